/* Learned Hamiltonians as a kind of model: their recipe, which tells how files store them. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "hamiltonian/files/constrained.h"
#include "hamiltonian/files/family.h"
#include "hamiltonian/internal.h"
#include "files/h5.h"
#include "model/files/recipe.h"

/* ---- the run ---- */

static uint32_t hidden_layers(const lg_hamiltonian *model) {
    return model->net.layers > 0 && model->net.layers <= LG_MLP_MAX_LAYERS ? model->net.layers - 1 : 0;
}

enum { SCALES = sizeof(lg_hamiltonian_scales) / sizeof(double) };
_Static_assert(sizeof(lg_hamiltonian_scales) == SCALES * sizeof(double),
               "scales are numbers one after the other");

/* The list has the scale of time, then the scales of the parts. Scales of 1 at its end are left out, but
 * never the first three numbers. */
enum { LEAST_SCALES = 3 };

static uint32_t get_scales(const void *member, double *values) {
    uint32_t count = SCALES;
    memcpy(values, member, sizeof(lg_hamiltonian_scales));
    while (count > LEAST_SCALES && values[count - 1] == 1.0) count--;
    return count;
}

static void put_scales(void *member, const double *values, uint32_t count) {
    const lg_hamiltonian_scales ones = LG_HAMILTONIAN_NO_SCALES;
    memcpy(member, &ones, sizeof ones);
    memcpy(member, values, count * sizeof *values);
}

#define FACT(group, name, type, member, ...)                                                                 \
    LG_FACT(lg_hamiltonian_run, group, name, type, member, __VA_ARGS__)
static const lg_field facts[] = {
    FACT("model", "family", NAME, model.family, .value_name = lg_name_family, .value_at = lg_family_number),
    FACT("model", "links", U32, model.n, .low = 1),
    FACT("model", "scales", REALS, model.scales, .low = 0, .get = get_scales, .put = put_scales,
         .least = LEAST_SCALES, .most = SCALES, .optional = true),
    FACT("run", "system", TEXT, system, .low = 0),
    FACT("run", "trajectories", U64, trajectories, .low = 0),
    FACT("run", "points", U64, points, .low = 0),
    FACT("run", "dt", REAL, dt, .low = 0),
    FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
    FACT("run", "penalty_sha256", TEXT, penalty_sha256, .low = 0, .optional = true),
    LG_FIELD_END};

static const lg_hamiltonian_run defaults = {.model = {.scales = LG_HAMILTONIAN_NO_SCALES},
                                            .substeps = 1,
                                            .penalty_integral = "oscillator",
                                            .training = {.schedule = LG_SCHEDULE_STEP}};

/* Whether all scales are above 0, and 1 for the parts that the family does not scale. */
static bool fit(const lg_hamiltonian_scales *scales, const lg_hamiltonian_family *family) {
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++)
        if (!(scales->part[i] > 0.0) || (!family->scaled[i] && scales->part[i] != 1.0)) return false;
    return scales->time > 0.0;
}

static lg_status build(lg_h5 *h5, void *user, lg_error *error) {
    lg_hamiltonian_run *run = user;
    lg_hamiltonian *model = &run->model;
    const lg_mlp read = model->net;
    const lg_symmetry symmetry = model->symmetry;
    const lg_hamiltonian_scales scales = model->scales;
    if (run->scheme == NULL) run->scheme = lg_scheme_at(0);
    const lg_status status = lg_hamiltonian_init(model, model->family, model->n, model->potential,
                                                 read.width + 1, hidden_layers(model), read.activation);
    if (status != LG_OK)
        return lg_fail(error, LG_FORMAT, "%s: /model: attributes links and hidden are out of range",
                       lg_shown_path(h5->path));
    if (!fit(&scales, model->family))
        return lg_fail(error, LG_FORMAT, "%s: /model: attribute scales is out of range",
                       lg_shown_path(h5->path));
    model->scales = scales;
    if (lg_hamiltonian_set_symmetry(model, symmetry) == LG_OK) return LG_OK;
    return lg_fail(error, LG_FORMAT,
                   "%s: /model: a model of family %s and links %u cannot have this symmetry",
                   lg_shown_path(h5->path), model->family->name, model->n);
}

static size_t parameters(const void *run) {
    return lg_hamiltonian_parameters(&((const lg_hamiltonian_run *)run)->model);
}

static lg_status check(const void *user) {
    const lg_hamiltonian_run *run = user;
    const lg_hamiltonian *model = &run->model;
    lg_hamiltonian again;
    LG_TRY(lg_hamiltonian_init(&again, model->family, model->n, model->potential, model->net.width + 1,
                               hidden_layers(model), model->net.activation));
    LG_TRY(lg_hamiltonian_set_symmetry(&again, model->symmetry));
    const bool same = again.net.layers == model->net.layers && fit(&model->scales, model->family) &&
                      lg_hamiltonian_parameters(&again) == parameters(run);
    return same && run->penalty_points.count <= LG_PENALTY_POINTS ? LG_OK : LG_INVALID_ARGUMENT;
}

static lg_status describe(lg_h5 *h5, const void *user, lg_error *error) {
    const lg_hamiltonian *model = &((const lg_hamiltonian_run *)user)->model;
    char layout[LG_LAYOUT_TEXT];
    lg_layout_text(model->family, model->n, layout);
    LG_TRY(lg_h5_put_text(h5, "model", "inputs", layout, error));
    LG_TRY(lg_h5_put_text(h5, "model", "input_units", model->family->state_units, error));
    LG_TRY(lg_h5_put_text(h5, "model", "outputs", "H", error));
    return lg_h5_put_text(h5, "model", "output_units", model->family->energy_unit, error);
}

/* ---- the flat parameter vector as named arrays ---- */

static void set_slice(lg_slice_info *s, size_t offset, uint32_t rank, uint64_t first, uint64_t second) {
    s->rank = rank;
    s->dims[0] = first, s->dims[1] = second;
    s->offset = offset;
    s->count = (size_t)(first * (rank == 2 ? second : 1));
}

/* The slices are the weights and biases of the potential, then the arrays of the family. */
static bool slice(const void *run, uint32_t index, lg_slice_info *s) {
    const lg_hamiltonian *model = &((const lg_hamiltonian_run *)run)->model;
    const lg_mlp *net = &model->net;
    for (uint32_t layer = 0; layer < net->layers; layer++) {
        if (index-- == 0) {
            set_slice(s, lg_mlp_weight_offset(net, layer), 2, net->width[layer], net->width[layer + 1]);
            (void)snprintf(s->name, sizeof s->name, "potential/layer%u/weight", layer + 1);
            return true;
        }
        if (!lg_mlp_has_bias(net, layer)) continue;
        if (index-- == 0) {
            set_slice(s, lg_mlp_bias_offset(net, layer), 1, net->width[layer + 1], 0);
            (void)snprintf(s->name, sizeof s->name, "potential/layer%u/bias", layer + 1);
            return true;
        }
    }
    if (index >= LG_HAMILTONIAN_MAX_ARRAYS || model->family->arrays[index].rank == 0) return false;
    const lg_hamiltonian_array *array = &model->family->arrays[index];
    const uint64_t m = lg_hamiltonian_array_length(model, index);
    set_slice(s, lg_hamiltonian_array_offset(model, index), array->rank, m, m);
    (void)snprintf(s->name, sizeof s->name, "%s", array->name);
    return true;
}

/* ---- the rest of the file ---- */

static lg_status put_optimizer(lg_h5 *h5, const lg_hamiltonian_file *file, lg_error *error) {
    const uint64_t count = file->parameters, words = 4;
    if (file->adam_m != NULL && file->adam_v != NULL) {
        LG_TRY(lg_h5_put(h5, "optimizer/adam/m", LG_ELEMENT_F64, 1, &count, file->adam_m, error));
        LG_TRY(lg_h5_put(h5, "optimizer/adam/v", LG_ELEMENT_F64, 1, &count, file->adam_v, error));
        LG_TRY(lg_h5_put(h5, "optimizer/adam/step", LG_ELEMENT_U64, 0, NULL, &file->adam_step, error));
    }
    return file->has_rng ? lg_h5_put(h5, "rng", LG_ELEMENT_U64, 1, &words, file->rng.s, error) : LG_OK;
}

/* ---- errors on a test set ---- */

static const char *const verdict_names[] = {"E1",          "E2",         "test_trajectories",
                                            "test_points", "test_t_end", "test_sha256"};

static lg_status put_real(lg_h5 *h5, const char *name, double value, lg_error *error) {
    if (!isfinite(value))
        return lg_fail(error, LG_NOT_FINITE, "%s: attribute %s is not finite", lg_shown_path(h5->path), name);
    return lg_h5_put_number(h5, "", name, LG_ELEMENT_F64, &value, error);
}

/* Writes what is known of the errors and the test set; unknown numbers are left out. */
static lg_status put_verdict(lg_h5 *h5, const lg_hamiltonian_file *file, lg_error *error) {
    const lg_test_set *test = &file->test;
    if (file->has_e1) LG_TRY(put_real(h5, "E1", file->e1, error));
    if (file->has_e2) LG_TRY(put_real(h5, "E2", file->e2, error));
    if (test->trajectories > 0)
        LG_TRY(lg_h5_put_number(h5, "", "test_trajectories", LG_ELEMENT_U64, &test->trajectories, error));
    if (test->points > 0)
        LG_TRY(lg_h5_put_number(h5, "", "test_points", LG_ELEMENT_U64, &test->points, error));
    if (test->t_end > 0) LG_TRY(put_real(h5, "test_t_end", test->t_end, error));
    return test->sha256[0] != '\0' ? lg_h5_put_text(h5, "", "test_sha256", test->sha256, error) : LG_OK;
}

/* Only people read the test set, so an attribute that cannot be read counts as unknown. */
static void get_test_set(lg_h5 *h5, lg_test_set *test) {
    lg_test_set got = {.trajectories = 0};
    if (lg_h5_number(h5, "", "test_trajectories", LG_ELEMENT_U64, &got.trajectories, NULL) == LG_OK)
        test->trajectories = got.trajectories;
    if (lg_h5_number(h5, "", "test_points", LG_ELEMENT_U64, &got.points, NULL) == LG_OK)
        test->points = got.points;
    if (lg_h5_number(h5, "", "test_t_end", LG_ELEMENT_F64, &got.t_end, NULL) == LG_OK && got.t_end > 0 &&
        isfinite(got.t_end))
        test->t_end = got.t_end;
    if (lg_h5_text(h5, "", "test_sha256", got.sha256, sizeof got.sha256, NULL) == LG_OK)
        memcpy(test->sha256, got.sha256, sizeof got.sha256);
}

static lg_status get_verdict(lg_h5 *h5, lg_hamiltonian_file *file, lg_error *error) {
    LG_TRY(lg_model_get_number(h5, "E1", &file->has_e1, &file->e1, error));
    LG_TRY(lg_model_get_number(h5, "E2", &file->has_e2, &file->e2, error));
    get_test_set(h5, &file->test);
    return LG_OK;
}

static lg_status put_rest(lg_h5 *h5, const void *user, bool fitted, lg_error *error) {
    const lg_hamiltonian_file *file = user;
    LG_TRY(put_verdict(h5, file, error));
    return fitted ? LG_OK : put_optimizer(h5, file, error);
}

static lg_status get_optimizer(lg_h5 *h5, lg_hamiltonian_file *out, lg_error *error) {
    const uint64_t words = 4;
    lg_h5_size count = {out->parameters, "parameters", "model"};
    const lg_h5_array moments[] = {{"optimizer/adam/m", &out->adam_m, {&count}, false},
                                   {"optimizer/adam/v", &out->adam_v, {&count}, false}};
    if (lg_h5_has(h5, "optimizer/adam")) {
        LG_TRY(lg_h5_get_arrays(h5, moments, LG_COUNT(moments), error));
        LG_TRY(lg_as_format(
            lg_h5_get(h5, "optimizer/adam/step", LG_ELEMENT_U64, 0, NULL, &out->adam_step, error), error));
        for (size_t i = 0; i < out->parameters; i++)
            if (out->adam_v[i] < 0)
                return lg_fail(error, LG_FORMAT,
                               "%s: /optimizer/adam/v: the value at index (%zu) is negative",
                               lg_shown_path(h5->path), i);
    }
    out->has_rng = lg_h5_has(h5, "rng");
    if (!out->has_rng) return LG_OK;
    return lg_as_format(lg_h5_get(h5, "rng", LG_ELEMENT_U64, 1, &words, out->rng.s, error), error);
}

/* A model file has the constraint among its functions; a checkpoint has no functions. */
static lg_status get_constraint(lg_h5 *h5, lg_hamiltonian_file *file, lg_error *error) {
    lg_hamiltonian *model = &file->run.model;
    if (!model->family->constrained) return LG_OK;
    LG_TRY(lg_h5_constraint(h5, NULL, &file->constraint, error));
    model->constraint = file->constraint;
    if (file->constraint == NULL || lg_constraint_coordinates(file->constraint) == model->n) return LG_OK;
    return lg_fail(error, LG_FORMAT, "%s: function constraint takes %u numbers, but the model has n = %u",
                   lg_shown_path(h5->path), lg_constraint_coordinates(file->constraint), model->n);
}

static lg_status get_rest(lg_h5 *h5, void *user, lg_error *error) {
    lg_hamiltonian_file *file = user;
    LG_TRY(get_constraint(h5, file, error));
    LG_TRY(get_optimizer(h5, file, error));
    return get_verdict(h5, file, error);
}

void lg_hamiltonian_file_destroy(lg_hamiltonian_file *file) {
    if (file == NULL) return;
    lg_constraint_destroy(file->constraint);
    lg_free(file->context, file->theta);
    lg_free(file->context, file->adam_m);
    lg_free(file->context, file->adam_v);
    lg_history_destroy(file->context, file->history);
    *file = (lg_hamiltonian_file){0};
}

/* ---- members of the recipe, and the recipe ---- */

static lg_status program(const lg_context *context, const void *user, const lg_scheme *scheme,
                         lg_program **out, lg_error *error) {
    const lg_hamiltonian_file *file = user;
    return lg_hamiltonian_program(context, &file->run.model, file->theta, scheme, out, error);
}

static lg_status space(const void *run, lg_space *out) {
    const lg_hamiltonian *model = &((const lg_hamiltonian_run *)run)->model;
    return lg_hamiltonian_space(model->family, model->n, out);
}

static const lg_scheme *usual_scheme(const void *file) {
    return lg_scheme_find(((const lg_hamiltonian_file *)file)->run.model.family->scheme);
}

extern const struct lg_trainer lg_hamiltonian_learner; /* in recipe.c */
LG_RECIPE(hamiltonian, "checkpoint", .scheme = usual_scheme, .space = space,
          .trainer = &lg_hamiltonian_learner);

/* ---- recording errors in a model file ---- */

/* The parameter x as a file of this type stores it. */
static double stored_as(lg_dtype dtype, double x) {
    return dtype == LG_F32 ? (double)(float)x : x;
}

static lg_status check_judged(const lg_h5 *h5, const lg_hamiltonian_file *judged,
                              const lg_hamiltonian_file *stored, lg_error *error) {
    LG_TRY(lg_recipe_compare_runs(&lg_recipe_hamiltonian, &stored->run, &judged->run, h5->path, error));
    bool same = judged->parameters == stored->parameters;
    for (size_t i = 0; same && i < stored->parameters; i++)
        same = stored->theta[i] == stored_as(judged->run.training.dtype, judged->theta[i]);
    return same ? LG_OK
                : lg_fail(error, LG_INVALID_ARGUMENT,
                          "%s: the parameters in this file are not the parameters that were judged",
                          lg_shown_path(h5->path));
}

static lg_status record(void *user, lg_h5 *h5, lg_error *error) {
    const lg_hamiltonian_file *judged = user;
    lg_hamiltonian_file stored = {.context = h5->context};
    lg_status status = lg_run_get_file(h5, &lg_recipe_hamiltonian, &stored, error);
    if (status == LG_OK) status = check_judged(h5, judged, &stored, error);
    lg_hamiltonian_file_destroy(&stored);
    for (size_t i = 0; status == LG_OK && i < LG_COUNT(verdict_names); i++)
        status = lg_h5_remove_attribute(h5, "", verdict_names[i], error);
    return status == LG_OK ? put_verdict(h5, judged, error) : status;
}

lg_status lg_hamiltonian_save_errors(const lg_context *context, const char *path,
                                     const lg_hamiltonian_file *file, lg_error *error) {
    if (path == NULL || file == NULL || file->theta == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a model file needs a name and parameters");
    return lg_run_edit(context, path, record, (void *)(uintptr_t)file, error); /* record() only reads it */
}

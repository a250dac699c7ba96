/* Learned Hamiltonians as a kind of model: their recipe, which tells how files store them. */
#include <stdio.h>
#include <string.h>

#include "hamiltonian/files/constrained.h"
#include "hamiltonian/files/family.h"
#include "hamiltonian/internal.h"
#include "model/files/recipe.h"

/* ---- the run ---- */

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

static const char *family_name(uint32_t value) {
    return value < lg_hamiltonian_family_count() ? lg_hamiltonian_family_at(value)->name : NULL;
}

static const void *family_at(uint32_t value) {
    return lg_hamiltonian_family_at(value);
}

#define FACT(group, name, type, member, ...)                                                                 \
    LG_FACT(lg_hamiltonian_run, group, name, type, member, __VA_ARGS__)
static const lg_field facts[] = {
    FACT("model", "family", NAME, model.family, .value_name = family_name, .value_at = family_at),
    FACT("model", "links", U32, model.n, .low = 1),
    FACT("model", "scales", REALS, model.scales, .get = get_scales, .put = put_scales, .least = LEAST_SCALES,
         .most = SCALES, .optional = true),
    FACT("run", "system", TEXT, system, .low = 0),
    FACT("run", "trajectories", U64, trajectories, .low = 0),
    FACT("run", "points", U64, points, .low = 0),
    FACT("run", "dt", REAL, dt, .low = 0),
    FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
    FACT("run", "penalty_sha256", TEXT, penalty_sha256, .optional = true),
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

static lg_status make(void *user, lg_error *why) {
    lg_hamiltonian_run *run = user;
    lg_hamiltonian *model = &run->model;
    const lg_hamiltonian read = *model;
    if (run->scheme == NULL) run->scheme = lg_scheme_at(0);
    const lg_status status =
        lg_hamiltonian_init(model, read.family, read.n, read.potential, read.net.width + 1,
                            read.net.layers > 0 ? read.net.layers - 1 : 0, read.net.activation);
    if (status != LG_OK) return lg_fail(why, status, "/model: attributes links and hidden are out of range");
    if (!fit(&read.scales, model->family))
        return lg_fail(why, LG_INVALID_ARGUMENT, "/model: attribute scales is out of range");
    model->scales = read.scales;
    model->constraint = read.constraint;
    if (lg_hamiltonian_set_symmetry(model, read.symmetry) == LG_OK) return LG_OK;
    return lg_fail(why, LG_INVALID_ARGUMENT,
                   "/model: a model of family %s and links %u cannot have this symmetry", model->family->name,
                   model->n);
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

/* The slices are the weights and biases of the potential, then the arrays of the family. */
static bool slice(const void *run, uint32_t index, lg_slice_info *s) {
    const lg_hamiltonian *model = &((const lg_hamiltonian_run *)run)->model;
    if (lg_slice_of_mlp(&model->net, "potential", 0, &index, s)) return true;
    if (index >= LG_HAMILTONIAN_MAX_ARRAYS || model->family->arrays[index].rank == 0) return false;
    const lg_hamiltonian_array *array = &model->family->arrays[index];
    const uint64_t m = lg_hamiltonian_array_length(model, index);
    lg_slice_set(s, lg_hamiltonian_array_offset(model, index), array->rank, m, m);
    (void)snprintf(s->name, sizeof s->name, "%s", array->name);
    return true;
}

/* ---- the rest of the file ---- */

#define RESULT(type, name, member, ...) LG_ATTRIBUTE(lg_hamiltonian_file, type, name, member, __VA_ARGS__)
static const lg_item items[] = {
    RESULT(REAL, "E1", e1, .known = offsetof(lg_hamiltonian_file, has_e1),
           .field.meaning = "mean squared error of the learned flow, integrated accurately from the starts "
                            "of the test set, over its trajectories, coordinates and points"),
    RESULT(REAL, "E2", e2, .known = offsetof(lg_hamiltonian_file, has_e2),
           .field.meaning = "mean |d - mean d|, d = true H - learned H at these starts"),
    /* only people read the test set */
    RESULT(U64, "test_trajectories", test.trajectories, .lenient = true),
    RESULT(U64, "test_points", test.points, .lenient = true),
    RESULT(REAL, "test_t_end", test.t_end, .lenient = true),
    RESULT(TEXT, "test_sha256", test.sha256, .lenient = true),
    {.type = LG_ITEM_END}};

/* A model file has the constraint among its functions; a checkpoint has no functions. */
static lg_status get_constraint(lg_h5 *h5, void *user, lg_error *error) {
    lg_hamiltonian_file *file = user;
    lg_hamiltonian *model = &file->run.model;
    if (!model->family->constrained) return LG_OK;
    LG_TRY(lg_h5_constraint(h5, NULL, &file->constraint, error));
    model->constraint = file->constraint;
    if (file->constraint == NULL || lg_constraint_coordinates(file->constraint) == model->n) return LG_OK;
    return lg_h5_fail(h5, error, "function constraint takes %u numbers, but the model has n = %u",
                      lg_constraint_coordinates(file->constraint), model->n);
}

static void release(void *user) {
    lg_constraint_destroy(((lg_hamiltonian_file *)user)->constraint);
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
LG_RECIPE(hamiltonian, "checkpoint", LG_MADE(lg_hamiltonian_run, model.net), .items = items,
          .get_rest = get_constraint, .release = release, .scheme = usual_scheme, .space = space,
          .trainer = &lg_hamiltonian_learner);

/* ---- recording errors in a model file ---- */

static void release_stored(lg_hamiltonian_file *file) {
    lg_recipe_release(&lg_recipe_hamiltonian, file);
}

static lg_status record(void *user, lg_h5 *h5, lg_error *error) {
    const lg_hamiltonian_file *judged = user;
    LG_CLEAN(release_stored) lg_hamiltonian_file stored = {.context = h5->context};
    LG_TRY(lg_run_get_file(h5, &lg_recipe_hamiltonian, &stored, error));
    LG_TRY(lg_recipe_compare_runs(&lg_recipe_hamiltonian, &stored.run, &judged->run, h5->path, error));
    const bool single = judged->run.training.dtype == LG_F32; /* the file then stores floats */
    bool same = judged->parameters == stored.parameters;
    for (size_t i = 0; same && i < stored.parameters; i++)
        same = stored.theta[i] == (single ? (double)(float)judged->theta[i] : judged->theta[i]);
    if (!same)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%s: the parameters in this file are not the parameters that were judged",
                       lg_shown_path(h5->path));
    for (size_t i = 0; i + 1 < LG_COUNT(items); i++)
        LG_TRY(lg_h5_remove_attribute(h5, "", items[i].field.name, error));
    return lg_items_put(h5, &lg_recipe_hamiltonian, judged, error);
}

lg_status lg_hamiltonian_save_errors(const lg_context *context, const char *path,
                                     const lg_hamiltonian_file *file, lg_error *error) {
    if (path == NULL || file == NULL || file->theta == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a model file needs a name and parameters");
    return lg_run_edit(context, path, record, (void *)(uintptr_t)file, error); /* record() only reads it */
}

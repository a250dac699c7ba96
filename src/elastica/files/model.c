/* Surrogates of the elastica as a kind of model: their attributes and arrays in model files. */
#include <math.h>
#include <string.h>

#include "liegrad/elastica.h"

#include "model/files/program_file.h"
#include "model/files/recipe.h"

enum { BOUNDARY = 8 };

/* ---- the run ---- */

#define FACT(group, name, type, member, ...) LG_FACT(lg_surrogate_run, group, name, type, member, __VA_ARGS__)
static const lg_field facts[] = {
    FACT("model", "intervals", U32, model.intervals, .low = LG_ELASTICA_MIN_INTERVALS),
    FACT("model", "length", REAL, model.length, .low = 0),
    FACT("model", "centre", REAL, model.centre, .low = 0),
    FACT("run", "curves", U64, curves, .low = 0),
    FACT("run", "stiffness", REAL, stiffness, .optional = true),
    FACT("run", "values", NAME, continuous, LG_NAMES("discrete", "continuous")),
    FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
    LG_FIELD_END};

static const lg_surrogate_run defaults = {.training = {.shards = 4}};

static lg_status make(void *user, lg_error *why) {
    lg_surrogate *model = &((lg_surrogate_run *)user)->model;
    const lg_surrogate_options options = model->options;
    return lg_surrogate_init(model, &options, model->intervals, model->length, model->centre, why);
}

static lg_status describe(lg_h5 *h5, const void *user, lg_error *error) {
    static const struct {
        const char *inputs, *outputs;
    } names[LG_SURROGATE_KIND_COUNT] = {
        [LG_SURROGATE_DISCRETE] = {"q0 v0 qN vN", "q1 ... q(N-1) v1 ... v(N-1)"},
        [LG_SURROGATE_CONTINUOUS] = {"s/L q0 v0 qN vN", "q"},
        [LG_SURROGATE_ANGLE] = {"theta_0/pi theta_N/pi s", "theta/pi"},
    };
    const lg_surrogate_kind kind = ((const lg_surrogate_run *)user)->model.options.kind;
    LG_TRY(lg_h5_put_text(h5, "model", "inputs", names[kind].inputs, error));
    return lg_h5_put_text(h5, "model", "outputs", names[kind].outputs, error);
}

static bool slice(const void *run, uint32_t index, lg_slice_info *out) {
    return lg_net_slice(&((const lg_surrogate_run *)run)->model.net, index, out);
}

/* ---- other arrays and numbers of the file ---- */

/* Writes /model/mean (n) and /model/modes (K, n), n = 4(N - 1). */
static lg_status put_modes(lg_h5 *h5, const void *file, lg_error *error) {
    const lg_surrogate *model = &((const lg_surrogate_file *)file)->run.model;
    const uint64_t n = 4 * ((uint64_t)model->intervals - 1), dims[2] = {model->options.modes, n};
    if (model->options.modes == 0) return LG_OK;
    if (model->modes == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%s: the model has modes, but the numbers of the modes are missing",
                       lg_shown_path(h5->path));
    LG_TRY(lg_check_finite(h5->path, "model/mean", 1, &n, model->modes, error));
    LG_TRY(lg_check_finite(h5->path, "model/modes", 2, dims, model->modes + n, error));
    LG_TRY(lg_h5_put(h5, "model/mean", LG_ELEMENT_F64, 1, &n, model->modes, error));
    return lg_h5_put(h5, "model/modes", LG_ELEMENT_F64, 2, dims, model->modes + n, error);
}

static lg_status get_modes(lg_h5 *h5, void *user, lg_error *error) {
    lg_surrogate_file *file = user;
    lg_surrogate *model = &file->run.model;
    const uint64_t n = 4 * ((uint64_t)model->intervals - 1), dims[2] = {model->options.modes, n};
    if (model->options.modes == 0) return LG_OK;
    file->modes = lg_alloc(h5->context, lg_surrogate_modes_size(model), sizeof *file->modes);
    if (file->modes == NULL) return lg_h5_no_memory(h5, error);
    model->modes = file->modes;
    LG_TRY(lg_h5_get_finite(h5, "model/mean", 1, &n, file->modes, error));
    return lg_h5_get_finite(h5, "model/modes", 2, dims, file->modes + n, error);
}

#define RESULT(member, ...)                                                                                  \
    LG_ATTRIBUTE(lg_surrogate_file, REAL, #member, member, .known = offsetof(lg_surrogate_file, has_errors), \
                 __VA_ARGS__)
static const lg_item items[] = {
    {.type = LG_ITEM_ARRAY,
     .name = "trained",
     .offset = offsetof(lg_surrogate_file, trained),
     .dims = {LG_DIM(lg_surrogate_file, trained_count, "curves"), {.offset = BOUNDARY}},
     .optional = true},
    {.type = LG_ITEM_ARRAY, .offset = offsetof(lg_surrogate_file, modes)},
    RESULT(train_mse, .field.meaning = "mean square error of q and v at the nodes"),
    RESULT(test_mse, .optional = true),
    {.type = LG_ITEM_END}};

/* ---- program and recipe ---- */

static lg_status program(const lg_context *context, const void *user, const lg_scheme *scheme,
                         lg_program **out, lg_error *error) {
    const lg_surrogate_file *file = user;
    return lg_surrogate_program(context, &file->run.model, file->theta, out, error);
}

static const lg_program_source places[] = {{"mean", "model/mean"}, {"modes", "model/modes"}, {NULL, NULL}};

extern const struct lg_trainer lg_surrogate_learner; /* defined in recipe.c */
LG_RECIPE(surrogate, "surrogate-checkpoint", LG_MADE(lg_surrogate_run, model.net), .items = items,
          .put_rest = put_modes, .get_rest = get_modes, .places = places, .trainer = &lg_surrogate_learner);

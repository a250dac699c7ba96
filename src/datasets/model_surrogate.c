/* Surrogates of the elastica as a kind of model. */
#include <math.h>

#include "datasets/names.h"
#include "datasets/run.h"

enum { BOUNDARY = 8 };

/* ---- the run ---- */

#define FACT(group, name, type, member, ...) LG_FACT(lg_surrogate_run, group, name, type, member, __VA_ARGS__)
static const lg_hyperparameter facts[] = {
    FACT("model", "intervals", U32, model.intervals, .low = LG_ELASTICA_MIN_INTERVALS),
    FACT("model", "length", REAL, model.length, .low = 0),
    FACT("model", "centre", REAL, model.centre, .low = 0),
    FACT("run", "curves", U64, curves, .low = 0),
    FACT("run", "values", NAME, continuous, .value_name = lg_name_values),
    FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
    LG_HYPERPARAMETER_END};

static const lg_surrogate_run defaults = {.training = {.shards = 4}};

static lg_status build(lg_h5 *h5, void *user, lg_error *error) {
    lg_surrogate_run *run = user;
    const lg_surrogate *model = &run->model;
    const char *shown = lg_shown_path(h5->path);
    lg_error reason = {LG_OK, ""};
    const lg_surrogate_options options = model->options;
    if (lg_surrogate_init(&run->model, &options, model->intervals, model->length, model->centre, &reason) !=
        LG_OK)
        return lg_fail(error, LG_FORMAT, "%s: /model: the attributes are no network: %s", shown,
                       reason.message);
    return LG_OK;
}

static lg_status check(const void *user) {
    const lg_surrogate_run *run = user;
    const lg_surrogate *model = &run->model;
    lg_surrogate again;
    LG_TRY(lg_surrogate_init(&again, &model->options, model->intervals, model->length, model->centre, NULL));
    const lg_net *net = &model->net, *made = &again.net;
    const bool same = net->kind == made->kind && net->inputs == made->inputs &&
                      net->outputs == made->outputs && net->embedding == made->embedding &&
                      net->hidden == made->hidden && net->layers == made->layers &&
                      net->activation == made->activation;
    return same ? LG_OK : LG_INVALID_ARGUMENT;
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

static size_t parameters(const void *run) {
    return lg_surrogate_parameters(&((const lg_surrogate_run *)run)->model);
}

static bool slice(const void *run, uint32_t index, lg_slice_info *out) {
    return lg_net_slice(&((const lg_surrogate_run *)run)->model.net, index, out);
}

/* ---- the rest of the file ---- */

static lg_status put_rest(lg_h5 *h5, const void *user, bool fitted, lg_error *error) {
    const lg_surrogate_file *file = user;
    const uint64_t dims[2] = {file->trained_count, BOUNDARY};
    (void)fitted;
    if (file->trained != NULL) {
        LG_TRY(lg_check_finite(h5->path, "trained", 2, dims, file->trained, error));
        LG_TRY(lg_h5_put(h5, "trained", LG_ELEMENT_F64, 2, dims, file->trained, error));
    }
    if (!file->has_errors) return LG_OK;
    if (!isfinite(file->train_mse))
        return lg_fail(error, LG_NOT_FINITE, "%s: attribute train_mse is not finite",
                       lg_shown_path(h5->path));
    LG_TRY(lg_h5_put_number(h5, "", "train_mse", LG_ELEMENT_F64, &file->train_mse, error));
    if (isnan(file->test_mse)) return LG_OK;
    return lg_h5_put_number(h5, "", "test_mse", LG_ELEMENT_F64, &file->test_mse, error);
}

static lg_status get_rest(lg_h5 *h5, void *user, lg_error *error) {
    lg_surrogate_file *file = user;
    bool tested;
    uint64_t dims[4];
    if (lg_h5_has(h5, "trained")) {
        LG_TRY(lg_as_format(lg_h5_get_doubles(h5, "trained", 2, dims, &file->trained, error), error));
        if (dims[0] < 1 || dims[1] != BOUNDARY)
            return lg_fail(error, LG_FORMAT, "%s: /trained: shape (%llu, %llu), expected (n, %d)",
                           lg_shown_path(h5->path), (unsigned long long)dims[0], (unsigned long long)dims[1],
                           BOUNDARY);
        file->trained_count = (size_t)dims[0];
    }
    file->test_mse = NAN;
    LG_TRY(lg_model_get_number(h5, "train_mse", &file->has_errors, &file->train_mse, error));
    return lg_model_get_number(h5, "test_mse", &tested, &file->test_mse, error);
}

void lg_surrogate_file_destroy(lg_surrogate_file *file) {
    if (file == NULL) return;
    lg_free(file->context, file->theta);
    lg_free(file->context, file->trained);
    lg_history_destroy(file->context, file->history);
    *file = (lg_surrogate_file){0};
}

/* ---- outside ---- */

LG_RUN_KIND(surrogate, "surrogate-checkpoint")

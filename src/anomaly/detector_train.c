/* Training of detectors: scaled windows as data, the loss on a tape, presets of the settings. */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "kernels/kernels.h"
#include "core/clean.h"
#include "liegrad/ops.h"
#include "anomaly/detector_internal.h"
#include "model/record.h"

/* ---- data ---- */

static lg_status check_data(const lg_detector *model, const lg_scaler *scaler, const lg_series *series,
                            const lg_windows *windows, const uint32_t *chosen, size_t count,
                            lg_error *error) {
    if (count == 0) return lg_fail(error, LG_INVALID_ARGUMENT, "there are no windows to learn from");
    if (series->channels != model->net.channels || windows->length != model->net.length)
        return lg_fail(error, LG_SHAPE,
                       "windows of %" PRIu32 " channels and %" PRIu32
                       " samples do not fit a detector for %" PRIu32 " channels and %" PRIu32 " samples",
                       series->channels, windows->length, model->net.channels, model->net.length);
    if (scaler->channels != series->channels)
        return lg_fail(error, LG_SHAPE,
                       "the scaling is for %" PRIu32 " channels, but the windows have %" PRIu32,
                       scaler->channels, series->channels);
    for (size_t i = 0; i < count; i++) {
        const size_t window = chosen != NULL ? chosen[i] : i;
        if (window >= windows->count)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "there is no window %zu (counted from 0): there are %zu windows", window,
                           windows->count);
        const uint32_t label = series->label[windows->first[window]];
        if (label >= model->classes)
            return lg_fail(error, LG_SHAPE,
                           "window %zu is of class %" PRIu32 " (counted from 0); the detector tells %" PRIu32
                           " classes apart",
                           window, label, model->classes);
    }
    return LG_OK;
}

lg_status lg_detector_data_create(const lg_context *context, const lg_detector *model,
                                  const lg_scaler *scaler, const lg_series *series, const lg_windows *windows,
                                  const uint32_t *chosen, size_t count, lg_dtype dtype, lg_detector_data *out,
                                  lg_error *error) {
    LG_NEEDS(error, model, scaler, series, windows, out);
    if (chosen == NULL) count = windows->count;
    LG_TRY(check_data(model, scaler, series, windows, chosen, count, error));
    const lg_kernels *k = lg_kernels_for(dtype);
    const size_t numbers = (size_t)model->net.length * model->net.channels;
    LG_CLEAN(lg_detector_data_destroy)
    lg_detector_data made = {.count = count, .dtype = dtype, .context = context};
    LG_TRY_SCRATCH(float, window, context, numbers, lg_no_memory(error));
    if (LG_ALLOC_ALL(context, {&made.x, count, numbers * k->size}, LG_ARRAY(made.label, count)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu windows of %zu numbers", count, numbers);
    for (size_t i = 0; i < count; i++) {
        const size_t index = chosen != NULL ? chosen[i] : i;
        char *row = (char *)made.x + i * numbers * k->size;
        lg_windows_copy(series, windows, index, window);
        lg_detector_scale(model, scaler, dtype, window, row);
        made.label[i] = series->label[windows->first[index]];
        if (!k->all_finite(numbers, row))
            return lg_fail(error, LG_NOT_FINITE, "window %zu has numbers that are not finite after scaling",
                           index);
    }
    return LG_GIVE(out, made);
}

void lg_detector_data_destroy(lg_detector_data *data) {
    if (data == NULL) return;
    LG_FREE_ALL(data->context, data->x, data->label);
    *data = (lg_detector_data){0};
}

/* ---- loss ---- */

lg_var lg_detector_put_windows(const lg_detector_problem *problem, lg_tape *tape, const uint32_t *samples,
                               uint32_t count) {
    const lg_cnn *net = &problem->model->net;
    return lg_record_rows(tape, problem->data->dtype, problem->data->x,
                          lg_shape3(count, net->length, net->channels), samples);
}

static lg_status shard_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                            size_t batch, lg_var *loss) {
    const lg_detector_problem *problem = user;
    const lg_var x = lg_detector_put_windows(problem, tape, samples, (uint32_t)count);
    const lg_var target =
        lg_record_labels(tape, problem->data->label, problem->model->net.outputs, samples, (uint32_t)count);
    const lg_var y = lg_cnn_record(tape, &problem->model->net, theta, 0, x, NULL);
    lg_var mean;
    if (problem->model->loss == LG_DETECTOR_MSE)
        mean = lg_loss_record(tape, LG_LOSS_MSE, lg_act(tape, y, LG_SIGMOID), target, LG_NONE);
    else
        mean = lg_loss_record(tape, LG_LOSS_CROSS_ENTROPY, y, target, LG_NONE);
    *loss = count == batch ? mean : lg_scale(tape, mean, (double)count / (double)batch);
    return lg_tape_status(tape);
}

/* Chooses the number of windows recorded at once so that their values take at most 1.5 MiB and stay in the
 * L2 cache. Measured on windows of 6 x 300: 8 to 15 windows at once are equally fast; fewer or more are
 * slower. A window puts the input of the network on the tape, and for each output of a
 * block about four numbers: sums, activations and their cotangents. */
size_t lg_detector_chunk(const lg_detector_problem *problem) {
    const size_t limit = ((size_t)3 << 19) / lg_kernels_for(problem->data->dtype)->size;
    const lg_cnn *net = &problem->model->net;
    size_t sum = (size_t)net->length * net->channels;
    for (uint32_t i = 0; i < net->blocks; i++)
        sum += 4 * (size_t)net->lengths[i + 1] * net->block[i].channels *
               (net->block[i].pooling != LG_POOL_NONE ? net->block[i].pool_stride : 1);
    const size_t chunk = limit / sum;
    return chunk < 1 ? 1 : chunk < LG_FIT_CHUNK ? chunk : LG_FIT_CHUNK;
}

void lg_detector_fit_problem(const lg_detector_problem *problem, lg_fit_problem *out) {
    *out = (lg_fit_problem){.parameters = lg_cnn_parameters(&problem->model->net),
                            .samples = problem->data->count,
                            .loss = shard_loss,
                            .user = (void *)(uintptr_t)problem, /* never written */
                            .validation = problem->data->count - problem->training,
                            .chunk = lg_detector_chunk(problem),
                            .revive = lg_detector_revive};
}

/* ---- presets ---- */

#define TRAINING(epochs_, batch_, lr_, schedule_, factor_, decay_, clip_)                                    \
    {                                                                                                        \
        .dtype = LG_F32, .epochs = epochs_, .batch = batch_, .lr = lr_, .schedule = LG_SCHEDULE_##schedule_, \
        .lr_step = 1, .lr_gamma = factor_, .weight_decay = decay_, .adam_eps = 1e-8, .clip = clip_,          \
        .validation = 0.0, .shards = 4, .seed = 1                                                            \
    }

/* clang-format off */
static const lg_detector_preset presets[] = {
    /* name    noise  source       activation     loss                                 epochs batch lr     schedule factor decay  clip */
    {"thesis",  1.0, "table 6.5", LG_LEAKY_RELU, LG_DETECTOR_MSE,           TRAINING(100, 30, 2.562e-2, CONSTANT, 1.0,  1.243e-5, 0.0)},
    {"thesis", 10.0, "table 6.5", LG_LEAKY_RELU, LG_DETECTOR_MSE,           TRAINING(100, 10, 2.102e-3, CONSTANT, 1.0,  1.221e-5, 0.0)},
    {"thesis", 50.0, "table 6.5", LG_SWISH,      LG_DETECTOR_MSE,           TRAINING(100, 30, 1.017e-2, CONSTANT, 1.0,  1.520e-7, 0.0)},
    {"best",    NAN, "ours",      LG_LEAKY_RELU, LG_DETECTOR_CROSS_ENTROPY, TRAINING(100, 30, 1.0e-2,   COSINE,   1e-3, 1.0e-5,   1.0)},
    {"best",    1.0, "ours",      LG_SWISH,      LG_DETECTOR_CROSS_ENTROPY, TRAINING(100, 30, 3.0e-3,   COSINE,   0.0,  1.0e-5,   0.0)},
    {"best",   10.0, "ours",      LG_SWISH,      LG_DETECTOR_CROSS_ENTROPY, TRAINING(100, 30, 3.0e-3,   COSINE,   0.0,  1.0e-5,   0.0)},
    {"best",   50.0, "ours",      LG_SWISH,      LG_DETECTOR_CROSS_ENTROPY, TRAINING(100, 30, 3.0e-3,   COSINE,   0.0,  1.0e-3,   0.0)},
};
/* clang-format on */

/* Distance between two noise levels, where NaN means that the level is unknown. An unknown level has distance
 * 0 from another unknown level and infinite distance from a known one. */
static double level_distance(double row, double noise) {
    if (isnan(row) || isnan(noise)) return isnan(row) && isnan(noise) ? 0 : INFINITY;
    return fabs(row - noise);
}

const lg_detector_preset *lg_detector_preset_find(const char *name, double noise) {
    const lg_detector_preset *best = NULL;
    for (size_t i = 0; name != NULL && i < LG_COUNT(presets); i++) {
        const lg_detector_preset *row = &presets[i];
        if (strcmp(row->name, name) != 0) continue;
        if (best == NULL || level_distance(row->noise, noise) < level_distance(best->noise, noise))
            best = row;
    }
    return best;
}

/* Detectors: check of the description, scaling of windows, evaluation by a plan. */
#include <inttypes.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "kernels/kernels.h"
#include "core/clean.h"
#include "core/portions.h"
#include "anomaly/detector_internal.h"

LG_AT(lg_detector_plan_destroy, lg_detector_plan)

static const char *const loss_names[LG_DETECTOR_LOSS_COUNT] = {"mse", "cross-entropy"};

const char *lg_detector_loss_name(lg_detector_loss loss) {
    return (unsigned)loss < LG_DETECTOR_LOSS_COUNT ? loss_names[loss] : "unknown";
}

lg_status lg_detector_check(const lg_detector *model, lg_error *error) {
    if (model == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the detector is NULL");
    if ((unsigned)model->loss >= LG_DETECTOR_LOSS_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown loss");
    if (model->classes < 2)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a detector tells at least 2 classes apart, not %" PRIu32,
                       model->classes);
    const bool mse = model->loss == LG_DETECTOR_MSE;
    if (mse && model->classes != 2)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the loss \"mse\" is for 2 classes, not %" PRIu32 "; take \"cross-entropy\"",
                       model->classes);
    const uint32_t outputs = mse ? 1 : model->classes;
    if (model->net.outputs != outputs)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the network has %" PRIu32 " outputs, but %" PRIu32
                       " classes with the loss \"%s\" need %" PRIu32,
                       model->net.outputs, model->classes, loss_names[model->loss], outputs);
    lg_cnn again = model->net;
    LG_TRY(lg_cnn_init(&again, error));
    if (memcmp(again.lengths, model->net.lengths, sizeof again.lengths) != 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the network was not initialised with lg_cnn_init");
    return LG_OK;
}

/* ---- scaling ---- */

/* Returns the mean of one channel over the window if the model is centred, otherwise 0. It uses four partial
 * sums. */
static double own_mean(const lg_detector *model, const float *x) {
    const size_t n = model->net.length;
    double sum[4] = {0.0};
    if (!model->centred) return 0.0;
    size_t t = 0;
    for (; t + 4 <= n; t += 4)
        for (size_t j = 0; j < 4; j++) sum[j] += (double)x[t + j];
    for (; t < n; t++) sum[0] += (double)x[t];
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) / (double)n;
}

/* Computes x - mean in double: x is often close to its mean, far from 0, and single precision would lose
 * digits. */
void lg_detector_scale(const lg_detector *model, const lg_scaler *scaler, lg_dtype dtype, const float *x,
                       void *out) {
    const size_t n = model->net.length, channels = model->net.channels;
    for (size_t c = 0; c < channels; c++, x += n) {
        const double mean = scaler->mean[c] + own_mean(model, x), inverse = 1.0 / scaler->scale[c];
        if (dtype == LG_F64)
            for (size_t t = 0; t < n; t++)
                ((double *)out)[t * channels + c] = ((double)x[t] - mean) * inverse;
        else
            for (size_t t = 0; t < n; t++)
                ((float *)out)[t * channels + c] = (float)(((double)x[t] - mean) * inverse);
    }
}

/* ---- evaluation ---- */

struct lg_detector_plan {
    const lg_context *context;
    lg_detector model;
    lg_scaler scaler; /* its arrays point into `numbers` */
    double *numbers;
    lg_plan *scores;
    lg_dtype dtype;
};

/* Parts of the caller's work memory: scaled window, probabilities, plane, work of the plan. */
typedef struct pieces {
    void *z, *probability, *plane, *plan;
} pieces;

static pieces cut(const lg_detector_plan *plan, lg_portions *from) {
    const lg_cnn *net = &plan->model.net;
    const size_t size = lg_kernels_for(plan->dtype)->size;
    pieces p;
    p.z = lg_portion(from, (size_t)net->length * net->channels, size);
    p.probability = lg_portion(from, plan->model.classes, size);
    p.plane = lg_portion(from, net->plane, size);
    p.plan = lg_portion(from, lg_plan_work_size(plan->scores), 1);
    return p;
}

size_t lg_detector_work_size(const lg_detector_plan *plan) {
    lg_portions from = {NULL, 0};
    (void)cut(plan, &from);
    return from.used;
}

static lg_status make_scores(lg_detector_plan *made, const double *theta, lg_error *error) {
    LG_CLEAN(lg_program_destroy_at) lg_program *program = NULL;
    LG_TRY(lg_detector_build(made->context, &made->model, &made->scaler, theta, true, &program, error));
    return lg_program_plan(program, "scores", made->dtype, 1, &made->scores, error);
}

lg_status lg_detector_plan_create(const lg_context *context, const lg_detector *model,
                                  const lg_scaler *scaler, const double *theta, lg_dtype dtype,
                                  lg_detector_plan **out, lg_error *error) {
    LG_NEEDS(error, model, scaler, theta, out);
    const size_t channels = model->net.channels;
    LG_CLEAN(lg_detector_plan_destroy_at) lg_detector_plan *made = lg_alloc(context, 1, sizeof *made);
    LG_SCRATCH(double, numbers, context, 2 * channels);
    if (made != NULL) made->context = context;
    if (made == NULL || numbers == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a detector of %zu channels", channels);
    memcpy(numbers, scaler->mean, channels * sizeof *numbers);
    memcpy(numbers + channels, scaler->scale, channels * sizeof *numbers);
    *made = (lg_detector_plan){
        .context = context,
        .model = *model,
        .scaler = {.channels = scaler->channels, .mean = numbers, .scale = numbers + channels},
        .numbers = LG_KEEP(numbers),
        .dtype = dtype};
    LG_TRY(make_scores(made, theta, error));
    return LG_MOVE(out, made);
}

void lg_detector_plan_destroy(lg_detector_plan *plan) {
    if (plan == NULL) return;
    lg_plan_destroy(plan->scores);
    LG_FREE_ALL(plan->context, plan->numbers, plan);
}

void lg_detector_eval(const lg_detector_plan *plan, const float *x, double *probability, double *plane,
                      void *work) {
    const lg_kernels *k = lg_kernels_for(plan->dtype);
    lg_portions from = {work, 0};
    const pieces p = cut(plan, &from);
    lg_detector_scale(&plan->model, &plan->scaler, plan->dtype, x, p.z);
    lg_plan_eval(plan->scores, (const void *const[]){p.z}, (void *const[]){p.probability, p.plane}, p.plan);
    k->convert_out(plan->model.classes, p.probability, probability);
    if (plane != NULL) k->convert_out(plan->model.net.plane, p.plane, plane);
}

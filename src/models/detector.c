/* Detectors: description, scaling of windows, evaluation. */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "kernels/kernels.h"
#include "core/core.h"
#include "models/detector_internal.h"
#include "nn/eval.h"

static const char *const loss_names[LG_DETECTOR_LOSS_COUNT] = {"mse", "cross-entropy"};

const char *lg_detector_loss_name(lg_detector_loss loss) {
    return (unsigned)loss < LG_DETECTOR_LOSS_COUNT ? loss_names[loss] : "unknown";
}

lg_status lg_detector_loss_parse(const char *name, lg_detector_loss *out) {
    for (int i = 0; name != NULL && i < LG_DETECTOR_LOSS_COUNT; i++)
        if (strcmp(name, loss_names[i]) == 0) {
            *out = (lg_detector_loss)i;
            return LG_OK;
        }
    return LG_NOT_FOUND;
}

lg_status lg_detector_check(const lg_detector *model, lg_error *error) {
    (void)lg_fail(error, LG_OK, "%s", "");
    if (model == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "there is no detector");
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
                       "a network of %" PRIu32 " outputs; %" PRIu32 " classes with the loss \"%s\" take "
                       "%" PRIu32,
                       model->net.outputs, model->classes, loss_names[model->loss], outputs);
    lg_cnn again = model->net;
    LG_TRY(lg_cnn_init(&again, error));
    if (memcmp(again.lengths, model->net.lengths, sizeof again.lengths) != 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the network has not been through lg_cnn_init");
    return LG_OK;
}

/* ---- scaling ---- */

/* The window's mean of one channel, or 0. Four sums side by side. */
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

/* x is near its mean as a rule: the difference in double loses nothing. */
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

double lg_detector_mean(const double *x, size_t n) {
    double sum[4] = {0.0};
    size_t t = 0;
    for (; t + 4 <= n; t += 4)
        for (size_t j = 0; j < 4; j++) sum[j] += x[t + j];
    for (; t < n; t++) sum[0] += x[t];
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) / (double)n;
}

void lg_detector_scale_numbers(const lg_detector *model, const lg_scaler *scaler, const double *x,
                               double *out) {
    const size_t n = model->net.length, channels = model->net.channels;
    for (size_t c = 0; c < channels; c++, x += n) {
        const double own = model->centred ? lg_detector_mean(x, n) : 0.0;
        const double mean = scaler->mean[c] + own, inverse = 1.0 / scaler->scale[c];
        for (size_t t = 0; t < n; t++) out[t * channels + c] = (x[t] - mean) * inverse;
    }
}

/* ---- evaluation ---- */

typedef struct pieces {
    char *x;      /* (length, channels), scaled */
    char *logits; /* (outputs) */
    char *plane;  /* (plane) */
    char *net;    /* of lg_cnn_eval */
} pieces;

/* With `work` NULL only *bytes is of use. */
static pieces cut(const lg_detector *model, lg_dtype dtype, void *work, size_t *bytes) {
    const size_t size = lg_kernels_for(dtype)->size;
    const lg_cnn *net = &model->net;
    char *rest = work;
    pieces p;
    *bytes = 0;
    p.x = eval_take(&rest, bytes, (size_t)net->length * net->channels * size);
    p.logits = eval_take(&rest, bytes, net->outputs * size);
    p.plane = eval_take(&rest, bytes, net->plane * size);
    p.net = eval_take(&rest, bytes, lg_cnn_work_size(net, dtype));
    return p;
}

size_t lg_detector_work_size(const lg_detector *model, lg_dtype dtype) {
    size_t bytes;
    (void)cut(model, dtype, NULL, &bytes);
    return bytes;
}

/* 1/(1 + exp(-y)) and 1/(1 + exp(y)): neither loses digits where it is small. */
static void sigmoid_pair(double y, double *probability) {
    probability[0] = 1.0 / (1.0 + exp(y));
    probability[1] = 1.0 / (1.0 + exp(-y));
}

/* In place. */
static void softmax(size_t n, double *y) {
    double most = y[0], sum = 0.0;
    for (size_t i = 1; i < n; i++)
        if (y[i] > most) most = y[i];
    for (size_t i = 0; i < n; i++) sum += y[i] = exp(y[i] - most);
    for (size_t i = 0; i < n; i++) y[i] /= sum;
}

void lg_detector_eval(const lg_detector *model, const lg_scaler *scaler, lg_dtype dtype, const void *theta,
                      const float *x, double *probability, double *plane, void *work) {
    const lg_kernels *k = lg_kernels_for(dtype);
    size_t bytes;
    const pieces p = cut(model, dtype, work, &bytes);
    lg_detector_scale(model, scaler, dtype, x, p.x);
    lg_cnn_eval(&model->net, dtype, theta, p.x, 1, p.logits, p.plane, p.net);
    if (plane != NULL) k->convert_out(model->net.plane, p.plane, plane);
    if (model->loss == LG_DETECTOR_MSE) {
        double y;
        k->convert_out(1, p.logits, &y);
        sigmoid_pair(y, probability);
        return;
    }
    k->convert_out(model->classes, p.logits, probability);
    softmax(model->classes, probability);
}

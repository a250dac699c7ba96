/* Detectors as maps of numbers: from a window as recorded, (channels, length), to the logits of the network.
 *
 * The network reads z (length, channels), z_tc = (x_ct - mean_c - m_c)/scale_c with m_c the channel's own
 * mean over the window for `centred` models, else 0. From dy/dz, which backward passes give row by row,
 *   dy/dx_ct = (dy/dz_tc - (the mean over t of dy/dz_tc, for `centred`))/scale_c.
 */
#include "models/detector_internal.h"
#include "models/model_internal.h"
#include "nn/cnn.h"
#include "nn/eval.h"

typedef struct pieces {
    double *z;         /* (length, channels) */
    double *gradient;  /* (length, channels) */
    double *cotangent; /* (outputs) */
    char *net;
} pieces;

static double *take(char **rest, size_t *bytes, size_t numbers) {
    return (double *)(void *)eval_take(rest, bytes, numbers * sizeof(double));
}

/* With `work` NULL only *bytes is of use. */
static pieces cut(const lg_detector *model, void *work, size_t *bytes) {
    const size_t numbers = (size_t)model->net.length * model->net.channels;
    char *rest = work;
    pieces p;
    *bytes = 0;
    p.z = take(&rest, bytes, numbers);
    p.gradient = take(&rest, bytes, numbers);
    p.cotangent = take(&rest, bytes, model->net.outputs);
    p.net = eval_take(&rest, bytes, 0);
    const size_t value = lg_cnn_work_size(&model->net, LG_F64);
    const size_t gradient = lg_cnn_gradient_work_size(&model->net, LG_F64);
    *bytes += value > gradient ? value : gradient;
    return p;
}

size_t lg_model_detector_inputs(const lg_detector *model) {
    return (size_t)model->net.channels * model->net.length;
}

size_t lg_model_detector_outputs(const lg_detector *model) {
    return model->net.outputs;
}

size_t lg_model_detector_work_size(const lg_detector *model) {
    size_t bytes;
    (void)cut(model, NULL, &bytes);
    return bytes;
}

void lg_model_detector_eval(const lg_detector *model, const lg_scaler *scaler, const double *theta,
                            const double *x, double *y, void *work) {
    size_t bytes;
    const pieces p = cut(model, work, &bytes);
    lg_detector_scale_numbers(model, scaler, x, p.z);
    lg_cnn_eval(&model->net, LG_F64, theta, p.z, 1, y, NULL, p.net);
}

/* dy/dz (length, channels) -> dy/dx (channels, length) */
static void through_scaling(const lg_detector *model, const lg_scaler *scaler, const double *z, double *x) {
    const size_t n = model->net.length, channels = model->net.channels;
    for (size_t c = 0; c < channels; c++, x += n) {
        const double inverse = 1.0 / scaler->scale[c];
        for (size_t t = 0; t < n; t++) x[t] = z[t * channels + c];
        const double mean = model->centred ? lg_detector_mean(x, n) : 0.0;
        for (size_t t = 0; t < n; t++) x[t] = (x[t] - mean) * inverse;
    }
}

void lg_model_detector_jacobian(const lg_detector *model, const lg_scaler *scaler, const double *theta,
                                const double *x, double *y, double *jacobian, void *work) {
    size_t bytes;
    const pieces p = cut(model, work, &bytes);
    const size_t outputs = model->net.outputs, inputs = lg_model_detector_inputs(model);
    lg_detector_scale_numbers(model, scaler, x, p.z);
    lg_cnn_forward(&model->net, LG_F64, theta, p.z, y, p.net);
    for (size_t o = 0; o < outputs; o++) p.cotangent[o] = 0.0;
    for (size_t o = 0; o < outputs; o++) {
        p.cotangent[o] = 1.0;
        lg_cnn_backward(&model->net, LG_F64, theta, p.cotangent, p.gradient, p.net);
        p.cotangent[o] = 0.0;
        through_scaling(model, scaler, p.gradient, jacobian + o * inputs);
    }
}

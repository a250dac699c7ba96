/* By how much a convolutional network multiplies rounding. A logit can be small beside the terms that it is
 * the sum of, after a short training for example: then its rounding is large beside it. */
#include "lg-export/detector.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "liegrad/convolution.h"

enum { ROUNDING_STREAM = 0x726f756e };

/* Large enough that the rounding of double precision does not matter beside it, small enough for a
 * derivative. */
#define MOVE 0x1p-26

void detector_draw_window(const export_source *source, const exported_detector *model, lg_rng *rng,
                          double *x) {
    const lg_scaler *scaler = &model->scaler;
    const lg_cnn *net = &model->detector.net;
    const size_t length = net->length;
    for (size_t c = 0; c < net->channels; c++) {
        const double offset = model->detector.centred ? scaler->scale[c] * lg_rng_normal(rng) : 0;
        for (size_t i = c * length; i < (c + 1) * length; i++)
            x[i] = (double)export_window_number(source, scaler->mean[c] + offset +
                                                            scaler->scale[c] * lg_rng_normal(rng));
    }
}

bool detector_has_kinks(const lg_cnn *net) {
    bool kinks = net->activation == LG_RELU || net->activation == LG_LEAKY_RELU;
    for (uint32_t i = 0; i < net->blocks; i++) kinks = kinks || net->block[i].pooling == LG_POOL_MAX;
    return kinks;
}

/* What one quantity of `size` numbers does over all windows. */
typedef struct spread {
    size_t size;
    double squares, change; /* the sum of |here|^2, and the largest |there - here| */
} spread;

static double square_of(const double *a, const double *b, size_t size) {
    double sum = 0;
    for (size_t i = 0; i < size; i++) {
        const double d = a[i] - (b != NULL ? b[i] : 0);
        sum += d * d;
    }
    return sum;
}

static void note(spread *s, const double *here, const double *there) {
    s->squares += square_of(here, NULL, s->size);
    s->change = fmax(s->change, sqrt(square_of(there, here, s->size)));
}

/* The largest change in units of `eps` beside the root mean square, over these windows or the golden vectors:
 * the smaller one. */
static double growth(const spread *s, double eps, const double *golden, size_t count) {
    const double mean =
        fmin(s->squares / DETECTOR_WINDOWS, square_of(golden, NULL, count * s->size) / (double)count);
    return mean > 0 ? s->change / sqrt(mean) / eps : 0;
}

static double sign_of(lg_rng *rng) {
    return lg_rng_uniform(rng) < 0.5 ? -MOVE : MOVE;
}

/* Weights off by a relative MOVE each, and windows off by one of the scale: the growth of value and gradient.
 * A gradient with kinks may jump and is left out. */
static double growth_of_moves(const export_source *source, const exported_detector *model, lg_rng *rng) {
    const size_t n = source->inputs, outputs = source->outputs, parameters = source->parameters;
    double *x = app_alloc(2 * n, sizeof *x), *theta = app_alloc(parameters, sizeof *theta);
    double *here = app_alloc(2 * outputs * (n + 1), sizeof *here), *there = here + outputs * (n + 1);
    void *work = app_alloc(lg_model_work_size(model->learned), 1);
    const bool kinks = detector_has_kinks(&model->detector.net);
    spread value = {.size = outputs}, gradient = {.size = kinks ? 0 : outputs * n};
    for (int v = 0; v < DETECTOR_WINDOWS; v++) {
        detector_draw_window(source, model, rng, x);
        for (size_t i = 0; i < n; i++)
            x[n + i] = x[i] + model->scaler.scale[i / model->detector.net.length] * sign_of(rng);
        for (size_t i = 0; i < parameters; i++) theta[i] = model->theta[i] * (1 + sign_of(rng));
        lg_model_jacobian(model->learned, x, here, here + outputs, work);
        lg_model *moved = NULL;
        if (lg_model_create_detector(NULL, &model->detector, &model->scaler, theta, &moved, NULL) != LG_OK)
            continue;
        lg_model_jacobian(moved, x + n, there, there + outputs, work);
        lg_model_destroy(moved);
        note(&value, here, there);
        note(&gradient, here + outputs, there + outputs);
    }
    free(x);
    free(theta);
    free(here);
    free(work);
    return fmax(growth(&value, MOVE, source->golden.y, source->golden.count),
                growth(&gradient, MOVE, source->golden.jacobian, source->golden.count));
}

/* y (outputs) and the gradient (outputs, length, channels) by the window, in either precision. */
static void library(const exported_detector *model, lg_dtype dtype, const void *theta, const double *x,
                    double *out, void *number, void *work) {
    const lg_cnn *net = &model->detector.net;
    const size_t n = (size_t)net->length * net->channels, m = net->outputs, total = n + m + m + n;
    float *single = number;
    double *full = number; /* x, cotangent, y, gradient */
    for (size_t o = 0; o < m; o++) {
        for (size_t i = 0; i < n + m; i++) {
            const double value = i < n ? x[i] : i - n == o ? 1 : 0;
            if (dtype == LG_F32)
                single[i] = (float)value;
            else
                full[i] = value;
        }
        if (dtype == LG_F32)
            lg_cnn_input_gradient(net, dtype, theta, single, single + n, single + n + m, single + n + 2 * m,
                                  work);
        else
            lg_cnn_input_gradient(net, dtype, theta, full, full + n, full + n + m, full + n + 2 * m, work);
        for (size_t i = n + m; i < total; i++) {
            const double value = dtype == LG_F32 ? (double)single[i] : full[i];
            if (i < n + 2 * m)
                out[i - n - m] = value;
            else
                out[m + o * n + i - n - 2 * m] = value / model->scaler.scale[(i - n - 2 * m) % net->channels];
        }
    }
}

/* The library in single precision against itself in double precision, on the same scaled windows: the growth
 * of value and gradient. */
static double growth_of_sums(const export_source *source, const exported_detector *model, lg_rng *rng) {
    const lg_cnn *net = &model->detector.net;
    const size_t n = source->inputs, outputs = source->outputs, parameters = source->parameters;
    const bool kinks = detector_has_kinks(net);
    double *x = app_alloc(n, sizeof *x), *here = app_alloc(2 * outputs * (n + 1), sizeof *here);
    double *there = here + outputs * (n + 1), *number = app_alloc(2 * (n + outputs), sizeof *number);
    float *single = app_alloc(parameters, sizeof *single);
    void *work = app_alloc(lg_cnn_gradient_work_size(net, LG_F64), 1);
    void *work_single = app_alloc(lg_cnn_gradient_work_size(net, LG_F32), 1);
    spread value = {.size = outputs}, gradient = {.size = kinks ? 0 : outputs * n};
    for (size_t i = 0; i < parameters; i++) single[i] = (float)model->theta[i];
    for (int v = 0; v < DETECTOR_WINDOWS; v++) {
        for (size_t i = 0; i < n; i++) x[i] = (double)(float)lg_rng_normal(rng);
        library(model, LG_F64, model->theta, x, here, number, work);
        library(model, LG_F32, single, x, there, number, work_single);
        note(&value, here, there);
        note(&gradient, here + outputs, there + outputs);
    }
    free(x);
    free(here);
    free(number);
    free(single);
    free(work);
    free(work_single);
    return fmax(growth(&value, (double)FLT_EPSILON, source->golden.y, source->golden.count),
                growth(&gradient, (double)FLT_EPSILON, source->golden.jacobian, source->golden.count));
}

/* Rounded up to two digits: the last ones of growth_of_sums depend on the processor. */
double detector_condition(const export_source *source, const exported_detector *model) {
    lg_rng rng;
    lg_rng_seed(&rng, source->options->seed, ROUNDING_STREAM);
    const double moves = growth_of_moves(source, model, &rng), sums = growth_of_sums(source, model, &rng);
    const double out = 4 * fmax(moves, sums) / (20 * (double)source->depth);
    return out > 1 ? ceil(10 * out) / 10 : 1;
}

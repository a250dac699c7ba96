/* Measures by how much a convolutional network multiplies rounding errors. A logit can be small compared with
 * the terms that are added up to it, for example after a short training; then its rounding error is
 * relatively large. */
#include "lg-export/anomaly/detector.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "liegrad/anomaly.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"

enum { ROUNDING_STREAM = 0x726f756e };

/* Relative size of a move: so large that rounding errors of double precision do not matter beside it, and so
 * small that the change is proportional to it. */
#define MOVE 0x1p-26

static const lg_detector_file *file_of(const export_model *m) {
    return m->file->contents;
}

static size_t channel_of(const export_model *m, size_t i) {
    return i / file_of(m)->run.model.net.length;
}

void detector_draw_window(const export_model *m, lg_rng *rng, double *x) {
    const lg_scaler *scaler = &file_of(m)->scaler;
    const lg_cnn *net = &file_of(m)->run.model.net;
    const size_t length = net->length;
    for (size_t c = 0; c < net->channels; c++) {
        const double offset = file_of(m)->run.model.centred ? scaler->scale[c] * lg_rng_normal(rng) : 0;
        for (size_t i = c * length; i < (c + 1) * length; i++)
            x[i] = (double)export_window_number(m->source, scaler->mean[c] + offset +
                                                               scaler->scale[c] * lg_rng_normal(rng));
    }
}

bool detector_has_kinks(const lg_cnn *net) {
    bool kinks = net->activation == LG_RELU || net->activation == LG_LEAKY_RELU;
    for (uint32_t i = 0; i < net->blocks; i++) kinks = kinks || net->block[i].pooling == LG_POOL_MAX;
    return kinks;
}

/* Changes of one quantity (`size` numbers) over all windows. */
typedef struct spread {
    size_t size;
    double squares, change; /* squares: sum of |here|^2. change: largest |there - here|. */
} spread;

static void note(spread *s, const double *here, const double *there) {
    s->squares += pow(export_norm(here, NULL, s->size), 2);
    s->change = fmax(s->change, export_norm(there, here, s->size));
}

/* Returns the largest change, in units of `eps`, divided by a root mean square: of the quantity over these
 * windows or over the golden vectors, whichever is smaller. */
static double growth(const spread *s, double eps, const double *golden, size_t count) {
    const double mean = fmin(s->squares / DETECTOR_WINDOWS,
                             pow(export_norm(golden, NULL, count * s->size), 2) / (double)count);
    return mean > 0 ? s->change / sqrt(mean) / eps : 0;
}

static double sign_of(lg_rng *rng) {
    return lg_rng_uniform(rng) < 0.5 ? -MOVE : MOVE;
}

/* Moves each weight by a relative +-MOVE and each sample by +-MOVE times the channel's scale, and returns the
 * larger growth of value and gradient. The gradient is left out if the network has kinks, because it could
 * jump. */
static double growth_of_moves(const export_model *m, lg_rng *rng) {
    const lg_detector_file *file = file_of(m);
    const export_golden *golden = &m->source->golden;
    const size_t n = m->source->inputs, outputs = m->source->outputs, parameters = m->source->parameters;
    double *x = app_alloc(2 * n, sizeof *x), *theta = app_alloc(parameters, sizeof *theta);
    double *here = app_alloc(2 * outputs * (n + 1), sizeof *here), *there = here + outputs * (n + 1);
    const bool kinks = detector_has_kinks(&file->run.model.net);
    spread value = {.size = outputs}, gradient = {.size = kinks ? 0 : outputs * n};
    for (int v = 0; v < DETECTOR_WINDOWS; v++) {
        detector_draw_window(m, rng, x);
        for (size_t i = 0; i < n; i++) x[n + i] = x[i] + file->scaler.scale[channel_of(m, i)] * sign_of(rng);
        for (size_t i = 0; i < parameters; i++) theta[i] = file->theta[i] * (1 + sign_of(rng));
        lg_model_jacobian(m->file->model, x, here, here + outputs, m->work);
        lg_model *moved = NULL;
        lg_program *program;
        if (lg_detector_program(NULL, &file->run.model, &file->scaler, theta, &program, NULL) != LG_OK ||
            lg_model_create(NULL, program, NULL, &moved, NULL) != LG_OK)
            continue;
        lg_model_jacobian(moved, x + n, there, there + outputs, m->work);
        lg_model_destroy(moved);
        note(&value, here, there);
        note(&gradient, here + outputs, there + outputs);
    }
    free(x);
    free(theta);
    free(here);
    return fmax(growth(&value, MOVE, golden->y, golden->count),
                growth(&gradient, MOVE, golden->jacobian, golden->count));
}

/* Makes the program of the network without scaling and centring; it reads scaled windows. */
static lg_status network_program(const export_model *m, lg_program **out) {
    lg_detector alone = file_of(m)->run.model;
    const size_t channels = alone.net.channels;
    double *scale = app_alloc(2 * channels, sizeof *scale);
    for (size_t c = 0; c < channels; c++) scale[c] = 1;
    const lg_scaler scaler = {.channels = alone.net.channels, .mean = scale + channels, .scale = scale};
    alone.centred = false;
    const lg_status status = lg_detector_program(NULL, &alone, &scaler, file_of(m)->theta, out, NULL);
    free(scale);
    return status;
}

/* Draws a scaled window (channels, length) of noise in single precision; the random numbers are drawn sample
 * by sample, all channels of a sample together. */
static void draw_scaled(const lg_cnn *net, lg_rng *rng, double *x) {
    for (size_t t = 0; t < net->length; t++)
        for (size_t c = 0; c < net->channels; c++) x[c * net->length + t] = (double)(float)lg_rng_normal(rng);
}

/* Computes y (outputs) and the gradient (outputs, channels, length) with respect to the recorded, unscaled
 * window. x: a scaled window, which the program reads. */
static void evaluate(const export_model *m, const export_evaluation *e, const double *x, double *out) {
    const size_t outputs = m->source->outputs, n = m->source->inputs;
    export_evaluate(e, x, out);
    for (size_t i = 0; i < outputs * n; i++)
        out[outputs + i] /= file_of(m)->scaler.scale[channel_of(m, i % n)];
}

/* Compares the library in single precision with the library in double precision on the same scaled windows.
 * *out: the larger growth of value and gradient. */
static lg_status growth_of_sums(const export_model *m, lg_rng *rng, double *out, lg_error *error) {
    const lg_cnn *net = &file_of(m)->run.model.net;
    const export_golden *golden = &m->source->golden;
    const size_t n = m->source->inputs, outputs = m->source->outputs;
    spread value = {.size = outputs}, gradient = {.size = detector_has_kinks(net) ? 0 : outputs * n};
    lg_program *program = NULL;
    export_evaluation wide = {.plan = NULL}, narrow = {.plan = NULL};
    size_t grad = 0;
    lg_status status = network_program(m, &program);
    if (status == LG_OK) status = lg_program_find(program, "grad", &grad, NULL);
    if (status == LG_OK) status = export_evaluation_open(program, grad, LG_F64, 0, &wide, error);
    if (status == LG_OK) status = export_evaluation_open(program, grad, LG_F32, 0, &narrow, error);
    double *x = app_alloc(n, sizeof *x), *here = app_alloc(2 * outputs * (n + 1), sizeof *here);
    double *there = here + outputs * (n + 1);
    for (int v = 0; status == LG_OK && v < DETECTOR_WINDOWS; v++) {
        draw_scaled(net, rng, x);
        evaluate(m, &wide, x, here);
        evaluate(m, &narrow, x, there);
        note(&value, here, there);
        note(&gradient, here + outputs, there + outputs);
    }
    export_evaluation_close(&wide);
    export_evaluation_close(&narrow);
    lg_program_destroy(program);
    free(x);
    free(here);
    *out = fmax(growth(&value, (double)FLT_EPSILON, golden->y, golden->count),
                growth(&gradient, (double)FLT_EPSILON, golden->jacobian, golden->count));
    return status;
}

/* The condition is rounded up to one decimal: the further digits of growth_of_sums depend on the
 * processor. */
lg_status detector_condition(export_model *m, lg_error *error) {
    lg_rng rng;
    double sums;
    lg_rng_seed(&rng, m->source->options->seed, ROUNDING_STREAM);
    const double moves = growth_of_moves(m, &rng);
    LG_TRY(growth_of_sums(m, &rng, &sums, error));
    const double condition = 4 * fmax(moves, sums) / (20 * (double)m->source->depth);
    m->source->condition = condition > 1 ? ceil(10 * condition) / 10 : 1;
    return LG_OK;
}

/* By how much a convolutional network multiplies rounding. A logit can be small beside the terms that it is
 * the sum of, after a short training for example: then its rounding is large beside it. */
#include "lg-export/detector.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "liegrad/convolution.h"
#include "liegrad/program.h"

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
        lg_program *program;
        if (lg_detector_program(NULL, &model->detector, &model->scaler, theta, &program, NULL) != LG_OK ||
            lg_model_create(NULL, program, NULL, &moved, NULL) != LG_OK)
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

/* A plan of the network's values and gradients, with memory for it. */
typedef struct rounded {
    lg_plan *plan;
    lg_dtype dtype;
    void *x, *out, *work; /* numbers of dtype; out: y (outputs), then g (outputs, channels, length) */
} rounded;

static lg_status prepare(const lg_program *program, lg_dtype dtype, rounded *r) {
    lg_plan_options options;
    size_t function = 0;
    lg_plan_options_init(&options);
    options.dtype = dtype;
    *r = (rounded){.dtype = dtype};
    lg_status status = lg_program_find(program, "grad", &function);
    if (status == LG_OK) status = lg_plan_create(program, function, &options, &r->plan, NULL);
    if (status != LG_OK) return status;
    r->x = app_alloc(lg_plan_input_count(r->plan, 0), sizeof(double));
    r->out = app_alloc(lg_plan_output_count(r->plan, 0) + lg_plan_output_count(r->plan, 1), sizeof(double));
    r->work = app_alloc(lg_plan_work_size(r->plan), 1);
    return LG_OK;
}

static void finish(rounded *r) {
    lg_plan_destroy(r->plan);
    free(r->x);
    free(r->out);
    free(r->work);
}

/* y (outputs) and the gradient (outputs, channels, length) by the window, in the plan's precision. */
static void evaluate(const rounded *r, const exported_detector *model, const double *x, double *out) {
    const size_t n = lg_plan_input_count(r->plan, 0), m = lg_plan_output_count(r->plan, 0);
    const size_t length = model->detector.net.length;
    float *x_single = r->x, *single = r->out;
    double *x_full = r->x, *full = r->out;
    for (size_t i = 0; i < n; i++) {
        if (r->dtype == LG_F32)
            x_single[i] = (float)x[i];
        else
            x_full[i] = x[i];
    }
    void *const outputs[2] = {r->out, r->dtype == LG_F32 ? (void *)(single + m) : (void *)(full + m)};
    lg_plan_eval(r->plan, (const void *const[]){r->x}, outputs, r->work);
    for (size_t i = 0; i < m + m * n; i++) out[i] = r->dtype == LG_F32 ? (double)single[i] : full[i];
    for (size_t i = 0; i < m * n; i++) out[m + i] /= model->scaler.scale[i % n / length];
}

/* The network alone, which reads windows that are scaled already. */
static lg_status network_program(const exported_detector *model, lg_program **out) {
    lg_detector alone = model->detector;
    const size_t channels = alone.net.channels;
    double *scale = app_alloc(2 * channels, sizeof *scale);
    for (size_t c = 0; c < channels; c++) {
        scale[c] = 1;
        scale[channels + c] = 0;
    }
    const lg_scaler scaler = {.channels = alone.net.channels, .mean = scale + channels, .scale = scale};
    alone.centred = false;
    const lg_status status = lg_detector_program(NULL, &alone, &scaler, model->theta, out, NULL);
    free(scale);
    return status;
}

/* A scaled window (channels, length) of noise in single precision, drawn sample by sample. */
static void draw_scaled(const lg_cnn *net, lg_rng *rng, double *x) {
    for (size_t t = 0; t < net->length; t++)
        for (size_t c = 0; c < net->channels; c++) x[c * net->length + t] = (double)(float)lg_rng_normal(rng);
}

/* The library in single precision against itself in double precision, on the same scaled windows: the growth
 * of value and gradient. */
static lg_status growth_of_sums(const export_source *source, const exported_detector *model, lg_rng *rng,
                                double *out) {
    const size_t n = source->inputs, outputs = source->outputs;
    spread value = {.size = outputs},
           gradient = {.size = detector_has_kinks(&model->detector.net) ? 0 : outputs * n};
    lg_program *program = NULL;
    rounded full = {.plan = NULL}, single = {.plan = NULL};
    lg_status status = network_program(model, &program);
    if (status == LG_OK) status = prepare(program, LG_F64, &full);
    if (status == LG_OK) status = prepare(program, LG_F32, &single);
    double *x = app_alloc(n, sizeof *x), *here = app_alloc(2 * outputs * (n + 1), sizeof *here);
    double *there = here + outputs * (n + 1);
    for (int v = 0; status == LG_OK && v < DETECTOR_WINDOWS; v++) {
        draw_scaled(&model->detector.net, rng, x);
        evaluate(&full, model, x, here);
        evaluate(&single, model, x, there);
        note(&value, here, there);
        note(&gradient, here + outputs, there + outputs);
    }
    finish(&full);
    finish(&single);
    lg_program_destroy(program);
    free(x);
    free(here);
    *out = fmax(growth(&value, (double)FLT_EPSILON, source->golden.y, source->golden.count),
                growth(&gradient, (double)FLT_EPSILON, source->golden.jacobian, source->golden.count));
    return status;
}

/* Rounded up to two digits: the last ones of growth_of_sums depend on the processor. */
lg_status detector_condition(const export_source *source, const exported_detector *model, double *out) {
    lg_rng rng;
    double sums;
    lg_rng_seed(&rng, source->options->seed, ROUNDING_STREAM);
    const double moves = growth_of_moves(source, model, &rng);
    const lg_status status = growth_of_sums(source, model, &rng, &sums);
    if (status != LG_OK) return status;
    const double condition = 4 * fmax(moves, sums) / (20 * (double)source->depth);
    *out = condition > 1 ? ceil(10 * condition) / 10 : 1;
    return LG_OK;
}

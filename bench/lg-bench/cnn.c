/* Detectors of a damaged well: an epoch of training a convolutional network, the parts of the network, and
 * its value for one window. The network has three blocks of convolution (kernel 5), activation and average
 * pooling by 2, with 6 -> 12 -> 24 -> 48 channels and 300 samples per window; then a layer of 2 numbers and a
 * layer of one. */
#include <math.h>
#include <stdlib.h>

#include "kernels/conv.h"
#include "lg-bench/bench.h"
#include "liegrad/anomaly.h"

enum { WINDOWS = 4944, CHANNELS = 6, LENGTH = 300, NUMBERS = CHANNELS * LENGTH, JUDGED = 30, SHARDS = 4 };
enum { STREAM_WEIGHTS = 1, STREAM_WINDOWS = 2 };
static const double rate = 2.102e-3, decay = 1.221e-5;
static const lg_activation activations[] = {LG_LEAKY_RELU, LG_TANH, LG_SWISH};

static lg_detector detector_of(const bench *b, lg_activation activation) {
    lg_detector model = {.classes = 2};
    lg_error error = {LG_OK, ""};
    lg_cnn_init_default(&model.net, CHANNELS, LENGTH, 1, activation);
    bench_check(b, lg_detector_check(&model, &error), error.message);
    return model;
}

static double *weights_of(const bench *b, const lg_cnn *net) {
    double *theta = app_alloc(lg_cnn_parameters(net), sizeof *theta);
    lg_rng rng;
    lg_rng_seed(&rng, b->app->seed, STREAM_WEIGHTS);
    lg_cnn_initialise(net, &rng, theta);
    return theta;
}

/* Multiplications in the convolutions for one window: for its value, or for value and gradient. The first
 * layer's input needs no cotangent. */
static double products(const lg_cnn *net, bool gradient) {
    double sum = 0;
    size_t in = net->channels;
    for (uint32_t i = 0; i < net->blocks; in = net->block[i++].channels) {
        const double count = net->lengths[i] + 2.0 * net->block[i].padding - net->block[i].kernel + 1;
        sum += (gradient ? i > 0 ? 3 : 2 : 1) * count * (double)(net->block[i].kernel * in) *
               net->block[i].channels;
    }
    return sum;
}

/* ---- an epoch ---- */

typedef struct training {
    lg_detector model;
    lg_detector_data data;
    lg_detector_problem problem;
    lg_fit_problem fit;
    double *theta;
} training;

static void open_windows(const bench *b, training *l) {
    double *x = bench_uniform((size_t)WINDOWS * NUMBERS, STREAM_WINDOWS);
    l->data = (lg_detector_data){.count = WINDOWS, .dtype = b->dtype};
    l->data.label = app_alloc(WINDOWS, sizeof *l->data.label);
    for (size_t i = 0; i < WINDOWS; i++) { /* Windows of class 1 have larger amplitudes. */
        l->data.label[i] = x[i * NUMBERS] > 0;
        for (size_t j = 0; j < NUMBERS; j++) x[i * NUMBERS + j] *= l->data.label[i] ? 1.7 : 1.3;
    }
    l->data.x = bench_typed(b->dtype, x, (size_t)WINDOWS * NUMBERS);
    free(x);
}

/* Gradient of the loss of the first windows at the initial parameters, computed in `dtype`. */
static double *first_gradient(const bench *b, const training *l, lg_dtype dtype) {
    const size_t n = l->fit.parameters;
    void *theta = bench_typed(dtype, l->theta, n), *gradient = app_alloc(n, bench_size(dtype));
    uint32_t samples[JUDGED];
    for (uint32_t i = 0; i < JUDGED; i++) samples[i] = i;
    lg_tape *tape = bench_tape(b, dtype, 1);
    const lg_var at = lg_parameter(tape, lg_shape1((uint32_t)n), theta);
    lg_var loss = LG_NONE;
    bench_check(b, l->fit.loss(l->fit.user, tape, at, samples, JUDGED, JUDGED, &loss), "the loss");
    bench_check(b, lg_backward_set(tape, loss, &at, 1, &gradient), "the gradient");
    double *out = bench_doubles(dtype, gradient, n);
    lg_tape_destroy(tape);
    free(theta), free(gradient);
    return out;
}

static void judge(const bench *b, const training *l, bench_row *row) {
    row->error_is = "largest difference of a gradient from that in f64, relative to its largest element";
    if (b->dtype == LG_F64) return;
    double *ours = first_gradient(b, l, b->dtype), *exact = first_gradient(b, l, LG_F64);
    row->error = bench_difference(ours, exact, l->fit.parameters);
    free(ours), free(exact);
}

static void train(bench *b, training *l) {
    const bench_options *given = b->given;
    lg_fit_options options;
    lg_fit *fit = NULL;
    lg_error error = {LG_OK, ""};
    size_t count;
    lg_fit_options_init(&options);
    options.dtype = b->dtype;
    options.epochs = given->repeats > 0 && !app_given(b->app, "epochs") ? given->repeats + 1 : given->epochs;
    options.batch = (size_t)*bench_batches(b, &count);
    options.shards = SHARDS;
    options.adam.lr = rate;
    options.adam.weight_decay = decay;
    options.threads = b->threads;
    bench_check(b, lg_fit_create(b->app->context, &l->fit, &options, l->theta, &fit, &error), error.message);
    bench_check(b, lg_fit_run(fit, &error), error.message);
    const size_t epochs = (size_t)lg_fit_epochs_done(fit), steps = (WINDOWS - 1) / options.batch + 1;
    double *us = app_alloc(epochs, sizeof *us);
    for (size_t i = 1; i < epochs; i++) us[i - 1] = 1e6 * lg_fit_history(fit, LG_FIT_SECONDS)[i];
    bench_row *row = bench_from_samples(b, lg_activation_name(l->model.net.activation), us, epochs - 1);
    free(us);
    if (row != NULL) {
        row->batch = options.batch;
        row->rate = 1e-6 * row->median_us;
        row->unit = "s an epoch";
        judge(b, l, row);
        bench_note_add(row, "step_us", row->median_us / (double)steps);
        bench_note_add(row, "gflops", 2e-3 * products(&l->model.net, true) * WINDOWS / row->median_us);
        bench_note_add(row, "loss", lg_fit_loss(fit));
        bench_note_add(row, "parameters", (double)l->fit.parameters);
        bench_note_add(row, "tape_bytes", (double)lg_fit_tape_size(fit));
    }
    lg_fit_destroy(fit);
}

void bench_cnn(bench *b) {
    training l = {.theta = NULL};
    open_windows(b, &l);
    for (size_t i = 0; i < LG_COUNT(activations); i++) {
        if (!bench_wanted(b, lg_activation_name(activations[i]))) continue;
        l.model = detector_of(b, activations[i]);
        l.problem = (lg_detector_problem){&l.model, &l.data, WINDOWS, 1};
        lg_detector_fit_problem(&l.problem, &l.fit);
        l.theta = weights_of(b, &l.model.net);
        train(b, &l);
        free(l.theta);
    }
    free(l.data.x), free(l.data.label);
}

/* ---- parts of the network ---- */

/* One block of the network on `batch` windows, the number that a shard of a training step has. */
typedef struct stage {
    const lg_kernels *k;
    lg_conv conv;
    void *x, *w, *wt, *bias, *slope, *pooled, *g, *dx, *dw, *db, *scratch;
} stage;

static void run_apply(void *user) {
    const stage *s = user;
    lg_conv_apply(s->k, &s->conv, s->x, s->w, s->bias, LG_K_LEAKY_RELU, s->slope, s->pooled, s->scratch);
}
static void run_slope(void *user) {
    const stage *s = user;
    lg_conv_slope(s->k, &s->conv, s->pooled, s->slope, s->g);
}
static void run_input(void *user) {
    const stage *s = user;
    lg_conv_input(s->k, &s->conv, s->g, s->wt, s->dx, false, s->scratch);
}
static void run_weight(void *user) {
    const stage *s = user;
    lg_conv_weight(s->k, &s->conv, s->x, s->g, s->dw, false, s->scratch);
}
static void run_bias(void *user) {
    const stage *s = user;
    lg_conv_bias(s->k, &s->conv, s->g, s->db, false, s->scratch);
}

static const struct {
    const char *name;
    void (*run)(void *user);
    /* product: the part is a matrix product. inner: the part does not exist for the first block. */
    bool product, inner;
} parts[] = {{"convolution, activation, pooling", run_apply, true, false},
             {"adjoint of pooling, slope", run_slope, false, false},
             {"cotangent of the input", run_input, true, true},
             {"cotangent of the weight", run_weight, true, false},
             {"cotangent of the bias", run_bias, false, false}};

static size_t most(size_t a, size_t b) {
    return a > b ? a : b;
}

static stage open_stage(const bench *b, const lg_cnn *net, uint32_t i, size_t batch) {
    const size_t channels = i == 0 ? net->channels : net->block[i - 1].channels;
    stage s = {.k = lg_kernels_for(b->dtype),
               .conv = {.windows = {.length = net->lengths[i],
                                    .channels = channels,
                                    .size = net->block[i].kernel,
                                    .stride = net->block[i].stride,
                                    .padding = net->block[i].padding},
                        .batch = batch,
                        .outputs = net->block[i].channels}};
    (void)lg_windows_count(&s.conv.windows);
    s.conv.pool = (lg_k_windows){.length = s.conv.windows.count,
                                 .channels = s.conv.outputs,
                                 .size = net->block[i].pool_size,
                                 .stride = net->block[i].pool_stride};
    (void)lg_windows_count(&s.conv.pool);
    const size_t nx = batch * s.conv.windows.length * channels,
                 ny = batch * s.conv.pool.length * s.conv.outputs;
    const size_t nw = s.conv.windows.size * channels * s.conv.outputs;
    double *numbers = bench_uniform(most(most(nx, ny), nw), i);
    void **const memory[] = {&s.x, &s.dx, &s.slope, &s.pooled, &s.g, &s.w, &s.wt, &s.dw, &s.bias, &s.db};
    const size_t counts[] = {nx, nx, ny, ny, ny, nw, nw, nw, s.conv.outputs, s.conv.outputs};
    for (size_t j = 0; j < LG_COUNT(memory); j++) *memory[j] = bench_typed(b->dtype, numbers, counts[j]);
    free(numbers);
    const size_t scratch = most(most(lg_conv_scratch(&s.conv), lg_conv_input_scratch(&s.conv)),
                                most(lg_conv_weight_scratch(&s.conv), LG_CONV_BIAS_SCRATCH * s.conv.outputs));
    s.scratch = app_alloc(scratch, bench_size(b->dtype));
    return s;
}

static void close_stage(stage *s) {
    free(s->x), free(s->w), free(s->wt), free(s->bias), free(s->slope), free(s->pooled), free(s->g);
    free(s->dx), free(s->dw), free(s->db), free(s->scratch);
}

void bench_cnn_parts(bench *b) {
    const lg_detector model = detector_of(b, LG_LEAKY_RELU);
    size_t count;
    const size_t batch = (size_t)*bench_batches(b, &count);
    for (uint32_t i = 0; i < model.net.blocks; i++) {
        stage s = open_stage(b, &model.net, i, batch);
        const lg_k_windows *w = &s.conv.windows;
        const double flops =
            2.0 * (double)(batch * w->count) * (double)(w->size * w->channels) * (double)s.conv.outputs;
        for (size_t p = 0; p < LG_COUNT(parts); p++) {
            if (parts[p].inner && i == 0) continue;
            char *name = app_format("block %u: %s", i + 1, parts[p].name);
            bench_row *row = bench_measure(b, name, parts[p].run, &s);
            free(name);
            if (row == NULL) continue;
            row->batch = batch;
            if (!parts[p].product) continue;
            row->rate = 1e-3 * flops / row->median_us;
            row->unit = "GF/s";
        }
        close_stage(&s);
    }
}

/* ---- one window ---- */

typedef struct watching {
    lg_detector_plan *plan;
    void *work;
    float *windows; /* (JUDGED, channels, length) */
    double probability[2], plane[2];
    size_t next;
} watching;

static void watch(void *user) {
    watching *w = user;
    const float *x = w->windows + (w->next++ % JUDGED) * NUMBERS;
    lg_detector_eval(w->plan, x, w->probability, w->plane, w->work);
}

static void open_watching(const bench *b, watching *w, const lg_detector *model, const lg_scaler *scaler,
                          lg_dtype dtype, const double *theta, const double *x) {
    lg_error error = {LG_OK, ""};
    *w = (watching){.plan = NULL};
    bench_check(b, lg_detector_plan_create(b->app->context, model, scaler, theta, dtype, &w->plan, &error),
                error.message);
    const size_t bytes = lg_detector_work_size(w->plan);
    w->windows = bench_typed(LG_F32, x, (size_t)JUDGED * NUMBERS);
    w->work = aligned_alloc(64, (bytes + 63) / 64 * 64);
    if (w->work == NULL) abort();
}

static void close_watching(watching *w) {
    lg_detector_plan_destroy(w->plan);
    free(w->windows), free(w->work);
}

/* Largest difference between a probability in this type and the one in f64. */
static double watching_error(watching *w, watching *exact) {
    double worst = 0;
    w->next = exact->next = 0;
    for (size_t i = 0; i < JUDGED; i++) {
        watch(w), watch(exact);
        const double error = fabs(w->probability[1] - exact->probability[1]);
        if (!(error <= worst)) worst = error;
    }
    return worst;
}

void bench_cnn_window(bench *b) {
    static double mean[CHANNELS], scale[CHANNELS];
    const lg_detector model = detector_of(b, LG_LEAKY_RELU);
    for (size_t c = 0; c < CHANNELS; c++) scale[c] = 1.0 / (double)(c + 1);
    const lg_scaler scaler = {.channels = CHANNELS, .mean = mean, .scale = scale};
    double *theta = weights_of(b, &model.net), *x = bench_uniform((size_t)JUDGED * NUMBERS, STREAM_WINDOWS);
    watching w, exact;
    open_watching(b, &w, &model, &scaler, b->dtype, theta, x);
    open_watching(b, &exact, &model, &scaler, LG_F64, theta, x);
    bench_row *row = bench_measure(b, "window", watch, &w);
    if (row != NULL) {
        row->batch = 1;
        row->rate = 2e-3 * products(&model.net, false) / row->median_us;
        row->unit = "GF/s";
        row->error_is = "largest difference of a probability from that in f64";
        if (b->dtype != LG_F64) row->error = watching_error(&w, &exact);
    }
    close_watching(&w), close_watching(&exact);
    free(theta), free(x);
}

/* Surrogates of the elastica: seconds per epoch of training, one row per architecture. */
#include <stdlib.h>
#include <string.h>

#include "lg-bench/bench.h"
#include "liegrad/elastica.h"

enum { STREAM_WEIGHTS = 1, STREAM_CURVES = 2, STREAM_SAMPLES = 3, CURVES = 1000, TRAINING = 900 };

/* Published settings, without weight decay, with at most two architectures. points: a sample is one point of
 * a curve, not a whole curve. */
typedef struct experiment {
    const char *name;
    bool points;
    double lr;
    uint32_t shards;
    lg_surrogate_options model; /* Options of the first architecture. */
    lg_net_kind architectures[2];
    uint32_t count;
} experiment;

static const experiment experiments[] = {
    {"elastica-discrete",
     false,
     1.378e-3,
     1,
     {.kind = LG_SURROGATE_DISCRETE, .hidden = 879, .layers = 4, .normalise = true, .gamma = 4.242e-3},
     {LG_NET_MLP},
     1},
    {"elastica-continuous",
     true,
     3.025e-3,
     4,
     {.kind = LG_SURROGATE_CONTINUOUS,
      .embedding = 190,
      .hidden = 190,
      .layers = 5,
      .normalise = true,
      .gamma = 2e-2},
     {LG_NET_MULT_AFFINE, LG_NET_MULT},
     2},
    {"elastica-angle",
     false,
     3.007e-3,
     4,
     {.kind = LG_SURROGATE_ANGLE, .embedding = 143, .hidden = 143, .layers = 7},
     {LG_NET_MULT, LG_NET_MULT_AFFINE},
     2},
};

typedef struct training {
    const experiment *what;
    lg_elastica_curves curves;
    uint32_t training[TRAINING];
    uint32_t *order; /* (samples): the fixed order of the samples, the same in every epoch. */
    size_t samples;
    lg_surrogate model;
    lg_surrogate_problem problem;
    lg_fit_problem inner;
    double *theta;
} training;

static uint32_t *shuffled(size_t n, uint64_t stream) {
    lg_rng rng;
    uint32_t *order = app_alloc(n, sizeof *order);
    for (size_t i = 0; i < n; i++) order[i] = (uint32_t)i;
    lg_rng_seed(&rng, 1, stream);
    lg_rng_shuffle(&rng, order, n);
    return order;
}

static void open_curves(const bench *b, training *l) {
    lg_elastica_sampling sampling;
    lg_elastica_sampling_init(&sampling);
    lg_error error = {LG_OK, ""};
    sampling.count = CURVES;
    bench_check(b, lg_elastica_generate(b->app->context, &sampling, &l->curves, &error), error.message);
    uint32_t *chosen = shuffled(CURVES, STREAM_CURVES);
    memcpy(l->training, chosen, sizeof l->training);
    free(chosen);
    l->samples = (size_t)TRAINING * (l->what->points ? l->curves.intervals + 1 : 1);
    l->order = shuffled(l->samples, STREAM_SAMPLES);
}

/* Loss of a part of a batch. lg_fit does not shuffle, so the samples are consecutive; l->order maps them to
 * the fixed order. */
static lg_status ordered_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                              size_t batch, lg_var *loss) {
    const training *l = user;
    if (samples[count - 1] - samples[0] != count - 1) return LG_CHECK_FAILED;
    return l->inner.loss(l->inner.user, tape, theta, l->order + samples[0], count, batch, loss);
}

static void open_model(const bench *b, training *l, lg_net_kind architecture) {
    lg_surrogate_options options = l->what->model;
    lg_error error = {LG_OK, ""};
    lg_rng rng;
    options.architecture = architecture;
    options.activation = LG_TANH;
    bench_check(b, lg_surrogate_init(&l->model, &options, l->curves.intervals, l->curves.length, 1.5, &error),
                error.message);
    l->problem = (lg_surrogate_problem){&l->model, &l->curves, l->training, TRAINING, NULL};
    lg_surrogate_fit_problem(&l->problem, &l->inner);
    l->theta = app_alloc(l->inner.parameters, sizeof *l->theta);
    lg_rng_seed(&rng, b->app->seed, STREAM_WEIGHTS);
    lg_net_initialise(&l->model.net, &rng, l->theta);
}

static void fill_row(const bench *b, const training *l, const lg_fit *fit, bench_row *row) {
    const size_t epochs = (size_t)lg_fit_epochs_done(fit);
    lg_surrogate_errors errors;
    lg_error error = {LG_OK, ""};
    lg_fit_parameters(fit, l->theta);
    bench_check(b,
                lg_surrogate_evaluate(b->app->context, &l->model, l->theta, &l->curves, l->training, TRAINING,
                                      NULL, &errors, &error),
                error.message);
    row->width = l->model.options.hidden;
    row->error = errors.mse;
    row->error_is = "mean squared error over the training set, f64";
    row->rate = 1e-6 * row->median_us;
    row->unit = "s an epoch";
    bench_note_add(row, "loss", lg_fit_loss(fit));
    bench_note_add(row, "epochs", (double)epochs);
    bench_note_add(row, "parameters", (double)l->inner.parameters);
    bench_note_add(row, "tape_bytes", (double)lg_fit_tape_size(fit));
    row->series_is = "losses";
    row->series_count = epochs;
    row->series = app_alloc(epochs, sizeof *row->series);
    memcpy(row->series, lg_fit_history(fit, LG_FIT_LOSS), epochs * sizeof *row->series);
}

static void train(bench *b, training *l) {
    const lg_fit_problem problem = {.parameters = l->inner.parameters,
                                    .samples = l->inner.samples,
                                    .loss = ordered_loss,
                                    .user = l,
                                    .chunk = l->inner.chunk};
    const bench_options *given = b->given;
    lg_fit_options options;
    lg_fit *fit = NULL;
    lg_error error = {LG_OK, ""};
    size_t count;
    lg_fit_options_init(&options);
    options.dtype = b->dtype;
    options.epochs = given->repeats > 0 && !app_given(b->app, "epochs") ? given->repeats + 1 : given->epochs;
    options.batch = (size_t)*bench_batches(b, &count);
    options.shards = l->what->shards;
    options.shuffle = false;
    options.adam.lr = l->what->lr;
    options.threads = b->threads;
    bench_check(b, lg_fit_create(b->app->context, &problem, &options, l->theta, &fit, &error), error.message);
    bench_check(b, lg_fit_run(fit, &error), error.message);
    const size_t epochs = (size_t)lg_fit_epochs_done(fit);
    double *us = app_alloc(epochs, sizeof *us);
    for (size_t i = 1; i < epochs; i++) us[i - 1] = 1e6 * lg_fit_history(fit, LG_FIT_SECONDS)[i];
    bench_row *row = bench_from_samples(b, lg_net_kind_name(l->model.options.architecture), us, epochs - 1);
    free(us);
    if (row != NULL) {
        row->batch = options.batch;
        fill_row(b, l, fit, row);
    }
    lg_fit_destroy(fit);
}

/* ---- files for other programs ---- */

/* Writes two files. PREFIX.data: boundary conditions (900, 8), then q and v (900, 51, 2) of the training
 * curves. PREFIX.order: the samples in the order of an epoch. */
static void write_curves(const bench *b, const training *l) {
    const lg_elastica_curves *c = &l->curves;
    const size_t nodes = 2 * ((size_t)c->intervals + 1);
    double *data = app_alloc(TRAINING * (8 + 2 * nodes), sizeof *data);
    double *q = data + 8 * (size_t)TRAINING, *v = q + nodes * TRAINING;
    for (size_t i = 0; i < TRAINING; i++) {
        const size_t at = l->training[i];
        memcpy(data + 8 * i, c->boundary + 8 * at, 8 * sizeof *data);
        memcpy(q + nodes * i, c->q + nodes * at, nodes * sizeof *data);
        memcpy(v + nodes * i, c->v + nodes * at, nodes * sizeof *data);
    }
    bench_write_doubles(b, "data", data, TRAINING * (8 + 2 * nodes));
    free(data);
    double *order = app_alloc(l->samples, sizeof *order);
    for (size_t i = 0; i < l->samples; i++) order[i] = l->order[i];
    bench_write_doubles(b, "order", order, l->samples);
    free(order);
}

void bench_elastica(bench *b) {
    static training l;
    l = (training){.what = NULL};
    for (size_t i = 0; i < LG_COUNT(experiments); i++)
        if (strcmp(experiments[i].name, b->what->name) == 0) l.what = &experiments[i];
    open_curves(b, &l);
    if (b->given->out != NULL) write_curves(b, &l);
    for (uint32_t i = 0; i < l.what->count; i++) {
        const char *name = lg_net_kind_name(l.what->architectures[i]);
        if (!bench_wanted(b, name)) continue;
        open_model(b, &l, l.what->architectures[i]);
        if (b->given->out != NULL) bench_write_doubles(b, name, l.theta, l.inner.parameters);
        train(b, &l);
        free(l.theta);
    }
    free(l.order);
    lg_elastica_curves_destroy(&l.curves);
}

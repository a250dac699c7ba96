/* Training steps whose cost depends on the number of parameters: the cases dense and adam. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "kernels/kernels.h"
#include "core/core.h"
#include "lg-bench/bench.h"
#include "liegrad/ops.h"

enum { IN = 8, OUT = 196, HIDDEN = 5 };

/* Allocates memory in large pages, as lg_fit does; the numbers are x, converted, or zeros if x is NULL. */
static void *placed(const bench *b, const double *x, size_t n) {
    void *out = lg_alloc(b->app->context, n, bench_size(b->dtype));
    bench_check(b, out != NULL ? LG_OK : LG_OUT_OF_MEMORY, "the parameters");
    if (x != NULL) lg_kernels_for(b->dtype)->convert_in(n, x, out);
    return out;
}

/* ---- dense ---- */

typedef struct dense {
    lg_mlp net;
    lg_dtype dtype;
    size_t parameters, rows;
    void *x, *target, *theta, *gradient, *m, *v;
    lg_tape *tape;
    lg_adam_options adam;
    uint64_t step;
    double loss;
} dense;

static lg_var dense_loss(lg_tape *tape, const dense *d, lg_var theta) {
    const lg_var x = lg_parameter(tape, lg_shape2((uint32_t)d->rows, IN), d->x);
    const lg_var target = lg_parameter(tape, lg_shape2((uint32_t)d->rows, OUT), d->target);
    return lg_loss_record(tape, LG_LOSS_MSE, lg_mlp_record(tape, &d->net, theta, 0, x), target, LG_NONE);
}

static void dense_gradient(dense *d) {
    lg_tape_reset(d->tape);
    const lg_var theta = lg_parameter(d->tape, lg_shape1((uint32_t)d->parameters), d->theta);
    const lg_var loss = dense_loss(d->tape, d, theta);
    (void)lg_backward_set(d->tape, loss, &theta, 1, &d->gradient);
    (void)lg_read(d->tape, loss, 1, &d->loss);
}

static void gradient_call(void *user) {
    dense_gradient(user);
}

static void step_call(void *user) {
    dense *d = user;
    dense_gradient(d);
    lg_adam_step(&d->adam, d->dtype, ++d->step, 1.0, 1.0, d->gradient, d->parameters, d->m, d->v, d->theta);
}

/* Error of the gradient at the initial parameters, against long double. The loss is mean (y - t)^2. */
static double dense_error(const bench *b, dense *d) {
    const size_t n = d->parameters, size = d->rows * OUT;
    dense_gradient(d);
    bench_check_tape(b, d->tape);
    double *theta = bench_doubles(d->dtype, d->theta, n), *x = bench_doubles(d->dtype, d->x, d->rows * IN);
    double *target = bench_doubles(d->dtype, d->target, size),
           *found = bench_doubles(d->dtype, d->gradient, n);
    long double *wide = reference_widen(x, d->rows * IN), *y = app_alloc(size, sizeof *y);
    long double *gradient = app_alloc(n, sizeof *gradient);
    reference_pass pass = {.net = &d->net, .theta = theta, .rows = d->rows, .x = wide, .y = y};
    reference_run(&pass);
    for (size_t i = 0; i < size; i++) y[i] = 2 * (y[i] - target[i]) / (long double)size;
    pass.y = NULL;
    pass.cy = y;
    pass.gradient = gradient;
    reference_run(&pass);
    double *expected = reference_narrow(gradient, n);
    const double error = bench_difference(found, expected, n);
    free(theta);
    free(x);
    free(target);
    free(found);
    free(wide);
    free(y);
    free(gradient);
    free(expected);
    return error;
}

/* The row "fit" times whole steps of lg_fit with everything around them (shards, order of sums, checks, the
 * best parameters kept once per epoch). An epoch has STEPS steps on the same rows. */
enum { STEPS = 16 };

static lg_status fit_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                          size_t batch, lg_var *loss) {
    const dense *d = user;
    const size_t size = bench_size(d->dtype), first = samples[0] % d->rows;
    const lg_var x =
        lg_parameter(tape, lg_shape2((uint32_t)count, IN), (const char *)d->x + first * IN * size);
    const lg_var target =
        lg_parameter(tape, lg_shape2((uint32_t)count, OUT), (const char *)d->target + first * OUT * size);
    const lg_var mean =
        lg_loss_record(tape, LG_LOSS_MSE, lg_mlp_record(tape, &d->net, theta, 0, x), target, LG_NONE);
    *loss = lg_scale(tape, mean, (double)count / (double)batch);
    return lg_tape_status(tape);
}

static void fit_row(bench *b, dense *d, const double *start, double error) {
    const uint64_t repeats = (b->given->repeats > 0 ? b->given->repeats : 101) / STEPS + 1;
    lg_fit_options options;
    lg_fit *fit = NULL;
    lg_error message = {LG_OK, ""};
    const lg_fit_problem problem = {
        .parameters = d->parameters, .samples = STEPS * d->rows, .loss = fit_loss, .user = d};
    lg_fit_options_init(&options);
    options.dtype = d->dtype;
    options.epochs = repeats + 2;
    options.batch = d->rows;
    options.shards = 1;
    options.shuffle = false;
    options.threads = b->threads;
    bench_check(b, lg_fit_create(b->app->context, &problem, &options, start, &fit, &message),
                message.message);
    bench_check(b, lg_fit_run(fit, &message), message.message);
    double *us = app_alloc(repeats, sizeof *us);
    for (uint64_t i = 0; i < repeats; i++) us[i] = 1e6 / STEPS * lg_fit_history(fit, LG_FIT_SECONDS)[i + 2];
    bench_row *row = bench_from_samples(b, "fit", us, repeats);
    if (row != NULL) {
        row->batch = d->rows;
        row->width = d->net.width[1];
        row->error = error;
        row->error_is = bench_long_double;
        bench_note_add(row, "loss", lg_fit_loss(fit));
    }
    free(us);
    lg_fit_destroy(fit);
}

static void dense_rows(bench *b, dense *d, double error) {
    static const struct {
        const char *name;
        void (*call)(void *user);
    } table[] = {{"step", step_call}, {"gradient", gradient_call}};
    for (size_t i = 0; i < LG_COUNT(table); i++) {
        bench_row *row = bench_measure(b, table[i].name, table[i].call, d);
        if (row == NULL) continue;
        row->batch = d->rows;
        row->width = d->net.width[1];
        row->rate = 6e-3 * (double)d->rows * (double)d->parameters / row->median_us;
        row->unit = "GF/s, 6 B parameters";
        row->error = error;
        row->error_is = bench_long_double;
    }
}

void bench_dense(bench *b) {
    size_t count;
    dense d = {.net = bench_net(b, IN, (uint32_t)b->given->width, HIDDEN, OUT, true), .dtype = b->dtype};
    d.rows = (size_t)*bench_batches(b, &count);
    d.parameters = lg_mlp_parameters(&d.net);
    lg_adam_options_init(&d.adam);
    double *x = bench_uniform(d.rows * IN, 1), *target = bench_uniform(d.rows * OUT, 2);
    double *theta = bench_parameters(&d.net);
    void **const arrays[] = {&d.theta, &d.gradient, &d.m, &d.v};
    d.x = bench_typed(d.dtype, x, d.rows * IN);
    d.target = bench_typed(d.dtype, target, d.rows * OUT);
    for (size_t i = 0; i < LG_COUNT(arrays); i++) *arrays[i] = placed(b, i == 0 ? theta : NULL, d.parameters);
    d.tape = bench_tape(b, d.dtype, b->threads);
    const double error = dense_error(b, &d);
    dense_rows(b, &d, error);
    if (bench_wanted(b, "fit")) fit_row(b, &d, theta, error);
    lg_tape_destroy(d.tape);
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(b->app->context, *arrays[i]);
    free(d.x);
    free(d.target);
    free(x);
    free(target);
    free(theta);
}

/* ---- adam ---- */

typedef struct adam {
    lg_dtype dtype;
    lg_adam_options options;
    size_t n, pieces;
    uint64_t step;
    char *gradient, *m, *v, *theta;
    lg_thread_pool *pool;
} adam;

static void adam_piece(void *user, size_t i) {
    const adam *a = user;
    const size_t first = i * a->n / a->pieces, n = (i + 1) * a->n / a->pieces - first;
    const size_t at = first * bench_size(a->dtype);
    lg_adam_step(&a->options, a->dtype, a->step, 1.0, 1.0, a->gradient + at, n, a->m + at, a->v + at,
                 a->theta + at);
}

static void adam_call(void *user) {
    adam *a = user;
    a->step++;
    if (a->pool == NULL)
        adam_piece(a, 0);
    else
        lg_thread_pool_run(a->pool, a->pieces, adam_piece, a);
}

/* Makes two steps from the same initial theta and compares it with Adam's formula in long double. Returns the
 * error of theta. */
static double adam_error(adam *a) {
    const lg_adam_options *o = &a->options;
    double *g = bench_doubles(a->dtype, a->gradient, a->n), *start = bench_doubles(a->dtype, a->theta, a->n);
    double *expected = app_alloc(a->n, sizeof *expected);
    adam_call(a);
    adam_call(a);
    double *found = bench_doubles(a->dtype, a->theta, a->n);
    for (size_t i = 0; i < a->n; i++) {
        long double m = 0, v = 0, x = start[i];
        for (int step = 1; step <= 2; step++) {
            m = o->beta1 * m + (1 - (long double)o->beta1) * g[i];
            v = o->beta2 * v + (1 - (long double)o->beta2) * g[i] * g[i];
            x -= o->lr * (m / (1 - powl(o->beta1, step))) / (sqrtl(v / (1 - powl(o->beta2, step))) + o->eps);
        }
        expected[i] = (double)x;
    }
    const double error = bench_difference(found, expected, a->n);
    free(g);
    free(start);
    free(expected);
    free(found);
    return error;
}

void bench_adam(bench *b) {
    adam a = {.dtype = b->dtype, .n = (size_t)b->given->width};
    lg_adam_options_init(&a.options);
    a.pieces = (size_t)b->threads;
    double *gradient = bench_uniform(a.n, 1), *theta = bench_uniform(a.n, 2);
    char **const arrays[] = {&a.gradient, &a.theta, &a.m, &a.v};
    const double *const values[] = {gradient, theta, NULL, NULL};
    for (size_t i = 0; i < LG_COUNT(arrays); i++) *arrays[i] = placed(b, values[i], a.n);
    if (b->threads > 1)
        bench_check(b, lg_thread_pool_create(b->app->context, b->threads, &a.pool), "making threads");
    const double error = adam_error(&a);
    bench_row *row = bench_measure(b, "step", adam_call, &a);
    if (row != NULL) {
        row->width = a.n;
        row->error = error;
        row->error_is = "max |theta - r| / max |r| after two steps, r: the formula in long double";
        row->rate = 7.0 * (double)(a.n * bench_size(a.dtype)) / row->median_us * 1e-3;
        row->unit = "GB/s";
    }
    lg_thread_pool_destroy(a.pool);
    free(gradient);
    free(theta);
    for (size_t i = 0; i < LG_COUNT(arrays); i++) lg_free(b->app->context, *arrays[i]);
}

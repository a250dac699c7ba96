/* One state at a time, as a controller evaluates a model: the distribution of the times of single calls. For
 * comparison, two more rows: an empty loop around the same clock, and a loop that only reads the clock until
 * the median time has passed, which shows what interrupts do to calls of this length. */
#include <math.h>
#include <stdlib.h>
#include <time.h>

#include "lg-bench/bench.h"
#include "liegrad/model.h"

enum { CALLS = 50000, STATES = 64, WARM = 2000 };

typedef struct controller {
    lg_hamiltonian model;
    lg_model *learned;
    double *theta, *states, gradient[6], value, as_long;
    void *work;
} controller;

static void ask(controller *c, size_t i) {
    const double *state = c->states + 6 * (i % STATES);
    double y;
    lg_model_jacobian(c->learned, state, &y, c->gradient, c->work);
    c->value += y;
}

static void nothing(controller *c, size_t i) {
    c->value += (double)(i & 1);
}

static double nanoseconds(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static void wait(controller *c, size_t i) {
    (void)i;
    for (const double end = nanoseconds() + c->as_long; nanoseconds() < end;) {
    }
}

/* Times every call by itself. Tails of the distribution go into the notes. */
static void distribution(bench *b, const char *name, controller *c, void (*call)(controller *c, size_t i),
                         size_t calls) {
    if (!bench_wanted(b, name)) return;
    double *us = app_alloc(calls, sizeof *us);
    for (size_t i = 0; i < WARM; i++) call(c, i);
    for (size_t i = 0; i < calls; i++) {
        const double begin = nanoseconds();
        call(c, i);
        us[i] = 1e-3 * (nanoseconds() - begin);
    }
    bench_row *row = bench_from_samples(b, name, us, calls);
    if (row != NULL) {
        const size_t tail = (size_t)ceil(0.999 * (double)calls);
        bench_note_add(row, "p999_us", us[(tail < calls ? tail : calls) - 1]);
        bench_note_add(row, "max_us", us[calls - 1]);
        bench_note_add(row, "p999_over_median", us[(tail < calls ? tail : calls) - 1] / row->median_us);
    }
    free(us);
}

/* Returns the largest error of the gradient over all states, against long double: dH/dq = dV/dq and dH/dp =
 * p/m with m = gamma^2 + max(0, b). */
static double controller_error(controller *c) {
    const lg_mlp *net = &c->model.net;
    const double *mass = c->theta + lg_mlp_parameters(net);
    const long double m = (long double)mass[0] * mass[0] + (mass[1] > 0 ? mass[1] : 0);
    long double q[3], slope[3], one = 1;
    double worst = 0;
    for (size_t i = 0; i < STATES; i++) {
        const double *state = c->states + 6 * i;
        double expected[6];
        for (int j = 0; j < 3; j++) q[j] = state[j];
        reference_run(
            &(reference_pass){.net = net, .theta = c->theta, .rows = 1, .x = q, .cy = &one, .input = slope});
        for (int j = 0; j < 3; j++) {
            expected[j] = (double)slope[j];
            expected[3 + j] = (double)(state[3 + j] / m);
        }
        lg_model_jacobian(c->learned, state, NULL, c->gradient, c->work);
        const double error = bench_difference(c->gradient, expected, 6);
        if (!(error <= worst)) worst = error;
    }
    return worst;
}

/* Draws states: q on the unit sphere, p tangent to the sphere at q. */
static void fill_states(double *states) {
    double *u = bench_uniform(6 * STATES, 3);
    for (size_t i = 0; i < STATES; i++) {
        const double *x = u + 6 * i, *w = x + 3;
        double *q = states + 6 * i, *p = q + 3;
        const double length = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
        for (int j = 0; j < 3; j++) q[j] = x[j] / length;
        for (int j = 0; j < 3; j++) p[j] = q[(j + 1) % 3] * w[(j + 2) % 3] - q[(j + 2) % 3] * w[(j + 1) % 3];
    }
    free(u);
}

void bench_batch1(bench *b) {
    const uint32_t width = (uint32_t)b->given->width, hidden[3] = {width, width, width};
    const size_t calls = b->given->repeats > 0 ? (size_t)b->given->repeats : CALLS;
    controller c = {.value = 0};
    lg_rng rng;
    if (b->dtype != LG_F64) bench_check(b, LG_UNSUPPORTED, "a learned Hamiltonian is evaluated in f64");
    bench_check(b,
                lg_hamiltonian_init(&c.model, lg_hamiltonian_family_find("chain"), 1, LG_POTENTIAL_MLP,
                                    hidden, 3, LG_TANH),
                "making the model");
    c.theta = app_alloc(lg_hamiltonian_parameters(&c.model), sizeof *c.theta);
    c.states = app_alloc(6 * STATES, sizeof *c.states);
    lg_rng_seed(&rng, 1, 1);
    lg_hamiltonian_initialise(&c.model, &rng, c.theta);
    c.learned = bench_model(b, &c.model, c.theta);
    c.work = app_alloc(lg_model_work_size(c.learned), 1);
    fill_states(c.states);
    distribution(b, "value and gradient", &c, ask, calls);
    for (size_t i = 0; i < b->rows; i++) {
        b->row[i].width = width;
        b->row[i].error = controller_error(&c);
        b->row[i].error_is = bench_long_double;
    }
    c.as_long = b->rows > 0 ? 1e3 * b->row[0].median_us : 0;
    distribution(b, "empty loop", &c, nothing, calls);
    distribution(b, "empty loop as long", &c, wait, calls);
    lg_model_destroy(c.learned);
    free(c.theta);
    free(c.states);
    free(c.work);
}

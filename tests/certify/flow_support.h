/* Random systems with a held input, recorded and in long double, and their exact motions. */
#ifndef LG_FLOW_TEST_SUPPORT_H
#define LG_FLOW_TEST_SUPPORT_H

#include "certify_support.h"

enum { FLOW_MOST = 4 };

/* In units of the system, X = x/size and time t/tau:
 *     X_i' = sum a_ij X_j + b_i u + c_i sin X_p + d_i X_p X_q/(1 + X_q^2) + g_i tanh(s X_q),
 *     u = -limit of sum k_j X_j, with p = i + 1 and q = i + 2. */
typedef struct flow_system {
    size_t n;
    double a[FLOW_MOST * FLOW_MOST], b[FLOW_MOST], c[FLOW_MOST], d[FLOW_MOST], g[FLOW_MOST], s, k[FLOW_MOST],
        limit, size[FLOW_MOST], tau;
} flow_system;

static inline lg_var flow_column(lg_tape *tape, const flow_system *f, lg_var x, size_t i) {
    i %= f->n;
    return lg_scale(tape, column(tape, x, (uint32_t)i), 1 / f->size[i]);
}

static inline lg_status flow_rate(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x,
                                  lg_var *y) {
    const flow_system *f = user;
    lg_var rate[FLOW_MOST];
    (void)theta;
    for (size_t i = 0; i < f->n; i++) {
        const lg_var p = flow_column(tape, f, x[0], i + 1), q = flow_column(tape, f, x[0], i + 2);
        lg_var sum = lg_scale(tape, x[1], f->b[i]);
        for (size_t j = 0; j < f->n; j++)
            sum = lg_add(tape, sum, lg_scale(tape, flow_column(tape, f, x[0], j), f->a[i * f->n + j]));
        const lg_var bent = lg_div(tape, lg_scale(tape, lg_mul(tape, p, q), f->d[i]),
                                   lg_add_scalar(tape, lg_square(tape, q), 1));
        sum = lg_add(tape, sum, lg_scale(tape, lg_sin(tape, p), f->c[i]));
        sum = lg_add(tape, lg_add(tape, sum, bent),
                     lg_scale(tape, lg_act(tape, lg_scale(tape, q, f->s), LG_TANH), f->g[i]));
        rate[i] = lg_scale(tape, sum, f->size[i] / f->tau);
    }
    y[0] = lg_concat(tape, rate, f->n, 1);
    return lg_tape_status(tape);
}

static inline lg_status flow_control(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x,
                                     lg_var *y) {
    const flow_system *f = user;
    lg_var sum = LG_NONE;
    (void)theta;
    for (size_t j = 0; j < f->n; j++) {
        const lg_var term = lg_scale(tape, flow_column(tape, f, x[0], j), -f->k[j]);
        sum = j == 0 ? term : lg_add(tape, sum, term);
    }
    y[0] = saturated(tape, sum, f->limit);
    return lg_tape_status(tape);
}

/* A program with the functions `rate` and `control`. */
static inline lg_program *flow_program(flow_system *f) {
    const lg_port in[2] = {{.name = "x", .shape = lg_shape1((uint32_t)f->n)},
                           {.name = "u", .shape = lg_shape1(1)}},
                  out = {.name = "y"};
    const lg_function_spec functions[2] = {{"rate", in, 2, &out, 1, flow_rate, f},
                                           {"control", in, 1, &out, 1, flow_control, f}};
    const lg_program_spec spec = spec_of(NULL, 0, functions, 2);
    return test_program(&spec);
}

/* ---- exact motions: in units of the system ---- */

static inline void flow_exact_rate(const flow_system *f, const long double *X, long double u,
                                   long double *rate) {
    for (size_t i = 0; i < f->n; i++) {
        const long double p = X[(i + 1) % f->n], q = X[(i + 2) % f->n];
        rate[i] = f->b[i] * u + f->d[i] * p * q / (1 + q * q);
        if (f->c[i] != 0) rate[i] += f->c[i] * sinl(p);
        if (f->g[i] != 0) rate[i] += f->g[i] * tanhl(f->s * q);
        for (size_t j = 0; j < f->n; j++) rate[i] += f->a[i * f->n + j] * X[j];
    }
}

static inline long double flow_exact_control(const flow_system *f, const long double *X) {
    long double u = 0;
    for (size_t j = 0; j < f->n; j++) u -= f->k[j] * X[j];
    return fmaxl(-f->limit, fminl(f->limit, u));
}

/* Moves X for `time` with Gragg's midpoint rule, extrapolated to order 16, in `pieces` steps. */
static inline void flow_exact(const flow_system *f, long double *X, long double u, long double time,
                              int pieces) {
    enum { LEVELS = 8 };
    const size_t n = f->n;
    for (int piece = 0; piece < pieces; piece++) {
        const long double H = time / pieces;
        long double table[LEVELS][FLOW_MOST];
        for (int l = 0; l < LEVELS; l++) {
            const int steps = 2 * (l + 1);
            const long double h = H / steps;
            long double before[FLOW_MOST], now[FLOW_MOST], rate[FLOW_MOST];
            flow_exact_rate(f, X, u, rate);
            for (size_t i = 0; i < n; i++) before[i] = X[i], now[i] = X[i] + h * rate[i];
            for (int k = 1; k < steps; k++) {
                flow_exact_rate(f, now, u, rate);
                for (size_t i = 0; i < n; i++) {
                    const long double next = before[i] + 2 * h * rate[i];
                    before[i] = now[i];
                    now[i] = next;
                }
            }
            flow_exact_rate(f, now, u, rate);
            for (size_t i = 0; i < n; i++) table[l][i] = (now[i] + before[i] + h * rate[i]) / 2;
        }
        for (int k = 1; k < LEVELS; k++)
            for (int l = LEVELS - 1; l >= k; l--) {
                const long double ratio = (long double)(l + 1) / (l + 1 - k);
                for (size_t i = 0; i < n; i++)
                    table[l][i] += (table[l][i] - table[l - 1][i]) / (ratio * ratio - 1);
            }
        for (size_t i = 0; i < n; i++) X[i] = table[LEVELS - 1][i];
    }
}

/* ---- drawn systems ---- */

static inline double flow_drawn(lg_rng *r, double size) {
    return lg_rng_below(r, 3) == 0 ? 0 : lg_rng_uniform_in(r, -size, size);
}

static inline flow_system draw_flow(lg_rng *r) {
    static const double units[] = {1, 1, 0x1p30, 0x1p-30, 0x1p10}, fast[] = {1, 1, 1, 3, 20};
    flow_system f = {.n = 2 + lg_rng_below(r, FLOW_MOST - 1), .limit = lg_rng_uniform_in(r, 0.2, 3)};
    const double speed = fast[lg_rng_below(r, LG_COUNT(fast))];
    for (size_t i = 0; i < f.n * f.n; i++) f.a[i] = flow_drawn(r, 1.5 * speed);
    for (size_t i = 0; i < f.n; i++) {
        f.a[i * (f.n + 1)] -= speed > 3 ? speed : 0;
        f.b[i] = flow_drawn(r, 2), f.c[i] = flow_drawn(r, 2), f.d[i] = flow_drawn(r, 1);
        f.g[i] = flow_drawn(r, 1), f.k[i] = flow_drawn(r, 2);
        f.size[i] = units[lg_rng_below(r, LG_COUNT(units))];
    }
    f.s = lg_rng_uniform_in(r, 0.5, 4);
    f.tau = units[lg_rng_below(r, LG_COUNT(units))];
    return f;
}

#endif

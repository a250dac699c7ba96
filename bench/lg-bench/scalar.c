/* Scalar code: the planar double pendulum (pendulum.h) with the classical Runge-Kutta scheme, 100 steps of
 * 0.01. J is the sum of the last state's numbers; the gradient is dJ/d(start). */
#include <stdlib.h>
#include <string.h>

#include "lg-bench/bench.h"
#include "lg-bench/pendulum.h"
#include "liegrad/ops.h"

enum { STEPS = 100 };
static const double start[4] = {1.0, 0.5, 0.2, -0.3};

/* ---- gradient written by hand, as a custom operation ---- */

typedef struct trajectory {
    pendulum_stage stage[STEPS][STAGES];
} trajectory;

static void run_forward(trajectory *t, const double *y0, double *y) {
    memcpy(y, y0, sizeof start);
    for (int n = 0; n < STEPS; n++) pendulum_step(y, t->stage[n]);
}

static void run_adjoint(const trajectory *t, const double *g, double *y0) {
    memcpy(y0, g, sizeof start);
    for (int n = STEPS - 1; n >= 0; n--) pendulum_step_adjoint(t->stage[n], y0);
}

static lg_status custom_forward(void *user, lg_dtype dtype, const void *const *inputs, void *y) {
    if (dtype != LG_F64) return LG_UNSUPPORTED;
    run_forward(user, inputs[0], y);
    return LG_OK;
}

/* Uses the stages that the last custom_forward stored: a gradient must directly follow its forward run. */
static lg_status custom_vjp(void *user, lg_dtype dtype, const void *const *inputs, const void *y,
                            const void *g, void *const *out) {
    (void)dtype;
    (void)inputs;
    (void)y;
    if (out[0] != NULL) run_adjoint(user, g, out[0]);
    return LG_OK;
}

/* ---- gradient by plain operations on the tape ---- */

/* The field f of the four scalars y, written as anyone would write it. */
static void tape_field(lg_tape *t, const lg_var *y, lg_var *f) {
    const lg_var s1 = lg_sin(t, y[0]), s2 = lg_sin(t, y[1]), c1 = lg_cos(t, y[0]), c2 = lg_cos(t, y[1]);
    const lg_var s = lg_sub(t, lg_mul(t, s1, c2), lg_mul(t, c1, s2));
    const lg_var c = lg_add(t, lg_mul(t, c1, c2), lg_mul(t, s1, s2));
    const lg_var det = lg_add_scalar(t, lg_neg(t, lg_mul(t, c, c)), 2);
    const lg_var w11 = lg_mul(t, y[2], y[2]), w22 = lg_mul(t, y[3], y[3]);
    const lg_var r1 = lg_sub(t, lg_scale(t, s1, -2 * gravity), lg_mul(t, w22, s));
    const lg_var r2 = lg_sub(t, lg_mul(t, w11, s), lg_scale(t, s2, gravity));
    f[0] = y[2];
    f[1] = y[3];
    f[2] = lg_div(t, lg_sub(t, r1, lg_mul(t, c, r2)), det);
    f[3] = lg_div(t, lg_sub(t, lg_scale(t, r2, 2), lg_mul(t, c, r1)), det);
}

static void tape_run(lg_tape *t, lg_var *y) {
    for (int n = 0; n < STEPS; n++) {
        lg_var k[STAGES][4], at[4];
        for (int i = 0; i < STAGES; i++) {
            for (int j = 0; j < 4; j++)
                at[j] = i == 0 ? y[j] : lg_add(t, y[j], lg_scale(t, k[i - 1][j], step * offset[i]));
            tape_field(t, at, k[i]);
        }
        for (int j = 0; j < 4; j++) {
            const lg_var x[5] = {y[j], k[0][j], k[1][j], k[2][j], k[3][j]};
            const double c[5] = {1, step / 6, step / 3, step / 3, step / 6};
            y[j] = lg_linear_combination(t, x, c, 5);
        }
    }
}

/* ---- the cases ---- */

typedef struct scalar {
    lg_tape *tape;
    lg_custom_op operation;
    trajectory *trajectory;
    double gradient[4];
} scalar;

static void custom_call(void *user) {
    scalar *s = user;
    void *gradient = s->gradient;
    lg_tape_reset(s->tape);
    const lg_var y0 = lg_input(s->tape, lg_shape1(4), start);
    const lg_var y = lg_custom(s->tape, &s->operation, &y0, 1, lg_shape1(4));
    (void)lg_backward_set(s->tape, y, &y0, 1, &gradient);
}

static void operations_call(void *user) {
    scalar *s = user;
    lg_var y0[4], y[4];
    lg_tape_reset(s->tape);
    void *const gradient[4] = {&s->gradient[0], &s->gradient[1], &s->gradient[2], &s->gradient[3]};
    for (int j = 0; j < 4; j++) y[j] = y0[j] = lg_input(s->tape, lg_shape0(), &start[j]);
    tape_run(s->tape, y);
    const lg_var sum = lg_add(s->tape, lg_add(s->tape, y[0], y[1]), lg_add(s->tape, y[2], y[3]));
    (void)lg_backward_set(s->tape, sum, y0, 4, gradient);
}

static void forward_call(void *user) {
    scalar *s = user;
    double y[4];
    run_forward(s->trajectory, start, y);
    s->gradient[0] += y[0]; /* Keeps the compiler from removing the run. */
}

/* ---- reference: fourth order difference quotients in long double ---- */

static long double sum_of_last(const long double *y0) {
    long double y[4];
    memcpy(y, y0, sizeof y);
    for (int n = 0; n < STEPS; n++) {
        long double k[4] = {0, 0, 0, 0}, sum[4] = {0, 0, 0, 0}, at[4];
        for (int i = 0; i < STAGES; i++) {
            for (int j = 0; j < 4; j++) at[j] = y[j] + step * (long double)offset[i] * k[j];
            const long double s = sinl(at[0] - at[1]), c = cosl(at[0] - at[1]), d = 1 / (2 - c * c);
            const long double r1 = -at[3] * at[3] * s - 2 * (long double)gravity * sinl(at[0]);
            const long double r2 = at[2] * at[2] * s - (long double)gravity * sinl(at[1]);
            const long double f[4] = {at[2], at[3], d * (r1 - c * r2), d * (2 * r2 - c * r1)};
            memcpy(k, f, sizeof k);
            for (int j = 0; j < 4; j++) sum[j] += weight[i] * k[j];
        }
        for (int j = 0; j < 4; j++) y[j] += (long double)step / 6 * sum[j];
    }
    return y[0] + y[1] + y[2] + y[3];
}

static double scalar_error(const double *gradient) {
    const long double h = 1e-4L;
    double expected[4];
    for (int j = 0; j < 4; j++) {
        long double value[4], y[4];
        static const int at[4] = {-2, -1, 1, 2};
        for (int i = 0; i < 4; i++) {
            for (int l = 0; l < 4; l++) y[l] = start[l] + (l == j ? at[i] * h : 0);
            value[i] = sum_of_last(y);
        }
        expected[j] = (double)((value[0] - 8 * value[1] + 8 * value[2] - value[3]) / (12 * h));
    }
    return bench_difference(gradient, expected, 4);
}

static const char scalar_reference[] = "max |x - r| / max |r|, r: difference quotients in long double";

static void scalar_row(bench *b, scalar *s, const char *name, void (*call)(void *user), bool judged) {
    bench_row *row = bench_measure(b, name, call, s);
    if (row == NULL || !judged) return;
    call(s);
    bench_check_tape(b, s->tape);
    row->error = scalar_error(s->gradient);
    row->error_is = scalar_reference;
}

static void with_scalar(bench *b, bool custom) {
    if (b->dtype != LG_F64) bench_check(b, LG_UNSUPPORTED, "the scalar cases are f64");
    scalar s = {.tape = bench_tape(b, LG_F64, 1), .trajectory = app_alloc(1, sizeof *s.trajectory)};
    s.operation = (lg_custom_op){
        .name = "trajectory", .forward = custom_forward, .numeric_vjp = custom_vjp, .user = s.trajectory};
    if (custom) {
        scalar_row(b, &s, "custom", custom_call, true);
        scalar_row(b, &s, "forward", forward_call, false);
    } else {
        scalar_row(b, &s, "operations", operations_call, true);
    }
    lg_tape_destroy(s.tape);
    free(s.trajectory);
}

void bench_scalar(bench *b) {
    with_scalar(b, true);
}

void bench_scalar_ops(bench *b) {
    with_scalar(b, false);
}

/* own_function: records a function on a tape, checks its derivatives, and minimises it by Newton's method.
 * Conjugate gradients solve for the steps, so the Hessian H is never formed; only products H v are. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <liegrad/gradcheck.h>
#include <liegrad/ops.h>

enum { N = 50 };

/* f(x) = sum over i < N - 1 of (1 - x_i)^2 + 100 (x_{i+1} - x_i^2)^2 (Rosenbrock); the minimum is at 1. */
static lg_var valley(const void *none, lg_tape *t, const lg_var *x) {
    const lg_var low = lg_slice(t, x[0], 0, 0, N - 1), next = lg_slice(t, x[0], 0, 1, N - 1);
    const lg_var wall = lg_square(t, lg_sub(t, next, lg_square(t, low)));
    (void)none;
    return lg_sum(t, lg_add(t, lg_square(t, lg_add_scalar(t, low, -1)), lg_scale(t, wall, 100)));
}

static double value(lg_tape *t, const double *x) {
    const lg_mark mark = lg_tape_mark(t);
    const lg_var at = lg_input_f64(t, lg_shape1(N), x);
    double f = NAN;
    (void)lg_read(t, valley(NULL, t, &at), 1, &f); /* on failure f stays NaN */
    return lg_tape_rewind(t, mark) == LG_OK ? f : NAN;
}

static double dot(const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < N; i++) sum += a[i] * b[i];
    return sum;
}

/* Computes H v at x, the point where f was recorded. */
static lg_status product(lg_tape *t, lg_var f, lg_var x, const double *v, double *out) {
    const lg_mark mark = lg_tape_mark(t);
    const lg_status status = lg_read(t, lg_hvp(t, f, x, lg_input_f64(t, lg_shape1(N), v)), N, out);
    return status == LG_OK ? lg_tape_rewind(t, mark) : status;
}

/* Solves H s = -g by conjugate gradients. It stops early at a direction along which f is not convex, with the
 * s found so far. */
static lg_status solve(lg_tape *t, lg_var f, lg_var x, const double *g, double *s) {
    double r[N], v[N], Hv[N];
    for (int i = 0; i < N; i++) s[i] = 0, v[i] = r[i] = -g[i];
    for (int n = 0; n < 2 * N && dot(r, r) > 1e-4 * dot(g, g); n++) {
        const lg_status status = product(t, f, x, v, Hv);
        const double square = dot(r, r), curvature = dot(v, Hv);
        if (status != LG_OK) return status;
        if (!(curvature > 0)) return n == 0 ? memcpy(s, v, sizeof v), LG_OK : LG_OK;
        for (int i = 0; i < N; i++) s[i] += square / curvature * v[i], r[i] -= square / curvature * Hv[i];
        const double turn = dot(r, r) / square;
        for (int i = 0; i < N; i++) v[i] = r[i] + turn * v[i];
    }
    return LG_OK;
}

/* Makes a Newton step from x (in/out). *slope becomes the norm of the gradient at the start of the step. */
static lg_status newton(lg_tape *t, double *x, double *slope) {
    double g[N], s[N], to[N], length = 1;
    lg_tape_reset(t);
    const lg_var at = lg_input_f64(t, lg_shape1(N), x), f = valley(NULL, t, &at);
    lg_var gradient = LG_NONE;
    lg_status status = lg_grad(t, f, &at, 1, &gradient);
    if (status == LG_OK) status = lg_read(t, gradient, N, g);
    if (status == LG_OK) status = solve(t, f, at, g, s);
    if (status != LG_OK) return status;
    const double here = value(t, x);
    for (int k = 0; k < 40; k++, length /= 2) {
        for (int i = 0; i < N; i++) to[i] = x[i] + length * s[i];
        if (value(t, to) <= here + 1e-4 * length * dot(g, s)) break;
    }
    memcpy(x, to, sizeof to);
    *slope = sqrt(dot(g, g));
    return LG_OK;
}

/* Where a matrix is wanted, H is the Jacobian of the gradient. *off becomes the largest |H_ij - H_ji|. */
static lg_status asymmetry(lg_tape *t, const double *x, double *off) {
    double H[N * N];
    lg_tape_reset(t);
    const lg_var at = lg_input_f64(t, lg_shape1(N), x);
    lg_var gradient = LG_NONE;
    lg_status status = lg_grad(t, valley(NULL, t, &at), &at, 1, &gradient);
    if (status == LG_OK) status = lg_read(t, lg_jacobian(t, gradient, at), N * N, H);
    for (int i = 0; i < N * N && status == LG_OK; i++) *off = fmax(*off, fabs(H[i] - H[i % N * N + i / N]));
    return status;
}

int main(void) {
    const lg_gradcheck_argument point = {.shape = lg_shape1(N), .low = -2, .high = 2};
    const lg_gradcheck_function function = {
        .name = "valley", .inputs = 1, .arguments = &point, .build = valley};
    lg_gradcheck_result check;
    lg_tape *t = NULL;
    double x[N] = {0}, slope = 1, worst = 0, off = 0;
    int steps = 0;
    if (lg_gradcheck(NULL, &function, NULL, &check) != LG_OK) return (void)puts(check.message), 1;
    printf("derivatives are right: Taylor slopes %.2f and %.2f\n", check.order[0].slope,
           check.order[1].slope);
    lg_status status = lg_tape_create(NULL, NULL, &t);
    while (status == LG_OK && slope > 1e-9 && steps < 500) status = newton(t, x, &slope), steps++;
    if (status == LG_OK) status = asymmetry(t, x, &off);
    if (status != LG_OK) (void)puts(t != NULL ? lg_tape_message(t) : lg_status_sentence(status));
    for (int i = 0; i < N; i++) worst = fmax(worst, fabs(x[i] - 1));
    printf("after %d steps x is off by %.1e, and the Hessian there is symmetric to %.0e\n", steps, worst,
           off);
    lg_tape_destroy(t);
    return status == LG_OK && worst < 1e-8 && off < 1e-9 ? 0 : 1;
}

/* The mechanics of a beam as terms of a loss, on a tape.
 *
 * EI theta'' = lx sin theta - ly cos theta along q' = (cos theta, sin theta) has the integral
 *   EI theta' = m + lx y - ly x,
 * so the bending moment is linear in the position. In units of L and EI, with f = (lx, ly) L^2/EI, the error
 * at point k is e_k = L theta'_k - m - fx y_k/L + fy x_k/L. In each curve m and f minimise the sum of
 * e_k^2. */
#include <math.h>

#include "liegrad/ops.h"
#include "elastica/surrogate_internal.h"

/* a (B, n) less the mean of each row. */
static lg_var centred(lg_tape *tape, lg_var a, double scale) {
    const lg_var scaled = lg_scale(tape, a, scale);
    return lg_sub(tape, scaled, lg_mean_axis(tape, scaled, 1, true));
}

static lg_var mean_of(lg_tape *tape, lg_var a, lg_var b) {
    return lg_mean_axis(tape, lg_mul(tape, a, b), 1, true);
}

/* (a d - b c)/e */
static lg_var cramer(lg_tape *tape, lg_var a, lg_var d, lg_var b, lg_var c, lg_var e) {
    return lg_div(tape, lg_sub(tape, lg_mul(tape, a, d), lg_mul(tape, b, c)), e);
}

/* Points on a line leave f undetermined: a small part of xx + yy is added to both. */
lg_var lg_surrogate_moments(lg_tape *tape, const lg_surrogate *model, lg_var turning, lg_var x, lg_var y) {
    const double regular = lg_tape_dtype(tape) == LG_F32 ? 1e-6 : 1e-12;
    const lg_var k = centred(tape, turning, model->length);
    x = centred(tape, x, 1.0 / model->length), y = centred(tape, y, 1.0 / model->length);
    lg_var xx = mean_of(tape, x, x), yy = mean_of(tape, y, y);
    const lg_var xy = mean_of(tape, x, y), kx = mean_of(tape, k, x), ky = mean_of(tape, k, y);
    const lg_var more = lg_scale(tape, lg_add(tape, xx, yy), regular);
    xx = lg_add(tape, xx, more), yy = lg_add(tape, yy, more);
    const lg_var det = lg_sub(tape, lg_mul(tape, xx, yy), lg_square(tape, xy));
    const lg_var f[2] = {cramer(tape, xx, ky, xy, kx, det), cramer(tape, xy, ky, yy, kx, det)};
    const lg_var loaded = lg_sub(tape, lg_mul(tape, f[0], y), lg_mul(tape, f[1], x));
    return lg_sub(tape, k, loaded);
}

/* Least squares of theta_k - theta_0 = m s_k + fx Y_k - fy X_k over the nodes: the moment, integrated once
 * more. X and Y are the integrals of x and y from s = 0, of the cubics through nodes and tangents; everything
 * in units of L. */
enum { UNKNOWN = 3 };

static void solve(double a[UNKNOWN][UNKNOWN + 1]) {
    for (size_t p = 0; p < UNKNOWN; p++)
        for (size_t i = 0; i < UNKNOWN; i++) {
            const double factor = i == p || a[p][p] == 0.0 ? 0.0 : a[i][p] / a[p][p];
            for (size_t j = p; j <= UNKNOWN; j++) a[i][j] -= factor * a[p][j];
        }
}

void lg_surrogate_force(double length, uint32_t intervals, const double *q, const double *v, double *force) {
    const double h = 1.0 / intervals;
    double a[UNKNOWN][UNKNOWN + 1] = {{0.0}}, row[UNKNOWN + 1] = {0.0};
    for (size_t k = 0; k < intervals; k++) {
        const double *p = q + 2 * k, *t = v + 2 * k;
        double area[2];
        for (size_t c = 0; c < 2; c++)
            area[c] = 0.5 * h * (p[c] + p[c + 2] - 2.0 * q[c]) / length + h * h / 12.0 * (t[c] - t[c + 2]);
        row[0] += h, row[1] += area[1], row[2] -= area[0];
        row[UNKNOWN] += atan2(t[0] * t[3] - t[1] * t[2], t[0] * t[2] + t[1] * t[3]);
        for (size_t i = 0; i < UNKNOWN; i++)
            for (size_t j = 0; j <= UNKNOWN; j++) a[i][j] += row[i] * row[j];
    }
    solve(a);
    for (size_t c = 0; c < 2; c++)
        force[c] = a[c + 1][c + 1] == 0.0 ? 0.0 : a[c + 1][UNKNOWN] / a[c + 1][c + 1];
}

lg_var lg_surrogate_bending(lg_tape *tape, const lg_surrogate *model, lg_var turning) {
    const lg_var mean = lg_mean_axis(tape, lg_square(tape, turning), 1, true);
    return lg_scale(tape, mean, 0.5 * model->length * model->length);
}

lg_var lg_surrogate_closing(lg_tape *tape, const lg_surrogate *model, lg_var force, lg_var r) {
    const double length = model->length, n = model->intervals;
    const lg_var terms[2] = {lg_rowdot(tape, force, r), lg_rownorm2(tape, r)};
    const double weights[2] = {1.0 / length, 18.0 * n * n / (length * length)};
    return lg_linear_combination(tape, terms, weights, 2);
}

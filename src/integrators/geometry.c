/* SO(3) and SE(3) in coordinates. In every function `out` may be one of the inputs. */
#include "liegrad/geometry.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "kernels/stumpff.h"

static inline double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross(const double a[3], const double b[3], double out[3]) {
    const double x = a[1] * b[2] - a[2] * b[1];
    const double y = a[2] * b[0] - a[0] * b[2];
    const double z = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

double lg_dot3(const double a[3], const double b[3]) {
    return dot(a, b);
}

void lg_cross3(const double a[3], const double b[3], double out[3]) {
    cross(a, b, out);
}

/* out = b + g1 u x b + g2 u x (u x b): every function of hat(u) that is I at 0 has this form. */
static void so3_function(double g1, double g2, const double u[3], const double b[3], double out[3]) {
    double ub[3], uub[3];
    cross(u, b, ub);
    cross(u, ub, uub);
    for (int i = 0; i < 3; i++) out[i] = b[i] + (g1 * ub[i] + g2 * uub[i]);
}

/* Applies so3_function to each column of the 3 x 3 matrix B. */
static void so3_function_columns(double g1, double g2, const double u[3], const double B[9], double out[9]) {
    double result[9];
    for (int j = 0; j < 3; j++) {
        double column[3] = {B[j], B[3 + j], B[6 + j]};
        so3_function(g1, g2, u, column, column);
        for (int i = 0; i < 3; i++) result[3 * i + j] = column[i];
    }
    memcpy(out, result, sizeof(result));
}

void lg_so3_exp_multiply(const double u[3], const double R[9], double out[9]) {
    double c[4];
    lg_stumpff(dot(u, u), 3, 0, c);
    so3_function_columns(c[1], c[2], u, R, out);
}

void lg_so3_exp(const double u[3], double R[9]) {
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    lg_so3_exp_multiply(u, identity, R);
}

/* The symmetric matrix K with q^T K q = tr(R(q)^T A) for unit quaternions q = (scalar, vector), plus `shift`
 * times I. For a rotation A = R(q), K + I = 4 q q^T. */
static void quaternion_form(const double A[9], double shift, double K[4][4]) {
    const double wx = A[7] - A[5], wy = A[2] - A[6], wz = A[3] - A[1];
    const double xy = A[1] + A[3], xz = A[2] + A[6], yz = A[5] + A[7];
    const double rows[4][4] = {{shift + A[0] + A[4] + A[8], wx, wy, wz},
                               {wx, shift + A[0] - A[4] - A[8], xy, xz},
                               {wy, xy, shift - A[0] + A[4] - A[8], yz},
                               {wz, xz, yz, shift - A[0] - A[4] + A[8]}};
    memcpy(K, rows, sizeof rows);
}

/* Reads q off a row of 4 q q^T. The row with the largest diagonal entry has length at least 2, so normalising
 * it loses no digits. */
void lg_so3_log(const double R[9], double u[3]) {
    double rows[4][4];
    quaternion_form(R, 1.0, rows);
    int best = 0;
    for (int k = 1; k < 4; k++)
        if (rows[k][k] > rows[best][best]) best = k;
    const double *q = rows[best], norm = sqrt(dot(q + 1, q + 1)), scalar = fabs(q[0]);
    const double half = norm == 0.0 ? 1.0 / scalar : atan2(norm, scalar) / norm;
    const double factor = q[0] < 0.0 ? -2.0 * half : 2.0 * half;
    for (int i = 0; i < 3; i++) u[i] = factor * q[i + 1];
}

void lg_so3_adjoint(const double R[9], const double b[3], double out[3]) {
    const double x[3] = {dot(R, b), dot(R + 3, b), dot(R + 6, b)};
    memcpy(out, x, sizeof(x));
}

void lg_so3_coadjoint(const double R[9], const double mu[3], double out[3]) {
    double x[3];
    for (int j = 0; j < 3; j++) x[j] = R[j] * mu[0] + R[3 + j] * mu[1] + R[6 + j] * mu[2];
    memcpy(out, x, sizeof(x));
}

void lg_so3_exp_act(const double u[3], const double q[3], double out[3]) {
    double c[4];
    lg_stumpff(dot(u, u), 3, 0, c);
    so3_function(c[1], c[2], u, q, out);
}

void lg_so3_dexp(const double u[3], const double b[3], double out[3]) {
    double c[4];
    lg_stumpff(dot(u, u), 3, 0, c);
    so3_function(c[2], c[3], u, b, out);
}

void lg_so3_dexpinv(const double u[3], const double b[3], double out[3]) {
    so3_function(-0.5, lg_dexpinv_coef(dot(u, u), 0), u, b, out);
}

/* If the largest |entry| is outside of about 2^-9 .. 2^8, scales R by a power of two that brings it near 1.
 * Rotations are never scaled. */
static void scale_entries(double R[9]) {
    double largest = 0.0;
    int exponent;
    for (int i = 0; i < 9; i++) largest = fmax(largest, fabs(R[i]));
    (void)frexp(largest, &exponent);
    if (!isfinite(largest) || abs(exponent) <= 8) return;
    for (int i = 0; i < 9; i++) R[i] = ldexp(R[i], -exponent);
}

enum { SQUARES = 50 };

/* The quaternion q of the nearest rotation maximises q^T K q (B. K. P. Horn 1987). K + c I has no negative
 * eigenvalue, and repeatedly squared (and divided by its trace) it tends to q q^T. If the two largest
 * eigenvalues differ by rounding only, SQUARES squarings do not separate them; then the result is NaN. */
static void nearest_rotation(double R[9]) {
    double sum = 0.0, change = 1.0, P[4][4];
    for (int i = 0; i < 9; i++) sum += fabs(R[i]);
    quaternion_form(R, sum, P);
    for (int n = 0; n < SQUARES && change > 1e-9; n++) {
        const double scale = 1.0 / (P[0][0] + P[1][1] + P[2][2] + P[3][3]);
        double Q[4][4];
        for (int i = 0; i < 16; i++) Q[i / 4][i % 4] = scale * P[i / 4][i % 4];
        change = 0.0;
        for (int i = 0; i < 16; i++) {
            const double *a = Q[i / 4], *b = Q[i % 4];
            P[i / 4][i % 4] = (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]);
            change = fmax(change, fabs(P[i / 4][i % 4] - a[i % 4]));
        }
    }
    const double turn[9] = {P[0][0] + P[1][1] - P[2][2] - P[3][3],
                            2.0 * (P[1][2] - P[0][3]),
                            2.0 * (P[1][3] + P[0][2]),
                            2.0 * (P[1][2] + P[0][3]),
                            P[0][0] - P[1][1] + P[2][2] - P[3][3],
                            2.0 * (P[2][3] - P[0][1]),
                            2.0 * (P[1][3] - P[0][2]),
                            2.0 * (P[2][3] + P[0][1]),
                            P[0][0] - P[1][1] - P[2][2] + P[3][3]};
    for (int i = 0; i < 9; i++) R[i] = change > 1e-9 ? NAN : turn[i];
}

/* Newton's method R <- (R + R^-T)/2 with R^-T = cofactors / determinant: the error after a step is half the
 * square of the error before. If R is far from a rotation, nearest_rotation is used instead, because the
 * inverse would lose digits that the polar factor has. */
void lg_so3_project(double R[9]) {
    double cofactor[9], d[9], change = 1.0;
    scale_entries(R);
    while (change > 1e-9) {
        for (int i = 0; i < 3; i++) cross(R + 3 * ((i + 1) % 3), R + 3 * ((i + 2) % 3), cofactor + 3 * i);
        const double det = dot(R, cofactor), scale = det > 0.0 ? 1.0 / det : NAN;
        change = 0.0;
        for (int i = 0; i < 9; i++) {
            d[i] = 0.5 * (scale * cofactor[i] - R[i]);
            if (fabs(d[i]) > change) change = fabs(d[i]);
        }
        if (change > 0.5)
            nearest_rotation(R);
        else
            for (int i = 0; i < 9; i++) R[i] += d[i];
    }
}

void lg_se3_exp(const double a[6], double R[9], double r[3]) {
    double translation[3];
    lg_so3_dexp(a, a + 3, translation);
    lg_so3_exp(a, R);
    memcpy(r, translation, sizeof(translation));
}

void lg_se3_exp_multiply(const double a[6], const double R[9], const double r[3], double out_R[9],
                         double out_r[3]) {
    double c[4], moved[3], translation[3];
    lg_stumpff(dot(a, a), 3, 0, c);
    so3_function(c[2], c[3], a, a + 3, translation);
    so3_function(c[1], c[2], a, r, moved);
    so3_function_columns(c[1], c[2], a, R, out_R);
    for (int i = 0; i < 3; i++) out_r[i] = moved[i] + translation[i];
}

void lg_se3_log(const double R[9], const double r[3], double a[6]) {
    double u[3];
    lg_so3_log(R, u);
    lg_so3_dexpinv(u, r, a + 3);
    memcpy(a, u, sizeof(u));
}

void lg_se3_exp_act(const double a[6], const double y[6], double out[6]) {
    double c[4], r[3], q[3], p[3], rq[3];
    lg_stumpff(dot(a, a), 3, 0, c);
    so3_function(c[2], c[3], a, a + 3, r);
    so3_function(c[1], c[2], a, y, q);
    so3_function(c[1], c[2], a, y + 3, p);
    cross(r, q, rq);
    for (int i = 0; i < 3; i++) {
        out[i] = q[i];
        out[3 + i] = p[i] + rq[i];
    }
}

/* out = (u x x1, u x x2 + v x x1) for a = (u, v) and x = (x1, x2): the generator on T*S^2 and the bracket of
 * se(3) have the same formula. */
static void se3_cross(const double a[6], const double x[6], double out[6]) {
    double first[3], second[3], third[3];
    cross(a, x, first);
    cross(a, x + 3, second);
    cross(a + 3, x, third);
    for (int i = 0; i < 3; i++) {
        out[i] = first[i];
        out[3 + i] = second[i] + third[i];
    }
}

void lg_se3_generator(const double a[6], const double y[6], double out[6]) {
    se3_cross(a, y, out);
}

void lg_se3_bracket(const double a[6], const double b[6], double out[6]) {
    se3_cross(a, b, out);
}

/* Coefficients of a function phi(ad_a) with phi(0) = 1, w = |u|^2: g1, g2 and gt = 2 dg/dw of each. */
typedef struct coefficients {
    double g1, gt1, g2, gt2;
} coefficients;

static coefficients dexp_coefficients(const double a[6]) {
    double c[5];
    lg_stumpff_slopes(dot(a, a), c);
    return (coefficients){c[1], c[3], c[2], c[4]};
}

static coefficients dexpinv_coefficients(const double a[6]) {
    const double w = dot(a, a);
    return (coefficients){-0.5, 0.0, lg_dexpinv_coef(w, 0), 2.0 * lg_dexpinv_coef(w, 1)};
}

/* out = phi(ad_a) b. Let x = ad_a b, xx = ad_a ad_a b and rho = u.v. The result is b + g1 x + g2 xx. Its
 * translational part (the last three numbers) also has the term rho (gt1 x + gt2 xx), where x and xx mean
 * their rotational parts (the first three numbers). */
static void se3_function(coefficients k, const double a[6], const double b[6], double out[6]) {
    double x[6], xx[6];
    se3_cross(a, b, x);
    se3_cross(a, x, xx);
    const double rho = dot(a, a + 3);
    for (int i = 0; i < 3; i++) {
        out[3 + i] = b[3 + i] + (k.g1 * x[3 + i] + k.g2 * xx[3 + i] + rho * (k.gt1 * x[i] + k.gt2 * xx[i]));
        out[i] = b[i] + (k.g1 * x[i] + k.g2 * xx[i]);
    }
}

void lg_se3_dexp(const double a[6], const double b[6], double out[6]) {
    se3_function(dexp_coefficients(a), a, b, out);
}

void lg_se3_dexpinv(const double a[6], const double b[6], double out[6]) {
    se3_function(dexpinv_coefficients(a), a, b, out);
}

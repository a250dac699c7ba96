/* SO(3) and SE(3) in coordinates. In every function `out` may be one of the inputs. */
#include "liegrad/geometry.h"

#include <stdlib.h>
#include <string.h>

#include "integrators/doubles.inc"

double lg_dot3(const double a[3], const double b[3]) {
    return lie_dot(lie_at(a), lie_at(b));
}

void lg_cross3(const double a[3], const double b[3], double out[3]) {
    lie_put(lie_cross(lie_at(a), lie_at(b)), out);
}

void lg_so3_exp_multiply(const double u[3], const double R[9], double out[9]) {
    double c1, c2, c3;
    stumpff_lanes(lg_dot3(u, u), &c1, &c2, &c3);
    map_columns(c1, c2, lie_at(u), R, out);
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
    const double *q = rows[best], norm = sqrt(lg_dot3(q + 1, q + 1)), scalar = fabs(q[0]);
    const double half = norm == 0.0 ? 1.0 / scalar : atan2(norm, scalar) / norm;
    const double factor = q[0] < 0.0 ? -2.0 * half : 2.0 * half;
    for (int i = 0; i < 3; i++) u[i] = factor * q[i + 1];
}

void lg_so3_adjoint(const double R[9], const double b[3], double out[3]) {
    const double x[3] = {lg_dot3(R, b), lg_dot3(R + 3, b), lg_dot3(R + 6, b)};
    memcpy(out, x, sizeof(x));
}

void lg_so3_coadjoint(const double R[9], const double mu[3], double out[3]) {
    double x[3];
    for (int j = 0; j < 3; j++) x[j] = R[j] * mu[0] + R[3 + j] * mu[1] + R[6 + j] * mu[2];
    memcpy(out, x, sizeof(x));
}

void lg_so3_exp_act(const double u[3], const double q[3], double out[3]) {
    double c1, c2, c3;
    stumpff_lanes(lg_dot3(u, u), &c1, &c2, &c3);
    lie_put(lie_function(c1, c2, lie_at(u), lie_at(q)), out);
}

void lg_so3_dexp(const double u[3], const double b[3], double out[3]) {
    double c1, c2, c3;
    stumpff_lanes(lg_dot3(u, u), &c1, &c2, &c3);
    lie_put(lie_function(c2, c3, lie_at(u), lie_at(b)), out);
}

void lg_so3_dexpinv(const double u[3], const double b[3], double out[3]) {
    lie_put(lie_function(-0.5, lg_dexpinv_coef(lg_dot3(u, u), 0), lie_at(u), lie_at(b)), out);
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
        for (int i = 0; i < 3; i++) lg_cross3(R + 3 * ((i + 1) % 3), R + 3 * ((i + 2) % 3), cofactor + 3 * i);
        const double det = lg_dot3(R, cofactor), scale = det > 0.0 ? 1.0 / det : NAN;
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

void lg_se3_log(const double R[9], const double r[3], double a[6]) {
    double u[3];
    lg_so3_log(R, u);
    lg_so3_dexpinv(u, r, a + 3);
    memcpy(a, u, sizeof(u));
}

void lg_se3_exp_act(const double a[6], const double y[6], double out[6]) {
    const lie_vector u = lie_at(a);
    lie_vector q = lie_at(y), p = lie_at(y + 3);
    double c1, c2, c3;
    stumpff_lanes(lie_dot(u, u), &c1, &c2, &c3);
    (void)lie_act(u, lie_at(a + 3), c1, c2, c3, &q, &p);
    lie_put(q, out);
    lie_put(p, out + 3);
}

void lg_se3_generator(const double a[6], const double y[6], double out[6]) {
    cross_pair(a, y, out);
}

void lg_se3_bracket(const double a[6], const double b[6], double out[6]) {
    cross_pair(a, b, out);
}

/* Coefficients of a function phi(ad_a) with phi(0) = 1, w = |u|^2: g1, g2 and gt = 2 dg/dw of each. */
typedef struct coefficients {
    double g1, gt1, g2, gt2;
} coefficients;

static coefficients dexp_coefficients(const double a[6]) {
    double c[5];
    lg_stumpff_slopes(lg_dot3(a, a), c);
    return (coefficients){c[1], c[3], c[2], c[4]};
}

static coefficients dexpinv_coefficients(const double a[6]) {
    const double w = lg_dot3(a, a);
    return (coefficients){-0.5, 0.0, lg_dexpinv_coef(w, 0), 2.0 * lg_dexpinv_coef(w, 1)};
}

/* out = phi(ad_a) b. Let x = ad_a b, xx = ad_a ad_a b and rho = u.v. The result is b + g1 x + g2 xx. Its
 * translational part (the last three numbers) also has the term rho (gt1 x + gt2 xx), where x and xx mean
 * their rotational parts (the first three numbers). */
static void se3_function(coefficients k, const double a[6], const double b[6], double out[6]) {
    double x[6], xx[6];
    cross_pair(a, b, x);
    cross_pair(a, x, xx);
    const double rho = lg_dot3(a, a + 3);
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

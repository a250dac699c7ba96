/* SO(3) and SE(3) in coordinates; every function is written so that `out` may be an input. */
#include "liegrad/geometry.h"

#include <math.h>
#include <string.h>

#include "autodiff/kernels/stumpff.h"

double lg_dot3(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void lg_cross3(const double a[3], const double b[3], double out[3]) {
    const double x = a[1] * b[2] - a[2] * b[1];
    const double y = a[2] * b[0] - a[0] * b[2];
    const double z = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

/* out = b + g1 u x b + g2 u x (u x b): every function of hat(u) that is I at 0 has this form. */
static void so3_function(double g1, double g2, const double u[3], const double b[3], double out[3]) {
    double ub[3], uub[3];
    lg_cross3(u, b, ub);
    lg_cross3(u, ub, uub);
    for (int i = 0; i < 3; i++) out[i] = b[i] + (g1 * ub[i] + g2 * uub[i]);
}

void lg_so3_exp(const double u[3], double R[9]) {
    double c[4], column[3], unit[3] = {0.0, 0.0, 0.0}, result[9];
    lg_stumpff(lg_dot3(u, u), 3, 0, c);
    for (int j = 0; j < 3; j++) {
        unit[j] = 1.0;
        so3_function(c[1], c[2], u, unit, column);
        unit[j] = 0.0;
        for (int i = 0; i < 3; i++) result[3 * i + j] = column[i];
    }
    memcpy(R, result, sizeof(result));
}

void lg_so3_exp_act(const double u[3], const double q[3], double out[3]) {
    double c[4];
    lg_stumpff(lg_dot3(u, u), 3, 0, c);
    so3_function(c[1], c[2], u, q, out);
}

void lg_so3_dexp(const double u[3], const double b[3], double out[3]) {
    double c[4];
    lg_stumpff(lg_dot3(u, u), 3, 0, c);
    so3_function(c[2], c[3], u, b, out);
}

void lg_so3_dexpinv(const double u[3], const double b[3], double out[3]) {
    so3_function(-0.5, lg_dexpinv_coef(lg_dot3(u, u), 0), u, b, out);
}

void lg_se3_exp(const double a[6], double R[9], double r[3]) {
    double translation[3];
    lg_so3_dexp(a, a + 3, translation);
    lg_so3_exp(a, R);
    memcpy(r, translation, sizeof(translation));
}

void lg_se3_exp_act(const double a[6], const double y[6], double out[6]) {
    double c[4], r[3], q[3], p[3], rq[3];
    lg_stumpff(lg_dot3(a, a), 3, 0, c);
    so3_function(c[2], c[3], a, a + 3, r);
    so3_function(c[1], c[2], a, y, q);
    so3_function(c[1], c[2], a, y + 3, p);
    lg_cross3(r, q, rq);
    for (int i = 0; i < 3; i++) {
        out[i] = q[i];
        out[3 + i] = p[i] + rq[i];
    }
}

/* (u1 x x1, u1 x x2 + v1 x x1): the generator on T*S^2 and the bracket have the same coordinates. */
static void se3_cross(const double a[6], const double x[6], double out[6]) {
    double first[3], second[3], third[3];
    lg_cross3(a, x, first);
    lg_cross3(a, x + 3, second);
    lg_cross3(a + 3, x, third);
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

/* phi(ad_a) b for phi(0) = 1. With x = ad_a b and xx = ad_a ad_a b this is b + g1 x + g2 xx, and rho times
 * the w-derivatives of the coefficients on the translational part. */
static void se3_function(double g1, double gt1, double g2, double gt2, const double a[6], const double b[6],
                         double out[6]) {
    double x[6], xx[6];
    se3_cross(a, b, x);
    se3_cross(a, x, xx);
    const double rho = lg_dot3(a, a + 3);
    for (int i = 0; i < 3; i++) {
        out[3 + i] = b[3 + i] + (g1 * x[3 + i] + g2 * xx[3 + i] + rho * (gt1 * x[i] + gt2 * xx[i]));
        out[i] = b[i] + (g1 * x[i] + g2 * xx[i]);
    }
}

/* gt = 2 dg/dw by dc_k/dw = (k c_{k+2} - c_{k+1})/2 */
void lg_se3_dexp(const double a[6], const double b[6], double out[6]) {
    double c[6];
    lg_stumpff(lg_dot3(a, a), 5, 0, c);
    se3_function(c[2], 2.0 * c[4] - c[3], c[3], 3.0 * c[5] - c[4], a, b, out);
}

void lg_se3_dexpinv(const double a[6], const double b[6], double out[6]) {
    const double w = lg_dot3(a, a);
    se3_function(-0.5, 0.0, lg_dexpinv_coef(w, 0), 2.0 * lg_dexpinv_coef(w, 1), a, b, out);
}

/* A second implementation of a body that turns about a fixed point, in the axes of the body. */
#ifndef BODY_CHECK_H
#define BODY_CHECK_H

#include "mechanics/system_check.h"

/* Parameters of a top; mass 0: a free body. */
typedef struct top {
    double inertia[3], mass, length, chi[3], gamma0[3];
} top;

/* y = (Q, Pi): Q' = Q hat(Omega), Pi' = Pi x Omega + M l (Q^T Gamma0) x chi, Omega = I^-1 Pi. */
static inline void body_equations(const top *of, const double *y, double *out) {
    double omega[3], gamma[3], a[3], b[3];
    for (int i = 0; i < 3; i++) {
        omega[i] = y[9 + i] / of->inertia[i];
        gamma[i] = y[i] * of->gamma0[0] + y[3 + i] * of->gamma0[1] + y[6 + i] * of->gamma0[2];
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            const int d = (c + 1) % 3, e = (c + 2) % 3;
            out[3 * r + c] = y[3 * r + d] * omega[e] - y[3 * r + e] * omega[d];
        }
    lg_cross3(y + 9, omega, a);
    lg_cross3(gamma, of->chi, b);
    for (int i = 0; i < 3; i++) out[9 + i] = a[i] + of->mass * of->length * b[i];
}

static inline void rk4_in_the_body(const top *of, double h, int steps, double *y) {
    static const double c[4] = {0.0, 0.5, 0.5, 1.0};
    double k[4][12], z[12];
    for (int s = 0; s < steps; s++) {
        for (int i = 0; i < 4; i++) {
            for (int j = 0; j < 12; j++) z[j] = y[j] + (i > 0 ? c[i] * h * k[i - 1][j] : 0.0);
            body_equations(of, z, k[i]);
        }
        for (int j = 0; j < 12; j++) y[j] += h / 6.0 * (k[0][j] + 2.0 * (k[1][j] + k[2][j]) + k[3][j]);
    }
}

#endif

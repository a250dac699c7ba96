/* The planar double pendulum (unit masses and lengths), written by hand: the field with its adjoint, and a
 * step of the classical Runge-Kutta scheme with its adjoint.
 *
 * y = (theta_1, theta_2, omega_1, omega_2), s, c = sin, cos(theta_1 - theta_2), D = 1/(2 - c^2):
 * r_1 = -omega_2^2 s - 2 g sin theta_1, r_2 = omega_1^2 s - g sin theta_2,
 * omega_1' = D (r_1 - c r_2), omega_2' = D (2 r_2 - c r_1). */
#ifndef LG_BENCH_PENDULUM_H
#define LG_BENCH_PENDULUM_H

#include <math.h>

enum { STAGES = 4 };
static const double gravity = 9.81, step = 0.01;
static const double offset[STAGES] = {0, 0.5, 0.5, 1}, weight[STAGES] = {1, 2, 2, 1};

/* Values of a stage that the adjoint needs again, so that no sine is computed twice. */
typedef struct pendulum_stage {
    double s1, c1, s2, c2, s, c, d, r1, r2, w1, w2;
} pendulum_stage;

static inline void pendulum_field(const double *y, double *f, pendulum_stage *m) {
    m->s1 = sin(y[0]);
    m->c1 = cos(y[0]);
    m->s2 = sin(y[1]);
    m->c2 = cos(y[1]);
    m->w1 = y[2];
    m->w2 = y[3];
    m->s = m->s1 * m->c2 - m->c1 * m->s2;
    m->c = m->c1 * m->c2 + m->s1 * m->s2;
    m->d = 1 / (2 - m->c * m->c);
    m->r1 = -m->w2 * m->w2 * m->s - 2 * gravity * m->s1;
    m->r2 = m->w1 * m->w1 * m->s - gravity * m->s2;
    f[0] = m->w1;
    f[1] = m->w2;
    f[2] = m->d * (m->r1 - m->c * m->r2);
    f[3] = m->d * (2 * m->r2 - m->c * m->r1);
}

/* Computes y = (df/dy)^T g. */
static inline void pendulum_field_adjoint(const pendulum_stage *m, const double *g, double *y) {
    const double f1 = m->d * (m->r1 - m->c * m->r2), f2 = m->d * (2 * m->r2 - m->c * m->r1);
    const double r1 = m->d * (g[2] - m->c * g[3]), r2 = m->d * (2 * g[3] - m->c * g[2]);
    const double c = m->d * (2 * m->c * (g[2] * f1 + g[3] * f2) - g[2] * m->r2 - g[3] * m->r1);
    const double s = m->w1 * m->w1 * r2 - m->w2 * m->w2 * r1;
    const double difference = m->c * s - m->s * c;
    y[0] = difference - 2 * gravity * m->c1 * r1;
    y[1] = -difference - gravity * m->c2 * r2;
    y[2] = g[0] + 2 * m->w1 * m->s * r2;
    y[3] = g[1] - 2 * m->w2 * m->s * r1;
}

/* Advances y by one step, and stores the values of its stages. */
static inline void pendulum_step(double *y, pendulum_stage *stage) {
    double k[4] = {0, 0, 0, 0}, sum[4] = {0, 0, 0, 0}, at[4];
    for (int i = 0; i < STAGES; i++) {
        for (int j = 0; j < 4; j++) at[j] = y[j] + step * offset[i] * k[j];
        pendulum_field(at, k, &stage[i]);
        for (int j = 0; j < 4; j++) sum[j] += weight[i] * k[j];
    }
    for (int j = 0; j < 4; j++) y[j] += step / 6 * sum[j];
}

/* Stages in reverse order: the adjoint of k_i is kbar_i = h b_i lambda + h a_{i+1,i} mu_{i+1}, and mu_i =
 * (df/dy)^T kbar_i. At the end, lambda += sum of all mu_i. */
static inline void pendulum_step_adjoint(const pendulum_stage *stage, double *lambda) {
    double sum[4] = {0, 0, 0, 0}, mu[4] = {0, 0, 0, 0}, kbar[4];
    for (int i = STAGES - 1; i >= 0; i--) {
        const double next = i + 1 < STAGES ? offset[i + 1] : 0;
        for (int j = 0; j < 4; j++) kbar[j] = step * (weight[i] / 6 * lambda[j] + next * mu[j]);
        pendulum_field_adjoint(&stage[i], kbar, mu);
        for (int j = 0; j < 4; j++) sum[j] += mu[j];
    }
    for (int j = 0; j < 4; j++) lambda[j] += sum[j];
}

#endif

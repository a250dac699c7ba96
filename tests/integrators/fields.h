/* Small vector fields for the tests of integrators, in long double with wrappers in double. */
#ifndef LG_TEST_FIELDS_H
#define LG_TEST_FIELDS_H

#include "test_support.h"

#include "liegrad/integrators.h"

typedef long double real;

static inline real dot_l(const real *a, const real *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross_l(const real *a, const real *b, real *out) {
    const real x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x, out[1] = y, out[2] = z;
}

/* Two linked pendulums in space, y = (q1, omega1, q2, omega2), under gravity g(t) = 9.81 (1 + swing sin 3t).
 * A 2 x 2 system determines the tensions; f = (omega, q (q.q'') - q''). */
#define CHAIN_DIM 12

static inline void chain_l(real t, real swing, const real *y, real *f) {
    const real m[2] = {1.0L, 1.3L}, L[2] = {1.0L, 0.8L}, g = 9.81L * (1.0L + swing * sinl(3.0L * t));
    const real *q[2] = {y, y + 6}, *w[2] = {y + 3, y + 9};
    const real d0 = 1.0L / m[0], d1 = 1.0L / m[1] + 1.0L / m[0], e = -dot_l(q[0], q[1]) / m[0];
    const real b0 = L[0] * dot_l(w[0], w[0]) - g * q[0][2], b1 = L[1] * dot_l(w[1], w[1]);
    const real det = d0 * d1 - e * e;
    const real lambda[3] = {(b0 * d1 - e * b1) / det, (d0 * b1 - e * b0) / det, 0.0L};
    real before[3] = {0.0L, 0.0L, 0.0L};
    for (int i = 0; i < 2; i++) {
        real a[3], accel[3];
        for (int j = 0; j < 3; j++) {
            const real next = i == 0 ? lambda[1] * q[1][j] : 0.0L;
            a[j] = (next - lambda[i] * q[i][j]) / m[i] - (j == 2 ? g : 0.0L);
            accel[j] = (a[j] - before[j]) / L[i];
        }
        const real along = dot_l(q[i], accel);
        for (int j = 0; j < 3; j++) {
            f[6 * i + j] = w[i][j];
            f[6 * i + 3 + j] = q[i][j] * along - accel[j];
            before[j] = a[j];
        }
    }
}

/* The ambient velocity of an element of se(3)^2. */
static inline void chain_velocity_l(const real *y, const real *f, real *out) {
    for (int i = 0; i < 2; i++) {
        const real *u = f + 6 * i, *v = u + 3, *q = y + 6 * i, *w = q + 3;
        real a[3], b[3], c[3];
        cross_l(u, q, a), cross_l(u, w, b), cross_l(v, q, c);
        for (int j = 0; j < 3; j++) out[6 * i + j] = a[j], out[6 * i + 3 + j] = b[j] + c[j];
    }
}

static inline void widen(size_t n, const double *x, real *out) {
    for (size_t i = 0; i < n; i++) out[i] = x[i];
}

static inline void narrow(size_t n, const real *x, double *out) {
    for (size_t i = 0; i < n; i++) out[i] = (double)x[i];
}

/* `user` points to a double, the swing. */
static inline lg_status chain_field(void *user, double t, const double *y, const double *input, double *out) {
    real x[CHAIN_DIM], f[CHAIN_DIM];
    widen(CHAIN_DIM, y, x);
    chain_l(t, *(const double *)user, x, f);
    narrow(CHAIN_DIM, f, out);
    return LG_OK;
}

static inline lg_status chain_ambient_field(void *user, double t, const double *y, const double *input,
                                            double *out) {
    real x[CHAIN_DIM], f[CHAIN_DIM], v[CHAIN_DIM];
    widen(CHAIN_DIM, y, x);
    chain_l(t, *(const double *)user, x, f);
    chain_velocity_l(x, f, v);
    narrow(CHAIN_DIM, v, out);
    return LG_OK;
}

/* The equation of the chain in the coordinates that the scheme needs. */
static inline lg_ode chain_ode(const lg_scheme *scheme, double *swing) {
    lg_ode ode = {.field = chain_field, .user = swing};
    assert_ok(lg_space_init(&ode.space, &(lg_space_factor){LG_SPACE_TS2, 2}, 1));
    if (!scheme->ambient) return ode;
    ode.manifold = ode.space;
    ode.field = chain_ambient_field;
    assert_ok(lg_space_init_rn(&ode.space, CHAIN_DIM));
    return ode;
}

/* A start that is not in a plane and not at rest, on the manifold up to rounding. */
static inline void chain_start(double y[CHAIN_DIM]) {
    static const double start[CHAIN_DIM] = {0.6, 0.0, -0.8, 0.4, 0.9, 0.3, 0.0, 0.8, 0.6, -0.7, 0.3, -0.4};
    memcpy(y, start, sizeof(start));
}

/* Free rigid body: mu' = -J^-1 mu x mu with J = (0.8, 1.3, 2.1). */
static inline lg_status rigid_field(void *user, double t, const double *y, const double *input, double *out) {
    out[0] = -y[0] / 0.8, out[1] = -y[1] / 1.3, out[2] = -y[2] / 2.1;
    return LG_OK;
}

static inline lg_status rigid_ambient_field(void *user, double t, const double *y, const double *input,
                                            double *out) {
    double f[3];
    (void)rigid_field(user, t, y, input, f);
    out[0] = f[1] * y[2] - f[2] * y[1];
    out[1] = f[2] * y[0] - f[0] * y[2];
    out[2] = f[0] * y[1] - f[1] * y[0];
    return LG_OK;
}

/* V = q1^4/4 + q2^4/4 + q1^2 q2^2/2 + q1^2/2, K = |p|^2/2; y = (q1, q2, p1, p2). */
static inline lg_status quartic_force(void *user, double t, const double *q, const double *input,
                                      double *out) {
    const double r = q[0] * q[0] + q[1] * q[1];
    out[0] = -q[0] * (r + 1.0), out[1] = -q[1] * r;
    return LG_OK;
}

static inline lg_status quartic_velocity(void *user, double t, const double *p, const double *input,
                                         double *out) {
    out[0] = p[0], out[1] = p[1];
    return LG_OK;
}

static inline lg_status quartic_field(void *user, double t, const double *y, const double *input,
                                      double *out) {
    (void)quartic_velocity(user, t, y + 2, input, out);
    return quartic_force(user, t, y, input, out + 2);
}

/* The symmetric heavy top of Celledoni and Safstrom (2006) on T*SO(3): y = (Q, pi), f = (Q J^-1 Q^T pi, tau -
 * omega x pi), tau = M l Gamma0 x Q e2. */
static inline void top_omega_l(const real *y, real *omega) {
    const real inertia[3] = {0.234375L, 0.46875L, 0.234375L};
    real body[3];
    for (int j = 0; j < 3; j++) body[j] = (y[j] * y[9] + y[3 + j] * y[10] + y[6 + j] * y[11]) / inertia[j];
    for (int i = 0; i < 3; i++) omega[i] = dot_l(y + 3 * i, body);
}

static inline void top_l(const real *y, real *f) {
    const real weight[3] = {0.0L, 0.0L, -9.81L * 15.0L * 2.0L}, axis[3] = {y[1], y[4], y[7]};
    real torque[3], turn[3];
    top_omega_l(y, f);
    cross_l(weight, axis, torque);
    cross_l(f, y + 9, turn);
    for (int i = 0; i < 3; i++) f[3 + i] = torque[i] - turn[i];
}

static inline lg_status top_field(void *user, double t, const double *y, const double *input, double *out) {
    real x[12], f[6];
    widen(12, y, x);
    top_l(x, f);
    narrow(6, f, out);
    return LG_OK;
}

/* `spin` is the angular velocity: large for a fast top, small where a short step must be a small rotation. */
static inline void top_start(double spin, double y[12]) {
    const double start[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.0, 0.46875 * spin, 0.234375 * -4.61538};
    memcpy(y, start, sizeof(start));
}

#endif

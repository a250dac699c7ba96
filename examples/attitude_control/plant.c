#include "plant.h"

#include <math.h>
#include <string.h>

const body true_body = {.J = {0.080, 0.010, -0.005, 0.010, 0.100, 0.008, -0.005, 0.008, 0.050},
                        .w = {0.30, -0.20, 1.20},
                        .k = 0.40,
                        .d = {0.050, 0.060, 0.030},
                        .c = {0.020, 0.010, 0.015}};

static void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void times(const double *M, const double *x, double *out) {
    for (int i = 0; i < 3; i++) out[i] = M[3 * i] * x[0] + M[3 * i + 1] * x[1] + M[3 * i + 2] * x[2];
}

bool invert3(const double *M, double *out) {
    double det = 0.0, adjugate[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            adjugate[3 * i + j] = M[3 * a + c] * M[3 * b + d] - M[3 * a + d] * M[3 * b + c];
        }
    for (int i = 0; i < 3; i++) det += M[i] * adjugate[3 * i];
    if (!(fabs(det) > 0.0) || !isfinite(1.0 / det)) return false;
    for (int i = 0; i < 9; i++) out[i] = adjugate[i] / det;
    return true;
}

/* The field as an element of the algebra of SO(3) x R^3: R Omega, then Omega'. */
static lg_status field(void *user, double t, const double *state, const double *torque, double *out) {
    const plant *self = user;
    const body *b = &true_body;
    const double *Omega = state + ATTITUDE, *up = state + 6;
    const double slope[3] = {b->w[0], b->w[1] + b->k * up[1], b->w[2]};
    double momentum[3], gyration[3], gravity[3], sum[3];
    (void)t;
    times(state, Omega, out);
    times(b->J, Omega, momentum);
    cross(momentum, Omega, gyration);
    cross(up, slope, gravity);
    for (int i = 0; i < 3; i++)
        sum[i] = gyration[i] + gravity[i] - (b->d[i] + b->c[i] * fabs(Omega[i])) * Omega[i] + torque[i];
    times(self->inverse, sum, out + 3);
    return LG_OK;
}

bool plant_create(plant *self) {
    const lg_space_factor factors[2] = {{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}};
    lg_ode ode = {.field = field, .user = self};
    memset(self, 0, sizeof *self);
    return invert3(true_body.J, self->inverse) && lg_space_init(&ode.space, factors, 2) == LG_OK &&
           lg_stepper_create(NULL, lg_scheme_find("rkmk4"), &ode, &self->stepper) == LG_OK;
}

void plant_destroy(plant *self) {
    lg_stepper_destroy(self->stepper);
}

bool plant_advance(plant *self, double period, const double *torque, double *state) {
    for (int i = 0; i < PLANT_STEPS; i++)
        if (lg_stepper_step(self->stepper, 0.0, period / PLANT_STEPS, state, torque, state) != LG_OK)
            return false;
    return isfinite(state[0] + state[ATTITUDE]);
}

/* R = I + sin(a)/a hat(v) + (1 - cos(a))/a^2 hat(v)^2, a = |v|. */
void plant_attitude(const double *v, double *R) {
    const double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], a = sqrt(square);
    const double s = a > 1e-8 ? sin(a) / a : 1.0, c = a > 1e-8 ? (1.0 - cos(a)) / square : 0.5;
    const double hat[9] = {0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            R[3 * i + j] = (i == j ? 1.0 - c * square : 0.0) + s * hat[3 * i + j] + c * v[i] * v[j];
}

/* The attitude is uniformly distributed: a quaternion of four normal numbers, normalised. */
void plant_start(lg_rng *rng, double rate, double *state) {
    double q[4], length = 0.0, vector[3];
    for (int i = 0; i < 4; i++) {
        q[i] = lg_rng_normal(rng);
        length += q[i] * q[i];
    }
    const double s = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), angle = 2.0 * atan2(s, q[0]);
    (void)length;
    for (int i = 0; i < 3; i++) vector[i] = s > 0.0 ? q[1 + i] * angle / s : 0.0;
    plant_attitude(vector, state);
    for (int i = 0; i < 3; i++) state[ATTITUDE + i] = rate * lg_rng_normal(rng);
}

#include "controller.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Weights of the energy and of the vertical angular momentum in the Lyapunov function. linear_range is the
 * size of its scaled gradient at which the torque reaches its bound. */
static const double energy_weight = 1.0, momentum_weight = 1.0, linear_range = 0.02;
/* Weights of angle and angular velocity relative to the torque, in the pendulum's units (m g L and
 * sqrt(g/L)). */
static const double angle_weight = 1.0, rate_weight = 0.2;
static const double least_cosine = 0.7; /* BALANCE requires that q.upright is larger */
static const double catch_fraction =
    0.8; /* BALANCE begins in this fraction of its region, and continues in the whole region */

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

double pendulum_angle(const double *state) {
    return atan2(hypot(state[0], state[1]), state[2]);
}

/* ---- set-up ---- */

size_t controller_work_size(const lg_model *model) {
    return lg_lqr_size(model);
}

/* Finds the equilibrium at rest that is nearest to e3. */
static bool find_upright(controller *self, void *work) {
    const double above[STATE] = {0.0, 0.0, 1.0, 0.0, 0.0, 0.0};
    memcpy(self->upright, above, sizeof above);
    return lg_model_equilibrium(self->model, NULL, self->upright, NULL, work) == LG_OK &&
           pendulum_angle(self->upright) < 0.5;
}

/* Largest eigenvalue of the symmetric positive matrix M (3, 3), by power iteration. The result is a lower
 * bound; it is exact to rounding if the two largest eigenvalues are equal or well separated. */
static double largest_eigenvalue(const double *M) {
    double x[3] = {0.6, 0.5, 0.4}, value = 0.0;
    for (int iteration = 0; iteration < 200; iteration++) {
        double y[3];
        for (int i = 0; i < 3; i++) y[i] = dot(M + 3 * i, x);
        value = sqrt(dot(y, y));
        for (int i = 0; i < 3; i++) x[i] = value > 0.0 ? y[i] / value : 0.0;
    }
    return value;
}

/* u = -K c minimises the integral of c^T Q c + |u|^2. Where |K c| exceeds torque_max, the torque is u = -s
 * K c with s < 1. c^T P c still decreases if s >= 1/2 (the regulator's gain margin; Anderson and Moore,
 * Optimal Control, 1990, ch. 5), that is, if |K c| <= 2 torque_max. The controller balances where c^T P c <
 * region. `region` is chosen so that |K c| <= 2 torque_max there: it is (2 torque_max)^2 divided by the
 * largest |K c|^2 on c^T P c = 1, which is the largest eigenvalue of K B = B^T P B. */
static bool design(controller *self, void *memory, lg_error *error) {
    double Q[TANGENT * TANGENT] = {0.0}, KB[TORQUE * TORQUE] = {0.0};
    const double R[TORQUE * TORQUE] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    lg_lqr_options options;
    for (int i = 0; i < 2; i++) {
        Q[i * TANGENT + i] = angle_weight * self->energy_scale * self->energy_scale;
        Q[(2 + i) * TANGENT + 2 + i] = rate_weight * self->energy_scale / self->mass;
    }
    lg_lqr_options_init(&options);
    options.state = self->upright, options.Q = Q, options.R = R;
    if (lg_lqr_init(self->model, &options, &self->lqr, memory, lg_lqr_size(self->model), error) != LG_OK)
        return false;
    for (int i = 0; i < TORQUE; i++)
        for (int j = 0; j < TORQUE; j++)
            for (int l = 0; l < TANGENT; l++)
                KB[i * TORQUE + j] += self->lqr.K[i * TANGENT + l] * self->lqr.B[l * TORQUE + j];
    const double bound = 2.0 * self->torque_max;
    self->region = bound * bound / largest_eigenvalue(KB);
    return isfinite(self->region);
}

static bool refuse(char *why, const char *sentence) {
    (void)snprintf(why, 256, "%.255s", sentence);
    return false;
}

bool controller_init(controller *self, const lg_model *model, void *work, double torque_max, char *why) {
    double down[STATE] = {0.0}, energy_down, A[TANGENT * TANGENT];
    lg_error error = {LG_OK, "the Riccati equation has no solution"};
    if (lg_model_inputs(model) != STATE || lg_model_tangent_dim(model) != TANGENT)
        return refuse(why, "the model is not the Hamiltonian of a spherical pendulum");
    *self = (controller){.model = model, .torque_max = torque_max};
    if (!find_upright(self, work)) return refuse(why, "the learned potential has no equilibrium near e3");
    for (int i = 0; i < 3; i++) down[i] = -self->upright[i];
    lg_model_eval(model, self->upright, &self->energy_up, work);
    lg_model_eval(model, down, &energy_down, work);
    if (lg_model_linearise(model, self->upright, NULL, A, NULL, NULL, work) != LG_OK)
        return refuse(why, "the model cannot be linearised");
    self->energy_scale = 0.5 * (self->energy_up - energy_down);
    self->mass = 1.0 / A[2]; /* the linearisation has a_1' = b_1 / m */
    if (!(self->energy_scale > 0.0 && self->mass > 0.0) || !isfinite(self->energy_scale + self->mass))
        return refuse(why, "the learned equilibrium near e3 is not above the one opposite");
    return design(self, work, &error) || refuse(why, error.message);
}

/* ---- a control step ---- */

static void scale_to(double *x, double factor) {
    for (int i = 0; i < 3; i++) x[i] *= factor;
}

/* Returns c^T P c for the deviation c from upright, or infinity if the pendulum is too far from upright. */
static double distance(const controller *self, const double *state, double *c) {
    double sum = 0.0;
    if (!(dot(state, self->upright) > least_cosine)) return INFINITY;
    if (lg_model_deviation(self->model, self->upright, state, c, self->lqr.work) != LG_OK) return INFINITY;
    for (int i = 0; i < TANGENT; i++)
        for (int j = 0; j < TANGENT; j++) sum += c[i] * self->lqr.P[i * TANGENT + j] * c[j];
    return sum;
}

/* W = kE (H - H_up)^2/2 + kL L^2/2 with L = e3.(q x p) has W' = torque.g with g = kE (H - H_up) omega + kL L
 * (e3 - q (q.e3)). The torque is along -g and saturated (Astrom and Furuta, Automatica 36, 2000, 287-295, for
 * motion in a plane; the term with L brings the motion into a plane). Everything is in units of the learned
 * pendulum. If the pendulum hangs at rest, g is 0, and a push starts the motion. */
static void swing_up(const controller *self, const double *state, double *torque) {
    double field[6], about[3], g[3];
    const double *q = state, *p = state + 3;
    if (lg_model_field(self->model, state, NULL, field, self->lqr.work) != LG_OK)
        return; /* field[0..2] is omega */
    cross(q, p, about);
    const double unit = sqrt(self->mass * self->energy_scale);
    const double energy = energy_weight * (self->energy - self->energy_up) / self->energy_scale;
    const double rate = self->mass / unit, momentum = momentum_weight * about[2] / unit;
    for (int i = 0; i < 3; i++)
        g[i] = energy * rate * field[i] + momentum * ((i == 2 ? 1.0 : 0.0) - q[i] * q[2]);
    const double size = sqrt(dot(g, g));
    if (size < 1e-3 && q[2] < -0.99) {
        torque[0] = self->torque_max;
        return;
    }
    memcpy(torque, g, sizeof g);
    scale_to(torque, -self->torque_max / fmax(size, linear_range));
}

void controller_step(controller *self, const double *state, double *torque) {
    double c[TANGENT];
    torque[0] = torque[1] = torque[2] = 0.0;
    lg_model_eval(self->model, state, &self->energy, self->lqr.work);
    const double far = distance(self, state, c);
    self->mode = far < self->region * (self->mode == BALANCE ? 1.0 : catch_fraction) ? BALANCE : SWING_UP;
    if (self->mode == BALANCE)
        (void)lg_lqr_control(&self->lqr, state, torque);
    else
        swing_up(self, state, torque);
    /* A torque beyond the bound, even by rounding, is scaled down in its own direction. A NaN must not reach
     * the motor. */
    const double size = sqrt(dot(torque, torque));
    if (!isfinite(size))
        torque[0] = torque[1] = torque[2] = 0.0;
    else if (size > self->torque_max)
        scale_to(torque, self->torque_max * (1.0 - 1e-15) / size);
}

/* Separable systems on R^4, y = (q_1, q_2, p_1, p_2): the quartic oscillators coupled through the kinetic
 * energy, and the two oscillators, one of them harmonic, of the experiment with noise and a first integral.
 */
#include "mechanics/system.h"

/* The field from its halves: y' = (dK/dp, -dV/dq). */
static lg_status from_halves(const lg_system_row *row, void *user, double t, const double *y,
                             const double *input, double *out) {
    LG_TRY(row->velocity(user, t, y + 2, input, out));
    return row->force(user, t, y, input, out + 2);
}

/* ---- H = 1/2 p^T [5 -1; -1 5] p + (q_1^4 + q_2^4)/4 + (q_1^2 + q_2^2)/2 ---- */

static double quartic_hamiltonian(const lg_system *system, const double *y, double *work) {
    const double a = y[0] * y[0], b = y[1] * y[1];
    (void)system, (void)work;
    return 0.5 * (5.0 * y[2] * y[2] - 2.0 * y[2] * y[3] + 5.0 * y[3] * y[3]) + 0.25 * (a * a + b * b) +
           0.5 * (a + b);
}

static lg_status quartic_force(void *user, double t, const double *q, const double *input, double *out) {
    (void)user, (void)t, (void)input;
    for (int i = 0; i < 2; i++) out[i] = -q[i] * (q[i] * q[i] + 1.0);
    return LG_OK;
}

static lg_status quartic_velocity(void *user, double t, const double *p, const double *input, double *out) {
    (void)user, (void)t, (void)input;
    out[0] = 5.0 * p[0] - p[1];
    out[1] = 5.0 * p[1] - p[0];
    return LG_OK;
}

static lg_status quartic_field(void *user, double t, const double *y, const double *input, double *out) {
    return from_halves(&lg_system_row_quartic, user, t, y, input, out);
}

static const char *const no_invariants[] = {NULL};

const lg_system_row lg_system_row_quartic = {
    .name = "quartic",
    .layout = "q p",
    .kind = LG_SPACE_RN,
    .copies = 4,
    .separable = true,
    .invariants = no_invariants,
    .hamiltonian = quartic_hamiltonian,
    .field = {quartic_field, quartic_field},
    .force = quartic_force,
    .velocity = quartic_velocity,
};

/* ---- H = (q_1^2 + p_1^2)/2 + p_2^2/2 + q_2^2/2 + q_2^4/4, G = (q_1^2 + p_1^2)/2 ---- */

static double coupled_invariant(const lg_system *system, size_t index, const double *y) {
    (void)system, (void)index;
    return 0.5 * (y[0] * y[0] + y[2] * y[2]);
}

static double coupled_hamiltonian(const lg_system *system, const double *y, double *work) {
    const double b = y[1] * y[1];
    (void)work;
    return coupled_invariant(system, 0, y) + 0.5 * (y[3] * y[3] + b) + 0.25 * b * b;
}

static lg_status coupled_force(void *user, double t, const double *q, const double *input, double *out) {
    (void)user, (void)t, (void)input;
    out[0] = -q[0];
    out[1] = -q[1] * (1.0 + q[1] * q[1]);
    return LG_OK;
}

static lg_status coupled_velocity(void *user, double t, const double *p, const double *input, double *out) {
    (void)user, (void)t, (void)input;
    out[0] = p[0];
    out[1] = p[1];
    return LG_OK;
}

static lg_status coupled_field(void *user, double t, const double *y, const double *input, double *out) {
    return from_halves(&lg_system_row_coupled, user, t, y, input, out);
}

static const char *const coupled_invariants[] = {"G", NULL};

const lg_system_row lg_system_row_coupled = {
    .name = "coupled-oscillators",
    .layout = "q p",
    .kind = LG_SPACE_RN,
    .copies = 4,
    .separable = true,
    .invariants = coupled_invariants,
    .hamiltonian = coupled_hamiltonian,
    .invariant = coupled_invariant,
    .field = {coupled_field, coupled_field},
    .force = coupled_force,
    .velocity = coupled_velocity,
};

/* The free rigid body: its body momentum on so(3)*, and its attitude on SO(3) for a given spatial momentum.
 *
 * Body momentum mu with principal moments of inertia I: Euler's equations mu' = mu x I^-1 mu. Under the
 * action exp(u) mu an algebra element u has the velocity u x mu, so f is -I^-1 mu plus any multiple of mu. f
 * is chosen orthogonal to mu: a component along mu has no effect on mu', but the commutators of the other
 * components would have to undo its rotation about mu, which costs three digits near a principal axis. The
 * orbits are the spheres |mu| = const, which every scheme on so(3)* preserves.
 *
 * Attitude: R' = hat(omega) R, omega = R I^-1 R^T pi, with the spatial momentum pi constant.
 */
#include "mechanics/system.h"

#include <float.h>

#include "liegrad/geometry.h"
#include "mechanics/engine.h"

static const double inertia_fallback[3] = {1.0, 2.0, 3.0};

static const lg_parameter_entry parameters[] = {
    {"inertia", "I", 3, LG_PARAMETER_POSITIVE, inertia_fallback, "principal moments of inertia, kg m^2"},
    {.key = NULL},
};

double lg_body_energy(const double *I, const double *x) {
    return 0.5 * (x[0] * x[0] / I[0] + x[1] * x[1] / I[1] + x[2] * x[2] / I[2]);
}

/* ---- body momentum ---- */

static const lg_state_entry momentum_state[] = {{"mu", 1, 1, 3, 0, 3, NULL}, {.key = NULL}};

static const char *const momentum_invariants[] = {"energy", "|mu|^2", NULL};

static double momentum_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    return index == 0 ? lg_body_energy(system->parameters, y) : lg_dot3(y, y);
}

LG_TAPED_FIELD(momentum) {
    const lg_var mu = y[0], velocity = lg_div(tape, mu, numbers);
    const lg_var square = lg_add_scalar(tape, lg_rowdot(tape, mu, mu), DBL_MIN);
    const lg_var along = lg_div(tape, lg_rowdot(tape, mu, velocity), square);
    algebra[0] = lg_sub(tape, lg_mul(tape, along, mu), velocity);
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_rigid_body = {
    .name = "rigid-body",
    .parameters = parameters,
    .state = momentum_state,
    .factor = {{LG_SPACE_SO3_DUAL, 1}},
    .invariants = momentum_invariants,
    .invariant = momentum_invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    LG_RECORDED(momentum),
};

/* ---- attitude ---- */

static const lg_state_entry attitude_state[] = {
    {"R", 1, 3, 3, 0, 9, lg_row_attitude},
    {"pi", 1, 1, 3, 9, 3, NULL},
    {.key = NULL},
};

static const char *const attitude_invariants[] = {"energy", "|R^T pi|^2", NULL};

static double attitude_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    double body[3];
    lg_so3_coadjoint(y, y + 9, body);
    return index == 0 ? lg_body_energy(system->parameters, body) : lg_dot3(body, body);
}

LG_TAPED_FIELD(attitude) {
    algebra[0] = lg_body_velocity(tape, numbers, lg_row_matrices(tape, y[0]), y[1]);
    algebra[1] = lg_full(tape, lg_var_shape(tape, y[1]), 0.0);
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_attitude = {
    .name = "rigid-body-attitude",
    .parameters = parameters,
    .state = attitude_state,
    .factor = {{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}},
    .invariants = attitude_invariants,
    .invariant = attitude_invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    LG_RECORDED(attitude),
};

/* ---- the row: M = diag(I) ---- */

const lg_energy_row lg_energy_attitude = {"rigid-body-attitude",    parameters, lg_row_diagonal, NULL, 1,
                                          {LG_COORDINATE_ROTATION}, .seen = 0};

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

#include "mechanics/engine.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/plain.inc"

#include "mechanics/fields/rotations.inc"

static const double inertia_fallback[3] = {1.0, 2.0, 3.0};

static const lg_parameter_entry parameters[] = {
    {"inertia", "I", 3, LG_PARAMETER_POSITIVE, inertia_fallback, "principal moments of inertia, kg m^2"},
    {.key = NULL},
};

/* ---- body momentum ---- */

static const lg_state_entry momentum_state[] = {{"mu", 1, 1, 3, 0, 3, NULL}, {.key = NULL}};

static const char *const momentum_invariants[] = {"energy", "|mu|^2", NULL};

static double momentum_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const field_at f = {.parameter = system->parameters, .y = y};
    return index == 0 ? body_energy(&f, v_state(&f, 0)) : v_dot(&f, v_state(&f, 0), v_state(&f, 0));
}

LG_PLAIN_FIELD(momentum)

const lg_system_row lg_system_row_rigid_body = {
    .name = "rigid-body",
    .parameters = parameters,
    .state = momentum_state,
    .factor = {{LG_SPACE_SO3_DUAL, 1}},
    .invariants = momentum_invariants,
    .invariant = momentum_invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    LG_FIELDS(momentum),
};

/* ---- attitude ---- */

static const lg_state_entry attitude_state[] = {
    {"R", 1, 3, 3, ATTITUDE, 9, lg_row_attitude},
    {"pi", 1, 1, 3, MOMENTUM, 3, NULL},
    {.key = NULL},
};

static const char *const attitude_invariants[] = {"energy", "|R^T pi|^2", NULL};

static double attitude_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const field_at f = {.parameter = system->parameters, .y = y};
    const vector body = v_turned_back(&f, matrix_state(&f, ATTITUDE), v_state(&f, MOMENTUM));
    return index == 0 ? body_energy(&f, body) : v_dot(&f, body, body);
}

LG_PLAIN_FIELD(attitude)

const lg_system_row lg_system_row_attitude = {
    .name = "rigid-body-attitude",
    .parameters = parameters,
    .state = attitude_state,
    .factor = {{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}},
    .invariants = attitude_invariants,
    .invariant = attitude_invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    LG_FIELDS(attitude),
};

/* ---- the row: M = diag(I) ---- */

const lg_energy_row lg_energy_attitude = {"rigid-body-attitude",    parameters, lg_row_diagonal, NULL, 1,
                                          {LG_COORDINATE_ROTATION}, .seen = 0};

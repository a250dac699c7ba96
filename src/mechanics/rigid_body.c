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
#include "mechanics/rotation.h"
#include "mechanics/system.h"

#include <float.h>

#include "liegrad/geometry.h"
#include "liegrad/ops.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/vectors.inc"

#include "mechanics/fields/rotations.inc"

static const double inertia_fallback[3] = {1.0, 2.0, 3.0};
static const double identity[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};

static const lg_parameter_entry parameters[] = {
    {"inertia", "I", 3, LG_PARAMETER_POSITIVE, inertia_fallback, "principal moments of inertia, kg m^2"},
    {.key = NULL},
};

static const double *inertia_of(const void *user) {
    return ((const lg_system_user *)user)->system->parameters;
}

/* ---- body momentum ---- */

static const lg_state_entry momentum_state[] = {{"mu", 1, 1, 3, 0, 3, NULL}, {.key = NULL}};

static lg_status momentum_space(size_t links, lg_space *out) {
    return lg_space_init(out, &(lg_space_factor){LG_SPACE_SO3_DUAL, 1}, 1);
}

static const char *const momentum_invariants[] = {"energy", "|mu|^2", NULL};

static double momentum_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    return index == 0 ? lg_body_energy(system->parameters, y) : lg_dot3(y, y);
}

LG_PLAIN_FIELD(momentum_field, inertia_of(user), y, out)

static lg_status momentum_taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                lg_var input, lg_var parameter, lg_var *algebra) {
    const lg_var velocity = lg_div(tape, y[0], parameter);
    const lg_var size = lg_add_scalar(tape, lg_rownorm2(tape, y[0]), DBL_MIN);
    const lg_var along = lg_div(tape, lg_rowdot(tape, y[0], velocity), size);
    algebra[0] = lg_sub(tape, lg_mul(tape, along, y[0]), velocity);
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_rigid_body = {
    .name = "rigid-body",
    .parameters = parameters,
    .state = momentum_state,
    .space = momentum_space,
    .invariants = momentum_invariants,
    .invariant = momentum_invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    .field = {momentum_field, NULL},
    .lanes = LG_LANES_RIGID_BODY,
    .taped = momentum_taped,
};

/* ---- attitude ---- */

enum { ATTITUDE = 0, SPATIAL_MOMENTUM = 9 }; /* offsets in the state */

static const lg_state_entry attitude_state[] = {
    {"R", 1, 3, 3, ATTITUDE, 9, identity},
    {"pi", 1, 1, 3, SPATIAL_MOMENTUM, 3, NULL},
    {.key = NULL},
};

static lg_status attitude_space(size_t links, lg_space *out) {
    return lg_space_init(out, (const lg_space_factor[]){{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}}, 2);
}

static const char *const attitude_invariants[] = {"energy", "|R^T pi|^2", NULL};

static double attitude_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    double body[3];
    lg_so3_coadjoint(y + ATTITUDE, y + SPATIAL_MOMENTUM, body);
    return index == 0 ? lg_body_energy(system->parameters, body) : lg_dot3(body, body);
}

LG_PLAIN_FIELD(attitude_field, inertia_of(user), y, out)

/* Parts of y: R (B, 1, 9), pi (B, 3). */
static lg_status attitude_taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                lg_var input, lg_var parameter, lg_var *algebra) {
    const lg_shape shape = lg_var_shape(tape, y[1]);
    lg_var pi = lg_reshape(tape, y[1], lg_shape3(shape.dims[0], 1, 3));
    algebra[0] = lg_taped_body_velocity(tape, parameter, y[0], pi);
    algebra[1] = lg_full(tape, shape, 0.0);
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_attitude = {
    .name = "rigid-body-attitude",
    .parameters = parameters,
    .state = attitude_state,
    .space = attitude_space,
    .invariants = attitude_invariants,
    .invariant = attitude_invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    .field = {attitude_field, NULL},
    .lanes = LG_LANES_ATTITUDE,
    .taped = attitude_taped,
};

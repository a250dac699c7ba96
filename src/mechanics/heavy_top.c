/* The heavy top, a rigid body with a fixed point, in four forms.
 *
 * Q maps body to inertial coordinates. I are the principal moments of inertia about the fixed point. In the
 * body frame the centre of mass is at l chi from the fixed point, chi a unit vector. M is the mass. Gamma0 is
 * the gradient of the potential energy per unit mass in the inertial frame, so the potential energy is
 * M l Gamma0.Q chi. With the spatial momentum pi,
 *
 *   Q' = hat(omega) Q, omega = Q I^-1 Q^T pi, pi' = tau = M l Gamma0 x Q chi;
 *
 * with the body momentum Pi = Q^T pi and Gamma = Q^T Gamma0,
 *
 *   Pi' = Pi x I^-1 Pi + M l Gamma x chi, Gamma' = Gamma x I^-1 Pi.
 *
 * - cotangent: right-trivialised T*SO(3) as SE(3), f = (dH/dpi, -R_Q^* dH/dQ) = (omega, tau - omega x pi).
 *   Under an algebra element (u, n) pi moves at n + u x pi = n - ad_u^* pi, so this f is also the one that
 *   the symplectic Lie group integrators (slgi) need.
 * - direct: the direct product SO(3) x R^3, f = (omega, tau).
 * - lie-poisson: (Gamma, Pi) in se(3)* under (R Gamma, R Pi + r x R Gamma), f = -(dH/dPi, dH/dGamma)
 *   = -(I^-1 Pi, M l chi).
 * - quadratic: q in R^3 with a constant momentum p = -M l chi makes the Hamiltonian quadratic,
 *     H = 1/2 Pi.I^-1 Pi + 1/2 |p - Gamma|^2 - 1/2 |Gamma|^2:
 *     pi' = -Gamma0 x Q p, q' = p - Q^T Gamma0, p' = 0.
 *   The state holds p + M l chi in place of p; for the top it is zero. Shifting p by a constant is
 *   symplectic. It makes the start independent of the parameters, so that derivatives in M, l, chi are right.
 *
 * Celledoni, Cokaj, Leone, Murari, Owren: Lie group integrators for mechanical systems (2022).
 */
#include "mechanics/rotation.h"
#include "mechanics/system.h"

#include <float.h>

#include "liegrad/geometry.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/vectors.inc"

#include "mechanics/fields/rotations.inc"

static const double inertia_fallback[3] = {0.234375, 0.46875, 0.234375}, mass_fallback = 15.0,
                    length_fallback = 2.0, chi_fallback[3] = {0.0, 1.0, 0.0},
                    gamma0_fallback[3] = {0.0, 0.0, -9.81};

static const lg_parameter_entry parameters[] = {
    {"inertia", "I", 3, LG_PARAMETER_POSITIVE, inertia_fallback,
     "principal moments of inertia about the fixed point, kg m^2"},
    {"mass", "m", 1, LG_PARAMETER_POSITIVE, &mass_fallback, "mass, kg"},
    {"length", "L", 1, LG_PARAMETER_POSITIVE, &length_fallback,
     "distance of the centre of mass from the fixed point, m"},
    {"chi", "chi", 3, LG_PARAMETER_UNIT_VECTOR, chi_fallback,
     "direction from the fixed point to the centre of mass, in the body"},
    {"gamma0", "gamma0_", 3, LG_PARAMETER_FINITE, gamma0_fallback,
     "gradient of the potential energy of unit mass in the inertial frame, m/s^2"},
    {.key = NULL},
};

static const double *parameters_of(const void *user) {
    return ((const lg_system_user *)user)->system->parameters;
}

/* ---- (Q, pi): the state of cotangent and direct, and the first part of the state of quadratic ---- */

enum { ATTITUDE = 0 }; /* offset of Q in the state; the other offsets are in fields/rotations.inc */

static const double identity[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};

static const lg_state_entry spatial_state[] = {
    {"Q", 1, 3, 3, ATTITUDE, 9, identity},
    {"pi", 1, 1, 3, MOMENTUM, 3, NULL},
    {.key = NULL},
};

static const char *const spatial_invariants[] = {"energy", "pi.Gamma0", NULL};

static double spatial_energy(const double *parameter, const double *y, const double arm[3]) {
    double body[3], gamma[3];
    lg_so3_coadjoint(y + ATTITUDE, y + MOMENTUM, body);
    lg_so3_coadjoint(y + ATTITUDE, parameter + GAMMA0, gamma);
    return lg_body_energy(parameter + INERTIA, body) + lg_dot3(gamma, arm);
}

static double spatial_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const double *parameter = system->parameters;
    double arm[3];
    if (index > 0) return lg_dot3(y + MOMENTUM, parameter + GAMMA0);
    weight_arm_of(parameter, arm);
    return spatial_energy(parameter, y, arm);
}

LG_PLAIN_FIELD(direct_field, parameters_of(user), y, out)
LG_PLAIN_FIELD(cotangent_field, parameters_of(user), y, out)

/* ---- on a tape ---- */

typedef struct taped_parameters {
    lg_var inertia, arm, gamma0; /* arm = M l chi; shape (3) each */
} taped_parameters;

static taped_parameters slice_parameters(lg_tape *tape, lg_var parameter) {
    lg_var scale =
        lg_mul(tape, lg_slice(tape, parameter, 0, MASS, 1), lg_slice(tape, parameter, 0, LENGTH, 1));
    return (taped_parameters){.inertia = lg_slice(tape, parameter, 0, INERTIA, 3),
                              .arm = lg_mul(tape, scale, lg_slice(tape, parameter, 0, CHI, 3)),
                              .gamma0 = lg_slice(tape, parameter, 0, GAMMA0, 3)};
}

/* Gamma0 x Q arm; Q is (B, 1, 9), arm and the result are (B, 1, 3). */
static lg_var taped_torque(lg_tape *tape, const taped_parameters *of, lg_var Q, lg_var arm) {
    return lg_cross(tape, lg_taped_spread(tape, of->gamma0, arm), lg_taped_rotate(tape, Q, arm));
}

/* Parts of y: Q (B, 1, 9), pi (B, 3). */
static lg_status direct_taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                              lg_var input, lg_var parameter, lg_var *algebra) {
    const taped_parameters of = slice_parameters(tape, parameter);
    const lg_shape shape = lg_var_shape(tape, y[1]);
    lg_var pi = lg_reshape(tape, y[1], lg_shape3(shape.dims[0], 1, 3));
    algebra[0] = lg_taped_body_velocity(tape, of.inertia, y[0], pi);
    algebra[1] = lg_reshape(tape, taped_torque(tape, &of, y[0], lg_taped_spread(tape, of.arm, pi)), shape);
    return lg_tape_status(tape);
}

/* algebra = (omega, tau - omega x pi) with the torque tau = Gamma0 x Q arm */
static void taped_cotangent(lg_tape *tape, const taped_parameters *of, const lg_var *y, lg_var arm,
                            lg_var *algebra) {
    algebra[0] = lg_taped_body_velocity(tape, of->inertia, y[0], y[1]);
    algebra[1] = lg_sub(tape, taped_torque(tape, of, y[0], arm), lg_cross(tape, algebra[0], y[1]));
}

/* Parts of y: Q (B, 1, 9), pi (B, 1, 3). */
static lg_status cotangent_taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                 lg_var input, lg_var parameter, lg_var *algebra) {
    const taped_parameters of = slice_parameters(tape, parameter);
    taped_cotangent(tape, &of, y, lg_taped_spread(tape, of.arm, y[1]), algebra);
    return lg_tape_status(tape);
}

/* ---- cotangent, direct ---- */

static lg_status cotangent_space(size_t links, lg_space *out) {
    return lg_space_init(out, &(lg_space_factor){LG_SPACE_SE3, 1}, 1);
}

static lg_status direct_space(size_t links, lg_space *out) {
    return lg_space_init(out, (const lg_space_factor[]){{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}}, 2);
}

#define TOP     .name = "heavy-top", .parameters = parameters, .structure = LG_STRUCTURE_HAMILTONIAN
#define SPATIAL TOP, .state = spatial_state, .invariants = spatial_invariants
const lg_system_row lg_system_row_top_cotangent = {
    .form = "cotangent",
    .space = cotangent_space,
    .invariant = spatial_invariant,
    .field = {cotangent_field, NULL},
    .lanes = LG_LANES_TOP_COTANGENT,
    .taped = cotangent_taped,
    SPATIAL,
};

const lg_system_row lg_system_row_top_direct = {
    .form = "direct",
    .space = direct_space,
    .invariant = spatial_invariant,
    .field = {direct_field, NULL},
    .lanes = LG_LANES_TOP_DIRECT,
    .taped = direct_taped,
    SPATIAL,
};

/* ---- lie-poisson ---- */

enum { GAMMA = 0 }; /* offset in the state */

static const lg_state_entry poisson_state[] = {
    {"Gamma", 1, 1, 3, GAMMA, 3, NULL},
    {"Pi", 1, 1, 3, BODY_MOMENTUM, 3, NULL},
    {.key = NULL},
};

static lg_status poisson_space(size_t links, lg_space *out) {
    return lg_space_init(out, &(lg_space_factor){LG_SPACE_SE3_DUAL, 1}, 1);
}

static const char *const poisson_invariants[] = {"energy", "|Gamma|^2", "Gamma.Pi", NULL};

static double poisson_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const double *parameter = system->parameters;
    double arm[3];
    if (index > 0) return lg_dot3(y + GAMMA, y + (index == 1 ? GAMMA : BODY_MOMENTUM));
    weight_arm_of(parameter, arm);
    return lg_body_energy(parameter + INERTIA, y + BODY_MOMENTUM) + lg_dot3(y + GAMMA, arm);
}

LG_PLAIN_FIELD(poisson_field, parameters_of(user), y, out)

/* Parts of y: Gamma and Pi, (B, 1, 3) each. */
static lg_status poisson_taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                               lg_var input, lg_var parameter, lg_var *algebra) {
    const taped_parameters of = slice_parameters(tape, parameter);
    algebra[0] = lg_neg(tape, lg_div(tape, y[1], of.inertia));
    algebra[1] = lg_taped_spread(tape, lg_neg(tape, of.arm), y[1]);
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_top_lie_poisson = {
    .form = "lie-poisson",
    .state = poisson_state,
    .space = poisson_space,
    .invariants = poisson_invariants,
    .invariant = poisson_invariant,
    .field = {poisson_field, NULL},
    .lanes = LG_LANES_TOP_LIE_POISSON,
    .taped = poisson_taped,
    TOP,
};

/* ---- quadratic: Q, pi, q, p + M l chi ---- */

static lg_status quadratic_space(size_t links, lg_space *out) {
    return lg_space_init(out, (const lg_space_factor[]){{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 6}}, 2);
}

/* The invariant "energy" is H - |p|^2/2, which is the energy of the other forms. */
static double quadratic_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const double *parameter = system->parameters;
    double arm[3];
    if (index > 0) return lg_dot3(y + MOMENTUM, parameter + GAMMA0);
    quadratic_arm_of(parameter, y, arm);
    return spatial_energy(parameter, y, arm);
}

/* H, the energy plus the constant |p|^2/2. */
static double quadratic_generating(const lg_system *system, const double *y, double *work) {
    double arm[3];
    quadratic_arm_of(system->parameters, y, arm);
    return quadratic_invariant(system, 0, y, work) + 0.5 * lg_dot3(arm, arm);
}

LG_PLAIN_FIELD(quadratic_field, parameters_of(user), y, out)

/* Parts of y: Q (B, 1, 9), pi (B, 1, 3), (q, p + M l chi) (B, 6). */
static lg_status quadratic_taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                 lg_var input, lg_var parameter, lg_var *algebra) {
    const taped_parameters of = slice_parameters(tape, parameter);
    const uint32_t batch = lg_var_shape(tape, y[1]).dims[0];
    lg_var shift = lg_reshape(tape, lg_slice(tape, y[2], 1, 3, 3), lg_shape3(batch, 1, 3));
    lg_var arm = lg_sub(tape, of.arm, shift);
    taped_cotangent(tape, &of, y, arm, algebra);
    lg_var gamma = lg_taped_rotate_back(tape, y[0], lg_taped_spread(tape, of.gamma0, y[1]));
    lg_var velocity = lg_neg(tape, lg_add(tape, arm, gamma));
    algebra[2] = lg_pad(tape, lg_reshape(tape, velocity, lg_shape2(batch, 3)), 1, 0, 3);
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_top_quadratic = {
    .form = "quadratic",
    .unreported = 6,
    .space = quadratic_space,
    .invariant = quadratic_invariant,
    .generating = quadratic_generating,
    .field = {quadratic_field, NULL},
    .lanes = LG_LANES_TOP_QUADRATIC,
    .taped = quadratic_taped,
    SPATIAL,
};

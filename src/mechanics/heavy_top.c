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
#include "mechanics/system.h"

#include "liegrad/geometry.h"
#include "mechanics/engine.h"

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

/* Offsets in the parameters. */
enum { INERTIA = 0, MASS = 3, LENGTH = 4, CHI = 5, GAMMA0 = 8 };
/* Offsets in the states: Q, pi and p in (Q, pi, q, p), Gamma and Pi. */
enum { ATTITUDE = 0, MOMENTUM = 9, SHIFT = 15, GAMMA = 0, BODY_MOMENTUM = 3 };

/* M l chi - shift; NULL: M l chi. */
static void arm_of(const double *p, const double *shift, double *arm) {
    for (int c = 0; c < 3; c++) arm[c] = p[MASS] * p[LENGTH] * p[CHI + c] - (shift != NULL ? shift[c] : 0.0);
}

/* The same on a tape, (3), or (B, 1, 3) with a shift. */
static lg_var taped_arm(lg_tape *tape, lg_var numbers, lg_var shift) {
    const lg_var scale =
        lg_mul(tape, lg_slice(tape, numbers, 0, MASS, 1), lg_slice(tape, numbers, 0, LENGTH, 1));
    const lg_var arm = lg_mul(tape, scale, lg_slice(tape, numbers, 0, CHI, 3));
    return lg_is_none(shift) ? arm : lg_sub(tape, arm, shift);
}

/* ---- (Q, pi): the state of cotangent and direct, and the first part of the state of quadratic ---- */

static const lg_state_entry spatial_state[] = {
    {"Q", 1, 3, 3, ATTITUDE, 9, lg_row_attitude},
    {"pi", 1, 1, 3, MOMENTUM, 3, NULL},
    {.key = NULL},
};

static const char *const spatial_invariants[] = {"energy", "pi.Gamma0", NULL};

static double spatial_energy(const double *p, const double *y, const double *arm) {
    double gamma[3], momentum[3];
    lg_so3_coadjoint(y + ATTITUDE, p + GAMMA0, gamma);
    lg_so3_coadjoint(y + ATTITUDE, y + MOMENTUM, momentum);
    return lg_body_energy(p + INERTIA, momentum) + lg_dot3(gamma, arm);
}

static double spatial_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    double arm[3];
    if (index > 0) return lg_dot3(y + MOMENTUM, system->parameters + GAMMA0);
    arm_of(system->parameters, NULL, arm);
    return spatial_energy(system->parameters, y, arm);
}

/* omega and tau, or tau - omega x pi for the cotangent bundle, with the torque tau = Gamma0 x Q arm. */
LG_TAPED_FIELD(top) {
    const bool cotangent = system->space.factor[0].kind == LG_SPACE_SE3,
               quadratic = cotangent && system->space.factors > 1;
    const lg_shape line = lg_shape3(lg_rows_of(tape, y[0]), 1, 3);
    const lg_var Q = lg_row_matrices(tape, y[0]), pi = lg_reshape(tape, y[1], line),
                 omega = lg_body_velocity(tape, lg_slice(tape, numbers, 0, INERTIA, 3), Q, pi);
    const lg_var shift = quadratic ? lg_reshape(tape, lg_slice(tape, y[2], 1, 3, 3), line) : LG_NONE;
    const lg_var gamma0 = lg_broadcast_to(tape, lg_slice(tape, numbers, 0, GAMMA0, 3), line),
                 arm = lg_broadcast_to(tape, taped_arm(tape, numbers, shift), line);
    lg_var f = lg_cross(tape, gamma0, lg_matmul_nt(tape, arm, Q));
    if (cotangent) f = lg_sub(tape, f, lg_cross(tape, omega, pi));
    algebra[0] = omega;
    algebra[1] = lg_reshape(tape, f, lg_var_shape(tape, y[1]));
    if (!quadratic) return lg_tape_status(tape);
    const lg_var q = lg_neg(tape, lg_add(tape, arm, lg_matmul(tape, gamma0, Q))), /* q' and p' */
        change[2] = {q, lg_full(tape, line, 0.0)};
    algebra[2] = lg_reshape(tape, lg_concat(tape, change, 2, 2), lg_var_shape(tape, y[2]));
    return lg_tape_status(tape);
}

/* ---- cotangent, direct ---- */

#define TOP     .name = "heavy-top", .parameters = parameters, .structure = LG_STRUCTURE_HAMILTONIAN
#define SPATIAL TOP, .state = spatial_state, .invariants = spatial_invariants
const lg_system_row lg_system_row_top_cotangent = {
    .form = "cotangent",
    .factor = {{LG_SPACE_SE3, 1}},
    .invariant = spatial_invariant,
    LG_RECORDED(top),
    SPATIAL,
};

const lg_system_row lg_system_row_top_direct = {
    .form = "direct",
    .factor = {{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}},
    .invariant = spatial_invariant,
    LG_RECORDED(top),
    SPATIAL,
};

/* ---- lie-poisson ---- */

static const lg_state_entry poisson_state[] = {
    {"Gamma", 1, 1, 3, GAMMA, 3, NULL},
    {"Pi", 1, 1, 3, BODY_MOMENTUM, 3, NULL},
    {.key = NULL},
};

static const char *const poisson_invariants[] = {"energy", "|Gamma|^2", "Gamma.Pi", NULL};

static double poisson_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const double *gamma = y + GAMMA, *momentum = y + BODY_MOMENTUM;
    double arm[3];
    if (index > 0) return lg_dot3(gamma, index == 1 ? gamma : momentum);
    arm_of(system->parameters, NULL, arm);
    return lg_body_energy(system->parameters + INERTIA, momentum) + lg_dot3(gamma, arm);
}

LG_TAPED_FIELD(poisson) {
    const lg_var force = lg_neg(tape, taped_arm(tape, numbers, LG_NONE));
    algebra[0] = lg_neg(tape, lg_div(tape, y[1], lg_slice(tape, numbers, 0, INERTIA, 3)));
    algebra[1] = lg_broadcast_to(tape, force, lg_var_shape(tape, y[1]));
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_top_lie_poisson = {
    .form = "lie-poisson",
    .state = poisson_state,
    .factor = {{LG_SPACE_SE3_DUAL, 1}},
    .invariants = poisson_invariants,
    .invariant = poisson_invariant,
    LG_RECORDED(poisson),
    TOP,
};

/* ---- quadratic: Q, pi, q, p + M l chi ---- */

/* The invariant "energy" is H - |p|^2/2, which is the energy of the other forms. */
static double quadratic_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    double arm[3];
    arm_of(system->parameters, y + SHIFT, arm);
    return index > 0 ? spatial_invariant(system, index, y, work) : spatial_energy(system->parameters, y, arm);
}

/* H, the energy plus the constant |p|^2/2. */
static double quadratic_generating(const lg_system *system, const double *y, double *work) {
    double arm[3];
    arm_of(system->parameters, y + SHIFT, arm);
    return spatial_energy(system->parameters, y, arm) + 0.5 * lg_dot3(arm, arm);
}

const lg_system_row lg_system_row_top_quadratic = {
    .form = "quadratic",
    .unreported = 6,
    .factor = {{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 6}},
    .invariant = quadratic_invariant,
    .generating = quadratic_generating,
    LG_RECORDED(top),
    SPATIAL,
};

/* ---- the row: M = diag(I), V = m L gamma0.R chi ---- */

static lg_var potential(lg_tape *tape, const lg_at *at) {
    const lg_var R = lg_reshape(tape, at->state[0], lg_shape3(at->rows, 3, 3));
    const lg_var chi = lg_reshape(tape, lg_row_numbers(tape, at, CHI, 3), lg_shape3(1, 3, 1)),
                 gamma0 = lg_reshape(tape, lg_row_numbers(tape, at, GAMMA0, 3), lg_shape3(1, 1, 3));
    const lg_var along = lg_matmul(tape, gamma0, lg_matmul(tape, R, chi)); /* (B, 1, 1) */
    const lg_var weight = lg_mul(tape, lg_row_number(tape, at, MASS), lg_row_number(tape, at, LENGTH));
    return lg_mul(tape, lg_reshape(tape, along, lg_shape2(at->rows, 1)), weight);
}

const lg_energy_row lg_energy_top = {
    "heavy-top", parameters, lg_row_diagonal, potential, 1, {LG_COORDINATE_ROTATION}, .seen = 1};

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

#include <float.h>

#include "mechanics/engine.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/plain.inc"

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

/* ---- (Q, pi): the state of cotangent and direct, and the first part of the state of quadratic ---- */

static const lg_state_entry spatial_state[] = {
    {"Q", 1, 3, 3, ATTITUDE, 9, lg_row_attitude},
    {"pi", 1, 1, 3, MOMENTUM, 3, NULL},
    {.key = NULL},
};

static const char *const spatial_invariants[] = {"energy", "pi.Gamma0", NULL};

static double spatial_energy(const field_at *f, vector arm) {
    const matrix Q = matrix_state(f, ATTITUDE);
    const vector gamma = v_turned_back(f, Q, v_parameter(f, GAMMA0));
    return body_energy(f, v_turned_back(f, Q, v_state(f, MOMENTUM))) + v_dot(f, gamma, arm);
}

static double spatial_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const field_at f = {.parameter = system->parameters, .y = y};
    if (index > 0) return v_dot(&f, v_state(&f, MOMENTUM), v_parameter(&f, GAMMA0));
    return spatial_energy(&f, weight_arm(&f));
}

LG_PLAIN_FIELD(direct)
LG_PLAIN_FIELD(cotangent)

/* ---- cotangent, direct ---- */

#define TOP     .name = "heavy-top", .parameters = parameters, .structure = LG_STRUCTURE_HAMILTONIAN
#define SPATIAL TOP, .state = spatial_state, .invariants = spatial_invariants
const lg_system_row lg_system_row_top_cotangent = {
    .form = "cotangent",
    .factor = {{LG_SPACE_SE3, 1}},
    .invariant = spatial_invariant,
    LG_FIELDS(cotangent),
    SPATIAL,
};

const lg_system_row lg_system_row_top_direct = {
    .form = "direct",
    .factor = {{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}},
    .invariant = spatial_invariant,
    LG_FIELDS(direct),
    SPATIAL,
};

/* ---- lie-poisson ---- */

enum { GAMMA = 0 }; /* offset in the state */

static const lg_state_entry poisson_state[] = {
    {"Gamma", 1, 1, 3, GAMMA, 3, NULL},
    {"Pi", 1, 1, 3, BODY_MOMENTUM, 3, NULL},
    {.key = NULL},
};

static const char *const poisson_invariants[] = {"energy", "|Gamma|^2", "Gamma.Pi", NULL};

static double poisson_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const field_at f = {.parameter = system->parameters, .y = y};
    const vector gamma = v_state(&f, GAMMA), momentum = v_state(&f, BODY_MOMENTUM);
    if (index > 0) return v_dot(&f, gamma, index == 1 ? gamma : momentum);
    return body_energy(&f, momentum) + v_dot(&f, gamma, weight_arm(&f));
}

LG_PLAIN_FIELD(poisson)

const lg_system_row lg_system_row_top_lie_poisson = {
    .form = "lie-poisson",
    .state = poisson_state,
    .factor = {{LG_SPACE_SE3_DUAL, 1}},
    .invariants = poisson_invariants,
    .invariant = poisson_invariant,
    LG_FIELDS(poisson),
    TOP,
};

/* ---- quadratic: Q, pi, q, p + M l chi ---- */

/* The invariant "energy" is H - |p|^2/2, which is the energy of the other forms. */
static double quadratic_invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const field_at f = {.parameter = system->parameters, .y = y};
    return index > 0 ? spatial_invariant(system, index, y, work) : spatial_energy(&f, quadratic_arm(&f));
}

/* H, the energy plus the constant |p|^2/2. */
static double quadratic_generating(const lg_system *system, const double *y, double *work) {
    const field_at f = {.parameter = system->parameters, .y = y};
    const vector arm = quadratic_arm(&f);
    return spatial_energy(&f, arm) + 0.5 * v_dot(&f, arm, arm);
}

LG_PLAIN_FIELD(quadratic)

const lg_system_row lg_system_row_top_quadratic = {
    .form = "quadratic",
    .unreported = 6,
    .factor = {{LG_SPACE_SE3, 1}, {LG_SPACE_RN, 6}},
    .invariant = quadratic_invariant,
    .generating = quadratic_generating,
    LG_FIELDS(quadratic),
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

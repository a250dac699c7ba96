/* A satellite with a spherical pendulum: the slosh of its fuel, or an instrument on a cable.
 *
 * The body has the attitude R, body to inertial, and principal moments of inertia J about its centre. The
 * pendulum is a point mass at D + l q, with the pivot D = R d fixed in the body and q in S^2. Without outer
 * forces the centre of all masses rests, and mu is the reduced mass of body and pendulum:
 *
 *   T = 1/2 Omega.J Omega + 1/2 mu |omega x D + l q'|^2,  V = k (1 - q.A),
 *
 * with Omega = R^T omega and the axis A = R a that the pendulum is drawn to, as under constant thrust. The
 * momenta are pi (spatial, of R) and p = mu l P (omega x D + l q'), P = I - q q^T. Then with S = R J^-1 R^T,
 * b = pi - D x p/l and c = D x q
 *
 *   omega = S b - mu S c (c.S b)/(1 + mu c.S c),  H = 1/2 b.omega + |p|^2/(2 mu l^2) + V,
 *
 * by the formula of Sherman and Morrison. With v = dH/dp = p/(mu l^2) - omega x D/l and
 * g = dH/dq = -mu (c.omega) omega x D - k A, q and p move as on T*S^2 with f = (q x v, g x q + v x p), and
 * pi' = -(q x p)', because the total angular momentum pi + q x p is constant. */
#include "liegrad/geometry.h"
#include "mechanics/engine.h"
#include "mechanics/system.h"

/* Offsets in the parameters and in the state. */
enum { INERTIA = 0, MASS = 3, LENGTH = 4, PIVOT = 5, STIFFNESS = 8, AXIS = 9 };
enum { ATTITUDE = 0, MOMENTUM = 9, DIRECTION = 12, PENDULUM = 15 };

static const double inertia_fallback[3] = {1.0, 1.4, 0.8}, mass_fallback = 0.3, length_fallback = 0.7,
                    pivot_fallback[3] = {0.2, 0.0, 0.5}, stiffness_fallback = 1.0,
                    axis_fallback[3] = {0.0, 0.0, 1.0};

static const lg_parameter_entry parameters[] = {
    {"inertia", "I", 3, LG_PARAMETER_POSITIVE, inertia_fallback, "principal moments of inertia, kg m^2"},
    {"mass", "m", 1, LG_PARAMETER_POSITIVE, &mass_fallback, "reduced mass of body and pendulum, kg"},
    {"length", "L", 1, LG_PARAMETER_POSITIVE, &length_fallback, "length of the pendulum, m"},
    {"pivot", "d", 3, LG_PARAMETER_FINITE, pivot_fallback, "pivot in the body, from its centre, m"},
    {"stiffness", "k", 1, LG_PARAMETER_FINITE, &stiffness_fallback, "k of V = k (1 - q.R a), kg m^2/s^2"},
    {"axis", "a", 3, LG_PARAMETER_UNIT_VECTOR, axis_fallback, "axis a in the body"},
    {.key = NULL},
};

static const lg_state_entry state[] = {
    {"R", 1, 3, 3, ATTITUDE, 9, lg_row_attitude},
    {"pi", 1, 1, 3, MOMENTUM, 3, NULL},
    {"q", 1, 1, 3, DIRECTION, 3, NULL},
    {"p", 1, 1, 3, PENDULUM, 3, NULL},
    {.key = NULL},
};

/* What field and energy use: vectors (B, 1, 3), numbers (1) and (B, 1, 1). A = R a. */
typedef struct rates {
    lg_var pi, q, p, omega, D, b, A;
    lg_var mass, length, stiffness;
    lg_var tied; /* mu c.omega */
} rates;

static rates rates_at(lg_tape *tape, const lg_var *y, lg_var numbers) {
    const lg_shape line = lg_var_shape(tape, y[2]);
    const lg_var R = lg_row_matrices(tape, y[0]), inertia = lg_slice(tape, numbers, 0, INERTIA, 3),
                 d = lg_broadcast_to(tape, lg_slice(tape, numbers, 0, PIVOT, 3), line),
                 a = lg_broadcast_to(tape, lg_slice(tape, numbers, 0, AXIS, 3), line);
    rates at = {.pi = lg_reshape(tape, y[1], line),
                .q = y[2],
                .p = y[3],
                .D = lg_matmul_nt(tape, d, R),
                .A = lg_matmul_nt(tape, a, R),
                .mass = lg_slice(tape, numbers, 0, MASS, 1),
                .length = lg_slice(tape, numbers, 0, LENGTH, 1),
                .stiffness = lg_slice(tape, numbers, 0, STIFFNESS, 1)};
    const lg_var c = lg_cross(tape, at.D, at.q), moved = lg_div(tape, lg_cross(tape, at.D, at.p), at.length);
    at.b = lg_sub(tape, at.pi, moved);
    const lg_var Sc = lg_body_velocity(tape, inertia, R, c), Sb = lg_body_velocity(tape, inertia, R, at.b);
    const lg_var below = lg_add_scalar(tape, lg_mul(tape, at.mass, lg_rowdot(tape, c, Sc)), 1.0);
    const lg_var share = lg_div(tape, lg_mul(tape, at.mass, lg_rowdot(tape, c, Sb)), below);
    at.omega = lg_sub(tape, Sb, lg_mul(tape, share, Sc));
    at.tied = lg_mul(tape, at.mass, lg_rowdot(tape, c, at.omega));
    return at;
}

/* mu l^2 */
static lg_var moment_of(lg_tape *tape, const rates *at) {
    return lg_mul(tape, lg_mul(tape, at->mass, at->length), at->length);
}

LG_TAPED_FIELD(satellite) {
    const rates at = rates_at(tape, y, numbers);
    const lg_var carried = lg_cross(tape, at.omega, at.D);
    const lg_var v = lg_sub(tape, lg_div(tape, at.p, moment_of(tape, &at)), lg_div(tape, carried, at.length));
    const lg_var drawn = lg_mul(tape, at.stiffness, at.A);
    const lg_var g = lg_neg(tape, lg_add(tape, lg_mul(tape, at.tied, carried), drawn));
    const lg_var force = lg_add(tape, lg_cross(tape, g, at.q), lg_cross(tape, v, at.p));
    algebra[0] = at.omega;
    algebra[1] = lg_reshape(tape, lg_neg(tape, force), lg_var_shape(tape, y[1]));
    algebra[2] = lg_cross(tape, at.q, v);
    algebra[3] = force;
    return lg_tape_status(tape);
}

static lg_var energy(const lg_system *system, lg_tape *tape, const lg_var *y, lg_var numbers) {
    const rates at = rates_at(tape, y, numbers);
    const lg_var square = lg_div(tape, lg_rowdot(tape, at.p, at.p), moment_of(tape, &at));
    const lg_var fallen = lg_add_scalar(tape, lg_neg(tape, lg_rowdot(tape, at.q, at.A)), 1.0);
    const lg_var kinetic = lg_scale(tape, lg_add(tape, lg_rowdot(tape, at.b, at.omega), square), 0.5);
    return lg_add(tape, kinetic, lg_mul(tape, at.stiffness, fallen));
}

static const char *const invariants[] = {"energy", "angular-momentum-x", "angular-momentum-y",
                                         "angular-momentum-z", NULL};

static double invariant(const lg_system *system, size_t index, const double *y, double *work) {
    double turn[3];
    if (index == 0) return lg_recorded_energy(system, index, y, work);
    lg_cross3(y + DIRECTION, y + PENDULUM, turn);
    return y[MOMENTUM + index - 1] + turn[index - 1];
}

const lg_system_row lg_system_row_satellite = {
    .name = "satellite",
    .parameters = parameters,
    .state = state,
    .factor = {{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}, {LG_SPACE_TS2, 1}},
    .invariants = invariants,
    .invariant = invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    .taped_energy = energy,
    LG_RECORDED(satellite),
};

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
#include "mechanics/rotation.h"
#include "mechanics/system.h"

#include "liegrad/geometry.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/vectors.inc"

static const double inertia_fallback[3] = {1.0, 1.4, 0.8}, mass_fallback = 0.3, length_fallback = 0.7,
                    pivot_fallback[3] = {0.2, 0.0, 0.5}, stiffness_fallback = 1.0,
                    axis_fallback[3] = {0.0, 0.0, 1.0},
                    identity[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};

enum { INERTIA = 0, MASS = 3, LENGTH = 4, PIVOT = 5, STIFFNESS = 8, AXIS = 9 };
static const lg_parameter_entry parameters[] = {
    {"inertia", "I", 3, LG_PARAMETER_POSITIVE, inertia_fallback, "principal moments of inertia, kg m^2"},
    {"mass", "m", 1, LG_PARAMETER_POSITIVE, &mass_fallback, "reduced mass of body and pendulum, kg"},
    {"length", "L", 1, LG_PARAMETER_POSITIVE, &length_fallback, "length of the pendulum, m"},
    {"pivot", "d", 3, LG_PARAMETER_FINITE, pivot_fallback, "pivot in the body, from its centre, m"},
    {"stiffness", "k", 1, LG_PARAMETER_FINITE, &stiffness_fallback, "k of V = k (1 - q.R a), kg m^2/s^2"},
    {"axis", "a", 3, LG_PARAMETER_UNIT_VECTOR, axis_fallback, "axis a in the body"},
    {.key = NULL},
};

enum { ATTITUDE = 0, SPATIAL_MOMENTUM = 9, DIRECTION = 12, MOMENTUM = 15 }; /* offsets in the state */
static const lg_state_entry state[] = {
    {"R", 1, 3, 3, ATTITUDE, 9, identity},
    {"pi", 1, 1, 3, SPATIAL_MOMENTUM, 3, NULL},
    {"q", 1, 1, 3, DIRECTION, 3, NULL},
    {"p", 1, 1, 3, MOMENTUM, 3, NULL},
    {.key = NULL},
};

static lg_status space(size_t links, lg_space *out) {
    const lg_space_factor factors[] = {{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}, {LG_SPACE_TS2, 1}};
    return lg_space_init(out, factors, 3);
}

/* omega, D and c at a state. */
static void rates(const double *parameter, const double *y, double *omega, double *D, double *c) {
    const double *R = y + ATTITUDE, *pi = y + SPATIAL_MOMENTUM, *p = y + MOMENTUM;
    const double mu = parameter[MASS], length = parameter[LENGTH];
    double b[3], body[3], Sb[3], Sc[3];
    field_rotate(R, parameter + PIVOT, D);
    field_cross(D, y + DIRECTION, c);
    field_cross(D, p, b);
    for (int i = 0; i < 3; i++) b[i] = pi[i] - b[i] / length;
    field_rotate_back(R, b, body);
    for (int i = 0; i < 3; i++) body[i] /= parameter[INERTIA + i];
    field_rotate(R, body, Sb);
    field_rotate_back(R, c, body);
    for (int i = 0; i < 3; i++) body[i] /= parameter[INERTIA + i];
    field_rotate(R, body, Sc);
    const double share = mu * lg_dot3(c, Sb) / (1.0 + mu * lg_dot3(c, Sc));
    for (int i = 0; i < 3; i++) omega[i] = Sb[i] - share * Sc[i];
}

static lg_status field(void *user, double t, const double *y, const double *input, double *out) {
    const double *parameter = ((const lg_system_user *)user)->system->parameters;
    const double *q = y + DIRECTION, *p = y + MOMENTUM, mu = parameter[MASS], length = parameter[LENGTH];
    double *omega = out, D[3], c[3], A[3], carried[3], v[3], g[3], turn[3];
    rates(parameter, y, omega, D, c);
    field_rotate(y + ATTITUDE, parameter + AXIS, A);
    field_cross(omega, D, carried);
    const double tied = mu * lg_dot3(c, omega);
    for (int i = 0; i < 3; i++) {
        v[i] = p[i] / (mu * length * length) - carried[i] / length;
        g[i] = -tied * carried[i] - parameter[STIFFNESS] * A[i];
    }
    field_cross(q, v, out + 6);
    field_cross(g, q, out + 9);
    field_cross(v, p, turn);
    for (int i = 0; i < 3; i++) {
        out[9 + i] += turn[i];
        out[3 + i] = -out[9 + i];
    }
    return LG_OK;
}

static double energy(const double *parameter, const double *y) {
    const double *q = y + DIRECTION, *p = y + MOMENTUM, mu = parameter[MASS], length = parameter[LENGTH];
    double omega[3], D[3], c[3], b[3], A[3];
    rates(parameter, y, omega, D, c);
    field_cross(D, p, b);
    field_rotate(y + ATTITUDE, parameter + AXIS, A);
    for (int i = 0; i < 3; i++) b[i] = y[SPATIAL_MOMENTUM + i] - b[i] / length;
    return 0.5 * lg_dot3(b, omega) + 0.5 * lg_dot3(p, p) / (mu * length * length) +
           parameter[STIFFNESS] * (1.0 - lg_dot3(q, A));
}

static const char *const invariants[] = {"energy", "angular-momentum-x", "angular-momentum-y",
                                         "angular-momentum-z", NULL};

static double invariant(const lg_system *system, size_t index, const double *y, double *work) {
    double turn[3];
    if (index == 0) return energy(system->parameters, y);
    field_cross(y + DIRECTION, y + MOMENTUM, turn);
    return y[SPATIAL_MOMENTUM + index - 1] + turn[index - 1];
}

/* ---- on a tape ---- */

/* Parts of y: R (B, 1, 9), pi (B, 3), q and p (B, 1, 3). Vectors below are (B, 1, 3), numbers (B, 1, 1). */
static lg_status taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                       lg_var parameter, lg_var *algebra) {
    const lg_shape shape = lg_var_shape(tape, y[1]);
    const lg_var R = y[0], q = y[2], p = y[3], pi = lg_reshape(tape, y[1], lg_var_shape(tape, q));
    const lg_var inertia = lg_slice(tape, parameter, 0, INERTIA, 3);
    const lg_var mu = lg_slice(tape, parameter, 0, MASS, 1), length = lg_slice(tape, parameter, 0, LENGTH, 1);
    const lg_var k = lg_slice(tape, parameter, 0, STIFFNESS, 1);
    const lg_var d = lg_taped_spread(tape, lg_slice(tape, parameter, 0, PIVOT, 3), q);
    const lg_var a = lg_taped_spread(tape, lg_slice(tape, parameter, 0, AXIS, 3), q);
    const lg_var D = lg_taped_rotate(tape, R, d), A = lg_taped_rotate(tape, R, a), c = lg_cross(tape, D, q);
    const lg_var b = lg_sub(tape, pi, lg_div(tape, lg_cross(tape, D, p), length));
    const lg_var Sb = lg_taped_body_velocity(tape, inertia, R, b);
    const lg_var Sc = lg_taped_body_velocity(tape, inertia, R, c);
    const lg_var below = lg_add_scalar(tape, lg_mul(tape, mu, lg_rowdot(tape, c, Sc)), 1.0);
    const lg_var share = lg_div(tape, lg_mul(tape, mu, lg_rowdot(tape, c, Sb)), below);
    const lg_var omega = lg_sub(tape, Sb, lg_mul(tape, share, Sc));
    const lg_var carried = lg_cross(tape, omega, D);
    const lg_var moment = lg_mul(tape, mu, lg_square(tape, length));
    const lg_var v = lg_sub(tape, lg_div(tape, p, moment), lg_div(tape, carried, length));
    const lg_var tied = lg_mul(tape, lg_mul(tape, mu, lg_rowdot(tape, c, omega)), carried);
    const lg_var g = lg_neg(tape, lg_add(tape, tied, lg_mul(tape, k, A)));
    algebra[0] = omega;
    algebra[2] = lg_cross(tape, q, v);
    algebra[3] = lg_add(tape, lg_cross(tape, g, q), lg_cross(tape, v, p));
    algebra[1] = lg_reshape(tape, lg_neg(tape, algebra[3]), shape);
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_satellite = {
    .name = "satellite",
    .parameters = parameters,
    .state = state,
    .space = space,
    .invariants = invariants,
    .invariant = invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    .field = {field, NULL},
    .taped = taped,
};

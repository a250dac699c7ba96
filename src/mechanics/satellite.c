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
#include "mechanics/system.h"

#include <float.h>

#include "mechanics/engine.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/plain.inc"

#include "mechanics/fields/rotations.inc"

#include "mechanics/fields/satellite.inc"

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

LG_PLAIN_FIELD(satellite)

static double energy(const field_at *f) {
    const satellite_rates at = rates_at(f);
    const vector q = v_state(f, DIRECTION), p = v_state(f, PENDULUM);
    const double mu = f->parameter[MASS], length = f->parameter[LENGTH];
    return 0.5 * v_dot(f, at.b, at.omega) + 0.5 * v_dot(f, p, p) / (mu * length * length) +
           f->parameter[STIFFNESS] * (1.0 - v_dot(f, q, drawn_to(f)));
}

static const char *const invariants[] = {"energy", "angular-momentum-x", "angular-momentum-y",
                                         "angular-momentum-z", NULL};

static double invariant(const lg_system *system, size_t index, const double *y, double *work) {
    const field_at f = {.parameter = system->parameters, .y = y};
    if (index == 0) return energy(&f);
    const vector turn = v_cross(&f, v_state(&f, DIRECTION), v_state(&f, PENDULUM));
    return y[MOMENTUM + index - 1] + (const double[]){turn.x, turn.y, turn.z}[index - 1];
}

const lg_system_row lg_system_row_satellite = {
    .name = "satellite",
    .parameters = parameters,
    .state = state,
    .factor = {{LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3}, {LG_SPACE_TS2, 1}},
    .invariants = invariants,
    .invariant = invariant,
    .structure = LG_STRUCTURE_HAMILTONIAN,
    LG_FIELDS(satellite),
};

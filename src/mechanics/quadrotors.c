/* Two quadrotors that carry a point mass on rigid massless links, under a tracking control law.
 *
 * e3 points along gravity, DOWN. The payload is at y, the links have directions q_i in S^2, the quadrotors
 * are at y - L_i q_i. The thrust u_i is the sum of u_par_i along the link and u_perp_i across it:
 *
 *   M_q (v' - g e3) = sum_i u_par_i - m_i L_i |omega_i|^2 q_i,   M_q = m_y I + sum_i m_i q_i q_i^T
 *   omega_i' = q_i x (v' - g e3)/L_i - q_i x u_perp_i/(m_i L_i),   q_i' = omega_i x q_i
 *
 * The control law tracks y_d(t) = (t - 5/2, 0, (t - 5/2)^2 - 7) with the thrusts w_i; e = y - y_d:
 *
 *   A = y_d'' - kx e - kv e' - g e3, s = (G^T G)^-1 G^T A and x = G s with G = [q_1 q_2]
 *   w_par_i = (m_i q_i.A + m_i L_i |omega_i|^2 + m_y s_i) q_i
 *   d = -A/|A|, n the direction of e_y - (e_y.d) d
 *   q_d,i = cos(beta) d +- sin(beta) n x d, omega_d,i = q_d,i x q_d,i'
 *   c_i = -kq q_d,i x q_i - kw (omega_i - P_i omega_d,i) - (q_i.omega_d,i) omega_i x q_i
 *   w_perp_i = -q_i x (m_i q_i x x - m_i L_i c_i)
 *
 * with A' = y_d''' - kx e' - kv (x + g e3 - y_d''). In the form exact-thrusts u_i = w_i. Then v' = x + g e3
 * and omega_i' = c_i, whatever the masses are. If q_1, q_2 and A lie in one plane, e'' = -kx e - kv e'.
 *
 * In the form attitudes the thrust acts along R_i e3, which a moment M_i turns to -w_i; e_1 is the heading:
 *
 *   u_i = (w_i.R_i e3) R_i e3,   R_i' = hat(R_i Omega_i) R_i,   J Omega_i' = -Omega_i x J Omega_i + M_i
 *   R_c = [b_2 x b_3, b_2, b_3],   b_3 = -w_i/|w_i|,   b_2 the direction of b_3 x e_1
 *   M_i = -kR e_R - kOmega Omega_i + Omega_i x J Omega_i
 *   2 e_R = (R_c^T R_i - R_i^T R_c)^vee = R_i^T sum_j R_c e_j x R_i e_j
 *   v' = x + g e3 + dx with M_q dx = sum_i q_i q_i.l_i, l_i = u_i - w_i
 *   omega_i' = c_i + q_i x (m_i dx - l_i)/(m_i L_i)
 *
 * Lee and others add to M_i the rate and the acceleration of R_c, which need w_i''. Without them R_i lags
 * behind R_c by kOmega/kR times its rate, and reaches it where the payload has settled on its path.
 *
 * T. Lee, K. Sreenath, V. Kumar: Geometric control of cooperating multiple quadrotor UAVs with a suspended
 * payload, CDC 2013; Celledoni, Cokaj, Leone, Murari, Owren: Lie group integrators for mechanical systems
 * (2022).
 */
#include "mechanics/system.h"

#include <float.h>

#include "mechanics/engine.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/plain.inc"

/* For a double only. */
#define n_time_after(f, begin) ((f)->t - (begin))
#define n_root(f, a)           sqrt(a)
#define n_cosine(f, a)         cos(a)
#define n_sine(f, a)           sin(a)
#define n_positive(f, a)       field_positive(a)
#define v_second(f, a)         ((a).y)

#include "mechanics/fields/rotations.inc"

#include "mechanics/fields/quadrotors.inc"

static const double inertia_fallback[3] = {0.0820, 0.0845, 0.1377}, payload_fallback = 0.4,
                    masses_fallback[2] = {0.755, 0.755}, lengths_fallback[2] = {0.6, 0.8},
                    gravity_fallback = 9.81, kx_fallback = 4.0, kv_fallback = 4.0, kq_fallback = 100.0,
                    kw_fallback = 20.0, beta_fallback = 0.52359877559829887, kR_fallback = 50.0,
                    kOmega_fallback = 4.0;

static const lg_parameter_entry parameters[] = {
    {"J", "J", 3, LG_PARAMETER_POSITIVE, inertia_fallback,
     "principal moments of inertia of each quadrotor, kg m^2"},
    {"payload", "m_y", 1, LG_PARAMETER_POSITIVE, &payload_fallback, "mass of the payload, kg"},
    {"masses", "m", 2, LG_PARAMETER_POSITIVE, masses_fallback, "masses of the quadrotors, kg"},
    {"lengths", "L", 2, LG_PARAMETER_POSITIVE, lengths_fallback, "lengths of the links, m"},
    {"gravity", "g", 1, LG_PARAMETER_FINITE, &gravity_fallback, "gravity along e3, m/s^2"},
    {"kx", "kx", 1, LG_PARAMETER_FINITE, &kx_fallback, "gain on the payload's position, 1/s^2"},
    {"kv", "kv", 1, LG_PARAMETER_FINITE, &kv_fallback, "gain on the payload's velocity, 1/s"},
    {"kq", "kq", 1, LG_PARAMETER_FINITE, &kq_fallback, "gain on the links' directions, 1/s^2"},
    {"kw", "kw", 1, LG_PARAMETER_FINITE, &kw_fallback, "gain on the links' angular velocities, 1/s"},
    {"beta", "beta", 1, LG_PARAMETER_ANGLE, &beta_fallback, "half the wanted angle between the links, rad"},
    {"kR", "kR", 1, LG_PARAMETER_FINITE, &kR_fallback, "gain on the attitudes, kg m^2/s^2"},
    {"kOmega", "kOmega", 1, LG_PARAMETER_FINITE, &kOmega_fallback, "gain on the body rates, kg m^2/s"},
    {.key = NULL},
};

static const double position_fallback[3] = {-2.0, 0.0, 0.0}, zero[3] = {0.0, 0.0, 0.0};

static const lg_state_entry links_state[] = {
    {"y", 1, 1, 3, POSITION, 3, position_fallback},
    {"v", 1, 1, 3, VELOCITY, 3, zero},
    {"q", 2, 1, 3, LINK, LINK_SIZE, NULL},
    {"omega", 2, 1, 3, LINK + 3, LINK_SIZE, zero},
    {.key = NULL},
};

static const lg_state_entry attitudes_state[] = {
    {"y", 1, 1, 3, POSITION, 3, position_fallback},
    {"v", 1, 1, 3, VELOCITY, 3, zero},
    {"q", 2, 1, 3, LINK, LINK_SIZE, NULL},
    {"omega", 2, 1, 3, LINK + 3, LINK_SIZE, zero},
    {"R", 2, 3, 3, BODY, BODY_SIZE, lg_row_attitude},
    {"Omega", 2, 1, 3, BODY + RATE, BODY_SIZE, zero},
    {.key = NULL},
};

LG_PLAIN_FIELD(quadrotors)

const lg_system_row lg_system_row_quadrotors = {
    .name = "quadrotors",
    .form = "exact-thrusts",
    .parameters = parameters,
    .state = links_state,
    .factor = {{LG_SPACE_RN, 6}, {LG_SPACE_TS2, 2}},
    .vectors = 1 << 0,
    LG_FIELDS(quadrotors),
};

const lg_system_row lg_system_row_quadrotor_bodies = {
    .name = "quadrotors",
    .form = "attitudes",
    .parameters = parameters,
    .state = attitudes_state,
    .factor = {{LG_SPACE_RN, 6},
               {LG_SPACE_TS2, 2},
               {LG_SPACE_SO3, 1},
               {LG_SPACE_RN, 3},
               {LG_SPACE_SO3, 1},
               {LG_SPACE_RN, 3}},
    .vectors = 1 << 0 | 1 << 3 | 1 << 5,
    LG_FIELDS(quadrotors),
};

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
#include "mechanics/engine.h"
#include "mechanics/system.h"

/* Offsets in the parameters. */
enum { INERTIA = 0, PAYLOAD = 3, MASSES = 4, LENGTHS = 6, GRAVITY = 8, KX = 9, KV, KQ, KW, BETA, KR, KOMEGA };
/* Offsets in the state: each link has q (3) and omega (3); with attitudes, each body R (9) and Omega (3). */
enum { POSITION = 0, VELOCITY = 3, LINK = 6, LINK_SIZE = 6, BODY = 18, RATE = 9, BODY_SIZE = 12 };

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

#define PAYLOAD_AND_LINKS                                                                                    \
    {"y", 1, 1, 3, POSITION, 3, position_fallback}, {"v", 1, 1, 3, VELOCITY, 3, zero},                       \
        {"q", 2, 1, 3, LINK, LINK_SIZE, NULL}, {                                                             \
        "omega", 2, 1, 3, LINK + 3, LINK_SIZE, zero                                                          \
    }
static const lg_state_entry links_state[] = {PAYLOAD_AND_LINKS, {.key = NULL}};

static const lg_state_entry attitudes_state[] = {
    PAYLOAD_AND_LINKS,
    {"R", 2, 3, 3, BODY, BODY_SIZE, lg_row_attitude},
    {"Omega", 2, 1, 3, BODY + RATE, BODY_SIZE, zero},
    {.key = NULL},
};

/* Vectors are (B, 1, 3), or (B, 2, 3) for the two links; numbers (1), (1, 2, 1) or (B, 2, 1). */
typedef struct flight {
    lg_tape *tape;
    lg_var numbers, q, w;
    uint32_t rows;
} flight;

static lg_var number(const flight *f, uint32_t at) {
    return lg_slice(f->tape, f->numbers, 0, at, 1);
}

/* One number for each link. */
static lg_var each(const flight *f, uint32_t at) {
    return lg_reshape(f->tape, lg_slice(f->tape, f->numbers, 0, at, 2), lg_shape3(1, 2, 1));
}

static lg_var axis(const flight *f, int i) {
    const double unit[3] = {i == 0, i == 1, i == 2};
    return lg_broadcast_to(f->tape, lg_input_f64(f->tape, lg_shape1(3), unit), lg_shape3(f->rows, 1, 3));
}

static lg_var both(const flight *f, lg_var x) {
    return lg_broadcast_to(f->tape, x, lg_shape3(f->rows, 2, 3));
}

/* G z with G = [q_1 q_2], where z (B, 2, 1) solves (G^T G + more) z = r; NaN if this matrix is not positive
 * definite. */
static lg_var in_plane(const flight *f, lg_var more, lg_var r, lg_var *z) {
    const lg_var gram = lg_matmul_nt(f->tape, f->q, f->q);
    *z = lg_spd_solve(f->tape, lg_is_none(more) ? gram : lg_add(f->tape, gram, more), r);
    return lg_matmul_tn(f->tape, *z, f->q);
}

static lg_var unit(lg_tape *tape, lg_var x) {
    return lg_div(tape, x, lg_sqrt(tape, lg_rownorm2(tape, x)));
}

/* q_d,i */
static lg_var wanted_directions(const flight *f, lg_var A) {
    static const double signs[2] = {1.0, -1.0};
    lg_tape *tape = f->tape;
    const lg_var beta = number(f, BETA), sign = lg_input_f64(tape, lg_shape3(1, 2, 1), signs);
    const lg_var d = unit(tape, lg_neg(tape, A)), y = lg_slice(tape, d, 2, 1, 1);
    const lg_var n = unit(tape, lg_sub(tape, axis(f, 1), lg_mul(tape, y, d)));
    const lg_var side = lg_mul(tape, lg_sin(tape, beta), lg_cross(tape, n, d));
    return lg_add(tape, lg_mul(tape, lg_cos(tape, beta), d), lg_mul(tape, sign, side));
}

/* c_i, the angular accelerations that the control law asks for. */
static lg_var wanted_acceleration(const flight *f, lg_var A, lg_var dA) {
    lg_tape *tape = f->tape;
    const lg_var qd = wanted_directions(f, A);
    lg_var dqd = LG_NONE;
    (void)lg_jvp(tape, &qd, 1, &A, &dA, 1, &dqd);
    const lg_var wd = lg_cross(tape, qd, dqd), spin = lg_rowdot(tape, f->q, wd);
    const lg_var error = lg_sub(tape, f->w, lg_sub(tape, wd, lg_mul(tape, spin, f->q)));
    const lg_var back = lg_add(tape, lg_mul(tape, number(f, KQ), lg_cross(tape, qd, f->q)),
                               lg_mul(tape, number(f, KW), error));
    return lg_neg(tape, lg_add(tape, back, lg_mul(tape, spin, lg_cross(tape, f->w, f->q))));
}

/* Writes R Omega and Omega' of a quadrotor, whose parts of the state are y. Returns the thrust that acts
 * where w is asked for. */
static lg_var steered(const flight *f, const lg_var *y, lg_var w, lg_var *algebra) {
    lg_tape *tape = f->tape;
    const lg_shape line = lg_shape3(f->rows, 1, 3), column = lg_shape3(f->rows, 3, 1);
    const lg_var R = lg_row_matrices(tape, y[0]), rate = lg_reshape(tape, y[1], line);
    const lg_var third = unit(tape, lg_neg(tape, w)), second = unit(tape, lg_cross(tape, third, axis(f, 0))),
                 first = lg_cross(tape, second, third);
    const lg_var columns[3] = {lg_reshape(tape, first, column), lg_reshape(tape, second, column),
                               lg_reshape(tape, third, column)};
    const lg_var wanted = lg_reshape(tape, lg_concat(tape, columns, 3, 2), lg_var_shape(tape, y[0])),
                 turn = lg_reshape(tape, lg_columns_crossed(tape, wanted, y[0]), line);
    const lg_var error = lg_matmul(tape, turn, R); /* 2 e_R */
    const lg_var back = lg_add(tape, lg_mul(tape, lg_scale(tape, number(f, KR), 0.5), error),
                               lg_mul(tape, number(f, KOMEGA), rate));
    const lg_var slowing = lg_neg(tape, lg_div(tape, back, lg_slice(tape, f->numbers, 0, INERTIA, 3))),
                 up = lg_reshape(tape, lg_slice(tape, R, 2, 2, 1), line);
    algebra[0] = lg_matmul_nt(tape, rate, R);
    algebra[1] = lg_reshape(tape, slowing, lg_var_shape(tape, y[1]));
    return lg_mul(tape, lg_rowdot(tape, w, up), up);
}

/* Adds to x and omega_i' what the thrusts lack that act along the bodies. */
static void add_attitudes(const flight *f, const lg_var *y, lg_var A, lg_var share, lg_var *x, lg_var *turn,
                          lg_var *algebra) {
    lg_tape *tape = f->tape;
    const lg_var m = each(f, MASSES), mL = lg_mul(tape, m, each(f, LENGTHS)), payload = number(f, PAYLOAD);
    const lg_var force = lg_add(tape, lg_mul(tape, m, lg_rowdot(tape, f->q, both(f, A))),
                                lg_mul(tape, mL, lg_rownorm2(tape, f->w)));
    const lg_var along = lg_mul(tape, lg_add(tape, force, lg_mul(tape, payload, share)), f->q);
    const lg_var asked =
        lg_sub(tape, lg_mul(tape, mL, *turn), lg_mul(tape, m, lg_cross(tape, f->q, both(f, *x))));
    const lg_var thrust = lg_add(tape, along, lg_cross(tape, f->q, asked));
    lg_var z, acting[2];
    for (uint32_t i = 0; i < 2; i++)
        acting[i] = steered(f, y + 2 * i, lg_slice(tape, thrust, 1, i, 1), algebra + 2 * i);
    const lg_var lack = lg_sub(tape, lg_concat(tape, acting, 2, 1), thrust);
    const lg_var more = lg_mul(tape, lg_unit_matrix(tape, 2), lg_div(tape, payload, m));
    const lg_var dx = in_plane(f, more, lg_div(tape, lg_rowdot(tape, f->q, lack), m), &z);
    const lg_var moved = lg_cross(tape, f->q, lg_sub(tape, lg_mul(tape, m, both(f, dx)), lack));
    *turn = lg_add(tape, *turn, lg_div(tape, moved, mL));
    *x = lg_add(tape, *x, dx);
}

/* e and e' at time t. */
static void follow(const flight *f, lg_taped_time t, lg_var position, lg_var velocity, lg_var *e,
                   lg_var *de) {
    lg_tape *tape = f->tape;
    t.value -= 2.5;
    const lg_var s = lg_reshape(tape, lg_taped_time_rows(tape, t, f->rows), lg_shape3(f->rows, 1, 1)),
                 e1 = axis(f, 0), e3 = axis(f, 2);
    const lg_var height = lg_add_scalar(tape, lg_square(tape, s), -7.0);
    *e = lg_sub(tape, position, lg_add(tape, lg_mul(tape, s, e1), lg_mul(tape, height, e3)));
    *de = lg_sub(tape, velocity, lg_add(tape, e1, lg_mul(tape, lg_scale(tape, s, 2.0), e3)));
}

/* (v, v'), then (omega_i, q_i x omega_i') of the links, then with attitudes (R_i Omega_i, Omega_i'). */
LG_TAPED_FIELD(quadrotors) {
    const flight f = {tape, numbers, y[1], y[2], lg_rows_of(tape, y[0])};
    const lg_shape line = lg_shape3(f.rows, 1, 3);
    const lg_var position = lg_reshape(tape, lg_slice(tape, y[0], 1, POSITION, 3), line),
                 velocity = lg_reshape(tape, lg_slice(tape, y[0], 1, VELOCITY, 3), line), e3 = axis(&f, 2);
    lg_var e, de, share;
    follow(&f, t, position, velocity, &e, &de);
    const lg_var kx = number(&f, KX), kv = number(&f, KV), a = lg_scale(tape, e3, 2.0),
                 down = lg_mul(tape, number(&f, GRAVITY), e3);
    const lg_var pulled = lg_sub(tape, lg_sub(tape, a, lg_mul(tape, kx, e)), lg_mul(tape, kv, de)),
                 A = lg_sub(tape, pulled, down);
    lg_var x = in_plane(&f, LG_NONE, lg_rowdot(tape, f.q, both(&f, A)), &share);
    const lg_var slowing = lg_mul(tape, kv, lg_sub(tape, lg_add(tape, x, down), a));
    lg_var turn = wanted_acceleration(&f, A, lg_neg(tape, lg_add(tape, lg_mul(tape, kx, de), slowing)));
    if (system->space.factors > 2) add_attitudes(&f, y + 3, A, share, &x, &turn, algebra + 3);
    const lg_var first[2] = {velocity, lg_add(tape, x, down)};
    algebra[0] = lg_reshape(tape, lg_concat(tape, first, 2, 2), lg_var_shape(tape, y[0]));
    algebra[1] = f.w;
    algebra[2] = lg_cross(tape, f.q, turn);
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_quadrotors = {
    .name = "quadrotors",
    .form = "exact-thrusts",
    .parameters = parameters,
    .state = links_state,
    .factor = {{LG_SPACE_RN, 6}, {LG_SPACE_TS2, 2}},
    .vectors = 1 << 0,
    LG_RECORDED(quadrotors),
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
    LG_RECORDED(quadrotors),
};

/* Two quadrotors that carry a point mass on rigid massless links, under a tracking control law.
 *
 * e3 points along gravity, DOWN. The payload is at y, the links have directions q_i in S^2, the quadrotors
 * are at y - L_i q_i and have attitudes R_i with body rates Omega_i. The thrust u_i is the sum of u_par_i
 * along the link and u_perp_i across it; M_i are the moments:
 *
 *   M_q (v' - g e3) = sum_i u_par_i - m_i L_i |omega_i|^2 q_i,   M_q = m_y I + sum_i m_i q_i q_i^T
 *   omega_i' = q_i x (v' - g e3)/L_i - q_i x u_perp_i/(m_i L_i),   q_i' = omega_i x q_i
 *   J Omega_i' = -Omega_i x J Omega_i + M_i,   R_i' = hat(omega) R_i, omega = R_i Omega_i
 *
 * The quadrotors deliver the thrusts of the control law exactly. Therefore attitudes and links are not
 * coupled, and M_i = 0. The control law tracks y_d(t) = (t - 5/2, 0, (t - 5/2)^2 - 7); with e = y - y_d:
 *
 *   A = y_d'' - kx e - kv e' - g e3, s = (G^T G)^-1 G^T m_y A with G = [q_1 q_2]
 *   u_par_i = (m_i q_i.A + m_i L_i |omega_i|^2 + s_i) q_i
 *   d = -A/|A|, n the direction of e_y - (e_y.d) d
 *   q_d,i = cos(beta) d +- sin(beta) n x d, omega_d,i = q_d,i x q_d,i'
 *   c_i = -kq q_d,i x q_i - kw (omega_i - P_i omega_d,i) - (q_i.omega_d,i) omega_i x q_i
 *   u_perp_i = -q_i x (m_i q_i x (v' - g e3) - m_i L_i c_i)
 *
 * with A' = y_d''' - kx e' - kv (v' - y_d''). If q_1, q_2 and A lie in one plane, e'' = -kx e - kv e'.
 *
 * T. Lee, K. Sreenath, V. Kumar: Geometric control of cooperating multiple quadrotor UAVs with a suspended
 * payload, CDC 2013; Celledoni, Cokaj, Leone, Murari, Owren: Lie group integrators for mechanical systems
 * (2022).
 */
#include "mechanics/rotation.h"
#include "mechanics/system.h"

#include <math.h>

#include "liegrad/geometry.h"

/* Offsets in the parameters. */
enum { INERTIA = 0, PAYLOAD = 3, MASSES = 4, LENGTHS = 6, GRAVITY = 8, KX = 9, KV, KQ, KW, BETA };

static const double inertia_fallback[3] = {0.0820, 0.0845, 0.1377}, payload_fallback = 0.4,
                    masses_fallback[2] = {0.755, 0.755}, lengths_fallback[2] = {0.6, 0.8},
                    gravity_fallback = 9.81, kx_fallback = 4.0, kv_fallback = 4.0, kq_fallback = 100.0,
                    kw_fallback = 20.0, beta_fallback = 0.52359877559829887;

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
    {.key = NULL},
};

/* Offsets in the state: each quadrotor has R (9) and Omega (3), each link q (3) and omega (3). */
enum { POSITION = 0, VELOCITY = 3, QUADROTOR = 6, RATE = 9, QUADROTOR_SIZE = 12, LINK = 30, LINK_SIZE = 6 };

static const double position_fallback[3] = {-2.0, 0.0, 0.0}, zero[3] = {0.0, 0.0, 0.0},
                    identity[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};

static const lg_state_entry state[] = {
    {"y", 1, 1, 3, POSITION, 3, position_fallback},
    {"v", 1, 1, 3, VELOCITY, 3, zero},
    {"R", 2, 3, 3, QUADROTOR, QUADROTOR_SIZE, identity},
    {"Omega", 2, 1, 3, QUADROTOR + RATE, QUADROTOR_SIZE, zero},
    {"q", 2, 1, 3, LINK, LINK_SIZE, NULL},
    {"omega", 2, 1, 3, LINK + 3, LINK_SIZE, zero},
    {.key = NULL},
};

static lg_status space(size_t links, lg_space *out) {
    static const lg_space_factor factors[] = {{LG_SPACE_RN, 6},  {LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3},
                                              {LG_SPACE_SO3, 1}, {LG_SPACE_RN, 3},  {LG_SPACE_TS2, 2}};
    return lg_space_init(out, factors, LG_COUNT(factors));
}

static const char *const no_invariants[] = {NULL};

/* The reference y_d with its first and second derivative; the third derivative is zero. */
typedef struct reference {
    double y[3], v[3], a[3];
} reference;

static reference parabola(double t) {
    const double s = t - 2.5;
    return (reference){.y = {s, 0.0, s * s - 7.0}, .v = {1.0, 0.0, 2.0 * s}, .a = {0.0, 0.0, 2.0}};
}

static const double side[2] = {1.0, -1.0}; /* sign of sin(beta) in q_d,i */

/* ---- the plain field ---- */

/* x += c y */
static void add_to(double x[3], double c, const double y[3]) {
    for (int i = 0; i < 3; i++) x[i] += c * y[i];
}

/* z = (G^T G + diag(extra))^-1 r, G = [q_1 q_2]. False if the matrix is not positive definite. */
static bool solve_pair(const double *const q[2], const double extra[2], const double r[2], double z[2]) {
    const double a = lg_dot3(q[0], q[0]) + extra[0], b = lg_dot3(q[0], q[1]),
                 c = lg_dot3(q[1], q[1]) + extra[1], det = a * c - b * b;
    z[0] = (c * r[0] - b * r[1]) / det;
    z[1] = (a * r[1] - b * r[0]) / det;
    return det > 0.0;
}

/* Computes along_i, where u_par_i = along_i q_i. False if the links are parallel. */
static bool thrusts_along(const double *p, const double *const q[2], const double *const w[2],
                          const double A[3], double along[2]) {
    const double r[2] = {p[PAYLOAD] * lg_dot3(q[0], A), p[PAYLOAD] * lg_dot3(q[1], A)};
    double s[2];
    const bool solvable = solve_pair(q, zero, r, s);
    for (int i = 0; i < 2; i++) {
        const double m = p[MASSES + i];
        along[i] = m * lg_dot3(q[i], A) + m * p[LENGTHS + i] * lg_dot3(w[i], w[i]) + s[i];
    }
    return solvable;
}

/* x = v' - g e3. With D = diag(m_i), M_q = m_y I + G D G^T and
 * M_q^-1 = (I - G (m_y D^-1 + G^T G)^-1 G^T)/m_y. */
static void payload(const double *p, const double *const q[2], const double *const w[2],
                    const double along[2], double x[3]) {
    const double extra[2] = {p[PAYLOAD] / p[MASSES], p[PAYLOAD] / p[MASSES + 1]};
    double force[3] = {0.0, 0.0, 0.0}, z[2];
    for (int i = 0; i < 2; i++)
        add_to(force, along[i] - p[MASSES + i] * p[LENGTHS + i] * lg_dot3(w[i], w[i]), q[i]);
    (void)solve_pair(q, extra, (const double[]){lg_dot3(q[0], force), lg_dot3(q[1], force)}, z);
    for (int i = 0; i < 2; i++) add_to(force, -z[i], q[i]);
    for (int i = 0; i < 3; i++) x[i] = force[i] / p[PAYLOAD];
}

/* The vectors d and arm = n x d from which q_d,i is combined, with their time derivatives dd and darm. */
typedef struct directions {
    double d[3], dd[3], arm[3], darm[3];
} directions;

/* out = x/|x| and its time derivative dout; dx is the time derivative of x. */
static void normalise(const double x[3], const double dx[3], double out[3], double dout[3]) {
    const double length = sqrt(lg_dot3(x, x));
    for (int i = 0; i < 3; i++) out[i] = x[i] / length;
    const double along = lg_dot3(out, dx);
    for (int i = 0; i < 3; i++) dout[i] = (dx[i] - along * out[i]) / length;
}

static directions directions_from(const double A[3], const double dA[3]) {
    const double minus_A[3] = {-A[0], -A[1], -A[2]}, minus_dA[3] = {-dA[0], -dA[1], -dA[2]};
    directions of;
    double m[3] = {0.0, 1.0, 0.0}, dm[3] = {0.0, 0.0, 0.0}, n[3], dn[3], cross[3];
    normalise(minus_A, minus_dA, of.d, of.dd);
    add_to(m, -of.d[1], of.d);
    add_to(dm, -of.dd[1], of.d);
    add_to(dm, -of.d[1], of.dd);
    normalise(m, dm, n, dn);
    lg_cross3(n, of.d, of.arm);
    lg_cross3(dn, of.d, of.darm);
    lg_cross3(n, of.dd, cross);
    add_to(of.darm, 1.0, cross);
    return of;
}

/* c_i, the angular acceleration of link i that the control law asks for. */
static void wanted_acceleration(const double *p, const directions *of, int link, const double q[3],
                                const double w[3], double c[3]) {
    const double cosine = cos(p[BETA]), sine = side[link] * sin(p[BETA]);
    double qd[3], dqd[3], wd[3], turn[3], wq[3];
    for (int i = 0; i < 3; i++) {
        qd[i] = cosine * of->d[i] + sine * of->arm[i];
        dqd[i] = cosine * of->dd[i] + sine * of->darm[i];
    }
    lg_cross3(qd, dqd, wd);
    lg_cross3(qd, q, turn);
    lg_cross3(w, q, wq);
    const double spin = lg_dot3(q, wd);
    for (int i = 0; i < 3; i++)
        c[i] = -p[KQ] * turn[i] - p[KW] * (w[i] - (wd[i] - spin * q[i])) - spin * wq[i];
}

/* out = omega' of a link with mass m and length L under u_perp = -q x (m q x x - m L c), x = v' - g e3. */
static void link_acceleration(double m, double L, const double q[3], const double x[3], const double c[3],
                              double out[3]) {
    double qx[3], across[3], turn[3];
    lg_cross3(q, x, qx);
    for (int i = 0; i < 3; i++) across[i] = -(m * qx[i] - m * L * c[i]);
    lg_cross3(q, across, turn); /* u_perp */
    lg_cross3(q, turn, across);
    for (int i = 0; i < 3; i++) out[i] = qx[i] / L - across[i] / (m * L);
}

/* out = (R Omega, Omega') of the quadrotor whose (R, Omega) are at y. */
static void attitude(const double *J, const double *y, double *out) {
    const double *rate = y + RATE;
    double momentum[3], cross[3];
    lg_so3_adjoint(y, rate, out);
    for (int i = 0; i < 3; i++) momentum[i] = J[i] * rate[i];
    lg_cross3(momentum, rate, cross);
    for (int i = 0; i < 3; i++) out[3 + i] = cross[i] / J[i];
}

/* Computes A, x = v' - g e3 and dA = A'. False if the links are parallel. */
static bool track(const double *p, double t, const double *y, const double *const q[2],
                  const double *const w[2], double A[3], double dA[3], double x[3]) {
    const reference wanted = parabola(t);
    const double down[3] = {0.0, 0.0, p[GRAVITY]};
    double along[2], de[3];
    for (int i = 0; i < 3; i++) {
        de[i] = y[VELOCITY + i] - wanted.v[i];
        A[i] = wanted.a[i] - p[KX] * (y[POSITION + i] - wanted.y[i]) - p[KV] * de[i] - down[i];
    }
    const bool solvable = thrusts_along(p, q, w, A, along);
    payload(p, q, w, along, x);
    for (int i = 0; i < 3; i++) dA[i] = -p[KX] * de[i] - p[KV] * (x[i] + down[i] - wanted.a[i]);
    return solvable;
}

/* out = (v, v'), then (R_i Omega_i, Omega_i') per quadrotor, then (omega_i, q_i x omega_i') per link.
 * LG_NOT_FINITE if the links are parallel. */
static lg_status field(void *user, double t, const double *y, const double *input, double *out) {
    const double *p = ((const lg_system_user *)user)->system->parameters;
    const double *const q[2] = {y + LINK, y + LINK + LINK_SIZE};
    const double *const w[2] = {y + LINK + 3, y + LINK + LINK_SIZE + 3};
    double A[3], dA[3], x[3], c[3], acceleration[3];
    if (!track(p, t, y, q, w, A, dA, x)) return LG_NOT_FINITE;
    const directions wanted = directions_from(A, dA);
    for (int i = 0; i < 3; i++) {
        out[i] = y[VELOCITY + i];
        out[3 + i] = x[i] + (i == 2 ? p[GRAVITY] : 0.0);
    }
    for (int i = 0; i < 2; i++) {
        double *link = out + 18 + 6 * i;
        attitude(p + INERTIA, y + QUADROTOR + i * QUADROTOR_SIZE, out + 6 + 6 * i);
        wanted_acceleration(p, &wanted, i, q[i], w[i], c);
        link_acceleration(p[MASSES + i], p[LENGTHS + i], q[i], x, c, acceleration);
        for (int j = 0; j < 3; j++) link[j] = w[i][j];
        lg_cross3(q[i], acceleration, link + 3);
    }
    return LG_OK;
}

/* ---- the field on a tape ---- */

/* Shapes: vectors of the payload are (B, 1, 3), of both links (B, 2, 3); scalars of both links (B, 2, 1). */
typedef struct taped_system {
    lg_tape *tape;
    lg_var p;            /* parameters */
    lg_var m, L, mL;     /* (2, 1) */
    lg_var q, w, q1, q2; /* q_i and omega_i (B, 2, 3); q_1 and q_2 (B, 1, 3) */
    lg_var centrifugal;  /* m_i L_i |omega_i|^2, (B, 2, 1) */
} taped_system;

static lg_var number(const taped_system *s, uint32_t place) {
    return lg_slice(s->tape, s->p, 0, place, 1);
}

static lg_var pair(const taped_system *s, uint32_t place) {
    return lg_reshape(s->tape, lg_slice(s->tape, s->p, 0, place, 2), lg_shape2(2, 1));
}

static lg_var constant3(lg_tape *tape, const double *x) {
    return lg_input_f64(tape, lg_shape1(3), x);
}

/* q_i.x for both links; x is (B, 1, 3). */
static lg_var along_links(const taped_system *s, lg_var x) {
    return lg_rowdot(s->tape, s->q, lg_taped_spread(s->tape, x, s->q));
}

/* sum_i c_i q_i, (B, 1, 3) */
static lg_var combine_links(const taped_system *s, lg_var c) {
    return lg_sum_axis(s->tape, lg_mul(s->tape, c, s->q), 1, true);
}

static lg_var swap_links(lg_tape *tape, lg_var x) {
    lg_var halves[2] = {lg_slice(tape, x, 1, 1, 1), lg_slice(tape, x, 1, 0, 1)};
    return lg_concat(tape, halves, 2, 1);
}

/* (G^T G + diag(extra))^-1 r; extra is (2, 1), or LG_NONE for 0. */
static lg_var taped_solve_pair(const taped_system *s, lg_var extra, lg_var r) {
    lg_tape *tape = s->tape;
    lg_var diagonal = lg_rownorm2(tape, s->q), b = lg_rowdot(tape, s->q1, s->q2);
    if (!lg_is_none(extra)) diagonal = lg_add(tape, diagonal, extra);
    lg_var det =
        lg_sub(tape, lg_mul(tape, lg_slice(tape, diagonal, 1, 0, 1), lg_slice(tape, diagonal, 1, 1, 1)),
               lg_square(tape, b));
    lg_var z =
        lg_sub(tape, lg_mul(tape, swap_links(tape, diagonal), r), lg_mul(tape, b, swap_links(tape, r)));
    return lg_div(tape, z, det);
}

/* x = v' - g e3 from A */
static lg_var taped_payload(const taped_system *s, lg_var A) {
    lg_tape *tape = s->tape;
    lg_var my = number(s, PAYLOAD), qA = along_links(s, A);
    lg_var tension = taped_solve_pair(s, LG_NONE, lg_mul(tape, my, qA));
    lg_var along = lg_add(tape, lg_add(tape, lg_mul(tape, s->m, qA), s->centrifugal), tension);
    lg_var force = combine_links(s, lg_sub(tape, along, s->centrifugal));
    lg_var z = taped_solve_pair(s, lg_div(tape, my, s->m), along_links(s, force));
    return lg_div(tape, lg_sub(tape, force, combine_links(s, z)), my);
}

/* *out = x/|x| and its time derivative *dout, all (B, 1, 3). */
static void taped_normalise(lg_tape *tape, lg_var x, lg_var dx, lg_var *out, lg_var *dout) {
    lg_var length = lg_sqrt(tape, lg_rownorm2(tape, x));
    *out = lg_div(tape, x, length);
    lg_var along = lg_rowdot(tape, *out, dx);
    *dout = lg_div(tape, lg_sub(tape, dx, lg_mul(tape, along, *out)), length);
}

/* q_d and q_d' of both links */
static void taped_directions(const taped_system *s, lg_var A, lg_var dA, lg_var *qd, lg_var *dqd) {
    lg_tape *tape = s->tape;
    lg_var d, dd, n, dn, signs = lg_input_f64(tape, lg_shape2(2, 1), side);
    taped_normalise(tape, lg_neg(tape, A), lg_neg(tape, dA), &d, &dd);
    lg_var d_y = lg_slice(tape, d, 2, 1, 1), dd_y = lg_slice(tape, dd, 2, 1, 1);
    lg_var e_y = constant3(tape, (const double[]){0.0, 1.0, 0.0});
    lg_var m = lg_sub(tape, e_y, lg_mul(tape, d_y, d));
    lg_var dm = lg_neg(tape, lg_add(tape, lg_mul(tape, dd_y, d), lg_mul(tape, d_y, dd)));
    taped_normalise(tape, m, dm, &n, &dn);
    lg_var arm = lg_cross(tape, n, d);
    lg_var darm = lg_add(tape, lg_cross(tape, dn, d), lg_cross(tape, n, dd));
    lg_var beta = number(s, BETA), cosine = lg_cos(tape, beta);
    lg_var sine = lg_mul(tape, lg_sin(tape, beta), signs);
    *qd = lg_add(tape, lg_mul(tape, cosine, d), lg_mul(tape, sine, arm));
    *dqd = lg_add(tape, lg_mul(tape, cosine, dd), lg_mul(tape, sine, darm));
}

/* c_i of both links */
static lg_var taped_wanted_acceleration(const taped_system *s, lg_var A, lg_var dA) {
    lg_tape *tape = s->tape;
    lg_var qd, dqd;
    taped_directions(s, A, dA, &qd, &dqd);
    lg_var wd = lg_cross(tape, qd, dqd), spin = lg_rowdot(tape, s->q, wd);
    lg_var error = lg_sub(tape, s->w, lg_sub(tape, wd, lg_mul(tape, spin, s->q)));
    lg_var terms[3] = {lg_mul(tape, number(s, KQ), lg_cross(tape, qd, s->q)),
                       lg_mul(tape, number(s, KW), error), lg_mul(tape, spin, lg_cross(tape, s->w, s->q))};
    return lg_linear_combination(tape, terms, (const double[]){-1.0, -1.0, -1.0}, 3);
}

/* omega_i' of both links */
static lg_var taped_link_acceleration(const taped_system *s, lg_var x, lg_var c) {
    lg_tape *tape = s->tape;
    lg_var qx = lg_cross(tape, s->q, lg_taped_spread(tape, x, s->q));
    lg_var asked = lg_sub(tape, lg_mul(tape, s->mL, c), lg_mul(tape, s->m, qx));
    lg_var across = lg_cross(tape, s->q, asked); /* u_perp */
    return lg_sub(tape, lg_div(tape, qx, s->L), lg_div(tape, lg_cross(tape, s->q, across), s->mL));
}

/* algebra = R Omega (B, 1, 3) and Omega' (B, 3), from y = R (B, 1, 9) and Omega (B, 3). */
static void taped_attitude(lg_tape *tape, lg_var J, const lg_var *y, lg_var *algebra) {
    const lg_shape flat = lg_var_shape(tape, y[1]);
    lg_var momentum = lg_mul(tape, y[1], J);
    algebra[0] = lg_taped_rotate(tape, y[0], lg_reshape(tape, y[1], lg_shape3(flat.dims[0], 1, 3)));
    algebra[1] = lg_div(tape, lg_cross(tape, momentum, y[1]), J);
}

static taped_system taped_system_of(lg_tape *tape, lg_var parameter, lg_var q, lg_var w) {
    taped_system s = {.tape = tape, .p = parameter, .q = q, .w = w};
    s.m = pair(&s, MASSES);
    s.L = pair(&s, LENGTHS);
    s.mL = lg_mul(tape, s.m, s.L);
    s.q1 = lg_slice(tape, q, 1, 0, 1);
    s.q2 = lg_slice(tape, q, 1, 1, 1);
    s.centrifugal = lg_mul(tape, s.mL, lg_rownorm2(tape, w));
    return s;
}

/* s = t - 2.5, the parameter of the parabola, (B, 1, 1); B is the batch size of `like`. */
static lg_var along_parabola(lg_tape *tape, lg_taped_time t, lg_var like) {
    const uint32_t batch = lg_var_shape(tape, like).dims[0];
    return lg_reshape(tape, lg_add_scalar(tape, lg_taped_time_rows(tape, t, batch), -2.5),
                      lg_shape3(batch, 1, 1));
}

static const double e1[3] = {1.0, 0.0, 0.0}, e3[3] = {0.0, 0.0, 1.0};

/* y_d = (s, 0, s^2 - 7) */
static lg_var taped_position(lg_tape *tape, lg_taped_time t, lg_var like) {
    if (!lg_taped_time_varies(t)) return constant3(tape, parabola(t.value).y);
    lg_var s = along_parabola(tape, t, like), up = lg_add_scalar(tape, lg_square(tape, s), -7.0);
    return lg_add(tape, lg_mul(tape, s, constant3(tape, e1)), lg_mul(tape, up, constant3(tape, e3)));
}

/* y_d' = (1, 0, 2 s) */
static lg_var taped_velocity(lg_tape *tape, lg_taped_time t, lg_var like) {
    if (!lg_taped_time_varies(t)) return constant3(tape, parabola(t.value).v);
    lg_var up = lg_scale(tape, along_parabola(tape, t, like), 2.0);
    return lg_add(tape, lg_mul(tape, up, constant3(tape, e3)), constant3(tape, e1));
}

/* Computes A, A' and x = v' - g e3 from y and v (B, 1, 3); down = g e3. */
static void taped_track(const taped_system *s, lg_taped_time t, lg_var y, lg_var v, lg_var down, lg_var *A,
                        lg_var *dA, lg_var *x) {
    lg_tape *tape = s->tape;
    lg_var a = constant3(tape, parabola(0.0).a), kx = number(s, KX), kv = number(s, KV);
    lg_var e = lg_sub(tape, y, taped_position(tape, t, y)), de = lg_sub(tape, v, taped_velocity(tape, t, v));
    lg_var feedback = lg_add(tape, lg_mul(tape, kx, e), lg_mul(tape, kv, de));
    *A = lg_sub(tape, lg_sub(tape, a, feedback), down);
    *x = taped_payload(s, *A);
    lg_var dde = lg_sub(tape, lg_add(tape, *x, down), a);
    *dA = lg_neg(tape, lg_add(tape, lg_mul(tape, kx, de), lg_mul(tape, kv, dde)));
}

/* Parts of y: (y, v) (B, 6); R_1 (B, 1, 9); Omega_1 (B, 3); R_2; Omega_2; q (B, 2, 3); omega (B, 2, 3). */
static lg_status taped(const lg_system *system, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                       lg_var parameter, lg_var *algebra) {
    const taped_system s = taped_system_of(tape, parameter, y[5], y[6]);
    const lg_shape flat = lg_var_shape(tape, y[0]), vector = lg_shape3(flat.dims[0], 1, 3);
    lg_var position = lg_reshape(tape, lg_slice(tape, y[0], 1, POSITION, 3), vector);
    lg_var velocity = lg_reshape(tape, lg_slice(tape, y[0], 1, VELOCITY, 3), vector);
    lg_var down = lg_mul(tape, number(&s, GRAVITY), constant3(tape, e3));
    lg_var J = lg_slice(tape, parameter, 0, INERTIA, 3), A, dA, x;
    taped_track(&s, t, position, velocity, down, &A, &dA, &x);
    lg_var rates[2] = {velocity, lg_add(tape, x, down)};
    algebra[0] = lg_reshape(tape, lg_concat(tape, rates, 2, 2), flat);
    taped_attitude(tape, J, y + 1, algebra + 1);
    taped_attitude(tape, J, y + 3, algebra + 3);
    algebra[5] = y[6];
    lg_var c = taped_wanted_acceleration(&s, A, dA);
    algebra[6] = lg_cross(tape, y[5], taped_link_acceleration(&s, x, c));
    return lg_tape_status(tape);
}

const lg_system_row lg_system_row_quadrotors = {
    .name = "quadrotors",
    .parameters = parameters,
    .state = state,
    .space = space,
    .invariants = no_invariants,
    .field = {field, NULL},
    .taped = taped,
};

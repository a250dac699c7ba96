/* Two quadrotors with a payload: Newton's laws for the three masses, the control law written with dense
 * algebra, the closed form of a planar start; then attitudes under their controllers. */
#include "mechanics/system_check.h"

enum { DIM = 42, LINKS = 18, ALGEBRA = 30 };
enum { Y = 0, V = 3, Q = 6, W = 9, LINK = 6, R = 18, RATE = 27, NEXT = 12 };

static const double J[3] = {0.0820, 0.0845, 0.1377}, payload = 0.4, masses[2] = {0.755, 0.9},
                    lengths[2] = {0.6, 0.8}, gravity = 9.81, gains[4] = {4.0, 4.0, 100.0, 20.0}, kR = 50.0,
                    kOmega = 4.0;
#define BETA 0.52359877559829887

static const char *const forms[] = {"exact-thrusts", "attitudes"};

static lg_system *make_quadrotors(const char *form) {
    return make_system("quadrotors", form, &(lg_named_values){"masses", masses, 2}, 1);
}

/* The form attitudes, with these gains. */
static lg_system *make_stiff(double attitude, double rate) {
    const lg_named_values given[] = {{"masses", masses, 2}, {"kR", &attitude, 1}, {"kOmega", &rate, 1}};
    return make_system("quadrotors", "attitudes", given, 3);
}

static void random_state(lg_rng *rng, double *y) {
    for (int i = 0; i < 6; i++) y[i] = lg_rng_uniform_in(rng, -1, 1);
    for (int i = 0; i < 2; i++) {
        double *q = y + Q + i * LINK, u[3], w[3];
        random_rotation(rng, y + R + i * NEXT);
        for (int j = 0; j < 3; j++) y[RATE + i * NEXT + j] = lg_rng_uniform_in(rng, -2, 2);
        for (int j = 0; j < 3; j++)
            u[j] = lg_rng_uniform_in(rng, -0.4, 0.4) + (j == 0 ? 0.7 - 1.4 * i : j == 2);
        for (int j = 0; j < 3; j++) w[j] = lg_rng_uniform_in(rng, -1, 1);
        const double norm = sqrt(lg_dot3(u, u));
        for (int j = 0; j < 3; j++) q[j] = u[j] / norm;
        lg_cross3(q, w, q + 3);
    }
}

static void reference(double t, double yd[3][3]) {
    const double values[3][3] = {
        {t - 2.5, 0.0, (t - 2.5) * (t - 2.5) - 7.0}, {1.0, 0.0, 2.0 * (t - 2.5)}, {0, 0, 2}};
    memcpy(yd, values, sizeof(values));
}

static void wanted_force(double t, const double *y, double A[3]) {
    double yd[3][3];
    reference(t, yd);
    for (int i = 0; i < 3; i++)
        A[i] = yd[2][i] - gains[0] * (y[Y + i] - yd[0][i]) - gains[1] * (y[V + i] - yd[1][i]) -
               (i == 2 ? gravity : 0.0);
}

/* The wanted direction q_d of link i at t, y, v. */
static void wanted_direction(double t, const double *y, int i, double out[3]) {
    double A[3], d[3], n[3], arm[3];
    wanted_force(t, y, A);
    for (int j = 0; j < 3; j++) d[j] = -A[j] / sqrt(lg_dot3(A, A));
    for (int j = 0; j < 3; j++) n[j] = (j == 1) - d[1] * d[j];
    const double norm = sqrt(lg_dot3(n, n));
    for (int j = 0; j < 3; j++) n[j] /= norm;
    lg_cross3(n, d, arm);
    for (int j = 0; j < 3; j++) out[j] = cos(BETA) * d[j] + (i == 0 ? 1.0 : -1.0) * sin(BETA) * arm[j];
}

/* Solves M x = b, 3 x 3, by Cramer's rule. */
static void cramer(const double M[9], const double b[3], double x[3]) {
    double columns[3][3], cross[3];
    for (int c = 0; c < 3; c++)
        for (int r = 0; r < 3; r++) columns[c][r] = M[3 * r + c];
    lg_cross3(columns[1], columns[2], cross);
    const double det = lg_dot3(columns[0], cross);
    for (int c = 0; c < 3; c++) {
        double kept[3];
        memcpy(kept, columns[c], sizeof(kept));
        memcpy(columns[c], b, sizeof(kept));
        lg_cross3(columns[1], columns[2], cross);
        x[c] = lg_dot3(columns[0], cross) / det;
        memcpy(columns[c], kept, sizeof(kept));
    }
}

/* The thrusts u_1, u_2 that the control law asks for. q_d' is computed by differences along the motion with
 * v' = x + g e3. */
static void asked_thrusts(double t, const double *y, double u[2][3]) {
    double A[3], s[2], force[3] = {0, 0, 0}, M[9] = {0}, x[3], along[2];
    const double *q[2] = {y + Q, y + Q + LINK}, *w[2] = {y + W, y + W + LINK};
    wanted_force(t, y, A);
    /* s minimises |s_1 q_1 + s_2 q_2 - payload A|. The normal equations are solved by projection on q_1
     * and on the part of q_2 orthogonal to q_1. */
    const double b = lg_dot3(q[0], q[1]), r0 = payload * lg_dot3(q[0], A), r1 = payload * lg_dot3(q[1], A);
    s[1] = (r1 - b * r0) / (1.0 - b * b);
    s[0] = r0 - b * s[1];
    for (int i = 0; i < 2; i++) {
        const double m = masses[i], centrifugal = m * lengths[i] * lg_dot3(w[i], w[i]);
        along[i] = m * lg_dot3(q[i], A) + centrifugal + s[i];
        for (int j = 0; j < 3; j++) {
            force[j] += (along[i] - centrifugal) * q[i][j];
            for (int k = 0; k < 3; k++) M[3 * j + k] += m * q[i][j] * q[i][k];
        }
    }
    for (int j = 0; j < 3; j++) M[4 * j] += payload;
    cramer(M, force, x);
    for (int i = 0; i < 2; i++) {
        double qd[3], dqd[3] = {0, 0, 0}, at[3], moved[DIM], wd[3], turn[3], wq[3], qx[3], across[3], c[3];
        static const double stencil[4][2] = {{-2, 1.0 / 12}, {-1, -2.0 / 3}, {1, 2.0 / 3}, {2, -1.0 / 12}};
        const double delta = 1e-3;
        wanted_direction(t, y, i, qd);
        for (int k = 0; k < 4; k++) {
            const double h = delta * stencil[k][0];
            for (int j = 0; j < 3; j++) {
                moved[Y + j] = y[Y + j] + h * y[V + j];
                moved[V + j] = y[V + j] + h * (x[j] + (j == 2 ? gravity : 0.0));
            }
            wanted_direction(t + h, moved, i, at);
            for (int j = 0; j < 3; j++) dqd[j] += stencil[k][1] / delta * at[j];
        }
        lg_cross3(qd, dqd, wd);
        lg_cross3(qd, q[i], turn);
        lg_cross3(w[i], q[i], wq);
        lg_cross3(q[i], x, qx);
        const double spin = lg_dot3(q[i], wd);
        for (int j = 0; j < 3; j++) {
            c[j] = -gains[2] * turn[j] - gains[3] * (w[i][j] - wd[j] + spin * q[i][j]) - spin * wq[j];
            across[j] = masses[i] * qx[j] - masses[i] * lengths[i] * c[j];
        }
        lg_cross3(q[i], across, u[i]);
        for (int j = 0; j < 3; j++) u[i][j] = along[i] * q[i][j] - u[i][j];
    }
}

/* Acceleration of quadrotor i, which is at y - L_i q_i. */
static void quadrotor_acceleration(const double *y, const double *dy, int i, double out[3]) {
    const double *q = y + Q + i * LINK, *w = q + 3, *dw = dy + W + i * LINK;
    double a[3], b[3];
    lg_cross3(dw, q, a);
    lg_cross3(w, q, b);
    lg_cross3(w, b, b);
    for (int j = 0; j < 3; j++) out[j] = dy[V + j] - lengths[i] * (a[j] + b[j]);
}

/* ---- attitudes ---- */

/* R_c for the thrust u: its third column is -u/|u|, its first one has no part along e_2 x that. */
static void wanted_attitude(const double u[3], double Rc[9]) {
    double b[3][3], e1[3] = {1, 0, 0};
    for (int j = 0; j < 3; j++) b[2][j] = -u[j] / sqrt(lg_dot3(u, u));
    for (int j = 0; j < 3; j++) b[0][j] = e1[j] - b[2][0] * b[2][j];
    const double norm = sqrt(lg_dot3(b[0], b[0]));
    for (int j = 0; j < 3; j++) b[0][j] /= norm;
    lg_cross3(b[2], b[0], b[1]);
    for (int j = 0; j < 3; j++)
        for (int c = 0; c < 3; c++) Rc[3 * j + c] = b[c][j];
}

/* e_R = (R_c^T R - R^T R_c)^vee/2. Returns Psi = tr(I - R_c^T R)/2, which is 1 - cos of the angle. */
static double attitude_error(const double Rc[9], const double *m, double out[3]) {
    double E[9] = {0};
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) E[3 * r + c] += Rc[3 * k + r] * m[3 * k + c];
    for (int j = 0; j < 3; j++) {
        const int k = (j + 1) % 3, l = (j + 2) % 3;
        out[j] = 0.5 * (E[3 * l + k] - E[3 * k + l]);
    }
    return 0.5 * (3.0 - E[0] - E[4] - E[8]);
}

/* The thrusts that act: exactly, or along the third axis of each body. */
static void thrusts(double t, const double *y, bool attitudes, double u[2][3]) {
    asked_thrusts(t, y, u);
    for (int i = 0; i < 2 && attitudes; i++) {
        const double *m = y + R + i * NEXT, b[3] = {m[2], m[5], m[8]}, size = lg_dot3(u[i], b);
        for (int j = 0; j < 3; j++) u[i][j] = size * b[j];
    }
}

/* The largest Psi of both quadrotors. */
static double largest_psi(double t, const double *y) {
    double u[2][3], Rc[9], e[3], worst = 0.0;
    asked_thrusts(t, y, u);
    for (int i = 0; i < 2; i++) {
        wanted_attitude(u[i], Rc);
        worst = fmax(worst, attitude_error(Rc, y + R + i * NEXT, e));
    }
    return worst;
}

/* Sets R_i = R_c and Omega_i = 0. */
static void align(double t, double *y) {
    double u[2][3];
    asked_thrusts(t, y, u);
    for (int i = 0; i < 2; i++) {
        wanted_attitude(u[i], y + R + i * NEXT);
        memset(y + RATE + i * NEXT, 0, 3 * sizeof *y);
    }
}

/* On each quadrotor act its thrust, gravity and the tension T_i of its link; on the payload act gravity and
 * both tensions. */
TEST("the three masses obey Newton's laws under the thrusts that act") {
    lg_rng rng = test_rng(31, 0);
    for (int trial = 0; trial < 10; trial++) {
        const bool attitudes = trial % 2 == 1;
        const double t = lg_rng_uniform_in(&rng, 0, 5);
        double y[DIM], dy[DIM], u[2][3], a[3], pull[3] = {0, 0, 0};
        random_state(&rng, y);
        velocity(make_quadrotors(forms[attitudes]), t, y, dy);
        thrusts(t, y, attitudes, u);
        for (int i = 0; i < 2; i++) {
            const double *q = y + Q + i * LINK, m = masses[i];
            double rest[3];
            quadrotor_acceleration(y, dy, i, a);
            for (int j = 0; j < 3; j++) rest[j] = m * a[j] - u[i][j] - (j == 2 ? m * gravity : 0.0);
            const double tension = -lg_dot3(q, rest);
            for (int j = 0; j < 3; j++) {
                assert_close(rest[j], -tension * q[j], 1e-8, 1e-8);
                pull[j] += tension * q[j];
            }
        }
        for (int j = 0; j < 3; j++)
            assert_close(payload * (dy[V + j] - (j == 2 ? gravity : 0.0)), pull[j], 1e-8, 1e-8);
    }
}

TEST("positions, links and attitudes change with their velocities") {
    lg_rng rng = test_rng(32, 0);
    double y[DIM], dy[DIM], cross[3];
    random_state(&rng, y);
    velocity(make_quadrotors("attitudes"), 0.3, y, dy);
    for (int j = 0; j < 3; j++) assert_close(dy[Y + j], y[V + j], 0.0, 0.0);
    for (int i = 0; i < 2; i++) {
        const double *m = y + R + i * NEXT, *rate = y + RATE + i * NEXT, *q = y + Q + i * LINK;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) { /* R hat(Omega) */
                const int d = (c + 1) % 3, e = (c + 2) % 3;
                assert_close(dy[R + i * NEXT + 3 * r + c], m[3 * r + d] * rate[e] - m[3 * r + e] * rate[d],
                             0.0, 1e-14);
            }
        lg_cross3(q + 3, q, cross);
        for (int j = 0; j < 3; j++) assert_close(dy[Q + i * LINK + j], cross[j], 0.0, 1e-15);
        /* q.omega' + q'.omega = 0. */
        assert_close(lg_dot3(q, dy + W + i * LINK) + lg_dot3(cross, q + 3), 0.0, 0.0, 1e-11);
    }
}

/* J Omega' = -kR e_R - kOmega Omega, for the moment cancels Omega x J Omega: at constant R_c the energy
 * Omega.J Omega/2 + kR Psi falls by kOmega |Omega|^2. */
TEST("each body obeys Euler's equation under the moment of its controller") {
    lg_rng rng = test_rng(33, 0);
    lg_system *system = make_quadrotors("attitudes");
    for (int trial = 0; trial < 5; trial++) {
        double y[DIM], dy[DIM], u[2][3], Rc[9], e[3];
        random_state(&rng, y);
        velocity(system, 0.7, y, dy);
        asked_thrusts(0.7, y, u);
        for (int i = 0; i < 2; i++) {
            const double *rate = y + RATE + i * NEXT, *drate = dy + RATE + i * NEXT;
            double power = 0.0;
            wanted_attitude(u[i], Rc);
            (void)attitude_error(Rc, y + R + i * NEXT, e);
            for (int j = 0; j < 3; j++) {
                assert_close(J[j] * drate[j], -kR * e[j] - kOmega * rate[j], 1e-8, 1e-7);
                power += rate[j] * J[j] * drate[j] + kR * e[j] * rate[j];
            }
            assert_close(power, -kOmega * lg_dot3(rate, rate), 1e-8, 1e-6);
            /* e_R.Omega is the derivative of Psi along R' = R hat(Omega). */
            double moved[9], step[9], none[3], psi[2];
            for (int k = 0; k < 2; k++) {
                const double h = k == 0 ? -1e-5 : 1e-5, w[3] = {h * rate[0], h * rate[1], h * rate[2]};
                lg_so3_exp(w, step);
                for (int r = 0; r < 3; r++)
                    for (int c = 0; c < 3; c++) {
                        moved[3 * r + c] = 0.0;
                        for (int l = 0; l < 3; l++)
                            moved[3 * r + c] += y[R + i * NEXT + 3 * r + l] * step[3 * l + c];
                    }
                psi[k] = attitude_error(Rc, moved, none);
            }
            assert_close((psi[1] - psi[0]) / 2e-5, lg_dot3(e, rate), 1e-6, 1e-8);
        }
    }
}

static void thesis_start(double *y) {
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const double angle = 80.0 * acos(-1.0) / 180.0;
    memset(y, 0, DIM * sizeof(*y));
    y[Y] = -2.0;
    for (int i = 0; i < 2; i++) {
        memcpy(y + R + i * NEXT, identity, sizeof(identity));
        y[Q + i * LINK] = (i == 0 ? 1.0 : -1.0) * sin(angle);
        y[Q + i * LINK + 2] = cos(angle);
    }
}

/* While links and error stay in a plane, y - y_d = (e0 + (e0' + 2 e0) t) exp(-2 t), and the links approach
 * their wanted directions. */
TEST("a planar start follows its closed form") {
    enum { POINTS = 10 };
    const double e0[3] = {0.5, 0.0, 0.75}, de0[3] = {-1.0, 0.0, 5.0};
    double y0[DIM], times[POINTS], y[POINTS * LINKS], yd[3][3], qd[3], worst = 0.0, direction = 0.0;
    lg_system *system = make_quadrotors("exact-thrusts");
    thesis_start(y0);
    for (int n = 0; n < POINTS; n++) times[n] = 0.5 * (n + 1);
    integrate(system, 1e-12, y0, times, POINTS, y);
    for (int n = 0; n < POINTS; n++) {
        const double t = times[n], *at = y + n * LINKS;
        reference(t, yd);
        for (int j = 0; j < 3; j++) {
            const double slope = de0[j] + 2.0 * e0[j], decay = exp(-2.0 * t), e = (e0[j] + slope * t) * decay;
            const double de = slope * decay - 2.0 * e;
            worst = fmax(worst, fabs(at[Y + j] - yd[0][j] - e));
            worst = fmax(worst, fabs(at[V + j] - yd[1][j] - de));
        }
        assert_true(lg_space_manifold_error(lg_system_space(system), at) < 1e-13);
    }
    for (int i = 0; i < 2; i++) {
        const double *at = y + (POINTS - 1) * LINKS;
        wanted_direction(5.0, at, i, qd);
        for (int j = 0; j < 3; j++) direction = fmax(direction, fabs(at[Q + i * LINK + j] - qd[j]));
    }
    printf("closed form: %.2e, directions of the links at t = 5: %.2e\n", worst, direction);
    assert_true(worst < 1e-9);
    assert_true(direction < 0.02);
}

TEST("bodies that point where they should give the motion of exact thrusts") {
    lg_rng rng = test_rng(34, 0);
    for (int trial = 0; trial < 5; trial++) {
        double y[DIM], with[ALGEBRA], without[LINKS];
        random_state(&rng, y);
        align(1.1, y);
        evaluate(make_quadrotors("attitudes"), 1.1, y, with);
        evaluate(make_quadrotors("exact-thrusts"), 1.1, y, without);
        for (int j = 0; j < LINKS; j++) assert_close(with[j], without[j], 1e-7, 1e-7);
        for (int j = LINKS; j < ALGEBRA; j++) assert_close(with[j], 0.0, 0.0, 1e-5);
    }
}

/* The largest distance of the payload from that with exact thrusts over time, and at the end. */
static double follow(lg_system *system, const double *y0, double *end, double *psi) {
    enum { POINTS = 40 };
    double times[POINTS], y[POINTS * DIM], ideal[POINTS * LINKS], worst = 0.0;
    for (int n = 0; n < POINTS; n++) times[n] = 0.2 * (n + 1);
    integrate(system, 1e-8, y0, times, POINTS, y);
    integrate(make_quadrotors("exact-thrusts"), 1e-8, y0, times, POINTS, ideal);
    for (int n = 0; n < POINTS; n++) {
        const double *a = y + n * DIM + Y, *b = ideal + n * LINKS + Y;
        const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
        *end = sqrt(lg_dot3(d, d));
        worst = fmax(worst, *end);
        assert_true(lg_space_manifold_error(lg_system_space(system), y + n * DIM) < 1e-13);
    }
    *psi = largest_psi(times[POINTS - 1], y + (POINTS - 1) * DIM);
    return worst;
}

TEST("attitudes reach their wanted values, and the payload follows its path") {
    static const struct {
        double kR, kOmega, worst, end;
    } rows[] = {{50, 4, 0.5, 1e-3}, {800, 16, 0.1, 1e-3}, {3200, 32, 0.05, 1e-3}};
    double y0[DIM], before = INFINITY;
    thesis_start(y0);
    assert_true(largest_psi(0.0, y0) > 0.01);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        double end, psi;
        const double worst = follow(make_stiff(rows[i].kR, rows[i].kOmega), y0, &end, &psi);
        printf("kR %g: payload off by at most %.2e m, %.2e m at the end; Psi at the end %.2e\n", rows[i].kR,
               worst, end, psi);
        assert_true(worst < rows[i].worst && worst < before);
        assert_true(end < rows[i].end);
        assert_true(psi < 1e-6);
        before = worst;
    }
}

/* The relative tolerances of y, v and Omega follow whole vectors: turned bodies push the payload out of the
 * plane, where each coordinate begins as a high power of the time. */
TEST("bodies that are turned about their axes start with the default tolerances") {
    for (int way = 0; way < 3; way++) {
        double y0[DIM], y[DIM];
        const double turn[3] = {0, 0, way == 0 ? 0.01 : acos(0.0)}, at = 0.5;
        double work[SYSTEM_MAX_DIM];
        lg_system_user user;
        lg_ode ode;
        lg_stepper *stepper = NULL;
        lg_step_controller control;
        lg_run_stats stats;
        thesis_start(y0);
        if (way < 2)
            for (int i = 0; i < 2; i++) lg_so3_exp(turn, y0 + R + i * NEXT);
        else
            y0[RATE] = 0.1;
        lg_step_controller_init(&control);
        control.rtol = 1e-9;
        control.atol = -1e-13;
        assert_ok(lg_system_ode(make_quadrotors("attitudes"), LG_COORDINATES_LIE, &ode, &user, work));
        assert_ok(lg_stepper_create(NULL, lg_scheme_find("rkmk54"), &ode, &stepper));
        assert_ok(lg_integrate_adaptive(stepper, &control, 0.0, y0, &at, 1, y, &stats));
        lg_stepper_destroy(stepper);
        assert_in_range(stats.steps, 10, 1000);
    }
}

TEST("quadrotors that begin nearly upside down recover") {
    for (int axis = 0; axis < 3; axis++) {
        double y0[DIM], turn[3] = {0, 0, 0}, end, psi;
        thesis_start(y0);
        turn[axis] = acos(-1.0) - 0.01;
        for (int i = 0; i < 2; i++) lg_so3_exp(turn, y0 + R + i * NEXT);
        const double worst = follow(make_stiff(800, 16), y0, &end, &psi);
        printf("turned about e%d: payload off by at most %.2e m, %.2e m at the end; Psi %.2e\n", axis + 1,
               worst, end, psi);
        assert_true(worst < 3.0 && end < 1e-3 && psi < 1e-6);
    }
}

/* From aligned bodies to t = 0.2, against RKMK(5,4) at a tolerance of 1e-13. */
TEST("Lie group schemes have their orders with attitudes") {
    static const struct {
        const char *scheme;
        double order, h;
    } rows[] = {{"lie-euler", 1, 2e-3}, {"rkmk3", 3, 1e-2}, {"rkmk4", 4, 1e-2}, {"cf4", 4, 1e-2}};
    enum { LEVELS = 6 };
    const double at = 0.2;
    double y0[DIM], exact[DIM], path[2 * DIM], work[SYSTEM_MAX_DIM], *y = path + DIM;
    lg_system *system = make_quadrotors("attitudes");
    lg_system_user user;
    lg_ode ode;
    thesis_start(y0);
    align(0.0, y0);
    integrate(system, 1e-13, y0, &at, 1, exact);
    assert_ok(lg_system_ode(system, LG_COORDINATES_LIE, &ode, &user, work));
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        double sum[4] = {0, 0, 0, 0}; /* of x, z, x x, x z with x = log h, z = log error */
        int points = 0;
        for (int level = 0; level < LEVELS; level++) {
            const double h = ldexp(rows[r].h, -level);
            double error = 0.0;
            lg_stepper *stepper = NULL;
            assert_ok(lg_stepper_create(NULL, lg_scheme_find(rows[r].scheme), &ode, &stepper));
            const size_t steps = (size_t)(at / h + 0.5);
            assert_ok(lg_integrate_fixed(stepper, 0.0, h, steps, NULL, 0, steps, y0, path, NULL));
            lg_stepper_destroy(stepper);
            for (int j = 0; j < DIM; j++) error = fmax(error, fabs(y[j] - exact[j]));
            assert_true(lg_space_manifold_error(lg_system_space(system), y) < 1e-13);
            if (error < 1e-11 || (error > 1e-3 && rows[r].order > 1)) continue;
            const double x = log(h), z = log(error);
            sum[0] += x, sum[1] += z, sum[2] += x * x, sum[3] += x * z;
            points++;
        }
        const double slope = (points * sum[3] - sum[0] * sum[1]) / (points * sum[2] - sum[0] * sum[0]);
        printf("%s: order %.2f from %d step sizes\n", rows[r].scheme, slope, points);
        assert_true(points >= 5);
        assert_close(slope, rows[r].order, 0.0, 0.25);
    }
}

/* A = 0 at y = y_d, v = y_d' where gravity equals y_d''. */
TEST("parallel links and an undefined wanted direction end a run, and the system has no energy") {
    const double weak = 2.0;
    for (int form = 0; form < 2; form++) {
        lg_system *systems[] = {
            make_quadrotors(forms[form]),
            make_system("quadrotors", forms[form], &(lg_named_values){"gravity", &weak, 1}, 1)};
        for (int bad = 0; bad < 2; bad++) {
            double y[DIM], work[SYSTEM_MAX_DIM], out[2 * DIM], yd[3][3];
            lg_system_user user;
            lg_ode ode;
            lg_stepper *stepper = NULL;
            thesis_start(y);
            assert_true(isnan(lg_system_hamiltonian(systems[bad], y, work)));
            reference(0.0, yd);
            if (bad == 0)
                for (int i = 0; i < 6; i++) y[Q + i / 3 * LINK + i % 3] = i % 3 == 2;
            else
                for (int i = 0; i < 3; i++) y[Y + i] = yd[0][i], y[V + i] = yd[1][i];
            assert_ok(lg_system_ode(systems[bad], LG_COORDINATES_LIE, &ode, &user, work));
            assert_ok(lg_stepper_create(NULL, lg_scheme_find("rkmk4"), &ode, &stepper));
            assert_status(lg_integrate_fixed(stepper, 0.0, 0.01, 1, NULL, 0, 1, y, out, NULL), LG_NOT_FINITE);
            lg_stepper_destroy(stepper);
        }
    }
}

/* Two quadrotors with a payload: Newton's laws for the three masses, the control law written with dense
 * algebra, and the closed form of a planar start. */
#include "mechanics/system_check.h"

enum { DIM = 42, ALGEBRA = 30 };
enum { Y = 0, V = 3, R = 6, RATE = 15, NEXT = 12, Q = 30, W = 33, LINK = 6 };

static const double J[3] = {0.0820, 0.0845, 0.1377}, payload = 0.4, masses[2] = {0.755, 0.9},
                    lengths[2] = {0.6, 0.8}, gravity = 9.81, gains[4] = {4.0, 4.0, 100.0, 20.0};
#define BETA 0.52359877559829887

static lg_system *make_quadrotors(void) {
    return make_system("quadrotors", NULL, &(lg_named_values){"masses", masses, 2}, 1);
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

/* The thrusts u_1, u_2. q_d' is computed by differences along the motion with v' = x + g e3. */
static void thrusts(double t, const double *y, double u[2][3]) {
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

/* On each quadrotor act its thrust, gravity and the tension T_i of its link; on the payload act gravity and
 * both tensions. */
TEST("the three masses obey Newton's laws under the thrusts of the control law") {
    lg_rng rng = test_rng(31, 0);
    lg_system *system = make_quadrotors();
    for (int trial = 0; trial < 5; trial++) {
        const double t = lg_rng_uniform_in(&rng, 0, 5);
        double y[DIM], dy[DIM], u[2][3], a[3], pull[3] = {0, 0, 0};
        random_state(&rng, y);
        velocity(system, t, y, dy);
        thrusts(t, y, u);
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

TEST("positions, attitudes and links change with their velocities") {
    lg_rng rng = test_rng(32, 0);
    lg_system *system = make_quadrotors();
    double y[DIM], dy[DIM], cross[3];
    random_state(&rng, y);
    velocity(system, 0.3, y, dy);
    for (int j = 0; j < 3; j++) assert_close(dy[Y + j], y[V + j], 0.0, 0.0);
    for (int i = 0; i < 2; i++) {
        const double *m = y + R + i * NEXT, *rate = y + RATE + i * NEXT, *q = y + Q + i * LINK;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) { /* R hat(Omega) */
                const int d = (c + 1) % 3, e = (c + 2) % 3;
                assert_close(dy[R + i * NEXT + 3 * r + c], m[3 * r + d] * rate[e] - m[3 * r + e] * rate[d],
                             0.0, 1e-14);
            }
        for (int j = 0; j < 3; j++) {
            const int k = (j + 1) % 3, l = (j + 2) % 3;
            assert_close(J[j] * dy[RATE + i * NEXT + j], (J[k] - J[l]) * rate[k] * rate[l], 1e-13, 1e-15);
        }
        lg_cross3(q + 3, q, cross);
        for (int j = 0; j < 3; j++) assert_close(dy[Q + i * LINK + j], cross[j], 0.0, 1e-15);
        /* q.omega' + q'.omega = 0. */
        assert_close(lg_dot3(q, dy + W + i * LINK) + lg_dot3(cross, q + 3), 0.0, 0.0, 1e-11);
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
    double y0[DIM], times[POINTS], y[POINTS * DIM], yd[3][3], qd[3], worst = 0.0, direction = 0.0;
    lg_system *system = make_quadrotors();
    thesis_start(y0);
    for (int n = 0; n < POINTS; n++) times[n] = 0.5 * (n + 1);
    integrate(system, 1e-12, y0, times, POINTS, y);
    for (int n = 0; n < POINTS; n++) {
        const double t = times[n], *at = y + n * DIM;
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
        const double *at = y + (POINTS - 1) * DIM;
        wanted_direction(5.0, at, i, qd);
        for (int j = 0; j < 3; j++) direction = fmax(direction, fabs(at[Q + i * LINK + j] - qd[j]));
    }
    printf("closed form: %.2e, directions of the links at t = 5: %.2e\n", worst, direction);
    assert_true(worst < 1e-9);
    assert_true(direction < 0.02);
}

TEST("parallel links cannot hold the payload, and the system has no energy") {
    double y[DIM], work[SYSTEM_MAX_DIM], algebra[ALGEBRA];
    lg_system *system = make_quadrotors();
    lg_system_user user;
    lg_ode ode;
    thesis_start(y);
    assert_true(isnan(lg_system_hamiltonian(system, y, work)));
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 3; j++) y[Q + i * LINK + j] = j == 2;
    assert_ok(lg_system_ode(system, LG_COORDINATES_LIE, &ode, &user, work));
    assert_status(ode.field(ode.user, 0.0, y, NULL, algebra), LG_NOT_FINITE);
}

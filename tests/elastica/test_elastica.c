/* The discrete elastica: description, known energies and nodes, derivatives and Euler-Lagrange equations
 * against differences, minima, rotated frames, hard cases and invalid input. */
#include "liegrad/elastica.h"
#include "test_support.h"

#define PI     3.14159265358979323846
#define POINTS 1001

static double theta[POINTS], other[POINTS], q[2 * POINTS], v[2 * POINTS], multiplier[POINTS];

static lg_elastica family(lg_elastica_case kind, double x, uint32_t n) {
    lg_elastica p;
    lg_elastica_init(&p);
    lg_elastica_set_case(&p, kind, x);
    p.intervals = n;
    return p;
}

static lg_elastica_solution solved(const lg_elastica *p) {
    lg_elastica_solution s;
    assert_told(lg_elastica_solve(NULL, p, NULL, theta, &s, &told));
    return s;
}

/* ---- descriptions ---- */

TEST("boundary values of both families agree with those by hand") {
    lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.5 * PI, 50);
    assert_close(p.theta0, 0.5 * PI, 0, 1e-15);
    assert_close(p.rotation, -PI, 0, 1e-15);
    p = family(LG_ELASTICA_BOTH_ENDS, 1.5 * PI, 50);
    assert_close(p.theta0, -0.5 * PI, 0, 1e-15);
    p = family(LG_ELASTICA_RIGHT_END, 2.0, 50);
    assert_close(p.theta0, 0.0, 0, 0);
    assert_close(p.rotation, -2.0, 0, 1e-15);
    assert_close(family(LG_ELASTICA_BOTH_ENDS, -PI, 50).theta0, PI, 0, 0); /* angles are in (-pi, pi] */
    assert_string_equal(lg_elastica_case_name(LG_ELASTICA_RIGHT_END), "right-end");
    assert_string_equal(lg_elastica_case_name((lg_elastica_case)LG_ELASTICA_CASE_COUNT), "unknown");
    const lg_elastica before = p;
    lg_elastica_set_case(&p, (lg_elastica_case)LG_ELASTICA_CASE_COUNT, 1.0);
    assert_memory_equal(&p, &before, sizeof p);
}

static void refused(const lg_elastica *p, const lg_elastica_options *o, lg_status status) {
    lg_error error;
    theta[0] = 77.0;
    assert_status(lg_elastica_solve(NULL, p, o, theta, NULL, &error), status);
    assert_true(strlen(error.message) > 10);
    assert_status(lg_elastica_solve_continuous(NULL, p, o, theta, q, NULL, NULL), status);
    assert_close(theta[0], 77.0, 0, 0);
}

TEST("invalid problems and options are refused, and nothing is written") {
    const lg_elastica good = family(LG_ELASTICA_BOTH_ENDS, 1.0, 50);
    lg_elastica_options defaults, o;
    lg_elastica p;
    lg_elastica_options_init(&defaults);
    assert_ok(lg_elastica_check(&good, NULL));
#define BAD(change, status) p = good, o = defaults, change, refused(&p, &o, status)
    BAD(p.theta0 = NAN, LG_NOT_FINITE);
    BAD(p.rotation = INFINITY, LG_NOT_FINITE);
    BAD(p.q0[1] = NAN, LG_NOT_FINITE);
    BAD(p.qN[0] = 3.3, LG_INVALID_ARGUMENT); /* straight: the chord is exactly the length */
    BAD(p.qN[1] = -4.0, LG_INVALID_ARGUMENT);
    BAD(p.length = 0.0, LG_INVALID_ARGUMENT);
    BAD(p.stiffness = -1.0, LG_INVALID_ARGUMENT);
    BAD((p.length = 1e160, p.qN[0] = 1.0), LG_INVALID_ARGUMENT);
    BAD((p.length = 1e-150, p.qN[0] = 1e-151), LG_INVALID_ARGUMENT);
    BAD((p.length = 1.0, p.qN[0] = 0.5, p.stiffness = 1e300), LG_INVALID_ARGUMENT);
    BAD((p.length = 1e-3, p.qN[0] = 5e-4, p.stiffness = 1e-311), LG_INVALID_ARGUMENT);
    BAD((p.length = 1e28, p.qN[0] = 5e27, p.stiffness = 1e308), LG_INVALID_ARGUMENT);
    BAD(p.intervals = 1, LG_INVALID_ARGUMENT);
    BAD(p.intervals = LG_ELASTICA_MAX_INTERVALS + 1, LG_INVALID_ARGUMENT);
    BAD(p.rotation = 41.0 * PI, LG_INVALID_ARGUMENT); /* more than twenty turns */
    BAD(p.theta0 = 1e7, LG_INVALID_ARGUMENT);
    BAD((p.q0[0] = -1.7e308, p.qN[0] = 1.7e308), LG_INVALID_ARGUMENT);
    BAD(o.gradient_tolerance = 0.0, LG_INVALID_ARGUMENT);
    BAD(o.gradient_tolerance = 1.0, LG_INVALID_ARGUMENT);
    BAD(o.max_step = NAN, LG_INVALID_ARGUMENT);
    BAD(o.max_step = 1.5, LG_INVALID_ARGUMENT);
    BAD(o.max_iterations = 0, LG_INVALID_ARGUMENT);
    BAD(o.size = 3, LG_INVALID_ARGUMENT);
    memset(other, 0, sizeof other);
    other[7] = NAN;
    BAD(o.guess = other, LG_NOT_FINITE);
#undef BAD
    assert_status(lg_elastica_check(NULL, NULL), LG_INVALID_ARGUMENT);
}

/* ---- energy, gradient, Euler-Lagrange equations ---- */

/* The action by its definition with Lambda = 0: trapezoidal rule for (EI/2)(|a-|^2 + |a+|^2). */
static double action(const lg_elastica *p, const double *nodes, const double *tangents) {
    const double h = p->length / p->intervals;
    double sum = 0.0;
    for (size_t k = 0; k < p->intervals; k++)
        for (size_t c = 0; c < 2; c++) {
            const double dq = nodes[2 * k + 2 + c] - nodes[2 * k + c];
            const double v0 = tangents[2 * k + c], v1 = tangents[2 * k + 2 + c];
            const double minus = ((-2.0 * v1 - 4.0 * v0) * h + 6.0 * dq) / (h * h);
            const double plus = ((4.0 * v1 + 2.0 * v0) * h - 6.0 * dq) / (h * h);
            sum += 0.5 * h * 0.5 * p->stiffness * (minus * minus + plus * plus);
        }
    return sum;
}

TEST("the energy is the discrete action") {
    lg_elastica p = family(LG_ELASTICA_RIGHT_END, 1.7, 20);
    p.q0[0] = 0.4;
    p.q0[1] = -0.3;
    for (size_t k = 0; k <= 20; k++) theta[k] = sin(1.0 + 0.7 * (double)k) - 0.1 * (double)k;
    lg_elastica_curve(&p, theta, q, v);
    assert_close(lg_elastica_energy(&p, theta), action(&p, q, v), 1e-13, 0);
    assert_close(q[40], p.qN[0], 0, 0);
    assert_close(q[1], p.q0[1], 0, 0);
}

/* d action / d(q_k, v_k) by central differences plus 2 h Lambda v must be zero at the solution, and so gives
 * the multipliers found. */
TEST("the solution satisfies the Euler-Lagrange equations, and errors of 1e-6 are noticed") {
    const lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.6 * PI, 50);
    const lg_elastica_solution s = solved(&p);
    const double h = p.length / p.intervals, step = 1e-5;
    lg_elastica_curve(&p, theta, q, v);
    const double residual = lg_elastica_euler_lagrange(&p, q, v, multiplier);
    assert_true(residual < 1e-9);
    assert_close(residual, s.residual, 0, 0);
    for (size_t k = 1; k < 50; k += 7)
        for (size_t c = 0; c < 2; c++) {
            double *const variables[2] = {q, v};
            double d[2];
            for (int i = 0; i < 2; i++) {
                double *x = &variables[i][2 * k + c];
                const double x0 = *x;
                *x = x0 + step;
                const double up = action(&p, q, v);
                *x = x0 - step;
                d[i] = (up - action(&p, q, v)) / (2.0 * step);
                *x = x0;
            }
            assert_close(d[0], 0.0, 0, 2e-6);
            assert_close(d[1] + 2.0 * h * multiplier[k - 1] * v[2 * k + c], 0.0, 0, 2e-6);
        }
    q[2 * 20] += 1e-6; /* a node that is moved is noticed */
    assert_true(lg_elastica_euler_lagrange(&p, q, v, NULL) > 1e-4);
    q[2 * 20] -= 1e-6;
    v[2 * 20] += 1e-6;
    assert_true(lg_elastica_euler_lagrange(&p, q, v, NULL) > 1e-6);
    double *const numbers[] = {&q[2 * 20], &v[2]};
    for (size_t i = 0; i < 2; i++) {
        const double kept = *numbers[i];
        *numbers[i] = NAN;
        assert_true(isnan(lg_elastica_euler_lagrange(&p, q, v, NULL)));
        *numbers[i] = kept;
    }
}

TEST("solutions are minima, and the force is dE/dq_N") {
    for (int kind = 0; kind < LG_ELASTICA_CASE_COUNT; kind++) {
        lg_elastica p = family((lg_elastica_case)kind, 2.3, 30);
        const lg_elastica_solution s = solved(&p);
        const double e = lg_elastica_energy(&p, theta);
        assert_close(s.energy, e, 1e-14, 0);
        assert_int_equal(s.negative_eigenvalues, 0);
        assert_true(s.gradient < 1e-11);
        for (size_t k = 1; k < 30; k++) {
            const double kept = theta[k];
            theta[k] = kept + 1e-4;
            const double up = lg_elastica_energy(&p, theta);
            theta[k] = kept - 1e-4;
            const double down = lg_elastica_energy(&p, theta);
            theta[k] = kept;
            assert_true(up > e && down > e);
            assert_close((up - down) / 2e-4, 0.0, 0, 1e-3);
        }
        for (int c = 0; c < 2; c++) {
            p.qN[c] += 1e-4;
            const double up = solved(&p).energy;
            p.qN[c] -= 2e-4;
            const double down = solved(&p).energy;
            p.qN[c] += 1e-4;
            assert_close((up - down) / 2e-4, s.force[c], 1e-5, 1e-5);
        }
    }
}

/* ---- known values ---- */

TEST("energies agree with known values") {
    const struct {
        double x;
        uint32_t n;
        double energy, atol;
    } rows[] = {{PI / 3.0, 1000, 9.695403610363, 1e-11},
                {PI / 2.0, 1000, 45.752542288901, 1e-11},
                {PI, 50, 420.415, 5e-4},
                {PI, 1000, 532.9, 5e-2}};
    for (size_t i = 0; i < 4; i++) {
        const lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, rows[i].x, rows[i].n);
        assert_close(solved(&p).energy, rows[i].energy, 0, rows[i].atol);
    }
}

/* For x of both families, including the edges next to the gap: a minimum with small residual, and its mirror
 * image. */
TEST("every member of both families is a minimum with a mirror image") {
    for (int i = 0; i < 120; i++) {
        const lg_elastica_case kind = (lg_elastica_case)(i % 2);
        const double x = PI * (0.01 + 0.98 * (i / 2) / 59.0);
        lg_elastica p = family(kind, x, 50);
        const lg_elastica_solution s = solved(&p);
        assert_int_equal(s.negative_eigenvalues, 0);
        assert_true(s.residual < 1e-9);
        memcpy(other, theta, 51 * sizeof(double));
        p = family(kind, 2.0 * PI - x, 50);
        assert_close(solved(&p).energy, s.energy, 1e-13, 0);
        for (size_t k = 0; k <= 50; k++) assert_close(theta[k], -other[k], 0, 1e-12);
    }
}

TEST("a problem that is moved, rotated and scaled has the same shape") {
    const double scale = 2.5, turn = 2.0, EI = 3.0;
    lg_elastica p = family(LG_ELASTICA_RIGHT_END, 2.0, 40);
    const lg_elastica_solution s = solved(&p);
    memcpy(other, theta, 41 * sizeof(double));
    p.length *= scale;
    p.stiffness *= EI;
    p.q0[0] = -7.0;
    p.q0[1] = 11.0;
    p.qN[0] = p.q0[0] + scale * 3.0 * cos(turn);
    p.qN[1] = p.q0[1] + scale * 3.0 * sin(turn);
    p.theta0 += turn + 4.0 * PI;
    const lg_elastica_solution moved = solved(&p);
    assert_close(moved.energy, s.energy * EI / scale, 1e-12, 0);
    const double unit = EI / scale / scale, c = cos(turn), r = sin(turn);
    assert_close(moved.force[0], unit * (c * s.force[0] - r * s.force[1]), 1e-9, 1e-9);
    assert_close(moved.force[1], unit * (r * s.force[0] + c * s.force[1]), 1e-9, 1e-9);
    for (size_t k = 0; k <= 40; k++) assert_close(theta[k], other[k] + turn + 4.0 * PI, 0, 1e-12);
    assert_close(theta[0], p.theta0, 0, 0);
    assert_close(theta[40], p.theta0 + p.rotation, 0, 0);
}

/* ---- initial guesses ---- */

TEST("a guess selects the minimum") {
    lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.1, 50);
    lg_elastica_options o;
    lg_elastica_solution s, first = solved(&p);
    lg_error error;
    lg_elastica_options_init(&o);
    o.guess = other;
    for (size_t k = 0; k <= 50; k++) other[k] = -0.7 * sin(2.0 * PI * (double)k / 50.0);
    assert_ok(lg_elastica_solve(NULL, &p, &o, theta, &s, &error)); /* the lower arch */
    assert_true(s.energy > first.energy + 4.0);
    for (size_t k = 0; k <= 50; k++) other[k] = 0.0;
    p = family(LG_ELASTICA_BOTH_ENDS, 0.0, 50);
    assert_status(lg_elastica_solve(NULL, &p, &o, theta, &s, &error), LG_NO_CONVERGENCE);
    assert_says(error.message, "no minimum");
    /* the straight compressed beam; the results are written all the same */
    assert_true(s.negative_eigenvalues > 0);
    assert_close(s.energy, 18.0 * 10.0 * 2500.0 / pow(3.3, 3.0) * 0.09, 1e-12, 0);
}

/* ---- hard cases ---- */

TEST("straight, half-turned and coarse beams have minima") {
    lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.0, 50);
    lg_elastica_solution s = solved(&p);
    assert_int_equal(s.negative_eigenvalues, 0);
    assert_true(theta[10] > 0.1); /* buckled upwards */
    assert_close(s.energy, 11.084103198529, 1e-11, 0);
    p = family(LG_ELASTICA_RIGHT_END, PI, 50);
    assert_close(solved(&p).energy, 130.730254824581, 1e-11, 0);
    for (uint32_t n = 2; n <= 5; n++)
        for (double x = 0.0; x < 3.0; x += 0.5) {
            p = family(LG_ELASTICA_RIGHT_END, x, n);
            s = solved(&p);
            assert_int_equal(s.negative_eigenvalues, 0);
            assert_true(s.gradient < 1e-10);
        }
    p = family(LG_ELASTICA_BOTH_ENDS, 1.0, 2); /* one inner angle, which is 0 by symmetry */
    (void)solved(&p);
    assert_close(theta[1], 0.0, 0, 1e-14);
}

TEST("if the ends meet the beam is a circle with E = (EI/2)(2 pi)^2/L, or with half a turn a drop") {
    lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.0, 1000);
    p.qN[0] = 0.0;
    p.theta0 = 0.4;
    p.rotation = 2.0 * PI;
    assert_close(solved(&p).energy, 5.0 * 4.0 * PI * PI / 3.3, 1e-5, 0);
    for (size_t k = 0; k <= 1000; k += 100)
        assert_close(theta[k], 0.4 + 2.0 * PI * (double)k / 1000.0, 0, 1e-9);
    p.intervals = 60;
    p.rotation = PI;
    assert_int_equal(solved(&p).negative_eigenvalues, 0);
}

TEST("beams with two turns have a minimum while the nodes resolve it") {
    lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.0, 100);
    p.qN[0] = 1.0;
    p.theta0 = 0.3;
    p.rotation = 4.0 * PI;
    assert_int_equal(solved(&p).negative_eigenvalues, 0);
    for (size_t k = 0; k < 100; k++) assert_true(fabs(theta[k + 1] - theta[k]) < 1.0);
    p.qN[0] = 3.25; /* loops with a radius smaller than the distance of the nodes */
    lg_error error;
    assert_status(lg_elastica_solve(NULL, &p, NULL, theta, NULL, &error), LG_NO_CONVERGENCE);
    assert_true(strlen(error.message) > 10);
}

TEST("beams taut to 1e-13 have minima") {
    for (double slack = 1e-2; slack > 1e-13; slack *= 1e-5) {
        lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 1.0, 50);
        p.qN[0] = 3.3 * (1.0 - slack);
        assert_int_equal(solved(&p).negative_eigenvalues, 0);
    }
}

TEST("problems with 10^5 intervals are solved") {
    const uint32_t n = 100000;
    const lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, PI / 3.0, n);
    double *angles = TEST_ARRAY(double, n + 1);
    lg_elastica_solution s;
    lg_error error;
    assert_ok(lg_elastica_solve(NULL, &p, NULL, angles, &s, &error));
    assert_close(s.energy, 9.69540085496, 1e-9, 0); /* the energy of the continuous problem up to O(h^2) */
    assert_int_equal(s.negative_eigenvalues, 0);
}

TEST("random problems with any chord and angles give a minimum or a message") {
    uint32_t seed = 7;
    int found = 0;
    for (int i = 0; i < 40; i++) {
        double u[4];
        for (int j = 0; j < 4; j++) {
            seed = seed * 1664525u + 1013904223u;
            u[j] = seed / 4294967296.0;
        }
        lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.0, 60);
        p.qN[0] = 3.0 * u[0] * cos(6.0 * u[1]);
        p.qN[1] = 3.0 * u[0] * sin(6.0 * u[1]);
        p.theta0 = 8.0 * u[2] - 4.0;
        p.rotation = 9.0 * u[3] - 4.5;
        lg_elastica_solution s;
        lg_error error = {LG_OK, ""};
        const lg_status status = lg_elastica_solve(NULL, &p, NULL, theta, &s, &error);
        if (status == LG_OK) {
            found++;
            assert_int_equal(s.negative_eigenvalues, 0);
            assert_true(s.residual < 1e-8);
        } else {
            assert_int_equal(status, LG_NO_CONVERGENCE);
            assert_true(strlen(error.message) > 10);
        }
    }
    assert_true(found >= 36);
}

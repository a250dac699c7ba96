/* The continuous elastica: against its own first integral, Richardson's extrapolation of discrete solutions,
 * and closed forms. */
#include "liegrad/elastica.h"
#include "test_support.h"

#define PI 3.14159265358979323846
#define N  2000

static double theta[4 * N + 1], q[2 * (4 * N + 1)], coarse[2 * N + 1], coarse_q[2 * (2 * N + 1)];

static lg_elastica family(lg_elastica_case kind, double share, uint32_t n) {
    lg_elastica p;
    lg_elastica_init(&p);
    lg_elastica_set_case(&p, kind, share * PI);
    p.intervals = n;
    return p;
}

static lg_elastica_solution solved(const lg_elastica *p) {
    lg_elastica_solution s;
    lg_error error;
    if (lg_elastica_solve_continuous(NULL, p, NULL, theta, q, &s, &error) != LG_OK)
        fail_msg("%s", error.message);
    assert_true(s.residual <= 1e-12);
    assert_int_equal(s.negative_eigenvalues, 0);
    return s;
}

static const double shares[] = {0.0, 0.01, 0.1, 1.0 / 3.0, 0.5, 0.8, 0.95, 0.99, 1.0, 1.01, 1.6};

TEST("the first integral is constant along every solution") {
    static const double weight[] = {4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0};
    for (size_t i = 0; i < 11; i++)
        for (int kind = 0; kind < LG_ELASTICA_CASE_COUNT; kind++) {
            const lg_elastica p = family((lg_elastica_case)kind, shares[i], N);
            const lg_elastica_solution s = solved(&p);
            const double h = p.length / N, scale = hypot(s.force[0], s.force[1]);
            double first = 0.0;
            for (size_t k = 4; k + 4 <= N; k += 83) {
                double slope = 0.0;
                for (size_t j = 1; j <= 4; j++) slope += weight[j - 1] * (theta[k + j] - theta[k - j]) / h;
                const double value = 0.5 * p.stiffness * slope * slope + s.force[0] * cos(theta[k]) +
                                     s.force[1] * sin(theta[k]);
                if (k == 4) first = value;
                assert_close(value, first, 0, 1e-9 * scale);
            }
        }
}

TEST("the curve and the differential equation hold") {
    for (size_t i = 0; i < 11; i++) {
        const lg_elastica p = family(LG_ELASTICA_RIGHT_END, shares[i], N);
        const lg_elastica_solution s = solved(&p);
        const double h = p.length / N;
        double x = 0.0, y = 0.0;
        for (size_t k = 0; k + 2 <= N; k += 2) {
            const double *t = theta + k;
            x += h / 3.0 * (cos(t[0]) + 4.0 * cos(t[1]) + cos(t[2]));
            y += h / 3.0 * (sin(t[0]) + 4.0 * sin(t[1]) + sin(t[2]));
            assert_close(q[2 * k + 4], x, 0, 1e-9);
            assert_close(q[2 * k + 5], y, 0, 1e-9);
            const double second = (t[0] - 2.0 * t[1] + t[2]) / (h * h);
            assert_close(p.stiffness * second, s.force[0] * sin(t[1]) - s.force[1] * cos(t[1]), 2e-3, 1e-2);
        }
    }
}

TEST("Richardson's extrapolation of discrete solutions meets the continuous one") {
    for (int kind = 0; kind < LG_ELASTICA_CASE_COUNT; kind++)
        for (size_t i = 0; i < 5; i++) {
            lg_elastica p = family((lg_elastica_case)kind, shares[i], N);
            lg_elastica_solution s;
            assert_ok(lg_elastica_solve(NULL, &p, NULL, coarse, &s, NULL));
            lg_elastica_curve(&p, coarse, coarse_q, NULL);
            const double energy = s.energy;
            p.intervals = 2 * N;
            assert_ok(lg_elastica_solve(NULL, &p, NULL, theta, &s, NULL));
            lg_elastica_curve(&p, theta, q, NULL);
            for (size_t k = 0; k <= N; k++) {
                coarse[k] = (4.0 * theta[2 * k] - coarse[k]) / 3.0;
                for (size_t c = 0; c < 2; c++)
                    coarse_q[2 * k + c] = (4.0 * q[4 * k + c] - coarse_q[2 * k + c]) / 3.0;
            }
            const double extrapolated = (4.0 * s.energy - energy) / 3.0;
            p.intervals = N;
            assert_close(solved(&p).energy, extrapolated, 1e-9, 0);
            for (size_t k = 0; k <= N; k++) {
                assert_close(theta[k], coarse[k], 0, 1e-9);
                for (size_t c = 0; c < 2; c++) assert_close(q[2 * k + c], coarse_q[2 * k + c], 0, 1e-9);
            }
        }
}

TEST("the result does not depend on the nodes that are asked for") {
    lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.99, 400);
    (void)solved(&p);
    memcpy(coarse, theta, 401 * sizeof *theta);
    p.intervals = 2;
    (void)solved(&p);
    for (size_t k = 0; k <= 2; k++) assert_close(theta[k], coarse[200 * k], 0, 1e-13);
    assert_close(q[4], 3.0, 0, 0);
}

/* Ends turned by pi: each sheds half a loop of the infinite beam, E = 16 EI/(L - d), force 16 EI/(L - d)^2,
 * up to exp(-L sqrt(force/EI)). A closed beam with a full turn is a circle. */
TEST("half loops and circles are closed forms") {
    lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 1.0, 50);
    lg_elastica_solution s = solved(&p);
    assert_close(s.energy, 1600.0 / 3.0, 1e-12, 0);
    assert_close(s.force[0], 16000.0 / 9.0, 1e-12, 0);
    p.qN[0] = 0.0;
    p.theta0 = -2.0;
    p.rotation = -2.0 * PI;
    s = solved(&p);
    assert_close(s.energy, 20.0 * PI * PI / 3.3, 1e-12, 0);
    for (size_t k = 0; k <= 50; k++) assert_close(theta[k], -2.0 - 2.0 * PI * (double)k / 50.0, 0, 1e-11);
}

TEST("a guess chooses the minimum") {
    const lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.1, 50);
    lg_elastica_options o;
    lg_elastica_solution s;
    double guess[51];
    lg_elastica_options_init(&o);
    for (size_t k = 0; k <= 50; k++) guess[k] = -0.7 * sin(2.0 * PI * (double)k / 50.0);
    o.guess = guess;
    const double lowest = solved(&p).energy;
    assert_ok(lg_elastica_solve_continuous(NULL, &p, &o, theta, NULL, &s, NULL));
    assert_true(s.energy > lowest + 4.0);
}

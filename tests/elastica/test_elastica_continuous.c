/* The continuous elastica compared with its first integral, with Richardson's extrapolation of discrete
 * solutions, and with closed forms. */
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
    assert_told(lg_elastica_solve_continuous(NULL, p, NULL, theta, q, &s, &told));
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

TEST("the curve and the differential equation are satisfied") {
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

TEST("Richardson's extrapolation of discrete solutions agrees with the continuous one") {
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

TEST("the result does not depend on the number of requested nodes") {
    lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.99, 400);
    (void)solved(&p);
    memcpy(coarse, theta, 401 * sizeof *theta);
    p.intervals = 2;
    (void)solved(&p);
    for (size_t k = 0; k <= 2; k++) assert_close(theta[k], coarse[200 * k], 0, 1e-13);
    assert_close(q[4], 3.0, 0, 0);
}

/* If the ends are turned by pi, each holds half a loop of the infinite beam: E = 16 EI/(L - d), force 16
 * EI/(L - d)^2, up to exp(-L sqrt(force/EI)). A closed beam with a full turn is a circle. */
TEST("half loops and circles agree with closed forms") {
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

/* Clamped ends, 1 - d = x: 2 E(m)/K(m) - 1 = d (rounded to double), energy 32 K (E - (1 - m) K), force -(4
 * K)^2; computed with mpmath. */
TEST("nearly straight beams buckle as the elliptic integrals predict, down to a shortening of 1e-12") {
    static const double rows[][3] = {
        {1e-1, 4.050408891634514, -41.57025579315579},
        {1e-2, 0.39577485385465958, -39.676926538343484},
        {1e-3, 0.039488290911480208, -39.498167922945326},
        {1e-4, 0.0039479404601805831, -39.480391636277179},
        {1e-5, 0.00039478516300591889, -39.478614997555792},
        {1e-6, 3.9478427475100765e-5, -39.478437343577341},
        {1e-7, 3.9478418570538215e-6, -39.478419578278425},
        {1e-8, 3.9478417901423025e-7, -39.478417801749525},
        {1e-9, 3.9478416497701137e-8, -39.478417624096643},
        {1e-10, 3.9478420871803314e-9, -39.478417606331356},
        {1e-11, 3.947842087091505e-10, -39.478417604554827},
        {1e-12, 3.947754427386222e-11, -39.478417604377173},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        double angles[51];
        lg_elastica_solution s;
        const lg_elastica p = {.length = 1, .stiffness = 1, .qN = {1 - rows[i][0], 0}, .intervals = 50};
        assert_ok(lg_elastica_solve_continuous(NULL, &p, NULL, angles, NULL, &s, NULL));
        assert_close(s.energy, rows[i][1], 1e-12 + 5e-16 / rows[i][0], 0);
        assert_close(s.force[0], rows[i][2], 1e-11, 0);
        assert_int_equal(s.negative_eigenvalues, 0);
    }
}

/* The angles are sqrt(x) times a shape, plus terms of order x^1.5. */
TEST("nearly straight beams with any tangents have one shape, with angles proportional to sqrt(1 - d)") {
    static const double ends[][2] = {{0, 0},   {0.9, -0.9}, {0, 0.9},   {0.9, 0},    {1, 1},    {-1, -2},
                                     {1, 0.2}, {3, -3},     {2.5, 0.1}, {1e-3, 0.0}, {-4, 3.5}, {0.3, -0.2}};
    for (size_t i = 0; i < LG_COUNT(ends); i++)
        for (double x = 1e-11; x < 2e-5; x *= 10) {
            lg_elastica_solution s[2];
            for (int k = 0; k < 2; k++) {
                const double short_by = k == 0 ? x : 1e-5, size = sqrt(short_by);
                double angles[51];
                lg_error error = {LG_OK, ""};
                const lg_elastica p = {.length = 1,
                                       .stiffness = 1,
                                       .qN = {1 - short_by, 0},
                                       .theta0 = size * ends[i][0],
                                       .rotation = size * (ends[i][1] - ends[i][0]),
                                       .intervals = 50};
                if (lg_elastica_solve_continuous(NULL, &p, NULL, angles, NULL, &s[k], &error) != LG_OK)
                    fail_msg("%g %g, %g: %s", ends[i][0], ends[i][1], short_by, error.message);
                s[k].energy /= 1 - p.qN[0];
            }
            assert_close(s[0].energy, s[1].energy, 1e-3 + 1e-14 / x, 0);
            assert_close(s[0].force[0], s[1].force[0], 1e-3 + 1e-14 / x, 0);
        }
}

TEST("a guess selects the minimum") {
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

TEST("a guess may have as few nodes as a beam of two intervals") {
    const lg_elastica p = family(LG_ELASTICA_BOTH_ENDS, 0.3, 2);
    const lg_elastica fine = family(LG_ELASTICA_BOTH_ENDS, 0.3, 50);
    lg_elastica_options o;
    lg_elastica_solution s;
    lg_elastica_options_init(&o);
    const double guess[3] = {0.3 * PI, 0.0, -0.3 * PI}, energy = solved(&fine).energy;
    o.guess = guess;
    assert_told(lg_elastica_solve_continuous(NULL, &p, &o, theta, NULL, &s, &told));
    assert_close(s.energy, energy, 1e-9, 0);
}

/* The free rigid body compared with Jacobi's elliptic functions; its attitude compared with the equations in
 * the axes of the body. */
#include "mechanics/body_check.h"

static const double inertia[3] = {1.0, 2.0, 3.0};

static lg_system *make_body(const char *name, const double *moments) {
    return make_system(name, NULL, &(lg_named_values){"inertia", moments, 3}, 1);
}

/* sn, cn, dn of u for the modulus k with complement m1 = 1 - k^2, by the arithmetic-geometric mean
 * (Abramowitz and Stegun 16.4). */
static void jacobi(double u, double m1, double *sn, double *cn, double *dn) {
    enum { LEVELS = 16 };
    double a[LEVELS], c[LEVELS], b = sqrt(m1), phi;
    int n = 0;
    a[0] = 1.0;
    c[0] = sqrt(1.0 - m1);
    while (fabs(c[n]) > 1e-16 && n + 1 < LEVELS) {
        a[n + 1] = 0.5 * (a[n] + b);
        c[n + 1] = 0.5 * (a[n] - b);
        b = sqrt(a[n] * b);
        n++;
    }
    phi = ldexp(a[n] * u, n);
    for (; n > 0; n--) phi = 0.5 * (phi + asin(c[n] / a[n] * sin(phi)));
    *sn = sin(phi);
    *cn = cos(phi);
    *dn = sqrt(m1 + (1.0 - m1) * *cn * *cn);
}

/* The solution for 2 E = 1 and I_1 < I_2 < I_3, |mu|^2 > 2 E I_2 (Landau and Lifshitz, Mechanics, 37): omega
 * = (A cn, B sn, C dn) of the phase rate * t, where (A, B, C) is `amplitude`. */
typedef struct elliptic {
    double amplitude[3], rate, m1;
} elliptic;

static elliptic make_elliptic(const double *I, double m1) {
    const double m = 1.0 - m1, p = I[1] - I[0], r = m * (I[2] - I[1]);
    /* |mu|^2 is chosen such that the modulus has this complement. I_3 - |mu|^2 and |mu|^2 - I_1 without
     * cancellation: */
    const double high = r * (I[2] - I[0]) / (p + r), low = p * (I[2] - I[0]) / (p + r);
    return (elliptic){.amplitude = {sqrt(high / (I[0] * (I[2] - I[0]))), sqrt(high / (I[1] * (I[2] - I[1]))),
                                    sqrt(low / (I[2] * (I[2] - I[0])))},
                      .rate = sqrt((I[2] - I[1]) * low / (I[0] * I[1] * I[2])),
                      .m1 = m1};
}

static void elliptic_momentum(const elliptic *of, const double *I, double phase, double *mu) {
    double value[3];
    jacobi(phase, of->m1, &value[1], &value[0], &value[2]);
    for (int i = 0; i < 3; i++) mu[i] = I[i] * of->amplitude[i] * value[i];
}

/* Starts near -e_2 and integrates to T = 100. m1 = 1 - k^2 is the distance from the separatrix; a change of
 * the start by epsilon shifts the phase by about epsilon/m1 per period. */
static void check_near_the_middle_axis(double m1, double start, double tolerance, double error) {
    enum { POINTS = 20 };
    const elliptic of = make_elliptic(inertia, m1);
    double times[POINTS], y[POINTS * 3], mu[3], worst = 0.0, work[8];
    lg_system *system = make_body("rigid-body", inertia);
    elliptic_momentum(&of, inertia, start, mu);
    const double energy = lg_system_invariant(system, 0, mu, work),
                 square = lg_system_invariant(system, 1, mu, work);
    assert_true(fabs(mu[1]) > 0.99 * sqrt(square));
    assert_close(energy, 0.5, 1e-14, 0.0);
    for (int n = 0; n < POINTS; n++) times[n] = 5.0 * (n + 1);
    integrate(system, tolerance, mu, times, POINTS, y);
    for (int n = 0; n < POINTS; n++) {
        elliptic_momentum(&of, inertia, start + of.rate * times[n], mu);
        for (int i = 0; i < 3; i++) worst = fmax(worst, fabs(y[3 * n + i] - mu[i]));
        assert_close(lg_system_invariant(system, 0, y + 3 * n, work), energy, 1e-10, 0.0);
        assert_close(lg_system_invariant(system, 1, y + 3 * n, work), square, 1e-13, 0.0);
    }
    printf("1 - k^2 = %.0e: error to T = 100: %.2e\n", m1, worst);
    assert_true(worst < error);
}

TEST("near the middle axis the solution agrees with Jacobi's up to T = 100") {
    check_near_the_middle_axis(1e-4, -4.0, 1e-12, 5e-7);
    check_near_the_middle_axis(1e-8, -9.0, 1e-14, 2e-5);
}

TEST("the attitude agrees with the equations in the axes of the body") {
    lg_rng rng = test_rng(3, 0);
    double y[12], body[12], end[12], work[16];
    const double T = 2.0;
    lg_system *system = make_body("rigid-body-attitude", inertia);
    random_rotation(&rng, y);
    for (int i = 0; i < 3; i++) y[9 + i] = lg_rng_uniform_in(&rng, -2, 2);
    memcpy(body, y, 9 * sizeof(*y));
    for (int c = 0; c < 3; c++) body[9 + c] = y[c] * y[9] + y[3 + c] * y[10] + y[6 + c] * y[11];
    const top of = {.inertia = {inertia[0], inertia[1], inertia[2]}};
    rk4_in_the_body(&of, T / 4000, 4000, body);
    integrate(system, 1e-12, y, &T, 1, end);
    assert_all_close(end, body, 9, 0.0, 1e-10);
    for (int i = 9; i < 12; i++) assert_close(end[i], y[i], 0.0, 0.0);
    for (size_t k = 0; k < lg_system_invariants(system); k++)
        assert_close(lg_system_invariant(system, k, end, work), lg_system_invariant(system, k, y, work),
                     1e-11, 0.0);
}

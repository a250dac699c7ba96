/* Orders of convergence for a nonplanar double pendulum, a rigid body, a heavy top and coupled oscillators,
 * and the orders that remain with planted errors.
 * ctest-labels: src/integrators */
#include "fields.h"
#include "support/fixtures.h"

#include "integrators/stepper.h"

/* ---- problems and their solutions in long double ---- */

typedef void (*rhs)(real t, const real *y, real *out);

static double swing = 0.3;

static void chain_rhs(real t, const real *y, real *out) {
    real f[CHAIN_DIM];
    chain_l(t, swing, y, f);
    chain_velocity_l(y, f, out);
}

static void rigid_rhs(real t, const real *y, real *out) {
    const real u[3] = {-y[0] / 0.8L, -y[1] / 1.3L, -y[2] / 2.1L};
    cross_l(u, y, out);
}

static void quartic_rhs(real t, const real *y, real *out) {
    const real r = y[0] * y[0] + y[1] * y[1];
    out[0] = y[2], out[1] = y[3], out[2] = -y[0] * (r + 1.0L), out[3] = -y[1] * r;
}

/* Q' = hat(u) Q, pi' = u x pi + v. */
static void top_rhs(real t, const real *y, real *out) {
    real f[6];
    top_l(y, f);
    for (int j = 0; j < 3; j++) {
        real column[3] = {y[j], y[3 + j], y[6 + j]};
        cross_l(f, column, column);
        for (int i = 0; i < 3; i++) out[3 * i + j] = column[i];
    }
    cross_l(f, y + 9, out + 9);
    for (int i = 0; i < 3; i++) out[9 + i] += f[3 + i];
}

#define DIM_MAX 12

/* Solves with the classical Runge-Kutta scheme of order 4. */
static void solve_coarse(rhs f, size_t n, real t_end, int steps, const double *y0, real *y) {
    static const real c[4] = {0.0L, 0.5L, 0.5L, 1.0L}, b[4] = {1, 2, 2, 1};
    const real h = t_end / steps;
    widen(n, y0, y);
    for (int step = 0; step < steps; step++) {
        real k[DIM_MAX] = {0}, point[DIM_MAX], sum[DIM_MAX] = {0};
        for (int stage = 0; stage < 4; stage++) {
            for (size_t i = 0; i < n; i++) point[i] = y[i] + c[stage] * h * k[i];
            f(h * (step + c[stage]), point, k);
            for (size_t i = 0; i < n; i++) sum[i] += b[stage] * k[i];
        }
        for (size_t i = 0; i < n; i++) y[i] += h / 6 * sum[i];
    }
}

/* Extrapolates once, which gives order 5. */
static void solve(rhs f, size_t n, double t_end, const double *y0, double *y) {
    const int steps = 500 + (int)(1500.0 * t_end);
    real coarse[DIM_MAX], fine[DIM_MAX];
    solve_coarse(f, n, t_end, steps, y0, coarse);
    solve_coarse(f, n, t_end, 2 * steps, y0, fine);
    for (size_t i = 0; i < n; i++) y[i] = (double)(fine[i] + (fine[i] - coarse[i]) / 15);
}

typedef struct problem {
    const char *name;
    lg_ode ode;
    size_t n;
    double t_end, y0[DIM_MAX], exact[DIM_MAX];
} problem;

static problem chain_problem(const lg_scheme *scheme, double t_end) {
    problem p = {.name = "chain", .ode = chain_ode(scheme, &swing), .n = CHAIN_DIM, .t_end = t_end};
    chain_start(p.y0);
    solve(chain_rhs, p.n, t_end, p.y0, p.exact);
    return p;
}

static problem rigid_problem(const lg_scheme *scheme, double t_end) {
    problem p = {.name = "rigid body", .n = 3, .t_end = t_end, .y0 = {0.4, 1.1, -0.7}};
    p.ode.field = scheme->ambient ? rigid_ambient_field : rigid_field;
    assert_ok(lg_space_init(&p.ode.space, &(lg_space_factor){LG_SPACE_SO3_DUAL, 1}, 1));
    if (scheme->ambient) assert_ok(lg_space_init_rn(&p.ode.space, 3));
    p.ode.manifold = (lg_space){0};
    solve(rigid_rhs, p.n, t_end, p.y0, p.exact);
    return p;
}

static problem quartic_problem(double t_end) {
    problem p = {.name = "oscillators", .n = 4, .t_end = t_end, .y0 = {0.4, -0.7, 0.3, 0.6}};
    p.ode = (lg_ode){.field = quartic_field, .force = quartic_force, .velocity = quartic_velocity};
    assert_ok(lg_space_init_rn(&p.ode.space, 4));
    solve(quartic_rhs, p.n, t_end, p.y0, p.exact);
    return p;
}

static problem top_problem(double t_end) {
    problem p = {.name = "heavy top", .n = 12, .t_end = t_end};
    p.ode = (lg_ode){.field = top_field};
    assert_ok(lg_space_init(&p.ode.space, &(lg_space_factor){LG_SPACE_SE3, 1}, 1));
    top_start(3.0, p.y0);
    solve(top_rhs, p.n, t_end, p.y0, p.exact);
    return p;
}

/* ---- measuring orders ---- */

/* Largest error at t_end; infinity if the run fails. */
static double error_of(const problem *p, lg_stepper *stepper, size_t steps) {
    double error = 0.0, out[2 * DIM_MAX];
    if (lg_integrate_fixed(stepper, 0.0, p->t_end / (double)steps, steps, NULL, 0, steps, p->y0, out, NULL) !=
        LG_OK)
        return INFINITY;
    for (size_t j = 0; j < p->n; j++) error = fmax(error, fabs(out[p->n + j] - p->exact[j]));
    return error;
}

/* The slope of log(error) against log(h) by least squares, over step sizes with errors in [1e-11, 1e-3].
 * There are `density` step sizes per halving and at most 5.5 halvings; *halvings gets the range of h in
 * powers of 2. */
static double measured_order(const problem *p, const lg_scheme *scheme, int density, double *halvings) {
    fit_line fit = {0};
    double first = 0.0;
    *halvings = 0.0;
    lg_stepper *stepper = test_stepper(scheme, &p->ode);
    for (int i = 2 * density; i <= 20 * density && *halvings < 5.4; i++) {
        const size_t steps = (size_t)lround(pow(2.0, (double)i / density));
        const double x = log(p->t_end / (double)steps), error = error_of(p, stepper, steps);
        if (error > 1e-3) continue;
        if (!(error > 1e-11)) break;
        if (fit.n == 0) first = x;
        fit_add(&fit, x, log(error));
        *halvings = (first - x) / log(2.0);
    }
    return fit_slope(&fit);
}

static bool has_order(double slope, int order) {
    return slope >= order - 0.15;
}

static void assert_order(const problem *p, const lg_scheme *scheme, int order) {
    double halvings;
    const double slope = measured_order(p, scheme, order < 5 ? 2 : 12, &halvings);
    print_message("  %-16s %-11s dexpinv %2d: order %.3f over %.2f halvings\n", scheme->name, p->name,
                  scheme->dexpinv, slope, halvings);
    const double wanted = order > 5 ? 0.85 * log2(1e8) / order : 4.99;
    if (halvings < wanted)
        fail_msg("%s: errors between 1e-3 and 1e-11 over %.2f halvings of h, not %.2f", scheme->name,
                 halvings, wanted);
    if (!has_order(slope, order) || has_order(slope, order + 1))
        fail_msg("%s: measured order %.3f, expected %d", scheme->name, slope, order);
}

/* End times. Between errors of 1e-3 and 1e-11 order 5 has 5.3 halvings, and its runs are so long that even
 * the coarse steps are asymptotic. Higher orders have fewer halvings: order 8 has 3.3. */
static double chain_time(const lg_scheme *scheme, int order) {
    if (order > 5) return 2.0;
    return order == 1 ? 0.125 : order < 5 ? 1.0 : scheme->ambient ? 5.0 : 3.5;
}

static double rigid_time(int order) {
    if (order > 5) return 105.0;
    return order == 1 ? 0.5 : order < 5 ? 4.0 : 28.0;
}

/* Steps with many stages have small errors: in a short run five halvings would reach rounding. */
static double quartic_time(const lg_scheme *scheme) {
    return scheme->stages < 5 ? 1.0 : 16.0;
}

TEST("every Lie group scheme has its order on the chain") {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind != LG_SCHEME_RKMK && scheme->kind != LG_SCHEME_COMMUTATOR_FREE) continue;
        const problem p = chain_problem(scheme, chain_time(scheme, scheme->order));
        assert_order(&p, scheme, scheme->order);
    }
}

TEST("every one-step scheme has its order on the rigid body") {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind != LG_SCHEME_RKMK && scheme->kind != LG_SCHEME_COMMUTATOR_FREE &&
            scheme->kind != LG_SCHEME_IMPLICIT)
            continue;
        const problem p = rigid_problem(scheme, rigid_time(scheme->order));
        assert_order(&p, scheme, scheme->order);
    }
}

TEST("every splitting scheme has its order") {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind != LG_SCHEME_SPLITTING) continue;
        const problem p = quartic_problem(quartic_time(scheme));
        assert_order(&p, scheme, scheme->order);
    }
}

TEST("every embedded solution has its order: the error estimate of one step has that order plus one") {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->embedded_order == 0) continue;
        const problem p = chain_problem(scheme, 0.01);
        lg_stepper *stepper = test_stepper(scheme, &p.ode);
        fit_line fit = {0};
        for (int k = 0; k <= 10; k++) { /* five halvings */
            const double h = 0.2 * pow(2.0, -0.5 * k);
            double out[DIM_MAX], largest = 0.0;
            lg_stepper_reset(stepper);
            assert_ok(lg_stepper_step(stepper, 0.3, h, p.y0, NULL, out));
            for (size_t j = 0; j < p.n; j++) largest = fmax(largest, fabs(stepper->error[j]));
            fit_add(&fit, log(h), log(largest));
        }
        const double slope = fit_slope(&fit);
        print_message("  %-16s estimate of order %.3f\n", scheme->name, slope);
        if (!has_order(slope, scheme->embedded_order + 1) || has_order(slope, scheme->embedded_order + 2))
            fail_msg("%s: measured order %.3f, expected %d", scheme->name, slope, scheme->embedded_order + 1);
    }
}

TEST("slgi has order 2 for theta = 1/2, otherwise 1") {
    static const struct {
        double theta;
        int order;
    } cases[] = {{0.5, 2}, {0.0, 1}, {0.3, 1}, {1.0, 1}};
    for (size_t i = 0; i < 4; i++) {
        const problem p = top_problem(cases[i].order == 1 ? 0.005 : 0.1);
        lg_scheme scheme = *lg_scheme_find("slgi");
        scheme.theta = cases[i].theta;
        assert_order(&p, &scheme, cases[i].order);
    }
}

/* Suzuki's composition: a = 1/(4 - 4^(1/3)). One of the steps goes backwards. */
TEST("steps a h, a h, (1 - 4 a) h, a h, a h of slgi have order 4 together") {
    const problem p = top_problem(0.15);
    const double a = 1.0 / (4.0 - cbrt(4.0)), part[5] = {a, a, 1.0 - 4.0 * a, a, a};
    lg_stepper *stepper = test_stepper(lg_scheme_find("slgi"), &p.ode);
    fit_line fit = {0};
    for (int k = 4; k <= 9; k++) {
        const double h = ldexp(p.t_end, -k);
        double y[DIM_MAX], error = 0.0;
        memcpy(y, p.y0, p.n * sizeof *y);
        for (int i = 0; i < 5 << k; i++)
            assert_ok(lg_stepper_step(stepper, 0.0, part[i % 5] * h, y, NULL, y));
        for (size_t j = 0; j < p.n; j++) error = fmax(error, fabs(y[j] - p.exact[j]));
        assert_true(error > 1e-11 && error < 1e-3);
        fit_add(&fit, log(h), log(error));
    }
    const double slope = fit_slope(&fit);
    print_message("  slgi composed: order %.3f\n", slope);
    assert_true(has_order(slope, 4) && !has_order(slope, 5));
}

TEST("order 3 needs one nested bracket, orders 4 and 5 need two; with one term less the orders are 2, 3 "
     "and 3") {
    static const struct {
        const char *name;
        int truncation, order;
    } cases[] = {{"rkmk3", 1, 3}, {"rkmk3", 0, 2}, {"rkmk4", 2, 4}, {"rkmk4", 1, 3},
                 {"rkmk4", 0, 2}, {"rkmk5", 2, 5}, {"rkmk5", 1, 3}, {"rkmk54", 1, 3}};
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        lg_scheme scheme = *lg_scheme_find(cases[i].name);
        scheme.dexpinv = cases[i].truncation;
        const problem p = chain_problem(&scheme, chain_time(&scheme, cases[i].order));
        assert_order(&p, &scheme, cases[i].order);
    }
}

/* ---- planted errors ---- */

static void assert_falls(const lg_scheme *scheme, int order) {
    double halvings;
    const problem p = chain_problem(scheme, chain_time(scheme, scheme->order));
    const double slope = measured_order(&p, scheme, 2, &halvings);
    print_message("  %-28s: order %.3f\n", scheme->name, slope);
    assert_false(has_order(slope, order + 1));
    assert_true(has_order(slope, order));
}

TEST("wrong brackets and swapped exponentials reduce the order") {
    lg_scheme two = *lg_scheme_find("rkmk4-2c"), cf4 = *lg_scheme_find("cf4"), cg3 = *lg_scheme_find("cg3");
    lg_commutator list[2];
    lg_cf_row rows[5];
    for (int i = 0; i < 2; i++) { /* changes the sign of each bracket */
        memcpy(list, lg_scheme_find("rkmk4-2c")->commutators, sizeof(list));
        list[i].weight = -list[i].weight;
        two.commutators = list;
        two.name = i == 0 ? "rkmk4-2c, +1/8" : "rkmk4-2c, +1/12";
        assert_falls(&two, 3 - i);
    }
    memcpy(rows, cf4.rows, sizeof(rows)); /* the last two exponentials in the other order */
    memcpy(rows[4].coefficient[0], cf4.rows[4].coefficient[1], sizeof(rows[4].coefficient[0]));
    memcpy(rows[4].coefficient[1], cf4.rows[4].coefficient[0], sizeof(rows[4].coefficient[0]));
    cf4.rows = rows, cf4.name = "cf4, swapped";
    assert_falls(&cf4, 2);
    memcpy(rows, cg3.rows, 4 * sizeof(rows[0]));
    memcpy(rows[3].coefficient[0], cg3.rows[3].coefficient[2], sizeof(rows[3].coefficient[0]));
    memcpy(rows[3].coefficient[2], cg3.rows[3].coefficient[0], sizeof(rows[3].coefficient[0]));
    cg3.rows = rows, cg3.name = "cg3, reversed";
    assert_falls(&cg3, 2);
}

/* Distance from the start after 20 steps forward and 20 back. Also checks that a step costs `forces` new
 * forces. */
static double way_back(const problem *p, const lg_scheme *scheme, size_t forces) {
    double out[8], back[8], distance = 0.0;
    lg_run_stats stats;
    lg_stepper *stepper = test_stepper(scheme, &p->ode);
    assert_ok(lg_integrate_fixed(stepper, 0.0, 0.05, 20, NULL, 0, 20, p->y0, out, NULL));
    assert_ok(lg_integrate_fixed(stepper, 1.0, -0.05, 20, NULL, 0, 20, out + 4, back, NULL));
    for (int j = 0; j < 4; j++) distance = fmax(distance, fabs(back[4 + j] - p->y0[j]));
    lg_stepper_reset(stepper);
    assert_ok(lg_integrate_fixed(stepper, 0.0, 0.05, 20, NULL, 0, 20, p->y0, out, &stats));
    assert_int_equal(stats.evaluations, 20 * forces + (scheme->drift[scheme->stages - 1] == 0.0));
    return distance;
}

TEST("symmetric splittings are reversible, and a step reuses the last force of the step before") {
    const problem p = quartic_problem(1.0);
    static const struct {
        const char *name;
        size_t forces;
    } symmetric[] = {{"stormer-verlet", 1}, {"forest-ruth", 3}, {"blanes-moan", 6}};
    for (size_t i = 0; i < LG_COUNT(symmetric); i++)
        assert_close(way_back(&p, lg_scheme_find(symmetric[i].name), symmetric[i].forces), 0.0, 0.0, 1e-14);
    assert_true(way_back(&p, lg_scheme_find("symplectic-euler"), 1) > 1e-3);
}

/* ---- order conditions of splittings ---- */

enum { LONGEST = 5 };
/* A series in two letters that do not commute, with a coefficient for each word. The letters of a word are
 * bits, the last letter is the lowest bit. */
typedef struct series {
    double word[LONGEST + 1][1 << LONGEST];
} series;

/* Multiplies s by exp(c letter): each word gets contributions from the words that it continues by `letter`
 * alone. */
static void times_exp(series *s, unsigned letter, double c) {
    for (int n = LONGEST; n > 0; n--)
        for (unsigned w = 0; w < 1u << n; w++) {
            double factor = 1.0;
            for (int k = 1; k <= n && (w >> (k - 1) & 1u) == letter; k++)
                s->word[n][w] += (factor *= c / k) * s->word[n - k][w >> k];
        }
}

/* Largest difference between the coefficients of the words of length n in the scheme's step and in exp(kick +
 * drift), where they are 1/n!. */
static double defect(const lg_scheme *scheme, int n) {
    series s = {{{0}}};
    double largest = 0.0, factorial = 1.0;
    s.word[0][0] = 1.0;
    for (int i = 0; i < scheme->stages; i++) {
        times_exp(&s, 0, scheme->kick[i]);
        times_exp(&s, 1, scheme->drift[i]);
    }
    for (int k = 2; k <= n; k++) factorial *= k;
    for (unsigned w = 0; w < 1u << n; w++) largest = fmax(largest, fabs(s.word[n][w] - 1.0 / factorial));
    return largest;
}

TEST("splittings satisfy the order conditions of their order, and not those of the next one") {
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind != LG_SCHEME_SPLITTING) continue;
        for (int n = 1; n <= scheme->order; n++) assert_close(defect(scheme, n), 0.0, 0.0, 2e-15);
        assert_true(defect(scheme, scheme->order + 1) > 1e-4);
    }
}

/* At h = 0.06 the errors of these two schemes of order 4 differ by a factor of 2000 in one step, so the
 * coefficients matter beyond the order. */
TEST("the splitting of Blanes and Moan has the smaller error") {
    static const char *const names[] = {"forest-ruth", "blanes-moan"};
    const problem p = quartic_problem(0.06);
    double error[2];
    for (size_t i = 0; i < 2; i++) {
        error[i] = error_of(&p, test_stepper(lg_scheme_find(names[i]), &p.ode), 1);
        print_message("  %-16s %.3e\n", names[i], error[i]);
    }
    assert_true(error[1] < 1e-3 * error[0]);
}

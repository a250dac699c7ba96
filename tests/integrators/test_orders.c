/* Orders of convergence on a nonplanar double pendulum with the true Hamiltonian, and what planted errors do
 * to them; drift off the manifold. */
#include "test_support.h"

#include "liegrad/geometry.h"
#include "liegrad/mechanics.h"

/* Nonplanar, with unequal masses and lengths. Order 5 leaves room for 5.3 halvings between errors of 1e-3 and
 * 1e-11, so its cases are long enough for the coarse steps to be asymptotic already. */
#define CASES 3
static const struct {
    double t_end, y[12];
} cases[CASES] = {
    {1.0, {0.6, 0.0, -0.8, 0.4, 0.9, 0.3, 0.0, 0.8, 0.6, -0.7, 0.3, -0.4}}, /* orders below 5 */
    {6.0, {0.6, 0.0, -0.8, 0.4, 0.9, 0.3, 0.0, 0.8, 0.6, -0.7, 0.3, -0.4}}, /* order 5, Lie group */
    {7.0, {0.8, 0.0, -0.6, 0.3, 0.5, 0.4, 0.0, 0.8, -0.6, 0.3, 0.6, 0.8}},  /* order 5, classical */
};

typedef struct fixture {
    lg_system *system;
    lg_system_user user;
    double work[64];
    double reference[CASES][12];
} fixture;

static void setup(fixture *f) {
    const double masses[] = {1.0, 1.3}, lengths[] = {1.0, 0.8};
    lg_system_options options;
    lg_system_options_init(&options);
    options.links = 2;
    options.masses = masses;
    options.lengths = lengths;
    assert_ok(lg_system_create(NULL, "pendulum-chain", &options, &f->system, NULL));
    assert_true(lg_system_workspace(f->system) <= 64);
    for (int i = 0; i < CASES; i++)
        assert_ok(lg_reference_trajectories(NULL, f->system, cases[i].y, 1, &cases[i].t_end, 1, 1e-14, 1e-14,
                                            f->reference[i], NULL));
}

static lg_stepper *stepper_for(fixture *f, const lg_scheme *scheme) {
    lg_ode ode;
    lg_stepper *stepper = NULL;
    assert_ok(lg_system_ode(f->system, lg_system_form_for(scheme), &f->user, f->work, &ode));
    assert_ok(lg_stepper_create(NULL, scheme, &ode, &stepper));
    return stepper;
}

/* Logarithm of the error in the maximum norm; +infinity when the run fails: Euler with coarse steps leaves
 * the region where the kinetic energy is defined. */
static double log_error(fixture *f, lg_stepper *stepper, int which, size_t steps) {
    double error = 0.0, out[24];
    if (lg_integrate_fixed(stepper, 0.0, cases[which].t_end / (double)steps, steps, NULL, 0, steps,
                           cases[which].y, out, NULL) != LG_OK)
        return INFINITY;
    for (int j = 0; j < 12; j++) error = fmax(error, fabs(out[12 + j] - f->reference[which][j]));
    return log(error);
}

/* Slope of log(error) against log(h) by least squares over the step sizes with errors in [1e-11, 1e-3], two
 * of them a halving (24 for order 5, where the window itself is hardly wider than five halvings); `halvings`
 * is the range of h in powers of 2, at most 6. */
static double measured_order(fixture *f, const lg_scheme *scheme, double *halvings) {
    lg_stepper *stepper = stepper_for(f, scheme);
    double sx = 0, sy = 0, sxx = 0, sxy = 0, n = 0, first = 0;
    const int which = scheme->order < 5 ? 0 : scheme->ambient ? 2 : 1, density = which == 0 ? 2 : 24;
    for (int i = 2 * density; i <= 20 * density; i++) {
        const size_t steps = (size_t)lround(pow(2.0, (double)i / density));
        const double x = log(cases[which].t_end / (double)steps), y = log_error(f, stepper, which, steps);
        if (y > log(1e-3)) continue;
        if (y < log(1e-11)) break;
        if (n == 0) first = x;
        sx += x, sy += y, sxx += x * x, sxy += x * y, n++;
        *halvings = (first - x) / log(2.0);
        if (*halvings > 5.9) break;
    }
    lg_stepper_destroy(NULL, stepper);
    return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

static bool has_order(double slope, int order) {
    return slope >= order - 0.15;
}

static void assert_order(fixture *f, const lg_scheme *scheme, int order) {
    double halvings = 0.0;
    const double slope = measured_order(f, scheme, &halvings);
    print_message("  %-16s dexpinv %2d: order %.3f over %.2f halvings\n", scheme->name, scheme->dexpinv,
                  slope, halvings);
    assert_true(halvings >= 4.99); /* five */
    assert_true(has_order(slope, order));
    assert_false(has_order(slope, order + 1));
}

static void test_orders(void **state) {
    (void)state;
    fixture f;
    setup(&f);
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind != LG_SCHEME_SPLITTING) assert_order(&f, scheme, scheme->order);
    }
    lg_system_destroy(NULL, f.system);
}

/* Orders 4 and 5 need the bracket twice; once leaves 3, never 2. */
static void test_orders_of_truncations(void **state) {
    (void)state;
    static const struct {
        const char *name;
        int truncation, order;
    } truncated[] = {{"rkmk4", 2, 4}, {"rkmk4", 1, 3}, {"rkmk4", 0, 2}, {"rkmk5", 2, 5}, {"rkmk5", 1, 3}};
    fixture f;
    setup(&f);
    for (size_t i = 0; i < sizeof(truncated) / sizeof(truncated[0]); i++) {
        lg_scheme scheme = *lg_scheme_find(truncated[i].name);
        scheme.dexpinv = truncated[i].truncation;
        assert_order(&f, &scheme, truncated[i].order);
    }
    lg_system_destroy(NULL, f.system);
}

/* Planted: CF4 with its two last exponentials in the other order is not of order 4. */
static void test_swapped_exponentials_are_caught(void **state) {
    (void)state;
    fixture f;
    setup(&f);
    lg_scheme scheme = *lg_scheme_find("cf4");
    lg_cf_row rows[5];
    memcpy(rows, scheme.rows, sizeof(rows));
    memcpy(rows[4].coefficient[0], scheme.rows[4].coefficient[1], sizeof(rows[4].coefficient[0]));
    memcpy(rows[4].coefficient[1], scheme.rows[4].coefficient[0], sizeof(rows[4].coefficient[0]));
    scheme.rows = rows;
    scheme.name = "cf4, swapped";
    double halvings;
    const double slope = measured_order(&f, &scheme, &halvings);
    print_message("  cf4 with swapped exponentials: order %.3f\n", slope);
    assert_false(has_order(slope, 4));
    lg_system_destroy(NULL, f.system);
}

/* The quartic oscillators under Stormer-Verlet, reversible and of order 2. */
static void test_stormer_verlet(void **state) {
    (void)state;
    const lg_scheme *scheme = lg_scheme_find("stormer-verlet");
    const double y0[4] = {0.4, -0.7, 0.3, 0.6}, times[] = {1.0};
    fixture f;
    double exact[4], out[8], sx = 0, sy = 0, sxx = 0, sxy = 0;
    assert_ok(lg_system_create(NULL, "quartic", NULL, &f.system, NULL));
    assert_ok(lg_reference_trajectories(NULL, f.system, y0, 1, times, 1, 0.0, 0.0, exact, NULL));
    lg_stepper *stepper = stepper_for(&f, scheme);
    const int n = 7;
    size_t steps = 64;
    for (int i = 0; i < n; i++, steps *= 2) {
        double error = 0.0;
        assert_ok(
            lg_integrate_fixed(stepper, 0.0, 1.0 / (double)steps, steps, NULL, 0, steps, y0, out, NULL));
        for (int j = 0; j < 4; j++) error = fmax(error, fabs(out[4 + j] - exact[j]));
        assert_true(error < 1e-2 && error > 1e-11);
        sx += log(1.0 / (double)steps), sy += log(error);
        sxx += log(1.0 / (double)steps) * log(1.0 / (double)steps),
            sxy += log(1.0 / (double)steps) * log(error);
    }
    const double slope = (n * sxy - sx * sy) / (n * sxx - sx * sx);
    print_message("  %-16s: order %.3f from %d step sizes\n", scheme->name, slope, n);
    assert_true(has_order(slope, 2) && !has_order(slope, 3));
    /* Back again with -h: reversible. */
    assert_ok(lg_integrate_fixed(stepper, 0.0, 0.05, 20, NULL, 0, 20, y0, out, NULL));
    double back[8];
    assert_ok(lg_integrate_fixed(stepper, 1.0, -0.05, 20, NULL, 0, 20, out + 4, back, NULL));
    for (int j = 0; j < 4; j++) assert_close(back[4 + j], y0[j], 0.0, 1e-14);
    /* One force a point: M points cost M forces. */
    lg_run_stats stats;
    lg_stepper_reset(stepper);
    assert_ok(lg_integrate_fixed(stepper, 0.0, 0.05, 20, NULL, 0, 20, y0, out, &stats));
    assert_int_equal(stats.evaluations, 21);
    lg_stepper_destroy(NULL, stepper);
    lg_system_destroy(NULL, f.system);
}

/* 4000 steps of 0.025 (T = 100): every Lie group scheme stays on the manifold to rounding, the classical ones
 * do not. */
static void test_manifold_drift(void **state) {
    (void)state;
    static const char *const names[] = {"lie-euler", "rkmk4", "rkmk5", "rkmk54", "cf4"};
    for (size_t links = 1; links <= 3; links++) {
        fixture f;
        lg_space space;
        lg_system_options options;
        lg_system_options_init(&options);
        options.links = links;
        assert_ok(lg_space_init(&space, &(lg_space_factor){LG_SPACE_TS2, links}, 1));
        assert_ok(lg_system_create(NULL, "pendulum-chain", &options, &f.system, NULL));
        double y0[18], out[36], worst[5] = {0};
        lg_rng rng;
        lg_rng_seed(&rng, 11, links);
        for (int repeat = 0; repeat < 5; repeat++) {
            assert_ok(lg_system_start(f.system, LG_STARTS_THESIS, &rng, y0));
            for (size_t i = 0; i < 5; i++) {
                lg_stepper *stepper = stepper_for(&f, lg_scheme_find(names[i]));
                const double h = i == 0 ? 0.0025 : 0.025; /* Euler gains energy */
                assert_ok(lg_integrate_fixed(stepper, 0.0, h, 4000, NULL, 0, 4000, y0, out, NULL));
                worst[i] = fmax(worst[i], lg_space_manifold_error(&space, out + 6 * links));
                lg_stepper_destroy(NULL, stepper);
            }
        }
        for (size_t i = 0; i < 5; i++) {
            print_message("  k = %zu, %-10s: largest manifold error after 4000 steps %.2g\n", links, names[i],
                          worst[i]);
            assert_true(worst[i] <= 1e-13);
        }
        lg_stepper *stepper = stepper_for(&f, lg_scheme_find("rk4"));
        assert_ok(lg_integrate_fixed(stepper, 0.0, 0.025, 4000, NULL, 0, 4000, y0, out, NULL));
        assert_true(lg_space_manifold_error(&space, out + 6 * links) > 1e-13); /* the test can fail */
        lg_stepper_destroy(NULL, stepper);
        lg_system_destroy(NULL, f.system);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_orders),
        cmocka_unit_test(test_orders_of_truncations),
        cmocka_unit_test(test_swapped_exponentials_are_caught),
        cmocka_unit_test(test_stormer_verlet),
        cmocka_unit_test(test_manifold_drift),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

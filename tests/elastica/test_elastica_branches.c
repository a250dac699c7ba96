/* Branches of the elastica: the documented hard cases, saddles, generated curves, memory. */
#include "elastica/elastica.h"
#include "support/fixtures.h"
#include "test_support.h"
/* ctest-labels: threads */

#define PI   3.14159265358979323846
#define ROOM 16

static double theta[ROOM * 51];
static lg_elastica_solution solutions[ROOM];

/* Finds the branches of a family at x = share * pi, with a rotation that differs by `turns` full turns from
 * that of the global minimum. */
static size_t branches(lg_elastica_case kind, double share, int turns, bool saddles) {
    lg_elastica p;
    lg_elastica_init(&p);
    size_t count = 99;
    lg_elastica_set_case(&p, kind, share * PI);
    p.rotation += 2.0 * PI * turns;
    assert_told(lg_elastica_branches(NULL, &p, NULL, saddles, ROOM, theta, solutions, &count, &told));
    for (size_t i = 0; i < count; i++) {
        assert_close(lg_elastica_energy(&p, theta + 51 * i), solutions[i].energy, 1e-12, 0);
        assert_true(i == 0 || solutions[i].energy >= solutions[i - 1].energy * (1.0 - 1e-10));
        assert_true(saddles || solutions[i].negative_eigenvalues == 0);
        assert_true(solutions[i].residual < 1e-7);
    }
    return count;
}

/* Both-ends: the second, lower arch exists up to |w| = 0.1925 pi. Right-end: the beam that buckles to the
 * other side exists up to 0.171 pi. */
TEST("a second minimum is found") {
    assert_int_equal(branches(LG_ELASTICA_BOTH_ENDS, 0.192, 0, false), 2);
    assert_true(theta[10] > 0.0 && theta[51 + 10] < 0.0);
    assert_int_equal(branches(LG_ELASTICA_BOTH_ENDS, 0.193, 0, false), 1);
    assert_int_equal(branches(LG_ELASTICA_RIGHT_END, 0.170, 0, false), 2);
    assert_int_equal(branches(LG_ELASTICA_RIGHT_END, 0.172, 0, false), 1);
}

TEST("the same tangents with other rotations give both loops and the asymmetric pair") {
    assert_int_equal(branches(LG_ELASTICA_BOTH_ENDS, 1.0, 0, false), 1);
    assert_close(solutions[0].energy, 420.415, 0, 5e-4);
    assert_int_equal(branches(LG_ELASTICA_BOTH_ENDS, 1.0, 2, false), 1);
    assert_close(solutions[0].energy, 420.415, 0, 5e-4);
    assert_int_equal(branches(LG_ELASTICA_BOTH_ENDS, 1.0, 1, false), 2);
    assert_close(solutions[0].energy, 439.367, 0, 5e-4);
    assert_close(solutions[1].energy, 439.367, 0, 5e-4);
    for (int turns = 1; turns <= 2; turns++) {
        assert_int_equal(branches(LG_ELASTICA_BOTH_ENDS, 0.890, turns, false), turns == 1 ? 2 : 1);
        assert_int_equal(branches(LG_ELASTICA_BOTH_ENDS, 0.887, turns, false), 0);
    }
}

/* The clamped straight beam buckles into two arches, two S-shapes (one negative eigenvalue each), then two
 * shapes with two negative eigenvalues. */
TEST("saddles are found if requested") {
    assert_true(branches(LG_ELASTICA_BOTH_ENDS, 0.0, 0, true) >= 6);
    const double energies[] = {11.084, 11.084, 22.442, 22.442, 43.774, 43.774};
    for (uint32_t i = 0; i < 6; i++) {
        assert_close(solutions[i].energy, energies[i], 0, 1e-3);
        assert_int_equal(solutions[i].negative_eigenvalues, i / 2);
    }
    /* A guess at a saddle gives the saddle of the continuous problem, which is told. */
    double guess[51], angles[51];
    const lg_elastica p = {.length = 3.3, .stiffness = 10.0, .qN = {3.0, 0.0}, .intervals = 50};
    lg_elastica_options o;
    lg_elastica_solution s;
    lg_error error = {LG_OK, ""};
    lg_elastica_options_init(&o);
    memcpy(guess, theta + 51 * 2, sizeof guess);
    o.guess = guess;
    assert_status(lg_elastica_solve_continuous(NULL, &p, &o, angles, NULL, &s, &error), LG_NO_CONVERGENCE);
    assert_says(error.message, "1 negative eigenvalues, so this is a saddle");
    assert_close(s.energy, energies[2], 1e-2, 0);
    /* Between two minima there is a saddle. */
    const size_t count = branches(LG_ELASTICA_BOTH_ENDS, 0.03, 0, true);
    assert_true(count >= 3);
    assert_int_equal(solutions[2].negative_eigenvalues, 1);
}

/* Branches of many nodes are found on a coarse grid first. */
TEST("branches of a fine beam are near the branches of a coarse one") {
    enum { COARSE = 100, FINE = 300 };
    double *fine = TEST_ARRAY(double, ROOM *(FINE + 1)), *coarse = TEST_ARRAY(double, ROOM *(COARSE + 1));
    lg_elastica p;
    for (int saddles = 0; saddles < 2; saddles++) {
        lg_elastica_solution found[2][ROOM];
        size_t count[2];
        lg_elastica_init(&p);
        lg_elastica_set_case(&p, LG_ELASTICA_BOTH_ENDS, 0.1 * PI);
        p.intervals = COARSE;
        assert_told(lg_elastica_branches(NULL, &p, NULL, saddles, ROOM, coarse, found[0], &count[0], &told));
        p.intervals = FINE;
        assert_told(lg_elastica_branches(NULL, &p, NULL, saddles, ROOM, fine, found[1], &count[1], &told));
        assert_true(count[0] >= 2 && count[1] >= 2); /* on fine grids tight loops are minima, too */
        for (size_t i = 0; i < count[1]; i++) {
            assert_true(found[1][i].residual < 1e-6);
            assert_true(saddles || found[1][i].negative_eigenvalues == 0);
            if (i < 2) assert_close(found[1][i].energy, found[0][i].energy, 2e-3, 0);
        }
    }
    EVERY_ALLOCATION_FAILS(context, 2, {
        size_t count;
        status = lg_elastica_branches(context, &p, NULL, false, 2, fine, solutions, &count, NULL);
    });
}

/* ---- few steps, rough tolerances, impossible beams ---- */

/* A beam of 2 to 40 intervals with any chord and up to 20 turns. */
static lg_elastica any_beam(lg_rng *rng) {
    static const double slack[] = {1.0, 0.5, 1e-3, 1e-9};
    lg_elastica p;
    lg_elastica_init(&p);
    p.intervals = 2 + (uint32_t)lg_rng_below(rng, lg_rng_below(rng, 2) == 0 ? 4 : 39);
    const double d = p.length * (1.0 - slack[lg_rng_below(rng, 4)]), turn = lg_rng_uniform_in(rng, -PI, PI);
    p.qN[0] = d * cos(turn);
    p.qN[1] = d * sin(turn);
    p.theta0 = lg_rng_uniform_in(rng, -8.0, 8.0);
    p.rotation =
        lg_rng_uniform_in(rng, -1.0, 1.0) * (lg_rng_below(rng, 3) == 0 ? PI * fmin(40, p.intervals) : 4.0);
    return p;
}

/* The solver finds a minimum, or it fails with a sentence that says why it found no minimum. */
static void judged(const lg_elastica *p, lg_status status, const lg_elastica_solution *s,
                   const lg_error *error) {
    if (status != LG_OK) {
        assert_int_equal(status, LG_NO_CONVERGENCE);
        assert_says(error->message, "elastica: ");
        return;
    }
    assert_int_equal(s->negative_eigenvalues, 0);
    assert_true(s->energy >= 0.0);
    assert_close(theta[0], p->theta0, 0, 0);
    assert_close(theta[p->intervals], p->theta0 + p->rotation, 0, 0);
}

TEST("with few steps or a rough tolerance any beam gives a minimum or a sentence") {
    static const double tolerances[] = {1e-12, 1e-3, 0.9}, steps[] = {0.05, 1.0, 2e-4};
    size_t failed = 0, found = 0;
    lg_rng rng = test_rng(21, 0);
    for (int i = 0; i < 24; i++) {
        double guess[ROOM * 51];
        const lg_elastica p = any_beam(&rng);
        lg_elastica_options o;
        lg_elastica_solution s;
        lg_error error = {LG_OK, ""};
        size_t count = 0;
        lg_elastica_options_init(&o);
        o.max_iterations = 1 + (uint32_t)lg_rng_below(&rng, i % 2 == 0 ? 3 : 60);
        o.gradient_tolerance = tolerances[lg_rng_below(&rng, 3)];
        o.max_step = steps[i / 2 % 3];
        for (size_t k = 0; k <= p.intervals; k++) guess[k] = p.theta0 + 3.0 * lg_rng_normal(&rng);
        if (i % 3 == 0) o.guess = guess;
        LG_STATUS_OF(lg_elastica_solve(NULL, &p, &o, theta, &s, &error), coarse);
        judged(&p, coarse, &s, &error);
        LG_STATUS_OF(lg_elastica_solve_continuous(NULL, &p, &o, theta, NULL, &s, &error), smooth);
        judged(&p, smooth, &s, &error);
        found += (coarse == LG_OK) + (smooth == LG_OK);
        failed += (coarse != LG_OK) + (smooth != LG_OK);
        if (i % 10 != 0) continue;
        assert_ok(lg_elastica_branches(NULL, &p, &o, true, ROOM, theta, solutions, &count, NULL));
        for (size_t k = 0; k < count; k++) assert_true(solutions[k].energy >= 0.0);
    }
    print_message("  %zu minima, %zu sentences\n", found, failed);
    assert_true(found >= 8 && failed >= 8);
}

TEST("invalid arguments of branches are refused") {
    lg_elastica p;
    lg_elastica_init(&p);
    size_t count = 5;
    assert_status(lg_elastica_branches(NULL, &p, NULL, false, 0, theta, solutions, &count, NULL),
                  LG_INVALID_ARGUMENT);
    p.theta0 = NAN;
    assert_status(lg_elastica_branches(NULL, &p, NULL, false, 1, theta, solutions, &count, NULL),
                  LG_NOT_FINITE);
    assert_int_equal(count, 5);
    p.theta0 = 0.0; /* room for one: the lowest */
    assert_ok(lg_elastica_branches(NULL, &p, NULL, false, 1, theta, solutions, &count, NULL));
    assert_int_equal(count, 1);
    assert_close(solutions[0].energy, 11.084103198529, 1e-10, 0);
}

/* ---- generated sets of curves ---- */

TEST("generated curves equal single solutions, discrete and continuous, for any number of threads") {
    for (int continuous = 0; continuous < 2; continuous++) {
        lg_elastica_sampling s;
        lg_elastica_sampling_init(&s);
        lg_elastica_curves one = {.count = 0}, two = {.count = 0};
        s.right_end = true;
        s.continuous = continuous;
        s.count = 91;
        assert_ok(lg_elastica_generate(NULL, &s, &one, NULL));
        assert_int_equal(one.count, 182);
        assert_int_equal(one.continuous, continuous);
        s.threads = 3;
        assert_ok(lg_elastica_generate(NULL, &s, &two, NULL));
        assert_memory_equal(one.q, two.q, 182 * 102 * sizeof(double));
        assert_memory_equal(one.v, two.v, 182 * 102 * sizeof(double));
        assert_memory_equal(one.energy, two.energy, 182 * sizeof(double));
        /* 46 values are in the first half */
        const double ends[4] = {0.01 * PI, 0.99 * PI, 1.01 * PI, 1.99 * PI};
        const double found[4] = {one.x[0], one.x[45], one.x[46], one.x[90]};
        assert_all_close(found, ends, 4, 1e-15, 0);
        for (size_t i = 0; i < one.count; i += 11) {
            lg_elastica p = s.problem;
            lg_elastica_solution solution;
            double q[102], v[102];
            assert_int_equal(one.kind[i], i < 91 ? LG_ELASTICA_BOTH_ENDS : LG_ELASTICA_RIGHT_END);
            lg_elastica_set_case(&p, (lg_elastica_case)one.kind[i], one.x[i]);
            assert_ok(continuous ? lg_elastica_solve_continuous(NULL, &p, NULL, theta, q, &solution, NULL)
                                 : lg_elastica_solve(NULL, &p, NULL, theta, &solution, NULL));
            lg_elastica_curve(&p, theta, continuous ? NULL : q, v);
            assert_close(one.energy[i], solution.energy, 1e-11, 0);
            assert_all_close(one.q + 102 * i, q, 102, 0, 1e-11);
            assert_all_close(one.v + 102 * i, v, 102, 0, 1e-11);
            const double boundary[8] = {q[0], q[1], v[0], v[1], q[100], q[101], v[100], v[101]};
            assert_all_close(one.boundary + 8 * i, boundary, 8, 0, 1e-11);
        }
        lg_elastica_curves_destroy(&one);
        lg_elastica_curves_destroy(&two);
        assert_null(two.q);
    }
}

TEST("without a gap the ends of the range are the bifurcations themselves") {
    lg_elastica_sampling s;
    lg_elastica_sampling_init(&s);
    lg_elastica_curves curves = {.count = 0};
    s.gap = 0.0;
    s.count = 9;
    assert_ok(lg_elastica_generate(NULL, &s, &curves, NULL));
    assert_close(curves.energy[0], curves.energy[8], 1e-12, 0); /* x = 0 and 2 pi */
    assert_close(curves.energy[4], curves.energy[5], 1e-12, 0); /* pi, twice */
    lg_elastica_curves_destroy(&curves);
    s.count =
        100; /* the last curve, at x = 2 pi, equals the first one, at x = 0, for other distances of x too */
    assert_ok(lg_elastica_generate(NULL, &s, &curves, NULL));
    for (size_t k = 0; k < 102; k++) assert_close(curves.q[99 * 102 + k], curves.q[k], 0, 1e-11);
    lg_elastica_curves_destroy(&curves);
    s.count = 1;
    assert_ok(lg_elastica_generate(NULL, &s, &curves, NULL));
    lg_elastica_curves_destroy(&curves);
}

TEST("sets of hard curves are generated, or the first impossible one is named") {
    size_t failed = 0;
    lg_rng rng = test_rng(22, 0);
    for (int i = 0; i < 16; i++) {
        lg_elastica_sampling s;
        lg_elastica_curves curves = {.count = 0};
        lg_error error = {LG_OK, ""};
        lg_elastica_sampling_init(&s);
        s.problem = any_beam(&rng);
        s.right_end = true;
        s.continuous = i % 8 == 0;
        s.count = s.continuous ? 5 : 64;
        LG_STATUS_OF(lg_elastica_generate(NULL, &s, &curves, &error), status);
        if (status != LG_OK) {
            failed++;
            assert_int_equal(status, LG_NO_CONVERGENCE);
            assert_says(error.message, "-end");
            assert_null(curves.q);
        }
        lg_elastica_curves_destroy(&curves);
    }
    print_message("  %zu of 16 sets have an impossible curve\n", failed);
}

TEST("invalid samplings are refused") {
    lg_error error;
    lg_elastica_curves curves = {.count = 77};
    lg_elastica_sampling bad[8];
    for (size_t i = 0; i < LG_COUNT(bad); i++) lg_elastica_sampling_init(&bad[i]);
    bad[0].both_ends = false;
    bad[1].count = 0;
    bad[2].gap = 0.5;
    bad[3].threads = 0;
    bad[4].problem.qN[0] = 3.3;
    bad[5].problem.intervals = 1;
    bad[6].gap = -0.1;
    bad[7].threads = 1025;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_status(lg_elastica_generate(NULL, &bad[i], &curves, &error), LG_INVALID_ARGUMENT);
        assert_true(strlen(error.message) > 10);
    }
    lg_elastica_sampling_init(&bad[0]);
    bad[0].gap = NAN;
    assert_status(lg_elastica_generate(NULL, &bad[0], &curves, &error), LG_NOT_FINITE);
    assert_int_equal(curves.count, 77);
    lg_elastica_sampling_init(&bad[0]);
    bad[0].count = SIZE_MAX / 2;
    assert_status(lg_elastica_generate(NULL, &bad[0], &curves, NULL), LG_OUT_OF_MEMORY);
    static const struct {
        size_t count;
        uint32_t intervals;
    } sizes[] = {{0, 50}, {1, 0}, {1, LG_ELASTICA_MAX_INTERVALS + 1}};
    for (size_t i = 0; i < LG_COUNT(sizes); i++)
        assert_status(lg_elastica_curves_create(NULL, sizes[i].count, sizes[i].intervals, true, &curves),
                      LG_INVALID_ARGUMENT);
    assert_status(lg_elastica_curves_create(NULL, 1, 50, true, NULL), LG_INVALID_ARGUMENT);
    lg_elastica_curves_destroy(NULL);
}

static lg_status everything(const lg_context *context) {
    lg_elastica_sampling s;
    lg_elastica_sampling_init(&s);
    lg_elastica_curves curves = {.count = 0};
    size_t count;
    s.count = 3;
    s.problem.intervals = 10;
    lg_elastica p = s.problem;
    lg_elastica_set_case(&p, LG_ELASTICA_BOTH_ENDS, 1.1);
    lg_status status = lg_elastica_solve(context, &p, NULL, theta, NULL, NULL);
    if (status == LG_OK) status = lg_elastica_solve_continuous(context, &p, NULL, theta, NULL, NULL, NULL);
    if (status == LG_OK)
        status = lg_elastica_branches(context, &p, NULL, true, 2, theta, solutions, &count, NULL);
    if (status == LG_OK) status = lg_elastica_generate(context, &s, &curves, NULL);
    lg_elastica_curves_destroy(&curves);
    s.continuous = true;
    if (status == LG_OK) status = lg_elastica_generate(context, &s, &curves, NULL);
    lg_elastica_curves_destroy(&curves);
    return status;
}

TEST("every allocation may fail") {
    EVERY_ALLOCATION_FAILS(context, 1, status = everything(context););
}

typedef struct canceller {
    volatile int stop;
    long left; /* allocations until stop becomes 1 */
} canceller;

static void *take_and_stop(void *user, size_t bytes) {
    canceller *c = user;
    void *block = NULL;
    if (--c->left == 0) c->stop = 1;
    return posix_memalign(&block, 64, bytes) == 0 ? block : NULL;
}

static void give(void *user, void *block) {
    (void)user;
    free(block);
}

/* What is cancelled at an allocation ends before its next step. */
TEST("solving and generating can be cancelled at any moment") {
    canceller c = {0, 0};
    lg_context_options o;
    lg_context *context;
    lg_elastica hopeless;
    lg_elastica_init(&hopeless);
    hopeless.qN[0] = 3.25, hopeless.theta0 = 0.3, hopeless.rotation = 4.0 * PI;
    lg_context_options_init(&o);
    o.allocate = take_and_stop, o.release = give, o.allocator_user = &c, o.cancel = &c.stop;
    assert_ok(lg_context_create(&o, &context));
    size_t cancelled = 0;
    for (long n = 1; c.left <= 0; n++) {
        c = (canceller){0, n};
        lg_status status = everything(context);
        if (status == LG_OK) status = lg_elastica_solve(context, &hopeless, NULL, theta, NULL, NULL);
        assert_true(status == LG_CANCELLED || status == LG_NO_CONVERGENCE);
        cancelled += status == LG_CANCELLED;
    }
    assert_true(cancelled > 10);
    lg_context_destroy(context);
}

TEST("solving and generating can be cancelled") {
    const volatile int stop = 1;
    lg_context_options o;
    lg_context *context;
    lg_context_options_init(&o);
    o.cancel = &stop;
    assert_ok(lg_context_create(&o, &context));
    assert_status(everything(context), LG_CANCELLED);
    lg_elastica_sampling s;
    lg_elastica_sampling_init(&s);
    lg_elastica_curves curves = {.count = 0};
    assert_status(lg_elastica_generate(context, &s, &curves, NULL), LG_CANCELLED);
    assert_null(curves.q);
    lg_context_destroy(context);
}

/* Retractions, equilibria, the zero-order hold, and regulators whose predicted cost is the cost of a run. */
#include <float.h>

#include "support/models.h"
#include "support/machine_support.h"
#include "support/model_support.h"
#include "golden/hold_table.h"
#include "support/malloc_count.h"

#include "liegrad/control.h"

/* ---- retractions and deviations ---- */

static lg_machine every_coordinate(void) {
    return machine_with(lg_term_kind_find(LG_MACHINE_MASS, "network"), LG_MACHINE_MASS);
}

/* deviation(retract(e c)) = e c + O(e^2), on the manifold. */
static void check_retract(const built *b, const lg_space *space, const double *y) {
    const size_t d = lg_model_inputs(b->model), r = lg_model_tangent_dim(b->model);
    const double *c = test_numbers(5, r, -1.0, 1.0);
    double *moved = room(d), *step = room(r), *back = room(r), before = NAN;
    for (int halving = 0; halving < 6; halving++) {
        const double e = 0.1 * exp2(-halving);
        double off = 0.0;
        for (size_t i = 0; i < r; i++) step[i] = e * c[i];
        assert_ok(lg_model_retract(b->model, y, step, moved, b->work));
        assert_true(lg_space_manifold_error(space, moved) < 1e-14);
        assert_ok(lg_model_deviation(b->model, y, moved, back, b->work));
        for (size_t i = 0; i < r; i++) off = fmax(off, fabs(back[i] - step[i]));
        assert_true(off < 1e-13 || !(off > 0.3 * before)); /* the difference falls to a quarter each time */
        before = fmax(off, 0.25 * before);                 /* a difference may be smaller by chance */
    }
}

TEST("a retraction stays on the manifold, and its deviation gives the coordinates back") {
    for (size_t i = 0; i < motions(); i++) {
        const moving s = make_motion(i, LG_POTENTIAL_MLP, LG_TANH);
        const lg_space space = space_of(&s.b);
        check_retract(&s.b, &space, s.y);
    }
    const lg_machine machine = every_coordinate();
    built b = {.model = NULL};
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES];
    lg_space space;
    assert_ok(test_machine_model(NULL, &machine, machine_theta(&machine, 4), &b.model, NULL));
    b = ready_to_run(b);
    double *y = room(lg_model_inputs(b.model));
    assert_ok(lg_machine_space(&machine, &space));
    random_rows(&machine, 2, 1, q, v);
    assert_ok(lg_model_machine_state(b.model, q, v, y, b.work));
    check_retract(&b, &space, y);
}

TEST("equilibria are found upright, hanging and under a torque; a state without one nearby is refused") {
    const built b = build_pendulum(2.0, 5.0);
    const double c = sqrt(0.5);
    double up[6] = {0.2, -0.1, 0.9, 0.3, 0.0, 0.0}, down[6] = {0.3, 0.0, -1.0, 0.0, 0.2, 0.1}, drift = 1.0;
    double held[6] = {0.6, 0.0, 0.8, 0.0, 0.0, 0.0};
    const double torque[3] = {0.0, -5.0 * c,
                              0.0}; /* against gravity at 45 degrees: q x -5 e3 = 5 (-q_2, q_1, 0) */
    const lg_space space = space_of(&b);
    double *const starts[] = {up, down, held};
    for (int i = 0; i < 3; i++) lg_space_project(&space, starts[i]);
    assert_ok(lg_model_equilibrium(b.model, NULL, up, &drift, b.work));
    assert_all_close(up, ((double[]){0, 0, 1, 0, 0, 0}), 6, 0.0, 1e-12);
    assert_true(drift < 1e-11);
    assert_ok(lg_model_equilibrium(b.model, NULL, down, NULL, b.work));
    assert_all_close(down, ((double[]){0, 0, -1, 0, 0, 0}), 6, 0.0, 1e-12);
    assert_ok(lg_model_equilibrium(b.model, torque, held, NULL, b.work));
    assert_all_close(held, ((double[]){c, 0, c, 0, 0, 0}), 6, 0.0, 1e-7);
    const double strong[3] = {0.0, 9.0, 0.0}; /* more than gravity can balance */
    double before[6];
    memcpy(before, held, sizeof held);
    assert_status(lg_model_equilibrium(b.model, strong, held, &drift, b.work), LG_NO_CONVERGENCE);
    assert_memory_equal(held, before, sizeof held);
}

/* ---- zero-order hold ---- */

static void hold(size_t n, size_t m, const double *A, const double *B, double h, double *Ad, double *Bd) {
    const size_t bytes = lg_zero_order_hold_work_size(n, m);
    assert_told(lg_zero_order_hold(n, m, A, B, h, Ad, Bd, test_work(bytes), bytes, &told));
}

TEST("the zero-order hold of integrators, an oscillator and stiff systems is exact to rounding") {
    const double chain[4] = {0, 1, 0, 0}, push[2] = {0, 1}, swing[4] = {0, 3, -3, 0};
    double Ad[4], Bd[2];
    hold(2, 1, chain, push, 0.25, Ad, Bd);
    assert_all_close(Ad, ((double[]){1, 0.25, 0, 1}), 4, 1e-15, 1e-16);
    assert_all_close(Bd, ((double[]){0.03125, 0.25}), 2, 1e-15, 0.0);
    hold(2, 1, swing, push, 2.0, Ad, Bd);
    assert_all_close(Ad, ((double[]){cos(6), sin(6), -sin(6), cos(6)}), 4, 0.0, 1e-14);
    assert_all_close(Bd, ((double[]){(1 - cos(6)) / 3, sin(6) / 3}), 2, 0.0, 1e-14);
    const double fast[4] = {-1e6, 0, 0, -1e-6}, strong[2] = {1e9, 1e-9};
    hold(2, 1, fast, strong, 1e-3, Ad, Bd);
    assert_all_close(Ad, ((double[]){exp(-1e3), 0, 0, exp(-1e-9)}), 4, 1e-12, 1e-300);
    assert_all_close(Bd, ((double[]){1e3, 1e-12}), 2, 1e-9, 0.0);
    hold(1, 1, (double[]){-1e30}, push + 1, 1.0, Ad, Bd);
    assert_true(Ad[0] == 0.0);
    assert_close(Bd[0], 1e-30, 1e-12, 0.0);
    const double beyond[4] = {1e300, 1e300, -1e300, 1e300};
    assert_status(lg_zero_order_hold(2, 1, beyond, push, 1e10, Ad, Bd, test_work(4096), 4096, NULL),
                  LG_NOT_FINITE);
    hold(2, 1, chain, push, 0.0, Ad, Bd);
    assert_all_close(Ad, ((double[]){1, 0, 0, 1}), 4, 0.0, 0.0);
    assert_status(lg_zero_order_hold(2, 1, chain, push, NAN, Ad, Bd, test_work(4096), 4096, NULL),
                  LG_NOT_FINITE);
}

static double distance(size_t count, const double *a, const double *b) {
    double apart = 0.0, size = 0.0;
    for (size_t i = 0; i < count; i++) apart = hypot(apart, a[i] - b[i]), size = hypot(size, b[i]);
    return apart > 0.0 ? apart / size : apart;
}

TEST("the zero-order hold agrees with 50 digits: integrators, stiff, badly scaled, overscaled, huge, tiny") {
    print_message("%-28s %9s %9s %9s %9s\n", "relative errors", "Ad", "Bd", "SciPy", "condition");
    for (size_t i = 0; i < LG_COUNT(hold_table); i++) {
        const hold_case *c = &hold_table[i];
        const size_t n = c->n, m = c->m;
        const double *A = c->numbers, *B = A + n * n, *exact = B + n * m;
        double *Ad = TEST_ARRAY(double, n *n), *Bd = TEST_ARRAY(double, n *m);
        hold(n, m, A, B, c->h, Ad, Bd);
        const double off_A = distance(n * n, Ad, exact), off_B = distance(n * m, Bd, exact + n * n);
        print_message("%-28s %9.1e %9.1e %9.1e %9.1e\n", c->name, off_A, off_B, c->scipy, c->condition);
        assert_true(fmax(off_A, off_B) <= 4.0 * DBL_EPSILON * fmax(1.0, c->condition));
    }
}

/* ---- regulators ---- */

enum { R = 4, M = 3 };
static const double upright[6] = {0, 0, 1, 0, 0, 0};
static const double Q[R * R] = {4, 0, 0.5, 0, 0, 3, 0, 0.2, 0.5, 0, 2, 0, 0, 0.2, 0, 1};
static const double weights[M * M] = {1, 0, 0, 0, 2, 0, 0, 0, 1.5};
static const double cross[R * M] = {0.1, 0, 0, 0, 0.2, 0, 0, -0.1, 0, 0.1, 0, 0};

static lg_lqr regulator(const built *b, double period) {
    lg_lqr_options options;
    lg_lqr lqr;
    const size_t bytes = lg_lqr_size(b->model);
    lg_lqr_options_init(&options);
    options.state = upright, options.Q = Q, options.R = weights, options.S = cross, options.period = period;
    assert_true(bytes > 0);
    assert_told(lg_lqr_init(b->model, &options, &lqr, test_work(bytes), bytes, &told));
    return lqr;
}

/* The cost c'Q c + 2 c'S u + u'R u. */
static double cost(const double *c, const double *u) {
    double sum = 0.0;
    for (int i = 0; i < R; i++) {
        for (int j = 0; j < R; j++) sum += c[i] * Q[i * R + j] * c[j];
        for (int j = 0; j < M; j++) sum += 2.0 * c[i] * cross[i * M + j] * u[j];
    }
    for (int i = 0; i < M; i++) sum += weights[i * M + i] * u[i] * u[i];
    return sum;
}

static double quadratic(const double *P, const double *c) {
    double sum = 0.0;
    for (int i = 0; i < R; i++)
        for (int j = 0; j < R; j++) sum += c[i] * P[i * R + j] * c[j];
    return sum;
}

/* The cost of a run of the model from a small deviation; u is computed every `steps` steps. */
static double run_cost(const built *b, const lg_lqr *lqr, double h, int steps, double *c0) {
    lg_stepper *stepper = stepper_of(b, lg_scheme_find("rkmk4"));
    double y[6], u[M] = {0.0}, total = 0.0;
    assert_ok(lg_model_retract(b->model, upright, c0, y, b->work));
    for (int n = 0; n < 40000; n++) {
        if (n % steps == 0) {
            assert_ok(lg_lqr_control(lqr, y, u));
            total += cost(lqr->c, u) * (lqr->period > 0.0 ? 1.0 : n == 0 ? 0.5 * h : h);
        }
        assert_ok(lg_stepper_step(stepper, 0.0, h, y, u, y));
    }
    assert_true(fabs(y[0]) < 1e-9 && fabs(y[3]) < 1e-9);
    return total;
}

TEST("a regulator brings the pendulum upright at the cost that P predicts") {
    const built b = build_pendulum(2.0, 5.0);
    double c0[R] = {1e-3, -5e-4, 2e-3, 1e-3};
    const lg_lqr continuous = regulator(&b, 0.0), held = regulator(&b, 0.1);
    assert_true(continuous.result.margin > 0.0 && held.result.margin > 0.0 && held.drift < 1e-15);
    /* c' = (0 1/m; c 0) c is the regulator's A. */
    assert_close(continuous.A[2], 0.5, 1e-14, 0.0);
    assert_close(continuous.A[2 * R], 5.0, 1e-14, 0.0);
    assert_close(held.A[0], cosh(0.1 * sqrt(2.5)), 1e-13, 0.0);
    assert_close(run_cost(&b, &held, 0.01, 10, c0), quadratic(held.P, c0), 1e-5, 0.0);
    /* u is held for 2e-4 s and the cost is a trapezoidal sum, so the remaining error is O(h). */
    const double coarse = run_cost(&b, &continuous, 1e-3, 1, c0),
                 fine = run_cost(&b, &continuous, 5e-4, 1, c0);
    assert_close(2.0 * fine - coarse, quadratic(continuous.P, c0), 1e-5, 0.0);
    /* Any other gain costs more. */
    const double least = run_cost(&b, &held, 0.01, 10, c0);
    double *K = (double *)held.K; /* its memory belongs to this test */
    for (int i = 0; i < M * R; i += 5) {
        const double kept = K[i];
        for (int sign = -1; sign <= 1; sign += 2) {
            K[i] = kept + 0.3 * sign;
            assert_true(run_cost(&b, &held, 0.01, 10, c0) > least);
        }
        K[i] = kept;
    }
}

TEST("a regulator refuses states that are no equilibria, missing inputs and too little memory, with the "
     "reason") {
    const built b = build_pendulum(2.0, 5.0), surrogate = build_surrogate(LG_SURROGATE_DISCRETE);
    const double tilted[6] = {0.6, 0, 0.8, 0, 0, 0};
    const size_t bytes = lg_lqr_size(b.model);
    void *memory = test_work(bytes);
    lg_lqr_options options;
    lg_lqr lqr = {.r = 77};
    lg_error error;
    lg_lqr_options_init(&options);
    options.state = tilted, options.Q = Q, options.R = weights;
    assert_status(lg_lqr_init(b.model, &options, &lqr, memory, bytes, &error), LG_CHECK_FAILED);
    assert_says(error.message, "not an equilibrium: a coordinate changes by 3 per second");
    options.most_drift = 3.1;
    assert_ok(lg_lqr_init(b.model, &options, &lqr, memory, bytes, &error));
    lqr.r = 77;
    options.state = upright;
    assert_status(lg_lqr_init(b.model, &options, &lqr, memory, bytes - 1, &error), LG_INVALID_ARGUMENT);
    lg_lqr_options bad[3] = {options, options, options};
    bad[0].size = 3, bad[1].state = NULL, bad[2].period = -1.0;
    for (size_t i = 0; i < LG_COUNT(bad); i++)
        assert_status(lg_lqr_init(b.model, &bad[i], &lqr, memory, bytes, &error), LG_INVALID_ARGUMENT);
    double A[4] = {0, 1, 0, 0}, B[2] = {0, 1}, Ad[4], Bd[2];
    const size_t room_of = lg_zero_order_hold_work_size(2, 1);
    void *room_for_hold = test_work(room_of);
    assert_int_equal(lg_zero_order_hold_work_size(0, 1), 0);
    assert_status(lg_zero_order_hold(0, 1, A, B, 0.1, Ad, Bd, room_for_hold, room_of, &error),
                  LG_INVALID_ARGUMENT);
    for (int i = 0; i < 2; i++) {
        (i == 0 ? A : B)[0] = NAN;
        assert_status(lg_zero_order_hold(2, 1, A, B, 0.1, Ad, Bd, room_for_hold, room_of, &error),
                      LG_NOT_FINITE);
        (i == 0 ? A : B)[0] = 0.0;
    }
    A[0] = 1e4; /* exp(1000) */
    assert_status(lg_zero_order_hold(2, 1, A, B, 0.1, Ad, Bd, room_for_hold, room_of, &error), LG_NOT_FINITE);
    assert_says(error.message, "the exponential over 0.1 s is not finite");
    options.Q = NULL;
    assert_status(lg_lqr_init(b.model, &options, &lqr, memory, bytes, &error), LG_INVALID_ARGUMENT);
    assert_int_equal(lqr.r, 77);
    assert_int_equal(lg_lqr_size(surrogate.model), 0);
    assert_status(lg_lqr_init(surrogate.model, &options, &lqr, memory, bytes, &error), LG_UNSUPPORTED);
}

TEST("a regulator in a loop allocates nothing and takes no lock; with NaN it gives no input") {
    const built b = build_pendulum(2.0, 5.0);
    const lg_lqr lqr = regulator(&b, 0.0);
    double y[6] = {0, 0, 1, 0, 0, 0}, u[M] = {7, 7, 7};
    lg_status status = LG_OK;
    y[4] = NAN;
    assert_status(lg_lqr_control(&lqr, y, u), LG_NOT_FINITE);
    assert_true(u[0] == 7 && u[2] == 7);
    if (!lg_count_available()) skip();
    y[4] = 0.1;
    assert_no_malloc_no_lock(status = lg_lqr_control(&lqr, y, u));
    assert_ok(status);
}

/* Policies under noise, late inputs and other machines; set points; the bound on what goes back through runs.
 * ctest-labels: src/control */
#include "liegrad/geometry.h"
#include "liegrad/ops.h"
#include "support/policies.h"

static const char heavy[] =
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: angle, "
    "velocity: w}]\n"
    "inputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: 1, pole: 0.4, length: 1, gravity: 9.81}\n"
    "input_map: {kind: known, values: [[1], [0]]}\n";

static lg_policy_task disturbed_task(double noise, double delay) {
    lg_policy_task task = cart_task();
    for (int i = 0; i < 2; i++)
        task.coordinate[i].noise = noise, task.coordinate[i].noise_velocity = 2.0 * noise;
    task.delay = delay;
    return task;
}

/* Random errors of starts, and the states. */
typedef struct starts {
    double *z, *x;
} starts;

static starts draw(const lg_policy *policy, size_t count, uint64_t seed) {
    lg_rng rng = test_rng(seed, 0);
    const size_t n = policy->layout.errors;
    const starts s = {TEST_ARRAY(double, count *n), TEST_ARRAY(double, count * policy->state)};
    for (size_t i = 0; i < count; i++) lg_policy_draw(policy, &rng, s.z + i * n);
    assert_ok(lg_policy_states(policy, s.z, count, s.x, NULL));
    return s;
}

static lg_policy_runs run(const lg_policy *policy, const double *x, size_t count, size_t steps,
                          bool disturbed) {
    lg_policy_runs runs = {.count = count,
                           .steps = steps,
                           .x = TEST_ARRAY(double, count * policy->state),
                           .cost = TEST_ARRAY(double, count),
                           .succeeded = TEST_ARRAY(bool, count),
                           .input = TEST_ARRAY(double, steps *count)};
    const lg_policy_trial trial = {.theta = policy->theta, .disturbed = disturbed, .seed = 3, .threads = 1};
    memcpy(runs.x, x, count * policy->state * sizeof *x);
    assert_ok(lg_policy_run(policy, &trial, &runs, NULL));
    return runs;
}

TEST("a disturbance that is too small to matter leaves the runs as they are") {
    const lg_policy_task task = disturbed_task(1e-300, 0.0);
    const lg_policy *policy = make(&task, cart_pole);
    const starts s = draw(policy, 100, 1);
    const lg_policy_runs plain = run(policy, s.x, 100, 20, false), same = run(policy, s.x, 100, 20, true);
    for (size_t i = 0; i < 100; i++) assert_close(same.cost[i], plain.cost[i], 1e-12, 0.0);
    for (size_t i = 0; i < 400; i++) assert_close(same.x[i], plain.x[i], 1e-9, 1e-9);
}

TEST("a late input is the one that was asked for a period before") {
    const lg_policy_task task = disturbed_task(0.0, 1.0);
    const lg_policy *policy = make(&task, cart_pole);
    enum { N = 5, STEPS = 12 };
    const starts s = draw(policy, N, 2);
    const lg_policy_runs late = run(policy, s.x, N, STEPS, true);
    double x[N * 4], next[N * 4], q[N * 2], v[N * 2], before[N], asked[N];
    memcpy(x, s.x, sizeof x);
    for (int i = 0; i < N; i++) before[i] = policy->regulator.u0[0];
    for (int k = 0; k < STEPS; k++) {
        for (int i = 0; i < N; i++) assert_close(late.input[k * N + i], before[i], 1e-9, 1e-9);
        assert_ok(lg_program_eval(NULL, policy->program, "positions", N, (const double *const[]){x},
                                  (double *const[]){q}, NULL));
        assert_ok(lg_program_eval(NULL, policy->program, "velocities", N, (const double *const[]){x},
                                  (double *const[]){v}, NULL));
        assert_ok(lg_program_eval(NULL, policy->program, "policy", N,
                                  (const double *const[]){q, v, policy->theta}, (double *const[]){asked},
                                  NULL));
        assert_ok(lg_program_eval(NULL, policy->program, "period", N, (const double *const[]){x, before},
                                  (double *const[]){next}, NULL));
        memcpy(x, next, sizeof x);
        memcpy(before, asked, sizeof before);
    }
    for (int i = 0; i < N * 4; i++) assert_close(late.x[i], x[i], 1e-9, 1e-9);
}

TEST("noise has the deviations of the task, and about the asked share of the runs is late") {
    const lg_policy_task task = disturbed_task(0.1, 0.25);
    const lg_policy *policy = make(&task, cart_pole);
    enum { PIECES = 40, PERIODS = 5 };
    double square[4] = {0}, late_runs = 0.0;
    double *noise = TEST_ARRAY(double, PERIODS *LG_POLICY_ROWS * 4), late[LG_POLICY_ROWS];
    for (uint64_t piece = 0; piece < PIECES; piece++) {
        lg_policy_draw_noise(policy, 7, piece, PERIODS, LG_F64, noise, late);
        for (size_t i = 0; i < (size_t)PERIODS * LG_POLICY_ROWS * 4; i++)
            square[i % 4] += noise[i] * noise[i];
        for (size_t i = 0; i < LG_POLICY_ROWS; i++) late_runs += late[i];
    }
    for (int i = 0; i < 4; i++)
        assert_close(sqrt(square[i] / (PIECES * PERIODS * LG_POLICY_ROWS)), i < 2 ? 0.1 : 0.2, 0.05, 0.0);
    assert_close(late_runs / (PIECES * LG_POLICY_ROWS), 0.25, 0.15, 0.0);
}

/* Sensors of every kind of coordinate: small noise turns an attitude and a direction by its vector. */
TEST("noise of a rotation turns it by a small vector in the body, of a direction about an axis in space") {
    lg_policy_task task;
    lg_tape *tape;
    double R[9], q[12], noisy[12];
    static const double turn[3] = {0.4, -0.3, 0.2};
    const double n[12] = {1e-6, -2e-6, 3e-6, 2e-6, 1e-6, -1e-6};
    lg_policy_task_init(&task);
    task.coordinate_count = 2;
    task.coordinate[0] = coordinate("R", "vR", LG_POLICY_ROTATION, 1.0);
    task.coordinate[1] = coordinate("d", "vd", LG_POLICY_DIRECTION, 1.0);
    lg_so3_exp(turn, R);
    memcpy(q, R, sizeof R);
    const double d[3] = {0.6, 0.0, 0.8}, v[6] = {0};
    memcpy(q + 9, d, sizeof d);
    lg_policy p = {.task = task};
    lg_policy_lay_out(&task, &p.layout);
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    const lg_policy_seen seen = {lg_input_f64(tape, lg_shape2(1, 12), q),
                                 lg_input_f64(tape, lg_shape2(1, 6), v)};
    const lg_policy_seen sensed =
        lg_policy_record_noise(tape, &p, seen, lg_input_f64(tape, lg_shape2(1, 12), n));
    assert_ok(lg_read(tape, sensed.q, 12, noisy));
    lg_tape_destroy(tape);
    double by[9], moved[3];
    lg_so3_exp(n, by);
    lg_so3_exp_act(n + 3, d, moved);
    for (int i = 0; i < 3; i++) {
        assert_close(noisy[9 + i], moved[i], 0.0, 1e-11);
        for (int j = 0; j < 3; j++) {
            double sum = 0.0;
            for (int k = 0; k < 3; k++) sum += R[3 * i + k] * by[3 * k + j];
            assert_close(noisy[3 * i + j], sum, 0.0, 1e-11);
        }
    }
}

TEST(
    "noise of any size leaves directions of length 1 and rotations: errors are finite opposite to the goal") {
    static const double turn[3] = {0, 3.141592653589793, 0};
    const double n[12] = {0.4, -0.7, 0.2, 0.3, -0.1, 0.6};
    lg_policy_task task;
    lg_tape *tape;
    double q[12] = {[11] = -1.00001}, v[6] = {0}, seen[12], z[10], by[9];
    lg_policy_task_init(&task);
    task.coordinate_count = 2;
    task.coordinate[0] = coordinate("R", "vR", LG_POLICY_ROTATION, 1.0);
    task.coordinate[1] = coordinate("d", "vd", LG_POLICY_DIRECTION, 1.0);
    lg_policy p = {.task = task};
    lg_policy_lay_out(&task, &p.layout);
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    lg_so3_exp(turn, q);
    lg_policy_seen at = {lg_input_f64(tape, lg_shape2(1, 12), q), lg_input_f64(tape, lg_shape2(1, 6), v)};
    at = lg_policy_record_noise(tape, &p, at, lg_input_f64(tape, lg_shape2(1, 12), n));
    assert_ok(lg_read(tape, at.q, 12, seen));
    const double given[7] = {[2] = 2.0, [6] = -1.00001}; /* a quaternion, then the direction */
    at.q = lg_policy_record_positions(tape, &p, false, lg_input_f64(tape, lg_shape2(1, 7), given));
    /* From the half turn to its quaternion, and back. */
    at.q = lg_policy_record_positions(tape, &p, false, lg_policy_record_positions(tape, &p, true, at.q));
    assert_ok(lg_read(tape, lg_policy_record_errors(tape, &p, false, at), p.layout.errors, z));
    lg_tape_destroy(tape);
    for (uint32_t i = 0; i < p.layout.errors; i++) assert_close(z[i], 0.0, 0.0, 1e-9);
    lg_so3_exp(n, by); /* R by, R = diag(-1, 1, -1) */
    for (int i = 0; i < 9; i++) assert_close(seen[i], i / 3 == 1 ? by[i] : -by[i], 1e-12, 1e-12);
    assert_close(hypot(hypot(seen[9], seen[10]), seen[11]), 1.0, 1e-14, 0.0);
}

TEST("equal starts in two pieces have other noise, and the same noise when they are run again") {
    const lg_policy_task task = disturbed_task(0.02, 0.0);
    const lg_policy *policy = make(&task, cart_pole);
    enum { N = LG_POLICY_ROWS };
    const size_t numbers = N * (size_t)policy->state;
    const starts s = draw(policy, N, 4);
    double *twice = TEST_ARRAY(double, 2 * numbers);
    memcpy(twice, s.x, numbers * sizeof *twice);
    memcpy(twice + numbers, s.x, numbers * sizeof *twice);
    const lg_policy_runs both = run(policy, twice, 2 * (size_t)N, 10, true),
                         one = run(policy, s.x, N, 10, true);
    assert_memory_equal(both.cost, one.cost, N * sizeof *one.cost);
    for (int i = 0; i < N; i++) assert_true(both.cost[N + i] != one.cost[i]);
}

TEST("disturbed runs take the machines that were added in turn") {
    const lg_policy_task task = disturbed_task(1e-300, 0.0);
    lg_policy *policy = make(&task, cart_pole), *other;
    assert_ok(lg_policy_transplant(policy, machine_program(heavy), NULL, &other, NULL));
    lg_test_owns(other, release_policy);
    assert_ok(lg_policy_add_draw(policy, machine_program(cart_pole), NULL));
    assert_ok(lg_policy_add_draw(policy, machine_program(heavy), NULL));
    enum { N = 3 * LG_POLICY_ROWS };
    const starts s = draw(policy, N, 4);
    const lg_policy_runs mixed = run(policy, s.x, N, 10, true), own = run(policy, s.x, N, 10, false),
                         heavier = run(other, s.x, N, 10, false);
    size_t differ = 0;
    for (size_t i = 0; i < N; i++) {
        const bool second = i / LG_POLICY_ROWS == 1;
        assert_close(mixed.cost[i], second ? heavier.cost[i] : own.cost[i], 1e-3, 0.0);
        differ += fabs(mixed.cost[i] - own.cost[i]) > 1e-3 * own.cost[i];
    }
    assert_true(differ > 48 && differ <= LG_POLICY_ROWS);
}

/* ---- gradients ---- */

TEST("the gradient of disturbed runs on two machines is that of differences") {
    lg_policy_task task = disturbed_task(0.02, 0.5);
    task.draws = 2;
    lg_policy *policy = make(&task, cart_pole);
    assert_ok(lg_policy_add_draw(policy, machine_program(cart_pole), NULL));
    assert_ok(lg_policy_add_draw(policy, machine_program(heavy), NULL));
    rolled of = roll(policy, draw(policy, 2 * LG_POLICY_ROWS, 8).x, 2);
    of.seed = 5, of.first = 6;
    check_rolled(&of);
}

TEST("the cost of late runs in training is the cost of the same runs when they are judged") {
    const lg_policy_task task = disturbed_task(1e-300, 1.0);
    const lg_policy *policy = make(&task, cart_pole);
    enum { N = LG_POLICY_ROWS };
    const starts s = draw(policy, N, 9);
    const rolled of = roll(policy, s.x, 1);
    double *g = TEST_ARRAY(double, policy->parameters), *end = TEST_ARRAY(double, N), sum = 0.0;
    const double cost = rolled_cost(&of, g);
    const lg_policy_runs late = run(policy, s.x, N, of.steps, true);
    assert_ok(lg_program_eval(NULL, policy->program, "terminal", N, (const double *const[]){late.x},
                              (double *const[]){end}, NULL));
    for (int i = 0; i < N; i++) sum += (late.cost[i] + end[i]) / N;
    assert_close(cost, sum, 1e-10, 0.0);
}

TEST("a bounded gradient is the mean over starts: the same starts twice change nothing") {
    const lg_policy_task task = cart_task();
    const lg_policy *policy = make(&task, cart_pole);
    enum { N = LG_POLICY_ROWS };
    const size_t n = policy->parameters, numbers = N * (size_t)policy->state;
    const starts s = draw(policy, N, 8);
    double *twice = TEST_ARRAY(double, 2 * numbers), *g = TEST_ARRAY(double, n),
           *same = TEST_ARRAY(double, n);
    memcpy(twice, s.x, numbers * sizeof *twice);
    memcpy(twice + numbers, s.x, numbers * sizeof *twice);
    rolled one = roll(policy, s.x, 1), both = roll(policy, twice, 2);
    one.bound = both.bound = 0.02 * policy->terminal;
    assert_close(rolled_cost(&one, g), rolled_cost(&both, same), 1e-12, 0.0);
    assert_all_close(same, g, n, 1e-9, 1e-12);
}

static double length_of(const double *x, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += x[i] * x[i];
    return sqrt(sum);
}

TEST("a bound that no run meets changes nothing, a small one shortens the gradient, in any unit of length") {
    double first = 0.0;
    for (int k = 0; k < 2; k++) {
        const double l = k == 0 ? 1.0 : 1e9;
        lg_policy_task task = cart_task();
        for (int i = 0; i < 2; i++)
            task.coordinate[0].start[i] *= l, task.coordinate[0].start_velocity[i] *= l;
        task.coordinate[0].weight /= l * l, task.coordinate[0].weight_velocity /= l * l;
        task.input[0].low *= l, task.input[0].high *= l, task.input[0].weight /= l * l;
        const lg_policy *policy = make(
            &task,
            test_text("columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, "
                      "kind: angle, velocity: w}]\ninputs: {columns: [u]}\nsystem: cart-pole\nparameters: "
                      "{cart: 1, pole: 0.1, length: %.17g, gravity: %.17g}\ninput_map: {kind: known, "
                      "values: [[1], [0]]}\n",
                      l, 9.81 * l));
        const size_t n = policy->parameters;
        rolled of = roll(policy, draw(policy, LG_POLICY_ROWS, 8).x, 1);
        double *g = TEST_ARRAY(double, n), *same = TEST_ARRAY(double, n), *less = TEST_ARRAY(double, n);
        const double cost = rolled_cost(&of, g);
        of.bound = 1e9 * cost;
        (void)rolled_cost(&of, same);
        assert_memory_equal(g, same, n * sizeof *g);
        of.bound = 1e-3 * cost;
        (void)rolled_cost(&of, less);
        assert_true(length_of(less, n) < 0.5 * length_of(g, n) && length_of(less, n) > 0.0);
        if (k == 0) first = length_of(less, n);
        assert_close(length_of(less, n), first, 1e-5, 0.0);
    }
}

/* ---- set points ---- */

TEST("at a set point the controller does what it does at the goal, and a rate moves with it") {
    lg_policy_task task = cart_task();
    task.coordinate[0].track = true;
    const lg_policy *policy = make(&task, cart_pole);
    const double x[4] = {0.3, 0.7, -0.2, 0.4}, moved[4] = {5.3, 0.7, 0.9, 0.4}, reference[2] = {5.0, 1.1};
    double u, same;
    assert_ok(lg_program_eval(NULL, policy->program, "control", 1, (const double *const[]){x},
                              (double *const[]){&u}, NULL));
    assert_ok(lg_program_eval(NULL, policy->program, "track", 1, (const double *const[]){moved, reference},
                              (double *const[]){&same}, NULL));
    assert_close(same, u, 1e-12, 0.0);
}

TEST("set points are refused where the machine moves otherwise") {
    lg_policy_task task = cart_task();
    lg_policy *policy;
    lg_error error;
    task.coordinate[1].track = true;
    assert_int_equal(lg_policy_create(NULL, &task, machine_program(cart_pole), 1, &policy, &error),
                     LG_CHECK_FAILED);
    assert_non_null(strstr(error.message, "track: the machine moves otherwise where th is 1 larger"));
    lg_policy_task turning = body_task(LG_POLICY_LQR);
    turning.coordinate[0].track = true;
    assert_int_equal(lg_policy_create(NULL, &turning, machine_program(body), 1, &policy, &error),
                     LG_INVALID_ARGUMENT);
}

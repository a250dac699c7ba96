/* Policies of machines whose inputs act behind lags: a weight that is hoisted by a slow motor.
 * ctest-labels: src/control src/machine */
#include <unistd.h>

#include "support/policies.h"

/* A weight of 2 kg on a line with damping, in units of mass, length and time; `lag` is a part of the
 * inputs. */
static lg_program *hoist(const char *lag, double m, double l, double t) {
    const double force = m * l / (t * t);
    return machine_program(test_text(
        "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: {columns: "
        "[u], lag: %s}\nmass: {kind: known, values: [[%.17g]]}\ndamping: {kind: known, values: "
        "[%.17g]}\noffset: {kind: known, values: [%.17g]}\ninput_map: {kind: known, values: [[3]]}\n",
        lag, 2 * m, 0.5 * m / t, -6 * force));
}

static lg_policy_task hoist_task(uint32_t lags, lg_policy_kind kind) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.coordinate_count = 1 + lags, task.input_count = 1, task.kind = kind;
    task.coordinate[0] = coordinate("x", "v", LG_POLICY_LINE, 0.5);
    for (uint32_t k = 0; k < lags; k++)
        task.coordinate[1 + k] = (lg_policy_coordinate){
            .name = "lagged", .follows = 1, .success = INFINITY, .success_velocity = INFINITY};
    task.input[0] = (lg_policy_input){"u", -1.0, 6.0, 0.01};
    task.hidden_layers = 1, task.hidden[0] = 8;
    task.period = 0.1, task.horizon = 3.0, task.within = 8.0;
    return task;
}

static lg_policy *make_hoist(const char *lag, uint32_t lags, lg_policy_kind kind) {
    const lg_policy_task task = hoist_task(lags, kind);
    lg_policy *policy;
    lg_error error = {LG_OK, ""};
    if (lg_policy_create(NULL, &task, hoist(lag, 1, 1, 1), 1, &policy, &error) != LG_OK)
        fail_msg("%s", error.message);
    lg_test_owns(policy, release_policy);
    return policy;
}

static void call(const lg_policy *policy, const char *function, size_t rows, const double *a, const double *b,
                 double *out) {
    assert_ok(lg_program_eval(NULL, lg_policy_program(policy), function, rows, (const double *const[]){a, b},
                              (double *const[]){out}, NULL));
}

TEST("the goal of a lagged input is the input that holds the weight, and the weight stays there") {
    static const struct {
        const char *lag;
        uint32_t lags;
    } rows[] = {{"0.3", 1}, {"{order: 2, value: 0.1}", 2}};
    for (size_t k = 0; k < LG_COUNT(rows); k++) {
        const lg_policy *p = make_hoist(rows[k].lag, rows[k].lags, LG_POLICY_NETWORK);
        assert_close(p->regulator.u0[0], 2.0, 1e-9, 0.0);
        assert_true(p->regulator.residual < 1e-9);
        double given[5] = {0}, x[5], u, next[5];
        for (uint32_t i = 1; i <= rows[k].lags; i++) {
            assert_close(p->task.coordinate[i].goal[0], 2.0, 1e-9, 0.0);
            given[i] = 2.0;
        }
        call(p, "control", 1, given, NULL, &u);
        assert_close(u, 2.0, 0.05, 0.0); /* the gate lets a little of the network through */
        u = 2.0;
        call(p, "momenta", 1, given, given + 1 + rows[k].lags, x);
        call(p, "period", 1, x, &u, next);
        assert_all_close(next, x, 2 + rows[k].lags, 1e-12, 1e-12);
    }
}

TEST("`lagged` is the exact motion of lags of first and second order") {
    const double h = 0.1, tau = 0.3;
    const lg_policy *one = make_hoist("0.3", 1, LG_POLICY_LQR),
                    *two = make_hoist("{order: 2, value: 0.3}", 2, LG_POLICY_LQR);
    lg_rng rng = test_rng(1, 0);
    for (int k = 0; k < 20; k++) {
        const double u = lg_rng_uniform_in(&rng, -1, 6), a[2] = {lg_rng_normal(&rng), lg_rng_normal(&rng)},
                     E = exp(-h / tau);
        double next[2];
        call(one, "lagged", 1, a, &u, next);
        assert_close(next[0], u + (a[0] - u) * E, 1e-12, 1e-13);
        call(two, "lagged", 1, a, &u, next);
        assert_close(next[0], u + (a[0] - u) * E, 1e-12, 1e-13);
        assert_close(next[1], u + (a[1] - u + (a[0] - u) * h / tau) * E, 1e-12, 1e-13);
    }
}

TEST("a regulator that knows the lagged input holds where one that does not know it fails") {
    const lg_policy *p = make_hoist("2.5", 1, LG_POLICY_LQR);
    lg_policy_outcome outcome;
    assert_ok(lg_policy_evaluate(p, LG_POLICY_NOMINAL, 200, 3, 1, &outcome, NULL, NULL));
    assert_true(outcome.succeeded >= 198);
    double K[3];
    lg_policy_runs runs = {.count = 1, .steps = 80, .x = K};
    memcpy(K, p->regulator.K, sizeof K);
    assert_true(K[1] > 0.0 && K[0] > 0.0 && K[2] > 0.0); /* more lagged input: less input */
    K[1] = 0.0;
    double x[200 * 3], z[200 * 3], cost[200];
    bool held[200];
    lg_rng rng = test_rng(3, 0);
    for (int i = 0; i < 200; i++) lg_policy_draw(p, &rng, z + 3 * i);
    assert_ok(lg_policy_states(p, z, 200, x, NULL));
    runs = (lg_policy_runs){.count = 200, .steps = 80, .x = x, .cost = cost, .succeeded = held};
    assert_ok(lg_policy_run(p, &(lg_policy_trial){.gain = K, .threads = 1}, &runs, NULL));
    int stand = 0;
    for (int i = 0; i < 200; i++) stand += held[i];
    assert_true(stand < 100);
}

TEST("training and its result are the same in other units of mass, length and time") {
    static const double units[][3] = {{1, 1, 1}, {1e9, 1e-9, 1}, {1e-9, 1e9, 1e9}};
    double first = 0.0;
    for (size_t k = 0; k < LG_COUNT(units); k++) {
        const double m = units[k][0], l = units[k][1], t = units[k][2];
        const double force = m * l / (t * t);
        lg_policy_task task = hoist_task(1, LG_POLICY_LQR);
        lg_policy_coordinate *x = &task.coordinate[0];
        for (int i = 0; i < 2; i++) x->start[i] *= l, x->start_velocity[i] *= l / t;
        x->weight /= l * l, x->weight_velocity *= t * t / (l * l), x->success *= l;
        task.input[0].low *= force, task.input[0].high *= force, task.input[0].weight /= force * force;
        task.period *= t, task.horizon *= t, task.hold *= t, task.within *= t;
        lg_policy *policy;
        lg_policy_outcome outcome;
        assert_ok(
            lg_policy_create(NULL, &task, hoist(test_text("%.17g", 0.3 * t), m, l, t), 1, &policy, NULL));
        lg_test_owns(policy, release_policy);
        assert_close(policy->regulator.u0[0], 2.0 * force, 1e-9, 0.0);
        assert_ok(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 64, 5, 1, &outcome, NULL, NULL));
        if (k == 0) first = outcome.cost_median;
        assert_close(outcome.cost_median, t * first, 1e-5, 0.0);
    }
}

static const char task_text[] =
    "plant: hoist.yaml\nperiod: 0.1\nhorizon: 3\nstarts: {x: [-0.5, 0.5], v: [-0.5, "
    "0.5]}\nlimits: {u: [-1, 6]}\ncost: {x: 1, v: 0.1, u: 0.01}\nsuccess: {x: 0.1, "
    "hold: 1, within: 8}\ncontroller: {kind: network, hidden: [8]}\n";

TEST("a policy with a lagged input is saved and loaded, and runs on a plant with another lag") {
    lg_policy *policy = make_hoist("0.3", 1, LG_POLICY_NETWORK), *loaded, *moved;
    lg_policy_outcome a, b, c;
    assert_ok(lg_policy_save(NULL, "test_policy_lagged.h5", policy, task_text, NULL, NULL));
    assert_ok(lg_policy_load(NULL, "test_policy_lagged.h5", NULL, &loaded, NULL, NULL));
    lg_test_owns(loaded, release_policy);
    (void)unlink("test_policy_lagged.h5");
    assert_int_equal(loaded->task.coordinate[1].follows, 1);
    assert_true(loaded->task.coordinate[1].goal[0] == policy->task.coordinate[1].goal[0]);
    assert_ok(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 64, 3, 1, &a, NULL, NULL));
    assert_ok(lg_policy_evaluate(loaded, LG_POLICY_NOMINAL, 64, 3, 1, &b, NULL, NULL));
    assert_true(a.cost_mean == b.cost_mean);
    assert_ok(lg_policy_transplant(loaded, hoist("0.35", 1, 1, 1), NULL, &moved, NULL));
    lg_test_owns(moved, release_policy);
    assert_ok(lg_policy_evaluate(moved, LG_POLICY_NOMINAL, 64, 3, 1, &c, NULL, NULL));
    assert_true(isfinite(c.cost_mean) && c.cost_mean != a.cost_mean);
}

TEST("what a lagged input cannot be is refused, and a certificate does not know it") {
    lg_error error = {LG_OK, ""};
    lg_policy *made;
    lg_program *program;
    lg_policy_task task = hoist_task(1, LG_POLICY_ENERGY);
    assert_int_equal(lg_policy_create(NULL, &task, hoist("0.3", 1, 1, 1), 1, &made, &error),
                     LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "forces that act at once"));
    task = hoist_task(1, LG_POLICY_LQR);
    task.coordinate[1].follows = 2;
    assert_int_equal(lg_policy_create(NULL, &task, hoist("0.3", 1, 1, 1), 1, &made, &error),
                     LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "follows an input that is not there"));
    task.coordinate[1].follows = 1, task.coordinate[1].free = true;
    assert_int_equal(lg_policy_create(NULL, &task, hoist("0.3", 1, 1, 1), 1, &made, &error),
                     LG_INVALID_ARGUMENT);
    assert_ok(lg_policy_add_rate(make_hoist("0.3", 1, LG_POLICY_LQR), &program, &error));
}

/* Policies of a crane whose trolley sticks: what they claim, and what an integrator from outside finds.
 * ctest-labels: src/control src/machine */
#include "liegrad/ops.h"
#include "support/policies.h"

/* Trolley 8 kg, load 3 kg at .9 m below, motor 2.5 N/V, friction 4 v + 6 sgn v on the trolley. */
static const double cart = 8, load = 3, length = 0.9, weight = 9.81 * 3 * 0.9, slow = 4, swing = 0.05,
                    dry = 6;
enum { STARTS = 40, MOST = 24 };

static lg_program *crane(double width) {
    return machine_program(
        test_text("columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}, {name: th, kind: "
                  "angle, velocity: "
                  "w}]\ninputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: 8, pole: 3, length: "
                  "0.9, gravity: "
                  "-9.81}\ndamping: [{kind: known, values: [4, 0.05]}, {kind: coulomb, values: [6, 0]%s}]\n"
                  "input_map: {kind: known, values: [[2.5], [0]]}\n",
                  width > 0 ? test_text(", width: %g", width) : ""));
}

static lg_status soften(void *user, const double *speed, lg_program **out, lg_error *error) {
    *out = crane(speed != NULL ? speed[0] : 1e9);
    return LG_OK;
}

typedef struct row {
    double late; /* periods */
    bool integral;
} row;

static lg_policy_task crane_task(row r) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.kind = LG_POLICY_LQR, task.coordinate_count = 2, task.input_count = 1;
    task.coordinate[0] = coordinate("x", "v", LG_POLICY_LINE, 1.2);
    task.coordinate[1] = coordinate("th", "w", LG_POLICY_ANGLE, 0.4);
    task.coordinate[0].success = 0.02, task.coordinate[1].success = 0.03;
    task.coordinate[0].weight_velocity = task.coordinate[1].weight_velocity = 0.05;
    task.coordinate[0].integral = r.integral;
    task.input[0] = (lg_policy_input){"u", -12.0, 12.0, 0.001};
    task.horizon = 6, task.within = 8, task.dead_time[0] = r.late * task.period;
    task.soften = soften;
    return task;
}

static lg_policy *make_crane(const lg_policy_task *task) {
    lg_policy *policy;
    lg_error error = {LG_OK, ""};
    if (lg_policy_create(NULL, task, crane(0), 1, &policy, &error) != LG_OK) fail_msg("%s", error.message);
    lg_test_owns(policy, release_policy);
    return policy;
}

/* ---- the crane by hand: x, th, v, w; at rest the trolley stays if 6 N are enough ---- */

static void rates(const double *y, double force, bool stuck, double *k, double *needed) {
    const double C = cos(y[1]), S = sin(y[1]), B = load * length * C, D = load * length * length,
                 A = cart + load, along = force - slow * y[2] + load * length * y[3] * y[3] * S,
                 turn = -weight * S - swing * y[3], det = A * D - B * B;
    *needed = B * turn / D - along;
    k[0] = y[2], k[1] = y[3];
    k[2] = stuck ? 0 : (D * along - B * turn) / det;
    k[3] = stuck ? turn / D : (A * turn - B * along) / det;
}

/* The classical method; a trolley that turns around stops. */
static void step(double *y, double u, double h) {
    double k[4][4], needed;
    rates(y, 2.5 * u, false, k[0], &needed);
    const bool stuck = y[2] == 0 && fabs(needed) <= dry;
    const double sign = y[2] > 0 ? 1 : y[2] < 0 ? -1 : needed < 0 ? 1 : -1;
    for (int i = 0; i < 4; i++) {
        const double by = i == 0 ? 0 : i == 3 ? h : 0.5 * h;
        double z[4];
        for (int j = 0; j < 4; j++) z[j] = y[j] + (i > 0 ? by * k[i - 1][j] : 0);
        rates(z, 2.5 * u - sign * dry, stuck, k[i], &needed);
    }
    for (int j = 0; j < 4; j++) y[j] += h / 6 * (k[0][j] + 2 * k[1][j] + 2 * k[2][j] + k[3][j]);
    if (!stuck && y[2] * sign < 0) y[2] = 0;
}

/* Whether a run from z succeeds. */
static bool outside(const lg_policy *p, lg_plan *const plan[2], double late, const double *z) {
    enum { PARTS = 50 };
    const uint32_t given = p->layout.given;
    const size_t steps = lg_policy_steps(p), hold = lg_policy_periods(p, p->task.hold);
    double y[4] = {z[0], z[1], z[given], z[given + 1]}, seen[MOST] = {0}, u[256] = {0}, kept[MOST],
           work[4096];
    bool good = true;
    for (size_t k = 0; k < steps; k++) {
        seen[0] = y[0], seen[1] = y[1], seen[given] = y[2], seen[given + 1] = y[3];
        lg_plan_eval(plan[0], (const void *[]){seen}, (void *[]){&u[k]}, work);
        if (plan[1] != NULL) {
            lg_plan_eval(plan[1], (const void *[]){seen, &u[k]}, (void *[]){kept}, work);
            memcpy(seen + 2, kept, (given - 2) * sizeof *seen);
        }
        for (int i = 0; i < PARTS; i++) {
            const double acts = floor((double)k + (i + 0.5) / PARTS - late);
            step(y, acts < 0 ? 0 : u[(size_t)acts], p->task.period / PARTS);
        }
        if (k + 1 + hold > steps) good = good && fabs(y[0]) < 0.02 && fabs(y[1]) < 0.03;
    }
    return good;
}

static void compare(const lg_policy *p, double late, double *claimed, double *truly) {
    static const char *const names[] = {"control", "remember"};
    lg_plan *plan[2] = {NULL};
    double z[STARTS * MOST], x[STARTS * MOST];
    bool held[STARTS];
    lg_rng rng = test_rng(11, 0);
    const uint32_t n = p->layout.errors;
    for (int i = 0; i < (p->memory.count > 0 ? 2 : 1); i++) {
        size_t at;
        assert_ok(lg_program_find(p->program, names[i], &at, NULL));
        assert_ok(lg_plan_create(p->program, at, NULL, &plan[i], NULL));
        assert_true(lg_plan_work_size(plan[i]) <= 4096 * sizeof(double));
    }
    for (int i = 0; i < STARTS; i++) lg_policy_draw(p, &rng, z + i * n);
    assert_ok(lg_policy_states(p, z, STARTS, x, NULL));
    lg_policy_runs runs = {.count = STARTS, .steps = lg_policy_steps(p), .x = x, .succeeded = held};
    assert_ok(lg_policy_run(p, &(lg_policy_trial){.theta = p->theta, .threads = 1}, &runs, NULL));
    *claimed = *truly = 0;
    for (int i = 0; i < STARTS; i++) {
        *claimed += held[i] / (double)STARTS;
        *truly += outside(p, plan, late, z + i * n) / (double)STARTS;
    }
    for (int i = 0; i < 2; i++) lg_plan_destroy(plan[i]);
}

TEST("claimed and true success agree where the trolley sticks, with integrals and with late inputs") {
    static const row rows[] = {{0, false}, {0, true}, {3, true}, {1.5, true}};
    double claimed[LG_COUNT(rows)];
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_policy_task task = crane_task(rows[i]);
        double truly;
        compare(make_crane(&task), rows[i].late, &claimed[i], &truly);
        print_message("%g periods late%s: claimed %.3f, truly %.3f\n", rows[i].late,
                      rows[i].integral ? ", integral" : "", claimed[i], truly);
        assert_close(claimed[i], truly, 0, 0.05);
    }
    assert_true(claimed[0] > 0.7 && claimed[0] < 0.95 && claimed[1] > 0.95 && claimed[2] > 0.95);
    /* At rest friction hides the input: without a sliding machine there is nothing to design. */
    lg_policy_task task = crane_task(rows[0]);
    lg_policy *policy;
    task.soften = NULL;
    assert_status(lg_policy_create(NULL, &task, crane(0), 1, &policy, NULL), LG_CHECK_FAILED);
}

TEST("the regulator without compensation is kept where training finds nothing better, also without steps") {
    lg_policy_task task = crane_task((row){0, false});
    task.compensate = true;
    for (int steps = 0; steps < 2; steps++) {
        lg_policy *p = make_crane(&task);
        lg_policy_trainer *trainer;
        lg_policy_train_options options;
        p->first[0] = 10; /* much more than friction */
        lg_policy_train_options_init(&options);
        options.race = (uint64_t)steps, options.finish = options.polish = 0;
        assert_ok(lg_policy_trainer_create(p, &options, &trainer, NULL));
        assert_ok(lg_policy_trainer_run(trainer, NULL, NULL));
        lg_policy_trainer_destroy(trainer);
        assert_true(p->theta[0] == -100);
    }
}

TEST("compensation begins at the break-away force, and training makes it succeed") {
    lg_policy_task task = crane_task((row){0, false});
    task.compensate = true;
    lg_policy *p = make_crane(&task);
    lg_policy_trainer *trainer;
    lg_policy_train_options options;
    double claimed, truly;
    assert_close(exp(p->first[0]), dry / 2.5, 1e-6, 0);
    assert_int_equal(p->parameters, 2);
    lg_policy_train_options_init(&options);
    options.race = 60, options.finish = 0, options.polish = 0;
    assert_ok(lg_policy_trainer_create(p, &options, &trainer, NULL));
    assert_ok(lg_policy_trainer_run(trainer, NULL, NULL));
    lg_policy_trainer_destroy(trainer);
    compare(p, 0, &claimed, &truly);
    print_message("compensation: claimed %.3f, truly %.3f, k %.3g, w %.3g\n", claimed, truly,
                  exp(p->theta[0]), exp(p->theta[1]));
    assert_true(claimed > 0.95 && truly > 0.95);
}

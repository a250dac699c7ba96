/* Policies of one coordinate with runs of two periods. A test takes milliseconds, so that runs with failing
 * calls reach every allocation. Where a machine cannot have a fault, the plant of this file has it.
 * ctest-labels: src/control */
#include <float.h>
#include <unistd.h>

#include "autodiff/program_support.h"
#include "files/h5.h"
#include "liegrad/ops.h"
#include "support/memory_archive.h"
#include "support/policies.h"

/* x = (q, p, extra numbers that stay): q' = p/m + drift, m = 1 + mass q^2,
 * p' = force (1 + bend q) u - damping v - square v |v| - stiffness q. A step is one of Euler's method. */
typedef struct plant {
    double mass, drift, bend, damping, square, stiffness;
    uint32_t inputs, extra;
    bool without_field, without_value, with_lag;
} plant;
static const double force = 2.0;
static const plant usual = {.damping = 0.5, .inputs = 1};

static lg_var scaled_square(lg_tape *tape, lg_var q, double by) {
    return lg_add_scalar(tape, lg_scale(tape, lg_square(tape, q), by), 1.0);
}

static lg_var velocity_of(lg_tape *tape, const plant *p, lg_var x) {
    const lg_var v = lg_slice(tape, x, 1, 1, 1);
    return p->mass == 0 ? v : lg_div(tape, v, scaled_square(tape, lg_slice(tape, x, 1, 0, 1), p->mass));
}

RECORDING(field) {
    const plant *p = user;
    const lg_var q = lg_slice(tape, x[0], 1, 0, 1), v = velocity_of(tape, p, x[0]);
    lg_var u = lg_scale(tape, lg_sum_axis(tape, x[1], 1, true), force), parts[3];
    if (p->bend != 0) u = lg_mul(tape, u, lg_add_scalar(tape, lg_scale(tape, q, p->bend), 1.0));
    parts[0] = lg_add_scalar(tape, v, p->drift);
    parts[1] = lg_sub(tape, u, lg_scale(tape, v, p->damping));
    if (p->square != 0)
        parts[1] = lg_sub(tape, parts[1], lg_scale(tape, lg_mul(tape, v, lg_abs(tape, v)), p->square));
    if (p->stiffness != 0) parts[1] = lg_sub(tape, parts[1], lg_scale(tape, q, p->stiffness));
    if (p->extra > 0) parts[2] = lg_scale(tape, lg_slice(tape, x[0], 1, 2, p->extra), 0.0);
    y[0] = lg_concat(tape, parts, p->extra > 0 ? 3 : 2, 1);
}

RECORDING(step) {
    lg_var rate;
    (void)field(user, tape, theta, x, &rate);
    y[0] = lg_add(tape, x[0], lg_mul(tape, rate, x[2]));
}

RECORDING(momenta) {
    const plant *p = user;
    lg_var parts[3] = {x[0], x[1]};
    if (p->mass != 0) parts[1] = lg_mul(tape, x[1], scaled_square(tape, x[0], p->mass));
    if (p->extra > 0) parts[2] = lg_matmul(tape, x[0], lg_full(tape, lg_shape2(1, p->extra), 0.0));
    y[0] = lg_concat(tape, parts, p->extra > 0 ? 3 : 2, 1);
}

RECORDING(positions) {
    (void)user;
    y[0] = lg_slice(tape, x[0], 1, 0, 1);
}

RECORDING(velocities) {
    y[0] = velocity_of(tape, user, x[0]);
}

RECORDING(value) {
    y[0] = lg_scale(tape, lg_mul(tape, velocity_of(tape, user, x[0]), lg_slice(tape, x[0], 1, 1, 1)), 0.5);
}

RECORDING(lag) {
    (void)user;
    y[0] = lg_add(tape, x[0], lg_mul(tape, lg_sub(tape, x[1], x[0]), x[2]));
}

static lg_program *plant_program(const plant *p) {
    const lg_port state = {.name = "x", .shape = lg_shape1(2 + p->extra)},
                  q = {.name = "q", .shape = lg_shape1(1)}, v = {.name = "v", .shape = lg_shape1(1)},
                  u = {.name = "u", .shape = lg_shape1(p->inputs)}, h = {.name = "h", .shape = lg_shape1(1)},
                  y = {.name = "y"};
    const lg_port moved[3] = {state, u, h}, pair[2] = {q, v},
                  lagged[3] = {u, {.name = "w", .shape = u.shape}, h};
    void *user = (void *)(uintptr_t)p;
    lg_function_spec all[7] = {{"step", moved, 3, &y, 1, step, user},
                               {"momenta", pair, 2, &y, 1, momenta, user},
                               {"positions", &state, 1, &y, 1, positions, user},
                               {"velocities", &state, 1, &y, 1, velocities, user}};
    size_t count = 4;
    if (!p->without_field) all[count++] = (lg_function_spec){"field", moved, 2, &y, 1, field, user};
    if (!p->without_value) all[count++] = (lg_function_spec){"value", &state, 1, &y, 1, value, user};
    if (p->with_lag) all[count++] = (lg_function_spec){"lag", lagged, 3, &y, 1, lag, user};
    const lg_program_spec spec = spec_of(NULL, 0, all, count);
    lg_program *program = NULL;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    return program;
}

static lg_policy_task small_task(lg_policy_kind kind) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.kind = kind, task.coordinate_count = task.input_count = 1;
    task.coordinate[0] = coordinate("q", "v", LG_POLICY_LINE, 0.5);
    task.coordinate[0].success = 10.0;
    task.input[0] = (lg_policy_input){"u", -3.0, 3.0, 0.01};
    task.hidden_layers = 1, task.hidden[0] = 2;
    task.horizon = task.within = 0.1, task.hold = 0.0, task.substeps = 1;
    return task;
}

static lg_policy *make_small(const lg_policy_task *task, const plant *p) {
    lg_policy *policy = NULL;
    assert_told(lg_policy_create(NULL, task, plant_program(p), 1, &policy, &told));
    lg_test_owns(policy, release_policy);
    return policy;
}

static lg_policy *of_kind(lg_policy_kind kind) {
    const lg_policy_task task = small_task(kind);
    return make_small(&task, &usual);
}

/* ---- what is made ---- */

TEST("a regulator holds the mass: its closed loop is stable, with gains that are given too") {
    lg_policy_task task = small_task(LG_POLICY_LQR);
    for (int given = 0; given < 2; given++) {
        const lg_policy *policy = make_small(&task, &usual);
        const double *K = policy->regulator.K, h = task.period, a = h * force * K[0], b = h * force * K[1];
        /* z+ = [[1, h], [-a, 1 - h damping - b]] z: both eigenvalues in the circle (Jury) */
        const double trace = 2 - h * usual.damping - b, det = 1 - h * usual.damping - b + h * a;
        assert_true(det < 1 && fabs(trace) < 1 + det);
        task.gain_count = 2;
        memcpy(task.gains, K, 2 * sizeof *K);
    }
}

TEST("a network is made with a gate, whose set is bounded, and moves its scale to the unforced motion") {
    lg_policy_task task = small_task(LG_POLICY_NETWORK);
    task.coordinate[0].motion = LG_POLICY_ANGLE;
    const lg_policy *policy = make_small(&task, &usual);
    const lg_policy_regulator *r = &policy->regulator;
    double ratio;
    assert_ok(lg_policy_bound_gate(policy, r->P, r->c, &ratio, NULL));
    assert_true(ratio > 1.0 - 1e-6 && ratio < 1.1); /* 1 where errors are angles */
    assert_status(lg_policy_bound_gate(policy, r->P, 0.0, &ratio, NULL), LG_INVALID_ARGUMENT);
    const double tiny[4] = {1e-308, 0, 0, 1e-308};
    assert_status(lg_policy_bound_gate(policy, tiny, 1.0, &ratio, NULL), LG_INVALID_ARGUMENT);
    task.gate = false;
    assert_status(lg_policy_bound_gate(make_small(&task, &usual), r->P, r->c, &ratio, NULL), LG_UNSUPPORTED);
}

static lg_policy_task disturbed_task(lg_policy_kind kind) {
    lg_policy_task task = small_task(kind);
    task.coordinate[0].noise_velocity = 0.1;
    task.delay = 0.5;
    return task;
}

TEST("the mean cost is the mean of the runs' costs, and a run costs what its periods cost") {
    const lg_policy_task task = disturbed_task(LG_POLICY_LQR);
    const lg_policy *policy = make_small(&task, &usual);
    enum { N = 70 };
    for (int test = LG_POLICY_NOMINAL; test <= LG_POLICY_DISTURBED; test++) {
        double cost[N], costs[2 * N], x[2 * N], motion[3 * N * 2], saturated[N], sum = 0, share = 0;
        bool succeeded[N];
        lg_policy_runs runs = {.x = x,
                               .cost = cost,
                               .succeeded = succeeded,
                               .saturated = saturated,
                               .costs = costs,
                               .motion = motion};
        lg_policy_outcome outcome;
        assert_told(lg_policy_evaluate(policy, (lg_policy_test)test, N, 3, 1, &outcome, &runs, &told));
        for (size_t i = 0; i < N; i++) {
            sum += cost[i] / N;
            share += saturated[i] / N;
            assert_close(cost[i], costs[i] + costs[N + i], 1e-12, 0.0);
        }
        assert_close(outcome.cost_mean, sum, 1e-12, 0.0);
        assert_close(outcome.saturated, share, 1e-12, 0.0);
        assert_memory_equal(x, motion + 2 * N * 2, sizeof x);
    }
    lg_policy_outcome outcome;
    assert_told(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 40, 3, 1, &outcome, NULL, &told));
    assert_int_equal(outcome.succeeded, 40);
    assert_true(outcome.success_low > 0.9 && outcome.success_high <= 1);
    assert_status(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 0, 3, 1, &outcome, NULL, NULL),
                  LG_INVALID_ARGUMENT);
    assert_status(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 10000001, 3, 1, &outcome, NULL, NULL),
                  LG_INVALID_ARGUMENT);
    assert_status(
        lg_policy_evaluate(of_kind(LG_POLICY_LQR), LG_POLICY_DISTURBED, N, 3, 1, &outcome, NULL, NULL),
        LG_INVALID_ARGUMENT);
}

TEST("a policy on its own plant again, and its draws, cost what the policy costs") {
    const lg_policy_task task = disturbed_task(LG_POLICY_NETWORK);
    lg_policy *policy = of_kind(LG_POLICY_NETWORK), *moved = NULL;
    lg_policy_outcome a, b;
    assert_told(lg_policy_disturb(policy, &task, &told));
    assert_told(lg_policy_evaluate(policy, LG_POLICY_DISTURBED, 10, 3, 1, &a, NULL, &told));
    for (int i = 0; i < 2; i++) assert_told(lg_policy_add_draw(policy, plant_program(&usual), &told));
    assert_told(lg_policy_evaluate(policy, LG_POLICY_DISTURBED, 10, 3, 1, &b, NULL, &told));
    assert_close(b.cost_mean, a.cost_mean, 1e-12, 0.0);
    plant smooth = usual;
    smooth.damping = 0; /* Euler's method is exact but for h^2 u */
    lg_error error;
    const lg_status status = lg_policy_transplant(policy, plant_program(&smooth), NULL, &moved, &error);
    assert_int_equal(status, LG_CHECK_FAILED);
    assert_says(error.message, "64 steps of the integrator");
}

TEST("a position is tracked or free only if the machine moves in the same way everywhere") {
    lg_policy_task task = small_task(LG_POLICY_LQR);
    task.coordinate[0].track = true;
    assert_non_null(make_small(&task, &usual));
    lg_policy_coordinate *q = &task.coordinate[0];
    q->track = false, q->free = true, q->weight = 0.0, q->success = INFINITY, q->success_velocity = 9.0;
    lg_policy *policy = make_small(&task, &usual);
    lg_program *program;
    double z = 0.7, rate;
    assert_told(lg_policy_add_rate(policy, &program, &told));
    assert_ok(lg_program_eval(NULL, program, "rate", 1, (const double *const[]){&z}, (double *const[]){&rate},
                              NULL));
    assert_close(rate, -(usual.damping + force * policy->regulator.K[0]) * z, 1e-12, 0.0);
    q->velocity[0] = '\0';
    assert_status(lg_policy_create(NULL, &task, plant_program(&usual), 1, &policy, NULL),
                  LG_INVALID_ARGUMENT);
}

TEST("a plant of states without velocities is controlled too, and follows set points") {
    lg_policy_task task = small_task(LG_POLICY_LQR);
    task.coordinate_count = 2;
    task.coordinate[0] = task.coordinate[1] = coordinate("q", "", LG_POLICY_LINE, 0.5);
    (void)snprintf(task.coordinate[1].name, LG_POLICY_NAME, "p");
    task.coordinate[0].success = 10.0, task.coordinate[0].track = true;
    task.coordinate[1].success = INFINITY;
    const lg_policy *policy = make_small(&task, &usual);
    const double *K = policy->regulator.K, h = task.period, x[2] = {0.3, -0.2}, reference = 0.1;
    const double trace = 2 - h * usual.damping - h * force * K[1],
                 det = 1 - h * usual.damping - h * force * K[1] + h * h * force * K[0];
    assert_true(det < 1 && fabs(trace) < 1 + det);
    double u;
    assert_ok(lg_program_eval(NULL, policy->program, "track", 1, (const double *const[]){x, &reference},
                              (double *const[]){&u}, NULL));
    assert_close(u, fmax(-3, fmin(3, -K[0] * (x[0] - reference) - K[1] * x[1])), 1e-9, 0.0);
    lg_policy *none;
    task.kind = LG_POLICY_ENERGY;
    assert_status(lg_policy_create(NULL, &task, plant_program(&usual), 1, &none, NULL), LG_NOT_FOUND);
}

/* ---- training ---- */

static lg_policy_train_options short_training(void) {
    lg_policy_train_options o;
    lg_policy_train_options_init(&o);
    o.seeds = 3, o.race = 3, o.finish = 1, o.polish = 2;
    return o;
}

typedef struct stopping {
    int left;
    volatile int flag;
} stopping;

static void stop(void *user, const lg_policy_progress *now) {
    stopping *s = user;
    (void)now;
    if (--s->left == 0) s->flag = 1;
}

static lg_policy *cancelled(const lg_policy_task *task, stopping *s) {
    lg_context_options options;
    lg_context *context;
    lg_policy *policy = NULL;
    lg_context_options_init(&options);
    options.cancel = &s->flag;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    assert_told(lg_policy_create(context, task, plant_program(&usual), 1, &policy, &told));
    lg_test_owns(policy, release_policy);
    return policy;
}

RELEASES(release_trainer, lg_policy_trainer_destroy)

static lg_policy_trainer *trainer_of(lg_policy *policy, const lg_policy_train_options *o) {
    lg_policy_trainer *trainer = NULL;
    assert_told(lg_policy_trainer_create(policy, o, &trainer, &told));
    lg_test_owns(trainer, release_trainer);
    return trainer;
}

TEST("a race without steps is won by the seed that is best on the validation starts") {
    const lg_policy_task task = small_task(LG_POLICY_NETWORK);
    lg_policy *policy = make_small(&task, &usual);
    enum { SEEDS = 7, N = 512 };
    lg_policy_train_options o = short_training();
    lg_policy_train_result result;
    double *x = TEST_ARRAY(double, N * policy->state), *theta = TEST_ARRAY(double, policy->parameters),
           most = -1, least = INFINITY;
    uint32_t best = 0;
    lg_rng rng;
    o.seeds = SEEDS, o.race = o.finish = o.polish = 0, o.seed = 3;
    assert_told(lg_policy_trainer_run(trainer_of(policy, &o), &result, &told));
    lg_rng_seed(&rng, o.seed, 2);
    assert_ok(lg_policy_starts(policy, &rng, N, x, NULL, NULL));
    for (uint32_t k = 0; k < SEEDS; k++) {
        lg_policy_outcome found;
        lg_policy_initialise(policy, o.seed * 1000 + k, theta);
        const lg_policy_trial trial = {.theta = theta, .threads = 1};
        assert_ok(lg_policy_try(policy, &trial, x, N, &found, NULL, NULL));
        const double success = fmin((double)found.succeeded / N, 0.995);
        if (!(success > most || (success == most && found.cost_mean < least))) continue;
        most = success, least = found.cost_mean, best = k;
    }
    assert_int_equal(result.seed, best);
    assert_true(result.cost == least);
    lg_policy_initialise(policy, o.seed * 1000 + best, theta);
    assert_memory_equal(policy->theta, theta, policy->parameters * sizeof *theta);
}

/* Trains with a stop after `at` reports, stores the state, and continues with another trainer. */
static void stopped_and_continued(const lg_policy_task *task, int at, memory_archive *archive,
                                  lg_policy *again) {
    lg_policy_train_options o = short_training();
    stopping s = {.left = at};
    o.progress = stop, o.user = &s;
    lg_policy_trainer *trainer = trainer_of(cancelled(task, &s), &o);
    assert_status(lg_policy_trainer_run(trainer, NULL, NULL), LG_CANCELLED);
    const lg_archive_writer writer = memory_writer(archive);
    const lg_archive_reader reader = memory_reader(archive);
    assert_ok(lg_policy_trainer_save(trainer, &writer, NULL));
    o.progress = NULL;
    trainer = trainer_of(again, &o);
    assert_told(lg_policy_trainer_load(trainer, &reader, &told));
    assert_told(lg_policy_trainer_run(trainer, NULL, &told));
}

TEST("training that is stopped while it polishes ends with the bits of one run") {
    const lg_policy_task task = small_task(LG_POLICY_NETWORK);
    const lg_policy_train_options o = short_training();
    lg_policy *whole = make_small(&task, &usual), *again = make_small(&task, &usual);
    memory_archive archive = {.count = 0};
    assert_told(lg_policy_trainer_run(trainer_of(whole, &o), NULL, &told));
    stopped_and_continued(&task, 5, &archive, again);
    assert_memory_equal(whole->theta, again->theta, whole->parameters * sizeof *whole->theta);
}

TEST("a trainer that has run loads the state before the first step, and runs again with the same bits") {
    const lg_policy_task task = small_task(LG_POLICY_NETWORK);
    lg_policy_train_options o = short_training();
    stopping s = {.left = 5};
    memory_archive archive = {.count = 0};
    const lg_archive_writer writer = memory_writer(&archive);
    const lg_archive_reader reader = memory_reader(&archive);
    lg_policy *whole = make_small(&task, &usual), *again = cancelled(&task, &s);
    assert_told(lg_policy_trainer_run(trainer_of(whole, &o), NULL, &told));
    o.progress = stop, o.user = &s;
    lg_policy_trainer *trainer = trainer_of(again, &o);
    assert_ok(lg_policy_trainer_save(trainer, &writer, NULL));
    assert_status(lg_policy_trainer_run(trainer, NULL, NULL), LG_CANCELLED);
    s.flag = 0;
    assert_told(lg_policy_trainer_load(trainer, &reader, &told));
    assert_told(lg_policy_trainer_run(trainer, NULL, &told));
    assert_memory_equal(whole->theta, again->theta, whole->parameters * sizeof *whole->theta);
}

TEST("the worse racers leave a race by the time that its steps took before a load, too") {
    const lg_policy_task task = small_task(LG_POLICY_NETWORK);
    lg_policy_train_options o = short_training();
    for (int late = 0; late < 2; late++) {
        memory_archive archive = {.count = 0}, after = {.count = 0};
        const lg_archive_writer writer = memory_writer(&archive), last = memory_writer(&after);
        const lg_archive_reader reader = memory_reader(&archive);
        stopping s = {.left = 1};
        o.race = 1000, o.seconds = 1000, o.progress = stop, o.user = &s;
        lg_policy_trainer *trainer = trainer_of(cancelled(&task, &s), &o);
        assert_status(lg_policy_trainer_run(trainer, NULL, NULL), LG_CANCELLED);
        assert_ok(lg_policy_trainer_save(trainer, &writer, NULL));
        double *took = memory_find(&archive, "train/history/seconds")->data;
        if (late) *took = 300; /* of the 500 that the race has */
        s = (stopping){.left = 1};
        trainer = trainer_of(cancelled(&task, &s), &o);
        assert_told(lg_policy_trainer_load(trainer, &reader, &told));
        assert_status(lg_policy_trainer_run(trainer, NULL, NULL), LG_CANCELLED);
        assert_ok(lg_policy_trainer_save(trainer, &last, NULL));
        assert_int_equal(*(const uint64_t *)memory_find(&after, "racers")->data, late ? 2 : 3);
    }
}

TEST("training reports a lack of memory, also while it evaluates, and can then continue") {
    const lg_policy_task task = small_task(LG_POLICY_ENERGY);
    lg_policy_train_options o = short_training();
    lg_fail_alloc *memory = TEST_ARRAY(lg_fail_alloc, 1);
    lg_context *context = lg_fail_alloc_context(memory);
    lg_policy *policy = NULL;
    lg_test_owns(context, release_context);
    assert_told(lg_policy_create(context, &task, plant_program(&usual), 1, &policy, &told));
    lg_test_owns(policy, release_policy);
    o.race = 0, o.finish = 1, o.polish = 0;
    lg_policy_trainer *trainer = trainer_of(policy, &o);
    lg_fail_alloc_arm(memory, 0);
    assert_told(lg_policy_trainer_run(trainer, NULL, &told));
    const long calls = atomic_load(&memory->calls);
    for (long at = 1; at <= calls; at += 1 + calls / 50) {
        lg_error error = {LG_OK, ""};
        trainer = trainer_of(policy, &o);
        lg_fail_alloc_arm_end(memory, at);
        const lg_status status = lg_policy_trainer_run(trainer, NULL, &error);
        assert_true(status == LG_OUT_OF_MEMORY || !lg_fail_alloc_hit(memory));
        assert_int_equal(error.status, status);
        lg_fail_alloc_arm(memory, 0);
        assert_told(lg_policy_trainer_run(trainer, NULL, &told));
    }
}

TEST("a state of training that is cut or damaged is refused") {
    const lg_policy_task task = small_task(LG_POLICY_ENERGY);
    static const struct {
        const char *path;
        uint64_t value;
        const char *says;
    } rows[] = {{"parameters", 77, "parameters was 77 in the saved run and is 2"},
                {"seed", 5, "seed was 5"},
                {"task", 5, "another task, plant or version"},
                {"phase", 4, "damaged"},
                {"leader", 1, "damaged"},
                {"racers", 0, "damaged"},
                {"racers", 2, "damaged"},
                {"racing", 0, "damaged"},
                {"begun", 1, "train/options"},
                {"round", 4, "damaged"}};
    lg_policy_train_options o = short_training();
    o.finish = 0;
    memory_archive archive = {.count = 0};
    lg_policy *policy = make_small(&task, &usual);
    lg_policy_trainer *trainer = trainer_of(policy, &o);
    const lg_archive_writer writer = memory_writer(&archive);
    const lg_archive_reader reader = memory_reader(&archive);
    assert_ok(lg_policy_trainer_save(trainer, &writer, NULL));
    lg_error error;
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        size_t at = 0;
        while (strcmp(archive.items[at].path, rows[i].path) != 0) at++;
        uint64_t *fact = archive.items[at].data, kept = *fact;
        *fact = rows[i].value;
        assert_true(lg_policy_trainer_load(trainer_of(policy, &o), &reader, &error) != LG_OK);
        assert_says(error.message, rows[i].says);
        *fact = kept;
    }
    const size_t count = archive.count;
    for (size_t left = 0; left < count; left++) {
        archive.count = left;
        assert_status(lg_policy_trainer_load(trainer_of(policy, &o), &reader, &error), LG_FORMAT);
        memory_archive full = {.fail_after = left + 1};
        const lg_archive_writer to = memory_writer(&full);
        assert_status(lg_policy_trainer_save(trainer, &to, &error), left + 1 < count ? LG_FILE : LG_OK);
    }
    archive.count = count;
    assert_ok(lg_policy_trainer_load(trainer, &reader, &error));
    lg_policy_train_result result;
    assert_told(lg_policy_trainer_run(trainer, &result, &told));
    assert_true(isfinite(result.cost));
}

/* ---- plants that are refused ---- */

TEST("a plant without an equilibrium, an energy or room for the step is refused") {
    static const struct {
        plant p;
        lg_policy_kind kind;
        uint32_t substeps;
        lg_status status;
        const char *says;
    } rows[] = {
        {{.inputs = 1, .drift = 1}, LG_POLICY_LQR, 1, LG_CHECK_FAILED, "from there q changes by 0.05"},
        {{.inputs = 1, .without_value = true}, LG_POLICY_ENERGY, 1, LG_NOT_FOUND, "a plant with an energy"},
        {{.inputs = 1, .damping = 9}, LG_POLICY_LQR, 0, LG_CHECK_FAILED, "take a shorter period"},
        {{.inputs = 1, .damping = 9, .with_lag = true}, LG_POLICY_LQR, 0, LG_CHECK_FAILED, "leave out a lag"},
        {{.inputs = 2}, LG_POLICY_LQR, 1, LG_SHAPE, "the task has 1 numbers as inputs"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_policy_task task = small_task(rows[i].kind);
        lg_policy *policy;
        lg_error error;
        task.substeps = rows[i].substeps;
        assert_status(lg_policy_create(NULL, &task, plant_program(&rows[i].p), 1, &policy, &error),
                      rows[i].status);
        assert_says(error.message, rows[i].says);
    }
}

TEST("the energy is certified with the numbers of the plant, and a plant that they do not fit is refused") {
    static const struct {
        plant p;
        lg_policy_motion motion;
        const char *says; /* NULL: it is certified */
    } rows[] = {
        {{.inputs = 1, .damping = 0.5}, LG_POLICY_LINE, NULL},
        {{.inputs = 1, .damping = 0.5}, LG_POLICY_ANGLE, NULL},
        {{.inputs = 1, .damping = 0.5, .stiffness = 1}, LG_POLICY_LINE, "depends on the position"},
        {{.inputs = 1, .damping = 0.5, .mass = 1}, LG_POLICY_ANGLE, "the mass of q is not constant"},
        {{.inputs = 1, .damping = 0.5, .bend = 0.1}, LG_POLICY_ANGLE, "is not a constant times the input"},
        {{.inputs = 1, .damping = 0.5, .square = 0.1}, LG_POLICY_ANGLE, "the damping of q is not linear"},
        {{.inputs = 1}, LG_POLICY_ANGLE, "not positive"},
        {{.inputs = 1, .extra = 2}, LG_POLICY_LINE, "2 more states"},
        {{.inputs = 1, .without_field = true}, LG_POLICY_LINE, "no function field"},
        {{.inputs = 2}, LG_POLICY_LINE, "one coordinate and one input"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_policy_task task = small_task(LG_POLICY_ENERGY);
        task.coordinate[0].motion = rows[i].motion;
        task.search = false, task.input_count = rows[i].p.inputs, task.input[1] = task.input[0];
        if (i == 0) task.gain_count = 2, task.gains[0] = 3, task.gains[1] = 4;
        lg_policy *policy = make_small(&task, &rows[i].p);
        lg_policy_slope spec;
        lg_error error;
        if (rows[i].says != NULL) {
            assert_true(lg_policy_add_slope(policy, &spec, &error) != LG_OK);
            assert_says(error.message, rows[i].says);
            continue;
        }
        assert_told(lg_policy_add_slope(policy, &spec, &told));
        const double kp = i == 0 ? 3 : 1, kd = i == 0 ? 4 : 1; /* untrained gains: e^0 */
        assert_close(spec.damping, 0.5, 1e-5, 0.0);
        assert_close(spec.gain, kd * force * force, 1e-5, 0.0);
        assert_close(spec.saturated, 3.0 / (kp * force), 1e-5, 0.0);
    }
    lg_policy_slope spec;
    lg_policy_task task = small_task(LG_POLICY_ENERGY);
    lg_policy_coordinate *q = &task.coordinate[0];
    q->free = true, q->weight = 0.0, q->success = INFINITY, q->success_velocity = 9.0;
    lg_error error;
    assert_status(lg_policy_add_slope(make_small(&task, &usual), &spec, &error), LG_UNSUPPORTED);
    assert_says(error.message, "q is free");
    assert_status(lg_policy_add_slope(of_kind(LG_POLICY_LQR), &spec, &error), LG_UNSUPPORTED);
    lg_policy_task cart = cart_task();
    cart.kind = LG_POLICY_ENERGY, cart.search = false;
    assert_status(lg_policy_add_slope(make(&cart, cart_pole), &spec, &error), LG_UNSUPPORTED);
    assert_says(error.message, "one coordinate and one input; the plant has 2 and 1");
}

TEST("a body that turns is certified if one gain serves all axes") {
    static const char turning[] =
        "columns: {time: t}\ncoordinates: [{name: R, kind: rotation, columns: [qw, "
        "qx, qy, qz], velocity: [wx, wy, wz]}]\ninputs: {columns: [a, b, c]}\nmass: "
        "{kind: known, values: [[1, 0.3, 0], [0.3, 2, 0.1], [0, 0.1, 3]]}\ndamping: {kind: known, values: "
        "[0.5, 0.5, "
        "0.5]}\ninput_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n";
    lg_policy_task task = body_task(LG_POLICY_ENERGY);
    task.search = false;
    lg_policy *policy = make(&task, turning);
    lg_policy_turn spec;
    lg_error error;
    assert_told(lg_policy_find_turn(policy, &spec, &told));
    assert_close(spec.stiffness, 1.0, 1e-5, 0.0);
    assert_close(spec.damping, 1.5, 1e-5, 0.0); /* the body's and the controller's */
    policy->theta[0] = 1.0;
    assert_status(lg_policy_find_turn(policy, &spec, &error), LG_UNSUPPORTED);
    assert_says(error.message, "the stiffness depends on the axis");
    assert_status(lg_policy_find_turn(of_kind(LG_POLICY_ENERGY), &spec, &error), LG_UNSUPPORTED);
    assert_status(lg_policy_find_turn(of_kind(LG_POLICY_LQR), &spec, &error), LG_UNSUPPORTED);
}

/* ---- files ---- */

static const char text[] = "plant: p\nperiod: 0.05\nhorizon: 0.1\nstarts: {q: 0.5, vq: 0.5}\nlimits: {u: 3}\n"
                           "cost: {q: 1, v: 0.1, u: 0.01}\nsuccess: {q: 10, hold: 0.01, within: 0.1}\n"
                           "controller: {kind: network, hidden: [2]}\n";
static const char path[] = "test_policy_small.h5";

static void remove_file(void *name) {
    (void)unlink(name);
}

TEST("a policy is read with the names of its file; a file with impossible names is rejected") {
    static const char long_word[] =
        "a_name_of_more_than_sixty_three_letters_which_no_coordinate_of_a_policy_has";
    const struct {
        const char *coordinate, *input;
        uint64_t coordinates, inputs; /* how often the list has them */
        const char *says;             /* NULL: it is read */
    } rows[] = {{"q\tline\tv\t0\t0\t0", "u", 1, 1, NULL},
                {"q line v 0 0 0", "u", 1, 1, "is no coordinate or input"},
                {"q line", "u", 1, 1, "is no coordinate or input"},
                {"q\tcurve\tv\t0\t0\t0", "u", 1, 1, "is no coordinate or input"},
                {"q\tline\tv", "u", 1, 1, "is no coordinate or input"},
                {"q\tline\t-\t17\t0\t0", "u", 1, 1, "is no coordinate or input"},
                {"q\tline\t-\t0\t1\t0", "u", 1, 1, "is no coordinate or input"},
                {"q\tline\t-\t0\t0\t1", "u", 1, 1, "is no coordinate or input"},
                {test_text("%s\tline\tv\t0\t0\t0", long_word), "u", 1, 1, "is no coordinate or input"},
                {test_text("q\tline\t%s\t0\t0\t0", long_word), "u", 1, 1, "is no coordinate or input"},
                {test_text("q\tline\t%s%s%s\t0\t0\t0", long_word, long_word, long_word), "u", 1, 1,
                 "is no coordinate"},
                {"q\tline\tv\t0\t0\t0", "u", LG_POLICY_COORDINATES + 1, 1, "is no coordinate or input"},
                {"q\tline\tv\t0\t0\t0", long_word, 1, 1, "is no coordinate or input"},
                {"q\tline\tv\t0\t0\t0", "u", 1, LG_POLICY_INPUTS + 1, "is no coordinate or input"},
                {NULL, "u", 1, 1, "names of coordinates and inputs are missing"},
                {"q\tline\tv\t0\t0\t0", NULL, 1, 1, "names of coordinates and inputs are missing"}};
    enum { LONG = 256 };
    const lg_policy *policy = of_kind(LG_POLICY_NETWORK);
    lg_test_owns((void *)(uintptr_t)path, remove_file);
    assert_told(lg_policy_save(NULL, path, policy, text, NULL, &told));
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_h5 *h5;
        lg_policy *loaded = NULL;
        lg_error error = {LG_OK, ""};
        char *words = NULL;
        char lists[2][(LG_POLICY_COORDINATES + LG_POLICY_INPUTS + 1) * LONG] = {{0}};
        assert_ok(lg_h5_edit(NULL, path, &h5, NULL));
        assert_ok(lg_h5_remove_attribute(h5, "policy", "coordinates", NULL));
        assert_ok(lg_h5_remove_attribute(h5, "policy", "inputs", NULL));
        for (int list = 0; list < 2; list++) {
            const char *word = list == 0 ? rows[i].coordinate : rows[i].input;
            const uint64_t count = list == 0 ? rows[i].coordinates : rows[i].inputs;
            for (uint64_t k = 0; word != NULL && k < count; k++)
                (void)snprintf(lists[list] + k * LONG, LONG, "%s", word);
            if (word != NULL)
                assert_ok(lg_h5_put_text_list(h5, "policy", list == 0 ? "coordinates" : "inputs", lists[list],
                                              LONG, count, NULL));
        }
        assert_ok(lg_h5_commit(h5, NULL));
        lg_h5_close(h5);
        if (rows[i].says == NULL) {
            assert_told(lg_policy_load(NULL, path, NULL, &loaded, &words, &told));
            assert_string_equal(words, text);
            assert_memory_equal(&loaded->regulator, &policy->regulator, sizeof policy->regulator);
            lg_policy_destroy(loaded);
            lg_free(NULL, words);
            continue;
        }
        assert_status(lg_policy_load(NULL, path, NULL, &loaded, &words, &error), LG_FORMAT);
        assert_says(error.message, rows[i].says);
    }
}

TEST("a file whose period has more steps than a task may have is rejected before they are recorded") {
    const lg_policy *policy = of_kind(LG_POLICY_NETWORK);
    static const uint32_t steps[] = {LG_POLICY_SUBSTEPS, LG_POLICY_SUBSTEPS + 1, UINT32_MAX};
    lg_test_owns((void *)(uintptr_t)path, remove_file);
    assert_told(lg_policy_save(NULL, path, policy, text, NULL, &told));
    for (size_t i = 0; i < LG_COUNT(steps); i++) {
        lg_h5 *h5;
        lg_policy *loaded = NULL;
        lg_error error = {LG_OK, ""};
        char *words = NULL;
        assert_ok(lg_h5_edit(NULL, path, &h5, NULL));
        assert_ok(lg_h5_remove_attribute(h5, "policy", "substeps", NULL));
        assert_ok(lg_h5_put_number(h5, "policy", "substeps", LG_ELEMENT_U32, &steps[i], NULL));
        assert_ok(lg_h5_commit(h5, NULL));
        lg_h5_close(h5);
        assert_status(lg_policy_load(NULL, path, NULL, &loaded, &words, &error), LG_FORMAT);
        assert_says(error.message, i == 0 ? "are not of one policy" : "expected at most 1000");
    }
}

TEST("a policy does not adopt the program of another policy") {
    static const lg_policy_kind others[] = {LG_POLICY_LQR, LG_POLICY_ENERGY};
    lg_policy *policy = of_kind(LG_POLICY_NETWORK);
    lg_error error;
    assert_ok(lg_policy_adopt(policy, NULL));
    lg_program *own = policy->program;
    for (size_t i = 0; i < LG_COUNT(others); i++) {
        policy->program = of_kind(others[i])->program;
        const lg_status status = lg_policy_adopt(policy, &error);
        policy->program = own;
        assert_int_equal(status, LG_FORMAT);
        assert_says(error.message, "does not have the");
    }
    lg_program *bare = plant_program(&usual);
    policy->program = bare;
    const lg_status status = lg_policy_adopt(policy, &error);
    policy->program = own;
    lg_program_destroy(bare);
    assert_int_equal(status, LG_FORMAT);
    assert_says(error.message, "has no function period");
}

TEST("a search of inputs finds none that cost more than the policy's") {
    for (int kind = 0; kind < LG_POLICY_KIND_COUNT; kind++) {
        lg_policy_gap gap[2];
        assert_told(lg_policy_find_gaps(of_kind((lg_policy_kind)kind), 2, 1, 0, gap, NULL, &told));
        for (int i = 0; i < 2; i++) assert_true(gap[i].best <= gap[i].cost && gap[i].ratio >= 1);
    }
}

/* ---- observer and adaptation: functions of the policy's program ---- */

/* The machine is linear: the filter is Kalman's, here in its plain form. One measurement is missing. */
TEST("the observer of a linear machine is Kalman's filter") {
    static const double s = 0.02, drift = 0.03;
    const lg_policy *policy = of_kind(LG_POLICY_LQR);
    const double h = policy->task.period, F[2][2] = {{1, h}, {0, 1 - h * usual.damping}};
    const lg_policy_filter filter = {.policy = policy, .sensor = {s}, .drift = {drift}, .tiny = DBL_MIN};
    double memory[6] = {0.3, 0, s, 0, 0, 1}, kept[6], x[2] = {0.3, 0}, P[2][2] = {{s * s, 0}, {0, 1}};
    lg_rng rng = test_rng(2, 3);
    assert_told(lg_policy_add(policy, "sensed_by_control", &told));
    assert_told(lg_policy_add_observer(&filter, &told));
    for (int k = 0; k < 40; k++) {
        const double u = sin(0.5 * k), seen[2] = {lg_rng_normal(&rng), k != 20}, f = x[1];
        double A[2][2] = {{0}}, gain[2];
        assert_told(lg_program_eval(NULL, policy->program, "observe", 1,
                                    (const double *const[]){seen, &u, memory}, (double *const[]){kept},
                                    &told));
        memcpy(memory, kept, sizeof memory);
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 2; j++)
                for (int l = 0; l < 4; l++) A[i][j] += F[i][l / 2] * P[l / 2][l % 2] * F[j][l % 2];
        A[1][1] += drift * drift;
        x[0] += h * f, x[1] += h * (force * u - usual.damping * f);
        for (int i = 0; i < 2; i++) gain[i] = seen[1] * A[i][0] / (A[0][0] + s * s);
        const double away = seen[0] - x[0];
        for (int i = 0; i < 2; i++) x[i] += gain[i] * away;
        for (int i = 0; i < 4; i++) P[i / 2][i % 2] = A[i / 2][i % 2] - gain[i / 2] * A[0][i % 2];
        for (int i = 0; i < 2; i++) assert_close(memory[i], x[i], 1e-10, 1e-10);
        for (int i = 0; i < 4; i++) {
            const double *a = memory + 2 + 2 * (i / 2), *b = memory + 2 + 2 * (i % 2);
            assert_close(a[0] * b[0] + a[1] * b[1], P[i / 2][i % 2], 1e-9, 1e-12);
        }
    }
}

/* The plant has more damping, an offset and more mass than the machine. */
TEST("the adaptation finds damping, an offset and a payload in runs of the library") {
    enum { PERIODS = 400 };
    static const double more[LG_POLICY_FOUND] = {0.2, 0, 0.3, 0.4};
    const lg_policy *policy = of_kind(LG_POLICY_LQR);
    const double h = policy->task.period;
    double state[2 * (PERIODS + 1)] = {0}, memory[LG_POLICY_ADAPT] = {0}, kept[LG_POLICY_ADAPT];
    lg_policy_adaptation a = {.policy = policy, .keep = exp(-h / 100), .tiny = DBL_MIN};
    double *x = state, *next = state;
    for (int k = 0; k < PERIODS; k++, x += 2) {
        const double u = 2 * sin(0.37 * k) + sin(0.11 * k);
        const double rate = (force * u - (usual.damping + more[0]) * x[1] + more[2]) / (1 + more[3]);
        x[2] = x[0] + h * x[1], x[3] = x[1] + h * rate;
    }
    lg_policy_find_ranges(&a, state, state, PERIODS); /* the mass is 1: momenta are velocities */
    assert_told(lg_policy_add_adaptation(&a, &told));
    for (int k = 0; k < LG_POLICY_FOUND; k++) memory[LG_POLICY_FOUND + 5 * k] = 1;
    for (int k = 0; k < PERIODS; k++, next += 2) {
        const double u = 2 * sin(0.37 * k) + sin(0.11 * k);
        assert_told(lg_program_eval(NULL, policy->program, "adapt", 1,
                                    (const double *const[]){next, &u, next + 2, memory},
                                    (double *const[]){kept}, &told));
        memcpy(memory, kept, sizeof memory);
    }
    for (int k = 0; k < LG_POLICY_FOUND; k++) {
        print_message("%.4f of %g\n", a.range[0][k] * memory[k], more[k]);
        assert_close(a.range[0][k] * memory[k], more[k], 0.1, 0.05);
    }
}

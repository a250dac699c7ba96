/* Policies of machines with a coordinate whose position does not matter: a pendulum with a reaction wheel
 * against the same plant without the wheel's position.
 * ctest-labels: src/control */
#include <unistd.h>

#include "kernels/matrix.h"
#include "liegrad/ops.h"
#include "liegrad/taped.h"
#include "support/policies.h"

/* The mass and potential of a pendulum of about 1 kg and .1 m, upright at th = 0; ph is the wheel's angle
 * relative to the pendulum. */
static const double M[4] = {0.0135, 0.0015, 0.0015, 0.0015}, weight = 0.35, damping[2] = {5e-4, 2e-4};

/* In units of mass, length and time. */
static const char *wheel(const char *kind, double m, double l, double t) {
    const double inertia = m * l * l, moment = inertia / (t * t), friction = inertia / t;
    return test_text(
        "columns: {time: t}\ncoordinates: [{name: th, kind: angle, velocity: vth}, {name: ph, kind: %s, "
        "velocity: vph}]\ninputs: {columns: [u]}\nmass: {kind: known, values: [[%.17g, %.17g], [%.17g, "
        "%.17g]]}\npotential: {kind: known, form: linear, of: th, values: [0, %.17g]}\ndamping: {kind: "
        "known, "
        "values: [%.17g, %.17g]}\ninput_map: {kind: known, values: [[0], [1]]}\n",
        kind, M[0] * inertia, M[1] * inertia, M[2] * inertia, M[3] * inertia, weight * moment,
        damping[0] * friction, damping[1] * friction);
}

static lg_policy_coordinate moving(const char *name, const char *velocity, lg_policy_motion motion) {
    lg_policy_coordinate c = coordinate(name, velocity, motion, 0.0);
    c.start_velocity[0] = c.start_velocity[1] = 0.0;
    c.weight = c.weight_velocity = 0.0, c.success = c.success_velocity = INFINITY;
    return c;
}

static lg_policy_task wheel_task(lg_policy_kind kind) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.coordinate_count = 2, task.input_count = 1, task.kind = kind;
    lg_policy_coordinate *th = &task.coordinate[0], *ph = &task.coordinate[1];
    *th = moving("th", "vth", LG_POLICY_ANGLE);
    th->start[0] = -3.14159, th->start[1] = 3.14159;
    th->weight = 1.0, th->weight_velocity = 0.05, th->success = 0.05, th->success_velocity = 0.3;
    *ph = moving("ph", "vph", LG_POLICY_ANGLE);
    ph->free = true, ph->weight_velocity = 1e-4, ph->success_velocity = 3.0;
    task.input[0] = (lg_policy_input){"u", -0.12, 0.12, 0.01};
    task.hidden_layers = 1, task.hidden[0] = 8;
    task.period = 0.04, task.horizon = 5.0, task.hold = 0.5, task.within = 6.0;
    return task;
}

/* ---- the plant with three states ---- */

static lg_status three_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const double det = M[0] * M[3] - M[1] * M[2],
                 inverse[4] = {M[3] / det, -M[2] / det, -M[1] / det, M[0] / det};
    const lg_var v = lg_slice(tape, in[0], 1, 1, 2), th = lg_slice(tape, in[0], 1, 0, 1);
    const lg_var drag = lg_mul(tape, v, lg_input_f64(tape, lg_shape2(1, 2), damping));
    const lg_var push = lg_concat(tape, (lg_var[]){lg_scale(tape, lg_sin(tape, th), weight), in[1]}, 2, 1);
    (void)user, (void)theta;
    out[0] = lg_concat(
        tape,
        (lg_var[]){lg_slice(tape, v, 1, 0, 1),
                   lg_matmul(tape, lg_sub(tape, push, drag), lg_input_f64(tape, lg_shape2(2, 2), inverse))},
        2, 1);
    return lg_tape_status(tape);
}

/* The same with the wheel's angle as a fourth state. */
static lg_status four_field(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var three[] = {lg_slice(tape, in[0], 1, 0, 3), in[1]};
    lg_var parts[2] = {LG_NONE, lg_slice(tape, in[0], 1, 2, 1)};
    const lg_status status = three_field(user, tape, theta, three, parts);
    out[0] = lg_concat(tape, parts, 2, 1);
    return status;
}

static lg_program *program_of_states(uint32_t n) {
    const lg_port in[] = {{.name = "x", .shape = lg_shape1(n)}, {.name = "u", .shape = lg_shape1(1)}},
                  out = {.name = "rate"};
    const lg_function_spec function = {"field", in, 2, &out, 1, n == 3 ? three_field : four_field, NULL};
    const lg_program_spec spec = {sizeof spec, NULL, 0, &function, 1, "a pendulum with a wheel"};
    lg_program *program;
    lg_space space;
    assert_ok(lg_program_build(NULL, &spec, &program, NULL));
    assert_ok(lg_space_init_rn(&space, n));
    assert_ok(lg_program_add_step(program, &space, lg_scheme_find("rk4"), 1e-5, 1.0, NULL));
    return program;
}

static void disturb(lg_policy_task *task) {
    lg_policy_coordinate *th = &task->coordinate[0], *ph = &task->coordinate[1];
    th->noise = 0.01, th->noise_velocity = 0.05, ph->noise_velocity = 0.5;
    task->delay = 0.5;
}

/* The regulator is given; the bounds of velocities are `wide` times as large. */
static lg_policy *make_states(uint32_t n, const double *gains, double wide, bool disturbed) {
    lg_policy_task task = wheel_task(LG_POLICY_LQR);
    if (disturbed) disturb(&task);
    const lg_policy_coordinate *ph = &task.coordinate[1], *th = &task.coordinate[0];
    lg_policy_coordinate states[4] = {*th, moving("vth", "", LG_POLICY_LINE),
                                      moving("vph", "", LG_POLICY_LINE), moving("ph", "", LG_POLICY_LINE)};
    states[3].free = true;
    states[0].velocity[0] = '\0', states[0].weight_velocity = 0.0, states[0].success_velocity = INFINITY;
    states[1].weight = th->weight_velocity, states[1].success = wide * th->success_velocity;
    states[2].weight = ph->weight_velocity, states[2].success = wide * ph->success_velocity;
    states[0].noise_velocity = 0.0, states[1].noise = th->noise_velocity,
    states[2].noise = ph->noise_velocity;
    memcpy(task.coordinate, states, sizeof states);
    task.coordinate_count = n, task.gain_count = 3;
    memcpy(task.gains, gains, 3 * sizeof *gains);
    lg_policy *policy;
    lg_error error = {LG_OK, ""};
    if (lg_policy_create(NULL, &task, program_of_states(n), 1, &policy, &error) != LG_OK)
        fail_msg("%s", error.message);
    lg_test_owns(policy, release_policy);
    return policy;
}

static void call(const lg_program *program, const char *function, const double *a, const double *b,
                 double *out) {
    assert_ok(lg_program_eval(NULL, program, function, 1, (const double *const[]){a, b},
                              (double *const[]){out}, NULL));
}

static void linearise(const lg_policy *policy, double *A, double *B) {
    const double zero[3] = {0}, u = 0;
    assert_ok(lg_program_eval(NULL, policy->program, "jac_linear", 1, (const double *const[]){zero, &u},
                              (double *const[]){A, B}, NULL));
}

TEST("regulator, costs and success are those of the plant without the position") {
    lg_policy_task task = wheel_task(LG_POLICY_LQR);
    const lg_policy *chosen = make(&task, wheel("angle", 1, 1, 1));
    assert_int_equal(chosen->layout.errors, 3);
    task.gain_count = 3;
    memcpy(task.gains, chosen->regulator.K, 3 * sizeof *task.gains);
    const lg_policy *given = make(&task, wheel("angle", 1, 1, 1)),
                    *three = make_states(3, task.gains, 1.0, false);
    double A[2][9], B[2][3];
    linearise(chosen, A[0], B[0]);
    linearise(three, A[1], B[1]);
    assert_all_close(A[0], A[1], 9, 1e-8, 1e-10);
    assert_all_close(B[0], B[1], 3, 1e-8, 1e-10);
    lg_policy_outcome own, other;
    assert_ok(lg_policy_evaluate(chosen, LG_POLICY_NOMINAL, 200, 3, 1, &own, NULL, NULL));
    assert_ok(lg_policy_evaluate(three, LG_POLICY_NOMINAL, 200, 3, 1, &other, NULL, NULL));
    print_message("%g of 200 succeed, cost %g and %g\n", (double)own.succeeded, own.cost_mean,
                  other.cost_mean);
    assert_true(own.succeeded > 20 && own.succeeded < 100);
    assert_int_equal(own.succeeded, other.succeeded);
    assert_close(own.cost_mean, other.cost_mean, 1e-6, 0.0);
    /* P of given gains weighs squares of velocities a tenth: of states they are then sqrt(10) as large. */
    assert_all_close(given->regulator.P, make_states(3, task.gains, sqrt(10.0), false)->regulator.P, 9, 1e-6,
                     1e-9);
}

TEST("a state of a program can be free") {
    static const double gains[3] = {-0.5, -0.05, -0.001}, z[3] = {0.3, -0.2, 9.0};
    lg_policy *three = make_states(3, gains, 1.0, false), *four = make_states(4, gains, 1.0, false);
    lg_policy_outcome own, other;
    assert_ok(lg_policy_evaluate(three, LG_POLICY_NOMINAL, 100, 3, 1, &own, NULL, NULL));
    assert_ok(lg_policy_evaluate(four, LG_POLICY_NOMINAL, 100, 3, 1, &other, NULL, NULL));
    assert_int_equal(own.succeeded, other.succeeded);
    assert_close(own.cost_mean, other.cost_mean, 1e-6, 0.0);
    lg_policy *const both[2] = {three, four};
    double rate[2][3], next[2][3];
    for (int k = 0; k < 2; k++) {
        lg_program *program;
        assert_ok(lg_policy_add_rate(both[k], &program, NULL));
        call(program, "rate", z, NULL, rate[k]);
        call(program, "advance", z, NULL, next[k]);
    }
    assert_all_close(rate[0], rate[1], 3, 1e-12, 1e-12);
    assert_all_close(next[0], next[1], 3, 1e-12, 1e-12);
}

TEST("disturbed runs are those of the plant without the position") {
    static const double gains[3] = {-0.5, -0.05, -0.001};
    lg_policy_task task = wheel_task(LG_POLICY_LQR);
    disturb(&task);
    task.gain_count = 3;
    memcpy(task.gains, gains, sizeof gains);
    const lg_policy *policy = make(&task, wheel("angle", 1, 1, 1)), *three = make_states(3, gains, 1.0, true);
    lg_policy_outcome own, other;
    assert_ok(lg_policy_evaluate(policy, LG_POLICY_DISTURBED, 100, 3, 1, &own, NULL, NULL));
    assert_ok(lg_policy_evaluate(three, LG_POLICY_DISTURBED, 100, 3, 1, &other, NULL, NULL));
    assert_int_equal(own.succeeded, other.succeeded);
    assert_close(own.cost_mean, other.cost_mean, 1e-6, 0.0);
}

TEST("an energy controller pushes by positions that are not free, and damps all velocities") {
    static const char coupled[] =
        "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: angle, "
        "velocity: w}]\ninputs: {columns: [u, f]}\nmass: {kind: known, values: [[2, 0.3], [0.3, 0.5]]}\n"
        "damping: {kind: known, values: [0.4, 0.1]}\ninput_map: {kind: known, values: [[1, 0], [0.7, 2]]}\n";
    lg_policy_task task = cart_task();
    task.kind = LG_POLICY_ENERGY, task.search = false;
    task.gain_count = 2, task.gains[0] = 0.3, task.gains[1] = 0.2;
    task.input_count = 2, task.input[1] = (lg_policy_input){"f", -10.0, 10.0, 0.002};
    task.coordinate[0].free = true, task.coordinate[0].weight = 0.0;
    const lg_policy *policy = make(&task, coupled);
    assert_all_close(policy->G, ((double[]){0.7, 1, 0.7, 2, 0, 2}), 6, 1e-6, 1e-7); /* th, vx, w */
    const double x[4] = {5, 0.1, 0.2, -0.4};
    double u[2];
    assert_ok(lg_program_eval(NULL, policy->program, "control", 1, (const double *const[]){x},
                              (double *const[]){u}, NULL));
    assert_close(u[0], -0.3 * 0.7 * 0.1 - 0.2 * (0.2 - 0.7 * 0.4), 1e-6, 0.0);
    assert_close(u[1], -0.3 * 2 * 0.1 + 0.2 * 2 * 0.4, 1e-6, 0.0);
}

TEST("the controller does not use the number, and the network has no feature of it") {
    lg_policy_task task = wheel_task(LG_POLICY_NETWORK);
    const lg_policy *policy = make(&task, wheel("line", 1, 1, 1));
    assert_int_equal(lg_policy_parameters(policy), 4 * 8 + 8 + 8 + 1);
    double u[3], x[4] = {2.0, 0.0, 1.0, -30.0};
    for (int k = 0; k < 3; k++) {
        x[1] = k == 0 ? 0.0 : k == 1 ? 2.0 : -1e9;
        assert_ok(lg_program_eval(NULL, policy->program, "control", 1, (const double *const[]){x},
                                  (double *const[]){u + k}, NULL));
    }
    assert_true(u[0] != 0.0 && fabs(u[0]) < 0.12);
    assert_true(u[1] == u[0] && u[2] == u[0]);
}

/* ---- certificates ---- */

/* A cart and a pole, wherever the cart is: the free coordinate comes first. */
static lg_policy_task drive_task(lg_policy_kind kind) {
    lg_policy_task task = cart_task();
    task.kind = kind;
    task.coordinate[0].free = true, task.coordinate[0].weight = 0.0;
    return task;
}

/* z: the angle of coordinate `held`, then both velocities. */
static void check_motion(lg_policy *policy, uint32_t held) {
    lg_program *program;
    const double z[3] = {0.4, -0.3, 0.7}, h = 1e-6;
    double q[2] = {0}, x[4], u, rate[3], next[4], moved[3], after[4];
    q[held] = z[0];
    assert_ok(lg_policy_add_rate(policy, &program, NULL));
    call(program, "momenta", q, z + 1, x);
    call(program, "policy", q, z + 1, &u);
    assert_ok(lg_program_eval(NULL, program, "step", 1, (const double *const[]){x, &u, &h},
                              (double *const[]){next}, NULL));
    call(program, "positions", next, NULL, after);
    call(program, "velocities", next, NULL, after + 2);
    call(program, "rate", z, NULL, rate);
    after[1] = after[held];
    for (int i = 0; i < 3; i++) assert_close(rate[i], (after[i + 1] - z[i]) / h, 1e-4, 1e-4);
    call(program, "advance", z, NULL, moved);
    call(program, "period", x, &u, next);
    call(program, "positions", next, NULL, after);
    call(program, "velocities", next, NULL, after + 2);
    after[1] = after[held];
    assert_all_close(moved, after + 1, 3, 1e-5, 1e-5);
}

TEST("rate and advance of a certificate are motions of what is not free, whatever its place") {
    static const double gains[3] = {-0.5, -0.05, -0.001}, others[3] = {-30, -3, -9};
    lg_policy_task task = wheel_task(LG_POLICY_LQR), drive = drive_task(LG_POLICY_LQR);
    task.search = drive.search = false, task.gain_count = drive.gain_count = 3;
    memcpy(task.gains, gains, sizeof gains);
    memcpy(drive.gains, others, sizeof others);
    check_motion(make(&task, wheel("angle", 1, 1, 1)), 0);
    check_motion(make(&drive, cart_pole), 1);
}

/* P = L L^T of the regulator: a state z of the set {V <= level} reaches far in the angle where the parts of
 * angle and velocity in V cancel each other. There the error of the angle is less than the angle, and V of
 * the errors is more than V of z. */
TEST("the bound of the gate is of the angle, also behind a free coordinate") {
    const lg_policy_task task = drive_task(LG_POLICY_NETWORK);
    const lg_policy *policy = make(&task, cart_pole);
    const lg_policy_regulator *r = &policy->regulator;
    double L[9], bound, most = 0, far = 0, level = 1;
    assert_true(lg_matrix_cholesky(3, r->P, L));
    for (int pass = 0; pass < 2; pass++) { /* the first one finds the level at which the angle reaches 2 */
        lg_rng rng = test_rng(12, 0);
        for (int k = 0; k < 20000; k++) {
            double y[3], z[3], q[2] = {0}, x[4], e[3], length = 0, gate = 0;
            for (int i = 0; i < 3; i++) y[i] = lg_rng_normal(&rng), length += y[i] * y[i];
            for (int i = 3; i-- > 0;) { /* L^T z = y */
                z[i] = y[i] * sqrt(level / length);
                for (int j = i + 1; j < 3; j++) z[i] -= L[3 * j + i] * z[j];
                z[i] /= L[4 * i];
            }
            far = fmax(far, z[0]);
            q[1] = z[0];
            call(policy->program, "momenta", q, z + 1, x);
            call(policy->program, "errors", x, NULL, e);
            for (int i = 0; i < 9; i++) gate += e[i / 3] * r->P[i] * e[i % 3];
            most = pass == 0 ? 0 : fmax(most, gate / r->c);
        }
        if (pass == 0) level *= 4 / (far * far);
    }
    assert_ok(lg_policy_bound_gate(policy, r->P, level, &bound, NULL));
    print_message("the gate's V/c up to %g, bound %g, level %g\n", most, bound, level / r->c);
    assert_true(most <= bound && most > 0.5 * bound && most > 1.2 * level / r->c);
}

/* ---- refusals ---- */

static void expect_refused(const lg_policy_task *task, const char *machine, lg_status status,
                           const char *says) {
    lg_policy *policy;
    lg_error error = {LG_OK, ""};
    assert_int_equal(lg_policy_create(NULL, task, machine_program(machine), 1, &policy, &error), status);
    if (strstr(error.message, says) == NULL) fail_msg("'%s' does not say '%s'", error.message, says);
}

TEST("a position on which the machine depends, a position with a weight, and a rotation cannot be free") {
    lg_policy_task task = drive_task(LG_POLICY_LQR);
    task.coordinate[1].free = true, task.coordinate[1].weight = 0.0, task.coordinate[1].success = INFINITY;
    task.coordinate[1].success_velocity = 1.0;
    expect_refused(&task, cart_pole, LG_CHECK_FAILED,
                   "free: the machine moves otherwise where th is 1 larger");
    task.coordinate[1].success = 0.1;
    expect_refused(&task, cart_pole, LG_INVALID_ARGUMENT, "free: the position of th is no error");
    task = body_task(LG_POLICY_LQR);
    task.coordinate[0].free = true;
    expect_refused(&task, body, LG_INVALID_ARGUMENT, "free: R is a rotation; only lines and angles");
}

TEST("a policy is not judged on a plant where the free position matters") {
    static const char spring[] =
        "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}]\ninputs: {columns: [u]}\n"
        "mass: {kind: known, values: [2]}\ndamping: {kind: known, values: [0.1]}\n"
        "input_map: {kind: known, values: [[1]]}\n%s";
    lg_policy_task task = drive_task(LG_POLICY_LQR);
    task.coordinate_count = 1, task.coordinate[0].success_velocity = 0.1;
    task.coordinate[0].start[0] = task.coordinate[0].start[1] = 0.0;
    /* Nothing but the velocity is held. */
    lg_policy *policy = make(&task, test_text(spring, "")), *other;
    lg_policy_outcome outcome;
    assert_int_equal(policy->layout.errors, 1);
    assert_ok(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 50, 1, 1, &outcome, NULL, NULL));
    assert_int_equal(outcome.succeeded, 50);
    lg_error error;
    const char *bound = test_text(spring, "potential: {kind: known, form: quadratic, of: x, values: [1]}\n");
    assert_int_equal(lg_policy_transplant(policy, machine_program(bound), NULL, &other, &error),
                     LG_CHECK_FAILED);
    assert_non_null(strstr(error.message, "free: the machine moves otherwise where x"));
}

/* ---- units ---- */

TEST("regulator and runs are the same in other units of mass, length and time") {
    static const double units[][3] = {{1, 1, 1}, {1e9, 1e-9, 1}, {1e-9, 1e9, 1e9}};
    lg_policy_outcome first = {.starts = 0};
    double gain = 0.0;
    for (size_t k = 0; k < LG_COUNT(units); k++) {
        const double m = units[k][0], l = units[k][1], t = units[k][2], moment = m * l * l / (t * t);
        lg_policy_task task = wheel_task(LG_POLICY_LQR);
        for (int i = 0; i < 2; i++)
            task.coordinate[i].weight_velocity *= t * t, task.coordinate[i].success_velocity /= t;
        task.input[0].low *= moment, task.input[0].high *= moment, task.input[0].weight /= moment * moment;
        task.period *= t, task.horizon *= t, task.hold *= t, task.within *= t;
        const lg_policy *policy = make(&task, wheel("angle", m, l, t));
        lg_policy_outcome outcome;
        assert_ok(lg_policy_evaluate(policy, LG_POLICY_REGULATED, 64, 5, 1, &outcome, NULL, NULL));
        if (k == 0) first = outcome, gain = policy->regulator.K[2];
        assert_close(policy->regulator.K[2] / (moment * t), gain, 1e-6, 0.0);
        assert_int_equal(outcome.succeeded, first.succeeded);
        assert_close(outcome.cost_median, t * first.cost_median, 1e-5, 0.0);
    }
}

/* ---- training ---- */

TEST("a short training swings up more starts than the regulator, and its file gives the same runs") {
    static const char text[] =
        "plant: wheel.yaml\nperiod: 0.04\nhorizon: 5\nstarts: {th: [-3.14159, 3.14159], ph: [-9, 9]}\n"
        "limits: {u: 0.12}\ncost: {th: 1, vth: 0.05, vph: 1e-4, u: 0.01}\nsuccess: {th: 0.05, vth: 0.3, vph: "
        "3, hold: 0.5, within: 6}\ncontroller: {kind: network, hidden: [8]}\nfree: [ph]\n";
    lg_policy_task task = wheel_task(LG_POLICY_NETWORK), read = task;
    for (uint32_t i = 0; i < 2; i++) /* what the plant tells */
        read.coordinate[i].free = false, read.coordinate[i].weight = read.coordinate[i].weight_velocity = 0.0;
    assert_ok(lg_policy_task_parse(NULL, "task", text, &read, NULL));
    task.coordinate[1].start[0] = -9, task.coordinate[1].start[1] = 9; /* changes no run */
    assert_memory_equal(&task.coordinate, &read.coordinate, sizeof task.coordinate);
    lg_policy *policy = make(&task, wheel("angle", 1, 1, 1)), *loaded;
    lg_policy_train_options o;
    lg_policy_train_options_init(&o);
    o.seeds = 2, o.race = 60, o.finish = 120, o.polish = 5, o.threads = 2;
    lg_policy_trainer *trainer;
    assert_ok(lg_policy_trainer_create(policy, &o, &trainer, NULL));
    assert_ok(lg_policy_trainer_run(trainer, NULL, NULL));
    lg_policy_trainer_destroy(trainer);
    lg_policy_outcome own, same, regulator;
    assert_ok(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 200, 5, 1, &own, NULL, NULL));
    assert_ok(lg_policy_evaluate(policy, LG_POLICY_REGULATED, 200, 5, 1, &regulator, NULL, NULL));
    print_message("%g of 200, the regulator %g\n", (double)own.succeeded, (double)regulator.succeeded);
    assert_true(own.succeeded > regulator.succeeded + 40);
    assert_ok(lg_policy_save(NULL, "test_policy_free.h5", policy, text, NULL, NULL));
    assert_ok(lg_policy_load(NULL, "test_policy_free.h5", NULL, &loaded, NULL, NULL));
    (void)unlink("test_policy_free.h5");
    lg_test_owns(loaded, release_policy);
    assert_ok(lg_policy_evaluate(loaded, LG_POLICY_NOMINAL, 200, 5, 2, &same, NULL, NULL));
    assert_memory_equal(&own, &same, sizeof own);
}

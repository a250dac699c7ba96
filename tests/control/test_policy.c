/* Policies: errors of coordinates, the regulator and its region, gradients, training that can be stopped,
 * files.
 * ctest-labels: slow src/control src/integrators */
#include <unistd.h>

#include "autodiff/program/program.h"
#include "liegrad/geometry.h"
#include "liegrad/ops.h"
#include "support/fixtures.h"
#include "support/memory_archive.h"
#include "support/policies.h"
#include "support/rank_team.h"
#include "test_support.h"

/* ---- errors ---- */

/* Errors of the position and velocity at z from the goal. */
static void errors_of(const lg_policy_task *task, const double *z, double *out) {
    lg_policy p = {.task = *task};
    lg_tape *tape;
    lg_policy_lay_out(task, &p.layout);
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    const lg_policy_seen seen =
        lg_policy_record_place(tape, &p, lg_input_f64(tape, lg_shape2(1, p.layout.errors), z));
    assert_ok(lg_read(tape, lg_policy_record_errors(tape, &p, false, seen), p.layout.errors, out));
    lg_tape_destroy(tape);
}

static lg_policy_task every_motion(void) {
    static const double half[3] = {0.3, -0.2, 0.4};
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.coordinate_count = 4;
    task.coordinate[0] = coordinate("x", "vx", LG_POLICY_LINE, 1.0);
    task.coordinate[1] = coordinate("a", "va", LG_POLICY_ANGLE, 1.0);
    task.coordinate[2] = coordinate("d", "vd", LG_POLICY_DIRECTION, 1.0);
    task.coordinate[3] = coordinate("R", "vR", LG_POLICY_ROTATION, 1.0);
    task.coordinate[0].goal[0] = 0.7, task.coordinate[1].goal[0] = -2.0;
    const double direction[3] = {0.6, 0.0, 0.8};
    memcpy(task.coordinate[2].goal, direction, sizeof direction);
    lg_so3_exp(half, task.coordinate[3].goal);
    return task;
}

TEST("errors are tangent coordinates at the goal, and have the length 2 sin(a/2) up to the opposite side") {
    const lg_policy_task task = every_motion();
    static const uint32_t at[4] = {0, 1, 2, 4}, count[4] = {1, 1, 2, 3};
    static const double angles[] = {1e-9, 1e-3, 0.5, 2.0, 3.1, 3.14159};
    lg_rng rng = test_rng(3, 0);
    for (size_t k = 0; k < LG_COUNT(angles); k++) {
        double z[14] = {0}, e[14];
        for (int i = 0; i < 4; i++) {
            double sum = 0.0;
            for (uint32_t j = 0; j < count[i]; j++)
                z[at[i] + j] = lg_rng_normal(&rng), sum += pow(z[at[i] + j], 2);
            for (uint32_t j = 0; j < count[i]; j++) z[at[i] + j] *= angles[k] / sqrt(sum);
        }
        for (int j = 7; j < 14; j++) z[j] = angles[k] < 0.1 ? lg_rng_normal(&rng) : 0.0;
        errors_of(&task, z, e);
        for (int i = 0; i < 4; i++) { /* along z; of the length 2 sin(a/2) but for 1e-6/cos^2(a/2) */
            const double length = i == 0 ? angles[k] : 2.0 * sin(angles[k] / 2.0), c = cos(angles[k] / 2.0);
            for (uint32_t j = 0; j < count[i]; j++)
                assert_close(e[at[i] + j], z[at[i] + j] * length / angles[k], 2e-6 / (c * c + 1e-6), 1e-14);
        }
        for (int j = 7; j < 14; j++) assert_close(e[j], z[j], 2e-3, 2e-3 * angles[k]);
    }
}

/* r(x) = sqrt(x^2 + 1e-6): the potential 4 k (r(1) - r(cos(a/2))) of lg_certify_rotation has this slope. */
TEST("the error of a rotation is 2 sin(a/2) cos(a/2)/r(cos(a/2)), as the certificate of its energy says") {
    const lg_policy_task task = body_task(LG_POLICY_ENERGY);
    for (double from_pi = 3.1; from_pi > 1e-7; from_pi *= 0.3) {
        const double half = 0.5 * (3.141592653589793 - from_pi), c = cos(half);
        const double z[6] = {2 * half};
        double e[6];
        errors_of(&task, z, e);
        assert_close(e[0], 2 * sin(half) * c / sqrt(c * c + 1e-6), 1e-9, 1e-9);
    }
}

TEST("success is measured by the angle: opposite to the goal, where the error is 0, nothing succeeds") {
    static const double angles[] = {0.099, 0.101, 1.5, 3.0, 3.14, 3.14159265, 3.141592653589793};
    lg_policy_task task = every_motion();
    for (uint32_t i = 1; i < 4; i++)
        for (size_t k = 0; k < LG_COUNT(angles); k++)
            for (int wide = 0; wide < 2; wide++) {
                lg_policy p = {.task = task};
                double z[LG_POLICY_ERRORS] = {0}, e[LG_POLICY_ERRORS], q[16];
                lg_tape *tape;
                p.task.coordinate[i].success = wide ? 3.1 : 0.1;
                lg_policy_lay_out(&p.task, &p.layout);
                z[p.layout.at[i].error] = angles[k];
                assert_ok(lg_tape_create(NULL, NULL, &tape));
                const lg_policy_seen seen =
                    lg_policy_record_place(tape, &p, lg_input_f64(tape, lg_shape2(1, p.layout.errors), z));
                assert_ok(lg_read(tape, seen.q, p.layout.positions, q));
                assert_ok(lg_read(tape, lg_policy_record_errors(tape, &p, false, seen), p.layout.errors, e));
                lg_tape_destroy(tape);
                assert_int_equal(lg_policy_inside(&p, q, e), angles[k] < p.task.coordinate[i].success);
            }
}

TEST("a run that hangs opposite to the goal fails") {
    const lg_policy_task task = body_task(LG_POLICY_LQR);
    const lg_policy *policy = make(&task, body);
    const double z[6] = {3.141592653589793};
    double x[12], e[6];
    bool held = true;
    assert_ok(lg_policy_states(policy, z, 1, x, NULL));
    lg_policy_runs runs = {.count = 1, .steps = 5, .x = x, .succeeded = &held};
    assert_ok(lg_policy_run(policy, &(lg_policy_trial){.theta = policy->theta, .threads = 1}, &runs, NULL));
    assert_ok(lg_program_eval(NULL, policy->program, "errors", 1, (const double *const[]){x},
                              (double *const[]){e}, NULL));
    assert_true(hypot(hypot(e[0], e[1]), e[2]) < 0.01 && !held);
}

TEST("positions from a quaternion are those of its rotation, and control is the policy at these positions") {
    const lg_policy_task task = body_task(LG_POLICY_NETWORK);
    const lg_policy *policy = make(&task, body);
    lg_rng rng = test_rng(4, 0);
    for (int k = 0; k < 20; k++) {
        double x[7], u[3], other[3], R[9], axis[3], norm = 0.0;
        for (int i = 0; i < 3; i++) axis[i] = lg_rng_uniform_in(&rng, -1.8, 1.8), norm += axis[i] * axis[i];
        norm = sqrt(norm);
        lg_so3_exp(axis, R);
        x[0] = cos(norm / 2.0);
        for (int i = 0; i < 3; i++) x[1 + i] = sin(norm / 2.0) * axis[i] / norm;
        for (int i = 4; i < 7; i++) x[i] = lg_rng_normal(&rng);
        assert_ok(lg_program_eval(NULL, lg_policy_program(policy), "control", 1, (const double *const[]){x},
                                  (double *const[]){u}, NULL));
        assert_ok(lg_program_eval(NULL, lg_policy_program(policy), "policy", 1,
                                  (const double *const[]){R, x + 4, policy->theta}, (double *const[]){other},
                                  NULL));
        assert_all_close(u, other, 3, 1e-12, 1e-12);
        for (int i = 0; i < 4; i++) x[i] *= -3.0; /* the same rotation */
        assert_ok(lg_program_eval(NULL, lg_policy_program(policy), "control", 1, (const double *const[]){x},
                                  (double *const[]){other}, NULL));
        assert_all_close(u, other, 3, 1e-12, 1e-12);
    }
}

TEST("opposite to the goal the regulator does not act, in single precision neither") {
    const lg_policy_task task = cart_task();
    const lg_policy *policy = make(&task, cart_pole);
    static const double from[] = {0.01, 1e-3, 1e-4, 1e-6, 1e-9, 0.0};
    double before = NAN;
    lg_plan *single;
    assert_ok(lg_program_plan(policy->program, "control", LG_F32, 1, &single, NULL));
    float *work = lg_test_memory(lg_plan_work_size(single));
    for (size_t k = 0; k < LG_COUNT(from); k++) {
        const double x[4] = {0.0, 3.14159265358979323846 - from[k], 0.0, 0.0};
        const float y[4] = {0.0F, (float)x[1], 0.0F, 0.0F};
        double u;
        float v;
        assert_ok(lg_program_eval(NULL, lg_policy_program(policy), "control", 1, (const double *const[]){x},
                                  (double *const[]){&u}, NULL));
        lg_plan_eval(single, (const void *[]){y}, (void *[]){&v}, work);
        assert_close(v, u, 0.0, 1e-3);
        if (k > 0) assert_close(u, before, 0.0, 0.05); /* of 20: the network is smooth, the gate is closed */
        before = u;
    }
    lg_plan_destroy(single);
}

/* ---- limits ---- */

TEST("inputs stay in their limits in any state, also in single precision") {
    static const lg_policy_kind kinds[] = {LG_POLICY_LQR, LG_POLICY_NETWORK, LG_POLICY_ENERGY};
    lg_rng rng = test_rng(5, 0);
    for (size_t k = 0; k < LG_COUNT(kinds); k++) {
        lg_policy_task task = body_task(kinds[k]);
        task.input[1].low = -0.5; /* not symmetric */
        lg_policy *policy = make(&task, body);
        for (size_t i = 0; i < policy->parameters; i++) policy->theta[i] = 2.0 * lg_rng_normal(&rng);
        assert_ok(lg_policy_take(policy, policy->theta));
        for (int n = 0; n < 60; n++) {
            double x[7], u[3], far = pow(10.0, lg_rng_uniform_in(&rng, -3.0, 6.0));
            for (int i = 0; i < 7; i++) x[i] = lg_rng_normal(&rng) * (i < 4 ? 1.0 : far);
            assert_ok(lg_program_eval(NULL, lg_policy_program(policy), "control", 1,
                                      (const double *const[]){x}, (double *const[]){u}, NULL));
            for (int l = 0; l < 3; l++)
                assert_true(u[l] >= task.input[l].low - 1e-15 && u[l] <= task.input[l].high + 1e-15);
        }
    }
}

/* ---- the regulator ---- */

TEST("a network without a gate needs no search for a regulator; with it, scales follow from the unforced "
     "motion") {
    lg_policy_task task = cart_task();
    task.kind = LG_POLICY_NETWORK;
    const double *wide = make(&task, cart_pole)->scale;
    task.kind = LG_POLICY_NETWORK, task.gate = task.search = false;
    const lg_policy *policy = make(&task, cart_pole);
    const double x[4] = {0.3, 0.2, -0.4, 0.1};
    double u;
    assert_ok(lg_program_eval(NULL, policy->program, "control", 1, (const double *const[]){x},
                              (double *const[]){&u}, NULL));
    assert_true(isfinite(u) && u != 0.0);
    /* A pole of 1 m that falls from upright reaches sqrt(4 g/l) = 6.3 rad/s. */
    assert_close(policy->scale[3], 4.0 * task.coordinate[1].start_velocity[1], 0.0, 1e-12);
    assert_true(wide[3] > 4.5 && wide[3] < 10.0);
}

TEST("the regulator holds from its whole region, and not from one of ten times its level") {
    const lg_policy_task task = cart_task();
    const lg_policy *policy = make(&task, cart_pole);
    const lg_policy_regulator *r = lg_policy_regulator_of(policy);
    assert_true(r->radius < 1.0 && r->c > 0.0);
    assert_close(r->u0[0], 0.0, 0.0, 1e-12);
    lg_rng rng = test_rng(6, 0);
    size_t inside = 0, held[2] = {0, 0}, count[2] = {0, 0};
    enum { N = 512 };
    double *z = TEST_ARRAY(double, N * 4), *x = TEST_ARRAY(double, N * 4);
    bool *ok = TEST_ARRAY(bool, N);
    for (size_t i = 0; i < N; i++) {
        z[4 * i] = 0.3 * lg_rng_normal(&rng), z[4 * i + 1] = 0.8 * lg_rng_normal(&rng);
        z[4 * i + 2] = 0.3 * lg_rng_normal(&rng), z[4 * i + 3] = 3.0 * lg_rng_normal(&rng);
    }
    assert_ok(lg_policy_states(policy, z, N, x, NULL));
    lg_policy_runs runs = {.count = N, .steps = lg_policy_steps(policy), .x = x, .succeeded = ok};
    assert_ok(lg_policy_run(policy, &(lg_policy_trial){.gain = r->K, .threads = 1}, &runs, NULL));
    for (size_t i = 0; i < N; i++) {
        double V = 0.0, e[4] = {z[4 * i], 2.0 * sin(z[4 * i + 1] / 2.0), z[4 * i + 2], z[4 * i + 3]};
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < 4; b++) V += e[a] * r->P[4 * a + b] * e[b];
        const int where = V < r->c ? 0 : V > 10.0 * r->c ? 1 : -1;
        if (where < 0) continue;
        count[where]++, held[where] += ok[i];
        inside += where == 0;
    }
    print_message("%zu inside, %zu beyond\n", inside, count[1]);
    assert_true(inside > 20 && count[1] > 20);
    assert_int_equal(held[0], count[0]);
    assert_true(held[1] < count[1] / 2);
}

TEST("in the gate of a network the regulator of the cost acts: runs from its set succeed and cost less") {
    lg_policy_task task = cart_task();
    task.kind = LG_POLICY_NETWORK;
    const lg_policy *policy = make(&task, cart_pole);
    const lg_policy_regulator *r = lg_policy_regulator_of(policy);
    enum { N = 256 };
    double *z = TEST_ARRAY(double, N * 4), *x = TEST_ARRAY(double, N * 4), *cost = TEST_ARRAY(double, N),
           sum[2];
    bool *ok = TEST_ARRAY(bool, N);
    lg_rng rng = test_rng(6, 1);
    for (size_t i = 0; i < N; i++) {
        double V = 0.0, *e = z + 4 * i;
        for (int a = 0; a < 4; a++) e[a] = lg_rng_normal(&rng);
        for (int a = 0; a < 16; a++) V += e[a / 4] * r->P[a] * e[a % 4];
        for (int a = 0; a < 4; a++) e[a] *= sqrt(0.5 * r->c / V);
    }
    for (int gain = 0; gain < 2; gain++) {
        assert_ok(lg_policy_states(policy, z, N, x, NULL));
        lg_policy_runs runs = {
            .count = N, .steps = lg_policy_steps(policy), .x = x, .cost = cost, .succeeded = ok};
        const lg_policy_trial trial = {.gain = gain == 0 ? r->near : r->K, .threads = 1};
        assert_ok(lg_policy_run(policy, &trial, &runs, NULL));
        sum[gain] = 0.0;
        for (size_t i = 0; i < N; i++) {
            assert_true(ok[i]);
            sum[gain] += cost[i];
        }
    }
    print_message("cost %g by near, %g by K\n", sum[0] / N, sum[1] / N);
    assert_true(sum[0] < 0.8 * sum[1]);
}

TEST(
    "a goal that no constant input holds is refused with what moves, one outside the limits with the input") {
    lg_error error = {LG_OK, ""};
    lg_policy *policy;
    lg_policy_task task = cart_task();
    task.coordinate[1].goal[0] = 0.3;
    assert_int_equal(lg_policy_create(NULL, &task, machine_program(cart_pole), 1, &policy, &error),
                     LG_CHECK_FAILED);
    assert_non_null(strstr(error.message, "not an equilibrium"));
    static const char pushed[] =
        "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}]\ninputs: {columns: [u]}\n"
        "mass: {kind: known, values: [2]}\npotential: {kind: known, form: quadratic, of: x, values: [3]}\n"
        "input_map: {kind: known, values: [1]}\n";
    lg_policy_task spring = cart_task();
    spring.coordinate_count = 1;
    spring.coordinate[0].goal[0] = 0.5, spring.coordinate[0].success = 0.1;
    assert_ok(lg_policy_create(NULL, &spring, machine_program(pushed), 1, &policy, &error));
    assert_close(lg_policy_regulator_of(policy)->u0[0], 2.0 * 3.0 * 0.5, 1e-9, 0.0); /* V = 3 x^2 */
    lg_policy_destroy(policy);
    spring.input[0].high = 2.5;
    assert_int_equal(lg_policy_create(NULL, &spring, machine_program(pushed), 1, &policy, &error),
                     LG_CHECK_FAILED);
    assert_non_null(strstr(error.message, "must be 3, which is not inside"));
}

/* ---- functions for certificates ---- */

/* Positions and velocities of a state. */
static void seen_of(const lg_policy *policy, const double *x, double *out) {
    assert_ok(lg_program_eval(NULL, policy->program, "positions", 1, (const double *const[]){x},
                              (double *const[]){out}, NULL));
    assert_ok(lg_program_eval(NULL, policy->program, "velocities", 1, (const double *const[]){x},
                              (double *const[]){out + policy->layout.positions}, NULL));
}

TEST("rate is the derivative of positions and velocities along the loop, advance is a period of it") {
    lg_policy_task task = cart_task();
    task.kind = LG_POLICY_LQR;
    task.coordinate[0].goal[0] = 0.3; /* a cart may stand anywhere */
    lg_policy *policy = make(&task, cart_pole);
    lg_program *program;
    lg_rng rng = test_rng(9, 0);
    assert_ok(lg_policy_add_rate(policy, &program, NULL));
    for (int k = 0; k < 50; k++) {
        static const double h = 1e-6;
        double z[4], q[2], v[2], x[4], u, next[4], rate[4], after[4], before[4], moved[4];
        for (int i = 0; i < 4; i++) z[i] = lg_rng_normal(&rng);
        for (int i = 0; i < 2; i++) q[i] = task.coordinate[i].goal[0] + z[i], v[i] = z[2 + i];
        assert_ok(lg_program_eval(NULL, program, "momenta", 1, (const double *const[]){q, v},
                                  (double *const[]){x}, NULL));
        assert_ok(lg_program_eval(NULL, program, "policy", 1, (const double *const[]){q, v},
                                  (double *const[]){&u}, NULL));
        assert_ok(lg_program_eval(NULL, program, "step", 1, (const double *const[]){x, &u, &h},
                                  (double *const[]){next}, NULL));
        assert_ok(lg_program_eval(NULL, program, "rate", 1, (const double *const[]){z},
                                  (double *const[]){rate}, NULL));
        seen_of(policy, x, before);
        seen_of(policy, next, after);
        for (int i = 0; i < 4; i++) assert_close(rate[i], (after[i] - before[i]) / h, 1e-4, 1e-4);
        assert_ok(lg_program_eval(NULL, program, "period", 1, (const double *const[]){x, &u},
                                  (double *const[]){next}, NULL));
        assert_ok(lg_program_eval(NULL, program, "advance", 1, (const double *const[]){z},
                                  (double *const[]){moved}, NULL));
        seen_of(policy, next, after);
        for (int i = 0; i < 2; i++) after[i] -= task.coordinate[i].goal[0];
        assert_all_close(moved, after, 4, 1e-5, 1e-5); /* two integrators */
    }
}

TEST("the bound of the gate holds at points of the set, and is nearly reached") {
    const lg_policy_task task = cart_task();
    const lg_policy *policy = make(&task, cart_pole);
    const lg_policy_regulator *r = &policy->regulator;
    const double P[16] = {1, 0, 0, 0, 0, 2, 0.5, 0, 0, 0.5, 1, 0, 0, 0, 0, 0.3}, level = 1.7;
    double bound, most = 0;
    lg_rng rng = test_rng(12, 0);
    assert_ok(lg_policy_bound_gate(policy, P, level, &bound, NULL));
    for (int k = 0; k < 4000; k++) {
        double z[4], q[2], v[2], x[4], e[4], V = 0, gate = 0;
        for (int i = 0; i < 4; i++) z[i] = lg_rng_normal(&rng);
        for (int i = 0; i < 16; i++) V += z[i / 4] * P[i] * z[i % 4];
        for (int i = 0; i < 4; i++) z[i] *= sqrt(level / V);
        for (int i = 0; i < 2; i++) q[i] = task.coordinate[i].goal[0] + z[i], v[i] = z[2 + i];
        assert_ok(lg_program_eval(NULL, policy->program, "momenta", 1, (const double *const[]){q, v},
                                  (double *const[]){x}, NULL));
        assert_ok(lg_program_eval(NULL, policy->program, "errors", 1, (const double *const[]){x},
                                  (double *const[]){e}, NULL));
        for (int i = 0; i < 16; i++) gate += e[i / 4] * r->P[i] * e[i % 4];
        most = fmax(most, gate / r->c);
    }
    print_message("the gate's V/c up to %g, bound %g\n", most, bound);
    assert_true(most <= bound && most > 0.7 * bound);
    double saddle[16] = {-1};
    assert_int_equal(lg_policy_bound_gate(policy, saddle, level, &bound, NULL), LG_INVALID_ARGUMENT);
    lg_policy_task plain = cart_task();
    plain.kind = LG_POLICY_LQR;
    assert_int_equal(lg_policy_bound_gate(make(&plain, cart_pole), P, level, &bound, NULL), LG_UNSUPPORTED);
}

TEST("an energy controller has the gains that are given, whatever the machine does in a period") {
    static const char damped[] =
        "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}]\ninputs: {columns: [u]}\n"
        "mass: {kind: known, values: [2]}\npotential: {kind: known, form: quadratic, of: x, values: [3]}\n"
        "damping: {kind: known, values: [4]}\ninput_map: {kind: known, values: [0.7]}\n";
    static const double periods[] = {0.01, 0.2};
    for (size_t k = 0; k < LG_COUNT(periods); k++) {
        lg_policy_task task = cart_task();
        task.kind = LG_POLICY_ENERGY, task.period = periods[k], task.coordinate_count = 1;
        task.coordinate[0].success = 0.1;
        const lg_policy *policy = make(&task, damped);
        assert_all_close(policy->G, ((double[]){0.7, 0.7}), 2, 1e-6, 0.0);
    }
}

/* ---- gradients ---- */

static void check_gradient(const lg_policy_task *task, const char *machine, double cut) {
    const lg_policy *policy = make(task, machine);
    lg_rng rng = test_rng(8, 0);
    const size_t count = LG_POLICY_ROWS;
    double *z = TEST_ARRAY(double, count * policy->layout.errors),
           *x = TEST_ARRAY(double, count * policy->state);
    for (size_t i = 0; i < count; i++) lg_policy_draw(policy, &rng, z + i * policy->layout.errors);
    assert_ok(lg_policy_states(policy, z, count, x, NULL));
    rolled of = roll(policy, x, 1);
    of.cut = cut;
    check_rolled(&of);
}

TEST("the gradient of the cost of runs is that of differences, with a cut and without") {
    const lg_policy_task cart = cart_task(), network = body_task(LG_POLICY_NETWORK),
                         energy = body_task(LG_POLICY_ENERGY);
    check_gradient(&cart, cart_pole, INFINITY);
    check_gradient(&cart, cart_pole, 5.0);
    check_gradient(&network, body, INFINITY);
    check_gradient(&energy, body, INFINITY);
}

TEST("runs of a piece are as long as asked: a longer run costs what its shorter part does, and more") {
    const lg_policy_task task = cart_task();
    const lg_policy *policy = make(&task, cart_pole);
    enum { N = LG_POLICY_ROWS };
    double *x = TEST_ARRAY(double, N * policy->state), *g = TEST_ARRAY(double, policy->parameters),
           *end = TEST_ARRAY(double, N), *cost = TEST_ARRAY(double, N);
    bool *held = TEST_ARRAY(bool, N);
    lg_rng rng = test_rng(8, 0);
    assert_ok(lg_policy_starts(policy, &rng, N, x, NULL, NULL));
    for (size_t steps = 4; steps <= 10; steps += 6) {
        rolled of = roll(policy, x, 1);
        double *from = TEST_ARRAY(double, N * policy->state), sum = 0;
        memcpy(from, x, N * policy->state * sizeof *x);
        lg_policy_runs runs = {.count = N, .steps = steps, .x = from, .cost = cost, .succeeded = held};
        assert_ok(
            lg_policy_run(policy, &(lg_policy_trial){.theta = policy->theta, .threads = 1}, &runs, NULL));
        assert_ok(lg_program_eval(NULL, policy->program, "terminal", N, (const double *const[]){from},
                                  (double *const[]){end}, NULL));
        for (int i = 0; i < N; i++) sum += (cost[i] + end[i]) / N;
        of.steps = steps;
        assert_close(rolled_cost(&of, g), sum, 1e-10, 0.0);
    }
}

/* ---- training ---- */

static lg_policy_train_options short_training(int threads) {
    lg_policy_train_options o;
    lg_policy_train_options_init(&o);
    o.seeds = 5, o.race = 9, o.finish = 4, o.polish = 6, o.threads = threads;
    return o;
}

static void train(lg_policy *policy, const lg_policy_train_options *options, lg_policy_train_result *result) {
    lg_policy_trainer *trainer;
    assert_ok(lg_policy_trainer_create(policy, options, &trainer, NULL));
    assert_ok(lg_policy_trainer_run(trainer, result, NULL));
    lg_policy_trainer_destroy(trainer);
}

TEST("the result of training has the share of validation starts that succeed, and their cost") {
    lg_policy_task task = cart_task();
    task.kind = LG_POLICY_LQR;
    lg_policy *policy = make(&task, cart_pole);
    const lg_policy_train_options o = short_training(1);
    lg_policy_train_result result;
    lg_policy_outcome outcome;
    train(policy, &o, &result);
    assert_ok(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 4000, 3, 1, &outcome, NULL, NULL));
    const double success = (double)outcome.succeeded / (double)outcome.starts;
    assert_true(success > 0.05 && success < 0.95);
    assert_close(result.success, success, 0.0, 4.0 * sqrt(success * (1.0 - success) / 512.0));
    assert_close(result.cost, outcome.cost_mean, 0.3, 0.0);
}

/* The parameters after the short training by one thread; *result: what it says. Trained once. */
static const double *trained_alone(lg_policy_train_result *result) {
    static double theta[256];
    static lg_policy_train_result first;
    if (theta[0] == 0) {
        const lg_policy_task task = cart_task();
        const lg_policy_train_options o = short_training(1);
        lg_policy *policy = make(&task, cart_pole);
        assert_true(policy->parameters <= LG_COUNT(theta));
        train(policy, &o, &first);
        assert_true(isfinite(first.cost));
        memcpy(theta, policy->theta, policy->parameters * sizeof *theta);
    }
    if (result != NULL) *result = first;
    return theta;
}

TEST("training gives the same bits with one thread and with three") {
    const lg_policy_task task = cart_task();
    const lg_policy_train_options o = short_training(3);
    lg_policy *policy = make(&task, cart_pole);
    train(policy, &o, NULL);
    assert_memory_equal(trained_alone(NULL), policy->theta, policy->parameters * sizeof(double));
}

/* ---- ranks ---- */

typedef struct trained_by_ranks {
    lg_policy *policy[TEAM_MOST];
    lg_policy_train_options options;
    lg_policy_train_result result[TEAM_MOST];
    double seconds; /* options.seconds of rank 0; the other ranks have no time */
} trained_by_ranks;

static lg_status train_on_rank(void *user, const lg_ranks *ranks, lg_error *error) {
    trained_by_ranks *all = user;
    lg_policy_trainer *trainer;
    lg_policy_train_options o = all->options;
    o.ranks = ranks;
    o.seconds = ranks->rank == 0 ? all->seconds : fmin(all->seconds, 1e-9);
    lg_status status = lg_policy_trainer_create(all->policy[ranks->rank], &o, &trainer, error);
    if (status != LG_OK) return status;
    status = lg_policy_trainer_run(trainer, &all->result[ranks->rank], error);
    lg_policy_trainer_destroy(trainer);
    return status;
}

static void train_on_ranks(uint32_t count, trained_by_ranks *all, lg_status expected) {
    const lg_policy_task task = cart_task();
    rank_team team;
    for (uint32_t r = 0; r < count; r++) all->policy[r] = make(&task, cart_pole);
    team_run(&team, count, train_on_rank, all);
    for (uint32_t r = 0; r < count; r++) {
        assert_int_equal(team.members[r].status, expected);
        assert_memory_equal(all->policy[0]->theta, all->policy[r]->theta,
                            all->policy[0]->parameters * sizeof(double));
    }
}

TEST("training gives the same bits with one process, two ranks and five ranks") {
    trained_by_ranks all = {.options = short_training(1)};
    lg_policy_train_result result;
    const double *alone = trained_alone(&result);
    for (uint32_t count = 2; count <= 5; count += 3) {
        train_on_ranks(count, &all, LG_OK);
        assert_memory_equal(alone, all.policy[0]->theta, all.policy[0]->parameters * sizeof(double));
        assert_true(all.result[count - 1].cost == result.cost && all.result[count - 1].seed == result.seed);
    }
}

static lg_status rank_1_leaves(void *user, const lg_ranks *ranks, lg_error *error) {
    return ranks->rank == 1 ? LG_OK : train_on_rank(user, ranks, error);
}

TEST("a rank that loses the others says so") {
    trained_by_ranks all = {.options = short_training(1)};
    const lg_policy_task task = cart_task();
    rank_team team;
    all.policy[0] = make(&task, cart_pole);
    team_run(&team, 2, rank_1_leaves, &all);
    assert_int_equal(team.members[0].status, LG_FILE);
    assert_says(team.members[0].error.message, "lost their connection");
}

TEST("all ranks stop where rank 0 has no more time") {
    trained_by_ranks all = {.options = short_training(1), .seconds = 1e15};
    const lg_policy_task task = cart_task();
    lg_policy *alone = make(&task, cart_pole);
    lg_policy_train_options o = all.options;
    o.seconds = 1e15;
    train(alone, &o, NULL);
    train_on_ranks(2, &all, LG_OK);
    assert_memory_equal(alone->theta, all.policy[0]->theta, alone->parameters * sizeof(double));
}

typedef struct stopping {
    uint64_t at, calls;
    volatile int flag;
} stopping;

static void stop(void *user, const lg_policy_progress *now) {
    stopping *s = user;
    (void)now;
    if (++s->calls == s->at) s->flag = 1;
}

TEST("training that is stopped anywhere and continued ends with the same bits") {
    lg_policy_task task = cart_task();
    lg_policy_train_options o = short_training(1);
    for (uint64_t at = 4; at < 31; at += 8) { /* in each phase, and in two rounds of the second one */
        lg_policy_trainer *trainer;
        memory_archive archive = {.count = 0};
        stopping s = {.at = at};
        lg_context_options options;
        lg_context *context;
        lg_policy *policy;
        lg_context_options_init(&options);
        options.cancel = &s.flag;
        assert_ok(lg_context_create(&options, &context));
        lg_test_owns(context, release_context);
        o.progress = stop, o.user = &s;
        assert_ok(lg_policy_create(context, &task, machine_program(cart_pole), 1, &policy, NULL));
        lg_test_owns(policy, release_policy);
        assert_ok(lg_policy_trainer_create(policy, &o, &trainer, NULL));
        assert_int_equal(lg_policy_trainer_run(trainer, NULL, NULL), LG_CANCELLED);
        const lg_archive_writer writer = memory_writer(&archive);
        assert_ok(lg_policy_trainer_save(trainer, &writer, NULL));
        lg_policy_trainer_destroy(trainer);
        lg_policy *again = make(&task, cart_pole);
        o.progress = NULL;
        assert_ok(lg_policy_trainer_create(again, &o, &trainer, NULL));
        const lg_archive_reader reader = memory_reader(&archive);
        assert_ok(lg_policy_trainer_load(trainer, &reader, NULL));
        assert_ok(lg_policy_trainer_run(trainer, NULL, NULL));
        lg_policy_trainer_destroy(trainer);
        assert_memory_equal(trained_alone(NULL), again->theta, again->parameters * sizeof(double));
    }
}

TEST("a state of training is refused for another task or plant") {
    lg_policy_task task = cart_task();
    lg_policy_train_options o = short_training(1);
    lg_policy_trainer *trainer;
    memory_archive archive = {.count = 0};
    lg_error error;
    assert_ok(lg_policy_trainer_create(make(&task, cart_pole), &o, &trainer, NULL));
    const lg_archive_writer writer = memory_writer(&archive);
    assert_ok(lg_policy_trainer_save(trainer, &writer, NULL));
    lg_policy_trainer_destroy(trainer);
    const lg_archive_reader reader = memory_reader(&archive);
    for (int k = 0; k < 12; k++) {
        const lg_policy_task same = task;
        if (k == 1) task.coordinate[1].weight = 2.0;
        if (k == 3) task.gate = false;
        if (k == 4) task.coordinate[1].success *= 1.2;
        if (k == 5) task.within += 1.0;
        if (k == 7) task.delay = 0.1;
        if (k == 8) task.coordinate[0].noise = 0.1;
        if (k == 9) task.coordinate[1].noise_velocity = 0.1;
        if (k == 10) task.draws = 1;
        if (k == 11) task.spread = 0.1;
        o.lr = k == 6 ? 0.01 : 0.02;
        const char *plant =
            k != 2 ? cart_pole : test_text("%s%s", cart_pole, "damping: {kind: known, values: [0.2, 0]}\n");
        assert_ok(lg_policy_trainer_create(make(&task, plant), &o, &trainer, NULL));
        assert_int_equal(lg_policy_trainer_load(trainer, &reader, &error),
                         k == 0 ? LG_OK : LG_INVALID_ARGUMENT);
        if (k > 0) assert_non_null(strstr(error.message, "another task, plant or version of training"));
        lg_policy_trainer_destroy(trainer);
        task = same;
    }
}

/* ---- units ---- */

TEST("the regulator and the runs are the same in other units of mass, length and time") {
    static const char form[] = "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, "
                               "{name: th, kind: angle, velocity: w}]\n"
                               "inputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: %.17g, pole: "
                               "%.17g, length: %.17g, gravity: "
                               "%.17g}\ninput_map: {kind: known, values: [[1], [0]]}\n";
    static const double units[][3] = {{1, 1, 1}, {1e9, 1e-9, 1}, {1e-9, 1e9, 1e9}};
    lg_policy_outcome first = {.starts = 0};
    double far = 0.0;
    for (size_t k = 0; k < LG_COUNT(units); k++) {
        const double m = units[k][0], l = units[k][1], t = units[k][2];
        lg_policy_task task = cart_task();
        lg_policy_coordinate *x = &task.coordinate[0], *th = &task.coordinate[1];
        for (int i = 0; i < 2; i++)
            x->start[i] *= l, x->start_velocity[i] *= l / t, th->start_velocity[i] /= t;
        x->weight /= l * l, x->weight_velocity *= t * t / (l * l), th->weight_velocity *= t * t;
        const double force = m * l / (t * t);
        task.input[0].low *= force, task.input[0].high *= force, task.input[0].weight /= force * force;
        task.period *= t, task.horizon *= t, task.hold *= t, task.within *= t;
        lg_policy *policy = make(&task, test_text(form, m, 0.1 * m, l, 9.81 * l / (t * t)));
        const lg_policy_regulator *r = lg_policy_regulator_of(policy);
        lg_policy_outcome outcome;
        assert_ok(lg_policy_evaluate(policy, LG_POLICY_REGULATED, 64, 5, 1, &outcome, NULL, NULL));
        if (k == 0) first = outcome, far = r->P[5] / r->c;
        assert_close(r->P[5] / r->c, far, 1e-6, 0.0); /* of the angle: without a unit */
        assert_int_equal(outcome.succeeded, first.succeeded);
        assert_close(outcome.cost_median, t * first.cost_median, 1e-5, 0.0);
    }
}

/* ---- files ---- */

static const char task_text[] = "plant: cart.yaml\nperiod: 0.05\nhorizon: 2\nstarts: {x: [-0.5, 0.5], th: "
                                "[-3.14, 3.14], vx: [-0.5, 0.5], w: "
                                "[-0.5, 0.5]}\nlimits: {u: 10}\ncost: {x: 0.1, th: 1, vx: 0.1, w: 0.1, u: "
                                "0.002}\nsuccess: {th: 0.1, hold: 1, "
                                "within: 4}\ncontroller: {kind: network, hidden: [8]}\n";

TEST("a policy is saved and loaded with its bits, on its plant and on another one") {
    lg_policy_task task = cart_task(), read = cart_task();
    lg_policy *policy = make(&task, cart_pole), *loaded, *moved;
    lg_policy_outcome a, b, c;
    char *text;
    assert_ok(lg_policy_task_parse(NULL, "task", task_text, &read, NULL));
    assert_memory_equal(&task.coordinate, &read.coordinate, sizeof task.coordinate);
    assert_status(lg_policy_save(NULL, NULL, policy, task_text, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_save(NULL, "test_policy.h5", NULL, task_text, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_save(NULL, "test_policy.h5", policy, NULL, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_load(NULL, NULL, NULL, &loaded, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_load(NULL, "test_policy.h5", NULL, NULL, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_policy_save(NULL, "test_policy.h5", policy, test_text("%05000d", 0), NULL, NULL),
                  LG_FORMAT);
    assert_true(access("test_policy.h5", F_OK) != 0);
    assert_ok(lg_policy_save(NULL, "test_policy.h5", policy, task_text, NULL, NULL));
    assert_ok(lg_policy_load(NULL, "test_policy.h5", NULL, &loaded, &text, NULL));
    (void)unlink("test_policy.h5");
    lg_test_owns(loaded, release_policy);
    assert_string_equal(text, task_text);
    free(text);
    assert_memory_equal(&loaded->regulator, &policy->regulator, sizeof policy->regulator);
    assert_ok(lg_policy_evaluate(policy, LG_POLICY_NOMINAL, 70, 5, 1, &a, NULL, NULL));
    assert_ok(lg_policy_evaluate(loaded, LG_POLICY_NOMINAL, 70, 5, 2, &b, NULL, NULL));
    assert_memory_equal(&a, &b, sizeof a);
    assert_ok(lg_policy_transplant(loaded, machine_program(cart_pole), NULL, &moved, NULL));
    lg_test_owns(moved, release_policy);
    assert_ok(lg_policy_evaluate(moved, LG_POLICY_NOMINAL, 70, 5, 1, &c, NULL, NULL));
    assert_true(lg_policy_task_of(moved)->substeps > task.substeps); /* to judge, steps are shorter */
    assert_close(c.cost_median, a.cost_median, 1e-2, 0.0);
}

TEST("a task with a fault is refused with its line") {
    static const struct {
        const char *from, *to, *says;
    } faults[] = {
        {"limits: {u: 10}", "limits: {f: 10}",
         "line 5: limits: unknown name 'f'; the plant has x, th, vx, w, u"},
        {"limits: {u: 10}", "limits: {u: [3, -3]}", "line 5: limits: u: expected [low, high]"},
        {"limits: {u: 10}", "limits: {u: ten}", "expected a finite number"},
        {"x: 0.1, th: 1", "x: -1, th: 1", "line 6: cost: x: expected a weight"},
        {"th: 0.1, hold", "th: 0, hold", "line 7: success: th: expected a number above 0"},
        {"x: [-0.5, 0.5], th", "x: [0.5, -0.5], th", "line 4: starts: x: expected [low, high]"},
        {"x: [-0.5, 0.5], th", "th: 1, th", "'th' stands twice"},
        {"kind: network", "kind: neural", "neural"},
        {"limits: {u: 10}", "limits: {x: 10}", "line 5: limits: x: expected an input, not a coordinate"},
        {"limits: {u: 10}", "limits: {u: -10}", "line 5: limits: u: expected [low, high]"},
        {"limits: {u: 10}", "limits: {u: [1, 2, 3]}", "line 5: limits: u: expected [low, high]"},
        {"limits: {u: 10}", "limits: {}", "limits: input 'u' has no limits"},
        {"limits: {u: 10}", "limits: 10", "line 5: limits: expected {NAME: number, ...}"},
        {"limits: {u: 10}", "limits: {u: {low: 1}}", "line 5: limits: expected a finite number"},
        {"limits: {u: 10}", "limits: {[u]: 10}", "line 5: limits: unknown name ''"},
        {"limits: {u: 10}", "limits: {u: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13]}",
         "line 5: limits: more than 9 numbers"},
        {"x: [-0.5, 0.5], th", "u: 1, th", "line 4: starts: u: expected a coordinate, not an input"},
        {"x: [-0.5, 0.5], th", "x: [1, 2, 3], th", "line 4: starts: x: expected [low, high]"},
        {"x: [-0.5, 0.5], th", "x: [], th", "line 4: starts: x: expected [low, high]"},
        {"x: [-0.5, 0.5], th", "y: 1, th", "line 4: starts: unknown name 'y'"},
        {"x: 0.1, th: 1", "y: 1, th: 1", "line 6: cost: unknown name 'y'"},
        {"x: 0.1, th: 1", "x: [1, 2], th: 1", "line 6: cost: x: expected a weight"},
        {"th: 0.1, hold", "u: 0.1, hold", "line 7: success: u: expected a coordinate, not an input"},
        {"th: 0.1, hold", "y: 0.1, hold", "line 7: success: unknown name 'y'"},
        {"th: 0.1, hold", "th: [1, 2], hold", "line 7: success: th: expected a number above 0"},
        {"controller:", "goal: {y: 1}\ncontroller:", "line 8: goal: unknown name 'y'"},
        {"controller:", "goal: {u: 1}\ncontroller:", "line 8: goal: u: expected a coordinate, not an input"},
        {"controller:", "goal: {vx: 1}\ncontroller:", "line 8: goal: vx: expected 0, for the goal is"},
        {"controller:", "goal: {w: [0, 0]}\ncontroller:", "line 8: goal: w: expected 0, for the goal is"},
        {"controller:", "goal: {x: [1, 2]}\ncontroller:", "line 8: goal: x: expected a number"},
        {"controller:", "robust: {noise: {u: 1}}\ncontroller:", "noise: u: expected a coordinate, not"},
        {"controller:", "robust: {noise: {y: 1}}\ncontroller:", "noise: unknown name 'y'"},
        {"controller:", "robust: {noise: {x: -1}}\ncontroller:", "noise: x: expected a standard deviation"},
        {"controller:", "robust: {noise: {x: [1, 2]}}\ncontroller:", "x: expected a standard deviation"},
        {"controller:", "track: x\ncontroller:", "line 8: track: expected a list of positions"},
        {"controller:", "track: [y]\ncontroller:", "line 8: track: unknown name 'y'"},
        {"controller:", "track: [[x]]\ncontroller:", "line 8: track: unknown name ''"},
        {"controller:", "track: [u]\ncontroller:", "line 8: track: expected a position, not 'u'"},
        {"controller:", "track: [vx]\ncontroller:", "line 8: track: expected a position, not 'vx'"},
    };
    for (size_t i = 0; i < LG_COUNT(faults); i++) {
        const char *at = strstr(task_text, faults[i].from);
        lg_policy_task task = cart_task();
        task.input[0].low = task.input[0].high = 0.0;
        lg_error error = {LG_OK, ""};
        char *text = test_text("%.*s%s%s", (int)(at - task_text), task_text, faults[i].to,
                               at + strlen(faults[i].from));
        if (lg_policy_task_parse(NULL, "task", text, &task, &error) != LG_FORMAT)
            fail_msg("not refused: %s", faults[i].to);
        assert_says(error.message, faults[i].says);
    }
}

TEST("a message names the plant's coordinates as far as there is room") {
    lg_policy_task task = cart_task();
    lg_error error;
    for (uint32_t i = 0; i < LG_POLICY_COORDINATES; i++) {
        task.coordinate[i] = coordinate(test_text("%060u", i), "v", LG_POLICY_LINE, 1.0);
        task.coordinate_count = i + 1;
        assert_status(lg_policy_task_parse(NULL, "task", task_text, &task, &error), LG_FORMAT);
        assert_says(error.message, "unknown name 'x'; the plant has 000000");
    }
}

static lg_policy_task every_motion_and_a_lag(void) {
    lg_policy_task task = every_motion();
    task.input_count = 1;
    task.input[0] = (lg_policy_input){"u", 0, 0, 0};
    task.coordinate[task.coordinate_count++] =
        (lg_policy_coordinate){.name = "lag", .motion = LG_POLICY_LINE, .follows = 1};
    return task;
}

TEST("goals of directions are unit vectors, goals of rotations are unit quaternions; a lagged input has no "
     "goal") {
    static const char form[] = "plant: p\nperiod: 1\nhorizon: 2\n%s: {%s}\nstarts: {vd: 1}\nlimits: {u: 1}\n"
                               "cost: {x: 1}\n%s";
    static const char usual[] = "success: {x: 1}\n";
    static const struct {
        const char *key, *value, *says;
    } rows[] = {{"goal", "d: [1, 0]", "d: expected a unit vector"},
                {"goal", "d: [1, 1, 1]", "d: expected a unit vector"},
                {"goal", "R: [1, 0, 0]", "R: expected a unit quaternion"},
                {"goal", "R: [1, 1, 0, 0]", "R: expected a unit quaternion"},
                {"goal", "lag: 1", "lag: expected a coordinate of the machine"},
                {"success", "lag: 1", "lag: expected a coordinate of the machine"},
                {"robust", "noise: {lag: 1}", "lag: expected a coordinate of the machine"},
                {"goal", "nothing: 1", "the plant has x, a, d, R, lag, vx, va, vd, vR, u"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_policy_task task = every_motion_and_a_lag();
        lg_error error = {LG_OK, ""};
        const bool success = strcmp(rows[i].key, "success") == 0;
        const char *text = test_text(form, rows[i].key, rows[i].value, success ? "" : usual);
        assert_status(lg_policy_task_parse(NULL, "task", text, &task, &error), LG_FORMAT);
        assert_says(error.message, rows[i].says);
    }
    lg_policy_task task = every_motion_and_a_lag();
    assert_told(lg_policy_task_parse(
        NULL, "task", test_text(form, "goal", "d: [0, 0.6, 0.8], R: [0, 1, 0, 0], a: 1, vx: 0", usual), &task,
        &told));
    static const double direction[3] = {0, 0.6, 0.8}, turned[9] = {1, 0, 0, 0, -1, 0, 0, 0, -1};
    assert_all_close(task.coordinate[2].goal, direction, 3, 1e-15, 1e-15);
    assert_all_close(task.coordinate[3].goal, turned, 9, 1e-15, 1e-15);
    assert_true(task.coordinate[1].goal[0] == 1.0 && task.coordinate[0].goal[0] == 0.0);
    task = every_motion_and_a_lag(); /* the usual goals; a sensor of a velocity */
    assert_told(lg_policy_task_parse(NULL, "task", test_text(form, "robust", "noise: {vx: 0.25}", usual),
                                     &task, &told));
    assert_true(task.coordinate[2].goal[2] == 1.0 && task.coordinate[3].goal[0] == 1.0);
    assert_true(task.coordinate[0].noise_velocity == 0.25 && task.coordinate[0].noise == 0.0);
}

TEST("states of a program are read with their kinds, and their names are checked") {
    static const struct {
        const char *states, *says;
    } rows[] = {
        {"3", "states: expected a list"},
        {"['']", "states: a name has 1 to"},
        {"[a_name_of_more_than_sixty_three_letters_which_is_longer_than_any_name_of_a_coordinate]",
         "states: a name has 1 to"},
        {"[a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, s, t, u, v, w, x, y, z, A, B, C, D, E, "
         "F, G, H, I, J, K, L, M, N, O, P, Q, R, S, T, U, V, W, X, Y, Z, a1, b1, c1, d1, e1, f1, g1, h1]",
         "states: more than"},
        {"[a, {name: b, kind: angle}, {name: c, kind: line}]", NULL}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_policy_task task;
        lg_error error = {LG_OK, ""};
        char plant[64], *text = NULL;
        FILE *file = fopen("test_task.yaml", "w");
        assert_non_null(file);
        (void)fprintf(file,
                      "plant: p.h5\nstates: %s\nperiod: 1\nhorizon: 1\nstarts: {}\nlimits: {}\ncost: {}\n"
                      "success: {}\n",
                      rows[i].states);
        (void)fclose(file);
        const lg_status status =
            lg_policy_task_read(NULL, "test_task.yaml", &task, plant, sizeof plant, &text, &error);
        (void)unlink("test_task.yaml");
        assert_int_equal(status, rows[i].says != NULL ? LG_FORMAT : LG_OK);
        if (rows[i].says != NULL) {
            assert_says(error.message, rows[i].says);
            continue;
        }
        lg_free(NULL, text);
        assert_string_equal(plant, "p.h5");
        assert_true(task.coordinate_count == 3 && task.coordinate[0].motion == LG_POLICY_LINE);
        assert_true(task.coordinate[1].motion == LG_POLICY_ANGLE &&
                    task.coordinate[2].motion == LG_POLICY_LINE);
    }
}

/* ---- tasks, plants and options that are refused ---- */

static lg_status copy_of(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)tape, (void)theta;
    y[0] = x[0];
    return LG_OK;
}

static lg_program *no_plant(void) {
    static const lg_port in = {.name = "x", .shape = {1, {2, 0, 0, 0}}}, out = {.name = "y"};
    static const lg_function_spec function = {"copy", &in, 1, &out, 1, copy_of, NULL};
    lg_program_spec spec;
    lg_program *program;
    lg_program_spec_init(&spec);
    spec.functions = &function, spec.function_count = 1;
    assert_ok(lg_program_build(NULL, &spec, &program, NULL));
    return program;
}

TEST("a task with a number out of range is refused by name") {
    const lg_policy_coordinate turning = coordinate("R", "w", LG_POLICY_ROTATION, 1.0);
    lg_policy *policy;
    lg_error error;
#define REFUSED(word, ...)                                                                                   \
    do {                                                                                                     \
        lg_policy_task t = cart_task();                                                                      \
        lg_policy_coordinate *x = &t.coordinate[0];                                                          \
        (void)x;                                                                                             \
        __VA_ARGS__;                                                                                         \
        assert_status(lg_policy_create(NULL, &t, no_plant(), 1, &policy, &error), LG_INVALID_ARGUMENT);      \
        assert_says(error.message, word);                                                                    \
    } while (0)
    REFUSED("sizes", t.size = 3);
    REFUSED("sizes", t.coordinate_count = 0);
    REFUSED("sizes", t.coordinate_count = LG_POLICY_COORDINATES + 1);
    REFUSED("sizes", t.input_count = 0);
    REFUSED("sizes", t.input_count = LG_POLICY_INPUTS + 1);
    REFUSED("sizes", t.kind = LG_POLICY_KIND_COUNT);
    REFUSED("sizes", t.hidden_layers = LG_POLICY_HIDDEN + 1);
    REFUSED("x: unknown kind", x->motion = (lg_policy_motion)99);
    REFUSED("x: starts", x->start[0] = 2);
    REFUSED("x: starts", x->start[1] = INFINITY);
    REFUSED("x: starts", x->start[0] = -INFINITY);
    REFUSED("x: starts", x->start_velocity[0] = 2);
    REFUSED("x: starts", x->start_velocity[0] = -INFINITY);
    REFUSED("x: starts", x->start_velocity[1] = INFINITY);
    REFUSED("x: weights", x->weight = -1);
    REFUSED("x: weights", x->weight = INFINITY);
    REFUSED("x: weights", x->weight_velocity = -1);
    REFUSED("x: weights", x->weight_velocity = INFINITY);
    REFUSED("x is a lagged input", x->follows = 1);
    REFUSED("x is a lagged input", (x->follows = 1, x->motion = LG_POLICY_ANGLE, x->velocity[0] = '\0'));
    REFUSED("x is a lagged input", (x->follows = 1, x->velocity[0] = '\0', x->track = true));
    REFUSED("x is a lagged input", (x->follows = 1, x->velocity[0] = '\0', x->free = true));
    REFUSED("the position of x is no error", (x->free = true, x->weight = 0, x->track = true));
    REFUSED("the position of x is no error", (x->free = true, x->weight = 0, x->goal[0] = 1));
    REFUSED("the position of x is no error", (x->free = true, x->weight = 1));
    REFUSED("the position of x is no error", (x->free = true, x->weight = 0, x->noise = 1));
    REFUSED("x: noise", x->noise = -1);
    REFUSED("x: noise", x->noise_velocity = -1);
    REFUSED("x: noise", x->noise = INFINITY);
    REFUSED("x: noise", x->noise_velocity = INFINITY);
    REFUSED("x: bounds of success", x->success = 0);
    REFUSED("x: bounds of success", x->success_velocity = NAN);
    REFUSED("u: limits", t.input[0].low = 20);
    REFUSED("u: limits", t.input[0].low = -INFINITY);
    REFUSED("u: limits", t.input[0].high = INFINITY);
    REFUSED("u: its weight", t.input[0].weight = 0);
    REFUSED("u: its weight", t.input[0].weight = INFINITY);
    REFUSED("gains are two positive", (t.kind = LG_POLICY_ENERGY, t.gain_count = 2, t.gains[0] = -1));
    REFUSED("gains are two positive", (t.kind = LG_POLICY_ENERGY, t.gain_count = 3));
    REFUSED("gains are two positive", (t.kind = LG_POLICY_LQR, t.gain_count = 4, t.gains[3] = NAN));
    REFUSED("the gate of a network", (t.kind = LG_POLICY_NETWORK, t.search = false));
    REFUSED("delay from 0 to 1", t.delay = -1);
    REFUSED("delay from 0 to 1", t.delay = 1.5);
    REFUSED("delay from 0 to 1", t.spread = -1);
    REFUSED("delay from 0 to 1", t.spread = INFINITY);
    REFUSED("weighs no coordinate", for (int i = 0; i < 2; i++) t.coordinate[i].weight = 0,
            t.coordinate[i].weight_velocity = 0);
    REFUSED("bounds no coordinate", t.coordinate[1].success = INFINITY);
    REFUSED("times need", t.period = 0);
    REFUSED("times need", t.horizon = 0.5 * t.period);
    REFUSED("times need", t.horizon = INFINITY);
    REFUSED("times need", t.hold = -1);
    REFUSED("times need", t.within = 0.5 * t.hold);
    REFUSED("times need", t.within = INFINITY);
    REFUSED("times need", (t.hold = 0, t.within = 0.5 * t.period));
    REFUSED("hidden layers", (t.hidden_layers = 1, t.hidden[0] = 0));
    REFUSED("54 errors; a policy needs 1 to", for (int i = 0; i < 9; i++) t.coordinate[i] = turning;
            t.coordinate_count = 9);
    REFUSED("a dead time of -1", t.dead_time[0] = -1);
    REFUSED("a dead time of inf", t.dead_time[0] = INFINITY);
    REFUSED("integral: x has no error", (x->free = true, x->weight = 0, x->integral = true));
    REFUSED("kind energy has no integrals", (t.kind = LG_POLICY_ENERGY, x->integral = true));
#undef REFUSED
    lg_policy_task task = cart_task();
    assert_status(lg_policy_create(NULL, &task, no_plant(), 1, &policy, &error), LG_NOT_FOUND);
    assert_says(error.message, "no function step");
    assert_status(lg_policy_create(NULL, &task, machine_program(body), 1, &policy, &error), LG_SHAPE);
    assert_says(error.message, "the plant's function step has");
}

TEST("training options, tasks and draws that do not fit a policy are refused") {
    lg_policy_task task = cart_task(), wrong = cart_task();
    task.kind = LG_POLICY_LQR;
    lg_policy *policy = make(&task, cart_pole);
    lg_policy_trainer *trainer = NULL;
    lg_policy_train_options good;
    lg_error error;
    lg_policy_train_options_init(&good);
    lg_policy_train_options bad[7] = {good, good, good, good, good, good, good};
    bad[0].size = 3, bad[1].seeds = 0, bad[2].seeds = 1001, bad[3].starts = 0, bad[4].starts = 17;
    bad[5].lr = 0, bad[6].seconds = -1;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_status(lg_policy_trainer_create(policy, &bad[i], &trainer, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "training needs 1 to 1000 seeds");
        assert_null(trainer);
    }
    wrong.coordinate_count = 1;
    assert_status(lg_policy_disturb(policy, &wrong, &error), LG_SHAPE);
    wrong = task, wrong.delay = 2;
    assert_status(lg_policy_disturb(policy, &wrong, &error), LG_INVALID_ARGUMENT);
    assert_ok(lg_policy_disturb(policy, &task, &error)); /* no disturbance: nothing changes */
    assert_status(lg_policy_add_draw(policy, machine_program(cart_pole), &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "no disturbances");
    assert_status(lg_policy_add_draw(policy, NULL, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "NULL");
    wrong = task, wrong.delay = 0.5;
    for (int i = 0; i < 2; i++) assert_ok(lg_policy_disturb(policy, &wrong, &error));
    assert_status(lg_policy_add_draw(policy, machine_program(body), &error), LG_SHAPE);
}

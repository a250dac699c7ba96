/* Machines and tasks of tests of policies. */
#ifndef TESTS_SUPPORT_POLICIES_H
#define TESTS_SUPPORT_POLICIES_H

#include "control/policy_rollout.h"
#include "liegrad/machine.h"
#include "support/fixtures.h"
#include "test_support.h"

RELEASES(release_policy, lg_policy_destroy)

static const char cart_pole[] =
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: angle, "
    "velocity: w}]\n"
    "inputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: 1, pole: 0.1, length: 1, gravity: 9.81}\n"
    "input_map: {kind: known, values: [[1], [0]]}\n";
static const char body[] = "columns: {time: t}\ncoordinates: [{name: R, kind: rotation, columns: [qw, qx, "
                           "qy, qz], velocity: [wx, wy, wz]}]\n"
                           "inputs: {columns: [a, b, c]}\nmass: {kind: known, values: [1, 2, 3]}\n"
                           "input_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n";

static inline lg_program *machine_program(const char *text) {
    lg_machine_file file;
    lg_program *program;
    lg_error error = {LG_OK, ""};
    if (lg_machine_file_parse(NULL, "machine", text, strlen(text), &file, &error) != LG_OK)
        fail_msg("%s", error.message);
    assert_ok(lg_machine_program(NULL, &file.machine, NULL, lg_scheme_find("rkmk4"), true, &program, NULL));
    lg_machine_file_destroy(&file);
    return program;
}

static inline lg_policy_coordinate coordinate(const char *name, const char *velocity, lg_policy_motion motion,
                                              double far) {
    lg_policy_coordinate c = {.motion = motion,
                              .start = {-far, far},
                              .start_velocity = {-0.5, 0.5},
                              .weight = 1.0,
                              .weight_velocity = 0.1,
                              .success = 0.1,
                              .success_velocity = INFINITY};
    (void)snprintf(c.name, sizeof c.name, "%s", name);
    (void)snprintf(c.velocity, sizeof c.velocity, "%s", velocity);
    if (motion == LG_POLICY_ROTATION) c.goal[0] = c.goal[4] = c.goal[8] = 1.0;
    if (motion == LG_POLICY_DIRECTION) c.goal[2] = 1.0;
    return c;
}

static inline lg_policy_task cart_task(void) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.coordinate_count = 2, task.input_count = 1;
    task.coordinate[0] = coordinate("x", "vx", LG_POLICY_LINE, 0.5);
    task.coordinate[0].weight = 0.1, task.coordinate[0].success = INFINITY;
    task.coordinate[1] = coordinate("th", "w", LG_POLICY_ANGLE, 3.14);
    task.input[0] = (lg_policy_input){"u", -10.0, 10.0, 0.002};
    task.hidden_layers = 1, task.hidden[0] = 8;
    task.horizon = 2.0, task.within = 4.0;
    return task;
}

static inline lg_policy_task body_task(lg_policy_kind kind) {
    lg_policy_task task;
    lg_policy_task_init(&task);
    task.kind = kind;
    task.coordinate_count = 1, task.input_count = 3;
    task.coordinate[0] = coordinate("R", "vR", LG_POLICY_ROTATION, 3.1);
    for (int l = 0; l < 3; l++) task.input[l] = (lg_policy_input){{(char)('a' + l)}, -2.0, 2.0, 0.01};
    task.hidden_layers = 1, task.hidden[0] = 8;
    return task;
}

static inline lg_policy *make(const lg_policy_task *task, const char *machine) {
    lg_policy *policy;
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_policy_create(NULL, task, machine_program(machine), 1, &policy, &error);
    if (status != LG_OK) fail_msg("%s", error.message);
    lg_test_owns(policy, release_policy);
    return policy;
}

/* The cost of 10 periods of runs of the policy from `pieces` pieces of starts x, piece after piece from the
 * number `first` on, as training takes it, and its gradient. */
typedef struct rolled {
    const lg_policy *policy;
    const double *x;
    size_t pieces, steps;
    uint64_t first, seed;
    double cut, bound;
} rolled;
static inline rolled roll(const lg_policy *policy, const double *x, size_t pieces) {
    return (rolled){policy, x, pieces, 10, 0, 1, INFINITY, INFINITY};
}
static inline double rolled_cost(const rolled *of, double *gradient) {
    static const char *const names[2][LG_POLICY_PLANS] = {
        {"closed", "terminal", "adj1_closed", "adj1_terminal"},
        {"disturbed", "disturbed_end", "adj1_disturbed", "adj1_disturbed_end"}};
    const lg_policy *p = of->policy;
    const bool disturbed = lg_policy_is_disturbed(&p->task);
    lg_policy_rollout r = {.policy = p, .dtype = LG_F64, .rows = LG_POLICY_ROWS, .most = 20};
    lg_policy_piece w = {0};
    double cost = 0;
    assert_ok(lg_policy_rollout_create(&r, names[disturbed], LG_POLICY_PLANS, NULL));
    char *memory = lg_test_memory(r.bytes);
    memset(gradient, 0, p->parameters * sizeof *gradient);
    for (size_t k = 0; k < of->pieces; k++) {
        lg_policy_piece_at(&r, memory, of->first + k, &w);
        w.steps = of->steps;
        lg_policy_begin_runs(&r, of->x + k * LG_POLICY_ROWS * p->state, LG_POLICY_ROWS, of->seed,
                             of->first + k, &w);
        lg_put_numbers(LG_F64, w.given[0], 0, p->theta, p->parameters);
        cost += lg_policy_gradient(&r, &w, of->cut, of->bound, gradient) / (double)of->pieces;
    }
    for (size_t i = 0; i < p->parameters; i++) gradient[i] /= (double)of->pieces;
    lg_policy_plans_destroy(&r.plans);
    return cost;
}
/* Compares derivatives with differences. */
static inline void check_rolled(const rolled *of) {
    const size_t n = of->policy->parameters;
    double *g = TEST_ARRAY(double, n), *other = TEST_ARRAY(double, n), *theta = of->policy->theta;
    const double cost = rolled_cost(of, g);
    for (size_t i = 0; i < n; i += 1 + n / 9) {
        static const double h = 1e-5;
        const double kept = theta[i];
        theta[i] = kept + h;
        const double up = rolled_cost(of, other);
        theta[i] = kept - h;
        const double down = rolled_cost(of, other);
        theta[i] = kept;
        assert_close(g[i], (up - down) / (2.0 * h), 1e-5, 1e-7 * fabs(cost));
    }
}

#endif

/* Machines and tasks of tests of policies. */
#ifndef TESTS_SUPPORT_POLICIES_H
#define TESTS_SUPPORT_POLICIES_H

#include "control/policy.h"
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

#endif

/* Programs: building, what is refused, application on a tape, plans. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "liegrad/nn.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "test_support.h"

/* ---- a network with an input gradient ---- */

typedef struct network {
    lg_mlp net;
    double *theta;
} network;

static void make_network(network *n, uint32_t inputs, uint32_t width, uint32_t outputs, lg_activation kind) {
    const uint32_t hidden[2] = {width, width};
    lg_rng rng;
    lg_rng_seed(&rng, 3, 1);
    assert_int_equal(lg_mlp_init(&n->net, inputs, hidden, 2, outputs, kind, true), LG_OK);
    n->theta = malloc(lg_mlp_parameters(&n->net) * sizeof(double));
    lg_mlp_initialise(&n->net, &rng, n->theta);
}

static lg_status record_value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = lg_mlp_apply(tape, user, theta[0], 0, x[0]);
    return lg_tape_status(tape);
}

static lg_status record_gradient(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = lg_mlp_apply(tape, user, theta[0], 0, x[0]);
    return lg_grad(tape, y[0], x, 1, &y[1]);
}

static lg_status record_loss(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = lg_mean(tape, lg_square(tape, lg_mlp_apply(tape, user, theta[0], 0, x[0])));
    return lg_tape_status(tape);
}

static const lg_port x3 = {.name = "x", .shape = {1, {3, 0, 0, 0}}};
static const lg_port value_ports[2] = {{.name = "y"}, {.name = "g"}};

static lg_program *build_network(network *n) {
    const lg_parameter_spec theta = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta};
    const lg_function_spec functions[] = {
        {"value", &x3, 1, value_ports, 1, record_value, &n->net},
        {"gradient", &x3, 1, value_ports, 2, record_gradient, &n->net},
        {"loss", &x3, 1, value_ports, 1, record_loss, &n->net},
    };
    lg_program_spec spec;
    lg_program *program = NULL;
    lg_error error;
    lg_program_spec_init(&spec);
    spec.parameters = &theta;
    spec.parameter_count = 1;
    spec.functions = functions;
    spec.function_count = sizeof functions / sizeof *functions;
    if (lg_program_build(NULL, &spec, &program, &error) != LG_OK) fail_msg("%s", error.message);
    return program;
}

/* Function of the program on a tape, and the recording itself, with `rows` rows: to the last bit. */
static void compare_apply(lg_program *program, size_t function, network *n, lg_program_record record,
                          size_t outputs, size_t rows) {
    lg_tape *tape;
    lg_rng rng;
    lg_rng_seed(&rng, 4, rows);
    assert_int_equal(lg_tape_create(NULL, NULL, &tape), LG_OK);
    double *x = malloc(3 * rows * sizeof *x);
    for (size_t i = 0; i < 3 * rows; i++) x[i] = lg_rng_normal(&rng);
    lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta);
    lg_var in = lg_input(tape, lg_shape2((uint32_t)rows, 3), x), want[2], got[2];
    assert_int_equal(record(&n->net, tape, &theta, &in, want), LG_OK);
    assert_int_equal(lg_program_apply(tape, program, function, &theta, &in, got), LG_OK);
    for (size_t j = 0; j < outputs; j++) {
        const size_t count = lg_shape_count(lg_var_shape(tape, want[j]));
        assert_int_equal(lg_shape_count(lg_var_shape(tape, got[j])), count);
        assert_memory_equal(lg_value(tape, want[j]), lg_value(tape, got[j]), count * sizeof(double));
    }
    free(x);
    lg_tape_destroy(tape);
}

static void applied_equals_recorded(void **state) {
    (void)state;
    network n;
    make_network(&n, 3, 16, 1, LG_TANH);
    lg_program *program = build_network(&n);
    for (size_t rows = 1; rows <= 4; rows++) {
        compare_apply(program, 0, &n, record_value, 1, rows);
        compare_apply(program, 1, &n, record_gradient, 2, rows);
        compare_apply(program, 2, &n, record_loss, 1, rows);
    }
    lg_program_destroy(program);
    free(n.theta);
}

/* ---- plans ---- */

static void close_to(const double *got, const double *want, size_t count, double tolerance) {
    for (size_t i = 0; i < count; i++) assert_close(got[i], want[i], tolerance, tolerance);
}

static void compare_plan(lg_program *program, size_t function, network *n, lg_program_record record,
                         size_t outputs, size_t rows) {
    lg_tape *tape;
    lg_plan *plan;
    lg_rng rng;
    lg_error error;
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.rows = rows;
    lg_rng_seed(&rng, 5, rows);
    assert_int_equal(lg_tape_create(NULL, NULL, &tape), LG_OK);
    if (lg_plan_create(program, function, &options, &plan, &error) != LG_OK) fail_msg("%s", error.message);
    double *x = malloc(3 * rows * sizeof *x);
    for (size_t i = 0; i < 3 * rows; i++) x[i] = lg_rng_normal(&rng);
    lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta);
    lg_var in = lg_input(tape, lg_shape2((uint32_t)rows, 3), x), want[2];
    assert_int_equal(record(&n->net, tape, &theta, &in, want), LG_OK);
    void *work = aligned_alloc(64, lg_plan_work_size(plan)), *out[2] = {NULL, NULL};
    memset(work, 0xff, lg_plan_work_size(plan));
    for (size_t j = 0; j < outputs; j++) out[j] = malloc(lg_plan_output_count(plan, j) * sizeof(double));
    lg_plan_run(plan, (const void *const[]){x}, out, work);
    for (size_t j = 0; j < outputs; j++) {
        const size_t count = lg_plan_output_count(plan, j);
        assert_int_equal(count, lg_shape_count(lg_var_shape(tape, want[j])));
        close_to(out[j], lg_value(tape, want[j]), count, 1e-14);
        free(out[j]);
    }
    free(work);
    free(x);
    lg_plan_destroy(plan);
    lg_tape_destroy(tape);
}

static void plans_equal_recorded(void **state) {
    (void)state;
    const lg_activation kinds[] = {LG_TANH, LG_SIGMOID, LG_SWISH, LG_RELU, LG_LEAKY_RELU, LG_SINE, LG_IDENTITY};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
        for (uint32_t width = 2; width <= 20; width += 6) {
            network n;
            make_network(&n, 3, width, 1, kinds[k]);
            lg_program *program = build_network(&n);
            for (size_t rows = 1; rows <= 40; rows += 13) {
                compare_plan(program, 0, &n, record_value, 1, rows);
                compare_plan(program, 1, &n, record_gradient, 2, rows);
                compare_plan(program, 2, &n, record_loss, 1, rows);
            }
            lg_program_destroy(program);
            free(n.theta);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(applied_equals_recorded),
        cmocka_unit_test(plans_equal_recorded),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* A C program outside the tree that uses the library: a network on a tape, its input gradient, and the
 * parameter gradient of the squared norm of the input gradient; also a program of the network and its
 * plan. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <liegrad/networks.h>
#include <liegrad/ops.h>
#include <liegrad/program.h>

enum { HIDDEN = 8, ROWS = 2 };

static int close_to(double a, double b) {
    return fabs(a - b) <= 1e-12 * (1.0 + fabs(b));
}

/* Records V (rows, 1) and dV/dx (rows, 3). */
static lg_status record(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *out) {
    lg_mlp_vars vars;
    out[0] = lg_mlp_record(tape, user, theta[0], 0, x[0]);
    lg_mlp_bind(tape, user, theta[0], 0, &vars);
    out[1] = lg_mlp_record_gradient(tape, user, &vars, x[0]);
    return lg_tape_status(tape);
}

/* The same by a plan: without a tape, and without allocation in the call that evaluates. */
static lg_status run(const lg_context *context, lg_mlp *net, const double *theta, const double *x, double *y,
                     double *dx) {
    const lg_port input = {.name = "x", .shape = lg_shape1(3)}, outputs[2] = {{.name = "V"}, {.name = "g"}};
    const lg_function_spec function = {"value", &input, 1, outputs, 2, record, net};
    const lg_parameter_spec parameter = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(net)), theta};
    lg_program_spec spec;
    lg_plan_options options;
    lg_program *program = NULL;
    lg_plan *plan = NULL;
    lg_program_spec_init(&spec);
    spec.parameters = &parameter;
    spec.parameter_count = 1;
    spec.functions = &function;
    spec.function_count = 1;
    lg_plan_options_init(&options);
    options.rows = ROWS;
    lg_status status = lg_program_build(context, &spec, &program, NULL);
    if (status == LG_OK) status = lg_plan_create(program, 0, &options, &plan, NULL);
    void *work = status == LG_OK ? malloc(lg_plan_work_size(plan) + 64) : NULL;
    if (work != NULL) {
        const void *const in[1] = {x};
        void *const out[2] = {y, dx};
        lg_plan_eval(plan, in, out, (void *)(((size_t)work + 63) & ~(size_t)63));
    } else if (status == LG_OK) {
        status = LG_OUT_OF_MEMORY;
    }
    free(work);
    lg_plan_destroy(plan);
    lg_program_destroy(program);
    return status;
}

/* Returns 0 if value and input gradient agree between tape and plan and the last pass gives a finite
 * gradient. */
static int use(const lg_context *context) {
    const uint32_t hidden[1] = {HIDDEN};
    const double x[ROWS * 3] = {0.1, -0.4, 0.9, 0.3, 0.2, -0.7};
    lg_mlp net;
    lg_rng rng;
    if (lg_mlp_init(&net, 3, hidden, 1, 1, LG_TANH, false) != LG_OK) return 1;
    const size_t n = lg_mlp_parameters(&net);
    double params[3 * HIDDEN + HIDDEN + HIDDEN], grad[3 * HIDDEN + HIDDEN + HIDDEN] = {0.0};
    double y[ROWS], dx[ROWS * 3], taped[ROWS * 3], norm = 0.0;
    if (n != sizeof params / sizeof *params) return 2;
    lg_rng_seed(&rng, 1, 0);
    lg_mlp_initialise(&net, &rng, params);

    lg_tape *tape = NULL;
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return 3;
    lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)n), params);
    lg_var q = lg_input(tape, lg_shape2(ROWS, 3), x);
    lg_var V = lg_mlp_record(tape, &net, theta, 0, q), g = LG_NONE;
    lg_grad(tape, lg_sum(tape, V), &q, 1, &g);
    lg_var loss = lg_sum(tape, lg_square(tape, g));
    void *out = grad;
    int failed =
        lg_backward(tape, loss, &theta, 1, &out) != LG_OK || lg_read(tape, g, ROWS * 3, taped) != LG_OK;
    lg_tape_destroy(tape);

    if (run(context, &net, params, x, y, dx) != LG_OK) return 4;
    for (int i = 0; i < ROWS * 3; i++) failed |= !close_to(dx[i], taped[i]);
    for (size_t i = 0; i < n; i++) norm += grad[i] * grad[i];
    return failed || !(norm > 0.0 && norm < 1e6) ? 5 : 0;
}

int main(void) {
    lg_context *context = NULL;
    lg_status status = lg_context_create(NULL, &context);
    const int failed = use(context);
    printf("C: liegrad %s, %s, %d\n", lg_version(), lg_status_name(status), failed);
    lg_context_destroy(context);
    return status == LG_OK && failed == 0 && strcmp(lg_status_name(LG_SHAPE), "SHAPE") == 0 ? 0 : 1;
}

/* Programs for the tests of program files: a network with a loss and a loop, and every operation registered
 * with lg-gradcheck, with its derivative. */
#ifndef LG_PROGRAM_ZOO_H
#define LG_PROGRAM_ZOO_H

#include "support/io_test.h"
#include "liegrad/gradcheck.h"
#include "liegrad/networks.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"

/* ---- a network with a loss and a loop ---- */

static inline lg_status zoo_value(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x,
                                  lg_var *y) {
    y[0] = lg_mlp_record(tape, user, theta[1], 0, x[0]);
    return lg_tape_status(tape);
}

static inline lg_status zoo_loss(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_var out = lg_mlp_record(tape, user, theta[1], 0, x[0]);
    y[0] = lg_mse(tape, out, x[1]);
    return lg_grad(tape, y[0], x, 1, &y[1]);
}

static inline lg_status zoo_step(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_var field = lg_mlp_record(tape, user, theta[1], 0, x[0]);
    y[0] = lg_add(tape, x[0], lg_mul(tape, x[1], lg_mul(tape, field, theta[0])));
    return lg_tape_status(tape);
}

#define ZOO_DESCRIPTION "A network, its loss and ten steps; \xc2\xb5m and */ may stand here."

static inline lg_program *zoo_network(void) {
    static const uint32_t hidden[2] = {7, 5};
    static const lg_port in[2] = {
        {.name = "x", .shape = {1, {3, 0, 0, 0}}, .unit = "rad/s", .low = -2.0, .high = 0.1},
        {.name = "wanted", .shape = {1, {3, 0, 0, 0}}}};
    static const lg_port stepping[2] = {{.name = "x", .shape = {1, {3, 0, 0, 0}}},
                                        {.name = "h", .shared = true, .unit = "s"}};
    static const lg_port value[1] = {{.name = "y",
                                      .unit = "\xc2\xb0"
                                              "C"}};
    static const lg_port loss[2] = {{.name = "loss"}, {.name = "gradient"}};
    static const lg_port next[1] = {{.name = "next"}};
    static const lg_carry carry = {"next", "x"};
    lg_mlp net;
    lg_program *program = NULL;
    lg_program_spec spec;
    lg_rng rng = test_rng(11, 12);
    assert_ok(lg_mlp_init(&net, 3, hidden, 2, 3, LG_TANH, true));
    double *theta = TEST_ARRAY(double, lg_mlp_parameters(&net));
    const double scale = 1.0 / 3.0;
    lg_mlp_initialise(&net, &rng, theta);
    const lg_parameter_spec parameters[] = {
        {"scale", {0, {0, 0, 0, 0}}, &scale},
        {"theta", {1, {(uint32_t)lg_mlp_parameters(&net), 0, 0, 0}}, theta},
    };
    const lg_function_spec functions[] = {
        {"value", in, 1, value, 1, zoo_value, &net},
        {"loss", in, 2, loss, 2, zoo_loss, &net},
        {"step", stepping, 2, next, 1, zoo_step, &net},
    };
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = LG_COUNT(parameters);
    spec.functions = functions;
    spec.function_count = LG_COUNT(functions);
    spec.description = ZOO_DESCRIPTION;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    const char *const path = carry.output;
    const lg_loop_spec loop = {sizeof loop, "ten_steps", "step", 10, &carry, 1, &path, 1};
    assert_told(lg_program_add_loop(program, &loop, &told));
    return program;
}

/* ---- every operation ---- */

/* The value and, if it has one, the gradient of the sum of its squares: derivatives use operations of their
 * own. */
static inline lg_status zoo_row(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_gradcheck_case *row = user;
    (void)theta;
    y[0] = row->function.build(row->function.user, tape, x);
    if (row->zero) return lg_tape_status(tape);
    return lg_grad(tape, lg_sum(tape, lg_square(tape, y[0])), x, row->function.inputs, &y[1]);
}

/* A program with one function of the registered case, whose inputs are shared. NULL: the case cannot be in a
 * program. */
static inline lg_program *zoo_operation(const lg_gradcheck_case *row) {
    static const char *const names[] = {"a", "b", "c", "d", "e", "f", "g", "h"};
    static const char *const results[] = {"y", "ga", "gb", "gc", "gd", "ge", "gf", "gg", "gh"};
    const uint32_t n = row->function.inputs;
    lg_port in[8], out[9];
    lg_program_spec spec;
    lg_program *program = NULL;
    if (n > LG_COUNT(in)) return NULL;
    for (uint32_t i = 0; i < n; i++)
        in[i] = (lg_port){.name = names[i],
                          .shape = row->function.arguments[i].shape,
                          .shared = true,
                          .low = row->function.arguments[i].low,
                          .high = row->function.arguments[i].high};
    for (uint32_t i = 0; i <= n; i++) out[i] = (lg_port){.name = results[i]};
    union {
        const lg_gradcheck_case *row;
        void *user;
    } as = {row};
    const lg_function_spec function = {"row", in, n, out, row->zero ? 1 : n + 1, zoo_row, as.user};
    lg_program_spec_init(&spec);
    spec.functions = &function;
    spec.function_count = 1;
    (void)lg_program_build(NULL, &spec, &program, NULL);
    return program;
}

/* ---- running ---- */

static inline lg_var zoo_input(lg_tape *tape, const lg_port *port, size_t rows, lg_rng *rng) {
    lg_shape shape = port->shape;
    void *values = NULL;
    if (!port->shared) {
        for (uint32_t d = shape.rank; d > 0; d--) shape.dims[d] = shape.dims[d - 1];
        shape.rank++;
        shape.dims[0] = (uint32_t)rows;
    }
    const lg_var x = lg_input_buffer(tape, shape, &values);
    const bool wide = lg_tape_dtype(tape) == LG_F64;
    for (size_t j = 0; values != NULL && j < lg_shape_count(shape); j++) {
        const double value = lg_rng_uniform_in(rng, 0.1, 1.1);
        if (wide)
            ((double *)values)[j] = value;
        else
            ((float *)values)[j] = (float)value;
    }
    return x;
}

static inline size_t zoo_bytes(const lg_tape *tape, lg_var v) {
    return lg_shape_count(lg_var_shape(tape, v)) * (lg_tape_dtype(tape) == LG_F64 ? 8 : 4);
}

/* Differentiates y by all x in every way: recorded twice, in forward mode, and without recording. */
static inline lg_status zoo_differentiate(lg_tape *tape, lg_var y, const lg_var *x, size_t n) {
    lg_var gradient[64], second[64], tangent;
    void *memory[64];
    const lg_mark mark = lg_tape_mark(tape);
    lg_status status = lg_grad(tape, lg_sum(tape, y), x, n, gradient);
    if (status == LG_OK) (void)lg_grad(tape, lg_sum(tape, lg_square(tape, gradient[0])), x, n, second);
    (void)lg_tape_rewind(tape, mark);
    (void)lg_jvp(tape, &y, 1, x, x, n, &tangent);
    (void)lg_tape_rewind(tape, mark);
    for (size_t i = 0; i < n; i++) {
        memory[i] = malloc(zoo_bytes(tape, x[i]) + 1);
        assert_non_null(memory[i]);
    }
    (void)lg_backward_set(tape, lg_sum(tape, y), x, n, memory);
    for (size_t i = 0; i < n; i++) free(memory[i]);
    (void)lg_tape_rewind(tape, mark);
    return status;
}

/* Runs a function of the program on a tape with inputs drawn from `seed`, and differentiates its first output
 * by them. Any status is allowed; the values, if there are any, go into `hash`. */
static inline lg_status zoo_run(const lg_program *program, size_t function, size_t rows, lg_dtype dtype,
                                uint64_t seed, size_t max_size, uint64_t *hash) {
    lg_tape_options options;
    lg_tape *tape;
    lg_var x[64], y[64];
    size_t inputs, outputs;
    const lg_port *in = lg_program_inputs(program, function, &inputs);
    (void)lg_program_outputs(program, function, &outputs);
    lg_rng rng = test_rng(seed, rows);
    lg_tape_options_init(&options);
    options.dtype = dtype;
    options.max_size = max_size;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    for (size_t i = 0; i < inputs; i++) x[i] = zoo_input(tape, &in[i], rows, &rng);
    lg_status status = lg_tape_status(tape);
    if (status == LG_OK) status = lg_program_record(tape, program, function, NULL, x, y);
    for (size_t j = 0; status == LG_OK && j < outputs; j++) {
        const unsigned char *value = lg_value(tape, y[j]);
        for (size_t b = 0; hash != NULL && b < zoo_bytes(tape, y[j]); b++)
            *hash = (*hash ^ value[b]) * 0x100000001b3u;
    }
    if (status == LG_OK) status = zoo_differentiate(tape, y[0], x, inputs);
    assert_true(max_size == 0 || lg_tape_size(tape) <= max_size);
    lg_tape_destroy(tape);
    return status;
}

/* All functions of the two programs must give the same bits. */
static inline void assert_same_results(const lg_program *a, const lg_program *b) {
    assert_int_equal(lg_program_functions(a), lg_program_functions(b));
    for (size_t f = 0; f < lg_program_functions(a); f++)
        for (size_t rows = 1; rows < 4; rows++)
            for (int dtype = 0; dtype < 2; dtype++) {
                uint64_t ha = 1, hb = 1;
                const lg_dtype type = dtype == 0 ? LG_F64 : LG_F32;
                const lg_status wanted = zoo_run(a, f, rows, type, f, 0, &ha);
                assert_int_equal(zoo_run(b, f, rows, type, f, 0, &hb), wanted);
                assert_true(ha != 1 && ha == hb);
            }
}

#endif

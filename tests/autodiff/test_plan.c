/* Plans agree with the tape for many numbers of rows, whatever the work memory contains and whichever outputs
 * are requested; common work is shared correctly. lg-gradcheck compares plans of every operation, network,
 * scheme and system with the tape, one call at a time. This file tests rows, float, Jacobians and memory.
 * ctest-labels: threads isa */
#include <pthread.h>

#include "support/malloc_count.h"
#include "autodiff/plan_ways.h"

#include "autodiff/ops/op_rows.h"
#include "autodiff/program/plan.h"
#include "autodiff/program/program.h"
#include "liegrad/geometry.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/networks.h"
#include "liegrad/taped.h"
#include "hamiltonian/internal.h"

/* ---- building ---- */

static lg_program *build(const lg_port *in, size_t inputs, const lg_port *out, size_t outputs,
                         size_t parameters, lg_record_function record, void *user) {
    lg_rng rng = test_rng(11, parameters);
    double *values = TEST_ARRAY(double, parameters + 1);
    for (size_t i = 0; i < parameters; i++) values[i] = 0.5 * lg_rng_normal(&rng);
    const lg_parameter_spec theta = {"theta", lg_shape1((uint32_t)parameters), values};
    const lg_function_spec function = {"f", in, inputs, out, outputs, record, user};
    const lg_program_spec spec = spec_of(&theta, parameters > 0, &function, 1);
    return test_program(&spec);
}

/* ---- derivatives of rows ---- */

/* Compares the Jacobian function of a function whose rows are independent with lg_jacobian of each row. */
static void check_jacobian(const char *name, const lg_program *program, size_t value, size_t jacobian,
                           size_t rows) {
    numbers n;
    ready r;
    size_t inputs, outputs;
    const lg_port *in = lg_program_inputs(program, value, &inputs),
                  *out = lg_program_outputs(program, value, &outputs);
    open_numbers(&n, program, jacobian, rows, false);
    for (size_t row = 0; row < rows; row++) {
        lg_tape *tape = test_tape(LG_F64);
        lg_var x[PORTS], y[PORTS];
        for (size_t i = 0; i < inputs; i++) {
            const size_t skip = in[i].shared ? 0 : row * lg_shape_count(in[i].shape);
            x[i] = lg_input(tape, lg_port_shape(&in[i], 1), n.in[i] + skip);
        }
        assert_ok(lg_program_record(tape, program, value, NULL, x, y));
        for (size_t j = 0, block = 0; j < outputs; j++)
            for (size_t i = 0; !out[j].shared && i < inputs; i++) {
                if (in[i].shared) continue;
                const size_t count = lg_shape_count(out[j].shape) * lg_shape_count(in[i].shape);
                assert_ok(lg_read(tape, lg_jacobian(tape, y[j], x[i]), count, n.out[block++] + row * count));
            }
    }
    open_plan(&r, program, jacobian, rows, LG_F64, &n);
    run(&r, &n, r.out, 0xff);
    compare(name, rows, &r, &n, 1e-11);
}

/* Compares the forward or adjoint function with lg_jvp or lg_vjp on a tape. Its inputs are the value's
 * inputs, followed by directions of the inputs (forward) or weights of the outputs (adjoint). */
static void check_modes(const char *name, const lg_program *program, size_t value, size_t mode, bool adjoint,
                        size_t rows) {
    numbers n;
    size_t inputs, outputs;
    const lg_port *port = lg_program_inputs(program, mode, &inputs);
    lg_var in[PORTS], y[PORTS], expected[PORTS], got[PORTS];
    lg_tape *tape = test_tape(LG_F64);
    (void)lg_program_inputs(program, value, &inputs);
    (void)lg_program_outputs(program, value, &outputs);
    open_numbers(&n, program, mode, rows, false);
    for (size_t i = 0; i < n.inputs; i++) in[i] = lg_input(tape, lg_port_shape(&port[i], rows), n.in[i]);
    assert_ok(lg_program_record(tape, program, value, NULL, in, y));
    assert_ok(lg_program_record(tape, program, mode, NULL, in, got));
    if (adjoint)
        assert_ok(lg_vjp(tape, y, in + inputs, outputs, in, inputs, expected));
    else
        assert_ok(lg_jvp(tape, y, outputs, in, in + inputs, inputs, expected));
    assert_int_equal(n.outputs, adjoint ? inputs : outputs);
    for (size_t j = 0; j < n.outputs; j++) {
        double *other = TEST_ARRAY(double, n.out_count[j]), size = 1e-3;
        assert_ok(lg_read(tape, got[j], n.out_count[j], n.out[j]));
        assert_ok(lg_read(tape, expected[j], n.out_count[j], other));
        for (size_t i = 0; i < n.out_count[j]; i++) size = fmax(size, fabs(other[i]));
        lg_all_close(name, n.out[j], other, n.out_count[j], 0.0, 1e-12 * size, __FILE__, __LINE__);
    }
}

static void check_derivatives(const char *name, lg_program *program, bool independent, bool second) {
    const size_t value = lg_program_functions(program) - 1;
    const char *function = lg_program_function_name(program, value);
    const size_t forward = derived(program, LG_DERIVATIVE_FORWARD, function),
                 adjoint = derived(program, LG_DERIVATIVE_ADJOINT, function);
    check_modes(name, program, value, forward, false, 3);
    check_modes(name, program, value, adjoint, true, 3);
    if (independent) {
        const size_t jacobian = derived(program, LG_DERIVATIVE_JACOBIAN, function);
        for (size_t rows = 1; rows <= 5; rows += 2) check_jacobian(name, program, value, jacobian, rows);
    }
    if (independent && second) {
        const size_t jacobian = derived(program, LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, function);
        for (size_t rows = 1; rows <= 5; rows += 2) check_jacobian(name, program, adjoint, jacobian, rows);
    }
    check_all(name, program);
}

/* ---- networks ---- */

RECORDING(record_net) {
    y[0] = lg_net_record(tape, user, theta[0], 0, x[0]);
}

RECORDING(record_value) {
    y[0] = lg_mlp_record(tape, user, theta[0], 0, x[0]);
}

static const lg_port y_ports[] = {{.name = "y"}, {.name = "z"}, {.name = "a"}, {.name = "b"},
                                  {.name = "c"}, {.name = "e"}, {.name = "f"}, {.name = "g"},
                                  {.name = "h"}, {.name = "i"}, {.name = "j"}};

TEST("plans and derivatives of a network agree with the tape, for any number of rows") {
    const lg_port x = {.name = "x", .shape = {1, {3, 0, 0, 0}}};
    for (uint32_t width = 5; width <= 17; width += 12) {
        lg_net net;
        assert_ok(lg_net_init(&net, LG_NET_MULT, 3, 4, width, 2, 2, LG_SWISH));
        lg_program *program = build(&x, 1, y_ports, 1, lg_net_parameters(&net), record_net, &net);
        check_derivatives("network", program, true, width == 5);
    }
}

/* ---- Hamiltonians and systems ---- */

/* The caller destroys the program. */
static lg_program *make_hamiltonian(const lg_hamiltonian_family *family, uint32_t links, const char *scheme) {
    const uint32_t hidden[1] = {6};
    lg_hamiltonian model;
    lg_program *program = NULL;
    assert_ok(lg_hamiltonian_init(&model, family, links, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
    double *theta = TEST_ARRAY(double, lg_hamiltonian_parameters(&model));
    for (size_t i = 0; i < lg_hamiltonian_parameters(&model); i++)
        theta[i] = 0.3 + 0.5 * (double)(i * 7 % 11) / 11.0;
    assert_told(lg_hamiltonian_program(NULL, &model, theta, scheme == NULL ? NULL : lg_scheme_find(scheme),
                                       &program, &told));
    return program;
}

static lg_program *hamiltonian(const lg_hamiltonian_family *family, uint32_t links, const char *scheme) {
    lg_program *program = make_hamiltonian(family, links, scheme);
    lg_test_owns(program, release_program);
    return program;
}

TEST("plans and derivatives of a learned Hamiltonian and its steps agree with the tape, for any number "
     "of rows") {
    lg_program *program = hamiltonian(&lg_hamiltonian_chain, 2, "rkmk4");
    check_derivatives("hamiltonian", program, true, false);
}

/* ---- unusual outputs and shapes ---- */

RECORDING(record_odd) {
    const uint32_t rows = lg_var_shape(tape, x[0]).dims[0];
    y[0] = lg_sin(tape, x[0]); /* used as two outputs */
    y[1] = y[0];
    y[2] = x[0];                                                             /* an input */
    y[3] = lg_full(tape, lg_shape2(rows, 2), 0.25);                          /* a constant */
    y[4] = lg_reshape(tape, x[0], lg_shape3(rows, 2, 2));                    /* a view of an input */
    y[5] = lg_reshape(tape, y[0], lg_shape3(rows, 4, 1));                    /* a view of an output */
    y[6] = lg_slice(tape, lg_reshape(tape, x[1], lg_shape1(6)), 0, 2, 3);    /* a part of a shared input */
    y[7] = lg_reshape(tape, lg_slice(tape, x[0], 1, 0, 1), lg_shape1(rows)); /* rank 1: a row has no shape */
    y[8] = x[1];
    y[9] = lg_add(tape, x[0], lg_mul(tape, x[2], lg_full(tape, lg_shape1(4), 2.0)));
    y[10] = lg_slice(tape, x[0], 1, 4, 0); /* empty */
}

TEST("outputs may be inputs, constants, views, empty, or equal to other outputs") {
    const lg_port in[] = {{.name = "x", .shape = {1, {4}}},
                          {.name = "s", .shape = {2, {2, 3}}, .shared = true},
                          {.name = "t", .shape = {0, {0}}, .shared = true}};
    lg_program *program = build(in, 3, y_ports, LG_COUNT(y_ports), 0, record_odd, NULL);
    check_all("odd outputs", program);
    (void)derived(program, LG_DERIVATIVE_FORWARD, "f");
    (void)derived(program, LG_DERIVATIVE_ADJOINT, "f");
    check_all("odd outputs", program);
}

/* ---- operations that read the same numbers twice ---- */

/* sin x is recorded twice and becomes one buffer in a plan. The last operation that reads the buffer may
 * write its result there, and must not read the buffer afterwards. */
RECORDING(record_twice) {
    static const double c[3] = {0.25, 2.0, -1.5};
    lg_var z[2], e[2], h[2], q[2], w[2];
    for (int i = 0; i < 2; i++) {
        z[i] = lg_sin(tape, x[0]);
        e[i] = lg_exp(tape, x[0]);
        h[i] = lg_act(tape, x[0], LG_TANH);
        q[i] = lg_square(tape, x[0]);
        w[i] = lg_cos(tape, lg_neg(tape, x[0]));
    }
    y[0] = lg_cos(tape, lg_linear_combination(tape, z, c, 2));
    y[1] = lg_exp(tape, lg_linear_combination(tape, (lg_var[]){e[0], lg_cos(tape, x[0]), e[1]}, c, 3));
    y[2] = lg_sin(tape, lg_lerp(tape, h[0], h[1], h[0]));
    y[3] = lg_sin(tape, lg_div(tape, q[0], lg_add(tape, q[0], q[1])));
    y[4] = lg_exp(tape, lg_sub(tape, w[0], lg_slice(tape, w[1], 0, 0, 1))); /* each row minus the first row */
}

/* Here a part of a buffer is read again for every element. */
RECORDING(record_part) {
    const lg_var s = lg_sin(tape, x[0]), e = lg_exp(tape, x[0]), c = lg_cos(tape, x[0]);
    y[0] = lg_cos(tape, lg_mul(tape, s, lg_slice(tape, s, 1, 0, 1))); /* each column times the first one */
    y[1] = lg_sin(tape, lg_sub(tape, lg_slice(tape, e, 1, 7, 1), e));
    y[2] = lg_exp(tape, lg_mul(tape, c, lg_slice(tape, c, 0, 0, 1))); /* each row times the first one */
}

TEST("an operation may read equal numbers twice") {
    const lg_port wide = {.name = "x", .shape = {1, {40}}}, one = {.name = "x", .shape = {1, {1}}};
    check_derivatives("twice, wide", build(&wide, 1, y_ports, 5, 0, record_twice, NULL), false, false);
    check_derivatives("twice", build(&one, 1, y_ports, 5, 0, record_twice, NULL), false, false);
    check_derivatives("a part", build(&wide, 1, y_ports, 3, 0, record_part, NULL), false, false);
}

/* x' = sin u with a constant input u: the stages of a step are equal subexpressions. */
static lg_status sine_of_input(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                               lg_var *algebra) {
    (void)user, (void)t, (void)y;
    algebra[0] = lg_sin(tape, input);
    return lg_tape_status(tape);
}

RECORDING(record_step_of_input) {
    lg_taped_ode ode = {.field = sine_of_input};
    if (lg_space_init_rn(&ode.space, 1) != LG_OK || lg_space_init_rn(&ode.manifold, 1) != LG_OK) return;
    const lg_taped_interval over = {.h = 0.1, .input = x[1]};
    (void)lg_taped_step(tape, user, &ode, &over, x, y);
}

TEST("a plan of a step with equal stages agrees with the tape, for every explicit scheme") {
    const lg_port in[] = {{.name = "x", .shape = {1, {1}}}, {.name = "u", .shape = {1, {1}}}};
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        const lg_scheme *scheme = lg_scheme_at(i);
        if (scheme->kind == LG_SCHEME_RKMK || scheme->kind == LG_SCHEME_COMMUTATOR_FREE)
            check_all(scheme->name,
                      build(in, 2, y_ports, 1, 0, record_step_of_input, (void *)(uintptr_t)scheme));
    }
}

RECORDING(record_scalar_rows) {
    y[0] = lg_mul(tape, lg_exp(tape, x[0]), lg_sin(tape, x[1]));
}

TEST("a row may be a single number: shape (B)") {
    const lg_port in[] = {{.name = "x"}, {.name = "z"}};
    lg_program *program = build(in, 2, y_ports, 1, 0, record_scalar_rows, NULL);
    check_derivatives("rows of rank 0", program, true, true);
}

/* ---- rows of scalar code, LG_K_ROWS at a time ---- */

/* Every operation of scalar code on x (B, 6), on w (2), which is shared, on parameters and on constants; y[8]
 * and y[9] have no rows, but y[9] has two elements along the first axis, as a batch of two has. */
RECORDING(record_each_scalar) {
    static const double equal_rows[] = {0.25, -1.5}, factors[] = {2.0, -1.0, 0.5}, matrix[] = {1, 2, -3, 5};
    lg_var a[6], z[3];
    for (uint32_t i = 0; i < 6; i++) a[i] = lg_slice(tape, x[0], 1, i, 1);
    const lg_var square = lg_add_scalar(tape, lg_square(tape, a[0]), 0.5),
                 shared = lg_slice(tape, x[1], 0, 1, 1), constants = lg_input(tape, lg_shape1(2), equal_rows);
    y[0] =
        lg_concat(tape, (lg_var[]){lg_sin(tape, a[0]), a[3], lg_cos(tape, a[1]), lg_neg(tape, a[2])}, 4, 1);
    y[1] = lg_select(tape, lg_ge(tape, a[0], a[1]), lg_mul(tape, a[2], shared), lg_exp(tape, a[3]));
    y[2] = lg_div(tape, lg_max(tape, a[4], a[5]), lg_pow(tape, square, 1.75));
    y[3] = lg_atan2(tape, a[0], lg_sub(tape, a[1], lg_slice(tape, theta[0], 0, 2, 1)));
    z[0] = lg_sqrt(tape, square), z[1] = lg_log(tape, square), z[2] = lg_sign(tape, lg_abs(tape, a[1]));
    y[4] = lg_linear_combination(tape, z, factors, 3);
    z[0] = lg_slice(tape, lg_stumpff_functions(tape, lg_slice(tape, y[0], 1, 0, 1), 3), 1, 1, 3);
    z[1] = lg_dexpinv_coefficient(tape, a[5], 1);
    y[5] = lg_concat(tape, z, 2, 1);
    y[6] = lg_act(tape, lg_slice(tape, x[0], 1, 1, 4), LG_SIGMOID);
    y[7] = lg_add(tape, lg_act(tape, lg_slice(tape, x[0], 1, 3, 2), LG_TANH), constants);
    y[8] = lg_mul(tape, lg_exp(tape, shared), lg_slice(tape, theta[0], 0, 0, 1));
    y[9] = lg_mul(tape, lg_sin(tape, x[1]), lg_input(tape, lg_shape2(2, 2), matrix));
}

/* Number of groups of scalar code that run for all rows. */
static size_t groups_by_rows(const lg_plan *plan) {
    size_t count = 0;
    for (size_t s = 0; s < plan->steps; s++)
        if (plan->step[s].kind == LG_STEP_SCALARS && plan->step[s].scalars.rows == plan->rows)
            count += plan->step[s].scalars.groups;
    return count;
}

TEST("a row of a batch has the bits of a plan for this row alone") {
    static const size_t batches[] = {2, 31, 32, 33, 70};
    const lg_port in[] = {{.name = "x", .shape = {1, {6}}}, {.name = "w", .shape = {1, {2}}, .shared = true}};
    lg_program *program = build(in, 2, y_ports, 10, 3, record_each_scalar, NULL);
    for (size_t k = 0; k < LG_COUNT(batches); k++)
        for (int dtype = 0; dtype < 2; dtype++) {
            const size_t rows = batches[k];
            numbers all, alone;
            ready batch, one;
            open_numbers(&all, program, 0, rows, false);
            open_numbers(&alone, program, 0, 1, false);
            open_plan(&batch, program, 0, rows, dtype == 0 ? LG_F64 : LG_F32, &all);
            open_plan(&one, program, 0, 1, dtype == 0 ? LG_F64 : LG_F32, &alone);
            assert_true(groups_by_rows(batch.plan) >= 16);
            run(&batch, &all, batch.out, 0xff);
            memcpy(one.in[1], batch.in[1], 2 * one.size);
            for (size_t row = 0; row < rows; row++) {
                memcpy(one.in[0], (char *)batch.in[0] + row * 6 * one.size, 6 * one.size);
                run(&one, &alone, one.out, 0x00);
                for (size_t j = 0; j < all.outputs; j++) {
                    const size_t skip = j >= 8 ? 0 : row * alone.out_count[j];
                    if (memcmp(one.out[j], (char *)batch.out[j] + skip * one.size,
                               alone.out_count[j] * one.size) != 0)
                        fail_msg("row %zu of %zu: output %zu has other bits", row, rows, j);
                }
            }
        }
    check_derivatives("every scalar operation", program, false, false);
}

/* ---- repeated rows, which must not be treated one by one ---- */

/* Each row is repeated `copies` times, as in a Jacobian. */
static lg_var repeated(lg_tape *tape, lg_var x, uint32_t rows, uint32_t width, uint32_t copies) {
    const lg_var one = lg_reshape(tape, x, lg_shape3(rows, 1, width));
    return lg_reshape(tape, lg_broadcast_to(tape, one, lg_shape3(rows, copies, width)),
                      lg_shape2(rows * copies, width));
}

enum { WIDTH = 4, COPIES = 2 };

/* x (B, 4); w (4, 4) is shared. */
RECORDING(record_meeting) {
    static const uint32_t chosen[3] = {3, 0, 0};
    const uint32_t rows = lg_var_shape(tape, x[0]).dims[0], all = rows * COPIES;
    const lg_var r = repeated(tape, x[0], rows, WIDTH, COPIES), other = lg_sin(tape, r);
    /* Here rows affect each other: sums over the batch, x^T y, maxima, slices, paddings and concatenations
     * along the rows. */
    const lg_var mean = lg_mean_axis(tape, other, 0, true);
    y[0] = lg_slice(tape, lg_sub(tape, other, mean), 0, 0, rows);
    y[1] = lg_matmul_tn(tape, r, other);
    y[2] = lg_slice(tape, other, 0, 1, rows);
    const lg_var halves[2] = {lg_slice(tape, other, 0, rows, rows), lg_slice(tape, other, 0, 0, rows)};
    const lg_var joint = lg_concat(tape, halves, 2, 0);
    y[3] = lg_slice(tape, lg_mul(tape, joint, r), 0, 0, rows);
    y[4] = lg_slice(tape, lg_pad(tape, other, 0, 1, 2), 0, 0, rows);
    y[5] = lg_sum(tape, other);
    y[6] = lg_slice(tape, lg_reshape(tape, other, lg_shape2(all / COPIES, WIDTH * COPIES)), 1, 2, 3);
    y[7] = lg_gather(tape, lg_slice(tape, lg_transpose(tape, other), 1, 0, rows), chosen, 3);
    y[7] = lg_transpose(tape, y[7]);
    y[8] = lg_slice(tape, lg_matmul(tape, other, lg_matmul_tn(tape, r, r)), 0, 0, rows);
    y[9] = lg_slice(tape, lg_add(tape, lg_matmul(tape, r, x[1]), theta[0]), 0, 0, rows);
    y[10] = lg_sum_axis(tape, other, 0, false); /* (4): as many numbers as repeated rows if 2 B = 4 */
}

TEST("rows that affect each other are not treated one by one") {
    const lg_port in[] = {{.name = "x", .shape = {1, {WIDTH}}},
                          {.name = "w", .shape = {2, {WIDTH, WIDTH}}, .shared = true}};
    lg_program *program = build(in, 2, y_ports, LG_COUNT(y_ports), WIDTH, record_meeting, NULL);
    check_derivatives("rows that meet", program, false, false);
}

/* Products of batches with one matrix that has equal rows. If 2 B = 4, it has as many rows as the batch, but
 * they are not the batch's rows. x (B, 4) */
RECORDING(record_matrix) {
    static const double right_values[12] = {1, 2, 3, 1, 2, 3, -1, 4, 2, -1, 4, 2},
                        left_values[8] = {1, 2, 1, 2, 3, 4, 3, 4};
    static const uint32_t turned[4] = {3, 0, 1, 2};
    const uint32_t rows = lg_var_shape(tape, x[0]).dims[0], all = rows * COPIES;
    const lg_var r = lg_sin(tape, repeated(tape, x[0], rows, WIDTH, COPIES));
    const lg_var right = lg_input(tape, lg_shape2(4, 3), right_values),
                 left = lg_input(tape, lg_shape2(4, 2), left_values);
    const lg_var alike = repeated(tape, lg_reshape(tape, theta[0], lg_shape2(2, 2)), 2, 2, 2);
    const lg_var tall = lg_reshape(tape, r, lg_shape3(all, 1, 4)),
                 square = lg_reshape(tape, r, lg_shape3(all, 2, 2));
    y[0] = lg_slice(tape, lg_reshape(tape, lg_matmul(tape, tall, right), lg_shape2(all, 3)), 0, 0, rows);
    y[1] = lg_slice(tape, lg_reshape(tape, lg_matmul(tape, left, square), lg_shape2(all, 8)), 0, 0, rows);
    y[2] = lg_slice(tape, lg_reshape(tape, lg_matmul(tape, alike, square), lg_shape2(all, 8)), 0, 0, rows);
    const lg_var from_input = repeated(tape, x[1], 2, 2, 2);
    y[3] =
        lg_slice(tape, lg_reshape(tape, lg_matmul(tape, from_input, square), lg_shape2(all, 8)), 0, 0, rows);
    y[4] = lg_slice(tape,
                    lg_mul(tape, r, lg_reshape(tape, lg_slice(tape, from_input, 0, 1, 2), lg_shape2(1, 4))),
                    0, 0, rows);
    y[5] = lg_gather(tape, from_input, turned, 4);
}

TEST("a matrix that happens to have as many rows as the batch is not treated as a batch") {
    const lg_port in[] = {{.name = "x", .shape = {1, {WIDTH}}},
                          {.name = "w", .shape = {2, {2, 2}}, .shared = true}};
    lg_program *program = build(in, 2, y_ports, 6, 4, record_matrix, NULL);
    check_derivatives("a matrix beside a batch", program, false, false);
}

/* Repeats without rows: w (1, 4) is repeated 0 times. x (B, 4) */
RECORDING(record_no_rows) {
    const lg_var none = lg_broadcast_to(tape, x[1], lg_shape2(0, WIDTH)),
                 of_x = lg_slice(tape, x[0], 1, 0, 0);
    const lg_var other = lg_sin(tape, lg_mul(tape, none, none)), parts[2] = {none, x[1]};
    y[0] = lg_add(tape, x[0], lg_matmul(tape, of_x, none));
    y[1] = lg_add(tape, x[0], lg_concat(tape, parts, 2, 0));
    y[2] = lg_add(tape, x[0], lg_sum_axis(tape, lg_add(tape, other, none), 0, false));
    y[3] = lg_mul(tape, x[0], lg_sum_axis(tape, lg_scatter(tape, none, NULL, 0, 2), 0, false));
    y[4] = lg_add(tape, x[0], lg_sum_axis(tape, lg_mul(tape, none, theta[0]), 0, false));
    const lg_var line = lg_broadcast_to(tape, lg_slice(tape, theta[0], 0, 0, 1), lg_shape1(0));
    y[5] = lg_add(tape, x[0], lg_sum(tape, lg_exp(tape, line)));
}

TEST("a tensor that is repeated 0 times has no rows") {
    const lg_port in[] = {{.name = "x", .shape = {1, {WIDTH}}},
                          {.name = "w", .shape = {2, {1, WIDTH}}, .shared = true}};
    lg_program *program = build(in, 2, y_ports, 6, WIDTH, record_no_rows, NULL);
    check_derivatives("no rows", program, false, false);
}

/* ---- work that does not depend on the direction is done once ---- */

/* Number of tanh evaluations in a plan. */
static size_t tangents(const lg_plan *plan) {
    size_t count = 0;
    for (size_t s = 0; s < plan->steps; s++) {
        const lg_plan_step *step = &plan->step[s];
        if (step->kind == LG_STEP_DENSE && step->dense.kind == LG_TANH)
            count += step->dense.m * step->dense.n;
        if (step->kind == LG_STEP_TENSOR && step->tensor.op == &lg_op_act) count += step->tensor.count;
        for (uint32_t g = 0; step->kind == LG_STEP_SCALARS && g < step->scalars.groups; g++)
            if (step->scalars.group[g].op == LG_S_TANH)
                count += step->scalars.rows * step->scalars.group[g].count;
    }
    return count;
}

TEST("shared work is done once") {
    for (uint32_t width = 3; width <= 24; width += 7) {
        const lg_port x = {.name = "x", .shape = {1, {3}}};
        const uint32_t hidden[2] = {width, width};
        lg_mlp net;
        assert_ok(lg_mlp_init(&net, 3, hidden, 2, 5, LG_TANH, true));
        lg_program *program = build(&x, 1, y_ports, 1, lg_mlp_parameters(&net), record_value, &net);
        (void)derived(program, LG_DERIVATIVE_ADJOINT, "f");
        (void)derived(program, LG_DERIVATIVE_JACOBIAN, "f");
        (void)derived(program, LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, "f");
        for (size_t f = 0; f < lg_program_functions(program); f++)
            for (size_t rows = 1; rows <= 6; rows += 5) {
                const lg_plan_options options = plan_options(rows, LG_F64);
                assert_int_equal(tangents(test_plan(program, f, &options)), rows * 2 * width);
            }
    }
}

/* A function of two inputs with two outputs, whose derivatives are taken for chosen inputs and outputs. */
RECORDING(record_two) {
    y[0] = lg_mlp_record(tape, user, theta[0], 0, x[0]);
    y[1] = lg_mul(tape, lg_sin(tape, x[1]), lg_slice(tape, x[0], 1, 0, 2));
}

TEST("derivatives by chosen inputs and of chosen outputs compute only what these need") {
    static const char *const by = "z", *const all[2] = {"y", "z"};
    const lg_port in[] = {{.name = "x", .shape = {1, {3}}}, {.name = "u", .shape = {1, {2}}}};
    const uint32_t hidden[1] = {30};
    lg_mlp net;
    assert_ok(lg_mlp_init(&net, 3, hidden, 1, 1, LG_TANH, true));
    lg_program *program = build(in, 2, y_ports, 2, lg_mlp_parameters(&net), record_two, &net);
    const struct {
        lg_derivative_kind kind;
        const char *name, *in, *out;
        bool network;
    } chosen[] = {{LG_DERIVATIVE_JACOBIAN, "j1", "u", "z", false},
                  {LG_DERIVATIVE_JACOBIAN, "j2", "x", "z", false},
                  {LG_DERIVATIVE_JACOBIAN, "j3", "x", "y", true},
                  {LG_DERIVATIVE_JACOBIAN, "j4", "u", "y", false},
                  {LG_DERIVATIVE_ADJOINT, "a1", "x", "z", false},
                  {LG_DERIVATIVE_ADJOINT, "a2", "x", "y", true},
                  {LG_DERIVATIVE_FORWARD, "f1", "x", "z", false},
                  {LG_DERIVATIVE_FORWARD, "f2", "u", "y", false},
                  {LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, "h1", "x", "z", false},
                  {LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, "h2", "x", "y", true}};
    for (size_t c = 0; c < LG_COUNT(chosen); c++) {
        lg_derivative what;
        lg_derivative_init(&what);
        what.kind = chosen[c].kind;
        what.function = "f";
        what.name = chosen[c].name;
        what.inputs = &chosen[c].in;
        what.outputs = &chosen[c].out;
        what.input_count = what.output_count = 1;
        assert_told(lg_program_derive(program, &what, &told));
        assert_int_equal(tangents(test_plan(program, lg_program_functions(program) - 1, NULL)) > 0,
                         chosen[c].network);
    }
    check_all("chosen pairs", program);
    /* Compares one of these derivatives with the tape. */
    enum { ROWS = 3 };
    size_t j2;
    numbers n;
    ready r;
    assert_ok(lg_program_find(program, "j2", &j2, NULL));
    open_numbers(&n, program, j2, ROWS, false);
    for (size_t row = 0; row < ROWS; row++)
        for (size_t i = 0; i < 2; i++)
            for (size_t j = 0; j < 3; j++)
                n.out[0][(row * 2 + i) * 3 + j] = i == j ? sin(n.in[1][row * 2 + i]) : 0.0;
    open_plan(&r, program, j2, ROWS, LG_F64, &n);
    run(&r, &n, r.out, 0xff);
    compare("j2", ROWS, &r, &n, 1e-14);
    const size_t before = lg_program_functions(program);
    lg_derivative what;
    lg_error error;
    lg_derivative_init(&what);
    what.kind = LG_DERIVATIVE_JACOBIAN;
    what.function = "f";
    what.inputs = &by;
    what.input_count = 1;
    assert_status(lg_program_derive(program, &what, &error), LG_NOT_FOUND);
    assert_says(error.message, "'z'");
    what.inputs = NULL;
    what.outputs = all;
    what.output_count = 2;
    assert_ok(lg_program_derive(program, &what, &error));
    assert_status(lg_program_derive(program, &what, &error), LG_INVALID_ARGUMENT); /* the name is taken */
    assert_int_equal(lg_program_functions(program), before + 1);
}

/* ---- loops ---- */

static void add_loop(lg_program *program, const char *name, size_t times) {
    const lg_carry carry = {"next", "x"};
    const lg_loop_spec loop = {sizeof loop, name, "step", times, &carry, 1, NULL, 0};
    assert_told(lg_program_add_loop(program, &loop, &told));
}

TEST("a plan of a loop equals single steps") {
    lg_program *program = hamiltonian(&lg_hamiltonian_chain, 1, NULL);
    size_t step;
    assert_ok(lg_program_find(program, "step", &step, NULL));
    for (size_t times = 1; times <= 7; times += times < 3 ? 1 : 4) {
        const char *name = test_text("steps%zu", times);
        add_loop(program, name, times);
        const size_t loop = lg_program_functions(program) - 1;
        for (size_t rows = 1; rows <= 7; rows += 3)
            for (int dtype = 0; dtype < 2; dtype++) {
                numbers n;
                ready one, all;
                open_numbers(&n, program, step, rows, true);
                open_plan(&one, program, step, rows, (lg_dtype)dtype, &n);
                open_plan(&all, program, loop, rows, (lg_dtype)dtype, &n);
                run(&all, &n, all.out, 0xff);
                compare_asked(name, &all, &n);
                for (size_t t = 0; t < times; t++) {
                    run(&one, &n, one.out, 0xff);
                    memcpy(one.in[0], one.out[0], n.out_count[0] * one.size);
                }
                assert_memory_equal(one.out[0], all.out[0], n.out_count[0] * one.size);
            }
        for (size_t rows = 1; rows <= 7; rows += 3) check_function(name, program, loop, rows);
    }
    /* Derivatives through the loop: lg_program_record of the loop records the chain of its steps. */
    const size_t adjoint = derived(program, LG_DERIVATIVE_ADJOINT, "steps3"),
                 jacobian = derived(program, LG_DERIVATIVE_JACOBIAN, "steps3");
    size_t loop;
    assert_ok(lg_program_find(program, "steps3", &loop, NULL));
    check_jacobian("loop", program, loop, jacobian, 3);
    check_function("adjoint of a loop", program, adjoint, 2);
    numbers n;
    open_numbers(&n, program, loop, 2, false);
    by_tape(program, loop, 2, &n);
    numbers single;
    open_numbers(&single, program, step, 2, false);
    for (size_t i = 0; i < n.inputs; i++) memcpy(single.in[i], n.in[i], n.in_count[i] * sizeof(double));
    for (size_t t = 0; t < 3; t++) {
        by_tape(program, step, 2, &single);
        memcpy(single.in[0], single.out[0], single.out_count[0] * sizeof(double));
    }
    assert_memory_equal(n.out[0], single.out[0], n.out_count[0] * sizeof(double));
}

/* Two outputs that become each other's inputs. */
RECORDING(record_exchange) {
    y[0] = lg_scale(tape, x[1], 2.0);
    y[1] = lg_add(tape, x[0], x[2]);
}

/* An output that is longer than the inputs, and an output that is shared by all rows. */
RECORDING(record_uneven) {
    y[0] = lg_concat(tape, x, 2, 1);
    y[1] = lg_mean_axis(tape, x[0], 0, false);
}

/* A shared output of rank 4. */
RECORDING(record_highest) {
    y[0] = lg_full(tape, lg_shape_of(4, (const uint32_t[]){1, 1, 1, 2}), 0.5);
}

TEST("loops carry several outputs in any order, and refuse impossible ones") {
    const lg_port in[] = {
        {.name = "a", .shape = {1, {2}}}, {.name = "b", .shape = {1, {2}}}, {.name = "c", .shape = {1, {2}}}};
    const lg_port out[] = {{.name = "p"}, {.name = "q"}};
    const lg_carry both[] = {{"p", "a"}, {"q", "b"}}, one[] = {{"q", "a"}, {"q", "b"}};
    const lg_port others[] = {{.name = "wide"}, {.name = "one"}};
    const char *const others_names[] = {"wide", "one"};
    const lg_function_spec functions[] = {{"f", in, 3, out, 2, record_exchange, NULL},
                                          {"uneven", in, 3, others, 2, record_uneven, NULL}};
    const lg_program_spec spec = spec_of(NULL, 0, functions, 2);
    lg_program *program = test_program(&spec);
    lg_error error;
    const char *const paths[] = {"q", "p"}, *const no_path[] = {"r"}, *const unnamed_path[] = {NULL};
    const lg_loop_spec loops[] = {{sizeof *loops, "both", "f", 5, both, 2, paths, 1},
                                  {sizeof *loops, "one", "f", 4, one, 2, paths, 2},
                                  {sizeof *loops, "still", "f", 3, NULL, 0, NULL, 0},
                                  {sizeof *loops, "uneven_paths", "uneven", 1, NULL, 0, others_names, 2}};
    for (size_t i = 0; i < LG_COUNT(loops); i++) assert_ok(lg_program_add_loop(program, &loops[i], &error));
    check_all("loops", program);
    /* Refused loops. */
    const lg_port deep = {.name = "deep"};
    const lg_function_spec highest = {"deep", in, 1, &deep, 1, record_highest, NULL};
    const lg_carry unknown = {"r", "a"}, nowhere = {"p", "z"}, unnamed = {NULL, "a"}, unset = {"p", NULL},
                   twice[] = {{"p", "a"}, {"q", "a"}}, wider = {"wide", "a"}, common = {"one", "a"};
    const struct {
        const char *name, *function;
        size_t times;
        const lg_carry *carries;
        size_t count;
        lg_status status;
        const char *says;
    } refused[] = {
        {"l", "g", 2, both, 2, LG_NOT_FOUND,
         "the program has no function 'g'; it has f, uneven, both, one, still, uneven_paths"},
        {"l", NULL, 2, both, 2, LG_INVALID_ARGUMENT,
         "'l': the name of its function, its carries or its paths are NULL"},
        {"l", "f", 2, NULL, 2, LG_INVALID_ARGUMENT,
         "'l': the name of its function, its carries or its paths are NULL"},
        {"l", "f", 2, &unknown, 1, LG_NOT_FOUND, "'f' has no output 'r'"},
        {"l", "f", 2, &nowhere, 1, LG_NOT_FOUND, "'f' has no input 'z'"},
        {"l", "f", 2, &unnamed, 1, LG_INVALID_ARGUMENT,
         "'l': each carry needs the names of an input and of an output"},
        {"l", "f", 2, &unset, 1, LG_INVALID_ARGUMENT,
         "'l': each carry needs the names of an input and of an output"},
        {"l", "f", 0, both, 2, LG_INVALID_ARGUMENT, "'l': times is 0, expected 1 to 16777216"},
        {"l", "f", 1 << 25, both, 2, LG_INVALID_ARGUMENT, "times is 33554432, expected 1 to 16777216"},
        {"l", "both", 2, both, 2, LG_INVALID_ARGUMENT, "'l' calls 'both', which is a loop too"},
        {"f", "f", 2, both, 2, LG_INVALID_ARGUMENT, "two functions are called 'f'"},
        {NULL, "f", 2, both, 2, LG_INVALID_ARGUMENT, "name of a function"},
        {"l", "f", 2, twice, 2, LG_INVALID_ARGUMENT, "'l': input 'a' is carried twice"},
        {"l", "uneven", 2, &wider, 1, LG_INVALID_ARGUMENT,
         "'l': output 'wide' cannot become input 'a': their shapes differ"},
        {"l", "uneven", 2, &common, 1, LG_INVALID_ARGUMENT,
         "'l': output 'one' cannot become input 'a': one of them is shared by all rows"}};
    for (size_t i = 0; i < LG_COUNT(refused); i++) {
        memset(&error, 0, sizeof error);
        const lg_loop_spec loop = {.size = sizeof loop,
                                   .name = refused[i].name,
                                   .function = refused[i].function,
                                   .times = refused[i].times,
                                   .carry = refused[i].carries,
                                   .carry_count = refused[i].count};
        assert_status(lg_program_add_loop(program, &loop, &error), refused[i].status);
        assert_says(error.message, refused[i].says);
    }
    const lg_loop_spec paths_refused[] = {{sizeof *paths_refused, "l", "f", 2, both, 2, no_path, 1},
                                          {sizeof *paths_refused, "l", "f", 2, both, 2, unnamed_path, 1},
                                          {sizeof *paths_refused, "l", "f", 2, both, 2, NULL, 1},
                                          {sizeof *paths_refused, "l", "deep", 2, NULL, 0, &deep.name, 1},
                                          {1, "l", "f", 2, both, 2, NULL, 0}};
    assert_ok(lg_program_add_function(program, &highest, &error));
    assert_status(lg_program_add_loop(program, &paths_refused[2], NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_program_add_loop(program, &paths_refused[3], &error), LG_SHAPE);
    assert_says(error.message, "output 'deep' has the highest rank already");
    assert_status(lg_program_add_loop(program, &paths_refused[4], &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "the size of the loop's specification is 1");
    assert_status(
        lg_program_add_loop(program, &(lg_loop_spec){sizeof *loops, "l", "f", 2, twice, 2, NULL, 0}, NULL),
        LG_INVALID_ARGUMENT);
    assert_status(lg_program_add_loop(program, &paths_refused[0], &error), LG_NOT_FOUND);
    assert_says(error.message, "'f' has no output 'r'");
    assert_status(lg_program_add_loop(program, &paths_refused[1], &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "its paths are NULL");
    /* A loop counts as its number of rounds times the work of one call. */
    lg_plan_options options = plan_options(1, LG_F64);
    lg_plan *plan = NULL;
    options.most_work = 1e4;
    const lg_loop_spec few = {sizeof few, "few", "f", 100, both, 2, NULL, 0},
                       many = {sizeof many, "many", "f", 1 << 20, both, 2, NULL, 0};
    assert_ok(lg_program_add_loop(program, &few, &error));
    (void)test_plan(program, lg_program_functions(program) - 1, &options);
    assert_ok(lg_program_add_loop(program, &many, &error));
    assert_status(lg_plan_create(program, lg_program_functions(program) - 1, &options, &plan, &error),
                  LG_UNSUPPORTED);
    assert_says(error.message, "more than the 1e+04");
}

/* x + tanh(x A)/10 */
RECORDING(record_walk) {
    y[0] = lg_add(tape, x[0], lg_scale(tape, lg_act(tape, lg_matmul(tape, x[0], theta[0]), LG_TANH), 0.1));
}

/* The mean square of all points of a motion of 200 steps. */
RECORDING(record_cost) {
    const lg_var motion = lg_program_call(tape, "motion", 1, x);
    y[0] = lg_mean_axis(tape, lg_mean_axis(tape, lg_square(tape, motion), 2, false), 1, false);
}

/* The same without a loop. */
RECORDING(record_long_cost) {
    lg_var now = x[0], sum = LG_NONE;
    for (int n = 0; n < 200; n++) {
        now = lg_program_call(tape, "step", 0, &now);
        const lg_var part = lg_mean_axis(tape, lg_square(tape, now), 1, false);
        sum = n == 0 ? part : lg_add(tape, sum, part);
    }
    y[0] = lg_scale(tape, sum, 1.0 / 200);
}

TEST("a function that is added later calls a loop, and its cost over a motion is the cost of single steps") {
    const lg_port in = {.name = "x", .shape = {1, {2}}}, out = {.name = "next"}, cost = {.name = "cost"};
    const lg_parameter_spec A = {"A", lg_shape2(2, 2), test_numbers(4, 4, -0.5, 0.5)};
    const lg_function_spec step = {"step", &in, 1, &out, 1, record_walk, NULL},
                           added[] = {{"cost", &in, 1, &cost, 1, record_cost, NULL},
                                      {"long_cost", &in, 1, &cost, 1, record_long_cost, NULL}};
    const lg_program_spec spec = spec_of(&A, 1, &step, 1);
    const lg_carry carry = {"next", "x"};
    const char *const path = "next";
    const lg_loop_spec loop = {sizeof loop, "motion", "step", 200, &carry, 1, &path, 1};
    lg_program *program = test_program(&spec);
    lg_error error;
    assert_status(lg_program_add_function(program, &added[0], &error), LG_NOT_FOUND); /* no loop yet */
    assert_ok(lg_program_add_loop(program, &loop, &error));
    for (size_t i = 0; i < LG_COUNT(added); i++)
        assert_ok(lg_program_add_function(program, &added[i], &error));
    assert_status(lg_program_add_function(program, &added[0], &error), LG_INVALID_ARGUMENT); /* twice */
    assert_true(lg_program_operations(program, 2) <= 6);
    assert_true(lg_program_operations(program, 3) > 600);
    const double x[] = {0.3, -0.7, 1.1, 0.4};
    const double *const inputs[] = {x};
    double value[2][2], gradient[2][4];
    for (int i = 0; i < 2; i++) {
        double *const outputs[] = {value[i]};
        assert_ok(lg_program_eval(NULL, program, added[i].name, 2, inputs, outputs, &error));
        const size_t adjoint = derived(program, LG_DERIVATIVE_ADJOINT, added[i].name);
        const double one[] = {1, 1}, *const both[] = {x, one};
        double *const slopes[] = {gradient[i]};
        assert_ok(lg_program_eval(NULL, program, lg_program_function_name(program, adjoint), 2, both, slopes,
                                  &error));
    }
    for (int b = 0; b < 2; b++) assert_close(value[0][b], value[1][b], 1e-14, 0);
    for (int b = 0; b < 4; b++) assert_close(gradient[0][b], gradient[1][b], 1e-12, 1e-14);
}

/* ---- options ---- */

TEST("with mark_unfit, unfit inputs make all results NaN, and other inputs give the same bits as without") {
    const double bad[] = {NAN, INFINITY, -INFINITY};
    lg_program *program = hamiltonian(&lg_hamiltonian_chain, 1, NULL);
    add_loop(program, "steps", 3);
    for (size_t f = 0; f < lg_program_functions(program); f++)
        for (int dtype = 0; dtype < 2; dtype++)
            for (size_t b = 0; b < LG_COUNT(bad); b++) {
                numbers n;
                ready plain, marking;
                const lg_kernels *k = lg_kernels_for((lg_dtype)dtype);
                lg_plan_options options = plan_options(3, (lg_dtype)dtype);
                options.mark_unfit = true;
                open_numbers(&n, program, f, 3, true);
                open_plan(&plain, program, f, 3, (lg_dtype)dtype, &n);
                open_plan(&marking, program, f, 3, (lg_dtype)dtype, &n);
                marking.plan = test_plan(program, f, &options);
                marking.work = room(lg_plan_work_size(marking.plan));
                run(&plain, &n, plain.out, 0xff);
                run(&marking, &n, marking.out, 0xff); /* nothing to mark: the same bits */
                for (size_t j = 0; j < n.outputs; j++)
                    assert_memory_equal(marking.out[j], plain.out[j], n.out_count[j] * plain.size);
                for (size_t i = 0; i < n.inputs; i++) {
                    unsigned char *last = (unsigned char *)marking.in[i] + (n.in_count[i] - 1) * plain.size;
                    k->convert_in(1, &bad[b], last);
                    run(&marking, &n, marking.out, 0xff);
                    for (size_t j = 0; j < n.outputs; j++) {
                        double *got = TEST_ARRAY(double, n.out_count[j]);
                        k->convert_out(n.out_count[j], marking.out[j], got);
                        for (size_t e = 0; e < n.out_count[j]; e++) assert_true(isnan(got[e]));
                    }
                    k->convert_in(1, &n.in[i][n.in_count[i] - 1], last);
                }
            }
}

TEST("without mark_unfit a row with NaN does not affect other rows") {
    lg_program *program = hamiltonian(&lg_hamiltonian_chain, 2, NULL);
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        numbers n;
        ready r;
        open_numbers(&n, program, f, 3, false);
        open_plan(&r, program, f, 3, LG_F64, &n);
        ((double *)r.in[0])[n.in_count[0] / 3] = NAN; /* in row 1 */
        run(&r, &n, r.out, 0xff);
        for (size_t j = 0; j < n.outputs; j++) {
            const size_t row = n.out_count[j] / 3;
            size_t bad = 0;
            for (size_t i = 0; i < n.out_count[j]; i++) {
                const bool is_nan = isnan(((double *)r.out[j])[i]);
                if (is_nan && i / row != 1) fail_msg("function %zu: row %zu is touched by row 1", f, i / row);
                bad += is_nan;
            }
            assert_true(bad > 0);
        }
    }
}

TEST("max_size limits a plan, and a plan that fits also fits into more memory") {
    const lg_port x = {.name = "x", .shape = {1, {16}}};
    const uint32_t hidden[2] = {64, 64};
    lg_mlp net;
    assert_ok(lg_mlp_init(&net, 16, hidden, 2, 3, LG_TANH, true));
    lg_program *program = build(&x, 1, y_ports, 1, lg_mlp_parameters(&net), record_value, &net);
    for (size_t rows = 1; rows <= 50; rows += 49) {
        bool made = false, refused = false;
        for (size_t most = 64; most < (size_t)1 << 22; most += most / 3) {
            lg_plan *plan = NULL;
            lg_error error;
            lg_plan_options options = plan_options(rows, LG_F64);
            options.max_size = most;
            const lg_status status = lg_plan_create(program, 0, &options, &plan, &error);
            if (status == LG_OK) {
                assert_true(lg_plan_work_size(plan) <= most + 64);
                assert_true(plan->constant_count * sizeof(double) <= most);
                made = true;
            } else {
                assert_int_equal(status, LG_OUT_OF_MEMORY);
                assert_true(strlen(error.message) > 0);
                assert_false(made); /* a plan that was made with less memory must be made with more */
                assert_null(plan);
                refused = true;
            }
            lg_plan_destroy(plan);
        }
        assert_true(made && refused);
    }
    lg_plan *plan = NULL;
    lg_plan_options bad[4], all = plan_options(1, LG_F64);
    for (size_t i = 0; i < LG_COUNT(bad); i++) bad[i] = all;
    bad[0].rows = 0;
    bad[1].dtype = (lg_dtype)7;
    bad[2].size = 1;
    for (size_t i = 0; i < 3; i++)
        assert_status(lg_plan_create(program, 0, &bad[i], &plan, NULL), LG_INVALID_ARGUMENT);
    bad[3].max_size = all.max_size = SIZE_MAX;
    bad[3].rows = (size_t)1 << 30;
    (void)test_plan(program, 0, &all);
    assert_true(lg_plan_create(program, 0, &bad[3], &plan, NULL) != LG_OK);
    assert_status(lg_plan_create(program, lg_program_functions(program), NULL, &plan, NULL), LG_NOT_FOUND);
    assert_null(plan);
    lg_plan_destroy(NULL);
}

TEST("a plan keeps no reference to its program") {
    lg_program *program = hamiltonian(&lg_hamiltonian_chain, 2, "rkmk4");
    add_loop(program, "steps", 2);
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        lg_program *other =
            make_hamiltonian(&lg_hamiltonian_chain, 2, "rkmk4"); /* destroyed before the plan runs */
        add_loop(other, "steps", 2);
        numbers n;
        ready r;
        open_numbers(&n, other, f, 3, false);
        by_tape(other, f, 3, &n);
        open_plan(&r, other, f, 3, LG_F64, &n);
        const lg_parameter_spec theta = lg_program_parameter(other, 0);
        assert_ok(lg_program_set_parameter(other, 0, TEST_ARRAY(double, lg_shape_count(theta.shape))));
        lg_program_destroy(other);
        run(&r, &n, r.out, 0xff);
        compare("alone", 3, &r, &n, 1e-12);
    }
}

/* ---- threads ---- */

enum { THREADS = 4, RUNS = 50 };
typedef struct worker {
    const ready *r;
    const numbers *n;
    void *out[PORTS], *work;
    size_t different;
} worker;

static void *work_on(void *user) {
    worker *w = user;
    for (int i = 0; i < RUNS; i++) {
        lg_plan_eval(w->r->plan, (const void *const *)(void *const *)w->r->in, w->out, w->work);
        for (size_t j = 0; j < w->n->outputs; j++)
            w->different += memcmp(w->out[j], w->r->out[j], w->n->out_count[j] * w->r->size) != 0;
    }
    return NULL;
}

TEST("threads can share a plan and get the same bits") {
    lg_program *program = hamiltonian(&lg_hamiltonian_chain, 2, NULL);
    add_loop(program, "steps", 2);
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        numbers n;
        ready r;
        worker workers[THREADS];
        pthread_t threads[THREADS];
        open_numbers(&n, program, f, 7, false);
        open_plan(&r, program, f, 7, LG_F64, &n);
        run(&r, &n, r.out, 0xff);
        for (size_t t = 0; t < THREADS; t++) {
            workers[t] = (worker){.r = &r, .n = &n, .work = room(lg_plan_work_size(r.plan))};
            for (size_t j = 0; j < n.outputs; j++) workers[t].out[j] = room(n.out_count[j] * r.size);
            assert_int_equal(pthread_create(&threads[t], NULL, work_on, &workers[t]), 0);
        }
        for (size_t t = 0; t < THREADS; t++) {
            assert_int_equal(pthread_join(threads[t], NULL), 0);
            assert_int_equal(workers[t].different, 0);
        }
    }
}

/* ---- every allocation fails in turn ---- */

TEST("if an allocation fails there is a message, and the program is unchanged") {
    const lg_port in = {.name = "x", .shape = {1, {3}}, .unit = "m"}, out = {.name = "y", .unit = "J"};
    const uint32_t hidden[1] = {4};
    lg_mlp net;
    assert_ok(lg_mlp_init(&net, 3, hidden, 1, 2, LG_TANH, true));
    const lg_parameter_spec theta = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&net)),
                                     test_numbers(3, lg_mlp_parameters(&net), -0.3, 0.3)};
    const lg_function_spec function = {"f", &in, 1, &out, 1, record_value, &net};
    lg_program_spec spec = spec_of(&theta, 1, &function, 1);
    const char *const path = "y";
    const lg_loop_spec loop = {sizeof loop, "l", "f", 2, NULL, 0, &path, 1};
    lg_derivative what;
    lg_derivative_init(&what);
    what.kind = LG_DERIVATIVE_JACOBIAN;
    what.function = "f";
    spec.description = "a network";
    const lg_plan_options options = plan_options(30, LG_F64);
    EVERY_ALLOCATION_FAILS(context, 4, {
        lg_error error = {.message = ""};
        lg_program *program = NULL;
        size_t functions = 0;
        status = lg_program_build(context, &spec, &program, &error);
        if (status == LG_OK) functions++, status = lg_program_derive(program, &what, &error);
        if (status == LG_OK) functions++, status = lg_program_add_loop(program, &loop, &error);
        if (status == LG_OK) functions++;
        assert_int_equal(program != NULL ? lg_program_functions(program) : 0, functions);
        for (size_t f = 0; status == LG_OK && f < functions; f++) {
            lg_plan *plan = NULL;
            status = lg_plan_create(program, f, &options, &plan, &error);
            assert_int_equal(plan != NULL, status == LG_OK);
            lg_plan_destroy(plan);
        }
        assert_true(status == LG_OK || (error.status == status && strlen(error.message) > 0));
        lg_program_destroy(program);
    });
}

/* ---- memory of long recordings ---- */

enum { ROUNDS = 3000, WIDE = 20 };

/* Computes x sin(sum x) many times: alternately a tensor and scalar code. */
static lg_status record_rounds(void *user, lg_tape *tape, const lg_var *parameters, const lg_var *x,
                               lg_var *y) {
    *y = x[0];
    for (int i = 0; i < ROUNDS; i++) *y = lg_mul(tape, x[0], lg_sin(tape, lg_sum(tape, *y)));
    return lg_tape_status(tape);
}

TEST("the memory for long recordings is proportional to their length") {
    const lg_port in = {.name = "x", .shape = lg_shape1(WIDE), .shared = true}, out = {.name = "y"};
    const lg_function_spec function = {"rounds", &in, 1, &out, 1, record_rounds, NULL};
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    lg_plan_options options = plan_options(1, LG_F64);
    options.max_size = (size_t)16 << 20;
    (void)test_plan(test_program(&spec), 0, &options);
}

/* Programs: how they are built, what is refused, recording on a tape, plans. */
#include "program_support.h"

#include "autodiff/ops/op_rows.h"
#include "autodiff/program/plan.h"
#include "liegrad/networks.h"
#include "liegrad/program.h"
#include "liegrad/taped.h"

/* ---- a network with an input gradient ---- */

typedef struct network {
    lg_mlp net;
    double *theta;
} network;

static void make_network(network *n, uint32_t inputs, uint32_t width, uint32_t outputs, lg_activation kind) {
    const uint32_t hidden[2] = {width, width};
    lg_rng rng = test_rng(3, 1);
    assert_ok(lg_mlp_init(&n->net, inputs, hidden, 2, outputs, kind, true));
    n->theta = TEST_ARRAY(double, lg_mlp_parameters(&n->net));
    lg_mlp_initialise(&n->net, &rng, n->theta);
}

RECORDING(record_value) {
    y[0] = lg_mlp_record(tape, user, theta[0], 0, x[0]);
}

static lg_status record_gradient(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = lg_mlp_record(tape, user, theta[0], 0, x[0]);
    return lg_grad(tape, y[0], x, 1, &y[1]);
}

RECORDING(record_loss) {
    y[0] = lg_mean(tape, lg_square(tape, lg_mlp_record(tape, user, theta[0], 0, x[0])));
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
    const lg_program_spec spec = spec_of(&theta, 1, functions, LG_COUNT(functions));
    return test_program(&spec);
}

/* Compares a function of the program on a tape with its recording for `rows` rows, to the last bit. */
static void compare_apply(lg_program *program, size_t function, network *n, lg_record_function record,
                          size_t outputs, size_t rows) {
    lg_rng rng = test_rng(4, rows);
    lg_tape *tape = test_tape(LG_F64);
    double *x = TEST_ARRAY(double, 3 * rows);
    for (size_t i = 0; i < 3 * rows; i++) x[i] = lg_rng_normal(&rng);
    lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta);
    lg_var in = lg_input(tape, lg_shape2((uint32_t)rows, 3), x), want[2], got[2];
    assert_ok(record(&n->net, tape, &theta, &in, want));
    assert_ok(lg_program_record(tape, program, function, &theta, &in, got));
    for (size_t j = 0; j < outputs; j++) {
        const size_t count = lg_shape_count(lg_var_shape(tape, want[j]));
        assert_int_equal(lg_shape_count(lg_var_shape(tape, got[j])), count);
        assert_memory_equal(lg_value(tape, want[j]), lg_value(tape, got[j]), count * sizeof(double));
    }
}

TEST("a program on a tape equals its recording to the last bit") {
    network n;
    make_network(&n, 3, 16, 1, LG_TANH);
    lg_program *program = build_network(&n);
    for (size_t rows = 1; rows <= 4; rows++) {
        compare_apply(program, 0, &n, record_value, 1, rows);
        compare_apply(program, 1, &n, record_gradient, 2, rows);
        compare_apply(program, 2, &n, record_loss, 1, rows);
    }
}

/* ---- derivatives ---- */

/* y = (sin(q u), net(q, u) + q . u): two inputs and two outputs, with every kind of operation that networks
 * and mechanics use. */
enum { Q = 3, U = 2, Y0 = 6, Y1 = 2 };

static lg_status record_pair(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const uint32_t rows = lg_var_shape(tape, in[0]).dims[0];
    lg_var outer = lg_matmul(tape, lg_reshape(tape, in[0], lg_shape3(rows, Q, 1)),
                             lg_reshape(tape, in[1], lg_shape3(rows, 1, U)));
    lg_var both[2] = {in[0], in[1]};
    lg_var net = lg_mlp_record(tape, user, theta[0], 0, lg_concat(tape, both, 2, 1));
    lg_var dot = lg_rowdot(tape, lg_slice(tape, in[0], 1, 0, U), in[1]);
    out[0] = lg_sin(tape, lg_reshape(tape, outer, lg_shape2(rows, Y0)));
    out[1] = lg_add(tape, net, dot);
    return lg_tape_status(tape);
}

static lg_program *build_pair(network *n) {
    static const lg_port in[2] = {{.name = "q", .shape = {1, {Q, 0, 0, 0}}},
                                  {.name = "u", .shape = {1, {U, 0, 0, 0}}}};
    static const lg_port out[2] = {{.name = "a"}, {.name = "b"}};
    const lg_parameter_spec theta = {"theta", lg_shape1((uint32_t)lg_mlp_parameters(&n->net)), n->theta};
    const lg_function_spec function = {"pair", in, 2, out, 2, record_pair, &n->net};
    const lg_program_spec spec = spec_of(&theta, 1, &function, 1);
    return test_program(&spec);
}

/* ---- refused programs and their messages ---- */

RECORDING(identity) {
    y[0] = lg_scale(tape, x[0], 1.0);
}

static uint32_t rows_in(lg_tape *tape, lg_var x) {
    return lg_var_shape(tape, x).dims[0];
}

RECORDING(branch) {
    const double *values = lg_value(tape, x[0]);
    if (values == NULL) return;
    y[0] = values[0] > values[1] ? lg_sin(tape, x[0]) : lg_exp(tape, lg_sin(tape, x[0]));
}

RECORDING(loop_over_rows) {
    lg_var rows[8];
    for (uint32_t r = 0; r < rows_in(tape, x[0]); r++) rows[r] = lg_sin(tape, lg_slice(tape, x[0], 0, r, 1));
    y[0] = lg_concat(tape, rows, rows_in(tape, x[0]), 0);
}

RECORDING(put_back) {
    for (int i = 0; i < 9; i++) lg_scope_push(tape, i == 0 ? "friction" : "deep");
    const lg_var copy = lg_input(tape, lg_var_shape(tape, x[0]), lg_value(tape, x[0]));
    for (int i = 0; i < 9; i++) lg_scope_pop(tape);
    y[0] = lg_mul(tape, x[0], copy);
}

/* Reads the value of a parameter, which is refused too. */
RECORDING(weight_put_back) {
    y[0] = lg_mul(tape, x[0], lg_input(tape, lg_var_shape(tape, theta[0]), lg_value(tape, theta[0])));
}

RECORDING(closed_over) {
    static const double data[5 * 3] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    y[0] = lg_sub(tape, x[0], lg_input(tape, lg_var_shape(tape, x[0]), data));
}

RECORDING(attribute) {
    const double *values = lg_value(tape, x[0]);
    if (values == NULL) return;
    y[0] = lg_scale(tape, x[0], values[0]);
}

RECORDING(coefficients) {
    const lg_var both[2] = {x[0], lg_sin(tape, x[0])};
    const double c[2] = {1.0, (double)rows_in(tape, x[0])};
    y[0] = lg_linear_combination(tape, both, c, 2);
}

RECORDING(quadratic) {
    const uint32_t rows = rows_in(tape, x[0]);
    const lg_var all = lg_reshape(tape, lg_matmul_nt(tape, x[0], x[0]), lg_shape1(rows * rows));
    y[0] = lg_sum(tape, lg_sin(tape, all));
}

RECORDING(square) {
    y[0] = lg_matmul_nt(tape, x[0], x[0]);
}

RECORDING(doubled) {
    const lg_var both[2] = {x[0], x[0]};
    y[0] = lg_concat(tape, both, 2, 0);
}

static lg_status triple_forward(void *user, lg_dtype dtype, const void *const *in, void *y) {
    if (dtype == LG_F64)
        for (size_t i = 0; i < 3; i++) ((double *)y)[i] = 3.0 * ((const double *)in[0])[i];
    return LG_OK;
}

RECORDING(custom) {
    static const lg_custom_op triple = {.name = "triple", .forward = triple_forward};
    y[0] = lg_add(tape, x[0], lg_custom(tape, &triple, &x[1], 1, lg_shape1(3)));
}

static lg_status fall(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                      lg_var *out) {
    out[0] = lg_neg(tape, lg_pow(tape, y[0], 3.0));
    return lg_tape_status(tape);
}

static lg_status implicit(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    lg_taped_ode ode = {.field = fall};
    const lg_space_factor flat = {LG_SPACE_RN, 3};
    lg_status status = lg_space_init(&ode.space, &flat, 1);
    if (status == LG_OK) status = lg_taped_step(tape, lg_scheme_find("midpoint"), &ode, OVER(0.0, 0.1), x, y);
    return status;
}

RECORDING(nothing) {
}

RECORDING(resets) {
    const double one[3] = {1.0, 1.0, 1.0};
    lg_tape_reset(tape);
    y[0] = lg_input(tape, lg_shape1(3), one);
}

static lg_status fails(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    return LG_NO_CONVERGENCE;
}

RECORDING(misfits) {
    y[0] = lg_cross(tape, x[0], lg_slice(tape, x[0], 1, 0, 2));
}

/* ---- recordings with another structure for 5 rows, and attributes that do not follow the rows ---- */

static bool five(lg_tape *tape, lg_var x) {
    return rows_in(tape, x) == 5;
}

RECORDING(short_for_five) {
    y[0] = lg_sin(tape, x[0]);
    if (!five(tape, x[0])) y[0] = lg_exp(tape, y[0]);
}

RECORDING(more_terms) {
    const lg_var parts[2] = {x[0], x[0]};
    y[0] = lg_concat(tape, parts, five(tape, x[0]) ? 2 : 1, 0);
}

RECORDING(other_rank) {
    y[0] = lg_sum_axis(tape, x[0], 1, !five(tape, x[0]));
}

RECORDING(other_operand) {
    const lg_var a = lg_sin(tape, x[0]), b = lg_cos(tape, x[0]);
    y[0] = lg_exp(tape, five(tape, x[0]) ? a : b);
}

RECORDING(other_result) {
    const lg_var a = lg_sin(tape, x[0]), b = lg_cos(tape, x[0]);
    y[0] = five(tape, x[0]) ? a : b;
}

RECORDING(scalar_put_back) {
    const double *values = lg_value(tape, x[0]);
    if (values != NULL) y[0] = lg_mul(tape, x[0], lg_full(tape, lg_shape0(), values[0]));
}

RECORDING(moving_slice) {
    y[0] = lg_slice(tape, x[0], 0, five(tape, x[0]), 1);
}

RECORDING(inverse_square) {
    const double rows = rows_in(tape, x[0]);
    y[0] = lg_scale(tape, x[0], 1.0 / (rows * rows));
}

RECORDING(gathered_rows) {
    static const uint32_t order[8];
    y[0] = lg_gather(tape, theta[0], order, rows_in(tape, x[0]));
}

RECORDING(gathered_from_rows) {
    static const uint32_t order[3] = {0, 1, 1};
    y[0] = lg_gather(tape, lg_reshape(tape, x[0], lg_shape1(3 * rows_in(tape, x[0]))), order, 3);
}

RECORDING(gathered_otherwise) {
    const uint32_t order[3] = {0, 1, five(tape, x[0])};
    y[0] = lg_gather(tape, theta[0], order, 3);
}

/* An operation that no table has. */
RECORDING(unknown_operation) {
    static lg_op unknown;
    unknown = lg_op_sin;
    y[0] = lg_record(tape, &unknown, x, 1, NULL);
}

RECORDING(empty) {
    y[0] = lg_full(tape, lg_shape1(0), 1.0);
}

RECORDING(endless) {
    const double infinite[3] = {1.0, INFINITY, 2.0};
    y[0] = lg_max(tape, x[0], lg_input(tape, lg_shape1(3), infinite));
}

typedef struct refusal {
    lg_record_function record;
    lg_status status;
    const char *words[4];
    const char *function, *input, *other, *output; /* names; NULL: f, x, s, y */
    lg_port port;                                  /* rank 0: the port is x3 */
} refusal;

static lg_status build_one(const refusal *c, lg_program **program, lg_error *error) {
    const double weights[3] = {0.5, 0.25, -1.0};
    const lg_parameter_spec theta = {"theta", lg_shape1(3), weights};
    lg_port in[2] = {c->port.shape.rank > 0 ? c->port : x3, {.shape = {1, {3, 0, 0, 0}}, .shared = true}};
    in[0].name = c->input != NULL ? c->input : "x";
    in[1].name = c->other != NULL ? c->other : "s";
    const lg_port out = {.name = c->output != NULL ? c->output : "y"};
    const lg_function_spec function = {
        c->function != NULL ? c->function : "f", in, 2, &out, 1, c->record, NULL};
    const lg_program_spec spec = spec_of(&theta, 1, &function, 1);
    return lg_program_build(NULL, &spec, program, error);
}

TEST("recordings that depend on numbers or on the number of rows are refused, with the function's name") {
    static const refusal cases[] = {
        {branch, LG_UNSUPPORTED, .words = {"'f'", "branch on values", "sin"}},
        {loop_over_rows, LG_UNSUPPORTED, .words = {"'f'", "loop over rows"}},
        {put_back, LG_UNSUPPORTED, .words = {"'f'", "used by mul", "friction", "values differ"}},
        {weight_put_back, LG_UNSUPPORTED, .words = {"used by mul", "values differ"}},
        {closed_over, LG_UNSUPPORTED, .words = {"used by sub", "values differ", "declare it as an input"}},
        {implicit, LG_UNSUPPORTED, .words = {"solves equations in each step"}},
        {attribute, LG_UNSUPPORTED, .words = {"operation scale", "depends on values"}},
        {coefficients, LG_UNSUPPORTED, .words = {"operation combine", "coefficients"}},
        {quadratic, LG_UNSUPPORTED, .words = {"not affine in the number of rows"}},
        {square, LG_UNSUPPORTED, .words = {"output 'y'", "neither one value per row"}},
        {doubled, LG_UNSUPPORTED, .words = {"output 'y'", "neither one value per row"}},
        {custom, LG_UNSUPPORTED, .words = {"operation custom", "triple", "this process only"}},
        {nothing, LG_INVALID_ARGUMENT, .words = {"has not set output 'y'"}},
        {resets, LG_INVALID_ARGUMENT, .words = {"'f'", "reset the tape"}},
        {fails, LG_NO_CONVERGENCE, .words = {"'f'", "the callback `record` failed"}},
        {misfits, LG_SHAPE, .words = {"'f'", "cross"}},
        {endless, LG_NOT_FINITE, .words = {"'f'", "constant that is not finite"}},
        {short_for_five, LG_UNSUPPORTED, .words = {"different operations", "(exp)"}},
        {more_terms, LG_UNSUPPORTED, .words = {"different operations", "(concat)"}},
        {other_rank, LG_UNSUPPORTED, .words = {"different operations", "(sum)"}},
        {other_operand, LG_UNSUPPORTED, .words = {"different operations", "(exp)"}},
        {other_result, LG_UNSUPPORTED, .words = {"different operations", "(cos)"}},
        {scalar_put_back, LG_UNSUPPORTED, .words = {"used by mul", "values differ"}},
        {moving_slice, LG_UNSUPPORTED, .words = {"slice", "an attribute is not affine"}},
        {inverse_square, LG_UNSUPPORTED, .words = {"scale", "an attribute depends on values"}},
        {gathered_rows, LG_UNSUPPORTED, .words = {"gather", "its indices depend"}},
        {gathered_from_rows, LG_UNSUPPORTED, .words = {"gather", "its indices depend"}},
        {gathered_otherwise, LG_UNSUPPORTED, .words = {"gather", "its indices depend"}},
        {unknown_operation, LG_FORMAT, .words = {"(sin)", "there is no such operation"}},
        {NULL, LG_INVALID_ARGUMENT, .words = {"needs the callback `record`"}},
        {identity, LG_INVALID_ARGUMENT, .words = {"it is empty"}, .function = ""},
        {identity, LG_INVALID_ARGUMENT, .words = {"not a C identifier"}, .function = "a-b"},
        {identity, LG_INVALID_ARGUMENT, .words = {"begin with a letter"}, .function = "_f"},
        {identity, LG_INVALID_ARGUMENT, .words = {"word of C"}, .function = "while"},
        {identity, LG_INVALID_ARGUMENT, .words = {"'2x'", "an input", "begin with a letter"}, .input = "2x"},
        {identity, LG_INVALID_ARGUMENT, .words = {"'x__1'", "two underscores"}, .input = "x__1"},
        {identity, LG_INVALID_ARGUMENT, .words = {"'int'", "an output", "word of C"}, .output = "int"},
        {identity, LG_INVALID_ARGUMENT, .words = {"'y\?'", "not a C identifier"}, .output = "y\n"},
        {identity, LG_INVALID_ARGUMENT, .words = {"two inputs or outputs called 'x'"}, .other = "x"},
        {identity, LG_INVALID_ARGUMENT, .words = {"two inputs or outputs called 's'"}, .output = "s"},
        {identity, LG_INVALID_ARGUMENT, .words = {"'x'", "low must not be above high"},
         .port = {.shape = {1, {3}}, .low = 2.0, .high = 1.0}},
        {identity, LG_SHAPE, .words = {"input 0", "rank (with the axis of rows) is above 4"},
         .port = {.shape = {4, {1, 1, 1, 1}}}},
        {identity, LG_SHAPE, .words = {"input 0", "too large"}, .port = {.shape = {1, {1u << 30}}}},
        {identity, LG_INVALID_ARGUMENT, .words = {"the unit of 'x'"},
         .port = {.shape = {1, {3}}, .unit = "\x7f"}},
        {identity, LG_INVALID_ARGUMENT, .words = {"the unit of 'x'"},
         .port = {.shape = {1, {3}}, .unit = "\t"}},
        {identity, LG_INVALID_ARGUMENT, .words = {"the unit of 'x'"},
         .port = {.shape = {1, {3}}, .unit = "\""}},
        {identity, LG_INVALID_ARGUMENT, .words = {"the unit of 'x'"},
         .port = {.shape = {1, {3}}, .unit = "?"}},
        {identity, LG_INVALID_ARGUMENT, .words = {"the unit of 'x'"},
         .port = {.shape = {1, {3}}, .unit = "a*/"}},
        {identity, LG_INVALID_ARGUMENT, .words = {"the unit of 'x'"},
         .port = {.shape = {1, {3}}, .unit = "/*"}},
        {identity, LG_INVALID_ARGUMENT, .words = {"the unit of 'x'"},
         .port = {.shape = {1, {3}}, .unit = "//"}},
        {identity, LG_OK, .port = {.shape = {1, {3}}, .unit = "m*s/kg*"}},
        {.record = empty, .status = LG_OK},
        {identity, LG_INVALID_ARGUMENT, .words = {"too long"},
         .output = "y12345678901234567890123456789012345678901234567890123456789012345678901234567890"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_error error = {.message = ""};
        lg_program *program = NULL;
        const lg_status status = build_one(&cases[i], &program, &error);
        if (status != cases[i].status) fail_msg("case %zu: %s, %s", i, lg_status_name(status), error.message);
        if (status == LG_OK) lg_test_owns(program, release_program);
        if (status == LG_OK) continue;
        assert_null(program);
        assert_int_equal(error.status, status);
        for (size_t w = 0; w < 4 && cases[i].words[w] != NULL; w++)
            if (strstr(error.message, cases[i].words[w]) == NULL)
                fail_msg("case %zu: '%s' is not in: %s", i, cases[i].words[w], error.message);
        assert_int_equal(build_one(&cases[i], &program, NULL), status); /* NULL instead of an lg_error */
        assert_null(program);
    }
}

TEST("a parameter without values is zero") {
    const lg_port out = {.name = "y"};
    const lg_function_spec function = {"f", &x3, 1, &out, 1, identity, NULL};
    const lg_parameter_spec without = {"w", lg_shape1(3), NULL};
    const lg_program_spec spec = spec_of(&without, 1, &function, 1);
    lg_program *program = test_program(&spec);
    for (int i = 0; i < 3; i++) assert_true(lg_program_parameter(program, 0).values[i] == 0.0);
}

TEST("parameters that are not finite or named twice are refused, and functions named twice") {
    const double numbers[3] = {0.5, NAN, 1.0}, good[3] = {1.0, 2.0, 3.0}, bad[3] = {1.0, -INFINITY, 3.0};
    const lg_port out = {.name = "y"};
    const lg_function_spec function = {"f", &x3, 1, &out, 1, identity, NULL};
    const lg_parameter_spec not_finite = {"w", lg_shape1(3), numbers},
                            twice[2] = {{"w", lg_shape1(3), good}, {"w", lg_shape1(3), good}},
                            named = {"double", lg_shape1(3), good};
    const struct {
        const lg_parameter_spec *specs;
        size_t count;
        lg_status status;
        const char *words;
    } cases[] = {{&not_finite, 1, LG_NOT_FINITE, "'w' has a number that is not finite"},
                 {twice, 2, LG_INVALID_ARGUMENT, "two parameters are called 'w'"},
                 {&named, 1, LG_INVALID_ARGUMENT, "'double' cannot be the name of a parameter"}};
    lg_program_spec spec;
    lg_program *program = NULL;
    lg_error error;
    spec = spec_of(NULL, 0, &function, 1);
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        spec.parameters = cases[i].specs;
        spec.parameter_count = cases[i].count;
        assert_int_equal(lg_program_build(NULL, &spec, &program, &error), cases[i].status);
        if (strstr(error.message, cases[i].words) == NULL) fail_msg("%s", error.message);
        assert_null(program);
    }
    spec = spec_of(twice, 1, NULL, 0);
    assert_status(lg_program_build(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "at least one function");
    spec = spec_of(NULL, 1, &function, 1);
    assert_status(lg_program_build(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "parameter_count is 1, but `parameters` is NULL");
    assert_status(lg_program_begin(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "add functions later");
    assert_null(program);
    const lg_function_spec alike[2] = {function, function};
    spec = spec_of(NULL, 0, alike, 2);
    assert_status(lg_program_build(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "two functions are called 'f'");
    spec = spec_of(twice, 1, &function, 1);
    assert_ok(lg_program_build(NULL, &spec, &program, &error));
    assert_int_equal(lg_program_set_parameter(program, 0, bad), LG_NOT_FINITE);
    assert_memory_equal(lg_program_parameter(program, 0).values, good, sizeof good);
    assert_int_equal(lg_program_set_parameter(program, 1, good), LG_NOT_FOUND);
    assert_null(lg_program_parameter(program, 1).name);
    lg_program_destroy(program);
    spec.size = 8;
    assert_int_equal(lg_program_build(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    lg_program_destroy(NULL);
}

/* ---- refused derivatives; the program stays unchanged ---- */

RECORDING(shared_and_not) {
    y[0] = lg_mul(tape, x[0], x[1]);
    y[1] = lg_mean(tape, lg_square(tape, x[0]));
}

TEST("impossible derivatives are refused, and the program stays unchanged") {
    const lg_port in[2] = {x3, {.name = "s", .shape = {1, {3}}, .shared = true}},
                  out[2] = {{.name = "y"}, {.name = "m"}};
    const lg_function_spec function = {"f", in, 2, out, 2, shared_and_not, NULL};
    const char *const s = "s", *const m = "m", *const x = "x", *const unknown = "q";
    lg_error error;
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    lg_program *program = test_program(&spec);
    const struct {
        lg_derivative_kind kind;
        const char *function, *const *input, *const *output, *name;
        lg_status status;
        const char *words;
    } cases[] = {
        {LG_DERIVATIVE_JACOBIAN, "f", &s, NULL, NULL, LG_UNSUPPORTED, "input 's' is shared"},
        {LG_DERIVATIVE_JACOBIAN, "f", NULL, &m, NULL, LG_UNSUPPORTED, "output 'm' is shared"},
        {LG_DERIVATIVE_JACOBIAN_OF_ADJOINT, "f", &s, NULL, NULL, LG_UNSUPPORTED, "input 's' is shared"},
        {LG_DERIVATIVE_JACOBIAN, "f", &unknown, NULL, NULL, LG_NOT_FOUND, "no input 'q'"},
        {LG_DERIVATIVE_FORWARD, "f", NULL, &unknown, NULL, LG_NOT_FOUND, "no output 'q'"},
        {LG_DERIVATIVE_ADJOINT, "g", NULL, NULL, NULL, LG_NOT_FOUND, "no function 'g'"},
        {LG_DERIVATIVE_ADJOINT, "f", NULL, NULL, "a b", LG_INVALID_ARGUMENT, "not a C identifier"},
        {LG_DERIVATIVE_ADJOINT, "f", &x, NULL, "f", LG_INVALID_ARGUMENT, "two functions are called 'f'"},
        {(lg_derivative_kind)LG_DERIVATIVE_KIND_COUNT, "f", NULL, NULL, NULL, LG_INVALID_ARGUMENT, ""},
        {LG_DERIVATIVE_ADJOINT, NULL, NULL, NULL, NULL, LG_INVALID_ARGUMENT, ""},
    };
    const char *many[64];
    for (size_t i = 0; i < LG_COUNT(many); i++) many[i] = x;
    lg_derivative twice;
    lg_derivative_init(&twice);
    twice.function = "f";
    for (int kind = 0; kind < LG_DERIVATIVE_KIND_COUNT; kind++)
        for (twice.input_count = 2; twice.input_count <= 64; twice.input_count += 62) {
            twice.kind = (lg_derivative_kind)kind;
            twice.inputs = many;
            assert_status(lg_program_derive(program, &twice, &error), LG_INVALID_ARGUMENT);
            assert_says(error.message, "input 'x' is named twice");
        }
    twice.input_count = 0;
    assert_status(lg_program_derive(program, &twice, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "the derivative has no input");
    twice.size = 1;
    assert_status(lg_program_derive(program, &twice, &error), LG_INVALID_ARGUMENT);
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_derivative what;
        lg_derivative_init(&what);
        what.kind = cases[i].kind;
        what.function = cases[i].function;
        what.name = cases[i].name;
        what.inputs = cases[i].input;
        what.input_count = cases[i].input != NULL;
        what.outputs = cases[i].output;
        what.output_count = cases[i].output != NULL;
        const lg_status status = lg_program_derive(program, &what, &error);
        if (status != cases[i].status) fail_msg("case %zu: %s", i, lg_status_name(status));
        if (strstr(error.message, cases[i].words) == NULL) fail_msg("case %zu: %s", i, error.message);
        assert_int_equal(lg_program_functions(program), 1);
    }
    /* By default a Jacobian leaves out shared inputs and outputs; forward and adjoint derivatives include
     * them. */
    size_t count;
    (void)derived(program, LG_DERIVATIVE_JACOBIAN, "f");
    (void)lg_program_outputs(program, lg_program_functions(program) - 1, &count);
    assert_int_equal(count, 1);
    (void)derived(program, LG_DERIVATIVE_ADJOINT, "f");
    const lg_port *port = lg_program_outputs(program, lg_program_functions(program) - 1, &count);
    assert_int_equal(count, 2);
    assert_string_equal(port[1].name, "adj_s");
    assert_true(port[1].shared);
    /* The derivative by two directions, and the adjoint of an adjoint. */
    (void)derived(program, LG_DERIVATIVE_FORWARD, "f");
    (void)derived(program, LG_DERIVATIVE_FORWARD, "fwd1_f");
    port = lg_program_inputs(program, lg_program_functions(program) - 1, &count);
    assert_int_equal(count, 8);
    assert_string_equal(port[2].name, "fwd_x");
    assert_string_equal(port[4].name, "fwd2_x");
    assert_string_equal(port[6].name, "fwd2_fwd_x");
    (void)derived(program, LG_DERIVATIVE_ADJOINT, "adj1_f");
    port = lg_program_outputs(program, lg_program_functions(program) - 1, &count);
    assert_string_equal(port[0].name, "adj2_x");
}

/* Rows affect each other, and the inputs without a range that are tried all give NaN. */
RECORDING(centred_root) {
    const lg_var root = lg_sqrt(tape, lg_add_scalar(tape, x[0], -2.0));
    y[0] = lg_sub(tape, root, lg_mean_axis(tape, root, 0, true));
}

RECORDING(centred) {
    y[0] = lg_sub(tape, x[0], lg_mean_axis(tape, x[0], 0, true));
}

TEST("a Jacobian is refused if rows affect each other") {
    const lg_port out = {.name = "y"};
    const lg_function_spec functions[] = {{"centred", &x3, 1, &out, 1, centred, NULL},
                                          {"centred_root", &x3, 1, &out, 1, centred_root, NULL}};
    lg_derivative what;
    lg_error error;
    const lg_program_spec spec = spec_of(NULL, 0, functions, 2);
    lg_program *program = test_program(&spec);
    lg_derivative_init(&what);
    what.kind = LG_DERIVATIVE_JACOBIAN;
    what.function = "centred_root";
    assert_int_equal(lg_program_derive(program, &what, &error), LG_UNSUPPORTED);
    assert_says(error.message, "NaN");
    what.function = "centred";
    assert_int_equal(lg_program_derive(program, &what, &error), LG_UNSUPPORTED);
    assert_says(error.message, "a row of output 'y' depends on other rows");
    what.kind = LG_DERIVATIVE_JACOBIAN_OF_ADJOINT;
    assert_int_equal(lg_program_derive(program, &what, &error), LG_UNSUPPORTED);
    what.kind = LG_DERIVATIVE_ADJOINT;
    assert_ok(lg_program_derive(program, &what, &error));
}

/* ---- errors while recording on a tape ---- */

TEST("on a tape the first error stays, and outputs are not written") {
    network n;
    make_network(&n, 3, 4, 1, LG_TANH);
    lg_program *program = build_network(&n);
    const double zeros[8] = {0.0};
    for (int c = 0; c < 5; c++) {
        lg_tape *tape = test_tape(LG_F64);
        lg_var x = lg_input(tape, c == 0 ? lg_shape2(2, 4) : c == 1 ? lg_shape1(3) : lg_shape2(2, 3), zeros);
        lg_var theta = c == 2 ? lg_input(tape, lg_shape1(5), zeros)
                              : lg_input(tape, lg_shape1((uint32_t)lg_mlp_parameters(&n.net)), n.theta);
        const lg_var mark = {77, 78};
        lg_var y = mark;
        if (c == 4) {
            lg_tape_reset(tape);
        }
        const lg_status expected = c == 3 ? LG_NOT_FOUND : c == 4 ? LG_STALE_HANDLE : LG_SHAPE;
        assert_int_equal(lg_program_record(tape, program, c == 3 ? 99 : 0, &theta, &x, &y), expected);
        assert_int_equal(lg_tape_status(tape), expected);
        assert_true(strlen(lg_tape_message(tape)) > 0);
        assert_memory_equal(&y, &mark, sizeof y);
        assert_int_equal(lg_program_record(tape, program, 0, &theta, &x, &y), expected); /* the error stays */
        assert_memory_equal(&y, &mark, sizeof y);
    }
}

/* ---- work that depends only on parameters is done once ---- */

RECORDING(scaled) {
    y[0] = lg_mul(tape, x[0], lg_exp(tape, theta[0]));
}

/* Whether a step of the plan is this operation, or contains it as scalar code. */
static bool computes(const lg_plan *plan, const lg_op *op, lg_scalar_op code) {
    for (size_t s = 0; s < plan->steps; s++) {
        const lg_plan_step *step = &plan->step[s];
        if (step->kind == LG_STEP_TENSOR && step->tensor.op == op) return true;
        for (uint32_t g = 0; step->kind == LG_STEP_SCALARS && g < step->scalars.groups; g++)
            if (step->scalars.group[g].op == code) return true;
    }
    return false;
}

static const double logarithms[3] = {0.5, -1.0, 2.0}, x_at[3] = {1.0, 2.0, -3.0};
static const lg_parameter_spec three_logarithms = {"theta", {.rank = 1, .dims = {3}}, logarithms};

/* A program with one function of x (3). */
static lg_program *program_of(lg_record_function record) {
    const lg_port out = {.name = "y"};
    const lg_function_spec function = {"f", &x3, 1, &out, 1, record, NULL};
    const lg_program_spec spec = spec_of(&three_logarithms, 1, &function, 1);
    return test_program(&spec);
}

TEST("results that depend only on parameters are computed once") {
    lg_program *program = program_of(scaled);
    lg_plan *plan;
    lg_error error;
    double y[3];
    unsigned char pattern[9];
    assert_int_equal(lg_program_operations(program, 0), 2);
    assert_ok(lg_plan_create(program, 0, NULL, &plan, &error));
    assert_false(computes(plan, &lg_op_exp, LG_S_EXP));
    assert_true(computes(plan, &lg_op_mul, LG_S_MUL));
    void *work = lg_test_memory(lg_plan_work_size(plan));
    lg_plan_eval(plan, (const void *const[]){x_at}, (void *const[]){y}, work);
    for (size_t i = 0; i < 3; i++) assert_close(y[i], x_at[i] * exp(logarithms[i]), 1e-15, 0);
    lg_plan_destroy(plan);
    assert_ok(lg_program_sparsity(program, 0, 0, 0, pattern, &error));
    for (size_t i = 0; i < 9; i++) assert_int_equal(pattern[i], i % 4 == 0);
}

RECORDING(left_over) {
    const lg_var zero = lg_full(tape, lg_shape1(1), 0.0);
    y[0] = lg_add(tape, lg_cos(tape, x[0]), lg_mul(tape, lg_sin(tape, x[0]), zero));
}

TEST("values that are not needed after simplification are not computed") {
    lg_plan *plan;
    lg_error error;
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.compact = true;
    assert_ok(lg_plan_create(program_of(left_over), 0, &options, &plan, &error));
    assert_true(computes(plan, &lg_op_cos, LG_S_COS));
    assert_false(computes(plan, &lg_op_sin, LG_S_SIN));
    lg_plan_destroy(plan);
}

TEST("output a_{2i+j} = sin(q_i u_j) uses one element each of q and u; b = net(q, u) + q . u uses all") {
    network n;
    make_network(&n, Q + U, 10, Y1, LG_TANH);
    /* zero weights do not hide a dependence */
    memset(n.theta, 0, lg_mlp_parameters(&n.net) * sizeof *n.theta);
    lg_program *program = build_pair(&n);
    unsigned char by_q[Y0 * Q], by_u[Y0 * U], all[Y1 * Q];
    lg_error error;
    assert_ok(lg_program_sparsity(program, 0, 0, 0, by_q, &error));
    assert_ok(lg_program_sparsity(program, 0, 0, 1, by_u, &error));
    assert_ok(lg_program_sparsity(program, 0, 1, 0, all, &error));
    for (size_t a = 0; a < Y0; a++) {
        for (size_t i = 0; i < Q; i++) assert_int_equal(by_q[a * Q + i], a / U == i);
        for (size_t j = 0; j < U; j++) assert_int_equal(by_u[a * U + j], a % U == j);
    }
    for (size_t i = 0; i < Y1 * Q; i++) assert_int_equal(all[i], 1);
    assert_int_equal(lg_program_sparsity(program, 0, 2, 0, all, &error), LG_NOT_FOUND);
    assert_int_equal(lg_program_sparsity(program, 0, 0, 2, all, &error), LG_NOT_FOUND);
    assert_int_equal(lg_program_sparsity(program, 1, 0, 0, all, &error), LG_NOT_FOUND);
}

/* ---- limits of programs ---- */

TEST("specifications with wrong sizes, counts and lengths are refused") {
    lg_port many[65];
    char name[65][8], text[4098];
    const lg_port out = {.name = "y"};
    lg_program *program = NULL;
    lg_error error;
    for (size_t i = 0; i < LG_COUNT(many); i++) {
        (void)snprintf(name[i], sizeof name[i], "x%zu", i);
        many[i] = (lg_port){.name = name[i], .shape = lg_shape1(3)};
    }
    memset(text, 'a', sizeof text - 1);
    text[sizeof text - 1] = '\0';
    const lg_function_spec functions[] = {
        {"f", NULL, 1, &out, 1, identity, NULL},  {"f", &x3, 1, NULL, 1, identity, NULL},
        {"f", &x3, 0, &out, 1, identity, NULL},   {"f", &x3, 1, &out, 0, identity, NULL},
        {"f", many, 65, &out, 1, identity, NULL}, {"f", &x3, 1, many, 65, identity, NULL}};
    for (size_t i = 0; i < LG_COUNT(functions); i++) {
        const lg_program_spec spec = spec_of(NULL, 0, &functions[i], 1);
        assert_status(lg_program_build(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "1 to 64 inputs and 1 to 64 outputs");
    }
    lg_program_spec spec = spec_of(NULL, 0, functions, 0);
    assert_status(lg_program_build(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    spec.description = text;
    assert_status(lg_program_begin(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "more than 4095 bytes");
    spec.size = 8;
    assert_status(lg_program_begin(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    assert_null(program);
}

RECORDING(first_of) {
    y[0] = lg_sin(tape, x[0]);
}

TEST("a program has at most 256 functions and parameters, and a derivative at most 64 inputs and outputs") {
    static char name[300][8];
    static lg_port many[64];
    static lg_parameter_spec parameters[257];
    const lg_port out[] = {{.name = "y"}};
    lg_program *program = NULL;
    lg_program_spec spec;
    lg_derivative what;
    lg_error error;
    lg_program_spec_init(&spec);
    for (size_t i = 0; i < LG_COUNT(name); i++) (void)snprintf(name[i], sizeof name[i], "a%zu", i);
    for (size_t i = 0; i < LG_COUNT(parameters); i++)
        parameters[i] = (lg_parameter_spec){.name = name[i], .shape = lg_shape1(1)};
    for (size_t i = 0; i < LG_COUNT(many); i++) many[i] = (lg_port){.name = name[i], .shape = lg_shape1(1)};
    spec.parameters = parameters;
    spec.parameter_count = LG_COUNT(parameters);
    assert_status(lg_program_begin(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "at most 256 parameters");
    parameters[0].shape = (lg_shape){.rank = 5};
    assert_status(lg_program_begin(NULL, &spec, &program, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "its rank is above 4");
    spec.parameter_count = 0;
    assert_ok(lg_program_begin(NULL, &spec, &program, &error));
    lg_test_owns(program, release_program);
    lg_function_spec f = {"f", many, 64, out, 1, first_of, NULL};
    assert_ok(lg_program_add_function(program, &f, &error));
    lg_derivative_init(&what);
    what.function = "f";
    for (int kind = 0; kind < LG_DERIVATIVE_KIND_COUNT; kind++) {
        what.kind = (lg_derivative_kind)kind;
        assert_status(lg_program_derive(program, &what, &error),
                      kind == LG_DERIVATIVE_JACOBIAN ? LG_OK : LG_INVALID_ARGUMENT);
        if (kind != LG_DERIVATIVE_JACOBIAN) assert_says(error.message, "more than 64 inputs or outputs");
    }
    const char *paths[64];
    for (size_t i = 0; i < LG_COUNT(paths); i++) paths[i] = "y";
    const lg_loop_spec loop = {sizeof loop, "loop", "f", 2, NULL, 0, paths, LG_COUNT(paths)};
    assert_status(lg_program_add_loop(program, &loop, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "more than 64 outputs");
    f.input_count = 1;
    while (lg_program_functions(program) < 256) {
        f.name = name[lg_program_functions(program)];
        assert_ok(lg_program_add_function(program, &f, &error));
    }
    f.name = "last";
    assert_status(lg_program_add_function(program, &f, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "at most 256 functions");
    assert_null(lg_program_function_name(program, 256));
    assert_int_equal(lg_program_operations(program, 256), 0);
}

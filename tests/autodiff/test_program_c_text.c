/* The C text of a program is complete or refused: when memory ends, and when a number does not fit the
 * type.
 * ctest-labels: src/autodiff src/kernels */
#include "program_support.h"

#include "autodiff/program/program.h"
#include "autodiff/program/program_c.h"
#include "autodiff/ops/op_rows.h"
#include "gradcheck/cases.h"
#include "liegrad/networks.h"

/* ---- a program with all kinds of code ---- */

/* Blocks of scalar code that pass numbers on to each other, functions of an angle, constants. */
RECORDING(scalars) {
    const lg_attr attr = {.i = {4, 0, 0, 0}};
    lg_var z = x[0];
    for (int i = 0; i < 14; i++)
        z = lg_add(tape, lg_sin(tape, lg_mul(tape, z, x[1])),
                   lg_scale(tape, lg_act(tape, z, LG_TANH), 0.1 * i));
    y[0] = lg_add(tape, z, lg_cos(tape, z));
    y[1] = lg_record(tape, &lg_op_stumpff, &x[1], 1, &attr);
    y[2] = lg_max(tape, lg_pow(tape, lg_abs(tape, x[0]), 1.3), lg_atan2(tape, x[0], x[1]));
}

/* Tables of weights and indices, loops over tensors of different shapes, a network with its gradient. */
RECORDING(tensors) {
    static const uint32_t order[5] = {3, 1, 4, 0, 2}, other[5] = {0, 0, 4, 4, 2}, few[2] = {2, 1};
    const lg_var mixed =
        lg_add(tape, lg_gather(tape, theta[1], order, 5), lg_gather(tape, theta[1], other, 5));
    const lg_var more = lg_add(tape, mixed, lg_sum(tape, lg_gather(tape, theta[1], few, 2)));
    const lg_var wide = lg_mul(tape, lg_mul(tape, x[0], more), x[1]);
    y[0] = lg_act(tape, lg_sub(tape, wide, theta[1]), LG_SIGMOID);
    const lg_var flat = lg_reshape(tape, wide, lg_shape2(lg_var_shape(tape, wide).dims[0], 20));
    y[1] = lg_mlp_record(tape, user, theta[0], 0, flat);
    (void)lg_grad(tape, y[1], x, 1, &y[2]);
}

RECORDING(step) {
    y[0] = lg_mul(tape, lg_sin(tape, x[0]), lg_mul(tape, x[1], theta[1]));
    y[1] = lg_add(tape, x[1], lg_scale(tape, x[0], 0.25));
}

RECORDING(calls) {
    lg_var at[2] = {x[0], x[1]};
    for (int i = 0; i < 3; i++) at[i % 2] = lg_program_call(tape, "step", (size_t)i % 2, at);
    y[0] = lg_add(tape, at[0], at[1]);
}

/* A call with more arguments than fit on one line of C. */
RECORDING(sum) {
    y[0] = lg_concat(tape, x, LG_PROGRAM_MAX_PORTS / 2, 1);
}

static lg_program *all_kinds(const lg_context *context) {
    static char name[LG_PROGRAM_MAX_PORTS / 2][16];
    static lg_port many[LG_PROGRAM_MAX_PORTS / 2];
    static const lg_port angles[2] = {{.name = "x", .shape = {2, {8, 1, 0, 0}}, .unit = "m"},
                                      {.name = "w", .shape = {2, {8, 1, 0, 0}}, .unit = "1/s"}};
    static const lg_port grid[2] = {{.name = "grid", .shape = {2, {4, 5, 0, 0}}},
                                    {.name = "row", .shape = {2, {4, 1, 0, 0}}}};
    static const lg_port state[2] = {{.name = "q", .shape = {1, {5, 0, 0, 0}}},
                                     {.name = "p", .shape = {1, {5, 0, 0, 0}}}};
    static const lg_port out[3] = {
        {.name = "first", .unit = "\xc2\xb5m"}, {.name = "second"}, {.name = "third"}};
    static const lg_carry carry[2] = {{"first", "q"}, {"second", "p"}};
    static const uint32_t hidden[1] = {6};
    static lg_mlp net;
    lg_program *program = NULL;
    lg_rng rng = test_rng(9, 2);
    assert_ok(lg_mlp_init(&net, 20, hidden, 1, 1, LG_SWISH, true));
    double *theta = TEST_ARRAY(double, lg_mlp_parameters(&net));
    lg_mlp_initialise(&net, &rng, theta);
    for (size_t i = 0; i < LG_COUNT(many); i++) {
        (void)snprintf(name[i], sizeof name[i], "part_%zu", i);
        many[i] = (lg_port){.name = name[i], .shape = lg_shape1(2)};
    }
    const lg_parameter_spec parameters[2] = {{"theta", lg_shape1((uint32_t)lg_mlp_parameters(&net)), theta},
                                             {"scale", lg_shape1(5), test_numbers(3, 5, -1, 1)}};
    const lg_function_spec functions[] = {{"scalars", angles, 2, out, 3, scalars, NULL},
                                          {"tensors", grid, 2, out, 3, tensors, &net},
                                          {"step", state, 2, out, 2, step, NULL},
                                          {"calls", state, 2, out, 1, calls, NULL},
                                          {"sum", many, LG_COUNT(many), out, 1, sum, NULL}};
    const lg_program_spec spec = spec_of(parameters, 2, functions, LG_COUNT(functions));
    const char *const path[] = {"first"};
    const lg_loop_spec loop = {sizeof loop, "loop", "step", 7, carry, 2, path, 1};
    assert_told(lg_program_build(context, &spec, &program, &told) != LG_OK ||
                lg_program_add_loop(program, &loop, &told));
    return program;
}

/* ---- writing the C text ---- */

static void assert_same_source(const lg_c_source *a, const lg_c_source *b) {
    assert_string_equal(a->sizes, b->sizes);
    assert_string_equal(a->declarations, b->declarations);
    assert_string_equal(a->arrays, b->arrays);
    assert_string_equal(a->code, b->code);
    assert_string_equal(a->weights, b->weights);
    assert_int_equal(a->functions, b->functions);
    assert_int_equal(a->stack_size, b->stack_size);
}

/* Makes each allocation fail, alone and with all later ones. The result must be an error with nothing
 * allocated, or the complete text `whole`. */
static void write_where_memory_ends(lg_fail_alloc *memory, const lg_program *program, const lg_c_options *how,
                                    long *failures) {
    lg_c_source *whole = NULL;
    lg_error error = {LG_OK, ""};
    const lg_status undisturbed = lg_program_write_c(program, how, &whole, &error);
    if (undisturbed == LG_UNSUPPORTED) return;
    if (undisturbed != LG_OK) fail_msg("%s", error.message);
    bool hit = true;
    for (long n = 2; hit; n++) {
        lg_c_source *source = NULL;
        (n % 2 == 0 ? lg_fail_alloc_arm : lg_fail_alloc_arm_end)(memory, n / 2);
        const lg_status status = lg_program_write_c(program, how, &source, &error);
        hit = lg_fail_alloc_hit(memory);
        if (status == LG_OK)
            assert_same_source(source, whole);
        else
            assert_null(source);
        if (hit) assert_status(status, LG_OUT_OF_MEMORY);
        lg_c_source_destroy(source);
        assert_int_equal(lg_fail_alloc_live(memory), 0);
        *failures += hit;
    }
    lg_fail_alloc_arm(memory, 0);
    lg_c_source_destroy(whole);
}

static void write_both_forms(lg_fail_alloc *memory, const lg_program *program, lg_c_options *how,
                             long *failures) {
    how->size = sizeof *how;
    how->name = "p";
    for (int compact = 0; compact < 2; compact++) {
        how->compact = compact == 1;
        write_where_memory_ends(memory, program, how, failures);
    }
}

TEST("a program with scalars, tensors, calls and loops is written completely or not at all") {
    static lg_fail_alloc memory; /* until the program is released, after the test */
    lg_context *context = lg_fail_alloc_context(&memory);
    assert_non_null(context);
    lg_test_owns(context, release_context);
    lg_program *program = all_kinds(context);
    lg_test_owns(program, release_program);
    static const size_t chosen[2] = {3, 1};
    static const char *const names[2] = {NULL, "other"};
    static const bool hidden[2] = {false, true};
    lg_c_options how[] = {{.mark_unfit = true},
                          {.mark_unfit = true, .dtype = LG_F32},
                          {.functions = chosen, .function_count = 2, .names = names, .hidden = hidden}};
    long failures = 0;
    for (size_t i = 0; i < LG_COUNT(how); i++) write_both_forms(&memory, program, &how[i], &failures);
    assert_true(failures > 2000);
    print_message("%ld failing allocations\n", failures);
}

/* ---- a program for every operation ---- */

static lg_status record_row(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_gradcheck_function *f = user;
    y[0] = f->build(f->user, tape, x);
    return lg_tape_status(tape);
}

static lg_status add_row(lg_program *program, const lg_gradcheck_function *f) {
    lg_port in[LG_GRADCHECK_MAX_INPUTS];
    static const char *const names[] = {"a", "b", "c", "d", "e", "f", "g", "h", "i", "j", "k", "l"};
    const lg_port out = {.name = "y"};
    for (uint32_t k = 0; k < f->inputs; k++)
        in[k] = (lg_port){.name = names[k],
                          .shape = f->arguments[k].shape,
                          .shared = true,
                          .low = f->arguments[k].low,
                          .high = f->arguments[k].high};
    const lg_function_spec spec = {"value", in, f->inputs, &out, 1, record_row, (void *)f};
    return lg_program_record_function(program, &spec, false, NULL);
}

TEST("every operation of the table is written completely or not at all") {
    static lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    assert_non_null(context);
    lg_test_owns(context, release_context);
    long failures = 0;
    for (size_t i = 0; lg_gradcheck_operation(i) != NULL; i++) {
        lg_program *program = NULL;
        lg_c_options how = {.dtype = i % 2 == 0 ? LG_F64 : LG_F32};
        assert_ok(lg_program_create(context, &program));
        if (add_row(program, &lg_gradcheck_operation(i)->function) == LG_OK)
            write_both_forms(&memory, program, &how, &failures);
        lg_program_destroy(program);
    }
    print_message("%ld failing allocations\n", failures);
}

/* ---- numbers that a float cannot hold ---- */

RECORDING(scaled) {
    y[0] = lg_scale(tape, x[0], 1e300);
}

RECORDING(raised) {
    y[0] = lg_pow(tape, x[0], 1e39);
}

RECORDING(combined) {
    static const double c[2] = {1, -1e200};
    y[0] = lg_linear_combination(tape, (const lg_var[2]){x[0], lg_sin(tape, x[0])}, c, 2);
}

RECORDING(weighted) {
    y[0] = lg_add(tape, x[0], theta[0]);
}

RECORDING(called) {
    y[0] = lg_program_call(tape, "value", 0, x);
}

TEST("a constant that a float cannot hold is refused wherever it occurs") {
    static const lg_record_function records[] = {scaled, raised, combined, weighted};
    static const lg_port in = {.name = "x", .shape = {1, {3, 0, 0, 0}}}, out = {.name = "y"};
    static const double large[3] = {1, 1e39, 1};
    const lg_parameter_spec theta = {"theta", lg_shape1(3), large};
    for (size_t i = 0; i < LG_COUNT(records); i++) {
        const lg_function_spec functions[2] = {{"value", &in, 1, &out, 1, records[i], NULL},
                                               {"called", &in, 1, &out, 1, called, NULL}};
        const lg_program_spec spec = spec_of(&theta, 1, functions, 2);
        const lg_program *program = test_program(&spec);
        for (size_t way = 0; way < 8; way++) {
            const size_t function = way / 4;
            const lg_c_options how = {.size = sizeof how,
                                      .name = "p",
                                      .dtype = way % 2 == 0 ? LG_F32 : LG_F64,
                                      .compact = way / 2 % 2 == 1,
                                      .functions = &function,
                                      .function_count = 1};
            lg_c_source *source = NULL;
            assert_status(lg_program_write_c(program, &how, &source, NULL),
                          how.dtype == LG_F32 ? LG_NOT_FINITE : LG_OK);
            lg_c_source_destroy(source);
        }
    }
}

/* ---- names and lines ---- */

RECORDING(doubled) {
    y[0] = lg_scale(tape, x[0], 2.0);
}

TEST("names that C cannot have are refused, and arguments that could be macros get an underscore") {
    static const struct {
        const char *title;
        lg_status status;
    } titles[] = {{"good", LG_OK},
                  {"Good_1", LG_OK},
                  {"MACRO", LG_INVALID_ARGUMENT},
                  {"real", LG_INVALID_ARGUMENT},
                  {"weights", LG_INVALID_ARGUMENT},
                  {"f_WORK_SIZE", LG_INVALID_ARGUMENT},
                  {"a b", LG_INVALID_ARGUMENT},
                  {"", LG_INVALID_ARGUMENT},
                  {"{}", LG_INVALID_ARGUMENT}};
    static const char *const inputs[][2] = {{"x", "*x,"},        {"X", "*X_,"},     {"X2", "*X2_,"},
                                            {"work", "*work_,"}, {"p_x", "*p_x_,"}, {"px", "*px,"}};
    const lg_port out = {.name = "y", .unit = ""};
    const size_t zero = 0, five = 5;
    lg_c_source *source = NULL;
    lg_error error;
    lg_c_options how;
    for (size_t i = 0; i < LG_COUNT(inputs); i++) {
        const lg_port in = {.name = inputs[i][0], .shape = lg_shape1(3), .unit = ""};
        const lg_function_spec f = {"f", &in, 1, &out, 1, doubled, NULL};
        const lg_program_spec spec = spec_of(NULL, 0, &f, 1);
        const lg_program *program = test_program(&spec);
        lg_c_options_init(&how);
        how.name = "p";
        assert_told(lg_program_write_c(program, &how, &source, &told));
        assert_says(source->declarations, inputs[i][1]);
        lg_c_source_destroy(source);
        source = NULL;
        how.names = (const char *const[]){"MACRO"}; /* not read without a list of functions */
        how.hidden = (const bool[]){true};
        assert_told(lg_program_write_c(program, &how, &source, &told));
        assert_says(source->declarations, "p_f(");
        lg_c_source_destroy(source);
        source = NULL;
        how.function_count = 1;
        how.functions = &zero;
        for (size_t k = 0; k < LG_COUNT(titles); k++) {
            how.names = &titles[k].title;
            assert_status(lg_program_write_c(program, &how, &source, &error), titles[k].status);
            if (titles[k].status != LG_OK) assert_says(error.message, "cannot be used in C");
            lg_c_source_destroy(source);
            source = NULL;
        }
        how.functions = &five;
        assert_status(lg_program_write_c(program, &how, &source, &error), LG_NOT_FOUND);
        how.dtype = (lg_dtype)7;
        assert_status(lg_program_write_c(program, &how, &source, &error), LG_INVALID_ARGUMENT);
        how = (lg_c_options){.size = 1, .name = "p"};
        assert_status(lg_program_write_c(program, &how, &source, &error), LG_INVALID_ARGUMENT);
        how = (lg_c_options){.size = sizeof how};
        assert_status(lg_program_write_c(program, &how, &source, &error), LG_INVALID_ARGUMENT);
        how.name = "a b";
        assert_status(lg_program_write_c(program, &how, &source, &error), LG_INVALID_ARGUMENT);
        assert_null(source);
    }
}

/* A line of `count` words that are separated by `gap`. */
static const char *line_of(size_t count, const char *gap) {
    char *line = test_text("%*s", (int)(count * 8), "");
    size_t at = 0;
    for (size_t i = 0; i < count; i++) at += (size_t)snprintf(line + at, 9, "w%02zu%s", i, gap);
    return line;
}

TEST("long lines are broken behind commas, otherwise at blanks, and nowhere else") {
    static const char *const gaps[] = {", ", " + ", " (* ", "_", " "};
    for (size_t g = 0; g < LG_COUNT(gaps); g++) {
        const char *line = line_of(60, gaps[g]);
        lg_text text = {.context = NULL};
        lg_c_add_line(&text, 1, line, strlen(line));
        assert_false(text.failed);
        const char *from = text.data, *next = line;
        size_t lines = 0;
        for (const char *end; (end = strchr(from, '\n')) != NULL; from = end + 1, lines++) {
            const size_t indent = strspn(from, " ");
            assert_int_equal(indent, lines == 0 ? 4 : 12);
            if (g != 3) assert_true(end - from <= 110);
            if (g == 0 && end[1] != '\0') assert_true(end[-1] == ',');
            for (const char *c = from + indent; c < end; c++, next++) {
                while (*next == ' ' && *c != ' ') next++;
                assert_int_equal(*c, *next);
            }
        }
        assert_int_equal(strspn(next, " "), strlen(next));
        assert_true(g == 3 ? lines == 1 : lines > 2);
        lg_text_destroy(&text);
    }
    assert_true(lg_c_uses("work[0] = y", "work") && lg_c_uses("y = work", "work"));
    assert_true(lg_c_uses("homework + work", "work"));
    assert_false(lg_c_uses("homework + work2", "work"));
    assert_false(lg_c_uses("work2", "work"));
}

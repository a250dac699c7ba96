/* Calls between the functions of a program: the same numbers as without calls, only one copy of the called
 * function, refusals. */
#include "program_support.h"

#include "autodiff/program/plan.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"

/* product(x, y) = (x . y, theta x o y); thrice(x, y) = p(p(p(x))) with p(x) = theta x o y. "o" multiplies
 * elementwise. */
static lg_status product(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user;
    lg_var both = lg_mul(tape, x[0], x[1]);
    y[0] = lg_rowdot(tape, x[0], x[1]);
    y[1] = lg_mul(tape, both, theta[0]);
    return lg_tape_status(tape);
}

static lg_status other(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    (void)user, (void)theta;
    y[0] = lg_sin(tape, x[0]);
    return lg_tape_status(tape);
}

typedef struct way {
    bool calls;
    const char *function;
    size_t output;
} way;

static lg_status thrice(void *user, lg_tape *tape, const lg_var *theta, const lg_var *x, lg_var *y) {
    const way *w = user;
    lg_var at[2] = {x[0], x[1]}, both[2];
    for (int i = 0; i < 3; i++) {
        if (w->calls)
            at[0] = lg_program_call(tape, w->function, w->output, at);
        else if (product(NULL, tape, theta, at, both) == LG_OK)
            at[0] = both[1];
    }
    y[0] = lg_add(tape, at[0], x[0]);
    return lg_tape_status(tape);
}

static const lg_port pair[2] = {{.name = "x", .shape = {1, {4, 0, 0, 0}}},
                                {.name = "y", .shape = {1, {4, 0, 0, 0}}}};
static const lg_port results[2] = {{.name = "dot"}, {.name = "both"}};
static const double weights[4] = {0.5, -1.5, 2.0, 0.25};

static lg_status build(way *w, lg_program **out, lg_error *error) {
    const lg_parameter_spec theta = {"theta", lg_shape1(4), weights};
    const lg_function_spec functions[] = {{"other", pair, 1, results, 1, other, NULL},
                                          {"product", pair, 2, results, 2, product, NULL},
                                          {"thrice", pair, 2, results, 1, thrice, w}};
    const lg_program_spec spec = spec_of(&theta, 1, functions, LG_COUNT(functions));
    return lg_program_build(NULL, &spec, out, error);
}

static lg_program *built(bool calls) {
    way w = {calls, "product", 1};
    lg_program *program = NULL;
    assert_told(build(&w, &program, &told));
    lg_test_owns(program, release_program);
    return program;
}

static const double x[2][12] = {{1, 2, 3, 4, -1, 0.5, 7, 2, 0.1, 0.2, 0.3, 0.4},
                                {2, -1, 0.5, 3, 1, 1, 1, 1, -2, 4, 0.25, 9}};

/* Computes output 0 of `function` for `rows` rows. Returns the depth of its plan. */
static size_t values_of(lg_program *program, size_t function, size_t rows, lg_dtype dtype, bool calls,
                        double *y) {
    lg_plan_options options;
    lg_plan *plan;
    float single[2][12], ys[256];
    lg_plan_options_init(&options);
    options.rows = rows;
    options.dtype = dtype;
    options.calls = calls;
    assert_told(lg_plan_create(program, function, &options, &plan, &told));
    void *work = aligned_alloc(64, lg_plan_work_size(plan));
    for (size_t i = 0; i < 24; i++) single[i / 12][i % 12] = (float)x[i / 12][i % 12];
    const void *in[2] = {dtype == LG_F64 ? (const void *)x[0] : single[0],
                         dtype == LG_F64 ? (const void *)x[1] : single[1]};
    void *out[2] = {dtype == LG_F64 ? (void *)y : ys, NULL};
    lg_plan_eval(plan, in, out, work);
    for (size_t i = 0; dtype == LG_F32 && i < lg_plan_output_count(plan, 0); i++) y[i] = (double)ys[i];
    const size_t depth = plan->depth;
    free(work);
    lg_plan_destroy(plan);
    return depth;
}

static void assert_equal_functions(lg_program *a, lg_program *b, size_t function, size_t rows, size_t count) {
    double want[256] = {0}, got[256] = {1};
    for (int k = 0; k < 4; k++) {
        const bool single = k % 2 == 1, calls = k / 2 == 1;
        const lg_dtype dtype = single ? LG_F32 : LG_F64;
        const size_t depth = values_of(a, function, rows, dtype, calls, want);
        const size_t plain = values_of(b, function, rows, dtype, calls, got);
        /* a call counts with the depth of all outputs of the called function */
        assert_true(calls ? depth >= plain : depth == plain);
        for (size_t i = 0; i < count; i++) assert_close(got[i], want[i], single ? 1e-6 : 1e-15, 0);
    }
}

TEST("a call computes the called function, in plans for any number of rows and in derivatives") {
    lg_program *with = built(true), *without = built(false);
    for (size_t rows = 1; rows <= 3; rows++) assert_equal_functions(with, without, 2, rows, 4 * rows);
    const size_t jacobian = derived(without, LG_DERIVATIVE_JACOBIAN, "thrice");
    assert_int_equal(derived(with, LG_DERIVATIVE_JACOBIAN, "thrice"), jacobian);
    assert_equal_functions(with, without, jacobian, 1, 16);
}

TEST("the program stores calls, and counts them") {
    lg_program *with = built(true);
    assert_int_equal(lg_program_calls(with, 2, 1), 3);
    assert_int_equal(lg_program_calls(with, 2, 0), 0);
    assert_int_equal(lg_program_calls(with, 3, 1), 0);
    assert_int_equal(lg_program_calls(built(false), 2, 1), 0);
}

TEST("on a tape a call equals the called function") {
    lg_program *with = built(true), *without = built(false);
    lg_tape *tape = test_tape(LG_F64);
    lg_var theta = lg_parameter(tape, lg_shape1(4), weights), in[2], a, b;
    for (int i = 0; i < 2; i++) in[i] = lg_input(tape, lg_shape2(3, 4), x[i]);
    assert_ok(lg_program_record(tape, with, 2, &theta, in, &a));
    assert_ok(lg_program_record(tape, without, 2, &theta, in, &b));
    assert_memory_equal(lg_value(tape, a), lg_value(tape, b), 12 * sizeof(double));
}

TEST("calls of functions or outputs that do not exist yet are refused") {
    static const way ways[] = {{true, "thrice", 0}, {true, "nothing", 0}, {true, "product", 2}};
    for (size_t i = 0; i < LG_COUNT(ways); i++) {
        way w = ways[i];
        lg_program *program = NULL;
        lg_error error;
        assert_int_equal(build(&w, &program, &error), LG_NOT_FOUND);
        assert_non_null(strstr(error.message, ways[i].output < 2 ? "the program has no function '"
                                                                 : "has no output number 2; it has"));
        assert_null(program);
    }
    lg_tape *tape = test_tape(LG_F64);
    lg_var in[2] = {lg_input(tape, lg_shape2(1, 4), x[0]), LG_NONE};
    assert_true(lg_is_none(lg_program_call(tape, "product", 0, in)));
    assert_int_equal(lg_tape_status(tape), LG_NOT_FOUND);
}

/* Changes one number of the only call in the function's image, so that it calls something else, and adds the
 * function. */
static lg_status add_changed(lg_program *program, size_t which, int64_t value, lg_error *error) {
    lg_function_image *image;
    assert_ok(lg_function_image_create(program, 2, &image));
    image->name = "changed";
    for (size_t i = 0; i < image->operation_count; i++) {
        lg_operation *o = &image->operations[i];
        if (strcmp(o->name, "call") == 0) o->whole[which].base = value;
    }
    const lg_status status = lg_program_add_image(program, image, error);
    lg_function_image_destroy(image);
    return status;
}

TEST("images store calls, and may call only earlier functions with fitting shapes") {
    lg_program *program = built(true);
    lg_error error;
    assert_ok(add_changed(program, 2, 0, &error));
    assert_equal_functions(program, program, 3, 1, 4);
    double want[4], got[4];
    (void)values_of(program, 2, 1, LG_F64, true, want);
    (void)values_of(program, 3, 1, LG_F64, true, got);
    assert_memory_equal(want, got, sizeof want);
    static const struct {
        size_t which;
        int64_t value;
        const char *words;
    } bad[] = {{0, 0, ""},
               {0, 3, "comes before this one"},
               {0, 5, "comes before this one"},
               {0, -1, "comes before this one"},
               {1, 0, ""},
               {1, 2, "another number of inputs"},
               {1, -1, "another number of inputs"}};
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        lg_program *fresh = built(true);
        assert_int_equal(add_changed(fresh, bad[i].which, bad[i].value, &error), LG_FORMAT);
        assert_non_null(strstr(error.message, bad[i].words));
        assert_int_equal(lg_program_functions(fresh), 3);
    }
}

/* Changes of the image of function 2, whose operation 3 is a call. */
#define CHANGE(name, ...)                                                                                    \
    static void name(lg_function_image *f) {                                                                 \
        __VA_ARGS__;                                                                                         \
    }
CHANGE(many_operations, f->operation_count = ((size_t)1 << 20) + 1)
CHANGE(no_operations, f->operation_count = 0)
CHANGE(no_name, f->name = NULL)
CHANGE(no_operation_name, f->operations[3].name = NULL)
CHANGE(nothing_known, f->operations[3].name = "nothing")
CHANGE(many_inputs, f->operations[3].input_count = 65)
CHANGE(one_input, f->operations[3].input_count = 1)
CHANGE(many_reals, f->operations[2].real_count = f->operations[3].real_count = UINT32_MAX)
CHANGE(many_indices, f->operations[2].index_count = f->operations[3].index_count = UINT32_MAX)
CHANGE(high_rank, f->operations[3].rank = 5)
CHANGE(call_by_rows, f->operations[3].whole[0].rows = 1)
CHANGE(output_by_rows, f->operations[3].whole[1].rows = 1)
CHANGE(shrinking_input, f->operations[3].shape[0].rows = -1)
CHANGE(steep, f->operations[3].shape[0].rows = INT64_MIN / 2)
CHANGE(input_by_rows, f->operations[0].whole[0].rows = 1)
CHANGE(negative_input, f->operations[0].whole[0].base = -1)
CHANGE(huge_input, f->operations[0].whole[0].base = (int64_t)1 << 32)
static const uint32_t itself[1] = {0};
CHANGE(leaf_of_leaf, f->operations[1].inputs = itself, f->operations[1].input_count = 1)
CHANGE(shrinking_result, f->operations[f->operation_count - 1].shape[0].rows = 2)
CHANGE(no_constant, f->operations[1].name = "constant")

TEST("images with wrong counts, names and numbers are refused in words") {
    static const struct {
        void (*change)(lg_function_image *);
        const char *words;
    } rows[] = {{many_operations, "too many operations"},
                {no_operations, "expected 1 to"},
                {no_name, "cannot be the name of a function"},
                {no_operation_name, "there is no such operation"},
                {nothing_known, "there is no such operation"},
                {many_inputs, "too many inputs"},
                {one_input, "another number of inputs"},
                {many_reals, "too many numbers"},
                {many_indices, "too many numbers"},
                {high_rank, "rank is too high"},
                {call_by_rows, "comes before this one"},
                {output_by_rows, "no such output"},
                {shrinking_input, "differs from the one"},
                {steep, "too large"},
                {input_by_rows, "no such input"},
                {negative_input, "no such input"},
                {huge_input, "no such input"},
                {leaf_of_leaf, "wrong number of inputs"},
                {shrinking_result, "shape"},
                {no_constant, "it has no numbers"}};
    lg_program *program = built(true);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_function_image *image;
        lg_error error;
        assert_ok(lg_function_image_create(program, 2, &image));
        assert_string_equal(image->operations[3].name, "call");
        const lg_operation *operations = image->operations;
        lg_operation *own = TEST_ARRAY(lg_operation, image->operation_count);
        memcpy(own, operations, image->operation_count * sizeof *own);
        lg_function_image changed = *image;
        changed.name = "changed";
        changed.operations = own;
        rows[i].change(&changed);
        const lg_status status = lg_program_add_image(program, &changed, &error);
        if (status != LG_FORMAT && status != LG_INVALID_ARGUMENT) fail_msg("row %zu: %d", i, (int)status);
        assert_says(error.message, rows[i].words);
        assert_int_equal(lg_program_functions(program), 3);
        lg_function_image_destroy(image);
    }
}

TEST("nothing is leaked when memory ends") {
    const lg_parameter_spec theta = {"theta", lg_shape1(4), weights};
    lg_plan_options options;
    lg_plan_options_init(&options);
    for (int calls = 0; calls < 2; calls++) {
        options.calls = calls == 1;
        EVERY_ALLOCATION_FAILS(context, 20, {
            way w = {true, "product", 1};
            const lg_function_spec functions[] = {{"product", pair, 2, results, 2, product, NULL},
                                                  {"thrice", pair, 2, results, 1, thrice, &w}};
            const lg_program_spec spec = spec_of(&theta, 1, functions, LG_COUNT(functions));
            lg_program *program = NULL;
            lg_plan *plan = NULL;
            status = lg_program_build(context, &spec, &program, NULL);
            if (status == LG_OK) status = lg_plan_create(program, 1, &options, &plan, NULL);
            lg_plan_destroy(plan);
            lg_program_destroy(program);
        });
    }
}

TEST("images and bytes keep the paths of a loop, and wrong paths are refused") {
    static const struct {
        uint32_t path;
        size_t paths, outputs;
        lg_status status;
    } rows[] = {{0, 1, 2, LG_OK},     {1, 1, 2, LG_FORMAT}, {UINT32_MAX, 1, 2, LG_FORMAT},
                {0, 0, 2, LG_FORMAT}, {0, 1, 1, LG_FORMAT}, {0, 2, 2, LG_FORMAT}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        lg_program *program = built(true);
        size_t count, size = 0, memory = 1 << 20;
        const char *const path = lg_program_outputs(program, 0, &count)->name;
        const lg_loop_spec loop = {sizeof loop, "l", lg_program_function_name(program, 0), 3, NULL, 0,
                                   &path,       1};
        const uint32_t changed[] = {rows[r].path, 0};
        lg_function_image *image, *again;
        lg_error error;
        assert_int_equal(count, 1);
        assert_ok(lg_program_add_loop(program, &loop, &error));
        assert_ok(lg_function_image_create(program, 3, &image));
        image->path = changed;
        image->path_count = rows[r].paths;
        image->output_count = rows[r].outputs;
        assert_ok(lg_function_pack(image, NULL, &size, &error));
        void *bytes = TEST_ARRAY(unsigned char, size);
        assert_ok(lg_function_pack(image, bytes, &size, &error));
        lg_function_image_destroy(image);
        assert_ok(lg_function_unpack(NULL, "changed", bytes, size, &memory, &again, &error));
        assert_int_equal(again->path_count, rows[r].paths);
        assert_status(lg_program_add_image(program, again, &error), rows[r].status);
        lg_function_image_destroy(again);
        if (rows[r].status != LG_OK) continue;
        double want[64], got[64];
        (void)values_of(program, 3, 1, LG_F64, true, want);
        (void)values_of(program, 4, 1, LG_F64, true, got);
        assert_memory_equal(want, got, 4 * sizeof *want);
    }
}

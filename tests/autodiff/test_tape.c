/* The tape: handles, marks, errors and their messages, memory, derivatives against closed forms, both
 * types.
 * ctest-labels: isa */
#include "gradcheck/cases.h"
#include "row_support.h"

#include "autodiff/tape/sweep.h"
#include "autodiff/tape/tape_internal.h"

static lg_var vector(lg_tape *tape, uint32_t n, const double *values) {
    return lg_input_f64(tape, lg_shape1(n), values);
}

static double number(lg_tape *tape, lg_var v) {
    double value = NAN;
    assert_ok(lg_read(tape, v, 1, &value));
    return value;
}

static void assert_tape_error(lg_tape *tape, lg_status status, const char *const *says, size_t n) {
    if (lg_tape_status(tape) != status)
        fail_msg("%s: %s, expected %s", lg_status_name(lg_tape_status(tape)), lg_tape_message(tape),
                 lg_status_name(status));
    for (size_t i = 0; i < n; i++)
        if (says[i] != NULL && strstr(lg_tape_message(tape), says[i]) == NULL)
            fail_msg("'%s' is not in: %s", says[i], lg_tape_message(tape));
}

static lg_var good(lg_tape *t) {
    static const double six[6] = {1, 2, 3, 4, 5, 6};
    return lg_input_f64(t, lg_shape2(2, 3), six);
}
static const uint32_t first_rows[2] = {0, 1};
static const double weights3[3] = {1, 2, 3};
static lg_status identity_forward(void *user, lg_dtype dtype, const void *const *in, void *y) {
    memcpy(y, in[0], 3 * (dtype == LG_F64 ? sizeof(double) : sizeof(float)));
    return LG_OK;
}

/* ---- handles ---- */

/* The functions that differentiate, as functions of one handle. */
static lg_var call_jacobian(lg_tape *t, lg_var v) {
    return lg_jacobian(t, v, good(t));
}
static lg_var call_hvp(lg_tape *t, lg_var v) {
    return lg_hvp(t, good(t), v, good(t));
}
static lg_var call_grad(lg_tape *t, lg_var v) {
    lg_var out = LG_NONE;
    (void)lg_grad(t, v, &v, 1, &out);
    return out;
}
static lg_var call_vjp(lg_tape *t, lg_var v) {
    lg_var y = good(t), out = LG_NONE;
    (void)lg_vjp(t, &y, &v, 1, &y, 1, &out);
    return out;
}
static lg_var call_jvp(lg_tape *t, lg_var v) {
    lg_var y = good(t), out = LG_NONE;
    (void)lg_jvp(t, &y, 1, &y, &v, 1, &out);
    return out;
}
static lg_var call_backward(lg_tape *t, lg_var v) {
    double g[6];
    void *grad = g;
    lg_var y = good(t);
    (void)lg_backward(t, y, &v, 1, &grad);
    return LG_NONE;
}

static const struct {
    const char *name;
    lg_var (*call)(lg_tape *, lg_var);
} derivatives[] = {{"jacobian", call_jacobian}, {"hvp", call_hvp}, {"grad", call_grad},
                   {"vjp", call_vjp},           {"jvp", call_jvp}, {"backward", call_backward}};

typedef lg_var (*handle_call)(void *user, lg_tape *tape, lg_var v);

/* Calls a case's function with v as input number `at` and valid handles as the other inputs. */
typedef struct row_input {
    const lg_gradcheck_function *f;
    uint32_t at;
} row_input;

static lg_var call_row(void *user, lg_tape *tape, lg_var v) {
    const row_input *r = user;
    lg_var x[LG_GRADCHECK_MAX_INPUTS];
    for (uint32_t i = 0; i < r->f->inputs; i++)
        x[i] = i == r->at ? v : lg_full(tape, r->f->arguments[i].shape, 0.5);
    return r->f->build(r->f->user, tape, x);
}

static lg_var call_derivative(void *user, lg_tape *tape, lg_var v) {
    return (*(lg_var(**)(lg_tape *, lg_var))user)(tape, v);
}

/* The call must refuse these handles: LG_NONE, rewound, of another tape, made up. `name`: the operation in
 * the message, or NULL for any name. `optional`: LG_NONE is allowed. */
static void refuses_handles(const char *name, handle_call call, void *user, bool optional) {
    lg_tape *tape = test_tape(LG_F64), *other = test_tape(LG_F64);
    for (int kind = 0; kind < 4; kind++) {
        lg_tape_reset(tape);
        lg_mark mark = lg_tape_mark(tape);
        lg_var stale = good(tape);
        assert_ok(lg_tape_rewind(tape, mark));
        const lg_var bad[4] = {LG_NONE, stale, good(other), {1000000u, 12345u}};
        const lg_var out = call(user, tape, bad[kind]);
        if (kind == 0 && optional && lg_tape_status(tape) == LG_OK) continue;
        const char *const says[] = {
            kind == 0 ? ": an input is LG_NONE" : ": an input was rewound or belongs to another tape", name};
        assert_true(lg_is_none(out));
        assert_tape_error(tape, LG_STALE_HANDLE, says, 2);
        assert_true(lg_tape_message(tape)[0] != ':');
    }
}

/* The next case that is not a leaf, since a leaf has no input handles. */
static const lg_gradcheck_case *operation_after(size_t *i) {
    const lg_gradcheck_case *row = lg_gradcheck_operation((*i)++);
    const bool leaf = row != NULL && row->operations[0] != NULL && strcmp(row->operations[0], "leaf") == 0;
    return leaf ? operation_after(i) : row;
}

TEST("handles that are LG_NONE, rewound, of another tape or made up cause an error that names the "
     "operation") {
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = operation_after(&i)) != NULL;)
        for (uint32_t at = 0; at < row->function.inputs; at++) {
            row_input of = {&row->function, at};
            refuses_handles(NULL, call_row, &of, at > 0);
        }
    for (size_t i = 0; i < LG_COUNT(derivatives); i++) {
        lg_var (*call)(lg_tape *, lg_var) = derivatives[i].call;
        refuses_handles(derivatives[i].name, call_derivative, &call, false);
    }
}

TEST("after a failure every operation does nothing, and the first message stays") {
    const lg_gradcheck_case *row;
    lg_tape *tape = test_tape(LG_F64);
    lg_var x = good(tape);
    lg_scope_push(tape, "first");
    (void)lg_matmul(tape, x, x);
    lg_scope_pop(tape);
    const char *before = test_text("%s", lg_tape_message(tape));
    const size_t nodes = tape->count;
    for (size_t i = 0; (row = operation_after(&i)) != NULL;)
        assert_true(lg_is_none(call_row(&(row_input){&row->function, 0}, tape, x)));
    for (size_t i = 0; i < LG_COUNT(derivatives); i++) assert_true(lg_is_none(derivatives[i].call(tape, x)));
    assert_string_equal(lg_tape_message(tape), before);
    assert_int_equal(tape->count, nodes);
    double value[6], grad[6] = {7, 7, 7, 7, 7, 7};
    void *grads = grad;
    lg_var out = {77, 77};
    assert_status(lg_read(tape, x, 6, value), LG_SHAPE);
    assert_null(lg_value(tape, x));
    assert_status(lg_grad(tape, x, &x, 1, &out), LG_SHAPE);
    assert_status(lg_jvp(tape, &x, 1, &x, &x, 1, &out), LG_SHAPE);
    assert_status(lg_backward(tape, x, &x, 1, &grads), LG_SHAPE);
    assert_true(out.index == 77 && out.generation == 77);
    for (int i = 0; i < 6; i++) assert_close(grad[i], 7.0, 0, 0);
    assert_true(lg_is_none(lg_full(tape, lg_shape0(), 1)));
    assert_true(lg_is_none(lg_parameter(tape, lg_shape1(6), value)));
    assert_true(lg_is_none(lg_tape_fail(tape, LG_FILE, "later", "not heard")));
    assert_string_equal(lg_tape_message(tape), before);
}

TEST("functions that read values refuse bad handles") {
    lg_tape *tape = test_tape(LG_F64);
    lg_mark mark = lg_tape_mark(tape);
    lg_var x = good(tape);
    double value[6];
    assert_status(lg_read(tape, x, 5, value), LG_SHAPE);
    assert_status(lg_read(tape, LG_NONE, 6, value), LG_STALE_HANDLE);
    assert_ok(lg_read(tape, x, 6, value));
    assert_ok(lg_tape_rewind(tape, mark));
    assert_status(lg_read(tape, x, 6, value), LG_STALE_HANDLE);
    assert_null(lg_value(tape, x));
    assert_int_equal(lg_var_shape(tape, x).rank, 0);
    lg_var again = good(tape); /* the same index with another generation */
    assert_int_equal(again.index, x.index);
    assert_status(lg_read(tape, x, 6, value), LG_STALE_HANDLE);
    assert_ok(lg_tape_status(tape));
}

/* ---- marks ---- */

TEST("rewinding clears only errors that came after the mark") {
    lg_tape *tape = test_tape(LG_F64);
    lg_var x = good(tape);
    lg_mark before = lg_tape_mark(tape);
    lg_var y = lg_sin(tape, x);
    (void)lg_matmul(tape, y, y);
    assert_int_equal(lg_tape_status(tape), LG_SHAPE);
    assert_ok(lg_tape_rewind(tape, before));
    assert_ok(lg_tape_status(tape));
    assert_string_equal(lg_tape_message(tape), "");
    assert_close(number(tape, lg_sum(tape, x)), 21.0, 1e-15, 0);
    assert_status(lg_read(tape, y, 1, &(double){0}), LG_STALE_HANDLE);
    (void)lg_transpose(tape, lg_sum(tape, x));
    lg_tape_reset(tape);
    assert_ok(lg_tape_status(tape));
    assert_int_equal(tape->count, 0);
}

TEST("stale marks and marks of other tapes are refused") {
    lg_tape *tape = test_tape(LG_F64), *other = test_tape(LG_F64);
    lg_var x = good(tape);
    (void)good(other);
    lg_mark one = lg_tape_mark(tape);
    (void)lg_sin(tape, x);
    (void)lg_cos(tape, x);
    lg_mark three = lg_tape_mark(tape);
    assert_ok(lg_tape_rewind(tape, one));
    assert_status(lg_tape_rewind(tape, three), LG_INVALID_ARGUMENT); /* the mark is ahead */
    (void)lg_exp(tape, x);
    lg_var kept = lg_exp(tape, x);
    assert_status(lg_tape_rewind(tape, three),
                  LG_INVALID_ARGUMENT); /* the nodes of the mark are gone, others have their places */
    assert_status(lg_tape_rewind(tape, lg_tape_mark(other)), LG_INVALID_ARGUMENT);
    assert_int_equal(tape->count, 3);
    assert_close(((const double *)lg_value(tape, kept))[0], exp(1.0), 1e-15, 0);
    assert_ok(lg_tape_status(tape));
    assert_ok(lg_tape_rewind(tape, one)); /* the same mark again */
    assert_int_equal(tape->count, 1);
    assert_close(number(tape, lg_sum(tape, x)), 21.0, 1e-15, 0);
    /* The mark of an empty tape fits any tape and does not bring memory of the other tape along. */
    lg_tape *empty = test_tape(LG_F64);
    (void)lg_tape_fail(empty, LG_SHAPE, "x", "y");
    lg_tape_reset(empty);
    assert_ok(lg_tape_rewind(tape, lg_tape_mark(empty)));
    assert_close(number(tape, lg_sum(tape, good(tape))), 21.0, 1e-15, 0);
}

/* ---- shapes that do not fit ---- */

static lg_var of(lg_tape *t, uint32_t rank, uint32_t a, uint32_t b, uint32_t c) {
    uint32_t dims[4] = {a, b, c, 0};
    return lg_full(t, lg_shape_of(rank, dims), 0.5);
}
#define V0          of(t, 0, 0, 0, 0)
#define V1(a)       of(t, 1, a, 0, 0)
#define V2(a, b)    of(t, 2, a, b, 0)
#define V3(a, b, c) of(t, 3, a, b, c)
static const uint32_t out_of_range[2] = {0, 9};
static const int not_axes[3] = {0, 0, 1};
static const int beyond[2] = {0, 2};

/* X(expression, status, operation, shape or reason, other shape) */
#define WRONG_LIST(X)                                                                                        \
    X(lg_sum(t, LG_NONE), LG_STALE_HANDLE, "sum", "LG_NONE", NULL)                                           \
    X(lg_mean(t, LG_NONE), LG_STALE_HANDLE, "mean", "LG_NONE", NULL)                                         \
    X(lg_sum_axis(t, LG_NONE, 0, true), LG_STALE_HANDLE, "sum", "LG_NONE", NULL)                             \
    X(lg_broadcast_to(t, V2(1, 3), lg_shape1(3)), LG_SHAPE, "broadcast", "(1, 3)", NULL)                     \
    X(lg_concat(t, (lg_var[2]){V1(3), V1(3)}, 2, 1), LG_INVALID_ARGUMENT, "concat", "no such axis", NULL)    \
    X(lg_permute(t, V2(2, 3), (const int[]){0, -3}), LG_INVALID_ARGUMENT, "permute", NULL, NULL)             \
    X(lg_loss_record(t, LG_LOSS_MSE, V2(4, 3), V2(4, 3), V2(4, 1)), LG_SHAPE, "loss weights", "(4, 1)",      \
      NULL)                                                                                                  \
    X(lg_add(t, V2(2, 3), V2(3, 2)), LG_SHAPE, "add", "(2, 3)", "(3, 2)")                                    \
    X(lg_sub(t, V2(2, 3), V1(2)), LG_SHAPE, "sub", "(2, 3)", "(2)")                                          \
    X(lg_mul(t, V3(2, 3, 4), V2(2, 4)), LG_SHAPE, "mul", "(2, 3, 4)", "(2, 4)")                              \
    X(lg_div(t, V1(4), V1(3)), LG_SHAPE, "div", "(4)", "(3)")                                                \
    X(lg_max(t, V2(4, 1), V1(3)), LG_OK, NULL, NULL, NULL)                                                   \
    X(lg_max(t, V2(4, 2), V1(3)), LG_SHAPE, "max", "(4, 2)", "(3)")                                          \
    X(lg_lerp(t, V1(3), V1(3), V1(4)), LG_SHAPE, "mix", "(3)", "(4)")                                        \
    X(lg_linear_combination(t, (lg_var[2]){V1(3), V1(4)}, weights3, 2), LG_SHAPE, "combine", "(3)", "(4)")   \
    X(lg_linear_combination(t, NULL, weights3, 0), LG_INVALID_ARGUMENT, "combine", "number of terms", NULL)  \
    X(lg_mse(t, V1(4), V1(3)), LG_SHAPE, "mse", "(4)", "(3)")                                                \
    X(lg_act(t, V1(4), (lg_activation)LG_ACTIVATION_COUNT), LG_INVALID_ARGUMENT, "act", "unknown", NULL)     \
    X(lg_act_derivative(t, V1(4), LG_TANH, -1), LG_INVALID_ARGUMENT, "act", "negative", NULL)                \
    X(lg_act_derivative(t, V1(4), LG_TANH, 9), LG_NOT_DIFFERENTIABLE, "act_derivative", "order", NULL)       \
    X(lg_matmul(t, V2(2, 3), V2(2, 3)), LG_SHAPE, "matmul", "(2, 3) and (2, 3)", NULL)                       \
    X(lg_matmul_nt(t, V2(2, 3), V2(3, 2)), LG_SHAPE, "matmul", "(2, 3)", "(3, 2)")                           \
    X(lg_matmul_tn(t, V2(2, 3), V2(3, 2)), LG_SHAPE, "matmul", "(2, 3)", "(3, 2)")                           \
    X(lg_matmul(t, V1(3), V2(3, 2)), LG_SHAPE, "matmul", "(3)", "(3, 2)")                                    \
    X(lg_matmul(t, V3(2, 2, 3), V3(3, 3, 2)), LG_SHAPE, "matmul", "(2, 2, 3)", "(3, 3, 2)")                  \
    X(lg_matmul_add(t, V2(2, 3), V2(3, 4), V1(3)), LG_SHAPE, "matmul", "(3, 4)", "(3)")                      \
    X(lg_matmul_add(t, V2(2, 3), V2(3, 4), V2(3, 4)), LG_SHAPE, "matmul", "(2, 3)", "(3, 4)")                \
    X(lg_matmul_add(t, V3(1, 2, 3), V2(3, 4), V1(4)), LG_SHAPE, "matmul", "(1, 2, 3)", "(4)")                \
    X(lg_dense(t, V2(2, 3), V2(2, 4), LG_NONE, LG_TANH), LG_SHAPE, "dense", "(2, 3)", "(2, 4)")              \
    X(lg_dense(t, V2(2, 3), V2(3, 4), V1(3), LG_TANH), LG_SHAPE, "dense", "(3, 4)", "(3)")                   \
    X(lg_dense(t, V2(2, 3), V2(3, 4), V1(3), LG_SWISH), LG_SHAPE, "matmul", "(3, 4)", "(3)")                 \
    X(lg_dense(t, V2(2, 3), V2(3, 4), V1(4), (lg_activation)-1), LG_INVALID_ARGUMENT, "dense", "unknown",    \
      NULL)                                                                                                  \
    X(lg_sum_axis(t, V2(2, 3), 2, false), LG_INVALID_ARGUMENT, "sum", "axis", NULL)                          \
    X(lg_sum_axis(t, V2(2, 3), -3, false), LG_INVALID_ARGUMENT, "sum", "axis", NULL)                         \
    X(lg_mean_axis(t, V0, 0, false), LG_INVALID_ARGUMENT, "sum", "axis", NULL)                               \
    X(lg_max_axis(t, V2(2, 3), 5, false), LG_INVALID_ARGUMENT, "max_axis", "axis", NULL)                     \
    X(lg_max_axis(t, V2(2, 0), 1, false), LG_SHAPE, "max_axis", "shapes", NULL)                              \
    X(lg_sum_to(t, V2(2, 3), lg_shape1(2)), LG_SHAPE, "sum", "(2, 3)", NULL)                                 \
    X(lg_broadcast_to(t, V1(2), lg_shape2(2, 3)), LG_SHAPE, "broadcast", "(2)", NULL)                        \
    X(lg_broadcast_to(t, V1(2), (lg_shape){5, {1, 1, 1, 1}}), LG_SHAPE, "broadcast", "rank", NULL)           \
    X(lg_reshape(t, V2(2, 3), lg_shape1(5)), LG_SHAPE, "reshape", "(2, 3)", NULL)                            \
    X(lg_reshape(t, V2(2, 3), (lg_shape){7, {6, 1, 1, 1}}), LG_SHAPE, "reshape", "(2, 3)", NULL)             \
    X(lg_slice(t, V2(2, 3), 1, 2, 2), LG_INVALID_ARGUMENT, "slice", "number 2 on", NULL)                     \
    X(lg_slice(t, V2(2, 3), 1, UINT32_MAX, 2), LG_INVALID_ARGUMENT, "slice", "axis 1 has 3 elements", NULL)  \
    X(lg_slice(t, V2(2, 3), 2, 0, 1), LG_INVALID_ARGUMENT, "slice", "axis", NULL)                            \
    X(lg_pad(t, V2(2, 3), 2, 0, 1), LG_INVALID_ARGUMENT, "pad", "axis", NULL)                                \
    X(lg_pad(t, V2(2, 3), 0, UINT32_MAX, 1), LG_INVALID_ARGUMENT, "pad", "padded axis", NULL)                \
    X(lg_concat(t, (lg_var[2]){V2(2, 3), V2(2, 4)}, 2, 0), LG_SHAPE, "concat", "(2, 3)", "(2, 4)")           \
    X(lg_concat(t, (lg_var[2]){V2(2, 3), V1(3)}, 2, 0), LG_SHAPE, "concat", "(2, 3)", "(3)")                 \
    X(lg_concat(t, NULL, 0, 0), LG_INVALID_ARGUMENT, "concat", "no tensors", NULL)                           \
    X(lg_transpose(t, V1(3)), LG_SHAPE, "transpose", "rank", NULL)                                           \
    X(lg_permute(t, V3(2, 3, 4), not_axes), LG_INVALID_ARGUMENT, "permute", "permutation", NULL)             \
    X(lg_permute(t, V2(2, 3), beyond), LG_INVALID_ARGUMENT, "permute", "permutation", NULL)                  \
    X(lg_gather(t, V2(3, 2), out_of_range, 2), LG_INVALID_ARGUMENT, "gather", "index", NULL)                 \
    X(lg_gather(t, V0, out_of_range, 1), LG_INVALID_ARGUMENT, "gather", "index", NULL)                       \
    X(lg_scatter(t, V2(2, 2), out_of_range, 2, 5), LG_INVALID_ARGUMENT, "scatter", "index", NULL)            \
    X(lg_scatter(t, V2(3, 2), first_rows, 2, 5), LG_SHAPE, "scatter", "(3, 2)", NULL)                        \
    X(lg_rowdot(t, V2(2, 3), V2(2, 1)), LG_SHAPE, "rowdot", "(2, 3)", "(2, 1)")                              \
    X(lg_rownorm2(t, V0), LG_SHAPE, "rowdot", "()", NULL)                                                    \
    X(lg_cross(t, V2(2, 3), V2(1, 3)), LG_SHAPE, "cross", "(2, 3)", "(1, 3)")                                \
    X(lg_cross(t, V2(3, 2), V2(3, 2)), LG_SHAPE, "cross", "(3, 2)", NULL)                                    \
    X(lg_spd_solve(t, V3(2, 3, 2), V3(2, 3, 1)), LG_SHAPE, "spd_factor", "(2, 3, 2)", NULL)                  \
    X(lg_spd_solve(t, V2(3, 3), V2(3, 1)), LG_SHAPE, "spd_factor", "(3, 3)", NULL)                           \
    X(lg_spd_solve(t, V3(1, 1, 1), V3(2, 1, 1)), LG_SHAPE, "spd_solve", "(1, 1, 1)", "(2, 1, 1)")            \
    X(lg_stumpff_functions(t, V2(2, 3), 3), LG_SHAPE, "stumpff", "(2, 3)", NULL)                             \
    X(lg_stumpff_functions(t, V2(2, 1), 9), LG_INVALID_ARGUMENT, "stumpff", "range", NULL)                   \
    X(lg_stumpff_functions(t, V2(2, 1), -1), LG_INVALID_ARGUMENT, "stumpff", "negative", NULL)               \
    X(lg_stumpff_functions(t, V0, 1), LG_SHAPE, "stumpff", "()", NULL)                                       \
    X(lg_dexpinv_coefficient(t, V1(3), 0), LG_SHAPE, "dexpinv_coef", "(3)", NULL)                            \
    X(lg_dexpinv_coefficient(t, V1(1), 9), LG_NOT_DIFFERENTIABLE, "dexpinv_coef", "order", NULL)             \
    X(lg_dexpinv_coefficient(t, V1(1), -1), LG_INVALID_ARGUMENT, "dexpinv_coef", "negative", NULL)           \
    X(lg_loss_record(t, LG_LOSS_MSE, V2(4, 3), V2(4, 1), LG_NONE), LG_SHAPE, "loss", "(4, 3)", "(4, 1)")     \
    X(lg_loss_record(t, LG_LOSS_MSE, V0, V0, LG_NONE), LG_SHAPE, "loss", "()", NULL)                         \
    X(lg_loss_record(t, LG_LOSS_MAE, V2(4, 3), V2(4, 3), V1(3)), LG_SHAPE, "loss weights", "(4, 3)", "(3)")  \
    X(lg_loss_record(t, (lg_loss)LG_LOSS_COUNT, V2(4, 3), V2(4, 3), LG_NONE), LG_INVALID_ARGUMENT, "loss",   \
      "unknown", NULL)                                                                                       \
    X(lg_log_softmax(t, V0), LG_INVALID_ARGUMENT, "max_axis", "axis", NULL)                                  \
    X(lg_input(t, lg_shape1(2), NULL), LG_INVALID_ARGUMENT, "input", "the data is NULL", NULL)               \
    X(lg_input_f64(t, (lg_shape){5, {1, 1, 1, 1}}, weights3), LG_INVALID_ARGUMENT, "input", "rank", NULL)    \
    X(lg_parameter(t, lg_shape1(2), NULL), LG_INVALID_ARGUMENT, "parameter", "the data is NULL", NULL)       \
    X(lg_full(t, lg_shape4(65535, 65535, 65535, 65535), 1.0), LG_OUT_OF_MEMORY, "tape", "", NULL)            \
    X(lg_custom(t, NULL, NULL, 0, lg_shape0()), LG_INVALID_ARGUMENT, "custom", "a name", NULL)               \
    X(lg_jacobian(t, V1(2), LG_NONE), LG_STALE_HANDLE, "jacobian", "LG_NONE", NULL)

TEST("shapes that do not fit are reported with the operation and its scope") {
    lg_tape *t = test_tape(LG_F64);
#define X(expression, status, operation, one, two)                                                           \
    {                                                                                                        \
        lg_tape_reset(t);                                                                                    \
        lg_scope_push(t, "net");                                                                             \
        lg_scope_push(t, "layer 3");                                                                         \
        lg_var y = expression;                                                                               \
        const char *const says[] = {operation, one, two, (status) != LG_OK ? ", in net/layer 3" : NULL};     \
        if (lg_is_none(y) != ((status) != LG_OK)) fail_msg("%s", #expression);                               \
        assert_tape_error(t, status, says, 4);                                                               \
    }
    WRONG_LIST(X)
#undef X
}

TEST("directions of a wrong shape are refused") {
    lg_tape *t = test_tape(LG_F64);
    lg_var x = good(t), c = lg_full(t, lg_shape1(6), 1.0), out = {9, 9};
    lg_mark mark = lg_tape_mark(t);
    assert_status(lg_vjp(t, &x, &c, 1, &x, 1, &out), LG_SHAPE);
    assert_says(lg_tape_message(t), "vjp");
    assert_ok(lg_tape_rewind(t, mark));
    assert_status(lg_jvp(t, &x, 1, &x, &c, 1, &out), LG_SHAPE);
    assert_says(lg_tape_message(t), "jvp");
    assert_int_equal(out.index, 9);
}

TEST("scopes nest, and too many of them are harmless") {
    lg_tape *t = test_tape(LG_F64);
    static const char *const names[10] = {"s0", "s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "s9"};
    for (int i = 0; i < 10; i++) lg_scope_push(t, names[i]);
    (void)lg_tape_fail(t, LG_SHAPE, "deep", "it fails");
    assert_says(lg_tape_message(t), "it fails, in s0/s1/");
    assert_null(strstr(lg_tape_message(t), "s9"));
    lg_tape_reset(t);
    for (int i = 0; i < 10; i++) lg_scope_push(t, names[i]);
    for (int i = 0; i < 9; i++) lg_scope_pop(t);
    (void)lg_transpose(t, lg_full(t, lg_shape0(), 1));
    assert_says(lg_tape_message(t), ", in s0");
    assert_null(strstr(lg_tape_message(t), "s1"));
    lg_scope_pop(t);
    lg_scope_pop(t); /* one pop too many is harmless */
}

/* ---- memory ---- */

enum { WEIGHTS = 3 * 8 + 8 + 8 + 1 };

typedef struct model {
    const double *theta, *x;
    double grad[WEIGHTS];
} model;

static model make_model(void) {
    return (model){.theta = test_numbers(5, WEIGHTS, -1, 1), .x = test_numbers(6, 5 * 3, -1, 1)};
}

/* A network whose input gradient is part of the loss: a training step that uses everything that a tape
 * does. */
static lg_var record_step(lg_tape *t, const model *m, lg_var *theta) {
    static const uint32_t indices[6] = {4, 1, 1, 0, 3, 1};
    *theta = lg_parameter(t, lg_shape1(WEIGHTS), m->theta);
    lg_var x = lg_gather(t, lg_input_f64(t, lg_shape2(5, 3), m->x), indices, 6);
    lg_var w1 = lg_reshape(t, lg_slice(t, *theta, 0, 0, 24), lg_shape2(3, 8)),
           b1 = lg_slice(t, *theta, 0, 24, 8);
    lg_var w2 = lg_reshape(t, lg_slice(t, *theta, 0, 32, 8), lg_shape2(8, 1)),
           b2 = lg_slice(t, *theta, 0, 40, 1);
    lg_var v = lg_matmul_add(t, lg_dense(t, x, w1, b1, LG_TANH), w2, b2), g = LG_NONE;
    (void)lg_grad(t, lg_sum(t, v), &x, 1, &g);
    lg_var y = lg_concat(t, (lg_var[2]){g, lg_cross(t, g, x)}, 2, 1);
    return lg_mean(t, lg_square(t, lg_add(t, y, v)));
}

static lg_status train_step(lg_tape *t, model *m) {
    lg_var theta, loss = record_step(t, m, &theta);
    void *grad = m->grad;
    return lg_backward(t, loss, &theta, 1, &grad);
}

TEST("there is no allocation after the first step") {
    lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    lg_tape *tape;
    model m = make_model();
    assert_ok(lg_tape_create(context, NULL, &tape));
    lg_mark start = lg_tape_mark(tape);
    assert_ok(train_step(tape, &m));
    size_t nodes = tape->count, bytes = lg_tape_size(tape);
    lg_fail_alloc_arm(&memory, 0);
    for (int step = 0; step < 20; step++) {
        if (step % 2 == 0)
            lg_tape_reset(tape);
        else
            assert_ok(lg_tape_rewind(tape, start));
        assert_ok(train_step(tape, &m));
        assert_int_equal(tape->count, nodes);
    }
    assert_int_equal(atomic_load(&memory.calls), 0);
    assert_int_equal(lg_tape_size(tape), bytes);
    lg_tape_destroy(tape);
    lg_context_destroy(context);
}

TEST("every allocation may fail, and the tape works after a reset") {
    model m = make_model();
    EVERY_ALLOCATION_FAILS(context, 6, {
        lg_tape *tape = NULL;
        status = lg_tape_create(context, NULL, &tape);
        if (status == LG_OK) status = train_step(tape, &m);
        if (status != LG_OK && tape != NULL) {
            assert_says(lg_tape_message(tape), "allocation");
            lg_tape_reset(tape);
            assert_ok(train_step(tape, &m));
        }
        lg_tape_destroy(tape);
    });
}

TEST("max_size limits the tape") {
    model m = make_model();
    lg_tape *tape = test_tape(LG_F64);
    assert_ok(train_step(tape, &m));
    lg_tape_options options;
    lg_tape_options_init(&options);
    options.max_size = lg_tape_size(tape) / 2;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    assert_status(train_step(tape, &m), LG_OUT_OF_MEMORY);
    assert_says(lg_tape_message(tape), "max_size");
    assert_true(lg_tape_size(tape) <= options.max_size);
    lg_tape_destroy(tape);
}

/* ---- memory that ends within a derivative ---- */

/* Numbers of this variable's shape that differ from element to element. */
static lg_var weights_of(lg_tape *t, lg_var y) {
    const size_t count = lg_shape_count(lg_var_shape(t, y));
    double *weights = TEST_ARRAY(double, count + 1);
    for (size_t i = 0; i < count; i++) weights[i] = 0.5 + 0.25 * (double)(i % 5);
    return lg_input_f64(t, lg_var_shape(t, y), weights);
}

static lg_var weighted(lg_tape *t, lg_var y) {
    return lg_sum(t, lg_mul(t, y, weights_of(t, y)));
}

enum { ENDING_WAYS = 7, ENDING_NUMBERS = 1 << 14 };

typedef struct ending {
    lg_tape *tape;
    const lg_gradcheck_function *f;
    row_on_tape r;
    lg_var weights, y, slope; /* y = <weights, r.y>; slope: <weights, the derivative of y by x_0> */
} ending;

static lg_status derive_in(const ending *e, int way, double *numbers) {
    lg_tape *t = e->tape;
    const lg_var *x = e->r.x;
    const uint32_t n = e->f->inputs;
    const uint32_t results = way == 2 ? n : 1;
    lg_var out[LG_GRADCHECK_MAX_INPUTS];
    void *gradient[LG_GRADCHECK_MAX_INPUTS];
    size_t at = 0;
    for (uint32_t k = 0; k < n; at += lg_shape_count(lg_var_shape(t, x[k++]))) gradient[k] = numbers + at;
    if (way < 2) return lg_backward_set(t, way == 0 ? e->y : e->slope, x, n, gradient);
    if (way == 2) (void)lg_vjp(t, &e->r.y, &e->weights, 1, x, n, out);
    if (way == 3) (void)lg_jvp(t, &e->r.y, 1, x, e->r.d, n, out);
    if (way == 4) out[0] = lg_jacobian(t, e->r.y, x[0]);
    if (way == 5) out[0] = e->f->build(e->f->user, t, x);
    if (way == 6) out[0] = lg_hvp(t, e->y, x[0], e->r.d[0]);
    at = 0;
    for (uint32_t j = 0; j < results && lg_tape_status(t) == LG_OK; j++) {
        const size_t count = lg_shape_count(lg_var_shape(t, out[j]));
        assert_true(at + count <= ENDING_NUMBERS);
        assert_ok(lg_read(t, out[j], count, numbers + at));
        at += count;
    }
    return lg_tape_status(t);
}

/* Leaves `bytes` bytes of the chunk that the arena uses now. */
static void leave(lg_arena *arena, size_t bytes) {
    if (arena->count == 0) return;
    const size_t size = arena->chunks[arena->current].size;
    if (arena->used + bytes < size) arena->used = size - bytes;
}

/* Rewinds the tape, and gives back all blocks that its pool took since `before`. */
static void go_back(lg_tape *t, lg_mark mark, const lg_arena *before) {
    assert_ok(lg_tape_rewind(t, mark));
    lg_forget_transposes(t, 0);
    memset(t->pool.free, 0, sizeof t->pool.free);
    t->pool.arena.current = before->current;
    t->pool.arena.used = before->used;
}

/* The tape gets no new chunk. First its arena has more and more memory, then its pool. */
static size_t end_memory(const ending *e, int way, double *want, double *got) {
    lg_tape *t = e->tape;
    const lg_mark mark = lg_tape_mark(t);
    const lg_arena before = t->pool.arena;
    size_t failures = 0;
    go_back(t, mark, &before);
    assert_ok(derive_in(e, way, want));
    t->options.max_size = t->bytes;
    for (int part = 0; part < 2; part++) {
        lg_status status = LG_OUT_OF_MEMORY;
        for (size_t blocks = 0; status != LG_OK; blocks += 1 + blocks / 32) {
            go_back(t, mark, &before);
            leave(part == 0 ? &t->arena : &t->pool.arena, blocks * LG_ALIGNMENT);
            status = derive_in(e, way, got);
            if (status != LG_OK) assert_int_equal(status, LG_OUT_OF_MEMORY);
            failures += status != LG_OK;
        }
        assert_memory_equal(got, want, ENDING_NUMBERS * sizeof *want);
    }
    go_back(t, mark, &before);
    t->options.max_size = 0;
    return failures;
}

TEST("where memory ends within a derivative of any operation, the tape says so or has the same numbers") {
    double *want = TEST_ARRAY(double, ENDING_NUMBERS), *got = TEST_ARRAY(double, ENDING_NUMBERS);
    const lg_gradcheck_case *row;
    size_t failures = 0;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        const size_t mark = lg_test_owned();
        lg_rng rng = test_rng(11, 0);
        lg_var back[LG_GRADCHECK_MAX_INPUTS];
        ending e = {.tape = test_tape(LG_F64), .f = &row->function};
        e.r = record_row(e.tape, &rng, e.f);
        e.weights = weights_of(e.tape, e.r.y);
        e.y = weighted(e.tape, e.r.y);
        assert_ok(lg_grad(e.tape, e.y, e.r.x, e.f->inputs, back));
        e.slope = weighted(e.tape, back[0]);
        const size_t jacobian =
            lg_shape_count(lg_var_shape(e.tape, e.r.y)) * lg_shape_count(lg_var_shape(e.tape, e.r.x[0]));
        for (int way = 0; way < ENDING_WAYS; way++) {
            if (e.f->first_order_only && (way == 1 || way == 6)) continue;
            if (way == 4 && jacobian > ENDING_NUMBERS) continue;
            failures += end_memory(&e, way, want, got);
        }
        lg_test_give_back(mark);
    }
    print_message("%zu times the memory ended\n", failures);
    assert_true(failures > 10000);
}

TEST("invalid options are refused") {
    lg_tape *tape = NULL;
    lg_tape_options bad[4];
    for (size_t i = 0; i < LG_COUNT(bad); i++) lg_tape_options_init(&bad[i]);
    bad[0].size = 3;
    bad[1].dtype = (lg_dtype)7;
    bad[2].threads = 0;
    bad[3].threads = 1025;
    for (size_t i = 0; i < LG_COUNT(bad); i++)
        assert_status(lg_tape_create(NULL, &bad[i], &tape), LG_INVALID_ARGUMENT);
    assert_null(tape);
    lg_tape_destroy(NULL);
}

/* ---- float against double ---- */

/* Value, vjp and jvp of a case at drawn points, on a tape of either type. */
static size_t derivatives_of(const lg_gradcheck_function *f, lg_dtype dtype, double *out, size_t room) {
    lg_tape *t = test_tape(dtype);
    lg_var all[LG_GRADCHECK_MAX_INPUTS + 2];
    size_t used = 0;
    lg_rng rng = test_rng(11, 0);
    const row_on_tape r = record_row(t, &rng, f);
    const lg_var c = lg_act(t, lg_full(t, lg_var_shape(t, r.y), 0.7), LG_SINE);
    all[f->inputs] = r.y;
    assert_ok(lg_vjp(t, &r.y, &c, 1, r.x, f->inputs, all));
    assert_ok(lg_jvp(t, &r.y, 1, r.x, r.d, f->inputs, &all[f->inputs + 1]));
    for (uint32_t i = 0; i < f->inputs + 2; i++) {
        const size_t count = lg_shape_count(lg_var_shape(t, all[i]));
        assert_true(used + count <= room);
        assert_ok(lg_read(t, all[i], count, out + used));
        used += count;
    }
    return used;
}

TEST("values, vjp and jvp of every case agree in float and double") {
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        double in_double[1024], in_float[1024], most = 0.0;
        size_t n = derivatives_of(&row->function, LG_F64, in_double, 1024);
        assert_int_equal(derivatives_of(&row->function, LG_F32, in_float, 1024), n);
        for (size_t j = 0; j < n; j++) most = fmax(most, fabs(in_double[j]));
        lg_all_close(row->function.name, in_float, in_double, n, 2e-5, 2e-5 * most, __FILE__, __LINE__);
    }
}

/* ---- derivatives by one input ---- */

static const double *numbers_of(lg_tape *t, lg_var v) {
    const size_t count = lg_shape_count(lg_var_shape(t, v));
    double *out = TEST_ARRAY(double, count + 1);
    assert_ok(lg_read(t, v, count, out));
    return out;
}

static void assert_same_numbers(const char *name, lg_tape *t, lg_var have, lg_var want) {
    const size_t count = lg_shape_count(lg_var_shape(t, want));
    lg_all_close(name, numbers_of(t, have), numbers_of(t, want), count, 1e-12, 1e-12, __FILE__, __LINE__);
}

TEST("a derivative by one input alone equals its part of the derivative by all inputs, in two orders") {
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        const size_t mark = lg_test_owned();
        const lg_gradcheck_function *f = &row->function;
        lg_tape *t = test_tape(LG_F64);
        lg_rng rng = test_rng(11, 0);
        const row_on_tape r = record_row(t, &rng, f);
        const lg_var weights = weights_of(t, r.y), one = lg_full(t, lg_shape0(), 1.0);
        const lg_var y = lg_sum(t, lg_mul(t, r.y, weights));
        lg_var all[LG_GRADCHECK_MAX_INPUTS], second[LG_GRADCHECK_MAX_INPUTS], alone, again;
        assert_ok(lg_vjp(t, &y, &one, 1, r.x, f->inputs, all));
        /* the derivative by the result itself needs no input */
        const size_t results = lg_shape_count(lg_var_shape(t, r.y));
        double *unit = TEST_ARRAY(double, results + 1);
        assert_ok(lg_vjp(t, &y, &one, 1, &r.y, 1, &alone));
        assert_same_numbers(f->name, t, alone, weights);
        assert_ok(lg_backward_set(t, y, &r.y, 1, &(void *){unit}));
        lg_all_close(f->name, unit, numbers_of(t, weights), results, 0, 0, __FILE__, __LINE__);
        for (uint32_t k = 0; k < f->inputs; k++) {
            const size_t count = lg_shape_count(lg_var_shape(t, r.x[k]));
            double *gradient = TEST_ARRAY(double, count + 1);
            assert_ok(lg_vjp(t, &y, &one, 1, &r.x[k], 1, &alone));
            assert_same_numbers(f->name, t, alone, all[k]);
            assert_ok(lg_backward_set(t, y, &r.x[k], 1, &(void *){gradient}));
            lg_all_close(f->name, gradient, numbers_of(t, all[k]), count, 1e-12, 1e-12, __FILE__, __LINE__);
            if (f->first_order_only) continue;
            const lg_var slope = weighted(t, alone);
            assert_ok(lg_vjp(t, &slope, &one, 1, r.x, f->inputs, second));
            for (uint32_t j = 0; j < f->inputs; j++) {
                assert_ok(lg_vjp(t, &slope, &one, 1, &r.x[j], 1, &again));
                assert_same_numbers(f->name, t, again, second[j]);
            }
            assert_ok(lg_vjp(t, &slope, &one, 1, &alone, 1, &again));
            assert_same_numbers(f->name, t, again, weights_of(t, alone));
        }
        lg_test_give_back(mark);
    }
}

/* ---- rules of shapes ---- */

/* Changes a rank, a length or a setting of an operation. */
static void spoil(lg_rng *rng, lg_shape *shapes, uint32_t inputs, lg_attr *attr) {
    lg_shape *shape = &shapes[lg_rng_below(rng, inputs)];
    uint32_t *length = &shape->dims[lg_rng_below(rng, LG_MAX_RANK)],
             *setting = &attr->i[lg_rng_below(rng, 4)];
    static const uint32_t lengths[] = {0, 1, 2, 3, 5, 4096, UINT32_MAX};
    switch (lg_rng_below(rng, 4)) {
    case 0:
        shape->rank = (uint32_t)lg_rng_below(rng, LG_MAX_RANK + 1);
        for (uint32_t i = 0; i < LG_MAX_RANK; i++)
            if (i >= shape->rank) shape->dims[i] = 0;
        break;
    case 1:
        *length = lengths[lg_rng_below(rng, LG_COUNT(lengths))];
        break;
    case 2:
        *setting = lengths[lg_rng_below(rng, LG_COUNT(lengths))];
        break;
    default:
        attr->c = (double)lg_rng_below(rng, 7) - 1.5;
    }
}

/* Operations of files are checked by these rules alone. */
static void try_rule(lg_rng *rng, const lg_tape *t, uint32_t at) {
    const lg_node *node = &t->nodes[at];
    const uint32_t *parents = lg_parents_of(t, node);
    const lg_shape *in[LG_MAX_INPUTS];
    lg_shape shapes[LG_MAX_INPUTS];
    for (uint32_t k = 0; k < node->inputs; k++) in[k] = &shapes[k];
    for (int draw = 0; draw < 40; draw++) {
        lg_attr attr = node->attr;
        lg_shape first = node->shape, second = node->shape;
        for (uint32_t k = 0; k < node->inputs; k++) shapes[k] = t->nodes[parents[k]].shape;
        for (int i = 0; i < draw % 3; i++) spoil(rng, shapes, node->inputs, &attr);
        const lg_status status = node->op->shape(in, node->inputs, &attr, &first);
        if (draw % 3 == 0 && (status != LG_OK || !lg_same_shape(&first, &node->shape)))
            fail_msg("%s is refused as it is", node->op->name);
        assert_int_equal(node->op->shape(in, node->inputs, &attr, &second), status);
        if (status == LG_OK && (first.rank > LG_MAX_RANK || !lg_same_shape(&first, &second)))
            fail_msg("%s", node->op->name);
    }
}

TEST("rules of shapes accept recorded nodes, and give the same answer to a changed node each time") {
    const lg_gradcheck_case *row;
    lg_rng rng = test_rng(12, 0);
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        const size_t mark = lg_test_owned();
        const lg_gradcheck_function *f = &row->function;
        lg_tape *t = test_tape(LG_F64);
        lg_rng points = test_rng(11, 0);
        const row_on_tape r = record_row(t, &points, f);
        const lg_var y = weighted(t, r.y), one = lg_full(t, lg_shape0(), 1.0);
        lg_var first[LG_GRADCHECK_MAX_INPUTS], again;
        assert_ok(lg_vjp(t, &y, &one, 1, r.x, f->inputs, first));
        for (uint32_t k = 0; k < f->inputs && !f->first_order_only; k++) {
            const lg_var slope = weighted(t, first[k]);
            assert_ok(lg_vjp(t, &slope, &one, 1, r.x, 1, &again));
        }
        for (uint32_t at = 0; at < t->count; at++)
            if (t->nodes[at].inputs > 0 && t->nodes[at].op->payload != LG_PAYLOAD_IN_PROCESS)
                try_rule(&rng, t, at);
        lg_test_give_back(mark);
    }
}

/* ---- values; the gradient check tests only that derivatives fit the values ---- */

/* X(expression in v, its numbers) for v = (1 -2 3; 4 5 -6) and a second variable (1 2 3; 4 5 6). */
#define VALUES(X)                                                                                            \
    X(lg_mean(t, v), 5.0 / 6)                                                                                \
    X(lg_sum_axis(t, v, 0, false), 5, 3, -3)                                                                 \
    X(lg_mean_axis(t, v, 0, false), 2.5, 1.5, -1.5)                                                          \
    X(lg_mean_axis(t, v, -1, true), 2.0 / 3, 1)                                                              \
    X(lg_max_axis(t, v, 1, false), 3, 5)                                                                     \
    X(lg_slice(t, v, 1, 2, 1), 3, -6)                                                                        \
    X(lg_pad(t, v, 0, 1, 0), 0, 0, 0, 1, -2, 3, 4, 5, -6)                                                    \
    X(lg_concat(t, (lg_var[2]){v, good(t)}, 2, 1), 1, -2, 3, 1, 2, 3, 4, 5, -6, 4, 5, 6)                     \
    X(lg_transpose(t, v), 1, 4, -2, 5, 3, -6)                                                                \
    X(lg_gather(t, v, first_rows + 1, 1), 4, 5, -6)                                                          \
    X(lg_rowdot(t, v, good(t)), 6, 5)                                                                        \
    X(lg_cross(t, v, good(t)), -12, 0, 4, 60, -48, 0)                                                        \
    X(lg_mul(t, v, lg_input_f64(t, lg_shape1(3), weights3)), 1, -4, 9, 4, 10, -18)                           \
    X(lg_matmul_nt(t, v, good(t)), 6, 12, -4, 5)                                                             \
    X(lg_matmul_tn(t, v, good(t)), 17, 22, 27, 18, 21, 24, -21, -24, -27)                                    \
    X(lg_linear_combination(t, (lg_var[2]){v, good(t)}, two_less, 2), 1, -6, 3, 4, 5, -18)                   \
    X(lg_spd_solve(t, lg_input_f64(t, lg_shape3(1, 2, 2), positive), lg_reshape(t, v, lg_shape3(1, 2, 3))),  \
      -0.2, -2.2, 3, 1.4, 2.4, -3)

TEST("values agree with those computed by hand") {
    static const double numbers[6] = {1, -2, 3, 4, 5, -6}, two_less[2] = {2, -1}, positive[4] = {2, 1, 1, 3};
    for (int dtype = 0; dtype < 2; dtype++) {
        lg_tape *t = test_tape((lg_dtype)dtype);
        const lg_var v = lg_input_f64(t, lg_shape2(2, 3), numbers);
#define X(expression, ...)                                                                                   \
    {                                                                                                        \
        const double expected[] = {__VA_ARGS__};                                                             \
        assert_reads(t, expression, LG_COUNT(expected), expected, 1e-6, 1e-6);                               \
    }
        VALUES(X)
#undef X
    }
}

/* ---- gradients of gradients ---- */

/* The n-th derivative of x^c. */
static double d_power(double c, int n, double x) {
    double factor = 1;
    for (int i = 0; i < n; i++) factor *= c - i;
    return factor == 0 ? 0 : factor * pow(x, c - n);
}
static double d_x5(int n, double x) {
    return d_power(5, n, x);
}
static double d_reciprocal(int n, double x) {
    return d_power(-1, n, x);
}
static double d_sqrt(int n, double x) {
    return d_power(0.5, n, x);
}
static double d_log(int n, double x) {
    return n == 0 ? log(x) : d_power(-1, n - 1, x);
}
static double d_sin(int n, double x) {
    const double all[4] = {sin(x), cos(x), -sin(x), -cos(x)};
    return all[n % 4];
}
static double d_cos(int n, double x) {
    return d_sin(n + 1, x);
}
static double d_exp(int n, double x) {
    return exp(x);
}
static double d_tanh(int n, double x) {
    double t = tanh(x), s = 1 - t * t;
    const double all[5] = {t, s, -2 * t * s, s * (6 * t * t - 2), s * (16 * t - 24 * t * t * t)};
    return all[n];
}
static double d_sigmoid(int n, double x) {
    return (n == 0 ? 0.5 : 0.0) + 0.5 * pow(0.5, n) * d_tanh(n, 0.5 * x);
}
static double d_swish(int n, double x) {
    return x * d_sigmoid(n, x) + (n > 0 ? n * d_sigmoid(n - 1, x) : 0.0);
}

#define OP(name, expression)                                                                                 \
    static lg_var call_##name(lg_tape *t, lg_var v) {                                                        \
        return expression;                                                                                   \
    }
OP(sin, lg_sin(t, v))
OP(cos, lg_cos(t, v))
OP(exp, lg_exp(t, v))
OP(log, lg_log(t, v))
OP(sqrt, lg_sqrt(t, v))
OP(abs, lg_abs(t, v))
OP(sign, lg_sign(t, v))
OP(swish, lg_act(t, v, LG_SWISH))
OP(x5, lg_pow(t, v, 5))
OP(x5_products, lg_mul(t, lg_mul(t, lg_square(t, v), lg_square(t, v)), v))
OP(tanh, lg_act(t, v, LG_TANH))
OP(tanh_of_exp, lg_div(t, lg_sub(t, lg_exp(t, v), lg_exp(t, lg_neg(t, v))),
                       lg_add(t, lg_exp(t, v), lg_exp(t, lg_neg(t, v)))))
OP(sigmoid, lg_act(t, v, LG_SIGMOID))
OP(sine, lg_act(t, v, LG_SINE))
OP(reciprocal, lg_div(t, lg_full(t, lg_shape0(), 1.0), v))

TEST("derivatives up to order 4 agree with closed forms, for every sequence of forward and reverse mode") {
    static const struct {
        const char *name;
        lg_var (*build)(lg_tape *, lg_var);
        double (*derivative)(int order, double x);
        double x;
    } forms[] = {
        {"x^5", call_x5, d_x5, 1.3},
        {"x^5 at 0", call_x5, d_x5, 0.0},
        {"x x^2 x^2", call_x5_products, d_x5, -0.8},
        {"tanh", call_tanh, d_tanh, 0.4},
        {"tanh by exp", call_tanh_of_exp, d_tanh, -0.3},
        {"sigmoid", call_sigmoid, d_sigmoid, 0.9},
        {"swish", call_swish, d_swish, -0.6},
        {"sine", call_sine, d_sin, 2.1},
        {"sin", call_sin, d_sin, 0.7},
        {"cos", call_cos, d_cos, 0.7},
        {"exp", call_exp, d_exp, -1.1},
        {"log", call_log, d_log, 1.7},
        {"1/x", call_reciprocal, d_reciprocal, -1.4},
        {"sqrt", call_sqrt, d_sqrt, 2.3},
    };
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < LG_COUNT(forms); i++)
        for (int modes = 0; modes < 16; modes++) {
            lg_tape_reset(tape);
            lg_var x = lg_full(tape, lg_shape0(), forms[i].x), one = lg_full(tape, lg_shape0(), 1.0);
            lg_var y = forms[i].build(tape, x);
            for (int order = 0; order <= 4; order++) {
                double expected = forms[i].derivative(order, forms[i].x);
                if (!lg_is_close(number(tape, y), expected, 1e-12, 1e-13))
                    fail_msg("%s, order %d, modes %d: %.17g, expected %.17g", forms[i].name, order, modes,
                             number(tape, y), expected);
                lg_var next = LG_NONE;
                if (order < 4 && (modes >> order & 1)) assert_ok(lg_jvp(tape, &y, 1, &x, &one, 1, &next));
                if (order < 4 && !(modes >> order & 1)) assert_ok(lg_grad(tape, y, &x, 1, &next));
                if (order < 4) y = next;
            }
        }
}

TEST("activations can be differentiated eight times, not more") {
    lg_tape *tape = test_tape(LG_F64);
    lg_var x = lg_full(tape, lg_shape0(), 0.3), y = lg_act(tape, x, LG_TANH);
    for (int order = 1; order <= 8; order++) assert_ok(lg_grad(tape, y, &x, 1, &y));
    assert_status(lg_grad(tape, y, &x, 1, &y), LG_NOT_DIFFERENTIABLE);
    assert_says(lg_tape_message(tape), "act_derivative");
}

/* f(x) = sum_i x_i^3 + x_0 x_1 x_2. Its gradient, Hessian and third derivative are known. */
static lg_var cubic(lg_tape *t, lg_var x) {
    lg_var p =
        lg_mul(t, lg_mul(t, lg_slice(t, x, 0, 0, 1), lg_slice(t, x, 0, 1, 1)), lg_slice(t, x, 0, 2, 1));
    return lg_add(t, lg_sum(t, lg_pow(t, x, 3)), lg_sum(t, p));
}

TEST("a Hessian-vector product and a Hessian agree with those computed by hand") {
    static const double x0[3] = {0.5, -1.5, 2.0}, v0[3] = {1.0, 0.25, -0.75}, zeros[3] = {0};
    double product[3], hessian[9];
    lg_tape *t = test_tape(LG_F64);
    lg_var x = vector(t, 3, x0), v = vector(t, 3, v0), y = cubic(t, x), g;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        product[i] = 6 * x0[i] * v0[i] + x0[k] * v0[j] + x0[j] * v0[k];
        for (int l = 0; l < 3; l++) hessian[3 * i + l] = i == l ? 6 * x0[i] : x0[3 - i - l];
    }
    assert_reads(t, lg_hvp(t, y, x, v), 3, product, 1e-14, 1e-14);
    assert_ok(lg_grad(t, y, &x, 1, &g));
    assert_reads(t, lg_jacobian(t, g, x), 9, hessian, 1e-14, 1e-14);
    assert_reads(t, lg_hvp(t, lg_sum(t, x), x, v), 3, zeros, 0, 0); /* of a linear function */
}

TEST("the Jacobian of y = sin(x A) is J[a, b] = cos(y_a) A[b, a]: wide, tall, and with more than 64 "
     "passes") {
    static const uint32_t sizes[][2] = {{3, 5}, {5, 3}, {4, 4}, {70, 90}, {90, 70}};
    const double *a0 = test_numbers(3, 90 * 90, -1, 1), *x0 = test_numbers(4, 90, -1, 1);
    static double expected[90 * 90];
    lg_tape *t = test_tape(LG_F64);
    for (size_t s = 0; s < LG_COUNT(sizes); s++) {
        const uint32_t in = sizes[s][0], out = sizes[s][1];
        lg_tape_reset(t);
        lg_var x = lg_input_f64(t, lg_shape2(1, in), x0), a = lg_input_f64(t, lg_shape2(in, out), a0);
        lg_var j = lg_jacobian(t, lg_sin(t, lg_matmul(t, x, a)), x);
        for (uint32_t r = 0; r < out; r++) {
            double z = 0;
            for (uint32_t k = 0; k < in; k++) z += x0[k] * a0[k * out + r];
            for (uint32_t k = 0; k < in; k++) expected[r * in + k] = cos(z) * a0[k * out + r];
        }
        assert_reads(t, j, (size_t)in * out, expected, 1e-11, 1e-13);
        assert_int_equal(lg_var_shape(t, j).rank, 2);
        assert_int_equal(lg_var_shape(t, j).dims[0], out);
    }
}

/* ---- gradients by chosen variables ---- */

TEST("lg_backward adds to its outputs and leaves the tape unchanged") {
    static const double x0[3] = {0.5, -1.5, 2.0}, kept[3] = {7, 8, 9};
    double gx[3] = {10, 20, 30}, gz[3] = {1, 2, 3}, ex[3], ez[3], gy = 5.0, unused[3] = {7, 8, 9};
    lg_tape *t = test_tape(LG_F64);
    lg_var x = vector(t, 3, x0), z = lg_scale(t, x, 3.0), y = lg_sum(t, lg_square(t, z));
    /* the inner variable is listed before the leaf */
    const lg_var wrt[2] = {z, x}, both[2] = {y, vector(t, 3, x0)}, twice[2] = {x, x};
    void *const grads[2] = {gz, gx}, *const into[2] = {&gy, unused};
    const size_t nodes = t->count;
    for (int pass = 1; pass <= 3; pass++) {
        for (int i = 0; i < 3; i++)
            ez[i] = 1.0 + i + pass * 6.0 * x0[i], ex[i] = 10.0 * (i + 1) + pass * 18.0 * x0[i];
        assert_ok(lg_backward(t, y, wrt, 2, grads));
        assert_int_equal(t->count, nodes);
        assert_all_close(gz, ez, 3, 1e-14, 0);
        assert_all_close(gx, ex, 3, 1e-14, 0);
    }
    /* by y itself, and by a variable that y does not depend on */
    assert_ok(lg_backward(t, y, both, 2, into));
    assert_close(gy, 6.0, 0, 0);
    assert_all_close(unused, kept, 3, 0, 0);
    assert_ok(lg_backward(t, y, wrt, 0, NULL));
    assert_status(lg_backward(t, y, twice, 2, grads), LG_INVALID_ARGUMENT);
    assert_says(lg_tape_message(t), "twice");
}

/* lg_backward_set into memory full of NaN must equal lg_backward onto zeros to the last bit, for every way to
 * use a flat parameter: random views of 1 to 7 of its 60 elements (few, or more than the tape has places to
 * remember them), views of views, weights, a variable that y does not depend on, inner variables. */
TEST("lg_backward_set equals lg_backward onto zeros, whatever views are used") {
    enum { N = 60, UNUSED = 5 };
    const double *theta = test_numbers(7, N, -1, 1), unused[UNUSED] = {0};
    double added[3][N], set[3][N], bound; /* of the parameter, of an unused variable, of an inner variable */
    const size_t sizes[3] = {N, UNUSED, N};
    lg_rng rng = test_rng(7, 0);
    for (uint32_t views = 1; views < 60; views++) {
        lg_tape *t = test_tape(LG_F64);
        lg_var p = vector(t, N, theta), other = vector(t, UNUSED, unused), z = lg_square(t, p);
        lg_var y = lg_scale(t, lg_sum(t, lg_slice(t, z, 0, 0, N / 2)), 0.25);
        for (uint32_t i = 0; i < views; i++) {
            const uint32_t length = 1 + (uint32_t)lg_rng_below(&rng, 7);
            const uint32_t start = views % 2 == 0 ? 10 * (i % 6) : (uint32_t)lg_rng_below(&rng, N - 7);
            const bool again = length > 3 && i % 4 == 0;
            lg_var part = lg_slice(t, i % 3 == 0 ? z : p, 0, start, length);
            if (again) part = lg_slice(t, part, 0, 1, 2);
            lg_var row = lg_reshape(t, part, lg_shape2(1, again ? 2 : length));
            y = lg_add(t, y, i % 2 == 0 ? lg_sum(t, lg_sin(t, part)) : lg_sum(t, lg_matmul_nt(t, row, row)));
        }
        const lg_var wrt[3] = {p, other, z};
        for (size_t n = 2; n <= 3; n++) {
            double sum = 0;
            void *zeros[3] = {added[0], added[1], added[2]}, *nans[3] = {set[0], set[1], set[2]};
            memset(added, 0, sizeof added);
            memset(set, 0xff, sizeof set);
            assert_ok(lg_backward(t, y, wrt, n, zeros));
            assert_ok(views % 2 == 0 ? lg_backward_set(t, y, wrt, n, nans)
                                     : lg_backward_set_bounded(t, y, wrt, n, nans, &bound));
            for (size_t w = 0; w < n; w++) {
                assert_all_close(set[w], added[w], sizes[w], 0, 0);
                for (size_t i = 0; i < sizes[w]; i++) sum += added[w][i] * added[w][i];
            }
            assert_all_close(added[1], unused, UNUSED, 0, 0);
            assert_true(views % 2 == 0 || (bound >= (1 - 1e-12) * sqrt(sum) && bound < 100 * sqrt(sum)));
        }
    }
}

/* A loss with two layers, and with operations that are no layer. The bound is exact where a gradient has a
 * single contribution; a product contributes a matrix of rank one. Infinity and NaN in any contribution must
 * make the bound infinite or NaN. */
TEST("the bound of a gradient's norm holds, and is exact for single contributions") {
    enum { SIDE = 20, N = SIDE * SIDE + 2 * SIDE };
    static double theta[N], grad[N];
    for (int kind = 0; kind < 6; kind++)
        for (uint32_t rows = 1; rows <= 40; rows += 13) {
            lg_tape *t = test_tape(LG_F64);
            const double left = kind == 1 ? 1e200 : kind == 2 ? NAN : 2.0, right = kind == 1 ? 1e200 : 3.0;
            for (int i = 0; i < N; i++) theta[i] = kind == 3 && i == N - 1 ? 0.0 : 0.25;
            lg_var p = vector(t, N, theta), x = lg_full(t, lg_shape2(rows, SIDE), left);
            lg_var w = lg_reshape(t, lg_slice(t, p, 0, 0, SIDE * SIDE), lg_shape2(SIDE, SIDE));
            lg_var b = lg_slice(t, p, 0, SIDE * SIDE, SIDE), c = lg_slice(t, p, 0, N - SIDE, SIDE);
            /* adds right * left * rows to each element of W's gradient */
            lg_var y = lg_sum(t, lg_scale(t, lg_matmul(t, x, w), right));
            /* kinds 3 to 5: adds 1 to each element of c's gradient; for kind 3 it is infinite for the last
             * one */
            if (kind >= 3) y = lg_add(t, y, lg_sum(t, lg_sqrt(t, c)));
            if (kind >= 4) y = lg_add(t, y, lg_sum(t, lg_scale(t, b, kind == 5 ? -INFINITY : 4.0)));
            const lg_var wrt = p;
            void *into = grad;
            double bound = -1.0, squares = 0.0;
            assert_ok(lg_backward_set_bounded(t, y, &wrt, 1, &into, &bound));
            for (int i = 0; i < N; i++) squares += grad[i] * grad[i];
            if (kind == 0) {
                assert_close(sqrt(squares), SIDE * left * right * rows, 1e-12, 0);
                assert_close(bound, sqrt(squares), 1e-12, 0);
            } else if (kind == 4) {
                const double layer = SIDE * left * right * rows, rest = (4.0 + 1.0) * sqrt(SIDE);
                assert_close(bound, layer + rest, 1e-12, 0);
            } else {
                assert_false(isfinite(squares));
                assert_false(bound < 1e300);
            }
        }
}

/* Two inputs of one operation are overlapping views of the parameter, longer than a block of the kernels: x
 * and its factor in the derivative of an activation; vector and angle of a rotation. */
TEST("inputs of one operation may be overlapping views") {
    enum { N = 1200, LENGTH = 900 };
    static double set[N], zero[N];
    const double *theta = test_numbers(8, N, -1, 1);
    for (uint32_t apart = 0; apart <= 300; apart += 60)
        for (int kind = 0; kind < 3; kind++) {
            lg_tape *t = test_tape(LG_F64);
            lg_var p = vector(t, N, theta), y = LG_NONE;
            lg_var x = lg_slice(t, p, 0, apart, LENGTH), q = lg_slice(t, p, 0, 300 - apart, LENGTH);
            if (kind < 2) {
                lg_var h = lg_act(t, kind == 0 ? x : q, LG_TANH);
                assert_ok(lg_vjp(t, &h, kind == 0 ? &q : &x, 1, kind == 0 ? &x : &q, 1, &y));
            } else {
                const lg_shape rows = lg_shape2(LENGTH / 3, 3);
                lg_var a = lg_reshape(t, x, rows), b = lg_reshape(t, q, rows);
                y = lg_mul(t, lg_cross(t, a, b), lg_mul(t, a, b));
            }
            lg_var loss = lg_sum(t, lg_sin(t, y));
            memset(zero, 0, sizeof zero);
            memset(set, 0xff, sizeof set);
            assert_ok(lg_backward(t, loss, &p, 1, (void *[]){zero}));
            assert_ok(lg_backward_set(t, loss, &p, 1, (void *[]){set}));
            assert_all_close(set, zero, N, 1e-13, 1e-15);
        }
}

/* Derivatives are total: a variable that depends on another requested variable passes its contribution on to
 * it, in every mode. */
TEST("derivatives are total: they pass through other requested variables") {
    lg_tape *t = test_tape(LG_F64);
    lg_var x = lg_full(t, lg_shape0(), 2.0), z = lg_square(t, x), y = lg_mul(t, z, x);
    lg_var wrt[3] = {x, z, x}, out[3], d[2] = {lg_full(t, lg_shape0(), 0.5), lg_full(t, lg_shape0(), 0.25)};
    assert_ok(lg_grad(t, y, wrt, 3, out));
    assert_close(number(t, out[0]), 12.0, 1e-15, 0); /* d x^3 */
    assert_close(number(t, out[1]), 2.0, 1e-15, 0);  /* x */
    assert_close(number(t, out[2]), 12.0, 1e-15, 0);
    double gx = 0, gz = 0;
    void *grads[2] = {&gx, &gz};
    assert_ok(lg_backward(t, y, wrt, 2, grads));
    assert_close(gx, 12.0, 1e-15, 0);
    assert_close(gz, 2.0, 1e-15, 0);
    assert_ok(lg_jvp(t, &y, 1, wrt, d, 2, out));
    assert_close(number(t, out[0]), 12.0 * 0.5 + 2.0 * 0.25, 1e-15, 0);
    /* Outputs that are older than the variables, the variable itself, and no variables at all. */
    lg_var ys[3] = {x, y, z};
    assert_ok(lg_jvp(t, ys, 3, &z, &d[0], 1, out));
    assert_close(number(t, out[0]), 0.0, 0, 0);
    assert_close(number(t, out[1]), 2.0 * 0.5, 1e-15, 0);
    assert_close(number(t, out[2]), 0.5, 0, 0);
    lg_var same[2] = {x, x}; /* given twice: both directions are added */
    assert_ok(lg_jvp(t, &y, 1, same, d, 2, out));
    assert_close(number(t, out[0]), 12.0 * 0.75, 1e-15, 0);
    assert_ok(lg_jvp(t, &y, 1, NULL, NULL, 0, out));
    assert_close(number(t, out[0]), 0.0, 0, 0);
    assert_ok(lg_grad(t, x, &y, 1, out));
    assert_close(number(t, out[0]), 0.0, 0, 0);
    assert_ok(lg_vjp(t, ys, ys, 3, &x, 1, out)); /* several outputs: x + y 3 x^2 + z 2 x */
    assert_close(number(t, out[0]), 2.0 + 8.0 * 12.0 + 4.0 * 4.0, 1e-15, 0);
}

TEST("a flat parameter may have slices that overlap, are reshaped, sliced again and used many times") {
    double theta[12], expected[12], grad[12], got[12];
    float theta32[12], grad32[12];
    for (int i = 0; i < 12; i++) theta32[i] = (float)(theta[i] = 0.1 * (i + 1));
    for (int f32 = 0; f32 < 2; f32++) {
        const double tolerance = f32 ? 1e-6 : 1e-14;
        lg_tape *t = test_tape(f32 ? LG_F32 : LG_F64);
        const void *const given = f32 ? (const void *)theta32 : theta;
        lg_var p = lg_parameter(t, lg_shape1(12), given), out;
        assert_ptr_equal(lg_value(t, p), given);                                     /* not copied */
        lg_var a = lg_slice(t, p, 0, 0, 6), b = lg_slice(t, p, 0, 4, 6);             /* both contain 4, 5 */
        lg_var m = lg_reshape(t, a, lg_shape2(2, 3)), row = lg_slice(t, m, 0, 1, 1); /* 3, 4, 5 */
        lg_var column = lg_slice(t, m, 1, 1, 1); /* 1, 4; not contiguous */
        lg_var y = lg_add(t, lg_sum(t, a), lg_scale(t, lg_sum(t, b), 10.0));
        for (int i = 0; i < 3; i++) y = lg_add(t, y, lg_scale(t, lg_sum(t, row), 100.0));
        y = lg_add(t, y, lg_scale(t, lg_sum(t, column), 1000.0));
        y = lg_add(t, y, lg_sum(t, lg_matmul_nt(t, m, m))); /* used on both sides */
        for (int with_slice = 0; with_slice < 2; with_slice++) {
            const lg_var wrt[2] = {p, a};
            memset(grad, 0, sizeof grad);
            memset(grad32, 0, sizeof grad32);
            for (int i = 0; i < 12; i++)
                expected[i] = (i < 6 ? 1.0 : 0.0) + (i >= 4 && i < 10 ? 10.0 : 0.0) +
                              (i >= 3 && i < 6 ? 300.0 : 0.0) + (i == 1 || i == 4 ? 1000.0 : 0.0) +
                              (i < 6 ? 2 * (theta[i % 3] + theta[3 + i % 3]) : 0.0);
            assert_ok(lg_grad(t, y, &p, 1, &out));
            assert_reads(t, out, 12, expected, tolerance, 0);
            /* The slice a has 6 elements; what y gets through b does not count for it. */
            const size_t n = with_slice ? 6 : 12;
            for (int i = 4; with_slice && i < 6; i++) expected[i] -= 10.0;
            void *const into = f32 ? (void *)grad32 : grad;
            assert_ok(lg_backward(t, y, &wrt[with_slice], 1, &into));
            for (int i = 0; i < 12; i++) got[i] = f32 ? (double)grad32[i] : grad[i];
            assert_all_close(got, expected, n, tolerance, 1e-4 * f32);
        }
    }
}

/* ---- NaN and kinks ---- */

TEST("NaN is not an error") {
    lg_tape *t = test_tape(LG_F64);
    static const double x0[2] = {-1.0, 4.0};
    double y[2], g[2];
    lg_var x = vector(t, 2, x0), r = lg_sqrt(t, x), gradient;
    assert_ok(lg_read(t, r, 2, y));
    assert_true(isnan(y[0]));
    assert_close(y[1], 2.0, 0, 0);
    assert_ok(lg_grad(t, r, &x, 1, &gradient));
    assert_ok(lg_read(t, gradient, 2, g));
    assert_true(isnan(g[0]));
    assert_close(g[1], 0.25, 0, 0);
    assert_true(isnan(number(t, lg_max_axis(t, r, 0, false))));
    assert_true(isinf(number(t, lg_log(t, lg_full(t, lg_shape0(), 0.0)))));
    assert_ok(lg_tape_status(t));
}

TEST("at each kink the derivative is that of the documented side; second derivatives are zero") {
    static const struct {
        const char *name;
        lg_var (*call)(lg_tape *, lg_var);
        double value, derivative;
    } kinks[] = {
        {"abs", call_abs, 0.0, 1.0},
        {"sign", call_sign, 1.0, 0.0},
    };
    static const double activation_slope[LG_ACTIVATION_COUNT] = {
        [LG_IDENTITY] = 1.0, [LG_TANH] = 1.0,        [LG_SIGMOID] = 0.25, [LG_SWISH] = 0.5,
        [LG_RELU] = 0.0,     [LG_LEAKY_RELU] = 0.01, [LG_SINE] = 1.0};
    lg_tape *t = test_tape(LG_F64);
    for (size_t i = 0; i < LG_COUNT(kinks); i++) {
        lg_var x = lg_full(t, lg_shape0(), 0.0), y = kinks[i].call(t, x), g, gg;
        assert_close(number(t, y), kinks[i].value, 0, 0);
        assert_ok(lg_grad(t, y, &x, 1, &g));
        assert_close(number(t, g), kinks[i].derivative, 0, 0);
        assert_ok(lg_grad(t, g, &x, 1, &gg));
        assert_close(number(t, gg), 0.0, 0, 0);
    }
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++) {
        lg_var x = lg_full(t, lg_shape0(), 0.0), g;
        assert_ok(lg_grad(t, lg_act(t, x, (lg_activation)kind), &x, 1, &g));
        assert_close(number(t, g), activation_slope[kind], 0, 0);
    }
    static const double tie[4] = {1.0, 3.0, 3.0, 2.0};
    double got[4];
    lg_var x = vector(t, 4, tie), g, ab[2] = {lg_full(t, lg_shape0(), 2.0), lg_full(t, lg_shape0(), 2.0)},
           gab[2];
    assert_ok(lg_grad(t, lg_max_axis(t, x, 0, false), &x, 1, &g));
    assert_ok(lg_read(t, g, 4, got));
    /* the first of equal numbers */
    for (int i = 0; i < 4; i++) assert_close(got[i], i == 1 ? 1.0 : 0.0, 0, 0);
    assert_ok(lg_grad(t, lg_max(t, ab[0], ab[1]), ab, 2, gab));
    assert_close(number(t, gab[0]), 1.0, 0, 0);
    assert_close(number(t, gab[1]), 0.0, 0, 0);
}

/* ---- linear solves ---- */

TEST("a solve that fails is NaN in its row alone") {
    static const double a[12] = {4, 1, 3, 2 /* symmetric part 4 2; 2 2 */, -1, 0, 0, 1, 2, 0, 0, 5},
                        b[6] = {2, 4, 1, 1, 4, 10}, expected[6] = {-1, 3, NAN, NAN, 2, 2};
    double x[6];
    lg_tape *t = test_tape(LG_F64);
    lg_var va = lg_input_f64(t, lg_shape3(3, 2, 2), a), vb = lg_input_f64(t, lg_shape3(3, 2, 1), b);
    lg_var vx = lg_spd_solve(t, va, vb);
    assert_ok(lg_read(t, vx, 6, x));
    assert_true(isnan(x[2]) && isnan(x[3]));
    assert_all_close(x, expected, 2, 1e-14, 0);
    assert_all_close(x + 4, expected + 4, 2, 1e-15, 0);
}

/* ---- long sums ---- */

enum { LONG_ROWS = 1 << 18 };

/* Gradient of sum(f) in v, of one number per column. */
static lg_var slope_in(lg_tape *t, lg_var f, lg_var v) {
    lg_var g = LG_NONE;
    (void)lg_grad(t, lg_sum(t, f), &v, 1, &g);
    return g;
}

TEST("long reductions in f32 are as exact as their result") {
    static const uint32_t widths[] = {1, 2, 7};
    static uint32_t first[LONG_ROWS];
    for (size_t w = 0; w < LG_COUNT(widths); w++) {
        const uint32_t n = LONG_ROWS, k = widths[w];
        lg_rng rng = test_rng(21, k);
        double *x = TEST_ARRAY(double, (size_t)n *k), *z = TEST_ARRAY(double, (size_t)n *k);
        double sum = 0, all = 0, squares = 0, products = 0;
        for (size_t i = 0; i < (size_t)n * k; i++) {
            x[i] = (double)(float)lg_rng_uniform_in(&rng, 250, 320);
            z[i] = (double)(float)lg_rng_uniform_in(&rng, 1, 2);
            all += x[i];
            if (i % k != 0) continue;
            sum += x[i];
            squares += x[i] * x[i];
            products += x[i] * z[i];
        }
        lg_tape *t = test_tape(LG_F32);
        const lg_shape series = lg_shape3(1, n, k), matrix = lg_shape2(n, k);
        const lg_var X = lg_input_f64(t, matrix, x), Z = lg_input_f64(t, matrix, z);
        const lg_var XT = lg_transpose(t, X), ZT = lg_transpose(t, Z), X3 = lg_reshape(t, X, series);
        const lg_var one = lg_full(t, lg_shape2(1, k), 1.0), bias = lg_full(t, lg_shape1(k), 0.0);
        const lg_var ones = lg_full(t, lg_shape2(n, 1), 1.0), taps = lg_full(t, lg_shape3(1, 1, k), 1.0);
        const lg_var dense = lg_dense(t, ones, one, bias, LG_IDENTITY);
        const lg_var conv =
            lg_conv1d_dense(t, lg_reshape(t, ones, lg_shape3(1, n, 1)), taps, bias, 1, 0, LG_IDENTITY);
        const struct {
            const char *name;
            lg_var y; /* its first number is compared */
            double right;
        } rows[] = {
            {"sum", lg_sum(t, X), all},
            {"mean", lg_mean(t, X), all / n / k},
            {"loss", lg_loss_record(t, LG_LOSS_MAE, X, lg_scale(t, X, 0.0), LG_NONE), all / n / k},
            {"sum_axis 0", lg_sum_axis(t, X, 0, false), sum},
            {"mean_axis 0", lg_mean_axis(t, X, 0, true), sum / n},
            {"sum_axis in the middle", lg_sum_axis(t, X3, 1, false), sum},
            {"sum_axis 1", lg_sum_axis(t, XT, 1, false), sum},
            {"sum_to", lg_sum_to(t, X, lg_shape1(k)), sum},
            {"rownorm2", lg_rownorm2(t, XT), squares},
            {"rowdot", lg_rowdot(t, XT, ZT), products},
            {"matmul", lg_matmul(t, XT, Z), products},
            {"matmul_nt", lg_matmul_nt(t, XT, ZT), products},
            {"matmul_tn", lg_matmul_tn(t, X, Z), products},
            {"scatter", lg_scatter(t, X, first, n, 3), sum},
            {"avg_pool1d", lg_avg_pool1d(t, X3, n, 1), sum / n},
            {"gradient of a gather", slope_in(t, lg_mul(t, lg_gather(t, one, first, n), X), one), sum},
            {"gradient of a broadcast", slope_in(t, lg_mul(t, lg_broadcast_to(t, one, matrix), X), one), sum},
            {"gradient of a bias", slope_in(t, lg_mul(t, dense, X), bias), sum},
            {"gradient of a weight", slope_in(t, lg_mul(t, dense, X), one), sum},
            {"gradient of a bias of a convolution", slope_in(t, lg_mul(t, conv, X3), bias), sum},
            {"gradient of a kernel", slope_in(t, lg_mul(t, conv, X3), taps), sum},
        };
        for (size_t i = 0; i < LG_COUNT(rows); i++) {
            double y[64];
            const size_t count = lg_shape_count(lg_var_shape(t, rows[i].y));
            if (lg_read(t, rows[i].y, count, y) != LG_OK)
                fail_msg("%s: %s", rows[i].name, lg_tape_message(t));
            if (!(fabs(y[0] - rows[i].right) <= 2e-6 * rows[i].right))
                fail_msg("%s of %u columns: relative error %.3g", rows[i].name, k, y[0] / rows[i].right - 1);
        }
    }
}

/* ---- losses ---- */

TEST("losses agree with those computed by hand, with and without weights") {
    static const double y0[4] = {0.5, -2.0, 1.5, 0.25}, t0[4] = {0.0, 1.0, 0.5, 1.0}, w0[2] = {2.0, 0.5};
    double expected[LG_LOSS_COUNT] = {0}, weighted[LG_LOSS_COUNT] = {0};
    for (int i = 0; i < 4; i++) {
        double r = y0[i] - t0[i], w = w0[i / 2];
        double each[] = {[LG_LOSS_MSE] = r * r,
                         [LG_LOSS_MAE] = fabs(r),
                         [LG_LOSS_HUBER] = fabs(r) <= 1 ? r * r / 2 : fabs(r) - 0.5,
                         [LG_LOSS_BCE_LOGITS] = fmax(y0[i], 0) - y0[i] * t0[i] + log1p(exp(-fabs(y0[i])))};
        for (size_t l = 0; l < LG_COUNT(each); l++) {
            expected[l] += each[l] / 4;
            weighted[l] += w * each[l] / 4;
        }
        double total = exp(y0[i / 2 * 2]) + exp(y0[i / 2 * 2 + 1]);
        expected[LG_LOSS_CROSS_ENTROPY] -= t0[i] * (y0[i] - log(total)) / 2;
        weighted[LG_LOSS_CROSS_ENTROPY] -= w * t0[i] * (y0[i] - log(total)) / 2;
    }
    lg_tape *t = test_tape(LG_F64);
    lg_var y = lg_input_f64(t, lg_shape2(2, 2), y0), target = lg_input_f64(t, lg_shape2(2, 2), t0);
    lg_var w = vector(t, 2, w0);
    for (int l = 0; l < LG_LOSS_COUNT; l++) {
        assert_close(number(t, lg_loss_record(t, (lg_loss)l, y, target, LG_NONE)), expected[l], 1e-14, 0);
        assert_close(number(t, lg_loss_record(t, (lg_loss)l, y, target, w)), weighted[l], 1e-14, 0);
    }
    assert_close(number(t, lg_mse(t, y, target)), expected[0], 1e-14, 0);
}

typedef struct loss_point {
    lg_loss loss;
    double y, t, value, slope, curvature;
} loss_point;

static void check_loss_point(lg_dtype dtype, const loss_point *p) {
    const double tolerance = dtype == LG_F64 ? 4e-16 : 2e-7;
    lg_tape *t = test_tape(dtype);
    const lg_var y = vector(t, 1, &p->y), target = vector(t, 1, &p->t);
    const lg_var loss = lg_loss_record(t, p->loss, y, target, LG_NONE);
    lg_var g, gg;
    double back;
    assert_ok(lg_grad(t, loss, &y, 1, &g));
    assert_ok(lg_grad(t, g, &y, 1, &gg));
    const double got[3] = {number(t, loss), number(t, g), number(t, gg)},
                 right[3] = {p->value, p->slope, p->curvature};
    for (int i = 0; i < 3; i++)
        if (!(got[i] == right[i] || fabs(got[i] - right[i]) <= tolerance * fmax(1.0, fabs(right[i]))))
            fail_msg("loss %d, %s, y = %g, t = %g, derivative %d: %.17g, expected %.17g", p->loss,
                     dtype == LG_F64 ? "f64" : "f32", p->y, p->t, i, got[i], right[i]);
    /* a sample of weight 0 counts as 0, even if its loss is infinite */
    const lg_var none = lg_full(t, lg_shape1(1), 0.0);
    const lg_var weighted = lg_loss_record(t, p->loss, y, target, none);
    assert_ok(lg_grad(t, weighted, &y, 1, &g));
    back = number(t, g);
    assert_close(number(t, weighted), 0.0, 0, 0);
    assert_close(back, 0.0, 0, 0);
}

TEST("every loss has the right value and derivatives at 0, at its kinks and far away") {
    static const double logits[] = {-1e3, -30, -1, -1e-9, -0.0, 0, 1e-9, 1, 30, 1e3}, targets[] = {0, 0.5, 1};
    static const double residuals[] = {-1e3, -2, -1, -0.5, -0.0, 0, 0.5, 1, 2, 1e3};
    static const lg_dtype types[] = {LG_F64, LG_F32};
    for (size_t d = 0; d < 2; d++) {
        for (size_t i = 0; i < LG_COUNT(logits); i++)
            for (size_t j = 0; j < LG_COUNT(targets); j++) {
                const double y = logits[i], t = targets[j], s = 1 / (1 + exp(-y));
                check_loss_point(types[d], &(loss_point){LG_LOSS_BCE_LOGITS, y, t,
                                                         fmax(y, 0) - y * t + log1p(exp(-fabs(y))), s - t,
                                                         s / (1 + exp(y))});
            }
        for (size_t i = 0; i < LG_COUNT(residuals); i++) {
            const double r = residuals[i], size = fabs(r), inside = size <= 1;
            const loss_point points[] = {
                {LG_LOSS_MSE, r, 0, r * r, 2 * r, 2},
                {LG_LOSS_MAE, r, 0, size, r >= 0 ? 1 : -1, 0},
                {LG_LOSS_HUBER, r, 0, inside ? r * r / 2 : size - 0.5, fmax(-1, fmin(r, 1)), inside},
            };
            for (size_t l = 0; l < LG_COUNT(points); l++) check_loss_point(types[d], &points[l]);
        }
        static const loss_point infinite[] = {{LG_LOSS_BCE_LOGITS, -INFINITY, 0, 0, 0, 0},
                                              {LG_LOSS_BCE_LOGITS, INFINITY, 1, 0, 0, 0},
                                              {LG_LOSS_BCE_LOGITS, -INFINITY, 1, INFINITY, -1, 0},
                                              {LG_LOSS_BCE_LOGITS, INFINITY, 0, INFINITY, 1, 0}};
        for (size_t l = 0; l < LG_COUNT(infinite); l++) check_loss_point(types[d], &infinite[l]);
    }
}

TEST("a class with a logit of -inf has probability 0: its loss counts only if it is the target") {
    static const double logits[3] = {-INFINITY, 0, 0}, p[3] = {0, 0.5, 0.5}, along[3] = {3, 2, -1};
    static const double targets[][3] = {{0, 1, 0}, {0, 0.25, 0.75}, {0, 0, 0}, {1, 0, 0}, {0.5, 0.5, 0}};
    static const lg_dtype types[] = {LG_F64, LG_F32};
    for (size_t d = 0; d < 2; d++)
        for (size_t i = 0; i < LG_COUNT(targets); i++) {
            const double *t0 = targets[i], sum = t0[0] + t0[1] + t0[2], rounding = d == 0 ? 1e-15 : 1e-6;
            double g[3], gg[3], mean = 0, masked[1];
            lg_tape *tape = test_tape(types[d]);
            lg_var y = lg_input_f64(tape, lg_shape2(1, 3), logits),
                   t = lg_input_f64(tape, lg_shape2(1, 3), t0);
            lg_var v = lg_input_f64(tape, lg_shape2(1, 3), along), dy, ddy;
            lg_var loss = lg_loss_record(tape, LG_LOSS_CROSS_ENTROPY, y, t, LG_NONE);
            assert_ok(lg_grad(tape, loss, &y, 1, &dy));
            assert_ok(lg_grad(tape, lg_sum(tape, lg_mul(tape, dy, v)), &y, 1, &ddy));
            assert_ok(lg_read(tape, dy, 3, g));
            assert_ok(lg_read(tape, ddy, 3, gg));
            const double value = number(tape, loss);
            if (t0[0] > 0)
                assert_true(value == (double)INFINITY);
            else
                assert_close(value, sum * log(2), rounding, rounding);
            for (int c = 0; c < 3; c++) mean += p[c] * along[c];
            for (int c = 0; c < 3; c++) {
                assert_close(g[c], sum * p[c] - t0[c], rounding, rounding);
                assert_close(gg[c], sum * p[c] * (along[c] - mean), rounding, rounding);
            }
            assert_ok(lg_read(tape, lg_slice(tape, lg_log_softmax(tape, y), 1, 0, 1), 1, masked));
            assert_true(masked[0] == -(double)INFINITY);
        }
}

/* ---- custom operations ---- */

static lg_status failing_forward(void *user, lg_dtype dtype, const void *const *in, void *y) {
    return LG_NO_CONVERGENCE;
}
static lg_status wrong_shape_vjp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y, lg_var g,
                                 const bool *need, lg_var *out) {
    out[0] = lg_sum(tape, g);
    return LG_OK;
}
static lg_status failing_vjp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y, lg_var g,
                             const bool *need, lg_var *out) {
    return LG_NO_CONVERGENCE;
}
/* Uses operations with payload, and writes invalid handles where no cotangent is needed. */
static lg_status payload_vjp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y, lg_var g,
                             const bool *need, lg_var *out) {
    static const uint32_t order[3] = {0, 1, 2};
    if (need[0]) out[0] = lg_gather(tape, g, order, 3);
    if (!need[1]) out[1] = (lg_var){4000000000u, 1};
    return LG_OK;
}
/* Returns one temporary for both inputs; then a temporary and a view of a part of it. */
static lg_status shared_vjp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y, lg_var g,
                            const bool *need, lg_var *out) {
    out[0] = out[1] = lg_scale(tape, g, 2.0);
    return LG_OK;
}
static lg_status shared_part_vjp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y, lg_var g,
                                 const bool *need, lg_var *out) {
    out[0] = lg_scale(tape, g, 2.0);
    out[1] = lg_slice(tape, out[0], 0, 0, 2);
    return LG_OK;
}
static const lg_custom_op custom_table[] = {
    {.name = "bad forward", .forward = failing_forward},
    {.name = "bad shape", .forward = identity_forward, .vjp = wrong_shape_vjp},
    {.name = "bad vjp", .forward = identity_forward, .vjp = failing_vjp},
    {.name = "bare", .forward = identity_forward},
    {.name = "payload", .forward = identity_forward, .vjp = payload_vjp},
    {.name = "shared", .forward = identity_forward, .vjp = shared_vjp},
    {.name = "shared part", .forward = identity_forward, .vjp = shared_part_vjp},
};

TEST("failures of custom operations name the operation") {
    static const double x0[3] = {1, 2, 3};
    static const lg_status expected[4] = {LG_NO_CONVERGENCE, LG_SHAPE, LG_NO_CONVERGENCE,
                                          LG_NOT_DIFFERENTIABLE};
    lg_tape *t = test_tape(LG_F64);
    for (int backward = 0; backward < 2; backward++)
        for (size_t i = 0; i < 4; i++) {
            lg_tape_reset(t);
            double g[3] = {0};
            void *grad = g;
            lg_var x = vector(t, 3, x0), y = lg_custom(t, &custom_table[i], &x, 1, lg_shape1(3)), out;
            lg_status status = backward ? lg_backward(t, y, &x, 1, &grad) : lg_grad(t, y, &x, 1, &out);
            assert_int_equal(status, expected[i]);
            assert_says(lg_tape_message(t), custom_table[i].name);
        }
    lg_tape_reset(t);
    lg_var x = vector(t, 3, x0), y = lg_custom(t, &custom_table[3], &x, 1, lg_shape1(3)), out;
    assert_status(lg_jvp(t, &y, 1, &x, &x, 1, &out), LG_NOT_DIFFERENTIABLE);
    assert_says(lg_tape_message(t), "bare");
    lg_tape_reset(t);
    lg_var many[LG_CUSTOM_MAX_INPUTS + 1];
    for (size_t i = 0; i < LG_COUNT(many); i++) many[i] = vector(t, 3, x0);
    assert_true(lg_is_none(lg_custom(t, &custom_table[1], many, LG_COUNT(many), lg_shape1(3))));
    assert_int_equal(lg_tape_status(t), LG_INVALID_ARGUMENT);
    lg_tape_reset(t);
    assert_true(lg_is_none(lg_custom(t, &custom_table[1], NULL, 1, lg_shape1(3))));
    assert_int_equal(lg_tape_status(t), LG_INVALID_ARGUMENT);
}

/* y = x^2 with both kinds of vjp, recorded and numeric, which count their calls. */
typedef struct both_counts {
    int built, numeric;
} both_counts;

static lg_status square_forward(void *user, lg_dtype dtype, const void *const *in, void *y) {
    const double *x = in[0];
    for (int i = 0; i < 3; i++) ((double *)y)[i] = x[i] * x[i];
    return LG_OK;
}
static lg_status square_vjp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y, lg_var g,
                            const bool *need, lg_var *out) {
    ((both_counts *)user)->built++;
    out[0] = lg_scale(tape, lg_mul(tape, g, in[0]), 2.0);
    return LG_OK;
}
static lg_status square_numeric_vjp(void *user, lg_dtype dtype, const void *const *in, const void *y,
                                    const void *g, void *const *out) {
    const double *x = in[0], *by = g;
    ((both_counts *)user)->numeric++;
    for (int i = 0; i < 3; i++) ((double *)out[0])[i] = 2.0 * by[i] * x[i];
    return LG_OK;
}

TEST("a custom operation's numeric vjp serves the last pass, the recorded vjp all other orders") {
    static const double x0[3] = {1, 2, 3}, added[3] = {3, 5, 7}, set[3] = {2, 4, 6}, two[3] = {2, 2, 2};
    both_counts counts = {0, 0};
    const lg_custom_op op = {.name = "square",
                             .forward = square_forward,
                             .vjp = square_vjp,
                             .numeric_vjp = square_numeric_vjp,
                             .user = &counts};
    lg_tape *t = test_tape(LG_F64);
    double first[3] = {1, 1, 1}, second[3];
    void *into_first = first, *into_second = second;
    lg_var x = vector(t, 3, x0), y = lg_custom(t, &op, &x, 1, lg_shape1(3)), g;
    assert_ok(lg_backward(t, y, &x, 1, &into_first));
    assert_true(counts.numeric == 1 && counts.built == 0);
    assert_all_close(first, added, 3, 0, 0);
    assert_ok(lg_backward_set(t, y, &x, 1, &into_first));
    assert_true(counts.numeric == 2 && counts.built == 0);
    assert_all_close(first, set, 3, 0, 0);
    assert_ok(lg_grad(t, y, &x, 1, &g));
    assert_true(counts.numeric == 2 && counts.built == 1);
    /* Between g and x there are only recorded operations of the tape, not the square, so no vjp is called
     * again. */
    assert_ok(lg_backward_set(t, g, &x, 1, &into_second));
    assert_all_close(second, two, 3, 0, 0);
    assert_true(counts.numeric == 2 && counts.built == 1);
}

TEST("the payload of a custom vjp is freed after the last pass") {
    static const double x0[3] = {1, 2, 3};
    lg_tape *t = test_tape(LG_F64);
    lg_var in[2] = {vector(t, 3, x0), vector(t, 3, x0)};
    lg_var y = lg_custom(t, &custom_table[4], in, 2, lg_shape1(3));
    double g[3] = {0};
    void *grad = g;
    assert_ok(lg_backward(t, y, in, 1, &grad));
    lg_mark before = lg_tape_mark(t);
    size_t bytes = lg_tape_size(t);
    for (int i = 0; i < 10000; i++) assert_ok(lg_backward(t, y, in, 1, &grad));
    lg_mark after = lg_tape_mark(t);
    assert_int_equal(after.used, before.used); /* the payload of the vjp's operations is freed */
    assert_int_equal(after.chunk, before.chunk);
    assert_int_equal(lg_tape_size(t), bytes);
    for (int i = 0; i < 3; i++) assert_close(g[i], 10001.0, 0, 0);
}

/* A temporary that serves two inputs must not be used as the adjoint of one input while it is still read for
 * the other. */
TEST("a temporary may serve two inputs of a custom vjp") {
    static const double x0[3] = {1, 2, 3}, ten[3] = {10, 20, 30};
    lg_tape *t = test_tape(LG_F64);
    for (int part = 0; part < 2; part++) {
        lg_tape_reset(t);
        lg_var x = vector(t, 3, x0), a = lg_scale(t, x, 1.0);
        lg_var b = part ? lg_slice(t, a, 0, 1, 2) : lg_scale(t, x, 1.0), in[2] = {a, b}, g,
               c = vector(t, 3, ten);
        /* Recorded before the custom operation, so that the custom operation's cotangents come first. */
        lg_var aa = lg_mul(t, a, a), bb = lg_mul(t, b, b);
        lg_var y = lg_custom(t, &custom_table[5 + part], in, 2, lg_shape1(3));
        lg_var z = lg_add(t, lg_sum(t, lg_mul(t, c, lg_add(t, y, aa))), lg_sum(t, bb));
        double grad[3] = {0}, recorded[3];
        void *into = grad;
        assert_ok(lg_backward(t, z, &x, 1, &into));
        assert_ok(lg_grad(t, z, &x, 1, &g));
        assert_ok(lg_read(t, g, 3, recorded));
        for (int i = 0; i < 3; i++) {
            double second = part ? (i > 0 ? 2 * ten[i - 1] + 2 * x0[i] : 0.0) : 2 * ten[i] + 2 * x0[i];
            double expected = 2 * ten[i] + 2 * ten[i] * x0[i] + second;
            assert_close(grad[i], expected, 1e-14, 0);
            assert_close(recorded[i], expected, 1e-14, 0);
        }
    }
}

TEST("activations have names") {
    ASSERT_NAMES(lg_activation, lg_activation, LG_ACTIVATION_COUNT);
}

TEST("empty tensors pass through without reading or writing") {
    lg_tape *t = test_tape(LG_F64);
    lg_var x = lg_full(t, lg_shape2(0, 3), 1.0), w = lg_full(t, lg_shape2(3, 4), 1.0), g;
    lg_var y = lg_sum(t, lg_act(t, lg_matmul(t, x, w), LG_TANH));
    assert_close(number(t, y), 0.0, 0, 0);
    assert_ok(lg_grad(t, y, &w, 1, &g));
    assert_close(number(t, lg_sum(t, g)), 0.0, 0, 0);
    lg_var inner = lg_matmul(t, lg_full(t, lg_shape2(2, 0), 1.0), lg_full(t, lg_shape2(0, 3), 1.0));
    assert_close(number(t, lg_sum(t, inner)), 0.0, 0, 0);
    assert_ok(lg_tape_status(t));
}

static lg_status vjp_with_a_pass(void *user, lg_tape *t, const lg_var *inputs, size_t n, lg_var y, lg_var g,
                                 const bool *need, lg_var *out) {
    double inner[3] = {0};
    void *memory = inner;
    out[0] = g;
    return lg_backward(t, g, inputs, 1, &memory);
}

TEST("the last pass cannot run inside itself; the tape is usable again after a rewind") {
    static const double x0[3] = {1, 2, 3}, expected[3] = {2, 4, 6};
    const lg_custom_op op = {.name = "nested", .forward = identity_forward, .vjp = vjp_with_a_pass};
    double grad[3] = {0};
    void *memory = grad;
    lg_tape *t = test_tape(LG_F64);
    lg_var x = vector(t, 3, x0);
    assert_status(lg_backward(t, lg_custom(t, &op, &x, 1, lg_shape1(3)), &x, 1, &memory), LG_UNSUPPORTED);
    assert_says(lg_tape_message(t), "backward");
    lg_tape_reset(t);
    x = vector(t, 3, x0);
    memset(grad, 0, sizeof grad);
    assert_ok(lg_backward(t, lg_square(t, x), &x, 1, &memory));
    assert_all_close(grad, expected, 3, 0, 0);
}

/* y = sum of tanh(x W + b) exp(c); rows differ in x alone. */
static lg_var rows_of_layer(lg_tape *t, lg_var theta, lg_var x) {
    const lg_var W = lg_reshape(t, lg_slice(t, theta, 0, 0, 6), lg_shape2(3, 2)),
                 b = lg_slice(t, theta, 0, 6, 2);
    const lg_var c = lg_exp(t, lg_reshape(t, lg_slice(t, theta, 0, 8, 2), lg_shape2(1, 2)));
    const lg_var h = lg_act(t, lg_add(t, lg_matmul(t, x, W), b), LG_TANH);
    return lg_sum(t, lg_mul(t, h, c));
}

TEST("gradients of rows equal those of each row alone, and rows that affect each other are refused") {
    enum { ROWS = 4, N = 10 };
    const double *theta = test_numbers(1, N, -1, 1), *x = test_numbers(2, ROWS * 3, -1, 1);
    double found[ROWS * N], dx[ROWS * 3];
    lg_tape *t = test_tape(LG_F64);
    lg_var p = vector(t, N, theta), all = lg_input_f64(t, lg_shape2(ROWS, 3), x);
    lg_tape_mark_rows(t, all);
    assert_ok(lg_backward_rows(t, rows_of_layer(t, p, all), all, dx, p, ROWS, found));
    for (int row = 0; row < ROWS; row++) {
        double alone[N] = {0}, of_x[3] = {0};
        void *into[2] = {alone, of_x};
        lg_tape_reset(t);
        p = vector(t, N, theta);
        const lg_var one = lg_input_f64(t, lg_shape2(1, 3), x + 3 * row), wrt[2] = {p, one};
        assert_ok(lg_backward(t, rows_of_layer(t, p, one), wrt, 2, into));
        assert_all_close(found + row * N, alone, N, 1e-14, 1e-15);
        assert_all_close(dx + row * 3, of_x, 3, 1e-14, 1e-15);
    }
    lg_tape_reset(t);
    p = vector(t, N, theta);
    all = lg_input_f64(t, lg_shape2(ROWS, 3), x);
    lg_tape_mark_rows(t, all);
    const lg_var W = lg_reshape(t, lg_slice(t, p, 0, 0, ROWS * 2), lg_shape2(ROWS, 2));
    assert_int_equal(lg_backward_rows(t, lg_sum(t, lg_matmul_tn(t, all, W)), all, dx, p, ROWS, found),
                     LG_UNSUPPORTED);
}

TEST("gradients of rows need a leaf as theta, which may come after x") {
    enum { ROWS = 4, N = 10 };
    const double *theta = test_numbers(1, N, -1, 1), *x = test_numbers(2, ROWS * 3, -1, 1);
    double first[ROWS * N], second[ROWS * N], dx[ROWS * 3];
    lg_tape *t = test_tape(LG_F64);
    for (int late = 0; late < 2; late++) {
        lg_tape_reset(t);
        lg_var p = late ? LG_NONE : vector(t, N, theta);
        const lg_var all = lg_input_f64(t, lg_shape2(ROWS, 3), x);
        if (late) p = vector(t, N, theta);
        lg_tape_mark_rows(t, all);
        assert_ok(lg_backward_rows(t, rows_of_layer(t, p, all), all, dx, p, ROWS, late ? second : first));
    }
    assert_memory_equal(first, second, sizeof first);
    for (int kind = 0; kind < 2; kind++) {
        lg_tape_reset(t);
        const lg_var p = vector(t, N, theta), all = lg_input_f64(t, lg_shape2(ROWS, 3), x);
        const lg_var other = kind == 0 ? LG_NONE : lg_neg(t, p);
        assert_status(lg_backward_rows(t, rows_of_layer(t, p, all), all, dx, other, ROWS, first),
                      kind == 0 ? LG_STALE_HANDLE : LG_UNSUPPORTED);
    }
}

/* ---- requests at the limits ---- */

TEST("derivatives of nothing, by nothing, and by what came later are empty or zero") {
    lg_tape *t = test_tape(LG_F64);
    const lg_var x = good(t), y = lg_square(t, x), later = good(t), empty = lg_full(t, lg_shape1(0), 0);
    double gradient[6] = {7, 7, 7, 7, 7, 7};
    lg_var out = LG_NONE;
    assert_ok(lg_vjp(t, &y, &y, 1, NULL, 0, NULL));
    assert_ok(lg_jvp(t, NULL, 0, &x, &x, 1, NULL));
    assert_ok(lg_vjp(t, &y, &x, 1, &later, 1, &out));
    for (int i = 0; i < 6; i++) assert_true(numbers_of(t, out)[i] == 0.0);
    assert_ok(lg_backward_set(t, y, &later, 1, &(void *){gradient}));
    for (int i = 0; i < 6; i++) assert_true(gradient[i] == 0.0);
    assert_int_equal(lg_var_shape(t, lg_jacobian(t, empty, x)).dims[1], 6);
    assert_false(lg_depends_on(t, y, later));
    assert_false(lg_depends_on(t, y, LG_NONE));
    assert_status(lg_tape_status(t), LG_STALE_HANDLE);
    lg_tape_reset(t);
    const lg_var again = good(t);
    assert_status(lg_backward(t, again, &again, 1, &(void *){NULL}), LG_INVALID_ARGUMENT);
    assert_says(lg_tape_message(t), "the memory for a gradient is NULL");
    lg_tape_reset(t);
    lg_var rows[6] = {V2(2, 3), V2(2, 3), V2(2, 3), V2(2, 3), V2(2, 3), V2(3, 2)};
    assert_true(lg_is_none(lg_concat(t, rows, 6, 0)));
    assert_status(lg_tape_status(t), LG_SHAPE);
    assert_int_equal(lg_shape_of(5, (uint32_t[4]){1, 2, 3, 4}).dims[3], 4);
}

/* More separate parts than a gradient's list of filled parts has room for. */
TEST("a gradient may consist of many parts that do not touch") {
    enum { PARTS = 40, ALL = 3 * PARTS };
    const double *values = test_numbers(3, ALL, -1, 1);
    double gradient[ALL];
    lg_tape *t = test_tape(LG_F64);
    const lg_var theta = lg_parameter(t, lg_shape1(ALL), values);
    lg_var sum = LG_NONE;
    for (int i = 0; i < PARTS; i++)
        sum = lg_add_or(t, sum, lg_sum(t, lg_square(t, lg_slice(t, theta, 0, (uint32_t)(3 * i), 1))));
    for (int i = 0; i < ALL; i++) gradient[i] = NAN;
    assert_ok(lg_backward_set(t, sum, &theta, 1, &(void *){gradient}));
    for (int i = 0; i < ALL; i++) assert_close(gradient[i], i % 3 == 0 ? 2 * values[i] : 0.0, 1e-15, 0);
}

/* ---- custom operations that are described or differentiated wrongly ---- */

static lg_status failing_jvp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y,
                             const lg_var *tangents, lg_var *out) {
    return LG_NO_CONVERGENCE;
}
static lg_status short_jvp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y,
                           const lg_var *tangents, lg_var *out) {
    *out = lg_sum(tape, tangents[0]);
    return LG_OK;
}
static lg_status no_jvp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y,
                        const lg_var *tangents, lg_var *out) {
    return LG_OK;
}
static lg_status stale_jvp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y,
                           const lg_var *tangents, lg_var *out) {
    *out = (lg_var){4000000000u, 1};
    return LG_OK;
}
static lg_status failing_numeric_jvp(void *user, lg_dtype dtype, const void *const *in, const void *y,
                                     const void *const *tangents, void *out) {
    return LG_NO_CONVERGENCE;
}
static lg_status failing_numeric_vjp(void *user, lg_dtype dtype, const void *const *in, const void *y,
                                     const void *g, void *const *out) {
    return LG_NO_CONVERGENCE;
}

TEST("custom operations that are described wrongly, or whose tangents are wrong, are refused by name") {
    static const double x0[3] = {1, 2, 3};
    static const lg_custom_op wrong[] = {
        {.forward = identity_forward},
        {.name = "no forward"},
        {.name = "rank 5", .forward = identity_forward},
        {.name = "two", .forward = identity_forward, .jvp = no_jvp, .numeric_jvp = failing_numeric_jvp}};
    static const struct {
        lg_custom_op op;
        lg_status status;
    } rows[] = {{{.name = "fails", .forward = identity_forward, .jvp = failing_jvp}, LG_NO_CONVERGENCE},
                {{.name = "short", .forward = identity_forward, .jvp = short_jvp}, LG_SHAPE},
                {{.name = "stale", .forward = identity_forward, .jvp = stale_jvp}, LG_STALE_HANDLE},
                {{.name = "no", .forward = identity_forward, .jvp = no_jvp}, LG_OK},
                {{.name = "numeric",
                  .forward = identity_forward,
                  .numeric_jvp = failing_numeric_jvp,
                  .numeric_vjp = failing_numeric_vjp},
                 LG_NO_CONVERGENCE}};
    lg_tape *t = test_tape(LG_F64);
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        lg_tape_reset(t);
        const lg_var x = vector(t, 3, x0);
        assert_true(
            lg_is_none(lg_custom(t, &wrong[i], &x, 1, i == 2 ? (lg_shape){.rank = 5} : lg_shape1(3))));
        assert_status(lg_tape_status(t), LG_INVALID_ARGUMENT);
    }
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_tape_reset(t);
        const lg_var x = vector(t, 3, x0);
        lg_var y = lg_custom(t, &rows[i].op, &x, 1, (lg_shape){4, {1, 1, 1, 3}}), out;
        const lg_var ones = lg_full(t, lg_shape1(3), 1.0);
        assert_status(lg_jvp(t, &y, 1, &x, &ones, 1, &out), rows[i].status);
        assert_says(lg_tape_message(t), rows[i].status == LG_OK ? "" : rows[i].op.name);
        if (rows[i].status == LG_OK) assert_true(numbers_of(t, out)[2] == 0.0);
    }
    lg_tape_reset(t);
    const lg_var x = vector(t, 3, x0);
    lg_var y = lg_custom(t, &rows[4].op, &x, 1, lg_shape1(3)), out;
    assert_status(lg_grad(t, y, &x, 1, &out), LG_NO_CONVERGENCE);
    assert_says(lg_tape_message(t), "numeric");
}

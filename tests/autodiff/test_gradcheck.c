/* Tests of the gradient check: all registered cases pass, every operation has a case, planted errors are
 * caught, and each part of the check fails when it should.
 * ctest-labels: isa src/autodiff src/kernels src/integrators */
#include "gradcheck/cases.h"
#include "test_support.h"

#include "autodiff/ops/op_rows.h"
#include "autodiff/ops/op_table.h"
#include "support/fixtures.h"

/* ---- registered cases ---- */

TEST("every registered case passes") {
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        lg_gradcheck_result result;
        lg_status status = lg_gradcheck_run(NULL, row, NULL, NULL, &result);
        if (status != LG_OK)
            fail_msg("%s: %s: %s", row->function.name, lg_status_name(status), result.message);
        assert_true(result.passed);
        assert_string_equal(result.message, "");
        int orders = row->function.first_order_only ? 1 : 2;
        for (int order = 0; order < 2; order++) {
            assert_int_equal(result.order[order].checked, order < orders);
            assert_int_equal(result.order[order].passed, order < orders);
        }
        if (!row->zero) assert_true(result.order[0].derivative > 1e-6);
    }
}

TEST("every case passes as a program, or states why it cannot be one") {
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        lg_gradcheck_program_result result;
        const lg_status status = lg_gradcheck_program(NULL, row, NULL, NULL, &result);
        if (status != LG_OK)
            fail_msg("%s: %s: %s", row->function.name, lg_status_name(status), result.message);
        assert_true(result.passed);
        assert_int_equal(result.refused, row->no_program != NULL);
        if (result.refused) {
            assert_non_null(strstr(result.message, row->no_program));
            continue;
        }
        assert_string_equal(result.message, "");
        assert_true(result.value <= 1e-12 && result.forward <= 1e-12 && result.adjoint <= 1e-12);
    }
}

/* A case with a wrong statement about itself must fail: it is refused as a program without stating so, it
 * states so but is a program, or it is refused for another reason. */
TEST("a case that cannot be a program must be refused for the stated reason") {
    const lg_gradcheck_case *row;
    bool both[2] = {false, false};
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        lg_gradcheck_case wrong = *row;
        lg_gradcheck_program_result result;
        wrong.no_program = row->no_program != NULL ? NULL : "operation custom";
        assert_status(lg_gradcheck_program(NULL, &wrong, NULL, NULL, &result), LG_CHECK_FAILED);
        assert_false(result.passed);
        assert_true(strlen(result.message) > 0);
        assert_int_equal(result.refused, row->no_program != NULL);
        both[row->no_program != NULL] = true;
        if (row->no_program == NULL) continue;
        wrong.no_program = "another reason";
        assert_status(lg_gradcheck_program(NULL, &wrong, NULL, NULL, &result), LG_CHECK_FAILED);
    }
    assert_true(both[0] && both[1]);
}

/* No operation may exist without a case that names it and has it on its tape. */
TEST("every operation has a case") {
    const lg_gradcheck_case *row;
    lg_gradcheck_options options;
    lg_gradcheck_options_init(&options);
    for (uint32_t at = 0; lg_ops[at] != NULL; at++) {
        const lg_op *op = lg_ops[at];
        bool found = false;
        for (size_t i = 0; !found && (row = lg_gradcheck_operation(i)) != NULL; i++)
            for (size_t j = 0; j < LG_GRADCHECK_CASE_OPERATIONS && row->operations[j] != NULL; j++) {
                if (strcmp(row->operations[j], op->name) != 0) continue;
                uint32_t inputs = 0;
                assert_ok(lg_gradcheck_inputs_of(NULL, &row->function, &options, op, &inputs));
                if (inputs == 0 && op != &lg_op_leaf)
                    fail_msg("%s has no %s on its tape", row->function.name, op->name);
                found = true;
            }
        if (!found) fail_msg("no row for the operation %s", op->name);
    }
}

static lg_op stray; /* a copy of an operation that is not in the table */

static lg_var build_stray(const void *user, lg_tape *tape, const lg_var *x) {
    (void)user;
    return lg_record(tape, &stray, x, 1, NULL);
}

TEST("operations outside the table are refused") {
    const lg_gradcheck_argument argument = {.shape = {1, {3}}, .low = 1.0, .high = 2.0};
    const lg_gradcheck_function f = {
        .name = "stray", .build = build_stray, .arguments = &argument, .inputs = 1};
    lg_gradcheck_result result;
    stray = lg_op_exp;
    assert_status(lg_gradcheck(NULL, &f, NULL, &result), LG_UNSUPPORTED);
    assert_says(result.message, "'exp' is not in the table");
}

TEST("names of cases differ, and their operations exist") {
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        for (size_t j = 0; j < i; j++)
            assert_string_not_equal(row->function.name, lg_gradcheck_operation(j)->function.name);
        for (size_t j = 0; j < LG_GRADCHECK_CASE_OPERATIONS && row->operations[j] != NULL; j++)
            if (lg_op_named(row->operations[j]) == NULL) fail_msg("unknown %s", row->operations[j]);
    }
    for (uint32_t a = 0; lg_ops[a] != NULL; a++) {
        assert_int_equal(lg_op_place(lg_ops[a]), a);
        for (uint32_t b = 0; b < a; b++) assert_string_not_equal(lg_ops[a]->name, lg_ops[b]->name);
    }
}

/* ---- planted errors ---- */

typedef struct tally {
    size_t outcome[LG_PLANT_EXCLUDED + 1], caught[LG_OPS_MOST][LG_PLANT_DIRECTIONS][LG_PLANT_MUTATIONS];
    size_t programs[LG_PLANT_EXCLUDED + 1], in_plans[LG_PLANT_PLAN_MUTATIONS];
    /* transposed matrices of one column or row, which change nothing */
    size_t flat[LG_OPS_MOST][LG_PLANT_DIRECTIONS];
} tally;

static void count_plant(void *user, const lg_gradcheck_case *row, const lg_gradcheck_plant *plant,
                        lg_plant_outcome outcome, const char *reason) {
    tally *t = user;
    const bool of_plan = plant->direction == LG_PLANT_PLAN;
    (of_plan || plant->direction == LG_PLANT_SCALARS ? t->programs : t->outcome)[outcome]++;
    assert_true(strlen(reason) > 0 || outcome == LG_PLANT_MISSED);
    if (outcome == LG_PLANT_EXCLUDED && plant->mutation == LG_PLANT_TRANSPOSE &&
        strstr(reason, "the same numbers") != NULL)
        t->flat[lg_op_place(lg_op_named(plant->operation))][plant->direction]++;
    if (outcome == LG_PLANT_CAUGHT && of_plan) t->in_plans[plant->mutation - LG_PLANT_MUTATIONS]++;
    if (outcome == LG_PLANT_CAUGHT && !of_plan)
        t->caught[lg_op_place(lg_op_named(plant->operation))][plant->direction][plant->mutation]++;
    if (outcome == LG_PLANT_MISSED)
        fail_msg("%s: %s %s of %s, input %u, was not caught", row->function.name, plant->operation,
                 lg_plant_direction_name(plant->direction), lg_plant_mutation_name(plant->mutation),
                 plant->input);
}

TEST("every planted error is caught") {
    static tally t;
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++)
        assert_ok(lg_gradcheck_plant_all(NULL, row, NULL, count_plant, &t));
    assert_int_equal(t.outcome[LG_PLANT_MISSED] + t.programs[LG_PLANT_MISSED], 0);
    /* In the scalar code of every operation that has some, each kind of error must be caught; in plans too.
     * stop_gradient vanishes before there is code. */
    for (uint32_t at = 0; lg_ops[at] != NULL; at++)
        for (int mutation = 0; mutation < LG_PLANT_MUTATIONS; mutation++) {
            const lg_op *op = lg_ops[at];
            if ((op->element == NULL && op->expand == NULL) || op == &lg_op_stop_gradient) continue;
            if (t.caught[at][LG_PLANT_SCALARS][mutation] == 0)
                fail_msg("%s: no %s of scalar code was caught", op->name,
                         lg_plant_mutation_name((lg_plant_mutation)mutation));
        }
    for (int mutation = 0; mutation < LG_PLANT_PLAN_MUTATIONS; mutation++)
        assert_true(t.in_plans[mutation] > 0);
    assert_true(t.outcome[LG_PLANT_CAUGHT] > 3 * t.outcome[LG_PLANT_EXCLUDED]);
    /* Every operation with a derivative must have caught errors of sign, drop and factor, and of
     * transposition if its derivative can have two axes. */
    for (uint32_t at = 0; lg_ops[at] != NULL; at++) {
        const lg_op *op = lg_ops[at];
        if (op == &lg_op_leaf || op == &lg_op_custom_derivative || op->frozen == ~0u ||
            op == &lg_op_spd_factor)
            continue;
        for (int direction = 0; direction < 2; direction++)
            for (int mutation = 0; mutation < LG_PLANT_MUTATIONS; mutation++) {
                if (mutation == LG_PLANT_TRANSPOSE && t.flat[at][direction] > 0) continue;
                if (t.caught[at][direction][mutation] == 0)
                    fail_msg("%s: no %s of a %s was caught", op->name,
                             lg_plant_mutation_name((lg_plant_mutation)mutation),
                             lg_plant_direction_name((lg_plant_direction)direction));
            }
    }
}

static const lg_gradcheck_case *row_named(const char *name) {
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++)
        if (strcmp(row->function.name, name) == 0) return row;
    fail_msg("no row %s", name);
    return NULL;
}

TEST("each part of the check by itself finds the error that it is for") {
    static const struct {
        const char *row, *operation, *says;
        lg_plant_direction direction;
        double rounding, difference;
    } parts[] = {
        {"sin", "sin", "<c, jvp(d)> differs", LG_PLANT_VJP, 1e-10, 1e9},
        {"sin", "sin", "<c, jvp(d)> differs", LG_PLANT_JVP, 1e-10, 1e9},
        {"sin", "sin", "difference quotient", LG_PLANT_JVP, 1e9, 1e-6},
        {"sin", "sin", "Taylor remainder", LG_PLANT_VJP, 1e9, 1e9},
        {"scale", "scale", "Taylor remainder", LG_PLANT_VJP, 1e9, 1e9},
        {"matmul nn (3, 4) (4, 5)", "matmul", "Taylor remainder", LG_PLANT_VJP, 1e9, 1e9},
    };
    for (size_t i = 0; i < LG_COUNT(parts); i++) {
        lg_gradcheck_plant plant = {parts[i].operation, parts[i].direction, LG_PLANT_FACTOR, 0};
        lg_gradcheck_options options;
        lg_gradcheck_options_init(&options);
        options.rounding_tolerance = parts[i].rounding;
        options.difference_tolerance = parts[i].difference;
        lg_plant planted;
        lg_gradcheck_result result;
        assert_ok(lg_plant_open(&planted, &plant));
        assert_status(lg_gradcheck_run(NULL, row_named(parts[i].row), &options, &planted, &result),
                      LG_CHECK_FAILED);
        if (strstr(result.message, parts[i].says) == NULL) fail_msg("%s: %s", parts[i].row, result.message);
        assert_true(planted.applied > 0 && planted.changed > 0);
        assert_false(result.passed);
        assert_false(result.order[0].passed);
        if (strcmp(parts[i].says, "Taylor remainder") == 0)
            assert_close(result.order[0].slope, 1.0, 0.0, 0.05);
    }
}

/* ---- functions of a user ---- */

static const lg_gradcheck_argument three[] = {{.shape = {1, {3, 0, 0, 0}}}};

static lg_var tanh_of_sin(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_act(tape, lg_sin(tape, x[0]), LG_TANH);
}

/* Right to first order only: the derivative has the right value, but is constant on the tape. */
static lg_var once(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_mul(tape, lg_stop_gradient(tape, lg_scale(tape, lg_sin(tape, x[0]), 2.0)), x[0]);
}

static lg_status sine_forward(void *user, lg_dtype dtype, const void *const *in, void *y) {
    for (int i = 0; i < 3; i++) ((double *)y)[i] = sin(((const double *)in[0])[i]);
    return LG_OK;
}
static lg_status frozen_vjp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y, lg_var g,
                            const bool *need, lg_var *out) {
    out[0] = lg_mul(tape, g, lg_stop_gradient(tape, lg_cos(tape, in[0])));
    return LG_OK;
}
static lg_status right_jvp(void *user, lg_tape *tape, const lg_var *in, size_t n, lg_var y,
                           const lg_var *tangents, lg_var *out) {
    *out = lg_mul(tape, tangents[0], lg_cos(tape, in[0]));
    return LG_OK;
}
static lg_status numeric_cos(void *user, lg_dtype dtype, const void *const *in, const void *y, const void *g,
                             void *const *out) {
    for (int i = 0; i < 3; i++)
        ((double *)out[0])[i] = ((const double *)g)[i] * cos(((const double *)in[0])[i]);
    return LG_OK;
}
static lg_status numeric_cos_jvp(void *user, lg_dtype dtype, const void *const *in, const void *y,
                                 const void *const *tangents, void *out) {
    for (int i = 0; i < 3; i++)
        ((double *)out)[i] = ((const double *)tangents[0])[i] * cos(((const double *)in[0])[i]);
    return LG_OK;
}
static const lg_custom_op once_sine = {
    .name = "once-sine", .forward = sine_forward, .vjp = frozen_vjp, .jvp = right_jvp};
static const lg_custom_op numeric_sine = {.name = "numeric-sine",
                                          .forward = sine_forward,
                                          .numeric_vjp = numeric_cos,
                                          .numeric_jvp = numeric_cos_jvp};
static lg_var custom_of(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_custom(tape, user, x, 1, lg_shape1(3));
}
static lg_var root_of_negative(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_sqrt(tape, lg_add_scalar(tape, x[0], -4.0));
}
static lg_var does_not_fit(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_matmul(tape, x[0], x[0]);
}
static lg_var own_failure(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_tape_fail(tape, LG_NO_CONVERGENCE, "mine", "it does not converge");
}
static lg_var none(const void *user, lg_tape *tape, const lg_var *x) {
    return LG_NONE;
}
/* A kink nearer than the difference steps: |x| at 1e-4. */
static lg_var kinked(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_abs(tape, x[0]);
}

static void expect(lg_gradcheck_function f, lg_status status, const char *says, int failing_order) {
    lg_gradcheck_result result;
    if (f.arguments == NULL) f.arguments = three;
    if (f.inputs == 0) f.inputs = 1;
    lg_status got = lg_gradcheck(NULL, &f, NULL, &result);
    if (got != status) fail_msg("%s: %s, %s", f.name, lg_status_name(got), result.message);
    if (strstr(result.message, says) == NULL) fail_msg("%s: %s", f.name, result.message);
    if (status != LG_OK && strstr(result.message, f.name) == NULL) fail_msg("no name in: %s", result.message);
    assert_int_equal(result.passed, status == LG_OK);
    if (failing_order > 0) assert_false(result.order[failing_order - 1].passed);
    if (failing_order > 1) assert_true(result.order[0].passed);
}

TEST("functions of a user pass, or fail with the part and the order that is wrong") {
    static const double close[3] = {1e-4, 1.0, -1.0};
    static const lg_gradcheck_argument at_kink[] = {{.shape = {1, {3, 0, 0, 0}}, .values = close}};
    expect((lg_gradcheck_function){.name = "right", .build = tanh_of_sin}, LG_OK, "", 0);
    expect((lg_gradcheck_function){.name = "stopped", .build = once}, LG_CHECK_FAILED, "order 1", 1);
    expect((lg_gradcheck_function){.name = "second", .build = custom_of, .user = &once_sine}, LG_CHECK_FAILED,
           "order 2", 2);
    expect((lg_gradcheck_function){.name = "kink", .build = kinked, .arguments = at_kink}, LG_CHECK_FAILED,
           "difference quotient", 1);
    expect((lg_gradcheck_function){.name = "nan", .build = root_of_negative}, LG_CHECK_FAILED, "order 1", 1);
    expect((lg_gradcheck_function){.name = "shapes", .build = does_not_fit}, LG_SHAPE, "matmul", 0);
    expect((lg_gradcheck_function){.name = "own", .build = own_failure}, LG_NO_CONVERGENCE,
           "does not converge", 0);
    expect((lg_gradcheck_function){.name = "none", .build = none}, LG_STALE_HANDLE, "LG_NONE", 0);
}

TEST("an operation with a numeric derivative has no second order") {
    lg_gradcheck_function f = {.name = "numeric", .build = custom_of, .user = &numeric_sine};
    expect(f, LG_NOT_DIFFERENTIABLE, "numeric-sine", 2);
    f.first_order_only = true;
    expect(f, LG_OK, "", 0);
    f = (lg_gradcheck_function){.name = "too modest", .build = tanh_of_sin, .first_order_only = true};
    expect(f, LG_CHECK_FAILED, "differentiable once only", 0);
}

static lg_var zero_claim(const void *user, lg_tape *tape, const lg_var *x) {
    return lg_sin(tape, x[0]);
}

TEST("a function that is declared to be zero must be zero") {
    lg_gradcheck_result result;
    lg_gradcheck_case row = {
        .function = {.name = "not zero", .inputs = 1, .arguments = three, .build = zero_claim}, .zero = true};
    assert_status(lg_gradcheck_run(NULL, &row, NULL, NULL, &result), LG_CHECK_FAILED);
    assert_says(result.message, "identically zero");
    row.function.stops = true;
    assert_status(lg_gradcheck_run(NULL, &row, NULL, NULL, &result), LG_CHECK_FAILED);
    assert_says(result.message, "not zero");
}

/* ---- manifolds ---- */

static lg_gradcheck_function sphere;
static double slip = 0.0;
static lg_status wrong_tangent(const void *user, uint32_t argument, const double *x, const double *d,
                               double *dx) {
    lg_status status = row_named("on the sphere")->function.tangent(user, argument, x, d, dx);
    dx[0] += slip;
    return status;
}
static lg_status no_perturb(const void *user, uint32_t argument, const double *x, const double *d, double h,
                            double *moved) {
    return LG_NO_CONVERGENCE;
}

TEST("on a manifold, tangents are compared with its perturbations") {
    lg_gradcheck_result result;
    sphere = row_named("on the sphere")->function;
    sphere.tangent = wrong_tangent;
    slip = 0.0;
    assert_ok(lg_gradcheck(NULL, &sphere, NULL, &result));
    slip = 1e-3;
    assert_status(lg_gradcheck(NULL, &sphere, NULL, &result), LG_CHECK_FAILED);
    assert_says(result.message, "difference quotient");
    sphere.perturb = no_perturb;
    assert_status(lg_gradcheck(NULL, &sphere, NULL, &result), LG_NO_CONVERGENCE);
    sphere.perturb = NULL;
    assert_status(lg_gradcheck(NULL, &sphere, NULL, &result), LG_INVALID_ARGUMENT);
}

/* ---- invalid functions and options ---- */

TEST("invalid functions and options are refused") {
    lg_gradcheck_result result;
    const lg_gradcheck_function good = {
        .name = "good", .inputs = 1, .arguments = three, .build = tanh_of_sin};
    lg_gradcheck_function bad[6] = {good, good, good, good, good, good};
    static const lg_gradcheck_argument rank5[] = {{.shape = {5, {1, 1, 1, 1}}}};
    bad[0].name = NULL;
    bad[1].build = NULL;
    bad[2].arguments = NULL;
    bad[3].inputs = 0;
    bad[4].inputs = LG_GRADCHECK_MAX_INPUTS + 1;
    bad[5].arguments = rank5;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_status(lg_gradcheck(NULL, &bad[i], NULL, &result), LG_INVALID_ARGUMENT);
        assert_true(strlen(result.message) > 0 && !result.passed);
    }

    lg_gradcheck_options options[3];
    for (size_t i = 0; i < 3; i++) lg_gradcheck_options_init(&options[i]);
    const lg_gradcheck_plant unknown = {"no such operation", LG_PLANT_VJP, LG_PLANT_SIGN, 0};
    options[0].size = 1;
    options[1].order = 3;
    options[2].directions = 0;
    for (size_t i = 0; i < 3; i++)
        assert_status(lg_gradcheck(NULL, &good, &options[i], &result), LG_INVALID_ARGUMENT);

    lg_plant planted;
    assert_status(lg_plant_open(&planted, &unknown), LG_INVALID_ARGUMENT);
    lg_gradcheck_case row = {.function = good, .operations = {"no such operation"}};
    assert_status(lg_gradcheck_plant_all(NULL, &row, NULL, count_plant, NULL), LG_INVALID_ARGUMENT);
}

TEST("order 1 can be checked alone") {
    lg_gradcheck_options options;
    lg_gradcheck_options_init(&options);
    options.order = 1;
    lg_gradcheck_result result;
    const lg_gradcheck_function f = {
        .name = "second", .inputs = 1, .arguments = three, .build = custom_of, .user = &once_sine};
    assert_ok(lg_gradcheck(NULL, &f, &options, &result));
    assert_false(result.order[1].checked);
}

TEST("every allocation may fail") {
    const lg_gradcheck_case *row = row_named("dense tanh");
    EVERY_ALLOCATION_FAILS(context, 6, {
        lg_gradcheck_result result;
        status = lg_gradcheck_run(context, row, NULL, NULL, &result);
        assert_int_equal(result.passed, status == LG_OK);
        assert_true(status == LG_OK || strlen(result.message) > 0);
    });
}

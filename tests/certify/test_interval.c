/* Interval evaluation. Bounds of every operation over random boxes contain exact values, in long double, at
 * points of the box; they shrink with the box.
 * ctest-labels: src/certify src/autodiff */
#include "interval_support.h"
#include "autodiff/program_support.h"

#include "liegrad/ops.h"

#include <fenv.h>

TEST("bounds contain the exact values of every operation, with every instruction set") {
    assert_true(check_bounds(3, 37) >= 1000000);
}

/* Widths over boxes of radius 1e-3 and 1e-5 about the point of the case, where nothing jumps. */
static void check_width(const lg_tape *tape, const lg_node *node, const char *row) {
    interval_node *n = interval_node_of(tape, node, lg_interval_kernel(lg_isa_in_use()));
    if (n == NULL || n->inputs == 0) return;
    double *low = TEST_ARRAY(double, 2 * n->inputs), *high = TEST_ARRAY(double, 2 * n->inputs);
    double *out_low = TEST_ARRAY(double, 2 * n->outputs), *out_high = TEST_ARRAY(double, 2 * n->outputs);
    for (size_t i = 0; i < 2 * n->inputs; i++) {
        const double at = n->at[i % n->inputs], radius = (i < n->inputs ? 1e-3 : 1e-5) * fmin(1, fabs(at));
        low[i] = at - radius;
        high[i] = at + radius;
    }
    uint8_t *flags = TEST_ARRAY(uint8_t, 2 * n->outputs);
    assert_ok(lg_interval_eval(n->f, 2, low, high, out_low, out_high, flags,
                               lg_test_memory(lg_interval_work_size(n->f)), NULL));
    for (size_t j = 0; j < n->outputs; j++) {
        const double wide = out_high[j] - out_low[j],
                     narrow = out_high[n->outputs + j] - out_low[n->outputs + j];
        const double size = fmax(fabs(out_low[j]), fabs(out_high[j]));
        if (flags[j] >= LG_INTERVAL_LIPSCHITZ && isfinite(wide) &&
            !(narrow <= 0.02 * wide + 1e-11 * (size + 1)))
            fail_msg("%s: %s: the width is %g over a box, %g over one of a hundredth", row, node->op->name,
                     wide, narrow);
    }
}

TEST("bounds shrink linearly with the box") {
    each_node(check_width);
}

/* ---- programs ---- */

RECORDING(third) {
    y[0] = lg_scale(tape, x[0], 1.0 / 3.0);
}
/* x ((.7 - .1)/.3 - 2): what is left of the constants is their rounding */
RECORDING(cancelled) {
    lg_var c[4];
    const double values[4] = {0.7, 0.1, 0.3, 2};
    for (int i = 0; i < 4; i++) c[i] = lg_full(tape, lg_shape1(3), values[i]);
    y[0] = lg_mul(tape, x[0], lg_sub(tape, lg_div(tape, lg_sub(tape, c[0], c[1]), c[2]), c[3]));
}
RECORDING(square) {
    y[0] = lg_mul(tape, lg_sin(tape, x[0]), lg_exp(tape, lg_neg(tape, x[0])));
}
RECORDING(jumping) {
    y[0] = lg_mul(tape, lg_ge(tape, x[0], lg_scale(tape, x[0], 0.5)), x[0]);
}
RECORDING(stopped) {
    y[0] = lg_mul(tape, lg_stop_gradient(tape, x[0]), x[0]);
}
/* Each jumps: a product of two comparisons, and of a comparison and a number. */
RECORDING(both_hold) {
    y[0] = lg_mul(tape, lg_ge(tape, x[0], lg_neg(tape, x[0])), lg_ge(tape, x[0], lg_scale(tape, x[0], 0.5)));
}

RECORDING(one_holds) {
    const lg_var holds = lg_ge(tape, x[0], lg_neg(tape, x[0]));
    y[0] = lg_mul(tape, holds, lg_add_scalar(tape, x[0], 1.0));
}

RECORDING(weighed) {
    const lg_var holds = lg_ge(tape, x[0], lg_neg(tape, x[0])), by = lg_add_scalar(tape, x[0], 1.0);
    const lg_var twice = lg_mul(tape, lg_mul(tape, holds, by), holds);
    y[0] = lg_add(tape, x[0], twice);
}

RECORDING(greatest) {
    y[0] = lg_max_axis(tape, x[0], 1, true);
}

static lg_program *program_of(lg_record_function record) {
    const lg_port in = {.name = "x", .shape = lg_shape1(3)}, out = {.name = "y"};
    const lg_function_spec f = {"f", &in, 1, &out, 1, record, NULL};
    const lg_program_spec spec = spec_of(NULL, 0, &f, 1);
    return test_program(&spec);
}

RELEASES(release_interval, lg_interval_destroy)
static lg_interval *test_interval(const lg_program *program, const size_t *functions, size_t count) {
    lg_interval *f = NULL;
    assert_told(lg_interval_create(program, functions, count, NULL, &f, &told));
    lg_test_owns(f, release_interval);
    return f;
}

TEST("a function and its Jacobian are evaluated together, and bound the function's slopes") {
    lg_program *program = program_of(square);
    const size_t functions[2] = {0, derived(program, LG_DERIVATIVE_JACOBIAN, "f")};
    lg_interval *f = test_interval(program, functions, 2);
    assert_int_equal(lg_interval_inputs(f), 3);
    assert_int_equal(lg_interval_outputs(f), 12);
    const double low[3] = {0.1, -1, 2}, high[3] = {0.1, 0.5, 2.1};
    double l[12], h[12];
    assert_ok(lg_interval_eval(f, 1, low, high, l, h, NULL, lg_test_memory(lg_interval_work_size(f)), NULL));
    const double slope = (cos(0.1) - sin(0.1)) * exp(-0.1);
    assert_true(l[3] <= slope && slope <= h[3] && h[3] - l[3] < 1e-14);
    assert_true(l[4] == 0.0 && h[4] == 0.0); /* rows of other elements */
    assert_true(l[7] < (cos(0.5) - sin(0.5)) * exp(-0.5) && h[7] > (cos(-1) - sin(-1)) * exp(1));
}

RECORDING(slope_of_power) {
    const lg_var power = lg_pow(tape, x[0], *(const double *)user);
    (void)lg_grad(tape, lg_sum(tape, power), x, 1, y);
}

/* c - 1 is no double for these c, but it is a long double. */
TEST("the derivative of a power whose exponent less 1 is no double contains its slopes") {
    static const double exponents[] = {1.0 / 3, 0.1, -0.1, -1.0 / 3, -5.7, 1e-3, 0.3};
    for (size_t i = 0; i < LG_COUNT(exponents); i++) {
        const long double c = exponents[i];
        const lg_port in = {.name = "x", .shape = lg_shape1(3)}, out = {.name = "y"};
        const lg_function_spec of = {"f", &in, 1, &out, 1, slope_of_power, (void *)(uintptr_t)&exponents[i]};
        const lg_program_spec spec = spec_of(NULL, 0, &of, 1);
        const lg_program *program = test_program(&spec);
        const size_t zero = 0;
        lg_interval *f = test_interval(program, &zero, 1);
        void *work = lg_test_memory(lg_interval_work_size(f));
        for (int k = -150; k <= 150; k++) {
            const double x[3] = {pow(2, k / 3.0), pow(2, k), pow(7, k / 8.0)};
            double l[3], h[3];
            assert_ok(lg_interval_eval(f, 1, x, x, l, h, NULL, work, NULL));
            for (int j = 0; j < 3; j++)
                if (!is_within(l[j], h[j], c * powl(x[j], c - 1)) || h[j] - l[j] > 1e-13 * fabs(h[j]))
                    fail_msg("%g x^(%g - 1) at %g: [%.17g, %.17g]", exponents[i], exponents[i], x[j], l[j],
                             h[j]);
        }
    }
}

/* ---- flags ---- */

static lg_var lifted(lg_tape *tape, double value) {
    return lg_full(tape, lg_shape0(), value);
}

/* `y` columns of the two numbers a, b: what each needs stands in the rows of the test. */
RECORDING(with_flags) {
    const lg_var a = lg_slice(tape, x[0], 1, 0, 1), b = lg_slice(tape, x[0], 1, 1, 1);
    const lg_var one = lifted(tape, 1), inverse = lg_div(tape, one, a), log = lg_log(tape, a);
    const lg_var sat =
        lg_max(tape, lg_neg(tape, lg_max(tape, lg_neg(tape, log), lifted(tape, -1))), lifted(tape, -1));
    const lg_var positive = lg_ge(tape, a, lifted(tape, 0)), angle = lg_atan2(tape, a, b);
    const lg_var parts[] = {lg_act(tape, log, LG_TANH),
                            lg_sin(tape, lg_sqrt(tape, a)),
                            sat,
                            lg_act(tape, inverse, LG_TANH),
                            lg_scale(tape, inverse, 0),
                            lg_sub(tape, log, log),
                            lg_div(tape, lg_scale(tape, b, 0), a),
                            lg_mul(tape, positive, a),
                            lg_select(tape, positive, a, lg_log(tape, lg_neg(tape, a))),
                            lg_select(tape, positive, b, b),
                            angle,
                            lg_act(tape, lg_abs(tape, a), LG_SINE),
                            lg_act(tape, a, LG_LEAKY_RELU),
                            lg_mul(tape, lg_stop_gradient(tape, b), a),
                            lg_mul(tape, lg_exp(tape, a), lg_sin(tape, b)),
                            lg_pow(tape, a, -3),
                            lg_pow(tape, a, 1.5),
                            lg_scale(tape, lg_sign(tape, a), 0)};
    y[0] = lg_concat(tape, parts, LG_COUNT(parts), 1);
}

enum { FLAGGED = 18, U = LG_INTERVAL_UNDEFINED, D, C, L, S };

TEST(
    "flags say what holds on a box: compositions outside of domains, products with 0, cuts, kinks, choices") {
    static const struct {
        double low[2], high[2];
        uint8_t wanted[FLAGGED];
    } rows[] = {{{-2, 1}, {-1, 1}, {U, U, U, S, S, U, S, S, S, S, S, S, S, C, S, S, U, S}},
                {{-1, -1}, {1, 1}, {U, U, U, U, U, U, U, D, U, S, U, L, L, C, S, U, U, D}},
                {{-1, -2}, {1, -1}, {U, U, U, U, U, U, U, D, U, S, D, L, L, C, S, U, U, D}},
                {{0, -2}, {1, -1}, {U, C, U, U, U, U, U, D, S, S, D, L, L, C, S, U, S, D}},
                {{0.5, -2}, {0.75, 2}, {S, S, S, S, S, S, S, S, S, S, S, S, S, C, S, S, S, S}},
                {{0.25, 0}, {0.5, 0}, {S, S, L, S, S, S, S, S, S, S, S, S, S, C, S, S, S, S}},
                {{3, 1}, {4, 1}, {S, S, S, S, S, S, S, S, S, S, S, S, S, C, S, S, S, S}}};
    const lg_port in = {.name = "x", .shape = lg_shape1(2)}, out = {.name = "y"};
    const lg_function_spec function = {"f", &in, 1, &out, 1, with_flags, NULL};
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    const size_t zero = 0;
    const lg_interval *f = test_interval(test_program(&spec), &zero, 1);
    void *work = lg_test_memory(lg_interval_work_size(f));
    double low[FLAGGED], high[FLAGGED];
    uint8_t flags[FLAGGED];
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        assert_ok(lg_interval_eval(f, 1, rows[i].low, rows[i].high, low, high, flags, work, NULL));
        for (size_t j = 0; j < FLAGGED; j++)
            if (flags[j] != rows[i].wanted[j])
                fail_msg("box %zu, output %zu: level %d, not %d", i, j, flags[j], rows[i].wanted[j]);
        assert_true(low[4] == 0 && high[4] == 0 && low[5] == 0 && high[5] == 0);
    }
}

RECORDING(diagonal_angle) {
    y[0] = lg_atan2(tape, x[0], x[0]);
}

TEST("the slope of atan2(v, v) has no bound where v may be 0, and is 0 elsewhere") {
    lg_program *program = program_of(diagonal_angle);
    const size_t functions[2] = {0, derived(program, LG_DERIVATIVE_JACOBIAN, "f")};
    const lg_interval *f = test_interval(program, functions, 2);
    const double low[3] = {-1, 1, -2}, high[3] = {1, 2, -1};
    double l[12], h[12];
    uint8_t flags[12];
    assert_ok(lg_interval_eval(f, 1, low, high, l, h, flags, lg_test_memory(lg_interval_work_size(f)), NULL));
    assert_true(flags[0] == U && flags[3] == U && isinf(l[3]) && isinf(h[3]));
    for (size_t i = 1; i < 3; i++)
        assert_true(flags[i] == S && flags[3 + 4 * i] >= D && l[3 + 4 * i] <= 0 && h[3 + 4 * i] >= 0);
}

TEST("products of comparisons jump, a stopped gradient has no slopes, smooth functions have all levels") {
    static const struct {
        lg_record_function record;
        uint8_t wanted;
    } rows[] = {{jumping, D}, {stopped, C}, {both_hold, D}, {one_holds, D}, {weighed, D}, {square, S}};
    const double low[3] = {-1, -1, -1}, high[3] = {1, 1, 1};
    const size_t zero = 0;
    double l[3], h[3];
    uint8_t flags[3];
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_interval *f = test_interval(program_of(rows[i].record), &zero, 1);
        assert_ok(
            lg_interval_eval(f, 1, low, high, l, h, flags, lg_test_memory(lg_interval_work_size(f)), NULL));
        for (size_t j = 0; j < 3; j++) assert_int_equal(flags[j], rows[i].wanted);
    }
}

static size_t even, odd;

/* f(-x) = f(x) or -f(x) where the code says so: bounds at both points overlap. */
static void check_parity(const lg_tape *tape, const lg_node *node, const char *row) {
    interval_node *n = interval_node_of(tape, node, lg_interval_kernel(lg_isa_in_use()));
    if (n == NULL || n->inputs == 0) return;
    int8_t *parity = TEST_ARRAY(int8_t, n->outputs);
    double *at = TEST_ARRAY(double, 2 * n->inputs), *low = TEST_ARRAY(double, 2 * n->outputs),
           *high = TEST_ARRAY(double, 2 * n->outputs);
    assert_ok(lg_expansion_parity(&n->expansion, parity));
    for (size_t i = 0; i < n->inputs; i++) at[n->inputs + i] = -(at[i] = n->at[i]);
    assert_ok(lg_interval_eval(n->f, 2, at, at, low, high, NULL, lg_test_memory(lg_interval_work_size(n->f)),
                               NULL));
    for (size_t j = 0; j < n->outputs; j++) {
        const double l = low[n->outputs + j], h = high[n->outputs + j],
                     from = parity[j] > 0 ? low[j] : -high[j], to = parity[j] > 0 ? high[j] : -low[j];
        if (parity[j] == 0) continue;
        *(parity[j] > 0 ? &even : &odd) += 1;
        if (!(l <= to && from <= h))
            fail_msg("%s: %s: element %zu is not %s: [%g, %g] and [%g, %g]", row, node->op->name, j,
                     parity[j] > 0 ? "even" : "odd", low[j], high[j], l, h);
    }
}

TEST("what is called even or odd is so, for every operation") {
    even = odd = 0;
    each_node(check_parity);
    print_message("%zu even, %zu odd\n", even, odd);
    assert_true(even > 20 && odd > 20);
}

/* u in the limits -2 and `high` */
static lg_var limited(lg_tape *tape, lg_var u, double high) {
    const lg_var above = lg_max(tape, u, lg_full(tape, lg_shape0(), -2));
    return lg_neg(tape, lg_max(tape, lg_neg(tape, above), lg_full(tape, lg_shape0(), -high)));
}

/* (x1 x2, sin x1 cos x2, |x1|, sat(x1 + x2), the same with other limits, x1 + 1, exp x1, exp x2^2) */
RECORDING(mixed_parity) {
    const lg_var a = lg_slice(tape, x[0], 1, 0, 1), b = lg_slice(tape, x[0], 1, 1, 1),
                 sum = lg_add(tape, a, b);
    const lg_var parts[8] = {lg_mul(tape, a, b),    lg_mul(tape, lg_sin(tape, a), lg_cos(tape, b)),
                             lg_abs(tape, a),       limited(tape, sum, 2),
                             limited(tape, sum, 3), lg_add_scalar(tape, a, 1),
                             lg_exp(tape, a),       lg_exp(tape, lg_square(tape, b))};
    y[0] = lg_concat(tape, parts, 8, 1);
}

TEST("saturations with equal limits are odd, with other limits they are not") {
    static const int wanted[8] = {1, -1, 1, -1, 0, 0, 0, 1};
    const lg_port in = {.name = "x", .shape = lg_shape1(2)}, out = {.name = "y"};
    const lg_function_spec function = {"f", &in, 1, &out, 1, mixed_parity, NULL};
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    const size_t zero = 0;
    const lg_interval *f = test_interval(test_program(&spec), &zero, 1);
    for (size_t j = 0; j < 8; j++) assert_int_equal(lg_interval_parity(f, j), wanted[j]);
    assert_int_equal(lg_interval_parity(f, 8), 0);
}

TEST("an operation without interval form is refused by name") {
    lg_interval *f = NULL;
    lg_error error;
    const size_t zero = 0;
    assert_int_equal(lg_interval_create(program_of(greatest), &zero, 1, NULL, &f, &error), LG_UNSUPPORTED);
    assert_non_null(strstr(error.message, "'max_axis' has no interval form"));
}

TEST("operations on constants are rounded outward, too") {
    const size_t zero = 0;
    lg_interval *f = test_interval(program_of(cancelled), &zero, 1);
    const double one[3] = {1, 1, 1};
    const long double exact = ((long double)0.7 - (long double)0.1) / (long double)0.3 - 2;
    double l[3], h[3];
    assert_ok(lg_interval_eval(f, 1, one, one, l, h, NULL, lg_test_memory(lg_interval_work_size(f)), NULL));
    assert_true(l[0] <= exact && exact <= h[0] && h[0] - l[0] < 2e-15 && l[0] < h[0]);
}

TEST("constants that are widened contain the decimal number that they stand for") {
    lg_interval_options options;
    lg_interval *f = NULL;
    double l[3], h[3];
    const double x[3] = {3, 3 * 0x1p40, -9};
    const size_t zero = 0;
    lg_interval_options_init(&options);
    options.widen = true;
    assert_ok(lg_interval_create(program_of(third), &zero, 1, &options, &f, NULL));
    lg_test_owns(f, release_interval);
    assert_ok(lg_interval_eval(f, 1, x, x, l, h, NULL, lg_test_memory(lg_interval_work_size(f)), NULL));
    for (int i = 0; i < 3; i++)
        assert_true(l[i] < x[i] / 3 && x[i] / 3 < h[i] && h[i] - l[i] < 1e-15 * fabs(x[i]));
}

TEST("boxes that are empty or not finite are refused, and outputs stay") {
    const size_t zero = 0;
    lg_interval *f = test_interval(program_of(square), &zero, 1);
    double l[6] = {7}, h[6] = {7};
    lg_error error;
    void *work = lg_test_memory(lg_interval_work_size(f));
    const double good[6] = {0, 0, 0, 0, 0, 0}, above[6] = {0, 0, 0, 0, 1, 0}, none[6] = {0, 0, 0, 0, NAN, 0},
                 far[6] = {0, 0, 0, 0, INFINITY, 0};
    assert_int_equal(lg_interval_eval(f, 2, above, good, l, h, NULL, work, &error), LG_INVALID_ARGUMENT);
    assert_string_equal(error.message, "box 1, input 1: [1, 0] is empty");
    assert_int_equal(lg_interval_eval(f, 2, good, none, l, h, NULL, work, &error), LG_NOT_FINITE);
    assert_int_equal(lg_interval_eval(f, 2, good, far, l, h, NULL, work, &error), LG_NOT_FINITE);
    assert_true(l[0] == 7 && h[0] == 7);
}

TEST("bounds and proofs need the rounding to nearest") {
    static const int modes[] = {FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};
    const size_t zero = 0;
    lg_program *program = program_of(square);
    lg_interval *f = test_interval(program, &zero, 1), *none = NULL;
    double l[3] = {7}, h[3], bound[3];
    const double x[3] = {0.1, 0.2, 0.3};
    void *work = lg_test_memory(lg_interval_work_size(f));
    for (size_t i = 0; i < LG_COUNT(modes); i++) {
        assert_int_equal(fesetround(modes[i]), 0);
        const lg_status status[] = {lg_interval_eval(f, 1, x, x, l, h, NULL, work, NULL),
                                    lg_interval_create(program, &zero, 1, NULL, &none, NULL),
                                    lg_interval_rounding(program, 0, x, x, 0x1p-53, bound, NULL)};
        (void)fesetround(FE_TONEAREST);
        for (size_t k = 0; k < LG_COUNT(status); k++) assert_int_equal(status[k], LG_UNSUPPORTED);
        assert_true(l[0] == 7);
    }
}

TEST("inputs and outputs in parts give the same bounds; a box with a number that has no bounds is reported") {
    const size_t zero = 0;
    lg_interval *f = test_interval(program_of(square), &zero, 1);
    void *work = lg_test_memory(lg_interval_work_size(f));
    double low[12] = {0.1, 0.2, 0.3, 1, NAN, 1, -1, -2, -3, 0.5, 1, 3}, high[12], l[12], h[12];
    double a[4], A[4], b[8], B[8], out[2][12];
    bool unbounded[4] = {false};
    for (int i = 0; i < 12; i++) high[i] = i == 8 ? INFINITY : low[i] + 0.25;
    high[11] = 2; /* below the lower bound */
    for (int i = 0; i < 4; i++) {
        a[i] = low[3 * i], A[i] = high[3 * i];
        for (int k = 0; k < 2; k++) b[2 * i + k] = low[3 * i + 1 + k], B[2 * i + k] = high[3 * i + 1 + k];
    }
    const lg_bounds *const in[] = {&(lg_bounds){a, A, 1}, &(lg_bounds){b, B, 2}},
                           *const parts[] = {&(lg_bounds){out[0], out[1], 2},
                                             &(lg_bounds){out[0] + 8, out[1] + 8, 1}};
    LG_INTERVAL_BOUND(f, 4, in, parts, NULL, unbounded, work);
    assert_memory_equal(unbounded, ((bool[]){false, true, true, true}), sizeof unbounded);
    low[4] = high[4] = low[8] = high[8] = low[11] = high[11] = 0;
    assert_ok(lg_interval_eval(f, 4, low, high, l, h, NULL, work, NULL));
    for (int i = 0; i < 4; i++) {
        assert_memory_equal(out[0] + 2 * i, l + 3 * i, 2 * sizeof *l);
        assert_memory_equal(out[1] + 2 * i, h + 3 * i, 2 * sizeof *h);
        assert_true(out[0][8 + i] == l[3 * i + 2] && out[1][8 + i] == h[3 * i + 2]);
    }
}

/* ---- loops, parameters and requests that are refused ---- */

/* (a, b) -> (a + sin(theta b)/4, a b/2) */
RECORDING(exchange) {
    y[0] = lg_add(tape, x[0], lg_scale(tape, lg_sin(tape, lg_mul(tape, theta[0], x[1])), 0.25));
    y[1] = lg_scale(tape, lg_mul(tape, x[0], x[1]), 0.5);
}

RECORDING(three_times) {
    lg_var now[2] = {x[0], x[1]}, path[3];
    for (int n = 0; n < 3; n++) {
        const lg_var a = lg_program_call(tape, "step", 0, now), b = lg_program_call(tape, "step", 1, now);
        path[n] = lg_reshape(tape, a, lg_shape3(lg_var_shape(tape, a).dims[0], 1, 2));
        now[0] = a;
        now[1] = b;
    }
    y[0] = now[0];
    y[1] = now[1];
    y[2] = lg_concat(tape, path, 3, 1);
}

TEST("a loop has the bounds of its steps, which contain the exact values; functions must fit together") {
    static const double scale[2] = {1.5, -0.5};
    static const lg_port in[2] = {{.name = "a", .shape = {1, {2}}}, {.name = "b", .shape = {1, {2}}}},
                         out[3] = {{.name = "p"}, {.name = "q"}, {.name = "path"}};
    static const lg_carry carry[2] = {{"p", "a"}, {"q", "b"}};
    const lg_parameter_spec theta = {"theta", lg_shape1(2), scale};
    const lg_function_spec functions[] = {{"step", in, 2, out, 2, exchange, NULL},
                                          {"unrolled", in, 2, out, 3, three_times, NULL},
                                          {"single", in, 1, out, 1, third, NULL}};
    const lg_program_spec spec = spec_of(&theta, 1, functions, 3);
    const lg_loop_spec loop = {sizeof loop, "loop", "step", 3, carry, 2, (const char *const[]){"p"}, 1};
    lg_program *program = test_program(&spec);
    lg_interval *refused = NULL;
    lg_error error;
    double low[2][10], high[2][10], x[4] = {0.3, -0.2, 0.7, 1.1};
    static const double from[4] = {0.3, -0.2, 0.7, 1.0}, to[4] = {0.3, -0.1, 0.7, 1.2};
    assert_told(lg_program_add_loop(program, &loop, &told));
    for (size_t k = 0; k < 2; k++) {
        const size_t function = k == 0 ? 1 : 3;
        const lg_interval *f = test_interval(program, &function, 1);
        assert_int_equal(lg_interval_outputs(f), 10);
        assert_true(lg_interval_operations(f) > 0);
        assert_ok(lg_interval_eval(f, 1, from, to, low[k], high[k], NULL,
                                   lg_test_memory(lg_interval_work_size(f)), NULL));
    }
    assert_memory_equal(low[0], low[1], sizeof low[0]);
    assert_memory_equal(high[0], high[1], sizeof high[0]);
    for (int n = 0; n < 3; n++)
        for (int i = 0; i < 2; i++) {
            const double a = x[i], b = x[2 + i];
            x[i] = a + sin(scale[i] * b) / 4;
            x[2 + i] = a * b / 2;
            assert_true(low[0][4 + 2 * n + i] <= x[i] && x[i] <= high[0][4 + 2 * n + i]);
        }
    const struct {
        size_t functions[2], count, size;
        lg_status status;
        const char *words;
    } rows[] = {{{0, 0}, 0, sizeof(lg_interval_options), LG_INVALID_ARGUMENT, "no functions"},
                {{0, 0}, 1, 1, LG_INVALID_ARGUMENT, "size"},
                {{0, 9}, 2, sizeof(lg_interval_options), LG_NOT_FOUND, "no function number 9"},
                {{0, 2}, 2, sizeof(lg_interval_options), LG_INVALID_ARGUMENT, "differ in their inputs"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const lg_interval_options options = {.size = rows[i].size};
        assert_status(
            lg_interval_create(program, rows[i].functions, rows[i].count, &options, &refused, &error),
            rows[i].status);
        assert_says(error.message, rows[i].words);
    }
    lg_interval_options_init(NULL);
    assert_int_equal(lg_interval_inputs(NULL) + lg_interval_outputs(NULL) + lg_interval_operations(NULL), 0);
    assert_int_equal(lg_interval_work_size(NULL), 0);
    assert_int_equal(lg_interval_parity(NULL, 0), 0);
    lg_interval_destroy(NULL);
    assert_null(refused);
    unsigned char pattern[4] = {0};
    assert_ok(lg_program_sparsity(program, 3, 0, 0, pattern, &error));
    for (size_t i = 0; i < 4; i++) assert_int_equal(pattern[i], 1); /* of a loop, everything is assumed */
}

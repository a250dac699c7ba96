/* Polynomial V by linear programming.
 * ctest-labels: src/certify src/autodiff */
#include "certify_support.h"

#include "certify/linear_program.h"
#include "liegrad/lyapunov.h"

/* ---- Van der Pol: x1' = x2, x2' = -x1 + (1 - x1^2) x2 + u, u = -sat(3 x2) ---- */

RECORDING(van_der_pol) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var u = saturated(tape, lg_scale(tape, b, -3), 1);
    const lg_var damped = lg_sub(tape, b, lg_mul(tape, lg_square(tape, a), b));
    const lg_var parts[2] = {b, lg_add(tape, lg_sub(tape, damped, a), u)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

/* Lienard's coordinates: x1, x2 - x1 + x1^3/3 */
RECORDING(lienard) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var cube = lg_scale(tape, lg_mul(tape, a, lg_square(tape, a)), 1.0 / 3.0);
    const lg_var parts[2] = {a, lg_add(tape, lg_sub(tape, b, a), cube)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

/* The same in Lienard's coordinates; areas are equal, as the determinant of the map is 1. */
RECORDING(turned) {
    const lg_var a = column(tape, x[0], 0), w = column(tape, x[0], 1);
    const lg_var cube = lg_scale(tape, lg_mul(tape, a, lg_square(tape, a)), 1.0 / 3.0);
    const lg_var b = lg_sub(tape, lg_add(tape, w, a), cube), u = saturated(tape, lg_scale(tape, b, -3), 1);
    const lg_var parts[2] = {b, lg_sub(tape, u, a)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

static lg_lyapunov_spec fit_of(const char *map, int degree, const double *low, const double *high) {
    lg_lyapunov_spec v;
    lg_lyapunov_spec_init(&v);
    v.rate = "loop";
    v.map = map;
    v.name = "lyapunov";
    v.low = low;
    v.high = high;
    v.degree = degree;
    v.decay = 1e-2;
    return v;
}

static lg_certify_result prove_polynomial(lg_record_function loop, lg_record_function map, int degree,
                                          const double *low, const double *high) {
    lg_program *program = loop_program(2, loop, map, NULL);
    const lg_lyapunov_spec v = fit_of(map == NULL ? NULL : "v", degree, low, high);
    const double start = lg_seconds();
    assert_told(lg_lyapunov_polynomial(program, &v, &told));
    print_message("degree %d: %.2f s\n", degree, lg_seconds() - start);
    lg_certify_spec spec = spec_for(program, NULL, low, high);
    spec.lyapunov = "lyapunov";
    return prove(&spec, 60);
}

RECORDING(held_still) {
    y[0] = lg_neg(tape, x[0]);
}

TEST("Van der Pol: an area of at least 50 inside the published box 4.8, 10.8") {
    const double low[2] = {-4.4, -9}, high[2] = {4.4, 9};
    const lg_certify_result r = prove_polynomial(van_der_pol, lienard, 8, low, high);
    assert_true(r.verified && r.converges && r.volume >= 50);
}

TEST("Van der Pol: an area of at least 150 in a box of Lienard's coordinates") {
    const double low[2] = {-6, -14}, high[2] = {6, 14};
    const lg_certify_result r = prove_polynomial(turned, NULL, 10, low, high);
    assert_true(r.verified && r.converges && r.volume >= 150);
}

TEST("a box in which no polynomial falls is refused") {
    const double low[2] = {-6, -18}, high[2] = {6, 18};
    lg_error error;
    lg_program *program = loop_program(2, van_der_pol, lienard, NULL);
    const lg_lyapunov_spec v = fit_of("v", 4, low, high);
    assert_int_equal(lg_lyapunov_polynomial(program, &v, &error), LG_NO_CONVERGENCE);
    assert_non_null(strstr(error.message, "no polynomial of degree 4 falls at all 12000 points"));
    assert_int_equal(lg_program_functions(program), 2);
}

RECORDING(root) {
    y[0] = lg_sqrt(tape, x[0]);
}

RECORDING(one_number) {
    y[0] = column(tape, x[0], 0);
}

TEST("numbers out of range, functions of other sizes and too many monomials are refused") {
    const double low[6] = {-1, -1, -1, -1, -1, -1}, high[6] = {1, 1, 1, 1, 1, 1};
    lg_error error;
    lg_program *program = loop_program(2, van_der_pol, one_number, NULL);
    lg_lyapunov_spec bad[7];
    for (size_t i = 0; i < LG_COUNT(bad); i++) bad[i] = fit_of(NULL, 4, low, high);
    bad[0].size = 3, bad[1].degree = 0, bad[2].degree = 14, bad[3].degree = 3, bad[4].points = 99;
    bad[5].points = 1000001, bad[6].decay = 0;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_int_equal(lg_lyapunov_polynomial(program, &bad[i], &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "the degree must be even");
    }
    const lg_lyapunov_spec narrow = fit_of("v", 4, low, high);
    assert_int_equal(lg_lyapunov_polynomial(program, &narrow, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "the function 'v' needs one input");
    const lg_port square = {.name = "x", .shape = lg_shape2(2, 2)},
                  many = {.name = "x", .shape = lg_shape1(7)},
                  shared = {.name = "x", .shape = lg_shape1(2), .shared = true},
                  six = {.name = "x", .shape = lg_shape1(6)}, out = {.name = "y"};
    const lg_port *const ports[] = {&square, &many, &shared};
    for (size_t i = 0; i < LG_COUNT(ports); i++) {
        const lg_function_spec function = {"loop", ports[i], 1, &out, 1, held_still, NULL};
        const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
        const lg_lyapunov_spec v = fit_of(NULL, 4, low, high);
        assert_int_equal(lg_lyapunov_polynomial(test_program(&spec), &v, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, "the function 'loop' needs one input");
    }
    const lg_port pair[2] = {six, {.name = "z", .shape = lg_shape1(6)}};
    const lg_function_spec two = {"loop", pair, 2, &out, 1, held_still, NULL};
    const lg_program_spec of_two = spec_of(NULL, 0, &two, 1);
    const lg_lyapunov_spec w = fit_of(NULL, 4, low, high), endless = fit_of(NULL, 4, low, high);
    assert_int_equal(lg_lyapunov_polynomial(test_program(&of_two), &w, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "the function 'loop' needs one input");
    assert_int_equal(lg_lyapunov_polynomial(loop_program(2, root, NULL, NULL), &endless, &error),
                     LG_NOT_FINITE);
    assert_says(error.message, "not finite at a point of the box");
    const lg_function_spec function = {"loop", &six, 1, &out, 1, held_still, NULL};
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    const lg_lyapunov_spec v = fit_of(NULL, 12, low, high);
    assert_int_equal(lg_lyapunov_polynomial(test_program(&spec), &v, &error), LG_INVALID_ARGUMENT);
    assert_says(error.message, "more than 500 monomials");
    lg_lyapunov_spec_init(NULL);
}

/* x' = 1 - x about the goal 1: V is a polynomial in x - 1. */
RECORDING(towards_one) {
    y[0] = lg_add_scalar(tape, lg_neg(tape, x[0]), 1.0);
}

TEST("the goal may be anywhere: V is 0 there") {
    const double low[1] = {0.25}, high[1] = {1.75}, goal[1] = {1};
    lg_program *program = loop_program(1, towards_one, NULL, NULL);
    lg_lyapunov_spec v = fit_of(NULL, 2, low, high);
    double at, value, *out = &value, rest[4], four_low[4] = {-1, -1, -1, -1}, four_high[4] = {1, 1, 1, 1};
    const double *in = &at;
    v.goal = goal;
    assert_told(lg_lyapunov_polynomial(program, &v, &told));
    for (int i = 0; i < 3; i++) {
        at = 1 + 0.5 * (i - 1);
        assert_ok(lg_program_eval(NULL, program, "lyapunov", 1, &in, &out, NULL));
        assert_true(i == 1 ? fabs(value) < 1e-15 : value > 0);
    }
    lg_rng rng = test_rng(3, 3); /* 65 monomials */
    lg_lyapunov_spec of_four = fit_of(NULL, 4, four_low, four_high);
    of_four.points = 400;
    program = loop_program(4, held_still, NULL, NULL);
    assert_told(lg_lyapunov_polynomial(program, &of_four, &told));
    in = rest;
    for (int i = 0; i < 20; i++) { /* x' = -x: V falls along rays */
        double before = 0;
        for (int k = 0; k < 4; k++) rest[k] = 0.5 * lg_rng_uniform_in(&rng, -1, 1);
        for (int n = 0; n < 2; n++) {
            assert_ok(lg_program_eval(NULL, program, "lyapunov", 1, &in, &out, NULL));
            assert_true(value > before);
            before = value;
            for (int k = 0; k < 4; k++) rest[k] *= 2;
        }
    }
}

/* ---- linear programs ---- */

TEST("a linear program with a known solution is solved, one without a solution is refused") {
    /* min -x - 2 y with x + y <= 4, x + 3 y <= 6, x, y >= 0: at (3, 1) */
    const double A[8] = {-1, -1, -1, -3, 1, 0, 0, 1}, b[4] = {-4, -6, 0, 0}, c[2] = {-1, -2};
    double x[2];
    assert_ok(lg_linear_program(NULL, 4, 2, A, b, c, x));
    assert_close(x[0], 3, 0, 1e-6);
    assert_close(x[1], 1, 0, 1e-6);
    const double none[4] = {-4, -6, 5, 0};
    assert_int_equal(lg_linear_program(NULL, 4, 2, A, none, c, x), LG_NO_CONVERGENCE);
    const double down[2] = {1, -2}, half[4] = {-4, -6, 0, 0};
    assert_int_equal(lg_linear_program(NULL, 2, 2, A + 4, half + 2, down, x), LG_NO_CONVERGENCE);
}

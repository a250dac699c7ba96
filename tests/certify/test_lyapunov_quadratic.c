/* Quadratic V by a search: what is proposed is large, holds, and does not depend on units or threads.
 * ctest-labels: src/certify */
#include "certify_support.h"

#include "liegrad/lyapunov.h"

/* A pendulum at the top: x1' = x2, x2' = g sin x1 - .1 x2 + u, in units `time` of time and `angle` of x1;
 * u = sat(-K x). */
typedef struct pendulum {
    double time, angle, limit;
    double K[2]; /* for a loop with given gains */
} pendulum;

static lg_var rate_of(lg_tape *tape, const pendulum *p, lg_var x, lg_var K) {
    const double t = p->time, a = p->angle;
    const lg_var q = column(tape, x, 0), v = column(tape, x, 1);
    const lg_var u = saturated(tape, lg_neg(tape, lg_matmul_nt(tape, x, K)), p->limit);
    const lg_var turn = lg_scale(tape, lg_sin(tape, lg_scale(tape, q, 1 / a)), a * t * t);
    const lg_var push = lg_sub(tape, lg_scale(tape, u, a * t * t), lg_scale(tape, v, 0.1 * t));
    return lg_concat(tape, (const lg_var[]){v, lg_add(tape, turn, push)}, 2, 1);
}

RECORDING(steered) {
    y[0] = rate_of(tape, user, x[0], x[1]);
}

RECORDING(given) {
    const pendulum *p = user;
    y[0] = rate_of(tape, p, x[0], lg_input_f64(tape, lg_shape2(1, 2), p->K));
}

/* A step of Euler's method of .02 */
RECORDING(steered_step) {
    y[0] = lg_add(tape, x[0], lg_scale(tape, rate_of(tape, user, x[0], x[1]), 0.02));
}

static lg_program *pendulum_program(lg_record_function record, bool gains, pendulum *p) {
    const lg_port in[2] = {{.name = "x", .shape = lg_shape1(2)},
                           {.name = "K", .shape = lg_shape2(1, 2), .shared = true}},
                  out = {.name = "y"};
    const lg_function_spec function = {"loop", in, gains ? 2 : 1, &out, 1, record, p};
    const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
    return test_program(&spec);
}

static const double low[2] = {-3, -4}, high[2] = {3, 4};

static lg_lyapunov_search search_in(const double *from, const double *to) {
    lg_lyapunov_search s;
    lg_lyapunov_search_init(&s);
    s.rate = "loop";
    s.low = from, s.high = to;
    s.generations = 240;
    return s;
}

static double volume_of(const double *P) {
    return 3.14159265358979 / sqrt(P[0] * P[3] - P[1] * P[2]);
}

TEST("gains and V are found, and nearly all of the proposal is proved") {
    pendulum p = {1, 1, 1.5, {0}};
    double P[4], volume;
    lg_lyapunov_search s = search_in(low, high);
    assert_told(lg_lyapunov_quadratic(NULL, pendulum_program(steered, true, &p), &s, P, p.K, &volume, &told));
    assert_close(volume, volume_of(P), 1e-9, 0);
    assert_true(P[1] == P[2] && volume > 9);
    lg_certify_spec spec = spec_for(pendulum_program(given, false, &p), P, low, high);
    spec.most = 1;
    const lg_certify_result r = prove(&spec, 20);
    assert_true(r.verified && r.converges && r.level <= 1 && r.volume > 0.9 * volume);
    /* The same with V alone, for the gains that were found. */
    double alone[4], found;
    assert_told(lg_lyapunov_quadratic(NULL, spec.program, &s, alone, NULL, &found, &told));
    print_message("with gains %g, V alone %g\n", volume, found);
    assert_true(found > 0.9 * volume);
}

TEST("steps: gains and V are found and proved") {
    pendulum p = {1, 1, 1.5, {0}};
    double P[4], volume;
    lg_lyapunov_search s = search_in(low, high);
    s.step = true;
    assert_told(
        lg_lyapunov_quadratic(NULL, pendulum_program(steered_step, true, &p), &s, P, p.K, &volume, &told));
    assert_true(volume > 8);
}

TEST("the proposal does not depend on units") {
    static const double times[] = {1e9, 1e-9}, angles[] = {1e9, 1e-9};
    pendulum p = {1, 1, 1.5, {0}};
    double P[4], K[2], volume;
    lg_lyapunov_search s = search_in(low, high);
    assert_told(lg_lyapunov_quadratic(NULL, pendulum_program(steered, true, &p), &s, P, K, &volume, &told));
    for (size_t i = 0; i < 4; i++) {
        pendulum other = {times[i / 2], angles[i % 2], 1.5, {0}};
        const double unit[2] = {other.angle, other.angle * other.time};
        const double from[2] = {low[0] * unit[0], low[1] * unit[1]},
                     to[2] = {high[0] * unit[0], high[1] * unit[1]};
        double there[4], gains[2], size;
        s = search_in(from, to);
        assert_told(lg_lyapunov_quadratic(NULL, pendulum_program(steered, true, &other), &s, there, gains,
                                          &size, &told));
        assert_close(size / (unit[0] * unit[1]), volume, 0.02, 0);
    }
}

TEST("threads do not change a bit, another seed finds as much") {
    pendulum p = {1, 1, 1.5, {0}};
    double P[4], K[2], again[4], gains[2], volume, other;
    lg_lyapunov_search s = search_in(low, high);
    const lg_program *program = pendulum_program(steered, true, &p);
    assert_told(lg_lyapunov_quadratic(NULL, program, &s, P, K, &volume, &told));
    s.threads = 3;
    assert_told(lg_lyapunov_quadratic(NULL, program, &s, again, gains, &other, &told));
    assert_memory_equal(P, again, sizeof P);
    assert_memory_equal(K, gains, sizeof K);
    s.seed = 7;
    assert_told(lg_lyapunov_quadratic(NULL, program, &s, again, gains, &other, &told));
    assert_close(other, volume, 0.05, 0);
}

TEST("an error of the model makes the proposal smaller") {
    pendulum p = {1, 1, 1.5, {0}};
    const double error[2] = {0, 0.3};
    double P[4], volume, with;
    lg_lyapunov_search s = search_in(low, high);
    const lg_program *program = pendulum_program(steered, true, &p);
    assert_told(lg_lyapunov_quadratic(NULL, program, &s, P, p.K, &volume, &told));
    s.model_error = error;
    assert_told(lg_lyapunov_quadratic(NULL, program, &s, P, p.K, &with, &told));
    assert_true(with < 0.9 * volume && with > 0.2 * volume);
}

TEST("a loop that no V shows to be stable, and sizes that do not fit, are refused") {
    pendulum p = {1, 1, 1.5, {0.5, 1}}; /* the slope of the sine is 1 */
    double P[4] = {7, 7, 7, 7};
    lg_error error;
    lg_lyapunov_search s = search_in(low, high);
    const lg_program *program = pendulum_program(given, false, &p);
    assert_int_equal(lg_lyapunov_quadratic(NULL, program, &s, P, NULL, NULL, &error), LG_CHECK_FAILED);
    assert_non_null(strstr(error.message, "is not stable"));
    assert_true(P[0] == 7);
    s.low = high;
    assert_int_equal(lg_lyapunov_quadratic(NULL, program, &s, P, NULL, NULL, &error), LG_INVALID_ARGUMENT);
    s = search_in(low, high);
    s.rate = "none";
    assert_int_equal(lg_lyapunov_quadratic(NULL, program, &s, P, NULL, NULL, &error), LG_NOT_FOUND);
    s.rate = "loop";
    assert_int_equal(
        lg_lyapunov_quadratic(NULL, pendulum_program(steered, true, &p), &s, P, NULL, NULL, &error),
        LG_INVALID_ARGUMENT);
}

/* No gain moves the first state. */
RECORDING(beyond_reach) {
    const lg_var q = column(tape, x[0], 0), v = column(tape, x[0], 1), u = lg_matmul_nt(tape, x[0], x[1]);
    y[0] = lg_concat(tape, (const lg_var[]){q, lg_sub(tape, u, v)}, 2, 1);
}

RECORDING(rooted) {
    y[0] = lg_sqrt(tape, x[0]);
}

TEST("a loop that no gains stabilise, and one that is not finite about the goal, are refused") {
    double P[4], K[2];
    lg_error error;
    const lg_lyapunov_search s = search_in(low, high);
    assert_int_equal(
        lg_lyapunov_quadratic(NULL, pendulum_program(beyond_reach, true, NULL), &s, P, K, NULL, &error),
        LG_CHECK_FAILED);
    assert_says(error.message, "is not stabilised by any gains");
    assert_int_equal(
        lg_lyapunov_quadratic(NULL, pendulum_program(rooted, false, NULL), &s, P, NULL, NULL, &error),
        LG_CHECK_FAILED);
    assert_says(error.message, "not finite near the goal");
}

RECORDING(first_column) {
    y[0] = column(tape, x[0], 0);
}

TEST("functions of other sizes and numbers out of range are refused") {
    pendulum p = {1, 1, 1.5, {0.5, 1}};
    double P[4];
    lg_error error;
    const lg_port x = {.name = "x", .shape = lg_shape1(2)},
                  shared = {.name = "x", .shape = lg_shape2(1, 2), .shared = true},
                  square = {.name = "x", .shape = lg_shape2(2, 2)},
                  rows = {.name = "L", .shape = lg_shape2(1, 2)},
                  narrow = {.name = "K", .shape = lg_shape2(1, 1), .shared = true},
                  flat = {.name = "K", .shape = lg_shape1(2), .shared = true},
                  many = {.name = "K", .shape = lg_shape2(17, 2), .shared = true},
                  large = {.name = "x", .shape = lg_shape1(17)}, out = {.name = "y"};
    const struct {
        lg_port in[3];
        size_t inputs;
        lg_record_function record;
    } wrong[] = {
        {{x}, 1, first_column},       {{shared}, 1, first_column},        {{square}, 1, first_column},
        {{x, rows}, 2, first_column}, {{x, narrow}, 2, first_column},     {{x, flat}, 2, first_column},
        {{large}, 1, first_column},   {{x, many, rows}, 3, first_column}, {{x, many}, 2, first_column}};
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        const lg_function_spec function = {"loop",          wrong[i].in, wrong[i].inputs, &out, 1,
                                           wrong[i].record, &p};
        const lg_program_spec spec = spec_of(NULL, 0, &function, 1);
        const lg_lyapunov_search s = search_in(low, high);
        assert_int_equal(lg_lyapunov_quadratic(NULL, test_program(&spec), &s, P, p.K, NULL, &error),
                         LG_INVALID_ARGUMENT);
        assert_says(error.message, "the function 'loop' needs one input of 1 to");
    }
    const lg_program *program = pendulum_program(given, false, &p);
    const double zero[2] = {0, 1}, below[2] = {-1, 0}, endless[2] = {INFINITY, 1};
    lg_lyapunov_search bad[8];
    for (size_t i = 0; i < LG_COUNT(bad); i++) bad[i] = search_in(low, high);
    bad[0].size = 3, bad[1].directions = 9, bad[2].directions = 1000001, bad[3].threads = 0;
    bad[4].scale = zero, bad[5].scale = endless, bad[6].model_error = below, bad[7].goal = high;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_int_equal(lg_lyapunov_quadratic(NULL, program, &bad[i], P, NULL, NULL, &error),
                         LG_INVALID_ARGUMENT);
        assert_says(error.message, i < 4 ? "directions 10 to 1e6" : "the box must hold the goal");
    }
    lg_lyapunov_search_init(NULL);
    const volatile int stop = 1;
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.cancel = &stop;
    assert_ok(lg_context_create(&options, &context));
    lg_lyapunov_search s = search_in(low, high);
    assert_int_equal(
        lg_lyapunov_quadratic(context, pendulum_program(steered, true, &p), &s, P, p.K, NULL, &error),
        LG_CANCELLED);
    lg_context_destroy(context);
}

TEST("an allocation that fails is reported, and nothing leaks") {
    pendulum p = {1, 1, 1.5, {0}};
    lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    const lg_program *program = pendulum_program(steered, true, &p);
    lg_lyapunov_search s = search_in(low, high);
    s.generations = 6;
    long n = 1;
    for (;; n++) {
        double P[4], K[2];
        lg_fail_alloc_arm(&memory, n);
        const lg_status status = lg_lyapunov_quadratic(context, program, &s, P, K, NULL, NULL);
        if (!lg_fail_alloc_hit(&memory)) break;
        assert_int_equal(status, LG_OUT_OF_MEMORY);
        assert_int_equal(lg_fail_alloc_live(&memory), 0);
    }
    assert_true(n > 3);
    lg_context_destroy(context);
}

/* Certificates of other kinds: functions V that are wrong, errors of the model, steps, budgets and threads.
 * ctest-labels: threads src/certify src/autodiff */
#include "certify_support.h"

#include "certify/certify.h"

#include <fenv.h>

#include "liegrad/networks.h"
#include "support/fail_alloc.h"

static const double low[2] = {-1, -1}, high[2] = {1, 1};
static const double P[4] = {1.5, 0.5, 0.5, 1};

/* x1' = x2, x2' = -sin x1 - x2 */
RECORDING(damped) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var parts[2] = {b, lg_neg(tape, lg_add(tape, lg_sin(tape, a), b))};
    y[0] = lg_concat(tape, parts, 2, 1);
}

static lg_var form(lg_tape *tape, lg_var x) {
    return lg_rowdot(tape, x, lg_matmul(tape, x, lg_input_f64(tape, lg_shape2(2, 2), P)));
}

RECORDING(quadratic) {
    y[0] = form(tape, x[0]);
}

/* A quadratic form with a hole about (.4, .4): V is below eps there. */
RECORDING(with_a_hole) {
    const lg_var about[2] = {lg_full(tape, lg_shape1(1), 0.4), lg_full(tape, lg_shape1(1), 0.4)};
    const lg_var d = lg_sub(tape, x[0], lg_concat(tape, about, 2, 0));
    const lg_var dip = lg_exp(tape, lg_scale(tape, lg_rownorm2(tape, d), -40));
    y[0] = lg_mul(tape, form(tape, x[0]), lg_add_scalar(tape, lg_scale(tape, dip, -0.999), 1));
}

/* V = (1 - cos x1) + x2^2/2 + a mixed term, as an energy */
RECORDING(energy) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var rest = lg_add_scalar(tape, lg_neg(tape, lg_cos(tape, a)), 1);
    const lg_var mixed = lg_scale(tape, lg_mul(tape, lg_sin(tape, a), b), 0.3);
    y[0] = lg_add(tape, lg_add(tape, rest, mixed), lg_scale(tape, lg_square(tape, b), 0.5));
}

static lg_certify_spec spec_of_v(lg_record_function v) {
    lg_certify_spec spec = spec_for(loop_program(2, damped, v, NULL), NULL, low, high);
    spec.lyapunov = "v";
    return spec;
}

TEST("a function of the program as V: the level set stays inside the box, and its volume is a lower bound") {
    lg_certify_spec spec = spec_of_v(quadratic), form_spec = spec_for(spec.program, P, low, high);
    const lg_certify_result r = prove(&spec, 20), s = prove(&form_spec, 20);
    assert_true(r.verified && r.converges && s.verified && s.converges);
    assert_close(r.level, s.level, 0.01, 0);
    assert_true(r.volume < s.volume && r.volume > 0.97 * s.volume);
    assert_close(s.volume, 3.14159265 * s.level / sqrt(1.5 * 1 - 0.25), 1e-5, 0);
    lg_certify_spec other = spec_of_v(energy);
    assert_true(prove(&other, 20).converges);
}

TEST("a V with a hole is refused with the box") {
    lg_certify_spec spec = spec_of_v(with_a_hole);
    spec.level = 0.7;
    spec.eps = 0.05;
    const lg_certify_result r = prove(&spec, 20);
    assert_true(!r.verified && r.finished && r.reason[0] != '\0');
    print_message("[%g, %g] x [%g, %g]\n", r.failed_low[0], r.failed_high[0], r.failed_low[1],
                  r.failed_high[1]);
    assert_true(fabs(r.failed_low[0] - 0.4) < 0.4 && fabs(r.failed_low[1] - 0.4) < 0.4);
}

/* x+ = (x + 1)/2 */
RECORDING(halfway_to_one) {
    y[0] = lg_scale(tape, lg_add_scalar(tape, x[0], 1), 0.5);
}

TEST("a goal elsewhere, of steps too, and a box that is larger on one side change nothing") {
    const double form_of_loop[1] = {1}, from[1] = {-1}, to[1] = {2}, goal[1] = {1}, wide[2] = {1.2, 1};
    lg_certify_spec spec = spec_for(loop_program(1, halfway_to_one, NULL, NULL), form_of_loop, from, to);
    spec.goal = goal;
    spec.step = true;
    const lg_certify_result r = prove(&spec, 20);
    assert_true(r.verified);
    assert_close(r.level, 1, 1e-5, 0); /* up to x = 2 */
    lg_certify_spec even = spec_of_v(quadratic), uneven = even;
    uneven.high = wide;
    assert_close(prove(&uneven, 20).level, prove(&even, 20).level, 1e-3, 0);
}

/* The rate is chosen such that this V falls everywhere, even into the hole: x' = -grad V. */
RECORDING(down_hill) {
    lg_var v, slope;
    (void)with_a_hole(NULL, tape, theta, x, &v);
    (void)lg_grad(tape, lg_sum(tape, v), x, 1, &slope);
    y[0] = lg_neg(tape, slope);
}

/* x' = -x + side x^2: V = x^2 rises beyond x = side. */
RECORDING(one_sided) {
    const double side = *(const double *)user;
    y[0] = lg_sub(tape, lg_scale(tape, lg_square(tape, x[0]), side), x[0]);
}

TEST("a loop that is not the same on both sides is examined on both") {
    const double form_of_loop[1] = {1}, from[1] = {-1.5}, to[1] = {1.5};
    for (int i = 0; i < 2; i++) {
        double side = i == 0 ? 1 : -1;
        lg_certify_spec spec = spec_for(loop_program(1, one_sided, NULL, &side), form_of_loop, from, to);
        spec.level = 2;
        const lg_certify_result r = prove(&spec, 20);
        assert_true(!r.verified && side * r.failed_low[0] > 0.99);
        spec.level = 0.9;
        assert_true(prove(&spec, 20).converges);
    }
}

TEST("a part of {V < eps} elsewhere is refused") {
    lg_certify_spec spec = spec_for(loop_program(2, down_hill, with_a_hole, NULL), NULL, low, high);
    spec.lyapunov = "v";
    spec.level = 0.05;
    spec.eps = 0.03;
    const lg_certify_result r = prove(&spec, 20);
    assert_true(!r.verified && r.finished && strstr(r.reason, "away from the goal") != NULL);
    assert_true(fabs(r.failed_low[0] - 0.4) < 0.2 && fabs(r.failed_low[1] - 0.4) < 0.2);
}

TEST(
    "an error of the model is allowed for: a small one leaves a set about the goal, a large one is refused") {
    lg_certify_spec spec = spec_for(loop_program(2, damped, NULL, NULL), P, low, high);
    const double small[2] = {0, 0.05}, large[2] = {0, 0.5};
    spec.model_error = small;
    spec.eps = 0.2;
    spec.level = 0.8;
    const lg_certify_result r = prove(&spec, 20);
    assert_true(r.verified && !r.converges && strstr(r.claim, "may err by up to (0, 0.05)") != NULL);
    spec.model_error = large;
    const lg_certify_result bad = prove(&spec, 20);
    assert_true(!bad.verified && bad.finished);
    spec.model_error = small;
    spec.eps = 1e-3; /* the error moves states that are so close */
    assert_true(!prove(&spec, 20).verified);
    spec.eps = 0;
    const lg_certify_result found = prove(&spec, 20);
    assert_true(found.verified && !found.converges && found.eps > 1e-3 && found.eps < 0.05);
}

/* A step of Euler's method of length h */
RECORDING(euler) {
    lg_var rate;
    (void)damped(NULL, tape, theta, x, &rate);
    y[0] = lg_add(tape, x[0], lg_scale(tape, rate, *(const double *)user));
}

TEST("steps are proved of V(F(x)) - V(x), and steps that are too long are refused") {
    double h = 0.1;
    lg_certify_spec spec = spec_for(loop_program(2, euler, NULL, &h), P, low, high);
    spec.step = true;
    const lg_certify_result r = prove(&spec, 20);
    assert_true(r.verified && r.converges && strstr(r.claim, "every step") != NULL);
    const double errors[2][2] = {{1e-4, 1e-4}, {1e-4, 2e-4}};
    static const char *const says[2] = {"the next state may err by up to 0.0001 per component",
                                        "the next state may err by up to (0.0001, 0.0002)"};
    for (int i = 0; i < 2; i++) {
        spec.model_error = errors[i];
        const lg_certify_result about = prove(&spec, 20);
        assert_true(about.verified && !about.converges && about.eps < 0.1 * r.level);
        assert_says(about.claim, says[i]);
    }
    double too_long = 2.5;
    lg_certify_spec bad = spec_for(loop_program(2, euler, NULL, &too_long), P, low, high);
    bad.step = true;
    assert_true(!prove(&bad, 20).verified);
}

TEST("a proof in portions, and by several threads, ends as in one run") {
    lg_certify_spec spec = spec_of_v(energy);
    const lg_certify_result whole = prove(&spec, 20);
    lg_certify_result part = {.finished = false};
    spec.threads = 3;
    lg_certify *certify = test_certify(&spec);
    size_t runs = 0;
    for (; !part.finished; runs++) assert_ok(lg_certify_run(certify, 1, 20, &part, NULL));
    assert_true(runs > 3 && part.verified);
    assert_true(part.level == whole.level && part.eps == whole.eps && part.boxes == whole.boxes);
    assert_true(part.volume == whole.volume);
}

/* x1' = x2, x2' = sin x1 + u; u = -3 x1 - 3 x2 + a network of 2-16-16-1, weights as at the start of a
 * training */
typedef struct policy {
    lg_mlp net;
    double *theta;
} policy;

RECORDING(network_loop) {
    const policy *p = user;
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var weights = lg_input_f64(tape, lg_shape1((uint32_t)lg_mlp_parameters(&p->net)), p->theta);
    const lg_var net = lg_mlp_record(tape, &p->net, weights, 0, x[0]);
    const lg_var line = lg_scale(tape, lg_add(tape, a, b), -3),
                 u = saturated(tape, lg_add(tape, line, net), 5);
    const lg_var parts[2] = {b, lg_add(tape, lg_sin(tape, a), u)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

TEST("a network as policy is proved") {
    policy p;
    lg_rng rng = test_rng(37, 5);
    assert_ok(lg_mlp_init(&p.net, 2, (const uint32_t[]){16, 16}, 2, 1, LG_TANH, true));
    p.theta = TEST_ARRAY(double, lg_mlp_parameters(&p.net));
    lg_mlp_initialise(&p.net, &rng, p.theta);
    const double form_of_loop[4] = {4, 1, 1, 1};
    lg_certify_spec spec = spec_for(loop_program(2, network_loop, NULL, &p), form_of_loop, low, high);
    spec.level = 0.5;
    spec.eps = 0.05;
    const lg_certify_result r = prove(&spec, 20);
    assert_true(r.verified);
}

/* x1' = -x1 or -3 x1, x2' = -x2: V falls on both sides of the jump at x1 = .3. */
RECORDING(switched) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var faster = lg_add_scalar(tape, lg_sign(tape, lg_add_scalar(tape, a, -0.3)), 2);
    const lg_var parts[2] = {lg_neg(tape, lg_mul(tape, a, faster)), lg_neg(tape, b)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

RECORDING(with_a_jump) {
    y[0] = lg_add(tape, form(tape, x[0]), lg_scale(tape, lg_sign(tape, column(tape, x[0], 0)), 0.01));
}

TEST("a proof fails if V jumps, even where its gradient does not, and if the loop jumps") {
    const lg_certify_spec spec = spec_of_v(with_a_jump);
    const lg_certify_result r = prove(&spec, 20);
    assert_true(r.finished && !r.verified && r.failed_low[0] <= 0 && r.failed_high[0] >= 0);
    assert_says(r.reason, "V or its gradient may jump");
    lg_certify_spec loop = spec_for(loop_program(2, switched, NULL, NULL), P, low, high);
    loop.level = 0.5;
    const lg_certify_result s = prove(&loop, 20);
    assert_true(s.finished && !s.verified && s.failed_low[0] < 0.31 && s.failed_high[0] > 0.29);
    assert_says(s.reason, "may jump");
}

TEST("lg_certify_create rejects boxes without the goal and forms that are not definite") {
    lg_certify *certify = NULL;
    lg_error error;
    lg_certify_spec spec = spec_for(loop_program(2, damped, NULL, NULL), P, high, high);
    assert_int_equal(lg_certify_create(NULL, &spec, &certify, &error), LG_INVALID_ARGUMENT);
    const double saddle[4] = {1, 0, 0, -1};
    spec = spec_for(spec.program, saddle, low, high);
    assert_int_equal(lg_certify_create(NULL, &spec, &certify, &error), LG_INVALID_ARGUMENT);
    assert_string_equal(error.message, "P is not positive definite");
}

/* One number for each row */
RECORDING(with_a_sum) {
    y[0] = lg_sum_axis(tape, lg_square(tape, x[0]), 1, true);
}

TEST("numbers of a certificate that are out of range are refused") {
    lg_certify *certify = NULL;
    lg_error error;
    const double no_bound[2] = {-1, 0}, goal[2] = {0.1, 0}, beyond[2] = {0, 2}, endless[2] = {INFINITY, 1};
    const double nowhere[2][2] = {{-INFINITY, -INFINITY}, {INFINITY, INFINITY}};
    const lg_certify_spec good = spec_for(loop_program(2, damped, quadratic, NULL), P, low, high);
#define REFUSED(word, ...)                                                                                   \
    do {                                                                                                     \
        lg_certify_spec s = good;                                                                            \
        __VA_ARGS__;                                                                                         \
        assert_int_equal(lg_certify_create(NULL, &s, &certify, &error), LG_INVALID_ARGUMENT);                \
        assert_says(error.message, word);                                                                    \
    } while (0)
    REFUSED("size of the struct", s.size = 3);
    REFUSED("not both", s.lyapunov = "v");
    REFUSED("not both", s.P = NULL);
    REFUSED("level and eps", s.level = -1);
    REFUSED("level and eps", s.level = INFINITY);
    REFUSED("level and eps", s.eps = -1);
    REFUSED("level and eps", s.eps = NAN);
    REFUSED("level and eps", s.most = -1);
    REFUSED("level and eps", s.resolution = 0);
    REFUSED("level and eps", s.resolution = 0.75);
    REFUSED("level and eps", s.threads = 0);
    REFUSED("level and eps", (s.level = 1, s.eps = 1));
    REFUSED("does not hold the goal", s.goal = beyond);
    REFUSED("must be finite", (s.P = NULL, s.lyapunov = "v", s.high = endless));
    REFUSED("unbounded in all states", (s.low = nowhere[0], s.high = nowhere[1]));
    REFUSED("is no bound", s.model_error = no_bound);
    REFUSED("is no bound", s.model_error = endless);
#undef REFUSED
    lg_certify_spec stepping = good;
    stepping.P = NULL, stepping.lyapunov = "v", stepping.step = true;
    assert_int_equal(lg_certify_create(NULL, &stepping, &certify, &error), LG_UNSUPPORTED);
    assert_says(error.message, "steps need a quadratic V");
    lg_certify_spec shifted = good;
    shifted.goal = goal; /* no equilibrium: motions cannot converge to it */
    shifted.level = 0.3;
    assert_false(prove(&shifted, 5).converges);
    lg_certify_spec_init(NULL);
    lg_certify_destroy(NULL);
}

TEST("a rate or a V of another size is refused with the function's name") {
    lg_certify *certify = NULL;
    lg_error error;
    const lg_port x = {.name = "x", .shape = lg_shape1(2)}, three = {.name = "x", .shape = lg_shape1(3)},
                  square = {.name = "x", .shape = lg_shape2(2, 2)}, out = {.name = "y"},
                  shared = {.name = "x", .shape = lg_shape2(1, 2), .shared = true},
                  large = {.name = "x", .shape = lg_shape1(LG_CERTIFY_STATES + 1)};
    const lg_port pair[2] = {x, {.name = "z", .shape = lg_shape1(2)}};
    const struct {
        const lg_port *in;
        size_t inputs;
        lg_record_function record;
    } v[] = {{&x, 1, damped},
             {&three, 1, with_a_sum},
             {&square, 1, with_a_sum},
             {&shared, 1, with_a_sum},
             {pair, 2, with_a_sum}},
      loop[] = {{&large, 1, with_a_sum},
                {&square, 1, with_a_sum},
                {&shared, 1, with_a_sum},
                {pair, 2, damped},
                {&x, 1, with_a_sum}};
    double from[LG_CERTIFY_STATES + 1], to[LG_CERTIFY_STATES + 1];
    for (size_t i = 0; i <= LG_CERTIFY_STATES; i++) {
        from[i] = -1;
        to[i] = 1;
    }
    for (size_t i = 0; i < LG_COUNT(v) + LG_COUNT(loop); i++) {
        const bool of_v = i < LG_COUNT(v);
        const size_t k = of_v ? i : i - LG_COUNT(v);
        const lg_function_spec functions[2] = {
            of_v ? (lg_function_spec){"loop", &x, 1, &out, 1, damped, NULL}
                 : (lg_function_spec){"loop", loop[k].in, loop[k].inputs, &out, 1, loop[k].record, NULL},
            of_v ? (lg_function_spec){"v", v[k].in, v[k].inputs, &out, 1, v[k].record, NULL}
                 : (lg_function_spec){"v", &x, 1, &out, 1, quadratic, NULL}};
        const lg_program_spec whole = spec_of(NULL, 0, functions, 2);
        lg_certify_spec spec = spec_for(test_program(&whole), NULL, from, to);
        spec.lyapunov = "v";
        assert_int_equal(lg_certify_create(NULL, &spec, &certify, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, of_v ? "'v'" : "'loop'");
    }
}

TEST("a proof without time examines nothing, and one that is cancelled is reported") {
    lg_certify_spec spec = spec_for(loop_program(2, damped, NULL, NULL), P, low, high);
    volatile int cancel = 0;
    lg_context_options options;
    lg_context *context;
    lg_certify *certify;
    lg_certify_result result;
    lg_error error;
    lg_context_options_init(&options);
    options.cancel = &cancel;
    assert_ok(lg_context_create(&options, &context));
    lg_test_owns(context, release_context);
    assert_ok(lg_certify_create(context, &spec, &certify, &error));
    lg_test_owns(certify, release_certify);
    assert_ok(lg_certify_run(certify, 100, 0, &result, &error));
    assert_true(!result.finished && result.boxes == 0);
    cancel = 1;
    assert_status(lg_certify_run(certify, 100, 10, &result, &error), LG_CANCELLED);
    cancel = 0;
    assert_ok(lg_certify_run(certify, 1, 10, &result, &error));
    assert_ok(lg_certify_run(certify, SIZE_MAX, 20, &result, &error));
    assert_true(result.finished && result.verified);
}

TEST("matrices of an attitude that are not finite or not symmetric are refused") {
    double A[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    lg_certify_attitude_result result;
    assert_ok(lg_certify_attitude(A, 1, &result, NULL));
    A[4] = NAN;
    assert_status(lg_certify_attitude(A, 1, &result, NULL), LG_NOT_FINITE);
    A[4] = 1, A[1] = 0.5;
    assert_status(lg_certify_attitude(A, 1, &result, NULL), LG_INVALID_ARGUMENT);
}

static lg_status create_and_run(const lg_context *context, const lg_certify_spec *spec) {
    lg_certify *certify = NULL;
    lg_certify_result result;
    lg_status status = lg_certify_create(context, spec, &certify, NULL);
    if (status == LG_OK) status = lg_certify_run(certify, 3000, 20, &result, NULL);
    lg_certify_destroy(certify);
    return status;
}

/* A saddle: V = x^2 + y^2 rises where x y > 0. */
RECORDING(saddle) {
    const lg_var parts[2] = {column(tape, x[0], 1), column(tape, x[0], 0)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

RECORDING(round_bowl) {
    y[0] = lg_rowdot(tape, x[0], x[0]);
}

TEST("after an allocation that fails nothing is proved, whatever is run later") {
    lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    lg_certify_spec spec = spec_for(loop_program(2, saddle, round_bowl, NULL), NULL, low, high);
    spec.lyapunov = "v", spec.level = 0.9, spec.eps = 0.1;
    size_t failed = 0;
    for (long n = 1; n < 20; n++) {
        lg_certify *certify;
        lg_certify_result result = {.verified = true};
        lg_fail_alloc_arm(&memory, 0);
        assert_ok(lg_certify_create(context, &spec, &certify, NULL));
        lg_fail_alloc_arm(&memory, n);
        const lg_status status = lg_certify_run(certify, SIZE_MAX, 20, &result, NULL);
        if (status != LG_OK) {
            assert_int_equal(status, LG_OUT_OF_MEMORY);
            assert_ok(lg_certify_run(certify, SIZE_MAX, 20, &result, NULL));
            assert_says(result.reason, "no memory");
            failed++;
        }
        assert_true(result.finished && !result.verified && strncmp(result.claim, "Not proved", 10) == 0);
        lg_certify_destroy(certify);
    }
    assert_true(failed >= 2);
    lg_context_destroy(context);
}

TEST("a proof needs the rounding to nearest") {
    const lg_certify_spec spec = spec_for(loop_program(2, damped, NULL, NULL), P, low, high);
    lg_certify *certify = test_certify(&spec), *none;
    lg_certify_result result;
    assert_int_equal(fesetround(FE_UPWARD), 0);
    const lg_status run = lg_certify_run(certify, 1, 10, &result, NULL),
                    create = lg_certify_create(NULL, &spec, &none, NULL);
    (void)fesetround(FE_TONEAREST);
    assert_int_equal(run, LG_UNSUPPORTED);
    assert_int_equal(create, LG_UNSUPPORTED);
    assert_ok(lg_certify_run(certify, SIZE_MAX, 20, &result, NULL));
    assert_true(result.verified);
}

TEST("an allocation that fails is reported, and nothing leaks") {
    lg_fail_alloc memory;
    lg_context *context = lg_fail_alloc_context(&memory);
    lg_certify_spec spec = spec_of_v(energy);
    long n = 1;
    for (;; n += 1 + n / 20) {
        lg_fail_alloc_arm(&memory, n);
        const lg_status status = create_and_run(context, &spec);
        if (!lg_fail_alloc_hit(&memory)) break;
        assert_int_equal(status, LG_OUT_OF_MEMORY);
        assert_int_equal(lg_fail_alloc_live(&memory), 0);
    }
    assert_true(n > 50);
    lg_context_destroy(context);
}

/* Multilayer perceptrons: description, initialisation, evaluation without a tape against plain loops and
 * difference quotients, the tape against evaluation, products with the Hessian against the tape. */
#include "nn_support.h"
#include "liegrad/ops.h"

#define ROWS 5

static const uint32_t hidden[2] = {7, 4};

static double activation(lg_activation kind, double x) {
    const double s = 1.0 / (1.0 + exp(-x));
    switch (kind) {
    case LG_TANH:
        return tanh(x);
    case LG_SIGMOID:
        return s;
    case LG_SWISH:
        return x * s;
    case LG_RELU:
        return x > 0.0 ? x : 0.0;
    case LG_LEAKY_RELU:
        return x > 0.0 ? x : 0.01 * x;
    case LG_SINE:
        return sin(x);
    case LG_IDENTITY:
        break;
    }
    return x;
}

/* The definition, one number at a time. */
static void naive(const lg_mlp *net, const double *theta, const double *x, double *y) {
    double a[16], b[16];
    memcpy(a, x, net->width[0] * sizeof *a);
    for (uint32_t l = 0; l < net->layers; l++) {
        const bool last = l + 1 == net->layers;
        const uint32_t in = net->width[l], out = net->width[l + 1];
        for (uint32_t j = 0; j < out; j++) {
            double sum = 0.0;
            for (uint32_t i = 0; i < in; i++) sum += a[i] * theta[i * out + j];
            if (!last || net->last_bias) sum += theta[in * out + j];
            b[j] = last ? sum : activation(net->activation, sum);
        }
        theta += in * out + (!last || net->last_bias ? out : 0);
        memcpy(a, b, out * sizeof *a);
    }
    memcpy(y, a, net->width[net->layers] * sizeof *y);
}

typedef struct fixture {
    lg_mlp net;
    double *theta;
    double x[ROWS * 3], direction[ROWS * 3], cotangent[ROWS * 2];
    void *work;
    size_t bytes;
} fixture;

#define CANARY 64

static void setup(fixture *f, lg_activation kind, bool last_bias, uint32_t hidden_layers) {
    lg_rng rng;
    lg_rng_seed(&rng, 11, (uint64_t)kind);
    assert_ok(lg_mlp_init(&f->net, 3, hidden, hidden_layers, 2, kind, last_bias));
    f->theta = malloc(lg_mlp_parameters(&f->net) * sizeof(double));
    assert_non_null(f->theta);
    lg_mlp_initialise(&f->net, &rng, f->theta);
    for (int i = 0; i < ROWS * 3; i++) f->x[i] = lg_rng_normal(&rng);
    for (int i = 0; i < ROWS * 3; i++) f->direction[i] = lg_rng_normal(&rng);
    for (int i = 0; i < ROWS * 2; i++) f->cotangent[i] = lg_rng_normal(&rng);
    f->bytes = lg_mlp_work_size(&f->net, ROWS, LG_F64);
    f->work = aligned_alloc(64, (f->bytes + 63) / 64 * 64 + CANARY);
    assert_non_null(f->work);
    memset(f->work, 0x5a, f->bytes + CANARY);
}

static void teardown(fixture *f) {
    for (size_t i = 0; i < CANARY; i++) assert_int_equal(((unsigned char *)f->work)[f->bytes + i], 0x5a);
    free(f->work);
    free(f->theta);
}

static void test_description(void **state) {
    (void)state;
    lg_mlp net;
    assert_ok(lg_mlp_init(&net, 3, hidden, 2, 2, LG_TANH, false));
    assert_int_equal(lg_mlp_parameters(&net), 3 * 7 + 7 + 7 * 4 + 4 + 4 * 2);
    assert_int_equal(lg_mlp_weight_offset(&net, 0), 0);
    assert_int_equal(lg_mlp_bias_offset(&net, 0), 21);
    assert_int_equal(lg_mlp_weight_offset(&net, 1), 28);
    assert_int_equal(lg_mlp_weight_offset(&net, 2), 60);
    assert_int_equal(lg_mlp_bias_offset(&net, 2), 68);
    assert_true(lg_mlp_has_bias(&net, 1));
    assert_false(lg_mlp_has_bias(&net, 2));
    assert_ok(lg_mlp_init(&net, 3, NULL, 0, 1, LG_TANH, true));
    assert_int_equal(lg_mlp_parameters(&net), 4);
}

static void test_bad_descriptions(void **state) {
    (void)state;
    const uint32_t zero[1] = {0}, huge[1] = {UINT32_MAX}, many[LG_MLP_MAX_LAYERS] = {1};
    lg_mlp net, before;
    assert_ok(lg_mlp_init(&net, 3, hidden, 2, 2, LG_TANH, false));
    memcpy(&before, &net, sizeof net);
    assert_status(lg_mlp_init(NULL, 3, hidden, 2, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 0, hidden, 2, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, hidden, 2, 0, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, zero, 1, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, huge, 1, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, NULL, 1, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, many, LG_MLP_MAX_LAYERS, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, hidden, 2, 2, (lg_activation)LG_ACTIVATION_COUNT, true),
                  LG_INVALID_ARGUMENT);
    assert_memory_equal(&net, &before, sizeof net);
}

/* Bounds, second moments (variance of U(+-a) is a^2/3) and biases of each law, on a layer of 80 x 100. */
static void test_initialisation(void **state) {
    (void)state;
    const uint32_t wide[1] = {100};
    const struct {
        const char *name;
        double variance, bound; /* bound 0: none */
        bool bias;
    } expected[LG_INITIALISATION_COUNT] = {
        {"fan-in", 1.0 / 240.0, sqrt(1.0 / 80.0), true},
        {"glorot-uniform", 2.0 / 180.0, sqrt(6.0 / 180.0), false},
        {"glorot-normal", 2.0 / 180.0, 0.0, false},
        {"he-uniform", 2.0 / 80.0, sqrt(6.0 / 80.0), false},
        {"he-normal", 2.0 / 80.0, 0.0, false},
    };
    lg_mlp net;
    assert_ok(lg_mlp_init(&net, 80, wide, 1, 1, LG_TANH, true));
    double *theta = malloc(lg_mlp_parameters(&net) * sizeof *theta);
    assert_non_null(theta);
    for (int kind = 0; kind < LG_INITIALISATION_COUNT; kind++) {
        lg_initialisation parsed;
        assert_ok(lg_initialisation_parse(expected[kind].name, &parsed));
        assert_int_equal(parsed, kind);
        assert_string_equal(lg_initialisation_name(parsed), expected[kind].name);
        lg_rng rng;
        lg_rng_seed(&rng, 5, 0);
        memset(theta, 0xff, lg_mlp_parameters(&net) * sizeof *theta);
        lg_mlp_initialise_as(&net, parsed, &rng, theta);
        double second = 0.0, largest = 0.0, biases = 0.0;
        for (size_t i = 0; i < 8000; i++) {
            second += theta[i] * theta[i] / 8000.0;
            largest = fmax(largest, fabs(theta[i]));
        }
        for (size_t i = 8000; i < 8100; i++) biases = fmax(biases, fabs(theta[i]));
        assert_close(second, expected[kind].variance, 0.08, 0.0);
        if (expected[kind].bound > 0.0) assert_true(largest <= expected[kind].bound);
        assert_int_equal(biases > 0.0, expected[kind].bias);
        for (size_t i = 0; i < lg_mlp_parameters(&net); i++) assert_true(isfinite(theta[i]));
    }
    free(theta);
    lg_initialisation untouched = LG_INIT_HE_NORMAL;
    assert_status(lg_initialisation_parse("xavier", &untouched), LG_NOT_FOUND);
    assert_int_equal(untouched, LG_INIT_HE_NORMAL);
}

static void check_eval(lg_activation kind, bool last_bias, uint32_t hidden_layers) {
    fixture f;
    setup(&f, kind, last_bias, hidden_layers);
    double y[ROWS * 2], expected[2], single[2];
    lg_mlp_eval(&f.net, LG_F64, f.theta, f.x, ROWS, y, f.work);
    for (int r = 0; r < ROWS; r++) {
        naive(&f.net, f.theta, f.x + 3 * r, expected);
        for (int o = 0; o < 2; o++) assert_close(y[2 * r + o], expected[o], 1e-13, 1e-14);
        lg_mlp_eval(&f.net, LG_F64, f.theta, f.x + 3 * r, 1, single, f.work);
        assert_memory_equal(single, y + 2 * r, sizeof single);
    }
    teardown(&f);
}

static void test_eval(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++)
        for (uint32_t layers = 0; layers <= 2; layers++)
            for (int bias = 0; bias < 2; bias++) check_eval((lg_activation)kind, bias == 1, layers);
}

/* Central differences of the plain loops; h = 1e-5 leaves about 1e-10. */
static double quotient(const fixture *f, int row, const double *direction, int output) {
    const double h = 1e-5;
    double plus[3], minus[3], yp[2], ym[2];
    for (int i = 0; i < 3; i++) {
        plus[i] = f->x[3 * row + i] + h * direction[i];
        minus[i] = f->x[3 * row + i] - h * direction[i];
    }
    naive(&f->net, f->theta, plus, yp);
    naive(&f->net, f->theta, minus, ym);
    return (yp[output] - ym[output]) / (2.0 * h);
}

static void check_derivatives(lg_activation kind, size_t rows, uint32_t hidden_layers) {
    fixture f;
    setup(&f, kind, true, hidden_layers);
    double y[ROWS * 2], value[ROWS * 2], dy[ROWS * 2], gradient[ROWS * 3], ones[ROWS * 3];
    lg_mlp_eval(&f.net, LG_F64, f.theta, f.x, rows, y, f.work);
    lg_mlp_input_gradient(&f.net, LG_F64, f.theta, f.x, rows, f.cotangent, value, gradient, f.work);
    for (size_t i = 0; i < 2 * rows; i++) assert_close(value[i], y[i], 1e-14, 1e-15);
    lg_mlp_jvp(&f.net, LG_F64, f.theta, f.x, f.direction, rows, value, dy, f.work);
    for (size_t i = 0; i < 2 * rows; i++) assert_close(value[i], y[i], 1e-14, 1e-15);
    lg_mlp_input_gradient(&f.net, LG_F64, f.theta, f.x, rows, NULL, NULL, ones, f.work);
    for (int r = 0; r < (int)rows; r++) {
        double forward = 0.0, reverse = 0.0;
        for (int i = 0; i < 3; i++) {
            const double unit[3] = {i == 0, i == 1, i == 2};
            const double d0 = quotient(&f, r, unit, 0), d1 = quotient(&f, r, unit, 1);
            const double expected = f.cotangent[2 * r] * d0 + f.cotangent[2 * r + 1] * d1;
            assert_close(gradient[3 * r + i], expected, 1e-7, 1e-9);
            assert_close(ones[3 * r + i], d0 + d1, 1e-7, 1e-9);
            reverse += gradient[3 * r + i] * f.direction[3 * r + i];
        }
        for (int o = 0; o < 2; o++) {
            assert_close(dy[2 * r + o], quotient(&f, r, f.direction + 3 * r, o), 1e-7, 1e-9);
            forward += dy[2 * r + o] * f.cotangent[2 * r + o];
        }
        assert_close(forward, reverse, 1e-12, 1e-14);
    }
    teardown(&f);
}

static void test_derivatives(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++)
        for (uint32_t layers = 0; layers <= 2; layers++) {
            check_derivatives((lg_activation)kind, 1, layers);
            check_derivatives((lg_activation)kind, ROWS, layers);
        }
}

/* One output, as a potential has it: its own way through the last layer, whatever the memory held before. */
static void test_single_output(void **state) {
    (void)state;
    for (uint32_t layers = 0; layers <= 2; layers++)
        for (size_t rows = 1; rows <= ROWS; rows += ROWS - 1) {
            fixture f;
            setup(&f, LG_TANH, true, layers);
            assert_ok(lg_mlp_init(&f.net, 3, hidden, layers, 1, LG_TANH, false));
            double gradient[ROWS * 3], dy[ROWS];
            assert_true(lg_mlp_work_size(&f.net, rows, LG_F64) <= f.bytes);
            memset(f.work, 0x41, f.bytes); /* 2261634.5... */
            lg_mlp_input_gradient(&f.net, LG_F64, f.theta, f.x, rows, NULL, NULL, gradient, f.work);
            memset(f.work, 0x41, f.bytes);
            lg_mlp_jvp(&f.net, LG_F64, f.theta, f.x, f.direction, rows, NULL, dy, f.work);
            for (int r = 0; r < (int)rows; r++) {
                for (int i = 0; i < 3; i++) {
                    const double unit[3] = {i == 0, i == 1, i == 2};
                    assert_close(gradient[3 * r + i], quotient(&f, r, unit, 0), 1e-7, 1e-9);
                }
                assert_close(dy[r], quotient(&f, r, f.direction + 3 * r, 0), 1e-7, 1e-9);
            }
            teardown(&f);
        }
}

static void to_float(size_t n, const double *x, float *y) {
    for (size_t i = 0; i < n; i++) y[i] = (float)x[i];
}

static void test_single_precision(void **state) {
    (void)state;
    fixture f;
    setup(&f, LG_SWISH, true, 2);
    const size_t n = lg_mlp_parameters(&f.net);
    float *theta = malloc(n * sizeof *theta);
    assert_non_null(theta);
    float x[ROWS * 3], direction[ROWS * 3], cotangent[ROWS * 2], y[ROWS * 2], dy[ROWS * 2],
        gradient[ROWS * 3];
    double y64[ROWS * 2], dy64[ROWS * 2], gradient64[ROWS * 3];
    to_float(n, f.theta, theta);
    to_float(ROWS * 3, f.x, x);
    to_float(ROWS * 3, f.direction, direction);
    to_float(ROWS * 2, f.cotangent, cotangent);
    assert_true(lg_mlp_work_size(&f.net, ROWS, LG_F32) <= f.bytes);
    for (size_t rows = 1; rows <= ROWS; rows += ROWS - 1) {
        lg_mlp_jvp(&f.net, LG_F64, f.theta, f.x, f.direction, rows, y64, dy64, f.work);
        lg_mlp_input_gradient(&f.net, LG_F64, f.theta, f.x, rows, f.cotangent, NULL, gradient64, f.work);
        lg_mlp_jvp(&f.net, LG_F32, theta, x, direction, rows, y, dy, f.work);
        lg_mlp_input_gradient(&f.net, LG_F32, theta, x, rows, cotangent, NULL, gradient, f.work);
        for (size_t i = 0; i < 2 * rows; i++) assert_close(y[i], y64[i], 1e-5, 1e-6);
        for (size_t i = 0; i < 2 * rows; i++) assert_close(dy[i], dy64[i], 1e-5, 1e-6);
        for (size_t i = 0; i < 3 * rows; i++) assert_close(gradient[i], gradient64[i], 1e-5, 1e-6);
    }
    free(theta);
    teardown(&f);
}

/* The tape against evaluation: value, gradient of the first output, at an offset in a longer vector. */
static void test_taped(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++) {
        fixture f;
        setup(&f, (lg_activation)kind, kind % 2 == 0, 2);
        const size_t n = lg_mlp_parameters(&f.net), offset = 3;
        double *longer = malloc((n + offset) * sizeof *longer);
        assert_non_null(longer);
        memcpy(longer + offset, f.theta, n * sizeof *longer);
        longer[0] = longer[1] = longer[2] = 1e6;
        lg_tape *tape = NULL;
        assert_ok(lg_tape_create(NULL, NULL, &tape));
        const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)(n + offset)), longer);
        const lg_var x = lg_input(tape, lg_shape2(ROWS, 3), f.x);
        lg_mlp_vars vars;
        assert_ok(lg_mlp_bind(tape, &f.net, theta, offset, &vars));
        double y[ROWS * 2], gradient[ROWS * 3], first[ROWS * 2], expected[ROWS * 2], slope[ROWS * 3];
        assert_ok(lg_read(tape, lg_mlp_record(tape, &f.net, theta, offset, x), y, ROWS * 2));
        assert_ok(lg_read(tape, lg_mlp_record_gradient(tape, &f.net, &vars, x), gradient, ROWS * 3));
        for (int r = 0; r < ROWS; r++) {
            first[2 * r] = 1.0;
            first[2 * r + 1] = 0.0;
        }
        lg_mlp_input_gradient(&f.net, LG_F64, f.theta, f.x, ROWS, first, expected, slope, f.work);
        for (int i = 0; i < ROWS * 2; i++) assert_close(y[i], expected[i], 1e-13, 1e-14);
        for (int i = 0; i < ROWS * 3; i++) assert_close(gradient[i], slope[i], 1e-12, 1e-14);
        lg_tape_destroy(tape);
        free(longer);
        teardown(&f);
    }
}

/* d/dtheta of sum |dV/dx|^2, the shape of a Hamiltonian's training loss, against difference quotients. */
static double squared_gradient(const fixture *f, const double *theta) {
    double first[ROWS * 2], gradient[ROWS * 3], sum = 0.0;
    for (int i = 0; i < ROWS * 2; i++) first[i] = i % 2 == 0 ? 1.0 : 0.0;
    lg_mlp_input_gradient(&f->net, LG_F64, theta, f->x, ROWS, first, NULL, gradient, f->work);
    for (int i = 0; i < ROWS * 3; i++) sum += gradient[i] * gradient[i];
    return sum;
}

static void test_gradient_of_gradient(void **state) {
    (void)state;
    fixture f;
    setup(&f, LG_TANH, true, 2);
    const size_t n = lg_mlp_parameters(&f.net);
    double *gradient = calloc(n, sizeof *gradient);
    assert_non_null(gradient);
    lg_tape *tape = NULL;
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)n), f.theta);
    lg_mlp_vars vars;
    assert_ok(lg_mlp_bind(tape, &f.net, theta, 0, &vars));
    const lg_var slope = lg_mlp_record_gradient(tape, &f.net, &vars, lg_input(tape, lg_shape2(ROWS, 3), f.x));
    void *out = gradient;
    assert_ok(lg_backward(tape, lg_sum(tape, lg_square(tape, slope)), &theta, 1, &out));
    for (size_t i = 0; i < n; i++) {
        const double kept = f.theta[i], h = 1e-5;
        f.theta[i] = kept + h;
        const double plus = squared_gradient(&f, f.theta);
        f.theta[i] = kept - h;
        const double minus = squared_gradient(&f, f.theta);
        f.theta[i] = kept;
        assert_close(gradient[i], (plus - minus) / (2.0 * h), 1e-7, 1e-9);
    }
    lg_tape_destroy(tape);
    free(gradient);
    teardown(&f);
}

static void test_short_theta(void **state) {
    (void)state;
    fixture f;
    setup(&f, LG_TANH, true, 2);
    const size_t n = lg_mlp_parameters(&f.net);
    lg_tape *tape = NULL;
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)n - 1), f.theta);
    lg_mlp_vars vars;
    assert_int_not_equal(lg_mlp_bind(tape, &f.net, theta, 0, &vars), LG_OK);
    assert_int_not_equal(lg_tape_status(tape), LG_OK);
    lg_tape_reset(tape);
    const lg_var good = lg_parameter(tape, lg_shape1((uint32_t)n), f.theta);
    assert_true(lg_is_none(lg_mlp_record(tape, &f.net, good, SIZE_MAX, good)));
    assert_status(lg_tape_status(tape), LG_SHAPE);
    lg_tape_reset(tape);
    const lg_var again = lg_parameter(tape, lg_shape1((uint32_t)n), f.theta);
    const lg_var wrong = lg_input(tape, lg_shape2(1, 2), f.x);
    assert_true(lg_is_none(lg_mlp_record(tape, &f.net, again, 0, wrong)));
    assert_status(lg_tape_status(tape), LG_SHAPE);
    lg_tape_destroy(tape);
    teardown(&f);
}

/* ---- products with the Hessian ---- */

enum { INPUTS = 3, CURVED_HIDDEN = 3 };
static const uint32_t curved_hidden[CURVED_HIDDEN] = {7, 4, 6};

typedef struct curved {
    lg_mlp net;
    double *theta;
    double x[ROWS * INPUTS], direction[ROWS * INPUTS];
    double gradient[ROWS * INPUTS], dgradient[ROWS * INPUTS]; /* by the tape */
} curved;

/* The gradient of the sum of outputs, and its derivative along the direction: lg_jvp of lg_grad. */
static void curved_on_tape(curved *c) {
    lg_tape *tape = NULL;
    lg_var g, dg;
    assert_ok(lg_tape_create(NULL, NULL, &tape));
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)lg_mlp_parameters(&c->net)), c->theta);
    const lg_var x = lg_input(tape, lg_shape2(ROWS, INPUTS), c->x);
    const lg_var direction = lg_input(tape, lg_shape2(ROWS, INPUTS), c->direction);
    const lg_var y = lg_sum(tape, lg_mlp_record(tape, &c->net, theta, 0, x));
    assert_ok(lg_grad(tape, y, &x, 1, &g));
    assert_ok(lg_jvp(tape, &g, 1, &x, &direction, 1, &dg));
    assert_ok(lg_read(tape, g, c->gradient, ROWS * INPUTS));
    assert_ok(lg_read(tape, dg, c->dgradient, ROWS * INPUTS));
    lg_tape_destroy(tape);
}

static void curved_setup(curved *c, lg_activation kind, uint32_t depth, uint32_t outputs) {
    lg_rng rng;
    lg_rng_seed(&rng, 17, (uint64_t)kind);
    assert_ok(lg_mlp_init(&c->net, INPUTS, curved_hidden, depth, outputs, kind, outputs > 1));
    c->theta = malloc(lg_mlp_parameters(&c->net) * sizeof(double));
    assert_non_null(c->theta);
    for (size_t i = 0; i < lg_mlp_parameters(&c->net); i++) c->theta[i] = lg_rng_normal(&rng);
    for (int i = 0; i < ROWS * INPUTS; i++) c->x[i] = lg_rng_normal(&rng);
    for (int i = 0; i < ROWS * INPUTS; i++) c->direction[i] = lg_rng_normal(&rng);
    curved_on_tape(c);
}

/* In memory that holds something else, and behind which nothing is written. */
static void product(const curved *c, lg_dtype dtype, const void *theta, const void *x, const void *direction,
                    size_t rows, void *y, void *gradient, void *dgradient) {
    const size_t bytes = lg_mlp_hessian_work_size(&c->net, rows, dtype);
    unsigned char *work = aligned_alloc(64, (bytes + 63) / 64 * 64 + CANARY);
    assert_non_null(work);
    memset(work, 0x41, bytes + CANARY);
    lg_mlp_hessian_vector(&c->net, dtype, theta, x, direction, rows, y, gradient, dgradient, work);
    for (size_t i = 0; i < CANARY; i++) assert_int_equal(work[bytes + i], 0x41);
    free(work);
}

static double largest_of(const double *x, size_t n) {
    double largest = 0.0;
    for (size_t i = 0; i < n; i++) largest = fmax(largest, fabs(x[i]));
    return largest;
}

static void check_product(const curved *c, size_t rows) {
    const size_t n = rows * INPUTS, outputs = lg_mlp_outputs(&c->net);
    double y[ROWS * 2], expected[ROWS * 2], gradient[ROWS * INPUTS], dgradient[ROWS * INPUTS],
        alone[ROWS * INPUTS];
    product(c, LG_F64, c->theta, c->x, c->direction, rows, y, gradient, dgradient);
    const double scale = largest_of(c->dgradient, n);
    for (size_t i = 0; i < n; i++) {
        assert_close(gradient[i], c->gradient[i], 1e-12, 1e-13 * largest_of(c->gradient, n));
        assert_close(dgradient[i], c->dgradient[i], 1e-12, 1e-13 * scale);
    }
    for (size_t r = 0; r < rows; r++) naive(&c->net, c->theta, c->x + INPUTS * r, expected + outputs * r);
    for (size_t i = 0; i < rows * outputs; i++) assert_close(y[i], expected[i], 1e-12, 1e-13);
    product(c, LG_F64, c->theta, c->x, c->direction, rows, NULL, NULL, alone);
    assert_memory_equal(alone, dgradient, n * sizeof *alone);
}

static void test_hessian_vector(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++)
        for (uint32_t depth = 0; depth <= CURVED_HIDDEN; depth++)
            for (uint32_t outputs = 1; outputs <= 2; outputs++) {
                curved c;
                curved_setup(&c, (lg_activation)kind, depth, outputs);
                const bool bends =
                    depth > 0 && kind != LG_IDENTITY && kind != LG_RELU && kind != LG_LEAKY_RELU;
                assert_int_equal(largest_of(c.dgradient, ROWS * INPUTS) > 0.0, bends);
                check_product(&c, 1);
                check_product(&c, ROWS);
                free(c.theta);
            }
}

/* v.H w = w.H v, of each row. */
static void test_hessian_is_symmetric(void **state) {
    (void)state;
    curved c;
    double hv[ROWS * INPUTS], hw[ROWS * INPUTS], other[ROWS * INPUTS];
    curved_setup(&c, LG_SWISH, 3, 1);
    for (int i = 0; i < ROWS * INPUTS; i++) other[i] = c.direction[(i + 4) % (ROWS * INPUTS)];
    product(&c, LG_F64, c.theta, c.x, c.direction, ROWS, NULL, NULL, hv);
    product(&c, LG_F64, c.theta, c.x, other, ROWS, NULL, NULL, hw);
    for (int r = 0; r < ROWS; r++) {
        double one = 0.0, two = 0.0;
        for (int i = INPUTS * r; i < INPUTS * (r + 1); i++) {
            one += other[i] * hv[i];
            two += c.direction[i] * hw[i];
        }
        assert_true(fabs(one) > 1e-4);
        assert_close(one, two, 1e-12, 1e-14);
    }
    free(c.theta);
}

static void test_hessian_in_single_precision(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++)
        for (uint32_t depth = 0; depth <= CURVED_HIDDEN; depth++)
            for (size_t rows = 1; rows <= ROWS; rows += ROWS - 1) {
                curved c;
                curved_setup(&c, (lg_activation)kind, depth, 1);
                const size_t parameters = lg_mlp_parameters(&c.net), n = rows * INPUTS;
                float *theta = malloc(parameters * sizeof *theta);
                assert_non_null(theta);
                float x[ROWS * INPUTS], direction[ROWS * INPUTS], gradient[ROWS * INPUTS],
                    dgradient[ROWS * INPUTS];
                to_float(parameters, c.theta, theta);
                to_float(n, c.x, x);
                to_float(n, c.direction, direction);
                product(&c, LG_F32, theta, x, direction, rows, NULL, gradient, dgradient);
                for (size_t i = 0; i < n; i++) {
                    assert_close(gradient[i], c.gradient[i], 1e-4, 1e-5 * largest_of(c.gradient, n));
                    assert_close(dgradient[i], c.dgradient[i], 1e-4, 1e-5 * largest_of(c.dgradient, n));
                }
                free(theta);
                free(c.theta);
            }
}

static void test_hessian_of_what_is_not_a_number(void **state) {
    (void)state;
    curved c;
    double dgradient[ROWS * INPUTS];
    curved_setup(&c, LG_TANH, 2, 1);
    c.x[INPUTS] = NAN; /* in row 1 */
    product(&c, LG_F64, c.theta, c.x, c.direction, ROWS, NULL, NULL, dgradient);
    for (int i = 0; i < ROWS * INPUTS; i++) assert_int_equal(isnan(dgradient[i]) != 0, i / INPUTS == 1);
    free(c.theta);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_description),
        cmocka_unit_test(test_bad_descriptions),
        cmocka_unit_test(test_initialisation),
        cmocka_unit_test(test_eval),
        cmocka_unit_test(test_derivatives),
        cmocka_unit_test(test_single_precision),
        cmocka_unit_test(test_taped),
        cmocka_unit_test(test_gradient_of_gradient),
        cmocka_unit_test(test_short_theta),
        cmocka_unit_test(test_single_output),
        cmocka_unit_test(test_hessian_vector),
        cmocka_unit_test(test_hessian_is_symmetric),
        cmocka_unit_test(test_hessian_in_single_precision),
        cmocka_unit_test(test_hessian_of_what_is_not_a_number),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

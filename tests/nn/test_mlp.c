/* Multilayer perceptrons: description, initialisation, values on a tape against plain loops, the recorded
 * input gradient against the tape's. */
#include "nn_support.h"
#include "plain_layers.h"
#include "support/fixtures.h"

/* OFFSET other numbers precede the network's parameters. */
enum { ROWS = 5, INPUTS = 3, MOST_OUTPUTS = 2, OFFSET = 3 };

static const uint32_t hidden[2] = {7, 4};

static void plain(const lg_mlp *net, const double *theta, const double *x, double *y) {
    double a[16], b[16];
    memcpy(a, x, net->width[0] * sizeof *a);
    for (uint32_t l = 0; l < net->layers; l++) {
        const bool last = l + 1 == net->layers;
        plain_dense(&theta, net->width[l], net->width[l + 1], !last || net->last_bias,
                    last ? LG_IDENTITY : net->activation, a, b);
        memcpy(a, b, sizeof a);
    }
    memcpy(y, a, net->width[net->layers] * sizeof *y);
}

typedef struct fixture {
    lg_mlp net;
    size_t outputs, parameters;
    double *flat, *theta; /* theta = flat + OFFSET */
    double x[ROWS * INPUTS];
} fixture;

static fixture setup(lg_activation kind, bool last_bias, uint32_t hidden_layers, uint32_t outputs) {
    fixture f = {.outputs = outputs};
    lg_rng rng = test_rng(11, (uint64_t)kind);
    assert_ok(lg_mlp_init(&f.net, INPUTS, hidden, hidden_layers, outputs, kind, last_bias));
    f.parameters = lg_mlp_parameters(&f.net);
    f.flat = TEST_ARRAY(double, f.parameters + OFFSET);
    f.theta = f.flat + OFFSET;
    for (size_t i = 0; i < OFFSET; i++) f.flat[i] = 1e6;
    lg_mlp_initialise(&f.net, &rng, f.theta);
    for (size_t i = 0; i < LG_COUNT(f.x); i++) f.x[i] = lg_rng_normal(&rng);
    return f;
}

TEST("a description counts its parameters and knows where they are") {
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

TEST("a refused description leaves the network unchanged") {
    const uint32_t zero[1] = {0}, huge[1] = {UINT32_MAX}, many[LG_MLP_MAX_LAYERS] = {1};
    lg_mlp net, before;
    assert_ok(lg_mlp_init(&net, 3, hidden, 2, 2, LG_TANH, false));
    memcpy(&before, &net, sizeof net);
    assert_status(lg_mlp_init(&net, 0, hidden, 2, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, hidden, 2, 0, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, zero, 1, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, huge, 1, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, many, LG_MLP_MAX_LAYERS, 2, LG_TANH, true), LG_INVALID_ARGUMENT);
    assert_status(lg_mlp_init(&net, 3, hidden, 2, 2, (lg_activation)LG_ACTIVATION_COUNT, true),
                  LG_INVALID_ARGUMENT);
    assert_memory_equal(&net, &before, sizeof net);
}

/* Of a layer of 80 x 100; the variance of U(-a, a) is a^2/3. */
TEST("initial parameters have their bound and variance") {
    const uint32_t wide[1] = {100};
    lg_mlp net;
    assert_ok(lg_mlp_init(&net, 80, wide, 1, 1, LG_TANH, true));
    double *theta = TEST_ARRAY(double, lg_mlp_parameters(&net)), second = 0.0, largest = 0.0, biases = 0.0;
    lg_rng rng = test_rng(5, 0);
    memset(theta, 0xff, lg_mlp_parameters(&net) * sizeof *theta);
    lg_mlp_initialise(&net, &rng, theta);
    for (size_t i = 0; i < 8000; i++) {
        second += theta[i] * theta[i] / 8000.0;
        largest = fmax(largest, fabs(theta[i]));
    }
    for (size_t i = 8000; i < 8100; i++) biases = fmax(biases, fabs(theta[i]));
    assert_close(second, 1.0 / 240.0, 0.08, 0.0);
    assert_true(largest <= sqrt(1.0 / 80.0) && biases > 0.0);
    for (size_t i = 0; i < lg_mlp_parameters(&net); i++) assert_true(isfinite(theta[i]));
}

/* The network's outputs on a tape, and the gradient of the first output: recorded by the network, and by the
 * tape. */
typedef struct recorded {
    double y[ROWS * MOST_OUTPUTS], gradient[ROWS * INPUTS], of_tape[ROWS * INPUTS];
} recorded;

static recorded record(const fixture *f, lg_tape *tape, uint32_t rows) {
    recorded r;
    lg_mlp_vars vars;
    lg_var of_tape = LG_NONE;
    lg_tape_reset(tape);
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)f->parameters + OFFSET), f->flat);
    const lg_var x = lg_input_f64(tape, lg_shape2(rows, INPUTS), f->x);
    const lg_var y = lg_mlp_record(tape, &f->net, theta, OFFSET, x);
    assert_ok(lg_grad(tape, lg_sum(tape, lg_slice(tape, y, 1, 0, 1)), &x, 1, &of_tape));
    assert_ok(lg_mlp_bind(tape, &f->net, theta, OFFSET, &vars));
    assert_ok(lg_read(tape, y, rows * f->outputs, r.y));
    assert_ok(lg_read(tape, lg_mlp_record_gradient(tape, &f->net, &vars, x), rows * INPUTS, r.gradient));
    assert_ok(lg_read(tape, of_tape, rows * INPUTS, r.of_tape));
    return r;
}

TEST("recorded perceptrons agree with plain loops, and their recorded gradient agrees with the tape's") {
    lg_tape *tape = test_tape(LG_F64);
    double expected[MOST_OUTPUTS];
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++)
        for (uint32_t layers = 0; layers <= 2; layers++)
            for (uint32_t outputs = 1; outputs <= MOST_OUTPUTS; outputs++)
                for (uint32_t which = 0; which < 4; which++) {
                    const uint32_t rows = which < 2 ? 1 : ROWS;
                    const fixture f = setup((lg_activation)kind, which % 2 == 1, layers, outputs);
                    const recorded r = record(&f, tape, rows);
                    for (size_t row = 0; row < rows; row++) {
                        plain(&f.net, f.theta, f.x + INPUTS * row, expected);
                        for (size_t o = 0; o < outputs; o++)
                            assert_close(r.y[outputs * row + o], expected[o], 1e-13, 1e-14);
                    }
                    for (size_t i = 0; i < INPUTS * rows; i++)
                        assert_close(r.gradient[i], r.of_tape[i], 1e-13, 1e-14);
                }
}

TEST("perceptrons in single precision agree with double precision to rounding") {
    const fixture f = setup(LG_SWISH, true, 2, 2);
    const recorded r = record(&f, test_tape(LG_F32), ROWS), expected = record(&f, test_tape(LG_F64), ROWS);
    for (size_t i = 0; i < 2 * ROWS; i++) assert_close(r.y[i], expected.y[i], 1e-5, 1e-6);
    for (size_t i = 0; i < INPUTS * ROWS; i++) assert_close(r.gradient[i], expected.gradient[i], 1e-5, 1e-6);
}

TEST("too few parameters, an offset beyond them, and inputs of another width are refused") {
    const fixture f = setup(LG_TANH, true, 2, 2);
    const uint32_t n = (uint32_t)f.parameters;
    const struct {
        uint32_t parameters, inputs;
        size_t offset;
        bool fits; /* there are enough parameters */
    } bad[] = {{n - 1, INPUTS, 0, false},
               {n, INPUTS, 1, false},
               {n, INPUTS, SIZE_MAX, true},
               {n, INPUTS - 1, 0, true}};
    lg_tape *tape = test_tape(LG_F64);
    lg_mlp_vars vars;
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        lg_tape_reset(tape);
        const lg_var theta = lg_parameter(tape, lg_shape1(bad[i].parameters), f.theta);
        const lg_var x = lg_input(tape, lg_shape2(1, bad[i].inputs), f.x);
        assert_true(lg_is_none(lg_mlp_record(tape, &f.net, theta, bad[i].offset, x)));
        assert_int_not_equal(lg_tape_status(tape), LG_OK);
        if (bad[i].fits) assert_status(lg_tape_status(tape), LG_SHAPE);
    }
    lg_tape_reset(tape);
    const lg_var theta = lg_parameter(tape, lg_shape1(n - 1), f.theta);
    assert_int_not_equal(lg_mlp_bind(tape, &f.net, theta, 0, &vars), LG_OK);
}

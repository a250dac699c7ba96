/* Programs of detectors: logits compared with the network on a tape, probabilities with the logits; scaling,
 * centred windows, poolings, strides and paddings, no blocks, both losses. test_recipes tests their
 * Jacobians. */
#include "test_support.h"

#include "anomaly/detector_internal.h"
#include "nn/odd_nets.h"
#include "support/plan_support.h"

enum { MOST_INPUTS = 80, MOST_OUTPUTS = 3, MOST_CHANNELS = 3 };

typedef struct example {
    lg_detector model;
    lg_scaler scaler;
    double mean[MOST_CHANNELS], scale[MOST_CHANNELS];
    double x[MOST_INPUTS], *theta;
    size_t inputs, outputs;
    lg_program *program;
    ready value, gradient;
} example;

static void make(example *e, size_t net, lg_activation activation, uint32_t classes, bool centred) {
    static const double mean[] = {0.3, -2.0, 5.0}, scale[] = {0.5, 3.0, 1.25};
    memset(e, 0, sizeof *e);
    e->model = (lg_detector){.net = odd_nets[net],
                             .classes = classes,
                             .loss = classes == 2 ? LG_DETECTOR_MSE : LG_DETECTOR_CROSS_ENTROPY,
                             .centred = centred};
    e->model.net.outputs = classes == 2 ? 1 : classes;
    e->model.net.activation = activation;
    assert_told(lg_cnn_init(&e->model.net, &told));
    assert_told(lg_detector_check(&e->model, &told));
    for (size_t c = 0; c < MOST_CHANNELS; c++) {
        e->mean[c] = centred ? 0.0 : mean[c];
        e->scale[c] = scale[c];
    }
    e->scaler = (lg_scaler){.channels = odd_nets[net].channels, .mean = e->mean, .scale = e->scale};
    lg_rng rng = test_rng(31, net);
    e->theta = TEST_ARRAY(double, lg_cnn_parameters(&e->model.net));
    lg_cnn_initialise(&e->model.net, &rng, e->theta);
    assert_told(lg_detector_program(NULL, &e->model, &e->scaler, e->theta, &e->program, &told));
    lg_test_owns(e->program, release_program);
    e->value = make_ready(e->program, "value", 1, LG_F64);
    e->gradient = make_ready(e->program, "grad", 1, LG_F64);
    e->inputs = lg_plan_input_count(e->value.plan, 0);
    e->outputs = lg_plan_output_count(e->value.plan, 0);
    assert_int_equal(e->inputs, odd_nets[net].channels * odd_nets[net].length);
    assert_int_equal(e->outputs, e->model.net.outputs);
    for (size_t i = 0; i < e->inputs; i++) {
        const size_t c = i / odd_nets[net].length;
        e->x[i] = (double)(float)(mean[c] + scale[c] * lg_rng_normal(&rng));
    }
}

/* Compares the logits with the network on a tape, for the window scaled as in training. */
static void against_tape(const example *e) {
    double y[MOST_OUTPUTS], logits[MOST_OUTPUTS], z[MOST_INPUTS];
    float x[MOST_INPUTS];
    const lg_cnn *net = &e->model.net;
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < e->inputs; i++) x[i] = (float)e->x[i];
    lg_detector_scale(&e->model, &e->scaler, LG_F64, x, z);
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)lg_cnn_parameters(net)), e->theta);
    const lg_var in = lg_input_f64(tape, lg_shape3(1, net->length, net->channels), z);
    assert_ok(lg_read(tape, lg_cnn_record(tape, net, theta, 0, in, NULL), e->outputs, logits));
    run_value(&e->value, e->x, y);
    for (size_t o = 0; o < e->outputs; o++) assert_close(y[o], logits[o], 1e-13, 1e-14);
}

/* Compares the probabilities with sigmoid or softmax of the logits, for the recorded window and for the
 * scaled one. */
static void against_probabilities(const example *e) {
    double y[MOST_OUTPUTS], probability[MOST_OUTPUTS], again[MOST_OUTPUTS], z[MOST_INPUTS], sum = 0.0;
    float x[MOST_INPUTS];
    for (size_t i = 0; i < e->inputs; i++) x[i] = (float)e->x[i];
    lg_detector_scale(&e->model, &e->scaler, LG_F64, x, z);
    const ready of_window = make_ready(e->program, "probability", 1, LG_F64);
    const ready of_scaled = make_ready(e->program, "scores", 1, LG_F64);
    run_value(&of_window, e->x, probability);
    run_gradient(&of_scaled, z, again, NULL);
    run_value(&e->value, e->x, y);
    for (size_t i = 0; i < e->model.classes; i++) assert_close(again[i], probability[i], 1e-13, 0);
    if (e->model.loss == LG_DETECTOR_MSE) {
        assert_close(probability[1], 1.0 / (1.0 + exp(-y[0])), 1e-14, 0);
        assert_close(probability[0], 1.0 / (1.0 + exp(y[0])), 1e-14, 0);
    } else {
        for (size_t i = 0; i < e->outputs; i++) sum += exp(y[i]);
        for (size_t i = 0; i < e->outputs; i++) assert_close(probability[i], exp(y[i]) / sum, 1e-13, 0);
    }
}

TEST("logits agree with a tape, and probabilities follow from the logits") {
    for (int activation = 0; activation < LG_ACTIVATION_COUNT; activation++)
        for (size_t net = 0; net < ODD_NETS; net++)
            for (uint32_t classes = 2; classes <= 3; classes++)
                for (int centred = 0; centred < 2; centred++) {
                    example e;
                    make(&e, net, (lg_activation)activation, classes, centred);
                    against_tape(&e);
                    against_probabilities(&e);
                }
}

TEST("if windows are centred, a constant added to a window changes nothing") {
    for (size_t net = 0; net < ODD_NETS; net++) {
        example e;
        make(&e, net, LG_TANH, 3, true);
        double jacobian[MOST_OUTPUTS * MOST_INPUTS], largest = 0.0;
        const size_t n = e.model.net.length;
        run_gradient(&e.gradient, e.x, NULL, jacobian);
        for (size_t i = 0; i < e.outputs * e.inputs; i++) largest = fmax(largest, fabs(jacobian[i]));
        for (size_t i = 0; i < e.outputs * e.inputs; i += n) {
            double sum = 0.0;
            for (size_t t = 0; t < n; t++) sum += jacobian[i + t];
            assert_close(sum, 0.0, 0, 1e-14 * largest);
        }
        assert_int_equal(largest == 0.0, n == 1);
    }
}

TEST("an offset that is large relative to the scale causes no rounding errors, in single precision too") {
    for (int centred = 0; centred < 2; centred++) {
        example e;
        make(&e, 1, LG_TANH, 3, centred);
        double y[MOST_OUTPUTS], moved[MOST_OUTPUTS];
        float x[MOST_INPUTS], narrow[MOST_OUTPUTS];
        const size_t n = e.model.net.length;
        run_value(&e.value, e.x, y);
        for (size_t i = 0; i < e.inputs; i++) { /* floats with free digits for the offset */
            e.x[i] = floor(e.x[i] * 256.0) / 256.0;
            x[i] = (float)(e.x[i] + 4096.0);
        }
        run_value(&e.value, e.x, y);
        for (size_t c = 0; c < e.inputs / n; c++) e.mean[c] += centred ? 0.0 : 4096.0;
        assert_ok(lg_detector_program(NULL, &e.model, &e.scaler, e.theta, &e.program, NULL));
        lg_test_owns(e.program, release_program);
        const ready single = make_ready(e.program, "value", 1, LG_F32);
        lg_plan_eval(single.plan, (const void *const[]){x}, (void *const[]){narrow}, single.work);
        for (size_t o = 0; o < e.outputs; o++) moved[o] = (double)narrow[o];
        for (size_t o = 0; o < e.outputs; o++) assert_close(moved[o], y[o], 1e-5, 1e-6);
    }
}

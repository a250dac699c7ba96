/* Detectors as maps of numbers: logits against lg_detector_eval, Jacobians against central differences;
 * scaling, windows without their means, poolings, strides and paddings, no blocks, both losses; memory. */
#include "test_support.h"

#include "models/model_internal.h"
#include "nn/odd_nets.h"
#include "support/malloc_count.h"

enum { MOST_INPUTS = 80, MOST_OUTPUTS = 3, MOST_CHANNELS = 3 };

typedef struct example {
    lg_detector model;
    lg_scaler scaler;
    double mean[MOST_CHANNELS], scale[MOST_CHANNELS];
    double x[MOST_INPUTS], *theta;
    size_t inputs, outputs;
    void *work;
} example;

static void make(example *e, size_t net, lg_activation activation, uint32_t classes, bool centred) {
    static const double mean[] = {0.3, -2.0, 5.0}, scale[] = {0.5, 3.0, 1.25};
    lg_error error;
    memset(e, 0, sizeof *e);
    e->model = (lg_detector){.net = odd_nets[net],
                             .classes = classes,
                             .loss = classes == 2 ? LG_DETECTOR_MSE : LG_DETECTOR_CROSS_ENTROPY,
                             .centred = centred};
    e->model.net.outputs = classes == 2 ? 1 : classes;
    e->model.net.activation = activation;
    if (lg_cnn_init(&e->model.net, &error) != LG_OK) fail_msg("%s", error.message);
    if (lg_detector_check(&e->model, &error) != LG_OK) fail_msg("%s", error.message);
    for (size_t c = 0; c < MOST_CHANNELS; c++) {
        e->mean[c] = centred ? 0.0 : mean[c];
        e->scale[c] = scale[c];
    }
    e->scaler = (lg_scaler){odd_nets[net].channels, e->mean, e->scale};
    lg_rng rng;
    lg_rng_seed(&rng, 31, net);
    e->theta = malloc(lg_cnn_parameters(&e->model.net) * sizeof *e->theta);
    lg_cnn_initialise(&e->model.net, LG_INIT_FAN_IN, &rng, e->theta);
    e->inputs = lg_model_detector_inputs(&e->model);
    e->outputs = lg_model_detector_outputs(&e->model);
    assert_int_equal(e->inputs, odd_nets[net].channels * odd_nets[net].length);
    assert_int_equal(e->outputs, e->model.net.outputs);
    for (size_t i = 0; i < e->inputs; i++) {
        const size_t c = i / odd_nets[net].length;
        e->x[i] = (double)(float)(mean[c] + scale[c] * lg_rng_normal(&rng));
    }
    const size_t bytes = lg_model_detector_work_size(&e->model) + 64;
    if (posix_memalign(&e->work, 64, bytes) != 0) fail_msg("no memory");
    memset(e->work, 0xff, bytes); /* NaN */
}

static void release(example *e) {
    free(e->theta);
    free(e->work);
}

/* Sigmoid or softmax of the logits. */
static void against_probabilities(const example *e) {
    double y[MOST_OUTPUTS], probability[MOST_OUTPUTS], sum = 0.0;
    float x[MOST_INPUTS];
    void *work;
    for (size_t i = 0; i < e->inputs; i++) x[i] = (float)e->x[i];
    if (posix_memalign(&work, 64, lg_detector_work_size(&e->model, LG_F64)) != 0) fail_msg("no memory");
    lg_detector_eval(&e->model, &e->scaler, LG_F64, e->theta, x, probability, NULL, work);
    lg_model_detector_eval(&e->model, &e->scaler, e->theta, e->x, y, e->work);
    if (e->model.loss == LG_DETECTOR_MSE) {
        assert_close(1.0 / (1.0 + exp(-y[0])), probability[1], 1e-15, 0);
    } else {
        for (size_t i = 0; i < e->outputs; i++) sum += exp(y[i]);
        for (size_t i = 0; i < e->outputs; i++) assert_close(exp(y[i]) / sum, probability[i], 1e-14, 0);
    }
    free(work);
}

static bool smooth(lg_activation kind) {
    return kind != LG_RELU && kind != LG_LEAKY_RELU;
}

/* Of second order with a step so small that it crosses no kink. */
static void against_differences(const example *e) {
    const size_t count = e->outputs * e->inputs, bytes = lg_model_detector_work_size(&e->model);
    double y[MOST_OUTPUTS], plain[MOST_OUTPUTS], up[MOST_OUTPUTS], down[MOST_OUTPUTS], x[MOST_INPUTS];
    double jacobian[MOST_OUTPUTS * MOST_INPUTS + 1], again[MOST_OUTPUTS * MOST_INPUTS];
    for (size_t i = 0; i <= count; i++) jacobian[i] = 55.0;
    memset(e->work, 0xff, bytes + 64);
    lg_model_detector_jacobian(&e->model, &e->scaler, e->theta, e->x, y, jacobian, e->work);
    for (size_t i = bytes; i < bytes + 64; i++) assert_int_equal(((unsigned char *)e->work)[i], 0xff);
    assert_close(jacobian[count], 55.0, 0, 0);
    lg_model_detector_jacobian(&e->model, &e->scaler, e->theta, e->x, NULL, again, e->work);
    assert_memory_equal(jacobian, again, count * sizeof *again);
    memset(e->work, 0xff, bytes);
    lg_model_detector_eval(&e->model, &e->scaler, e->theta, e->x, plain, e->work);
    for (size_t o = 0; o < e->outputs; o++) assert_close(y[o], plain[o], 1e-14, 1e-14);
    const double h = smooth(e->model.net.activation) ? 1e-5 : 1e-6;
    memcpy(x, e->x, e->inputs * sizeof *x);
    for (size_t i = 0; i < e->inputs; i++) {
        x[i] = e->x[i] + h;
        lg_model_detector_eval(&e->model, &e->scaler, e->theta, x, up, e->work);
        x[i] = e->x[i] - h;
        lg_model_detector_eval(&e->model, &e->scaler, e->theta, x, down, e->work);
        x[i] = e->x[i];
        for (size_t o = 0; o < e->outputs; o++)
            assert_close(jacobian[o * e->inputs + i], (up[o] - down[o]) / (2.0 * h), 1e-8, 2e-9);
    }
}

static void values_and_jacobians(void **state) {
    (void)state;
    for (int activation = 0; activation < LG_ACTIVATION_COUNT; activation++)
        for (size_t net = 0; net < ODD_NETS; net++)
            for (uint32_t classes = 2; classes <= 3; classes++)
                for (int centred = 0; centred < 2; centred++) {
                    example e;
                    make(&e, net, (lg_activation)activation, classes, centred);
                    against_probabilities(&e);
                    against_differences(&e);
                    release(&e);
                }
}

/* Without its own mean a window that is moved is the same: rows add up to 0 over each channel; and one sample
 * says nothing. */
static void moved_windows(void **state) {
    (void)state;
    for (size_t net = 0; net < ODD_NETS; net++) {
        example e;
        make(&e, net, LG_TANH, 3, true);
        double jacobian[MOST_OUTPUTS * MOST_INPUTS], largest = 0.0;
        const size_t n = e.model.net.length;
        lg_model_detector_jacobian(&e.model, &e.scaler, e.theta, e.x, NULL, jacobian, e.work);
        for (size_t i = 0; i < e.outputs * e.inputs; i++) largest = fmax(largest, fabs(jacobian[i]));
        for (size_t i = 0; i < e.outputs * e.inputs; i += n) {
            double sum = 0.0;
            for (size_t t = 0; t < n; t++) sum += jacobian[i + t];
            assert_close(sum, 0.0, 0, 1e-14 * largest);
        }
        assert_int_equal(largest == 0.0, n == 1);
        release(&e);
    }
}

static void nan_in_nan_out(void **state) {
    (void)state;
    example e;
    make(&e, 1, LG_TANH, 3, true);
    double y[MOST_OUTPUTS], jacobian[MOST_OUTPUTS * MOST_INPUTS];
    e.x[7] = NAN;
    lg_model_detector_jacobian(&e.model, &e.scaler, e.theta, e.x, y, jacobian, e.work);
    for (size_t o = 0; o < e.outputs; o++) assert_true(isnan(y[o]));
    assert_true(isnan(jacobian[7]));
    release(&e);
}

static void no_memory(void **state) {
    (void)state;
    if (!lg_count_available()) skip();
    for (size_t net = 0; net < ODD_NETS; net++) {
        example e;
        make(&e, net, LG_SWISH, 3, net % 2);
        double y[MOST_OUTPUTS], jacobian[MOST_OUTPUTS * MOST_INPUTS];
        assert_no_malloc_no_lock(lg_model_detector_eval(&e.model, &e.scaler, e.theta, e.x, y, e.work));
        assert_no_malloc_no_lock(
            lg_model_detector_jacobian(&e.model, &e.scaler, e.theta, e.x, y, jacobian, e.work));
        release(&e);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_and_jacobians),
        cmocka_unit_test(moved_windows),
        cmocka_unit_test(nan_in_nan_out),
        cmocka_unit_test(no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

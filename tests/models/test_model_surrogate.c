/* Surrogates as maps of numbers: values against the curves, Jacobians against central differences, every
 * architecture, activation and option, both sides of the mirror, ends, short beams; memory. */
#include "surrogate_support.h"

#include "models/model_internal.h"
#include "support/malloc_count.h"

enum { INTERVALS = 5, MOST_INPUTS = 9, MOST_OUTPUTS = 4 * (INTERVALS - 1) };

typedef struct example {
    lg_surrogate model;
    size_t inputs, outputs;
    double *theta;
    void *work, *curve;
} example;

static void *aligned(size_t bytes) {
    void *memory;
    if (posix_memalign(&memory, 64, bytes) != 0) fail_msg("no memory");
    memset(memory, 0xff, bytes); /* NaN */
    return memory;
}

static example make(const lg_surrogate_options *options, double length) {
    example e;
    lg_error error;
    if (lg_surrogate_init(&e.model, options, INTERVALS, length, 1.4, &error) != LG_OK)
        fail_msg("%s", error.message);
    lg_rng rng;
    lg_rng_seed(&rng, 8, options->layers);
    e.theta = malloc(lg_surrogate_parameters(&e.model) * sizeof *e.theta);
    lg_net_initialise(&e.model.net, LG_INIT_FAN_IN, &rng, e.theta);
    e.inputs = lg_model_surrogate_inputs(&e.model);
    e.outputs = lg_model_surrogate_outputs(&e.model);
    static const size_t inputs[] = {8, 9, 9}, outputs[] = {MOST_OUTPUTS, 2, 1};
    assert_int_equal(e.inputs, inputs[options->kind]);
    assert_int_equal(e.outputs, outputs[options->kind]);
    e.work = aligned(lg_model_surrogate_work_size(&e.model) + 64);
    e.curve = aligned(lg_surrogate_work_size(&e.model, INTERVALS + 1, LG_F64));
    return e;
}

static void release(example *e) {
    free(e->theta);
    free(e->work);
    free(e->curve);
}

/* Boundary conditions on either side of the mirror (v0y > vNy for side 1), tangents not quite of length 1;
 * behind s where the model has it. */
static void place(const example *e, double side, double s, double *x) {
    const double b[8] = {0.1, -0.2, 0.8, 0.7 * side, 2.6, 0.3, 0.9, -0.35 * side};
    if (e->inputs == 9) *x++ = s;
    memcpy(x, b, sizeof b);
}

/* ---- values ---- */

static void against_curve(const example *e, const double *x) {
    double y[MOST_OUTPUTS], at[INTERVALS + 1], q[2 * (INTERVALS + 1)], v[2 * (INTERVALS + 1)];
    const lg_surrogate *model = &e->model;
    lg_model_surrogate_eval(model, e->theta, x, y, e->work);
    if (model->options.kind == LG_SURROGATE_DISCRETE) {
        for (size_t k = 0; k <= INTERVALS; k++) at[k] = model->length * (double)k / INTERVALS;
        lg_surrogate_curve(model, LG_F64, e->theta, x, at, INTERVALS + 1, q, v, e->curve);
        for (size_t i = 0; i < 2 * (INTERVALS - 1); i++) {
            assert_close(y[i], q[2 + i], 0, 0);
            assert_close(y[2 * (INTERVALS - 1) + i], v[2 + i], 0, 0);
        }
        return;
    }
    lg_surrogate_curve(model, LG_F64, e->theta, x + 1, x, 1, q, v, e->curve);
    if (model->options.kind == LG_SURROGATE_CONTINUOUS) {
        for (size_t c = 0; c < 2; c++) assert_close(y[c], q[c], 0, 0);
        return;
    }
    assert_close(cos(y[0]), v[0], 0, 1e-15);
    assert_close(sin(y[0]), v[1], 0, 1e-15);
}

/* ---- Jacobians ---- */

static bool smooth(lg_activation kind) {
    return kind != LG_RELU && kind != LG_LEAKY_RELU;
}

/* Of fourth order with a step for smooth networks, else of second order with a tiny one. */
static void differences(const example *e, const double *x, size_t input, double *by) {
    const bool fourth = smooth(e->model.options.activation);
    const double h = fourth ? 3e-4 : 1e-7;
    static const double at[4] = {1.0, -1.0, 2.0, -2.0},
                        weight[2][4] = {{0.5, -0.5, 0.0, 0.0},
                                        {2.0 / 3.0, -2.0 / 3.0, -1.0 / 12.0, 1.0 / 12.0}};
    double moved[MOST_INPUTS], y[MOST_OUTPUTS];
    for (size_t o = 0; o < e->outputs; o++) by[o] = 0.0;
    for (size_t i = 0; i < 4; i++) {
        memcpy(moved, x, e->inputs * sizeof *x);
        moved[input] += at[i] * h;
        lg_model_surrogate_eval(&e->model, e->theta, moved, y, e->work);
        for (size_t o = 0; o < e->outputs; o++) by[o] += weight[fourth][i] / h * y[o];
    }
}

static void against_differences(const example *e, const double *x) {
    const size_t count = e->outputs * e->inputs, bytes = lg_model_surrogate_work_size(&e->model);
    double y[MOST_OUTPUTS], plain[MOST_OUTPUTS], by[MOST_OUTPUTS];
    double jacobian[MOST_OUTPUTS * MOST_INPUTS + 1], again[MOST_OUTPUTS * MOST_INPUTS];
    for (size_t i = 0; i <= count; i++) jacobian[i] = 55.0;
    memset(e->work, 0xff, bytes + 64);
    lg_model_surrogate_jacobian(&e->model, e->theta, x, y, jacobian, e->work);
    for (size_t i = bytes; i < bytes + 64; i++) assert_int_equal(((unsigned char *)e->work)[i], 0xff);
    assert_close(jacobian[count], 55.0, 0, 0);
    lg_model_surrogate_jacobian(&e->model, e->theta, x, NULL, again, e->work);
    assert_memory_equal(jacobian, again, count * sizeof *again);
    memset(e->work, 0xff, bytes);
    lg_model_surrogate_eval(&e->model, e->theta, x, plain, e->work);
    for (size_t o = 0; o < e->outputs; o++) assert_close(y[o], plain[o], 1e-14, 1e-14);
    const double tolerance = smooth(e->model.options.activation) ? 1e-8 : 1e-7;
    for (size_t input = 0; input < e->inputs; input++) {
        differences(e, x, input, by);
        for (size_t o = 0; o < e->outputs; o++)
            assert_close(jacobian[o * e->inputs + input], by[o], tolerance, tolerance);
    }
}

/* Column 0: the tangent, to the bit. */
static void first_column(const example *e, const double *x) {
    double jacobian[2 * MOST_INPUTS], q[2], v[2];
    if (e->model.options.kind != LG_SURROGATE_CONTINUOUS) return;
    lg_model_surrogate_jacobian(&e->model, e->theta, x, NULL, jacobian, e->work);
    lg_surrogate_curve(&e->model, LG_F64, e->theta, x + 1, x, 1, q, v, e->curve);
    for (size_t c = 0; c < 2; c++) assert_close(jacobian[9 * c], v[c], 0, 0);
}

static void all_checks(const lg_surrogate_options *options, double length) {
    example e = make(options, length);
    const double at[] = {0.0, 0.05 * length, 0.43 * length, length};
    double x[MOST_INPUTS];
    for (double side = -1.0; side <= 1.0; side += 2.0)
        for (size_t i = 0; i < LG_COUNT(at); i++) {
            place(&e, side, at[i], x);
            against_curve(&e, x);
            against_differences(&e, x);
            first_column(&e, x);
        }
    release(&e);
}

static lg_surrogate_options options_of(lg_surrogate_kind kind) {
    return (lg_surrogate_options){.kind = kind,
                                  .architecture = LG_NET_MULT,
                                  .embedding = 0,
                                  .hidden = 7,
                                  .layers = 2,
                                  .activation = LG_TANH};
}

static void architectures(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++)
        for (int net = 0; net < LG_NET_KIND_COUNT; net++)
            for (uint32_t embedding = 0; embedding <= 5; embedding += 5)
                for (uint32_t layers = 0; layers <= 2; layers++) {
                    lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
                    o.architecture = (lg_net_kind)net;
                    o.embedding = embedding;
                    o.layers = layers;
                    all_checks(&o, TEST_LENGTH);
                }
}

static void activations(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++)
        for (int activation = 0; activation < LG_ACTIVATION_COUNT; activation++)
            for (int net = 0; net < LG_NET_KIND_COUNT; net++) {
                lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
                o.architecture = (lg_net_kind)net;
                o.activation = (lg_activation)activation;
                all_checks(&o, TEST_LENGTH);
            }
}

/* Beams so short that both corrections of the ends reach each other, and of usual length. */
static void options(void **state) {
    (void)state;
    static const double lengths[] = {TEST_LENGTH, 0.5, 0.1};
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++)
        for (unsigned flags = 0; flags < 8; flags++)
            for (size_t i = 0; i < 3; i++) {
                lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
                o.normalise = flags & 1;
                o.mirror = flags & 2;
                o.boundary = (flags & 4) && kind == LG_SURROGATE_ANGLE;
                all_checks(&o, lengths[i]);
            }
}

/* theta(0) and theta(L) are the given angles, whatever the network: so are their derivatives. */
static void held_angles(void **state) {
    (void)state;
    static const double lengths[] = {TEST_LENGTH, 0.1};
    lg_surrogate_options o = options_of(LG_SURROGATE_ANGLE);
    o.boundary = true;
    for (int mirror = 0; mirror < 2; mirror++)
        for (size_t l = 0; l < 2; l++)
            for (double side = -1.0; side <= 1.0; side += 2.0)
                for (size_t end = 0; end < 2; end++) {
                    o.mirror = mirror;
                    example e = make(&o, lengths[l]);
                    double x[9], y, jacobian[9];
                    place(&e, side, end == 0 ? 0.0 : lengths[l], x);
                    lg_model_surrogate_jacobian(&e.model, e.theta, x, &y, jacobian, e.work);
                    const size_t at = end == 0 ? 3 : 7;
                    const double *v = x + at, square = v[0] * v[0] + v[1] * v[1];
                    assert_close(y, atan2(v[1], v[0]), 1e-14, 0);
                    for (size_t c = 1; c < 9; c++) {
                        const double wanted = c == at ? -v[1] / square : c == at + 1 ? v[0] / square : 0.0;
                        assert_close(jacobian[c], wanted, 1e-13, 1e-13);
                    }
                    release(&e);
                }
}

/* Moving a beam moves its curve; reflecting it reflects value and Jacobian, exactly with `mirror`. */
static void symmetries(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
        o.mirror = true;
        example e = make(&o, TEST_LENGTH);
        double x[MOST_INPUTS], image[MOST_INPUTS], y[MOST_OUTPUTS], z[MOST_OUTPUTS];
        double a[MOST_OUTPUTS * MOST_INPUTS], b[MOST_OUTPUTS * MOST_INPUTS];
        const size_t first = e.inputs - 8;
        place(&e, 1.0, 1.1, x);
        for (size_t i = 0; i < e.inputs; i++)
            image[i] = (i >= first && (i - first) % 2 == 1 ? -1.0 : 1.0) * x[i];
        lg_model_surrogate_jacobian(&e.model, e.theta, x, y, a, e.work);
        lg_model_surrogate_jacobian(&e.model, e.theta, image, z, b, e.work);
        for (size_t o_ = 0; o_ < e.outputs; o_++) {
            const double row = kind == LG_SURROGATE_ANGLE || o_ % 2 == 1 ? -1.0 : 1.0;
            assert_close(z[o_], row * y[o_], 0, 0);
            for (size_t i = 0; i < e.inputs; i++) {
                const double column = i >= first && (i - first) % 2 == 1 ? -1.0 : 1.0;
                assert_close(b[o_ * e.inputs + i], row * column * a[o_ * e.inputs + i], 0, 0);
            }
            for (size_t c = 0; c < 2; c++) { /* of a translation */
                const double *by = a + o_ * e.inputs + first;
                const bool point =
                    kind == LG_SURROGATE_CONTINUOUS || (kind == LG_SURROGATE_DISCRETE && o_ < e.outputs / 2);
                assert_close(by[c] + by[4 + c], point && o_ % 2 == c ? 1.0 : 0.0, 1e-15, 1e-15);
            }
        }
        release(&e);
    }
}

static void nan_in_nan_out(void **state) {
    (void)state;
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        const lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
        example e = make(&o, TEST_LENGTH);
        double x[MOST_INPUTS], y[MOST_OUTPUTS], jacobian[MOST_OUTPUTS * MOST_INPUTS];
        place(&e, 1.0, 1.1, x);
        x[e.inputs - 2] = NAN; /* vNx */
        lg_model_surrogate_eval(&e.model, e.theta, x, y, e.work);
        for (size_t i = 0; i < e.outputs; i++) assert_true(isnan(y[i]));
        lg_model_surrogate_jacobian(&e.model, e.theta, x, y, jacobian, e.work);
        for (size_t i = 0; i < e.outputs; i++) assert_true(isnan(y[i]));
        assert_true(isnan(jacobian[e.inputs - 2]));
        release(&e);
    }
}

static void no_memory(void **state) {
    (void)state;
    if (!lg_count_available()) skip();
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
        o.boundary = kind == LG_SURROGATE_ANGLE;
        o.embedding = 5;
        example e = make(&o, TEST_LENGTH);
        double x[MOST_INPUTS], y[MOST_OUTPUTS], jacobian[MOST_OUTPUTS * MOST_INPUTS];
        place(&e, 1.0, 1.1, x);
        assert_no_malloc_no_lock(lg_model_surrogate_eval(&e.model, e.theta, x, y, e.work));
        assert_no_malloc_no_lock(lg_model_surrogate_jacobian(&e.model, e.theta, x, y, jacobian, e.work));
        release(&e);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(architectures), cmocka_unit_test(activations), cmocka_unit_test(options),
        cmocka_unit_test(held_angles),   cmocka_unit_test(symmetries),  cmocka_unit_test(nan_in_nan_out),
        cmocka_unit_test(no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

/* Programs of surrogates: values compared with the network on a tape and with the curves, Jacobians with
 * central differences, for every architecture, activation and option, both sides of the mirror, fixed ends,
 * and short beams. test_recipes tests rows of a batch and single precision, test_model numbers that are not
 * finite.
 * ctest-labels: src/elastica src/autodiff */
#include "elastica/surrogate_support.h"

#include "liegrad/program.h"
#include "elastica/surrogate_internal.h"
#include "support/plan_support.h"

enum { INTERVALS = 5, MOST_INPUTS = 9, MOST_OUTPUTS = 4 * (INTERVALS - 1) };

typedef struct example {
    lg_surrogate model;
    size_t inputs, outputs;
    double *theta;
    lg_program *program;
    ready value, gradient;
    small curves; /* for curve_of */
    lg_tape *tape;
} example;

static example make(const lg_surrogate_options *options, double length) {
    example e;
    assert_told(lg_surrogate_init(&e.model, options, INTERVALS, length, 1.4, &told));
    give_modes(&e.model);
    lg_rng rng = test_rng(8, options->layers);
    e.theta = TEST_ARRAY(double, lg_surrogate_parameters(&e.model));
    lg_net_initialise(&e.model.net, &rng, e.theta);
    assert_told(lg_surrogate_program(NULL, &e.model, e.theta, &e.program, &told));
    lg_test_owns(e.program, release_program);
    e.value = make_ready(e.program, "value", 1, LG_F64);
    e.gradient = make_ready(e.program, "grad", 1, LG_F64);
    e.inputs = lg_plan_input_count(e.value.plan, 0);
    e.outputs = lg_plan_output_count(e.value.plan, 0);
    static const size_t inputs[] = {8, 9, 9}, outputs[] = {MOST_OUTPUTS, 2, 1};
    assert_int_equal(e.inputs, inputs[options->kind]);
    assert_int_equal(e.outputs, outputs[options->kind]);
    e.curves = (small){.model = e.model, .theta = e.theta};
    e.tape = test_tape(LG_F64);
    return e;
}

/* Boundary conditions on either side of the mirror (v0y > vNy for side 1), with tangents whose length is not
 * exactly 1; s comes first if the model has it. */
static void place(const example *e, double side, double s, double *x) {
    const double b[8] = {0.1, -0.2, 0.8, 0.7 * side, 2.6, 0.3, 0.9, -0.35 * side};
    if (e->inputs == 9) *x++ = s;
    memcpy(x, b, sizeof b);
}

/* ---- values ---- */

static void against_curve(const example *e, const double *x) {
    double y[MOST_OUTPUTS], at[INTERVALS + 1], q[2 * (INTERVALS + 1)], v[2 * (INTERVALS + 1)];
    const lg_surrogate *model = &e->model;
    run_value(&e->value, x, y);
    if (model->options.kind == LG_SURROGATE_DISCRETE) {
        for (size_t k = 0; k <= INTERVALS; k++) at[k] = model->length * (double)k / INTERVALS;
        curve_of(&e->curves, x, at, INTERVALS + 1, q, v);
        for (size_t i = 0; i < 2 * (INTERVALS - 1); i++) {
            assert_close(y[i], q[2 + i], 1e-14, 1e-14);
            assert_close(y[2 * (INTERVALS - 1) + i], v[2 + i], 1e-14, 1e-14);
        }
        return;
    }
    curve_of(&e->curves, x + 1, x, 1, q, v);
    if (model->options.kind == LG_SURROGATE_CONTINUOUS) {
        for (size_t c = 0; c < 2; c++) assert_close(y[c], q[c], 1e-14, 1e-14);
        return;
    }
    assert_close(cos(y[0]), v[0], 0, 1e-14);
    assert_close(sin(y[0]), v[1], 0, 1e-14);
}

/* Number `output` of a curve whose inner angles are f plus the line between the end angles. */
static double of_angles(const example *e, const double *row, const double *f, size_t output) {
    double theta[INTERVALS + 1], q[2 * (INTERVALS + 1)], v[2 * (INTERVALS + 1)];
    const double first = atan2(row[3], row[2]), last = atan2(row[7], row[6]);
    const bool scaled = e->model.options.normalise;
    for (size_t k = 0; k <= INTERVALS; k++)
        theta[k] = first + (last - first) * (double)k / INTERVALS + (k % INTERVALS > 0 ? f[k - 1] : 0.0);
    const lg_elastica problem = {.length = e->model.length,
                                 .stiffness = 1.0,
                                 .qN = {scaled ? e->model.centre * (1.0 + row[4]) : row[4], row[5]},
                                 .intervals = INTERVALS};
    lg_elastica_curve(&problem, theta, q, v);
    return output < MOST_OUTPUTS / 2 ? q[2 + output] : v[2 + output - MOST_OUTPUTS / 2];
}

/* Output of the network on a tape for the row that training uses, converted to a curve. */
static double of_network(const example *e, const double *row, size_t output) {
    lg_tape *tape = e->tape;
    double f[MOST_OUTPUTS];
    lg_tape_reset(tape);
    const lg_net *net = &e->model.net;
    const lg_var theta = lg_input_f64(tape, lg_shape1((uint32_t)lg_net_parameters(net)), e->theta);
    const lg_var y = lg_net_record(tape, net, theta, 0, lg_input_f64(tape, lg_shape2(1, net->inputs), row));
    assert_ok(lg_read(tape, y, net->outputs, f));
    if (e->model.options.angles) return of_angles(e, row, f, output);
    if (e->model.options.modes == 0) return f[output];
    const double *vector = e->model.modes + output;
    double sum = vector[0];
    for (size_t k = 0; k < net->outputs; k++) sum += f[k] * vector[MOST_OUTPUTS * (k + 1)];
    return sum;
}

static double angle_on_tape(const example *e, const double *x, double sign) {
    double row[9], weights[2], slopes[2], angles[2], angle;
    const double length = e->model.length;
    lg_surrogate_row(&e->model, x + 1, sign, x[0], row);
    angle = LG_SURROGATE_PI * of_network(e, row, 0);
    if (!e->model.options.boundary) return sign * angle;
    lg_surrogate_end_weights(&e->model, x[0], weights, slopes);
    lg_surrogate_angles(x + 1, sign, angles);
    for (size_t end = 0; end < 2; end++) {
        lg_surrogate_row(&e->model, x + 1, sign, end == 0 ? 0.0 : length, row);
        angle += (angles[end] - LG_SURROGATE_PI * of_network(e, row, 0)) * weights[end];
    }
    return sign * angle;
}

static void against_tape(const example *e, const double *x) {
    double y[MOST_OUTPUTS], row[9];
    const double *ends = x + e->inputs - 8, sign = lg_surrogate_sign(&e->model, ends);
    const size_t points = e->inputs == 8 ? e->outputs / 2 : 2;
    run_value(&e->value, x, y);
    if (e->model.options.kind == LG_SURROGATE_ANGLE) {
        assert_close(y[0], angle_on_tape(e, x, sign), 1e-13, 1e-14);
        return;
    }
    lg_surrogate_row(&e->model, ends, sign, x[0], row);
    const bool held = e->model.options.boundary;
    const double t = x[0] / e->model.length, u = 1.0 - t, weight = held ? 16.0 * t * t * u * u : 1.0;
    double pair[2];
    if (held)
        test_cubic((const double[]){ends[0], ends[1], ends[4], ends[5]},
                   (const double[]){ends[2], ends[3], ends[6], ends[7]}, e->model.length, t, pair);
    for (size_t o = 0; o < e->outputs; o++) {
        const double f = weight * of_network(e, row, o);
        const double from = held ? pair[o] : o < points ? ends[o % 2] : 0.0;
        assert_close(y[o], from + (o % 2 == 1 ? sign : 1.0) * f, 1e-13, 1e-14);
    }
}

/* ---- Jacobians ---- */

static bool smooth(lg_activation kind) {
    return kind != LG_RELU && kind != LG_LEAKY_RELU;
}

/* Differences of fourth order for smooth networks; for others of second order with a very small step. */
static void against_differences(const example *e, double *x) {
    double y[MOST_OUTPUTS], by[MOST_OUTPUTS];
    double jacobian[MOST_OUTPUTS * MOST_INPUTS + 1];
    check_gradient(&e->value, &e->gradient, x, y, jacobian);
    const bool fourth = smooth(e->model.options.activation);
    const double tolerance = fourth ? 1e-8 : 1e-7;
    for (size_t input = 0; input < e->inputs; input++) {
        test_slope(run_value, &e->value, x, input, fourth ? 6e-4 : 1e-7, fourth ? 2 : 1, e->outputs, by);
        for (size_t o = 0; o < e->outputs; o++)
            assert_close(jacobian[o * e->inputs + input], by[o], tolerance, tolerance);
    }
}

/* Column 0, the derivative by s, must be the tangent. */
static void first_column(const example *e, const double *x) {
    double jacobian[2 * MOST_INPUTS], q[2], v[2];
    if (e->model.options.kind != LG_SURROGATE_CONTINUOUS) return;
    run_gradient(&e->gradient, x, NULL, jacobian);
    curve_of(&e->curves, x + 1, x, 1, q, v);
    for (size_t c = 0; c < 2; c++) assert_close(jacobian[9 * c], v[c], 1e-13, 1e-13);
}

static void all_checks(const lg_surrogate_options *options, double length) {
    example e = make(options, length);
    const double at[] = {0.0, 0.05 * length, 0.43 * length, length};
    double x[MOST_INPUTS];
    for (double side = -1.0; side <= 1.0; side += 2.0)
        for (size_t i = 0; i < LG_COUNT(at); i++) {
            place(&e, side, at[i], x);
            against_tape(&e, x);
            against_curve(&e, x);
            against_differences(&e, x);
            first_column(&e, x);
        }
}

static lg_surrogate_options options_of(lg_surrogate_kind kind) {
    return (lg_surrogate_options){.kind = kind,
                                  .architecture = LG_NET_MULT,
                                  .embedding = 0,
                                  .hidden = 7,
                                  .layers = 2,
                                  .activation = LG_TANH};
}

TEST("value and Jacobian are right for every architecture and number of layers, with and without an "
     "embedding") {
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

TEST("value and Jacobian are right for every activation in every architecture") {
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++)
        for (int activation = 0; activation < LG_ACTIVATION_COUNT; activation++)
            for (int net = 0; net < LG_NET_KIND_COUNT; net++) {
                lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
                o.architecture = (lg_net_kind)net;
                o.activation = (lg_activation)activation;
                all_checks(&o, TEST_LENGTH);
            }
}

TEST("every option is right for usual beams, and for beams so short that the corrections of the ends "
     "overlap") {
    static const double lengths[] = {TEST_LENGTH, 0.5, 0.1};
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++)
        for (unsigned flags = 0; flags < 32; flags++)
            for (size_t i = 0; i < 3; i++) {
                lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
                o.normalise = flags & 1;
                o.mirror = flags & 2;
                o.boundary = (flags & 4) && kind != LG_SURROGATE_DISCRETE;
                o.modes = (flags & 8) && kind == LG_SURROGATE_DISCRETE ? 3 : 0;
                o.angles = (flags & 16) && kind == LG_SURROGATE_DISCRETE && o.modes == 0;
                all_checks(&o, lengths[i]);
            }
}

TEST("a network with modes can be recorded only with the modes' numbers") {
    lg_surrogate_options o = options_of(LG_SURROGATE_DISCRETE);
    lg_program *program;
    lg_error error;
    o.modes = 3;
    example e = make(&o, TEST_LENGTH);
    e.model.modes = NULL;
    assert_status(lg_surrogate_program(NULL, &e.model, e.theta, &program, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "3 modes"));
}

TEST("fixed end angles are the given ones for any network, and so are their derivatives") {
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
                    run_gradient(&e.gradient, x, &y, jacobian);
                    const size_t at = end == 0 ? 3 : 7;
                    const double *v = x + at, square = v[0] * v[0] + v[1] * v[1];
                    assert_close(y, atan2(v[1], v[0]), 1e-14, 0);
                    for (size_t c = 1; c < 9; c++) {
                        const double wanted = c == at ? -v[1] / square : c == at + 1 ? v[0] / square : 0.0;
                        assert_close(jacobian[c], wanted, 1e-13, 1e-13);
                    }
                }
}

TEST("a continuous network with fixed ends passes through them with their tangents, for any parameters") {
    lg_surrogate_options o = options_of(LG_SURROGATE_CONTINUOUS);
    o.boundary = true;
    for (int mirror = 0; mirror < 2; mirror++)
        for (double side = -1.0; side <= 1.0; side += 2.0)
            for (size_t end = 0; end < 2; end++) {
                o.mirror = mirror;
                example e = make(&o, TEST_LENGTH);
                double x[9], y[2], jacobian[18];
                place(&e, side, end == 0 ? 0.0 : TEST_LENGTH, x);
                run_gradient(&e.gradient, x, y, jacobian);
                const size_t at = end == 0 ? 1 : 5;
                assert_all_close(y, x + at, 2, 1e-14, 1e-14);
                for (size_t i = 0; i < 2; i++) /* dq/ds = v, and dq/dx is the identity for the end itself */
                    for (size_t c = 0; c < 9; c++)
                        assert_close(jacobian[9 * i + c],
                                     c == 0        ? x[at + 2 + i]
                                     : c == at + i ? 1.0
                                                   : 0.0,
                                     1e-13, 1e-13);
            }
}

TEST("moving a beam moves its curve, and reflecting it reflects value and Jacobian exactly") {
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
        run_gradient(&e.gradient, x, y, a);
        run_gradient(&e.gradient, image, z, b);
        for (size_t o_ = 0; o_ < e.outputs; o_++) {
            const double row = kind == LG_SURROGATE_ANGLE || o_ % 2 == 1 ? -1.0 : 1.0;
            assert_close(z[o_], row * y[o_], 0, 0);
            for (size_t i = 0; i < e.inputs; i++) {
                const double column = i >= first && (i - first) % 2 == 1 ? -1.0 : 1.0;
                assert_close(b[o_ * e.inputs + i], row * column * a[o_ * e.inputs + i], 0, 0);
            }
            for (size_t c = 0; c < 2; c++) { /* the derivatives by q0 and qN together, which move the beam */
                const double *by = a + o_ * e.inputs + first;
                const bool point =
                    kind == LG_SURROGATE_CONTINUOUS || (kind == LG_SURROGATE_DISCRETE && o_ < e.outputs / 2);
                assert_close(by[c] + by[4 + c], point && o_ % 2 == c ? 1.0 : 0.0, 1e-15, 1e-15);
            }
        }
    }
}

TEST("if the first numbers that decide about the reflection are zero, the next ones decide") {
    static const double ends[][8] = {
        {0.1, -0.2, 0.8, 0.5, 2.6, 0.3, 0.9, 0.5}, {0.1, -0.2, 0.8, -0.5, 2.6, 0.3, 0.9, -0.5},
        {0.1, -0.2, 1.0, 0.0, 2.6, 0.3, 1.0, 0.0}, {0.1, 0.2, 1.0, 0.0, 2.6, -0.3, 1.0, 0.0},
        {0.1, 0.2, 1.0, 0.0, 2.6, 0.2, 1.0, 0.0},  {0.1, 0.2, -1.0, 0.0, 2.6, 0.4, 1.0, -0.1},
        {0.1, 0.2, -1.0, 0.0, 2.6, 0.4, 1.0, 0.1}, {0.1, 0.2, -1.0, -0.0, 2.6, 0.4, 1.0, 0.1}};
    for (int kind = 0; kind < LG_SURROGATE_KIND_COUNT; kind++) {
        lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
        o.mirror = true;
        example e = make(&o, TEST_LENGTH);
        for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
            double x[MOST_INPUTS] = {1.1};
            memcpy(x + e.inputs - 8, ends[i], sizeof ends[i]);
            against_tape(&e, x);
        }
    }
}

TEST("the function along a curve equals the value at each of its places") {
    enum { PLACES = 4 };
    for (int kind = LG_SURROGATE_CONTINUOUS; kind < LG_SURROGATE_KIND_COUNT; kind++)
        for (unsigned flags = 0; flags < 4; flags++) {
            lg_surrogate_options o = options_of((lg_surrogate_kind)kind);
            o.mirror = flags & 1;
            o.boundary = (flags & 2) && kind == LG_SURROGATE_ANGLE;
            example e = make(&o, TEST_LENGTH);
            double x[PLACES][MOST_INPUTS], s[PLACES], q[2 * PLACES], v[2 * PLACES], curve[5];
            const ready point = make_ready(e.program, "point", PLACES, LG_F64);
            for (size_t i = 0; i < PLACES; i++) {
                s[i] = TEST_LENGTH * (double)i / (PLACES - 1);
                place(&e, -1.0, s[i], x[i]);
            }
            const double *shared = x[0] + 1;
            if (kind == LG_SURROGATE_ANGLE) {
                const ready of_curve = make_ready(e.program, "ends", 1, LG_F64);
                run_value(&of_curve, shared, curve);
                shared = curve;
            }
            lg_plan_eval(point.plan, (const void *const[]){s, shared}, (void *const[]){q, v}, point.work);
            for (size_t i = 0; i < PLACES; i++) {
                double y[2], jacobian[2 * MOST_INPUTS];
                run_gradient(&e.gradient, x[i], y, jacobian);
                for (size_t c = 0; c < e.outputs; c++) {
                    assert_close(q[e.outputs * i + c], y[c], 1e-14, 1e-14);
                    if (kind == LG_SURROGATE_CONTINUOUS)
                        assert_close(v[2 * i + c], jacobian[9 * c], 1e-13, 1e-13);
                }
            }
        }
}

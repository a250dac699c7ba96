/* Detectors as programs, with their Jacobians.
 *
 * The program takes a window x (channels, length) as recorded, and the network reads the scaled window z
 * (length, channels),
 *   z_tc = (x_ct - m_c - mean_c)/scale_c.
 * For `centred` models m_c is the mean of channel c over the window, otherwise 0. mean_c is the sum of two
 * parameters: `mean`, which is rounded to single precision, and the remainder `mean_rest`. m_c is computed
 * from the differences between the samples and the window's first sample. A large constant offset of a sensor
 * therefore causes no rounding errors, even if the program runs in single precision. */
#include "core/clean.h"
#include "liegrad/anomaly.h"
#include "liegrad/ops.h"
#include "anomaly/detector_internal.h"
#include "model/record.h"
#include "nn/cnn.h"

enum { THETA, MEAN, MEAN_REST, INVERSE_SCALE, PARAMETERS };

/* x (B, channels, length) -> z (B, length, channels) */
static lg_var scaled(lg_tape *t, const lg_detector *model, const lg_var *theta, lg_var x) {
    const lg_shape column = lg_shape2(model->net.channels, 1);
    if (model->centred) {
        x = lg_sub(t, x, lg_stop_gradient(t, lg_slice(t, x, 2, 0, 1)));
        x = lg_sub(t, x, lg_mean_axis(t, x, 2, true));
    }
    x = lg_sub(t, x, lg_reshape(t, theta[MEAN], column));
    x = lg_sub(t, x, lg_reshape(t, theta[MEAN_REST], column));
    return lg_transpose(t, lg_mul(t, x, lg_reshape(t, theta[INVERSE_SCALE], column)));
}

/* Logits (B, outputs) -> probabilities (B, classes). With two classes and one logit, a small probability has
 * the full relative accuracy. */
static lg_var probabilities(lg_tape *t, const lg_detector *model, lg_var y) {
    if (model->loss == LG_DETECTOR_MSE) {
        const lg_var both[2] = {lg_neg(t, y), y};
        return lg_act(t, lg_concat(t, both, 2, 1), LG_SIGMOID);
    }
    return lg_record_softmax(t, y);
}

static lg_status value(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_detector *model = user;
    y[0] = lg_cnn_record(t, &model->net, theta[THETA], 0, scaled(t, model, theta, x[0]), NULL);
    return lg_tape_status(t);
}

/* The logits, with the recording of the network that suits programs with derivatives. */
static lg_status value_apart(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_detector *model = user;
    y[0] = lg_cnn_record_apart(t, &model->net, theta[THETA], scaled(t, model, theta, x[0]));
    return lg_tape_status(t);
}

static lg_status gradient(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    return lg_record_gradient(value_apart, user, t, theta, x, false, y);
}

static lg_status probability(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = probabilities(t, user, lg_program_call(t, "value", 0, x));
    return lg_tape_status(t);
}

/* Outputs the probabilities and the plane of a window that is already scaled. */
static lg_status scores(void *user, lg_tape *t, const lg_var *theta, const lg_var *z, lg_var *y) {
    const lg_detector *model = user;
    lg_var plane;
    y[0] = probabilities(t, model, lg_cnn_record(t, &model->net, theta[THETA], 0, z[0], &plane));
    if (model->net.plane > 0) y[1] = plane;
    return lg_tape_status(t);
}

lg_status lg_detector_build(const lg_context *context, const lg_detector *model, const lg_scaler *scaler,
                            const double *theta, bool scores_alone, lg_program **out, lg_error *error) {
    void *const user = (void *)(uintptr_t)model; /* never written */
    const uint32_t channels = model->net.channels;
    LG_TRY_SCRATCH(double, mean, context, 3 * (size_t)channels,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a detector's scaling"));
    double *rest = mean + channels, *inverse = rest + channels;
    for (uint32_t c = 0; c < channels; c++) {
        mean[c] = (double)(float)scaler->mean[c];
        rest[c] = scaler->mean[c] - mean[c];
        inverse[c] = 1.0 / scaler->scale[c];
    }
    const lg_port window = {.name = "x", .shape = lg_shape2(channels, model->net.length)};
    const lg_port scaled_window = {.name = "z", .shape = lg_shape2(model->net.length, channels)};
    const lg_port values[] = {{.name = "y"}, {.name = "g"}};
    const lg_port score[] = {{.name = "probability"}, {.name = "plane"}};
    const lg_function_spec functions[] = {
        {"value", &window, 1, values, 1, value, user},
        {"grad", &window, 1, values, 2, gradient, user},
        {"probability", &window, 1, score, 1, probability, user},
        {"scores", &scaled_window, 1, score, model->net.plane > 0 ? 2 : 1, scores, user}};
    enum { SCORES = LG_COUNT(functions) - 1 };
    const lg_parameter_spec parameters[PARAMETERS] = {
        [THETA] = {"theta", lg_shape1((uint32_t)lg_cnn_parameters(&model->net)), theta},
        [MEAN] = {"mean", lg_shape1(channels), mean},
        [MEAN_REST] = {"mean_rest", lg_shape1(channels), rest},
        [INVERSE_SCALE] = {"inverse_scale", lg_shape1(channels), inverse}};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = PARAMETERS;
    spec.functions = scores_alone ? functions + SCORES : functions;
    spec.function_count = scores_alone ? 1 : LG_COUNT(functions);
    spec.description = "detector of the class of a window";
    return lg_program_build(context, &spec, out, error);
}

lg_status lg_detector_program(const lg_context *context, const lg_detector *model, const lg_scaler *scaler,
                              const double *theta, lg_program **out, lg_error *error) {
    LG_NEEDS(error, model, scaler, theta, out);
    return lg_detector_build(context, model, scaler, theta, false, out, error);
}

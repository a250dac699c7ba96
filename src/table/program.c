/* Table networks as programs. The mean of the inputs is stored as the sum of two parameters, the first of
 * which is a single-precision number. In single precision an offset of the inputs then makes no rounding
 * errors. */
#include "core/clean.h"
#include "model/record.h"
#include "table/internal.h"

enum { THETA, MEAN, MEAN_REST, INVERSE_SCALE, OUTPUT_MEAN, OUTPUT_SCALE, PARAMETERS };

static lg_var value_of(lg_tape *t, const lg_table *model, const lg_var *theta, lg_var x) {
    x = lg_sub(t, lg_sub(t, x, theta[MEAN]), theta[MEAN_REST]);
    const lg_var f = lg_table_record(t, model, theta[THETA], lg_mul(t, x, theta[INVERSE_SCALE]), NULL);
    if (model->options.task == LG_TABLE_CLASSIFICATION) return f;
    return lg_add(t, lg_mul(t, f, theta[OUTPUT_SCALE]), theta[OUTPUT_MEAN]);
}

static lg_status value(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = value_of(t, user, theta, x[0]);
    return lg_tape_status(t);
}

static lg_status gradient(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    const lg_table *model = user;
    return lg_record_gradient(value, user, t, theta, x, model->net.inputs < model->net.outputs, y);
}

static lg_status probability(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    y[0] = lg_record_softmax(t, lg_program_call(t, "value", 0, x));
    return lg_tape_status(t);
}

static lg_status check_scaler(const lg_scaler *scaler, uint32_t columns, const char *what, lg_error *error) {
    if (scaler != NULL && scaler->channels == columns && scaler->mean != NULL && scaler->scale != NULL)
        return LG_OK;
    return lg_fail(error, LG_INVALID_ARGUMENT, "the scaling of the %s does not have %u columns", what,
                   columns);
}

lg_status lg_table_program(const lg_context *context, const lg_table *model, const lg_scaler *inputs,
                           const lg_scaler *outputs, const double *theta, lg_program **out, lg_error *error) {
    LG_NEEDS(error, model, inputs, theta, out);
    void *const user = (void *)(uintptr_t)model; /* never written */
    const uint32_t n = model->net.inputs, m = model->net.outputs;
    const bool regression = model->options.task == LG_TABLE_REGRESSION;
    LG_TRY(check_scaler(inputs, n, "inputs", error));
    if (regression) LG_TRY(check_scaler(outputs, m, "outputs", error));
    LG_TRY_SCRATCH(double, mean, context, 3 * (size_t)n,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the scaling of a table"));
    double *rest = mean + n, *inverse = rest + n;
    for (uint32_t c = 0; c < n; c++) {
        const float near = (float)inputs->mean[c];
        mean[c] =
            /* A mean beyond the range of single precision is stored in `rest` alone. */
            near - near == 0.0F ? (double)near : 0.0;
        rest[c] = inputs->mean[c] - mean[c];
        inverse[c] = 1.0 / inputs->scale[c];
    }
    const lg_port x = {.name = "x", .shape = lg_shape1(n)};
    const lg_port values[] = {{.name = "y"}, {.name = "g"}}, chances = {.name = "probability"};
    const lg_function_spec functions[] = {{"value", &x, 1, values, 1, value, user},
                                          {"grad", &x, 1, values, 2, gradient, user},
                                          {"probability", &x, 1, &chances, 1, probability, user}};
    const lg_parameter_spec parameters[PARAMETERS] = {
        [THETA] = {"theta", lg_shape1((uint32_t)lg_table_parameters(model)), theta},
        [MEAN] = {"mean", lg_shape1(n), mean},
        [MEAN_REST] = {"mean_rest", lg_shape1(n), rest},
        [INVERSE_SCALE] = {"inverse_scale", lg_shape1(n), inverse},
        [OUTPUT_MEAN] = {"output_mean", lg_shape1(m), regression ? outputs->mean : NULL},
        [OUTPUT_SCALE] = {"output_scale", lg_shape1(m), regression ? outputs->scale : NULL}};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    spec.parameters = parameters;
    spec.parameter_count = regression ? PARAMETERS : OUTPUT_MEAN;
    spec.functions = functions;
    spec.function_count = regression ? 2 : 3;
    spec.description = regression ? "regression of a table" : "classification of a table";
    return lg_program_build(context, &spec, out, error);
}

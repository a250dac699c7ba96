/* Table networks: description, parameters, scaling. */
#include "liegrad/ops.h"
#include "liegrad/table.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/clean.h"
#include "core/rounding.h"
#include "table/internal.h"

static const char *const task_names[LG_TABLE_TASK_COUNT] = {"regression", "classification"};

const char *lg_table_task_name(lg_table_task task) {
    return (unsigned)task < LG_TABLE_TASK_COUNT ? task_names[task] : NULL;
}

/* ---- description ---- */

lg_status lg_table_init(lg_table *model, const lg_table_options *options, uint32_t inputs, uint32_t outputs,
                        lg_error *error) {
    LG_NEEDS(error, model, options);
    if ((unsigned)options->task >= LG_TABLE_TASK_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown task");
    if (options->task == LG_TABLE_CLASSIFICATION && outputs < 2)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%u classes; a classification has two at least", outputs);
    if (options->hidden_count < 1 || options->hidden_count > LG_TABLE_LAYERS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%u hidden layers; 1 to %d are possible",
                       options->hidden_count, LG_TABLE_LAYERS);
    for (uint32_t i = 1; i < options->hidden_count; i++)
        if (options->hidden[i] != options->hidden[0])
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "hidden layers of widths %u and %u: all must have the same width, as in 32,32",
                           options->hidden[0], options->hidden[i]);
    lg_table made = {.options = *options};
    if (lg_net_init(&made.net, options->network, inputs, 0, options->hidden[0], options->hidden_count - 1,
                    outputs, options->activation) != LG_OK)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "no network is possible with %u inputs, %u layers of width %u and %u outputs: widths "
                       "must be 1 to 2^20",
                       inputs, options->hidden_count, options->hidden[0], outputs);
    *model = made;
    return LG_OK;
}

size_t lg_table_parameters(const lg_table *model) {
    const size_t linear = model->options.linear ? (size_t)model->net.inputs * model->net.outputs : 0;
    return lg_net_parameters(&model->net) + linear;
}

bool lg_table_slice(const lg_table *model, uint32_t index, lg_slice_info *out) {
    lg_slice_info info;
    uint32_t slices = 0;
    if (lg_net_slice(&model->net, index, out)) return true;
    while (lg_net_slice(&model->net, slices, &info)) slices++;
    if (!model->options.linear || index != slices) return false;
    *out = (lg_slice_info){.rank = 2,
                           .dims = {model->net.inputs, model->net.outputs},
                           .offset = lg_net_parameters(&model->net),
                           .count = (size_t)model->net.inputs * model->net.outputs};
    (void)snprintf(out->name, sizeof out->name, "linear/weight");
    return true;
}

void lg_table_initialise(const lg_table *model, lg_rng *rng, double *theta) {
    const size_t net = lg_net_parameters(&model->net);
    lg_net_initialise(&model->net, rng, theta);
    memset(theta + net, 0, (lg_table_parameters(model) - net) * sizeof *theta);
}

/* ---- scaling ---- */

/* Mean and deviation in two passes, about the first value, so that a large offset costs no digits, and in
 * units of half the range, because squares may overflow. */
static lg_status fit_column(const double *values, uint32_t columns, const uint32_t *chosen, size_t count,
                            double *mean, double *scale) {
    const double first = values[(chosen != NULL ? chosen[0] : 0) * columns];
    double low = first, high = first, sum = 0, squares = 0;
    for (size_t i = 0; i < count; i++) {
        const double value = values[(chosen != NULL ? chosen[i] : i) * columns];
        if (!isfinite(value)) return LG_NOT_FINITE;
        low = fmin(low, value);
        high = fmax(high, value);
    }
    const double unit = 0.5 * high - 0.5 * low, size = fmax(fabs(low), fabs(high));
    for (size_t i = 0; i < count && unit > 0; i++)
        sum += (0.5 * values[(chosen != NULL ? chosen[i] : i) * columns] - 0.5 * first) / unit;
    sum /= (double)count;
    for (size_t i = 0; i < count && unit > 0; i++) {
        const double off =
            (0.5 * values[(chosen != NULL ? chosen[i] : i) * columns] - 0.5 * first) / unit - sum;
        squares += off * off;
    }
    const double deviation = 2.0 * (sqrt(squares / (double)count) * unit);
    *mean = 2.0 * (0.5 * first + sum * unit);
    *scale = !lg_is_rounding(unit, 0.5 * size) && deviation >= DBL_MIN ? deviation : 1.0;
    return LG_OK;
}

lg_status lg_table_scaler_fit(const lg_context *context, const double *values, uint32_t columns,
                              const uint32_t *chosen, size_t count, lg_scaler *out) {
    if (values == NULL || out == NULL || count == 0) return LG_INVALID_ARGUMENT;
    LG_CLEAN(lg_scaler_destroy) lg_scaler made = {.channels = columns, .context = context};
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(made.mean, columns), LG_ARRAY(made.scale, columns)));
    for (uint32_t c = 0; c < columns; c++)
        LG_TRY(fit_column(values + c, columns, chosen, count, &made.mean[c], &made.scale[c]));
    return LG_GIVE(out, made);
}

/* ---- on a tape ---- */

lg_var lg_table_record(lg_tape *tape, const lg_table *model, lg_var theta, lg_var z, lg_net_tap *taps) {
    const lg_net *net = &model->net;
    const size_t parameters = lg_net_parameters(net), linear = (size_t)net->inputs * net->outputs;
    const lg_var y = lg_net_record_taps(tape, net, theta, 0, z, taps);
    if (!model->options.linear) return y;
    const lg_var flat = lg_slice(tape, theta, 0, (uint32_t)parameters, (uint32_t)linear);
    return lg_matmul_add(tape, z, lg_reshape(tape, flat, lg_shape2(net->inputs, net->outputs)), y);
}

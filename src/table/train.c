/* Table networks as a fit problem: loss, residuals and their Jacobian. */
#include <math.h>
#include <string.h>

#include "liegrad/ops.h"

#include "core/core.h"
#include "kernels/kernels.h"
#include "model/record.h"
#include "table/internal.h"

/* Samples that are recorded on a tape at once. */
enum { CHUNK = 256 };

/* Rows `samples` of values (.., columns) as a variable (count, columns). */
static lg_var put_rows(lg_tape *tape, const double *values, uint32_t columns, const uint32_t *samples,
                       size_t count) {
    return lg_record_rows(tape, LG_F64, values, lg_shape2((uint32_t)count, columns), samples);
}

/* The residuals f - t of a regression, (count, outputs). */
static lg_var differences(const lg_table_problem *problem, lg_tape *tape, lg_var theta,
                          const uint32_t *samples, size_t count) {
    const lg_net *net = &problem->model->net;
    const lg_var z = put_rows(tape, problem->samples->x, net->inputs, samples, count);
    const lg_var t = put_rows(tape, problem->samples->y, net->outputs, samples, count);
    return lg_sub(tape, lg_table_record(tape, problem->model, theta, z, NULL), t);
}

static lg_status loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                      size_t batch, lg_var *out) {
    const lg_table_problem *problem = user;
    const lg_net *net = &problem->model->net;
    const double share = (double)count / (double)batch;
    if (problem->model->options.task == LG_TABLE_REGRESSION) {
        const lg_var r = differences(problem, tape, theta, samples, count);
        *out = lg_scale(tape, lg_mean(tape, lg_square(tape, r)), share);
        return lg_tape_status(tape);
    }
    const lg_var z = put_rows(tape, problem->samples->x, net->inputs, samples, count);
    const lg_var f = lg_table_record(tape, problem->model, theta, z, NULL);
    const lg_var t = lg_record_labels(tape, problem->samples->label, net->outputs, samples, (uint32_t)count);
    *out = lg_scale(tape, lg_loss_record(tape, LG_LOSS_CROSS_ENTROPY, f, t, LG_NONE), share);
    return lg_tape_status(tape);
}

/* Factor of the residuals r that makes r.r their part of the loss. */
static double factor_of(const lg_table_problem *problem, size_t batch) {
    return 1.0 / sqrt((double)batch * problem->model->net.outputs);
}

static lg_status residuals(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *r) {
    const lg_table_problem *problem = user;
    *r = lg_scale(tape, differences(problem, tape, theta, samples, count), factor_of(problem, batch));
    return lg_tape_status(tape);
}

/* ---- the Jacobian of the residuals ---- */

/* Fills the entries of the Jacobian for the weights and the bias of one dense layer and for one output of the
 * network; the rows of consecutive samples begin `stride` numbers apart. `in` (count, layer->in): the
 * layer's inputs; `by` (count, layer->out): derivative of the output with respect to the layer's outputs. */
static void fill_layer(const lg_layer *layer, const double *in, const double *by, size_t count, double factor,
                       size_t stride, double *jacobian) {
    for (size_t i = 0; i < count; i++, in += layer->in, by += layer->out, jacobian += stride) {
        double *weight = jacobian + layer->weight, *bias = jacobian + layer->bias;
        for (uint32_t a = 0; a < layer->in; a++)
            for (uint32_t b = 0; b < layer->out; b++) weight[a * layer->out + b] = factor * in[a] * by[b];
        for (uint32_t b = 0; layer->has_bias && b < layer->out; b++) bias[b] = factor * by[b];
    }
}

/* Fills the columns of A in the same rows. Output `output` is z times column `output` of A. */
static void fill_linear(const lg_table *model, const double *z, size_t count, uint32_t output, double factor,
                        size_t stride, double *jacobian) {
    const uint32_t in = model->net.inputs, out = model->net.outputs;
    if (!model->options.linear) return;
    double *to = jacobian + lg_net_parameters(&model->net);
    for (size_t i = 0; i < count; i++, to += stride, z += in) {
        memset(to, 0, (size_t)in * out * sizeof *to);
        for (uint32_t a = 0; a < in; a++) to[a * out + output] = factor * z[a];
    }
}

/* Fills the rows of J for one output by one reverse sweep. */
static lg_status fill_output(lg_tape *tape, const lg_table *model, const lg_layers *layers,
                             const lg_net_tap *taps, lg_var f, size_t count, uint32_t output, double factor,
                             double *jacobian) {
    const uint32_t outputs = model->net.outputs;
    const size_t stride = lg_table_parameters(model) * outputs;
    lg_var given[NET_MAX_DENSE], by[NET_MAX_DENSE];
    const lg_mark mark = lg_tape_mark(tape);
    const lg_var g = lg_record_units(tape, (uint32_t)count, 1, output, outputs);
    for (uint32_t i = 0; i < layers->count; i++) given[i] = taps[i].output;
    LG_TRY(lg_vjp(tape, &f, &g, 1, given, layers->count, by));
    for (uint32_t i = 0; i < layers->count; i++) {
        const double *in = lg_value(tape, taps[i].input), *slope = lg_value(tape, by[i]);
        if (in == NULL || slope == NULL) return lg_tape_status(tape);
        fill_layer(&layers->layer[i], in, slope, count, factor, stride, jacobian);
    }
    return lg_tape_rewind(tape, mark);
}

lg_status lg_table_linearise(const lg_table_problem *problem, lg_tape *tape, const double *theta,
                             const uint32_t *samples, size_t count, double factor, double *r,
                             double *jacobian) {
    const lg_table *model = problem->model;
    const size_t n = lg_table_parameters(model);
    const uint32_t inputs = model->net.inputs, outputs = model->net.outputs;
    const lg_layers layers = lg_net_layers(&model->net);
    lg_net_tap taps[NET_MAX_DENSE];
    lg_tape_reset(tape);
    const lg_var z = put_rows(tape, problem->samples->x, inputs, samples, count);
    const lg_var f = lg_table_record(tape, model, lg_parameter(tape, lg_shape1((uint32_t)n), theta), z, taps);
    LG_TRY(lg_read(tape, f, count * outputs, r));
    for (size_t i = 0; i < count; i++)
        for (uint32_t o = 0; o < outputs; o++)
            r[i * outputs + o] =
                factor * (r[i * outputs + o] - problem->samples->y[(size_t)samples[i] * outputs + o]);
    for (uint32_t o = 0; o < outputs; o++) {
        LG_TRY(fill_output(tape, model, &layers, taps, f, count, o, factor, jacobian + o * n));
        fill_linear(model, lg_value(tape, z), count, o, factor, n * outputs, jacobian + o * n);
    }
    return LG_OK;
}

static lg_status linearise(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                           size_t count, size_t batch, double *out, double *r, double *jacobian) {
    const lg_table_problem *problem = user;
    const size_t numbers = count * problem->model->net.outputs;
    LG_TRY(lg_table_linearise(problem, tape, theta, samples, count, factor_of(problem, batch), r, jacobian));
    *out = 0.0;
    for (size_t i = 0; i < numbers; i++) *out += r[i] * r[i];
    return LG_OK;
}

void lg_table_fit_problem(const lg_table_problem *problem, lg_fit_problem *out) {
    const lg_table_samples *samples = problem->samples;
    const bool squares = problem->model->options.task == LG_TABLE_REGRESSION;
    const uint32_t outputs = problem->model->net.outputs;
    *out = (lg_fit_problem){.parameters = lg_table_parameters(problem->model),
                            .samples = samples->count,
                            .loss = loss,
                            .user = (void *)(uintptr_t)problem, /* never written */
                            .validation = samples->count - samples->training,
                            .residuals = squares ? residuals : NULL,
                            .linearise = squares ? linearise : NULL,
                            .rows = squares ? outputs : 0,
                            .observations = squares ? samples->training * outputs : 0,
                            .decay = problem->decay,
                            .chunk = CHUNK};
}

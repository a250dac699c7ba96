/* Training loss of the discrete network: values at the nodes, or coefficients of modes. */
#include <math.h>

#include "liegrad/ops.h"
#include "elastica/surrogate_loss.h"

typedef lg_loss_part part;
typedef lg_loss_curve curve;

/* Mean square of the differences of d (B, 4(N - 1)) between neighbouring nodes, where d is zero at the ends:
 * 4N differences per sample. In the shape (B, 2, 2(N + 1)) the same component at the next node is two places
 * further. */
static lg_var rough(lg_tape *tape, lg_var d, uint32_t count, uint32_t intervals) {
    lg_var nodes = lg_reshape(tape, d, lg_shape3(count, 2, 2 * (intervals - 1)));
    nodes = lg_pad(tape, nodes, 2, 2, 2);
    return lg_mse(tape, lg_slice(tape, nodes, 2, 2, 2 * intervals),
                  lg_slice(tape, nodes, 2, 0, 2 * intervals));
}

/* Mean square of W d for d (B, 4(N - 1)), W = I + gamma G'G, G = S - I (docs/beams.md). */
static lg_var weighted(lg_tape *tape, lg_var d, double gamma) {
    const uint32_t n = lg_var_shape(tape, d).dims[1];
    const lg_var next = lg_pad(tape, lg_slice(tape, d, 1, 1, n - 1), 1, 0, 1);
    const lg_var step = lg_sub(tape, next, d);
    const lg_var before = lg_pad(tape, lg_slice(tape, step, 1, 0, n - 1), 1, 1, 0);
    const lg_var wd = lg_add(tape, d, lg_scale(tape, lg_sub(tape, before, step), gamma));
    return lg_mean(tape, lg_square(tape, wd));
}

static lg_var inputs_of(const part *b) {
    void *rows;
    const lg_shape shape = lg_shape2((uint32_t)b->count, b->problem->model->net.inputs);
    const lg_var x = lg_input_buffer(b->tape, shape, &rows);
    if (lg_is_none(x)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = lg_loss_curve_at(b, b->samples[i]);
        lg_loss_put_row(b, rows, i, &c, 0.0);
    }
    return x;
}

/* Errors of the network's nodes and tangents (B, 4(N - 1)). */
static lg_var curve_errors(const part *b, lg_var theta) {
    const lg_surrogate *model = b->problem->model;
    const uint32_t count = (uint32_t)b->count, inner = model->intervals - 1;
    void *values;
    const lg_var x = inputs_of(b);
    const lg_var target = lg_input_buffer(b->tape, lg_shape2(count, 4 * inner), &values);
    if (lg_is_none(target)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = lg_loss_curve_at(b, b->samples[i]);
        lg_loss_put_points(b, values, 4 * inner * i, c.q + 2, inner, c.x + LG_AT_Q0, c.sign);
        lg_loss_put_points(b, values, 4 * inner * i + 2 * inner, c.v + 2, inner, lg_loss_origin, c.sign);
    }
    return lg_sub(b->tape, lg_surrogate_net(b->tape, model, theta, x), target);
}

/* Loss of a network with modes: sum_k s_k^2 (c_k - c_k*)^2, divided by the 4(N - 1) numbers of a curve. */
static lg_var modes_loss(const part *b, lg_var theta) {
    const lg_surrogate *model = b->problem->model;
    const uint32_t modes = model->options.modes, n = lg_surrogate_outputs(model);
    void *values, *weights;
    const lg_var x = inputs_of(b);
    const lg_var target = lg_input_buffer(b->tape, lg_shape2((uint32_t)b->count, modes), &values);
    const lg_var weight = lg_input_buffer(b->tape, lg_shape2(1, modes), &weights);
    if (lg_is_none(weight)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++)
        lg_put_numbers(lg_tape_dtype(b->tape), values, modes * i,
                       b->problem->coefficients + modes * (size_t)b->samples[i], modes);
    for (size_t k = 0; k < modes; k++) {
        const double *vector = model->modes + n * (k + 1);
        double square = 0.0;
        for (size_t i = 0; i < n; i++) square += vector[i] * vector[i];
        const double scale = sqrt(square * modes / n);
        lg_put_numbers(lg_tape_dtype(b->tape), weights, k, &scale, 1);
    }
    const lg_var d = lg_sub(b->tape, lg_net_record(b->tape, &model->net, theta, 0, x), target);
    return lg_mean(b->tape, lg_square(b->tape, lg_mul(b->tape, d, weight)));
}

/* Returns L/EI times the sum of the energies of the data's curves: E of liegrad/elastica.h, computed from
 * their tangents with 1 - cos(theta_{k+1} - theta_k) = |v_{k+1} - v_k|^2/2. */
static double given_energy(const part *b) {
    const double length = b->problem->model->length;
    const uint32_t n = b->problem->model->intervals;
    double sum = 0.0;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = lg_loss_curve_at(b, b->samples[i]);
        double bend = 0.0, r[2] = {c.x[LG_AT_QN] - c.x[LG_AT_Q0], c.x[LG_AT_QN + 1] - c.x[LG_AT_Q0 + 1]};
        for (size_t k = 0; k < 2 * (size_t)n; k++) {
            const double step = c.v[k + 2] - c.v[k];
            bend += 0.5 * step * step;
            r[k % 2] -= 0.5 * length / n * (c.v[k] + c.v[k + 2]);
        }
        sum += n * bend + 18.0 * n * n / (length * length) * (r[0] * r[0] + r[1] * r[1]);
    }
    return sum;
}

/* Mean of (E - E_curve) L/EI. E uses 1 - cos(a) = 2 sin^2(a/2). */
static lg_var energy_loss(const part *b, lg_var theta) {
    const lg_surrogate *model = b->problem->model;
    const uint32_t n = model->intervals, rows = (uint32_t)b->count;
    lg_tape *t = b->tape;
    const lg_var x = inputs_of(b), angles = lg_surrogate_node_angles(t, model, theta, x);
    const lg_var turns = lg_sub(t, lg_slice(t, angles, 1, 1, n), lg_slice(t, angles, 1, 0, n));
    const lg_var bend = lg_sum(t, lg_square(t, lg_sin(t, lg_scale(t, turns, 0.5))));
    void *values;
    const lg_var trapezoid = lg_input_buffer(t, lg_shape2(n + 1, 1), &values);
    if (lg_is_none(trapezoid)) return LG_NONE;
    for (uint32_t k = 0; k <= n; k++) {
        const double weight = (k == 0 || k == n ? 0.5 : 1.0) * model->length / n;
        lg_put_numbers(lg_tape_dtype(t), values, k, &weight, 1);
    }
    const lg_var reached[2] = {lg_matmul(t, lg_cos(t, angles), trapezoid),
                               lg_matmul(t, lg_sin(t, angles), trapezoid)};
    const lg_var r = lg_sub(t, lg_surrogate_chord(t, model, x), lg_concat(t, reached, 2, 1));
    const double weights[2] = {2.0 * n, 18.0 * n * n / (model->length * model->length)};
    const lg_var terms[2] = {bend, lg_sum(t, lg_square(t, r))};
    const lg_var sum = lg_linear_combination(t, terms, weights, 2);
    return lg_scale(t, lg_add_scalar(t, sum, -given_energy(b)), 1.0 / rows);
}

static lg_var discrete_error(const part *b, lg_var theta) {
    const lg_surrogate *model = b->problem->model;
    if (model->options.modes > 0 && model->options.gamma == 0.0) return modes_loss(b, theta);
    const lg_var d = curve_errors(b, theta);
    if (model->options.penalty == LG_SURROGATE_WEIGHTED) return weighted(b->tape, d, model->options.gamma);
    const lg_var loss = lg_loss_mean_square(b->tape, d);
    if (model->options.gamma == 0.0) return loss;
    const lg_var differences = rough(b->tape, d, (uint32_t)b->count, model->intervals);
    return lg_add(b->tape, loss, lg_scale(b->tape, differences, model->options.gamma));
}

lg_var lg_loss_discrete(const part *b, lg_var theta) {
    const lg_surrogate_options *options = &b->problem->model->options;
    if (options->loss == LG_SURROGATE_ENERGY) return energy_loss(b, theta);
    const lg_var loss = discrete_error(b, theta);
    return options->energy == 0.0 ? loss : lg_loss_add(b, loss, options->energy, energy_loss(b, theta));
}

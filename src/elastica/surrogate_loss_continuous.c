/* Training loss of the continuous network (q, v)(s). */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/ops.h"
#include "elastica/surrogate_loss.h"

typedef lg_loss_part part;
typedef lg_loss_curve curve;

bool lg_loss_has_mechanics(const lg_surrogate *model) {
    return model->options.energy > 0.0 || model->options.residual > 0.0;
}

bool lg_loss_samples_are_points(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_CONTINUOUS && !lg_loss_has_mechanics(model);
}

/* Derivative of y along s at the network's inputs (s/L, ends), x (B, 9). */
static lg_var along_s(const part *b, lg_var x, lg_var y) {
    const double tangent[9] = {1.0 / b->problem->model->length};
    const lg_var row = lg_input_f64(b->tape, lg_shape2(1, 9), tangent);
    const lg_var along = lg_broadcast_to(b->tape, row, lg_var_shape(b->tape, x));
    lg_var out = LG_NONE;
    (void)lg_jvp(b->tape, &y, 1, &x, &along, 1, &out);
    return out;
}

/* Number of point i of a part: its curve times the number of nodes, plus its node. */
static uint32_t point_number(const part *b, size_t i) {
    const uint32_t nodes = b->problem->curves->intervals + 1;
    if (lg_loss_samples_are_points(b->problem->model)) return b->samples[i];
    return b->samples[i / nodes] * nodes + (uint32_t)(i % nodes);
}

/* A hash by splitmix64: Steele, Lea & Flood 2014. */
double lg_surrogate_shift(uint64_t sample) {
    uint64_t z = (sample + 1) * 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53 - 0.5;
}

/* Interpolation uses up to INTERPOLATED neighbouring nodes of 0..n. Returns the first of the `points` nodes
 * that are nearest to `at`. */
enum { INTERPOLATED = 6 };
static uint32_t first_of(uint32_t n, uint32_t points, double at) {
    const uint32_t last = n + 1 - points;
    const double wanted = floor(at) + 1.0 - 0.5 * points;
    return wanted <= 0.0 ? 0 : wanted >= last ? last : (uint32_t)wanted;
}

/* Lagrange interpolation of values (n + 1, 2), given at the nodes, at the place `at` (in intervals). */
static void interpolate(const double *values, uint32_t n, double at, double *out) {
    const uint32_t points = n + 1 < INTERPOLATED ? n + 1 : INTERPOLATED, first = first_of(n, points, at);
    out[0] = out[1] = 0.0;
    for (uint32_t i = 0; i < points; i++) {
        double weight = 1.0;
        for (uint32_t j = 0; j < points; j++)
            if (j != i) weight *= (at - (first + j)) / ((double)i - (double)j);
        for (size_t c = 0; c < 2; c++) out[c] += weight * values[2 * (size_t)(first + i) + c];
    }
}

/* Hermite interpolation at t = `at` (in intervals) through up to 6 nodes with their tangents, degree 11, and
 * its derivative with respect to arc length. With the Lagrange polynomials L_i,
 *   q = sum_i (1 - 2 (t - i) L_i'(i)) L_i^2 q_i + (t - i) L_i^2 h v_i.
 * `at` must not be a node. */
static void osculate(const curve *c, uint32_t n, double h, double at, double *q, double *v) {
    const uint32_t points = n + 1 < INTERPOLATED ? n + 1 : INTERPOLATED, first = first_of(n, points, at);
    q[0] = q[1] = v[0] = v[1] = 0.0;
    for (uint32_t i = 0; i < points; i++) {
        const double from = at - (first + i), *node = c->q + 2 * (size_t)(first + i);
        const double *tangent = c->v + 2 * (size_t)(first + i);
        double value = 1.0, slope = 0.0, own = 0.0; /* L_i(t), L_i'(t)/L_i(t), L_i'(i) */
        for (uint32_t j = 0; j < points; j++) {
            if (j == i) continue;
            value *= (at - (first + j)) / ((double)i - (double)j);
            slope += 1.0 / (at - (first + j));
            own += 1.0 / ((double)i - (double)j);
        }
        const double square = value * value, place = 1.0 - 2.0 * from * own;
        for (size_t k = 0; k < 2; k++) {
            q[k] += square * (place * node[k] + from * h * tangent[k]);
            v[k] += square *
                    (2.0 * (place * slope - own) * node[k] / h + (1.0 + 2.0 * from * slope) * tangent[k]);
        }
    }
}

/* Interpolates q and v between the nodes. Only curves of the continuous problem have tangents that are
 * exactly their derivatives. For discrete curves q and v are therefore interpolated separately. */
static void between_nodes(const part *b, const curve *c, double at, double *q, double *v) {
    const uint32_t n = b->problem->curves->intervals;
    if (!b->problem->curves->continuous) {
        interpolate(c->q, n, at, q);
        interpolate(c->v, n, at, v);
        return;
    }
    osculate(c, n, b->problem->model->length / n, at, q, v);
}

/* Computes q and v of the point of a curve that the sample stands for, and returns its s. */
static double point_of_sample(const part *b, const curve *c, uint32_t sample, double *q, double *v) {
    const uint32_t n = b->problem->curves->intervals, node = sample % (n + 1);
    double at = node;
    if (b->problem->model->options.between) at += lg_surrogate_shift(sample);
    at = at < 0.0 ? 0.0 : at > n ? n : at;
    if (at == node) {
        memcpy(q, c->q + 2 * (size_t)node, 2 * sizeof *q);
        memcpy(v, c->v + 2 * (size_t)node, 2 * sizeof *v);
        return lg_loss_node_of_data(b, node);
    }
    between_nodes(b, c, at, q, v);
    return b->problem->model->length * at / n;
}

/* Weight of node k of 0..n in an integral over [0, 1]: Gregory's rule with two corrections, which is exact
 * for cubics; the trapezoidal rule for few nodes. */
static double gregory(uint32_t n, uint32_t k) {
    static const double ends[] = {3.0 / 8.0, 7.0 / 6.0, 23.0 / 24.0}, few[] = {0.5, 1.0, 1.0};
    const uint32_t from_end = k < n - k ? k : n - k;
    if (from_end >= LG_COUNT(ends)) return 1.0 / n;
    return (n + 1 < 2 * LG_COUNT(ends) ? few : ends)[from_end] / n;
}

/* Column c of values (B n, 2) at n points of B curves: (B, n). */
static lg_var component(const part *b, lg_var values, uint32_t c) {
    const uint32_t rows = lg_var_shape(b->tape, values).dims[0], count = (uint32_t)b->count;
    return lg_reshape(b->tape, lg_slice(b->tape, values, 1, c, 1), lg_shape2(count, rows / count));
}

/* The rule of quadrature times N, as a row (1, N + 1), so that means over the nodes become integrals. */
static lg_var rule_of(const part *b) {
    const uint32_t n = b->problem->curves->intervals;
    void *values;
    const lg_var rule = lg_input_buffer(b->tape, lg_shape2(1, n + 1), &values);
    if (lg_is_none(rule)) return LG_NONE;
    for (uint32_t k = 0; k <= n; k++) {
        const double weight = gregory(n, k) * (n + 1);
        lg_put_numbers(lg_tape_dtype(b->tape), values, k, &weight, 1);
    }
    return rule;
}

/* Mean of values (B, N + 1) by the rule: (B, 1). */
static lg_var integral_over(const part *b, lg_var values) {
    return lg_mean_axis(b->tape, lg_mul(b->tape, rule_of(b), values), 1, true);
}

/* Energies (B, 1) of a continuous network with held ends, from the angle of its tangents: turning q' x q''
 * and tangents at the nodes, (B, N + 1) each. */
static lg_var tangents_energy(const part *b, lg_var turning, lg_var vx, lg_var vy) {
    lg_tape *t = b->tape;
    const lg_var square = lg_add(t, lg_square(t, vx), lg_square(t, vy)), speed = lg_sqrt(t, square);
    const lg_var rate = lg_mul(t, lg_sqrt(t, rule_of(b)), lg_div(t, turning, square));
    const lg_var reached[2] = {integral_over(b, lg_div(t, vx, speed)),
                               integral_over(b, lg_div(t, vy, speed))};
    const lg_var r =
        lg_sub(t, lg_loss_chords(b), lg_scale(t, lg_concat(t, reached, 2, 1), b->problem->model->length));
    return lg_add(t, lg_surrogate_bending(t, b->problem->model, rate),
                  lg_surrogate_closing(t, b->problem->model, lg_loss_forces(b), r));
}

/* Adds the terms of mechanics to the loss of a continuous network: q (relative to q0), dq/ds and d2q/ds2 at
 * all nodes of the curves. */
static lg_var add_mechanics(const part *b, lg_var loss, lg_var q, lg_var v, lg_var a) {
    const lg_surrogate_options *options = &b->problem->model->options;
    lg_tape *t = b->tape;
    const lg_var vx = component(b, v, 0), vy = component(b, v, 1);
    const lg_var turning = lg_sub(t, lg_mul(t, vx, component(b, a, 1)), lg_mul(t, vy, component(b, a, 0)));
    const lg_var x = component(b, q, 0), y = component(b, q, 1);
    if (options->residual > 0.0) loss = lg_loss_add_residual(b, loss, turning, x, y);
    return options->energy == 0.0 ? loss : lg_loss_add_energy(b, loss, tangents_energy(b, turning, vx, vy));
}

lg_var lg_loss_continuous(const part *b, lg_var theta) {
    const lg_surrogate *model = b->problem->model;
    const uint32_t nodes = b->problem->curves->intervals + 1;
    const uint32_t count = (uint32_t)b->count * (lg_loss_samples_are_points(model) ? 1 : nodes);
    void *rows, *q_values, *v_values, *end_values;
    lg_tape *t = b->tape;
    lg_var x = lg_input_buffer(t, lg_shape2(count, 9), &rows);
    lg_var q_given = lg_input_buffer(t, lg_shape2(count, 2), &q_values);
    lg_var v_given = lg_input_buffer(t, lg_shape2(count, 2), &v_values);
    lg_var ends = lg_input_buffer(t, lg_shape2(model->options.boundary ? count : 0, 8), &end_values);
    if (lg_is_none(ends)) return LG_NONE;
    for (size_t i = 0; i < count; i++) {
        const uint32_t point = point_number(b, i);
        const curve c = lg_loss_curve_at(b, point / nodes);
        const double *starts[2] = {c.x + LG_AT_Q0, lg_loss_origin};
        double q[2], v[2];
        lg_loss_put_row(b, rows, i, &c, point_of_sample(b, &c, point, q, v));
        lg_loss_put_points(b, q_values, 2 * i, q, 1, starts[0], c.sign);
        lg_loss_put_points(b, v_values, 2 * i, v, 1, starts[1], c.sign);
        for (size_t k = 0; k < 4 && model->options.boundary; k++)
            lg_loss_put_points(b, end_values, 8 * i + 2 * k, c.x + 2 * k, 1, starts[k % 2], c.sign);
    }
    lg_var q = lg_net_record(t, &model->net, theta, 0, x);
    if (model->options.boundary)
        q = lg_surrogate_hold_ends(t, model, lg_scale(t, lg_slice(t, x, 1, 0, 1), model->length), ends, q);
    const lg_var v = along_s(b, x, q);
    lg_var loss = lg_add(t, lg_mse(t, q, q_given), lg_mse(t, v, v_given));
    if (model->options.gamma > 0.0) {
        const lg_var excess = lg_add_scalar(t, lg_rownorm2(t, v), -1.0);
        loss = lg_loss_add(b, loss, 0.5 * model->options.gamma, lg_loss_mean_square(t, excess));
    }
    return lg_loss_has_mechanics(model) ? add_mechanics(b, loss, q, v, along_s(b, x, v)) : loss;
}

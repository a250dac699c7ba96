/* Training losses of the surrogates on a tape. Mirroring and normalisation are applied to the numbers of a
 * batch before they enter the tape. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/ops.h"
#include "elastica/surrogate_internal.h"

/* The samples of a batch whose loss is recorded together. */
typedef struct part {
    const lg_surrogate_problem *problem;
    lg_tape *tape;
    const uint32_t *samples;
    size_t count;
} part;

/* A training curve; sign is -1 if the network sees its mirror image. */
typedef struct curve {
    const double *x, *q, *v;
    double sign;
} curve;

static curve curve_at(const part *b, size_t i) {
    const lg_elastica_curves *set = b->problem->curves;
    const size_t at = b->problem->training[i], stride = 2 * ((size_t)set->intervals + 1);
    const double *x = set->boundary + 8 * at;
    return (curve){x, set->q + stride * at, set->v + stride * at, lg_surrogate_sign(b->problem->model, x)};
}

static const double origin[2] = {0.0, 0.0};

static lg_var mean_square(lg_tape *tape, lg_var d) {
    return lg_mean(tape, lg_square(tape, d));
}

static lg_var add_term(const part *b, lg_var sum, double weight, lg_var term) {
    return lg_add(b->tape, sum, lg_scale(b->tape, term, weight));
}

/* L/EI times the mean energy of the curves of the data; 0 where the data have none. */
static double known_energy(const part *b) {
    const lg_elastica_curves *set = b->problem->curves;
    double sum = 0.0;
    for (size_t i = 0; i < b->count && set->energy != NULL; i++)
        sum += set->energy[b->problem->training[b->samples[i]]];
    return sum * set->length / (set->stiffness * (double)b->count);
}

/* Adds weight times the residual of curves: turning, x and y at n points, (B, n) each. */
static lg_var add_residual(const part *b, lg_var sum, lg_var turning, lg_var x, lg_var y) {
    const lg_surrogate *model = b->problem->model;
    const lg_var errors = lg_surrogate_moments(b->tape, model, turning, x, y);
    return add_term(b, sum, model->options.residual, mean_square(b->tape, errors));
}

/* Adds weight times the mean energy of a network of s, above the known energy. energies (B, 1). */
static lg_var add_energy(const part *b, lg_var sum, lg_var energies) {
    const lg_var above = lg_add_scalar(b->tape, lg_mean(b->tape, energies), -known_energy(b));
    return add_term(b, sum, b->problem->model->options.energy, above);
}

/* Writes points (n, 2) of a curve, relative to `start` and mirrored for sign = -1, to values[at ...]. */
static void put_points(const part *b, void *values, size_t at, const double *points, size_t n,
                       const double *start, double sign) {
    for (size_t k = 0; k < n; k++) {
        const double point[2] = {points[2 * k] - start[0], sign * (points[2 * k + 1] - start[1])};
        lg_surrogate_put(lg_tape_dtype(b->tape), values, at + 2 * k, point, 2);
    }
}

static void put_row(const part *b, void *values, size_t row, const curve *c, double s) {
    double numbers[9];
    const lg_surrogate *model = b->problem->model;
    const size_t n = model->net.inputs;
    lg_surrogate_row(model, c->x, c->sign, s, numbers);
    lg_surrogate_put(lg_tape_dtype(b->tape), values, row * n, numbers, n);
}

/* Arc length of node k of the training data, whose N may differ from the model's for networks of a continuous
 * s. */
static double node_of_data(const part *b, uint32_t k) {
    const uint32_t n = b->problem->curves->intervals;
    return k == n ? b->problem->model->length : b->problem->model->length * k / n;
}

/* qN - q0 of the curves, reflected if the network sees the mirror image: (B, 2). */
static lg_var chords(const part *b) {
    void *values;
    const lg_var chord = lg_input_buffer(b->tape, lg_shape2((uint32_t)b->count, 2), &values);
    if (lg_is_none(chord)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i]);
        put_points(b, values, 2 * i, c.x + LG_AT_QN, 1, c.x + LG_AT_Q0, c.sign);
    }
    return chord;
}

/* The forces in the curves of the data (B, 2), as the network sees them. */
static lg_var forces(const part *b) {
    const lg_elastica_curves *set = b->problem->curves;
    void *values;
    const lg_var force = lg_input_buffer(b->tape, lg_shape2((uint32_t)b->count, 2), &values);
    if (lg_is_none(force)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i]);
        double f[2];
        lg_surrogate_force(set->length, set->intervals, c.q, c.v, f);
        put_points(b, values, 2 * i, f, 1, origin, c.sign);
    }
    return force;
}

/* ---- discrete network ---- */

/* Mean square of the differences of d (B, 4(N - 1)) between neighbouring nodes, where d is zero at the ends:
 * 4N differences per sample. In the shape (B, 2, 2(N + 1)) the same component at the next node is two places
 * further. */
static lg_var rough(lg_tape *tape, lg_var d, uint32_t count, uint32_t intervals) {
    lg_var nodes = lg_reshape(tape, d, lg_shape3(count, 2, 2 * (intervals - 1)));
    nodes = lg_pad(tape, nodes, 2, 2, 2);
    return lg_mse(tape, lg_slice(tape, nodes, 2, 2, 2 * intervals),
                  lg_slice(tape, nodes, 2, 0, 2 * intervals));
}

/* Mean square of W d for d (B, 4(N - 1)), W = I + gamma G'G, G = S - I (liegrad/elastica.h). */
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
        const curve c = curve_at(b, b->samples[i]);
        put_row(b, rows, i, &c, 0.0);
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
        const curve c = curve_at(b, b->samples[i]);
        put_points(b, values, 4 * inner * i, c.q + 2, inner, c.x + LG_AT_Q0, c.sign);
        put_points(b, values, 4 * inner * i + 2 * inner, c.v + 2, inner, origin, c.sign);
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
        lg_surrogate_put(lg_tape_dtype(b->tape), values, modes * i,
                         b->problem->coefficients + modes * (size_t)b->samples[i], modes);
    for (size_t k = 0; k < modes; k++) {
        const double *vector = model->modes + n * (k + 1);
        double square = 0.0;
        for (size_t i = 0; i < n; i++) square += vector[i] * vector[i];
        const double scale = sqrt(square * modes / n);
        lg_surrogate_put(lg_tape_dtype(b->tape), weights, k, &scale, 1);
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
        const curve c = curve_at(b, b->samples[i]);
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
        lg_surrogate_put(lg_tape_dtype(t), values, k, &weight, 1);
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
    const lg_var loss = mean_square(b->tape, d);
    if (model->options.gamma == 0.0) return loss;
    const lg_var differences = rough(b->tape, d, (uint32_t)b->count, model->intervals);
    return lg_add(b->tape, loss, lg_scale(b->tape, differences, model->options.gamma));
}

static lg_var discrete_loss(const part *b, lg_var theta) {
    const lg_surrogate_options *options = &b->problem->model->options;
    if (options->loss == LG_SURROGATE_ENERGY) return energy_loss(b, theta);
    const lg_var loss = discrete_error(b, theta);
    return options->energy == 0.0 ? loss : add_term(b, loss, options->energy, energy_loss(b, theta));
}

/* ---- continuous network ---- */

/* Whether the loss has a term that needs whole curves and their turning. */
static bool has_mechanics(const lg_surrogate *model) {
    return model->options.energy > 0.0 || model->options.residual > 0.0;
}

static bool samples_are_points(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_CONTINUOUS && !has_mechanics(model);
}

/* Derivative of the network's inputs (s/L, x) with respect to s, one row for all points. */
static lg_var along_s(const part *b) {
    const double tangent[9] = {1.0 / b->problem->model->length};
    return lg_input_f64(b->tape, lg_shape2(1, 9), tangent);
}

/* Derivative of v (B, 2) along s at the network's inputs x (B, 9). */
static lg_var second_along_s(const part *b, lg_var x, lg_var v) {
    const lg_var along = lg_broadcast_to(b->tape, along_s(b), lg_var_shape(b->tape, x));
    lg_var a = LG_NONE;
    (void)lg_jvp(b->tape, &v, 1, &x, &along, 1, &a);
    return a;
}

/* Number of point i of a part: its curve times the number of nodes, plus its node. */
static uint32_t point_number(const part *b, size_t i) {
    const uint32_t nodes = b->problem->curves->intervals + 1;
    if (samples_are_points(b->problem->model)) return b->samples[i];
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
        return node_of_data(b, node);
    }
    between_nodes(b, c, at, q, v);
    return b->problem->model->length * at / n;
}

/* Columns of numbers of held ends, for each point: dH/ds, w, dw/ds, d2w/ds2, d2H/ds2, H - q0. */
enum { HELD_V = 0, HELD_WEIGHT = 2, HELD_SLOPE, HELD_TURN, HELD_A, HELD_Q = 7, HELD_NUMBERS = 9 };

static void put_held(const part *b, void *values, size_t i, const lg_surrogate_held *held, const curve *c) {
    const double weights[3] = {held->weight, held->slope, held->turn};
    put_points(b, values, HELD_NUMBERS * i + HELD_V, held->v, 1, origin, c->sign);
    lg_surrogate_put(lg_tape_dtype(b->tape), values, HELD_NUMBERS * i + HELD_WEIGHT, weights, 3);
    put_points(b, values, HELD_NUMBERS * i + HELD_A, held->a, 1, origin, c->sign);
    put_points(b, values, HELD_NUMBERS * i + HELD_Q, held->q, 1, c->x + LG_AT_Q0, c->sign);
}

/* For held ends: the second derivative of H + w f by s, from f, df/ds and d2f/ds2. */
static lg_var hold_second(lg_tape *tape, lg_var held, lg_var f, lg_var slope, lg_var turn) {
    const lg_var terms[4] = {lg_slice(tape, held, 1, HELD_A, 2),
                             lg_mul(tape, lg_slice(tape, held, 1, HELD_TURN, 1), f),
                             lg_mul(tape, lg_slice(tape, held, 1, HELD_SLOPE, 1), slope),
                             lg_mul(tape, lg_slice(tape, held, 1, HELD_WEIGHT, 1), turn)};
    return lg_linear_combination(tape, terms, (const double[4]){1.0, 1.0, 2.0, 1.0}, 4);
}

/* For held ends: computes q - H and dq/ds from the network's f = *q and df/ds = *v. */
static void hold(lg_tape *tape, lg_var held, lg_var *q, lg_var *v) {
    const lg_var weight = lg_slice(tape, held, 1, HELD_WEIGHT, 1),
                 slope = lg_slice(tape, held, 1, HELD_SLOPE, 1);
    const lg_var turned = lg_add(tape, lg_mul(tape, *v, weight), lg_mul(tape, *q, slope));
    *v = lg_add(tape, turned, lg_slice(tape, held, 1, 0, 2));
    *q = lg_mul(tape, *q, weight);
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
        lg_surrogate_put(lg_tape_dtype(b->tape), values, k, &weight, 1);
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
        lg_sub(t, chords(b), lg_scale(t, lg_concat(t, reached, 2, 1), b->problem->model->length));
    return lg_add(t, lg_surrogate_bending(t, b->problem->model, rate),
                  lg_surrogate_closing(t, b->problem->model, forces(b), r));
}

/* Adds the terms of mechanics to the loss of a continuous network: q (relative to q0), dq/ds and d2q/ds2 at
 * all nodes of the curves. */
static lg_var add_mechanics(const part *b, lg_var loss, lg_var q, lg_var v, lg_var a) {
    const lg_surrogate_options *options = &b->problem->model->options;
    lg_tape *t = b->tape;
    const lg_var vx = component(b, v, 0), vy = component(b, v, 1);
    const lg_var turning = lg_sub(t, lg_mul(t, vx, component(b, a, 1)), lg_mul(t, vy, component(b, a, 0)));
    const lg_var x = component(b, q, 0), y = component(b, q, 1);
    if (options->residual > 0.0) loss = add_residual(b, loss, turning, x, y);
    return options->energy == 0.0 ? loss : add_energy(b, loss, tangents_energy(b, turning, vx, vy));
}

static lg_var continuous_loss(const part *b, lg_var theta) {
    const lg_surrogate *model = b->problem->model;
    const uint32_t nodes = b->problem->curves->intervals + 1;
    const uint32_t count = (uint32_t)b->count * (samples_are_points(model) ? 1 : nodes);
    void *rows, *q_values, *v_values, *held_values;
    lg_var x = lg_input_buffer(b->tape, lg_shape2(count, 9), &rows);
    lg_var q_given = lg_input_buffer(b->tape, lg_shape2(count, 2), &q_values);
    lg_var v_given = lg_input_buffer(b->tape, lg_shape2(count, 2), &v_values);
    lg_var held_given = lg_input_buffer(b->tape, lg_shape2(count, HELD_NUMBERS), &held_values);
    if (lg_is_none(held_given)) return LG_NONE;
    for (size_t i = 0; i < count; i++) {
        const uint32_t point = point_number(b, i);
        const curve c = curve_at(b, point / nodes);
        double q[2], v[2];
        lg_surrogate_held held;
        const double s = point_of_sample(b, &c, point, q, v);
        lg_surrogate_hold(model, s, c.x, &held);
        put_row(b, rows, i, &c, s);
        put_points(b, q_values, 2 * i, q, 1, model->options.boundary ? held.q : c.x + LG_AT_Q0, c.sign);
        put_points(b, v_values, 2 * i, v, 1, origin, c.sign);
        put_held(b, held_values, i, &held, &c);
    }
    lg_var q = LG_NONE, v = LG_NONE, a = LG_NONE;
    if (lg_net_record_jvp(b->tape, &model->net, theta, 0, x, along_s(b), &q, &v) != LG_OK) return LG_NONE;
    if (has_mechanics(model)) a = second_along_s(b, x, v);
    if (has_mechanics(model) && model->options.boundary) a = hold_second(b->tape, held_given, q, v, a);
    if (model->options.boundary) hold(b->tape, held_given, &q, &v);
    lg_var loss = lg_add(b->tape, lg_mse(b->tape, q, q_given), lg_mse(b->tape, v, v_given));
    if (model->options.gamma > 0.0) {
        const lg_var excess = lg_add_scalar(b->tape, lg_rownorm2(b->tape, v), -1.0);
        loss = add_term(b, loss, 0.5 * model->options.gamma, mean_square(b->tape, excess));
    }
    if (!has_mechanics(model)) return loss;
    if (model->options.boundary) q = lg_add(b->tape, q, lg_slice(b->tape, held_given, 1, HELD_Q, 2));
    return add_mechanics(b, loss, q, v, a);
}

/* ---- angle network ---- */

/* Arc length of place r of a curve. A curve has R = 4N + 1 places: its N + 1 nodes, then Gauss point 0 of
 * every interval, Gauss point 1 of every interval, Gauss point 2 of every interval. */
static double place(const part *b, uint32_t r) {
    const uint32_t n = b->problem->curves->intervals;
    if (r <= n) return node_of_data(b, r);
    const uint32_t g = (r - n - 1) / n, j = (r - n - 1) % n;
    return b->problem->model->length * (j + lg_gauss_at[g]) / n;
}

/* Corrects the angles pi f (B, R) so that they have the given end angles: pi f + (given - pi f(ends)) W,
 * where W (2, R) are the weights of the ends; the derivative by s, *turning, if it is there, with dW/ds. */
static lg_var hold_ends(const part *b, lg_var angle, uint32_t places, lg_var *turning) {
    const lg_dtype dtype = lg_tape_dtype(b->tape);
    void *given_values, *weight_values, *slope_values;
    lg_var given = lg_input_buffer(b->tape, lg_shape2((uint32_t)b->count, 2), &given_values);
    lg_var weights = lg_input_buffer(b->tape, lg_shape2(2, places), &weight_values);
    lg_var slopes = lg_input_buffer(b->tape, lg_shape2(2, places), &slope_values);
    if (lg_is_none(slopes)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i]);
        double angles[2];
        lg_surrogate_angles(c.x, c.sign, angles);
        lg_surrogate_put(dtype, given_values, 2 * i, angles, 2);
    }
    for (uint32_t r = 0; r < places; r++) {
        double w[2], dw[2];
        lg_surrogate_end_weights(b->problem->model, place(b, r), w, dw);
        for (size_t end = 0; end < 2; end++) {
            lg_surrogate_put(dtype, weight_values, end * places + r, &w[end], 1);
            lg_surrogate_put(dtype, slope_values, end * places + r, &dw[end], 1);
        }
    }
    const lg_var ends[2] = {lg_slice(b->tape, angle, 1, 0, 1),
                            lg_slice(b->tape, angle, 1, b->problem->curves->intervals, 1)};
    lg_var missing = lg_sub(b->tape, given, lg_concat(b->tape, ends, 2, 1));
    if (!lg_is_none(*turning)) *turning = lg_matmul_add(b->tape, missing, slopes, *turning);
    return lg_matmul_add(b->tape, missing, weights, angle);
}

/* theta (B, R) at all places of the curves; with terms of mechanics also d theta/ds in *turning (B, R). */
static lg_var angles_of(const part *b, lg_var theta, uint32_t places, lg_var *turning) {
    static const double along[3] = {0.0, 0.0, 1.0};
    const lg_surrogate *model = b->problem->model;
    const uint32_t count = (uint32_t)b->count;
    void *rows;
    lg_var x = lg_input_buffer(b->tape, lg_shape2(count * places, 3), &rows);
    if (lg_is_none(x)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i]);
        for (uint32_t r = 0; r < places; r++) put_row(b, rows, i * places + r, &c, place(b, r));
    }
    const lg_shape shape = lg_shape2(count, places);
    lg_var f = LG_NONE, slope = LG_NONE;
    if (!has_mechanics(model)) {
        f = lg_net_record(b->tape, &model->net, theta, 0, x);
    } else {
        const lg_var dx = lg_input_f64(b->tape, lg_shape2(1, 3), along);
        if (lg_net_record_jvp(b->tape, &model->net, theta, 0, x, dx, &f, &slope) != LG_OK) return LG_NONE;
        *turning = lg_scale(b->tape, lg_reshape(b->tape, slope, shape), LG_SURROGATE_PI);
    }
    lg_var angle = lg_scale(b->tape, lg_reshape(b->tape, f, shape), LG_SURROGATE_PI);
    return model->options.boundary ? hold_ends(b, angle, places, turning) : angle;
}

/* Integrals from 0 to s_k, k = 0..N, of the function with the values `trig` (2B, R): (2B, N + 1). Only the
 * values at Gauss points are used. The integrals over the intervals are summed up by doubling: after the step
 * with d, each column is the sum over the 2d intervals that end there (or over all, if there are fewer). */
static lg_var integrals(const part *b, lg_var trig) {
    const uint32_t n = b->problem->curves->intervals;
    const double h = b->problem->model->length / n;
    lg_var at[LG_GAUSS_POINTS];
    double weight[LG_GAUSS_POINTS];
    for (uint32_t g = 0; g < LG_GAUSS_POINTS; g++) {
        at[g] = lg_slice(b->tape, trig, 1, n + 1 + g * n, n);
        weight[g] = h * lg_gauss_weight[g];
    }
    lg_var sum = lg_linear_combination(b->tape, at, weight, LG_GAUSS_POINTS);
    for (uint32_t d = 1; d < n; d *= 2)
        sum = lg_add(b->tape, sum, lg_pad(b->tape, lg_slice(b->tape, sum, 1, 0, n - d), 1, d, 0));
    return lg_pad(b->tape, sum, 1, 1, 0);
}

/* Writes points relative to `start` into values (2B, N + 1): the x-components of all curves, then the
 * y-components of all curves. The rows of cos and sin on the tape have the same order. */
static void put_components(const part *b, void *values, size_t i, const double *points, const double *start,
                           double sign) {
    const size_t nodes = (size_t)b->problem->curves->intervals + 1;
    for (size_t c = 0; c < 2; c++)
        for (size_t k = 0; k < nodes; k++) {
            const double value = (c == 1 ? sign : 1.0) * (points[2 * k + c] - start[c]);
            lg_surrogate_put(lg_tape_dtype(b->tape), values, (c * b->count + i) * nodes + k, &value, 1);
        }
}

/* qN - q0 - I(L) (2B, 1) for the integrals I(s) (2B, N + 1). */
static lg_var missing_chord(const part *b, lg_var integral) {
    const uint32_t n = b->problem->curves->intervals, rows = 2 * (uint32_t)b->count;
    const lg_var chord = lg_reshape(b->tape, lg_transpose(b->tape, chords(b)), lg_shape2(rows, 1));
    return lg_sub(b->tape, chord, lg_slice(b->tape, integral, 1, n, 1));
}

/* For `symmetric`: the integrals I(s) (2B, N + 1) plus (s/L) (qN - q0 - I(L)). */
static lg_var from_both_ends(const part *b, lg_var integral) {
    const uint32_t n = b->problem->curves->intervals;
    void *share_values;
    const lg_var shares = lg_input_buffer(b->tape, lg_shape2(1, n + 1), &share_values);
    if (lg_is_none(shares)) return LG_NONE;
    for (uint32_t k = 0; k <= n; k++) {
        const double share = (double)k / n;
        lg_surrogate_put(lg_tape_dtype(b->tape), share_values, k, &share, 1);
    }
    return lg_matmul_add(b->tape, missing_chord(b, integral), shares, integral);
}

/* Rows first .. first + B - 1 of x- or y-components (2B, n). */
static lg_var rows_of(const part *b, lg_var components, size_t first) {
    return lg_slice(b->tape, components, 0, (uint32_t)first, (uint32_t)b->count);
}

/* Energies (B, 1) of an angle network with held ends: turning (B, 3N) at the Gauss points, integral
 * (2B, N + 1). */
static lg_var closed_energy(const part *b, lg_var turning, lg_var integral) {
    const uint32_t n = b->problem->curves->intervals;
    lg_tape *t = b->tape;
    lg_var energies = LG_NONE;
    for (uint32_t g = 0; g < LG_GAUSS_POINTS; g++) {
        const lg_var at = lg_slice(t, turning, 1, g * n, n);
        const lg_var term = lg_scale(t, lg_surrogate_bending(t, b->problem->model, at), lg_gauss_weight[g]);
        energies = g == 0 ? term : lg_add(t, energies, term);
    }
    const lg_var missing = missing_chord(b, integral);
    const lg_var r[2] = {rows_of(b, missing, 0), rows_of(b, missing, b->count)};
    return lg_add(t, energies, lg_surrogate_closing(t, b->problem->model, forces(b), lg_concat(t, r, 2, 1)));
}

/* q (2B, 3N) at the Gauss points, by the cubics through the nodes q and v (2B, N + 1). */
static lg_var at_gauss_points(const part *b, lg_var q, lg_var v) {
    const uint32_t n = b->problem->curves->intervals;
    const double h = b->problem->model->length / n;
    lg_var at[LG_GAUSS_POINTS];
    const lg_var ends[4] = {lg_slice(b->tape, q, 1, 0, n), lg_slice(b->tape, v, 1, 0, n),
                            lg_slice(b->tape, q, 1, 1, n), lg_slice(b->tape, v, 1, 1, n)};
    for (size_t g = 0; g < LG_GAUSS_POINTS; g++) {
        const double t = lg_gauss_at[g], u = 1.0 - t;
        const double shares[4] = {u * u * (1.0 + 2.0 * t), h * t * u * u, t * t * (1.0 + 2.0 * u),
                                  -h * t * t * u};
        at[g] = lg_linear_combination(b->tape, ends, shares, 4);
    }
    return lg_concat(b->tape, at, LG_GAUSS_POINTS, 1);
}

/* Adds the terms of mechanics to the loss of an angle network: turning (B, R) at all places, q and v
 * (2B, N + 1) at the nodes, integral of v. */
static lg_var add_balance(const part *b, lg_var loss, lg_var turning, lg_var q, lg_var v, lg_var integral) {
    const lg_surrogate_options *options = &b->problem->model->options;
    const uint32_t n = b->problem->curves->intervals;
    const lg_var points = at_gauss_points(b, q, v), within = lg_slice(b->tape, turning, 1, n + 1, 3 * n);
    const lg_var x = rows_of(b, points, 0), y = rows_of(b, points, b->count);
    if (options->residual > 0.0) loss = add_residual(b, loss, within, x, y);
    if (options->energy == 0.0) return loss;
    return add_energy(b, loss, closed_energy(b, within, integral));
}

static lg_var angle_loss(const part *b, lg_var theta) {
    const uint32_t n = b->problem->curves->intervals, places = 4 * n + 1;
    if (b->count > UINT32_MAX / places)
        return lg_tape_fail(b->tape, LG_SHAPE, "surrogate", "the curves have 2^32 places or more");
    const lg_shape shape = lg_shape2(2 * (uint32_t)b->count, n + 1);
    void *q_values, *v_values;
    lg_var q_given = lg_input_buffer(b->tape, shape, &q_values);
    lg_var v_given = lg_input_buffer(b->tape, shape, &v_values);
    if (lg_is_none(v_given)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i]);
        put_components(b, q_values, i, c.q, c.x + LG_AT_Q0, c.sign);
        put_components(b, v_values, i, c.v, origin, c.sign);
    }
    lg_var turning = LG_NONE, angle = angles_of(b, theta, places, &turning);
    const lg_var both[2] = {lg_cos(b->tape, angle), lg_sin(b->tape, angle)};
    lg_var trig = lg_concat(b->tape, both, 2, 0);
    lg_var v = lg_slice(b->tape, trig, 1, 0, n + 1);
    const lg_var integral = integrals(b, trig);
    const lg_var q = b->problem->model->options.symmetric ? from_both_ends(b, integral) : integral;
    const lg_var loss = lg_add(b->tape, lg_mse(b->tape, q, q_given), lg_mse(b->tape, v, v_given));
    return lg_is_none(turning) ? loss : add_balance(b, loss, turning, q, v, integral);
}

/* ---- learning problem ---- */

/* The loss of each kind of network. The number of points that are on a tape at once is small enough that the
 * values stay in the L2 cache. */
static const struct learned {
    lg_var (*loss)(const part *b, lg_var theta);
    size_t places; /* number of points of a network of s that are on a tape at once */
} learned[LG_SURROGATE_KIND_COUNT] = {
    [LG_SURROGATE_DISCRETE] = {discrete_loss, 0},
    [LG_SURROGATE_CONTINUOUS] = {continuous_loss, 128},
    [LG_SURROGATE_ANGLE] = {angle_loss, 402},
};

/* Number of samples with so many points; 0, the default, for the discrete network. */
static size_t chunk_of(const lg_surrogate_problem *problem) {
    const lg_surrogate *model = problem->model;
    const size_t n = problem->curves->intervals, places = learned[model->options.kind].places;
    const size_t each = samples_are_points(model)                        ? 1
                        : model->options.kind == LG_SURROGATE_CONTINUOUS ? n + 1
                                                                         : 4 * n + 1;
    return places == 0 ? 0 : places < each ? 1 : places / each;
}

/* Records the share of these samples in the loss of the batch: their mean times count/batch. */
static lg_status shard_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                            size_t batch, lg_var *loss) {
    const lg_surrogate_problem *problem = user;
    const part b = {problem, tape, samples, count};
    lg_var mean = learned[problem->model->options.kind].loss(&b, theta);
    *loss = count == batch ? mean : lg_scale(tape, mean, (double)count / (double)batch);
    return lg_tape_status(tape);
}

static size_t sample_count(const lg_surrogate_problem *problem) {
    return problem->training_count *
           (samples_are_points(problem->model) ? (size_t)problem->curves->intervals + 1 : 1);
}

lg_status lg_surrogate_problem_check(const lg_surrogate_problem *problem, lg_error *error) {
    LG_NEEDS(error, problem);
    const lg_elastica_curves *curves = problem->curves;
    if (problem->model == NULL || curves == NULL || problem->training == NULL ||
        problem->training_count == 0 || curves->boundary == NULL || curves->q == NULL || curves->v == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the problem has no model, no curves, or nothing to learn from");
    if (curves->intervals < LG_ELASTICA_MIN_INTERVALS || curves->intervals > LG_ELASTICA_MAX_INTERVALS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the curves have %u intervals; %d to %d are possible",
                       curves->intervals, LG_ELASTICA_MIN_INTERVALS, LG_ELASTICA_MAX_INTERVALS);
    LG_TRY(lg_surrogate_check_curves(problem->model, curves, error));
    LG_TRY(lg_surrogate_check_modes(problem->model, error));
    if (problem->model->options.modes > 0 && problem->model->options.gamma == 0.0 &&
        problem->coefficients == NULL)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "a network of modes learns coefficients: compute them first with lg_surrogate_coefficients");
    for (size_t i = 0; i < problem->training_count; i++)
        if (problem->training[i] >= curves->count)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "there is no curve %u (counted from 0) to learn: there are %zu curves",
                           problem->training[i], curves->count);
    const uint64_t per_curve = sample_count(problem) / problem->training_count;
    if (problem->training_count > UINT32_MAX / per_curve)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu curves of %llu samples are 2^32 samples or more",
                       problem->training_count, (unsigned long long)per_curve);
    return LG_OK;
}

void lg_surrogate_fit_problem(const lg_surrogate_problem *problem, lg_fit_problem *out) {
    /* This union only drops const, which is safe because the loss does not write to the problem. */
    union {
        const lg_surrogate_problem *borrowed;
        void *user;
    } pointer = {.borrowed = problem};
    *out = (lg_fit_problem){.parameters = lg_surrogate_parameters(problem->model),
                            .samples = sample_count(problem),
                            .loss = shard_loss,
                            .user = pointer.user,
                            .chunk = chunk_of(problem)};
}

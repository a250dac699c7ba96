/* Training losses of the surrogates on a tape. Reflection and normalisation are done on the numbers of a
 * batch before they enter the tape. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/ops.h"
#include "models/surrogate_internal.h"

/* A part of a batch. */
typedef struct part {
    const lg_surrogate_problem *problem;
    lg_tape *tape;
    const uint32_t *samples;
    size_t count;
} part;

/* Curve number i of the training part, reflected for `sign` -1. */
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

/* Points (n, 2) of a curve, counted from `start`, into values[at ...]. */
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

/* Arc length of node k of the data. For networks of a continuous s the data may have another N. */
static double node_of_data(const part *b, uint32_t k) {
    const uint32_t n = b->problem->curves->intervals;
    return k == n ? b->problem->model->length : b->problem->model->length * k / n;
}

/* ---- discrete ---- */

/* Mean of squares of the node-to-node differences of d (B, 4(N - 1)), which is zero at the ends: 4N numbers a
 * sample. In the shape (B, 2, 2(N + 1)) the next node of a component is two places further. */
static lg_var rough(lg_tape *tape, lg_var d, uint32_t count, uint32_t intervals) {
    lg_var nodes = lg_reshape(tape, d, lg_shape3(count, 2, 2 * (intervals - 1)));
    nodes = lg_pad(tape, nodes, 2, 2, 2);
    return lg_mse(tape, lg_slice(tape, nodes, 2, 2, 2 * intervals),
                  lg_slice(tape, nodes, 2, 0, 2 * intervals));
}

static lg_var discrete_loss(const part *b, lg_var theta) {
    const lg_surrogate *model = b->problem->model;
    const uint32_t count = (uint32_t)b->count, inner = model->intervals - 1;
    void *rows, *values;
    lg_var x = lg_input_buffer(b->tape, lg_shape2(count, model->net.inputs), &rows);
    lg_var target = lg_input_buffer(b->tape, lg_shape2(count, 4 * inner), &values);
    if (lg_is_none(target)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i]);
        put_row(b, rows, i, &c, 0.0);
        put_points(b, values, 4 * inner * i, c.q + 2, inner, c.x + LG_AT_Q0, c.sign);
        put_points(b, values, 4 * inner * i + 2 * inner, c.v + 2, inner, origin, c.sign);
    }
    lg_var d = lg_sub(b->tape, lg_net_record(b->tape, &model->net, theta, 0, x), target);
    lg_var loss = lg_mean(b->tape, lg_square(b->tape, d));
    if (model->options.gamma == 0.0) return loss;
    lg_var differences = rough(b->tape, d, count, model->intervals);
    return lg_add(b->tape, loss, lg_scale(b->tape, differences, model->options.gamma));
}

/* ---- continuous ---- */

/* d/ds of the inputs (s/L, x), one row for all samples. */
static lg_var along_s(const part *b) {
    const double tangent[9] = {1.0 / b->problem->model->length};
    return lg_input_f64(b->tape, lg_shape2(1, 9), tangent);
}

/* splitmix64: Steele, Lea & Flood 2014. */
double lg_surrogate_shift(uint64_t sample) {
    uint64_t z = (sample + 1) * 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53 - 0.5;
}

/* Lagrange's polynomial through the values (n + 1, 2) at up to INTERPOLATED of the nodes 0..n nearest to
 * `at`. */
enum { INTERPOLATED = 6 };
static void interpolate(const double *values, uint32_t n, double at, double *out) {
    const uint32_t points = n + 1 < INTERPOLATED ? n + 1 : INTERPOLATED, last = n + 1 - points;
    const double wanted = floor(at) + 1.0 - 0.5 * points;
    const uint32_t first = wanted <= 0.0 ? 0 : wanted >= last ? last : (uint32_t)wanted;
    out[0] = out[1] = 0.0;
    for (uint32_t i = 0; i < points; i++) {
        double weight = 1.0;
        for (uint32_t j = 0; j < points; j++)
            if (j != i) weight *= (at - (first + j)) / ((double)i - (double)j);
        for (size_t c = 0; c < 2; c++) out[c] += weight * values[2 * (size_t)(first + i) + c];
    }
}

/* q and v between the nodes. Only in the continuous problem are the tangents exactly the derivative of the
 * curve. In the discrete one q and v are therefore interpolated separately. */
static void between_nodes(const part *b, const curve *c, double at, double *q, double *v) {
    const uint32_t n = b->problem->curves->intervals;
    if (!b->problem->curves->continuous) {
        interpolate(c->q, n, at, q);
        interpolate(c->v, n, at, v);
        return;
    }
    const size_t k = at < n ? (size_t)at : n - 1;
    lg_surrogate_hermite(c->q + 2 * k, c->v + 2 * k, b->problem->model->length / n, at - (double)k, q, v);
}

/* The sample: a point of a curve with s, q and v. */
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

static lg_var continuous_loss(const part *b, lg_var theta) {
    const lg_surrogate *model = b->problem->model;
    const uint32_t count = (uint32_t)b->count, nodes = b->problem->curves->intervals + 1;
    void *rows, *q_values, *v_values;
    lg_var x = lg_input_buffer(b->tape, lg_shape2(count, 9), &rows);
    lg_var q_given = lg_input_buffer(b->tape, lg_shape2(count, 2), &q_values);
    lg_var v_given = lg_input_buffer(b->tape, lg_shape2(count, 2), &v_values);
    if (lg_is_none(v_given)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i] / nodes);
        double q[2], v[2];
        put_row(b, rows, i, &c, point_of_sample(b, &c, b->samples[i], q, v));
        put_points(b, q_values, 2 * i, q, 1, c.x + LG_AT_Q0, c.sign);
        put_points(b, v_values, 2 * i, v, 1, origin, c.sign);
    }
    lg_var q = LG_NONE, v = LG_NONE;
    if (lg_net_record_jvp(b->tape, &model->net, theta, 0, x, along_s(b), &q, &v) != LG_OK) return LG_NONE;
    lg_var loss = lg_add(b->tape, lg_mse(b->tape, q, q_given), lg_mse(b->tape, v, v_given));
    if (model->options.gamma == 0.0) return loss;
    lg_var excess = lg_add_scalar(b->tape, lg_rownorm2(b->tape, v), -1.0);
    lg_var penalty = lg_mean(b->tape, lg_square(b->tape, excess));
    return lg_add(b->tape, loss, lg_scale(b->tape, penalty, 0.5 * model->options.gamma));
}

/* ---- angle ---- */

/* A curve has R = 4N + 1 places: its N + 1 nodes, then Gauss point 0 of every interval, point 1, point 2. */
static double place(const part *b, uint32_t r) {
    const uint32_t n = b->problem->curves->intervals;
    if (r <= n) return node_of_data(b, r);
    const uint32_t g = (r - n - 1) / n, j = (r - n - 1) % n;
    return b->problem->model->length * (j + lg_gauss_at[g]) / n;
}

/* theta (B, R) with the end angles of the boundary conditions: pi f + (given - pi f(ends)) W, where W (2, R)
 * are the weights of the ends. */
static lg_var hold_ends(const part *b, lg_var angle, uint32_t places) {
    const lg_dtype dtype = lg_tape_dtype(b->tape);
    void *given_values, *weight_values;
    lg_var given = lg_input_buffer(b->tape, lg_shape2((uint32_t)b->count, 2), &given_values);
    lg_var weights = lg_input_buffer(b->tape, lg_shape2(2, places), &weight_values);
    if (lg_is_none(weights)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i]);
        double angles[2];
        lg_surrogate_angles(c.x, c.sign, angles);
        lg_surrogate_put(dtype, given_values, 2 * i, angles, 2);
    }
    for (uint32_t r = 0; r < places; r++) {
        double w[2];
        lg_surrogate_end_weights(b->problem->model, place(b, r), w);
        lg_surrogate_put(dtype, weight_values, r, &w[0], 1);
        lg_surrogate_put(dtype, weight_values, places + r, &w[1], 1);
    }
    const lg_var ends[2] = {lg_slice(b->tape, angle, 1, 0, 1),
                            lg_slice(b->tape, angle, 1, b->problem->curves->intervals, 1)};
    lg_var missing = lg_sub(b->tape, given, lg_concat(b->tape, ends, 2, 1));
    return lg_matmul_add(b->tape, missing, weights, angle);
}

/* theta at all places of the curves, (B, R). */
static lg_var angles_of(const part *b, lg_var theta, uint32_t places) {
    const lg_surrogate *model = b->problem->model;
    const uint32_t count = (uint32_t)b->count;
    void *rows;
    lg_var x = lg_input_buffer(b->tape, lg_shape2(count * places, 3), &rows);
    if (lg_is_none(x)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = curve_at(b, b->samples[i]);
        for (uint32_t r = 0; r < places; r++) put_row(b, rows, i * places + r, &c, place(b, r));
    }
    lg_var f = lg_net_record(b->tape, &model->net, theta, 0, x);
    lg_var angle = lg_scale(b->tape, lg_reshape(b->tape, f, lg_shape2(count, places)), LG_SURROGATE_PI);
    return model->options.boundary ? hold_ends(b, angle, places) : angle;
}

/* Integrals from 0 to s_k, k = 0..N, of the function with values `trig` (2B, R): (2B, N + 1). Only the Gauss
 * points are used. Sums over intervals are made by doubling: after the step of length d each column is the
 * sum of the 2d intervals that end there. */
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

/* `points` relative to their start, (2B, N + 1): the x-components of all curves, then their y-components, in
 * the order of the rows of cos and sin. */
static void put_components(const part *b, void *values, size_t i, const double *points, const double *start,
                           double sign) {
    const size_t nodes = (size_t)b->problem->curves->intervals + 1;
    for (size_t c = 0; c < 2; c++)
        for (size_t k = 0; k < nodes; k++) {
            const double value = (c == 1 ? sign : 1.0) * (points[2 * k + c] - start[c]);
            lg_surrogate_put(lg_tape_dtype(b->tape), values, (c * b->count + i) * nodes + k, &value, 1);
        }
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
    lg_var angle = angles_of(b, theta, places);
    const lg_var both[2] = {lg_cos(b->tape, angle), lg_sin(b->tape, angle)};
    lg_var trig = lg_concat(b->tape, both, 2, 0);
    lg_var v = lg_slice(b->tape, trig, 1, 0, n + 1);
    return lg_add(b->tape, lg_mse(b->tape, integrals(b, trig), q_given), lg_mse(b->tape, v, v_given));
}

/* ---- as a learning problem ---- */

/* chunk: samples on a tape at once, few enough that the values stay in the L2 cache; for the angle network as
 * many curves as have about 400 places. */
static const struct learned {
    lg_var (*loss)(const part *b, lg_var theta);
    bool points; /* samples are points of curves */
    size_t chunk;
} learned[LG_SURROGATE_KIND_COUNT] = {
    [LG_SURROGATE_DISCRETE] = {discrete_loss, false, 0},
    [LG_SURROGATE_CONTINUOUS] = {continuous_loss, true, 128},
    [LG_SURROGATE_ANGLE] = {angle_loss, false, 0},
};
enum { ANGLE_PLACES = 402 };

/* The loss of `count` samples is a mean over them. */
static lg_status shard_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                            size_t batch, lg_var *loss) {
    const lg_surrogate_problem *problem = user;
    const part b = {problem, tape, samples, count};
    lg_var mean = learned[problem->model->options.kind].loss(&b, theta);
    *loss = count == batch ? mean : lg_scale(tape, mean, (double)count / (double)batch);
    return lg_tape_status(tape);
}

static size_t sample_count(const lg_surrogate_problem *problem) {
    const bool points = learned[problem->model->options.kind].points;
    return problem->training_count * (points ? (size_t)problem->curves->intervals + 1 : 1);
}

lg_status lg_surrogate_problem_check(const lg_surrogate_problem *problem, lg_error *error) {
    const lg_elastica_curves *curves = problem->curves;
    if (problem->model == NULL || curves == NULL || problem->training == NULL ||
        problem->training_count == 0 || curves->boundary == NULL || curves->q == NULL || curves->v == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "no model, no curves, or nothing to learn from");
    if (curves->intervals < LG_ELASTICA_MIN_INTERVALS || curves->intervals > LG_ELASTICA_MAX_INTERVALS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "curves of %u intervals; %d to %d are possible",
                       curves->intervals, LG_ELASTICA_MIN_INTERVALS, LG_ELASTICA_MAX_INTERVALS);
    LG_TRY(lg_surrogate_check_curves(problem->model, curves, error));
    for (size_t i = 0; i < problem->training_count; i++)
        if (problem->training[i] >= curves->count)
            return lg_fail(error, LG_INVALID_ARGUMENT, "curve %u is to be learned; there are %zu",
                           problem->training[i], curves->count);
    const uint64_t per_curve = sample_count(problem) / problem->training_count;
    if (problem->training_count > UINT32_MAX / per_curve)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu curves of %llu samples are 2^32 samples or more",
                       problem->training_count, (unsigned long long)per_curve);
    return LG_OK;
}

void lg_surrogate_fit_problem(const lg_surrogate_problem *problem, lg_fit_problem *out) {
    /* The union only drops const: the loss only reads the problem. */
    union {
        const lg_surrogate_problem *borrowed;
        void *user;
    } pointer = {.borrowed = problem};
    const lg_surrogate_kind kind = problem->model->options.kind;
    size_t chunk = learned[kind].chunk;
    if (kind == LG_SURROGATE_ANGLE) chunk = ANGLE_PLACES / (4 * (size_t)problem->curves->intervals + 1);
    if (kind == LG_SURROGATE_ANGLE && chunk == 0) chunk = 1;
    *out = (lg_fit_problem){.parameters = lg_surrogate_parameters(problem->model),
                            .samples = sample_count(problem),
                            .loss = shard_loss,
                            .user = pointer.user,
                            .chunk = chunk};
}

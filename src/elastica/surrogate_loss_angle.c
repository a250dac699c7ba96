/* Training loss of the angle network, whose curve is the integral of (cos, sin) of the angle. */
#include "core/core.h"
#include "liegrad/ops.h"
#include "elastica/surrogate_loss.h"

typedef lg_loss_part part;
typedef lg_loss_curve curve;

/* Arc length of place r of a curve. A curve has R = 4N + 1 places: its N + 1 nodes, then Gauss point 0 of
 * every interval, Gauss point 1 of every interval, Gauss point 2 of every interval. */
static double place(const part *b, uint32_t r) {
    const uint32_t n = b->problem->curves->intervals;
    if (r <= n) return lg_loss_node_of_data(b, r);
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
        const curve c = lg_loss_curve_at(b, b->samples[i]);
        double angles[2];
        lg_surrogate_angles(c.x, c.sign, angles);
        lg_put_numbers(dtype, given_values, 2 * i, angles, 2);
    }
    for (uint32_t r = 0; r < places; r++) {
        double w[2], dw[2];
        lg_surrogate_end_weights(b->problem->model, place(b, r), w, dw);
        for (size_t end = 0; end < 2; end++) {
            lg_put_numbers(dtype, weight_values, end * places + r, &w[end], 1);
            lg_put_numbers(dtype, slope_values, end * places + r, &dw[end], 1);
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
        const curve c = lg_loss_curve_at(b, b->samples[i]);
        for (uint32_t r = 0; r < places; r++) lg_loss_put_row(b, rows, i * places + r, &c, place(b, r));
    }
    const lg_shape shape = lg_shape2(count, places);
    lg_var f = LG_NONE, slope = LG_NONE;
    if (!lg_loss_has_mechanics(model)) {
        f = lg_net_record(b->tape, &model->net, theta, 0, x);
    } else {
        const lg_var dx = lg_input_f64(b->tape, lg_shape2(1, 3), along);
        if (lg_net_record_jvp(b->tape, &model->net, theta, 0, x, dx, &f, &slope) != LG_OK) return LG_NONE;
        *turning = lg_scale(b->tape, lg_reshape(b->tape, slope, shape), LG_SURROGATE_PI);
    }
    lg_var angle = lg_scale(b->tape, lg_reshape(b->tape, f, shape), LG_SURROGATE_PI);
    return model->options.boundary ? hold_ends(b, angle, places, turning) : angle;
}

/* Integrals from 0 to s_k, k = 0..N, of the function with the values `trig` (2B, R): (2B, N + 1). The
 * quadrature uses the values at the Gauss points and leaves the others out. */
static lg_var integrals(const part *b, lg_var trig) {
    const uint32_t n = b->problem->curves->intervals;
    const double h = b->problem->model->length / n;
    lg_var at[LG_GAUSS_POINTS];
    double weight[LG_GAUSS_POINTS];
    for (uint32_t g = 0; g < LG_GAUSS_POINTS; g++) {
        at[g] = lg_slice(b->tape, trig, 1, n + 1 + g * n, n);
        weight[g] = h * lg_gauss_weight[g];
    }
    const lg_var parts = lg_linear_combination(b->tape, at, weight, LG_GAUSS_POINTS);
    return lg_pad(b->tape, lg_surrogate_running_sums(b->tape, parts, n), 1, 1, 0);
}

/* Writes points relative to `start` into values (2B, N + 1): the x-components of all curves, then the
 * y-components of all curves. The rows of cos and sin on the tape have the same order. */
static void put_components(const part *b, void *values, size_t i, const double *points, const double *start,
                           double sign) {
    const size_t nodes = (size_t)b->problem->curves->intervals + 1;
    for (size_t c = 0; c < 2; c++)
        for (size_t k = 0; k < nodes; k++) {
            const double value = (c == 1 ? sign : 1.0) * (points[2 * k + c] - start[c]);
            lg_put_numbers(lg_tape_dtype(b->tape), values, (c * b->count + i) * nodes + k, &value, 1);
        }
}

/* qN - q0 - I(L) (2B, 1) for the integrals I(s) (2B, N + 1). */
static lg_var missing_chord(const part *b, lg_var integral) {
    const uint32_t n = b->problem->curves->intervals, rows = 2 * (uint32_t)b->count;
    const lg_var chord = lg_reshape(b->tape, lg_transpose(b->tape, lg_loss_chords(b)), lg_shape2(rows, 1));
    return lg_sub(b->tape, chord, lg_slice(b->tape, integral, 1, n, 1));
}

/* For `symmetric`: the integrals I(s) (2B, N + 1) plus (s/L) (qN - q0 - I(L)). */
static lg_var from_both_ends(const part *b, lg_var integral) {
    lg_var rising = LG_NONE, falling = LG_NONE;
    lg_surrogate_shares(b->tape, b->problem->curves->intervals, &rising, &falling);
    return lg_matmul_add(b->tape, missing_chord(b, integral), rising, integral);
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
    return lg_add(t, energies,
                  lg_surrogate_closing(t, b->problem->model, lg_loss_forces(b), lg_concat(t, r, 2, 1)));
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
    if (options->residual > 0.0) loss = lg_loss_add_residual(b, loss, within, x, y);
    if (options->energy == 0.0) return loss;
    return lg_loss_add_energy(b, loss, closed_energy(b, within, integral));
}

lg_var lg_loss_angle(const part *b, lg_var theta) {
    const uint32_t n = b->problem->curves->intervals, places = 4 * n + 1;
    if (b->count > UINT32_MAX / places)
        return lg_tape_fail(b->tape, LG_SHAPE, "surrogate", "the curves have 2^32 places or more");
    const lg_shape shape = lg_shape2(2 * (uint32_t)b->count, n + 1);
    void *q_values, *v_values;
    lg_var q_given = lg_input_buffer(b->tape, shape, &q_values);
    lg_var v_given = lg_input_buffer(b->tape, shape, &v_values);
    if (lg_is_none(v_given)) return LG_NONE;
    for (size_t i = 0; i < b->count; i++) {
        const curve c = lg_loss_curve_at(b, b->samples[i]);
        put_components(b, q_values, i, c.q, c.x + LG_AT_Q0, c.sign);
        put_components(b, v_values, i, c.v, lg_loss_origin, c.sign);
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

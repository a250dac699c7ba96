/* Computes the numbers of a curve from the output of the discrete network: directly, from modes, or from
 * angles. */
#include "elastica/surrogate_internal.h"
#include "model/record.h"

/* ---- angles ---- */

/* Angle of the tangent v (B, 2). A y-component of -0 would give -pi instead of pi; lg_abs makes it 0. */
lg_var lg_surrogate_angle(lg_tape *tape, lg_var v) {
    const lg_var y = lg_columns(tape, v, 1, 1), zero = lg_full(tape, lg_var_shape(tape, y), 0.0);
    const lg_var upper = lg_select(tape, lg_ge(tape, y, zero), lg_abs(tape, y), y);
    return lg_atan2(tape, upper, lg_columns(tape, v, 0, 1));
}

lg_var lg_surrogate_chord(lg_tape *tape, const lg_surrogate *model, lg_var x) {
    const lg_var seen = lg_columns(tape, x, LG_AT_QN, 2);
    const double centre[2] = {model->centre, 0.0}, scale[2] = {model->centre, 1.0};
    if (!model->options.normalise) return seen;
    return lg_add(tape, lg_mul(tape, seen, lg_input_f64(tape, lg_shape2(1, 2), scale)),
                  lg_input_f64(tape, lg_shape2(1, 2), centre));
}

void lg_surrogate_shares(lg_tape *tape, uint32_t intervals, lg_var *rising, lg_var *falling) {
    const lg_shape shape = lg_shape2(1, intervals + 1);
    void *up, *down;
    *rising = lg_input_buffer(tape, shape, &up);
    *falling = lg_input_buffer(tape, shape, &down);
    if (lg_is_none(*falling)) return;
    for (uint32_t k = 0; k <= intervals; k++) {
        const double share = (double)k / intervals, rest = (double)(intervals - k) / intervals;
        lg_put_numbers(lg_tape_dtype(tape), up, k, &share, 1);
        lg_put_numbers(lg_tape_dtype(tape), down, k, &rest, 1);
    }
}

lg_var lg_surrogate_node_angles(lg_tape *tape, const lg_surrogate *model, lg_var theta, lg_var x) {
    lg_var rising = LG_NONE, falling = LG_NONE;
    lg_surrogate_shares(tape, model->intervals, &rising, &falling);
    const lg_var first = lg_surrogate_angle(tape, lg_columns(tape, x, LG_AT_V0, 2));
    const lg_var last = lg_surrogate_angle(tape, lg_columns(tape, x, LG_AT_VN, 2));
    const lg_var line = lg_add(tape, lg_mul(tape, first, falling), lg_mul(tape, last, rising));
    const lg_var f = lg_net_record(tape, &model->net, theta, 0, x);
    return lg_add(tape, line, lg_pad(tape, f, 1, 1, 1));
}

lg_var lg_surrogate_running_sums(lg_tape *tape, lg_var points, uint32_t n) {
    for (uint32_t d = 1; d < n; d *= 2)
        points = lg_add(tape, points, lg_pad(tape, lg_slice(tape, points, 1, 0, n - d), 1, d, 0));
    return points;
}

/* Nodes and tangents from the angles: q_k - q_0 = S_k + (k/N) r, where
 *   S_k = (h/2) sum_{j < k} (v_j + v_{j+1}),   r = q_N - q_0 - S_N. */
static lg_var curve_of_angles(lg_tape *tape, const lg_surrogate *model, lg_var angles, lg_var chord) {
    const uint32_t n = model->intervals, rows = lg_var_shape(tape, angles).dims[0];
    const lg_shape one = lg_shape3(rows, n + 1, 1), flat = lg_shape2(rows, 2 * (n - 1));
    lg_var rising = LG_NONE, falling = LG_NONE;
    lg_surrogate_shares(tape, n, &rising, &falling);
    const lg_var parts[2] = {lg_reshape(tape, lg_cos(tape, angles), one),
                             lg_reshape(tape, lg_sin(tape, angles), one)};
    const lg_var v = lg_concat(tape, parts, 2, 2);
    const lg_var pairs = lg_add(tape, lg_slice(tape, v, 1, 0, n), lg_slice(tape, v, 1, 1, n));
    const lg_var sums = lg_surrogate_running_sums(tape, lg_scale(tape, pairs, 0.5 * model->length / n), n);
    const lg_var whole = lg_slice(tape, sums, 1, n - 1, 1);
    const lg_var r = lg_sub(tape, lg_reshape(tape, chord, lg_shape3(rows, 1, 2)), whole);
    const lg_var shares = lg_reshape(tape, lg_columns(tape, rising, 1, n - 1), lg_shape3(1, n - 1, 1));
    const lg_var q = lg_add(tape, lg_slice(tape, sums, 1, 0, n - 1), lg_mul(tape, r, shares));
    const lg_var both[2] = {lg_reshape(tape, q, flat),
                            lg_reshape(tape, lg_slice(tape, v, 1, 1, n - 1), flat)};
    return lg_concat(tape, both, 2, 1);
}

/* ---- all forms of the network ---- */

lg_var lg_surrogate_net(lg_tape *tape, const lg_surrogate *model, lg_var theta, lg_var x) {
    if (model->options.angles)
        return curve_of_angles(tape, model, lg_surrogate_node_angles(tape, model, theta, x),
                               lg_surrogate_chord(tape, model, x));
    const lg_var y = lg_net_record(tape, &model->net, theta, 0, x);
    return model->options.modes > 0 ? lg_surrogate_sum_modes(tape, model, y) : y;
}

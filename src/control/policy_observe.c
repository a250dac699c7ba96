/* Policies: the observer, observe (seen, u, memory) -> kept, an extended Kalman filter. The estimate
 * (positions, then velocities) has the covariance L L^T; the memory holds the estimate, then the rows of L.
 * `seen` holds the positions, then a 1 for each position that was measured and a 0 for each that was not. */
#include <math.h>

#include "autodiff/program/program.h"
#include "control/policy.h"
#include "liegrad/ops.h"

enum { MOST = LG_POLICY_COORDINATES };

lg_var lg_policy_record_state(lg_tape *tape, const lg_policy *p, lg_var x) {
    const uint32_t n = p->layout.given;
    const lg_var parts[] = {lg_slice(tape, x, 1, 0, n), lg_slice(tape, x, 1, n, n)};
    return lg_program_call(tape, "momenta", 0, parts);
}

lg_var lg_policy_record_inverse(lg_tape *tape, double tiny, lg_var x) {
    const lg_var least = lg_input_f64(tape, lg_shape2(1, 1), &tiny);
    return lg_div(tape, lg_ge(tape, x, least), lg_max(tape, x, least));
}

/* The next positions and velocities from positions, velocities (x) and u. */
LG_POLICY_RECORDING(record_step) {
    const lg_var state = lg_policy_record_state(tape, p, in[0]),
                 next = lg_program_call(tape, "period", 0, (const lg_var[]){state, in[1]});
    out[0] = lg_program_call(tape, "sensed_by_control", 0, &next);
}

/* Makes the rows of (count, columns) lower triangular by reflections from the right, which keep a a^T. The
 * rows have as many columns as there are rows then. */
static void make_triangular(lg_tape *tape, double tiny, uint32_t count, uint32_t columns, lg_var *row) {
    lg_var low[2 * MOST][2 * MOST];
    for (uint32_t i = 0; i < count; i++) {
        const lg_var square = lg_rownorm2(tape, row[i]), first = lg_slice(tape, row[i], 1, 0, 1),
                     end = lg_neg(tape, lg_mul(tape, lg_sqrt(tape, square), lg_sign(tape, first))),
                     /* 1 over half of the squared norm of the reflection's vector */
            by = lg_policy_record_inverse(tape, tiny, lg_sub(tape, square, lg_mul(tape, end, first))),
                     vector = lg_sub(tape, row[i], lg_pad(tape, end, 1, 0, columns - i - 1));
        low[i][i] = end;
        for (uint32_t j = i + 1; j < count; j++) {
            const lg_var part = lg_mul(tape, lg_rowdot(tape, row[j], vector), by);
            row[j] = lg_sub(tape, row[j], lg_mul(tape, vector, part));
            low[j][i] = lg_slice(tape, row[j], 1, 0, 1);
            row[j] = lg_slice(tape, row[j], 1, 1, columns - i - 1);
        }
    }
    for (uint32_t i = 0; i < count; i++)
        row[i] = lg_pad(tape, lg_concat(tape, low[i], i + 1, 1), 1, 0, count - i - 1);
}

/* Corrects the estimate x by the measurement of position i (Potter's square root update). */
static lg_var correct(const lg_policy_filter *f, lg_tape *tape, uint32_t i, lg_var seen, lg_var x,
                      lg_var *row) {
    const uint32_t n = f->policy->layout.given;
    const lg_var square = lg_add_scalar(tape, lg_rownorm2(tape, row[i]), f->sensor[i] * f->sensor[i]),
                 size = lg_sqrt(tape, square), own = row[i],
                 part = lg_div(tape, size, lg_add_scalar(tape, size, f->sensor[i])),
                 on = lg_slice(tape, seen, 1, n + i, 1);
    lg_var gains[2 * MOST], away = lg_sub(tape, lg_slice(tape, seen, 1, i, 1), lg_slice(tape, x, 1, i, 1));
    if (f->policy->task.coordinate[i].motion == LG_POLICY_ANGLE)
        away = lg_atan2(tape, lg_sin(tape, away), lg_cos(tape, away));
    for (uint32_t j = 0; j < 2 * n; j++) gains[j] = lg_rowdot(tape, row[j], own);
    const lg_var gain = lg_mul(tape, lg_concat(tape, gains, 2 * n, 1), lg_div(tape, on, square));
    for (uint32_t j = 0; j < 2 * n; j++)
        row[j] = lg_sub(tape, row[j], lg_mul(tape, own, lg_mul(tape, part, lg_slice(tape, gain, 1, j, 1))));
    return lg_add(tape, x, lg_mul(tape, gain, away));
}

static lg_status record_observe(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in,
                                lg_var *out) {
    const lg_policy_filter *f = user;
    const uint32_t n = f->policy->layout.given, all = 2 * n, rows = lg_var_shape(tape, in[0]).dims[0];
    const lg_var at[2] = {lg_slice(tape, in[2], 1, 0, all), in[1]},
                 F = lg_program_call(tape, "jac_observe_step", 0, at),
                 L = lg_reshape(tape, lg_slice(tape, in[2], 1, all, all * all), lg_shape3(rows, all, all));
    lg_var x = lg_program_call(tape, "observe_step", 0, at), parts[1 + 2 * MOST], *row = parts + 1;
    for (uint32_t i = 0; i < all; i++) { /* F L, then the drift of the velocities */
        double drift[3 * MOST] = {0};
        const lg_var own = lg_reshape(tape, lg_slice(tape, F, 1, i, 1), lg_shape3(rows, all, 1));
        if (i >= n) drift[all + i - n] = f->drift[i - n];
        row[i] = lg_pad(tape, lg_sum_axis(tape, lg_mul(tape, own, L), 1, false), 1, 0, n);
        row[i] = lg_add(tape, row[i], lg_input_f64(tape, lg_shape2(1, all + n), drift));
    }
    make_triangular(tape, f->tiny, all, all + n, row);
    for (uint32_t i = 0; i < n; i++) x = correct(f, tape, i, in[0], x, row);
    parts[0] = x;
    out[0] = lg_concat(tape, parts, 1 + all, 1);
    return lg_tape_status(tape);
}

lg_status lg_policy_add_observer(const lg_policy_filter *f, lg_error *error) {
    static const lg_policy_function step = {"observe_step", record_step, {"given", "u"}, {"next"}};
    static const lg_policy_function observe = {
        "observe", record_observe, {"measured", "u", "estimate"}, {"kept"}};
    LG_TRY(lg_policy_add_row(f->policy, &step, error));
    LG_TRY(lg_program_jacobian(f->policy->program, "observe_step", error));
    return lg_policy_add_row_with(f->policy, &observe, f, error);
}

/* Policies: the adaptation, adapt (x, u, next, memory) -> kept, recursive least squares for each velocity
 * alone. The plant's force less the machine's, over a period, is -damping v - coulomb sign(v) + offset -
 * inertia v'. The four numbers are bounded; `range` scales them to at most 1. The memory has, for each
 * velocity, the scaled numbers (4), then their covariance (4, 4). */
#include <math.h>

#include "control/policy.h"
#include "liegrad/ops.h"

enum { NUMBERS = LG_POLICY_FOUND, MEMORY = LG_POLICY_ADAPT };
const double lg_policy_adapt_lowest[NUMBERS] = {0, 0, -1, -0.2};
static const double noise = 1e-4;

static lg_var row_of(lg_tape *tape, const double *numbers) {
    return lg_input_f64(tape, lg_shape2(1, NUMBERS), numbers);
}

static lg_var bounded(lg_tape *tape, lg_var s) {
    static const double ones[NUMBERS] = {-1, -1, -1, -1};
    const lg_var above = lg_max(tape, s, row_of(tape, lg_policy_adapt_lowest));
    return lg_neg(tape, lg_max(tape, lg_neg(tape, above), row_of(tape, ones)));
}

/* Moves each number outside its bounds to the bound, and the others to their conditional means; `row` are the
 * rows of the covariance. */
static lg_var stay_inside(lg_tape *tape, double tiny, const lg_var *row, lg_var s) {
    for (uint32_t k = 0; k < NUMBERS; k++) {
        const lg_var by = lg_slice(tape, lg_sub(tape, bounded(tape, s), s), 1, k, 1),
                     per = lg_policy_record_inverse(tape, tiny, lg_slice(tape, row[k], 1, k, 1));
        s = lg_add(tape, s, lg_mul(tape, row[k], lg_mul(tape, by, per)));
    }
    return bounded(tape, s);
}

/* One update of the memory (B, MEMORY) of a velocity: `by` are the derivatives of the force by the numbers,
 * `away` is the force that they should give. */
static lg_var recur(const lg_policy_adaptation *a, lg_tape *tape, lg_var memory, lg_var by, lg_var away) {
    lg_var s = lg_slice(tape, memory, 1, 0, NUMBERS), row[NUMBERS], parts[NUMBERS], grown = LG_NONE;
    for (uint32_t k = 0; k < NUMBERS; k++) {
        row[k] = lg_slice(tape, memory, 1, NUMBERS * (k + 1), NUMBERS);
        parts[k] = lg_rowdot(tape, row[k], by);
    }
    const lg_var Pb = lg_concat(tape, parts, NUMBERS, 1),
                 size = lg_add_scalar(tape, lg_rowdot(tape, Pb, by), noise),
                 rest = lg_sub(tape, away, lg_rowdot(tape, by, s)), gain = lg_div(tape, Pb, size);
    s = lg_add(tape, s, lg_mul(tape, gain, rest));
    for (uint32_t k = 0; k < NUMBERS; k++) /* in this order the covariance stays symmetric, bit by bit */
        row[k] = lg_sub(tape, row[k], lg_div(tape, lg_mul(tape, Pb, parts[k]), size));
    s = stay_inside(tape, a->tiny, row, s);
    /* Forgetting stops where data are missing: no variance grows above its value at the start, 1. */
    for (uint32_t k = 0; k < NUMBERS; k++) {
        const lg_var own = lg_slice(tape, row[k], 1, k, 1);
        grown = k == 0 ? own : lg_max(tape, grown, own);
    }
    const lg_var full = lg_ge(tape, grown, lg_input_f64(tape, lg_shape2(1, 1), &a->keep)),
                 factor = lg_add_scalar(tape, lg_scale(tape, full, 1 - 1 / a->keep), 1 / a->keep),
                 next[] = {s, lg_mul(tape, lg_concat(tape, row, NUMBERS, 1), factor)};
    return lg_concat(tape, next, 2, 1);
}

static lg_status record_adapt(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_policy_adaptation *a = user;
    const lg_policy *p = a->policy;
    const uint32_t n = p->layout.given;
    const double period = p->task.period;
    const lg_var from = lg_policy_record_state(tape, p, in[0]), to = lg_policy_record_state(tape, p, in[2]),
                 free = lg_program_call(tape, "period", 0, (const lg_var[]){from, in[1]}),
                 force = lg_scale(tape, lg_slice(tape, lg_sub(tape, to, free), 1, n, n), 1 / period);
    lg_var memory[LG_POLICY_COORDINATES];
    for (uint32_t i = 0; i < n; i++) {
        const double *range = a->range[i], scale = a->scale[i];
        const lg_var v = lg_slice(tape, in[0], 1, n + i, 1), w = lg_slice(tape, in[2], 1, n + i, 1),
                     middle = lg_scale(tape, lg_add(tape, v, w), 0.5),
                     size = lg_add_scalar(tape, lg_abs(tape, middle), 0.01 * a->speed[i]),
                     by[NUMBERS] = {lg_scale(tape, middle, -range[0] / scale),
                                    lg_scale(tape, lg_div(tape, middle, size), -range[1] / scale),
                                    lg_add_scalar(tape, lg_scale(tape, v, 0), range[2] / scale),
                                    lg_scale(tape, lg_sub(tape, w, v), -range[3] / (period * scale))};
        memory[i] =
            recur(a, tape, lg_slice(tape, in[3], 1, MEMORY * i, MEMORY), lg_concat(tape, by, NUMBERS, 1),
                  lg_scale(tape, lg_slice(tape, force, 1, i, 1), 1 / scale));
    }
    out[0] = lg_concat(tape, memory, n, 1);
    return lg_tape_status(tape);
}

/* Returns the root mean square of the rates of x (periods + 1, 2 n), of x if period is 0; 1 if it is 0. */
static double rms(const double *x, size_t periods, size_t n, double period) {
    double sum = 0;
    for (size_t k = 0; k < periods; k++, x += 2 * n)
        sum += pow(period > 0 ? (x[2 * n] - x[0]) / period : x[0], 2);
    return sum > 0 ? sqrt(sum / (double)periods) : 1;
}

void lg_policy_find_ranges(lg_policy_adaptation *a, const double *state, const double *seen, size_t periods) {
    const size_t n = a->policy->layout.given;
    const double period = a->policy->task.period;
    for (size_t i = 0; i < n; i++) {
        const double force = rms(state + n + i, periods, n, period), speed = rms(seen + n + i, periods, n, 0),
                     rate = rms(seen + n + i, periods, n, period),
                     range[NUMBERS] = {2 * force / speed, 2 * force, 2 * force, 4 * force / rate};
        a->scale[i] = force, a->speed[i] = speed;
        for (int k = 0; k < NUMBERS; k++) a->range[i][k] = range[k];
    }
}

lg_status lg_policy_add_adaptation(const lg_policy_adaptation *a, lg_error *error) {
    static const lg_policy_function adapt = {
        "adapt", record_adapt, {"given", "u", "next", "found"}, {"kept"}};
    return lg_policy_add_row_with(a->policy, &adapt, a, error);
}

/* Bounds of V and V' over boxes hold at points of the boxes.
 * ctest-labels: src/certify src/autodiff */
#include "certify_support.h"

#include "certify/certify.h"

static const double low[2] = {-2, -3}, high[2] = {2, 3}, P[4] = {1.5, 0.5, 0.5, 1};

/* x1' = x2 + x1 x2, x2' = -sin x1 - x2 + sat(x1 - 2 x2) + x1^2 x2 */
RECORDING(curved) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1), both = lg_mul(tape, a, b);
    const lg_var u = saturated(tape, lg_sub(tape, a, lg_scale(tape, b, 2)), 0.7);
    const lg_var rest = lg_sub(tape, u, lg_add(tape, lg_sin(tape, a), b));
    const lg_var parts[2] = {lg_add(tape, b, both), lg_add(tape, rest, lg_mul(tape, a, both))};
    y[0] = lg_concat(tape, parts, 2, 1);
}

RECORDING(stepped) {
    lg_var rate;
    (void)curved(NULL, tape, theta, x, &rate);
    y[0] = lg_add(tape, x[0], lg_scale(tape, rate, 0.2));
}

RECORDING(energy) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var rest = lg_add_scalar(tape, lg_neg(tape, lg_cos(tape, a)), 1);
    const lg_var mixed = lg_scale(tape, lg_mul(tape, lg_sin(tape, a), b), 0.3);
    y[0] = lg_add(tape, lg_add(tape, rest, mixed), lg_scale(tape, lg_square(tape, b), 0.5));
}

/* Worst overestimation of the largest V' at points, relative to the range of V', over narrow boxes */
static void check_boxes(lg_certify *c, double size) {
    enum { POINTS = 50 };
    lg_rng rng = test_rng(37, 7);
    void *work = lg_test_memory(lg_interval_work_size(c->point));
    c->batched = 500;
    for (size_t i = 0; i < c->batched; i++)
        for (size_t k = 0; k < 2; k++) {
            const double width = c->to[k] - c->from[k], at = lg_rng_uniform_in(&rng, c->from[k], c->to[k]);
            c->batch[i * 4 + k] = at;
            c->batch[i * 4 + 2 + k] = at + size * lg_rng_uniform(&rng) * width;
        }
    lg_certify_bounds(c);
    for (size_t i = 0; i < c->batched; i++) {
        const double *box = c->batch + 4 * i;
        const lg_certify_box *f = &c->found[i];
        for (size_t p = 0; p < POINTS; p++) {
            double at[2], l[6], h[6];
            for (size_t k = 0; k < 2; k++) {
                const double u = p < 4 ? (double)(p >> k & 1) : lg_rng_uniform(&rng);
                at[k] = fmin(box[k] + u * (box[2 + k] - box[k]), box[2 + k]);
            }
            assert_ok(lg_interval_eval(c->point, 1, at, at, l, h, NULL, work, NULL));
            if (!(l[1] <= f->rise_high)) fail_msg("V' is %.17g, its bound %.17g", l[1], f->rise_high);
            if (!(f->v_low <= h[0] && l[0] <= f->v_high))
                fail_msg("V is %.17g, its bounds %.17g, %.17g", l[0], f->v_low, f->v_high);
        }
    }
}

TEST("bounds of V and V' hold at points, for quadratic and other V, for steps, in wide and narrow boxes") {
    lg_certify_spec spec = spec_for(loop_program(2, curved, energy, NULL), P, low, high);
    lg_certify *quadratic = test_certify(&spec);
    spec.P = NULL;
    spec.lyapunov = "v";
    lg_certify *other = test_certify(&spec);
    lg_certify_spec steps = spec_for(loop_program(2, stepped, NULL, NULL), P, low, high);
    steps.step = true;
    lg_certify *step = test_certify(&steps);
    for (double size = 1e-6; size < 1; size *= 10) {
        check_boxes(quadratic, size);
        check_boxes(other, size);
        check_boxes(step, size);
    }
}

/* Bounds of V and of its rate over boxes: of second order about the middle m of a box, with the Jacobians of
 * the gradient of V and of the rate over the box (certify_program.c). Linear parts of the loop do not lose
 * by that. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "certify/certify.h"
#include "core/portions.h"

/* Memory of one task: boxes with all inputs, middles, and outputs of both. */
typedef struct desk {
    double *low, *high, *at, *out_low, *out_high, *at_low, *at_high;
    uint8_t *flags; /* of out_low and out_high */
    void *work;
} desk;

static desk desk_of(const lg_certify *c, size_t task, size_t *bytes) {
    lg_portions from = {c->work == NULL ? NULL : (char *)c->work + task * c->piece, 0};
    const size_t boxes = LG_CERTIFY_TASK,
                 work[2] = {lg_interval_work_size(c->full),
                            c->flow != NULL ? lg_certify_held_work_size(c) : lg_interval_work_size(c->point)};
    const size_t all = lg_interval_outputs(c->full), few = lg_interval_outputs(c->point);
    const size_t wide = lg_interval_inputs(c->full),
                 sizes[8] = {wide, wide, c->n, all, all, few, few, (all + 7) / 8};
    double *parts[8];
    void *evaluation = lg_portion(&from, work[0] > work[1] ? work[0] : work[1], 1);
    for (size_t i = 0; i < 8; i++) parts[i] = lg_portion(&from, boxes * sizes[i], sizeof(double));
    *bytes = from.used;
    return (desk){parts[0],  parts[1], parts[2], parts[3], parts[4], parts[5], parts[6], (uint8_t *)parts[7],
                  evaluation};
}

lg_status lg_certify_memory(lg_certify *c) {
    (void)desk_of(c, 0, &c->piece);
    c->work = lg_alloc(c->context, LG_CERTIFY_TASKS, c->piece);
    c->batch = lg_alloc(c->context, (size_t)LG_CERTIFY_BATCH * 2 * c->n, sizeof *c->batch);
    c->found = lg_alloc(c->context, LG_CERTIFY_BATCH, sizeof *c->found);
    return c->work != NULL && c->batch != NULL && c->found != NULL ? LG_OK : LG_OUT_OF_MEMORY;
}

/* Bounds at a point that are not finite become so large that nothing can be proved with them: the products
 * are then not finite either, or V' at the point, which is a bound itself, is not. */
static double finite(double x) {
    return x < -DBL_MAX ? -DBL_MAX : x > DBL_MAX ? DBL_MAX : x;
}

/* The least level of V, its gradient and the rate over the box. Where one of their Jacobians may not be
 * defined, nothing holds. */
static uint8_t least_flag(const lg_certify *c, const uint8_t *flags) {
    const size_t all = lg_interval_outputs(c->full), few = 1 + 2 * c->n;
    uint8_t least = LG_INTERVAL_DIFFERENTIABLE;
    for (size_t j = 0; j < all; j++)
        if (flags[j] < least && (j < few || flags[j] == LG_INTERVAL_UNDEFINED)) least = flags[j];
    return least;
}

/* V over the box, in y: for a quadratic V, T^T P T differs from 1 by at most 1e-7. The gradient of another V
 * bounds its changes only if V is Lipschitz continuous on all of the box. */
static void bound_value(const lg_certify *c, const desk *d, size_t i, const double *r, lg_certify_box *f) {
    const size_t wide = lg_interval_inputs(c->full);
    const double *low = d->low + i * wide, *high = d->high + i * wide;
    const double *l = d->out_low + i * lg_interval_outputs(c->full),
                 *h = d->out_high + i * lg_interval_outputs(c->full);
    double least = 0, most = 0;
    for (size_t k = 0; k < c->n; k++) {
        const double far = fmax(-low[k], high[k]), near = fmax(fmax(low[k], -high[k]), 0.0);
        least += near * near;
        most += far * far;
    }
    if (c->quadratic) {
        f->v_low = least * (1 - 2e-7);
        f->v_high = most * (1 + 2e-7);
        return;
    }
    double change = 0;
    const uint8_t flag = d->flags[i * lg_interval_outputs(c->full)];
    for (size_t k = 0; k < c->n; k++)
        change = lg_certify_up(change + lg_certify_size(l[1 + k], h[1 + k]) * r[k]);
    if (flag < LG_INTERVAL_LIPSCHITZ) {
        f->v_low = flag == LG_INTERVAL_UNDEFINED ? -DBL_MAX : l[0];
        f->v_high = flag == LG_INTERVAL_UNDEFINED ? DBL_MAX : h[0];
        return;
    }
    f->v_low = fmax(l[0], -lg_certify_up(-f->at_v_low + change));
    f->v_high = fmin(h[0], lg_certify_up(f->at_v_high + change));
}

/* The bound of a rise of V on the part of a box in {V <= c}, where c - V is not below 0: a multiple of c - V,
 * which makes the rise level along the ray through the middle, is added. |y|^2 <= c (1 + 3e-7), as in
 * bound_value. Replaces `rise` and `part` if it is smaller. */
static void bound_inside(const lg_certify *c, const double *at, const double *l, const double *h,
                         const double *r, double base, double *rise, double *part) {
    enum { MOST = LG_CERTIFY_STATES };
    const size_t n = c->n;
    double low[MOST + MOST * MOST], high[MOST + MOST * MOST], inside[MOST], along = 0, square = 0;
    for (size_t k = 0; k < n; k++) {
        along += (0.5 * l[k] + 0.5 * h[k]) * at[k];
        square += at[k] * at[k];
    }
    const double by = 0.5 * along / square;
    if (!(by > 0 && by < DBL_MAX)) return;
    memcpy(low, l, (n + n * n) * sizeof *l);
    memcpy(high, h, (n + n * n) * sizeof *h);
    for (size_t k = 0; k < n; k++) {
        const double shift = 2 * by * at[k];
        low[k] -= shift + (fabs(shift) + fabs(l[k])) * 1e-15;
        high[k] -= shift - (fabs(shift) + fabs(h[k])) * 1e-15;
        high[n + k * n + k] -= 2 * by - (by + fabs(high[n + k * n + k])) * 1e-15;
    }
    const double rest = c->level * (1 + 3e-7) - square,
                 sum = lg_certify_up(base + by * (rest + (c->level + square) * 1e-13)),
                 most = lg_certify_up(sum + lg_certify_form(n, low, high, r, inside));
    if (!(most < *rise)) return;
    *rise = most;
    memcpy(part, inside, n * sizeof *part);
}

/* most: the flag of what the inputs of `full` were computed from */
static void combine(const lg_certify *c, const desk *d, size_t i, uint8_t most, lg_certify_box *f) {
    const size_t n = c->n, outputs = lg_interval_outputs(c->full), few = lg_interval_outputs(c->point);
    const size_t wide = lg_interval_inputs(c->full);
    const double *low = d->low + i * wide, *high = d->high + i * wide, *at = d->at + i * n;
    const double *lever_l = d->out_low + i * outputs + 1, *lever_h = d->out_high + i * outputs + 1;
    const double *l = lever_l + 2 * n, *h = lever_h + 2 * n; /* g, M + M^T */
    const double *at_l = d->at_low + i * few, *at_h = d->at_high + i * few;
    double r[LG_CERTIFY_STATES] = {0}, part[LG_CERTIFY_STATES], rise = at_h[1], force = 0, at_force = 0;
    memcpy(f->at, at, n * sizeof *at);
    f->at_v_low = at_l[0];
    f->at_v_high = at_h[0];
    for (size_t k = 0; k < n; k++) r[k] = fmax(high[k] - at[k], at[k] - low[k]) * (1 + 1e-15);
    rise = lg_certify_up(rise + lg_certify_form(n, l, h, r, part));
    bound_value(c, d, i, r, f);
    double inside = rise;
    if (c->quadratic && c->phase == LG_CERTIFY_FALL && f->v_low <= c->level && f->v_high > c->level)
        bound_inside(c, at, l, h, r, at_h[1], &inside, part);
    for (size_t k = 0; k < n && c->errors; k++) {
        force = lg_certify_up(force + lg_certify_size(lever_l[k], lever_h[k]) * c->error[k]);
        at_force += fmax(fmax(at_l[2 + k], -at_h[2 + k]), 0.0) * c->error[k] * (1 - 1e-12);
        for (size_t j = 0; j < n && c->step; j++)
            force = lg_certify_up(force + fabs(c->P[k * n + j]) * c->error[k] * c->error[j]);
    }
    f->rise_high = lg_certify_up(rise + force);
    f->rise_inside = lg_certify_up(inside + force);
    f->at_rise_low = at_l[1] + (c->step ? 0 : at_force);
    f->flag = least_flag(c, d->flags + i * outputs);
    if (most < f->flag) f->flag = most;
    double widest = -1;
    for (size_t k = 0; k < n; k++) {
        const double side = (high[k] - low[k]) / (c->to[k] - c->from[k]);
        const bool by_side = c->phase != LG_CERTIFY_FALL || f->flag < LG_INTERVAL_LIPSCHITZ;
        const double weight = by_side ? side : r[k] == 0 ? -1 : isfinite(part[k]) ? part[k] : DBL_MAX * side;
        if (weight <= widest) continue;
        widest = weight;
        f->split = (uint32_t)k;
    }
}

/* Whether more steps in the period may prove it: only the bounds at the middle are too wide. */
static bool needs_steps(const lg_certify *c, const desk *d, size_t i, const lg_certify_box *f) {
    const size_t few = lg_interval_outputs(c->point);
    const double low = d->at_low[i * few + 1], high = d->at_high[i * few + 1];
    return c->phase == LG_CERTIFY_FALL && f->rise_inside >= 0.0 && f->rise_inside - (high - low) < 0.0;
}

/* Boxes over which V changes by more than this part of the level are halved where they have no tube; others
 * have more steps first. */
static const double wide = 0.2;

static void held_task(const lg_certify *c, desk *d, size_t first, size_t boxes) {
    const size_t n = c->n;
    double gain[LG_CERTIFY_TASK];
    bool unbounded[LG_CERTIFY_TASK], no_tube[LG_CERTIFY_TASK];
    uint8_t flag[LG_CERTIFY_TASK];
    size_t index[LG_CERTIFY_TASK], left = boxes;
    for (size_t i = 0; i < boxes; i++) index[i] = i;
    for (uint32_t k = 0; k < LG_FLOW_DOUBLINGS && left > 0; k++) {
        size_t more = 0;
        const lg_certify_held_boxes all = {left,    index,     c->batch + first * 2 * n,
                                           d->at,   k,         d->low,
                                           d->high, d->at_low, d->at_high,
                                           gain,    unbounded, no_tube,
                                           flag};
        lg_certify_held(c, &all, d->work);
        (void)lg_interval_eval(c->full, left, d->low, d->high, d->out_low, d->out_high, d->flags, d->work,
                               NULL);
        for (size_t i = 0; i < left; i++) {
            lg_certify_box *f = &c->found[first + index[i]];
            combine(c, d, i, flag[i], f);
            f->gain = gain[i];
            f->doublings = k;
            if (unbounded[i]) {
                f->rise_high = f->rise_inside = f->gain = (double)INFINITY;
                f->at_rise_low = -(double)INFINITY;
            }
            if (no_tube[i] ? f->v_high - f->v_low > wide * c->level
                           : unbounded[i] || !needs_steps(c, d, i, f))
                continue;
            memmove(d->at + more * n, d->at + i * n, n * sizeof *d->at);
            index[more++] = index[i];
        }
        left = more;
    }
}

static void task(void *user, size_t number) {
    const lg_certify *c = user;
    const size_t first = number * LG_CERTIFY_TASK, n = c->n, few = lg_interval_outputs(c->point);
    const size_t boxes = c->batched - first < LG_CERTIFY_TASK ? c->batched - first : LG_CERTIFY_TASK;
    size_t bytes;
    desk d = desk_of(c, number, &bytes);
    for (size_t i = 0; i < boxes; i++)
        for (size_t k = 0; k < n; k++) {
            const double *box = c->batch + (first + i) * 2 * n;
            d.at[i * n + k] = 0.5 * box[k] + 0.5 * box[n + k];
        }
    if (c->flow != NULL) {
        held_task(c, &d, first, boxes);
        return;
    }
    (void)lg_interval_eval(c->point, boxes, d.at, d.at, d.at_low, d.at_high, NULL, d.work, NULL);
    for (size_t i = 0; i < boxes; i++)
        for (size_t k = 0; k < n; k++) {
            const double *box = c->batch + (first + i) * 2 * n;
            double *low = d.low + i * 3 * n, *high = d.high + i * 3 * n;
            low[k] = box[k];
            high[k] = box[n + k];
            for (size_t p = 0; p < 2; p++) { /* gradient and rate at the middle */
                low[(1 + p) * n + k] = finite(d.at_low[i * few + 2 + p * n + k]);
                high[(1 + p) * n + k] = finite(d.at_high[i * few + 2 + p * n + k]);
            }
        }
    (void)lg_interval_eval(c->full, boxes, d.low, d.high, d.out_low, d.out_high, d.flags, d.work, NULL);
    for (size_t i = 0; i < boxes; i++) combine(c, &d, i, LG_INTERVAL_DIFFERENTIABLE, &c->found[first + i]);
}

void lg_certify_bounds(lg_certify *c) {
    const size_t tasks = (c->batched + LG_CERTIFY_TASK - 1) / LG_CERTIFY_TASK;
    if (c->pool != NULL)
        lg_thread_pool_run(c->pool, tasks, task, c);
    else
        for (size_t i = 0; i < tasks; i++) task(c, i);
}

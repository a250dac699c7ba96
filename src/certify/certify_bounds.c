/* Bounds of V and of its rate over boxes: of second order about the middle m of a box, with the Jacobians of
 * the gradient of V and of the rate over the box (certify_program.c). Linear parts of the loop do not lose
 * by that. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "certify/certify.h"
#include "core/portions.h"

typedef lg_certify_desk desk;

static desk desk_of(const lg_certify *c, size_t task, size_t *bytes) {
    const size_t n = c->n, boxes = LG_CERTIFY_TASK, outputs = lg_interval_outputs(c->full),
                 held = c->flow != NULL,
                 work[3] = {lg_interval_work_size(c->full), lg_interval_work_size(c->point),
                            lg_interval_work_size(c->part)};
    lg_portions from = {c->work == NULL ? NULL : (char *)c->work + task * c->piece, 0};
    desk d = {.c = c};
    const struct {
        lg_bounds *to;
        size_t width;
    } all[] = {{&d.y, n},        {&d.at, n},           {&d.value, 2}, {&d.G, n},        {&d.F, n},
               {&d.X, held * n}, {&d.S, held * n * n}, {&d.t, held},  {&d.out, outputs}};
    size_t most = 0;
    for (size_t i = 0; i < LG_COUNT(work); i++) most = work[i] > most ? work[i] : most;
    for (size_t i = 0; i < LG_COUNT(all); i++) *all[i].to = lg_bounds_take(&from, boxes, all[i].width);
    d.work = lg_portion(&from, most, 1);
    d.flow = held ? lg_portion(&from, lg_flow_work_size(c->flow), 1) : NULL;
    d.r = lg_portion(&from, boxes * n, sizeof *d.r);
    d.gain = lg_portion(&from, boxes, sizeof *d.gain);
    d.base = lg_portion(&from, boxes, sizeof *d.base);
    d.flags = lg_portion(&from, boxes * outputs, 1);
    d.flag = lg_portion(&from, boxes, 1);
    d.unbounded = lg_portion(&from, boxes, 1);
    d.no_tube = lg_portion(&from, boxes, 1);
    *bytes = from.used;
    return d;
}

lg_status lg_certify_memory(lg_certify *c) {
    (void)desk_of(c, 0, &c->piece);
    return LG_ALLOC_ALL(c->context, {&c->work, LG_CERTIFY_TASKS, c->piece},
                        LG_ARRAY(c->batch, (size_t)LG_CERTIFY_BATCH * 2 * c->n),
                        LG_ARRAY(c->found, LG_CERTIFY_BATCH));
}

/* The least level of V, its gradient and the rate over the box. Where one of their Jacobians may not be
 * defined, nothing holds. */
static uint8_t least_flag(const desk *d, const uint8_t *flags) {
    const size_t all = d->out.width, few = 1 + 2 * d->c->n;
    uint8_t least = LG_INTERVAL_DIFFERENTIABLE;
    for (size_t j = 0; j < all; j++)
        if (flags[j] < least && (j < few || flags[j] == LG_INTERVAL_UNDEFINED)) least = flags[j];
    return least;
}

/* V over the box, in y: for a quadratic V, T^T P T differs from 1 by at most 1e-7. The gradient of another V
 * bounds its changes only if V is Lipschitz continuous on all of the box. */
static void bound_value(const desk *d, size_t i, const double *r, lg_certify_box *f) {
    const lg_certify *c = d->c;
    const double *low = d->y.low + i * c->n, *high = d->y.high + i * c->n;
    const double *l = d->out.low + i * d->out.width, *h = d->out.high + i * d->out.width;
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
    const uint8_t flag = d->flags[i * d->out.width];
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

static void combine(const desk *d, size_t i, lg_certify_box *f) {
    const lg_certify *c = d->c;
    const size_t n = c->n, outputs = d->out.width;
    const double *low = d->y.low + i * n, *high = d->y.high + i * n, *at = d->at.low + i * n,
                 *r = d->r + i * n;
    const double *lever_l = d->out.low + i * outputs + 1, *lever_h = d->out.high + i * outputs + 1;
    const double *l = lever_l + 2 * n, *h = lever_h + 2 * n; /* g, M + M^T */
    const double *at_l = d->value.low + 2 * i, *at_h = d->value.high + 2 * i, *G_l = d->G.low + i * n,
                 *G_h = d->G.high + i * n;
    double part[LG_CERTIFY_STATES], rise = at_h[1], force = 0, at_force = 0;
    memcpy(f->at, at, n * sizeof *at);
    f->at_v_low = at_l[0];
    f->at_v_high = at_h[0];
    rise = lg_certify_up(rise + lg_certify_form(n, l, h, r, part));
    bound_value(d, i, r, f);
    double inside = rise;
    if (c->quadratic && c->phase == LG_CERTIFY_FALL && f->v_low <= c->level && f->v_high > c->level)
        bound_inside(c, at, l, h, r, at_h[1], &inside, part);
    for (size_t k = 0; k < n && c->errors; k++) {
        force = lg_certify_up(force + lg_certify_size(lever_l[k], lever_h[k]) * c->error[k]);
        at_force += fmax(fmax(G_l[k], -G_h[k]), 0.0) * c->error[k] * (1 - 1e-12);
        for (size_t j = 0; j < n && c->step; j++)
            force = lg_certify_up(force + fabs(c->P[k * n + j]) * c->error[k] * c->error[j]);
    }
    f->rise_high = lg_certify_up(rise + force);
    f->rise_inside = lg_certify_up(inside + force);
    f->at_rise_low = at_l[1] + (c->step ? 0 : at_force);
    f->flag = least_flag(d, d->flags + i * outputs);
    if (d->flag[i] < f->flag) f->flag = d->flag[i];
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

/* Whether more steps in the period of a held loop may prove it: only the bounds at the middle are too wide.
 * Boxes over which V changes by more than `wide` of the level are halved where they have no tube. */
static bool needs_steps(const desk *d, size_t i, const lg_certify_box *f) {
    static const double wide = 0.2;
    const double spread = d->value.high[2 * i + 1] - d->value.low[2 * i + 1];
    if (d->no_tube[i]) return f->v_high - f->v_low <= wide * d->c->level;
    return !d->unbounded[i] && d->c->phase == LG_CERTIFY_FALL && f->rise_inside >= 0.0 &&
           f->rise_inside - spread < 0.0;
}

/* Takes boxes of the batch. */
static void take(desk *d, size_t first, const size_t *index, size_t count) {
    const size_t n = d->c->n;
    for (size_t i = 0; i < count * n; i++) {
        const double *box = d->c->batch + (first + index[i / n]) * 2 * n, l = box[i % n], h = box[n + i % n];
        const double at = 0.5 * l + 0.5 * h;
        d->y.low[i] = l, d->y.high[i] = h;
        d->at.low[i] = d->at.high[i] = at;
        d->r[i] = fmax(h - at, at - l) * (1 + 1e-15);
    }
    memset(d->gain, 0, count * sizeof *d->gain);
    memset(d->flag, LG_INTERVAL_DIFFERENTIABLE, count);
    memset(d->unbounded, 0, count * sizeof *d->unbounded);
    memset(d->no_tube, 0, count * sizeof *d->no_tube);
}

/* Bounds of `point` and `full`. A box without bounds at its middle or of a period has none. */
static void evaluate(desk *d, size_t count) {
    const lg_certify *c = d->c;
    const bool held = c->flow != NULL;
    const lg_bounds *const at[] = {&d->at, &d->F}, *const found[] = {&d->value, &d->G, &d->F},
                           *const in[] = {&d->y, &d->G, &d->F, &d->X, &d->S}, *const out[] = {&d->out};
    lg_interval_bound(c->point, count, at, held ? 2 : 1, found, held ? 2 : 3, NULL, d->unbounded, d->work);
    lg_interval_bound(c->full, count, in, held ? 5 : 3, out, 1, d->flags, d->unbounded, d->work);
}

static void task(void *user, size_t number) {
    const lg_certify *c = user;
    const size_t first = number * LG_CERTIFY_TASK;
    size_t bytes, index[LG_CERTIFY_TASK], left = c->batched - first;
    desk d = desk_of(c, number, &bytes);
    if (left > LG_CERTIFY_TASK) left = LG_CERTIFY_TASK;
    for (size_t i = 0; i < left; i++) index[i] = i;
    for (uint32_t k = 0; k < LG_FLOW_DOUBLINGS && left > 0; k++) {
        size_t more = 0;
        take(&d, first, index, left);
        if (c->flow != NULL) lg_certify_held(&d, left, k);
        evaluate(&d, left);
        for (size_t i = 0; i < left; i++) {
            lg_certify_box *f = &c->found[first + index[i]];
            combine(&d, i, f);
            f->gain = d.gain[i];
            f->doublings = k;
            if (d.unbounded[i]) {
                f->rise_high = f->rise_inside = f->gain = (double)INFINITY;
                f->at_rise_low = -(double)INFINITY;
            }
            if (c->flow != NULL && needs_steps(&d, i, f)) index[more++] = index[i];
        }
        left = more;
    }
}

void lg_certify_bounds(lg_certify *c) {
    const size_t tasks = (c->batched + LG_CERTIFY_TASK - 1) / LG_CERTIFY_TASK;
    lg_thread_pool_run(c->pool, tasks, task, c);
}

/* Bounds of V and of its rate over boxes: the natural form, and the mean value form about a point that is good for
 * the rate (Baumann 1988). */
#include <float.h>
#include <math.h>
#include <string.h>

#include "control/certify.h"

enum { MOST = LG_CERTIFY_INPUTS };

/* Memory of one task: boxes with all inputs, points, and outputs of both. */
typedef struct desk {
    double *low, *high, *at, *out_low, *out_high, *at_low, *at_high;
    void *work;
} desk;

static size_t round_up(size_t bytes) {
    return (bytes + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT;
}

static desk desk_of(const lg_certify *c, size_t task, size_t *bytes) {
    unsigned char *base = c->work == NULL ? NULL : (unsigned char *)c->work + task * c->piece;
    const size_t boxes = LG_CERTIFY_TASK,
                 work[2] = {lg_interval_work_size(c->full), lg_interval_work_size(c->point)};
    const size_t sizes[7] = {
        c->inputs, c->inputs, c->inputs, lg_interval_outputs(c->full), lg_interval_outputs(c->full), 2, 2};
    double *parts[7];
    size_t used = round_up(work[0] > work[1] ? work[0] : work[1]);
    for (size_t i = 0; i < 7; i++) {
        parts[i] = base == NULL ? NULL : (double *)(void *)(base + used);
        used += round_up(boxes * sizes[i] * sizeof(double));
    }
    *bytes = used;
    return (desk){parts[0], parts[1], parts[2], parts[3], parts[4], parts[5], parts[6], base};
}

lg_status lg_certify_memory(lg_certify *c) {
    (void)desk_of(c, 0, &c->piece);
    c->work = lg_alloc(c->context, LG_CERTIFY_TASKS, c->piece);
    c->batch = lg_alloc(c->context, (size_t)LG_CERTIFY_BATCH * 2 * c->n, sizeof *c->batch);
    c->found = lg_alloc(c->context, LG_CERTIFY_BATCH, sizeof *c->found);
    return c->work != NULL && c->batch != NULL && c->found != NULL ? LG_OK : LG_OUT_OF_MEMORY;
}

/* The point for which D(at) + max J (y - at) is least; the middle where the slope is unknown. */
static double best_point(double low, double high, double slope_low, double slope_high) {
    const double middle = 0.5 * low + 0.5 * high;
    if (slope_low >= 0.0) return high;
    if (slope_high <= 0.0) return low;
    const double at = (slope_high * high - slope_low * low) / (slope_high - slope_low);
    return at >= low && at <= high ? at : middle;
}

/* A bound of max J (y - at) over the box, rounded up. */
static double most_rise(double low, double high, double at, double slope_low, double slope_high) {
    const double up = (high - at) * slope_high, down = (low - at) * slope_low;
    return high == low ? 0.0 : fmax(fmax(up, down), 0.0) * (1 + 1e-14) + DBL_MIN;
}

/* value + change, rounded up; no bound where it is not a number */
static double above(double value, double change) {
    const double sum = value + change;
    return sum == sum ? sum + (fabs(value) + fabs(change)) * 1e-14 : (double)INFINITY;
}

static void combine(const lg_certify *c, const desk *d, size_t i, lg_certify_box *f) {
    const size_t m = c->inputs, outputs = lg_interval_outputs(c->full);
    const double *low = d->low + i * m, *high = d->high + i * m, *at = d->at + i * m;
    const double *l = d->out_low + i * outputs, *h = d->out_high + i * outputs;
    const double *v_low = l + 2, *v_high = h + 2, *r_low = l + 2 + m, *r_high = h + 2 + m;
    double rise = 0, fall_v = 0, rise_v = 0, widest = -1;
    for (size_t k = 0; k < m; k++) {
        rise += most_rise(low[k], high[k], at[k], r_low[k], r_high[k]);
        rise_v += most_rise(low[k], high[k], at[k], v_low[k], v_high[k]);
        fall_v += most_rise(low[k], high[k], at[k], -v_high[k], -v_low[k]);
    }
    f->v_low = l[0];
    f->v_high = h[0];
    f->rise_high = h[1];
    f->at_v_low = d->at_low[2 * i];
    f->at_v_high = d->at_high[2 * i];
    f->at_rise_low = d->at_low[2 * i + 1];
    if (c->smooth) {
        f->v_low = fmax(f->v_low, -above(-f->at_v_low, fall_v));
        f->v_high = fmin(f->v_high, above(f->at_v_high, rise_v));
        f->rise_high = fmin(f->rise_high, above(d->at_high[2 * i + 1], rise));
    }
    memcpy(f->at, at, m * sizeof *at);
    for (size_t k = 0; k < c->n; k++) {
        const bool fall = c->phase == LG_CERTIFY_FALL;
        const double slope = fall ? fmax(-r_low[k], r_high[k]) : fmax(-v_low[k], v_high[k]);
        const double wide = high[k] - low[k], part = wide / (c->to[k] - c->from[k]);
        const double smear = wide == 0.0 ? -1 : c->smooth && isfinite(slope) ? slope * wide : DBL_MAX * part;
        /* A side that is long beside the others is halved, whatever the slope. */
        if (smear <= widest) continue;
        widest = smear;
        f->split = (uint32_t)k;
        f->upper_last = v_low[k] + v_high[k] < 0;
    }
}

static void task(void *user, size_t number) {
    const lg_certify *c = user;
    const size_t first = number * LG_CERTIFY_TASK, m = c->inputs;
    const size_t boxes = c->batched - first < LG_CERTIFY_TASK ? c->batched - first : LG_CERTIFY_TASK;
    const size_t outputs = lg_interval_outputs(c->full);
    size_t bytes;
    const desk d = desk_of(c, number, &bytes);
    for (size_t i = 0; i < boxes; i++) {
        const double *box = c->batch + (first + i) * 2 * c->n;
        for (size_t k = 0; k < m; k++) {
            d.low[i * m + k] = k < c->n ? box[k] : -c->error[k - c->n];
            d.high[i * m + k] = k < c->n ? box[c->n + k] : c->error[k - c->n];
        }
    }
    (void)lg_interval_eval(c->full, boxes, d.low, d.high, d.out_low, d.out_high, d.work, NULL);
    for (size_t i = 0; i < boxes; i++)
        for (size_t k = 0; k < m; k++) {
            const size_t j = i * m + k, slope = i * outputs + 2 + m + k;
            d.at[j] = best_point(d.low[j], d.high[j], d.out_low[slope], d.out_high[slope]);
        }
    (void)lg_interval_eval(c->point, boxes, d.at, d.at, d.at_low, d.at_high, d.work, NULL);
    for (size_t i = 0; i < boxes; i++) combine(c, &d, i, &c->found[first + i]);
}

void lg_certify_bounds(lg_certify *c) {
    const size_t tasks = (c->batched + LG_CERTIFY_TASK - 1) / LG_CERTIFY_TASK;
    if (c->pool != NULL)
        lg_thread_pool_run(c->pool, tasks, task, c);
    else
        for (size_t i = 0; i < tasks; i++) task(c, i);
}

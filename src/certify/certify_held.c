/* Held loops: what a proof needs of the flow of a period (flow.c). */
#include <float.h>
#include <math.h>
#include <string.h>

#include "certify/certify.h"
#include "core/portions.h"

/* Boxes that are evaluated together, and the results of their flows */
typedef struct held {
    const lg_certify *c;
    double *low, *high, *in_low, *in_high, *out_low, *out_high, *r, *gain, *base;
    lg_bounds F, S, X;
    void *work; /* of evaluators */
} held;

static held held_of(const lg_certify *c, void *base, size_t *used) {
    const size_t n = c->n, part = lg_interval_inputs(c->part), boxes = LG_FLOW_BOXES;
    const size_t most = lg_interval_outputs(c->part) + lg_interval_outputs(c->point);
    const size_t work[3] = {lg_flow_work_size(c->flow), lg_interval_work_size(c->part),
                            lg_interval_work_size(c->point)};
    held h = {.c = c, .F = {.width = n}, .S = {.width = n * n}, .X = {.width = n}};
    lg_portions from = {base, 0};
    for (int i = 0; i < 3; i++) { /* the flow reports parts while it uses its own memory */
        void *one = lg_portion(&from, work[i], 1);
        if (i == 1) h.work = one;
    }
    const struct {
        double **to;
        size_t width;
    } all[] = {{&h.low, n},        {&h.high, n},        {&h.in_low, part}, {&h.in_high, part},
               {&h.out_low, most}, {&h.out_high, most}, {&h.r, n},         {&h.base, 1},
               {&h.F.low, n},      {&h.F.high, n},      {&h.S.low, n * n}, {&h.S.high, n * n},
               {&h.X.low, n},      {&h.X.high, n}};
    for (size_t i = 0; i < LG_COUNT(all); i++)
        *all[i].to = lg_portion(&from, boxes * all[i].width, sizeof(double));
    *used = from.used;
    return h;
}

size_t lg_certify_held_work_size(const lg_certify *c) {
    size_t used;
    (void)held_of(c, NULL, &used);
    return used;
}

/* V grows by at most `base` until the step begins, and by `gain` at any time so far. */
static void add_part(void *user, size_t boxes, const lg_bounds *F, const lg_bounds *S, const lg_bounds *D,
                     const lg_bounds *Q, double from, double to) {
    held *h = user;
    const size_t n = h->c->n, width = lg_interval_inputs(h->c->part),
                 outputs = lg_interval_outputs(h->c->part);
    const lg_bounds t = {&from, &to, 1};
    const lg_bounds *const in[5] = {F, S, D, Q, &t};
    bool none[LG_FLOW_BOXES] = {false};
    for (size_t i = 0; i < boxes; i++) {
        double *low = h->in_low + i * width, *high = h->in_high + i * width;
        for (size_t p = 0; p < 5; p++)
            for (size_t j = 0; j < in[p]->width; j++) {
                const size_t place = p == 4 ? 0 : i * in[p]->width + j;
                const double l = in[p]->low[place], u = in[p]->high[place];
                const bool finite = l >= -DBL_MAX && u <= DBL_MAX;
                none[i] = none[i] || !finite;
                *low++ = finite ? l : 0;
                *high++ = finite ? u : 0;
            }
    }
    (void)lg_interval_eval(h->c->part, boxes, h->in_low, h->in_high, h->out_low, h->out_high, NULL, h->work,
                           NULL);
    for (size_t i = 0; i < boxes; i++) {
        const double *l = h->out_low + i * outputs, *u = h->out_high + i * outputs;
        const double sup = u[0] + lg_certify_form(n, l + 1, u + 1, h->r + i * n, NULL);
        const double by = none[i] || !(sup < DBL_MAX) ? (double)INFINITY : to * (sup + fabs(sup) * 1e-13);
        if (from < to)
            h->gain[i] = fmax(h->gain[i], h->base[i] + fmax(by, 0));
        else
            h->base[i] += by;
        h->gain[i] += fabs(h->gain[i]) * 1e-13;
        h->base[i] += fabs(h->base[i]) * 1e-13;
    }
}

/* Inputs of `full`; the gradient follows later. */
static void put(const held *h, size_t i, const lg_certify_held_boxes *b) {
    const size_t n = h->c->n, wide = lg_interval_inputs(h->c->full);
    double *low = b->low + i * wide, *high = b->high + i * wide;
    memcpy(low, h->low + i * n, n * sizeof *low);
    memcpy(high, h->high + i * n, n * sizeof *high);
    const lg_bounds *const all[3] = {&h->F, &h->X, &h->S};
    for (size_t p = 0, at = 2 * n; p < 3; at += all[p++]->width) {
        memcpy(low + at, all[p]->low + i * all[p]->width, all[p]->width * sizeof *low);
        memcpy(high + at, all[p]->high + i * all[p]->width, all[p]->width * sizeof *high);
    }
}

/* The outputs of `point` at the middles, whose inputs are y and F; the gradient is an input of `full`. */
static void evaluate_points(const held *h, const lg_certify_held_boxes *b) {
    const size_t n = h->c->n, wide = lg_interval_inputs(h->c->full), few = lg_interval_outputs(h->c->point);
    for (size_t i = 0; i < b->count; i++) {
        double *low = h->in_low + i * 2 * n, *high = h->in_high + i * 2 * n;
        memcpy(low, b->at + i * n, n * sizeof *low);
        memcpy(high, b->at + i * n, n * sizeof *high);
        memcpy(low + n, b->low + i * wide + 2 * n, n * sizeof *low);
        memcpy(high + n, b->high + i * wide + 2 * n, n * sizeof *high);
    }
    (void)lg_interval_eval(h->c->point, b->count, h->in_low, h->in_high, b->at_low, b->at_high, NULL, h->work,
                           NULL);
    for (size_t i = 0; i < b->count; i++) {
        memcpy(b->low + i * wide + n, b->at_low + i * few + 2, n * sizeof(double));
        memcpy(b->high + i * wide + n, b->at_high + i * few + 2, n * sizeof(double));
        for (size_t j = 0; j < wide; j++)
            if (!(b->low[i * wide + j] >= -DBL_MAX && b->high[i * wide + j] <= DBL_MAX)) {
                b->low[i * wide + j] = b->high[i * wide + j] = 0;
                b->unbounded[i] = true;
            }
    }
}

void lg_certify_held(const lg_certify *c, const lg_certify_held_boxes *b, void *work) {
    const size_t n = c->n;
    size_t used;
    held h = held_of(c, work, &used);
    h.gain = b->gain;
    for (size_t i = 0; i < b->count; i++) {
        const double *box = b->box + b->index[i] * 2 * n, *at = b->at + i * n;
        memcpy(h.low + i * n, box, n * sizeof *box);
        memcpy(h.high + i * n, box + n, n * sizeof *box);
        for (size_t j = 0; j < n; j++)
            h.r[i * n + j] = fmax(box[n + j] - at[j], at[j] - box[j]) * (1 + 1e-15);
        h.gain[i] = h.base[i] = 0;
    }
    const lg_flow_boxes flow = {
        b->count,   b->at,  h.low, h.high, b->doublings,  c->phase == LG_CERTIFY_BETWEEN ? add_part : NULL,
        &h,         h.F,    h.S,   h.X,    {.low = NULL}, b->unbounded,
        b->no_tube, b->flag};
    lg_flow_eval(c->flow, &flow, work);
    for (size_t i = 0; i < b->count; i++) put(&h, i, b);
    evaluate_points(&h, b);
}

/* The gradient and its Jacobian are not needed of a quadratic V. */
lg_status lg_certify_held_local(const lg_certify *c, const double *from, const double *to, double *low,
                                double *high, bool *slopes) {
    const size_t n = c->n;
    uint8_t flag;
    double at[LG_CERTIFY_STATES], X[2 * LG_CERTIFY_STATES];
    bool unbounded, no_tube;
    void *work = lg_alloc(c->context, lg_flow_work_size(c->flow), 1);
    if (work == NULL) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < n; i++) at[i] = 0.5 * from[i] + 0.5 * to[i];
    memset(low, 0, (2 * n + 2 * n * n) * sizeof *low);
    memset(high, 0, (2 * n + 2 * n * n) * sizeof *high);
    for (uint32_t k = 0; k < LG_FLOW_DOUBLINGS; k++) {
        const lg_flow_boxes flow = {.count = 1,
                                    .at = at,
                                    .low = from,
                                    .high = to,
                                    .doublings = k,
                                    .F = {low + n, high + n, n},
                                    .S = {low + 2 * n + n * n, high + 2 * n + n * n, n * n},
                                    .X = {X, X + LG_CERTIFY_STATES, n},
                                    .unbounded = &unbounded,
                                    .no_tube = &no_tube,
                                    .flag = &flag};
        lg_flow_eval(c->flow, &flow, work);
        if (!no_tube) break;
    }
    *slopes = !unbounded;
    lg_free(c->context, work);
    return LG_OK;
}

/* Held loops: what a proof needs of the flow of a period (flow.c). */
#include <float.h>
#include <math.h>
#include <string.h>

#include "certify/certify.h"

/* V grows by at most `base` until the step begins, and by `gain` at any time so far. */
static void add_part(void *user, size_t boxes, const lg_bounds *F, const lg_bounds *S, const lg_bounds *D,
                     const lg_bounds *Q, double from, double to) {
    lg_certify_desk *d = user;
    const size_t n = d->c->n, outputs = lg_interval_outputs(d->c->part);
    const lg_bounds out = {d->out.low, d->out.high, outputs};
    bool none[LG_FLOW_BOXES] = {false};
    for (size_t i = 0; i < boxes; i++) d->t.low[i] = from, d->t.high[i] = to;
    LG_INTERVAL_BOUND(d->c->part, boxes, ((const lg_bounds *[]){F, S, D, Q, &d->t}),
                      ((const lg_bounds *[]){&out}), NULL, none, d->work);
    for (size_t i = 0; i < boxes; i++) {
        const double *l = out.low + i * outputs, *u = out.high + i * outputs;
        const double sup = u[0] + lg_certify_form(n, l + 1, u + 1, d->r + i * n, NULL);
        const double by = none[i] || !(sup < DBL_MAX) ? (double)INFINITY : to * (sup + fabs(sup) * 1e-13);
        if (from < to)
            d->gain[i] = fmax(d->gain[i], d->base[i] + fmax(by, 0));
        else
            d->base[i] += by;
        d->gain[i] += fabs(d->gain[i]) * 1e-13;
        d->base[i] += fabs(d->base[i]) * 1e-13;
    }
}

void lg_certify_held(lg_certify_desk *d, size_t count, uint32_t doublings) {
    const lg_flow_boxes flow = {.count = count,
                                .at = d->at.low,
                                .low = d->y.low,
                                .high = d->y.high,
                                .doublings = doublings,
                                .part = d->c->phase == LG_CERTIFY_BETWEEN ? add_part : NULL,
                                .user = d,
                                .F = d->F,
                                .S = d->S,
                                .X = d->X,
                                .unbounded = d->unbounded,
                                .no_tube = d->no_tube,
                                .flag = d->flag};
    memset(d->base, 0, count * sizeof *d->base);
    lg_flow_eval(d->c->flow, &flow, d->flow);
}

/* The gradient and its Jacobian are not needed of a quadratic V. */
lg_status lg_certify_held_local(const lg_certify *c, const double *from, const double *to, double *low,
                                double *high, bool *slopes) {
    const size_t n = c->n;
    uint8_t flag;
    double at[LG_CERTIFY_STATES], X[2 * LG_CERTIFY_STATES];
    bool unbounded, no_tube;
    LG_TRY_SCRATCH(char, work, c->context, lg_flow_work_size(c->flow), LG_OUT_OF_MEMORY);
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
    return LG_OK;
}

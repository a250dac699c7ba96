/* Boxes: where they are, and the tree of a certificate, which is written or examined depth by depth. */
#include <stdio.h>
#include <string.h>

#include "certify/certificate.h"
#include "certify/certify.h"
#include "core/widen.h"

void lg_certify_states(const lg_certify *c, const double *low, const double *high, double *x_low,
                       double *x_high) {
    for (size_t i = 0; i < c->n; i++) {
        x_low[i] = x_high[i] = c->goal[i];
        for (size_t j = 0; j < c->n; j++) {
            const double t = c->quadratic ? c->T[i * c->n + j] : i == j, a = t * low[j], b = t * high[j];
            x_low[i] += fmin(a, b);
            x_high[i] += fmax(a, b);
        }
    }
}

void lg_certify_fail(lg_certify *c, const double *box, const char *reason) {
    c->failed = true;
    c->phase = LG_CERTIFY_DONE;
    lg_certify_states(c, box, box + c->n, c->failed_low, c->failed_high);
    (void)snprintf(c->reason, sizeof c->reason, "%s", reason);
}

bool lg_certify_is_near(const lg_certify *c, const double *low, const double *high) {
    for (size_t i = 0; i < c->n; i++)
        if (low[i] < -c->near[i] || high[i] > c->near[i]) return false;
    return true;
}

/* ---- the tree of a certificate ---- */

lg_status lg_certify_coordinates(lg_certify *c, lg_error *error) {
    memcpy(c->T, c->file->T, c->n * c->n * sizeof *c->T);
    return lg_certify_check_coordinates(c, error);
}

static lg_status reject(lg_certify *c, const char *reason) {
    double box[2 * LG_CERTIFY_STATES];
    memcpy(box, c->from, c->n * sizeof *box);
    memcpy(box + c->n, c->to, c->n * sizeof *box);
    lg_certify_fail(c, box, reason);
    return LG_OK;
}

/* A new certificate gets the numbers of the proof. Those of a file are examined: |y_i| <= sqrt(c) (1 + 3e-7)
 * on {V <= c}, as T^T P T is 1 to 1e-7. */
lg_status lg_certify_root(lg_certify *c) {
    const lg_certificate *f = c->file;
    const size_t n = c->n;
    const double size = sqrt(c->level) * (1 + 3e-7), near = sqrt(c->eps) * (1 + 3e-7);
    bool whole = true, holds = true;
    c->depth_boxes = 1;
    c->depth_at = 0;
    if (c->made != NULL) {
        lg_certificate *made = c->made;
        made->even = c->stack[0] == 0;
        made->order = c->flow != NULL ? LG_FLOW_ORDER : 0;
        made->steps = c->flow != NULL ? lg_flow_steps(c->flow) : 0;
        made->converges = c->converges;
        memcpy(made->T, c->T, n * n * sizeof *c->T);
        memcpy(made->near, c->near, sizeof c->near);
        memcpy(made->from, c->stack, n * sizeof *c->stack);
        memcpy(made->to, c->stack + n, n * sizeof *c->stack);
        made->tree = lg_alloc(made->context, 3, 1);
        return made->tree != NULL ? LG_OK : LG_OUT_OF_MEMORY;
    }
    for (size_t i = 0; i < n; i++) {
        const bool half = i == 0 && f->even && f->from[0] <= 0;
        whole = whole && f->to[i] >= size && (half || f->from[i] <= -size);
        holds = holds && f->near[i] >= near;
    }
    memcpy(c->stack, f->from, n * sizeof *c->stack);
    memcpy(c->stack + n, f->to, n * sizeof *c->stack);
    if (f->even && !c->even) return reject(c, "the operations do not show that V and its fall are even");
    if (!whole) return reject(c, "the root box does not hold {V <= level}");
    if (!holds) return reject(c, "the box \"near\" does not hold {V < eps}");
    if (f->converges && !c->converges)
        return reject(c, "convergence to the goal could not be shown on the box \"near\"");
    if (c->flow != NULL && f->order != LG_FLOW_ORDER)
        return reject(c, "this version proves with Taylor polynomials of another order");
    c->converges = f->converges;
    return LG_OK;
}

/* What a leaf says holds. A tree is written with a slack that is larger than differences between machines. */
static bool leaf_holds(const lg_certify *c, const double *box, const lg_certify_box *f, char leaf) {
    const double slack = c->made != NULL ? 1e-12 * c->level : 0;
    if (leaf == 'o') return f->v_low > c->level;
    if (f->flag < LG_INTERVAL_LIPSCHITZ) return false;
    if (leaf != 'n') return leaf >= '0' && f->rise_high < -slack && (uint32_t)(leaf - '0') >= f->doublings;
    const bool kept = !c->step || f->v_high + f->rise_high < c->level - slack;
    return lg_certify_is_near(c, box, box + c->n) && (c->converges || (f->v_high < c->eps && kept));
}

static bool is_split(const lg_certify *c, char of) {
    return of >= 'a' && (size_t)(of - 'a') < c->n;
}

bool lg_certify_leaf(lg_certify *c, const double *box, const lg_certify_box *f) {
    const char fits[] = {'o', 'n', (char)('0' + (c->flow != NULL ? f->doublings : 0))};
    const size_t index = (size_t)(box - c->batch) / (2 * c->n);
    char *of = &c->file->tree[c->depth_at + c->depth_boxes - c->stacked - c->batched + index];
    if (c->made != NULL) {
        *of = (char)('a' + f->split);
        for (size_t k = LG_COUNT(fits); k-- > 0;)
            if (leaf_holds(c, box, f, fits[k])) *of = fits[k];
    } else if (!is_split(c, *of) &&
               !((*of == 'o' || *of == 'n' || (*of >= '0' && *of < '0' + LG_FLOW_DOUBLINGS)) &&
                 leaf_holds(c, box, f, *of)))
        lg_certify_fail(c, box, "the tree has a leaf there that is not true");
    return true;
}

/* The stack still has the boxes of this depth, the first at its end. */
lg_status lg_certify_deeper(lg_certify *c) {
    const size_t n = c->n, count = c->depth_boxes;
    const char *of = c->file->tree + c->depth_at;
    size_t splits = 0, at = 0;
    if (c->failed) return LG_OK;
    for (size_t i = 0; i < count; i++) splits += is_split(c, of[i]);
    const size_t next = c->depth_at + count + 1;
    if (c->made != NULL) {
        char *tree = lg_widen(c->made->context, c->made->tree, next - 1, next + 2 * splits + 2, 1);
        if (tree == NULL) return LG_OUT_OF_MEMORY;
        c->made->tree = tree;
        tree[next - 1] = '\n';
        c->made->boxes = c->boxes;
        if (next + 2 * splits > LG_CERTIFICATE_BOXES)
            return reject(c, "its tree would have more boxes than a file holds; a lower level needs fewer");
        of = tree + c->depth_at;
    } else if (of[count] != '\n' || strcspn(of + count + 1, "\n") != 2 * splits)
        return reject(c, "a depth of the tree does not have two boxes for each that is halved above");
    if (splits == 0) return LG_OK;
    double *stack = lg_alloc(c->context, 2 * splits, 2 * n * sizeof *stack);
    if (stack == NULL) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < count; i++) {
        const double *box = c->stack + (count - 1 - i) * 2 * n;
        if (!is_split(c, of[i])) continue;
        const size_t side = (size_t)(of[i] - 'a');
        double *lower = stack + (2 * splits - 1 - at) * 2 * n, *upper = lower - splits * 2 * n;
        memcpy(lower, box, 2 * n * sizeof *box);
        memcpy(upper, box, 2 * n * sizeof *box);
        lower[n + side] = upper[side] = 0.5 * box[side] + 0.5 * box[n + side];
        at++;
    }
    lg_free(c->context, c->stack);
    c->stack = stack;
    c->stacked = c->capacity = c->depth_boxes = 2 * splits;
    c->depth_at = next;
    return LG_OK;
}

void lg_certify_close(lg_certify *c) {
    if (c->made != NULL)
        c->made->between = c->between;
    else if (c->between > c->file->between)
        (void)reject(c, "V could not be shown to stay below \"between\" between the samples");
}

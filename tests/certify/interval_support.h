/* Checks that intervals contain exact values: scalar code run in long double. */
#ifndef LG_INTERVAL_SUPPORT_H
#define LG_INTERVAL_SUPPORT_H

#include "autodiff/row_support.h"

#include <float.h>

#include "autodiff/ops/op_rows.h"
#include "autodiff/ops/op_table.h"
#include "certify/interval.h"
#include "kernels/stumpff.h"

/* ---- exact values ---- */

/* c_k^(d)(w) by its series; NAN (unknown) where its terms cancel. */
static inline long double exact_stumpff(long double w, uint32_t k, uint32_t d) {
    long double sum = 0, term = d % 2 == 0 ? 1 : -1;
    if (fabsl(w) > 16) return NAN;
    for (uint32_t j = 1; j <= k + 2 * d; j++) term /= j;
    for (uint32_t j = 1; j <= d; j++) term *= j;
    for (uint32_t i = 0; i < 60; i++) {
        sum += term;
        term *= -w * (long double)(i + 1 + d) / (long double)(i + 1) / (long double)(k + 2 * (i + d) + 1) /
                (long double)(k + 2 * (i + d) + 2);
    }
    return sum;
}

/* g_2^(n)(w) = sum_m 2 zeta(2 m + 2)/(4 pi^2)^(m + 1) m!/(m - n)! w^(m - n) */
static inline long double exact_dexpinv(long double w, uint32_t n) {
    static long double c[160];
    const long double pi = 3.14159265358979323846264338327950288L;
    long double sum = 0, power = 1;
    if (fabsl(w) > 16) return NAN;
    if (c[0] == 0)
        for (int m = 0; m < 160; m++) {
            long double zeta = 0;
            for (int j = 2000; j >= 1; j--) zeta += powl(j, -2.0L * m - 2);
            if (m == 0) zeta = pi * pi / 6;
            if (m == 1) zeta = pi * pi * pi * pi / 90;
            c[m] = 2 * zeta * powl(4 * pi * pi, -(long double)(m + 1));
        }
    for (uint32_t m = n; m < 160; m++, power *= w) {
        long double factor = c[m];
        for (uint32_t j = 0; j < n; j++) factor *= m - j;
        sum += factor * power;
    }
    return sum;
}

/* NAN: not defined or not known. */
static inline long double exact_value(const lg_scalar_code *c, const long double *x) {
    const long double a = x[0], b = x[1];
    switch (c->op) {
    case LG_S_ADD:
        return a + b;
    case LG_S_SUB:
        return a - b;
    case LG_S_MUL:
        return a * b;
    case LG_S_DIV:
        return a / b;
    case LG_S_NEG:
        return -a;
    case LG_S_MAX:
        return isnan(a) || isnan(b) ? NAN : a >= b ? a : b;
    case LG_S_GE:
        return isnan(a) || isnan(b) ? NAN : a >= b ? 1 : 0;
    case LG_S_SELECT:
        return isnan(a) ? NAN : a != 0 ? b : x[2];
    case LG_S_SQRT:
        return sqrtl(a);
    case LG_S_ABS:
        return fabsl(a);
    case LG_S_SIGN:
        return a >= 0 ? 1 : a < 0 ? -1 : a;
    case LG_S_POW:
        return powl(a, c->p);
    case LG_S_EXP:
        return expl(a);
    case LG_S_LOG:
        return logl(a);
    case LG_S_SIN:
        return sinl(a);
    case LG_S_COS:
        return cosl(a);
    case LG_S_TANH:
        return tanhl(a);
    case LG_S_SIGMOID:
        return 1 / (1 + expl(-a));
    case LG_S_ATAN2:
        return atan2l(a, b);
    case LG_S_STUMPFF:
        return exact_stumpff(a, c->n % 16, c->n / 16);
    case LG_S_DEXPINV:
        return exact_dexpinv(a, c->n);
    case LG_S_INPUT:
    case LG_S_CONSTANT:
    case LG_SCALAR_OPS:
        break;
    }
    return NAN;
}

static inline void exact_walk(const lg_scalars *s, const double *inputs, long double *r) {
    for (uint32_t i = 0; i < s->count; i++) {
        const lg_scalar_code *c = &s->code[i];
        const long double x[3] = {r[c->in[0]], r[c->in[1]], r[c->in[2]]};
        r[i] = c->op == LG_S_INPUT ? inputs[c->n] : c->op == LG_S_CONSTANT ? c->p : exact_value(c, x);
    }
}

/* A value that long double rounds may miss a bound by this much. */
static inline bool is_within(double low, double high, long double value) {
    const long double slack = fabsl(value) * 0x1p-58L + 0x1p-1073L;
    return isnan(value) ? true : low - slack <= value && value <= high + slack;
}

/* ---- boxes ---- */

/* Widths from none to a few. */
static inline void draw_box(lg_rng *rng, double about, double *low, double *high) {
    static const double widths[] = {0, 1e-15, 1e-9, 1e-4, 0.05, 1, 8};
    const double width = widths[lg_rng_below(rng, LG_COUNT(widths))] * (0.1 + fabs(about));
    const double from = lg_rng_uniform_in(rng, -width, 0), to = lg_rng_uniform_in(rng, 0, width);
    *low = about + from;
    *high = about + to;
}

static inline double draw_in(lg_rng *rng, double low, double high) {
    const uint64_t which = lg_rng_below(rng, 8);
    const double x = which == 0 ? low : which == 1 ? high : low + (high - low) * lg_rng_uniform(rng);
    return x < low ? low : x > high ? high : x;
}

/* ---- a node of a tape ---- */

typedef struct interval_node {
    lg_expansion expansion;
    lg_interval *f;
    size_t inputs, outputs;
    double *at; /* the numbers of the inputs on the tape */
} interval_node;

static inline void release_interval_node(void *object) {
    interval_node *n = object;
    lg_expansion_destroy(&n->expansion);
    lg_interval_destroy(n->f);
}

/* The node's scalar code as an evaluator; NULL: the operation has none. */
static inline interval_node *interval_node_of(const lg_tape *tape, const lg_node *node,
                                              lg_interval_run *run) {
    const lg_op *op = node->op;
    const lg_shape *shapes[LG_MAX_INPUTS];
    const lg_scalar *in[LG_MAX_INPUTS];
    const uint32_t unread = op->unread != NULL ? op->unread(&node->attr, node->inputs) : 0;
    if ((op->element == NULL && op->expand == NULL) || node->count > 4096) return NULL;
    interval_node *n = TEST_ARRAY(interval_node, 1);
    lg_test_owns(n, release_interval_node);
    n->expansion = (lg_expansion){.results = node->count};
    size_t most = 1;
    for (uint32_t i = 0; i < node->inputs; i++) most += tape->nodes[tape->parents[node->parents + i]].count;
    n->at = TEST_ARRAY(double, most);
    lg_scalars *s = &n->expansion.s;
    lg_scalars_init(s, NULL);
    s->level_of = lg_interval_level;
    for (uint32_t i = 0; i < node->inputs; i++) {
        const lg_node *from = &tape->nodes[tape->parents[node->parents + i]];
        lg_scalar *x = TEST_ARRAY(lg_scalar, from->count + 1);
        shapes[i] = &from->shape;
        in[i] = x;
        for (size_t j = 0; (i >= 32 || !(unread >> i & 1u)) && j < from->count; j++) {
            n->at[n->inputs] = ((const double *)from->value)[j];
            x[j] = lg_s_input(s, (uint32_t)n->inputs++);
        }
    }
    const lg_evaluation e = {.attr = &node->attr,
                             .inputs = node->inputs,
                             .in = shapes,
                             .shape = &node->shape,
                             .count = node->count};
    n->expansion.result = lg_heap_take(&n->expansion.heap, node->count + 1, sizeof(lg_scalar));
    n->expansion.inputs = n->inputs;
    n->outputs = node->count;
    assert_true(lg_scalars_expand(s, op, &e, in, n->expansion.result));
    n->f = lg_alloc(NULL, 1, sizeof *n->f);
    *n->f = (lg_interval){.run = run, .inputs = n->inputs, .outputs = n->outputs, .functions = 1};
    assert_ok(lg_interval_choose(&n->expansion, false, n->f));
    return n;
}

/* ---- every operation ---- */

typedef struct bounds_check {
    bool seen[LG_OPS_MOST];
    size_t each, points, unknown; /* points of a box, all points, values that are not defined or not known */
    lg_rng rng;
} bounds_check;
static bounds_check checked;
enum { BOXES = 40 };

static inline void check_node(const lg_tape *tape, const lg_node *node, const char *row) {
    for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
        lg_interval_run *run = lg_interval_kernel((lg_isa)isa);
        interval_node *n = run != NULL ? interval_node_of(tape, node, run) : NULL;
        if (n == NULL) continue;
        double *low = TEST_ARRAY(double, BOXES * n->inputs + 1),
               *high = TEST_ARRAY(double, BOXES * n->inputs + 1);
        double *out_low = TEST_ARRAY(double, BOXES * n->outputs),
               *out_high = TEST_ARRAY(double, BOXES * n->outputs);
        double *x = TEST_ARRAY(double, n->inputs + 1);
        long double *r = TEST_ARRAY(long double, n->expansion.s.count + 1);
        for (size_t i = 0; i < BOXES * n->inputs; i++)
            draw_box(&checked.rng, n->at[i % n->inputs], &low[i], &high[i]);
        assert_ok(lg_interval_eval(n->f, BOXES, low, high, out_low, out_high, NULL,
                                   lg_test_memory(lg_interval_work_size(n->f)), NULL));
        for (size_t p = 0; p < BOXES * checked.each; p++) {
            const size_t box = p % BOXES;
            for (size_t i = 0; i < n->inputs; i++)
                x[i] = draw_in(&checked.rng, low[box * n->inputs + i], high[box * n->inputs + i]);
            exact_walk(&n->expansion.s, x, r);
            for (size_t j = 0; j < n->outputs; j++) {
                const double l = out_low[box * n->outputs + j], h = out_high[box * n->outputs + j];
                const long double value = r[n->expansion.result[j]];
                if (!(l <= h)) fail_msg("%s: %s: the bounds [%g, %g]", row, node->op->name, l, h);
                if (!is_within(l, h, value))
                    fail_msg("%s: %s: %.20Lg is outside of [%.17g, %.17g]", row, node->op->name, value, l, h);
                checked.unknown += isnan(value);
            }
            checked.points++;
        }
    }
    checked.seen[lg_op_place(node->op)] = true;
}

/* Bounds of every operation on every tape of the gradient check, with every instruction set. Returns the
 * number of points. */
static inline size_t check_bounds(size_t each, uint64_t seed) {
    checked = (bounds_check){.each = each, .rng = test_rng(seed, 0)};
    each_node(check_node);
    print_message("%zu points, %zu values not defined or not known\n", checked.points, checked.unknown);
    assert_true(checked.unknown < checked.points);
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if ((lg_ops[i]->element != NULL || lg_ops[i]->expand != NULL) && !checked.seen[i])
            fail_msg("%s was on no tape", lg_ops[i]->name);
    return checked.points;
}

#endif

/* Gradients of each row of a batch with respect to a parameter vector theta that all rows share.
 *
 * A node "carries rows" when it depends on a marked leaf (lg_tape_mark_rows). A node that depends on theta
 * and carries no rows is "shared": it is the same for all rows. Where a shared node is an input of a node
 * that carries rows, the ordinary sweep sums the cotangent over rows; here the part of each row is kept. For
 * a view of theta, the parts are written directly into theta's gradients. For any other shared node, they are
 * collected, and at the end carried from node to node down to theta. */
#include "autodiff/tape/rows.h"
#include "autodiff/ops/op_rows.h"

#include <string.h>

enum { SHARED = 1, CARRIES = 2 };

struct lg_rows {
    lg_node_range range;
    size_t count;      /* B, number of rows */
    uint32_t theta;    /* node index of theta */
    size_t parameters; /* number of elements of theta */
    double *gradient;  /* (B, parameters) */
    uint8_t *kind;     /* SHARED, CARRIES or 0, per node of the range */
    /* Cotangent of each row for shared nodes that are no views of theta: (B, elements), NULL until needed. */
    double **part;
};

static bool carries_rows(const lg_tape *tape, const lg_rows *rows, uint32_t node) {
    return (tape->nodes[node].flags & LG_NODE_ROWS) != 0 ||
           (node >= rows->range.lo && rows->kind[node - rows->range.lo] == CARRIES);
}

lg_rows *lg_rows_open(lg_tape *tape, lg_node_range range, lg_var theta, size_t count, double *gradient,
                      uint8_t *reach) {
    const size_t length = (size_t)range.hi - range.lo + 1;
    lg_rows *rows = lg_pool_take(tape, sizeof *rows + length * (sizeof *rows->part + 1));
    if (rows == NULL) return NULL;
    memset(rows, 0, sizeof *rows + length * (sizeof *rows->part + 1));
    *rows = (lg_rows){.range = range,
                      .count = count,
                      .theta = theta.index,
                      .parameters = tape->nodes[theta.index].count,
                      .gradient = gradient,
                      .part = (double **)(rows + 1)};
    rows->kind = (uint8_t *)(rows->part + length);
    for (uint32_t i = range.lo; i <= range.hi; i++) {
        const lg_node *node = &tape->nodes[i];
        const uint32_t *parents = lg_parents_of(tape, node);
        bool carries = carries_rows(tape, rows, i);
        for (uint32_t k = 0; k < node->inputs && !carries; k++)
            carries = carries_rows(tape, rows, parents[k]);
        if (carries) rows->kind[i - range.lo] = CARRIES;
        if (carries || !reach[i - range.lo]) continue;
        rows->kind[i - range.lo] = SHARED;
        reach[i - range.lo] = 0;
    }
    memset(gradient, 0, count * rows->parameters * sizeof *gradient);
    return rows;
}

/* Where the rows' parts of a shared node are stored; consecutive rows are `*stride` numbers apart. NULL:
 * error set. */
static double *parts_of(lg_tape *tape, lg_rows *rows, uint32_t node, size_t *stride) {
    size_t offset = 0;
    uint32_t at = node;
    for (; at != rows->theta && (tape->nodes[at].flags & LG_NODE_VIEW) != 0;
         at = *lg_parents_of(tape, &tape->nodes[at]))
        offset += (size_t)tape->nodes[at].attr.i[3];
    if (at == rows->theta) {
        *stride = rows->parameters;
        return rows->gradient + offset;
    }
    double **part = &rows->part[node - rows->range.lo];
    *stride = tape->nodes[node].count;
    if (*part == NULL) {
        *part = lg_pool_take(tape, rows->count * *stride * sizeof **part);
        if (*part != NULL) memset(*part, 0, rows->count * *stride * sizeof **part);
    }
    return *part;
}

/* ---- one node that carries rows ---- */

static void meet(lg_tape *tape, const char *operation) {
    (void)lg_tape_fail(tape, LG_UNSUPPORTED, operation,
                       "the operation mixes rows, so there is no gradient per row");
}

/* y = a W, a W^T or either plus b, with a shared W or b. Row r contributes the outer product of a_r and g_r
 * to W's gradient and g_r to b's. */
static void add_product(lg_tape *tape, lg_rows *rows, const lg_node *node, uint32_t k, const double *g) {
    const uint32_t *parents = lg_parents_of(tape, node);
    const uint32_t variant = node->attr.i[0];
    const lg_node *a = &tape->nodes[parents[0]];
    const size_t n = node->shape.dims[1], m = a->shape.dims[1], count = tape->nodes[parents[k]].count;
    size_t stride;
    double *out = parts_of(tape, rows, parents[k], &stride);
    if (out == NULL) return;
    if (k == 0 || variant == LG_TN || node->shape.dims[0] != rows->count || (k == 2 && count != n)) {
        meet(tape, node->op->name);
        return;
    }
    for (size_t r = 0; r < rows->count; r++, out += stride) {
        const double *x = (const double *)a->value + r * m, *c = g + r * n;
        if (k == 2)
            tape->k->axpy(n, 1.0, c, out);
        else if (variant == LG_NN)
            tape->k->outer(m, n, x, c, out);
        else
            tape->k->outer(n, m, c, x, out);
    }
}

/* Any other operation: the shared input is broadcast to all rows first, so the vjp returns one cotangent per
 * row instead of their sum. */
static void add_other(lg_tape *tape, lg_rows *rows, uint32_t i, uint32_t k, lg_var g) {
    const uint32_t inputs = tape->nodes[i].inputs, shared = lg_parents_of(tape, &tape->nodes[i])[k];
    lg_var in[LG_MAX_INPUTS], out[LG_MAX_INPUTS];
    bool need[LG_MAX_INPUTS] = {false};
    lg_attr attr = tape->nodes[i].attr;
    lg_shape shape = tape->nodes[shared].shape;
    if (shape.rank < tape->nodes[i].shape.rank) {
        lg_shape longer = {tape->nodes[i].shape.rank, {1, 1, 1, 1}};
        for (uint32_t d = 0; d < shape.rank; d++) longer.dims[longer.rank - shape.rank + d] = shape.dims[d];
        shape = longer;
    }
    if (shape.rank == 0 || shape.dims[0] != 1 || tape->nodes[i].shape.dims[0] != rows->count) {
        meet(tape, tape->nodes[i].op->name);
        return;
    }
    shape.dims[0] = (uint32_t)rows->count;
    for (uint32_t j = 0; j < inputs; j++) in[j] = lg_var_at(tape, lg_parents_of(tape, &tape->nodes[i])[j]);
    in[k] = lg_broadcast_to(tape, in[k], shape);
    need[k] = true;
    out[k] = LG_NONE;
    const lg_op *op = lg_row_in_use(&tape->exchange, tape->nodes[i].op);
    lg_reverse r = {op, tape, i, lg_var_at(tape, i), g, &attr, in, inputs, need, out, NULL, true};
    if (tape->status == LG_OK) op->vjp(&r);
    if (tape->status != LG_OK || lg_is_none(out[k])) return;
    size_t stride;
    double *to = parts_of(tape, rows, shared, &stride);
    const size_t count = tape->nodes[shared].count;
    const double *value = lg_node_at(tape, out[k])->value;
    for (size_t row = 0; to != NULL && row < rows->count; row++)
        tape->k->axpy(count, 1.0, value + row * count, to + row * stride);
}

void lg_tape_mark_rows(lg_tape *tape, lg_var leaf) {
    if (tape->status == LG_OK) tape->nodes[leaf.index].flags |= LG_NODE_ROWS;
}

void lg_rows_add(lg_tape *tape, lg_rows *rows, uint32_t i, lg_var g) {
    for (uint32_t k = 0; k < tape->nodes[i].inputs && tape->status == LG_OK; k++) {
        const lg_node *node = &tape->nodes[i];
        const uint32_t parent = lg_parents_of(tape, node)[k], first = rows->range.lo;
        if (parent < first || rows->kind[parent - first] != SHARED || lg_frozen(node, k)) continue;
        if (node->op == &lg_op_matmul && node->shape.rank == 2)
            add_product(tape, rows, node, k, lg_node_at(tape, g)->value);
        else
            add_other(tape, rows, i, k, g);
    }
}

/* ---- gradients of theta from the collected parts ---- */

/* Applies the chain rule at a shared node: adds part times the derivative of the node with respect to each
 * shared input to the part of that input, element after element of the node. */
static void pull_back(lg_tape *tape, lg_rows *rows, uint32_t node, const double *part) {
    const lg_mark mark = lg_tape_mark(tape);
    const size_t elements = tape->nodes[node].count;
    const uint32_t inputs = tape->nodes[node].inputs;
    lg_var in[LG_MAX_INPUTS], out[LG_MAX_INPUTS];
    bool need[LG_MAX_INPUTS];
    for (size_t e = 0; e < elements && tape->status == LG_OK; e++) {
        const lg_var one = lg_unit_like(tape, lg_var_at(tape, node), e);
        if (lg_is_none(one)) return;
        lg_reverse_step(tape, rows->range, rows->kind, NULL, node, one, in, need, out);
        for (uint32_t k = 0; k < inputs && tape->status == LG_OK; k++) {
            if (!need[k] || lg_is_none(out[k])) continue;
            size_t stride;
            double *to = parts_of(tape, rows, in[k].index, &stride);
            const size_t count = lg_node_at(tape, in[k])->count;
            const double *slope = lg_value(tape, out[k]);
            for (size_t r = 0; to != NULL && r < rows->count; r++)
                tape->k->axpy(count, part[r * elements + e], slope, to + r * stride);
        }
        if (tape->status == LG_OK) (void)lg_tape_rewind(tape, mark);
    }
}

/* Goes from the newest shared node to the oldest one, so that the part of a node is complete before the node
 * passes it to its inputs. */
void lg_rows_close(lg_tape *tape, lg_rows *rows) {
    const size_t length = (size_t)rows->range.hi - rows->range.lo + 1;
    for (size_t at = length; at-- > 0;) {
        if (rows->part[at] == NULL) continue;
        const uint32_t node = rows->range.lo + (uint32_t)at;
        if (tape->status == LG_OK) pull_back(tape, rows, node, rows->part[at]);
        lg_pool_give(tape, rows->part[at], rows->count * tape->nodes[node].count * sizeof(double));
    }
    lg_pool_give(tape, rows, sizeof *rows + length * (sizeof *rows->part + 1));
}

/* Sums of padded tensors. The adjoint of a slice is the slice's adjoint between zeros, so the gradient by a
 * vector of parameters is a sum of such tensors, one for each slice. Here the sum becomes a concatenation of
 * the slices' adjoints. Adjoints of the same slice are added first, in the order of the sum. */
#include "autodiff/program/plan_graph.h"

/* A tensor along one axis: nodes, and zeros between nodes. */
typedef struct piece {
    uint32_t node; /* LG_GRAPH_NONE: zeros */
    uint32_t length;
} piece;

typedef struct pieces {
    uint32_t axis, count;
    piece piece[LG_MAX_INPUTS];
} pieces;

static bool append(pieces *to, uint32_t node, uint32_t length) {
    piece *last = to->count > 0 ? &to->piece[to->count - 1] : NULL;
    if (length == 0) return true;
    if (node == LG_GRAPH_NONE && last != NULL && last->node == LG_GRAPH_NONE) {
        last->length += length;
        return true;
    }
    if (to->count == LG_MAX_INPUTS) return false;
    to->piece[to->count++] = (piece){node, length};
    return true;
}

static bool is_zeros(const lg_graph *g, uint32_t i) {
    const lg_graph_node *n = &g->node[i];
    const bool repeats = n->sort == LG_GRAPH_OPERATION && n->op == &lg_op_repeat;
    return lg_graph_filled(g, repeats ? n->in[0] : i, 0.0);
}

static bool append_parts(const lg_graph *g, const lg_graph_node *concat, pieces *to) {
    bool good = true;
    for (uint32_t k = 0; good && k < concat->inputs; k++) {
        const uint32_t in = concat->in[k];
        good = append(to, is_zeros(g, in) ? LG_GRAPH_NONE : in, g->node[in].shape.dims[to->axis]);
    }
    return good;
}

static bool is_operation(const lg_graph_node *n, const lg_op *op, uint32_t axis) {
    return n->sort == LG_GRAPH_OPERATION && n->op == op && n->attr.i[0] == axis;
}

/* Takes a padded or concatenated tensor apart. Returns false for any other node, and for too many pieces. */
static bool take_apart(const lg_graph *g, uint32_t i, pieces *out) {
    const lg_graph_node *n = &g->node[i];
    if (n->sort != LG_GRAPH_OPERATION || (n->op != &lg_op_pad && n->op != &lg_op_concat)) return false;
    uint32_t before = 0, after = 0;
    out->axis = n->attr.i[0];
    out->count = 0;
    for (; is_operation(n, &lg_op_pad, out->axis); n = &g->node[i]) {
        before += n->attr.i[1];
        after += n->attr.i[2];
        i = n->in[0];
    }
    return append(out, LG_GRAPH_NONE, before) &&
           (is_operation(n, &lg_op_concat, out->axis) ? append_parts(g, n, out)
                                                      : append(out, i, n->shape.dims[out->axis])) &&
           append(out, LG_GRAPH_NONE, after);
}

static uint32_t add(lg_graph *g, uint32_t a, uint32_t b) {
    uint32_t in[2] = {a, b};
    const lg_shape shape = g->node[a].shape;
    const lg_shape *const shapes[2] = {&shape, &shape};
    return lg_graph_operation(
        g,
        &(lg_graph_node){
            .op = &lg_op_add, .inputs = 2, .in = in, .shape = shape, .count = lg_shape_count(shape)},
        shapes);
}

/* Adds two tensors piece by piece. Returns false if a node of one of them meets a part of a node of the
 * other. */
static bool sum_of(lg_graph *g, pieces a, pieces b, pieces *out) {
    out->axis = a.axis;
    out->count = 0;
    for (uint32_t i = 0, j = 0; i < a.count && j < b.count;) {
        piece *x = &a.piece[i], *y = &b.piece[j];
        const uint32_t length = x->length < y->length ? x->length : y->length;
        if ((x->node != LG_GRAPH_NONE && x->length > length) ||
            (y->node != LG_GRAPH_NONE && y->length > length))
            return false;
        const uint32_t node = x->node == LG_GRAPH_NONE   ? y->node
                              : y->node == LG_GRAPH_NONE ? x->node
                                                         : add(g, x->node, y->node);
        if (!append(out, node, length)) return false;
        x->length -= length;
        y->length -= length;
        i += x->length == 0;
        j += y->length == 0;
    }
    return true;
}

/* Zeros, as one zero that is repeated: a constant would take the memory of all. */
static uint32_t zeros(lg_graph *g, lg_shape shape) {
    const double *zero = lg_graph_take(g, 1, sizeof *zero);
    if (zero == NULL) return 0;
    uint32_t in = lg_graph_add_constant(g, lg_shape1(1), zero, false);
    const size_t count = lg_shape_count(shape);
    return lg_graph_add(g, &(lg_graph_node){.op = &lg_op_repeat,
                                            .attr = {.i = {1, (uint32_t)count, 1, 0}},
                                            .inputs = 1,
                                            .in = &in,
                                            .shape = shape,
                                            .count = count});
}

static uint32_t concatenation(lg_graph *g, const pieces *p, lg_shape shape) {
    uint32_t in[LG_MAX_INPUTS];
    lg_shape parts[LG_MAX_INPUTS];
    const lg_shape *shapes[LG_MAX_INPUTS];
    for (uint32_t k = 0; k < p->count; k++) {
        parts[k] = shape;
        parts[k].dims[p->axis] = p->piece[k].length;
        shapes[k] = &parts[k];
        in[k] = p->piece[k].node == LG_GRAPH_NONE ? zeros(g, parts[k]) : p->piece[k].node;
    }
    const lg_graph_node made = {.op = &lg_op_concat,
                                .attr = {.i = {p->axis, 0, 0, 0}},
                                .inputs = p->count,
                                .in = in,
                                .shape = shape,
                                .count = lg_shape_count(shape)};
    return g->failed ? 0 : lg_graph_operation(g, &made, shapes);
}

static bool has_zeros(const pieces *p) {
    for (uint32_t k = 0; k < p->count; k++)
        if (p->piece[k].node == LG_GRAPH_NONE) return true;
    return false;
}

/* A sum of two concatenations without zeros stays one sum. */
uint32_t lg_graph_joined(lg_graph *g, const lg_graph_node *n, const lg_shape *const *shapes) {
    pieces a, b, both;
    if (n->op != &lg_op_add || !lg_same_shape(shapes[0], shapes[1]) || n->count == 0 ||
        n->count > UINT32_MAX || !take_apart(g, n->in[0], &a) || !take_apart(g, n->in[1], &b) ||
        a.axis != b.axis || (!has_zeros(&a) && !has_zeros(&b)) || !sum_of(g, a, b, &both))
        return LG_GRAPH_NONE;
    return g->failed ? 0 : concatenation(g, &both, n->shape);
}

/* Simplifies an operation of a graph: it may become a constant (if all inputs are constants), one of its
 * inputs, zeros, or the same operation on fewer rows. Otherwise it stays as it is. */
#include <string.h>

#include "autodiff/program/plan_graph.h"
#include "autodiff/program/program_call.h"

/* ---- folding of constants ---- */

/* Limits on the size of folded constants: a result may have SMALL elements in any case, or GROWTH times as
 * many elements as the inputs together. */
enum { SMALL = 1024, GROWTH = 2 };

static bool folds(const lg_graph *g, const lg_graph_node *n) {
    size_t in = 0;
    if (lg_is_call(n->op)) return false; /* a graph has no plan of the called function */
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE) continue;
        if (g->node[n->in[k]].sort != LG_GRAPH_CONSTANT) return false;
        in += g->node[n->in[k]].count;
    }
    return n->count <= SMALL || n->count <= GROWTH * in;
}

static bool takes_weights(const lg_graph *g, const lg_graph_node *n) {
    for (uint32_t k = 0; k < n->inputs; k++)
        if (n->in[k] != LG_GRAPH_NONE && g->node[n->in[k]].weights) return true;
    return false;
}

static uint32_t fold(lg_graph *g, const lg_graph_node *n, const lg_shape *const *shapes) {
    const void *values[LG_MAX_INPUTS];
    const lg_op *op = n->op;
    const bool weights = takes_weights(g, n);
    size_t offset;
    for (uint32_t k = 0; k < n->inputs; k++)
        values[k] = n->in[k] == LG_GRAPH_NONE ? NULL : g->node[n->in[k]].value;
    if (op->view != NULL && op->view(shapes, &n->attr, &offset))
        return lg_graph_add_constant(g, n->shape, (const double *)values[0] + offset, weights);
    lg_evaluation e = {.k = lg_kernels_for(LG_F64),
                       .attr = &n->attr,
                       .inputs = n->inputs,
                       .in = shapes,
                       .x = values,
                       .shape = &n->shape,
                       .count = n->count,
                       .y = lg_graph_take(g, n->count, sizeof(double))};
    if (op->scratch != NULL) e.scratch = lg_graph_take(g, op->scratch(&e), 1);
    if (g->failed) return 0;
    g->work += lg_graph_work(g, n);
    if (g->work > g->most_work) return 0;
    (void)op->forward(&e);
    return lg_graph_add_constant(g, n->shape, e.y, weights);
}

/* ---- simplification ---- */

bool lg_graph_filled(const lg_graph *g, uint32_t i, double with) {
    if (i == LG_GRAPH_NONE) return false;
    const lg_graph_node *n = &g->node[i];
    if (n->sort != LG_GRAPH_CONSTANT || n->weights) return false;
    for (size_t k = 0; k < n->count; k++)
        if (n->value[k] != with) return false;
    return true;
}

static uint32_t zeros(lg_graph *g, lg_shape shape) {
    const double *value = lg_graph_take(g, lg_shape_count(shape), sizeof *value);
    return g->failed ? 0 : lg_graph_add_constant(g, shape, value, false);
}

static uint32_t reshaped(lg_graph *g, uint32_t i, lg_shape shape) {
    while (g->node[i].sort == LG_GRAPH_OPERATION && g->node[i].op == &lg_op_reshape) i = g->node[i].in[0];
    const lg_graph_node *from = &g->node[i];
    if (lg_same_shape(&from->shape, &shape)) return i;
    if (from->sort == LG_GRAPH_CONSTANT) return lg_graph_add_constant(g, shape, from->value, from->weights);
    if (from->sort == LG_GRAPH_OPERATION && from->op == &lg_op_repeat) {
        lg_graph_node other = *from; /* a broadcast may have any shape with the right number of elements */
        other.shape = shape;
        return lg_graph_add(g, &other);
    }
    return lg_graph_add(
        g, &(lg_graph_node){
               .op = &lg_op_reshape, .inputs = 1, .in = &i, .shape = shape, .count = lg_shape_count(shape)});
}

/* The state behind lg_known.filled, which `instead` of a row may call. */
typedef struct asking {
    const lg_graph *g;
    const lg_graph_node *n;
} asking;

static bool asked_filled(void *user, uint32_t input, double with) {
    const asking *a = user;
    return lg_graph_filled(a->g, a->n->in[input], with);
}

/* The simpler node that replaces this one, or LG_GRAPH_NONE. */
static uint32_t simpler(lg_graph *g, const lg_graph_node *n, const lg_shape *const *shapes) {
    const lg_op *op = n->op;
    asking asks = {g, n};
    const lg_known known = {&n->attr, n->inputs, shapes, &n->shape, asked_filled, &asks};
    const lg_instead found = op->instead != NULL ? op->instead(&known) : lg_instead_nothing();
    switch (found.kind) {
    case LG_INSTEAD_INPUT:
        return reshaped(g, n->in[found.input], n->shape);
    case LG_INSTEAD_ZEROS:
        return zeros(g, n->shape);
    case LG_INSTEAD_NOTHING:
        break;
    }
    return LG_GRAPH_NONE;
}

/* ---- batches with repeated rows: the operation is done on single rows, then its result is repeated ---- */

/* The number of times each row is repeated: row r of the node is row r / copies of a smaller tensor. 1: no
 * repetition is known, or there are no rows. */
static uint32_t copies_of(const lg_graph *g, uint32_t i) {
    const lg_graph_node *n = &g->node[i];
    if (n->sort != LG_GRAPH_OPERATION || n->op != &lg_op_repeat || n->shape.rank == 0) return 1;
    const uint32_t rows = n->shape.dims[0], copies = n->attr.i[1];
    return rows > 0 && rows == n->attr.i[0] * copies ? copies : 1;
}

static lg_shape fewer_rows(lg_shape shape, uint32_t copies) {
    shape.dims[0] /= copies;
    return shape;
}

/* The tensor with each row once; LG_GRAPH_NONE when the copies of a row differ. */
static uint32_t single_rows(lg_graph *g, uint32_t i, uint32_t copies) {
    const lg_graph_node n = g->node[i];
    const lg_shape shape = fewer_rows(n.shape, copies);
    if (copies_of(g, i) == copies) return reshaped(g, n.in[0], shape);
    if (n.sort != LG_GRAPH_CONSTANT || n.shape.dims[0] % copies != 0) return LG_GRAPH_NONE;
    const size_t length = n.shape.dims[0] == 0 ? 0 : n.count / n.shape.dims[0];
    for (size_t r = 0; r < n.shape.dims[0]; r++)
        if (memcmp(n.value + r * length, n.value + r / copies * copies * length, length * sizeof *n.value) !=
            0)
            return LG_GRAPH_NONE;
    double *value = lg_graph_take(g, lg_shape_count(shape), sizeof *value);
    for (size_t r = 0; value != NULL && r < shape.dims[0]; r++)
        memcpy(value + r * length, n.value + r * copies * length, length * sizeof *value);
    return g->failed ? LG_GRAPH_NONE : lg_graph_add_constant(g, shape, value, n.weights);
}

/* Whether the input has no row axis (for example one matrix next to a batch of matrices: its first axis is
 * not the row axis, whatever its length) or has a single row for all rows. */
static bool serves_all(const lg_shape *shape, const lg_shape *in) {
    return in->rank < shape->rank || in->dims[0] == 1;
}

static lg_row_use row_use(const lg_graph_node *n, const lg_shape *const *shapes, uint32_t copies,
                          lg_attr *attr) {
    const lg_op *op = n->op;
    return op->rows != NULL      ? op->rows(shapes, n->inputs, &n->shape, copies, attr)
           : op->element != NULL ? LG_ROWS_BROADCAST
                                 : LG_ROWS_MEET;
}

static uint32_t on_single_rows(lg_graph *g, const lg_graph_node *n, const lg_shape *const *shapes) {
    uint32_t copies = 1, in[LG_MAX_INPUTS];
    const uint32_t rows = n->shape.rank > 0 ? n->shape.dims[0] : 0;
    for (uint32_t k = 0; k < n->inputs && copies == 1; k++)
        if (n->in[k] != LG_GRAPH_NONE) copies = copies_of(g, n->in[k]);
    if (copies == 1 || rows == 0 || rows % copies != 0) return LG_GRAPH_NONE;
    lg_graph_node once = *n;
    once.in = in;
    const lg_row_use use = row_use(n, shapes, copies, &once.attr);
    if (use == LG_ROWS_MEET) return LG_GRAPH_NONE;
    for (uint32_t k = 0; k < n->inputs; k++) {
        in[k] = n->in[k];
        if (in[k] == LG_GRAPH_NONE || (use == LG_ROWS_FIRST && k > 0)) continue;
        const lg_shape shape = g->node[in[k]].shape;
        if (use == LG_ROWS_BROADCAST && serves_all(&n->shape, &shape)) continue;
        if (shape.rank == 0 || shape.dims[0] != rows) return LG_GRAPH_NONE;
        in[k] = single_rows(g, in[k], copies);
        if (in[k] == LG_GRAPH_NONE) return LG_GRAPH_NONE;
    }
    once.shape = fewer_rows(n->shape, copies);
    once.count = lg_shape_count(once.shape);
    uint32_t made = lg_graph_add(g, &once);
    const uint32_t length = (uint32_t)(once.count / once.shape.dims[0]);
    return g->failed
               ? 0
               : lg_graph_add(g, &(lg_graph_node){.op = &lg_op_repeat,
                                                  .attr = {.i = {once.shape.dims[0], copies, length, 0}},
                                                  .inputs = 1,
                                                  .in = &made,
                                                  .shape = n->shape,
                                                  .count = n->count});
}

/* The number of times each row is repeated in all inputs except the last; 1 when the inputs differ in
 * this. */
static uint32_t rows_of_copies(const lg_graph *g, const lg_graph_node *n) {
    uint32_t copies = 0;
    for (uint32_t k = 0; k + 1 < n->inputs; k++) {
        const uint32_t own = n->in[k] == LG_GRAPH_NONE ? copies : copies_of(g, n->in[k]);
        if (copies != 0 && own != copies) return 1;
        copies = own;
    }
    return copies == 0 ? 1 : copies;
}

/* Operations that broadcast rows: an input that repeats one row for all rows is replaced by this single
 * row. */
static uint32_t with_broadcasts(lg_graph *g, const lg_graph_node *n, const lg_shape *const *shapes) {
    const lg_op *op = n->op;
    const lg_shape *fewer[LG_MAX_INPUTS];
    uint32_t in[LG_MAX_INPUTS], changed = 0;
    lg_graph_node made = *n;
    lg_shape shape = n->shape;
    lg_attr attr = n->attr;
    if (n->shape.rank == 0 || n->inputs < 2 ||
        (op->element == NULL && row_use(n, shapes, 1, &attr) != LG_ROWS_BROADCAST))
        return LG_GRAPH_NONE;
    for (uint32_t k = 0; k < n->inputs; k++) {
        in[k] = n->in[k];
        fewer[k] = shapes[k];
        if (in[k] == LG_GRAPH_NONE || copies_of(g, in[k]) != n->shape.dims[0] || n->shape.dims[0] == 1)
            continue;
        in[k] = single_rows(g, in[k], n->shape.dims[0]);
        if (in[k] == LG_GRAPH_NONE) return LG_GRAPH_NONE;
        changed++;
    }
    made.in = in;
    if (changed == 0 || changed == n->inputs) return LG_GRAPH_NONE;
    lg_graph_shapes(g, &made, fewer);
    if (op->shape(fewer, n->inputs, &n->attr, &shape) != LG_OK || !lg_same_shape(&shape, &n->shape))
        return LG_GRAPH_NONE;
    return lg_graph_add(g, &made);
}

/* If only the factor (lg_op.factor) has different rows, everything else is computed for single rows and then
 * multiplied by the factor. */
static uint32_t factor_apart(lg_graph *g, const lg_graph_node *n, const lg_shape *const *shapes) {
    const lg_op *op = n->op;
    const uint32_t last = n->inputs - 1, copies = n->inputs > 1 ? rows_of_copies(g, n) : 1;
    lg_graph_node rest = *n;
    if (copies == 1 || op->factor == NULL || !op->factor(&n->attr, n->inputs, &rest.attr))
        return LG_GRAPH_NONE;
    rest.inputs = last;
    uint32_t in[2] = {n->in[last], lg_graph_operation(g, &rest, shapes)};
    const lg_graph_node product = {
        .op = &lg_op_mul, .inputs = 2, .in = in, .shape = n->shape, .count = n->count};
    const lg_shape *both[2];
    lg_graph_shapes(g, &product, both);
    return g->failed ? 0 : lg_graph_operation(g, &product, both);
}

/* Replaces the product A B^T by A C. C = B^T is a new operation, and all products with B^T use the same C. If
 * B is a constant, plan_steps.c stores B^T instead. */
static uint32_t with_transpose(lg_graph *g, const lg_graph_node *n, const lg_shape *const *shapes) {
    const lg_evaluation e = {
        .attr = &n->attr, .inputs = n->inputs, .in = shapes, .shape = &n->shape, .count = n->count};
    if (n->op != &lg_op_matmul || n->attr.i[0] != LG_NT || shapes[1]->rank != 2 || shapes[0]->rank != 2 ||
        g->node[n->in[1]].sort == LG_GRAPH_CONSTANT || n->op->transpose(&e) != LG_TRANSPOSE_MAKE)
        return LG_GRAPH_NONE;
    uint32_t in[3] = {n->in[0], n->in[1], n->inputs > 2 ? n->in[2] : LG_GRAPH_NONE};
    const lg_graph_node turned = {.op = &lg_op_permute,
                                  .attr = {.i = {1, 0, 2, 3}},
                                  .inputs = 1,
                                  .in = &in[1],
                                  .shape = lg_shape2(shapes[1]->dims[1], shapes[1]->dims[0]),
                                  .count = lg_shape_count(*shapes[1])};
    in[1] = lg_graph_operation(g, &turned, &shapes[1]);
    lg_graph_node product = *n;
    product.attr.i[0] = LG_NN;
    product.in = in;
    return g->failed ? 0 : lg_graph_add(g, &product);
}

uint32_t lg_graph_operation(lg_graph *g, const lg_graph_node *n, const lg_shape *const *shapes) {
    if (folds(g, n)) return fold(g, n, shapes);
    static uint32_t (*const ways[])(lg_graph *, const lg_graph_node *, const lg_shape *const *) = {
        simpler, on_single_rows, factor_apart, with_broadcasts, with_transpose};
    for (size_t i = 0; i < LG_COUNT(ways); i++) {
        const uint32_t other = ways[i](g, n, shapes);
        if (other != LG_GRAPH_NONE) return other;
    }
    return lg_graph_add(g, n);
}

#include "autodiff/plan_graph.h"
#include "autodiff/op_rows.h"
#include "autodiff/program_call.h"

#include <math.h>
#include <string.h>

typedef struct making {
    lg_graph g;
    const lg_program *program;
    const lg_function *f;  /* what is looked at: the function, or one that it calls */
    const uint32_t *input; /* nodes that are its inputs; NULL: inputs of the graph */
    size_t rows;
    lg_dtype dtype;
    bool calls;      /* stay; else they are written out */
    uint8_t *needed; /* by node of f */
    uint32_t *of;    /* node of f -> node of the graph */
    const double **parameter;
    double work, most_work; /* of folding */
    bool symbolic;          /* parameters are inputs */
    bool failed;            /* out of memory */
} making;

static void *take(making *m, size_t count, size_t size) {
    void *memory = lg_heap_take(m->g.heap, count, size);
    if (memory == NULL) m->failed = true;
    return memory;
}

/* ---- nodes, equal ones once ---- */

static uint64_t mix(uint64_t h, uint64_t x) {
    h = (h ^ x) * 0xff51afd7ed558ccdu;
    return h ^ h >> 32;
}

static uint64_t hash(const lg_graph_node *n) {
    uint64_t bits, h = mix((uint64_t)(uintptr_t)n->op + n->sort, n->number);
    memcpy(&bits, &n->attr.c, sizeof bits);
    h = mix(h, bits);
    for (int k = 0; k < 4; k++) h = mix(h, n->attr.i[k]);
    for (uint32_t k = 0; k < n->inputs; k++) h = mix(h, n->in[k]);
    for (uint32_t d = 0; d < n->shape.rank; d++) h = mix(h, n->shape.dims[d]);
    for (size_t i = 0; n->sort == LG_GRAPH_CONSTANT && i < n->count && i < 8; i++) {
        memcpy(&bits, &n->value[i], sizeof bits);
        h = mix(h, bits);
    }
    return h;
}

static size_t payload_bytes(const lg_graph_node *n) {
    const lg_payload kind = n->op->payload;
    return kind == LG_PAYLOAD_REALS     ? n->inputs * sizeof(double)
           : kind == LG_PAYLOAD_INDICES ? n->attr.i[0] * sizeof(uint32_t)
                                        : 0;
}

static bool equal(const lg_graph_node *a, const lg_graph_node *b) {
    if (a->sort != b->sort || a->op != b->op || a->number != b->number || a->inputs != b->inputs ||
        a->weights != b->weights || !lg_same_shape(&a->shape, &b->shape) ||
        memcmp(&a->attr.c, &b->attr.c, sizeof a->attr.c) != 0 ||
        memcmp(a->attr.i, b->attr.i, sizeof a->attr.i) != 0)
        return false;
    for (uint32_t k = 0; k < a->inputs; k++)
        if (a->in[k] != b->in[k]) return false;
    const size_t payload = a->sort == LG_GRAPH_OPERATION ? payload_bytes(a) : 0;
    if (payload > 0 && memcmp(a->attr.pointer, b->attr.pointer, payload) != 0) return false;
    return a->sort != LG_GRAPH_CONSTANT || a->value == b->value ||
           memcmp(a->value, b->value, a->count * sizeof *a->value) == 0;
}

static bool grow(making *m) {
    lg_graph *g = &m->g;
    const uint32_t capacity = g->capacity == 0 ? 128 : 2 * g->capacity;
    lg_graph_node *node = take(m, capacity, sizeof *node);
    uint32_t *table = take(m, 2 * (size_t)capacity, sizeof *table);
    if (m->failed) return false;
    if (g->count > 0) memcpy(node, g->node, g->count * sizeof *node);
    g->node = node;
    g->table = table;
    g->capacity = capacity;
    g->slots = 2 * capacity;
    for (uint32_t i = 0; i < g->count; i++) {
        uint32_t at = (uint32_t)hash(&node[i]) & (g->slots - 1);
        while (table[at] != 0) at = (at + 1) & (g->slots - 1);
        table[at] = i + 1;
    }
    return true;
}

/* The node, which may have been there before; n->in lives on the stack of the caller. 0 after a failure. */
static uint32_t add(making *m, const lg_graph_node *n) {
    lg_graph *g = &m->g;
    if (m->failed || (g->count == g->capacity && !grow(m))) return 0;
    uint32_t at = (uint32_t)hash(n) & (g->slots - 1);
    for (; g->table[at] != 0; at = (at + 1) & (g->slots - 1))
        if (equal(&g->node[g->table[at] - 1], n)) return g->table[at] - 1;
    uint32_t *in = take(m, n->inputs, sizeof *in);
    if (in == NULL) return 0;
    if (n->inputs > 0) memcpy(in, n->in, n->inputs * sizeof *in);
    g->node[g->count] = *n;
    g->node[g->count].in = in;
    g->table[at] = ++g->count;
    return g->count - 1;
}

static uint32_t add_constant(making *m, lg_shape shape, const double *value, bool weights) {
    return add(m, &(lg_graph_node){.sort = LG_GRAPH_CONSTANT,
                                   .op = &lg_op_leaf,
                                   .shape = shape,
                                   .count = lg_shape_count(shape),
                                   .value = value,
                                   .weights = weights});
}

/* ---- folding ---- */

static const lg_shape no_shape;

void lg_graph_shapes(const lg_graph *g, const lg_graph_node *n, const lg_shape **shapes) {
    for (uint32_t k = 0; k < n->inputs; k++)
        shapes[k] = n->in[k] == LG_GRAPH_NONE ? &no_shape : &g->node[n->in[k]].shape;
}

/* Constants are not blown up: elements that a result may have in any case, and more than its inputs have. */
enum { SMALL = 1024, GROWTH = 2 };

static bool folds(const making *m, const lg_graph_node *n) {
    size_t in = 0;
    if (n->op == &lg_op_call) return false; /* a graph has no plan of what is called */
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE) continue;
        if (m->g.node[n->in[k]].sort != LG_GRAPH_CONSTANT) return false;
        in += m->g.node[n->in[k]].count;
    }
    return n->count <= SMALL || n->count <= GROWTH * in;
}

static bool takes_weights(const making *m, const lg_graph_node *n) {
    for (uint32_t k = 0; k < n->inputs; k++)
        if (n->in[k] != LG_GRAPH_NONE && m->g.node[n->in[k]].weights) return true;
    return false;
}

double lg_graph_work(const lg_graph *g, const lg_graph_node *n) {
    const lg_shape *shapes[LG_MAX_INPUTS];
    if (n->op->terms == NULL) return (double)n->count;
    lg_graph_shapes(g, n, shapes);
    return (double)n->count * (double)n->op->terms(shapes, &n->attr, &n->shape);
}

static uint32_t fold(making *m, const lg_graph_node *n, const lg_shape *const *shapes) {
    const void *values[LG_MAX_INPUTS];
    const lg_op *op = n->op;
    const bool weights = takes_weights(m, n);
    size_t offset;
    for (uint32_t k = 0; k < n->inputs; k++)
        values[k] = n->in[k] == LG_GRAPH_NONE ? NULL : m->g.node[n->in[k]].value;
    if (op->view != NULL && op->view(shapes, &n->attr, &offset))
        return add_constant(m, n->shape, (const double *)values[0] + offset, weights);
    lg_evaluation e = {.k = lg_kernels_for(LG_F64),
                       .attr = &n->attr,
                       .inputs = n->inputs,
                       .in = shapes,
                       .x = values,
                       .shape = &n->shape,
                       .count = n->count,
                       .y = take(m, n->count, sizeof(double))};
    if (op->scratch != NULL) e.scratch = take(m, op->scratch(&e), 1);
    if (m->failed) return 0;
    m->work += lg_graph_work(&m->g, n);
    if (m->work > m->most_work) return 0;
    (void)op->forward(&e);
    return add_constant(m, n->shape, e.y, weights);
}

/* ---- simplification ---- */

/* Weights are not: what a plan looks like does not depend on them. */
static bool is_filled(const making *m, uint32_t i, double with) {
    if (i == LG_GRAPH_NONE) return false;
    const lg_graph_node *n = &m->g.node[i];
    if (n->sort != LG_GRAPH_CONSTANT || n->weights) return false;
    for (size_t k = 0; k < n->count; k++)
        if (n->value[k] != with) return false;
    return true;
}

static uint32_t zeros(making *m, lg_shape shape) {
    const double *value = take(m, lg_shape_count(shape), sizeof *value);
    return m->failed ? 0 : add_constant(m, shape, value, false);
}

static uint32_t reshaped(making *m, uint32_t i, lg_shape shape) {
    while (m->g.node[i].sort == LG_GRAPH_OPERATION && m->g.node[i].op == &lg_op_reshape)
        i = m->g.node[i].in[0];
    const lg_graph_node *from = &m->g.node[i];
    if (lg_same_shape(&from->shape, &shape)) return i;
    if (from->sort == LG_GRAPH_CONSTANT) return add_constant(m, shape, from->value, from->weights);
    if (from->sort == LG_GRAPH_OPERATION && from->op == &lg_op_repeat) {
        lg_graph_node other = *from; /* the shape of a broadcast is given */
        other.shape = shape;
        return add(m, &other);
    }
    return add(
        m, &(lg_graph_node){
               .op = &lg_op_reshape, .inputs = 1, .in = &i, .shape = shape, .count = lg_shape_count(shape)});
}

/* What `instead` of a row may ask. */
typedef struct asking {
    const making *m;
    const lg_graph_node *n;
} asking;

static bool asked_filled(void *user, uint32_t input, double with) {
    const asking *a = user;
    return is_filled(a->m, a->n->in[input], with);
}

/* What the node is instead, or LG_GRAPH_NONE. */
static uint32_t simpler(making *m, const lg_graph_node *n, const lg_shape *const *shapes) {
    const lg_op *op = n->op;
    asking asks = {m, n};
    const lg_known known = {&n->attr, n->inputs, shapes, &n->shape, asked_filled, &asks};
    const lg_instead found = op->instead != NULL ? op->instead(&known) : lg_instead_nothing();
    switch (found.kind) {
    case LG_INSTEAD_INPUT:
        return reshaped(m, n->in[found.input], n->shape);
    case LG_INSTEAD_ZEROS:
        return zeros(m, n->shape);
    case LG_INSTEAD_NOTHING:
        break;
    }
    return LG_GRAPH_NONE;
}

/* ---- rows that stand several times in a batch: the operation on single rows, then its rows several times
 * ---- */

/* copies > 1: row r of the node is row r / copies of a tensor with rows / copies rows. */
static uint32_t copies_of(const making *m, uint32_t i) {
    const lg_graph_node *n = &m->g.node[i];
    if (n->sort != LG_GRAPH_OPERATION || n->op != &lg_op_repeat || n->shape.rank == 0) return 1;
    return n->shape.dims[0] == n->attr.i[0] * n->attr.i[1] ? n->attr.i[1] : 1;
}

static lg_shape fewer_rows(lg_shape shape, uint32_t copies) {
    shape.dims[0] /= copies;
    return shape;
}

/* The tensor of single rows, LG_GRAPH_NONE when the rows differ. */
static uint32_t single_rows(making *m, uint32_t i, uint32_t copies) {
    const lg_graph_node n = m->g.node[i];
    const lg_shape shape = fewer_rows(n.shape, copies);
    if (copies_of(m, i) == copies) return reshaped(m, n.in[0], shape);
    if (n.sort != LG_GRAPH_CONSTANT || n.shape.dims[0] % copies != 0) return LG_GRAPH_NONE;
    const size_t length = n.shape.dims[0] == 0 ? 0 : n.count / n.shape.dims[0];
    for (size_t r = 0; r < n.shape.dims[0]; r++)
        if (memcmp(n.value + r * length, n.value + r / copies * copies * length, length * sizeof *n.value) !=
            0)
            return LG_GRAPH_NONE;
    double *value = take(m, lg_shape_count(shape), sizeof *value);
    for (size_t r = 0; value != NULL && r < shape.dims[0]; r++)
        memcpy(value + r * length, n.value + r * copies * length, length * sizeof *value);
    return m->failed ? LG_GRAPH_NONE : add_constant(m, shape, value, n.weights);
}

/* An input without an axis of rows (a matrix beside a batch of them: its first axis is none, whatever its
 * length), or with one row for all. */
static bool serves_all(const lg_shape *shape, const lg_shape *in) {
    return in->rank < shape->rank || in->dims[0] == 1;
}

static uint32_t on_single_rows(making *m, const lg_graph_node *n, const lg_shape *const *shapes) {
    uint32_t copies = 1, in[LG_MAX_INPUTS];
    const uint32_t rows = n->shape.rank > 0 ? n->shape.dims[0] : 0;
    for (uint32_t k = 0; k < n->inputs && copies == 1; k++)
        if (n->in[k] != LG_GRAPH_NONE) copies = copies_of(m, n->in[k]);
    if (copies == 1 || rows == 0 || rows % copies != 0) return LG_GRAPH_NONE;
    const lg_op *op = n->op;
    lg_graph_node once = *n;
    once.in = in;
    const lg_row_use use = op->rows != NULL      ? op->rows(shapes, n->inputs, &n->shape, copies, &once.attr)
                           : op->element != NULL ? LG_ROWS_BROADCAST
                                                 : LG_ROWS_MEET;
    if (use == LG_ROWS_MEET) return LG_GRAPH_NONE;
    for (uint32_t k = 0; k < n->inputs; k++) {
        in[k] = n->in[k];
        if (in[k] == LG_GRAPH_NONE || (use == LG_ROWS_FIRST && k > 0)) continue;
        const lg_shape shape = m->g.node[in[k]].shape;
        if (use == LG_ROWS_BROADCAST && serves_all(&n->shape, &shape)) continue;
        if (shape.rank == 0 || shape.dims[0] != rows) return LG_GRAPH_NONE;
        in[k] = single_rows(m, in[k], copies);
        if (in[k] == LG_GRAPH_NONE) return LG_GRAPH_NONE;
    }
    once.shape = fewer_rows(n->shape, copies);
    once.count = lg_shape_count(once.shape);
    uint32_t made = add(m, &once);
    const uint32_t length = (uint32_t)(once.count / once.shape.dims[0]);
    return m->failed ? 0
                     : add(m, &(lg_graph_node){.op = &lg_op_repeat,
                                               .attr = {.i = {once.shape.dims[0], copies, length, 0}},
                                               .inputs = 1,
                                               .in = &made,
                                               .shape = n->shape,
                                               .count = n->count});
}

/* How often each row stands in all inputs but the last; 1: they differ. */
static uint32_t rows_of_copies(const making *m, const lg_graph_node *n) {
    uint32_t copies = 0;
    for (uint32_t k = 0; k + 1 < n->inputs; k++) {
        const uint32_t own = n->in[k] == LG_GRAPH_NONE ? copies : copies_of(m, n->in[k]);
        if (copies != 0 && own != copies) return 1;
        copies = own;
    }
    return copies == 0 ? 1 : copies;
}

/* An input that is one row for all rows of an elementwise operation, where the operation takes it so. */
static uint32_t with_broadcasts(making *m, const lg_graph_node *n, const lg_shape *const *shapes) {
    const lg_op *op = n->op;
    const lg_shape *fewer[LG_MAX_INPUTS];
    uint32_t in[LG_MAX_INPUTS], changed = 0;
    lg_graph_node made = *n;
    lg_shape shape = n->shape;
    if (op->element == NULL || n->shape.rank == 0 || n->inputs < 2) return LG_GRAPH_NONE;
    for (uint32_t k = 0; k < n->inputs; k++) {
        in[k] = n->in[k];
        fewer[k] = shapes[k];
        if (in[k] == LG_GRAPH_NONE || copies_of(m, in[k]) != n->shape.dims[0] || n->shape.dims[0] == 1)
            continue;
        in[k] = single_rows(m, in[k], n->shape.dims[0]);
        if (in[k] == LG_GRAPH_NONE) return LG_GRAPH_NONE;
        changed++;
    }
    made.in = in;
    if (changed == 0 || changed == n->inputs) return LG_GRAPH_NONE;
    lg_graph_shapes(&m->g, &made, fewer);
    if (op->shape(fewer, n->inputs, &n->attr, &shape) != LG_OK || !lg_same_shape(&shape, &n->shape))
        return LG_GRAPH_NONE;
    return add(m, &made);
}

static uint32_t operation(making *m, const lg_graph_node *n, const lg_shape *const *shapes);

/* Where a factor alone has rows of its own, what it multiplies is computed for single rows. */
static uint32_t factor_apart(making *m, const lg_graph_node *n, const lg_shape *const *shapes) {
    const lg_op *op = n->op;
    const uint32_t last = n->inputs - 1, copies = n->inputs > 1 ? rows_of_copies(m, n) : 1;
    lg_graph_node rest = *n;
    if (copies == 1 || op->factor == NULL || !op->factor(&n->attr, n->inputs, &rest.attr))
        return LG_GRAPH_NONE;
    rest.inputs = last;
    uint32_t in[2] = {n->in[last], operation(m, &rest, shapes)};
    const lg_graph_node product = {
        .op = &lg_op_mul, .inputs = 2, .in = in, .shape = n->shape, .count = n->count};
    const lg_shape *both[2];
    lg_graph_shapes(&m->g, &product, both);
    return m->failed ? 0 : operation(m, &product, both);
}

static uint32_t operation(making *m, const lg_graph_node *n, const lg_shape *const *shapes) {
    if (folds(m, n)) return fold(m, n, shapes);
    static uint32_t (*const ways[])(making *, const lg_graph_node *, const lg_shape *const *) = {
        simpler, on_single_rows, factor_apart, with_broadcasts};
    for (size_t i = 0; i < LG_COUNT(ways); i++) {
        const uint32_t other = ways[i](m, n, shapes);
        if (other != LG_GRAPH_NONE) return other;
    }
    return add(m, n);
}

/* ---- from the function ---- */

static uint32_t unread(const lg_function *f, const lg_program_node *n, size_t rows) {
    lg_attr attr;
    const lg_op *op = n->op;
    if (op->unread == NULL || !lg_node_attr_at(f, n, rows, &attr)) return 0;
    return op->unread(&attr, n->inputs);
}

/* What the results need that are marked. */
static void mark_needed(making *m) {
    const lg_function *f = m->f;
    for (uint32_t i = f->nodes; i-- > 0;) {
        if (!m->needed[i]) continue;
        const uint32_t not = unread(f, &f->node[i], m->rows);
        for (uint32_t k = 0; k < f->node[i].inputs; k++)
            if (k >= 32 || !(not >> k & 1u)) m->needed[f->edges[f->node[i].first + k]] = 1;
    }
}

/* Values as doubles, rounded to the plan's type. */
static const double *rounded(making *m, const double *values, size_t count, size_t period) {
    if (m->dtype == LG_F64 && count == period) return values;
    double *own = take(m, count, sizeof *own);
    for (size_t i = 0; own != NULL && i < count; i++) {
        const double value = values[i % period];
        own[i] = m->dtype == LG_F32 ? (double)(float)value : value;
    }
    return own;
}

static uint32_t leaf(making *m, const lg_program_node *n, lg_shape shape) {
    const size_t count = lg_shape_count(shape);
    if (n->leaf == LG_LEAF_INPUT && m->input != NULL) return m->input[n->number];
    if (n->leaf == LG_LEAF_INPUT)
        return add(
            m, &(lg_graph_node){.sort = LG_GRAPH_INPUT, .number = n->number, .shape = shape, .count = count});
    if (n->leaf == LG_LEAF_CONSTANT)
        return add_constant(m, shape, rounded(m, m->f->reals + n->payload, count, n->payload_count), false);
    if (m->parameter[n->number] == NULL)
        m->parameter[n->number] = rounded(m, m->program->parameter[n->number].values, count, count);
    return add_constant(m, shape, m->parameter[n->number], true);
}

/* What follows from the rest would tell equal operations apart. */
static void tidy(lg_attr *attr, const lg_op *op) {
    for (uint32_t k = 0; k < LG_WHOLE_COUNT; k++)
        if (op->follows >> k & 1) attr->i[k] = 0;
}

static lg_status all_nodes(making *m, lg_error *error);

/* The output of what the node calls, on its inputs: the called function's operations instead of the call. */
static lg_status write_out(making *m, const lg_program_node *call, const uint32_t *in, uint32_t *out,
                           lg_error *error) {
    making inner = *m;
    inner.f = &m->program->function[lg_called(call)];
    inner.input = in;
    inner.needed = take(m, inner.f->nodes, 1);
    inner.of = take(m, inner.f->nodes, sizeof *inner.of);
    if (m->failed) return LG_OUT_OF_MEMORY;
    const uint32_t result = inner.f->result[lg_called_output(call)];
    inner.needed[result] = 1;
    const lg_status status = all_nodes(&inner, error);
    m->g = inner.g;
    m->work = inner.work;
    m->failed = inner.failed;
    *out = inner.of[result];
    return status;
}

/* Loops stay. */
static bool writes_out(const making *m, const lg_program_node *n) {
    return n->op == &lg_op_call && !m->calls && m->program->function[lg_called(n)].times == 0;
}

static lg_status node(making *m, uint32_t i, lg_error *error) {
    const lg_function *f = m->f;
    const lg_program_node *from = &f->node[i];
    const lg_op *op = from->op;
    lg_shape stated;
    if (!lg_node_shape_at(from, m->rows, &stated))
        return lg_fail(error, LG_SHAPE,
                       "function '%s', operation %u (%s): a tensor is too large with %zu rows", f->name, i,
                       op->name, m->rows);
    if (from->op == &lg_op_leaf) {
        m->of[i] = leaf(m, from, stated);
        return m->failed ? LG_OUT_OF_MEMORY : LG_OK;
    }
    uint32_t in[LG_MAX_INPUTS];
    lg_shape shapes[LG_MAX_INPUTS], shape = stated;
    const lg_shape *pointers[LG_MAX_INPUTS];
    lg_graph_node made = {.op = from->op, .inputs = from->inputs, .in = in, .shape = stated};
    const uint32_t not = unread(f, from, m->rows);
    for (uint32_t k = 0; k < from->inputs; k++) {
        const uint32_t edge = f->edges[from->first + k];
        in[k] = k < 32 && (not >> k & 1u) ? LG_GRAPH_NONE : m->of[edge];
        if (!lg_node_shape_at(&f->node[edge], m->rows, &shapes[k])) return LG_SHAPE;
        pointers[k] = &shapes[k];
    }
    if (writes_out(m, from)) return write_out(m, from, in, &m->of[i], error);
    if (!lg_node_attr_at(f, from, m->rows, &made.attr) ||
        op->shape(pointers, from->inputs, &made.attr, &shape) != LG_OK || !lg_same_shape(&shape, &stated))
        return lg_fail(error, LG_SHAPE, "function '%s', operation %u (%s) does not fit %zu rows", f->name, i,
                       op->name, m->rows);
    made.count = lg_shape_count(stated);
    tidy(&made.attr, made.op);
    m->of[i] = operation(m, &made, pointers);
    if (m->work > m->most_work)
        return lg_fail(error, LG_UNSUPPORTED,
                       "function '%s': what depends on parameters alone takes more than %.2g operations",
                       f->name, m->most_work);
    return m->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

static lg_status all_nodes(making *m, lg_error *error) {
    mark_needed(m);
    for (uint32_t i = 0; i < m->f->nodes; i++)
        if (m->needed[i]) LG_TRY(node(m, i, error));
    return LG_OK;
}

/* What simplification left behind goes. */
static bool drop_unused(making *m) {
    lg_graph *g = &m->g;
    uint32_t *place = take(m, g->count, sizeof *place), kept = 0;
    if (place == NULL) return false;
    for (size_t j = 0; j < m->f->outputs; j++) place[g->result[j]] = 1;
    for (uint32_t i = g->count; i-- > 0;)
        for (uint32_t k = 0; place[i] != 0 && k < g->node[i].inputs; k++)
            if (g->node[i].in[k] != LG_GRAPH_NONE) place[g->node[i].in[k]] = 1;
    for (uint32_t i = 0; i < g->count; i++) {
        if (place[i] == 0) continue;
        for (uint32_t k = 0; k < g->node[i].inputs; k++)
            if (g->node[i].in[k] != LG_GRAPH_NONE) g->node[i].in[k] = place[g->node[i].in[k]] - 1;
        g->node[kept] = g->node[i];
        place[i] = ++kept;
    }
    for (size_t j = 0; j < m->f->outputs; j++) g->result[j] = place[g->result[j]] - 1;
    g->count = kept;
    return true;
}

static lg_status make(making *made, lg_graph *out, lg_error *error) {
    making m = *made;
    const lg_function *f = m.f;
    m.needed = take(&m, f->nodes, 1);
    m.of = take(&m, f->nodes, sizeof *m.of);
    m.parameter = take(&m, m.program->parameters + 1, sizeof *m.parameter);
    m.g.result = take(&m, f->outputs, sizeof *m.g.result);
    if (m.failed) return LG_OUT_OF_MEMORY;
    for (size_t j = 0; j < f->outputs; j++) m.needed[f->result[j]] = 1;
    LG_TRY(all_nodes(&m, error));
    for (size_t j = 0; j < f->outputs; j++) m.g.result[j] = m.of[f->result[j]];
    if (!drop_unused(&m)) return LG_OUT_OF_MEMORY;
    *out = m.g;
    return LG_OK;
}

lg_status lg_graph_make(lg_heap *heap, const lg_program *program, const lg_function *f,
                        const lg_plan_options *options, lg_graph *out, lg_error *error) {
    making m = {.g = {.heap = heap},
                .program = program,
                .f = f,
                .rows = options->rows,
                .dtype = options->dtype,
                .calls = options->calls,
                .most_work = options->most_work};
    return make(&m, out, error);
}

lg_status lg_graph_make_symbolic(lg_heap *heap, const lg_program *program, const lg_function *f, size_t rows,
                                 lg_graph *out, lg_error *error) {
    making m = {.g = {.heap = heap},
                .program = program,
                .f = f,
                .rows = rows,
                .dtype = LG_F64,
                .symbolic = true,
                .most_work = INFINITY};
    return make(&m, out, error);
}

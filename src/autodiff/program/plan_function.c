/* Makes the graph of a function. */
#include "autodiff/program/plan_graph.h"
#include "autodiff/program/program_call.h"

typedef struct making {
    lg_graph *g;
    const lg_program *program;
    const lg_function *f; /* the function being read: the planned one, or one that it calls */
    /* Graph nodes that are the inputs of f. NULL: f is the planned function, and the graph gets input
     * nodes. */
    const uint32_t *input;
    size_t rows;
    lg_dtype dtype;
    bool calls;      /* whether calls stay calls; otherwise they are inlined */
    bool exact;      /* operations stay as they are */
    uint8_t *needed; /* for each node of f: whether the results need it */
    uint32_t *of;    /* for each node of f: its node in the graph */
    const double **parameter;
} making;

static uint32_t unread(const lg_function *f, const lg_program_node *n, size_t rows) {
    lg_attr attr;
    const lg_op *op = n->op;
    if (op->unread == NULL || !lg_node_attr_at(f, n, rows, &attr)) return 0;
    return op->unread(&attr, n->inputs);
}

/* Marks all nodes that the already marked nodes need. */
static void mark_needed(making *m) {
    const lg_function *f = m->f;
    for (uint32_t i = f->nodes; i-- > 0;) {
        if (!m->needed[i]) continue;
        const uint32_t not = unread(f, &f->node[i], m->rows);
        for (uint32_t k = 0; k < f->node[i].inputs; k++)
            if (k >= 32 || !(not >> k & 1u)) m->needed[f->edges[f->node[i].first + k]] = 1;
    }
}

/* Returns `count` values that repeat the first `period` ones, rounded to the plan's type but stored as
 * doubles. */
static const double *rounded(making *m, const double *values, size_t count, size_t period) {
    if (m->dtype == LG_F64 && count == period) return values;
    double *own = lg_graph_take(m->g, count, sizeof *own);
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
        return lg_graph_add(
            m->g,
            &(lg_graph_node){.sort = LG_GRAPH_INPUT, .number = n->number, .shape = shape, .count = count});
    if (n->leaf == LG_LEAF_CONSTANT)
        return lg_graph_add_constant(m->g, shape,
                                     rounded(m, m->f->reals + n->payload, count, n->payload_count), false);
    if (m->parameter[n->number] == NULL)
        m->parameter[n->number] = rounded(m, m->program->parameter[n->number].values, count, count);
    return lg_graph_add_constant(m->g, shape, m->parameter[n->number], true);
}

/* Clears attributes that follow from other data (lg_op.follows), so that equal operations compare equal. */
static void tidy(lg_attr *attr, const lg_op *op) {
    for (uint32_t k = 0; k < LG_WHOLE_COUNT; k++)
        if (op->follows >> k & 1) attr->i[k] = 0;
}

static lg_status all_nodes(making *m, lg_error *error);

/* Inlines a call: adds the operations of the called function, applied to the nodes `in`; *out is the node of
 * the output. */
static lg_status write_out(making *m, const lg_program_node *call, const uint32_t *in, uint32_t *out,
                           lg_error *error) {
    making inner = *m;
    inner.f = &m->program->function[lg_called(call)];
    inner.input = in;
    inner.needed = lg_graph_take(m->g, inner.f->nodes, 1);
    inner.of = lg_graph_take(m->g, inner.f->nodes, sizeof *inner.of);
    if (m->g->failed) return LG_OUT_OF_MEMORY;
    const uint32_t result = inner.f->result[lg_called_output(call)];
    inner.needed[result] = 1;
    const lg_status status = all_nodes(&inner, error);
    *out = inner.of[result];
    return status;
}

/* Whether a call is inlined. Calls of loops never are. */
static bool writes_out(const making *m, const lg_program_node *n) {
    return lg_is_call(n->op) && !m->calls && m->program->function[lg_called(n)].times == 0;
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
        return m->g->failed ? LG_OUT_OF_MEMORY : LG_OK;
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
        return lg_fail(error, LG_SHAPE,
                       "function '%s', operation %u (%s): its shape with %zu rows is not the one that the "
                       "program states",
                       f->name, i, op->name, m->rows);
    made.count = lg_shape_count(stated);
    tidy(&made.attr, made.op);
    m->of[i] = m->exact ? lg_graph_add(m->g, &made) : lg_graph_joined(m->g, &made, pointers);
    if (m->of[i] == LG_GRAPH_NONE) m->of[i] = lg_graph_operation(m->g, &made, pointers);
    if (m->g->work > m->g->most_work)
        return lg_fail(error, LG_UNSUPPORTED,
                       "function '%s': the part that depends on parameters alone takes more than the %.2g "
                       "operations that most_work allows",
                       f->name, m->g->most_work);
    return m->g->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

static lg_status all_nodes(making *m, lg_error *error) {
    mark_needed(m);
    for (uint32_t i = 0; i < m->f->nodes; i++)
        if (m->needed[i]) LG_TRY(node(m, i, error));
    return LG_OK;
}

/* Removes nodes that simplification has made unnecessary. */
static bool drop_unused(making *m) {
    lg_graph *g = m->g;
    uint32_t *place = lg_graph_take(m->g, g->count, sizeof *place), kept = 0;
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

lg_status lg_graph_make(lg_heap *heap, const lg_program *program, const lg_function *f,
                        const lg_plan_options *options, bool exact, lg_graph *out, lg_error *error) {
    lg_graph g = {.heap = heap, .rows = (uint32_t)options->rows, .most_work = options->most_work};
    making m = {.g = &g,
                .program = program,
                .f = f,
                .rows = options->rows,
                .dtype = options->dtype,
                .calls = options->calls,
                .exact = exact};
    m.needed = lg_graph_take(&g, f->nodes, 1);
    m.of = lg_graph_take(&g, f->nodes, sizeof *m.of);
    m.parameter = lg_graph_take(&g, program->parameters + 1, sizeof *m.parameter);
    g.result = lg_graph_take(&g, f->outputs, sizeof *g.result);
    if (g.failed) return LG_OUT_OF_MEMORY;
    for (size_t j = 0; j < f->outputs; j++) m.needed[f->result[j]] = 1;
    LG_TRY(all_nodes(&m, error));
    for (size_t j = 0; j < f->outputs; j++) g.result[j] = m.of[f->result[j]];
    if (!drop_unused(&m)) return LG_OUT_OF_MEMORY;
    *out = g;
    return LG_OK;
}

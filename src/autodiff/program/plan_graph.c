#include "autodiff/program/plan_graph.h"

#include <string.h>

void *lg_graph_take(lg_graph *g, size_t count, size_t size) {
    void *memory = lg_heap_take(g->heap, count, size);
    if (memory == NULL) g->failed = true;
    return memory;
}

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

static bool grow(lg_graph *g) {
    const uint32_t capacity = g->capacity == 0 ? 128 : 2 * g->capacity;
    lg_graph_node *node = lg_graph_take(g, capacity, sizeof *node);
    uint32_t *table = lg_graph_take(g, 2 * (size_t)capacity, sizeof *table);
    if (g->failed) return false;
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

uint32_t lg_graph_add(lg_graph *g, const lg_graph_node *n) {
    if (g->failed || (g->count == g->capacity && !grow(g))) return 0;
    uint32_t at = (uint32_t)hash(n) & (g->slots - 1);
    for (; g->table[at] != 0; at = (at + 1) & (g->slots - 1))
        if (equal(&g->node[g->table[at] - 1], n)) return g->table[at] - 1;
    uint32_t *in = lg_graph_take(g, n->inputs, sizeof *in);
    if (in == NULL) return 0;
    if (n->inputs > 0) memcpy(in, n->in, n->inputs * sizeof *in);
    g->node[g->count] = *n;
    g->node[g->count].in = in;
    g->table[at] = ++g->count;
    return g->count - 1;
}

uint32_t lg_graph_add_constant(lg_graph *g, lg_shape shape, const double *value, bool weights) {
    return lg_graph_add(g, &(lg_graph_node){.sort = LG_GRAPH_CONSTANT,
                                            .op = &lg_op_leaf,
                                            .shape = shape,
                                            .count = lg_shape_count(shape),
                                            .value = value,
                                            .weights = weights});
}

static const lg_shape no_shape;

void lg_graph_shapes(const lg_graph *g, const lg_graph_node *n, const lg_shape **shapes) {
    for (uint32_t k = 0; k < n->inputs; k++)
        shapes[k] = n->in[k] == LG_GRAPH_NONE ? &no_shape : &g->node[n->in[k]].shape;
}

double lg_graph_work(const lg_graph *g, const lg_graph_node *n) {
    const lg_shape *shapes[LG_MAX_INPUTS];
    if (n->op->terms == NULL) return (double)n->count;
    lg_graph_shapes(g, n, shapes);
    return (double)n->count * (double)n->op->terms(shapes, &n->attr, &n->shape);
}

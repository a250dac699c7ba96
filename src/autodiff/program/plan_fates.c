/* Decides how each node of a plan is computed. */
#include "autodiff/program/plan_code.h"
#include "autodiff/program/plan_make.h"

/* Whether the node ends a layer whose product no other node uses. */
static bool fuses(const lg_planning *p, const lg_graph_node *n) {
    const lg_shape *shapes[LG_MAX_INPUTS];
    if (!n->op->ends_layer || n->in[0] == LG_GRAPH_NONE) return false;
    const lg_graph_node *product = &p->g.node[n->in[0]];
    if (product->sort != LG_GRAPH_OPERATION || product->op->begins_layer == NULL ||
        p->item[n->in[0]].uses != 1 || p->item[n->in[0]].fate != LG_FATE_TENSOR)
        return false;
    lg_graph_shapes(&p->g, product, shapes);
    return product->op->begins_layer(shapes, product->inputs, &product->attr);
}

/* Whether an elementwise operation should stay a tensor step, because an input of the same size is computed
 * by a tensor step. */
static bool follows_tensor(const lg_planning *p, uint32_t node) {
    enum { FEW = 6 };
    const lg_graph_node *n = &p->g.node[node];
    if (n->op->element == NULL || lg_code_count(&p->g, node) <= FEW) return false;
    for (uint32_t k = 0; k < n->inputs; k++)
        if (n->in[k] != LG_GRAPH_NONE && p->g.node[n->in[k]].count == n->count &&
            (p->item[n->in[k]].fate == LG_FATE_TENSOR || p->item[n->in[k]].fate == LG_FATE_FUSED))
            return true;
    return false;
}

/* Whether the node is a full sum of two matrices, and term k is a product that no other node uses. For few
 * elements a sum takes no longer than adding to y does in the product. */
static bool adds_product(const lg_planning *p, const lg_graph_node *n, uint32_t k) {
    enum { FEW = 1024 };
    const lg_graph *g = &p->g;
    const lg_graph_node *product = &g->node[n->in[k]], *other = &g->node[n->in[1 - k]];
    return n->count > FEW && product->op == &lg_op_matmul && product->inputs == 2 &&
           product->shape.rank == 2 && lg_same_shape(&product->shape, &other->shape) &&
           p->item[n->in[k]].uses == 1 && p->item[n->in[k]].fate == LG_FATE_TENSOR;
}

/* Returns the product that the step of a sum can add to the other term. If both terms are such products,
 * returns the later product. Returns LG_GRAPH_NONE if neither term is such a product. */
static uint32_t added_product(const lg_planning *p, uint32_t node) {
    const lg_graph_node *n = &p->g.node[node];
    if (n->op != &lg_op_add) return LG_GRAPH_NONE;
    const uint32_t later = n->in[1] > n->in[0];
    return adds_product(p, n, later)       ? n->in[later]
           : adds_product(p, n, 1 - later) ? n->in[1 - later]
                                           : LG_GRAPH_NONE;
}

bool lg_planning_joins(const lg_planning *p, uint32_t node) {
    const lg_graph_node *n = &p->g.node[node];
    size_t outer = 1;
    if (p->item[node].fate != LG_FATE_TENSOR || n->op != &lg_op_concat) return false;
    for (uint32_t d = 0; d < n->attr.i[0]; d++) outer *= n->shape.dims[d];
    return outer == 1;
}

static bool is_output(const lg_planning *p, uint32_t node) {
    for (size_t j = 0; j < p->plan->outputs; j++)
        if (p->item[p->g.result[j]].base == node) return true;
    return false;
}

/* Lets the step that computes an input of `node` write it to the node's memory, from element `at` on.
 * Changes nothing if the input is an output of the plan, or if its memory already belongs to another node. */
static void join(lg_planning *p, uint32_t input, uint32_t node, size_t at) {
    const uint32_t base = p->item[input].base;
    lg_plan_item *part = &p->item[base];
    if (!lg_planning_is_step(p, base) || part->into != LG_GRAPH_NONE ||
        p->g.node[base].count != p->g.node[input].count || is_output(p, base))
        return;
    part->into = node;
    part->into_offset = at;
    part->lasting = true; /* the memory belongs to `node` */
}

static void join_inputs(lg_planning *p, uint32_t node) {
    const lg_graph_node *n = &p->g.node[node];
    const uint32_t product = p->item[node].product;
    if (product != LG_GRAPH_NONE) {
        const uint32_t other = n->in[n->in[0] == product];
        if (p->item[other].uses == 1 && p->item[p->item[other].base].uses == 1) join(p, other, node, 0);
    }
    size_t at = 0;
    for (uint32_t k = 0; lg_planning_joins(p, node) && k < n->inputs; k++) {
        join(p, n->in[k], node, at);
        at += p->g.node[n->in[k]].count;
    }
}

void lg_planning_find_fates(lg_planning *p) {
    const lg_graph *g = &p->g;
    for (uint32_t i = 0; i < g->count; i++)
        for (uint32_t k = 0; k < g->node[i].inputs; k++)
            if (g->node[i].in[k] != LG_GRAPH_NONE) p->item[g->node[i].in[k]].uses++;
    for (size_t j = 0; j < p->plan->outputs; j++) p->item[g->result[j]].uses++;
    for (uint32_t i = 0; i < g->count; i++) {
        const lg_graph_node *n = &g->node[i];
        lg_plan_item *it = &p->item[i];
        const lg_shape *shapes[LG_MAX_INPUTS];
        it->base = i;
        it->into = it->product = LG_GRAPH_NONE;
        it->place.area = LG_AREA_NONE;
        if (n->sort != LG_GRAPH_OPERATION) {
            it->fate = LG_FATE_GIVEN;
            continue;
        }
        lg_graph_shapes(g, n, shapes);
        const lg_op *op = n->op;
        size_t offset;
        if (op->view != NULL && p->item[n->in[0]].fate != LG_FATE_CODE &&
            op->view(shapes, &n->attr, &offset)) {
            it->fate = LG_FATE_VIEW;
            it->base = p->item[n->in[0]].base;
            it->offset = p->item[n->in[0]].offset + offset;
            continue;
        }
        const bool fused = fuses(p, n); /* one layer step is faster than a product followed by scalar code */
        it->fate = !p->compact && !fused && lg_code_fits(g, i) && !follows_tensor(p, i) ? LG_FATE_CODE
                                                                                        : LG_FATE_TENSOR;
        if (fused) p->item[n->in[0]].fate = LG_FATE_FUSED;
        if (it->fate != LG_FATE_TENSOR) continue;
        it->product = added_product(p, i);
        if (it->product != LG_GRAPH_NONE) p->item[it->product].fate = LG_FATE_FUSED;
    }
    for (uint32_t i = 0; i < g->count; i++) join_inputs(p, i);
}

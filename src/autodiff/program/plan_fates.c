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
    }
}

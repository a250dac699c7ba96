/* Finds the order of the steps of a plan. */
#include "autodiff/program/plan_make.h"

/* The smallest phase that is not before the phases of the inputs. Tensor steps have even phases, scalar code
 * has odd phases. A node may have the same phase as its inputs. */
static uint32_t phase_of(const lg_planning *p, uint32_t node) {
    const lg_graph_node *n = &p->g.node[node];
    const uint32_t odd = p->item[node].fate == LG_FATE_CODE;
    uint32_t phase = odd;
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE) continue;
        const uint32_t before = p->item[n->in[k]].phase, after = before + (before % 2 != odd);
        if (after > phase) phase = after;
    }
    return phase;
}

/* The node behind which `node` is placed; usually the node itself. An elementwise tensor step is placed
 * earlier if that frees more memory than its output takes, for example in the case of an activation's slope.
 * This is so when it is the last reader of several inputs that other steps read, too, and that together are
 * larger than its output. It is then placed behind the last of its inputs and of the other readers of these
 * inputs. last[i] is the last reader of node i, before[i] the reader before it. */
static uint32_t anchor_of(const lg_planning *p, uint32_t node, const uint32_t *last, const uint32_t *before,
                          const uint32_t *anchor) {
    const lg_graph_node *n = &p->g.node[node];
    size_t freed = 0;
    uint32_t after = 0;
    if (p->item[node].fate != LG_FATE_TENSOR || n->op->element == NULL) return node;
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE) continue;
        const uint32_t in = n->in[k], base = p->item[in].base;
        if (anchor[in] > after) after = anchor[in];
        if (in != base || p->item[in].fate != LG_FATE_TENSOR || last[in] != node || p->item[in].uses < 2)
            continue;
        freed += p->g.node[in].count;
        if (anchor[before[in]] > after) after = anchor[before[in]];
    }
    return freed > n->count ? after : node;
}

/* Finds the anchor of each node, the node behind which it is placed. */
static bool find_anchors(lg_planning *p, uint32_t *anchor) {
    const uint32_t nodes = p->g.count;
    uint32_t *last = lg_planning_take(p, nodes, sizeof *last);
    uint32_t *before = lg_planning_take(p, nodes, sizeof *before);
    if (p->failed) return false;
    for (uint32_t i = 0; i < nodes; i++)
        for (uint32_t k = 0; k < p->g.node[i].inputs; k++) {
            const uint32_t in = p->g.node[i].in[k];
            if (in == LG_GRAPH_NONE || last[in] == i) continue;
            before[in] = last[in];
            last[in] = i;
        }
    for (size_t j = 0; j < p->plan->outputs; j++) last[p->g.result[j]] = UINT32_MAX;
    for (uint32_t i = 0; i < nodes; i++) anchor[i] = anchor_of(p, i, last, before, anchor);
    return true;
}

static bool sort_by_anchor(lg_planning *p, uint32_t *sorted) {
    const uint32_t nodes = p->g.count;
    uint32_t *anchor = lg_planning_take(p, nodes, sizeof *anchor);
    uint32_t *behind = lg_planning_take(p, (size_t)nodes + 1, sizeof *behind);
    if (p->failed || !find_anchors(p, anchor)) return false;
    for (uint32_t i = 0; i < nodes; i++) behind[anchor[i] + 1]++;
    for (uint32_t i = 0; i < nodes; i++) behind[i + 1] += behind[i];
    for (uint32_t i = 0; i < nodes; i++) sorted[behind[anchor[i]]++] = i;
    return true;
}

/* Sorts the steps by phase, and by anchor within a phase: first everything that tensor steps can compute,
 * then all scalar code that is possible with these results, and so on. This gives few, long runs of scalar
 * code. Returns the number of nodes in the order. `first` must hold 2 nodes + 2 zeros. */
static uint32_t sort_by_phase(lg_planning *p, const uint32_t *sorted, uint32_t *first, uint32_t *order) {
    const uint32_t nodes = p->g.count;
    for (uint32_t i = 0; i < nodes; i++) {
        if (p->item[i].fate != LG_FATE_GIVEN) p->item[i].phase = phase_of(p, i);
        if (lg_planning_is_step(p, i)) first[p->item[i].phase + 1]++;
    }
    for (uint32_t f = 0; f <= 2 * nodes; f++) first[f + 1] += first[f];
    const uint32_t placed = first[2 * nodes + 1];
    for (uint32_t i = 0; i < nodes; i++)
        if (lg_planning_is_step(p, sorted[i])) order[first[p->item[sorted[i]].phase]++] = sorted[i];
    return placed;
}

/* Makes one step from all scalar code of a phase, and one step from each tensor. */
static void find_runs(const lg_planning *p, uint32_t placed, lg_plan_order *o) {
    for (uint32_t j = 0; j < placed; j++) {
        const lg_plan_item *it = &p->item[o->node[j]];
        const bool code = it->fate == LG_FATE_CODE;
        if (code && j > 0 && p->item[o->node[j - 1]].phase == it->phase)
            o->run[o->steps - 1].count++;
        else
            o->run[o->steps++] = (lg_plan_run){j, 1, code};
    }
}

/* Finds the steps at which each node is made and read last. The inputs of a product inside a dense layer are
 * read by the layer's step. */
static void find_lives(lg_planning *p, const lg_plan_order *o) {
    for (size_t s = 0; s < o->steps; s++)
        for (uint32_t j = 0; j < o->run[s].count; j++) {
            const uint32_t node = o->node[o->run[s].first + j];
            const lg_graph_node *n = &p->g.node[node];
            p->item[node].made = (uint32_t)s;
            for (uint32_t k = 0; k < n->inputs; k++) {
                if (n->in[k] == LG_GRAPH_NONE) continue;
                const lg_graph_node *from = &p->g.node[n->in[k]];
                p->item[p->item[n->in[k]].base].last = (uint32_t)s;
                for (uint32_t l = 0; p->item[n->in[k]].fate == LG_FATE_FUSED && l < from->inputs; l++)
                    p->item[p->item[from->in[l]].base].last = (uint32_t)s;
            }
        }
    /* A concatenation lives until its parts are no longer read. */
    for (uint32_t i = 0; i < p->g.count; i++) {
        const lg_plan_item *part = &p->item[i];
        if (part->into != LG_GRAPH_NONE && part->last > p->item[part->into].last)
            p->item[part->into].last = part->last;
    }
}

static void sort_endings(const lg_planning *p, lg_plan_order *o) {
    for (uint32_t i = 0; i < p->g.count; i++)
        if (lg_planning_is_step(p, i)) o->end[p->item[i].last + 1]++;
    for (size_t s = 0; s <= o->steps; s++) o->end[s + 1] += o->end[s];
    for (uint32_t i = p->g.count; i-- > 0;)
        if (lg_planning_is_step(p, i)) o->ending[--o->end[p->item[i].last + 1]] = i;
}

lg_status lg_planning_find_order(lg_planning *p, lg_plan_order *out) {
    const uint32_t nodes = p->g.count;
    uint32_t *sorted = lg_planning_take(p, nodes, sizeof *sorted);
    uint32_t *phases = lg_planning_take(p, 2 * (size_t)nodes + 2, sizeof *phases);
    lg_plan_order o = {.node = lg_planning_take(p, nodes, sizeof *o.node),
                       .run = lg_planning_take(p, nodes, sizeof *o.run),
                       .ending = lg_planning_take(p, nodes, sizeof *o.ending)};
    if (p->failed || !sort_by_anchor(p, sorted)) return LG_OUT_OF_MEMORY;
    find_runs(p, sort_by_phase(p, sorted, phases, o.node), &o);
    o.end = lg_planning_take(p, o.steps + 2, sizeof *o.end);
    if (p->failed) return LG_OUT_OF_MEMORY;
    find_lives(p, &o);
    sort_endings(p, &o);
    *out = o;
    return LG_OK;
}

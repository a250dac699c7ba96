/* Assigns memory to the numbers of a plan. */
#include "autodiff/program/plan_make.h"

/* ---- the work memory ---- */

struct lg_plan_hole {
    size_t offset, count;
    struct lg_plan_hole *next;
};

static size_t aligned(const lg_planning *p, size_t count) {
    const size_t unit = p->packed ? 4 : 16;
    return (count + unit - 1) / unit * unit;
}

/* Takes the first hole that is large enough. If the last hole reaches the end of the work memory, it may be
 * extended. */
size_t lg_planning_give_room(lg_planning *p, size_t count) {
    count = aligned(p, count);
    for (struct lg_plan_hole **at = &p->free; *at != NULL; at = &(*at)->next) {
        struct lg_plan_hole *hole = *at;
        const size_t offset = hole->offset;
        if (hole->count < count && offset + hole->count == p->plan->work_count) {
            p->plan->work_count = offset + count;
            hole->count = count;
        }
        if (hole->count < count) continue;
        hole->offset += count;
        hole->count -= count;
        if (hole->count == 0) *at = hole->next;
        return offset;
    }
    const size_t offset = p->plan->work_count;
    p->plan->work_count += count;
    return offset;
}

void lg_planning_take_back(lg_planning *p, size_t offset, size_t count) {
    count = aligned(p, count);
    if (count == 0) return;
    struct lg_plan_hole **at = &p->free, *before = NULL;
    while (*at != NULL && (*at)->offset < offset) {
        before = *at;
        at = &before->next;
    }
    struct lg_plan_hole *after = *at;
    if (before != NULL && before->offset + before->count == offset) {
        before->count += count;
    } else {
        struct lg_plan_hole *made = lg_planning_take(p, 1, sizeof *made);
        if (made == NULL) return;
        *made = (struct lg_plan_hole){offset, count, after};
        *at = made;
        before = made;
    }
    if (after != NULL && before->offset + before->count == after->offset) {
        before->count += after->count;
        before->next = after->next;
    }
}

/* ---- constants ---- */

static bool grow_constants(lg_planning *p) {
    lg_plan_constants *c = &p->constants;
    const size_t capacity = c->capacity == 0 ? 64 : 2 * c->capacity;
    const double **values = lg_planning_take(p, capacity, sizeof *values);
    size_t *at = lg_planning_take(p, capacity, sizeof *at);
    size_t *count = lg_planning_take(p, capacity, sizeof *count);
    if (p->failed) return false;
    for (size_t i = 0; i < c->pieces; i++) {
        values[i] = c->values[i];
        at[i] = c->at[i];
        count[i] = c->count[i];
    }
    *c = (lg_plan_constants){values, at, count, c->pieces, capacity, c->room};
    return true;
}

lg_place lg_planning_add_constant(lg_planning *p, const double *values, size_t count) {
    lg_plan_constants *c = &p->constants;
    if (c->pieces == c->capacity && !grow_constants(p)) return (lg_place){LG_AREA_NONE, 0, 0};
    for (size_t i = 0; i < c->pieces; i++)
        if (c->values[i] == values && c->count[i] == count) return (lg_place){LG_AREA_CONSTANTS, 0, c->at[i]};
    const size_t at = c->room;
    c->values[c->pieces] = values;
    c->at[c->pieces] = at;
    c->count[c->pieces++] = count;
    c->room += aligned(p, count);
    return (lg_place){LG_AREA_CONSTANTS, 0, at};
}

lg_status lg_planning_fill_constants(lg_planning *p) {
    const lg_plan_constants *c = &p->constants;
    lg_plan *plan = p->plan;
    plan->constant_count = c->room;
    plan->constants = lg_planning_keep(p, c->room + 1, plan->k->size);
    if (p->failed) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < c->pieces; i++)
        plan->k->convert_in(c->count[i], c->values[i],
                            (unsigned char *)plan->constants + c->at[i] * plan->k->size);
    return LG_OK;
}

/* ---- places ---- */

lg_place lg_planning_place(lg_planning *p, uint32_t node) {
    const lg_plan_item *it = &p->item[node];
    const uint32_t base = it->base;
    const lg_graph_node *n = &p->g.node[base];
    if (n->sort == LG_GRAPH_INPUT) return (lg_place){LG_AREA_INPUT, n->number, it->offset};
    if (n->sort == LG_GRAPH_CONSTANT)
        return lg_planning_add_constant(p, n->value + it->offset, p->g.node[node].count);
    lg_place place = p->item[base].place;
    place.offset += it->offset;
    return place;
}

/* Whether y may overwrite the numbers that input k reads. The kernel of an elementwise operation reads
 * element i of every input before it writes element i of y. So every input that reads these numbers,
 * including k, must have the shape of y; with another shape the kernel would read element i again later. A
 * kernel with over_first writes all of y before it reads the second input, so only the first input may read
 * these numbers. */
static bool may_lie_over(const lg_planning *p, const lg_graph_node *n, uint32_t k) {
    if (n->in[k] == LG_GRAPH_NONE) return false;
    for (uint32_t j = 0; j < n->inputs; j++) {
        if (n->in[j] == LG_GRAPH_NONE || p->item[n->in[j]].base != p->item[n->in[k]].base) continue;
        if (!lg_same_shape(&p->g.node[n->in[j]].shape, &n->shape) || (n->op->over_first && j > 0))
            return false;
    }
    return true;
}

/* Lets an elementwise operation overwrite an input that no later step needs, if possible. */
static bool over_input(lg_planning *p, uint32_t node, uint32_t now) {
    const lg_graph_node *n = &p->g.node[node];
    if (n->op->element == NULL) return false;
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (!may_lie_over(p, n, k)) continue;
        lg_plan_item *from = &p->item[p->item[n->in[k]].base];
        if (from->place.area != LG_AREA_WORK || from->last != now || from->lasting ||
            p->g.node[p->item[n->in[k]].base].count != n->count)
            continue;
        p->item[node].place = from->place;
        from->lasting = true; /* the memory now belongs to the new node */
        return true;
    }
    return false;
}

void lg_planning_give_place(lg_planning *p, uint32_t node, uint32_t now) {
    lg_plan_item *it = &p->item[node];
    if (it->into != LG_GRAPH_NONE && it->place.area == LG_AREA_NONE) {
        lg_planning_give_place(p, it->into, UINT32_MAX);
        it->place = p->item[it->into].place;
        it->place.offset += it->into_offset;
        return;
    }
    if (it->into == LG_GRAPH_NONE && it->place.area == LG_AREA_OUTPUT && !it->skipped &&
        p->plan->spill[it->place.number] == LG_NO_SPILL)
        p->plan->spill[it->place.number] = lg_planning_give_room(p, p->g.node[node].count);
    if (it->place.area != LG_AREA_NONE || over_input(p, node, now)) return;
    it->place = (lg_place){LG_AREA_WORK, 0, lg_planning_give_room(p, p->g.node[node].count)};
}

void lg_planning_end_lives(lg_planning *p, const uint32_t *ending, size_t count) {
    for (size_t i = 0; i < count; i++) {
        const lg_plan_item *it = &p->item[ending[i]];
        if (it->place.area == LG_AREA_WORK && !it->lasting)
            lg_planning_take_back(p, it->place.offset, p->g.node[ending[i]].count);
    }
}

/* How often a concatenation reads the elements of a node, not counting views that others read, too. */
static uint32_t reads(const lg_planning *p, const lg_graph_node *n, uint32_t base) {
    uint32_t count = 0;
    for (uint32_t k = 0; k < n->inputs; k++)
        count += n->in[k] == base || (p->item[n->in[k]].base == base && p->item[n->in[k]].uses == 1);
    return count;
}

/* Whether tensor steps that may be left out compute all elements of the node, and only `uses` others read
 * them. */
static bool is_apart(const lg_planning *p, uint32_t node, uint32_t uses) {
    const lg_graph_node *n = &p->g.node[node];
    const lg_plan_item *it = &p->item[node];
    if (it->fate != LG_FATE_TENSOR || it->uses != uses || it->product != LG_GRAPH_NONE || n->op->ends_layer)
        return false;
    for (uint32_t k = 0; lg_planning_joins(p, node) && k < n->inputs; k++) {
        const uint32_t base = p->item[n->in[k]].base;
        if (p->item[base].into == node && !is_apart(p, base, reads(p, n, base))) return false;
    }
    return true;
}

/* The node whose step can write output j: the node itself, or the node that has the same elements in another
 * shape, if nothing else reads it. LG_GRAPH_NONE: an output that is copied at the end. */
static uint32_t written_for(const lg_planning *p, size_t j) {
    const uint32_t node = p->g.result[j], base = p->item[node].base;
    const bool whole =
        node == base || (p->g.node[base].count == p->g.node[node].count && p->item[base].uses == 1 &&
                         p->item[node].uses == 1 && p->item[base].into == LG_GRAPH_NONE);
    return whole && lg_planning_is_step(p, base) && p->item[base].place.area == LG_AREA_NONE ? base
                                                                                             : LG_GRAPH_NONE;
}

/* Lets the step that computes an output write it directly to the caller's memory, unless the output is a part
 * of another node, an input or a constant, or the node is already another output. If the caller does not want
 * such an output, the steps that compute nothing else are left out; lg_planning_give_place assigns smaller
 * outputs, and those that other steps read, a place in the work memory, too (`spill`). */
void lg_planning_place_outputs(lg_planning *p) {
    enum { SMALL = 64 };
    for (size_t j = 0; j < p->plan->outputs; j++) {
        const uint32_t node = written_for(p, j);
        p->item[p->item[p->g.result[j]].base].lasting = true;
        p->plan->spill[j] = LG_NO_SPILL;
        if (node == LG_GRAPH_NONE) continue;
        p->item[node].place = (lg_place){LG_AREA_OUTPUT, (uint32_t)j, 0};
        p->item[node].skipped = p->g.node[node].count > SMALL && is_apart(p, node, 1);
    }
}

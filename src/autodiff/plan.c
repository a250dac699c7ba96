/* Plans: the order of steps, where numbers lie. */
#include "autodiff/plan.h"

#include <string.h>

#include "autodiff/plan_code.h"
#include "autodiff/plan_graph.h"
#include "autodiff/program_call.h"
#include "kernels/product.h"

/* ---- what becomes of a node ---- */

typedef enum fate {
    GIVEN,  /* an input or a constant */
    VIEW,   /* a part of another node's numbers */
    FUSED,  /* a product inside of the dense layer that takes it */
    CODE,   /* scalar code */
    TENSOR, /* a step of its own */
} fate;

typedef struct item {
    fate fate;
    uint32_t base; /* VIEW: the node whose numbers it is a part of, none itself; others: itself */
    size_t offset; /* VIEW: in the base's numbers */
    uint32_t uses;
    uint32_t made, last; /* steps: that computes it, that reads it last */
    uint32_t phase;      /* in the order of work: even for tensors, odd for scalar code */
    bool lasting;        /* no place is given away, as outputs are */
    lg_place place;
} item;

typedef struct piece {
    size_t offset, count;
    struct piece *next;
} piece;

typedef struct planning {
    lg_plan *plan;
    lg_heap temporary;
    lg_graph g;
    item *item;
    lg_scalar **code_value; /* for lg_code_begin */
    piece *free;            /* holes in the work memory, in order */
    lg_plan_step *step;
    size_t capacity;
    size_t constant_room;
    const double *
        *constant; /* pieces of the constants: values, or NULL when the place is written otherwise */
    size_t *constant_at, *constant_count, constants, constant_capacity;
    lg_exchange exchange;
    lg_error *error;
    bool compact, packed, failed;
} planning;

static void *take(planning *p, size_t count, size_t size) {
    void *memory = lg_heap_take(&p->temporary, count, size);
    if (memory == NULL) p->failed = true;
    return memory;
}

static void *keep(planning *p, size_t count, size_t size) {
    void *memory = lg_heap_take(&p->plan->memory, count, size);
    if (memory == NULL) p->failed = true;
    return memory;
}

static size_t aligned(const planning *p, size_t count) {
    const size_t unit = p->packed ? 4 : 16;
    return (count + unit - 1) / unit * unit;
}

/* ---- fates ---- */

/* It ends a layer whose product nobody else takes. */
static bool fuses(const planning *p, const lg_graph_node *n) {
    const lg_shape *shapes[LG_MAX_INPUTS];
    if (!n->op->ends_layer || n->in[0] == LG_GRAPH_NONE) return false;
    const lg_graph_node *product = &p->g.node[n->in[0]];
    if (product->sort != LG_GRAPH_OPERATION || product->op->begins_layer == NULL ||
        p->item[n->in[0]].uses != 1 || p->item[n->in[0]].fate != TENSOR)
        return false;
    lg_graph_shapes(&p->g, product, shapes);
    return product->op->begins_layer(shapes, product->inputs, &product->attr);
}

/* Elementwise over a tensor of its size that a step makes: the kernel goes on where that step ends. */
static bool follows_tensor(const planning *p, const lg_graph_node *n) {
    enum { FEW = 6 };
    if (n->op->element == NULL || n->count <= FEW) return false;
    for (uint32_t k = 0; k < n->inputs; k++)
        if (n->in[k] != LG_GRAPH_NONE && p->g.node[n->in[k]].count == n->count &&
            (p->item[n->in[k]].fate == TENSOR || p->item[n->in[k]].fate == FUSED))
            return true;
    return false;
}

static void find_fates(planning *p) {
    const lg_graph *g = &p->g;
    for (uint32_t i = 0; i < g->count; i++)
        for (uint32_t k = 0; k < g->node[i].inputs; k++)
            if (g->node[i].in[k] != LG_GRAPH_NONE) p->item[g->node[i].in[k]].uses++;
    for (size_t j = 0; j < p->plan->outputs; j++) p->item[g->result[j]].uses++;
    for (uint32_t i = 0; i < g->count; i++) {
        const lg_graph_node *n = &g->node[i];
        item *it = &p->item[i];
        const lg_shape *shapes[LG_MAX_INPUTS];
        it->base = i;
        it->place.area = LG_AREA_NONE;
        if (n->sort != LG_GRAPH_OPERATION) {
            it->fate = GIVEN;
            continue;
        }
        lg_graph_shapes(g, n, shapes);
        const lg_op *op = n->op;
        size_t offset;
        if (op->view != NULL && p->item[n->in[0]].fate != CODE && op->view(shapes, &n->attr, &offset)) {
            it->fate = VIEW;
            it->base = p->item[n->in[0]].base;
            it->offset = p->item[n->in[0]].offset + offset;
            continue;
        }
        const bool fused = fuses(p, n); /* a layer is quicker than its product and scalar code */
        it->fate = !p->compact && !fused && lg_code_fits(g, n) && !follows_tensor(p, n) ? CODE : TENSOR;
        if (fused) p->item[n->in[0]].fate = FUSED;
    }
}

/* ---- the work memory ---- */

/* The first hole that is large enough, or the last one, when it ends the memory, made larger. */
static size_t give_room(planning *p, size_t count) {
    count = aligned(p, count);
    for (piece **at = &p->free; *at != NULL; at = &(*at)->next) {
        piece *hole = *at;
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

static void take_back(planning *p, size_t offset, size_t count) {
    count = aligned(p, count);
    if (count == 0) return;
    piece **at = &p->free, *before = NULL;
    while (*at != NULL && (*at)->offset < offset) {
        before = *at;
        at = &before->next;
    }
    piece *after = *at;
    if (before != NULL && before->offset + before->count == offset) {
        before->count += count;
    } else {
        piece *made = take(p, 1, sizeof *made);
        if (made == NULL) return;
        *made = (piece){offset, count, after};
        *at = made;
        before = made;
    }
    if (after != NULL && before->offset + before->count == after->offset) {
        before->count += after->count;
        before->next = after->next;
    }
}

/* ---- constants ---- */

static lg_place add_constant(planning *p, const double *values, size_t count) {
    if (p->constants == p->constant_capacity) {
        const size_t capacity = p->constant_capacity == 0 ? 64 : 2 * p->constant_capacity;
        const double **grown = take(p, capacity, sizeof *grown);
        size_t *at = take(p, capacity, sizeof *at), *counts = take(p, capacity, sizeof *counts);
        if (p->failed) return (lg_place){LG_AREA_NONE, 0, 0};
        for (size_t i = 0; i < p->constants; i++) {
            grown[i] = p->constant[i];
            at[i] = p->constant_at[i];
            counts[i] = p->constant_count[i];
        }
        p->constant = grown;
        p->constant_at = at;
        p->constant_count = counts;
        p->constant_capacity = capacity;
    }
    for (size_t i = 0; i < p->constants; i++)
        if (p->constant[i] == values && p->constant_count[i] == count)
            return (lg_place){LG_AREA_CONSTANTS, 0, p->constant_at[i]};
    p->constant[p->constants] = values;
    p->constant_at[p->constants] = p->constant_room;
    p->constant_count[p->constants++] = count;
    const size_t at = p->constant_room;
    p->constant_room += aligned(p, count);
    return (lg_place){LG_AREA_CONSTANTS, 0, at};
}

static lg_status fill_constants(planning *p) {
    lg_plan *plan = p->plan;
    plan->constant_count = p->constant_room;
    plan->constants = keep(p, p->constant_room + 1, plan->k->size);
    if (p->failed) return LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < p->constants; i++)
        plan->k->convert_in(p->constant_count[i], p->constant[i],
                            (unsigned char *)plan->constants + p->constant_at[i] * plan->k->size);
    return LG_OK;
}

/* ---- places ---- */

static lg_place place_of(planning *p, uint32_t node) {
    const item *it = &p->item[node];
    const uint32_t base = it->base;
    const lg_graph_node *n = &p->g.node[base];
    if (n->sort == LG_GRAPH_INPUT) return (lg_place){LG_AREA_INPUT, n->number, it->offset};
    if (n->sort == LG_GRAPH_CONSTANT) return add_constant(p, n->value + it->offset, p->g.node[node].count);
    lg_place place = p->item[base].place;
    place.offset += it->offset;
    return place;
}

static lg_place code_place(void *user, uint32_t node) {
    return place_of(user, node);
}

/* Whether an input of another shape reads the same numbers as input k. */
static bool meets_another(const planning *p, const lg_graph_node *n, uint32_t k) {
    for (uint32_t j = 0; j < n->inputs; j++)
        if (n->in[j] != LG_GRAPH_NONE && p->item[n->in[j]].base == p->item[n->in[k]].base &&
            !lg_same_shape(&p->g.node[n->in[j]].shape, &n->shape))
            return true;
    return false;
}

/* An elementwise operation over an input of its shape that nobody needs afterwards. */
static bool over_input(planning *p, uint32_t node, uint32_t now) {
    const lg_graph_node *n = &p->g.node[node];
    if (n->op->element == NULL) return false;
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE || (n->op->over_first && k > 0)) continue;
        if (!lg_same_shape(&p->g.node[n->in[k]].shape, &n->shape) || meets_another(p, n, k)) continue;
        item *from = &p->item[p->item[n->in[k]].base];
        if (from->place.area != LG_AREA_WORK || from->last != now || from->lasting ||
            p->g.node[p->item[n->in[k]].base].count != n->count)
            continue;
        p->item[node].place = from->place;
        from->lasting = true; /* the place lives on under another name */
        return true;
    }
    return false;
}

static void give_place(planning *p, uint32_t node, uint32_t now) {
    item *it = &p->item[node];
    if (it->place.area == LG_AREA_OUTPUT)
        p->plan->spill[it->place.number] = give_room(p, p->g.node[node].count);
    if (it->place.area != LG_AREA_NONE || over_input(p, node, now)) return;
    it->place = (lg_place){LG_AREA_WORK, 0, give_room(p, p->g.node[node].count)};
}

static void end_lives(planning *p, const uint32_t *ending, size_t count) {
    for (size_t i = 0; i < count; i++) {
        const item *it = &p->item[ending[i]];
        if (it->place.area == LG_AREA_WORK && !it->lasting)
            take_back(p, it->place.offset, p->g.node[ending[i]].count);
    }
}

/* ---- order ---- */

/* A step is a node, or a run of scalar code: order[first..first + count - 1]. */
typedef struct stretch {
    uint32_t first, count;
    bool code;
} stretch;

/* The earliest phase after those of the inputs; a phase may follow upon itself. */
static uint32_t phase_of(const planning *p, uint32_t node) {
    const lg_graph_node *n = &p->g.node[node];
    const uint32_t odd = p->item[node].fate == CODE;
    uint32_t phase = odd;
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE) continue;
        const uint32_t before = p->item[n->in[k]].phase, after = before + (before % 2 != odd);
        if (after > phase) phase = after;
    }
    return phase;
}

static bool is_step(const planning *p, uint32_t node) {
    return p->item[node].fate == CODE || p->item[node].fate == TENSOR;
}

/* An elementwise step behind which two or more tensors end that are not needed elsewhere any more, such as an
 * activation's slope, takes less memory than they do: it stands behind the last node that it has to wait for,
 * which is returned. Others stand at their own place. `last`: the node that reads a node last. */
static uint32_t anchor_of(const planning *p, uint32_t node, const uint32_t *last, const uint32_t *before,
                          const uint32_t *anchor) {
    const lg_graph_node *n = &p->g.node[node];
    size_t freed = 0;
    uint32_t after = 0;
    if (p->item[node].fate != TENSOR || n->op->element == NULL) return node;
    for (uint32_t k = 0; k < n->inputs; k++) {
        if (n->in[k] == LG_GRAPH_NONE) continue;
        const uint32_t in = n->in[k], base = p->item[in].base;
        if (anchor[in] > after) after = anchor[in];
        if (in != base || p->item[in].fate != TENSOR || last[in] != node || p->item[in].uses < 2) continue;
        freed += p->g.node[in].count;
        if (anchor[before[in]] > after) after = anchor[before[in]];
    }
    return freed > n->count ? after : node;
}

/* The place of each node: anchors, and for each node the ones that stand behind it. */
static bool find_anchors(planning *p, uint32_t *anchor) {
    const uint32_t nodes = p->g.count;
    uint32_t *last = take(p, nodes, sizeof *last), *before = take(p, nodes, sizeof *before);
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

/* Everything that can be computed by tensors, then all scalar code that can, and so on: few long runs of it;
 * in a phase by anchors. `first`, zeros: 2 nodes + 2 of them. */
static size_t find_order(planning *p, uint32_t *first, uint32_t *order, stretch *stretches) {
    const uint32_t nodes = p->g.count;
    uint32_t *anchor = take(p, nodes, sizeof *anchor), *sorted = take(p, nodes, sizeof *sorted);
    uint32_t *behind = take(p, (size_t)nodes + 1, sizeof *behind);
    size_t count = 0;
    if (p->failed || !find_anchors(p, anchor)) return 0;
    for (uint32_t i = 0; i < nodes; i++) behind[anchor[i] + 1]++;
    for (uint32_t i = 0; i < nodes; i++) behind[i + 1] += behind[i];
    for (uint32_t i = 0; i < nodes; i++) sorted[behind[anchor[i]]++] = i;
    for (uint32_t i = 0; i < nodes; i++) {
        if (p->item[i].fate != GIVEN) p->item[i].phase = phase_of(p, i);
        if (is_step(p, i)) first[p->item[i].phase + 1]++;
    }
    for (uint32_t f = 0; f <= 2 * nodes; f++) first[f + 1] += first[f];
    const uint32_t placed = first[2 * nodes + 1];
    for (uint32_t i = 0; i < nodes; i++)
        if (is_step(p, sorted[i])) order[first[p->item[sorted[i]].phase]++] = sorted[i];
    for (uint32_t j = 0; j < placed; j++) {
        const item *it = &p->item[order[j]];
        if (it->fate == CODE && j > 0 && p->item[order[j - 1]].phase == it->phase)
            stretches[count - 1].count++;
        else
            stretches[count++] = (stretch){j, 1, it->fate == CODE};
    }
    return count;
}

/* When each node is made and read last; a product inside of a dense layer reads when the layer does. */
static void find_lives(planning *p, const uint32_t *order, const stretch *stretches, size_t count) {
    for (size_t s = 0; s < count; s++)
        for (uint32_t j = 0; j < stretches[s].count; j++) {
            const lg_graph_node *n = &p->g.node[order[stretches[s].first + j]];
            p->item[order[stretches[s].first + j]].made = (uint32_t)s;
            for (uint32_t k = 0; k < n->inputs; k++) {
                if (n->in[k] == LG_GRAPH_NONE) continue;
                const lg_graph_node *from = &p->g.node[n->in[k]];
                p->item[p->item[n->in[k]].base].last = (uint32_t)s;
                for (uint32_t l = 0; p->item[n->in[k]].fate == FUSED && l < from->inputs; l++)
                    p->item[p->item[from->in[l]].base].last = (uint32_t)s;
            }
        }
}

/* ---- steps ---- */

static lg_plan_step *new_step(planning *p, lg_plan_step_kind kind) {
    lg_plan *plan = p->plan;
    if (plan->steps == p->capacity) {
        const size_t capacity = p->capacity == 0 ? 16 : 2 * p->capacity;
        lg_plan_step *grown = keep(p, capacity, sizeof *grown);
        if (grown == NULL) return NULL;
        if (plan->steps > 0) memcpy(grown, plan->step, plan->steps * sizeof *grown);
        plan->step = grown;
        p->capacity = capacity;
    }
    lg_plan_step *step = &plan->step[plan->steps++];
    *step = (lg_plan_step){.kind = kind};
    return step;
}

/* The transpose of a constant that products go through faster. */
static lg_place transposed(planning *p, const lg_graph_node *n, lg_evaluation *e) {
    const lg_place none = {LG_AREA_NONE, 0, 0};
    const lg_op *op = n->op;
    if (op->transpose == NULL || n->in[1] == LG_GRAPH_NONE) return none;
    const lg_graph_node *from = &p->g.node[n->in[1]];
    if (from->sort != LG_GRAPH_CONSTANT || op->transpose(e) == LG_TRANSPOSE_NONE) return none;
    const lg_shape *s = &from->shape;
    const size_t columns = s->dims[s->rank - 1], rows = columns == 0 ? 0 : from->count / columns;
    double *made = take(p, from->count, sizeof *made);
    if (made == NULL) return none;
    lg_kernels_for(LG_F64)->transpose(rows, columns, from->value, made);
    e->transposed = made;
    return add_constant(p, made, from->count);
}

static lg_status keep_payload(planning *p, const lg_graph_node *n, lg_attr *attr) {
    const lg_payload kind = n->op->payload;
    const size_t bytes = kind == LG_PAYLOAD_REALS     ? n->inputs * sizeof(double)
                         : kind == LG_PAYLOAD_INDICES ? n->attr.i[0] * sizeof(uint32_t)
                                                      : 0;
    if (bytes == 0) return LG_OK;
    void *kept = keep(p, bytes, 1);
    if (kept == NULL) return LG_OUT_OF_MEMORY;
    memcpy(kept, attr->pointer, bytes);
    attr->pointer = kept;
    return LG_OK;
}

static lg_status add_tensor(planning *p, uint32_t node, uint32_t now) {
    const lg_graph_node *n = &p->g.node[node];
    const lg_shape *shapes[LG_MAX_INPUTS];
    lg_plan_step *step = new_step(p, LG_STEP_TENSOR);
    if (step == NULL) return LG_OUT_OF_MEMORY;
    lg_tensor_step made = {
        .op = n->op, .attr = n->attr, .inputs = n->inputs, .shape = n->shape, .count = n->count};
    lg_shape *own = keep(p, n->inputs + 1, sizeof *own);
    made.shapes = keep(p, n->inputs + 1, sizeof *made.shapes);
    made.x = keep(p, n->inputs + 1, sizeof *made.x);
    if (p->failed || keep_payload(p, n, &made.attr) != LG_OK) return LG_OUT_OF_MEMORY;
    lg_graph_shapes(&p->g, n, shapes);
    for (uint32_t k = 0; k < n->inputs; k++) {
        own[k] = *shapes[k];
        made.shapes[k] = &own[k];
        made.x[k] = n->in[k] == LG_GRAPH_NONE ? (lg_place){LG_AREA_NONE, 0, 0} : place_of(p, n->in[k]);
    }
    lg_evaluation e = {.k = p->plan->k,
                       .attr = &made.attr,
                       .inputs = n->inputs,
                       .in = shapes,
                       .shape = &n->shape,
                       .count = n->count};
    made.transposed = transposed(p, n, &e);
    give_place(p, node, now);
    made.y = p->item[node].place;
    made.scratch_count = n->op->scratch != NULL ? n->op->scratch(&e) / p->plan->k->size + 1 : 0;
    made.scratch = (lg_place){LG_AREA_WORK, 0, give_room(p, made.scratch_count)};
    take_back(p, made.scratch.offset, made.scratch_count);
    step->tensor = made;
    return p->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

static lg_status add_dense(planning *p, uint32_t node) {
    const lg_graph_node *n = &p->g.node[node], *product = &p->g.node[n->in[0]];
    lg_plan_step *step = new_step(p, LG_STEP_DENSE);
    if (step == NULL) return LG_OUT_OF_MEMORY;
    lg_dense_step made = {.m = n->shape.dims[0],
                          .k = p->g.node[product->in[0]].shape.dims[1],
                          .n = n->shape.dims[1],
                          .x = place_of(p, product->in[0]),
                          .w = place_of(p, product->in[1]),
                          .b = {LG_AREA_NONE, 0, 0},
                          .kind = (lg_activation)n->attr.i[0]};
    if (product->inputs > 2) made.b = place_of(p, product->in[2]);
    give_place(p, node, UINT32_MAX);
    made.y = p->item[node].place;
    step->dense = made;
    return p->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

/* A node of the run whose numbers are needed in memory: by a later step, or as an output. */
static bool goes_out(const planning *p, uint32_t node, uint32_t now) {
    return p->item[node].last > now || p->item[node].lasting;
}

static lg_status add_code(planning *p, const uint32_t *nodes, uint32_t count, uint32_t now) {
    lg_code code;
    lg_plan_step *step = new_step(p, LG_STEP_SCALARS);
    uint32_t *stored = take(p, count, sizeof *stored), outs = 0;
    if (step == NULL || stored == NULL) return LG_OUT_OF_MEMORY;
    lg_status status = LG_OK;
    lg_code_begin(&code, &p->temporary, &p->g, p->code_value);
    code.exchange = p->exchange;
    for (uint32_t j = 0; status == LG_OK && j < count; j++) status = lg_code_add(&code, nodes[j]);
    for (uint32_t j = 0; status == LG_OK && j < count; j++) {
        if (!goes_out(p, nodes[j], now)) continue;
        give_place(p, nodes[j], UINT32_MAX);
        stored[outs++] = nodes[j];
    }
    if (status == LG_OK)
        status =
            lg_code_finish(&code, &p->plan->memory, p->plan->k, stored, outs, code_place, p, &step->scalars);
    lg_code_end(&code, nodes, count);
    LG_TRY(status);
    const size_t registers = step->scalars.constants + step->scalars.loads + step->scalars.instructions;
    step->scalars.registers = (lg_place){LG_AREA_WORK, 0, give_room(p, registers)};
    take_back(p, step->scalars.registers.offset, registers);
    return p->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

static lg_status add_step(planning *p, const uint32_t *order, const stretch *s, uint32_t now) {
    const uint32_t node = order[s->first];
    const lg_graph_node *n = &p->g.node[node];
    if (s->code) return add_code(p, order + s->first, s->count, now);
    const bool dense = n->op->ends_layer && n->in[0] != LG_GRAPH_NONE && p->item[n->in[0]].fate == FUSED;
    return dense ? add_dense(p, node) : add_tensor(p, node, now);
}

/* An output is written where it belongs by the step that makes it, unless it is a view, given, or twice one.
 * That step and others need a place when nobody wants it. */
static void place_outputs(planning *p) {
    for (size_t j = 0; j < p->plan->outputs; j++) {
        item *it = &p->item[p->g.result[j]];
        p->item[it->base].lasting = true;
        p->plan->spill[j] = LG_NO_SPILL;
        if ((it->fate != CODE && it->fate != TENSOR) || it->place.area != LG_AREA_NONE) continue;
        it->place = (lg_place){LG_AREA_OUTPUT, (uint32_t)j, 0};
    }
}

static lg_status copy_outputs(planning *p) {
    for (size_t j = 0; j < p->plan->outputs; j++) {
        const uint32_t node = p->g.result[j];
        const lg_place from = place_of(p, node);
        if (from.area == LG_AREA_OUTPUT && from.number == j) continue;
        lg_plan_step *step = new_step(p, LG_STEP_COPY);
        if (step == NULL) return LG_OUT_OF_MEMORY;
        step->copy = (lg_copy_step){from, {LG_AREA_OUTPUT, (uint32_t)j, 0}, p->g.node[node].count};
    }
    return LG_OK;
}

/* Nodes by the step that reads them last: those of step s are ending[first[s + 1] .. first[s + 2] - 1]. */
static void sort_endings(const planning *p, size_t steps, uint32_t *ending, uint32_t *first) {
    for (uint32_t i = 0; i < p->g.count; i++)
        if (is_step(p, i)) first[p->item[i].last + 1]++;
    for (size_t s = 0; s <= steps; s++) first[s + 1] += first[s];
    for (uint32_t i = p->g.count; i-- > 0;)
        if (is_step(p, i)) ending[--first[p->item[i].last + 1]] = i;
}

static lg_status add_steps(planning *p) {
    const uint32_t nodes = p->g.count;
    uint32_t *order = take(p, nodes, sizeof *order), *ending = take(p, nodes, sizeof *ending);
    uint32_t *phases = take(p, 2 * (size_t)nodes + 2, sizeof *phases);
    stretch *stretches = take(p, nodes, sizeof *stretches);
    p->code_value = take(p, nodes, sizeof *p->code_value);
    if (p->failed) return LG_OUT_OF_MEMORY;
    const size_t count = find_order(p, phases, order, stretches);
    if (p->failed) return LG_OUT_OF_MEMORY;
    uint32_t *first = take(p, count + 2, sizeof *first);
    if (first == NULL) return LG_OUT_OF_MEMORY;
    find_lives(p, order, stretches, count);
    place_outputs(p);
    sort_endings(p, count, ending, first);
    for (size_t s = 0; s < count; s++) {
        LG_TRY(add_step(p, order, &stretches[s], (uint32_t)s));
        end_lives(p, ending + first[s + 1], first[s + 2] - first[s + 1]);
    }
    return copy_outputs(p);
}

/* ---- depth ---- */

static size_t bits(size_t n) {
    size_t b = 0;
    for (; n > 1; n = (n + 1) / 2) b++;
    return b;
}

/* What an operation adds to the longest path: 1, and log2 of the terms of its longest sum. */
static size_t own_depth(const lg_graph *g, const lg_graph_node *n) {
    const lg_shape *shapes[LG_MAX_INPUTS];
    if (n->op == &lg_op_call) return ((const lg_plan *)n->attr.pointer)->depth;
    if (n->op->terms == NULL) return 1;
    lg_graph_shapes(g, n, shapes);
    const size_t terms = n->op->terms(shapes, &n->attr, &n->shape);
    return terms > 0 ? 1 + bits(terms) : 0;
}

static lg_status find_depth(planning *p) {
    size_t *depth = take(p, p->g.count, sizeof *depth);
    if (depth == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < p->g.count; i++) {
        const lg_graph_node *n = &p->g.node[i];
        for (uint32_t k = 0; k < n->inputs; k++)
            if (n->in[k] != LG_GRAPH_NONE && depth[n->in[k]] > depth[i]) depth[i] = depth[n->in[k]];
        if (n->sort == LG_GRAPH_OPERATION) {
            depth[i] += own_depth(&p->g, n);
            p->plan->work +=
                n->op == &lg_op_call ? ((const lg_plan *)n->attr.pointer)->work : lg_graph_work(&p->g, n);
        }
        if (depth[i] > p->plan->depth) p->plan->depth = depth[i];
    }
    return LG_OK;
}

/* ---- calls and loops ---- */

/* A plan of what is called: the caller looks for numbers that are not finite. */
static lg_status plan_callee(planning *p, const lg_program *program, size_t function,
                             const lg_plan_options *options, lg_plan **out) {
    lg_plan_options inner = *options;
    inner.mark_unfit = false;
    return lg_plan_create(program, function, &inner, out, p->error);
}

/* One plan for all calls of a function. */
static lg_status plan_calls(planning *p, const lg_program *program, const lg_plan_options *options) {
    lg_plan *plan = p->plan;
    for (uint32_t i = 0; i < p->g.count; i++) {
        lg_graph_node *n = &p->g.node[i];
        if (n->op != &lg_op_call) continue;
        if (plan->callee == NULL) {
            plan->callee = keep(p, program->functions, sizeof *plan->callee);
            if (p->failed) return LG_OUT_OF_MEMORY;
            plan->callees = program->functions;
        }
        lg_plan **callee = &plan->callee[n->attr.i[0]];
        if (*callee == NULL) LG_TRY(plan_callee(p, program, n->attr.i[0], options, callee));
        n->attr.pointer = *callee;
    }
    return LG_OK;
}

static lg_status plan_loop(planning *p, const lg_program *program, const lg_function *f,
                           const lg_plan_options *options) {
    lg_plan *plan = p->plan, *callee;
    for (size_t j = 0; j < plan->outputs; j++) plan->spill[j] = LG_NO_SPILL; /* the callee has its own */
    LG_TRY(plan_callee(p, program, f->callee, options, &callee));
    lg_plan_step *step = new_step(p, LG_STEP_CALL);
    if (step == NULL) {
        lg_plan_destroy(callee);
        return LG_OUT_OF_MEMORY;
    }
    step->call = (lg_call_step){.callee = callee, .times = f->times};
    uint32_t *carry = keep(p, f->inputs, sizeof *carry);
    step->call.next = keep(p, f->inputs, sizeof *step->call.next);
    if (p->failed) return LG_OUT_OF_MEMORY;
    memcpy(carry, f->carry, f->inputs * sizeof *carry);
    step->call.carry = carry;
    for (size_t i = 0; i < f->inputs; i++)
        if (carry[i] != UINT32_MAX)
            step->call.next[i] =
                (lg_place){LG_AREA_WORK, 0, give_room(p, 2 * ((plan->input_count[i] + 15) / 16 * 16))};
    step->call.work = (lg_place){
        LG_AREA_WORK, 0, give_room(p, (lg_plan_work_size(callee) + plan->k->size - 1) / plan->k->size)};
    plan->depth = callee->depth * f->times;
    plan->work = callee->work * f->times;
    return LG_OK;
}

/* ---- a plan ---- */

void lg_plan_options_init(lg_plan_options *options) {
    *options = (lg_plan_options){
        .size = sizeof *options, .rows = 1, .dtype = LG_F64, .max_size = (size_t)1 << 30, .most_work = 1e13};
}

static lg_status count_ports(planning *p, const lg_function *f, size_t rows) {
    lg_plan *plan = p->plan;
    const size_t length = strlen(f->name) + 1;
    char *name = keep(p, length, 1);
    plan->inputs = f->inputs;
    plan->outputs = f->outputs;
    plan->input_count = keep(p, f->inputs, sizeof *plan->input_count);
    plan->output_count = keep(p, f->outputs, sizeof *plan->output_count);
    plan->spill = keep(p, f->outputs, sizeof *plan->spill);
    if (p->failed) return LG_OUT_OF_MEMORY;
    memcpy(name, f->name, length);
    plan->name = name;
    for (size_t i = 0; i < f->inputs; i++)
        plan->input_count[i] = lg_shape_count(lg_port_shape(&f->input[i], rows));
    for (size_t j = 0; j < f->outputs; j++) {
        plan->output_count[j] = lg_shape_count(lg_port_shape(&f->output[j], rows));
    }
    return LG_OK;
}

static lg_status plan_nodes(planning *p, const lg_program *program, const lg_function *f,
                            const lg_plan_options *options) {
    LG_TRY(lg_graph_make(&p->temporary, program, f, options, &p->g, p->error));
    p->item = take(p, p->g.count, sizeof *p->item);
    if (p->failed) return LG_OUT_OF_MEMORY;
    LG_TRY(plan_calls(p, program, options));
    find_fates(p);
    LG_TRY(add_steps(p));
    LG_TRY(find_depth(p));
    return fill_constants(p);
}

static lg_status make(planning *p, const lg_program *program, const lg_function *f,
                      const lg_plan_options *options) {
    p->plan->k = lg_kernels_for(options->dtype);
    p->plan->rows = options->rows;
    p->plan->mark_unfit = options->mark_unfit;
    LG_TRY(count_ports(p, f, options->rows));
    LG_TRY(f->times > 0 ? plan_loop(p, program, f, options) : plan_nodes(p, program, f, options));
    if (p->plan->work_count * p->plan->k->size > options->max_size)
        return lg_fail(p->error, LG_OUT_OF_MEMORY,
                       "function '%s' needs %zu bytes of work memory, more than %zu", f->name,
                       p->plan->work_count * p->plan->k->size, options->max_size);
    if (p->plan->work > options->most_work)
        return lg_fail(p->error, LG_UNSUPPORTED, "function '%s' takes about %.2g operations, more than %.2g",
                       f->name, p->plan->work, options->most_work);
    return LG_OK;
}

lg_status lg_plan_create(const lg_program *program, size_t function, const lg_plan_options *options,
                         lg_plan **out, lg_error *error) {
    lg_plan_options chosen;
    lg_error ignored;
    lg_plan_options_init(&chosen);
    if (error == NULL) error = &ignored;
    error->message[0] = '\0';
    if (options != NULL) {
        if (options->size != sizeof *options)
            return lg_fail(error, LG_INVALID_ARGUMENT, "options of another version");
        chosen = *options;
    }
    if (chosen.rows < 1 || chosen.rows > (size_t)1 << 31 ||
        (chosen.dtype != LG_F64 && chosen.dtype != LG_F32))
        return lg_fail(error, LG_INVALID_ARGUMENT, "a plan has at least one row and a type");
    if (function >= program->functions) return lg_fail(error, LG_NOT_FOUND, "there is no such function");
    const lg_function *f = &program->function[function];
    lg_plan *plan = lg_alloc(program->context, 1, sizeof *plan);
    if (plan == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a plan of '%s'", f->name);
    plan->context = program->context;
    plan->memory = (lg_heap){.context = program->context, .most = chosen.max_size};
    planning p = {.plan = plan,
                  .temporary = {.context = program->context,
                                .most = chosen.max_size < SIZE_MAX / 4 ? 4 * chosen.max_size : 0},
                  .compact = chosen.compact,
                  .packed = chosen.packed,
                  .exchange = program->exchange,
                  .error = error};
    lg_status status = make(&p, program, f, &chosen);
    lg_heap_destroy(&p.temporary);
    if (status == LG_OK) {
        *out = plan;
        return LG_OK;
    }
    lg_plan_destroy(plan);
    if (error->message[0] == '\0')
        (void)lg_fail(error, status, "function '%s' with %zu rows: %s", f->name, chosen.rows,
                      lg_status_sentence(status));
    return status;
}

void lg_plan_destroy(lg_plan *plan) {
    if (plan == NULL) return;
    for (size_t s = 0; s < plan->steps; s++)
        if (plan->step[s].kind == LG_STEP_CALL) lg_plan_destroy(plan->step[s].call.callee);
    for (size_t i = 0; i < plan->callees; i++) lg_plan_destroy(plan->callee[i]);
    lg_heap_destroy(&plan->memory);
    lg_free(plan->context, plan);
}

size_t lg_plan_work_size(const lg_plan *plan) {
    return (plan->work_count * plan->k->size + LG_ALIGNMENT) & ~(size_t)(LG_ALIGNMENT - 1);
}

size_t lg_plan_input_count(const lg_plan *plan, size_t input) {
    return input < plan->inputs ? plan->input_count[input] : 0;
}

size_t lg_plan_output_count(const lg_plan *plan, size_t output) {
    return output < plan->outputs ? plan->output_count[output] : 0;
}

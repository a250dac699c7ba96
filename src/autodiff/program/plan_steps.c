/* Makes the steps of a plan. */
#include "autodiff/program/plan_make.h"

#include <string.h>

#include "autodiff/program/plan_code.h"
#include "kernels/product.h"

lg_plan_step *lg_planning_new_step(lg_planning *p, lg_plan_step_kind kind) {
    lg_plan *plan = p->plan;
    if (plan->steps == p->step_capacity) {
        const size_t capacity = p->step_capacity == 0 ? 16 : 2 * p->step_capacity;
        lg_plan_step *grown = lg_planning_keep(p, capacity, sizeof *grown);
        if (grown == NULL) return NULL;
        if (plan->steps > 0) memcpy(grown, plan->step, plan->steps * sizeof *grown);
        plan->step = grown;
        p->step_capacity = capacity;
    }
    lg_plan_step *step = &plan->step[plan->steps++];
    *step = (lg_plan_step){.kind = kind};
    return step;
}

/* Adds the transpose of a constant to the plan's constants if it makes the product faster. */
static lg_place transposed(lg_planning *p, const lg_graph_node *n, lg_evaluation *e) {
    const lg_place none = {LG_AREA_NONE, 0, 0};
    const lg_op *op = n->op;
    if (op->transpose == NULL || n->in[1] == LG_GRAPH_NONE) return none;
    const lg_graph_node *from = &p->g.node[n->in[1]];
    if (from->sort != LG_GRAPH_CONSTANT || op->transpose(e) == LG_TRANSPOSE_NONE) return none;
    const lg_shape *s = &from->shape;
    const size_t columns = s->dims[s->rank - 1], rows = columns == 0 ? 0 : from->count / columns;
    double *made = lg_planning_take(p, from->count, sizeof *made);
    if (made == NULL) return none;
    lg_kernels_for(LG_F64)->transpose(rows, columns, from->value, made);
    e->transposed = made;
    return lg_planning_add_constant(p, made, from->count);
}

static lg_status keep_payload(lg_planning *p, const lg_graph_node *n, lg_attr *attr) {
    const lg_payload kind = n->op->payload;
    const size_t bytes = kind == LG_PAYLOAD_REALS     ? n->inputs * sizeof(double)
                         : kind == LG_PAYLOAD_INDICES ? n->attr.i[0] * sizeof(uint32_t)
                                                      : 0;
    if (bytes == 0) return LG_OK;
    void *kept = lg_planning_keep(p, bytes, 1);
    if (kept == NULL) return LG_OUT_OF_MEMORY;
    memcpy(kept, attr->pointer, bytes);
    attr->pointer = kept;
    return LG_OK;
}

/* The operation of a tensor step. A sum with a product is the product with the other term as third input
 * `in`. */
static lg_graph_node operation_of(const lg_planning *p, uint32_t node, uint32_t *in) {
    const lg_graph_node *n = &p->g.node[node];
    const uint32_t product = p->item[node].product;
    if (product == LG_GRAPH_NONE) return *n;
    lg_graph_node made = p->g.node[product];
    in[0] = made.in[0];
    in[1] = made.in[1];
    in[2] = n->in[n->in[0] == product];
    made.in = in;
    made.inputs = 3;
    return made;
}

static lg_status add_tensor(lg_planning *p, uint32_t node, uint32_t now) {
    uint32_t in[3];
    const lg_graph_node operation = operation_of(p, node, in), *n = &operation;
    const lg_shape *shapes[LG_MAX_INPUTS];
    lg_plan_step *step = lg_planning_new_step(p, LG_STEP_TENSOR);
    if (step == NULL) return LG_OUT_OF_MEMORY;
    lg_tensor_step made = {
        .op = n->op, .attr = n->attr, .inputs = n->inputs, .shape = n->shape, .count = n->count};
    lg_shape *own = lg_planning_keep(p, n->inputs + 1, sizeof *own);
    made.shapes = lg_planning_keep(p, n->inputs + 1, sizeof *made.shapes);
    made.x = lg_planning_keep(p, n->inputs + 1, sizeof *made.x);
    if (p->failed || keep_payload(p, n, &made.attr) != LG_OK) return LG_OUT_OF_MEMORY;
    lg_graph_shapes(&p->g, n, shapes);
    for (uint32_t k = 0; k < n->inputs; k++) {
        own[k] = *shapes[k];
        made.shapes[k] = &own[k];
        made.x[k] =
            n->in[k] == LG_GRAPH_NONE ? (lg_place){LG_AREA_NONE, 0, 0} : lg_planning_place(p, n->in[k]);
    }
    lg_evaluation e = {.k = p->plan->k,
                       .attr = &made.attr,
                       .inputs = n->inputs,
                       .in = shapes,
                       .shape = &n->shape,
                       .count = n->count};
    made.transposed = transposed(p, n, &e);
    lg_planning_give_place(p, node, p->item[node].product == LG_GRAPH_NONE ? now : UINT32_MAX);
    made.y = p->item[node].place;
    made.scratch_count = n->op->scratch != NULL ? n->op->scratch(&e) / p->plan->k->size + 1 : 0;
    made.scratch = (lg_place){LG_AREA_WORK, 0, lg_planning_give_room(p, made.scratch_count)};
    lg_planning_take_back(p, made.scratch.offset, made.scratch_count);
    step->tensor = made;
    return p->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

static lg_status add_dense(lg_planning *p, uint32_t node) {
    const lg_graph_node *n = &p->g.node[node], *product = &p->g.node[n->in[0]];
    lg_plan_step *step = lg_planning_new_step(p, LG_STEP_DENSE);
    if (step == NULL) return LG_OUT_OF_MEMORY;
    lg_dense_step made = {.m = n->shape.dims[0],
                          .k = p->g.node[product->in[0]].shape.dims[1],
                          .n = n->shape.dims[1],
                          .x = lg_planning_place(p, product->in[0]),
                          .w = lg_planning_place(p, product->in[1]),
                          .b = {LG_AREA_NONE, 0, 0},
                          .kind = (lg_activation)n->attr.i[0]};
    if (product->inputs > 2) made.b = lg_planning_place(p, product->in[2]);
    lg_planning_give_place(p, node, UINT32_MAX);
    made.y = p->item[node].place;
    step->dense = made;
    return p->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

static lg_status add_copy(lg_planning *p, lg_place from, lg_place to, size_t count) {
    lg_plan_step *step = lg_planning_new_step(p, LG_STEP_COPY);
    if (step == NULL) return LG_OUT_OF_MEMORY;
    step->copy = (lg_copy_step){from, to, count};
    return LG_OK;
}

/* Copies the parts of a concatenation that do not lie in its memory. */
static lg_status add_parts(lg_planning *p, uint32_t node) {
    const lg_graph_node *n = &p->g.node[node];
    lg_planning_give_place(p, node, UINT32_MAX);
    lg_place to = p->item[node].place;
    for (uint32_t k = 0; k < n->inputs; k++) {
        const lg_place from = lg_planning_place(p, n->in[k]);
        const size_t count = p->g.node[n->in[k]].count;
        if (!lg_same_place(&from, &to)) LG_TRY(add_copy(p, from, to, count));
        to.offset += count;
    }
    return p->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

/* Whether the values of a node in a run of scalar code must be stored: a later step reads them, or they are
 * an output. */
static bool goes_out(const lg_planning *p, uint32_t node, uint32_t now) {
    return p->item[node].last > now || p->item[node].lasting;
}

static lg_place code_place(void *user, uint32_t node) {
    return lg_planning_place(user, node);
}

/* `value` is the argument of lg_code_begin. */
static lg_status add_code(lg_planning *p, const uint32_t *nodes, uint32_t count, uint32_t now,
                          lg_scalar **value) {
    lg_code code;
    lg_plan_step *step = lg_planning_new_step(p, LG_STEP_SCALARS);
    uint32_t *stored = lg_planning_take(p, count, sizeof *stored), outs = 0;
    if (step == NULL || stored == NULL) return LG_OUT_OF_MEMORY;
    lg_status status = LG_OK;
    lg_code_begin(&code, &p->temporary, &p->g, value);
    code.exchange = p->exchange;
    for (uint32_t j = 0; status == LG_OK && j < count; j++) status = lg_code_add(&code, nodes[j]);
    for (uint32_t j = 0; status == LG_OK && j < count; j++) {
        if (!goes_out(p, nodes[j], now)) continue;
        lg_planning_give_place(p, nodes[j], UINT32_MAX);
        stored[outs++] = nodes[j];
    }
    if (status == LG_OK)
        status =
            lg_code_finish(&code, &p->plan->memory, p->plan->k, stored, outs, code_place, p, &step->scalars);
    lg_code_end(&code, nodes, count);
    LG_TRY(status);
    const size_t each = step->scalars.rows > 1 ? LG_K_ROWS : 1;
    const size_t registers =
        each * ((size_t)step->scalars.constants + step->scalars.loads + step->scalars.instructions);
    step->scalars.registers = (lg_place){LG_AREA_WORK, 0, lg_planning_give_room(p, registers)};
    lg_planning_take_back(p, step->scalars.registers.offset, registers);
    return p->failed ? LG_OUT_OF_MEMORY : LG_OK;
}

static lg_status add_step(lg_planning *p, const uint32_t *order, const lg_plan_run *run, uint32_t now,
                          lg_scalar **value) {
    const uint32_t node = order[run->first];
    const lg_graph_node *n = &p->g.node[node];
    if (run->code) return add_code(p, order + run->first, run->count, now, value);
    const bool dense =
        n->op->ends_layer && n->in[0] != LG_GRAPH_NONE && p->item[n->in[0]].fate == LG_FATE_FUSED;
    if (dense) return add_dense(p, node);
    return lg_planning_joins(p, node) ? add_parts(p, node) : add_tensor(p, node, now);
}

static lg_status copy_outputs(lg_planning *p) {
    for (size_t j = 0; j < p->plan->outputs; j++) {
        const uint32_t node = p->g.result[j];
        const lg_place from = lg_planning_place(p, node);
        if (from.area == LG_AREA_OUTPUT && from.number == j) continue;
        LG_TRY(add_copy(p, from, (lg_place){LG_AREA_OUTPUT, (uint32_t)j, 0}, p->g.node[node].count));
    }
    return LG_OK;
}

lg_status lg_planning_add_steps(lg_planning *p) {
    lg_plan_order o;
    lg_scalar **value = lg_planning_take(p, p->g.count, sizeof *value);
    if (value == NULL) return LG_OUT_OF_MEMORY;
    LG_TRY(lg_planning_find_order(p, &o));
    lg_planning_place_outputs(p);
    for (size_t s = 0; s < o.steps; s++) {
        LG_TRY(add_step(p, o.node, &o.run[s], (uint32_t)s, value));
        lg_planning_end_lives(p, o.ending + o.end[s + 1], o.end[s + 2] - o.end[s + 1]);
    }
    return copy_outputs(p);
}

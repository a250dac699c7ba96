/* Planted errors in finished plans: one step of a plan is changed. */
#include "gradcheck/cases.h"
#include "autodiff/ops/op_rows.h"
#include <string.h>

#include "autodiff/program/plan.h"

#define PLANTED (1.0 / 1024.0)

/* ---- LG_PLANT_OPERATION: another operation ---- */

static const lg_op *other_operation(const lg_op *op) {
    static const lg_op *const pairs[][2] = {
        {&lg_op_add, &lg_op_sub},   {&lg_op_sub, &lg_op_add},     {&lg_op_mul, &lg_op_add},
        {&lg_op_div, &lg_op_mul},   {&lg_op_max, &lg_op_add},     {&lg_op_sin, &lg_op_cos},
        {&lg_op_cos, &lg_op_sin},   {&lg_op_exp, &lg_op_sin},     {&lg_op_log, &lg_op_exp},
        {&lg_op_sqrt, &lg_op_exp},  {&lg_op_abs, &lg_op_sin},     {&lg_op_atan2, &lg_op_mul},
        {&lg_op_cross, &lg_op_add}, {&lg_op_scale, &lg_op_shift}, {&lg_op_shift, &lg_op_scale},
    };
    for (size_t i = 0; i < LG_COUNT(pairs); i++)
        if (pairs[i][0] == op) return pairs[i][1];
    return op;
}

static uint32_t other_scalar(uint32_t op) {
    static const uint8_t pairs[][2] = {
        {LG_S_ADD, LG_S_SUB},      {LG_S_SUB, LG_S_ADD}, {LG_S_MUL, LG_S_ADD},   {LG_S_DIV, LG_S_MUL},
        {LG_S_NEG, LG_S_SIN},      {LG_S_MAX, LG_S_ADD}, {LG_S_SQRT, LG_S_EXP},  {LG_S_EXP, LG_S_SIN},
        {LG_S_LOG, LG_S_EXP},      {LG_S_SIN, LG_S_COS}, {LG_S_COS, LG_S_SIN},   {LG_S_TANH, LG_S_SIGMOID},
        {LG_S_SIGMOID, LG_S_TANH}, {LG_S_ABS, LG_S_SIN}, {LG_S_ATAN2, LG_S_MUL},
    };
    for (size_t i = 0; i < LG_COUNT(pairs); i++)
        if (pairs[i][0] == op) return pairs[i][1];
    return op;
}

static bool operation(lg_plan_step *s) {
    switch (s->kind) {
    case LG_STEP_TENSOR: {
        const lg_op *op = s->tensor.op, *other = other_operation(op);
        s->tensor.op = other;
        return other != op;
    }
    case LG_STEP_DENSE:
        s->dense.kind = s->dense.kind == LG_TANH ? LG_SINE : LG_TANH;
        return true;
    case LG_STEP_SCALARS:
        for (uint32_t g = s->scalars.groups; g-- > 0;) {
            const uint32_t op = s->scalars.group[g].op;
            s->scalars.group[g].op = other_scalar(op);
            if (s->scalars.group[g].op != op) return true;
        }
        return false;
    case LG_STEP_COPY:
    case LG_STEP_CALL:
        break;
    }
    return false;
}

/* ---- LG_PLANT_OPERAND: another operand ---- */

/* A tensor step reads another input in place of one input; scalar code reads the next register or, if there
 * is none, the register before. */
static bool operand(lg_plan_step *s) {
    if (s->kind == LG_STEP_TENSOR)
        for (uint32_t a = 0; a < s->tensor.inputs; a++)
            for (uint32_t b = 0; b < s->tensor.inputs; b++)
                if (s->tensor.x[a].area != LG_AREA_NONE && s->tensor.x[b].area != LG_AREA_NONE &&
                    !lg_same_place(&s->tensor.x[a], &s->tensor.x[b]) &&
                    lg_shape_count(*s->tensor.shapes[a]) <= lg_shape_count(*s->tensor.shapes[b])) {
                    s->tensor.x[a] = s->tensor.x[b];
                    return true;
                }
    if (s->kind != LG_STEP_SCALARS || s->scalars.groups == 0) return false;
    const lg_scalar_group *last = &s->scalars.group[s->scalars.groups - 1];
    uint32_t *of = &s->scalars.operands[last->operands];
    if (last->result < 2) return false;
    *of = *of + 1 < last->result ? *of + 1 : *of - 1;
    return true;
}

/* ---- LG_PLANT_CONSTANT: other constants ---- */

static bool moved(lg_plan *plan, void *values, size_t count) {
    for (size_t at = 0; at < count; at++) {
        unsigned char *one = (unsigned char *)values + at * plan->k->size;
        plan->k->unary[LG_K_SCALE](1, 1.0 + PLANTED, one, one);
        plan->k->unary[LG_K_SHIFT](1, PLANTED, one, one);
    }
    return count > 0;
}

static bool constant(lg_plan *plan, lg_plan_step *s) {
    if (s->kind == LG_STEP_SCALARS) {
        const size_t count = s->scalars.constants;
        void *own = lg_heap_take(&plan->memory, count + 1, plan->k->size);
        if (own == NULL || count == 0) return false;
        memcpy(own, s->scalars.constant, count * plan->k->size);
        s->scalars.constant = own;
        return moved(plan, own, count);
    }
    bool reads = s->kind == LG_STEP_DENSE && s->dense.w.area == LG_AREA_CONSTANTS;
    for (uint32_t k = 0; s->kind == LG_STEP_TENSOR && k < s->tensor.inputs; k++)
        reads = reads || s->tensor.x[k].area == LG_AREA_CONSTANTS;
    return reads && moved(plan, plan->constants, plan->constant_count);
}

/* ---- LG_PLANT_CLOBBER: a place that is still needed is overwritten ---- */

/* Calls fn(user, place, written) for the operands and results of the step, but not for its work memory,
 * and for nothing in steps that are calls. */
typedef void (*place_fn)(void *user, lg_place *place, bool written);
static void each_place(lg_plan_step *s, place_fn fn, void *user) {
    switch (s->kind) {
    case LG_STEP_TENSOR:
        for (uint32_t k = 0; k < s->tensor.inputs; k++) fn(user, &s->tensor.x[k], false);
        fn(user, &s->tensor.y, true);
        break;
    case LG_STEP_DENSE:
        fn(user, &s->dense.x, false);
        fn(user, &s->dense.w, false);
        fn(user, &s->dense.b, false);
        fn(user, &s->dense.y, true);
        break;
    case LG_STEP_SCALARS:
        for (uint32_t i = 0; i < s->scalars.ins; i++) fn(user, &s->scalars.in[i].place, false);
        for (uint32_t i = 0; i < s->scalars.outs; i++) fn(user, &s->scalars.out[i].place, true);
        break;
    case LG_STEP_COPY:
        fn(user, &s->copy.x, false);
        fn(user, &s->copy.y, true);
        break;
    case LG_STEP_CALL:
        break;
    }
}

typedef struct moving {
    lg_place from, to;
    bool reads, writes, found;
    lg_place first; /* the first place in the work memory that the step writes */
} moving;

static void look(void *user, lg_place *place, bool written) {
    moving *m = user;
    if (written && place->area == LG_AREA_WORK && !m->found) {
        m->first = *place;
        m->found = true;
    }
    if (lg_same_place(place, &m->from)) *(written ? &m->writes : &m->reads) = true;
}

static lg_place moved_place(const lg_place *place, const moving *m) {
    return lg_same_place(place, &m->from) ? m->to : *place;
}

static void move_place(void *user, lg_place *place, bool written) {
    *place = moved_place(place, user);
}

static bool meet(lg_place a, size_t count_a, lg_place b, size_t count_b) {
    return a.area == LG_AREA_WORK && b.area == LG_AREA_WORK && a.offset < b.offset + count_b &&
           b.offset < a.offset + count_a;
}

/* Whether a step would read memory that it writes, after a place has moved. Its result would be undefined
 * then. */
static bool reads_its_result(const lg_plan_step *s, const moving *move) {
    bool found = false;
    if (s->kind == LG_STEP_TENSOR)
        for (uint32_t k = 0; k < s->tensor.inputs; k++)
            found = found || (!lg_same_place(&s->tensor.x[k], &s->tensor.y) &&
                              meet(moved_place(&s->tensor.y, move), s->tensor.count,
                                   moved_place(&s->tensor.x[k], move), lg_shape_count(*s->tensor.shapes[k])));
    if (s->kind == LG_STEP_DENSE)
        found = meet(moved_place(&s->dense.y, move), s->dense.m * s->dense.n, moved_place(&s->dense.x, move),
                     s->dense.m * s->dense.k);
    if (s->kind == LG_STEP_COPY)
        found =
            meet(moved_place(&s->copy.y, move), s->copy.count, moved_place(&s->copy.x, move), s->copy.count);
    return found;
}

/* Moves the step's result, and all later reads of it, to the place of an earlier result that a later step
 * still reads. */
static bool clobber(lg_plan *plan, size_t at) {
    moving made = {.from = {LG_AREA_NONE, 1, 0}};
    each_place(&plan->step[at], look, &made);
    if (!made.found) return false;
    for (size_t s = 0; s < at; s++) {
        moving victim = {.from = {LG_AREA_NONE, 1, 0}};
        each_place(&plan->step[s], look, &victim);
        if (!victim.found || lg_same_place(&victim.first, &made.first)) continue;
        moving later = {.from = victim.first};
        for (size_t t = at + 1; t < plan->steps && !later.writes; t++)
            each_place(&plan->step[t], look, &later);
        if (!later.reads) continue;
        moving all = {.from = made.first, .to = victim.first};
        bool defined = true;
        for (size_t t = at; t < plan->steps; t++)
            defined = defined && !reads_its_result(&plan->step[t], &all);
        if (!defined) continue;
        for (size_t t = at; t < plan->steps; t++) each_place(&plan->step[t], move_place, &all);
        return true;
    }
    return false;
}

/* ---- planting ---- */

static bool strike(lg_plan *plan, size_t at, lg_plant_mutation mutation) {
    lg_plan_step *s = &plan->step[at];
    switch (mutation) {
    case LG_PLANT_MISSING:
        *s = (lg_plan_step){.kind = LG_STEP_COPY};
        s->copy.x.area = s->copy.y.area = LG_AREA_WORK;
        return true;
    case LG_PLANT_OPERAND:
        return operand(s);
    case LG_PLANT_OPERATION:
        return operation(s);
    case LG_PLANT_CONSTANT:
        return constant(plan, s);
    case LG_PLANT_CLOBBER:
        return clobber(plan, at);
    default:
        return false;
    }
}

/* Tries the steps from the middle of the plan on, then from its start. A step in the middle has steps before
 * and after it. */
bool lg_plant_plan(lg_plant *plant, struct lg_plan *plan) {
    for (size_t i = 0; i < plan->steps; i++) {
        const size_t at = (plan->steps / 2 + i) % plan->steps;
        if (!strike(plan, at, plant->mutation)) continue;
        plant->input = (uint32_t)at;
        plant->applied++;
        return true;
    }
    return false;
}

/* Planted errors in operations: they change what the vjp or jvp of an operation returns, or its scalar
 * code. */
#include "gradcheck/cases.h"
#include "autodiff/ops/op_table.h"
#include "autodiff/program/scalars.h"

#include <string.h>

#define PLANTED_FACTOR (1.0 + 1.0 / 1024.0)

static bool same_numbers(const lg_tape *tape, lg_var a, lg_var b) {
    const lg_node *na = lg_node_at(tape, a), *nb = lg_node_at(tape, b);
    return memcmp(na->value, nb->value, na->count * tape->k->size) == 0;
}

static lg_var transposed(lg_tape *tape, lg_var v) {
    lg_shape shape = lg_node_at(tape, v)->shape;
    return shape.rank < 2 ? v : lg_reshape(tape, lg_transpose(tape, v), shape);
}

/* Returns the wrong value that replaces v; LG_NONE stands for zero. */
static lg_var mutated(lg_tape *tape, lg_plant *plant, lg_var v) {
    lg_var wrong = LG_NONE;
    plant->applied++;
    if (plant->mutation == LG_PLANT_SIGN) wrong = lg_neg(tape, v);
    if (plant->mutation == LG_PLANT_FACTOR) wrong = lg_scale(tape, v, PLANTED_FACTOR);
    if (plant->mutation == LG_PLANT_TRANSPOSE) wrong = transposed(tape, v);
    if (lg_is_none(wrong) || tape->status != LG_OK || !same_numbers(tape, v, wrong)) plant->changed++;
    return wrong;
}

static lg_plant *plant_of(const lg_op *row) {
    return ((const struct lg_planted_row *)row)->plant;
}

static void planted_vjp(lg_reverse *r) {
    lg_plant *plant = plant_of(r->op);
    const uint32_t k = plant->input;
    lg_reverse right = *r;
    right.op = plant->exchange.row;
    right.put_out = true;
    right.op->vjp(&right);
    if (k < r->inputs && r->need[k] && !lg_is_none(r->out[k]) && r->tape->status == LG_OK)
        r->out[k] = mutated(r->tape, plant, r->out[k]);
}

/* Calls the jvp as if the plant's input did not vary. */
static lg_var without_input(const lg_forward *f, lg_plant *plant) {
    lg_var kept[LG_MAX_INPUTS];
    bool any = false;
    for (uint32_t k = 0; k < f->inputs; k++) {
        kept[k] = k == plant->input ? LG_NONE : f->tangents[k];
        any = any || !lg_is_none(kept[k]);
        if (k == plant->input && !lg_is_none(f->tangents[k])) plant->applied = ++plant->changed;
    }
    lg_forward without = *f;
    without.tangents = kept;
    return any ? f->op->jvp(&without) : lg_zeros_like(f->tape, f->y);
}

static lg_var planted_jvp(const lg_forward *f) {
    lg_plant *plant = plant_of(f->op);
    lg_forward right = *f;
    right.op = plant->exchange.row;
    if (plant->mutation == LG_PLANT_DROP) return without_input(&right, plant);
    const lg_var v = right.op->jvp(&right);
    return f->tape->status == LG_OK && !lg_is_none(v) ? mutated(f->tape, plant, v) : v;
}

static void planted_scalars(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    lg_plant *plant = plant_of(s->row);
    if (!lg_scalars_expand(s, plant->exchange.row, e, x, y) || e->count == 0) return;
    const lg_scalar first = y[0];
    bool changed = false;
    for (size_t i = 0; i < e->count; i++) {
        const lg_scalar right = y[i];
        if (plant->mutation == LG_PLANT_SIGN) y[i] = lg_s_neg(s, right);
        if (plant->mutation == LG_PLANT_FACTOR) y[i] = lg_s_scale(s, PLANTED_FACTOR, right);
        if (plant->mutation == LG_PLANT_TRANSPOSE) y[i] = i + 1 < e->count ? y[i + 1] : first;
        if (plant->mutation == LG_PLANT_DROP && i + 1 == e->count) y[i] = lg_s_constant(s, 0.0);
        changed = changed || y[i] != right;
    }
    plant->applied++;
    plant->changed += changed;
}

lg_status lg_plant_open(lg_plant *plant, const lg_gradcheck_plant *chosen) {
    *plant = (lg_plant){.operation = chosen->operation,
                        .direction = chosen->direction,
                        .mutation = chosen->mutation,
                        .input = chosen->input};
    if (chosen->direction == LG_PLANT_PLAN) return LG_OK;
    const lg_op *row = lg_op_named(chosen->operation);
    if (row == NULL) return LG_INVALID_ARGUMENT;
    plant->wrong = (struct lg_planted_row){.row = *row, .plant = plant};
    plant->exchange = (lg_exchange){row, &plant->wrong.row};
    if (chosen->direction == LG_PLANT_VJP) plant->wrong.row.vjp = planted_vjp;
    if (chosen->direction == LG_PLANT_JVP) plant->wrong.row.jvp = planted_jvp;
    if (chosen->direction == LG_PLANT_SCALARS) {
        plant->wrong.row.element = NULL;
        plant->wrong.row.expand = planted_scalars;
    }
    return LG_OK;
}

const char *lg_plant_direction_name(lg_plant_direction direction) {
    static const char *const names[LG_PLANT_DIRECTIONS] = {"vjp", "jvp", "scalars", "plan"};
    return (unsigned)direction < LG_PLANT_DIRECTIONS ? names[direction] : "unknown";
}

const char *lg_plant_mutation_name(lg_plant_mutation mutation) {
    static const char *const names[LG_PLANT_MUTATIONS + LG_PLANT_PLAN_MUTATIONS] = {
        "sign", "drop", "factor", "transpose", "missing", "operand", "operation", "constant", "clobber"};
    return (unsigned)mutation < LG_COUNT(names) ? names[mutation] : "unknown";
}

/* Chooses instructions and registers for the interval evaluation of scalar code. */
#include <math.h>
#include <string.h>

#include "certify/interval.h"

#define DECLARE(NAME, name) extern lg_interval_run lg_intervals_##name;
DECLARE(BASELINE, baseline)
LG_FASTER_SETS(DECLARE)

lg_interval_run *lg_interval_kernel(lg_isa isa) {
#define ROW(NAME, name) [LG_ISA_##NAME] = lg_intervals_##name,
    static lg_interval_run *const table[LG_ISA_COUNT] = {ROW(BASELINE, baseline) LG_FASTER_SETS(ROW)};
    return lg_isa_is_here(isa) ? table[isa] : NULL;
}

lg_interval_value lg_interval_one(const lg_scalar_code *code, bool alike,
                                  const lg_interval_value operand[3]) {
    enum { IB = LG_INTERVAL_BLOCK };
    double registers[4 * 2 * IB];
    uint8_t flags[4 * IB];
    lg_interval_code one = {.op = (uint32_t)code->op, .n = code->n, .p = code->p, .y = 3};
    for (uint32_t k = 0; k < lg_scalar_instructions(code->op); k++) {
        one.x[k] = alike && k == 1 && code->in[1] == code->in[0] ? 0 : k;
        for (size_t i = 0; i < 2 * (size_t)IB; i++)
            registers[k * 2 * IB + i] = i < IB ? operand[k].low : operand[k].high;
        memset(flags + (size_t)k * IB, operand[k].level, IB);
    }
    lg_interval_kernel(lg_isa_in_use())(1, &one, registers, flags);
    return (lg_interval_value){registers[3 * 2 * IB], registers[3 * 2 * IB + IB], flags[3 * IB]};
}

typedef struct choosing {
    const lg_scalars *s;
    bool widen;
    uint8_t *live, *varies;
    /* Of an instruction that does not depend on inputs; its level is the highest where it is defined, as it
     * does not change. */
    lg_interval_value *value;
    uint32_t *uses; /* for each instruction: how many chosen instructions read it; results count once more */
    uint32_t *reg;  /* its register */
    uint32_t *idle; /* registers that are free again */
    uint32_t idle_count, top;
    lg_interval *to;
} choosing;

static uint32_t operands(const choosing *c, uint32_t i) {
    return lg_scalar_instructions(c->s->code[i].op);
}

static void mark(choosing *c, const lg_scalar *result, size_t count) {
    const lg_scalars *s = c->s;
    lg_scalars_mark(s, result, count, c->live);
    for (uint32_t i = 0; i < s->count; i++) {
        c->varies[i] = s->code[i].op == LG_S_INPUT;
        for (uint32_t k = 0; k < operands(c, i); k++) c->varies[i] |= c->varies[s->code[i].in[k]];
    }
}

static lg_interval_value constant(const choosing *c, double p) {
    const double all = (double)INFINITY;
    if (!isfinite(p)) return (lg_interval_value){-all, all, LG_INTERVAL_UNDEFINED};
    const bool widen = c->widen && p != 0.0;
    return (lg_interval_value){widen ? nextafter(p, -all) : p, widen ? nextafter(p, all) : p,
                               LG_INTERVAL_DIFFERENTIABLE};
}

/* Evaluates what does not depend on inputs. */
static void evaluate_constants(choosing *c) {
    for (uint32_t i = 0; i < c->s->count; i++) {
        const lg_scalar_code *code = &c->s->code[i];
        lg_interval_value in[3];
        if (!c->live[i] || c->varies[i]) continue;
        for (uint32_t k = 0; k < operands(c, i); k++) in[k] = c->value[code->in[k]];
        c->value[i] = code->op == LG_S_CONSTANT ? constant(c, code->p) : lg_interval_one(code, true, in);
        if (c->value[i].level != LG_INTERVAL_UNDEFINED) c->value[i].level = LG_INTERVAL_DIFFERENTIABLE;
    }
}

/* Whether the instruction is a number without width. */
static bool is_number(const choosing *c, uint32_t i, double *value) {
    *value = c->value[i].low;
    return !c->varies[i] && *value == c->value[i].high && c->value[i].level != LG_INTERVAL_UNDEFINED;
}

/* The instruction i in terms of instructions: operands are numbers of instructions, and y is i. */
static lg_interval_code choose(const choosing *c, uint32_t i) {
    const lg_scalar_code *code = &c->s->code[i];
    lg_interval_code out = {.op = (uint32_t)code->op, .n = code->n, .p = code->p, .y = i};
    double value;
    for (uint32_t k = 0; k < operands(c, i); k++) out.x[k] = code->in[k];
    for (uint32_t k = 0; k < 2 && (code->op == LG_S_MUL || code->op == LG_S_ADD); k++) {
        if (!is_number(c, code->in[k], &value)) continue;
        out.op = code->op == LG_S_MUL ? LG_INTERVAL_SCALE : LG_INTERVAL_SHIFT;
        out.p = value;
        out.x[0] = code->in[1 - k];
        return out;
    }
    if (code->op == LG_S_SUB && is_number(c, code->in[1], &value)) {
        out.op = LG_INTERVAL_SHIFT;
        out.p = -value;
    }
    return out;
}

static uint32_t chosen_operands(const lg_interval_code *code) {
    return code->op >= LG_SCALAR_OPS ? 1 : lg_scalar_instructions((lg_scalar_op)code->op);
}

static lg_status choose_all(choosing *c, const lg_scalar *result, size_t count) {
    for (uint32_t i = 0; i < c->s->count; i++)
        c->to->count += c->live[i] && c->varies[i] && operands(c, i) > 0;
    c->to->code = lg_alloc(c->to->context, c->to->count + 1, sizeof *c->to->code);
    if (c->to->code == NULL) return LG_OUT_OF_MEMORY;
    size_t at = 0;
    for (uint32_t i = 0; i < c->s->count; i++)
        if (c->live[i] && c->varies[i] && operands(c, i) > 0) c->to->code[at++] = choose(c, i);
    for (size_t j = 0; j < at; j++)
        for (uint32_t k = 0; k < chosen_operands(&c->to->code[j]); k++) c->uses[c->to->code[j].x[k]]++;
    for (size_t j = 0; j < count; j++) c->uses[result[j]]++;
    return LG_OK;
}

/* Registers of constants and inputs, which are not used again. */
static lg_status fixed_registers(choosing *c) {
    const lg_scalars *s = c->s;
    lg_interval *to = c->to;
    for (uint32_t i = 0; i < s->count; i++) to->constants += !c->varies[i] && c->uses[i] > 0;
    LG_TRY(LG_ALLOC_ALL(to->context, LG_ARRAY(to->constant, 2 * (to->constants + 1)),
                        LG_ARRAY(to->constant_flag, to->constants + 1)));
    for (uint32_t i = 0; i < s->count; i++) {
        if (c->varies[i] || c->uses[i] == 0) continue;
        to->constant[2 * (size_t)c->top] = c->value[i].low;
        to->constant[2 * (size_t)c->top + 1] = c->value[i].high;
        to->constant_flag[c->top] = c->value[i].level;
        c->reg[i] = c->top++;
    }
    for (uint32_t i = 0; i < s->count; i++)
        if (s->code[i].op == LG_S_INPUT) c->reg[i] = c->top + s->code[i].n;
    c->top += (uint32_t)to->inputs;
    return LG_OK;
}

/* Gives registers to results. A register is free again after the last instruction that reads it. */
static void other_registers(choosing *c) {
    for (size_t j = 0; j < c->to->count; j++) {
        lg_interval_code *code = &c->to->code[j];
        const uint32_t made = code->y, used = chosen_operands(code);
        code->y = c->reg[made] = c->idle_count > 0 ? c->idle[--c->idle_count] : c->top++;
        for (uint32_t k = 0; k < used; k++) {
            const uint32_t i = code->x[k];
            code->x[k] = c->reg[i];
            if (--c->uses[i] == 0 && c->varies[i] && c->s->code[i].op != LG_S_INPUT)
                c->idle[c->idle_count++] = c->reg[i];
        }
    }
}

lg_status lg_interval_choose(const lg_expansion *from, bool widen, lg_interval *out) {
    LG_CLEAN(lg_heap_destroy) lg_heap heap = {.context = out->context};
    const size_t n = (size_t)from->s.count + 1;
    choosing c = {.s = &from->s,
                  .widen = widen,
                  .live = lg_heap_take(&heap, n, 1),
                  .varies = lg_heap_take(&heap, n, 1),
                  .value = lg_heap_take(&heap, n, sizeof(lg_interval_value)),
                  .uses = lg_heap_take(&heap, n, sizeof(uint32_t)),
                  .reg = lg_heap_take(&heap, n, sizeof(uint32_t)),
                  .idle = lg_heap_take(&heap, n, sizeof(uint32_t)),
                  .to = out};
    out->stored = lg_alloc(out->context, from->results + 1, sizeof *out->stored);
    if (c.live == NULL || c.varies == NULL || c.value == NULL || c.uses == NULL || c.reg == NULL ||
        c.idle == NULL || out->stored == NULL)
        return LG_OUT_OF_MEMORY;
    mark(&c, from->result, from->results);
    evaluate_constants(&c);
    LG_TRY(choose_all(&c, from->result, from->results));
    LG_TRY(fixed_registers(&c));
    other_registers(&c);
    for (size_t j = 0; j < from->results; j++) out->stored[j] = c.reg[from->result[j]];
    out->registers = c.top;
    return LG_OK;
}

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

typedef struct choosing {
    const lg_scalars *s;
    lg_heap *heap;
    bool widen;
    uint8_t *live, *varies;
    double *value;  /* (s->count, 2): bounds of an instruction that does not depend on inputs */
    uint8_t *flag;  /* and its level: the highest where it is defined, as it does not change */
    uint32_t *uses; /* for each instruction: how many chosen instructions read it; results count once more */
    uint32_t *reg;  /* its register */
    uint32_t *idle; /* registers that are free again */
    uint32_t idle_count, top;
    lg_interval *to;
} choosing;

enum { PAIR = 2, APART = 2 * LG_INTERVAL_BLOCK };

static uint32_t operands(const choosing *c, uint32_t i) {
    return lg_scalar_instructions(c->s->code[i].op);
}

static void mark(choosing *c, const lg_scalar *result, size_t count) {
    const lg_scalars *s = c->s;
    for (size_t j = 0; j < count; j++) c->live[result[j]] = 1;
    for (uint32_t i = s->count; i-- > 0;)
        for (uint32_t k = 0; c->live[i] && k < operands(c, i); k++) c->live[s->code[i].in[k]] = 1;
    for (uint32_t i = 0; i < s->count; i++) {
        c->varies[i] = s->code[i].op == LG_S_INPUT;
        for (uint32_t k = 0; k < operands(c, i); k++) c->varies[i] |= c->varies[s->code[i].in[k]];
    }
}

static void constant_bounds(const choosing *c, double p, double *bounds) {
    const bool finite = isfinite(p), widen = c->widen && p != 0.0;
    bounds[0] = !finite ? -(double)INFINITY : widen ? nextafter(p, -(double)INFINITY) : p;
    bounds[1] = !finite ? (double)INFINITY : widen ? nextafter(p, (double)INFINITY) : p;
}

/* Evaluates what does not depend on inputs. */
static lg_status evaluate_constants(choosing *c) {
    double *registers = lg_heap_take(c->heap, (size_t)4 * APART, sizeof *registers);
    uint8_t *flags = lg_heap_take(c->heap, (size_t)4 * LG_INTERVAL_BLOCK, 1);
    if (registers == NULL || flags == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < c->s->count; i++) {
        const lg_scalar_code *code = &c->s->code[i];
        double *bounds = c->value + (size_t)PAIR * i;
        if (!c->live[i] || c->varies[i]) continue;
        if (code->op == LG_S_CONSTANT) {
            constant_bounds(c, code->p, bounds);
            c->flag[i] = isfinite(code->p) ? LG_INTERVAL_DIFFERENTIABLE : LG_INTERVAL_UNDEFINED;
            continue;
        }
        lg_interval_code one = {.op = (uint32_t)code->op, .n = code->n, .p = code->p, .y = 3};
        for (uint32_t k = 0; k < operands(c, i); k++) {
            one.x[k] = k == 1 && code->in[1] == code->in[0] ? 0 : k;
            for (size_t b = 0; b < (size_t)APART; b++)
                registers[k * APART + b] = c->value[(size_t)PAIR * code->in[k] + (b >= LG_INTERVAL_BLOCK)];
            memset(flags + (size_t)k * LG_INTERVAL_BLOCK, c->flag[code->in[k]], LG_INTERVAL_BLOCK);
        }
        c->to->run(1, &one, registers, flags);
        const bool defined = flags[(size_t)3 * LG_INTERVAL_BLOCK] != LG_INTERVAL_UNDEFINED;
        c->flag[i] = defined ? LG_INTERVAL_DIFFERENTIABLE : LG_INTERVAL_UNDEFINED;
        bounds[0] = registers[(size_t)3 * APART];
        bounds[1] = registers[(size_t)3 * APART + LG_INTERVAL_BLOCK];
    }
    return LG_OK;
}

/* Whether the instruction is a number without width. */
static bool is_number(const choosing *c, uint32_t i, double *value) {
    *value = c->value[(size_t)PAIR * i];
    return !c->varies[i] && *value == c->value[(size_t)PAIR * i + 1] && c->flag[i] != LG_INTERVAL_UNDEFINED;
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
    to->constant = lg_alloc(to->context, to->constants + 1, PAIR * sizeof *to->constant);
    to->constant_flag = lg_alloc(to->context, to->constants + 1, 1);
    if (to->constant == NULL || to->constant_flag == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < s->count; i++) {
        if (c->varies[i] || c->uses[i] == 0) continue;
        memcpy(to->constant + (size_t)PAIR * c->top, c->value + (size_t)PAIR * i, PAIR * sizeof(double));
        to->constant_flag[c->top] = c->flag[i];
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
    lg_heap heap = {.context = out->context};
    const size_t n = (size_t)from->s.count + 1;
    choosing c = {.s = &from->s,
                  .heap = &heap,
                  .widen = widen,
                  .live = lg_heap_take(&heap, n, 1),
                  .varies = lg_heap_take(&heap, n, 1),
                  .value = lg_heap_take(&heap, n, PAIR * sizeof(double)),
                  .flag = lg_heap_take(&heap, n, 1),
                  .uses = lg_heap_take(&heap, n, sizeof(uint32_t)),
                  .reg = lg_heap_take(&heap, n, sizeof(uint32_t)),
                  .idle = lg_heap_take(&heap, n, sizeof(uint32_t)),
                  .to = out};
    lg_status status = LG_OUT_OF_MEMORY;
    out->stored = lg_alloc(out->context, from->results + 1, sizeof *out->stored);
    if (c.live != NULL && c.varies != NULL && c.value != NULL && c.flag != NULL && c.uses != NULL &&
        c.reg != NULL && c.idle != NULL && out->stored != NULL) {
        mark(&c, from->result, from->results);
        status = evaluate_constants(&c);
        if (status == LG_OK) status = choose_all(&c, from->result, from->results);
        if (status == LG_OK) status = fixed_registers(&c);
        if (status == LG_OK) other_registers(&c);
        for (size_t j = 0; status == LG_OK && j < from->results; j++) out->stored[j] = c.reg[from->result[j]];
    }
    out->registers = c.top;
    lg_heap_destroy(&heap);
    return status;
}

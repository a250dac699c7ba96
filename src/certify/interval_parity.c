/* Which results of scalar code are even or odd functions of all inputs together. */
#include <math.h>

#include "certify/interval.h"

/* What is known of a value f: f(-x) = f(x), f(-x) = -f(x); the constant 0 is both. */
enum { EVEN = 1, ODD = 2, BOTH = EVEN | ODD };

static uint8_t of_constant(double value) {
    return value == 0.0 ? BOTH : EVEN;
}

static uint8_t of_product(uint8_t a, uint8_t b) {
    const uint8_t even = (a & b) != 0 ? EVEN : 0, crossed = (uint8_t)((a & EVEN) << 1 | (a & ODD) >> 1);
    return (uint8_t)(even | ((crossed & b) != 0 ? ODD : 0));
}

static uint8_t of_power(uint8_t a, double exponent) {
    if (exponent != floor(exponent)) return a & EVEN;
    return fmod(exponent, 2.0) != 0.0 ? a : a != 0 ? EVEN : 0;
}

/* The instruction whose result is negated here; none: *out is unchanged. */
static bool is_negative(const lg_scalars *s, lg_scalar a, lg_scalar *out) {
    if (s->code[a].op != LG_S_NEG) return false;
    *out = s->code[a].in[0];
    return true;
}

/* max(a, c) with a constant c; the constant is either operand. */
static bool is_bound(const lg_scalars *s, lg_scalar i, lg_scalar *a, double *c) {
    const lg_scalar_code *code = &s->code[i];
    if (code->op != LG_S_MAX) return false;
    for (int k = 0; k < 2; k++)
        if (lg_s_is_constant(s, code->in[k], c)) {
            *a = code->in[1 - k];
            return true;
        }
    return false;
}

/* max(-max(a, c), c) with c <= 0 is -a in limits -c and c, which has the parity of a. max(a, -a) is |a|. */
static uint8_t of_maximum(const lg_scalars *s, const uint8_t *parity, lg_scalar i) {
    const lg_scalar_code *code = &s->code[i];
    lg_scalar a, inner;
    double c, first;
    for (int k = 0; k < 2; k++)
        if (is_negative(s, code->in[k], &a) && a == code->in[1 - k]) return parity[a] != 0 ? EVEN : 0;
    if (is_bound(s, i, &inner, &c) && is_negative(s, inner, &inner) && is_bound(s, inner, &a, &first) &&
        c == first && c <= 0.0)
        return parity[a];
    return parity[code->in[0]] & parity[code->in[1]] & EVEN;
}

static uint8_t of_instruction(const lg_scalars *s, const uint8_t *parity, lg_scalar i) {
    const lg_scalar_code *c = &s->code[i];
    const uint32_t operands = lg_scalar_instructions(c->op);
    const uint8_t a = operands > 0 ? parity[c->in[0]] : 0, b = operands > 1 ? parity[c->in[1]] : 0;
    switch (c->op) {
    case LG_S_INPUT:
        return ODD;
    case LG_S_CONSTANT:
        return of_constant(c->p);
    case LG_S_ADD:
    case LG_S_SUB:
        return a & b;
    case LG_S_MUL:
    case LG_S_DIV:
        return of_product(a, b);
    case LG_S_NEG:
    case LG_S_SIN:
    case LG_S_TANH:
        return a;
    case LG_S_COS:
    case LG_S_ABS:
        return a != 0 ? EVEN : 0;
    case LG_S_POW:
        return of_power(a, c->p);
    case LG_S_MAX:
        return of_maximum(s, parity, i);
    case LG_S_SELECT:
        return (a & EVEN) != 0 ? b & parity[c->in[2]] : 0;
    default: { /* a function of even values is even; sign and atan2 are not odd where they jump */
        uint8_t all = EVEN;
        for (uint32_t k = 0; k < operands; k++) all &= parity[c->in[k]];
        return all;
    }
    }
}

lg_status lg_expansion_parity(lg_expansion *x, int8_t *out) {
    const lg_scalars *s = &x->s;
    uint8_t *parity = lg_heap_take(&x->heap, s->count + 1, 1);
    if (parity == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < s->count; i++) parity[i] = of_instruction(s, parity, i);
    for (size_t j = 0; j < x->results; j++) {
        const uint8_t p = parity[x->result[j]];
        out[j] = (p & EVEN) != 0 ? 1 : p == ODD ? -1 : 0;
    }
    return LG_OK;
}

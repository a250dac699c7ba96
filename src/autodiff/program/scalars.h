/* Scalar code: small tensors written out element by element.
 *
 * An instruction has a number, which is its result; it takes results of instructions before it. Equal
 * instructions are one (they are looked up), operations on constants are carried out, and x + 0, 1 x, 0 x and
 * the like vanish. What differs from the tensor's kernels is rounding alone, that 0 x, 0/x and x - x are 0
 * for every x, and the sign of 0.
 */
#ifndef LG_SCALARS_H
#define LG_SCALARS_H

#include "autodiff/ops/op.h"

typedef struct lg_scalar_code {
    lg_scalar_op op;
    uint32_t n;
    double p;
    lg_scalar in[3];
} lg_scalar_code;

struct lg_scalars {
    const lg_context *context;
    const lg_op *row;     /* in use: whose `expand` is called */
    lg_scalar_code *code; /* by number */
    uint32_t count, capacity;
    uint32_t *table; /* hashes: number + 1, 0 for none */
    uint32_t slots;
    bool failed; /* out of memory, or more than LG_SCALARS_MOST instructions */
};
#define LG_SCALARS_MOST (1u << 20)

/* Operands of an instruction that are instructions; all of them. */
uint32_t lg_scalar_instructions(lg_scalar_op op);
uint32_t lg_scalar_operands(lg_scalar_op op);

void lg_scalars_init(lg_scalars *s, const lg_context *context);
void lg_scalars_destroy(lg_scalars *s);
/* Each returns an instruction; 0 on failure, which `failed` tells. */
lg_scalar lg_s(lg_scalars *s, lg_scalar_op op, lg_scalar a, lg_scalar b);
lg_scalar lg_s_input(lg_scalars *s, uint32_t number); /* a fresh one for a new number */
lg_scalar lg_s_constant(lg_scalars *s, double value);
lg_scalar lg_s_select(lg_scalars *s, lg_scalar condition, lg_scalar yes, lg_scalar no);
lg_scalar lg_s_pow(lg_scalars *s, lg_scalar a, double exponent);
/* Sum of n terms, `step` apart, pairwise: few levels, little rounding. 0 for none. */
lg_scalar lg_s_sum(lg_scalars *s, const lg_scalar *terms, size_t n, size_t step);
/* sum a[i sa] b[i sb] likewise */
lg_scalar lg_s_dot(lg_scalars *s, const lg_scalar *a, size_t sa, const lg_scalar *b, size_t sb, size_t n);
lg_scalar lg_s_numbered(lg_scalars *s, lg_scalar_op op, lg_scalar a, uint32_t n); /* STUMPFF, DEXPINV */
bool lg_s_is_constant(const lg_scalars *s, lg_scalar a, double *value);

static inline lg_scalar lg_s_add(lg_scalars *s, lg_scalar a, lg_scalar b) {
    return lg_s(s, LG_S_ADD, a, b);
}
static inline lg_scalar lg_s_sub(lg_scalars *s, lg_scalar a, lg_scalar b) {
    return lg_s(s, LG_S_SUB, a, b);
}
static inline lg_scalar lg_s_mul(lg_scalars *s, lg_scalar a, lg_scalar b) {
    return lg_s(s, LG_S_MUL, a, b);
}
static inline lg_scalar lg_s_div(lg_scalars *s, lg_scalar a, lg_scalar b) {
    return lg_s(s, LG_S_DIV, a, b);
}
static inline lg_scalar lg_s_neg(lg_scalars *s, lg_scalar a) {
    return lg_s(s, LG_S_NEG, a, a);
}
static inline lg_scalar lg_s_scale(lg_scalars *s, double c, lg_scalar a) {
    return lg_s(s, LG_S_MUL, lg_s_constant(s, c), a);
}

/* The operation's output from its inputs' elements: by its row's `element` (elementwise, broadcasting) or
 * `expand`. False: it has neither, or failed. */
bool lg_scalars_expand(lg_scalars *s, const lg_op *op, const lg_evaluation *e, const lg_scalar *const *x,
                       lg_scalar *y);

#endif

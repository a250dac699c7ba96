/* Scalar code: small tensors computed element by element.
 *
 * The number of an instruction stands for its result. An instruction uses results of earlier instructions.
 * Equal instructions are stored once (by a hash table), operations on constants are evaluated, and x + 0, 1
 * x, 0 x and similar expressions are simplified. The results differ from the tensor kernels' results only by
 * rounding, by the sign of 0, and in that 0 x, 0/x and x - x are 0 for every x. Exact code (for intervals)
 * replaces 0 x and x - x by 0 only if x is Lipschitz continuous for all numbers; otherwise it keeps a product
 * of 0 and x, so that the result has the flag of x. It never replaces 0/x. */
#ifndef LG_SCALARS_H
#define LG_SCALARS_H

#include "autodiff/ops/op.h"

typedef struct lg_scalar_code {
    lg_scalar_op op;
    uint32_t n;
    double p;
    lg_scalar in[3];
    uint8_t level; /* if the code is exact: what holds for all numbers of the inputs */
} lg_scalar_code;

struct lg_scalars {
    const lg_context *context;
    const lg_op *row;     /* the row whose `expand` or `element` is running */
    lg_scalar_code *code; /* the instructions, by number */
    uint32_t count, capacity;
    uint32_t *table; /* hash table of 1 + number; 0: empty slot */
    uint32_t slots;
    bool failed; /* out of memory, or more than LG_SCALARS_MOST instructions */
    /* The level of a new instruction. NULL: the code is not exact. In exact code operations on constants are
     * evaluated only if they do not round. */
    uint8_t (*level_of)(const lg_scalars *s, const lg_scalar_code *c);
    bool drops; /* exact code does not keep the x of 0 x: its level is known in another way */
};
/* Levels that simplifications of exact code need; liegrad/interval.h has all of them. */
enum { LG_S_DEFINED = 1, LG_S_LIPSCHITZ = 3 };
#define LG_SCALARS_MOST (1u << 20)

/* Number of operands of an instruction that are instructions; number of all its operands. */
uint32_t lg_scalar_instructions(lg_scalar_op op);
uint32_t lg_scalar_operands(lg_scalar_op op);

void lg_scalars_init(lg_scalars *s, const lg_context *context);
void lg_scalars_destroy(lg_scalars *s);
/* Each of these returns an instruction, or 0 on failure; `failed` is then set. */
lg_scalar lg_s(lg_scalars *s, lg_scalar_op op, lg_scalar a, lg_scalar b);
lg_scalar lg_s_input(lg_scalars *s, uint32_t number); /* a new number makes a new instruction */
lg_scalar lg_s_constant(lg_scalars *s, double value);
lg_scalar lg_s_select(lg_scalars *s, lg_scalar condition, lg_scalar yes, lg_scalar no);
lg_scalar lg_s_pow(lg_scalars *s, lg_scalar a, double exponent);
/* a, whose derivative is stopped. Exact code marks it as a power of 1, which lg_s_pow never makes. */
lg_scalar lg_s_stopped(lg_scalars *s, lg_scalar a);
/* Sum of n terms that are `step` entries apart, added pairwise: this keeps depth and rounding errors small. 0
 * for n = 0. */
lg_scalar lg_s_sum(lg_scalars *s, const lg_scalar *terms, size_t n, size_t step);
/* sum_i a[i sa] b[i sb], added in the same way. */
lg_scalar lg_s_dot(lg_scalars *s, const lg_scalar *a, size_t sa, const lg_scalar *b, size_t sb, size_t n);
/* For STUMPFF and DEXPINV. */
lg_scalar lg_s_numbered(lg_scalars *s, lg_scalar_op op, lg_scalar a, uint32_t n);
/* Marks the instructions that the results need, among `live` (s->count), which are 0. */
void lg_scalars_mark(const lg_scalars *s, const lg_scalar *result, size_t count, uint8_t *live);
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

/* Computes the operation's output from the elements of its inputs, with the row's `element` (elementwise,
 * with broadcasting) or `expand`. False: the row has neither, or the code failed. */
bool lg_scalars_expand(lg_scalars *s, const lg_op *op, const lg_evaluation *e, const lg_scalar *const *x,
                       lg_scalar *y);
/* The `expand` of an operation whose forward copies numbers and does nothing else with them. */
void lg_moved_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y);

#endif

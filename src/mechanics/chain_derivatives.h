/* Value and first adjoint of the Lagrangian chain's field for a batch, at a cost of O(k) per row: the
 * numerics of the custom operation in chain_taped.c. Tensors: q, omega (B, k, 3), parameters (1 + 2k),
 * result v (B, k, 3), of the tape's element type. */
#ifndef LG_CHAIN_DERIVATIVES_H
#define LG_CHAIN_DERIVATIVES_H

#include "core/numbers.h"
#include "mechanics/chain.h"

typedef struct lg_chain_batch {
    lg_dtype dtype;
    const void *sizes;   /* B and k, as elements of type dtype */
    const void *scratch; /* lg_chain_scratch(k) doubles; the functions write to it despite const */
} lg_chain_batch;

size_t lg_chain_scratch(size_t links);

/* v = the field's value at in = {q, omega, parameters}. */
void lg_chain_batch_value(const lg_chain_batch *batch, const void *const *in, void *v);
/* out[i] = the cotangent of in[i] for the cotangent g of v; an out[i] that is NULL is skipped. */
void lg_chain_batch_adjoint(const lg_chain_batch *batch, const void *const *in, const void *g,
                            void *const *out);

#endif

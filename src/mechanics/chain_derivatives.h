/* Value and first derivatives of the Lagrangian chain's field for a batch, O(k) a row: the inside of the
 * custom operations of chain_taped.c. Tensors: q, omega (B, k, 3), parameters (1 + 2k), result v (B, k, 3),
 * in the elements of the tape. */
#ifndef LG_CHAIN_DERIVATIVES_H
#define LG_CHAIN_DERIVATIVES_H

#include "mechanics/chain.h"

typedef struct lg_chain_batch {
    lg_dtype dtype;
    const void *sizes;   /* B, k as elements */
    const void *scratch; /* lg_chain_scratch(k) doubles; it is written to */
} lg_chain_batch;

size_t lg_chain_scratch(size_t links);

/* in: q, omega, parameters */
void lg_chain_batch_value(const lg_chain_batch *batch, const void *const *in, void *v);
/* out[i]: the cotangent of in[i] for the cotangent g of v, where not NULL. */
void lg_chain_batch_adjoint(const lg_chain_batch *batch, const void *const *in, const void *g,
                            void *const *out);
/* out: the tangent of v for the tangents of q, omega, parameters. */
void lg_chain_batch_tangent(const lg_chain_batch *batch, const void *const *in, const void *const *tangents,
                            void *out);

#endif

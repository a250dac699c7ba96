/* Pairs of a value and its derivative in a direction, (2 B, n): B rows of values, then B rows of derivatives.
 * A layer takes both through one product, forwards and backwards. All are differentiable to any order. */
#ifndef LG_DUAL_H
#define LG_DUAL_H

#include "liegrad/ops.h"

/* (x, x') of shapes (B, in), (B, in) or (1, in) -> pairs */
lg_var lg_dual_pair(lg_tape *tape, lg_var x, lg_var dx);
/* sigma(x W + b) of pairs (2 B, k): (sigma(z), sigma'(z) (x' W)); b (n) or LG_NONE */
lg_var lg_dual_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, lg_activation kind);
/* sigma of pairs */
lg_var lg_dual_act(lg_tape *tape, lg_var x, lg_activation kind);
/* (1 - z) u + z v of pairs */
lg_var lg_dual_mix(lg_tape *tape, lg_var z, lg_var u, lg_var v);
/* One half of pairs, (B, n): 0 the values, 1 the derivatives. A view. */
lg_var lg_dual_half(lg_tape *tape, lg_var pairs, int half);

#endif

/* Pairs of values and their derivatives in one direction: arrays (2 B, n) with B rows of values, followed by
 * B rows of derivatives. A layer transforms both with one matrix product, in the forward and the reverse
 * pass. All functions are differentiable to any order. */
#ifndef LG_DUAL_H
#define LG_DUAL_H

#include "liegrad/tape.h"

/* Makes pairs from x (B, in) and its derivative dx, of shape (B, in) or (1, in). */
lg_var lg_dual_pair(lg_tape *tape, lg_var x, lg_var dx);
/* A dense layer sigma(x W + b) of pairs (2 B, k): with z = x W + b, the result is (sigma(z), sigma'(z) (x'
 * W)). b (n) may be LG_NONE. */
lg_var lg_dual_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, lg_activation kind);
/* The activation sigma of pairs. */
lg_var lg_dual_act(lg_tape *tape, lg_var x, lg_activation kind);
/* The mix (1 - z) u + z v of pairs. */
lg_var lg_dual_mix(lg_tape *tape, lg_var z, lg_var u, lg_var v);
/* One half of the pairs, (B, n): half 0 is the values, half 1 the derivatives. The result is a view. */
lg_var lg_dual_half(lg_tape *tape, lg_var pairs, int half);

#endif

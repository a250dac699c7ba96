/* Pooling along time, which a convolution may end with. */
#ifndef LG_OPS_POOL_H
#define LG_OPS_POOL_H

#include "autodiff/ops/op_c.h"
#include "autodiff/tape/tape_internal.h"
#include "kernels/conv.h"

/* Windows of a series (batch, length, channels) of this shape; attr.i = {size, stride}. False: they do not
 * fit. */
bool lg_pool_of(const lg_shape *x, const lg_attr *attr, lg_k_windows *out);
/* A pooling operation of a, and of b unless it is LG_NONE, with the size and stride of attr; length: of the
 * series, where the inputs leave it open. */
lg_var lg_record_pool(lg_tape *tape, const lg_op *op, lg_var a, lg_var b, const lg_attr *attr,
                      uint32_t length);

extern const lg_c_fragment lg_c_pool_mean; /* means of windows */

#endif

/* Pooling along time, also used as the last stage of a convolution block. */
#ifndef LG_OPS_POOL_H
#define LG_OPS_POOL_H

#include "autodiff/ops/op_c.h"
#include "autodiff/tape/tape_internal.h"
#include "kernels/conv.h"

/* Sets *out to the windows of a series with shape x (batch, length, channels); attr.i = {size, stride}.
 * False: the windows do not fit the series. */
bool lg_pool_of(const lg_shape *x, const lg_attr *attr, lg_k_windows *out);
/* Records an operation along time with input a, and with input b unless b is LG_NONE. attr.i[0] and [1] are
 * those of `attr`; attr.i[2] is `extent`, a size that the inputs' shapes do not determine, or 0. */
lg_var lg_record_windows(lg_tape *tape, const lg_op *op, lg_var a, lg_var b, const lg_attr *attr,
                         uint32_t extent);

#endif

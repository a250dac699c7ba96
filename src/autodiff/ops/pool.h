/* Pooling along time, also used as the last stage of a convolution block. */
#ifndef LG_OPS_POOL_H
#define LG_OPS_POOL_H

#include "autodiff/ops/op_c.h"
#include "autodiff/tape/tape_internal.h"
#include "kernels/conv.h"

/* Sets *out to the windows of a series with shape x (batch, length, channels); attr.i = {size, stride}.
 * False: the windows do not fit the series. */
bool lg_pool_of(const lg_shape *x, const lg_attr *attr, lg_k_windows *out);
/* Records a pooling operation with input a, and with input b unless b is LG_NONE. Size and stride are in
 * attr. `length` is the length of the series, for operations whose inputs do not determine it. */
lg_var lg_record_pool(lg_tape *tape, const lg_op *op, lg_var a, lg_var b, const lg_attr *attr,
                      uint32_t length);

extern const lg_c_fragment lg_c_pool_mean; /* pool_mean: means of windows */

#endif

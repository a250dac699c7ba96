/* Fragments of C for convolution along time. */
#ifndef LG_OPS_CONV_CODE_H
#define LG_OPS_CONV_CODE_H

#include "autodiff/ops/op_c.h"

extern const lg_c_fragment lg_c_conv1d, lg_c_conv1d_input, lg_c_conv1d_weight;

#endif

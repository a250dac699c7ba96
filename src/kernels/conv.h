/* One-dimensional convolution of plain memory, for the tape and for evaluation without one.
 *
 * With channels last the windows of a series are rows of a matrix that overlap in memory: row t begins t
 * stride channels numbers on and has kernel channels numbers. Convolution is the product of that matrix A
 * (count, k C) by the weight W (k C, O), its derivatives are A^T G and, with overlapping rows added up, G
 * W^T. Nothing is copied where there is no padding. A sample's results do not depend on the others.
 */
#ifndef LG_CONV_H
#define LG_CONV_H

#include "kernels/kernels.h"

/* windows.size is the kernel, windows.channels the input's. pool.count > 0: sigma(conv + bias) is averaged
 * over these windows, which fit it. */
typedef struct lg_conv {
    lg_k_windows windows, pool;
    size_t batch, outputs;
} lg_conv;

/* Sets count. False: nothing is left, or size or stride is 0, or the padding reaches the kernel's length. */
bool lg_windows_count(lg_k_windows *windows);

/* Elements of scratch memory, which may be none. */
size_t lg_conv_scratch(const lg_conv *conv);
size_t lg_conv_input_scratch(const lg_conv *conv);
size_t lg_conv_weight_scratch(const lg_conv *conv);

/* y (batch, count or pool.count, outputs) = sigma(conv(x, w) + bias), averaged if there is a pool; slope
 * (batch, count, outputs) = sigma'(...). bias (outputs) and slope may be NULL. */
void lg_conv_apply(const lg_kernels *k, const lg_conv *conv, const void *x, const void *w, const void *bias,
                   lg_k_act kind, void *slope, void *y, void *scratch);
/* out (batch, count, outputs): the cotangent of conv(x, w) from g, that of y. */
void lg_conv_slope(const lg_kernels *k, const lg_conv *conv, const void *g, const void *slope, void *out);
/* x [+]= G W^T; wt (outputs, kernel channels) is the weight transposed. */
void lg_conv_input(const lg_kernels *k, const lg_conv *conv, const void *g, const void *wt, void *x, bool add,
                   void *scratch);
/* w [+]= A^T G */
void lg_conv_weight(const lg_kernels *k, const lg_conv *conv, const void *x, const void *g, void *w, bool add,
                    void *scratch);
/* bias [+]= sum of G over samples and time; scratch: LG_CONV_BIAS_SCRATCH outputs elements. */
#define LG_CONV_BIAS_SCRATCH 16
void lg_conv_bias(const lg_kernels *k, const lg_conv *conv, const void *g, void *bias, bool add,
                  void *scratch);

#endif

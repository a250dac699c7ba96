/* One-dimensional convolution on arrays in memory. The tape uses it, and so does evaluation without a tape.
 *
 * Channels are the last index. The windows of a series are then the rows of a matrix A (count, kernel
 * channels) whose rows overlap in memory: row t begins t stride channels numbers after the first one and has
 * kernel channels numbers. Convolution is the product of A and the weight W (kernel channels, outputs). With
 * G, the cotangent of this product, the weight's cotangent is A^T G. The input's cotangent is G W^T, whose
 * overlapping rows are added up. Nothing is copied unless there is padding. The results of a sample do not
 * depend on the other samples. "[+]=" in the comments below means: set, or added to if `add`.
 */
#ifndef LG_CONV_H
#define LG_CONV_H

#include "kernels/kernels.h"

/* windows.size is the length of the kernel, windows.channels the number of channels of the input. If
 * pool.count > 0, sigma(conv + bias) is averaged over the windows of `pool`, which must fit it. */
typedef struct lg_conv {
    lg_k_windows windows, pool;
    size_t batch, outputs;
} lg_conv;

/* Sets `count`. Returns false if the series is shorter than a window, if size or stride is 0, or if the
 * padding is not less than the size. */
bool lg_windows_count(lg_k_windows *windows);

/* Number of elements of scratch memory that lg_conv_apply, lg_conv_input and lg_conv_weight need; may be
 * 0. */
size_t lg_conv_scratch(const lg_conv *conv);
size_t lg_conv_input_scratch(const lg_conv *conv);
size_t lg_conv_weight_scratch(const lg_conv *conv);

/* y (batch, count, outputs) = sigma(conv(x, w) + bias). With a pool this is averaged to y (batch, pool.count,
 * outputs). slope (batch, count, outputs) becomes sigma' at the same arguments. bias (outputs) and slope may
 * be NULL. */
void lg_conv_apply(const lg_kernels *k, const lg_conv *conv, const void *x, const void *w, const void *bias,
                   lg_k_act kind, void *slope, void *y, void *scratch);
/* Computes out (batch, count, outputs), the cotangent of conv(x, w), from g, the cotangent of y. slope comes
 * from lg_conv_apply. */
void lg_conv_slope(const lg_kernels *k, const lg_conv *conv, const void *g, const void *slope, void *out);
/* x [+]= G W^T with overlapping rows added up. wt (outputs, kernel channels) is the transposed weight. */
void lg_conv_input(const lg_kernels *k, const lg_conv *conv, const void *g, const void *wt, void *x, bool add,
                   void *scratch);
/* w [+]= A^T G */
void lg_conv_weight(const lg_kernels *k, const lg_conv *conv, const void *x, const void *g, void *w, bool add,
                    void *scratch);
/* bias [+]= the sum of G over samples and time. scratch has room for LG_CONV_BIAS_SCRATCH outputs
 * elements. */
#define LG_CONV_BIAS_SCRATCH 16
void lg_conv_bias(const lg_kernels *k, const lg_conv *conv, const void *g, void *bias, bool add,
                  void *scratch);

#endif

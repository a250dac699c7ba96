/* The layers of a convolutional network (liegrad/convolution.h) in the order in which their parameters lie in
 * the flat vector, each weight before its bias: convolutions, the plane where there is one, the output. */
#ifndef LG_CNN_H
#define LG_CNN_H

#include "liegrad/convolution.h"

#define CNN_MAX_LAYERS (LG_CNN_MAX_BLOCKS + 2)

/* y = x W + b, x the kernel's samples of a convolution's input, or all numbers of a series: W (in, out). */
typedef struct cnn_layer {
    size_t in;
    uint32_t out;
    uint32_t kernel; /* samples; 0: dense */
    size_t weight, bias;
} cnn_layer;

typedef struct cnn_layout {
    uint32_t count;
    size_t parameters;
    cnn_layer layer[CNN_MAX_LAYERS];
} cnn_layout;

void lg_cnn_layout(const lg_cnn *net, cnn_layout *layout);

/* lg_cnn_record with convolutions and poolings as operations of their own: a program of values and recorded
 * derivatives then computes each convolution once. */
lg_var lg_cnn_record_apart(lg_tape *tape, const lg_cnn *net, lg_var theta, lg_var x);

/* Channels and samples that enter block i, or, for i = blocks, the layers behind the last one. */
static inline uint32_t cnn_channels(const lg_cnn *net, uint32_t i) {
    return i == 0 ? net->channels : net->block[i - 1].channels;
}

/* Samples after the convolution of block i and before its pooling. */
static inline uint32_t cnn_convolved(const lg_cnn *net, uint32_t i) {
    const lg_cnn_block *b = &net->block[i];
    return (net->lengths[i] + 2 * b->padding - b->kernel) / b->stride + 1;
}

#endif

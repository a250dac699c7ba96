/* The layers of a convolutional network (liegrad/convolution.h) in the order of their parameters in the flat
 * vector: convolutions, the plane if there is one, the output. Each weight is before its bias. */
#ifndef LG_CNN_H
#define LG_CNN_H

#include "liegrad/convolution.h"

#define CNN_MAX_LAYERS (LG_CNN_MAX_BLOCKS + 2)

/* y = x W + b with W (in, out); x is the part of the input under the kernel of a convolution, or all numbers
 * of a series. */
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

/* lg_cnn_record with separate operations for convolutions and poolings, so that a program of values and
 * recorded derivatives computes each convolution once. */
lg_var lg_cnn_record_apart(lg_tape *tape, const lg_cnn *net, lg_var theta, lg_var x);

/* lg_cnn_record that also gives the output of each layer of the layout: (B, L'', O) of a block, else
 * (B, out). */
lg_var lg_cnn_record_layers(lg_tape *tape, const lg_cnn *net, lg_var theta, size_t offset, lg_var x,
                            lg_var layers[CNN_MAX_LAYERS]);

/* Channels and samples of the input of block i; for i = blocks, of the layers behind the last block. */
static inline uint32_t cnn_channels(const lg_cnn *net, uint32_t i) {
    return i == 0 ? net->channels : net->block[i - 1].channels;
}

#endif

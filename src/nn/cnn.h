/* The layers of a convolutional network (liegrad/networks.h), in the order of their parameters in the flat
 * vector: convolutions, the dense layer "plane" if there is one, output layer. A bias follows its weight. */
#ifndef LG_CNN_H
#define LG_CNN_H

#include "nn/layers.h"

#define CNN_MAX_LAYERS (LG_CNN_MAX_BLOCKS + 2)

lg_layers lg_cnn_layers(const lg_cnn *net);

/* The same as lg_cnn_record, but convolutions, activations and poolings are separate operations. A program
 * that also has recorded derivatives then computes each convolution once. */
lg_var lg_cnn_record_apart(lg_tape *tape, const lg_cnn *net, lg_var theta, lg_var x);

/* The same as lg_cnn_record; also returns the output of each layer of lg_cnn_layers: (B, L'', O) for a block,
 * (B, out) for a dense layer. */
lg_var lg_cnn_record_layers(lg_tape *tape, const lg_cnn *net, lg_var theta, size_t offset, lg_var x,
                            lg_var layers[CNN_MAX_LAYERS]);

/* Number of channels in the input of block i. For i = net->blocks: in the output of the last block. */
static inline uint32_t cnn_channels(const lg_cnn *net, uint32_t i) {
    return i == 0 ? net->channels : net->block[i - 1].channels;
}

#endif

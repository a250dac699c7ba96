/* One-dimensional convolutional networks: blocks of convolution, activation and pooling, then dense layers.
 *
 * Series on a tape have the time before the channels: x (B, L, C). For a block with kernel k, stride s,
 * padding p (zeros at both ends) and `channels` O:
 *   L' = floor((L + 2p - k)/s) + 1,  y[b, t, o] = bias[o] + sum_{j,c} x[b, s t + j - p, c] W[j, c, o]
 * (a correlation, as usual), then the activation, then pooling over windows of pool_size samples every
 * pool_stride: L'' = floor((L' - pool_size)/pool_stride) + 1. After the last block the (L'', O) numbers of
 * each series form one row. A dense layer with activation maps it to `plane` numbers (0: no such layer), and
 * the output layer to `outputs` logits.
 * Default: 3 blocks, channels 2C, 4C, 8C (4096 at most, fewer if one block would have 2^28 weights), kernel
 * 5, average pooling 2/2, plane 2. Without blocks, it is a perceptron of the whole series.
 */
#ifndef LIEGRAD_CONVOLUTION_H
#define LIEGRAD_CONVOLUTION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/export.h"
#include "liegrad/networks.h"
#include "liegrad/nn.h"
#include "liegrad/random.h"
#include "liegrad/status.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

typedef enum lg_pooling { LG_POOL_NONE, LG_POOL_AVERAGE, LG_POOL_MAX } lg_pooling;
#define LG_POOLING_COUNT 3
LG_API const char *lg_pooling_name(lg_pooling kind);                  /* "none", "average", "max" */
LG_API lg_status lg_pooling_parse(const char *name, lg_pooling *out); /* LG_NOT_FOUND */

typedef struct lg_cnn_block {
    uint32_t channels, kernel, stride, padding; /* kernel, stride >= 1; padding < kernel */
    lg_pooling pooling;
    uint32_t pool_size, pool_stride; /* >= 1; ignored without pooling */
} lg_cnn_block;

#define LG_CNN_MAX_BLOCKS 8

/* Immutable after lg_cnn_init; plain data, copied freely. */
typedef struct lg_cnn {
    uint32_t channels, length; /* of the input */
    uint32_t blocks;           /* 0..LG_CNN_MAX_BLOCKS */
    lg_cnn_block block[LG_CNN_MAX_BLOCKS];
    uint32_t plane;   /* width of the layer before the output; 0: there is none */
    uint32_t outputs; /* >= 1 */
    lg_activation activation;
    uint32_t lengths[LG_CNN_MAX_BLOCKS + 1]; /* set by init: length of the input and after each block */
} lg_cnn;

/* Makes the default network for series of this size and applies lg_cnn_init. A series too short for three
 * blocks gets fewer. The last kernel is at most as long as the series before it. A block that leaves one
 * sample has no pooling. The result is valid for channels, length and outputs >= 1 within the limits of
 * lg_cnn_init; beyond them lg_cnn_init refuses it. */
LG_API void lg_cnn_init_default(lg_cnn *net, uint32_t channels, uint32_t length, uint32_t outputs,
                                lg_activation activation);
/* Checks the description and sets `lengths`. LG_INVALID_ARGUMENT (sizes of 0 or beyond 2^20, more than 2^31
 * parameters, a block after which no sample is left): a sentence names the block, and *net is untouched. */
LG_API lg_status lg_cnn_init(lg_cnn *net, lg_error *error);

LG_API size_t lg_cnn_parameters(const lg_cnn *net);
/* "conv1/weight" (k, C, O), "conv1/bias" (O), ..., "plane/weight" (L'' O, plane), "plane/bias",
 * "output/weight", "output/bias"; false beyond the last. */
LG_API bool lg_cnn_slice(const lg_cnn *net, uint32_t index, lg_slice_info *out);
/* Fills theta slice by slice. Fan in of a convolution: k C; fan out: k O. */
LG_API void lg_cnn_initialise(const lg_cnn *net, lg_initialisation kind, lg_rng *rng, double *theta);

/* theta: flat vector (rank 1) whose elements offset .. offset + lg_cnn_parameters - 1 are the network's.
 * x (B, length, channels) -> logits (B, outputs); *plane (may be NULL): (B, plane), LG_NONE without one or on
 * failure. Errors: the tape's, which stick; LG_SHAPE for series of another size. */
LG_API lg_var lg_cnn_record(lg_tape *tape, const lg_cnn *net, lg_var theta, size_t offset, lg_var x,
                            lg_var *plane);

LG_END_DECLS

#endif

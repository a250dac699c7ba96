/* Networks over a flat parameter vector: multilayer perceptrons, residual and multiplicative networks, convolutions.
 *
 * A network is a small immutable description without pointers. Its parameters are a slice of one flat vector
 * theta, so that an optimiser, a file and a gradient see one array.
 */
#ifndef LIEGRAD_NETWORKS_H
#define LIEGRAD_NETWORKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

/* ---- multilayer perceptron: description ---- */

#define LG_MLP_MAX_LAYERS 16

/* a_0 = x, a_{l+1} = sigma_l(a_l W_l + b_l), l = 0..layers-1, W_l of shape (width[l], width[l+1]), b_l
 * (width[l+1]). sigma_l is `activation` in the hidden layers and the identity in the last one, which has a
 * bias only when `last_bias`. Parameters: W_0 row-major, b_0, W_1, b_1, ... Plain data, copied freely,
 * immutable after lg_mlp_init. */
typedef struct lg_mlp {
    uint32_t layers;                       /* 1..LG_MLP_MAX_LAYERS; layers - 1 hidden ones */
    uint32_t width[LG_MLP_MAX_LAYERS + 1]; /* input, hidden..., output */
    lg_activation activation;
    bool last_bias;
} lg_mlp;

/* inputs -> hidden[0] -> ... -> hidden[hidden_layers - 1] -> outputs; hidden_layers may be 0 (a linear map;
 * `hidden` may be NULL then). Errors: LG_INVALID_ARGUMENT for a NULL net, widths of 0 or above 2^20, more
 * than LG_MLP_MAX_LAYERS - 1 hidden layers, an unknown activation. */
LG_API lg_status lg_mlp_init(lg_mlp *net, uint32_t inputs, const uint32_t *hidden, uint32_t hidden_layers,
                             uint32_t outputs, lg_activation activation, bool last_bias);
LG_API size_t lg_mlp_parameters(const lg_mlp *net);
LG_API uint32_t lg_mlp_inputs(const lg_mlp *net);
LG_API uint32_t lg_mlp_outputs(const lg_mlp *net);
LG_API bool lg_mlp_has_bias(const lg_mlp *net, uint32_t layer);
/* Where a layer's weight and bias begin in the flat vector, in elements; layer < net->layers. A layer without
 * bias gives the offset at which its bias would stand. */
LG_API size_t lg_mlp_weight_offset(const lg_mlp *net, uint32_t layer);
LG_API size_t lg_mlp_bias_offset(const lg_mlp *net, uint32_t layer);

/* How parameters are drawn, layer by layer, weight then bias. */
typedef enum lg_initialisation {
    LG_INIT_FAN_IN,         /* weights and biases U(+-1/sqrt(fan_in)) */
    LG_INIT_GLOROT_UNIFORM, /* weights U(+-sqrt(6/(fan_in + fan_out))), biases 0 (Glorot & Bengio 2010) */
    LG_INIT_GLOROT_NORMAL,  /* weights N(0, 2/(fan_in + fan_out)), biases 0 */
    LG_INIT_HE_UNIFORM,     /* weights U(+-sqrt(6/fan_in)), biases 0 (He et al. 2015) */
    LG_INIT_HE_NORMAL       /* weights N(0, 2/fan_in), biases 0 */
} lg_initialisation;
#define LG_INITIALISATION_COUNT 5

/* Fills theta[0 .. lg_mlp_parameters - 1]; LG_INIT_FAN_IN. */
LG_API void lg_mlp_initialise(const lg_mlp *net, lg_rng *rng, double *theta);
LG_API void lg_mlp_initialise_as(const lg_mlp *net, lg_initialisation kind, lg_rng *rng, double *theta);

/* ---- multilayer perceptron: on a tape ---- */

/* Weights and biases as views of the flat vector; LG_NONE where a layer has no bias. Valid until rewound. */
typedef struct lg_mlp_vars {
    lg_var weight[LG_MLP_MAX_LAYERS], bias[LG_MLP_MAX_LAYERS];
} lg_mlp_vars;

/* theta: flat vector (rank 1), whose elements offset .. offset + lg_mlp_parameters - 1 are the network's.
 * Errors: the tape's (LG_SHAPE when theta is too short), which stick. */
LG_API lg_status lg_mlp_bind(lg_tape *tape, const lg_mlp *net, lg_var theta, size_t offset,
                             lg_mlp_vars *vars);
/* x (B, in) -> (B, out) */
LG_API lg_var lg_mlp_record_bound(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var x);
/* d sum(output[:, 0]) / dx: (B, in) -> (B, in); row b is the gradient of the first output at x_b. Recorded:
 * it may be differentiated again by theta and by x. */
LG_API lg_var lg_mlp_record_gradient(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var x);
/* Bind and apply in one. */
LG_API lg_var lg_mlp_record(lg_tape *tape, const lg_mlp *net, lg_var theta, size_t offset, lg_var x);

/* ---- residual and multiplicative networks ----
 *
 * Networks of several architectures behind one description: multilayer perceptrons, residual and
 * multiplicative networks, with or without a periodic embedding of their inputs. The functions correspond to
 * those of lg_mlp (liegrad/nn.h); use lg_mlp for hidden layers of different widths.
 *
 * With inputs x (B, in), h = hidden, l = layers, sigma = activation; weights are (in, out), y = x W + b:
 *
 *   embedding e > 0:  x <- sin(2 pi (x A + b)), (B, e); otherwise x does not change
 *   LG_NET_MLP        H = sigma(x W + b), then l times H <- sigma(H W + b), y = H W + b
 *   LG_NET_RESNET     H = sigma(x W + b), then l times H <- H + sigma(H A + b) B, y = H W + b
 *   LG_NET_MULT       U = sigma(x W_1 + b_1), V = sigma(x W_2 + b_2), H = sigma(x W_3 + b_3), then l times
 *                     Z = sigma(H W_z + b_z), H <- (1 - Z) o U + Z o V, y = H W + b
 *   LG_NET_MULT_AFFINE  the same with Z = sigma(H W_z + b_z) W_o + b_o: no bound on the gate
 *
 * ("l layers of h": the first layer is not counted.) Sources: He et al. 2016 (residual), Wang, Teng &
 * Perdikaris 2021 (multiplicative). */

typedef enum lg_net_kind { LG_NET_MLP, LG_NET_RESNET, LG_NET_MULT, LG_NET_MULT_AFFINE } lg_net_kind;
#define LG_NET_KIND_COUNT 4
LG_API const char *lg_net_kind_name(lg_net_kind kind); /* "mlp", "resnet", "mult", "mult-affine" */

#define LG_NET_MAX_LAYERS 14

/* Immutable after lg_net_init; plain data, copied freely, holds no pointers. */
typedef struct lg_net {
    lg_net_kind kind;
    uint32_t inputs, outputs;
    uint32_t embedding; /* e; 0: none */
    uint32_t hidden;    /* h */
    uint32_t layers;    /* l, 0..LG_NET_MAX_LAYERS */
    lg_activation activation;
} lg_net;

/* LG_INVALID_ARGUMENT: NULL, widths of 0 or above 2^20, too many layers, an unknown kind or activation. */
LG_API lg_status lg_net_init(lg_net *net, lg_net_kind kind, uint32_t inputs, uint32_t embedding,
                             uint32_t hidden, uint32_t layers, uint32_t outputs, lg_activation activation);
LG_API size_t lg_net_parameters(const lg_net *net);

/* A named slice of a flat parameter vector, the unit of files and of initialisation. The vector has these
 * layers in order, each with its weight and then its bias:
 * - "embedding", if there is one
 * - MLP: "layer1".."layer<l + 1>"
 * - residual network: "first", then for i = 1..l "inner<i>" (A) and "outer<i>" (B, without a bias)
 * - multiplicative network: "u", "v", "first", then for i = 1..l "gate<i>", followed by "affine<i>" (W_o) for
 *   LG_NET_MULT_AFFINE
 * - "output"
 * Without an embedding, an MLP's vector is that of the lg_mlp of the same widths. */
typedef struct lg_slice_info {
    char name[48];    /* "embedding/weight", "layer1/bias", "gate2/weight", ... */
    uint32_t rank;    /* 1, 2, or 3 (convolutions: k, C, O) */
    uint64_t dims[4]; /* weights (in, out) row-major */
    size_t offset, count;
} lg_slice_info;
/* Slice number `index` = 0, 1, ... in the order of the vector; false beyond the last. */
LG_API bool lg_net_slice(const lg_net *net, uint32_t index, lg_slice_info *out);

/* Fills theta[0 .. lg_net_parameters - 1], slice by slice. The embedding is drawn like every other layer. */
LG_API void lg_net_initialise(const lg_net *net, lg_initialisation kind, lg_rng *rng, double *theta);

/* ---- on a tape ---- */

/* theta: flat vector (rank 1) whose elements offset .. offset + lg_net_parameters - 1 are the network's.
 * x (B, in) -> (B, out). */
LG_API lg_var lg_net_record(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x);
/* Value and directional derivative in one pass: y (B, out), dy = (dy/dx) dx (B, out); dx (B, in) or (1, in).
 * Both are recorded and may be differentiated again by theta and x. Equal to lg_jvp of lg_net_record up to
 * rounding, and cheaper. */
LG_API lg_status lg_net_record_jvp(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x,
                                   lg_var dx, lg_var *y, lg_var *dy);

/* ---- convolutional networks ----
 *
 * One-dimensional convolutional networks: blocks of convolution, activation and pooling, then dense layers.
 *
 * Series on a tape have the time before the channels: x (B, L, C). For a block with kernel k, stride s,
 * padding p (zeros at both ends) and `channels` O:
 *   L' = floor((L + 2p - k)/s) + 1,  y[b, t, o] = bias[o] + sum_{j,c} x[b, s t + j - p, c] W[j, c, o]
 * (a correlation, as usual), then the activation, then pooling over windows of pool_size samples every
 * pool_stride: L'' = floor((L' - pool_size)/pool_stride) + 1. After the last block the (L'', O) numbers of
 * each series form one row. A dense layer with activation maps it to `plane` numbers (0: no such layer), and
 * the output layer to `outputs` logits.
 * Default: 3 blocks, channels 2C, 4C, 8C (4096 at most, fewer if one block would have 2^28 weights), kernel
 * 5, average pooling 2/2, plane 2. Without blocks, it is a perceptron of the whole series. */

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

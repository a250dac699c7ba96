/* Networks: multilayer perceptrons (lg_mlp), residual and multiplicative networks (lg_net), convolutional
 * networks (lg_cnn). Library liegrad. liegrad/fit.h trains them.
 *
 * A network is a small struct that describes the architecture. It is plain data without pointers: it may be
 * copied, needs no destruction, and does not change after its ..._init function. The parameters of a network
 * are not in the struct: they are a range of a flat vector theta of the caller, so that an optimiser, a file
 * and a gradient deal with a single array. The ..._initialise functions fill this vector, and the ..._record
 * functions put the network on a tape.
 *
 *   lg_mlp net;
 *   lg_status status = lg_mlp_init(&net, 2, (uint32_t[]){32, 32}, 2, 1, LG_TANH, true);
 *   lg_mlp_initialise(&net, &rng, theta);                    (theta: lg_mlp_parameters(&net) doubles)
 *   lg_var y = lg_mlp_record(tape, &net, lg_input_f64(tape, shape, theta), 0, x);
 *
 * Rules for all functions: B is the number of rows of a batch. Functions that get a tape keep errors on it
 * (liegrad/tape.h), and return LG_NONE or its status: LG_INVALID_ARGUMENT (theta is too short), LG_SHAPE (x
 * has another shape), LG_STALE_HANDLE. Several threads may use the same network, each with its own tape.
 */
#ifndef LIEGRAD_NETWORKS_H
#define LIEGRAD_NETWORKS_H

#include "liegrad/tape.h"

LG_BEGIN_DECLS

/* ---- multilayer perceptron: description ---- */

#define LG_MLP_MAX_LAYERS 16

/* a_0 = x, a_{l+1} = sigma_l(a_l W_l + b_l) for l = 0..layers-1; the output is a_layers. W_l has shape
 * (width[l], width[l+1]), b_l has shape (width[l+1]). sigma_l is `activation` in the hidden layers and the
 * identity in the last layer. The last layer has a bias only if `last_bias` is true. Order of the parameters:
 * W_0 (row-major), b_0, W_1, b_1, ... */
typedef struct lg_mlp {
    uint32_t layers;                       /* 1..LG_MLP_MAX_LAYERS, of which layers - 1 are hidden */
    uint32_t width[LG_MLP_MAX_LAYERS + 1]; /* of the input, the hidden layers, and the output */
    lg_activation activation;
    bool last_bias;
} lg_mlp;

/* Describes a network with widths inputs, hidden[0], ..., hidden[hidden_layers - 1], outputs. hidden_layers
 * may be 0, for an affine map; then `hidden` may be NULL. Errors: LG_INVALID_ARGUMENT (a width of 0 or above
 * 2^20, more than LG_MLP_MAX_LAYERS - 1 hidden layers, an unknown activation). */
LG_API lg_status lg_mlp_init(lg_mlp *net, uint32_t inputs, const uint32_t *hidden, uint32_t hidden_layers,
                             uint32_t outputs, lg_activation activation, bool last_bias);
LG_API size_t lg_mlp_parameters(const lg_mlp *net); /* number of parameters */
LG_API uint32_t lg_mlp_inputs(const lg_mlp *net);   /* width of the input */
LG_API uint32_t lg_mlp_outputs(const lg_mlp *net);  /* width of the output */
LG_API bool lg_mlp_has_bias(const lg_mlp *net,
                            uint32_t layer); /* all layers have one, except perhaps the last */
/* Return the index in the network's parameters at which the weight or the bias of a layer begins; layer <
 * net->layers. For a layer without a bias, it is the index at which a bias would begin. */
LG_API size_t lg_mlp_weight_offset(const lg_mlp *net, uint32_t layer);
LG_API size_t lg_mlp_bias_offset(const lg_mlp *net, uint32_t layer);

/* Fills theta[0 .. lg_mlp_parameters - 1] with initial parameters, layer by layer, first the weight and then
 * the bias: uniform in +-1/sqrt(fan_in), where fan_in is the number of inputs of the layer. */
LG_API void lg_mlp_initialise(const lg_mlp *net, lg_rng *rng, double *theta);
/* lg_mlp_initialise in the form of lg_fit_starts.draw (liegrad/fit.h). net is an lg_mlp. Draws every
 * parameter of the program that has lg_mlp_parameters(net) numbers, and leaves the others as they are. */
LG_API void lg_mlp_draw(void *net, size_t parameter, size_t count, lg_rng *rng, double *theta);

/* ---- multilayer perceptron: on a tape ---- */

/* Weights and biases of a network as variables on a tape, which refer to the flat vector without copies.
 * `bias` is LG_NONE for a layer without a bias. Valid until the flat vector is rewound. */
typedef struct lg_mlp_vars {
    lg_var weight[LG_MLP_MAX_LAYERS], bias[LG_MLP_MAX_LAYERS];
} lg_mlp_vars;

/* Cuts the flat vector theta (rank 1) into weights and biases. The network's parameters are its elements
 * offset .. offset + lg_mlp_parameters - 1. Errors: the status of the tape. */
LG_API lg_status lg_mlp_bind(lg_tape *tape, const lg_mlp *net, lg_var theta, size_t offset,
                             lg_mlp_vars *vars);
/* Applies the network to x (B, in) -> (B, out), with the weights of lg_mlp_bind. */
LG_API lg_var lg_mlp_record_bound(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var x);
/* Gradient of the first output by the input: (B, in) -> (B, in). Row b is the gradient at row b of x. It is
 * recorded, so it can be differentiated again by theta and x. */
LG_API lg_var lg_mlp_record_gradient(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var x);
/* lg_mlp_bind and lg_mlp_record_bound in one call: x (B, in) -> (B, out). */
LG_API lg_var lg_mlp_record(lg_tape *tape, const lg_mlp *net, lg_var theta, size_t offset, lg_var x);

/* ---- residual and multiplicative networks ----
 *
 * lg_net describes networks of several architectures, with or without a periodic embedding of the inputs. All
 * hidden layers have the same width; lg_mlp allows different widths. The functions work like the functions of
 * lg_mlp with the same endings.
 *
 * Input x (B, in), output y (B, out), h = hidden, l = layers, sigma = activation. A weight W has shape (in,
 * out); each W, A, B and b below is a parameter of its own. "o" multiplies elementwise. "l times" means: l
 * layers, each with its own parameters.
 *
 *   embedding e > 0:  first x <- sin(2 pi (x A + b)), of shape (B, e); e = 0: x stays as it is
 *   LG_NET_MLP        H = sigma(x W + b), then l times H <- sigma(H W + b), y = H W + b
 *   LG_NET_RESNET     H = sigma(x W + b), then l times H <- H + sigma(H A + b) B, y = H W + b
 *   LG_NET_MULT       U = sigma(x W_1 + b_1), V = sigma(x W_2 + b_2), H = sigma(x W_3 + b_3), then l times
 *                     Z = sigma(H W_z + b_z), H <- (1 - Z) o U + Z o V, y = H W + b
 *   LG_NET_MULT_AFFINE  like LG_NET_MULT, but Z = sigma(H W_z + b_z) W_o + b_o, so Z is not bounded by sigma
 *
 * So `layers` does not count the first layer, which maps the input to width h. Sources: He et al. 2016
 * (residual networks), Wang, Teng & Perdikaris 2021 (multiplicative networks). */

typedef enum lg_net_kind { LG_NET_MLP, LG_NET_RESNET, LG_NET_MULT, LG_NET_MULT_AFFINE } lg_net_kind;
#define LG_NET_KIND_COUNT 4
/* Returns "mlp", "resnet", "mult" or "mult-affine"; "unknown" for another value. */
LG_API const char *lg_net_kind_name(lg_net_kind kind);

#define LG_NET_MAX_LAYERS 14

/* Made by lg_net_init. */
typedef struct lg_net {
    lg_net_kind kind;
    uint32_t inputs, outputs;
    uint32_t embedding; /* e; 0: no embedding */
    uint32_t hidden;    /* h */
    uint32_t layers;    /* l, 0..LG_NET_MAX_LAYERS */
    lg_activation activation;
} lg_net;

/* Describes a network. Errors: LG_INVALID_ARGUMENT (a width of 0 or above 2^20, too many layers, an unknown
 * kind or activation). `embedding` may be 0. */
LG_API lg_status lg_net_init(lg_net *net, lg_net_kind kind, uint32_t inputs, uint32_t embedding,
                             uint32_t hidden, uint32_t layers, uint32_t outputs, lg_activation activation);
LG_API size_t lg_net_parameters(const lg_net *net); /* number of parameters */

/* A named range of a network's parameters: one weight or one bias. Files store parameters by these names. The
 * parameters of lg_net are the weight and then the bias of each of these layers, in this order:
 * - "embedding", if there is one
 * - LG_NET_MLP: "layer1", ..., "layer<l + 1>"
 * - LG_NET_RESNET: "first", then "inner<i>" (A and b) and "outer<i>" (B, no bias) for i = 1..l
 * - LG_NET_MULT: "u", "v", "first", then "gate<i>" (W_z, b_z) for i = 1..l; LG_NET_MULT_AFFINE has
 *   "affine<i>" (W_o, b_o) after each "gate<i>"
 * - "output"
 *
 * Without an embedding, LG_NET_MLP has the same parameters in the same order as an lg_mlp of the
 *   same widths with last_bias. */
typedef struct lg_slice_info {
    char name[48];        /* "embedding/weight", "layer1/bias", "gate2/weight", ... */
    uint32_t rank;        /* 1: bias (out); 2: weight (in, out); 3: weight of a convolution (k, C, O) */
    uint64_t dims[4];     /* the shape; row-major */
    size_t offset, count; /* first element in the network's parameters, and number of elements */
} lg_slice_info;
/* Gives the range number `index` = 0, 1, ..., in the order of the parameters. Returns false if there are not
 * so many. */
LG_API bool lg_net_slice(const lg_net *net, uint32_t index, lg_slice_info *out);

/* Fills theta[0 .. lg_net_parameters - 1] as lg_mlp_initialise does, the embedding like every
 * other layer. */
LG_API void lg_net_initialise(const lg_net *net, lg_rng *rng, double *theta);

/* ---- residual and multiplicative networks: on a tape ---- */

/* Applies the network: x (B, in) -> (B, out). theta is a flat vector (rank 1); the network's parameters are
 * its elements offset .. offset + lg_net_parameters - 1. */
LG_API lg_var lg_net_record(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x);
/* Value and directional derivative in one pass: *y = network(x) (B, out) and *dy = (dy/dx) dx (B, out), for a
 * direction dx (B, in) or (1, in). Both are recorded and can be differentiated again by theta and x. The
 * result equals lg_jvp of lg_net_record up to rounding, and takes less work. Errors: the status of the tape;
 * then *y and *dy are unchanged. */
LG_API lg_status lg_net_record_jvp(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x,
                                   lg_var dx, lg_var *y, lg_var *dy);

/* ---- convolutional networks ----
 *
 * One-dimensional convolutional networks for classification of series: blocks of convolution, activation and
 * pooling, then dense layers.
 *
 * x has shape (B, L, C): B series of L samples with C channels. A block has a kernel of k samples, stride s,
 * padding p (zeros at both ends) and O = `channels` output channels. It computes
 *   y[b, t, o] = bias[o] + sum_{j,c} x[b, s t + j - p, c] W[j, c, o],   L' = floor((L + 2p - k)/s) + 1
 * (a correlation, as usual), then the activation, then pooling over windows of pool_size samples that begin
 * every pool_stride samples, which leaves L'' = floor((L' - pool_size)/pool_stride) + 1 samples. After the
 * last block, the L'' O numbers of a series form one row. A dense layer called "plane", with activation, maps
 * this row to `plane` numbers; it is missing if plane = 0. The output layer, without activation, maps to
 * `outputs` logits. A network without blocks is a perceptron that reads the whole series. */

typedef enum lg_pooling { LG_POOL_NONE, LG_POOL_AVERAGE, LG_POOL_MAX } lg_pooling;
#define LG_POOLING_COUNT 3
/* Returns "none", "average" or "max"; "unknown" for another value. */
LG_API const char *lg_pooling_name(lg_pooling kind);

typedef struct lg_cnn_block {
    uint32_t channels, kernel, stride, padding; /* kernel, stride >= 1; padding < kernel */
    lg_pooling pooling;
    uint32_t pool_size, pool_stride; /* >= 1; not used for LG_POOL_NONE */
} lg_cnn_block;

#define LG_CNN_MAX_BLOCKS 8

/* Fill in the members (or call lg_cnn_init_default), then call lg_cnn_init. */
typedef struct lg_cnn {
    uint32_t channels, length; /* C and L of the input */
    uint32_t blocks;           /* 0..LG_CNN_MAX_BLOCKS */
    lg_cnn_block block[LG_CNN_MAX_BLOCKS];
    uint32_t plane;   /* width of the dense layer before the output layer; 0: no such layer */
    uint32_t outputs; /* >= 1 */
    lg_activation activation;
    /* Set by lg_cnn_init: number of samples of the input, and after each block. */
    uint32_t lengths[LG_CNN_MAX_BLOCKS + 1];
} lg_cnn;

/* Describes the default network for series of this size, and calls lg_cnn_init: 3 blocks with 2C, 4C and 8C
 * channels, kernel 5, stride 1, no padding, average pooling with size and stride 2; plane 2. A block has at
 * most 4096 channels, and fewer if it would have more than 2^28 weights. Short series get fewer blocks and a
 * shorter last kernel, which is never longer than the series that reaches it; a block that leaves one sample
 * has no pooling. The result is valid if channels, length and outputs are at least 1 and within the limits of
 * lg_cnn_init. Otherwise it is not valid, and a further call of lg_cnn_init tells why. */
LG_API void lg_cnn_init_default(lg_cnn *net, uint32_t channels, uint32_t length, uint32_t outputs,
                                lg_activation activation);
/* Checks the members and sets `lengths`. Errors: LG_INVALID_ARGUMENT (sizes of 0 or above 2^20, more than
 * 2^31 parameters, or a block that leaves no sample). Then the message names the block, and *net is
 * unchanged. */
LG_API lg_status lg_cnn_init(lg_cnn *net, lg_error *error);

LG_API size_t lg_cnn_parameters(const lg_cnn *net); /* number of parameters */
/* Gives the range number `index` = 0, 1, ... of the parameters, in their order: "conv1/weight" (k, C, O),
 * "conv1/bias" (O), "conv2/weight", ..., "plane/weight" (L'' O, plane), "plane/bias" (plane),
 * "output/weight", "output/bias". Returns false if there are not so many. */
LG_API bool lg_cnn_slice(const lg_cnn *net, uint32_t index, lg_slice_info *out);
/* Fills theta[0 .. lg_cnn_parameters - 1] with initial parameters, in their order. For a convolution fan_in =
 * k C. */
LG_API void lg_cnn_initialise(const lg_cnn *net, lg_rng *rng, double *theta);

/* Applies the network: x (B, length, channels) -> logits (B, outputs). theta is a flat vector (rank 1); the
 * network's parameters are its elements offset .. offset + lg_cnn_parameters - 1. `plane` may be NULL;
 * otherwise *plane becomes the output of the layer "plane" (B, plane), or LG_NONE if there is no such layer
 * or on failure. */
LG_API lg_var lg_cnn_record(lg_tape *tape, const lg_cnn *net, lg_var theta, size_t offset, lg_var x,
                            lg_var *plane);

LG_END_DECLS

#endif

/* Networks of several architectures behind one description: multilayer perceptrons, residual and
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
 * Perdikaris 2021 (multiplicative).
 */
#ifndef LIEGRAD_NETWORKS_H
#define LIEGRAD_NETWORKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/export.h"
#include "liegrad/nn.h"
#include "liegrad/random.h"
#include "liegrad/status.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

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

LG_END_DECLS

#endif

/* Networks of dense layers (liegrad/networks.h): the embedding; the "heads", which read the embedded input
 * (U, V and H of the gated kinds, else H only); one or two "steps" for each of the l layers; the output
 * layer. */
#ifndef LG_NET_H
#define LG_NET_H

#include "nn/layers.h"

#define NET_MAX_HEADS 3
#define NET_MAX_STEPS 2
#define NET_MAX_DENSE (1 + NET_MAX_HEADS + NET_MAX_STEPS * LG_NET_MAX_LAYERS + 1)

/* The dense layers between embedding and output. A dense layer of layer i = 0, 1, ... is called by its name
 * in `step` and the number i + `number`, such as "gate1". */
typedef struct net_body {
    const char *name;
    uint32_t heads, steps; /* steps: dense layers in each of the l layers */
    const char *head[NET_MAX_HEADS];
    struct {
        const char *name;
        bool has_bias;
    } step[NET_MAX_STEPS];
    uint32_t number;
    bool gated; /* the layers are H <- (1 - Z) o U + Z o V, where o multiplies elementwise */
} net_body;
const net_body *lg_net_body(const lg_net *net);

/* All dense layers: the embedding, if there is one; the heads; the steps; the output layer. */
lg_layers lg_net_layers(const lg_net *net);

/* What a dense layer reads, x (B, in), and what it computes before its activation, x W + b (B, out). */
typedef struct lg_net_tap {
    lg_var input, output;
} lg_net_tap;
/* The same as lg_net_record. taps: NULL, or one element per dense layer, which is filled in; then products
 * and activations are recorded as separate operations. */
lg_var lg_net_record_taps(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x,
                          lg_net_tap *taps);

#define LG_TWO_PI 6.283185307179586476925286766559

#endif

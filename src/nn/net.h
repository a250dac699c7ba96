/* The dense layers of a network (liegrad/networks.h) in the order of its parameters in the flat vector:
 * embedding, the layers that read the input of the network ("heads": U, V and H for the gated kinds), one or
 * two for each of its l layers, the output. */
#ifndef LG_NET_H
#define LG_NET_H

#include "liegrad/networks.h"

#define NET_MAX_HEADS 3
#define NET_MAX_STEPS 2
#define NET_MAX_DENSE (1 + NET_MAX_HEADS + NET_MAX_STEPS * LG_NET_MAX_LAYERS + 1)

typedef struct net_dense {
    uint32_t in, out;
    bool has_bias;
    size_t weight, bias; /* where they begin; `bias` is where the weight ends */
} net_dense;

typedef struct net_layout {
    uint32_t count;
    uint32_t heads, first_head; /* how many, and which dense layer is the first */
    uint32_t steps, first_step; /* dense layers in each of the l layers */
    size_t parameters;
    net_dense dense[NET_MAX_DENSE]; /* dense[0] is the embedding where there is one, the last the output */
} net_layout;

void lg_net_layout(const lg_net *net, net_layout *layout);

/* What a dense layer of net_layout reads, x (B, in), and gives before its activation, x W + b (B, out). */
typedef struct lg_net_tap {
    lg_var input, output;
} lg_net_tap;
/* lg_net_record; taps: NULL, or one for each dense layer, whose products and activations are then recorded
 * apart. */
lg_var lg_net_record_taps(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x,
                          lg_net_tap *taps);

/* Whether H <- (1 - Z) o U + Z o V. */
bool lg_net_gated(const lg_net *net);

#define LG_TWO_PI 6.283185307179586476925286766559

#endif

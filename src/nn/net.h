/* Networks of dense layers (liegrad/networks.h): the embedding; the "heads", which read the embedded input
 * (U, V and H of the gated kinds, else H only); one or two "steps" for each of the l layers; the output
 * layer. */
#ifndef LG_NET_H
#define LG_NET_H

#include "nn/layers.h"

#define NET_MAX_HEADS 3
#define NET_MAX_STEPS 2
#define NET_MAX_DENSE (1 + NET_MAX_HEADS + NET_MAX_STEPS * LG_NET_MAX_LAYERS + 1)

typedef struct net_layout {
    lg_layers all; /* the embedding, if there is one, is the first; the output layer is the last */
    uint32_t heads, first_head; /* number of heads, and the index of the first one */
    /* number of dense layers in each of the l layers, and the index of the first one */
    uint32_t steps, first_step;
} net_layout;

void lg_net_layout(const lg_net *net, net_layout *layout);

/* What a dense layer reads, x (B, in), and what it computes before its activation, x W + b (B, out). */
typedef struct lg_net_tap {
    lg_var input, output;
} lg_net_tap;
/* The same as lg_net_record. taps: NULL, or one element per dense layer, which is filled in; then products
 * and activations are recorded as separate operations. */
lg_var lg_net_record_taps(lg_tape *tape, const lg_net *net, lg_var theta, size_t offset, lg_var x,
                          lg_net_tap *taps);

/* Whether the layers are H <- (1 - Z) o U + Z o V, where o multiplies elementwise. */
bool lg_net_gated(const lg_net *net);

#define LG_TWO_PI 6.283185307179586476925286766559

#endif

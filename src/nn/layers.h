/* The layers of a network (liegrad/networks.h), in the order of their parameters in the flat vector. A bias
 * follows its weight. */
#ifndef LG_LAYERS_H
#define LG_LAYERS_H

#include "liegrad/networks.h"

#define LG_MOST_LAYERS 33 /* of all kinds of networks */
/* Whether a number of units, channels or samples is possible. */
static inline bool lg_layers_size_fits(uint32_t size) {
    return size >= 1 && size <= (uint32_t)1 << 20;
}

/* One layer y = x W + b with W (in, out). For a convolution x is the part of the input below the kernel. */
typedef struct lg_layer {
    const char *name; /* of its slices: "gate" */
    uint32_t number;  /* follows the name, as in "gate1"; 0: none */
    size_t in;
    uint32_t out;
    uint32_t kernel; /* length in samples; 0: dense layer */
    bool has_bias;
    size_t weight, bias; /* offsets in the flat vector; without a bias, `bias` is where the weight ends */
} lg_layer;

typedef struct lg_layers {
    uint32_t count;
    size_t parameters;
    lg_layer layer[LG_MOST_LAYERS];
} lg_layers;

void lg_layers_add(lg_layers *layers, const char *name, uint32_t number, size_t in, uint32_t out,
                   uint32_t kernel, bool has_bias);
/* Slice `index`: weights and biases in their order. Returns false beyond the last one. */
bool lg_layers_slice(const lg_layers *layers, uint32_t index, lg_slice_info *out);
void lg_layers_initialise(const lg_layers *layers, lg_rng *rng, double *theta);
/* Records weights and biases as views of theta from `offset` on; LG_NONE for a missing bias. `what` names the
 * network in the error if they end beyond 2^32 elements. Returns the tape's status. */
lg_status lg_layers_bind(lg_tape *tape, const lg_layers *layers, const char *what, lg_var theta,
                         size_t offset, lg_var *weight, lg_var *bias);

#endif

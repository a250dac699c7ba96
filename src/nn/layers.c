#include "nn/layers.h"

#include <math.h>
#include <stdio.h>

#include "core/core.h"
#include "liegrad/ops.h"

void lg_layers_add(lg_layers *layers, const char *name, uint32_t number, size_t in, uint32_t out,
                   uint32_t kernel, bool has_bias) {
    const size_t weight = layers->parameters, bias = weight + in * out;
    layers->layer[layers->count++] = (lg_layer){name, number, in, out, kernel, has_bias, weight, bias};
    layers->parameters = bias + (has_bias ? out : 0);
}

bool lg_layers_slice(const lg_layers *layers, uint32_t index, lg_slice_info *out) {
    const lg_layer *l = layers->layer, *end = l + layers->count;
    for (; l < end && index > l->has_bias; l++) index -= 1 + l->has_bias;
    if (l == end) return false;
    char number[12] = "";
    if (l->number > 0) (void)snprintf(number, sizeof number, "%u", (unsigned)l->number);
    const bool weight = index == 0, dense = l->kernel == 0;
    lg_slice_info info = {.rank = 1, .dims = {l->out}, .offset = l->bias, .count = l->out};
    if (weight)
        info = (lg_slice_info){
            .rank = dense ? 2 : 3,
            .dims = {dense ? l->in : l->kernel, dense ? l->out : l->in / l->kernel, dense ? 0 : l->out},
            .offset = l->weight,
            .count = l->in * l->out};
    (void)snprintf(info.name, sizeof info.name, "%s%s/%s", l->name, number, weight ? "weight" : "bias");
    *out = info;
    return true;
}

void lg_layers_initialise(const lg_layers *layers, lg_rng *rng, double *theta) {
    for (const lg_layer *l = layers->layer; l < layers->layer + layers->count; l++) {
        const double scale = sqrt(1.0 / (double)l->in);
        const size_t drawn = l->in * l->out + (l->has_bias ? l->out : 0);
        for (size_t i = 0; i < drawn; i++) theta[l->weight + i] = lg_rng_uniform_in(rng, -scale, scale);
    }
}

lg_status lg_layers_bind(lg_tape *tape, const lg_layers *layers, const char *what, lg_var theta,
                         size_t offset, lg_var *weight, lg_var *bias) {
    const bool fits = layers->parameters <= UINT32_MAX && offset <= UINT32_MAX - layers->parameters;
    if (lg_tape_status(tape) == LG_OK && !fits)
        (void)lg_tape_fail(tape, LG_SHAPE, what, "the parameters of the network end beyond 2^32 elements");
    for (uint32_t i = 0; i < layers->count; i++) {
        const lg_layer *l = &layers->layer[i];
        const uint32_t in = (uint32_t)l->in, at = (uint32_t)(offset + l->weight);
        const lg_var flat = lg_slice(tape, theta, 0, at, in * l->out);
        weight[i] =
            lg_reshape(tape, flat,
                       l->kernel == 0 ? lg_shape2(in, l->out) : lg_shape3(l->kernel, in / l->kernel, l->out));
        bias[i] = l->has_bias ? lg_slice(tape, theta, 0, (uint32_t)(offset + l->bias), l->out) : LG_NONE;
    }
    return lg_tape_status(tape);
}

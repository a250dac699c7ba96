/* Networks of several architectures: description, slices of the parameter vector, initialisation. */
#include "nn/net.h"

#include <stdio.h>

#include "core/core.h"

#define MAX_WIDTH (1u << 20)

/* The dense layers between embedding and output, for each kind of network. A dense layer of layer i = 0, 1,
 * ... is called by its name in `steps` and the number i + `number`, such as "gate1". */
static const struct body {
    const char *name;
    const char *heads[NET_MAX_HEADS];
    struct {
        const char *name;
        bool has_bias;
    } steps[NET_MAX_STEPS];
    uint32_t number;
    bool gated;
} bodies[LG_NET_KIND_COUNT] = {
    [LG_NET_MLP] = {"mlp", {"layer1"}, {{"layer", true}}, 2, false},
    [LG_NET_RESNET] = {"resnet", {"first"}, {{"inner", true}, {"outer", false}}, 1, false},
    [LG_NET_MULT] = {"mult", {"u", "v", "first"}, {{"gate", true}}, 1, true},
    [LG_NET_MULT_AFFINE] = {"mult-affine", {"u", "v", "first"}, {{"gate", true}, {"affine", true}}, 1, true},
};

const char *lg_net_kind_name(lg_net_kind kind) {
    return (unsigned)kind < LG_NET_KIND_COUNT ? bodies[kind].name : "unknown";
}

static bool width_fits(uint32_t width) {
    return width > 0 && width <= MAX_WIDTH;
}

lg_status lg_net_init(lg_net *net, lg_net_kind kind, uint32_t inputs, uint32_t embedding, uint32_t hidden,
                      uint32_t layers, uint32_t outputs, lg_activation activation) {
    if (net == NULL || (unsigned)kind >= LG_NET_KIND_COUNT || (unsigned)activation >= LG_ACTIVATION_COUNT)
        return LG_INVALID_ARGUMENT;
    if (!width_fits(inputs) || !width_fits(hidden) || !width_fits(outputs) || embedding > MAX_WIDTH ||
        layers > LG_NET_MAX_LAYERS)
        return LG_INVALID_ARGUMENT;
    *net = (lg_net){.kind = kind,
                    .inputs = inputs,
                    .outputs = outputs,
                    .embedding = embedding,
                    .hidden = hidden,
                    .layers = layers,
                    .activation = activation};
    return LG_OK;
}

/* ---- layout ---- */

static void append(net_layout *layout, uint32_t in, uint32_t out, bool has_bias) {
    net_dense *d = &layout->dense[layout->count++];
    *d = (net_dense){in, out, has_bias, layout->parameters, layout->parameters + (size_t)in * out};
    layout->parameters = d->bias + (has_bias ? out : 0);
}

void lg_net_layout(const lg_net *net, net_layout *layout) {
    const struct body *body = &bodies[net->kind];
    const uint32_t h = net->hidden, in = net->embedding > 0 ? net->embedding : net->inputs;
    layout->count = layout->heads = layout->steps = 0;
    layout->parameters = 0;
    if (net->embedding > 0) append(layout, net->inputs, net->embedding, true);
    layout->first_head = layout->count;
    while (layout->heads < NET_MAX_HEADS && body->heads[layout->heads] != NULL) {
        append(layout, in, h, true);
        layout->heads++;
    }
    layout->first_step = layout->count;
    while (layout->steps < NET_MAX_STEPS && body->steps[layout->steps].name != NULL) layout->steps++;
    for (uint32_t l = 0; l < net->layers; l++)
        for (uint32_t s = 0; s < layout->steps; s++) append(layout, h, h, body->steps[s].has_bias);
    append(layout, h, net->outputs, true);
}

bool lg_net_gated(const lg_net *net) {
    return bodies[net->kind].gated;
}

size_t lg_net_parameters(const lg_net *net) {
    net_layout layout;
    lg_net_layout(net, &layout);
    return layout.parameters;
}

/* ---- names ---- */

static void name_dense(const lg_net *net, const net_layout *layout, uint32_t i, char *name, size_t size) {
    const struct body *body = &bodies[net->kind];
    if (i < layout->first_head) {
        (void)snprintf(name, size, "embedding");
    } else if (i < layout->first_step) {
        (void)snprintf(name, size, "%s", body->heads[i - layout->first_head]);
    } else if (i + 1 < layout->count) {
        const uint32_t at = i - layout->first_step;
        (void)snprintf(name, size, "%s%u", body->steps[at % layout->steps].name,
                       (unsigned)(at / layout->steps + body->number));
    } else {
        (void)snprintf(name, size, "output");
    }
}

bool lg_net_slice(const lg_net *net, uint32_t index, lg_slice_info *out) {
    net_layout layout;
    char name[32];
    lg_net_layout(net, &layout);
    for (uint32_t i = 0, at = 0; i < layout.count; i++) {
        const net_dense *d = &layout.dense[i];
        const uint32_t pieces = d->has_bias ? 2 : 1;
        if (index >= at + pieces) {
            at += pieces;
            continue;
        }
        const bool weight = index == at;
        lg_slice_info info = {.rank = weight ? 2 : 1, .offset = weight ? d->weight : d->bias};
        info.dims[0] = weight ? d->in : d->out;
        info.dims[1] = weight ? d->out : 0;
        info.count = weight ? (size_t)d->in * d->out : d->out;
        name_dense(net, &layout, i, name, sizeof name);
        (void)snprintf(info.name, sizeof info.name, "%s/%s", name, weight ? "weight" : "bias");
        *out = info;
        return true;
    }
    return false;
}

/* ---- initialisation ---- */

void lg_net_initialise(const lg_net *net, lg_initialisation kind, lg_rng *rng, double *theta) {
    net_layout layout;
    lg_net_layout(net, &layout);
    for (uint32_t i = 0; i < layout.count; i++) {
        const net_dense *d = &layout.dense[i];
        const lg_mlp one = {
            .layers = 1, .width = {d->in, d->out}, .activation = net->activation, .last_bias = d->has_bias};
        lg_mlp_initialise_as(&one, kind, rng, theta + d->weight);
    }
}

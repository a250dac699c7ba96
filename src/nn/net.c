/* Networks of several architectures: description, slices of the parameter vector, initialisation. */
#include "nn/net.h"

#include "core/core.h"

static const net_body bodies[LG_NET_KIND_COUNT] = {
    [LG_NET_MLP] = {"mlp", 1, 1, {"layer1"}, {{"layer", true}}, 2, false},
    [LG_NET_RESNET] = {"resnet", 1, 2, {"first"}, {{"inner", true}, {"outer", false}}, 1, false},
    [LG_NET_MULT] = {"mult", 3, 1, {"u", "v", "first"}, {{"gate", true}}, 1, true},
    [LG_NET_MULT_AFFINE] =
        {"mult-affine", 3, 2, {"u", "v", "first"}, {{"gate", true}, {"affine", true}}, 1, true},
};

const char *lg_net_kind_name(lg_net_kind kind) {
    return (unsigned)kind < LG_NET_KIND_COUNT ? bodies[kind].name : "unknown";
}

lg_status lg_net_init(lg_net *net, lg_net_kind kind, uint32_t inputs, uint32_t embedding, uint32_t hidden,
                      uint32_t layers, uint32_t outputs, lg_activation activation) {
    if (net == NULL || (unsigned)kind >= LG_NET_KIND_COUNT || (unsigned)activation >= LG_ACTIVATION_COUNT)
        return LG_INVALID_ARGUMENT;
    if (!lg_layers_size_fits(inputs) || !lg_layers_size_fits(hidden) || !lg_layers_size_fits(outputs) ||
        (embedding > 0 && !lg_layers_size_fits(embedding)) || layers > LG_NET_MAX_LAYERS)
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

const net_body *lg_net_body(const lg_net *net) {
    return &bodies[net->kind];
}

lg_layers lg_net_layers(const lg_net *net) {
    const net_body *body = lg_net_body(net);
    const uint32_t h = net->hidden, in = net->embedding > 0 ? net->embedding : net->inputs;
    lg_layers all = {.count = 0};
    if (net->embedding > 0) lg_layers_add(&all, "embedding", 0, net->inputs, net->embedding, 0, true);
    for (uint32_t i = 0; i < body->heads; i++) lg_layers_add(&all, body->head[i], 0, in, h, 0, true);
    for (uint32_t l = 0; l < net->layers; l++)
        for (uint32_t s = 0; s < body->steps; s++)
            lg_layers_add(&all, body->step[s].name, l + body->number, h, h, 0, body->step[s].has_bias);
    lg_layers_add(&all, "output", 0, h, net->outputs, 0, true);
    return all;
}

size_t lg_net_parameters(const lg_net *net) {
    return lg_net_layers(net).parameters;
}

bool lg_net_slice(const lg_net *net, uint32_t index, lg_slice_info *out) {
    const lg_layers layers = lg_net_layers(net);
    return lg_layers_slice(&layers, index, out);
}

void lg_net_initialise(const lg_net *net, lg_rng *rng, double *theta) {
    const lg_layers layers = lg_net_layers(net);
    lg_layers_initialise(&layers, rng, theta);
}

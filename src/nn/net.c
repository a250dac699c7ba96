/* Networks of several architectures: description, slices of the parameter vector, initialisation. */
#include "nn/net.h"

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

void lg_net_layout(const lg_net *net, net_layout *layout) {
    const struct body *body = &bodies[net->kind];
    const uint32_t h = net->hidden, in = net->embedding > 0 ? net->embedding : net->inputs;
    lg_layers *all = &layout->all;
    all->count = layout->heads = layout->steps = 0;
    all->parameters = 0;
    if (net->embedding > 0) lg_layers_add(all, "embedding", 0, net->inputs, net->embedding, 0, true);
    layout->first_head = all->count;
    while (layout->heads < NET_MAX_HEADS && body->heads[layout->heads] != NULL)
        lg_layers_add(all, body->heads[layout->heads++], 0, in, h, 0, true);
    layout->first_step = all->count;
    while (layout->steps < NET_MAX_STEPS && body->steps[layout->steps].name != NULL) layout->steps++;
    for (uint32_t l = 0; l < net->layers; l++)
        for (uint32_t s = 0; s < layout->steps; s++)
            lg_layers_add(all, body->steps[s].name, l + body->number, h, h, 0, body->steps[s].has_bias);
    lg_layers_add(all, "output", 0, h, net->outputs, 0, true);
}

bool lg_net_gated(const lg_net *net) {
    return bodies[net->kind].gated;
}

size_t lg_net_parameters(const lg_net *net) {
    net_layout layout;
    lg_net_layout(net, &layout);
    return layout.all.parameters;
}

bool lg_net_slice(const lg_net *net, uint32_t index, lg_slice_info *out) {
    net_layout layout;
    lg_net_layout(net, &layout);
    return lg_layers_slice(&layout.all, index, out);
}

void lg_net_initialise(const lg_net *net, lg_rng *rng, double *theta) {
    net_layout layout;
    lg_net_layout(net, &layout);
    lg_layers_initialise(&layout.all, rng, theta);
}

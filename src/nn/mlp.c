/* Multilayer perceptrons: description, initialisation, application on a tape. */
#include "liegrad/networks.h"
#include "liegrad/ops.h"

#include "autodiff/tape/tape_internal.h"
#include "core/core.h"
#include "nn/layers.h"

lg_status lg_mlp_init(lg_mlp *net, uint32_t inputs, const uint32_t *hidden, uint32_t hidden_layers,
                      uint32_t outputs, lg_activation activation, bool last_bias) {
    if (net == NULL || hidden_layers >= LG_MLP_MAX_LAYERS || (hidden == NULL && hidden_layers > 0))
        return LG_INVALID_ARGUMENT;
    if ((int)activation < 0 || (int)activation >= LG_ACTIVATION_COUNT) return LG_INVALID_ARGUMENT;
    lg_mlp made = {.layers = hidden_layers + 1, .activation = activation, .last_bias = last_bias};
    made.width[0] = inputs;
    for (uint32_t i = 0; i < hidden_layers; i++) made.width[i + 1] = hidden[i];
    made.width[made.layers] = outputs;
    for (uint32_t i = 0; i <= made.layers; i++)
        if (!lg_layers_size_fits(made.width[i])) return LG_INVALID_ARGUMENT;
    *net = made;
    return LG_OK;
}

uint32_t lg_mlp_inputs(const lg_mlp *net) {
    return net->width[0];
}

uint32_t lg_mlp_outputs(const lg_mlp *net) {
    return net->width[net->layers];
}

bool lg_mlp_has_bias(const lg_mlp *net, uint32_t layer) {
    return net->last_bias || layer + 1 < net->layers;
}

static lg_layers layers_of(const lg_mlp *net) {
    lg_layers layers = {.count = 0};
    for (uint32_t l = 0; l < net->layers; l++)
        lg_layers_add(&layers, "layer", l + 1, net->width[l], net->width[l + 1], 0, lg_mlp_has_bias(net, l));
    return layers;
}

size_t lg_mlp_weight_offset(const lg_mlp *net, uint32_t layer) {
    const lg_layers layers = layers_of(net);
    return layer < layers.count ? layers.layer[layer].weight : layers.parameters;
}

size_t lg_mlp_bias_offset(const lg_mlp *net, uint32_t layer) {
    return lg_mlp_weight_offset(net, layer) + (size_t)net->width[layer] * net->width[layer + 1];
}

size_t lg_mlp_parameters(const lg_mlp *net) {
    return lg_mlp_weight_offset(net, net->layers);
}

void lg_mlp_initialise(const lg_mlp *net, lg_rng *rng, double *theta) {
    const lg_layers layers = layers_of(net);
    lg_layers_initialise(&layers, rng, theta);
}

void lg_mlp_draw(void *net, size_t parameter, size_t count, lg_rng *rng, double *theta) {
    if (count == lg_mlp_parameters(net)) lg_mlp_initialise(net, rng, theta);
}

/* ---- on a tape ---- */

lg_status lg_mlp_bind(lg_tape *tape, const lg_mlp *net, lg_var theta, size_t offset, lg_mlp_vars *vars) {
    LG_TRY(lg_tape_needs(tape, "mlp", net != NULL && vars != NULL));
    lg_mlp_vars bound;
    const lg_layers layers = layers_of(net);
    LG_TRY(lg_layers_bind(tape, &layers, "mlp", theta, offset, bound.weight, bound.bias));
    *vars = bound;
    return LG_OK;
}

lg_var lg_mlp_record_bound(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var x) {
    lg_var a = x;
    for (uint32_t l = 0; l < net->layers; l++) {
        const lg_activation kind = l + 1 < net->layers ? net->activation : LG_IDENTITY;
        a = lg_dense(tape, a, vars->weight[l], vars->bias[l], kind);
    }
    return a;
}

lg_var lg_mlp_record_gradient(lg_tape *tape, const lg_mlp *net, const lg_mlp_vars *vars, lg_var x) {
    lg_var y = lg_mlp_record_bound(tape, net, vars, x);
    if (lg_mlp_outputs(net) > 1) y = lg_slice(tape, y, 1, 0, 1);
    lg_var gradient = LG_NONE;
    return lg_grad(tape, y, &x, 1, &gradient) == LG_OK ? gradient : LG_NONE;
}

lg_var lg_mlp_record(lg_tape *tape, const lg_mlp *net, lg_var theta, size_t offset, lg_var x) {
    lg_mlp_vars vars;
    if (lg_mlp_bind(tape, net, theta, offset, &vars) != LG_OK) return LG_NONE;
    return lg_mlp_record_bound(tape, net, &vars, x);
}

/* Networks as C: a table of dense layers, where arrays lie in work, and the fragments that run over them. */
#include <stdlib.h>
#include <string.h>

#include "lg-export/export.h"

/* The pieces of the parameter vector, in its order, and how many of them are weights. */
typedef struct slices {
    lg_slice_info *at;
    size_t count, layers;
} slices;

enum { SLICES_MAX = 2 * (LG_MLP_MAX_LAYERS + 2 * LG_NET_MAX_LAYERS + 5) };

static slices slices_of_net(const lg_net *net) {
    slices s = {.at = app_alloc(SLICES_MAX, sizeof *s.at)};
    while (s.count < SLICES_MAX && lg_net_slice(net, (uint32_t)s.count, &s.at[s.count]))
        if (s.at[s.count++].rank > 1) s.layers++;
    return s;
}

static slices slices_of_mlp(const lg_mlp *net) {
    slices s = {.at = app_alloc(SLICES_MAX, sizeof *s.at), .layers = net->layers};
    for (uint32_t l = 0; l < net->layers; l++) {
        const uint64_t in = net->width[l], out = net->width[l + 1];
        lg_slice_info weight = {.rank = 2, .dims = {in, out}, .offset = lg_mlp_weight_offset(net, l)};
        lg_slice_info bias = {.rank = 1, .dims = {out}, .offset = lg_mlp_bias_offset(net, l), .count = out};
        weight.count = (size_t)(in * out);
        (void)snprintf(weight.name, sizeof weight.name, "layer%lu/weight", (unsigned long)l + 1);
        (void)snprintf(bias.name, sizeof bias.name, "layer%lu/bias", (unsigned long)l + 1);
        s.at[s.count++] = weight;
        if (lg_mlp_has_bias(net, l)) s.at[s.count++] = bias;
    }
    return s;
}

static void add_weights(export_source *source, const slices *s, const double *theta) {
    export_part *parts = app_alloc(s->count, sizeof *parts);
    char(*comments)[96] = app_alloc(s->count, sizeof *comments);
    for (size_t i = 0; i < s->count; i++) {
        const lg_slice_info *piece = &s->at[i];
        const int length = snprintf(comments[i], sizeof comments[i], "%s (%llu", piece->name,
                                    (unsigned long long)piece->dims[0]);
        if (piece->rank > 1)
            (void)snprintf(comments[i] + length, sizeof comments[i] - (size_t)length, ", %llu)",
                           (unsigned long long)piece->dims[1]);
        else
            (void)snprintf(comments[i] + length, sizeof comments[i] - (size_t)length, ")");
        parts[i] = (export_part){comments[i], piece->count, theta + piece->offset};
    }
    export_array(source, "weights", parts, s->count);
    free(comments);
    free(parts);
}

static void add_table(export_source *source, const slices *s) {
    text *to = &source->code;
    lg_text_add(to, "\n/* in, out, weight, bias */\nstatic const net_layer net_layers[] = {\n");
    for (size_t i = 0; i < s->count; i++) {
        const lg_slice_info *w = &s->at[i];
        if (w->rank < 2) continue;
        lg_text_add(to, "    {%llu, %llu, %zu, ", (unsigned long long)w->dims[0],
                    (unsigned long long)w->dims[1], w->offset);
        if (i + 1 < s->count && s->at[i + 1].rank == 1)
            lg_text_add(to, "%zu},\n", s->at[i + 1].offset);
        else
            lg_text_add(to, "-1},\n");
    }
    lg_text_add(to, "};\n");
}

/* ---- places in work ---- */

typedef struct work_place {
    const char *name;
    size_t count;      /* reals; 0: the network has no such array */
    unsigned only_for; /* uses that need it; 0: the value too */
} work_place;

static size_t add_places(export_source *source, const work_place *places, size_t count, unsigned uses) {
    size_t at = 0;
    lg_text_add(&source->code, "\n/* where arrays begin in a network's work */\n");
    for (size_t i = 0; i < count; i++) {
        const bool wanted = places[i].only_for == 0 || (places[i].only_for & uses) != 0;
        if (!wanted || places[i].count == 0) continue;
        export_constant(source, places[i].name, at);
        at += (places[i].count + 7) / 8 * 8;
    }
    return at;
}

enum { JVP = EXPORT_NET_JVP, VJP = EXPORT_NET_VJP };

/* Of a chain of layers, and of an embedding before it. */
static size_t add_chain_places(export_source *source, size_t embedding, size_t widest, size_t hidden,
                               unsigned uses) {
    const work_place places[] = {
        {"NET_ANGLE", embedding, 0},
        {"NET_EMBEDDED", embedding, 0},
        {"NET_EMBEDDED_D", embedding, JVP | VJP},
        {"NET_SIDES", 2 * widest, 0},
        {"NET_SIDES_D", 2 * widest, JVP},
        {"NET_SLOPE", widest, JVP},
        {"NET_SLOPES", hidden + 1, VJP},
    };
    return add_places(source, places, LG_COUNT(places), uses);
}

/* Of a residual or multiplicative network. */
static size_t add_body_places(export_source *source, const lg_net *net, unsigned uses) {
    const bool gated = net->kind == LG_NET_MULT || net->kind == LG_NET_MULT_AFFINE;
    const size_t h = net->hidden, e = net->embedding, gates = gated ? h : 0;
    const size_t inner = e > 0 ? e : net->inputs, spare = h > net->outputs ? h : net->outputs;
    const work_place places[] = {
        {"NET_ANGLE", e, 0},
        {"NET_EMBEDDED", e, 0},
        {"NET_EMBEDDED_D", e, JVP | VJP},
        {"NET_H", h, 0},
        {"NET_Z", h, 0},
        {"NET_T", h, 0},
        {"NET_U", gates, 0},
        {"NET_V", gates, 0},
        {"NET_H_D", h, JVP},
        {"NET_Z_D", h, JVP | VJP},
        {"NET_T_D", h, JVP},
        {"NET_U_D", gates, JVP | VJP},
        {"NET_V_D", gates, JVP | VJP},
        {"NET_SLOPE", spare, JVP},
        {"NET_INNER", gated ? inner : 0, VJP},
        {"NET_SLOPES", h * (net->layers + (gated ? 3 : 1)), VJP},
        {"NET_GATES", gated ? gates * net->layers + 1 : 0, VJP},
    };
    return add_places(source, places, LG_COUNT(places), uses);
}

/* ---- fragments in the order of their use ---- */

/* `name`, followed by name_jvp and name_vjp where these are wanted. */
static void add_code(export_source *source, const char *name, unsigned uses) {
    static const char *const endings[] = {"", "_jvp", "_vjp"};
    const bool wanted[] = {true, (uses & JVP) != 0, (uses & VJP) != 0};
    for (size_t i = 0; i < LG_COUNT(endings); i++) {
        char fragment[64];
        (void)snprintf(fragment, sizeof fragment, "%s%s", name, endings[i]);
        if (wanted[i]) export_code(source, fragment);
    }
}

static const struct activation_code {
    const char *name;
    const char *needs; /* stands on exp */
} activations[LG_ACTIVATION_COUNT] = {
    [LG_IDENTITY] = {"activation_identity", NULL},
    [LG_TANH] = {"activation_tanh", "tanh"},
    [LG_SIGMOID] = {"activation_sigmoid", "sigmoid"},
    [LG_SWISH] = {"activation_swish", "sigmoid"},
    [LG_RELU] = {"activation_relu", NULL},
    [LG_LEAKY_RELU] = {"activation_leaky_relu", NULL},
    [LG_SINE] = {"activation_sine", NULL},
};

void export_activation(export_source *source, lg_activation kind, unsigned uses) {
    char fragment[64];
    if (activations[kind].needs != NULL) {
        export_code(source, source->options->dtype == LG_F32 ? "exp_float" : "exp_double");
        export_code(source, activations[kind].needs);
    }
    export_code(source, activations[kind].name);
    (void)snprintf(fragment, sizeof fragment, "%s_slope", activations[kind].name);
    if (uses != 0) export_code(source, fragment);
}

static void add_layers(export_source *source, lg_activation kind, unsigned uses) {
    export_activation(source, kind, uses);
    export_code(source, "dense_activated");
    if (uses != 0) export_code(source, "scale");
    if ((uses & JVP) != 0) export_code(source, "dense_pair");
    if ((uses & JVP) != 0) export_code(source, "dense_pair_activated");
    if ((uses & VJP) != 0) export_code(source, "dense_transposed");
    if ((uses & VJP) != 0) export_code(source, "dense_kept");
}

/* The table, and before it what its type stands in. */
static void add_description(export_source *source, const slices *s, const double *theta, bool embedding) {
    add_weights(source, s, theta);
    export_code(source, "dot");
    export_code(source, "noinline");
    export_code(source, "dense_add");
    export_code(source, "dense");
    add_table(source, s);
    export_constant(source, "NET_FIRST", embedding ? 1 : 0);
    export_constant(source, "NET_LAST", s->layers - 1);
}

/* Bytes of stack of all these functions, gcc and clang, -O0 to -O3: clang spills much of what it unrolls. */
enum { STACK_VALUE = 2048, STACK_DERIVATIVE = 2560 };

static size_t stack_of(unsigned uses) {
    return STACK_VALUE + ((uses & JVP) != 0 ? STACK_DERIVATIVE : 0) +
           ((uses & VJP) != 0 ? STACK_DERIVATIVE : 0);
}

/* ---- networks ---- */

/* Layers one after another, behind an embedding or not. */
static size_t add_chain(export_source *source, const slices *s, const double *theta, size_t embedding,
                        lg_activation kind, unsigned uses) {
    size_t widest = 8, hidden = 0, layers = 0;
    for (size_t i = 0; i < s->count; i++) {
        const size_t out = (size_t)s->at[i].dims[1];
        if (s->at[i].rank < 2) continue;
        layers++;
        if (out > widest) widest = (out + 7) / 8 * 8;
        if (layers < s->layers && !(embedding > 0 && layers == 1)) hidden += out;
    }
    add_description(source, s, theta, embedding > 0);
    if (embedding > 0) export_constant(source, "NET_EMBEDDING", embedding);
    export_constant(source, "NET_WIDEST", widest);
    const size_t work = add_chain_places(source, embedding, widest, hidden, uses);
    add_layers(source, hidden > 0 ? kind : LG_IDENTITY, uses);
    add_code(source, embedding > 0 ? "net_embedding" : "net_input", uses);
    add_code(source, "mlp", uses);
    return work;
}

static size_t add_body(export_source *source, const slices *s, const lg_net *net, const double *theta,
                       unsigned uses) {
    add_description(source, s, theta, net->embedding > 0);
    if (net->embedding > 0) export_constant(source, "NET_EMBEDDING", net->embedding);
    export_constant(source, "NET_HIDDEN", net->hidden);
    const size_t work = add_body_places(source, net, uses);
    add_layers(source, net->activation, uses);
    add_code(source, net->embedding > 0 ? "net_embedding" : "net_input", uses);
    if (net->kind == LG_NET_MULT) add_code(source, "gate", uses);
    if (net->kind == LG_NET_MULT_AFFINE) add_code(source, "affine_gate", uses);
    add_code(source, net->kind == LG_NET_RESNET ? "resnet" : "mult", uses);
    return work;
}

size_t export_mlp(export_source *source, const lg_mlp *net, const double *theta, unsigned uses) {
    const slices s = slices_of_mlp(net);
    const size_t work = add_chain(source, &s, theta, 0, net->activation, uses);
    source->stack += stack_of(uses);
    free(s.at);
    return work;
}

size_t export_net(export_source *source, const lg_net *net, const double *theta, unsigned uses) {
    const slices s = slices_of_net(net);
    const size_t work = net->kind == LG_NET_MLP
                            ? add_chain(source, &s, theta, net->embedding, net->activation, uses)
                            : add_body(source, &s, net, theta, uses);
    source->stack += stack_of(uses);
    free(s.at);
    return work;
}

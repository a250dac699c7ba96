/* Networks as C: a table of dense layers, where arrays lie in work, and the fragments that run over them. */
#include <stdlib.h>
#include <string.h>

#include "lg-export/export.h"

/* The pieces of the parameter vector, in its order, and how many of them are weights. */
typedef struct slices {
    lg_slice_info *at;
    size_t count, layers;
} slices;

enum { SLICES_MAX = 2 * LG_MLP_MAX_LAYERS };

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

static size_t add_place(export_source *source, const char *name, size_t count, size_t at) {
    export_constant(source, name, at);
    return at + (count + 7) / 8 * 8;
}

static size_t add_places(export_source *source, size_t widest, size_t hidden) {
    lg_text_add(&source->code, "\n/* where arrays begin in a network's work */\n");
    const size_t at = add_place(source, "NET_SIDES", 2 * widest, 0);
    return add_place(source, "NET_SLOPES", hidden + 1, at);
}

/* ---- fragments in the order of their use ---- */

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

static void add_activation(export_source *source, lg_activation kind) {
    char fragment[64];
    if (activations[kind].needs != NULL) {
        export_code(source, source->options->dtype == LG_F32 ? "exp_float" : "exp_double");
        export_code(source, activations[kind].needs);
    }
    export_code(source, activations[kind].name);
    (void)snprintf(fragment, sizeof fragment, "%s_slope", activations[kind].name);
    export_code(source, fragment);
}

/* The table, and before it what its type stands in. */
static void add_description(export_source *source, const slices *s, const double *theta) {
    add_weights(source, s, theta);
    export_code(source, "dot");
    export_code(source, "noinline");
    export_code(source, "dense_add");
    export_code(source, "dense");
    add_table(source, s);
    export_constant(source, "NET_FIRST", 0);
    export_constant(source, "NET_LAST", s->layers - 1);
}

/* Bytes of stack of all these functions, gcc and clang, -O0 to -O3: clang spills much of what it unrolls. */
enum { STACK = 4608 };

size_t export_mlp(export_source *source, const lg_mlp *net, const double *theta) {
    static const char *const fragments[] = {
        "dense_activated", "scale", "dense_transposed", "dense_kept", "net_input",
        "net_input_vjp",   "mlp",   "mlp_vjp"};
    const slices s = slices_of_mlp(net);
    size_t widest = 8, hidden = 0;
    for (uint32_t l = 1; l <= net->layers; l++) {
        if (net->width[l] > widest) widest = (net->width[l] + 7) / 8 * 8;
        if (l < net->layers) hidden += net->width[l];
    }
    add_description(source, &s, theta);
    export_constant(source, "NET_WIDEST", widest);
    const size_t work = add_places(source, widest, hidden);
    add_activation(source, hidden > 0 ? net->activation : LG_IDENTITY);
    for (size_t i = 0; i < LG_COUNT(fragments); i++) export_code(source, fragments[i]);
    source->stack += STACK;
    free(s.at);
    return work;
}

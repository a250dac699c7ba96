/* Surrogates exported as C: every kind with every architecture and activation, with and without an embedding;
 * one model of each kind by every compiler at every level.
 * ctest-labels: study */
#include "export_surrogate_support.h"

enum { KINDS = LG_SURROGATE_KIND_COUNT, NETS = LG_NET_KIND_COUNT, ACTIVATIONS = LG_ACTIVATION_COUNT };

/* The other choices change from model to model. */
static void every_network(void **state) {
    (void)state;
    static const export_way ways[] = {
        {"gcc", "-O1"}, {"clang", "-O1"}, {"g++", "-O2"}, {"clang++", "-O0"}, {"gcc", "-O3"}};
    for (size_t i = 0; i < (size_t)KINDS * NETS * ACTIVATIONS * 2; i++) {
        const size_t kind = i % KINDS, net = i / KINDS % NETS, activation = i / (KINDS * NETS) % ACTIVATIONS;
        const size_t embedded = i / ((size_t)KINDS * NETS * ACTIVATIONS),
                     turn = kind + net + activation + embedded;
        const lg_surrogate_options options = {.kind = (lg_surrogate_kind)kind,
                                              .architecture = (lg_net_kind)net,
                                              .embedding = embedded ? 6 : 0,
                                              .hidden = (uint32_t)(5 + turn),
                                              .layers = (uint32_t)(turn % 4),
                                              .activation = (lg_activation)activation,
                                              .normalise = turn % 2 == 1 && kind != LG_SURROGATE_ANGLE,
                                              .mirror = turn / 2 % 2 == 1,
                                              .boundary = turn % 3 == 1 && kind == LG_SURROGATE_ANGLE};
        const export_way *way = &ways[i % LG_COUNT(ways)];
        char name[48];
        if (!export_has(way->compiler)) continue;
        (void)snprintf(name, sizeof name, "%s_%s_%s%s", lg_surrogate_kind_name(options.kind),
                       net == LG_NET_MULT_AFFINE ? "affine" : lg_net_kind_name(options.architecture),
                       activation == LG_LEAKY_RELU ? "leaky" : lg_activation_name(options.activation),
                       embedded ? "_e" : "");
        beam b = beam_make(&options, (uint32_t)(4 + 7 * (turn % 5)), 3.3, turn % 3 > 0);
        beam_check(&b, name, turn % 2 == 0, way->compiler, way->flags, 100);
        beam_free(&b);
    }
}

static void every_way(void **state) {
    (void)state;
    static const lg_surrogate_options options[] = {
        {.kind = LG_SURROGATE_DISCRETE,
         .architecture = LG_NET_MULT_AFFINE,
         .hidden = 11,
         .layers = 2,
         .activation = LG_TANH,
         .normalise = true},
        {.kind = LG_SURROGATE_CONTINUOUS,
         .architecture = LG_NET_RESNET,
         .embedding = 7,
         .hidden = 24,
         .layers = 2,
         .activation = LG_SWISH,
         .mirror = true},
        {.kind = LG_SURROGATE_ANGLE,
         .architecture = LG_NET_MLP,
         .hidden = 20,
         .layers = 3,
         .activation = LG_SIGMOID,
         .boundary = true},
    };
    for (size_t i = 0; i < KINDS; i++)
        for (int single = 0; single < 2; single++) {
            char name[16];
            (void)snprintf(name, sizeof name, "way%zu%d", i, single);
            beam b = beam_make(&options[i], 12, 3.3, true);
            beam_export(&b, name, single == 1);
            export_check_all_ways(name, name);
            export_check_objects(name, name);
            export_check_stack(name);
            beam_free(&b);
        }
}

static int begin(void **state) {
    (void)state;
    return export_begin();
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_network), cmocka_unit_test(every_way)};
    return cmocka_run_group_tests(tests, begin, export_end);
}

/* Surrogates exported as C: every kind with every architecture and activation, with and without an embedding;
 * one model of each kind by every compiler at every level.
 * ctest-labels: study */
#include "export_surrogate.h"

enum {
    KINDS = LG_SURROGATE_KIND_COUNT,
    NETS = LG_NET_KIND_COUNT,
    ACTIVATIONS = LG_ACTIVATION_COUNT,
    ALL = KINDS * NETS * ACTIVATIONS * 2
};

static const char *name_of(size_t i) {
    static char name[16];
    (void)snprintf(name, sizeof name, "net%zu", i);
    return name;
}

static export_way way_of(size_t i) {
    static const export_way ways[] = {
        {"gcc", "-O1"}, {"clang", "-O1"}, {"g++", "-O2"}, {"clang++", "-O0"}, {"gcc", "-O3"}};
    return ways[i % LG_COUNT(ways)];
}

/* The other choices change from model to model. */
static void *make(size_t i) {
    const size_t kind = i % KINDS, net = i / KINDS % NETS, activation = i / (KINDS * NETS) % ACTIVATIONS;
    const size_t embedded = i / (ALL / 2), turn = kind + net + activation + embedded;
    const lg_surrogate_options options = {.kind = (lg_surrogate_kind)kind,
                                          .architecture = (lg_net_kind)net,
                                          .embedding = embedded ? 6 : 0,
                                          .hidden = (uint32_t)(5 + turn),
                                          .layers = (uint32_t)(turn % 4),
                                          .activation = (lg_activation)activation,
                                          .normalise = turn % 2 == 1 && kind != LG_SURROGATE_ANGLE,
                                          .mirror = turn / 2 % 2 == 1,
                                          .boundary = turn % 3 == 1 && kind == LG_SURROGATE_ANGLE,
                                          .modes = turn % 3 == 2 && kind == LG_SURROGATE_DISCRETE ? 5 : 0,
                                          .angles = turn % 3 == 1 && kind == LG_SURROGATE_DISCRETE};
    return beam_make(name_of(i), &options, (uint32_t)(4 + 7 * (turn % 5)), 3.3, turn % 3 > 0);
}

static const export_kind beams = {ALL, name_of, way_of, make, beam_draw, beam_reference, beam_curves};

TEST("values, Jacobians and curves of every network are the library's") {
    for (size_t i = 0; i < ALL; i++) {
        const size_t mark = lg_test_owned();
        exported e = export_saved(name_of(i), i / KINDS % 2 == 0 ? "f32" : "f64", 7, make(i));
        export_compare_one(&beams, &e, way_of(i));
        lg_test_give_back(mark);
    }
}

TEST("a model of each kind is built by every compiler at every level") {
    for (size_t i = 0; i < 2 * KINDS; i++)
        export_build(&beams, i + KINDS * NETS * (i / KINDS), i < KINDS ? "f64" : "f32",
                     export_check_all_ways);
}

TEST_GROUP(export_begin, export_end)

/* Surrogates of the elastica exported as C against the library: value, Jacobian and curve of random boundary
 * conditions; what the header says.
 * ctest-labels: slow apps/lg-export src/elastica */
#include "export_surrogate.h"

typedef struct example {
    const char *name, *compiler, *flags;
    uint32_t intervals;
    double length;
    bool trained;
    lg_surrogate_options options;
} example;

#define NETWORK(kind_, architecture_, embedding_, hidden_, layers_, activation_, ...)                        \
    {                                                                                                        \
        .kind = LG_SURROGATE_##kind_, .architecture = LG_NET_##architecture_, .embedding = embedding_,       \
        .hidden = hidden_, .layers = layers_, .activation = LG_##activation_, __VA_ARGS__                    \
    }

/* The last beam is so short that what holds one end counts at the other one too. */
static const example examples[] = {
    {"plain", "gcc", "-O2", 8, 3.3, true, NETWORK(DISCRETE, MLP, 0, 13, 2, TANH, .mirror = false)},
    {"nodes", "clang", "-O1", 50, 1.0, true,
     NETWORK(DISCRETE, RESNET, 5, 11, 2, SINE, .normalise = true, .mirror = true)},
    {"direct", "g++", "-O2", 2, 20.0, false, NETWORK(DISCRETE, MULT, 0, 9, 0, SWISH, .mirror = true)},
    {"fixed", "gcc", "-O2", 20, 3.3, true,
     NETWORK(DISCRETE, MLP, 0, 12, 1, TANH, .normalise = true, .mirror = true, .modes = 12)},
    {"turned", "gcc", "-O2", 20, 3.3, true,
     NETWORK(DISCRETE, MLP, 0, 12, 1, TANH, .normalise = true, .mirror = true, .angles = true)},
    {"gated", "gcc", "-O3 -march=native -ffp-contract=fast", 50, 3.3, true,
     NETWORK(CONTINUOUS, MULT, 6, 10, 3, SIGMOID, .normalise = true, .mirror = true)},
    {"smooth", "clang", "-O3", 10, 3.3, false, NETWORK(CONTINUOUS, MLP, 0, 17, 1, TANH, .mirror = true)},
    {"kinked", "gcc", "-O0", 10, 1.0, true,
     NETWORK(CONTINUOUS, RESNET, 0, 8, 0, LEAKY_RELU, .normalise = true)},
    {"bend", "gcc", "-O2", 60, 3.3, true,
     NETWORK(ANGLE, MULT_AFFINE, 0, 9, 2, TANH, .mirror = true, .boundary = true)},
    {"turning", "clang++", "-O2", 7, 3.3, false, NETWORK(ANGLE, RESNET, 5, 8, 1, SINE, .mirror = false)},
    {"brief", "clang", "-O2", 5, 0.15, true, NETWORK(ANGLE, MLP, 0, 12, 0, SWISH, .boundary = true)},
};

static const char *name_of(size_t i) {
    return examples[i].name;
}

static export_way way_of(size_t i) {
    return (export_way){examples[i].compiler, examples[i].flags};
}

static void *make(size_t i) {
    const example *x = &examples[i];
    return beam_make(x->name, &x->options, x->intervals, x->length, x->trained);
}

static const export_kind beams = {LG_COUNT(examples), name_of,        way_of,     make,
                                  beam_draw,          beam_reference, beam_curves};

TEST("values, Jacobians and curves are the library's in double precision") {
    export_compare_all(&beams, "f64");
}

TEST("values, Jacobians and curves are the library's in single precision") {
    export_compare_all(&beams, "f32");
}

/* A place that is not finite loses its own point, a boundary condition all of them. */
TEST("points of a curve are NaN where their place or the boundary conditions are") {
    for (size_t i = 0; i < LG_COUNT(examples); i++) {
        double boundary[8], s[] = {0, 0.3, NAN, 0.9}, q[8], v[8];
        lg_rng rng;
        lg_rng_seed(&rng, 3, i);
        exported e = export_saved(name_of(i), "f64", 1, make(i));
        export_compile(&e, (export_way){"cc", "-O1"});
        draw_boundary(&rng, examples[i].length, boundary);
        for (size_t k = 0; k < 4; k++) s[k] *= examples[i].length;
        beam_curve(&e.lib, boundary, s, 4, q, v);
        for (size_t k = 0; k < 8; k++)
            assert_true(isnan(q[k]) == (k / 2 == 2) && isnan(v[k]) == (k / 2 == 2));
        boundary[6] = NAN; /* vNx */
        beam_curve(&e.lib, boundary, s, 4, q, v);
        for (size_t k = 0; k < 8; k++) assert_true(isnan(q[k]) && isnan(v[k]));
        export_close(&e.lib);
    }
}

/* A plain sum would lose ten times as much. */
TEST("the sum over thousands of panels in single precision is as good as its terms") {
    enum { PANELS = 20000 };
    const lg_surrogate_options options = NETWORK(ANGLE, MLP, 0, 2, 0, TANH, .mirror = false);
    double boundary[8], s[2], q[2][4], v[4];
    beam *b = beam_make("panels", &options, PANELS, 3.3, false);
    lg_rng rng;
    lg_rng_seed(&rng, 4, 4);
    draw_boundary(&rng, 3.3, boundary);
    exported e = export_saved("panels", "f32", 1, b);
    export_compile(&e, (export_way){"gcc", "-O2"});
    for (size_t c = 0; c < 8; c++) boundary[c] = c < 2 ? 0 : export_rounded(&e.lib, boundary[c]);
    for (size_t i = 0; i < 2; i++) s[i] = export_rounded(&e.lib, i == 0 ? 1.1 : 3.3);
    lg_surrogate_curve(b->curves, boundary, s, 2, q[0], v, b->work);
    beam_curve(&e.lib, boundary, s, 2, q[1], v);
    const double error = export_worst(q[1], q[0], 1, 4);
    print_message("%d panels: %.2e\n", PANELS, error);
    assert_close(error, 0, 0, 4e-7);
    export_close(&e.lib);
}

TEST("the header tells what a model is, where its numbers come from, and the range it was trained on") {
    static const struct {
        size_t example;
        const char *words;
    } rows[] = {
        {0, "discrete network|inner nodes and tangents|L = 3.3, N = 8|q_7x q_7y|mlp"},
        {3, "discrete network|outputs y (76)|q_19x q_19y|mean and 12 modes of the training curves"},
        {4, "discrete network|outputs y (76)|from the inner angles"},
        {5, "continuous network|dq/ds|embedding 6, sigmoid|x-coordinates of the ends|mirror"},
        {8, "angle network|radians|curvature|given ones by construction|mult-affine"},
    };
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        const beam *b = make(rows[r].example);
        const exported e = export_saved(name_of(rows[r].example), "f64", 1, NULL);
        double least = INFINITY;
        char header[96], range[64];
        (void)snprintf(header, sizeof header, "%s/m.h", e.folder);
        export_expect_words(header, rows[r].words);
        export_expect_words(
            header, "2.5e-07|3.5e-07|lg-elastica train beams.h5|0000000042|1000 curves|batches of 32");
        for (size_t i = 0; i < TRAINED; i++) least = fmin(least, b->trained->trained[8 * i + 4]);
        (void)snprintf(range, sizeof range, "qNx   %.6g to ", least);
        export_expect_words(header, range);
    }
    export_expect("! grep -r NAME */m.h");
    static cli result;
    cli_json("lg-export", "plain.h5 --out told", "kind \"surrogate\", scheme null", &result);
}

TEST("a model of each kind is built in every way") {
    static const size_t chosen[] = {4, 5, 8};
    for (size_t i = 0; i < LG_COUNT(chosen); i++)
        export_build(&beams, chosen[i], i == 1 ? "f32" : "f64", export_check_ways);
}

TEST_GROUP(export_begin, export_end)

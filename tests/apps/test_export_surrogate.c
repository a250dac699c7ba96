/* Surrogates of the elastica exported as C against the library: value, Jacobian and curve of random boundary
 * conditions; what the header says. */
#include "export_surrogate_support.h"

typedef struct example {
    const char *name;
    const char *compiler, *flags;
    lg_surrogate_options options;
    uint32_t intervals;
    double length;
    bool trained;
} example;

/* The last beam is so short that what holds one end counts at the other one too. */
static const example examples[] = {
    {"plain",
     "gcc",
     "-O2",
     {.kind = LG_SURROGATE_DISCRETE,
      .architecture = LG_NET_MLP,
      .hidden = 13,
      .layers = 2,
      .activation = LG_TANH},
     8,
     3.3,
     true},
    {"nodes",
     "clang",
     "-O1",
     {.kind = LG_SURROGATE_DISCRETE,
      .architecture = LG_NET_RESNET,
      .embedding = 5,
      .hidden = 11,
      .layers = 2,
      .activation = LG_SINE,
      .normalise = true,
      .mirror = true},
     50,
     1.0,
     true},
    {"direct",
     "g++",
     "-O2",
     {.kind = LG_SURROGATE_DISCRETE,
      .architecture = LG_NET_MULT,
      .hidden = 9,
      .layers = 0,
      .activation = LG_SWISH,
      .mirror = true},
     2,
     20.0,
     false},
    {"gated",
     "gcc",
     "-O3 -march=native -ffp-contract=fast",
     {.kind = LG_SURROGATE_CONTINUOUS,
      .architecture = LG_NET_MULT,
      .embedding = 6,
      .hidden = 10,
      .layers = 3,
      .activation = LG_SIGMOID,
      .normalise = true,
      .mirror = true},
     50,
     3.3,
     true},
    {"smooth",
     "clang",
     "-O3",
     {.kind = LG_SURROGATE_CONTINUOUS,
      .architecture = LG_NET_MLP,
      .hidden = 17,
      .layers = 1,
      .activation = LG_TANH,
      .mirror = true},
     10,
     3.3,
     false},
    {"kinked",
     "gcc",
     "-O0",
     {.kind = LG_SURROGATE_CONTINUOUS,
      .architecture = LG_NET_RESNET,
      .hidden = 8,
      .layers = 0,
      .activation = LG_LEAKY_RELU,
      .normalise = true},
     10,
     1.0,
     true},
    {"bend",
     "gcc",
     "-O2",
     {.kind = LG_SURROGATE_ANGLE,
      .architecture = LG_NET_MULT_AFFINE,
      .hidden = 9,
      .layers = 2,
      .activation = LG_TANH,
      .mirror = true,
      .boundary = true},
     60,
     3.3,
     true},
    {"turning",
     "clang++",
     "-O2",
     {.kind = LG_SURROGATE_ANGLE,
      .architecture = LG_NET_RESNET,
      .embedding = 5,
      .hidden = 8,
      .layers = 1,
      .activation = LG_SINE},
     7,
     3.3,
     false},
    {"brief",
     "clang",
     "-O2",
     {.kind = LG_SURROGATE_ANGLE,
      .architecture = LG_NET_MLP,
      .hidden = 12,
      .layers = 0,
      .activation = LG_SWISH,
      .boundary = true},
     5,
     0.15,
     true},
};

static void compare_all(bool single) {
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        const example *x = &examples[e];
        if (!export_has(x->compiler)) continue;
        beam b = beam_make(&x->options, x->intervals, x->length, x->trained);
        beam_check(&b, x->name, single, x->compiler, x->flags,
                   x->options.kind == LG_SURROGATE_ANGLE ? 200 : 1000);
        beam_free(&b);
    }
}

static void double_precision(void **state) {
    (void)state;
    compare_all(false);
}

static void single_precision(void **state) {
    (void)state;
    compare_all(true);
}

/* A curve is a curve: it begins where it is told to, its tangent is its derivative, the nodes lie on it. */
static void curves_are_curves(void **state) {
    (void)state;
    for (size_t e = 0; e < LG_COUNT(examples); e++) {
        const example *x = &examples[e];
        const double h = 1e-5 * x->length, length = x->length;
        double boundary[8], s[POINTS], q[2 * POINTS], v[2 * POINTS];
        lg_rng rng;
        lg_rng_seed(&rng, 3, e);
        beam b = beam_make(&x->options, x->intervals, x->length, x->trained);
        beam_export(&b, x->name, false);
        b.lib = export_open(x->name, x->name, "cc", "-O1");
        draw_boundary(&rng, length, boundary);
        const double places[] = {0, 0.31 * length - h, 0.31 * length, 0.31 * length + h, length};
        memcpy(s, places, sizeof places);
        beam_curve(&b, boundary, s, LG_COUNT(places), q, v);
        for (size_t c = 0; c < 2; c++) {
            if (x->options.kind != LG_SURROGATE_CONTINUOUS) assert_close(q[c], boundary[c], 0, 0);
            if (x->options.kind == LG_SURROGATE_DISCRETE) assert_close(q[8 + c], boundary[4 + c], 0, 0);
            if (x->options.kind == LG_SURROGATE_DISCRETE || x->options.boundary) {
                assert_close(v[c], boundary[2 + c], 0, 1e-13);
                assert_close(v[8 + c], boundary[6 + c], 0, 1e-13);
            }
            assert_close((q[6 + c] - q[2 + c]) / (2 * h), v[4 + c], 1e-5, 1e-5);
        }
        s[3] = NAN; /* that point alone is lost */
        beam_curve(&b, boundary, s, LG_COUNT(places), q, v);
        for (size_t c = 0; c < 2; c++)
            assert_true(isnan(q[6 + c]) && isnan(v[6 + c]) && isfinite(q[8 + c]) && isfinite(v[8 + c]));
        boundary[6] = NAN; /* vNx: now all of it */
        beam_curve(&b, boundary, s, LG_COUNT(places), q, v);
        for (size_t i = 0; i < 2 * LG_COUNT(places); i++) assert_true(isnan(q[i]) && isnan(v[i]));
        export_close(&b.lib);
        beam_free(&b);
    }
}

/* The sum over thousands of panels in single precision is as good as its terms: a plain sum would lose ten
 * times as much. */
static void many_panels(void **state) {
    (void)state;
    enum { PANELS = 20000 };
    const lg_surrogate_options options = {
        .kind = LG_SURROGATE_ANGLE, .architecture = LG_NET_MLP, .hidden = 2, .activation = LG_TANH};
    double boundary[8], s[2], q[2][4], v[4];
    beam b = beam_make(&options, PANELS, 3.3, false);
    lg_rng rng;
    lg_rng_seed(&rng, 4, 4);
    draw_boundary(&rng, 3.3, boundary);
    beam_export(&b, "panels", true);
    b.lib = export_open("panels", "panels", "gcc", "-O2");
    for (size_t c = 0; c < 8; c++) boundary[c] = c < 2 ? 0 : export_rounded(&b.lib, boundary[c]);
    s[0] = export_rounded(&b.lib, 1.1);
    s[1] = export_rounded(&b.lib, 3.3);
    lg_surrogate_curve(b.curves, boundary, s, 2, q[0], v, b.work);
    beam_curve(&b, boundary, s, 2, q[1], v);
    const double error = export_worst(q[1], q[0], 1, 4);
    print_message("%d panels: %.2e\n", PANELS, error);
    assert_close(error, 0, 0, 4e-7);
    export_close(&b.lib);
    beam_free(&b);
}

/* What a model of each kind is, where its numbers come from, and the range it was trained on. */
static void header_tells(void **state) {
    (void)state;
    static char out[EXPORT_TEXT];
    static const struct {
        size_t example;
        const char *words[6];
    } rows[] = {
        {0, {"discrete network", "inner nodes and tangents", "L = 3.3, N = 8", "q_7x q_7y", "mlp", NULL}},
        {3,
         {"continuous network", "dq/ds", "embedding 6, sigmoid", "x-coordinates of the ends", "mirror",
          NULL}},
        {6, {"angle network", "radians", "curvature", "given ones by construction", "mult-affine", NULL}},
    };
    static const char *const all[] = {"2.5e-07",    "3.5e-07",     "lg-elastica train beams.h5",
                                      "0000000042", "1000 curves", "batches of 32",
                                      "m.h5"};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        const example *x = &examples[rows[r].example];
        beam b = beam_make(&x->options, x->intervals, x->length, x->trained);
        double least = INFINITY;
        char range[64];
        beam_export(&b, "m", false);
        assert_int_equal(export_shell("cat m/m.h", out), 0);
        for (const char *const *w = rows[r].words; *w != NULL; w++)
            if (strstr(out, *w) == NULL) fail_msg("no '%s' in\n%s", *w, out);
        for (size_t i = 0; i < LG_COUNT(all); i++)
            if (strstr(out, all[i]) == NULL) fail_msg("no '%s' in\n%s", all[i], out);
        for (size_t i = 0; i < TRAINED; i++) least = fmin(least, b.file.trained[8 * i + 4]);
        (void)snprintf(range, sizeof range, "qNx   %.6g to ", least);
        if (strstr(out, range) == NULL) fail_msg("no '%s' in\n%s", range, out);
        assert_true(strstr(out, "NAME") == NULL);
        beam_free(&b);
    }
}

/* One model of each kind in every way. */
static void compiled_every_way(void **state) {
    (void)state;
    static const size_t chosen[] = {1, 3, 6};
    for (size_t i = 0; i < LG_COUNT(chosen); i++) {
        const example *x = &examples[chosen[i]];
        beam b = beam_make(&x->options, x->intervals, x->length, x->trained);
        beam_export(&b, x->name, i == 1);
        export_check_ways(x->name, x->name);
        export_check_objects(x->name, x->name);
        export_check_stack(x->name);
        beam_free(&b);
    }
}

static int begin(void **state) {
    (void)state;
    return export_begin();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(double_precision),  cmocka_unit_test(single_precision),
        cmocka_unit_test(curves_are_curves), cmocka_unit_test(many_panels),
        cmocka_unit_test(header_tells),      cmocka_unit_test(compiled_every_way),
    };
    return cmocka_run_group_tests(tests, begin, export_end);
}

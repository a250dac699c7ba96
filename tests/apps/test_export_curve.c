/* Compares exported surrogates of the elastica with the library: value, Jacobian and curve for random
 * boundary conditions, with small networks that have random parameters; and what the header says.
 * ctest-labels: slow apps/lg-export src/elastica */
#include "export_models.h"

#include "support/modes.h"

enum { TRAINED = 20, POINTS = 21 };

typedef struct example {
    export_row row;
    uint32_t intervals;
    double length;
    bool trained;
    lg_surrogate_options options;
} example;

/* The last beam is so short that the condition at one end also affects the other end. */
static const example examples[] = {
    {.row = {"plain", "gcc", "-O2", ""},
     8,
     3.3,
     true,
     SURROGATE(DISCRETE, MLP, 0, 13, 2, TANH, .mirror = false)},
    {.row = {"nodes", "clang", "-O1", ""},
     50,
     1.0,
     true,
     SURROGATE(DISCRETE, RESNET, 5, 11, 2, SINE, .normalise = true, .mirror = true)},
    {.row = {"direct", "g++", "-O2", ""},
     2,
     20.0,
     false,
     SURROGATE(DISCRETE, MULT, 0, 9, 0, SWISH, .mirror = true)},
    {.row = {"fixed", "gcc", "-O2", ""},
     20,
     3.3,
     true,
     SURROGATE(DISCRETE, MLP, 0, 12, 1, TANH, .normalise = true, .mirror = true, .modes = 12)},
    {.row = {"turned", "gcc", "-O2", ""},
     20,
     3.3,
     true,
     SURROGATE(DISCRETE, MLP, 0, 12, 1, TANH, .normalise = true, .mirror = true, .angles = true)},
    {.row = {"gated", "gcc", "-O3 -march=native -ffp-contract=fast", ""},
     50,
     3.3,
     true,
     SURROGATE(CONTINUOUS, MULT, 6, 10, 3, SIGMOID, .normalise = true, .mirror = true)},
    {.row = {"smooth", "clang", "-O3", ""},
     10,
     3.3,
     false,
     SURROGATE(CONTINUOUS, MLP, 0, 17, 1, TANH, .mirror = true)},
    {.row = {"kinked", "gcc", "-O0", ""},
     10,
     1.0,
     true,
     SURROGATE(CONTINUOUS, RESNET, 0, 8, 0, LEAKY_RELU, .normalise = true)},
    {.row = {"bend", "gcc", "-O2", ""},
     60,
     3.3,
     true,
     SURROGATE(ANGLE, MULT_AFFINE, 0, 9, 2, TANH, .mirror = true, .boundary = true)},
    {.row = {"turning", "clang++", "-O2", ""},
     7,
     3.3,
     false,
     SURROGATE(ANGLE, RESNET, 5, 8, 1, SINE, .mirror = false)},
    {.row = {"closed", "gcc", "-O2", ""},
     7,
     3.3,
     true,
     SURROGATE(ANGLE, MLP, 0, 9, 1, TANH, .mirror = true, .symmetric = true)},
    {.row = {"brief", "clang", "-O2", ""},
     5,
     0.15,
     true,
     SURROGATE(ANGLE, MLP, 0, 12, 0, SWISH, .boundary = true)},
};

/* ---- models ---- */

static void draw_tangent(lg_rng *rng, double *v) {
    const double angle = lg_rng_uniform_in(rng, -3.1, 3.1);
    v[0] = cos(angle);
    v[1] = sin(angle);
}

static void draw_boundary(lg_rng *rng, double length, double *x) {
    for (int c = 0; c < 2; c++) {
        x[c] = lg_rng_uniform_in(rng, -0.5, 0.5) * length;
        x[4 + c] = x[c] + lg_rng_uniform_in(rng, -0.7, 0.7) * length;
    }
    draw_tangent(rng, x + 2);
    draw_tangent(rng, x + 6);
}

static void *make(const void *row) {
    const example *of = row;
    lg_surrogate_file file = {
        .run = {.train_fraction = 0.9, .test_fraction = 0.1, .curves = 1000, .training = export_training()},
        .has_errors = true,
        .train_mse = 2.5e-7,
        .test_mse = 3.5e-7};
    lg_surrogate *model = &file.run.model;
    lg_rng rng = test_rng(11, 12);
    assert_ok(lg_surrogate_init(model, &of->options, of->intervals, of->length, 0.4 * of->length, NULL));
    give_modes(model);
    (void)snprintf(file.run.data_sha256, sizeof file.run.data_sha256, "%064d", 42);
    (void)snprintf(file.provenance.command, sizeof file.provenance.command, "lg-elastica train beams.h5");
    file.parameters = lg_surrogate_parameters(model);
    file.theta = TEST_ARRAY(double, file.parameters);
    lg_net_initialise(&model->net, &rng, file.theta);
    file.trained_count = of->trained ? TRAINED : 0;
    file.trained = of->trained ? TEST_ARRAY(double, 8 * TRAINED) : NULL;
    for (size_t i = 0; i < file.trained_count; i++) draw_boundary(&rng, of->length, file.trained + 8 * i);
    assert_ok(lg_recipe_save(NULL, export_path(of->row.name), &lg_recipe_surrogate, &file, NULL, NULL));
    return NULL;
}

static const lg_surrogate_file *file_of(const exported *e) {
    return lg_model_file_of(&e->file, &lg_recipe_surrogate);
}

static double length_of(const exported *e) {
    return file_of(e)->run.model.length;
}

/* For networks with the input s, s comes first, then the boundary conditions. */
static void draw(void *user, lg_rng *rng, double *x) {
    const exported *e = user;
    if (lg_model_inputs(e->model) == 9) *x++ = lg_rng_uniform_in(rng, -0.02, 1.02) * length_of(e);
    draw_boundary(rng, length_of(e), x);
}

/* ---- curves ---- */

typedef struct library {
    lg_surrogate_curves *curves;
    void *work;
} library;

RELEASES(release_curves, lg_surrogate_curves_destroy)

static library curves_of(const exported *e, size_t points) {
    library of;
    assert_ok(lg_surrogate_curves_create(NULL, &file_of(e)->run.model, file_of(e)->theta, LG_F64, points,
                                         &of.curves, NULL));
    lg_test_owns(of.curves, release_curves);
    of.work = lg_test_memory(lg_surrogate_curves_work_size(of.curves));
    return of;
}

/* Calls NAME_curve with doubles. Guard bytes follow the work memory. */
static void exported_curve(const export_library *lib, const double *x, const double *s, size_t points,
                           double *q, double *v) {
    enum { GUARD = 16 };
    const size_t size = lib->single ? sizeof(float) : sizeof(double), used = lib->work_size * size;
    void *in = export_reals(lib, x, 8), *at = export_reals(lib, s, points);
    void *to_q = export_reals(lib, q, 2 * points), *to_v = export_reals(lib, v, 2 * points);
    unsigned char *work = malloc(used + GUARD * size);
    assert_non_null(work);
    memset(work, 0xff, used + GUARD * size); /* NaN */
    EXPORT_FUNCTION(lib, "curve", void, (const void *, const void *, int, void *, void *, void *), curve);
    curve(in, at, (int)points, to_q, to_v, work);
    for (size_t i = 0; i < GUARD * size; i++) assert_int_equal(work[used + i], 0xff);
    export_doubles(lib, to_q, q, 2 * points);
    export_doubles(lib, to_v, v, 2 * points);
    free(work);
    free(to_v);
    free(to_q);
    free(at);
    free(in);
}

/* Increasing places: the ends, nodes and points between them; in one of four draws also places beyond the
 * ends. */
static void draw_places(const exported *e, lg_rng *rng, double *s) {
    const lg_surrogate *model = &file_of(e)->run.model;
    const bool beyond = lg_rng_below(rng, 4) == 0;
    for (size_t i = 0; i < POINTS; i++) {
        double share = (double)i / (POINTS - 1);
        if (i % 3 == 1) share = floor(share * model->intervals) / model->intervals;
        if (i % 3 == 2) share -= lg_rng_uniform_in(rng, 0, 0.03);
        s[i] = export_rounded(&e->lib, share * model->length);
        if (i > 0 && s[i] < s[i - 1]) s[i] = s[i - 1];
    }
    if (!beyond) return;
    s[0] = export_rounded(&e->lib, -0.01 * model->length);
    s[POINTS - 1] = export_rounded(&e->lib, 1.02 * model->length);
}

/* q without v, v without q, and a point alone must be the same as when all are computed together. */
static void check_parts(const exported *e, const double *x, const double *s, const double *q,
                        const double *v) {
    const double allowed = e->lib.tolerance * (1 + length_of(e));
    double alone[2 * POINTS] = {0}, one[4] = {0};
    exported_curve(&e->lib, x, s, POINTS, alone, NULL);
    assert_all_close(alone, q, 2 * POINTS, 0, allowed);
    exported_curve(&e->lib, x, s, POINTS, NULL, alone);
    assert_all_close(alone, v, 2 * POINTS, 0, allowed);
    exported_curve(&e->lib, x, s + POINTS / 2, 1, one, one + 2);
    assert_all_close(one, q + 2 * (POINTS / 2), 2, 0, allowed);
    assert_all_close(one + 2, v + 2 * (POINTS / 2), 2, 0, allowed);
    one[0] = one[2] = 77;
    exported_curve(&e->lib, x, s, 0, one, one + 2);
    exported_curve(&e->lib, x, NULL, 0, NULL, NULL);
    assert_true(one[0] == 77 && one[2] == 77);
}

/* Reflected boundary conditions must give the reflected curve exactly. */
static void check_mirror(const exported *e, const double *x, const double *s, const double *q,
                         const double *v) {
    double image[8], at[2 * POINTS], along[2 * POINTS];
    for (size_t c = 0; c < 8; c++) image[c] = c % 2 == 1 ? -x[c] : x[c];
    exported_curve(&e->lib, image, s, POINTS, at, along);
    for (size_t i = 0; i < 2 * POINTS; i++) {
        assert_true(at[i] == (i % 2 == 1 ? -q[i] : q[i]));
        assert_true(along[i] == (i % 2 == 1 ? -v[i] : v[i]));
    }
}

/* 200 random curves must agree with the library's. The tangents of the discrete network are differences of
 * nodes over L/N, so their rounding errors are those of the nodes over L/N. */
static void more(exported *e) {
    enum { CURVES = 200, SIZE = 2 * POINTS };
    const lg_surrogate *model = &file_of(e)->run.model;
    const double interval = model->length / model->intervals;
    const double condition = e->lib.inputs == 8 && interval < 1 ? 1 / interval : 1;
    const library of = curves_of(e, POINTS);
    double *q[2], *v[2];
    lg_rng rng = test_rng(21, 27);
    for (int i = 0; i < 2; i++) {
        q[i] = TEST_ARRAY(double, CURVES *SIZE);
        v[i] = TEST_ARRAY(double, CURVES *SIZE);
    }
    for (size_t k = 0; k < CURVES; k++) {
        double *const at[] = {q[0] + SIZE * k, v[0] + SIZE * k, q[1] + SIZE * k, v[1] + SIZE * k}, x[8],
                      s[POINTS];
        draw_boundary(&rng, model->length, x);
        for (size_t c = 0; c < 8; c++) x[c] = export_rounded(&e->lib, x[c]);
        draw_places(e, &rng, s);
        lg_surrogate_curve(of.curves, x, s, POINTS, at[0], at[1], of.work);
        exported_curve(&e->lib, x, s, POINTS, at[2], at[3]);
        if (k % 16 == 0) check_parts(e, x, s, at[2], at[3]);
        if (k % 16 == 0 && model->options.mirror) check_mirror(e, x, s, at[2], at[3]);
    }
    const double errors[] = {export_worst(q[1], q[0], CURVES, SIZE), export_worst(v[1], v[0], CURVES, SIZE)};
    print_message("  curves: q %.2e, v %.2e (v: times %.3g)\n", errors[0], errors[1], condition);
    assert_close(errors[0], 0, 0, e->lib.tolerance);
    assert_close(errors[1], 0, 0, e->lib.tolerance * condition);
}

static const export_kind beams = EXPORT_KIND(examples, make, draw, NULL, more);

TEST_GROUP(export_begin, export_end)

#ifdef EVERY_WAY
enum {
    KINDS = LG_SURROGATE_KIND_COUNT,
    NETS = LG_NET_KIND_COUNT,
    ACTIVATIONS = LG_ACTIVATION_COUNT,
    ALL = KINDS * NETS * ACTIVATIONS * 2
};

/* Every kind, architecture and activation, with and without an embedding. The other choices vary from row to
 * row. */
static example every_network(size_t i) {
    static const char *const ways[][2] = {
        {"gcc", "-O1"}, {"clang", "-O1"}, {"g++", "-O2"}, {"clang++", "-O0"}, {"gcc", "-O3"}};
    static char name[16];
    const size_t kind = i % KINDS, net = i / KINDS % NETS, activation = i / (KINDS * NETS) % ACTIVATIONS;
    const size_t embedded = i / (ALL / 2), turn = kind + net + activation + embedded;
    const char *const *way = ways[i % LG_COUNT(ways)];
    (void)snprintf(name, sizeof name, "net%zu", i);
    return (example){{name, way[0], way[1], ""},
                     (uint32_t)(4 + 7 * (turn % 5)),
                     3.3,
                     turn % 3 > 0,
                     {.kind = (lg_surrogate_kind)kind,
                      .architecture = (lg_net_kind)net,
                      .embedding = embedded ? 6 : 0,
                      .hidden = (uint32_t)(5 + turn),
                      .layers = (uint32_t)(turn % 4),
                      .activation = (lg_activation)activation,
                      .normalise = turn % 2 == 1 && kind != LG_SURROGATE_ANGLE,
                      .mirror = turn / 2 % 2 == 1,
                      .boundary = turn % 3 == 1 && kind == LG_SURROGATE_ANGLE,
                      .modes = turn % 3 == 2 && kind == LG_SURROGATE_DISCRETE ? 5 : 0,
                      .angles = turn % 3 == 1 && kind == LG_SURROGATE_DISCRETE}};
}

TEST("values, Jacobians and curves of every network agree with the library") {
    for (size_t i = 0; i < ALL; i++) {
        const size_t mark = lg_test_owned();
        const example of = every_network(i);
        export_compare_one(&beams, export_opened(&beams, &of, i / KINDS % 2 == 0 ? "f32" : "f64", ""), 1000);
        lg_test_give_back(mark);
    }
}

TEST("a model of each kind is built by every compiler at every optimisation level") {
    for (size_t i = 0; i < 2 * KINDS; i++) {
        const example of = every_network(i + KINDS * NETS * (i / KINDS));
        export_build(&beams, &of, i < KINDS ? "f64" : "f32", export_check_all_ways);
    }
}
#else

TEST("values, Jacobians and curves agree with the library in double precision") {
    export_compare_all(&beams, "f64");
}

TEST("values, Jacobians and curves agree with the library in single precision") {
    export_compare_all(&beams, "f32");
}

/* A place that is not finite makes its own point NaN; a boundary condition that is not finite makes all
 * points NaN. */
TEST("a point of a curve is NaN if its place or a boundary condition is") {
    for (size_t i = 0; i < LG_COUNT(examples); i++) {
        double boundary[8], s[] = {0, 0.3, NAN, 0.9}, q[8], v[8];
        lg_rng rng = test_rng(3, i);
        exported *e = export_made(&beams, &examples[i], "f64", "");
        export_compile(e, "cc", "-O1");
        draw_boundary(&rng, examples[i].length, boundary);
        for (size_t k = 0; k < 4; k++) s[k] *= examples[i].length;
        exported_curve(&e->lib, boundary, s, 4, q, v);
        for (size_t k = 0; k < 8; k++)
            assert_true(isnan(q[k]) == (k / 2 == 2) && isnan(v[k]) == (k / 2 == 2));
        boundary[6] = NAN; /* vNx */
        exported_curve(&e->lib, boundary, s, 4, q, v);
        for (size_t k = 0; k < 8; k++) assert_true(isnan(q[k]) && isnan(v[k]));
    }
}

/* A plain sum would have ten times the error. */
TEST("in single precision a sum over thousands of panels is as accurate as its terms") {
    static const example panels = {{"panels", "gcc", "-O2", ""},
                                   20000,
                                   3.3,
                                   false,
                                   SURROGATE(ANGLE, MLP, 0, 2, 0, TANH, .mirror = false)};
    double boundary[8], s[2], q[2][4], v[4];
    lg_rng rng = test_rng(4, 4);
    draw_boundary(&rng, 3.3, boundary);
    const exported *e = export_opened(&beams, &panels, "f32", "");
    const library of = curves_of(e, 2);
    for (size_t c = 0; c < 8; c++) boundary[c] = c < 2 ? 0 : export_rounded(&e->lib, boundary[c]);
    for (size_t i = 0; i < 2; i++) s[i] = export_rounded(&e->lib, i == 0 ? 1.1 : 3.3);
    lg_surrogate_curve(of.curves, boundary, s, 2, q[0], v, of.work);
    exported_curve(&e->lib, boundary, s, 2, q[1], v);
    const double error = export_worst(q[1], q[0], 1, 4);
    print_message("%u panels: %.2e\n", panels.intervals, error);
    assert_close(error, 0, 0, 4e-7);
}

TEST("the header describes the model, says where its numbers come from, and gives the training range") {
    static const char *const rows[][2] = {
        {"plain", "discrete network|inner nodes and tangents|L = 3.3, N = 8|q_7x q_7y|mlp"},
        {"fixed", "discrete network|outputs y (76)|q_19x q_19y|modes 12"},
        {"turned", "discrete network|outputs y (76)|angles true"},
        {"gated", "continuous network|dq/ds|sigmoid|embedding 6|normalise true|mirror true"},
        {"bend", "angle network|radians|curvature|boundary true|mult-affine"},
    };
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        const exported *e = export_made(&beams, export_find(&beams, rows[r][0]), "f64", "");
        double least = INFINITY;
        const char *header = test_text("%s/m.h", e->folder);
        export_expect_words(header, rows[r][1]);
        export_expect_words(header,
                            "2.5e-07|3.5e-07|lg-elastica train beams.h5|0000000042|curves 1000|batch 10");
        for (size_t i = 0; i < TRAINED; i++) least = fmin(least, file_of(e)->trained[8 * i + 4]);
        export_expect_words(header, test_text("qNx   %.6g to ", least));
    }
    export_expect("! grep -r NAME */m.h");
    cli_json("lg-export", "plain.h5 --out told", "kind \"surrogate\", scheme null");
}

TEST("a model of each kind is built by many compilers") {
    export_build(&beams, export_find(&beams, "turned"), "f64", export_check_ways);
    export_build(&beams, export_find(&beams, "gated"), "f32", export_check_ways);
    export_build(&beams, export_find(&beams, "bend"), "f64", export_check_ways);
}
#endif

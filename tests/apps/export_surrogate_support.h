/* Surrogates as exported C against the library: small networks of every kind with random parameters. */
#ifndef LG_TEST_EXPORT_SURROGATE_SUPPORT_H
#define LG_TEST_EXPORT_SURROGATE_SUPPORT_H

#include "export_support.h"

#include "liegrad/io.h"
#include "liegrad/model.h"

enum { TRAINED = 20, POINTS = 21 };

/* A model in its file, as the library has it, and as it was compiled. */
typedef struct beam {
    lg_surrogate_file file;
    lg_model *model;
    export_library lib;
    size_t place; /* 1 where s is an input */
    lg_surrogate_curves *curves;
    void *work;
} beam;

/* ---- models ---- */

static inline void draw_tangent(lg_rng *rng, double *v) {
    const double angle = lg_rng_uniform_in(rng, -3.1, 3.1);
    v[0] = cos(angle);
    v[1] = sin(angle);
}

static inline void draw_boundary(lg_rng *rng, double length, double *x) {
    for (int c = 0; c < 2; c++) {
        x[c] = lg_rng_uniform_in(rng, -0.5, 0.5) * length;
        x[4 + c] = x[c] + lg_rng_uniform_in(rng, -0.7, 0.7) * length;
    }
    draw_tangent(rng, x + 2);
    draw_tangent(rng, x + 6);
}

static inline beam beam_make(const lg_surrogate_options *options, uint32_t intervals, double length,
                             bool trained) {
    beam b = {.place = options->kind != LG_SURROGATE_DISCRETE};
    lg_error error = {LG_OK, ""};
    lg_rng rng;
    lg_rng_seed(&rng, 11, 12);
    if (lg_surrogate_init(&b.file.run.model, options, intervals, length, 0.4 * length, &error) != LG_OK)
        fail_msg("%s", error.message);
    b.file.run.training = (lg_training){.dtype = LG_F64,
                                        .epochs = 300,
                                        .batch = 32,
                                        .lr = 0.002,
                                        .lr_step = 1,
                                        .lr_gamma = 0.5,
                                        .adam_eps = 1e-8,
                                        .shards = 1,
                                        .seed = 7};
    b.file.run.train_fraction = 0.9;
    b.file.run.test_fraction = 0.1;
    b.file.run.curves = 1000;
    (void)snprintf(b.file.run.data_sha256, sizeof b.file.run.data_sha256, "%064d", 42);
    b.file.has_errors = true;
    b.file.train_mse = 2.5e-7;
    b.file.test_mse = 3.5e-7;
    (void)snprintf(b.file.provenance.command, sizeof b.file.provenance.command, "lg-elastica train beams.h5");
    b.file.parameters = lg_surrogate_parameters(&b.file.run.model);
    b.file.theta = calloc(b.file.parameters, sizeof(double));
    assert_non_null(b.file.theta);
    lg_net_initialise(&b.file.run.model.net, LG_INIT_FAN_IN, &rng, b.file.theta);
    if (trained) {
        b.file.trained_count = TRAINED;
        b.file.trained = calloc((size_t)8 * TRAINED, sizeof(double));
        assert_non_null(b.file.trained);
        for (size_t i = 0; i < TRAINED; i++) draw_boundary(&rng, length, b.file.trained + 8 * i);
    }
    assert_ok(lg_model_create_surrogate(NULL, &b.file.run.model, b.file.theta, &b.model, NULL));
    assert_ok(
        lg_surrogate_curves_create(NULL, &b.file.run.model, b.file.theta, LG_F64, POINTS, &b.curves, NULL));
    const size_t bytes[] = {lg_model_work_size(b.model), lg_surrogate_curves_work_size(b.curves)};
    const size_t room = bytes[0] > bytes[1] ? bytes[0] : bytes[1];
    b.work = aligned_alloc(64, (room + 63) / 64 * 64);
    assert_non_null(b.work);
    return b;
}

static inline void beam_free(beam *b) {
    lg_surrogate_curves_destroy(b->curves);
    lg_model_destroy(b->model);
    free(b->work);
    free(b->file.trained);
    free(b->file.theta);
    *b = (beam){.work = NULL};
}

/* NAME.h5 and the folder NAME with its C. */
static inline void beam_export(const beam *b, const char *name, bool single) {
    char path[1024], arguments[256];
    lg_error error = {LG_OK, ""};
    (void)snprintf(path, sizeof path, "%s/%s.h5", cli_folder, name);
    if (lg_model_save_surrogate(NULL, path, &b->file, NULL, &error) != LG_OK) fail_msg("%s", error.message);
    (void)snprintf(arguments, sizeof arguments, "%s.h5 --out %s --golden 6 --dtype %s", name, name,
                   single ? "f32" : "f64");
    export_run(arguments);
}

/* ---- values ---- */

static inline void beam_draw(void *user, lg_rng *rng, double *x) {
    const beam *b = user;
    const double length = b->file.run.model.length;
    if (b->place == 1) x[0] = lg_rng_uniform_in(rng, -0.02, 1.02) * length;
    draw_boundary(rng, length, x + b->place);
}

static inline void beam_reference(void *user, const double *x, double *y, double *jacobian) {
    const beam *b = user;
    lg_model_jacobian(b->model, x, y, jacobian, b->work);
}

/* ---- curves ---- */

typedef void (*curve_function)(const void *x, const void *s, int points, void *q, void *v, void *work);

/* NAME_curve in doubles; work has a guard behind it. */
static inline void beam_curve(const beam *b, const double *x, const double *s, size_t points, double *q,
                              double *v) {
    enum { GUARD = 16 };
    const export_library *lib = &b->lib;
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

/* Rising: the ends, nodes, places between; now and then beyond the ends. */
static inline void draw_places(const beam *b, lg_rng *rng, double *s) {
    const lg_surrogate *model = &b->file.run.model;
    const bool beyond = lg_rng_below(rng, 4) == 0;
    for (size_t i = 0; i < POINTS; i++) {
        double share = (double)i / (POINTS - 1);
        if (i % 3 == 1) share = floor(share * model->intervals) / model->intervals;
        if (i % 3 == 2) share -= lg_rng_uniform_in(rng, 0, 0.03);
        s[i] = export_rounded(&b->lib, share * model->length);
        if (i > 0 && s[i] < s[i - 1]) s[i] = s[i - 1];
    }
    if (!beyond) return;
    s[0] = export_rounded(&b->lib, -0.01 * model->length);
    s[POINTS - 1] = export_rounded(&b->lib, 1.02 * model->length);
}

/* q alone and v alone are what they are together, and a point what it is among others. */
static inline void check_parts(const beam *b, const double *x, const double *s, const double *q,
                               const double *v) {
    const double allowed = b->lib.tolerance * (1 + b->file.run.model.length);
    double alone[2 * POINTS], one[4];
    beam_curve(b, x, s, POINTS, alone, NULL);
    for (size_t i = 0; i < 2 * POINTS; i++) assert_close(alone[i], q[i], 0, allowed);
    beam_curve(b, x, s, POINTS, NULL, alone);
    for (size_t i = 0; i < 2 * POINTS; i++) assert_close(alone[i], v[i], 0, allowed);
    beam_curve(b, x, s + POINTS / 2, 1, one, one + 2);
    for (size_t c = 0; c < 2; c++) {
        assert_close(one[c], q[2 * (POINTS / 2) + c], 0, allowed);
        assert_close(one[2 + c], v[2 * (POINTS / 2) + c], 0, allowed);
    }
    one[0] = one[2] = 77;
    beam_curve(b, x, s, 0, one, one + 2);
    beam_curve(b, x, NULL, 0, NULL, NULL);
    assert_true(one[0] == 77 && one[2] == 77);
}

/* Reflected boundary conditions give the reflected curve, digit by digit. */
static inline void check_mirror(const beam *b, const double *x, const double *s, const double *q,
                                const double *v) {
    double image[8], at[2 * POINTS], along[2 * POINTS];
    for (size_t c = 0; c < 8; c++) image[c] = c % 2 == 1 ? -x[c] : x[c];
    beam_curve(b, image, s, POINTS, at, along);
    for (size_t i = 0; i < 2 * POINTS; i++) {
        assert_true(at[i] == (i % 2 == 1 ? -q[i] : q[i]));
        assert_true(along[i] == (i % 2 == 1 ? -v[i] : v[i]));
    }
}

/* `curves` random curves against the library's. The discrete network's tangents are differences of nodes over
 * L/N: so is their rounding. */
static inline void beam_compare_curves(const beam *b, const char *title, size_t curves) {
    const lg_surrogate *model = &b->file.run.model;
    const double interval = model->length / model->intervals;
    const double condition = model->options.kind == LG_SURROGATE_DISCRETE && interval < 1 ? 1 / interval : 1;
    double *q[2], *v[2];
    lg_rng rng;
    lg_rng_seed(&rng, 21, 27);
    for (int i = 0; i < 2; i++) {
        q[i] = calloc(curves * POINTS, 2 * sizeof(double));
        v[i] = calloc(curves * POINTS, 2 * sizeof(double));
        assert_true(q[i] != NULL && v[i] != NULL);
    }
    for (size_t k = 0; k < curves; k++) {
        const size_t at = 2 * POINTS * k;
        double x[8], s[POINTS];
        draw_boundary(&rng, model->length, x);
        for (size_t c = 0; c < 8; c++) x[c] = export_rounded(&b->lib, x[c]);
        draw_places(b, &rng, s);
        lg_surrogate_curve(b->curves, x, s, POINTS, q[0] + at, v[0] + at, b->work);
        beam_curve(b, x, s, POINTS, q[1] + at, v[1] + at);
        if (k % 16 == 0) check_parts(b, x, s, q[1] + at, v[1] + at);
        if (k % 16 == 0 && model->options.mirror) check_mirror(b, x, s, q[1] + at, v[1] + at);
    }
    const double errors[] = {export_worst(q[1], q[0], curves, 2 * POINTS),
                             export_worst(v[1], v[0], curves, 2 * POINTS)};
    print_message("%s: q %.2e, v %.2e; tolerance %.2e (v: times %.3g)\n", title, errors[0], errors[1],
                  b->lib.tolerance, condition);
    assert_close(errors[0], 0, 0, b->lib.tolerance);
    assert_close(errors[1], 0, 0, b->lib.tolerance * condition);
    for (int i = 0; i < 2; i++) {
        free(v[i]);
        free(q[i]);
    }
}

/* Exported, compiled with this compiler and flags, 1000 values and `curves` curves compared. */
static inline void beam_check(beam *b, const char *name, bool single, const char *compiler, const char *flags,
                              size_t curves) {
    char title[160];
    (void)snprintf(title, sizeof title, "%s, %s, %s %s", name, single ? "float" : "double", compiler, flags);
    beam_export(b, name, single);
    b->lib = export_open(name, name, compiler, flags);
    assert_int_equal(b->lib.inputs, lg_model_inputs(b->model));
    assert_int_equal(b->lib.outputs, lg_model_outputs(b->model));
    assert_true(b->lib.single == single);
    export_compare(&b->lib, title, 1000, beam_draw, beam_reference, b);
    beam_compare_curves(b, title, curves);
    export_close(&b->lib);
}

#endif

/* Surrogates as exported C against the library: small networks of every kind with random parameters. */
#ifndef LG_TEST_EXPORT_SURROGATE_H
#define LG_TEST_EXPORT_SURROGATE_H

#include "export_models.h"

#include "liegrad/io.h"
#include "liegrad/model.h"
#include "support/modes.h"

enum { TRAINED = 20, POINTS = 21 };

typedef struct beam {
    lg_model_file file;
    const lg_surrogate_file *trained; /* of `file` */
    const lg_surrogate *model;
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

static inline void beam_release(void *of) {
    beam *b = of;
    lg_surrogate_curves_destroy(b->curves);
    lg_model_file_destroy(&b->file);
}

/* NAME.h5, and what the library reads from it. */
static inline beam *beam_make(const char *name, const lg_surrogate_options *options, uint32_t intervals,
                              double length, bool trained) {
    char path[1024];
    lg_rng rng;
    lg_rng_seed(&rng, 11, 12);
    lg_surrogate_file file = {.run = {.train_fraction = 0.9, .test_fraction = 0.1, .curves = 1000},
                              .has_errors = true,
                              .train_mse = 2.5e-7,
                              .test_mse = 3.5e-7};
    file.run.training = (lg_training){.dtype = LG_F64,
                                      .epochs = 300,
                                      .batch = 32,
                                      .lr = 0.002,
                                      .lr_step = 1,
                                      .lr_gamma = 0.5,
                                      .adam_eps = 1e-8,
                                      .shards = 1,
                                      .seed = 7};
    assert_ok(lg_surrogate_init(&file.run.model, options, intervals, length, 0.4 * length, NULL));
    give_modes(&file.run.model);
    (void)snprintf(file.run.data_sha256, sizeof file.run.data_sha256, "%064d", 42);
    (void)snprintf(file.provenance.command, sizeof file.provenance.command, "lg-elastica train beams.h5");
    file.parameters = lg_surrogate_parameters(&file.run.model);
    file.theta = TEST_ARRAY(double, file.parameters);
    lg_net_initialise(&file.run.model.net, LG_INIT_FAN_IN, &rng, file.theta);
    if (trained) {
        file.trained_count = TRAINED;
        file.trained = TEST_ARRAY(double, 8 * TRAINED);
        for (size_t i = 0; i < TRAINED; i++) draw_boundary(&rng, length, file.trained + 8 * i);
    }
    (void)snprintf(path, sizeof path, "%s/%s.h5", cli_folder, name);
    assert_ok(lg_model_save_surrogate(NULL, path, &file, NULL, NULL));
    beam *b = TEST_ARRAY(beam, 1);
    assert_ok(lg_model_load(NULL, path, NULL, &b->file, NULL));
    lg_test_owns(b, beam_release);
    b->trained = lg_model_file_of(&b->file, &lg_recipe_surrogate);
    b->model = &b->trained->run.model;
    b->place = options->kind != LG_SURROGATE_DISCRETE;
    assert_ok(
        lg_surrogate_curves_create(NULL, b->model, b->trained->theta, LG_F64, POINTS, &b->curves, NULL));
    b->work = TEST_ARRAY(unsigned char,
                         lg_model_work_size(b->file.model) + lg_surrogate_curves_work_size(b->curves));
    return b;
}

/* ---- values ---- */

static inline void beam_draw(void *user, lg_rng *rng, double *x) {
    const beam *b = ((const exported *)user)->model;
    if (b->place == 1) x[0] = lg_rng_uniform_in(rng, -0.02, 1.02) * b->model->length;
    draw_boundary(rng, b->model->length, x + b->place);
}

static inline void beam_reference(void *user, const double *x, double *y, double *jacobian) {
    const beam *b = ((const exported *)user)->model;
    lg_model_jacobian(b->file.model, x, y, jacobian, b->work);
}

/* ---- curves ---- */

/* NAME_curve in doubles; work has a guard behind it. */
static inline void beam_curve(const export_library *lib, const double *x, const double *s, size_t points,
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

/* Rising: the ends, nodes, places between; now and then beyond the ends. */
static inline void draw_places(const exported *e, lg_rng *rng, double *s) {
    const lg_surrogate *model = ((const beam *)e->model)->model;
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

/* q alone and v alone are what they are together, and a point what it is among others. */
static inline void check_parts(const exported *e, const double *x, const double *s, const double *q,
                               const double *v) {
    const double allowed = e->lib.tolerance * (1 + ((const beam *)e->model)->model->length);
    double alone[2 * POINTS] = {0}, one[4] = {0};
    beam_curve(&e->lib, x, s, POINTS, alone, NULL);
    assert_all_close(alone, q, 2 * POINTS, 0, allowed);
    beam_curve(&e->lib, x, s, POINTS, NULL, alone);
    assert_all_close(alone, v, 2 * POINTS, 0, allowed);
    beam_curve(&e->lib, x, s + POINTS / 2, 1, one, one + 2);
    assert_all_close(one, q + 2 * (POINTS / 2), 2, 0, allowed);
    assert_all_close(one + 2, v + 2 * (POINTS / 2), 2, 0, allowed);
    one[0] = one[2] = 77;
    beam_curve(&e->lib, x, s, 0, one, one + 2);
    beam_curve(&e->lib, x, NULL, 0, NULL, NULL);
    assert_true(one[0] == 77 && one[2] == 77);
}

/* Reflected boundary conditions give the reflected curve, digit by digit. */
static inline void check_mirror(const exported *e, const double *x, const double *s, const double *q,
                                const double *v) {
    double image[8], at[2 * POINTS], along[2 * POINTS];
    for (size_t c = 0; c < 8; c++) image[c] = c % 2 == 1 ? -x[c] : x[c];
    beam_curve(&e->lib, image, s, POINTS, at, along);
    for (size_t i = 0; i < 2 * POINTS; i++) {
        assert_true(at[i] == (i % 2 == 1 ? -q[i] : q[i]));
        assert_true(along[i] == (i % 2 == 1 ? -v[i] : v[i]));
    }
}

/* 200 random curves against the library's. The discrete network's tangents are differences of nodes over L/N:
 * so is their rounding. */
static inline void beam_curves(exported *e) {
    enum { CURVES = 200, SIZE = 2 * POINTS };
    const beam *b = e->model;
    const double interval = b->model->length / b->model->intervals;
    const double condition = b->place == 0 && interval < 1 ? 1 / interval : 1;
    double *q[2], *v[2];
    lg_rng rng;
    assert_int_equal(e->lib.inputs, lg_model_inputs(b->file.model));
    assert_int_equal(e->lib.outputs, lg_model_outputs(b->file.model));
    lg_rng_seed(&rng, 21, 27);
    for (int i = 0; i < 2; i++) {
        q[i] = TEST_ARRAY(double, CURVES *SIZE);
        v[i] = TEST_ARRAY(double, CURVES *SIZE);
    }
    for (size_t k = 0; k < CURVES; k++) {
        double *const at[] = {q[0] + SIZE * k, v[0] + SIZE * k, q[1] + SIZE * k, v[1] + SIZE * k}, x[8],
                      s[POINTS];
        draw_boundary(&rng, b->model->length, x);
        for (size_t c = 0; c < 8; c++) x[c] = export_rounded(&e->lib, x[c]);
        draw_places(e, &rng, s);
        lg_surrogate_curve(b->curves, x, s, POINTS, at[0], at[1], b->work);
        beam_curve(&e->lib, x, s, POINTS, at[2], at[3]);
        if (k % 16 == 0) check_parts(e, x, s, at[2], at[3]);
        if (k % 16 == 0 && b->model->options.mirror) check_mirror(e, x, s, at[2], at[3]);
    }
    const double errors[] = {export_worst(q[1], q[0], CURVES, SIZE), export_worst(v[1], v[0], CURVES, SIZE)};
    print_message("  curves: q %.2e, v %.2e (v: times %.3g)\n", errors[0], errors[1], condition);
    assert_close(errors[0], 0, 0, e->lib.tolerance);
    assert_close(errors[1], 0, 0, e->lib.tolerance * condition);
}

#endif

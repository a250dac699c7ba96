/* Shared by the tests of src/anomaly/classify: clouds of points, features and windows that the running test
 * owns. */
#ifndef LG_CLASSIFY_SUPPORT_H
#define LG_CLASSIFY_SUPPORT_H

#include "support/fixtures.h"

#include "liegrad/classify.h"
#include "liegrad/core.h"

/* n points in d dimensions. Point i has the class i mod classes; the centres of the classes are `apart` from
 * the origin along different axes. */
static inline double *clouds(size_t n, uint32_t d, uint32_t classes, double apart, uint64_t seed,
                             uint32_t *label) {
    double *x = TEST_ARRAY(double, n *d);
    lg_rng rng = test_rng(seed, 0);
    for (size_t i = 0; i < n; i++) {
        label[i] = (uint32_t)(i % classes);
        for (uint32_t j = 0; j < d; j++)
            x[i * d + j] = lg_rng_normal(&rng) + (j % classes == label[i] ? apart : 0.0);
    }
    return x;
}

OWNED(lg_series, lg_series_destroy)
OWNED(lg_features, lg_features_destroy)
OWNED(lg_windows, lg_windows_destroy)
OWNED(lg_classifier, lg_classifier_destroy)

/* Scores (n, classes) of the rows of x (n, d) by a model alone, without standardisation. */
static inline void scores_alone(const lg_classifier *model, const double *x, size_t n, uint32_t d,
                                double *score) {
    lg_classifier c = *model;
    lg_program *program;
    lg_plan *plan;
    lg_plan_options options;
    size_t at;
    c.pca = (lg_pca){.inputs = d, .mean = TEST_ARRAY(double, d), .scale = TEST_ARRAY(double, d)};
    for (uint32_t j = 0; j < d; j++) c.pca.scale[j] = 1;
    assert_ok(lg_classifier_program(NULL, &c, &program, NULL));
    assert_ok(lg_program_find(program, "score", &at, NULL));
    lg_plan_options_init(&options);
    options.rows = n;
    assert_ok(lg_plan_create(program, at, &options, &plan, NULL));
    void *work = aligned_alloc(64, (lg_plan_work_size(plan) + 64) / 64 * 64);
    lg_plan_eval(plan, (const void *const[]){x}, (void *const[]){score}, work);
    free(work);
    lg_plan_destroy(plan);
    lg_program_destroy(program);
}
static inline void logistic_scores(const lg_logistic *m, const double *x, size_t n, double *score) {
    const lg_classifier c = {.method = LG_METHOD_LOGISTIC, .classes = m->classes, .logistic = *m};
    scores_alone(&c, x, n, m->inputs, score);
}
static inline void svm_scores(const lg_svm *m, const double *x, size_t n, double *score) {
    const bool rbf = m->kernel == LG_KERNEL_RBF;
    const lg_classifier c = {
        .method = rbf ? LG_METHOD_SVM_RBF : LG_METHOD_SVM_LINEAR, .classes = m->classes, .svm = *m};
    scores_alone(&c, x, n, m->inputs, score);
}

static inline lg_features features_of(lg_feature_kind kind, bool directions_x, const lg_series *series,
                                      uint32_t length, const lg_scaler *scaler) {
    lg_features f;
    assert_ok(lg_features_create(NULL, kind, directions_x, series, length, scaler, &f, NULL));
    return *own_lg_features(f);
}

static inline lg_windows windows_of(const lg_series *series) {
    lg_windows w;
    assert_ok(lg_windows_create(NULL, series, 0, 0, &w, NULL));
    return *own_lg_windows(w);
}

/* At least 96 random convolution features, fitted to all windows of the series. */
static inline lg_features rocket_made(const lg_series *series, uint32_t count, uint64_t seed) {
    const lg_windows w = windows_of(series);
    lg_rocket_options options;
    lg_scaler scaler;
    lg_features f;
    lg_rocket_options_init(&options);
    options.features = count;
    options.seed = seed;
    assert_ok(lg_scaler_fit(NULL, series, &w, NULL, w.count, false, &scaler));
    assert_ok(lg_rocket_fit(NULL, &options, series, &w, NULL, w.count, &scaler, &f, NULL));
    lg_scaler_destroy(&scaler);
    return f;
}

static inline lg_features rocket_of(const lg_series *series, uint32_t count, uint64_t seed) {
    return *own_lg_features(rocket_made(series, count, seed));
}

#endif

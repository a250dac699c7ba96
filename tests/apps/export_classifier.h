/* Classical classifiers for the tests of lg-export: every kind of features with every method, with and
 * without principal components, of two and more classes. */
#ifndef LG_TEST_EXPORT_CLASSIFIER_H
#define LG_TEST_EXPORT_CLASSIFIER_H

#include "export_models.h"

#include "core/core.h"
#include "liegrad/classify.h"
#include "liegrad/io.h"
#include "liegrad/metrics.h"
#include "liegrad/series.h"

typedef struct sample {
    const char *name;
    lg_feature_kind kind;
    bool directions_x;
    lg_method method;
    uint32_t components, classes;
    const char *compiler, *flags;
} sample;

#define RAW      LG_FEATURES_RAW
#define STD      LG_FEATURES_STD
#define COV      LG_FEATURES_COV
#define BASELINE LG_FEATURES_BASELINE
#define SPECTRUM LG_FEATURES_SPECTRUM
#define LOGISTIC LG_METHOD_LOGISTIC
#define TREE     LG_METHOD_TREE
#define LINEAR   LG_METHOD_SVM_LINEAR
#define RBF      LG_METHOD_SVM_RBF

static const sample samples[] = {
    {"cov-logistic", COV, false, LOGISTIC, 0, 2, "gcc", "-O2"},
    {"cov-tree", COV, false, TREE, 4, 3, "clang", "-O3"},
    {"cov-linear", COV, true, LINEAR, 3, 3, "gcc", "-O3 -march=native"},
    {"cov-rbf", COV, false, RBF, 0, 3, "clang", "-O2"},
    {"std-logistic", STD, false, LOGISTIC, 2, 3, "gcc", "-O1"},
    {"std-tree", STD, false, TREE, 0, 2, "clang", "-O1"},
    {"std-linear", STD, false, LINEAR, 0, 2, "gcc", "-O0"},
    {"std-rbf", STD, true, RBF, 0, 2, "clang", "-O3 -march=native"},
    {"raw-logistic", RAW, false, LOGISTIC, 5, 2, "gcc", "-O3"},
    {"raw-tree", RAW, true, TREE, 0, 3, "clang", "-O0"},
    {"raw-linear", RAW, false, LINEAR, 0, 3, "gcc", "-O2"},
    {"raw-rbf", RAW, false, RBF, 6, 4, "clang", "-O2"},
    {"baseline-logistic", BASELINE, false, LOGISTIC, 0, 2, "gcc", "-O2"},
    {"baseline-tree", BASELINE, false, TREE, 2, 2, "clang", "-O2"},
    {"baseline-linear", BASELINE, true, LINEAR, 0, 2, "gcc", "-O3"},
    {"baseline-rbf", BASELINE, false, RBF, 3, 3, "clang", "-O3"},
    {"spectrum-logistic", SPECTRUM, false, LOGISTIC, 0, 2, "gcc", "-O2"},
    {"spectrum-tree", SPECTRUM, false, TREE, 5, 3, "clang", "-O3"},
    {"spectrum-linear", SPECTRUM, true, LINEAR, 0, 3, "gcc", "-O3 -march=native"},
    {"spectrum-rbf", SPECTRUM, false, RBF, 4, 3, "clang", "-O2"},
};
#ifndef LENGTH_OF_WINDOWS
#define LENGTH_OF_WINDOWS 33
#endif
enum { CHANNELS = 4, LENGTH = LENGTH_OF_WINDOWS, WINDOWS = 40, INPUTS = CHANNELS * LENGTH };

typedef struct fitted {
    const sample *of;
    lg_classifier classifier;
    lg_series series;
    lg_scaler scaler;
    double *work;
    float window[INPUTS];
} fitted;

/* A window of a class as recorded: correlated noise, larger in later classes, with an offset; sizes of the
 * channels are far apart. Its size varies from place to place, for the lines of BASELINE. */
static inline void classifier_window(lg_rng *rng, uint32_t class, float *x) {
    static const double size[CHANNELS] = {0.02, 3, 400, 5e4}, offset[CHANNELS] = {0.01, 9.81, -50, 1e4};
    const double trend = lg_rng_uniform_in(rng, 0.7, 1.4);
    for (uint32_t t = 0; t < LENGTH; t++) {
        const double swell = trend * (1 + 0.6 * sin(0.7 * t));
        double z[CHANNELS], mixed[CHANNELS];
        for (uint32_t c = 0; c < CHANNELS; c++) z[c] = lg_rng_normal(rng);
        mixed[0] = z[0];
        mixed[1] = z[1] + (0.3 + 0.4 * class) * z[0];
        mixed[2] = (1 + 0.5 * class) * z[0] + 0.3 * z[2];
        mixed[3] = z[3] * (1 + 0.2 * class) + 0.5 * z[1];
        for (uint32_t c = 0; c < CHANNELS; c++)
            x[c * LENGTH + t] = (float)(size[c] * swell * mixed[c] + offset[c] + size[c] * class * (c == 1));
    }
}

static inline void classifier_release(void *of) {
    fitted *f = of;
    lg_classifier_destroy(&f->classifier);
    lg_series_destroy(&f->series);
    lg_scaler_destroy(&f->scaler);
}

static inline fitted *classifier_fit(const sample *of) {
    static const char *const names[CHANNELS] = {"acc_lower_x", "acc_lower_y", "moment_x", "moment_y"};
    lg_error error = {LG_OK, ""};
    lg_windows windows;
    lg_method_options options;
    lg_rng rng;
    fitted *f = TEST_ARRAY(fitted, 1);
    lg_rng_seed(&rng, 11, of->classes);
    f->of = of;
    f->series = (lg_series){.count = WINDOWS * of->classes,
                            .channels = CHANNELS,
                            .length = LENGTH,
                            .classes = of->classes,
                            .rate = 10};
    assert_ok(lg_series_allocate(NULL, &f->series, false, false));
    lg_test_owns(f, classifier_release);
    f->series.channel_name = lg_alloc(NULL, CHANNELS, sizeof *f->series.channel_name);
    for (uint32_t c = 0; c < CHANNELS; c++)
        (void)snprintf(f->series.channel_name[c], LG_SERIES_NAME, "%s", names[c]);
    for (size_t i = 0; i < f->series.count; i++) {
        f->series.label[i] = (uint32_t)(i % of->classes);
        classifier_window(&rng, f->series.label[i], f->series.x + i * INPUTS);
    }
    assert_ok(lg_windows_create(NULL, &f->series, 0, 0, &windows, &error));
    assert_ok(lg_scaler_fit(NULL, &f->series, &windows, NULL, windows.count, false, &f->scaler));
    lg_features *features = &f->classifier.features;
    assert_ok(lg_features_create(NULL, of->kind, of->directions_x, &f->series, LENGTH, &f->scaler, features,
                                 &error));
    double *table = TEST_ARRAY(double, windows.count * features->count);
    assert_ok(lg_features_table(NULL, features, &f->series, &windows, 1, table, &error));
    lg_method_options_init(&options);
    options.method = of->method;
    options.components = of->components < features->count ? of->components : features->count;
    if (lg_classifier_fit(NULL, &options, table, f->series.label, NULL, windows.count, features->count,
                          of->classes, &f->classifier, &error) != LG_OK)
        fail_msg("%s: %s", of->name, error.message);
    lg_windows_destroy(&windows);
    f->work = lg_test_memory(lg_classifier_work_size(&f->classifier) +
                             lg_classifier_jacobian_work_size(&f->classifier));
    return f;
}

/* As lg-anomaly train writes it: NAME.h5. */
static inline void classifier_save(const fitted *f) {
    char file[128], path[1024], hash[LG_SHA256_TEXT] = "";
    lg_file_writer *writer = NULL;
    lg_archive_writer to;
    const double fraction = 0.25, accuracy = 0.9375, f1 = 0.875;
    const uint64_t seed = 1, count = f->series.count, length = LENGTH;
    const struct {
        const char *path;
        lg_element type;
        const void *value;
    } rows[] = {{"run/test_fraction", LG_ELEMENT_F64, &fraction},
                {"run/accuracy", LG_ELEMENT_F64, &accuracy},
                {"run/f1", LG_ELEMENT_F64, &f1},
                {"run/seed", LG_ELEMENT_U64, &seed},
                {"run/windows", LG_ELEMENT_U64, &count},
                {"run/window", LG_ELEMENT_U64, &length},
                {"run/hop", LG_ELEMENT_U64, &length}};
    (void)snprintf(file, sizeof file, "%s.h5", f->of->name);
    cli_path(file, path, sizeof path);
    memset(hash, 'b', LG_SHA256_TEXT - 1);
    assert_ok(lg_file_writer_create(NULL, path, "classifier", NULL, &writer, NULL));
    assert_ok(lg_file_writer_archive(writer, "", &to));
    assert_ok(lg_file_writer_names(writer, &f->series, NULL));
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        assert_ok(to.array(to.user, rows[i].path, rows[i].type, 0, NULL, rows[i].value));
    assert_ok(to.text(to.user, "run/method", lg_method_name(f->classifier.method)));
    assert_ok(to.text(to.user, "run/split", "random"));
    assert_ok(to.text(to.user, "run/data_sha256", hash));
    assert_ok(lg_classifier_save(&f->classifier, &to, NULL));
    assert_ok(lg_file_writer_commit(writer, NULL));
    lg_file_writer_destroy(writer);
}

static inline const char *classifier_name(size_t i) {
    return samples[i].name;
}

static inline export_way classifier_way(size_t i) {
    return (export_way){samples[i].compiler, samples[i].flags};
}

static inline void *classifier_make(size_t i) {
    fitted *f = classifier_fit(&samples[i]);
    classifier_save(f);
    return f;
}

#endif

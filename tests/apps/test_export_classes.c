/* Compares exported table networks, detectors and classical classifiers with the library: value, gradient,
 * features, scores and classes of random inputs in both types; windows whose covariance is singular;
 * headers.
 * ctest-labels: slow apps/lg-export src/anomaly src/table src/nn */
#include "export_models.h"
#include "support/decisions.h"

#include "core/core.h"
#include "datasets/series_files.h"
#include "files/h5.h"
#include "liegrad/anomaly.h"
#include "liegrad/classify.h"
#include "liegrad/series.h"
#include "liegrad/table.h"

enum { ROWS = 1000, CHANNELS = 4, MOST_INPUTS = 1200, MOST = 512 };

/* ---- table networks ---- */

typedef struct table_example {
    export_row row;
    uint32_t inputs, outputs;
    double size; /* size of the columns' values */
    lg_table_options options;
} table_example;

#define NETWORK(task_, kind, activation_, layers, width, linear_)                                            \
    {                                                                                                        \
        .task = LG_TABLE_##task_, .network = LG_NET_##kind, .activation = LG_##activation_,                  \
        .hidden_count = layers, .hidden = {width, width, width}, .linear = linear_                           \
    }

static const table_example table_examples[] = {
    {.row = {"plain", "gcc", "-O2", ""}, 4, 2, 1, NETWORK(REGRESSION, MLP, TANH, 2, 9, true)},
    {.row = {"large", "clang", "-O3", ""}, 3, 1, 1e9, NETWORK(REGRESSION, RESNET, SWISH, 2, 8, true)},
    {.row = {"small", "gcc", "-O1", ""}, 2, 5, 1e-9, NETWORK(REGRESSION, MULT, SIGMOID, 3, 6, false)},
    {.row = {"gates", "g++", "-O2", ""}, 1, 1, 1, NETWORK(REGRESSION, MULT_AFFINE, SINE, 2, 5, true)},
    {.row = {"classes", "gcc", "-O3 -march=native -ffp-contract=fast", ""},
     5,
     4,
     100,
     NETWORK(CLASSIFICATION, MLP, TANH, 1, 10, true)},
    {.row = {"two", "clang", "-O1", ""}, 3, 2, 1, NETWORK(CLASSIFICATION, RESNET, SWISH, 1, 7, false)},
};

static lg_scaler scaler_of(uint32_t columns, double size, lg_rng *rng) {
    lg_scaler made = {
        .channels = columns, .mean = TEST_ARRAY(double, columns), .scale = TEST_ARRAY(double, columns)};
    for (uint32_t c = 0; c < columns; c++) {
        made.mean[c] = 20 * size * lg_rng_normal(rng);
        made.scale[c] = size * lg_rng_uniform_in(rng, 0.5, 2);
    }
    return made;
}

static void *make_table(const void *row) {
    const table_example *of = row;
    lg_rng rng = test_rng(13, (uint64_t)(of - table_examples));
    lg_table_file file = {
        .run = {.training = export_training(), .rows = 321}, .rmse = 0.125, .accuracy = NAN, .f1 = NAN};
    file.run.training.batch = 1;
    assert_ok(lg_table_init(&file.run.model, &of->options, of->inputs, of->outputs, NULL));
    file.parameters = lg_table_parameters(&file.run.model);
    file.theta = TEST_ARRAY(double, file.parameters);
    lg_table_initialise(&file.run.model, &rng, file.theta);
    for (size_t k = 0; k < file.parameters; k++) file.theta[k] += 0.2 * lg_rng_normal(&rng);
    file.inputs = scaler_of(of->inputs, of->size, &rng);
    if (of->options.task == LG_TABLE_REGRESSION) file.outputs = scaler_of(of->outputs, of->size, &rng);
    file.input_name = (char(*)[LG_TABLE_NAME])lg_test_memory(of->inputs * (size_t)LG_TABLE_NAME);
    for (uint32_t c = 0; c < of->inputs; c++)
        (void)snprintf(file.input_name[c], LG_TABLE_NAME, "in */ %u", c);
    (void)snprintf(file.run.data_sha256, sizeof file.run.data_sha256, "%064d", 42);
    (void)snprintf(file.provenance.command, sizeof file.provenance.command, "lg-fit train soil.csv");
    assert_ok(lg_recipe_save(NULL, export_path(of->row.name), &lg_recipe_table, &file, NULL, NULL));
    return NULL;
}

static void draw_row(void *user, lg_rng *rng, double *x) {
    const lg_table_file *file = lg_model_file_of(&((const exported *)user)->file, &lg_recipe_table);
    const lg_scaler *in = &file->inputs;
    for (uint32_t c = 0; c < in->channels; c++) x[c] = in->mean[c] + in->scale[c] * lg_rng_normal(rng);
}

/* ---- detectors: every pooling, stride, padding, plane, loss, scaling and activation ---- */

#define MSE     LG_DETECTOR_MSE
#define CROSS   LG_DETECTOR_CROSS_ENTROPY
#define NONE    LG_POOL_NONE
#define AVERAGE LG_POOL_AVERAGE
#define MAX     LG_POOL_MAX

typedef struct detector_example {
    export_row row;
    uint32_t classes;
    lg_detector_loss loss;
    bool centred;
    /* {channels, length, blocks, {channels, kernel, stride, padding, pooling, size, stride}, plane,
     * outputs} */
    lg_cnn net;
    double weight, offset; /* added to the last weight and to the bias of the output layer */
} detector_example;

#define NET(channels, length, blocks, plane, outputs, activation, ...)                                       \
    {                                                                                                        \
        channels, length, blocks, {__VA_ARGS__}, plane, outputs, LG_##activation, {                          \
            0                                                                                                \
        }                                                                                                    \
    }

static const detector_example detector_examples[] = {
    {.row = {"average", "gcc", "-O2", ""},
     2,
     MSE,
     false,
     NET(3, 40, 3, 2, 1, TANH, {6, 5, 1, 0, AVERAGE, 2, 2}, {12, 5, 1, 0, AVERAGE, 2, 2},
         {5, 3, 1, 0, AVERAGE, 2, 1})},
    {.row = {"maximum", "clang", "-O3", ""},
     3,
     CROSS,
     true,
     NET(2, 31, 2, 0, 3, SWISH, {5, 4, 2, 3, MAX, 3, 2}, {9, 3, 1, 1, MAX, 2, 3})},
    {.row = {"none", "gcc", "-O3 -march=native", ""},
     2,
     CROSS,
     false,
     NET(4, 25, 2, 5, 2, SIGMOID, {3, 5, 3, 2, NONE, 1, 1}, {8, 2, 1, 1, NONE, 1, 1})},
    {.row = {"kinks", "clang", "-O2", ""},
     4,
     CROSS,
     false,
     NET(2, 30, 3, 3, 4, RELU, {4, 3, 1, 1, MAX, 2, 2}, {6, 3, 2, 0, NONE, 1, 1},
         {4, 2, 1, 1, AVERAGE, 3, 2})},
    {.row = {"leaky", "gcc", "-O1", ""},
     2,
     MSE,
     true,
     NET(1, 20, 1, 0, 1, LEAKY_RELU, {7, 5, 2, 4, AVERAGE, 4, 1})},
    {.row = {"sine", "clang", "-O1", ""}, 2, CROSS, false, NET(1, 1, 1, 1, 2, SINE, {2, 1, 1, 0, MAX, 1, 1})},
    {.row = {"flat", "gcc", "-O2", ""}, 2, MSE, true, NET(3, 7, 0, 4, 1, TANH, {0, 0, 0, 0, NONE, 0, 0})},
    {.row = {"linear", "clang", "-O3", ""},
     3,
     CROSS,
     false,
     NET(2, 9, 0, 0, 3, IDENTITY, {0, 0, 0, 0, NONE, 0, 0})},
    {.row = {"one", "gcc", "-O0", ""},
     2,
     MSE,
     false,
     NET(2, 16, 1, 1, 1, IDENTITY, {1, 3, 1, 0, NONE, 1, 1})},
};

/* Makes a detector whose channels have offsets far from 0 and scales far from 1. */
static void *make_detector(const void *row) {
    const detector_example *of = row;
    lg_rng rng = test_rng(5, (uint64_t)of->net.length);
    lg_detector_file file = {
        .run = {.model = {.net = of->net, .classes = of->classes, .loss = of->loss, .centred = of->centred},
                .training = export_training(),
                .test_fraction = 0.2,
                .windows = 10,
                .window = of->net.length,
                .hop = 1},
        .names = {.rate = 12.5},
        .accuracy = 0.9375,
        .f1 = 0.875,
        .test_mse = NAN};
    lg_cnn *net = &file.run.model.net;
    assert_ok(lg_cnn_init(net, NULL));
    memset(file.run.data_sha256, 'a', LG_SHA256_TEXT - 1);
    file.parameters = lg_cnn_parameters(net);
    file.theta = TEST_ARRAY(double, file.parameters);
    file.scaler = scaler_of(net->channels, 1, &rng);
    file.names.class_name = lg_test_memory(of->classes * sizeof *file.names.class_name);
    file.names.channel_name = lg_test_memory(net->channels * sizeof *file.names.channel_name);
    lg_cnn_initialise(net, &rng, file.theta);
    for (size_t i = 0; i < file.parameters; i++) file.theta[i] += 0.1 * lg_rng_normal(&rng);
    file.theta[file.parameters - 1] += of->offset;
    file.theta[file.parameters - 2] += of->weight;
    for (uint32_t c = 0; c < net->channels; c++) {
        file.scaler.mean[c] = of->centred ? 0 : 10 * lg_rng_normal(&rng);
        file.scaler.scale[c] = pow(10, lg_rng_uniform_in(&rng, -2, 4));
        (void)snprintf(file.names.channel_name[c], LG_SERIES_NAME, "acc \"%u\" */ \\", c);
    }
    for (uint32_t c = 0; c < of->classes; c++)
        (void)snprintf(file.names.class_name[c], LG_SERIES_NAME, "state\t\"%u\" \xc3\xa9?\?/ */", c);
    assert_ok(lg_recipe_save(NULL, export_path(of->row.name), &lg_recipe_detector, &file, NULL, NULL));
    return NULL;
}

/* The default network for windows of this size. `relu`: with max pooling and ReLU. */
static detector_example default_detector(const char *name, uint32_t channels, uint32_t length,
                                         uint32_t classes, bool relu) {
    detector_example out = {
        .row = {.name = name}, .classes = classes, .loss = classes == 2 ? MSE : CROSS, .centred = relu};
    lg_cnn_init_default(&out.net, channels, length, classes == 2 ? 1 : classes, relu ? LG_RELU : LG_TANH);
    for (uint32_t i = 0; i < out.net.blocks && relu; i++)
        if (out.net.block[i].pooling != LG_POOL_NONE) out.net.block[i].pooling = LG_POOL_MAX;
    return out;
}

static const lg_detector_file *detector_of(const exported *e) {
    return lg_model_file_of(&e->file, &lg_recipe_detector);
}

static bool has_kinks(const lg_cnn *net) {
    bool kinks = net->activation == LG_RELU || net->activation == LG_LEAKY_RELU;
    for (uint32_t i = 0; i < net->blocks; i++) kinks = kinks || net->block[i].pooling == LG_POOL_MAX;
    return kinks;
}

/* False if x is so near to a kink that rounding decides which side's gradient is computed. */
static bool is_smooth(const exported *e, lg_rng *rng, const double *x) {
    static double near[2][4 * MOST_INPUTS], moved[MOST_INPUTS];
    const lg_detector_file *file = detector_of(e);
    const size_t n = e->lib.inputs, all = n * e->lib.outputs, length = file->run.model.net.length;
    const double eps = e->lib.single ? FLT_EPSILON : DBL_EPSILON;
    double change = 0, sum = 0;
    if (!has_kinks(&file->run.model.net)) return true;
    assert_true(all <= LG_COUNT(near[0]));
    lg_model_jacobian(e->model, x, NULL, near[0], e->work);
    for (int k = 0; k < 2; k++) {
        for (size_t i = 0; i < n; i++)
            moved[i] = x[i] + 16 * eps * lg_rng_normal(rng) * file->scaler.scale[i / length];
        lg_model_jacobian(e->model, moved, NULL, near[1], e->work);
        change += pow(export_norm(near[1], near[0], all), 2);
        sum += pow(export_norm(near[0], NULL, all), 2);
    }
    return change <= pow(e->lib.tolerance / 2, 2) * sum;
}

static void draw_window(void *user, lg_rng *rng, double *x) {
    const exported *e = user;
    const lg_detector_file *file = detector_of(e);
    const lg_detector *model = &file->run.model;
    const lg_scaler *scaler = &file->scaler;
    do {
        for (size_t c = 0; c < model->net.channels; c++) {
            const double offset = model->centred ? 3 * scaler->scale[c] * lg_rng_normal(rng) : 0;
            for (size_t i = c * model->net.length; i < (c + 1) * model->net.length; i++)
                x[i] = (float)(scaler->mean[c] + offset + scaler->scale[c] * lg_rng_normal(rng));
        }
    } while (!is_smooth(e, rng, x));
}

/* ---- classical classifiers: every kind of features, every method ---- */

typedef struct classifier_example {
    export_row row;
    lg_feature_kind kind;
    bool directions_x;
    lg_classifier_method method;
    uint32_t components, classes, length;
} classifier_example;

#define RAW      LG_FEATURES_RAW
#define STD      LG_FEATURES_STD
#define COV      LG_FEATURES_COV
#define BASELINE LG_FEATURES_BASELINE
#define SPECTRUM LG_FEATURES_SPECTRUM
#define LEVELS   LG_FEATURES_LEVELS
#define ROCKET   LG_FEATURES_ROCKET
#define LOGISTIC LG_METHOD_LOGISTIC
#define TREE     LG_METHOD_TREE
#define LINEAR   LG_METHOD_SVM_LINEAR
#define RBF      LG_METHOD_SVM_RBF
#define RIDGE    LG_METHOD_RIDGE

static const classifier_example classifier_examples[] = {
    {.row = {"cov-logistic", "gcc", "-O2", ""}, COV, false, LOGISTIC, 0, 2, 33},
    {.row = {"cov-tree", "clang", "-O3", ""}, COV, false, TREE, 4, 3, 33},
    {.row = {"cov-linear", "gcc", "-O3 -march=native", ""}, COV, true, LINEAR, 3, 3, 33},
    {.row = {"cov-rbf", "clang", "-O2", ""}, COV, false, RBF, 0, 3, 33},
    {.row = {"std-logistic", "gcc", "-O1", ""}, STD, false, LOGISTIC, 2, 3, 33},
    {.row = {"std-tree", "clang", "-O1", ""}, STD, false, TREE, 0, 2, 33},
    {.row = {"std-linear", "gcc", "-O0", ""}, STD, false, LINEAR, 0, 2, 33},
    {.row = {"std-rbf", "clang", "-O3 -march=native", ""}, STD, true, RBF, 0, 2, 33},
    {.row = {"raw-logistic", "gcc", "-O3", ""}, RAW, false, LOGISTIC, 5, 2, 33},
    {.row = {"raw-tree", "clang", "-O0", ""}, RAW, true, TREE, 0, 3, 33},
    {.row = {"raw-linear", "gcc", "-O2", ""}, RAW, false, LINEAR, 0, 3, 33},
    {.row = {"raw-rbf", "clang", "-O2", ""}, RAW, false, RBF, 6, 4, 33},
    {.row = {"baseline-logistic", "gcc", "-O2", ""}, BASELINE, false, LOGISTIC, 0, 2, 33},
    {.row = {"baseline-tree", "clang", "-O2", ""}, BASELINE, false, TREE, 2, 2, 33},
    {.row = {"baseline-linear", "gcc", "-O3", ""}, BASELINE, true, LINEAR, 0, 2, 33},
    {.row = {"baseline-rbf", "clang", "-O3", ""}, BASELINE, false, RBF, 3, 3, 33},
    {.row = {"spectrum-logistic", "gcc", "-O2", ""}, SPECTRUM, false, LOGISTIC, 0, 2, 33},
    {.row = {"spectrum-tree", "clang", "-O3", ""}, SPECTRUM, false, TREE, 5, 3, 33},
    {.row = {"spectrum-linear", "gcc", "-O3 -march=native", ""}, SPECTRUM, true, LINEAR, 0, 3, 33},
    {.row = {"spectrum-rbf", "clang", "-O2", ""}, SPECTRUM, false, RBF, 4, 3, 33},
    {.row = {"levels-logistic", "gcc", "-O2", ""}, LEVELS, false, LOGISTIC, 0, 2, 33},
    {.row = {"levels-tree", "clang", "-O3", ""}, LEVELS, false, TREE, 0, 3, 33},
    {.row = {"levels-linear", "gcc", "-O3 -march=native", ""}, LEVELS, true, LINEAR, 3, 3, 33},
    {.row = {"levels-rbf", "clang", "-O2", ""}, LEVELS, false, RBF, 0, 3, 33},
    {.row = {"rocket-ridge", "gcc", "-O3 -march=native", ""}, ROCKET, false, RIDGE, 0, 2, 33},
    {.row = {"rocket-ridge-3", "clang", "-O2", ""}, ROCKET, true, RIDGE, 0, 3, 60},
    {.row = {"rocket-rbf", "gcc", "-O0", ""}, ROCKET, false, RBF, 4, 2, 33},
    {.row = {"cov-ridge", "gcc", "-O2", ""}, COV, false, RIDGE, 0, 3, 33},
    /* Windows longer than one segment of the spectrum, so segments overlap. No trees: rounding would decide
     * at their thresholds. */
    {.row = {"long-logistic", "gcc", "-O2", ""}, SPECTRUM, false, LOGISTIC, 0, 2, 300},
    {.row = {"long-rbf", "clang", "-O2", ""}, SPECTRUM, false, RBF, 4, 3, 300},
};

typedef struct fitted {
    const classifier_example *of;
    lg_classifier classifier;
    lg_series series;
    lg_scaler scaler;
    double *work;
    float window[MOST_INPUTS];
    test_decider decider;
} fitted;

/* A recorded window of a class: correlated noise with an offset, larger for later classes. The sizes of the
 * channels differ by orders of magnitude. The size also varies within a window, for the lines of BASELINE. */
static void recorded_window(lg_rng *rng, uint32_t length, uint32_t class, float *x) {
    static const double size[CHANNELS] = {0.02, 3, 400, 5e4}, offset[CHANNELS] = {0.01, 9.81, -50, 1e4};
    const double trend = lg_rng_uniform_in(rng, 0.7, 1.4);
    for (uint32_t t = 0; t < length; t++) {
        const double swell = trend * (1 + 0.6 * sin(0.7 * t));
        double z[CHANNELS], mixed[CHANNELS];
        for (uint32_t c = 0; c < CHANNELS; c++) z[c] = lg_rng_normal(rng);
        mixed[0] = z[0];
        mixed[1] = z[1] + (0.3 + 0.4 * class) * z[0];
        mixed[2] = (1 + 0.5 * class) * z[0] + 0.3 * z[2];
        mixed[3] = z[3] * (1 + 0.2 * class) + 0.5 * z[1];
        for (uint32_t c = 0; c < CHANNELS; c++)
            x[c * length + t] = (float)(size[c] * swell * mixed[c] + offset[c] + size[c] * class * (c == 1));
    }
}

static void release_fitted(void *of) {
    fitted *f = of;
    lg_classifier_destroy(&f->classifier);
    lg_series_destroy(&f->series);
    lg_scaler_destroy(&f->scaler);
}

static lg_series series_of(const classifier_example *of) {
    static const char *const names[CHANNELS] = {"acc_lower_x", "acc_lower_y", "moment_x", "moment_y"};
    lg_series series = {.count = 40 * of->classes,
                        .channels = CHANNELS,
                        .length = of->length,
                        .classes = of->classes,
                        .rate = 10};
    lg_rng rng = test_rng(11, of->classes);
    assert_ok(lg_series_allocate(NULL, &series, false, false));
    series.channel_name = lg_test_gives(CHANNELS, sizeof *series.channel_name);
    for (uint32_t c = 0; c < CHANNELS; c++)
        (void)snprintf(series.channel_name[c], LG_SERIES_NAME, "%s", names[c]);
    for (size_t i = 0; i < series.count; i++) {
        series.label[i] = (uint32_t)(i % of->classes);
        recorded_window(&rng, of->length, series.label[i], series.x + i * CHANNELS * of->length);
    }
    return series;
}

static fitted *fit(const classifier_example *of) {
    lg_error error = {LG_OK, ""};
    lg_windows windows;
    lg_classifier_options options;
    fitted *f = TEST_ARRAY(fitted, 1);
    f->of = of;
    f->series = series_of(of);
    lg_test_owns(f, release_fitted);
    assert_ok(lg_windows_create(NULL, &f->series, 0, 0, &windows, &error));
    assert_ok(lg_scaler_fit(NULL, &f->series, &windows, NULL, windows.count, false, &f->scaler));
    lg_features *features = &f->classifier.features;
    if (of->kind == ROCKET) {
        lg_rocket_options rocket;
        lg_rocket_options_init(&rocket);
        rocket.features = 96;
        rocket.directions_x = of->directions_x;
        assert_ok(lg_rocket_fit(NULL, &rocket, &f->series, &windows, NULL, windows.count, &f->scaler,
                                features, &error));
    } else {
        assert_ok(lg_features_create(NULL, of->kind, of->directions_x, &f->series, of->length, &f->scaler,
                                     features, &error));
    }
    double *table = TEST_ARRAY(double, windows.count * features->count);
    assert_ok(lg_features_table(NULL, features, &f->series, &windows, 1, table, &error));
    lg_classifier_options_init(&options);
    options.method = of->method;
    options.components = of->components < features->count ? of->components : features->count;
    if (lg_classifier_fit(NULL, &options, table, f->series.label, NULL, windows.count, features->count,
                          of->classes, &f->classifier, &error) != LG_OK)
        fail_msg("%s: %s", of->row.name, error.message);
    lg_windows_destroy(&windows);
    if (of->length > 100) assert_int_equal(features->spectrum.segments, 4);
    f->work = lg_test_memory(lg_classifier_work_size(&f->classifier));
    return f;
}

/* Writes the classifier as lg-anomaly train does. */
static void save_classifier(const fitted *f) {
    char hash[LG_SHA256_TEXT] = "";
    lg_file_writer *writer = NULL;
    lg_archive_writer to;
    const double fraction = 0.25, accuracy = 0.9375, f1 = 0.875;
    const uint64_t seed = 1, count = f->series.count, length = f->of->length, version = LG_FORMAT_VERSION;
    const struct {
        const char *group, *name;
        lg_element type;
        const void *value;
    } rows[] = {{"run", "test_fraction", LG_ELEMENT_F64, &fraction},
                {"", "accuracy", LG_ELEMENT_F64, &accuracy},
                {"", "f1", LG_ELEMENT_F64, &f1},
                {"run", "seed", LG_ELEMENT_U64, &seed},
                {"run", "windows", LG_ELEMENT_U64, &count},
                {"model", "window", LG_ELEMENT_U64, &length},
                {"model", "hop", LG_ELEMENT_U64, &length},
                {"", "format_version", LG_ELEMENT_I64, &version}};
    memset(hash, 'b', LG_SHA256_TEXT - 1);
    assert_ok(lg_file_writer_create(NULL, export_path(f->of->row.name), "classifier", NULL, &writer, NULL));
    lg_h5 *h5 = lg_file_writer_h5(writer);
    assert_ok(lg_file_writer_archive(writer, "", &to));
    assert_ok(lg_sensing_put(h5, &f->series, NULL));
    assert_ok(lg_h5_remove_attribute(h5, "", "format_version", NULL));
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        assert_ok(lg_h5_put_number(h5, rows[i].group, rows[i].name, rows[i].type, rows[i].value, NULL));
    assert_ok(to.text(to.user, "run/split", "random"));
    assert_ok(to.text(to.user, "run/data_sha256", hash));
    assert_ok(lg_classifier_save(&f->classifier, &to, NULL));
    assert_ok(lg_file_writer_commit(writer, NULL));
    lg_file_writer_destroy(writer);
}

static void *make_classifier(const void *row) {
    fitted *f = fit(row);
    save_classifier(f);
    return f;
}

static void as_floats(fitted *f, const double *x) {
    for (size_t i = 0; i < CHANNELS * f->of->length; i++) f->window[i] = (float)x[i];
}

/* False if a feature is so near to a threshold that rounding decides on which side the window falls. */
static bool is_decided(const exported *e) {
    const fitted *of = e->of;
    const lg_classifier *c = &of->classifier;
    const double margin = e->lib.single ? 1e-4 : 1e-12;
    double f[MOST], number[MOST];
    if (c->method != LG_METHOD_TREE) return true;
    assert_ok(lg_features_compute(&c->features, of->window, f, of->work));
    lg_pca_eval(&c->pca, f, 1, number, of->work);
    for (uint32_t i = 0; c->tree.node[i].left != 0;) {
        const lg_tree_node *node = &c->tree.node[i];
        if (fabs(number[node->feature] - node->threshold) < margin * (1 + fabs(node->threshold)))
            return false;
        i = number[node->feature] <= node->threshold ? node->left : node->right;
    }
    return true;
}

static void draw_recorded(void *user, lg_rng *rng, double *x) {
    const exported *e = user;
    fitted *f = e->of;
    do {
        recorded_window(rng, f->of->length, (uint32_t)lg_rng_below(rng, f->of->classes), f->window);
    } while (!is_decided(e));
    for (size_t i = 0; i < CHANNELS * f->of->length; i++) x[i] = f->window[i];
}

static void decisions(void *user, const double *x, double *y, double *jacobian) {
    fitted *f = ((const exported *)user)->of;
    as_floats(f, x);
    assert_ok(test_decide(&f->classifier, &f->decider, f->window, y, jacobian));
}

/* ---- features ---- */

static void call_features(const exported *e, const double *x, double *out) {
    export_call(&e->lib, "features", 2,
                (export_port[]){EXPORT_IN(x, e->lib.inputs),
                                EXPORT_OUT(out, ((const fitted *)e->of)->classifier.features.count)});
}

/* The norm of the differences, each relative to the feature's scale in training. */
static double features_error(const exported *e, const double *x) {
    const fitted *f = e->of;
    const lg_pca *pca = &f->classifier.pca;
    double sum = 0, all = 0, got[MOST] = {0}, want[MOST];
    assert_ok(lg_features_compute(&f->classifier.features, f->window, want, f->work));
    call_features(e, x, got);
    for (size_t i = 0; i < pca->inputs; i++) {
        const double unit = fabs(pca->mean[i]) + pca->scale[i];
        sum += pow((got[i] - want[i]) / unit, 2);
        all += pow(want[i] / unit, 2);
    }
    return all > 0 ? sqrt(sum / all) : sqrt(sum);
}

/* Windows on which some quantity is zero. */
enum { CONSTANT, ONE_CONSTANT, TWINS, TWO_VALUES, EDGES };

static void edge_window(int kind, uint32_t length, double *x) {
    float window[MOST_INPUTS];
    lg_rng rng = test_rng(9, 9);
    recorded_window(&rng, length, 0, window);
    for (size_t i = 0; i < CHANNELS * length; i++) {
        x[i] = window[i];
        if (kind == CONSTANT) x[i] = window[i / length * length];
        if (kind == ONE_CONSTANT && i < length) x[i] = window[0];
        if (kind == TWINS) x[i] = window[i % length]; /* equal channels: a covariance of rank 1 */
        if (kind == TWO_VALUES) x[i] = i % length == 5;
    }
}

static void check_edges(exported *e) {
    fitted *f = e->of;
    const size_t size = e->lib.outputs * e->lib.inputs;
    double *jacobian = TEST_ARRAY(double, size), *wanted = TEST_ARRAY(double, size);
    for (int kind = 0; kind < EDGES; kind++) {
        double x[MOST_INPUTS], y[MOST] = {0}, mine[MOST];
        edge_window(kind, f->of->length, x);
        decisions(e, x, mine, wanted);
        const double error = features_error(e, x);
        if (!(error <= e->lib.tolerance)) fail_msg("%s, edge %d: features %.3g", e->folder, kind, error);
        export_grad(&e->lib, x, y, jacobian);
        for (size_t i = 0; i < e->lib.outputs; i++) assert_true(isfinite(y[i]));
        for (size_t i = 0; i < size; i++) assert_true(isfinite(jacobian[i]));
        for (size_t i = 0; i < size && kind == CONSTANT && f->of->kind != RAW && f->of->kind != LEVELS; i++)
            assert_true(jacobian[i] == 0);
        /* Library and exported code both set the singular directions of the covariance's root to 0. Far from
         * all support vectors the gradient is too small for single precision. */
        const bool some = export_norm(wanted, NULL, size) > 1e-30;
        const double slope = export_worst(jacobian, wanted, 1, size);
        if (some && !(slope <= 100 * e->lib.tolerance))
            fail_msg("%s, edge %d: gradient %.3g", e->folder, kind, slope);
    }
}

/* ---- scores and classes ---- */

RELEASES(release_plan, lg_plan_destroy)

/* The library's scores of x: a detector's probabilities, or the softmax of a table network's logits. */
static void scores_of(const exported *e, lg_plan *probability, const double *x, uint32_t classes,
                      double *score) {
    double sum = 0;
    if (e->of != NULL) {
        fitted *f = e->of;
        as_floats(f, x);
        assert_ok(lg_classifier_window(&f->classifier, f->window, score, f->work));
    } else if (probability != NULL) {
        lg_plan_eval(probability, (const void *const[]){x}, (void *const[]){score}, e->work);
    } else {
        lg_model_eval(e->model, x, score, e->work);
        for (uint32_t k = 0; k < classes; k++) sum += score[k] = exp(score[k]);
        for (uint32_t k = 0; k < classes; k++) score[k] /= sum;
    }
}

/* The exported class must be the library's, unless rounding decides it, and no class if x has a NaN. The
 * scores of support vector machines jump where two classes are close. */
static void check_classes(const exported *e, const export_kind *kind, uint32_t classes) {
    double x[MOST_INPUTS], got[MOST] = {0}, want[MOST], worst[2] = {0, 0};
    size_t seen[8] = {0}, near = 0;
    lg_plan *plan = NULL;
    lg_rng rng = test_rng(3, 4);
    if (e->of == NULL && lg_model_find(e->model, "probability", NULL, &plan, NULL) == LG_OK)
        lg_test_owns(plan, release_plan);
    exported with_room = *e;
    if (plan != NULL) with_room.work = lg_test_memory(lg_plan_work_size(plan));
    for (size_t r = 0; r < ROWS; r++) {
        kind->draw((void *)(uintptr_t)e, &rng, x);
        for (size_t i = 0; i < e->lib.inputs; i++) x[i] = export_rounded(&e->lib, x[i]);
        scores_of(&with_room, plan, x, classes, want);
        const uint32_t class = lg_metrics_class(want, classes);
        double second = -INFINITY, size = 1;
        for (uint32_t k = 0; k < classes; k++) {
            if (k != class) second = fmax(second, want[k]);
            size = fmax(size, fabs(want[k]));
        }
        if (e->of != NULL) worst[1] = fmax(worst[1], features_error(e, x));
        const int found = export_classify(&e->lib, x, got, classes);
        assert_int_equal(export_classify(&e->lib, x, NULL, classes), found);
        assert_true(found >= 0 && found < (int)classes);
        seen[found]++;
        const bool decided = want[class] - second > 10 * e->lib.tolerance * size;
        if (decided) assert_int_equal(found, class);
        near += !decided;
        if (decided || e->of == NULL) worst[0] = fmax(worst[0], export_norm(got, want, classes) / size);
    }
    print_message("  scores %.2e, features %.2e; %zu close; classes", worst[0], worst[1], near);
    for (uint32_t k = 0; k < classes; k++) print_message(" %zu", seen[k]);
    print_message("\n");
    assert_true(near < ROWS / 10 && worst[0] <= 4 * e->lib.tolerance && worst[1] <= e->lib.tolerance);
    x[0] = NAN;
    assert_int_equal(export_classify(&e->lib, x, got, classes), -1);
}

/* For value and class, work memory of NAME_EVAL_WORK_SIZE numbers must be enough. */
static void check_small_work(const exported *e) {
    const size_t size = (size_t)export_constant(e->folder, "m", "EVAL_WORK_SIZE");
    const size_t bytes = e->lib.single ? sizeof(float) : sizeof(double);
    void *in = lg_test_memory(e->lib.inputs * sizeof(double)), *out = lg_test_memory(MOST * sizeof(double));
    unsigned char *work = e->lib.work;
    assert_true(size > 0 && size <= e->lib.work_size);
    EXPORT_FUNCTION(&e->lib, "eval", void, (const void *, void *, void *), eval);
    EXPORT_FUNCTION(&e->lib, "classify", int, (const void *, void *, void *), classify);
    memset(work, 0x5a, e->lib.work_size * bytes);
    eval(in, out, work);
    (void)classify(in, out, work);
    for (size_t i = size * bytes; i < e->lib.work_size * bytes; i++) assert_int_equal(work[i], 0x5a);
}

static void more_of_table(exported *e);
static void more_of_detector(exported *e);
static void more_of_classifier(exported *e);

static const export_kind tables = EXPORT_KIND(table_examples, make_table, draw_row, NULL, more_of_table),
                         detectors = EXPORT_KIND(detector_examples, make_detector, draw_window, NULL,
                                                 more_of_detector),
                         classifiers = EXPORT_KIND(classifier_examples, make_classifier, draw_recorded,
                                                   decisions, more_of_classifier);

static void more_of_table(exported *e) {
    const table_example *of = (const table_example *)e->row;
    if (of->options.task == LG_TABLE_CLASSIFICATION) check_classes(e, &tables, of->outputs);
}

static void more_of_detector(exported *e) {
    const lg_detector_file *file = detector_of(e);
    const char *const *names = export_symbol(&e->lib, "class_names");
    for (uint32_t k = 0; k < file->run.model.classes; k++)
        assert_string_equal(names[k], file->names.class_name[k]);
    check_classes(e, &detectors, file->run.model.classes);
    check_small_work(e);
}

static void more_of_classifier(exported *e) {
    const fitted *f = e->of;
    assert_int_equal(e->lib.inputs, CHANNELS * f->of->length);
    assert_int_equal(e->lib.outputs, lg_plan_output_count(f->decider.value, 0));
    check_classes(e, &classifiers, f->of->classes);
    check_edges(e);
}

TEST_GROUP(export_begin, export_end)

#ifdef EVERY_WAY
TEST("every detector and classifier is built by all compilers") {
    export_build_all(&detectors);
    export_build_all(&classifiers);
}

/* Compilers unroll the long loops of these networks and spill registers to the stack. */
TEST("networks of default sizes need no more than the stated stack") {
    static const struct {
        uint32_t channels, length, classes;
        bool relu;
    } rows[] = {{1, 96, 2, false},  {2, 128, 2, false}, {2, 128, 3, true},  {4, 64, 3, false},
                {6, 100, 2, false}, {6, 100, 3, true},  {6, 300, 5, false}, {6, 300, 2, true}};
    for (size_t i = 0; i < 2 * LG_COUNT(rows); i++) {
        const detector_example of =
            default_detector(test_text("default%zu", i), rows[i / 2].channels, rows[i / 2].length,
                             rows[i / 2].classes, rows[i / 2].relu);
        const exported *e = export_made(&detectors, &of, i % 2 == 0 ? "f64" : "f32", "");
        export_check_stack(e->folder);
        export_expect(test_text("make -C %s test stack", e->folder));
    }
}
#else

TEST("values, Jacobians, features, scores and classes agree with the library in double precision") {
    export_compare_all(&tables, "f64");
    export_compare_all(&detectors, "f64");
    export_compare_all(&classifiers, "f64");
}

TEST("values, Jacobians, features, scores and classes agree with the library in single precision") {
    export_compare_all(&tables, "f32");
    export_compare_all(&detectors, "f32");
    export_compare_all(&classifiers, "f32");
}

/* A class without support vectors: the last of four classes loses all of them. */
static void *make_lonely(const void *row) {
    fitted *f = fit(row);
    lg_svm *svm = &f->classifier.svm;
    svm->vectors -= svm->vectors_of[3];
    for (size_t r = 1; r < 3; r++)
        memmove(svm->coefficient + r * svm->vectors,
                svm->coefficient + r * (svm->vectors + svm->vectors_of[3]), svm->vectors * sizeof(double));
    svm->vectors_of[3] = 0;
    save_classifier(f);
    lg_classifier_destroy(&f->classifier); /* its scores are those of the fit */
    lg_file_reader *reader;
    lg_archive_reader from;
    assert_ok(lg_file_reader_create(NULL, export_path(f->of->row.name), "classifier", NULL, &reader, NULL));
    assert_ok(lg_file_reader_archive(reader, "", &from));
    assert_ok(lg_classifier_load(NULL, &from, &f->classifier, NULL));
    lg_file_reader_destroy(reader);
    return f;
}

TEST("a class may have no support vectors") {
    static const classifier_example lonely[] = {
        {.row = {"lonely-rbf", "cc", "-O2", ""}, RAW, false, RBF, 6, 4, 33},
        {.row = {"lonely-linear", "cc", "-O2", ""}, RAW, false, LINEAR, 6, 4, 33}};
    const export_kind kind = EXPORT_KIND(lonely, make_lonely, draw_recorded, decisions, NULL);
    for (size_t i = 0; i < LG_COUNT(lonely); i++) {
        exported *e = export_opened(&kind, &lonely[i], "f64", "");
        export_compare_one(&kind, e, 100);
        check_classes(e, &classifiers, 4);
    }
}

/* The tolerance of detectors accounts for channel offsets up to 10 at scales down to 0.01. The rounding of
 * the mean to float is stated next to it. */
TEST("headers describe the model, its inputs and classes, and say where its numbers come from") {
    static const struct {
        const export_kind *kind;
        const char *name, *dtype, *words, *of_weights;
    } rows[] = {
        {&tables, "plain", "f64",
         "regression|inputs x (4)|in |outputs y (2)|0.125: of the outputs|lg-fit train soil.csv|rows 321|"
         "0000000042|hidden 9,9",
         ""},
        {&tables, "classes", "f64", "classification|CLASSES 4|class2|a logit a class", ""},
        {&detectors, "average", "f32",
         "#define m_CHANNELS 3|#define m_LENGTH 40|#define m_CLASSES 2|#define m_RATE 12.5|#define m_DEPTH 6|"
         "x[channel * 40 + sample]|logit|0.9375|aaaaaaaa|channel 2|units|scaling|m_classify",
         "/* theta from 0 on */|/* mean */|/* inverse_scale */"},
        {&classifiers, "std-tree", "f32",
         "#define m_CHANNELS 4|#define m_LENGTH 33|#define m_CLASSES 2|#define m_FEATURES 4|#define m_RATE "
         "10.0|"
         "Gradient: 0 everywhere|0.9375|bbbbbbbb|moment_y|std acc_lower_x",
         ""},
        {&classifiers, "cov-logistic", "f32", "cov acc_lower_x moment_x|logit of class 1|contains the factor",
         ""}};
    static char numbers[EXPORT_TEXT]; /* in hexadecimal only real numbers are written */
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const exported *e =
            export_made(rows[i].kind, export_find(rows[i].kind, rows[i].name), rows[i].dtype, "");
        export_expect_words(test_text("%s/m.h", e->folder), rows[i].words);
        export_expect_words(test_text("%s/m_weights.c", e->folder), rows[i].of_weights);
    }
    export_expect("! grep -r NAME */m.h");
    cli_expect("lg-export", "cov-logistic.h5 --out told --name m --dtype f32 --json", 0, "");
    assert_int_equal(export_shell("grep -o 0x told/m_weights.c | wc -l", numbers), 0);
    assert_true(atof(numbers) > 10 && json_number(result.out, "weights_bytes") >= 4.0 * atof(numbers));
}

TEST("models are built by many compilers, and one of default size with the flags of the Makefile") {
    const detector_example of = default_detector("default", 4, 64, 3, false);
    export_build(&tables, export_find(&tables, "large"), "f32", export_check_ways);
    export_build(&tables, export_find(&tables, "classes"), "f64", export_check_ways);
    export_build(&detectors, export_find(&detectors, "kinks"), "f32", export_check_ways);
    export_build(&classifiers, export_find(&classifiers, "cov-rbf"), "f32", export_check_ways);
    export_build(&classifiers, export_find(&classifiers, "long-logistic"), "f32", export_check_ways);
    export_check_objects(
        export_made(&classifiers, export_find(&classifiers, "cov-logistic"), "f64", "")->folder, "m");
    const exported *e = export_made(&detectors, &of, "f64", "");
    export_expect("make -C default-f64 test stack");
    export_check_objects(e->folder, "m");
    export_check_stack(e->folder);
}

/* The mean of a single logit over windows that resemble the training data. */
static double mean_logit(const detector_example *of) {
    enum { DRAWN = 200 };
    exported e = {.row = &of->row};
    double x[MOST_INPUTS], mean = 0, y;
    make_detector(of);
    export_load(&e);
    lg_rng rng = test_rng(1, 1);
    for (int v = 0; v < DRAWN; v++) {
        draw_window(&e, &rng, x);
        lg_model_eval(e.model, x, &y, e.work);
        mean += y / DRAWN;
    }
    lg_model_file_destroy(&e.file);
    return mean;
}

TEST("the tolerance accounts for a logit that is a small difference of large terms, and self-tests of "
     "any seed pass") {
    detector_example of = default_detector("small", 2, 64, 2, false);
    of.net.activation = LG_SIGMOID;
    of.offset = -mean_logit(&of);
    for (int seed = 0; seed < 12; seed++) {
        const exported *e =
            export_made(&detectors, &of, seed % 2 == 0 ? "f64" : "f32", test_text("--seed %d", seed));
        export_expect(test_text("make -C %s test CFLAGS=-O1", e->folder));
        const double eps = seed % 2 == 0 ? DBL_EPSILON : (double)FLT_EPSILON;
        const double usual = 20 * eps * export_constant(e->folder, "m", "DEPTH");
        const double factor = export_constant(e->folder, "m", "TOLERANCE") / usual;
        if (!(factor > 5 && factor < 500)) fail_msg("factor %g", factor);
    }
    export_expect_words("small-f32/m.h", "contains the factor");
}

TEST("a model whose values are finite but whose norm overflows is refused, as its self-test could not "
     "see errors") {
    detector_example of = default_detector("huge", 2, 64, 2, false);
    of.weight = 1e200;
    make_detector(&of);
    cli_expect("lg-export", "huge.h5 --out huge", 3, "huge.h5: gives numbers");
    cli_expect("lg-export", "huge.h5 --out huge --dtype f32", 3, "huge.h5: holds numbers");
    assert_false(cli_exists("huge"));
}
#endif

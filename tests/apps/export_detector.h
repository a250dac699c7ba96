/* Detectors for the tests of lg-export: every pooling, stride, padding, plane, loss, scaling and activation.
 */
#ifndef LG_TEST_EXPORT_DETECTOR_H
#define LG_TEST_EXPORT_DETECTOR_H

#include "export_support.h"

#include "liegrad/detector.h"
#include "liegrad/io.h"
#include "liegrad/metrics.h"
#include "liegrad/model.h"

#define MSE     LG_DETECTOR_MSE
#define CROSS   LG_DETECTOR_CROSS_ENTROPY
#define NONE    LG_POOL_NONE
#define AVERAGE LG_POOL_AVERAGE
#define MAX     LG_POOL_MAX

typedef struct sample {
    const char *folder;
    lg_cnn net;
    uint32_t classes;
    lg_detector_loss loss;
    bool centred;
    const char *compiler, *flags;
} sample;

/* channels, length, blocks, {channels, kernel, stride, padding, pooling, size, stride}, plane, outputs */
static const sample samples[] = {
    {"average",
     {3,
      40,
      3,
      {{6, 5, 1, 0, AVERAGE, 2, 2}, {12, 5, 1, 0, AVERAGE, 2, 2}, {5, 3, 1, 0, AVERAGE, 2, 1}},
      2,
      1,
      LG_TANH,
      {0}},
     2,
     MSE,
     false,
     "gcc",
     "-O2"},
    {"maximum",
     {2, 31, 2, {{5, 4, 2, 3, MAX, 3, 2}, {9, 3, 1, 1, MAX, 2, 3}}, 0, 3, LG_SWISH, {0}},
     3,
     CROSS,
     true,
     "clang",
     "-O3"},
    {"none",
     {4, 25, 2, {{3, 5, 3, 2, NONE, 1, 1}, {8, 2, 1, 1, NONE, 1, 1}}, 5, 2, LG_SIGMOID, {0}},
     2,
     CROSS,
     false,
     "gcc",
     "-O3 -march=native"},
    {"kinks",
     {2,
      30,
      3,
      {{4, 3, 1, 1, MAX, 2, 2}, {6, 3, 2, 0, NONE, 1, 1}, {4, 2, 1, 1, AVERAGE, 3, 2}},
      3,
      4,
      LG_RELU,
      {0}},
     4,
     CROSS,
     false,
     "clang",
     "-O2"},
    {"leaky",
     {1, 20, 1, {{7, 5, 2, 4, AVERAGE, 4, 1}}, 0, 1, LG_LEAKY_RELU, {0}},
     2,
     MSE,
     true,
     "gcc",
     "-O1"},
    {"sine", {1, 1, 1, {{2, 1, 1, 0, MAX, 1, 1}}, 1, 2, LG_SINE, {0}}, 2, CROSS, false, "clang", "-O1"},
    {"plain", {3, 7, 0, {{0, 0, 0, 0, NONE, 0, 0}}, 4, 1, LG_TANH, {0}}, 2, MSE, true, "gcc", "-O2"},
    {"linear",
     {2, 9, 0, {{0, 0, 0, 0, NONE, 0, 0}}, 0, 3, LG_IDENTITY, {0}},
     3,
     CROSS,
     false,
     "clang",
     "-O3"},
    {"one", {2, 16, 1, {{1, 3, 1, 0, NONE, 1, 1}}, 1, 1, LG_IDENTITY, {0}}, 2, MSE, false, "gcc", "-O0"},
};
enum { SAMPLES = LG_COUNT(samples) };

/* Writes FOLDER.h5; offsets and scales of the channels are far from 0 and 1. */
static inline void detector_save(const sample *of) {
    char path[1024], name[128];
    lg_rng rng;
    lg_error error = {LG_OK, ""};
    lg_rng_seed(&rng, 5, (uint64_t)of->net.length);
    lg_detector_file file = {
        .run = {.model = {.net = of->net, .classes = of->classes, .loss = of->loss, .centred = of->centred},
                .training = {.dtype = LG_F64,
                             .epochs = 3,
                             .batch = 4,
                             .lr = 1e-3,
                             .lr_gamma = 1,
                             .lr_step = 1,
                             .adam_eps = 1e-8,
                             .shards = 1},
                .test_fraction = 0.2,
                .windows = 10,
                .window = of->net.length,
                .hop = 1},
        .rate = 12.5,
        .accuracy = 0.9375,
        .f1 = 0.875,
        .test_mse = NAN,
        .epochs_done = 3};
    lg_cnn *net = &file.run.model.net;
    assert_ok(lg_cnn_init(net, NULL));
    memset(file.run.data_sha256, 'a', LG_SHA256_TEXT - 1);
    file.parameters = lg_cnn_parameters(net);
    file.theta = calloc(file.parameters, sizeof(double));
    file.scaler = (lg_scaler){.channels = net->channels,
                              .mean = calloc(net->channels, sizeof(double)),
                              .scale = calloc(net->channels, sizeof(double))};
    file.class_name = calloc(of->classes, sizeof *file.class_name);
    file.channel_name = calloc(net->channels, sizeof *file.channel_name);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) file.history[i] = calloc(3, sizeof(double));
    lg_cnn_initialise(net, LG_INIT_GLOROT_UNIFORM, &rng, file.theta);
    for (size_t i = 0; i < file.parameters; i++) file.theta[i] += 0.1 * lg_rng_normal(&rng);
    for (uint32_t c = 0; c < net->channels; c++) {
        file.scaler.mean[c] = of->centred ? 0 : 10 * lg_rng_normal(&rng);
        file.scaler.scale[c] = pow(10, lg_rng_uniform_in(&rng, -2, 4));
        (void)snprintf(file.channel_name[c], LG_SERIES_NAME, "acc \"%u\" */ \\", c);
    }
    for (uint32_t c = 0; c < of->classes; c++)
        (void)snprintf(file.class_name[c], LG_SERIES_NAME, "state\t\"%u\" \xc3\xa9?\?/ */", c);
    (void)snprintf(name, sizeof name, "%s.h5", of->folder);
    cli_path(name, path, sizeof path);
    if (lg_model_save_detector(NULL, path, &file, NULL, &error) != LG_OK) fail_msg("%s", error.message);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) free(file.history[i]);
    free(file.channel_name);
    free(file.class_name);
    free(file.scaler.mean);
    free(file.scaler.scale);
    free(file.theta);
}

/* The default network for windows of this size; maxima and ReLU where `relu`. */
static inline sample detector_default(const char *folder, uint32_t channels, uint32_t length,
                                      uint32_t classes, bool relu) {
    sample out = {.folder = folder,
                  .classes = classes,
                  .loss = classes == 2 ? MSE : CROSS,
                  .centred = relu,
                  .compiler = "gcc",
                  .flags = "-O2"};
    lg_cnn_init_default(&out.net, channels, length, classes == 2 ? 1 : classes, relu ? LG_RELU : LG_TANH);
    for (uint32_t i = 0; i < out.net.blocks && relu; i++)
        if (out.net.block[i].pooling != LG_POOL_NONE) out.net.block[i].pooling = LG_POOL_MAX;
    return out;
}

/* Adds to a parameter of FOLDER.h5, counted from the last one, which is 1: an offset of the output layer. */
static inline void detector_change(const sample *of, size_t from_end, double change) {
    char path[1024], name[128];
    lg_model_file file;
    (void)snprintf(name, sizeof name, "%s.h5", of->folder);
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_load(NULL, path, NULL, &file, NULL));
    lg_detector_file changed = file.detector;
    double *theta = calloc(changed.parameters, sizeof *theta);
    assert_non_null(theta);
    memcpy(theta, file.detector.theta, changed.parameters * sizeof *theta);
    theta[changed.parameters - from_end] += change;
    changed.theta = theta;
    changed.scaler = file.detector.scaler;
    assert_ok(lg_model_save_detector(NULL, path, &changed, NULL, NULL));
    lg_model_file_destroy(&file);
    free(theta);
}

/* The mean of a single logit over windows like those of the training data. */
static inline double detector_mean(const sample *of) {
    enum { DRAWN = 200 };
    char path[1024], name[128];
    lg_model_file file;
    lg_rng rng;
    double mean = 0, y;
    (void)snprintf(name, sizeof name, "%s.h5", of->folder);
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_load(NULL, path, NULL, &file, NULL));
    const lg_scaler *scaler = &file.detector.scaler;
    const size_t n = lg_model_inputs(file.model), length = of->net.length;
    double *x = calloc(n, sizeof *x);
    void *work = aligned_alloc(64, (lg_model_work_size(file.model) + 64) / 64 * 64);
    assert_true(x != NULL && work != NULL);
    lg_rng_seed(&rng, 1, 1);
    for (int v = 0; v < DRAWN; v++) {
        for (size_t i = 0; i < n; i++)
            x[i] = scaler->mean[i / length] + scaler->scale[i / length] * lg_rng_normal(&rng);
        lg_model_eval(file.model, x, &y, work);
        mean += y / DRAWN;
    }
    lg_model_file_destroy(&file);
    free(work);
    free(x);
    return mean;
}

/* Exports FOLDER.h5 to FOLDER-DTYPE as model `m`. */
static inline void detector_export_saved(const sample *of, const char *dtype, int seed, char *folder,
                                         size_t size) {
    char line[256];
    (void)snprintf(folder, size, "%s-%s", of->folder, dtype);
    (void)snprintf(line, sizeof line, "%s.h5 --out %s --name m --dtype %s --seed %d", of->folder, folder,
                   dtype, seed);
    export_run(line);
}

static inline void detector_export(const sample *of, const char *dtype, char *folder, size_t size) {
    detector_save(of);
    detector_export_saved(of, dtype, 7, folder, size);
}

#endif

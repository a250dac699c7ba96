/* Detectors for the tests of lg-export: every pooling, stride, padding, plane, loss, scaling and activation.
 */
#ifndef LG_TEST_EXPORT_DETECTOR_H
#define LG_TEST_EXPORT_DETECTOR_H

#include "export_models.h"

#include <float.h>

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
    const char *name, *compiler, *flags;
    uint32_t classes;
    lg_detector_loss loss;
    bool centred;
    /* channels, length, blocks, {channels, kernel, stride, padding, pooling, size, stride}, plane, outputs */
    lg_cnn net;
} sample;

#define NET(channels, length, blocks, plane, outputs, activation, ...)                                       \
    {                                                                                                        \
        channels, length, blocks, {__VA_ARGS__}, plane, outputs, LG_##activation, {                          \
            0                                                                                                \
        }                                                                                                    \
    }

static const sample samples[] = {
    {"average", "gcc", "-O2", 2, MSE, false,
     NET(3, 40, 3, 2, 1, TANH, {6, 5, 1, 0, AVERAGE, 2, 2}, {12, 5, 1, 0, AVERAGE, 2, 2},
         {5, 3, 1, 0, AVERAGE, 2, 1})},
    {"maximum", "clang", "-O3", 3, CROSS, true,
     NET(2, 31, 2, 0, 3, SWISH, {5, 4, 2, 3, MAX, 3, 2}, {9, 3, 1, 1, MAX, 2, 3})},
    {"none", "gcc", "-O3 -march=native", 2, CROSS, false,
     NET(4, 25, 2, 5, 2, SIGMOID, {3, 5, 3, 2, NONE, 1, 1}, {8, 2, 1, 1, NONE, 1, 1})},
    {"kinks", "clang", "-O2", 4, CROSS, false,
     NET(2, 30, 3, 3, 4, RELU, {4, 3, 1, 1, MAX, 2, 2}, {6, 3, 2, 0, NONE, 1, 1},
         {4, 2, 1, 1, AVERAGE, 3, 2})},
    {"leaky", "gcc", "-O1", 2, MSE, true, NET(1, 20, 1, 0, 1, LEAKY_RELU, {7, 5, 2, 4, AVERAGE, 4, 1})},
    {"sine", "clang", "-O1", 2, CROSS, false, NET(1, 1, 1, 1, 2, SINE, {2, 1, 1, 0, MAX, 1, 1})},
    {"plain", "gcc", "-O2", 2, MSE, true, NET(3, 7, 0, 4, 1, TANH, {0, 0, 0, 0, NONE, 0, 0})},
    {"linear", "clang", "-O3", 3, CROSS, false, NET(2, 9, 0, 0, 3, IDENTITY, {0, 0, 0, 0, NONE, 0, 0})},
    {"one", "gcc", "-O0", 2, MSE, false, NET(2, 16, 1, 1, 1, IDENTITY, {1, 3, 1, 0, NONE, 1, 1})},
};

/* Writes NAME.h5; offsets and scales of the channels are far from 0 and 1. `offset` is added to the last
 * parameter, the offset of the output layer, and `weight` to the one before. */
static inline void detector_save(const sample *of, double weight, double offset) {
    char path[1024], name[128];
    lg_rng rng;
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
    file.theta = TEST_ARRAY(double, file.parameters);
    file.scaler.channels = net->channels;
    file.scaler.mean = TEST_ARRAY(double, net->channels);
    file.scaler.scale = TEST_ARRAY(double, net->channels);
    file.class_name = lg_test_memory(of->classes * sizeof *file.class_name);
    file.channel_name = lg_test_memory(net->channels * sizeof *file.channel_name);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++) file.history[i] = TEST_ARRAY(double, 3);
    lg_cnn_initialise(net, LG_INIT_GLOROT_UNIFORM, &rng, file.theta);
    for (size_t i = 0; i < file.parameters; i++) file.theta[i] += 0.1 * lg_rng_normal(&rng);
    file.theta[file.parameters - 1] += offset;
    file.theta[file.parameters - 2] += weight;
    for (uint32_t c = 0; c < net->channels; c++) {
        file.scaler.mean[c] = of->centred ? 0 : 10 * lg_rng_normal(&rng);
        file.scaler.scale[c] = pow(10, lg_rng_uniform_in(&rng, -2, 4));
        (void)snprintf(file.channel_name[c], LG_SERIES_NAME, "acc \"%u\" */ \\", c);
    }
    for (uint32_t c = 0; c < of->classes; c++)
        (void)snprintf(file.class_name[c], LG_SERIES_NAME, "state\t\"%u\" \xc3\xa9?\?/ */", c);
    (void)snprintf(name, sizeof name, "%s.h5", of->name);
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_save_detector(NULL, path, &file, NULL, NULL));
}

/* The default network for windows of this size; maxima and ReLU where `relu`. */
static inline sample detector_default(const char *name, uint32_t channels, uint32_t length, uint32_t classes,
                                      bool relu) {
    sample out = {.name = name, .classes = classes, .loss = classes == 2 ? MSE : CROSS, .centred = relu};
    lg_cnn_init_default(&out.net, channels, length, classes == 2 ? 1 : classes, relu ? LG_RELU : LG_TANH);
    for (uint32_t i = 0; i < out.net.blocks && relu; i++)
        if (out.net.block[i].pooling != LG_POOL_NONE) out.net.block[i].pooling = LG_POOL_MAX;
    return out;
}

/* ---- as the library has it ---- */

typedef struct detector {
    lg_model_file file;
    lg_detector_plan *scores;
    void *work;
    double *near[3]; /* two Jacobians, a window */
    float *window;
} detector;

static inline void detector_release(void *of) {
    detector *d = of;
    lg_detector_plan_destroy(d->scores);
    lg_model_file_destroy(&d->file);
}

static inline const lg_detector_file *detector_of(const detector *d) {
    return lg_model_file_of(&d->file, &lg_recipe_detector);
}

static inline detector *detector_load(const char *of) {
    char name[64], path[1024];
    detector *d = TEST_ARRAY(detector, 1);
    (void)snprintf(name, sizeof name, "%s.h5", of);
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_load(NULL, path, NULL, &d->file, NULL));
    const lg_detector_file *file = detector_of(d);
    assert_ok(lg_detector_plan_create(NULL, &file->run.model, &file->scaler, file->theta, LG_F64, &d->scores,
                                      NULL));
    lg_test_owns(d, detector_release);
    d->work = TEST_ARRAY(unsigned char, lg_model_work_size(d->file.model) + lg_detector_work_size(d->scores));
    const size_t inputs = lg_model_inputs(d->file.model), all = inputs * lg_model_outputs(d->file.model);
    for (int i = 0; i < 3; i++) d->near[i] = TEST_ARRAY(double, i < 2 ? all : inputs);
    d->window = TEST_ARRAY(float, inputs);
    return d;
}

static inline const char *detector_name(size_t i) {
    return samples[i].name;
}

static inline export_way detector_way(size_t i) {
    return (export_way){samples[i].compiler, samples[i].flags};
}

static inline void *detector_make(size_t i) {
    detector_save(&samples[i], 0, 0);
    return detector_load(samples[i].name);
}

/* ---- windows ---- */

static inline bool has_kinks(const lg_cnn *net) {
    bool kinks = net->activation == LG_RELU || net->activation == LG_LEAKY_RELU;
    for (uint32_t i = 0; i < net->blocks; i++) kinks = kinks || net->block[i].pooling == LG_POOL_MAX;
    return kinks;
}

/* Where a kink lies within rounding, the gradient may be that of its other side. */
static inline bool is_smooth(const exported *e, lg_rng *rng, const double *x) {
    const detector *d = e->model;
    const lg_detector_file *file = detector_of(d);
    const size_t n = e->lib.inputs, all = n * e->lib.outputs, length = file->run.model.net.length;
    const double eps = e->lib.single ? FLT_EPSILON : DBL_EPSILON;
    double change = 0, sum = 0;
    if (!has_kinks(&file->run.model.net)) return true;
    lg_model_jacobian(d->file.model, x, NULL, d->near[0], d->work);
    for (int k = 0; k < 2; k++) {
        for (size_t i = 0; i < n; i++)
            d->near[2][i] = x[i] + 16 * eps * lg_rng_normal(rng) * file->scaler.scale[i / length];
        lg_model_jacobian(d->file.model, d->near[2], NULL, d->near[1], d->work);
        change += pow(export_norm(d->near[1], d->near[0], all), 2);
        sum += pow(export_norm(d->near[0], NULL, all), 2);
    }
    return change <= pow(e->lib.tolerance / 2, 2) * sum;
}

static inline void detector_draw(void *user, lg_rng *rng, double *x) {
    const exported *e = user;
    const detector *d = e->model;
    const lg_detector_file *file = detector_of(d);
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

static inline void detector_reference(void *user, const double *x, double *y, double *jacobian) {
    const detector *d = ((const exported *)user)->model;
    lg_model_jacobian(d->file.model, x, y, jacobian, d->work);
}

#endif

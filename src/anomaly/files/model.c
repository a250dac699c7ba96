/* Detectors as a kind of model: their attributes and arrays in model files. */
#include <stdio.h>
#include <string.h>

#include "liegrad/anomaly.h"

#include "anomaly/files/recipe.h"
#include "model/files/program_file.h"

/* ---- blocks as text, such as "12 kernel 5 stride 1 padding 0 average 2/2, 24 kernel ..." ---- */

static void show_blocks(const void *user, char *text, size_t size) {
    const lg_cnn *net = &((const lg_detector_run *)user)->model.net;
    size_t used = 0;
    text[0] = '\0';
    for (uint32_t i = 0; i < net->blocks && i < LG_CNN_MAX_BLOCKS && used < size; i++) {
        const lg_cnn_block *b = &net->block[i];
        const char *pooling = b->pooling < LG_POOLING_COUNT ? lg_pooling_name(b->pooling) : NULL;
        used += (size_t)snprintf(text + used, size - used, "%s%u kernel %u stride %u padding %u %s",
                                 i > 0 ? ", " : "", b->channels, b->kernel, b->stride, b->padding,
                                 pooling != NULL ? pooling : "?");
        if (b->pooling != LG_POOL_NONE && used < size)
            used += (size_t)snprintf(text + used, size - used, " %u/%u", b->pool_size, b->pool_stride);
    }
}

/* Parses a block: "12 kernel 5 [stride 1] [padding 0] [pooling]" with the pooling "none", "average 2/2" or
 * "max 2/2" (pool_size/pool_stride). Returns its end, NULL if it is wrong. */
static const char *parse_block(const char *text, lg_cnn_block *b) {
    unsigned long long n[6] = {0, 0, 1, 0, 1, 1};
    char pooling[16] = "none";
    int end[5] = {0};
    (void)sscanf(text, "%10llu kernel %10llu%n", &n[0], &n[1], &end[0]);
    (void)sscanf(text += end[0], " stride %10llu%n", &n[2], &end[1]);
    (void)sscanf(text += end[1], " padding %10llu%n", &n[3], &end[2]);
    (void)sscanf(text += end[2], " %15[a-z]%n", pooling, &end[3]);
    LG_FIND_NAME(b->pooling, LG_POOLING_COUNT, lg_pooling_name, pooling);
    bool good = end[0] > 0 && b->pooling < LG_POOLING_COUNT;
    text += end[3];
    if (good && b->pooling != LG_POOL_NONE) {
        (void)sscanf(text, "%10llu/%10llu%n", &n[4], &n[5], &end[4]);
        good = end[4] > 0;
    }
    for (size_t i = 0; i < LG_COUNT(n); i++) good = good && n[i] <= UINT32_MAX;
    b->channels = (uint32_t)n[0], b->kernel = (uint32_t)n[1], b->stride = (uint32_t)n[2];
    b->padding = (uint32_t)n[3], b->pool_size = (uint32_t)n[4], b->pool_stride = (uint32_t)n[5];
    text += end[4];
    return good ? text + strspn(text, " ") : NULL;
}

/* ---- the run ---- */

#define FACT(group, name, type, member, ...) LG_FACT(lg_detector_run, group, name, type, member, __VA_ARGS__)
static const lg_field facts[] = {FACT("model", "channels", U32, model.net.channels, .low = 1),
                                 FACT("model", "length", U32, model.net.length, .low = 1),
                                 FACT("model", "blocks", SHOWN, model.net, .show = show_blocks),
                                 FACT("model", "classes", U32, model.classes, .low = 2),
                                 FACT("run", "windows", U64, windows, .low = 0),
                                 FACT("run", "window", U64, window, .low = 0),
                                 FACT("run", "hop", U64, hop, .low = 0),
                                 FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
                                 LG_FIELD_END};

static const lg_detector_run defaults = {.training = {.shards = 4}};

static lg_status read_blocks(lg_h5 *h5, void *user, lg_error *error) {
    lg_cnn *net = &((lg_detector_run *)user)->model.net;
    char text[LG_H5_TEXT];
    const lg_status status = lg_h5_text(h5, "model", "blocks", text, sizeof text, error);
    if (status != LG_OK && status != LG_SHAPE) return lg_as_format(status, error);
    const char *at = status == LG_OK ? text : NULL;
    net->blocks = 0;
    if (at != NULL && at[strspn(at, " ")] == '\0') return LG_OK;
    while (at != NULL && net->blocks < LG_CNN_MAX_BLOCKS) {
        at = parse_block(at, &net->block[net->blocks++]);
        if (at != NULL && *at == '\0') return LG_OK;
        at = at != NULL && *at == ',' ? at + 1 : NULL;
    }
    return lg_h5_fail(h5, error,
                      "/model: attribute blocks: expected up to %d as '12 kernel 5 stride 1 padding 0 "
                      "average 2/2, ...'",
                      LG_CNN_MAX_BLOCKS);
}

static lg_status make(void *user, lg_error *why) {
    lg_detector_run *run = user;
    lg_detector *model = &run->model;
    model->net.outputs = model->loss == LG_DETECTOR_MSE ? 1 : model->classes;
    LG_TRY(lg_cnn_init(&model->net, why));
    LG_TRY(lg_detector_check(model, why));
    if (run->test_fraction < 1 && run->validation_fraction < 1 &&
        run->test_fraction + run->validation_fraction < 1)
        return LG_OK;
    return lg_fail(why, LG_INVALID_ARGUMENT,
                   "/run: attributes test_fraction and validation_fraction: their sum must be below 1");
}

static lg_status describe(lg_h5 *h5, const void *user, lg_error *error) {
    static const char *const outputs[LG_DETECTOR_LOSS_COUNT] = {
        [LG_DETECTOR_MSE] = "logit of class 1",
        [LG_DETECTOR_CROSS_ENTROPY] = "a logit a class",
    };
    const lg_detector *model = &((const lg_detector_run *)user)->model;
    LG_TRY(lg_h5_put_text(h5, "model", "inputs", "(samples, channels), scaled: (x - mean)/scale", error));
    return lg_h5_put_text(h5, "model", "outputs", outputs[model->loss], error);
}

static bool slice(const void *run, uint32_t index, lg_slice_info *out) {
    return lg_cnn_slice(&((const lg_detector_run *)run)->model.net, index, out);
}

/* ---- other arrays and numbers of the file ---- */

static const lg_item items[] = {
    {.type = LG_ITEM_SCALER,
     .name = "scaler",
     .offset = offsetof(lg_detector_file, scaler),
     .dims = {LG_DIM(lg_detector_file, run.model.net.channels, "channels")}},
    LG_ATTRIBUTE(lg_detector_file, REAL, "accuracy", accuracy, .field.meaning = "on the test part"),
    LG_ATTRIBUTE(lg_detector_file, REAL, "f1", f1, .field.meaning = "mean over the classes"),
    LG_ATTRIBUTE(lg_detector_file, REAL, "test_mse", test_mse, .field.meaning = "of the probability"),
    {.type = LG_ITEM_END}};

static lg_status put_rest(lg_h5 *h5, const void *user, lg_error *error) {
    const lg_detector_file *file = user;
    const lg_cnn *net = &file->run.model.net;
    lg_series names = file->names;
    names.classes = file->run.model.classes, names.channels = net->channels, names.length = net->length;
    return lg_detector_put_names(h5, &names, &file->novelty, error);
}

static lg_status get_rest(lg_h5 *h5, void *user, lg_error *error) {
    lg_detector_file *file = user;
    const lg_cnn *net = &file->run.model.net;
    file->names =
        (lg_series){.classes = file->run.model.classes, .channels = net->channels, .length = net->length};
    return lg_detector_get_names(h5, net->length, &file->names, &file->novelty, error);
}

static void release(void *user) {
    lg_detector_file *file = user;
    lg_series_destroy(&file->names);
    lg_novelty_destroy(&file->novelty);
}

/* ---- program and recipe ---- */

static lg_status program(const lg_context *context, const void *user, const lg_scheme *scheme,
                         lg_program **out, lg_error *error) {
    const lg_detector_file *file = user;
    return lg_detector_program(context, &file->run.model, &file->scaler, file->theta, out, error);
}

static const lg_program_source places[] = {{"mean", "single scaler/mean"},
                                           {"mean_rest", "rest scaler/mean"},
                                           {"inverse_scale", "inverse scaler/scale"},
                                           {NULL, NULL}};

extern const struct lg_trainer lg_detector_learner; /* defined in recipe.c */
LG_RECIPE(detector, "detector-checkpoint", LG_MADE(lg_detector_run, model.net), .read = read_blocks,
          .items = items, .put_rest = put_rest, .get_rest = get_rest, .release = release, .places = places,
          .trainer = &lg_detector_learner);

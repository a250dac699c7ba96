/* Detectors as a kind of model: their attributes and arrays in model files. */
#include <stdio.h>
#include <string.h>

#include "liegrad/anomaly.h"

#include "model/files/program_file.h"
#include "model/files/recipe.h"
#include "datasets/series_files.h"

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

/* Skips blanks and takes the next word, up to a blank, comma or slash. Returns false if there is no word or
 * the word has 16 characters or more. */
static bool next_word(const char **at, char word[16]) {
    *at += strspn(*at, " ");
    const size_t length = strcspn(*at, " ,/");
    if (length == 0 || length >= 16) return false;
    memcpy(word, *at, length);
    word[length] = '\0';
    *at += length;
    return true;
}

static bool next_number(const char **at, uint32_t *out) {
    char word[16];
    uint64_t value;
    if (!next_word(at, word) || lg_integer_parse(word, &value) != LG_OK || value > UINT32_MAX) return false;
    *out = (uint32_t)value;
    return true;
}

/* Takes a name with its number, such as "kernel 5", and returns true; *bad tells whether the number is
 * missing or wrong. If the next word is not `name`, takes nothing and returns false. */
static bool named_number(const char **at, const char *name, uint32_t *out, bool *bad) {
    const char *look = *at;
    char word[16];
    if (!next_word(&look, word) || strcmp(word, name) != 0) return false;
    *bad = !next_number(&look, out);
    *at = look;
    return true;
}

/* Parses an optional pooling: "none", "average 2/2" or "max 2/2", the numbers being pool_size/pool_stride. */
static bool parse_pooling(const char **at, lg_cnn_block *b) {
    const char *look = *at;
    char word[16];
    if (!next_word(&look, word)) return true;
    if (lg_pooling_parse(word, &b->pooling) != LG_OK) return false;
    *at = look;
    if (b->pooling == LG_POOL_NONE) return true;
    return next_number(at, &b->pool_size) && *(*at)++ == '/' && next_number(at, &b->pool_stride);
}

/* Parses a block: "12 kernel 5 [stride 1] [padding 0] [pooling]". */
static bool parse_block(const char **at, lg_cnn_block *b) {
    bool bad = false;
    *b = (lg_cnn_block){.stride = 1, .pool_size = 1, .pool_stride = 1};
    if (!next_number(at, &b->channels) || !named_number(at, "kernel", &b->kernel, &bad) || bad) return false;
    (void)named_number(at, "stride", &b->stride, &bad);
    if (!bad) (void)named_number(at, "padding", &b->padding, &bad);
    return !bad && parse_pooling(at, b);
}

static bool parse_blocks(const char *text, lg_cnn *net) {
    const char *at = text + strspn(text, " ");
    net->blocks = 0;
    while (*at != '\0') {
        if (net->blocks == LG_CNN_MAX_BLOCKS || !parse_block(&at, &net->block[net->blocks])) return false;
        net->blocks++;
        at += strspn(at, " ");
        if (*at == '\0') return true;
        if (*at++ != ',' || at[strspn(at, " ")] == '\0') return false;
    }
    return true;
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

static lg_status check_fractions(const lg_detector_run *run) {
    return run->test_fraction < 1 && run->validation_fraction < 1 &&
                   run->test_fraction + run->validation_fraction < 1
               ? LG_OK
               : LG_INVALID_ARGUMENT;
}

static uint32_t outputs_of(const lg_detector *model) {
    return model->loss == LG_DETECTOR_MSE ? 1 : model->classes;
}

static lg_status build(lg_h5 *h5, void *user, lg_error *error) {
    lg_detector_run *run = user;
    lg_detector *model = &run->model;
    char text[LG_H5_TEXT];
    const char *shown = lg_shown_path(h5->path);
    lg_error reason = {LG_OK, ""};
    const lg_status status = lg_h5_text(h5, "model", "blocks", text, sizeof text, error);
    if (status != LG_OK && status != LG_SHAPE) return lg_missing_is_format(status, error);
    if (status == LG_SHAPE || !parse_blocks(text, &model->net))
        return lg_fail(error, LG_FORMAT,
                       "%s: /model: attribute blocks: expected up to %d as '12 kernel 5 stride 1 padding 0 "
                       "average 2/2, ...'",
                       shown, LG_CNN_MAX_BLOCKS);
    model->net.outputs = outputs_of(model);
    if (lg_cnn_init(&model->net, &reason) != LG_OK || lg_detector_check(model, &reason) != LG_OK)
        return lg_fail(error, LG_FORMAT, "%s: /model: the attributes do not describe a possible network: %s",
                       shown, reason.message);
    if (check_fractions(run) != LG_OK)
        return lg_fail(
            error, LG_FORMAT,
            "%s: /run: attributes test_fraction and validation_fraction: their sum must be below 1", shown);
    return LG_OK;
}

/* lg_detector_check also compares the network's lengths with the lengths that lg_cnn_init computes. */
static lg_status check(const void *user) {
    const lg_detector_run *run = user;
    LG_TRY(lg_detector_check(&run->model, NULL));
    return check_fractions(run);
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

static size_t parameters(const void *run) {
    return lg_cnn_parameters(&((const lg_detector_run *)run)->model.net);
}

static bool slice(const void *run, uint32_t index, lg_slice_info *out) {
    return lg_cnn_slice(&((const lg_detector_run *)run)->model.net, index, out);
}

/* ---- other arrays and numbers of the file ---- */

#define NUMBER(member)                                                                                       \
    { #member, offsetof(lg_detector_file, member) }
static const lg_model_number numbers[] = {NUMBER(accuracy), NUMBER(f1), NUMBER(test_mse), {NULL, 0}};

static lg_sensing sensing_of(const lg_detector_file *file) {
    return (lg_sensing){.classes = file->run.model.classes,
                        .channels = file->run.model.net.channels,
                        .class_name = file->class_name,
                        .class_label = file->class_label,
                        .channel_name = file->channel_name,
                        .rate = file->rate};
}

static lg_status check_scales(const char *path, const lg_scaler *scaler, lg_status status, lg_error *error) {
    for (uint32_t c = 0; c < scaler->channels; c++)
        if (!(scaler->scale[c] > 0))
            return lg_fail(error, status, "%s: /scaler/scale: is %g at index (%u), expected more than 0",
                           lg_shown_path(path), scaler->scale[c], c);
    return LG_OK;
}

enum { ARRAYS = 2 };
static void list_arrays(lg_scaler *scaler, lg_h5_size *channels, lg_h5_array out[ARRAYS]) {
    out[0] = (lg_h5_array){"scaler/mean", &scaler->mean, {channels}, false};
    out[1] = (lg_h5_array){"scaler/scale", &scaler->scale, {channels}, false};
}

static lg_status put_scaler(lg_h5 *h5, const lg_detector_file *file, lg_error *error) {
    lg_scaler scaler = file->scaler;
    lg_h5_size channels = {file->run.model.net.channels, "channels", "model"};
    lg_h5_array arrays[ARRAYS];
    if (scaler.channels != channels.n || scaler.mean == NULL || scaler.scale == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: /scaler: has %u channels, but the model has %u",
                       lg_shown_path(h5->path), scaler.channels, file->run.model.net.channels);
    LG_TRY(check_scales(h5->path, &scaler, LG_INVALID_ARGUMENT, error));
    list_arrays(&scaler, &channels, arrays);
    return lg_h5_put_arrays(h5, arrays, ARRAYS, error);
}

static lg_status check_novelty(const lg_h5 *h5, const lg_detector_file *file, lg_status status,
                               lg_error *error) {
    const lg_novelty *v = &file->novelty;
    const lg_cnn *net = &file->run.model.net;
    if (v->channels == 0 || (v->channels == net->channels && v->length == net->length)) return LG_OK;
    return lg_fail(
        error, status,
        "%s: /novelty: is for windows of %u channels and %u samples, but windows of the model have %u and %u",
        lg_shown_path(h5->path), v->channels, v->length, net->channels, net->length);
}

static lg_status put_novelty(lg_h5 *h5, const lg_detector_file *file, lg_error *error) {
    lg_error failure = {LG_OK, ""};
    lg_h5_view view = {.h5 = h5, .failure = &failure};
    const lg_archive_writer writer = lg_h5_view_writer(&view);
    LG_TRY(check_novelty(h5, file, LG_INVALID_ARGUMENT, error));
    return file->novelty.channels == 0 ? LG_OK : lg_novelty_save(&file->novelty, &writer, error);
}

static lg_status get_novelty(lg_h5 *h5, lg_detector_file *file, lg_error *error) {
    lg_error failure = {LG_OK, ""};
    lg_h5_view view = {.h5 = h5, .failure = &failure};
    const lg_archive_reader reader = lg_h5_view_reader(&view);
    lg_error reason = {LG_OK, ""};
    const lg_status status = lg_novelty_load(h5->context, &reader, &file->novelty, &reason);
    if (status == LG_NOT_FOUND) return LG_OK;
    if (status != LG_OK) return lg_fail(error, status, "%s: /%s", lg_shown_path(h5->path), reason.message);
    return check_novelty(h5, file, LG_FORMAT, error);
}

static lg_status put_rest(lg_h5 *h5, const void *user, bool fitted, lg_error *error) {
    const lg_detector_file *file = user;
    const lg_sensing sensing = sensing_of(file);
    (void)fitted;
    LG_TRY(put_scaler(h5, file, error));
    LG_TRY(lg_sensing_check(h5->context, h5->path, &sensing, error));
    LG_TRY(lg_sensing_put(h5, &sensing, error));
    LG_TRY(put_novelty(h5, file, error));
    return lg_model_put_numbers(h5, numbers, file, error);
}

static lg_status get_scaler(lg_h5 *h5, lg_detector_file *file, lg_error *error) {
    lg_h5_size channels = {file->run.model.net.channels, "channels", "model"};
    lg_h5_array arrays[ARRAYS];
    file->scaler = (lg_scaler){.channels = file->run.model.net.channels, .context = h5->context};
    list_arrays(&file->scaler, &channels, arrays);
    LG_TRY(lg_h5_get_arrays(h5, arrays, ARRAYS, error));
    return check_scales(h5->path, &file->scaler, LG_FORMAT, error);
}

/* Names the classes "0", "1", ... if the file has no names for them. */
static lg_status number_classes(lg_h5 *h5, lg_detector_file *file, lg_error *error) {
    const uint32_t classes = file->run.model.classes;
    if (file->class_name != NULL) return LG_OK;
    file->class_name = lg_alloc(h5->context, classes, sizeof *file->class_name);
    if (file->class_name == NULL) return lg_h5_no_memory(h5, error);
    for (uint32_t c = 0; c < classes; c++) (void)snprintf(file->class_name[c], LG_SERIES_NAME, "%u", c);
    return LG_OK;
}

static lg_status get_rest(lg_h5 *h5, void *user, lg_error *error) {
    lg_detector_file *file = user;
    lg_sensing sensing = {.classes = file->run.model.classes, .channels = file->run.model.net.channels};
    LG_TRY(get_scaler(h5, file, error));
    LG_TRY(lg_sensing_get(h5, &sensing, error));
    file->class_name = sensing.class_name;
    file->class_label = sensing.class_label;
    file->channel_name = sensing.channel_name;
    file->rate = sensing.rate;
    LG_TRY(number_classes(h5, file, error));
    LG_TRY(get_novelty(h5, file, error));
    return lg_model_get_numbers(h5, numbers, file, error);
}

void lg_detector_file_destroy(lg_detector_file *file) {
    if (file == NULL) return;
    lg_free(file->context, file->theta);
    lg_scaler_destroy(&file->scaler);
    lg_novelty_destroy(&file->novelty);
    lg_free(file->context, file->class_name);
    lg_free(file->context, file->class_label);
    lg_free(file->context, file->channel_name);
    lg_history_destroy(file->context, file->history);
    *file = (lg_detector_file){.parameters = 0};
}

/* ---- program and recipe ---- */

static lg_status program(const lg_context *context, const void *user, const lg_scheme *scheme,
                         lg_program **out, lg_error *error) {
    const lg_detector_file *file = user;
    (void)scheme;
    return lg_detector_program(context, &file->run.model, &file->scaler, file->theta, out, error);
}

static const lg_program_source places[] = {{"mean", "single scaler/mean"},
                                           {"mean_rest", "rest scaler/mean"},
                                           {"inverse_scale", "inverse scaler/scale"},
                                           {NULL, NULL}};

extern const struct lg_trainer lg_detector_learner; /* defined in recipe.c */
LG_RECIPE(detector, "detector-checkpoint", .places = places, .trainer = &lg_detector_learner);

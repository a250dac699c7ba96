/* Table networks as a kind of model: their model file. */
#include <stdio.h>
#include <string.h>

#include "model/files/program_file.h"
#include "model/files/recipe.h"
#include "table/files/recipe.h"

/* ---- fields of the run ---- */

static const char *name_task(uint32_t value) {
    return lg_table_task_name((lg_table_task)value);
}

#define FACT(group, name, type, member, ...) LG_FACT(lg_table_run, group, name, type, member, __VA_ARGS__)
static const lg_field facts[] = {FACT("model", "task", NAME, model.options.task, .value_name = name_task),
                                 FACT("model", "inputs", U32, model.net.inputs, .low = 1),
                                 FACT("model", "outputs", U32, model.net.outputs, .low = 1),
                                 FACT("run", "rows", U64, rows, .low = 0),
                                 FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
                                 LG_FIELD_END};

static const lg_table_run defaults; /* zeros */

static bool decay_fits(const lg_table_run *run) {
    return run->decay.count == 0 || run->decay.count == lg_table_slices(&run->model);
}

static lg_status build(lg_h5 *h5, void *user, lg_error *error) {
    lg_table_run *run = user;
    const lg_table_options options = run->model.options;
    const char *shown = lg_shown_path(h5->path);
    lg_error reason = {LG_OK, ""};
    if (lg_table_init(&run->model, &options, run->model.net.inputs, run->model.net.outputs, &reason) != LG_OK)
        return lg_fail(error, LG_FORMAT, "%s: /model: the attributes do not describe a possible network: %s",
                       shown, reason.message);
    if (!decay_fits(run))
        return lg_fail(error, LG_FORMAT,
                       "%s: /run: attribute decay: has %u numbers, but the model has %u arrays", shown,
                       run->decay.count, lg_table_slices(&run->model));
    return LG_OK;
}

static lg_status check(const void *user) {
    const lg_table_run *run = user;
    const lg_table *model = &run->model;
    lg_table again;
    LG_TRY(lg_table_init(&again, &model->options, model->net.inputs, model->net.outputs, NULL));
    const bool same = memcmp(&again.net, &model->net, sizeof again.net) == 0 && decay_fits(run);
    return same ? LG_OK : LG_INVALID_ARGUMENT;
}

static lg_status describe(lg_h5 *h5, const void *user, lg_error *error) {
    static const char *const scaled[LG_TABLE_TASK_COUNT] = {
        [LG_TABLE_REGRESSION] = "x -> (x - mean)/scale, y = mean + scale f",
        [LG_TABLE_CLASSIFICATION] = "x -> (x - mean)/scale; f: a logit a class",
    };
    const lg_table *model = &((const lg_table_run *)user)->model;
    return lg_h5_put_text(h5, "model", "scaling", scaled[model->options.task], error);
}

static size_t parameters(const void *run) {
    return lg_table_parameters(&((const lg_table_run *)run)->model);
}

static bool slice(const void *run, uint32_t index, lg_slice_info *out) {
    return lg_table_slice(&((const lg_table_run *)run)->model, index, out);
}

/* ---- other contents of the file ---- */

#define NUMBER(member)                                                                                       \
    { #member, offsetof(lg_table_file, member) }
static const lg_model_number numbers[] = {NUMBER(rmse), NUMBER(accuracy), NUMBER(f1), {NULL, 0}};

static bool is_regression(const lg_table_file *file) {
    return file->run.model.options.task == LG_TABLE_REGRESSION;
}

static lg_status check_scales(const lg_h5 *h5, const char *name, const lg_scaler *scaler, lg_status status,
                              lg_error *error) {
    for (uint32_t c = 0; scaler->scale != NULL && c < scaler->channels; c++)
        if (!(scaler->scale[c] > 0))
            return lg_fail(error, status, "%s: /scaler/%s/scale: is %g at index (%u), expected more than 0",
                           lg_shown_path(h5->path), name, scaler->scale[c], c);
    return LG_OK;
}

enum { ARRAYS = 6 };
static void list_arrays(lg_table_file *file, lg_h5_size sizes[2], lg_h5_array out[ARRAYS]) {
    const bool scaled = is_regression(file); /* the outputs */
    const lg_h5_array list[ARRAYS] = {{"scaler/inputs/mean", &file->inputs.mean, {sizes}, false},
                                      {"scaler/inputs/scale", &file->inputs.scale, {sizes}, false},
                                      {"scaler/outputs/mean", &file->outputs.mean, {sizes + 1}, !scaled},
                                      {"scaler/outputs/scale", &file->outputs.scale, {sizes + 1}, !scaled},
                                      {"range/low", &file->low, {sizes}, true},
                                      {"range/high", &file->high, {sizes}, true}};
    memcpy(out, list, sizeof list);
    sizes[0] = (lg_h5_size){file->run.model.net.inputs, "inputs", "model"};
    sizes[1] = (lg_h5_size){file->run.model.net.outputs, "outputs", "model"};
}

static lg_status check_scaler(lg_h5 *h5, const char *name, const lg_scaler *scaler, uint32_t columns,
                              lg_error *error) {
    if (scaler->channels != columns || scaler->mean == NULL || scaler->scale == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: /scaler/%s: has %u columns, but the model has %u",
                       lg_shown_path(h5->path), name, scaler->channels, columns);
    return check_scales(h5, name, scaler, LG_INVALID_ARGUMENT, error);
}

static lg_status put_names(lg_h5 *h5, const char *name, char (*names)[LG_TABLE_NAME], uint32_t count,
                           lg_error *error) {
    return names != NULL ? lg_h5_put_texts(h5, name, names[0], LG_TABLE_NAME, count, error) : LG_OK;
}

static lg_status put_rest(lg_h5 *h5, const void *user, bool fitted, lg_error *error) {
    const lg_table_file *file = user;
    const lg_net *net = &file->run.model.net;
    lg_table_file copy = *file; /* it is only read; the list takes pointers without const */
    lg_h5_size sizes[2];
    lg_h5_array arrays[ARRAYS];
    (void)fitted;
    LG_TRY(check_scaler(h5, "inputs", &file->inputs, net->inputs, error));
    if (is_regression(file)) LG_TRY(check_scaler(h5, "outputs", &file->outputs, net->outputs, error));
    list_arrays(&copy, sizes, arrays);
    LG_TRY(lg_h5_put_arrays(h5, arrays, ARRAYS, error));
    LG_TRY(put_names(h5, "names/inputs", file->input_name, net->inputs, error));
    LG_TRY(put_names(h5, "names/outputs", file->output_name, net->outputs, error));
    if (file->class_column[0] != '\0')
        LG_TRY(lg_h5_put_text(h5, "", "class_column", file->class_column, error));
    return lg_model_put_numbers(h5, numbers, file, error);
}

/* ---- reading ---- */

typedef struct names_call {
    const lg_h5 *h5;
    const char *name;
    char (*names)[LG_TABLE_NAME];
    uint32_t count, found;
} names_call;

static lg_status take_name(void *user, uint64_t index, const char *text, lg_error *error) {
    names_call *call = user;
    const size_t length = strlen(text);
    (void)index;
    if (call->found >= call->count || length == 0 || length >= LG_TABLE_NAME)
        return lg_fail(error, LG_FORMAT, "%s: /%s: expected %u names of 1 to %d bytes",
                       lg_shown_path(call->h5->path), call->name, call->count, LG_TABLE_NAME - 1);
    char *to = call->names[call->found++];
    memset(to, 0, LG_TABLE_NAME);
    memcpy(to, text, length);
    return LG_OK;
}

/* Reads the names of inputs or outputs. Without names in the file they are "x1", "x2", ... with the given
 * letter. */
static lg_status get_names(lg_h5 *h5, const char *name, const char *letter, uint32_t count,
                           char (**out)[LG_TABLE_NAME], lg_error *error) {
    *out = lg_alloc(h5->context, count, sizeof **out);
    if (*out == NULL) return lg_h5_no_memory(h5, error);
    names_call call = {h5, name, *out, count, 0};
    for (uint32_t i = 0; i < count; i++) (void)snprintf((*out)[i], LG_TABLE_NAME, "%s%u", letter, i + 1);
    if (!lg_h5_has(h5, name)) return LG_OK;
    LG_TRY(lg_as_format(lg_h5_each_text(h5, name, take_name, &call, error), error));
    if (call.found == count) return LG_OK;
    return lg_fail(error, LG_FORMAT, "%s: /%s: has %u names, but the model has %u columns or classes",
                   lg_shown_path(h5->path), name, call.found, count);
}

static lg_status get_class_column(lg_h5 *h5, lg_table_file *file, lg_error *error) {
    if (!lg_h5_has_attribute(h5, "", "class_column")) return LG_OK;
    const lg_status status =
        lg_h5_text(h5, "", "class_column", file->class_column, sizeof file->class_column, error);
    if (status != LG_SHAPE) return status;
    return lg_fail(error, LG_FORMAT, "%s: attribute class_column is too long", lg_shown_path(h5->path));
}

static lg_status get_rest(lg_h5 *h5, void *user, lg_error *error) {
    lg_table_file *file = user;
    const lg_net *net = &file->run.model.net;
    lg_h5_size sizes[2];
    lg_h5_array arrays[ARRAYS];
    file->inputs = (lg_scaler){.channels = net->inputs, .context = h5->context};
    file->outputs = (lg_scaler){.channels = is_regression(file) ? net->outputs : 0, .context = h5->context};
    list_arrays(file, sizes, arrays);
    LG_TRY(lg_h5_get_arrays(h5, arrays, ARRAYS, error));
    LG_TRY(check_scales(h5, "inputs", &file->inputs, LG_FORMAT, error));
    LG_TRY(check_scales(h5, "outputs", &file->outputs, LG_FORMAT, error));
    LG_TRY(get_names(h5, "names/inputs", "x", net->inputs, &file->input_name, error));
    LG_TRY(get_names(h5, "names/outputs", is_regression(file) ? "y" : "class", net->outputs,
                     &file->output_name, error));
    LG_TRY(get_class_column(h5, file, error));
    return lg_model_get_numbers(h5, numbers, file, error);
}

void lg_table_file_destroy(lg_table_file *file) {
    if (file == NULL) return;
    lg_free(file->context, file->theta);
    lg_scaler_destroy(&file->inputs);
    lg_scaler_destroy(&file->outputs);
    lg_free(file->context, file->low);
    lg_free(file->context, file->high);
    lg_free(file->context, file->input_name);
    lg_free(file->context, file->output_name);
    lg_history_destroy(file->context, file->history);
    *file = (lg_table_file){.parameters = 0};
}

/* ---- program and recipe ---- */

static lg_status program(const lg_context *context, const void *user, const lg_scheme *scheme,
                         lg_program **out, lg_error *error) {
    const lg_table_file *file = user;
    (void)scheme;
    return lg_table_program(context, &file->run.model, &file->inputs, &file->outputs, file->theta, out,
                            error);
}

static const lg_program_source places[] = {{"mean", "single scaler/inputs/mean"},
                                           {"mean_rest", "rest scaler/inputs/mean"},
                                           {"inverse_scale", "inverse scaler/inputs/scale"},
                                           {"output_mean", "scaler/outputs/mean"},
                                           {"output_scale", "scaler/outputs/scale"},
                                           {NULL, NULL}};

extern const struct lg_trainer lg_table_learner; /* in recipe.c */
LG_RECIPE(table, "table-checkpoint", .places = places, .trainer = &lg_table_learner);

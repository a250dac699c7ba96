/* Table networks as a kind of model: their model file. */
#include <stdio.h>

#include "datasets/series_files.h"
#include "model/files/program_file.h"
#include "model/files/recipe.h"
#include "table/files/recipe.h"

/* ---- fields of the run ---- */

#define FACT(group, name, type, member, ...) LG_FACT(lg_table_run, group, name, type, member, __VA_ARGS__)
static const lg_field facts[] = {
    FACT("model", "task", NAME, model.options.task, LG_NAMED(lg_table_task_name, LG_TABLE_TASK_COUNT)),
    FACT("model", "inputs", U32, model.net.inputs, .low = 1),
    FACT("model", "outputs", U32, model.net.outputs, .low = 1),
    FACT("run", "rows", U64, rows, .low = 0),
    FACT("run", "data_sha256", TEXT, data_sha256, .low = 0),
    LG_FIELD_END};

static const lg_table_run defaults; /* zeros */

static lg_status make(void *user, lg_error *why) {
    lg_table_run *run = user;
    const lg_table_options options = run->model.options;
    LG_TRY(lg_table_init(&run->model, &options, run->model.net.inputs, run->model.net.outputs, why));
    if (run->decay.count == 0 || run->decay.count == lg_table_slices(&run->model)) return LG_OK;
    return lg_fail(why, LG_INVALID_ARGUMENT,
                   "/run: attribute decay: has %u numbers, but the model has %u arrays", run->decay.count,
                   lg_table_slices(&run->model));
}

static lg_status describe(lg_h5 *h5, const void *user, lg_error *error) {
    static const char *const scaled[LG_TABLE_TASK_COUNT] = {
        [LG_TABLE_REGRESSION] = "x -> (x - mean)/scale, y = mean + scale f",
        [LG_TABLE_CLASSIFICATION] = "x -> (x - mean)/scale; f: a logit a class",
    };
    const lg_table *model = &((const lg_table_run *)user)->model;
    return lg_h5_put_text(h5, "model", "scaling", scaled[model->options.task], error);
}

static bool slice(const void *run, uint32_t index, lg_slice_info *out) {
    return lg_table_slice(&((const lg_table_run *)run)->model, index, out);
}

/* ---- other contents of the file ---- */

static bool is_regression(const void *run) {
    return ((const lg_table_run *)run)->model.options.task == LG_TABLE_REGRESSION;
}

#define TABLE(type_, name_, member, ...)                                                                     \
    { .type = LG_ITEM_##type_, .name = name_, .offset = offsetof(lg_table_file, member), __VA_ARGS__ }
#define INPUTS  .dims = {LG_DIM(lg_table_file, run.model.net.inputs, "columns")}
#define OUTPUTS .dims = {LG_DIM(lg_table_file, run.model.net.outputs, "columns")}
static const lg_item items[] = {
    TABLE(SCALER, "scaler/inputs", inputs, INPUTS),
    TABLE(SCALER, "scaler/outputs", outputs, OUTPUTS, .applies = is_regression),
    TABLE(ARRAY, "range/low", low, INPUTS, .optional = true),
    TABLE(ARRAY, "range/high", high, INPUTS, .optional = true),
    {.type = LG_ITEM_ARRAY, .offset = offsetof(lg_table_file, input_name)},
    {.type = LG_ITEM_ARRAY, .offset = offsetof(lg_table_file, output_name)},
    LG_ATTRIBUTE(lg_table_file, TEXT, "class_column", class_column),
    LG_ATTRIBUTE(lg_table_file, REAL, "rmse", rmse, .field.meaning = "of the outputs' deviation"),
    LG_ATTRIBUTE(lg_table_file, REAL, "accuracy", accuracy),
    LG_ATTRIBUTE(lg_table_file, REAL, "f1", f1),
    {.type = LG_ITEM_END}};

static lg_status put_names(lg_h5 *h5, const void *user, lg_error *error) {
    const lg_table_file *file = user;
    const lg_net *net = &file->run.model.net;
    if (file->input_name != NULL)
        LG_TRY(lg_h5_put_texts(h5, "names/inputs", file->input_name[0], LG_TABLE_NAME, net->inputs, error));
    if (file->output_name == NULL) return LG_OK;
    return lg_h5_put_texts(h5, "names/outputs", file->output_name[0], LG_TABLE_NAME, net->outputs, error);
}

/* Reads the names of inputs or outputs. Without names in the file they are "x1", "x2", ... with the given
 * letter. */
static lg_status read_names(lg_h5 *h5, const char *name, const char *letter, uint32_t count,
                            char (**out)[LG_TABLE_NAME], lg_error *error) {
    LG_TRY(lg_names_list(h5, name, true, &count, out, error));
    if (*out != NULL) return LG_OK;
    *out = lg_alloc(h5->context, count, sizeof **out);
    if (*out == NULL) return lg_h5_no_memory(h5, error);
    for (uint32_t i = 0; i < count; i++) (void)snprintf((*out)[i], LG_TABLE_NAME, "%s%u", letter, i + 1);
    return LG_OK;
}

static lg_status get_names(lg_h5 *h5, void *user, lg_error *error) {
    lg_table_file *file = user;
    const lg_net *net = &file->run.model.net;
    LG_TRY(read_names(h5, "names/inputs", "x", net->inputs, &file->input_name, error));
    return read_names(h5, "names/outputs", is_regression(&file->run) ? "y" : "class", net->outputs,
                      &file->output_name, error);
}

/* ---- program and recipe ---- */

static lg_status program(const lg_context *context, const void *user, const lg_scheme *scheme,
                         lg_program **out, lg_error *error) {
    const lg_table_file *file = user;
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
LG_RECIPE(table, "table-checkpoint", LG_MADE(lg_table_run, model.net), .items = items, .put_rest = put_names,
          .get_rest = get_names, .places = places, .trainer = &lg_table_learner);

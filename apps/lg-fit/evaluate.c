/* lg-fit evaluate: the errors of a model on a table. */
#include <stdlib.h>

#include "lg-fit/fit.h"

typedef struct evaluate_values {
    const char *plot;
} evaluate_values;

static const lg_field evaluate_options[] = {
    LG_OPTION(evaluate_values, plot, STRING, "FILE.svg|.png",
              "Draw predicted against true values, or the table of confusion; its data and script stay "
              "beside it, as FILE.dat and FILE.gp"),
    LG_FIELD_END};

static evaluate_values values;

static int judge(const app *self, const lg_table_file *file, const fit_table *table) {
    lg_error error = {LG_OK, ""};
    judgement j;
    const double begin = app_seconds();
    lg_status status = judge_rows(self, file, table, NULL, 0, &j, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    const double seconds = app_seconds() - begin;
    warn_outside(self, j.outside, j.rows, table->path, self->arguments[0]);
    const int code = warn_judgement(self, file, &j, table->path);
    warn_far_outputs(self, file, table);
    if (values.plot != NULL) status = draw_judgement(self, values.plot, file, &j, &error);
    if (status == LG_OK && self->json) {
        app_json json;
        app_json_begin(&json);
        judgement_json(&json, file, &j);
        app_json_text(&json, "task", lg_table_task_name(file->run.model.options.task));
        app_json_size(&json, "rows_left_out", table->left_out);
        app_json_real(&json, "seconds", seconds);
        app_json_warnings(&json, self);
        app_json_end(&json);
    } else if (status == LG_OK) {
        judgement_print(file, &j);
    }
    judgement_free(&j);
    return status == LG_OK ? code : app_fail_file(self, status, &error, values.plot);
}

static int run(app *self) {
    lg_error error = {LG_OK, ""};
    lg_table_file file;
    fit_table table = {.path = NULL};
    const app_path plot = {"plot", values.plot, LG_FILE_DRAWN};
    int code = app_check_outputs(self, &plot, 1);
    if (code != APP_EXIT_OK) return code;
    const lg_status status = lg_model_load_table(self->context, self->arguments[0], NULL, &file, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    const bool regression = file.run.model.options.task == LG_TABLE_REGRESSION;
    const column_names inputs = {file.run.model.net.inputs, file.input_name},
                       outputs = {regression ? file.run.model.net.outputs : 0, file.output_name};
    code = read_table(self, self->arguments[1], &inputs, &outputs, regression ? NULL : file.class_column,
                      true, &table);
    if (code == APP_EXIT_OK && !regression)
        code = match_classes(self, &table, file.output_name, file.run.model.net.outputs);
    if (code == APP_EXIT_OK) code = judge(self, &file, &table);
    lg_table_data_destroy(&table.data);
    lg_table_file_destroy(&file);
    return code;
}

const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 TABLE",
    .summary = "Judge a model on a table",
    .details =
        "Columns are found by their names, in any order. Rows with missing cells are left out. A row is "
        "outside of the training range where an input is beyond it by more than a tenth of it.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, values)),
    .run = run};

/* lg-fit predict: writes the outputs of a model for the rows of a table. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/csv.h"
#include "lg-fit/fit.h"
#include "liegrad/series.h"

typedef struct predict_values {
    const char *out;
} predict_values;

static const lg_field predict_options[] = {LG_OPTION(predict_values, out, STRING, "FILE.csv",
                                                     "The file to write (default: standard output)",
                                                     .file = LG_FILE_TEXT),
                                           LG_FIELD_END};

static predict_values values;

/* ---- CSV ---- */

/* A column name has at most LG_TABLE_NAME - 1 bytes. If "probability_CLASS" is longer for any class, all
 * columns are named by the number of the class instead. */
static void put_header(FILE *to, const lg_table_file *file) {
    static const char before[] = "probability_";
    const bool regression = file->run.model.options.task == LG_TABLE_REGRESSION;
    bool fits = true;
    for (uint32_t o = 0; o < file->run.model.net.outputs; o++)
        fits = fits && strlen(before) + strlen(file->output_name[o]) < LG_TABLE_NAME;
    if (!regression) lg_csv_put(to, "", file->class_column[0] != '\0' ? file->class_column : "class", true);
    for (uint32_t o = 0; o < file->run.model.net.outputs; o++) {
        APP_FREE char *name = regression ? app_format("%s", file->output_name[o])
                              : fits     ? app_format("%s%s", before, file->output_name[o])
                                         : app_format("%s%u", before, o);
        lg_csv_put(to, o > 0 || !regression ? "," : "", name, true);
    }
    (void)fputc('\n', to);
}

/* Writes a row; without `known` its cells are empty. A row of one such cell has quotes: readers skip blank
 * lines. */
static void put_row(FILE *to, const lg_table_file *file, double *y, bool known) {
    const uint32_t outputs = file->run.model.net.outputs;
    const bool regression = file->run.model.options.task == LG_TABLE_REGRESSION;
    if (known && !regression) {
        lg_table_softmax(y, outputs);
        lg_csv_put(to, "", file->output_name[lg_metrics_class(y, outputs)], false);
    }
    for (uint32_t o = 0; o < outputs; o++) {
        if (o > 0 || !regression) (void)fputc(',', to);
        if (known) (void)fprintf(to, "%.17g", y[o]);
    }
    if (!known && regression && outputs == 1) lg_csv_put(to, "", "", false);
    (void)fputc('\n', to);
}

typedef struct counts {
    size_t outside, incomplete, infinite;
} counts;

static void put_rows(FILE *to, const lg_table_file *file, const lg_model *model, const lg_table_sheet *table,
                     counts *found) {
    APP_FREE void *work = app_alloc(lg_model_work_size(model), 1);
    APP_FREE double *y = app_alloc(lg_model_outputs(model), sizeof *y);
    put_header(to, file);
    for (size_t i = 0; i < table->data.rows; i++) {
        const double *x = lg_table_sheet_row(table, i);
        bool complete = true, finite = false;
        for (uint32_t c = 0; c < table->inputs; c++) complete = complete && !isnan(x[c]);
        if (complete) lg_model_eval(model, x, y, work);
        if (complete) finite = lg_table_are_finite(y, file->run.model.net.outputs);
        found->incomplete += !complete;
        found->infinite += complete && !finite;
        found->outside += complete && lg_table_is_outside(file, x);
        put_row(to, file, y, finite);
    }
}

/* ---- the command ---- */

static void write_rows(const app *self, const lg_table_file *file, const lg_table_sheet *table,
                       counts *found) {
    app_file to = {.stream = stdout};
    lg_model *model;
    APP_MUST_FILE(self, self->arguments[0], lg_table_model(self->context, file, &model, &error));
    if (values.out != NULL) app_file_begin(&to, values.out);
    put_rows(to.stream, file, model, table, found);
    if (values.out != NULL) APP_MUST_FILE(self, values.out, app_file_end(&to, &error));
    lg_model_destroy(model);
}

static void report(const app *self, size_t rows, const counts *found) {
    app_json out;
    app_result_begin(&out, self);
    app_result_text(&out, "out", values.out, NULL);
    app_result_size(&out, "rows", rows, NULL);
    app_result_size(&out, "incomplete", found->incomplete, "rows that lack an input");
    app_result_size(&out, "outside", found->outside, "rows beyond the training range");
    app_json_warnings(&out, self);
    app_json_end(&out);
}

static int run(app *self) {
    const char *model = self->arguments[0], *path = self->arguments[1];
    APP_CLEAN(lg_table_file_destroy) lg_table_file file = {0};
    lg_table_sheet table;
    counts found = {0};
    if (self->json && values.out == NULL)
        app_stop_usage(self, "--json: give --out FILE; without it the predictions go to standard output");
    APP_MUST_FILE(self, model, lg_table_load(self->context, model, NULL, &file, &error));
    const lg_table_names inputs = {file.run.model.net.inputs, file.input_name, NULL}, none = {.count = 0};
    APP_MUST_FILE(self, path, lg_table_sheet_read(self->context, path, &inputs, &none, NULL, &table, &error));
    write_rows(self, &file, &table, &found);
    const size_t rows = table.data.rows;
    lg_table_data_destroy(&table.data);
    if (found.incomplete > 0)
        app_warn(self, "%s: %zu of %zu rows lack an input; their predictions are empty", path,
                 found.incomplete, rows);
    lg_table_warn_outside(self->context, found.outside, rows, path, model);
    const bool failed = lg_table_warn_infinite(self->context, found.infinite, rows, path);
    if (values.out != NULL) report(self, rows, &found);
    return failed ? APP_EXIT_NUMERIC : APP_EXIT_OK;
}

const app_command predict_command = {
    .name = "predict",
    .arguments = "MODEL.h5 TABLE",
    .summary = "Write the outputs of a model for a table",
    .details =
        "One row for each row of TABLE, in order: the outputs, or the class and the probability of each. "
        "Columns are found by their names; the outputs need not be there. The cells of a row that lacks an "
        "input, or whose predictions are not finite, are empty.",
    .settings = APP_SETTINGS(APP_GIVEN(predict_options, values)),
    .run = run};

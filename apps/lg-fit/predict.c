/* lg-fit predict: the outputs of a model for the rows of a table. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-fit/fit.h"
#include "liegrad/metrics.h"

typedef struct predict_values {
    const char *out;
} predict_values;

static const lg_field predict_options[] = {
    LG_OPTION(predict_values, out, STRING, "FILE.csv", "The file to write (default: standard output)"),
    LG_FIELD_END};

static predict_values values;

/* ---- CSV ---- */

/* In quotes where it has to be. */
static void put_text(FILE *to, const char *text) {
    if (strpbrk(text, ",;\t\" #") == NULL) {
        (void)fputs(text, to);
        return;
    }
    (void)fputc('"', to);
    for (; *text != '\0'; text++) {
        if (*text == '"') (void)fputc('"', to);
        (void)fputc(*text, to);
    }
    (void)fputc('"', to);
}

static void put_header(FILE *to, const lg_table_file *file) {
    const bool regression = file->run.model.options.task == LG_TABLE_REGRESSION;
    if (!regression) put_text(to, file->class_column[0] != '\0' ? file->class_column : "class");
    for (uint32_t o = 0; o < file->run.model.net.outputs; o++) {
        char *name = regression ? app_format("%s", file->output_name[o])
                                : app_format("probability_%s", file->output_name[o]);
        if (o > 0 || !regression) (void)fputc(',', to);
        put_text(to, name);
        free(name);
    }
    (void)fputc('\n', to);
}

/* Empty cells where y is not known. */
static void put_row(FILE *to, const lg_table_file *file, double *y, bool known) {
    const uint32_t outputs = file->run.model.net.outputs;
    const bool regression = file->run.model.options.task == LG_TABLE_REGRESSION;
    if (known && !regression) {
        softmax(y, outputs);
        put_text(to, file->output_name[lg_class_of(y, outputs)]);
    }
    for (uint32_t o = 0; o < outputs; o++) {
        if (o > 0 || !regression) (void)fputc(',', to);
        if (known) (void)fprintf(to, "%.17g", y[o]);
    }
    (void)fputc('\n', to);
}

typedef struct counts {
    size_t outside, incomplete, infinite;
} counts;

static void put_rows(FILE *to, const lg_table_file *file, const lg_model *model, const fit_table *table,
                     counts *found) {
    void *work = app_alloc(lg_model_work_size(model), 1);
    double *y = app_alloc(lg_model_outputs(model), sizeof *y);
    put_header(to, file);
    for (size_t i = 0; i < table->data.rows; i++) {
        const double *x = table_row(table, i);
        bool complete = true, finite = false;
        for (uint32_t c = 0; c < table->inputs; c++) complete = complete && !isnan(x[c]);
        if (complete) lg_model_eval(model, x, y, work);
        if (complete) finite = are_finite(y, file->run.model.net.outputs);
        found->incomplete += !complete;
        found->infinite += complete && !finite;
        found->outside += complete && is_outside(file, x);
        put_row(to, file, y, finite);
    }
    free(y);
    free(work);
}

/* ---- running ---- */

/* The exit code. */
static int tell(const app *self, const fit_table *table, const counts *found) {
    if (found->incomplete > 0)
        app_warn(self, "%s: %zu of %zu rows lack an input; their predictions are empty", table->path,
                 found->incomplete, table->data.rows);
    warn_outside(self, found->outside, table->data.rows, table->path, self->arguments[0]);
    return warn_infinite(self, found->infinite, table->data.rows, table->path);
}

static int write_all(const app *self, const lg_table_file *file, const lg_model *model,
                     const fit_table *table) {
    lg_error error = {LG_OK, ""};
    counts found = {0};
    app_json json;
    if (values.out == NULL) {
        put_rows(stdout, file, model, table, &found);
        return tell(self, table, &found);
    }
    app_file to;
    app_file_begin(&to, values.out);
    put_rows(to.stream, file, model, table, &found);
    const lg_status status = app_file_end(&to, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, values.out);
    const int code = tell(self, table, &found);
    if (!self->json) {
        (void)printf("%s: %zu rows\n", values.out, table->data.rows);
        return code;
    }
    app_json_begin(&json);
    app_json_text(&json, "out", values.out);
    app_json_size(&json, "rows", table->data.rows);
    app_json_size(&json, "incomplete", found.incomplete);
    app_json_size(&json, "outside", found.outside);
    app_json_warnings(&json, self);
    app_json_end(&json);
    return code;
}

static int run(app *self) {
    lg_error error = {LG_OK, ""};
    lg_table_file file;
    fit_table table = {.path = NULL};
    lg_model *model = NULL;
    const app_path out = {"out", values.out, LG_FILE_WRITTEN};
    if (self->json && values.out == NULL)
        return app_usage(self, "--json: give --out FILE; without it the predictions go to standard output");
    int code = app_check_outputs(self, &out, 1);
    if (code != APP_EXIT_OK) return code;
    lg_status status = lg_model_load_table(self->context, self->arguments[0], NULL, &file, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    const column_names inputs = {file.run.model.net.inputs, file.input_name}, none = {0, NULL};
    code = read_table(self, self->arguments[1], &inputs, &none, NULL, false, &table);
    if (code == APP_EXIT_OK) {
        status = table_model(self, &file, &model, &error);
        code = status == LG_OK ? write_all(self, &file, model, &table)
                               : app_fail_file(self, status, &error, self->arguments[0]);
    }
    lg_model_destroy(model);
    lg_table_data_destroy(&table.data);
    lg_table_file_destroy(&file);
    return code;
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

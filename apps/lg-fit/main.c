/* lg-fit: regression and classification of tables. */
#include <math.h>
#include <string.h>

#include "common/verbs.h"
#include "files/csv.h"
#include "liegrad/series.h"
#include "nn/search.h"
#include "table/files/recipe.h"

enum { PANELS = 4, POINTS = 5000 };

/* ---- plots and the table of confusion ---- */

static void put_scatter(app_plot *plot, const void *training) {
    const lg_table_state *of = ((const lg_training *)training)->state;
    const lg_table_judgement *j = &of->judged;
    const uint32_t outputs = of->file.run.model.net.outputs, panels = outputs < PANELS ? outputs : PANELS;
    app_plot_text(plot, "%zu", j->rows);
    for (uint32_t o = 0; o < panels; o++)
        app_plot_text(plot, "%s: rmse %.3g, R^2 %.3f", of->file.output_name[o], j->rmse[o], j->r2[o]);
    const size_t every = j->rows / POINTS + 1, step = every * outputs;
    APP_PLOT_COLUMNS(plot, 9, (j->rows + every - 1) / every, {j->truth, step, panels},
                     {j->prediction, step, panels});
}

static void put_confusion(app_plot *plot, const void *training) {
    const lg_table_state *of = ((const lg_training *)training)->state;
    const lg_table_judgement *j = &of->judged;
    APP_FREE char *title = app_format("accuracy %.4f, f1 %.4f on %zu rows", j->accuracy, j->f1, j->rows);
    app_plot_confusion(plot, title, j->confusion, of->file.run.model.net.outputs, of->file.output_name);
}

enum { REGRESSION = 2, CLASSES = 4 };

static unsigned has(const lg_training *training) {
    const lg_table_run *run = training->run;
    return run->model.options.task == LG_TABLE_REGRESSION ? REGRESSION : CLASSES;
}

static const app_plot_kind plots[] = {
    APP_PLOT("loss", "the loss over the epochs", "training", train_put_loss),
    APP_PLOT("scatter", "predicted against true values", "scatter", put_scatter, REGRESSION,
             "the table has classes", REGRESSION),
    APP_PLOT("confusion", "the table of confusion", "confusion", put_confusion, CLASSES,
             "the table has no classes", CLASSES),
    {.name = NULL}};

/* ---- train, evaluate and search ---- */

static lg_table_run run; /* everything that determines the result */
static lg_table_state state;
static const app_settings settings[] = {{lg_table_fields, &run, sizeof run},
                                        APP_GIVEN(lg_table_given_rows, state.given),
                                        TRAIN_SHARED,
                                        APP_SETTINGS_END};
static const app_command train_command;
static train_task task = {
    .recipe = &lg_recipe_table, .settings = settings, .command = &train_command, .state = &state, .has = has};

static const app_command train_command = {
    TRAIN_COMMAND("TABLE", task, plots), .summary = "Fit a network to a table",
    .details =
        "TABLE is a CSV file with a header, an HDF5 file or a numpy array (.npy). Columns are scaled by mean "
        "and deviation of the training rows. Rows with missing cells are left out. A regression is trained "
        "by Levenberg-Marquardt with a weight decay for each array of parameters that the evidence of the "
        "data gives: it needs no validation part, and a network that is too wide does not learn the noise. "
        "A classification is trained by lbfgs, the parameters are those of the best epoch on the validation "
        "part.\n\nWithout --test a tenth of the rows is held out for scoring and not learned; with it a "
        "regression learns all rows.\n\nrmse, r2, accuracy and f1 are those of the validation part or of "
        "--test. --plot draws predicted against true values, or the table of confusion.\n\n" TRAIN_STOPS,
    .settings = settings};

static const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 TABLE",
    VERB(evaluate, task),
    .summary = "Evaluate a model on a table",
    .details =
        "Columns are found by their names, in any order. Rows with missing cells are left out. A row lies "
        "outside the training range if an input exceeds its range by more than a tenth of the range.",
    .plots = plots + 1};

static const app_command search_command = {
    SEARCH_COMMAND("TABLE"), VERB(search, task),
    .settings = APP_SETTINGS(APP_GIVEN(lg_table_column_rows, state.given), SEARCH_SHARED)};

/* ---- predict ---- */

static const lg_field predict_options[] = {
    APP_OUT(app_common, "FILE.csv", "The file to write (default: standard output)", .file = LG_FILE_TEXT),
    LG_FIELD_END};

typedef struct counts {
    size_t outside, incomplete, infinite;
} counts;

/* Writes a row for each row of the table; its cells are empty if the prediction is not known. A column name
 * has at most LG_TABLE_NAME - 1 bytes. If "probability_CLASS" is longer for any class, all columns are named
 * by the number of the class instead. */
static void put_rows(lg_columns *to, const lg_table_file *file, const lg_model *model,
                     const lg_table_sheet *table, counts *found) {
    static const char before[] = "probability_";
    const bool regression = file->run.model.options.task == LG_TABLE_REGRESSION;
    const uint32_t outputs = file->run.model.net.outputs;
    bool fits = true;
    APP_FREE void *work = app_alloc(lg_model_work_size(model), 1);
    APP_FREE double *y = app_alloc(lg_model_outputs(model), sizeof *y);
    for (uint32_t o = 0; o < outputs; o++)
        fits = fits && strlen(before) + strlen(file->output_name[o]) < LG_TABLE_NAME;
    if (!regression) lg_columns_name(to, file->class_column[0] != '\0' ? file->class_column : "class");
    for (uint32_t o = 0; o < outputs; o++) {
        APP_FREE char *name = regression ? app_format("%s", file->output_name[o])
                              : fits     ? app_format("%s%s", before, file->output_name[o])
                                         : app_format("%s%u", before, o);
        lg_columns_name(to, name);
    }
    lg_columns_end(to);
    for (size_t i = 0; i < table->data.rows; i++) {
        const double *x = lg_table_sheet_row(table, i);
        bool complete = true, finite = false;
        for (uint32_t c = 0; c < table->inputs; c++) complete = complete && !isnan(x[c]);
        if (complete) lg_model_eval(model, x, y, work);
        if (complete) finite = lg_table_are_finite(y, outputs);
        found->incomplete += !complete;
        found->infinite += complete && !finite;
        found->outside += complete && lg_table_is_outside(file, x);
        if (finite && !regression) lg_table_softmax(y, outputs);
        if (finite && !regression)
            lg_columns_text(to, file->output_name[lg_metrics_class(y, outputs)]);
        else if (!regression)
            lg_columns_empty(to);
        for (uint32_t o = 0; o < outputs; o++) lg_columns_number(to, finite ? y[o] : (double)NAN);
        lg_columns_end(to);
    }
}

static void write_rows(const app *self, const lg_table_file *file, const lg_table_sheet *table,
                       counts *found) {
    lg_columns to = {.text = app_text()};
    lg_model *model;
    APP_MUST_FILE(self, self->arguments[0], lg_table_model(self->context, file, &model, &error));
    put_rows(&to, file, model, table, found);
    if (app_common_given.out == NULL)
        (void)fwrite(to.text.data, 1, to.text.length, stdout);
    else
        APP_MUST_FILE(self, app_common_given.out,
                      lg_columns_write(&to, self->context, app_common_given.out, &error));
    lg_text_destroy(&to.text);
    lg_model_destroy(model);
}

static void run_predict(app *self) {
    const char *model = self->arguments[0], *path = self->arguments[1];
    lg_table_file file;
    lg_table_sheet table;
    counts found = {0};
    if (self->json && app_common_given.out == NULL)
        app_stop_usage(self, "--json: give --out FILE; without it the predictions go to standard output");
    APP_FILE(self, model, lg_recipe_load, NULL, &lg_recipe_table, &file);
    const lg_table_names inputs = {file.run.model.net.inputs, file.input_name, NULL}, none = {.count = 0};
    APP_FILE(self, path, lg_table_sheet_read, &inputs, &none, NULL, &table);
    write_rows(self, &file, &table, &found);
    const size_t rows = table.data.rows;
    lg_table_data_destroy(&table.data);
    if (found.incomplete > 0)
        app_warn(self, "%s: %zu of %zu rows lack an input; their predictions are empty", path,
                 found.incomplete, rows);
    lg_table_warn_outside(self->context, found.outside, rows, path, model);
    const bool failed = lg_table_warn_infinite(self->context, found.infinite, rows, path);
    if (app_common_given.out != NULL)
        APP_PUT(self->out, LG_TEXT("out", app_common_given.out, NULL), LG_WHOLE("rows", rows, NULL),
                LG_WHOLE("incomplete", found.incomplete, "rows that lack an input"),
                LG_WHOLE("outside", found.outside, "rows beyond the training range"));
    if (failed) self->code = APP_EXIT_NUMERIC;
    lg_recipe_release(&lg_recipe_table, &file);
}

static const app_command predict_command = {
    .name = "predict",
    .arguments = "MODEL.h5 TABLE",
    .summary = "Write the outputs of a model for a table",
    .details =
        "One row for each row of TABLE, in order: the outputs, or the class and the probability of each. "
        "Columns are found by their names; the outputs need not be there. The cells of a row that lacks an "
        "input, or whose predictions are not finite, are empty.",
    .settings = APP_SETTINGS(APP_GIVEN(predict_options, app_common_given)),
    .run = run_predict};

APP_PROGRAM(lg_fit) {
    const app_command commands[] = {
        train_command, evaluate_command, predict_command, search_command, {.run = NULL}};
    return app_main(
        argc, argv, "lg-fit",
        "Networks that learn a table: regression of its columns, or the class of a row. Tables are CSV, "
        "HDF5 or numpy files; columns have names.",
        commands);
}

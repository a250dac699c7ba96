/* lg-fit: regression and classification of tables. */
#include <string.h>

#include "lg-fit/fit.h"

enum { PANELS = 4, POINTS = 5000 };
#define DRAWN "Draw predicted against true values, or the table of confusion"

/* ---- the plot and the table ---- */

static void put_scatter(app_plot *plot, const char *path, const lg_table_state *of) {
    const lg_table_judgement *j = &of->judged;
    const uint32_t outputs = of->file.run.model.net.outputs, panels = outputs < PANELS ? outputs : PANELS;
    app_plot_begin(plot, "scatter", path);
    app_plot_text(plot, "%zu", j->rows);
    for (uint32_t o = 0; o < panels; o++)
        app_plot_text(plot, "%s: rmse %.3g, R^2 %.3f", of->file.output_name[o], j->rmse[o], j->r2[o]);
    for (size_t i = 0; i < j->rows; i += j->rows / POINTS + 1) {
        double row[2 * PANELS];
        memcpy(row, j->truth + i * outputs, panels * sizeof *row);
        memcpy(row + panels, j->prediction + i * outputs, panels * sizeof *row);
        app_plot_numbers(plot, 9, row, 2 * (size_t)panels);
    }
}

static void draw(const app *self, const char *path, const lg_training *training) {
    const lg_table_state *of = training->state;
    const lg_table_judgement *j = &of->judged;
    APP_FREE char *title = app_format("accuracy %.4f, f1 %.4f on %zu rows", j->accuracy, j->f1, j->rows);
    app_plot plot;
    if (j->truth != NULL)
        put_scatter(&plot, path, of);
    else
        app_plot_confusion(&plot, path, title, j->confusion, of->file.run.model.net.outputs,
                           of->file.output_name);
    app_plot_end(self, &plot);
}

static void print(const lg_training *training) {
    lg_table_state *of = training->state;
    if (of->judged.truth == NULL)
        app_print_confusion(stdout, of->judged.confusion, of->file.run.model.net.outputs,
                            of->file.output_name);
}

/* ---- the commands ---- */

static const lg_field train_options[] = {TRAIN_SIZE_ROW, TRAIN_FILE_ROWS(DRAWN), LG_FIELD_END};
static const lg_field evaluate_options[] = {
    LG_OPTION(train_files, plot, STRING, "FILE.svg|.png",
              DRAWN "; its data and script stay next to it, as FILE.dat and FILE.gp", .file = LG_FILE_DRAWN),
    LG_FIELD_END};

static lg_table_run run; /* everything that determines the result */
static lg_table_state state;
static const app_settings settings[] = {{lg_table_fields, &run, sizeof run},
                                        APP_GIVEN(lg_table_given_rows, state.given),
                                        APP_GIVEN(train_options, train_given_files),
                                        APP_SETTINGS_END};
static const app_command train_command;
static train_task task = {.recipe = &lg_recipe_table,
                          .settings = settings,
                          .command = &train_command,
                          .state = &state,
                          .print = print,
                          .draw = draw};

static const app_command train_command = {
    TRAIN_COMMAND("TABLE", task), .summary = "Fit a network to a table",
    .details =
        "TABLE is a CSV file with a header, an HDF5 file or a numpy array (.npy). Columns are scaled by mean "
        "and deviation of the training rows. Rows with missing cells are left out. A regression is trained "
        "by Levenberg-Marquardt with a weight decay for each array of parameters that the evidence of the "
        "data gives: it needs no validation part, and a network that is too wide does not learn the noise. "
        "A classification is trained by lbfgs, the parameters are those of the best epoch on the validation "
        "part.\n\nWithout --test a tenth of the rows is held out for scoring and not learned; with it a "
        "regression learns all rows.\n\nrmse, r2, accuracy and f1 are those of the validation part or of "
        "--test. --plot draws predicted against true values, or the table of confusion.\n\nCtrl-C saves a "
        "checkpoint and ends with exit code 130; --resume continues to the same bits.",
    .settings = settings};

static const app_command evaluate_command = {
    .name = "evaluate",
    .arguments = "MODEL.h5 TABLE",
    VERB(evaluate, task),
    .summary = "Evaluate a model on a table",
    .details =
        "Columns are found by their names, in any order. Rows with missing cells are left out. A row lies "
        "outside the training range if an input exceeds its range by more than a tenth of the range.",
    .settings = APP_SETTINGS(APP_GIVEN(evaluate_options, train_given_files))};

static const app_command search_command = {
    SEARCH_COMMAND("TABLE"), VERB(search, task),
    .settings = APP_SETTINGS(APP_GIVEN(lg_table_column_rows, state.given), SEARCH_SHARED)};

int main(int argc, char **argv) {
    const app_command commands[] = {
        train_command, evaluate_command, predict_command, search_command, {.run = NULL}};
    return app_main(
        argc, argv, "lg-fit",
        "Networks that learn a table: regression of its columns, or the class of a row. Tables are CSV, "
        "HDF5 or numpy files; columns have names.",
        commands);
}

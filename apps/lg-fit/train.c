/* lg-fit train: fits a network to a table; lg-fit search: random search over the options of train. */
#include "lg-fit/fit.h"

static const lg_field file_options[] = {
    TRAIN_SIZE_ROW, TRAIN_FILE_ROWS("Draw predicted against true values, or the table of confusion"),
    LG_FIELD_END};

static lg_table_run run; /* everything that determines the result */
static lg_table_state state;
static const app_settings settings[] = {{lg_table_fields, &run, sizeof run},
                                        APP_GIVEN(lg_table_given_rows, state.given),
                                        APP_GIVEN(file_options, train_given_files),
                                        APP_SETTINGS_END};

static void print(const lg_training *training) {
    const lg_table_file *file = &state.file;
    const size_t rows = state.table.data.rows;
    app_put(stdout, "%s: %s of %zu of %zu rows, %u inputs, %s network, %zu parameters\n",
            train_given_files.out, lg_table_task_name(file->run.model.options.task), state.trained, rows,
            state.inputs.count, lg_net_kind_name(file->run.model.options.network), file->parameters);
    if (state.evidence.evaluations > 0)
        app_put(stdout, "the data determine %.1f parameters; noise about %.3g of the outputs' deviation\n",
                state.evidence.effective, lg_result_find(training, "noise")->real);
    app_put(stdout, "%s rows (%zu%s):\n", state.part, state.judged.rows,
            state.given.test == NULL && state.trained < rows ? ", not learned" : "");
    judgement_print(&state);
}

static void draw(const app *self, const char *path, const lg_training *training) {
    (void)training;
    draw_judgement(self, path, &state);
}

static train_task recipe = {
    .recipe = &lg_recipe_table, .settings = settings, .state = &state, .print = print, .draw = draw};

static int run_train(app *self) {
    return train_main(self, &recipe);
}

static int run_search(app *self) {
    return search_main(self, &train_command, &recipe);
}

const app_command train_command = {
    .name = "train",
    .arguments = "TABLE",
    .summary = "Fit a network to a table",
    .details =
        "TABLE is a CSV file with a header, an HDF5 file or a numpy array (.npy). Columns are scaled by mean "
        "and deviation of the training rows. Rows with missing cells are left out. A regression is trained "
        "by "
        "Levenberg-Marquardt with a weight decay for each array of parameters that the evidence of the data "
        "gives: it needs no validation part, and a network that is too wide does not learn the noise. A "
        "classification is trained by lbfgs, the parameters are those of the best epoch on the validation "
        "part.\n\nWithout --test a tenth of the rows is held out for judging and not learned; with it a "
        "regression learns all rows.\n\nrmse, r2, accuracy and f1 are those of the validation part or of "
        "--test. --plot draws "
        "predicted against true values, or the table of confusion.\n\nCtrl-C saves a checkpoint and ends "
        "with "
        "exit code 130; --resume continues to the same bits.",
    .settings = settings,
    .run = run_train,
    .together = APP_RANKS};

const app_command search_command = {
    SEARCH_COMMAND("TABLE"),
    .settings = APP_SETTINGS(APP_GIVEN(lg_table_column_rows, state.given), SEARCH_SHARED), .run = run_search};

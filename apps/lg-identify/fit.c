/* lg-identify fit: learns the machine. */
#include "common/train.h"
#include "lg-identify/identify.h"

static lg_machine_state state;
static lg_machine_model_run run; /* Everything that determines the result. */

static const lg_field options[] = {
    LG_OPTION(lg_machine_state, validation, STRING, "LOG,LOG,...",
              "Logs that are not trained on: the parameters of the best epoch on them are the result"),
    LG_FIELD_END};
static const app_settings settings[] = {{lg_machine_model_fields, &run, sizeof run},
                                        APP_GIVEN(options, state),
                                        TRAIN_SHARED_NO_SIZE,
                                        APP_SETTINGS_END};

static void show_identified(const lg_machine_verdict *what) {
    app_table table = {0};
    if (what->count == 0) return;
    if (what->placed) (void)printf("mass: of a network, %s\n", what->place);
    app_table_row(&table, "identified\tvalue\tstandard error");
    for (size_t i = 0; i < what->count; i++) {
        const lg_identified *number = &what->identified.numbers[i];
        app_table_row(&table, "%s\t%.6g\t%.2g", number->name, number->value, number->error);
    }
    app_table_end(&table, stdout);
    if (what->identified.block > 0.0)
        (void)printf("errors are corrected for correlation: blocks of %.3g s of the residuals\n",
                     what->identified.block);
}

static void print(const lg_training *training) {
    const lg_machine_verdict *what = &state.verdict;
    (void)training;
    (void)printf("%s: %zu parameters, %llu windows, %llu evaluations, loss %.3e (noise and steps leave "
                 "%.1e at most), floor of the steps %.1e, %.1f s\n",
                 train_given_files.out, run.machine.parameters, (unsigned long long)run.windows,
                 (unsigned long long)lg_fit_epochs_done(training->fit), what->loss, what->expected,
                 training->floor, training->seconds);
    show_identified(what);
}

static train_task recipe = {
    .recipe = &lg_recipe_machine_model, .settings = settings, .state = &state, .print = print};

static int run_fit(app *self) {
    return train_main(self, &recipe);
}

const app_command fit_command = {
    .name = "fit",
    .arguments = "MACHINE.yaml LOG...",
    .summary = "Learn the machine from logs",
    .details =
        "Windows of --window rows are predicted from their first row. The loss is the mean over windows and "
        "rows of squared errors in units of the noise; without noise, of the velocities' root mean squares "
        "and of half the way in a window. Short windows are fitted first.\n\nMethod, epochs, prior, window, "
        "stride, starts and substeps that are not given are chosen by the logs and the machine, whatever the "
        "defaults above: docs/machines.md has the table, --json the values of a run.",
    .settings = settings,
    .run = run_fit,
    .together = APP_RANKS};

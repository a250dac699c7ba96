/* lg-identify: learns a forced, damped machine from its logs. */
#include "common/train.h"
#include "lg-identify/identify.h"

#include <string.h>

/* ---- fit ---- */

static lg_machine_state state;
static lg_machine_model_run run; /* Everything that determines the result. */

static const lg_field options[] = {
    LG_OPTION(lg_machine_state, validation, STRING, "LOG,LOG,...",
              "Logs that are not trained on: the parameters of the best epoch on them are the result",
              .option = "validation-logs", .usual = true, .file = LG_FILE_READ),
    LG_OPTION(lg_machine_state, suggest, STRING, "FILE.yaml|-",
              "Find out which terms the logs ask for, write the machine's file with them (-: print it), and "
              "learn this machine",
              .usual = true, .file = LG_FILE_TEXT),
    LG_OPTION(lg_machine_state, select, NAME, NULL,
              "What chooses the best epoch: the loss of the windows, or free runs over windows that are held "
              "out (--validation-fraction of the rows, default 0.2)",
              LG_NAMES("loss", "free-run"), .usual = true),
    TRAIN_SIZE(
        lg_machine_state,
        "Widths of all networks, as hidden in the machine's file; or auto: learn a few widths, and take "
        "the smallest whose free runs over held-out windows none beats"),
    LG_FIELD_END};
static const app_settings settings[] = {{lg_machine_model_fields, &run, sizeof run},
                                        APP_GIVEN(options, state),
                                        TRAIN_SHARED_NO_SIZE,
                                        APP_SETTINGS_END};

static void print(const lg_training *training) {
    const lg_machine_verdict *what = &state.verdict;
    if (what->count > 0 && what->placed) app_put(stdout, "mass: of a network, %s\n", what->place);
    if (what->count > 0 && what->identified.block > 0.0)
        app_put(stdout, "errors are corrected for correlation: blocks of %.3g s of the residuals\n",
                what->identified.block);
    if (state.suggest == NULL) return;
    app_put(stdout, "free runs of %.3g s over %zu windows that were not trained on\n",
            state.suggestion.seconds, state.suggestion.windows);
    if (strcmp(state.suggest, "-") == 0) (void)fputs(state.data.file.text, stdout);
}

static train_task recipe = {
    .recipe = &lg_recipe_machine_model, .settings = settings, .state = &state, .print = print};

static void run_fit(app *self) {
    if (state.suggest != NULL && strcmp(state.suggest, "-") != 0)
        app_check_text(self, state.suggest, LG_SUGGEST_HEAD);
    train_main(self, &recipe);
}

static const app_command fit_command = {
    .name = "fit",
    .arguments = "MACHINE.yaml LOG...",
    .summary = "Learn the machine from logs",
    .details =
        "Windows of --window rows are predicted from their first row. The loss is the mean over windows and "
        "rows of squared errors in units of the noise; without noise, of the velocities' root mean squares "
        "and of half the way in a window. Short windows are fitted first.\n\ndocs/machines.md says how "
        "data and model choose options that are not given; --json prints the values of a run.",
    .settings = settings,
    .plots = train_plots,
    .run = run_fit,
    .together = APP_RANKS};

/* ---- demo ---- */

static const lg_field demo_options[] = {
    APP_OUT(app_common, "DIR", "Folder for files and plots", .value = "liegrad-machine"),
    APP_BOUND(app_common, "Time for the fit", .value = "20"),
    APP_DEMO_EPOCHS("Evaluations of the loss, if the time allows (default 300)"), LG_FIELD_END};

static const app_command demo_command = {
    APP_DEMO(demo_options, lg_identify_demo),
    .summary = "A driven, damped rigid body from its log to a controller",
    .details =
        "Makes a log of a body whose masses, damping and potential are known, learns them from it, and "
        "controls the true body with the learned one. Every command is shown before it runs."};

APP_PROGRAM(lg_identify) {
    const app_command commands[] = {identify_check_command,
                                    fit_command,
                                    identify_evaluate_command,
                                    identify_predict_command,
                                    identify_adapt_command,
                                    identify_generate_command,
                                    demo_command,
                                    {.run = NULL}};
    return app_main(argc, argv, "lg-identify",
                    "Learns forced, damped mechanical systems from logs. MACHINE.yaml says what the columns "
                    "are, what is known and what is to be learned; docs/machines.md is the guide.",
                    commands);
}

/* lg-elastica train: fits a surrogate to curves; lg-elastica search: random search over the options of
 * train. */
#include "common/search.h"
#include "lg-elastica/beam.h"

static lg_surrogate_run run; /* everything that determines the result */

static const app_settings settings[] = {
    {lg_surrogate_fields, &run, sizeof run}, TRAIN_PRESET, TRAIN_SHARED, APP_SETTINGS_END};

static double real(const lg_training *training, const char *name) {
    return lg_result_find(training, name)->real;
}

static uint64_t whole(const lg_training *training, const char *name) {
    return lg_result_find(training, name)->whole;
}

static void print(const lg_training *training) {
    const lg_surrogate_options *options = &run.model.options;
    const char *preset = lg_result_find(training, "preset")->text;
    app_put(stdout, "%s: %s network, %s %u x %u, %zu parameters", train_given_files.out,
            lg_surrogate_kind_name(options->kind), lg_net_kind_name(options->architecture), options->hidden,
            options->layers, lg_surrogate_parameters(&run.model));
    if (preset != NULL) app_put(stdout, " (preset %s: %s)", preset, lg_result_find(training, "source")->text);
    app_put(stdout,
            "\n%llu epochs (%.4f s each, %.1f s in all); mean squared error %.4e on %llu curves trained "
            "on",
            (unsigned long long)lg_fit_epochs_done(training->fit), lg_fit_seconds_per_epoch(training->fit),
            training->seconds, real(training, "train_mse"),
            (unsigned long long)whole(training, "train_curves"));
    if (whole(training, "test_curves") > 0)
        app_put(stdout, ", %.4e on %llu test curves", real(training, "test_mse"),
                (unsigned long long)whole(training, "test_curves"));
    app_put(stdout, "\n");
}

static train_task recipe = {.recipe = &lg_recipe_surrogate, .settings = settings, .print = print};

static int run_train(app *self) {
    return train_main(self, &recipe);
}

static int run_search(app *self) {
    return search_main(self, &train_command, &recipe);
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Fit a network to curves",
    .details =
        "train_mse and test_mse are mean squared errors over the curves of each part, nodes and "
        "components, in double precision (discrete: the 4(N - 1) inner ones); `loss` is the last "
        "epoch's mean over its batches, with its penalty. `truncation` is what --modes leaves out: the "
        "mean squared error of the trained curves' best approximation by so many modes.\n\nCtrl-C saves a "
        "checkpoint and ends with "
        "exit code 130; --resume continues to the same bits.",
    .settings = settings,
    .run = run_train,
    .together = APP_RANKS};

const app_command search_command = {SEARCH_COMMAND("DATA.h5"), .settings = APP_SETTINGS(SEARCH_SHARED),
                                    .run = run_search};

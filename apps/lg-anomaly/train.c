/* lg-anomaly train: trains a model on labelled series and writes its file. lg-anomaly search: over options of
 * cnn or rocket. */
#include <math.h>
#include <string.h>

#include "common/verbs.h"
#include "lg-anomaly/train.h"
#include "nn/search.h"

/* Default window and hop of the baseline, in seconds. */
static const double baseline_window = 600, baseline_hop = 60;
/* If the rate is unknown, the baseline's window has so many stored windows, and its hop is one. */
enum { BASELINE_STORED = 10 };

well_model trained_model(well_sort sort, const char *method) {
    return (well_model){.sort = sort,
                        .window = (uint32_t)train_run.window,
                        .healthy = train_state.healthy,
                        .method = method,
                        .file = {.names = train_state.all.data.series, .run = train_run}};
}

/* ---- the network ---- */

static unsigned has(const lg_training *training) {
    const well_model shape = trained_model(WELL_NETWORK, "cnn");
    return plots_of(&shape, true);
}

/* The model has no plan, because plots do not need one. */
static void draw(const app *self, const lg_training *training) {
    APP_FREE double *theta = app_alloc(training->problem.parameters, sizeof *theta);
    well_model model = trained_model(WELL_NETWORK, "cnn");
    lg_fit_parameters(training->fit, theta);
    model.network.theta = theta;
    const viewing view = {&model, lg_detector_tested(&train_state), &train_state.judged,
                          .training = training};
    app_plot_draw(self, plots_of(&model, true), &view);
}

static const char *const searched[] = {"cnn", "rocket", NULL};
train_task network_recipe = {.recipe = &lg_recipe_detector,
                             .settings = train_settings,
                             .command = &anomaly_train_command,
                             .searched = searched,
                             .check = train_check_options,
                             .trial = train_trial,
                             .state = &train_state,
                             .has = has,
                             .draw = draw};

/* ---- the classical methods ---- */

static void run_classical(const app *self) {
    lg_training *training = &network_recipe.training;
    const lg_series_data *data = &train_state.all.data;
    const bool alone = train_given.method == METHOD_NOVELTY;
    if (train_state.test != NULL) train_run.test_fraction = 0;
    train_run.validation_fraction = 0;
    train_run.training.seed = self->seed;
    train_run.window = data->series.length;
    memcpy(train_run.data_sha256, data->sha256, sizeof data->sha256);
    APP_MUST(self, lg_detector_settle(training, &error));
    if (alone) { /* all other classes become one */
        const well_model model = trained_model(WELL_CLASSICAL, "novelty");
        well_model_need_healthy(self, &model, "--classifier novelty");
        merge_classes(self, self->arguments[0], &train_state.all.data, train_run.healthy);
        if (train_state.test != NULL)
            merge_classes(self, train_state.test, &train_state.foreign.data, train_run.healthy);
        train_state.healthy = 0;
    }
    if (data->series.classes < 2 && !alone)
        app_stop(self, LG_INVALID_ARGUMENT, "all windows are of one class, '%s'", data->series.class_name[0]);
    /* If the data are no recordings, a window is a stored window. */
    const bool cut = train_given.method == METHOD_BASELINE && data->series.run != NULL;
    const double rate = data->series.rate;
    if (cut && rate > 0) {
        train_run.window = (uint64_t)fmax(floor(baseline_window * rate + 0.5), 1);
        train_run.hop = (uint64_t)fmax(floor(baseline_hop * rate + 0.5), 1);
    } else if (cut) {
        train_run.window = (uint64_t)BASELINE_STORED * data->series.length;
        train_run.hop = data->series.length;
    }
    APP_MUST(self, lg_detector_window(training, &train_run.window, &train_run.hop, &error));
    APP_MUST(self, lg_detector_split(training, &error));
    train_classical(self);
}

/* ---- the command ---- */

static void run_train(app *self) {
    if (train_given.method == METHOD_CNN) {
        train_main(self, &network_recipe);
        return;
    }
    if (self->rank_count > 1) app_stop_usage(self, "only --classifier cnn can be trained by several ranks");
    train_state.any_class = train_given.method == METHOD_NOVELTY; /* all other classes count as one */
    train_open(self, &network_recipe);
    run_classical(self);
    lg_training_close(&network_recipe.training);
}

const app_command anomaly_train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Train a detector on labelled windows",
    .details =
        "DATA.h5 holds /X (n, channels, samples) and /y (n), any number of classes; /group, /run and the "
        "attributes rate, classes and channels if they are known (docs/detectors.md).\n\nScaling, components "
        "and grids are fitted on the training part only. Metrics are those of the test part: precision, "
        "recall and F1 for two classes those of the class that is not healthy, otherwise their mean over the "
        "classes. false_alarms_per_day is the number of windows per day that would be given another class if "
        "all were of the healthy one (--healthy).\n\nCtrl-C saves a checkpoint (cnn) and ends with exit code "
        "130; --resume continues to the same bits.",
    .settings = train_settings,
    .plots = anomaly_plots,
    .run = run_train,
    .together = APP_RANKS};

const app_command anomaly_search_command = {
    .name = "search",
    .arguments = "RANGES.yaml DATA.h5",
    .summary = "Search over the options of train --classifier cnn or rocket",
    .details = "The objective is the network's loss on the held-out part at its best epoch; with "
               "`classifier: rocket` "
               "it is the fraction of the held-out windows that get a wrong class.\n\n" SEARCH_DETAILS
               " The search never uses the test part (fixed: test-fraction, split): train the best trial to "
               "evaluate it.",
    .settings = APP_SETTINGS(SEARCH_SHARED),
    .plots = search_plots,
    VERB(search, network_recipe),
    .together = APP_RANKS};

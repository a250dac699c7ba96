/* lg-anomaly train: trains a model on labelled series and writes its file. lg-anomaly search: over options of
 * cnn or rocket. */
#include <limits.h>

#include "common/verbs.h"
#include "lg-anomaly/train.h"
#include "nn/search.h"

well_model trained_model(well_sort sort, const char *method) {
    return (well_model){.sort = sort,
                        .window = (uint32_t)train_run.window,
                        .healthy = train_state.healthy,
                        .method = method,
                        .file = {.names = train_state.all.data.series, .run = train_run}};
}

/* ---- the network ---- */

/* The plots of a classical model depend on what it learns, and are checked after its training. */
static unsigned has(const lg_training *training) {
    const well_model shape = trained_model(WELL_NETWORK, "cnn");
    return train_given.method == METHOD_CNN ? plots_of(&shape, true) : UINT_MAX;
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
                             .learn = train_classical,
                             .state = &train_state,
                             .has = has,
                             .draw = draw};

/* ---- the commands ---- */

const app_command anomaly_train_command = {
    TRAIN_COMMAND("DATA.h5", network_recipe, anomaly_plots),
    .summary = "Train a detector on labelled windows",
    .details =
        "DATA.h5 holds /X (n, channels, samples) and /y (n), any number of classes; /group, /run and the "
        "attributes rate, classes and channels if they are known (docs/detectors.md).\n\nScaling, components "
        "and grids are fitted on the training part only. Metrics are those of the test part: precision, "
        "recall and F1 for two classes those of the class that is not healthy, otherwise their mean over the "
        "classes. false_alarms_per_day is the number of windows per day that would be given another class if "
        "all were of the healthy one (--healthy).\n\nCtrl-C saves a checkpoint (cnn) and ends with exit code "
        "130; --resume continues to the same bits.",
    .settings = train_settings};

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

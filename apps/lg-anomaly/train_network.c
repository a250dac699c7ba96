/* lg-anomaly train --classifier cnn, and lg-anomaly search, a search over options of cnn or rocket. */
#include "common/verbs.h"
#include "lg-anomaly/train.h"
#include "nn/search.h"

/* Returns the network as a model. `theta` are its parameters; there is no plan, because plots do not need
 * one. */
static well_model model_of(double *theta) {
    well_model out = trained_model(WELL_NETWORK, "cnn");
    out.network.theta = theta;
    return out;
}

static unsigned has(const lg_training *training) {
    const well_model shape = model_of(NULL);
    return plots_of(&shape, true);
}

static void draw(const app *self, const lg_training *training) {
    APP_FREE double *theta = app_alloc(training->problem.parameters, sizeof *theta);
    lg_fit_parameters(training->fit, theta);
    const well_model model = model_of(theta);
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

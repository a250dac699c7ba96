/* lg-anomaly train --method cnn, and lg-anomaly search, a random search over options of cnn or rocket. */
#include <math.h>

#include "lg-anomaly/train.h"

/* Returns the network as a model. `theta` are its parameters; there is no plan, because plots do not need
 * one. */
static well_model model_of(double *theta) {
    well_model out = trained_model(WELL_NETWORK, "cnn");
    out.detector = (lg_detector_file){.run = train_run, .theta = theta};
    return out;
}

static void check(const app *self, const lg_training *training) {
    const well_model shape = model_of(NULL);
    (void)training;
    check_plot(self, &shape);
}

static void print(const lg_training *training) {
    const lg_judgement *judged = &train_state.judged;
    const well_model model = model_of(NULL);
    (void)training;
    app_print_confusion(stdout, judged->confusion, judged->classes, model.class_name);
}

static void draw(const app *self, const char *path, const lg_training *training) {
    const lg_fit *fit = training->fit;
    APP_FREE double *theta = app_alloc(training->problem.parameters, sizeof *theta);
    lg_fit_parameters(fit, theta);
    const well_model model = model_of(theta);
    const int view = view_of(&model, train_given.plot_kind, true);
    if (view == VIEW_LOSS)
        train_draw_loss(self, path, fit, train_state.validation.count > 0);
    else
        draw_tested(self, view, &model, &train_state.judged);
}

static const char *const searched[] = {"cnn", "rocket", NULL};
train_task network_recipe = {.recipe = &lg_recipe_detector,
                             .settings = train_settings,
                             .searched = searched,
                             .trial = train_trial,
                             .state = &train_state,
                             .check = check,
                             .print = print,
                             .draw = draw};

static int search(app *self) {
    return search_main(self, &train_command, &network_recipe);
}

const app_command search_command = {
    .name = "search",
    .arguments = "RANGES.yaml DATA.h5",
    .summary = "Random search over the options of train --method cnn or rocket",
    .details =
        "The objective is the network's loss on the held-out part at its best epoch; with `method: rocket` "
        "it is the fraction of the held-out windows that get a wrong class.\n\n" SEARCH_DETAILS
        " The search never uses the test part (fixed: test-fraction, split): train the best trial to "
        "evaluate it.",
    .settings = APP_SETTINGS(SEARCH_SHARED),
    .run = search,
    .together = APP_RANKS};

/* lg-elastica: computes equilibria of a clamped beam, and trains networks that compute them. */
#include "common/verbs.h"
#include "lg-elastica/beam.h"
#include "nn/search.h"

static lg_surrogate_run run; /* everything that determines the result */

static const app_settings settings[] = {
    {lg_surrogate_fields, &run, sizeof run}, TRAIN_PRESET, TRAIN_SHARED, APP_SETTINGS_END};

static const app_command train_command;
static train_task task = {.recipe = &lg_recipe_surrogate, .settings = settings, .command = &train_command};

static const app_command train_command = {
    TRAIN_COMMAND("DATA.h5", task, train_plots), .summary = "Fit a network to curves",
    .details =
        "train_mse and test_mse are mean squared errors over the curves of each part, nodes and "
        "components, in double precision (discrete: the 4(N - 1) inner ones); `loss` is the last "
        "epoch's mean over its batches, with its penalty. `truncation` is what --modes leaves out: the "
        "mean squared error of the trained curves' best approximation by so many modes.\n\n" TRAIN_STOPS,
    .settings = settings};

static const app_command search_command = {SEARCH_COMMAND("DATA.h5"), VERB(search, task),
                                           .settings = APP_SETTINGS(SEARCH_SHARED)};

APP_PROGRAM(lg_elastica) {
    app_command commands[7] = {elastica_solve_command,
                               elastica_generate_command,
                               train_command,
                               elastica_evaluate_command,
                               elastica_predict_command,
                               search_command,
                               {.run = NULL}};
    return app_main(
        argc, argv, "lg-elastica",
        "Euler's elastica: equilibria of a planar inextensible beam clamped at both ends, data sets of "
        "equilibria, and networks that compute the curve from the boundary conditions.",
        commands);
}

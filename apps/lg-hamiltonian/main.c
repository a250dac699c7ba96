/* lg-hamiltonian: learns the Hamiltonian of a mechanical system from trajectories. */
#include "common/verbs.h"
#include "hamiltonian/files/recipe.h"
#include "lg-hamiltonian/training.h"
#include "nn/search.h"

static lg_hamiltonian_state state;
static lg_hamiltonian_run run; /* everything that determines the result */

static const app_settings settings[] = {{lg_hamiltonian_fields, &run, sizeof run},
                                        TRAIN_PRESET,
                                        APP_GIVEN(lg_hamiltonian_options, state),
                                        TRAIN_SHARED,
                                        APP_SETTINGS_END};

static const app_command train_command;
static train_task task = {
    .recipe = &lg_recipe_hamiltonian, .settings = settings, .command = &train_command, .state = &state};

static const app_command train_command = {
    TRAIN_COMMAND("DATA.h5", task, train_plots), .summary = "Fit a Hamiltonian to trajectories",
    .details =
        "Loss: the mean squared difference over trajectories, coordinates and points (the first excluded; "
        "with --initial-states estimated it counts too) between the data and the integrator's prediction "
        "with the "
        "learned Hamiltonian; with --penalty, plus the penalty. The `loss` reported is this mean squared "
        "error (no penalty) over all trajectories of the file, in double precision, at the parameters that "
        "are written; `running_loss` is the last epoch's mean over its batches. `floor` is the part of this "
        "error that the integrator's steps make, estimated by steps of half the size.\n\nIf an option of "
        "Adam is given, the defaults are those of --preset thesis, else of --preset best. --preset thesis "
        "has the published settings but for Adam's eps and bound on the gradient (published: --adam-eps 1e-8 "
        "--clip 0). docs/reports/accuracy.md has the table of both; --json prints the values of a "
        "run.\n\n" TRAIN_STOPS,
    .settings = settings};

static const app_command search_command = {SEARCH_COMMAND("DATA.h5"), VERB(search, task),
                                           .settings = APP_SETTINGS(SEARCH_SHARED)};

static const lg_field demo_options[] = {
    APP_OUT(app_common, "DIR", "Folder for data, model and plots", .value = "liegrad-demo"),
    APP_DEMO_EPOCHS("Evaluations of the loss (default 2000)"),
    APP_T_END(app_common, "Length of the long prediction", .value = "100"), LG_FIELD_END};

static const app_command demo_command = {APP_DEMO(demo_options, lg_hamiltonian_demo),
                                         .summary = "Learn, test and draw the spherical pendulum"};

APP_PROGRAM(lg_hamiltonian) {
    const app_command commands[] = {hamiltonian_generate_command,
                                    train_command,
                                    hamiltonian_evaluate_command,
                                    hamiltonian_predict_command,
                                    hamiltonian_study_command,
                                    search_command,
                                    demo_command,
                                    {.run = NULL}};
    APP_CLEAN(lg_text_destroy) lg_text text = app_text();
    lg_text_add(
        &text, "Learns the Hamiltonian of a mechanical system from sampled trajectories. The system's family "
               "says what is learned, and the integrator of exported steps, with which training steps too "
               "(by default separable systems with rk4, chains of 3 links or more with rkmk5):\n");
    for (size_t i = 0; i < lg_hamiltonian_family_count(); i++) {
        const lg_hamiltonian_family *family = lg_hamiltonian_family_at(i);
        lg_text_add(&text, "\n  %-12s %s (%s)", family->name, family->formula, family->scheme);
    }
    return app_main(argc, argv, "lg-hamiltonian", text.data, commands);
}

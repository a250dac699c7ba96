/* lg-hamiltonian train: fits a Hamiltonian to trajectories. */
#include "common/train.h"
#include "hamiltonian/files/recipe.h"
#include "lg-hamiltonian/training.h"

static lg_hamiltonian_state state;
static lg_hamiltonian_run run; /* everything that determines the result */

static const app_settings settings[] = {{lg_hamiltonian_fields, &run, sizeof run},
                                        TRAIN_PRESET,
                                        APP_GIVEN(lg_hamiltonian_options, state),
                                        TRAIN_SHARED,
                                        APP_SETTINGS_END};

static void print(const lg_training *training) {
    app_put(stdout,
            "%s: %zu parameters, %llu epochs or evaluations with %s, mean squared error %.3e, floor "
            "%.1e (%.4f s an epoch, "
            "%.1f s in all)\n",
            train_given_files.out, lg_hamiltonian_parameters(&run.model),
            (unsigned long long)lg_fit_epochs_done(training->fit), run.scheme->name,
            lg_result_find(training, "loss")->real, training->floor, lg_fit_seconds_per_epoch(training->fit),
            training->seconds);
}

static train_task recipe = {
    .recipe = &lg_recipe_hamiltonian, .settings = settings, .state = &state, .print = print};

static int run_train(app *self) {
    return train_main(self, &recipe);
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Fit a Hamiltonian to trajectories",
    .details =
        "Loss: the mean squared difference over trajectories, coordinates and points (the first excluded; "
        "with --starts estimated it counts too) between the data and the integrator's prediction with the "
        "learned Hamiltonian; with --penalty, plus the penalty. The `loss` reported is this mean squared "
        "error (no penalty) over all trajectories of the file, in double precision, at the parameters that "
        "are written; `running_loss` is the last epoch's mean over its batches. `floor` is the part of this "
        "error that the integrator's steps make, estimated by steps of half the size.\n\nIf an option of "
        "Adam is given, the defaults are those of --preset thesis, else of --preset best. --preset thesis "
        "has the published settings but for Adam's eps and bound on the gradient (published: --adam-eps 1e-8 "
        "--clip 0). docs/reports/accuracy.md has the table of both; --json prints the values of a run.\n\n"
        "Ctrl-C saves a checkpoint and ends with exit code 130; --resume continues to the same bits.",
    .settings = settings,
    .run = run_train,
    .together = APP_RANKS};

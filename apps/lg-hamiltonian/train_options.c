/* The options of lg-hamiltonian train, and the run they describe. */
#include "lg-hamiltonian/train.h"

#include <string.h>

static const char *const potentials[] = {"mlp", "linear", NULL};
static const char *const penalty_forms[] = {"text", "published", NULL};

const app_option train_options[] = {
    FIT_OUT_ROW(train_values, fit),
    APP_ROW_TEXT(
        train_values, integrator, "integrator", "NAME",
        "Any scheme of lg-simulate that fits the space: euler, lie-euler, rk4, cf4, rkmk4, stormer-verlet, "
        "... (default: cf4 for pendulum chains, stormer-verlet otherwise)"),
    APP_ROW_SIZE(train_values, substeps, "substeps", "n", 1, 1e6,
                 "Integrator steps between two points (default 1)"),
    APP_ROW_SIZES(train_values, hidden, "hidden", "W,W,...", 1, 1048576,
                  "Widths of the hidden layers of the potential (default 100,100,100)"),
    APP_ROW_CHOICE(train_values, activation, "activation", fit_activations,
                   "tanh (default), sigmoid, swish, relu, leaky-relu, sine, identity"),
    APP_ROW_CHOICE(train_values, potential, "potential", potentials, "mlp (default) or linear"),
    FIT_TRAINING_ROWS(train_values, fit, "Trajectories", "100", "80", "1e-2", "step", "50", "0.1", "0",
                      "1e-12", "1e-3", "f64", "4"),
    APP_ROW_REAL(train_values, penalty, "penalty", "MU", 0, 1e300,
                 "First-integral penalty for (q_1^2 + p_1^2)/2 (default 0: none)"),
    APP_ROW_CHOICE(train_values, penalty_form, "penalty-form", penalty_forms,
                   "text: mean over the batch of squares; published: sum over the batch of absolute values"),
    APP_ROW_FLAG(
        train_values, newton, "newton",
        "After the last epoch, full-batch Newton iterations to the floor of the loss (few parameters)"),
    FIT_FILE_ROWS(train_values, fit),
    APP_ROW_END};

train_values train_given = {.fit = {.dtype = LG_F64,
                                    .epochs = 100,
                                    .batch = 80,
                                    .lr = 1e-2,
                                    .schedule = LG_SCHEDULE_STEP,
                                    .lr_step = 50,
                                    .lr_gamma = 0.1,
                                    .adam_eps = LG_HAMILTONIAN_ADAM_EPS,
                                    .clip = LG_HAMILTONIAN_CLIP,
                                    .shards = 4},
                            .hidden = {3, {100, 100, 100}},
                            .substeps = 1};

static void adopt_network(const app *self, const lg_hamiltonian *model) {
    if (!app_given(self, "potential")) train_given.potential = model->potential == LG_POTENTIAL_MLP ? 0 : 1;
    if (!app_given(self, "activation"))
        train_given.activation = fit_position_of(fit_activations, lg_activation_name(model->net.activation),
                                                 train_given.activation);
    if (app_given(self, "hidden") || model->potential != LG_POTENTIAL_MLP) return;
    train_given.hidden.count = model->net.layers - 1;
    for (uint32_t i = 0; i + 1 < model->net.layers; i++)
        train_given.hidden.values[i] = model->net.width[i + 1];
}

void train_adopt(app *self, const lg_hamiltonian_run *stored) {
    adopt_network(self, &stored->model);
    fit_adopt(self, &train_given.fit, &stored->training, true);
    if (!app_given(self, "integrator")) train_given.integrator = stored->scheme->name;
    if (!app_given(self, "substeps")) train_given.substeps = stored->substeps;
    if (!app_given(self, "penalty")) train_given.penalty = stored->penalty;
    if (!app_given(self, "penalty-form"))
        train_given.penalty_form = stored->penalty_form == LG_PENALTY_MEAN_SQUARE ? 0 : 1;
}

lg_status train_run(const app *self, const lg_trajectories *data, lg_hamiltonian_run *run, lg_error *error) {
    lg_activation activation = LG_TANH;
    *run = (lg_hamiltonian_run){.substeps = (uint32_t)train_given.substeps,
                                .penalty = train_given.penalty,
                                .penalty_form = train_given.penalty_form == 0 ? LG_PENALTY_MEAN_SQUARE
                                                                              : LG_PENALTY_SUM_ABSOLUTE,
                                .training = fit_training(&train_given.fit, self->seed)};
    const char *integrator = train_given.integrator != NULL ? train_given.integrator : data->family->scheme;
    run->scheme = lg_scheme_find(integrator);
    if (run->scheme == NULL)
        return app_error(error, LG_INVALID_ARGUMENT, "--integrator: there is no scheme '%s'", integrator);
    const lg_status status = lg_activation_parse(fit_activations[train_given.activation], &activation);
    if (status != LG_OK) return status;
    return describe_run(data, train_given.potential == 0 ? LG_POTENTIAL_MLP : LG_POTENTIAL_LINEAR,
                        train_given.hidden.values, (uint32_t)train_given.hidden.count, activation, run,
                        error);
}

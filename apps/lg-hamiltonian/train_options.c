/* The options of lg-hamiltonian train, and the run they describe. */
#include "lg-hamiltonian/train.h"

#include <string.h>

static const char *const integrators[] = {"euler", "lie-euler",      "rk4", "cf4",
                                          "rkmk4", "stormer-verlet", NULL};
static const char *const activations[] = {"tanh",       "sigmoid", "swish",    "relu",
                                          "leaky-relu", "sine",    "identity", NULL};
static const char *const potentials[] = {"mlp", "linear", NULL};
static const char *const dtypes[] = {"f64", "f32", NULL};
static const char *const penalty_forms[] = {"text", "published", NULL};

const app_option train_options[] = {
    APP_ROW_TEXT(train_values, out, "out", "FILE", "The model file to write"),
    APP_ROW_CHOICE(
        train_values, integrator, "integrator", integrators,
        "euler, lie-euler, rk4, cf4, rkmk4, stormer-verlet (default: cf4 for pendulum chains, stormer-verlet "
        "otherwise)"),
    APP_ROW_SIZE(train_values, substeps, "substeps", "n", 1, 1e6,
                 "Integrator steps between two points (default 1)"),
    APP_ROW_SIZES(train_values, hidden, "hidden", "W,W,...", 1, 1048576,
                  "Widths of the hidden layers of the potential (default 100,100,100)"),
    APP_ROW_CHOICE(train_values, activation, "activation", activations,
                   "tanh (default), sigmoid, swish, relu, leaky-relu, sine, identity"),
    APP_ROW_CHOICE(train_values, potential, "potential", potentials, "mlp (default) or linear"),
    APP_ROW_SIZE(train_values, epochs, "epochs", "E", 1, 1e9,
                 "Planned total, a resumed run included (default 100)"),
    APP_ROW_SIZE(train_values, batch, "batch", "B", 1, 4e9, "Trajectories in a batch (default 80)"),
    APP_ROW_POSITIVE(train_values, lr, "lr", "R", "Learning rate of Adam (default 1e-2)"),
    APP_ROW_SIZE(train_values, lr_step, "lr-step", "E", 1, 1e9,
                 "Epochs after which the rate is multiplied by --lr-gamma (default 50)"),
    APP_ROW_POSITIVE(train_values, lr_gamma, "lr-gamma", "G", "Default 0.1"),
    APP_ROW_REAL(train_values, weight_decay, "weight-decay", "W", 0, 1e300,
                 "L2 penalty in the gradient (default 0)"),
    APP_ROW_POSITIVE(train_values, adam_eps, "adam-eps", "EPS", "Adam's eps (default 1e-12)"),
    APP_ROW_REAL(train_values, clip, "clip", "NORM", 0, 1e300,
                 "Bound on the gradient's norm, 0 for none (default 1e-3)"),
    APP_ROW_REAL(train_values, penalty, "penalty", "MU", 0, 1e300,
                 "First-integral penalty for (q_1^2 + p_1^2)/2 (default 0: none)"),
    APP_ROW_CHOICE(train_values, penalty_form, "penalty-form", penalty_forms,
                   "text: mean over the batch of squares; published: sum over the batch of absolute values"),
    APP_ROW_CHOICE(train_values, dtype, "dtype", dtypes, "f64 (default) or f32"),
    APP_ROW_REAL(train_values, validation, "validation", "F", 0, 0.9,
                 "Fraction kept for validation; the best epoch's parameters are then taken (default 0)"),
    APP_ROW_SIZE(train_values, shards, "shards", "n", 1, 1024,
                 "Pieces of a batch that threads share; the bits of the result depend on it (default 4)"),
    APP_ROW_FLAG(
        train_values, newton, "newton",
        "After the last epoch, full-batch Newton iterations to the floor of the loss (few parameters)"),
    APP_ROW_TEXT(
        train_values, checkpoint, "checkpoint", "FILE",
        "Where the state goes (default: FILE of --out with .checkpoint appended, when stopped early)"),
    APP_ROW_SIZE(train_values, checkpoint_every, "checkpoint-every", "n", 1, 1e9,
                 "Epochs between checkpoints (default 10 with --checkpoint)"),
    APP_ROW_SIZE(train_values, stop_after, "stop-after", "n", 1, 1e9,
                 "Stop after n epochs of this run, state saved"),
    APP_ROW_TEXT(
        train_values, resume, "resume", "FILE",
        "Continue from a checkpoint, to the same bits as one run; options not given are the checkpoint's"),
    APP_ROW_TEXT(train_values, history, "history", "FILE.csv",
                 "One row an epoch: epoch, loss, validation, rate, seconds"),
    APP_ROW_TEXT(train_values, plot, "plot", "FILE.svg|.png", "Draw the loss"),
    APP_ROW_END};

train_values train_given = {.integrator = -1,
                            .hidden = {3, {100, 100, 100}},
                            .substeps = 1,
                            .epochs = 100,
                            .batch = 80,
                            .lr_step = 50,
                            .shards = 4,
                            .lr = 1e-2,
                            .lr_gamma = 0.1,
                            .adam_eps = LG_HAMILTONIAN_ADAM_EPS,
                            .clip = LG_HAMILTONIAN_CLIP};

static int position_of(const char *const *names, const char *name, int otherwise) {
    for (int i = 0; names[i] != NULL; i++)
        if (strcmp(names[i], name) == 0) return i;
    return otherwise;
}

static void adopt_network(const app *self, const lg_hamiltonian *model) {
    if (!app_given(self, "potential")) train_given.potential = model->potential == LG_POTENTIAL_MLP ? 0 : 1;
    if (!app_given(self, "activation"))
        train_given.activation =
            position_of(activations, lg_activation_name(model->net.activation), train_given.activation);
    if (app_given(self, "hidden") || model->potential != LG_POTENTIAL_MLP) return;
    train_given.hidden.count = model->net.layers - 1;
    for (uint32_t i = 0; i + 1 < model->net.layers; i++)
        train_given.hidden.values[i] = model->net.width[i + 1];
}

void train_adopt(app *self, const lg_hamiltonian_run *stored) {
    adopt_network(self, &stored->model);
    if (!app_given(self, "integrator"))
        train_given.integrator = position_of(integrators, lg_train_integrator_name(stored->integrator), -1);
    if (!app_given(self, "substeps")) train_given.substeps = stored->substeps;
    if (!app_given(self, "epochs")) train_given.epochs = stored->epochs;
    if (!app_given(self, "batch")) train_given.batch = stored->batch;
    if (!app_given(self, "lr")) train_given.lr = stored->lr;
    if (!app_given(self, "lr-step")) train_given.lr_step = stored->lr_step;
    if (!app_given(self, "lr-gamma")) train_given.lr_gamma = stored->lr_gamma;
    if (!app_given(self, "weight-decay")) train_given.weight_decay = stored->weight_decay;
    if (!app_given(self, "adam-eps")) train_given.adam_eps = stored->adam_eps;
    if (!app_given(self, "clip")) train_given.clip = stored->clip;
    if (!app_given(self, "penalty")) train_given.penalty = stored->penalty;
    if (!app_given(self, "penalty-form"))
        train_given.penalty_form = stored->penalty_form == LG_PENALTY_TEXT ? 0 : 1;
    if (!app_given(self, "dtype")) train_given.dtype = stored->dtype == LG_F64 ? 0 : 1;
    if (!app_given(self, "validation")) train_given.validation = stored->validation;
    if (!app_given(self, "shards")) train_given.shards = stored->shards;
    if (!self->seed_given) self->seed = stored->seed;
}

lg_status train_run(const app *self, const lg_trajectories *data, lg_hamiltonian_run *run, lg_error *error) {
    lg_activation activation = LG_TANH;
    *run = (lg_hamiltonian_run){.dtype = train_given.dtype == 0 ? LG_F64 : LG_F32,
                                .substeps = (uint32_t)train_given.substeps,
                                .penalty = train_given.penalty,
                                .penalty_form =
                                    train_given.penalty_form == 0 ? LG_PENALTY_TEXT : LG_PENALTY_PUBLISHED,
                                .epochs = train_given.epochs,
                                .batch = train_given.batch,
                                .lr = train_given.lr,
                                .lr_gamma = train_given.lr_gamma,
                                .lr_step = train_given.lr_step,
                                .weight_decay = train_given.weight_decay,
                                .adam_eps = train_given.adam_eps,
                                .clip = train_given.clip,
                                .validation = train_given.validation,
                                .shards = (uint32_t)train_given.shards,
                                .seed = self->seed};
    run->integrator = data->family == LG_HAMILTONIAN_CHAIN ? LG_TRAIN_CF4 : LG_TRAIN_STORMER_VERLET;
    lg_status status = LG_OK;
    if (train_given.integrator >= 0)
        status = lg_train_integrator_parse(integrators[train_given.integrator], &run->integrator);
    if (status == LG_OK) status = lg_activation_parse(activations[train_given.activation], &activation);
    if (status != LG_OK) return status;
    return describe_run(data, train_given.potential == 0 ? LG_POTENTIAL_MLP : LG_POTENTIAL_LINEAR,
                        train_given.hidden.values, (uint32_t)train_given.hidden.count, activation, run,
                        error);
}

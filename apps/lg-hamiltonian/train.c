/* lg-hamiltonian train: fit a Hamiltonian to trajectories. */
#include "lg-hamiltonian/learning.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct train_values {
    const char *out, *checkpoint, *resume, *history, *plot;
    int integrator, activation, potential, dtype, penalty_form;
    app_sizes hidden;
    uint64_t substeps, epochs, batch, lr_step, shards, checkpoint_every, stop_after;
    double lr, lr_gamma, weight_decay, penalty, validation;
} train_values;

static const char *const integrators[] = {"euler", "lie-euler",      "rk4", "cf4",
                                          "rkmk4", "stormer-verlet", NULL};
static const char *const activations[] = {"tanh",       "sigmoid", "swish",    "relu",
                                          "leaky-relu", "sine",    "identity", NULL};
static const char *const potentials[] = {"mlp", "linear", NULL};
static const char *const dtypes[] = {"f64", "f32", NULL};
static const char *const penalty_forms[] = {"text", "published", NULL};

static const app_option train_options[] = {
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
    APP_ROW_REAL(train_values, penalty, "penalty", "MU", 0, 1e300,
                 "First-integral penalty for (q_1^2 + p_1^2)/2 (default 0: none)"),
    APP_ROW_CHOICE(train_values, penalty_form, "penalty-form", penalty_forms,
                   "text: mean over the batch of squares; published: sum over the batch of absolute values"),
    APP_ROW_CHOICE(train_values, dtype, "dtype", dtypes, "f64 (default) or f32"),
    APP_ROW_REAL(train_values, validation, "validation", "F", 0, 0.9,
                 "Fraction kept for validation; the best epoch's parameters are then taken (default 0)"),
    APP_ROW_SIZE(train_values, shards, "shards", "n", 1, 1024,
                 "Pieces of a batch that threads share; the bits of the result depend on it (default 4)"),
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

static train_values values = {.integrator = -1,
                              .hidden = {3, {100, 100, 100}},
                              .substeps = 1,
                              .epochs = 100,
                              .batch = 80,
                              .lr_step = 50,
                              .shards = 4,
                              .lr = 1e-2,
                              .lr_gamma = 0.1};

typedef struct training {
    app *app;
    learner learner;
    app_progress progress;
    const char *checkpoint;
    lg_status checkpoint_status; /* of the last one */
    lg_error checkpoint_error;
} training;

/* ---- options ---- */

static int position_of(const char *const *names, const char *name, int otherwise) {
    for (int i = 0; names[i] != NULL; i++)
        if (strcmp(names[i], name) == 0) return i;
    return otherwise;
}

static void adopt_network(const app *self, const lg_hamiltonian *model) {
    if (!app_given(self, "potential")) values.potential = model->potential == LG_POTENTIAL_MLP ? 0 : 1;
    if (!app_given(self, "activation"))
        values.activation =
            position_of(activations, lg_activation_name(model->net.activation), values.activation);
    if (app_given(self, "hidden") || model->potential != LG_POTENTIAL_MLP) return;
    values.hidden.count = model->net.layers - 1;
    for (uint32_t i = 0; i + 1 < model->net.layers; i++) values.hidden.values[i] = model->net.width[i + 1];
}

/* What was not given on the command line is the stored run's. */
static void adopt(app *self, const lg_hamiltonian_run *stored) {
    adopt_network(self, &stored->model);
    if (!app_given(self, "integrator"))
        values.integrator = position_of(integrators, lg_train_integrator_name(stored->integrator), -1);
    if (!app_given(self, "substeps")) values.substeps = stored->substeps;
    if (!app_given(self, "epochs")) values.epochs = stored->epochs;
    if (!app_given(self, "batch")) values.batch = stored->batch;
    if (!app_given(self, "lr")) values.lr = stored->lr;
    if (!app_given(self, "lr-step")) values.lr_step = stored->lr_step;
    if (!app_given(self, "lr-gamma")) values.lr_gamma = stored->lr_gamma;
    if (!app_given(self, "weight-decay")) values.weight_decay = stored->weight_decay;
    if (!app_given(self, "penalty")) values.penalty = stored->penalty;
    if (!app_given(self, "penalty-form"))
        values.penalty_form = stored->penalty_form == LG_PENALTY_TEXT ? 0 : 1;
    if (!app_given(self, "dtype")) values.dtype = stored->dtype == LG_F64 ? 0 : 1;
    if (!app_given(self, "validation")) values.validation = stored->validation;
    if (!app_given(self, "shards")) values.shards = stored->shards;
    if (!self->seed_given) self->seed = stored->seed;
}

static lg_status run_from_options(const app *self, const lg_trajectories *data, lg_hamiltonian_run *run,
                                  lg_error *error) {
    lg_activation activation = LG_TANH;
    *run = (lg_hamiltonian_run){.dtype = values.dtype == 0 ? LG_F64 : LG_F32,
                                .substeps = (uint32_t)values.substeps,
                                .penalty = values.penalty,
                                .penalty_form =
                                    values.penalty_form == 0 ? LG_PENALTY_TEXT : LG_PENALTY_PUBLISHED,
                                .epochs = values.epochs,
                                .batch = values.batch,
                                .lr = values.lr,
                                .lr_gamma = values.lr_gamma,
                                .lr_step = values.lr_step,
                                .weight_decay = values.weight_decay,
                                .validation = values.validation,
                                .shards = (uint32_t)values.shards,
                                .seed = self->seed};
    run->integrator = data->family == LG_HAMILTONIAN_CHAIN ? LG_TRAIN_CF4 : LG_TRAIN_STORMER_VERLET;
    lg_status status = LG_OK;
    if (values.integrator >= 0)
        status = lg_train_integrator_parse(integrators[values.integrator], &run->integrator);
    if (status == LG_OK) status = lg_activation_parse(activations[values.activation], &activation);
    if (status != LG_OK) return status;
    return describe_run(data, values.potential == 0 ? LG_POTENTIAL_MLP : LG_POTENTIAL_LINEAR,
                        values.hidden.values, (uint32_t)values.hidden.count, activation, run, error);
}

/* ---- callbacks of the fit ---- */

/* A checkpoint that cannot be written does not end the training: the next one may succeed. */
static lg_status on_checkpoint(void *user, const lg_fit *fit) {
    training *self = user;
    self->checkpoint_status =
        save_checkpoint(self->app, self->checkpoint, &self->learner.run, fit, &self->checkpoint_error);
    if (self->checkpoint_status != LG_OK) app_warn(self->app, "%s", self->checkpoint_error.message);
    return LG_OK;
}

static int on_epoch(void *user, const lg_fit_epoch *report) {
    training *self = user;
    app_progress_show(&self->progress, report->epoch, "epoch %llu/%llu  loss %.3g",
                      (unsigned long long)report->epoch, (unsigned long long)report->epochs, report->loss);
    return 0;
}

/* ---- result ---- */

static void report_json(const app *self, const learner *learned, double loss, double seconds) {
    char cpu[256];
    app_json json;
    const lg_fit *fit = learned->fit;
    (void)lg_cpu_describe(cpu, sizeof cpu);
    app_json_begin(&json);
    app_json_size(&json, "epochs", lg_fit_epochs_done(fit));
    app_json_real(&json, "loss", loss);
    app_json_real(&json, "running_loss", lg_fit_loss(fit));
    const uint64_t done = lg_fit_epochs_done(fit);
    app_json_real(&json, "validation_loss",
                  done > 0 ? lg_fit_history(fit, LG_FIT_VALIDATION)[done - 1] : (double)NAN);
    app_json_size(&json, "best_epoch", lg_fit_best_epoch(fit));
    app_json_bool(&json, "finished", lg_fit_finished(fit));
    app_json_real(&json, "seconds_per_epoch", lg_fit_seconds_per_epoch(fit));
    app_json_real(&json, "seconds", seconds);
    app_json_size(&json, "parameters", lg_hamiltonian_parameters(&learned->run.model));
    app_json_size(&json, "threads", self->threads);
    app_json_text(&json, "dtype", learned->run.dtype == LG_F64 ? "f64" : "f32");
    app_json_text(&json, "integrator", lg_train_integrator_name(learned->run.integrator));
    app_json_size(&json, "substeps", learned->run.substeps);
    app_json_size(&json, "seed", learned->run.seed);
    app_json_size(&json, "shards", learned->run.shards);
    app_json_size(&json, "steps", lg_fit_steps_done(fit));
    app_json_size(&json, "tape_bytes", lg_fit_tape_bytes(fit));
    app_json_text(&json, "cpu", cpu);
    app_json_text(&json, "out", values.out);
    app_json_end(&json);
}

static void report(const app *self, const learner *learned, double loss, double seconds) {
    if (self->json) {
        report_json(self, learned, loss, seconds);
        return;
    }
    (void)printf(
        "%s: %zu parameters, %llu epochs with %s, mean squared error %.3e (%.4f s an epoch, %.1f s in all)\n",
        values.out, lg_hamiltonian_parameters(&learned->run.model),
        (unsigned long long)lg_fit_epochs_done(learned->fit),
        lg_train_integrator_name(learned->run.integrator), loss, lg_fit_seconds_per_epoch(learned->fit),
        seconds);
}

/* What is written when training has ended: model, history, picture. */
static int finish(training *self, double seconds) {
    const learner *learned = &self->learner;
    lg_error error = {LG_OK, ""};
    const size_t epochs = (size_t)lg_fit_epochs_done(learned->fit);
    double loss = 0, *theta = app_alloc(lg_hamiltonian_parameters(&learned->run.model), sizeof *theta);
    lg_fit_parameters(learned->fit, theta);
    lg_status status = mean_squared_error(self->app->context, &learned->problem, theta, &loss, &error);
    if (status == LG_OK && !isfinite(loss)) status = LG_NOT_FINITE;
    int code = status == LG_OK
                   ? APP_EXIT_OK
                   : app_fail(self->app, status, "the loss at the end: %s",
                              error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    if (code == APP_EXIT_OK) {
        status = save_model(self->app, values.out, learned, theta, &error);
        if (status != LG_OK) code = app_fail_file(self->app, status, &error, values.out);
    }
    free(theta);
    if (code == APP_EXIT_OK && values.plot != NULL) {
        status =
            draw_loss(self->app, values.plot, lg_fit_history(learned->fit, LG_FIT_LOSS),
                      learned->run.validation > 0 ? lg_fit_history(learned->fit, LG_FIT_VALIDATION) : NULL,
                      epochs, &error);
        if (status != LG_OK) code = app_fail_file(self->app, status, &error, values.plot);
    }
    if (code == APP_EXIT_OK) report(self->app, learned, loss, seconds);
    return code;
}

/* The fit has returned `status`: history, then what the status asks for. */
static int conclude(training *self, lg_status status, const lg_error *fit_error, double seconds) {
    lg_error error = {LG_OK, ""};
    int code = APP_EXIT_OK;
    const learner *learned = &self->learner;
    if (values.history != NULL) {
        const lg_status saved = save_history(values.history, learned->fit, &error);
        if (saved != LG_OK) code = app_fail_file(self->app, saved, &error, values.history);
    }
    const bool stopped = status == LG_CANCELLED || (status == LG_OK && !lg_fit_finished(learned->fit));
    if (stopped && self->checkpoint_status != LG_OK)
        return app_fail(self->app, LG_FILE, "the state could not be saved: %s",
                        self->checkpoint_error.message);
    if (stopped)
        (void)fprintf(stderr, "%s: stopped in epoch %llu of %llu; continue with --resume %s\n",
                      self->app->title, (unsigned long long)lg_fit_epochs_done(learned->fit) + 1,
                      (unsigned long long)learned->run.epochs, self->checkpoint);
    if (status == LG_CANCELLED) return APP_EXIT_INTERRUPTED;
    if (status != LG_OK)
        return app_fail(self->app, status, "%s",
                        fit_error->message[0] != '\0' ? fit_error->message : lg_status_sentence(status));
    return code == APP_EXIT_OK ? finish(self, seconds) : code;
}

/* ---- running ---- */

static int train(training *self, const lg_hamiltonian_run *run, const lg_trajectories *data,
                 lg_file_reader *stored) {
    lg_error error = {LG_OK, ""};
    lg_fit_options options;
    lg_archive_reader archive;
    lg_fit_options_init(&options);
    options.threads = (int)self->app->threads;
    options.stop_after = values.stop_after;
    options.checkpoint = on_checkpoint;
    options.checkpoint_every = values.checkpoint_every > 0 ? values.checkpoint_every
                               : values.checkpoint != NULL ? 10
                                                           : 0;
    options.on_epoch = on_epoch;
    options.user = self;
    lg_status status = learner_create(self->app->context, run, data, &options, &self->learner, &error);
    if (status != LG_OK)
        return app_fail(self->app, status, "%s",
                        error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    if (stored != NULL) {
        status = lg_file_reader_archive(stored, "fit", &archive);
        if (status == LG_OK) status = lg_fit_load(self->learner.fit, &archive, &error);
        if (status != LG_OK) {
            const char *more = lg_file_reader_message(stored);
            if (more[0] != '\0') (void)snprintf(error.message, sizeof error.message, "%s", more);
            learner_destroy(&self->learner);
            if (status == LG_INVALID_ARGUMENT)
                return app_fail(self->app, status, "%s: %s", values.resume, error.message);
            return app_fail_file(self->app, status, &error, values.resume);
        }
    }
    const double begin = app_seconds();
    app_progress_begin(&self->progress, lg_fit_epochs_done(self->learner.fit), run->epochs);
    status = lg_fit_run(self->learner.fit, &error);
    app_progress_end(&self->progress);
    const int code = conclude(self, status, &error, app_seconds() - begin);
    learner_destroy(&self->learner);
    return code;
}

static int check_outputs(const app *self, const char *checkpoint) {
    const char *const paths[] = {values.out, checkpoint, values.history, values.plot};
    if (values.plot != NULL && !app_plot_name_fits(values.plot))
        return app_usage(self, "--plot: '%s' does not end in .svg or .png", values.plot);
    for (size_t i = 0; i < APP_COUNT(paths); i++) {
        lg_error error = {LG_OK, ""};
        const lg_status status = paths[i] != NULL ? app_check_writable(paths[i], &error) : LG_OK;
        if (status != LG_OK) return app_fail_file(self, status, &error, paths[i]);
    }
    return APP_EXIT_OK;
}

/* With the data read: the run from options and checkpoint, then the training. */
static int run_with(training *self, const lg_trajectories *data) {
    lg_error error = {LG_OK, ""};
    lg_hamiltonian_run run, stored_run;
    lg_file_reader *stored = NULL;
    lg_status status = LG_OK;
    if (values.resume != NULL) {
        status = lg_checkpoint_open(self->app->context, values.resume, NULL, &stored_run, &stored, &error);
        if (status != LG_OK) return app_fail_file(self->app, status, &error, values.resume);
        adopt(self->app, &stored_run);
    }
    status = run_from_options(self->app, data, &run, &error);
    if (status == LG_OK && stored != NULL)
        status = lg_hamiltonian_run_compare(values.resume, &stored_run, &run, &error);
    const int code = status == LG_OK
                         ? train(self, &run, data, stored)
                         : app_fail(self->app, status, "%s",
                                    error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    lg_file_reader_close(stored);
    return code;
}

static int run_train(app *self) {
    lg_error error = {LG_OK, ""};
    if (values.out == NULL) return app_usage(self, "--out FILE is missing");
    char *beside = app_format("%s.checkpoint", values.out);
    training state = {.app = self, .checkpoint = values.checkpoint != NULL ? values.checkpoint : beside};
    int code = check_outputs(self, state.checkpoint);
    lg_trajectories data;
    if (code == APP_EXIT_OK) {
        const lg_status status = lg_trajectories_read(self->context, self->arguments[0], NULL, &data, &error);
        if (status != LG_OK) {
            code = app_fail_file(self, status, &error, self->arguments[0]);
        } else {
            code = run_with(&state, &data);
            lg_trajectories_free(self->context, &data);
        }
    }
    free(beside);
    return code;
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Fit a Hamiltonian to trajectories",
    .details = "Loss: the mean squared difference over trajectories, coordinates and points (the first "
               "excluded) between the "
               "data and what the integrator predicts with the learned Hamiltonian; with --penalty, plus the "
               "penalty. The `loss` "
               "reported is this mean squared error (no penalty) over all trajectories of the file, in "
               "double precision, at the "
               "parameters that are written; `running_loss` is the last epoch's mean over its "
               "batches.\n\nCtrl-C saves a "
               "checkpoint and ends with exit code 130; --resume continues to the same bits.",
    .options = train_options,
    .values = &values,
    .arguments_min = 1,
    .arguments_max = 1,
    .run = run_train};

/* lg-hamiltonian train: fit a Hamiltonian to trajectories. */
#include "lg-hamiltonian/train.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct training {
    app *app;
    learner learner;
    app_progress progress;
    lg_newton_result newton;
    const char *checkpoint;
    lg_status checkpoint_status; /* of the last one */
    lg_error checkpoint_error;
} training;

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

static void report_json(const training *state, double loss, double seconds) {
    const app *self = state->app;
    const learner *learned = &state->learner;
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
    if (train_given.newton) {
        app_json_size(&json, "newton_iterations", state->newton.iterations);
        app_json_real(&json, "newton_gradient", state->newton.gradient_norm);
    }
    app_json_text(&json, "cpu", cpu);
    app_json_text(&json, "out", train_given.out);
    app_json_end(&json);
}

static void report(const training *state, double loss, double seconds) {
    const learner *learned = &state->learner;
    if (state->app->json) {
        report_json(state, loss, seconds);
        return;
    }
    (void)printf(
        "%s: %zu parameters, %llu epochs with %s, mean squared error %.3e (%.4f s an epoch, %.1f s in all)\n",
        train_given.out, lg_hamiltonian_parameters(&learned->run.model),
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
    lg_status status = LG_OK;
    if (train_given.newton && lg_fit_finished(learned->fit))
        status = lg_newton_fit(self->app->context, &learned->fit_problem, NULL, theta, &self->newton);
    if (status == LG_OK)
        status = mean_squared_error(self->app->context, &learned->problem, theta, &loss, &error);
    if (status == LG_OK && !isfinite(loss)) status = LG_NOT_FINITE;
    int code = status == LG_OK
                   ? APP_EXIT_OK
                   : app_fail(self->app, status, "after the last epoch: %s",
                              error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    if (code == APP_EXIT_OK) {
        status = save_model(self->app, train_given.out, learned, theta, &error);
        if (status != LG_OK) code = app_fail_file(self->app, status, &error, train_given.out);
    }
    free(theta);
    if (code == APP_EXIT_OK && train_given.plot != NULL) {
        status =
            draw_loss(self->app, train_given.plot, lg_fit_history(learned->fit, LG_FIT_LOSS),
                      learned->run.validation > 0 ? lg_fit_history(learned->fit, LG_FIT_VALIDATION) : NULL,
                      epochs, &error);
        if (status != LG_OK) code = app_fail_file(self->app, status, &error, train_given.plot);
    }
    if (code == APP_EXIT_OK) report(self, loss, seconds);
    return code;
}

/* Training broke down: the state before the step that failed is kept: nothing is lost. */
static int broken(training *self, lg_status status, const lg_error *fit_error) {
    const char *message = fit_error->message[0] != '\0' ? fit_error->message : lg_status_sentence(status);
    if (lg_fit_steps_done(self->learner.fit) > 0) {
        (void)on_checkpoint(self, self->learner.fit);
        if (self->checkpoint_status == LG_OK)
            return app_fail(self->app, status, "%s; the state before it is in %s", message, self->checkpoint);
    }
    return app_fail(self->app, status, "%s", message);
}

/* The fit has returned `status`: history, then what the status asks for. */
static int conclude(training *self, lg_status status, const lg_error *fit_error, double seconds) {
    lg_error error = {LG_OK, ""};
    int code = APP_EXIT_OK;
    const learner *learned = &self->learner;
    if (train_given.history != NULL) {
        const lg_status saved = save_history(train_given.history, learned->fit, &error);
        if (saved != LG_OK) code = app_fail_file(self->app, saved, &error, train_given.history);
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
    if (status != LG_OK) return broken(self, status, fit_error);
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
    options.stop_after = train_given.stop_after;
    options.checkpoint = on_checkpoint;
    options.checkpoint_every = train_given.checkpoint_every > 0 ? train_given.checkpoint_every
                               : train_given.checkpoint != NULL ? 10
                                                                : 0;
    options.on_epoch = on_epoch;
    options.user = self;
    if (train_given.newton && lg_hamiltonian_parameters(&run->model) > LG_NEWTON_MAX_PARAMETERS)
        return app_usage(self->app, "--newton: the model has %zu parameters, at most %d are possible",
                         lg_hamiltonian_parameters(&run->model), LG_NEWTON_MAX_PARAMETERS);
    if (data->points > LG_HAMILTONIAN_MAX_POINTS)
        return app_fail(self->app, LG_FORMAT,
                        "%s: /trajectories has %zu points a trajectory; training takes at most %d",
                        self->app->arguments[0], data->points, LG_HAMILTONIAN_MAX_POINTS);
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
                return app_fail(self->app, status, "%s: %s", train_given.resume, error.message);
            return app_fail_file(self->app, status, &error, train_given.resume);
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
    const char *const paths[] = {train_given.out, checkpoint, train_given.history, train_given.plot};
    if (train_given.plot != NULL && !app_plot_name_fits(train_given.plot))
        return app_usage(self, "--plot: '%s' does not end in .svg or .png", train_given.plot);
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
    if (train_given.resume != NULL) {
        status =
            lg_checkpoint_open(self->app->context, train_given.resume, NULL, &stored_run, &stored, &error);
        if (status != LG_OK) return app_fail_file(self->app, status, &error, train_given.resume);
        train_adopt(self->app, &stored_run);
    }
    status = train_run(self->app, data, &run, &error);
    if (status == LG_OK && stored != NULL)
        status = lg_hamiltonian_run_compare(train_given.resume, &stored_run, &run, &error);
    const int code = status == LG_OK
                         ? train(self, &run, data, stored)
                         : app_fail(self->app, status, "%s",
                                    error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    lg_file_reader_close(stored);
    return code;
}

static int run_train(app *self) {
    lg_error error = {LG_OK, ""};
    if (train_given.out == NULL) return app_usage(self, "--out FILE is missing");
    char *beside = app_format("%s.checkpoint", train_given.out);
    training state = {.app = self,
                      .checkpoint = train_given.checkpoint != NULL ? train_given.checkpoint : beside};
    int code = check_outputs(self, state.checkpoint);
    lg_trajectories data;
    if (code == APP_EXIT_OK) {
        const lg_status status = lg_trajectories_read(self->context, self->arguments[0], NULL, &data, &error);
        if (status != LG_OK) {
            code = app_fail_file(self, status, &error, self->arguments[0]);
        } else {
            warn_of_inputs(self, self->arguments[0], &data);
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
    .values = &train_given,
    .arguments_min = 1,
    .arguments_max = 1,
    .run = run_train};

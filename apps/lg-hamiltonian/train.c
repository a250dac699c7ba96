/* lg-hamiltonian train: fit a Hamiltonian to trajectories. */
#include "lg-hamiltonian/train.h"

#include <math.h>
#include <stdlib.h>

typedef struct training {
    app *app;
    learner learner;
    fit_session session;
    lg_newton_result newton;
} training;

static lg_status create_checkpoint(void *user, const char *path, const lg_provenance *provenance,
                                   lg_file_writer **out, lg_error *error) {
    const training *self = user;
    return lg_checkpoint_create(self->app->context, path, &self->learner.run, provenance, out, error);
}

static const char *sentence_of(lg_status status, const lg_error *error) {
    return error->message[0] != '\0' ? error->message : lg_status_sentence(status);
}

/* ---- result ---- */

static void report_json(const training *state, double loss) {
    const lg_hamiltonian_run *run = &state->learner.run;
    app_json json;
    app_json_begin(&json);
    app_json_real(&json, "loss", loss);
    fit_json(&state->session, &json);
    app_json_size(&json, "parameters", lg_hamiltonian_parameters(&run->model));
    app_json_text(&json, "integrator", run->scheme->name);
    app_json_size(&json, "substeps", run->substeps);
    if (train_given.newton) {
        app_json_size(&json, "newton_iterations", state->newton.iterations);
        app_json_real(&json, "newton_gradient", state->newton.gradient_norm);
    }
    app_json_end(&json);
}

static void report(const training *state, double loss) {
    const learner *learned = &state->learner;
    if (state->app->json) {
        report_json(state, loss);
        return;
    }
    (void)printf(
        "%s: %zu parameters, %llu epochs with %s, mean squared error %.3e (%.4f s an epoch, %.1f s in all)\n",
        train_given.fit.out, lg_hamiltonian_parameters(&learned->run.model),
        (unsigned long long)lg_fit_epochs_done(learned->fit), learned->run.scheme->name, loss,
        lg_fit_seconds_per_epoch(learned->fit), state->session.seconds);
}

/* What is written when training has ended: model, picture. */
static int finish(training *self) {
    const learner *learned = &self->learner;
    lg_error error = {LG_OK, ""};
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
                   : app_fail(self->app, status, "after the last epoch: %s", sentence_of(status, &error));
    if (code == APP_EXIT_OK) {
        status = save_model(self->app, train_given.fit.out, learned, theta, &error);
        if (status != LG_OK) code = app_fail_file(self->app, status, &error, train_given.fit.out);
    }
    free(theta);
    if (code == APP_EXIT_OK) code = fit_draw(&self->session);
    if (code == APP_EXIT_OK) report(self, loss);
    return code;
}

/* ---- running ---- */

static int train(training *self, const lg_hamiltonian_run *run, const lg_trajectories *data,
                 lg_file_reader *stored) {
    lg_error error = {LG_OK, ""};
    bool done = false;
    if (train_given.newton && lg_hamiltonian_parameters(&run->model) > LG_NEWTON_MAX_PARAMETERS)
        return app_usage(self->app, "--newton: the model has %zu parameters, at most %d are possible",
                         lg_hamiltonian_parameters(&run->model), LG_NEWTON_MAX_PARAMETERS);
    if (data->points > LG_HAMILTONIAN_MAX_POINTS)
        return app_fail(self->app, LG_FORMAT,
                        "%s: /trajectories has %zu points a trajectory; training takes at most %d",
                        self->app->arguments[0], data->points, LG_HAMILTONIAN_MAX_POINTS);
    self->session.training = run->training;
    const lg_fit_options options = fit_options(&self->session);
    const lg_status status = learner_create(self->app->context, run, data, &options, &self->learner, &error);
    if (status != LG_OK) return app_fail(self->app, status, "%s", sentence_of(status, &error));
    self->session.fit = self->learner.fit;
    int code = stored != NULL ? fit_load(&self->session, stored) : APP_EXIT_OK;
    if (code == APP_EXIT_OK) code = fit_train(&self->session, &done);
    if (done) code = finish(self);
    learner_destroy(&self->learner);
    return code;
}

/* With the data read: the run from options and checkpoint, then the training. */
static int run_with(training *self, const lg_trajectories *data) {
    lg_error error = {LG_OK, ""};
    const char *resume = train_given.fit.resume;
    lg_hamiltonian_run run, stored_run;
    lg_file_reader *stored = NULL;
    lg_status status = LG_OK;
    if (resume != NULL) {
        status = lg_checkpoint_open(self->app->context, resume, NULL, &stored_run, &stored, &error);
        if (status != LG_OK) return app_fail_file(self->app, status, &error, resume);
        train_adopt(self->app, &stored_run);
    }
    status = train_run(self->app, data, &run, &error);
    if (status == LG_OK && stored != NULL)
        status = lg_hamiltonian_run_compare(resume, &stored_run, &run, &error);
    const int code = status == LG_OK ? train(self, &run, data, stored)
                                     : app_fail(self->app, status, "%s", sentence_of(status, &error));
    lg_file_reader_close(stored);
    return code;
}

static int run_train(app *self) {
    lg_error error = {LG_OK, ""};
    lg_trajectories data;
    training state = {.app = self};
    state.session =
        (fit_session){.app = self, .values = &train_given.fit, .create = create_checkpoint, .user = &state};
    int code = fit_check_outputs(self, &train_given.fit);
    if (code != APP_EXIT_OK) return code;
    const lg_status status = lg_trajectories_read(self->context, self->arguments[0], NULL, &data, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    warn_of_inputs(self, self->arguments[0], &data);
    code = run_with(&state, &data);
    lg_trajectories_destroy(self->context, &data);
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

/* lg-elastica train: fit a surrogate to curves. */
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/train.h"

typedef struct training {
    app *app;
    const lg_elastica_data *data;
    const lg_surrogate_preset *preset; /* NULL when resumed */
    part_indices train, test;
    learner learner;
    fit_session session;
} training;

static lg_status create_checkpoint(void *user, const char *path, const lg_provenance *provenance,
                                   lg_file_writer **out, lg_error *error) {
    const training *self = user;
    return lg_surrogate_checkpoint_create(self->app->context, path, &self->learner.run, provenance, out,
                                          error);
}

static const char *sentence_of(lg_status status, const lg_error *error) {
    return error->message[0] != '\0' ? error->message : lg_status_sentence(status);
}

/* ---- result ---- */

static void json_model(app_json *json, const lg_surrogate *model) {
    const lg_surrogate_options *options = &model->options;
    app_json_text(json, "network", lg_surrogate_kind_name(options->kind));
    app_json_text(json, "architecture", lg_net_kind_name(options->architecture));
    app_json_size(json, "embedding", options->embedding);
    app_json_size(json, "hidden", options->hidden);
    app_json_size(json, "layers", options->layers);
    app_json_text(json, "activation", lg_activation_name(options->activation));
    app_json_bool(json, "normalise", options->normalise);
    app_json_bool(json, "mirror", options->mirror);
    app_json_bool(json, "boundary", options->boundary);
    app_json_bool(json, "between", options->between);
    app_json_real(json, "gamma", options->gamma);
}

static void json_training(app_json *json, const lg_training *how) {
    app_json_size(json, "batch", how->batch);
    app_json_real(json, "lr", how->lr);
    app_json_text(json, "schedule", lg_schedule_name(how->schedule));
    app_json_size(json, "lr_step", how->lr_step);
    app_json_real(json, "lr_gamma", how->lr_gamma);
    app_json_real(json, "weight_decay", how->weight_decay);
}

static void report_json(const training *state, const lg_surrogate_errors *train,
                        const lg_surrogate_errors *test) {
    const lg_surrogate_run *run = &state->learner.run;
    app_json json;
    app_json_begin(&json);
    app_json_real(&json, "train_mse", train->mse);
    app_json_real(&json, "test_mse", test->mse);
    app_json_real(&json, "loss", lg_fit_loss(state->learner.fit));
    app_json_size(&json, "parameters", lg_surrogate_parameters(&run->model));
    fit_json(&state->session, &json);
    json_model(&json, &run->model);
    json_training(&json, &run->training);
    app_json_text(&json, "preset", state->preset != NULL ? state->preset->name : NULL);
    app_json_text(&json, "source", state->preset != NULL ? state->preset->source : NULL);
    app_json_size(&json, "train_curves", state->train.count);
    app_json_size(&json, "test_curves", state->test.count);
    app_json_real(&json, "test_max_error", test->max_error);
    app_json_text(&json, "values", run->continuous ? "continuous" : "discrete");
    app_json_text(&json, "data_sha256", run->data_sha256);
    app_json_end(&json);
}

static void report(const training *state, const lg_surrogate_errors *train, const lg_surrogate_errors *test) {
    const learner *learned = &state->learner;
    const lg_surrogate_options *options = &learned->run.model.options;
    if (state->app->json) {
        report_json(state, train, test);
        return;
    }
    (void)printf("%s: %s network, %s %u x %u, %zu parameters", train_given.fit.out,
                 lg_surrogate_kind_name(options->kind), lg_net_kind_name(options->architecture),
                 options->hidden, options->layers, lg_surrogate_parameters(&learned->run.model));
    if (state->preset != NULL) (void)printf(" (preset %s: %s)", state->preset->name, state->preset->source);
    (void)printf("\n%llu epochs (%.4f s each, %.1f s in all); mean squared error %.4e on %zu curves trained "
                 "on",
                 (unsigned long long)lg_fit_epochs_done(learned->fit), lg_fit_seconds_per_epoch(learned->fit),
                 state->session.seconds, train->mse, state->train.count);
    if (state->test.count > 0) (void)printf(", %.4e on %zu test curves", test->mse, state->test.count);
    (void)printf("\n");
}

/* What is written when training has ended: model, picture. */
static int finish(training *self) {
    const lg_context *context = self->app->context;
    lg_error error = {LG_OK, ""};
    lg_surrogate_errors train, test;
    lg_status status = learner_errors(context, &self->learner, &self->train, &train, &error);
    if (status == LG_OK) status = learner_errors(context, &self->learner, &self->test, &test, &error);
    if (status != LG_OK)
        return app_fail(self->app, status, "after the last epoch: %s", sentence_of(status, &error));
    status = save_model(self->app, train_given.fit.out, &self->learner, train.mse, test.mse, &error);
    if (status != LG_OK) return app_fail_file(self->app, status, &error, train_given.fit.out);
    const int code = fit_draw(&self->session);
    if (code == APP_EXIT_OK) report(self, &train, &test);
    return code;
}

/* ---- running ---- */

static int train(training *self, const lg_surrogate_run *run, lg_file_reader *stored) {
    lg_error error = {LG_OK, ""};
    bool done = false;
    self->session.training = run->training;
    const lg_fit_options options = fit_options(&self->session);
    const lg_status status = learner_create(self->app->context, run, &self->data->curves, &self->train,
                                            &options, &self->learner, &error);
    if (status != LG_OK) return app_fail(self->app, status, "%s", sentence_of(status, &error));
    self->session.fit = self->learner.fit;
    int code = stored != NULL ? fit_load(&self->session, stored) : APP_EXIT_OK;
    if (code == APP_EXIT_OK) code = fit_train(&self->session, &done);
    if (done) code = finish(self);
    learner_destroy(&self->learner);
    return code;
}

/* With the data read: the run from options, preset or checkpoint, then the training. */
static int run_with(training *self) {
    lg_error error = {LG_OK, ""};
    lg_surrogate_run run, stored_run;
    lg_file_reader *stored = NULL;
    lg_status status = LG_OK;
    const char *resume = train_given.fit.resume;
    if (resume != NULL) {
        status = lg_surrogate_checkpoint_open(self->app->context, resume, NULL, &stored_run, &stored, &error);
        if (status != LG_OK) return app_fail_file(self->app, status, &error, resume);
        train_adopt(self->app, &train_given, &stored_run);
    }
    status = train_run(self->app, &train_given, self->data, stored != NULL, &run, &self->preset, &error);
    if (status == LG_OK && stored != NULL)
        status = lg_surrogate_run_compare(resume, &stored_run, &run, &error);
    if (status == LG_OK) status = split_curves(&run, &self->train, &self->test, &error);
    const int code = status == LG_OK ? train(self, &run, stored)
                                     : app_fail(self->app, status, "%s", sentence_of(status, &error));
    lg_file_reader_close(stored);
    free(self->train.list);
    free(self->test.list);
    return code;
}

static int run_train(app *self) {
    lg_elastica_data data;
    training state = {.app = self, .data = &data};
    state.session =
        (fit_session){.app = self, .values = &train_given.fit, .create = create_checkpoint, .user = &state};
    if (train_given.fit.resume != NULL && app_given(self, "preset"))
        return app_usage(self, "--preset: a resumed run has its settings already");
    int code = fit_check_outputs(self, &train_given.fit);
    if (code == APP_EXIT_OK) code = read_curves(self, self->arguments[0], &data);
    if (code != APP_EXIT_OK) return code;
    code = run_with(&state);
    lg_elastica_data_destroy(self->context, &data);
    return code;
}

const app_command train_command = {
    .name = "train",
    .arguments = "DATA.h5",
    .summary = "Fit a network to curves",
    .details = "train_mse and test_mse are mean squared errors over the curves of each part, nodes and "
               "components, in double precision (discrete: the 4(N - 1) inner ones); `loss` is the last "
               "epoch's mean over its batches, with its penalty.\n\nCtrl-C saves a checkpoint and ends with "
               "exit code 130; --resume continues to the same bits.",
    .options = train_options,
    .values = &train_given,
    .arguments_min = 1,
    .arguments_max = 1,
    .run = run_train};

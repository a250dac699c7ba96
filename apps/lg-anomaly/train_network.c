/* lg-anomaly train --method cnn. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

/* ---- result ---- */

static void json_network(app_json *json, const lg_detector *model) {
    const lg_cnn *net = &model->net;
    app_json_size(json, "parameters", lg_cnn_parameters(net));
    app_json_open(json, "blocks", '[');
    for (uint32_t i = 0; i < net->blocks; i++) {
        const lg_cnn_block *block = &net->block[i];
        app_json_open(json, NULL, '{');
        app_json_size(json, "filters", block->channels);
        app_json_size(json, "kernel", block->kernel);
        app_json_size(json, "stride", block->stride);
        app_json_size(json, "padding", block->padding);
        app_json_text(json, "pooling", lg_pooling_name(block->pooling));
        app_json_size(json, "pool_size", block->pool_size);
        app_json_size(json, "length", net->lengths[i + 1]);
        app_json_close(json, '}');
    }
    app_json_close(json, ']');
}

static uint64_t dead_units(const lg_detector_units *units) {
    uint64_t sum = 0;
    for (uint32_t i = 0; i < units->layers; i++) sum += units->layer[i].constant;
    return sum;
}

static void report_json(const trained *self, const train_session *session, const well_model *model) {
    app_json json;
    app_json_begin(&json);
    json_trained(&json, self, model);
    app_json_real(&json, "mse", self->judged.mse);
    app_json_real(&json, "train_mse", self->train_judged.mse);
    train_json(session, &json);
    json_network(&json, &train_run.model);
    app_json_size(&json, "restarts", lg_fit_restarts(self->net.fit));
    app_json_size(&json, "dead_units", dead_units(&self->units));
    app_json_text(&json, "preset", self->preset != NULL ? self->preset->name : NULL);
    app_json_text(&json, "source", self->preset != NULL ? self->preset->source : NULL);
    app_json_end(&json);
}

static void report(const trained *self, const train_session *session, const well_model *model) {
    const lg_fit *fit = self->net.fit;
    if (self->app->json) {
        report_json(self, session, model);
        return;
    }
    (void)printf("%s: cnn, %u blocks, %zu parameters", train_given_files.out, train_run.model.net.blocks,
                 self->net.fit_problem.parameters);
    if (self->preset != NULL) (void)printf(" (preset %s: %s)", self->preset->name, self->preset->source);
    (void)printf("\n%llu epochs (%.4f s each, %.1f s in all)", (unsigned long long)lg_fit_epochs_done(fit),
                 lg_fit_seconds_per_epoch(fit), session->seconds);
    if (self->validation.count > 0)
        (void)printf(", the parameters are those of epoch %llu, the best one on %zu validation windows",
                     (unsigned long long)lg_fit_best_epoch(fit), self->validation.count);
    (void)printf("\n");
    print_trained(self, model);
    if (isfinite(self->judged.mse))
        (void)printf("mean squared error %.3e (training part %.3e)\n", self->judged.mse,
                     self->train_judged.mse);
}

static int draw(const trained *self, const well_model *model) {
    lg_error error = {LG_OK, ""};
    const lg_fit *fit = self->net.fit;
    const cut_series *tested = tested_series(self);
    const char *picture = train_given_files.plot;
    const int view = view_of(model, train_given.picture, true);
    if (picture == NULL) return APP_EXIT_OK;
    const lg_status status =
        view == VIEW_LOSS
            ? train_draw_loss(self->app, picture, lg_fit_history(fit, LG_FIT_LOSS),
                              self->validation.count > 0 ? lg_fit_history(fit, LG_FIT_VALIDATION) : NULL,
                              (size_t)lg_fit_epochs_done(fit), &error)
            : draw_view(self->app, picture, view, model, &tested->data.series, &tested->windows,
                        &self->judged, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self->app, status, &error, picture);
}

static lg_status judge(trained *self, const well_model *model, lg_error *error) {
    const cut_series *tested = tested_series(self);
    const lg_status status = judge_windows(self->app, model, &self->all.data.series, &self->all.windows,
                                           &self->train, &self->train_judged, error);
    return status != LG_OK ? status
                           : judge_windows(self->app, model, &tested->data.series, &tested->windows,
                                           &self->test, &self->judged, error);
}

/* The share of windows of other classes than the most frequent one, in the part that was trained on. */
static double rare_share(const trained *self) {
    const uint32_t classes = self->all.data.series.classes;
    uint64_t most = 0;
    for (uint32_t i = 0; i < classes; i++) {
        uint64_t row = 0;
        for (uint32_t j = 0; j < classes; j++) row += self->train_judged.confusion[i * classes + j];
        if (row > most) most = row;
    }
    return 1.0 - (double)most / (double)self->train.count;
}

/* Dead units of the result; an exit code. */
static int judge_units(trained *self, const double *theta) {
    const uint64_t restarts = lg_fit_restarts(self->net.fit);
    const lg_status status = lg_detector_count_units(&self->net.problem, theta, &self->units);
    if (status != LG_OK) return app_fail(self->app, status, "dead units: %s", lg_status_sentence(status));
    if (restarts > 0)
        app_warn(self->app,
                 "the network died; it started again with other weights, restart %llu of at most %u",
                 (unsigned long long)restarts, train_run.restarts);
    for (uint32_t i = 0; i < self->units.layers; i++) {
        lg_slice_info info;
        if (self->units.layer[i].constant == 0) continue;
        (void)lg_cnn_slice(&train_run.model.net, 2 * i, &info);
        app_warn(self->app, "dead units of layer %.*s: %u of %u have the same value for all training windows",
                 (int)strcspn(info.name, "/"), info.name, self->units.layer[i].constant,
                 self->units.layer[i].units);
    }
    if (!self->units.died) return APP_EXIT_OK;
    app_warn(self->app,
             "the network has died and gives all windows one class: decrease --lr, or take --activation "
             "swish, another --seed or a wider --plane");
    return APP_EXIT_NUMERIC;
}

/* Writes the model and the picture after training. */
static int finish(void *user, train_session *session) {
    trained *self = user;
    const char *path = train_given_files.out;
    lg_error error = {LG_OK, ""};
    lg_detector_file file = network_file(&self->net, &self->all.data.series);
    well_model model;
    self->train_seconds = session->seconds;
    lg_status status = well_model_of_detector(self->app, &file, &model, &error);
    if (status == LG_OK) status = judge(self, &model, &error);
    int code = status == LG_OK ? APP_EXIT_OK
                               : app_fail(self->app, status, "after the last epoch: %s", error.message);
    const int judged = code == APP_EXIT_OK ? train_judge(session, "share of wrong windows",
                                                         1.0 - self->train_judged.metrics.accuracy,
                                                         "the most frequent class", rare_share(self))
                                           : APP_EXIT_OK;
    const int alive = code == APP_EXIT_OK ? judge_units(self, file.theta) : APP_EXIT_OK;
    if (alive != APP_EXIT_OK && alive != APP_EXIT_NUMERIC) code = alive;
    if (code == APP_EXIT_OK) code = fit_novelty(self, &self->train, &file.novelty);
    if (code == APP_EXIT_OK) {
        file.accuracy = self->judged.metrics.accuracy;
        file.f1 = self->judged.metrics.f1;
        file.test_mse = self->judged.mse;
        file.provenance = app_provenance(self->app, train_run.training.seed);
        status = lg_model_save_detector(self->app->context, path, &file, self->net.fit, &error);
        if (status != LG_OK) code = app_fail_file(self->app, status, &error, path);
    }
    if (code == APP_EXIT_OK) code = draw(self, &model);
    if (code == APP_EXIT_OK) report(self, session, &model);
    lg_detector_plan_destroy(model.plan);
    lg_novelty_destroy(&file.novelty);
    free(file.theta);
    return code != APP_EXIT_OK ? code : judged != APP_EXIT_OK ? judged : alive;
}

/* ---- the task ---- */

static lg_status describe(void *user, app *self, const void *stored, lg_error *error) {
    trained *state = user;
    return network_run(self, &state->all.data, stored, &state->preset, error);
}

static int prepare(void *user, app *self) {
    trained *state = user;
    const well_model shape = {
        .sort = WELL_NETWORK, .method = "cnn", .classes = train_run.model.classes, .detector.run = train_run};
    state->cut = cut_of_run(&train_run);
    const int code = cut_parts(state);
    if (code != APP_EXIT_OK) return code;
    train_run.windows = state->cut.windows;
    return train_given_files.plot != NULL ? check_view(self, &shape, train_given.picture, true) : APP_EXIT_OK;
}

static lg_status hold_out(void *user, app *self, double validation, lg_error *error) {
    trained *state = user;
    uint8_t *parts;
    train_run.validation_fraction = validation;
    state->cut = cut_of_run(&train_run);
    const lg_status status = cut_and_split(self->context, &state->all.data.series, &state->cut,
                                           &state->all.windows, &parts, error);
    if (status != LG_OK) return status;
    const size_t windows = state->all.windows.count;
    train_run.windows = windows;
    state->train = part_of(parts, windows, LG_PART_TRAIN);
    state->validation = part_of(parts, windows, LG_PART_VALIDATION);
    free(parts);
    if (state->validation.count > 0) return LG_OK;
    return app_error(error, LG_INVALID_ARGUMENT, "the validation part has no windows: increase --validation");
}

static lg_status create(void *user, app *self, const lg_fit_options *options, lg_fit **fit, lg_error *error) {
    trained *state = user;
    const lg_status status = network_create(self->context, &state->all.data.series, &state->all.windows,
                                            &state->train, &state->validation, options, &state->net, error);
    *fit = state->net.fit;
    return status;
}

static void release(void *user) {
    trained *state = user;
    network_destroy(&state->net);
    part_indices *const parts[] = {&state->train, &state->validation, &state->test};
    for (size_t i = 0; i < LG_COUNT(parts); i++) {
        free(parts[i]->list);
        *parts[i] = (part_indices){NULL, 0};
    }
    judgement_free(&state->train_judged);
    judgement_free(&state->judged);
    lg_windows_destroy(&state->all.windows);
    lg_windows_destroy(&state->foreign.windows);
}

/* The loss of the validation part at the best epoch so far. */
static double objective(void *user, app *self) {
    const trained *state = user;
    const uint64_t best = lg_fit_best_epoch(state->net.fit);
    (void)self;
    return best > 0 ? lg_fit_history(state->net.fit, LG_FIT_VALIDATION)[best - 1] : (double)NAN;
}

static size_t parameters(void *user) {
    return ((const trained *)user)->net.fit_problem.parameters;
}

train_task network_task(trained *state) {
    return (train_task){.kind = &lg_recipe_detector,
                        .settings = train_settings,
                        .training = &train_run.training,
                        .method = "method",
                        .only = "cnn",
                        .held_out = "validation",
                        .kept = "test",
                        .user = state,
                        .read = read_all,
                        .describe = describe,
                        .prepare = prepare,
                        .hold_out = hold_out,
                        .create = create,
                        .release = release,
                        .finish = finish,
                        .objective = objective,
                        .parameters = parameters};
}

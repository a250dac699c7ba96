/* lg-anomaly train --method cnn. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

typedef struct network_training {
    trained *base;
    const lg_detector_preset *preset; /* NULL when resumed */
    network net;
    fit_session session;
} network_training;

static lg_status create_checkpoint(void *user, const char *path, const lg_provenance *provenance,
                                   lg_file_writer **out, lg_error *error) {
    const network_training *self = user;
    return lg_detector_checkpoint_create(self->base->app->context, path, &self->net.run, provenance, out,
                                         error);
}

/* ---- result ---- */

static void json_network(app_json *json, const lg_detector *model) {
    const lg_cnn *net = &model->net;
    app_json_size(json, "parameters", lg_cnn_parameters(net));
    app_json_text(json, "activation", lg_activation_name(net->activation));
    app_json_text(json, "loss", lg_detector_loss_name(model->loss));
    app_json_bool(json, "centred", model->centred);
    app_json_size(json, "plane", net->plane);
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

static void report_json(const network_training *self, const well_model *model) {
    const lg_training *how = &self->net.run.training;
    app_json json;
    app_json_begin(&json);
    json_trained(&json, self->base, model);
    app_json_real(&json, "mse", self->base->judged.mse);
    app_json_real(&json, "train_mse", self->base->train_judged.mse);
    fit_json(&self->session, &json);
    json_network(&json, &self->net.run.model);
    app_json_size(&json, "batch", how->batch);
    app_json_real(&json, "lr", how->lr);
    app_json_text(&json, "schedule", lg_schedule_name(how->schedule));
    app_json_real(&json, "weight_decay", how->weight_decay);
    app_json_real(&json, "validation", self->net.run.validation_fraction);
    app_json_text(&json, "preset", self->preset != NULL ? self->preset->name : NULL);
    app_json_text(&json, "source", self->preset != NULL ? self->preset->source : NULL);
    app_json_end(&json);
}

static void report(const network_training *self, const well_model *model) {
    const lg_fit *fit = self->net.fit;
    if (self->base->app->json) {
        report_json(self, model);
        return;
    }
    (void)printf("%s: cnn, %u blocks, %zu parameters", train_given.fit.out, self->net.run.model.net.blocks,
                 self->net.fit_problem.parameters);
    if (self->preset != NULL) (void)printf(" (preset %s: %s)", self->preset->name, self->preset->source);
    (void)printf("\n%llu epochs (%.4f s each, %.1f s in all)", (unsigned long long)lg_fit_epochs_done(fit),
                 lg_fit_seconds_per_epoch(fit), self->session.seconds);
    if (self->base->validation.count > 0)
        (void)printf(", the parameters are those of epoch %llu, the best on %zu windows for validation",
                     (unsigned long long)lg_fit_best_epoch(fit), self->base->validation.count);
    (void)printf("\n");
    print_trained(self->base, model);
    if (isfinite(self->base->judged.mse))
        (void)printf("mean squared error %.3e (training part %.3e)\n", self->base->judged.mse,
                     self->base->train_judged.mse);
}

static int draw(const network_training *self, const well_model *model) {
    lg_error error = {LG_OK, ""};
    const lg_fit *fit = self->net.fit;
    const cut_series *tested = tested_series(self->base);
    const char *picture = train_given.fit.plot;
    const int view = view_of(model, train_given.picture, true);
    if (picture == NULL) return APP_EXIT_OK;
    const lg_status status =
        view == VIEW_LOSS
            ? fit_draw_loss(self->base->app, picture, lg_fit_history(fit, LG_FIT_LOSS),
                            self->base->validation.count > 0 ? lg_fit_history(fit, LG_FIT_VALIDATION) : NULL,
                            (size_t)lg_fit_epochs_done(fit), &error)
            : draw_view(self->base->app, picture, view, model, &tested->data.series, &tested->windows,
                        &self->base->judged, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self->base->app, status, &error, picture);
}

static lg_status judge(trained *base, const well_model *model, lg_error *error) {
    const cut_series *tested = tested_series(base);
    const lg_status status = judge_windows(base->app, model, &base->all->data.series, &base->all->windows,
                                           &base->train, &base->train_judged, error);
    return status != LG_OK ? status
                           : judge_windows(base->app, model, &tested->data.series, &tested->windows,
                                           &base->test, &base->judged, error);
}

/* What is written when training has ended: model, picture. */
static int finish(network_training *self) {
    trained *base = self->base;
    lg_error error = {LG_OK, ""};
    lg_detector_file file = network_file(&self->net, &base->all->data.series);
    well_model model;
    base->train_seconds = self->session.seconds;
    lg_status status = well_model_of_detector(base->app, &file, &model, &error);
    if (status == LG_OK) status = judge(base, &model, &error);
    int code = status == LG_OK ? APP_EXIT_OK
                               : app_fail(base->app, status, "after the last epoch: %s", error.message);
    if (code == APP_EXIT_OK) {
        file.accuracy = base->judged.metrics.accuracy;
        file.f1 = base->judged.metrics.f1;
        file.test_mse = base->judged.mse;
        file.provenance = app_provenance(base->app, self->net.run.training.seed);
        status =
            lg_model_save_detector(base->app->context, train_given.fit.out, &file, self->net.fit, &error);
        if (status != LG_OK) code = app_fail_file(base->app, status, &error, train_given.fit.out);
    }
    if (code == APP_EXIT_OK) code = draw(self, &model);
    if (code == APP_EXIT_OK) report(self, &model);
    lg_detector_plan_destroy(model.plan);
    free(file.theta);
    return code;
}

int train_network(trained *base, const lg_detector_run *run, const lg_detector_preset *preset,
                  lg_file_reader *stored) {
    app *self = base->app;
    lg_error error = {LG_OK, ""};
    bool done = false;
    network_training state = {.base = base, .preset = preset};
    state.session = (fit_session){.app = self,
                                  .values = &base->values->fit,
                                  .training = run->training,
                                  .create = create_checkpoint,
                                  .user = &state};
    const well_model shape = {
        .network = true, .method = "cnn", .classes = run->model.classes, .detector.run = *run};
    int code =
        base->values->fit.plot != NULL ? check_view(self, &shape, base->values->picture, true) : APP_EXIT_OK;
    if (code != APP_EXIT_OK) return code;
    const lg_fit_options options = fit_options(&state.session);
    const lg_status status = network_create(self->context, run, &base->all->data.series, &base->all->windows,
                                            &base->train, &base->validation, &options, &state.net, &error);
    if (status != LG_OK)
        return app_fail(self, status, "%s",
                        error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    state.session.fit = state.net.fit;
    if (stored != NULL) code = fit_load(&state.session, stored);
    if (code == APP_EXIT_OK) code = fit_train(&state.session, &done);
    if (done) code = finish(&state);
    network_destroy(self->context, &state.net);
    return code;
}

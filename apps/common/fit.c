/* Training from the options to the state of the fit at its end. */
#include "common/fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { CHECKPOINT_EVERY = 10 };

lg_provenance app_provenance(const app *self, uint64_t seed) {
    lg_provenance provenance = {.has_seed = true, .seed = seed};
    (void)snprintf(provenance.command, sizeof provenance.command, "%s", self->command_line);
    (void)lg_cpu_describe(provenance.cpu, sizeof provenance.cpu);
    return provenance;
}

static const char *sentence_of(lg_status status, const lg_error *error) {
    return error->message[0] != '\0' ? error->message : lg_status_sentence(status);
}

/* ---- callbacks of the fit ---- */

static lg_status save_checkpoint(const fit_session *self, const char *path, const lg_fit *fit,
                                 lg_error *error) {
    const lg_provenance provenance = app_provenance(self->app, self->training.seed);
    lg_file_writer *writer = NULL;
    lg_archive_writer archive;
    lg_status status = self->create(self->user, path, &provenance, &writer, error);
    if (status == LG_OK) status = lg_file_writer_archive(writer, "fit", &archive);
    if (status == LG_OK) status = lg_fit_save(fit, &archive, error);
    if (status == LG_OK) status = lg_file_writer_commit(writer, error);
    lg_file_writer_destroy(writer);
    return status;
}

/* A checkpoint that cannot be written does not end the training: the next one may succeed. */
static lg_status on_checkpoint(void *user, const lg_fit *fit) {
    fit_session *self = user;
    char *path = fit_checkpoint_path(self->values);
    self->checkpoint_error = (lg_error){LG_OK, ""};
    self->checkpoint_status = save_checkpoint(self, path, fit, &self->checkpoint_error);
    if (self->checkpoint_status != LG_OK)
        app_warn(self->app, "%s", sentence_of(self->checkpoint_status, &self->checkpoint_error));
    free(path);
    return LG_OK;
}

static int on_epoch(void *user, const lg_fit_epoch *report) {
    fit_session *self = user;
    app_progress_show(&self->progress, report->epoch, "epoch %llu/%llu  loss %.3g",
                      (unsigned long long)report->epoch, (unsigned long long)report->epochs, report->loss);
    return 0;
}

/* ---- training ---- */

lg_fit_options fit_options(fit_session *self) {
    const fit_values *values = self->values;
    lg_fit_options options;
    lg_fit_options_init(&options);
    lg_training_apply(&self->training, &options);
    options.threads = (int)self->app->threads;
    options.stop_after = values->stop_after;
    options.checkpoint = on_checkpoint;
    options.checkpoint_every = values->checkpoint_every > 0 ? values->checkpoint_every
                               : values->checkpoint != NULL ? CHECKPOINT_EVERY
                                                            : 0;
    options.on_epoch = on_epoch;
    options.user = self;
    return options;
}

int fit_load(fit_session *self, lg_file_reader *stored) {
    lg_error error = {LG_OK, ""};
    lg_archive_reader archive;
    lg_status status = lg_file_reader_archive(stored, "fit", &archive);
    if (status == LG_OK) status = lg_fit_load(self->fit, &archive, &error);
    if (status == LG_OK) return APP_EXIT_OK;
    const char *more = lg_file_reader_message(stored);
    if (more[0] != '\0') (void)snprintf(error.message, sizeof error.message, "%s", more);
    if (status == LG_INVALID_ARGUMENT)
        return app_fail(self->app, status, "%s: %s", self->values->resume, sentence_of(status, &error));
    return app_fail_file(self->app, status, &error, self->values->resume);
}

/* Training broke down: the state before the step that failed is kept: nothing is lost. */
static int broken(fit_session *self, lg_status status, const lg_error *fit_error) {
    if (lg_fit_steps_done(self->fit) > 0) {
        (void)on_checkpoint(self, self->fit);
        if (self->checkpoint_status == LG_OK) {
            char *path = fit_checkpoint_path(self->values);
            const int code = app_fail(self->app, status, "%s; the state before it is in %s",
                                      sentence_of(status, fit_error), path);
            free(path);
            return code;
        }
    }
    return app_fail(self->app, status, "%s", sentence_of(status, fit_error));
}

/* What is said about a training that stopped before the plan was finished; its state has been saved. */
static int stopped(const fit_session *self, lg_status status) {
    if (self->checkpoint_status != LG_OK)
        return app_fail(self->app, LG_FILE, "the state could not be saved: %s",
                        sentence_of(self->checkpoint_status, &self->checkpoint_error));
    char *path = fit_checkpoint_path(self->values);
    (void)fprintf(stderr, "%s: stopped in epoch %llu of %llu; continue with --resume %s\n", self->app->title,
                  (unsigned long long)lg_fit_epochs_done(self->fit) + 1,
                  (unsigned long long)self->training.epochs, path);
    free(path);
    return status == LG_CANCELLED ? APP_EXIT_INTERRUPTED : APP_EXIT_OK;
}

/* The fit has returned `status`: history, then what the status asks for. */
static int conclude(fit_session *self, lg_status status, const lg_error *fit_error) {
    lg_error error = {LG_OK, ""};
    int code = APP_EXIT_OK;
    if (self->values->history != NULL) {
        const lg_status saved = fit_save_history(self->values->history, self->fit, &error);
        if (saved != LG_OK) code = app_fail_file(self->app, saved, &error, self->values->history);
    }
    if (status == LG_CANCELLED || (status == LG_OK && !lg_fit_finished(self->fit))) {
        const int more = stopped(self, status);
        return more == APP_EXIT_OK ? code : more;
    }
    return status == LG_OK ? code : broken(self, status, fit_error);
}

int fit_train(fit_session *self, bool *done) {
    lg_error error = {LG_OK, ""};
    const double begin = app_seconds();
    app_progress_begin(&self->progress, lg_fit_epochs_done(self->fit), self->training.epochs);
    const lg_status status = lg_fit_run(self->fit, &error);
    app_progress_end(&self->progress);
    self->seconds = app_seconds() - begin;
    const int code = conclude(self, status, &error);
    *done = code == APP_EXIT_OK;
    return code;
}

/* ---- results ---- */

void fit_json(const fit_session *self, app_json *json) {
    char cpu[256];
    const lg_fit *fit = self->fit;
    const uint64_t done = lg_fit_epochs_done(fit);
    (void)lg_cpu_describe(cpu, sizeof cpu);
    app_json_size(json, "epochs", done);
    app_json_real(json, "running_loss", lg_fit_loss(fit));
    app_json_real(json, "validation_loss",
                  done > 0 ? lg_fit_history(fit, LG_FIT_VALIDATION)[done - 1] : (double)NAN);
    app_json_size(json, "best_epoch", lg_fit_best_epoch(fit));
    app_json_bool(json, "finished", lg_fit_finished(fit));
    app_json_real(json, "seconds_per_epoch", lg_fit_seconds_per_epoch(fit));
    app_json_real(json, "seconds", self->seconds);
    app_json_size(json, "threads", self->app->threads);
    app_json_text(json, "dtype", fit_dtypes[self->training.dtype]);
    app_json_size(json, "seed", self->training.seed);
    app_json_size(json, "shards", self->training.shards);
    app_json_size(json, "steps", lg_fit_steps_done(fit));
    app_json_size(json, "tape_bytes", lg_fit_tape_bytes(fit));
    app_json_text(json, "cpu", cpu);
    app_json_text(json, "out", self->values->out);
}

static void csv_number(FILE *stream, double value) {
    if (isfinite(value))
        (void)fprintf(stream, ",%.17g", value);
    else
        (void)fputc(',', stream);
}

lg_status fit_save_history(const char *path, const lg_fit *fit, lg_error *error) {
    static const lg_fit_series columns[] = {LG_FIT_LOSS, LG_FIT_VALIDATION, LG_FIT_RATE, LG_FIT_SECONDS};
    app_file file;
    app_file_begin(&file, path);
    (void)fputs("epoch,loss,validation,rate,seconds\n", file.stream);
    for (uint64_t epoch = 0; epoch < lg_fit_epochs_done(fit); epoch++) {
        (void)fprintf(file.stream, "%llu", (unsigned long long)(epoch + 1));
        for (size_t c = 0; c < APP_COUNT(columns); c++)
            csv_number(file.stream, lg_fit_history(fit, columns[c])[epoch]);
        (void)fputc('\n', file.stream);
    }
    return app_file_end(&file, error);
}

lg_status fit_draw_loss(const app *self, const char *picture, const double *loss, const double *validation,
                        size_t epochs, lg_error *error) {
    app_plot plot;
    bool drawn;
    const lg_status status = app_plot_begin(&plot, picture, 800, 500);
    if (status != LG_OK) return app_error(error, status, "%s: the name must end in .svg or .png", picture);
    for (size_t i = 0; i < epochs; i++)
        (void)fprintf(plot.data.stream, "%zu %.17g %.17g\n", i + 1, loss[i],
                      validation != NULL ? validation[i] : (double)NAN);
    (void)fputs("set title 'Training'\nset logscale y\nset format y '10^{%L}'\nset xlabel 'epoch'\n"
                "set ylabel 'loss (mean of an epoch)'\n"
                "plot datafile using 1:2 with lines lw 2 lc rgb '#1f5fa8' title 'training'",
                plot.script.stream);
    if (validation != NULL)
        (void)fputs(", datafile using 1:3 with lines lw 2 lc rgb '#d1641f' title 'validation'",
                    plot.script.stream);
    (void)fputc('\n', plot.script.stream);
    return app_plot_end(self, &plot, &drawn, error);
}

int fit_draw(const fit_session *self) {
    lg_error error = {LG_OK, ""};
    const char *picture = self->values->plot;
    if (picture == NULL) return APP_EXIT_OK;
    const double *validation =
        self->training.validation > 0 ? lg_fit_history(self->fit, LG_FIT_VALIDATION) : NULL;
    const lg_status status = fit_draw_loss(self->app, picture, lg_fit_history(self->fit, LG_FIT_LOSS),
                                           validation, (size_t)lg_fit_epochs_done(self->fit), &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self->app, status, &error, picture);
}

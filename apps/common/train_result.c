/* The outcome of a training: verdict, results, JSON and plots. */
#include <math.h>
#include <string.h>

#include "common/train.h"
#include "files/csv.h"

/* ---- the verdict ---- */

/* A model has learned something if its error is below `learned` times the error of a simple guess. It has
 * diverged if its error is above `enormous` times that error after more than one epoch. After fewer than LOOK
 * epochs, or FULL_LOOK evaluations of a full-batch method, training may simply not be far enough. */
static const double learned = 0.99, enormous = 1000.0;
enum { LOOK = 10, FULL_LOOK = 100 };

/* Warns if the model is no better than a simple guess, and if the loss has not fallen since the first epoch.
 * Returns APP_EXIT_NUMERIC if both hold, if one of them holds after LOOK epochs (FULL_LOOK for a full-batch
 * method), or if the error is enormous. The model is written all the same. A training that --stop-after ended
 * is only warned about. */
static int judge(const app *self, const lg_training *training) {
    const lg_training_verdict *verdict = &training->verdict;
    const char *what = verdict->what, *guess = verdict->guess;
    const double error = verdict->error, guessed = verdict->guessed;
    if (what == NULL) return APP_EXIT_OK;
    /* The model has the parameters of the epoch with the lowest validation loss, or without a validation part
     * those of the last epoch. */
    const uint64_t done = lg_fit_epochs_done(training->fit),
                   epoch =
                       isfinite(lg_training_validation(training)) ? lg_fit_best_epoch(training->fit) : done;
    const double *loss = lg_fit_history(training->fit, LG_FIT_LOSS);
    const bool adam = lg_fit_plan_ends_in_batches(&lg_training_settings(training)->plan),
               looked = done >= (adam ? LOOK : FULL_LOOK);
    const bool useless = guessed > 0 && !(error < learned * guessed);
    const bool risen = epoch > 1 && !(loss[epoch - 1] < loss[0]);
    if (useless)
        app_warn(self, "the model has learned nothing: its %s is %.3g, and %s reaches %.3g; %strain longer",
                 what, error, guess, guessed, adam ? "decrease --lr, or " : "");
    if (risen)
        app_warn(self, "the loss has not fallen: %.3g in epoch %llu, %.3g in the first one%s",
                 loss[epoch - 1], (unsigned long long)epoch, loss[0], adam ? "; decrease --lr" : "");
    const bool diverged = useless && done > 1 && error > enormous * guessed;
    const bool failed = (useless && risen) || diverged || ((useless || risen) && looked);
    return failed && lg_fit_finished(training->fit) ? APP_EXIT_NUMERIC : APP_EXIT_OK;
}

/* ---- results ---- */

void train_put_results(app_json *out, const lg_training *training, size_t first, size_t end) {
    const lg_result *outer = NULL; /* the object whose members people see under its name and theirs */
    size_t depth = 0;
    if (training->results_lost) app_out_of_memory();
    for (const lg_result *at = training->results + first; at < training->results + end; at++) {
        const bool table = depth > 0 && outer->label != NULL;
        if (at->bracket == '[' || at->bracket == '{') {
            if (depth++ == 0) outer = at;
            if (at->label != NULL)
                app_result_table(out, at->name, at->bracket, at->label);
            else
                app_json_open(out, at->name, at->bracket);
        } else if (at->bracket != 0) {
            if (--depth == 0 && table)
                app_result_rows_end(out);
            else
                app_json_close(out, at->bracket);
        } else if (!out->people || table || (depth == 0 && (at->type != LG_FIELD_REAL || !isnan(at->real)))) {
            app_json_put(out, *at);
        } else if (depth == 1 && at->name != NULL) {
            lg_result member = *at;
            APP_FREE char *name = app_format("%s, %s", outer->name, at->name);
            member.name = name;
            app_json_put(out, member);
        }
    }
}

/* Writes how the training went, and the run's hyperparameters under their names. `evaluations` counts
 * gradients over all data; `stopped` says why the training ended, null if it has not; seconds and bytes of
 * shards and exchanges are those of this process. */
static void json_training(const train_session *session, app_json *json) {
    const app *self = session->app;
    const lg_training *training = &session->task->training;
    char cpu[256];
    const lg_fit *fit = training->fit;
    const lg_fit_cost cost = lg_fit_cost_of(fit);
    const uint64_t done = lg_fit_epochs_done(fit);
    (void)lg_cpu_describe(cpu, sizeof cpu);
    APP_PUT(json, LG_WHOLE("epochs", done, NULL), LG_AS_WHOLE("evaluations", done),
            LG_AS_TEXT("gradients", lg_fit_by_plans(fit) ? "plans" : "tape"));
    app_result_known(json, "floor", training->floor, "part of the error that the integrator's steps make");
    APP_PUT(json, LG_AS_REAL("running_loss", lg_fit_loss(fit)),
            LG_AS_REAL("validation_loss", lg_training_validation(training)),
            LG_AS_WHOLE("best_epoch", lg_fit_best_epoch(fit)), LG_AS_FLAG("finished", lg_fit_finished(fit)),
            LG_AS_TEXT("stopped", lg_fit_finished(fit) ? lg_fit_end_sentence(fit) : NULL),
            LG_AS_REAL("seconds_per_epoch", lg_fit_seconds_per_epoch(fit)),
            LG_REAL("seconds", training->seconds, NULL), LG_AS_WHOLE("threads", self->threads),
            LG_AS_WHOLE("ranks", self->rank_count), LG_AS_REAL("training_seconds", cost.seconds),
            LG_AS_REAL("shard_seconds", cost.shard_seconds),
            LG_AS_REAL("exchange_seconds", cost.exchange_seconds), LG_AS_WHOLE("exchanges", cost.exchanges),
            LG_AS_WHOLE("exchanged_bytes", cost.bytes), LG_AS_WHOLE("steps", lg_fit_steps_done(fit)),
            LG_AS_WHOLE("tape_bytes", lg_fit_tape_size(fit)), LG_AS_TEXT("cpu", cpu),
            LG_TEXT("out", train_given_files.out, NULL));
    /* The hyperparameters without `epochs`, which says above how many are done, and without a row if another
     * row of the table is found under its name. */
    const app_settings *settings = session->task->settings;
    for (const lg_field *row = settings->rows; row->name != NULL; row++)
        if (strcmp(row->name, "epochs") != 0 && lg_field_find(settings->rows, row->name) == row)
            app_json_field(json, row, settings->values);
    train_size_json(&session->race, json);
}

lg_status train_save_history(const char *path, const lg_fit *fit, lg_error *error) {
    static const lg_fit_series columns[] = {LG_FIT_LOSS, LG_FIT_VALIDATION, LG_FIT_RATE, LG_FIT_SECONDS};
    lg_columns to = {.text = app_text()};
    lg_columns_names(&to, TRAIN_HISTORY);
    lg_columns_end(&to);
    for (uint64_t epoch = 0; epoch < lg_fit_epochs_done(fit); epoch++) {
        lg_columns_whole(&to, epoch + 1);
        for (size_t c = 0; c < LG_COUNT(columns); c++)
            lg_columns_number(&to, lg_fit_history(fit, columns[c])[epoch]);
        lg_columns_end(&to);
    }
    return lg_columns_write(&to, app_running()->context, path, error);
}

void train_put_loss(app_plot *plot, const void *training) {
    const lg_fit *fit = ((const lg_training *)training)->fit;
    const double *loss = lg_fit_history(fit, LG_FIT_LOSS),
                 *validation = lg_fit_history(fit, LG_FIT_VALIDATION);
    app_plot_text(plot, "%d", lg_fit_epochs_done(fit) > 0 && isfinite(validation[0]));
    APP_PLOT_COLUMNS(plot, 17, lg_fit_epochs_done(fit), {loss, 1, 1}, {validation, 1, 1});
}

const app_plot_kind train_plots[] = {APP_PLOT("loss", "the loss over the epochs", "training", train_put_loss),
                                     {.name = NULL}};

void train_draw(const app *self, const train_task *task) {
    if (task->draw != NULL)
        task->draw(self, &task->training);
    else
        app_plot_draw(self, task->has != NULL ? task->has(&task->training) : 0, &task->training);
}

/* ---- the end of a training ---- */

static void report(const train_session *session) {
    const train_task *task = session->task;
    const lg_training *training = &task->training;
    app_json *out = session->app->out;
    train_put_results(out, training, 0, training->first_count);
    json_training(session, out);
    train_put_results(out, training, training->first_count, training->result_count);
    app_result_end(session->app);
    if (!session->app->json && task->print != NULL) task->print(training);
}

/* Scores the fit's parameters, writes the model, draws and reports. */
int train_finish(train_session *session) {
    train_task *task = session->task;
    lg_training *training = &task->training;
    const app *self = session->app;
    const char *out = train_given_files.out;
    lg_error error = {LG_OK, ""};
    double *theta = lg_training_alloc(training, training->problem.parameters, sizeof *theta, &error);
    lg_status status = LG_OUT_OF_MEMORY;
    if (theta != NULL) {
        lg_fit_parameters(training->fit, theta);
        status = lg_training_judge(training, theta, &error);
    }
    if (status != LG_OK && status != LG_CANCELLED)
        return app_fail(self, status, "after the last epoch: %s", app_sentence(status, &error));
    const int judged = status == LG_OK ? judge(self, training) : APP_EXIT_OK;
    const lg_provenance provenance = app_provenance(self, train_training(task)->seed);
    if (status == LG_OK) status = lg_training_save(training, out, theta, &provenance, &error);
    if (status == LG_CANCELLED) return app_fail(self, status, "stopped by %s", app_stopper());
    if (status != LG_OK) return app_fail_file(self, status, &error, out);
    train_draw(self, task);
    report(session);
    return judged == APP_EXIT_OK && training->verdict.failed ? APP_EXIT_NUMERIC : judged;
}

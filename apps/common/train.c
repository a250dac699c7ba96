/* The train driver: from the command line to the end of training. */
#include "common/train.h"

#include <math.h>
#include <string.h>

enum { CHECKPOINT_EVERY = 10 };

train_files train_given_files;

/* --size must be first: TRAIN_SHARED_NO_SIZE begins behind it. */
const lg_field train_file_options[] = {
    TRAIN_SIZE(
        train_files,
        "Widths of the network, as --hidden; or auto: train a few widths, each for half of the epochs and "
        "all together for at most a third of --seconds, and take the one with the best validation loss"),
    APP_OUT(train_files, "FILE", "The model file to write", .required = true, .usual = true),
    LG_OPTION(train_files, checkpoint, STRING, "FILE",
              "File for the state (default: FILE of --out with .checkpoint appended, when stopped early)"),
    LG_OPTION(train_files, checkpoint_every, U64, "n",
              "Number of epochs between checkpoints (default 10 with --checkpoint)", .low = 1, .high = 1e9),
    APP_STOP_AFTER(train_files, "Save the state and stop after n epochs of this run"),
    APP_SECONDS(train_files,
                "Stop after this many seconds of training; with a method other than adam and no --epochs "
                "this is the only limit",
                .usual = true),
    APP_RESUME(train_files,
               "Continue from a checkpoint; the result has the same bits as one run. Options not given "
               "are the checkpoint's"),
    LG_OPTION(train_files, history, STRING, "FILE.csv",
              "Write one row for each epoch: epoch, loss, validation, rate, seconds", .file = LG_FILE_TEXT),
    LG_FIELD_END};

static const train_files *const files = &train_given_files;

/* ---- calls of the trainer's hooks; an error ends the command ---- */

static bool given(const lg_training *training, const char *option) {
    return app_given(training->user, option);
}

void train_check_usage(const app *self, lg_status status, const lg_error *error) {
    if (status == LG_INVALID_ARGUMENT && strncmp(error->message, "--", 2) == 0)
        app_stop_usage(self, "%s", error->message);
}

static void must(const app *self, lg_status status, const lg_error *error) {
    train_check_usage(self, status, error);
    app_must(self, status, error);
}

void train_begin(const app *self, train_task *task, int argument) {
    const lg_recipe *recipe = task->recipe;
    if (task->state == NULL && recipe->trainer->state_size > 0)
        task->state = app_keep(1, recipe->trainer->state_size);
    task->training = lg_training_of(self->context, recipe, task->settings[0].values, task->state);
    task->training.paths = self->arguments + argument;
    task->training.path_count = (size_t)(self->argument_count - argument);
    task->training.model = files->out;
    task->training.threads = self->threads;
    task->training.given = given;
    task->training.user = self;
}

void train_read(const app *self, train_task *task) {
    lg_training *training = &task->training;
    lg_error error = {LG_OK, ""};
    training->resumed = files->resume != NULL;
    const lg_status status = task->recipe->trainer->read(training, &error);
    train_check_usage(self, status, &error);
    app_must_file(self, status, &error, training->failed != NULL ? training->failed : training->paths[0]);
}

lg_status train_describe(const app *self, train_task *task, const void *stored, lg_error *error) {
    lg_training *training = &task->training;
    training->user = self;
    training->stored = stored;
    training->preset = app_given(self, "preset") ? lg_preset_name(train_preset_given) : NULL;
    return task->recipe->trainer->describe(training, error);
}

void train_prepare(const app *self, train_task *task) {
    const lg_trainer *trainer = task->recipe->trainer;
    lg_error error = {LG_OK, ""};
    if (trainer->prepare != NULL) must(self, trainer->prepare(&task->training, &error), &error);
    app_plot_check(self, task->has != NULL ? task->has(&task->training) : 0);
}

lg_status train_create(train_task *task, const lg_fit_options *options, lg_error *error) {
    task->training.options = *options;
    LG_TRY(lg_training_create_fit(&task->training, error));
    if (options->prior > 0 && given(&task->training, "prior") && task->training.problem.observations == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "--prior: this loss is no sum of squares of a network, so it has no prior: leave the "
                       "option out");
    return LG_OK;
}

lg_provenance app_provenance(const app *self, uint64_t seed) {
    lg_provenance provenance = {.has_seed = true, .seed = seed};
    (void)snprintf(provenance.command, sizeof provenance.command, "%s", self->command_line);
    (void)lg_cpu_describe(provenance.cpu, sizeof provenance.cpu);
    return provenance;
}

/* ---- before training: options and files ---- */

static const char *checkpoint_path(void) {
    if (files->checkpoint != NULL) return files->checkpoint;
    const size_t size = strlen(files->out) + sizeof ".checkpoint";
    char *path = app_keep(size, 1);
    (void)snprintf(path, size, "%s.checkpoint", files->out);
    return path;
}

static const lg_field *method_row(const train_task *task, void **values) {
    const app_settings *settings = task->settings;
    for (; task->recipe->trainer->method != NULL && settings->rows != NULL; settings++) {
        *values = settings->values;
        const lg_field *row = lg_field_find(settings->rows, task->recipe->trainer->method);
        if (row != NULL) return row;
    }
    return NULL;
}

const char *train_refuses(const train_task *task, const app_slot *slot) {
    static char text[128];
    void *values;
    const lg_field *method = method_row(task, &values);
    if (method == NULL || slot->row->methods == 0) return NULL;
    const uint32_t number = (uint32_t)lg_field_whole(method, values);
    if ((slot->row->methods & 1u << number) != 0) return NULL;
    (void)snprintf(text, sizeof text, "--%s %s has no such option", task->recipe->trainer->method,
                   lg_field_name(method, number));
    return text;
}

/* Returns whether a method of the plan can use the prior: one that minimises a general loss, so neither a
 * method in batches nor one for sums of squares. */
static bool takes_prior(const lg_fit_plan *plan) {
    bool takes = false;
    for (uint32_t i = 0; i < plan->phases; i++) {
        const lg_fit_method method = (lg_fit_method)plan->phase[i].method;
        takes = takes || !(lg_fit_method_batches(method) || lg_fit_method_squares(method));
    }
    return takes;
}

const char *train_ignores(const train_task *task, const app_slot *slot) {
    static char text[LG_FIT_PLAN_TEXT + 64];
    char plan[LG_FIT_PLAN_TEXT];
    const lg_fit_settings *training = train_training(task);
    const bool prior = strcmp(slot->name, "prior") == 0 && training->prior > 0;
    const bool takes =
        prior ? takes_prior(&training->plan) : !slot->row->adam || lg_fit_plan_batches(&training->plan);
    if (takes) return train_refuses(task, slot);
    lg_fit_plan_show(&training->plan, plan);
    (void)snprintf(text, sizeof text, "is for %s; training by %s has no such option",
                   prior ? "ssbroyden and lbfgs" : "adam", plan);
    return text;
}

static void check_options(const app *self, const train_task *task,
                          const char *(*refuses)(const train_task *, const app_slot *)) {
    for (const app_slot *slot = self->slots; slot < self->slots + self->slot_count; slot++) {
        const char *why = slot->given ? refuses(task, slot) : NULL;
        if (why != NULL) app_stop_usage(self, "--%s: %s", slot->name, why);
    }
}

/* Removes temporary files that a killed training left in the folder of the checkpoint that is resumed:
 * taking a lock does this. */
static void tidy(const app *self, const char *checkpoint) {
    lg_lock lock;
    if (lg_lock_take(self->context, checkpoint, self->command_line, &lock, NULL) == LG_OK)
        lg_lock_release(&lock);
}

/* Checks that no output file is also an input or another output. */
static void check_files(const train_session *session) {
    app *self = session->app;
    const lg_recipe *recipe = session->task->recipe;
    const char *checkpoint = session->checkpoint;
    /* A resumed run may write its checkpoints to the file that it was resumed from. */
    const bool same = files->resume != NULL && app_same_file(files->resume, checkpoint);
    if (files->resume != NULL && !same) tidy(self, files->resume);
    self->continues = same;
    const app_path paths[] = {{"resume", same ? NULL : files->resume, LG_FILE_READ, NULL},
                              {"out", files->out, LG_FILE_WRITTEN, recipe->name},
                              {"checkpoint", checkpoint, LG_FILE_WRITTEN, recipe->checkpoint}};
    app_check_outputs(self, paths, LG_COUNT(paths));
    app_check_text(self, files->history, TRAIN_HISTORY "\n");
}

static lg_fit *fit_of(const train_session *self) {
    return self->task->training.fit;
}

/* ---- callbacks of the fit ---- */

static lg_status write_checkpoint(const train_session *self, lg_error *error) {
    const train_task *task = self->task;
    const lg_provenance provenance = app_provenance(self->app, train_training(task)->seed);
    APP_CLEAN(lg_file_writer_destroy_at) lg_file_writer *writer = NULL;
    lg_archive_writer archive;
    LG_TRY(lg_checkpoint_create(self->app->context, self->checkpoint, task->recipe, task->settings[0].values,
                                &provenance, &writer, error));
    LG_TRY(lg_file_writer_archive(writer, "fit", &archive));
    LG_TRY(lg_fit_save(fit_of(self), &archive, error));
    return lg_file_writer_commit(writer, error);
}

/* Saves the state; false, with a warning, if it cannot be written. */
static bool save_state(train_session *self) {
    self->checkpoint_error = (lg_error){LG_OK, ""};
    self->checkpoint_status = write_checkpoint(self, &self->checkpoint_error);
    if (self->checkpoint_status != LG_OK)
        app_warn(self->app, "%s", app_sentence(self->checkpoint_status, &self->checkpoint_error));
    return self->checkpoint_status == LG_OK;
}

/* A checkpoint that cannot be written does not end the training, because the next one may succeed. */
static lg_status on_checkpoint(void *user, const lg_fit *fit) {
    (void)save_state(user);
    return LG_OK;
}

static int on_epoch(void *user, const lg_fit_epoch *report) {
    train_session *self = user;
    app_progress_show(&self->progress, report->epoch, "epoch %llu/%llu  loss %.3g",
                      (unsigned long long)report->epoch, (unsigned long long)report->epochs, report->loss);
    return 0;
}

/* ---- training ---- */

lg_fit_options train_fit_options(const app *self, const lg_fit_settings *training) {
    lg_fit_options options;
    lg_fit_options_init(&options);
    lg_fit_settings_apply(training, &options);
    options.threads = (int)self->threads;
    options.ranks = self->ranks;
    return options;
}

static lg_fit_options session_options(train_session *self) {
    lg_fit_options options = train_fit_options(self->app, train_training(self->task));
    options.stop_after = files->stop_after;
    options.checkpoint = on_checkpoint;
    options.checkpoint_every = files->checkpoint_every > 0 ? files->checkpoint_every
                               : files->checkpoint != NULL ? CHECKPOINT_EVERY
                                                           : 0;
    /* The seconds that the race has left over; at least 1e-9, so that one epoch is trained. */
    const double left = files->seconds - train_race_seconds(&self->race);
    options.seconds = files->seconds > 0 ? fmax(left, 1e-9) : 0;
    options.on_epoch = on_epoch;
    options.user = self;
    return options;
}

/* Loads the state in the group /fit of the checkpoint into the fit. */
static void load_fit(const train_session *self) {
    lg_error error = {LG_OK, ""};
    lg_archive_reader archive;
    lg_status status = lg_file_reader_archive(self->reader, "fit", &archive);
    if (status == LG_OK) status = lg_fit_load(fit_of(self), &archive, &error);
    const char *more = status != LG_OK ? lg_file_reader_message(self->reader) : "";
    if (more[0] != '\0') (void)snprintf(error.message, sizeof error.message, "%s", more);
    if (status == LG_INVALID_ARGUMENT)
        app_stop(self->app, status, "%s: %s", files->resume, app_sentence(status, &error));
    app_must_file(self->app, status, &error, files->resume);
}

/* Says that the training stopped before its plan was finished, and how to continue. Its state has been
 * saved. */
static void stopped(const train_session *self, lg_status status) {
    if (self->checkpoint_status != LG_OK)
        app_stop(self->app, LG_FILE, "the state could not be saved: %s",
                 app_sentence(self->checkpoint_status, &self->checkpoint_error));
    app_note(self->app, "stopped in epoch %llu of %llu; continue with --resume %s",
             (unsigned long long)lg_fit_epochs_done(fit_of(self)) + 1,
             (unsigned long long)train_training(self->task)->epochs, self->checkpoint);
    if (status == LG_CANCELLED) app_end(APP_EXIT_INTERRUPTED);
}

/* Called after the fit has returned `status`: writes the history, then does what the status requires. Returns
 * whether the model is to be written. */
static bool conclude(train_session *self, lg_status status, const lg_error *fit_error) {
    lg_error error = {LG_OK, ""};
    lg_fit *fit = fit_of(self);
    if (files->history != NULL && lg_fit_epochs_done(fit) > 0) {
        const lg_status saved = train_save_history(files->history, fit, &error);
        if (saved != LG_OK) self->app->code = app_fail_file(self->app, saved, &error, files->history);
    }
    if (status == LG_CANCELLED || (status == LG_OK && !lg_fit_finished(fit))) {
        stopped(self, status);
        return self->app->code == APP_EXIT_OK;
    }
    /* Training failed: the state before the failed step is saved, so that nothing is lost. */
    if (status != LG_OK && lg_fit_steps_done(fit) > 0 && save_state(self))
        app_stop(self->app, status, "%s; the state before this failure is in %s",
                 app_sentence(status, fit_error), self->checkpoint);
    must(self->app, status, fit_error);
    if (lg_fit_why_finished(fit) != LG_FIT_END_EPOCHS)
        app_note(self->app, "training ended after %llu epochs: %s",
                 (unsigned long long)lg_fit_epochs_done(fit), lg_fit_end_sentence(fit));
    return self->app->code == APP_EXIT_OK;
}

static bool run_fit(train_session *self) {
    lg_error error = {LG_OK, ""};
    const double begin = app_seconds();
    app_progress_begin(&self->progress, lg_fit_epochs_done(fit_of(self)), train_training(self->task)->epochs);
    const lg_status status = lg_fit_run(fit_of(self), &error);
    app_progress_end(&self->progress);
    self->task->training.seconds = app_seconds() - begin;
    app_end_exchanges(self->app);
    if (self->app->rank == 0) return conclude(self, status, &error);
    must(self->app, status, &error);
    return false;
}

/* If the model cannot be written, or the user stops while the model is scored, saves the state in a
 * checkpoint, so that the training is not lost. Not done when several ranks train. */
static void finish(train_session *self) {
    const int code = self->app->code = train_finish(self);
    const bool kept = code == APP_EXIT_FILE || code == APP_EXIT_MEMORY || code == APP_EXIT_INTERRUPTED;
    if (kept && self->app->rank_count == 1 && save_state(self))
        app_note(self->app, "the training is kept in %s; write the model with --resume %s", self->checkpoint,
                 self->checkpoint);
}

/* ---- the run ---- */

static const lg_fit_settings *stored_training(const train_session *self) {
    return (const lg_fit_settings *)(const void *)((const char *)self->stored + self->task->recipe->training);
}

/* Opens the checkpoint of --resume. Options that were not given on the command line get the stored run's
 * values. With --preset the run is derived again from preset and options, and then compared with the stored
 * run. With --size, takes the width from the checkpoint, so that the race is not repeated. */
static void open_stored(train_session *session) {
    app *self = session->app;
    train_task *task = session->task;
    if (files->resume == NULL) return;
    void *stored = session->stored = app_keep(1, task->settings[0].size);
    APP_FILE(self, files->resume, lg_checkpoint_open, NULL, task->recipe, stored, &session->reader);
    app_slot *slot = files->size != NULL ? app_find_slot(self, "hidden") : NULL;
    if (slot != NULL && !slot->given) {
        lg_field_copy(slot->row, stored, task->settings[0].values);
        slot->given = true;
    }
    if (!app_given(self, "preset")) lg_training_adopt(&task->training, stored, false);
    if (!self->seed_given) self->seed = stored_training(session)->seed;
}

static void compare(const train_session *self) {
    const train_task *task = self->task;
    lg_error error = {LG_OK, ""};
    if (self->reader == NULL) return;
    must(self->app,
         lg_recipe_compare_runs(task->recipe, self->stored, task->settings[0].values, files->resume, &error),
         &error);
}

uint32_t train_preset_given;

const lg_field train_preset_rows[] = {
    {.name = "preset",
     .group = "",
     .usual = true,
     .type = LG_FIELD_NAME,
     .size = sizeof train_preset_given,
     .value_name = lg_preset_name,
     .otherwise = "best; thesis where Adam is asked for",
     .meaning = "Source of options that are not given: the published settings (thesis) or ours (best)"},
    LG_FIELD_END};

/* The histories of 10^6 epochs take 40 MB. */
uint64_t train_epochs(const app *self, const lg_fit_settings *training) {
    enum { NO_LIMIT = 1000000 };
    const bool limited = files->resume != NULL || app_given(self, "epochs") || !(files->seconds > 0);
    return lg_fit_plan_ends_in_batches(&training->plan) || limited ? training->epochs : NO_LIMIT;
}

/* A resumed run is also compared before the split, because other data may not be divisible in the stored
 * way. */
static void run_session(train_session *session) {
    app *self = session->app;
    train_task *task = session->task;
    lg_error error = {LG_OK, ""};
    lg_fit_settings *training = train_training(task);
    const bool again = app_given(self, "preset"), splits = task->recipe->trainer->prepare != NULL;
    training->seed = self->seed;
    must(self, train_describe(self, task, again ? NULL : session->stored, &error), &error);
    if (session->reader != NULL && !app_given(self, "epochs"))
        training->epochs = stored_training(session)->epochs;
    training->epochs = train_epochs(self, training);
    if (session->reader == NULL) check_options(self, task, train_ignores);
    /* A run derived again from --preset knows the parts of the data only after the split, so it is compared
     * only then. */
    if (!(splits && again)) compare(session);
    train_prepare(self, task);
    if (splits) compare(session);
    const lg_status learned = task->learn != NULL ? task->learn(self, NULL, &error) : LG_NOT_FOUND;
    if (learned != LG_NOT_FOUND) {
        must(self, learned, &error);
        return;
    }
    const lg_fit_options options = session_options(session);
    must(self, train_create(task, &options, &error), &error);
    if (session->reader != NULL) load_fit(session);
    if (run_fit(session)) finish(session);
}

void train_main(app *self, train_task *task) {
    train_session session = {.app = self, .task = task, .checkpoint = checkpoint_path()};
    lg_error error = {LG_OK, ""};
    train_begin(self, task, 0);
    if (task->check != NULL) must(self, task->check(self, &error), &error);
    check_options(self, task, train_refuses);
    check_files(&session);
    app_read_options(self);
    train_read(self, task);
    train_size(self, task, files->size, &session.race);
    open_stored(&session);
    app_read_options(self);
    run_session(&session);
    lg_file_reader_destroy(session.reader);
    lg_training_close(&task->training);
}

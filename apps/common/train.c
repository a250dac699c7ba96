/* The train driver: from the command line to the end of training. */
#include "common/train.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model/files/learning.h"

enum { CHECKPOINT_EVERY = 10 };

train_files train_given_files;

/* --size is first: TRAIN_SHARED_NO_SIZE begins after it. */
const lg_field train_file_options[] = {TRAIN_SIZE_ROW, TRAIN_FILE_ROWS("Draw the loss"), LG_FIELD_END};

static const train_files *const files = &train_given_files;

static int fail(const app *self, lg_status status, const lg_error *error) {
    return app_fail(self, status, "%s", app_sentence(status, error));
}

lg_status train_no_room(size_t parameters, lg_error *error) {
    return app_error(error, LG_OUT_OF_MEMORY, "out of memory: the network has %zu parameters", parameters);
}

lg_provenance app_provenance(const app *self, uint64_t seed) {
    lg_provenance provenance = {.has_seed = true, .seed = seed};
    (void)snprintf(provenance.command, sizeof provenance.command, "%s", self->command_line);
    (void)lg_cpu_describe(provenance.cpu, sizeof provenance.cpu);
    return provenance;
}

/* ---- before training: options and files ---- */

/* Where the state goes: --checkpoint, or beside --out. Freed with free. */
static char *checkpoint_path(void) {
    return files->checkpoint != NULL ? app_format("%s", files->checkpoint)
                                     : app_format("%s.checkpoint", files->out);
}

static const lg_field *method_row(const train_task *task, void **values) {
    const app_settings *settings = task->settings;
    for (; task->method != NULL && settings->rows != NULL; settings++) {
        *values = settings->values;
        const lg_field *row = lg_field_find(settings->rows, task->method);
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
    (void)snprintf(text, sizeof text, "--%s %s", task->method, lg_field_name(method, number));
    return text;
}

static int check_options(const app *self, const train_task *task) {
    for (size_t i = 0; i < self->slot_count; i++) {
        const char *refuses = self->slots[i].given ? train_refuses(task, &self->slots[i]) : NULL;
        if (refuses != NULL)
            return app_usage(self, "--%s: %s has no such option", self->slots[i].name, refuses);
    }
    return APP_EXIT_OK;
}

/* What a killed training left beside the checkpoint that is resumed. Another one may be at work on it. */
static void tidy(const app *self, const char *checkpoint) {
    lg_lock lock;
    if (lg_lock_take(self->context, checkpoint, self->command_line, &lock, NULL) != LG_OK) return;
    lg_temporary_sweep(self->context, checkpoint);
    lg_lock_release(&lock);
}

/* --out is given, and no file is replaced that is read or written as another one. */
static int check_files(app *self, const train_task *task) {
    if (files->out == NULL) return app_usage(self, "--out FILE is missing");
    const app_slot *kept = task->kept != NULL ? app_find_slot(self, task->kept) : NULL;
    char *checkpoint = checkpoint_path();
    /* A run may go on in the checkpoint that it came from. */
    const bool same = files->resume != NULL && app_same_file(files->resume, checkpoint);
    if (files->resume != NULL && !same) tidy(self, files->resume);
    const app_path paths[] = {
        {"resume", same ? NULL : files->resume, LG_FILE_READ},
        {task->kept,
         kept != NULL ? *(const char *const *)((const char *)kept->values + kept->row->offset) : NULL,
         LG_FILE_READ},
        {"out", files->out, LG_FILE_WRITTEN},
        {"checkpoint", checkpoint, LG_FILE_WRITTEN},
        {"history", files->history, LG_FILE_WRITTEN},
        {"plot", files->plot, LG_FILE_DRAWN}};
    const int code = app_check_outputs(self, paths, LG_COUNT(paths));
    free(checkpoint);
    return code;
}

/* ---- callbacks of the fit ---- */

static lg_status save_checkpoint(const train_session *self, const char *path, const lg_fit *fit,
                                 lg_error *error) {
    const train_task *task = self->task;
    const lg_provenance provenance = app_provenance(self->app, task->training->seed);
    lg_file_writer *writer = NULL;
    lg_archive_writer archive;
    lg_status status = lg_checkpoint_create(self->app->context, path, task->kind, task->settings[0].values,
                                            &provenance, &writer, error);
    if (status == LG_OK) status = lg_file_writer_archive(writer, "fit", &archive);
    if (status == LG_OK) status = lg_fit_save(fit, &archive, error);
    if (status == LG_OK) status = lg_file_writer_commit(writer, error);
    lg_file_writer_destroy(writer);
    return status;
}

/* A checkpoint that cannot be written does not end the training: the next one may succeed. */
static lg_status on_checkpoint(void *user, const lg_fit *fit) {
    train_session *self = user;
    char *path = checkpoint_path();
    self->checkpoint_error = (lg_error){LG_OK, ""};
    self->checkpoint_status = save_checkpoint(self, path, fit, &self->checkpoint_error);
    if (self->checkpoint_status != LG_OK)
        app_warn(self->app, "%s", app_sentence(self->checkpoint_status, &self->checkpoint_error));
    free(path);
    return LG_OK;
}

static int on_epoch(void *user, const lg_fit_epoch *report) {
    train_session *self = user;
    app_progress_show(&self->progress, report->epoch, "epoch %llu/%llu  loss %.3g",
                      (unsigned long long)report->epoch, (unsigned long long)report->epochs, report->loss);
    return 0;
}

/* ---- training ---- */

lg_fit_options train_fit_options(const app *self, const lg_training *training) {
    lg_fit_options options;
    lg_fit_options_init(&options);
    lg_training_apply(training, &options);
    options.threads = (int)self->threads;
    options.ranks = self->ranks;
    return options;
}

static lg_fit_options session_options(train_session *self) {
    lg_fit_options options = train_fit_options(self->app, self->task->training);
    options.stop_after = files->stop_after;
    options.checkpoint = on_checkpoint;
    options.checkpoint_every = files->checkpoint_every > 0 ? files->checkpoint_every
                               : files->checkpoint != NULL ? CHECKPOINT_EVERY
                                                           : 0;
    /* What the race has left; at least one epoch. */
    const double left = files->seconds - train_race_seconds(&self->race);
    options.seconds = files->seconds > 0 ? fmax(left, 1e-9) : 0;
    options.on_epoch = on_epoch;
    options.user = self;
    return options;
}

/* The state below /fit of an open checkpoint becomes the fit's. */
static int load_fit(train_session *self, lg_file_reader *stored) {
    lg_error error = {LG_OK, ""};
    lg_archive_reader archive;
    lg_status status = lg_file_reader_archive(stored, "fit", &archive);
    if (status == LG_OK) status = lg_fit_load(self->fit, &archive, &error);
    if (status == LG_OK) return APP_EXIT_OK;
    const char *more = lg_file_reader_message(stored);
    if (more[0] != '\0') (void)snprintf(error.message, sizeof error.message, "%s", more);
    if (status == LG_INVALID_ARGUMENT)
        return app_fail(self->app, status, "%s: %s", files->resume, app_sentence(status, &error));
    return app_fail_file(self->app, status, &error, files->resume);
}

/* Training broke down: the state before the step that failed is kept: nothing is lost. */
static int broken(train_session *self, lg_status status, const lg_error *fit_error) {
    if (lg_fit_steps_done(self->fit) > 0) {
        (void)on_checkpoint(self, self->fit);
        if (self->checkpoint_status == LG_OK) {
            char *path = checkpoint_path();
            const int code = app_fail(self->app, status, "%s; the state before it is in %s",
                                      app_sentence(status, fit_error), path);
            free(path);
            return code;
        }
    }
    return fail(self->app, status, fit_error);
}

/* What is said about a training that stopped before the plan was finished; its state has been saved. */
static int stopped(const train_session *self, lg_status status) {
    if (self->checkpoint_status != LG_OK)
        return app_fail(self->app, LG_FILE, "the state could not be saved: %s",
                        app_sentence(self->checkpoint_status, &self->checkpoint_error));
    char *path = checkpoint_path();
    (void)fprintf(stderr, "%s: stopped in epoch %llu of %llu; continue with --resume %s\n", self->app->title,
                  (unsigned long long)lg_fit_epochs_done(self->fit) + 1,
                  (unsigned long long)self->task->training->epochs, path);
    free(path);
    return status == LG_CANCELLED ? APP_EXIT_INTERRUPTED : APP_EXIT_OK;
}

/* The fit has returned `status`: history, then what the status asks for. */
static int conclude(train_session *self, lg_status status, const lg_error *fit_error) {
    lg_error error = {LG_OK, ""};
    int code = APP_EXIT_OK;
    if (files->history != NULL) {
        const lg_status saved = train_save_history(files->history, self->fit, &error);
        if (saved != LG_OK) code = app_fail_file(self->app, saved, &error, files->history);
    }
    if (status == LG_CANCELLED || (status == LG_OK && !lg_fit_finished(self->fit))) {
        const int more = stopped(self, status);
        return more == APP_EXIT_OK ? code : more;
    }
    if (status != LG_OK) return broken(self, status, fit_error);
    if (lg_fit_why_finished(self->fit) != LG_FIT_END_EPOCHS)
        (void)fprintf(stderr, "%s: training ended after %llu epochs: %s\n", self->app->title,
                      (unsigned long long)lg_fit_epochs_done(self->fit), lg_fit_end_sentence(self->fit));
    return code;
}

static int run_fit(train_session *self) {
    lg_error error = {LG_OK, ""};
    const double begin = app_seconds();
    app_progress_begin(&self->progress, lg_fit_epochs_done(self->fit), self->task->training->epochs);
    const lg_status status = lg_fit_run(self->fit, &error);
    app_progress_end(&self->progress);
    self->seconds = app_seconds() - begin;
    app_end_exchanges(self->app);
    return self->app->rank == 0 ? conclude(self, status, &error) : app_exit_code(status);
}

/* What was trained is not lost when there is no room for the model: the state is saved, by one process. */
static int finish(train_session *self) {
    const int code = self->task->finish(self->task->user, self);
    if ((code != APP_EXIT_FILE && code != APP_EXIT_MEMORY) || self->app->rank_count > 1) return code;
    (void)on_checkpoint(self, self->fit);
    if (self->checkpoint_status != LG_OK) return code;
    char *path = checkpoint_path();
    (void)fprintf(stderr, "%s: the training is kept in %s; write the model with --resume %s\n",
                  self->app->title, path, path);
    free(path);
    return code;
}

/* With the run complete and the data split. */
static int train(train_session *self, lg_file_reader *stored) {
    const train_task *task = self->task;
    lg_error error = {LG_OK, ""};
    const lg_fit_options options = session_options(self);
    const lg_status status = task->create(task->user, self->app, &options, &self->fit, &error);
    int code = status == LG_OK ? APP_EXIT_OK : fail(self->app, status, &error);
    if (code == APP_EXIT_OK && stored != NULL) code = load_fit(self, stored);
    if (code == APP_EXIT_OK) code = run_fit(self);
    return code == APP_EXIT_OK && self->app->rank == 0 ? finish(self) : code;
}

/* ---- what has come of it ---- */

/* A result that learned something is below `learned` of a simple guess; one that is above `enormous` of it
 * after more than one epoch has diverged. A run shorter than LOOK epochs, or FULL_LOOK
 * evaluations of a full-batch method, may still be on its way. */
static const double learned = 0.99, enormous = 1000.0;
enum { LOOK = 10, FULL_LOOK = 100 };

/* The epoch whose parameters are the model: the best one on a validation part, or else the last one. */
static uint64_t model_epoch(const train_session *self) {
    const uint64_t done = lg_fit_epochs_done(self->fit);
    return done > 0 && isfinite(lg_fit_history(self->fit, LG_FIT_VALIDATION)[done - 1])
               ? lg_fit_best_epoch(self->fit)
               : done;
}

int train_judge(const train_session *self, const char *what, double error, const char *guess,
                double guessed) {
    const uint64_t done = lg_fit_epochs_done(self->fit), epoch = model_epoch(self);
    const double *loss = lg_fit_history(self->fit, LG_FIT_LOSS);
    const bool adam = lg_fit_plan_ends_in_batches(&self->task->training->plan),
               looked = done >= (adam ? LOOK : FULL_LOOK);
    const bool useless = guessed > 0 && !(error < learned * guessed);
    const bool risen = epoch > 1 && !(loss[epoch - 1] < loss[0]);
    if (useless)
        app_warn(self->app,
                 "the model has learned nothing: its %s %.3g is not below %.3g, that of %s; %strain longer",
                 what, error, guessed, guess, adam ? "decrease --lr, or " : "");
    if (risen)
        app_warn(self->app, "the loss has not fallen: %.3g in epoch %llu, %.3g in the first one%s",
                 loss[epoch - 1], (unsigned long long)epoch, loss[0], adam ? "; decrease --lr" : "");
    const bool diverged = useless && done > 1 && error > enormous * guessed;
    const bool failed = (useless && risen) || diverged || ((useless || risen) && looked);
    return failed && lg_fit_finished(self->fit) ? APP_EXIT_NUMERIC : APP_EXIT_OK;
}

/* ---- the run ---- */

/* A stored run; its copy is compared with the run that data and options describe. */
typedef struct stored_run {
    lg_file_reader *reader; /* NULL: nothing is resumed */
    void *run;
} stored_run;

/* The member of the stored run that task->training is of the run. */
static const lg_training *stored_training(const train_task *task, const stored_run *stored) {
    const ptrdiff_t offset = (const char *)task->training - (const char *)task->settings[0].values;
    return (const lg_training *)(const void *)((const char *)stored->run + offset);
}

/* The preset says once more what the stored run should be, and is compared with it. */
static bool derives_again(const app *self) {
    return app_given(self, "preset");
}

/* What a race chose is not raced again. */
static void adopt_size(app *self, const app_settings *settings, const void *from) {
    app_slot *slot = app_find_slot(self, "hidden");
    if (files->size == NULL || slot == NULL || slot->given) return;
    lg_field_copy(slot->row, from, settings->values);
    slot->given = true;
}

/* What was not given on the command line becomes the stored run's. */
static int open_stored(app *self, const train_task *task, stored_run *stored) {
    lg_error error = {LG_OK, ""};
    if (files->resume == NULL) return APP_EXIT_OK;
    stored->run = app_alloc(1, task->settings[0].size);
    const lg_status status = lg_checkpoint_open(self->context, files->resume, NULL, task->kind, stored->run,
                                                &stored->reader, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, files->resume);
    adopt_size(self, &task->settings[0], stored->run);
    if (!derives_again(self)) app_adopt(self, &task->settings[0], stored->run, false);
    if (!self->seed_given) self->seed = stored_training(task, stored)->seed;
    return APP_EXIT_OK;
}

static int compare(const app *self, const train_task *task, const stored_run *stored) {
    lg_error error = {LG_OK, ""};
    if (stored->reader == NULL) return APP_EXIT_OK;
    const lg_status status =
        lg_run_compare(task->kind, stored->run, task->settings[0].values, files->resume, &error);
    return status == LG_OK ? APP_EXIT_OK : fail(self, status, &error);
}

static bool is_plan(const app_slot *slot) {
    return slot->row->type == LG_FIELD_PHRASE;
}

static bool asks_adam(const app *self, const lg_training *training) {
    bool adam = training->dtype == LG_F32;
    for (size_t i = 0; i < self->slot_count; i++) {
        const app_slot *slot = &self->slots[i];
        if (slot->given && is_plan(slot)) return lg_fit_plan_ends_in_batches(&training->plan);
        adam = adam || (slot->given && slot->row->adam);
    }
    return adam;
}

uint32_t train_preset_given;

const lg_field train_preset_rows[] = {
    {.name = "preset",
     .group = "",
     .type = LG_FIELD_NAME,
     .size = sizeof train_preset_given,
     .value_name = lg_preset_name,
     .otherwise = "best; thesis where Adam is asked for",
     .meaning = "Source of options that are not given: the published settings or ours"},
    LG_FIELD_END};

const char *train_preset(const app *self, const lg_training *training) {
    if (app_given(self, "preset")) return lg_preset_name(train_preset_given);
    return asks_adam(self, training) ? "thesis" : "best";
}

/* A method of the plan learns with the prior: one that minimises any loss. */
static bool takes_prior(const lg_fit_plan *plan) {
    bool takes = false;
    for (uint32_t i = 0; i < plan->phases; i++) {
        const lg_fit_method method = (lg_fit_method)plan->phase[i].method;
        takes = takes || !(lg_fit_method_batches(method) || lg_fit_method_squares(method));
    }
    return takes;
}

/* Options that the plan has no use for: a prior, those of Adam. */
static int check_method(const app *self, const train_task *task) {
    char plan[LG_FIT_PLAN_TEXT];
    lg_fit_plan_show(&task->training->plan, plan);
    const bool prior = app_given(self, "prior") && task->training->prior > 0;
    if (prior && !task->prior) return app_usage(self, "--prior: this training has no use for it");
    if (prior && !takes_prior(&task->training->plan))
        return app_usage(self, "--prior: is for ssbroyden and lbfgs; training by %s has no such option",
                         plan);
    if (lg_fit_plan_batches(&task->training->plan)) return APP_EXIT_OK;
    for (size_t i = 0; i < self->slot_count; i++) {
        const app_slot *slot = &self->slots[i];
        if (slot->given && slot->row->adam)
            return app_usage(self, "--%s: is for adam; training by %s has no such option", slot->name, plan);
    }
    return APP_EXIT_OK;
}

/* Room for 10^6 epochs takes 40 MB. */
uint64_t train_epochs(const app *self, const lg_training *training) {
    enum { NO_LIMIT = 1000000 };
    const bool limited = files->resume != NULL || app_given(self, "epochs") || !(files->seconds > 0);
    return lg_fit_plan_ends_in_batches(&training->plan) || limited ? training->epochs : NO_LIMIT;
}

/* The data are compared before they are split, too: others need not be split in the same way. */
static int run_with(app *self, const train_task *task, stored_run *stored, const train_race *race) {
    lg_error error = {LG_OK, ""};
    train_session session = {.app = self, .task = task, .race = *race, .floor = (double)NAN};
    task->training->seed = self->seed;
    const lg_status status = task->describe(
        task->user, self, stored->reader != NULL && !derives_again(self) ? stored->run : NULL, &error);
    int code = status == LG_OK ? APP_EXIT_OK : fail(self, status, &error);
    if (stored->reader != NULL && !app_given(self, "epochs"))
        task->training->epochs = stored_training(task, stored)->epochs;
    task->training->epochs = train_epochs(self, task->training);
    if (code == APP_EXIT_OK && stored->reader == NULL) code = check_method(self, task);
    /* What is derived again knows the parts of the data after the split alone. */
    if (code == APP_EXIT_OK && (task->prepare == NULL || !derives_again(self)))
        code = compare(self, task, stored);
    if (code == APP_EXIT_OK && task->prepare != NULL) {
        code = task->prepare(task->user, self);
        if (code == APP_EXIT_OK) code = compare(self, task, stored);
    }
    if (code == APP_EXIT_OK) code = train(&session, stored->reader);
    task->release(task->user);
    return code;
}

int train_check(app *self, const train_task *task) {
    const int code = check_options(self, task);
    return code == APP_EXIT_OK ? check_files(self, task) : code;
}

int train_main(app *self, const train_task *task) {
    char sha256[LG_SHA256_TEXT];
    stored_run stored = {NULL, NULL};
    train_race race;
    int code = train_check(self, task);
    if (code == APP_EXIT_OK) code = task->read(task->user, self, self->arguments[0], sha256);
    if (code == APP_EXIT_OK) code = train_size(self, task, files->size, &race);
    if (code == APP_EXIT_OK) code = open_stored(self, task, &stored);
    if (code == APP_EXIT_OK) code = run_with(self, task, &stored, &race);
    lg_file_reader_destroy(stored.reader);
    free(stored.run);
    return code;
}

/* ---- results ---- */

/* `epochs` are those that are done, and a row that is no option is another's (the seed apart). */
static void json_run(app_json *json, const app_settings *settings) {
    for (const lg_field *row = settings->rows; row->name != NULL; row++) {
        const bool option = row->option == NULL || row->option[0] != '\0';
        if (strcmp(row->name, "epochs") != 0 && (option || strcmp(row->name, "seed") == 0))
            app_json_field(json, row, settings->values);
    }
}

/* How many, and of the time of this process the part for its shards and that for exchanges. */
static void json_ranks(const train_session *self, app_json *json) {
    const lg_fit_cost cost = lg_fit_cost_of(self->fit);
    app_json_size(json, "ranks", self->app->rank_count);
    app_json_real(json, "training_seconds", cost.seconds);
    app_json_real(json, "shard_seconds", cost.shard_seconds);
    app_json_real(json, "exchange_seconds", cost.exchange_seconds);
    app_json_size(json, "exchanges", cost.exchanges);
    app_json_size(json, "exchanged_bytes", cost.bytes);
}

void train_json(const train_session *self, app_json *json) {
    char cpu[256];
    const lg_fit *fit = self->fit;
    const uint64_t done = lg_fit_epochs_done(fit);
    (void)lg_cpu_describe(cpu, sizeof cpu);
    app_json_size(json, "epochs", done);
    app_json_size(json, "evaluations", done);
    app_json_real(json, "floor", self->floor);
    app_json_real(json, "running_loss", lg_fit_loss(fit));
    app_json_real(json, "validation_loss",
                  done > 0 ? lg_fit_history(fit, LG_FIT_VALIDATION)[done - 1] : (double)NAN);
    app_json_size(json, "best_epoch", lg_fit_best_epoch(fit));
    app_json_bool(json, "finished", lg_fit_finished(fit));
    app_json_text(json, "stopped", lg_fit_finished(fit) ? lg_fit_end_sentence(fit) : NULL);
    app_json_real(json, "seconds_per_epoch", lg_fit_seconds_per_epoch(fit));
    app_json_real(json, "seconds", self->seconds);
    app_json_size(json, "threads", self->app->threads);
    json_ranks(self, json);
    app_json_size(json, "steps", lg_fit_steps_done(fit));
    app_json_size(json, "tape_bytes", lg_fit_tape_size(fit));
    app_json_text(json, "cpu", cpu);
    app_json_text(json, "out", files->out);
    json_run(json, &self->task->settings[0]);
    train_size_json(&self->race, json);
    app_json_warnings(json, self->app);
}

static void csv_number(FILE *stream, double value) {
    if (isfinite(value))
        (void)fprintf(stream, ",%.17g", value);
    else
        (void)fputc(',', stream);
}

lg_status train_save_history(const char *path, const lg_fit *fit, lg_error *error) {
    static const lg_fit_series columns[] = {LG_FIT_LOSS, LG_FIT_VALIDATION, LG_FIT_RATE, LG_FIT_SECONDS};
    app_file file;
    app_file_begin(&file, path);
    (void)fputs("epoch,loss,validation,rate,seconds\n", file.stream);
    for (uint64_t epoch = 0; epoch < lg_fit_epochs_done(fit); epoch++) {
        (void)fprintf(file.stream, "%llu", (unsigned long long)(epoch + 1));
        for (size_t c = 0; c < LG_COUNT(columns); c++)
            csv_number(file.stream, lg_fit_history(fit, columns[c])[epoch]);
        (void)fputc('\n', file.stream);
    }
    return app_file_end(&file, error);
}

lg_status train_draw_loss(const app *self, const char *picture, const double *loss, const double *validation,
                          size_t epochs, lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 800, 500);
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
    return app_plot_end(self, &plot, error);
}

int train_draw(const train_session *self) {
    lg_error error = {LG_OK, ""};
    const char *picture = files->plot;
    if (picture == NULL) return APP_EXIT_OK;
    const double *validation =
        self->task->training->validation > 0 ? lg_fit_history(self->fit, LG_FIT_VALIDATION) : NULL;
    const lg_status status = train_draw_loss(self->app, picture, lg_fit_history(self->fit, LG_FIT_LOSS),
                                             validation, (size_t)lg_fit_epochs_done(self->fit), &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self->app, status, &error, picture);
}

/* What every `train` command shares: its options for files, and everything from the command line to the end
 * of training: --resume, checkpoints, progress, Ctrl-C, --history, exit codes, JSON.
 *
 * A command fills a train_task and calls train_main(...). The trainer of the task's recipe
 * (model/files/training.h) does what is special to a kind of model. The rows of settings[0] are the
 * hyperparameters: checkpoints store them, and a resumed run is compared with them. The search driver
 * (common/search.h) trains the same task.
 *
 * Functions that return int return an exit code; if it is not APP_EXIT_OK, they have printed why. Functions
 * that return a status explain it in `error`; in those that return nothing an error ends the command. */
#ifndef LG_APPS_TRAIN_DRIVER_H
#define LG_APPS_TRAIN_DRIVER_H

#include "common/app.h"
#include "core/clean.h"
#include "liegrad/fit.h"
#include "liegrad/model.h"
#include "model/files/training.h"

typedef struct train_files {
    const char *out, *checkpoint, *resume, *history, *size;
    uint64_t checkpoint_every, stop_after;
    double seconds;
} train_files;

/* The values from the command line, and the table of these options, which a command lists in its settings.
 * TRAIN_SHARED_NO_SIZE leaves out --size, for a command whose trainer has no `sizes`. */
extern train_files train_given_files;
extern const lg_field train_file_options[];
#define TRAIN_SIZE(type, ...) LG_OPTION(type, size, STRING, "auto|W,...", __VA_ARGS__, .usual = true)
#define TRAIN_SHARED          APP_GIVEN(train_file_options, train_given_files)
#define TRAIN_SHARED_NO_SIZE  APP_GIVEN(train_file_options + 1, train_given_files)
#define TRAIN_STOPS                                                                                          \
    "Ctrl-C saves a checkpoint and ends with exit code 130; --resume continues to the same bits. While "     \
    "--size auto tries widths there is no checkpoint."
typedef struct train_task {
    const lg_recipe *recipe;
    const app_settings *settings; /* the command's settings; the first one describes the run */
    const char *const *searched;  /* the methods that a search may train, ended by NULL; NULL: all methods */
    /* Rejects options that cannot be combined. The message begins with an option. May be NULL. */
    lg_status (*check)(const app *app, lg_error *error);
    /* Trains by a method that the recipe does not train; returns LG_NOT_FOUND for other methods. The data are
     * read and split. If trial is NULL, writes the model and reports. Otherwise sets parameters and objective
     * of this trial of a search. May be NULL. */
    lg_status (*learn)(const app *app, lg_trial *trial, lg_error *error);
    const app_command *command;                 /* the command `train`, for a search */
    void *state;                                /* the trainer's state; if NULL, train_begin allocates it */
    void (*print)(const lg_training *training); /* prints more than the results for people; may be NULL */
    /* The bits that `needs` and `usual` of the command's plots mean, for data that are read and split; NULL:
     * none. What is drawn is the training, or what `draw` gives to app_plot_draw. */
    unsigned (*has)(const lg_training *training);
    void (*draw)(const app *app, const lg_training *training);
    lg_training training; /* set and used by the driver */
} train_task;

/* The race of --size auto (size.c). */
#define TRAIN_LANES 8
typedef struct train_lane {
    const char *size;
    size_t parameters;
    double validation, forecast; /* lowest validation loss; its forecast for twice as many epochs */
    double seconds;
} train_lane;

typedef struct train_race {
    train_lane lane[TRAIN_LANES];
    size_t count, winner;
} train_race;

/* Sets the option "hidden" to `size`; NULL leaves it. "auto" chooses the width by a race: networks of
 * increasing size are trained for half of the epochs on four fifths of the data, all together for at most a
 * third of --seconds. The race ends when two networks in a row are no better than a smaller one. The winner
 * is the smallest network whose forecast is at most twice the lowest forecast (at most equal to it while its
 * loss still falls fast). Says on stderr which one it is. */
void train_size(app *app, train_task *task, const char *size, train_race *race);
double train_race_seconds(const train_race *race); /* the part of --seconds that the race took */
/* writes "sizes"; nothing if there was no race */
void train_size_json(const train_race *race, app_json *json);
/* The planned number of epochs. It is 10^6 if the training ends with a method other than Adam and only
 * --seconds limits it. */
uint64_t train_epochs(const app *app, const lg_fit_settings *training);

/* A training that is running or has ended. */
typedef struct train_session {
    app *app;
    train_task *task;
    train_race race;
    const char *checkpoint; /* path: --checkpoint, else a name made from --out */
    /* The run that is resumed (NULL: none), which is compared with what data and options describe. */
    lg_file_reader *reader;
    void *stored;
    app_progress progress;
    lg_status checkpoint_status;
    lg_error checkpoint_error;
} train_session;

void train_main(app *app, train_task *task);

/* ---- parts of train_main, also used by race and search ---- */

static inline lg_fit_settings *train_training(const train_task *task) {
    return lg_training_settings(&task->training);
}
/* Ends the command if the error is about the command line: its message begins with an option. */
void train_check_usage(const app *app, lg_status status, const lg_error *error);
/* Prepares task->training; its data files are the command's arguments from index `argument` on. */
void train_begin(const app *app, train_task *task, int argument);
void train_read(const app *app, train_task *task);
/* Completes the run from the options that were given to `app`. `stored`: the run that is resumed, or NULL. */
lg_status train_describe(const app *app, train_task *task, const void *stored, lg_error *error);
/* Splits the data, and checks that the plot exists. */
void train_prepare(const app *app, train_task *task);
lg_status train_create(train_task *task, const lg_fit_options *options, lg_error *error);
/* Called when the training has done all that was asked: judges and writes the model, draws and reports. */
int train_finish(train_session *session);
/* Adds results number `first` to `end` - 1 of the training to a command's results. */
void train_put_results(app_json *out, const lg_training *training, size_t first, size_t end);
/* The option --preset, one of the settings of a task (lg_training_preset). */
extern const lg_field train_preset_rows[];
extern uint32_t train_preset_given;
#define TRAIN_PRESET                                                                                         \
    { train_preset_rows, &train_preset_given, sizeof train_preset_given }
/* Options of the fit: the run's hyperparameters, and app's threads and ranks. */
lg_fit_options train_fit_options(const app *app, const lg_fit_settings *training);
/* Why the chosen method, as in "--network angle", does not have the option `slot`; NULL if it has. The text
 * is in static storage. */
const char *train_refuses(const train_task *task, const app_slot *slot);
/* The same after train_describe, when the plan of the training is known: an option that it does not use is
 * rejected too. */
const char *train_ignores(const train_task *task, const app_slot *slot);

/* ---- parts for other commands ---- */

LG_AT(lg_file_writer_destroy, lg_file_writer)
lg_provenance app_provenance(const app *app, uint64_t seed);
/* Writes a CSV file with these columns. */
#define TRAIN_HISTORY "epoch,loss,validation,rate,seconds"
lg_status train_save_history(const char *path, const lg_fit *fit, lg_error *error);
/* A row of the plots of a command: the loss over the epochs, and that of the validation part if there is one.
 * train_plots has this row only. */
void train_put_loss(app_plot *plot, const void *training);
extern const app_plot_kind train_plots[];
void train_draw(const app *app, const train_task *task); /* the plot of --plot, if it was given */

#endif

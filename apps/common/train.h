/* What every `train` command shares: its options for files, and the course from the command line to the end
 * of training: --resume, checkpoints, progress, Ctrl-C, --history, exit codes, JSON.
 *
 * A command gives a train_task and returns train_main(...). The learner of the task's recipe
 * (model/files/learning.h) does what a kind of model needs. The rows of settings[0] are the hyperparameters,
 * checkpoints hold them, and a resumed run is compared with them. The search driver (common/search.h) trains
 * the same task.
 *
 * Functions that return int return an exit code, and have told the user when it is not APP_EXIT_OK; those
 * that return a status explain it in `error`. */
#ifndef LG_APPS_TRAIN_DRIVER_H
#define LG_APPS_TRAIN_DRIVER_H

#include "common/app.h"
#include "liegrad/io.h"
#include "liegrad/nn.h"
#include "model/files/learning.h"

typedef struct train_files {
    const char *out, *checkpoint, *resume, *history, *plot, *size;
    uint64_t checkpoint_every, stop_after;
    double seconds;
} train_files;

/* What the command line gave, and its options, which stand among the settings of a command.
 * TRAIN_SHARED_NO_SIZE is for a command whose learner has no `sizes`. */
extern train_files train_given_files;
extern const lg_field train_file_options[];
#define TRAIN_SHARED         APP_GIVEN(train_file_options, train_given_files)
#define TRAIN_SHARED_NO_SIZE APP_GIVEN(train_file_options + 1, train_given_files)
#define TRAIN_SIZE_ROW                                                                                       \
    LG_OPTION(train_files, size, STRING, "auto|W,...",                                                       \
              "auto: choose --hidden by a race of a few widths on a validation part, each for half of "      \
              "the epochs and all for a third of --seconds, which counts them; else as --hidden")
/* The same for a command whose --plot draws something else than the loss. */
#define TRAIN_FILE_ROWS(drawn)                                                                               \
    LG_OPTION(train_files, out, STRING, "FILE", "The model file to write"),                                  \
        LG_OPTION(                                                                                           \
            train_files, checkpoint, STRING, "FILE",                                                         \
            "File for the state (default: FILE of --out with .checkpoint appended, when stopped early)"),    \
        LG_OPTION(train_files, checkpoint_every, U64, "n",                                                   \
                  "Number of epochs between checkpoints (default 10 with --checkpoint)", .low = 1,           \
                  .high = 1e9),                                                                              \
        LG_OPTION(train_files, stop_after, U64, "n", "Save the state and stop after n epochs of this run",   \
                  .low = 1, .high = 1e9),                                                                    \
        LG_OPTION(                                                                                           \
            train_files, seconds, REAL, "S",                                                                 \
            "Stop after so many seconds of training; with a method other than adam and no --epochs this is " \
            "the only limit",                                                                                \
            .high = 1e9),                                                                                    \
        LG_OPTION(train_files, resume, STRING, "FILE",                                                       \
                  "Continue from a checkpoint; the result has the same bits as one run. Options not given "  \
                  "are the checkpoint's"),                                                                   \
        LG_OPTION(train_files, history, STRING, "FILE.csv",                                                  \
                  "Write one row for each epoch: epoch, loss, validation, rate, seconds"),                   \
        LG_OPTION(train_files, plot, STRING, "FILE.svg|.png",                                                \
                  drawn "; its data and script stay beside it, as FILE.dat and FILE.gp")

/* A training while it goes on and after it. */
typedef struct train_session train_session;

typedef struct train_task {
    const lg_recipe *recipe;
    const app_settings *settings; /* the command's; the first one is the run */
    const char *only;             /* a search takes this method alone; NULL: any */
    void *state;                  /* the learner's state; NULL: train_begin allocates it */
    /* Called with the data split, before training; returns an exit code. May be NULL. */
    int (*check)(const app *app, const lg_learning *learning);
    /* Prints for people what came out; NULL: prints the results, a line each. */
    void (*print)(const lg_learning *learning);
    int (*draw)(const app *app, const lg_learning *learning); /* NULL: the loss */
    lg_learning learning;                                     /* the driver's */
} train_task;

/* The race of --size auto (size.c). */
#define TRAIN_LANES 8
typedef struct train_lane {
    const char *size;
    size_t parameters;
    double validation, forecast; /* lowest loss of the validation part; after as many epochs again */
    double seconds;
} train_lane;

typedef struct train_race {
    train_lane lane[TRAIN_LANES];
    size_t count, winner;
} train_race;

/* Sets the row "hidden" to `size` (NULL: nothing to do), or for "auto" to the winner of a race: each size is
 * trained for half of the epochs on four fifths of the data, all of them for at most a third of --seconds,
 * until two in a row are no better than a smaller one; the smallest one wins whose forecast is within twice
 * the lowest. Prints the table on stderr. */
int train_size(app *app, train_task *task, const char *size, train_race *race);
double train_race_seconds(const train_race *race);            /* of --seconds, for the race */
void train_size_json(const train_race *race, app_json *json); /* "sizes", unless there was no race */
/* The planned epochs: 10^6 where --seconds alone limits a method other than Adam. */
uint64_t train_epochs(const app *app, const lg_training *training);

struct train_session {
    app *app;
    train_task *task;
    train_race race;
    app_progress progress;
    lg_status checkpoint_status;
    lg_error checkpoint_error;
};

int train_main(app *app, train_task *task);
/* The beginning of train_main, for a command that also trains without a recipe: options and files are
 * checked, the data are read. An exit code; then lg_learning_close, whatever it is. */
int train_open(app *app, train_task *task);
/* Results of a model file's contents on the arguments from the second on; the command ends where there are
 * none. APP_EXIT_NUMERIC: they are of no use, and a warning said why. */
int train_evaluate(const app *app, train_task *task, const void *file);

/* ---- parts, for training, race and search ---- */

static inline lg_training *train_training(const train_task *task) {
    return lg_learning_training(&task->learning);
}
/* Begins the task's learning with the command's arguments from number `argument` on. */
void train_begin(const app *app, train_task *task, int argument);
int train_read(const app *app, train_task *task);
/* What the app was given completes the run; `stored`: the run that is resumed. */
lg_status train_describe(const app *app, train_task *task, const void *stored, lg_error *error);
/* Splits the data; the task's check. */
int train_prepare(const app *app, train_task *task);
lg_status train_create(train_task *task, const lg_fit_options *options, lg_error *error);
/* The plan was carried out as far as asked: judges, writes the model, draws and reports. */
int train_finish(train_session *session);
/* Adds the results number first to end - 1 of the learning to the results of a command. */
void train_put_results(app_json *out, const lg_learning *learning, size_t first, size_t end);
/* The option --preset, a row of a task's settings (lg_learning_preset). */
extern const lg_field train_preset_rows[];
extern uint32_t train_preset_given;
#define TRAIN_PRESET                                                                                         \
    { train_preset_rows, &train_preset_given, sizeof train_preset_given }
/* Hyperparameters of a run, threads. */
lg_fit_options train_fit_options(const app *app, const lg_training *training);
/* The task's method, as in "--network angle", when it does not have the option; otherwise NULL. Static
 * storage. */
const char *train_refuses(const train_task *task, const app_slot *slot);

/* ---- parts, for other commands ---- */

lg_provenance app_provenance(const app *app, uint64_t seed);
/* Columns epoch, loss, validation, rate, seconds. */
lg_status train_save_history(const char *path, const lg_fit *fit, lg_error *error);
/* validation may be NULL. */
lg_status train_draw_loss(const app *app, const char *picture, const double *loss, const double *validation,
                          size_t epochs, lg_error *error);

#endif

/* What every `train` command shares: its options for files, and the course from the command line to the end
 * of training: --resume, checkpoints, progress, Ctrl-C, --history, exit codes, JSON.
 *
 * A command gives a train_task and returns train_main(...). The run of its settings[0] says how is trained:
 * its rows are the hyperparameters, checkpoints hold it, and a resumed run is compared with it. The search
 * driver (common/search.h) trains the same task.
 *
 * Functions that return int return an exit code, and have told the user when it is not APP_EXIT_OK; those
 * that return a status explain it in `error`. */
#ifndef LG_APPS_TRAIN_DRIVER_H
#define LG_APPS_TRAIN_DRIVER_H

#include "common/app.h"
#include "liegrad/io.h"
#include "liegrad/nn.h"

typedef struct train_files {
    const char *out, *checkpoint, *resume, *history, *plot, *size;
    uint64_t checkpoint_every, stop_after;
    double seconds;
} train_files;

/* What the command line gave, and its options, which stand among the settings of a command.
 * TRAIN_SHARED_NO_SIZE is for a command whose task has no `sizes`. */
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
    const lg_recipe *kind;
    const app_settings *settings; /* the command's; the first one is the run */
    lg_training *training;        /* of the run */
    const char *method;           /* the row whose value the other rows' `methods` are about; NULL: none */
    const char *only;             /* a search takes this method alone; NULL: any */
    const char *held_out;         /* the row whose place --validation of a search takes; may be NULL */
    const char *kept;             /* the option that names one more file to be read; may be NULL */
    void *user;

    /* Reads the data at `path` and gives their SHA-256. */
    int (*read)(void *user, app *app, const char *path, char sha256[LG_SHA256_TEXT]);
    /* Completes the run: what the data say, and without a stored run what a preset says (app_adopt). The
     * hyperparameters of `stored`, of a resumed run, are adopted already. */
    lg_status (*describe)(void *user, app *app, const void *stored, lg_error *error);
    /* Splits the data, before the fit is made: into training and test part, or, in a search, holding out
     * `validation` of the training part. What it finds out about the data goes into the run. `prepare` may be
     * NULL. */
    int (*prepare)(void *user, app *app);
    lg_status (*hold_out)(void *user, app *app, double validation, lg_error *error);
    /* The fit; it is destroyed by `release`, with what prepare and hold_out made, whether they failed or
     * not. */
    lg_status (*create)(void *user, app *app, const lg_fit_options *options, lg_fit **fit, lg_error *error);
    void (*release)(void *user);
    /* The plan was carried out as far as asked: judges, writes the model, draws and reports. */
    int (*finish)(void *user, train_session *session);
    /* In a search: what is to be lowered, asked where a rung is passed, and at the end; how many weights. */
    double (*objective)(void *user, app *app);
    size_t (*parameters)(void *user);
    /* Values of the row "hidden" that --size auto compares, from small to large, ended by NULL; NULL: it
     * has no such row. Needs `parameters`. */
    const char *const *sizes;
    bool (*has_width)(void *user); /* NULL: always */
    bool prior;                    /* its loss is the square of noise, which --prior takes */
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
int train_size(app *app, const train_task *task, const char *size, train_race *race);
double train_race_seconds(const train_race *race);            /* of --seconds, for the race */
void train_size_json(const train_race *race, app_json *json); /* "sizes", unless there was no race */
/* The planned epochs: 10^6 where --seconds alone limits a method other than Adam. */
uint64_t train_epochs(const app *app, const lg_training *training);

struct train_session {
    app *app;
    const train_task *task;
    lg_fit *fit;
    double seconds; /* wall time of the training */
    train_race race;
    double floor; /* the integrator's truncation error in units of the loss; NaN: not known */
    /* The driver's own. */
    app_progress progress;
    lg_status checkpoint_status;
    lg_error checkpoint_error;
};

int train_main(app *app, const train_task *task);
/* The first part of train_main alone: options that do not go together, files that cannot be written. */
int train_check(app *app, const train_task *task);
/* The option --preset, a row of a task's settings, and the preset to take: "thesis" or "best". Not given, it
 * is "thesis" where the command line asks for Adam, by a --method that ends with it or, without one, by an
 * option of Adam's alone (a rate, a batch) or by single precision. */
extern const lg_field train_preset_rows[];
extern uint32_t train_preset_given;
#define TRAIN_PRESET                                                                                         \
    { train_preset_rows, &train_preset_given, sizeof train_preset_given }
const char *train_preset(const app *app, const lg_training *training);
/* Hyperparameters of a run, threads. */
lg_fit_options train_fit_options(const app *app, const lg_training *training);
/* The task's method, as in "--network angle", when it does not have the option; otherwise NULL. Static
 * storage. */
const char *train_refuses(const train_task *task, const app_slot *slot);

/* Says in a warning what is wrong with a training whose result is no better than a simple guess, or whose
 * loss has not fallen since the first epoch. `error` is that of the result and `guessed` that of `guess`
 * ("the mean curve"), both the `what` ("mean squared error") on the same data; guessed <= 0 or NaN: unknown.
 * APP_EXIT_NUMERIC, with the sentence told, when both hold, or one of them after 10 epochs (100 evaluations
 * of a full-batch method), or with an error 1000 times the guessed one; the model may still be written. A
 * training that --stop-after ended is only warned of. */
int train_judge(const train_session *session, const char *what, double error, const char *guess,
                double guessed);
/* LG_OUT_OF_MEMORY, with the size of the network. */
lg_status train_no_room(size_t parameters, lg_error *error);
/* --plot, if given: the loss. */
int train_draw(const train_session *session);
/* epochs, evaluations (gradients of all data), floor, running_loss, validation_loss, best_epoch, finished,
 * stopped (why, null while it goes on), seconds_per_epoch, seconds, threads, steps, tape_bytes, cpu, out, the
 * hyperparameters of the run by their names, and the warnings so far. */
void train_json(const train_session *session, app_json *json);

/* ---- parts, for other commands ---- */

lg_provenance app_provenance(const app *app, uint64_t seed);
/* Columns epoch, loss, validation, rate, seconds. */
lg_status train_save_history(const char *path, const lg_fit *fit, lg_error *error);
/* validation may be NULL. */
lg_status train_draw_loss(const app *app, const char *picture, const double *loss, const double *validation,
                          size_t epochs, lg_error *error);

#endif

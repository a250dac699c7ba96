/* What every `train` command shares: the rows of its options, and training from them: progress, checkpoints,
 * Ctrl-C and --resume, history, the picture of the loss.
 *
 * The course of a command:
 *
 *   fit_session session = {.app = app, .values = &given.fit, .create = my_checkpoint, .user = &mine};
 *   code = fit_check_outputs(app, &given.fit);                  before anything long
 *   read the data; with --resume: open the checkpoint, then fit_adopt(app, &given.fit, &stored.training,
 * true) session.training = fit_training(&given.fit, app->seed);     into the run, which is compared with the
 * stored one options = fit_options(&session);  lg_fit_create(..., &options, theta, &session.fit, &error);
 *   code = fit_load(&session, reader);                          with --resume; takes /fit of the checkpoint
 *   code = fit_train(&session, &done);
 *   if (done) judge, write the model, code = fit_draw(&session), report;
 *   lg_fit_destroy(session.fit);
 *
 * Functions that return int return an exit code, and have told the user when it is not APP_EXIT_OK. */
#ifndef LG_APPS_FIT_H
#define LG_APPS_FIT_H

#include "common/app.h"
#include "liegrad/io.h"
#include "liegrad/nn.h"

/* ---- options ---- */

/* A part of a command's values. */
typedef struct fit_values {
    const char *out, *checkpoint, *resume, *history, *plot;
    int dtype, schedule; /* positions in fit_dtypes, fit_schedules: values of lg_dtype, lg_schedule_kind */
    uint64_t epochs, batch, lr_step, shards, checkpoint_every, stop_after;
    double lr, lr_gamma, weight_decay, adam_eps, clip, validation;
} fit_values;

extern const char *const fit_dtypes[], *const fit_schedules[], *const fit_activations[];

/* Rows of a command's table whose values are `struct type` with a fit_values called `field`. `samples`: what
 * a batch counts ("Trajectories"). The others are texts of defaults: "80", "1e-2", "the preset's". */
#define FIT_TRAINING_ROWS(...) FIT_VALIDATED_ROWS("0", __VA_ARGS__)
/* The same with a validation part by default. */
#define FIT_VALIDATED_ROWS(d_validation, type, field, samples, d_epochs, d_batch, d_lr, d_schedule, d_step,  \
                           d_gamma, d_decay, d_eps, d_clip, d_dtype, d_shards)                               \
    APP_ROW_SIZE(type, field.epochs, "epochs", "E", 1, 1e9,                                                  \
                 "Planned total, a resumed run included (default " d_epochs ")"),                            \
        APP_ROW_SIZE(type, field.batch, "batch", "B", 1, 4e9, samples " in a batch (default " d_batch ")"),  \
        APP_ROW_POSITIVE(type, field.lr, "lr", "R", "Learning rate of Adam (default " d_lr ")"),             \
        APP_ROW_CHOICE(type, field.schedule, "schedule", fit_schedules,                                      \
                       "constant, step or cosine (default " d_schedule ")"),                                 \
        APP_ROW_SIZE(type, field.lr_step, "lr-step", "E", 1, 1e9,                                            \
                     "step: epochs after which the rate is multiplied by --lr-gamma (default " d_step ")"),  \
        APP_ROW_REAL(type, field.lr_gamma, "lr-gamma", "G", 0, 1e300,                                        \
                     "step: that factor; cosine: the last factor, at most 1 (default " d_gamma ")"),         \
        APP_ROW_REAL(type, field.weight_decay, "weight-decay", "W", 0, 1e300,                                \
                     "L2 penalty in the gradient (default " d_decay ")"),                                    \
        APP_ROW_POSITIVE(type, field.adam_eps, "adam-eps", "EPS", "Adam's eps (default " d_eps ")"),         \
        APP_ROW_REAL(type, field.clip, "clip", "NORM", 0, 1e300,                                             \
                     "Bound on the gradient's norm, 0 for none (default " d_clip ")"),                       \
        APP_ROW_CHOICE(type, field.dtype, "dtype", fit_dtypes, "f64 or f32 (default " d_dtype ")"),          \
        APP_ROW_REAL(type, field.validation, "validation", "F", 0, 0.9,                                      \
                     "Fraction kept for validation; the best epoch's parameters are then taken "             \
                     "(default " d_validation ")"),                                                          \
        APP_ROW_SIZE(                                                                                        \
            type, field.shards, "shards", "n", 1, 1024,                                                      \
            "Pieces of a batch that threads share; the bits of the result depend on it (default " d_shards   \
            ")")

#define FIT_FILE_ROWS(type, field)                                                                           \
    APP_ROW_TEXT(                                                                                            \
        type, field.checkpoint, "checkpoint", "FILE",                                                        \
        "Where the state goes (default: FILE of --out with .checkpoint appended, when stopped early)"),      \
        APP_ROW_SIZE(type, field.checkpoint_every, "checkpoint-every", "n", 1, 1e9,                          \
                     "Epochs between checkpoints (default 10 with --checkpoint)"),                           \
        APP_ROW_SIZE(type, field.stop_after, "stop-after", "n", 1, 1e9,                                      \
                     "Stop after n epochs of this run, state saved"),                                        \
        APP_ROW_TEXT(type, field.resume, "resume", "FILE",                                                   \
                     "Continue from a checkpoint, to the same bits as one run; options not given are the "   \
                     "checkpoint's"),                                                                        \
        APP_ROW_TEXT(type, field.history, "history", "FILE.csv",                                             \
                     "One row an epoch: epoch, loss, validation, rate, seconds"),                            \
        APP_ROW_TEXT(type, field.plot, "plot", "FILE.svg|.png", "Draw the loss")

/* `out` stands first in a table, apart from the rest. */
#define FIT_OUT_ROW(type, field) APP_ROW_TEXT(type, field.out, "out", "FILE", "The model file to write")

/* Position of `name` in a list that ends with NULL; `otherwise` when it is not there. */
int fit_position_of(const char *const *names, const char *name, int otherwise);

lg_training fit_training(const fit_values *values, uint64_t seed);
/* What was not given on the command line becomes `training`'s: a preset's, or with `seed` (its seed too) a
 * stored run's. */
void fit_adopt(app *app, fit_values *values, const lg_training *training, bool seed);

/* Where the state goes: --checkpoint, or beside --out. Freed with free. */
char *fit_checkpoint_path(const fit_values *values);
/* --out is given, and app_check_outputs of all files, that of --resume too, which --checkpoint may continue.
 */
int fit_check_outputs(const app *app, const fit_values *values);

/* ---- training ---- */

typedef struct fit_session {
    /* The command's. */
    app *app;
    const fit_values *values;
    lg_training training;
    lg_fit *fit; /* the caller creates and destroys it */
    /* Begins a checkpoint of the command's kind of run at `path`, without /fit (lg_checkpoint_create, ...).
     */
    lg_status (*create)(void *user, const char *path, const lg_provenance *provenance, lg_file_writer **out,
                        lg_error *error);
    void *user;
    /* The session's own. */
    app_progress progress;
    double seconds; /* wall time of fit_train */
    lg_status checkpoint_status;
    lg_error checkpoint_error;
} fit_session;

/* Hyperparameters of session->training, threads, checkpoints, progress. The session must not move while the
 * fit lives. */
lg_fit_options fit_options(fit_session *session);
/* The state below /fit of an open checkpoint becomes the fit's. */
int fit_load(fit_session *session, lg_file_reader *stored);
/* Trains, writes --history. *done: the plan was carried out as far as asked (--stop-after included): a model
 * is to be written. A training that stopped early has left a checkpoint and told how to continue; one that
 * broke down has left the state before. */
int fit_train(fit_session *session, bool *done);
/* --plot, if given. */
int fit_draw(const fit_session *session);
/* epochs, running_loss, validation_loss, best_epoch, finished, seconds_per_epoch, seconds, threads, dtype,
 * seed, shards, steps, tape_bytes, cpu, out. */
void fit_json(const fit_session *session, app_json *json);

/* ---- parts, for other commands ---- */

lg_provenance app_provenance(const app *app, uint64_t seed);
/* Columns epoch, loss, validation, rate, seconds. */
lg_status fit_save_history(const char *path, const lg_fit *fit, lg_error *error);
/* validation may be NULL. */
lg_status fit_draw_loss(const app *app, const char *picture, const double *loss, const double *validation,
                        size_t epochs, lg_error *error);

#endif

/* What the commands of lg-identify share: machines and logs, and how well a model does. Functions that return
 * int return an exit code and have told the user when it is not APP_EXIT_OK. */
#ifndef LG_APPS_IDENTIFY_H
#define LG_APPS_IDENTIFY_H

#include "common/app.h"
#include "common/train.h"
#include "liegrad/machine_model.h"

extern const app_command check_command, fit_command, evaluate_command, predict_command, generate_command,
    demo_command;

/* Parameters up to which a model keeps their covariance. */
#define IDENTIFY_MOST_SPREAD 256

/* ---- logs (data.c) ---- */

/* A machine and its logs: first those for training, then those for validation. */
typedef struct identify_data {
    lg_machine_file file;
    lg_logs logs;
    size_t training_parts;   /* parts of the log that are for training */
    lg_machine_log training; /* these parts */
} identify_data;

/* Reads MACHINE.yaml and logs; `more` (may be NULL) lists further logs with commas between them, those for
 * validation. Warnings of the reader are told. */
int identify_read(app *self, const char *machine, const char *const *paths, size_t count, const char *more,
                  identify_data *out);
void identify_release(identify_data *data);

/* A model as it runs. */
typedef struct identify_model {
    const lg_machine *machine;
    const double *theta;
    const lg_scheme *scheme;
    uint32_t substeps;
    bool positions; /* its logs have these alone */
} identify_model;

/* MODEL.h5 LOG..., the arguments of a command; the logs are read as the model's machine and delay say. */
typedef struct identify_given {
    lg_machine_model_file file;
    identify_data data;
    identify_model model;
} identify_given;
/* Ends the command where something cannot be read, or momenta are measured. substeps 0: the model's. */
void identify_load(app *self, uint64_t substeps, identify_given *out);
void identify_given_destroy(identify_given *given);

/* Standard deviations of the noise of the coordinates' positions and velocities: given in the machine's file,
 * or estimated where a column is noisy; 0: none. */
void identify_noise(const identify_data *data, double *position, double *velocity);
/* The noise that columns show, however small; 0: smooth columns. That of a line's or angle's position is the
 * part that also shows beside the velocity. */
void identify_traces(const identify_data *data, double *position, double *velocity);

/* ---- positions against velocities (kinematics.c) ---- */

/* How much of the motion of each coordinate from row to row the velocities `lag` rows later do not explain, a
 * part of its root mean square; NaN: nothing to compare. */
void identify_motions(const identify_data *data, int lag, double *out);
/* The lag of the velocities that explain the motion at least twice as well as those of the same rows, within
 * 12 rows; 0: none does. `left`: what they do not explain. */
void identify_lags(const identify_data *data, int *lag, double *left);
/* Noise of a line's or angle's position by what is left of its motion: noise makes neighbours of opposite
 * sign, curvature does not. 0: none, or another kind of coordinate. */
double identify_position_noise(const identify_data *data, uint32_t coordinate);
/* The longest run of rows in which a line or angle keeps its position although its velocity is not 0. */
typedef struct identify_standstill {
    size_t row, rows; /* rows 0: none */
    double value;
} identify_standstill;
identify_standstill identify_stuck(const identify_data *data, uint32_t coordinate);

/* ---- judging (judge.c) ---- */

typedef enum identify_error {
    ERROR_LINE,
    ERROR_ANGLE,
    ERROR_DIRECTION,
    ERROR_ROTATION,
    ERROR_VELOCITY,
    IDENTIFY_ERRORS
} identify_error;
extern const char *const identify_error_names[IDENTIFY_ERRORS];

/* Root mean squares of errors up to a horizon; NaN where there is no such coordinate. */
typedef struct identify_horizon {
    double seconds;
    size_t starts;
    double pooled[IDENTIFY_ERRORS];    /* over all samples in (0, H] of all starts */
    double median[IDENTIFY_ERRORS];    /* median over starts of each start's own */
    double unchanged[IDENTIFY_ERRORS]; /* pooled, of "nothing changes" */
} identify_horizon;

/* Of two positions in the order of logs: the mean square of each coordinate's places (angles wrapped), the
 * squared angle of directions and rotations, in sum. Missing ones count 0. */
double identify_position_loss(const lg_machine *machine, const double *a, const double *b);

/* Root mean squares of the errors of each coordinate over the problem's windows, from measured starts:
 * positions (radians; chords of directions and rotations) and velocities. NaN: not measured. */
typedef struct identify_residual {
    double position, velocity;
} identify_residual;
lg_status identify_residuals(const app *self, const identify_model *model, const lg_machine_problem *problem,
                             identify_residual *out, lg_error *error);

/* Runs of `steps` intervals from rows `start`: q (count, steps + 1, positions), v (count, steps + 1,
 * velocities). */
typedef void identify_runner(void *user, const lg_machine_log *log, const size_t *start, size_t count,
                             size_t steps, double *q, double *v);
void identify_horizon_errors_of(const lg_machine *machine, identify_runner *runner, void *user,
                                const lg_machine_log *log, double seconds, size_t every,
                                identify_horizon *out);
/* With positions alone the 50 rows up to a start estimate its state. */
void identify_horizon_errors(const app *self, const identify_model *model, const lg_machine_log *log,
                             double seconds, size_t every, identify_horizon *out);

#endif

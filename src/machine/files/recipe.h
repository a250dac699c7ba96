/* Machines and logs as the learner and the commands of lg-identify take them. Sentences for the user go to
 * the context's log as warnings. */
#ifndef LG_MACHINE_RECIPE_H
#define LG_MACHINE_RECIPE_H

#include "core/core.h"
#include "liegrad/machine_model.h"

/* Parameters up to which a model keeps their covariance. */
#define LG_MACHINE_MOST_SPREAD 256

/* ---- machines and their logs (data.c) ---- */

typedef struct lg_machine_sources {
    const char *machine;     /* MACHINE.yaml, or the file that `text` comes from */
    const char *text;        /* of a machine; NULL: it is read */
    const char *const *logs; /* (count) paths of the logs for training */
    size_t count;
    const char *validation; /* paths of the logs for validation, with commas between them; may be NULL */
    int64_t delay;          /* rows; < 0: the machine's */
} lg_machine_sources;

/* A machine and its logs: first those for training, then those for validation. */
typedef struct lg_machine_data {
    lg_machine_file file;
    lg_logs logs;
    lg_machine_log training; /* of these logs the parts that are for training */
    const char *failed;      /* the file that a failure is about */
    const char **paths;      /* (path_count) of all logs; owned, as is `list`, the words of the last ones */
    size_t path_count;
    char *list;
} lg_machine_data;
/* `out` is zero, and is destroyed whatever comes of it. Warnings of the reader are told. */
lg_status lg_machine_data_read(const lg_context *context, const lg_machine_sources *from,
                               lg_machine_data *out, lg_error *error);
void lg_machine_data_destroy(lg_machine_data *data);
/* LG_UNSUPPORTED where momenta are measured: they cannot be predicted in columns. */
lg_status lg_machine_refuse_momenta(const lg_machine_file *file, const char *path, lg_error *error);

/* Standard deviations of the noise of the coordinates: given in the machine's file, or estimated where a
 * column is noisy; 0: none. True: there is some. */
bool lg_machine_data_noise(const lg_machine_data *data, lg_machine_noise *out);
/* The noise that columns show, however small; 0: smooth columns. That of a line's or angle's position is the
 * part that its motion shows, too, against its velocity. */
void lg_machine_data_traces(const lg_machine_data *data, lg_machine_noise *out);

/* Mean square of the accelerations that are left of those between two rows by a polynomial of degree 2 in
 * positions (sines and cosines of angles), velocities and inputs, fitted to these logs (delay.c); NaN:
 * nothing to fit. */
lg_status lg_machine_unexplained(const lg_context *context, const lg_machine *machine,
                                 const lg_machine_log *log, double *out, lg_error *error);

/* ---- positions against velocities (kinematics.c) ---- */

double lg_machine_wrap(double angle); /* to [-pi, pi] */
/* How much of the motion of each coordinate from row to row the velocities `lag` rows later do not explain, a
 * part of its root mean square; NaN: nothing to compare. */
void lg_machine_motions(const lg_machine_data *data, int lag, double *out);
/* The lag of the velocities that explain the motion at least twice as well as those of the same rows, within
 * 12 rows; 0: none does. `left`: what they do not explain. */
void lg_machine_lags(const lg_machine_data *data, int *lag, double *left);
/* Noise of a line's or angle's position by what is left of its motion: noise makes neighbours of opposite
 * sign, curvature does not. 0: none, or another kind of coordinate. */
double lg_machine_position_noise(const lg_machine_data *data, uint32_t coordinate);
/* The longest run of rows in which a line or angle keeps its position although its velocity is not 0. */
typedef struct lg_standstill {
    size_t row, rows; /* rows 0: none */
    double value;
} lg_standstill;
lg_status lg_machine_stuck(const lg_context *context, const lg_machine_data *data, uint32_t coordinate,
                           lg_standstill *out, lg_error *error);

/* ---- runs of a learned machine, and their errors (horizons.c) ---- */

/* A model as it runs. */
typedef struct lg_learned_machine {
    const lg_machine *machine;
    const double *theta;
    const lg_scheme *scheme;
    uint32_t substeps;
    bool positions; /* its logs have these alone */
} lg_learned_machine;

enum { LG_START_ROWS = 50 };
/* A log that has states at some rows, and at these alone: q (rows, positions) and v (rows, velocities). */
typedef struct lg_started_log {
    lg_machine_log log;
    double *q, *v;
    const lg_context *context;
} lg_started_log;
/* The states at row[0..count-1] from the positions of LG_START_ROWS rows each, fewer at the end of a part.
 * `out` is destroyed whatever comes of it. */
lg_status lg_started_log_create(const lg_context *context, const lg_learned_machine *model,
                                const lg_machine_log *log, const size_t *row, size_t count,
                                lg_started_log *out, lg_error *error);
void lg_started_log_destroy(lg_started_log *started);

typedef enum lg_run_error {
    LG_ERROR_LINE,
    LG_ERROR_ANGLE,
    LG_ERROR_DIRECTION,
    LG_ERROR_ROTATION,
    LG_ERROR_VELOCITY,
    LG_RUN_ERRORS
} lg_run_error;
extern const char *const lg_run_error_names[LG_RUN_ERRORS];

/* Root mean squares of errors up to a horizon; NaN where there is no such coordinate. */
typedef struct lg_horizon {
    double seconds;
    size_t starts;
    double pooled[LG_RUN_ERRORS];    /* over all samples in (0, H] of all starts */
    double median[LG_RUN_ERRORS];    /* median over starts of each start's own */
    double unchanged[LG_RUN_ERRORS]; /* pooled, of "nothing changes" */
} lg_horizon;

/* Runs of `steps` intervals from rows `start`: q (count, steps + 1, positions), v (count, steps + 1,
 * velocities). */
typedef lg_status lg_runner(void *user, const lg_machine_log *log, const size_t *start, size_t count,
                            size_t steps, double *q, double *v, lg_error *error);
/* Of runs that begin every so many rows of a part. */
lg_status lg_horizon_of(const lg_context *context, const lg_machine *machine, lg_runner *runner, void *user,
                        const lg_machine_log *log, double seconds, size_t every, lg_horizon *out,
                        lg_error *error);
/* With positions alone the LG_START_ROWS rows up to a start estimate its state. */
lg_status lg_machine_horizon(const lg_context *context, const lg_learned_machine *model,
                             const lg_machine_log *log, double seconds, size_t every, lg_horizon *out,
                             lg_error *error);
/* The mean over all windows of so many rows, points 2..M, of: for each coordinate the mean square of its
 * places (angles wrapped) and the squared angles of directions and rotations; the mean square of all
 * velocities. NaN: there is no window. */
lg_status lg_machine_window_loss(const lg_context *context, const lg_learned_machine *model,
                                 const lg_machine_log *log, uint32_t window, double *out, lg_error *error);
/* Root mean squares of the errors of each coordinate over the problem's windows for training, from measured
 * starts: positions (radians; chords of directions and rotations) and velocities. NaN: not measured. */
lg_status lg_machine_residuals(const lg_context *context, const lg_learned_machine *model,
                               const lg_machine_problem *problem, lg_machine_noise *out, lg_error *error);

/* ---- the learner (recipe.c) ---- */

/* How well a model explains the logs, and what they say of its numbers (judge.c). */
typedef struct lg_machine_verdict {
    double loss, expected; /* `expected`: at most, of a model that explains the logs */
    double tolerated;      /* `expected` without the error of the steps */
    double forces;         /* the loss of a model in which nothing acts, about */
    lg_machine_missing missing;
    lg_identification identified; /* in the learning's memory */
    size_t count;                 /* of numbers */
    bool placed;                  /* M of a network is told at these positions: "at x 1.2, theta 3.1" */
    double positions[LG_MACHINE_POSITIONS];
    char place[256];
    char gauge[160]; /* what fixes the common factor of masses and forces */
} lg_machine_verdict;

typedef struct lg_machine_state {
    const char *validation; /* logs that are not trained on, with commas between them; NULL: none */
    lg_machine_data data;
    bool positions, noisy;  /* positions alone are measured; there is noise: */
    lg_machine_noise noise; /* lg_machine_data_noise */
    lg_machine_problem problem;
    lg_machine_verdict verdict;
} lg_machine_state;

/* Levenberg-Marquardt takes a forward sweep for each parameter: it wins while these are few. */
bool lg_machine_is_small(const lg_machine *machine);
struct lg_learning;
/* The parameters theta of the machine, in and out, from short windows, from which longer ones can be
 * predicted; the scales of the loss, and the substeps where they are not given (warm_up.c). */
lg_status lg_machine_warm_up(struct lg_learning *self, double *theta, lg_error *error);
/* The learner's hook: also tells what is wrong with the model. */
lg_status lg_machine_judge(struct lg_learning *self, double *theta, lg_error *error);

#endif

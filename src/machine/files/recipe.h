/* How the trainer and the commands of lg-identify read machines and logs. Sentences for the user go to the
 * context's log as warnings. */
#ifndef LG_MACHINE_RECIPE_H
#define LG_MACHINE_RECIPE_H

#include <math.h>

#include "core/clean.h"
#include "machine/internal.h"
#include "model/files/training.h"

/* A model keeps the covariance of its parameters up to this number of parameters. */
#define LG_MACHINE_MOST_SPREAD 256

/* ---- machines and their logs (data.c) ---- */

typedef struct lg_machine_sources {
    const char *machine;     /* path of MACHINE.yaml, or the name of the file that `text` comes from */
    const char *text;        /* the machine as YAML; NULL: it is read from the file */
    const char *const *logs; /* (count) paths of the logs for training */
    size_t count;
    const char *validation; /* comma-separated paths of the validation logs; may be NULL */
    int64_t delay;          /* rows, of inputs with `delay: estimate`; < 0: it is estimated */
    bool quiet;             /* warnings of the reader are not told: they were told before */
    bool clocks;            /* lg_log_options.clocks */
} lg_machine_sources;

/* A machine and its logs: first the training logs, then the validation logs. */
typedef struct lg_machine_data {
    lg_machine_file file;
    lg_logs logs;
    lg_machine_log training; /* the parts of `logs` that are for training */
    const char *failed;      /* after an error: the path of the file that caused it */
    bool clocks;
    /* (path_count) paths of all logs. Owned, as is `list`, the text that the validation paths point into. */
    const char **paths;
    size_t path_count;
    char *list;
} lg_machine_data;
/* `out` must be zero, and must be destroyed even after an error. Warnings of the reader go to the context's
 * log. */
lg_status lg_machine_data_read(const lg_context *context, const lg_machine_sources *from,
                               lg_machine_data *out, lg_error *error);
void lg_machine_data_destroy(lg_machine_data *data);
/* Fails with LG_UNSUPPORTED if the logs measure momenta, because columns of momenta cannot be predicted. */
lg_status lg_machine_refuse_momenta(const lg_machine_file *file, const char *path, lg_error *error);

/* Standard deviations of the noise of each coordinate: as given in the machine's file, else estimated,
 * however small; 0: smooth columns. If velocities are measured, the position noise of a line or angle is
 * at most lg_logs.position_noise. */
void lg_machine_data_traces(const lg_machine_data *data, lg_machine_noise *out);

/* Copies the machine's YAML without comments and blank lines to run->text (model.c). */
lg_status lg_machine_model_describe(lg_machine_model_run *run, const char *name, const char *text,
                                    lg_error *error);
/* Writes the SHA-256 of the rows of a log as little-endian doubles (model.c). */
void lg_machine_log_sha256(const lg_machine *machine, const lg_machine_log *log, char text[LG_SHA256_TEXT]);
/* Returns number i of a row: positions, then velocities or accelerations, then inputs. Where accelerations
 * are measured, positions are missing (NaN) (data.c). */
double lg_log_number(const lg_machine *machine, const lg_machine_log *log, size_t row, size_t i);
/* Return the mean square of changes of number i over `lag` rows, and its variance; NaN without values. */
double lg_log_change(const lg_machine *machine, const lg_machine_log *log, size_t i, size_t lag);
double lg_log_variance(const lg_machine *machine, const lg_machine_log *log, size_t i);
/* Writes the range of the numbers in a log; low > high for numbers that are not measured. */
void lg_machine_find_range(const lg_machine *machine, const lg_machine_log *log, lg_machine_range *out);

/* Whether a mass or force of the machine depends on the position of a coordinate (machine.c). */
bool lg_machine_sees_position(const lg_machine *machine, uint32_t coordinate);

/* Mean square of the accelerations between neighbouring rows that a polynomial of degree 2 in positions
 * (sine and cosine of angles), velocities and inputs, fitted to these logs, does not explain (delay.c).
 * NaN: nothing to fit. With linear (velocities, features) the model is linear in (q, v, u, 1), and
 * `linear` becomes its matrix unless there is nothing to fit. */
lg_status lg_machine_unexplained(const lg_context *context, const lg_machine *machine,
                                 const lg_machine_log *log, double *linear, double *out, lg_error *error);

/* ---- machines and logs at a glance ---- */

static inline bool lg_term_is_network(const lg_machine_term *term) {
    return lg_term_has(term, LG_TERM_HIDDEN);
}
/* Copies the parameters of terms that both machines have (choice.c). */
void lg_machine_carry(const lg_machine *from, const double *theta, const lg_machine *to, double *out);
size_t lg_log_longest_part(const lg_machine_log *log); /* in rows (recipe.c) */
/* Root mean square of the logged velocities (or accelerations) of a coordinate; 0: none was logged
 * (warm_up.c). */
double lg_log_speed(const lg_machine *machine, const lg_machine_log *log, uint32_t coordinate);

/* Wraps to [-pi, pi]. */
static inline double lg_machine_wrap(double angle) {
    const double turn = 6.283185307179586;
    return angle - turn * round(angle / turn);
}

/* ---- runs of a learned machine, and their errors (horizons.c) ---- */

/* What it takes to run a learned machine. */
typedef struct lg_learned_machine {
    const lg_machine *machine;
    const double *theta;
    const lg_scheme *scheme;
    uint32_t substeps;
    /* The state at the start of a run is estimated from this many rows, because the logs measure positions or
     * accelerations alone; 0: the logs have it. */
    uint32_t start_rows;
    const lg_context *context; /* memory and cancelling of its runs */
} lg_learned_machine;

/* The usual number of these rows: accelerations show a state only over a motion. */
static inline size_t lg_start_rows(const lg_machine *machine) {
    return machine->accelerations ? 200 : 50;
}
/* The machine of a model. `estimated`: its logs do not show the states at starts. */
static inline lg_learned_machine lg_model_learned(const lg_context *context, const lg_machine_model_run *run,
                                                  const double *theta, bool estimated) {
    const uint32_t rows = run->start_rows > 0 ? run->start_rows : (uint32_t)lg_start_rows(&run->machine);
    return (lg_learned_machine){&run->machine,        theta,  run->scheme, run->substeps,
                                estimated ? rows : 0, context};
}
/* What the log has of the velocities, (rows, velocities): the velocities, or the accelerations. */
static inline const double *lg_log_shown(const lg_machine_log *log) {
    return log->a != NULL ? log->a : log->v;
}
/* Copies a log. The copy has separate states, which are zero: q (rows, positions), v (rows, velocities). The
 * caller destroys it. */
typedef struct lg_started_log {
    lg_machine_log log;
    double *q, *v;
    const lg_context *context;
} lg_started_log;
lg_status lg_started_log_begin(const lg_context *context, const lg_machine *machine,
                               const lg_machine_log *log, lg_started_log *out, lg_error *error);
/* Estimates the states at row[0..count-1], each from model->start_rows rows, of which it is the first; fewer
 * at the end of a part. `out` must be destroyed even after an error. */
lg_status lg_started_log_create(const lg_learned_machine *model, const lg_machine_log *log, const size_t *row,
                                size_t count, lg_started_log *out, lg_error *error);
void lg_started_log_destroy(lg_started_log *started);
/* Sets model->start_rows to the number of rows, from 8 % of lg_start_rows to 200 but at most an eighth of a
 * part, with the least error of runs of up to 32 rows (128 in long parts) from the same starts in this log.
 * Many rows average noise; few rows contain less of what disturbs the machine. */
lg_status lg_machine_choose_start_rows(lg_learned_machine *model, const lg_machine_log *log, lg_error *error);
/* Sets the range of positions and velocities that no column shows (low > high) to that of runs over the
 * training windows. A number whose runs are not finite keeps low > high. */
lg_status lg_machine_widen_range(const lg_learned_machine *model, const lg_machine_problem *problem,
                                 lg_machine_range *range, lg_error *error);

typedef enum lg_run_error {
    LG_ERROR_LINE,
    LG_ERROR_ANGLE,
    LG_ERROR_DIRECTION,
    LG_ERROR_ROTATION,
    LG_ERROR_VELOCITY,
    LG_ERROR_ACCELERATION, /* where accelerations are measured; then the only one */
    LG_RUN_ERRORS
} lg_run_error;
extern const char *const lg_run_error_names[LG_RUN_ERRORS];

/* A difference between a prediction and a row of the log. number: of the row, positions first. */
enum { LG_POINT_ERRORS = LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES };
typedef struct lg_point_error {
    double error; /* NaN: the log has no number; 1e300: the prediction is not finite */
    uint32_t coordinate, number;
    lg_run_error kind;
} lg_point_error;
/* The errors of a predicted row of a log, at most LG_POINT_ERRORS; returns how many. Differences of angles
 * are wrapped. turned: directions and rotations have one angle each, instead of differences of their
 * numbers. */
size_t lg_point_errors(const lg_machine *machine, const double *q, const double *v, const double *given_q,
                       const double *given_v, bool turned, lg_point_error *out);

/* Root mean square errors of runs up to a horizon of H seconds; NaN for kinds of coordinates that the machine
 * does not have. */
typedef struct lg_horizon {
    double seconds;
    size_t starts;
    double pooled[LG_RUN_ERRORS];    /* over all samples in (0, H] of all runs */
    double median[LG_RUN_ERRORS];    /* median over runs of each run's root mean square */
    double unchanged[LG_RUN_ERRORS]; /* as pooled, for the prediction that nothing changes */
} lg_horizon;

/* Predicts runs of `steps` intervals from rows start[0..count-1]: q (count, steps + 1, positions), v (count,
 * steps + 1, velocities). */
typedef lg_status lg_runner(const void *user, const lg_machine_log *log, const size_t *start, size_t count,
                            size_t steps, double *q, double *v, lg_error *error);
/* The runner of an lg_learned_machine. If its start_rows is not 0, the state at a start is estimated from as
 * many rows, of which the start is the last. */
lg_runner lg_machine_run;
/* Lists rows, `every` rows apart in each part, from which a run of `steps` intervals stays within the part.
 * A row must be complete; with start_rows > 0 the state must be estimable from the start_rows rows that end
 * there; with `ended` the last row of a run must be complete, too. Returns their number; `out` has room for
 * all rows of the log. */
size_t lg_log_starts(const lg_machine *machine, const lg_machine_log *log, size_t start_rows, size_t steps,
                     size_t every, bool ended, size_t *out);
/* Computes the errors of runs that begin `every` rows apart in each part: at complete rows, or at the last
 * of model->start_rows rows from which the state can be estimated. */
lg_status lg_horizon_of(const lg_learned_machine *model, lg_runner *runner, const void *user,
                        const lg_machine_log *log, double seconds, size_t every, lg_horizon *out,
                        lg_error *error);
/* Mean over all windows of `window` rows and their points 2..M of: the mean square of each coordinate's
 * places (angles wrapped), the squared angles of directions and rotations, and the mean square of all
 * velocities. NaN: there is no window, or accelerations are measured. */
lg_status lg_machine_window_loss(const lg_learned_machine *model, const lg_machine_log *log, uint32_t window,
                                 double *out, lg_error *error);

/* ---- a few numbers for a new log (adapt.c) ---- */

enum {
    LG_ADAPT_FRICTION = LG_MACHINE_VELOCITIES, /* stands for a velocity: the direction changes all friction */
    LG_ADAPT_MOST                              /* an offset for each velocity, and friction */
};
/* Standard deviation of the prior: of the relative change of all friction; of an offset in units of the
 * forces of friction. */
#define LG_ADAPT_SIGMA 0.1
/* A learned machine that may move along a few directions. */
typedef struct lg_adaptation {
    lg_machine_model_run run; /* of the model, with an offset in its text where one is wanted */
    double *theta;            /* (P) */
    size_t count;
    double *directions; /* (count, P), one standard deviation of the prior each */
    char names[LG_ADAPT_MOST][LG_IDENTIFIED_NAME];
    double units[LG_ADAPT_MOST];        /* one standard deviation of the prior, in the units of the number */
    uint32_t velocities[LG_ADAPT_MOST]; /* the velocity that the direction pushes, or LG_ADAPT_FRICTION */
    const lg_context *context;
} lg_adaptation;
/* Checks a list of names with commas. Refuses a name that no adaptable number has, and a name that stands
 * twice. */
lg_status lg_adapt_check(const char *names, lg_error *error);
/* `force` (velocities): standard deviations of offsets in the units of the log. `out` must be destroyed even
 * after an error. */
lg_status lg_adaptation_create(const lg_context *context, const char *path, const lg_machine_model_file *file,
                               const char *names, const double *force, lg_adaptation *out, lg_error *error);
/* Returns the number of the direction that pushes `velocity`, or `count` if there is none. */
size_t lg_adaptation_direction(const lg_adaptation *adaptation, uint32_t velocity);
/* Adds sum_k x_k direction_k to theta. */
void lg_adaptation_move(lg_adaptation *adaptation, const double *x);
void lg_adaptation_destroy(lg_adaptation *adaptation);

/* ---- the trainer (recipe.c) ---- */

/* How well a model explains the logs, and what they say of its numbers (judge.c). */
typedef struct lg_machine_verdict {
    /* The loss, and the largest loss that is expected of a model that explains the logs. */
    double loss, expected;
    double tolerated; /* `expected` without the error of the integration steps */
    double forces;    /* about the loss that a model without any forces would have */
    lg_machine_missing missing;
    lg_identification identified; /* memory of the lg_training */
    size_t count;                 /* number of identified numbers */
    bool converged;               /* false: the numbers have no errors (NaN) */
    /* A network mass is reported at `positions`; `place` has them as text: "at x 1.2, theta 3.1". */
    bool placed;
    double positions[LG_MACHINE_POSITIONS];
    char place[256];
    /* What fixes the common factor of masses and forces. */
    char gauge[160];
} lg_machine_verdict;

/* Where fits of lags start, in rows (warm_up.c). */
#define LG_LAG_STARTS 4
extern const double lg_lag_starts[LG_LAG_STARTS];
extern const char *const lg_input_holds[LG_INPUT_HOLD_COUNT]; /* their names (actuators.c) */
/* Of an input: the root mean square errors of free runs with each hold and delay, divided by that of the
 * chosen one; 0: not tried. */
#define LG_MACHINE_DELAYS 6
/* Greatest delay, in rows, that `delay: estimate` tries. */
#define LG_DELAY_ESTIMATED 8
typedef struct lg_input_choice {
    double hold[LG_INPUT_HOLD_COUNT], delay[LG_MACHINE_DELAYS];
} lg_input_choice;

/* Numbers of the machine; `error`: their largest change with another hold that the log does not refute. */
typedef struct lg_input_changes {
    lg_identified numbers[LG_MACHINE_VALUES];
    size_t count;
} lg_input_changes;

/* The line with which the file of `fit --suggest` begins. */
#define LG_SUGGEST_HEAD "# a machine that lg-identify fit --suggest wrote\n"

/* What `fit --suggest` tried: the candidates of each round, best first. `ratio`: root mean square of the
 * errors of free runs, divided by that of the machine before the round; 0: it could not be learned. */
#define LG_SUGGEST_ROUNDS 4
#define LG_SUGGEST_ROWS   384
typedef struct lg_suggested {
    uint32_t round; /* from 1 */
    char name[64];
    double ratio;
    bool taken, chance; /* chance: the gain may be chance */
    size_t parameters;  /* of the machine with it */
} lg_suggested;
typedef struct lg_suggestion {
    uint32_t count;
    lg_suggested row[LG_SUGGEST_ROWS];
    double seconds; /* of a free run */
    size_t windows;
    bool ended; /* nothing more was taken; else the rounds were used up */
} lg_suggestion;

struct lg_held_out;
struct lg_machine_warm;
typedef struct lg_machine_state {
    const char *validation; /* comma-separated paths of validation logs; NULL: none */
    /* Windows of the log that are not trained on; NULL: all are (choice.h). most_windows > 0: not more
     * windows are trained on. */
    const struct lg_held_out *held;
    size_t most_windows;
    const struct lg_machine_warm *warm; /* parameters to begin from; NULL: none */
    lg_input_choice inputs[LG_MACHINE_INPUTS];
    lg_input_changes changes;
    /* The losses of the fits from each start of the lags, divided by the least one; 0: not tried. */
    double lag_ratios[LG_LAG_STARTS];
    const char *suggest; /* where the suggested machine is written, "-" for standard output; NULL: none */
    lg_suggestion suggestion;
    uint32_t select;   /* 1: free runs over held-out windows choose the epoch (select.c) */
    const char *size;  /* widths of networks: "auto" or a list; NULL: as in the machine's file */
    const char *width; /* the widths that "auto" took; NULL: none */
    struct lg_selection *selection;
    lg_machine_data data;
    /* The logs measure positions alone; positions or accelerations alone; `noise` is not all 0. */
    bool positions, estimated, noisy;
    lg_machine_noise
        noise; /* as given in the machine's file, else estimated where columns are clearly noisy */
    lg_machine_problem problem;
    lg_machine_verdict verdict;
} lg_machine_state;

static inline lg_machine_state *lg_machine_state_of(const lg_training *self) {
    return self->state;
}
static inline lg_machine_model_run *lg_machine_run_of(const lg_training *self) {
    return self->run;
}

/* Fills `positions`, `noisy` and `noise` of the state from its data (data.c). */
void lg_machine_look(lg_machine_state *state);

/* Whether the machine has so few parameters that Levenberg-Marquardt, with one forward sweep for each, is
 * fastest. */
bool lg_machine_is_small(const lg_machine *machine);
/* A floor of the loss below this does not matter: no more substeps are taken or proposed. */
#define LG_MACHINE_FLOOR 1e-11

/* Improves theta, the machine's parameters (in and out), on short windows until longer windows can be
 * predicted. Also sets the scales of the loss, and the substeps unless they are given (warm_up.c). */
lg_status lg_machine_warm_up(lg_training *self, double *theta, lg_error *error);

/* Coefficients of friction are squares of parameters. Near 0 a parameter has next to no influence, so that
 * its first step leads far away, and a fit that begins there rejects all steps. Such parameters begin again
 * at a tenth of their initial values, which make a hundredth of the initial friction (warm_up.c). */
void lg_machine_revive(const lg_machine *machine, const double *initial, double *theta);
/* Estimates the states of all rows by polynomials of a degree up to 3 through 2 half + 1 rows, fewer at the
 * ends of parts; NaN where too few rows have a position. The caller destroys `out` even after an error. */
lg_status lg_machine_smooth(const lg_context *context, const lg_machine *machine, const lg_machine_log *log,
                            uint32_t half, uint32_t degree, lg_started_log *out, lg_error *error);
/* The trainer's hook `judge`: fills the verdict, and warns of what is wrong with the model. */
lg_status lg_machine_judge(lg_training *self, double *theta, lg_error *error);

/* Warns if mass, potential, damping and input map are determined only up to a common factor (judge.c). */
void lg_machine_warn_of_gauge(const lg_context *context, const lg_machine *machine);

/* ---- memory (room.c) ---- */

/* Fails with LG_OUT_OF_MEMORY if the windows of the fit are so long that the memory that is left does not
 * suffice; the sentence says how long they may be. */
lg_status lg_machine_check_room(lg_training *self, lg_error *error);

#endif

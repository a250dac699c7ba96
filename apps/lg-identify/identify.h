/* Declarations that the commands of lg-identify share: models and logs, states in a log's columns, runs of
 * all parts, ranges, comparisons, plots. */
#ifndef LG_APPS_IDENTIFY_H
#define LG_APPS_IDENTIFY_H

#include "common/app.h"
#include "machine/files/recipe.h"
#include "settings/training.h"
#include "files/csv.h"

extern const app_command identify_check_command, identify_evaluate_command, identify_predict_command,
    identify_generate_command, identify_adapt_command;

/* ---- models and logs (runs.c) ---- */

/* Calls lg_machine_data_read. Ends the command if something cannot be read. */
void identify_read(const app *self, const lg_machine_sources *from, lg_machine_data *out);

/* The arguments MODEL.h5 LOG... of a command. The logs are read with the model's machine and delay. */
typedef struct identify_given {
    lg_machine_model_file file;
    lg_machine_data data;
    const lg_machine_log *log; /* data.logs.log */
    lg_learned_machine model;
} identify_given;
/* Reads model and logs. Ends the command if something cannot be read, if the log's velocities are momenta, or
 * if start_rows is not 0 and no start is estimated. substeps, start_rows 0: those of the model. */
void identify_load(app *self, uint64_t substeps, uint64_t start_rows, identify_given *out);
/* The rows of the options --substeps and --start-rows; `struct_` has members of these names. */
#define IDENTIFY_MODEL_OPTIONS(struct_)                                                                      \
    SUBSTEPS(struct_, NULL, U64, .otherwise = "the model's"),                                                \
        LG_OPTION(struct_, start_rows, U64, "n",                                                             \
                  "Rows that estimate the state at a start, where the logs measure positions or "            \
                  "accelerations alone",                                                                     \
                  .low = 2, .high = 1e6, .otherwise = "the model's")
/* Writes start_rows: the rows that estimate the state at a start, null if the logs have it. */
void identify_put_start_rows(app_json *json, const lg_learned_machine *model);
void identify_given_destroy(identify_given *given);

/* ---- states in columns (columns.c) ---- */

/* Writes positions and velocities of a row to the columns of the log, in the machine's units (not yet divided
 * by the columns' scale). Other columns are not changed. `before`: columns of the previous row, so that the
 * quaternion does not change its sign from row to row (may be the same array as `columns`); or NULL. */
void identify_to_columns(const lg_machine_file *file, const double *q, const double *v, const double *before,
                         double *columns);
/* Predicted minus logged of each column of the file; the difference of two angles is wrapped to (-pi, pi].
 * NaN: the column is no state, or the log has no number. Infinite: the prediction is not finite. */
void identify_errors(const lg_machine_file *file, const double *q, const double *v, const double *logged_q,
                     const double *logged_v, double *out);
bool identify_is_state(const lg_log_column *column); /* Whether the column is a position or a velocity. */

/* Free runs along a log, each in a part of its own. */
typedef struct identify_runs {
    size_t *start, count; /* (count) rows of the log at which they begin */
    double *q, *v;        /* (rows, positions), (rows, velocities): NaN at rows that are not predicted */
    double *bands;        /* (rows, columns of the file): standard deviations; NULL: not known */
} identify_runs;

/* Root mean squares of predicted minus logged values, one per column of the file; NaN: nothing to compare. */
void identify_column_errors(const identify_given *given, const identify_runs *runs, double *out);
/* Writes them as the object free_run. */
void identify_put_errors(app_json *out, const lg_machine_file *file, const double *errors, const char *label);

/* Warns about each column that leaves the range of the training data, in the log or in the runs, which may be
 * NULL. Where accelerations are measured, only inputs are compared: the states of the log are guesses. */
void identify_warn_range(const app *self, const identify_given *given, const identify_runs *runs);

/* Writes the runs as a log with the machine's columns, and their bands as columns NAME.sd. `logs`: the
 * logs with the names of the runs; NULL: a run has the number of its part. `input`: the logged input of a row
 * of a part. *rows: how many were written. False: some state is not finite, and its cell is empty. */
bool identify_write(const app *self, const char *path, const lg_machine_file *file, const lg_machine_log *log,
                    const lg_logs *logs, const identify_runs *runs,
                    double (*input)(const void *user, size_t part, size_t row, uint32_t input),
                    const void *user, size_t *rows);

/* ---- runs (runs.c): these functions end the command on failure ---- */

/* A log that a command makes. All numbers begin as zeros. */
typedef struct identify_log {
    lg_machine_log log; /* Points to the arrays below. */
    size_t *first;
    double *t, *q, *v, *u;
} identify_log;
void identify_log_begin(identify_log *made, const lg_machine *machine, size_t parts, size_t rows);

/* Returns the number of parts of the first run (parts are separated by gaps). */
size_t identify_first_run(const lg_logs *logs);

/* Calls lg_machine_free_run. */
void identify_run(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                  const size_t *start, size_t count, size_t steps, double *q, double *v);

/* Runs that begin at the first complete row of each part, at or after row `from` of the part; parts without
 * such a row have none. If the log has positions alone, a row with all positions is complete. The memory
 * lives until the command ends. */
identify_runs identify_runs_begin(const lg_learned_machine *model, const lg_machine_log *log, size_t from);
/* Runs from the starts to the ends of their parts. If the log has positions alone, the states at the starts
 * are estimated. */
void identify_run_log(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                      identify_runs *runs);
/* Sets to NaN the first rows of runs of identify_run_log, which only serve to estimate their starts. */
void identify_leave_out(const lg_learned_machine *model, const lg_machine_log *log, identify_runs *runs);

/* ---- comparisons (balance.c) ---- */

/* Sums over all intervals of the log, in the unit of energy. In each interval, the change of H is the work of
 * the inputs, of the damping and of the residual, plus a rest that the model does not explain. */
typedef enum identify_energy {
    ENERGY_CHANGE,
    ENERGY_INPUTS,
    ENERGY_DAMPING,
    ENERGY_RESIDUAL,
    ENERGY_OFFSET,
    ENERGY_LEFT,
    ENERGY_LEFT_SIZE,   /* Sum of the absolute values of the rests. */
    ENERGY_CHANGE_SIZE, /* Sum of the absolute values of the changes. */
    IDENTIFY_ENERGIES
} identify_energy;

/* Test of the residuals of a column: root mean square, correlation of neighbours, the Ljung-Box statistic of
 * 10 lags, and its probability if the residuals are white. A residual is the error of a prediction over one
 * interval. */
typedef struct identify_whiteness {
    double rms, lag1, ljung_box, probability;
} identify_whiteness;

void identify_balance(const app *self, const identify_given *given, double energy[IDENTIFY_ENERGIES],
                      identify_whiteness *whiteness);

/* The same test for the residuals of whole runs. */
void identify_run_whiteness(const identify_given *given, const identify_runs *runs, identify_whiteness *out);

/* ---- constant forces (offset.c) ---- */

/* The constant force on a line or angle that explains the error of the free run best, and root mean squares
 * of this error without and with it. */
typedef struct identify_offset {
    bool integrates; /* the force explains most of the error, and its effect grows to the end of the run */
    double force, without, with;
} identify_offset;
/* Fills `out` (LG_MACHINE_COORDINATES) for runs from the first rows. */
void identify_find_offsets(const app *self, const identify_given *given, const identify_runs *runs,
                           identify_offset *out);
/* Returns the log. If it has no states at starts, velocities are slopes of lines through 21 positions. */
lg_started_log identify_slopes(const app *self, const lg_learned_machine *model, const lg_machine_log *log);
/* Velocities (n, velocities), and on each the learned friction plus the force that the model lacks, from n
 * stretches of 20 intervals. Returns n. */
size_t identify_lacking(const app *self, const identify_given *given, double **velocity, double **force);

/* ---- values of the potential and of the damping force (balance.c) ---- */

/* Computes values at `count` states in the layout of logs: potential (count) and damping force (count,
 * velocities). Either output may be NULL. */
void identify_values(const app *self, const lg_learned_machine *model, size_t count, const double *q,
                     const double *v, double *potential, double *damping);

/* ---- plots (plots.c) ---- */

/* The plot shows each column of the first `parts` parts of a log against time, and its predictions. The plot
 * of an evaluation also shows the errors against the horizons, and the learned potential and friction. */
typedef struct identify_plot {
    const char *title;
    const lg_machine_file *file;
    const lg_machine_log *log;
    size_t parts;
    const identify_runs *runs;   /* NULL: there is no prediction */
    const identify_given *given; /* of an evaluation, else NULL */
    const lg_horizon *horizons;
    size_t horizon_count;
} identify_plot;
void identify_put(app_plot *plot, const void *drawn);

#endif

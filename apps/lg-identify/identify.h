/* What the commands of lg-identify share: models and logs, states in a log's own columns, runs of all parts,
 * ranges, comparisons, pictures. */
#ifndef LG_APPS_IDENTIFY_H
#define LG_APPS_IDENTIFY_H

#include "common/app.h"
#include "machine/files/recipe.h"

extern const app_command check_command, fit_command, evaluate_command, predict_command, generate_command,
    demo_command;

/* ---- models and logs (data.c) ---- */

/* lg_machine_data_read; ends the command where something cannot be read. */
void identify_read(const app *self, const lg_machine_sources *from, lg_machine_data *out);

/* MODEL.h5 LOG..., the arguments of a command; the logs are read as the model's machine and delay say. */
typedef struct identify_given {
    lg_machine_model_file file;
    lg_machine_data data;
    lg_learned_machine model;
} identify_given;
/* Ends the command where something cannot be read, or momenta are measured. substeps 0: the model's. */
void identify_load(app *self, uint64_t substeps, identify_given *out);
void identify_given_destroy(identify_given *given);

/* ---- states in columns (columns.c) ---- */

/* Positions and velocities of a row in the columns of the log, scaled as the machine works (not yet divided
 * by the columns' scale); other columns stay as they are. `before`: the columns of a row whose quaternion's
 * sign is kept (may be `columns`), or NULL. */
void identify_to_columns(const lg_machine_file *file, const double *q, const double *v, const double *before,
                         double *columns);
/* Columns as cells of a line of CSV, in the units of the log, and their names: without the line's end. */
void identify_put_columns(FILE *stream, const lg_machine_file *file, const double *columns);
void identify_put_names(FILE *stream, const lg_machine_file *file);
void identify_put_number(FILE *stream, double value);                   /* nothing where it is not finite */
bool identify_is_wrapped(const lg_machine_file *file, uint32_t column); /* an angle in radians */
bool identify_is_state(const lg_log_column *column);                    /* a position or velocity */
/* Whether a term of the part (LG_MACHINE_PART_COUNT: any) sees the position of the coordinate. */
bool identify_sees(const lg_machine *machine, int part, uint32_t coordinate);

/* Root mean squares of predicted minus logged columns, from the rows at which `q` is not NaN; NaN: nothing to
 * compare. Rows of `out`: columns of the file. */
void identify_column_errors(const identify_given *given, const double *q, const double *v, double *out);

/* Warns of each column in which the rows (those of the log, and those of q and v that are not NaN) leave the
 * range of the training data. q and v may be NULL. */
void identify_warn_range(const app *self, const identify_given *given, const double *q, const double *v);

/* ---- logs in the making (runs.c) ---- */

/* A log of pieces of equal length, as zeros. */
typedef struct identify_pieces {
    lg_machine_log log; /* of what follows */
    size_t *first;
    double *t, *q, *v, *u;
    size_t rows; /* of a piece */
} identify_pieces;
void identify_pieces_begin(identify_pieces *pieces, const lg_machine *machine, size_t count, size_t rows);
void identify_pieces_end(identify_pieces *pieces);

/* The parts of the first run, gaps between them. */
size_t identify_first_run(const lg_logs *logs);

/* ---- runs (runs.c): they end the command on failure ---- */

/* Runs as those of an lg_runner. */
void identify_run(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                  const size_t *start, size_t count, size_t steps, double *q, double *v);

/* Runs from rows start[0..count-1] to the ends of their parts; q (rows, positions) and v (rows, velocities)
 * are NaN where nothing is predicted. Starts are estimated where positions alone are measured. */
void identify_run_log(const app *self, const lg_learned_machine *model, const lg_machine_log *log,
                      const size_t *start, size_t count, double *q, double *v);

/* The first complete row of each part at or after row `from` of the part (without velocities: with all
 * positions); returns how many parts have one. */
size_t identify_first_rows(const lg_learned_machine *model, const lg_machine_log *log, size_t from,
                           size_t *out);

/* ---- bands (bands.c) ---- */

/* Standard deviations (rows, columns of the file) of predictions q and v from these starts, from 40 runs with
 * parameters theta + W x, x of N(0, 1), W the model's `spread`. */
void identify_bands(const app *self, const identify_given *given, const size_t *start, size_t count,
                    const double *q, const double *v, double *out);

/* ---- comparisons (linear.c, balance.c) ---- */

/* v' = A (q, v, u, 1), fitted to all rows of these logs; without velocities its runs are NaN. */
typedef struct identify_linear identify_linear;
identify_linear *identify_linear_create(const lg_machine *machine, const lg_machine_log *log);
void identify_linear_destroy(identify_linear *linear);
lg_runner identify_linear_run; /* of an identify_linear */

/* Sums over all intervals of the log, in the unit of energy: H at the end minus H at the start of each
 * interval is the work of the inputs, of damping and residual, and what the model does not explain. */
typedef enum identify_energy {
    ENERGY_CHANGE,
    ENERGY_INPUTS,
    ENERGY_DAMPING,
    ENERGY_RESIDUAL,
    ENERGY_LEFT,
    ENERGY_LEFT_SIZE,   /* of absolute values */
    ENERGY_CHANGE_SIZE, /* likewise */
    IDENTIFY_ENERGIES
} identify_energy;

/* Residuals of one interval's prediction, for each column: correlation of neighbours, the Ljung-Box statistic
 * of 10 lags and its probability for white residuals. */
typedef struct identify_whiteness {
    double rms, lag1, ljung_box, probability;
} identify_whiteness;

void identify_balance(const app *self, const identify_given *given, double energy[IDENTIFY_ENERGIES],
                      identify_whiteness *whiteness);

/* The same test for the residuals of a whole run, at the rows where q and v are predicted. */
void identify_run_whiteness(const identify_given *given, const double *q, const double *v,
                            identify_whiteness *out);

/* ---- forces and potential along a coordinate (balance.c) ---- */

/* Values of V or of a force at `count` states in the order of logs. Any of the outputs may be NULL. potential
 * (count); damping (count, velocities). */
void identify_values(const app *self, const lg_learned_machine *model, size_t count, const double *q,
                     const double *v, double *potential, double *damping);

/* ---- pictures (pictures.c) ---- */

/* Each column of the first run against time; q, v (rows, ...) predicted, or NULL; bands (rows, columns of
 * the file) their standard deviations, or NULL. */
void identify_draw_run(const app *self, const char *picture, const char *title, const lg_machine_file *file,
                       const lg_machine_log *log, size_t parts, const double *q, const double *v,
                       const double *bands);

/* What evaluate --plot draws: a free run, as the log's rows, and errors over horizons. */
void identify_draw_evaluation(const app *self, const char *picture, const identify_given *given,
                              const double *q, const double *v, const lg_horizon *horizons,
                              size_t horizon_count);

#endif

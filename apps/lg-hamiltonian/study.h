/* The study of lg-hamiltonian: it trains a model for each run of a grid and writes a table of the results.
 * Each row of the table is one run. */
#ifndef LG_APPS_STUDY_H
#define LG_APPS_STUDY_H

#include "common/trials.h"
#include "lg-hamiltonian/training.h"

/* The quantities that a study varies, and its results. */
enum { AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_EPS, AXIS_PENALTY, AXES };
enum { STUDY_LOSS, STUDY_E1, STUDY_E2, STUDY_SECONDS, MEASURES };
enum { STUDY_TEXT = 32, STUDY_PROTOCOL_TEXT = 13 };
extern const char *const study_axis_names[AXES], *const study_measure_names[MEASURES];

typedef struct study_axis {
    uint32_t count;
    char text[LG_GRID_VALUES][STUDY_TEXT]; /* the values as the table shows them */
    double number[LG_GRID_VALUES];         /* NaN for a value that is a name */
} study_axis;
/* Adds the value `name`, or `number` if `name` is NULL. */
void study_axis_add(study_axis *axis, const char *name, double number);

/* The runs are all combinations of the axes' values, each of them `repeats` times. */
typedef struct study_plan {
    study_axis axes[AXES];
    uint32_t repeats;
    uint64_t seed;
    /* Hash of all settings that are not columns; every row of the table has it. */
    char protocol[STUDY_PROTOCOL_TEXT];
} study_plan;

typedef struct study_row {
    uint32_t at[AXES]; /* index of the value on each axis */
    uint32_t repeat;   /* from 1 */
    uint64_t seed;
    double result[MEASURES]; /* NaN if the run failed */
    uint64_t epochs;
    bool failed; /* its numbers were not finite, or it did not converge */
} study_row;

size_t study_runs(const study_plan *plan);
/* A cell is all repeats of one combination of values. Cell i is the cell of study_run_at(plan, i), i <
 * study_cells(plan). */
size_t study_cells(const study_plan *plan);
study_row study_run_at(const study_plan *plan, size_t index);
/* Seed number `kind`, 0 to 7, of a repeat. Weights, shuffling and starts depend only on it, so all runs with
 * the same repeat number share them. Kind 0 is study_row.seed. */
uint64_t study_seed(uint64_t seed, uint64_t repeat, uint64_t kind);
void study_set_protocol(study_plan *plan, const char *text); /* to a hash of `text` */

/* The table, a CSV file. It is written whole, so a crash leaves the rows that were saved. A last row without
 * a line end is not read. */
typedef struct study_table {
    const study_plan *plan;
    app_file text;
    bool changed;    /* since it was read or saved */
    size_t count;    /* number of its rows; some may be of an earlier grid with other values */
    study_row *rows; /* (runs) */
    bool *done;      /* (runs) the run is in the table */
} study_table;
lg_status study_table_open(const char *path, const study_plan *plan, study_table *out, lg_error *error);
void study_table_add(study_table *table, size_t run);            /* appends rows[run] */
lg_status study_table_save(study_table *table, lg_error *error); /* does nothing if nothing has changed */
void study_table_close(study_table *table);

/* Medians and geometric means of the results, number of runs and of failed runs. */
typedef struct study_summary {
    size_t runs, failed;
    double median[MEASURES], geometric[MEASURES];
} study_summary;
typedef enum study_noise { STUDY_ANY, STUDY_WITHOUT, STUDY_WITH } study_noise;
/* Summarises the runs of the table that have the values of `key` on these axes, and such noise. */
study_summary study_summarise(const study_table *table, const study_row *key, const uint32_t *axes,
                              size_t count, study_noise noise);

/* Prints the medians over the repeats of each cell, and the geometric means over all runs of each integrator.
 * `fresh`: number of runs that this call of the command added. */
void study_report(const app *app, const study_table *table, size_t fresh, double seconds);
/* Draws median E1 against median training time: one mark per cell, one series per integrator and M. */
void study_draw_work(const app *app, const char *path, const study_table *table);
extern const uint32_t study_cell_axes[AXES]; /* all axes */

#endif

/* The study of lg-hamiltonian: it trains a model for each run of a grid and writes a table of the results.
 * Each row of the table is one run. */
#ifndef LG_APPS_STUDY_H
#define LG_APPS_STUDY_H

#include "common/trials.h"
#include "lg-hamiltonian/training.h"
#include "files/csv.h"

/* The quantities that a study varies, and its results. */
enum { AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_N, AXIS_M, AXIS_EPS, AXIS_PENALTY, AXES };
enum { STUDY_LOSS, STUDY_E1, STUDY_E2, STUDY_SECONDS, MEASURES };
/* The columns of the table: the axes, these, the measures, and three more. */
enum { STUDY_REPEAT = AXES, STUDY_SEED, STUDY_MEASURES, STUDY_EPOCHS = STUDY_MEASURES + MEASURES };
enum { STUDY_STATUS = STUDY_EPOCHS + 1, STUDY_PROTOCOL, STUDY_COLUMNS };
extern const char *const study_names[STUDY_COLUMNS];
enum { STUDY_PROTOCOL_TEXT = 13 };

typedef struct study_result {
    uint64_t run;           /* its number, which tells records of other processes from damaged ones */
    double value[MEASURES]; /* NaN if the run failed */
    uint64_t epochs;
    bool failed; /* its numbers were not finite, or it did not converge */
} study_result;

/* The runs are all combinations of the axes' values, each of them `repeats` times. A cell is all repeats of
 * one combination; its number is that of its first run. The table is a CSV file. It is written whole, so a
 * crash leaves the rows that were saved. A last row without a line end is not read. */
typedef struct study_table {
    size_t count[AXES];
    double value[AXES][LG_GRID_VALUES]; /* not of AXIS_INTEGRATOR */
    const lg_scheme *const *integrators;
    uint32_t repeats;
    uint64_t seed;
    /* Hash of all settings that are not columns; every row of the table has it. */
    char protocol[STUDY_PROTOCOL_TEXT];
    /* study_table_open sets the following members. */
    const char *path;
    lg_columns text;
    bool changed;          /* since it was read or saved */
    size_t rows;           /* number of its rows; some may be of an earlier grid with other values */
    study_result *results; /* (runs) */
    bool *done;            /* (runs) the run is in the table */
} study_table;

size_t study_cells(const study_table *table);
size_t study_runs(const study_table *table);
/* Number of the value that the run has on an axis; the value, not of AXIS_INTEGRATOR. */
size_t study_at(const study_table *table, size_t run, int axis);
double study_value(const study_table *table, size_t run, int axis);
/* Seed number `kind`, 0 to 7, of a run's repeat. Weights, shuffling and starts depend only on it, so all runs
 * of the same repeat share them. Kind 0 is in the table. */
uint64_t study_seed(const study_table *table, size_t run, uint64_t kind);
void study_set_protocol(study_table *table, const char *text); /* to a hash of `text` */

lg_status study_table_open(study_table *table, const char *path, lg_error *error);
void study_table_add(study_table *table, size_t run);            /* appends the row of results[run] */
lg_status study_table_save(study_table *table, lg_error *error); /* does nothing if nothing has changed */
void study_table_close(study_table *table);

/* Medians and geometric means of the results, number of runs and of failed runs. */
typedef struct study_summary {
    size_t runs, failed;
    double median[MEASURES], geometric[MEASURES];
} study_summary;
typedef enum study_noise { STUDY_ANY, STUDY_WITHOUT, STUDY_WITH } study_noise;
#define STUDY_CELL ((1u << AXES) - 1)
/* Summarises the runs of the table that have the values of `cell` on these axes (a bit for each), and such
 * noise. */
study_summary study_summarise(const study_table *table, size_t cell, unsigned axes, study_noise noise);

/* Prints the medians over the repeats of each cell, and the geometric means over all runs of each integrator.
 * `fresh`: number of runs that this call of the command added. */
void study_report(const app *app, const study_table *table, size_t fresh, double seconds);
/* Draws median E1 against median training time: one mark per cell, one series per integrator and M. */
void study_put(app_plot *plot, const void *table);

#endif

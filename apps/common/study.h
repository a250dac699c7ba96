/* What every `study` command shares: it trains a model at all points of a grid and writes a table of the
 * results. Each row of the table is one run. A row is appended when its run has ended, so after Ctrl-C or a
 * crash the same command continues.
 *
 * A command fills a study_task and calls study_main with it. */
#ifndef LG_APPS_STUDY_DRIVER_H
#define LG_APPS_STUDY_DRIVER_H

#include "common/trials.h"

enum { STUDY_AXES = 8, STUDY_VALUES = 16, STUDY_TEXT = 32, STUDY_MEASURES = 6, STUDY_PROTOCOL_TEXT = 13 };

/* A quantity that the study varies: a column of the table. */
typedef struct study_axis {
    const char *name;
    uint32_t count;
    char text[STUDY_VALUES][STUDY_TEXT]; /* the values as the table shows them */
    double number[STUDY_VALUES];         /* NaN for a value that is a name */
} study_axis;
/* Adds the value `name`, or `number` if `name` is NULL. */
void study_axis_add(study_axis *axis, const char *name, double number);

/* The runs are all combinations of the axes' values, each of them `repeats` times. */
typedef struct study_plan {
    uint32_t axis_count;
    study_axis axes[STUDY_AXES]; /* in the order of the columns */
    /* Indices of the axes from the fastest varying to the slowest; repeats vary slower than all axes. */
    uint32_t order[STUDY_AXES];
    uint32_t measure_count;
    const char *measures[STUDY_MEASURES]; /* names of the results; the last one is the training time */
    uint32_t repeats;
    uint64_t seed;
    /* Hash of all settings that are not columns; every row of the table has it. */
    char protocol[STUDY_PROTOCOL_TEXT];
} study_plan;

typedef struct study_row {
    /* Index of the value on each axis. It is the axis' count for a value that only an earlier grid had. */
    uint32_t at[STUDY_AXES];
    uint32_t repeat;
    uint64_t seed;
    double result[STUDY_MEASURES]; /* NaN if the run failed */
    uint64_t epochs;
    bool failed; /* its numbers were not finite, or it did not converge */
} study_row;

uint64_t study_runs(const study_plan *plan);
/* A cell is all repeats of one combination of values. Cell i is the cell of study_run_at(plan, i), i <
 * study_cells(plan). */
uint64_t study_cells(const study_plan *plan);
study_row study_run_at(const study_plan *plan, uint64_t index);
/* Seed number `kind`, 0 to 7, of a repeat. Weights, shuffling and starts depend only on it, so all runs with
 * the same repeat number share them. Kind 0 is study_row.seed. */
uint64_t study_seed(uint64_t seed, uint64_t repeat, uint64_t kind);
/* Sets plan->protocol to a hash of `text`. */
void study_set_protocol(study_plan *plan, const char *text);

/* ---- the table on disk (study_file.c) ---- */

/* The CSV file in memory. It is written whole, so a crash leaves the rows that were saved. A last row without a
 * line end is not read. */
typedef struct study_file {
    const study_plan *plan;
    app_file text;
    bool changed; /* since it was read or saved */
    size_t count, room;
    study_row *rows;
} study_file;

lg_status study_file_open(const char *path, const study_plan *plan, study_file *out, lg_error *error);
void study_file_append(study_file *file, const study_row *row);
lg_status study_file_save(study_file *file, lg_error *error); /* does nothing if nothing has changed */
/* The row of the run that `key` describes; NULL if this run is not done. */
const study_row *study_file_find(const study_file *file, const study_row *key);
void study_file_close(study_file *file);

/* ---- summaries ---- */

/* Summary of a set of runs: medians and geometric means of the results, number of runs and of failed runs. */
typedef struct study_summary {
    size_t runs, failed;
    double median[STUDY_MEASURES], geometric[STUDY_MEASURES];
} study_summary;

/* Collects up to `room` rows for a summary; study_end computes the summary and frees the collection. */
typedef struct study_collection {
    size_t count, failed;
    double *values[STUDY_MEASURES]; /* (room) each */
} study_collection;
study_collection study_collect(size_t room);
void study_add(study_collection *collection, const study_row *row); /* does nothing if row is NULL */
study_summary study_end(study_collection *collection);
study_summary study_cell_summary(const study_file *file, study_row key);

/* ---- the command ---- */

typedef struct study_values {
    const char *out;
    uint64_t jobs, stop_after;
    trials_values shared;
} study_values;
extern study_values study_given;
extern const lg_field study_options[];
#define STUDY_SHARED APP_GIVEN(study_options, study_given)

typedef struct study_task {
    void *user;
    /* Fills the plan from the grid file, argument 0; an error in it ends the command. */
    void (*read)(void *user, app *app, study_plan *plan);
    /* Trains and judges one run on `threads` threads; sets the row's results, including the training time,
     * and its epochs. Called by several threads at once. A run that overflows or does not converge counts as
     * failed in the table; any other failure ends the study. */
    lg_status (*run)(void *user, const app *app, const study_plan *plan, uint64_t threads, study_row *row,
                     lg_error *error);
    /* Writes the text that the progress line shows after a run. */
    void (*show)(const study_plan *plan, const study_row *row, char *text, size_t size);
    /* Prints tables or JSON. `fresh`: number of runs that this call of the command added. */
    void (*report)(const app *app, const study_file *file, uint64_t fresh, double seconds);
    const char *plot; /* path given by --plot; NULL: no plot */
    void (*draw)(const app *app, const char *path, const study_file *file);
} study_task;

void study_main(app *app, const study_task *task);

#endif

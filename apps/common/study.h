/* What every `study` command shares: a grid of trainings and the table of their results, resumable. A row of
 * the table is one run. It is appended when the run has ended, so that the same command goes on after Ctrl-C
 * or a crash.
 *
 * A command fills a study_task and calls study_main with it. */
#ifndef LG_APPS_STUDY_DRIVER_H
#define LG_APPS_STUDY_DRIVER_H

#include "common/board.h"

enum { STUDY_AXES = 8, STUDY_VALUES = 16, STUDY_TEXT = 32, STUDY_MEASURES = 6, STUDY_PROTOCOL_TEXT = 13 };

/* What a study varies: a column of the table. */
typedef struct study_axis {
    const char *name;
    uint32_t count;
    char text[STUDY_VALUES][STUDY_TEXT]; /* as in the table */
    double number[STUDY_VALUES];         /* NaN for a name */
} study_axis;
/* Adds a value; `name` NULL: the number. */
void study_axis_add(study_axis *axis, const char *name, double number);

/* All runs are the product of the axes and the repeats. */
typedef struct study_plan {
    uint32_t axis_count;
    study_axis axes[STUDY_AXES]; /* in the order of the columns */
    uint32_t order[STUDY_AXES];  /* positions of the axes, the one that varies fastest first; repeats vary
                                  * slowest */
    uint32_t measure_count;
    const char *measures[STUDY_MEASURES]; /* the last one is the time of training */
    uint32_t repeats;
    uint64_t seed;
    char protocol[STUDY_PROTOCOL_TEXT]; /* hash of all that is no column; it stands in each row */
} study_plan;

typedef struct study_row {
    uint32_t at[STUDY_AXES]; /* position on each axis; its count: a value of an earlier grid */
    uint32_t repeat;
    uint64_t seed;
    double result[STUDY_MEASURES]; /* NaN when the run failed */
    uint64_t epochs;
    bool failed; /* not finite or without convergence */
} study_row;

uint64_t study_runs(const study_plan *plan);
/* A cell is all repeats of a run; cell i is that of study_run_at(plan, i), i < study_cells(plan). */
uint64_t study_cells(const study_plan *plan);
study_row study_run_at(const study_plan *plan, uint64_t index);
/* Seed number `kind`, 0 to 7, of a repeat. Weights, shuffling and starts depend on it alone: the runs of a
 * repeat share them. Kind 0 is study_row.seed. */
uint64_t study_seed(uint64_t seed, uint64_t repeat, uint64_t kind);
/* Fills plan->protocol. */
void study_set_protocol(study_plan *plan, const char *text);

/* ---- the table on disk (study_file.c) ---- */

/* The CSV, opened for appending. Rows are written whole and fsynced; what a crash left of an unfinished last
 * row is cut off when the file is opened. */
typedef struct study_file {
    const char *path;
    const study_plan *plan;
    int fd;
    size_t count, room;
    study_row *rows;
} study_file;

lg_status study_file_open(const char *path, const study_plan *plan, study_file *out, lg_error *error);
lg_status study_file_append(study_file *file, const study_row *row, lg_error *error);
/* The row of this run; NULL: it is not done. */
const study_row *study_file_find(const study_file *file, const study_row *key);
void study_file_close(study_file *file);

/* ---- summaries ---- */

/* Results of a set of runs: medians, geometric means, how many there are and how many failed. */
typedef struct study_summary {
    size_t runs, failed;
    double median[STUDY_MEASURES], geometric[STUDY_MEASURES];
} study_summary;

/* Rows are collected, room for `room` of them, and summarised; the end frees. */
typedef struct study_collection {
    size_t count, failed;
    double *values[STUDY_MEASURES]; /* each (room) */
} study_collection;
study_collection study_collect(size_t room);
void study_add(study_collection *collection, const study_row *row); /* row NULL: nothing */
study_summary study_end(study_collection *collection);
study_summary study_cell_summary(const study_file *file, study_row key);

/* ---- the command ---- */

typedef struct study_values {
    const char *out;
    uint64_t jobs, stop_after;
    board_values board;
} study_values;
extern study_values study_given;
extern const lg_field study_options[];
#define STUDY_SHARED APP_GIVEN(study_options, study_given)

typedef struct study_task {
    void *user;
    /* Reads the grid, argument 0; what is wrong ends the command. */
    void (*read)(void *user, app *app, study_plan *plan);
    /* Trains and judges one run on `threads` threads: sets results, the last one included, and epochs.
     * Several threads call it at once. A run whose numbers overflow is a result of the study; any other
     * failure ends the study. */
    lg_status (*run)(void *user, const app *app, const study_plan *plan, uint64_t threads, study_row *row,
                     lg_error *error);
    /* The line of progress after a run. */
    void (*show)(const study_plan *plan, const study_row *row, char *text, size_t size);
    /* Tables or JSON; `fresh` runs are new. */
    void (*report)(const app *app, const study_file *file, uint64_t fresh, double seconds);
    const char *picture; /* --plot; NULL: not wanted */
    lg_status (*draw)(const app *app, const char *picture, const study_file *file, lg_error *error);
} study_task;

void study_main(app *app, const study_task *task);

#endif

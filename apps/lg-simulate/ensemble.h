/* --ensemble: many runs of a scene, and what is known of them together. */
#ifndef LG_APPS_ENSEMBLE_H
#define LG_APPS_ENSEMBLE_H

#include "lg-simulate/simulate.h"
#include "liegrad/ensemble.h"
#include "liegrad/tables.h"

/* ---- what varies (vary.c) ---- */

/* "q2.x", "mu.y", "R.13", "p" */
void component_name(const simulation *sim, size_t index, char *text, size_t size);
bool component_find(const simulation *sim, const char *name, size_t *index);

typedef struct vary vary;
/* `text`: NAME = DISTRIBUTION, ...; `table`: a file with a member a row, or NULL. */
vary *vary_open(const simulation *sim, const char *text, const char *table);
void vary_close(vary *self); /* NULL is fine */
bool vary_parameters(const vary *self);
size_t vary_rows(const vary *self); /* of the table; 0: none */
lg_status vary_draw(void *self, uint64_t member, double *y0, double *parameters);

/* ---- parts (ensemble_parts.c) ---- */

/* Part `index` of 0..count - 1; count 0: the whole. */
enum { TASKS_MAX = 1000000 };
typedef struct ensemble_task {
    uint64_t index, count;
} ensemble_task;
/* "out.h5" -> "out.part-3-of-8.h5"; of the whole "out.h5". Freed with free. */
char *part_path(const char *out, const ensemble_task *task);
/* "out.h5" -> "out.trajectories.h5" */
char *rows_path(const char *path);
/* Of the members first, first + 1, ... those below `saved`. */
uint64_t rows_among(uint64_t saved, uint64_t first, uint64_t members);

/* What a process does, and the files that it writes: of a task the files of its part alone. A single run is
 * the whole. */
typedef struct ensemble_files {
    ensemble_task task;
    char *out, *trajectories; /* NULL: not written */
} ensemble_files;
void ensemble_files_choose(const app *self, const simulate_values *values, ensemble_files *out);
void ensemble_files_free(ensemble_files *files);

/* ---- results ---- */

#define NAME_SIZE 64
typedef char column_name[NAME_SIZE];

enum { STATUSES = 17, LISTED = 100 };

typedef struct failure {
    uint64_t member, status;
    double t;
} failure;

#define MEMBERS_MAX 1e15 /* of an ensemble */

/* All that is known of an ensemble or of a part of it; parts are merged in any order. */
typedef struct result {
    char *what;              /* system, method, seed, distributions: parts of one ensemble have the same */
    uint64_t total;          /* members of the whole ensemble */
    uint64_t first, members; /* of this part */
    uint64_t block;          /* parts end with a whole block, or the ensemble */
    uint64_t saved;          /* members 0 .. saved - 1 of the whole have trajectories */
    size_t points, columns, events;
    double *t;                   /* (points) */
    column_name *column, *event; /* (columns), (events) */
    lg_statistics *states;       /* (points, columns) */
    lg_statistics *times;        /* (1, events), NULL without events */
    uint64_t steps, rejected;
    uint64_t failed[STATUSES]; /* by status */
    size_t listed;
    failure failures[LISTED]; /* the first of them, by member */
} result;

void result_free(result *self);
/* The number of members that failed. */
uint64_t result_failed(const result *self);
/* Adds to the list of the first failures, in order. */
void result_list(result *self, const failure *what);
/* `into` += `from`, of a part that is not in it yet. */
lg_status result_merge(result *into, const result *from, lg_error *error);

/* ensemble_file.c: HDF5 */
typedef struct result_rows {
    const lg_rows_part *parts; /* in the order of their members */
    size_t count;
    uint64_t dim; /* numbers of a state */
} result_rows;
/* `rows` NULL: without trajectories. */
lg_status result_write(const app *self, const char *path, const result *what, const result_rows *rows,
                       lg_error *error);
void result_read(const app *self, const char *path, result *out);

/* ensemble_report.c */
typedef struct ensemble_run {
    const result *what;
    const lg_ensemble_stats *stats; /* NULL: merged from files */
    const char *out;
} ensemble_run;
/* Shows it, and warns of members that failed. An exit code: that of the failure where all of them failed. */
int ensemble_conclude(const app *self, const ensemble_run *run);
lg_status ensemble_draw(const app *self, const result *what, const char *path, lg_error *error);

/* ensemble.c: an exit code, as of merge_parts; ranks agree on it. */
int ensemble(simulation *sim, const ensemble_files *files);
/* merge.c: one file of the parts, and what it says; then lg-simulate merge OUT.h5 PARTS... */
typedef struct merge_values {
    const char *plot;
    bool statistics_only; /* trajectories are left out */
} merge_values;
int merge_parts(const app *self, const char *out, const char *const *paths, size_t count,
                const merge_values *how);
int merge_main(int argc, char **argv);

#endif

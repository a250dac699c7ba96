/* --ensemble: many runs of a scene, and the statistics of all of them. */
#ifndef LG_APPS_ENSEMBLE_H
#define LG_APPS_ENSEMBLE_H

#include "lg-simulate/simulate.h"
#include "liegrad/ensemble.h"

/* ---- what varies between members (vary.c) ---- */

/* Components are the numbers of the state, with names such as "q2.x", "mu.y", "R.13" or "p", and then, from
 * sim->dim on, the parameters, such as "m2". component_name writes the name (in 64 bytes) of number `index`;
 * component_find finds the index. */
void component_name(const simulation *sim, size_t index, char *text, size_t size);
bool component_find(const simulation *sim, const char *name, size_t *index);

char *trimmed(char *text); /* without blanks at its beginning and end, which is cut off */
typedef struct vary vary;
/* `text`: NAME = DISTRIBUTION, ...; `table`: path of a table with one row per member, or NULL. *rows: number
 * of rows of the table, 0 without; *parameters: whether parameters vary. */
vary *vary_open(const simulation *sim, const char *text, const char *table, size_t *rows, bool *parameters);
void vary_close(vary *self); /* NULL is allowed */
lg_status vary_draw(void *self, uint64_t member, double *y0, double *parameters);

/* ---- parts of an ensemble (ensemble_parts.c) ---- */

/* Part `index` of 0..count - 1. count 0 means the whole ensemble. */
enum { TASKS_MAX = 1000000 };
typedef struct ensemble_task {
    uint64_t index, count;
} ensemble_task;
/* Path of a part's file: "out.h5" -> "out.part-3-of-8.h5". For the whole ensemble it is `out`. */
char *part_path(const char *out, const ensemble_task *task);
/* Path of the trajectories: "out.h5" -> "out.trajectories.h5". */
char *rows_path(const char *path);
/* How many of the members first, first + 1, ..., first + members - 1 are below `saved`. */
uint64_t rows_among(uint64_t saved, uint64_t first, uint64_t members);

/* The part of the ensemble that a process runs, and the files that it writes. A task writes only the files of
 * its part. A process without --task runs the whole ensemble. */
typedef struct ensemble_files {
    ensemble_task task;
    char *out, *trajectories; /* NULL if the file is not written */
} ensemble_files;
void ensemble_files_choose(const app *self, const simulate_values *values, ensemble_files *out);

/* ---- results ---- */

#define NAME_SIZE 64
typedef char column_name[NAME_SIZE];

enum { STATUSES = 17, LISTED = 100 };

#define MEMBERS_MAX 1e15 /* largest number of members of an ensemble */

/* The statistics of an ensemble or of a part of it. Parts can be merged in any order. */
typedef struct result {
    char *what; /* system, method, seed and distributions as a text that all parts of one ensemble share */
    union {
        struct {
            uint64_t total;          /* members of the whole ensemble */
            uint64_t first, members; /* members first .. first + members - 1 are in this part */
            uint64_t block; /* members per block; each part ends at the end of a block or of the ensemble */
            uint64_t steps, rejected, points, columns, events, listed;
            uint64_t saved; /* members 0 .. saved - 1 of the ensemble have trajectories */
        };
        uint64_t numbers[11]; /* these, as they lie in files */
    };
    double *t;                   /* (points) */
    column_name *column, *event; /* (columns), (events) */
    lg_statistics *states;       /* (points, columns) */
    lg_statistics *times;        /* (1, events); NULL without events */
    uint64_t failed[STATUSES];   /* number of failed members by status */
    uint64_t left;               /* members that leave the manifold; not in files */
    uint64_t lost;               /* members whose energy changes too much; not in files */
    /* (listed): number and status of the failed members with the lowest numbers; when they failed */
    uint64_t who[LISTED][2];
    double when[LISTED];
} result;

void result_free(result *self); /* its statistics; the other memory is kept */
/* For each column whether its histogram is logarithmic, as of a drift. */
const bool *result_logarithmic(const result *self);
/* The number of members that failed. */
uint64_t result_failed(const result *self);
/* Adds a failure to the list, which is sorted by member and keeps the first LISTED. */
void result_list(result *self, uint64_t member, uint64_t status, double t);
/* Adds the part `from` to `into`, which must not have its members yet. */
lg_status result_merge(result *into, const result *from, lg_error *error);

/* ensemble_file.c: ensembles as HDF5 files. */
typedef struct result_rows {
    const lg_rows_part *parts; /* in the order of their members */
    size_t count;
    uint64_t dim; /* numbers per state */
} result_rows;
/* `rows` NULL: the file has no trajectories. */
lg_status result_write(const app *self, const char *path, result *what, const result_rows *rows,
                       lg_error *error);
/* The caller must free `out` after a failure, too. */
lg_status result_read(const app *self, const char *path, result *out, lg_error *error);

/* ensemble_report.c: prints the results and warns of members that failed. If all failed, it ends the command
 * with the exit code of their most frequent status. `stats` is NULL if the results were merged from files. */
void ensemble_conclude(const app *self, const result *what, const lg_ensemble_stats *stats, const char *out);
extern const app_plot_kind ensemble_plots[]; /* of a result */

/* ensemble.c: runs the ensemble. A failure of one rank is a failure of all. */
void ensemble(simulation *sim, const ensemble_files *files);
/* merge.c: merge_parts writes one file from the parts and prints its results; merge_main is the command
 * lg-simulate merge OUT.h5 PARTS... */
void merge_parts(const app *self, const char *out, const char *const *paths, size_t count,
                 bool statistics_only);
int merge_main(int argc, char **argv);

#endif

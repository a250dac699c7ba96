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
int vary_open(const simulation *sim, const char *text, const char *table, vary **out);
void vary_close(vary *self); /* NULL is fine */
bool vary_parameters(const vary *self);
bool vary_state(const vary *self);
size_t vary_rows(const vary *self); /* of the table; 0: none */
lg_status vary_draw(void *self, uint64_t member, double *y0, double *parameters);

/* ---- results ---- */

#define NAME_SIZE 64
typedef char column_name[NAME_SIZE];

enum { STATUSES = 17, LISTED = 100 };

typedef struct failure {
    uint64_t member, status;
    double t;
} failure;

/* All that is known of an ensemble or of a part of it; parts are merged in any order. */
typedef struct result {
    char *what;              /* system, method, seed, distributions: parts of one ensemble have the same */
    uint64_t total;          /* members of the whole ensemble */
    uint64_t first, members; /* of this part */
    uint64_t block;          /* parts end with a whole block, or the ensemble */
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
lg_status result_write(const app *self, const char *path, const result *what, const char *const *parts,
                       size_t part_count, lg_error *error);
lg_status result_read(const app *self, const char *path, result *out, lg_error *error);

/* ensemble_report.c */
typedef struct ensemble_run {
    const result *what;
    const lg_ensemble_stats *stats; /* NULL: merged from files */
    const char *out;
} ensemble_run;
void ensemble_json(const app *self, const ensemble_run *run);
void ensemble_text(const ensemble_run *run);
lg_status ensemble_draw(const app *self, const result *what, const char *path, lg_error *error);

/* ensemble.c */
int ensemble(simulation *sim);
/* merge.c: one file of the parts, and what it says; then lg-simulate merge OUT.h5 PARTS... */
int merge_parts(const app *self, const char *out, const char *const *paths, size_t count, const char *plot);
int merge_main(int argc, char **argv);

#endif

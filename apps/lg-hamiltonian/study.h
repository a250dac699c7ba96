/* A study: its runs, the table of rows that is its state on disk, its summaries. */
#ifndef LG_APPS_STUDY_H
#define LG_APPS_STUDY_H

#include <pthread.h>

#include "lg-hamiltonian/learning.h"

#define STUDY_PROTOCOL_TEXT 13

/* One run. The first seven fields are its key. */
typedef struct study_row {
    const lg_scheme *integrator;
    uint32_t substeps, n, m;
    double eps, penalty;
    uint32_t repeat;
    uint64_t seed;
    double loss, e1, e2; /* NaN when the run failed */
    double seconds;      /* of training */
    uint64_t epochs;
    bool failed; /* not finite or without convergence */
} study_row;

/* The CSV, opened for appending. Rows are written whole and fsynced; what a crash left of an unfinished last
 * row is cut off when the file is opened. */
typedef struct study_file {
    const char *path;
    int fd;
    char protocol[STUDY_PROTOCOL_TEXT]; /* hash of all that is not in the key, in each row */
    size_t count, room;
    study_row *rows;
} study_file;

lg_status study_file_open(const char *path, const char *protocol, study_file *out, lg_error *error);
lg_status study_file_append(study_file *file, const study_row *row, lg_error *error);
const study_row *study_file_find(const study_file *file, const study_row *key);
void study_file_close(study_file *file);

/* Position 0 .. lg_grid_runs - 1 -> key and seed. Repeats vary slowest, integrators and substeps fastest. */
study_row study_run_at(const lg_grid *grid, uint64_t index);
void study_protocol(const lg_grid *grid, char out[STUDY_PROTOCOL_TEXT]);

/* Medians over the repeats of each cell, geometric means of each integrator. */
void study_print_tables(const lg_grid *grid, const study_file *file);
void study_print_json(const app *app, const lg_grid *grid, const study_file *file, uint64_t fresh,
                      double seconds);

/* Results of a set of runs: medians, geometric means, how many there are and how many failed. */
enum { STUDY_LOSS, STUDY_E1, STUDY_E2, STUDY_SECONDS, STUDY_MEASURES };
typedef struct summary {
    size_t runs, failed;
    double median[STUDY_MEASURES], geometric[STUDY_MEASURES];
} summary;

/* A cell is all repeats of a run; cell i is that of study_run_at(grid, i), i < study_cells(grid). */
uint64_t study_cells(const lg_grid *grid);
summary study_cell_summary(const lg_grid *grid, const study_file *file, study_row key);

typedef lg_status (*study_picture)(const app *app, const char *picture, const lg_grid *grid,
                                   const study_file *file, lg_error *error);
/* Median E1 against median training time, one mark a cell, one series an integrator and number of substeps.
 */
lg_status study_draw_work(const app *app, const char *picture, const lg_grid *grid, const study_file *file,
                          lg_error *error);
/* E1 of every run against the noise, one series an integrator, number of substeps and penalty. */
lg_status study_draw_noise(const app *app, const char *picture, const lg_grid *grid, const study_file *file,
                           lg_error *error);
/* Parallel coordinates: integrator, N, M, eps, loss, E2, E1, one line a cell (medians); cyan where E1 < 1e-7.
 */
lg_status study_draw_parallel(const app *app, const char *picture, const lg_grid *grid,
                              const study_file *file, lg_error *error);

#endif

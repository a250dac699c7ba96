/* Summaries of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>

static const char *const measures[4] = {"loss", "E1", "E2", "seconds"};

typedef struct collection {
    size_t count, failed;
    double *values[4]; /* each (room) */
} collection;

static collection collection_make(size_t room) {
    collection c = {0, 0, {NULL, NULL, NULL, NULL}};
    for (int k = 0; k < 4; k++) c.values[k] = app_alloc(room, sizeof(double));
    return c;
}

static void collection_add(collection *c, const study_row *row) {
    const double results[4] = {row->loss, row->e1, row->e2, row->seconds};
    if (row->failed) {
        c->failed++;
        return;
    }
    for (int k = 0; k < 4; k++) c->values[k][c->count] = results[k];
    c->count++;
}

static summary collection_end(collection *c) {
    summary s = {.runs = c->count + c->failed, .failed = c->failed};
    for (int k = 0; k < 4; k++) {
        double logarithm = 0;
        for (size_t i = 0; i < c->count; i++) logarithm += log(c->values[k][i]);
        s.geometric[k] = c->count > 0 ? exp(logarithm / (double)c->count) : (double)NAN;
        s.median[k] = app_median(c->values[k], c->count);
        free(c->values[k]);
    }
    return s;
}

summary study_cell_summary(const lg_grid *grid, const study_file *file, study_row key) {
    collection c = collection_make(grid->repeats);
    for (key.repeat = 1; key.repeat <= grid->repeats; key.repeat++) {
        const study_row *row = study_file_find(file, &key);
        if (row != NULL) collection_add(&c, row);
    }
    return collection_end(&c);
}

/* Over all runs of the grid with this integrator and number of substeps. */
static summary integrator_summary(const lg_grid *grid, const study_file *file, const lg_scheme *integrator,
                                  uint32_t substeps) {
    const uint64_t runs = lg_grid_runs(grid);
    collection c = collection_make((size_t)runs);
    for (uint64_t i = 0; i < runs; i++) {
        const study_row key = study_run_at(grid, i);
        if (key.integrator != integrator || key.substeps != substeps) continue;
        const study_row *row = study_file_find(file, &key);
        if (row != NULL) collection_add(&c, row);
    }
    return collection_end(&c);
}

/* A combination (integrator, substeps, N, M, penalty) over all noises of one kind and all repeats. */
typedef struct combination {
    study_row key;
    summary summary;
} combination;

enum { BEST = 5 };

static int by_e1(const void *a, const void *b) {
    return app_compare_doubles(&((const combination *)a)->summary.geometric[1],
                               &((const combination *)b)->summary.geometric[1]);
}

static summary combination_summary(const lg_grid *grid, const study_file *file, study_row key, bool noisy) {
    collection c = collection_make((size_t)grid->eps_count * grid->repeats);
    for (uint32_t i = 0; i < grid->eps_count; i++) {
        if ((grid->eps[i] > 0) != noisy) continue;
        key.eps = grid->eps[i];
        for (key.repeat = 1; key.repeat <= grid->repeats; key.repeat++) {
            const study_row *row = study_file_find(file, &key);
            if (row != NULL) collection_add(&c, row);
        }
    }
    return collection_end(&c);
}

/* Fills best[0..] in the order of the geometric mean of E1; returns how many there are. */
static size_t best_combinations(const lg_grid *grid, const study_file *file, bool noisy,
                                combination best[BEST]) {
    const size_t all = (size_t)(lg_grid_runs(grid) / grid->repeats / grid->eps_count);
    combination *list = app_alloc(all, sizeof *list);
    size_t n = 0;
    for (size_t i = 0; i < all; i++) {
        list[n].key = study_run_at(grid, i);
        list[n].summary = combination_summary(grid, file, list[n].key, noisy);
        if (list[n].summary.runs > list[n].summary.failed) n++;
    }
    qsort(list, n, sizeof *list, by_e1);
    if (n > BEST) n = BEST;
    for (size_t i = 0; i < n; i++) best[i] = list[i];
    free(list);
    return n;
}

uint64_t study_cells(const lg_grid *grid) {
    return lg_grid_runs(grid) / grid->repeats;
}

static void number_cell(app_table *table, const char *format, double value) {
    if (isfinite(value))
        app_table_cell(table, format, value);
    else
        app_table_cell(table, "-");
}

static void print_cells(const lg_grid *grid, const study_file *file) {
    static const char *const titles[] = {"integrator", "substeps", "N",  "M",       "eps",  "penalty",
                                         "loss",       "E1",       "E2", "seconds", "runs", "failed"};
    app_table table;
    app_table_begin(&table, LG_COUNT(titles));
    for (size_t i = 0; i < LG_COUNT(titles); i++) app_table_cell(&table, "%s", titles[i]);
    for (uint64_t i = 0; i < study_cells(grid); i++) {
        const study_row key = study_run_at(grid, i);
        const summary s = study_cell_summary(grid, file, key);
        if (s.runs == 0) continue;
        app_table_cell(&table, "%s", key.integrator->name);
        app_table_cell(&table, "%u", key.substeps);
        app_table_cell(&table, "%u", key.n);
        app_table_cell(&table, "%u", key.m);
        app_table_cell(&table, "%g", key.eps);
        app_table_cell(&table, "%g", key.penalty);
        for (int k = 0; k < 4; k++) number_cell(&table, k < 3 ? "%.2e" : "%.2f", s.median[k]);
        app_table_cell(&table, "%zu", s.runs);
        app_table_cell(&table, "%zu", s.failed);
    }
    (void)printf("Medians over the repeats\n");
    app_table_end(&table, stdout);
}

static void print_best(const lg_grid *grid, const study_file *file, bool noisy) {
    static const char *const titles[] = {"integrator", "substeps", "N", "M", "penalty", "E1", "E2", "runs"};
    combination best[BEST];
    const size_t n = best_combinations(grid, file, noisy, best);
    if (n == 0) return;
    app_table table;
    app_table_begin(&table, LG_COUNT(titles));
    for (size_t i = 0; i < LG_COUNT(titles); i++) app_table_cell(&table, "%s", titles[i]);
    for (size_t i = 0; i < n; i++) {
        app_table_cell(&table, "%s", best[i].key.integrator->name);
        app_table_cell(&table, "%u", best[i].key.substeps);
        app_table_cell(&table, "%u", best[i].key.n);
        app_table_cell(&table, "%u", best[i].key.m);
        app_table_cell(&table, "%g", best[i].key.penalty);
        number_cell(&table, "%.2e", best[i].summary.geometric[1]);
        number_cell(&table, "%.2e", best[i].summary.geometric[2]);
        app_table_cell(&table, "%zu", best[i].summary.runs - best[i].summary.failed);
    }
    (void)printf("\nBest combinations %s noise (geometric means)\n", noisy ? "with" : "without");
    app_table_end(&table, stdout);
}

void study_print_tables(const lg_grid *grid, const study_file *file) {
    static const char *const titles[] = {"integrator", "substeps", "E1",   "E2",
                                         "loss",       "seconds",  "runs", "failed"};
    static const int order[] = {1, 2, 0, 3};
    app_table table;
    print_cells(grid, file);
    app_table_begin(&table, LG_COUNT(titles));
    for (size_t i = 0; i < LG_COUNT(titles); i++) app_table_cell(&table, "%s", titles[i]);
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        for (uint32_t j = 0; j < grid->substeps_count; j++) {
            const summary s = integrator_summary(grid, file, grid->integrators[i], grid->substeps[j]);
            if (s.runs == 0) continue;
            app_table_cell(&table, "%s", grid->integrators[i]->name);
            app_table_cell(&table, "%u", grid->substeps[j]);
            for (int k = 0; k < 4; k++) number_cell(&table, k < 3 ? "%.2e" : "%.2f", s.geometric[order[k]]);
            app_table_cell(&table, "%zu", s.runs);
            app_table_cell(&table, "%zu", s.failed);
        }
    (void)printf("\nGeometric means over all runs of an integrator\n");
    app_table_end(&table, stdout);
    print_best(grid, file, false);
    print_best(grid, file, true);
}

static void json_summary(app_json *json, const summary *s, const double *figures) {
    for (int k = 0; k < 4; k++) app_json_real(json, measures[k], figures[k]);
    app_json_size(json, "runs", s->runs);
    app_json_size(json, "failed", s->failed);
}

static void json_best(app_json *json, const char *key, const lg_grid *grid, const study_file *file,
                      bool noisy) {
    combination best[BEST];
    const size_t n = best_combinations(grid, file, noisy, best);
    app_json_open(json, key, '[');
    for (size_t i = 0; i < n; i++) {
        app_json_open(json, NULL, '{');
        app_json_text(json, "integrator", best[i].key.integrator->name);
        app_json_size(json, "substeps", best[i].key.substeps);
        app_json_size(json, "N", best[i].key.n);
        app_json_size(json, "M", best[i].key.m);
        app_json_real(json, "penalty", best[i].key.penalty);
        json_summary(json, &best[i].summary, best[i].summary.geometric);
        app_json_close(json, '}');
    }
    app_json_close(json, ']');
}

void study_print_json(const app *self, const lg_grid *grid, const study_file *file, uint64_t fresh,
                      double seconds) {
    app_json json;
    app_json_begin(&json);
    app_json_size(&json, "planned", lg_grid_runs(grid));
    app_json_size(&json, "done", file->count);
    app_json_size(&json, "new", fresh);
    app_json_text(&json, "protocol", file->protocol);
    app_json_open(&json, "medians", '[');
    for (uint64_t i = 0; i < study_cells(grid); i++) {
        const study_row key = study_run_at(grid, i);
        const summary s = study_cell_summary(grid, file, key);
        if (s.runs == 0) continue;
        app_json_open(&json, NULL, '{');
        app_json_text(&json, "integrator", key.integrator->name);
        app_json_size(&json, "substeps", key.substeps);
        app_json_size(&json, "N", key.n);
        app_json_size(&json, "M", key.m);
        app_json_real(&json, "eps", key.eps);
        app_json_real(&json, "penalty", key.penalty);
        json_summary(&json, &s, s.median);
        app_json_close(&json, '}');
    }
    app_json_close(&json, ']');
    app_json_open(&json, "geometric_means", '[');
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        for (uint32_t j = 0; j < grid->substeps_count; j++) {
            const summary s = integrator_summary(grid, file, grid->integrators[i], grid->substeps[j]);
            app_json_open(&json, NULL, '{');
            app_json_text(&json, "integrator", grid->integrators[i]->name);
            app_json_size(&json, "substeps", grid->substeps[j]);
            json_summary(&json, &s, s.geometric);
            app_json_close(&json, '}');
        }
    app_json_close(&json, ']');
    json_best(&json, "best_without_noise", grid, file, false);
    json_best(&json, "best_with_noise", grid, file, true);
    app_json_size(&json, "threads", self->threads);
    app_json_text(&json, "out", file->path);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

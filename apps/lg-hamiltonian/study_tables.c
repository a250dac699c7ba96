/* Summaries of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>

/* Results of a set of runs: medians, geometric means, how many there are and how many failed. */
typedef struct summary {
    size_t runs, failed;
    double median[4], geometric[4]; /* loss, E1, E2, seconds */
} summary;
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

/* Over the repeats of the cell of `key`. */
static summary cell_summary(const lg_grid *grid, const study_file *file, study_row key) {
    collection c = collection_make(grid->repeats);
    for (key.repeat = 1; key.repeat <= grid->repeats; key.repeat++) {
        const study_row *row = study_file_find(file, &key);
        if (row != NULL) collection_add(&c, row);
    }
    return collection_end(&c);
}

/* Over all runs of the grid with this integrator and number of substeps. */
static summary integrator_summary(const lg_grid *grid, const study_file *file, lg_train_integrator integrator,
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

static uint64_t cells(const lg_grid *grid) {
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
    app_table_begin(&table, APP_COUNT(titles));
    for (size_t i = 0; i < APP_COUNT(titles); i++) app_table_cell(&table, "%s", titles[i]);
    for (uint64_t i = 0; i < cells(grid); i++) {
        const study_row key = study_run_at(grid, i);
        const summary s = cell_summary(grid, file, key);
        if (s.runs == 0) continue;
        app_table_cell(&table, "%s", lg_train_integrator_name(key.integrator));
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

void study_print_tables(const lg_grid *grid, const study_file *file) {
    static const char *const titles[] = {"integrator", "substeps", "E1",   "E2",
                                         "loss",       "seconds",  "runs", "failed"};
    static const int order[] = {1, 2, 0, 3};
    app_table table;
    print_cells(grid, file);
    app_table_begin(&table, APP_COUNT(titles));
    for (size_t i = 0; i < APP_COUNT(titles); i++) app_table_cell(&table, "%s", titles[i]);
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        for (uint32_t j = 0; j < grid->substeps_count; j++) {
            const summary s = integrator_summary(grid, file, grid->integrators[i], grid->substeps[j]);
            if (s.runs == 0) continue;
            app_table_cell(&table, "%s", lg_train_integrator_name(grid->integrators[i]));
            app_table_cell(&table, "%u", grid->substeps[j]);
            for (int k = 0; k < 4; k++) number_cell(&table, k < 3 ? "%.2e" : "%.2f", s.geometric[order[k]]);
            app_table_cell(&table, "%zu", s.runs);
            app_table_cell(&table, "%zu", s.failed);
        }
    (void)printf("\nGeometric means over all runs of an integrator\n");
    app_table_end(&table, stdout);
}

static void json_summary(app_json *json, const summary *s, const double *figures) {
    for (int k = 0; k < 4; k++) app_json_real(json, measures[k], figures[k]);
    app_json_size(json, "runs", s->runs);
    app_json_size(json, "failed", s->failed);
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
    for (uint64_t i = 0; i < cells(grid); i++) {
        const study_row key = study_run_at(grid, i);
        const summary s = cell_summary(grid, file, key);
        if (s.runs == 0) continue;
        app_json_open(&json, NULL, '{');
        app_json_text(&json, "integrator", lg_train_integrator_name(key.integrator));
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
            app_json_text(&json, "integrator", lg_train_integrator_name(grid->integrators[i]));
            app_json_size(&json, "substeps", grid->substeps[j]);
            json_summary(&json, &s, s.geometric);
            app_json_close(&json, '}');
        }
    app_json_close(&json, ']');
    app_json_size(&json, "threads", self->threads);
    app_json_text(&json, "out", file->path);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

lg_status study_draw(const app *self, const char *picture, const lg_grid *grid, const study_file *file,
                     lg_error *error) {
    app_plot plot;
    bool drawn;
    const lg_status status = app_plot_begin(&plot, picture, 800, 600);
    if (status != LG_OK) return status;
    (void)fputs("set logscale xy\nset format y '10^{%L}'\nset xlabel 'seconds of training'\nset ylabel 'E1'\n"
                "set key outside\nplot ",
                plot.script.stream);
    size_t block = 0;
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        for (uint32_t j = 0; j < grid->substeps_count; j++, block++) {
            (void)fprintf(plot.data.stream, "# %s, %u substeps\n",
                          lg_train_integrator_name(grid->integrators[i]), grid->substeps[j]);
            (void)fputs("nan nan\n", plot.data.stream);
            for (uint64_t c = 0; c < cells(grid); c++) {
                const study_row key = study_run_at(grid, c);
                if (key.integrator != grid->integrators[i] || key.substeps != grid->substeps[j]) continue;
                const summary s = cell_summary(grid, file, key);
                if (s.runs > s.failed)
                    (void)fprintf(plot.data.stream, "%.9g %.9g\n", s.median[3], s.median[1]);
            }
            app_plot_block(&plot);
            (void)fprintf(plot.script.stream,
                          "%sdatafile index %zu using 1:2 with points pt 7 ps 0.8 title '%s x%u'",
                          block > 0 ? ", " : "", block, lg_train_integrator_name(grid->integrators[i]),
                          grid->substeps[j]);
        }
    (void)fputc('\n', plot.script.stream);
    return app_plot_end(self, &plot, &drawn, error);
}

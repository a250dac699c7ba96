/* The pictures of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>

static lg_status begin(app_plot *plot, const char *picture, lg_error *error) {
    const lg_status status = app_plot_begin(plot, picture, 900, 600);
    if (status != LG_OK && error != NULL) {
        error->status = status;
        (void)snprintf(error->message, sizeof error->message, "%s: the name must end in .svg or .png",
                       picture);
    }
    return status;
}

static void put_series(app_plot *plot, size_t block, const char *title) {
    (void)fprintf(plot->script.stream, "%sdatafile index %zu using 1:2 with points pt 7 ps 0.7 title '%s'",
                  block > 0 ? ", " : "plot ", block, title);
}

lg_status study_draw_work(const app *self, const char *picture, const lg_grid *grid, const study_file *file,
                          lg_error *error) {
    app_plot plot;
    bool drawn;
    char title[64];
    size_t block = 0;
    const lg_status status = begin(&plot, picture, error);
    if (status != LG_OK) return status;
    (void)fputs("set logscale xy\nset format y '10^{%L}'\nset xlabel 'seconds of training'\nset ylabel 'E1'\n"
                "set key outside\n",
                plot.script.stream);
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        for (uint32_t j = 0; j < grid->substeps_count; j++, block++) {
            (void)fputs("nan nan\n", plot.data.stream); /* no series is without a line */
            for (uint64_t c = 0; c < study_cells(grid); c++) {
                const study_row key = study_run_at(grid, c);
                if (key.integrator != grid->integrators[i] || key.substeps != grid->substeps[j]) continue;
                const summary s = study_cell_summary(grid, file, key);
                if (s.runs > s.failed)
                    (void)fprintf(plot.data.stream, "%.9g %.9g\n", s.median[STUDY_SECONDS],
                                  s.median[STUDY_E1]);
            }
            app_plot_block(&plot);
            (void)snprintf(title, sizeof title, "%s, %u substep%s",
                           lg_train_integrator_name(grid->integrators[i]), grid->substeps[j],
                           grid->substeps[j] == 1 ? "" : "s");
            put_series(&plot, block, title);
        }
    (void)fputc('\n', plot.script.stream);
    return app_plot_end(self, &plot, &drawn, error);
}

lg_status study_draw_noise(const app *self, const char *picture, const lg_grid *grid, const study_file *file,
                           lg_error *error) {
    app_plot plot;
    bool drawn;
    char title[96];
    const lg_status status = begin(&plot, picture, error);
    if (status != LG_OK) return status;
    (void)fputs("set logscale y\nset format y '10^{%L}'\nset xlabel 'noise'\nset offsets graph 0.05, graph "
                "0.05, 0, 0\nset ylabel 'E1'\nset key outside\n",
                plot.script.stream);
    const uint64_t series = (uint64_t)grid->integrator_count * grid->substeps_count * grid->penalty_count;
    for (uint64_t k = 0; k < series; k++) {
        const study_row first = study_run_at(grid, k);
        (void)fputs("nan nan\n", plot.data.stream);
        for (size_t i = 0; i < file->count; i++) {
            const study_row *row = &file->rows[i];
            if (row->integrator == first.integrator && row->substeps == first.substeps &&
                row->penalty == first.penalty && !row->failed)
                (void)fprintf(plot.data.stream, "%.9g %.9g\n", row->eps, row->e1);
        }
        app_plot_block(&plot);
        (void)snprintf(title, sizeof title, "%s, %u, penalty %g", lg_train_integrator_name(first.integrator),
                       first.substeps, first.penalty);
        put_series(&plot, (size_t)k, title);
    }
    (void)fputc('\n', plot.script.stream);
    return app_plot_end(self, &plot, &drawn, error);
}

/* ---- parallel coordinates ---- */

enum { AXES = 7 };
static const char *const axis_names[AXES] = {"integrator", "N",        "M",       "eps",
                                             "log10 loss", "log10 E2", "log10 E1"};

typedef struct axes {
    double low[AXES], high[AXES];
} axes;

/* Positions in the grid's lists for what is chosen, logarithms for what is measured. */
static bool coordinates(const lg_grid *grid, const study_file *file, const study_row *key, double x[AXES]) {
    const summary s = study_cell_summary(grid, file, *key);
    if (s.runs == s.failed) return false;
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        if (grid->integrators[i] == key->integrator) x[0] = i;
    for (uint32_t i = 0; i < grid->n_count; i++)
        if (grid->n[i] == key->n) x[1] = i;
    for (uint32_t i = 0; i < grid->m_count; i++)
        if (grid->m[i] == key->m) x[2] = i;
    for (uint32_t i = 0; i < grid->eps_count; i++)
        if (grid->eps[i] == key->eps) x[3] = i;
    x[4] = log10(s.median[STUDY_LOSS]);
    x[5] = log10(s.median[STUDY_E2]);
    x[6] = log10(s.median[STUDY_E1]);
    return true;
}

static axes find_axes(const lg_grid *grid, const study_file *file) {
    axes a = {.high = {grid->integrator_count - 1.0, grid->n_count - 1.0, grid->m_count - 1.0,
                       grid->eps_count - 1.0}};
    double x[AXES];
    for (int k = 4; k < AXES; k++) {
        a.low[k] = INFINITY;
        a.high[k] = -INFINITY;
    }
    for (uint64_t c = 0; c < study_cells(grid); c++) {
        const study_row key = study_run_at(grid, c);
        if (!coordinates(grid, file, &key, x)) continue;
        for (int k = 4; k < AXES; k++) {
            a.low[k] = fmin(a.low[k], floor(x[k]));
            a.high[k] = fmax(a.high[k], ceil(x[k]));
        }
    }
    return a;
}

static double height(const axes *a, int k, double x) {
    return a->high[k] > a->low[k] ? (x - a->low[k]) / (a->high[k] - a->low[k]) : 0.5;
}

static void put_tick(FILE *script, const axes *a, int k, double x, const char *text) {
    (void)fprintf(script, "set label '%s ' at %d,%g right front font ',9'\n", text, k, height(a, k, x));
}

static void put_axes(FILE *script, const lg_grid *grid, const axes *a) {
    char text[32];
    (void)fputs("unset border\nunset tics\nunset grid\nset xrange [-0.6:6.3]\nset yrange [-0.05:1.12]\nset "
                "key below\n",
                script);
    for (int k = 0; k < AXES; k++)
        (void)fprintf(
            script,
            "set arrow from %d,0 to %d,1 nohead lc rgb '#555555' lw 1.5\nset label '%s' at %d,1.07 center\n",
            k, k, axis_names[k], k);
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        put_tick(script, a, 0, i, lg_train_integrator_name(grid->integrators[i]));
    for (uint32_t i = 0; i < grid->n_count; i++) {
        (void)snprintf(text, sizeof text, "%u", grid->n[i]);
        put_tick(script, a, 1, i, text);
    }
    for (uint32_t i = 0; i < grid->m_count; i++) {
        (void)snprintf(text, sizeof text, "%u", grid->m[i]);
        put_tick(script, a, 2, i, text);
    }
    for (uint32_t i = 0; i < grid->eps_count; i++) {
        (void)snprintf(text, sizeof text, "%g", grid->eps[i]);
        put_tick(script, a, 3, i, text);
    }
    for (int k = 4; k < AXES; k++)
        for (double x = a->low[k]; x <= a->high[k] && isfinite(x); x++) {
            (void)snprintf(text, sizeof text, "%g", x);
            put_tick(script, a, k, x, text);
        }
}

/* The cells whose median E1 is, or is not, below 1e-7: one block. */
static void put_lines(app_plot *plot, const lg_grid *grid, const study_file *file, const axes *a,
                      bool accurate) {
    double x[AXES];
    (void)fputs("nan nan\n\n", plot->data.stream);
    for (uint64_t c = 0; c < study_cells(grid); c++) {
        const study_row key = study_run_at(grid, c);
        if (!coordinates(grid, file, &key, x) || (x[6] < -7) != accurate) continue;
        for (int k = 0; k < AXES; k++) (void)fprintf(plot->data.stream, "%d %.6g\n", k, height(a, k, x[k]));
        (void)fputc('\n', plot->data.stream); /* one empty line interrupts the curve */
    }
    (void)fputc('\n', plot->data.stream);
    (void)fputc('\n', plot->data.stream);
}

lg_status study_draw_parallel(const app *self, const char *picture, const lg_grid *grid,
                              const study_file *file, lg_error *error) {
    app_plot plot;
    bool drawn;
    const lg_status status = begin(&plot, picture, error);
    if (status != LG_OK) return status;
    const axes a = find_axes(grid, file);
    put_axes(plot.script.stream, grid, &a);
    put_lines(&plot, grid, file, &a, false);
    put_lines(&plot, grid, file, &a, true);
    (void)fputs("plot datafile index 0 using 1:2 with lines lw 1 lc rgb '#8096a5bd' title 'E1 >= 1e-7', "
                "datafile index 1 using 1:2 with lines lw 1.5 lc rgb '#00b7c7' title 'E1 < 1e-7'\n",
                plot.script.stream);
    return app_plot_end(self, &plot, &drawn, error);
}

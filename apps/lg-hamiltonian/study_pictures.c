/* The pictures of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>

static lg_status begin(app_plot *plot, const char *picture, lg_error *error) {
    const lg_status status = app_plot_begin(plot, picture, 900, 600);
    if (status != LG_OK && error != NULL) {
        error->status = status;
        (void)snprintf(error->message, sizeof error->message, "%s: the name must end in .svg or .png",
                       picture);
    }
    return status;
}

static const char *const colours[] = {"#1f5fa8", "#d1641f", "#2a9d5c", "#8a4fbf", "#c0392b", "#6b7280"};

static const char *colour_of(size_t series) {
    return colours[series % LG_COUNT(colours)];
}

/* gnuplot's filled marks: circle, square, triangle up and down, diamond, pentagon. */
static int mark_of(size_t series) {
    static const int marks[] = {7, 5, 9, 11, 13, 15};
    return marks[series % LG_COUNT(marks)];
}

/* ---- accuracy against time ---- */

/* One block: the cells of an integrator and an M; an empty line parts curves over the substeps. */
static void put_work_block(app_plot *plot, const lg_grid *grid, const study_file *file, uint32_t i,
                           uint32_t m) {
    FILE *data = plot->data.stream;
    (void)fputs("nan nan nan\n", data); /* no block is without a line */
    for (uint64_t c = 0; c < study_cells(grid); c++) {
        study_row key = study_run_at(grid, c);
        if (key.integrator != grid->integrators[i] || key.m != grid->m[m] ||
            key.substeps != grid->substeps[0])
            continue;
        (void)fputc('\n', data);
        for (uint32_t j = 0; j < grid->substeps_count; j++) {
            key.substeps = grid->substeps[j];
            const summary s = study_cell_summary(grid, file, key);
            if (s.runs > s.failed)
                (void)fprintf(data, "%.9g %.9g %u\n", s.median[STUDY_SECONDS], s.median[STUDY_E1],
                              key.substeps);
        }
    }
    app_plot_block(plot);
}

static void put_work_curve(FILE *script, const lg_grid *grid, size_t block, uint32_t i, uint32_t m) {
    (void)fprintf(script, "%sdatafile index %zu using 1:2 with linespoints lw 1 lc rgb '%s' pt %d ps 0.8 ",
                  block > 0 ? ", " : "plot ", block, colour_of(i), mark_of(m));
    if (m == 0)
        (void)fprintf(script, "title '%s'", grid->integrators[i]->name);
    else
        (void)fputs("notitle", script);
    if (grid->substeps_count > 1)
        (void)fprintf(script,
                      ", datafile index %zu using 1:2:3 with labels offset 0.9,0.5 font ',9' tc rgb '%s' "
                      "notitle",
                      block, colour_of(i));
}

lg_status study_draw_work(const app *self, const char *picture, const lg_grid *grid, const study_file *file,
                          lg_error *error) {
    app_plot plot;
    bool drawn;
    size_t block = 0;
    const lg_status status = begin(&plot, picture, error);
    if (status != LG_OK) return status;
    FILE *script = plot.script.stream;
    (void)fprintf(script,
                  "set logscale xy\nset format y '10^{%%L}'\nset xlabel 'seconds of training%s'\nset ylabel "
                  "'E1'\nset key outside top center horizontal\nset offsets graph 0.04, graph 0.04, 0, 0\n",
                  grid->substeps_count > 1 ? " (numbers: substeps)" : "");
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        for (uint32_t m = 0; m < grid->m_count; m++, block++) {
            put_work_block(&plot, grid, file, i, m);
            put_work_curve(script, grid, block, i, m);
        }
    for (uint32_t m = 0; m < grid->m_count; m++)
        (void)fprintf(script, ", keyentry with points pt %d ps 0.8 lc rgb '#333333' title 'M = %u'",
                      mark_of(m), grid->m[m]);
    (void)fputc('\n', script);
    return app_plot_end(self, &plot, &drawn, error);
}

/* ---- accuracy against noise ---- */

static bool of_series(const study_row *row, const study_row *first) {
    return row->integrator == first->integrator && row->substeps == first->substeps &&
           row->penalty == first->penalty && !row->failed;
}

/* Two blocks: E1 of every run at the place of its eps in the grid's list, moved by `shift`; the medians as
 * horizontal bars of the given width. */
static void put_noise_blocks(app_plot *plot, const lg_grid *grid, const study_file *file,
                             const study_row *first, double shift, double width) {
    double *e1 = app_alloc(file->count + 1, sizeof *e1);
    app_file bars;
    app_file_begin(&bars, "");
    (void)fputs("nan nan\n", plot->data.stream);
    (void)fputs("nan nan nan nan\n", bars.stream);
    for (uint32_t i = 0; i < grid->eps_count; i++) {
        size_t n = 0;
        for (size_t r = 0; r < file->count; r++)
            if (of_series(&file->rows[r], first) && file->rows[r].eps == grid->eps[i])
                e1[n++] = file->rows[r].e1;
        for (size_t r = 0; r < n; r++) (void)fprintf(plot->data.stream, "%.9g %.9g\n", i + shift, e1[r]);
        if (n > 0)
            (void)fprintf(bars.stream, "%.9g %.9g %.9g 0\n", i + shift - width / 2, app_median(e1, n), width);
    }
    (void)fclose(bars.stream);
    app_plot_block(plot);
    (void)fputs(bars.text, plot->data.stream);
    app_plot_block(plot);
    free(bars.text);
    free(e1);
}

/* What distinguishes the series of a grid, in words. */
static void put_noise_title(FILE *script, const lg_grid *grid, const study_row *key) {
    (void)fprintf(script, "title '%s", key->integrator->name);
    if (grid->substeps_count > 1)
        (void)fprintf(script, ", %u substep%s", key->substeps, key->substeps == 1 ? "" : "s");
    if (grid->penalty_count > 1 && key->penalty > 0) (void)fprintf(script, ", penalty %g", key->penalty);
    if (grid->penalty_count > 1 && key->penalty == 0) (void)fputs(", no penalty", script);
    (void)fputc('\'', script);
}

lg_status study_draw_noise(const app *self, const char *picture, const lg_grid *grid, const study_file *file,
                           lg_error *error) {
    app_plot plot;
    bool drawn;
    const lg_status status = begin(&plot, picture, error);
    if (status != LG_OK) return status;
    FILE *script = plot.script.stream;
    (void)fprintf(script,
                  "set logscale y\nset format y '10^{%%L}'\nset xlabel 'noise (bars: medians)'\nset ylabel "
                  "'E1'\nset key outside top center horizontal\nset xrange [-0.6:%g]\nset xtics (",
                  grid->eps_count - 0.4);
    for (uint32_t i = 0; i < grid->eps_count; i++)
        (void)fprintf(script, "%s'%g' %u", i > 0 ? ", " : "", grid->eps[i], i);
    (void)fputs(")\n", script);
    const uint64_t series = (uint64_t)grid->integrator_count * grid->substeps_count * grid->penalty_count;
    const double width = 0.8 / (double)series;
    for (uint64_t k = 0; k < series; k++) {
        const study_row first = study_run_at(grid, k);
        put_noise_blocks(&plot, grid, file, &first, ((double)k - 0.5 * (double)(series - 1)) * width,
                         0.8 * width);
        (void)fprintf(script, "%sdatafile index %zu using 1:2 with points pt 7 ps 0.5 lc rgb '%s' ",
                      k > 0 ? ", " : "plot ", (size_t)(2 * k), colour_of((size_t)k));
        put_noise_title(script, grid, &first);
        (void)fprintf(script,
                      ", datafile index %zu using 1:2:3:4 with vectors nohead lw 2 lc rgb '%s' notitle",
                      (size_t)(2 * k + 1), colour_of((size_t)k));
    }
    (void)fputc('\n', script);
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
    (void)fprintf(script, "set label '%s' at %g,%g right front boxed font ',9'\n", text, k - 0.05,
                  height(a, k, x));
}

static void put_axes(FILE *script, const lg_grid *grid, const axes *a) {
    char text[32];
    (void)fputs("unset border\nunset tics\nunset grid\nset xrange [-0.6:6.3]\nset yrange [-0.05:1.12]\nset "
                "key below\nset style textbox opaque noborder margins 0.3,0.3\n",
                script);
    for (int k = 0; k < AXES; k++)
        (void)fprintf(
            script,
            "set arrow from %d,0 to %d,1 nohead lc rgb '#555555' lw 1.5\nset label '%s' at %d,1.07 center\n",
            k, k, axis_names[k], k);
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        put_tick(script, a, 0, i, grid->integrators[i]->name);
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

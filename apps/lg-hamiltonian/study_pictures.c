/* The pictures of a study. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>

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
static void put_work_block(app_plot *plot, const study_file *file, uint32_t i, uint32_t m) {
    FILE *data = plot->data.stream;
    const study_axis *substeps = &file->plan->axes[AXIS_SUBSTEPS];
    (void)fputs("nan nan nan\n", data); /* no block is without a line */
    for (uint64_t c = 0; c < study_cells(file->plan); c++) {
        study_row key = study_run_at(file->plan, c);
        if (key.at[AXIS_INTEGRATOR] != i || key.at[AXIS_M] != m || key.at[AXIS_SUBSTEPS] != 0) continue;
        (void)fputc('\n', data);
        for (uint32_t j = 0; j < substeps->count; j++) {
            key.at[AXIS_SUBSTEPS] = j;
            const study_summary s = study_cell_summary(file, key);
            if (s.runs > s.failed)
                (void)fprintf(data, "%.9g %.9g %s\n", s.median[STUDY_SECONDS], s.median[STUDY_E1],
                              substeps->text[j]);
        }
    }
    app_plot_block(plot);
}

static void put_work_curve(FILE *script, const study_plan *plan, size_t block, uint32_t i, uint32_t m) {
    (void)fprintf(script, "%sdatafile index %zu using 1:2 with linespoints lw 1 lc rgb '%s' pt %d ps 0.8 ",
                  block > 0 ? ", " : "plot ", block, colour_of(i), mark_of(m));
    if (m == 0)
        (void)fprintf(script, "title '%s'", plan->axes[AXIS_INTEGRATOR].text[i]);
    else
        (void)fputs("notitle", script);
    if (plan->axes[AXIS_SUBSTEPS].count > 1)
        (void)fprintf(script,
                      ", datafile index %zu using 1:2:3 with labels offset 0.9,0.5 font ',9' tc rgb '%s' "
                      "notitle",
                      block, colour_of(i));
}

lg_status study_draw_work(const app *self, const char *picture, const study_file *file, lg_error *error) {
    app_plot plot;
    size_t block = 0;
    app_plot_begin(&plot, picture, 900, 600);
    const study_plan *plan = file->plan;
    FILE *script = plot.script.stream;
    (void)fprintf(script,
                  "set logscale xy\nset format y '10^{%%L}'\nset xlabel 'seconds of training%s'\nset ylabel "
                  "'E1'\nset key outside top center horizontal\nset offsets graph 0.04, graph 0.04, 0, 0\n",
                  plan->axes[AXIS_SUBSTEPS].count > 1 ? " (numbers: substeps)" : "");
    for (uint32_t i = 0; i < plan->axes[AXIS_INTEGRATOR].count; i++)
        for (uint32_t m = 0; m < plan->axes[AXIS_M].count; m++, block++) {
            put_work_block(&plot, file, i, m);
            put_work_curve(script, plan, block, i, m);
        }
    for (uint32_t m = 0; m < plan->axes[AXIS_M].count; m++)
        (void)fprintf(script, ", keyentry with points pt %d ps 0.8 lc rgb '#333333' title 'M = %s'",
                      mark_of(m), plan->axes[AXIS_M].text[m]);
    (void)fputc('\n', script);
    return app_plot_end(self, &plot, error);
}

/* ---- accuracy against noise ---- */

static bool of_series(const study_row *row, const study_row *first) {
    return row->at[AXIS_INTEGRATOR] == first->at[AXIS_INTEGRATOR] &&
           row->at[AXIS_SUBSTEPS] == first->at[AXIS_SUBSTEPS] &&
           row->at[AXIS_PENALTY] == first->at[AXIS_PENALTY] && !row->failed;
}

/* Two blocks: E1 of every run at the place of its eps in the grid's list, moved by `shift`; the medians as
 * horizontal bars of the given width. */
static void put_noise_blocks(app_plot *plot, const study_file *file, const study_row *first, double shift,
                             double width) {
    double *e1 = app_alloc(file->count + 1, sizeof *e1);
    app_file bars;
    app_file_begin(&bars, "");
    (void)fputs("nan nan\n", plot->data.stream);
    (void)fputs("nan nan nan nan\n", bars.stream);
    for (uint32_t i = 0; i < file->plan->axes[AXIS_EPS].count; i++) {
        size_t n = 0;
        for (size_t r = 0; r < file->count; r++)
            if (of_series(&file->rows[r], first) && file->rows[r].at[AXIS_EPS] == i)
                e1[n++] = file->rows[r].result[STUDY_E1];
        for (size_t r = 0; r < n; r++) (void)fprintf(plot->data.stream, "%.9g %.9g\n", i + shift, e1[r]);
        if (n > 0)
            (void)fprintf(bars.stream, "%.9g %.9g %.9g 0\n", i + shift - width / 2, lg_median(e1, n), width);
    }
    (void)fclose(bars.stream);
    app_plot_block(plot);
    (void)fputs(bars.text, plot->data.stream);
    app_plot_block(plot);
    free(bars.text);
    free(e1);
}

/* What distinguishes the series of a grid, in words. */
static void put_noise_title(FILE *script, const study_plan *plan, const study_row *key) {
    const double substeps = number_at(plan, key, AXIS_SUBSTEPS), penalty = number_at(plan, key, AXIS_PENALTY);
    (void)fprintf(script, "title '%s", text_at(plan, key, AXIS_INTEGRATOR));
    if (plan->axes[AXIS_SUBSTEPS].count > 1)
        (void)fprintf(script, ", %g substep%s", substeps, substeps == 1 ? "" : "s");
    if (plan->axes[AXIS_PENALTY].count > 1 && penalty > 0) (void)fprintf(script, ", penalty %g", penalty);
    if (plan->axes[AXIS_PENALTY].count > 1 && penalty == 0) (void)fputs(", no penalty", script);
    (void)fputc('\'', script);
}

lg_status study_draw_noise(const app *self, const char *picture, const study_file *file, lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 900, 600);
    const study_plan *plan = file->plan;
    const study_axis *eps = &plan->axes[AXIS_EPS];
    FILE *script = plot.script.stream;
    (void)fprintf(script,
                  "set logscale y\nset format y '10^{%%L}'\nset xlabel 'noise (bars: medians)'\nset ylabel "
                  "'E1'\nset key outside top center horizontal\nset xrange [-0.6:%g]\nset xtics (",
                  eps->count - 0.4);
    for (uint32_t i = 0; i < eps->count; i++)
        (void)fprintf(script, "%s'%g' %u", i > 0 ? ", " : "", eps->number[i], i);
    (void)fputs(")\n", script);
    const uint64_t series = (uint64_t)plan->axes[AXIS_INTEGRATOR].count * plan->axes[AXIS_SUBSTEPS].count *
                            plan->axes[AXIS_PENALTY].count;
    const double width = 0.8 / (double)series;
    for (uint64_t k = 0; k < series; k++) {
        const study_row first = study_run_at(plan, k);
        put_noise_blocks(&plot, file, &first, ((double)k - 0.5 * (double)(series - 1)) * width, 0.8 * width);
        (void)fprintf(script, "%sdatafile index %zu using 1:2 with points pt 7 ps 0.5 lc rgb '%s' ",
                      k > 0 ? ", " : "plot ", (size_t)(2 * k), colour_of((size_t)k));
        put_noise_title(script, plan, &first);
        (void)fprintf(script,
                      ", datafile index %zu using 1:2:3:4 with vectors nohead lw 2 lc rgb '%s' notitle",
                      (size_t)(2 * k + 1), colour_of((size_t)k));
    }
    (void)fputc('\n', script);
    return app_plot_end(self, &plot, error);
}

/* ---- parallel coordinates ---- */

enum { LINES = 7 };
static const char *const axis_names[LINES] = {"integrator", "N",        "M",       "eps",
                                              "log10 loss", "log10 E2", "log10 E1"};

typedef struct axes {
    double low[LINES], high[LINES];
} axes;

/* Positions in the grid's lists for what is chosen, logarithms for what is measured. */
static bool coordinates(const study_file *file, const study_row *key, double x[LINES]) {
    static const uint32_t chosen[] = {AXIS_INTEGRATOR, AXIS_N, AXIS_M, AXIS_EPS};
    const study_summary s = study_cell_summary(file, *key);
    if (s.runs == s.failed) return false;
    for (size_t i = 0; i < LG_COUNT(chosen); i++) x[i] = key->at[chosen[i]];
    x[4] = log10(s.median[STUDY_LOSS]);
    x[5] = log10(s.median[STUDY_E2]);
    x[6] = log10(s.median[STUDY_E1]);
    return true;
}

static axes find_axes(const study_file *file) {
    const study_axis *from = file->plan->axes;
    axes a = {.high = {from[AXIS_INTEGRATOR].count - 1.0, from[AXIS_N].count - 1.0, from[AXIS_M].count - 1.0,
                       from[AXIS_EPS].count - 1.0}};
    double x[LINES];
    for (int k = 4; k < LINES; k++) {
        a.low[k] = INFINITY;
        a.high[k] = -INFINITY;
    }
    for (uint64_t c = 0; c < study_cells(file->plan); c++) {
        const study_row key = study_run_at(file->plan, c);
        if (!coordinates(file, &key, x)) continue;
        for (int k = 4; k < LINES; k++) {
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

static void put_axes(FILE *script, const study_plan *plan, const axes *a) {
    char text[32];
    (void)fputs("unset border\nunset tics\nunset grid\nset xrange [-0.6:6.3]\nset yrange [-0.05:1.12]\nset "
                "key below\nset style textbox opaque noborder margins 0.3,0.3\n",
                script);
    for (int k = 0; k < LINES; k++)
        (void)fprintf(
            script,
            "set arrow from %d,0 to %d,1 nohead lc rgb '#555555' lw 1.5\nset label '%s' at %d,1.07 center\n",
            k, k, axis_names[k], k);
    static const uint32_t chosen[] = {AXIS_INTEGRATOR, AXIS_N, AXIS_M, AXIS_EPS};
    for (int k = 0; k < (int)LG_COUNT(chosen); k++) {
        const study_axis *axis = &plan->axes[chosen[k]];
        for (uint32_t i = 0; i < axis->count; i++) put_tick(script, a, k, i, axis->text[i]);
    }
    for (int k = 4; k < LINES; k++)
        for (double x = a->low[k]; x <= a->high[k] && isfinite(x); x++) {
            (void)snprintf(text, sizeof text, "%g", x);
            put_tick(script, a, k, x, text);
        }
}

/* The cells whose median E1 is, or is not, below 1e-7: one block. */
static void put_lines(app_plot *plot, const study_file *file, const axes *a, bool accurate) {
    double x[LINES];
    (void)fputs("nan nan\n\n", plot->data.stream);
    for (uint64_t c = 0; c < study_cells(file->plan); c++) {
        const study_row key = study_run_at(file->plan, c);
        if (!coordinates(file, &key, x) || (x[6] < -7) != accurate) continue;
        for (int k = 0; k < LINES; k++) (void)fprintf(plot->data.stream, "%d %.6g\n", k, height(a, k, x[k]));
        (void)fputc('\n', plot->data.stream); /* one empty line interrupts the curve */
    }
    (void)fputc('\n', plot->data.stream);
    (void)fputc('\n', plot->data.stream);
}

lg_status study_draw_parallel(const app *self, const char *picture, const study_file *file, lg_error *error) {
    app_plot plot;
    app_plot_begin(&plot, picture, 900, 600);
    const axes a = find_axes(file);
    put_axes(plot.script.stream, file->plan, &a);
    put_lines(&plot, file, &a, false);
    put_lines(&plot, file, &a, true);
    (void)fputs("plot datafile index 0 using 1:2 with lines lw 1 lc rgb '#8096a5bd' title 'E1 >= 1e-7', "
                "datafile index 1 using 1:2 with lines lw 1.5 lc rgb '#00b7c7' title 'E1 < 1e-7'\n",
                plot.script.stream);
    return app_plot_end(self, &plot, error);
}

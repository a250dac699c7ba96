/* The picture of a study: error against training time. */
#include "lg-hamiltonian/study.h"

static const char *const colours[] = {"#1f5fa8", "#d1641f", "#2a9d5c", "#8a4fbf", "#c0392b", "#6b7280"};

static const char *colour_of(size_t series) {
    return colours[series % LG_COUNT(colours)];
}

/* Filled marks of gnuplot: circle, square, triangle up, triangle down, diamond, pentagon. */
static int mark_of(size_t series) {
    static const int marks[] = {7, 5, 9, 11, 13, 15};
    return marks[series % LG_COUNT(marks)];
}

/* Writes a data block: the cells with integrator number i and value number m of M. Each curve goes over
 * the substeps of otherwise equal cells; an empty line separates the curves. */
static void put_work_block(app_plot *plot, const study_file *file, uint32_t i, uint32_t m) {
    FILE *data = plot->data.stream;
    const study_axis *substeps = &file->plan->axes[AXIS_SUBSTEPS];
    (void)fputs("nan nan nan\n", data); /* so that no block is empty */
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

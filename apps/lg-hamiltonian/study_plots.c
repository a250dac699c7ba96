/* The plot of a study: error against training time. */
#include "lg-hamiltonian/study.h"

/* Writes a block of data: the cells with integrator number i and value number m of M. A curve connects cells
 * that differ only in their substeps. */
static void put_work_block(app_plot *plot, const study_table *table, uint32_t i, uint32_t m) {
    const study_axis *substeps = &table->plan->axes[AXIS_SUBSTEPS];
    for (size_t c = 0; c < study_cells(table->plan); c++) {
        study_row key = study_run_at(table->plan, c);
        if (key.at[AXIS_INTEGRATOR] != i || key.at[AXIS_M] != m || key.at[AXIS_SUBSTEPS] != 0) continue;
        app_plot_gap(plot);
        for (uint32_t j = 0; j < substeps->count; j++) {
            key.at[AXIS_SUBSTEPS] = j;
            const study_summary s = study_summarise(table, &key, study_cell_axes, AXES, STUDY_ANY);
            if (s.runs > s.failed)
                APP_PLOT_ROW(plot, 9, s.median[STUDY_SECONDS], s.median[STUDY_E1], substeps->number[j]);
        }
    }
    app_plot_block(plot);
}

void study_draw_work(const app *self, const char *path, const study_table *table) {
    app_plot plot;
    const study_axis *integrator = &table->plan->axes[AXIS_INTEGRATOR], *points = &table->plan->axes[AXIS_M];
    app_plot_begin(&plot, "training_time", path);
    app_plot_text(&plot, "%d\t%u\t%u", table->plan->axes[AXIS_SUBSTEPS].count > 1, integrator->count,
                  points->count);
    for (uint32_t i = 0; i < integrator->count; i++) app_plot_text(&plot, "%s", integrator->text[i]);
    for (uint32_t m = 0; m < points->count; m++) app_plot_text(&plot, "M = %s", points->text[m]);
    for (uint32_t i = 0; i < integrator->count; i++)
        for (uint32_t m = 0; m < points->count; m++) put_work_block(&plot, table, i, m);
    app_plot_end(self, &plot);
}

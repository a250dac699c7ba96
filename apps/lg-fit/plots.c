/* Predictions against true values, as a plot and as a table. */
#include <math.h>
#include <string.h>

#include "lg-fit/fit.h"

enum { PANELS = 4, POINTS = 5000 };

static void put_scatter(app_plot *plot, const char *path, const lg_table_state *of) {
    const lg_table_judgement *j = &of->judged;
    const uint32_t outputs = of->file.run.model.net.outputs, panels = outputs < PANELS ? outputs : PANELS;
    app_plot_begin(plot, "scatter", path);
    app_plot_text(plot, "%zu", j->rows);
    for (uint32_t o = 0; o < panels; o++)
        app_plot_text(plot, "%s: rmse %.3g, R^2 %.3f", of->file.output_name[o], j->rmse[o], j->r2[o]);
    for (size_t i = 0; i < j->rows; i += j->rows / POINTS + 1) {
        double row[2 * PANELS];
        memcpy(row, j->truth + i * outputs, panels * sizeof *row);
        memcpy(row + panels, j->prediction + i * outputs, panels * sizeof *row);
        app_plot_numbers(plot, 9, row, 2 * (size_t)panels);
    }
}

void draw_judgement(const app *self, const char *path, const lg_table_state *of) {
    const lg_table_judgement *j = &of->judged;
    APP_FREE char *title = app_format("accuracy %.4f, f1 %.4f on %zu rows", j->accuracy, j->f1, j->rows);
    app_plot plot;
    if (of->file.run.model.options.task == LG_TABLE_REGRESSION)
        put_scatter(&plot, path, of);
    else
        app_plot_confusion(&plot, path, title, j->confusion, of->file.run.model.net.outputs,
                           of->file.output_name);
    app_plot_end(self, &plot);
}

/* ---- text for people ---- */

void judgement_print(const lg_table_state *of) {
    const lg_table_file *file = &of->file;
    const lg_table_judgement *j = &of->judged;
    app_table table = {0};
    if (file->run.model.options.task != LG_TABLE_REGRESSION) {
        app_put(stdout, "accuracy %.4f, f1 %.4f on %zu rows\n", j->accuracy, j->f1, j->rows);
        app_print_confusion(stdout, j->confusion, file->run.model.net.outputs, file->output_name);
        return;
    }
    app_table_row(&table, "column\trmse\tr2");
    for (uint32_t o = 0; o < file->run.model.net.outputs; o++) {
        app_table_cell(&table, "%s", file->output_name[o]);
        app_table_cell(&table, isfinite(j->rmse[o]) ? "%.4g" : "-", j->rmse[o]);
        app_table_cell(&table, isfinite(j->r2[o]) ? "%.4f" : "-", j->r2[o]);
    }
    app_table_end(&table, stdout);
}

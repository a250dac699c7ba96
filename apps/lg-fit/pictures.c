/* Predictions against true values, as a picture and as a table. */
#include <math.h>

#include "lg-fit/fit.h"

enum { PANELS = 4, POINTS = 5000, FEW = 300, PANEL = 460, SHOWN_CLASSES = 12 };

static void put_panel(app_plot *plot, const lg_table_file *file, const lg_table_judgement *j, uint32_t o) {
    const uint32_t outputs = file->run.model.net.outputs;
    const size_t step = j->rows / POINTS + 1;
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < j->rows; i++) {
        const double truth = j->truth[i * outputs + o], prediction = j->prediction[i * outputs + o];
        low = fmin(low, fmin(truth, prediction));
        high = fmax(high, fmax(truth, prediction));
        if (i % step == 0) (void)fprintf(plot->data, "%.9g %.9g\n", truth, prediction);
    }
    app_plot_block(plot);
    const double margin = high > low ? 0.04 * (high - low) : 1.0;
    app_plot_text(plot, "%s: rmse %.3g, R^2 %.3f", file->output_name[o], j->rmse[o], j->r2[o]);
    app_plot_text(plot, "%.9g", low - margin);
    app_plot_text(plot, "%.9g", high + margin);
}

static lg_status draw_scatter(const app *self, const char *picture, const lg_table_file *file,
                              const lg_table_judgement *j, lg_error *error) {
    const uint32_t outputs = file->run.model.net.outputs, panels = outputs < PANELS ? outputs : PANELS;
    app_plot plot;
    app_plot_begin(&plot, "scatter", picture, PANEL * (int)panels, PANEL);
    app_plot_text(&plot, "%u", panels);
    app_plot_text(&plot, "%g", j->rows < FEW ? 0.8 : 0.4);
    for (uint32_t o = 0; o < panels; o++) put_panel(&plot, file, j, o);
    return app_plot_end(self, &plot, error);
}

lg_status draw_judgement(const app *self, const char *picture, const lg_table_state *of, lg_error *error) {
    const lg_table_file *file = &of->file;
    const lg_table_judgement *j = &of->judged;
    if (file->run.model.options.task == LG_TABLE_REGRESSION)
        return draw_scatter(self, picture, file, j, error);
    APP_FREE char *title = app_format("accuracy %.4f, f1 %.4f on %zu rows", j->accuracy, j->f1, j->rows);
    return app_draw_confusion(self, picture, title, j->confusion, file->run.model.net.outputs,
                              file->output_name, error);
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

/* Predictions against true values, as a picture and as a table. */
#include <math.h>

#include "lg-fit/fit.h"

enum { PANELS = 4, POINTS = 5000, FEW = 300, PANEL = 460, SHOWN_CLASSES = 12 };

/* Copies a column's name for a gnuplot string in single quotes. Characters that would end the string or act
 * as markup become blanks. */
static void plain(const char *name, char *out, size_t size) {
    size_t n = 0;
    for (; *name != '\0' && n + 1 < size; name++)
        out[n++] = *name == '\'' || *name == '\\' || *name == '`' || *name == '%' ? ' ' : *name;
    out[n] = '\0';
}

static void draw_panel(app_plot *plot, const lg_table_file *file, const lg_table_judgement *j, uint32_t o) {
    const uint32_t outputs = file->run.model.net.outputs;
    const size_t step = j->rows / POINTS + 1;
    double low = INFINITY, high = -INFINITY;
    char name[LG_TABLE_NAME];
    plain(file->output_name[o], name, sizeof name);
    for (size_t i = 0; i < j->rows; i++) {
        low = fmin(low, fmin(j->truth[i * outputs + o], j->prediction[i * outputs + o]));
        high = fmax(high, fmax(j->truth[i * outputs + o], j->prediction[i * outputs + o]));
    }
    if (o > 0) app_plot_block(plot);
    for (size_t i = 0; i < j->rows; i += step)
        (void)fprintf(plot->data.stream, "%.9g %.9g\n", j->truth[i * outputs + o],
                      j->prediction[i * outputs + o]);
    const double margin = high > low ? 0.04 * (high - low) : 1.0;
    low -= margin;
    high += margin;
    (void)fprintf(
        plot->script.stream,
        "set title '%s: rmse %.3g, R^2 %.3f' noenhanced\nset xrange [%.9g:%.9g]\nset yrange [%.9g:%.9g]\n"
        "plot datafile index %u using 1:2 with points pt 7 ps %s lc rgb '#1f5fa8' notitle, "
        "x with lines lc rgb '#d1641f' notitle\n",
        name, j->rmse[o], j->r2[o], low, high, low, high, o, j->rows < FEW ? "0.8" : "0.4");
}

static void draw_scatter(app_plot *plot, const lg_table_file *file, const lg_table_judgement *j,
                         uint32_t panels) {
    (void)fprintf(plot->script.stream,
                  "set xlabel 'true'\nset ylabel 'predicted'\nset size square\nset multiplot layout 1,%u\n",
                  panels);
    for (uint32_t o = 0; o < panels; o++) draw_panel(plot, file, j, o);
    (void)fputs("unset multiplot\n", plot->script.stream);
}

/* Draws the confusion matrix: for each true class, the fraction of its rows that is predicted as each
 * class. */
static void draw_confusion(app_plot *plot, const lg_table_file *file, const lg_table_judgement *j) {
    enum { NUMBERED = 12 };
    const uint32_t classes = file->run.model.net.outputs;
    FILE *script = plot->script.stream;
    for (uint32_t c = 0; c < classes; c++) {
        double members = 0;
        for (uint32_t k = 0; k < classes; k++) members += (double)j->confusion[c * classes + k];
        for (uint32_t k = 0; k < classes; k++)
            (void)fprintf(plot->data.stream, "%u %u %.9g %llu\n", k, c,
                          members > 0 ? (double)j->confusion[c * classes + k] / members : 0.0,
                          (unsigned long long)j->confusion[c * classes + k]);
    }
    (void)fprintf(script,
                  "set title 'accuracy %.4f, f1 %.4f on %zu rows'\nset xlabel 'told'\nset ylabel 'true'\n"
                  "set size square\nset cbrange [0:1]\nset palette defined (0 'white', 1 '#1f5fa8')\n"
                  "set xrange [-0.5:%g]\nset yrange [%g:-0.5]\n",
                  j->accuracy, j->f1, j->rows, classes - 0.5, classes - 0.5);
    for (int axis = 0; axis < 2; axis++) {
        (void)fprintf(script, "set %ctics (", axis == 0 ? 'x' : 'y');
        for (uint32_t c = 0; c < classes; c++) {
            char name[LG_TABLE_NAME];
            plain(file->output_name[c], name, sizeof name);
            (void)fprintf(script, "%s'%s' %u", c > 0 ? ", " : "", name, c);
        }
        (void)fputs(") noenhanced\n", script);
    }
    (void)fputs("plot datafile using 1:2:3 with image notitle", script);
    if (classes <= NUMBERED)
        (void)fputs(", datafile using 1:2:(sprintf('%d', $4)) with labels notitle", script);
    (void)fputc('\n', script);
}

lg_status draw_judgement(const app *self, const char *picture, const lg_table_state *of, lg_error *error) {
    const lg_table_file *file = &of->file;
    const lg_table_judgement *j = &of->judged;
    const bool regression = file->run.model.options.task == LG_TABLE_REGRESSION;
    const uint32_t outputs = file->run.model.net.outputs, panels = outputs < PANELS ? outputs : PANELS;
    app_plot plot;
    app_plot_begin(&plot, picture, PANEL * (regression ? (int)panels : 1), PANEL);
    if (regression)
        draw_scatter(&plot, file, j, panels);
    else
        draw_confusion(&plot, file, j);
    return app_plot_end(self, &plot, error);
}

/* ---- text for people ---- */

static void print_confusion(const lg_table_file *file, const lg_table_judgement *j) {
    const uint32_t classes = file->run.model.net.outputs;
    app_table table;
    if (classes > SHOWN_CLASSES) return;
    app_table_begin(&table, classes + 1);
    app_table_cell(&table, "true \\ told");
    for (uint32_t c = 0; c < classes; c++) app_table_cell(&table, "%s", file->output_name[c]);
    for (uint32_t c = 0; c < classes; c++) {
        app_table_cell(&table, "%s", file->output_name[c]);
        for (uint32_t k = 0; k < classes; k++)
            app_table_cell(&table, "%llu", (unsigned long long)j->confusion[c * classes + k]);
    }
    app_table_end(&table, stdout);
}

void judgement_print(const lg_table_state *of) {
    const lg_table_file *file = &of->file;
    const lg_table_judgement *j = &of->judged;
    app_table table = {0};
    if (file->run.model.options.task != LG_TABLE_REGRESSION) {
        app_put(stdout, "accuracy %.4f, f1 %.4f on %zu rows\n", j->accuracy, j->f1, j->rows);
        print_confusion(file, j);
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

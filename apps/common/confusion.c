/* Confusion matrices as plots and tables. */
#include "common/app.h"

void app_print_confusion(FILE *stream, const uint64_t *confusion, uint32_t classes,
                         char (*class_name)[APP_CLASS_NAME]) {
    enum { SHOWN = 12 };
    app_table table;
    if (classes > SHOWN) return;
    app_table_begin(&table, classes + 1);
    app_table_cell(&table, "true class / given");
    for (uint32_t j = 0; j < classes; j++) app_table_cell(&table, "%s", class_name[j]);
    for (uint32_t i = 0; i < classes * classes; i++) {
        if (i % classes == 0) app_table_cell(&table, "%s", class_name[i / classes]);
        app_table_cell(&table, "%llu", (unsigned long long)confusion[i]);
    }
    app_table_end(&table, stream);
}

lg_status app_draw_confusion(const app *self, const char *image, const char *title, const uint64_t *confusion,
                             uint32_t classes, char (*class_name)[APP_CLASS_NAME], lg_error *error) {
    app_plot plot;
    const int size = 220 + 110 * (int)(classes < 12 ? classes : 12);
    app_plot_begin(&plot, "confusion", image, size + 60, size);
    app_plot_text(&plot, "%u", classes);
    app_plot_text(&plot, "%s", title);
    for (uint32_t row = 0; row < classes; row++) {
        const uint64_t *entry = confusion + (size_t)row * classes;
        double total = 0;
        app_plot_text(&plot, "%s", class_name[row]);
        for (uint32_t j = 0; j < classes; j++) total += (double)entry[j];
        for (uint32_t j = 0; j < classes; j++)
            (void)fprintf(plot.data, "%u %u %.6g %llu\n", j, row, total > 0 ? (double)entry[j] / total : 0.0,
                          (unsigned long long)entry[j]);
    }
    return app_plot_end(self, &plot, error);
}

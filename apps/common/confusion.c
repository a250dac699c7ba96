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

void app_plot_confusion(app_plot *plot, const char *image, const char *title, const uint64_t *confusion,
                        uint32_t classes, char (*class_name)[APP_CLASS_NAME]) {
    app_plot_begin(plot, "confusion", image);
    app_plot_text(plot, "%u\t%s", classes, title);
    for (uint32_t row = 0; row < classes; row++) {
        app_plot_text(plot, "%s", class_name[row]);
        for (uint32_t j = 0; j < classes; j++)
            APP_PLOT_ROW(plot, 15, j, row, (double)confusion[(size_t)row * classes + j]);
    }
}

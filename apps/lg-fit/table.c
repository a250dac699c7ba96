/* Columns by name, rows without missing cells. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-fit/fit.h"

/* ---- names ---- */

void free_names(column_names *names) {
    free(names->name);
    *names = (column_names){0, NULL};
}

bool has_name(const column_names *names, const char *name) {
    for (uint32_t i = 0; i < names->count; i++)
        if (strcmp(names->name[i], name) == 0) return true;
    return false;
}

int parse_names(const app *self, const char *option, const char *text, column_names *out) {
    size_t count = 1;
    for (const char *c = text; *c != '\0'; c++) count += *c == ',';
    *out = (column_names){0, app_alloc(count, sizeof *out->name)};
    for (const char *at = text;; at++) {
        const size_t length = strcspn(at, ",");
        char name[LG_TABLE_NAME];
        if (length == 0 || length >= sizeof name)
            return app_usage(self, "--%s: names of 1 to %d bytes are expected, with commas between them",
                             option, LG_TABLE_NAME - 1);
        memcpy(name, at, length);
        name[length] = '\0';
        if (has_name(out, name)) return app_usage(self, "--%s: '%s' is there twice", option, name);
        memcpy(out->name[out->count++], name, sizeof name);
        at += length;
        if (*at == '\0') return APP_EXIT_OK;
    }
}

/* ---- rows ---- */

static bool is_complete(const lg_table_data *data, size_t row) {
    for (uint32_t c = 0; c < data->columns; c++)
        if (isnan(data->values[row * data->columns + c])) return false;
    return data->label == NULL || data->label[row] != LG_TABLE_NO_CLASS;
}

static void keep_complete(fit_table *table) {
    lg_table_data *data = &table->data;
    size_t kept = 0;
    for (size_t i = 0; i < data->rows; i++) {
        if (!is_complete(data, i)) continue;
        memmove(data->values + kept * data->columns, data->values + i * data->columns,
                data->columns * sizeof *data->values);
        data->line[kept] = data->line[i];
        if (data->label != NULL) data->label[kept] = data->label[i];
        kept++;
    }
    table->left_out = data->rows - kept;
    data->rows = kept;
}

int read_table(const app *self, const char *path, const column_names *inputs, const column_names *outputs,
               const char *class_column, bool complete, fit_table *out) {
    const uint32_t count = inputs->count + outputs->count;
    const char **names = app_alloc(count, sizeof *names);
    lg_error error = {LG_OK, ""};
    *out = (fit_table){.path = path, .inputs = inputs->count, .outputs = outputs->count};
    for (uint32_t i = 0; i < count; i++)
        names[i] = i < inputs->count ? inputs->name[i] : outputs->name[i - inputs->count];
    const lg_status status =
        lg_table_read(self->context, path, names, count, class_column, NULL, &out->data, &error);
    free(names);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    if (out->data.cut) app_warn(self, "%s: the last line was cut off and left out", path);
    if (!complete) return APP_EXIT_OK;
    keep_complete(out);
    if (out->data.rows == 0)
        return app_fail(self, LG_FORMAT, "%s: all %zu rows have missing cells in the columns that are used",
                        path, out->left_out);
    if (out->left_out > 0)
        app_warn(self, "%s: %zu of %zu rows have missing cells and are left out", path, out->left_out,
                 out->left_out + out->data.rows);
    return APP_EXIT_OK;
}

int match_classes(const app *self, fit_table *table, const lg_table_text *name, uint32_t classes) {
    lg_table_data *data = &table->data;
    uint32_t *number = app_alloc(data->classes + 1, sizeof *number);
    int code = APP_EXIT_OK;
    for (uint32_t c = 0; c < data->classes; c++) {
        number[c] = 0;
        while (number[c] < classes && strcmp(name[number[c]], data->class_name[c]) != 0) number[c]++;
    }
    for (size_t i = 0; i < data->rows && code == APP_EXIT_OK; i++) {
        if (data->label[i] == LG_TABLE_NO_CLASS) continue;
        if (number[data->label[i]] == classes)
            code = app_fail(self, LG_FORMAT, "%s: %s %zu: class '%s' is none of the model's", table->path,
                            data->place, data->line[i], data->class_name[data->label[i]]);
        data->label[i] = number[data->label[i]];
    }
    free(number);
    return code;
}

/* Columns by name, rows without missing cells. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "datasets/table_names.h"
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

/* In quotes: two are one of the name. Behind the last one; NULL: not closed, or too long. */
static const char *take_quoted(const char *at, char *name) {
    for (size_t used = 0; *at != '\0' && used + 1 < LG_TABLE_NAME; at++) {
        if (*at == '"' && at[1] != '"') return at + 1;
        at += *at == '"';
        name[used++] = *at;
        name[used] = '\0';
    }
    return *at == '"' && at[1] != '"' ? at + 1 : NULL;
}

/* Up to a comma. Behind it; NULL: too long. */
static const char *take_plain(const char *at, char *name) {
    const size_t length = strcspn(at, ",");
    size_t kept = length;
    while (kept > 0 && at[kept - 1] == ' ') kept--;
    if (kept >= LG_TABLE_NAME) return NULL;
    memcpy(name, at, kept);
    name[kept] = '\0';
    return at + length;
}

/* The next name of a list, up to a comma or the end; NULL: there is none. */
static const char *take_name(const char *at, char *name) {
    name[0] = '\0';
    at += strspn(at, " ");
    at = *at == '"' ? take_quoted(at + 1, name) : take_plain(at, name);
    if (at == NULL || name[0] == '\0') return NULL;
    at += strspn(at, " ");
    return *at == ',' || *at == '\0' ? at : NULL;
}

int parse_names(const app *self, const char *option, const char *text, column_names *out) {
    size_t count = 1;
    for (const char *c = text; *c != '\0'; c++) count += *c == ',';
    *out = (column_names){0, app_alloc(count, sizeof *out->name)};
    for (const char *at = text;; at++) {
        char name[LG_TABLE_NAME];
        at = take_name(at, name);
        if (at == NULL)
            return app_usage(self, "--%s: names of 1 to %d bytes are expected, with commas between them",
                             option, LG_TABLE_NAME - 1);
        if (has_name(out, name)) return app_usage(self, "--%s: '%s' is there twice", option, name);
        memcpy(out->name[out->count++], name, sizeof name);
        if (*at == '\0') return APP_EXIT_OK;
    }
}

int parse_class(const app *self, const char *text, lg_table_text out) {
    const char *end = text[0] == '"' ? take_name(text, out) : text + strlen(text);
    if (text[0] != '"' && strlen(text) < LG_TABLE_NAME) (void)snprintf(out, LG_TABLE_NAME, "%s", text);
    if (end == NULL || *end != '\0' || out[0] == '\0')
        return app_usage(self, "--class: one name of 1 to %d bytes is expected", LG_TABLE_NAME - 1);
    return APP_EXIT_OK;
}

char *list_names(const column_names *names) {
    char *text = app_alloc((size_t)names->count + 1, LG_TABLE_QUOTED + 1), *to = text;
    for (uint32_t i = 0; i < names->count; i++) {
        if (i > 0) *to++ = ',';
        to += strlen(lg_table_quote(names->name[i], to));
    }
    return text;
}

/* ---- rows ---- */

lg_status load_table(const app *self, const char *path, const column_names *inputs,
                     const column_names *outputs, const char *class_column, fit_table *out, lg_error *error) {
    const uint32_t count = inputs->count + outputs->count;
    APP_FREE const char **names = app_alloc((size_t)count + 1, sizeof *names);
    *out = (fit_table){.path = path, .inputs = inputs->count, .outputs = outputs->count};
    for (uint32_t i = 0; i < count; i++)
        names[i] = i < inputs->count ? inputs->name[i] : outputs->name[i - inputs->count];
    return lg_table_read(self->context, path, names, count, class_column, NULL, &out->data, error);
}

static void warn_cut(const app *self, const fit_table *table) {
    if (table->data.cut) app_warn(self, "%s: the last line was cut off and left out", table->path);
}

int leave_incomplete(const app *self, fit_table *table) {
    lg_table_data *data = &table->data;
    lg_error error = {LG_OK, ""};
    warn_cut(self, table);
    const lg_status status = lg_table_keep_complete(&data, 1, &table->left_out, &error);
    if (status != LG_OK) return app_fail(self, status, "%s: %s", table->path, error.message);
    if (table->left_out > 0)
        app_warn(self, "%s: %zu of %zu rows have missing cells and are left out", table->path,
                 table->left_out, table->left_out + table->data.rows);
    return APP_EXIT_OK;
}

int read_table(const app *self, const char *path, const column_names *inputs, const column_names *outputs,
               const char *class_column, bool complete, fit_table *out) {
    lg_error error = {LG_OK, ""};
    const lg_status status = load_table(self, path, inputs, outputs, class_column, out, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    if (complete) return leave_incomplete(self, out);
    warn_cut(self, out);
    return APP_EXIT_OK;
}

void warn_far(const app *self, const fit_table *table, uint32_t first, const column_names *names,
              const char *follows) {
    enum { MOST_TOLD = 8 };
    const lg_table_data *data = &table->data;
    uint32_t told = 0;
    for (uint32_t c = 0; c < names->count; c++) {
        const double *values = data->values + first + c;
        lg_table_far far;
        char quoted[LG_TABLE_QUOTED];
        if (lg_table_find_far(self->context, values, data->columns, data->rows, &far) != LG_OK)
            app_out_of_memory();
        if (far.count == 0 || told++ >= MOST_TOLD) continue;
        app_warn(self,
                 "%s: column %s: %zu of %zu cells %s far from all others, the farthest in %s %zu: %.6g (the "
                 "median is %.6g); %s; a cell that is an error is to be left empty",
                 table->path, lg_table_quote(names->name[c], quoted), far.count, data->rows,
                 far.count == 1 ? "lies" : "lie", data->place, data->line[far.farthest],
                 values[far.farthest * data->columns], far.median, follows);
    }
    if (told > MOST_TOLD)
        app_warn(self, "%s: %u more columns have cells far from all others", table->path, told - MOST_TOLD);
}

int match_classes(const app *self, fit_table *table, const lg_table_text *name, uint32_t classes) {
    lg_table_data *data = &table->data;
    APP_FREE uint32_t *number = app_alloc(data->classes + 1, sizeof *number);
    for (uint32_t c = 0; c < data->classes; c++) {
        number[c] = 0;
        while (number[c] < classes && strcmp(name[number[c]], data->class_name[c]) != 0) number[c]++;
    }
    for (size_t i = 0; i < data->rows; i++) {
        if (data->label[i] == LG_TABLE_NO_CLASS) continue;
        if (number[data->label[i]] == classes)
            return app_fail(self, LG_FORMAT, "%s: %s %zu: class '%s' is none of the model's", table->path,
                            data->place, data->line[i], data->class_name[data->label[i]]);
        data->label[i] = number[data->label[i]];
    }
    return APP_EXIT_OK;
}

void read_fitted_table(const app *self, bool judged, fitted_table *out) {
    const char *model = self->arguments[0];
    lg_table_file *file = &out->file;
    const lg_table *of = &file->run.model;
    APP_MUST_FILE(self, model, lg_model_load_table(self->context, model, NULL, file, &error));
    const bool classes = judged && of->options.task != LG_TABLE_REGRESSION;
    const column_names inputs = {of->net.inputs, file->input_name},
                       outputs = {judged && !classes ? of->net.outputs : 0, file->output_name};
    int code = read_table(self, self->arguments[1], &inputs, &outputs, classes ? file->class_column : NULL,
                          judged, &out->table);
    if (code == APP_EXIT_OK && classes)
        code = match_classes(self, &out->table, file->output_name, of->net.outputs);
    if (code != APP_EXIT_OK) app_end(code);
}

void fitted_table_destroy(fitted_table *of) {
    lg_table_data_destroy(&of->table.data);
    lg_table_file_destroy(&of->file);
}

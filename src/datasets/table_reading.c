/* Tables of numbers: columns of a file as numbers, and one of them as classes. */
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "core/lookup.h"
#include "datasets/series_files.h"
#include "files/frame.h"
#include "liegrad/table.h"

_Static_assert((int)LG_TABLE_NAME == (int)LG_FRAME_NAME, "texts of a frame are names of a table");
enum { MOST_CLASSES = 1000 };

void lg_table_names_destroy(lg_table_names *names) {
    if (names == NULL) return;
    lg_free(names->context, names->name);
    *names = (lg_table_names){.count = 0};
}

void lg_table_data_destroy(lg_table_data *data) {
    if (data == NULL) return;
    LG_FREE_ALL(data->context, data->values, data->line, data->label, data->class_name);
    *data = (lg_table_data){.rows = 0};
}

/* ---- classes ---- */

/* Numbers the classes that occur; rows with an empty text have none. Labels are texts as written, so 1 and
 * 1.0 are two classes. A warning says so. */
static lg_status name_classes(const lg_frame *f, const char *column, lg_table_data *out, lg_error *error) {
    LG_CLEAN(lg_names_destroy) lg_names met = {.context = f->context, .compare = lg_label_compare};
    uint32_t *label = out->label = lg_alloc(f->context, f->rows, sizeof *out->label);
    if (label == NULL) return lg_frame_no_memory(f, error);
    for (size_t i = 0; i < f->rows; i++) {
        bool known = true;
        label[i] = LG_TABLE_NO_CLASS;
        if (*f->text[i] != '\0' && lg_names_meet(&met, f->text[i], &label[i], &known) != LG_OK)
            return lg_frame_no_memory(f, error);
        if (met.count > MOST_CLASSES)
            return lg_fail(error, LG_FORMAT,
                           "%s: column %s: has more than %d different values: it does not look like classes; "
                           "use it as an output",
                           f->shown, column, MOST_CLASSES);
    }
    if (lg_names_sort(&met, label, f->rows) != LG_OK) return lg_frame_no_memory(f, error);
    out->classes = met.count;
    out->class_name = lg_names_take(&met);
    for (uint32_t c = 1; c < out->classes; c++) {
        const char *a = out->class_name[c - 1], *b = out->class_name[c];
        if (lg_is_decimal(a) && lg_is_decimal(b) && lg_decimal_compare(a, b) == 0)
            lg_log_message(f->context, LG_LOG_WARNING,
                           "%s: column %s: the classes '%s' and '%s' are the same number, written in two "
                           "ways; they stay two classes",
                           f->shown, column, a, b);
    }
    return LG_OK;
}

/* ---- complete rows ---- */

static bool are_complete(lg_table_data *const *tables, size_t count, size_t row) {
    bool all = true;
    for (size_t i = 0; i < count; i++) {
        const lg_table_data *data = tables[i];
        all = all && (data->label == NULL || data->label[row] != LG_TABLE_NO_CLASS);
        for (uint32_t c = 0; c < data->columns; c++)
            all = all && !isnan(data->values[row * data->columns + c]);
    }
    return all;
}

lg_status lg_table_keep_complete(lg_table_data *const *tables, size_t count, size_t *left_out,
                                 lg_error *error) {
    if (count > 0) LG_NEEDS(error, tables);
    const size_t rows = count > 0 ? tables[0]->rows : 0;
    size_t complete = 0, kept = 0;
    for (size_t i = 0; i < count; i++)
        if (tables[i]->rows != rows)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "the tables have %zu and %zu rows, so they are not from the same file", rows,
                           tables[i]->rows);
    for (size_t row = 0; row < rows; row++) complete += are_complete(tables, count, row);
    if (complete == 0 && rows > 0)
        return lg_fail(error, LG_FORMAT,
                       "all %zu rows have missing cells in the columns that are used: use fewer columns",
                       rows);
    for (size_t row = 0; row < rows; row++) {
        if (!are_complete(tables, count, row)) continue;
        for (lg_table_data *const *at = tables; at < tables + count; at++) {
            lg_table_data *data = *at;
            memmove(data->values + kept * data->columns, data->values + row * data->columns,
                    data->columns * sizeof *data->values);
            data->line[kept] = data->line[row];
            if (data->label != NULL) data->label[kept] = data->label[row];
        }
        kept++;
    }
    for (size_t i = 0; i < count; i++) tables[i]->rows = kept;
    if (left_out != NULL) *left_out = rows - kept;
    return LG_OK;
}

lg_port lg_table_port(const lg_table_data *of, const char *name, uint32_t numbers) {
    lg_port port = {
        .name = name, .shape = lg_shape1(numbers), .low = (double)INFINITY, .high = -(double)INFINITY};
    for (size_t i = 0; i < of->rows * of->columns; i++) {
        port.low = fmin(port.low, of->values[i]); /* if one is NaN, fmin gives the other one */
        port.high = fmax(port.high, of->values[i]);
    }
    if (!(port.low <= port.high)) port.low = port.high = 0.0;
    return port;
}

/* ---- reading ---- */

lg_status lg_table_names_read(const lg_context *context, const char *path, const lg_read_options *options,
                              lg_table_names *out, lg_error *error) {
    LG_NEEDS(error, path, out);
    LG_CLEAN(lg_table_names_destroy) lg_table_names made = {.context = context};
    LG_CLEAN(lg_frame_close)
    lg_frame f = {.context = context, .path = path, .what = "table", .options = options};
    LG_TRY(lg_frame_open(&f, error));
    made.name = lg_alloc(context, f.columns, sizeof *made.name);
    if (made.name == NULL) return lg_frame_no_memory(&f, error);
    for (; made.count < f.columns; made.count++) {
        const size_t length = strlen(f.name[made.count]);
        if (length >= LG_TABLE_NAME)
            return lg_fail(error, LG_FORMAT, "%s: the name of column %u has more than %d bytes: shorten it",
                           f.shown, made.count + 1, LG_TABLE_NAME - 1);
        memcpy(made.name[made.count], f.name[made.count], length + 1);
    }
    return LG_GIVE(out, made);
}

/* Reads all rows and keeps them. */
static lg_status read_rows(lg_frame *f, const char *class_column, lg_table_data *out, lg_error *error) {
    LG_TRY(lg_frame_open(f, error));
    LG_TRY(lg_frame_next(f, SIZE_MAX, error));
    if (f->rows == 0)
        return lg_fail(error, LG_FORMAT, "%s: has %sno rows: add some", f->shown,
                       f->header > 0 ? "a header, but " : "");
    if (class_column != NULL) LG_TRY(name_classes(f, class_column, out, error));
    lg_sha256 state; /* of the numbers, then the labels */
    lg_sha256_init(&state);
    lg_sha256_add_doubles(&state, f->value, f->rows * f->width);
    for (size_t i = 0; f->texts > 0 && i < f->rows; i++)
        lg_sha256_add(&state, f->text[i], strlen(f->text[i]) + 1);
    lg_sha256_finish(&state, out->sha256);
    out->rows = f->rows;
    out->columns = (uint32_t)f->width;
    out->values = f->value;
    out->line = f->line;
    out->place = f->place;
    out->cut = f->cut;
    if (f->cut)
        lg_log_message(f->context, LG_LOG_WARNING, "%s: the last line was cut off and left out", f->shown);
    f->value = NULL;
    f->line = NULL;
    return LG_OK;
}

lg_status lg_table_read(const lg_context *context, const char *path, const char *const *names, uint32_t count,
                        const char *class_column, const lg_read_options *options, lg_table_data *out,
                        lg_error *error) {
    LG_NEEDS(error, path, names, out);
    LG_TRY_SCRATCH(lg_frame_want, want, context, (uint64_t)count + 1, lg_no_memory(error));
    LG_CLEAN(lg_table_data_destroy) lg_table_data made = {.context = context};
    LG_CLEAN(lg_frame_close)
    lg_frame f = {.context = context,
                  .path = path,
                  .what = "table",
                  .options = options,
                  .want = want,
                  .wants = (size_t)count + (class_column != NULL)};
    for (uint32_t i = 0; i < count; i++) want[i].name = names[i];
    if (class_column != NULL) want[count] = (lg_frame_want){.name = class_column, .as = LG_FRAME_TEXT};
    LG_TRY(read_rows(&f, class_column, &made, error));
    return LG_GIVE(out, made);
}

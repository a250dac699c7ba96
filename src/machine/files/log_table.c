/* The table that logs are read into. */
#include <math.h>
#include <string.h>

#include "files/h5.h"
#include "machine/files/log_table.h"

enum { FIRST_ROWS = 1024, FIRST_WARNINGS = 8 };

lg_status lg_log_no_memory(const char *path, lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(path));
}

static bool is_h5(const lg_log_table *table, uint32_t file) {
    bool is = false;
    return lg_file_is_h5(table->paths[file], &is, NULL) == LG_OK && is;
}

lg_status lg_log_fail(const lg_log_table *table, size_t row, lg_error *error, const char *format, ...) {
    char text[400];
    va_list arguments;
    const lg_log_origin *o = &table->origin[row];
    va_start(arguments, format);
    (void)lg_format_list(text, sizeof text, format, arguments);
    va_end(arguments);
    return lg_fail(error, LG_FORMAT, "%s: %s %zu: %s", lg_shown_path(table->paths[o->file]),
                   is_h5(table, o->file) ? "row" : "line", o->line, text);
}

lg_status lg_log_warn(lg_log_table *table, const char *format, ...) {
    va_list arguments;
    lg_logs *out = table->out;
    const uint32_t count = out->warning_count;
    if (count == 0 || (count >= FIRST_WARNINGS && (count & (count - 1)) == 0)) {
        char(*more)[LG_LOG_SENTENCE] =
            lg_alloc(table->context, count == 0 ? FIRST_WARNINGS : 2 * (size_t)count, sizeof *more);
        if (more == NULL) return LG_OUT_OF_MEMORY;
        if (count > 0) memcpy(more, out->warnings, count * sizeof *more);
        lg_free(table->context, out->warnings);
        out->warnings = more;
    }
    va_start(arguments, format);
    (void)lg_format_list(out->warnings[out->warning_count++], LG_LOG_SENTENCE, format, arguments);
    va_end(arguments);
    return LG_OK;
}

lg_status lg_log_warn_at(lg_log_table *table, size_t row, const char *format, ...) {
    char text[LG_LOG_SENTENCE];
    va_list arguments;
    const lg_log_origin *o = &table->origin[row];
    va_start(arguments, format);
    (void)lg_format_list(text, sizeof text, format, arguments);
    va_end(arguments);
    return lg_log_warn(table, "%s: %s %zu: %s", lg_shown_path(table->paths[o->file]),
                       is_h5(table, o->file) ? "row" : "line", o->line, text);
}

double lg_log_tidy(double scale) {
    const double tidy = copysign(pow(10.0, round(log10(fabs(scale)))), scale);
    return fabs(scale / tidy - 1.0) < 0.01 ? tidy : scale;
}

static lg_status grow(lg_log_table *table) {
    const size_t room = table->room == 0 ? FIRST_ROWS : 2 * table->room;
    double *data = lg_alloc(table->context, room, table->columns * sizeof *data);
    lg_log_origin *origin = lg_alloc(table->context, room, sizeof *origin);
    if (data == NULL || origin == NULL) {
        lg_free(table->context, data);
        lg_free(table->context, origin);
        return LG_OUT_OF_MEMORY;
    }
    if (table->rows > 0) {
        memcpy(data, table->data, table->rows * table->columns * sizeof *data);
        memcpy(origin, table->origin, table->rows * sizeof *origin);
    }
    lg_free(table->context, table->data);
    lg_free(table->context, table->origin);
    table->data = data;
    table->origin = origin;
    table->room = room;
    return LG_OK;
}

lg_status lg_log_append(lg_log_table *table, uint32_t file, size_t line, const double *values, bool new_run,
                        lg_error *error) {
    const lg_log_column *columns = table->machine->columns;
    table->runs += new_run;
    table->rows_read++;
    if (isnan(values[table->machine->time])) return LG_OK;
    if (table->rows == table->room && grow(table) != LG_OK)
        return lg_log_no_memory(table->paths[file], error);
    const size_t row = table->rows++;
    double *to = lg_log_row(table, row);
    table->origin[row] = (lg_log_origin){line, file, table->runs - 1};
    for (uint32_t i = 0; i < table->columns; i++) {
        to[i] = values[i] * columns[i].scale;
        if (isinf(to[i]))
            return lg_log_fail(
                table, row, error,
                "column %s: the value is infinite; for a missing value leave the cell empty or write nan",
                columns[i].name);
    }
    return LG_OK;
}

void lg_log_names_of(const lg_log_table *table, uint32_t first, uint32_t count, lg_csv_names *names) {
    *names = (lg_csv_names){.used = 0};
    for (uint32_t i = 0; i < count; i++) lg_csv_add_name(names, table->machine->columns[first + i].name);
}

static lg_status read_file(lg_log_table *table, uint32_t file, lg_error *error) {
    return is_h5(table, file) ? lg_log_read_h5(table, file, error) : lg_log_read_csv(table, file, error);
}

lg_status lg_log_read_files(lg_log_table *table, size_t count, lg_error *error) {
    for (uint32_t file = 0; file < count; file++) {
        const size_t before = table->rows, read = table->rows_read;
        LG_TRY(read_file(table, file, error));
        const size_t timeless = table->rows_read - read - (table->rows - before);
        const char *shown = lg_shown_path(table->paths[file]);
        if (table->rows == before)
            return lg_fail(error, LG_FORMAT, "%s: has no row with a time (column %s)", shown,
                           table->machine->columns[table->machine->time].name);
        if (timeless > 0)
            LG_TRY(lg_log_warn(table, "%s: %zu rows without a time were left out", shown, timeless));
    }
    return LG_OK;
}

/* The table that logs are read into. */
#include <math.h>
#include <string.h>

#include "files/frame.h"
#include "files/h5.h"
#include "machine/files/log_table.h"

enum { FIRST_WARNINGS = 8 };

lg_status lg_log_no_memory(const lg_log_table *table) {
    return lg_fail(table->error, LG_OUT_OF_MEMORY, "%s: out of memory", lg_shown_path(table->paths[0]));
}

lg_status lg_log_fail(const lg_log_table *table, size_t row, const char *format, ...) {
    char text[400];
    va_list arguments;
    const lg_log_origin *o = &table->origin[row];
    va_start(arguments, format);
    (void)lg_format_list(text, sizeof text, format, arguments);
    va_end(arguments);
    return lg_fail(table->error, LG_FORMAT, "%s: %s %zu: %s", lg_shown_path(table->paths[o->file]),
                   table->place[o->file], o->line, text);
}

void lg_log_warn(lg_log_table *table, const char *format, ...) {
    va_list arguments;
    lg_logs *out = table->out;
    const uint32_t count = out->warning_count;
    if (count == 0 || (count >= FIRST_WARNINGS && (count & (count - 1)) == 0)) {
        char(*more)[LG_LOG_SENTENCE] =
            lg_widen(table->context, out->warnings, count, count == 0 ? FIRST_WARNINGS : 2 * (size_t)count,
                     sizeof *more);
        table->failed = table->failed || more == NULL;
        if (more == NULL) return;
        out->warnings = more;
    }
    va_start(arguments, format);
    (void)lg_format_list(out->warnings[out->warning_count++], LG_LOG_SENTENCE, format, arguments);
    va_end(arguments);
}

void lg_log_warn_at(lg_log_table *table, size_t row, const char *format, ...) {
    char text[LG_LOG_SENTENCE];
    va_list arguments;
    const lg_log_origin *o = &table->origin[row];
    va_start(arguments, format);
    (void)lg_format_list(text, sizeof text, format, arguments);
    va_end(arguments);
    lg_log_warn(table, "%s: %s %zu: %s", lg_shown_path(table->paths[o->file]), table->place[o->file], o->line,
                text);
}

void lg_log_names_of(const lg_log_table *table, uint32_t first, uint32_t count, lg_name_list *names) {
    *names = (lg_name_list){.used = 0};
    for (uint32_t i = 0; i < count; i++) lg_name_list_add(names, table->machine->columns[first + i].name);
}

/* ---- reading ---- */

typedef struct file_reading {
    lg_log_table *table;
    uint32_t file;
    lg_frame frame;
    lg_frame_want want[LG_LOG_COLUMNS]; /* (columns) in the order of the machine's file */
    lg_frame_text run;                  /* of the previous row */
} file_reading;

/* Makes room for the rows of a file. */
static lg_status grow(lg_log_table *table, size_t rows) {
    if (rows <= table->room - table->rows) return LG_OK;
    const size_t room = 2 * table->room + rows;
    double *data = lg_widen(table->context, table->data, table->rows * table->columns, room * table->columns,
                            sizeof *data);
    if (data != NULL) table->data = data;
    lg_log_origin *origin = lg_widen(table->context, table->origin, table->rows, room, sizeof *origin);
    if (origin != NULL) table->origin = origin;
    if (data != NULL && origin != NULL) table->room = room;
    return data != NULL && origin != NULL ? LG_OK : lg_log_no_memory(table);
}

/* Counts the row's run if it is a new one. */
static lg_status count_run(file_reading *r, size_t row) {
    lg_log_table *table = r->table;
    const lg_machine_file *machine = table->machine;
    const bool begins = row == 0 && r->frame.before == 0, named = machine->run < table->columns;
    const char *run = named ? lg_frame_text_of(&r->frame, row, &r->want[machine->run]) : "";
    if (named && *run == '\0')
        return lg_frame_fail(&r->frame, row, machine->columns[machine->run].name, table->error,
                             "the row names no run");
    table->runs += begins || strcmp(run, r->run) != 0;
    memcpy(r->run, run, strlen(run) + 1);
    return LG_OK;
}

/* Appends a row. A row without a time is counted in rows_read only. */
static lg_status append_row(file_reading *r, size_t row) {
    lg_log_table *table = r->table;
    const lg_log_column *columns = table->machine->columns;
    const double *values = r->frame.value + row * r->frame.width;
    LG_TRY(count_run(r, row));
    table->rows_read++;
    if (isnan(values[r->want[table->machine->time].first])) return LG_OK;
    table->origin[table->rows] = (lg_log_origin){r->frame.line[row], r->file, table->runs - 1};
    double *to = lg_log_row(table, table->rows);
    for (uint32_t i = 0; i < table->columns; i++) {
        to[i] = i == table->machine->run ? 0 : values[r->want[i].first] * columns[i].scale;
        if (isinf(to[i]))
            return lg_frame_fail(&r->frame, row, columns[i].name, table->error,
                                 "the value is infinite when it is multiplied by its scale");
    }
    table->rows++;
    return LG_OK;
}

static lg_status read_rows(file_reading *r) {
    lg_frame *f = &r->frame;
    lg_log_table *t = r->table;
    LG_TRY(lg_frame_open(f, t->error));
    t->place[r->file] = f->place;
    LG_TRY(lg_frame_next(f, SIZE_MAX, t->error));
    LG_TRY(grow(t, f->rows));
    for (size_t row = 0; row < f->rows; row++) LG_TRY(append_row(r, row));
    if (f->cut) lg_log_warn(t, "%s: the last line was cut off and left out", f->shown);
    return LG_OK;
}

static lg_status read_file(lg_log_table *table, uint32_t file) {
    const lg_machine_file *machine = table->machine;
    file_reading *r = lg_alloc(table->context, 1, sizeof *r);
    if (r == NULL) return lg_log_no_memory(table);
    r->table = table;
    r->file = file;
    r->frame = (lg_frame){.context = table->context,
                          .path = table->paths[file],
                          .what = "log",
                          .options = &table->options->read,
                          .want = r->want,
                          .wants = table->columns};
    for (uint32_t i = 0; i < table->columns; i++)
        r->want[i] = (lg_frame_want){.name = machine->columns[i].name,
                                     .as = i == machine->run    ? LG_FRAME_TEXT
                                           : i == machine->time ? LG_FRAME_ROUNDED
                                                                : LG_FRAME_NUMBER};
    const lg_status status = read_rows(r);
    lg_frame_close(&r->frame);
    lg_free(table->context, r);
    return status;
}

lg_status lg_log_read_files(lg_log_table *table) {
    for (uint32_t file = 0; file < table->files; file++) {
        const size_t before = table->rows, read = table->rows_read;
        LG_TRY(read_file(table, file));
        const size_t timeless = table->rows_read - read - (table->rows - before);
        const char *shown = lg_shown_path(table->paths[file]);
        if (table->rows == before)
            return lg_fail(table->error, LG_FORMAT, "%s: has no row with a time (column %s)", shown,
                           table->machine->columns[table->machine->time].name);
        if (timeless > 0) lg_log_warn(table, "%s: %zu rows without a time were left out", shown, timeless);
    }
    return LG_OK;
}

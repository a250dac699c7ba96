/* The table that logs are read into. */
#include <math.h>
#include <string.h>

#include "files/frame.h"
#include "files/h5.h"
#include "machine/files/log_table.h"

enum { FIRST_WARNINGS = 8 };

lg_status lg_log_no_memory(const lg_log_table *table) {
    return lg_no_memory_for(table->paths[0], table->error);
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

void lg_log_names_of(const lg_log_table *table, uint32_t first, uint32_t count, lg_name_list *names) {
    *names = (lg_name_list){.used = 0};
    for (uint32_t i = 0; i < count; i++) lg_name_list_add(names, table->machine->columns[first + i].name);
}

/* ---- reading ---- */

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

/* Appends the rows that have a time; the others are counted in rows_read of the logs only. */
static lg_status append_rows(lg_log_table *t, uint32_t file, const lg_frame *f) {
    const lg_log_column *columns = t->machine->columns;
    const uint32_t time = t->machine->time, run = t->machine->run;
    const char *before = NULL;
    LG_TRY(grow(t, f->rows));
    for (size_t row = 0; row < f->rows; row++) {
        const double *values = f->value + row * f->width;
        double *to = lg_log_row(t, t->rows);
        const char *name = run < t->columns ? lg_frame_text_of(f, row, &f->want[run]) : "";
        if (run < t->columns && *name == '\0')
            return lg_frame_fail(f, row, columns[run].name, t->error,
                                 "the row names no run: fill the cell, or remove the row");
        if (before == NULL || strcmp(name, before) != 0) {
            t->out->runs++;
            lg_text_append(&t->names, name, strlen(name) + 1);
        }
        before = name;
        t->out->rows_read++;
        if (isnan(values[f->want[time].first])) continue;
        t->origin[t->rows] = (lg_log_origin){f->line[row], file, t->out->runs - 1};
        for (uint32_t i = 0; i < t->columns; i++) to[i] = i == run ? 0 : values[f->want[i].first];
        t->rows++;
    }
    return LG_OK;
}

static lg_status read_file(lg_log_table *t, uint32_t file, lg_frame *f) {
    const size_t before = t->rows, read = t->out->rows_read;
    LG_TRY(lg_frame_open(f, t->error));
    t->place[file] = f->place;
    LG_TRY(lg_frame_next(f, SIZE_MAX, t->error));
    LG_TRY(append_rows(t, file, f));
    if (f->cut) lg_log_warn(t, "%s: the last line was cut off and left out", f->shown);
    const size_t timeless = t->out->rows_read - read - (t->rows - before);
    if (t->rows == before)
        return lg_fail(t->error, LG_FORMAT, "%s: has no row with a time (column %s)", f->shown,
                       t->machine->columns[t->machine->time].name);
    if (timeless > 0) lg_log_warn(t, "%s: %zu rows without a time were left out", f->shown, timeless);
    return LG_OK;
}

lg_status lg_log_read_files(lg_log_table *t) {
    LG_TRY_SCRATCH(lg_frame_want, want, t->context, t->columns, lg_log_no_memory(t));
    for (uint32_t file = 0; file < t->files; file++) {
        LG_CLEAN(lg_frame_close)
        lg_frame f = {.context = t->context,
                      .path = t->paths[file],
                      .what = "log",
                      .options = &t->options->read,
                      .want = want,
                      .wants = t->columns};
        for (uint32_t i = 0; i < t->columns; i++)
            want[i] = (lg_frame_want){.name = t->machine->columns[i].name,
                                      .scale = t->machine->columns[i].scale,
                                      .as = i == t->machine->run    ? LG_FRAME_TEXT
                                            : i == t->machine->time ? LG_FRAME_TIME
                                                                    : LG_FRAME_NUMBER};
        LG_TRY(read_file(t, file, &f));
    }
    return LG_OK;
}

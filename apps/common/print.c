/* JSON, tables, warnings, progress. */
#include "common/app.h"

#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* ---- JSON ---- */

/* Prints text as a JSON string with its quotes. Special characters are escaped; bytes that are not UTF-8
 * become \ufffd. */
static void put_quoted(FILE *stream, const char *text) {
    (void)fputc('"', stream);
    uint32_t code;
    for (size_t n; *text != '\0'; text += n) {
        n = lg_utf8(text, SIZE_MAX, &code);
        if (*text == '"' || *text == '\\')
            (void)fprintf(stream, "\\%c", *text);
        else if (app_is_harmless(code))
            (void)fwrite(text, 1, n, stream);
        else
            (void)fprintf(stream, "\\u%04x", code == LG_NO_CHARACTER ? 0xfffdu : code);
    }
    (void)fputc('"', stream);
}

/* Writes the key and returns true if a value is to follow. In text for people no value follows; there
 * put_cell fills the tables. */
static bool put_key(app_json *json, const char *key) {
    if (json->people) return false;
    if (json->comma) (void)fputs(", ", json->stream);
    json->comma = true;
    if (key == NULL) return true;
    put_quoted(json->stream, key);
    (void)fputs(": ", json->stream);
    return true;
}

static void put_cell(app_json *json, const char *key, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
static void put_name(app_json *json, const char *name);

void app_json_real(app_json *json, const char *key, double value) {
    char text[LG_SHORTEST];
    put_cell(json, key, isfinite(value) ? "%.6g" : "-", value);
    if (!put_key(json, key)) return;
    lg_format_shortest(text, value, false);
    (void)fputs(isfinite(value) ? text : "null", json->stream);
}

void app_json_size(app_json *json, const char *key, uint64_t value) {
    put_cell(json, key, "%llu", (unsigned long long)value);
    if (put_key(json, key)) (void)fprintf(json->stream, "%llu", (unsigned long long)value);
}

void app_json_bool(app_json *json, const char *key, bool value) {
    put_cell(json, key, "%s", value ? "yes" : "no");
    if (put_key(json, key)) (void)fputs(value ? "true" : "false", json->stream);
}

void app_json_text(app_json *json, const char *key, const char *value) {
    put_cell(json, key, "%s", value != NULL ? value : "");
    if (!put_key(json, key)) return;
    if (value != NULL)
        put_quoted(json->stream, value);
    else
        (void)fputs("null", json->stream);
}

void app_json_reals(app_json *json, const char *key, const double *values, size_t count) {
    app_json_open(json, key, '[');
    for (size_t i = 0; i < count; i++) app_json_real(json, NULL, values[i]);
    app_json_close(json, ']');
}

void app_json_field(app_json *json, const lg_field *row, const void *run) {
    const char *key = row->json != NULL ? row->json : row->name;
    char text[LG_FIELD_TEXT_SIZE];
    double list[LG_FIELD_LIST_MAX];
    const bool words = row->type == LG_FIELD_U64 && lg_field_name(row, 0) != NULL;
    switch (words ? LG_FIELD_NAME : row->type) {
    case LG_FIELD_REAL:
        app_json_real(json, key, lg_field_number(row, run));
        break;
    case LG_FIELD_U64:
    case LG_FIELD_U32:
        app_json_size(json, key, lg_field_whole(row, run));
        break;
    case LG_FIELD_FLAG:
        app_json_bool(json, key, lg_field_whole(row, run) != 0);
        break;
    case LG_FIELD_WHOLES:
    case LG_FIELD_REALS:
        app_json_reals(json, key, list, lg_field_list(row, run, list));
        break;
    default:
        lg_field_show(row, run, text, sizeof text);
        app_json_text(json, key, text[0] != '\0' ? text : NULL);
    }
}

void app_json_open(app_json *json, const char *key, char bracket) {
    if (key != NULL && bracket == '{') put_name(json, key);
    if (!put_key(json, key)) return;
    (void)fputc(bracket, json->stream);
    json->comma = false;
}

void app_json_close(app_json *json, char bracket) {
    if (json->people) return;
    (void)fputc(bracket, json->stream);
    json->comma = true;
}

/* ---- tables ---- */

void app_table_cell(app_table *table, const char *format, ...) {
    if (table->cells == table->room) {
        table->room = table->room > 0 ? 2 * table->room : 64;
        char **text = realloc(table->text, table->room * sizeof *text);
        if (text == NULL) app_out_of_memory();
        table->text = text;
    }
    va_list arguments;
    char cell[256];
    va_start(arguments, format);
    (void)vsnprintf(cell, sizeof cell, format, arguments);
    va_end(arguments);
    table->text[table->cells++] = app_shown(cell);
}

void app_table_row(app_table *table, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    APP_FREE char *text = app_shown_list(format, arguments);
    va_end(arguments);
    for (char *cell = text, *next = text; next != NULL; cell = next) {
        next = strchr(cell, '\t');
        if (next != NULL) *next++ = '\0';
        app_table_cell(table, "%s", cell);
    }
    if (table->columns == 0) table->columns = table->cells;
}

static size_t column_width(const app_table *table, size_t column) {
    size_t width = 0;
    for (size_t i = column; i < table->cells; i += table->columns)
        if (strlen(table->text[i]) > width) width = strlen(table->text[i]);
    return width;
}

void app_table_end(app_table *table, FILE *stream) {
    for (size_t i = 0; i < table->cells; i++) {
        const size_t column = i % table->columns, row = i / table->columns;
        const int width = (int)column_width(table, column);
        if (column == 0)
            (void)fprintf(stream, "%-*s", width, table->text[i]);
        else
            (void)fprintf(stream, "  %*s", width, table->text[i]);
        if (column + 1 < table->columns) continue;
        (void)fputc('\n', stream);
        if (row > 0) continue;
        for (size_t c = 0; c < table->columns; c++) {
            const size_t dashes = column_width(table, c) + (c > 0 ? 2 : 0);
            for (size_t k = 0; k < dashes; k++) (void)fputc('-', stream);
        }
        (void)fputc('\n', stream);
    }
    for (size_t i = 0; i < table->cells; i++) free(table->text[i]);
    free(table->text);
}

/* ---- warnings: each sentence is printed on stderr once and kept for JSON ---- */

enum { KEPT = 64 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static size_t warnings;
static char *sentences[KEPT];

void app_warn(const app *self, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    char *sentence = app_format_list(format, arguments);
    va_end(arguments);
    (void)pthread_mutex_lock(&lock);
    size_t i = 0;
    while (i < warnings && strcmp(sentences[i], sentence) != 0) i++;
    if (i == warnings) app_note(self, "warning: %s", sentence);
    if (i == warnings && i < KEPT)
        sentences[warnings++] = sentence;
    else
        free(sentence);
    (void)pthread_mutex_unlock(&lock);
}

/* No other thread may warn meanwhile. */
static void put_warnings(app_json *json) {
    app_json_open(json, "warnings", '[');
    for (size_t i = 0; i < warnings; i++) app_json_text(json, NULL, sentences[i]);
    app_json_close(json, ']');
}

/* ---- results for people ---- */

void app_result_begin(app_json *json, const app *self) {
    *json = (app_json){.people = !self->json, .prefix = ""};
    json->stream = open_memstream(&json->text, &json->length);
    if (json->stream == NULL) app_out_of_memory();
    if (!json->people) (void)fputc('{', json->stream);
}

void app_result_end(const app *self) {
    app_json *json = self->out;
    const bool used = json->people || json->comma;
    if (json->stream == NULL) return;
    if (!json->people && used) put_warnings(json);
    if (!json->people) (void)fputs("}\n", json->stream);
    if (fclose(json->stream) != 0) app_out_of_memory();
    if (used) (void)fwrite(json->text, 1, json->length, stdout);
    free(json->text);
    json->stream = NULL;
}

static void put_line(app_json *json, const char *key, const char *value, const char *label) {
    if (!json->people || json->rows != NULL) return;
    app_put(json->stream, "%s%-20s  %14s%s%s\n", json->prefix, key, value, label != NULL ? "  " : "",
            label != NULL ? label : "");
}

void app_result_real(app_json *json, const char *key, double value, const char *label) {
    char text[32];
    (void)snprintf(text, sizeof text, isfinite(value) ? "%.6g" : "unknown", value);
    app_json_real(json, key, value);
    put_line(json, key, text, label);
}

void app_result_size(app_json *json, const char *key, uint64_t value, const char *label) {
    char text[32];
    (void)snprintf(text, sizeof text, "%llu", (unsigned long long)value);
    app_json_size(json, key, value);
    put_line(json, key, text, label);
}

void app_result_text(app_json *json, const char *key, const char *value, const char *label) {
    app_json_text(json, key, value);
    if (value != NULL) put_line(json, key, value, label);
}

void app_result_reals(app_json *json, const char *key, const double *values, size_t count,
                      const char *label) {
    app_json_reals(json, key, values, count);
    if (!json->people || json->rows != NULL) return;
    app_put(json->stream, "%-20s  ", key);
    for (size_t i = 0; i < count; i++) (void)fprintf(json->stream, "%s%.10g", i > 0 ? ", " : "", values[i]);
    app_put(json->stream, "%s%s\n", label != NULL ? "  " : "", label != NULL ? label : "");
}

void app_result_line(app_json *json, const char *format, ...) {
    if (!json->people) return;
    va_list arguments;
    va_start(arguments, format);
    APP_FREE char *line = app_shown_list(format, arguments);
    va_end(arguments);
    (void)fprintf(json->stream, "%s\n", line);
}

/* A table for people: the keys of the first object are the headings, the members of all objects are the
 * cells. */
typedef struct app_rows {
    const char *names; /* heading of the column of object names; NULL if the objects have no names */
    app_table table;   /* only the headings, until `cells` are added */
    app_table cells;
} app_rows;

static void begin_rows(app_json *json, const char *key, char bracket, const char *names) {
    app_json_open(json, key, bracket);
    json->named = names != NULL;
    if (!json->people) return;
    json->rows = app_alloc(1, sizeof *json->rows);
    json->rows->names = names;
}

void app_result_rows(app_json *json, const char *key) {
    begin_rows(json, key, '[', NULL);
}

void app_result_named(app_json *json, const char *key, const char *names) {
    begin_rows(json, key, '{', names);
}

static void put_name(app_json *json, const char *name) {
    if (json->rows != NULL && json->rows->names != NULL) put_cell(json, json->rows->names, "%s", name);
}

/* The first object ends when its first key comes again; until then each key becomes a heading. */
static void put_cell(app_json *json, const char *key, const char *format, ...) {
    app_rows *rows = json->rows;
    if (rows == NULL || key == NULL) return;
    const size_t heads = rows->table.cells;
    if (rows->cells.cells == heads && (heads == 0 || strcmp(key, rows->table.text[0]) != 0))
        app_table_cell(&rows->table, "%s", key);
    va_list arguments;
    va_start(arguments, format);
    APP_FREE char *text = app_format_list(format, arguments);
    va_end(arguments);
    app_table_cell(&rows->cells, "%s", text);
}

void app_result_rows_end(app_json *json) {
    APP_FREE app_rows *rows = json->rows;
    json->rows = NULL;
    app_json_close(json, json->named ? '}' : ']');
    if (rows == NULL) return;
    rows->table.columns = rows->table.cells;
    for (size_t i = 0; i < rows->cells.cells; i++) {
        app_table_cell(&rows->table, "%s", rows->cells.text[i]);
        free(rows->cells.text[i]);
    }
    free(rows->cells.text);
    app_table_end(&rows->table, json->stream);
}

/* ---- progress ---- */

void app_progress_begin(app_progress *progress, uint64_t first, uint64_t total) {
    const double now = app_seconds();
    *progress = (app_progress){isatty(STDERR_FILENO) == 1, now, now - 1, first, total};
}

void app_progress_show(app_progress *progress, uint64_t done, const char *format, ...) {
    const double now = app_seconds();
    if (!progress->active || progress->total == 0 || (now - progress->shown < 0.1 && done < progress->total))
        return;
    progress->shown = now;
    char bar[25];
    const double share = (double)done / (double)progress->total;
    const int filled = (int)(24.0 * (share < 1 ? share : 1));
    for (int i = 0; i < 24; i++) bar[i] = i < filled ? '#' : '.';
    bar[24] = '\0';
    va_list arguments;
    va_start(arguments, format);
    APP_FREE char *words = app_shown_list(format, arguments);
    va_end(arguments);
    const double each =
        done > progress->first ? (now - progress->start) / (double)(done - progress->first) : 0;
    const long left =
        (long)(each * (double)(progress->total - (done < progress->total ? done : progress->total)) + 0.5);
    APP_FREE char *line = app_format("\r[%s] %3.0f%%  %.95s  %ld:%02ld left\033[K", bar, 100 * share, words,
                                     left / 60, left % 60);
    app_screen_raw(line);
}

void app_progress_end(app_progress *progress) {
    if (progress->active) app_screen_raw("\r\033[K");
    progress->active = false;
}

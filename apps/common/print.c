/* Results as JSON and as text for people, warnings, progress. */
#include "common/app.h"

#include <math.h>
#include <pthread.h>
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

static void put_cell(app_json *json, const char *key, const char *text);

/* Returns the text that people see, or NULL for a list and for a text that is NULL. */
static const char *shown(const lg_result *value, const char *unknown, char text[LG_SHORTEST]) {
    if (value->type == LG_FIELD_FLAG) return value->whole != 0 ? "yes" : "no";
    if (value->type == LG_FIELD_REAL && !isfinite(value->real)) return unknown;
    if (value->type == LG_FIELD_REAL)
        (void)snprintf(text, LG_SHORTEST, "%.*g", value->digits > 0 ? value->digits : 6, value->real);
    else if (value->type == LG_FIELD_U64)
        (void)snprintf(text, LG_SHORTEST, "%llu", (unsigned long long)value->whole);
    else
        return value->type == LG_FIELD_STRING ? value->text : NULL;
    return text;
}

/* The line that people see of an entry. */
static void put_line(app_json *json, const lg_result *value) {
    char text[LG_SHORTEST];
    const char *word = shown(value, "unknown", text), *label = value->label;
    const bool list = value->type == LG_FIELD_REALS;
    if (word == NULL && !list) return;
    if (list)
        app_put(json->stream, "%-20s  ", value->name);
    else
        app_put(json->stream, "%s%-20s  %14s", json->prefix, value->name, word);
    for (uint64_t i = 0; list && i < value->whole; i++)
        (void)fprintf(json->stream, "%s%.10g", i > 0 ? ", " : "", value->reals[i]);
    app_put(json->stream, "%s%s\n", label != NULL ? "  " : "", label != NULL ? label : "");
}

/* JSON has a list of the rows; people see a table, if there are not too many classes. */
static void put_confusion(app_json *json, const lg_result *matrix) {
    enum { SHOWN = 12 };
    const uint64_t classes = matrix->whole, *count = matrix->counts;
    if (json->people && classes > SHOWN) return;
    app_result_rows(json, matrix->name);
    for (uint64_t i = 0; i < classes; i++) {
        put_cell(json, "true class / given", matrix->text + i * matrix->size);
        app_json_open(json, NULL, '[');
        for (uint64_t j = 0; j < classes; j++)
            app_json_size(json, json->people ? matrix->text + j * matrix->size : NULL, *count++);
        app_json_close(json, ']');
    }
    app_result_rows_end(json);
}

void app_json_put(app_json *json, lg_result value) {
    char text[LG_SHORTEST];
    const bool reals = value.type == LG_FIELD_REALS;
    const char *word = shown(&value, "-", text);
    if (value.counts != NULL) put_confusion(json, &value);
    if (value.counts != NULL || (value.people && !json->people)) return;
    if (json->people && !json->tabled) {
        if (value.shown) put_line(json, &value);
        return;
    }
    if (reals || value.type == LG_FIELD_TEXT) {
        app_json_open(json, value.name, '[');
        for (uint64_t i = 0; i < value.whole; i++)
            app_json_put(json, reals ? LG_AS_REAL(NULL, value.reals[i])
                                     : LG_AS_TEXT(NULL, value.text + i * value.size));
        app_json_close(json, ']');
        return;
    }
    put_cell(json, value.name, word != NULL ? word : "");
    if (!put_key(json, value.name)) return;
    if (value.type == LG_FIELD_FLAG) word = value.whole != 0 ? "true" : "false";
    if (value.type == LG_FIELD_REAL) {
        word = isfinite(value.real) ? text : NULL;
        lg_format_shortest(text, value.real, false);
    }
    if (value.type == LG_FIELD_STRING && word != NULL)
        put_quoted(json->stream, word);
    else
        (void)fputs(word != NULL ? word : "null", json->stream);
}

void app_json_list(app_json *json, const lg_result *members) {
    for (; members->name != NULL; members++) app_json_put(json, *members);
}

void app_json_object(app_json *json, const char *key, const lg_result *members) {
    app_json_open(json, key, '{');
    app_json_list(json, members);
    app_json_close(json, '}');
}

void app_json_field(app_json *json, const lg_field *row, const void *run) {
    const char *key = row->json != NULL ? row->json : row->name;
    char text[LG_FIELD_TEXT_SIZE];
    double list[LG_FIELD_LIST_MAX];
    const bool words = row->type == LG_FIELD_U64 && lg_field_name(row, 0) != NULL;
    const lg_field_type type = words ? LG_FIELD_NAME : row->type;
    if (type == LG_FIELD_REAL) {
        app_json_real(json, key, lg_field_number(row, run));
    } else if (type == LG_FIELD_U64 || type == LG_FIELD_U32) {
        app_json_size(json, key, lg_field_whole(row, run));
    } else if (type == LG_FIELD_FLAG) {
        app_json_put(json, LG_AS_FLAG(key, lg_field_whole(row, run) != 0));
    } else if (type == LG_FIELD_WHOLES || type == LG_FIELD_REALS) {
        app_json_reals(json, key, list, lg_field_list(row, run, list));
    } else {
        lg_field_show(row, run, text, sizeof text);
        app_json_text(json, key, text[0] != '\0' ? text : NULL);
    }
}

void app_json_open(app_json *json, const char *key, char bracket) {
    if (key != NULL && bracket == '{') put_cell(json, json->names, key);
    if (!put_key(json, key)) return;
    (void)fputc(bracket, json->stream);
    json->comma = false;
}

void app_json_close(app_json *json, char bracket) {
    if (json->people) return;
    (void)fputc(bracket, json->stream);
    json->comma = true;
}

/* ---- warnings: each sentence is printed on stderr once and kept for JSON ---- */

enum { KEPT = 64 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static size_t warnings;
static char *sentences[KEPT];

void app_warn_words(const app *self, char *sentence) {
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
    if (used) app_json_open(json, "warnings", '[');
    for (size_t i = 0; used && i < warnings; i++)
        app_json_text(json, NULL, sentences[i]); /* no thread warns now */
    if (used) app_json_close(json, ']');
    if (!json->people) (void)fputs("}\n", json->stream);
    if (fclose(json->stream) != 0) app_out_of_memory();
    if (used) (void)fwrite(json->text, 1, json->length, stdout);
    free(json->text);
    json->stream = NULL;
}

void app_result_known(app_json *json, const char *key, double value, const char *label) {
    if (isfinite(value) || !json->people) app_result_real(json, key, value, label);
}

void app_result_words(app_json *json, char *line) {
    if (json->people) (void)fprintf(json->stream, "%s\n", line);
    free(line);
}

void app_result_table(app_json *json, const char *key, char bracket, const char *names) {
    app_json_open(json, key, bracket);
    json->names = bracket == '{' ? names : NULL;
    json->tabled = json->people;
}

/* The first object ends when its first key comes again; until then each key becomes a heading. */
static void put_cell(app_json *json, const char *key, const char *text) {
    app_table *table = &json->table;
    if (!json->tabled || key == NULL) return;
    if (table->cells + 2 > table->room) {
        table->room = 2 * table->room + 64;
        table->text = realloc(table->text, table->room * sizeof *table->text);
        if (table->text == NULL) app_out_of_memory();
    }
    if (table->cells == 2 * table->columns && (table->cells == 0 || strcmp(key, table->text[0]) != 0)) {
        char **first = table->text + table->columns;
        memmove(first + 1, first, table->columns++ * sizeof *first);
        *first = app_shown(key);
        table->cells++;
    }
    table->text[table->cells++] = app_shown(text);
}

static size_t column_width(const app_table *table, size_t column) {
    size_t width = 0;
    for (size_t i = column; i < table->cells; i += table->columns)
        if (strlen(table->text[i]) > width) width = strlen(table->text[i]);
    return width;
}

/* The first column is aligned to the left, the others to the right; a line of dashes follows the headings. */
void app_result_rows_end(app_json *json) {
    app_table *table = &json->table;
    app_json_close(json, json->names != NULL ? '}' : ']');
    for (size_t i = 0; i < table->cells; i++) {
        const size_t column = i % table->columns, row = i / table->columns;
        (void)fprintf(json->stream, column == 0 ? "%-*s" : "  %*s", (int)column_width(table, column),
                      table->text[i]);
        if (column + 1 < table->columns) continue;
        (void)fputc('\n', json->stream);
        if (row > 0) continue;
        for (size_t c = 0; c < table->columns; c++) {
            const size_t dashes = column_width(table, c) + (c > 0 ? 2 : 0);
            for (size_t k = 0; k < dashes; k++) (void)fputc('-', json->stream);
        }
        (void)fputc('\n', json->stream);
    }
    for (size_t i = 0; i < table->cells; i++) free(table->text[i]);
    free(table->text);
    *table = (app_table){0};
    json->tabled = false;
}

/* ---- progress ---- */

void app_progress_begin(app_progress *progress, uint64_t first, uint64_t total) {
    const double now = app_seconds();
    *progress = (app_progress){isatty(STDERR_FILENO) == 1, now, now - 1, first, total};
}

bool app_progress_due(app_progress *progress, uint64_t done) {
    const double now = app_seconds();
    const bool due =
        progress->active && progress->total > 0 && (now - progress->shown >= 0.1 || done >= progress->total);
    if (due) progress->shown = now;
    return due;
}

void app_progress_words(const app_progress *progress, uint64_t done, char *words) {
    char bar[25];
    const double share = (double)done / (double)progress->total;
    const int filled = (int)(24.0 * (share < 1 ? share : 1));
    for (int i = 0; i < 24; i++) bar[i] = i < filled ? '#' : '.';
    bar[24] = '\0';
    const double each =
        done > progress->first ? (progress->shown - progress->start) / (double)(done - progress->first) : 0;
    const long left =
        (long)(each * (double)(progress->total - (done < progress->total ? done : progress->total)) + 0.5);
    APP_FREE char *line = app_format("\r[%s] %3.0f%%  %.95s  %ld:%02ld left\033[K", bar, 100 * share, words,
                                     left / 60, left % 60);
    app_screen_raw(line);
    free(words);
}

void app_progress_end(app_progress *progress) {
    if (progress->active) app_screen_raw("\r\033[K");
    progress->active = false;
}

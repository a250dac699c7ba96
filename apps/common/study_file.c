/* The CSV file of a study. */
#include "common/study.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "files/csv.h"

/* Columns between the axes and the measures, and columns behind the measures. */
static const char *const between[] = {"repeat", "seed"}, *const behind[] = {"epochs", "status", "protocol"};
enum { MOST_COLUMNS = STUDY_AXES + STUDY_MEASURES + LG_COUNT(between) + LG_COUNT(behind) };

static void add_name(char *text, size_t size, const char *name) {
    const size_t used = strlen(text);
    (void)snprintf(text + used, size - used, "%s%s", used > 0 ? "," : "", name);
}

static void header_of(const study_plan *plan, char *text, size_t size) {
    text[0] = '\0';
    for (uint32_t i = 0; i < plan->axis_count; i++) add_name(text, size, plan->axes[i].name);
    for (size_t i = 0; i < LG_COUNT(between); i++) add_name(text, size, between[i]);
    for (uint32_t i = 0; i < plan->measure_count; i++) add_name(text, size, plan->measures[i]);
    for (size_t i = 0; i < LG_COUNT(behind); i++) add_name(text, size, behind[i]);
}

/* ---- reading ---- */

/* Reads a number; an empty field is NaN. */
static bool parse_result(const char *text, double *out) {
    if (text[0] != '\0') return app_parse_real(text, out);
    *out = (double)NAN;
    return true;
}

/* Sets *at to the value's index on its axis. A name or number that is not on the axis may be from an earlier
 * grid; it gets the index axis->count. False: the text is empty or not a number. */
static bool parse_value(const study_axis *axis, const char *text, uint32_t *at) {
    double number = (double)NAN;
    const bool named = isnan(axis->number[0]);
    if (text[0] == '\0' || (!named && !app_parse_real(text, &number))) return false;
    for (*at = 0; *at < axis->count; ++*at)
        if (named ? strcmp(axis->text[*at], text) == 0 : axis->number[*at] == number) break;
    return true;
}

static bool parse_repeat(const char *text, uint32_t *out) {
    uint64_t value;
    if (!app_parse_size(text, &value) || value > UINT32_MAX) return false;
    *out = (uint32_t)value;
    return true;
}

static bool parse_row(const study_plan *plan, char *line, const char **protocol, study_row *row) {
    const size_t columns = plan->axis_count + LG_COUNT(between) + plan->measure_count + LG_COUNT(behind);
    char *field[MOST_COLUMNS], *at = line;
    size_t n = 0;
    for (; n < columns && at != NULL; n++) {
        field[n] = at;
        at = strchr(at, ',');
        if (at != NULL) *at++ = '\0';
    }
    if (n != columns || at != NULL) return false;
    char **next = field;
    bool good = true;
    for (uint32_t i = 0; i < plan->axis_count && good; i++)
        good = parse_value(&plan->axes[i], *next++, &row->at[i]);
    good = good && parse_repeat(*next++, &row->repeat) && app_parse_size(*next++, &row->seed);
    for (uint32_t i = 0; i < plan->measure_count && good; i++) good = parse_result(*next++, &row->result[i]);
    if (!good || !app_parse_size(next[0], &row->epochs)) return false;
    row->failed = strcmp(next[1], "ok") != 0;
    *protocol = next[2];
    return true;
}

static void keep(study_file *file, const study_row *row) {
    if (file->count == file->room) {
        const size_t room = file->room > 0 ? 2 * file->room : 256;
        study_row *rows = app_alloc(room, sizeof *rows);
        if (file->count > 0) memcpy(rows, file->rows, file->count * sizeof *rows);
        free(file->rows);
        file->rows = rows;
        file->room = room;
    }
    file->rows[file->count++] = *row;
}

static lg_status parse_line(study_file *file, const lg_csv *csv, const char *header, lg_error *error) {
    const char *path = file->text.path, *protocol;
    study_row row;
    if (csv->number == 1 && strcmp(csv->line, header) == 0) return LG_OK;
    if (csv->number == 1)
        return app_error(error, LG_FORMAT,
                         "%s: line 1: this is not the table of a study; first line expected: %s", path,
                         header);
    (void)fprintf(file->text.stream, "%s\n", csv->line);
    if (!parse_row(file->plan, csv->line, &protocol, &row))
        return app_error(error, LG_FORMAT, "%s: line %zu: not a row of a study", path, csv->number);
    if (strcmp(protocol, file->plan->protocol) != 0)
        return app_error(error, LG_FORMAT,
                         "%s: line %zu: the row belongs to a study with other settings (protocol %s, not %s)",
                         path, csv->number, protocol, file->plan->protocol);
    keep(file, &row);
    return LG_OK;
}

static lg_status read_table(study_file *file, lg_error *error) {
    lg_csv csv;
    char header[512];
    bool more = true;
    header_of(file->plan, header, sizeof header);
    (void)fprintf(file->text.stream, "%s\n", header);
    lg_status status = lg_csv_open(NULL, file->text.path, "table of a study", &csv, error);
    while (status == LG_OK && (status = lg_csv_next(&csv, &more, error)) == LG_OK && more &&
           (csv.closed || csv.number == 1))
        status = parse_line(file, &csv, header, error);
    file->changed = file->count == 0;
    lg_csv_close(&csv);
    return status == LG_NOT_FOUND ? LG_OK : status;
}

lg_status study_file_open(const char *path, const study_plan *plan, study_file *out, lg_error *error) {
    *out = (study_file){.plan = plan};
    app_file_begin(&out->text, path);
    const lg_status status = read_table(out, error);
    if (status != LG_OK) study_file_close(out);
    return status;
}

/* ---- writing ---- */

lg_status study_file_save(study_file *file, lg_error *error) {
    if (!file->changed) return LG_OK;
    if (fflush(file->text.stream) != 0) return app_error(error, LG_OUT_OF_MEMORY, "out of memory");
    file->changed = false;
    return lg_file_write(app_running()->context, file->text.path, file->text.text, file->text.length, error);
}

/* Writes nothing if the number is not finite. */
static void number_text(double value, char text[STUDY_TEXT]) {
    char digits[LG_SHORTEST] = "";
    if (isfinite(value)) lg_format_shortest(digits, value, false);
    (void)snprintf(text, STUDY_TEXT, "%.31s", digits);
}

void study_axis_add(study_axis *axis, const char *name, double number) {
    if (axis->count == STUDY_VALUES) abort(); /* a grid has at most STUDY_VALUES values per axis */
    char *text = axis->text[axis->count];
    axis->number[axis->count++] = name != NULL ? (double)NAN : number;
    if (name != NULL)
        (void)snprintf(text, STUDY_TEXT, "%s", name);
    else
        number_text(number, text);
}

void study_file_append(study_file *file, const study_row *row) {
    const study_plan *plan = file->plan;
    char number[STUDY_TEXT];
    FILE *stream = file->text.stream;
    for (uint32_t i = 0; i < plan->axis_count; i++)
        (void)fprintf(stream, "%s,", plan->axes[i].text[row->at[i]]);
    (void)fprintf(stream, "%u,%llu", row->repeat, (unsigned long long)row->seed);
    for (uint32_t i = 0; i < plan->measure_count; i++) {
        number_text(row->result[i], number);
        (void)fprintf(stream, ",%s", number);
    }
    (void)fprintf(stream, ",%llu,%s,%s\n", (unsigned long long)row->epochs, row->failed ? "failed" : "ok",
                  plan->protocol);
    file->changed = true;
    keep(file, row);
}

const study_row *study_file_find(const study_file *file, const study_row *key) {
    for (size_t i = 0; i < file->count; i++) {
        const study_row *row = &file->rows[i];
        bool same = row->repeat == key->repeat;
        for (uint32_t a = 0; a < file->plan->axis_count && same; a++) same = row->at[a] == key->at[a];
        if (same) return row;
    }
    return NULL;
}

void study_file_close(study_file *file) {
    if (file->text.stream != NULL) app_file_discard(&file->text);
    free(file->rows);
    *file = (study_file){.plan = NULL};
}

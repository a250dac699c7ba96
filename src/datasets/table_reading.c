/* Reads tables of numbers: the common part for names, rows and classes. */
#include "core/lookup.h"
#include "files/csv.h"
#include "files/read_file.h"
#include "datasets/table_names.h"
#include "datasets/table_reading.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FIRST_NAMES = 16, FIRST_NUMBERS = 8192 };

lg_status lg_table_no_memory(const lg_table_reading *r, lg_error *error) {
    return lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", r->shown);
}

void lg_table_names_destroy(lg_table_names *names) {
    if (names == NULL) return;
    lg_free(names->context, names->name);
    *names = (lg_table_names){.count = 0};
}

void lg_table_data_destroy(lg_table_data *data) {
    if (data == NULL) return;
    lg_free(data->context, data->values);
    lg_free(data->context, data->line);
    lg_free(data->context, data->label);
    lg_free(data->context, data->class_name);
    *data = (lg_table_data){.rows = 0};
}

void lg_table_reset(lg_table_reading *r) {
    lg_table_names_destroy(&r->all);
    lg_table_data_destroy(&r->out);
    lg_free(r->context, r->to);
    lg_free(r->context, r->label_text);
    r->to = NULL;
    r->label_text = NULL;
    r->room = 0;
    r->row_room = 0;
    r->all.context = r->out.context = r->context;
    r->out.place = "row";
}

/* ---- names ---- */

/* Returns a copy of an array of `count` elements with room for `room`, and frees `old`. Returns NULL without
 * memory; then `old` stays. */
static void *widened(const lg_context *context, void *old, size_t count, size_t room, size_t size) {
    void *wider = lg_alloc(context, room, size);
    if (wider == NULL) return NULL;
    if (count > 0) memcpy(wider, old, count * size);
    lg_free(context, old);
    return wider;
}

lg_status lg_table_add_name(lg_table_reading *r, const char *name, lg_error *error) {
    if (r->all.count == LG_TABLE_MOST_COLUMNS)
        return lg_fail(error, LG_FORMAT, "%s: has more than %d columns", r->shown, LG_TABLE_MOST_COLUMNS);
    if (strlen(name) >= LG_TABLE_NAME)
        return lg_fail(error, LG_FORMAT, "%s: the name of column %u has more than %d bytes", r->shown,
                       r->all.count + 1, LG_TABLE_NAME - 1);
    if (r->all.count == r->room) {
        const uint32_t room = r->room == 0 ? FIRST_NAMES : 2 * r->room;
        lg_table_text *wider = widened(r->context, r->all.name, r->all.count, room, sizeof *wider);
        if (wider == NULL) return lg_table_no_memory(r, error);
        r->all.name = wider;
        r->room = room;
    }
    char *to = r->all.name[r->all.count++];
    (void)snprintf(to, LG_TABLE_NAME, "%s", name);
    return LG_OK;
}

static lg_status missing_column(const lg_table_reading *r, const char *name, lg_error *error) {
    lg_csv_names have = {.used = 0};
    char quoted[LG_TABLE_QUOTED];
    for (uint32_t i = 0; i < r->all.count; i++)
        lg_csv_add_name(&have, lg_table_quote(r->all.name[i], quoted));
    return lg_fail(error, LG_FORMAT, "%s: there is no column '%s'; the columns are: %s", r->shown, name,
                   have.text);
}

/* Finds the column with this name. `sorted` has the names of the file. */
static lg_status find_column(const lg_table_reading *r, const lg_lookup *sorted, const char *name,
                             uint32_t *at, lg_error *error) {
    const lg_lookup *found = lg_lookup_find(sorted, r->all.count, name);
    if (found == NULL) return missing_column(r, name, error);
    if (found + 1 < sorted + r->all.count && strcmp(found[1].name, name) == 0)
        return lg_fail(error, LG_FORMAT, "%s: column '%s' is there twice", r->shown, name);
    *at = (uint32_t)found->at;
    return LG_OK;
}

static lg_status find_all(lg_table_reading *r, lg_lookup *sorted, lg_error *error) {
    for (uint32_t i = 0; i < r->all.count; i++) sorted[i] = (lg_lookup){r->all.name[i], i};
    lg_lookup_sort(sorted, r->all.count);
    for (uint32_t i = 0; i < r->count; i++) {
        uint32_t at = 0;
        LG_TRY(find_column(r, sorted, r->names[i], &at, error));
        if (r->to[at] > 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "%s: column '%s' is requested twice", r->shown,
                           r->names[i]);
        r->to[at] = i + 1;
    }
    return r->class_column == NULL ? LG_OK : find_column(r, sorted, r->class_column, &r->class_at, error);
}

lg_status lg_table_find_columns(lg_table_reading *r, lg_error *error) {
    if (lg_table_names_only(r)) return LG_OK;
    r->class_at = UINT32_MAX;
    r->out.columns = r->count;
    r->to = lg_alloc(r->context, (size_t)r->all.count + 1, sizeof *r->to);
    lg_lookup *sorted = lg_alloc(r->context, (size_t)r->all.count + 1, sizeof *sorted);
    const lg_status status =
        r->to == NULL || sorted == NULL ? lg_table_no_memory(r, error) : find_all(r, sorted, error);
    lg_free(r->context, sorted);
    return status;
}

/* ---- rows ---- */

static lg_status widen_rows(lg_table_reading *r, size_t room, lg_error *error) {
    lg_table_data *out = &r->out;
    const size_t columns = out->columns > 0 ? out->columns : 1;
    if (room > SIZE_MAX / sizeof(double) / columns) return lg_table_no_memory(r, error);
    double *values = widened(r->context, out->values, out->rows * columns, room * columns, sizeof *values);
    if (values == NULL) return lg_table_no_memory(r, error);
    out->values = values;
    size_t *line = widened(r->context, out->line, out->rows, room, sizeof *line);
    if (line == NULL) return lg_table_no_memory(r, error);
    out->line = line;
    if (r->class_column != NULL) {
        lg_table_text *text = widened(r->context, r->label_text, out->rows, room, sizeof *text);
        if (text == NULL) return lg_table_no_memory(r, error);
        r->label_text = text;
    }
    r->row_room = room;
    return LG_OK;
}

lg_status lg_table_make_rows(lg_table_reading *r, uint64_t rows, lg_error *error) {
    if (rows == 0) return lg_fail(error, LG_FORMAT, "%s: has no rows", r->shown);
    if (rows > UINT32_MAX) return lg_fail(error, LG_FORMAT, "%s: has 2^32 rows or more", r->shown);
    LG_TRY(widen_rows(r, (size_t)rows, error));
    r->out.rows = (size_t)rows;
    for (size_t i = 0; i < r->out.rows; i++) r->out.line[i] = i + 1;
    return LG_OK;
}

lg_status lg_table_add_row(lg_table_reading *r, size_t line, double **values, lg_error *error) {
    if (r->out.rows == r->row_room)
        LG_TRY(widen_rows(r, r->row_room == 0 ? 1 + FIRST_NUMBERS / (r->out.columns + 1) : 2 * r->row_room,
                          error));
    if (r->out.rows == UINT32_MAX) return lg_fail(error, LG_FORMAT, "%s: has 2^32 rows or more", r->shown);
    r->out.line[r->out.rows] = line;
    *values = r->out.values + r->out.rows++ * r->out.columns;
    return LG_OK;
}

/* ---- numbers and classes ---- */

lg_status lg_table_set_label(lg_table_reading *r, size_t row, const char *text, lg_error *error) {
    if (strlen(text) >= LG_TABLE_NAME)
        return lg_fail(error, LG_FORMAT, "%s: %s %zu: column %s: the class has more than %d bytes", r->shown,
                       r->out.place, r->out.line[row], r->class_column, LG_TABLE_NAME - 1);
    (void)snprintf(r->label_text[row], LG_TABLE_NAME, "%s", text);
    return LG_OK;
}

static lg_status bad_number(const lg_table_reading *r, size_t row, uint32_t column, const char *text,
                            const char *what, lg_error *error) {
    return lg_fail(error, LG_FORMAT, "%s: row %zu: column %s: %s%s", r->shown, row + 1, r->all.name[column],
                   text, what);
}

lg_status lg_table_set_number(lg_table_reading *r, size_t row, uint32_t column, char type, const void *number,
                              lg_error *error) {
    char text[LG_SHORTEST] = "";
    const bool label = column == r->class_at, whole = type == 'i' || type == 'u';
    double value;
    uint64_t bits;
    if (!label && r->to[column] == 0) return LG_OK;
    memcpy(&value, number, sizeof value);
    memcpy(&bits, number, sizeof bits);
    const bool minus = type == 'i' && bits >> 63 != 0;
    const uint64_t magnitude = minus ? ~bits + 1 : bits;
    if (whole) value = minus ? -(double)magnitude : (double)magnitude;
    if (isinf(value))
        return bad_number(r, row, column, "is infinite; write nan for a missing value", "", error);
    if (whole)
        (void)snprintf(text, sizeof text, "%s%llu", minus ? "-" : "", (unsigned long long)magnitude);
    else if (label && !isnan(value))
        lg_format_shortest(text, value == 0.0 ? 0.0 : value, type == 'f');
    if (label) LG_TRY(lg_table_set_label(r, row, text, error));
    if (r->to[column] == 0) return LG_OK;
    if (whole && lg_whole_is_rounded(magnitude))
        return bad_number(r, row, column, text, " is beyond 2^53 and " LG_ROUNDED, error);
    r->out.values[row * r->out.columns + r->to[column] - 1] = value;
    return LG_OK;
}

/* Numbers come first, in rising order. */
static int compare_texts(const void *a, const void *b) {
    const char *x = a, *y = b;
    const bool p = lg_is_decimal(x), q = lg_is_decimal(y);
    const int order = p && q ? lg_decimal_compare(x, y) : (int)q - (int)p;
    return order != 0 ? order : strcmp(x, y);
}

/* Returns the position of the class, or the position where it would have to be inserted. */
static uint32_t place_of(const lg_table_data *out, const char *text, bool *known) {
    uint32_t low = 0, high = out->classes;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (compare_texts(out->class_name[middle], text) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    *known = low < out->classes && strcmp(out->class_name[low], text) == 0;
    return low;
}

/* Labels are texts as written, so 1 and 1.0 are two classes. That is told. */
static void warn_of_equals(const lg_table_reading *r) {
    const lg_table_data *out = &r->out;
    for (uint32_t c = 1; c < out->classes; c++) {
        const char *a = out->class_name[c - 1], *b = out->class_name[c];
        if (lg_is_decimal(a) && lg_is_decimal(b) && lg_decimal_compare(a, b) == 0)
            lg_log_message(r->context, LG_LOG_WARNING,
                           "%s: column %s: the classes '%s' and '%s' are the same number, written in two "
                           "ways; they stay two classes",
                           r->shown, r->class_column, a, b);
    }
}

static lg_status name_classes(lg_table_reading *r, lg_error *error) {
    lg_table_data *out = &r->out;
    bool known;
    if (r->class_column == NULL) return LG_OK;
    out->class_name = lg_alloc(r->context, LG_TABLE_MOST_CLASSES, sizeof *out->class_name);
    out->label = lg_alloc(r->context, out->rows, sizeof *out->label);
    if (out->class_name == NULL || out->label == NULL) return lg_table_no_memory(r, error);
    for (size_t i = 0; i < out->rows; i++) {
        const char *text = r->label_text[i];
        const uint32_t at = place_of(out, text, &known);
        if (known || *text == '\0') continue;
        if (out->classes == LG_TABLE_MOST_CLASSES)
            return lg_fail(error, LG_FORMAT,
                           "%s: column %s: has more than %d different values: it does not look like classes",
                           r->shown, r->class_column, LG_TABLE_MOST_CLASSES);
        memmove(out->class_name[at + 1], out->class_name[at], (out->classes - at) * sizeof *out->class_name);
        memcpy(out->class_name[at], text, sizeof *out->class_name);
        out->classes++;
    }
    for (size_t i = 0; i < out->rows; i++) {
        const uint32_t at = place_of(out, r->label_text[i], &known);
        out->label[i] = known ? at : LG_TABLE_NO_CLASS;
    }
    warn_of_equals(r);
    return LG_OK;
}

/* Hashes the numbers, then the labels. */
static void hash(lg_table_reading *r) {
    lg_sha256 state;
    lg_sha256_init(&state);
    lg_sha256_add_doubles(&state, r->out.values, r->out.rows * r->out.columns);
    for (size_t i = 0; r->class_column != NULL && i < r->out.rows; i++)
        lg_sha256_add(&state, r->label_text[i], strlen(r->label_text[i]) + 1);
    lg_sha256_finish(&state, r->out.sha256);
}

/* ---- complete rows ---- */

static bool is_complete(const lg_table_data *data, size_t row) {
    for (uint32_t c = 0; c < data->columns; c++)
        if (isnan(data->values[row * data->columns + c])) return false;
    return data->label == NULL || data->label[row] != LG_TABLE_NO_CLASS;
}

static bool are_complete(lg_table_data *const *tables, size_t count, size_t row) {
    bool all = true;
    for (size_t i = 0; i < count; i++) all = all && is_complete(tables[i], row);
    return all;
}

static void move_row(lg_table_data *data, size_t from, size_t to) {
    memmove(data->values + to * data->columns, data->values + from * data->columns,
            data->columns * sizeof *data->values);
    data->line[to] = data->line[from];
    if (data->label != NULL) data->label[to] = data->label[from];
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
        return lg_fail(error, LG_FORMAT, "all %zu rows have missing cells in the columns that are used",
                       rows);
    for (size_t row = 0; row < rows; row++) {
        if (!are_complete(tables, count, row)) continue;
        for (size_t i = 0; i < count; i++) move_row(tables[i], row, kept);
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

/* ---- public functions ---- */

static lg_status read_any(lg_table_reading *r, lg_error *error) {
    static const unsigned char npy[6] = {0x93, 'N', 'U', 'M', 'P', 'Y'};
    unsigned char first[sizeof npy] = {0};
    size_t got = 0;
    bool h5 = false;
    if (*r->path != '\0') LG_TRY(lg_file_is_h5(r->path, &h5, error));
    if (*r->path != '\0') LG_TRY(lg_read_first(r->path, first, sizeof first, &got, error));
    if (h5) return lg_table_read_h5(r, error);
    if (got >= sizeof npy && memcmp(first, npy, sizeof npy) == 0) return lg_table_read_npy(r, error);
    return lg_table_read_csv(r, error);
}

lg_status lg_table_names_read(const lg_context *context, const char *path, const lg_read_options *options,
                              lg_table_names *out, lg_error *error) {
    if (path == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the table's name or `out` is NULL");
    lg_table_reading r = {.context = context, .path = path, .shown = lg_shown_path(path), .options = options};
    lg_table_reset(&r);
    const lg_status status = read_any(&r, error);
    if (status == LG_OK) {
        *out = r.all;
        r.all = (lg_table_names){.count = 0};
    }
    lg_table_reset(&r);
    return status;
}

lg_status lg_table_read(const lg_context *context, const char *path, const char *const *names, uint32_t count,
                        const char *class_column, const lg_read_options *options, lg_table_data *out,
                        lg_error *error) {
    if (path == NULL || names == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the table's name, the names of columns or `out` is NULL");
    lg_table_reading r = {.context = context,
                          .path = path,
                          .shown = lg_shown_path(path),
                          .options = options,
                          .names = names,
                          .count = count,
                          .class_column = class_column};
    lg_table_reset(&r);
    lg_status status = read_any(&r, error);
    if (status == LG_OK && r.out.rows == 0)
        status = lg_fail(error, LG_FORMAT, "%s: has a header, but no rows", r.shown);
    if (status == LG_OK) status = name_classes(&r, error);
    if (status == LG_OK) {
        hash(&r);
        *out = r.out;
        r.out = (lg_table_data){.rows = 0};
    }
    lg_table_reset(&r);
    return status;
}

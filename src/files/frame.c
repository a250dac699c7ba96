/* Frames: what all formats share. Names, wanted columns, the block of rows, numbers and texts of cells. */
#include <math.h>

#include "core/lookup.h"
#include "files/csv.h"
#include "files/frame.h"
#include "files/h5.h"
#include "files/read_file.h"

#include "liegrad/settings.h"

enum { FIRST_NAMES = 16, FIRST_NUMBERS = 8192, FIRST_BYTES = 16 };

#define X(name) &lg_frame_##name,
static const lg_frame_format *const formats[] = {LG_FRAME_FORMATS};
#undef X

/* ---- messages ---- */

lg_status lg_frame_no_memory(const lg_frame *f, lg_error *error) {
    return lg_no_memory_for(f->shown, error);
}

lg_status lg_frame_fail(const lg_frame *f, size_t row, const char *column, lg_error *error,
                        const char *format, ...) {
    char text[sizeof error->message], line[32] = "";
    va_list arguments;
    const size_t number = column != NULL ? f->line[row] : f->header;
    va_start(arguments, format);
    (void)lg_format_list(text, sizeof text, format, arguments);
    va_end(arguments);
    if (number > 0) (void)snprintf(line, sizeof line, "%s %zu: ", f->place, number);
    return lg_fail(error, LG_FORMAT, "%s: %s%s%s%s%s", f->shown, line, column != NULL ? "column " : "",
                   column != NULL ? column : "", column != NULL ? ": " : "", text);
}

/* ---- names and wanted columns ---- */

lg_status lg_frame_add_name(lg_frame *f, const char *name, lg_error *error) {
    if (f->columns == LG_FRAME_MOST_COLUMNS)
        return lg_fail(error, LG_FORMAT, "%s: has more than %d columns: remove some", f->shown,
                       LG_FRAME_MOST_COLUMNS);
    if (f->columns == f->name_capacity) {
        const size_t capacity = f->name_capacity == 0 ? FIRST_NAMES : 2 * f->name_capacity;
        char **wider = lg_widen(f->context, f->name, f->columns, capacity, sizeof *wider);
        if (wider == NULL) return lg_frame_no_memory(f, error);
        f->name = wider;
        f->name_capacity = capacity;
    }
    f->name[f->columns] = lg_strdup(f->context, name);
    return f->name[f->columns] == NULL ? lg_frame_no_memory(f, error) : (f->columns++, LG_OK);
}

static lg_status missing_column(lg_frame *f, const char *name, lg_error *error) {
    lg_name_list have = {.used = 0};
    for (uint32_t i = 0; i < f->columns; i++) lg_name_list_add(&have, lg_csv_quote(f->name[i]).text);
    if (strcmp(f->place, "line") == 0 && (f->columns < 2 || *f->name[1] == '\0'))
        lg_name_list_add(&f->note,
                         "the first line must name the columns, separated by commas, semicolons or tabs");
    return lg_frame_fail(f, 0, NULL, error, "there is no column '%s'; the columns are: %s%s%s", name,
                         lg_tamed(have.text), f->note.used > 0 ? "; " : "", lg_tamed(f->note.text));
}

static lg_status find_want(lg_frame *f, const lg_lookup *sorted, lg_frame_want *want, lg_error *error) {
    const size_t index = (size_t)(want - f->want);
    uint32_t at = (uint32_t)index;
    if (!f->ours || index >= f->columns) {
        const lg_lookup *found = lg_lookup_find(sorted, f->columns, want->name);
        at = found == NULL ? f->columns : (uint32_t)found->at;
        if (found != NULL && found + 1 < sorted + f->columns && strcmp(found[1].name, want->name) == 0)
            return lg_frame_fail(f, 0, NULL, error, "there are two columns '%s': rename one of them",
                                 want->name);
    }
    want->there = at < f->columns;
    if (!want->there) return want->optional ? LG_OK : missing_column(f, want->name, error);
    lg_frame_use *use = &f->use[at];
    const bool text = want->as == LG_FRAME_TEXT || want->as == LG_FRAME_CELL;
    size_t *to = text ? &use->text : &use->value;
    if (*to > 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: column '%s' is requested twice: name it once",
                       f->shown, f->name[at]);
    want->first = text ? f->texts++ : f->width++;
    *to = 1 + want->first;
    want->clock = (lg_clock){.format = LG_TIME_NONE};
    if (want->as == LG_FRAME_TIME) use->clock = &want->clock;
    use->exact = want->as == LG_FRAME_CELL;
    if (!text) use->scale = want->scale != 0 ? want->scale : 1, use->complete = want->complete;
    return LG_OK;
}

/* The columns of the file are the first ones that are wanted, and no others. */
static lg_status check_order(const lg_frame *f, lg_error *error) {
    for (uint32_t i = 0; i < f->columns; i++)
        if (i == f->wants || strcmp(f->name[i], f->want[i].name) != 0)
            return lg_frame_fail(f, 0, NULL, error,
                                 "this is not the %s: column %u is '%s', expected: %s; write to another file",
                                 f->what, i + 1, lg_tamed(f->name[i]),
                                 i == f->wants ? "no further column" : f->want[i].name);
    return LG_OK;
}

lg_status lg_frame_find(lg_frame *f, lg_error *error) {
    LG_SCRATCH(lg_lookup, sorted, f->context, (size_t)f->columns + 1);
    f->use = lg_alloc(f->context, (size_t)f->columns + 1, sizeof *f->use);
    if (f->use == NULL || sorted == NULL) return lg_frame_no_memory(f, error);
    for (uint32_t i = 0; i < f->columns; i++) sorted[i] = (lg_lookup){f->name[i], i};
    lg_lookup_sort(sorted, f->columns);
    if (f->ours) LG_TRY(check_order(f, error));
    for (size_t i = 0; i < f->wants; i++) LG_TRY(find_want(f, sorted, &f->want[i], error));
    return LG_OK;
}

/* ---- the block ---- */

/* Widens one array of the block. */
static bool widen(const lg_frame *f, void **array, size_t capacity, size_t columns, size_t size) {
    void *wider =
        columns > SIZE_MAX / size ? NULL : lg_widen(f->context, *array, f->rows, capacity, columns * size);
    if (wider != NULL) *array = wider;
    return wider != NULL;
}

lg_status lg_frame_reserve(lg_frame *f, size_t rows, lg_error *error) {
    if (rows <= f->capacity && f->line != NULL) return LG_OK;
    if (f->before + rows > UINT32_MAX)
        return lg_fail(error, LG_FORMAT, "%s: has 2^32 rows or more: split it into several files", f->shown);
    const size_t twice = f->capacity == 0 ? 1 + FIRST_NUMBERS / (f->width + f->texts + 1) : 2 * f->capacity;
    const size_t capacity = rows > twice || rows > 1 + f->rows ? rows : twice;
    if (!widen(f, (void **)&f->value, capacity, f->width, sizeof *f->value) ||
        !widen(f, (void **)&f->text, capacity, f->texts, sizeof *f->text) ||
        !widen(f, (void **)&f->line, capacity, 1, sizeof *f->line))
        return lg_frame_no_memory(f, error);
    f->capacity = capacity;
    return LG_OK;
}

lg_status lg_frame_number_rows(lg_frame *f, size_t most, uint64_t left, lg_error *error) {
    const size_t rows = left < most ? (size_t)left : most;
    LG_TRY(lg_frame_reserve(f, rows, error));
    f->rows = rows;
    for (size_t i = 0; i < rows; i++) f->line[i] = f->before + i + 1;
    return LG_OK;
}

static lg_status fail_rounded(const lg_frame *f, size_t row, uint32_t column, const char *text,
                              lg_error *error) {
    return lg_frame_fail(f, row, f->name[column], error, "%s is beyond 2^53 and " LG_ROUNDED, text);
}

static lg_status put_text(lg_frame *f, size_t row, uint32_t column, const char *text, lg_error *error) {
    const size_t length = strlen(text);
    if (length >= LG_FRAME_NAME)
        return lg_frame_fail(f, row, f->name[column], error, "the text has more than %d bytes: shorten it",
                             LG_FRAME_NAME - 1);
    memcpy(f->text[row * f->texts + f->use[column].text - 1], text, length + 1);
    return LG_OK;
}

/* Puts a number into the block. */
static lg_status put_value(lg_frame *f, size_t row, uint32_t column, double value, lg_error *error) {
    const lg_frame_use *use = &f->use[column];
    if (use->complete && isnan(value))
        return lg_frame_fail(f, row, f->name[column], error,
                             "the value is missing: fill the cell, or remove the row");
    if (use->clock != NULL && lg_moment_is_packed(value * use->scale))
        return lg_frame_fail(f, row, f->name[column], error,
                             "%.17g is a date without separators: write dates as 2024-03-01T12:00:00, or "
                             "times in seconds",
                             value);
    value *= use->scale;
    if (isinf(value))
        return lg_frame_fail(f, row, f->name[column], error,
                             "the value is infinite when it is multiplied by its scale");
    f->value[row * f->width + use->value - 1] = value;
    return LG_OK;
}

static lg_status read_number(lg_frame *f, size_t row, uint32_t column, const char *cell, double *out,
                             lg_error *error) {
    static const char *const formats_of_times[] = {[LG_TIME_SECONDS] = "number of seconds",
                                                   [LG_TIME_DATE] = "date without an offset",
                                                   [LG_TIME_OFFSET] = "date with an offset",
                                                   [LG_TIME_OF_DAY] = "time of day"};
    char show[41];
    lg_moment now;
    lg_clock *clock = f->use[column].clock;
    *out = NAN;
    if (lg_csv_missing(cell)) return LG_OK;
    (void)snprintf(show, sizeof show, "%s", cell);
    const char *end = clock != NULL ? lg_moment_scan(cell, &now) : NULL;
    if (end != NULL && *end == '\0') {
        if (clock->format == LG_TIME_NONE) clock->line = f->line[row];
        *out = lg_clock_read(clock, now);
        if (now.format != clock->format)
            return lg_frame_fail(f, row, f->name[column], error,
                                 "'%s' is a %s, but %s %zu has a %s: write all times in one format", show,
                                 formats_of_times[now.format], f->place, clock->line,
                                 formats_of_times[clock->format]);
        if (now.format != LG_TIME_SECONDS && f->use[column].scale != 1)
            return lg_frame_fail(f, row, f->name[column], error,
                                 "'%s' is a %s, and these become seconds: remove the column's scale, %.6g",
                                 show, formats_of_times[now.format], f->use[column].scale);
        if (isfinite(*out)) return LG_OK;
    }
    const lg_status status = lg_number_parse(cell, out);
    if (status == LG_OK) return LG_OK;
    if (status == LG_UNSUPPORTED) return fail_rounded(f, row, column, show, error);
    const bool comma = strchr(cell, ',') != NULL;
    return lg_frame_fail(
        f, row, f->name[column], error, "'%s' is not a %snumber%s%s%s", lg_tamed(show),
        status == LG_NOT_FINITE ? "finite " : "",
        clock != NULL ? " of seconds, a date such as 2024-03-01T12:00:00.25Z or a time of day" : "",
        comma ? "; write decimals with a point" : lg_csv_empty(f->blanks),
        !comma && f->header > 0 && f->before + row == 0 ? ", and begin a line of units with #" : "");
}

lg_status lg_frame_put_cell(lg_frame *f, size_t row, uint32_t column, const char *text, bool quoted,
                            lg_error *error) {
    const lg_frame_use *use = &f->use[column];
    if (use->text > 0)
        LG_TRY(put_text(f, row, column, !quoted && !use->exact && lg_csv_missing(text) ? "" : text, error));
    double value;
    if (use->value == 0) return LG_OK;
    LG_TRY(read_number(f, row, column, text, &value, error));
    return put_value(f, row, column, value, error);
}

lg_status lg_frame_put_number(lg_frame *f, size_t row, uint32_t column, char type, const void *number,
                              lg_error *error) {
    char text[LG_SHORTEST] = "";
    const lg_frame_use *use = &f->use[column];
    const bool whole = type == 'i' || type == 'u';
    double value;
    uint64_t bits;
    memcpy(&value, number, sizeof value);
    memcpy(&bits, number, sizeof bits);
    const bool minus = type == 'i' && bits >> 63 != 0;
    const uint64_t magnitude = minus ? ~bits + 1 : bits;
    if (whole) value = minus ? -(double)magnitude : (double)magnitude;
    if (isinf(value))
        return lg_frame_fail(f, row, f->name[column], error,
                             "the value is infinite; for a missing value write nan");
    if (whole)
        (void)snprintf(text, sizeof text, "%s%llu", minus ? "-" : "", (unsigned long long)magnitude);
    else if (use->text > 0 && !isnan(value))
        lg_format_shortest(text, value == 0.0 ? 0.0 : value, type == 'f');
    if (use->text > 0) LG_TRY(put_text(f, row, column, text, error));
    if (use->value == 0) return LG_OK;
    if (whole && use->clock == NULL && lg_whole_is_rounded(magnitude))
        return fail_rounded(f, row, column, text, error);
    return put_value(f, row, column, value, error);
}

/* ---- the file ---- */

lg_status lg_frame_open(lg_frame *f, lg_error *error) {
    unsigned char first[FIRST_BYTES] = {0};
    size_t got = 0;
    bool is = false;
    f->shown = lg_shown_path(f->path);
    f->note = (lg_name_list){.used = 0};
    if (*f->path == '\0') return lg_fail(error, LG_INVALID_ARGUMENT, "a %s needs a name", f->what);
    LG_TRY(lg_read_first(f->path, first, sizeof first, &got, error));
    for (size_t i = 0; !is; i++) {
        f->format = formats[i];
        if (f->format->is == NULL) break;
        LG_TRY(f->format->is(f->path, first, got, &is, error));
    }
    f->place = f->format->place;
    return f->format->open(f, error);
}

lg_status lg_frame_next(lg_frame *f, size_t most, lg_error *error) {
    f->before += f->rows;
    f->rows = 0;
    if (f->value == NULL || f->text == NULL || f->line == NULL)
        f->capacity = 0; /* the caller kept an array */
    return f->format->rows(f, most, error);
}

void lg_frame_close(lg_frame *f) {
    if (f->format != NULL) f->format->close(f);
    for (uint32_t i = 0; i < f->columns; i++) lg_free(f->context, f->name[i]);
    LG_FREE_ALL(f->context, f->name, f->use, f->value, f->text, f->line);
    f->format = NULL, f->source = f->name = NULL, f->use = NULL;
    f->value = NULL, f->text = NULL, f->line = NULL;
    f->columns = 0, f->name_capacity = f->capacity = 0, f->width = f->texts = f->rows = f->before = 0;
}

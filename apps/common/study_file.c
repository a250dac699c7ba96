/* The CSV file of a study. */
#include "common/study.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

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

static lg_status parse_text(study_file *file, char *text, lg_error *error) {
    size_t number = 0;
    char header[512];
    header_of(file->plan, header, sizeof header);
    for (char *line = text, *end; (end = strchr(line, '\n')) != NULL; line = end + 1) {
        const char *protocol;
        study_row row;
        *end = '\0';
        number++;
        if (number == 1) {
            if (strcmp(line, header) == 0) continue;
            return app_error(error, LG_FORMAT,
                             "%s: line 1: this is not the table of a study; first line expected: %s",
                             file->path, header);
        }
        if (!parse_row(file->plan, line, &protocol, &row))
            return app_error(error, LG_FORMAT, "%s: line %zu: not a row of a study", file->path, number);
        if (strcmp(protocol, file->plan->protocol) != 0)
            return app_error(
                error, LG_FORMAT,
                "%s: line %zu: the row belongs to a study with other settings (protocol %s, not %s)",
                file->path, number, protocol, file->plan->protocol);
        keep(file, &row);
    }
    return LG_OK;
}

/* Returns the file's contents with a 0 at the end; NULL if it cannot be read. Freed with free. */
static char *read_whole(int fd, size_t *size) {
    struct stat information;
    if (fstat(fd, &information) != 0 || !S_ISREG(information.st_mode)) return NULL;
    char *text = app_alloc((size_t)information.st_size + 1, 1);
    ssize_t n = 1;
    for (*size = 0; *size < (size_t)information.st_size && n != 0;) {
        n = read(fd, text + *size, (size_t)information.st_size - *size);
        if (n > 0) *size += (size_t)n;
        if (n >= 0 || errno == EINTR) continue;
        free(text);
        return NULL;
    }
    return text;
}

/* ---- writing ---- */

/* Appends the whole text or nothing: if the disk is full, the part that was written is cut off again. */
static lg_status append(study_file *file, const char *text, lg_error *error) {
    const off_t before = lseek(file->fd, 0, SEEK_END);
    size_t left = strlen(text);
    int number = 0;
    for (const char *at = text; left > 0 && number == 0;) {
        const ssize_t n = write(file->fd, at, left);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) {
            number = n < 0 ? errno : ENOSPC;
        } else {
            at += n;
            left -= (size_t)n;
        }
    }
    if (number == 0 && fsync(file->fd) != 0) number = errno;
    if (number == 0) return LG_OK;
    if (before >= 0 && ftruncate(file->fd, before) != 0) number = errno;
    return app_error(error, LG_FILE, "%s: a row cannot be written: %s", file->path, strerror(number));
}

/* Reads the rows of the table, and cuts off an unfinished last row. */
static lg_status read_table(study_file *file, lg_error *error) {
    const char *path = file->path;
    size_t size = 0;
    APP_FREE char *text = read_whole(file->fd, &size);
    if (text == NULL) return app_error(error, LG_FILE, "%s: cannot be read", path);
    /* After a loss of power the last row may consist of zero bytes. */
    const size_t length = strlen(text);
    if (memchr(text + length, '\n', size - length) != NULL)
        return app_error(error, LG_FORMAT, "%s: this is not the table of a study", path);
    const char *last = strrchr(text, '\n');
    const size_t whole = last != NULL ? (size_t)(last - text) + 1 : 0;
    if (whole == 0 && size > 0)
        return app_error(error, LG_FORMAT, "%s: line 1: this is not the table of a study", path);
    LG_TRY(parse_text(file, text, error));
    if (whole < size && ftruncate(file->fd, (off_t)whole) != 0)
        return app_error(error, LG_FILE, "%s: the unfinished last row cannot be removed: %s", path,
                         strerror(errno));
    return LG_OK;
}

/* Writes a table without rows as a complete file. An appended header could be lost when the power fails, and
 * the file would then not be recognised as a table of a study. */
static lg_status begin_table(const char *path, const study_plan *plan, lg_error *error) {
    struct stat about;
    char header[512];
    header_of(plan, header, sizeof header);
    if (stat(path, &about) == 0 && about.st_size > 0) return LG_OK;
    APP_FREE char *first = app_format("%s\n", header);
    return lg_file_write(NULL, path, first, strlen(first), error);
}

lg_status study_file_open(const char *path, const study_plan *plan, study_file *out, lg_error *error) {
    LG_TRY(begin_table(path, plan, error));
    study_file file = {.path = path, .plan = plan, .fd = open(path, O_RDWR | O_APPEND | O_CLOEXEC)};
    if (file.fd < 0)
        return app_error(error, LG_FILE, "%s: cannot be opened for writing: %s", path, strerror(errno));
    const lg_status status = read_table(&file, error);
    if (status != LG_OK)
        study_file_close(&file);
    else
        *out = file;
    return status;
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

static char *row_text(const study_file *file, const study_row *row) {
    const study_plan *plan = file->plan;
    char number[STUDY_TEXT];
    app_file memory;
    app_file_begin(&memory, file->path);
    FILE *stream = memory.stream;
    for (uint32_t i = 0; i < plan->axis_count; i++)
        (void)fprintf(stream, "%s,", plan->axes[i].text[row->at[i]]);
    (void)fprintf(stream, "%u,%llu", row->repeat, (unsigned long long)row->seed);
    for (uint32_t i = 0; i < plan->measure_count; i++) {
        number_text(row->result[i], number);
        (void)fprintf(stream, ",%s", number);
    }
    (void)fprintf(stream, ",%llu,%s,%s\n", (unsigned long long)row->epochs, row->failed ? "failed" : "ok",
                  plan->protocol);
    (void)fclose(stream);
    return memory.text;
}

lg_status study_file_append(study_file *file, const study_row *row, lg_error *error) {
    APP_FREE char *text = row_text(file, row);
    LG_TRY(append(file, text, error));
    keep(file, row);
    return LG_OK;
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
    if (file->fd >= 0) (void)close(file->fd);
    free(file->rows);
    file->rows = NULL;
    file->fd = -1;
}

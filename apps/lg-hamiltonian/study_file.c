/* The CSV of a study. */
#include "lg-hamiltonian/study.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { COLUMNS = 15 };
static const char header[] =
    "integrator,substeps,N,M,eps,penalty,repeat,seed,loss,E1,E2,seconds,epochs,status,protocol";

/* ---- reading ---- */

static bool parse_u32(const char *text, uint32_t *out) {
    uint64_t value;
    if (!app_parse_size(text, &value) || value > UINT32_MAX) return false;
    *out = (uint32_t)value;
    return true;
}

/* An empty field is NaN. */
static bool parse_result(const char *text, double *out) {
    if (text[0] != '\0') return app_parse_real(text, out);
    *out = (double)NAN;
    return true;
}

static bool parse_row(char *line, const char **protocol, study_row *row) {
    char *field[COLUMNS], *at = line;
    size_t n = 0;
    for (; n < COLUMNS && at != NULL; n++) {
        field[n] = at;
        at = strchr(at, ',');
        if (at != NULL) *at++ = '\0';
    }
    if (n != COLUMNS || at != NULL) return false;
    row->failed = strcmp(field[13], "ok") != 0;
    *protocol = field[14];
    return (row->integrator = lg_scheme_find(field[0])) != NULL && parse_u32(field[1], &row->substeps) &&
           parse_u32(field[2], &row->n) && parse_u32(field[3], &row->m) &&
           app_parse_real(field[4], &row->eps) && app_parse_real(field[5], &row->penalty) &&
           parse_u32(field[6], &row->repeat) && app_parse_size(field[7], &row->seed) &&
           parse_result(field[8], &row->loss) && parse_result(field[9], &row->e1) &&
           parse_result(field[10], &row->e2) && parse_result(field[11], &row->seconds) &&
           app_parse_size(field[12], &row->epochs);
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
        if (!parse_row(line, &protocol, &row))
            return app_error(error, LG_FORMAT, "%s: line %zu: not a row of a study", file->path, number);
        if (strcmp(protocol, file->protocol) != 0)
            return app_error(
                error, LG_FORMAT,
                "%s: line %zu: the row belongs to a study with other settings (protocol %s, not %s)",
                file->path, number, protocol, file->protocol);
        keep(file, &row);
    }
    return LG_OK;
}

static char *read_whole(int fd, size_t *size) {
    struct stat information;
    if (fstat(fd, &information) != 0 || !S_ISREG(information.st_mode)) return NULL;
    char *text = app_alloc((size_t)information.st_size + 1, 1);
    *size = 0;
    while (*size < (size_t)information.st_size) {
        const ssize_t n = read(fd, text + *size, (size_t)information.st_size - *size);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) {
            free(text);
            return NULL;
        }
        if (n == 0) break;
        *size += (size_t)n;
    }
    return text;
}

/* ---- writing ---- */

/* All or nothing: what a full disk let through is cut off again. */
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

lg_status study_file_open(const char *path, const char *protocol, study_file *out, lg_error *error) {
    study_file file = {.path = path, .fd = open(path, O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666)};
    if (file.fd < 0)
        return app_error(error, LG_FILE, "%s: cannot be opened for writing: %s", path, strerror(errno));
    (void)snprintf(file.protocol, sizeof file.protocol, "%s", protocol);
    size_t size = 0;
    char *text = read_whole(file.fd, &size);
    lg_status status = LG_OK;
    if (text == NULL) {
        status = app_error(error, LG_FILE, "%s: cannot be read", path);
    } else if (strlen(text) != size) {
        status = app_error(error, LG_FORMAT, "%s: this is not the table of a study", path);
    } else {
        const char *last = strrchr(text, '\n');
        const size_t whole = last != NULL ? (size_t)(last - text) + 1 : 0;
        const bool unfinished_header = whole == 0 && strncmp(header, text, size) == 0;
        if (whole == 0 && !unfinished_header)
            status = app_error(error, LG_FORMAT, "%s: line 1: this is not the table of a study", path);
        if (status == LG_OK) status = parse_text(&file, text, error);
        if (status == LG_OK && whole < size && ftruncate(file.fd, (off_t)whole) != 0)
            status = app_error(error, LG_FILE, "%s: the unfinished last row cannot be removed: %s", path,
                               strerror(errno));
        if (status == LG_OK && whole == 0) {
            char *first = app_format("%s\n", header);
            status = append(&file, first, error);
            free(first);
        }
    }
    free(text);
    if (status != LG_OK)
        study_file_close(&file);
    else
        *out = file;
    return status;
}

/* The shortest of 15 and 17 digits that is read back as the same number; empty for what is not finite. */
static void put_number(FILE *stream, double value) {
    char text[40];
    if (!isfinite(value)) return;
    (void)snprintf(text, sizeof text, "%.15g", value);
    if (strtod(text, NULL) != value) (void)snprintf(text, sizeof text, "%.17g", value);
    (void)fputs(text, stream);
}

static char *row_text(const study_file *file, const study_row *row) {
    const double results[] = {row->loss, row->e1, row->e2, row->seconds};
    app_file memory;
    app_file_begin(&memory, file->path);
    FILE *stream = memory.stream;
    (void)fprintf(stream, "%s,%u,%u,%u,", row->integrator->name, row->substeps, row->n, row->m);
    put_number(stream, row->eps);
    (void)fputc(',', stream);
    put_number(stream, row->penalty);
    (void)fprintf(stream, ",%u,%llu", row->repeat, (unsigned long long)row->seed);
    for (size_t i = 0; i < LG_COUNT(results); i++) {
        (void)fputc(',', stream);
        put_number(stream, results[i]);
    }
    (void)fprintf(stream, ",%llu,%s,%s\n", (unsigned long long)row->epochs, row->failed ? "failed" : "ok",
                  file->protocol);
    (void)fclose(stream);
    return memory.text;
}

lg_status study_file_append(study_file *file, const study_row *row, lg_error *error) {
    char *text = row_text(file, row);
    const lg_status status = append(file, text, error);
    free(text);
    if (status == LG_OK) keep(file, row);
    return status;
}

const study_row *study_file_find(const study_file *file, const study_row *key) {
    for (size_t i = 0; i < file->count; i++) {
        const study_row *row = &file->rows[i];
        if (row->integrator == key->integrator && row->substeps == key->substeps && row->n == key->n &&
            row->m == key->m && row->eps == key->eps && row->penalty == key->penalty &&
            row->repeat == key->repeat)
            return row;
    }
    return NULL;
}

void study_file_close(study_file *file) {
    if (file->fd >= 0) (void)close(file->fd);
    free(file->rows);
    file->rows = NULL;
    file->fd = -1;
}

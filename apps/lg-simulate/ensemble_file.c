/* An ensemble, or a part of one, in HDF5. What people read: /t, /mean, /deviation, /least, /largest,
 * /quantiles, /events. What parts are merged from: /accumulators. */
#include "lg-simulate/ensemble.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double levels[] = {0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99};

/* ---- writing ---- */

/* Names joined by '|'. */
static lg_status put_names(const lg_archive_writer *to, const char *path, const column_name *names,
                           size_t count) {
    char *text = app_format("%s", "");
    for (size_t i = 0; i < count; i++) {
        char *longer = app_format("%s%s%s", text, i > 0 ? "|" : "", names[i]);
        free(text);
        text = longer;
    }
    const lg_status status = to->text(to->user, path, text);
    free(text);
    return status;
}

/* Arrays (rows, columns) of one number a cell, and the quantiles. */
static lg_status put_cells(const lg_archive_writer *to, const char *prefix, const lg_statistics *from,
                           size_t rows, size_t columns) {
    static const char *const names[] = {"mean", "deviation", "least", "largest"};
    const uint64_t dims[3] = {LG_COUNT(levels), rows, columns};
    double *values = app_alloc(LG_COUNT(levels) * rows * columns, sizeof *values);
    uint64_t *counts = app_alloc(rows * columns, sizeof *counts);
    lg_status status = LG_OK;
    for (size_t k = 0; k < LG_COUNT(names) && status == LG_OK; k++) {
        for (size_t i = 0; i < rows * columns; i++) {
            const lg_statistics_cell cell = lg_statistics_of(from, i / columns, i % columns);
            const double each[] = {cell.mean, cell.deviation, cell.least, cell.largest};
            values[i] = each[k];
            counts[i] = cell.count;
        }
        char *path = app_format("%s%s", prefix, names[k]);
        status = to->array(to->user, path, LG_ELEMENT_F64, 2, dims + 1, values);
        free(path);
    }
    for (size_t q = 0; q < LG_COUNT(levels); q++)
        for (size_t i = 0; i < rows * columns; i++)
            values[q * rows * columns + i] =
                lg_statistics_quantile(from, i / columns, i % columns, levels[q]);
    char *count_path = app_format("%scount", prefix), *path = app_format("%squantiles", prefix);
    if (status == LG_OK) status = to->array(to->user, count_path, LG_ELEMENT_U64, 2, dims + 1, counts);
    if (status == LG_OK) status = to->array(to->user, path, LG_ELEMENT_F64, 3, dims, values);
    free(count_path);
    free(path);
    free(values);
    free(counts);
    return status;
}

static lg_status put_numbers(const lg_archive_writer *to, const result *what) {
    const uint64_t numbers[] = {what->total,  what->first,    what->members, what->block,
                                what->steps,  what->rejected, what->points,  what->columns,
                                what->events, what->listed,   what->saved};
    const uint64_t dims[] = {LG_COUNT(numbers)}, statuses[] = {STATUSES}, listed[] = {what->listed, 2};
    uint64_t list[2 * LISTED];
    double t[LISTED];
    for (size_t i = 0; i < what->listed; i++) {
        list[2 * i] = what->failures[i].member;
        list[2 * i + 1] = what->failures[i].status;
        t[i] = what->failures[i].t;
    }
    lg_status status = to->array(to->user, "accumulators/numbers", LG_ELEMENT_U64, 1, dims, numbers);
    if (status == LG_OK)
        status = to->array(to->user, "failures/by_status", LG_ELEMENT_U64, 1, statuses, what->failed);
    if (status == LG_OK && what->listed > 0)
        status = to->array(to->user, "failures/member_and_status", LG_ELEMENT_U64, 2, listed, list);
    if (status == LG_OK && what->listed > 0)
        status = to->array(to->user, "failures/t", LG_ELEMENT_F64, 1, listed, t);
    return status;
}

static lg_status put_result(lg_file_writer *writer, const result *what) {
    const uint64_t points[] = {what->points}, level_count[] = {LG_COUNT(levels)};
    lg_archive_writer to, states, times;
    lg_status status = lg_file_writer_archive(writer, "", &to);
    if (status == LG_OK) status = lg_file_writer_archive(writer, "accumulators/states", &states);
    if (status == LG_OK) status = lg_file_writer_archive(writer, "accumulators/events", &times);
    if (status == LG_OK) status = to.text(to.user, "ensemble", what->what);
    if (status == LG_OK) status = put_names(&to, "columns", what->column, what->columns);
    if (status == LG_OK) status = to.array(to.user, "t", LG_ELEMENT_F64, 1, points, what->t);
    if (status == LG_OK) status = to.array(to.user, "levels", LG_ELEMENT_F64, 1, level_count, levels);
    if (status == LG_OK) status = put_cells(&to, "", what->states, what->points, what->columns);
    if (status == LG_OK) status = put_numbers(&to, what);
    if (status == LG_OK) status = lg_statistics_save(what->states, &states);
    if (status != LG_OK || what->events == 0) return status;
    status = put_names(&to, "events", what->event, what->events);
    if (status == LG_OK) status = put_cells(&to, "event_times/", what->times, 1, what->events);
    return status == LG_OK ? lg_statistics_save(what->times, &times) : status;
}

lg_status result_write(const app *self, const char *path, const result *what, const result_rows *rows,
                       lg_error *error) {
    lg_file_writer *writer = NULL;
    lg_provenance provenance = {.has_seed = true, .seed = self->seed};
    (void)snprintf(provenance.command, sizeof provenance.command, "%s", self->command_line);
    (void)lg_cpu_describe(provenance.cpu, sizeof provenance.cpu);
    lg_status status = lg_file_writer_create(self->context, path, "ensemble", &provenance, &writer, error);
    if (status != LG_OK) return status;
    if (rows != NULL)
        status = lg_file_writer_rows(writer, rows->parts, rows->count, what->points, rows->dim, error);
    if (status == LG_OK) {
        (void)put_result(writer, what);
        /* What failed in the archive sticks to the writer, and the commit says it. */
        status = lg_file_writer_commit(writer, error);
    }
    lg_file_writer_destroy(writer);
    return status;
}

/* ---- reading ---- */

static lg_status get_names(const lg_archive_reader *from, const char *path, size_t count, column_name **out) {
    const size_t size = (count + 1) * NAME_SIZE;
    char *text = app_alloc(size, 1), *rest = NULL;
    const lg_status status = from->text(from->user, path, text, size);
    *out = app_alloc(count, sizeof **out);
    size_t i = 0;
    for (char *name = strtok_r(text, "|", &rest); name != NULL && i < count;
         name = strtok_r(NULL, "|", &rest))
        (void)snprintf((*out)[i++], NAME_SIZE, "%s", name);
    free(text);
    return status == LG_OK && i < count ? LG_FORMAT : status;
}

static lg_status get_failures(const lg_archive_reader *from, result *out) {
    const uint64_t statuses[] = {STATUSES}, listed[] = {out->listed, 2};
    uint64_t list[2 * LISTED];
    double t[LISTED];
    lg_status status =
        from->array(from->user, "failures/by_status", LG_ELEMENT_U64, 1, statuses, out->failed);
    if (status != LG_OK || out->listed == 0) return status;
    status = from->array(from->user, "failures/member_and_status", LG_ELEMENT_U64, 2, listed, list);
    if (status == LG_OK) status = from->array(from->user, "failures/t", LG_ELEMENT_F64, 1, listed, t);
    for (size_t i = 0; i < out->listed; i++) out->failures[i] = (failure){list[2 * i], list[2 * i + 1], t[i]};
    return status;
}

static lg_status get_statistics(const app *self, lg_file_reader *reader, const char *prefix, size_t rows,
                                size_t columns, const bool *logarithmic, lg_statistics **out) {
    lg_archive_reader from;
    uint64_t dims[4] = {0};
    uint32_t rank = 0;
    lg_status status = lg_file_reader_archive(reader, prefix, &from);
    if (status == LG_OK) status = from.shape(from.user, "bins", &rank, dims);
    if (status == LG_OK && (rank != 3 || dims[2] < 3)) status = LG_FORMAT;
    if (status == LG_OK)
        status = lg_statistics_create(self->context, rows, columns, (size_t)dims[2] - 2, logarithmic, out);
    return status == LG_OK ? lg_statistics_load(*out, &from) : status;
}

/* No cell has more numbers than there are members. */
static bool fits_members(const lg_statistics *of, size_t rows, size_t columns, uint64_t members) {
    bool fits = true;
    for (size_t i = 0; i < rows * columns; i++)
        fits = fits && lg_statistics_of(of, i / columns, i % columns).count <= members;
    return fits;
}

/* The counts of a part fit each other, so that sums over parts have no more than all members. */
static bool check_counts(const result *what) {
    uint64_t left = what->members, failed = 0;
    for (size_t i = 0; i < STATUSES; i++) {
        if (what->failed[i] > left) return false;
        left -= what->failed[i];
        failed += what->failed[i];
    }
    if (what->listed > failed) return false;
    for (size_t i = 0; i < what->listed; i++) {
        const failure *f = &what->failures[i];
        if (f->member < what->first || f->member - what->first >= what->members || f->status >= STATUSES)
            return false;
    }
    return fits_members(what->states, what->points, what->columns, what->members) &&
           (what->events == 0 || fits_members(what->times, 1, what->events, what->members));
}

static lg_status get_result(const app *self, lg_file_reader *reader, result *out) {
    enum { NUMBERS = 11, LONGEST = 4096 };
    uint64_t numbers[NUMBERS] = {0};
    const uint64_t dims[] = {NUMBERS};
    lg_archive_reader from;
    lg_status status = lg_file_reader_archive(reader, "", &from);
    if (status == LG_OK)
        status = from.array(from.user, "accumulators/numbers", LG_ELEMENT_U64, 1, dims, numbers);
    if (status != LG_OK) return status;
    *out = (result){.total = numbers[0],
                    .first = numbers[1],
                    .members = numbers[2],
                    .block = numbers[3],
                    .steps = numbers[4],
                    .rejected = numbers[5],
                    .points = numbers[6],
                    .columns = numbers[7],
                    .events = numbers[8],
                    .listed = numbers[9],
                    .saved = numbers[10]};
    if (out->listed > LISTED || out->points < 1 || out->points > 100000000 || out->columns < 1 ||
        out->columns > 10000000 || out->events > LG_EVENTS_MAX || out->members > out->total ||
        out->block < 1 || out->first > out->total - out->members || out->saved > out->total ||
        (double)out->total > MEMBERS_MAX)
        return LG_CHECK_FAILED;
    const uint64_t points[] = {out->points};
    out->what = app_alloc(LONGEST, 1);
    out->t = app_alloc(out->points, sizeof *out->t);
    status = from.text(from.user, "ensemble", out->what, LONGEST);
    if (status == LG_OK) status = from.array(from.user, "t", LG_ELEMENT_F64, 1, points, out->t);
    if (status == LG_OK) status = get_names(&from, "columns", out->columns, &out->column);
    if (status == LG_OK) status = get_failures(&from, out);
    bool *logarithmic = app_alloc(out->columns, sizeof *logarithmic);
    for (size_t i = 0; status == LG_OK && i < out->columns; i++)
        logarithmic[i] = strncmp(out->column[i], "drift of ", 9) == 0;
    if (status == LG_OK)
        status = get_statistics(self, reader, "accumulators/states", out->points, out->columns, logarithmic,
                                &out->states);
    free(logarithmic);
    if (status == LG_OK && out->events > 0) {
        status = get_names(&from, "events", out->events, &out->event);
        if (status == LG_OK)
            status = get_statistics(self, reader, "accumulators/events", 1, out->events, NULL, &out->times);
    }
    return status == LG_OK && !check_counts(out) ? LG_CHECK_FAILED : status;
}

lg_status result_read(const app *self, const char *path, result *out, lg_error *error) {
    lg_file_reader *reader = NULL;
    lg_status status = lg_file_reader_create(self->context, path, "ensemble", NULL, &reader, error);
    *out = (result){.what = NULL};
    if (status != LG_OK) return status;
    status = get_result(self, reader, out);
    if (status != LG_OK) {
        const char *reason = lg_file_reader_message(reader);
        if (status == LG_CHECK_FAILED)
            reason = "is a damaged part of an ensemble: its counts contradict each other";
        if (reason == NULL || reason[0] == '\0') reason = "is not a part of an ensemble";
        if (status == LG_CHECK_FAILED) status = LG_FORMAT;
        (void)app_error(error, status, "%s: %s", path, reason);
        result_free(out);
    }
    lg_file_reader_destroy(reader);
    return status;
}

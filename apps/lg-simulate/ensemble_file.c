/* The statistics of an ensemble or of a part of it: how they are merged, and their HDF5 file. For people: /t,
 * /mean, /deviation, /least, /largest, /quantiles, /events. For merging parts: /accumulators. */
#include "common/train.h"
#include "core/stored.h"
#include "lg-simulate/ensemble.h"

#include <string.h>

void result_free(result *self) {
    lg_statistics_destroy(self->states);
    lg_statistics_destroy(self->times);
    *self = (result){.what = NULL};
}

const bool *result_logarithmic(const result *self) {
    bool *out = app_keep(self->columns, sizeof *out);
    for (size_t i = 0; i < self->columns; i++) out[i] = strncmp(self->column[i], "drift of ", 9) == 0;
    return out;
}

uint64_t result_failed(const result *self) {
    uint64_t sum = 0;
    for (size_t i = 0; i < STATUSES; i++) sum += self->failed[i];
    return sum;
}

void result_list(result *self, uint64_t member, uint64_t status, double t) {
    size_t at = 0;
    while (at < self->listed && self->who[at][0] < member) at++;
    if (at == LISTED) return;
    if (self->listed < LISTED) self->listed++;
    const size_t behind = self->listed - at - 1;
    memmove(self->who + at + 1, self->who + at, behind * sizeof *self->who);
    memmove(self->when + at + 1, self->when + at, behind * sizeof *self->when);
    self->who[at][0] = member;
    self->who[at][1] = status;
    self->when[at] = t;
}

lg_status result_merge(result *into, const result *from, lg_error *error) {
    if (strcmp(into->what, from->what) != 0)
        return lg_fail(error, LG_FORMAT, "it is a part of another ensemble: %.200s", from->what);
    lg_status status = lg_statistics_merge(into->states, from->states);
    if (status == LG_OK && into->times != NULL) status = lg_statistics_merge(into->times, from->times);
    if (status == LG_CHECK_FAILED || into->steps > UINT64_MAX - from->steps ||
        into->rejected > UINT64_MAX - from->rejected)
        return lg_fail(error, LG_FORMAT, "counts or sums overflow, so one of the parts is damaged");
    if (status != LG_OK)
        return lg_fail(error, LG_FORMAT, "its histograms have other cells or ranges than the other parts");
    into->members += from->members;
    into->steps += from->steps;
    into->rejected += from->rejected;
    into->left += from->left;
    into->lost += from->lost;
    for (size_t i = 0; i < STATUSES; i++) into->failed[i] += from->failed[i];
    for (size_t i = 0; i < from->listed; i++)
        result_list(into, from->who[i][0], from->who[i][1], from->when[i]);
    return LG_OK;
}

static const double levels[] = {0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99};

/* ---- writing: the writer remembers the first error, and the commit returns it ---- */

/* Writes the names as one text, separated by '|'. A backslash precedes '|' and backslashes in names. */
static void put_names(const lg_archive_writer *to, const char *path, const column_name *names, size_t count) {
    APP_CLEAN(lg_text_destroy) lg_text text = app_text();
    for (size_t i = 0; i < count; i++) {
        if (i > 0) lg_text_add(&text, "|");
        for (const char *at = names[i]; *at != '\0'; at++)
            lg_text_add(&text, "%s%c", *at == '|' || *at == '\\' ? "\\" : "", *at);
    }
    (void)to->text(to->user, path, text.data);
}

/* Writes arrays (rows, columns) with mean, deviation, least and largest of each cell, and the counts and
 * quantiles. */
static void put_cells(const lg_archive_writer *to, const char *prefix, const lg_statistics *from, size_t rows,
                      size_t columns) {
    static const char *const names[] = {"mean", "deviation", "least", "largest"};
    const size_t n = rows * columns;
    const uint64_t dims[3] = {LG_COUNT(levels), rows, columns};
    APP_FREE double *values = app_alloc(LG_COUNT(levels) * n, sizeof *values);
    APP_FREE uint64_t *counts = app_alloc(n, sizeof *counts);
    for (size_t k = 0; k < LG_COUNT(names); k++) {
        for (size_t i = 0; i < n; i++) {
            const lg_statistics_cell cell = lg_statistics_of(from, i / columns, i % columns);
            const double each[] = {cell.mean, cell.deviation, cell.least, cell.largest};
            values[i] = each[k];
            counts[i] = cell.count;
        }
        APP_FREE char *path = app_format("%s%s", prefix, names[k]);
        (void)to->array(to->user, path, LG_ELEMENT_F64, 2, dims + 1, values);
    }
    for (size_t q = 0; q < LG_COUNT(levels); q++)
        for (size_t i = 0; i < n; i++)
            values[q * n + i] = lg_statistics_quantile(from, i / columns, i % columns, levels[q]);
    APP_FREE char *count_path = app_format("%scount", prefix), *path = app_format("%squantiles", prefix);
    (void)to->array(to->user, count_path, LG_ELEMENT_U64, 2, dims + 1, counts);
    (void)to->array(to->user, path, LG_ELEMENT_F64, 3, dims, values);
}

enum { ARRAYS = 4 };

/* The arrays whose sizes `numbers` has. */
static void list_arrays(result *of, lg_stored out[ARRAYS]) {
    const lg_stored rows[ARRAYS] = {
        {"t", LG_ELEMENT_F64, 1, {of->points}, .data = of->t},
        {"failures/by_status", LG_ELEMENT_U64, 1, {STATUSES}, .data = of->failed},
        {"failures/member_and_status",
         LG_ELEMENT_U64,
         2,
         {of->listed, 2},
         .data = of->listed > 0 ? of->who : NULL},
        {"failures/t", LG_ELEMENT_F64, 1, {of->listed}, .data = of->listed > 0 ? of->when : NULL}};
    memcpy(out, rows, sizeof rows);
}

static lg_archive_writer archive_of(lg_file_writer *writer, const char *prefix) {
    lg_archive_writer to = {.user = NULL};
    (void)app_had_memory(lg_file_writer_archive(writer, prefix, &to));
    return to;
}

static void put_result(lg_file_writer *writer, result *what) {
    lg_stored arrays[ARRAYS];
    const uint64_t numbers[] = {LG_COUNT(what->numbers)}, level_count[] = {LG_COUNT(levels)};
    const lg_archive_writer to = archive_of(writer, ""), states = archive_of(writer, "accumulators/states"),
                            times = archive_of(writer, "accumulators/events");
    (void)to.text(to.user, "ensemble", what->what);
    put_names(&to, "columns", what->column, what->columns);
    (void)to.array(to.user, "accumulators/numbers", LG_ELEMENT_U64, 1, numbers, what->numbers);
    list_arrays(what, arrays);
    (void)lg_stored_save(&to, arrays, ARRAYS, NULL);
    (void)to.array(to.user, "levels", LG_ELEMENT_F64, 1, level_count, levels);
    put_cells(&to, "", what->states, what->points, what->columns);
    (void)app_had_memory(lg_statistics_save(what->states, &states));
    if (what->events == 0) return;
    put_names(&to, "events", what->event, what->events);
    put_cells(&to, "event_times/", what->times, 1, what->events);
    (void)app_had_memory(lg_statistics_save(what->times, &times));
}

lg_status result_write(const app *self, const char *path, result *what, const result_rows *rows,
                       lg_error *error) {
    APP_CLEAN(lg_file_writer_destroy_at) lg_file_writer *writer = NULL;
    const lg_provenance provenance = app_provenance(self, self->seed);
    LG_TRY(lg_file_writer_create(self->context, path, "ensemble", &provenance, &writer, error));
    if (rows != NULL)
        LG_TRY(lg_file_writer_rows(writer, rows->parts, rows->count, what->points, rows->dim, error));
    put_result(writer, what);
    return lg_file_writer_commit(writer, error);
}

/* ---- reading ---- */

static lg_status get_names(const lg_archive_reader *from, const char *path, size_t count, column_name **out) {
    const size_t size = 2 * (count + 1) * NAME_SIZE;
    APP_FREE char *text = app_alloc(size, 1);
    size_t i = 0, used = 0;
    LG_TRY(from->text(from->user, path, text, size));
    *out = app_keep(count, sizeof **out);
    for (const char *at = text; *at != '\0' && i < count; at++) {
        if (*at == '|') {
            i++, used = 0;
            continue;
        }
        if (*at == '\\' && (at[1] == '|' || at[1] == '\\')) at++;
        if (used + 1 < NAME_SIZE) (*out)[i][used++] = *at;
    }
    return i + (used > 0) < count ? LG_FORMAT : LG_OK;
}

static lg_status get_statistics(const app *self, lg_file_reader *reader, const char *prefix, size_t rows,
                                size_t columns, const bool *logarithmic, lg_statistics **out) {
    lg_archive_reader from;
    uint64_t dims[4] = {0};
    uint32_t rank = 0;
    LG_TRY(lg_file_reader_archive(reader, prefix, &from));
    LG_TRY(from.shape(from.user, "bins", &rank, dims));
    if (rank != 3 || dims[2] < 3) return LG_FORMAT;
    LG_TRY(lg_statistics_create(self->context, rows, columns, (size_t)dims[2] - 2, logarithmic, out));
    return lg_statistics_load(*out, &from);
}

/* Checks that the counts of a part are consistent, so that no sum over parts exceeds the number of members,
 * and that no cell has more numbers. */
static bool check_counts(const result *what) {
    uint64_t left = what->members, failed = 0;
    bool fits = true;
    for (size_t i = 0; i < STATUSES; i++) {
        if (what->failed[i] > left) return false;
        left -= what->failed[i];
        failed += what->failed[i];
    }
    if (what->listed > failed) return false;
    for (size_t i = 0; i < what->listed; i++) {
        const uint64_t member = what->who[i][0];
        if (member < what->first || member - what->first >= what->members || what->who[i][1] >= STATUSES)
            return false;
    }
    for (size_t i = 0, n = what->columns; i < what->points * n; i++)
        fits = fits && lg_statistics_of(what->states, i / n, i % n).count <= what->members;
    for (size_t i = 0; i < what->events; i++)
        fits = fits && lg_statistics_of(what->times, 0, i).count <= what->members;
    return fits;
}

static lg_status get_result(const app *self, lg_file_reader *reader, result *out) {
    enum { LONGEST = 4096 };
    const uint64_t dims[] = {LG_COUNT(out->numbers)};
    lg_stored arrays[ARRAYS];
    lg_archive_reader from;
    LG_TRY(lg_file_reader_archive(reader, "", &from));
    LG_TRY(from.array(from.user, "accumulators/numbers", LG_ELEMENT_U64, 1, dims, out->numbers));
    if (out->listed > LISTED || out->points < 1 || out->points > 100000000 || out->columns < 1 ||
        out->columns > 10000000 || out->events > LG_EVENTS_MAX || out->members > out->total ||
        out->block < 1 || out->first > out->total - out->members || out->saved > out->total ||
        (double)out->total > MEMBERS_MAX)
        return LG_CHECK_FAILED;
    out->what = app_keep(LONGEST, 1);
    out->t = app_keep(out->points, sizeof *out->t);
    LG_TRY(from.text(from.user, "ensemble", out->what, LONGEST));
    list_arrays(out, arrays);
    LG_TRY(lg_stored_load(&from, arrays, ARRAYS, NULL));
    LG_TRY(get_names(&from, "columns", out->columns, &out->column));
    LG_TRY(get_statistics(self, reader, "accumulators/states", out->points, out->columns,
                          result_logarithmic(out), &out->states));
    if (out->events > 0) {
        LG_TRY(get_names(&from, "events", out->events, &out->event));
        LG_TRY(get_statistics(self, reader, "accumulators/events", 1, out->events, NULL, &out->times));
    }
    return check_counts(out) ? LG_OK : LG_CHECK_FAILED;
}

lg_status result_read(const app *self, const char *path, result *out, lg_error *error) {
    lg_file_reader *reader = NULL;
    *out = (result){.what = NULL};
    LG_TRY(lg_file_reader_create(self->context, path, "ensemble", NULL, &reader, error));
    const lg_status status = get_result(self, reader, out);
    const char *reason = lg_file_reader_message(reader);
    if (status == LG_CHECK_FAILED)
        reason = "is a damaged part of an ensemble: its counts contradict each other";
    if (reason == NULL || reason[0] == '\0') reason = "is not a part of an ensemble";
    if (status != LG_OK) (void)lg_fail(error, status, "%s: %s", path, reason);
    lg_file_reader_destroy(reader);
    return status;
}

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "core/stored.h"

lg_status lg_as_format(lg_status status, lg_error *error) {
    if (status != LG_NOT_FOUND && status != LG_SHAPE && status != LG_INVALID_ARGUMENT) return status;
    if (error != NULL) error->status = LG_FORMAT;
    return LG_FORMAT;
}

static void *numbers_of(const lg_stored *row) {
    void *data = row->data;
    if (row->pointed) memcpy(&data, row->data, sizeof data);
    return data;
}

static uint64_t count_of(const lg_stored *row) {
    uint64_t count = 1;
    for (uint32_t i = 0; i < row->rank; i++)
        count = row->dims[i] > 0 && count > SIZE_MAX / sizeof(double) / row->dims[i] ? SIZE_MAX
                                                                                     : count * row->dims[i];
    return count;
}

static lg_status move_name(const lg_archive_writer *to, const lg_archive_reader *from, const lg_stored *row) {
    uint32_t *number = row->data, found;
    char text[32];
    if (to != NULL) return to->text(to->user, row->path, row->name(*number));
    const lg_status status = from->text(from->user, row->path, text, sizeof text);
    if (status != LG_OK && status != LG_SHAPE) return status;
    if (status == LG_SHAPE) text[0] = '\0'; /* too long for any name */
    LG_FIND_NAME(found, row->names, row->name, text);
    if (found == row->names) return LG_FORMAT;
    *number = found;
    return LG_OK;
}

static lg_status move_numbers(const lg_archive_writer *to, const lg_archive_reader *from,
                              const lg_stored *row) {
    void *data = numbers_of(row);
    return to != NULL ? to->array(to->user, row->path, row->type, row->rank, row->dims, data)
                      : from->array(from->user, row->path, row->type, row->rank, row->dims, data);
}

static lg_status move(const lg_archive_writer *to, const lg_archive_reader *from, const lg_stored *row,
                      lg_error *error) {
    const lg_status status = row->data == NULL   ? LG_OK
                             : row->name != NULL ? move_name(to, from, row)
                                                 : move_numbers(to, from, row);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, to != NULL ? "%s could not be saved: %s" : "%s: %s", row->path,
                   lg_status_sentence(status));
}

/* Returns `infinite` for a number that is not finite. */
static lg_status check_numbers(const lg_stored *row, lg_status infinite, lg_error *error) {
    const void *data = numbers_of(row);
    for (uint64_t i = 0; i < count_of(row); i++) {
        const double x = row->type == LG_ELEMENT_F64   ? ((const double *)data)[i]
                         : row->type == LG_ELEMENT_F32 ? (double)((const float *)data)[i]
                                                       : 0.0;
        if (!isfinite(x)) return lg_fail(error, infinite, "%s: entry %zu is %g", row->path, (size_t)i, x);
        if ((row->positive && !(x > 0)) || (row->not_negative && x < 0))
            return lg_fail(error, LG_FORMAT, "%s: entry %zu is %g, expected %s 0", row->path, (size_t)i, x,
                           row->positive ? "more than" : "at least");
    }
    return LG_OK;
}

lg_status lg_stored_save(const lg_archive_writer *to, const lg_stored *rows, size_t count, lg_error *error) {
    for (size_t i = 0; i < count; i++) LG_TRY(move(to, NULL, &rows[i], error));
    return LG_OK;
}

lg_status lg_stored_load(const lg_archive_reader *from, const lg_stored *rows, size_t count,
                         lg_error *error) {
    for (const lg_stored *row = rows; row < rows + count; row++) {
        LG_TRY(move(NULL, from, row, error));
        if ((row->finite || row->not_negative) && row->data != NULL)
            LG_TRY(check_numbers(row, LG_FORMAT, error));
    }
    return LG_OK;
}

/* One number against its saved value. */
static lg_status compare(const lg_archive_reader *from, const lg_stored *row, lg_error *error) {
    const bool real = row->type == LG_ELEMENT_F64;
    const uint64_t *whole = row->data;
    const double *x = row->data;
    uint64_t whole_then = 0;
    double x_then = 0;
    lg_stored then = *row;
    then.data = real ? (void *)&x_then : (void *)&whole_then;
    LG_TRY(lg_stored_load(from, &then, 1, error));
    if (real ? x_then == *x : whole_then == *whole) return LG_OK;
    if (real)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s was %.17g in the saved run and is %.17g in this one",
                       row->path, x_then, *x);
    return lg_fail(error, LG_INVALID_ARGUMENT,
                   "%s was %" PRIu64 " in the saved run and is %" PRIu64 " in this one", row->path,
                   whole_then, *whole);
}

lg_status lg_stored_compare(const lg_archive_reader *from, const lg_stored *rows, size_t count,
                            lg_error *error) {
    for (size_t i = 0; i < count; i++) LG_TRY(compare(from, &rows[i], error));
    return LG_OK;
}

static lg_status check_shape(const lg_archive_reader *from, const lg_stored *row, lg_error *error) {
    uint32_t rank = 0;
    uint64_t dims[4] = {0};
    lg_status status = from->shape(from->user, row->path, &rank, dims);
    if (status == LG_OK && (rank != row->rank || memcmp(dims, row->dims, rank * sizeof *dims) != 0))
        status = LG_FORMAT;
    return status == LG_OK ? LG_OK : lg_fail(error, status, "%s: %s", row->path, lg_status_sentence(status));
}

lg_status lg_stored_allocate(const lg_context *context, const lg_stored *row, lg_error *error) {
    void *made = lg_alloc(context, count_of(row), sizeof(double));
    if (made == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %s", row->path);
    memcpy(row->data, &made, sizeof made); /* sets the pointer, whatever its type */
    return LG_OK;
}

lg_status lg_stored_make(const lg_context *context, const lg_archive_reader *from, const lg_stored *rows,
                         size_t count, lg_error *error) {
    for (const lg_stored *row = rows; row < rows + count; row++) {
        if (row->data == NULL) continue;
        LG_TRY(check_shape(from, row, error));
        LG_TRY(lg_stored_allocate(context, row, error));
        LG_TRY(lg_as_format(lg_stored_load(from, row, 1, error), error));
        LG_TRY(check_numbers(row, LG_NOT_FINITE, error));
    }
    return LG_OK;
}

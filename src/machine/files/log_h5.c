/* Logs in HDF5: a data set of numbers for each column, all of one length. */
#include <math.h>
#include <string.h>

#include "files/h5_internal.h"
#include "machine/files/log_table.h"

typedef struct read_call {
    const lg_log_table *table;
    const char *shown;
    uint64_t rows;
    double *data; /* (columns, rows) */
} read_call;

static herr_t add_link(hid_t group, const char *name, const H5L_info_t *info, void *names) {
    (void)group, (void)info;
    lg_csv_add_name(names, name);
    return 0;
}

static lg_status missing_column(const read_call *call, lg_h5 *h5, const char *name, lg_error *error) {
    lg_csv_names have = {.used = 0};
    lg_h5_quiet quiet = lg_quiet_begin();
    (void)H5Literate(h5->file, H5_INDEX_NAME, H5_ITER_INC, NULL, add_link, &have);
    lg_quiet_end(quiet);
    return lg_fail(
        error, LG_FORMAT,
        "%s: there is no data set '%s', which the machine file names as a column; the file has: %s",
        call->shown, name, lg_tamed(have.text));
}

static lg_status check_shape(const read_call *call, lg_h5 *h5, const char *name, uint64_t *rows,
                             lg_error *error) {
    lg_h5_about about;
    const lg_status status = lg_h5_look(h5, name, sizeof(double), &about, error);
    if (status == LG_NOT_FOUND) return missing_column(call, h5, name, error);
    LG_TRY(status);
    if (about.kind != LG_H5_WHOLE && about.kind != LG_H5_REAL)
        return lg_fail(error, LG_FORMAT, "%s: /%s: does not hold numbers", call->shown, name);
    if (!lg_h5_is_vector(&about) && (about.rank < 1 || about.count != 1))
        return lg_fail(error, LG_FORMAT, "%s: /%s: expected one number per row", call->shown, name);
    *rows = about.count;
    return LG_OK;
}

typedef struct copying {
    double *to;
    uint64_t width; /* numbers per row of the data set: all, if it is (1, rows) */
} copying;

static void copy_rows(void *user, uint64_t row, uint64_t rows, const double *values) {
    const copying *copy = user;
    memcpy(copy->to + row, values, (size_t)(rows * copy->width) * sizeof *values);
}

static lg_status read_columns(void *user, lg_h5 *h5, lg_error *error) {
    read_call *call = user;
    const lg_machine_file *machine = call->table->machine;
    for (uint32_t i = 0; i < machine->column_count; i++) {
        uint64_t rows = 0;
        const char *name = machine->columns[i].name;
        LG_TRY(check_shape(call, h5, name, &rows, error));
        if (i > 0 && rows != call->rows)
            return lg_fail(error, LG_FORMAT, "%s: /%s: has %llu rows, but /%s has %llu", call->shown, name,
                           (unsigned long long)rows, machine->columns[0].name,
                           (unsigned long long)call->rows);
        call->rows = rows;
    }
    lg_free(call->table->context, call->data);
    call->data = lg_alloc(call->table->context, call->rows, machine->column_count * sizeof(double));
    if (call->data == NULL) return lg_log_no_memory(call->shown, error);
    for (uint32_t i = 0; i < machine->column_count; i++) {
        lg_h5_about about;
        LG_TRY(lg_h5_look(h5, machine->columns[i].name, sizeof(double), &about, error));
        copying copy = {call->data + i * (size_t)call->rows,
                        about.dims[0] > 0 ? about.count / about.dims[0] : 1};
        LG_TRY(lg_h5_each_rows(h5, machine->columns[i].name, i == machine->time ? LG_H5_ROUNDED : LG_H5_EXACT,
                               copy_rows, &copy, error));
    }
    return LG_OK;
}

static lg_status append_rows(lg_log_table *table, uint32_t file, const read_call *call, lg_error *error) {
    const lg_machine_file *machine = table->machine;
    const size_t rows = (size_t)call->rows;
    double values[LG_LOG_COLUMNS], run = NAN;
    for (size_t row = 0; row < rows; row++) {
        for (uint32_t i = 0; i < machine->column_count; i++) values[i] = call->data[i * rows + row];
        bool new_run = row == 0;
        if (machine->run < machine->column_count) {
            const double now = values[machine->run];
            if (!isfinite(now))
                return lg_fail(error, LG_FORMAT, "%s: /%s: row %zu has no number of its run", call->shown,
                               machine->columns[machine->run].name, row + 1);
            new_run = new_run || now != run;
            run = now;
            values[machine->run] = 0;
        }
        LG_TRY(lg_log_append(table, file, row + 1, values, new_run, error));
    }
    return LG_OK;
}

lg_status lg_log_read_h5(lg_log_table *table, uint32_t file, lg_error *error) {
    const char *path = table->paths[file];
    read_call call = {.table = table, .shown = lg_shown_path(path)};
    lg_status status = lg_h5_read(table->context, path, table->options, read_columns, &call, error);
    if (status == LG_OK) status = append_rows(table, file, &call, error);
    lg_free(table->context, call.data);
    return status;
}

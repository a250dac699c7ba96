/* Logs on their way into lg_logs. log_csv.c and log_h5.c fill a table with the columns of the machine file;
 * log_jumps.c tells outliers, logs.c cuts it into parts, log_clean.c mends attitudes and angles, log_check.c
 * compares positions with velocities, log_statistics.c has noise and splines. */
#ifndef LG_LOG_TABLE_H
#define LG_LOG_TABLE_H

#include "files/csv.h"
#include "liegrad/logs.h"

typedef struct lg_log_origin {
    size_t line; /* of a CSV file; of HDF5 the row, from 1 */
    uint32_t file, run;
} lg_log_origin;

typedef struct lg_log_table {
    const lg_context *context;
    const lg_machine_file *machine;
    const char *const *paths;
    uint32_t files;
    const lg_read_options *options;
    size_t rows, room;
    uint32_t columns, runs; /* columns: those of the machine file, in its order; the run's is 0 */
    double *data;           /* (rows, columns), scaled; NaN: missing. The time is always there */
    lg_log_origin *origin;  /* (rows) */
    size_t rows_read;       /* with those that have no time */
    size_t *first;          /* (parts + 1) rows, once they are known */
    size_t parts, gaps;
    lg_logs *out;
} lg_log_table;

static inline double *lg_log_row(const lg_log_table *table, size_t row) {
    return table->data + row * table->columns;
}

static inline double lg_log_time(const lg_log_table *table, size_t row) {
    return lg_log_row(table, row)[table->machine->time];
}

/* "FILE: line 7: ..." with LG_FORMAT */
lg_status lg_log_fail(const lg_log_table *table, size_t row, lg_error *error, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
lg_status lg_log_no_memory(const char *path, lg_error *error);
/* Adds a sentence. LG_OUT_OF_MEMORY. */
lg_status lg_log_warn(lg_log_table *table, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* The same of a row: "FILE: line 7: ..." */
lg_status lg_log_warn_at(lg_log_table *table, size_t row, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* Values (columns) as in the file. A row without a time is counted and left out. */
lg_status lg_log_append(lg_log_table *table, uint32_t file, size_t line, const double *values, bool new_run,
                        lg_error *error);
/* Names of columns that follow each other. */
void lg_log_names_of(const lg_log_table *table, uint32_t first, uint32_t count, lg_csv_names *names);

/* Reads all files; which are HDF5 their first bytes say. */
lg_status lg_log_read_files(lg_log_table *table, size_t count, lg_error *error);
/* Append the rows of one file. */
lg_status lg_log_read_csv(lg_log_table *table, uint32_t file, lg_error *error);
lg_status lg_log_read_h5(lg_log_table *table, uint32_t file, lg_error *error);

/* Of each file and column, refuses values so large that the others are lost in their rounding, and
 * tells those that jump far from all others and back within two rows. */
lg_status lg_log_judge_jumps(lg_log_table *table, lg_error *error);

/* ---- after the parts are known ---- */

/* Normalises attitudes, makes them continuous, unwraps angles, turns velocities of poses into the body and
 * those of directions to be orthogonal. In place, matrices and quaternions stay what they are. */
lg_status lg_log_clean(lg_log_table *table, lg_error *error);
/* Compares positions with velocities. */
lg_status lg_log_check(lg_log_table *table, lg_error *error);

/* R (row-major) of 4 (w, x, y, z) or 9 numbers. */
void lg_log_rotation(const double *numbers, uint32_t count, double R[9]);

/* Standard deviation of the noise of a column; NaN: too few rows. */
lg_status lg_log_noise(const lg_log_table *table, uint32_t column, double *noise, bool *at_most);
/* Cubic spline, not-a-knot, through n >= 4 points: coefficients (4) of each interval at out[i * stride + k *
 * step], k = 0..3, in s of [0, 1]. `work` (3 n). */
void lg_log_spline(size_t n, const double *t, const double *y, size_t y_stride, double *work, double *out,
                   size_t stride, size_t step);

#endif

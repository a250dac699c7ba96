/* The table through which logs are read into lg_logs. log_table.c fills it with the columns of the
 * machine's file, logs.c cuts it into parts, log_clean.c mends attitudes and angles, log_outliers.c
 * leaves out or warns of values far from all others, log_check.c compares positions with velocities,
 * log_statistics.c has ranges, noise and splines. */
#ifndef LG_LOG_TABLE_H
#define LG_LOG_TABLE_H

#include "core/clean.h"
#include "core/text.h"
#include "liegrad/machine.h"

enum { LG_LOG_SAMPLES = 50000 };

typedef struct lg_log_origin {
    size_t line; /* line of a text file, or number of the row, from 1 */
    uint32_t file, run;
} lg_log_origin;

typedef struct lg_log_table {
    const lg_context *context;
    const lg_machine_file *machine;
    const char *const *paths;
    const char **place; /* (files) what the lines of a file's rows count: "line" or "row" */
    uint32_t files;
    const lg_log_options *options;
    lg_error *error;
    bool failed; /* memory ran out for a warning */
    size_t rows, room;
    /* `columns`: the columns of the machine's file, in its order. The column of the run is 0 in all rows. */
    uint32_t columns;
    double *data;          /* (rows, columns), scaled; NaN: missing. The time is never missing */
    lg_log_origin *origin; /* (rows) */
    lg_text names;         /* lg_logs.run_names */
    size_t *first;         /* (parts + 1) first rows of the parts, once they are cut */
    size_t parts;
    lg_logs *out;
} lg_log_table;

static inline double *lg_log_row(const lg_log_table *table, size_t row) {
    return table->data + row * table->columns;
}

static inline double lg_log_time(const lg_log_table *table, size_t row) {
    return lg_log_row(table, row)[table->machine->time];
}

static inline bool lg_log_is_value(const lg_log_table *table, uint32_t column) {
    return column != table->machine->time && column != table->machine->run;
}

lg_status lg_log_no_memory(const lg_log_table *table);
/* Adds a warning. */
void lg_log_warn(lg_log_table *table, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* Add a warning, or fail with LG_FORMAT and a message, that begins with "FILE: line 7: " of the row. */
#define LG_LOG_WARN_AT(table, row, format, ...)                                                              \
    lg_log_warn(table, "%s: %s %zu: " format, LG_LOG_PLACE(table, row), __VA_ARGS__)
#define LG_LOG_FAIL(table, row, format, ...)                                                                 \
    lg_fail((table)->error, LG_FORMAT, "%s: %s %zu: " format, LG_LOG_PLACE(table, row), __VA_ARGS__)
#define LG_LOG_PLACE(table, row)                                                                             \
    lg_shown_path((table)->paths[(table)->origin[row].file]), (table)->place[(table)->origin[row].file],     \
        (table)->origin[row].line
/* Lists the names of columns first .. first + count - 1. */
void lg_log_names_of(const lg_log_table *table, uint32_t first, uint32_t count, lg_name_list *names);

/* Reads all files. */
lg_status lg_log_read_files(lg_log_table *table);

/* For each file and column, refuses values so large that the other values are lost in rounding, and warns of
 * values that jump far from all others and come back within two rows. */
lg_status lg_log_compare_with_range(lg_log_table *table);
/* The first row of the next file. */
size_t lg_log_file_end(const lg_log_table *table, size_t first);

/* ---- after the table is cut into parts ---- */

/* Normalises attitudes, makes quaternions continuous, unwraps angles, turns velocities of poses into the
 * body, and makes velocities of directions orthogonal to them. Changes the table in place; matrices stay
 * matrices, and quaternions stay quaternions. */
lg_status lg_log_clean(lg_log_table *table);
/* Leaves out outliers of positions of lines and angles and of velocities, with a warning for each column. */
lg_status lg_log_leave_out_outliers(lg_log_table *table);
/* Compares positions with velocities; refuses or warns of columns that do not belong together. */
lg_status lg_log_check(lg_log_table *table);

/* R (row-major) from 4 numbers (w, x, y, z) or 9 numbers. */
void lg_log_rotation(const double *numbers, uint32_t count, double R[9]);

/* Measures the smallest and the largest value of a column. */
void lg_log_range(const lg_log_table *table, uint32_t column);
/* Sorts values of rows first .. end - 1 of a column, at even distances, into `work` (LG_LOG_SAMPLES
 * numbers), and returns how many there are. */
size_t lg_log_sample(const lg_log_table *table, uint32_t column, size_t first, size_t end, double *work);
/* The smallest difference of two values in rows first .. end - 1 of a column. Both are false for a steady
 * motion, which has equal steps, too, but each value only once. */
typedef struct lg_log_steps {
    double least;
    bool coarse; /* a quarter of the values between the smallest and the largest repeats others */
    bool exact;  /* at least half of the values repeat others, and all are multiples of the step */
} lg_log_steps;
lg_log_steps lg_log_steps_of(const lg_log_table *table, uint32_t column, size_t first, size_t end,
                             double *work);
/* Finds the noise of all columns with values. */
lg_status lg_log_find_noise(const lg_log_table *table);
/* How one of `inputs` inputs acts between n rows, from its values y: coefficient k = 0..3 of interval i, in
 * powers of s in [0, 1], goes to u[(4 i + k) inputs]. Cubic: the spline through all values, not-a-knot. The
 * last row, in which the value may be missing, has no interval. `work` has 3 n numbers. */
void lg_log_act(lg_input_hold hold, size_t n, const double *t, const double *y, size_t stride, size_t inputs,
                double *work, double *u);

#endif

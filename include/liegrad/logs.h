/* What a machine's YAML file says, and logs of machines: CSV or HDF5 in, rows of lg_machine_log out. The
 * guide is docs/machines.md. Library liegrad_io. */
#ifndef LIEGRAD_LOGS_H
#define LIEGRAD_LOGS_H

#include "liegrad/io.h"
#include "liegrad/machine.h"

LG_BEGIN_DECLS

#define LG_LOG_NAME    64 /* bytes of a column's name */
#define LG_LOG_COLUMNS (LG_MACHINE_POSITIONS + LG_MACHINE_VELOCITIES + LG_MACHINE_INPUTS + 2)

/* ---- the machine file ---- */

typedef enum lg_log_role {
    LG_LOG_TIME,
    LG_LOG_RUN,
    LG_LOG_POSITION,
    LG_LOG_VELOCITY, /* or momentum */
    LG_LOG_INPUT
} lg_log_role;

typedef struct lg_log_column {
    char name[LG_LOG_NAME]; /* in the log */
    lg_log_role role;
    uint32_t index; /* of the coordinate, or of the input */
    double scale;   /* numbers of the file are multiplied by it */
    double noise;   /* standard deviation, after scaling; 0: not given */
} lg_log_column;

/* Where a coordinate's columns stand. */
typedef struct lg_log_coordinate {
    uint32_t place, places;        /* first column and how many: 1 of a line or angle, 3 of a pose, else 0 */
    uint32_t attitude, attitudes;  /* 3 of a direction; 4 (w, x, y, z) or 9 (row-major) of a rotation, pose */
    uint32_t velocity, velocities; /* of a pose 3 velocities, then 3 rates; 0: positions alone */
    bool space_frame;              /* the velocities of a pose are x' in space */
} lg_log_coordinate;

typedef enum lg_log_measured {
    LG_MEASURED_VELOCITIES,
    LG_MEASURED_MOMENTA,
    LG_MEASURED_POSITIONS
} lg_log_measured;
typedef enum lg_input_hold { LG_HOLD_ZERO, LG_HOLD_LINEAR, LG_HOLD_CUBIC } lg_input_hold;
#define LG_LOG_MEASURED_COUNT 3
#define LG_INPUT_HOLD_COUNT   3

typedef struct lg_machine_file {
    lg_machine machine; /* lg_machine_init has been called, with scales of 1 */
    lg_log_measured measured;
    lg_input_hold hold;
    uint32_t delay;                   /* rows by which inputs act later than they are logged */
    bool estimate_delay;              /* `delay: estimate`; delay is 0 */
    bool unwrap;                      /* jumps of angles by more than pi are turns; the default */
    double max_step;                  /* seconds; 0: 1.4 medians */
    uint32_t column_count, time, run; /* run: column_count when there is none */
    lg_log_column columns[LG_LOG_COLUMNS];
    lg_log_coordinate coordinates[LG_MACHINE_COORDINATES];
    char *text; /* the exact text of the file, terminated; owned */
    size_t text_bytes;
    const lg_context *context;
} lg_machine_file;

/* Errors: as for scenes, with the line; LG_UNSUPPORTED for `system:`; what lg_machine_init refuses. */
LG_API lg_status lg_machine_file_read(const lg_context *context, const char *path, lg_machine_file *out,
                                      lg_error *error);
/* The same from memory; `name` stands for the file in sentences. */
LG_API lg_status lg_machine_file_parse(const lg_context *context, const char *name, const char *text,
                                       size_t bytes, lg_machine_file *out, lg_error *error);
LG_API void lg_machine_file_destroy(lg_machine_file *file); /* NULL or zeros are fine */

/* ---- logs ---- */

typedef struct lg_log_options {
    size_t size; /* sizeof(lg_log_options) */
    lg_read_options read;
    int64_t delay;    /* rows; < 0: the machine file's */
    bool consistency; /* positions are compared with velocities; default true */
} lg_log_options;
LG_API void lg_log_options_init(lg_log_options *options);

typedef struct lg_log_statistics {
    double low, high; /* as in the log, after scaling; NaN: all values are missing */
    size_t missing;   /* rows without it */
    /* Estimated standard deviation; of coarse positions and velocities at least step/sqrt(12). NaN: too few
     * rows. */
    double noise;
    bool noise_at_most; /* the column is smooth: its noise is not more than that */
} lg_log_statistics;

#define LG_LOG_SENTENCE 400 /* bytes of a sentence */
typedef struct lg_logs {
    lg_machine_log log; /* views of the arrays below */
    uint32_t files, runs;
    size_t rows_read;         /* of all files; log.rows are those kept */
    double dt_median, dt_max; /* of steps between rows of a run; dt_max with gaps */
    double max_step;          /* longer steps are gaps */
    size_t gaps;
    uint32_t delay; /* rows, as applied */
    /* In the order of the machine file's columns; zeros for time and run. */
    lg_log_statistics columns[LG_LOG_COLUMNS];
    uint32_t warning_count;
    char (*warnings)[LG_LOG_SENTENCE];
    /* Owned. */
    size_t *first;                  /* (parts + 1) */
    uint32_t *part_file, *part_run; /* (parts): index of the file; of the run, counted through all files */
    double *t, *q, *v, *u;
    const lg_context *context;
} lg_logs;

/* Reads CSV or HDF5 files. options NULL: the defaults. Errors: LG_NOT_FOUND, LG_FILE, LG_OUT_OF_MEMORY;
 * LG_FORMAT with file, line (HDF5: row, from 1) and column: text; a missing column; a number so large that
 * the rest of its column is lost in its rounding; time that does not increase; numbers that are no attitude;
 * columns that do not belong together. */
LG_API lg_status lg_logs_read(const lg_context *context, const lg_machine_file *file,
                              const char *const *paths, size_t count, const lg_log_options *options,
                              lg_logs *out, lg_error *error);
LG_API void lg_logs_destroy(lg_logs *logs); /* NULL or zeros are fine */

LG_END_DECLS

#endif

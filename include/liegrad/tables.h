/* Tables of numbers: CSV, HDF5 or numpy files in, columns by name. Library liegrad_io. The guide is
 * docs/tables.md.
 *
 * - CSV: a header with names, then a row a line, separated by commas, semicolons or tabs. Quotes, CRLF, a
 *   byte order mark, blank lines and lines that begin with # are understood. "", nan, NA, N/A and null are
 *   missing.
 * - HDF5: data sets of the root with one number a row are columns of that name, in the order of their names.
 *   A data set (rows, k) of rank 2 is k columns; attribute `columns` (a list of texts, or one with commas)
 *   names them, otherwise they are NAME0, NAME1, ... Texts can be classes.
 * - numpy: one array (.npy, version 1 to 3) of numbers, (rows) or (rows, k), in C or Fortran order: c0, c1,
 *   ... */
#ifndef LIEGRAD_TABLES_H
#define LIEGRAD_TABLES_H

#include "liegrad/io.h"
#include "liegrad/program.h"

LG_BEGIN_DECLS

typedef char lg_table_text[LG_TABLE_NAME];

/* The names of all columns of a file, in order; "" for one without a name. Errors: LG_NOT_FOUND, LG_FILE,
 * LG_FORMAT (nothing that is a table, a header of numbers), LG_OUT_OF_MEMORY. */
typedef struct lg_table_names {
    uint32_t count;
    lg_table_text *name;       /* (count) */
    const lg_context *context; /* whose memory it is in */
} lg_table_names;
LG_API lg_status lg_table_names_read(const lg_context *context, const char *path,
                                     const lg_read_options *options, lg_table_names *out, lg_error *error);
LG_API void lg_table_names_destroy(lg_table_names *names); /* NULL or zeros are fine */

#define LG_TABLE_NO_CLASS UINT32_MAX

typedef struct lg_table_data {
    size_t rows;
    uint32_t columns;          /* numbers of a row */
    double *values;            /* (rows, columns); NaN: missing */
    size_t *line;              /* (rows): of a text file; else the row, from 1 */
    const char *place;         /* what `line` counts: "line" or "row" */
    uint32_t *label;           /* (rows) with a class column, or NULL; LG_TABLE_NO_CLASS: missing */
    uint32_t classes;          /* different labels */
    lg_table_text *class_name; /* (classes), numbers in rising order, else bytewise */
    bool cut;                  /* the last line was cut off and is left out */
    char sha256[LG_SHA256_TEXT];
    const lg_context *context;
} lg_table_data;

/* Reads the columns `names` (count) as numbers and, where it is not NULL, `class_column` as labels. Errors:
 * those of lg_table_names_read; LG_FORMAT with file, line and column: text in a column of numbers, an
 * infinite number, rows of unequal length, a column that is missing (the sentence lists those there are) or
 * there twice, no row, more than 1000 classes. */
LG_API lg_status lg_table_read(const lg_context *context, const char *path, const char *const *names,
                               uint32_t count, const char *class_column, const lg_read_options *options,
                               lg_table_data *out, lg_error *error);
LG_API void lg_table_data_destroy(lg_table_data *data); /* NULL or zeros are fine */
/* Of `count` tables that were read from the same rows, as inputs and outputs are: leaves the rows out in
 * which a number or a label of any of them is missing. *left_out (NULL: not wanted): how many. Errors, the
 * tables as before: LG_INVALID_ARGUMENT (different numbers of rows), LG_FORMAT (no row is complete). */
LG_API lg_status lg_table_keep_complete(lg_table_data *const *tables, size_t count, size_t *left_out,
                                        lg_error *error);
/* A port of a program that takes `numbers` numbers of such rows, with their range: lg_program_build then
 * records at numbers as the data have them, and so sees a branch in C that the data would take both ways. No
 * number at all: -1 to 1. `name` is borrowed. */
LG_API lg_port lg_table_port(const lg_table_data *of, const char *name, uint32_t numbers);

/* ---- named tensors: safetensors files (huggingface.co/docs/safetensors) ---- */

typedef struct lg_tensor {
    char name[128];
    uint32_t rank;
    uint64_t dims[4]; /* row-major */
    size_t count;
    double *values; /* (count) */
} lg_tensor;

typedef struct lg_tensors {
    size_t count;
    lg_tensor *tensor;         /* (count), in the order of the header */
    bool inputs_first;         /* the file says that weights are (in, out), as lg-export writes them */
    const lg_context *context; /* whose memory it is in */
} lg_tensors;

/* All tensors of types F64, F32, F16 and BF16. Errors: LG_NOT_FOUND, LG_FILE, LG_FORMAT with the tensor
 * (another type, a header or offsets that do not fit, a key that is there twice, bytes that belong to two
 * tensors or to no tensor, more than 4 dimensions, numbers that are not finite, more than 2^30 numbers),
 * LG_OUT_OF_MEMORY, LG_CANCELLED. The header is checked before a number is read. On failure `out` is
 * untouched. */
LG_API lg_status lg_tensors_read(const lg_context *context, const char *path, lg_tensors *out,
                                 lg_error *error);
LG_API void lg_tensors_destroy(lg_tensors *tensors); /* NULL or zeros are fine */

LG_END_DECLS

#endif

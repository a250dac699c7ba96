/* The layout of programs in files. Parameters and functions are below /parameters and /functions by name;
 * /parameter_names and /function_names have their order. The operations of a function are columns with one
 * number or row for each; so are its ports. /operations has the name of each operation once. */
#ifndef LG_PROGRAM_FILE_H
#define LG_PROGRAM_FILE_H

#include <stddef.h>

#include "files/h5.h"
#include "liegrad/program_image.h"

#define LG_PROGRAM_KIND "program"

enum { PATH = 256, NAME = 65, UNIT = 65, TEXT = 4096, MOST_NAMES = 1024 };

/* A path in the file; all are shorter than this. */
typedef struct lg_program_key {
    char text[PATH];
} lg_program_key;
lg_program_key lg_program_below(const char *group, const char *name);

/* A list as it lies in the file: one row of (width) or (width, 2) numbers for each operation or port. */
typedef struct lg_program_column {
    const char *name;
    lg_element type;
    uint32_t width; /* 1: no axis */
    bool affine;    /* pairs (base, rows) */
} lg_program_column;

enum { OPERATION, INPUTS, OPERATION_RANK, SHAPE, WHOLE, REAL, RECIPROCAL, REALS, INDICES, OPERATION_COLUMNS };
extern const lg_program_column lg_program_operation_rows[OPERATION_COLUMNS];
enum { PORT_RANK, PORT_SHAPE, SHARED, RANGE, PORT_COLUMNS };
extern const lg_program_column lg_program_port_rows[PORT_COLUMNS];

size_t lg_program_row_size(const lg_program_column *c);
/* Its shape with `count` rows; the rank. */
uint32_t lg_program_column_shape(const lg_program_column *c, uint64_t count, uint64_t dims[4]);
void lg_program_free_columns(const lg_context *context, size_t n, void **columns);

/* One of the lists of a function; the parts of its operations follow each other. */
typedef struct lg_program_list {
    const char *name;
    lg_element type;
    size_t size, pointer, count; /* of an element; offsets in lg_operation */
} lg_program_list;
enum { LG_PROGRAM_LISTS = 3 };
extern const lg_program_list lg_program_lists[LG_PROGRAM_LISTS]; /* edges, reals, indices */

/* How many elements of it each of the n operations has. */
uint32_t lg_program_count_of(const lg_program_list *l, const lg_operation *o);
uint64_t lg_program_list_count(const lg_program_list *l, const lg_operation *operations, size_t n);

lg_status lg_program_no_memory(const lg_h5 *h5, lg_error *error);

#endif

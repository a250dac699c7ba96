/* Tables on their way in. table_csv.c, table_h5.c and table_npy.c give the names of a file's columns and,
 * where columns are wanted, its rows. */
#ifndef LG_TABLE_READING_H
#define LG_TABLE_READING_H

#include "core/core.h"
#include "files/h5.h"
#include "liegrad/tables.h"

enum { LG_TABLE_MOST_COLUMNS = 1 << 16, LG_TABLE_MOST_CLASSES = 1000 };

typedef struct lg_table_reading {
    const lg_context *context;
    const char *path, *shown;
    const lg_read_options *options;
    lg_table_names all; /* columns of the file */
    uint32_t room;
    /* What is wanted; NULL: the names alone. */
    const char *const *names;
    uint32_t count;
    const char *class_column; /* may be NULL */
    /* Known after lg_table_find_columns. */
    uint32_t *to;      /* (columns of the file): which one of `names` it is, from 1; 0: none of them */
    uint32_t class_at; /* the column of the class */
    lg_table_data out;
    size_t row_room;
    lg_table_text *label_text; /* (row_room) of the rows */
} lg_table_reading;

/* Forgets names and rows. */
void lg_table_reset(lg_table_reading *r);
/* One more column of the file; a name that is too long is cut. */
lg_status lg_table_add_name(lg_table_reading *r, const char *name, lg_error *error);
/* After the last name: finds those that are wanted. */
lg_status lg_table_find_columns(lg_table_reading *r, lg_error *error);
/* Room for so many rows, zeroed, as a file with known sizes has them. */
lg_status lg_table_make_rows(lg_table_reading *r, uint64_t rows, lg_error *error);
/* One more row: its place in `values`, which the caller fills. */
lg_status lg_table_add_row(lg_table_reading *r, size_t line, double **values, lg_error *error);
/* The class of a row; "" is missing. */
lg_status lg_table_set_label(lg_table_reading *r, size_t row, const char *text, lg_error *error);
/* The number of a column of a binary file, where that column is wanted; NaN is missing. LG_FORMAT:
 * infinite. */
lg_status lg_table_set_number(lg_table_reading *r, size_t row, uint32_t column, double value,
                              lg_error *error);
lg_status lg_table_no_memory(const lg_table_reading *r, lg_error *error);

static inline bool lg_table_names_only(const lg_table_reading *r) {
    return r->names == NULL;
}

lg_status lg_table_read_csv(lg_table_reading *r, lg_error *error);
lg_status lg_table_read_h5(lg_table_reading *r, lg_error *error);
lg_status lg_table_read_npy(lg_table_reading *r, lg_error *error);

#endif

/* The state while a table is read. table_csv.c, table_h5.c and table_npy.c supply the names of a file's
 * columns, and its rows unless only the names are asked for. */
#ifndef LG_TABLE_READING_H
#define LG_TABLE_READING_H

#include "core/core.h"
#include "files/h5.h"
#include "liegrad/table.h"

enum { LG_TABLE_MOST_COLUMNS = 1 << 16, LG_TABLE_MOST_CLASSES = 1000 };

typedef struct lg_table_reading {
    const lg_context *context;
    const char *path, *shown;
    const lg_read_options *options;
    lg_table_names all; /* all columns of the file */
    uint32_t room;
    /* The wanted columns. names == NULL: only the file's column names are wanted. */
    const char *const *names;
    uint32_t count;
    const char *class_column; /* may be NULL */
    /* Set by lg_table_find_columns. */
    /* For each column of the file: its index in `names` plus 1, or 0 if it is not wanted. */
    uint32_t *to;
    uint32_t class_at; /* number of the class column */
    lg_table_data out;
    size_t row_room;
    lg_table_text *label_text; /* (row_room) class of each row as text */
} lg_table_reading;

/* Discards all names and rows. */
void lg_table_reset(lg_table_reading *r);
/* Adds a column of the file. A name that is too long is cut. */
lg_status lg_table_add_name(lg_table_reading *r, const char *name, lg_error *error);
/* Finds the wanted columns. Call it after all names have been added. */
lg_status lg_table_find_columns(lg_table_reading *r, lg_error *error);
/* Makes `rows` zeroed rows, for files whose size is known in advance. */
lg_status lg_table_make_rows(lg_table_reading *r, uint64_t rows, lg_error *error);
/* Adds a row. *values points to its numbers, which the caller fills. `line` is its line in the file. */
lg_status lg_table_add_row(lg_table_reading *r, size_t line, double **values, lg_error *error);
/* Sets the class of a row; "" means that it is missing. */
lg_status lg_table_set_label(lg_table_reading *r, size_t row, const char *text, lg_error *error);
/* Sets the number in a column of the file, for binary files. Ignored if that column is not wanted. `number`
 * points to an int64_t (type i), an uint64_t (u) or a double (d; f: it was a float). NaN means that it is
 * missing; an infinity, and an integer that no double equals, are LG_FORMAT. A label is the exact decimal of
 * an integer, or the shortest text that reads back as the real number. */
lg_status lg_table_set_number(lg_table_reading *r, size_t row, uint32_t column, char type, const void *number,
                              lg_error *error);
lg_status lg_table_no_memory(const lg_table_reading *r, lg_error *error);

static inline bool lg_table_names_only(const lg_table_reading *r) {
    return r->names == NULL;
}

lg_status lg_table_read_csv(lg_table_reading *r, lg_error *error);
lg_status lg_table_read_h5(lg_table_reading *r, lg_error *error);
lg_status lg_table_read_npy(lg_table_reading *r, lg_error *error);

#endif

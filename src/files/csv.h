/* Text files of rows: a header line, then one row a line; separated by commas, semicolons or tabs. Blank
 * lines and those that begin with # say nothing. Quotes, CRLF and a byte order mark are understood. Sentences
 * have file and line. */
#ifndef LG_CSV_H
#define LG_CSV_H

#include <stdio.h>

#include "core/core.h"

typedef struct lg_csv {
    const lg_context *context;
    const char *path, *shown;
    FILE *from;
    char *block, *line; /* line: terminated */
    size_t block_used, block_at, length, room;
    size_t number;       /* of the line, from 1 */
    bool broken, closed; /* closed: the line ended with a newline */
    char separator;
    size_t cells; /* of the header */
} lg_csv;

/* `what` a file is, for sentences: "log", "table". *c may be closed after a failure too. */
lg_status lg_csv_open(const lg_context *context, const char *path, const char *what, lg_csv *c,
                      lg_error *error);
void lg_csv_close(lg_csv *c);
/* The next line that says something; *more is false behind the last one. */
lg_status lg_csv_line(lg_csv *c, bool *more, lg_error *error);
/* Goes to the header and finds the separator. */
lg_status lg_csv_header(lg_csv *c, lg_error *error);
/* The cell at *at (first: c->line), unquoted and terminated in place; *at becomes NULL behind the last one.
 */
lg_status lg_csv_cell(const lg_csv *c, char **at, char **cell, lg_error *error);
/* Counts the cells of the line against those of the header. *cut: it is the last line and lacks some, as one
 * that was cut off. */
lg_status lg_csv_check_row(const lg_csv *c, bool *cut, lg_error *error);
/* A number; NaN for what is missing: "", nan, NA, N/A, null. `column` for the sentence. */
lg_status lg_csv_number(const lg_csv *c, const char *cell, const char *column, double *out, lg_error *error);
bool lg_csv_missing(const char *cell);
/* FILE: line N: what */
lg_status lg_csv_fail(const lg_csv *c, lg_error *error, const char *what);
lg_status lg_csv_no_memory(const lg_csv *c, lg_error *error);
/* "a, b, ..." of names that are added one by one, with "..." when there is no room. */
typedef struct lg_csv_names {
    char text[200];
    size_t used;
} lg_csv_names;
void lg_csv_add_name(lg_csv_names *names, const char *name);

#endif

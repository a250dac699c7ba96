/* CSV files: a header line, then one row per line. Cells are separated by commas, semicolons or tabs. Blank
 * lines are skipped, and so are comments: lines that begin with #, % or //. If the first other line is a row
 * of numbers, one of the comments before it is the header, as numpy.savetxt writes it. The reader takes the
 * first comment that has the separator and one name for each column; if there is no such comment, it takes
 * the last one with as many words as there are columns. In such a file blanks may separate cells. Quotes
 * (RFC 4180: a cell in quotes may hold anything, also separators, newlines and doubled quotes), CRLF and a
 * byte order mark are understood. Error messages name the file and the line, which is the first one of a row
 * that has several. */
#ifndef LG_CSV_H
#define LG_CSV_H

#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "core/text.h"

typedef struct lg_csv {
    const lg_context *context;
    const char *shown;  /* the path in messages */
    FILE *from;         /* NULL if another descriptor is read */
    int file;           /* descriptor; -1: `from` has none, as a text in memory */
    char *block, *line; /* line: the current line, terminated; length: with carriage returns at its end */
    size_t block_used, block_at, length, room, longest;
    size_t number, lines; /* number of the current line, from 1, and of the last one that was read */
    int failure;          /* errno of reading, or 0 */
    bool ended, closed;   /* ended: nothing more can be read; closed: the line has a line end */
    bool cut;             /* of a feed: the line is longer than `longest` bytes and was cut */
    /* of a feed: called before each read; false ends the feed */
    bool (*wait)(void *user);
    void *user;
    bool quoted; /* the last cell was in quotes */
    bool ours;   /* set by the caller: see lg_frame */
    struct {
        char *text;
        size_t number;
    } comment[16]; /* those before the header; if there are more, the first 15 and the last one */
    size_t comments;
    char *row; /* the first row, while a comment is `line`; `room` is that of the row */
    size_t row_number;
    bool blanks;   /* blanks separate the cells of the rows */
    bool counting; /* the names are 0, 1, 2, ..., unless row is set */
    char separator;
    size_t cells;                /* number of cells of the header */
    size_t hidden, first_hidden; /* comments that look like rows: their number, and the line of the first */
} lg_csv;

/* lg_csv_close may be called after a failure too. */
lg_status lg_csv_open(const lg_context *context, const char *path, lg_csv *c, lg_error *error);
/* Opens a feed: lines of any kind, which are read from a descriptor as they come, with lg_csv_next. Each line
 * end ends a line, zero bytes become '?', and lines are cut at `longest` bytes. The caller closes `file`. */
lg_status lg_csv_open_feed(const lg_context *context, int file, const char *name, size_t longest,
                           bool (*wait)(void *user), void *user, lg_csv *c, lg_error *error);
void lg_csv_close(lg_csv *c);
/* Reads the next line of any kind, without a byte order mark. *more becomes false after the last line. */
lg_status lg_csv_next(lg_csv *c, bool *more, lg_error *error);
/* Number of cells of a line. *open: a quote is not closed. */
size_t lg_csv_count(const char *line, char separator, bool *open);
/* Returns the separator of which the line has most: a comma, a semicolon or a tab. */
char lg_csv_separator(const char *line, char otherwise);
/* Makes each stretch of blanks between cells one separator. Blanks inside quotes stay. */
void lg_csv_join_blanks(char *line, char separator);
/* Returns the length of the sign (#, % or //) with which a comment begins; 0 if the line is not a comment. */
size_t lg_csv_comment(const char *line);
/* Returns whether a comment has as many cells as the header and a number in one of them, as the row "#N/A,2"
 * or a row that someone has commented out. */
bool lg_csv_hides_row(const lg_csv *c, const char *line);
/* Reads the next line that is neither blank nor a comment. *more becomes false after the last line. */
lg_status lg_csv_line(lg_csv *c, bool *more, lg_error *error);
/* Reads the header line and finds the separator. Fails if the line has numbers where names are expected and
 * no comment before it has one name per column. The names may be 0, 1, 2, ... (c->counting), and one of three
 * or more may be a number. */
lg_status lg_csv_header(lg_csv *c, lg_error *error);
/* Returns in *cell the cell at *at, unquoted and terminated in place, and moves *at to the next cell, or to
 * NULL after the last cell. Start a line with *at = c->line. */
lg_status lg_csv_cell(lg_csv *c, char **at, char **cell, lg_error *error);
/* The same for a cell of the header. Control characters are only allowed in quotes. */
lg_status lg_csv_name(lg_csv *c, char **at, char **name, lg_error *error);
/* Fails if the line has another number of cells than the header. *cut becomes true, without a failure, if the
 * line has fewer cells and no newline, as when the end of a file is cut off. */
lg_status lg_csv_check_row(const lg_csv *c, bool *cut, lg_error *error);
#define LG_CSV_EMPTY "; leave cells without a value empty" /* ends messages about text among numbers */
static inline const char *lg_csv_empty(bool blanks) {
    return blanks ? "; write nan in cells without a value" : LG_CSV_EMPTY;
}
/* These words stand for a missing number. A feed accepts them in any case, with or without a sign. */
#define LG_MISSING_WORDS "nan", "NaN", "NAN", "NA", "N/A", "null"
bool lg_csv_missing(const char *cell);
/* Fails with the message "FILE: line N: `what`". */
lg_status lg_csv_fail(const lg_csv *c, lg_error *error, const char *what);

/* ---- writing ---- */

/* The one writer of CSV: cells, each added to the row, and ends of rows. Initialise with {.text.context =
 * c}. Failures of memory stay in the text until lg_columns_write. */
typedef struct lg_columns {
    lg_text text; /* the file so far */
    size_t row;   /* where the row begins */
    bool open;    /* the row has a cell */
    bool words;   /* numbers that are not finite are nan, inf and -inf; otherwise their cells are empty */
} lg_columns;

/* Begins a cell and returns the text, to which the caller adds the cell. It must not need quotes. */
lg_text *lg_columns_cell(lg_columns *to);
/* Adds several cells of the header, such as "t,x,y". None of the names may need quotes. */
void lg_columns_names(lg_columns *to, const char *names);
/* Add a cell, in quotes if it needs them, so that the functions above read the same text. A name is a cell of
 * the header, where a number without quotes means that the header is missing. */
void lg_columns_name(lg_columns *to, const char *name);
void lg_columns_text(lg_columns *to, const char *text);
void lg_columns_whole(lg_columns *to, uint64_t value);
void lg_columns_number(lg_columns *to, double value);
void lg_columns_numbers(lg_columns *to, const double *values, size_t count);
void lg_columns_empty(lg_columns *to);
/* Ends the row. One of a single empty cell gets quotes: readers skip blank lines. */
void lg_columns_end(lg_columns *to);
/* Writes the file at `path` and frees the text. `context`: says whether a file may be replaced. */
lg_status lg_columns_write(lg_columns *to, const lg_context *context, const char *path, lg_error *error);

/* ---- lists of names ---- */

typedef struct lg_csv_quoted {
    char text[2 * 64 + 2];
} lg_csv_quoted;
/* Formats a name for a list with commas. Names with a comma, a quote or a blank at an end are quoted, as in
 * CSV. A name of 64 bytes or more is cut. */
static inline lg_csv_quoted lg_csv_quote(const char *name) {
    lg_csv_quoted out;
    const size_t length = strnlen(name, 63);
    const bool plain =
        strpbrk(name, ",\"") == NULL && length > 0 && name[0] != ' ' && name[length - 1] != ' ';
    size_t used = 0;
    if (!plain) out.text[used++] = '"';
    for (const char *c = name; c < name + length; c++) {
        if (*c == '"') out.text[used++] = '"';
        out.text[used++] = *c;
    }
    if (!plain) out.text[used++] = '"';
    out.text[used] = '\0';
    return out;
}

#endif

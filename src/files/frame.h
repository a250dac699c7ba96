/* Frames: named columns of a file, read in blocks of rows. CSV, HDF5 and numpy files look the same; a
 * format is a row of the table LG_FRAME_FORMATS below. A subject says which columns it wants and what they
 * mean; it knows nothing of files. In a function of a subject:
 *
 *   lg_frame_want want[] = {{.name = "t", .as = LG_FRAME_TIME},            a time, in seconds
 *                           {.name = "q"},                                 a number
 *                           {.name = "run", .as = LG_FRAME_TEXT, .optional = true}};
 *   lg_frame f = {.context = context, .path = path, .what = "log", .options = options,
 *                 .want = want, .wants = LG_COUNT(want)};
 *   lg_status status = lg_frame_open(&f, error);
 *   while (status == LG_OK) {
 *       status = lg_frame_next(&f, 4096, error);          SIZE_MAX: all rows that are left, in one block
 *       if (status != LG_OK || f.rows == 0) break;
 *       for (size_t row = 0; row < f.rows && status == LG_OK; row++) {
 *           const double *x = f.value + row * f.width;    t = x[want[0].first], q = x[want[1].first]
 *           const char *run = lg_frame_text_of(&f, row, &want[2]);           "": missing, or no such column
 *           if (x[0] < 0) status = lg_frame_fail(&f, row, "t", error, "is negative");
 *       }
 *   }
 *   lg_frame_close(&f);                                   also after a failure
 *
 * Without wants only the names are read. With HDF5, lg_frame_open first reads the whole file in the child
 * process of lg_probe. A want may be the path of a data set in a group ("parameters/mass").
 *
 * Numbers: "", nan, NA, N/A and null are missing (NaN). Infinities are rejected, and so are whole numbers
 * that no double equals, except as times. Times: numbers, or dates with a time and times of day as texts,
 * which become seconds since the first one; a column has one format, and one of dates has no scale. A time
 * that reads as a date without separators when it is in seconds is rejected. Texts: as written; "" if
 * missing. In binary files a whole number is its exact decimal text, a real number the shortest text that
 * reads back as the same number. liegrad/table.h ("tables of numbers") says which files are understood.
 *
 * Arrays of more than one number per row (windows, curves, trajectories, weights) are not columns: h5.h reads
 * them from lists that say their names and sizes (lg_h5_array). */
#ifndef LG_FRAME_H
#define LG_FRAME_H

#include "core/core.h"
#include "core/text.h"
#include "core/widen.h"
#include "liegrad/files.h"

struct lg_frame_format;

enum { LG_FRAME_NAME = 64, LG_FRAME_MOST_COLUMNS = 1 << 16 };
typedef char lg_frame_text[LG_FRAME_NAME];

/* ---- times ---- */

typedef enum lg_time_format {
    LG_TIME_NONE,
    LG_TIME_SECONDS, /* a number */
    LG_TIME_DATE,    /* 2024-03-01T12:00:00.25, or with a blank in place of T; years 1900 to 2189 */
    LG_TIME_OFFSET,  /* the same with Z, +01:00, +0100 or +01 at its end */
    LG_TIME_OF_DAY   /* 12:00:00.25 */
} lg_time_format;
typedef struct lg_moment {
    lg_time_format format;
    int64_t nanoseconds; /* of dates and times of day; further digits are left out */
    double seconds;
} lg_moment;
/* The times of a column. Initialise with {LG_TIME_NONE}. */
typedef struct lg_clock {
    lg_time_format format; /* of the first time */
    int64_t first, last;
    size_t line; /* of the first time; left to the caller */
} lg_clock;
/* Reads a time at the beginning of a text that may go on. Returns its end, or NULL if no time is there. */
const char *lg_moment_scan(const char *text, lg_moment *out);
/* Returns whether a number of seconds reads as a date without separators: YYYYMMDDhhmmss, also with digits of
 * a fraction or with milliseconds behind it, YYYYMMDDhhmm or YYMMDDhhmmss. As seconds these are 3000 years or
 * more. */
bool lg_moment_is_packed(double number);
/* Returns the seconds: a number stays as it is; for a date or a time of day they count from the first time,
 * exact to nanoseconds. Returns NaN if the format differs from that of the first time. If a time of day lies
 * more than half a day before the last one, it belongs to the next day. */
double lg_clock_read(lg_clock *clock, lg_moment now);

/* ---- wanted columns ---- */

/* LG_FRAME_CELL: a text that is kept as written, also nan, which is then not the same as an empty cell. */
typedef enum lg_frame_as { LG_FRAME_NUMBER, LG_FRAME_TIME, LG_FRAME_TEXT, LG_FRAME_CELL } lg_frame_as;
typedef struct lg_frame_want {
    const char *name;
    lg_frame_as as;
    bool optional; /* the file need not have the column */
    bool complete; /* a missing number is an error */
    double scale;  /* its numbers are multiplied by it; 0: by 1 */
    /* Set by lg_frame_open. */
    bool there;
    size_t first;   /* index in a row of `value` (numbers) or of `text`; without meaning unless it is there */
    lg_clock clock; /* of times that are texts; set by lg_frame_next */
} lg_frame_want;

/* Where a column of the file goes: indices plus 1, or 0. */
typedef struct lg_frame_use {
    size_t value, text;
    lg_clock *clock; /* NULL: it is not a time */
    double scale;
    bool exact, complete;
} lg_frame_use;

typedef struct lg_frame {
    /* Set by the caller. */
    const lg_context *context;
    const char *path, *what; /* what: kind of the file in messages, "log" */
    const lg_read_options *options;
    lg_frame_want *want;
    size_t wants;
    /* A table that liegrad wrote and continues. Its columns are the first of those that are wanted, in their
     * order; two may have one name. No line between them and the last row is blank or a comment. A last line
     * without its line end, which was not written whole, is left out. */
    bool ours;
    /* Set by lg_frame_open. */
    const char *shown, *place; /* shown: the path in messages; place: "line" or "row" */
    uint32_t columns;          /* of the file */
    char **name;               /* (columns) */
    size_t header;             /* line of the names, or 0 */
    size_t width, texts;       /* numbers and texts of a row */
    /* Set by lg_frame_next. To keep an array, take the pointer and set it to NULL. */
    size_t rows;
    double *value;       /* (rows, width) */
    lg_frame_text *text; /* (rows, texts) */
    size_t *line;        /* (rows) line in a text file, or number of the row, from 1 */
    bool cut;            /* the last line of the file is incomplete and was left out */
    bool blanks;         /* blanks separate cells, so that an empty one cannot be written */
    /* Internal. */
    const struct lg_frame_format *format;
    lg_name_list note; /* what the format adds to a message about a missing column */
    void *source;
    lg_frame_use *use; /* (columns) */
    size_t before, capacity, name_capacity;
} lg_frame;

lg_status lg_frame_open(lg_frame *f, lg_error *error);
/* Reads up to `most` rows. f->rows becomes their number, 0 at the end of the file. */
lg_status lg_frame_next(lg_frame *f, size_t most, lg_error *error);
void lg_frame_close(lg_frame *f);
/* Fails with LG_FORMAT and the message "FILE: line 7: column x: ...". column NULL: about the line of the
 * names. */
lg_status lg_frame_fail(const lg_frame *f, size_t row, const char *column, lg_error *error,
                        const char *format, ...) __attribute__((format(printf, 5, 6)));
static inline const char *lg_frame_text_of(const lg_frame *f, size_t row, const lg_frame_want *want) {
    return want->there ? f->text[row * f->texts + want->first] : "";
}

/* ---- for formats ---- */

typedef struct lg_frame_format {
    const char *name, *place;
    /* Whether a file is of this format, by its first bytes (count): those of the file, also a byte order
     * mark, which lg_csv_next removes. NULL: every file is. */
    lg_status (*is)(const char *path, const unsigned char *first, size_t count, bool *is, lg_error *error);
    /* Adds the names of the columns and calls lg_frame_find. */
    lg_status (*open)(lg_frame *f, lg_error *error);
    /* Fills the block (f->value, f->text, f->line) with up to `most` rows and sets f->rows to their number, 0
     * at the end of the file. Before the call f->rows is 0. */
    lg_status (*rows)(lg_frame *f, size_t most, lg_error *error);
    void (*close)(lg_frame *f); /* frees f->source, which may be NULL */
} lg_frame_format;
/* The table of formats: X(name) stands for the row lg_frame_<name>. The last one has no `is`. */
#define LG_FRAME_FORMATS X(h5) X(npy) X(csv)
#define X(name)          extern const lg_frame_format lg_frame_##name;
LG_FRAME_FORMATS
#undef X

/* `rows` and `close` of a text file. f->source is an lg_csv from lg_alloc that is open, and whose lines that
 * are left are rows: its blanks, separator, cells and ours are set. */
lg_status lg_frame_csv_rows(lg_frame *f, size_t most, lg_error *error);
void lg_frame_csv_close(lg_frame *f);

lg_status lg_frame_no_memory(const lg_frame *f, lg_error *error);
lg_status lg_frame_add_name(lg_frame *f, const char *name, lg_error *error);
/* Finds the wanted columns, once all names are added. */
lg_status lg_frame_find(lg_frame *f, lg_error *error);
/* Makes room for `rows` rows in the block; new rows are not cleared. */
lg_status lg_frame_reserve(lg_frame *f, size_t rows, lg_error *error);
/* Sets f->rows and the lines of a file whose rows have numbers. `left`: rows that are left. */
lg_status lg_frame_number_rows(lg_frame *f, size_t most, uint64_t left, lg_error *error);
/* Put a cell of the block where it is wanted. In quotes a word such as nan is a text, too. `number` points to
 * an int64_t (type i), an uint64_t (u) or a double (d; f: it was a float). */
lg_status lg_frame_put_cell(lg_frame *f, size_t row, uint32_t column, const char *text, bool quoted,
                            lg_error *error);
lg_status lg_frame_put_number(lg_frame *f, size_t row, uint32_t column, char type, const void *number,
                              lg_error *error);
static inline bool lg_frame_is_wanted(const lg_frame *f, uint32_t column) {
    return f->use[column].value > 0 || f->use[column].text > 0;
}

#endif

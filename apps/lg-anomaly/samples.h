/* Reads samples as lines of text from a pipe or a file, in fixed memory. */
#ifndef LG_APPS_SAMPLES_H
#define LG_APPS_SAMPLES_H

#include "common/app.h"

typedef enum sample_kind {
    SAMPLE_READ,      /* The line has all its numbers. A number may be NaN: an empty field, nan or inf. */
    SAMPLE_MALFORMED, /* the line is malformed; `problem` says why */
    SAMPLE_END,
    SAMPLE_STOPPED, /* stopped by Ctrl-C */
    SAMPLE_REFUSED, /* the feed's column names do not fit the model's channels; `problem` says how */
    SAMPLE_FAILED   /* read(2) failed with the errno in `failure` */
} sample_kind;

enum { SAMPLE_HEADERS = 20 }; /* most lines of words before the first sample */

typedef enum sample_layout { LAYOUT_UNKNOWN, LAYOUT_VALUES, LAYOUT_TIMED } sample_layout;

/* A line has C numbers, or a time in seconds and C numbers, separated by commas, semicolons or blanks. An
 * additional separator at its end, blanks around numbers, and a carriage return before the newline are
 * allowed. The reader skips blank lines, lines that begin with % or //, comments from # on, lines of words
 * before the first sample (names, units), and later repetitions of these lines.
 *
 * The first lines decide once and for all whether lines begin with a time: three lines of the same kind
 * decide, and one of them may be a line of names. After that a line with another number of columns is
 * malformed.
 *
 * If the model's channels have names, a line of names before the first sample that has one of them says
 * which column is which channel. Other columns are left out, whatever their cells hold, and `extra` has their
 * names. A column of times is the first one before the channels whose name is that of a time, or the first
 * column if it is the only other one and holds a number in the first sample; a column with the name of a time
 * behind a channel is an error.
 * `unnamed`: there was a line of names, but without any channel of the model.
 *
 * The last line of a feed may lack its line end, and then its last number may be cut. Such a line is
 * malformed (its time is used), unless a separator, a blank, \r or a comment follows the number, or it is the
 * only line. */
typedef struct sample_reader {
    int file;
    uint32_t channels;
    sample_layout layout;
    uint64_t line;   /* number of the last line read, from 1 */
    uint64_t lines;  /* number of lines so far that have, or should have, a sample */
    double *field;   /* (channels + 1): the numbers of the line */
    uint32_t fields; /* number of fields in the line; fields beyond channels + 1 are not stored */
    bool words;      /* the line holds something that is not a number */
    uint64_t header[SAMPLE_HEADERS]; /* hashes of the lines of words before the first sample */
    uint32_t headers;
    char problem[160];
    /* (channels): names of the model's channels, borrowed; NULL if they have none. */
    const char *const *names;
    uint32_t *place; /* (channels): index of each channel among the numbers of a line, without the time */
    /* named: a line of names has set `place`; unnamed: a line of names had no channel of the model. */
    bool named, unnamed;
    bool *left_out; /* (columns): columns that are left out; NULL if none is */
    uint32_t columns;
    char separator;  /* of the line of names */
    char guess[64];  /* name of the first column while only its place makes it one of times; else "" */
    char extra[160]; /* names of the columns that are left out */
    int failure;
    char *buffer; /* (room + 1) */
    size_t room, begin, end;
    bool at_end, skipping; /* skipping: inside a line that is longer than the buffer */
    bool looked;           /* the first lines have been examined for the layout */
    bool unended;          /* the line is the last one and has no line end */
    void (*idle)(void *); /* if not NULL, idle(user) is called several times a second while no sample comes */
    void *user;
} sample_reader;

void sample_reader_open(int file, uint32_t channels, const char *const *names, sample_reader *out);
void sample_reader_close(sample_reader *reader); /* frees the memory; the caller closes the file */
/* Reads the next line into sample (channels); *time is NaN if the feed has no times. A malformed line whose
 * time is known sets *time and fills `sample` with NaN. Flushes stdout before it waits. */
sample_kind sample_next(sample_reader *reader, float *sample, double *time);

#endif

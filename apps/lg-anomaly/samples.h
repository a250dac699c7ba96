/* Samples as lines of text, from a pipe or a file, in fixed memory. */
#ifndef LG_APPS_SAMPLES_H
#define LG_APPS_SAMPLES_H

#include "common/app.h"

typedef enum sample_kind {
    SAMPLE_READ,      /* all numbers are there; some may be NaN: empty fields, nan, inf */
    SAMPLE_MALFORMED, /* `problem` says why */
    SAMPLE_END,
    SAMPLE_STOPPED, /* Ctrl-C */
    SAMPLE_REFUSED, /* the names of the feed are not those of the model: `problem` says how */
    SAMPLE_FAILED   /* errno of read(2) is in `failure` */
} sample_kind;

enum { SAMPLE_HEADERS = 20 }; /* lines of words before the first sample */

typedef enum sample_layout { LAYOUT_UNKNOWN, LAYOUT_VALUES, LAYOUT_TIMED } sample_layout;

/* A line has C numbers, or a time in seconds and C numbers, separated by commas, semicolons or blanks. One
 * more separator at its end, blanks around numbers and \r\n are allowed. The reader skips blank lines,
 * comments from # on, lines of words before the first sample (names, units), and repetitions of these lines.
 *
 * The first lines decide once whether there is a time: three of one kind, and a line of names may be one of
 * them. From then on a line with another number of columns is malformed.
 *
 * A line of names before the first sample tells which column is which channel, where the model's channels
 * have names and one of them occurs. `unnamed`: it has names of other channels alone.
 *
 * A last line without a line end may have been cut within its last number. It is malformed, with its time,
 * unless something (a separator, a blank, \r, a comment) follows that number, or it is the only line. */
typedef struct sample_reader {
    int file;
    uint32_t channels;
    sample_layout layout;
    uint64_t line;                   /* number of the last line, from 1 */
    uint64_t lines;                  /* lines read so far that have, or should have, a sample */
    double *field;                   /* (channels + 1) */
    uint32_t fields;                 /* of the line; those beyond channels + 1 are not read */
    bool words;                      /* the line holds something that is no number */
    uint64_t header[SAMPLE_HEADERS]; /* hashes of the lines of words before the first sample */
    uint32_t headers;
    char problem[160];
    const char *const *names; /* (channels) of the model's channels, borrowed; NULL: they have none */
    uint32_t *place;          /* (channels): which number of a line each is, the time not counted */
    bool named, unnamed;      /* a line of names told the places; one had no name of the model */
    int failure;
    char *buffer; /* (room + 1) */
    size_t room, begin, end;
    bool at_end, skipping; /* skipping: within a line that is longer than the buffer */
    bool looked;           /* at the first lines, for the layout */
    bool unended;          /* the line is the last one and has no end */
    void (*idle)(void *);  /* idle(user) while no sample comes, several times a second; may be NULL */
    void *user;
} sample_reader;

void sample_reader_open(int file, uint32_t channels, const char *const *names, sample_reader *out);
void sample_reader_close(sample_reader *reader); /* frees; the file is the caller's */
/* The next line: sample (channels); *time NAN without one. A malformed line whose time is known sets *time
 * and fills sample with NaN. Flushes stdout before it waits. */
sample_kind sample_next(sample_reader *reader, float *sample, double *time);

#endif

/* Reads samples as lines of text from a pipe or a file, in fixed memory. */
#ifndef LG_APPS_SAMPLES_H
#define LG_APPS_SAMPLES_H

#include "common/app.h"
#include "core/text.h"
#include "files/csv.h"
#include "files/frame.h"

typedef enum sample_kind {
    SAMPLE_READ,      /* The line has all its numbers. A number may be NaN: an empty field, nan or inf. */
    SAMPLE_MALFORMED, /* the line is malformed; `problem` says why */
    SAMPLE_END        /* the feed has ended, Ctrl-C stopped it, or `error` says what is wrong with it */
} sample_kind;

enum {
    SAMPLE_HEADERS = 20, /* most lines of words before the first sample */
    SAMPLE_AHEAD = 50    /* most lines that are examined for the layout */
};

typedef enum sample_layout { LAYOUT_UNKNOWN, LAYOUT_VALUES, LAYOUT_TIMED } sample_layout;

typedef struct sample_line {
    char *text;
    uint64_t number;
    bool closed, cut; /* as in lg_csv */
} sample_line;

/* A line has C numbers, or a time (lg_moment_scan) and C numbers, separated by commas, semicolons or blanks.
 * An additional separator at its end, blanks around numbers, and a carriage return before the newline are
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
 * behind a channel is an error. A later line of names that has all channels replaces the columns. A later
 * line that has some of them, and as many names as a line has cells, is an error.
 *
 * The last line of a feed may lack its line end, and then its last number may be cut. Such a line is
 * malformed (its time is used), unless a separator, a blank, \r or a comment follows the number, or it is the
 * only line. */
typedef struct sample_reader {
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
    lg_error error;
    /* (channels): names of the model's channels, borrowed; NULL if they have none. */
    lg_frame_text *names;
    lg_frame frame;      /* the columns, if a line of names has channels */
    lg_frame_want *want; /* (channels) */
    uint32_t time;       /* column of times + 1; 0: none */
    lg_clock clock;      /* of the times */
    bool guessed;        /* only its place makes it one of times */
    bool renamed;        /* a later line of names has replaced the columns; cleared by the caller */
    bool unnamed;        /* a line of names had no channel of the model */
    uint32_t *place;     /* (channels): index of each channel among the numbers of a line, without the time */
    lg_name_list extra;  /* names of the columns that are left out */
    lg_csv csv;
    sample_line ahead[SAMPLE_AHEAD]; /* (looked): the first lines; `given` of them have been used */
    uint32_t looked, given;
    void (*idle)(void *); /* if not NULL, idle(user) is called several times a second while no sample comes */
    void *user;
} sample_reader;

/* `name` is that of the feed in messages. The reader must not be moved. */
void sample_reader_open(int file, const char *name, uint32_t channels, lg_frame_text *names,
                        sample_reader *out);
void sample_reader_close(sample_reader *reader); /* frees the memory; the caller closes the file */
/* Reads the next line into sample (channels); *time is NaN if the feed has no times. A malformed line whose
 * time is known sets *time and fills `sample` with NaN. Flushes stdout before it waits. */
sample_kind sample_next(sample_reader *reader, float *sample, double *time);
/* Leaves out the column that only its place makes one of times. */
void sample_leave_times(sample_reader *reader);

#endif

/* Declarations that the files of `lg-anomaly watch` share: watch.c prints verdicts and the summary,
 * watch_time.c finds the place of each sample in the feed, watch_log.c writes the file of verdicts. */
#ifndef LG_APPS_ANOMALY_WATCH_H
#define LG_APPS_ANOMALY_WATCH_H

#include "lg-anomaly/anomaly.h"
#include "lg-anomaly/samples.h"

enum {
    DAY = 86400, /* seconds */
    /* Largest number of first samples from which the feed's interval is measured; a short window takes only
     * as many as it has. */
    FIRST_TIMES = 100,
    HELD = 16 /* most samples that wait until their times are accepted */
};

/* What the judge of a window needs, and its results. */
typedef struct bench {
    const well_model *model;
    lg_scorer by;            /* of the model */
    const lg_series *names;  /* of the model */
    const lg_novelty *usual; /* its record of the training windows */
    /* Windows with a larger distance are unlike the training windows; infinite: no window is. */
    double farthest;
    double *score; /* (classes) */
    double *features;
    void *work, *novelty_work;
    uint32_t given;
    lg_novelty_result novelty;
} bench;

/* Amplitudes in the highest frequency band relative to the training windows, from the first windows of the
 * feed. */
typedef struct noise_level {
    uint32_t windows;
    double *sum; /* (channels): sum over the windows of the logarithm of the ratio */
} noise_level;

/* Counts samples in which channels have no number. */
typedef struct silence {
    /* samples: number since the last verdict; without (channels): for each channel, how many of these samples
     * lack its number. */
    uint64_t samples, *without;
    /* One bit for each of the last N windows, bit 0 for the latest: the window was not judged because a
     * channel had no numbers. */
    uint64_t windows;
} silence;

typedef struct tally {
    /* absent: missing according to the times. */
    uint64_t samples, received, absent, repeated, not_finite, malformed;
    uint64_t windows, judged, positive, failed, alarms, unlike, unlike_alarms;
    uint64_t judged_before, positive_before, alarms_before; /* those counted before the crack */
    double first_alarm, first_unlike, detection;            /* times in seconds; NaN if it has not happened */
} tally;

/* A sample that waits until its time is accepted. */
typedef struct held_sample {
    double time;
    uint64_t line;
    float *values; /* (channels) */
} held_sample;

/* Compares the times of the feed with the clock of the watch. */
typedef struct timing {
    held_sample first[FIRST_TIMES], held[HELD];
    /* firsts, holds: number of stored samples; wanted: number of samples from which the interval is
     * measured. */
    uint32_t firsts, wanted, holds;
    bool measured; /* the interval was measured, or measuring was given up */
    bool follow;   /* true: the clock follows the times; false: --rate forces the rate */
    double usual;  /* usual number of clock steps from one sample to the next */
} timing;

/* Where verdicts are written: standard output, or the file of --log. */
typedef struct watch_log {
    const app *app;
    const char *path;
    const char *begin; /* how the file begins; a line is written before the first verdict */
    FILE *stream;      /* the next line is printed to this stream */
    int fd;            /* file of --log; -1 for standard output */
    char *text;        /* contents of the stream, if it is in memory */
    size_t length;
    bool named;    /* lines have been written */
    bool failing;  /* the last line could not be written */
    uint64_t lost; /* number of lines that could not be written */
} watch_log;

typedef struct watching {
    const app *app;
    watch_log log;
    bench bench;
    uint32_t channels; /* of the model */
    sample_reader *reader;
    lg_monitor *watch;
    double rate, hop; /* Hz; samples. rate is 1 if it is unknown. */
    bool rate_known, started, alarm, unlike;
    noise_level noise;
    silence silence;
    double origin;  /* time of the sample from which the clock counts; s */
    uint64_t since; /* number of samples after that sample */
    double now;     /* time of the last sample: origin + since/rate */
    timing timing;
    bool in_gap, refused;                 /* refused: the feed has another rate; a message has been printed */
    uint64_t gap_windows;                 /* number of windows of the current gap that were not judged */
    double gap_first;                     /* time of the first such window that is not printed */
    uint64_t malformed_in_row, last_read; /* malformed lines in a row, and the line before them */
    tally tally;
} watching;

/* ---- verdicts (watch.c) ---- */

/* Passes a sample to the watch at the clock's time, and counts and prints the results. NULL: the sample is
 * lost. Numbers of the sample may be NaN. */
void watch_push(watching *self, const float *sample);
/* Prints one line for all windows of a gap that were not printed one by one. */
void watch_end_gap(watching *self);

/* ---- the file of verdicts (watch_log.c) ---- */

/* Opens the log and cuts off an unfinished last line. A file that is not empty and does not begin with
 * `begin` is rejected. `path` NULL: verdicts go to standard output, and the other functions do nothing. */
void watch_log_open(watch_log *log, const app *app, const char *path, const char *begin);
/* Opens the file again if SIGHUP asked for it; if this fails, the old file stays in use. Called before each
 * line is printed, and while no sample comes. */
void watch_log_turn(watch_log *log);
/* Appends what was printed to the stream to the file, completely or not at all. If this fails, it warns and
 * counts a lost line. */
void watch_log_put(watch_log *log);
/* Closes the log. Ends the command with an error if lines were lost. */
void watch_log_close(watch_log *log);

/* ---- samples and their times (watch_time.c) ---- */

/* `reader`, `rate_known`, `bench` and `rate` must be set. */
void watch_time_open(watching *self);
/* Takes a line of the feed; time is NaN in a feed without times. Pushes the missing samples before it and
 * then the sample, or holds the sample until its time is accepted. */
void watch_take(watching *self, const float *sample, double time, uint64_t line);
/* Takes a line that could not be read. */
void watch_take_malformed(watching *self, const float *sample, double time);
/* Called where a line of names has replaced the columns: the window begins anew. */
void watch_restart(watching *self);
/* Called when the feed has ended: accepts or rejects the samples that still wait. */
void watch_settle(watching *self);

#endif

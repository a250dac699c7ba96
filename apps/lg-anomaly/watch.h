/* Declarations that the files of `lg-anomaly watch` share: watch.c prints verdicts and the summary,
 * watch_time.c finds the place of each sample in the feed. */
#ifndef LG_APPS_ANOMALY_WATCH_H
#define LG_APPS_ANOMALY_WATCH_H

#include "liegrad/monitor.h"
#include "lg-anomaly/anomaly.h"
#include "lg-anomaly/samples.h"

enum {
    DAY = 86400,       /* s */
    FIRST_TIMES = 100, /* the feed's interval is measured from so many, or from a window's worth */
    HELD = 16          /* samples that wait until their time is accepted */
};

/* Inputs and results of the judge. */
typedef struct bench {
    const well_model *model;
    double farthest; /* distance beyond which a window is unlike those of training; infinite: never */
    double *score;   /* (classes) */
    double *features;
    void *work, *novelty_work;
    uint32_t given;
    lg_novelty_result novelty;
} bench;

/* Amplitudes of the highest band over those of training: sums of logarithms of the first windows. */
typedef struct noise_level {
    uint32_t windows;
    double *sum; /* (channels) */
} noise_level;

/* Samples that came without a number of a channel. */
typedef struct silence {
    uint64_t samples, *without; /* since the last verdict; (channels) of each channel */
    uint64_t windows;           /* the last ones that were not judged for that reason, bit 0 the latest */
} silence;

typedef struct tally {
    uint64_t samples, received, absent, repeated, not_finite, malformed; /* absent: told by the times */
    uint64_t windows, judged, positive, failed, alarms, unlike, unlike_alarms;
    uint64_t judged_before, positive_before, alarms_before; /* before the crack */
    double first_alarm, first_unlike, detection;            /* times; NaN: none */
} tally;

/* A sample that waits until its time is accepted. */
typedef struct held_sample {
    double time;
    uint64_t line;
} held_sample;

/* The clock that the times of the feed are compared with. */
typedef struct timing {
    held_sample first[FIRST_TIMES], held[HELD];
    float *first_values, *held_values; /* (FIRST_TIMES, channels), (HELD, channels) */
    uint32_t firsts, wanted, holds;    /* wanted: before the interval is measured */
    bool measured;                     /* or given up */
    bool follow;                       /* the clock follows the times; false: the rate is forced */
    double usual;                      /* steps of the clock from one sample to the next */
} timing;

/* Where verdicts go: standard output, or with --log a file. */
typedef struct watch_log {
    const app *app;
    const char *path;
    FILE *stream; /* of the next line */
    int fd;       /* -1: standard output */
    char *text;   /* of the stream in memory */
    size_t length;
    bool failing;  /* the last line could not be written */
    uint64_t lost; /* lines */
} watch_log;

typedef struct watching {
    const app *app;
    watch_log log;
    bench bench;
    lg_monitor *watch;
    double rate, hop; /* Hz; samples. rate 1 when nobody knows it */
    bool rate_known, started, alarm, unlike;
    noise_level noise;
    silence silence;
    double origin;  /* time of a sample; s */
    uint64_t since; /* samples after it */
    double now;     /* time of the last sample: origin + since/rate */
    timing timing;
    bool in_gap, refused;      /* refused: the rate of the feed; a sentence has said so */
    uint64_t gap_windows;      /* not judged, of this gap */
    double gap_first;          /* time of the first that is not printed */
    uint64_t malformed_in_row; /* lines */
    tally tally;
} watching;

/* ---- verdicts (watch.c) ---- */

/* Passes a sample (NULL: lost; its numbers may be NaN) to the watch at the clock's time; counts and prints
 * the results. */
void watch_push(watching *self, const float *sample);
/* Prints one line for the windows of a gap that were not printed one by one. */
void watch_end_gap(watching *self);

/* ---- the file of verdicts (watch_log.c) ---- */

/* `path` NULL: standard output, for which the other functions do nothing. An unfinished last line is cut
 * off. */
void watch_log_open(watch_log *log, const app *app, const char *path);
/* Opens the file again when SIGHUP asked for it; the old one goes on where that fails. Before a line is made,
 * which begins with the names where the file is empty, and while no sample comes. */
void watch_log_turn(watch_log *log);
bool watch_log_is_empty(const watch_log *log);
/* Writes what was printed to the stream: wholly, or a warning says that it is lost, and it is counted. */
void watch_log_put(watch_log *log);
/* The command ends here when lines were lost. */
void watch_log_close(watch_log *log);

/* ---- samples and their times (watch_time.c) ---- */

/* `rate_known`, `bench` and `rate` are set. */
void watch_time_open(watching *self);
void watch_time_close(watching *self);
/* Takes a line of the feed; time NaN in a feed without times. Pushes the missing samples before it and the
 * sample, or holds it until its time is accepted. */
void watch_take(watching *self, const float *sample, double time, uint64_t line);
/* A line that could not be read. */
void watch_take_malformed(watching *self, const sample_reader *reader, const float *sample, double time);
/* The feed has ended: decides on the samples that still wait. */
void watch_settle(watching *self);

#endif

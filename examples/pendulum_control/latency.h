/* Timing of a loop: a clock, an absolute timer, and statistics of the samples. */
#ifndef LATENCY_H
#define LATENCY_H

#include <stddef.h>
#include <stdint.h>

/* CLOCK_MONOTONIC in nanoseconds. */
int64_t clock_now(void);
/* Sleeps until `when`, or returns at once if it has passed. Returns how late it woke up, ns. */
int64_t clock_sleep_until(int64_t when);

/* Samples in memory that is allocated before the loop. Samples beyond `room` are dropped. */
typedef struct samples {
    int64_t *ns;
    size_t count, room;
} samples;

void samples_add(samples *self, int64_t ns);
typedef struct latency {
    size_t count;
    double median, p999, most; /* us; NaN if there are no samples */
} latency;
/* Summarises the samples, and sorts them. */
latency samples_summary(samples *self);

#endif

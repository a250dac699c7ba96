/* Times of a loop: a clock, an absolute timer, and what the samples look like. */
#ifndef LATENCY_H
#define LATENCY_H

#include <stddef.h>
#include <stdint.h>

/* Nanoseconds of CLOCK_MONOTONIC. */
int64_t clock_now(void);
/* Sleeps until then (returns at once when it is past); how late it woke, ns. */
int64_t clock_sleep_until(int64_t when);

/* Samples in memory that is there before the loop; those beyond `room` are not kept. */
typedef struct samples {
    int64_t *ns;
    size_t count, room;
} samples;

void samples_add(samples *self, int64_t ns);
typedef struct latency {
    size_t count;
    double median, p999, most; /* us; NaN without samples */
} latency;
/* Sorts the samples. */
latency samples_summary(samples *self);

#endif

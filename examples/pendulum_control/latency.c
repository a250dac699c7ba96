#include "latency.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <time.h>

enum { NS_IN_SECOND = 1000000000 };

int64_t clock_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * NS_IN_SECOND + now.tv_nsec;
}

int64_t clock_sleep_until(int64_t when) {
    const struct timespec at = {.tv_sec = (time_t)(when / NS_IN_SECOND),
                                .tv_nsec = (long)(when % NS_IN_SECOND)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == EINTR) {
    }
    return clock_now() - when;
}

void samples_add(samples *self, int64_t ns) {
    if (self->count < self->room) self->ns[self->count++] = ns;
}

static int ascending(const void *a, const void *b) {
    const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

latency samples_summary(samples *self) {
    if (self->count == 0) return (latency){0, NAN, NAN, NAN};
    qsort(self->ns, self->count, sizeof *self->ns, ascending);
    const size_t last = self->count - 1;
    return (latency){self->count, 1e-3 * (double)self->ns[last / 2],
                     1e-3 * (double)self->ns[last - self->count / 1000], 1e-3 * (double)self->ns[last]};
}

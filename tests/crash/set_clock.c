/* A library for LD_PRELOAD with which a test sets the wall clock of a program. This clock is the system's
 * clock plus the seconds in the file $LG_CLOCK. Each call reads the file (no file: 0 seconds). A wait for a
 * time of the wall clock ends when this clock has reached the time, as on a system whose clock is set. */
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static long shift(void) {
    char text[32] = "";
    const char *path = getenv("LG_CLOCK");
    const int kept = errno, file = path != NULL ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file >= 0) {
        if (read(file, text, sizeof text - 1) < 0) text[0] = '\0';
        (void)close(file);
    }
    errno = kept;
    return strtol(text, NULL, 10);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    const int code = (int)syscall(SYS_clock_gettime, clock, now);
    if (code == 0 && clock == CLOCK_REALTIME) now->tv_sec += shift();
    return code;
}

time_t time(time_t *out) {
    struct timespec now = {0, 0};
    (void)clock_gettime(CLOCK_REALTIME, &now);
    if (out != NULL) *out = now.tv_sec;
    return now.tv_sec;
}

int gettimeofday(struct timeval *restrict out, void *restrict zone) {
    struct timespec now = {0, 0};
    (void)zone;
    const int code = clock_gettime(CLOCK_REALTIME, &now);
    *out = (struct timeval){now.tv_sec, now.tv_nsec / 1000};
    return code;
}

/* Looks at the clock every 50 ms. A time of less than 30 years is a time of the monotonic clock. */
int pthread_cond_timedwait(pthread_cond_t *restrict condition, pthread_mutex_t *restrict mutex,
                           const struct timespec *restrict until) {
    const clockid_t clock = until->tv_sec < 1000000000 ? CLOCK_MONOTONIC : CLOCK_REALTIME;
    struct timespec now = {0, 0};
    for (int code = ETIMEDOUT; code == ETIMEDOUT;) {
        if (clock_gettime(clock, &now) != 0) return EINVAL;
        if (now.tv_sec > until->tv_sec || (now.tv_sec == until->tv_sec && now.tv_nsec >= until->tv_nsec))
            return ETIMEDOUT;
        if (clock_gettime(CLOCK_MONOTONIC, &now) != 0) return EINVAL;
        now.tv_nsec += 50000000;
        if (now.tv_nsec >= 1000000000) now.tv_sec++, now.tv_nsec -= 1000000000;
        code = pthread_cond_clockwait(condition, mutex, CLOCK_MONOTONIC, &now);
        if (code != ETIMEDOUT) return code;
    }
    return 0;
}

/* What the programs that compare random recordings share. */
#include <inttypes.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "autodiff/random/random.h"

tally counted;
volatile uint64_t looked_at;

void stop(const char *format, ...) {
    va_list list;
    va_start(list, format);
    (void)vfprintf(stderr, format, list);
    va_end(list);
    (void)fputc('\n', stderr);
    exit(3);
}

void *room(size_t count, size_t size) {
    void *memory = calloc(count + 1, size);
    if (memory == NULL) stop("no memory");
    return memory;
}

bool found(finding *out, bool refused, const char *format, ...) {
    va_list list;
    out->refused = refused;
    va_start(list, format);
    (void)vsnprintf(out->sentence, sizeof out->sentence, format, list);
    va_end(list);
    return false;
}

static void tell_crash(int signal_number) {
    char line[80];
    const int length =
        snprintf(line, sizeof line, "recording %" PRIu64 ": signal %d\n", looked_at, signal_number);
    (void)!write(1, line, (size_t)length);
    _exit(1);
}

void tell_crashes(char **argv) {
    static const int signals[] = {SIGSEGV, SIGBUS, SIGABRT, SIGFPE};
    /* The checks read the environment with which a process began. */
    if (argv != NULL && getenv("UBSAN_OPTIONS") == NULL) {
        (void)setenv("UBSAN_OPTIONS", "abort_on_error=1:print_stacktrace=0", 1);
        (void)execv("/proc/self/exe", argv);
    }
    for (size_t i = 0; i < LG_COUNT(signals); i++) (void)signal(signals[i], tell_crash);
}

/* Times several ways to compute the same thing. The ways alternate in rounds of some calls each; results are
 * medians over rounds. */
#ifndef BENCH_TIMING_H
#define BENCH_TIMING_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { WAYS = 4, MOST_ROUNDS = 10001 };

typedef struct way {
    const char *name;
    void (*call)(size_t input); /* input: number of a prepared input */
    const double *result;       /* where the way writes its result */
} way;

static double bench_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e6 + (double)t.tv_nsec * 1e-3;
}

static double bench_time(void (*call)(size_t), int calls, size_t inputs) {
    const double begin = bench_now();
    for (int i = 0; i < calls; i++) call((size_t)i % inputs);
    return (bench_now() - begin) / calls;
}

static int bench_ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The largest norm of the difference from way 0, relative to the root mean square of the norms of way 0. */
static double bench_error(const way *ways, size_t w, size_t numbers, size_t inputs) {
    double worst = 0, norms = 0;
    for (size_t i = 0; i < inputs; i++) {
        double difference = 0;
        ways[0].call(i);
        ways[w].call(i);
        for (size_t k = 0; k < numbers; k++) {
            difference += pow(ways[w].result[k] - ways[0].result[k], 2);
            norms += ways[0].result[k] * ways[0].result[k];
        }
        if (!(sqrt(difference) <= worst)) worst = sqrt(difference);
    }
    return worst / sqrt(norms / (double)inputs);
}

/* Prints one JSON object with the name and a row for each way. */
static void bench_ways(const char *name, const way *ways, size_t count, size_t numbers, size_t inputs,
                       size_t rounds) {
    static double us[WAYS][MOST_ROUNDS];
    const double one = bench_time(ways[0].call, 64, inputs);
    const int calls = 1 + (int)(20 / one);
    for (size_t r = 0; r < rounds; r++)
        for (size_t w = 0; w < count; w++) us[w][r] = bench_time(ways[w].call, calls, inputs);
    printf("{\"name\": \"%s\", \"ways\": [", name);
    for (size_t w = 0; w < count; w++) {
        qsort(us[w], rounds, sizeof us[w][0], bench_ascending);
        printf("%s{\"name\": \"%s\", \"us\": %.5f, \"error\": %.3g}", w > 0 ? ", " : "", ways[w].name,
               us[w][rounds / 2], bench_error(ways, w, numbers, inputs));
    }
    printf("]}");
}

static size_t bench_rounds(const char *word) {
    const long asked = strtol(word, NULL, 10);
    return asked < 1 ? 1 : asked > MOST_ROUNDS ? MOST_ROUNDS : (size_t)asked;
}

#endif

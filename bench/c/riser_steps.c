/* riser_steps LEVELS: error of the simulated riser by its time step, against the processor seconds of an
 * hour.
 *
 * Three runs of the standard set (low, middle and high sea, the well damaged) last an hour each at 5 Hz,
 * without sensor noise. The steps are 0.2 s, 0.1 s, ... (LEVELS of them). The reference has a step that is
 * four times smaller than the last one. The scheme has order 2, so the error of the reference is about a
 * sixteenth of the error of the last step. Errors are root mean squares over an hour, both directions and the
 * runs: of the lower accelerations (m/s^2), the upper accelerations, and the moments (N m). Prints one JSON
 * object. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include <liegrad/anomaly.h>

enum { RUNS = 3, SAMPLES = 18000, CHANNELS = LG_RISER_CHANNELS, SIZE = SAMPLES * CHANNELS, GROUPS = 3 };

static float now_at[SIZE], reference[RUNS][SIZE];
static const uint32_t numbers[RUNS] = {1, 49, 105};
static double noise[2]; /* of accelerations and of moments, at the noise 1 */

static double clock_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Simulates a run; returns its seconds. */
static double simulate(size_t run, double dt, float *samples) {
    lg_riser_parameters parameters;
    lg_riser_run how;
    lg_error error;
    uint32_t label, sea;
    lg_riser_standard_run(numbers[run], 1, 0.58, &parameters, &how, &label, &sea);
    how.dt = dt, how.noise = 0.0;
    noise[0] = parameters.noise_acceleration, noise[1] = parameters.noise_moment;
    const double begin = clock_now();
    if (lg_riser_simulate(NULL, &parameters, &how, SAMPLES, samples, &error) != LG_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        exit(4);
    }
    return clock_now() - begin;
}

/* Adds the squares of the differences of a run, and of the reference, by group of channels. */
static void add(const float *x, const float *y, double *difference, double *size) {
    for (size_t i = 0; i < SIZE; i++) {
        const size_t group = i % CHANNELS / 2;
        difference[group] += pow((double)x[i] - (double)y[i], 2);
        size[group] += pow((double)y[i], 2);
    }
}

int main(int argc, char **argv) {
    const int levels = argc == 2 ? atoi(argv[1]) : 0;
    if (levels < 1 || levels > 12) return 2;
    for (size_t r = 0; r < RUNS; r++) (void)simulate(r, ldexp(0.2, -levels - 1), reference[r]);
    printf("{\"reference\": %.6g, \"points\": [", ldexp(0.2, -levels - 1));
    for (int level = 0; level < levels; level++) {
        const double dt = ldexp(0.2, -level);
        double seconds = 0, difference[GROUPS] = {0}, size[GROUPS] = {0};
        for (size_t r = 0; r < RUNS; r++) {
            double least = INFINITY;
            for (int again = 0; again < 3; again++) least = fmin(least, simulate(r, dt, now_at));
            seconds += least / RUNS;
            add(now_at, reference[r], difference, size);
        }
        printf("%s{\"dt\": %.6g, \"seconds\": %.4g, \"error\": [", level > 0 ? ", " : "", dt, seconds);
        for (size_t g = 0; g < GROUPS; g++)
            printf("%s%.4g", g > 0 ? ", " : "", sqrt(difference[g] / (RUNS * SAMPLES * 2)));
        printf("], \"relative\": [");
        for (size_t g = 0; g < GROUPS; g++)
            printf("%s%.4g", g > 0 ? ", " : "", sqrt(difference[g] / size[g]));
        printf("]}");
    }
    printf("], \"noise\": [%g, %g]}\n", noise[0], noise[1]);
    return 0;
}

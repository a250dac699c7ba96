/* Timing of all cases, and helpers for them. */
#include <math.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>

#include "lg-bench/bench.h"

enum { SAMPLES = 101, SAMPLES_LEAST = 5, SEED = 20240229 };
/* A sample takes at least this long, so that the clock's resolution does not matter. */
static const double sample_seconds = 4e-4;
static const double warm_seconds = 0.1, patience = 4.0;

int bench_pin(void) {
    cpu_set_t allowed, one;
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) return -1;
    for (int core = CPU_SETSIZE - 1; core >= 0; core--) {
        if (!CPU_ISSET(core, &allowed)) continue;
        CPU_ZERO(&one);
        CPU_SET(core, &one);
        return sched_setaffinity(0, sizeof one, &one) == 0 ? core : -1;
    }
    return -1;
}

bool bench_wanted(const bench *b, const char *name) {
    return b->given->only == NULL || strstr(name, b->given->only) != NULL;
}

/* Returns the sorted sample of nearest rank for the fraction f: about f of all samples are not larger. */
static double quantile(const double *sorted, size_t count, double f) {
    const double rank = ceil(f * (double)count);
    const size_t i = rank < 1 ? 0 : (size_t)rank - 1;
    return sorted[i < count ? i : count - 1];
}

bench_row *bench_from_samples(bench *b, const char *name, double *us, size_t count) {
    if (b->rows == BENCH_ROWS || count == 0) return NULL;
    bench_row *row = &b->row[b->rows++];
    *row = (bench_row){.samples = count, .inner = 1, .error = NAN, .rate = NAN};
    (void)snprintf(row->name, sizeof row->name, "%s", name);
    row->median_us = lg_median(us, count);
    row->min_us = us[0];
    row->p10_us = quantile(us, count, 0.1);
    row->p90_us = quantile(us, count, 0.9);
    return row;
}

static double time_calls(void (*call)(void *user), void *user, uint64_t calls) {
    const double start = app_seconds();
    for (uint64_t i = 0; i < calls; i++) call(user);
    return app_seconds() - start;
}

/* Calls the function until the processor is warm, and returns the seconds of one call. `brief`: makes only
 * one call. */
static double warm_up(void (*call)(void *user), void *user, bool brief) {
    double one = time_calls(call, user, 1), spent = one;
    for (uint64_t calls = 1; !brief && spent < warm_seconds; calls *= 2) {
        const double t = time_calls(call, user, calls);
        spent += t;
        one = t / (double)calls;
    }
    return one;
}

bench_row *bench_measure(bench *b, const char *name, void (*call)(void *user), void *user) {
    if (!bench_wanted(b, name)) return NULL;
    const uint64_t asked = b->given->repeats;
    const double one = warm_up(call, user, asked == 1), ratio = sample_seconds / (one > 1e-9 ? one : 1e-9);
    const uint64_t inner = ratio > 1 ? (uint64_t)ceil(ratio) : 1;
    const double fitting = patience / (one * (double)inner);
    uint64_t samples = asked > 0 ? asked : fitting < SAMPLES ? (uint64_t)fitting : SAMPLES;
    if (asked == 0 && samples < SAMPLES_LEAST) samples = SAMPLES_LEAST;
    double *us = app_alloc(samples, sizeof *us);
    for (uint64_t i = 0; i < samples && !app_interrupted(); i++)
        us[i] = time_calls(call, user, inner) * 1e6 / (double)inner;
    bench_row *row = bench_from_samples(b, name, us, (size_t)samples);
    if (row != NULL) row->inner = inner;
    free(us);
    return row;
}

void bench_note_add(bench_row *row, const char *name, double value) {
    if (row->notes < BENCH_NOTES) row->note[row->notes++] = (bench_note){name, value};
}

/* ---- helpers ---- */

void bench_check(const bench *b, lg_status status, const char *what) {
    if (status != LG_OK) exit(app_fail(b->app, status, "%s: %s", what, lg_status_sentence(status)));
}

void bench_check_tape(const bench *b, const lg_tape *tape) {
    const lg_status status = lg_tape_status(tape);
    if (status != LG_OK) exit(app_fail(b->app, status, "%s", lg_tape_message(tape)));
}

lg_tape *bench_tape(const bench *b, lg_dtype dtype, int threads) {
    lg_tape_options options;
    lg_tape *tape = NULL;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    options.threads = threads;
    bench_check(b, lg_tape_create(b->app->context, &options, &tape), "making a tape");
    return tape;
}

size_t bench_size(lg_dtype dtype) {
    return dtype == LG_F64 ? sizeof(double) : sizeof(float);
}

void *bench_typed(lg_dtype dtype, const double *x, size_t n) {
    void *out = app_alloc(n, bench_size(dtype));
    for (size_t i = 0; i < n; i++)
        if (dtype == LG_F64)
            ((double *)out)[i] = x[i];
        else
            ((float *)out)[i] = (float)x[i];
    return out;
}

double *bench_doubles(lg_dtype dtype, const void *x, size_t n) {
    double *out = app_alloc(n, sizeof *out);
    for (size_t i = 0; i < n; i++)
        out[i] = dtype == LG_F64 ? ((const double *)x)[i] : (double)((const float *)x)[i];
    return out;
}

double *bench_uniform(size_t n, uint64_t stream) {
    lg_rng rng;
    lg_rng_seed(&rng, SEED, stream);
    double *x = app_alloc(n, sizeof *x);
    for (size_t i = 0; i < n; i++) x[i] = lg_rng_uniform_in(&rng, -1, 1);
    return x;
}

double *bench_parameters(const lg_mlp *net) {
    lg_rng rng;
    lg_rng_seed(&rng, SEED, 0);
    double *theta = app_alloc(lg_mlp_parameters(net), sizeof *theta);
    lg_mlp_initialise(net, &rng, theta);
    return theta;
}

lg_mlp bench_net(const bench *b, uint32_t inputs, uint32_t width, uint32_t hidden, uint32_t outputs,
                 bool last_bias) {
    uint32_t widths[LG_MLP_MAX_LAYERS];
    lg_mlp net;
    for (uint32_t i = 0; i < hidden && i < LG_MLP_MAX_LAYERS; i++) widths[i] = width;
    bench_check(b, lg_mlp_init(&net, inputs, widths, hidden, outputs, LG_TANH, last_bias),
                "making a network");
    return net;
}

void bench_write_doubles(const bench *b, const char *ending, const double *x, size_t n) {
    APP_FREE char *path = app_format("%s.%s", b->given->out, ending);
    app_file file;
    app_file_begin(&file, path);
    (void)fwrite(x, sizeof *x, n, file.stream);
    APP_MUST_FILE(b->app, path, app_file_end(&file, &error));
}

double bench_difference(const double *x, const double *reference, size_t n) {
    double difference = 0, largest = 0;
    for (size_t i = 0; i < n; i++) {
        const double d = fabs(x[i] - reference[i]);
        if (!isfinite(d)) return NAN;
        if (d > difference) difference = d;
        if (fabs(reference[i]) > largest) largest = fabs(reference[i]);
    }
    return largest > 0 ? difference / largest : difference;
}

const uint64_t *bench_batches(const bench *b, size_t *count) {
    *count = 1;
    if (b->given->batch > 0) return &b->given->batch;
    for (*count = 0; *count < LG_COUNT(b->what->batches) && b->what->batches[*count] > 0;) ++*count;
    return b->what->batches;
}

/* Features of all windows of a series, computed by several threads. */
#include <math.h>

#include "anomaly/classify/features.h"
#include "anomaly/judge.h"

typedef struct table {
    const lg_features *features;
    double *out;
} table;

static lg_status compute_row(void *user, size_t i, const float *x, void *work) {
    const table *t = user;
    return lg_features_compute(t->features, x, t->out + i * t->features->count, work);
}

/* The first window that has a feature which is not finite. */
static size_t first_unfit(const table *t) {
    size_t i = 0;
    while (isfinite(t->out[i])) i++;
    return i / t->features->count;
}

lg_status lg_features_table(const lg_context *context, const lg_features *features, const lg_series *series,
                            const lg_windows *windows, int threads, double *out, lg_error *error) {
    if (features == NULL || series == NULL || windows == NULL || out == NULL || threads < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "an argument is NULL, or there is less than one thread");
    if (series->channels != features->channels || windows->length != features->length)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "the features are for windows of %u channels and %u samples, but these windows have %u and %u",
            features->channels, features->length, series->channels, windows->length);
    table t = {features, out};
    const lg_window_list all = {.count = windows->count};
    const lg_status status = lg_windows_each(context, series, windows, &all, (uint64_t)threads,
                                             lg_features_work_size(features), compute_row, &t);
    if (status == LG_NOT_FINITE)
        return lg_fail(error, status, "features of window %zu: %s", first_unfit(&t),
                       lg_status_sentence(status));
    return status == LG_OK ? LG_OK : lg_fail(error, status, "features: %s", lg_status_sentence(status));
}

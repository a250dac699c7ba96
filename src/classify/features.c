/* Features of windows. */
#include "classify/classify_internal.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define SEGMENTS 10

static const char *const kind_names[LG_FEATURE_KIND_COUNT] = {
    [LG_FEATURES_RAW] = "raw",
    [LG_FEATURES_STD] = "std",
    [LG_FEATURES_COV] = "cov",
    [LG_FEATURES_BASELINE] = "baseline",
};

const char *lg_feature_kind_name(lg_feature_kind kind) {
    return (unsigned)kind < LG_FEATURE_KIND_COUNT ? kind_names[kind] : "unknown";
}

lg_status lg_feature_kind_parse(const char *name, lg_feature_kind *out) {
    if (name == NULL || out == NULL) return LG_INVALID_ARGUMENT;
    for (int i = 0; i < LG_FEATURE_KIND_COUNT; i++)
        if (strcmp(name, kind_names[i]) == 0) {
            *out = (lg_feature_kind)i;
            return LG_OK;
        }
    return LG_NOT_FOUND;
}

/* ---- which channels ---- */

static bool has_names(const lg_series *series) {
    return series->channel_name != NULL;
}

static bool ends_in(const char *text, const char *end) {
    const size_t a = strlen(text), b = strlen(end);
    return a >= b && strcmp(text + a - b, end) == 0;
}

/* What follows `start` in `text`, or NULL. */
static const char *after(const char *text, const char *start) {
    const size_t length = strlen(start);
    return strncmp(text, start, length) == 0 ? text + length : NULL;
}

static bool is_x(const lg_series *series, uint32_t channel) {
    return has_names(series) ? ends_in(series->channel_name[channel], "_x") : channel % 2 == 0;
}

/* The moment that goes with acceleration `channel`, or UINT32_MAX. Without names two sensors of accelerations
 * stand before that of the moments, each (x, y). */
static uint32_t moment_of(const lg_series *series, uint32_t channel) {
    if (!has_names(series)) return channel < 2 && channel + 4 < series->channels ? channel + 4 : UINT32_MAX;
    const char *direction = after(series->channel_name[channel], "acc_lower");
    if (direction == NULL) return UINT32_MAX;
    for (uint32_t i = 0; i < series->channels; i++) {
        const char *other = after(series->channel_name[i], "moment");
        if (other != NULL && strcmp(other, direction) == 0) return i;
    }
    return UINT32_MAX;
}

static void choose_channels(const lg_series *series, bool directions_x, lg_features *f) {
    for (uint32_t i = 0; i < series->channels; i++) {
        if (directions_x && !is_x(series, i)) continue;
        f->select[f->selected++] = i;
        const uint32_t moment = f->kind == LG_FEATURES_BASELINE ? moment_of(series, i) : UINT32_MAX;
        if (moment == UINT32_MAX) continue;
        f->pair[2 * f->pairs] = i;
        f->pair[2 * f->pairs + 1] = moment;
        f->pairs++;
    }
}

uint64_t lg_features_count(const lg_features *f) {
    const uint64_t m = f->selected;
    switch (f->kind) {
    case LG_FEATURES_RAW:
        return m * f->length;
    case LG_FEATURES_STD:
        return m;
    case LG_FEATURES_COV:
        return m * (m + 1) / 2;
    default:
        return 2 * (uint64_t)f->pairs;
    }
}

static lg_status check_create(lg_feature_kind kind, const lg_series *series, uint32_t length,
                              const lg_scaler *scaler, lg_error *error) {
    if ((unsigned)kind >= LG_FEATURE_KIND_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "no such kind of features");
    if (series->channels == 0 || length == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "windows of %u channels and %u samples have no features",
                       series->channels, length);
    if (series->channels > LG_FEATURES_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%u channels are more than %u", series->channels,
                       LG_FEATURES_MAX);
    if (kind == LG_FEATURES_BASELINE && length < SEGMENTS)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a window of %u samples is too short for the baseline, which cuts it into %d parts",
                       length, SEGMENTS);
    if (scaler == NULL) return LG_OK;
    if (scaler->channels != series->channels)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the scaler is for %u channels, the series has %u",
                       scaler->channels, series->channels);
    for (uint32_t i = 0; i < scaler->channels; i++)
        if (!(scaler->scale[i] > 0.0) || !isfinite(scaler->scale[i]))
            return lg_fail(error, LG_INVALID_ARGUMENT, "the scale of channel %u is %g", i, scaler->scale[i]);
    return LG_OK;
}

static lg_status check_made(const lg_features *f, bool directions_x, lg_error *error) {
    if (f->selected == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "no channel is of the x-direction: none has a name that ends in _x");
    if (f->kind == LG_FEATURES_BASELINE && f->pairs == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the baseline needs a lower acceleration and a moment of the same direction%s: "
                       "channels acc_lower_x and moment_x, or acc_lower_y and moment_y; without names "
                       "channels 0 and 4, or 1 and 5",
                       directions_x ? " (x)" : "");
    const uint64_t count = lg_features_count(f);
    if (count > LG_FEATURES_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%llu features of kind %s are more than %u: take a shorter window or fewer channels",
                       (unsigned long long)count, lg_feature_kind_name(f->kind), LG_FEATURES_MAX);
    return LG_OK;
}

lg_status lg_features_create(const lg_context *context, lg_feature_kind kind, bool directions_x,
                             const lg_series *series, uint32_t length, const lg_scaler *scaler,
                             lg_features *out, lg_error *error) {
    (void)lg_fail(error, LG_OK, "%s", "");
    if (series == NULL || out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "an argument is NULL");
    LG_TRY(check_create(kind, series, length, scaler, error));
    lg_features f = {.kind = kind, .channels = series->channels, .length = length};
    f.select = lg_alloc(context, f.channels, sizeof *f.select);
    f.pair = lg_alloc(context, 2 * (size_t)f.channels, sizeof *f.pair);
    f.scale = lg_alloc(context, f.channels, sizeof *f.scale);
    lg_status status = LG_OK;
    if (f.select == NULL || f.pair == NULL || f.scale == NULL) {
        status = lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the features of %u channels", f.channels);
    } else {
        f.segments = kind == LG_FEATURES_BASELINE ? SEGMENTS : 0;
        for (uint32_t i = 0; i < f.channels; i++) f.scale[i] = scaler != NULL ? scaler->scale[i] : 1.0;
        choose_channels(series, directions_x, &f);
        status = check_made(&f, directions_x, error);
    }
    if (status != LG_OK) {
        lg_features_free(context, &f);
        return status;
    }
    f.count = (uint32_t)lg_features_count(&f);
    *out = f;
    return LG_OK;
}

void lg_features_free(const lg_context *context, lg_features *features) {
    if (features == NULL) return;
    lg_free(context, features->select);
    lg_free(context, features->pair);
    lg_free(context, features->scale);
    *features = (lg_features){0};
}

/* ---- numbers ---- */

size_t lg_features_work(const lg_features *f) {
    const size_t m = f->selected, length = f->length;
    if (f->kind == LG_FEATURES_COV) return m * length + m * m + m + lg_eigen_work(m);
    return length + 2 * (size_t)f->segments;
}

static bool is_constant(const float *x, size_t length) {
    size_t i = 1;
    while (i < length && x[i] == x[0]) i++;
    return i >= length;
}

/* z (length) = (x - mean)/scale. Returns the standard deviation of z, denominator `length`. A constant gives
 * zeros, not what rounding would leave: standardisation would blow that up. */
static double centre(const float *x, size_t length, double scale, double *z) {
    if (is_constant(x, length)) {
        memset(z, 0, length * sizeof *z);
        return 0.0;
    }
    for (size_t i = 0; i < length; i++) z[i] = (double)x[i] / scale;
    const double mean = lg_sum_of(z, length) / (double)length;
    for (size_t i = 0; i < length; i++) z[i] -= mean;
    const double rest = lg_sum_of(z, length) / (double)length; /* what rounding left of the mean */
    return sqrt(fmax(0.0, lg_dot(z, z, length) / (double)length - rest * rest));
}

static lg_status compute_raw(const lg_features *f, const float *x, double *out, double *work) {
    (void)work;
    for (uint32_t i = 0; i < f->selected; i++) {
        const float *channel = x + (size_t)f->select[i] * f->length;
        for (uint32_t t = 0; t < f->length; t++) *out++ = (double)channel[t];
    }
    return LG_OK;
}

static lg_status compute_std(const lg_features *f, const float *x, double *out, double *work) {
    for (uint32_t i = 0; i < f->selected; i++)
        out[i] = centre(x + (size_t)f->select[i] * f->length, f->length, 1.0, work);
    return LG_OK;
}

/* Upper triangle of V max(L, 0)^(1/2) V^T of the covariance V L V^T: rounding makes eigenvalues of singular
 * covariances slightly negative. */
static lg_status compute_cov(const lg_features *f, const float *x, double *out, double *work) {
    const size_t m = f->selected, length = f->length;
    double *z = work, *a = z + m * length, *values = a + m * m, *rest = values + m;
    for (size_t i = 0; i < m; i++) {
        const uint32_t channel = f->select[i];
        (void)centre(x + (size_t)channel * length, length, f->scale[channel], z + i * length);
    }
    for (size_t i = 0; i < m; i++)
        for (size_t j = i; j < m; j++) {
            a[i * m + j] = lg_dot(z + i * length, z + j * length, length) / (double)length;
            if (!isfinite(a[i * m + j])) return LG_NOT_FINITE;
        }
    LG_TRY(lg_eigen(a, m, values, rest));
    for (size_t k = 0; k < m; k++) {
        const double root = sqrt(sqrt(fmax(values[k], 0.0)));
        for (size_t i = 0; i < m; i++) a[k * m + i] *= root;
    }
    for (size_t i = 0; i < m; i++)
        for (size_t j = i; j < m; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < m; k++) sum += a[k * m + i] * a[k * m + j];
            *out++ = sum;
        }
    return LG_OK;
}

static double deviation_of_part(const lg_features *f, const float *x, uint32_t channel, uint32_t part,
                                double *work) {
    const size_t first = (size_t)part * f->length / f->segments;
    const size_t last = ((size_t)part + 1) * f->length / f->segments;
    return centre(x + (size_t)channel * f->length + first, last - first, f->scale[channel], work);
}

/* Least squares y = intercept + slope x. */
static void regress(const double *x, const double *y, size_t n, double *intercept, double *slope) {
    double mx = 0.0, my = 0.0, largest = 0.0, xx = 0.0, xy = 0.0;
    for (size_t i = 0; i < n; i++) {
        mx += x[i] / (double)n;
        my += y[i] / (double)n;
        largest = fmax(largest, fabs(x[i]));
    }
    for (size_t i = 0; i < n; i++) {
        xx += (x[i] - mx) * (x[i] - mx);
        xy += (x[i] - mx) * (y[i] - my);
    }
    const double rounding = 0x1p-48 * largest;
    *slope = xx > (double)n * rounding * rounding ? xy / xx : 0.0;
    *intercept = my - *slope * mx;
}

static lg_status compute_baseline(const lg_features *f, const float *x, double *out, double *work) {
    double *acceleration = work + f->length, *moment = acceleration + f->segments;
    for (uint32_t p = 0; p < f->pairs; p++) {
        for (uint32_t s = 0; s < f->segments; s++) {
            acceleration[s] = deviation_of_part(f, x, f->pair[2 * p], s, work);
            moment[s] = deviation_of_part(f, x, f->pair[2 * p + 1], s, work);
        }
        regress(acceleration, moment, f->segments, &out[2 * p], &out[2 * p + 1]);
    }
    return LG_OK;
}

lg_status lg_features_compute(const lg_features *features, const float *x, double *out, double *work) {
    static lg_status (*const compute[LG_FEATURE_KIND_COUNT])(const lg_features *, const float *, double *,
                                                             double *) = {
        [LG_FEATURES_RAW] = compute_raw,
        [LG_FEATURES_STD] = compute_std,
        [LG_FEATURES_COV] = compute_cov,
        [LG_FEATURES_BASELINE] = compute_baseline,
    };
    LG_TRY(compute[features->kind](features, x, out, work));
    for (uint32_t i = 0; i < features->count; i++)
        if (!isfinite(out[i])) return LG_NOT_FINITE;
    return LG_OK;
}

/* ---- names ---- */

static int channel_name(const lg_series *series, uint32_t channel, char *text, size_t size) {
    if (series != NULL && channel < series->channels && has_names(series) &&
        series->channel_name[channel][0] != '\0')
        return snprintf(text, size, "%.*s", LG_SERIES_NAME - 1, series->channel_name[channel]);
    return snprintf(text, size, "%u", channel);
}

/* Row and column of entry `index` of an upper triangle, row by row. */
static void entry_of(uint32_t m, uint32_t index, uint32_t *row, uint32_t *column) {
    *row = 0;
    while (index >= m - *row) index -= m - (*row)++;
    *column = *row + index;
}

int lg_features_name(const lg_features *f, const lg_series *series, uint32_t index, char *text, size_t size) {
    char first[LG_SERIES_NAME], second[LG_SERIES_NAME];
    if (index >= f->count) return snprintf(text, size, "unknown");
    uint32_t i = index, j = 0;
    switch (f->kind) {
    case LG_FEATURES_RAW:
        (void)channel_name(series, f->select[index / f->length], first, sizeof first);
        return snprintf(text, size, "raw %s %u", first, index % f->length);
    case LG_FEATURES_STD:
        (void)channel_name(series, f->select[index], first, sizeof first);
        return snprintf(text, size, "std %s", first);
    case LG_FEATURES_COV:
        entry_of(f->selected, index, &i, &j);
        (void)channel_name(series, f->select[i], first, sizeof first);
        (void)channel_name(series, f->select[j], second, sizeof second);
        return snprintf(text, size, "cov %s %s", first, second);
    default:
        (void)channel_name(series, f->pair[index / 2 * 2], first, sizeof first);
        (void)channel_name(series, f->pair[index / 2 * 2 + 1], second, sizeof second);
        return snprintf(text, size, "%s %s %s", index % 2 == 0 ? "intercept" : "slope", second, first);
    }
}

/* ---- tables ---- */

typedef struct table_job {
    const lg_context *context;
    const lg_features *features;
    const lg_series *series;
    const lg_windows *windows;
    double *out;
    size_t parts, work; /* doubles of a part: `work` and the window */
    double *memory;     /* (parts, work) */
    lg_status *status;  /* (parts) */
    size_t *failed;     /* (parts): the window that failed */
} table_job;

static size_t window_doubles(const lg_features *f) {
    return ((size_t)f->channels * f->length + 1) / 2;
}

static void table_part(void *user, size_t part) {
    const table_job *job = user;
    const size_t n = job->windows->count;
    double *work = job->memory + part * job->work;
    float *x = (float *)(void *)(work + lg_features_work(job->features));
    for (size_t i = n * part / job->parts; i < n * (part + 1) / job->parts; i++) {
        lg_windows_copy(job->series, job->windows, i, x);
        lg_status status = lg_features_compute(job->features, x, job->out + i * job->features->count, work);
        if (status == LG_OK && lg_cancelled(job->context)) status = LG_CANCELLED;
        if (status == LG_OK) continue;
        job->status[part] = status;
        job->failed[part] = i;
        return;
    }
}

static lg_status run_table(table_job *job, int threads, lg_error *error) {
    lg_pool *pool = NULL;
    const lg_status made = lg_pool_create(job->context, threads, &pool);
    if (made != LG_OK) return lg_fail(error, made, "%d threads could not be started", threads);
    lg_pool_run(pool, job->parts, table_part, job);
    lg_pool_destroy(pool);
    for (size_t i = 0; i < job->parts; i++)
        if (job->status[i] != LG_OK)
            return lg_fail(error, job->status[i], "features of window %zu: %s", job->failed[i],
                           lg_status_sentence(job->status[i]));
    return LG_OK;
}

lg_status lg_features_table(const lg_context *context, const lg_features *features, const lg_series *series,
                            const lg_windows *windows, int threads, double *out, lg_error *error) {
    (void)lg_fail(error, LG_OK, "%s", "");
    if (features == NULL || series == NULL || windows == NULL || out == NULL || threads < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "an argument is missing, or fewer than one thread");
    if (series->channels != features->channels || windows->length != features->length)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the features are of windows of %u channels and %u samples, these have %u and %u",
                       features->channels, features->length, series->channels, windows->length);
    if (windows->count == 0) return LG_OK;
    table_job job = {context, features, series, windows, out, 0, 0, NULL, NULL, NULL};
    job.parts = (size_t)threads < windows->count ? (size_t)threads : windows->count;
    job.work = (lg_features_work(features) + window_doubles(features) + 7) / 8 * 8;
    job.memory = lg_alloc(context, job.parts, job.work * sizeof *job.memory);
    job.status = lg_alloc(context, job.parts, sizeof *job.status);
    job.failed = lg_alloc(context, job.parts, sizeof *job.failed);
    lg_status status = LG_OUT_OF_MEMORY;
    if (job.memory == NULL || job.status == NULL || job.failed == NULL)
        (void)lg_fail(error, status, "no memory for features by %d threads", threads);
    else
        status = run_table(&job, (int)job.parts, error);
    lg_free(context, job.memory);
    lg_free(context, job.status);
    lg_free(context, job.failed);
    return status;
}

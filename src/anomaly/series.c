/* Sets of time series: memory, windows, scaling. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/clean.h"
#include "liegrad/ops.h"
#include "liegrad/series.h"

/* ---- memory ---- */

lg_status lg_series_allocate(const lg_context *context, lg_series *series, bool with_group, bool with_run) {
    if (series == NULL || series->count == 0 || series->channels == 0 || series->length == 0 ||
        series->classes == 0)
        return LG_INVALID_ARGUMENT;
    LG_CLEAN(lg_series_destroy)
    lg_series made = {.count = series->count,
                      .channels = series->channels,
                      .length = series->length,
                      .classes = series->classes,
                      .rate = series->rate,
                      .context = context};
    const uint64_t window = (uint64_t)made.channels * made.length;
    if (window > SIZE_MAX / sizeof(float)) return LG_OUT_OF_MEMORY;
    LG_TRY(LG_ALLOC_ALL(context, {&made.x, made.count, (size_t)window * sizeof(float)},
                        LG_ARRAY(made.label, made.count), LG_ARRAY(made.class_name, made.classes)));
    if (with_group) LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(made.group, made.count)));
    if (with_run) LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(made.run, made.count)));
    for (uint32_t c = 0; c < made.classes; c++)
        (void)snprintf(made.class_name[c], sizeof made.class_name[c], "%" PRIu32, c);
    return LG_GIVE(series, made);
}

void lg_series_destroy(lg_series *series) {
    if (series == NULL) return;
    LG_FREE_ALL(series->context, series->x, series->label, series->group, series->run, series->class_name,
                series->class_label, series->channel_name);
    *series = (lg_series){0};
}

/* ---- windows ---- */

/* Returns one past the last of the stored windows first, first + 1, ... that have the same label and group as
 * `first`; at most `end`. */
static size_t end_of_label(const lg_series *series, size_t first, size_t end) {
    size_t i = first + 1;
    while (i < end && series->label[i] == series->label[first] &&
           (series->group == NULL || series->group[i] == series->group[first]))
        i++;
    return i;
}

/* Cuts the run of stored windows [first, end) into windows and writes them to *out from index `at` on. If
 * out->first is NULL, the windows are only counted. Returns `at` plus the number of windows of the run. */
static size_t cut_run(const lg_series *series, size_t first, size_t end, uint64_t hop, size_t at,
                      lg_windows *out) {
    const uint64_t stored = series->length, samples = (end - first) * stored;
    /* end of the stored windows with the same label and group as the one where the window begins */
    size_t same = first;
    for (uint64_t start = 0; start + out->length <= samples; start += hop) {
        const size_t from = first + (size_t)(start / stored);
        const size_t last = first + (size_t)((start + out->length - 1) / stored);
        if (from >= same) same = end_of_label(series, from, end);
        if (last >= same) continue;
        if (out->first != NULL) {
            out->first[at] = (uint32_t)from;
            out->offset[at] = (uint32_t)(start % stored);
        }
        at++;
    }
    return at;
}

static size_t cut_all(const lg_series *series, uint64_t hop, lg_windows *out) {
    size_t at = 0;
    for (size_t first = 0, end; first < series->count; first = end) {
        const uint32_t *run = series->run; /* without runs each stored window is one */
        for (end = first + 1; run != NULL && end < series->count && run[end] == run[first];) end++;
        at = cut_run(series, first, end, hop, at, out);
    }
    return at;
}

lg_status lg_windows_create(const lg_context *context, const lg_series *series, size_t length, size_t hop,
                            lg_windows *out, lg_error *error) {
    if (series == NULL || out == NULL || series->count == 0 || series->length == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "there are no series to cut");
    if (length == 0) length = series->length;
    if (hop == 0) hop = length;
    if (length > UINT32_MAX || series->count > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%zu stored windows, cut into windows of %zu samples: both must be below 2^32",
                       series->count, length);
    LG_CLEAN(lg_windows_destroy) lg_windows made = {.length = (uint32_t)length, .context = context};
    const uint64_t all = (uint64_t)series->count * series->length;
    /* start + hop must not overflow; any hop beyond the end gives the same windows */
    const uint64_t step = hop < all ? hop : all;
    made.count = cut_all(series, step, &made);
    if (made.count == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "not one window of %zu samples fits: the series are stored in windows of %" PRIu32
                       " samples%s",
                       length, series->length,
                       series->run != NULL
                           ? ", and in no run does a class last that long"
                           : " and have no runs, so that a window cannot continue into the next stored one");
    if (made.count > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%zu windows are too many: fewer than 2^32 are possible; take a larger hop",
                       made.count);
    if (LG_ALLOC_ALL(context, LG_ARRAY(made.first, made.count), LG_ARRAY(made.offset, made.count)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the places of the windows");
    (void)cut_all(series, step, &made);
    return LG_GIVE(out, made);
}

void lg_windows_destroy(lg_windows *windows) {
    if (windows == NULL) return;
    LG_FREE_ALL(windows->context, windows->first, windows->offset);
    *windows = (lg_windows){0};
}

void lg_windows_copy(const lg_series *series, const lg_windows *windows, size_t index, float *out) {
    const size_t stored = series->length;
    size_t window = windows->first[index], offset = windows->offset[index];
    for (size_t done = 0, piece; done < windows->length; done += piece) {
        const size_t rest = windows->length - done;
        piece = stored - offset < rest ? stored - offset : rest;
        for (size_t c = 0; c < series->channels; c++)
            memcpy(out + c * windows->length + done,
                   series->x + (window * series->channels + c) * stored + offset, piece * sizeof *out);
        window++;
        offset = 0;
    }
}

/* ---- scaling ---- */

/* Mean of n samples. If all samples are equal, the mean is exactly their value. */
static double mean_of(const float *x, size_t n) {
    double sum = 0.0;
    bool constant = true;
    for (size_t i = 0; i < n; i++) {
        sum += (double)x[i];
        constant = constant && x[i] == x[0];
    }
    return constant ? (double)x[0] : sum / (double)n;
}

static double squares_about(const float *x, size_t n, double mean) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += ((double)x[i] - mean) * ((double)x[i] - mean);
    return sum;
}

/* Arguments of the passes over the windows. */
typedef struct scan {
    const lg_series *series;
    const lg_windows *windows;
    const uint32_t *chosen; /* NULL: all windows */
    size_t count;
    float *window; /* (channels, length), the window that was read last */
} scan;

static void load(const scan *s, size_t i) {
    lg_windows_copy(s->series, s->windows, s->chosen != NULL ? s->chosen[i] : i, s->window);
}

/* Averages the means of the windows, which all have the same length. For a constant channel the mean is
 * exactly its value. mean (3, channels): the rows 1 and 2 are work memory. */
static void fit_means(const scan *s, double *mean) {
    const size_t channels = s->series->channels, length = s->windows->length;
    double *first = mean + channels, *constant = mean + 2 * channels;
    for (size_t i = 0; i < s->count; i++) {
        load(s, i);
        for (size_t c = 0; c < channels; c++) {
            const float *x = s->window + c * length;
            const double here = mean_of(x, length);
            if (i == 0) first[c] = here;
            if (here != first[c] || squares_about(x, length, here) > 0.0) constant[c] = 0.0;
            mean[c] += (here - first[c]) / (double)s->count;
        }
    }
    for (size_t c = 0; c < channels; c++) mean[c] = constant[c] > 0.0 ? first[c] : first[c] + mean[c];
}

static void fit_scales(const scan *s, bool centred, const double *mean, double *scale) {
    const size_t channels = s->series->channels, length = s->windows->length;
    for (size_t i = 0; i < s->count; i++) {
        load(s, i);
        for (size_t c = 0; c < channels; c++) {
            const float *x = s->window + c * length;
            scale[c] += squares_about(x, length, centred ? mean_of(x, length) : mean[c]);
        }
    }
    for (size_t c = 0; c < channels; c++) {
        scale[c] = sqrt(scale[c] / ((double)s->count * (double)length));
        if (!(scale[c] > 0.0)) scale[c] = 1.0;
    }
}

lg_status lg_scaler_fit(const lg_context *context, const lg_series *series, const lg_windows *windows,
                        const uint32_t *chosen, size_t count, bool centred, lg_scaler *out) {
    if (series == NULL || windows == NULL || out == NULL || count == 0) return LG_INVALID_ARGUMENT;
    for (size_t i = 0; i < count; i++)
        if ((chosen != NULL ? chosen[i] : i) >= windows->count) return LG_INVALID_ARGUMENT;
    const size_t channels = series->channels;
    LG_CLEAN(lg_scaler_destroy) lg_scaler made = {.channels = series->channels, .context = context};
    LG_TRY_SCRATCH(float, window, context, channels * windows->length, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(double, mean, context, 3 * channels, LG_OUT_OF_MEMORY);
    const scan s = {series, windows, chosen, count, window};
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(made.mean, channels), LG_ARRAY(made.scale, channels)));
    for (size_t c = 0; c < channels; c++) mean[2 * channels + c] = 1.0;
    if (!centred) {
        fit_means(&s, mean);
        memcpy(made.mean, mean, channels * sizeof *mean);
    }
    fit_scales(&s, centred, made.mean, made.scale);
    return LG_GIVE(out, made);
}

void lg_scaler_destroy(lg_scaler *scaler) {
    if (scaler == NULL) return;
    LG_FREE_ALL(scaler->context, scaler->mean, scaler->scale);
    *scaler = (lg_scaler){0};
}

lg_var lg_scaler_record(lg_tape *tape, const lg_scaler *scaler, lg_var x, bool back) {
    const lg_var mean = lg_input_f64(tape, lg_shape1(scaler->channels), scaler->mean),
                 scale = lg_input_f64(tape, lg_shape1(scaler->channels), scaler->scale);
    return back ? lg_add(tape, lg_mul(tape, x, scale), mean) : lg_div(tape, lg_sub(tape, x, mean), scale);
}

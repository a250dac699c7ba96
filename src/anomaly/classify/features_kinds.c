/* The kinds of features but random convolutions, as operations on windows, and the names of features. */
#include <math.h>
#include <stdio.h>

#include "anomaly/classify/features.h"
#include "autodiff/ops/covariance.h"

/* ---- pieces ---- */

/* Standard deviations (B, m, parts) of the parts of the channels of windows x (B, channels, length) that the
 * features use, over the channels' scales if `scaled`. One that is 0 has the derivative 0. */
static lg_var deviations(lg_tape *t, const lg_features *f, bool scaled, lg_var x, uint32_t parts) {
    LG_SCRATCH(double, used, NULL, f->channels);
    if (used == NULL) return LG_NONE;
    for (uint32_t i = 0; i < lg_features_channels(f); i++) {
        const uint32_t channel = lg_features_channel(f, i);
        used[channel] = scaled ? 1 / f->scale[channel] : 1;
    }
    const lg_var factor = lg_input_f64(t, lg_shape1(f->channels), used);
    const lg_var square = lg_covariance(t, x, factor, x, parts);
    const lg_var zero = lg_ge(t, lg_neg(t, square), square);
    return lg_features_chosen(t, f, lg_sub(t, lg_sqrt(t, lg_add(t, square, zero)), zero));
}

/* x (B, ...) as rows (B, n). */
static lg_var rows_of(lg_tape *t, lg_var x) {
    const lg_shape shape = lg_var_shape(t, x);
    if (lg_is_none(x)) return x;
    return lg_reshape(t, x, lg_shape2(shape.dims[0], (uint32_t)(lg_shape_count(shape) / shape.dims[0])));
}

/* ---- samples, deviations, the root of the covariance ---- */

static uint64_t raw_count(const lg_features *f) {
    return (uint64_t)f->selected * f->length;
}

static lg_var record_raw(lg_tape *t, const lg_features *f, lg_var eps, lg_var x) {
    return rows_of(t, lg_features_chosen(t, f, x));
}

static lg_var record_std(lg_tape *t, const lg_features *f, lg_var eps, lg_var x) {
    return rows_of(t, deviations(t, f, false, x, 1));
}

static uint64_t cov_count(const lg_features *f) {
    return (uint64_t)f->selected * (f->selected + 1) / 2;
}

/* The upper triangle, row by row, of the symmetric square root of the covariance. */
static lg_var record_cov(lg_tape *t, const lg_features *f, lg_var eps, lg_var x) {
    const uint32_t m = f->selected;
    LG_SCRATCH(uint32_t, entry, NULL, f->count);
    LG_SCRATCH(double, inverse, NULL, m);
    if (entry == NULL || inverse == NULL) return LG_NONE;
    for (uint32_t i = 0; i < m; i++) inverse[i] = 1 / f->scale[f->select[i]];
    for (uint32_t i = 0, e = 0; i < m; i++)
        for (uint32_t j = i; j < m; j++) entry[e++] = i * m + j;
    const lg_var factor = lg_input_f64(t, lg_shape1(m), inverse);
    const lg_var root = lg_covariance_root(t, lg_features_chosen(t, f, x), factor);
    return lg_transpose(t, lg_gather(t, lg_transpose(t, rows_of(t, root)), entry, f->count));
}

/* ---- levels ---- */

/* Mean, minimum, maximum and slope of each channel. Mean and slope are computed from the differences between
 * the samples and the window's first sample: a large constant offset causes no rounding errors. */
static lg_var record_levels(lg_tape *t, const lg_features *f, lg_var eps, lg_var x) {
    const double n = f->length, unit = n > 1 ? 12 * f->rate / (n * (n * n - 1)) : 0;
    LG_SCRATCH(double, weight, NULL, f->length);
    if (weight == NULL) return LG_NONE;
    for (uint32_t i = 0; i < f->length; i++) weight[i] = unit * (i - 0.5 * (n - 1));
    const lg_var z = lg_features_chosen(t, f, x), high = lg_max_axis(t, z, 2, true),
                 low = lg_neg(t, lg_max_axis(t, lg_neg(t, z), 2, true)),
                 first = lg_stop_gradient(t, lg_slice(t, z, 2, 0, 1)), change = lg_sub(t, z, first),
                 mean = lg_add(t, first, lg_mean_axis(t, change, 2, true)),
                 slope = lg_matmul(t, change, lg_input_f64(t, lg_shape2(f->length, 1), weight));
    return rows_of(t, lg_concat(t, (lg_var[]){mean, low, high, slope}, 4, 2));
}

/* ---- powers ---- */

static uint64_t spectrum_count(const lg_features *f) {
    return (uint64_t)f->selected * f->bands;
}

/* From the sums of squares of coefficients (2 bins), of cosines and sines of the frequencies 1 .. bins, to
 * powers. */
static lg_var bands_of(lg_tape *t, const lg_spectrum *s) {
    LG_SCRATCH(double, band, NULL, 2 * (size_t)s->bins * s->bands);
    if (band == NULL) return LG_NONE;
    for (uint32_t b = 0; b < s->bands; b++)
        for (uint32_t k = s->edge[b]; k < s->edge[b + 1]; k++)
            for (uint32_t part = 0; part < 2; part++)
                band[(k - 1 + part * s->bins) * (size_t)s->bands + b] =
                    1.0 / (s->segments * (double)(s->edge[b + 1] - s->edge[b]));
    return lg_input_f64(t, lg_shape2(2 * s->bins, s->bands), band);
}

/* Logarithms of the power of each channel in each band, by Welch's method: convolutions with waves are the
 * coefficients of all segments. */
static lg_var record_spectrum(lg_tape *t, const lg_features *f, lg_var eps, lg_var x) {
    const lg_spectrum *s = &f->spectrum;
    LG_SCRATCH(lg_var, all, NULL, f->selected);
    if (all == NULL) return LG_NONE;
    const lg_var bands = bands_of(t, s);
    const lg_var waves = lg_input_f64(t, lg_shape3(s->segment, 1, 2 * s->bins), s->wave);
    for (uint32_t i = 0; i < f->selected; i++) {
        const double scale = f->length / f->scale[f->select[i]];
        const lg_var factor = lg_input_f64(t, lg_shape3(1, 1, 1), &scale),
                     z = lg_centre(t, lg_slice(t, x, 1, f->select[i], 1), factor),
                     column = lg_reshape(t, z, lg_shape3(lg_var_shape(t, x).dims[0], f->length, 1)),
                     coefficients = lg_conv1d(t, column, waves, s->hop > 0 ? s->hop : 1, 0);
        all[i] = lg_matmul(t, lg_sum_axis(t, lg_square(t, coefficients), 1, false), bands);
    }
    return lg_log(t, lg_add_scalar(t, lg_concat(t, all, f->selected, 1), LG_FEATURES_FLOOR));
}

/* ---- the baseline ---- */

static uint64_t baseline_count(const lg_features *f) {
    return 2 * (uint64_t)f->pairs;
}

/* Intercept and slope of each pair of channels: least squares of the parts' deviations, moment against
 * acceleration. The slope is 0 where the acceleration's deviations do not vary. */
static lg_var record_baseline(lg_tape *t, const lg_features *f, lg_var eps, lg_var x) {
    const lg_var all = deviations(t, f, true, x, f->segments);
    const lg_var a = lg_slice(t, all, 1, 0, f->pairs), m = lg_slice(t, all, 1, f->pairs, f->pairs);
    const lg_var mean_a = lg_mean_axis(t, a, 2, true), mean_m = lg_mean_axis(t, m, 2, true);
    const lg_var of_a = lg_sub(t, a, mean_a), squares = lg_rownorm2(t, of_a);
    const lg_var rounding = lg_mul(t, lg_max_axis(t, a, 2, true), eps);
    const lg_var level = lg_ge(t, lg_scale(t, lg_square(t, rounding), 256.0 * f->segments), squares);
    const lg_var products = lg_rowdot(t, of_a, lg_sub(t, m, mean_m));
    const lg_var slope =
        lg_mul(t, lg_div(t, products, lg_add(t, squares, level)), lg_add_scalar(t, lg_neg(t, level), 1));
    const lg_var both[] = {lg_sub(t, mean_m, lg_mul(t, slope, mean_a)), slope};
    return rows_of(t, lg_concat(t, both, 2, 2));
}

/* ---- names ---- */

static int describe_raw(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                        size_t size) {
    char name[LG_SERIES_NAME];
    (void)lg_channel_name(series, f->select[index / f->length], name, sizeof name);
    return snprintf(text, size, "raw %s %u", name, index % f->length);
}

static int describe_two(const char *what, uint32_t first, uint32_t second, const lg_series *series,
                        char *text, size_t size) {
    char names[2][LG_SERIES_NAME];
    (void)lg_channel_name(series, first, names[0], sizeof names[0]);
    (void)lg_channel_name(series, second, names[1], sizeof names[1]);
    return snprintf(text, size, "%s %s %s", what, names[0], names[1]);
}

/* The entries of the upper triangle are stored row by row. */
static int describe_cov(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                        size_t size) {
    uint32_t row = 0;
    while (index >= f->selected - row) index -= f->selected - row++;
    return describe_two("cov", f->select[row], f->select[row + index], series, text, size);
}

static int describe_baseline(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                             size_t size) {
    const uint32_t *pair = f->pair + index / 2 * 2;
    return describe_two(index % 2 == 0 ? "intercept" : "slope", pair[1], pair[0], series, text, size);
}

/* Bin k covers the frequencies (k - 1/2)/segment .. (k + 1/2)/segment, in cycles per sample. The last bin
 * ends at 1/2. */
static int describe_spectrum(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                             size_t size) {
    const lg_spectrum *s = &f->spectrum;
    const uint32_t band = index % f->bands;
    char name[LG_SERIES_NAME];
    (void)lg_channel_name(series, f->select[index / f->bands], name, sizeof name);
    return lg_format(text, size, "band %.3g-%.3g %s", (s->edge[band] - 0.5) / s->segment,
                     fmin((s->edge[band + 1] - 0.5) / s->segment, 0.5), name);
}

/* ---- the table ---- */

#define ROW(kind, ...)                                                                                       \
    &(const lg_feature_row) {                                                                                \
        .name = #kind, .record = record_##kind, __VA_ARGS__                                                  \
    }
#define KIND(kind, ...) ROW(kind, .count = kind##_count, .describe = describe_##kind, __VA_ARGS__)
const lg_feature_row *const lg_feature_rows[LG_FEATURE_KIND_COUNT] = {
    [LG_FEATURES_RAW] = KIND(raw, .exact = true),
    [LG_FEATURES_STD] = ROW(std, .part = {"std"}, .parts = 1),
    [LG_FEATURES_COV] = KIND(cov, ),
    [LG_FEATURES_SPECTRUM] = KIND(spectrum, .bands = 8),
    [LG_FEATURES_LEVELS] =
        ROW(levels, .part = {"mean", "min", "max", "slope"}, .parts = 4, .exact = true, .rated = true),
    [LG_FEATURES_BASELINE] = KIND(baseline, .segments = 10),
    [LG_FEATURES_ROCKET] = &lg_feature_rocket,
};

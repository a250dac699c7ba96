/* Features of single channels: the samples themselves, and standard deviations. */
#include "anomaly/classify/features.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Adds in the same order as lg_sum_of. The sum of up to 2^29 equal numbers is exact, so their mean is exact
 * too. */
static double sum_of_floats(const float *x, size_t n) {
    double lane[8] = {0};
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (size_t j = 0; j < 8; j++) lane[j] += (double)x[i + j];
    for (size_t j = 0; i < n; i++, j++) lane[j] += (double)x[i];
    return ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}

/* The mean is subtracted before the division, while x is exact. A constant channel therefore becomes exactly
 * 0, and no rounding error is left that standardisation would magnify. */
double lg_centre(const float *x, size_t length, double scale, double *z) {
    const double mean = sum_of_floats(x, length) / (double)length;
    for (size_t i = 0; i < length; i++) z[i] = ((double)x[i] - mean) / scale;
    const double rest = lg_sum_of(z, length) / (double)length; /* mean that is left because of rounding */
    for (size_t i = 0; i < length; i++) z[i] -= rest;
    return sqrt(lg_dot(z, z, length) / (double)length);
}

void lg_deviation_reverse(const double *z, size_t n, double deviation, double scale, double cotangent,
                          double *gradient) {
    if (!(deviation > 0.0)) return;
    const double factor = cotangent / ((double)n * deviation * scale);
    for (size_t t = 0; t < n; t++) gradient[t] += factor * z[t];
}

/* ---- raw: the samples themselves ---- */

static uint64_t raw_count(const lg_features *f) {
    return (uint64_t)f->selected * f->length;
}

static size_t raw_work(const lg_features *f) {
    return f->length;
}

static lg_status compute_raw(const lg_features *f, const float *x, double *out, double *work) {
    for (uint32_t i = 0; i < f->selected; i++) {
        const float *channel = x + (size_t)f->select[i] * f->length;
        for (uint32_t t = 0; t < f->length; t++) *out++ = (double)channel[t];
    }
    return LG_OK;
}

static void reverse_raw(const lg_features *f, const double *cotangent, double *work, double *gradient) {
    for (uint32_t i = 0; i < f->selected; i++, cotangent += f->length)
        memcpy(gradient + (size_t)f->select[i] * f->length, cotangent, f->length * sizeof *gradient);
}

static int describe_raw(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                        size_t size) {
    char name[LG_SERIES_NAME];
    (void)lg_channel_name(series, f->select[index / f->length], name, sizeof name);
    return snprintf(text, size, "raw %s %u", name, index % f->length);
}

const lg_feature_row lg_feature_raw = {.name = "raw",
                                       .count = raw_count,
                                       .work = raw_work,
                                       .compute = compute_raw,
                                       .reverse = reverse_raw,
                                       .describe = describe_raw};

/* ---- std: standard deviations. work: the centred channels (m, length), then the deviations (m) ---- */

static uint64_t std_count(const lg_features *f) {
    return f->selected;
}

static size_t std_work(const lg_features *f) {
    const size_t m = f->selected;
    return m * f->length + m;
}

static lg_status compute_std(const lg_features *f, const float *x, double *out, double *work) {
    double *deviation = work + (size_t)f->selected * f->length;
    for (size_t i = 0; i < f->selected; i++)
        out[i] = deviation[i] =
            lg_centre(x + (size_t)f->select[i] * f->length, f->length, 1.0, work + i * f->length);
    return LG_OK;
}

static void reverse_std(const lg_features *f, const double *cotangent, double *work, double *gradient) {
    const double *deviation = work + (size_t)f->selected * f->length;
    for (size_t i = 0; i < f->selected; i++)
        lg_deviation_reverse(work + i * f->length, f->length, deviation[i], 1.0, cotangent[i],
                             gradient + (size_t)f->select[i] * f->length);
}

static int describe_std(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                        size_t size) {
    char name[LG_SERIES_NAME];
    (void)lg_channel_name(series, f->select[index], name, sizeof name);
    return snprintf(text, size, "std %s", name);
}

const lg_feature_row lg_feature_std = {.name = "std",
                                       .count = std_count,
                                       .work = std_work,
                                       .compute = compute_std,
                                       .reverse = reverse_std,
                                       .describe = describe_std};

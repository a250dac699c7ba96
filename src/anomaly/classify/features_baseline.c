/* Features of pairs of channels (an acceleration and a moment). Each window is cut into parts, and the
 * standard deviation of both channels is taken in each part. The features are the regression line of the
 * moment's deviations on the acceleration's deviations. */
#include "anomaly/classify/features.h"

#include <math.h>
#include <stdio.h>

/* Layout of `work`: numbers that compute_baseline keeps for the derivative. */
typedef struct kept {
    double *z;         /* (pairs, 2, length): scaled channels, centred in each part */
    double *deviation; /* (pairs, 2, segments): standard deviation in each part */
} kept;

static kept keep_in(const lg_features *f, double *work) {
    return (kept){.z = work, .deviation = work + 2 * (size_t)f->pairs * f->length};
}

static size_t baseline_work(const lg_features *f) {
    return 2 * (size_t)f->pairs * ((size_t)f->length + f->segments);
}

static uint64_t baseline_count(const lg_features *f) {
    return 2 * (uint64_t)f->pairs;
}

/* The samples first .. last - 1 of a window. */
typedef struct stretch {
    size_t first, last;
} stretch;

static stretch part_of(const lg_features *f, uint32_t number) {
    return (stretch){(size_t)number * f->length / f->segments,
                     ((size_t)number + 1) * f->length / f->segments};
}

/* Least-squares line y = intercept + slope x through n points: the means, xx = sum of (x - mean_x)^2, and the
 * slope. */
typedef struct line {
    double mean_x, mean_y, xx, slope;
    bool level; /* x does not vary; then the slope is 0 */
} line;

static line regress(const double *x, const double *y, size_t n) {
    line l = {0};
    double largest = 0.0, xy = 0.0;
    for (size_t i = 0; i < n; i++) {
        l.mean_x += x[i] / (double)n;
        l.mean_y += y[i] / (double)n;
        largest = fmax(largest, fabs(x[i]));
    }
    for (size_t i = 0; i < n; i++) {
        l.xx += (x[i] - l.mean_x) * (x[i] - l.mean_x);
        xy += (x[i] - l.mean_x) * (y[i] - l.mean_y);
    }
    const double rounding = 0x1p-48 * largest;
    l.level = !(l.xx > (double)n * rounding * rounding);
    l.slope = l.level ? 0.0 : xy / l.xx;
    return l;
}

static lg_status compute_baseline(const lg_features *f, const float *x, double *out, double *work) {
    const kept k = keep_in(f, work);
    for (size_t p = 0; p < f->pairs; p++) {
        const double *deviation = k.deviation + 2 * p * f->segments;
        for (size_t side = 0; side < 2; side++) {
            const size_t row = 2 * p + side, channel = f->pair[row];
            for (uint32_t s = 0; s < f->segments; s++) {
                const stretch at = part_of(f, s);
                k.deviation[row * f->segments + s] =
                    lg_centre(x + channel * f->length + at.first, at.last - at.first, f->scale[channel],
                              k.z + row * f->length + at.first);
            }
        }
        const line l = regress(deviation, deviation + f->segments, f->segments);
        out[2 * p] = l.mean_y - l.slope * l.mean_x;
        out[2 * p + 1] = l.slope;
    }
    return LG_OK;
}

/* ---- derivative ---- */

/* Derivatives of slope and intercept with respect to the deviations x_s, y_s of part s:
 *   d slope/dy_s = (x_s - mean x)/xx,  d slope/dx_s = (y_s - mean y - 2 slope (x_s - mean x))/xx,
 *   d intercept = d mean y - slope d mean x - mean x d slope. */
static void reverse_line(const line *l, size_t n, double x, double y, const double *cotangent, double *by_x,
                         double *by_y) {
    const double to_slope = l->level ? 0.0 : (cotangent[1] - l->mean_x * cotangent[0]) / l->xx;
    *by_y = cotangent[0] / (double)n + to_slope * (x - l->mean_x);
    *by_x = -l->slope * cotangent[0] / (double)n +
            to_slope * ((y - l->mean_y) - 2.0 * l->slope * (x - l->mean_x));
}

static void reverse_baseline(const lg_features *f, const double *cotangent, double *work, double *gradient) {
    const kept k = keep_in(f, work);
    const size_t n = f->segments, length = f->length;
    for (size_t p = 0; p < f->pairs; p++, cotangent += 2) {
        const double *x = k.deviation + 2 * p * n, *y = x + n;
        const line l = regress(x, y, n);
        for (uint32_t s = 0; s < n; s++) {
            const stretch at = part_of(f, s);
            double by[2];
            reverse_line(&l, n, x[s], y[s], cotangent, &by[0], &by[1]);
            for (size_t side = 0; side < 2; side++) {
                const size_t row = 2 * p + side, channel = f->pair[row];
                lg_deviation_reverse(k.z + row * length + at.first, at.last - at.first, x[side * n + s],
                                     f->scale[channel], by[side], gradient + channel * length + at.first);
            }
        }
    }
}

static int describe_baseline(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                             size_t size) {
    const uint32_t *pair = f->pair + index / 2 * 2;
    char first[LG_SERIES_NAME], second[LG_SERIES_NAME];
    (void)lg_channel_name(series, pair[0], first, sizeof first);
    (void)lg_channel_name(series, pair[1], second, sizeof second);
    return snprintf(text, size, "%s %s %s", index % 2 == 0 ? "intercept" : "slope", second, first);
}

const lg_feature_row lg_feature_baseline = {.name = "baseline",
                                            .segments = 10,
                                            .count = baseline_count,
                                            .work = baseline_work,
                                            .compute = compute_baseline,
                                            .reverse = reverse_baseline,
                                            .describe = describe_baseline};

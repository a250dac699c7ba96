/* Features of windows. */
#include "classify/classify_internal.h"

#include <float.h>
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

/* The moment that belongs to acceleration `channel`, or UINT32_MAX. Without names the channels are two
 * acceleration sensors and then the moments, each (x, y). */
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
    lg_features f = {.kind = kind, .channels = series->channels, .length = length, .context = context};
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
        lg_features_destroy(&f);
        return status;
    }
    f.count = (uint32_t)lg_features_count(&f);
    *out = f;
    return LG_OK;
}

void lg_features_destroy(lg_features *features) {
    if (features == NULL) return;
    lg_free(features->context, features->select);
    lg_free(features->context, features->pair);
    lg_free(features->context, features->scale);
    *features = (lg_features){0};
}

/* ---- numbers ---- */

/* Numbers that the computation of features leaves in `work` for the derivative. */
typedef struct kept {
    double *z; /* what is left of the channels without their means: (m, length), or baseline (pairs, 2,
                * length), part by part */
    double *deviation; /* (m), or baseline (pairs, 2, segments) */
    double *vectors;   /* cov: (m, m) orthonormal eigenvectors of the covariance, one a row */
    double *roots;     /* cov: (m) roots of its eigenvalues, in the order of the vectors */
    double *rest;      /* cov: m max(length, 2 m) that need not stay */
} kept;

static kept keep_in(const lg_features *f, double *work) {
    const size_t m = f->selected, length = f->length;
    const size_t rows = f->kind == LG_FEATURES_BASELINE ? 2 * (size_t)f->pairs : m;
    kept k = {.z = work, .deviation = work + rows * length};
    if (f->kind != LG_FEATURES_COV) return k;
    k.vectors = k.deviation + m;
    k.roots = k.vectors + m * m;
    k.rest = k.roots + m;
    return k;
}

/* Doubles. */
static size_t work_doubles(const lg_features *f) {
    const size_t m = f->selected, length = f->length, pairs = f->pairs;
    switch (f->kind) {
    case LG_FEATURES_RAW:
        return length;
    case LG_FEATURES_STD:
        return m * length + m;
    case LG_FEATURES_COV:
        return m * length + m + m * m + m + m * (length > 2 * m ? length : 2 * m);
    default:
        return 2 * pairs * (length + f->segments);
    }
}

size_t lg_features_work_size(const lg_features *f) {
    return work_doubles(f) * sizeof(double);
}

/* As lg_sum_of; the sum of up to 2^29 equal numbers is exact, and so is their mean. */
static double sum_of_floats(const float *x, size_t n) {
    double lane[8] = {0};
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (size_t j = 0; j < 8; j++) lane[j] += (double)x[i + j];
    for (size_t j = 0; i < n; i++, j++) lane[j] += (double)x[i];
    return ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}

/* z (length) = (x - mean)/scale. Returns the standard deviation of z, denominator `length`. The mean is
 * subtracted first, while x is exact, so a constant becomes exactly 0 and leaves no rounding for
 * standardisation to enlarge. */
static double centre(const float *x, size_t length, double scale, double *z) {
    const double mean = sum_of_floats(x, length) / (double)length;
    for (size_t i = 0; i < length; i++) z[i] = ((double)x[i] - mean) / scale;
    const double rest = lg_sum_of(z, length) / (double)length; /* what rounding left of the mean */
    for (size_t i = 0; i < length; i++) z[i] -= rest;
    return sqrt(lg_dot(z, z, length) / (double)length);
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
    const kept k = keep_in(f, work);
    for (size_t i = 0; i < f->selected; i++)
        out[i] = k.deviation[i] =
            centre(x + (size_t)f->select[i] * f->length, f->length, 1.0, k.z + i * f->length);
    return LG_OK;
}

/* The covariance C = Z Z^T/n is never formed: its small eigenvalues would lose half of their digits. Its
 * eigenvectors are the left singular vectors of Z (m, n), the roots of its eigenvalues are the singular
 * values over sqrt(n). */

/* Rows of z (m, n), orthogonalised one after the other: z = G^T Q, G (m, m) upper triangular, rows of Q
 * orthonormal. Gram and Schmidt's method in its modified form, whose G is as accurate as Householder's
 * (Bjorck 1967); Q is not kept, z is destroyed. */
static void triangle(double *z, size_t m, size_t n, double *g) {
    memset(g, 0, m * m * sizeof *g);
    for (size_t k = 0; k < m; k++) {
        const double *row = z + k * n;
        const double norm = sqrt(lg_dot(row, row, n)), inverse = norm > 0.0 ? 1.0 / norm : 0.0;
        g[k * m + k] = norm;
        for (size_t j = k + 1; j < m; j++) {
            double *other = z + j * n;
            const double along = lg_dot(row, other, n) * inverse, factor = along * inverse;
            g[k * m + j] = along;
            for (size_t t = 0; t < n; t++) other[t] -= factor * row[t];
        }
    }
}

/* Of rows of m numbers, too few for several sums. */
static double product(const double *a, const double *b, size_t m) {
    if (m >= 16) return lg_dot(a, b, m);
    double sum = 0.0;
    for (size_t i = 0; i < m; i++) sum += a[i] * b[i];
    return sum;
}

/* Rotates rows a and b (m) of product ab and norms na, nb until they are orthogonal. */
static void rotate(double *a, double *b, size_t m, double ab, double na, double nb) {
    const double middle = (nb - na) * (nb + na) / (2.0 * ab);
    const double size = 1.0 / (fabs(middle) + sqrt(1.0 + middle * middle));
    const double tangent = middle < 0.0 ? -size : size;
    const double cosine = 1.0 / sqrt(1.0 + tangent * tangent), sine = cosine * tangent;
    for (size_t i = 0; i < m; i++) {
        const double u = a[i], v = b[i];
        a[i] = cosine * u - sine * v;
        b[i] = sine * u + cosine * v;
    }
}

/* Every pair of rows of g (m, m) once. Returns whether any had to be rotated; rows of norm at most `least`
 * stay. norm (m): of the rows. */
static bool sweep(double *g, size_t m, double least, double *norm) {
    const double tolerance = DBL_EPSILON * sqrt((double)m + 2.0);
    bool rotated = false;
    for (size_t p = 0; p < m; p++)
        for (size_t q = p + 1; q < m; q++) {
            double *a = g + p * m, *b = g + q * m;
            if (norm[p] <= least || norm[q] <= least) continue;
            const double ab = product(a, b, m);
            if (fabs(ab) <= tolerance * norm[p] * norm[q]) continue;
            rotate(a, b, m, ab, norm[p], norm[q]);
            norm[p] = sqrt(product(a, a, m));
            norm[q] = sqrt(product(b, b, m));
            rotated = true;
        }
    return rotated;
}

/* Rotates rows of g (m, m) until all are orthogonal (one-sided Jacobi, Hestenes 1958): they become singular
 * values times right singular vectors. norm (m): the singular values. */
static lg_status singular_rows(double *g, size_t m, double *norm) {
    enum { SWEEPS = 60 }; /* quadratic convergence: ten are many */
    for (size_t k = 0; k < m; k++) norm[k] = sqrt(lg_dot(g + k * m, g + k * m, m));
    const double all = sqrt(lg_dot(norm, norm, m));
    if (!isfinite(all)) return LG_NOT_FINITE;
    for (int i = 0; i < SWEEPS; i++)
        if (!sweep(g, m, 0.5 * DBL_EPSILON * all, norm)) return LG_OK;
    return LG_NO_CONVERGENCE;
}

/* Roots below this count as 0: that of LG_NULL_EIGENVALUE times the largest eigenvalue. */
static double null_root(const double *roots, size_t m) {
    double largest = 0.0;
    for (size_t k = 0; k < m; k++) largest = fmax(largest, roots[k]);
    return sqrt(LG_NULL_EIGENVALUE) * largest;
}

/* Row k of v (m, m) becomes a unit vector orthogonal to the rows marked as known: what they leave, twice, of
 * the coordinate of which they leave most. */
static void complete_row(double *v, size_t m, size_t k, const double *known) {
    double *row = v + k * m, least = INFINITY;
    size_t best = 0;
    for (size_t i = 0; i < m; i++) {
        double taken = 0.0;
        for (size_t j = 0; j < m; j++) taken += known[j] * v[j * m + i] * v[j * m + i];
        if (taken < least) best = i;
        least = fmin(least, taken);
    }
    memset(row, 0, m * sizeof *row);
    row[best] = 1.0;
    for (int pass = 0; pass < 2; pass++)
        for (size_t j = 0; j < m; j++) {
            const double along = known[j] * lg_dot(row, v + j * m, m);
            for (size_t i = 0; i < m && along != 0.0; i++) row[i] -= along * v[j * m + i];
        }
    const double norm = sqrt(lg_dot(row, row, m));
    for (size_t i = 0; i < m; i++) row[i] /= norm;
}

/* Rows of v become orthonormal; those of the null space, whose directions are rounding, any basis of it.
 * known (m) is overwritten. */
static void orthonormalise(double *v, size_t m, const double *roots, double *known) {
    const double null = null_root(roots, m);
    for (size_t k = 0; k < m; k++) {
        double *row = v + k * m;
        known[k] = roots[k] > null ? 1.0 : 0.0;
        if (roots[k] > null)
            for (size_t i = 0; i < m; i++) row[i] /= roots[k];
        else
            memset(row, 0, m * sizeof *row);
    }
    for (size_t k = 0; k < m; k++) {
        if (known[k] > 0.0) continue;
        complete_row(v, m, k, known);
        known[k] = 1.0;
    }
}

/* From window x to the triangle's rotated rows: singular values and vectors of the scaled channels. */
static lg_status decompose(const lg_features *f, const float *x, const kept *k) {
    const size_t m = f->selected, length = f->length;
    for (size_t i = 0; i < m; i++) {
        const uint32_t channel = f->select[i];
        k->deviation[i] = centre(x + (size_t)channel * length, length, f->scale[channel], k->z + i * length);
    }
    memcpy(k->rest, k->z, m * length * sizeof *k->z);
    triangle(k->rest, m, length, k->vectors);
    return singular_rows(k->vectors, m, k->roots);
}

/* Upper triangle of sum_k v_k s_k v_k^T/sqrt(n). */
static lg_status compute_cov(const lg_features *f, const float *x, double *out, double *work) {
    const kept keep = keep_in(f, work);
    const size_t m = f->selected;
    double *vectors = keep.vectors, *roots = keep.roots, *a = keep.rest;
    LG_TRY(decompose(f, x, &keep));
    for (size_t k = 0; k < m; k++) {
        const double norm = roots[k], factor = norm > 0.0 ? 1.0 / norm / sqrt((double)f->length) : 0.0;
        for (size_t i = 0; i < m; i++) a[k * m + i] = factor * vectors[k * m + i];
    }
    for (size_t i = 0; i < m; i++)
        for (size_t j = i; j < m; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < m; k++) sum += a[k * m + i] * vectors[k * m + j];
            *out++ = sum;
        }
    orthonormalise(vectors, m, roots, a);
    for (size_t k = 0; k < m; k++) roots[k] /= sqrt((double)f->length);
    return LG_OK;
}

/* Samples first..last - 1. */
typedef struct stretch {
    size_t first, last;
} stretch;

static stretch part_of(const lg_features *f, uint32_t number) {
    return (stretch){(size_t)number * f->length / f->segments,
                     ((size_t)number + 1) * f->length / f->segments};
}

/* Sums of a line y = intercept + slope x through n points by least squares. */
typedef struct line {
    double mean_x, mean_y, xx, slope;
    bool level; /* x does not vary: slope 0 */
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
                    centre(x + channel * f->length + at.first, at.last - at.first, f->scale[channel],
                           k.z + row * f->length + at.first);
            }
        }
        const line l = regress(deviation, deviation + f->segments, f->segments);
        out[2 * p] = l.mean_y - l.slope * l.mean_x;
        out[2 * p + 1] = l.slope;
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

/* ---- derivatives: cotangent (d) of the features -> gradient (channels, length), zeros on entry ---- */

static void reverse_raw(const lg_features *f, const double *cotangent, double *work, double *gradient) {
    (void)work;
    for (uint32_t i = 0; i < f->selected; i++, cotangent += f->length)
        memcpy(gradient + (size_t)f->select[i] * f->length, cotangent, f->length * sizeof *gradient);
}

/* Adds the derivative of a standard deviation, d sigma/dx_t = z_t/(n sigma scale); none where it is 0. */
static void reverse_deviation(const double *z, size_t n, double deviation, double scale, double cotangent,
                              double *gradient) {
    if (!(deviation > 0.0)) return;
    const double factor = cotangent / ((double)n * deviation * scale);
    for (size_t t = 0; t < n; t++) gradient[t] += factor * z[t];
}

static void reverse_std(const lg_features *f, const double *cotangent, double *work, double *gradient) {
    const kept k = keep_in(f, work);
    for (size_t i = 0; i < f->selected; i++)
        reverse_deviation(k.z + i * f->length, f->length, k.deviation[i], 1.0, cotangent[i],
                          gradient + (size_t)f->select[i] * f->length);
}

/* to = V a V^T, or V^T a V for `back`; a symmetric, rows of V its eigenvectors; both (m, m). */
static void turn(const double *v, size_t m, bool back, const double *a, double *half, double *to) {
    const size_t row = back ? 1 : m, column = back ? m : 1; /* of element (i, k) of the left factor */
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < m; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < m; k++) sum += v[i * row + k * column] * a[k * m + j];
            half[i * m + j] = sum;
        }
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < m; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < m; k++) sum += half[i * m + k] * v[j * row + k * column];
            to[i * m + j] = sum;
        }
}

/* S S = C: S dS + dS S = dC, Sylvester's equation, is diagonal between eigenvectors of C,
 *   (V dS V^T)_ij = (V dC V^T)_ij/(s_i + s_j),
 * and self-adjoint (Higham, Functions of Matrices, 2008, section 6.1). Within the null space the root has a
 * kink: 0. */
static void solve_sylvester(const double *roots, size_t m, double *a) {
    const double null = null_root(roots, m);
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < m; j++) {
            const double sum = (roots[i] > null ? roots[i] : 0.0) + (roots[j] > null ? roots[j] : 0.0);
            a[i * m + j] = sum > 0.0 ? a[i * m + j] / sum : 0.0;
        }
}

/* With H the cotangent of C = Z Z^T/n, that of Z is 2 H Z/n; the rows of Z have mean 0, and so has this. */
static void reverse_cov(const lg_features *f, const double *cotangent, double *work, double *gradient) {
    const kept k = keep_in(f, work);
    const size_t m = f->selected, length = f->length;
    double *h = k.rest, *half = h + m * m;
    for (size_t i = 0; i < m; i++)
        for (size_t j = i; j < m; j++, cotangent++)
            h[i * m + j] = h[j * m + i] = i == j ? *cotangent : 0.5 * *cotangent;
    turn(k.vectors, m, false, h, half, h);
    solve_sylvester(k.roots, m, h);
    turn(k.vectors, m, true, h, half, h);
    for (size_t i = 0; i < m; i++) {
        const double outside = 2.0 / ((double)length * f->scale[f->select[i]]);
        double *to = gradient + (size_t)f->select[i] * length;
        for (size_t j = 0; j < m; j++) {
            const double factor = outside * h[i * m + j];
            for (size_t t = 0; t < length; t++) to[t] += factor * k.z[j * length + t];
        }
    }
}

/* Derivatives of slope and intercept by the deviations x_s, y_s of part s:
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
                reverse_deviation(k.z + row * length + at.first, at.last - at.first, x[side * n + s],
                                  f->scale[channel], by[side], gradient + channel * length + at.first);
            }
        }
    }
}

void lg_features_reverse(const lg_features *features, const double *cotangent, double *gradient,
                         double *work) {
    static void (*const reverse[LG_FEATURE_KIND_COUNT])(const lg_features *, const double *, double *,
                                                        double *) = {
        [LG_FEATURES_RAW] = reverse_raw,
        [LG_FEATURES_STD] = reverse_std,
        [LG_FEATURES_COV] = reverse_cov,
        [LG_FEATURES_BASELINE] = reverse_baseline,
    };
    memset(gradient, 0, (size_t)features->channels * features->length * sizeof *gradient);
    reverse[features->kind](features, cotangent, work, gradient);
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
    float *x = (float *)(void *)(work + work_doubles(job->features));
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
    lg_thread_pool *pool = NULL;
    const lg_status made = lg_thread_pool_create(job->context, threads, &pool);
    if (made != LG_OK) return lg_fail(error, made, "%d threads could not be started", threads);
    lg_thread_pool_run(pool, job->parts, table_part, job);
    lg_thread_pool_destroy(pool);
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
    job.work = (work_doubles(features) + window_doubles(features) + 7) / 8 * 8;
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

/* Features whose C is also what lg-export writes: samples, deviations, the root of the covariance, the
 * baseline, and powers of frequency bands (which exported code computes without the table of the waves). In
 * exported code the files below code/ have the sizes of one window as constants; here the same
 * names read them from lg_features. work: the window in double precision, then the memory of that code. */
#include <float.h>
#include <math.h>
#include <stdio.h>

#include "anomaly/classify/features.h"

typedef double real;
#define REAL(number) number
#define REAL_EPSILON DBL_EPSILON
#define SQRT         sqrt
#define FABS         fabs
#define ROLLED
#define FOR_WINDOW             const lg_features *self,
#define OF_WINDOW              self,
#define SELECTED               ((int)self->selected)
#define SEGMENTS               ((int)self->segments)
#define PAIRS                  ((int)self->pairs)
#define NAME_LENGTH            ((int)self->length)
#define NAME_FEATURES          ((int)self->count)
#define NAME_select            self->select
#define NAME_pair              self->pair
#define INVERSE_SCALE(channel) (1.0 / self->scale[channel])

#include "anomaly/classify/code/features_centre.c"
#include "anomaly/classify/code/features_cov_factor.c"
#include "anomaly/classify/code/features_deviation_vjp.c"

/* The code of each kind defines compute_features and features_vjp; here they are KIND_compute, KIND_vjp. */
#define JOINED(a, b)     a##b
#define JOIN(a, b)       JOINED(a, b)
#define compute_features JOIN(OWN, _compute)
#define features_vjp     JOIN(OWN, _vjp)
#define OWN              raw
#include "anomaly/classify/code/features_raw.c"
#include "anomaly/classify/code/features_raw_vjp.c"
#undef OWN
#define OWN std
#include "anomaly/classify/code/features_std.c"
#include "anomaly/classify/code/features_std_vjp.c"
#undef OWN
#define OWN cov
#include "anomaly/classify/code/features_cov.c"
#include "anomaly/classify/code/features_cov_vjp.c"
#undef OWN
#define OWN baseline
#include "anomaly/classify/code/features_baseline.c"
#include "anomaly/classify/code/features_baseline_vjp.c"
#undef OWN
#undef SEGMENTS
#define OWN         spectrum
#define SEGMENTS    ((int)self->spectrum.segments)
#define SEGMENT     ((int)self->spectrum.segment)
#define HOP         ((int)self->spectrum.hop)
#define BANDS       ((int)self->bands)
#define NAME_edge   ((const int *)self->spectrum.edge)
#define NAME_taper  self->spectrum.taper
#define NAME_cosine self->spectrum.cosine
#define NAME_sine   self->spectrum.sine
#include "anomaly/classify/code/features_segment.c"
#include "anomaly/classify/code/features_spectrum_vjp.c"

/* Logarithms of powers, in the first numbers of `work` as in the exported code; the waves lie behind them. */
static void spectrum_compute(const lg_features *self, const double *x, double *f, double *work) {
    double *inverse = work + 2 * NAME_LENGTH + SEGMENT, *waves = inverse + SELECTED * BANDS;
    for (int i = 0; i < SELECTED; i++, f += BANDS, inverse += BANDS) {
        const uint32_t channel = NAME_select[i];
        (void)centre_numbers(NAME_LENGTH, INVERSE_SCALE(channel), x + channel * NAME_LENGTH, work);
        lg_spectrum_powers(&self->spectrum, work, f, waves);
        for (int b = 0; b < BANDS; b++) {
            inverse[b] = 1.0 / (f[b] + LG_FEATURES_FLOOR);
            f[b] = log(f[b] + LG_FEATURES_FLOOR);
        }
    }
}

/* ---- numbers of features, and of work memory ---- */

static lg_feature_sizes raw_sizes(const lg_features *f) {
    return (lg_feature_sizes){(uint64_t)f->selected * f->length, 0};
}

static lg_feature_sizes std_sizes(const lg_features *f) {
    return (lg_feature_sizes){f->selected, f->length};
}

static lg_feature_sizes cov_sizes(const lg_features *f) {
    const uint64_t m = f->selected;
    return (lg_feature_sizes){m * (m + 1) / 2, m * (f->length + 3 * m + 2)};
}

static lg_feature_sizes baseline_sizes(const lg_features *f) {
    return (lg_feature_sizes){2 * (uint64_t)f->pairs, f->length + 2 * (uint64_t)f->segments * f->pairs};
}

static lg_feature_sizes spectrum_sizes(const lg_features *f) {
    const lg_spectrum *s = &f->spectrum;
    const uint64_t count = (uint64_t)f->selected * f->bands;
    return (lg_feature_sizes){count, 2 * (uint64_t)f->length + s->segment + count + lg_spectrum_work(s)};
}

/* ---- names ---- */

static int describe_raw(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                        size_t size) {
    char name[LG_SERIES_NAME];
    (void)lg_channel_name(series, f->select[index / f->length], name, sizeof name);
    return snprintf(text, size, "raw %s %u", name, index % f->length);
}

static int describe_std(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                        size_t size) {
    char name[LG_SERIES_NAME];
    (void)lg_channel_name(series, f->select[index], name, sizeof name);
    return snprintf(text, size, "std %s", name);
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

#define KIND(kind, ...)                                                                                      \
    const lg_feature_row lg_feature_##kind = {.name = #kind,                                                 \
                                              .sizes = kind##_sizes,                                         \
                                              .code = kind##_compute,                                        \
                                              .vjp = kind##_vjp,                                             \
                                              .describe = describe_##kind,                                   \
                                              __VA_ARGS__}
KIND(raw, );
KIND(std, );
KIND(cov, );
KIND(baseline, .segments = 10);
KIND(spectrum, .bands = 8);

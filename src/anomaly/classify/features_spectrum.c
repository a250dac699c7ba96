/* Features of single channels: logarithm of the channel's power in each frequency band. */
#include "anomaly/classify/features.h"

#include <math.h>

/* Layout of `work`: numbers that compute_spectrum keeps for the derivative, and temporary numbers. */
typedef struct kept {
    /* (m, lg_spectrum_work): the spectrum's work memory for each channel. */
    double *waves;
    double *powers; /* (m, bands): powers plus LG_FEATURES_FLOOR */
    double *rest;   /* temporary: max(length, bands) numbers */
} kept;

static kept keep_in(const lg_features *f, double *work) {
    double *powers = work + f->selected * lg_spectrum_work(&f->spectrum);
    return (kept){.waves = work, .powers = powers, .rest = powers + (size_t)f->selected * f->bands};
}

static size_t spectrum_work(const lg_features *f) {
    const size_t rest = f->length > f->bands ? f->length : f->bands;
    return f->selected * (lg_spectrum_work(&f->spectrum) + f->bands) + rest;
}

static uint64_t spectrum_count(const lg_features *f) {
    return (uint64_t)f->selected * f->bands;
}

static lg_status compute_spectrum(const lg_features *f, const float *x, double *out, double *work) {
    const kept k = keep_in(f, work);
    for (size_t i = 0; i < f->selected; i++) {
        const size_t channel = f->select[i];
        double *power = k.powers + i * f->bands;
        (void)lg_centre(x + channel * f->length, f->length, f->scale[channel], k.rest);
        lg_spectrum_powers(&f->spectrum, k.rest, power, k.waves + i * lg_spectrum_work(&f->spectrum));
        for (uint32_t b = 0; b < f->bands; b++) {
            power[b] += LG_FEATURES_FLOOR;
            *out++ = log(power[b]);
        }
    }
    return LG_OK;
}

/* If g is the cotangent of the centred and scaled channel, (g - mean of g)/scale is the cotangent of the
 * channel. */
static void reverse_spectrum(const lg_features *f, const double *cotangent, double *work, double *gradient) {
    const kept k = keep_in(f, work);
    for (size_t i = 0; i < f->selected; i++) {
        const size_t channel = f->select[i];
        const double *power = k.powers + i * f->bands;
        double *to = gradient + channel * f->length;
        for (uint32_t b = 0; b < f->bands; b++) k.rest[b] = *cotangent++ / power[b];
        lg_spectrum_reverse(&f->spectrum, k.rest, to, k.waves + i * lg_spectrum_work(&f->spectrum));
        const double mean = lg_sum_of(to, f->length) / (double)f->length;
        for (uint32_t t = 0; t < f->length; t++) to[t] = (to[t] - mean) / f->scale[channel];
    }
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

const lg_feature_row lg_feature_spectrum = {.name = "spectrum",
                                            .bands = 8,
                                            .count = spectrum_count,
                                            .work = spectrum_work,
                                            .compute = compute_spectrum,
                                            .reverse = reverse_spectrum,
                                            .describe = describe_spectrum};

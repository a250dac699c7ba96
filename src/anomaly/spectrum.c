/* Power in frequency bands by Welch's method. One matrix product of all segments with the windowed cosines
 * and sines gives the Fourier coefficients of all segments. */
#include "liegrad/series.h"

#include <math.h>

#include "core/core.h"
#include "kernels/kernels.h"

static const double PI = 3.14159265358979323846;

static uint32_t segment_of(uint32_t length) {
    return length < LG_SPECTRUM_SEGMENT ? length : LG_SPECTRUM_SEGMENT;
}

uint32_t lg_spectrum_bands(uint32_t length, uint32_t wanted) {
    const uint32_t bins = segment_of(length) / 2, most = bins < LG_SPECTRUM_BANDS ? bins : LG_SPECTRUM_BANDS;
    return length < 4 ? 0 : wanted < most ? wanted : most;
}

static void cut(uint32_t length, uint32_t bands, lg_spectrum *s) {
    s->length = length;
    s->segment = segment_of(length);
    const uint32_t rest = length - s->segment, half = (s->segment + 1) / 2, steps = (rest + half - 1) / half;
    s->segments = steps + 1;
    s->hop = steps > 0 ? rest / steps : 0;
    s->bins = s->segment / 2;
    s->bands = bands;
    for (uint32_t b = 0; b <= bands; b++) s->edge[b] = 1 + s->bins * b / bands;
}

static double hann(uint32_t t, uint32_t n) {
    return 0.5 - 0.5 * cos(2 * PI * (t + 0.5) / n);
}

static void fill(lg_spectrum *s) {
    const uint32_t n = s->segment, bins = s->bins;
    double power = 0;
    for (uint32_t t = 0; t < n; t++) power += hann(t, n) * hann(t, n);
    for (uint32_t t = 0; t < n; t++)
        for (uint32_t k = 1; k <= bins; k++) {
            const double angle = 2 * PI * (double)((uint64_t)k * t % n) / n, taper = hann(t, n) / sqrt(power);
            const size_t place = (size_t)t * 2 * bins + k - 1;
            s->wave[place] = taper * cos(angle);
            s->wave[place + bins] = taper * sin(angle);
        }
}

lg_status lg_spectrum_create(const lg_context *context, uint32_t length, uint32_t bands, lg_spectrum *out,
                             lg_error *error) {
    LG_NEEDS(error, out);
    if (bands == 0 || bands != lg_spectrum_bands(length, bands))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%u bands are not possible for a series of %u samples: at most %u are", bands, length,
                       lg_spectrum_bands(length, LG_SPECTRUM_BANDS));
    lg_spectrum s = {.context = context};
    cut(length, bands, &s);
    s.wave = lg_alloc(context, (size_t)s.segment * 2 * s.bins, sizeof *s.wave);
    if (s.wave == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a spectrum");
    fill(&s);
    *out = s;
    return LG_OK;
}

void lg_spectrum_destroy(lg_spectrum *spectrum) {
    if (spectrum == NULL) return;
    lg_free(spectrum->context, spectrum->wave);
    *spectrum = (lg_spectrum){.length = 0};
}

size_t lg_spectrum_work(const lg_spectrum *spectrum) {
    return (size_t)spectrum->segments * 2 * spectrum->bins;
}

void lg_spectrum_powers(const lg_spectrum *s, const double *z, double *power, double *work) {
    const size_t width = 2 * (size_t)s->bins;
    lg_kernels_for(LG_F64)->gemm(s->segments, width, s->segment, z, s->hop, 1, s->wave, width, work, width,
                                 false);
    for (uint32_t b = 0; b < s->bands; b++) {
        double sum = 0;
        for (uint32_t i = 0; i < s->segments; i++) {
            const double *re = work + i * width - 1, *im = re + s->bins;
            for (uint32_t k = s->edge[b]; k < s->edge[b + 1]; k++) sum += re[k] * re[k] + im[k] * im[k];
        }
        power[b] = sum / ((double)s->segments * (s->edge[b + 1] - s->edge[b]));
    }
}

/* Power of a series in frequency bands, by Welch's method (IEEE Trans. Audio Electroacoust. 15 (1967) 70).
 *
 * The series is cut into segments of n samples that overlap by half or a little more. Each is multiplied by
 * Hann's window h_t = sin^2(pi (t + 1/2)/n) and transformed; bin k has the frequency k/n, in cycles a sample.
 * The power of a bin is
 *   P_k = mean over the segments of |sum_t h_t z_t exp(-2 pi i k t/n)|^2 / sum h_t^2,
 * and that of a band the mean over its bins: white noise of variance s^2 has power s^2 in every band. Bin 0
 * is in no band; the others, 1..n/2, are shared out evenly in rising order. */
#ifndef LIEGRAD_SPECTRUM_H
#define LIEGRAD_SPECTRUM_H

#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

#define LG_SPECTRUM_SEGMENT 128u /* samples of a segment at most */
#define LG_SPECTRUM_BANDS   64u  /* bands at most */

typedef struct lg_spectrum {
    uint32_t length, segment, segments, hop; /* samples; samples; number; samples from one to the next */
    uint32_t bins, bands;                    /* bins: segment/2 */
    uint32_t edge[LG_SPECTRUM_BANDS + 1];    /* band b has the bins edge[b] .. edge[b + 1] - 1 */
    double *wave;              /* (segment, 2 bins): h_t cos(2 pi k t/n), then h_t sin, over sqrt(sum h^2) */
    const lg_context *context; /* whose memory it is in */
} lg_spectrum;

/* Bands of a series of `length` samples: `wanted`, or as many as it has bins for; 0 for less than 4 samples.
 */
LG_API uint32_t lg_spectrum_bands(uint32_t length, uint32_t wanted);
/* bands: 1..lg_spectrum_bands(length, bands). Errors: LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_spectrum_create(const lg_context *context, uint32_t length, uint32_t bands,
                                    lg_spectrum *out, lg_error *error);
LG_API void lg_spectrum_destroy(lg_spectrum *spectrum); /* a zeroed one is fine */
/* Doubles of work for the two functions below. */
LG_API size_t lg_spectrum_work(const lg_spectrum *spectrum);
/* z (length) -> power (bands). */
LG_API void lg_spectrum_powers(const lg_spectrum *spectrum, const double *z, double *power, double *work);
/* Adds to gradient (length) the derivative of sum_b cotangent_b power_b, at the series of the last call of
 * lg_spectrum_powers with this `work`. */
LG_API void lg_spectrum_reverse(const lg_spectrum *spectrum, const double *cotangent, double *gradient,
                                const double *work);

LG_END_DECLS

#endif

/* Random convolution features: what features_rocket.c and rocket_fit.c share. */
#ifndef LG_CLASSIFY_ROCKET_H
#define LG_CLASSIFY_ROCKET_H

#include "anomaly/classify/features.h"

enum {
    LG_ROCKET_TAPS = 9,
    LG_ROCKET_CHOICES = 84, /* ways to choose 3 of 9: kernels whose weights add up to 0 */
    LG_ROCKET_KERNELS = 96  /* the others have nine weights of 1 */
};

/* Doubles of work memory; valid as soon as the convolutions are listed. */
size_t lg_rocket_work_doubles(const lg_features *features);
/* Computes a convolution of the window x (channels, length). *y becomes its samples, in `work`, and *unit the
 * unit of its thresholds. Returns the number of samples, or 0 if a number is not finite. */
size_t lg_rocket_values(const lg_features *features, const lg_rocket_convolution *convolution,
                        const uint32_t *channel, const float *x, double *work, float **y, double *unit);

#endif

/* Kinds of features, one row each, and declarations that their files share. */
#ifndef LG_CLASSIFY_FEATURES_H
#define LG_CLASSIFY_FEATURES_H

#include "anomaly/classify/classify_internal.h"

typedef struct lg_feature_row {
    const char *name;
    uint32_t segments; /* parts of a window, for kinds of pairs of channels; 0: no pairs */
    uint32_t bands;    /* of frequency at most, for kinds of powers; 0: no powers */
    uint64_t (*count)(const lg_features *f); /* of features */
    size_t (*work)(const lg_features *f);    /* doubles */
    lg_status (*compute)(const lg_features *f, const float *x, double *out, double *work);
    /* cotangent (d) of the features -> gradient (channels, length), which is zero on entry; at the window for
     * which `compute` was called last with this `work` */
    void (*reverse)(const lg_features *f, const double *cotangent, double *work, double *gradient);
    /* Writes the name of feature `index` as snprintf does. */
    int (*describe)(const lg_features *f, const lg_series *series, uint32_t index, char *text, size_t size);
} lg_feature_row;

extern const lg_feature_row lg_feature_raw, lg_feature_std, lg_feature_cov, lg_feature_spectrum,
    lg_feature_baseline;

/* Doubles of work for lg_features_compute. */
size_t lg_features_work_doubles(const lg_features *features);

/* z (length) = (x - mean)/scale. Returns the standard deviation of z, denominator `length`. */
double lg_centre(const float *x, size_t length, double scale, double *z);
/* Adds the derivative of a standard deviation, d sigma/dx_t = z_t/(n sigma scale); nothing if sigma is 0. */
void lg_deviation_reverse(const double *z, size_t n, double deviation, double scale, double cotangent,
                          double *gradient);

/* The name of a channel, or its number if it has no name. */
int lg_channel_name(const lg_series *series, uint32_t channel, char *text, size_t size);

#endif

/* The kinds of features, each described by an lg_feature_row, and functions shared by the files of the
 * kinds. */
#ifndef LG_CLASSIFY_FEATURES_H
#define LG_CLASSIFY_FEATURES_H

#include "anomaly/classify/classify_internal.h"

/* Number of features; length of `work` in doubles. */
typedef struct lg_feature_sizes {
    uint64_t count, work;
} lg_feature_sizes;

typedef struct lg_feature_row {
    const char *name;
    /* Number of parts into which a window is cut, for kinds that work on pairs of channels. 0: the kind does
     * not use pairs. */
    uint32_t segments;
    /* Largest number of frequency bands, for kinds that use band powers. 0: the kind does not use powers. */
    uint32_t bands;
    lg_feature_sizes (*sizes)(const lg_features *f);
    /* Either `code` and `vjp` (features_code.c), for a window x in double precision, or `compute`, whose
     * features have the derivative 0. vjp comes after code, with the same `work`. It adds the derivative for
     * the cotangent df to dx. */
    void (*code)(const lg_features *f, const double *x, double *out, double *work);
    void (*vjp)(const lg_features *f, const double *x, const double *df, double *dx, double *work);
    lg_status (*compute)(const lg_features *f, const float *x, double *out, double *work);
    /* Writes the name of feature `index` and returns its length as snprintf does. */
    int (*describe)(const lg_features *f, const lg_series *series, uint32_t index, char *text, size_t size);
} lg_feature_row;

extern const lg_feature_row lg_feature_raw, lg_feature_std, lg_feature_cov, lg_feature_spectrum,
    lg_feature_baseline, lg_feature_rocket;

/* As lg_features_create, for any kind, but without `count`. */
lg_status lg_features_begin(const lg_context *context, lg_feature_kind kind, bool directions_x,
                            const lg_series *series, uint32_t length, const lg_scaler *scaler,
                            lg_features *out, lg_error *error);

/* ---- random convolutions ---- */

enum {
    LG_ROCKET_TAPS = 9,
    LG_ROCKET_CHOICES = 84, /* ways to choose 3 of 9: kernels whose weights add up to 0 */
    LG_ROCKET_KERNELS = 96  /* the others have nine weights of 1 */
};

void lg_rocket_destroy(const lg_context *context, lg_rocket *rocket);
/* Doubles of work memory; valid as soon as the convolutions are listed. */
size_t lg_rocket_work_doubles(const lg_features *features);
/* Computes a convolution of the window x (channels, length). *y becomes its samples, in `work`, and *unit the
 * unit of its thresholds. Returns the number of samples, or 0 if a number is not finite. */
size_t lg_rocket_values(const lg_features *features, const lg_rocket_convolution *convolution,
                        const uint32_t *channel, const float *x, double *work, float **y, double *unit);

/* ---- parts of all kinds ---- */

/* Writes the name of a channel, or its number if it has no name, as snprintf does. */
int lg_channel_name(const lg_series *series, uint32_t channel, char *text, size_t size);

#endif

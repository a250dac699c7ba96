/* Novelty: whether a window of sensor data is like the windows that a model was trained on. A classifier
 * gives any window one of its classes, also one from a dead sensor; this says when its answer means nothing.
 *
 * Features of a window z = (x - mean)/scale (channels, length):
 *   a channel   mean m; ln s, s the standard deviation; ln(max |z - m|/s); ln of the power in each of `bands`
 *               frequency bands (liegrad/spectrum.h)
 *   a pair      of channels: artanh of their correlation (up to LG_NOVELTY_PAIRED channels)
 * A thousandth of the channel's scale is added to s and to the amplitudes: less than that is not told from
 * nothing. Each class of the training windows has a normal distribution of the features f: centre c and
 * covariance Sigma, shrunk towards the diagonal by the share that the data ask for (Schaefer & Strimmer,
 * Stat. Appl. Genet. Mol. Biol. 4 (2005) 32). With P = Sigma^-1 and d = f - c the squared distances are
 *   of the window           d' P d                          (Mahalanobis)
 *   of a group of features  (P d)_g' (P_gg)^-1 (P d)_g      the part that the rest of d does not explain
 * where the features of a channel are a group, and all pairs are one. Their limits are `margin` times a
 * quantile of the same distances of training windows that the distributions were not fitted on, or times the
 * number of features, if that is larger. A window is novel when one of its distances is beyond its limit for
 * every class, when a channel stands still, or when too many samples are at the channel's least or largest
 * value. */
#ifndef LIEGRAD_NOVELTY_H
#define LIEGRAD_NOVELTY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/archive.h"
#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/series.h"
#include "liegrad/spectrum.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

#define LG_NOVELTY_PAIRED   24u   /* channels; with more, pairs are left out */
#define LG_NOVELTY_FEATURES 1024u /* at most; with many channels there are fewer bands */

typedef struct lg_novelty {
    uint32_t channels, length, classes;
    uint32_t bands, pairs, features;
    double *mean, *scale; /* (channels) */
    double *still;        /* (channels): equal consecutive samples that are allowed */
    double *extreme;      /* (channels): samples at the window's least, or largest, value that are allowed */
    double *windows;      /* (classes): training windows; a class without any has no distribution */
    double *centre;       /* (classes, features) */
    double *spread;       /* (features): standard deviation within the classes */
    double *precision;    /* (classes, features, features): of (f - centre)/spread */
    double *limit;        /* (1 + channels + 1): of the window, each channel, the pairs */
    double *block;        /* Cholesky factors of the groups' blocks of `precision` */
    lg_spectrum spectrum; /* zero for bands 0 */
    const lg_context *context;
} lg_novelty;

typedef struct lg_novelty_options {
    size_t size;     /* sizeof(lg_novelty_options) */
    uint32_t bands;  /* 8 */
    uint32_t folds;  /* 5: of the training windows, for the limits */
    uint32_t most;   /* 20000: windows that are looked at, evenly chosen */
    double quantile; /* 0.99 */
    double margin;   /* 3: limit of a squared distance over its quantile */
} lg_novelty_options;
LG_API void lg_novelty_options_init(lg_novelty_options *options);

/* Fits it on the windows `chosen` (count; NULL: the first `count`). Windows of a group, or without groups of
 * a run, are in the same fold. The bits do not depend on `threads` >= 1. Errors, with a sentence:
 * LG_INVALID_ARGUMENT (fewer than 8 windows or 2 samples, more than LG_NOVELTY_FEATURES/3 channels),
 * LG_NOT_FINITE, LG_OUT_OF_MEMORY, LG_CANCELLED. */
LG_API lg_status lg_novelty_fit(const lg_context *context, const lg_novelty_options *options,
                                const lg_series *series, const lg_windows *windows, const uint32_t *chosen,
                                size_t count, int threads, lg_novelty *out, lg_error *error);
LG_API void lg_novelty_destroy(lg_novelty *novelty); /* a zeroed one is fine */

/* ---- use ---- */

typedef enum lg_novelty_cause {
    LG_NOVELTY_NONE,
    LG_NOVELTY_STILL,   /* `samples` consecutive samples of `channel` are equal */
    LG_NOVELTY_EXTREME, /* `samples` samples of `channel` are at its least or largest value */
    LG_NOVELTY_CHANNEL, /* `channel` is unlike the others' and its own features in training */
    LG_NOVELTY_PAIR     /* so is the correlation of `channel` and `other` */
} lg_novelty_cause;

typedef struct lg_novelty_result {
    bool novel;
    double distance; /* the largest squared distance over its limit, of the nearest class; above 1 is novel */
    uint32_t nearest;       /* that class */
    lg_novelty_cause cause; /* told below the limits, too; NONE: a value is not finite */
    uint32_t channel, other, samples;
    uint32_t feature;    /* that deviates most, in units of its spread; a channel's if one deviates by 5 */
    double value, usual; /* of that feature */
    double deviation;    /* of the channel: standard deviation over the usual */
} lg_novelty_result;

/* Bytes, to be aligned to 64, for lg_novelty_eval. */
LG_API size_t lg_novelty_work_size(const lg_novelty *novelty);
/* x (channels, length), as recorded. features: NULL, or (features) for the result. No allocation, no lock. A
 * window with a value that is not finite is novel, its distance infinite. */
LG_API void lg_novelty_eval(const lg_novelty *novelty, const float *x, lg_novelty_result *result,
                            double *features, void *work);
/* ratio (channels) = amplitude in the highest band over the usual one of a class, from `features`: the noise
 * of the sensors, where they measure nothing else there. bands 0: 1. */
LG_API void lg_novelty_noise(const lg_novelty *novelty, uint32_t class_index, const double *features,
                             double *ratio);
/* The lower end of that band, in cycles a sample. */
LG_API double lg_novelty_noise_from(const lg_novelty *novelty);
/* Writes the cause as snprintf does: "moment_x: standard deviation 0.01 times the usual". names (channels) or
 * NULL: numbers from 1 on; rate Hz, 0: unknown. */
LG_API int lg_novelty_explain(const lg_novelty *novelty, const lg_novelty_result *result,
                              char (*names)[LG_SERIES_NAME], double rate, char *text, size_t size);

/* ---- files ---- */

/* Arrays below "novelty/". The reader checks sizes and values: LG_FORMAT, LG_NOT_FINITE; LG_NOT_FOUND: there
 * is none. On failure *out is zeroed. */
LG_API lg_status lg_novelty_save(const lg_novelty *novelty, const lg_archive_writer *writer, lg_error *error);
LG_API lg_status lg_novelty_load(const lg_context *context, const lg_archive_reader *reader, lg_novelty *out,
                                 lg_error *error);

LG_END_DECLS

#endif

/* The kinds of features, each described by an lg_feature_row, and functions shared by the files of the
 * kinds. */
#ifndef LG_CLASSIFY_FEATURES_H
#define LG_CLASSIFY_FEATURES_H

#include "anomaly/classify/classify_internal.h"
#include "autodiff/ops/rocket.h"

/* The channels that the features are computed from: how many, and number i. They are the selected ones, or of
 * pairs all accelerations, then all moments. */
static inline uint32_t lg_features_channels(const lg_features *f) {
    return f->segments == 0 ? f->selected : 2 * f->pairs;
}
static inline uint32_t lg_features_channel(const lg_features *f, uint32_t i) {
    return f->segments == 0 ? f->select[i] : f->pair[2 * (i % f->pairs) + i / f->pairs];
}
/* The rows of x (B, channels, ...) that belong to these channels, in their order. */
lg_var lg_features_chosen(lg_tape *t, const lg_features *f, lg_var x);
/* Makes features->plan, which computes the features of a window. */
lg_status lg_features_ready(lg_features *features, lg_error *error);

typedef struct lg_feature_row {
    const char *name;
    /* Number of parts into which a window is cut, for kinds that work on pairs of channels. 0: the kind does
     * not use pairs. */
    uint32_t segments;
    /* Largest number of frequency bands, for kinds that use band powers. 0: the kind does not use powers. */
    uint32_t bands;
    /* Names of the features of a channel, in kinds that have the same number of features for each one. */
    const char *part[4];
    uint32_t parts;
    uint64_t (*count)(const lg_features *f); /* of features; NULL: `parts` for each channel */
    bool exact; /* features are samples or as exact, so the rounding of their means to floats matters */
    bool rated; /* features depend on the sampling rate, which files then store */
    /* Records the features (B, d) of windows x (B, channels, length). eps: the relative distance of
     * neighbouring numbers. */
    lg_var (*record)(lg_tape *t, const lg_features *f, lg_var eps, lg_var x);
    /* Writes the name of feature `index` and returns its length as snprintf does. NULL: a name of `part`, and
     * the channel. */
    int (*describe)(const lg_features *f, const lg_series *series, uint32_t index, char *text, size_t size);
} lg_feature_row;
extern const lg_feature_row *const lg_feature_rows[LG_FEATURE_KIND_COUNT];

extern const lg_feature_row lg_feature_rocket;

/* As lg_features_create, for any kind, but without `count`. */
lg_status lg_features_begin(const lg_context *context, lg_feature_kind kind, bool directions_x,
                            const lg_series *series, uint32_t length, const lg_scaler *scaler,
                            lg_features *out, lg_error *error);

/* ---- random convolutions ---- */

void lg_rocket_destroy(const lg_context *context, lg_rocket *rocket);
lg_rocket_table lg_rocket_table_of(const lg_rocket *rocket);

/* ---- parts of all kinds ---- */

/* Writes the name of a channel, or its number if it has no name, as snprintf does. */
int lg_channel_name(const lg_series *series, uint32_t channel, char *text, size_t size);

#endif

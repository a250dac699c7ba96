/* Features of windows: the choice of channels, and names. The table of kinds is in features_kinds.c. */
#include "anomaly/classify/features.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

const char *lg_feature_kind_name(lg_feature_kind kind) {
    return (unsigned)kind < LG_FEATURE_KIND_COUNT ? lg_feature_rows[kind]->name : "unknown";
}

/* ---- choice of channels ---- */

static bool ends_in(const char *text, const char *end) {
    const size_t a = strlen(text), b = strlen(end);
    return a >= b && strcmp(text + a - b, end) == 0;
}

/* Returns the rest of `text` behind `start`, or NULL if the text does not begin with `start`. */
static const char *after(const char *text, const char *start) {
    const size_t length = strlen(start);
    return strncmp(text, start, length) == 0 ? text + length : NULL;
}

/* Returns the moment channel that belongs to the acceleration `channel`, or UINT32_MAX if there is none.
 * Channels without names are taken as two acceleration sensors (x, y each), followed by the moments (x,
 * y). */
static uint32_t moment_of(const lg_series *series, uint32_t channel) {
    if (series->channel_name == NULL)
        return channel < 2 && channel + 4 < series->channels ? channel + 4 : UINT32_MAX;
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
        const bool x = series->channel_name != NULL ? ends_in(series->channel_name[i], "_x") : i % 2 == 0;
        if (directions_x && !x) continue;
        f->select[f->selected++] = i;
        const uint32_t moment = f->segments > 0 ? moment_of(series, i) : UINT32_MAX;
        if (moment == UINT32_MAX) continue;
        f->pair[2 * f->pairs] = i;
        f->pair[2 * f->pairs + 1] = moment;
        f->pairs++;
    }
}

uint64_t lg_features_count(const lg_features *f) {
    const lg_feature_row *row = lg_feature_rows[f->kind];
    return row->count != NULL ? row->count(f) : (uint64_t)row->parts * f->selected;
}

static lg_status check_create(lg_feature_kind kind, const lg_series *series, uint32_t length,
                              const lg_scaler *scaler, lg_error *error) {
    if ((unsigned)kind >= LG_FEATURE_KIND_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown kind of features");
    const lg_feature_row *row = lg_feature_rows[kind];
    if (series->channels == 0 || length == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "windows of %u channels and %u samples have no features",
                       series->channels, length);
    if (series->channels > LG_FEATURES_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "there are %u channels; at most %u are possible",
                       series->channels, LG_FEATURES_MAX);
    if (length < row->segments)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a window of %u samples is too short for the baseline, which cuts it into %u parts",
                       length, row->segments);
    if (row->bands > 0 && lg_spectrum_bands(length, row->bands) == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a window of %u samples is too short for a spectrum, which needs 4 at least", length);
    if (scaler == NULL) return LG_OK;
    if (scaler->channels != series->channels)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the scaler is for %u channels, the series has %u",
                       scaler->channels, series->channels);
    for (uint32_t i = 0; i < scaler->channels; i++)
        if (!(scaler->scale[i] > 0.0) || !isfinite(scaler->scale[i]))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "the scale of channel %u is %g, expected a positive number", i, scaler->scale[i]);
    return LG_OK;
}

static lg_status check_made(const lg_features *f, bool directions_x, lg_error *error) {
    if (f->selected == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "there is no channel of the x-direction: no name ends in _x");
    if (f->segments > 0 && f->pairs == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the baseline needs a lower acceleration and a moment of the same direction%s: "
                       "channels acc_lower_x and moment_x, or acc_lower_y and moment_y; without names "
                       "channels 0 and 4, or 1 and 5",
                       directions_x ? " (x)" : "");
    const uint64_t count = lg_features_count(f);
    if (count > LG_FEATURES_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "there are %llu features of kind %s, but at most %u are possible: take a shorter "
                       "window or fewer channels",
                       (unsigned long long)count, lg_feature_kind_name(f->kind), LG_FEATURES_MAX);
    return LG_OK;
}

lg_status lg_features_begin(const lg_context *context, lg_feature_kind kind, bool directions_x,
                            const lg_series *series, uint32_t length, const lg_scaler *scaler,
                            lg_features *out, lg_error *error) {
    LG_TRY(check_create(kind, series, length, scaler, error));
    const lg_feature_row *row = lg_feature_rows[kind];
    LG_CLEAN(lg_features_destroy)
    lg_features f = {.kind = kind, .channels = series->channels, .length = length, .context = context};
    if (LG_ALLOC_ALL(context, LG_ARRAY(f.select, f.channels), LG_ARRAY(f.pair, 2 * (size_t)f.channels),
                     LG_ARRAY(f.scale, f.channels)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the features of %u channels", f.channels);
    f.segments = row->segments;
    f.bands = lg_spectrum_bands(length, row->bands);
    f.rate = series->rate > 0 ? series->rate : 1;
    for (uint32_t i = 0; i < f.channels; i++) f.scale[i] = scaler != NULL ? scaler->scale[i] : 1.0;
    choose_channels(series, directions_x, &f);
    LG_TRY(check_made(&f, directions_x, error));
    if (f.bands > 0) LG_TRY(lg_spectrum_create(context, length, f.bands, &f.spectrum, error));
    return LG_GIVE(out, f);
}

lg_status lg_features_create(const lg_context *context, lg_feature_kind kind, bool directions_x,
                             const lg_series *series, uint32_t length, const lg_scaler *scaler,
                             lg_features *out, lg_error *error) {
    LG_NEEDS(error, series, out);
    if (kind == LG_FEATURES_ROCKET)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "random convolution features depend on training windows: take lg_rocket_fit");
    LG_CLEAN(lg_features_destroy) lg_features f = {0};
    LG_TRY(lg_features_begin(context, kind, directions_x, series, length, scaler, &f, error));
    f.count = (uint32_t)lg_features_count(&f);
    LG_TRY(lg_features_ready(&f, error));
    return LG_GIVE(out, f);
}

void lg_features_destroy(lg_features *features) {
    if (features == NULL) return;
    LG_FREE_ALL(features->context, features->select, features->pair, features->scale);
    lg_spectrum_destroy(&features->spectrum);
    lg_plan_destroy(features->plan);
    lg_rocket_destroy(features->context, &features->rocket);
    *features = (lg_features){0};
}

/* ---- names ---- */

int lg_channel_name(const lg_series *series, uint32_t channel, char *text, size_t size) {
    if (series != NULL && channel < series->channels && series->channel_name != NULL &&
        series->channel_name[channel][0] != '\0')
        return snprintf(text, size, "%.*s", LG_SERIES_NAME - 1, series->channel_name[channel]);
    return snprintf(text, size, "%u", channel);
}

int lg_features_name(const lg_features *f, const lg_series *series, uint32_t index, char *text, size_t size) {
    const lg_feature_row *row = lg_feature_rows[f->kind];
    char name[LG_SERIES_NAME];
    if (index >= f->count) return snprintf(text, size, "unknown");
    if (row->describe != NULL) return row->describe(f, series, index, text, size);
    (void)lg_channel_name(series, f->select[index / row->parts], name, sizeof name);
    return snprintf(text, size, "%s %s", row->part[index % row->parts], name);
}

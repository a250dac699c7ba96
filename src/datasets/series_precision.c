/* Converts samples to single precision and measures how much each channel loses by rounding. */
#include <math.h>
#include <stdio.h>

#include "core/rounding.h"
#include "datasets/series_files.h"

/* Rounding error of a channel, relative to its standard deviation, above which there is a warning or a
 * failure. */
static const double worth_a_warning = 0.01, lost = 0.5;
/* Halfway between the largest float and 2^128. Numbers from here on round to infinity. */
static const double beyond = 0x1.ffffffp127;

/* Sums over one channel: of deviations from the channel's first sample, and the norms (roots of the sums of
 * squares) of deviations and rounding errors. */
typedef struct channel_sums {
    double first, largest, deviation, deviations, errors;
} channel_sums;

/* Converts one channel of a window. Numbers that are not finite are found later. */
static void convert(channel_sums *sums, const double *values, size_t length, float *out) {
    double deviation = 0, error = 0, d2 = 0, e2 = 0;
    for (size_t t = 0; t < length; t++) {
        out[t] = fabs(values[t]) >= beyond ? (float)copysign(INFINITY, values[t]) : (float)values[t];
        sums->largest = fmax(sums->largest, fabs(values[t]));
        deviation = fmax(deviation, fabs(values[t] - sums->first));
        error = fmax(error, fabs((double)out[t] - values[t]));
    }
    for (size_t t = 0; t < length && deviation > 0; t++) {
        const double d = (values[t] - sums->first) / deviation;
        sums->deviation += values[t] - sums->first;
        d2 += d * d;
    }
    for (size_t t = 0; t < length && error > 0; t++) {
        const double e = ((double)out[t] - values[t]) / error;
        e2 += e * e;
    }
    sums->deviations = hypot(sums->deviations, deviation * sqrt(d2));
    sums->errors = hypot(sums->errors, error * sqrt(e2));
}

static lg_status convert_all(lg_h5 *h5, const lg_series *s, channel_sums *channel, lg_error *error) {
    lg_h5_about about;
    LG_TRY(lg_h5_look(h5, "X", sizeof *s->x, &about, error));
    const size_t window = (size_t)s->channels * s->length, most = (size_t)lg_h5_block(&about, 0);
    LG_TRY_SCRATCH(double, values, h5->context, most *window, lg_h5_no_memory(h5, error));
    for (size_t at = 0; at < s->count; at += most) {
        const lg_h5_slice block = {
            .name = "X", .first = at, .count = s->count - at < most ? s->count - at : most};
        LG_TRY(lg_h5_get_slice(h5, &block, LG_H5_EXACT, values, error));
        for (size_t i = 0; i < block.count * s->channels; i++) {
            channel_sums *sums = &channel[i % s->channels];
            const double *from = values + i * s->length;
            if (at == 0 && i < s->channels) sums->first = from[0];
            convert(sums, from, s->length, s->x + at * window + i * s->length);
        }
    }
    return LG_OK;
}

/* Root mean square of the rounding errors, divided by the standard deviation, both over n samples. 0 for a
 * constant channel. */
static double part_lost(const channel_sums *sums, double n) {
    const double scale = sums->deviations;
    if (!(scale > 0) || sums->errors == 0) return 0;
    const double mean = sums->deviation / n / scale, deviation = sqrt(fmax(1 / n - mean * mean, 0));
    if (!(deviation > 0) || lg_is_rounding(deviation * scale, sums->largest)) return 0;
    return sums->errors / scale / sqrt(n) / deviation;
}

lg_status lg_series_convert(lg_h5 *h5, lg_series *series, lg_precision *out, lg_error *error) {
    const char *shown = lg_shown_path(h5->path);
    *out = (lg_precision){.part = 0};
    LG_TRY_SCRATCH(channel_sums, channel, h5->context, series->channels, lg_no_memory_for(shown, error));
    LG_TRY(convert_all(h5, series, channel, error));
    const double n = (double)series->count * series->length;
    for (uint32_t k = 0; k < series->channels; k++) {
        const double part = part_lost(&channel[k], n);
        if (!(part > worth_a_warning)) continue;
        out->channels++;
        if (!(part > out->part)) continue;
        out->part = part;
        const char *name = series->channel_name != NULL ? series->channel_name[k] : "";
        (void)snprintf(out->name, sizeof out->name, name[0] != '\0' ? "%u '%s'" : "%u", k + 1, name);
    }
    return LG_OK;
}

lg_status lg_precision_check(const char *path, const lg_precision *precision, lg_error *error) {
    if (!(precision->part > lost)) return LG_OK;
    return lg_fail(error, LG_FORMAT,
                   "%s: /X: single precision loses the signal of channel %s: its rounding is %.2g of the "
                   "standard deviation; subtract the channel's mean or rescale it",
                   lg_shown_path(path), precision->name, precision->part);
}

void lg_precision_warn(const lg_context *context, const char *path, const lg_precision *precision) {
    if (precision->channels == 0) return;
    lg_log_message(context, LG_LOG_WARNING,
                   "%s: /X: single precision rounds away %.2g of the standard deviation of channel %s%s: "
                   "subtract the channel's mean or rescale it",
                   lg_shown_path(path), precision->part, precision->name,
                   precision->channels > 1 ? ", and much of others" : "");
}

/* Makes the windows and the parts of a training from the options. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-anomaly/train.h"

/* The baseline's: ten minutes, every minute. */
static const double baseline_window = 600, baseline_hop = 60;
enum { BASELINE_STORED = 10 }; /* if the rate is unknown: stored windows instead of minutes */

/* Seconds, or samples if the rate is unknown. */
static lg_status samples_of(const char *option, double value, double rate, uint64_t *out, lg_error *error) {
    const double samples = rate > 0 ? value * rate : value, whole = floor(samples + 0.5);
    if (!(whole >= 1 && whole < 4294967296.0))
        return app_error(error, LG_INVALID_ARGUMENT, "--%s %g: is %g samples%s", option, value, samples,
                         rate > 0 ? "" : " (the data do not tell their rate)");
    if (fabs(samples - whole) > 1e-6 * samples)
        return app_error(error, LG_INVALID_ARGUMENT, "--%s %g: is %.6g samples, not a whole number%s", option,
                         value, samples,
                         rate > 0 ? ""
                                  : " (the sampling rate of the data is unknown: give samples, not "
                                    "seconds)");
    *out = (uint64_t)whole;
    return LG_OK;
}

/* Ten minutes if the recordings are long enough, otherwise the stored windows. */
static void baseline_defaults(const lg_series *series, uint64_t *window, uint64_t *hop) {
    if (series->run == NULL) {
        *window = series->length;
        *hop = series->length;
    } else if (series->rate > 0) {
        *window = (uint64_t)fmax(floor(baseline_window * series->rate + 0.5), 1);
        *hop = (uint64_t)fmax(floor(baseline_hop * series->rate + 0.5), 1);
    } else {
        *window = (uint64_t)BASELINE_STORED * series->length;
        *hop = series->length;
    }
}

lg_status window_of(const app *self, const lg_series *series, uint64_t *window, uint64_t *hop,
                    lg_error *error) {
    const train_values *values = &train_given;
    lg_status status = LG_OK;
    *window = series->length;
    *hop = 0;
    if (values->method == METHOD_BASELINE) baseline_defaults(series, window, hop);
    if (app_given(self, "window")) {
        status = samples_of("window", values->window, series->rate, window, error);
        *hop = 0;
    }
    if (status == LG_OK && app_given(self, "hop"))
        status = samples_of("hop", values->hop, series->rate, hop, error);
    if (status == LG_OK && *hop == 0) *hop = *window;
    return status;
}

lg_status cut_and_split(const lg_context *context, const lg_series *series, const well_cut *how,
                        lg_windows *windows, uint8_t **parts, lg_error *error) {
    *parts = NULL;
    lg_status status =
        lg_windows_create(context, series, (size_t)how->window, (size_t)how->hop, windows, error);
    if (status != LG_OK) return status;
    *parts = app_alloc(windows->count, 1);
    status = lg_series_split(context, series, windows, how->split, how->test_fraction,
                             how->validation_fraction, how->seed, *parts, error);
    if (status == LG_OK) return LG_OK;
    free(*parts);
    *parts = NULL;
    lg_windows_destroy(windows);
    return status;
}

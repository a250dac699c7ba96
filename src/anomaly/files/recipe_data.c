/* Data for training a detector: reading, cutting into windows, splitting into parts. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "anomaly/files/recipe.h"
#include "core/clean.h"
#include "core/lookup.h"
#include "datasets/series_files.h"

/* ---- reading ---- */

/* Reorders the channels of the series so that their names are in the order of `name` (channels). Does nothing
 * if the names are not the same up to their order. */
static lg_status order_channels(const lg_context *context, lg_series *series, char (*name)[LG_SERIES_NAME]) {
    const uint32_t m = series->channels;
    const size_t n = series->length;
    if (name == NULL || series->channel_name == NULL) return LG_OK;
    LG_TRY_SCRATCH(uint32_t, from, context, m, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(lg_lookup, sorted, context, m, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(bool, taken, context, m, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(float, window, context, m *n, LG_OUT_OF_MEMORY);
    for (uint32_t c = 0; c < m; c++) sorted[c] = (lg_lookup){series->channel_name[c], c};
    lg_lookup_sort(sorted, m);
    for (uint32_t c = 0; c < m; c++) { /* from[c]: the channel of the series with the name name[c] */
        const lg_lookup *found = lg_lookup_find(sorted, m, name[c]);
        if (found == NULL || taken[found->at]) return LG_OK;
        from[c] = (uint32_t)found->at;
        taken[found->at] = true;
    }
    for (size_t i = 0; i < series->count; i++) {
        float *x = series->x + i * m * n;
        memcpy(window, x, m * n * sizeof *x);
        for (uint32_t c = 0; c < m; c++) memcpy(x + c * n, window + from[c] * n, n * sizeof *x);
    }
    memcpy(series->channel_name, name, m * sizeof *name);
    return LG_OK;
}

lg_status lg_series_read_like(const lg_context *context, const char *path, const lg_series *like,
                              lg_series_data *out, lg_error *error) {
    lg_series *series = &out->series;
    LG_TRY(lg_series_read(context, path, NULL, like->classes > 0 ? like : NULL, out, error));
    if (series->channels != like->channels)
        return lg_fail(error, LG_SHAPE, "%s: has %u channels, but the model was trained on %u", path,
                       series->channels, like->channels);
    LG_TRY(order_channels(context, series, like->channel_name));
    const bool named = like->channel_name != NULL && series->channel_name != NULL;
    uint32_t c = 0;
    while (named && c < like->channels && strcmp(like->channel_name[c], series->channel_name[c]) == 0) c++;
    if (named && c < like->channels)
        lg_log_message(context, LG_LOG_WARNING, "%s: channel %u is '%s', but in training it was '%s'", path,
                       c + 1, series->channel_name[c], like->channel_name[c]);
    if (like->rate > 0 && series->rate > 0 && fabs(series->rate / like->rate - 1) > 1e-3)
        lg_log_message(context, LG_LOG_WARNING,
                       "%s: has %g samples per second, but the model was trained on %g", path, series->rate,
                       like->rate);
    return LG_OK;
}

/* ---- the healthy class ---- */

void lg_series_merge(const lg_context *context, const char *path, const char *healthy, lg_series_data *data) {
    lg_series *series = &data->series;
    uint32_t others = 0, own = lg_series_healthy(series, healthy);
    if (own == LG_NO_CLASS) {
        own = lg_series_healthy(series, data->healthy);
        lg_log_message(context, LG_LOG_WARNING,
                       "%s: no class is '%s', the healthy class of the training: '%s' is taken for it; "
                       "attribute healthy can name another class",
                       path, healthy, own == LG_NO_CLASS ? "none" : series->class_name[own]);
    }
    for (size_t i = 0; i < series->count; i++) {
        series->label[i] = series->label[i] != own;
        others |= series->label[i];
    }
    series->classes = 1 + others;
}

lg_status lg_find_healthy(const lg_context *context, const lg_series *names, const char *data,
                          char healthy[LG_SERIES_NAME], uint32_t *out, lg_error *error) {
    const char *wanted = healthy[0] != '\0' ? healthy : data;
    char list[160];
    *out = lg_series_healthy(names, wanted);
    lg_names_show(names->class_name, names->classes, list, sizeof list);
    if (*out == LG_NO_CLASS && healthy[0] != '\0')
        return lg_fail(error, LG_INVALID_ARGUMENT, "--healthy: '%s' is none of the classes %s", healthy,
                       list);
    if (*out != LG_NO_CLASS && wanted[0] == '\0')
        lg_log_message(context, LG_LOG_WARNING,
                       "class '%s' is taken as healthy because of its name: --healthy NAME says which of the "
                       "classes %s means that all is well, or attribute healthy of the data",
                       names->class_name[*out], list);
    (void)snprintf(healthy, LG_SERIES_NAME, "%s", *out != LG_NO_CLASS ? names->class_name[*out] : "");
    return LG_OK;
}

void lg_ask_healthy(const lg_series *names, char *text, size_t size) {
    char list[160];
    lg_names_show(names->class_name, names->classes, list, sizeof list);
    (void)snprintf(text, size,
                   "it is unknown which of the classes %s means that all is well: give --healthy NAME, or "
                   "attribute healthy of the data",
                   list);
}

lg_status lg_detector_settle(const lg_training *self, lg_error *error) {
    lg_detector_state *s = self->state;
    lg_detector_run *run = self->run;
    const lg_series *series = &s->all.data.series;
    char text[320];
    LG_TRY(lg_find_healthy(self->context, series, s->all.data.healthy, run->healthy, &s->healthy, error));
    lg_ask_healthy(series, text, sizeof text);
    if (s->healthy == LG_NO_CLASS) LG_WARN(self, "no false alarms are counted: %s", text);
    if (!s->alone) return LG_OK;
    if (s->healthy == LG_NO_CLASS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "--classifier novelty: %s", text);
    lg_series_merge(self->context, self->paths[0], run->healthy, &s->all.data);
    if (s->test != NULL) lg_series_merge(self->context, s->test, run->healthy, &s->foreign.data);
    s->healthy = 0;
    return LG_OK;
}

/* ---- windows ---- */

/* Converts the value of an option to samples. The value is in seconds, or in
 * samples if the rate is unknown (0). */
static lg_status samples_of(const char *option, double value, double rate, uint64_t *out, lg_error *error) {
    const double samples = rate > 0 ? value * rate : value, whole = floor(samples + 0.5);
    if (!(whole >= 1 && whole < 4294967296.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "--%s %g: is %g samples, expected at least 1 and fewer than 2^32%s", option, value,
                       samples, rate > 0 ? "" : " (the sampling rate of the data is unknown)");
    if (fabs(samples - whole) > 1e-6 * samples)
        return lg_fail(error, LG_INVALID_ARGUMENT, "--%s %g: is %.6g samples, not a whole number%s", option,
                       value, samples,
                       rate > 0 ? ""
                                : " (the sampling rate of the data is unknown: give samples, not seconds)");
    *out = (uint64_t)whole;
    return LG_OK;
}

lg_status lg_detector_window(const lg_training *self, uint64_t *window, uint64_t *hop, lg_error *error) {
    const lg_detector_state *s = self->state;
    const double rate = s->all.data.series.rate;
    if (self->given(self, "window")) {
        LG_TRY(samples_of("window", s->window, rate, window, error));
        *hop = 0;
    }
    if (self->given(self, "hop")) LG_TRY(samples_of("hop", s->hop, rate, hop, error));
    if (*hop == 0) *hop = *window;
    return LG_OK;
}

/* ---- parts ---- */

lg_status lg_window_part(const lg_context *context, const lg_cut_series *from, const lg_detector_run *run,
                         lg_part wanted, lg_window_list *out, lg_error *error) {
    const size_t count = from->windows.count;
    LG_SCRATCH(uint8_t, parts, context, count);
    *out = (lg_window_list){lg_alloc(context, count, sizeof *out->list), 0};
    if (parts == NULL || out->list == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "out of memory: %zu windows", count);
    if (run != NULL)
        LG_TRY(lg_series_split(context, &from->data.series, &from->windows, run->split, run->test_fraction,
                               run->validation_fraction, run->training.seed, parts, error));
    for (size_t i = 0; i < count; i++)
        if (run == NULL || parts[i] == (uint8_t)wanted) out->list[out->count++] = (uint32_t)i;
    return LG_OK;
}

const lg_cut_series *lg_detector_tested(const lg_detector_state *state) {
    return state->test != NULL ? &state->foreign : &state->all;
}

/* Whether there are several units, and some have more than one window. */
static bool has_units(const uint32_t *unit, size_t count) {
    bool alike = false, other = false;
    for (size_t i = 1; unit != NULL && i < count; i++) *(unit[i] == unit[i - 1] ? &alike : &other) = true;
    return alike && other;
}

static void warn_of_cut(const lg_training *self) {
    const lg_detector_run *run = self->run;
    const lg_detector_state *s = self->state;
    const lg_series *series = &s->all.data.series;
    const char *unit = has_units(series->group, series->count) ? "group"
                       : has_units(series->run, series->count) ? "run"
                                                               : NULL;
    const bool alone = run->split == LG_SPLIT_RANDOM;
    for (uint32_t c = 0, i; run->test_fraction > 0 && c < series->classes; c++) {
        for (i = 0; i < s->tested.count && series->label[s->all.windows.first[s->tested.list[i]]] != c;) i++;
        if (i == s->tested.count)
            LG_WARN(
                self,
                "the test part has no window of class '%s', so no figure says how well it is found: give a "
                "larger --test-fraction, or --test FILE",
                series->class_name[c]);
    }
    if (run->validation_fraction > 0 && s->validation.count == 0)
        LG_WARN(self,
                "--validation-fraction %g: this fraction of the %ss is too small for one window: there is no "
                "validation, and the parameters of the last epoch are kept",
                run->validation_fraction, alone ? "window" : lg_split_name(run->split));
    if (run->hop < run->window && alone && (run->test_fraction > 0 || run->validation_fraction > 0))
        LG_WARN(self, "windows overlap and are split at random, so training samples are also test samples; "
                      "use --split run or --split group");
    else if (alone && run->test_fraction > 0 && unit != NULL)
        LG_WARN(self,
                "single windows are split at random, but the data have /%s, and windows of one %s resemble "
                "each other: the figures are too good; use --split %s",
                unit, unit, unit);
}

static lg_status cut_windows(const lg_training *self, lg_cut_series *of, lg_error *error) {
    const lg_detector_run *run = self->run;
    return lg_windows_create(self->context, &of->data.series, (size_t)run->window, (size_t)run->hop,
                             &of->windows, error);
}

lg_status lg_detector_split_training(lg_training *self, lg_error *error) {
    lg_detector_state *s = self->state;
    lg_detector_run *run = self->run;
    LG_TRY(cut_windows(self, &s->all, error));
    run->windows = s->all.windows.count;
    LG_TRY(lg_window_part(self->context, &s->all, run, LG_PART_TRAIN, &s->train, error));
    return lg_window_part(self->context, &s->all, run, LG_PART_VALIDATION, &s->validation, error);
}

lg_status lg_detector_split(lg_training *self, lg_error *error) {
    lg_detector_state *s = self->state;
    lg_error why = {LG_OK, ""};
    LG_TRY(lg_detector_split_training(self, error));
    const lg_status status = s->test != NULL ? cut_windows(self, &s->foreign, &why) : LG_OK;
    if (status != LG_OK)
        return lg_fail(error, status == LG_OUT_OF_MEMORY ? status : LG_FORMAT, "%s: %s", s->test,
                       why.message);
    LG_TRY(lg_window_part(self->context, lg_detector_tested(s), s->test != NULL ? NULL : self->run,
                          LG_PART_TEST, &s->tested, error));
    warn_of_cut(self);
    return LG_OK;
}

lg_status lg_detector_fit_novelty(const lg_training *self, lg_novelty *out, lg_error *error) {
    const lg_detector_state *s = self->state;
    lg_novelty_options options;
    lg_error why = {LG_OK, ""};
    lg_novelty_options_init(&options);
    const lg_status status = lg_novelty_fit(self->context, &options, &s->all.data.series, &s->all.windows,
                                            s->train.list, s->train.count, (int)self->threads, out, &why);
    if (status == LG_CANCELLED || status == LG_OUT_OF_MEMORY)
        return lg_fail(error, status, "%s", why.message);
    if (status != LG_OK)
        LG_WARN(self,
                "the model has no record of what its training windows look like (%s): `watch` will not "
                "notice windows that are unlike them",
                why.message);
    return LG_OK;
}

/* Labelled series, and the parts that they are split into. */
#include <math.h>
#include <string.h>

#include "lg-anomaly/anomaly.h"

int read_series(const app *self, const char *path, const lg_series *like, lg_series_data *out) {
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_series_read(self->context, path, NULL, like, out, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, path);
}

static void warn_of_names(const app *self, const char *path, const lg_series *series, uint32_t channels,
                          char (*name)[LG_SERIES_NAME]) {
    if (name == NULL || series->channel_name == NULL) return;
    for (uint32_t c = 0; c < channels; c++)
        if (strcmp(name[c], series->channel_name[c]) != 0) {
            app_warn(self, "%s: channel %u is '%s', in training it was '%s'", path, c + 1,
                     series->channel_name[c], name[c]);
            return;
        }
}

/* from (channels): which channel of the series each name is. False: not all of them are there, each once. */
static bool find_channels(const lg_series *series, char (*name)[LG_SERIES_NAME], uint32_t *from) {
    for (uint32_t c = 0; c < series->channels; c++) {
        from[c] = 0;
        while (from[c] < series->channels && strcmp(name[c], series->channel_name[from[c]]) != 0) from[c]++;
        if (from[c] == series->channels) return false;
        for (uint32_t before = 0; before < c; before++)
            if (from[before] == from[c]) return false;
    }
    return true;
}

/* Channels in the order of `name` (channels), where they have these names in another one. */
static void order_channels(lg_series *series, char (*name)[LG_SERIES_NAME]) {
    const uint32_t m = series->channels;
    const size_t n = series->length;
    if (name == NULL || series->channel_name == NULL) return;
    APP_FREE uint32_t *from = app_alloc(m, sizeof *from);
    APP_FREE float *window = app_alloc(m * n, sizeof *window);
    const bool all = find_channels(series, name, from);
    for (size_t i = 0; i < series->count && all; i++) {
        float *x = series->x + i * m * n;
        memcpy(window, x, m * n * sizeof *x);
        for (uint32_t c = 0; c < m; c++) memcpy(x + c * n, window + from[c] * n, n * sizeof *x);
    }
    if (all) memcpy(series->channel_name, name, m * sizeof *name);
}

void read_series_of(const app *self, const char *path, const well_model *model, lg_series_data *out) {
    const lg_series like = {
        .classes = model->classes, .class_name = model->class_name, .class_label = model->class_label};
    const lg_series *series = &out->series;
    APP_MUST_FILE(
        self, path,
        lg_series_read(self->context, path, NULL, model->sort == WELL_NOVELTY ? NULL : &like, out, &error));
    if (model->sort == WELL_NOVELTY) merge_classes(&out->series, model->class_name[0]);
    if (series->channels != model->channels)
        app_stop(self, LG_SHAPE, "%s: %u channels, the model was trained on %u", path, series->channels,
                 model->channels);
    order_channels(&out->series, model->channel_name);
    warn_of_names(self, path, series, model->channels, model->channel_name);
    if (model->rate > 0 && series->rate > 0 && fabs(series->rate / model->rate - 1) > 1e-3)
        app_warn(self, "%s: %g samples a second, the model was trained on %g", path, series->rate,
                 model->rate);
}

void merge_classes(lg_series *series, const char *first) {
    uint32_t others = 0;
    for (size_t i = 0; i < series->count; i++) {
        series->label[i] = strcmp(series->class_name[series->label[i]], first) != 0;
        others |= series->label[i];
    }
    series->classes = 1 + others;
}

part_indices part_of(const uint8_t *parts, size_t count, lg_part wanted) {
    part_indices out = {app_alloc(count, sizeof *out.list), 0};
    for (size_t i = 0; i < count; i++)
        if (parts[i] == (uint8_t)wanted) out.list[out.count++] = (uint32_t)i;
    return out;
}

part_indices part_all(size_t count) {
    part_indices out = {app_alloc(count, sizeof *out.list), count};
    for (size_t i = 0; i < count; i++) out.list[i] = (uint32_t)i;
    return out;
}

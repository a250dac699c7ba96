/* Reads labelled series for a model. */
#include <string.h>

#include "lg-anomaly/anomaly.h"

void read_series_of(const app *self, const char *path, const well_model *model, lg_series_data *out) {
    const bool any = model->sort == WELL_NOVELTY;
    const lg_series like = {.classes = any ? 0 : model->classes,
                            .channels = model->channels,
                            .rate = model->rate,
                            .class_name = model->class_name,
                            .class_label = model->class_label,
                            .channel_name = model->channel_name};
    APP_MUST_FILE(self, path, lg_series_read_like(self->context, path, &like, out, &error));
    if (any) merge_classes(&out->series, model->class_name[0]);
}

void merge_classes(lg_series *series, const char *healthy) {
    uint32_t others = 0;
    for (size_t i = 0; i < series->count; i++) {
        series->label[i] = strcmp(series->class_name[series->label[i]], healthy) != 0;
        others |= series->label[i];
    }
    series->classes = 1 + others;
}

/* Random convolution features: numbers, names, memory. autodiff/ops/rocket.c computes them. */
#include "anomaly/classify/features.h"

#include <stdio.h>

lg_rocket_table lg_rocket_table_of(const lg_rocket *r) {
    return (lg_rocket_table){(const lg_rocket_row *)(const void *)r->convolution, r->channel, r->count,
                             r->listed};
}

static uint64_t rocket_count(const lg_features *f) {
    uint64_t count = 0;
    for (uint32_t i = 0; i < f->rocket.count; i++) count += f->rocket.convolution[i].features;
    return count;
}

static int describe_rocket(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                           size_t size) {
    const lg_rocket_convolution *c = f->rocket.convolution;
    const uint32_t *channel = f->rocket.channel;
    const float bias = f->rocket.bias[index];
    char names[256] = "";
    while (index >= c->features) index -= c->features, channel += c->channels, c++;
    for (uint32_t i = 0, used = 0; i < c->channels && used < sizeof names; i++) {
        char name[LG_SERIES_NAME];
        (void)lg_channel_name(series, f->select[channel[i] / 2], name, sizeof name);
        used += (uint32_t)snprintf(names + used, sizeof names - used, "%s%s",
                                   channel[i] % 2 == 1 ? "-"
                                   : i > 0             ? "+"
                                                       : "",
                                   name);
    }
    return lg_format(text, size, "rocket %u dilation %u %s > %.6g%s", c->kernel, c->dilation, names,
                     (double)bias, c->kernel < LG_ROCKET_CHOICES ? " rms" : "");
}

static lg_var record_rocket(lg_tape *t, const lg_features *f, lg_var eps, lg_var x) {
    const lg_rocket_table table = lg_rocket_table_of(&f->rocket);
    const uint32_t m = f->selected;
    LG_SCRATCH(double, mean, NULL, 2 * (size_t)m + f->count);
    if (mean == NULL) return LG_NONE;
    double *inverse = mean + m, *bias = inverse + m;
    for (uint32_t i = 0; i < m; i++) {
        mean[i] = f->rocket.mean[f->select[i]];
        inverse[i] = 1 / f->scale[f->select[i]];
    }
    for (uint32_t i = 0; i < f->count; i++) bias[i] = (double)f->rocket.bias[i];
    return lg_rocket_record(t, lg_features_chosen(t, f, x), lg_input_f64(t, lg_shape1(m), mean),
                            lg_input_f64(t, lg_shape1(m), inverse),
                            lg_input_f64(t, lg_shape1(f->count), bias), &table);
}

const lg_feature_row lg_feature_rocket = {
    .name = "rocket", .count = rocket_count, .record = record_rocket, .describe = describe_rocket};

void lg_rocket_destroy(const lg_context *context, lg_rocket *r) {
    LG_FREE_ALL(context, r->convolution, r->channel, r->bias, r->mean);
    *r = (lg_rocket){0};
}

/* Random convolution features, after Dempster, Schmidt, Webb: MiniRocket, KDD 2021. lg_rocket has the
 * formulas, and what is different here.
 *
 * Work memory, in floats: the scaled channels (m, length + 2 margin), zero outside of the window; the sums of
 * their nine taps (m, length); one convolution (length, and a vector beyond). The margin is four times the
 * largest dilation, so that a tap never lies outside of the memory. */
#include "anomaly/classify/features.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "kernels/kernels.h"

enum {
    WEIGHTED = 3, /* taps of weight 2 */
    VECTOR = 16,  /* a convolution is filled up to a multiple of this */
    CHUNK = 256   /* thresholds that are counted at a time */
};

/* ---- kernels ---- */

/* The taps of weight 2 of a kernel below LG_ROCKET_CHOICES. These kernels are the choices of three taps in
 * lexicographic order. */
static void weighted_taps(uint32_t kernel, uint32_t tap[WEIGHTED]) {
    for (tap[0] = 0; tap[0] < LG_ROCKET_TAPS; tap[0]++)
        for (tap[1] = tap[0] + 1; tap[1] < LG_ROCKET_TAPS; tap[1]++)
            for (tap[2] = tap[1] + 1; tap[2] < LG_ROCKET_TAPS; tap[2]++)
                if (kernel-- == 0) return;
}

/* ---- memory ---- */

typedef struct rocket_work {
    size_t margin, row; /* row: length + 2 margin */
    float rms;          /* of the scaled window */
    float *z, *sum, *y;
} rocket_work;

static size_t margin_of(const lg_rocket *r) {
    uint32_t most = 0;
    for (uint32_t i = 0; i < r->count; i++)
        if (r->convolution[i].dilation > most) most = r->convolution[i].dilation;
    return (size_t)most * (LG_ROCKET_TAPS / 2);
}

static rocket_work lay_out(const lg_features *f, double *work) {
    rocket_work w = {.margin = margin_of(&f->rocket), .z = (float *)(void *)work};
    w.row = f->length + 2 * w.margin;
    w.sum = w.z + f->selected * w.row;
    w.y = w.sum + (size_t)f->selected * f->length;
    return w;
}

size_t lg_rocket_work_doubles(const lg_features *f) {
    const size_t row = f->length + 2 * margin_of(&f->rocket);
    return (f->selected * (row + f->length) + f->length + VECTOR + 1) / 2;
}

/* ---- convolutions ---- */

/* Scales the channels of x, and computes the root mean square of the scaled window. The squares of floats are
 * exact in double, so that fused operations cannot change their sum. Returns whether all numbers are
 * finite. */
static bool scale_channels(const lg_kernels *k, const lg_features *f, const float *x, rocket_work *w) {
    double sum = 0;
    for (uint32_t i = 0; i < f->selected; i++) {
        const uint32_t channel = f->select[i];
        const float mean = (float)f->rocket.mean[channel], inverse = (float)(1 / f->scale[channel]);
        const float *from = x + (size_t)channel * f->length;
        float *row = w->z + i * w->row, *z = row + w->margin;
        memset(row, 0, w->margin * sizeof *row);
        memset(z + f->length, 0, w->margin * sizeof *row);
        for (uint32_t t = 0; t < f->length; t++) z[t] = (from[t] - mean) * inverse;
        for (uint32_t t = 0; t < f->length; t++) sum += (double)z[t] * (double)z[t];
    }
    w->rms = (float)sqrt(sum / ((double)f->selected * f->length));
    return k->all_finite(f->selected * w->row, w->z);
}

static void sum_taps(const lg_kernels *k, const lg_features *f, uint32_t dilation, const rocket_work *w) {
    for (uint32_t i = 0; i < f->selected; i++)
        k->taps_sum(f->length, w->z + i * w->row + w->margin - (size_t)dilation * (LG_ROCKET_TAPS / 2),
                    dilation, w->sum + (size_t)i * f->length);
}

/* Number of samples that a convolution is compared at: all of them, or only those where no tap lies outside
 * of the window. *first becomes the first of them. */
static size_t span_of(const lg_features *f, const lg_rocket_convolution *c, size_t *first) {
    *first = c->padded ? 0 : (size_t)c->dilation * (LG_ROCKET_TAPS / 2);
    return f->length - 2 * *first;
}

/* Writes the convolution to w->y, added up over its channels, from the sums of taps for its dilation. */
static void convolve(const lg_kernels *k, const lg_features *f, const lg_rocket_convolution *c,
                     const uint32_t *channel, const rocket_work *w) {
    uint32_t tap[WEIGHTED] = {0};
    if (c->kernel < LG_ROCKET_CHOICES)
        weighted_taps(c->kernel, tap);
    else
        memset(w->y, 0, f->length * sizeof *w->y);
    for (uint32_t i = 0; i < c->channels; i++) {
        const size_t number = channel[i] / 2;
        const double sign = channel[i] % 2 == 0 ? 1 : -1;
        const float *from = w->z + number * w->row + w->margin - (size_t)c->dilation * (LG_ROCKET_TAPS / 2),
                    *sum = w->sum + number * f->length;
        const void *at[WEIGHTED];
        for (int j = 0; j < WEIGHTED; j++) at[j] = from + (size_t)tap[j] * c->dilation;
        if (c->kernel < LG_ROCKET_CHOICES)
            k->taps_apply(f->length, at, sum, sign, w->y, i > 0);
        else
            k->axpy(f->length, sign, sum, w->y);
    }
}

/* The unit of the convolution's thresholds. */
static float unit_of(const lg_rocket_convolution *c, const rocket_work *w) {
    return c->kernel < LG_ROCKET_CHOICES ? w->rms : 1;
}

/* out[j] = the part of the convolution's samples that are above bias[j]. */
static void compare(const lg_kernels *k, const lg_features *f, const lg_rocket_convolution *c,
                    const float *bias, const rocket_work *w, double *out) {
    float level[CHUNK];
    uint32_t count[CHUNK];
    size_t first;
    const size_t n = span_of(f, c, &first), whole = (n + VECTOR - 1) / VECTOR * VECTOR;
    const float unit = unit_of(c, w);
    for (size_t i = n; i < whole; i++) w->y[first + i] = -INFINITY;
    for (uint32_t j = 0; j < c->features; j += CHUNK) {
        const uint32_t some = c->features - j < CHUNK ? c->features - j : CHUNK;
        for (uint32_t i = 0; i < some; i++) level[i] = bias[j + i] * unit;
        k->count_above(whole, w->y + first, some, level, count);
        for (uint32_t i = 0; i < some; i++) out[j + i] = count[i] / (double)n;
    }
}

static lg_status compute_rocket(const lg_features *f, const float *x, double *out, double *work) {
    const lg_kernels *k = lg_kernels_for(LG_F32);
    const lg_rocket *r = &f->rocket;
    rocket_work w = lay_out(f, work);
    const uint32_t *channel = r->channel;
    const float *bias = r->bias;
    if (!scale_channels(k, f, x, &w)) return LG_NOT_FINITE;
    for (uint32_t i = 0, dilation = 0; i < r->count; i++) {
        const lg_rocket_convolution *c = &r->convolution[i];
        if (c->dilation != dilation) sum_taps(k, f, dilation = c->dilation, &w);
        convolve(k, f, c, channel, &w);
        compare(k, f, c, bias, &w, out);
        channel += c->channels, bias += c->features, out += c->features;
    }
    return LG_OK;
}

size_t lg_rocket_values(const lg_features *f, const lg_rocket_convolution *c, const uint32_t *channel,
                        const float *x, double *work, float **y, double *unit) {
    const lg_kernels *k = lg_kernels_for(LG_F32);
    rocket_work w = lay_out(f, work);
    size_t first;
    if (!scale_channels(k, f, x, &w)) return 0;
    sum_taps(k, f, c->dilation, &w);
    convolve(k, f, c, channel, &w);
    const size_t n = span_of(f, c, &first);
    *y = w.y + first;
    *unit = (double)unit_of(c, &w);
    return n;
}

static lg_feature_sizes rocket_sizes(const lg_features *f) {
    uint64_t count = 0;
    for (uint32_t i = 0; i < f->rocket.count; i++) count += f->rocket.convolution[i].features;
    return (lg_feature_sizes){count, lg_rocket_work_doubles(f)};
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

const lg_feature_row lg_feature_rocket = {
    .name = "rocket", .sizes = rocket_sizes, .compute = compute_rocket, .describe = describe_rocket};

/* ---- memory and files ---- */

void lg_rocket_destroy(const lg_context *context, lg_rocket *r) {
    LG_FREE_ALL(context, r->convolution, r->channel, r->bias, r->mean);
    *r = (lg_rocket){0};
}

const char *lg_rocket_check(const lg_features *f) {
    const lg_rocket *r = &f->rocket;
    uint64_t listed = 0, features = 0;
    for (uint32_t i = 0; i < r->count; i++) {
        const lg_rocket_convolution *c = &r->convolution[i];
        if (c->kernel >= LG_ROCKET_KERNELS || c->padded > 1 || c->features == 0)
            return "has a kernel, a padding or a number of features that is out of range";
        if (c->dilation == 0 || (uint64_t)c->dilation * (LG_ROCKET_TAPS - 1) > f->length - 1)
            return "has a dilation that does not fit the window";
        if (c->channels == 0 || c->channels > f->selected) return "has no channels, or too many";
        listed += c->channels, features += c->features;
    }
    if (listed != r->listed || features != f->count) return "does not fit the channels or the thresholds";
    for (uint32_t i = 0; i < r->listed; i++)
        if (r->channel[i] / 2 >= f->selected) return "names a channel that does not exist";
    return NULL;
}

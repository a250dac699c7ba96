/* Fitting and pruning of random convolution features. */
#include "anomaly/classify/features.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_DILATIONS = 32 };

/* ---- dilations ---- */

/* Dilations floor(2^e) for evenly spaced e from 0 to log2((length - 1)/8), and how many features each kernel
 * has with each of them. A dilation that several e give has the features of all of them. Returns the number
 * of dilations. */
static uint32_t share_out(uint32_t length, uint32_t per_kernel, uint32_t dilation[MOST_DILATIONS],
                          uint32_t features[MOST_DILATIONS]) {
    const uint32_t exponents = per_kernel < MOST_DILATIONS ? per_kernel : MOST_DILATIONS;
    const double most = log2((length - 1) / (double)(LG_ROCKET_TAPS - 1));
    uint32_t count = 0, times[MOST_DILATIONS] = {0}, left = per_kernel;
    for (uint32_t i = 0; i < exponents; i++) {
        const double e = exponents > 1 ? most * i / (exponents - 1) : 0;
        /* The factor keeps 2^log2(d) at d, where rounding would give the integer below. */
        const uint32_t d = (uint32_t)(exp2(e) * (1 + 1e-12));
        if (count == 0 || dilation[count - 1] != d) dilation[count++] = d;
        times[count - 1]++;
    }
    for (uint32_t i = 0; i < count; i++) {
        features[i] = times[i] * per_kernel / exponents;
        left -= features[i];
    }
    for (uint32_t i = 0; left > 0; i = (i + 1) % count, left--) features[i]++;
    return count;
}

/* ---- fitting ---- */

void lg_rocket_options_init(lg_rocket_options *options) {
    *options = (lg_rocket_options){.size = sizeof *options, .features = 10000, .seed = 1};
}

/* What the fit reads and draws. */
typedef struct fitting {
    const lg_series *series;
    const lg_windows *windows;
    const uint32_t *chosen;
    size_t count;
    lg_rng rng;
    float *x;       /* (channels, length) a window */
    double *window; /* (selected, length) its selected channels, then their means and 1/scale */
    float *floats;  /* memory of convolutions */
    lg_rocket_work work;
    uint32_t *deck; /* (selected) channels, to draw some of them */
} fitting;

/* Draws how many channels a convolution adds up, 2^u for uniform u, at most nine, and moves them to the front
 * of the deck. */
static uint32_t draw_channels(fitting *fit, uint32_t selected) {
    const uint32_t most = selected < LG_ROCKET_TAPS ? selected : LG_ROCKET_TAPS;
    uint32_t count = (uint32_t)exp2(lg_rng_uniform_in(&fit->rng, 0, log2(most + 1.0)));
    if (count > most) count = most;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t j = i + (uint32_t)lg_rng_below(&fit->rng, selected - i), other = fit->deck[i];
        fit->deck[i] = fit->deck[j];
        fit->deck[j] = other;
    }
    return count;
}

static int by_value(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The thresholds of a convolution: quantiles of its values in one training window. Feature number i of all
 * has the level frac((i + 1) phi), phi the golden ratio, a sequence of low discrepancy. */
static lg_status fit_biases(fitting *fit, const lg_features *f, const lg_rocket_row *c,
                            const uint32_t *channel, size_t number, float *bias) {
    const double phi = 0.5 + sqrt(1.25);
    const size_t row = lg_rng_below(&fit->rng, fit->count), m = f->selected, length = f->length;
    double *mean = fit->window + m * length, *inverse = mean + m;
    size_t n;
    float single;
    lg_windows_copy(fit->series, fit->windows, lg_chosen_row(fit->chosen, row), fit->x);
    for (size_t i = 0; i < m; i++) {
        mean[i] = f->rocket.mean[f->select[i]];
        inverse[i] = 1 / f->scale[f->select[i]];
        for (size_t t = 0; t < length; t++)
            fit->window[i * length + t] = (double)fit->x[f->select[i] * length + t];
    }
    if (!lg_rocket_scale(fit->window, mean, inverse, &fit->work)) return LG_NOT_FINITE;
    float *y = lg_rocket_convolve(&fit->work, c, channel, true, &n, &single);
    const double unit = (double)single;
    qsort(y, n, sizeof *y, by_value);
    for (uint32_t i = 0; i < c->features; i++) {
        const double level = fmod((double)(number + i + 1) * phi, 1.0), at = level * (double)(n - 1);
        const size_t below = (size_t)at, above = below + 1 < n ? below + 1 : below;
        const double value = (double)y[below] + (at - floor(at)) * ((double)y[above] - (double)y[below]);
        bias[i] = (float)(unit > 0 ? value / unit : value);
    }
    return LG_OK;
}

/* Lists the convolutions and their channels. `channel` has room for nine per convolution. */
static void list_convolutions(fitting *fit, uint32_t length, uint32_t selected, uint32_t per_kernel,
                              lg_rocket *r) {
    uint32_t dilation[MOST_DILATIONS], features[MOST_DILATIONS];
    const uint32_t dilations = share_out(length, per_kernel, dilation, features);
    for (uint32_t i = 0; i < selected; i++) fit->deck[i] = i;
    for (uint32_t d = 0; d < dilations; d++)
        for (uint32_t kernel = 0; kernel < LG_ROCKET_KERNELS; kernel++) {
            if (features[d] == 0) continue;
            lg_rocket_convolution *c = &r->convolution[r->count++];
            *c = (lg_rocket_convolution){kernel, dilation[d], (kernel + d) % 2 == 0,
                                         draw_channels(fit, selected), features[d]};
            for (uint32_t i = 0; i < c->channels; i++)
                r->channel[r->listed++] = 2 * fit->deck[i] + (uint32_t)lg_rng_below(&fit->rng, 2);
        }
}

static lg_status draw(fitting *fit, const lg_context *context, uint32_t per_kernel, lg_features *f,
                      lg_error *error) {
    lg_rocket *r = &f->rocket;
    const size_t most = (size_t)LG_ROCKET_KERNELS * MOST_DILATIONS,
                 numbers = (size_t)LG_ROCKET_KERNELS * per_kernel;
    if (LG_ALLOC_ALL(context, LG_ARRAY(r->convolution, most), LG_ARRAY(r->channel, most * LG_ROCKET_TAPS),
                     LG_ARRAY(r->bias, numbers), LG_ARRAY(fit->deck, f->selected),
                     LG_ARRAY(fit->x, (size_t)f->channels * f->length)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu features", numbers);
    list_convolutions(fit, f->length, f->selected, per_kernel, r);
    const lg_rocket_table table = lg_rocket_table_of(r);
    const size_t m = f->selected, floats = lg_rocket_lay_out(&table, m, f->length, NULL, &fit->work);
    if (LG_ALLOC_ALL(context, LG_ARRAY(fit->floats, floats), LG_ARRAY(fit->window, m * (f->length + 2))) !=
        LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for windows of %u samples", f->length);
    (void)lg_rocket_lay_out(&table, m, f->length, fit->floats, &fit->work);
    const uint32_t *channel = r->channel;
    for (uint32_t i = 0; i < r->count; i++) {
        const lg_rocket_row c = table.row[i];
        const lg_status status = fit_biases(fit, f, &c, channel, f->count, r->bias + f->count);
        if (status != LG_OK)
            return lg_fail(error, status, "a training window has a number that is not finite");
        channel += c.channels, f->count += c.features;
    }
    return lg_features_ready(f, error);
}

static lg_status check_fit(const lg_rocket_options *o, const lg_windows *windows, size_t count,
                           lg_error *error) {
    if (o->size != sizeof *o)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the size of the options is %zu, expected %zu: begin with lg_rocket_options_init",
                       o->size, sizeof *o);
    if (count == 0) return lg_fail(error, LG_INVALID_ARGUMENT, "0 training windows: at least one is needed");
    if (windows->length < LG_ROCKET_TAPS)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a window of %u samples is too short for the convolutions, which have %d taps",
                       windows->length, LG_ROCKET_TAPS);
    if (o->features < LG_ROCKET_KERNELS || o->features > LG_FEATURES_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%u random convolution features: expected %d to %u",
                       o->features, LG_ROCKET_KERNELS, LG_FEATURES_MAX);
    return LG_OK;
}

lg_status lg_rocket_fit(const lg_context *context, const lg_rocket_options *options, const lg_series *series,
                        const lg_windows *windows, const uint32_t *chosen, size_t count,
                        const lg_scaler *scaler, lg_features *out, lg_error *error) {
    LG_CLEAN(lg_features_destroy) lg_features f = {0};
    LG_NEEDS(error, options, series, windows, scaler, out);
    LG_TRY(check_fit(options, windows, count, error));
    LG_TRY(lg_features_begin(context, LG_FEATURES_ROCKET, options->directions_x, series, windows->length,
                             scaler, &f, error));
    fitting fit = {.series = series, .windows = windows, .chosen = chosen, .count = count};
    lg_rng_seed(&fit.rng, options->seed, 0);
    f.rocket.mean = lg_alloc(context, f.channels, sizeof *f.rocket.mean);
    if (f.rocket.mean == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %u channels", f.channels);
    memcpy(f.rocket.mean, scaler->mean, f.channels * sizeof *f.rocket.mean);
    const lg_status status = draw(&fit, context, options->features / LG_ROCKET_KERNELS, &f, error);
    LG_FREE_ALL(context, fit.deck, fit.x, fit.window, fit.floats);
    LG_TRY(status);
    return LG_GIVE(out, f);
}

/* ---- pruning ---- */

/* Copies the convolutions of `from` that have a kept feature to `to`, whose arrays have room for all. keep
 * (count) is in rising order. */
static void copy_kept(const lg_rocket *from, const uint32_t *keep, size_t count, lg_rocket *to) {
    const uint32_t *channel = from->channel;
    size_t begin = 0, k = 0;
    for (uint32_t i = 0; i < from->count; i++) {
        const lg_rocket_convolution *c = &from->convolution[i];
        const size_t end = begin + c->features, first = k;
        for (; k < count && keep[k] < end; k++) to->bias[k] = from->bias[keep[k]];
        if (k > first) {
            to->convolution[to->count] = *c;
            to->convolution[to->count++].features = (uint32_t)(k - first);
            memcpy(to->channel + to->listed, channel, c->channels * sizeof *channel);
            to->listed += c->channels;
        }
        channel += c->channels, begin = end;
    }
}

static lg_status check_keep(const lg_features *f, const uint32_t *keep, size_t count, lg_error *error) {
    bool rising = count > 0 && keep[count - 1] < f->count;
    if (f->kind != LG_FEATURES_ROCKET)
        return lg_fail(error, LG_UNSUPPORTED, "features of the kind %s cannot be left out",
                       lg_feature_kind_name(f->kind));
    for (size_t i = 1; i < count; i++) rising = rising && keep[i] > keep[i - 1];
    return rising ? LG_OK
                  : lg_fail(error, LG_INVALID_ARGUMENT,
                            "the features to keep must be in rising order, at least one, and below %u",
                            f->count);
}

lg_status lg_rocket_prune(lg_features *features, const uint32_t *keep, size_t count, lg_error *error) {
    LG_NEEDS(error, features, keep);
    LG_TRY(check_keep(features, keep, count, error));
    const lg_rocket *from = &features->rocket;
    const lg_context *context = features->context;
    lg_rocket to = {0};
    if (LG_ALLOC_ALL(context, LG_ARRAY(to.convolution, from->count), LG_ARRAY(to.channel, from->listed),
                     LG_ARRAY(to.bias, count), LG_ARRAY(to.mean, features->channels)) != LG_OK) {
        lg_rocket_destroy(context, &to);
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu features", count);
    }
    memcpy(to.mean, from->mean, features->channels * sizeof *to.mean);
    copy_kept(from, keep, count, &to);
    lg_features kept = *features;
    kept.rocket = to, kept.count = (uint32_t)count, kept.plan = NULL;
    const lg_status status = lg_features_ready(&kept, error);
    lg_rocket_destroy(context, status == LG_OK ? &features->rocket : &to);
    LG_TRY(status);
    lg_plan_destroy(features->plan);
    *features = kept;
    return LG_OK;
}

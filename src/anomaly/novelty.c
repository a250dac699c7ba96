/* Novelty detector: features of a window, its distances to the classes, and the cause of a novelty. */
#include "liegrad/anomaly.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/portions.h"
#include "kernels/kernels.h"
#include "anomaly/novelty_internal.h"

/* Added to standard deviations and amplitudes, in units of the channel's scale, so that logarithms stay
 * finite. */
static const double FLOOR = 1e-3;
/* Factor on correlations before atanh, so that the feature of a correlation of 1 stays finite. */
static const double CORRELATED = 0.999999;

/* ---- layout ---- */

static uint32_t of_channel(const lg_novelty *v) {
    return NOVELTY_BAND + v->bands;
}

uint32_t lg_novelty_groups(const lg_novelty *v) {
    return 1 + v->channels + (v->pairs > 0);
}

novelty_group lg_novelty_group(const lg_novelty *v, uint32_t group) {
    const uint32_t each = of_channel(v);
    const size_t block = (size_t)each * each;
    if (group == 0) return (novelty_group){0, v->features, 0};
    if (group <= v->channels) return (novelty_group){(group - 1) * each, each, (group - 1) * block};
    return (novelty_group){v->channels * each, v->pairs, v->channels * block};
}

/* Doubles in `block` per class. */
static size_t block_size(const lg_novelty *v) {
    return (size_t)v->channels * of_channel(v) * of_channel(v) + (size_t)v->pairs * v->pairs;
}

void lg_novelty_list(lg_novelty *v, lg_stored rows[NOVELTY_ARRAYS]) {
    v->pairs = v->channels <= LG_NOVELTY_PAIRED ? v->channels * (v->channels - 1) / 2 : 0;
    v->features = v->channels * of_channel(v) + v->pairs;
    const uint64_t m = v->channels, k = v->classes, d = v->features;
#define ROW(member, positive_, rank, ...)                                                                    \
    {                                                                                                        \
        "novelty/" #member, LG_ELEMENT_F64, rank, {__VA_ARGS__}, &v->member, .pointed = true,                \
                                                                             .positive = positive_           \
    }
    const lg_stored list[NOVELTY_ARRAYS] = {ROW(mean, false, 1, m),
                                            ROW(scale, true, 1, m),
                                            ROW(still, true, 1, m),
                                            ROW(extreme, true, 1, m),
                                            ROW(windows, false, 1, k),
                                            ROW(centre, false, 2, k, d),
                                            ROW(spread, true, 1, d),
                                            ROW(precision, false, 3, k, d, d),
                                            ROW(limit, true, 1, lg_novelty_groups(v))};
    memcpy(rows, list, sizeof list);
}

lg_status lg_novelty_prepare(lg_novelty *v, lg_error *error) {
    v->block = lg_alloc(v->context, v->classes * block_size(v), sizeof *v->block);
    if (v->block == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the distribution of %u features", v->features);
    return v->bands > 0 ? lg_spectrum_create(v->context, v->length, v->bands, &v->spectrum, error) : LG_OK;
}

void lg_novelty_destroy(lg_novelty *v) {
    if (v == NULL) return;
    LG_FREE_ALL(v->context, v->mean, v->scale, v->still, v->extreme, v->windows, v->centre, v->spread,
                v->precision, v->limit, v->block);
    lg_spectrum_destroy(&v->spectrum);
    *v = (lg_novelty){.channels = 0};
}

lg_status lg_novelty_factor(lg_novelty *v, lg_error *error) {
    const size_t d = v->features;
    size_t largest = 0;
    for (uint32_t g = 1; g < lg_novelty_groups(v); g++)
        if (lg_novelty_group(v, g).count > largest) largest = lg_novelty_group(v, g).count;
    LG_TRY_SCRATCH(double, part, v->context, largest *largest,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the distances of windows"));
    size_t wrong = 0;
    for (uint32_t c = 0; c < v->classes; c++)
        for (uint32_t g = 1; g < lg_novelty_groups(v) && v->windows[c] > 0; g++) {
            const novelty_group group = lg_novelty_group(v, g);
            const double *from = v->precision + c * d * d + group.first * (d + 1);
            for (size_t i = 0; i < group.count; i++)
                memcpy(part + i * group.count, from + i * d, group.count * sizeof *part);
            wrong += lg_kernels_for(LG_F64)->spd_factor(1, group.count, part,
                                                        v->block + c * block_size(v) + group.block);
        }
    if (wrong > 0) return lg_fail(error, LG_FORMAT, "novelty/precision is not positive definite");
    return LG_OK;
}

/* ---- features ---- */

/* z becomes (x - mean)/scale minus its average over the window. Returns this average. */
static double centre_channel(const lg_novelty *v, uint32_t channel, const float *x, double *z) {
    const double inverse = 1.0 / v->scale[channel];
    double sum = 0;
    for (uint32_t t = 0; t < v->length; t++) {
        z[t] = ((double)x[t] - v->mean[channel]) * inverse;
        sum += z[t];
    }
    const double mean = sum / v->length;
    for (uint32_t t = 0; t < v->length; t++) z[t] -= mean;
    return mean;
}

/* *still becomes the length of the longest run of equal samples. *extreme becomes the number of samples at
 * the least value or at the largest value, whichever number is larger. */
static void count_equal(const float *x, uint32_t length, double *still, double *extreme) {
    uint32_t run = 1, longest = 1, least = 0, largest = 0;
    float low = x[0], high = x[0];
    for (uint32_t t = 0; t < length; t++) {
        run = t > 0 && x[t] == x[t - 1] ? run + 1 : 1;
        if (run > longest) longest = run;
        if (x[t] < low) low = x[t], least = 0;
        if (x[t] > high) high = x[t], largest = 0;
        least += x[t] == low;
        largest += x[t] == high;
    }
    *still = longest;
    *extreme = least > largest ? least : largest;
}

static double channel_features(const lg_novelty *v, const double *z, double *f, double *work) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    double largest = 0;
    for (uint32_t t = 0; t < v->length; t++) largest = fmax(largest, fabs(z[t]));
    const double deviation = sqrt(k->dot(v->length, z, z) / v->length);
    f[NOVELTY_DEVIATION] = log(deviation + FLOOR);
    f[NOVELTY_CREST] = log((largest + FLOOR) / (deviation + FLOOR));
    if (v->bands > 0) lg_spectrum_powers(&v->spectrum, z, f + NOVELTY_BAND, work);
    for (uint32_t b = 0; b < v->bands; b++) f[NOVELTY_BAND + b] = log(f[NOVELTY_BAND + b] + FLOOR * FLOOR);
    return deviation;
}

/* Parts of the caller's work memory. */
typedef struct room {
    double *z, *deviation, *spectrum; /* z: (channels, length); deviation: (channels) */
    double *features, *still, *extreme, *square, *distances;
} room;

static room cut(const lg_novelty *v, lg_portions *from) {
    room r;
    r.z = lg_portion(from, (size_t)v->channels * v->length, sizeof *r.z);
    r.deviation = lg_portion(from, v->channels, sizeof *r.deviation);
    r.spectrum = lg_portion(from, lg_spectrum_work(&v->spectrum), sizeof *r.spectrum);
    r.features = lg_portion(from, v->features, sizeof *r.features);
    r.still = lg_portion(from, v->channels, sizeof *r.still);
    r.extreme = lg_portion(from, v->channels, sizeof *r.extreme);
    r.square = lg_portion(from, lg_novelty_groups(v), sizeof *r.square);
    r.distances = lg_portion(from, v->features, 2 * sizeof *r.distances);
    return r;
}

size_t lg_novelty_work_size(const lg_novelty *v) {
    lg_portions from = {NULL, 0};
    (void)cut(v, &from);
    return from.used;
}

bool lg_novelty_features(const lg_novelty *v, const float *x, double *features, double *still,
                         double *extreme, void *work) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    const room p = cut(v, &(lg_portions){work, 0});
    const size_t n = v->length;
    for (uint32_t c = 0; c < v->channels; c++) {
        double *z = p.z + c * n, *f = features + (size_t)c * of_channel(v);
        count_equal(x + c * n, v->length, &still[c], &extreme[c]);
        f[NOVELTY_MEAN] = centre_channel(v, c, x + c * n, z);
        p.deviation[c] = channel_features(v, z, f, p.spectrum);
    }
    double *pair = features + (size_t)v->channels * of_channel(v);
    for (uint32_t a = 0; a < v->channels && v->pairs > 0; a++)
        for (uint32_t b = a + 1; b < v->channels; b++) {
            const double product = (p.deviation[a] + FLOOR) * (p.deviation[b] + FLOOR) * (double)n;
            *pair++ = atanh(CORRELATED * k->dot(n, p.z + a * n, p.z + b * n) / product);
        }
    for (uint32_t i = 0; i < v->features; i++)
        if (!isfinite(features[i])) return false;
    return true;
}

/* ---- distances ---- */

/* Returns |L^-1 w|^2 for a lower triangular L (n, n). w is overwritten. */
static double solved_square(size_t n, const double *L, double *w) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) {
        double rest = w[i];
        for (size_t j = 0; j < i; j++) rest -= L[i * n + j] * w[j];
        w[i] = rest / L[i * n + i];
        sum += w[i] * w[i];
    }
    return sum;
}

void lg_novelty_distances(const lg_novelty *v, uint32_t class_index, const double *features, double *square,
                          double *work) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    const size_t d = v->features;
    double *difference = work, *weighted = work + d;
    for (size_t i = 0; i < d; i++)
        difference[i] = (features[i] - v->centre[class_index * d + i]) / v->spread[i];
    k->matvec(d, d, v->precision + class_index * d * d, difference, weighted, false);
    square[0] = k->dot(d, difference, weighted);
    for (uint32_t g = 1; g < lg_novelty_groups(v); g++) {
        const novelty_group group = lg_novelty_group(v, g);
        const double *block = v->block + class_index * block_size(v) + group.block;
        square[g] = solved_square(group.count, block, weighted + group.first);
    }
}

/* Returns the largest ratio of a group's distance to its limit. */
static double farthest(const lg_novelty *v, const double *square) {
    double ratio = 0;
    for (uint32_t g = 0; g < lg_novelty_groups(v); g++) ratio = fmax(ratio, square[g] / v->limit[g]);
    return ratio;
}

/* ---- causes ---- */

static void name_pair(const lg_novelty *v, uint32_t pair, uint32_t *channel, uint32_t *other) {
    uint32_t a = 0;
    while (pair >= v->channels - 1 - a) pair -= v->channels - 1 - a++;
    *channel = a;
    *other = a + 1 + pair;
}

/* Finds the feature of a group that deviates most from the centre. Returns its deviation in units of its
 * spread. */
static double most_deviating(const lg_novelty *v, const double *f, const double *centre, uint32_t group,
                             uint32_t *feature) {
    const novelty_group among = lg_novelty_group(v, group);
    double most = -1;
    for (uint32_t i = among.first; i < among.first + among.count; i++) {
        const double deviation = fabs(f[i] - centre[i]) / v->spread[i];
        if (deviation > most) most = deviation, *feature = i;
    }
    return most;
}

/* Finds the feature that explains the novelty best. A feature of a single channel that deviates by more
 * than 5 spreads has precedence over pairs, because a fault of a channel also changes the channel's
 * correlations. */
static uint32_t find_feature(const lg_novelty *v, const double *f, const double *centre) {
    static const double STRANGE = 5;
    double most = STRANGE;
    uint32_t feature = UINT32_MAX, candidate = 0;
    for (uint32_t g = 1; g <= v->channels; g++) {
        const double deviation = most_deviating(v, f, centre, g, &candidate);
        if (deviation > most) most = deviation, feature = candidate;
    }
    if (feature == UINT32_MAX) (void)most_deviating(v, f, centre, 0, &feature);
    return feature;
}

static void find_cause(const lg_novelty *v, const double *f, lg_novelty_result *r) {
    const double *centre = v->centre + (size_t)r->nearest * v->features;
    const uint32_t each = of_channel(v), alone = v->channels * each;
    r->feature = find_feature(v, f, centre);
    r->value = f[r->feature];
    r->usual = centre[r->feature];
    r->cause = r->feature < alone ? LG_NOVELTY_CHANNEL : LG_NOVELTY_PAIR;
    if (r->cause == LG_NOVELTY_PAIR)
        name_pair(v, r->feature - alone, &r->channel, &r->other);
    else
        r->channel = r->feature / each;
    const uint32_t deviation = r->channel * each + NOVELTY_DEVIATION;
    r->deviation = exp(f[deviation] - centre[deviation]);
}

/* Looks for a channel that stands still, or whose values are cut off at its least or largest value. */
static bool find_fault(const lg_novelty *v, const double *still, const double *extreme,
                       lg_novelty_result *r) {
    for (uint32_t c = 0; c < v->channels; c++) {
        const bool stands = still[c] > v->still[c], cut_off = extreme[c] > v->extreme[c];
        if (!stands && !cut_off) continue;
        r->cause = stands ? LG_NOVELTY_STILL : LG_NOVELTY_EXTREME;
        r->channel = c;
        r->samples = (uint32_t)(stands ? still[c] : extreme[c]);
        return true;
    }
    return false;
}

void lg_novelty_eval(const lg_novelty *v, const float *x, lg_novelty_result *result, double *features,
                     void *work) {
    const room space = cut(v, &(lg_portions){work, 0});
    if (features == NULL) features = space.features;
    lg_novelty_result r = {.distance = INFINITY};
    const bool finite = lg_novelty_features(v, x, features, space.still, space.extreme, work);
    for (uint32_t c = 0; c < v->classes && finite; c++) {
        if (!(v->windows[c] > 0)) continue;
        lg_novelty_distances(v, c, features, space.square, space.distances);
        const double ratio = farthest(v, space.square);
        if (!(ratio < r.distance)) continue;
        r.distance = ratio;
        r.nearest = c;
        find_cause(v, features, &r);
    }
    r.novel = find_fault(v, space.still, space.extreme, &r) || !(r.distance <= 1);
    *result = r;
}

/* ---- results as numbers and text ---- */

double lg_novelty_noise_from(const lg_novelty *v) {
    return v->bands == 0 ? 0 : (v->spectrum.edge[v->bands - 1] - 0.5) / v->spectrum.segment;
}

void lg_novelty_noise(const lg_novelty *v, uint32_t class_index, const double *features, double *ratio) {
    for (uint32_t c = 0; c < v->channels; c++) {
        const size_t top = (size_t)c * of_channel(v) + NOVELTY_BAND + v->bands - 1;
        ratio[c] = v->bands == 0
                       ? 1
                       : exp(0.5 * (features[top] - v->centre[(size_t)class_index * v->features + top]));
    }
}

void lg_novelty_channel(char (*names)[LG_SERIES_NAME], uint32_t channel, char text[NOVELTY_NAME]) {
    if (names != NULL && names[channel][0] != '\0')
        (void)snprintf(text, NOVELTY_NAME, "%s", names[channel]);
    else
        (void)snprintf(text, NOVELTY_NAME, "channel %u", channel + 1);
}

/* Writes how the deviating feature differs from the usual. Writes nothing for the standard deviation, which
 * the caller writes anyway. */
static int explain_feature(const lg_novelty *v, const lg_novelty_result *r, double rate, char *text,
                           size_t size) {
    const uint32_t kind = r->feature % of_channel(v), band = kind - NOVELTY_BAND;
    const double change = r->value - r->usual;
    const char *unit = rate > 0 ? "Hz" : "cycles a sample";
    const double to_unit = (rate > 0 ? rate : 1) / (kind >= NOVELTY_BAND ? v->spectrum.segment : 1);
    switch (kind) {
    case NOVELTY_MEAN:
        return lg_format(text, size, ", mean off by %.3g of the channel's usual deviations", change);
    case NOVELTY_DEVIATION:
        return snprintf(text, size, "%s", "");
    case NOVELTY_CREST:
        return lg_format(text, size, ", peaks over it %.3g times", exp(change));
    default:
        return lg_format(text, size, ", amplitude from %.3g to %.3g %s %.3g times",
                         (v->spectrum.edge[band] - 0.5) * to_unit,
                         (v->spectrum.edge[band + 1] - 0.5) * to_unit, unit, exp(0.5 * change));
    }
}

int lg_novelty_explain(const lg_novelty *v, const lg_novelty_result *r, char (*names)[LG_SERIES_NAME],
                       double rate, char *text, size_t size) {
    char channel[NOVELTY_NAME], other[NOVELTY_NAME], more[128];
    lg_novelty_channel(names, r->channel, channel);
    switch (r->cause) {
    case LG_NOVELTY_STILL:
        return snprintf(text, size, "%s: stands still for %u of %u samples", channel, r->samples, v->length);
    case LG_NOVELTY_EXTREME:
        return snprintf(text, size, "%s: %u of %u samples at its least or largest value (saturated?)",
                        channel, r->samples, v->length);
    case LG_NOVELTY_CHANNEL:
        (void)explain_feature(v, r, rate, more, sizeof more);
        return lg_format(text, size, "%s: standard deviation %.3g times the usual%s", channel, r->deviation,
                         more);
    case LG_NOVELTY_PAIR:
        lg_novelty_channel(names, r->other, other);
        return lg_format(text, size, "%s and %s: correlation %.3g, usually %.3g", channel, other,
                         tanh(r->value), tanh(r->usual));
    case LG_NOVELTY_NONE:
        break;
    }
    return snprintf(text, size, "%s", "a value is not finite");
}

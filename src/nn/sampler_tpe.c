/* The tree-structured Parzen estimator (Bergstra et al. 2011) of each range alone, with the defaults of
 * Optuna. The best tenth of the trials and the others give a density each, good and bad; of 24 draws from
 * `good` the one with the largest good/bad is taken. A density is a mixture: a kernel around each trial's
 * value, and a wide one, the prior. Trials are random until 10 have ended; failed ones do not count. */
#include "nn/search.h"

#include <math.h>
#include <stdlib.h>

#include "core/clean.h"
#include "liegrad/core.h"

extern const lg_sampler lg_sampler_tpe;

enum { STARTUP = 10, DRAWS = 24, MOST_GOOD = 25, RECENT = 25, WIDEST = 100 };

/* Values are places in 0..1: fractions of the range or, of a log-uniform one, of its logarithms. An integer
 * is the middle of one of `cells` equal intervals. A choice is its index; the prior's mean is then -1. */
typedef struct kernel {
    double mean, sigma, weight;
} kernel;
typedef struct mixture {
    double cells; /* of integers; 0 for real numbers */
    uint32_t choices;
    size_t count;
    kernel *kernel; /* (count), their weights have the sum 1 */
} mixture;

/* ---- places ---- */

static double cells_of(const lg_range *range) {
    return range->kind == LG_RANGE_INTEGER ? range->high - range->low + 1 : 0;
}

static double middle(double cell, double cells) {
    return (fmin(floor(cell), cells - 1) + 0.5) / cells;
}

static double place_of(const lg_range *range, double x) {
    const double low = range->low, high = range->high;
    if (range->kind == LG_RANGE_CHOICE) return x;
    if (range->kind == LG_RANGE_INTEGER) return middle(x - low, cells_of(range));
    if (range->kind == LG_RANGE_LOG_UNIFORM) return (log(x) - log(low)) / (log(high) - log(low));
    return (0.5 * x - 0.5 * low) / (0.5 * high - 0.5 * low); /* high - low may overflow */
}

static double value_at(const lg_range *range, double place) {
    if (range->kind == LG_RANGE_CHOICE) return place;
    if (range->kind != LG_RANGE_INTEGER) return lg_range_at(range, place);
    return fmin(range->low + floor(place * cells_of(range)), range->high);
}

/* ---- densities ---- */

static int by_mean(const void *a, const void *b) {
    const kernel *x = a, *y = b;
    if (x->mean != y->mean) return x->mean < y->mean ? -1 : 1;
    if (x->weight != y->weight) return x->weight < y->weight ? -1 : 1;
    return (x->sigma > y->sigma) - (x->sigma < y->sigma); /* the prior comes last */
}

/* The widths: the distance to the farther neighbour, of the first and the last kernel to the only one; not
 * below 1/(1 + kernels) or 0.01. The prior keeps 1. */
static void find_widths(mixture *m) {
    const double least = 1.0 / fmin(WIDEST, 1.0 + (double)m->count);
    qsort(m->kernel, m->count, sizeof *m->kernel, by_mean);
    for (size_t i = 0; i < m->count; i++) {
        kernel *k = &m->kernel[i];
        const double left = i > 0 ? k->mean - k[-1].mean : 0,
                     right = i + 1 < m->count ? k[1].mean - k->mean : 0;
        k->sigma = fmax(k->sigma, fmax(least, fmax(left, right)));
    }
}

/* The mixture of the values of trials (count), which lie in the order of their numbers if they are more than
 * 25. The last 25 have weight 1; the weights of earlier ones rise linearly with the number from 1/count. */
static void fill(const lg_range *range, size_t at, const lg_trial *const *trials, size_t count, mixture *m) {
    const double early = count > RECENT ? (double)(count - RECENT) : 0, n = (double)count;
    double sum = 1;
    m->cells = cells_of(range);
    m->choices = range->kind == LG_RANGE_CHOICE ? range->choices : 0;
    m->count = count + 1;
    for (size_t i = 0; i < count; i++) {
        const double of = (double)i, weight = of < early ? 1 / n + of * (1 - 1 / n) / fmax(early - 1, 1) : 1;
        m->kernel[i] = (kernel){.mean = place_of(range, trials[i]->value[at]), .weight = weight};
        sum += weight;
    }
    m->kernel[count] = (kernel){.mean = m->choices > 0 ? -1 : 0.5, .sigma = 1, .weight = 1};
    for (size_t i = 0; i < m->count; i++) m->kernel[i].weight /= sum;
    if (m->choices == 0) find_widths(m);
}

/* The probability of a choice: each has the prior's weight, divided among the kernels. */
static double chance(const mixture *m, const kernel *k, double choice) {
    const double each = 1 / (double)m->count;
    return (each + (k->mean == choice)) / (each * m->choices + (k->mean >= 0));
}

/* The probability that a normal number lies between a and b. In the tails differences of erf cancel. */
static double between(double a, double b) {
    static const double root = 0.70710678118654752;
    if (a > 0) return 0.5 * (erfc(a * root) - erfc(b * root));
    return b < 0 ? between(-b, -a) : 0.5 * (erf(b * root) - erf(a * root));
}

static double density(const mixture *m, double place) {
    static const double peak = 0.3989422804014327, narrow = 1e-4; /* 1/sqrt(2 pi); of a cell in sigma */
    double sum = 0;
    for (const kernel *k = m->kernel; k < m->kernel + m->count; k++) {
        if (m->choices > 0) {
            sum += k->weight * chance(m, k, place);
            continue;
        }
        const double z = (place - k->mean) / k->sigma, cell = m->cells > 0 ? 1 / (m->cells * k->sigma) : 0,
                     here = cell > narrow ? between(z - 0.5 * cell, z + 0.5 * cell)
                                          : peak * exp(-0.5 * z * z) * (cell > 0 ? cell : 1 / k->sigma);
        sum += k->weight * here / between(-k->mean / k->sigma, (1 - k->mean) / k->sigma);
    }
    return sum;
}

static double draw(const mixture *m, lg_rng *rng) {
    const kernel *k = m->kernel;
    double u = lg_rng_uniform(rng), place = 0;
    for (; k + 1 < m->kernel + m->count && u >= k->weight; k++) u -= k->weight;
    if (m->choices > 0) {
        for (u = lg_rng_uniform(rng); place + 1 < m->choices && u >= chance(m, k, place); place++)
            u -= chance(m, k, place);
        return place;
    }
    do place = k->mean + k->sigma * lg_rng_normal(rng);
    while (!(place >= 0 && place < 1)); /* at least a third of the draws are inside */
    return m->cells > 0 ? middle(place * m->cells, m->cells) : place;
}

/* ---- trials ---- */

static int by_number(const void *a, const void *b) {
    const lg_trial *x = *(const lg_trial *const *)a, *y = *(const lg_trial *const *)b;
    return (x->number > y->number) - (x->number < y->number);
}

/* Finished trials by their objectives; then stopped ones, first those that reached more rungs, by their last
 * objectives; then failed ones. */
static int by_merit(const void *a, const void *b) {
    const lg_trial *x = *(const lg_trial *const *)a, *y = *(const lg_trial *const *)b;
    const double left = isfinite(x->objective) ? x->objective : INFINITY,
                 right = isfinite(y->objective) ? y->objective : INFINITY;
    if (x->state != y->state) return x->state < y->state ? -1 : 1;
    if (x->state == LG_TRIAL_PRUNED && x->reports != y->reports) return x->reports > y->reports ? -1 : 1;
    return left != right ? (left < right ? -1 : 1) : by_number(a, b);
}

/* How many of the trials are the good ones. */
static size_t good_of(size_t count) {
    const size_t tenth = (count + 9) / 10;
    return tenth < MOST_GOOD ? tenth : MOST_GOOD;
}

static lg_status next(const lg_search_space *space, const lg_search_options *options, uint64_t number,
                      const lg_trial *done, size_t count, double *value) {
    static const uint64_t tag = UINT64_C(0x7470650000000000);
    size_t ended = 0;
    for (size_t i = 0; i < count; i++) ended += done[i].state != LG_TRIAL_FAILED;
    const size_t good = good_of(ended);
    lg_search_draw(space, options->seed, number, value);
    if (ended < STARTUP) return LG_OK;
    LG_TRY_SCRATCH(const lg_trial *, order, NULL, count, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(kernel, kernels, NULL, count + 2, LG_OUT_OF_MEMORY);
    mixture side[2] = {{.kernel = kernels}, {.kernel = kernels + good + 1}};
    for (size_t i = 0; i < count; i++) order[i] = &done[i];
    qsort(order, count, sizeof *order, by_merit);
    qsort(order + good, ended - good, sizeof *order, by_number);
    for (size_t at = 0; at < space->count; at++) {
        const lg_range *range = &space->ranges[at];
        lg_rng rng = lg_search_rng(tag, options->seed, number, at);
        double best = -INFINITY;
        if (range->kind != LG_RANGE_CHOICE && range->low == range->high) continue;
        fill(range, at, order, good, &side[0]);
        fill(range, at, order + good, ended - good, &side[1]);
        for (int i = 0; i < DRAWS; i++) {
            const double place = draw(&side[0], &rng),
                         ratio = density(&side[0], place) / density(&side[1], place);
            if (!(ratio > best)) continue;
            best = ratio;
            value[at] = value_at(range, place);
        }
    }
    return LG_OK;
}

const lg_sampler lg_sampler_tpe = {.name = "tpe", .learns = true, .next = next};

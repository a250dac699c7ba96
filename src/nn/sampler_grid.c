/* A full factorial grid: all combinations of the levels of the ranges, of which the last one varies fastest.
 * Of a range with at most 16 values, each is a level. The other ranges are divided evenly, or evenly in the
 * logarithm, with both ends: as finely as the planned trials allow, and all into equally many levels, or the
 * first ones into one more. */
#include "nn/search.h"

#include <math.h>

extern const lg_sampler lg_sampler_grid;

static double values_of(const lg_range *range) {
    const double low = range->low, high = range->high, largest = fmax(fabs(low), fabs(high));
    if (range->kind == LG_RANGE_CHOICE) return range->choices;
    if (range->kind == LG_RANGE_INTEGER || low == high) return high - low + 1;
    return floor((high - low) / (largest - nextafter(largest, 0))) + 1; /* the coarsest spacing of doubles */
}

/* The levels of a range where ranges that are divided have `level`. */
static double levels_at(const lg_range *range, double level) {
    const double values = values_of(range);
    return values <= LG_RANGE_MAX_CHOICES ? values : fmin(values, level);
}

static double combinations(const lg_search_space *space, double level) {
    double product = 1;
    for (size_t i = 0; i < space->count; i++) product *= levels_at(&space->ranges[i], level);
    return product;
}

/* Sets the levels of each range, and returns the number of points. */
static double find_levels(const lg_search_space *space, uint64_t trials, double levels[LG_RANGE_MAX]) {
    const double most = (double)trials;
    double level = 1;
    for (double step = 0x1p52; step >= 1; step /= 2)
        if (combinations(space, level + step) <= most) level += step;
    double points = combinations(space, level);
    for (size_t i = 0; i < space->count; i++) {
        levels[i] = levels_at(&space->ranges[i], level);
        const double others = points / levels[i], more = levels_at(&space->ranges[i], level + 1);
        if (others * more <= most) levels[i] = more;
        points = others * levels[i];
    }
    return points;
}

static double value_at(const lg_range *range, double number, double levels) {
    const double u = levels > 1 ? number / (levels - 1) : 0.5;
    if (range->kind == LG_RANGE_CHOICE) return number;
    if (u == 0 || u == 1) return u == 0 ? range->low : range->high;
    return range->kind == LG_RANGE_INTEGER ? round(range->low + u * (range->high - range->low))
                                           : lg_range_at(range, u);
}

static uint64_t points(const lg_search_space *space, uint64_t trials) {
    double levels[LG_RANGE_MAX];
    return (uint64_t)fmin(find_levels(space, trials, levels), 0x1p63);
}

static lg_status next(const lg_search_space *space, const lg_search_options *options, uint64_t number,
                      const lg_trial *done, size_t count, double *value) {
    double levels[LG_RANGE_MAX];
    (void)done, (void)count;
    (void)find_levels(space, options->trials, levels);
    for (size_t i = space->count; i-- > 0; number /= (uint64_t)levels[i])
        value[i] = value_at(&space->ranges[i], (double)(number % (uint64_t)levels[i]), levels[i]);
    return LG_OK;
}

const lg_sampler lg_sampler_grid = {.name = "grid", .points = points, .next = next};

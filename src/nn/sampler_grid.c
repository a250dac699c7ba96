/* A full factorial grid: all combinations of the levels of the ranges, of which the last one varies fastest.
 * Of a range with at most 16 values, each is a level. The other ranges are divided evenly, or evenly in the
 * logarithm, with both ends: as finely as the planned trials allow. */
#include "nn/search.h"

#include <math.h>

extern const lg_sampler lg_sampler_grid;

/* The number of points if ranges that are divided have got one more level in turn, `raises` times. */
static double combinations(const lg_search_space *space, double raises, double *levels) {
    double product = 1;
    for (size_t i = 0; i < space->count; product *= levels[i++]) {
        const lg_range *range = &space->ranges[i];
        double values = range->kind == LG_RANGE_CHOICE ? range->choices : range->high - range->low + 1;
        if (range->kind < LG_RANGE_INTEGER && range->low < range->high) values = INFINITY;
        levels[i] = 1 + floor((raises + (double)(space->count - 1 - i)) / (double)space->count);
        levels[i] = values <= LG_RANGE_MAX_CHOICES ? values : fmin(values, levels[i]);
    }
    return product;
}

static double points(const lg_search_space *space, uint64_t trials, double *levels) {
    double raises = 0;
    for (double step = 0x1p52; step >= 1; step /= 2)
        if (combinations(space, raises + step, levels) <= (double)trials) raises += step;
    return combinations(space, raises, levels);
}

static double value_at(const lg_range *range, double level, double levels) {
    const double u = levels > 1 ? level / (levels - 1) : 0.5;
    if (range->kind == LG_RANGE_CHOICE) return level;
    if (u == 0 || u == 1) return u == 0 ? range->low : range->high;
    return range->kind == LG_RANGE_INTEGER ? round(range->low + u * (range->high - range->low))
                                           : lg_range_at(range, u);
}

static lg_status next(const lg_search_space *space, const lg_search_options *options, uint64_t number,
                      const lg_trial *done, size_t count, double *value) {
    double levels[LG_RANGE_MAX];
    (void)points(space, options->trials, levels);
    for (size_t i = space->count; i-- > 0; number /= (uint64_t)levels[i])
        value[i] = value_at(&space->ranges[i], (double)(number % (uint64_t)levels[i]), levels[i]);
    return LG_OK;
}

const lg_sampler lg_sampler_grid = {.name = "grid", .planned = true, .points = points, .next = next};

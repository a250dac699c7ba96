/* Independent random values: uniform, uniform in the logarithm, any integer, any choice. */
#include "nn/search.h"

#include <math.h>

#include "liegrad/core.h"

extern const lg_sampler lg_sampler_random;

lg_rng lg_search_rng(uint64_t tag, uint64_t seed, uint64_t number, size_t at) {
    lg_rng rng;
    lg_rng_seed(&rng, seed, tag ^ (number * LG_RANGE_MAX + at));
    return rng;
}

static double clamp(double x, double low, double high) {
    return x < low ? low : x > high ? high : x;
}

double lg_range_at(const lg_range *range, double u) {
    const double low = range->low, high = range->high;
    if (range->kind == LG_RANGE_LOG_UNIFORM) return clamp(exp(log(low) * (1 - u) + log(high) * u), low, high);
    return low == high ? low : clamp(low * (1 - u) + high * u, low, nextafter(high, low));
}

void lg_search_draw(const lg_search_space *space, uint64_t seed, uint64_t number, double *value) {
    /* Random streams that differ from the streams of training with the same seed. */
    static const uint64_t tag = UINT64_C(0x7365617263680000);
    for (size_t i = 0; i < space->count; i++) {
        const lg_range *range = &space->ranges[i];
        lg_rng rng = lg_search_rng(tag, seed, number, i);
        if (range->kind == LG_RANGE_CHOICE)
            value[i] = (double)lg_rng_below(&rng, range->choices);
        else if (range->kind == LG_RANGE_INTEGER)
            value[i] = (double)((int64_t)range->low +
                                (int64_t)lg_rng_below(
                                    &rng, (uint64_t)((int64_t)range->high - (int64_t)range->low) + 1));
        else
            value[i] = lg_range_at(range, lg_rng_uniform(&rng));
    }
}

static lg_status next(const lg_search_space *space, const lg_search_options *options, uint64_t number,
                      const lg_trial *done, size_t count, double *value) {
    lg_search_draw(space, options->seed, number, value);
    return LG_OK;
}

const lg_sampler lg_sampler_random = {.name = "random", .next = next};

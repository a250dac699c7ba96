/* How a search chooses the values of trials and decides which ones to stop. */
#ifndef LG_SEARCH_INTERNAL_H
#define LG_SEARCH_INTERNAL_H

#include "liegrad/settings.h"

/* The samplers: the name, and the sentence of `search --help` that begins "With --sampler NAME". */
#define LG_SAMPLERS(X)                                                                                       \
    X(random, "a trial depends on the seed and its number alone")                                            \
    X(tpe, "the first 10 trials are random, and then values near those of the best trials are likely")       \
    X(grid, "the trials are all combinations of the choices, of up to 16 integers, and of evenly spaced "    \
            "values, as many as --trials allows")

/* A sampler chooses the values of the next trial: a file sampler_NAME.c with a constant lg_sampler_NAME, and
 * a row of LG_SAMPLERS. */
typedef struct lg_sampler {
    const char *name; /* of --sampler */
    bool learns;      /* the values depend on trials that have ended */
    /* The values depend on the planned trials, options->trials; not together with `learns`. A table is then
     * continued only if all of its trials have the values that the sampler gives. */
    bool planned;
    /* The number of points of a grid for so many planned trials, and the levels of each range. Trial t is
     * point t; after the last one the points begin again. NULL: there is no end. */
    double (*points)(const lg_search_space *space, uint64_t trials, double *levels);
    /* Writes value (space->count) of trial `number`. It depends on the ranges, seed and trials of the
     * options, number and done alone. done (count) are trials that have ended, after lg_search_settle; none
     * if the sampler does not learn. Errors: LG_OUT_OF_MEMORY. */
    lg_status (*next)(const lg_search_space *space, const lg_search_options *options, uint64_t number,
                      const lg_trial *done, size_t count, double *value);
} lg_sampler;
/* Row `sampler` of the table, NULL beyond the last one. */
const lg_sampler *lg_search_sampler(uint32_t sampler);

/* The random numbers of a range (index `at`) of a trial. `tag`: a constant of the sampler. */
lg_rng lg_search_rng(uint64_t tag, uint64_t seed, uint64_t number, size_t at);
/* The value at the fraction u, 0 to 1, of a uniform or log-uniform range. Rounding can take it neither out of
 * the range nor to the open end `high` of a uniform range. */
double lg_range_at(const lg_range *range, double u);
/* Draws value (space->count) of trial `number` at random. The space must have passed lg_search_space_check. A
 * value depends only on the seed, the number, the range and the position of the range, so a range that is
 * added at the end does not change the values of the others. */
void lg_search_draw(const lg_search_space *space, uint64_t seed, uint64_t number, double *value);

/* Whether trial `number`, with `objective` at rung `rung` (0, 1, ...), is to be stopped. True if the
 * objective is not finite. Otherwise let n be the number of trials with lower numbers that reached the rung,
 * stopped there or not, and b how many of them were strictly better there: true if n >= warm_up, n > 0 and b
 * >= max(1, quantile n). An objective that is not finite is worse than every finite one. */
bool lg_search_prune(const lg_search_options *options, const lg_trial *trials, size_t count, uint64_t number,
                     uint32_t rung, double objective);

#endif

/* How a search draws trials and decides which ones to stop. */
#ifndef LG_SEARCH_INTERNAL_H
#define LG_SEARCH_INTERNAL_H

#include "liegrad/settings.h"

/* Draws value (space->count) of trial `number`. The space must have passed lg_search_space_check. A value
 * depends only on the seed, the number, the range and the position of the range, so a range that is added at
 * the end does not change the values of the others. */
void lg_search_draw(const lg_search_space *space, uint64_t seed, uint64_t number, double *value);
/* Whether trial `number`, with `objective` at rung `rung` (0, 1, ...), is to be stopped. True if the
 * objective is not finite. Otherwise let n be the number of trials with lower numbers that reached the rung,
 * stopped there or not, and b how many of them were strictly better there: true if n >= warm_up, n > 0 and b
 * >= max(1, quantile n). An objective that is not finite is worse than every finite one. */
bool lg_search_prune(const lg_search_options *options, const lg_trial *trials, size_t count, uint64_t number,
                     uint32_t rung, double objective);

#endif

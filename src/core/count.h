#ifndef LG_CORE_COUNT_H
#define LG_CORE_COUNT_H

#include <stddef.h>
#include <stdint.h>

/* Number of elements of an array. `array` must not be a pointer. */
#define LG_COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* Spreads `some` indices evenly over 0 to `all` - 1; returns the index of number i: floor(i all/some). The
 * product i all may exceed size_t. */
static inline size_t lg_spread(uint64_t i, uint64_t all, uint64_t some) {
    return (size_t)(i * all / some);
}

#endif

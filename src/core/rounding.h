/* The rule of all scalers: which numbers count as one constant. */
#ifndef LG_ROUNDING_H
#define LG_ROUNDING_H

#include <math.h>
#include <stdbool.h>

/* Whether numbers of this size that spread so little are equal or differ only by rounding: by at most 16
 * units in the last place. All other columns are scaled by their deviation, however large their offset. */
static inline bool lg_is_rounding(double spread, double size) {
    return spread <= 0x1p-48 * fabs(size);
}

#endif

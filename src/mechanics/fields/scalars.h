/* `number` for one state: a double. On lanes, mechanics/lanes.c defines it. */
#ifndef LG_FIELD_SCALARS_H
#define LG_FIELD_SCALARS_H

#include <math.h>

typedef double number;

/* x if it is positive and finite, else NaN */
static inline number field_positive(number x) {
    return x > 0.0 && isfinite(x) ? x : NAN;
}

#endif

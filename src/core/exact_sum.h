/* Sums of doubles without rounding. The result does not depend on the order of the numbers or on how they are
 * split into partial sums. */
#ifndef LG_EXACT_SUM_H
#define LG_EXACT_SUM_H

#include <stdint.h>

/* The value of the sum is sum_i part_i 2^(32 i - 1074). Up to 2^30 numbers may be added. */
#define LG_EXACT_PARTS 67
typedef struct lg_exact_sum {
    int64_t part[LG_EXACT_PARTS];
} lg_exact_sum;

/* x must be finite. */
void lg_exact_add(lg_exact_sum *sum, double x);
void lg_exact_merge(lg_exact_sum *into, const lg_exact_sum *from);
/* Returns the sum, with an error of a few units in the last place. */
double lg_exact_value(const lg_exact_sum *sum);

#endif

/* Order of numbers. */
#ifndef LG_MEDIAN_H
#define LG_MEDIAN_H

#include <stddef.h>

/* For qsort; NaN last. */
int lg_compare_doubles(const void *a, const void *b);
/* NaN of none. Sorts. */
double lg_median(double *values, size_t count);

#endif

/* Sorting numbers, and their median. */
#ifndef LG_MEDIAN_H
#define LG_MEDIAN_H

#include <stddef.h>

/* Compares two doubles for qsort; NaN comes last. */
int lg_compare_doubles(const void *a, const void *b);
/* Compares two uint32_t for qsort. Both also sort structures by a first member of their type. */
int lg_compare_u32(const void *a, const void *b);
/* Sorts the values and returns their median, or NaN if count is 0. */
double lg_median(double *values, size_t count);

#endif

/* Doubles in arrays of either type. */
#ifndef LG_NUMBERS_H
#define LG_NUMBERS_H

#include "liegrad/core.h"

/* Writes n doubles from number `at` on of an array of this type, or reads them. */
static inline void lg_put_numbers(lg_dtype dtype, void *to, size_t at, const double *from, size_t n) {
    if (dtype == LG_F64)
        for (size_t i = 0; i < n; i++) ((double *)to)[at + i] = from[i];
    else
        for (size_t i = 0; i < n; i++) ((float *)to)[at + i] = (float)from[i];
}
static inline double lg_number_at(lg_dtype dtype, const void *from, size_t i) {
    return dtype == LG_F64 ? ((const double *)from)[i] : (double)((const float *)from)[i];
}
static inline void lg_get_numbers(lg_dtype dtype, const void *from, size_t at, double *to, size_t n) {
    for (size_t i = 0; i < n; i++) to[i] = lg_number_at(dtype, from, at + i);
}

#endif

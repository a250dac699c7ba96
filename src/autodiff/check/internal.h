/* The gradient check with one operation replaced, for planted faults (tests/gradcheck). */
#ifndef LG_GRADCHECK_INTERNAL_H
#define LG_GRADCHECK_INTERNAL_H

#include "autodiff/tape/tape_internal.h"
#include "liegrad/gradcheck.h"

/* lg_gradcheck with the derivatives of an operation replaced; an exchange without rows replaces none. */
lg_status lg_gradcheck_exchanged(const lg_context *context, const lg_gradcheck_function *function,
                                 const lg_gradcheck_options *options, lg_exchange exchange,
                                 lg_gradcheck_result *result);

/* Whether the function and the options are valid for the gradient check. */
bool lg_gradcheck_valid(const lg_gradcheck_function *function, const lg_gradcheck_options *options);

/* max |a_i - b_i|, where b = NULL stands for zeros. NaN if one of the numbers is NaN; 0 if n = 0. */
double lg_largest_difference(const double *a, const double *b, size_t n);
static inline double lg_largest(const double *a, size_t n) {
    return lg_largest_difference(a, NULL, n);
}

#endif

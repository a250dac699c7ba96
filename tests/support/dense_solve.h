/* The reference for linear systems that the library solves in O(N). */
#ifndef DENSE_SOLVE_H
#define DENSE_SOLVE_H

#include <math.h>
#include <stddef.h>

/* x = A^-1 b by elimination with pivoting. A (n, n) and b are overwritten. */
static inline void dense_solve(size_t n, double *a, double *b, double *x) {
    for (size_t c = 0; c < n; c++) {
        size_t pivot = c;
        for (size_t r = c + 1; r < n; r++)
            if (fabs(a[r * n + c]) > fabs(a[pivot * n + c])) pivot = r;
        for (size_t j = 0; j < n; j++) {
            const double swap = a[c * n + j];
            a[c * n + j] = a[pivot * n + j];
            a[pivot * n + j] = swap;
        }
        const double swap = b[c];
        b[c] = b[pivot];
        b[pivot] = swap;
        for (size_t r = c + 1; r < n; r++) {
            const double l = a[r * n + c] / a[c * n + c];
            for (size_t j = c; j < n; j++) a[r * n + j] -= l * a[c * n + j];
            b[r] -= l * b[c];
        }
    }
    for (size_t c = n; c-- > 0;) {
        x[c] = b[c];
        for (size_t j = c + 1; j < n; j++) x[c] -= a[c * n + j] * x[j];
        x[c] /= a[c * n + c];
    }
}

#endif

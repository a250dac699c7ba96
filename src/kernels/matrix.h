/* Dense matrices, row-major, in double precision, on the library's own kernels (no allocation, no lock). */
#ifndef LG_KERNELS_MATRIX_H
#define LG_KERNELS_MATRIX_H

#include "kernels/kernels.h"

/* c (m, n) = a (m, k) b (k, n), or a^T with a (k, m). */
void lg_matrix_multiply(size_t m, size_t n, size_t k, const double *a, const double *b, double *c);
void lg_matrix_multiply_tn(size_t m, size_t n, size_t k, const double *a, const double *b, double *c);
/* c (n, m) = a (m, n)^T */
void lg_matrix_transpose(size_t m, size_t n, const double *a, double *c);
/* y += c x */
void lg_matrix_add(size_t count, double c, const double *x, double *y);
/* Replaces x (n, n) by (x + x^T)/2. */
void lg_matrix_symmetrise(size_t n, double *x);
/* A matrix in twice the digits, high + low. */
typedef struct lg_matrix_pair {
    double *high, *low;
} lg_matrix_pair;
/* c (m, n) = a^T b, a (k, m), b (k, n); b.low may be NULL (Ogita, Rump & Oishi 2005, Dot2). */
void lg_matrix_multiply_twice(size_t m, size_t n, size_t k, const double *a, lg_matrix_pair b,
                              lg_matrix_pair c);
/* y += x */
void lg_matrix_add_twice(size_t count, const double *x, lg_matrix_pair y);
double lg_matrix_norm(size_t count, const double *x);
/* L lower triangular, L L^T = (a + a^T)/2; false if that is not positive definite. a and L do not overlap. */
bool lg_matrix_cholesky(size_t n, const double *a, double *L);
/* The same of a positive semidefinite matrix; false if it is not that to 1e-8. */
bool lg_matrix_root(size_t n, const double *a, double *L);
/* M (rows, columns), rows <= columns, becomes (L, 0), L lower triangular, diagonal >= 0, L L^T = M M^T:
 * Householder reflections from the right. */
void lg_matrix_lower(size_t rows, size_t columns, double *M);

#endif

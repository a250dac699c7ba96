/* Dense matrices in double precision, row-major, computed with the library's kernels. No function allocates
 * or locks. */
#ifndef LG_KERNELS_MATRIX_H
#define LG_KERNELS_MATRIX_H

#include "kernels/kernels.h"

/* c (m, n) = a b with a (m, k) and b (k, n). multiply_tn: c = a^T b with a (k, m). */
void lg_matrix_multiply(size_t m, size_t n, size_t k, const double *a, const double *b, double *c);
void lg_matrix_multiply_tn(size_t m, size_t n, size_t k, const double *a, const double *b, double *c);
/* c (n, m) = a (m, n)^T */
void lg_matrix_transpose(size_t m, size_t n, const double *a, double *c);
/* y += c x */
void lg_matrix_add(size_t count, double c, const double *x, double *y);
/* Replaces x (n, n) by (x + x^T)/2. */
void lg_matrix_symmetrise(size_t n, double *x);
/* A matrix with twice the digits of double: its value is high + low. */
typedef struct lg_matrix_pair {
    double *high, *low;
} lg_matrix_pair;
/* c (m, n) = a^T b with a (k, m) and b (k, n), summed with twice the digits (Ogita, Rump & Oishi 2005, Dot2).
 * b.low may be NULL. */
void lg_matrix_multiply_twice(size_t m, size_t n, size_t k, const double *a, lg_matrix_pair b,
                              lg_matrix_pair c);
/* y += x, with y in twice the digits */
void lg_matrix_add_twice(size_t count, const double *x, lg_matrix_pair y);
double lg_matrix_norm(size_t count, const double *x);
/* The largest |eigenvalue| of a matrix (n, n), n <= 64, which is overwritten; 0 if they are not found */
double lg_matrix_radius(size_t n, double *a);
/* Eigenvalues w (n, ascending) of a symmetric matrix a (n, n), n <= 48. a is overwritten; with `vectors` its
 * rows become the eigenvectors. Returns false if they are not found. */
bool lg_matrix_eigen(size_t n, bool vectors, double *a, double *w);
/* LU factors of a (n, n), in place, with exchanges of rows; its rows are `stride` numbers apart. Returns
 * false if a pivot is 0 or not finite. lg_matrix_solve replaces x, whose numbers are `step` apart, by
 * a^-1 x. */
bool lg_matrix_factor(size_t n, size_t stride, double *a, size_t *pivot);
void lg_matrix_solve(size_t n, size_t stride, const double *a, const size_t *pivot, size_t step, double *x);
/* inverse (n, n) = a^-1; a becomes its factors. Returns false, with zeros in `inverse`, if a pivot is 0 or
 * not finite. */
bool lg_matrix_invert(size_t n, double *a, size_t *pivot, double *inverse);
/* L becomes the lower triangular matrix with L L^T = (a + a^T)/2. Returns false if (a + a^T)/2 is not
 * positive definite. a and L do not overlap. */
bool lg_matrix_cholesky(size_t n, const double *a, double *L);
/* T (n, n) = L^-T, upper triangular, for a lower triangular L */
void lg_matrix_invert_transposed(size_t n, const double *L, double *T);
/* L becomes lower triangular with L L^T = a for a positive semidefinite a. Returns false if a is not positive
 * semidefinite to 1e-8. */
bool lg_matrix_root(size_t n, const double *a, double *L);
/* Replaces M (rows, columns), rows <= columns, by (L, 0) with L L^T = M M^T, where L is lower triangular with
 * a diagonal >= 0. Uses Householder reflections from the right. */
void lg_matrix_lower(size_t rows, size_t columns, double *M);

#endif

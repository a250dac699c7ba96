/* exp(A) and phi(A) = (exp(A) - 1)/A of small matrices in long double, by scaling, Taylor's series and
 * doubling. References for the closed forms of the groups. */
#ifndef LG_MATRIX_FUNCTION_H
#define LG_MATRIX_FUNCTION_H

#include <math.h>
#include <string.h>

#define MATRIX_MAX 6

typedef struct matrix {
    int n;
    long double at[MATRIX_MAX][MATRIX_MAX];
} matrix;

static inline matrix matrix_scalar(int n, long double c) {
    matrix m = {.n = n};
    for (int i = 0; i < n; i++) m.at[i][i] = c;
    return m;
}

/* c A B + D. */
static inline matrix matrix_multiply_add(long double c, const matrix *a, const matrix *b, const matrix *d) {
    matrix m = *d;
    for (int i = 0; i < m.n; i++)
        for (int j = 0; j < m.n; j++)
            for (int k = 0; k < m.n; k++) m.at[i][j] += c * a->at[i][k] * b->at[k][j];
    return m;
}

/* The doubling uses phi(2A) = (exp(A) + 1) phi(A)/2. */
static inline void matrix_functions(const matrix *a, matrix *exponential, matrix *phi) {
    enum { TERMS = 24 };
    matrix small = *a;
    const matrix one = matrix_scalar(a->n, 1.0L), zero = matrix_scalar(a->n, 0.0L);
    long double norm = 0.0L;
    int doublings = 0;
    for (int i = 0; i < a->n; i++)
        for (int j = 0; j < a->n; j++) norm += fabsl(a->at[i][j]);
    for (; norm > 0.5L; norm *= 0.5L) doublings++;
    for (int i = 0; i < a->n; i++)
        for (int j = 0; j < a->n; j++) small.at[i][j] = ldexpl(a->at[i][j], -doublings);
    *phi = one;
    for (int k = TERMS; k >= 2; k--) *phi = matrix_multiply_add(1.0L / k, &small, phi, &one);
    *exponential = matrix_multiply_add(1.0L, &small, phi, &one);
    for (int k = 0; k < doublings; k++) {
        matrix sum = *exponential;
        for (int i = 0; i < sum.n; i++) sum.at[i][i] += 1.0L;
        *phi = matrix_multiply_add(0.5L, &sum, phi, &zero);
        *exponential = matrix_multiply_add(1.0L, exponential, exponential, &zero);
    }
}

/* out = M x, or M^T x if transposed. */
static inline void matrix_apply(const matrix *m, int transposed, const double *x, double *out) {
    long double sum[MATRIX_MAX] = {0};
    for (int i = 0; i < m->n; i++)
        for (int j = 0; j < m->n; j++) sum[i] += (transposed ? m->at[j][i] : m->at[i][j]) * x[j];
    for (int i = 0; i < m->n; i++) out[i] = (double)sum[i];
}

/* The matrix of x -> bracket(a, x), n = 3 or 6. */
static inline matrix matrix_of_bracket(int n, void (*bracket)(const double *, const double *, double *),
                                       const double *a) {
    matrix m = {.n = n};
    for (int j = 0; j < n; j++) {
        double unit[MATRIX_MAX] = {0}, column[MATRIX_MAX];
        unit[j] = 1.0;
        bracket(a, unit, column);
        for (int i = 0; i < n; i++) m.at[i][j] = column[i];
    }
    return m;
}

/* (hat(u), v; 0, 0). Its exponential is (R, r; 0, 1). */
static inline matrix matrix_of_motion(const double *a) {
    matrix m = {.n = 4};
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        m.at[i][j] = -a[k];
        m.at[i][k] = a[j];
        m.at[i][3] = a[3 + i];
    }
    return m;
}

#endif

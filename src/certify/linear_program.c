#include "certify/linear_program.h"

#include <cblas.h>
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "kernels/matrix.h"

/* Slacks s = A x - b > 0 and multipliers z > 0 with A^T z = c; optimal where all s z are 0. Residuals: p = A
 * x - s - b (m), d = c - A^T z (n). A step solves A^T W A dx = A^T (t/s - z - W p) - d with W = z/s; then ds
 * = A dx + p and dz = t/s - z - W ds. */
typedef struct solving {
    size_t m, n;
    const double *A, *b, *c;
    double *x, *s, *z, *p, *d, *dx, *ds, *dz, *t, *right, *scaled, *H, *L;
} solving;

static void multiply(const solving *v, const double *x, double *y) {
    cblas_dgemv(CblasRowMajor, CblasNoTrans, (int)v->m, (int)v->n, 1, v->A, (int)v->n, x, 1, 0, y, 1);
}

/* y = A^T x + beta y */
static void multiply_transposed(const solving *v, const double *x, double beta, double *y) {
    cblas_dgemv(CblasRowMajor, CblasTrans, (int)v->m, (int)v->n, 1, v->A, (int)v->n, x, 1, beta, y, 1);
}

static double residuals(const solving *v) {
    double worst = 0;
    multiply(v, v->x, v->p);
    for (size_t i = 0; i < v->m; i++) {
        v->p[i] -= v->s[i] + v->b[i];
        worst = fmax(worst, fabs(v->p[i]));
    }
    for (size_t j = 0; j < v->n; j++) v->d[j] = -v->c[j];
    multiply_transposed(v, v->z, 1, v->d);
    for (size_t j = 0; j < v->n; j++) {
        v->d[j] = -v->d[j];
        worst = fmax(worst, fabs(v->d[j]));
    }
    return worst;
}

static bool factorise(const solving *v) {
    double largest = 0;
    for (size_t i = 0; i < v->m; i++) {
        const double w = sqrt(v->z[i] / v->s[i]);
        for (size_t j = 0; j < v->n; j++) v->scaled[i * v->n + j] = w * v->A[i * v->n + j];
    }
    cblas_dgemm(CblasRowMajor, CblasTrans, CblasNoTrans, (int)v->n, (int)v->n, (int)v->m, 1, v->scaled,
                (int)v->n, v->scaled, (int)v->n, 0, v->H, (int)v->n);
    for (size_t j = 0; j < v->n; j++) largest = fmax(largest, v->H[j * v->n + j]);
    for (size_t j = 0; j < v->n; j++) v->H[j * v->n + j] += 1e-14 * largest;
    return lg_matrix_cholesky(v->n, v->H, v->L);
}

/* The step for the targets t of s z. */
static void step(const solving *v) {
    for (size_t i = 0; i < v->m; i++) v->right[i] = v->t[i] / v->s[i] - v->z[i] - v->z[i] / v->s[i] * v->p[i];
    for (size_t j = 0; j < v->n; j++) v->dx[j] = -v->d[j];
    multiply_transposed(v, v->right, 1, v->dx);
    cblas_dtrsv(CblasRowMajor, CblasLower, CblasNoTrans, CblasNonUnit, (int)v->n, v->L, (int)v->n, v->dx, 1);
    cblas_dtrsv(CblasRowMajor, CblasLower, CblasTrans, CblasNonUnit, (int)v->n, v->L, (int)v->n, v->dx, 1);
    multiply(v, v->dx, v->ds);
    for (size_t i = 0; i < v->m; i++) {
        v->ds[i] += v->p[i];
        v->dz[i] = v->t[i] / v->s[i] - v->z[i] - v->z[i] / v->s[i] * v->ds[i];
    }
}

/* The longest step, at most 1, that keeps x + step dx >= 0. */
static double room(size_t m, const double *x, const double *dx) {
    double most = 1;
    for (size_t i = 0; i < m; i++)
        if (dx[i] < 0) most = fmin(most, -x[i] / dx[i]);
    return most;
}

static double product(const solving *v, double a, double b) {
    double sum = 0;
    for (size_t i = 0; i < v->m; i++) sum += (v->s[i] + a * v->ds[i]) * (v->z[i] + b * v->dz[i]);
    return sum / (double)v->m;
}

static lg_status iterate(const solving *v) {
    for (int k = 0; k < 200; k++) {
        const double worst = residuals(v);
        double now = 0;
        for (size_t i = 0; i < v->m; i++) now += v->s[i] * v->z[i] / (double)v->m;
        if (!isfinite(worst) || !isfinite(now)) return LG_NO_CONVERGENCE;
        if (worst < 1e-8 && now * (double)v->m < 1e-7 * (1 + fabs(cblas_ddot((int)v->n, v->c, 1, v->x, 1))))
            return LG_OK;
        if (!factorise(v)) return LG_NO_CONVERGENCE;
        memset(v->t, 0, v->m * sizeof *v->t);
        step(v);
        const double part = product(v, room(v->m, v->s, v->ds), room(v->m, v->z, v->dz)) / now;
        for (size_t i = 0; i < v->m; i++) v->t[i] = part * part * part * now - v->ds[i] * v->dz[i];
        step(v);
        const double a = 0.99 * room(v->m, v->s, v->ds), b = 0.99 * room(v->m, v->z, v->dz);
        cblas_daxpy((int)v->n, a, v->dx, 1, v->x, 1);
        cblas_daxpy((int)v->m, a, v->ds, 1, v->s, 1);
        cblas_daxpy((int)v->m, b, v->dz, 1, v->z, 1);
    }
    return LG_NO_CONVERGENCE;
}

lg_status lg_linear_program(const lg_context *context, size_t m, size_t n, const double *A, const double *b,
                            const double *c, double *x) {
    const size_t all = 7 * m + 3 * n + m * n + 2 * n * n;
    LG_TRY_SCRATCH(double, memory, context, all, LG_OUT_OF_MEMORY);
    double *at = memory;
    solving v = {.m = m, .n = n, .A = A, .b = b, .c = c, .x = x};
    double **const long_ones[] = {&v.s, &v.z, &v.p, &v.ds, &v.dz, &v.t, &v.right};
    for (size_t i = 0; i < LG_COUNT(long_ones); i++, at += m) *long_ones[i] = at;
    v.d = at;
    v.dx = at + n;
    v.scaled = at + 2 * n;
    v.H = v.scaled + m * n;
    v.L = v.H + n * n;
    memset(x, 0, n * sizeof *x);
    for (size_t i = 0; i < m; i++) v.s[i] = v.z[i] = 1;
    return iterate(&v);
}

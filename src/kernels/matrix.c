#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "kernels/matrix.h"

void lg_matrix_multiply(size_t m, size_t n, size_t k, const double *a, const double *b, double *c) {
    lg_kernels_for(LG_F64)->gemm(m, n, k, a, k, 1, b, n, c, n, false);
}

void lg_matrix_multiply_tn(size_t m, size_t n, size_t k, const double *a, const double *b, double *c) {
    lg_kernels_for(LG_F64)->gemm(m, n, k, a, 1, m, b, n, c, n, false);
}

void lg_matrix_transpose(size_t m, size_t n, const double *a, double *c) {
    lg_kernels_for(LG_F64)->transpose(m, n, a, c);
}

void lg_matrix_add(size_t count, double c, const double *x, double *y) {
    lg_kernels_for(LG_F64)->axpy(count, c, x, y);
}

void lg_matrix_symmetrise(size_t n, double *x) {
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < i; j++) x[i * n + j] = x[j * n + i] = 0.5 * (x[i * n + j] + x[j * n + i]);
}

void lg_matrix_multiply_twice(size_t m, size_t n, size_t k, const double *a, lg_matrix_pair b,
                              lg_matrix_pair c) {
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < n; j++) {
            double sum = 0.0, rest = 0.0;
            for (size_t l = 0; l < k; l++) {
                const double x = a[l * m + i], y = b.high[l * n + j], product = x * y, before = sum;
                sum += product;
                const double taken = sum - before;
                rest += (before - (sum - taken)) + (product - taken) + fma(x, y, -product);
                if (b.low != NULL) rest += x * b.low[l * n + j];
            }
            c.high[i * n + j] = sum + rest;
            c.low[i * n + j] = rest - (c.high[i * n + j] - sum);
        }
}

void lg_matrix_add_twice(size_t count, const double *x, lg_matrix_pair y) {
    for (size_t i = 0; i < count; i++) {
        const double sum = y.high[i] + x[i], taken = sum - y.high[i];
        y.low[i] += (y.high[i] - (sum - taken)) + (x[i] - taken);
        y.high[i] = sum;
    }
}

double lg_matrix_norm(size_t count, const double *x) {
    double largest = 0.0, sum = 0.0;
    for (size_t i = 0; i < count && !isnan(largest); i++)
        if (!(fabs(x[i]) <= largest)) largest = fabs(x[i]);
    if (!(largest > 0.0) || !isfinite(largest)) return largest;
    for (size_t i = 0; i < count; i++) sum += (x[i] / largest) * (x[i] / largest);
    return largest * sqrt(sum);
}

double lg_matrix_radius(size_t n, double *a) {
    enum { MOST = 64, ROOM = 4 * MOST };
    double re[MOST], im[MOST], work[ROOM], most = 0;
    const int size = (int)n, room = ROOM, one = 1;
    int info;
    for (size_t i = 0; i < n * n; i++)
        if (!isfinite(a[i])) return 0;
    dgeev_("N", "N", &size, a, &size, re, im, NULL, &one, NULL, &one, work, &room, &info);
    for (size_t i = 0; i < n && info == 0; i++) most = fmax(most, hypot(re[i], im[i]));
    return most;
}

bool lg_matrix_eigen(size_t n, bool vectors, double *a, double *w) {
    enum { MOST = 48, ROOM = 1 + 6 * MOST + 2 * MOST * MOST, INTEGERS = 3 + 5 * MOST };
    const int size = (int)n, room = ROOM, integers = INTEGERS;
    double work[ROOM];
    int whole[INTEGERS], info = 0;
    dsyevd_(vectors ? "V" : "N", "L", &size, a, &size, w, work, &room, whole, &integers, &info);
    return info == 0;
}

bool lg_matrix_factor(size_t n, size_t stride, double *a, size_t *pivot) {
    for (size_t k = 0; k < n; k++) {
        size_t p = k;
        for (size_t i = k + 1; i < n; i++)
            if (fabs(a[i * stride + k]) > fabs(a[p * stride + k])) p = i;
        pivot[k] = p;
        if (!(fabs(a[p * stride + k]) > 0.0) || !isfinite(a[p * stride + k])) return false;
        for (size_t j = 0; p != k && j < n; j++) {
            const double swap = a[k * stride + j];
            a[k * stride + j] = a[p * stride + j];
            a[p * stride + j] = swap;
        }
        for (size_t i = k + 1; i < n; i++) {
            const double factor = a[i * stride + k] /= a[k * stride + k];
            if (factor == 0.0) continue;
            for (size_t j = k + 1; j < n; j++) a[i * stride + j] -= factor * a[k * stride + j];
        }
    }
    return true;
}

void lg_matrix_solve(size_t n, size_t stride, const double *a, const size_t *pivot, size_t step, double *x) {
    for (size_t k = 0; k < n; k++) {
        const double swap = x[k * step];
        x[k * step] = x[pivot[k] * step];
        x[pivot[k] * step] = swap;
    }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < i; j++) x[i * step] -= a[i * stride + j] * x[j * step];
    for (size_t i = n; i-- > 0;) {
        for (size_t j = i + 1; j < n; j++) x[i * step] -= a[i * stride + j] * x[j * step];
        x[i * step] /= a[i * stride + i];
    }
}

bool lg_matrix_invert(size_t n, double *a, size_t *pivot, double *inverse) {
    memset(inverse, 0, n * n * sizeof *inverse);
    if (!lg_matrix_factor(n, n, a, pivot)) return false;
    for (size_t j = 0; j < n; j++) {
        inverse[j * (n + 1)] = 1.0;
        lg_matrix_solve(n, n, a, pivot, n, inverse + j);
    }
    return true;
}

bool lg_matrix_cholesky(size_t n, const double *a, double *L) {
    return lg_kernels_for(LG_F64)->spd_factor(1, n, a, L) == 0;
}

void lg_matrix_invert_transposed(size_t n, const double *L, double *T) {
    memset(T, 0, n * n * sizeof *T);
    for (size_t j = 0; j < n; j++)
        for (size_t i = j + 1; i-- > 0;) {
            double rest = i == j ? 1.0 : 0.0;
            for (size_t k = i + 1; k <= j; k++) rest -= L[k * n + i] * T[k * n + j];
            T[i * n + j] = rest / L[i * (n + 1)];
        }
}

bool lg_matrix_root(size_t n, const double *a, double *L) {
    memset(L, 0, n * n * sizeof *L);
    for (size_t j = 0; j < n; j++) {
        const double *row = L + j * n, own = a[j * n + j];
        const double pivot = own - lg_kernels_for(LG_F64)->dot(j, row, row);
        if (!(pivot >= -1e-8 * own)) return false; /* also false for own < 0 */
        const bool zero = pivot <= 1e-14 * own;
        L[j * n + j] = zero ? 0.0 : sqrt(pivot);
        for (size_t i = j + 1; i < n; i++) {
            const double left = a[i * n + j] - lg_kernels_for(LG_F64)->dot(j, row, L + i * n);
            if (!zero)
                L[i * n + j] = left / L[j * n + j];
            else if (!(fabs(left) <= 1e-7 * sqrt(fabs(own * a[i * n + i]))))
                return false;
        }
    }
    return true;
}

void lg_matrix_lower(size_t rows, size_t columns, double *M) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    for (size_t i = 0; i < rows; i++) {
        const size_t length = columns - i;
        double *v = M + i * columns + i;
        const double norm = sqrt(k->dot(length, v, v)), first = v[0];
        if (norm > 0.0) {
            v[0] += copysign(norm, first); /* 2/|v|^2 = 1/(norm |v_0|) */
            const double factor = 1.0 / (norm * fabs(v[0]));
            for (size_t r = i + 1; r < rows; r++) {
                double *other = M + r * columns + i;
                k->axpy(length, -factor * k->dot(length, v, other), v, other);
            }
        }
        memset(v, 0, length * sizeof *v);
        v[0] = norm;
        for (size_t r = i + 1; first >= 0.0 && r < rows; r++) M[r * columns + i] = -M[r * columns + i];
    }
}

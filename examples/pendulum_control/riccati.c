#include "riccati.h"

#include <math.h>
#include <string.h>

enum { N2 = 2 * RICCATI_MAX, ITERATIONS = 60 };

/* Solves M X = F in place of F (n, columns) by Gaussian elimination with row pivoting; M is destroyed.
 * Returns log |det M|, NaN when a pivot is zero or not finite. */
static double solve(int n, double *M, int columns, double *F) {
    double log_det = 0.0;
    for (int j = 0; j < n; j++) {
        int pivot = j;
        for (int i = j + 1; i < n; i++)
            if (fabs(M[i * n + j]) > fabs(M[pivot * n + j])) pivot = i;
        if (!(fabs(M[pivot * n + j]) > 0.0)) return NAN;
        for (int c = 0; c < n; c++) {
            const double kept = M[j * n + c];
            M[j * n + c] = M[pivot * n + c], M[pivot * n + c] = kept;
        }
        for (int c = 0; c < columns; c++) {
            const double kept = F[j * columns + c];
            F[j * columns + c] = F[pivot * columns + c], F[pivot * columns + c] = kept;
        }
        log_det += log(fabs(M[j * n + j]));
        for (int i = 0; i < n; i++) {
            if (i == j) continue;
            const double factor = M[i * n + j] / M[j * n + j];
            for (int c = j; c < n; c++) M[i * n + c] -= factor * M[j * n + c];
            for (int c = 0; c < columns; c++) F[i * columns + c] -= factor * F[j * columns + c];
        }
    }
    for (int i = 0; i < n; i++)
        for (int c = 0; c < columns; c++) F[i * columns + c] /= M[i * n + i];
    return log_det;
}

/* Z <- sign(Z), n <= N2: Z <- (c Z + (c Z)^-1)/2 with c = |det Z|^(-1/n). */
static bool matrix_sign(int n, double *Z) {
    double M[N2 * N2], inverse[N2 * N2];
    for (int iteration = 0; iteration < ITERATIONS; iteration++) {
        double change = 0.0, size = 0.0;
        memcpy(M, Z, (size_t)(n * n) * sizeof *M);
        for (int i = 0; i < n * n; i++) inverse[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
        const double c = exp(-solve(n, M, n, inverse) / n);
        if (!isfinite(c)) return false;
        for (int i = 0; i < n * n; i++) {
            const double next = 0.5 * (c * Z[i] + inverse[i] / c);
            change = fmax(change, fabs(next - Z[i]));
            size = fmax(size, fabs(next));
            Z[i] = next;
        }
        if (change <= 1e-13 * size) return true;
    }
    return false;
}

/* W = [Z12; Z22 + I], F = -[Z11 + I; Z21]: normal equations of W P = F. */
static bool stable_subspace(int n, const double *Z, double *P) {
    double WW[RICCATI_MAX * RICCATI_MAX], WF[RICCATI_MAX * RICCATI_MAX];
    const int n2 = 2 * n;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double ww = 0.0, wf = 0.0;
            for (int l = 0; l < n2; l++) {
                const double wi = Z[l * n2 + n + i] + (l == n + i ? 1.0 : 0.0);
                ww += wi * (Z[l * n2 + n + j] + (l == n + j ? 1.0 : 0.0));
                wf -= wi * (Z[l * n2 + j] + (l == j ? 1.0 : 0.0));
            }
            WW[i * n + j] = ww;
            WF[i * n + j] = wf;
        }
    if (!isfinite(solve(n, WW, n, WF))) return false;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) P[i * n + j] = 0.5 * (WF[i * n + j] + WF[j * n + i]);
    return true;
}

double riccati_residual(int n, const double *A, const double *G, const double *Q, const double *P) {
    double GP[RICCATI_MAX * RICCATI_MAX], worst = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = 0.0;
            for (int l = 0; l < n; l++) sum += G[i * n + l] * P[l * n + j];
            GP[i * n + j] = sum;
        }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double sum = Q[i * n + j];
            for (int l = 0; l < n; l++)
                sum += A[l * n + i] * P[l * n + j] + P[i * n + l] * (A[l * n + j] - GP[l * n + j]);
            if (!(fabs(sum) <= worst)) worst = fabs(sum);
        }
    return worst;
}

static double largest(int count, const double *x) {
    double most = 0.0;
    for (int i = 0; i < count; i++)
        if (!(fabs(x[i]) <= most)) most = fabs(x[i]);
    return most;
}

bool riccati_solve(int n, const double *A, const double *G, const double *Q, double *P) {
    double Z[N2 * N2], made[RICCATI_MAX * RICCATI_MAX];
    const int n2 = 2 * n;
    if (n < 1 || n > RICCATI_MAX) return false;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            Z[i * n2 + j] = A[i * n + j];
            Z[i * n2 + n + j] = -G[i * n + j];
            Z[(n + i) * n2 + j] = -Q[i * n + j];
            Z[(n + i) * n2 + n + j] = -A[j * n + i];
        }
    if (!matrix_sign(n2, Z) || !stable_subspace(n, Z, made)) return false;
    /* What is no solution is not given out: without a stabilising one the subspace is not a graph. */
    const double p = largest(n * n, made);
    const double terms = p * (2.0 * largest(n * n, A) + p * largest(n * n, G)) + largest(n * n, Q);
    if (!(riccati_residual(n, A, G, Q, made) <= 1e-8 * n * n * terms)) return false;
    memcpy(P, made, (size_t)(n * n) * sizeof *P);
    return true;
}

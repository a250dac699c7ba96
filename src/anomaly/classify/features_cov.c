/* Features of all selected channels together: the symmetric square root of their covariance. */
#include "anomaly/classify/features.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* Layout of `work`: numbers that compute_cov keeps for the derivative, and temporary numbers. */
typedef struct kept {
    double *z;       /* (m, length): scaled channels without their means */
    double *vectors; /* (m, m): orthonormal eigenvectors of the covariance, one per row */
    double *roots;   /* (m): square roots of the eigenvalues, in the order of the vectors */
    double *rest;    /* temporary: m max(length, 2 m) numbers */
} kept;

static kept keep_in(const lg_features *f, double *work) {
    const size_t m = f->selected;
    double *vectors = work + m * f->length, *roots = vectors + m * m;
    return (kept){.z = work, .vectors = vectors, .roots = roots, .rest = roots + m};
}

static size_t cov_work(const lg_features *f) {
    const size_t m = f->selected, length = f->length;
    return m * length + m * m + m + m * (length > 2 * m ? length : 2 * m);
}

static uint64_t cov_count(const lg_features *f) {
    const uint64_t m = f->selected;
    return m * (m + 1) / 2;
}

/* The covariance C = Z Z^T/n is never formed, because its small eigenvalues would lose half of their digits.
 * Instead the singular values of Z (m, n) are computed: the left singular vectors of Z are the eigenvectors
 * of C, and the singular values divided by sqrt(n) are the square roots of its eigenvalues. */

/* QR factorisation of the rows of z (m, n): z = G^T Q, where G (m, m) is upper triangular and the rows of Q
 * are orthonormal. The method is modified Gram-Schmidt, which computes G as accurately as Householder's
 * method (Bjorck 1967). Q is not kept; z is overwritten. */
static void triangle(double *z, size_t m, size_t n, double *g) {
    memset(g, 0, m * m * sizeof *g);
    for (size_t k = 0; k < m; k++) {
        const double *row = z + k * n;
        const double norm = sqrt(lg_dot(row, row, n)), inverse = norm > 0.0 ? 1.0 / norm : 0.0;
        g[k * m + k] = norm;
        for (size_t j = k + 1; j < m; j++) {
            double *other = z + j * n;
            const double along = lg_dot(row, other, n) * inverse, factor = along * inverse;
            g[k * m + j] = along;
            for (size_t t = 0; t < n; t++) other[t] -= factor * row[t];
        }
    }
}

/* Dot product of two rows of m numbers. For small m one plain sum is faster than lg_dot's partial sums. */
static double product(const double *a, const double *b, size_t m) {
    if (m >= 16) return lg_dot(a, b, m);
    double sum = 0.0;
    for (size_t i = 0; i < m; i++) sum += a[i] * b[i];
    return sum;
}

/* Rotates the rows a and b (m) so that they become orthogonal. ab is their dot product before, na and nb are
 * their norms. */
static void rotate(double *a, double *b, size_t m, double ab, double na, double nb) {
    const double middle = (nb - na) * (nb + na) / (2.0 * ab);
    const double size = 1.0 / (fabs(middle) + sqrt(1.0 + middle * middle));
    const double tangent = middle < 0.0 ? -size : size;
    const double cosine = 1.0 / sqrt(1.0 + tangent * tangent), sine = cosine * tangent;
    for (size_t i = 0; i < m; i++) {
        const double u = a[i], v = b[i];
        a[i] = cosine * u - sine * v;
        b[i] = sine * u + cosine * v;
    }
}

/* One sweep over all pairs of rows of g (m, m). Rotates the pairs that are not yet orthogonal and updates the
 * norms (m) of the rows. Rows with a norm of at most `least` stay as they are. Returns whether any pair was
 * rotated. */
static bool sweep(double *g, size_t m, double least, double *norm) {
    const double tolerance = DBL_EPSILON * sqrt((double)m + 2.0);
    bool rotated = false;
    for (size_t p = 0; p < m; p++)
        for (size_t q = p + 1; q < m; q++) {
            double *a = g + p * m, *b = g + q * m;
            if (norm[p] <= least || norm[q] <= least) continue;
            const double ab = product(a, b, m);
            if (fabs(ab) <= tolerance * norm[p] * norm[q]) continue;
            rotate(a, b, m, ab, norm[p], norm[q]);
            norm[p] = sqrt(product(a, a, m));
            norm[q] = sqrt(product(b, b, m));
            rotated = true;
        }
    return rotated;
}

/* Rotates the rows of g (m, m) until all are orthogonal (one-sided Jacobi, Hestenes 1958). Each row then is a
 * singular value times a right singular vector. norm (m) becomes the singular values. */
static lg_status singular_rows(double *g, size_t m, double *norm) {
    enum { SWEEPS = 60 }; /* convergence is quadratic: more than ten sweeps are rare */
    for (size_t k = 0; k < m; k++) norm[k] = sqrt(lg_dot(g + k * m, g + k * m, m));
    const double all = sqrt(lg_dot(norm, norm, m));
    if (!isfinite(all)) return LG_NOT_FINITE;
    for (int i = 0; i < SWEEPS; i++)
        if (!sweep(g, m, 0.5 * DBL_EPSILON * all, norm)) return LG_OK;
    return LG_NO_CONVERGENCE;
}

/* Threshold for the roots: roots up to this value count as 0. It is the square root of LG_NULL_EIGENVALUE
 * times the largest eigenvalue. */
static double null_root(const double *roots, size_t m) {
    double largest = 0.0;
    for (size_t k = 0; k < m; k++) largest = fmax(largest, roots[k]);
    return sqrt(LG_NULL_EIGENVALUE) * largest;
}

/* Sets row k of v (m, m) to a unit vector orthogonal to the known rows: known[j] is 1 for a known row j,
 * otherwise 0. It begins with the coordinate axis that is farthest from the span of the known rows and
 * orthogonalises it twice. */
static void complete_row(double *v, size_t m, size_t k, const double *known) {
    double *row = v + k * m, least = INFINITY;
    size_t best = 0;
    for (size_t i = 0; i < m; i++) {
        double taken = 0.0;
        for (size_t j = 0; j < m; j++) taken += known[j] * v[j * m + i] * v[j * m + i];
        if (taken < least) best = i;
        least = fmin(least, taken);
    }
    memset(row, 0, m * sizeof *row);
    row[best] = 1.0;
    for (int pass = 0; pass < 2; pass++)
        for (size_t j = 0; j < m; j++) {
            const double along = known[j] * lg_dot(row, v + j * m, m);
            for (size_t i = 0; i < m && along != 0.0; i++) row[i] -= along * v[j * m + i];
        }
    const double norm = sqrt(lg_dot(row, row, m));
    for (size_t i = 0; i < m; i++) row[i] /= norm;
}

/* Makes the rows of v orthonormal. Rows whose root counts as 0 contain only rounding errors; they are
 * replaced by any orthonormal basis of the null space. known (m) is work memory. */
static void orthonormalise(double *v, size_t m, const double *roots, double *known) {
    const double null = null_root(roots, m);
    for (size_t k = 0; k < m; k++) {
        double *row = v + k * m;
        known[k] = roots[k] > null ? 1.0 : 0.0;
        if (roots[k] > null)
            for (size_t i = 0; i < m; i++) row[i] /= roots[k];
        else
            memset(row, 0, m * sizeof *row);
    }
    for (size_t k = 0; k < m; k++) {
        if (known[k] > 0.0) continue;
        complete_row(v, m, k, known);
        known[k] = 1.0;
    }
}

/* Computes the scaled, centred channels of window x, and their singular values and vectors: first `triangle`,
 * then `singular_rows`. */
static lg_status decompose(const lg_features *f, const float *x, const kept *k) {
    const size_t m = f->selected, length = f->length;
    for (size_t i = 0; i < m; i++) {
        const uint32_t channel = f->select[i];
        (void)lg_centre(x + (size_t)channel * length, length, f->scale[channel], k->z + i * length);
    }
    memcpy(k->rest, k->z, m * length * sizeof *k->z);
    triangle(k->rest, m, length, k->vectors);
    return singular_rows(k->vectors, m, k->roots);
}

/* out becomes the upper triangle of the root, sum_k v_k s_k v_k^T/sqrt(n), with the singular values s_k and
 * the singular vectors v_k of the channels. */
static lg_status compute_cov(const lg_features *f, const float *x, double *out, double *work) {
    const kept keep = keep_in(f, work);
    const size_t m = f->selected;
    double *vectors = keep.vectors, *roots = keep.roots, *a = keep.rest;
    LG_TRY(decompose(f, x, &keep));
    for (size_t k = 0; k < m; k++) {
        const double norm = roots[k], factor = norm > 0.0 ? 1.0 / norm / sqrt((double)f->length) : 0.0;
        for (size_t i = 0; i < m; i++) a[k * m + i] = factor * vectors[k * m + i];
    }
    for (size_t i = 0; i < m; i++)
        for (size_t j = i; j < m; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < m; k++) sum += a[k * m + i] * vectors[k * m + j];
            *out++ = sum;
        }
    orthonormalise(vectors, m, roots, a);
    for (size_t k = 0; k < m; k++) roots[k] /= sqrt((double)f->length);
    return LG_OK;
}

/* ---- derivative ---- */

/* to = V a V^T, or V^T a V if `back`. All matrices are (m, m), a is symmetric. The rows of V are
 * eigenvectors. */
static void turn(const double *v, size_t m, bool back, const double *a, double *half, double *to) {
    const size_t row = back ? 1 : m, column = back ? m : 1; /* strides of element (i, k) of the left factor */
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < m; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < m; k++) sum += v[i * row + k * column] * a[k * m + j];
            half[i * m + j] = sum;
        }
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < m; j++) {
            double sum = 0.0;
            for (size_t k = 0; k < m; k++) sum += half[i * m + k] * v[j * row + k * column];
            to[i * m + j] = sum;
        }
}

/* The root S satisfies S S = C, hence Sylvester's equation S dS + dS S = dC. In the basis of the eigenvectors
 * of C the equation is diagonal,
 *   (V dS V^T)_ij = (V dC V^T)_ij/(s_i + s_j),
 * and it is self-adjoint (Higham, Functions of Matrices, 2008, section 6.1). Within the null space the root
 * has a kink, and the derivative is set to 0. */
static void solve_sylvester(const double *roots, size_t m, double *a) {
    const double null = null_root(roots, m);
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < m; j++) {
            const double sum = (roots[i] > null ? roots[i] : 0.0) + (roots[j] > null ? roots[j] : 0.0);
            a[i * m + j] = sum > 0.0 ? a[i * m + j] / sum : 0.0;
        }
}

/* If H is the cotangent of C = Z Z^T/n, the cotangent of Z is 2 H Z/n. Its rows have mean 0 because the rows
 * of Z have; so the derivative of the centring adds nothing. */
static void reverse_cov(const lg_features *f, const double *cotangent, double *work, double *gradient) {
    const kept k = keep_in(f, work);
    const size_t m = f->selected, length = f->length;
    double *h = k.rest, *half = h + m * m;
    for (size_t i = 0; i < m; i++)
        for (size_t j = i; j < m; j++, cotangent++)
            h[i * m + j] = h[j * m + i] = i == j ? *cotangent : 0.5 * *cotangent;
    turn(k.vectors, m, false, h, half, h);
    solve_sylvester(k.roots, m, h);
    turn(k.vectors, m, true, h, half, h);
    for (size_t i = 0; i < m; i++) {
        const double outside = 2.0 / ((double)length * f->scale[f->select[i]]);
        double *to = gradient + (size_t)f->select[i] * length;
        for (size_t j = 0; j < m; j++) {
            const double factor = outside * h[i * m + j];
            for (size_t t = 0; t < length; t++) to[t] += factor * k.z[j * length + t];
        }
    }
}

/* ---- names ---- */

/* Row and column of entry `index` of an upper triangle that is stored row by row. */
static void entry_of(uint32_t m, uint32_t index, uint32_t *row, uint32_t *column) {
    *row = 0;
    while (index >= m - *row) index -= m - (*row)++;
    *column = *row + index;
}

static int describe_cov(const lg_features *f, const lg_series *series, uint32_t index, char *text,
                        size_t size) {
    char first[LG_SERIES_NAME], second[LG_SERIES_NAME];
    uint32_t i, j;
    entry_of(f->selected, index, &i, &j);
    (void)lg_channel_name(series, f->select[i], first, sizeof first);
    (void)lg_channel_name(series, f->select[j], second, sizeof second);
    return snprintf(text, size, "cov %s %s", first, second);
}

const lg_feature_row lg_feature_cov = {.name = "cov",
                                       .count = cov_count,
                                       .work = cov_work,
                                       .compute = compute_cov,
                                       .reverse = reverse_cov,
                                       .describe = describe_cov};

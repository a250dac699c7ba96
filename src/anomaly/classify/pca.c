/* Standardisation and principal components. */
#include "anomaly/classify/classify_internal.h"

#include <cblas.h>
#include <limits.h>
#include <math.h>
#include <string.h>

#include "core/rounding.h"
#include "kernels/lapack.h"

/* ---- checks of the table of a fit ---- */

lg_status lg_check_table(const double *x, size_t n, uint32_t d, lg_error *error) {
    if (x == NULL || n == 0 || d == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a table of %zu rows and %u features is empty or NULL", n,
                       d);
    if (n > INT_MAX / 2 || d > LG_FEATURES_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a table of %zu rows and %u features is too large: at most %d and %u", n, d,
                       INT_MAX / 2, LG_FEATURES_MAX);
    for (size_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < d; j++)
            if (!isfinite(x[i * d + j]))
                return lg_fail(error, LG_NOT_FINITE, "feature %u of row %zu is %g", j, i, x[i * d + j]);
    return LG_OK;
}

lg_status lg_check_c(double c, uint32_t classes, lg_error *error) {
    if (!(c > 0.0) || !isfinite(c))
        return lg_fail(error, LG_INVALID_ARGUMENT, "C is %g, expected a positive number", c);
    return classes >= 2 && classes <= LG_CLASSES_MAX
               ? LG_OK
               : lg_fail(error, LG_INVALID_ARGUMENT, "%u classes: 2 to %u are expected", classes,
                         LG_CLASSES_MAX);
}

lg_status lg_check_labels(const uint32_t *label, size_t n, uint32_t classes, uint32_t least, size_t *counts,
                          lg_error *error) {
    bool differ = false;
    if (counts != NULL) memset(counts, 0, classes * sizeof *counts);
    for (size_t i = 0; i < n; i++) {
        if (label[i] >= classes)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "row %zu is of class %u (counted from 0), but there are %u classes", i, label[i],
                           classes);
        if (counts != NULL) counts[label[i]]++;
        differ = differ || label[i] != label[0];
    }
    if (!differ && least > 1)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "all %zu rows are of one class: there is nothing to tell apart", n);
    return LG_OK;
}

void lg_column_means(const double *x, size_t n, size_t d, double *mean) {
    memset(mean, 0, d * sizeof *mean);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < d; j++) mean[j] += x[i * d + j] / (double)n;
}

/* ---- standardisation ---- */

/* Computes mean and scale of each column, about its first value, so that a large offset costs no digits. A
 * column that is constant up to rounding gets scale 1. */
static lg_status measure(const double *x, size_t n, uint32_t d, lg_pca *p) {
    const double weight = 1.0 / (double)n;
    for (size_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < d; j++) p->mean[j] += weight * (x[i * d + j] - x[j]);
    for (uint32_t j = 0; j < d; j++) p->mean[j] += x[j];
    for (size_t i = 0; i < n; i++) /* second pass: p->scale first holds the variance */
        for (uint32_t j = 0; j < d; j++) {
            const double z = x[i * d + j] - p->mean[j];
            p->scale[j] += weight * z * z;
        }
    for (uint32_t j = 0; j < d; j++) {
        if (!isfinite(p->scale[j]) || !isfinite(p->mean[j])) return LG_NOT_FINITE;
        const double deviation = sqrt(p->scale[j]);
        p->scale[j] = lg_is_rounding(deviation, p->mean[j]) ? 1.0 : deviation;
    }
    return LG_OK;
}

static void standardise(const lg_pca *p, const double *x, double *z) {
    for (uint32_t j = 0; j < p->inputs; j++) z[j] = (x[j] - p->mean[j]) / p->scale[j];
}

/* Changes the sign of v so that its largest entry in absolute value is positive. Of several entries that are
 * equal up to 1e-9, the first one decides. */
static void fix_sign(double *v, size_t d) {
    double largest = 0.0;
    for (size_t i = 0; i < d; i++) largest = fmax(largest, fabs(v[i]));
    size_t i = 0;
    while (fabs(v[i]) < (1.0 - 1e-9) * largest) i++;
    if (v[i] < 0.0) cblas_dscal((int)d, -1.0, v, 1);
}

typedef struct scratch {
    double *z, *a, *values, *rows, *work; /* a: (small, small) */
} scratch;

static size_t eigen_work(size_t d) {
    return 1 + 6 * d + 2 * d * d;
}

/* The eigenvectors of Z^T Z/n, in falling order. The row-major upper triangle of `a` is the lower triangle of
 * LAPACK's column-major matrix, and LAPACK's eigenvectors, its columns, are the rows of `a`. */
static lg_status by_covariance(size_t n, lg_pca *p, const scratch *s) {
    const size_t d = p->inputs;
    const int order = (int)d, lwork = (int)eigen_work(d), liwork = (int)(3 + 5 * d);
    int info = 0, *iwork = (int *)(void *)(s->work + lwork);
    cblas_dsyrk(CblasRowMajor, CblasUpper, CblasTrans, order, (int)n, 1.0 / (double)n, s->z, order, 0.0, s->a,
                order);
    dsyevd_("V", "L", &order, s->a, &order, s->values, s->work, &lwork, iwork, &liwork, &info);
    if (info != 0) return LG_NO_CONVERGENCE;
    for (size_t i = 0; i < d; i++) p->variance[i] = fmax(s->values[d - 1 - i], 0.0);
    for (size_t j = 0; j < p->components; j++)
        memcpy(s->rows + j * d, s->a + (d - 1 - j) * d, d * sizeof *s->rows);
    return LG_OK;
}

static size_t singular_work(size_t n) {
    return 4 * n * n + 7 * n;
}

/* The same for d > n: singular vectors of Z. LAPACK's column-major matrix is Z^T (d, n). */
static lg_status by_singular_values(size_t n, lg_pca *p, const scratch *s) {
    const int rows = (int)p->inputs, columns = (int)n, lwork = (int)singular_work(n);
    int info = 0, *iwork = (int *)(void *)(s->work + lwork);
    dgesdd_("S", &rows, &columns, s->z, &rows, s->values, s->rows, &rows, s->a, &columns, s->work, &lwork,
            iwork, &info);
    for (size_t i = 0; i < n; i++) p->variance[i] = s->values[i] * s->values[i] / (double)n;
    return info == 0 ? LG_OK : LG_NO_CONVERGENCE;
}

static lg_status decompose(const double *x, size_t n, lg_pca *p, const scratch *s) {
    const size_t d = p->inputs, k = p->components;
    for (size_t i = 0; i < n; i++) standardise(p, x + i * d, s->z + i * d);
    LG_TRY((d <= n ? by_covariance : by_singular_values)(n, p, s));
    for (size_t j = 0; j < k; j++) {
        fix_sign(s->rows + j * d, d);
        for (size_t i = 0; i < d; i++) p->vectors[i * k + j] = s->rows[j * d + i];
    }
    return LG_OK;
}

static lg_status fit_components(const lg_context *context, const double *x, size_t n, lg_pca *p,
                                lg_error *error) {
    const size_t d = p->inputs, small = p->variances;
    scratch s = {0};
    lg_status status =
        LG_ALLOC_ALL(context, LG_ARRAY(s.z, n * d), LG_ARRAY(s.a, small * small), LG_ARRAY(s.values, small),
                     LG_ARRAY(s.rows, (d <= n ? p->components : n) * d),
                     LG_ARRAY(s.work, d <= n ? eigen_work(d) + 3 * d + 2 : singular_work(n) + 4 * n));
    if (status == LG_OK) status = decompose(x, n, p, &s);
    LG_FREE_ALL(context, s.z, s.a, s.values, s.rows, s.work);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "principal components of %zu rows and %u features: %s", n, p->inputs,
                   lg_status_sentence(status));
}

static lg_status fit_into(const lg_context *context, const double *x, size_t n, lg_pca *p, lg_error *error) {
    const size_t d = p->inputs;
    if (LG_ALLOC_ALL(context, LG_ARRAY(p->mean, d), LG_ARRAY(p->scale, d),
                     LG_ARRAY(p->vectors, p->components * d), LG_ARRAY(p->variance, p->variances)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory to standardise %u features", p->inputs);
    if (measure(x, n, p->inputs, p) != LG_OK)
        return lg_fail(error, LG_NOT_FINITE, "the squares of a feature are too large for a double");
    return p->components > 0 ? fit_components(context, x, n, p, error) : LG_OK;
}

lg_status lg_pca_fit(const lg_context *context, const double *x, size_t n, uint32_t d, uint32_t components,
                     lg_pca *out, lg_error *error) {
    if (out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the place for the result is NULL");
    LG_TRY(lg_check_table(x, n, d, error));
    const size_t small = n < d ? n : d;
    if (components > small)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%u principal components asked for; %zu rows of %u features have at most %zu",
                       components, n, d, small);
    if (components > 0 && small > LG_EIGEN_MAX)
        return lg_fail(
            error, LG_INVALID_ARGUMENT,
            "principal components need at most %d rows or %d features; here are %zu rows and %u features",
            LG_EIGEN_MAX, LG_EIGEN_MAX, n, d);
    LG_CLEAN(lg_pca_destroy) lg_pca p = {.inputs = d, .components = components, .context = context};
    p.variances = components > 0 ? (uint32_t)small : 0;
    LG_TRY(fit_into(context, x, n, &p, error));
    return LG_GIVE(out, p);
}

void lg_pca_destroy(lg_pca *pca) {
    if (pca == NULL) return;
    LG_FREE_ALL(pca->context, pca->mean, pca->scale, pca->vectors, pca->variance);
    *pca = (lg_pca){0};
}

uint32_t lg_pca_outputs(const lg_pca *pca) {
    return pca->components > 0 ? pca->components : pca->inputs;
}

void lg_pca_eval(const lg_pca *pca, const double *x, size_t n, double *p, double *work) {
    const size_t d = pca->inputs, k = pca->components;
    for (size_t i = 0; i < n; i++) {
        if (k == 0) {
            standardise(pca, x + i * d, p + i * d);
            continue;
        }
        double *row = p + i * k;
        standardise(pca, x + i * d, work);
        memset(row, 0, k * sizeof *row);
        for (size_t a = 0; a < d; a++)
            for (size_t j = 0; j < k; j++) row[j] += work[a] * pca->vectors[a * k + j];
    }
}

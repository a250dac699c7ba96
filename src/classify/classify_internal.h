/* Shared by the files of src/classify. */
#ifndef LG_CLASSIFY_INTERNAL_H
#define LG_CLASSIFY_INTERNAL_H

#include "core/core.h"
#include "liegrad/classify.h"

/* Largest number of features. */
#define LG_FEATURES_MAX (UINT32_C(1) << 20)
/* Largest symmetric matrix whose eigenvectors are computed: with LAPACK's workspace 2 GiB. */
#define LG_EIGEN_MAX   8192
#define LG_CLASSES_MAX (UINT32_C(1) << 16)

/* Doubles of work, integers behind them, for lg_eigen of n x n. */
size_t lg_eigen_work(size_t n);
/* Symmetric a (n, n), of which the upper triangle of the row-major matrix is read, becomes the eigenvectors,
 * one a row; values (n) rising. */
lg_status lg_eigen(double *a, size_t n, double *values, double *work);

/* sum a_i b_i in eight interleaved sums: the same bits whatever the alignment. */
static inline double lg_dot(const double *a, const double *b, size_t n) {
    double lane[8] = {0};
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (size_t j = 0; j < 8; j++) lane[j] += a[i + j] * b[i + j];
    for (size_t j = 0; i < n; i++, j++) lane[j] += a[i] * b[i];
    return ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}
static inline double lg_sum_of(const double *a, size_t n) {
    double lane[8] = {0};
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (size_t j = 0; j < 8; j++) lane[j] += a[i + j];
    for (size_t j = 0; i < n; i++, j++) lane[j] += a[i];
    return ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}

/* What every fit asks of its table: sizes that LAPACK counts, finite numbers; labels below `classes`, of
 * which at least two occur. counts (classes) receives how often each does. */
lg_status lg_check_table(const double *x, size_t n, uint32_t d, lg_error *error);
lg_status lg_check_labels(const uint32_t *label, size_t n, uint32_t classes, size_t *counts, lg_error *error);

/* How many features its kind, channels and length make. */
uint64_t lg_features_count(const lg_features *features);

/* Row r of a table is row chosen[r] of another (NULL: r). */
static inline size_t lg_chosen_row(const uint32_t *chosen, size_t r) {
    return chosen != NULL ? chosen[r] : r;
}

#endif

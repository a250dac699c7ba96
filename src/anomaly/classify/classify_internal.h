/* Shared by the files of src/anomaly/classify. */
#ifndef LG_CLASSIFY_INTERNAL_H
#define LG_CLASSIFY_INTERNAL_H

#include "core/core.h"
#include "liegrad/classify.h"

/* Largest number of features. */
#define LG_FEATURES_MAX (UINT32_C(1) << 20)
/* Largest symmetric matrix whose eigenvectors are computed: with LAPACK's workspace 2 GiB. */
#define LG_EIGEN_MAX   8192
#define LG_CLASSES_MAX (UINT32_C(1) << 16)

/* Work of lg_eigen for an n x n matrix, in doubles; integers follow the doubles. */
size_t lg_eigen_work(size_t n);
/* Replaces a symmetric a (n, n), row-major, by its eigenvectors, one a row; values (n) rising. Only the upper
 * triangle of a is read. */
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

/* Checks for every fit's table: sizes within LAPACK's integers, finite numbers, labels below `classes`, at
 * least two classes that occur. counts (classes) becomes the number of rows of each class. */
lg_status lg_check_table(const double *x, size_t n, uint32_t d, lg_error *error);
lg_status lg_check_labels(const uint32_t *label, size_t n, uint32_t classes, size_t *counts, lg_error *error);

/* The number of features for kind, channels and length. */
uint64_t lg_features_count(const lg_features *features);

/* gradient (channels, length) = sum_i cotangent[i] d feature_i/dx at the window for which
 * lg_features_compute was called last with this `work`. */
void lg_features_reverse(const lg_features *features, const double *cotangent, double *gradient,
                         double *work);

/* The cotangent of x (d) from the cotangent p (k); the arrays may not overlap. */
void lg_pca_reverse(const lg_pca *pca, const double *p, double *x);

/* b_c + w_c.x: one number for two classes, else one for each class. */
void lg_logistic_scores(const lg_logistic *model, const double *x, double *score);

/* Decisions of all pairs at x. kernel (vectors) receives K(x_v, x). For a pair in which one class has no
 * vectors the decision is 1 for the other class; without any vectors it is 0. */
void lg_svm_decisions(const lg_svm *svm, const double *x, double *decision, double *kernel);
/* gradient (d) of decision number `pair`, with the kernel that lg_svm_decisions wrote. */
void lg_svm_decision_gradient(const lg_svm *svm, const double *x, const double *kernel, size_t pair,
                              double *gradient);

/* Row r of a table is row chosen[r] of another (NULL: r). */
static inline size_t lg_chosen_row(const uint32_t *chosen, size_t r) {
    return chosen != NULL ? chosen[r] : r;
}

#endif

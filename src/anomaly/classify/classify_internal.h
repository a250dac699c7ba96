/* Functions shared by the source files of src/anomaly/classify. */
#ifndef LG_CLASSIFY_INTERNAL_H
#define LG_CLASSIFY_INTERNAL_H

#include "core/clean.h"
#include "kernels/kernels.h"
#include "liegrad/classify.h"

/* Largest number of features per window. */
#define LG_FEATURES_MAX (UINT32_C(1) << 20)
/* Largest min(rows, features) of which principal components are computed. With LAPACK's workspace it takes
 * some 4 GiB. */
#define LG_EIGEN_MAX   8192
#define LG_CLASSES_MAX (UINT32_C(1) << 16)

/* What the methods' models are: rows of weights in `logistic`, or support vectors in `svm`. */
static inline bool lg_method_is_linear(lg_classifier_method method) {
    return method == LG_METHOD_LOGISTIC || method == LG_METHOD_RIDGE;
}
static inline bool lg_method_is_svm(lg_classifier_method method) {
    return method == LG_METHOD_SVM_LINEAR || method == LG_METHOD_SVM_RBF;
}

static inline double lg_dot(const double *a, const double *b, size_t n) {
    return lg_kernels_for(LG_F64)->dot(n, a, b);
}

/* Checks of fits. lg_check_c: C is positive, and there are 2 to LG_CLASSES_MAX classes. lg_check_table: the
 * sizes fit LAPACK's integers and all numbers are finite. lg_check_labels: labels are below `classes`, and at
 * least `least` classes occur, one or two; counts (classes; may be NULL) becomes the number of rows of each
 * class. */
lg_status lg_check_c(double c, uint32_t classes, lg_error *error);
lg_status lg_check_table(const double *x, size_t n, uint32_t d, lg_error *error);
lg_status lg_check_labels(const uint32_t *label, size_t n, uint32_t classes, uint32_t least, size_t *counts,
                          lg_error *error);

/* Means (d) of the columns of a table (n, d). */
void lg_column_means(const double *x, size_t n, size_t d, double *mean);

/* Copies a tree into depth-first order, left before right. A node with cut[i] becomes a leaf, and the nodes
 * below it are dropped. cut = NULL copies all nodes. */
lg_status lg_tree_compact(const lg_context *context, const lg_tree *tree, const bool *cut, lg_tree *out);

/* Number of features for the kind, channels and window length in *features. */
uint64_t lg_features_count(const lg_features *features);

/* Makes classifier->scores, the plan of its program. */
lg_status lg_classifier_ready(const lg_context *context, lg_classifier *classifier, lg_error *error);

/* Index in the table of the r-th chosen row. chosen = NULL means that all rows are chosen. */
static inline size_t lg_chosen_row(const uint32_t *chosen, size_t r) {
    return chosen != NULL ? chosen[r] : r;
}

#endif

/* Features of windows of sensor data, and classical classifiers on them. Library `liegrad_classify` (LAPACK,
 * libsvm).
 *
 * A classifier is a chain that is fitted on the training part only:
 *   window -> features (d) -> standardise -> [principal components (k)] -> logistic | tree | svm
 * Matrices are row-major; each row is a window. Functions that can fail explain the failure in `error`, which
 * may be NULL.
 */
#ifndef LIEGRAD_CLASSIFY_H
#define LIEGRAD_CLASSIFY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/series.h"

LG_BEGIN_DECLS

/* ---- features (src/anomaly/classify/features.c; a file a kind) ---- */

typedef enum lg_feature_kind {
    LG_FEATURES_RAW,      /* the window as it is, channel by channel: m length numbers */
    LG_FEATURES_STD,      /* standard deviation of each channel: m */
    LG_FEATURES_COV,      /* upper triangle, row by row, of the symmetric square root of the covariance of the
                          * scaled channels: m (m + 1)/2. Denominator `length`, as for STD. */
    LG_FEATURES_SPECTRUM, /* ln(P + LG_FEATURES_FLOOR) with the power P of each channel, less its mean and
                           * scaled, in each of `bands` bands of frequency (liegrad/spectrum.h): m bands
                           * numbers. 8 bands, or as many as the window has; of 4 samples at least. */
    LG_FEATURES_BASELINE  /* standard deviations of moment and acceleration in each of `segments` parts of the
                          * window, and the regression line of the moment on the acceleration over the parts:
                          * intercept and slope of each pair, 2 pairs numbers. Slope 0 when the accelerations
                          * of the parts are equal. */
} lg_feature_kind;
#define LG_FEATURE_KIND_COUNT 5
#define LG_FEATURES_FLOOR     1e-6 /* SPECTRUM: a thousandth of the scale, squared */
LG_API const char *lg_feature_kind_name(lg_feature_kind kind);                  /* "raw", "std", ... */
LG_API lg_status lg_feature_kind_parse(const char *name, lg_feature_kind *out); /* LG_NOT_FOUND */

/* What is computed from a window. */
typedef struct lg_features {
    lg_feature_kind kind;
    uint32_t channels, length; /* of the windows */
    uint32_t selected;         /* m: channels used */
    uint32_t *select;          /* (m) rising */
    uint32_t segments;         /* BASELINE: 10 */
    uint32_t pairs;            /* BASELINE: (acceleration, moment) channels */
    uint32_t *pair;            /* (pairs, 2) */
    uint32_t bands;            /* SPECTRUM */
    lg_spectrum spectrum;      /* SPECTRUM */
    double *scale;             /* (channels): all but RAW and STD divide channels by it */
    uint32_t count;            /* d */
    const lg_context *context; /* whose memory the arrays are in */
} lg_features;
/* `directions_x` selects the channels of the x-direction: names that end in "_x", or, in a set without names,
 * channels 0, 2, 4, ... BASELINE pairs acc_lower with the moment of the same ending (acc_lower_x, moment_x);
 * without names the pairs are channels 0 and 4, and 1 and 5. `scaler` is fitted on the training part; NULL:
 * scale 1. Errors: LG_INVALID_ARGUMENT (no channel of the x-direction; BASELINE without a pair, or with fewer
 * samples than segments; SPECTRUM with fewer than 4 samples; more than 2^20 features), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_features_create(const lg_context *context, lg_feature_kind kind, bool directions_x,
                                    const lg_series *series, uint32_t length, const lg_scaler *scaler,
                                    lg_features *out, lg_error *error);
LG_API void lg_features_destroy(lg_features *features);
/* Bytes of work for lg_features_compute. */
LG_API size_t lg_features_work_size(const lg_features *features);
/* x (channels, length) -> out (d). A constant channel, or a single sample, has standard deviation and
 * covariance exactly 0; a constant channel has the power 0. The root of a covariance comes from the singular
 * values of the centred, scaled window; its error is a few eps = 2^-52 times its norm. Errors:
 * LG_NO_CONVERGENCE (of these singular values), LG_NOT_FINITE; out is then undefined. */
LG_API lg_status lg_features_compute(const lg_features *features, const float *x, double *out, double *work);
/* Writes the name of feature `index` and returns its length as snprintf does:
 *   "raw acc_lower_x 17" (the sample), "std acc_lower_x", "cov acc_lower_x moment_x",
 *   "band 0.0117-0.0742 acc_lower_x" (its frequencies in cycles a sample),
 *   "intercept moment_x acc_lower_x", "slope moment_x acc_lower_x"
 * A channel without a name is written as its number. `series` may be NULL. */
LG_API int lg_features_name(const lg_features *features, const lg_series *series, uint32_t index, char *text,
                            size_t size);
/* The features of all windows: out (windows->count, d). The bits do not depend on `threads` >= 1. The error
 * names the window; out is undefined then. */
LG_API lg_status lg_features_table(const lg_context *context, const lg_features *features,
                                   const lg_series *series, const lg_windows *windows, int threads,
                                   double *out, lg_error *error);

/* ---- principal components (pca.c) ---- */

/* z = (x - mean)/scale, p = z W. The columns of W (d, k) are eigenvectors of Z^T Z/n by falling eigenvalue.
 * The largest component of each is positive; of components equal to 1e-9 it is the first. k = 0 only
 * standardises: p = z. */
typedef struct lg_pca {
    uint32_t inputs, components; /* d, k */
    double *mean, *scale;        /* (d); a constant feature has scale 1 */
    double *vectors;             /* (d, k) */
    double *variance;            /* (variances) all eigenvalues, falling; over their sum: explained ratios */
    uint32_t variances;          /* min(n, d); 0 for k = 0, where they are not computed */
    const lg_context *context;   /* whose memory the arrays are in */
} lg_pca;
/* x (n, d); components 0..min(n, d). For components > 0 the smaller of n and d must be at most 8192. For d >
 * n the eigenvectors come from the Gram matrix Z Z^T. Errors: LG_INVALID_ARGUMENT, LG_NOT_FINITE,
 * LG_NO_CONVERGENCE, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_pca_fit(const lg_context *context, const double *x, size_t n, uint32_t d,
                            uint32_t components, lg_pca *out, lg_error *error);
LG_API void lg_pca_destroy(lg_pca *pca);
/* Width of p: k, or d for k = 0. */
LG_API uint32_t lg_pca_outputs(const lg_pca *pca);
/* x (n, d) -> p (n, k); work: d doubles. */
LG_API void lg_pca_eval(const lg_pca *pca, const double *x, size_t n, double *p, double *work);

/* ---- logistic regression (logistic.c) ---- */

/* Scores b_c + w_c.x. Two classes have one row, the logit of class 1; K > 2 classes have K rows, softmax. */
typedef struct lg_logistic {
    uint32_t inputs, classes;
    double *weight;    /* (rows, d) */
    double *intercept; /* (rows) */
    uint32_t iterations;
    const lg_context *context; /* whose memory the arrays are in */
} lg_logistic;
/* Minimises C sum_i -log p(label_i | x_i) + |w|^2/2 by Newton's method with backtracking; intercepts are not
 * penalised. x (n, d), C > 0. For d >= n it works in the span of the rows, which contains the minimiser. With
 * more than two classes the intercepts, and the weights of each feature, add up to 0. A class that does not
 * occur gets weights 0 and intercept -10^4, so its probability is 0. Errors: LG_INVALID_ARGUMENT (fewer than
 * two classes, a label out of range), LG_NO_CONVERGENCE, LG_NOT_FINITE, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_logistic_fit(const lg_context *context, const double *x, const uint32_t *label, size_t n,
                                 uint32_t d, uint32_t classes, double c, lg_logistic *out, lg_error *error);
LG_API void lg_logistic_destroy(lg_logistic *model);
/* x (n, d) -> probability (n, classes) */
LG_API void lg_logistic_predict(const lg_logistic *model, const double *x, size_t n, double *probability);

/* ---- decision trees (tree.c): CART (Breiman et al. 1984) ---- */

typedef enum lg_criterion { LG_GINI, LG_ENTROPY } lg_criterion; /* entropy in bits */
#define LG_CRITERION_COUNT 2
LG_API const char *lg_criterion_name(lg_criterion criterion);             /* "gini", "entropy" */
LG_API lg_status lg_criterion_parse(const char *name, lg_criterion *out); /* LG_NOT_FOUND */

typedef struct lg_tree_options {
    size_t size;                /* sizeof(lg_tree_options) */
    lg_criterion criterion;     /* Gini */
    uint32_t max_depth;         /* 0: no limit */
    uint32_t min_samples_split; /* 2 */
    uint32_t min_samples_leaf;  /* 1 */
    double ccp_alpha;           /* 0: no pruning; > 0: cost-complexity pruning with this alpha */
} lg_tree_options;
LG_API void lg_tree_options_init(lg_tree_options *options);

typedef struct lg_tree_node {
    uint32_t feature, left, right; /* left == 0: a leaf. Rows with x[feature] <= threshold go left */
    double threshold, impurity;
    uint32_t samples;
} lg_tree_node;
typedef struct lg_tree {
    uint32_t inputs, classes, count; /* nodes; node 0 is the root, children after their parents */
    lg_criterion criterion;
    lg_tree_node *node;        /* (count) */
    uint32_t *counts;          /* (count, classes): training samples of each class */
    const lg_context *context; /* whose memory the arrays are in */
} lg_tree;
/* Grows a tree from x (n, d) and label (n). A threshold lies half-way between neighbouring distinct values;
 * it is the lower value when half-way rounds to the upper one. The best split has the largest decrease of the
 * impurity; among equal ones (as computed) the lower feature wins, then the lower threshold. An impure node
 * is split whenever options and values allow it, even when the split gains nothing: "exclusive or" needs such
 * a split. Nodes are in depth-first order, left before right. Columns are sorted once; a level then costs
 * O(d n). Memory: 16 d n bytes. Errors: LG_INVALID_ARGUMENT (n, d or classes 0, n > 2^29, a label
 * out of range, min_samples_split < 2, min_samples_leaf < 1, ccp_alpha < 0), LG_NOT_FINITE, LG_OUT_OF_MEMORY,
 * LG_CANCELLED. */
LG_API lg_status lg_tree_fit(const lg_context *context, const lg_tree_options *options, const double *x,
                             const uint32_t *label, size_t n, uint32_t d, uint32_t classes, lg_tree *out,
                             lg_error *error);
LG_API void lg_tree_destroy(lg_tree *tree);
/* 0 for a single leaf. Samples of children must add up to their parent's. */
LG_API uint32_t lg_tree_depth(const lg_tree *tree);
LG_API uint32_t lg_tree_leaf(const lg_tree *tree, const double *x); /* index of the leaf of x (d) */
/* Class fractions of the leaf: probability (n, classes). */
LG_API void lg_tree_predict(const lg_tree *tree, const double *x, size_t n, double *probability);
/* Minimal cost-complexity pruning with R_alpha(T) = sum over leaves of (n_t/n) impurity_t + alpha leaves. The
 * sequence of trees goes from the whole tree (alpha 0) to the root, and each step removes one branch. Tree i
 * minimises R_a for alpha_i <= a < alpha_{i+1}. Consecutive equal alphas are branches that go together. */
typedef struct lg_pruning_step {
    double alpha, impurity; /* impurity: sum over leaves of (n_t/n) impurity_t */
    uint32_t nodes, depth;
} lg_pruning_step;
/* Writes the first `room` steps of the sequence; *count becomes the length of the whole sequence. steps may
 * be NULL for room 0. The work is O(nodes (depth + log nodes)). Errors: LG_INVALID_ARGUMENT (an empty tree),
 * LG_OUT_OF_MEMORY. */
LG_API lg_status lg_tree_pruning_path(const lg_context *context, const lg_tree *tree, size_t room,
                                      lg_pruning_step *steps, size_t *count);
/* The smallest subtree that minimises R_alpha, up to rounding: an alpha of the path gives the tree of its
 * last step. alpha 0 removes splits that gain nothing; infinity leaves the root. *out must not be *tree.
 * LG_INVALID_ARGUMENT (alpha < 0 or NaN, an empty tree), LG_OUT_OF_MEMORY. */
LG_API lg_status lg_tree_prune(const lg_context *context, const lg_tree *tree, double alpha, lg_tree *out);

/* ---- support vectors (svm.c): libsvm trains, this library evaluates ---- */

typedef enum lg_kernel { LG_KERNEL_LINEAR, LG_KERNEL_RBF } lg_kernel; /* x.y, exp(-gamma |x - y|^2) */

/* One against one: pair (i, j), i < j, has the decision sum_v coefficient K(x_v, x) - rho, positive for class
 * i. */
typedef struct lg_svm {
    lg_kernel kernel;
    double gamma, c;
    uint32_t inputs, classes, vectors;
    uint32_t *vectors_of;      /* (classes); vectors are grouped by class */
    double *vector;            /* (vectors, d) */
    double *coefficient;       /* (classes - 1, vectors), libsvm's order */
    double *rho;               /* (classes (classes - 1)/2) */
    const lg_context *context; /* whose memory the arrays are in */
} lg_svm;
/* C-SVC with hinge loss, C > 0. gamma <= 0 means 1/(d var x), with the variance over all numbers of x; 1 when
 * they are all equal. A class that does not occur has no vectors and is never the answer. Standardise first:
 * libsvm forms |x - y|^2 from squares and a product. Sets libsvm's print function to one that prints nothing.
 * Errors: those of lg_logistic_fit. */
LG_API lg_status lg_svm_fit(const lg_context *context, lg_kernel kernel, double c, double gamma,
                            const double *x, const uint32_t *label, size_t n, uint32_t d, uint32_t classes,
                            lg_svm *out, lg_error *error);
LG_API void lg_svm_destroy(lg_svm *svm);
/* The decision w.x + b of a linear kernel with two classes: w (d), b; positive for class 1. Errors:
 * LG_UNSUPPORTED for another kernel or more classes. */
LG_API lg_status lg_svm_plane(const lg_svm *svm, double *w, double *b);
/* x (n, d) -> score (n, classes); the answer is the class with the largest score. Two classes: -decision and
 * +decision. More classes: the number of votes plus a term within 1/3 from the decisions, which orders
 * classes of equal votes. libsvm answers with the first class of the most votes; if its score is not the
 * largest, it is raised to the next number above the largest. work: lg_svm_work_size bytes. */
LG_API size_t lg_svm_work_size(const lg_svm *svm);
LG_API void lg_svm_predict(const lg_svm *svm, const double *x, size_t n, double *score, double *work);

/* ---- the chain (classifier.c) ---- */

typedef enum lg_method {
    LG_METHOD_LOGISTIC,
    LG_METHOD_TREE,
    LG_METHOD_SVM_LINEAR,
    LG_METHOD_SVM_RBF
} lg_method;
#define LG_METHOD_COUNT 4
LG_API const char *lg_method_name(lg_method method); /* "logistic", "tree", "svm-linear", "svm-rbf" */
LG_API lg_status lg_method_parse(const char *name, lg_method *out); /* LG_NOT_FOUND */

typedef struct lg_method_options {
    size_t size;         /* sizeof(lg_method_options) */
    lg_method method;    /* logistic */
    uint32_t components; /* 0: no principal components */
    double c;            /* 1 */
    double gamma;        /* 0: 1/(d var) */
    lg_tree_options tree;
} lg_method_options;
LG_API void lg_method_options_init(lg_method_options *options);

typedef struct lg_classifier {
    lg_method method;
    uint32_t classes;
    lg_features features;
    lg_pca pca;
    lg_logistic logistic; /* of these models only the one of `method` is used; the others are zeroed */
    lg_tree tree;
    lg_svm svm;
} lg_classifier;

/* Fits pca and model on rows `chosen` (count; NULL: all) of table x (rows, d). `out->features` does not
 * change. */
LG_API lg_status lg_classifier_fit(const lg_context *context, const lg_method_options *options,
                                   const double *x, const uint32_t *label, const uint32_t *chosen,
                                   size_t count, uint32_t d, uint32_t classes, lg_classifier *out,
                                   lg_error *error);
LG_API void lg_classifier_destroy(lg_classifier *classifier);
/* Bytes of work for the two functions below. */
LG_API size_t lg_classifier_work_size(const lg_classifier *classifier);
/* Features f (d) -> score (classes): probabilities; for svm as lg_svm_predict. */
LG_API void lg_classifier_score(const lg_classifier *classifier, const double *f, double *score,
                                double *work);
/* Window x (channels, length) -> score. LG_NO_CONVERGENCE as lg_features_compute. */
LG_API lg_status lg_classifier_window(const lg_classifier *classifier, const float *x, double *score,
                                      double *work);
#define LG_NULL_EIGENVALUE 5.684341886080802e-14 /* 2^-44 */
/* The numbers that determine the scores, and their Jacobian:
 *   logistic  logits: 1 for two classes (of class 1), else K
 *   tree      class fractions (K); Jacobian 0
 *   svm       decisions of the pairs (i, j), i < j: K (K - 1)/2 numbers, positive for i. For K > 2 the
 *             decision is 1 if only i has vectors, -1 if only j has vectors, 0 if neither has
 * x (channels, length) -> y (lg_classifier_outputs), jacobian (outputs, channels length) or NULL. Derivatives
 * with respect to channels without features are 0, and so are those of a standard deviation of 0, of the root
 * of a covariance within its null space, and of a baseline slope when the accelerations are equal. The null
 * space belongs to eigenvalues (squares of singular values of the window) of at most LG_NULL_EIGENVALUE times
 * the largest. Relative errors of the root's derivatives are a few eps = 2^-52 times the ratio of the largest
 * singular value to the smallest one outside the null space. work: lg_classifier_jacobian_work_size bytes.
 * Errors: those of lg_classifier_window; y and jacobian are untouched then. */
LG_API size_t lg_classifier_outputs(const lg_classifier *classifier);
LG_API size_t lg_classifier_jacobian_work_size(const lg_classifier *classifier);
LG_API lg_status lg_classifier_decisions(const lg_classifier *classifier, const float *x, double *y,
                                         double *jacobian, double *work);
/* Arrays and texts below "classifier/". The reader checks sizes and values: LG_FORMAT, LG_NOT_FINITE. On
 * failure *out is zeroed. */
LG_API lg_status lg_classifier_save(const lg_classifier *classifier, const lg_archive_writer *writer,
                                    lg_error *error);
LG_API lg_status lg_classifier_load(const lg_context *context, const lg_archive_reader *reader,
                                    lg_classifier *out, lg_error *error);

/* ---- grid search (grid_search.c) by cross-validation on the training part ---- */

/* Tries every options[i] (count) with `folds` stratified folds of rows `chosen` (rows; NULL: all of x).
 * accuracy (count) becomes the mean over the folds, *best the first option of the highest accuracy. `unit`
 * (NULL: none) has a number for every row of x, like label. Rows with equal numbers, such as the windows of a
 * sea state, fall into one fold (lg_folds, liegrad/series.h). Otherwise a setting could win because it
 * remembers neighbours of the rows that test it. The number of folds is limited to the number of rows, or
 * units, of the rarest class that occurs. With fewer than two folds the accuracy is that on the training
 * rows. A fold with fewer rows than components uses as many components as it has rows. Options that do not
 * converge have accuracy NaN and are
 * not chosen. Errors: LG_NO_CONVERGENCE (no options converge), those of lg_classifier_fit. The result does
 * not depend on `threads` >= 1. */
LG_API lg_status lg_grid_search(const lg_context *context, const lg_method_options *options, size_t count,
                                uint32_t folds, const double *x, const uint32_t *label, const uint32_t *unit,
                                const uint32_t *chosen, size_t rows, uint32_t d, uint32_t classes,
                                int threads, double *accuracy, size_t *best, lg_error *error);

LG_END_DECLS

#endif

/* Features of windows of sensor data, and classical classifiers on them: logistic regression, decision trees
 * and support vector machines, their combination with features and principal components, and grid search. The
 * functions are in the library liegrad_classify, which needs LAPACK and libsvm. The guide is
 * docs/detectors.md.
 *
 * A classifier is a chain whose stages are all fitted on the training part only:
 *   window -> features (d) -> standardisation -> [principal components (k)] -> logistic | tree | svm | ridge
 *
 *   lg_classifier classifier = {0};
 *   lg_features *f = &classifier.features;
 *   lg_features_create(NULL, LG_FEATURES_SPECTRUM, false, &series, length, &scaler, f, &error);
 *   lg_features_table(NULL, f, &series, &windows, 1, table, &error);
 *   lg_classifier_fit(NULL, &options, table, label, chosen, count, f->count, classes, &classifier, &error);
 *
 * Matrices are row-major; each row belongs to a window. Functions with an `error` write a sentence about a
 * failure to it; it may be NULL. Structures that own memory are freed by their _destroy function, which
 * accepts NULL and zeroed structures.
 */
#ifndef LIEGRAD_CLASSIFY_H
#define LIEGRAD_CLASSIFY_H

#include "liegrad/series.h"

LG_BEGIN_DECLS

/* ---- features ---- */

/* The features of a window of m selected channels, with their number d. docs/detectors.md ("Features") has
 * the formulas; denominators are `length`, channels are scaled except for RAW, STD and LEVELS. */
typedef enum lg_feature_kind {
    LG_FEATURES_RAW,      /* samples, channel by channel: m length */
    LG_FEATURES_STD,      /* standard deviation of each channel: m */
    LG_FEATURES_COV,      /* upper triangle of the root of the covariance matrix: m (m + 1)/2 */
    LG_FEATURES_SPECTRUM, /* ln(P + LG_FEATURES_FLOOR) of the power P in each band (lg_spectrum): m bands */
    /* Mean, minimum, maximum and slope of each channel, for slow plants: 4 m. The slope is that of the
     * least-squares line over time, in units of the signal per second (without a rate: per sample); 0 for
     * windows of one sample. The derivative of a minimum or maximum goes to the first of equal samples. */
    LG_FEATURES_LEVELS,
    LG_FEATURES_BASELINE, /* regression lines of moments on accelerations: 2 pairs */
    LG_FEATURES_ROCKET    /* random convolutions (lg_rocket, lg_rocket_fit): d numbers in [0, 1] */
} lg_feature_kind;
#define LG_FEATURE_KIND_COUNT 7
#define LG_FEATURES_FLOOR     1e-6 /* for SPECTRUM: the square of a thousandth of the scale */
/* "raw", "std", "cov", "spectrum", "levels", "baseline" or "rocket"; "unknown" for any other value. */
LG_API const char *lg_feature_kind_name(lg_feature_kind kind);

/* Random convolution features, after MiniRocket (Dempster, Schmidt, Webb, KDD 2021; its version for several
 * channels draws channels as here). Kernels have nine taps: 84 kernels have weights -1, and 2 at three taps,
 * and are numbered by the choices of three in lexicographic order; 12 kernels have nine weights 1. With
 * z = (x - mean)/scale, which is zero outside of the window, a convolution is
 *   y_t = sum over its channels c of s_c sum_{j = 0..8} w_j z_c,t + (j - 4) dilation,   s_c = 1 or -1,
 * and its features are the parts of its samples t with y_t > bias r. For the 84 kernels r is the root mean
 * square of z over the window and the selected channels, for the 12 kernels it is 1. All samples count if the
 * convolution is `padded`, otherwise the samples where no tap lies outside of the window. z and y are
 * computed in float, by sums in a fixed order, so the counts are the same on all machines.
 *   MiniRocket has neither the 12 kernels, nor signs, nor r. Its weights add up to 0, so it sees no constant
 * offset of a channel, and sums alone do not compare channels. Thresholds in units of r hold for windows of
 * any amplitude, such as other sea states; the 12 kernels see the amplitude, too. */
typedef struct lg_rocket_convolution {
    uint32_t kernel, dilation, padded; /* 0..95; 1..(length - 1)/8; 0 or 1 */
    uint32_t channels, features;       /* how many entries of `channel` and `bias` belong to this one */
} lg_rocket_convolution;
typedef struct lg_rocket {
    uint32_t count, listed;             /* numbers of convolutions and of entries of `channel` */
    lg_rocket_convolution *convolution; /* (count) by rising dilation */
    /* (listed) of each convolution in turn: 2 i for channel select[i], 2 i + 1 if it is subtracted. */
    uint32_t *channel;
    float *bias;  /* (d) */
    double *mean; /* (channels) */
} lg_rocket;

/* A description of the features that are computed from a window. */
typedef struct lg_features {
    lg_feature_kind kind;
    uint32_t channels, length; /* channels and samples of the windows */
    uint32_t selected;         /* m: number of channels that are used */
    uint32_t *select;          /* (m) these channels, in rising order */
    uint32_t segments;         /* BASELINE: number of parts of the window, 10 */
    uint32_t pairs;            /* BASELINE: number of pairs (acceleration, moment) */
    uint32_t *pair;            /* (pairs, 2) channels of each pair */
    uint32_t bands;            /* SPECTRUM: number of frequency bands */
    lg_spectrum spectrum;      /* SPECTRUM: the plan for `bands` */
    lg_rocket rocket;          /* ROCKET */
    double *scale;             /* (channels) divisor of each channel; not used by RAW, STD and LEVELS */
    double rate;               /* LEVELS: samples per second; 1 if the series has no rate */
    lg_plan *plan;             /* of the features of a window */
    uint32_t count;            /* d: number of features */
    const lg_context *context; /* in whose memory the arrays are */
} lg_features;
/* Makes features for windows of `length` samples with the channels of `series`. With `directions_x` only
 * channels of the x-direction are used: those whose names end in "_x", or channels 0, 2, 4, ... of a set
 * without names. BASELINE pairs each acc_lower with the moment of the same ending, such as acc_lower_x and
 * moment_x; without names the pairs are channels 0 and 4, and 1 and 5. `scaler` gives the scale of each
 * channel and must be fitted on the training part; NULL stands for scale 1. Errors: LG_INVALID_ARGUMENT (no
 * channel of the x-direction, BASELINE without a pair or with fewer samples than segments, SPECTRUM with
 * fewer than 4 samples, scales that do not fit the channels, more than 2^20 features). */
LG_API lg_status lg_features_create(const lg_context *context, lg_feature_kind kind, bool directions_x,
                                    const lg_series *series, uint32_t length, const lg_scaler *scaler,
                                    lg_features *out, lg_error *error);
LG_API void lg_features_destroy(lg_features *features);

/* The comments give the values of lg_rocket_options_init. */
typedef struct lg_rocket_options {
    size_t size;       /* sizeof(lg_rocket_options) */
    uint32_t features; /* default 10000, at least 96; rounded down to a multiple of 96 */
    bool directions_x; /* default false; as in lg_features_create */
    uint64_t seed;     /* default 1 */
} lg_rocket_options;
LG_API void lg_rocket_options_init(lg_rocket_options *options);
/* Makes random convolution features for windows like those with the indices chosen (count), or like the first
 * `count` windows if `chosen` is NULL. `scaler`, of the same windows, gives means and scales. Every kernel
 * has the same number of features. Its dilations are floor(2^e), with at most 32 values e evenly spaced
 * from 0 to log2((length - 1)/8); padding alternates; the number of channels that are added
 * up is 2^u with a uniform u, at most 9. A bias is a quantile of the convolution of one random training
 * window, at the levels frac((i + 1) phi), phi the golden ratio. Errors: LG_INVALID_ARGUMENT (no windows,
 * fewer than 9 samples, `features` out of range, a scaler that does not fit), LG_NOT_FINITE. */
LG_API lg_status lg_rocket_fit(const lg_context *context, const lg_rocket_options *options,
                               const lg_series *series, const lg_windows *windows, const uint32_t *chosen,
                               size_t count, const lg_scaler *scaler, lg_features *out, lg_error *error);
/* Leaves out all random convolution features but those with the indices keep (count), in rising order.
 * Errors, in which case *features is unchanged: LG_UNSUPPORTED (another kind), LG_INVALID_ARGUMENT. */
LG_API lg_status lg_rocket_prune(lg_features *features, const uint32_t *keep, size_t count, lg_error *error);
/* Bytes of work memory for lg_features_compute. */
LG_API size_t lg_features_work_size(const lg_features *features);
/* Computes out (d) from the window x (channels, length). For a constant channel and for windows of one
 * sample, standard deviation, covariance and power are exactly 0. The root of a covariance is computed from
 * the singular values of the centred and scaled window; its error is a few eps = 2^-52 times its norm.
 * Errors, out is then undefined: LG_NOT_FINITE. */
LG_API lg_status lg_features_compute(const lg_features *features, const float *x, double *out, double *work);
/* Writes the name of feature `index` and returns its length as snprintf does. The names are
 *   "raw acc_lower_x 17" (17 is the index of the sample), "std acc_lower_x", "cov acc_lower_x moment_x",
 *   "band 0.0117-0.0742 acc_lower_x" (the frequencies of the band in cycles per sample),
 *   "mean acc_lower_x", "min acc_lower_x", "max acc_lower_x", "slope acc_lower_x",
 *   "intercept moment_x acc_lower_x", "slope moment_x acc_lower_x"
 * The channels are named as in `series`. A channel without a name is written as its number;
 * `series` may be NULL. */
LG_API int lg_features_name(const lg_features *features, const lg_series *series, uint32_t index, char *text,
                            size_t size);
/* Computes the features of all windows: out (windows->count, d). The bits do not depend on `threads` >= 1.
 * Errors, out is then undefined: LG_INVALID_ARGUMENT (windows that do not fit the features), the errors of
 * lg_features_compute (the sentence names the window), LG_CANCELLED. */
LG_API lg_status lg_features_table(const lg_context *context, const lg_features *features,
                                   const lg_series *series, const lg_windows *windows, int threads,
                                   double *out, lg_error *error);

/* ---- principal components ---- */

/* Standardises features, z = (x - mean)/scale, and maps them to k components p = z W. The columns of W (d, k)
 * are the eigenvectors of Z^T Z/n with the largest eigenvalues, in falling order; the rows of Z (n, d) are
 * the z of the training rows. The sign of an eigenvector is chosen so that its entry with the largest
 * absolute value is positive; if several absolute values agree up to 1e-9, the first of these entries
 * decides. For k = 0 there are no components, and p = z. */
typedef struct lg_pca {
    uint32_t inputs, components; /* d, k */
    double *mean, *scale;        /* (d); a constant feature has scale 1 */
    double *vectors;             /* W (d, k) */
    double *variance;   /* (variances) all eigenvalues in falling order; divided by their sum they are the
                                  * explained parts of the variance */
    uint32_t variances; /* min(n, d); 0 for k = 0, where no eigenvalues are computed */
    const lg_context *context; /* in whose memory the arrays are */
} lg_pca;
/* Fits standardisation and components to x (n, d). components (k) is 0..min(n, d). For components > 0 the
 * smaller of n and d must be at most 8192. For d > n they are singular vectors
 * of Z. Errors: LG_INVALID_ARGUMENT, LG_NOT_FINITE, LG_NO_CONVERGENCE. */
LG_API lg_status lg_pca_fit(const lg_context *context, const double *x, size_t n, uint32_t d,
                            uint32_t components, lg_pca *out, lg_error *error);
LG_API void lg_pca_destroy(lg_pca *pca);
/* Number of columns of p: k, or d for k = 0. */
LG_API uint32_t lg_pca_outputs(const lg_pca *pca);
/* Computes p (n, lg_pca_outputs) from x (n, d). `work` has d doubles. */
LG_API void lg_pca_eval(const lg_pca *pca, const double *x, size_t n, double *p, double *work);

/* ---- logistic regression ---- */

/* The scores are b + w.x. For two classes there is one row of weights, and its score is the logit of class 1.
 * For K > 2 classes there are K rows, and the softmax of the scores gives the probabilities. */
typedef struct lg_logistic {
    uint32_t inputs, classes;  /* d, K */
    double *weight;            /* (rows, d) */
    double *intercept;         /* (rows) */
    uint32_t iterations;       /* number of Newton steps of the fit; 0 for lg_ridge_fit */
    double penalty;            /* chosen by lg_ridge_fit; 0 for lg_logistic_fit */
    const lg_context *context; /* in whose memory the arrays are */
} lg_logistic;
/* Fits x (n, d) and label (n): minimises C sum_i -log p(label_i | x_i) + |w|^2/2 by Newton's method with
 * backtracking. The intercepts are not penalised. C > 0. For d >= n the search is restricted to the span of
 * the rows, which contains the minimiser. With more than two classes the intercepts add up to 0, and so do
 * the weights of each feature. A class without rows gets weights 0 and intercept -10^4, so its probability is
 * 0. Errors: LG_INVALID_ARGUMENT (fewer than two classes with rows, a label out of range), LG_NO_CONVERGENCE,
 * LG_NOT_FINITE. */
LG_API lg_status lg_logistic_fit(const lg_context *context, const double *x, const uint32_t *label, size_t n,
                                 uint32_t d, uint32_t classes, double c, lg_logistic *out, lg_error *error);
LG_API void lg_logistic_destroy(lg_logistic *model);

/* ---- ridge regression on classes ---- */

/* Fits b + w.x to 1 for rows of a class and -1 for all others: minimises sum_i |target_i - b - w.x_i|^2 +
 * penalty |w|^2. The penalty is the one of ten, n 10^-3 to n 10^3, for which rows that are left out are
 * predicted with the smallest mean square error (Hastie, Tibshirani, Friedman, The Elements of Statistical
 * Learning, 7.10); b is not penalised. It is meant for many standardised features. The result has the
 * layout of lg_logistic: for two classes one row of weights, whose score is positive for class 1,
 * otherwise a row for each class. x (n, d) is overwritten. The result has the same bits for any number of
 * threads. Memory: some 20 min(n, d)^2 bytes. From 256 rows on, if n <= 5 d, the error is followed downhill
 * from the penalty that suits every fifth row; otherwise every third penalty and the neighbours of the best
 * one are tried. Errors: the errors of lg_logistic_fit. */
LG_API lg_status lg_ridge_fit(const lg_context *context, double *x, const uint32_t *label, size_t n,
                              uint32_t d, uint32_t classes, int threads, lg_logistic *out, lg_error *error);

/* ---- decision trees: CART (Breiman et al. 1984) ---- */

typedef enum lg_tree_criterion {
    LG_GINI,
    LG_ENTROPY
} lg_tree_criterion; /* impurity of a node; entropy in bits */
#define LG_CRITERION_COUNT 2
LG_API const char *lg_tree_criterion_name(lg_tree_criterion criterion); /* "gini", "entropy" */

/* The comments give the values of lg_tree_options_init. */
typedef struct lg_tree_options {
    size_t size;                 /* sizeof(lg_tree_options) */
    lg_tree_criterion criterion; /* default LG_GINI */
    uint32_t max_depth;          /* default 0, which means no limit */
    uint32_t min_samples_split;  /* default 2, >= 2: a node with fewer samples is not split */
    uint32_t min_samples_leaf;   /* default 1, >= 1: each side of a split must have so many samples */
    double ccp_alpha; /* default 0: no pruning; > 0: the tree is pruned with this alpha (lg_tree_prune) */
} lg_tree_options;
LG_API void lg_tree_options_init(lg_tree_options *options);

typedef struct lg_tree_node {
    /* left and right are the indices of the children; left == 0 means that the node is a leaf. Rows with
     * x[feature] <= threshold go to the left. */
    uint32_t feature, left, right;
    double threshold, impurity;
    uint32_t samples; /* number of training samples in the node */
} lg_tree_node;
typedef struct lg_tree {
    /* count is the number of nodes. Node 0 is the root; children follow their parents. */
    uint32_t inputs, classes, count, depth; /* depth: 0 if the root is a leaf */
    lg_tree_criterion criterion;
    lg_tree_node *node;        /* (count) */
    uint32_t *counts;          /* (count, classes) number of training samples of each class in each node */
    const lg_context *context; /* in whose memory the arrays are */
} lg_tree;
/* Grows a tree from x (n, d) and label (n). `options` must not be NULL. A threshold lies half-way between two
 * neighbouring distinct values of a feature; it is the lower value if half-way rounds to the upper one. The
 * best split has the largest decrease of the impurity; of splits with equal computed decreases, the one with
 * the lower feature is taken, then the one with the lower threshold. An impure node is split whenever options
 * and values allow it, even if the split does not decrease the impurity, because "exclusive or" needs such a
 * split. Nodes are in depth-first order, left before right. Columns are sorted once; then each level of the
 * tree costs O(d n). Memory: 16 d n bytes. Errors: LG_INVALID_ARGUMENT (n, d or classes is 0, n >= 2^30,
 * d > 2^20, a label out of range, min_samples_split < 2, min_samples_leaf < 1, ccp_alpha negative or not
 * finite), LG_NOT_FINITE, LG_CANCELLED. */
LG_API lg_status lg_tree_fit(const lg_context *context, const lg_tree_options *options, const double *x,
                             const uint32_t *label, size_t n, uint32_t d, uint32_t classes, lg_tree *out,
                             lg_error *error);
LG_API void lg_tree_destroy(lg_tree *tree);
/* Computes probability (n, classes) of the rows of x (n, d): the fractions of the classes in the leaf of each
 * row. */
LG_API void lg_tree_predict(const lg_tree *tree, const double *x, size_t n, double *probability);
/* Minimal cost-complexity pruning minimises R_alpha(T) = sum over the leaves t of T of (n_t/n) impurity_t,
 * plus alpha times the number of leaves. It gives a sequence of trees from the whole tree (alpha_0 = 0) to
 * the root alone; each step removes one branch. Tree i minimises R_a for alpha_i <= a < alpha_{i+1}. If
 * several consecutive alphas are equal, their branches are removed together. */
typedef struct lg_pruning_step {
    double alpha, impurity; /* impurity: sum over the leaves of (n_t/n) impurity_t */
    uint32_t nodes;         /* of the pruned tree */
} lg_pruning_step;
/* Writes the first steps of the sequence to steps (room); *count becomes the length of the whole sequence.
 * steps may be NULL if room is 0. The work is O(nodes^2). Errors: LG_INVALID_ARGUMENT (an empty tree). */
LG_API lg_status lg_tree_pruning_path(const lg_context *context, const lg_tree *tree, size_t room,
                                      lg_pruning_step *steps, size_t *count);
/* Computes the smallest subtree that minimises R_alpha, up to rounding. For an alpha of the pruning path this
 * is the tree of the last step with this alpha. alpha = 0 removes splits that do not decrease the impurity;
 * alpha = infinity leaves only the root. *out must not be *tree; free it with lg_tree_destroy. Errors:
 * LG_INVALID_ARGUMENT (alpha is negative or NaN, an empty tree). */
LG_API lg_status lg_tree_prune(const lg_context *context, const lg_tree *tree, double alpha, lg_tree *out);

/* ---- support vector machines: trained by libsvm, evaluated by this library ---- */

/* K(x, y) = x.y for the linear kernel, exp(-gamma |x - y|^2) for the RBF kernel. */
typedef enum lg_kernel { LG_KERNEL_LINEAR, LG_KERNEL_RBF } lg_kernel;

/* One against one: each pair of classes (i, j), i < j, has a decision, the sum over the support vectors v of
 * i and j of coefficient_v K(x_v, x), minus rho. It is positive for class i. */
typedef struct lg_svm {
    lg_kernel kernel;
    double gamma, c;
    uint32_t inputs, classes, vectors; /* d, number of classes, number of support vectors */
    uint32_t *vectors_of;              /* (classes) number of support vectors of each class */
    double *vector;                    /* (vectors, d) the support vectors, grouped by class */
    double *coefficient;               /* (classes - 1, vectors), in the order of libsvm */
    double *rho;                       /* (classes (classes - 1)/2) one per pair */
    const lg_context *context;         /* in whose memory the arrays are */
} lg_svm;
/* Trains C-SVC with hinge loss on x (n, d) and label (n). C > 0. gamma <= 0 stands for 1/(d var x), where var
 * x is the variance over all numbers of x, and for 1 if all numbers are equal; it is not used by the linear
 * kernel. A class without rows has no support vectors and is never the answer. Features should be
 * standardised, because libsvm computes |x - y|^2 from squares and a product. The function replaces libsvm's
 * print function by one that prints nothing. Errors: the errors of lg_logistic_fit; LG_INVALID_ARGUMENT also
 * for a C that does not fit the size of the features. */
LG_API lg_status lg_svm_fit(const lg_context *context, lg_kernel kernel, double c, double gamma,
                            const double *x, const uint32_t *label, size_t n, uint32_t d, uint32_t classes,
                            lg_svm *out, lg_error *error);
LG_API void lg_svm_destroy(lg_svm *svm);
/* For a linear kernel and two classes: computes w (d) and b so that w.x + b is positive for class 1. Errors:
 * LG_UNSUPPORTED (another kernel, or more classes). */
LG_API lg_status lg_svm_plane(const lg_svm *svm, double *w, double *b);

/* ---- the whole chain ---- */

typedef enum lg_classifier_method {
    LG_METHOD_LOGISTIC,
    LG_METHOD_TREE,
    LG_METHOD_SVM_LINEAR,
    LG_METHOD_SVM_RBF,
    LG_METHOD_RIDGE
} lg_classifier_method;
#define LG_METHOD_COUNT 5
/* "logistic", "tree", "svm-linear", "svm-rbf" or "ridge". */
LG_API const char *lg_classifier_method_name(lg_classifier_method method);

/* The comments give the values of lg_classifier_options_init. */
typedef struct lg_classifier_options {
    size_t size;                 /* sizeof(lg_classifier_options) */
    lg_classifier_method method; /* default LG_METHOD_LOGISTIC */
    uint32_t components;         /* default 0: no principal components */
    double c;                    /* C of logistic regression and SVM; default 1 */
    double gamma;         /* gamma of the RBF kernel; default 0, which stands for 1/(d var x) (lg_svm_fit) */
    lg_tree_options tree; /* defaults of lg_tree_options_init */
    int threads;          /* of a ridge regression; default 1. The other methods use one */
} lg_classifier_options;
LG_API void lg_classifier_options_init(lg_classifier_options *options);

/* A fitted chain. Of the models logistic, tree and svm only the model of `method` is used; the others are
 * zero. A ridge regression is in `logistic`. */
typedef struct lg_classifier {
    lg_classifier_method method;
    uint32_t classes;
    lg_features features;
    lg_pca pca;
    lg_logistic logistic;
    lg_tree tree;
    lg_svm svm;
    lg_plan *scores; /* of lg_classifier_program; made by lg_classifier_fit and _load, NULL for a tree */
} lg_classifier;

/* Fits standardisation, components and model to rows of a table x (.., d) with labels label (..): to the rows
 * with the indices chosen (count), or to the first `count` rows if `chosen` is NULL. out->features must be
 * set, or zero, before and stays as it is; the other members of *out are overwritten. Errors:
 * LG_INVALID_ARGUMENT (no rows, an option out of range), the errors of lg_pca_fit and of the fit of the
 * method. */
LG_API lg_status lg_classifier_fit(const lg_context *context, const lg_classifier_options *options,
                                   const double *x, const uint32_t *label, const uint32_t *chosen,
                                   size_t count, uint32_t d, uint32_t classes, lg_classifier *out,
                                   lg_error *error);
LG_API void lg_classifier_destroy(lg_classifier *classifier); /* frees the features too */
/* Finds features with large weights: index (count), in rising order. The features are cut into groups of
 * neighbours, as equal as can be, and each group gives its share of the features with the largest norms of
 * weights over the classes. For the methods logistic and ridge without principal components. Errors:
 * LG_INVALID_ARGUMENT (no groups, more features than there are), LG_UNSUPPORTED (another method, or
 * components). */
LG_API lg_status lg_classifier_largest(const lg_context *context, const lg_classifier *classifier,
                                       size_t groups, size_t count, uint32_t *index, lg_error *error);
/* Bytes of work memory for the two functions below. */
LG_API size_t lg_classifier_work_size(const lg_classifier *classifier);
/* Computes score (classes) from the features f (d) of a window; the answer is the class with the largest
 * score. The scores of logistic regressions and trees are probabilities. A ridge regression of two classes
 * has the scores -s and s. With two classes an SVM's score of class 0 is the decision of the pair (0, 1),
 * and the score of class 1 is minus this decision. With more classes its score is the number of pairs that
 * the class wins, plus a number between -1/3 and 1/3 that rises with its decisions and orders classes with
 * equal numbers of wins. libsvm answers with the first class that has the most wins. If the score of this
 * class is not the largest, it is raised just above the largest, so that the answer is the same. */
LG_API void lg_classifier_score(const lg_classifier *classifier, const double *f, double *score,
                                double *work);
/* Computes score (classes) from a window x (channels, length). Errors: LG_INVALID_ARGUMENT (the classifier
 * has no features, or features of another number than it was fitted on), the errors of
 * lg_features_compute. */
LG_API lg_status lg_classifier_window(const lg_classifier *classifier, const float *x, double *score,
                                      double *work);
/* Makes a program. `score` gives the scores (classes) of lg_classifier_score from the `features` f (d) of a
 * window, `decide` the numbers y that determine them. From a `window` (channels, length) `features` gives f,
 * `probability` the scores, `value` y, and `grad` y and its derivatives (y, channels length); these four are
 * left out if the classifier has no features. With K classes y is:
 *   logistic  the logits: 1 number for two classes (the logit of class 1), else K
 *   tree      the fractions of the classes in the leaf (K)
 *   ridge     the scores of lg_ridge_fit: 1 number for two classes, else K
 *   svm       the decisions of the pairs (i, j), i < j: K (K - 1)/2 numbers, positive for class i. For K > 2
 *             the decision is 1 if only i has support vectors, -1 if only j has, and 0 if neither has
 * Derivatives are 0 for trees and random convolutions, with respect to channels that the features do not use,
 * and where a feature is not differentiable: for a standard deviation of 0, for the root of a covariance
 * within its null space, and for a baseline slope when the deviations of the acceleration are equal. The
 * null space belongs to singular values of the window of at most 2^-22 times the largest one. The relative
 * error of the root's derivatives is a few eps = 2^-52 times the ratio of the largest singular value to the
 * smallest one outside the null space. The parameter `eps` is the relative distance of neighbouring
 * numbers; set it to FLT_EPSILON for single precision. Errors: LG_INVALID_ARGUMENT (not fitted), the errors
 * of lg_program_build. */
LG_API lg_status lg_classifier_program(const lg_context *context, const lg_classifier *classifier,
                                       lg_program **out, lg_error *error);
/* Save and load the arrays and texts below "classifier/" of an archive (liegrad/core.h). lg_classifier_load
 * checks sizes and values; on failure *out is zeroed. Errors of lg_classifier_load: LG_NOT_FOUND, LG_FORMAT,
 * LG_NOT_FINITE. Errors of lg_classifier_save: the errors of the writer. */
LG_API lg_status lg_classifier_save(const lg_classifier *classifier, const lg_archive_writer *writer,
                                    lg_error *error);
LG_API lg_status lg_classifier_load(const lg_context *context, const lg_archive_reader *reader,
                                    lg_classifier *out, lg_error *error);

/* ---- grid search by cross-validation on the training part ---- */

/* Tries every options[i] (count) with `folds` stratified folds. The training part is the rows of x (.., d)
 * with the indices chosen (rows), or the first `rows` rows if `chosen` is NULL. accuracy (count) becomes the
 * mean accuracy of each option over the folds, and *best the index of the first option with the highest
 * accuracy. label and unit have one number per row of x; unit may be NULL. Rows with equal unit numbers, such
 * as the windows of one sea state, are put into the same fold (lg_series_folds). Otherwise an option could
 * win because it remembers neighbours of the rows on which it is tested. The number of folds is limited to
 * the number of rows, or of units, of the rarest class that occurs. With fewer than two folds the accuracy is
 * measured on the training rows themselves. If the training rows of a fold are fewer than
 * options[i].components, as many components are used as there are rows. Options that do not converge get the
 * accuracy NaN and are not chosen. The result does not depend on `threads` >= 1. Errors: LG_NO_CONVERGENCE
 * (no option converges), LG_CANCELLED, the errors of lg_classifier_fit. */
LG_API lg_status lg_classifier_search(const lg_context *context, const lg_classifier_options *options,
                                      size_t count, uint32_t folds, const double *x, const uint32_t *label,
                                      const uint32_t *unit, const uint32_t *chosen, size_t rows, uint32_t d,
                                      uint32_t classes, int threads, double *accuracy, size_t *best,
                                      lg_error *error);

LG_END_DECLS

#endif

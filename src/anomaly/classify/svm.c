/* Support vector classification. libsvm (Chang and Lin 2011) solves the dual problem; this file converts its
 * models and evaluates them. */
#include "anomaly/classify/classify_internal.h"

#include <libsvm/svm.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include <cblas.h>

#define CACHE_MB 200.0
/* To compute an entry of the kernel matrix, libsvm walks through two lists of (index, value). If it needs
 * many entries and the lists are long, it is faster to compute the whole kernel matrix beforehand with
 * BLAS ("table", 8 bytes per entry). There is no table below TABLE_FEATURES features or above TABLE_ROWS
 * rows. Otherwise there always is one up to TABLE_ALWAYS rows; with more rows a trial on PILOT_ROWS rows
 * decides. */
#define TABLE_FEATURES 8
#define TABLE_ROWS     8192
#define TABLE_ALWAYS   1500
#define PILOT_ROWS     300
/* Memory that libsvm needs besides its cache, in bytes per row. */
#define ROW_BYTES 256

/* ---- training ---- */

static void silent(const char *text) {
}

/* libsvm is loaded when support vectors are fitted. */
static struct {
    void (*destroy)(struct svm_model **model);
    void (*set_print)(void (*print)(const char *text));
    struct svm_model *(*train)(const struct svm_problem *problem, const struct svm_parameter *parameter);
} libsvm; /* if `train` is found, so are the others */
static pthread_mutex_t libsvm_lock = PTHREAD_MUTEX_INITIALIZER;

/* Tries again if it failed before, as for lack of memory. */
static bool load_libsvm(void) {
    const lg_plugin_function functions[] = {{"svm_free_and_destroy_model", &libsvm.destroy},
                                            {"svm_set_print_string_function", &libsvm.set_print},
                                            {"svm_train", &libsvm.train}};
    (void)pthread_mutex_lock(&libsvm_lock);
    const bool loaded =
        libsvm.train != NULL || lg_plugin_load(LG_SVM_LIBRARY, LG_COUNT(functions), functions);
    (void)pthread_mutex_unlock(&libsvm_lock);
    return loaded;
}

/* The rows are sorted by class, because libsvm numbers the classes in the order in which they first
 * appear. */
typedef struct training {
    const lg_context *context;
    const double *x; /* (n, d), the caller's table */
    size_t n;
    uint32_t d, classes;
    size_t *counts;  /* (classes): number of rows */
    uint32_t *order; /* (n): index in the caller's table of each sorted row */
    double *target;  /* (n): class of each sorted row */
    double *scaled;  /* (n, d): sorted rows times `factor` */
    struct svm_node *nodes;
    struct svm_node **rows; /* (n): pointers into nodes */
    double factor;          /* a power of two, see factor_for */
    struct svm_parameter parameter;
} training;

static void sort_rows(training *t, const uint32_t *label) {
    size_t at = 0;
    for (uint32_t c = 0; c < t->classes; c++) {
        if (t->counts[c] == 0) continue;
        for (size_t i = 0; i < t->n; i++)
            if (label[i] == c) {
                t->target[at] = (double)c;
                t->order[at++] = (uint32_t)i;
            }
    }
    for (size_t i = 0; i < t->n; i++)
        for (size_t j = 0; j < t->d; j++)
            t->scaled[i * t->d + j] = t->factor * t->x[t->order[i] * (size_t)t->d + j];
}

/* Returns row i of the table in the layout of libsvm's kernel PRECOMPUTED. The `value` of a row's node 0 is
 * the number of the row, from 1 on; the `value` of its node j is the kernel with row j. libsvm reads no other
 * member of these nodes. A node is two doubles wide, so two rows share their nodes: the second row begins one
 * double later, in the members that are not read. */
static double *table_row(const training *t, size_t i) {
    return (double *)(void *)t->nodes + i / 2 * 2 * (t->n + 1) + i % 2;
}

/* Computes the kernel of the rows first .. first + rows - 1 with the columns first .. n - 1, and writes the
 * entries and their transposes to the table. product (rows, n - first) is work memory. */
static void fill_stripe(const training *t, size_t first, size_t rows, const double *square, double *product) {
    const size_t columns = t->n - first, d = t->d;
    const double gamma = t->parameter.gamma, *x = t->scaled + first * d;
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, (int)rows, (int)columns, (int)d, 1.0, x, (int)d, x,
                (int)d, 0.0, product, (int)columns);
    for (size_t i = 0; i < rows; i++) {
        double *k = product + i * columns, *row = table_row(t, first + i) + 1;
        for (size_t j = i; j < columns; j++) {
            if (gamma > 0.0)
                k[j] = exp(-gamma * fmax(0.0, square[first + i] + square[first + j] - 2.0 * k[j]));
            row[2 * (first + j + 1)] = k[j];
        }
    }
    for (size_t j = 1; j < columns; j++) {
        double *row = table_row(t, first + j) + 1;
        for (size_t i = 0; i < rows && i < j; i++) row[2 * (first + i + 1)] = product[i * columns + j];
    }
}

#define STRIPE 64

/* Fills the whole table. work: (STRIPE + 1) n doubles. */
static void fill_table(const training *t, double *work) {
    const size_t n = t->n, d = t->d;
    for (size_t i = 0; i < n; i++) {
        work[i] = lg_dot(t->scaled + i * d, t->scaled + i * d, d);
        t->rows[i] = (struct svm_node *)(void *)table_row(t, i);
        table_row(t, i)[1] = (double)(i + 1);
    }
    for (size_t first = 0; first < n; first += STRIPE)
        fill_stripe(t, first, n - first < STRIPE ? n - first : STRIPE, work, work + n);
}

static void fill_lists(training *t) {
    const size_t d = t->d;
    for (size_t i = 0; i < t->n; i++) {
        struct svm_node *row = t->rows[i] = t->nodes + i * (d + 1);
        for (size_t j = 0; j < d; j++) row[j] = (struct svm_node){(int)j + 1, t->scaled[i * d + j]};
        row[d] = (struct svm_node){-1, 0.0};
    }
}

static lg_status training_allocate(training *t) {
    return LG_ALLOC_ALL(t->context, LG_ARRAY(t->order, t->n), LG_ARRAY(t->target, t->n),
                        LG_ARRAY(t->scaled, t->n * t->d), LG_ARRAY(t->rows, t->n));
}

static void training_free(training *t) {
    LG_FREE_ALL(t->context, t->order, t->target, t->scaled, t->rows, t->nodes);
}

/* libsvm does not check its allocations. This function allocates as much memory as libsvm will need, and
 * frees it again, to see whether there is enough. */
static bool memory_is_there(const training *t) {
    const double kernel = 4.0 * (double)t->n * (double)t->n, cache = CACHE_MB * 1048576.0;
    void *volatile probe = malloc((size_t)(kernel < cache ? kernel : cache) +
                                  t->n * (ROW_BYTES + 8 * (size_t)t->classes) + 65536);
    const bool there = probe != NULL;
    free(probe);
    return there;
}

static struct svm_model *run_libsvm(const training *t, size_t n, const struct svm_parameter *parameter) {
    const struct svm_problem problem = {(int)n, t->target, t->rows};
    libsvm.set_print(silent);
    return libsvm.train(&problem, parameter);
}

/* Returns the fraction of support vectors in a rough solution on PILOT_ROWS equidistant rows. */
static double pilot(const training *t) {
    double target[PILOT_ROWS];
    struct svm_node *rows[PILOT_ROWS];
    for (size_t i = 0; i < PILOT_ROWS; i++) {
        target[i] = t->target[i * t->n / PILOT_ROWS];
        rows[i] = t->rows[i * t->n / PILOT_ROWS];
    }
    if (!(target[0] < target[PILOT_ROWS - 1])) return 0.0;
    training few = *t;
    few.target = target;
    few.rows = rows;
    struct svm_parameter rough = t->parameter;
    rough.eps = 0.1;
    struct svm_model *model = run_libsvm(&few, PILOT_ROWS, &rough);
    const double part = model != NULL ? (double)model->l / PILOT_ROWS : 0.0;
    libsvm.destroy(&model);
    return part;
}

/* Measured times: lists take about 8 + 1.1 d ns per kernel entry, and libsvm needs about as many columns as
 * there are support vectors. The table takes 6 + d/16 ns per entry, for all entries. The factor 0.7: the
 * fraction of support vectors falls as the number of rows grows, so the pilot overestimates it. */
static bool table_pays(const training *t) {
    if (t->d < TABLE_FEATURES || t->n > TABLE_ROWS) return false;
    if (t->n <= TABLE_ALWAYS) return true;
    const double d = (double)t->d;
    return 0.7 * pilot(t) * (8.0 + 1.1 * d) > 6.0 + d / 16.0;
}

static lg_status lay_lists(training *t) {
    t->nodes = lg_alloc(t->context, t->n, ((size_t)t->d + 1) * sizeof *t->nodes);
    if (t->nodes == NULL) return LG_OUT_OF_MEMORY;
    fill_lists(t);
    return LG_OK;
}

static lg_status lay_table(training *t) {
    double *work = lg_alloc(t->context, t->n, (STRIPE + 1) * sizeof *work);
    lg_free(t->context, t->nodes);
    t->nodes = lg_alloc(t->context, t->n / 2 + 1, (t->n + 2) * sizeof *t->nodes);
    if (work != NULL && t->nodes != NULL) fill_table(t, work);
    lg_free(t->context, work);
    t->parameter.kernel_type = PRECOMPUTED;
    return work != NULL && t->nodes != NULL ? LG_OK : LG_OUT_OF_MEMORY;
}

/* Factor by which the features are multiplied for a linear kernel. libsvm stores the kernel in single
 * precision, so the squares of the features must stay inside that range. With x' = f x and C' = C/f^2 the
 * dual variables are alpha' = alpha/f^2, and the margins stay the same. */
static double factor_for(const double *x, size_t count) {
    double largest = 0.0;
    for (size_t i = 0; i < count; i++) largest = fmax(largest, fabs(x[i]));
    if (largest == 0.0) return 1.0;
    int exponent = 0;
    (void)frexp(largest, &exponent);
    return ldexp(1.0, exponent > 500 ? -500 : exponent < -500 ? 500 : -exponent);
}

/* ---- conversion ---- */

/* Row of the coefficient matrix that holds the coefficients of the vectors of class `own` against class
 * `other`. */
static size_t coefficient_row(size_t own, size_t other) {
    return other > own ? other - 1 : other;
}

static size_t pair_index(size_t i, size_t j, size_t classes) {
    return i * classes - i * (i + 1) / 2 + (j - i - 1);
}

static void copy_vectors(const training *t, const struct svm_model *model, lg_svm *out) {
    const size_t d = t->d, total = out->vectors;
    size_t at = 0;
    for (size_t a = 0; a < (size_t)model->nr_class; a++) {
        const size_t own = (size_t)model->label[a];
        out->vectors_of[own] = (uint32_t)model->nSV[a];
        for (int k = 0; k < model->nSV[a]; k++, at++) {
            const size_t row = t->order[model->sv_indices[at] - 1];
            memcpy(out->vector + at * d, t->x + row * d, d * sizeof *t->x);
            for (size_t b = 0; b < (size_t)model->nr_class; b++) {
                if (b == a) continue;
                const size_t other = (size_t)model->label[b];
                out->coefficient[coefficient_row(own, other) * total + at] =
                    model->sv_coef[coefficient_row(a, b)][at] * t->factor * t->factor;
            }
        }
    }
}

static lg_status convert(const training *t, const struct svm_model *model, lg_svm *out) {
    const size_t classes = t->classes, pairs = classes * (classes - 1) / 2;
    out->vectors = (uint32_t)model->l;
    LG_TRY(LG_ALLOC_ALL(t->context, LG_ARRAY(out->vectors_of, classes),
                        LG_ARRAY(out->vector, out->vectors * t->d),
                        LG_ARRAY(out->coefficient, out->vectors * (classes - 1)), LG_ARRAY(out->rho, pairs)));
    copy_vectors(t, model, out);
    size_t p = 0;
    for (size_t a = 0; a < (size_t)model->nr_class; a++)
        for (size_t b = a + 1; b < (size_t)model->nr_class; b++, p++)
            out->rho[pair_index((size_t)model->label[a], (size_t)model->label[b], classes)] = model->rho[p];
    for (size_t i = 0; i < pairs; i++)
        if (!isfinite(out->rho[i])) return LG_NO_CONVERGENCE;
    for (size_t i = 0; i < out->vectors * (classes - 1); i++)
        if (!isfinite(out->coefficient[i])) return LG_NO_CONVERGENCE;
    return LG_OK;
}

static lg_status train(training *t, const uint32_t *label, lg_svm *out) {
    LG_TRY(training_allocate(t));
    sort_rows(t, label);
    if (!memory_is_there(t)) return LG_OUT_OF_MEMORY;
    LG_TRY(lay_lists(t));
    if (table_pays(t)) LG_TRY(lay_table(t));
    struct svm_model *model = run_libsvm(t, t->n, &t->parameter);
    const lg_status status = model != NULL ? convert(t, model, out) : LG_OUT_OF_MEMORY;
    libsvm.destroy(&model);
    return status;
}

/* Returns 1/(d var), where var is the variance over all numbers of x; 1 if all numbers are equal. */
static double default_gamma(const double *x, size_t count, uint32_t d) {
    const double mean = lg_kernels_for(LG_F64)->sum(count, x) / (double)count;
    double variance = 0.0;
    for (size_t i = 0; i < count; i++) variance += (x[i] - mean) * (x[i] - mean) / (double)count;
    const double gamma = 1.0 / ((double)d * variance);
    return isfinite(gamma) && gamma > 0.0 ? gamma : 1.0;
}

static lg_status fit_model(training *t, const uint32_t *label, lg_svm *out, lg_error *error) {
    LG_TRY(lg_check_labels(label, t->n, t->classes, 2, t->counts, error));
    if (!load_libsvm())
        return lg_fail(error, LG_NOT_FOUND,
                       "support vectors need the library " LG_SVM_LIBRARY ", which cannot be loaded");
    if ((double)t->n * (double)t->d * sizeof(struct svm_node) > 0x1p36)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%zu rows of %u features are too many for support vectors: use principal components "
                       "or fewer windows",
                       t->n, t->d);
    const lg_status status = train(t, label, out);
    training_free(t);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "support vectors of %zu rows and %u features, C = %g: %s", t->n, t->d,
                   out->c, lg_status_sentence(status));
}

static lg_status check_fit(lg_kernel kernel, double c, double gamma, const uint32_t *label, uint32_t classes,
                           const lg_svm *out, lg_error *error) {
    LG_NEEDS(error, label, out);
    if (kernel != LG_KERNEL_LINEAR && kernel != LG_KERNEL_RBF)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown kernel");
    if (isnan(gamma) || gamma > 1e300)
        return lg_fail(error, LG_INVALID_ARGUMENT, "gamma is %g, expected a number of at most 1e300", gamma);
    return lg_check_c(c, classes, error);
}

lg_status lg_svm_fit(const lg_context *context, lg_kernel kernel, double c, double gamma, const double *x,
                     const uint32_t *label, size_t n, uint32_t d, uint32_t classes, lg_svm *out,
                     lg_error *error) {
    LG_TRY(check_fit(kernel, c, gamma, label, classes, out, error));
    LG_TRY(lg_check_table(x, n, d, error));
    LG_CLEAN(lg_svm_destroy)
    lg_svm svm = {.kernel = kernel, .c = c, .inputs = d, .classes = classes, .context = context};
    training t = {.context = context, .x = x, .n = n, .d = d, .classes = classes, .factor = 1.0};
    if (kernel == LG_KERNEL_RBF) svm.gamma = gamma > 0.0 ? gamma : default_gamma(x, n * d, d);
    if (kernel == LG_KERNEL_LINEAR) t.factor = factor_for(x, n * d);
    t.parameter = (struct svm_parameter){.svm_type = C_SVC,
                                         .kernel_type = kernel == LG_KERNEL_RBF ? RBF : LINEAR,
                                         .gamma = svm.gamma,
                                         .cache_size = CACHE_MB,
                                         .eps = 1e-3,
                                         .C = c / t.factor / t.factor,
                                         .shrinking = 1};
    if (!isfinite(t.parameter.C) || t.parameter.C == 0.0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "C = %g does not fit the size of the features: scale them",
                       c);
    LG_TRY_SCRATCH(size_t, counts, context, classes,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %u classes", classes));
    t.counts = counts;
    LG_TRY(fit_model(&t, label, &svm, error));
    return LG_GIVE(out, svm);
}

void lg_svm_destroy(lg_svm *svm) {
    if (svm == NULL) return;
    LG_FREE_ALL(svm->context, svm->vectors_of, svm->vector, svm->coefficient, svm->rho);
    *svm = (lg_svm){0};
}

lg_status lg_svm_plane(const lg_svm *svm, double *w, double *b) {
    if (svm == NULL || w == NULL || b == NULL) return LG_INVALID_ARGUMENT;
    if (svm->kernel != LG_KERNEL_LINEAR || svm->classes != 2) return LG_UNSUPPORTED;
    memset(w, 0, svm->inputs * sizeof *w);
    for (size_t v = 0; v < svm->vectors; v++)
        for (size_t j = 0; j < svm->inputs; j++)
            w[j] -= svm->coefficient[v] * svm->vector[v * svm->inputs + j];
    *b = svm->rho[0];
    return LG_OK;
}

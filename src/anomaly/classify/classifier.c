/* The classifier's chain: features, standardisation, principal components, model. */
#include "anomaly/classify/classify_internal.h"

#include <stdlib.h>
#include <string.h>

#include "core/median.h"

static const char *const method_names[LG_METHOD_COUNT] = {
    [LG_METHOD_LOGISTIC] = "logistic", [LG_METHOD_TREE] = "tree",   [LG_METHOD_SVM_LINEAR] = "svm-linear",
    [LG_METHOD_SVM_RBF] = "svm-rbf",   [LG_METHOD_RIDGE] = "ridge",
};

const char *lg_classifier_method_name(lg_classifier_method method) {
    return (unsigned)method < LG_METHOD_COUNT ? method_names[method] : "unknown";
}

void lg_classifier_options_init(lg_classifier_options *options) {
    *options = (lg_classifier_options){
        .size = sizeof *options, .method = LG_METHOD_LOGISTIC, .c = 1.0, .threads = 1};
    lg_tree_options_init(&options->tree);
}

/* ---- fitting ---- */

typedef struct fitting {
    const lg_context *context;
    const lg_classifier_options *options;
    size_t n;
    uint32_t d;
    double *x, *p;   /* (n, d) features, (n, k) components; without components both are the same array */
    uint32_t *label; /* (n) */
} fitting;

static lg_status fit_method(const fitting *f, uint32_t k, lg_classifier *c, lg_error *error) {
    const lg_classifier_options *o = f->options;
    switch (o->method) {
    case LG_METHOD_LOGISTIC:
        return lg_logistic_fit(f->context, f->p, f->label, f->n, k, c->classes, o->c, &c->logistic, error);
    case LG_METHOD_TREE:
        return lg_tree_fit(f->context, &o->tree, f->p, f->label, f->n, k, c->classes, &c->tree, error);
    case LG_METHOD_RIDGE:
        return lg_ridge_fit(f->context, f->p, f->label, f->n, k, c->classes, o->threads, &c->logistic, error);
    default:
        return lg_svm_fit(f->context, o->method == LG_METHOD_SVM_RBF ? LG_KERNEL_RBF : LG_KERNEL_LINEAR, o->c,
                          o->gamma, f->p, f->label, f->n, k, c->classes, &c->svm, error);
    }
}

static lg_status fit_chain(fitting *f, const double *x, const uint32_t *label, const uint32_t *chosen,
                           lg_classifier *c, lg_error *error) {
    const size_t d = f->d;
    if (LG_ALLOC_ALL(f->context, LG_ARRAY(f->x, f->n * d), LG_ARRAY(f->label, f->n)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu rows of %u features", f->n, f->d);
    for (size_t i = 0; i < f->n; i++) {
        const size_t row = lg_chosen_row(chosen, i);
        memcpy(f->x + i * d, x + row * d, d * sizeof *x);
        f->label[i] = label[row];
    }
    LG_TRY(lg_pca_fit(f->context, f->x, f->n, f->d, f->options->components, &c->pca, error));
    const uint32_t k = lg_pca_outputs(&c->pca);
    LG_SCRATCH(double, work, f->context, d);
    f->p = c->pca.components == 0 ? f->x : lg_alloc(f->context, f->n, k * sizeof *f->p);
    if (work == NULL || f->p == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu rows of %u components", f->n, k);
    lg_pca_eval(&c->pca, f->x, f->n, f->p, work);
    return fit_method(f, k, c, error);
}

static void free_fitted(lg_classifier *c) {
    lg_pca_destroy(&c->pca);
    lg_logistic_destroy(&c->logistic);
    lg_tree_destroy(&c->tree);
    lg_svm_destroy(&c->svm);
    lg_plan_destroy(c->scores);
}

lg_status lg_classifier_fit(const lg_context *context, const lg_classifier_options *options, const double *x,
                            const uint32_t *label, const uint32_t *chosen, size_t count, uint32_t d,
                            uint32_t classes, lg_classifier *out, lg_error *error) {
    if (options == NULL || options->size != sizeof *options || x == NULL || label == NULL || out == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "an argument is NULL, or the options were not initialised");
    if ((unsigned)options->method >= LG_METHOD_COUNT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown method");
    if (count == 0 || d == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu rows of %u features: nothing to learn from", count,
                       d);
    LG_CLEAN(free_fitted) lg_classifier made = {.method = options->method, .classes = classes};
    fitting f = {.context = context, .options = options, .n = count, .d = d};
    const lg_status status = fit_chain(&f, x, label, chosen, &made, error);
    if (f.p != f.x) lg_free(context, f.p);
    LG_FREE_ALL(context, f.x, f.label);
    made.features = out->features;
    LG_TRY(status);
    LG_TRY(lg_classifier_ready(context, &made, error));
    return LG_GIVE(out, made);
}

void lg_classifier_destroy(lg_classifier *classifier) {
    if (classifier == NULL) return;
    lg_features_destroy(&classifier->features);
    free_fitted(classifier);
    *classifier = (lg_classifier){0};
}

/* ---- the most important features ---- */

typedef struct weighted {
    double squares;
    uint32_t index;
} weighted;

/* By falling weight, then by index. */
static int by_weight(const void *a, const void *b) {
    const weighted *x = a, *y = b;
    if (x->squares != y->squares) return x->squares < y->squares ? 1 : -1;
    return (x->index > y->index) - (x->index < y->index);
}

static void weigh(const lg_classifier *c, uint32_t i, weighted *out) {
    const size_t rows = c->classes == 2 ? 1 : c->classes;
    *out = (weighted){0, i};
    for (size_t row = 0; row < rows; row++) {
        const double w = c->logistic.weight[row * c->pca.inputs + i];
        out->squares += w * w;
    }
}

lg_status lg_classifier_largest(const lg_context *context, const lg_classifier *c, size_t groups,
                                size_t count, uint32_t *index, lg_error *error) {
    LG_NEEDS(error, c, index);
    const size_t d = c->pca.inputs;
    if (!lg_method_is_linear(c->method) || c->pca.components > 0)
        return lg_fail(error, LG_UNSUPPORTED,
                       "only logistic and ridge regression without components have a weight per feature");
    if (count > d || groups == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu of %zu features in %zu groups", count, d, groups);
    LG_TRY_SCRATCH(weighted, all, context, d,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu features", d));
    for (size_t i = 0; i < d; i++) weigh(c, (uint32_t)i, &all[i]);
    for (size_t g = 0, done = 0; g < groups; g++) {
        const size_t begin = d * g / groups, end = d * (g + 1) / groups, until = count * (g + 1) / groups;
        qsort(all + begin, end - begin, sizeof *all, by_weight);
        for (size_t i = begin; done < until; i++) index[done++] = all[i].index;
    }
    qsort(index, count, sizeof *index, lg_compare_u32);
    return LG_OK;
}

/* ---- scores. work: features, then memory that their computation and the scores use in turn ---- */

size_t lg_classifier_work_size(const lg_classifier *c) {
    const size_t d = c->pca.inputs,
                 features = c->features.count > 0 ? lg_features_work_size(&c->features) : 0;
    const size_t scores = c->scores != NULL ? lg_plan_work_size(c->scores) + LG_ALIGNMENT
                                            : (lg_pca_outputs(&c->pca) + d) * sizeof(double);
    return d * sizeof(double) + (features > scores ? features : scores);
}

void lg_classifier_score(const lg_classifier *c, const double *f, double *score, double *work) {
    const size_t over = (uintptr_t)work % LG_ALIGNMENT;
    if (c->scores != NULL) {
        lg_plan_eval(c->scores, (const void *const[]){f}, (void *const[]){score},
                     (char *)work + (over > 0 ? LG_ALIGNMENT - over : 0));
        return;
    }
    lg_pca_eval(&c->pca, f, 1, work, work + lg_pca_outputs(&c->pca));
    lg_tree_predict(&c->tree, work, 1, score);
}

lg_status lg_classifier_window(const lg_classifier *c, const float *x, double *score, double *work) {
    LG_NEEDS(NULL, c, x, score, work);
    if (c->features.count == 0 || c->features.count != c->pca.inputs) return LG_INVALID_ARGUMENT;
    LG_TRY(lg_features_compute(&c->features, x, work, work + c->pca.inputs));
    lg_classifier_score(c, work, score, work + c->pca.inputs);
    return LG_OK;
}

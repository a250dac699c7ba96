/* Estimates by how much features, their scaling and a classifier's weights multiply rounding errors. The
 * stated tolerance of an exported classifier contains this factor. */
#include "lg-export/anomaly/classifier.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bool classifier_is_linear(const lg_classifier *c) {
    return c->method == LG_METHOD_LOGISTIC || c->method == LG_METHOD_RIDGE ||
           c->method == LG_METHOD_SVM_LINEAR;
}

/* Rounding error, in eps, of the logarithm of a power P in a channel whose mean power is A: amplitudes are
 * accurate to eps A^(1/2), so P is accurate to 2 eps (A P)^(1/2). */
static double size_of_power(const lg_features *f, const double *mean, size_t i) {
    const double *bands = mean + i / f->bands * f->bands;
    double sum = 0;
    for (size_t b = 0; b < f->bands; b++) sum += exp(bands[b] - mean[i]);
    return fabs(mean[i]) + 2 * sqrt(sum / f->bands);
}

/* Estimates the rounding error of feature i at the training mean, in eps. For a standard deviation it is the
 * feature itself; for an entry of a matrix root, the norm of the matrix; for the coefficients of a line, a
 * multiple of both coefficients, since the deviations that the line is fitted to are rounded. Windows
 * themselves are exact. */
double classifier_size_of(const classifier_job *j, size_t i) {
    const double *mean = j->c->pca.mean;
    switch (j->c->features.kind) {
    case LG_FEATURES_RAW:
        return 0;
    case LG_FEATURES_STD:
    case LG_FEATURES_ROCKET:
        return fabs(mean[i]);
    case LG_FEATURES_COV:
        return sqrt(2) * export_norm(mean, NULL, j->d);
    case LG_FEATURES_SPECTRUM:
        return size_of_power(&j->c->features, mean, i);
    default:
        return 4 * (fabs(mean[i / 2 * 2]) + fabs(mean[i / 2 * 2 + 1]));
    }
}

/* Condition of linear decisions: the norm of W with the row of each feature multiplied by 1 + size_of/scale,
 * divided by the norm of W and its bias. */
static double linear_condition(const classifier_job *j, const classifier_linear *w) {
    const lg_pca *pca = &j->c->pca;
    double most = 0, plain = 0;
    for (size_t o = 0; o < j->outputs; o++) {
        plain += w->bias[o] * w->bias[o];
        for (size_t i = 0; i < j->d; i++) {
            double by = 0;
            if (pca->components == 0)
                by = w->weight[i * j->outputs + o];
            else
                for (size_t p = 0; p < j->k; p++)
                    by += pca->vectors[i * j->k + p] * w->weight[p * j->outputs + o];
            const double times = by * (1 + classifier_size_of(j, i) / pca->scale[i]);
            most += times * times;
            plain += by * by;
        }
    }
    return plain > 0 ? sqrt(most / plain) : 1;
}

/* Extra condition of linear SVMs in double precision: the library adds up the support vectors one by one,
 * while the exported code uses their sum. */
static double vectors_condition(const classifier_job *j, const classifier_linear *w) {
    const lg_svm *svm = &j->c->svm;
    double sum = 0;
    if (j->c->method != LG_METHOD_SVM_LINEAR || j->source->options->dtype == LG_F32) return 0;
    for (size_t v = 0; v < svm->vectors; v++) {
        const double size = export_norm(svm->vector + v * svm->inputs, NULL, svm->inputs);
        for (size_t r = 0; r + 1 < svm->classes; r++) {
            const double c = svm->coefficient[r * svm->vectors + v];
            sum += c * c * size * size;
        }
    }
    const double plain =
        hypot(export_norm(w->weight, NULL, j->k * j->outputs), export_norm(w->bias, NULL, j->outputs));
    return plain > 0 ? sqrt(sum) / plain : 0;
}

/* Terms of the pair (own, other) at p, added up over support vectors: the decision, its derivative with
 * respect to p, and the sum of squares of the terms. */
typedef struct rbf_sums {
    double decision, squares;
    double *by_p; /* (k) */
} rbf_sums;

static void add_class(const lg_svm *svm, size_t own, size_t other, const double *p, rbf_sums *sums) {
    const double *coefficient = svm->coefficient + (other > own ? other - 1 : other) * (size_t)svm->vectors;
    size_t first = 0;
    for (size_t i = 0; i < own; i++) first += svm->vectors_of[i];
    for (size_t v = first; v < first + svm->vectors_of[own]; v++) {
        const double *vector = svm->vector + v * svm->inputs;
        double distance = 0;
        for (size_t i = 0; i < svm->inputs; i++) distance += (vector[i] - p[i]) * (vector[i] - p[i]);
        const double term = coefficient[v] * exp(-svm->gamma * distance);
        const double exact = term * (1 + svm->gamma * distance);
        sums->decision += term;
        sums->squares += exact * exact;
        for (size_t i = 0; i < svm->inputs; i++) sums->by_p[i] += 2 * svm->gamma * term * (vector[i] - p[i]);
    }
}

/* Returns the square of a decision's rounding error, in eps: from standardised features that are off by eps
 * (1 + size_of/scale) each, and from the rounding of the terms themselves. */
static double grown(const classifier_job *j, const rbf_sums *sums) {
    const lg_pca *pca = &j->c->pca;
    double out = sums->squares;
    for (size_t i = 0; i < j->d; i++) {
        double by = 0;
        if (pca->components == 0)
            by = sums->by_p[i];
        else
            for (size_t p = 0; p < j->k; p++) by += pca->vectors[i * j->k + p] * sums->by_p[p];
        by *= 1 + classifier_size_of(j, i) / pca->scale[i];
        out += by * by;
    }
    return out;
}

/* Evaluates the decisions at support vectors (at most 50 of them). Returns the largest rounding error, in
 * eps, divided by the root mean square of the decisions. */
static double rbf_condition(const classifier_job *j) {
    const lg_svm *svm = &j->c->svm;
    const size_t step = (svm->vectors + 49) / 50;
    double most = 0, decisions = 0;
    size_t count = 0;
    rbf_sums sums = {.by_p = app_alloc(j->k, sizeof(double))};
    for (size_t v = 0; v < svm->vectors; v += step, count++) {
        double here = 0;
        size_t pair = 0;
        for (size_t a = 0; a < svm->classes; a++)
            for (size_t b = a + 1; b < svm->classes; b++, pair++) {
                memset(sums.by_p, 0, j->k * sizeof *sums.by_p);
                sums.decision = -svm->rho[pair];
                sums.squares = 0;
                add_class(svm, a, b, svm->vector + v * svm->inputs, &sums);
                add_class(svm, b, a, svm->vector + v * svm->inputs, &sums);
                here += grown(j, &sums);
                decisions += sums.decision * sums.decision;
            }
        most = fmax(most, here);
    }
    free(sums.by_p);
    return decisions > 0 ? sqrt(most * (double)count / decisions) : 1;
}

double classifier_condition(const classifier_job *j, const classifier_linear *w) {
    double out = 1;
    if (classifier_is_linear(j->c)) out = fmax(out, linear_condition(j, w) + vectors_condition(j, w));
    if (j->c->method == LG_METHOD_SVM_RBF) out = fmax(out, rbf_condition(j));
    return out;
}

/* By how much features, their scaling and a classifier's weights multiply rounding: what the stated tolerance
 * of an exported classifier is multiplied by. */
#include "lg-export/anomaly/classifier.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

bool classifier_is_linear(const lg_classifier *c) {
    return c->method == LG_METHOD_LOGISTIC || c->method == LG_METHOD_SVM_LINEAR;
}

/* The logarithm of a power P of a channel whose mean power is A: amplitudes are accurate to eps A^(1/2), P to
 * 2 eps (A P)^(1/2). */
static double size_of_power(const lg_features *f, const double *mean, size_t i) {
    const double *bands = mean + i / f->bands * f->bands;
    double sum = 0;
    for (size_t b = 0; b < f->bands; b++) sum += exp(bands[b] - mean[i]);
    return fabs(mean[i]) + 2 * sqrt(sum / f->bands);
}

/* Feature i is accurate to about eps times this number, at the training mean: itself for a standard
 * deviation, the norm of the matrix for an entry of its root; the coefficients of a line cost some of those
 * of the deviations that it is drawn through. Windows themselves are exact. */
double classifier_size_of(const classifier_job *j, size_t i) {
    const double *mean = j->c->pca.mean;
    switch (j->c->features.kind) {
    case LG_FEATURES_RAW:
        return 0;
    case LG_FEATURES_STD:
        return fabs(mean[i]);
    case LG_FEATURES_COV:
        return sqrt(2) * export_norm(mean, NULL, j->d);
    case LG_FEATURES_SPECTRUM:
        return size_of_power(&j->c->features, mean, i);
    default:
        return 4 * (fabs(mean[i / 2 * 2]) + fabs(mean[i / 2 * 2 + 1]));
    }
}

/* Of linear decisions: norms of W with each column multiplied, and as it is with its bias. */
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

/* The library adds up support vectors one by one, in double precision. */
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

/* The terms of pair (own, other) at p that come from the vectors of `own`: decision, its derivative by p, the
 * squares of the terms that are added. */
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

/* The square of what standardised features that are off by eps size_of/scale, and the terms' own rounding,
 * make of a decision, in eps. */
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

/* At support vectors, of which at most 50 are looked at: the most that rounding grows to, beside the root
 * mean square of the decisions. */
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

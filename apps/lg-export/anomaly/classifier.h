/* Export of a classical classifier: declarations that the files of this folder share. */
#ifndef LG_EXPORT_CLASSIFIER_H
#define LG_EXPORT_CLASSIFIER_H

#include "common/classifier_file.h"
#include "lg-export/window.h"
#include "liegrad/classify.h"

/* The classifier that is being exported. */
typedef struct classifier_job {
    export_source *source;
    const classifier_file *file;
    const lg_classifier *c;
    /* Numbers of features, of inputs of the model (after the principal components), and of decisions. */
    size_t d, k, outputs;
} classifier_job;

/* Linear decisions y = W p + b, of logistic regression and linear SVMs. */
typedef struct classifier_linear {
    double *weight; /* (k, outputs) */
    double *bias;   /* (outputs) */
} classifier_linear;

bool classifier_is_linear(const lg_classifier *c);
/* Returns a number for feature i: at the training mean, the feature's rounding error is about eps times this
 * number (classifier_rounding.c). */
double classifier_size_of(const classifier_job *j, size_t i);
/* Returns the factor >= 1 by which the classifier multiplies rounding errors on windows; the tolerance
 * contains it besides 20 eps depth. `w` is read only if the decisions are linear. */
double classifier_condition(const classifier_job *j, const classifier_linear *w);
/* Draws windows and computes the library's results for them (classifier_golden.c). */
void classifier_golden(const classifier_job *j, const app *self);

#endif

/* Export of a classical classifier: declarations that its files share. */
#ifndef LG_EXPORT_CLASSIFIER_H
#define LG_EXPORT_CLASSIFIER_H

#include "common/classifier_file.h"
#include "lg-export/window.h"
#include "liegrad/classify.h"

/* The classifier that is exported. */
typedef struct classifier_job {
    export_source *source;
    const classifier_file *file;
    const lg_classifier *c;
    size_t d, k, outputs; /* features, what the model reads, decisions */
} classifier_job;

/* Linear decisions y = W p + b of logistic regression and linear SVMs. */
typedef struct classifier_linear {
    double *weight; /* (k, outputs) */
    double *bias;   /* (outputs) */
} classifier_linear;

bool classifier_is_linear(const lg_classifier *c);
/* Feature i is accurate to about eps times this number, at the training mean (classifier_rounding.c). */
double classifier_size_of(const classifier_job *j, size_t i);
/* Factor of the rounding of decisions on windows, beside 20 eps depth; w is read when decisions are
 * linear. */
double classifier_condition(const classifier_job *j, const classifier_linear *w);
/* Draws windows and computes the results of the library. Returns an exit code (classifier_golden.c). */
int classifier_golden(const classifier_job *j, const app *self);

#endif

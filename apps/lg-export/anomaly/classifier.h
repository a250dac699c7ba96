/* Export of a classical classifier: declarations that the files of this folder share. */
#ifndef LG_EXPORT_CLASSIFIER_H
#define LG_EXPORT_CLASSIFIER_H

#include "common/classifier_file.h"
#include "lg-export/window.h"

/* The classifier that is being exported. */
typedef struct classifier_job {
    const app *self;
    export_source *source;
    const classifier_file *file;
    const lg_classifier *c;
    size_t d, outputs;                  /* Numbers of features, and of decisions. */
    lg_program *program;                /* lg_classifier_program, with the adjoint of its value. */
    export_evaluation value, pull_back; /* These two functions; a tree has no adjoint. */
} classifier_job;

/* Returns whether the outputs are constant between thresholds. */
bool classifier_is_constant(const lg_classifier *c);
/* Draws windows and computes the library's results for them. Sets the factor by which the classifier
 * multiplies rounding errors (classifier_golden.c). */
void classifier_golden(const classifier_job *j);

#endif

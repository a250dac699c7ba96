/* Files of kind "classifier": a classical classifier with the names of its classes and channels, how its
 * data were cut and split, and the novelty of its training windows. The method "novelty" is that alone.
 * Written by lg-anomaly, read by it and by lg-export. */
#ifndef LG_APPS_CLASSIFIER_FILE_H
#define LG_APPS_CLASSIFIER_FILE_H

#include "liegrad/classify.h"
#include "liegrad/io.h"
#include "liegrad/novelty.h"
#include "liegrad/series.h"

typedef struct classifier_file {
    lg_classifier classifier; /* zero for "novelty" */
    lg_novelty novelty;       /* channels 0: none */
    lg_series names;    /* classes, channels and rate with their names, no windows; channels 0: not named */
    const char *method; /* "logistic", "tree", "svm-linear", "svm-rbf", "baseline", "novelty"; static */
    lg_split split;
    double test_fraction;
    uint64_t seed, windows, window, hop; /* windows in all; samples of one, and from one to the next */
    char data_sha256[LG_SHA256_TEXT];
    double accuracy, f1; /* on the test part; NaN: not stored */
    lg_provenance provenance;
} classifier_file;

/* Everything of `file` is borrowed. What is NaN of accuracy and f1 is left out. */
lg_status classifier_file_save(const lg_context *context, const char *path, const classifier_file *file,
                               lg_error *error);
/* Window and hop fit the classifier, the classes are named as many as it has; of the method "novelty" two.
 * On failure *out is zeroed. */
bool classifier_file_is_novelty(const classifier_file *file);
lg_status classifier_file_load(const lg_context *context, const char *path, classifier_file *out,
                               lg_error *error);
void classifier_file_free(classifier_file *file); /* a zeroed one may be freed */

#endif

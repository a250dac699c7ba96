/* Files of kind "classifier": a classical classifier with the names of its classes and channels, and how its
 * data were cut and split. Written by lg-anomaly, read by it and by lg-export. */
#ifndef LG_APPS_CLASSIFIER_FILE_H
#define LG_APPS_CLASSIFIER_FILE_H

#include "liegrad/classify.h"
#include "liegrad/io.h"
#include "liegrad/series.h"

typedef struct classifier_file {
    lg_classifier classifier;
    lg_series names;    /* classes, channels and rate with their names, no windows; channels 0: not named */
    const char *method; /* "logistic", "tree", "svm-linear", "svm-rbf", "baseline"; static */
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
/* Window and hop fit the classifier, the classes are named as many as it has. On failure *out is zeroed. */
lg_status classifier_file_load(const lg_context *context, const char *path, classifier_file *out,
                               lg_error *error);
void classifier_file_free(classifier_file *file); /* a zeroed one may be freed */

#endif

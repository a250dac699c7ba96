/* Files of kind "classifier": a classical classifier with the names of its classes and channels, how its data
 * were cut and split, and the novelty model of its training windows. A file of the method "novelty" has only
 * the novelty model. lg-anomaly writes these files; lg-anomaly and lg-export read them. */
#ifndef LG_APPS_CLASSIFIER_FILE_H
#define LG_APPS_CLASSIFIER_FILE_H

#include "liegrad/anomaly.h"
#include "liegrad/classify.h"
#include "liegrad/files.h"
#include "liegrad/series.h"

typedef struct classifier_file {
    lg_classifier classifier; /* zero for the method "novelty" */
    lg_novelty novelty;       /* channels is 0 if there is no novelty model */
    /* Names of classes and channels, and the rate; no windows. channels is 0 if they have no names. */
    lg_series names;
    const char *method; /* by classifier_method_name; not "cnn" */
    /* How the data were cut: split, test_fraction, training.seed, windows, window, hop, data_sha256,
     * healthy. */
    lg_detector_run run;
    double accuracy, f1; /* on the test part; NaN: not stored */
    lg_provenance provenance;
} classifier_file;

/* Methods by number: "cnn", "logistic", "tree", "svm-linear", "svm-rbf", "baseline", "rocket", "novelty",
 * then NULL. */
const char *classifier_method_name(uint32_t method);
/* All pointers in `file` stay the caller's. An accuracy or f1 that is NaN is not written. */
lg_status classifier_file_save(const lg_context *context, const char *path, const classifier_file *file,
                               lg_error *error);
bool classifier_file_is_novelty(const classifier_file *file);
/* Checks that the window length fits the classifier and that there are as many class names as classes (two
 * for the method "novelty"). On failure *out is zeroed. */
lg_status classifier_file_load(const lg_context *context, const char *path, classifier_file *out,
                               lg_error *error);
void classifier_file_free(classifier_file *file); /* a zeroed structure is allowed */

#endif

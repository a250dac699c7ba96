/* Files of kind "classifier": a classical classifier with the names of its classes and channels, how its data
 * were cut and split, and the novelty model of its training windows. A file of the method "novelty" has only
 * the novelty model. lg-anomaly writes these files; lg-anomaly and lg-export read them. */
#ifndef LG_APPS_CLASSIFIER_FILE_H
#define LG_APPS_CLASSIFIER_FILE_H

#include "liegrad/anomaly.h"
#include "liegrad/classify.h"
#include "liegrad/model.h"

/* A file structure of lg_recipe_save. Of `run` only how the data were cut is used: split, test_fraction,
 * training.seed, windows, window, hop, data_sha256, healthy. */
typedef struct classifier_file {
    LG_DETECTOR_HEAD
    lg_scaler scaler; /* unused, as test_mse: they keep `classifier` out of the memory of lg_detector_file */
    double test_mse;
    lg_classifier classifier; /* zero for the method "novelty" */
    const char *method;       /* by classifier_method_name; not stored, since the classifier determines it */
} classifier_file;

extern const lg_recipe classifier_recipe;

/* Methods by number: "cnn", "logistic", "tree", "svm-linear", "svm-rbf", "baseline", "rocket", "novelty",
 * then NULL. */
const char *classifier_method_name(uint32_t method);
static inline bool classifier_file_is_novelty(const classifier_file *file) {
    return file->classifier.classes == 0;
}
/* lg_recipe_load checks that the length of a window and the number of class names (two for the method
 * "novelty") fit the classifier. */
#define classifier_file_load(context, path, out, error)                                                      \
    lg_recipe_load(context, path, NULL, &classifier_recipe, out, error)
#define classifier_file_free(file) lg_recipe_release(&classifier_recipe, file)

#endif

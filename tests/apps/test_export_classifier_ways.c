/* Exported classifiers with every compiler and optimisation; stack. ctest-labels: study */
#include "export_classifier.h"

static const export_kind classifiers = {
    LG_COUNT(samples), classifier_name, classifier_way, classifier_make, NULL, NULL, NULL};

TEST("every classifier is built in every way") {
    export_build_all(&classifiers);
}

TEST_GROUP(export_begin, export_end)

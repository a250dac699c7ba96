/* Measures of the quality of a classifier. */
#ifndef LIEGRAD_METRICS_H
#define LIEGRAD_METRICS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

/* Class of the largest score, the first of equals; two classes: 1 when score[1] >= score[0]. */
LG_API uint32_t lg_class_of(const double *score, uint32_t classes);
/* confusion (classes, classes): windows of true class i given class j; overwritten. Classes out of range are
 * left out. */
LG_API void lg_confusion(const uint32_t *truth, const uint32_t *given, size_t n, uint32_t classes,
                         uint64_t *confusion);

/* For two classes the numbers are those of class 1; for more, the mean over all classes ("macro"). A class
 * that was never predicted has precision 0, a class that does not occur has recall 0; f1 = 2 p r/(p + r), 0
 * for 0/0. */
typedef struct lg_metrics {
    double accuracy, precision, recall, f1;
    double false_positive_rate; /* part of class 0 that was given another class; NaN without class 0 */
} lg_metrics;
LG_API lg_metrics lg_metrics_of(const uint64_t *confusion, uint32_t classes);

/* Receiver operating characteristic of `score` for class `positive` against all others. The points are sorted
 * by falling threshold, (fpr, tpr) from (0, 0) to (1, 1); equal scores form one point. fpr, tpr and threshold
 * have room for n + 1 numbers; threshold[0] = infinity. `order` (n < 2^32) is work memory. A NaN score counts
 * as -infinity. Returns the number of points, 0 when one side is empty. */
LG_API size_t lg_roc(const uint32_t *truth, const double *score, size_t n, uint32_t positive, double *fpr,
                     double *tpr, double *threshold, uint32_t *order);
/* Area under this curve; ties count half; NaN when one side is empty. With more than two classes it is the
 * mean of the areas of one class against the rest, over the classes for which it exists. score (n, classes).
 * Errors: LG_OUT_OF_MEMORY, LG_INVALID_ARGUMENT (no classes, 2^32 windows). */
LG_API lg_status lg_auc(const lg_context *context, const uint32_t *truth, const double *score, size_t n,
                        uint32_t classes, double *auc);

LG_END_DECLS

#endif

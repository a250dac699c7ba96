/* Results of a model on the windows of a set. */
#ifndef LG_ANOMALY_JUDGE_H
#define LG_ANOMALY_JUDGE_H

#include "liegrad/metrics.h"
#include "liegrad/series.h"

/* Indices of windows, rising. */
typedef struct lg_window_list {
    uint32_t *list;
    size_t count;
} lg_window_list;

/* Calls each(user, i, x, work) with x (channels, length), window number list[i], in bundles, by several
 * threads; `work` bytes are the thread's alone, 64-byte aligned. LG_CANCELLED where the context is, otherwise
 * the first failure. */
lg_status lg_windows_each(const lg_context *context, const lg_series *series, const lg_windows *windows,
                          const lg_window_list *part, uint64_t threads, size_t work,
                          lg_status (*each)(void *user, size_t i, const float *x, void *work), void *user);

typedef struct lg_judgement {
    size_t count;
    uint32_t classes;
    uint32_t *window, *truth, *given; /* (count); window: index in lg_windows */
    double *score;                    /* (count, classes) */
    double *plane;                    /* (count, 2) or NULL */
    uint64_t *confusion;              /* (classes, classes) */
    lg_metrics metrics;
    double auc;
    double mse;     /* two classes with probabilities: mean of (p - label)^2; otherwise NaN */
    double seconds; /* of scoring */
    const lg_context *context;
} lg_judgement;

/* The windows of a part; the time of scoring begins. Without windows all numbers are NaN. */
lg_status lg_judgement_begin(const lg_context *context, const lg_series *series, const lg_windows *windows,
                             const lg_window_list *part, uint32_t classes, bool plane, lg_judgement *out,
                             lg_error *error);
/* Scores are there, unless `status` is a failure, with which *judged is destroyed. `probabilities`: that is
 * what the scores are; otherwise decisions, distances. */
lg_status lg_judgement_end(lg_judgement *judged, bool probabilities, lg_status status, lg_error *error);
void lg_judgement_destroy(lg_judgement *judged);
/* LG_NOT_FINITE: a window whose numbers overflow in the model has no class. */
lg_status lg_judgement_check(const lg_judgement *judged, lg_error *error);
/* False alarms a day: the false positive rate times the number of windows a day, one every `hop` samples. NaN
 * when the rate is unknown. */
double lg_judgement_alarms(const lg_judgement *judged, uint64_t hop, double rate);

#endif

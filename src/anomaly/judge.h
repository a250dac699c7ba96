/* Results of a model on the windows of a set. */
#ifndef LG_ANOMALY_JUDGE_H
#define LG_ANOMALY_JUDGE_H

#include "liegrad/metrics.h"
#include "liegrad/series.h"

/* Indices of windows, rising; the list is lg_alloc's. */
typedef struct lg_window_list {
    uint32_t *list;
    size_t count;
} lg_window_list;

/* A model, as one that scores window number `window` of a set: score (classes), plane (2) or NULL. Called by
 * several threads, each with `work` bytes of its own, 64-byte aligned. */
typedef struct lg_scorer {
    lg_status (*score)(const void *user, uint32_t window, double *score, double *plane, void *work);
    const void *user;
    size_t work;
    uint32_t classes;
    bool plane;         /* it has one */
    bool probabilities; /* scores are probabilities; false: decisions, distances */
} lg_scorer;

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

/* Without windows all numbers are NaN. */
lg_status lg_judge_windows(const lg_context *context, const lg_scorer *scorer, const lg_series *series,
                           const lg_windows *windows, const lg_window_list *part, uint64_t threads,
                           lg_judgement *out, lg_error *error);
void lg_judgement_destroy(lg_judgement *judged);
/* LG_NOT_FINITE: a window whose numbers overflow in the model has no class. */
lg_status lg_judgement_check(const lg_judgement *judged, lg_error *error);
/* False alarms a day: the false positive rate times the number of windows a day, one every `hop` samples. NaN
 * when the rate is unknown. */
double lg_judgement_alarms(const lg_judgement *judged, uint64_t hop, double rate);

#endif

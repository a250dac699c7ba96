/* Evaluation of a model on the windows of a data set: scores, confusion matrix, metrics. */
#ifndef LG_ANOMALY_JUDGE_H
#define LG_ANOMALY_JUDGE_H

#include "liegrad/series.h"
#include "settings/training.h"

/* The row of --healthy, for a member of this name. */
#define HEALTHY(type)                                                                                        \
    LG_FIELD(type, "run", "healthy", TEXT, healthy, .usual = true, .optional = true, .unit = "NAME",         \
             .form = "text", .meaning = "Name or label of the class that means that all is well",            \
             .otherwise = LG_CHOSEN                                                                          \
             ": the model's, attribute healthy of the data, or the only class whose name says so")

/* Appends a vote to *votes, whose bits are the last n (1 to 64) votes, the latest in bit 0. Returns how many
 * of them are for. */
static inline uint32_t lg_cast_vote(uint64_t *votes, uint32_t n, bool is_for) {
    *votes = (*votes << 1 | is_for) & (UINT64_MAX >> (64 - n));
    return (uint32_t)__builtin_popcountll(*votes);
}

/* A data file and the windows cut out of it. */
typedef struct lg_cut_series {
    lg_series_data data;
    lg_windows windows;
} lg_cut_series;

/* Indices of windows in rising order; list NULL: 0, 1, ... */
typedef struct lg_window_list {
    uint32_t *list;
    size_t count;
} lg_window_list;

/* Calls each(user, i, x, work) for every i below part->count. x (channels, length) is window number
 * part->list[i]. Several threads do this, in bundles of windows. Each call has `work` bytes of memory,
 * aligned to 64 bytes, which no other thread uses. Returns LG_CANCELLED if the context is cancelled, or the
 * first failure in the order of the list. */
lg_status lg_windows_each(const lg_context *context, const lg_series *series, const lg_windows *windows,
                          const lg_window_list *part, uint64_t threads, size_t work,
                          lg_status (*each)(void *user, size_t i, const float *x, void *work), void *user);

/* How a model scores windows. The scores are probabilities, or else decision values or distances. */
typedef struct lg_scorer {
    /* Scores a window x (channels, length), as recorded -> score (classes), plane (2). */
    lg_status (*score)(const void *model, const float *x, double *score, double *plane, void *work);
    const void *model;
    size_t work; /* bytes of work memory of `score`, aligned to 64 bytes */
    uint32_t classes, healthy;
    bool plane; /* whether `score` gives numbers of a plane; else its `plane` is NULL */
    bool probabilities;
} lg_scorer;

typedef struct lg_judgement {
    size_t count;
    uint32_t classes, healthy; /* healthy: the class that means "all is well", or LG_NO_CLASS */
    /* Arrays (count). window: index of the window in lg_windows; truth: its class; given: the class that the
     * model gave it. */
    uint32_t *window, *truth, *given;
    double *score;       /* (count, classes) */
    double *plane;       /* (count, 2) or NULL */
    uint64_t *confusion; /* (classes, classes) */
    lg_metrics metrics;
    double auc;
    /* Mean of (p - label)^2, where p is the probability of class 1. NaN unless there are two classes and the
     * scores are probabilities. */
    double mse;
    double seconds;      /* time that the scoring took */
    const lg_scorer *by; /* the model, until lg_judgement_end */
    const lg_context *context;
} lg_judgement;

/* Scores windows of `part`, in threads. A failure leaves *out without memory. */
lg_status lg_judge(const lg_context *context, const lg_scorer *by, const lg_cut_series *from,
                   const lg_window_list *part, uint64_t threads, lg_judgement *out, lg_error *error);
/* The parts of lg_judge, for a caller that fills in the scores itself. lg_judgement_begin allocates the
 * arrays of *out for the windows of `part`, fills in `window` and `truth`, and starts the clock. The metrics
 * are NaN until lg_judgement_end sets them; they stay NaN if there are no windows. */
lg_status lg_judgement_begin(const lg_context *context, const lg_scorer *by, const lg_cut_series *from,
                             const lg_window_list *part, lg_judgement *out, lg_error *error);
/* Stops the clock and computes the metrics from the scores. If `status` is a failure, or the computation
 * fails, the result is destroyed and the failure is returned. */
lg_status lg_judgement_end(lg_judgement *judged, lg_status status, lg_error *error);
void lg_judgement_destroy(lg_judgement *judged);
/* Checks that all scores are finite. LG_NOT_FINITE means that the numbers of a window overflow in the model,
 * so that it has no class. */
lg_status lg_judgement_check(const lg_judgement *judged, lg_error *error);
/* Returns the expected number of false alarms per day: the false positive rate times the number of windows
 * per day. A window begins every `hop` samples, at `rate` samples per second. NaN if the rate (0) or the
 * healthy class is unknown. */
double lg_judgement_alarms(const lg_judgement *judged, uint64_t hop, double rate);

#endif

/* How good a classifier is, and what a watch-keeper sees of it. Library `liegrad_classify`. */
#ifndef LIEGRAD_JUDGE_H
#define LIEGRAD_JUDGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

/* ---- metrics (metrics.c) ---- */

/* Class of the largest score, the first of equals; two classes: 1 when score[1] >= score[0]. */
LG_API uint32_t lg_class_of(const double *score, uint32_t classes);
/* confusion (classes, classes): windows of true class i given class j; overwritten. Classes out of range are
 * left out. */
LG_API void lg_confusion(const uint32_t *truth, const uint32_t *given, size_t n, uint32_t classes,
                         uint64_t *confusion);

/* Two classes: of class 1; more: the mean over classes ("macro"). A class that was never given has precision
 * 0, one that does not occur has recall 0; f1 = 2 p r/(p + r), 0 for 0/0. All classes count in the mean. */
typedef struct lg_metrics {
    double accuracy, precision, recall, f1;
    double false_positive_rate; /* part of class 0 that was given another class; NaN without class 0 */
} lg_metrics;
LG_API lg_metrics lg_metrics_of(const uint64_t *confusion, uint32_t classes);

/* Receiver operating characteristic of `score` for class `positive` against all others: points by falling
 * threshold, (fpr, tpr) from (0, 0) to (1, 1), equal scores in one point. Arrays of n + 1; returns the number
 * of points; 0 when one side is empty. threshold[0] = infinity. `order` (n < 2^32) is workspace. A score that
 * is NaN stands below every number, with -infinity. */
LG_API size_t lg_roc(const uint32_t *truth, uint32_t positive, const double *score, size_t n, uint32_t *order,
                     double *fpr, double *tpr, double *threshold);
/* Area under it, ties counted half; NaN when one side is empty. With more than two classes the mean of one
 * against the rest over the classes for which it exists. score (n, classes). LG_OUT_OF_MEMORY,
 * LG_INVALID_ARGUMENT (no classes, 2^32 windows). */
LG_API lg_status lg_auc(const lg_context *context, const uint32_t *truth, const double *score, size_t n,
                        uint32_t classes, double *auc);

/* ---- watching a feed (watch.c): fixed memory, the caller's ---- */

typedef struct lg_watch_options {
    size_t size;       /* sizeof(lg_watch_options) */
    uint32_t channels; /* >= 1 */
    uint32_t window;   /* samples of a window */
    uint32_t hop;      /* 0: window; samples from one window to the next, <= window */
    uint32_t bridge;   /* 5: gaps of at most so many samples are filled by straight lines */
    double missing;    /* 0.1: largest part of a window that may be missing, bridged samples included */
    uint32_t votes;    /* k = 3: alarm when k of the last n judged windows are positive */
    uint32_t votes_of; /* n = 5, 1..64 */
} lg_watch_options;
LG_API void lg_watch_options_init(lg_watch_options *options);

/* Judges a window (channels, window): sets *positive and *score (the higher, the more so). x lies in the
 * watch's memory, 64-byte aligned, and is the judge's until it returns. */
typedef lg_status (*lg_watch_judge)(void *user, const float *x, bool *positive, double *score);

typedef struct lg_verdict {
    uint64_t window;       /* 0, 1, ... */
    uint64_t first_sample; /* of the feed */
    bool judged;           /* false: too much was missing; nothing below but `alarm` means anything */
    bool positive;
    double score;
    uint32_t missing;               /* samples not received, or not finite */
    uint32_t positive_votes, votes; /* among the last n judged windows */
    bool alarm;                     /* holds k of n; the last state while windows are not judged */
} lg_verdict;

typedef struct lg_watch lg_watch;
/* Bytes, 64-byte aligned: twice a window as floats, and a little. 0 for options that init refuses. */
LG_API size_t lg_watch_size(const lg_watch_options *options);
/* LG_INVALID_ARGUMENT with a sentence: a size of 0, hop > window, missing outside [0, 1], votes outside
 * 1..votes_of, votes_of outside 1..64, memory that is not aligned. The watch lives in `memory` and owns
 * nothing else. */
LG_API lg_status lg_watch_init(const lg_watch_options *options, lg_watch_judge judge, void *user,
                               void *memory, lg_watch **out, lg_error *error);
/* One sample (channels), or NULL: lost. A sample with a value that is not finite is lost as a whole. *ready:
 * a window is complete, *verdict is set. Window i holds samples i hop .. i hop + window - 1 of the feed, lost
 * ones counted. Lost samples:
 *   - a gap of at most `bridge` samples is filled by straight lines as soon as the next sample is received;
 *   - a longer gap, and one still open when a window is complete, holds the last value received;
 *   - lost samples at the beginning of a feed get the value of the first one received.
 * A window of a feed that has not sent a sample yet is not judged, whatever `missing` allows. No allocation,
 * no lock of its own. Returns the judge's status: unless it is LG_OK, *ready and *verdict are untouched, that
 * window has no vote, and the feed may go on. */
LG_API lg_status lg_watch_push(lg_watch *watch, const float *sample, bool *ready, lg_verdict *verdict);

LG_END_DECLS

#endif

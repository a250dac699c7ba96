/* Monitoring of a feed by a classifier, in the caller's memory of fixed size. Library `liegrad_classify`. */
#ifndef LIEGRAD_MONITOR_H
#define LIEGRAD_MONITOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

typedef struct lg_monitor_options {
    size_t size;       /* sizeof(lg_monitor_options) */
    uint32_t channels; /* >= 1 */
    uint32_t window;   /* samples of a window */
    uint32_t hop;      /* 0: window; samples from one window to the next, <= window */
    uint32_t bridge;   /* 5: gaps of at most this many samples are filled by straight lines */
    double missing;    /* 0.1: largest part of a window that may be missing, bridged samples included */
    uint32_t votes;    /* k = 3: alarm when k of the last n judged windows are positive */
    uint32_t votes_of; /* n = 5, 1..64 */
} lg_monitor_options;
LG_API void lg_monitor_options_init(lg_monitor_options *options);

typedef enum lg_answer {
    LG_ANSWER_NEGATIVE, /* all is well */
    LG_ANSWER_POSITIVE,
    LG_ANSWER_NOVEL /* unlike what the judge knows (liegrad/novelty.h): neither of the two */
} lg_answer;
/* Judges a window (channels, window), `missing` samples of which are filled in: sets *answer and *score
 * (higher means more positive). x lies in the monitor's memory, 64-byte aligned; the judge may use it until
 * it returns. */
typedef lg_status (*lg_monitor_judge)(void *user, const float *x, uint32_t missing, lg_answer *answer,
                                      double *score);

typedef struct lg_verdict {
    uint64_t window;       /* 0, 1, ... */
    uint64_t first_sample; /* of the feed */
    bool judged;           /* false: too much was missing; nothing below but `alarm` means anything */
    lg_answer answer;
    double score;
    uint32_t missing;               /* samples not received, or not finite */
    uint32_t positive_votes, votes; /* among the last n windows that were judged and not novel */
    uint32_t novel_votes;           /* among the last n judged windows */
    bool alarm; /* k of n are positive; the last state while windows are not judged, or novel */
    bool novel; /* k of n are novel; the last state while windows are not judged */
} lg_verdict;

typedef struct lg_monitor lg_monitor;
/* Bytes, to be 64-byte aligned: two windows of floats and a small rest. 0 for options that init refuses. */
LG_API size_t lg_monitor_size(const lg_monitor_options *options);
/* LG_INVALID_ARGUMENT with a sentence: a size of 0, hop > window, missing outside [0, 1], votes outside
 * 1..votes_of, votes_of outside 1..64, memory that is not aligned or smaller than lg_monitor_size. The
 * monitor lives in `memory` (`size` bytes) and owns nothing else. */
LG_API lg_status lg_monitor_init(const lg_monitor_options *options, lg_monitor_judge judge, void *user,
                                 lg_monitor **out, void *memory, size_t size, lg_error *error);
/* One sample (channels), or NULL: lost. A sample with a value that is not finite is lost as a whole. *ready:
 * a window is complete, *verdict is set. Window i holds samples i hop .. i hop + window - 1 of the feed, lost
 * ones counted. Lost samples:
 *   - a gap of at most `bridge` samples is filled by straight lines as soon as the next sample is received;
 *   - a longer gap, and one still open when a window is complete, holds the last value received;
 *   - lost samples at the beginning of a feed get the value of the first one received.
 * A window of a feed that has not sent a sample yet is not judged, whatever `missing` allows. No allocation,
 * no lock of its own. Returns the judge's status: unless it is LG_OK, *ready and *verdict are untouched, that
 * window has no vote, and the feed may go on. */
LG_API lg_status lg_monitor_push(lg_monitor *monitor, const float *sample, bool *ready, lg_verdict *verdict);

LG_END_DECLS

#endif

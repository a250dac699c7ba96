/* Random search over hyperparameters, resumable, with early stopping of bad trials. It knows nothing of what
 * is trained: a trial is a row of numbers, an objective to be lowered, and reports on the way.
 *
 * Trial t's values depend on the seed and t alone, whatever ran before: an interrupted search continues to
 * the same trials, and trials may run in any order.
 */
#ifndef LIEGRAD_SEARCH_H
#define LIEGRAD_SEARCH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/context.h"
#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

typedef enum lg_range_kind {
    LG_RANGE_UNIFORM,     /* [low, high) */
    LG_RANGE_LOG_UNIFORM, /* the logarithm uniform; low > 0 */
    LG_RANGE_INTEGER,     /* low..high, whole numbers, both ends included */
    LG_RANGE_CHOICE       /* one of the choices; the value is its position */
} lg_range_kind;

#define LG_RANGE_MAX         32
#define LG_RANGE_MAX_CHOICES 16
#define LG_RANGE_NAME        32

typedef struct lg_range {
    char name[LG_RANGE_NAME];
    lg_range_kind kind;
    double low, high;
    uint32_t choices;
    char choice[LG_RANGE_MAX_CHOICES][LG_RANGE_NAME];
} lg_range;

typedef struct lg_search_space {
    size_t count;
    lg_range ranges[LG_RANGE_MAX];
} lg_search_space;

typedef enum lg_trial_state { LG_TRIAL_DONE, LG_TRIAL_PRUNED, LG_TRIAL_FAILED } lg_trial_state;
#define LG_TRIAL_STATE_COUNT 3
LG_API const char *lg_trial_state_name(lg_trial_state state); /* "done", "pruned", "failed" */

#define LG_TRIAL_REPORTS 16 /* rungs at which trials are compared */

typedef struct lg_trial {
    uint64_t number; /* 0, 1, ... */
    lg_trial_state state;
    double objective; /* to be lowered; pruned: the last one reported; NaN when failed */
    double seconds;   /* wall time, set by lg_search_run */
    uint64_t parameters, epochs;
    double value[LG_RANGE_MAX];
    uint32_t reports;                /* rungs reached */
    double report[LG_TRIAL_REPORTS]; /* objective at each */
} lg_trial;

typedef struct lg_search_options {
    size_t size;     /* sizeof(lg_search_options) */
    uint64_t trials; /* 50: planned total, earlier ones included */
    uint64_t seed;   /* 1 */
    uint32_t rungs; /* 5, 0..LG_TRIAL_REPORTS: they cut a trial's epochs into rungs + 1 equal parts, the first
                     * one after 1/(rungs + 1) of them; 0: no early stopping */
    uint32_t warm_up; /* 5: trials that must have passed a rung before others are stopped there */
    double quantile;  /* 0.5, in (0, 1]: a trial is stopped at a rung where at least this part of those before
                       * were better */
} lg_search_options;
LG_API void lg_search_options_init(lg_search_options *options);

/* LG_INVALID_ARGUMENT with a sentence: no range, a name twice, low above high, a bound that is not finite, a
 * logarithm of what is not positive, whole numbers that are none or beyond 2^53, no choice, a choice twice; a
 * name or choice that is empty or holds a comma, a double quote or a control character. */
LG_API lg_status lg_search_space_check(const lg_search_space *space, lg_error *error);
/* value (space->count) of trial `number`, for a space that passed the check. A range's value depends on the
 * seed, the number, the range and its position: ranges added at the end leave the others as they were. */
LG_API void lg_search_draw(const lg_search_space *space, uint64_t seed, uint64_t number, double *value);
/* Whether trial `number` with `objective` at rung `rung` (0, 1, ...) is to be stopped. Only trials with lower
 * numbers count, so that the answer does not depend on what else ran before. True when the objective is not
 * finite. Otherwise, of the n trials that reached the rung (stopped there or not), b were better, strictly:
 * true when n >= warm_up, n > 0 and b >= max(1, quantile n). A tie is not better; an objective that is not
 * finite is worse than every finite one. */
LG_API bool lg_search_prune(const lg_search_options *options, const lg_trial *trials, size_t count,
                            uint64_t number, uint32_t rung, double objective);

/* A trial's side of the search. */
typedef struct lg_search lg_search;
/* Called by a trial after `done` of its `total` epochs with its objective of now. Records the rungs passed
 * since the last report, all with this objective. True: stop, the trial is lost, because of one of these
 * rungs or, at any time, an objective that is not finite. After the last epoch a finite one never stops. */
LG_API bool lg_search_report(lg_search *search, uint64_t done, uint64_t total, double objective);

typedef struct lg_search_problem {
    /* Runs one trial: reads trial->number and trial->value, reports, sets objective, parameters and epochs.
     * LG_OK: done, pruned when a report said so, failed when the objective is not finite. LG_CANCELLED: the
     * search stops and the trial is not kept; after a report that said stop it is the same as LG_OK, so that
     * the status of lg_fit_run may be handed on. Any other status: the trial failed, with `error` (never
     * NULL), and the search goes on. */
    lg_status (*run)(void *user, lg_search *search, lg_trial *trial, lg_error *error);
    /* After each trial, with all of them so far, the new one last: where results are saved. `error`: LG_OK,
     * or why the trial failed. May be NULL. A status other than LG_OK stops the search. */
    lg_status (*finished)(void *user, const lg_trial *trials, size_t count, const lg_error *error);
    void *user;
} lg_search_problem;

/* Runs the trials whose numbers are not among the first *count of `trials` (room for options->trials), one
 * after the other by rising number, and appends them. The cancel flag is read before each trial. `options`
 * NULL: defaults. Errors: LG_INVALID_ARGUMENT (what the check refuses, options outside their range, an
 * earlier trial twice or beyond the plan), LG_CANCELLED, what `finished` returned; the trials so far stay.
 * Interrupted anywhere and continued with the trials so far, a search whose `run` is a pure function of its
 * trial ends with the same trials, but for their seconds, as one that was not. */
LG_API lg_status lg_search_run(const lg_context *context, const lg_search_space *space,
                               const lg_search_options *options, const lg_search_problem *problem,
                               lg_trial *trials, size_t *count, lg_error *error);
/* Position of the trial that is done with the lowest objective, of equal ones that with the lowest number;
 * `count` when there is none. */
LG_API size_t lg_search_best(const lg_trial *trials, size_t count);

LG_END_DECLS

#endif

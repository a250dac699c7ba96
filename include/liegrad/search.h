/* Random search over hyperparameters. A search can be resumed, and bad trials are stopped early. It does not
 * depend on the model: a trial is a list of numbers, an objective to be lowered, and reports during the
 * trial.
 *
 * The values of trial t depend on the seed and t alone. So an interrupted search continues with the same
 * trials, and trials may run in any order.
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
    LG_RANGE_LOG_UNIFORM, /* uniform in the logarithm; low > 0 */
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
    /* Of a trial that ran beside others: its planned epochs, and those done at each rung. 0: settled. */
    uint64_t planned, report_epoch[LG_TRIAL_REPORTS];
} lg_trial;

typedef struct lg_search_options {
    size_t size;     /* sizeof(lg_search_options) */
    uint64_t trials; /* 50: planned total, earlier ones included */
    uint64_t seed;   /* 1 */
    uint32_t rungs; /* 5, 0..LG_TRIAL_REPORTS: rungs divide a trial's epochs into rungs + 1 equal parts; 0: no
                     * early stopping */
    uint32_t warm_up; /* 5: trials that must have reached a rung before any trial is stopped there */
    double quantile;  /* 0.5, in (0, 1]: a trial is stopped at a rung when at least this part of the earlier
                       * trials was better there */
} lg_search_options;
LG_API void lg_search_options_init(lg_search_options *options);

/* LG_INVALID_ARGUMENT with a sentence:
 * - no range; two ranges of the same name
 * - low above high; a bound that is not finite, or not positive in a logarithmic range
 * - bounds of an integer range that are not whole or beyond 2^53
 * - no choice, or the same choice twice
 * - a name or choice that is empty or has a comma, a double quote or a control character */
LG_API lg_status lg_search_space_check(const lg_search_space *space, lg_error *error);

/* A trial's side of the search. */
typedef struct lg_search lg_search;
/* A trial calls this after `done` of its `total` epochs with its current objective, which is recorded for all
 * rungs passed since the last report. Returns true when the trial is to be stopped: at one of these rungs, or
 * because the objective is not finite. After the last epoch a finite objective never stops a trial. */
LG_API bool lg_search_report(lg_search *search, uint64_t done, uint64_t total, double objective);

typedef struct lg_search_problem {
    /* Runs one trial: reads trial->number and trial->value, reports, sets objective, parameters and epochs.
     * What it returns:
     * - LG_OK: the trial is pruned when a report said stop, failed when the objective is not finite, else
     *   done
     * - LG_CANCELLED: the search stops and the trial is not kept. After a report that said stop it means
     *   LG_OK, so the status of lg_fit_run may be returned as it is
     * - any other status: the trial failed with `error` (never NULL), and the search goes on */
    lg_status (*run)(void *user, lg_search *search, lg_trial *trial, lg_error *error);
    /* Called after each trial with all trials so far, the new one last: saves results. `error` holds LG_OK or
     * why the trial failed. A status other than LG_OK stops the search. The callback may be NULL. */
    lg_status (*finished)(void *user, const lg_trial *trials, size_t count, const lg_error *error);
    void *user;
} lg_search_problem;

/* Runs the trials whose numbers are not among the first *count of `trials` (room for options->trials), one
 * after the other by rising number, and appends them. The cancel flag is read before each trial. `options`
 * NULL: defaults. Errors, with the trials so far kept: LG_INVALID_ARGUMENT (the check refuses the space, an
 * option is out of range, an earlier trial is there twice or beyond the plan), LG_CANCELLED, the status of
 * `finished`. When `run` is a pure function of its trial, an interrupted and continued search ends with the
 * same trials as an uninterrupted one, except for their seconds. */
LG_API lg_status lg_search_run(const lg_context *context, const lg_search_space *space,
                               const lg_search_options *options, const lg_search_problem *problem,
                               lg_trial *trials, size_t *count, lg_error *error);
/* ---- trials beside each other: on other threads, processes, machines ---- */

/* What a trial learns of others where it passes a rung: sets *trials to those with lower numbers, settled.
 * False: one of them has not come so far; then the trial goes on, and lg_search_settle decides later. */
typedef bool (*lg_search_known)(void *user, const lg_trial *trial, uint32_t rung, const lg_trial **trials,
                                size_t *count);
/* Runs one trial. `known` NULL: nothing is known. LG_OK (a trial that failed, too: `why`), LG_CANCELLED (it
 * is not kept), or what lg_search_run refuses. */
LG_API lg_status lg_search_run_trial(const lg_search_space *space, const lg_search_options *options,
                                     const lg_search_problem *problem, lg_search_known known, uint64_t number,
                                     lg_trial *trial, lg_error *why);
/* Sorts the trials by number, and makes each that ran on where it would have been stopped one that was
 * stopped there: when all numbers below are there, they are those of lg_search_run, but for their seconds. */
LG_API void lg_search_settle(const lg_search_options *options, lg_trial *trials, size_t count);

/* Position of the done trial with the lowest objective; among equal ones, the lowest number. `count` when no
 * trial is done. */
LG_API size_t lg_search_best(const lg_trial *trials, size_t count);

LG_END_DECLS

#endif

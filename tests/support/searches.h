/* The reference for searches: trials one after the other, each of them compared with all that ran before. */
#ifndef TEST_SEARCHES_H
#define TEST_SEARCHES_H

#include "liegrad/settings.h"

/* Called after each trial with all trials so far. A status other than LG_OK ends the search. */
typedef lg_status serial_finished(void *user, const lg_trial *trials, size_t count, const lg_error *error);

static struct {
    const lg_trial *trials;
    size_t count;
} serial_before;

static inline bool serial_known(void *user, const lg_trial *trial, uint32_t rung, const lg_trial **trials,
                                size_t *count) {
    (void)user, (void)trial, (void)rung;
    *trials = serial_before.trials;
    *count = serial_before.count;
    return true;
}

static inline lg_status search_nothing(void *user, lg_search *search, lg_trial *trial, lg_error *error) {
    (void)user, (void)search, (void)error;
    trial->objective = 0;
    return LG_OK;
}

/* The values that the sampler chooses after the trials of serial_before. */
static inline lg_status search_values(const lg_search_space *space, const lg_search_options *options,
                                      uint64_t number, lg_trial *trial) {
    const lg_search_problem problem = {search_nothing, NULL};
    return lg_search_run_trial(space, options, &problem, serial_known, number, trial, NULL);
}

/* Runs all numbers below `planned` that are not among the first *count trials, and appends them. */
static inline lg_status serial_search(const volatile int *cancel, const lg_search_space *space,
                                      const lg_search_options *options, uint64_t planned,
                                      const lg_search_problem *problem, serial_finished *finished,
                                      lg_trial *trials, size_t *count) {
    lg_status status = LG_OK;
    for (uint64_t number = 0; number < planned && status == LG_OK; number++) {
        lg_error why = {LG_OK, ""};
        bool has = false;
        for (size_t i = 0; i < *count; i++) has = has || trials[i].number == number;
        if (has) continue;
        if (cancel != NULL && *cancel) return LG_CANCELLED;
        serial_before.trials = trials;
        serial_before.count = *count;
        status = lg_search_run_trial(space, options, problem, serial_known, number, &trials[*count], &why);
        if (status != LG_OK) return status;
        trials[*count].planned = 0;
        ++*count;
        if (finished != NULL) status = finished(problem->user, trials, *count, &why);
    }
    return status;
}

#endif

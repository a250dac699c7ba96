/* Searches with early stopping: spaces, stopping and running trials. */
#include "nn/search.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/core.h"

#define DECLARE(name, sentence) extern const lg_sampler lg_sampler_##name;
#define ROW(name, sentence)     &lg_sampler_##name,
LG_SAMPLERS(DECLARE)
static const lg_sampler *const samplers[] = {LG_SAMPLERS(ROW)};

struct lg_search {
    const lg_search_options *options;
    lg_trial *trial; /* the trial that is running */
    bool stopped;    /* a report has told the trial to stop */
    lg_search_known known;
    void *user;
};

const char *lg_trial_state_name(lg_trial_state state) {
    static const char *const names[LG_TRIAL_STATE_COUNT] = {
        [LG_TRIAL_DONE] = "done", [LG_TRIAL_PRUNED] = "pruned", [LG_TRIAL_FAILED] = "failed"};
    return (int)state >= 0 && (int)state < LG_TRIAL_STATE_COUNT ? names[state] : "unknown";
}

const lg_sampler *lg_search_sampler(uint32_t sampler) {
    return sampler < LG_COUNT(samplers) ? samplers[sampler] : NULL;
}

const char *lg_search_sampler_name(uint32_t sampler) {
    return sampler < LG_COUNT(samplers) ? samplers[sampler]->name : NULL;
}

void lg_search_options_init(lg_search_options *options) {
    *options = (lg_search_options){
        .size = sizeof *options, .seed = 1, .rungs = 5, .warm_up = 5, .quantile = 0.5, .trials = 50};
}

/* ---- spaces ---- */

/* Whether the name is terminated, not empty, and a word that a table shows as it is. */
static bool is_name(const char name[LG_RANGE_NAME]) {
    const char *end = memchr(name, '\0', LG_RANGE_NAME);
    if (end == NULL || end == name || name[0] == ' ' || end[-1] == ' ') return false;
    for (; name < end; name++)
        if ((unsigned char)*name < 0x20 || *name == 0x7f || *name == '"') return false;
    return true;
}

static lg_status check_choices(const lg_range *range, lg_error *error) {
    if (range->choices == 0 || range->choices > LG_RANGE_MAX_CHOICES)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: has %u choices, 1 to %d are expected", range->name,
                       range->choices, LG_RANGE_MAX_CHOICES);
    for (uint32_t i = 0; i < range->choices; i++) {
        if (!is_name(range->choice[i]))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "%s: choice %u is empty, too long, holds a quote or a control character, or "
                           "begins or ends with a blank",
                           range->name, i + 1);
        for (uint32_t k = 0; k < i; k++)
            if (strcmp(range->choice[i], range->choice[k]) == 0)
                return lg_fail(error, LG_INVALID_ARGUMENT, "%s: choice '%s' stands twice", range->name,
                               range->choice[i]);
    }
    return LG_OK;
}

static bool is_whole(double x) {
    return fabs(x) <= 0x1p53 && floor(x) == x;
}

static lg_status check_bounds(const lg_range *range, lg_error *error) {
    const double low = range->low, high = range->high;
    if (!isfinite(low) || !isfinite(high))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: a bound is not finite", range->name);
    if (low > high)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: the lower bound %g is above the upper bound %g",
                       range->name, low, high);
    if (range->kind == LG_RANGE_LOG_UNIFORM && !(low > 0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%s: the lower bound of a log-uniform range must be above 0, found %g", range->name,
                       low);
    if (range->kind == LG_RANGE_INTEGER && (!is_whole(low) || !is_whole(high)))
        return lg_fail(error, LG_INVALID_ARGUMENT, "%s: %.17g is not a whole number up to 2^53", range->name,
                       is_whole(low) ? high : low);
    return LG_OK;
}

static lg_status check_range(const lg_search_space *space, size_t index, lg_error *error) {
    const lg_range *range = &space->ranges[index];
    if (!is_name(range->name))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the name of range %zu is empty, too long, or holds a quote or a control character",
                       index + 1);
    for (size_t k = 0; k < index; k++)
        if (strcmp(range->name, space->ranges[k].name) == 0)
            return lg_fail(error, LG_INVALID_ARGUMENT, "range '%s' stands twice", range->name);
    if (range->kind == LG_RANGE_CHOICE) return check_choices(range, error);
    if (range->kind == LG_RANGE_UNIFORM || range->kind == LG_RANGE_LOG_UNIFORM ||
        range->kind == LG_RANGE_INTEGER)
        return check_bounds(range, error);
    return lg_fail(error, LG_INVALID_ARGUMENT, "%s: the range has the unknown kind %d", range->name,
                   (int)range->kind);
}

lg_status lg_search_space_check(const lg_search_space *space, lg_error *error) {
    if (space == NULL || space->count == 0 || space->count > LG_RANGE_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a search needs 1 to %d ranges", LG_RANGE_MAX);
    for (size_t i = 0; i < space->count; i++) LG_TRY(check_range(space, i, error));
    return LG_OK;
}

/* ---- early stopping ---- */

bool lg_search_prune(const lg_search_options *options, const lg_trial *trials, size_t count, uint64_t number,
                     uint32_t rung, double objective) {
    if (!isfinite(objective)) return true;
    size_t reached = 0, better = 0;
    for (size_t i = 0; i < count; i++) {
        if (trials[i].number >= number || trials[i].reports <= rung) continue;
        const double other = trials[i].report[rung];
        reached++;
        better += isfinite(other) && other < objective;
    }
    if (reached == 0 || reached < options->warm_up) return false;
    /* The last factor is for rounding: 0.1 * 30 is a little more than 3. */
    const double needed = options->quantile * (double)reached * (1 - 1e-12);
    return better > 0 && (double)better >= needed;
}

/* First epoch at which the trial has passed the rung: total (rung + 1)/parts rounded up, no overflow. */
static uint64_t rung_epoch(uint64_t total, uint32_t rung, uint32_t parts) {
    return total / parts * (rung + 1) + (total % parts * (rung + 1) + parts - 1) / parts;
}

/* Whether the trial is to be stopped at the rung that it has just reached. Where the other trials are not
 * known yet, only an objective that is not finite stops it. */
static bool prunes(const lg_search *search, uint32_t rung) {
    const lg_trial *before = NULL, *trial = search->trial;
    size_t count = 0;
    if (search->known == NULL || !search->known(search->user, trial, rung, &before, &count)) count = 0;
    return lg_search_prune(search->options, before, count, trial->number, rung, trial->report[rung]);
}

bool lg_search_report(lg_search *search, uint64_t done, uint64_t total, double objective) {
    if (search == NULL) return false;
    lg_trial *trial = search->trial;
    const uint32_t rungs = search->options->rungs;
    bool stop = !isfinite(objective);
    trial->objective = objective;
    trial->planned = total;
    while (trial->reports < rungs && done >= rung_epoch(total, trial->reports, rungs + 1)) {
        const uint32_t rung = trial->reports++;
        trial->report[rung] = objective;
        trial->report_epoch[rung] = done;
        stop = stop || (done < total && prunes(search, rung));
    }
    search->stopped = search->stopped || stop;
    return search->stopped;
}

/* ---- running ---- */

static lg_status check_options(const lg_search_options *options, lg_error *error) {
    if (options->size != sizeof *options)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the size of the search's options is wrong: initialise the options first");
    if (options->rungs > LG_TRIAL_REPORTS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "rungs: %u is too large; at most %d are possible",
                       options->rungs, LG_TRIAL_REPORTS);
    if (!(options->quantile > 0 && options->quantile <= 1))
        return lg_fail(error, LG_INVALID_ARGUMENT, "quantile: %g is outside (0, 1]", options->quantile);
    if (lg_search_sampler_name(options->sampler) == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "there is no sampler %u", options->sampler);
    return LG_OK;
}

/* Writes to `why` why a trial has failed, unless its run has done so. */
static void explain(const lg_trial *trial, lg_status status, lg_error *why) {
    if (status == LG_OK) /* the run itself reported no error */
        (void)lg_fail(why, LG_NOT_FINITE, "trial %llu: the objective is not finite",
                      (unsigned long long)trial->number);
    else if (why->message[0] == '\0')
        (void)lg_fail(why, status, "trial %llu: %s", (unsigned long long)trial->number,
                      lg_status_sentence(status));
    why->status = status == LG_OK ? LG_NOT_FINITE : status;
}

static lg_status choose_values(const lg_search *search, const lg_search_space *space) {
    const lg_sampler *sampler = samplers[search->options->sampler];
    const lg_trial *done = NULL;
    lg_trial *trial = search->trial;
    size_t count = 0;
    const bool any = sampler->learns && search->known != NULL &&
                     search->known(search->user, trial, LG_TRIAL_BEGINS, &done, &count);
    return sampler->next(space, search->options, trial->number, done, any ? count : 0, trial->value);
}

lg_status lg_search_run_trial(const lg_search_space *space, const lg_search_options *options,
                              const lg_search_problem *problem, lg_search_known known, uint64_t number,
                              lg_trial *trial, lg_error *why) {
    lg_error unasked;
    if (why == NULL) why = &unasked;
    if (problem == NULL || problem->run == NULL || trial == NULL || options == NULL)
        return lg_fail(why, LG_INVALID_ARGUMENT,
                       "the problem, its function `run`, the options or the trials are NULL");
    LG_TRY(lg_search_space_check(space, why));
    LG_TRY(check_options(options, why));
    lg_search search = {.options = options, .trial = trial, .known = known, .user = problem->user};
    *why = (lg_error){LG_OK, ""};
    *trial = (lg_trial){.number = number, .objective = NAN};
    lg_status status = choose_values(&search, space);
    const double start = lg_seconds();
    if (status == LG_OK) status = problem->run(problem->user, &search, trial, why);
    if (trial->seconds == 0) trial->seconds = lg_seconds() - start;
    trial->number = number;
    if (status == LG_CANCELLED && search.stopped) status = LG_OK;
    if (status == LG_CANCELLED)
        return lg_fail(why, status, "the search was stopped in trial %llu", (unsigned long long)number);
    if (status == LG_OK && (search.stopped || isfinite(trial->objective))) {
        trial->state = search.stopped ? LG_TRIAL_PRUNED : LG_TRIAL_DONE;
        *why = (lg_error){LG_OK, ""};
        return LG_OK;
    }
    trial->state = LG_TRIAL_FAILED;
    trial->objective = NAN;
    explain(trial, status, why);
    return LG_OK;
}

static int by_number(const void *a, const void *b) {
    const lg_trial *x = a, *y = b;
    return (x->number > y->number) - (x->number < y->number);
}

/* Makes the trial what it would be if it had been stopped after its first `reports` reports. */
static void stop_at(lg_trial *trial, uint32_t reports) {
    trial->state = LG_TRIAL_PRUNED;
    trial->reports = reports;
    trial->objective = trial->report[reports - 1];
    trial->epochs = trial->report_epoch[reports - 1];
    for (uint32_t r = reports; r < LG_TRIAL_REPORTS; r++) trial->report[r] = 0.0;
}

/* Stops the trial where it would have stopped in a search without other processes, if it ran too long. Rungs
 * that one report passed at once are judged together, since the trial could only stop after the last of
 * them. */
static void settle(const lg_search_options *options, const lg_trial *before, lg_trial *trial) {
    for (uint32_t first = 0, end; first < trial->reports; first = end) {
        const uint64_t epoch = trial->report_epoch[first];
        bool stop = false;
        for (end = first; end < trial->reports && trial->report_epoch[end] == epoch; end++)
            stop = stop || lg_search_prune(options, before, (size_t)(trial - before), trial->number, end,
                                           trial->report[end]);
        if (!stop || epoch >= trial->planned) continue;
        stop_at(trial, end);
        return;
    }
}

void lg_search_settle(const lg_search_options *options, lg_trial *trials, size_t count) {
    qsort(trials, count, sizeof *trials, by_number);
    for (size_t i = 0; i < count; i++) {
        if (trials[i].planned > 0) settle(options, trials, &trials[i]);
        trials[i].planned = 0;
    }
}

size_t lg_search_best(const lg_trial *trials, size_t count) {
    size_t best = count;
    for (size_t i = 0; i < count; i++) {
        if (trials[i].state != LG_TRIAL_DONE || !isfinite(trials[i].objective)) continue;
        const double least = best < count ? trials[best].objective : INFINITY;
        if (trials[i].objective < least ||
            (trials[i].objective == least && trials[i].number < trials[best].number))
            best = i;
    }
    return best;
}

/* Sweeps: trials of settings, and the table of these trials. */
#include "common/sweep.h"

#include <stdlib.h>
#include <string.h>

#include "nn/search.h"

/* The result of a trial as processes exchange it. */
typedef struct posted {
    lg_trial trial;
    char why[256]; /* why the trial failed */
} posted;

static void warn(sweep *self, const posted *p) {
    if (self->failure.status == LG_OK) {
        self->failed = (size_t)p->trial.number;
        (void)lg_fail(&self->failure, LG_NO_CONVERGENCE, "%s", p->why);
    }
    app_warn(self->app, "trial %llu failed: %s", (unsigned long long)p->trial.number, p->why);
}

void sweep_values(const sweep *self, uint64_t number, double *value) {
    (void)lg_search_sampler(self->options.sampler)
        ->next(&self->file->space, &self->options, number, NULL, 0, value);
}

/* Whether the trial has the values that the sampler gives it; true if they do not depend on --trials. */
static bool is_planned(const sweep *self, const lg_trial *trial) {
    double value[LG_RANGE_MAX];
    if (!lg_search_sampler(self->options.sampler)->planned) return true;
    sweep_values(self, trial->number, value);
    return memcmp(value, trial->value, self->file->space.count * sizeof *value) == 0;
}

static bool take_trial(void *user, size_t item, void *record, bool done, bool own) {
    sweep *self = user;
    posted *p = record;
    if (!own && (memchr(p->why, '\0', sizeof p->why) == NULL || p->trial.number != item ||
                 !lg_trial_is_possible(self->file, &p->trial) || !is_planned(self, &p->trial)))
        return false;
    if (!own) (void)lg_tame(p->why);
    self->results[item] = p->trial;
    const bool task = self->work.values->task != NULL || self->work.child;
    if (done && !task && self->file->layout == NULL && p->trial.state == LG_TRIAL_FAILED) warn(self, p);
    if (own)
        app_progress_show(&self->progress, trials_known(&self->work), "%s: objective %.3g", self->work.noun,
                          p->trial.objective);
    return true;
}

/* Collects the trials that are done or have passed the rung, of the first `end`. */
static void collect(sweep *self, size_t end, uint32_t rung) {
    self->count = 0;
    for (size_t i = 0; i < end; i++)
        if (self->work.known[i] || self->results[i].reports > rung)
            self->trials[self->count++] = self->results[i];
    lg_search_settle(&self->options, self->trials, self->count);
}

static lg_status save(void *user, lg_error *error) {
    sweep *self = user;
    collect(self, self->work.count, LG_TRIAL_BEGINS);
    if (self->written == self->count) return LG_OK;
    self->written = self->count;
    return lg_trials_write(self->app->context, self->work.out, self->file, self->options.seed, self->setting,
                           self->trials, self->count, error);
}

/* Waits for the trials from which trial `number` learns, and returns how many these are: all before it, but
 * with J jobs not the J - 1 last ones, which may be running. Tasks and ranks take what they have, and do not
 * wait for each other. */
static size_t wait_before(sweep *self, size_t number) {
    const bool alone = self->work.tasks == 1;
    const size_t last = alone ? (size_t)self->work.jobs : 1, end = number + 1 > last ? number + 1 - last : 0;
    self->stopped = !trials_wait(&self->work, alone ? end : 0);
    return end;
}

/* Shows the trial's progress to the other processes. Returns true if all trials with lower numbers are done
 * or have also passed this rung; then these trials are in *before. */
static bool known_before(void *user, const lg_trial *trial, uint32_t rung, const lg_trial **before,
                         size_t *count) {
    sweep *self = user;
    const posted piece = {.trial = *trial};
    size_t end = (size_t)trial->number;
    if (rung == LG_TRIAL_BEGINS)
        end = wait_before(self, end);
    else
        trials_exchange(&self->work, end, &piece);
    collect(self, end, rung);
    *before = self->trials;
    *count = self->count;
    return rung == LG_TRIAL_BEGINS || self->count == end;
}

static lg_status do_trial(void *user, size_t item, void *record, lg_error *error) {
    sweep *self = user;
    const lg_search_problem problem = {self->run, self};
    posted *p = record;
    lg_error why = {LG_OK, ""};
    lg_status status = lg_search_run_trial(&self->file->space, &self->options, &problem, known_before, item,
                                           &p->trial, &why);
    (void)snprintf(p->why, sizeof p->why, "%.*s", (int)sizeof p->why - 1, why.message);
    if (self->stopped) return lg_fail(error, LG_CANCELLED, "the search was stopped");
    const bool failed = status == LG_OK && p->trial.state == LG_TRIAL_FAILED;
    if (failed && self->ends != NULL && self->ends(why.status)) status = why.status;
    return status == LG_OK ? LG_OK : lg_fail(error, status, "%s", why.message);
}

/* Takes the trials of the table that no part has, or checks that it may be replaced. */
static lg_status read_table(sweep *self, lg_error *error) {
    const trials_work *work = &self->work;
    const lg_status status =
        lg_trials_read(self->app->context, work->out, self->file, self->options.seed, self->setting,
                       self->continues ? work->count : 0, self->trials, &self->count, error);
    if (!self->continues) {
        /* The label of a table of trials is a sure sign; a comment that begins as it does is not. */
        app_check_text(self->app, work->out,
                       status == LG_FORMAT ? "no table of trials" : "# " LG_SEARCH_SEED);
        return LG_OK;
    }
    for (size_t i = 0; i < self->count && status == LG_OK; i++) {
        const uint64_t number = self->trials[i].number;
        if (number >= work->count)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "trial %llu was already run, but only %zu trials are planned in all",
                           (unsigned long long)number, work->count);
        if (!is_planned(self, &self->trials[i]))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "trial %llu has other values than --sampler %s gives it with --trials %llu: give "
                           "the --sampler and --trials with which the search began",
                           (unsigned long long)number, lg_search_sampler_name(self->options.sampler),
                           (unsigned long long)self->options.trials);
        if (!work->known[number]) self->results[number] = self->trials[i];
        work->known[number] = true;
    }
    self->written = self->count;
    if (status == LG_OK) app_continue(work->out);
    return status == LG_NOT_FOUND ? LG_OK : status;
}

void sweep_choose(sweep *self, bool continues) {
    const app_path out = trials_choose(&self->work, NULL);
    self->continues = continues || trials_continues(&self->work);
    app_check_outputs(self->app, &out, 1);
    if (!self->continues && !app_begins(self->work.out, "# " LG_SEARCH_SEED, strlen("# " LG_SEARCH_SEED), 1))
        app_check_text(self->app, self->work.out, "no table of trials");
}

bool sweep_run(sweep *self) {
    const app *host = self->app;
    trials_work *work = &self->work;
    lg_error error = {LG_OK, ""};
    work->record = sizeof(posted);
    work->user = self;
    work->run = do_trial;
    work->take = take_trial;
    work->save = save;
    self->results = app_alloc(work->count, sizeof *self->results);
    self->trials = app_alloc(work->count, sizeof *self->trials);
    lg_search_label(self->file, self->options.seed, self->setting, self->label);
    app_must_file(host, trials_open(work, self->label, &error), &error, work->out);
    const lg_status status = read_table(self, &error);
    if (status == LG_INVALID_ARGUMENT) app_must(host, status, &error);
    app_must_file(host, status, &error, work->out);
    self->before = trials_known(work);
    app_progress_begin(&self->progress, self->before, work->count);
    const bool whole = trials_run(work);
    app_progress_end(&self->progress);
    if (!whole) return false;
    app_must_file(host, save(self, &error), &error, work->out);
    trials_end(work);
    return true;
}

void sweep_close(sweep *self) {
    free(self->results);
    free(self->trials);
    trials_close(&self->work);
}

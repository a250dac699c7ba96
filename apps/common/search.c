/* Search over the options of a program's train command. */
#include "common/search.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "nn/search.h"
#include "settings/settings.h"

enum { SHOWN_TRIALS = 10, MOST_CHECKED = 10000 };

search_values search_given;

const lg_field search_options[] = {
    LG_OPTION(search_values, trials, U64, "n",
              "Planned number of trials, including earlier trials in the table", .low = 1, .high = 1000000,
              .value = "50", .usual = true),
    APP_OUT(search_values, "FILE.csv", "Table of trials, written after each trial", .required = true,
            .usual = true),
    LG_OPTION(search_values, resume, SWITCH, NULL,
              "Continue the search of this table; without --continue an existing table is replaced, unless "
              "parts of a stopped search (FILE.part-i-of-n) lie next to it",
              .option = "continue", .usual = true),
    LG_OPTION(search_values, rungs, REALS, "R[,W[,Q]]",
              "Compare a trial with earlier trials at R points (0: never), and stop it at a point that W or "
              "more trials have passed if at least the fraction Q of them was better there (default 5,5,0.5)",
              .high = 1e6, .most = 3),
    LG_FIELD(search_values, "", "sampler", NAME, sampler, .value_name = lg_search_sampler_name,
             .value = "random", .meaning = "How the values of a trial are chosen"),
    LG_OPTION(search_values, validation, REAL, "F",
              "Fraction of the training data that is held out; the objective is the error on this part",
              .option = "validation-fraction", .low = 1e-9, .high = 0.9, .value = "0.1"),
    TRIALS_JOBS(search_values,
                "Number of simultaneous trials (default 1); each has a process and threads/jobs threads",
                .usual = true, .value = "1"),
    TRIALS_ROWS(search_values),
    LG_FIELD_END};

typedef struct searching {
    sweep sweep; /* the first member */
    const app_command *train;
    train_task *task;
    uint32_t line; /* of the option that was looked at last */
} searching;

/* ---- setting names and values as options of train ---- */

/* Returns a copy of the app whose command is `train`, to set options on. The values are stored in the
 * settings of `train` itself. */
static app virtual_begin(const searching *search) {
    app out = *search->sweep.app;
    app_choose_command(&out, search->train);
    return out;
}

static bool is_hyperparameter(const train_task *task, const app_slot *slot) {
    return slot != NULL && slot->row->group != NULL &&
           (task->recipe->trainer->held_out == NULL ||
            strcmp(slot->name, task->recipe->trainer->held_out) != 0);
}

static bool is_searched(const train_task *task, const char *method) {
    for (const char *const *each = task->searched; *each != NULL; each++)
        if (strcmp(*each, method) == 0) return true;
    return false;
}

static lg_status virtual_set(app *v, const train_task *task, const char *name, const char *text,
                             lg_error *error) {
    lg_error reason = {LG_OK, ""};
    app_slot *slot = app_find_slot(v, name);
    if (!is_hyperparameter(task, slot))
        return lg_fail(error, LG_FORMAT, "'%s' is not an option of train that changes its result", name);
    if (task->searched != NULL && strcmp(slot->name, task->recipe->trainer->method) == 0 &&
        !is_searched(task, text))
        return lg_fail(error, LG_FORMAT, "a search does not train '%s: %s'; --help names the methods", name,
                       text);
    if (app_store(slot, text, &reason) != LG_OK)
        return lg_fail(error, LG_FORMAT, "%s: %.400s", name, reason.message);
    return LG_OK;
}

static size_t entries(const searching *search) {
    return search->sweep.file->fixed_count + search->sweep.file->space.count;
}

/* The name of option i of the file, of which the fixed ones come first. Its line goes to search->line. */
static const char *entry(searching *search, size_t i) {
    const lg_search_file *file = search->sweep.file;
    const bool fixed = i < file->fixed_count;
    const size_t range = i - file->fixed_count;
    search->line = fixed ? file->fixed_line[i] : file->line[range];
    return fixed ? file->fixed_name[i] : file->space.ranges[range].name;
}

enum { NUMBER = 32 };

/* The text of option i; `value` is that of a range, the index of a choice. */
static const char *value_text(const searching *search, size_t i, double value, char number[NUMBER]) {
    const lg_search_file *file = search->sweep.file;
    if (i < file->fixed_count) return file->fixed_value[i];
    const lg_range *range = &file->space.ranges[i - file->fixed_count];
    if (range->kind == LG_RANGE_CHOICE) return range->choice[(size_t)value];
    (void)snprintf(number, NUMBER, "%.17g", value);
    return number;
}

static lg_status set_entry(searching *search, app *v, size_t i, double value, lg_error *error) {
    char number[NUMBER];
    return virtual_set(v, search->task, entry(search, i), value_text(search, i, value, number), error);
}

/* Checks that train accepts the bounds of a range, a number between them, and every choice. */
static lg_status check_range(searching *search, app *v, size_t i, lg_error *error) {
    const lg_range *range = &search->sweep.file->space.ranges[i - search->sweep.file->fixed_count];
    const bool choice = range->kind == LG_RANGE_CHOICE;
    const double between = range->low + 0.381966 * (range->high - range->low);
    const double probes[] = {range->low, range->high, range->kind == LG_RANGE_INTEGER ? range->low : between};
    const size_t count = choice ? range->choices : LG_COUNT(probes);
    for (size_t k = 0; k < count; k++) LG_TRY(set_entry(search, v, i, choice ? (double)k : probes[k], error));
    return LG_OK;
}

/* Sets the fixed options and the drawn values; `drawn` NULL: only checks the ranges. */
static lg_status set_all(searching *search, app *v, const double *drawn, lg_error *error) {
    const size_t fixed = search->sweep.file->fixed_count;
    for (size_t i = 0; i < fixed; i++) LG_TRY(set_entry(search, v, i, 0, error));
    for (size_t i = fixed; i < entries(search); i++)
        LG_TRY(drawn == NULL ? check_range(search, v, i, error)
                             : set_entry(search, v, i, drawn[i - fixed], error));
    return LG_OK;
}

/* Sets the options of a candidate and checks them as train does. An option that its method lacks is left
 * out. */
static lg_status set_candidate(searching *search, app *v, const double *drawn, lg_error *error) {
    train_task *task = search->task;
    LG_TRY(set_all(search, v, drawn, error));
    for (size_t i = 0; i < entries(search); i++) {
        app_slot *slot = app_find_slot(v, entry(search, i));
        slot->given = train_refuses(task, slot) == NULL;
    }
    const lg_status status = task->check != NULL ? task->check(v, error) : LG_OK;
    for (size_t i = 0; status != LG_OK && i < entries(search); i++) {
        const char *name = app_find_slot(v, entry(search, i))->name;
        if (strncmp(error->message + 2, name, strcspn(error->message + 2, ": ")) == 0) break;
    }
    return status == LG_OK ? LG_OK : LG_FORMAT;
}

/* Marks the options that training reads for a candidate. */
static void mark_read(searching *search, app *v, bool *read) {
    lg_error ignored;
    const bool known = train_describe(v, search->task, NULL, &ignored) == LG_OK;
    for (size_t i = 0; i < entries(search); i++)
        if (!known || train_ignores(search->task, app_find_slot(v, entry(search, i))) == NULL) read[i] = true;
    lg_training_release(&search->task->training);
}

/* Checks the candidates of a search: the combinations of all choices, at most MOST_CHECKED of them. An option
 * that none of them reads is rejected. */
static lg_status check_candidates(searching *search, lg_error *error) {
    const lg_search_space *space = &search->sweep.file->space;
    const lg_range *range = space->ranges;
    double drawn[LG_RANGE_MAX];
    bool read[2 * LG_RANGE_MAX] = {false};
    app v;
    for (size_t i = 0; i < space->count; i++) drawn[i] = range[i].low;
    for (size_t done = 0, i = 0; i < space->count; done++) {
        if (done == MOST_CHECKED) return LG_OK;
        v = virtual_begin(search);
        LG_TRY(set_candidate(search, &v, drawn, error));
        if (memchr(read, false, entries(search)) != NULL) mark_read(search, &v, read);
        for (i = 0; i < space->count; drawn[i] = range[i].low, i++)
            if (range[i].kind == LG_RANGE_CHOICE && ++drawn[i] < (double)range[i].choices) break;
    }
    const bool *unread = memchr(read, false, entries(search));
    if (unread == NULL) return LG_OK;
    const char *name = entry(search, (size_t)(unread - read));
    return lg_fail(error, LG_FORMAT, "%s: %s", name, train_ignores(search->task, app_find_slot(&v, name)));
}

/* Two spellings of an option are the same option. */
static lg_status check_spellings(searching *search, const app *v, lg_error *error) {
    for (size_t i = 0; i < entries(search); i++)
        for (size_t k = 0; k < i; k++) {
            const char *other = entry(search, k), *name = entry(search, i);
            if (app_find_slot(v, name) == app_find_slot(v, other))
                return lg_fail(error, LG_FORMAT, "'%s' is the same option as '%s': leave one out", name,
                               other);
        }
    return LG_OK;
}

/* Reads the data after the names and values are checked, because a default may depend on the data. */
static void check_and_read(searching *search) {
    lg_error error = {LG_OK, ""};
    app v = virtual_begin(search);
    lg_status status = set_all(search, &v, NULL, &error);
    if (status == LG_OK) status = check_spellings(search, &v, &error);
    if (status == LG_OK) train_read(search->sweep.app, search->task);
    if (status == LG_OK) status = check_candidates(search, &error);
    if (status != LG_OK)
        app_stop(search->sweep.app, status, "%s: line %u: %s", search->sweep.app->arguments[0], search->line,
                 error.message);
}

/* ---- one trial ---- */

/* A trial that is being trained. */
typedef struct search_trial {
    searching *search;
    lg_search *session;
    lg_trial *trial;
    app *train;
    lg_error failure; /* of an objective */
} search_trial;

static lg_status find_objective(search_trial *self) {
    self->failure.status =
        lg_training_objective(&self->search->task->training, &self->trial->objective, &self->failure);
    return self->failure.status;
}

/* Computes the objective only in epochs in which the trial passes a rung. */
static int on_epoch(void *user, const lg_fit_epoch *report) {
    search_trial *self = user;
    searching *search = self->search;
    const uint64_t parts = (uint64_t)search->sweep.options.rungs + 1, done = report->epoch,
                   total = report->epochs;
    app_progress_show(&search->sweep.progress, trials_known(&search->sweep.work),
                      "trial %llu/%llu, epoch %llu/%llu, loss %.3g",
                      (unsigned long long)self->trial->number + 1, (unsigned long long)search_given.trials,
                      (unsigned long long)done, (unsigned long long)total, report->loss);
    if (done == total || done * parts / total == (done - 1) * parts / total) return 0;
    return find_objective(self) != LG_OK ||
           lg_search_report(self->session, done, total, self->trial->objective);
}

static lg_status run_fit(search_trial *self, lg_error *error) {
    train_task *task = self->search->task;
    const lg_status learned =
        task->learn != NULL ? task->learn(self->train, self->trial, error) : LG_NOT_FOUND;
    if (learned != LG_NOT_FOUND) return learned;
    lg_fit_options options = train_fit_options(self->train, train_training(task));
    options.on_epoch = on_epoch;
    options.user = self;
    LG_TRY(train_create(task, &options, error));
    lg_fit *fit = task->training.fit;
    self->trial->parameters = lg_recipe_parameters(task->recipe, task->training.run);
    const lg_status status = lg_fit_run(fit, error);
    self->trial->epochs = lg_fit_epochs_done(fit);
    if (status == LG_OK) (void)find_objective(self);
    if (self->failure.status != LG_OK) {
        *error = self->failure;
        return error->status;
    }
    if (status != LG_OK) return status;
    (void)lg_search_report(self->session, self->trial->epochs, self->trial->epochs, self->trial->objective);
    return LG_OK;
}

static lg_status run_trial(void *user, lg_search *session, lg_trial *trial, lg_error *error) {
    searching *search = user;
    train_task *task = search->task;
    app v = virtual_begin(search);
    search_trial self = {.search = search, .session = session, .trial = trial, .train = &v};
    lg_status status = set_candidate(search, &v, trial->value, error);
    train_training(task)->seed = v.seed;
    if (status == LG_OK) status = train_describe(&v, task, NULL, error);
    if (status == LG_OK) status = lg_training_hold_out(&task->training, search_given.validation, error);
    if (status == LG_OK) status = run_fit(&self, error);
    lg_training_release(&task->training);
    app_progress_end(&search->sweep.progress);
    app_progress_begin(&search->sweep.progress, search->sweep.before, search_given.trials);
    return status;
}

/* ---- results ---- */

static int by_objective(const void *a, const void *b) {
    const lg_trial *p = *(const lg_trial *const *)a, *q = *(const lg_trial *const *)b;
    if (p->state != q->state) return (p->state > q->state) - (p->state < q->state);
    return lg_compare_doubles(&p->objective, &q->objective);
}

static void put_trial(app_json *json, const lg_search_space *space, const char *key, const lg_trial *trial) {
    app_json_open(json, key, '{');
    APP_PUT(json, LG_AS_WHOLE("trial", trial->number),
            LG_FOR_PEOPLE("state", lg_trial_state_name(trial->state)),
            LG_AS_REAL("objective", trial->objective), LG_AS_WHOLE("parameters", trial->parameters),
            LG_AS_WHOLE("epochs", trial->epochs), LG_AS_REAL("seconds", trial->seconds));
    app_json_open(json, "values", '{');
    const double *value = trial->value;
    for (const lg_range *range = space->ranges; range < space->ranges + space->count; range++, value++)
        if (range->kind == LG_RANGE_CHOICE)
            app_json_text(json, range->name, range->choice[(size_t)*value]);
        else
            app_json_real(json, range->name, *value);
    app_json_close(json, '}');
    app_json_close(json, '}');
}

static void print_trials(const sweep *self) {
    app_json *out = self->app->out;
    APP_FREE const lg_trial **order = app_alloc(self->count, sizeof *order);
    for (size_t i = 0; i < self->count; i++) order[i] = &self->trials[i];
    qsort(order, self->count, sizeof *order, by_objective);
    app_result_rows(out, NULL);
    for (size_t i = 0; i < self->count && i < SHOWN_TRIALS; i++)
        put_trial(out, &self->file->space, NULL, order[i]);
    app_result_rows_end(out);
}

/* Prints the given options that are texts or names and do not belong to the search itself; train takes them
 * too. */
static void print_given(const app *self, FILE *out) {
    char text[LG_FIELD_TEXT_SIZE];
    for (size_t i = 0; i < self->slot_count; i++) {
        const app_slot *slot = &self->slots[i];
        const bool word_like = slot->row->type == LG_FIELD_STRING || slot->row->type == LG_FIELD_NAME;
        if (!slot->given || !word_like || slot->values == &search_given || slot->values == &app_plot_given)
            continue;
        lg_field_show(slot->row, slot->values, text, sizeof text);
        char *word = app_quote(text);
        app_put(out, " --%s %s", slot->name, word);
        free(word);
    }
}

/* Prints the command line that trains with the best trial's settings. */
static void print_best(searching *search, size_t best) {
    const lg_trial *trial = &search->sweep.trials[best];
    const app *self = search->sweep.app;
    const size_t fixed = search->sweep.file->fixed_count;
    FILE *out = self->out->stream;
    app v = virtual_begin(search);
    lg_error ignored;
    char number[NUMBER];
    (void)set_candidate(search, &v, trial->value, &ignored);
    (void)train_describe(&v, search->task, NULL, &ignored);
    lg_training_release(&search->task->training);
    app_put(out, "best: trial %llu, objective %.4e; %s train", (unsigned long long)trial->number,
            trial->objective, self->program);
    for (int i = 1; i < self->argument_count; i++) {
        APP_FREE char *data = app_quote(self->arguments[i]);
        app_put(out, " %s", data);
    }
    print_given(self, out);
    for (size_t i = 0; i < entries(search); i++) {
        const char *name = entry(search, i);
        const app_slot *slot = app_find_slot(&v, name);
        const double value = i < fixed ? 0 : trial->value[i - fixed];
        if (slot->given && train_ignores(search->task, slot) == NULL)
            app_put(out, " --%s %s", name, value_text(search, i, value, number));
    }
    app_put(out, " --seed %llu --out FILE\n", (unsigned long long)self->seed);
}

static void report(searching *search, double seconds) {
    const sweep *self = &search->sweep;
    const size_t best = lg_search_best(self->trials, self->count);
    size_t states[LG_TRIAL_STATE_COUNT] = {0};
    for (size_t i = 0; i < self->count; i++) states[self->trials[i].state]++;
    app_json *json = self->app->out;
    if (!self->app->json) print_trials(self);
    app_result_line(json, "%zu trials: %zu done, %zu stopped early, %zu failed (%.1f s)", self->count,
                    states[LG_TRIAL_DONE], states[LG_TRIAL_PRUNED], states[LG_TRIAL_FAILED], seconds);
    APP_PUT(json, LG_AS_WHOLE("trials", self->count), LG_AS_WHOLE("new", self->count - self->before));
    for (int i = 0; i < LG_TRIAL_STATE_COUNT; i++)
        app_json_size(json, lg_trial_state_name((lg_trial_state)i), states[i]);
    if (best < self->count && self->app->json)
        put_trial(json, &self->file->space, "best", &self->trials[best]);
    if (best < self->count && !self->app->json) print_best(search, best);
    APP_PUT(json, LG_AS_WHOLE("seed", self->app->seed), LG_AS_WHOLE("threads", self->app->threads),
            LG_AS_TEXT("out", search_given.out), LG_AS_REAL("seconds", seconds));
}

/* ---- the plot ---- */

static void put_search(app_plot *plot, const void *user) {
    const sweep *self = user;
    app_plot_text(plot, "%zu", self->count);
    for (const lg_trial *at = self->trials; at < self->trials + self->count; at++)
        APP_PLOT_ROW(plot, 9, (double)at->number, at->state == LG_TRIAL_DONE, at->state == LG_TRIAL_PRUNED,
                     at->objective);
}

const app_plot_kind search_plots[] = {
    APP_PLOT("search", "the objective of each trial and the best so far", "search", put_search),
    {.name = NULL}};

/* ---- the command ---- */

static int none_done(const sweep *self) {
    if (self->failure.status == LG_OK)
        return app_fail(self->app, LG_NO_CONVERGENCE, "none of the %zu trials in %s was finished",
                        self->count, search_given.out);
    return app_fail(self->app, LG_NO_CONVERGENCE,
                    "none of %zu trials was finished; trial %zu failed first: %s", self->count, self->failed,
                    self->failure.message);
}

/* Takes the numbers of --rungs; missing numbers keep their defaults. */
static void take_rungs(const app *self, lg_search_options *options) {
    const lg_reals *given = &search_given.rungs;
    char text[128];
    lg_search_options_init(options);
    options->seed = self->seed;
    options->sampler = search_given.sampler;
    options->trials = search_given.trials;
    const double rungs = given->count > 0 ? given->values[0] : options->rungs,
                 warm_up = given->count > 1 ? given->values[1] : options->warm_up;
    if (given->count > 2) options->quantile = given->values[2];
    options->rungs = (uint32_t)rungs;
    options->warm_up = (uint32_t)warm_up;
    if (rungs <= LG_TRIAL_REPORTS && rungs == floor(rungs) && warm_up == floor(warm_up) &&
        options->quantile > 0 && options->quantile <= 1)
        return;
    lg_field_show(lg_field_find(search_options, "rungs"), &search_given, text, sizeof text);
    app_stop_usage(
        self,
        "--rungs: '%s' is not R,W,Q with whole numbers R (0 to %d) and W, and a Q above 0 and at most 1",
        text, LG_TRIAL_REPORTS);
}

/* A grid may have fewer points than trials are planned, or more. */
static void plan(sweep *self) {
    const lg_sampler *sampler = lg_search_sampler(self->options.sampler);
    const uint64_t planned = search_given.trials;
    double levels[LG_RANGE_MAX];
    if (sampler->points == NULL) return;
    const double points = sampler->points(&self->file->space, planned, levels);
    if (points < (double)planned) self->work.count = search_given.trials = (size_t)points;
    if (points != (double)planned)
        app_note(self->app, "the grid has %.0f points, and %zu trials are made", points, self->work.count);
}

void search_main(app *self, const app_command *train, train_task *task) {
    const char *ranges = self->arguments[0];
    APP_FREE lg_search_file *file = app_alloc(1, sizeof *file);
    searching search = {.sweep = {.app = self,
                                  .file = file,
                                  .run = run_trial,
                                  .work = {.app = self,
                                           .values = &search_given.shared,
                                           .out = search_given.out,
                                           .noun = "trials",
                                           .resume = "continue with --continue",
                                           .count = (size_t)search_given.trials,
                                           .threads = 1,
                                           .jobs = search_given.jobs}},
                        .train = train,
                        .task = task};
    take_rungs(self, &search.sweep.options);
    sweep_choose(&search.sweep, search_given.resume);
    self->continues = search.sweep.continues;
    train_begin(self, task, 1);
    APP_FILE(self, ranges, lg_search_file_read, file);
    check_and_read(&search);
    plan(&search.sweep);
    APP_FREE char *setting =
        app_format("data %s validation %.17g rungs %u warm-up %u quantile %.17g", task->training.sha256,
                   search_given.validation, search.sweep.options.rungs, search.sweep.options.warm_up,
                   search.sweep.options.quantile);
    search.sweep.setting = setting;
    const double begin = app_seconds();
    if (sweep_run(&search.sweep)) {
        app_plot_draw(self, 0, &search.sweep);
        report(&search, app_seconds() - begin);
        const size_t count = search.sweep.count;
        self->code =
            lg_search_best(search.sweep.trials, count) < count ? APP_EXIT_OK : none_done(&search.sweep);
    }
    sweep_close(&search.sweep);
    lg_training_close(&task->training);
}

/* lg-elastica search: random search over the options of train. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lg-elastica/train.h"

enum { SHOWN_TRIALS = 10 };

typedef struct search_values {
    const char *out, *plot;
    bool resume;
    uint64_t trials, rungs, warm_up;
    double quantile, validation;
} search_values;

static const app_option search_options[] = {
    APP_ROW_SIZE(search_values, trials, "trials", "n", 1, 1000000,
                 "Planned total, earlier ones included (default 50)"),
    APP_ROW_TEXT(search_values, out, "out", "FILE.csv", "The table of trials, written after each"),
    APP_ROW_FLAG(search_values, resume, "resume",
                 "Continue the search of that table; without it a table that is there is replaced"),
    APP_ROW_SIZE(search_values, rungs, "rungs", "r", 0, LG_TRIAL_REPORTS,
                 "Points of a trial where it is compared with earlier ones (default 5; 0: never)"),
    APP_ROW_SIZE(search_values, warm_up, "warm-up", "n", 0, 1000000,
                 "Trials that must have passed a rung before others are stopped there (default 5)"),
    APP_ROW_REAL(search_values, quantile, "quantile", "Q", 1e-9, 1,
                 "A trial is stopped where this part of the earlier ones was better (default 0.5)"),
    APP_ROW_REAL(search_values, validation, "validation", "F", 1e-9, 0.9,
                 "Part of the training curves that is held out: their mean squared error is the objective "
                 "(default 0.1)"),
    APP_ROW_TEXT(search_values, plot, "plot", "FILE.svg|.png", "Draw objective and best so far"),
    APP_ROW_END};

static search_values values = {.trials = 50, .rungs = 5, .warm_up = 5, .quantile = 0.5, .validation = 0.1};

typedef struct searching {
    app *app;
    const lg_elastica_data *data;
    const lg_search_file *file;
    char setting[256];
    lg_trial *trials;
    size_t count, before;
    lg_error failure; /* of the first trial that failed in this run */
    uint64_t failed;  /* its number */
    lg_error saving;  /* why the table could not be written */
    app_progress progress;
} searching;

/* One trial while it is trained. */
typedef struct trial_state {
    searching *search;
    lg_search *session;
    lg_trial *trial;
    learner learner;
    part_indices train, validation;
} trial_state;

/* ---- names and values as options of train ---- */

/* An app as if the options had been given to `train`. */
typedef struct virtual_train {
    app app;
    train_values values;
} virtual_train;

static virtual_train virtual_begin(const app *self, const train_values *defaults) {
    virtual_train out = {*self, *defaults};
    out.app.command = &train_command;
    memset(out.app.given, 0, sizeof out.app.given);
    return out;
}

static lg_status virtual_set(virtual_train *v, const char *name, const char *text, lg_error *error) {
    char message[512];
    if (!train_is_hyperparameter(name))
        return app_error(error, LG_FORMAT, "'%s' is no option of train that determines its result", name);
    for (size_t i = 0; train_options[i].name != NULL; i++) {
        if (strcmp(train_options[i].name, name) != 0) continue;
        if (!app_store(&train_options[i], text, &v->values, message, sizeof message))
            return app_error(error, LG_FORMAT, "%s: %s", name, message);
        v->app.given[i] = true;
    }
    return LG_OK;
}

static void value_text(const lg_range *range, double value, char *out, size_t size) {
    if (range->kind == LG_RANGE_CHOICE)
        (void)snprintf(out, size, "%s", range->choice[(size_t)value]);
    else
        (void)snprintf(out, size, "%.17g", value);
}

static lg_status set_fixed(virtual_train *v, const lg_search_file *file, size_t *bad, lg_error *error) {
    lg_status status = LG_OK;
    for (size_t i = 0; i < file->fixed_count && status == LG_OK; i++) {
        *bad = i;
        status = virtual_set(v, file->fixed_name[i], file->fixed_value[i], error);
    }
    return status;
}

static lg_status set_drawn(virtual_train *v, const lg_search_space *space, const double *drawn,
                           lg_error *error) {
    lg_status status = LG_OK;
    char text[64];
    for (size_t i = 0; i < space->count && status == LG_OK; i++) {
        value_text(&space->ranges[i], drawn[i], text, sizeof text);
        status = virtual_set(v, space->ranges[i].name, text, error);
    }
    return status;
}

/* The bounds, a number between them and every choice must be values that train takes. */
static lg_status check_range(virtual_train *v, const lg_range *range, lg_error *error) {
    const bool choice = range->kind == LG_RANGE_CHOICE;
    const double between = range->low + 0.381966 * (range->high - range->low);
    const double probes[] = {range->low, range->high, range->kind == LG_RANGE_INTEGER ? range->low : between};
    const size_t count = choice ? range->choices : APP_COUNT(probes);
    lg_status status = LG_OK;
    for (size_t i = 0; i < count && status == LG_OK; i++) {
        char text[64];
        value_text(range, choice ? (double)i : probes[i], text, sizeof text);
        status = virtual_set(v, range->name, text, error);
    }
    return status;
}

static int check_names(const app *self, const lg_search_file *file) {
    lg_error error = {LG_OK, ""};
    virtual_train v = virtual_begin(self, &train_given);
    const char *path = self->arguments[0];
    size_t bad = 0;
    if (set_fixed(&v, file, &bad, &error) != LG_OK)
        return app_fail(self, LG_FORMAT, "%s: line %u: %s", path, file->fixed_line[bad], error.message);
    for (size_t i = 0; i < file->space.count; i++)
        if (check_range(&v, &file->space.ranges[i], &error) != LG_OK)
            return app_fail(self, LG_FORMAT, "%s: line %u: %s", path, file->line[i], error.message);
    return APP_EXIT_OK;
}

/* ---- one trial ---- */

/* The training part without what is held out; both lists are the caller's. */
static lg_status hold_out(const lg_surrogate_run *run, part_indices *train, part_indices *held,
                          lg_error *error) {
    part_indices whole, test;
    lg_status status = split_curves(run, &whole, &test, error);
    if (status != LG_OK) return status;
    free(test.list);
    uint8_t *parts = app_alloc(whole.count, 1);
    status =
        lg_surrogate_split(whole.count, 1 - values.validation, values.validation, run->training.seed, parts);
    *train = (part_indices){app_alloc(whole.count, sizeof *train->list), 0};
    *held = (part_indices){app_alloc(whole.count, sizeof *held->list), 0};
    for (size_t i = 0; i < whole.count && status == LG_OK; i++) {
        part_indices *to = parts[i] == LG_PART_TEST ? held : train;
        to->list[to->count++] = whole.list[i];
    }
    free(parts);
    if (status == LG_OK && held->count > 0 && train->count > 0) {
        free(whole.list);
        return LG_OK;
    }
    (void)app_error(error, LG_INVALID_ARGUMENT, "--validation %g of %zu curves leaves a part without any",
                    values.validation, whole.count);
    free(whole.list);
    free(train->list);
    free(held->list);
    return LG_INVALID_ARGUMENT;
}

static double objective_of(const trial_state *state) {
    lg_surrogate_errors errors;
    const lg_status status =
        learner_errors(state->search->app->context, &state->learner, &state->validation, &errors, NULL);
    return status == LG_OK ? errors.mse : (double)NAN;
}

/* The objective is computed where a rung is passed only. */
static int on_epoch(void *user, const lg_fit_epoch *report) {
    trial_state *state = user;
    const uint64_t parts = values.rungs + 1, done = report->epoch, total = report->epochs;
    searching *search = state->search;
    app_progress_show(&search->progress, search->count, "trial %llu/%llu, epoch %llu/%llu, loss %.3g",
                      (unsigned long long)state->trial->number + 1, (unsigned long long)values.trials,
                      (unsigned long long)done, (unsigned long long)total, report->loss);
    if (done == total || done * parts / total == (done - 1) * parts / total) return 0;
    return lg_search_report(state->session, done, total, objective_of(state)) ? 1 : 0;
}

static lg_status train_trial(trial_state *state, const lg_surrogate_run *run, lg_error *error) {
    const app *self = state->search->app;
    lg_fit_options options;
    lg_fit_options_init(&options);
    lg_training_apply(&run->training, &options);
    options.threads = (int)self->threads;
    options.on_epoch = on_epoch;
    options.user = state;
    lg_status status = learner_create(self->context, run, &state->search->data->curves, &state->train,
                                      &options, &state->learner, error);
    if (status == LG_OK) status = lg_fit_run(state->learner.fit, error);
    state->trial->parameters = lg_surrogate_parameters(&run->model);
    if (state->learner.fit != NULL) state->trial->epochs = lg_fit_epochs_done(state->learner.fit);
    if (status == LG_OK) {
        state->trial->objective = objective_of(state);
        (void)lg_search_report(state->session, run->training.epochs, run->training.epochs,
                               state->trial->objective);
    }
    learner_destroy(&state->learner);
    return status;
}

static lg_status run_trial(void *user, lg_search *session, lg_trial *trial, lg_error *error) {
    searching *search = user;
    trial_state state = {.search = search, .session = session, .trial = trial};
    virtual_train v = virtual_begin(search->app, &train_given);
    lg_surrogate_run run;
    const lg_surrogate_preset *preset;
    size_t bad;
    lg_status status = set_fixed(&v, search->file, &bad, error);
    if (status == LG_OK) status = set_drawn(&v, &search->file->space, trial->value, error);
    if (status == LG_OK) status = train_run(&v.app, &v.values, search->data, false, &run, &preset, error);
    if (status == LG_OK) status = hold_out(&run, &state.train, &state.validation, error);
    if (status != LG_OK) return status;
    status = train_trial(&state, &run, error);
    free(state.train.list);
    free(state.validation.list);
    return status;
}

static lg_status on_finished(void *user, const lg_trial *trials, size_t count, const lg_error *error) {
    searching *search = user;
    search->count = count;
    app_progress_end(&search->progress);
    if (error->status != LG_OK && search->failure.status == LG_OK) {
        search->failure = *error;
        search->failed = trials[count - 1].number;
    }
    if (error->status != LG_OK)
        app_warn(search->app, "trial %llu failed: %s", (unsigned long long)trials[count - 1].number,
                 error->message);
    app_progress_begin(&search->progress, search->before, values.trials);
    return lg_trials_write(search->app->context, values.out, search->file, search->app->seed, search->setting,
                           trials, count, &search->saving);
}

/* ---- results ---- */

static int by_objective(const void *a, const void *b) {
    const lg_trial *p = *(const lg_trial *const *)a, *q = *(const lg_trial *const *)b;
    if (p->state != q->state) return (p->state > q->state) - (p->state < q->state);
    return app_compare_doubles(&p->objective, &q->objective);
}

static void print_trials(const searching *search) {
    const lg_search_space *space = &search->file->space;
    const lg_trial **order = app_alloc(search->count, sizeof *order);
    app_table table;
    char text[64];
    for (size_t i = 0; i < search->count; i++) order[i] = &search->trials[i];
    qsort(order, search->count, sizeof *order, by_objective);
    app_table_begin(&table, 5 + space->count);
    static const char *const heads[] = {"trial", "state", "objective", "parameters", "seconds"};
    for (size_t c = 0; c < APP_COUNT(heads); c++) app_table_cell(&table, "%s", heads[c]);
    for (size_t c = 0; c < space->count; c++) app_table_cell(&table, "%s", space->ranges[c].name);
    for (size_t i = 0; i < search->count && i < SHOWN_TRIALS; i++) {
        app_table_cell(&table, "%llu", (unsigned long long)order[i]->number);
        app_table_cell(&table, "%s", lg_trial_state_name(order[i]->state));
        app_table_cell(&table, "%.4e", order[i]->objective);
        app_table_cell(&table, "%llu", (unsigned long long)order[i]->parameters);
        app_table_cell(&table, "%.1f", order[i]->seconds);
        for (size_t c = 0; c < space->count; c++) {
            if (space->ranges[c].kind == LG_RANGE_CHOICE)
                value_text(&space->ranges[c], order[i]->value[c], text, sizeof text);
            else
                (void)snprintf(text, sizeof text, "%.6g", order[i]->value[c]);
            app_table_cell(&table, "%s", text);
        }
    }
    app_table_end(&table, stdout);
    free(order);
}

/* The best trial's settings as words of a command line. */
static void print_best(const searching *search, size_t best) {
    const lg_search_file *file = search->file;
    char text[64];
    (void)printf("best: trial %llu, objective %.4e; lg-elastica train %s",
                 (unsigned long long)search->trials[best].number, search->trials[best].objective,
                 search->app->arguments[1]);
    for (size_t i = 0; i < file->fixed_count; i++)
        (void)printf(" --%s %s", file->fixed_name[i], file->fixed_value[i]);
    for (size_t i = 0; i < file->space.count; i++) {
        value_text(&file->space.ranges[i], search->trials[best].value[i], text, sizeof text);
        (void)printf(" --%s %s", file->space.ranges[i].name, text);
    }
    (void)printf(" --seed %llu --out FILE\n", (unsigned long long)search->app->seed);
}

static size_t count_state(const searching *search, lg_trial_state state) {
    size_t n = 0;
    for (size_t i = 0; i < search->count; i++) n += search->trials[i].state == state;
    return n;
}

static void json_best(app_json *json, const searching *search, size_t best) {
    const lg_search_space *space = &search->file->space;
    const lg_trial *trial = &search->trials[best];
    app_json_open(json, "best", '{');
    app_json_size(json, "trial", trial->number);
    app_json_real(json, "objective", trial->objective);
    app_json_size(json, "parameters", trial->parameters);
    app_json_size(json, "epochs", trial->epochs);
    app_json_real(json, "seconds", trial->seconds);
    app_json_open(json, "values", '{');
    for (size_t i = 0; i < space->count; i++)
        if (space->ranges[i].kind == LG_RANGE_CHOICE)
            app_json_text(json, space->ranges[i].name, space->ranges[i].choice[(size_t)trial->value[i]]);
        else
            app_json_real(json, space->ranges[i].name, trial->value[i]);
    app_json_close(json, '}');
    app_json_close(json, '}');
}

static void report(const searching *search, double seconds) {
    const size_t best = lg_search_best(search->trials, search->count);
    if (!search->app->json) {
        print_trials(search);
        (void)printf("%zu trials: %zu done, %zu stopped early, %zu failed (%.1f s)\n", search->count,
                     count_state(search, LG_TRIAL_DONE), count_state(search, LG_TRIAL_PRUNED),
                     count_state(search, LG_TRIAL_FAILED), seconds);
        if (best < search->count) print_best(search, best);
        return;
    }
    app_json json;
    app_json_begin(&json);
    app_json_size(&json, "trials", search->count);
    app_json_size(&json, "new", search->count - search->before);
    app_json_size(&json, "done", count_state(search, LG_TRIAL_DONE));
    app_json_size(&json, "pruned", count_state(search, LG_TRIAL_PRUNED));
    app_json_size(&json, "failed", count_state(search, LG_TRIAL_FAILED));
    if (best < search->count) json_best(&json, search, best);
    app_json_size(&json, "seed", search->app->seed);
    app_json_size(&json, "threads", search->app->threads);
    app_json_text(&json, "out", values.out);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

/* ---- the command ---- */

static int read_trials(searching *search) {
    const app *self = search->app;
    lg_error error = {LG_OK, ""};
    if (!values.resume) return APP_EXIT_OK;
    const lg_status status =
        lg_trials_read(self->context, values.out, search->file, self->seed, search->setting, search->trials,
                       (size_t)values.trials, &search->count, &error);
    search->before = search->count;
    if (status == LG_OK || status == LG_NOT_FOUND) return APP_EXIT_OK;
    if (status == LG_INVALID_ARGUMENT) return app_fail(self, status, "%s", error.message);
    return app_fail_file(self, status, &error, values.out);
}

static int none_done(const searching *search) {
    if (search->failure.status == LG_OK)
        return app_fail(search->app, LG_NO_CONVERGENCE, "none of the %zu trials in %s was done",
                        search->count, values.out);
    return app_fail(search->app, LG_NO_CONVERGENCE,
                    "none of %zu trials was done; trial %llu failed first: %s", search->count,
                    (unsigned long long)search->failed, search->failure.message);
}

static int run_search(searching *search) {
    const app *self = search->app;
    lg_error error = {LG_OK, ""};
    lg_search_options options;
    const lg_search_problem problem = {run_trial, on_finished, search};
    lg_search_options_init(&options);
    options.trials = values.trials;
    options.seed = self->seed;
    options.rungs = (uint32_t)values.rungs;
    options.warm_up = (uint32_t)values.warm_up;
    options.quantile = values.quantile;
    const double begin = app_seconds();
    app_progress_begin(&search->progress, search->before, values.trials);
    lg_status status = lg_search_run(self->context, &search->file->space, &options, &problem, search->trials,
                                     &search->count, &error);
    app_progress_end(&search->progress);
    if (status == LG_CANCELLED) {
        (void)fprintf(stderr, "%s: stopped after %zu of %llu trials; continue with --resume\n", self->title,
                      search->count, (unsigned long long)values.trials);
        return APP_EXIT_INTERRUPTED;
    }
    if (search->saving.status != LG_OK)
        return app_fail_file(self, search->saving.status, &search->saving, values.out);
    if (status != LG_OK)
        return app_fail(self, status, "%s",
                        error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    if (values.plot != NULL) {
        status = draw_search(self, values.plot, search->trials, search->count, &error);
        if (status != LG_OK) return app_fail_file(self, status, &error, values.plot);
    }
    report(search, app_seconds() - begin);
    return lg_search_best(search->trials, search->count) < search->count ? APP_EXIT_OK : none_done(search);
}

static int run(app *self) {
    const app_path paths[] = {{"out", values.out, APP_WRITTEN}, {"plot", values.plot, APP_DRAWN}};
    lg_error error = {LG_OK, ""};
    lg_elastica_data data;
    if (values.out == NULL) return app_usage(self, "--out FILE.csv is missing");
    int code = app_check_outputs(self, paths, APP_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    lg_search_file *file = app_alloc(1, sizeof *file);
    const lg_status status = lg_search_file_read(self->context, self->arguments[0], file, &error);
    if (status != LG_OK) code = app_fail_file(self, status, &error, self->arguments[0]);
    if (code == APP_EXIT_OK) code = check_names(self, file);
    if (code == APP_EXIT_OK) code = read_curves(self, self->arguments[1], &data);
    if (code == APP_EXIT_OK) {
        searching search = {.app = self,
                            .data = &data,
                            .file = file,
                            .trials = app_alloc((size_t)values.trials, sizeof *search.trials)};
        (void)snprintf(search.setting, sizeof search.setting,
                       "data %s validation %.17g rungs %llu warm-up %llu quantile %.17g", data.sha256,
                       values.validation, (unsigned long long)values.rungs,
                       (unsigned long long)values.warm_up, values.quantile);
        code = read_trials(&search);
        if (code == APP_EXIT_OK) code = run_search(&search);
        free(search.trials);
        lg_elastica_data_free(self->context, &data);
    }
    free(file);
    return code;
}

const app_command search_command = {
    .name = "search",
    .arguments = "RANGES.yaml DATA.h5",
    .summary = "Random search over the options of train",
    .details =
        "The file has `ranges`, options of train each with one of {uniform: [a, b]}, {log-uniform: [a, b]}, "
        "{integer: [a, b]}, {choice: [a, ...]}, and `fixed`, options with a value; what neither says is the "
        "preset's. A trial depends on the seed and its number alone. One that fails is kept as such; exit "
        "code 4 when none was done. Ctrl-C keeps the finished trials and ends with exit code 130; --resume "
        "continues to the same table.",
    .options = search_options,
    .values = &values,
    .arguments_min = 2,
    .arguments_max = 2,
    .run = run};

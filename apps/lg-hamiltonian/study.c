/* lg-hamiltonian study: a sweep over a grid of trainings. A cell is all repeats of one combination. */
#include "common/sweep.h"
#include "hamiltonian/files/recipe.h"
#include "lg-hamiltonian/training.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct study_values {
    const char *out;
    uint64_t jobs, stop_after;
    trials_values shared;
} study_values;

static const lg_field study_options[] = {
    APP_OUT(study_values, "FILE.csv", "Table of runs; runs that are in it already are not repeated",
            .required = true),
    TRIALS_JOBS(study_values,
                "Number of simultaneous runs (default: --threads); each uses threads/jobs threads"),
    APP_STOP_AFTER(study_values, "Stop after n new runs"), TRIALS_ROWS(study_values), LG_FIELD_END};

static study_values values;

/* The ranges of the grid, the fastest varying last; so the first runs are one of each cell. */
enum { REPEAT, EPS, N, M, PENALTY, SUBSTEPS, INTEGRATOR, RANGES };
static const char *const range_names[RANGES] = {"repeat",  "eps",      "N",         "M",
                                                "penalty", "substeps", "integrator"};
/* The results of a run; the first ones are reports of its trial. */
enum { LOSS, E1, E2, REPORTS, SECONDS = REPORTS, MEASURES };
static const char *const measure_names[MEASURES] = {"loss", "E1", "E2", "seconds"};
static const char *const columns[] = {"integrator", "substeps", "N",        "M",  "eps", "penalty",
                                      "repeat",     "seed",     "loss",     "E1", "E2",  "seconds",
                                      "epochs",     "status",   "protocol", NULL};

typedef struct study {
    sweep sweep; /* the first member */
    lg_grid grid;
    lg_search_file file;
    lg_trial_layout layout;
    lg_text setting;
    uint64_t threads_each;
} study;

/* Returns the value of a range that is a list, as text. `at`: the values of a trial. */
static const char *text_of(const study *self, const double *at, int range) {
    return self->file.space.ranges[range].choice[(size_t)at[range]];
}

/* Returns the value of a range that is a list of numbers. */
static double value_of(const study *self, const double *at, int range) {
    double value = 0;
    (void)lg_number_parse(text_of(self, at, range), &value);
    return value;
}

/* ---- the grid ---- */

/* Returns all settings that the runs depend on and that are not columns. Files are given by their hash. */
static lg_text setting_of(const lg_grid *grid) {
    const lg_scene *scene = &grid->scene;
    const lg_system *system = scene->system;
    const lg_hamiltonian_run *run = &grid->run;
    char value[LG_FIELD_TEXT_SIZE];
    lg_text text = app_text();
    lg_text_add(&text, "%s %zu;", lg_system_name(system), lg_system_links(system));
    for (size_t i = 0; i < lg_system_parameter_count(system); i++)
        lg_text_add(&text, " %.17g", lg_system_parameter_values(system)[i]);
    lg_text_add(&text, "; %d %.17g %.17g %u %.17g; %.17g %d %u %u %llu",
                scene->has_starts ? (int)scene->starts : -1, scene->low, scene->high, scene->segments,
                scene->ahead, grid->t_end, (int)grid->noise_kind, grid->test_trajectories, grid->test_points,
                (unsigned long long)grid->seed);
    for (const lg_field *row = lg_hamiltonian_fields; row->name != NULL; row++) {
        if (!lg_grid_shares(row)) continue;
        lg_field_show(row, run, value, sizeof value);
        const bool in_file = strcmp(value, run->penalty_integral) == 0 && run->penalty_sha256[0] != '\0';
        lg_text_add(&text, "; %s %s", row->name, in_file ? run->penalty_sha256 : value);
    }
    return text;
}

/* Adds a value to a range, unless it is there. */
static void add_value(const study *self, lg_range *range, const char *text) {
    (void)snprintf(range->choice[range->choices], LG_RANGE_NAME, "%.*s", LG_RANGE_NAME - 1, text);
    uint32_t i = 0;
    while (strcmp(range->choice[i], text) != 0) i++;
    if (i < range->choices)
        app_note(self->sweep.app, "%s: %s is given twice and counts once", range->name, text);
    else
        range->high = range->choices++;
}

/* Makes the ranges of the sweep. */
static void set_ranges(study *self) {
    const lg_grid *grid = &self->grid;
    lg_search_space *space = &self->file.space;
    double list[LG_GRID_VALUES];
    char text[LG_SHORTEST];
    space->count = RANGES;
    space->ranges[REPEAT] = (lg_range){.low = 1, .high = grid->repeats};
    for (int at = 0; at < RANGES; at++) {
        lg_range *range = &space->ranges[at];
        const lg_field *key = lg_field_find(lg_grid_keys, range_names[at]);
        range->kind = at == REPEAT ? LG_RANGE_INTEGER : LG_RANGE_CHOICE;
        (void)snprintf(range->name, LG_RANGE_NAME, "%s", range_names[at]);
        for (uint32_t i = 0; key != NULL && i < lg_field_list(key, grid, list); i++) {
            lg_format_shortest(text, list[i] + 0.0, false); /* -0 is 0 */
            add_value(self, range, text);
        }
    }
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        add_value(self, &space->ranges[INTEGRATOR], grid->integrators[i]->name);
}

/* Number of values of a range that is a list. */
static size_t values_of(const study *self, int range) {
    return self->file.space.ranges[range].choices;
}

static size_t cells_of(const study *self) {
    return self->sweep.work.count / self->grid.repeats;
}

/* Loads the file of the penalty's first integral once, for its hash. */
static void read_integral(const app *self, const char *path, lg_hamiltonian_run *run) {
    lg_program *program = NULL;
    if (lg_first_integral_find(run->penalty_integral) != NULL) return;
    APP_MUST_FILE(self, path, lg_penalty_load(self->context, run, &program, &error));
    lg_program_destroy(program);
}

static void read_grid(app *self, lg_grid *grid) {
    const char *path = self->arguments[0];
    const lg_hamiltonian_family *family;
    lg_error why = {LG_OK, ""};
    uint32_t n;
    APP_FILE(self, path, lg_grid_read, grid);
    if (self->seed_given) grid->seed = self->seed;
    if (scene_family(&grid->scene, &family, &n, &why) != LG_OK)
        app_stop(self, LG_FORMAT, "%s: %s", path, why.message);
    read_integral(self, path, &grid->run);
}

/* Returns seed `kind`, 0 to 7, of a repeat. Weights, shuffling and starts depend only on it, so all runs of
 * the same repeat share them. */
enum { SEED_TRAIN, SEED_TEST, SEEDS = 8 };
static uint64_t seed_of(const study *self, const double *at, uint64_t kind) {
    lg_rng rng;
    const double repeat = fmin(fmax(at[REPEAT], 0), UINT32_MAX); /* a row of a table may have any number */
    lg_rng_seed(&rng, self->grid.seed, (uint64_t)repeat * SEEDS + kind);
    return lg_rng_next(&rng) >> 1;
}

/* Writes the seed of a run, or the protocol, a hash of all settings that are no columns. */
static void mark(void *user, const lg_trial *trial, const char *column, char text[LG_RANGE_NAME]) {
    const study *self = user;
    if (strcmp(column, "seed") == 0)
        (void)snprintf(text, LG_RANGE_NAME, "%llu",
                       (unsigned long long)seed_of(self, trial->value, SEED_TRAIN));
    else
        (void)snprintf(text, LG_RANGE_NAME, "%.12s", strrchr(self->sweep.label, ' ') + 1);
}

/* Says what the runs of the grid are. */
static void plan(study *self) {
    sweep *made = &self->sweep;
    set_ranges(self);
    made->work.count = self->grid.repeats;
    for (int range = REPEAT + 1; range < RANGES; range++) made->work.count *= values_of(self, range);
    lg_search_options_init(&made->options);
    made->options.seed = self->grid.seed;
    while (strcmp(lg_search_sampler_name(made->options.sampler), "grid") != 0) made->options.sampler++;
    made->options.trials = made->work.count;
    self->setting = setting_of(&self->grid);
    made->file = &self->file;
    made->setting = self->setting.data;
    self->file.layout = &self->layout;
    self->layout = (lg_trial_layout){.what = "a study",
                                     .columns = columns,
                                     .report_names = measure_names,
                                     .reports = REPORTS,
                                     .mark = mark,
                                     .user = self};
}

/* ---- one run ---- */

static lg_status train_and_judge(const app *self, lg_hamiltonian_run run, uint64_t threads,
                                 const lg_trajectories *data, const lg_trajectories *test, lg_trial *out,
                                 lg_error *error) {
    const lg_context *context = self->context;
    verdict result = {.e1 = 0};
    lg_hamiltonian_state state = {.data = *data};
    APP_CLEAN(lg_training_release)
    lg_training training = lg_training_of(context, &lg_recipe_hamiltonian, &run, &state);
    training.stored = &run; /* no preset changes the run */
    LG_TRY(training.recipe->trainer->describe(&training, error));
    training.options = train_fit_options(self, &run.training);
    training.options.threads = (int)threads;
    LG_TRY(lg_training_create_fit(&training, error));
    const double begin = app_seconds();
    const lg_status status = lg_fit_run(training.fit, error);
    out->seconds = app_seconds() - begin;
    LG_TRY(status);
    APP_FREE double *theta = app_alloc(training.problem.parameters, sizeof *theta);
    out->parameters = training.problem.parameters;
    out->epochs = lg_fit_epochs_done(training.fit);
    lg_fit_parameters(training.fit, theta);
    LG_TRY(lg_hamiltonian_mean_squared_error(context, &state.problem, theta, &out->report[LOSS], error));
    APP_FREE double *predicted = app_alloc(test->count * test->points * test->state_dim, sizeof *predicted);
    LG_TRY(judge(context, threads, &run.model, theta, test, default_tolerance(&run.model), predicted, &result,
                 error));
    out->report[E1] = out->objective = result.e1;
    out->report[E2] = result.e2;
    out->reports = REPORTS;
    return LG_OK;
}

static lg_status train_run(void *user, lg_search *session, lg_trial *trial, lg_error *error) {
    const study *self = user;
    const lg_grid *grid = &self->grid;
    const double *at = trial->value;
    lg_trajectory_options training = sample_options(&grid->scene), testing = training;
    training.trajectories = (size_t)value_of(self, at, N);
    training.points = (size_t)value_of(self, at, M);
    training.t_end = grid->t_end;
    training.noise = value_of(self, at, EPS);
    training.noise_kind = grid->noise_kind;
    training.seed = seed_of(self, at, SEED_TRAIN);
    testing.trajectories = grid->test_trajectories;
    testing.points = grid->test_points;
    testing.t_end = 1;
    testing.segments = 1;
    testing.seed = seed_of(self, at, SEED_TEST);
    const lg_context *context = self->sweep.app->context;
    APP_CLEAN(lg_trajectories_destroy) lg_trajectories data = {0}, test = {0};
    LG_TRY(sample_scene(context, &grid->scene, &training, &data, error));
    LG_TRY(sample_scene(context, &grid->scene, &testing, &test, error));
    lg_hamiltonian_run run = grid->run;
    run.scheme = lg_scheme_find(text_of(self, at, INTEGRATOR));
    run.substeps = (uint32_t)value_of(self, at, SUBSTEPS);
    run.penalty = value_of(self, at, PENALTY);
    run.training.seed = training.seed;
    return train_and_judge(self->sweep.app, run, self->threads_each, &data, &test, trial, error);
}

/* A run that overflows or does not converge counts as failed; any other failure ends the study. */
static bool ends(lg_status status) {
    return status != LG_NOT_FINITE && status != LG_NO_CONVERGENCE && status != LG_STEP_TOO_SMALL &&
           status != LG_TOO_MANY_STEPS;
}

/* ---- summaries ---- */

/* Medians and geometric means of the results, number of runs and of failed runs. */
typedef struct summary {
    size_t runs, failed;
    double median[MEASURES], geometric[MEASURES];
} summary;
typedef enum noise_levels { ANY_NOISE, WITHOUT, WITH } noise_levels;
/* A set has a bit for each range whose value is the same in all runs of a summary. A combination is
 * summarised over noise levels, either zero or all above zero. */
enum {
    CELL = ((1u << RANGES) - 1) & ~(1u << REPEAT),
    COMBINATION = CELL & ~(1u << EPS),
    INTEGRATORS = 1u << INTEGRATOR | 1u << SUBSTEPS
};

static bool is_chosen(const study *self, const lg_trial *run, const double *at, unsigned ranges,
                      noise_levels noise) {
    bool same = true;
    for (int range = 0; range < RANGES; range++)
        same = same && ((ranges >> range & 1) == 0 || run->value[range] == at[range]);
    return same && (noise == ANY_NOISE || (value_of(self, run->value, EPS) > 0) == (noise == WITH));
}

/* Summarises the runs that have the values `at` on these ranges (a bit for each), and such noise. */
static summary summarise(const study *self, const double *at, unsigned ranges, noise_levels noise) {
    const sweep *done = &self->sweep;
    summary s = {.runs = 0};
    APP_FREE const lg_trial **list = app_alloc(done->count, sizeof *list);
    APP_FREE double *numbers = app_alloc(done->count, sizeof *numbers);
    size_t n = 0;
    for (const lg_trial *run = done->trials; run < done->trials + done->count; run++) {
        if (!is_chosen(self, run, at, ranges, noise)) continue;
        s.runs++;
        if (run->state == LG_TRIAL_DONE) list[n++] = run;
    }
    s.failed = s.runs - n;
    for (size_t k = 0; k < MEASURES; k++) {
        double logarithm = 0;
        for (size_t i = 0; i < n; i++) {
            numbers[i] = k < REPORTS ? list[i]->report[k] : list[i]->seconds;
            logarithm += log(numbers[i]);
        }
        s.geometric[k] = n > 0 ? exp(logarithm / (double)n) : NAN;
        s.median[k] = lg_median(numbers, n);
    }
    return s;
}

/* ---- the report ---- */

enum { BEST = 5 };

typedef struct combination {
    double e1; /* first: it sorts the combinations */
    double at[RANGES];
    summary summary;
} combination;

/* Writes a table row: the values on the given ranges, the figures, and the numbers of runs and failed
 * runs. */
static void put_row(app_json *out, const study *self, const double *at, unsigned ranges, const summary *s,
                    const double *figures) {
    static const int order[] = {SUBSTEPS, N, M, EPS, PENALTY};
    app_json_open(out, NULL, '{');
    app_json_text(out, range_names[INTEGRATOR], text_of(self, at, INTEGRATOR));
    for (size_t i = 0; i < LG_COUNT(order); i++)
        if ((ranges >> order[i] & 1) != 0)
            app_json_real(out, range_names[order[i]], value_of(self, at, order[i]));
    for (size_t k = 0; k < MEASURES; k++) app_json_real(out, measure_names[k], figures[k]);
    APP_PUT(out, LG_AS_WHOLE("runs", s->runs), LG_AS_WHOLE("failed", s->failed));
    app_json_close(out, '}');
}

/* Writes the best combinations in rising order of the geometric mean of E1. */
static void put_best(app_json *out, const char *name, const study *self, noise_levels noise) {
    const size_t all = cells_of(self) / values_of(self, EPS);
    APP_FREE combination *list = app_alloc(all, sizeof *list);
    size_t n = 0;
    for (size_t i = 0; i < all; i++) {
        combination *next = &list[n];
        sweep_values(&self->sweep, i, next->at);
        next->summary = summarise(self, next->at, COMBINATION, noise);
        next->e1 = next->summary.geometric[E1];
        n += next->summary.runs > next->summary.failed;
    }
    qsort(list, n, sizeof *list, lg_compare_doubles);
    if (n > 0)
        app_result_line(out, "\nBest combinations %s noise (geometric means)",
                        noise == WITH ? "with" : "without");
    app_result_rows(out, name);
    for (size_t i = 0; i < n && i < BEST; i++)
        put_row(out, self, list[i].at, COMBINATION, &list[i].summary, list[i].summary.geometric);
    app_result_rows_end(out);
}

static void report(const study *self, double seconds) {
    const sweep *done = &self->sweep;
    const size_t integrators = values_of(self, INTEGRATOR), substeps = values_of(self, SUBSTEPS);
    app_json *out = done->app->out;
    char protocol[LG_RANGE_NAME];
    double at[RANGES];
    mark((void *)(uintptr_t)self, NULL, "protocol", protocol);
    APP_PUT(out, LG_WHOLE("planned", done->work.count, "runs of the grid"),
            LG_WHOLE("done", done->count + self->layout.other_rows, "runs of the table"),
            LG_WHOLE("new", done->work.fresh, NULL), LG_AS_TEXT("protocol", protocol));
    app_result_line(out, "\nMedians over the repeats");
    app_result_rows(out, "medians");
    for (size_t i = 0; i < cells_of(self); i++) {
        sweep_values(&self->sweep, i, at);
        const summary s = summarise(self, at, CELL, ANY_NOISE);
        if (s.runs > 0) put_row(out, self, at, CELL, &s, s.median);
    }
    app_result_rows_end(out);
    app_result_line(out, "\nGeometric means over all runs of an integrator");
    app_result_rows(out, "geometric_means");
    for (size_t i = 0; i < integrators * substeps; i++) {
        sweep_values(&self->sweep, i / substeps + i % substeps * integrators, at);
        const summary s = summarise(self, at, INTEGRATORS, ANY_NOISE);
        put_row(out, self, at, INTEGRATORS, &s, s.geometric);
    }
    app_result_rows_end(out);
    put_best(out, "best_without_noise", self, WITHOUT);
    put_best(out, "best_with_noise", self, WITH);
    APP_PUT(out, LG_AS_WHOLE("threads", done->app->threads), LG_AS_TEXT("out", values.out),
            LG_REAL("seconds", seconds, NULL));
}

/* ---- the plot: median E1 against median training time ---- */

/* Writes a block of data: the cells with integrator number i and value number m of M. A curve connects cells
 * that have the same settings except for the number of substeps. */
static void put_block(app_plot *plot, const study *self, size_t i, size_t m) {
    double at[RANGES];
    for (size_t cell = 0; cell < cells_of(self); cell++) {
        sweep_values(&self->sweep, cell, at);
        if (at[INTEGRATOR] != (double)i || at[M] != (double)m || at[SUBSTEPS] != 0) continue;
        app_plot_gap(plot);
        for (; at[SUBSTEPS] < (double)values_of(self, SUBSTEPS); at[SUBSTEPS]++) {
            const summary s = summarise(self, at, CELL, ANY_NOISE);
            if (s.runs > s.failed)
                APP_PLOT_ROW(plot, 9, s.median[SECONDS], s.median[E1], value_of(self, at, SUBSTEPS));
        }
    }
    app_plot_block(plot);
}

static void put_study(app_plot *plot, const void *user) {
    const study *self = user;
    const size_t integrators = values_of(self, INTEGRATOR), points = values_of(self, M);
    app_plot_text(plot, "%d\t%zu\t%zu", values_of(self, SUBSTEPS) > 1, integrators, points);
    for (size_t i = 0; i < integrators; i++)
        app_plot_text(plot, "%s", self->file.space.ranges[INTEGRATOR].choice[i]);
    for (size_t m = 0; m < points; m++) app_plot_text(plot, "M = %s", self->file.space.ranges[M].choice[m]);
    for (size_t i = 0; i < integrators; i++)
        for (size_t m = 0; m < points; m++) put_block(plot, self, i, m);
}

/* ---- the command ---- */

static void study_end(study *self) {
    sweep_close(&self->sweep);
    lg_text_destroy(&self->setting);
    lg_text_destroy(&self->layout.others);
    lg_grid_destroy(&self->grid);
}

static void run(app *host) {
    const double start = app_seconds();
    const uint64_t jobs = values.jobs > 0 ? values.jobs : host->threads;
    APP_CLEAN(study_end)
    study self = {.sweep = {.app = host,
                            .run = train_run,
                            .ends = ends,
                            .work = {.app = host,
                                     .values = &values.shared,
                                     .out = values.out,
                                     .noun = "runs",
                                     .resume = "the same command continues",
                                     .threads = jobs,
                                     .most = values.stop_after}},
                  .threads_each = host->threads / jobs > 0 ? host->threads / jobs : 1};
    sweep_choose(&self.sweep, true);
    read_grid(host, &self.grid);
    plan(&self);
    if (!sweep_run(&self.sweep)) return;
    app_plot_draw(host, 0, &self);
    report(&self, app_seconds() - start);
}

const app_command hamiltonian_study_command = {
    .name = "study",
    .arguments = "GRID.yaml",
    .summary = "Train over a grid of integrators, N, M, noise and repeats",
    .details =
        "The table has one row for each run: integrator, substeps, N, M, eps, penalty, repeat, seed, "
        "loss (mean squared error at the end), E1, E2, seconds of training, epochs. The table is "
        "written as runs end; the same command continues after Ctrl-C or a crash. Runs of one repeat share "
        "initial weights, starts, noise and test trajectories. The command prints medians over the "
        "repeats of each cell and geometric means over all runs of an integrator. The default seed is "
        "the grid's; other keys that it lacks have the values of train --preset thesis.",
    .settings = APP_SETTINGS(APP_GIVEN(study_options, values)),
    APP_DRAWS("median E1 against training time", "training_time", put_study),
    .run = run,
    .together = APP_RANKS};

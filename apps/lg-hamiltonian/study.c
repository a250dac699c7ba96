/* lg-hamiltonian study: a resumable grid of trainings. */
#include "common/train.h"
#include "hamiltonian/files/recipe.h"
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct study_values {
    const char *out, *plot;
    uint64_t jobs, stop_after;
    trials_values shared;
} study_values;

static const lg_field study_options[] = {
    LG_OPTION(study_values, plot, STRING, "FILE.svg|.png", "Draw median E1 against training time"),
    LG_OPTION(study_values, out, STRING, "FILE.csv",
              "Table of runs; runs that are in it already are not repeated", .required = true),
    LG_OPTION(study_values, jobs, U64, "J",
              "Number of simultaneous runs (default: --threads); each uses threads/jobs threads", .low = 1,
              .high = 256),
    LG_OPTION(study_values, stop_after, U64, "n", "Stop after n new runs", .low = 1, .high = 1e9),
    TRIALS_ROWS(study_values),
    LG_FIELD_END};

static study_values values;

enum { SEED_TEST = 1 }; /* kind of seed (study_seed) for the test trajectories; kind 0 is the row's seed */

typedef struct study {
    app *app;
    lg_grid grid;
    study_plan plan;
    study_table table;
    trials_work work;
    uint64_t threads_each;
    app_progress progress;
} study;

/* ---- the grid ---- */

/* Sets the hash of all that the runs depend on and that is no column. A file is represented by its hash. */
static void set_protocol(const lg_grid *grid, study_plan *plan) {
    static const char *const columns[] = {"integrator", "penalty", "substeps", "seed"};
    const lg_scene *scene = &grid->scene;
    const lg_system *system = scene->system;
    const lg_hamiltonian_run *run = &grid->run;
    char value[LG_FIELD_TEXT_SIZE];
    app_file memory;
    app_file_begin(&memory, "");
    FILE *text = memory.stream;
    (void)fprintf(text, "%s %zu;", lg_system_name(system), lg_system_links(system));
    for (size_t i = 0; i < lg_system_parameter_count(system); i++)
        (void)fprintf(text, " %.17g", lg_system_parameter_values(system)[i]);
    (void)fprintf(text, "; %d %.17g %.17g %u %.17g; %.17g %d %u %u %llu",
                  scene->has_starts ? (int)scene->starts : -1, scene->low, scene->high, scene->segments,
                  scene->ahead, grid->t_end, (int)grid->noise_kind, grid->test_trajectories,
                  grid->test_points, (unsigned long long)grid->seed);
    for (const lg_field *row = lg_hamiltonian_fields; row->name != NULL; row++) {
        bool column = false;
        for (size_t i = 0; i < LG_COUNT(columns); i++) column = column || strcmp(columns[i], row->name) == 0;
        if (column) continue;
        lg_field_show(row, run, value, sizeof value);
        const bool in_file = strcmp(value, run->penalty_integral) == 0 && run->penalty_sha256[0] != '\0';
        (void)fprintf(text, "; %s %s", row->name, in_file ? run->penalty_sha256 : value);
    }
    (void)fclose(text);
    study_set_protocol(plan, memory.text);
    free(memory.text);
}

static void add_wholes(study_axis *axis, const lg_wholes *list) {
    for (size_t i = 0; i < list->count; i++) study_axis_add(axis, NULL, list->values[i]);
}

static void add_reals(study_axis *axis, const lg_reals *list) {
    for (size_t i = 0; i < list->count; i++) study_axis_add(axis, NULL, list->values[i]);
}

static void make_plan(const lg_grid *grid, study_plan *plan) {
    study_axis *axes = plan->axes;
    *plan = (study_plan){.repeats = grid->repeats, .seed = grid->seed};
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        study_axis_add(&axes[AXIS_INTEGRATOR], grid->integrators[i]->name, 0);
    add_wholes(&axes[AXIS_SUBSTEPS], &grid->substeps);
    add_wholes(&axes[AXIS_N], &grid->n);
    add_wholes(&axes[AXIS_M], &grid->m);
    add_reals(&axes[AXIS_EPS], &grid->eps);
    add_reals(&axes[AXIS_PENALTY], &grid->penalty);
    set_protocol(grid, plan);
}

/* Loads the file of the penalty's first integral once, for its hash. */
static void read_integral(const app *self, const char *path, lg_hamiltonian_run *run) {
    lg_program *program = NULL;
    if (lg_penalty_named(run) != NULL) return;
    APP_MUST_FILE(self, path, lg_penalty_load(self->context, run, &program, &error));
    lg_program_destroy(program);
}

static void read_grid(app *self, lg_grid *grid) {
    const char *path = self->arguments[0];
    const lg_hamiltonian_family *family;
    lg_error why = {LG_OK, ""};
    uint32_t n;
    APP_MUST_FILE(self, path, lg_grid_read(self->context, path, grid, &error));
    if (self->seed_given) grid->seed = self->seed;
    if (scene_family(&grid->scene, &family, &n, &why) != LG_OK)
        app_stop(self, LG_FORMAT, "%s: %s", path, why.message);
    read_integral(self, path, &grid->run);
}

/* ---- one run ---- */

static double number_at(const study_plan *plan, const study_row *row, uint32_t axis) {
    return plan->axes[axis].number[row->at[axis]];
}

static lg_status train_and_judge(const app *self, lg_hamiltonian_run run, uint64_t threads,
                                 const lg_trajectories *data, const lg_trajectories *test, study_row *row,
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
    row->result[STUDY_SECONDS] = app_seconds() - begin;
    LG_TRY(status);
    APP_FREE double *theta = app_alloc(training.problem.parameters, sizeof *theta);
    row->epochs = lg_fit_epochs_done(training.fit);
    lg_fit_parameters(training.fit, theta);
    LG_TRY(
        lg_hamiltonian_mean_squared_error(context, &state.problem, theta, &row->result[STUDY_LOSS], error));
    APP_FREE double *predicted = app_alloc(test->count * test->points * test->state_dim, sizeof *predicted);
    LG_TRY(judge(context, threads, &run.model, theta, test, default_tolerance(&run.model), predicted, &result,
                 error));
    row->result[STUDY_E1] = result.e1;
    row->result[STUDY_E2] = result.e2;
    return LG_OK;
}

static lg_status train_row(const study *self, study_row *row, lg_error *error) {
    const lg_grid *grid = &self->grid;
    const study_plan *plan = &self->plan;
    lg_trajectory_options training = sample_options(&grid->scene), testing = training;
    training.trajectories = (size_t)number_at(plan, row, AXIS_N);
    training.points = (size_t)number_at(plan, row, AXIS_M);
    training.t_end = grid->t_end;
    training.noise = number_at(plan, row, AXIS_EPS);
    training.noise_kind = grid->noise_kind;
    training.seed = row->seed;
    testing.trajectories = grid->test_trajectories;
    testing.points = grid->test_points;
    testing.t_end = 1;
    testing.segments = 1;
    testing.seed = study_seed(plan->seed, row->repeat, SEED_TEST);
    const lg_context *context = self->app->context;
    APP_CLEAN(lg_trajectories_destroy) lg_trajectories data = {0}, test = {0};
    LG_TRY(sample_scene(context, &grid->scene, &training, &data, error));
    LG_TRY(sample_scene(context, &grid->scene, &testing, &test, error));
    lg_hamiltonian_run run = grid->run;
    run.scheme = grid->integrators[row->at[AXIS_INTEGRATOR]];
    run.substeps = (uint32_t)number_at(plan, row, AXIS_SUBSTEPS);
    run.penalty = number_at(plan, row, AXIS_PENALTY);
    run.training.seed = row->seed;
    return train_and_judge(self->app, run, self->threads_each, &data, &test, row, error);
}

/* A run that overflows or does not converge counts as failed in the table; any other failure ends the
 * study. */
static lg_status do_run(void *user, size_t index, void *record, lg_error *error) {
    const study *self = user;
    study_row *row = record;
    *row = study_run_at(&self->plan, index);
    const lg_status status = train_row(self, row, error);
    if (status != LG_NOT_FINITE && status != LG_NO_CONVERGENCE && status != LG_STEP_TOO_SMALL &&
        status != LG_TOO_MANY_STEPS)
        return status;
    row->failed = true;
    for (uint32_t k = 0; k < STUDY_SECONDS; k++) row->result[k] = (double)NAN;
    return LG_OK;
}

static void show_row(study *self, const study_row *row) {
    const char *text[AXES];
    for (uint32_t i = 0; i < AXES; i++) text[i] = self->plan.axes[i].text[row->at[i]];
    app_progress_show(&self->progress, self->work.fresh, "run %zu  %s N=%s M=%s eps=%s: E1 %.2e",
                      self->work.fresh, text[AXIS_INTEGRATOR], text[AXIS_N], text[AXIS_M], text[AXIS_EPS],
                      row->result[STUDY_E1]);
}

/* A record of another process must be of this run. */
static bool take_row(void *user, size_t index, void *record, bool done, bool own) {
    study *self = user;
    const study_row run = study_run_at(&self->plan, index), *row = record;
    unsigned char failed;
    memcpy(&failed, &row->failed, 1);
    if (!done || failed > 1 || row->repeat != run.repeat || memcmp(row->at, run.at, sizeof run.at) != 0)
        return false;
    self->table.rows[index] = *row;
    if (own) show_row(self, row);
    return true;
}

/* Appends the rows that are done to the table, in the order of the plan. */
static lg_status save(void *user, lg_error *error) {
    study *self = user;
    for (size_t i = 0; i < self->work.count; i++)
        if (self->work.known[i] && !self->table.done[i]) study_table_add(&self->table, i);
    return study_table_save(&self->table, error);
}

/* ---- the command ---- */

static void study_end(study *self) {
    trials_close(&self->work);
    study_table_close(&self->table);
    lg_grid_destroy(&self->grid);
}

/* Reads the table and the results of other processes. */
static void begin(study *self) {
    trials_work *work = &self->work;
    char label[LG_SHA256_TEXT];
    work->count = study_runs(&self->plan);
    APP_MUST_FILE(self->app, work->out, study_table_open(work->out, &self->plan, &self->table, &error));
    app_continue(work->out);
    trials_label(self->app, self->plan.protocol, self->app->arguments[0], label);
    APP_MUST_FILE(self->app, work->out, trials_open(work, label, &error));
    for (size_t i = 0; i < work->count; i++) work->known[i] = work->known[i] || self->table.done[i];
}

static void run(app *host) {
    const double start = app_seconds();
    const uint64_t jobs = values.jobs > 0 ? values.jobs : host->threads;
    APP_CLEAN(study_end)
    study self = {.app = host,
                  .threads_each = host->threads / jobs > 0 ? host->threads / jobs : 1,
                  .work = {.app = host,
                           .values = &values.shared,
                           .out = values.out,
                           .noun = "runs",
                           .resume = "the same command continues",
                           .record = sizeof(study_row),
                           .threads = jobs,
                           .most = values.stop_after,
                           .user = &self,
                           .run = do_run,
                           .take = take_row,
                           .save = save}};
    const app_path paths[] = {trials_choose(&self.work, LG_FILE_TEXT), {"plot", values.plot, LG_FILE_DRAWN}};
    app_check_outputs(host, paths, LG_COUNT(paths));
    read_grid(host, &self.grid);
    make_plan(&self.grid, &self.plan);
    begin(&self);
    app_progress_begin(&self.progress, 0, self.work.count - trials_known(&self.work));
    const bool whole = trials_run(&self.work);
    app_progress_end(&self.progress);
    if (!whole) return;
    APP_MUST_FILE(host, values.out, save(&self, &error));
    trials_end(&self.work);
    if (values.plot != NULL) study_draw_work(host, values.plot, &self.table);
    study_report(host, &self.table, self.work.fresh, app_seconds() - start);
}

const app_command hamiltonian_study_command = {
    .name = "study",
    .arguments = "GRID.yaml",
    .summary = "Train over a grid of integrators, N, M, noise and repeats",
    .details = "The table has one row for each run: integrator, substeps, N, "
               "M, eps, penalty, repeat, seed, loss (mean squared error at "
               "the end), E1, E2, seconds of training, epochs. Rows are "
               "appended as runs end; the same command continues after "
               "Ctrl-C or a crash. Runs of one repeat share initial weights, "
               "starts, noise and test trajectories. The command prints "
               "medians over the repeats of each cell and geometric means "
               "over all runs of an integrator. The default seed is the "
               "grid's; other keys that it lacks have the values of train "
               "--preset thesis.",
    .settings = APP_SETTINGS(APP_GIVEN(study_options, values)),
    .run = run,
    .together = APP_RANKS};

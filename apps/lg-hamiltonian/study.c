/* lg-hamiltonian study: a resumable grid of trainings. */
#include "hamiltonian/files/recipe.h"
#include "lg-hamiltonian/study.h"

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

enum { SEED_TEST = 1 }; /* kind of seed (study_seed) for the test trajectories; kind 0 is the row's seed */

typedef struct study {
    app *app;
    lg_grid grid;
    study_table table;
    trials_work work;
    uint64_t threads_each;
    app_progress progress;
} study;

/* ---- the grid ---- */

/* Sets the hash of all that the runs depend on and that is no column. A file is represented by its hash. */
static void set_protocol(const lg_grid *grid, study_table *table) {
    const lg_scene *scene = &grid->scene;
    const lg_system *system = scene->system;
    const lg_hamiltonian_run *run = &grid->run;
    char value[LG_FIELD_TEXT_SIZE];
    APP_CLEAN(lg_text_destroy) lg_text text = app_text();
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
    study_set_protocol(table, text.data);
}

static void set_axes(const lg_grid *grid, study_table *table) {
    *table = (study_table){.integrators = grid->integrators, .repeats = grid->repeats, .seed = grid->seed};
    table->count[AXIS_INTEGRATOR] = grid->integrator_count;
    for (int axis = AXIS_INTEGRATOR + 1; axis < AXES; axis++)
        table->count[axis] =
            lg_field_list(lg_field_find(lg_grid_keys, study_names[axis]), grid, table->value[axis]);
    set_protocol(grid, table);
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

/* ---- one run ---- */

static lg_status train_and_judge(const app *self, lg_hamiltonian_run run, uint64_t threads,
                                 const lg_trajectories *data, const lg_trajectories *test, study_result *out,
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
    out->value[STUDY_SECONDS] = app_seconds() - begin;
    LG_TRY(status);
    APP_FREE double *theta = app_alloc(training.problem.parameters, sizeof *theta);
    out->epochs = lg_fit_epochs_done(training.fit);
    lg_fit_parameters(training.fit, theta);
    LG_TRY(lg_hamiltonian_mean_squared_error(context, &state.problem, theta, &out->value[STUDY_LOSS], error));
    APP_FREE double *predicted = app_alloc(test->count * test->points * test->state_dim, sizeof *predicted);
    LG_TRY(judge(context, threads, &run.model, theta, test, default_tolerance(&run.model), predicted, &result,
                 error));
    out->value[STUDY_E1] = result.e1;
    out->value[STUDY_E2] = result.e2;
    return LG_OK;
}

static lg_status train_run(const study *self, size_t index, study_result *out, lg_error *error) {
    const lg_grid *grid = &self->grid;
    const study_table *table = &self->table;
    lg_trajectory_options training = sample_options(&grid->scene), testing = training;
    training.trajectories = (size_t)study_value(table, index, AXIS_N);
    training.points = (size_t)study_value(table, index, AXIS_M);
    training.t_end = grid->t_end;
    training.noise = study_value(table, index, AXIS_EPS);
    training.noise_kind = grid->noise_kind;
    training.seed = study_seed(table, index, 0);
    testing.trajectories = grid->test_trajectories;
    testing.points = grid->test_points;
    testing.t_end = 1;
    testing.segments = 1;
    testing.seed = study_seed(table, index, SEED_TEST);
    const lg_context *context = self->app->context;
    APP_CLEAN(lg_trajectories_destroy) lg_trajectories data = {0}, test = {0};
    LG_TRY(sample_scene(context, &grid->scene, &training, &data, error));
    LG_TRY(sample_scene(context, &grid->scene, &testing, &test, error));
    lg_hamiltonian_run run = grid->run;
    run.scheme = grid->integrators[study_at(table, index, AXIS_INTEGRATOR)];
    run.substeps = (uint32_t)study_value(table, index, AXIS_SUBSTEPS);
    run.penalty = study_value(table, index, AXIS_PENALTY);
    run.training.seed = training.seed;
    return train_and_judge(self->app, run, self->threads_each, &data, &test, out, error);
}

/* A run that overflows or does not converge counts as failed in the table; any other failure ends the
 * study. */
static lg_status do_run(void *user, size_t index, void *record, lg_error *error) {
    study_result *out = record;
    *out = (study_result){.run = index};
    const lg_status status = train_run(user, index, out, error);
    if (status != LG_NOT_FINITE && status != LG_NO_CONVERGENCE && status != LG_STEP_TOO_SMALL &&
        status != LG_TOO_MANY_STEPS)
        return status;
    out->failed = true;
    for (size_t k = 0; k < STUDY_SECONDS; k++) out->value[k] = NAN;
    return LG_OK;
}

/* The record of another process may hold any bytes. */
static bool take_run(void *user, size_t index, void *record, bool done, bool own) {
    study *self = user;
    const study_table *table = &self->table;
    const study_result *of = record;
    unsigned char failed;
    memcpy(&failed, &of->failed, 1);
    if (!done || failed > 1 || of->run != index) return false;
    table->results[index] = *of;
    if (own)
        app_progress_show(&self->progress, self->work.fresh, "run %zu  %s N=%g M=%g eps=%g: E1 %.2e",
                          self->work.fresh, table->integrators[study_at(table, index, AXIS_INTEGRATOR)]->name,
                          study_value(table, index, AXIS_N), study_value(table, index, AXIS_M),
                          study_value(table, index, AXIS_EPS), table->results[index].value[STUDY_E1]);
    return true;
}

/* Appends the rows that are done to the table, in the order of the runs. */
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
    work->count = study_runs(&self->table);
    APP_MUST_FILE(self->app, work->out, study_table_open(&self->table, work->out, &error));
    app_continue(work->out);
    trials_begin(work, self->table.protocol, self->app->arguments[0]);
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
                           .record = sizeof(study_result),
                           .threads = jobs,
                           .most = values.stop_after,
                           .user = &self,
                           .run = do_run,
                           .take = take_run,
                           .save = save}};
    const app_path out = trials_choose(&self.work, NULL);
    app_check_outputs(host, &out, 1);
    read_grid(host, &self.grid);
    set_axes(&self.grid, &self.table);
    begin(&self);
    app_progress_begin(&self.progress, 0, self.work.count - trials_known(&self.work));
    const bool whole = trials_run(&self.work);
    app_progress_end(&self.progress);
    if (!whole) return;
    APP_MUST_FILE(host, values.out, save(&self, &error));
    trials_end(&self.work);
    app_plot_draw(host, 0, &self.table);
    study_report(host, &self.table, self.work.fresh, app_seconds() - start);
}

const app_command hamiltonian_study_command = {
    .name = "study",
    .arguments = "GRID.yaml",
    .summary = "Train over a grid of integrators, N, M, noise and repeats",
    .details = "The table has one row for each run: integrator, substeps, N, M, eps, penalty, repeat, seed, "
               "loss (mean squared error at the end), E1, E2, seconds of training, epochs. Rows are appended "
               "as runs end; the same command continues after Ctrl-C or a crash. Runs of one repeat share "
               "initial weights, starts, noise and test trajectories. The command prints medians over the "
               "repeats of each cell and geometric means over all runs of an integrator. The default seed is "
               "the grid's; other keys that it lacks have the values of train --preset thesis.",
    .settings = APP_SETTINGS(APP_GIVEN(study_options, values)),
    APP_DRAWS("median E1 against training time", "training_time", study_put),
    .run = run,
    .together = APP_RANKS};

/* lg-hamiltonian study: a resumable grid of trainings. */
#include "common/train.h"
#include "hamiltonian/files/recipe.h"
#include "lg-hamiltonian/study.h"

#include <stdlib.h>
#include <string.h>

typedef struct plot_values {
    const char *plot;
} plot_values;

static const lg_field plot_options[] = {
    LG_OPTION(plot_values, plot, STRING, "FILE.svg|.png", "Draw median E1 against training time"),
    LG_FIELD_END};

static plot_values values;

enum { SEED_TEST = 1 }; /* kind of seed (study_seed) for the test trajectories; kind 0 is the row's seed */

/* ---- the grid ---- */

/* The values of the parameter with this key; NULL if the system has no such parameter. */
static const double *parameter_of(const lg_system *system, const char *key) {
    const lg_parameter_entry *row = lg_system_parameters(lg_system_name(system), lg_system_form(system));
    const double *numbers = lg_system_parameter_values(system);
    for (; row->key != NULL && strcmp(row->key, key) != 0; row++)
        numbers += row->count > 0 ? row->count : lg_system_links(system);
    return row->key != NULL ? numbers : NULL;
}

/* Adds the hyperparameters that grids of earlier versions did not have. One with its default value adds
 * nothing, so that the tables of those versions keep their protocol. A file is told by its hash. */
static void write_later_keys(const lg_hamiltonian_run *run, FILE *text) {
    char value[LG_FIELD_TEXT_SIZE], usual[LG_FIELD_TEXT_SIZE];
    lg_hamiltonian_run initial = *run;
    lg_fields_default(lg_hamiltonian_fields, &initial);
    for (const lg_field *row = lg_hamiltonian_fields; row->name != NULL; row++) {
        /* set_protocol writes the schedule itself. */
        if (!row->optional || strcmp(row->name, "schedule") == 0) continue;
        lg_field_show(row, run, value, sizeof value);
        lg_field_show(row, &initial, usual, sizeof usual);
        if (strcmp(value, usual) == 0) continue;
        const bool in_file = strcmp(value, run->penalty_integral) == 0 && run->penalty_sha256[0] != '\0';
        (void)fprintf(text, "; %s %s", row->name, in_file ? run->penalty_sha256 : value);
    }
}

static void set_protocol(const lg_grid *grid, study_plan *plan) {
    const lg_scene *scene = &grid->scene;
    const lg_system *system = scene->system;
    const double *gravity = parameter_of(system, "gravity"), *masses = parameter_of(system, "masses"),
                 *lengths = parameter_of(system, "lengths");
    const size_t k = lg_system_links(system), links = k > 0 ? k : lg_system_dim(system) / 2;
    app_file memory;
    app_file_begin(&memory, "");
    FILE *text = memory.stream;
    (void)fprintf(text, "%s %zu %.17g %d %.17g %.17g %u;", lg_system_name(system), links,
                  gravity != NULL ? gravity[0] : 0, scene->has_starts ? (int)scene->starts : -1, scene->low,
                  scene->high, scene->segments);
    for (size_t i = 0; i < links; i++)
        (void)fprintf(text, " %.17g %.17g", masses != NULL ? masses[i] : 0, lengths != NULL ? lengths[i] : 0);
    const lg_hamiltonian_run *run = &grid->run;
    const lg_fit_settings *how = &run->training;
    (void)fprintf(text, "; %.17g %llu %llu %llu %.17g %.17g %.17g %.17g %.17g;", grid->t_end,
                  (unsigned long long)how->epochs, (unsigned long long)how->batch,
                  (unsigned long long)how->lr_step, how->lr, how->lr_gamma, how->weight_decay, how->adam_eps,
                  how->clip);
    for (uint32_t i = 1; i < run->model.net.layers; i++) (void)fprintf(text, " %u", run->model.net.width[i]);
    (void)fprintf(text, "; %d %d %d %d %d %u %u %u %llu", (int)run->model.net.activation,
                  (int)run->model.potential, (int)how->dtype, (int)grid->noise_kind, (int)run->penalty_form,
                  how->shards, grid->test_trajectories, grid->test_points, (unsigned long long)grid->seed);
    if (how->schedule != LG_SCHEDULE_STEP || how->validation > 0)
        (void)fprintf(text, "; %d %.17g", (int)how->schedule, how->validation);
    if (scene->ahead > 0) (void)fprintf(text, "; ahead %.17g", scene->ahead);
    write_later_keys(run, text);
    (void)fclose(text);
    study_set_protocol(plan, memory.text);
    free(memory.text);
}

/* Integrators and substeps vary fastest, the noise slowest. */
static void make_plan(const lg_grid *grid, study_plan *plan) {
    const study_plan shape = {
        .axis_count = AXES,
        .axes = {[AXIS_INTEGRATOR].name = "integrator",
                 [AXIS_SUBSTEPS].name = "substeps",
                 [AXIS_N].name = "N",
                 [AXIS_M].name = "M",
                 [AXIS_EPS].name = "eps",
                 [AXIS_PENALTY].name = "penalty"},
        .order = {AXIS_INTEGRATOR, AXIS_SUBSTEPS, AXIS_PENALTY, AXIS_M, AXIS_N, AXIS_EPS},
        .measure_count = MEASURES,
        .measures = {"loss", "E1", "E2", "seconds"},
        .repeats = grid->repeats,
        .seed = grid->seed};
    *plan = shape;
    study_axis *axes = plan->axes;
    for (uint32_t i = 0; i < grid->integrator_count; i++)
        study_axis_add(&axes[AXIS_INTEGRATOR], grid->integrators[i]->name, 0);
    for (uint32_t i = 0; i < grid->substeps_count; i++)
        study_axis_add(&axes[AXIS_SUBSTEPS], NULL, grid->substeps[i]);
    for (uint32_t i = 0; i < grid->n_count; i++) study_axis_add(&axes[AXIS_N], NULL, grid->n[i]);
    for (uint32_t i = 0; i < grid->m_count; i++) study_axis_add(&axes[AXIS_M], NULL, grid->m[i]);
    for (uint32_t i = 0; i < grid->eps_count; i++) study_axis_add(&axes[AXIS_EPS], NULL, grid->eps[i]);
    for (uint32_t i = 0; i < grid->penalty_count; i++)
        study_axis_add(&axes[AXIS_PENALTY], NULL, grid->penalty[i]);
    set_protocol(grid, plan);
}

/* Loads the file of the penalty's first integral once, for its hash. */
static void read_integral(const app *self, const char *path, lg_hamiltonian_run *run) {
    lg_program *program = NULL;
    if (lg_penalty_named(run) != NULL) return;
    APP_MUST_FILE(self, path, lg_penalty_load(self->context, run, &program, &error));
    lg_program_destroy(program);
}

static void read_grid(void *user, app *self, study_plan *plan) {
    lg_grid *grid = user;
    const char *path = self->arguments[0];
    const lg_hamiltonian_family *family;
    lg_error why = {LG_OK, ""};
    uint32_t n;
    APP_MUST_FILE(self, path, lg_grid_read(self->context, path, grid, &error));
    if (self->seed_given) grid->seed = self->seed;
    if (scene_family(&grid->scene, &family, &n, &why) != LG_OK)
        app_stop(self, LG_FORMAT, "%s: %s", path, why.message);
    read_integral(self, path, &grid->run);
    make_plan(grid, plan);
}

/* ---- one run ---- */

static lg_hamiltonian_run run_of(const lg_grid *grid, const study_plan *plan, const study_row *row) {
    lg_hamiltonian_run run = grid->run;
    run.scheme = grid->integrators[row->at[AXIS_INTEGRATOR]];
    run.substeps = (uint32_t)number_at(plan, row, AXIS_SUBSTEPS);
    run.penalty = number_at(plan, row, AXIS_PENALTY);
    run.training.seed = row->seed;
    return run;
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
    LG_TRY(judge(context, threads, &run.model, theta, test, default_tolerance(&run.model), NULL, &result,
                 error));
    row->result[STUDY_E1] = result.e1;
    row->result[STUDY_E2] = result.e2;
    return LG_OK;
}

static lg_status do_run(void *user, const app *self, const study_plan *plan, uint64_t threads, study_row *row,
                        lg_error *error) {
    const lg_grid *grid = user;
    const sampling training = {(size_t)number_at(plan, row, AXIS_N),
                               (size_t)number_at(plan, row, AXIS_M),
                               grid->t_end,
                               number_at(plan, row, AXIS_EPS),
                               grid->noise_kind,
                               false,
                               row->seed};
    const sampling testing = {grid->test_trajectories,
                              grid->test_points,
                              1,
                              0,
                              LG_NOISE_NORMAL,
                              false,
                              study_seed(plan->seed, row->repeat, SEED_TEST)};
    lg_scene test_scene = grid->scene;
    test_scene.segments = 1;
    APP_CLEAN(lg_trajectories_destroy) lg_trajectories data = {0}, test = {0};
    LG_TRY(sample_scene(self->context, &grid->scene, &training, &data, error));
    LG_TRY(sample_scene(self->context, &test_scene, &testing, &test, error));
    return train_and_judge(self, run_of(grid, plan, row), threads, &data, &test, row, error);
}

static void show_row(const study_plan *plan, const study_row *row, char *text, size_t size) {
    (void)snprintf(text, size, "%s N=%s M=%s eps=%s: E1 %.2e", text_at(plan, row, AXIS_INTEGRATOR),
                   text_at(plan, row, AXIS_N), text_at(plan, row, AXIS_M), text_at(plan, row, AXIS_EPS),
                   row->result[STUDY_E1]);
}

/* ---- the command ---- */

static int run(app *host) {
    APP_CLEAN(lg_grid_destroy) lg_grid grid = {.repeats = 0};
    const study_task task = {.user = &grid,
                             .read = read_grid,
                             .run = do_run,
                             .show = show_row,
                             .report = study_report,
                             .plot = values.plot,
                             .draw = study_draw_work};
    study_main(host, &task);
    return APP_EXIT_OK;
}

const app_command study_command = {.name = "study",
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
                                   .settings = APP_SETTINGS(APP_GIVEN(plot_options, values), STUDY_SHARED),
                                   .run = run,
                                   .together = APP_RANKS};

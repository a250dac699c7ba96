/* lg-hamiltonian study: a grid of trainings, resumable. */
#include "lg-hamiltonian/study.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct study_values {
    const char *out, *plot, *plot_noise, *plot_parallel;
    uint64_t jobs, stop_after;
} study_values;

static const app_option study_options[] = {
    APP_ROW_TEXT(study_values, out, "out", "FILE.csv",
                 "The table of runs; rows that it already holds are not run again"),
    APP_ROW_SIZE(study_values, jobs, "jobs", "J", 1, 256,
                 "Runs at the same time (default: --threads); each uses threads/jobs threads"),
    APP_ROW_SIZE(study_values, stop_after, "stop-after", "n", 1, 1e9, "Stop after n new runs"),
    APP_ROW_TEXT(study_values, plot, "plot", "FILE.svg|.png", "Draw median E1 against training time"),
    APP_ROW_TEXT(study_values, plot_noise, "plot-noise", "FILE.svg|.png",
                 "Draw E1 of every run against the noise"),
    APP_ROW_TEXT(study_values, plot_parallel, "plot-parallel", "FILE.svg|.png",
                 "Draw parallel coordinates of all cells"),
    APP_ROW_END};

static study_values values;

enum { SEED_TRAIN, SEED_TEST, SEED_KINDS = 8 };

typedef struct study {
    app *app;
    lg_grid grid;
    study_file file;
    uint64_t *pending; /* indices of the runs to do */
    size_t pending_count, done;
    uint64_t threads_each;
    pthread_mutex_t mutex; /* file, done, status, progress */
    lg_status status;
    lg_error error;
    app_progress progress;
} study;

/* ---- the grid ---- */

/* Weights, shuffling and starts depend on (seed of the grid, repeat) alone: the integrators of a repeat share
 * them. */
static uint64_t derived_seed(uint64_t seed, uint64_t repeat, uint64_t kind) {
    lg_rng rng;
    lg_rng_seed(&rng, seed, repeat * SEED_KINDS + kind);
    return lg_rng_next(&rng) >> 1;
}

study_row study_run_at(const lg_grid *grid, uint64_t index) {
    study_row row = {.failed = false};
    row.integrator = grid->integrators[index % grid->integrator_count];
    index /= grid->integrator_count;
    row.substeps = grid->substeps[index % grid->substeps_count];
    index /= grid->substeps_count;
    row.penalty = grid->penalty[index % grid->penalty_count];
    index /= grid->penalty_count;
    row.m = grid->m[index % grid->m_count];
    index /= grid->m_count;
    row.n = grid->n[index % grid->n_count];
    index /= grid->n_count;
    row.eps = grid->eps[index % grid->eps_count];
    index /= grid->eps_count;
    row.repeat = (uint32_t)index + 1;
    row.seed = derived_seed(grid->seed, row.repeat, SEED_TRAIN);
    return row;
}

/* The numbers of a parameter; NULL when the system has none of that key. */
static const double *parameter_of(const lg_system *system, const char *key) {
    const lg_parameter_row *row = lg_system_parameters(lg_system_name(system), lg_system_form(system));
    const double *numbers = lg_system_parameter_values(system);
    for (; row->key != NULL && strcmp(row->key, key) != 0; row++)
        numbers += row->count > 0 ? row->count : lg_system_links(system);
    return row->key != NULL ? numbers : NULL;
}

void study_protocol(const lg_grid *grid, char out[STUDY_PROTOCOL_TEXT]) {
    const lg_scene *scene = &grid->scene;
    const lg_system *system = scene->system;
    const double *gravity = parameter_of(system, "gravity"), *masses = parameter_of(system, "masses"),
                 *lengths = parameter_of(system, "lengths");
    const size_t k = lg_system_links(system), links = k > 0 ? k : lg_system_dim(system) / 2;
    char hash[LG_SHA256_TEXT];
    app_file memory;
    lg_sha256 sha;
    app_file_begin(&memory, "");
    FILE *text = memory.stream;
    (void)fprintf(text, "%s %zu %.17g %d %.17g %.17g %u;", lg_system_name(system), links,
                  gravity != NULL ? gravity[0] : 0, scene->has_starts ? (int)scene->starts : -1, scene->low,
                  scene->high, scene->segments);
    for (size_t i = 0; i < links; i++)
        (void)fprintf(text, " %.17g %.17g", masses != NULL ? masses[i] : 0, lengths != NULL ? lengths[i] : 0);
    const lg_hamiltonian_run *run = &grid->run;
    const lg_training *how = &run->training;
    (void)fprintf(text, "; %.17g %llu %llu %llu %.17g %.17g %.17g %.17g %.17g;", grid->t_end,
                  (unsigned long long)how->epochs, (unsigned long long)how->batch,
                  (unsigned long long)how->lr_step, how->lr, how->lr_gamma, how->weight_decay, how->adam_eps,
                  how->clip);
    for (uint32_t i = 1; i < run->model.net.layers; i++) (void)fprintf(text, " %u", run->model.net.width[i]);
    (void)fprintf(text, "; %d %d %d %d %d %u %u %u %llu", (int)run->model.net.activation,
                  (int)run->model.potential, (int)how->dtype, (int)grid->noise_kind, (int)run->penalty_form,
                  how->shards, grid->test_trajectories, grid->test_points, (unsigned long long)grid->seed);
    /* Grids of earlier versions had neither key. */
    if (how->schedule != LG_SCHEDULE_STEP || how->validation > 0)
        (void)fprintf(text, "; %d %.17g", (int)how->schedule, how->validation);
    (void)fclose(text);
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, memory.text, strlen(memory.text));
    lg_sha256_finish(&sha, hash);
    free(memory.text);
    (void)snprintf(out, STUDY_PROTOCOL_TEXT, "%.*s", STUDY_PROTOCOL_TEXT - 1, hash);
}

/* ---- one run ---- */

static lg_hamiltonian_run run_of(const lg_grid *grid, const study_row *row) {
    lg_hamiltonian_run run = grid->run;
    run.scheme = row->integrator;
    run.substeps = row->substeps;
    run.penalty = row->penalty;
    run.training.seed = row->seed;
    return run;
}

static lg_status train_and_judge(const study *self, const lg_trajectories *data, const lg_trajectories *test,
                                 study_row *row, lg_error *error) {
    const lg_grid *grid = &self->grid;
    const lg_context *context = self->app->context;
    lg_hamiltonian_run run = run_of(grid, row);
    lg_fit_options options;
    learner learned;
    verdict result = {0, 0};
    lg_fit_options_init(&options);
    options.threads = (int)self->threads_each;
    lg_status status = describe_run(data, &run, error);
    if (status == LG_OK) status = learner_create(context, &run, data, &options, &learned, error);
    if (status != LG_OK) return status;
    const double begin = app_seconds();
    status = lg_fit_run(learned.fit, error);
    row->seconds = app_seconds() - begin;
    row->epochs = lg_fit_epochs_done(learned.fit);
    double *theta = app_alloc(lg_hamiltonian_parameters(&run.model), sizeof *theta);
    lg_fit_parameters(learned.fit, theta);
    if (status == LG_OK) status = mean_squared_error(context, &learned.problem, theta, &row->loss, error);
    if (status == LG_OK)
        status = judge(context, self->threads_each, &run.model, theta, test, default_tolerance(&run.model),
                       NULL, &result, error);
    row->e1 = result.e1;
    row->e2 = result.e2;
    free(theta);
    learner_destroy(&learned);
    return status;
}

/* A run whose numbers blow up is a result of the study; anything else ends it. */
static bool is_result(lg_status status) {
    return status == LG_NOT_FINITE || status == LG_NO_CONVERGENCE || status == LG_STEP_TOO_SMALL ||
           status == LG_TOO_MANY_STEPS;
}

static lg_status do_run(const study *self, study_row *row, lg_error *error) {
    const lg_grid *grid = &self->grid;
    const sampling training = {row->n, row->m, grid->t_end, row->eps, grid->noise_kind, row->seed};
    const sampling testing = {grid->test_trajectories,
                              grid->test_points,
                              1,
                              0,
                              LG_NOISE_NORMAL,
                              derived_seed(grid->seed, row->repeat, SEED_TEST)};
    lg_scene test_scene = grid->scene;
    test_scene.segments = 1;
    lg_trajectories data, test;
    lg_status status = sample_scene(self->app->context, &grid->scene, &training, &data, error);
    if (status != LG_OK) return status;
    status = sample_scene(self->app->context, &test_scene, &testing, &test, error);
    if (status == LG_OK) {
        status = train_and_judge(self, &data, &test, row, error);
        lg_trajectories_destroy(self->app->context, &test);
    }
    lg_trajectories_destroy(self->app->context, &data);
    return status;
}

static void run_task(void *user, size_t index) {
    study *self = user;
    (void)pthread_mutex_lock(&self->mutex);
    const bool stop = self->status != LG_OK || app_interrupted();
    (void)pthread_mutex_unlock(&self->mutex);
    if (stop) return;
    lg_error error = {LG_OK, ""};
    study_row row = study_run_at(&self->grid, self->pending[index]);
    lg_status status = do_run(self, &row, &error);
    if (is_result(status)) {
        row.failed = true;
        row.loss = row.e1 = row.e2 = (double)NAN;
        status = LG_OK;
    }
    (void)pthread_mutex_lock(&self->mutex);
    if (status == LG_OK) status = study_file_append(&self->file, &row, &error);
    if (status == LG_OK) {
        self->done++;
        app_progress_show(&self->progress, self->done, "run %zu/%zu  %s N=%u M=%u eps=%g: E1 %.2e",
                          self->done, self->pending_count, row.integrator->name, row.n, row.m, row.eps,
                          row.e1);
    } else if (self->status == LG_OK) {
        self->status = status;
        self->error = error;
    }
    (void)pthread_mutex_unlock(&self->mutex);
}

/* ---- the study ---- */

static void collect_pending(study *self) {
    const uint64_t runs = lg_grid_runs(&self->grid);
    self->pending = app_alloc((size_t)runs, sizeof *self->pending);
    for (uint64_t i = 0; i < runs; i++) {
        const study_row row = study_run_at(&self->grid, i);
        if (study_file_find(&self->file, &row) == NULL) self->pending[self->pending_count++] = i;
    }
    if (values.stop_after > 0 && self->pending_count > values.stop_after)
        self->pending_count = (size_t)values.stop_after;
}

static int run_all(study *self) {
    const uint64_t jobs = values.jobs > 0 ? values.jobs : self->app->threads;
    self->threads_each = self->app->threads / jobs > 0 ? self->app->threads / jobs : 1;
    (void)pthread_mutex_init(&self->mutex, NULL);
    app_progress_begin(&self->progress, 0, self->pending_count);
    app_parallel(jobs, self->pending_count, run_task, self);
    app_progress_end(&self->progress);
    (void)pthread_mutex_destroy(&self->mutex);
    if (app_interrupted() || self->status == LG_CANCELLED) {
        (void)fprintf(stderr, "%s: stopped; %zu of %llu runs are in %s, the same command continues\n",
                      self->app->title, self->file.count, (unsigned long long)lg_grid_runs(&self->grid),
                      self->file.path);
        return APP_EXIT_INTERRUPTED;
    }
    if (self->status != LG_OK)
        return app_fail(self->app, self->status, "%s",
                        self->error.message[0] != '\0' ? self->error.message
                                                       : lg_status_sentence(self->status));
    return APP_EXIT_OK;
}

typedef struct picture {
    const char *path;
    study_picture draw;
} picture;

static void list_pictures(picture out[3]) {
    out[0] = (picture){values.plot, study_draw_work};
    out[1] = (picture){values.plot_noise, study_draw_noise};
    out[2] = (picture){values.plot_parallel, study_draw_parallel};
}

static int check_outputs(const app *self) {
    const app_path paths[] = {{"out", values.out, APP_WRITTEN},
                              {"plot", values.plot, APP_DRAWN},
                              {"plot-noise", values.plot_noise, APP_DRAWN},
                              {"plot-parallel", values.plot_parallel, APP_DRAWN}};
    return app_check_outputs(self, paths, APP_COUNT(paths));
}

static int draw_pictures(const study *self) {
    picture pictures[3];
    lg_error error = {LG_OK, ""};
    list_pictures(pictures);
    for (size_t i = 0; i < APP_COUNT(pictures); i++) {
        if (pictures[i].path == NULL) continue;
        const lg_status status =
            pictures[i].draw(self->app, pictures[i].path, &self->grid, &self->file, &error);
        if (status != LG_OK) return app_fail_file(self->app, status, &error, pictures[i].path);
    }
    return APP_EXIT_OK;
}

static int study_with_file(study *self) {
    const double begin = app_seconds();
    collect_pending(self);
    int code = run_all(self);
    if (code == APP_EXIT_OK) code = draw_pictures(self);
    if (code == APP_EXIT_OK && self->app->json)
        study_print_json(self->app, &self->grid, &self->file, self->done, app_seconds() - begin);
    else if (code == APP_EXIT_OK)
        study_print_tables(&self->grid, &self->file);
    free(self->pending);
    return code;
}

static int study_grid(study *self) {
    app *host = self->app;
    char protocol[STUDY_PROTOCOL_TEXT];
    const lg_hamiltonian_family *family;
    uint32_t n;
    if (host->seed_given) self->grid.seed = host->seed;
    lg_status status = scene_family(&self->grid.scene, &family, &n, &self->error);
    if (status != LG_OK) return app_fail(host, LG_FORMAT, "%s: %s", host->arguments[0], self->error.message);
    study_protocol(&self->grid, protocol);
    status = study_file_open(values.out, protocol, &self->file, &self->error);
    if (status != LG_OK) return app_fail_file(host, status, &self->error, values.out);
    const int code = study_with_file(self);
    study_file_close(&self->file);
    return code;
}

static int run(app *host) {
    study self = {.app = host};
    if (values.out == NULL) return app_usage(host, "--out FILE.csv is missing");
    const int checked = check_outputs(host);
    if (checked != APP_EXIT_OK) return checked;
    const lg_status status = lg_grid_read(host->context, host->arguments[0], &self.grid, &self.error);
    if (status != LG_OK) return app_fail_file(host, status, &self.error, host->arguments[0]);
    const int code = study_grid(&self);
    lg_grid_destroy(host->context, &self.grid);
    return code;
}

const app_command study_command = {.name = "study",
                                   .arguments = "GRID.yaml",
                                   .summary = "Train over a grid of integrators, N, M, noise and repeats",
                                   .details = "One row a run: integrator, substeps, N, M, eps, penalty, "
                                              "repeat, seed, loss (mean squared error at the end), E1, "
                                              "E2, seconds of training, epochs. Rows are appended as runs "
                                              "end, so that the same command continues after "
                                              "Ctrl-C or a crash. Runs of one repeat share initial weights, "
                                              "starts, noise and test trajectories. Printed: "
                                              "medians over the repeats of each cell and geometric means "
                                              "over all runs of an integrator. The default seed is "
                                              "the grid's.",
                                   .options = study_options,
                                   .values = &values,
                                   .arguments_min = 1,
                                   .arguments_max = 1,
                                   .run = run};

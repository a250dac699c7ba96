/* lg-hamiltonian demo: samples, learns, judges and draws the spherical pendulum. */
#include "common/train.h"
#include "hamiltonian/files/recipe.h"
#include "lg-hamiltonian/training.h"

#include <stdlib.h>

typedef struct demo_values {
    const char *out;
    uint64_t epochs;
    double t_end;
} demo_values;

static const lg_field demo_options[] = {
    LG_OPTION(demo_values, out, STRING, "DIR", "Folder for data, model and pictures",
              .value = "liegrad-demo"),
    LG_OPTION(demo_values, epochs, U64, "E", "Evaluations of the loss (default 2000)", .low = 1, .high = 1e6),
    LG_OPTION(demo_values, t_end, REAL, "T", "Length of the long prediction", LG_POSITIVE, .value = "100"),
    LG_FIELD_END};

static demo_values values;

/* Published errors for CF4, N = 500, M = 5 without noise (thesis, study of section 4.4.3). */
static const double published_e1 = 1.7e-7, published_e2 = 3.4e-4;

enum { LONG_POINTS = 2001 };

typedef struct demo {
    app *app;
    lg_scene scene;
    lg_trajectories data, test;
    lg_hamiltonian_run run;
    lg_hamiltonian_state state;
    lg_training training;
    double *theta, *predicted;
    double loss, sampling_seconds, training_seconds, judging_seconds;
    verdict verdict;
    app_progress progress;
} demo;

static char *inside(const char *name) {
    return app_format("%s/%s", values.out, name);
}

static void write_data(const demo *self, const char *name, lg_trajectories *data) {
    APP_FREE char *path = inside(name);
    data->provenance = app_provenance(self->app, self->app->seed);
    APP_MUST(self->app, lg_trajectories_write(self->app->context, path, data, &error));
}

/* The spherical pendulum with m = L = g = 1. */
static void make_scene(demo *self) {
    static const double gravity = 1;
    static const lg_named_values parameters = {"gravity", &gravity, 1};
    const lg_context *context = self->app->context;
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = FORM;
    options.parameters = &parameters;
    options.parameter_count = 1;
    self->scene = (lg_scene){.segments = 1, .context = context};
    APP_MUST(self->app, lg_system_create(context, "pendulum-chain", &options, &self->scene.system, &error));
}

static void sample_all(demo *self) {
    const app *host = self->app;
    const sampling training = {500, 5, 0.1, 0, LG_NOISE_NORMAL, false, host->seed};
    const sampling test = {100, 15, 1, 0, LG_NOISE_NORMAL, false, host->seed + UINT64_C(0x9e3779b9)};
    const double begin = app_seconds();
    make_scene(self);
    APP_MUST(host, sample_scene(host->context, &self->scene, &training, &self->data, &error));
    APP_MUST(host, sample_scene(host->context, &self->scene, &test, &self->test, &error));
    write_data(self, "train.h5", &self->data);
    write_data(self, "test.h5", &self->test);
    self->sampling_seconds = app_seconds() - begin;
}

static int on_epoch(void *user, const lg_fit_epoch *report) {
    demo *self = user;
    app_progress_show(&self->progress, report->epoch, "training  epoch %llu/%llu  loss %.2e",
                      (unsigned long long)report->epoch, (unsigned long long)report->epochs, report->loss);
    return 0;
}

static void train_model(demo *self) {
    const app *host = self->app;
    lg_training *training = &self->training;
    lg_fit_settings *settings = &self->run.training;
    lg_fields_default(lg_hamiltonian_fields, &self->run);
    self->state.data = self->data;
    *training = lg_training_of(host->context, &lg_recipe_hamiltonian, &self->run, &self->state);
    training->preset = "best";
    settings->seed = host->seed;
    APP_MUST(host, training->recipe->trainer->describe(training, &error));
    if (values.epochs > 0) settings->epochs = values.epochs;
    training->options = train_fit_options(host, settings);
    training->options.on_epoch = on_epoch;
    training->options.user = self;
    APP_MUST(host, lg_training_create_fit(training, &error));
    const double begin = app_seconds();
    app_progress_begin(&self->progress, 0, settings->epochs);
    lg_error why = {LG_OK, ""};
    const lg_status status = lg_fit_run(training->fit, &why);
    app_progress_end(&self->progress);
    app_must(host, status, &why);
    self->training_seconds = app_seconds() - begin;
    self->theta = app_alloc(training->problem.parameters, sizeof *self->theta);
    lg_fit_parameters(training->fit, self->theta);
    APP_MUST(host, lg_hamiltonian_mean_squared_error(host->context, &self->state.problem, self->theta,
                                                     &self->loss, &error));
}

/* Saves the model, judges it, and records the verdict in the model's file. */
static void judge_model(demo *self) {
    const app *host = self->app;
    const lg_hamiltonian *model = &self->run.model;
    const lg_provenance provenance = app_provenance(host, self->run.training.seed);
    const double begin = app_seconds();
    APP_FREE char *path = inside("model.h5");
    APP_MUST(host, lg_training_save(&self->training, path, self->theta, &provenance, &error));
    self->predicted = app_alloc(self->test.count * self->test.points * self->test.state_dim, sizeof(double));
    APP_MUST(host, judge(host->context, host->threads, model, self->theta, &self->test,
                         default_tolerance(model), self->predicted, &self->verdict, &error));
    self->judging_seconds = app_seconds() - begin;
    APP_MUST(host, record_verdict(host->context, path, &self->run, self->theta, &self->test, &self->verdict,
                                  &error));
}

/* Draws the true and the learned energy along the learned flow from the first start of the test data. */
static void draw_long(const demo *self) {
    const app *host = self->app;
    const lg_system *system = self->scene.system;
    const size_t dim = self->test.state_dim;
    APP_FREE char *picture = inside("energy.svg");
    APP_FREE double *t = app_alloc(LONG_POINTS, sizeof *t), *y = app_alloc(LONG_POINTS * dim, sizeof *y);
    APP_FREE double *energies = app_alloc(LONG_POINTS, sizeof *energies);
    APP_FREE double *learned = app_alloc(LONG_POINTS, sizeof *learned);
    APP_FREE double *work = app_alloc(lg_system_work_size(system), 1);
    for (int i = 0; i < LONG_POINTS; i++) t[i] = values.t_end * i / (LONG_POINTS - 1);
    APP_MUST(host, learned_flow(host->context, &self->run.model, self->theta, 1e-10, self->test.data, t,
                                LONG_POINTS, y, learned, NULL, &error));
    for (size_t i = 0; i < LONG_POINTS; i++) energies[i] = lg_system_hamiltonian(system, y + i * dim, work);
    APP_MUST(host, draw_energy(host, picture, t, energies, learned, LONG_POINTS, &error));
}

static void draw_all(const demo *self) {
    const app *host = self->app;
    const lg_trajectories *test = &self->test;
    const lg_fit *fit = self->training.fit;
    APP_FREE char *sphere = inside("trajectories.svg"), *loss = inside("loss.svg");
    APP_FREE char *history = inside("loss.csv");
    APP_MUST(host, train_save_history(history, fit, &error));
    APP_MUST(host,
             draw_trajectories(
                 host, sphere,
                 "Spherical pendulum, m = L = g = 1: direction q on the unit sphere, t in [0, 1]",
                 &self->run.model, test->t, test->data, self->predicted,
                 test->count < SHOWN_TRAJECTORIES ? test->count : SHOWN_TRAJECTORIES, test->points, &error));
    APP_MUST(host, train_draw_loss(host, loss, lg_fit_history(fit, LG_FIT_LOSS), NULL,
                                   (size_t)lg_fit_epochs_done(fit), &error));
    draw_long(self);
}

static void report(const demo *self, double seconds) {
    const lg_fit *fit = self->training.fit;
    app_json out;
    app_result_begin(&out, self->app);
    app_result_line(
        &out,
        "The spherical pendulum on T*S^2, learned from %zu trajectories of %zu points on [0, 0.1] "
        "with the\ncommutator-free integrator CF4, and judged by %zu trajectories on [0, 1].\n",
        self->data.count, self->data.points, self->test.count);
    app_result_real(&out, "E1", self->verdict.e1, "mean squared error of the flow");
    app_result_real(&out, "E2", self->verdict.e2, "mean deviation of the Hamiltonian");
    app_result_real(&out, "published_E1", published_e1, NULL);
    app_result_real(&out, "published_E2", published_e2, NULL);
    app_result_real(&out, "loss", self->loss, "mean squared error on the training data");
    app_result_size(&out, "epochs", lg_fit_epochs_done(fit), NULL);
    app_result_real(&out, "seconds_per_epoch", lg_fit_seconds_per_epoch(fit), NULL);
    app_result_size(&out, "threads", self->app->threads, NULL);
    app_result_size(&out, "seed", self->app->seed, NULL);
    app_result_text(&out, "out", values.out, NULL);
    app_result_real(&out, "seconds", seconds, NULL);
    app_result_line(&out,
                    "\n%.1f s of sampling, %.1f s of training, %.1f s of judging. In %s:\n"
                    "  train.h5  test.h5   the data\n"
                    "  model.h5            the learned Hamiltonian, E1 and E2 on record\n"
                    "  trajectories.svg    true and predicted, on the sphere\n"
                    "  loss.svg  loss.csv  the training loss\n"
                    "  energy.svg          the energy along a prediction to t = %g",
                    self->sampling_seconds, self->training_seconds, self->judging_seconds, values.out,
                    values.t_end);
    app_json_end(&out);
}

static void demo_end(demo *self) {
    if (self->training.recipe != NULL) lg_training_release(&self->training);
    lg_trajectories_destroy(&self->data);
    lg_trajectories_destroy(&self->test);
    lg_scene_destroy(&self->scene);
    free(self->theta);
    free(self->predicted);
}

static int check_outputs(const app *host) {
    app_path paths[] = {{"out", "train.h5", LG_FILE_WRITTEN},       {"out", "test.h5", LG_FILE_WRITTEN},
                        {"out", "model.h5", LG_FILE_WRITTEN},       {"out", "loss.csv", LG_FILE_TEXT},
                        {"out", "trajectories.svg", LG_FILE_DRAWN}, {"out", "loss.svg", LG_FILE_DRAWN},
                        {"out", "energy.svg", LG_FILE_DRAWN}};
    for (size_t i = 0; i < LG_COUNT(paths); i++) paths[i].path = inside(paths[i].path);
    const int code = app_check_outputs(host, paths, LG_COUNT(paths));
    if (code == APP_EXIT_OK) app_check_text(host, paths[3].path, TRAIN_HISTORY);
    for (size_t i = 0; i < LG_COUNT(paths); i++) free((void *)(uintptr_t)paths[i].path);
    return code;
}

static int run(app *host) {
    APP_CLEAN(demo_end) demo self = {.app = host};
    const double begin = app_seconds();
    APP_MUST_FILE(host, values.out, app_make_folder(values.out, &error));
    APP_MUST_FILE(host, values.out, app_claim(host, values.out, &error));
    const int code = check_outputs(host);
    if (code != APP_EXIT_OK) return code;
    sample_all(&self);
    train_model(&self);
    judge_model(&self);
    draw_all(&self);
    report(&self, app_seconds() - begin);
    return APP_EXIT_OK;
}

const app_command demo_command = {.name = "demo",
                                  .arguments = NULL,
                                  .summary = "Learn, test and draw the spherical pendulum",
                                  .details = NULL,
                                  .settings = APP_SETTINGS(APP_GIVEN(demo_options, values)),
                                  .run = run};

/* lg-hamiltonian demo: the single spherical pendulum from nothing to pictures. */
#include "common/learn.h"
#include "hamiltonian/files/recipe.h"
#include "lg-hamiltonian/learning.h"

#include <stdlib.h>
#include <string.h>

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

/* Published for CF4, N = 500, M = 5 without noise (thesis, study of section 4.4.3). */
static const double published_e1 = 1.7e-7, published_e2 = 3.4e-4;

enum { LONG_POINTS = 2001 };

typedef struct demo {
    app *app;
    lg_scene scene;
    lg_trajectories data, test;
    lg_hamiltonian_run run;
    lg_hamiltonian_state state;
    lg_learning learning;
    double *theta, *predicted;
    double loss, sampling_seconds, training_seconds, judging_seconds;
    verdict verdict;
    app_progress progress;
    lg_error error;
} demo;

static char *inside(const char *name) {
    return app_format("%s/%s", values.out, name);
}

static lg_status write_data(demo *self, const char *name, lg_trajectories *data) {
    char *path = inside(name);
    data->provenance = app_provenance(self->app, self->app->seed);
    const lg_status status = lg_trajectories_write(self->app->context, path, data, &self->error);
    free(path);
    return status;
}

/* m = L = g = 1 */
static lg_status make_scene(demo *self) {
    static const double gravity = 1;
    static const lg_named_values parameters = {"gravity", &gravity, 1};
    lg_system_options options;
    lg_system_options_init(&options);
    options.form = FORM;
    options.parameters = &parameters;
    options.parameter_count = 1;
    self->scene = (lg_scene){.segments = 1, .context = self->app->context};
    return lg_system_create(self->app->context, "pendulum-chain", &options, &self->scene.system,
                            &self->error);
}

static lg_status sample_all(demo *self) {
    const sampling training = {500, 5, 0.1, 0, LG_NOISE_NORMAL, false, self->app->seed};
    const sampling test = {100, 15, 1, 0, LG_NOISE_NORMAL, false, self->app->seed + UINT64_C(0x9e3779b9)};
    const double begin = app_seconds();
    lg_status status = make_scene(self);
    if (status == LG_OK)
        status = sample_scene(self->app->context, &self->scene, &training, &self->data, &self->error);
    if (status == LG_OK)
        status = sample_scene(self->app->context, &self->scene, &test, &self->test, &self->error);
    if (status == LG_OK) status = write_data(self, "train.h5", &self->data);
    if (status == LG_OK) status = write_data(self, "test.h5", &self->test);
    self->sampling_seconds = app_seconds() - begin;
    return status;
}

static int on_epoch(void *user, const lg_fit_epoch *report) {
    demo *self = user;
    app_progress_show(&self->progress, report->epoch, "training  epoch %llu/%llu  loss %.2e",
                      (unsigned long long)report->epoch, (unsigned long long)report->epochs, report->loss);
    return 0;
}

static lg_status train_model(demo *self) {
    lg_learning *learning = &self->learning;
    lg_training *training = &self->run.training;
    lg_fields_default(lg_hamiltonian_fields, &self->run);
    self->state.data = self->data;
    *learning = lg_learning_of(self->app->context, &lg_recipe_hamiltonian, &self->run, &self->state);
    learning->preset = "best";
    training->seed = self->app->seed;
    lg_status status = learning->recipe->learner->describe(learning, &self->error);
    if (values.epochs > 0) training->epochs = values.epochs;
    learning->options = train_fit_options(self->app, training);
    learning->options.on_epoch = on_epoch;
    learning->options.user = self;
    if (status == LG_OK) status = lg_learning_create_fit(learning, &self->error);
    if (status != LG_OK) return status;
    const double begin = app_seconds();
    app_progress_begin(&self->progress, 0, training->epochs);
    status = lg_fit_run(self->learning.fit, &self->error);
    app_progress_end(&self->progress);
    self->training_seconds = app_seconds() - begin;
    if (status != LG_OK) return status;
    self->theta = app_alloc(learning->problem.parameters, sizeof *self->theta);
    lg_fit_parameters(learning->fit, self->theta);
    status = lg_hamiltonian_mean_squared_error(self->app->context, &self->state.problem, self->theta,
                                               &self->loss, &self->error);
    char *path = inside("model.h5");
    const lg_provenance provenance = app_provenance(self->app, training->seed);
    if (status == LG_OK) status = lg_learning_save(learning, path, self->theta, &provenance, &self->error);
    free(path);
    return status;
}

static lg_status judge_model(demo *self) {
    const lg_hamiltonian *model = &self->run.model;
    const double begin = app_seconds();
    self->predicted = app_alloc(self->test.count * self->test.points * self->test.state_dim, sizeof(double));
    const lg_status status = judge(self->app->context, self->app->threads, model, self->theta, &self->test,
                                   default_tolerance(model), self->predicted, &self->verdict, &self->error);
    self->judging_seconds = app_seconds() - begin;
    return status;
}

static lg_status record_model(demo *self) {
    char *path = inside("model.h5");
    const lg_status status = record_verdict(self->app->context, path, &self->run, self->theta, &self->test,
                                            &self->verdict, &self->error);
    free(path);
    return status;
}

/* The true and the learned energy along the learned flow of the first test start. */
static lg_status draw_long(demo *self, const char *picture) {
    const lg_hamiltonian *model = &self->run.model;
    const size_t dim = self->test.state_dim;
    double *t = app_alloc(LONG_POINTS, sizeof *t), *y = app_alloc(LONG_POINTS * dim, sizeof *y);
    double *energies = app_alloc(2 * LONG_POINTS, sizeof *energies), *work = NULL;
    const lg_system *system = self->scene.system;
    for (int i = 0; i < LONG_POINTS; i++) t[i] = values.t_end * i / (LONG_POINTS - 1);
    lg_status status = learned_flow(self->app->context, model, self->theta, 1e-10, self->test.data, t,
                                    LONG_POINTS, y, energies + LONG_POINTS, NULL, &self->error);
    if (status == LG_OK) {
        work = app_alloc(lg_system_work_size(system), 1);
        for (size_t i = 0; i < LONG_POINTS; i++)
            energies[i] = lg_system_hamiltonian(system, y + i * dim, work);
        status =
            draw_energy(self->app, picture, t, energies, energies + LONG_POINTS, LONG_POINTS, &self->error);
    }
    free(work);
    free(energies);
    free(y);
    free(t);
    return status;
}

static lg_status draw_all(demo *self) {
    char *sphere = inside("trajectories.svg"), *loss = inside("loss.svg"), *energy = inside("energy.svg");
    char *history = inside("loss.csv");
    const lg_fit *fit = self->learning.fit;
    lg_status status = train_save_history(history, fit, &self->error);
    if (status == LG_OK)
        status = draw_trajectories(
            self->app, sphere,
            "Spherical pendulum, m = L = g = 1: direction q on the unit sphere, t in [0, 1]",
            &self->run.model, self->test.t, self->test.data, self->predicted,
            self->test.count < SHOWN_TRAJECTORIES ? self->test.count : SHOWN_TRAJECTORIES, self->test.points,
            &self->error);
    if (status == LG_OK)
        status = train_draw_loss(self->app, loss, lg_fit_history(fit, LG_FIT_LOSS), NULL,
                                 (size_t)lg_fit_epochs_done(fit), &self->error);
    if (status == LG_OK) status = draw_long(self, energy);
    free(sphere);
    free(loss);
    free(energy);
    free(history);
    return status;
}

static void report_json(const demo *self, double seconds) {
    app_json json;
    app_json_begin(&json);
    app_json_real(&json, "E1", self->verdict.e1);
    app_json_real(&json, "E2", self->verdict.e2);
    app_json_real(&json, "published_E1", published_e1);
    app_json_real(&json, "published_E2", published_e2);
    app_json_real(&json, "loss", self->loss);
    app_json_size(&json, "epochs", lg_fit_epochs_done(self->learning.fit));
    app_json_real(&json, "seconds_per_epoch", lg_fit_seconds_per_epoch(self->learning.fit));
    app_json_size(&json, "threads", self->app->threads);
    app_json_size(&json, "seed", self->app->seed);
    app_json_text(&json, "out", values.out);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

static void report(const demo *self, double seconds) {
    app_table table;
    (void)printf(
        "The spherical pendulum on T*S^2, learned from %zu trajectories of %zu points on [0, 0.1]\n"
        "with the commutator-free integrator CF4: %zu parameters, %llu epochs, mean squared error %.2e.\n\n",
        self->data.count, self->data.points, lg_hamiltonian_parameters(&self->run.model),
        (unsigned long long)lg_fit_epochs_done(self->learning.fit), self->loss);
    app_table_begin(&table, 3);
    app_table_cell(&table, "%zu test trajectories on [0, 1]", self->test.count);
    app_table_cell(&table, "liegrad");
    app_table_cell(&table, "published");
    app_table_cell(&table, "E1  mean squared error of the flow");
    app_table_cell(&table, "%.2e", self->verdict.e1);
    app_table_cell(&table, "%.1e", published_e1);
    app_table_cell(&table, "E2  deviation of the Hamiltonian");
    app_table_cell(&table, "%.2e", self->verdict.e2);
    app_table_cell(&table, "%.1e", published_e2);
    app_table_end(&table, stdout);
    (void)printf("\nIn %s:\n"
                 "  train.h5  test.h5   the data\n"
                 "  model.h5            the learned Hamiltonian, E1 and E2 on record\n"
                 "  trajectories.svg    true and predicted, on the sphere\n"
                 "  loss.svg  loss.csv  the training loss\n"
                 "  energy.svg          the energy along a prediction to t = %g\n\n",
                 values.out, values.t_end);
    (void)printf("%.1f s: sampling %.1f, training %.1f (%.4f an epoch, %llu threads), judging %.1f\n",
                 seconds, self->sampling_seconds, self->training_seconds,
                 lg_fit_seconds_per_epoch(self->learning.fit), (unsigned long long)self->app->threads,
                 self->judging_seconds);
}

static int run(app *host) {
    demo self = {.app = host};
    const double begin = app_seconds();
    lg_status status = app_make_folder(values.out, &self.error);
    if (status == LG_OK) status = app_claim(host, values.out, &self.error);
    if (status != LG_OK) return app_fail_file(host, status, &self.error, values.out);
    status = sample_all(&self);
    if (status == LG_OK) status = train_model(&self);
    if (status == LG_OK) status = judge_model(&self);
    if (status == LG_OK) status = record_model(&self);
    if (status == LG_OK) status = draw_all(&self);
    int code = APP_EXIT_OK;
    if (status != LG_OK)
        code = app_fail(host, status, "%s",
                        self.error.message[0] != '\0' ? self.error.message : lg_status_sentence(status));
    else if (host->json)
        report_json(&self, app_seconds() - begin);
    else
        report(&self, app_seconds() - begin);
    if (self.learning.recipe != NULL) lg_learning_release(&self.learning);
    lg_trajectories_destroy(&self.data);
    lg_trajectories_destroy(&self.test);
    lg_scene_destroy(&self.scene);
    free(self.theta);
    free(self.predicted);
    return code;
}

const app_command demo_command = {.name = "demo",
                                  .arguments = NULL,
                                  .summary = "Learn, test and draw the spherical pendulum",
                                  .details = NULL,
                                  .settings = APP_SETTINGS(APP_GIVEN(demo_options, values)),
                                  .run = run};

/* lg-hamiltonian predict: follow the learned flow from one start. */
#include "lg-hamiltonian/learning.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct predict_values {
    const char *out, *plot;
    lg_reals initial;
    double t_end, tolerance;
    uint64_t points;
} predict_values;

static const lg_field predict_options[] = {
    LG_OPTION(predict_values, initial, REALS, "X,X,...", "The start, in the layout of the model's state",
              LG_ANY_REAL),
    LG_OPTION(predict_values, t_end, REAL, "T", "Time of the last point (default: the scene's t_end, or 1)",
              LG_POSITIVE),
    LG_OPTION(predict_values, points, U64, "M", "Equidistant points of the trajectory, the start included",
              .low = 2, .high = 1e8, .value = "101"),
    LG_OPTION(predict_values, tolerance, REAL, "TOL",
              "Tolerance of the adaptive integration of the learned flow", .low = 1e-14, .high = 1e-2,
              .otherwise = "1e-10; 1e-13 for linear potentials"),
    LG_OPTION(predict_values, out, STRING, "FILE", "Write the trajectory as a data file (HDF5)"),
    LG_OPTION(predict_values, plot, STRING, "FILE.svg|.png",
              "Draw the trajectory; with a scene, the true one too"),
    LG_FIELD_END};

static predict_values values;

typedef struct prediction {
    const lg_hamiltonian_file *file;
    size_t dim;
    lg_scene scene;
    bool has_scene;
    double t_end;
    double *start;     /* (d) */
    lg_trajectories y; /* N = 1 */
    double *truth;     /* (M, d), or NULL without a scene */
    double *energy;    /* (M), learned */
    lg_run_stats stats;
    double seconds;
} prediction;

/* Distance from the manifold of a start typed by hand; one off by rounding is projected. */
static int check_start(const app *self, prediction *p) {
    const lg_hamiltonian *model = &p->file->run.model;
    lg_space space;
    const lg_status status = lg_hamiltonian_space(model->family, model->n, &space);
    if (status != LG_OK) return app_fail(self, status, "%s", lg_status_sentence(status));
    const size_t copy = p->dim / model->n;
    double distance = 0;
    for (size_t i = 0; i < model->n && model->family->off_manifold != NULL; i++)
        distance = fmax(distance, model->family->off_manifold(p->start + copy * i));
    if (!(distance <= 1e-6))
        return app_usage(self, "--initial: the start is off the manifold, %s, by %g", model->family->manifold,
                         distance);
    if (distance > 1e-14) app_warn(self, "the start was off the manifold by %g and is projected", distance);
    if (distance > 1e-14) lg_space_project(&space, p->start);
    return APP_EXIT_OK;
}

static int start_from_numbers(const app *self, prediction *p) {
    if (values.initial.count != p->dim)
        return app_usage(self, "--initial: %zu numbers, but the model's state has %zu", values.initial.count,
                         p->dim);
    memcpy(p->start, values.initial.values, p->dim * sizeof *p->start);
    return check_start(self, p);
}

static int start_from_scene(const app *self, prediction *p) {
    lg_error error = {LG_OK, ""};
    const char *path = self->arguments[1];
    const lg_hamiltonian *model = &p->file->run.model;
    const lg_hamiltonian_family *family;
    uint32_t n;
    lg_status status = lg_scene_read(self->context, path, FORM, &p->scene, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, path);
    p->has_scene = true;
    status = scene_family(&p->scene, &family, &n, &error);
    if (status != LG_OK)
        return app_fail(self, LG_FORMAT, "%s: line %u: %s", path, p->scene.line_system, error.message);
    if (family != model->family || n != model->n)
        return app_fail(self, LG_SHAPE, "%s: line %u: a state of %zu numbers, but the model's has %zu", path,
                        p->scene.line_system, lg_system_dim(p->scene.system), p->dim);
    const int code = app_scene_start(self, &p->scene, path);
    if (code != APP_EXIT_OK) return code;
    memcpy(p->start, p->scene.state, p->dim * sizeof *p->start);
    return APP_EXIT_OK;
}

static int integrate(const app *self, prediction *p) {
    lg_error error = {LG_OK, ""};
    const lg_hamiltonian *model = &p->file->run.model;
    const size_t points = (size_t)values.points;
    lg_status status = lg_trajectories_create(self->context, p->file->run.system, model->family, model->n, 1,
                                              points, p->t_end, true, 0, &p->y);
    if (status != LG_OK) return app_fail(self, status, "%s", lg_status_sentence(status));
    p->energy = app_alloc(points, sizeof *p->energy);
    const double tolerance = values.tolerance > 0 ? values.tolerance : default_tolerance(model);
    const double begin = app_seconds();
    status = learned_flow(self->context, model, p->file->theta, tolerance, p->start, p->y.t, points,
                          p->y.data, p->energy, &p->stats, &error);
    p->seconds = app_seconds() - begin;
    if (status != LG_OK) return app_fail(self, status, "%s", error.message);
    p->y.hamiltonian[0] = p->energy[0];
    if (!p->has_scene) return APP_EXIT_OK;
    p->truth = app_alloc(points * p->dim, sizeof *p->truth);
    status = lg_reference_trajectories(self->context, p->scene.system, p->start, 1, p->y.t, points, 0, 0,
                                       p->truth, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail(self, status, "the true flow: %s", error.message);
}

static double largest_difference(const prediction *p) {
    if (p->truth == NULL) return (double)NAN;
    double largest = 0;
    for (size_t i = 0; i < p->y.points * p->dim; i++)
        largest = fmax(largest, fabs(p->y.data[i] - p->truth[i]));
    return largest;
}

static double energy_drift(const prediction *p) {
    double drift = 0;
    for (size_t i = 0; i < p->y.points; i++) drift = fmax(drift, fabs(p->energy[i] - p->energy[0]));
    return drift;
}

static void report(const app *self, const prediction *p) {
    const double *end = p->y.data + (p->y.points - 1) * p->dim;
    if (self->json) {
        app_json json;
        app_json_begin(&json);
        app_json_real(&json, "t", p->t_end);
        app_json_reals(&json, "y", end, p->dim);
        app_json_size(&json, "points", p->y.points);
        app_json_size(&json, "steps", p->stats.steps);
        app_json_size(&json, "evaluations", p->stats.evaluations);
        app_json_real(&json, "energy_drift", energy_drift(p));
        app_json_real(&json, "max_error", largest_difference(p));
        app_json_text(&json, "out", values.out);
        app_json_real(&json, "seconds", p->seconds);
        app_json_end(&json);
        return;
    }
    (void)printf("t = %g after %zu steps (%.3f s); the learned energy drifts by %.2e", p->t_end,
                 p->stats.steps, p->seconds, energy_drift(p));
    if (p->truth != NULL) (void)printf("; largest difference from the true flow %.2e", largest_difference(p));
    (void)printf("\n");
    for (size_t i = 0; i < p->dim; i++) (void)printf("%s%.10g", i > 0 ? ", " : "y = ", end[i]);
    (void)printf("\n");
}

static int write_outputs(app *self, prediction *p) {
    lg_error error = {LG_OK, ""};
    lg_status status = LG_OK;
    if (values.out != NULL) {
        p->y.provenance = app_provenance(self, self->seed);
        status = lg_trajectories_write(self->context, values.out, &p->y, &error);
        if (status != LG_OK) return app_fail_file(self, status, &error, values.out);
    }
    if (values.plot != NULL)
        status = draw_trajectories(self, values.plot, "The learned flow", &p->file->run.model, p->y.t,
                                   p->truth, p->y.data, 1, p->y.points, &error);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, values.plot);
}

static int predict(app *self, const lg_hamiltonian_file *file) {
    prediction p = {.file = file, .dim = lg_hamiltonian_state_dim(&file->run.model)};
    p.start = app_alloc(p.dim, sizeof *p.start);
    int code = self->argument_count > 1 ? start_from_scene(self, &p) : start_from_numbers(self, &p);
    p.t_end = values.t_end > 0 ? values.t_end : p.has_scene && p.scene.has_t_end ? p.scene.t_end : 1;
    if (code == APP_EXIT_OK) code = integrate(self, &p);
    if (code == APP_EXIT_OK) code = write_outputs(self, &p);
    if (code == APP_EXIT_OK) report(self, &p);
    free(p.start);
    free(p.truth);
    free(p.energy);
    lg_trajectories_destroy(&p.y);
    lg_scene_destroy(&p.scene);
    return code;
}

static int run(app *self) {
    lg_error error = {LG_OK, ""};
    lg_hamiltonian_file file;
    const bool scene = self->argument_count > 1;
    if (scene == (values.initial.count > 0))
        return app_usage(self, scene ? "--initial and a scene cannot be given together"
                                     : "no start: give --initial X,X,... or a scene");
    const app_path paths[] = {{"out", values.out, APP_WRITTEN}, {"plot", values.plot, APP_DRAWN}};
    int code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    const lg_status status =
        lg_model_load_hamiltonian(self->context, self->arguments[0], NULL, &file, &error);
    if (status != LG_OK) return app_fail_file(self, status, &error, self->arguments[0]);
    code = predict(self, &file);
    lg_hamiltonian_file_destroy(&file);
    return code;
}

const app_command predict_command = {.name = "predict",
                                     .arguments = "MODEL.h5 [SCENE.yaml]",
                                     .summary = "Integrate the learned flow from a start",
                                     .details = "The start is --initial, or the scene's `initial`. With a "
                                                "scene the true flow is integrated too, and the largest "
                                                "difference is reported.",
                                     .settings = APP_SETTINGS(APP_GIVEN(predict_options, values)),
                                     .arguments_min = 1,
                                     .arguments_max = 2,
                                     .run = run};

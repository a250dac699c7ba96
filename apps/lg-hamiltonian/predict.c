/* lg-hamiltonian predict: integrates the learned flow from one start. */
#include "common/verbs.h"
#include "hamiltonian/learned.h"
#include "lg-hamiltonian/training.h"

#include <math.h>
#include <string.h>

static const lg_field predict_options[] = {APP_OUT(app_common, "FILE",
                                                   "Write the trajectory as a data file (HDF5)",
                                                   .file = LG_FILE_WRITTEN, .kind = "trajectories"),
                                           LG_FIELD_END};

typedef struct prediction {
    const lg_hamiltonian_file *file;
    size_t dim;
    lg_scene scene;
    bool has_scene;
    double t_end;
    double *start;     /* (d) */
    lg_trajectories y; /* a single trajectory, N = 1 */
    double *truth;     /* (M, d); NULL without a scene */
    double *energy;    /* (M): the learned energy */
    lg_run_stats stats;
    double seconds;
} prediction;

static void warn_of_projection(const app *self, double distance) {
    if (distance > 1e-14) app_warn(self, "the start was off the manifold by %g and is projected", distance);
}

static void check_constrained(const app *self, const lg_constraint *constraint, prediction *p) {
    lg_constraint_view view;
    APP_MUST(self, lg_constraint_look(constraint, 0, p->start, &view, &error));
    const double distance = fmax(view.off, view.across);
    if (!(distance <= LG_CONSTRAINT_TOLERANCE))
        app_stop_usage(self,
                       "--initial: the start is off the constraint: g(q) = 0 by %g of the size of q (largest "
                       "|g_i| = %g), P(q) p = p by %g of the size of p",
                       view.off, view.residual, view.across);
    warn_of_projection(self, distance);
    APP_MUST(self, lg_constraint_project(constraint, 0, p->start, &error));
}

/* A start from the command line may be off the manifold. Up to a distance of 1e-6 it is projected, with a
 * warning above 1e-14; a larger distance ends the command. */
static void start_from_numbers(const app *self, prediction *p) {
    const lg_hamiltonian *model = &p->file->run.model;
    lg_space space;
    if (flow_given.initial.count != p->dim)
        app_stop_usage(self, "--initial: %zu numbers, but the model's state has %zu",
                       flow_given.initial.count, p->dim);
    memcpy(p->start, flow_given.initial.values, p->dim * sizeof *p->start);
    if (model->constraint != NULL) {
        check_constrained(self, model->constraint, p);
        return;
    }
    app_must(self, lg_hamiltonian_space(model->family, model->n, &space), NULL);
    uint32_t copy = 0;
    const double distance = lg_hamiltonian_off_manifold(model->family, model->n, p->start, &copy);
    if (!(distance <= 1e-6))
        app_stop_usage(self, "--initial: the start is off the manifold, %s, by %g", model->family->manifold,
                       distance);
    warn_of_projection(self, distance);
    if (distance > 1e-14) lg_space_project(&space, p->start);
}

static void start_from_scene(const app *self, prediction *p) {
    lg_error why = {LG_OK, ""};
    const char *path = self->arguments[1];
    const lg_hamiltonian *model = &p->file->run.model;
    const lg_hamiltonian_family *family;
    uint32_t n;
    APP_FILE(self, path, lg_scene_read, FORM, &p->scene);
    p->has_scene = true;
    if (scene_family(&p->scene, &family, &n, &why) != LG_OK)
        app_stop(self, LG_FORMAT, "%s: line %u: %s", path, p->scene.line_system, why.message);
    if (family != model->family || n != model->n)
        app_stop(self, LG_SHAPE, "%s: line %u: a state of %zu numbers, but the model's has %zu", path,
                 p->scene.line_system, lg_system_dim(p->scene.system), p->dim);
    app_scene_start(self, &p->scene, path);
    memcpy(p->start, p->scene.state, p->dim * sizeof *p->start);
}

static void integrate(const app *self, prediction *p) {
    lg_error why = {LG_OK, ""};
    const lg_hamiltonian *model = &p->file->run.model;
    const size_t points = (size_t)flow_given.points;
    app_must(self,
             lg_trajectories_create(self->context, p->file->run.system, model->family, model->n, 1, points,
                                    p->t_end, true, 0, &p->y),
             NULL);
    p->energy = app_keep(points, sizeof *p->energy);
    const double tolerance = flow_given.tolerance > 0 ? flow_given.tolerance : default_tolerance(model);
    const double begin = app_seconds();
    lg_model *learned;
    APP_DO(self, lg_hamiltonian_learned, model, p->file->theta, &learned);
    const lg_status flown = app_flow(self->context, learned, lg_scheme_find(model->family->accurate),
                                     tolerance, 0, p->start, p->y.t, points, p->y.data, &p->stats);
    if (flown != LG_OK) app_stop(self, flown, "the learned flow: %s", lg_status_sentence(flown));
    APP_MUST(self, land(model, points, p->y.data, &error));
    energies_of(learned, p->y.data, points, p->dim, p->energy);
    lg_model_destroy(learned);
    p->seconds = app_seconds() - begin;
    p->y.hamiltonian[0] = p->energy[0];
    if (model->constraint != NULL)
        APP_MUST(self,
                 lg_trajectories_set_constraint(&p->y, lg_constraint_program(model->constraint), &error));
    if (!p->has_scene) return;
    p->truth = app_keep(points * p->dim, sizeof *p->truth);
    const lg_status status =
        lg_system_solve(self->context, p->scene.system, p->start, 1, p->y.t, points, 0, 0, p->truth, &why);
    if (status != LG_OK) app_stop(self, status, "the true flow: %s", why.message);
}

static void report(const app *self, const prediction *p) {
    app_json *out = self->out;
    double drift = 0, largest = p->truth != NULL ? 0 : NAN;
    for (size_t i = 0; i < p->y.points; i++) drift = fmax(drift, fabs(p->energy[i] - p->energy[0]));
    for (size_t i = 0; p->truth != NULL && i < p->y.points * p->dim; i++)
        largest = fmax(largest, fabs(p->y.data[i] - p->truth[i]));
    APP_PUT(out, LG_REAL("t", p->t_end, NULL),
            LG_REALS("y", p->y.data + (p->y.points - 1) * p->dim, p->dim, NULL),
            LG_AS_WHOLE("points", p->y.points), LG_WHOLE("steps", p->stats.steps, NULL),
            LG_AS_WHOLE("evaluations", p->stats.evaluations),
            LG_REAL("energy_drift", drift, "largest change of the learned energy"),
            LG_REAL("max_error", largest, "largest difference from the true flow, which a scene gives"),
            LG_AS_TEXT("out", app_common_given.out), LG_REAL("seconds", p->seconds, NULL));
}

static void prediction_destroy(prediction *p) {
    lg_trajectories_destroy(&p->y);
    lg_scene_destroy(&p->scene);
}

static void run(app *self) {
    const bool scene = self->argument_count > 1;
    const char *path = self->arguments[0];
    lg_hamiltonian_file file;
    APP_CLEAN(prediction_destroy) prediction p = {.file = &file};
    if (scene == (flow_given.initial.count > 0))
        app_stop_usage(self, scene ? "--initial and a scene cannot be given together"
                                   : "no start: give --initial X,X,... or a scene");
    APP_FILE(self, path, lg_recipe_load, NULL, &lg_recipe_hamiltonian, &file);
    p.dim = lg_hamiltonian_state_dim(&file.run.model);
    p.start = app_keep(p.dim, sizeof *p.start);
    if (scene)
        start_from_scene(self, &p);
    else
        start_from_numbers(self, &p);
    p.t_end = flow_given.t_end > 0 ? flow_given.t_end : p.has_scene && p.scene.has_t_end ? p.scene.t_end : 1;
    integrate(self, &p);
    p.y.provenance = app_provenance(self, self->seed);
    if (app_common_given.out != NULL) APP_FILE(self, app_common_given.out, lg_trajectories_write, &p.y);
    app_plot_draw(
        self, 0, &(drawn_flow){"The learned flow", &file.run.model, p.y.t, p.truth, p.y.data, 1, p.y.points});
    report(self, &p);
    lg_recipe_release(&lg_recipe_hamiltonian, &file);
}

const app_command hamiltonian_predict_command = {
    .name = "predict",
    .arguments = "MODEL.h5 [SCENE.yaml]",
    .summary = "Integrate the learned flow from a start",
    .details = "The start is --initial, or the scene's `initial`. With a scene the true flow is integrated "
               "too, and the largest difference is reported.",
    APP_DRAWS("the trajectory; with a scene, the true one too", "learned_flow", put_flow),
    .settings = APP_SETTINGS(FLOW, APP_GIVEN(predict_options, app_common_given)),
    .run = run};

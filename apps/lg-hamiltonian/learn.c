/* Training a learned Hamiltonian: what `train`, `study` and `demo` have in common. */
#include "lg-hamiltonian/learning.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { STREAM_WEIGHTS = 1 };

/* Preset, option, value; family (NULL: any) and its least n. Later rows replace earlier ones; what stands
 * in no row has its own default. */
static const struct {
    const char *preset, *option, *value, *family;
    uint32_t least;
} preset_rows[] = {
    {"thesis", "method", "adam", NULL, 0},       {"thesis", "hidden", "100,100,100", NULL, 0},
    {"thesis", "epochs", "100", NULL, 0},        {"thesis", "prior", "0", NULL, 0},
    {"thesis", "scaled", "no", NULL, 0},         {"thesis", "units", "given", NULL, 0},
    {"best", "method", "ssbroyden", NULL, 0},    {"best", "hidden", "20,20", NULL, 0},
    {"best", "epochs", "2000", NULL, 0},         {"best", "prior", "0.15", NULL, 0},
    {"best", "units", "data", NULL, 0},          {"best", "integrator", "rk4", "separable", 0},
    {"best", "scaled", "yes", "chain", 0},       {"best", "hidden", "20", "chain", 3},
    {"best", "integrator", "rkmk5", "chain", 3},
};

lg_status learner_preset(const app *self, const char *preset, const lg_hamiltonian_family *family, uint32_t n,
                         lg_hamiltonian_run *run) {
    lg_status found = LG_NOT_FOUND;
    for (size_t i = 0; i < LG_COUNT(preset_rows); i++) {
        const char *option = preset_rows[i].option, *of = preset_rows[i].family;
        if (strcmp(preset_rows[i].preset, preset) != 0) continue;
        found = LG_OK;
        const bool fits = (of == NULL || strcmp(of, family->name) == 0) && n >= preset_rows[i].least;
        if (!fits || (self != NULL && app_given(self, option))) continue;
        (void)lg_field_set(lg_field_find(lg_hamiltonian_fields, option), preset_rows[i].value, run, NULL);
    }
    /* The starts are too many for a dense matrix. */
    const bool dense = strcmp(preset, "best") == 0 && run->starts == LG_START_ESTIMATED;
    if (dense && (self == NULL || !app_given(self, "method")))
        (void)lg_fit_plan_parse("lbfgs", &run->training.plan, NULL);
    return found;
}

static lg_hamiltonian_problem problem_of(const lg_hamiltonian_run *run, const lg_trajectories *data) {
    return (lg_hamiltonian_problem){.model = &run->model,
                                    .scheme = run->scheme,
                                    .substeps = run->substeps,
                                    .penalty = run->penalty,
                                    .penalty_form = run->penalty_form,
                                    .penalty_integral = lg_first_integral_at(run->penalty_integral),
                                    .penalty_copy = run->penalty_copy,
                                    .penalty_points = run->penalty_points,
                                    .distance = run->distance,
                                    .starts = run->starts,
                                    .trajectories = data->count,
                                    .points = data->points,
                                    .dt = data->dt,
                                    .data = data->data};
}

lg_status describe_run(const lg_trajectories *data, lg_hamiltonian_run *run, lg_error *error) {
    const lg_mlp net = run->model.net;
    const lg_symmetry symmetry = run->model.symmetry;
    const lg_status status = lg_hamiltonian_init(&run->model, data->family, data->n, run->model.potential,
                                                 net.width + 1, net.layers - 1, net.activation);
    if (status != LG_OK) return app_error(error, status, "a network of this size cannot be made");
    run->model.symmetry = symmetry;
    memcpy(run->system, data->system, sizeof run->system);
    memcpy(run->data_sha256, data->sha256, sizeof run->data_sha256);
    run->trajectories = data->count;
    run->points = data->points;
    run->dt = data->dt;
    if (run->units == LG_UNITS_GIVEN) return LG_OK;
    const lg_hamiltonian_problem problem = problem_of(run, data);
    return lg_hamiltonian_find_scales(&problem, &run->model.scales, error);
}

/* Weights of the loss by the data; the penalty keeps its ratio to the squares of the momenta. */
static lg_status weigh(lg_hamiltonian_problem *problem, lg_error *error) {
    const lg_status status = lg_hamiltonian_weigh(problem, error);
    if (status != LG_OK || problem->penalty == 0) return status;
    double unit = 1;
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++)
        unit *= pow(problem->model->scales.part[i], problem->penalty_integral->power[i]);
    if (problem->penalty_form == LG_PENALTY_MEAN_SQUARE) unit *= unit;
    problem->penalty *= fmax(problem->weight[0], problem->weight[1]) / unit;
    return LG_OK;
}

/* The weights to begin with. They are drawn again where a prediction is not finite: a long chain with a
 * nearly singular mass is too fast for its steps. */
static lg_status draw_weights(const lg_context *context, const learner *self, double *theta) {
    enum { DRAWS = 20 };
    double loss = (double)NAN;
    lg_rng rng;
    lg_rng_seed(&rng, self->run.training.seed, STREAM_WEIGHTS);
    for (int draw = 0; draw < DRAWS && !isfinite(loss); draw++) {
        lg_hamiltonian_initialise(&self->run.model, &rng, theta);
        const lg_status scaled =
            self->run.scaled ? lg_hamiltonian_scale(context, &self->problem, theta, NULL) : LG_OK;
        if (scaled != LG_OK && scaled != LG_NOT_FINITE) return scaled;
        (void)lg_hamiltonian_mean_squared_error(context, &self->problem, theta, &loss, NULL);
    }
    return LG_OK;
}

lg_status learner_create(const lg_context *context, const lg_hamiltonian_run *run,
                         const lg_trajectories *data, const lg_fit_options *options, learner *out,
                         lg_error *error) {
    *out = (learner){.run = *run};
    out->problem = problem_of(&out->run, data);
    lg_status status = lg_hamiltonian_problem_check(&out->problem, error);
    if (status == LG_OK && run->units == LG_UNITS_DATA) status = weigh(&out->problem, error);
    if (status != LG_OK) return status;
    lg_hamiltonian_fit_problem(&out->problem, &out->fit_problem);
    double *theta = app_alloc(out->fit_problem.parameters, sizeof *theta);
    status = draw_weights(context, out, theta);
    lg_fit_options chosen = *options;
    lg_training_apply(&out->run.training, &chosen);
    if (status == LG_OK)
        status = lg_fit_create(context, &out->fit_problem, &chosen, theta, &out->fit, error);
    else
        (void)app_error(error, status, "%s", lg_status_sentence(status));
    free(theta);
    return status;
}

void learner_destroy(learner *self) {
    lg_fit_destroy(self->fit);
    self->fit = NULL;
}

double *learner_theta(const learner *self) {
    double *theta = app_alloc(self->fit_problem.parameters, sizeof *theta);
    lg_fit_parameters(self->fit, theta);
    return theta;
}

double unchanged_error(const lg_hamiltonian_problem *problem) {
    const size_t d = lg_hamiltonian_state_dim(problem->model), m = problem->points;
    double sum = 0;
    for (size_t i = 0; i < problem->trajectories; i++) {
        const double *start = problem->data + i * m * d;
        for (size_t j = d; j < m * d; j++) sum += (start[j] - start[j % d]) * (start[j] - start[j % d]);
    }
    return sum / ((double)problem->trajectories * (double)(m - 1) * (double)d);
}

static size_t trajectory_size(const lg_hamiltonian_problem *problem) {
    return problem->points * lg_hamiltonian_state_dim(problem->model);
}

/* ---- the truncation floor ---- */

/* A floor below this part of the mean square of the data is rounding. */
static const double rounding_floor = 1e-30, near_floor = 3.0;

/* Explicit, without error estimate, on the same space; a splitting in place of a splitting. */
static bool replaces(const lg_scheme *old, const lg_scheme *scheme) {
    const lg_scheme_kind kind = scheme->kind;
    const bool splits = old->kind == LG_SCHEME_SPLITTING;
    const bool explicit_kind = kind == LG_SCHEME_RKMK || kind == LG_SCHEME_COMMUTATOR_FREE;
    return scheme->order > old->order && scheme->embedded_order == 0 && scheme->ambient == old->ambient &&
           (splits ? kind == LG_SCHEME_SPLITTING : explicit_kind);
}

/* The one of the highest order that replaces the problem's scheme, of several the one with most stages, which
 * has the least error; NULL: none. */
static const lg_scheme *better_scheme(const lg_hamiltonian_problem *problem) {
    const lg_scheme *best = NULL;
    for (size_t i = 0; i < lg_scheme_count(); i++) {
        lg_hamiltonian_problem other = *problem;
        other.scheme = lg_scheme_at(i);
        if (!replaces(problem->scheme, other.scheme) || lg_hamiltonian_problem_check(&other, NULL) != LG_OK)
            continue;
        if (best == NULL || other.scheme->order > best->order ||
            (other.scheme->order == best->order && other.scheme->stages > best->stages))
            best = other.scheme;
    }
    return best;
}

bool is_near_floor(double loss, double floor) {
    return loss <= near_floor * floor;
}

void warn_of_floor(const app *self, const lg_hamiltonian_problem *problem, double loss, double floor) {
    const lg_scheme *scheme = problem->scheme, *better = better_scheme(problem);
    const size_t size = problem->trajectories * trajectory_size(problem);
    double square = 0;
    for (size_t i = 0; i < size; i++) square += problem->data[i] * problem->data[i] / (double)size;
    if (!is_near_floor(loss, floor) || floor < rounding_floor * square) return;
    app_warn(self,
             "the loss %.3g is near the floor %.3g, the error of %s with %u step%s between two points: more "
             "training fits this error; use --substeps %u (floor about %.1g)%s%s",
             loss, floor, scheme->name, problem->substeps, problem->substeps == 1 ? "" : "s",
             2 * problem->substeps, ldexp(floor, -2 * scheme->order),
             better != NULL ? " or a scheme of higher order, --integrator " : "",
             better != NULL ? better->name : "");
}

/* The root mean square of G's change at a point, or of G at point 1. */
static lg_status integral_at(const app *self, const learner *trained, const double *theta, size_t point,
                             double *size, lg_error *error) {
    const lg_status status =
        lg_hamiltonian_integral_change(self->context, &trained->problem, theta, point, size, error);
    if (status == LG_OK) *size = sqrt(*size);
    return status;
}

/* Noise changes G by as much at every point, but for the scatter of a mean over N: a drift by more later. */
lg_status warn_of_integral(const app *self, const learner *trained, lg_error *error) {
    static const double scatter = 4.0, least = 1e-3;
    const lg_hamiltonian_problem *problem = &trained->problem;
    double whole = 0, second = 0, largest = 0, change = 0;
    if (problem->penalty == 0) return LG_OK;
    double *theta = learner_theta(trained);
    lg_status status = integral_at(self, trained, theta, 1, &whole, error);
    for (size_t j = 2; j <= problem->points && status == LG_OK; j++) {
        status = integral_at(self, trained, theta, j, &change, error);
        if (j == 2) second = change;
        largest = fmax(largest, change);
    }
    free(theta);
    const double grown = 1 + scatter / sqrt((double)problem->trajectories);
    if (status == LG_OK && largest > grown * second && largest > least * whole)
        app_warn(
            self,
            "the data do not conserve %s: it changes by %.2g to the second point and by up to %.2g later, "
            "its size is %.2g (root mean squares); the penalty trains the model to conserve it",
            problem->penalty_integral->name, second, largest, whole);
    return status;
}

void warn_of_inputs(const app *self, const char *path, const lg_trajectories *data) {
    if (data->inputs != NULL)
        app_warn(self, "%s: /inputs (%u a step) are not used: the learned system has no inputs", path,
                 data->input_dim);
}

/* ---- the data ---- */

static const lg_hamiltonian_problem
    *compared; /* by the two functions below; the program sorts in one thread */

static int compare_trajectories(const void *a, const void *b) {
    const size_t i = *(const size_t *)a, j = *(const size_t *)b, size = trajectory_size(compared);
    const int order = memcmp(compared->data + i * size, compared->data + j * size, size * sizeof(double));
    return order != 0 ? order : (i > j) - (i < j);
}

size_t different_trajectories(const lg_hamiltonian_problem *problem, size_t *out) {
    const size_t size = trajectory_size(problem);
    size_t count = 0;
    for (size_t i = 0; i < problem->trajectories; i++) out[i] = i;
    compared = problem;
    qsort(out, problem->trajectories, sizeof *out, compare_trajectories);
    for (size_t i = 0; i < problem->trajectories; i++) {
        const double *last = problem->data + out[count > 0 ? count - 1 : 0] * size;
        const bool again = count > 0 && memcmp(last, problem->data + out[i] * size, size * sizeof *last) == 0;
        if (!again) out[count++] = out[i];
    }
    return count;
}

void warn_of_data(const app *self, const lg_hamiltonian_problem *problem, const char *path) {
    const size_t parameters = lg_hamiltonian_parameters(problem->model), given = problem->trajectories;
    size_t *index = app_alloc(given, sizeof *index);
    const size_t count = different_trajectories(problem, index), d = lg_hamiltonian_state_dim(problem->model);
    const double numbers = (double)count * (double)(problem->points - 1) * (double)d;
    free(index);
    if (!lg_hamiltonian_moves(problem))
        app_warn(self, "%s: nothing moves: every trajectory stays at its first point, as with any constant H",
                 path);
    if (count < given)
        app_warn(self,
                 "%s: %zu of %zu trajectories repeat another one: there is as much to learn from as in %zu",
                 path, given - count, given, count);
    if (numbers < (double)parameters)
        app_warn(
            self,
            "%.0f numbers are given, fewer than the %zu parameters that are learned: they fit these data, "
            "not the system; take %.0f trajectories or more, or smaller --hidden",
            numbers, parameters, ceil((double)parameters / numbers * (double)count));
}

lg_status save_model(const app *self, const char *path, const learner *trained, const double *theta,
                     lg_error *error) {
    lg_hamiltonian_file file;
    memset(&file, 0, sizeof file);
    file.run = trained->run;
    file.parameters = lg_hamiltonian_parameters(&trained->run.model);
    file.provenance = app_provenance(self, trained->run.training.seed);
    file.theta = app_alloc(file.parameters, sizeof *file.theta);
    memcpy(file.theta, theta, file.parameters * sizeof *theta);
    const lg_status status = lg_model_save_hamiltonian(self->context, path, &file, trained->fit, error);
    free(file.theta);
    return status;
}

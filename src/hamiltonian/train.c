/* Learned Hamiltonians: the training loss, checks of a training problem, and means over all data. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "core/numbers.h"
#include "integrators/stepper.h"
#include "hamiltonian/internal.h"

/* ---- data ---- */

/* Writes points first..last of the samples as states divided by their scales, ((last - first + 1) count, d):
 * all samples of a point, then all samples of the next point, as the concatenated predictions are ordered.
 * For geodesic distances the states are projected to the manifold first. */
static void fill_states(const lg_hamiltonian_problem *problem, const lg_space *space, lg_dtype dtype,
                        const uint32_t *samples, size_t count, size_t first, size_t last, void *values) {
    const size_t d = space->dim;
    double state[LG_HAMILTONIAN_LARGEST], scale[LG_HAMILTONIAN_LARGEST];
    size_t row = 0;
    lg_hamiltonian_number_scales(problem->model, scale);
    for (size_t c = 0; c < d; c++) scale[c] = 1.0 / scale[c];
    for (size_t j = first; j <= last; j++)
        for (size_t s = 0; s < count; s++, row++) {
            memcpy(state, problem->data + (samples[s] * problem->points + j) * d, d * sizeof *state);
            if (problem->distance == LG_DISTANCE_GEODESIC) lg_space_project(space, state);
            for (size_t c = 0; c < d; c++) state[c] *= scale[c];
            lg_put_numbers(dtype, values, row * d, state, d);
        }
}

/* Records the same points, split into the parts of the space. */
static lg_status given_points(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_space *space,
                              const uint32_t *samples, size_t count, size_t first, size_t last,
                              lg_var *parts) {
    void *values;
    const lg_shape shape = lg_shape2((uint32_t)((last - first + 1) * count), (uint32_t)space->dim);
    lg_var states = lg_input_buffer(tape, shape, &values);
    if (lg_is_none(states)) return lg_tape_status(tape);
    fill_states(problem, space, lg_tape_dtype(tape), samples, count, first, last, values);
    return lg_taped_split(tape, space, states, parts);
}

/* ---- loss ---- */

const lg_first_integral *lg_hamiltonian_integral_of(const lg_hamiltonian_problem *problem) {
    return problem->penalty_integral != NULL ? problem->penalty_integral : lg_first_integral_at(0);
}

/* G (B, 1) at a point, in the units of the data. `y`: the parts of the point, divided by their scales. */
static lg_var conserved(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_hamiltonian_vars *vars,
                        const lg_var *y) {
    const lg_first_integral *integral = lg_hamiltonian_integral_of(problem);
    lg_var given[LG_HAMILTONIAN_MAX_PARTS];
    lg_hamiltonian_by_scales(tape, problem->model, y, given);
    return integral->record(integral->user, tape, vars, given);
}

/* The sum over samples and points of (G(y_j) - G(x))^2, or of 2 |G(y_j) - G(x)|. `y` has the parts of all M
 * points, one point after the other; x is the first point. */
static lg_var penalty_sum(lg_tape *tape, const lg_hamiltonian_problem *problem,
                          const lg_hamiltonian_vars *vars, size_t parts, const lg_var *y) {
    lg_var at_start = conserved(tape, problem, vars, y), total = LG_NONE;
    for (size_t j = 1; j < problem->points; j++) {
        lg_var gap = lg_sub(tape, conserved(tape, problem, vars, y + parts * j), at_start);
        lg_var each = problem->penalty_form == LG_PENALTY_MEAN_SQUARE
                          ? lg_square(tape, gap)
                          : lg_scale(tape, lg_abs(tape, gap), 2.0);
        total = lg_add_or(tape, total, lg_sum(tape, each));
    }
    return total;
}

enum { PREDICTED = LG_HAMILTONIAN_MAX_PARTS * LG_HAMILTONIAN_MAX_POINTS };

/* Variational steps; the point after every `every`-th step is kept. */
static lg_status predict_variational(lg_tape *tape, const lg_hamiltonian_vars *vars, double h, size_t steps,
                                     size_t every, const lg_var *start, lg_var *out) {
    const char *const *layout = vars->model->family->layout;
    lg_var y[LG_HAMILTONIAN_MAX_PARTS];
    size_t parts = 0;
    for (; layout[parts] != NULL; parts++) y[parts] = start[parts];
    for (size_t i = 1; i <= steps; i++) {
        LG_TRY(lg_hamiltonian_variational_step(tape, vars, &(lg_taped_span){.h = h}, y, y));
        for (size_t k = 0; i % every == 0 && k < parts; k++) *out++ = y[k];
    }
    return LG_OK;
}

/* Predicts points 1..M-1, with `substeps` steps between two points; predicted: (M - 1) x parts. */
static lg_status predict(lg_tape *tape, const lg_hamiltonian_problem *problem, lg_hamiltonian_vars *vars,
                         uint32_t substeps, const lg_var *start, lg_var *predicted) {
    lg_taped_ode ode;
    const size_t steps = substeps * (problem->points - 1);
    const double h = problem->dt / problem->model->scales.time / substeps;
    if (problem->scheme->kind == LG_SCHEME_VARIATIONAL)
        return predict_variational(tape, vars, h, steps, substeps, start, predicted);
    LG_TRY(lg_hamiltonian_training_ode(tape, vars, problem->scheme, start, &ode));
    return lg_taped_integrate(tape, problem->scheme, &ode, 0.0, h, steps, substeps, start, predicted);
}

/* Each part of `y`, whose parts lie point by point, at all points, concatenated. */
static void join_points(lg_tape *tape, const lg_var *y, size_t points, size_t parts, lg_var *out) {
    lg_var each[LG_HAMILTONIAN_MAX_POINTS];
    for (size_t part = 0; part < parts; part++) {
        for (size_t j = 0; j < points; j++) each[j] = y[parts * j + part];
        out[part] = lg_concat(tape, each, points, 0);
    }
}

static const double *weights_of(const lg_hamiltonian_problem *problem) {
    static const double ones[LG_HAMILTONIAN_MAX_PARTS] = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++)
        if (problem->weight[i] != 0.0) return problem->weight;
    return ones;
}

static bool is_estimated(const lg_hamiltonian_problem *problem) {
    return problem->starts == LG_START_ESTIMATED;
}

/* The index of the first point that is part of the loss. */
static size_t first_point(const lg_hamiltonian_problem *problem) {
    return is_estimated(problem) ? 0 : 1;
}

/* The estimated starts exp(a_i) . start of the samples. theta ends with the a_i (N, algebra_dim). */
static lg_status estimated_starts(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_space *space,
                                  lg_var theta, const uint32_t *samples, size_t count, lg_var *start) {
    const uint32_t n = (uint32_t)problem->trajectories, dim = (uint32_t)space->algebra_dim;
    const uint32_t from = (uint32_t)lg_hamiltonian_parameters(problem->model);
    lg_var a[LG_HAMILTONIAN_MAX_PARTS];
    lg_var all = lg_reshape(tape, lg_slice(tape, theta, 0, from, n * dim), lg_shape2(n, dim));
    LG_TRY(lg_taped_split_algebra(tape, space, lg_gather(tape, all, samples, (uint32_t)count), a));
    return lg_taped_act(tape, space, a, start, start);
}

/* Binds the model's parameters, sets the space and records the starts of the samples. */
static lg_status begin(lg_tape *tape, const lg_hamiltonian_problem *problem, lg_var theta,
                       const uint32_t *samples, size_t count, lg_hamiltonian_vars *vars, lg_space *space,
                       lg_var *start) {
    const uint32_t n = (uint32_t)lg_hamiltonian_parameters(problem->model);
    const lg_var weights = is_estimated(problem) ? lg_slice(tape, theta, 0, 0, n) : theta;
    LG_TRY(lg_hamiltonian_bind(tape, problem->model, weights, vars));
    *space = lg_hamiltonian_model_space(problem->model);
    LG_TRY(given_points(tape, problem, space, samples, count, 0, 0, start));
    if (!is_estimated(problem)) return LG_OK;
    return estimated_starts(tape, problem, space, theta, samples, count, start);
}

/* The number of squares in a mean over `batch` samples. */
static double terms_of(const lg_hamiltonian_problem *problem, const lg_space *space, size_t batch) {
    return (double)batch * (double)space->dim * (double)(problem->points - first_point(problem));
}

/* Samples of a problem on a tape. */
typedef struct shard {
    lg_hamiltonian_vars vars;
    lg_space space;
    size_t parts;        /* of a state */
    lg_var y[PREDICTED]; /* the start and the predictions: the parts of M points, one point after the other */
    /* The points in the loss, predicted and given. */
    lg_var all[LG_HAMILTONIAN_MAX_PARTS], given[LG_HAMILTONIAN_MAX_PARTS];
} shard;

static lg_status run(lg_tape *tape, const lg_hamiltonian_problem *problem, lg_var theta,
                     const uint32_t *samples, size_t count, shard *s) {
    const size_t first = first_point(problem);
    LG_TRY(begin(tape, problem, theta, samples, count, &s->vars, &s->space, s->y));
    s->parts = lg_taped_parts(&s->space);
    LG_TRY(predict(tape, problem, &s->vars, problem->substeps, s->y, s->y + s->parts));
    LG_TRY(given_points(tape, problem, &s->space, samples, count, first, problem->points - 1, s->given));
    join_points(tape, s->y + first * s->parts, problem->points - first, s->parts, s->all);
    return LG_OK;
}

static lg_status shard_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                            size_t batch, lg_var *loss) {
    const lg_hamiltonian_problem *problem = user;
    shard s;
    LG_TRY(run(tape, problem, theta, samples, count, &s));
    const lg_var squares = lg_hamiltonian_squared_distance(tape, problem->distance, &s.space,
                                                           weights_of(problem), s.all, s.given);
    lg_var total = lg_scale(tape, squares, 1.0 / terms_of(problem, &s.space, batch));
    if (problem->penalty != 0.0) {
        const bool mean = problem->penalty_form == LG_PENALTY_MEAN_SQUARE;
        const double weight = mean ? problem->penalty / (double)batch : problem->penalty;
        total =
            lg_add(tape, total, lg_scale(tape, penalty_sum(tape, problem, &s.vars, s.parts, s.y), weight));
    }
    *loss = total;
    return lg_tape_status(tape);
}

/* The residuals of shard_loss, without a penalty: the numbers that it squares, in one column. */
static lg_status shard_residuals(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples,
                                 size_t count, size_t batch, lg_var *r) {
    const lg_hamiltonian_problem *problem = user;
    shard s;
    lg_var columns[LG_HAMILTONIAN_MAX_PARTS];
    LG_TRY(run(tape, problem, theta, samples, count, &s));
    for (size_t part = 0; part < s.parts; part++) {
        const lg_var difference = lg_hamiltonian_scaled(tape, lg_sub(tape, s.all[part], s.given[part]),
                                                        sqrt(weights_of(problem)[part]));
        const uint64_t length = lg_shape_count(lg_var_shape(tape, difference));
        columns[part] = lg_reshape(tape, difference, lg_shape1((uint32_t)length));
    }
    const double scale = 1.0 / sqrt(terms_of(problem, &s.space, batch));
    *r = lg_scale(tape, lg_concat(tape, columns, s.parts, 0), scale);
    return lg_tape_status(tape);
}

/* ---- means over all data ---- */

/* Like shard_loss, but for the floor: the predictions are compared with predictions that have twice the
 * substeps, and the squares are multiplied by Richardson's factor. */
static lg_status shard_floor(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                             size_t batch, lg_var *floor) {
    const lg_hamiltonian_problem *problem = user;
    const size_t points = problem->points - 1;
    const double power = ldexp(1.0, problem->scheme->order), factor = power / (power - 1.0);
    shard s;
    lg_var coarse[LG_HAMILTONIAN_MAX_PARTS], fine[LG_HAMILTONIAN_MAX_PARTS], twice[PREDICTED];
    LG_TRY(run(tape, problem, theta, samples, count, &s));
    LG_TRY(predict(tape, problem, &s.vars, 2 * problem->substeps, s.y, twice));
    join_points(tape, twice, points, s.parts, fine);
    join_points(tape, s.y + s.parts, points, s.parts, coarse);
    const lg_var squares = lg_hamiltonian_squared_distance(tape, LG_DISTANCE_AMBIENT, &s.space,
                                                           weights_of(problem), coarse, fine);
    *floor = lg_scale(tape, squares, factor * factor / terms_of(problem, &s.space, batch));
    return lg_tape_status(tape);
}

/* The mean over all data of the loss, or of the floor, with weights that take the squares from the model's
 * scales back to the units of the data. */
static lg_status mean_in_units(const lg_context *context, lg_hamiltonian_problem problem, bool floor,
                               const double *theta, double *out, lg_error *error) {
    lg_fit_problem fit;
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++)
        problem.weight[i] = problem.model->scales.part[i] * problem.model->scales.part[i];
    lg_hamiltonian_fit_problem(&problem, &fit);
    if (floor) fit.loss = shard_floor;
    return lg_fit_problem_loss(context, &fit, theta, out, error);
}

lg_status lg_hamiltonian_mean_squared_error(const lg_context *context, const lg_hamiltonian_problem *problem,
                                            const double *theta, double *out, lg_error *error) {
    LG_NEEDS(error, problem, theta, out);
    lg_hamiltonian_problem plain = *problem;
    plain.penalty = 0.0;
    plain.distance = LG_DISTANCE_AMBIENT;
    LG_TRY(lg_hamiltonian_problem_check(&plain, error));
    return mean_in_units(context, plain, false, theta, out, error);
}

lg_status lg_hamiltonian_floor(const lg_context *context, const lg_hamiltonian_problem *problem,
                               const double *theta, double *out, lg_error *error) {
    LG_NEEDS(error, problem, theta, out);
    LG_TRY(lg_hamiltonian_problem_check(problem, error));
    if (problem->substeps > UINT32_MAX / 2)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%u substeps are too many: twice their number must be below 2^32", problem->substeps);
    return mean_in_units(context, *problem, true, theta, out, error);
}

/* ---- the problem ---- */

/* Fails if training cannot differentiate the scheme on the model's space. */
static lg_status check_scheme(const lg_hamiltonian *model, const lg_scheme *scheme, lg_error *error) {
    const lg_hamiltonian_family *family = model->family;
    lg_space space;
    LG_TRY(lg_hamiltonian_space(family, model->n, &space));
    if (scheme->kind == LG_SCHEME_VARIATIONAL && family->ambient == NULL)
        return lg_fail(
            error, LG_UNSUPPORTED,
            "%s steps are for families on a manifold, not for family %s: take stormer-verlet, which "
            "is symplectic, too",
            scheme->name, family->name);
    if (scheme->kind == LG_SCHEME_SPLITTING && family->drift == NULL)
        return lg_fail(error, LG_UNSUPPORTED,
                       "%s needs a separable Hamiltonian; the Hamiltonian of family %s is not separable",
                       scheme->name, family->name);
    if (scheme->kind == LG_SCHEME_SLGI && !lg_slgi_fits(&space))
        return lg_fail(error, LG_UNSUPPORTED, "%s is for SE(3), not for family %s", scheme->name,
                       family->name);
    if (scheme->project)
        return lg_fail(error, LG_UNSUPPORTED,
                       "%s projects states onto the manifold, which training does not support", scheme->name);
    return LG_OK;
}

static lg_status check_penalty(const lg_hamiltonian_problem *problem, lg_error *error) {
    const lg_first_integral *integral = lg_hamiltonian_integral_of(problem);
    const lg_hamiltonian *model = problem->model;
    if (!lg_first_integral_fits(integral, model))
        return lg_fail(error, LG_UNSUPPORTED,
                       "first integral %s = %s of the penalty does not fit family %s with n = %u",
                       integral->name, integral->formula, model->family->name, model->n);
    return LG_OK;
}

static lg_status check_distance(const lg_hamiltonian_problem *problem, lg_error *error) {
    const lg_hamiltonian_family *family = problem->model->family;
    lg_space space;
    LG_TRY(lg_hamiltonian_space(family, problem->model->n, &space));
    if ((unsigned)problem->distance > LG_DISTANCE_GEODESIC)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown kind of distance");
    if (problem->distance == LG_DISTANCE_AMBIENT || lg_space_is_abelian(&space)) return LG_OK;
    if (!lg_hamiltonian_has_geodesics(&space))
        return lg_fail(error, LG_UNSUPPORTED, "geodesic distances are for R^n and T*S^2, not for family %s",
                       family->name);
    if (problem->scheme->ambient)
        return lg_fail(error, LG_UNSUPPORTED,
                       "geodesic distances need a Lie group scheme: %s leaves the manifold",
                       problem->scheme->name);
    return LG_OK;
}

lg_status lg_hamiltonian_problem_check(const lg_hamiltonian_problem *problem, lg_error *error) {
    LG_NEEDS(error, problem);
    if (problem->model == NULL || problem->data == NULL || problem->trajectories == 0 ||
        problem->substeps == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the problem has no model, no data, no trajectories or no substeps");
    if (problem->points < 2 || problem->points > LG_HAMILTONIAN_MAX_POINTS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a trajectory has %zu points; 2 to %d are possible",
                       problem->points, LG_HAMILTONIAN_MAX_POINTS);
    /* All points of a batch are rows of one tensor. */
    if (problem->trajectories > UINT32_MAX / problem->points)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%zu trajectories of %zu points are more than 2^32 - 1 points", problem->trajectories,
                       problem->points);
    if (!(problem->dt > 0.0 && problem->dt <= DBL_MAX) ||
        !(problem->penalty >= 0.0 && problem->penalty <= DBL_MAX))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "dt is %g and the penalty %g: dt must be positive, the penalty must not be negative, "
                       "and both must be finite",
                       problem->dt, problem->penalty);
    if ((unsigned)problem->penalty_form > LG_PENALTY_SUM_ABSOLUTE)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown form of the penalty");
    if ((unsigned)problem->starts > LG_START_ESTIMATED)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown kind of starts");
    if (problem->starts == LG_START_ESTIMATED && problem->model->constraint != NULL)
        return lg_fail(
            error, LG_UNSUPPORTED,
            "estimated starts would leave the constraint g(q) = 0; take --initial-states measured");
    if (problem->scheme == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "the problem has no integrator");
    LG_TRY(check_scheme(problem->model, problem->scheme, error));
    LG_TRY(check_distance(problem, error));
    return problem->penalty != 0.0 ? check_penalty(problem, error) : LG_OK;
}

void lg_hamiltonian_fit_problem(const lg_hamiltonian_problem *problem, lg_fit_problem *out) {
    const lg_space space = lg_hamiltonian_model_space(problem->model);
    const size_t starts = is_estimated(problem) ? problem->trajectories * space.algebra_dim : 0;
    const bool squares = problem->penalty == 0.0 && problem->distance == LG_DISTANCE_AMBIENT;
    const bool network = problem->model->potential == LG_POTENTIAL_MLP;
    const size_t numbers = problem->trajectories * (problem->points - first_point(problem)) * space.dim;
    *out = (lg_fit_problem){.parameters = lg_hamiltonian_parameters(problem->model) + starts,
                            .samples = problem->trajectories,
                            .observations = network ? numbers : 0,
                            .weights = lg_mlp_parameters(&problem->model->net),
                            .loss = shard_loss,
                            .residuals = squares ? shard_residuals : NULL,
                            .user = (void *)(uintptr_t)problem}; /* never written */
}

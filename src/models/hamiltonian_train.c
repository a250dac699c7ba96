/* Learned Hamiltonians: the training loss, and fields that only training uses. */
#include <float.h>
#include <string.h>

#include "core/core.h"
#include "integrators/stepper.h"
#include "liegrad/ops.h"
#include "models/hamiltonian_internal.h"

/* ---- data ---- */

static void store(lg_dtype dtype, void *values, size_t i, double value) {
    if (dtype == LG_F64)
        ((double *)values)[i] = value;
    else
        ((float *)values)[i] = (float)value;
}

/* Points first..last of the samples as states ((last - first + 1) count, d). All samples of one point follow
 * each other, the order of the concatenated predictions. */
static void fill_states(const lg_hamiltonian_problem *problem, lg_dtype dtype, const uint32_t *samples,
                        size_t count, size_t first, size_t last, void *values) {
    const size_t d = lg_hamiltonian_state_dim(problem->model);
    size_t at = 0;
    for (size_t j = first; j <= last; j++)
        for (size_t s = 0; s < count; s++) {
            const double *state = problem->data + (samples[s] * problem->points + j) * d;
            for (size_t c = 0; c < d; c++) store(dtype, values, at++, state[c]);
        }
}

/* The same points, split into the parts of the space. */
static lg_status given_points(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_space *space,
                              const uint32_t *samples, size_t count, size_t first, size_t last,
                              lg_var *parts) {
    void *values;
    const lg_shape shape = lg_shape2((uint32_t)((last - first + 1) * count), (uint32_t)space->dim);
    lg_var states = lg_input_buffer(tape, shape, &values);
    if (lg_is_none(states)) return lg_tape_status(tape);
    fill_states(problem, lg_tape_dtype(tape), samples, count, first, last, values);
    return lg_taped_split(tape, space, states, parts);
}

/* ---- loss ---- */

/* G = (q_1^2 + p_1^2)/2 for every row of (B, n), as (B, 1) */
static lg_var first_oscillator(lg_tape *tape, lg_var q, lg_var p) {
    lg_var q1 = lg_slice(tape, q, 1, 0, 1), p1 = lg_slice(tape, p, 1, 0, 1);
    return lg_scale(tape, lg_add(tape, lg_square(tape, q1), lg_square(tape, p1)), 0.5);
}

/* Sum over samples and points of (G(y_j) - G(x))^2, or of 2 |G(y_j) - G(x)|; `predicted` is (M - 1) x (q, p).
 */
static lg_var penalty_sum(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_var *start,
                          const lg_var *predicted) {
    lg_var at_start = first_oscillator(tape, start[0], start[1]), total = LG_NONE;
    for (size_t j = 0; j + 1 < problem->points; j++) {
        lg_var gap = lg_sub(tape, first_oscillator(tape, predicted[2 * j], predicted[2 * j + 1]), at_start);
        lg_var each = problem->penalty_form == LG_PENALTY_MEAN_SQUARE
                          ? lg_square(tape, gap)
                          : lg_scale(tape, lg_abs(tape, gap), 2.0);
        lg_var sum = lg_sum(tape, each);
        total = lg_is_none(total) ? sum : lg_add(tape, total, sum);
    }
    return total;
}

/* Sum of squares of predicted minus given points over all parts; predicted is (M - 1) x parts. */
static lg_var squared_error(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_space *space,
                            const uint32_t *samples, size_t count, const lg_var *predicted) {
    const size_t last = problem->points - 1, parts = lg_taped_parts(space);
    lg_var total = LG_NONE, given[LG_HAMILTONIAN_MAX_PARTS];
    if (given_points(tape, problem, space, samples, count, 1, last, given) != LG_OK) return LG_NONE;
    for (size_t part = 0; part < parts; part++) {
        lg_var points[LG_HAMILTONIAN_MAX_POINTS];
        for (size_t j = 0; j < last; j++) points[j] = predicted[parts * j + part];
        lg_var difference = lg_sub(tape, lg_concat(tape, points, last, 0), given[part]);
        lg_var sum = lg_sum(tape, lg_square(tape, difference));
        total = lg_is_none(total) ? sum : lg_add(tape, total, sum);
    }
    return total;
}

static lg_status shard_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                            size_t batch, lg_var *loss) {
    const lg_hamiltonian_problem *problem = user;
    const lg_hamiltonian *model = problem->model;
    lg_hamiltonian_vars vars;
    lg_space space;
    lg_taped_ode ode;
    lg_var start[LG_HAMILTONIAN_MAX_PARTS], predicted[LG_HAMILTONIAN_MAX_PARTS * LG_HAMILTONIAN_MAX_POINTS];
    LG_TRY(lg_hamiltonian_bind(tape, model, theta, &vars));
    LG_TRY(lg_hamiltonian_space(model->family, model->n, &space));
    LG_TRY(given_points(tape, problem, &space, samples, count, 0, 0, start));
    LG_TRY(lg_hamiltonian_training_ode(tape, &vars, problem->scheme, start, &ode));
    const size_t steps = problem->substeps * (problem->points - 1);
    LG_TRY(lg_taped_integrate(tape, problem->scheme, &ode, 0.0, problem->dt / problem->substeps, steps,
                              problem->substeps, start, predicted));
    const double terms = (double)batch * (double)space.dim * (double)(problem->points - 1);
    lg_var squares = squared_error(tape, problem, &space, samples, count, predicted);
    lg_var total = lg_scale(tape, squares, 1.0 / terms);
    if (problem->penalty != 0.0) {
        const bool mean = problem->penalty_form == LG_PENALTY_MEAN_SQUARE;
        const double weight = mean ? problem->penalty / (double)batch : problem->penalty;
        total = lg_add(tape, total, lg_scale(tape, penalty_sum(tape, problem, start, predicted), weight));
    }
    *loss = total;
    return lg_tape_status(tape);
}

/* Whether training can differentiate the scheme on the model's space. */
static lg_status check_scheme(const lg_hamiltonian *model, const lg_scheme *scheme, lg_error *error) {
    const lg_hamiltonian_family *family = model->family;
    lg_space space;
    LG_TRY(lg_hamiltonian_space(family, model->n, &space));
    if (scheme->kind == LG_SCHEME_VARIATIONAL)
        return lg_fail(error, LG_UNSUPPORTED,
                       "%s cannot be differentiated: it has no form that the tape can record", scheme->name);
    if (scheme->kind == LG_SCHEME_SPLITTING && family->force == NULL)
        return lg_fail(error, LG_UNSUPPORTED, "%s needs a separable Hamiltonian; that of family %s is not",
                       scheme->name, family->name);
    if (scheme->kind == LG_SCHEME_SLGI && !lg_slgi_fits(&space))
        return lg_fail(error, LG_UNSUPPORTED, "%s is for SE(3), not for family %s", scheme->name,
                       family->name);
    if (scheme->project) return lg_fail(error, LG_UNSUPPORTED, "%s: training does not project", scheme->name);
    return LG_OK;
}

lg_status lg_hamiltonian_problem_check(const lg_hamiltonian_problem *problem, lg_error *error) {
    if (problem->model == NULL || problem->data == NULL || problem->trajectories == 0 ||
        problem->substeps == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "no model, no data, no trajectories or no substeps");
    if (problem->points < 2 || problem->points > LG_HAMILTONIAN_MAX_POINTS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the number of points is %zu, not in 2..%d",
                       problem->points, LG_HAMILTONIAN_MAX_POINTS);
    /* All points of a batch stand in one tensor. */
    if (problem->trajectories > UINT32_MAX / problem->points)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%zu trajectories of %zu points are more than 2^32 - 1 points", problem->trajectories,
                       problem->points);
    if (!(problem->dt > 0.0 && problem->dt <= DBL_MAX) ||
        !(problem->penalty >= 0.0 && problem->penalty <= DBL_MAX))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "dt must be positive and the penalty not negative, both finite");
    if ((unsigned)problem->penalty_form > LG_PENALTY_SUM_ABSOLUTE)
        return lg_fail(error, LG_INVALID_ARGUMENT, "unknown form of the penalty");
    if (problem->scheme == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "no integrator");
    LG_TRY(check_scheme(problem->model, problem->scheme, error));
    if (problem->penalty != 0.0 && problem->model->family->force == NULL)
        return lg_fail(error, LG_UNSUPPORTED, "the first-integral penalty is for separable systems only");
    return LG_OK;
}

void lg_hamiltonian_fit_problem(const lg_hamiltonian_problem *problem, lg_fit_problem *out) {
    /* The union only drops const: the loss only reads the problem. */
    union {
        const lg_hamiltonian_problem *borrowed;
        void *user;
    } pointer = {.borrowed = problem};
    *out = (lg_fit_problem){.parameters = lg_hamiltonian_parameters(problem->model),
                            .samples = problem->trajectories,
                            .loss = shard_loss,
                            .user = pointer.user};
}

/* Warnings about the data and about a Hamiltonian that was learned from them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/clean.h"
#include "hamiltonian/internal.h"
#include "hamiltonian/learned.h"

#define WARN(...) lg_log_message(context, LG_LOG_WARNING, __VA_ARGS__)

double lg_hamiltonian_unchanged(const lg_hamiltonian_problem *problem) {
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

/* ---- the model ---- */

lg_status lg_hamiltonian_learned(const lg_context *context, const lg_hamiltonian *model, const double *theta,
                                 lg_model **out, lg_error *error) {
    lg_program *program;
    const lg_space space = lg_hamiltonian_model_space(model);
    LG_TRY(lg_hamiltonian_program(context, model, theta, NULL, &program, error));
    return lg_model_create(context, program, &space, out, error);
}

/* ---- the truncation floor ---- */

/* A floor below rounding_floor times the mean square of the data is caused by rounding. A loss of at most
 * near_floor times the floor is near it. */
static const double rounding_floor = 1e-30, near_floor = 3.0;

/* Whether `scheme` may be suggested in place of `old`: it has a higher order, is explicit, has no error
 * estimate and stays on the same space. A splitting scheme is only replaced by a splitting scheme. */
static bool replaces(const lg_scheme *old, const lg_scheme *scheme) {
    const lg_scheme_kind kind = scheme->kind;
    const bool splits = old->kind == LG_SCHEME_SPLITTING;
    const bool explicit_kind = kind == LG_SCHEME_RKMK || kind == LG_SCHEME_COMMUTATOR_FREE;
    return scheme->order > old->order && scheme->embedded_order == 0 && scheme->ambient == old->ambient &&
           (splits ? kind == LG_SCHEME_SPLITTING : explicit_kind);
}

/* The scheme of the highest order that can replace the problem's scheme; among equal orders the one with most
 * stages, since it has the smallest error. NULL: there is none. */
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

bool lg_is_near_floor(double loss, double floor) {
    return loss <= near_floor * floor;
}

void lg_hamiltonian_warn_of_floor(const lg_context *context, const lg_hamiltonian_problem *problem,
                                  double loss, double floor) {
    const lg_scheme *scheme = problem->scheme, *better = better_scheme(problem);
    const size_t size = problem->trajectories * trajectory_size(problem);
    static const double small = 1e-3;
    const double left = loss / lg_hamiltonian_unchanged(problem);
    double square = 0;
    char symmetry[160] = "";
    lg_momentum_motion motion;
    for (size_t i = 0; i < size; i++) square += problem->data[i] * problem->data[i] / (double)size;
    if (!lg_is_near_floor(loss, floor) || floor < rounding_floor * square) return;
    /* A wrong symmetry that conserves no momentum leaves a large loss, and its wrong forces can have a large
     * floor. */
    if (problem->model->symmetry != LG_SYMMETRY_NONE && left > small &&
        lg_hamiltonian_momentum_motion(context, problem, &motion) == LG_OK && !(motion.size > 0))
        (void)snprintf(symmetry, sizeof symmetry,
                       "; the error is %.2g %% of the motion: the potential may not have the symmetry of "
                       "--symmetry (none is without it)",
                       100.0 * sqrt(left));
    WARN("the loss %.3g is near the floor %.3g, which is the error of %s with %u step%s between two points: "
         "more training would fit this error, not the system; use --substeps %u (floor about %.1g)%s%s%s",
         loss, floor, scheme->name, problem->substeps, problem->substeps == 1 ? "" : "s",
         2 * problem->substeps, ldexp(floor, -2 * scheme->order),
         better != NULL ? " or a scheme of higher order, --scheme " : "", better != NULL ? better->name : "",
         symmetry);
}

/* Noise changes G equally at every point, except for the scatter of a mean over N trajectories. So the data
 * do not conserve G if a later point changes G by more than the second point does. */
lg_status lg_hamiltonian_warn_of_integral(const lg_context *context, const lg_hamiltonian_problem *problem) {
    static const double scatter = 4.0, least = 1e-3;
    double change[LG_HAMILTONIAN_MAX_POINTS], largest = 0;
    if (problem->penalty == 0) return LG_OK;
    LG_TRY(lg_hamiltonian_integral_changes(context, problem, change));
    for (size_t j = 1; j < problem->points; j++) largest = fmax(largest, change[j]);
    const double grown = 1 + scatter / sqrt((double)problem->trajectories);
    if (largest > grown * change[1] && largest > least * change[0])
        WARN("the data do not conserve %s: it changes by %.2g between the first and the second point and by "
             "up to %.2g later, and its size is %.2g (root mean squares); but the penalty trains the model "
             "to conserve it",
             problem->penalty_integral->name, change[1], largest, change[0]);
    return LG_OK;
}

lg_status lg_hamiltonian_warn_of_symmetry(const lg_context *context, const lg_hamiltonian_problem *problem) {
    const lg_field *row = lg_field_find(lg_hamiltonian_fields, "symmetry");
    lg_momentum_motion motion;
    LG_TRY(lg_hamiltonian_momentum_motion(context, problem, &motion));
    if (motion.moves)
        WARN("the data do not have the symmetry %s: the momentum that it conserves changes by up to %.2g "
             "along the trajectories, and its size is at most %.2g (root mean squares); --symmetry none is "
             "without this assumption",
             lg_field_name(row, (uint32_t)problem->model->symmetry), motion.moved, motion.size);
    return LG_OK;
}

/* ---- the data ---- */

void lg_warn_of_inputs(const lg_context *context, const char *path, const lg_trajectories *data) {
    if (data->inputs != NULL)
        WARN("%s: /inputs (%u numbers per step) is not used: the learned system has no inputs", path,
             data->input_dim);
}

typedef struct sorted {
    const double *data;
    size_t index, size; /* size: in bytes */
} sorted;

static int compare_trajectories(const void *a, const void *b) {
    const sorted *x = a, *y = b;
    const int order = memcmp(x->data, y->data, x->size);
    return order != 0 ? order : (x->index > y->index) - (x->index < y->index);
}

lg_status lg_hamiltonian_different(const lg_context *context, const lg_hamiltonian_problem *problem,
                                   size_t *out, size_t *count) {
    const size_t n = problem->trajectories, size = trajectory_size(problem);
    LG_TRY_SCRATCH(sorted, rows, context, n, LG_OUT_OF_MEMORY);
    for (size_t i = 0; i < n; i++) rows[i] = (sorted){problem->data + i * size, i, size * sizeof(double)};
    qsort(rows, n, sizeof *rows, compare_trajectories);
    *count = 0;
    for (size_t i = 0, last = 0; i < n; i++) {
        const bool again = i > 0 && memcmp(rows[last].data, rows[i].data, rows[i].size) == 0;
        if (!again) out[(*count)++] = rows[last = i].index;
    }
    return LG_OK;
}

lg_status lg_hamiltonian_warn_of_data(const lg_context *context, const lg_hamiltonian_problem *problem,
                                      const char *path) {
    const size_t parameters = lg_hamiltonian_parameters(problem->model), given = problem->trajectories;
    const size_t d = lg_hamiltonian_state_dim(problem->model);
    size_t count = 0;
    LG_TRY_SCRATCH(size_t, index, context, given, LG_OUT_OF_MEMORY);
    LG_TRY(lg_hamiltonian_different(context, problem, index, &count));
    const double numbers = (double)count * (double)(problem->points - 1) * (double)d;
    if (!lg_hamiltonian_moves(problem))
        WARN("%s: nothing moves: every trajectory stays at its first point, so any constant H explains the "
             "data",
             path);
    if (count < given)
        WARN(
            "%s: %zu of %zu trajectories repeat another one: only %zu different ones are there to learn from",
            path, given - count, given, count);
    if (numbers < (double)parameters)
        WARN("the data have %.0f numbers, fewer than the %zu parameters that are learned: the model may fit "
             "the data without learning the system; give %.0f trajectories or more, or a smaller --hidden",
             numbers, parameters, ceil((double)parameters / numbers * (double)count));
    return LG_OK;
}

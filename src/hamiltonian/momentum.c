/* Whether trajectories conserve the momentum that belongs to a symmetry, or a first integral. */
#include <math.h>

#include "core/clean.h"
#include "hamiltonian/internal.h"
#include "kernels/matrix.h"

LG_AT(lg_tape_destroy, lg_tape)

/* The momenta of all points, and the squared lengths of the parts of the states. */
typedef struct momenta {
    size_t n, points, k, parts; /* trajectories, points of each, components, parts of a state */
    double *J, *square;         /* (n, points, k), (n, points, parts) */
} momenta;

/* Records numbers (rows, k) of `rows` states, from their parts y in the units of the data. */
typedef lg_var (*quantity)(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_var *y);

/* The squared lengths of the parts. */
static lg_var squares_of(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_var *y) {
    const lg_space space = lg_hamiltonian_model_space(problem->model);
    const size_t parts = lg_taped_parts(&space);
    lg_var square[LG_HAMILTONIAN_MAX_PARTS];
    for (size_t i = 0; i < parts; i++) {
        const lg_shape flat = lg_shape2((uint32_t)problem->points, lg_hamiltonian_width(tape, y[i]));
        square[i] = lg_rownorm2(tape, lg_reshape(tape, y[i], flat));
    }
    return lg_concat(tape, square, parts, 1);
}

static lg_var momentum(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_var *y) {
    return lg_symmetry_row_of(problem->model->symmetry)->momentum(tape, problem->model, y);
}

static lg_var first_integral(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_var *y) {
    const lg_hamiltonian_vars vars = {.model = problem->model};
    const lg_first_integral *integral = lg_hamiltonian_integral_of(problem);
    return integral->record(integral->user, tape, &vars, y);
}

/* dG/dy with y divided by its scales; NaN where G is not finite. */
static lg_var slope(lg_tape *tape, const lg_hamiltonian_problem *problem, const lg_var *y) {
    const lg_space space = lg_hamiltonian_model_space(problem->model);
    const lg_var values = first_integral(tape, problem, y);
    lg_var each[LG_HAMILTONIAN_MAX_PARTS];
    if (lg_grad(tape, lg_sum(tape, values), y, lg_taped_parts(&space), each) != LG_OK) return LG_NONE;
    lg_hamiltonian_by_scales(tape, problem->model, each, each);
    return lg_add(tape, lg_taped_join(tape, &space, each), lg_scale(tape, values, 0.0));
}

/* Computes the quantity at all points: *out (n, points, *k), which the caller frees. */
static lg_status compute(const lg_context *context, const lg_hamiltonian_problem *problem, quantity record,
                         double **out, size_t *k) {
    const lg_space space = lg_hamiltonian_model_space(problem->model);
    const uint32_t rows = (uint32_t)problem->points, d = (uint32_t)space.dim;
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    LG_TRY(lg_tape_create(context, NULL, &tape));
    for (size_t i = 0; i < problem->trajectories; i++) {
        lg_var y[LG_HAMILTONIAN_MAX_PARTS];
        lg_tape_reset(tape);
        const lg_var x = lg_input(tape, lg_shape2(rows, d), problem->data + i * rows * d);
        LG_TRY(lg_taped_split(tape, &space, x, y));
        const lg_var values = record(tape, problem, y);
        LG_TRY(lg_tape_status(tape));
        *k = lg_var_shape(tape, values).dims[1];
        if (*out == NULL) *out = lg_alloc(context, problem->trajectories * rows * *k, sizeof **out);
        if (*out == NULL) return LG_OUT_OF_MEMORY;
        LG_TRY(lg_read(tape, values, rows * *k, *out + i * rows * *k));
    }
    return LG_OK;
}

/* Root mean squares over the trajectories at point j: *moved of the change since point 0, *left of what a
 * common factor from 0 to 1 leaves of it. */
static void change_at(const momenta *m, size_t j, double *moved, double *left) {
    double product = 0.0, square = 0.0, change = 0.0, rest = 0.0;
    for (int pass = 0; pass < 2; pass++) {
        const double factor = square > 0.0 ? fmin(fmax(product / square, 0.0), 1.0) : 1.0;
        for (size_t i = 0; i < m->n; i++)
            for (size_t c = 0; c < m->k; c++) {
                const double *at = m->J + i * m->points * m->k + c, first = at[0], now = at[j * m->k];
                if (pass == 0)
                    product += first * now, square += first * first;
                else
                    change += (now - first) * (now - first), rest += pow(now - factor * first, 2.0);
            }
    }
    *moved = sqrt(change / (double)m->n), *left = sqrt(rest / (double)m->n);
}

/* Mean square of part k at point j. */
static double part_at(const momenta *m, size_t j, size_t k) {
    double sum = 0.0;
    for (size_t i = 0; i < m->n; i++) sum += m->square[(i * m->points + j) * m->parts + k] / (double)m->n;
    return sum;
}

/* The factor by which equal noise in the states can change the momentum more at point j than at point 1. */
static double noise_growth(const momenta *m, size_t j) {
    double growth = 1.0;
    for (size_t k = 0; k < m->parts; k++) growth = fmax(growth, sqrt(part_at(m, j, k) / part_at(m, 1, k)));
    return growth;
}

static double size_of(const momenta *m) {
    double sum = 0.0;
    for (size_t i = 0; i < m->n * m->points; i++) {
        const double *square = m->square + i * m->parts;
        double bound = 0.0;
        for (size_t k = 0; k + 1 < m->parts; k += 2) bound += sqrt(square[k]) * sqrt(square[k + 1]);
        sum += bound * bound / (double)(m->n * m->points);
    }
    return sqrt(sum);
}

/* The change of the momentum by noise, from second differences in time, which are small where the momentum
 * moves smoothly: those of equal noise have 3 times the mean square of a change. Infinite for fewer than
 * three points. */
static double noise_of(const momenta *m) {
    const size_t j = m->points > 3 ? 1 : 0; /* often the first point alone has no noise */
    double sum = 0.0;
    if (m->points < 3) return INFINITY;
    for (size_t i = 0; i < m->n; i++)
        for (size_t c = 0; c < m->k; c++) {
            const double *at = m->J + (i * m->points + j) * m->k + c;
            sum += pow(at[0] - 2.0 * at[m->k] + at[2 * m->k], 2.0);
        }
    return sqrt(sum / (3.0 * (double)m->n));
}

/* The momentum moves if it changes by more than the noise at that point can explain, with a margin for the
 * scatter of a mean over the trajectories. */
static void compare(const momenta *m, lg_momentum_motion *out) {
    static const double scatter = 4.0, least = 1e-3, most = 0.5;
    const double grown = 1.0 + scatter / sqrt((double)m->n);
    const double noise = noise_of(m);
    out->size = size_of(m);
    for (size_t j = 1; j < m->points; j++) {
        double moved, left;
        change_at(m, j, &moved, &left);
        out->moved = fmax(out->moved, moved);
        out->moves = out->moves || (left > most * moved && left > least * out->size &&
                                    left > grown * noise * noise_growth(m, j));
    }
}

lg_status lg_hamiltonian_momentum_motion(const lg_context *context, const lg_hamiltonian_problem *problem,
                                         lg_momentum_motion *out) {
    const lg_symmetry_row *row = lg_symmetry_row_of(problem->model->symmetry);
    momenta m = {.n = problem->trajectories, .points = problem->points};
    *out = (lg_momentum_motion){0.0, 0.0, false};
    if (row == NULL || row->momentum == NULL || row->count(problem->model) == 0) return LG_OK;
    if (row->isotropic && problem->model->family->inputs * problem->model->n < 2) return LG_OK;
    lg_status status = compute(context, problem, momentum, &m.J, &m.k);
    if (status == LG_OK) status = compute(context, problem, squares_of, &m.square, &m.parts);
    if (status == LG_OK) compare(&m, out);
    LG_FREE_ALL(context, m.J, m.square);
    return status;
}

lg_status lg_hamiltonian_integral_changes(const lg_context *context, const lg_hamiltonian_problem *problem,
                                          double *out) {
    momenta m = {.n = problem->trajectories, .points = problem->points};
    double square = 0.0, left;
    const lg_status status = compute(context, problem, first_integral, &m.J, &m.k);
    for (size_t i = 0; status == LG_OK && i < m.n; i++) square += pow(m.J[i * m.points], 2.0);
    out[0] = sqrt(square / (double)m.n);
    for (size_t j = 1; status == LG_OK && j < m.points; j++) change_at(&m, j, &out[j], &left);
    lg_free(context, m.J);
    return status;
}

/* Root mean square of |slope| over all points. */
static lg_status measure_unit(const lg_context *context, const lg_hamiltonian_problem *problem, double *out,
                              lg_error *error) {
    const size_t n = problem->trajectories * problem->points;
    double *slopes = NULL, unit = 0.0;
    size_t k = 0;
    const lg_status status = compute(context, problem, slope, &slopes, &k);
    if (status == LG_OK) unit = lg_matrix_norm(n * k, slopes) / sqrt((double)n);
    lg_free(context, slopes);
    if (status != LG_OK) return lg_fail(error, status, "%s", lg_status_sentence(status));
    if (!isfinite(unit) || unit == 0.0)
        return lg_fail(error, LG_NOT_FINITE, "%s: %s %s points of the data", problem->penalty_integral->name,
                       problem->penalty_integral->formula,
                       unit == 0.0 ? "has the slope 0 at all" : "or its derivative is not finite at some");
    *out = unit;
    return LG_OK;
}

lg_status lg_hamiltonian_integral_unit(const lg_context *context, const lg_hamiltonian_problem *problem,
                                       double *out, lg_error *error) {
    LG_NEEDS(error, problem, out);
    lg_hamiltonian_problem punished = *problem;
    if (punished.penalty == 0.0) punished.penalty = 1.0;
    LG_TRY(lg_hamiltonian_problem_check(&punished, error));
    const lg_first_integral *integral = lg_hamiltonian_integral_of(problem);
    if (integral->measured) return measure_unit(context, problem, out, error);
    *out = 1.0;
    for (size_t i = 0; i < LG_HAMILTONIAN_MAX_PARTS; i++)
        *out *= pow(problem->model->scales.part[i], integral->power[i]);
    return LG_OK;
}

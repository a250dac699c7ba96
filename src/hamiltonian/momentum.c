/* Whether trajectories conserve the momentum that belongs to a symmetry. */
#include <math.h>

#include "core/core.h"
#include "hamiltonian/internal.h"
#include "liegrad/ops.h"
#include "liegrad/taped.h"

/* The momenta of all points, and a bound on each. */
typedef struct momenta {
    size_t n, points, k; /* trajectories, points of each, components */
    double *J, *bound;   /* (n, points, k), (n, points) */
} momenta;

/* sum_i |y_i| |y_(i+1)| over the pairs of parts, (B, 1) */
static lg_var bound_of(lg_tape *tape, const lg_var *y, size_t parts, uint32_t rows) {
    lg_var sum = LG_NONE;
    for (size_t i = 0; i + 1 < parts; i += 2) {
        lg_var square[2];
        for (size_t s = 0; s < 2; s++) {
            const uint32_t each = (uint32_t)(lg_shape_count(lg_var_shape(tape, y[i + s])) / rows);
            square[s] = lg_rownorm2(tape, lg_reshape(tape, y[i + s], lg_shape2(rows, each)));
        }
        const lg_var both = lg_sqrt(tape, lg_mul(tape, square[0], square[1]));
        sum = i == 0 ? both : lg_add(tape, sum, both);
    }
    return sum;
}

static lg_status take_trajectory(lg_tape *tape, const lg_hamiltonian_problem *problem, size_t i,
                                 const lg_context *context, momenta *out) {
    const lg_hamiltonian *model = problem->model;
    const lg_space space = lg_hamiltonian_space_of(model->family, model->n);
    const uint32_t d = lg_hamiltonian_state_dim(model), rows = (uint32_t)out->points;
    const lg_mark mark = lg_tape_mark(tape);
    lg_var y[LG_HAMILTONIAN_MAX_PARTS];
    const lg_var x = lg_input(tape, lg_shape2(rows, d), problem->data + i * rows * d);
    (void)lg_taped_split(tape, &space, x, y);
    const lg_var J = lg_symmetry_row_of(model->symmetry)->momentum(tape, model, y),
                 bound = bound_of(tape, y, lg_taped_parts(&space), rows);
    LG_TRY(lg_tape_status(tape));
    out->k = lg_var_shape(tape, J).dims[1];
    if (out->J == NULL) out->J = lg_alloc(context, out->n * rows * out->k, sizeof *out->J);
    if (out->J == NULL) return LG_OUT_OF_MEMORY;
    LG_TRY(lg_read(tape, J, rows * out->k, out->J + i * rows * out->k));
    LG_TRY(lg_read(tape, bound, rows, out->bound + i * rows));
    return lg_tape_rewind(tape, mark);
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

/* Noise changes the momentum equally at every point, except for the scatter of a mean over the trajectories.
 * So the momentum moves if it changes by more at a later point than at the second one. */
static void compare(const momenta *m, lg_momentum_motion *out) {
    static const double scatter = 4.0, least = 1e-3, most = 0.5;
    double second = 0.0, largest = 0.0;
    for (size_t i = 0; i < m->n * m->points; i++)
        out->size += m->bound[i] * m->bound[i] / (double)(m->n * m->points);
    out->size = sqrt(out->size);
    for (size_t j = 1; j < m->points; j++) {
        double moved, left;
        change_at(m, j, &moved, &left);
        if (j == 1) second = left;
        if (left > most * moved) largest = fmax(largest, left);
        out->moved = fmax(out->moved, moved);
    }
    out->moves = largest > (1.0 + scatter / sqrt((double)m->n)) * second && largest > least * out->size;
}

lg_status lg_hamiltonian_momentum_motion(const lg_context *context, const lg_hamiltonian_problem *problem,
                                         lg_momentum_motion *out) {
    LG_NEEDS(NULL, problem, out);
    LG_TRY(lg_hamiltonian_problem_check(problem, NULL));
    const lg_symmetry_row *row = lg_symmetry_row_of(problem->model->symmetry);
    momenta m = {.n = problem->trajectories, .points = problem->points};
    lg_tape *tape = NULL;
    *out = (lg_momentum_motion){0.0, 0.0, false};
    if (row == NULL || row->momentum == NULL || row->count(problem->model) == 0) return LG_OK;
    if (row->isotropic && problem->model->family->inputs * problem->model->n < 2) return LG_OK;
    m.bound = lg_alloc(context, m.n * m.points, sizeof *m.bound);
    lg_status status = m.bound != NULL ? lg_tape_create(context, NULL, &tape) : LG_OUT_OF_MEMORY;
    for (size_t i = 0; i < m.n && status == LG_OK; i++)
        status = take_trajectory(tape, problem, i, context, &m);
    if (status == LG_OK) compare(&m, out);
    lg_tape_destroy(tape);
    lg_free(context, m.J);
    lg_free(context, m.bound);
    return status;
}

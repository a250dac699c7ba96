/* Learned Hamiltonians: the training loss, and the fields that only training wants. */
#include <float.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/ops.h"
#include "models/hamiltonian_internal.h"

/* What one batch needs of theta, built once on its tape. */
typedef struct bound {
    lg_hamiltonian_vars vars;
    lg_var inverse_mii; /* chain: 1/m_ii (1, k, 1) */
} bound;

/* v = dH/dp, g = dH/dq on the manifold. One link needs no multiplier there, T = |p|^2/(2 m). */
static void tangent_gradient(lg_tape *tape, const bound *b, lg_var q, lg_var p, lg_var *v, lg_var *g) {
    if (b->vars.model->links > 1) {
        lg_hamiltonian_chain_gradient(tape, &b->vars, q, p, v, g);
        return;
    }
    *g = lg_hamiltonian_potential_gradient(tape, &b->vars, q);
    *v = lg_mul(tape, p, b->vars.W);
}

/* T = 1/2 p^T W p + 1/2 u^T S^-1 r off the manifold, summed over the batch. */
static lg_var extended_kinetic(lg_tape *tape, const bound *b, lg_var q, lg_var p) {
    const lg_var W = b->vars.W, unit = lg_hamiltonian_unit_matrix(tape, b->vars.model->links);
    lg_var wp = lg_matmul(tape, W, p);
    lg_var u = lg_rowdot(tape, q, wp);
    lg_var gap = lg_add_scalar(tape, lg_neg(tape, lg_rownorm2(tape, q)), 1.0);
    lg_var diagonal = lg_mul(tape, unit, lg_mul(tape, gap, b->inverse_mii));
    lg_var S = lg_add(tape, diagonal, lg_mul(tape, lg_matmul_nt(tape, q, q), W));
    lg_var r = lg_sub(tape, lg_mul(tape, lg_rowdot(tape, q, p), b->inverse_mii), u);
    lg_var free = lg_sum(tape, lg_rowdot(tape, p, wp));
    lg_var tied = lg_sum(tape, lg_mul(tape, u, lg_spd_solve(tape, S, r)));
    return lg_scale(tape, lg_add(tape, free, tied), 0.5);
}

/* v = dH/dp, g = dH/dq of the extension. */
static void extended_gradient(lg_tape *tape, const bound *b, lg_var q, lg_var p, lg_var *v, lg_var *g) {
    if (b->vars.model->links == 1) {
        tangent_gradient(tape, b, q, p, v, g);
        return;
    }
    lg_var wrt[2] = {p, q}, out[2] = {LG_NONE, LG_NONE};
    if (lg_grad(tape, extended_kinetic(tape, b, q, p), wrt, 2, out) != LG_OK) return;
    *v = out[0];
    *g = lg_add(tape, out[1], lg_hamiltonian_potential_gradient(tape, &b->vars, q));
}

static lg_status chain_field_lie(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,
                                 lg_var *algebra) {
    lg_var v = LG_NONE, g = LG_NONE;
    (void)t;
    tangent_gradient(tape, user, y[0], y[1], &v, &g);
    return lg_hamiltonian_chain_lift(tape, y, v, g, input, algebra);
}

/* q' = v - q (q.v), p' = -g + q (q.g) + p (q.v) - q (p.v), in ambient coordinates (B, k, 3) */
static lg_status chain_field_ambient(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y,
                                     lg_var input, lg_var *out) {
    lg_var q = y[0], p = y[1], v = LG_NONE, g = LG_NONE;
    (void)t, (void)input; /* training has none */
    extended_gradient(tape, user, q, p, &v, &g);
    lg_var qv = lg_rowdot(tape, q, v), qg = lg_rowdot(tape, q, g), pv = lg_rowdot(tape, p, v);
    out[0] = lg_sub(tape, v, lg_mul(tape, q, qv));
    lg_var along_q = lg_mul(tape, q, lg_sub(tape, qg, pv));
    out[1] = lg_add(tape, lg_sub(tape, along_q, g), lg_mul(tape, p, qv));
    return lg_tape_status(tape);
}

static lg_status taped_ode(bound *b, const lg_scheme *scheme, lg_taped_ode *ode) {
    const size_t k = b->vars.model->links;
    LG_TRY(lg_hamiltonian_taped_ode(&b->vars, ode));
    if (b->vars.model->family == LG_HAMILTONIAN_SEPARABLE) return LG_OK;
    ode->user = b;
    ode->field = scheme->ambient ? chain_field_ambient : chain_field_lie;
    if (!scheme->ambient) return LG_OK;
    return lg_space_init(&ode->space, (lg_space_factor[]){{LG_SPACE_RN, 3 * k}, {LG_SPACE_RN, 3 * k}}, 2);
}

/* ---- data ---- */

/* Which component of a state stands at place c of part 0 (q) or 1 (p). */
static size_t component(const lg_hamiltonian *model, size_t part, size_t c) {
    if (model->family == LG_HAMILTONIAN_CHAIN) return 6 * (c / 3) + 3 * part + c % 3;
    return part * model->links + c;
}

static void store(lg_dtype dtype, void *values, size_t i, double value) {
    if (dtype == LG_F64)
        ((double *)values)[i] = value;
    else
        ((float *)values)[i] = (float)value;
}

/* Points first..last of the samples as one tensor, ((last - first + 1) count, ...), point-major, so that it
 * stands beside the concatenated predictions. */
static lg_var gather_points(lg_tape *tape, const lg_hamiltonian_problem *problem, size_t part,
                            const uint32_t *samples, size_t count, size_t first, size_t last) {
    const lg_hamiltonian *model = problem->model;
    const size_t half = lg_hamiltonian_state_size(model) / 2;
    const uint32_t rows = (uint32_t)((last - first + 1) * count);
    lg_shape shape = model->family == LG_HAMILTONIAN_CHAIN ? lg_shape3(rows, model->links, 3)
                                                           : lg_shape2(rows, model->links);
    void *values;
    lg_var out = lg_input_buffer(tape, shape, &values);
    if (lg_is_none(out)) return out;
    size_t at = 0;
    for (size_t j = first; j <= last; j++)
        for (size_t s = 0; s < count; s++) {
            const double *state = problem->data + (samples[s] * problem->points + j) * 2 * half;
            for (size_t c = 0; c < half; c++)
                store(lg_tape_dtype(tape), values, at++, state[component(model, part, c)]);
        }
    return out;
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

/* Sum of squares of predicted minus given points over both parts. */
static lg_var squared_error(lg_tape *tape, const lg_hamiltonian_problem *problem, const uint32_t *samples,
                            size_t count, const lg_var *predicted) {
    const size_t last = problem->points - 1;
    lg_var total = LG_NONE;
    for (size_t part = 0; part < 2; part++) {
        lg_var points[LG_HAMILTONIAN_MAX_POINTS];
        for (size_t j = 0; j < last; j++) points[j] = predicted[2 * j + part];
        lg_var whole = lg_concat(tape, points, last, 0);
        lg_var difference = lg_sub(tape, whole, gather_points(tape, problem, part, samples, count, 1, last));
        lg_var sum = lg_sum(tape, lg_square(tape, difference));
        total = lg_is_none(total) ? sum : lg_add(tape, total, sum);
    }
    return total;
}

static lg_status shard_loss(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                            size_t batch, lg_var *loss) {
    const lg_hamiltonian_problem *problem = user;
    const lg_scheme *scheme = lg_scheme_find(lg_train_integrator_name(problem->integrator));
    bound b;
    lg_taped_ode ode;
    LG_TRY(lg_hamiltonian_bind_extended(tape, problem->model, theta, &b.vars, &b.inverse_mii));
    LG_TRY(taped_ode(&b, scheme, &ode));
    lg_var start[2], predicted[2 * LG_HAMILTONIAN_MAX_POINTS];
    for (size_t part = 0; part < 2; part++)
        start[part] = gather_points(tape, problem, part, samples, count, 0, 0);
    const size_t steps = problem->substeps * (problem->points - 1);
    LG_TRY(lg_taped_integrate(tape, scheme, &ode, 0.0, problem->dt / problem->substeps, steps,
                              problem->substeps, start, predicted));
    const double terms =
        (double)batch * lg_hamiltonian_state_size(problem->model) * (double)(problem->points - 1);
    lg_var total = lg_scale(tape, squared_error(tape, problem, samples, count, predicted), 1.0 / terms);
    if (problem->penalty != 0.0) {
        double weight = problem->penalty_form == LG_PENALTY_MEAN_SQUARE ? problem->penalty / (double)batch
                                                                        : problem->penalty;
        total = lg_add(tape, total, lg_scale(tape, penalty_sum(tape, problem, start, predicted), weight));
    }
    *loss = total;
    return lg_tape_status(tape);
}

lg_status lg_hamiltonian_problem_check(const lg_hamiltonian_problem *problem, lg_error *error) {
    if (problem->model == NULL || problem->data == NULL || problem->trajectories == 0 ||
        problem->substeps == 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "no model, no data, no trajectories or no substeps");
    if (problem->points < 2 || problem->points > LG_HAMILTONIAN_MAX_POINTS)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the number of points is %zu, not in 2..%d",
                       problem->points, LG_HAMILTONIAN_MAX_POINTS);
    /* The points of a batch stand in one tensor. */
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
    const char *name = lg_train_integrator_name(problem->integrator);
    const lg_scheme *scheme = lg_scheme_find(name);
    if (scheme == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "unknown integrator");
    const bool chain = problem->model->family == LG_HAMILTONIAN_CHAIN;
    if (chain && scheme->kind == LG_SCHEME_SPLITTING)
        return lg_fail(error, LG_UNSUPPORTED, "%s needs a separable Hamiltonian; a chain has none", name);
    if (!chain && !scheme->ambient && scheme->kind != LG_SCHEME_SPLITTING)
        return lg_fail(error, LG_UNSUPPORTED,
                       "%s is for chains on the sphere; use euler, rk4 or stormer-verlet", name);
    if (chain && problem->penalty != 0.0)
        return lg_fail(error, LG_UNSUPPORTED, "the first-integral penalty is for separable systems only");
    return LG_OK;
}

void lg_hamiltonian_fit_problem(const lg_hamiltonian_problem *problem, lg_fit_problem *out) {
    /* The loss only reads the problem. */
    union {
        const lg_hamiltonian_problem *borrowed;
        void *user;
    } pointer = {.borrowed = problem};
    *out = (lg_fit_problem){.parameters = lg_hamiltonian_parameters(problem->model),
                            .samples = problem->trajectories,
                            .loss = shard_loss,
                            .user = pointer.user};
}

/* Machines: the loss to expect of a model that explains the logs except for their noise.
 *
 * Near the best fit the residuals are linear: r = e - S d - J t with the noise e, changes d of the starts and
 * changes t of the parameters. P projects onto the columns of S. Estimated starts remove the part of e along
 * S, window by window: r' = (1 - P) e. The parameters then remove the part along J' = (1 - P) J. With the
 * covariance C of e
 *   E |r|^2 = tr((1 - P) C) - tr((J'^T J')^-1 J'^T C J'),
 * so each number of a start and each parameter reduces the sum by about 1 in units of the noise. Measured
 * starts add their own noise, with covariance C_0: C = diag + S C_0 S^T and P = 0.
 * The steps' own error f adds |f'|^2 - b^T (J'^T J')^-1 b with f' = (1 - P) f and b = J'^T f'. */
#include <math.h>
#include <string.h>

#include "kernels/kernels.h"
#include "machine/internal.h"

enum { MOST_PARAMETERS = 256 };

typedef struct expecting {
    lg_machine_problem problem; /* its starts are always set to estimated */
    lg_fit_errors of;           /* linearises the windows */
    bool measured;              /* whether the caller's problem has measured starts */
    const lg_machine_noise *noise;
    size_t rows;      /* residuals per window without priors */
    double *variance; /* (3 * rows): add_window uses it as scratch */
    double *J, *K;    /* (n, n): J'^T J', with priors, and J'^T C J', summed over windows */
    double *b;        /* (n + 1): J'^T f' and |f'|^2, summed over windows */
    size_t n;         /* parameters; the columns of `of` have f behind these */
    /* `left`: tr((1 - P) C), summed over windows. `unit`: what one number adds to the loss if its error is
     * one scale of the loss. */
    double left, unit;
} expecting;

/* Adds the effect of a measured start's noise on the residuals to `left` and K. */
static void add_start(expecting *e, const double *columns, const double *variance) {
    const size_t n = e->n, stride = e->of.rows;
    for (size_t k = 0; k < e->of.fit.own; k++) {
        const double *S = columns + (e->of.n + k) * stride;
        if (!(variance[k] > 0.0)) continue;
        e->left += variance[k] * lg_fit_dot(S, S, e->rows);
        for (size_t i = 0; i < n; i++)
            for (size_t j = 0; j < n; j++)
                e->K[i * n + j] += variance[k] * lg_fit_dot(columns + i * stride, S, e->rows) *
                                   lg_fit_dot(columns + j * stride, S, e->rows);
    }
}

static void add_window(void *user, double *columns, uint32_t window) {
    expecting *e = user;
    const lg_fit_errors *of = &e->of;
    const size_t n = e->n, d = e->rows / e->problem.window, first = e->measured ? d : 0;
    const double factor = sqrt(e->unit);
    double *variance = e->variance, *part = variance + e->rows, *of_start = part + e->rows,
           *f = columns + n * of->rows;
    for (uint32_t j = 0; j < e->problem.window; j++)
        lg_machine_row_variances(&e->problem, e->noise, e->problem.start[window] + j, factor,
                                 variance + j * d, part + j * d);
    for (size_t i = 0; i < d; i++) of_start[i] = variance[i] / (e->unit * (double)e->problem.windows);
    memset(variance, 0, first * sizeof *variance);
    for (size_t j = 0; j < of->n + of->fit.own; j++)
        memset(columns + j * of->rows, 0, first * sizeof *columns);
    e->left += lg_fit_dot(variance, part, e->rows);
    if (!e->measured) e->left -= lg_fit_take_start(columns, of->rows, e->rows, of->n, of->fit.own, variance);
    for (size_t i = 0; i <= n; i++) e->b[i] += lg_fit_dot(columns + i * of->rows, f, e->rows);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            const double *a = columns + i * of->rows, *b = columns + j * of->rows;
            e->J[i * n + j] += lg_fit_dot(a, b, of->fit.rows);
            e->K[i * n + j] += lg_fit_dot3(a, b, variance, e->rows);
        }
    if (e->measured) add_start(e, columns, of_start);
}

/* Sets `out` to tr(J^-1 K) over the eigenvectors of J that the residuals determine, and takes b^T J^-1 b from
 * |f'|^2. Network weights have the prior N(0, 1). */
static lg_status taken(expecting *e, double *values, double *out) {
    static const double shown = 1e-12;
    const size_t n = e->n;
    *out = 0.0;
    if (n == 0) return LG_OK;
    for (size_t i = 0; i < e->problem.machine->weights; i++) e->J[i * n + i] += e->unit;
    const lg_status status = lg_fit_eigen(e->of.context, n, e->J, values);
    if (status == LG_NOT_FINITE) *out = INFINITY;
    if (status != LG_OK) return status == LG_NOT_FINITE ? LG_OK : status;
    for (size_t k = 0; k < n; k++) {
        const double *v = e->J + k * n;
        if (!(values[k] > shown * values[n - 1])) continue;
        for (size_t i = 0; i < n; i++) *out += v[i] * lg_fit_dot(e->K + i * n, v, n) / values[k];
        e->b[n] -= pow(lg_fit_dot(e->b, v, n), 2.0) / values[k];
    }
    return LG_OK;
}

/* ---- changes of the velocities ---- */

/* Adds for each coordinate the squares, in units of the loss, of its velocities (or accelerations) minus
 * those of the start, or their mean where starts are estimated, and of the displacements that they make. */
static void add_changes(const expecting *e, lg_machine_noise *out) {
    const lg_machine_problem *problem = &e->problem;
    const lg_machine *machine = problem->machine;
    const uint32_t first = e->measured ? 1 : problem->window;
    const double factor = 1.0 / ((double)e->of.used * (double)problem->window);
    double q[LG_MACHINE_POSITIONS], v[2][LG_MACHINE_VELOCITIES], there[LG_MACHINE_VELOCITIES];
    for (size_t w = 0; w < e->of.used; w++) {
        const size_t start = problem->start[lg_spread(w, e->of.windows, e->of.used)];
        double mean[LG_MACHINE_VELOCITIES] = {0}, run[LG_MACHINE_VELOCITIES] = {0};
        for (uint32_t j = 0; j < first; j++) {
            lg_machine_shown_row(machine, &problem->log, start + j, q, v[0]);
            for (uint32_t k = 0; k < machine->velocities; k++) mean[k] += v[0][k] / first;
        }
        for (size_t row = start; row < start + problem->window; row++) {
            double *now = v[(row - start) % 2], *before = v[(row - start + 1) % 2];
            lg_machine_shown_row(machine, &problem->log, row, q, now);
            lg_machine_weigh_row(problem, row, 1.0, q, there);
            for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);)
                for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++) {
                    now[k] = (now[k] - mean[k]) * lg_machine_shown_unit(machine, k);
                    if (row > start && !machine->accelerations)
                        run[k] +=
                            0.5 * (now[k] + before[k]) * (problem->log.t[row] - problem->log.t[row - 1]);
                    if (there[k] != 0.0)
                        out->velocity[at.index] +=
                            factor * pow(now[k] / problem->velocity_scale[at.index], 2.0);
                    out->position[at.index] += factor * pow(run[k] / problem->position_scale[at.index], 2.0);
                }
        }
    }
}

/* ---- the whole loss ---- */

static lg_status expect(expecting *e, double *values, lg_machine_expected *out) {
    /* Turns a mean over points 0 .. M - 1 into a mean over the points that count in the loss. */
    const double points = (double)e->problem.window / (e->problem.window - (e->measured ? 1.0 : 0.0));
    double lost = 0.0;
    e->unit = 1.0 / ((double)e->of.used * (double)e->problem.window);
    LG_TRY(lg_fit_errors_gather(&e->of, false));
    LG_TRY(taken(e, values, &lost));
    lost = fmin(lost * (double)e->of.used / (double)e->of.windows, 0.5 * e->left);
    *out = (lg_machine_expected){.loss = points * (e->left - lost), .steps = points * fmax(e->b[e->n], 0.0)};
    add_changes(e, &out->change);
    return LG_OK;
}

lg_status lg_machine_expect(const lg_context *context, const lg_machine_problem *problem, const double *theta,
                            const lg_machine_noise *noise, lg_machine_expected *out, lg_error *error) {
    const lg_machine *machine = problem->machine;
    const bool measured = !lg_machine_starts_estimated(problem), many = machine->parameters > MOST_PARAMETERS;
    const size_t given = machine->parameters, n = many ? 0 : given,
                 starts = problem->windows * lg_machine_start_numbers(machine);
    expecting e = {.problem = *problem, .measured = measured, .noise = noise};
    e.problem.starts = LG_MACHINE_STARTS_ESTIMATED;
    if (many) e.problem.theta = theta;
    e.rows = lg_machine_linearised_rows(&e.problem) - lg_machine_problem_priors(&e.problem);
    LG_TRY_SCRATCH(double, all, context, given + starts + 3 * e.rows + (2 * n + 2) * n + 1,
                   lg_no_memory(error));
    e.n = n;
    e.variance = all + given + starts;
    e.J = e.variance + 3 * e.rows;
    e.K = e.J + n * n;
    e.b = e.K + n * n;
    memcpy(all, theta, lg_machine_problem_parameters(problem) * sizeof *all);
    e.of = lg_machine_errors(context, &e.problem, many ? all + given : all, LG_MACHINE_MOST_WINDOWS);
    e.of.fit.linearise = lg_machine_linearise_steps;
    e.of.n = n + 1;
    e.of.last = true;
    e.of.visit = add_window;
    e.of.user = &e;
    const lg_status status = expect(&e, e.b + n + 1, out);
    return lg_fit_errors_end(&e.of, status, error);
}

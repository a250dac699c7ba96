/* Machines: the loss to expect of a model that explains the logs except for their noise.
 *
 * Near the best fit the residuals are linear: r = e - S d - J t with the noise e, changes d of the starts and
 * changes t of the parameters. P projects onto the columns of S. Estimated starts remove the part of e along
 * S, window by window: r' = (1 - P) e. The parameters then remove the part along J' = (1 - P) J. With the
 * covariance C of e
 *   E |r|^2 = tr((1 - P) C) - tr((J'^T J')^-1 J'^T C J'),
 * so each number of a start and each parameter reduces the sum by about 1 in units of the noise. Measured
 * starts add their own noise, with covariance C_0: C = diag + S C_0 S^T and P = 0. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "kernels/kernels.h"
#include "machine/internal.h"

enum { CHUNK = 64, MOST_PARAMETERS = 256 };

typedef struct expecting {
    const lg_context *context;
    lg_machine_problem problem; /* its starts are always set to estimated */
    bool measured;              /* whether the caller's problem has measured starts */
    const lg_machine_noise *noise;
    const double *theta; /* (parameters, numbers of all starts) */
    size_t chunk;        /* windows that are linearised at once, at most CHUNK */
    size_t n, own, rows; /* number of parameters, of numbers per start, of residuals per window */
    size_t all;          /* rows, and the rows of priors */
    double *jacobian;    /* (CHUNK, all, n + own) */
    double *residuals;   /* (CHUNK, all); behind them the work arrays of add_window */
    double *columns;     /* (n + own, rows): the Jacobian of one window, by columns */
    double *J, *K;       /* (n, n): J'^T J' and J'^T C J', summed over windows */
    /* `left`: tr((1 - P) C), summed over windows. `unit`: what one number adds to the loss if its error is
     * one scale of the loss. */
    double left, unit;
} expecting;

static double dot(const double *a, const double *b, size_t n) {
    return lg_kernels_for(LG_F64)->dot(n, a, b);
}

/* Sum of a[i] b[i] c[i]. */
static double dot3(const double *a, const double *b, const double *c, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += a[i] * b[i] * c[i];
    return sum;
}

double lg_machine_take_start(double *columns, size_t stride, size_t rows, size_t n, size_t own,
                             const double *variance) {
    static const double rounding = 1e-20;
    double before[2 * LG_MACHINE_VELOCITIES], taken = 0.0;
    for (size_t k = 0; k < own; k++) {
        const double *column = columns + (n + k) * stride;
        before[k] = dot(column, column, rows);
    }
    for (size_t k = n + own; k-- > n;) {
        const double *pivot = columns + k * stride;
        const double norm = dot(pivot, pivot, rows);
        if (!(norm > rounding * before[k - n])) continue;
        taken += variance != NULL ? dot3(pivot, pivot, variance, rows) / norm : 1.0;
        for (size_t j = 0; j < k; j++) {
            double *column = columns + j * stride;
            lg_kernels_for(LG_F64)->axpy(rows, -dot(pivot, column, rows) / norm, pivot, column);
        }
    }
    return taken;
}

/* Adds the effect of a measured start's noise on the residuals to `left` and K. */
static void add_start(expecting *e, const double *variance) {
    for (size_t k = 0; k < e->own; k++) {
        const double *S = e->columns + (e->n + k) * e->rows;
        if (!(variance[k] > 0.0)) continue;
        e->left += variance[k] * dot(S, S, e->rows);
        for (size_t i = 0; i < e->n; i++)
            for (size_t j = 0; j < e->n; j++)
                e->K[i * e->n + j] += variance[k] * dot(e->columns + i * e->rows, S, e->rows) *
                                      dot(e->columns + j * e->rows, S, e->rows);
    }
}

static void add_window(expecting *e, const double *jacobian, size_t start, double factor) {
    const size_t columns = e->n + e->own, d = e->rows / e->problem.window, first = e->measured ? d : 0;
    double *variance = e->residuals + e->chunk * e->all, *part = variance + e->rows,
           *of_start = part + e->rows;
    for (uint32_t j = 0; j < e->problem.window; j++)
        lg_machine_row_variances(&e->problem, e->noise, start + j, factor, variance + j * d, part + j * d);
    for (size_t i = 0; i < d; i++) of_start[i] = variance[i] / (factor * factor * (double)e->problem.windows);
    for (size_t row = 0; row < e->rows; row++) {
        const bool counts = row >= first;
        if (!counts) variance[row] = 0.0;
        for (size_t j = 0; j < columns; j++)
            e->columns[j * e->rows + row] = counts ? jacobian[row * columns + j] : 0.0;
        e->left += variance[row] * part[row];
    }
    if (!e->measured) e->left -= lg_machine_take_start(e->columns, e->rows, e->rows, e->n, e->own, variance);
    for (size_t i = 0; i < e->n; i++)
        for (size_t j = 0; j < e->n; j++) {
            const double *a = e->columns + i * e->rows, *b = e->columns + j * e->rows;
            e->J[i * e->n + j] += dot(a, b, e->rows);
            e->K[i * e->n + j] += dot3(a, b, variance, e->rows);
        }
    if (e->measured) add_start(e, of_start);
}

static lg_status add_windows(expecting *e, lg_tape *tape, size_t all, size_t used) {
    lg_fit_problem fit;
    uint32_t samples[CHUNK];
    double loss;
    e->unit = 1.0 / ((double)used * (double)e->problem.window);
    const double factor = sqrt(e->unit);
    lg_machine_fit_problem(&e->problem, &fit);
    for (size_t first = 0; first < used; first += e->chunk) {
        const size_t count = used - first < e->chunk ? used - first : e->chunk;
        for (size_t i = 0; i < count; i++) samples[i] = (uint32_t)lg_spread(first + i, all, used);
        LG_TRY(
            fit.linearise(fit.user, tape, e->theta, samples, count, used, &loss, e->residuals, e->jacobian));
        for (size_t i = 0; i < count; i++)
            add_window(e, e->jacobian + i * e->all * (e->n + e->own), e->problem.start[samples[i]], factor);
    }
    return LG_OK;
}

/* Adds what priors say of the parameters to J. */
static void add_priors(expecting *e) {
    lg_prior priors[LG_MACHINE_PRIORS];
    const lg_machine *machine = e->problem.machine;
    const uint32_t count =
        lg_machine_problem_priors(&e->problem) > 0 ? lg_machine_list_priors(machine, priors) : 0;
    const double weight = lg_machine_prior_weight(&e->problem, 1);
    for (uint32_t i = 0; i < count; i++) {
        const size_t at = machine->terms[priors[i].term].offset + priors[i].index;
        double slope;
        (void)lg_number_at(&priors[i].map, e->theta[at], &slope);
        slope *= weight / priors[i].sigma;
        e->J[at * e->n + at] += slope * slope;
    }
}

/* Sets `out` to tr(J^-1 K) over the eigenvectors of J that the residuals determine. Network weights have the
 * prior N(0, 1). */
static lg_status taken(expecting *e, double *values, double *out) {
    static const double shown = 1e-12;
    const size_t n = e->n;
    *out = 0.0;
    if (n == 0) return LG_OK;
    for (size_t i = 0; i < e->problem.machine->weights; i++) e->J[i * n + i] += e->unit;
    add_priors(e);
    const lg_status status = lg_machine_eigen(e->context, n, e->J, values);
    if (status == LG_NOT_FINITE) *out = INFINITY;
    if (status != LG_OK) return status == LG_NOT_FINITE ? LG_OK : status;
    for (size_t k = 0; k < n; k++) {
        const double *v = e->J + k * n;
        if (!(values[k] > shown * values[n - 1])) continue;
        for (size_t i = 0; i < n; i++) *out += v[i] * dot(e->K + i * n, v, n) / values[k];
    }
    return LG_OK;
}

/* ---- changes of the velocities ---- */

/* Adds for each coordinate the squares, in units of the loss, of its velocities (or accelerations) minus
 * `mean` and of the displacements that the velocities make from the start of one window. `run` holds the
 * displacements. */
static void add_change(const lg_machine_problem *problem, const double *mean, size_t start, double *run,
                       double factor, lg_machine_noise *out) {
    const lg_machine *machine = problem->machine;
    double q[LG_MACHINE_POSITIONS], v[2][LG_MACHINE_VELOCITIES], there[LG_MACHINE_VELOCITIES];
    memset(run, 0, machine->velocities * sizeof *run);
    for (uint32_t j = 0; j < problem->window; j++) {
        const size_t row = start + j;
        double *now = v[j % 2], *before = v[1 - j % 2];
        lg_machine_shown_row(machine, &problem->log, row, q, now);
        lg_machine_weigh_row(problem, row, 1.0, q, there);
        for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
            for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++) {
                now[k] = (now[k] - mean[k]) * lg_machine_shown_unit(machine, k);
                if (j > 0 && !machine->accelerations)
                    run[k] += 0.5 * (now[k] + before[k]) * (problem->log.t[row] - problem->log.t[row - 1]);
                const double speed = there[k] != 0.0 ? now[k] / problem->velocity_scale[at.index] : 0.0,
                             way = run[k] / problem->position_scale[at.index];
                out->velocity[at.index] += factor * speed * speed;
                out->position[at.index] += factor * way * way;
            }
        }
    }
}

static void add_changes(const expecting *e, size_t all, size_t used, lg_machine_noise *out) {
    const lg_machine_problem *problem = &e->problem;
    const uint32_t nv = problem->machine->velocities;
    const double factor = 1.0 / ((double)used * (double)problem->window);
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES], mean[LG_MACHINE_VELOCITIES],
        run[LG_MACHINE_VELOCITIES];
    for (size_t w = 0; w < used; w++) {
        const size_t start = problem->start[lg_spread(w, all, used)];
        const uint32_t rows = e->measured ? 1 : problem->window;
        memset(mean, 0, sizeof mean);
        for (uint32_t j = 0; j < rows; j++) {
            const size_t row = start + j;
            lg_machine_shown_row(problem->machine, &problem->log, row, q, v);
            for (uint32_t k = 0; k < nv; k++) mean[k] += v[k] / rows;
        }
        add_change(problem, mean, start, run, factor, out);
    }
}

/* ---- the whole loss ---- */

static lg_status expect(expecting *e, lg_tape *tape, double *values, lg_machine_expected *out) {
    const size_t all = e->problem.windows - e->problem.validation;
    const size_t used = all < LG_MACHINE_MOST_WINDOWS ? all : LG_MACHINE_MOST_WINDOWS,
                 first = e->measured ? 1 : 0;
    /* Turns a mean over points 0 .. M - 1 into a mean over the points that count in the loss. */
    const double points = (double)e->problem.window / (double)(e->problem.window - first);
    const size_t d = e->rows / e->problem.window;
    double lost = 0.0;
    LG_TRY(add_windows(e, tape, all, used));
    const double before = e->left;
    /* Too many parameters for their Jacobian: every parameter except network weights is taken to remove as
     * much as one average residual. */
    if (e->problem.theta != NULL) {
        lost = before * (double)(e->problem.machine->parameters - e->problem.machine->weights) /
               (double)(all * (e->problem.window - first) * d);
    } else {
        LG_TRY(taken(e, values, &lost));
        lost *= (double)used / (double)all;
    }
    lost = fmin(lost, 0.5 * before);
    *out = (lg_machine_expected){.loss = points * (before - lost)};
    add_changes(e, all, used, &out->change);
    return LG_OK;
}

lg_status lg_machine_expect(const lg_context *context, const lg_machine_problem *problem, const double *theta,
                            const lg_machine_noise *noise, lg_machine_expected *out, lg_error *error) {
    const lg_machine *machine = problem->machine;
    const bool measured = !lg_machine_starts_estimated(problem), many = machine->parameters > MOST_PARAMETERS;
    expecting e = {.context = context,
                   .problem = *problem,
                   .measured = measured,
                   .noise = noise,
                   .n = many ? 0 : machine->parameters,
                   .own = lg_machine_start_numbers(machine)};
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    lg_fit_problem fit;
    e.problem.starts = LG_MACHINE_STARTS_ESTIMATED;
    if (many) e.problem.theta = theta;
    e.all = lg_machine_linearised_rows(&e.problem);
    e.rows = e.all - lg_machine_problem_priors(&e.problem);
    const size_t columns = e.n + e.own, starts = problem->windows * e.own, given = machine->parameters;
    lg_machine_fit_problem(&e.problem, &fit);
    e.chunk = CHUNK < fit.chunk ? CHUNK : fit.chunk;
    const size_t rows = e.chunk * e.all;
    const size_t numbers[] = {given + starts, rows * columns, rows + 3 * e.rows, e.rows * columns};
    size_t sum = (2 * e.n + 1) * e.n;
    for (size_t i = 0; i < LG_COUNT(numbers); i++) sum += numbers[i];
    LG_TRY_SCRATCH(double, all, context, sum, lg_no_memory(error));
    if (lg_tape_create(context, NULL, &tape) != LG_OK) return lg_no_memory(error);
    e.jacobian = all + numbers[0];
    e.residuals = e.jacobian + numbers[1];
    e.columns = e.residuals + numbers[2];
    e.J = e.columns + numbers[3];
    e.K = e.J + e.n * e.n;
    memcpy(all, theta, given * sizeof *all);
    if (!measured) memcpy(all + given, theta + given, starts * sizeof *all);
    e.theta = many ? all + given : all;
    return lg_tape_conclude(tape, expect(&e, tape, e.J + 2 * e.n * e.n, out), error);
}

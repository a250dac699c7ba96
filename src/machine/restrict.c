/* Machines: fits of a few numbers x, theta = theta0 + D^T x, with the prior N(0, 1) on each. The chain rule
 * gives the Jacobian J D^T from that of all parameters.
 *
 * Residuals of long runs are correlated in time, so the data count less than their number says. The variance
 * that the prior is weighed with is therefore that of a residual times the factor by which the correlation
 * raises the variances of x. It is found in a few rounds, of which the first one has no prior: with x held at
 * 0 a large change would count as noise. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

static size_t all_starts(const lg_machine_problem *problem) {
    return lg_machine_problem_parameters(problem) - lg_machine_shared(problem);
}

/* ---- directions ---- */

bool lg_machine_scale_friction(const lg_machine *machine, const double *theta, double *direction) {
    bool any = false;
    memset(direction, 0, machine->parameters * sizeof *direction);
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_DAMPING, &term);) {
        if (term->parameters == 0) continue;
        term->kind->scaling(machine, term, theta + term->offset, direction + term->offset);
        any = true;
    }
    return any;
}

/* ---- the fit problem ---- */

/* theta0 + D^T x, then the starts. */
static lg_var recorded(lg_tape *tape, const lg_machine_restriction *r, lg_var x) {
    const uint32_t k = (uint32_t)r->count, P = (uint32_t)r->problem->machine->parameters,
                   starts = (uint32_t)all_starts(r->problem);
    const lg_var D = lg_input_f64(tape, lg_shape2(k, P), r->directions),
                 from = lg_input_f64(tape, lg_shape1(P), r->theta),
                 move = lg_matmul(tape, lg_reshape(tape, lg_slice(tape, x, 0, 0, k), lg_shape2(1, k)), D);
    const lg_var both[2] = {lg_add(tape, from, lg_reshape(tape, move, lg_shape1(P))),
                            starts > 0 ? lg_slice(tape, x, 0, k, starts) : LG_NONE};
    return starts > 0 ? lg_concat(tape, both, 2, 0) : both[0];
}

static lg_status residuals(void *user, lg_tape *tape, lg_var x, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *out) {
    const lg_machine_restriction *r = user;
    lg_fit_problem all;
    lg_machine_fit_problem(r->problem, &all);
    return all.residuals(all.user, tape, recorded(tape, r, x), samples, count, batch, out);
}

/* theta0 + D^T x, then the starts. */
static void moved(const lg_machine_restriction *r, const double *x, double *theta) {
    const size_t P = r->problem->machine->parameters;
    memcpy(theta, r->theta, P * sizeof *theta);
    for (size_t k = 0; k < r->count; k++)
        for (size_t i = 0; i < P; i++) theta[i] += x[k] * r->directions[k * P + i];
    memcpy(theta + P, x + r->count, all_starts(r->problem) * sizeof *theta);
}

static lg_status linearise(void *user, lg_tape *tape, const double *x, const uint32_t *samples, size_t count,
                           size_t batch, double *value, double *r, double *jacobian) {
    const lg_machine_restriction *of = user;
    const lg_machine_problem *problem = of->problem;
    const size_t P = problem->machine->parameters, starts = all_starts(problem),
                 own = lg_machine_own(problem), rows = count * lg_machine_linearised_rows(problem),
                 columns = P + own, bytes = (P + starts + rows * columns) * sizeof(double);
    double *theta = lg_pool_take(tape, bytes);
    if (theta == NULL) return lg_tape_status(tape);
    double *J = theta + P + starts;
    moved(of, x, theta);
    const lg_status status =
        lg_machine_linearise((void *)(uintptr_t)problem, tape, theta, samples, count, batch, value, r, J);
    for (size_t row = 0; row < rows && status == LG_OK; row++) {
        const double *from = J + row * columns;
        double *to = jacobian + row * (of->count + own);
        for (size_t k = 0; k < of->count; k++) to[k] = tape->k->dot(P, from, of->directions + k * P);
        memcpy(to + of->count, from + P, own * sizeof *to);
    }
    lg_pool_give(tape, theta, bytes);
    return status;
}

void lg_machine_restricted_problem(const lg_machine_restriction *r, lg_fit_problem *out) {
    lg_machine_fit_problem(r->problem, out);
    out->parameters = r->count + all_starts(r->problem);
    out->residuals = residuals;
    out->linearise = linearise;
    out->user = (void *)(uintptr_t)r; /* never written */
    out->observations = out->weights = 0;
}

/* ---- the most probable numbers ---- */

typedef struct adapting {
    const lg_context *context;
    const lg_machine_restriction *of;
    lg_fit_problem fit;
    double *x;       /* (fit.parameters) */
    double *decay;   /* (fit.parameters) */
    double *W;       /* (count, count), column-major: W W^T is the covariance of x */
    double variance; /* of a residual */
    double widened;  /* factor by which the correlation of the residuals raised variances, on average */
    double block;    /* as in lg_identification */
} adapting;

/* Runs the fit until a few epochs together no longer lower the loss: the problem is nearly linear. */
static lg_status settle(lg_fit *fit, double *loss_at, lg_error *error) {
    static const double settled = 1e-6;
    double before;
    *loss_at = INFINITY;
    do {
        before = *loss_at;
        LG_TRY(lg_fit_run(fit, error));
        *loss_at = lg_fit_history(fit, LG_FIT_LOSS)[lg_fit_epochs_done(fit) - 1];
    } while (*loss_at < (1.0 - settled) * before);
    return LG_OK;
}

static lg_status minimise(adapting *a, double *loss_at, lg_error *error) {
    enum { MOST_EVALUATIONS = 60, FEW = 4 };
    lg_fit_options options;
    LG_CLEAN(lg_fit_destroy_at) lg_fit *fit = NULL;
    lg_fit_options_init(&options);
    options.plan.phases = 1;
    options.plan.phase[0].method = LG_FIT_LM;
    options.epochs = MOST_EVALUATIONS;
    options.stop_after = FEW;
    options.shards = 1;
    LG_TRY(lg_fit_create(a->context, &a->fit, &options, a->x, &fit, error));
    LG_TRY(settle(fit, loss_at, error));
    lg_fit_parameters(fit, a->x);
    return LG_OK;
}

/* Weighs the prior as if each residual had this variance. With an infinite weight x stays 0. */
static void weigh_prior(adapting *a, double variance) {
    for (size_t k = 0; k < a->of->count; k++) a->decay[k] = 2.0 * variance;
}

/* Sum of the variances after `colour` in units of those before, mean over the parameters. */
static double widened(size_t n, const double *before, const double *after) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) {
        double a = 0.0, b = 0.0;
        for (size_t k = 0; k < n; k++) {
            a += after[k * n + i] * after[k * n + i];
            b += before[k * n + i] * before[k * n + i];
        }
        sum += b > 0.0 ? a / b : 1.0;
    }
    return sum / (double)n;
}

/* What the logs say of x. */
static lg_status find_errors(adapting *a, lg_error *error) {
    const size_t n = a->of->count;
    lg_fit_errors s = lg_machine_errors(a->context, a->of->problem, a->x, LG_MACHINE_MOST_OF_SMALL);
    LG_TRY_SCRATCH(double, work, a->context, 4 * n * n, lg_no_memory(error));
    LG_TRY_SCRATCH(int, order, a->context, n, lg_no_memory(error));
    s.fit = a->fit;
    s.n = n;
    lg_status status = lg_fit_errors_gather(&s, true);
    for (size_t i = 0; status == LG_OK && i < n; i++) s.bound[i] = 1e6;
    if (status == LG_OK) status = lg_fit_errors_invert(&s, work + n * n, order, a->W);
    if (status == LG_OK) {
        memcpy(work, a->W, n * n * sizeof *work);
        a->block = 0.0;
        status = lg_fit_errors_colour(&s, a->W, &a->block);
        a->widened = widened(n, work, a->W);
        a->variance = lg_fit_errors_variance(&s);
    }
    return lg_fit_errors_end(&s, status, error);
}

/* Errors with the prior: the covariance (C^-1 + 1)^-1 with C = W W^T is W V (1 + L)^-1 V^T W^T, where
 * W^T W = V L V^T. The change is x^T C^-1 x = |L^-1 V^T W^T x|^2. */
static lg_status tell_errors(const adapting *a, double *work, lg_machine_adapted *out) {
    static const double lost = 1e3;
    const size_t n = a->of->count;
    const lg_kernels *k = lg_kernels_for(LG_F64);
    const double *W = a->W;
    double *square = work, *values = work + n * n;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) square[i * n + j] = k->dot(n, W + i * n, W + j * n);
    LG_TRY(lg_fit_eigen(a->context, n, square, values));
    out->change = 0.0;
    for (size_t j = 0; j < n; j++) {
        double along = 0.0;
        for (size_t l = 0; l < n; l++) along += k->dot(n, W + l * n, out->x) * square[j * n + l];
        out->change += values[j] > 0.0 ? along * along / (values[j] * values[j]) : 0.0;
    }
    for (size_t i = 0; i < n; i++) {
        double alone = 0.0, both = 0.0;
        for (size_t j = 0; j < n; j++) {
            double along = 0.0;
            for (size_t l = 0; l < n; l++) along += W[l * n + i] * square[j * n + l];
            alone += along * along;
            both += along * along / (1.0 + fmax(values[j], 0.0));
        }
        out->alone[i] = sqrt(alone) <= lost ? sqrt(alone) : INFINITY;
        out->error[i] = sqrt(both);
    }
    return LG_OK;
}

static lg_status adapt(adapting *a, double *work, lg_machine_adapted *out, lg_error *error) {
    enum { ROUNDS = 3 };
    const size_t n = a->of->count;
    static const double held = 1e12;
    weigh_prior(a, held);
    LG_TRY(minimise(a, &out->before, error));
    for (int round = 0; round < ROUNDS; round++) {
        weigh_prior(a, a->variance * a->widened);
        LG_TRY(minimise(a, &out->after, error));
        LG_TRY(find_errors(a, error));
    }
    memcpy(out->x, a->x, n * sizeof *out->x);
    out->block = a->block;
    const lg_status status = tell_errors(a, work, out);
    return status == LG_OK ? LG_OK : lg_fail(error, status, "%s", lg_status_sentence(status));
}

lg_status lg_machine_adapt(const lg_context *context, const lg_machine_restriction *restriction,
                           lg_machine_adapted *out, lg_error *error) {
    LG_NEEDS(error, restriction, out);
    const size_t n = restriction->count;
    adapting a = {.context = context, .of = restriction};
    lg_machine_restricted_problem(restriction, &a.fit);
    LG_TRY_SCRATCH(double, x, context, 2 * a.fit.parameters + 2 * n * n + n, lg_no_memory(error));
    a.x = x;
    a.decay = a.x + a.fit.parameters;
    a.fit.decay = a.decay;
    a.W = a.decay + a.fit.parameters;
    return adapt(&a, a.W + n * n, out, error);
}

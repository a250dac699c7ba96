/* Machines: standard errors of their numbers, from the errors of their parameters. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "kernels/matrix.h"
#include "machine/chain.h"

enum { SMALL = 64 };

typedef struct identifying {
    lg_fit_errors of;
    const lg_machine *machine;
    double at[LG_MACHINE_POSITIONS]; /* positions at which a network mass is reported */
    lg_status missing;               /* of a number that could not be computed */
} identifying;

/* The numbers, at the parameters theta with parameter j moved up and down by a step. */
static void probe(identifying *s, double *theta, size_t j, double step, size_t count, lg_identified *up,
                  lg_identified *down) {
    const double before = theta[j];
    theta[j] = before + step;
    (void)lg_machine_numbers_at(s->machine, theta, s->at, count, up, &s->missing);
    theta[j] = before - step;
    (void)lg_machine_numbers_at(s->machine, theta, s->at, count, down, &s->missing);
    theta[j] = before;
}

/* A number that is the square of a parameter has derivative 0, and thus no error, where the parameter is 0.
 * Such a parameter is moved by 1e-2. theta (n) is changed; `up` and `down` (count) are work space. False:
 * nothing was moved. */
static bool leave_bounds(identifying *s, double *theta, size_t count, const lg_identified *numbers,
                         lg_identified *up, lg_identified *down) {
    static const double away = 1e-2;
    bool any = false;
    for (size_t j = s->machine->weights; j < s->of.n; j++) {
        bool square = false, plain = false;
        probe(s, theta, j, away, count, up, down);
        for (size_t i = 0; i < count; i++) {
            const double odd = fabs(up[i].value - down[i].value),
                         even = fabs(up[i].value - 2.0 * numbers[i].value + down[i].value);
            square = square || even > odd;
            plain = plain || odd > even;
        }
        if (!square || plain) continue;
        any = any || theta[j] != copysign(away, theta[j]);
        theta[j] = copysign(away, theta[j]);
    }
    return any;
}

/* gradient (count, n): derivative of each number with respect to each parameter, by central differences. */
static void differentiate(identifying *s, double *theta, size_t count, lg_identified *moved,
                          double *gradient) {
    static const double step = 1e-5;
    for (size_t j = 0; j < s->of.n; j++) {
        probe(s, theta, j, step, count, moved, moved + count);
        for (size_t i = 0; i < count; i++)
            gradient[i * s->of.n + j] = (moved[i].value - moved[count + i].value) / (2.0 * step);
    }
}

/* Replaces the gradient g of each number by W^T g, whose squares add up to the number's error^2. Sets
 * `units`, the sizes that relative changes of the numbers refer to: |value|, but at least a hundredth of the
 * largest derivative. */
static void propagate(identifying *s, const double *W, size_t count, double *gradient, double *row,
                      lg_identified *numbers, double *units) {
    static const double lost = 1e3, small = 1e-2;
    for (size_t i = 0; i < count; i++) {
        double *g = gradient + i * s->of.n, variance = 0.0, largest = 0.0;
        for (size_t j = 0; j < s->of.n; j++) {
            largest = fmax(largest, fabs(g[j]));
            row[j] = g[j];
        }
        for (size_t k = 0; k < s->of.n; k++) {
            g[k] = lg_fit_dot(W + k * s->of.n, row, s->of.n);
            variance += g[k] * g[k];
        }
        numbers[i].error = sqrt(variance);
        if (!(numbers[i].error <= lost * largest)) numbers[i].error = INFINITY;
        units[i] = fmax(fmax(fabs(numbers[i].value), small * largest), DBL_MIN);
    }
}

/* A number that ran to 0 or infinity no longer changes with the parameters, though it depends on them. Its
 * error becomes infinite and its row of `gradient` 0. theta (n) and moved (count) are overwritten. */
static void mark_lost(identifying *s, size_t count, double *gradient, double *theta, lg_identified *moved,
                      lg_identified *numbers, double *units) {
    for (size_t i = 0; i < count; i++) {
        double *g = gradient + i * s->of.n;
        bool depends = !isfinite(numbers[i].value) || !isfinite(lg_fit_dot(g, g, s->of.n));
        for (int probe = 0; probe < 2 && !depends && numbers[i].error == 0.0; probe++) {
            for (size_t j = 0; j < s->of.n; j++) theta[j] = probe;
            (void)lg_machine_numbers_at(s->machine, theta, s->at, count, moved, &s->missing);
            depends = moved[i].value != numbers[i].value;
        }
        if (!depends) continue;
        numbers[i].error = INFINITY;
        units[i] = 1.0;
        for (size_t j = 0; j < s->of.n; j++) g[j] = 0.0;
    }
}

/* The covariance of the numbers in units of `units`. `shares` are propagate's rows W^T g. A number with an
 * infinite error and no shares gets the variance of the bounds, 1e12. */
static void multiply(identifying *s, size_t count, const double *shares, const double *units,
                     const lg_identified *numbers, double *out) {
    for (size_t i = 0; i < count; i++)
        for (size_t j = 0; j <= i; j++)
            out[i * count + j] = out[j * count + i] =
                lg_fit_dot(shares + i * s->of.n, shares + j * s->of.n, s->of.n) / (units[i] * units[j]);
    for (size_t i = 0; i < count; i++)
        if (isinf(numbers[i].error) && out[i * count + i] == 0.0) out[i * count + i] = 1e12;
}

/* Sets the standard deviations of the parameters before any data. That of the weights of networks is
 * `weight`; the others are so large that they hardly matter. 0: all are. */
static void set_bounds(identifying *s, double weight) {
    for (size_t i = 0; i < s->of.n; i++)
        s->of.bound[i] = weight == 0.0 ? 1e6 : i < s->machine->weights ? weight : 1e4;
}

/* changes (count): what a Gauss-Newton step would change of the numbers. `gradient` (count, n): their
 * derivatives. */
static lg_status find_changes(identifying *s, size_t count, const double *gradient, double prior,
                              double *work, int *order, double *changes) {
    const size_t n = s->of.n;
    LG_TRY_SCRATCH(double, W, s->of.context, (n + 2) * n, LG_OUT_OF_MEMORY);
    double *slope = W + n * n, *step = slope + n;
    set_bounds(s, prior > 0.0 ? prior : 1e6);
    LG_TRY(lg_fit_errors_invert(&s->of, work, order, W));
    for (size_t j = 0; j < n; j++) {
        const double b = s->of.bound[j],
                     scale = (double)s->of.windows / (double)s->of.used / lg_fit_errors_variance(&s->of);
        slope[j] = s->of.slope[j] * scale + (j < s->machine->weights ? s->of.theta[j] / (b * b) : 0.0);
    }
    for (size_t k = 0; k < n; k++) {
        const double along = lg_fit_dot(W + k * n, slope, n);
        for (size_t j = 0; j < n; j++) step[j] -= along * W[k * n + j];
    }
    for (size_t i = 0; i < count; i++) changes[i] = lg_fit_dot(gradient + i * n, step, n);
    return LG_OK;
}

/* Computes the results from R. Errors and open directions come from the data alone, because a prior would
 * hide that a number is not determined. */
static lg_status conclude(identifying *s, size_t count, double *work, int *order, lg_identified *moved,
                          lg_identification *out) {
    static const double rounding = 1e-6;
    const size_t n = s->of.n;
    double *W = work, *theta = W + n * n, *gradient = theta + n, *units = gradient + count * n,
           *covariance = units + count, *more = covariance + count * count;
    memcpy(theta, s->of.theta, n * sizeof *theta);
    differentiate(s, theta, count, moved, gradient);
    /* `units` and the covariance are set later */
    LG_TRY(find_changes(s, count, gradient, out->prior, more, order, covariance));
    set_bounds(s, 0.0);
    LG_TRY(lg_fit_errors_invert(&s->of, more, order, W));
    LG_TRY(lg_fit_errors_colour(&s->of, W, &out->block));
    propagate(s, W, count, gradient, theta, out->numbers, units);
    for (size_t i = 0; i < count && s->of.unmoved == NULL; i++)
        if (isfinite(out->numbers[i].error))
            out->step = fmax(out->step, fabs(covariance[i]) / (out->numbers[i].error + rounding * units[i]));
    mark_lost(s, count, gradient, theta, moved, out->numbers, units);
    multiply(s, count, gradient, units, out->numbers, covariance);
    LG_TRY(lg_machine_relate(s->of.context, count, covariance, out));
    if (out->spread == NULL) return LG_OK;
    double block;
    set_bounds(s, 1.0);
    LG_TRY(lg_fit_errors_invert(&s->of, more, order, W));
    LG_TRY(lg_fit_errors_colour(&s->of, W, &block));
    lg_matrix_transpose(n, n, W, out->spread);
    return LG_OK;
}

lg_fit_errors lg_machine_errors(const lg_context *context, const lg_machine_problem *problem,
                                const double *theta, size_t most) {
    const lg_machine *machine = problem->machine;
    const lg_machine_log *log = &problem->log;
    const lg_row_axes all = lg_row_axes_of(machine);
    lg_fit_errors s = {.context = context,
                       .theta = theta,
                       .n = machine->parameters,
                       .each = lg_machine_start_numbers(machine),
                       .priors = lg_machine_problem_priors(problem),
                       .start = problem->start,
                       .window = problem->window,
                       .windows = problem->windows - problem->validation};
    lg_machine_fit_problem(problem, &s.fit);
    s.used = s.windows < most ? s.windows : most;
    /* The three numbers of a direction, or of its velocity, are worth two. */
    for (size_t i = 0; i < s.each; i++) {
        const lg_coordinate_kind kind = machine->coordinates[all.each[i % all.seen].coordinate].kind;
        s.worth[i] = kind == LG_COORDINATE_DIRECTION ? 2.0 / 3.0 : 1.0;
    }
    for (lg_log_part p = {0}; lg_log_next(log, &p);) s.seconds += log->t[p.end - 1] - log->t[p.first];
    return s;
}

lg_status lg_machine_identify(const lg_context *context, const lg_machine_problem *problem,
                              const double *theta, lg_identification *out, lg_error *error) {
    LG_NEEDS(error, problem, theta, out);
    const lg_machine *machine = problem->machine;
    const size_t n = machine->parameters, count = lg_machine_numbers(machine, theta, 0, NULL);
    identifying s = {.machine = machine, .missing = LG_OK};
    double squares = 0.0;
    (void)lg_machine_mass_at(problem, s.at);
    (void)lg_machine_numbers_at(machine, theta, s.at, count, out->numbers, &s.missing);
    out->open_count = 0;
    out->block = out->step = 0.0;
    for (size_t i = 0; out->spread != NULL && i < n * n; i++) out->spread[i] = 0.0;
    for (size_t i = 0; out->correlations != NULL && i < count * count; i++) out->correlations[i] = 0.0;
    if (count == 0) return LG_OK;
    const size_t all = lg_machine_problem_parameters(problem);
    LG_TRY_SCRATCH(lg_identified, moved, context, 2 * count, lg_no_memory(error));
    LG_TRY_SCRATCH(double, at, context, all + (4 * n + 1 + count) * n + (1 + count) * count,
                   lg_no_memory(error));
    LG_TRY_SCRATCH(int, order, context, n, lg_no_memory(error));
    memcpy(at, theta, all * sizeof *at);
    s.of = lg_machine_errors(context, problem, at,
                             n > SMALL ? LG_MACHINE_MOST_WINDOWS : LG_MACHINE_MOST_OF_SMALL);
    const bool left = leave_bounds(&s, at, count, out->numbers, moved, moved + count);
    if (left) s.of.unmoved = theta;
    lg_status status = lg_fit_errors_gather(&s.of, true);
    if (status == LG_OK && left) status = lg_machine_loss(context, problem, theta, &squares, NULL, NULL);
    if (left) s.of.squares = squares;
    if (status == LG_OK) status = conclude(&s, count, at + all, order, moved, out);
    if (status == LG_OK && s.missing == LG_OUT_OF_MEMORY) status = s.missing;
    return lg_fit_errors_end(&s.of, status, error);
}

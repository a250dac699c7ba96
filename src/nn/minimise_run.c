/* The loop that evaluates and tells a minimiser: lg_minimise and lg_least_squares. */
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "kernels/lapack.h"
#include "nn/minimise_internal.h"

LG_AT(lg_minimiser_destroy, lg_minimiser)

/* Evaluates at m->point and tells the minimiser. Also returns the status of the caller's function. */
typedef lg_status (*evaluation)(lg_minimiser *m, void *user);

/* Counts steps that do not lower f. iteration: the last step that was counted; steps: how many in a row did
 * not lower f; value: f after the last step; first: |f| after the first step. */
typedef struct steps_still {
    uint64_t iteration, steps;
    double value, first;
} steps_still;

enum { MOST_STILL = 30, MOST_EVALUATIONS = 10000 };
/* relative to steps_still.first: what is smaller underflows when it is squared */
static const double LEAST_FALL = 1e-200;

/* Whether each of the last MOST_STILL steps lowered f by at most LEAST_FALL of `first`. */
static bool still(const lg_minimiser *m, steps_still *s) {
    if (m->counts.iterations == s->iteration) return false;
    if (s->iteration == 0) s->first = fabs(m->numbers.value);
    s->iteration = m->counts.iterations;
    s->steps = s->value - m->numbers.value <= LEAST_FALL * s->first ? s->steps + 1 : 0;
    s->value = m->numbers.value;
    if (s->steps < MOST_STILL) return false;
    s->steps = 0;
    return true;
}

static uint64_t most_evaluations(const lg_minimiser *m) {
    return m->options.evaluations > 0 ? m->options.evaluations : MOST_EVALUATIONS;
}

/* Evaluates until the run ends. If an evaluation fails, returns its status and leaves *end at
 * LG_MINIMISE_RUNNING; LG_CANCELLED is an end, not a failure. */
static lg_status run(lg_minimiser *m, evaluation evaluate, void *user, lg_minimise_end *end) {
    const lg_minimise_options *o = &m->options;
    const double begin = lg_seconds();
    steps_still steps = {.value = NAN};
    while ((*end = (lg_minimise_end)m->counts.end) == LG_MINIMISE_RUNNING) {
        if (lg_cancelled(m->context))
            *end = LG_MINIMISE_CANCELLED;
        else if (m->counts.evaluations >= most_evaluations(m))
            *end = o->evaluations > 0 ? LG_MINIMISE_EVALUATIONS : LG_MINIMISE_LIMIT;
        else if (o->seconds > 0.0 && lg_seconds() - begin >= o->seconds)
            *end = LG_MINIMISE_SECONDS;
        else if (m->counts.stage == LG_STAGE_SEARCH && still(m, &steps))
            *end = lg_minimise_verify(m, LG_MINIMISE_ROUNDING);
        if (*end != LG_MINIMISE_RUNNING) break;
        const lg_status status = evaluate(m, user);
        if (status == LG_CANCELLED) *end = LG_MINIMISE_CANCELLED;
        if (status == LG_CANCELLED) break;
        if (status != LG_OK) return status;
    }
    return LG_OK;
}

static void multiply(size_t n, const double *a, const double *b, double *out) {
    for (size_t i = 0; i < n; i++) out[i] = a[i] * b[i];
}

/* Ends a call: fills x and *result in the caller's units, and writes the sentence of the end to `error`. */
static lg_status conclude(lg_minimiser *m, lg_status status, lg_minimise_end end, double *x,
                          lg_minimise_result *result, lg_error *error) {
    memcpy(x, m->x, m->n * sizeof *x);
    if (result != NULL) {
        *result = lg_minimiser_result(m);
        result->end = end;
    }
    if (m->unit != NULL) multiply(m->n, x, m->unit, x);
    if (m->unit != NULL && result != NULL) result->value *= m->value_unit;
    if (status != LG_OK) return lg_fail(error, status, "the objective: %s", lg_status_sentence(status));
    status = lg_minimise_end_status(end);
    (void)lg_fail(error, status, "%s", lg_minimise_end_sentence(end));
    return status;
}

/* The minimiser works on x/unit and f/value_unit. Both units come from the start point, so that the result
 * does not depend on the caller's units. */
typedef struct given_objective {
    lg_objective function;
    void *user;
    double *x, *gradient, *unit; /* (n) each: x and the gradient in the caller's units, units of x */
    double value_unit;           /* a power of 2 */
} given_objective;

/* Sets the units of variables that start at 0: unit[i] = size/|slope[i]|, so that one unit of x_i changes f
 * (or r) by about its own size. `size` is |f| or |r|, slope[i] the derivative by x_i. If the slope is zero or
 * of rounding size, unit[i] is the largest |x_j|; if all x are 0, it is the largest finite unit; if there is
 * none, 1. A variable below NEAR counts as 0 if a change by |x_i| changes f (or r) by less than NEAR size. */
static void units_of_zeros(lg_minimiser *m, const double *x, double size, const double *slope, double *unit) {
    static const double ROUNDED = 1e-12, NEAR = 1e-15;
    double largest = 0.0;
    for (size_t i = 0; i < m->n; i++) size = fmax(size, fabs(slope[i] * x[i]));
    for (size_t i = 0; i < m->n; i++)
        if (fabs(x[i]) < NEAR && fabs(slope[i] * x[i]) <= NEAR * size)
            unit[i] = size / fabs(slope[i]);
        else
            largest = fmax(largest, fabs(x[i]));
    const bool all_zero = largest == 0.0;
    for (size_t i = 0; i < m->n && all_zero; i++)
        if (isfinite(unit[i])) largest = fmax(largest, unit[i]);
    for (size_t i = 0; i < m->n; i++) {
        if (!(unit[i] > 0.0) || !(unit[i] * ROUNDED <= largest)) unit[i] = largest > 0.0 ? largest : 1.0;
        m->x[i] = m->point[i] = x[i] / unit[i];
    }
}

/* Sets the units to |x_i|, or 1 for x_i = 0. So the minimiser starts at 1, -1 or 0 in each variable. */
static void take_units(lg_minimiser *m, const double *x, double *unit) {
    for (size_t i = 0; i < m->n; i++) {
        unit[i] = x[i] != 0.0 ? fabs(x[i]) : 1.0;
        m->x[i] = m->point[i] = x[i] != 0.0 ? copysign(1.0, x[i]) : 0.0;
    }
    m->unit = unit;
    m->value_unit = 1.0;
}

/* Called at the start point: sets the units of variables that start at 0, and value_unit, which scales the
 * gradient to a norm between 1 and 2. */
static void complete_units(lg_minimiser *m, given_objective *given, double value) {
    double sum = 0.0;
    if (!isfinite(value) || !m->k->all_finite(m->n, given->gradient)) return;
    units_of_zeros(m, given->x, fabs(value), given->gradient, given->unit);
    for (size_t i = 0; i < m->n; i++) sum = hypot(sum, given->gradient[i] * given->unit[i]);
    if (sum > 0.0 && isfinite(sum)) given->value_unit = exp2(floor(log2(sum)));
}

static lg_status evaluate_objective(lg_minimiser *m, void *user) {
    given_objective *given = user;
    double value = NAN;
    multiply(m->n, m->point, given->unit, given->x);
    const lg_status status = given->function(given->user, given->x, &value, given->gradient);
    if (status != LG_OK && status != LG_NOT_FINITE) return status;
    if (status != LG_OK) value = NAN;
    if (m->counts.stage == LG_STAGE_START) complete_units(m, given, value);
    m->value_unit = given->value_unit;
    for (size_t i = 0; i < m->n; i++) given->gradient[i] *= given->unit[i] / given->value_unit;
    (void)lg_minimiser_tell(m, value / given->value_unit, given->gradient);
    return LG_OK;
}

lg_status lg_minimise(const lg_context *context, size_t n, lg_objective objective, void *user,
                      const lg_minimise_options *options, double *x, lg_minimise_result *result,
                      lg_error *error) {
    LG_NEEDS(error, objective, x);
    if (options != NULL && options->method == LG_MINIMISE_LM)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the method lm minimises sums of squares only: call lg_least_squares");
    LG_CLEAN(lg_minimiser_destroy_at) lg_minimiser *m = NULL;
    LG_TRY(lg_minimiser_create(context, n, options, x, &m, error));
    LG_SCRATCH(double, memory, context, (3 * n));
    if (memory == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a gradient of %zu numbers", n);
    given_objective given = {objective, user, memory, memory + n, memory + 2 * n, 1.0};
    take_units(m, x, given.unit);
    lg_minimise_end end;
    const lg_status status = run(m, evaluate_objective, &given, &end);
    return conclude(m, status, end, x, result, error);
}

/* ---- least squares ---- */

typedef struct given_residuals {
    lg_residuals function;
    void *user;
    size_t m, n;
    /* one allocation holds all arrays of this struct */
    double *r, *jacobian, *transposed, *gradient, *matrix;
    /* For the check of J: J d at x and in the middle of a step, r and J d at its end. */
    double *slope0, *middle, *end, *change;
    bool checked;
    const lg_kernels *k;
    lg_minimise_squares best;
    double *x, *unit; /* (n): x in the caller's units, units of x */
} given_residuals;

/* Computes r and J at `point`, which is in the minimiser's units. J is the derivative by x/unit. */
static lg_status call_residuals(const given_residuals *given, const double *point) {
    multiply(given->n, point, given->unit, given->x);
    const lg_status status = given->function(given->user, given->x, given->r, given->jacobian);
    for (size_t i = 0; i < given->m && status == LG_OK; i++)
        multiply(given->n, given->jacobian + i * given->n, given->unit, given->jacobian + i * given->n);
    return status;
}

/* Called at the start point: variables that start at 0 have had the unit 1; they now get a unit that makes
 * their column of J as long as r. J is converted. */
static void complete_residual_units(lg_minimiser *m, const given_residuals *given) {
    const size_t n = given->n, numbers = given->m * n;
    double *slope = given->gradient;
    given->k->fill(n, 0.0, slope);
    for (size_t i = 0; i < numbers; i++) given->jacobian[i] /= given->unit[i % n];
    for (size_t i = 0; i < numbers; i++) slope[i % n] = hypot(slope[i % n], given->jacobian[i]);
    units_of_zeros(m, given->x, sqrt(given->k->dot(given->m, given->r, given->r)), slope, given->unit);
    for (size_t i = 0; i < numbers; i++) given->jacobian[i] *= given->unit[i % n];
}

/* ---- the check of J: changes of r along a random line against Simpson's rule on J d ---- */

static const double JACOBIAN_STEP = 1e-3, JACOBIAN_TOLERANCE = 1e-2, JACOBIAN_ROUNDING = 1e-8;

/* The largest of |r| and all |x_j| |column j of J|. Rounding errors of r are relative to it. */
static double residual_size(const given_residuals *given, const double *x) {
    const lg_kernels *k = given->k;
    double size = sqrt(k->dot(given->m, given->best.r, given->best.r));
    for (size_t j = 0; j < given->n; j++) {
        const double *column = given->best.columns + j * given->m;
        size = fmax(size, fabs(x[j]) * sqrt(k->dot(given->m, column, column)));
    }
    return size;
}

/* Scales the random direction d (n): each variable changes r by about JACOBIAN_STEP of `size`, but moves by
 * no more than about JACOBIAN_STEP of |x_j| (of 1 where x_j = 0). */
static void check_line(const given_residuals *given, const double *x, double size, double *d) {
    for (size_t j = 0; j < given->n; j++) {
        const double *column = given->best.columns + j * given->m;
        const double norm = sqrt(given->k->dot(given->m, column, column));
        d[j] *= JACOBIAN_STEP * fmin(size / norm, x[j] != 0.0 ? fabs(x[j]) : 1.0);
    }
}

/* Computes r and J at x + step d, and out = J d. Returns false if a result is not finite, if no evaluation is
 * left, or if the evaluation failed (*status is not LG_OK). */
static bool look(lg_minimiser *m, const given_residuals *given, double step, double *out, lg_status *status) {
    const double *d = m->s;
    if (m->counts.evaluations >= most_evaluations(m)) return false;
    for (size_t j = 0; j < m->n; j++) m->y[j] = m->x[j] + step * d[j];
    *status = call_residuals(given, m->y);
    m->counts.evaluations++;
    if (*status != LG_OK) return false;
    given->k->matvec(given->m, given->n, given->jacobian, d, out, false);
    return given->k->all_finite(given->m, given->r) && given->k->all_finite(given->m, out);
}

/* Whether the change of r over the step agrees with `foretold` (rows), which is an integral of J d. */
static bool change_agrees(const given_residuals *given, double step, double size, const double *middle) {
    double top = 0.0, error = 0.0;
    for (size_t i = 0; i < given->m; i++) {
        const double ends = given->slope0[i] + given->change[i], change = given->end[i] - given->best.r[i];
        const double foretold = middle != NULL ? step / 6.0 * (ends + 4.0 * middle[i]) : step / 2.0 * ends;
        top += fmax(change * change, foretold * foretold);
        error += (change - foretold) * (change - foretold);
    }
    return !(sqrt(error) > JACOBIAN_TOLERANCE * sqrt(top) + JACOBIAN_ROUNDING * size);
}

/* Whether the change of r over the step agrees with the integral of J d along it, by the trapezoidal rule or
 * by Simpson's; also true if r could not be evaluated. */
static bool step_agrees(lg_minimiser *m, const given_residuals *given, double step, double size,
                        lg_status *status) {
    if (!look(m, given, step, given->change, status)) return true;
    memcpy(given->end, given->r, given->m * sizeof *given->r);
    if (change_agrees(given, step, size, NULL)) return true;
    return !look(m, given, 0.5 * step, given->middle, status) ||
           change_agrees(given, step, size, given->middle);
}

/* J is accepted if it agrees with r for one of four steps from the best point: forwards or backwards, at two
 * lengths. Otherwise the run ends with LG_MINIMISE_WRONG_JACOBIAN. */
static lg_status check_jacobian(lg_minimiser *m, const given_residuals *given) {
    static const double steps[] = {1.0, -1.0, 1e-2, -1e-2};
    lg_status status = LG_OK;
    const double size = residual_size(given, m->x);
    lg_minimise_check_direction(m);
    check_line(given, m->x, size, m->s);
    given->k->fill(given->m, 0.0, given->slope0);
    for (size_t j = 0; j < m->n; j++)
        given->k->axpy(given->m, m->s[j], given->best.columns + j * given->m, given->slope0);
    for (size_t i = 0; i < LG_COUNT(steps); i++)
        if (step_agrees(m, given, steps[i], size, &status)) return status == LG_NOT_FINITE ? LG_OK : status;
    lg_minimise_finish(m, LG_MINIMISE_WRONG_JACOBIAN);
    return LG_OK;
}

/* Tells the minimiser f = |r|^2, its gradient 2 J^T r and the Gauss-Newton matrix 2 J^T J. */
static lg_status evaluate_residuals(lg_minimiser *m, void *user) {
    given_residuals *given = user;
    const size_t n = given->n, rows = given->m;
    const bool first = m->counts.stage == LG_STAGE_START;
    const lg_status status = call_residuals(given, m->point);
    if (status != LG_OK && status != LG_NOT_FINITE) return status;
    if (first && status == LG_OK) complete_residual_units(m, given);
    given->k->transpose(rows, n, given->jacobian, given->transposed);
    given->k->gemm(n, n, rows, given->transposed, rows, 1, given->jacobian, n, given->matrix, n, false);
    given->k->matvec(n, rows, given->transposed, given->r, given->gradient, false);
    for (size_t i = 0; i < n; i++) given->gradient[i] *= 2.0;
    for (size_t i = 0; i < n * n; i++) given->matrix[i] *= 2.0;
    const double value = status == LG_OK ? given->k->dot(rows, given->r, given->r) : NAN;
    (void)lg_minimiser_tell_squares(m, value, given->gradient, given->matrix);
    /* J is checked when the first step is refused, or before the end. */
    const bool doubtful = m->counts.failures > 0 || m->counts.stage == LG_STAGE_DONE;
    if (given->checked || !doubtful || !m->options.check || m->counts.end == LG_MINIMISE_NOT_FINITE)
        return LG_OK;
    given->checked = true;
    return check_jacobian(m, given);
}

/* The covariance |r|^2/(m - n) (J^T J)^-1, where m is the number of rows. J^T J comes from A = 2 J^T J at the
 * best point; A is first scaled to a unit diagonal. */
static void covariance_of(const lg_minimiser *m, size_t rows, double *out) {
    const size_t n = m->n, stride = lg_minimise_stride(n);
    const double *a = m->curvature, variance = m->numbers.value / (double)(rows - n);
    const int order = (int)n;
    int info = rows > n ? 0 : 1;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            out[i * n + j] = a[i * stride + j] / sqrt(a[i * stride + i] * a[j * stride + j]);
    if (info == 0) dpotrf_("L", &order, out, &order, &info);
    /* A pivot of rounding size: the data do not identify this combination of variables. */
    for (size_t i = 0; i < n && info == 0; i++)
        info = out[i * n + i] * out[i * n + i] > 1e-13 * (double)n ? 0 : 1;
    if (info == 0) dpotri_("L", &order, out, &order, &info);
    for (size_t i = 0; i < n; i++)
        for (size_t j = i; j < n; j++) {
            const double scale =
                2.0 * variance * m->unit[i] * m->unit[j] / sqrt(a[i * stride + i] * a[j * stride + j]);
            const double value = info == 0 ? out[i * n + j] * scale : NAN;
            out[i * n + j] = out[j * n + i] = value;
        }
}

lg_status lg_least_squares(const lg_context *context, size_t n, size_t rows, lg_residuals residuals,
                           void *user, const lg_minimise_options *options, double *x, double *covariance,
                           lg_minimise_result *result, lg_error *error) {
    lg_minimise_options chosen;
    lg_minimise_options_init(&chosen);
    if (options != NULL) chosen = *options;
    chosen.method = LG_MINIMISE_LM;
    LG_NEEDS(error, residuals, x);
    if (rows < n || rows > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%zu residuals for %zu unknowns: expected at least as many residuals as unknowns",
                       rows, n);
    LG_CLEAN(lg_minimiser_destroy_at) lg_minimiser *m = NULL;
    LG_TRY(lg_minimiser_create(context, n, &chosen, x, &m, error));
    const size_t numbers = 6 * rows + 3 * rows * n + 3 * n + n * n + lg_minimise_stack_length(rows, n);
    LG_TRY_SCRATCH(
        double, memory, context, numbers,
        lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a Jacobian of %zu x %zu numbers", rows, n));
    given_residuals given = {
        .function = residuals, .user = user, .m = rows, .n = n, .k = m->k, .best.rows = rows};
    double **const arrays[] = {
        &given.r,      &given.slope0,   &given.middle,     &given.end,          &given.change,
        &given.best.r, &given.jacobian, &given.transposed, &given.best.columns, &given.gradient,
        &given.x,      &given.unit,     &given.matrix,     &given.best.stack};
    for (size_t i = 0, at = 0; i < LG_COUNT(arrays); i++) {
        *arrays[i] = memory + at;
        at += i < 6 ? rows : i < 9 ? rows * n : i < 12 ? n : n * n;
    }
    given.best.trial_r = given.r;
    given.best.trial_columns = given.transposed;
    take_units(m, x, given.unit);
    m->squares = &given.best;
    lg_minimise_end end;
    const lg_status status = run(m, evaluate_residuals, &given, &end);
    if (covariance != NULL && status == LG_OK) covariance_of(m, rows, covariance);
    return conclude(m, status, end, x, result, error);
}

lg_status lg_normal_equations(size_t n, size_t columns, double ridge, double *matrix, double *right) {
    LG_NEEDS(NULL, matrix, right);
    const int order = (int)n, many = (int)columns;
    int info = 0;
    for (size_t i = 0; i < n; i++) {
        double *square = matrix + i * n + i;
        *square = *square != 0.0 ? *square * (1.0 + ridge) : 1.0;
    }
    /* LAPACK's upper triangle (by columns) is our lower triangle (by rows) */
    dposv_("U", &order, &many, matrix, &order, right, &order, &info);
    for (size_t i = 0; i < n * columns && info == 0; i++) info = !isfinite(right[i]);
    return info == 0 ? LG_OK : LG_CHECK_FAILED;
}

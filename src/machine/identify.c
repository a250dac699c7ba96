/* Machines: standard errors of their numbers, from the Jacobian J of the residuals. Uses the triangular
 * factor of J, not J^T J: products lose everything below 1e-8 of the largest entry to rounding, and this
 * rounding error would look like information on directions that the data do not determine. */
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "kernels/lapack.h"
#include "kernels/matrix.h"
#include "machine/chain.h"

enum { CHUNK = 64, BLOCK = 32, SMALL = 64, MOST_OF_SMALL = 8192, RUN = 32, FEW = 64 };

typedef lg_machine_normal normal;

static double dot(const double *a, const double *b, size_t n) {
    return lg_kernels_for(LG_F64)->dot(n, a, b);
}

double lg_machine_dot3(const double *a, const double *b, const double *c, size_t n) {
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
        taken += variance != NULL ? lg_machine_dot3(pivot, pivot, variance, rows) / norm : 1.0;
        for (size_t j = 0; j < k; j++) {
            double *column = columns + j * stride;
            lg_kernels_for(LG_F64)->axpy(rows, -dot(pivot, column, rows) / norm, pivot, column);
        }
    }
    return taken;
}

/* Counts the residuals of a chunk. The three numbers of a direction, or of its velocity, are worth two. Those
 * that are almost 0 have almost no weight: positions that are integrals of measured velocities. */
static void count_residuals(normal *s) {
    static const double nothing = 1e-8;
    const lg_machine *machine = s->problem->machine;
    const lg_row_axes all = lg_row_axes_of(machine);
    const double least = nothing * dot(s->residuals, s->residuals, s->rows) / (double)s->rows;
    for (size_t row = 0; row < s->rows; row++) {
        const size_t i = row % s->fit.rows;
        const lg_coordinate_kind kind = machine->coordinates[all.each[i % all.seen].coordinate].kind;
        if (i < s->fit.rows - s->priors && s->residuals[row] * s->residuals[row] > least)
            s->weighted += kind == LG_COORDINATE_DIRECTION ? 2.0 / 3.0 : 1.0;
    }
}

/* R (n, n) of `matrix` (m, n), which is overwritten; both are column-major. With `order` columns are pivoted,
 * the longest remaining one first, and `order` gets their numbers from 1; with NULL they are not. */
static lg_status triangulate(const lg_context *context, size_t m, size_t n, double *matrix, int *order,
                             double *triangle) {
    const int rows = (int)m, columns = (int)n, query = -1;
    double want = 0.0;
    int info = 0; /* these functions only refuse wrong arguments */
    for (size_t j = 0; order != NULL && j < n; j++) order[j] = 0;
    if (order != NULL)
        dgeqp3_(&rows, &columns, matrix, &rows, order, &want, &want, &query, &info);
    else
        dgeqrf_(&rows, &columns, matrix, &rows, &want, &want, &query, &info);
    const int room = (int)want;
    LG_TRY_SCRATCH(double, tau, context, n + (size_t)room, LG_OUT_OF_MEMORY);
    if (order != NULL)
        dgeqp3_(&rows, &columns, matrix, &rows, order, tau, tau + n, &room, &info);
    else
        dgeqrf_(&rows, &columns, matrix, &rows, tau, tau + n, &room, &info);
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < n; i++) triangle[j * n + i] = i <= j ? matrix[j * m + i] : 0.0;
    return LG_OK;
}

/* Adds products of the columns with the columns one row of the log later. A row of the log has d residuals,
 * as many as a start has numbers. */
static void add_lagged(normal *s, size_t count) {
    const size_t each = s->rows / count, d = lg_machine_start_numbers(s->problem->machine);
    for (size_t j = 0; j < s->n * s->n; j++)
        for (size_t w = 0; w < count; w++) {
            const double *a = s->columns + j / s->n * s->rows + w * each,
                         *b = s->columns + j % s->n * s->rows + w * each;
            s->lagged[j] += dot(a, b + d, each - d - s->priors);
        }
}

/* Adds products of the residuals of neighbouring rows, and the scores of the windows' stretches. `first`:
 * index of the chunk's first window. */
static void add_scores(normal *s, size_t first, size_t count) {
    const size_t each = s->rows / count, logged = each - s->priors,
                 d = lg_machine_start_numbers(s->problem->machine), m = s->stretches;
    for (size_t j = 0; j < s->n; j++) s->slope[j] += dot(s->columns + j * s->rows, s->residuals, s->rows);
    for (size_t w = 0; w < count; w++) {
        const double *r = s->residuals + w * each;
        s->neighbours += dot(r, r + d, logged - d);
        for (size_t k = 0; k < m; k++) {
            const size_t begin = logged / d * k / m * d, end = logged / d * (k + 1) / m * d;
            double *score = s->scores + ((first + w) * m + k) * s->n;
            for (size_t j = 0; j < s->n; j++)
                score[j] = dot(s->columns + j * s->rows + w * each + begin, r + begin, end - begin);
        }
    }
}

/* Replaces R by the QR factor of the matrix with R above the rows of the chunk. Overwrites s->columns. */
static void put_below(normal *s) {
    const int rows = (int)s->rows, n = (int)s->n, none = 0, block = n < BLOCK ? n : BLOCK;
    int info = 0; /* dtpqrt reports invalid arguments only */
    dtpqrt_(&rows, &n, &none, &block, s->triangle, &n, s->columns, &rows, s->reflectors, &block,
            s->reflectors + (size_t)block * s->n, &info);
}

static lg_status add_chunk(normal *s, const uint32_t *samples, size_t first, size_t count) {
    const size_t given = s->n - s->last, columns = given + s->starts, batch = s->used;
    double squares = 0.0;
    s->rows = count * s->fit.rows;
    LG_TRY(s->fit.linearise(s->fit.user, s->tape, s->theta, samples, count, batch, &squares, s->residuals,
                            s->jacobian));
    for (size_t row = 0; row < s->rows; row++)
        for (size_t j = 0; j < columns; j++)
            s->columns[(j < given ? j : j + s->last) * s->rows + row] = s->jacobian[row * columns + j];
    if (s->last) memcpy(s->columns + given * s->rows, s->residuals, s->rows * sizeof *s->columns);
    if (s->visit != NULL) {
        for (size_t w = 0; w < count; w++) s->visit(s->user, s->columns + w * s->fit.rows, samples[w]);
        return LG_OK;
    }
    for (size_t w = 0, each = s->rows / count; w < count && s->starts > 0; w++)
        s->weighted -= lg_machine_take_start(s->columns + w * each, s->rows, each, s->n, s->starts, NULL);
    if (s->lagged != NULL) add_lagged(s, count);
    s->squares += squares;
    if (s->unmoved != NULL)
        LG_TRY(s->fit.linearise(s->fit.user, s->tape, s->unmoved, samples, count, batch, &squares,
                                s->residuals, s->jacobian));
    if (s->scores != NULL) add_scores(s, first, count);
    count_residuals(s);
    put_below(s);
    return LG_OK;
}

/* Index of the used window i. */
static uint32_t window_at(const normal *s, size_t i) {
    if (s->used == s->windows || !s->runs) return (uint32_t)lg_spread(i, s->windows, s->used);
    return (uint32_t)(i / RUN * (s->windows - RUN) / (s->used / RUN - 1) + i % RUN);
}

static lg_status add_all(normal *s) {
    uint32_t samples[CHUNK];
    for (size_t first = 0; first < s->used; first += s->chunk) {
        const size_t count = s->used - first < s->chunk ? s->used - first : s->chunk;
        if (lg_cancelled(s->context)) return LG_CANCELLED;
        for (size_t i = 0; i < count; i++) samples[i] = window_at(s, first + i);
        LG_TRY(add_chunk(s, samples, first, count));
    }
    /* Scales R as if all windows had been used. */
    for (size_t i = 0; i < s->n * s->n; i++) s->triangle[i] *= sqrt((double)s->windows / (double)s->used);
    return LG_OK;
}

/* Standard deviation of parameter i before any data. With `prior` it is s->deviation for the weights of
 * networks; otherwise it is so large that it hardly matters. */
static double bound(const normal *s, size_t i, bool prior) {
    const bool weight = i < s->problem->machine->weights;
    return !prior ? 1e6 : weight ? s->deviation : 1e4;
}

/* s->weighted with rows that are in several windows counted once. The first row of a window is left out: its
 * start takes as much. Scores of whole windows show by their correlation how windows overlap: nothing changes
 * then. */
static double count_once(const normal *s) {
    size_t rows = 0, end = 0;
    for (size_t i = 0; i < s->used; i++) {
        const size_t start = s->problem->start[window_at(s, i)] + 1, begin = start > end ? start : end;
        end = start + s->problem->window - 1;
        rows += end - begin;
    }
    return s->stretches == 1
               ? s->weighted
               : s->weighted * (double)rows / ((double)s->used * (double)(s->problem->window - 1));
}

/* Variance s^2 of a residual. */
static double variance_of(const normal *s) {
    return fmax(s->squares / fmax(1.0, count_once(s) - (double)s->n), DBL_MIN);
}

/* Writes R D/s with D the diagonal matrix of the bounds and s^2 the variance of the residuals: the
 * information in the data, in units of what was known before. */
static void put_information(const normal *s, bool prior, double *out) {
    const double deviation = sqrt(variance_of(s));
    for (size_t j = 0; j < s->n; j++)
        for (size_t i = 0; i < s->n; i++)
            out[j * s->n + i] = s->triangle[j * s->n + i] * bound(s, j, prior) / deviation;
}

/* W (n, n), column-major, such that W W^T is the inverse of J^T J/s^2 + D^-2, with D the bounds. Rows of the
 * factor whose pivot is below 1e-12 of the largest are rounding error and are set to 0. `work`: (3 n, n). */
static lg_status invert(const normal *s, bool prior, double *work, int *order, double *W) {
    static const double nothing = 1e-12;
    const size_t n = s->n;
    const int size = (int)n;
    int info = 0;
    double *first = work, *both = work + n * n;
    put_information(s, prior, W);
    LG_TRY(triangulate(s->context, n, n, W, order, first));
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < n; i++) {
            const bool shown = fabs(first[i * n + i]) > nothing * fabs(first[0]);
            both[j * 2 * n + i] = shown ? first[j * n + i] : 0.0;
            both[j * 2 * n + n + i] = i == j ? 1.0 : 0.0;
        }
    LG_TRY(triangulate(s->context, 2 * n, n, both, NULL, first));
    dtrtri_("U", "N", &size, first, &size, &info);
    for (size_t j = 0; j < n; j++)
        for (size_t k = 0; k < n; k++) {
            const size_t i = (size_t)order[j] - 1;
            W[k * n + i] = bound(s, i, prior) * first[k * n + j];
        }
    return info == 0 ? LG_OK : LG_OUT_OF_MEMORY;
}

/* The numbers, at the parameters theta with parameter j moved up and down by a step. */
static void probe(const normal *s, double *theta, size_t j, double step, size_t count, lg_identified *up,
                  lg_identified *down) {
    const double before = theta[j];
    theta[j] = before + step;
    (void)lg_machine_numbers_at(s->problem->machine, theta, s->at, count, up, s->missing);
    theta[j] = before - step;
    (void)lg_machine_numbers_at(s->problem->machine, theta, s->at, count, down, s->missing);
    theta[j] = before;
}

/* A number that is the square of a parameter has derivative 0, and thus no error, where the parameter is 0.
 * Such a parameter is moved by 1e-2. theta (n) is changed; `up` and `down` (count) are work space. False:
 * nothing was moved. */
static bool leave_bounds(const normal *s, double *theta, size_t count, const lg_identified *numbers,
                         lg_identified *up, lg_identified *down) {
    static const double away = 1e-2;
    bool any = false;
    for (size_t j = s->problem->machine->weights; j < s->n; j++) {
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
static void differentiate(const normal *s, double *theta, size_t count, lg_identified *moved,
                          double *gradient) {
    static const double step = 1e-5;
    for (size_t j = 0; j < s->n; j++) {
        probe(s, theta, j, step, count, moved, moved + count);
        for (size_t i = 0; i < count; i++)
            gradient[i * s->n + j] = (moved[i].value - moved[count + i].value) / (2.0 * step);
    }
}

/* Replaces the gradient g of each number by W^T g, whose squares add up to the number's error^2. Sets
 * `units`, the sizes that relative changes of the numbers refer to: |value|, but at least a hundredth of the
 * largest derivative. */
static void propagate(const normal *s, const double *W, size_t count, double *gradient, double *row,
                      lg_identified *numbers, double *units) {
    static const double lost = 1e3, small = 1e-2;
    for (size_t i = 0; i < count; i++) {
        double *g = gradient + i * s->n, variance = 0.0, largest = 0.0;
        for (size_t j = 0; j < s->n; j++) {
            largest = fmax(largest, fabs(g[j]));
            row[j] = g[j];
        }
        for (size_t k = 0; k < s->n; k++) {
            g[k] = dot(W + k * s->n, row, s->n);
            variance += g[k] * g[k];
        }
        numbers[i].error = sqrt(variance);
        if (!(numbers[i].error <= lost * largest)) numbers[i].error = INFINITY;
        units[i] = fmax(fmax(fabs(numbers[i].value), small * largest), DBL_MIN);
    }
}

/* A number that ran to 0 or infinity no longer changes with the parameters, though it depends on them. Its
 * error becomes infinite and its row of `gradient` 0. theta (n) and moved (count) are overwritten. */
static void mark_lost(const normal *s, size_t count, double *gradient, double *theta, lg_identified *moved,
                      lg_identified *numbers, double *units) {
    for (size_t i = 0; i < count; i++) {
        double *g = gradient + i * s->n;
        bool depends = !isfinite(numbers[i].value) || !isfinite(dot(g, g, s->n));
        for (int probe = 0; probe < 2 && !depends && numbers[i].error == 0.0; probe++) {
            for (size_t j = 0; j < s->n; j++) theta[j] = probe;
            (void)lg_machine_numbers_at(s->problem->machine, theta, s->at, count, moved, s->missing);
            depends = moved[i].value != numbers[i].value;
        }
        if (!depends) continue;
        numbers[i].error = INFINITY;
        units[i] = 1.0;
        for (size_t j = 0; j < s->n; j++) g[j] = 0.0;
    }
}

/* The covariance of the numbers in units of `units`. `shares` are propagate's rows W^T g. A number with an
 * infinite error and no shares gets the variance of the bounds, 1e12. */
static void multiply(const normal *s, size_t count, const double *shares, const double *units,
                     const lg_identified *numbers, double *out) {
    for (size_t i = 0; i < count; i++)
        for (size_t j = 0; j <= i; j++)
            out[i * count + j] = out[j * count + i] =
                dot(shares + i * s->n, shares + j * s->n, s->n) / (units[i] * units[j]);
    for (size_t i = 0; i < count; i++)
        if (isinf(numbers[i].error) && out[i * count + i] == 0.0) out[i * count + i] = 1e12;
}

static double seconds_of(const lg_machine_log *log) {
    double sum = 0.0;
    for (size_t p = 0; p < log->parts; p++) sum += log->t[log->first[p + 1] - 1] - log->t[log->first[p]];
    return sum;
}

/* c (m, n) = factor a (m, n) b^T (n, n) */
static void product(size_t m, size_t n, double factor, const double *a, const double *b, double *c) {
    const int rows = (int)m, columns = (int)n;
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, rows, columns, columns, factor, a, columns, b,
                columns, 0.0, c, columns);
}

/* Replaces W by the factor of a covariance for residuals that are correlated in time, if they are. */
static lg_status colour(const normal *s, bool prior, double *W, double *block) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    const size_t n = s->n, count = s->used * s->stretches;
    const double c = s->neighbours / fmax(s->squares, DBL_MIN), least = 0.02;
    const bool coloured = c > fmax(least, 4.0 / sqrt(fmax(s->weighted, 1.0)));
    LG_TRY_SCRATCH(double, F, s->context, (count + 3 * n) * n, LG_OUT_OF_MEMORY);
    size_t stretches = 0;
    double *apart = F + n * n, *P = F + 2 * n * n, *h = F + 3 * n * n;
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < n; i++) apart[j * n + i] = W[j * n + i] / bound(s, i, prior);
    product(n, n, 1.0, apart, apart, P);
    product(count, n, 1.0 / variance_of(s), s->scores, W, h);
    LG_TRY(lg_machine_colour(s->context, count, n, s->stretches, (double)s->used / (double)s->windows,
                             coloured, P, h, F, &stretches));
    if (stretches > 0) { /* Columns of W F: column-major W is W^T row by row. */
        k->gemm(n, n, n, F, n, 1, W, n, F + n * n, n, false);
        memcpy(W, F + n * n, n * n * sizeof *W);
        *block = (double)stretches * seconds_of(&s->problem->log) / (double)(s->windows * s->stretches);
    }
    return LG_OK;
}

/* changes (count): what a Gauss-Newton step would change of the numbers. `gradient` (count, n): their
 * derivatives. */
static lg_status find_changes(normal *s, size_t count, const double *gradient, double prior, double *work,
                              int *order, double *changes) {
    const size_t n = s->n;
    LG_TRY_SCRATCH(double, W, s->context, (n + 2) * n, LG_OUT_OF_MEMORY);
    double *slope = W + n * n, *step = slope + n;
    s->deviation = prior > 0.0 ? prior : 1e6;
    LG_TRY(invert(s, true, work, order, W));
    for (size_t j = 0; j < n; j++) {
        const double b = bound(s, j, true), scale = (double)s->windows / (double)s->used / variance_of(s);
        slope[j] = s->slope[j] * scale + (j < s->problem->machine->weights ? s->theta[j] / (b * b) : 0.0);
    }
    for (size_t k = 0; k < n; k++) {
        const double along = dot(W + k * n, slope, n);
        for (size_t j = 0; j < n; j++) step[j] -= along * W[k * n + j];
    }
    for (size_t i = 0; i < count; i++) changes[i] = dot(gradient + i * n, step, n);
    s->deviation = 1.0;
    return LG_OK;
}

/* Computes the results from R. Errors and open directions come from the data alone, because a prior would
 * hide that a number is not determined. */
static lg_status conclude(normal *s, size_t count, double *work, int *order, lg_identified *moved,
                          lg_identification *out) {
    static const double rounding = 1e-6;
    const size_t n = s->n;
    double *W = work, *theta = W + n * n, *gradient = theta + n, *units = gradient + count * n,
           *covariance = units + count, *more = covariance + count * count;
    memcpy(theta, s->theta, n * sizeof *theta);
    differentiate(s, theta, count, moved, gradient);
    /* `units` and the covariance are set later */
    LG_TRY(find_changes(s, count, gradient, out->prior, more, order, covariance));
    LG_TRY(invert(s, false, more, order, W));
    LG_TRY(colour(s, false, W, &out->block));
    propagate(s, W, count, gradient, theta, out->numbers, units);
    for (size_t i = 0; i < count && s->unmoved == NULL; i++)
        if (isfinite(out->numbers[i].error))
            out->step = fmax(out->step, fabs(covariance[i]) / (out->numbers[i].error + rounding * units[i]));
    mark_lost(s, count, gradient, theta, moved, out->numbers, units);
    multiply(s, count, gradient, units, out->numbers, covariance);
    LG_TRY(lg_machine_relate(s->context, count, covariance, out));
    if (out->spread == NULL) return LG_OK;
    double block;
    LG_TRY(invert(s, true, more, order, W));
    LG_TRY(colour(s, true, W, &block));
    lg_matrix_transpose(n, n, W, out->spread);
    return LG_OK;
}

void lg_machine_choose_windows(normal *s, size_t most) {
    s->windows = s->problem->windows - s->problem->validation;
    s->used = s->windows < most ? s->windows : most;
}

/* Scores of few windows are taken in several stretches of each window. */
static lg_status allocate_scores(normal *s) {
    const size_t rows = s->fit.rows / lg_machine_start_numbers(s->problem->machine),
                 wanted = (FEW + s->used - 1) / s->used;
    s->stretches = wanted < rows ? wanted : rows;
    s->runs = true;
    s->scores = lg_alloc(s->context, (s->used * s->stretches + 1) * s->n, sizeof *s->scores);
    s->slope = s->scores + s->used * s->stretches * s->n;
    return s->scores != NULL ? LG_OK : LG_OUT_OF_MEMORY;
}

static lg_status allocate(normal *s) {
    const lg_machine_problem *problem = s->problem;
    if (s->fit.linearise == NULL) lg_machine_fit_problem(problem, &s->fit);
    s->priors = lg_machine_problem_priors(problem);
    s->chunk = CHUNK < s->fit.chunk ? CHUNK : s->fit.chunk;
    if (lg_machine_starts_estimated(problem)) s->starts = lg_machine_start_numbers(problem->machine);
    const size_t rows = s->chunk * s->fit.rows, columns = s->n + s->starts;
    s->jacobian =
        lg_alloc(s->context, (2 * columns + 1) * rows + (s->n + 2 * BLOCK) * s->n, sizeof *s->jacobian);
    if (s->jacobian == NULL) return LG_OUT_OF_MEMORY;
    s->columns = s->jacobian + columns * rows;
    s->residuals = s->columns + columns * rows;
    s->triangle = s->residuals + rows;
    s->reflectors = s->triangle + s->n * s->n;
    return LG_OK;
}

lg_status lg_machine_gather(normal *s, bool scored) {
    LG_TRY(allocate(s));
    if (scored) LG_TRY(allocate_scores(s));
    LG_TRY(lg_tape_create(s->context, NULL, &s->tape));
    return add_all(s);
}

lg_status lg_machine_end_gather(normal *s, lg_status status, lg_error *error) {
    (void)lg_tape_conclude(s->tape, status, error);
    lg_tape_destroy(s->tape);
    LG_FREE_ALL(s->context, s->jacobian, s->scores);
    return status;
}

lg_status lg_machine_identify(const lg_context *context, const lg_machine_problem *problem,
                              const double *theta, lg_identification *out, lg_error *error) {
    LG_NEEDS(error, problem, theta, out);
    const lg_machine *machine = problem->machine;
    const size_t count = lg_machine_numbers(machine, theta, 0, NULL);
    lg_status missing = LG_OK;
    normal s = {.context = context,
                .problem = problem,
                .n = machine->parameters,
                .missing = &missing,
                .deviation = 1.0};
    double squares = 0.0;
    (void)lg_machine_mass_at(problem, s.at);
    (void)lg_machine_numbers_at(machine, theta, s.at, count, out->numbers, &missing);
    out->open_count = 0;
    out->block = out->step = 0.0;
    for (size_t i = 0; out->spread != NULL && i < s.n * s.n; i++) out->spread[i] = 0.0;
    for (size_t i = 0; out->correlations != NULL && i < count * count; i++) out->correlations[i] = 0.0;
    if (count == 0) return LG_OK;
    const size_t all = lg_machine_problem_parameters(problem);
    LG_TRY_SCRATCH(lg_identified, moved, context, 2 * count, lg_no_memory(error));
    LG_TRY_SCRATCH(double, at, context, all + (4 * s.n + 1 + count) * s.n + (1 + count) * count,
                   lg_no_memory(error));
    LG_TRY_SCRATCH(int, order, context, s.n, lg_no_memory(error));
    lg_machine_choose_windows(&s, s.n > SMALL ? LG_MACHINE_MOST_WINDOWS : MOST_OF_SMALL);
    memcpy(at, theta, all * sizeof *at);
    s.theta = at;
    const bool left = leave_bounds(&s, at, count, out->numbers, moved, moved + count);
    if (left) s.unmoved = theta;
    lg_status status = lg_machine_gather(&s, true);
    if (status == LG_OK && left) status = lg_machine_loss(context, problem, theta, &squares, NULL, NULL);
    if (left) s.squares = squares;
    if (status == LG_OK) status = conclude(&s, count, at + all, order, moved, out);
    if (status == LG_OK && missing == LG_OUT_OF_MEMORY) status = missing;
    return lg_machine_end_gather(&s, status, error);
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

lg_status lg_machine_uncertain(const lg_context *context, const lg_machine_problem *problem,
                               const lg_fit_problem *fit, const double *x, size_t n,
                               lg_machine_uncertainty *out, lg_error *error) {
    normal s = {.context = context, .problem = problem, .fit = *fit, .theta = x, .n = n};
    LG_TRY_SCRATCH(double, work, context, 4 * n * n, lg_no_memory(error));
    LG_TRY_SCRATCH(int, order, context, n, lg_no_memory(error));
    lg_machine_choose_windows(&s, MOST_OF_SMALL);
    lg_status status = lg_machine_gather(&s, true);
    if (status == LG_OK) status = invert(&s, false, work + n * n, order, out->W);
    if (status == LG_OK) {
        memcpy(work, out->W, n * n * sizeof *work);
        out->block = 0.0;
        status = colour(&s, false, out->W, &out->block);
        out->widened = widened(n, work, out->W);
        out->variance = variance_of(&s);
    }
    return lg_machine_end_gather(&s, status, error);
}

lg_status lg_machine_triangle(const lg_context *context, const lg_machine_problem *problem,
                              const double *theta, double *triangle, double *lagged, double *numbers,
                              lg_error *error) {
    normal s = {.context = context,
                .problem = problem,
                .theta = theta,
                .n = problem->machine->parameters + 1,
                .last = true,
                .lagged = lagged};
    lg_machine_choose_windows(&s, LG_MACHINE_MOST_WINDOWS);
    const lg_status status = lg_machine_gather(&s, false);
    if (status == LG_OK) memcpy(triangle, s.triangle, s.n * s.n * sizeof *triangle);
    *numbers = count_once(&s);
    return lg_machine_end_gather(&s, status, error);
}

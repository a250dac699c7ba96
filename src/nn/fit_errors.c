/* What data say of the shared parameters of a fit: the factor R of the Jacobian J = Q R of the residuals, and
 * from it the covariance. Uses the triangular factor of J, not J^T J: products lose everything below 1e-8 of
 * the largest entry to rounding, and this rounding error would look like information on directions that the
 * data do not determine. */
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "kernels/lapack.h"
#include "nn/fit_errors.h"

enum { CHUNK = 64, BLOCK = 32, RUN = 32, FEW = 64 };

typedef lg_fit_errors normal;

double lg_fit_dot(const double *a, const double *b, size_t n) {
    return lg_kernels_for(LG_F64)->dot(n, a, b);
}

double lg_fit_dot3(const double *a, const double *b, const double *c, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += a[i] * b[i] * c[i];
    return sum;
}

double lg_fit_take_start(double *columns, size_t stride, size_t rows, size_t n, size_t own,
                         const double *variance) {
    static const double rounding = 1e-20;
    double before[LG_FIT_MOST_OWN], taken = 0.0;
    for (size_t k = 0; k < own; k++) {
        const double *column = columns + (n + k) * stride;
        before[k] = lg_fit_dot(column, column, rows);
    }
    for (size_t k = n + own; k-- > n;) {
        const double *pivot = columns + k * stride;
        const double norm = lg_fit_dot(pivot, pivot, rows);
        if (!(norm > rounding * before[k - n])) continue;
        taken += variance != NULL ? lg_fit_dot3(pivot, pivot, variance, rows) / norm : 1.0;
        for (size_t j = 0; j < k; j++) {
            double *column = columns + j * stride;
            lg_kernels_for(LG_F64)->axpy(rows, -lg_fit_dot(pivot, column, rows) / norm, pivot, column);
        }
    }
    return taken;
}

/* Counts the residuals of a chunk. Those that are almost 0 have almost no weight: positions that are
 * integrals of measured velocities, and rows without a measurement. */
static void count_residuals(normal *s) {
    static const double nothing = 1e-8;
    const double least = nothing * lg_fit_dot(s->residuals, s->residuals, s->rows) / (double)s->rows;
    for (size_t row = 0; row < s->rows; row++) {
        const size_t i = row % s->fit.rows;
        if (i < s->fit.rows - s->priors && s->residuals[row] * s->residuals[row] > least)
            s->weighted += s->worth[i % s->each];
    }
}

/* R (n, n) of `matrix` (m, n), which is overwritten; both are column-major. With `order` columns are pivoted,
 * the longest remaining one first, and `order` gets their numbers from 1; with NULL they are not. */
static lg_status triangulate(const lg_context *context, size_t m, size_t n, double *matrix, int *order,
                             double *triangle) {
    const int rows = (int)m, columns = (int)n, query = -1;
    double want = 0.0;
    int info = 0; /* LAPACK sets it only for wrong arguments */
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

/* Adds products of the columns with the columns one row of the log later. */
static void add_lagged(normal *s, size_t count) {
    const size_t each = s->rows / count, d = s->each;
    for (size_t j = 0; j < s->n * s->n; j++)
        for (size_t w = 0; w < count; w++) {
            const double *a = s->columns + j / s->n * s->rows + w * each,
                         *b = s->columns + j % s->n * s->rows + w * each;
            s->lagged[j] += lg_fit_dot(a, b + d, each - d - s->priors);
        }
}

/* Adds products of the residuals of neighbouring rows, and the scores of the windows' stretches. `first`:
 * index of the chunk's first window. */
static void add_scores(normal *s, size_t first, size_t count) {
    const size_t each = s->rows / count, logged = each - s->priors, d = s->each, m = s->stretches;
    for (size_t j = 0; j < s->n; j++)
        s->slope[j] += lg_fit_dot(s->columns + j * s->rows, s->residuals, s->rows);
    for (size_t w = 0; w < count; w++) {
        const double *r = s->residuals + w * each;
        s->neighbours += lg_fit_dot(r, r + d, logged - d);
        for (size_t k = 0; k < m; k++) {
            const size_t begin = logged / d * k / m * d, end = logged / d * (k + 1) / m * d;
            double *score = s->scores + ((first + w) * m + k) * s->n;
            for (size_t j = 0; j < s->n; j++)
                score[j] = lg_fit_dot(s->columns + j * s->rows + w * each + begin, r + begin, end - begin);
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
    const size_t given = s->n - s->last, columns = given + s->fit.own, batch = s->used;
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
    for (size_t j = 0; j < s->n && s->lengths != NULL; j++)
        s->lengths[j] += lg_fit_dot(s->columns + j * s->rows, s->columns + j * s->rows, s->rows);
    for (size_t w = 0, each = s->rows / count; w < count && s->fit.own > 0; w++)
        s->weighted -= lg_fit_take_start(s->columns + w * each, s->rows, each, s->n, s->fit.own, NULL);
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

/* s->weighted with rows that are in several windows counted once. The first row of a window is left out: its
 * start takes as much. Scores of whole windows show by their correlation how windows overlap: nothing changes
 * then. */
double lg_fit_errors_count(const normal *s) {
    if (s->start == NULL || s->stretches == 1) return s->weighted;
    size_t rows = 0, end = 0;
    for (size_t i = 0; i < s->used; i++) {
        const size_t start = s->start[window_at(s, i)] + 1, begin = start > end ? start : end;
        end = start + s->window - 1;
        rows += end - begin;
    }
    return s->weighted * (double)rows / ((double)s->used * (double)(s->window - 1));
}

double lg_fit_errors_variance(const normal *s) {
    return fmax(s->squares / fmax(1.0, lg_fit_errors_count(s) - (double)s->n), DBL_MIN);
}

/* Writes R D/s with D the diagonal matrix of the bounds and s^2 the variance of the residuals: the
 * information in the data, in units of what was known before. */
static void put_information(const normal *s, double *out) {
    const double deviation = sqrt(lg_fit_errors_variance(s));
    for (size_t j = 0; j < s->n; j++)
        for (size_t i = 0; i < s->n; i++)
            out[j * s->n + i] = s->triangle[j * s->n + i] * s->bound[j] / deviation;
}

lg_status lg_fit_errors_invert(const normal *s, double *work, int *order, double *W) {
    static const double nothing = 1e-12;
    const size_t n = s->n;
    const int size = (int)n;
    int info = 0;
    double *first = work, *both = work + n * n;
    put_information(s, W);
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
            W[k * n + i] = s->bound[i] * first[k * n + j];
        }
    return info == 0 ? LG_OK : LG_OUT_OF_MEMORY;
}

/* c (m, n) = factor a (m, n) b^T (n, n) */
static void product(size_t m, size_t n, double factor, const double *a, const double *b, double *c) {
    const int rows = (int)m, columns = (int)n;
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, rows, columns, columns, factor, a, columns, b,
                columns, 0.0, c, columns);
}

lg_status lg_fit_errors_colour(const normal *s, double *W, double *block) {
    const lg_kernels *k = lg_kernels_for(LG_F64);
    const size_t n = s->n, count = s->used * s->stretches;
    const double c = s->neighbours / fmax(s->squares, DBL_MIN), least = 0.02;
    const bool coloured = c > fmax(least, 4.0 / sqrt(fmax(s->weighted, 1.0)));
    LG_TRY_SCRATCH(double, F, s->context, (count + 3 * n) * n, LG_OUT_OF_MEMORY);
    size_t stretches = 0;
    double *apart = F + n * n, *P = F + 2 * n * n, *h = F + 3 * n * n;
    for (size_t j = 0; j < n; j++)
        for (size_t i = 0; i < n; i++) apart[j * n + i] = W[j * n + i] / s->bound[i];
    product(n, n, 1.0, apart, apart, P);
    product(count, n, 1.0 / lg_fit_errors_variance(s), s->scores, W, h);
    LG_TRY(lg_fit_colour(s->context, count, n, s->stretches, (double)s->used / (double)s->windows, coloured,
                         P, h, F, &stretches));
    if (stretches > 0) { /* Columns of W F: column-major W is W^T row by row. */
        k->gemm(n, n, n, F, n, 1, W, n, F + n * n, n, false);
        memcpy(W, F + n * n, n * n * sizeof *W);
        *block = (double)stretches * s->seconds / (double)(s->windows * s->stretches);
    }
    return LG_OK;
}

/* Scores of few windows are taken in several stretches of each window. */
static lg_status allocate_scores(normal *s) {
    const size_t rows = s->fit.rows / s->each, wanted = (FEW + s->used - 1) / s->used;
    s->stretches = wanted < rows ? wanted : rows;
    s->runs = true;
    s->scores = lg_alloc(s->context, (s->used * s->stretches + 1) * s->n, sizeof *s->scores);
    s->slope = s->scores + s->used * s->stretches * s->n;
    return s->scores != NULL ? LG_OK : LG_OUT_OF_MEMORY;
}

static lg_status allocate(normal *s) {
    s->chunk = CHUNK < s->fit.chunk ? CHUNK : s->fit.chunk;
    const size_t rows = s->chunk * s->fit.rows, columns = s->n + s->fit.own;
    s->jacobian =
        lg_alloc(s->context, (2 * columns + 1) * rows + (s->n + 2 * BLOCK + 1) * s->n, sizeof *s->jacobian);
    if (s->jacobian == NULL) return LG_OUT_OF_MEMORY;
    s->columns = s->jacobian + columns * rows;
    s->residuals = s->columns + columns * rows;
    s->triangle = s->residuals + rows;
    s->reflectors = s->triangle + s->n * s->n;
    s->bound = s->reflectors + (size_t)(2 * BLOCK) * s->n;
    return LG_OK;
}

lg_status lg_fit_errors_gather(normal *s, bool scored) {
    LG_TRY(allocate(s));
    if (scored) LG_TRY(allocate_scores(s));
    LG_TRY(lg_tape_create(s->context, NULL, &s->tape));
    return add_all(s);
}

lg_status lg_fit_errors_end(normal *s, lg_status status, lg_error *error) {
    (void)lg_tape_conclude(s->tape, status, error);
    lg_tape_destroy(s->tape);
    LG_FREE_ALL(s->context, s->jacobian, s->scores);
    return status;
}

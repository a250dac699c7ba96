/* Machines: standard errors of their numbers, from the Gauss-Newton matrix. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "kernels/kernels.h"
#include "liegrad/ops.h"
#include "models/machine_internal.h"

enum { MOST_WINDOWS = 512, CHUNK = 64 };

/* J^T J (n, n) of the machine's parameters, the starts of the windows eliminated; the sum of squares. */
typedef struct normal {
    const lg_context *context;
    const lg_machine_problem *problem;
    lg_fit_problem fit;
    const double *theta;
    size_t n, starts;  /* parameters of the machine, of one start */
    size_t rows;       /* numbers of the residuals of a chunk, and room for them */
    double *jacobian;  /* (rows, n + starts) */
    double *columns;   /* its transpose */
    double *residuals; /* (rows) */
    double *matrix;    /* (n, n) */
    double squares, weighted;
} normal;

static double dot(const double *a, const double *b, size_t n) {
    return lg_kernels_for(LG_F64)->dot(n, a, b);
}

/* The columns of the parameters lose their components along those of the starts, window by window: each has
 * `each` rows. */
static void eliminate(normal *s, size_t count) {
    const size_t each = s->rows / count;
    for (size_t w = 0; w < count; w++)
        for (size_t k = s->n + s->starts; k-- > s->n;) {
            const double *pivot = s->columns + k * s->rows + w * each;
            const double norm = dot(pivot, pivot, each);
            for (size_t j = 0; j < k && norm > 0.0; j++) {
                double *column = s->columns + j * s->rows + w * each;
                const double part = dot(pivot, column, each) / norm;
                for (size_t row = 0; row < each; row++) column[row] -= part * pivot[row];
            }
        }
}

static lg_status add_chunk(normal *s, lg_tape *tape, const uint32_t *samples, size_t count, size_t batch) {
    const size_t columns = s->n + s->starts;
    double squares = 0.0;
    s->rows = count * s->fit.rows;
    LG_TRY(s->fit.linearise(s->fit.user, tape, s->theta, samples, count, batch, &squares, s->residuals,
                            s->jacobian));
    for (size_t row = 0; row < s->rows; row++)
        for (size_t j = 0; j < columns; j++) s->columns[j * s->rows + row] = s->jacobian[row * columns + j];
    if (s->starts > 0) eliminate(s, count);
    s->squares += squares;
    for (size_t row = 0; row < s->rows; row++) s->weighted += s->residuals[row] != 0.0;
    for (size_t i = 0; i < s->n; i++)
        for (size_t j = 0; j <= i; j++)
            s->matrix[i * s->n + j] += dot(s->columns + i * s->rows, s->columns + j * s->rows, s->rows);
    return LG_OK;
}

static lg_status add_all(normal *s, lg_tape *tape) {
    const size_t windows = s->problem->windows - s->problem->validation;
    const size_t used = windows < MOST_WINDOWS ? windows : MOST_WINDOWS;
    uint32_t samples[CHUNK];
    for (size_t first = 0; first < used; first += CHUNK) {
        const size_t count = used - first < CHUNK ? used - first : CHUNK;
        for (size_t i = 0; i < count; i++) samples[i] = (uint32_t)((first + i) * windows / used);
        LG_TRY(add_chunk(s, tape, samples, count, used));
    }
    /* As if from all windows. */
    for (size_t i = 0; i < s->n * s->n; i++) s->matrix[i] *= (double)windows / (double)used;
    return LG_OK;
}

/* Standard deviation of parameter i before any data: weights of networks 1, others hardly bounded. */
static double spread(const normal *s, size_t i) {
    const lg_machine *machine = s->problem->machine;
    for (uint32_t t = 0; t < machine->term_count; t++) {
        const lg_machine_term *term = &machine->terms[t];
        if (i < term->offset + term->parameters && term->kind->outputs != NULL && i >= term->offset)
            return 1.0;
    }
    return 1e4;
}

/* matrix becomes V, and weights 1/(lambda + 1) of its columns, so that V diag(weights) V^T is the inverse of
 * D (J^T J/s^2) D + 1, D the prior standard deviations; s^2 from the residuals. False: no convergence. */
static bool decompose(normal *s, double *weights) {
    const double freedom = fmax(1.0, s->weighted - (double)s->n);
    const double variance = fmax(s->squares / freedom, DBL_MIN);
    for (size_t i = 0; i < s->n; i++)
        for (size_t j = 0; j <= i; j++)
            s->matrix[j * s->n + i] = s->matrix[i * s->n + j] *= spread(s, i) * spread(s, j) / variance;
    if (!lg_machine_eigen(s->context, s->n, s->matrix, weights)) return false;
    /* Eigenvalues below rounding are those of directions that the data do not show; weights of networks have
     * another unit. */
    const double nothing =
        s->problem->machine->weights > 0 ? 0.0 : 4.0 * DBL_EPSILON * (double)s->n * weights[s->n - 1];
    for (size_t i = 0; i < s->n; i++) weights[i] = 1.0 / ((weights[i] > nothing ? weights[i] : 0.0) + 1.0);
    return true;
}

/* gradient (count, n): the derivative of each number by each parameter, by differences. */
static void differentiate(const normal *s, double *theta, size_t count, lg_identified *moved,
                          double *gradient) {
    static const double step = 1e-5;
    const lg_machine *machine = s->problem->machine;
    for (size_t j = 0; j < s->n; j++) {
        const double before = theta[j];
        theta[j] = before + step;
        (void)lg_machine_numbers(machine, theta, count, moved);
        for (size_t i = 0; i < count; i++) gradient[i * s->n + j] = moved[i].value;
        theta[j] = before - step;
        (void)lg_machine_numbers(machine, theta, count, moved);
        for (size_t i = 0; i < count; i++)
            gradient[i * s->n + j] = (gradient[i * s->n + j] - moved[i].value) / (2.0 * step);
        theta[j] = before;
    }
}

/* The gradients become their shares in the eigenvectors: error^2 is the sum of their squares. units: what a
 * change of each number is small against, its value, or where that is next to 0 what a parameter makes of it.
 */
static void propagate(const normal *s, const double *weights, size_t count, double *gradient, double *row,
                      lg_identified *numbers, double *units) {
    static const double lost = 1e3, small = 1e-2;
    for (size_t i = 0; i < count; i++) {
        double *g = gradient + i * s->n, variance = 0.0, largest = 0.0;
        for (size_t j = 0; j < s->n; j++) {
            largest = fmax(largest, fabs(g[j]));
            row[j] = g[j] * spread(s, j);
        }
        for (size_t k = 0; k < s->n; k++) {
            g[k] = sqrt(weights[k]) * dot(s->matrix + k * s->n, row, s->n);
            variance += g[k] * g[k];
        }
        numbers[i].error = sqrt(variance);
        if (numbers[i].error > lost * largest) numbers[i].error = (double)INFINITY;
        units[i] = fmax(fmax(fabs(numbers[i].value), small * largest), DBL_MIN);
    }
}

/* The covariance of the numbers in their units. */
static void multiply(const normal *s, size_t count, const double *shares, const double *units, double *out) {
    for (size_t i = 0; i < count; i++)
        for (size_t j = 0; j <= i; j++)
            out[i * count + j] = out[j * count + i] =
                dot(shares + i * s->n, shares + j * s->n, s->n) / (units[i] * units[j]);
}

/* W = D V sqrt(weights), (n, n). */
static void put_spread(const normal *s, const double *weights, double *W) {
    for (size_t k = 0; k < s->n; k++)
        for (size_t i = 0; i < s->n; i++)
            W[i * s->n + k] = spread(s, i) * s->matrix[k * s->n + i] * sqrt(weights[k]);
}

/* What follows from the matrix. */
static lg_status conclude(normal *s, size_t count, double *work, lg_identification *out) {
    lg_identified *moved = lg_alloc(s->context, count, sizeof *moved);
    double *weights = work, *theta = weights + s->n, *gradient = theta + s->n,
           *units = gradient + count * s->n, *covariance = units + count;
    lg_status status = moved != NULL ? LG_OK : LG_OUT_OF_MEMORY;
    if (status == LG_OK && decompose(s, weights)) {
        memcpy(theta, s->theta, s->n * sizeof *theta);
        if (out->spread != NULL) put_spread(s, weights, out->spread);
        differentiate(s, theta, count, moved, gradient);
        propagate(s, weights, count, gradient, theta, out->numbers, units);
        multiply(s, count, gradient, units, covariance);
        status = lg_machine_relate(s->context, count, covariance, out);
    }
    lg_free(s->context, moved);
    return status;
}

lg_status lg_machine_identify(const lg_context *context, const lg_machine_problem *problem,
                              const double *theta, lg_identification *out, lg_error *error) {
    const lg_machine *machine = problem->machine;
    const size_t count = lg_machine_numbers(machine, theta, 0, NULL);
    normal s = {.context = context, .problem = problem, .theta = theta, .n = machine->parameters};
    lg_tape *tape = NULL;
    (void)lg_machine_numbers(machine, theta, count, out->numbers);
    out->open_count = 0;
    for (size_t i = 0; out->spread != NULL && i < s.n * s.n; i++) out->spread[i] = 0.0;
    for (size_t i = 0; out->correlations != NULL && i < count * count; i++) out->correlations[i] = 0.0;
    if (count == 0) return LG_OK;
    lg_machine_fit_problem(problem, &s.fit);
    if (problem->starts == LG_MACHINE_STARTS_ESTIMATED)
        s.starts = (s.fit.parameters - s.n) / problem->windows;
    const size_t rows = CHUNK * s.fit.rows, columns = s.n + s.starts;
    s.jacobian = lg_alloc(context, (2 * columns + 1) * rows, sizeof(double));
    if (s.jacobian != NULL) {
        s.columns = s.jacobian + columns * rows;
        s.residuals = s.columns + columns * rows;
    }
    s.matrix = lg_alloc(context, s.n * s.n, sizeof(double));
    double *work = lg_alloc(context, (2 + count) * s.n + (1 + count) * count, sizeof *work);
    const bool room = s.jacobian != NULL && s.matrix != NULL && work != NULL;
    lg_status status = room ? lg_tape_create(context, NULL, &tape) : LG_OUT_OF_MEMORY;
    if (status == LG_OK) {
        memset(s.matrix, 0, s.n * s.n * sizeof *s.matrix);
        status = add_all(&s, tape);
        if (status != LG_OK) (void)lg_fail(error, status, "%s", lg_tape_message(tape));
    } else {
        (void)lg_fail(error, status, "%s", lg_status_sentence(status));
    }
    if (status == LG_OK) {
        status = conclude(&s, count, work, out);
        if (status != LG_OK) (void)lg_fail(error, status, "%s", lg_status_sentence(status));
    }
    lg_tape_destroy(tape);
    lg_free(context, s.jacobian);
    lg_free(context, s.matrix);
    lg_free(context, work);
    return status;
}

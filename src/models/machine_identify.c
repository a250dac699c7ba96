/* Machines: standard errors of their numbers, from the Gauss-Newton matrix. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "core/core.h"
#include "kernels/lapack.h"
#include "liegrad/ops.h"
#include "models/machine_internal.h"

enum { MOST_WINDOWS = 512, LEAST_WINDOWS = 48, MOST_SWEEPS = 60000, CHUNK = 64 };

/* J^T J (n, n) of the machine's parameters, the starts of the windows eliminated; the sum of squares. */
typedef struct normal {
    const lg_context *context;
    const lg_machine_problem *problem;
    lg_fit_problem fit;
    const double *theta;
    size_t n, starts;  /* parameters of the machine, of one start */
    size_t rows;       /* numbers of the residuals of a chunk, and room for them */
    double *columns;   /* (n + starts, rows) */
    double *residuals; /* (rows) */
    double *matrix;    /* (n, n) */
    double squares, weighted;
} normal;

/* Column j: the derivative by parameter j, or by start number j - n of all windows at once. */
static lg_status fill_column(normal *s, lg_tape *tape, lg_var theta, lg_var r, const uint32_t *samples,
                             size_t count, size_t j) {
    void *memory;
    const lg_mark mark = lg_tape_mark(tape);
    const lg_var direction = lg_input_buffer(tape, lg_shape1((uint32_t)s->fit.parameters), &memory);
    lg_var column;
    if (lg_is_none(direction)) return lg_tape_status(tape);
    memset(memory, 0, s->fit.parameters * sizeof(double));
    if (j < s->n) ((double *)memory)[j] = 1.0;
    for (size_t i = 0; j >= s->n && i < count; i++)
        ((double *)memory)[s->n + samples[i] * s->starts + j - s->n] = 1.0;
    LG_TRY(lg_jvp(tape, &r, 1, &theta, &direction, 1, &column));
    LG_TRY(lg_read(tape, column, s->rows, s->columns + j * s->rows));
    return lg_tape_rewind(tape, mark);
}

static double dot(const double *a, const double *b, size_t n) {
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
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
    lg_var r;
    lg_tape_reset(tape);
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)s->fit.parameters), s->theta);
    LG_TRY(s->fit.residuals(s->fit.user, tape, theta, samples, count, batch, &r));
    s->rows = lg_shape_count(lg_var_shape(tape, r));
    LG_TRY(lg_read(tape, r, s->rows, s->residuals));
    for (size_t j = 0; j < s->n + s->starts; j++) LG_TRY(fill_column(s, tape, theta, r, samples, count, j));
    if (s->starts > 0) eliminate(s, count);
    s->squares += dot(s->residuals, s->residuals, s->rows);
    for (size_t row = 0; row < s->rows; row++) s->weighted += s->residuals[row] != 0.0;
    for (size_t i = 0; i < s->n; i++)
        for (size_t j = 0; j <= i; j++)
            s->matrix[i * s->n + j] += dot(s->columns + i * s->rows, s->columns + j * s->rows, s->rows);
    return LG_OK;
}

static lg_status add_all(normal *s, lg_tape *tape) {
    const size_t windows = s->problem->windows - s->problem->validation;
    /* Windows times columns bound the work; many parameters need rows enough, too. */
    size_t wanted = MOST_SWEEPS / (s->n + s->starts);
    wanted = wanted > MOST_WINDOWS ? MOST_WINDOWS : wanted < LEAST_WINDOWS ? LEAST_WINDOWS : wanted;
    const size_t used = windows < wanted ? windows : wanted;
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
    const int n = (int)s->n;
    const double freedom = fmax(1.0, s->weighted - (double)s->n);
    const double variance = fmax(s->squares / freedom, DBL_MIN);
    for (size_t i = 0; i < s->n; i++)
        for (size_t j = 0; j <= i; j++)
            s->matrix[j * s->n + i] = s->matrix[i * s->n + j] *= spread(s, i) * spread(s, j) / variance;
    double want;
    int iwant, info = 0, query = -1;
    dsyevd_("V", "U", &n, s->matrix, &n, weights, &want, &query, &iwant, &query, &info);
    const int room = (int)want, iroom = iwant;
    double *work = lg_alloc(s->context, (size_t)room, sizeof *work);
    int *iwork = lg_alloc(s->context, (size_t)iroom, sizeof *iwork);
    info = work != NULL && iwork != NULL ? 0 : -1;
    if (info == 0) dsyevd_("V", "U", &n, s->matrix, &n, weights, work, &room, iwork, &iroom, &info);
    lg_free(s->context, work);
    lg_free(s->context, iwork);
    for (size_t i = 0; i < s->n; i++) weights[i] = 1.0 / (fmax(weights[i], 0.0) + 1.0);
    return info == 0;
}

/* sqrt(g^T C g), g the derivative of each number by differences. */
static void propagate(const normal *s, const double *weights, double *theta, size_t count, lg_identified *out,
                      lg_identified *moved, double *gradient) {
    static const double step = 1e-5, lost = 1e3;
    const lg_machine *machine = s->problem->machine;
    for (size_t i = 0; i < count * s->n; i++) gradient[i] = 0.0;
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
    for (size_t i = 0; i < count; i++) {
        double *g = gradient + i * s->n, variance = 0.0, largest = 0.0;
        for (size_t j = 0; j < s->n; j++) {
            largest = fmax(largest, fabs(g[j]));
            g[j] *= spread(s, j);
        }
        for (size_t k = 0; k < s->n; k++) {
            const double part = dot(s->matrix + k * s->n, g, s->n);
            variance += weights[k] * part * part;
        }
        out[i].error = sqrt(variance);
        if (out[i].error > lost * largest) out[i].error = (double)INFINITY;
    }
}

static size_t residual_room(const lg_machine_problem *problem) {
    return (size_t)CHUNK * problem->window * (problem->machine->positions + problem->machine->velocities);
}

lg_status lg_machine_identify(const lg_context *context, const lg_machine_problem *problem,
                              const double *theta, lg_identified *out, lg_error *error) {
    const lg_machine *machine = problem->machine;
    const size_t count = lg_machine_numbers(machine, theta, 0, NULL);
    normal s = {.context = context, .problem = problem, .theta = theta, .n = machine->parameters};
    lg_tape *tape = NULL;
    (void)lg_machine_numbers(machine, theta, count, out);
    if (count == 0) return LG_OK;
    lg_machine_fit_problem(problem, &s.fit);
    if (problem->starts == LG_MACHINE_STARTS_ESTIMATED)
        s.starts = (s.fit.parameters - s.n) / problem->windows;
    s.columns = lg_alloc(context, (s.n + s.starts) * residual_room(problem), sizeof(double));
    s.residuals = lg_alloc(context, residual_room(problem), sizeof(double));
    s.matrix = lg_alloc(context, s.n * s.n, sizeof(double));
    double *work = lg_alloc(context, (2 + count) * s.n, sizeof *work);
    lg_identified *moved = lg_alloc(context, count, sizeof *moved);
    const bool room =
        s.columns != NULL && s.residuals != NULL && s.matrix != NULL && work != NULL && moved != NULL;
    lg_status status = room ? lg_tape_create(context, NULL, &tape) : LG_OUT_OF_MEMORY;
    if (status == LG_OK) {
        memset(s.matrix, 0, s.n * s.n * sizeof *s.matrix);
        status = add_all(&s, tape);
        if (status != LG_OK) (void)lg_fail(error, status, "%s", lg_tape_message(tape));
    } else {
        (void)lg_fail(error, status, "%s", lg_status_sentence(status));
    }
    if (status == LG_OK && decompose(&s, work)) {
        memcpy(work + s.n, theta, s.n * sizeof *work);
        propagate(&s, work, work + s.n, count, out, moved, work + 2 * s.n);
    }
    lg_tape_destroy(tape);
    lg_free(context, s.columns);
    lg_free(context, s.residuals);
    lg_free(context, s.matrix);
    lg_free(context, work);
    lg_free(context, moved);
    return status;
}

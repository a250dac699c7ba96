/* Training on sums of squares: loss, gradient and Gauss-Newton matrix of all training samples. The Jacobian
 * comes from the problem's `linearise`, or from forward mode on the shards' tapes, one column per parameter.
 * The matrix has the form of lg_minimiser_tell_squares. Its part of the shared parameters is summed over the
 * shards; the parts of single samples are written to the first shard's matrix directly. */
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "nn/fit_internal.h"

/* Number of parameters that all samples share. */
static size_t shared_by_all(const lg_fit *fit) {
    return fit->problem.parameters - fit->problem.own * fit->problem.samples;
}

/* Columns of the Jacobian: the shared parameters, then the parameters of one sample. */
static size_t columns_of(const lg_fit *fit) {
    return shared_by_all(fit) + fit->problem.own;
}

/* Makes room for the Jacobian (rows, columns), the residuals and, without `linearise`, its transpose. */
static lg_status room_for(const lg_fit *fit, lg_shard *shard, size_t rows) {
    const size_t columns = columns_of(fit), copies = fit->problem.linearise != NULL ? 1 : 2;
    if (shard->rows >= rows) return LG_OK;
    lg_free(fit->context, shard->jacobian);
    shard->rows = 0;
    shard->jacobian = lg_alloc(fit->context, rows * (copies * columns + 1), sizeof(double));
    if (shard->jacobian == NULL) return LG_OUT_OF_MEMORY;
    shard->rows = rows;
    return LG_OK;
}

/* Fills the transposed Jacobian. Row j is the derivative of r by shared parameter j; beyond the shared ones,
 * by own parameter number j - shared of all samples at once. */
static lg_status fill_columns(const lg_fit *fit, lg_tape *tape, lg_var theta, lg_var r,
                              const uint32_t *samples, size_t count, size_t rows, double *transposed) {
    const size_t n = fit->problem.parameters, shared = shared_by_all(fit), own = fit->problem.own;
    const lg_mark mark = lg_tape_mark(tape);
    for (size_t j = 0; j < shared + own; j++) {
        void *unit;
        lg_var direction = lg_input_buffer(tape, lg_shape1((uint32_t)n), &unit), column;
        if (lg_is_none(direction)) return lg_tape_status(tape);
        memset(unit, 0, n * sizeof(double));
        if (j < shared) ((double *)unit)[j] = 1.0;
        for (size_t i = 0; j >= shared && i < count; i++)
            ((double *)unit)[shared + samples[i] * own + j - shared] = 1.0;
        LG_TRY(lg_jvp(tape, &r, 1, &theta, &direction, 1, &column));
        LG_TRY(lg_read(tape, column, rows, transposed + j * rows));
        LG_TRY(lg_tape_rewind(tape, mark));
    }
    return LG_OK;
}

/* Computes r and J (rows, columns) by forward sweeps. */
static lg_status sweep_forward(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count,
                               size_t *rows) {
    const size_t columns = columns_of(fit);
    lg_tape *tape = shard->tape;
    lg_var theta, r = LG_NONE;
    lg_tape_reset(tape);
    LG_TRY(lg_fit_record(&fit->problem, tape, fit->point, true, samples, count, fit->training, &theta, &r));
    *rows = (size_t)lg_shape_count(lg_var_shape(tape, r));
    LG_TRY(room_for(fit, shard, *rows));
    double *residuals = shard->jacobian + columns * *rows, *transposed = residuals + *rows;
    LG_TRY(lg_read(tape, r, *rows, residuals));
    LG_TRY(fill_columns(fit, tape, theta, r, samples, count, *rows, transposed));
    fit->k->transpose(columns, *rows, transposed, shard->jacobian);
    shard->loss += fit->k->dot(*rows, residuals, residuals);
    return LG_OK;
}

static lg_status linearise(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count,
                           size_t *rows) {
    double loss = 0.0;
    *rows = count * fit->problem.rows;
    LG_TRY(room_for(fit, shard, *rows));
    LG_TRY(fit->problem.linearise(fit->problem.user, shard->tape, fit->point, samples, count, fit->training,
                                  &loss, shard->jacobian + columns_of(fit) * *rows, shard->jacobian));
    LG_TRY(lg_tape_status(shard->tape));
    shard->loss += loss;
    return LG_OK;
}

/* Adds J^T J to the upper triangle of P (shared, shared), J^T r to the shared part of the gradient. */
static void add_shared(const lg_fit *fit, lg_shard *shard, size_t rows, const double *jacobian,
                       const double *residuals) {
    enum { WIDTH = 96 };
    const size_t columns = columns_of(fit), n = shared_by_all(fit);
    double *gradient = (double *)(void *)shard->gradient;
    for (size_t at = 0; at < n; at += WIDTH) {
        const size_t width = n - at < WIDTH ? n - at : WIDTH;
        fit->k->gemm(width, n - at, rows, jacobian + at, 1, columns, jacobian + at, columns,
                     shard->matrix + at * n + at, n, true);
    }
    for (size_t row = 0; row < rows; row++)
        fit->k->axpy(n, residuals[row], jacobian + row * columns, gradient);
}

size_t lg_fit_squares_length(const lg_fit *fit) {
    return shared_by_all(fit) * shared_by_all(fit);
}

lg_fit_own lg_fit_own_of(const lg_fit *fit, uint32_t sample) {
    const size_t n = shared_by_all(fit), own = fit->problem.own, at = sample * own;
    double *rest = fit->shards[0].matrix + n * n;
    return (lg_fit_own){.rows = rest + at * n,
                        .block = rest + fit->problem.samples * own * n + at * own,
                        .rows_length = own * n,
                        .block_length = own * own};
}

/* Writes C, B and the part of the gradient of one sample. No other shard writes there. */
static void put_own(const lg_fit *fit, lg_shard *shard, uint32_t sample, size_t rows, const double *jacobian,
                    const double *residuals) {
    const size_t columns = columns_of(fit), n = shared_by_all(fit), own = fit->problem.own;
    const lg_fit_own to = lg_fit_own_of(fit, sample);
    double *gradient = (double *)(void *)shard->gradient + n + sample * own;
    fit->k->gemm(own, n, rows, jacobian + n, 1, columns, jacobian, columns, to.rows, n, false);
    fit->k->gemm(own, own, rows, jacobian + n, 1, columns, jacobian + n, columns, to.block, own, false);
    for (size_t row = 0; row < rows; row++)
        fit->k->axpy(own, residuals[row], jacobian + row * columns + n, gradient);
}

lg_status lg_fit_add_squares(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count) {
    const size_t columns = columns_of(fit);
    size_t rows = 0;
    if (samples == shard->samples) {
        memset(shard->matrix, 0, lg_fit_squares_length(fit) * sizeof(double));
        memset(shard->gradient, 0, fit->problem.parameters * sizeof(double));
    }
    LG_TRY((fit->problem.linearise != NULL ? linearise : sweep_forward)(fit, shard, samples, count, &rows));
    const double *jacobian = shard->jacobian, *residuals = jacobian + columns * rows;
    const size_t each = rows / count;
    add_shared(fit, shard, rows, jacobian, residuals);
    for (size_t i = 0; i < count && fit->problem.own > 0; i++)
        put_own(fit, shard, samples[i], each, jacobian + i * each * columns, residuals + i * each);
    return LG_OK;
}

/* The first shard holds the whole matrix, the others only P. The first shard is allocated last. */
static lg_status make_matrices(lg_fit *fit) {
    const size_t n = shared_by_all(fit);
    const lg_minimise_options options = lg_fit_minimise_options(fit, fit->state.phase);
    for (size_t i = fit->used; i-- > 0;) {
        lg_shard *shard = &fit->shards[i];
        if (!lg_fit_holds(fit, i)) continue;
        const size_t numbers = i > 0 ? n * n : lg_minimise_matrix_length(fit->problem.parameters, &options);
        if (shard->matrix == NULL) shard->matrix = lg_alloc(fit->context, numbers, sizeof(double));
        if (shard->matrix == NULL) return LG_OUT_OF_MEMORY;
    }
    return LG_OK;
}

/* Adds up gradients and matrices of all shards, mirrors P's upper triangle to the lower one, doubles all. */
static void add_up(lg_fit *fit) {
    const size_t n = shared_by_all(fit), all = fit->problem.parameters;
    double *matrix = fit->shards[0].matrix;
    (void)lg_fit_reduce(fit, LG_PAIRS_REST);
    fit->k->unary[LG_K_SCALE](all, 2.0, fit->shards[0].gradient, fit->shards[0].gradient);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < i; j++) matrix[i * n + j] = matrix[j * n + i];
    const size_t numbers = n * n + (all - n) * (n + fit->problem.own);
    fit->k->unary[LG_K_SCALE](numbers, 2.0, matrix, matrix);
}

lg_status lg_fit_squares(lg_fit *fit, const char *what, double *value, lg_error *error) {
    if (fit->shards[0].matrix == NULL) {
        const lg_status made = make_matrices(fit);
        if (made != LG_OK)
            (void)lg_fail(error, made, "no memory for the Gauss-Newton matrix of %zu parameters",
                          fit->problem.parameters);
        LG_TRY(lg_fit_agree(fit, made, error));
    }
    LG_TRY(lg_fit_batch_loss(fit, fit->state.order, fit->training, LG_FIT_SQUARES, what, value, error));
    add_up(fit);
    return LG_OK;
}

void lg_fit_add_diagonal(lg_fit *fit, size_t weights, double prior, double decay) {
    const size_t n = shared_by_all(fit), own = fit->problem.own, rest = fit->problem.parameters - n;
    double *matrix = fit->shards[0].matrix, *B = matrix + n * n + rest * n;
    const double *each = fit->problem.decay;
    for (size_t i = 0; i < n; i++)
        matrix[i * n + i] += decay + (i < weights ? prior : 0.0) + (each != NULL ? each[i] : 0.0);
    for (size_t i = 0; i < rest; i++) B[i * own + i % own] += decay + (each != NULL ? each[n + i] : 0.0);
}

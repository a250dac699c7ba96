/* Sums of squares in training: loss, gradient and Gauss-Newton matrix of all training samples, from
 * residuals on the shards' tapes. The Jacobian comes by forward mode, a column a parameter. */
#include <string.h>

#include "autodiff/tape_internal.h"
#include "nn/fit_internal.h"

/* Parameters that all samples share. */
static size_t shared_by_all(const lg_fit *fit) {
    return fit->problem.parameters - fit->problem.own * fit->problem.samples;
}

/* Columns of the Jacobian: one for each shared parameter, one for each of a sample's own. */
static size_t columns_of(const lg_fit *fit) {
    return shared_by_all(fit) + fit->problem.own;
}

/* The Jacobian's transpose (columns, rows), then the Jacobian, the residuals, and products (columns,
 * columns). */
static lg_status room_for(const lg_fit *fit, lg_shard *shard, size_t rows) {
    const size_t columns = columns_of(fit);
    if (shard->rows >= rows) return LG_OK;
    lg_free(fit->context, shard->jacobian);
    shard->rows = 0;
    shard->jacobian = lg_alloc(fit->context, rows * (2 * columns + 1) + columns * columns, sizeof(double));
    if (shard->jacobian == NULL) return LG_OUT_OF_MEMORY;
    shard->rows = rows;
    return LG_OK;
}

/* Row j of the transpose: the derivative of r by shared parameter j, or by own number j of all samples. */
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

/* Adds 2 J^T r and 2 J^T J of `rows` rows, from columns at a stride, to the shard's: column j is parameter j
 * when it is shared, else j - shared + first. */
static void add_rows(const lg_fit *fit, lg_shard *shard, size_t rows, size_t stride, const double *transposed,
                     const double *residuals, size_t first, double *products) {
    const size_t n = fit->problem.parameters, columns = columns_of(fit), shared = shared_by_all(fit);
    double *jacobian = products + columns * columns, *gradient = (double *)(void *)shard->gradient;
    for (size_t j = 0; j < columns; j++)
        for (size_t row = 0; row < rows; row++) jacobian[row * columns + j] = transposed[j * stride + row];
    fit->k->gemm(columns, columns, rows, transposed, stride, 1, jacobian, columns, products, columns, false);
    for (size_t i = 0; i < columns; i++) {
        const size_t at = i < shared ? i : first + i - shared;
        gradient[at] += 2.0 * fit->k->dot(rows, transposed + i * stride, residuals);
        for (size_t j = 0; j < columns; j++)
            shard->matrix[at * n + (j < shared ? j : first + j - shared)] += 2.0 * products[i * columns + j];
    }
}

/* Adds |r|^2, 2 J^T r and 2 J^T J of `count` samples to the shard's. */
static lg_status add_chunk(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count) {
    const size_t n = fit->problem.parameters, columns = columns_of(fit), own = fit->problem.own;
    lg_tape *tape = shard->tape;
    lg_var r = LG_NONE;
    lg_tape_reset(tape);
    const lg_var theta = lg_parameter(tape, lg_shape1((uint32_t)n), fit->point);
    const lg_status given =
        fit->problem.residuals(fit->problem.user, tape, theta, samples, count, fit->training, &r);
    LG_TRY(lg_tape_status(tape));
    LG_TRY(given);
    const size_t rows = (size_t)lg_shape_count(lg_var_shape(tape, r));
    LG_TRY(room_for(fit, shard, rows));
    double *transposed = shard->jacobian, *residuals = transposed + columns * rows,
           *products = residuals + rows;
    LG_TRY(lg_read(tape, r, rows, residuals));
    LG_TRY(fill_columns(fit, tape, theta, r, samples, count, rows, transposed));
    shard->loss += fit->k->dot(rows, residuals, residuals);
    const size_t blocks = own > 0 ? count : 1, each = rows / blocks;
    for (size_t i = 0; i < blocks; i++) {
        const size_t first = own > 0 ? shared_by_all(fit) + samples[i] * own : 0;
        add_rows(fit, shard, each, rows, transposed + i * each, residuals + i * each, first, products);
    }
    return LG_OK;
}

static lg_status add_shard(const lg_fit *fit, lg_shard *shard) {
    const size_t n = fit->problem.parameters;
    if (shard->matrix == NULL) shard->matrix = lg_alloc(fit->context, n * n, sizeof(double));
    if (shard->matrix == NULL) return LG_OUT_OF_MEMORY;
    memset(shard->matrix, 0, n * n * sizeof(double));
    memset(shard->gradient, 0, n * sizeof(double));
    return lg_fit_chunks(fit, shard, add_chunk);
}

static void shard_task(void *user, size_t index) {
    lg_fit *fit = user;
    fit->shards[index].status = add_shard(fit, &fit->shards[index]);
}

lg_status lg_fit_squares(lg_fit *fit, const char *what, double *value, lg_error *error) {
    const size_t n = fit->problem.parameters;
    lg_fit_cut(fit, fit->state.order, fit->training);
    lg_thread_pool_run(fit->pool, fit->active, shard_task, fit);
    LG_TRY(lg_fit_sum_losses(fit, what, value, error));
    for (size_t i = 1; i < fit->active; i++) {
        fit->k->axpy(n, 1.0, fit->shards[i].gradient, fit->shards[0].gradient);
        fit->k->axpy(n * n, 1.0, fit->shards[i].matrix, fit->shards[0].matrix);
    }
    return LG_OK;
}

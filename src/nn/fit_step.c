/* One training step. A batch is cut into contiguous pieces, one per shard; each shard has its own tape and
 * gradient. Gradients are added pairwise, (0 + 1) + (2 + 3) ..., then the method takes its step. Results do
 * not depend on the number of threads: a task writes only to its own shard or its own block of parameters. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "core/clean.h"
#include "nn/fit_internal.h"

/* Threads are used from so many blocks on; with fewer, waking them costs more than it saves. */
#define PARALLEL_BLOCKS 16

static size_t chunk_of(const lg_fit *fit) {
    return fit->problem.chunk > 0 ? fit->problem.chunk : LG_FIT_CHUNK;
}

/* Adds loss and gradient of `count` samples to the shard's; its first chunk overwrites the gradient. */
static lg_status chunk_loss(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count) {
    lg_tape *tape = shard->tape;
    if (fit->problem.gradient != NULL) {
        const bool wanted = fit->wanted == LG_FIT_GRADIENT;
        if (wanted && samples == shard->samples)
            memset(shard->gradient, 0, fit->problem.parameters * fit->k->size);
        return fit->problem.gradient(fit->problem.user, fit->point, samples, count, fit->batch_samples,
                                     &shard->loss, wanted ? shard->gradient : NULL);
    }
    if (fit->plans && fit->wanted == LG_FIT_GRADIENT) {
        bool done;
        LG_TRY(lg_fit_run_recording(fit, shard, samples, count, &done));
        if (done) return LG_OK;
    }
    lg_tape_reset(tape);
    lg_var theta, loss = LG_NONE;
    double value = 0.0;
    LG_TRY(lg_fit_record(&fit->problem, tape, fit->point, false, samples, count, fit->batch_samples, &theta,
                         &loss));
    LG_TRY(lg_read(tape, loss, 1, &value));
    shard->loss += value;
    if (fit->wanted < LG_FIT_GRADIENT || !isfinite(shard->loss)) return LG_OK;
    void *gradient = shard->gradient;
    /* one sweep computes the whole gradient, whose norm is not needed for clipping: its bound suffices */
    if (fit->active == 1 && count == shard->count && fit->options.clip_norm == 0.0)
        return lg_backward_set_bounded(tape, loss, &theta, 1, &gradient, &shard->bound);
    if (samples == shard->samples) return lg_backward_set(tape, loss, &theta, 1, &gradient);
    return lg_backward(tape, loss, &theta, 1, &gradient);
}

/* Chunks of samples bound the memory of a tape and keep its values in the cache. */
static void shard_task(void *user, size_t index) {
    lg_fit *fit = user;
    lg_shard *shard = &fit->shards[index];
    const size_t chunk = chunk_of(fit);
    shard->loss = 0.0;
    shard->bound = INFINITY;
    shard->status = LG_OK;
    lg_tape_constant(shard->tape, fit->point, fit->problem.parameters * fit->k->size);
    /* A rank that is asked to stop says so in the next exchange, and then no rank uses the shards. */
    for (size_t at = 0; at < shard->count && shard->status == LG_OK; at += chunk) {
        if (!lg_fit_alone(fit) && fit->wanted >= LG_FIT_GRADIENT && lg_cancelled(fit->context)) break;
        const size_t rest = shard->count - at, count = rest < chunk ? rest : chunk;
        shard->status = (fit->wanted == LG_FIT_SQUARES ? lg_fit_add_squares
                                                       : chunk_loss)(fit, shard, shard->samples + at, count);
    }
}

/* The result is a power of 2, because 3 shards would leave one of two threads idle. Small shards do not pay:
 * recording takes longer than computing, and products with few rows are slow. A shard of several chunks is
 * recorded once per chunk anyway, so it may be divided. */
size_t lg_fit_pieces(size_t samples, size_t parameters, size_t chunk) {
    static const double least_work = 6e4, least_rows = 24;
    const double rows = (double)samples,
                 most = fmin(rows / least_rows, rows * (double)parameters / least_work);
    const size_t chunks = (samples + chunk - 1) / chunk;
    size_t pieces = 1;
    while (2.0 * (double)pieces <= most && pieces < LG_FIT_PIECES) pieces *= 2;
    while (pieces < chunks && pieces < LG_FIT_PIECES) pieces *= 2;
    return pieces;
}

/* Shard i of n gets the samples [i count/n, (i + 1) count/n), at least one since n <= count. */
static void cut(lg_fit *fit, const uint32_t *samples, size_t count) {
    const size_t most = fit->by_work ? lg_fit_pieces(count, fit->problem.parameters, chunk_of(fit)) : count;
    size_t n = count < fit->options.shards ? count : fit->options.shards;
    if (n > most) n = most;
    for (size_t i = 0; i < n; i++) {
        const size_t start = i * count / n;
        fit->shards[i].samples = samples + start;
        fit->shards[i].count = (i + 1) * count / n - start;
    }
    fit->active = n;
    fit->batch_samples = count;
}

lg_status lg_fit_try_recording(lg_fit *fit) {
    lg_shard *shard = &fit->shards[fit->first];
    if (!fit->plans || fit->first == fit->end) return LG_OK;
    fit->point = fit->state.theta;
    cut(fit, fit->state.order, fit->batch);
    const size_t chunk = chunk_of(fit), count = shard->count < chunk ? shard->count : chunk;
    return lg_fit_run_recording(fit, shard, fit->state.order, count, &fit->plans);
}

/* Text of a number that is not finite; NaN is written without a sign. */
static const char *shown(double x) {
    return isnan(x) ? "NaN" : x > 0 ? "inf" : "-inf";
}

/* Reports why a shard failed. Only the rank that computed the shard has the sentence, so it is shared. */
static lg_status shard_failure(const lg_fit *fit, const char *what, size_t index, lg_error *error) {
    const lg_shard *shard = &fit->shards[index];
    char message[256] = "";
    if (index >= fit->first && index < fit->end)
        (void)snprintf(message, sizeof message, "%s", lg_tape_message(shard->tape));
    if (!lg_fit_alone(fit)) LG_TRY(lg_ranks_share(fit->options.ranks, shard->rank, message, sizeof message));
    return lg_fail(error, shard->status, "%s, shard %zu: %s", what, index,
                   message[0] != '\0' ? message : lg_status_sentence(shard->status));
}

lg_status lg_fit_batch_loss(lg_fit *fit, const uint32_t *samples, size_t count, lg_fit_wanted wanted,
                            const char *what, double *loss, lg_error *error) {
    double sum = 0.0;
    cut(fit, samples, count);
    fit->wanted = wanted;
    LG_TRY(lg_fit_run_shards(fit, shard_task, error));
    for (size_t i = 0; i < fit->active; i++) {
        if (fit->shards[i].status != LG_OK) return shard_failure(fit, what, i, error);
        sum += fit->shards[i].loss;
    }
    if (!isfinite(sum)) return lg_fail(error, LG_NOT_FINITE, "%s: the loss is %s", what, shown(sum));
    *loss = sum;
    return LG_OK;
}

static size_t block_length(const lg_fit *fit, size_t block) {
    const size_t rest = fit->problem.parameters - block * LG_FIT_BLOCK;
    return rest < LG_FIT_BLOCK ? rest : LG_FIT_BLOCK;
}

static void for_blocks(lg_fit *fit, void (*task)(void *user, size_t block)) {
    if (fit->blocks >= PARALLEL_BLOCKS) {
        lg_thread_pool_run(fit->pool, fit->blocks, task, fit);
        return;
    }
    for (size_t i = 0; i < fit->blocks; i++) task(fit, i);
}

static void add_gradients(const lg_fit *fit, void *user, size_t to, size_t from) {
    const size_t block = *(const size_t *)user, at = block * LG_FIT_BLOCK * fit->k->size;
    fit->k->axpy(block_length(fit, block), 1.0, fit->shards[from].gradient + at,
                 fit->shards[to].gradient + at);
}

static void add_matrices(const lg_fit *fit, void *user, size_t to, size_t from) {
    fit->k->axpy(lg_fit_squares_length(fit), 1.0, fit->shards[from].matrix, fit->shards[to].matrix);
}

/* Adds a block of the shards' gradients, and takes the squared norm of the first shard's. */
static void reduce_block(void *user, size_t block) {
    lg_fit *fit = user;
    lg_fit_for_pairs(fit, fit->pairs, add_gradients, &block);
    const char *gradient = fit->shards[0].gradient + block * LG_FIT_BLOCK * fit->k->size;
    fit->partial[block] = fit->k->dot(block_length(fit, block), gradient, gradient);
}

double lg_fit_reduce(lg_fit *fit, lg_pairs pairs) {
    double squared = 0.0;
    fit->pairs = pairs;
    for_blocks(fit, reduce_block);
    if (fit->wanted == LG_FIT_SQUARES) lg_fit_for_pairs(fit, pairs, add_matrices, NULL);
    for (size_t i = 0; i < fit->blocks; i++) squared += fit->partial[i];
    return sqrt(squared);
}

/* Whether a step with a gradient of this norm might overflow. Always true if the norm of the parameters
 * reaches 1e10. */
static bool may_overflow(const lg_fit *fit, double norm, double rate) {
    const double limit = fit->options.dtype == LG_F32 ? 1e15 : 1e150;
    const bool bounded = fit->row->bounded != NULL && fit->row->bounded(&fit->options, rate);
    return !(bounded && norm < limit && fit->largest < 1e10);
}

static void step_block(void *user, size_t block) {
    lg_fit *fit = user;
    const lg_fit_state *s = &fit->state;
    const size_t n = block_length(fit, block), size = fit->k->size, at = block * LG_FIT_BLOCK * size;
    const size_t stride = fit->problem.parameters * size;
    char *const arrays[3] = {(char *)s->theta + at, (char *)s->m + at, (char *)s->v + at};
    for (size_t i = 0; fit->careful && i < 3; i++) memcpy(fit->backup + i * stride + at, arrays[i], n * size);
    fit->row->step(&fit->options, s->step + 1, fit->rate, fit->clip, fit->shards[0].gradient + at, n,
                   arrays[1], arrays[2], arrays[0]);
    fit->partial[block] = 0.0;
    for (size_t i = 0; fit->careful && i < 3; i++)
        if (!fit->k->all_finite(n, arrays[i])) fit->partial[block] = NAN;
}

/* Index of the first element that is not finite, and its value; n if all are finite. */
static size_t first_bad(const lg_fit *fit, const void *x, double *value) {
    const size_t n = fit->problem.parameters;
    for (size_t i = 0; i < n; i++) {
        fit->k->convert_out(1, (const char *)x + i * fit->k->size, value);
        if (!isfinite(*value)) return i;
    }
    return n;
}

lg_status lg_fit_gradient_failure(const lg_fit *fit, const char *what, lg_error *error) {
    double value = 0.0;
    const size_t index = first_bad(fit, fit->shards[0].gradient, &value);
    if (index < fit->problem.parameters)
        return lg_fail(error, LG_NOT_FINITE, "%s: the gradient of parameter %zu is %s", what, index,
                       shown(value));
    return lg_fail(error, LG_NOT_FINITE, "%s: the norm of the gradient%s overflows", what,
                   fit->wanted == LG_FIT_SQUARES ? " or the Gauss-Newton matrix" : "");
}

/* Reports the first value that overflowed, and restores the state before the step. */
static lg_status step_failure(lg_fit *fit, const char *what, lg_error *error) {
    static const char *const names[3] = {"parameter", "first moment of parameter",
                                         "second moment of parameter"};
    void *const arrays[3] = {fit->state.theta, fit->state.m, fit->state.v};
    const size_t bytes = fit->problem.parameters * fit->k->size;
    size_t index = fit->problem.parameters, which = 0;
    double value = 0.0;
    for (size_t i = 0; i < 3; i++) {
        if (index == fit->problem.parameters) {
            index = first_bad(fit, arrays[i], &value);
            which = i;
        }
        memcpy(arrays[i], fit->backup + i * bytes, bytes);
    }
    return lg_fail(error, LG_NOT_FINITE, "%s: the step of %s makes %s %zu %s", what, fit->row->name,
                   names[which], index, shown(value));
}

lg_status lg_fit_step(lg_fit *fit, const uint32_t *samples, size_t count, double rate, double *loss,
                      lg_error *error) {
    char what[96];
    const uint64_t batch = lg_fit_batches(fit, fit->state.position) + 1;
    (void)snprintf(what, sizeof what, "epoch %" PRIu64 ", batch %" PRIu64, fit->state.epoch + 1, batch);
    double value = 0.0;
    fit->row = lg_fit_batches_of(lg_fit_method_now(fit));
    fit->point = fit->state.theta;
    LG_TRY(lg_fit_batch_loss(fit, samples, count, LG_FIT_GRADIENT, what, &value, error));

    double norm = fit->shards[0].bound;
    if (may_overflow(fit, norm, rate)) {
        norm = lg_fit_reduce(fit, LG_PAIRS_REST);
        if (!isfinite(norm)) return lg_fit_gradient_failure(fit, what, error);
    }
    fit->clip = lg_clip_factor(norm, fit->options.clip_norm);
    fit->rate = rate;
    fit->careful = may_overflow(fit, norm * fit->clip, rate);
    for_blocks(fit, step_block);
    for (size_t i = 0; i < fit->blocks; i++)
        if (isnan(fit->partial[i])) return step_failure(fit, what, error);
    *loss = value;
    return LG_OK;
}

/* ---- the loss of all samples ---- */

static lg_status add_chunks(lg_tape *tape, const lg_fit_problem *problem, const double *theta, size_t chunk,
                            uint32_t *samples, double *loss) {
    const size_t all = problem->samples - problem->validation;
    double sum = 0.0, value = 0.0;
    for (size_t first = 0; first < all; first += chunk) {
        const size_t left = all - first, count = left < chunk ? left : chunk;
        for (size_t i = 0; i < count; i++) samples[i] = (uint32_t)(first + i);
        lg_tape_reset(tape);
        lg_var weights, part;
        LG_TRY(lg_fit_record(problem, tape, theta, false, samples, count, all, &weights, &part));
        LG_TRY(lg_read(tape, part, 1, &value));
        sum += value;
    }
    *loss = sum;
    return LG_OK;
}

lg_status lg_fit_problem_loss(const lg_context *context, const lg_fit_problem *problem, const double *theta,
                              double *loss, lg_error *error) {
    LG_NEEDS(error, problem, loss);
    if (problem->parameters > 0) LG_NEEDS(error, theta);
    if (problem->loss == NULL && problem->residuals == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the problem has neither a loss function nor residuals");
    const size_t chunk = problem->chunk > 0 ? problem->chunk : LG_FIT_CHUNK;
    LG_SCRATCH(uint32_t, samples, context, chunk);
    LG_CLEAN(lg_tape_destroy_at) lg_tape *tape = NULL;
    lg_status status = samples != NULL ? lg_tape_create(context, NULL, &tape) : LG_OUT_OF_MEMORY;
    if (status == LG_OK) status = add_chunks(tape, problem, theta, chunk, samples, loss);
    return lg_tape_conclude(tape, status, error);
}

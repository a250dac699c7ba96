/* Training on several ranks. A rank computes a contiguous range of the shards, and adds those sums of the
 * tree that need only its shards. The results go to all ranks, and each rank adds the rest. So all ranks have
 * the same state, with the same bits as one process.
 *
 * Per batch, each rank sends one message to all others: whether it was asked to stop; loss, bound and status
 * of its shards; its sums of gradients; and for sums of squares its sums of matrices and the rows and blocks
 * of its samples. */
#include <inttypes.h>
#include <string.h>

#include "nn/fit_internal.h"

/* ---- the tree of sums ---- */

/* Whether the shards to, ..., to + 2 stride - 1, which the pair with this stride sums up, lie on several
 * ranks. Then all ranks add this pair. */
static bool across(const lg_fit *fit, size_t to, size_t stride) {
    if (lg_fit_alone(fit)) return true;
    const size_t last = to + 2 * stride < fit->used ? to + 2 * stride - 1 : fit->used - 1;
    return fit->shards[to].rank != fit->shards[last].rank;
}

void lg_fit_for_pairs(const lg_fit *fit, lg_pairs pairs, lg_fit_add add, void *user) {
    for (size_t stride = 1; stride < fit->active; stride *= 2)
        for (size_t i = 0; i + stride < fit->active; i += 2 * stride) {
            const bool rest = across(fit, i, stride);
            if (pairs == LG_PAIRS_REST ? rest : !rest && fit->shards[i].rank == fit->options.ranks->rank)
                add(fit, user, i, i + stride);
        }
}

/* Whether the shard's sum must be sent, because its rank cannot add it into another shard alone. */
static bool is_sent(const lg_fit *fit, size_t shard) {
    const size_t stride = shard & (~shard + 1);
    return shard == 0 || across(fit, shard - stride, stride);
}

bool lg_fit_holds(const lg_fit *fit, size_t shard) {
    return lg_fit_alone(fit) || (shard >= fit->first && shard < fit->end) || is_sent(fit, shard);
}

/* ---- exchanges ---- */

static void count(lg_fit *fit, const size_t *bytes, double begin) {
    fit->cost.exchange_seconds += lg_seconds() - begin;
    fit->cost.exchanges++;
    for (uint32_t r = 0; r < fit->given->count; r++) fit->cost.bytes += bytes[r];
}

static lg_status counted_gather(void *user, void *all, const size_t *bytes) {
    lg_fit *fit = user;
    const double begin = lg_seconds();
    const lg_status status = fit->given->gather(fit->given->user, all, bytes);
    count(fit, bytes, begin);
    return status;
}

/* This exchange is not counted in fit->cost, because it is part of a checkpoint, not of an epoch. */
static lg_status collect(void *user, const void *mine, void *all, const size_t *bytes) {
    const lg_fit *fit = user;
    return fit->given->collect(fit->given->user, mine, all, bytes);
}

static const char *reason(void *user) {
    const lg_ranks *given = ((const lg_fit *)user)->given;
    return given->reason != NULL ? given->reason(given->user) : NULL;
}

lg_status lg_fit_ranks_create(lg_fit *fit) {
    const lg_ranks *ranks = fit->options.ranks;
    fit->end = fit->used;
    if (ranks == NULL) return LG_OK;
    fit->given = ranks;
    fit->counted = (lg_ranks){sizeof *ranks, ranks->rank, ranks->count, fit, counted_gather, collect, reason};
    fit->options.ranks = &fit->counted;
    for (uint32_t r = 0; r < ranks->count; r++) {
        size_t first, end;
        lg_ranks_part(r, ranks->count, fit->used, &first, &end);
        for (size_t i = first; i < end; i++) fit->shards[i].rank = r;
        if (r == ranks->rank) fit->first = first, fit->end = end;
    }
    return LG_ALLOC_ALL(fit->context, LG_ARRAY(fit->message_bytes, ranks->count),
                        LG_ARRAY(fit->stops, ranks->count));
}

void lg_fit_ranks_destroy(lg_fit *fit) {
    LG_FREE_ALL(fit->context, fit->message, fit->message_bytes, fit->stops);
}

/* ---- messages ---- */

/* A message is a list of arrays, which list_message counts, packs or unpacks one after the other. */
typedef struct message {
    enum { COUNT, PACK, UNPACK } what;
    char *begin; /* not read to COUNT */
    size_t length;
} message;

static void each(message *m, void *data, size_t bytes) {
    if (m->what == PACK) memcpy(m->begin + m->length, data, bytes);
    if (m->what == UNPACK) memcpy(data, m->begin + m->length, bytes);
    m->length += bytes;
}

static void list_shard(lg_fit *fit, size_t index, message *m) {
    lg_shard *shard = &fit->shards[index];
    each(m, &shard->loss, sizeof shard->loss);
    each(m, &shard->bound, sizeof shard->bound);
    each(m, &shard->status, sizeof shard->status);
    if (is_sent(fit, index) && fit->wanted >= LG_FIT_GRADIENT)
        each(m, shard->gradient, fit->problem.parameters * fit->k->size);
    if (fit->wanted < LG_FIT_SQUARES) return;
    if (is_sent(fit, index)) each(m, shard->matrix, lg_fit_squares_length(fit) * sizeof(double));
    for (size_t i = 0; fit->problem.own > 0 && i < shard->count; i++) {
        const lg_fit_own own = lg_fit_own_of(fit, shard->samples[i]);
        each(m, own.rows, own.rows_length * sizeof(double));
        each(m, own.block, own.block_length * sizeof(double));
    }
}

/* The message of rank `from`. Returns its length in bytes. */
static size_t list_message(lg_fit *fit, uint32_t from, message m) {
    each(&m, &fit->stops[from], sizeof *fit->stops);
    for (size_t i = 0; i < fit->active; i++)
        if (fit->shards[i].rank == from) list_shard(fit, i, &m);
    return m.length;
}

/* Computes the lengths of all messages, and allocates room for them. All ranks need room for the same number
 * of bytes, so they allocate at the same time, and agree about it. */
static lg_status make_room(lg_fit *fit, lg_error *error) {
    size_t total = 0;
    for (uint32_t r = 0; r < fit->options.ranks->count; r++) {
        fit->message_bytes[r] = list_message(fit, r, (message){.what = COUNT});
        total += fit->message_bytes[r];
    }
    if (total <= fit->message_room) return LG_OK;
    lg_free(fit->context, fit->message);
    fit->message = lg_alloc(fit->context, total, 1);
    const lg_status made =
        fit->message != NULL ? LG_OK
                             : lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the exchange between %u ranks",
                                       fit->options.ranks->count);
    const lg_status status = lg_fit_agree(fit, made, error);
    fit->message_room = status == LG_OK ? total : 0;
    return status;
}

static lg_status exchange(lg_fit *fit, lg_error *error) {
    const lg_ranks *ranks = fit->options.ranks;
    fit->stops[ranks->rank] = fit->wanted >= LG_FIT_GRADIENT && lg_cancelled(fit->context);
    LG_TRY(make_room(fit, error));
    char *at = fit->message;
    for (uint32_t r = 0; r < ranks->rank; r++) at += fit->message_bytes[r];
    (void)list_message(fit, ranks->rank, (message){.what = PACK, .begin = at});
    LG_TRY(ranks->gather(ranks->user, fit->message, fit->message_bytes));
    at = fit->message;
    uint32_t stopped = 0;
    for (uint32_t r = 0; r < ranks->count; r++) {
        if (r != ranks->rank) (void)list_message(fit, r, (message){.what = UNPACK, .begin = at});
        at += fit->message_bytes[r];
        stopped |= fit->stops[r];
    }
    return stopped != 0 ? lg_fit_cancelled(fit, error) : LG_OK;
}

/* ---- running the shards of a batch ---- */

typedef struct work {
    void (*task)(void *user, size_t shard);
    lg_fit *fit;
} work;

static void own_task(void *user, size_t index) {
    const work *w = user;
    w->task(w->fit, w->fit->first + index);
}

lg_status lg_fit_run_shards(lg_fit *fit, void (*task)(void *user, size_t shard), lg_error *error) {
    work w = {task, fit};
    const size_t end = fit->end < fit->active ? fit->end : fit->active;
    const double begin = lg_seconds();
    if (end > fit->first) lg_thread_pool_run(fit->pool, end - fit->first, own_task, &w);
    fit->cost.shard_seconds += lg_seconds() - begin;
    if (lg_fit_alone(fit)) return LG_OK;
    if (fit->wanted >= LG_FIT_GRADIENT) (void)lg_fit_reduce(fit, LG_PAIRS_HERE);
    return exchange(fit, error);
}

/* ---- agreement ---- */

lg_status lg_fit_agree(const lg_fit *fit, lg_status status, lg_error *error) {
    return lg_fit_alone(fit) ? status : lg_ranks_agree(fit->options.ranks, status, error);
}

lg_status lg_fit_share_seconds(const lg_fit *fit, double *seconds) {
    return lg_fit_alone(fit) ? LG_OK : lg_ranks_share(fit->options.ranks, 0, seconds, sizeof *seconds);
}

lg_status lg_fit_cancelled(const lg_fit *fit, lg_error *error) {
    return lg_fail(error, LG_CANCELLED, "stopped in epoch %" PRIu64 " after %" PRIu64 " of %zu samples",
                   fit->state.epoch + 1, fit->state.position, fit->training);
}

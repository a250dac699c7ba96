/* The training loop: its state, which is saved (lg_fit_state), and its working memory. */
#ifndef LG_FIT_INTERNAL_H
#define LG_FIT_INTERNAL_H

#include "kernels/kernels.h"
#include "core/core.h"
#include "liegrad/minimise.h"
#include "liegrad/nn.h"
#include "liegrad/ranks.h"

/* Everything that the next step depends on, except the hyperparameters. One allocation each. */
typedef struct lg_fit_state {
    void *memory;
    void *theta, *m, *v, *best; /* (parameters), the fit's type */
    uint32_t *order;            /* permutation of all samples: training part, then validation part */
    double *history[LG_FIT_SERIES_COUNT];
    lg_rng rng;
    lg_minimiser *minimiser;     /* of the present phase, NULL before its first evaluation and for Adam */
    uint64_t step;               /* Adam steps done */
    uint64_t adam_epochs;        /* finished */
    uint64_t phase, phase_start; /* the present one, and the epochs finished before it */
    uint64_t epoch;              /* epochs finished */
    uint64_t position;           /* training samples used in the unfinished epoch; on a batch boundary */
    uint64_t best_epoch;         /* counted from 1; 0 before the first */
    double noise;                /* variance taken for that of the data; 0: none */
    double plateau;              /* loss at iteration plateau_start of the minimiser */
    uint64_t plateau_start;
    bool open;           /* the unfinished epoch has drawn its order */
    uint64_t restarts;   /* from other parameters, because the model was dead */
    double lost_seconds; /* of the epochs before the last restart */
    double running_loss; /* sum of batch loss times samples in the unfinished epoch */
    double running_seconds;
} lg_fit_state;

typedef struct lg_shard {
    uint32_t rank;  /* that computes it */
    lg_tape *tape;  /* NULL: another rank's, or never needed */
    char *gradient; /* (parameters); NULL where it stays on another rank */
    const uint32_t *samples;
    size_t count;
    double loss;
    double bound; /* of the gradient's norm; infinite where none is known */
    lg_status status;
    /* Of sums of squares alone: the Gauss-Newton matrix (fit_squares.c); room for a Jacobian. */
    double *matrix, *jacobian;
    size_t rows;
} lg_shard;

struct lg_fit {
    const lg_context *context;
    lg_fit_problem problem;
    lg_fit_options options;
    const lg_kernels *k;
    size_t training, batch; /* samples of the training part; of a full batch */
    lg_fit_state state;
    double spent;      /* seconds of all finished epochs, those before a restart included */
    const void *point; /* where loss and gradients are taken */
    lg_thread_pool *pool;
    lg_shard *shards;
    bool by_work;      /* options.shards was 0: fewer for small batches */
    size_t used;       /* shards of a full batch; the others are never needed */
    size_t first, end; /* of them, this rank's */
    char *message;     /* to and from other ranks (message_room bytes); how long each rank's is */
    size_t message_room, *message_bytes;
    uint32_t *stops;  /* (ranks): whether it was asked to stop */
    lg_ranks counted; /* those of the options, with what they cost */
    const lg_ranks *given;
    lg_fit_cost cost;
    /* The present batch: pieces in use, its samples, whether gradients and matrices are wanted; then the data
     * of the step. */
    size_t active, batch_samples;
    bool with_gradient, with_squares;
    const struct lg_fit_batches_row *row; /* the method of this step */
    double clip, rate;
    size_t blocks;    /* of LG_FIT_BLOCK parameters: the unit of the reduction and of the step */
    double *partial;  /* (blocks): squared norm of a block's gradient */
    bool *overflowed; /* (blocks): the step gave a value that is not finite */
    double largest;   /* norm of the parameters at the start of the epoch: bounds each of them */
    bool careful;     /* this step might overflow: keep a backup and look at the result */
    char *backup;     /* theta, m, v before a careful step */
    double *scratch;  /* (epochs) */
    double *revived;  /* (parameters); NULL without restarts */
};

#define LG_FIT_BLOCK  4096
#define LG_FIT_PIECES 4 /* of a batch that is cut by its work */
/* How many pieces those are, of chunks of at most `chunk` samples. */
size_t lg_fit_pieces(size_t samples, size_t parameters, size_t chunk);

lg_status lg_fit_state_create(const lg_fit *fit, lg_fit_state *out);
void lg_fit_state_destroy(const lg_fit *fit, lg_fit_state *state);

/* Loss of a batch at the present parameters, summed over shards in order; with gradients in the shards if
 * wanted. The sentence of an error uses `what`. */
lg_status lg_fit_batch_loss(lg_fit *fit, const uint32_t *samples, size_t count, bool with_gradient,
                            const char *what, double *loss, lg_error *error);
/* Cuts the samples into pieces, one a shard. */
void lg_fit_cut(lg_fit *fit, const uint32_t *samples, size_t count);
/* Adds `count` samples to the shard's sums. */
typedef lg_status (*lg_fit_chunk)(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count);
/* Adds a shard's samples a chunk at a time, its loss from 0: a chunk's values stay in the cache, and memory
 * is bounded. */
lg_status lg_fit_chunks(const lg_fit *fit, lg_shard *shard, lg_fit_chunk add);
/* The sum of the shards' losses; the failure of a shard, or a sum that is not finite. */
lg_status lg_fit_sum_losses(const lg_fit *fit, const char *what, double *loss, lg_error *error);
/* Loss, gradient and matrix of all training samples by residuals; the latter in the first shard. */
lg_status lg_fit_squares(lg_fit *fit, const char *what, double *value, lg_error *error);
/* Adds `decay` and the problem's own decay to the matrix's diagonal, `prior` to its first `weights` numbers.
 */
void lg_fit_add_diagonal(lg_fit *fit, size_t weights, double prior, double decay);
/* Adds the gradients of all shards into that of the first one and returns its norm. */
double lg_fit_reduce(lg_fit *fit);
/* The pairs of the tree (0 + 1) + (2 + 3) ... by which arrays of shards are added into the first one's, in
 * their order: `from` is to be added into `to`. LG_PAIRS_HERE: those that this rank adds alone, before the
 * exchange; LG_PAIRS_REST: those that all ranks add after it, without ranks all of them. */
typedef enum lg_pairs { LG_PAIRS_HERE, LG_PAIRS_REST } lg_pairs;
typedef void (*lg_fit_add)(const lg_fit *fit, void *user, size_t to, size_t from);
void lg_fit_for_pairs(const lg_fit *fit, lg_pairs pairs, lg_fit_add add, void *user);
/* Brings a gradient of this norm to at most `limit`: min(1, limit/norm), or 1 for limit 0. */
double lg_clip_factor(double norm, double limit);
/* What a gradient is not finite in. */
lg_status lg_fit_gradient_failure(const lg_fit *fit, const char *what, lg_error *error);

/* Of the matrix of sums of squares: the length of P, which is added over shards, and what is a sample's own
 * in the first shard's matrix, its rows C and its block B. */
typedef struct lg_fit_own {
    double *rows, *block;
    size_t rows_length, block_length;
} lg_fit_own;
size_t lg_fit_squares_length(const lg_fit *fit);
lg_fit_own lg_fit_own_of(const lg_fit *fit, uint32_t sample);

/* ---- ranks (fit_ranks.c) ---- */

static inline bool lg_fit_alone(const lg_fit *fit) {
    return fit->options.ranks == NULL;
}
/* Divides the shards over ranks. */
lg_status lg_fit_ranks_create(lg_fit *fit);
void lg_fit_ranks_destroy(lg_fit *fit);
/* The rank computes the shard, or gets a sum from it. */
bool lg_fit_holds(const lg_fit *fit, size_t shard);
/* Runs task(user, i) for i < active, in threads; then with ranks the exchange: afterwards each has the loss
 * and status of all shards, and, if wanted, what LG_PAIRS_REST adds. LG_CANCELLED: a rank was asked to
 * stop. */
lg_status lg_fit_run_shards(lg_fit *fit, void (*task)(void *user, size_t shard), lg_error *error);
/* Before the exchange: adds the pairs of LG_PAIRS_HERE. */
void lg_fit_reduce_here(lg_fit *fit);
void lg_fit_squares_here(lg_fit *fit);
/* The failure of one rank becomes that of all. */
lg_status lg_fit_agree(const lg_fit *fit, lg_status status, lg_error *error);
/* Of rank 0, on all ranks. */
lg_status lg_fit_share_seconds(const lg_fit *fit, double *seconds);
lg_status lg_fit_cancelled(const lg_fit *fit, lg_error *error);

/* ---- methods (fit_methods.c) ---- */

/* A method that takes batches. It has two numbers for each parameter, m and v >= 0, which start from zero and
 * are saved; they stay through all phases. */
typedef struct lg_fit_batches_row {
    const char *name;
    /* Step number `step` = 1, 2, ... of n parameters of the type options->dtype. The gradient counts `clip`
     * times, the learning rate is options->adam.lr times `rate`. */
    void (*step)(const lg_fit_options *options, uint64_t step, double rate, double clip, const void *gradient,
                 size_t n, void *m, void *v, void *theta);
    /* A step of moderate gradients changes no parameter by more than 1e10: it need not be looked at for
     * overflow. NULL: it must be. */
    bool (*bounded)(const lg_fit_options *options, double rate);
} lg_fit_batches_row;

/* The row of a method that takes batches; NULL of another one. */
const lg_fit_batches_row *lg_fit_batches_of(lg_fit_method method);
/* The present phase. */
lg_fit_method lg_fit_method_of(const lg_fit *fit, uint64_t phase);
/* Options for a minimiser of a phase without batches. */
lg_minimise_options lg_fit_minimise_options(const lg_fit *fit, uint64_t phase);
/* One evaluation of the loss of all training samples; *moved: theta is another point than before. */
lg_status lg_fit_evaluate(lg_fit *fit, bool *moved, lg_error *error);
/* After an epoch: goes to the next phase where the present one is over. */
void lg_fit_next_phase(lg_fit *fit);
lg_status lg_fit_check_plan(const lg_fit_problem *problem, const lg_fit_options *options, lg_error *error);

/* One step on a batch; on failure theta, m, v are as before. */
lg_status lg_fit_step(lg_fit *fit, const uint32_t *samples, size_t count, double rate, double *loss,
                      lg_error *error);

/* Batches in the first `samples` samples of an epoch. */
static inline uint64_t lg_fit_batches(const lg_fit *fit, uint64_t samples) {
    return (samples + fit->batch - 1) / fit->batch;
}

/* The loss that decides which epoch is best, for a finished epoch counted from 1. */
static inline double lg_fit_criterion(const lg_fit *fit, uint64_t epoch) {
    const lg_fit_series series = fit->training < fit->problem.samples ? LG_FIT_VALIDATION : LG_FIT_LOSS;
    return fit->state.history[series][epoch - 1];
}

/* The parameters (`parameters` numbers) as they are now, whatever the best epoch was. */
void lg_fit_current_parameters(const lg_fit *fit, double *theta);

#endif

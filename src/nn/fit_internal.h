/* The training loop: its state (lg_fit_state), as fit_archive.c saves it, and its working memory. */
#ifndef LG_FIT_INTERNAL_H
#define LG_FIT_INTERNAL_H

#include "kernels/kernels.h"
#include "liegrad/minimise.h"
#include "nn/fit_errors.h"

/* Everything that the next step depends on, except the hyperparameters. `memory` is one allocation that holds
 * all arrays. */
typedef struct lg_fit_state {
    void *memory;
    void *theta, *m, *v, *best; /* (parameters) each, in the fit's type */
    uint32_t *order;            /* permutation of all samples: training part, then validation part */
    double *history[LG_FIT_SERIES_COUNT];
    lg_rng rng;
    /* of the current phase; NULL before its first evaluation, and where the phase takes batches */
    lg_minimiser *minimiser;
    uint64_t step;               /* Adam steps done */
    uint64_t adam_epochs;        /* epochs finished by methods that take batches */
    uint64_t phase, phase_start; /* current phase; epochs that were finished before it */
    uint64_t epoch;              /* epochs finished */
    uint64_t position;           /* training samples used in the unfinished epoch; on a batch boundary */
    uint64_t best_epoch;         /* counted from 1; 0: no epoch is finished */
    double noise;                /* estimated variance of the noise in the data; 0: the prior is off */
    double plateau;              /* the minimiser's loss at iteration plateau_start */
    uint64_t plateau_start;
    uint64_t open;       /* 1: the order of the unfinished epoch is drawn; else 0 */
    uint64_t restarts;   /* how often a dead model was given other parameters */
    double lost_seconds; /* of all epochs before the last restart */
    double running_loss; /* sum over the batches of the unfinished epoch: loss times samples */
    double running_seconds;
} lg_fit_state;

typedef struct lg_fit_recording lg_fit_recording;

/* What is computed for a batch: the loss; the loss and its gradient; for sums of squares also the
 * Gauss-Newton matrix. */
typedef enum lg_fit_wanted { LG_FIT_VALUE, LG_FIT_GRADIENT, LG_FIT_SQUARES } lg_fit_wanted;
/* In each pair of shards one is added to the other (lg_fit_for_pairs). LG_PAIRS_HERE: the pairs that this
 * rank adds alone, before the exchange. LG_PAIRS_REST: the pairs that every rank adds after it; without
 * ranks, all pairs. */
typedef enum lg_pairs { LG_PAIRS_HERE, LG_PAIRS_REST } lg_pairs;

typedef struct lg_shard {
    uint32_t rank;  /* the rank that computes this shard */
    lg_tape *tape;  /* NULL: another rank computes the shard, or it is never used */
    char *gradient; /* (parameters); NULL: its sum stays on another rank */
    const uint32_t *samples;
    size_t count;
    double loss;
    double bound; /* upper bound of the gradient's norm; infinite if unknown */
    lg_status status;
    /* Only for sums of squares: the Gauss-Newton matrix, and memory for a Jacobian of `rows` rows. */
    double *matrix, *jacobian;
    size_t rows;
    /* Array of LG_FIT_RECORDINGS recordings (fit_recording.c). NULL until the first recording is made. */
    lg_fit_recording *recordings;
    size_t next; /* counts the recordings made; recording number next % LG_FIT_RECORDINGS is replaced next */
    void *part;  /* (parameters): gradient of a chunk */
} lg_shard;

struct lg_fit {
    const lg_context *context;
    lg_fit_problem problem;
    lg_fit_options options;
    const lg_kernels *k;
    size_t training, batch; /* samples of the training part; samples of a full batch */
    lg_fit_state state;
    double spent;      /* seconds of all finished epochs, also of epochs before a restart */
    const void *point; /* parameters at which loss and gradients are taken, in the fit's type */
    lg_thread_pool *pool;
    lg_shard *shards;
    bool plans;        /* losses and gradients are computed by plans where they can be */
    bool by_work;      /* options.shards was 0: small batches have fewer shards */
    size_t used;       /* number of shards that can ever be in use: at most one per training sample */
    size_t first, end; /* this rank's shards: first, ..., end - 1 */
    /* message: the messages of all ranks, one after the other, in message_room bytes; message_bytes (ranks):
     * the length of each message */
    char *message;
    size_t message_room, *message_bytes;
    uint32_t *stops; /* (ranks): 1 if the rank was asked to stop */
    /* options.ranks points to this wrapper, which counts into `cost`; `given` are the caller's ranks */
    lg_ranks counted;
    const lg_ranks *given;
    lg_fit_cost cost;
    /* The current batch: shards in use, samples, what is computed for it. Then the data of the step. */
    size_t active, batch_samples;
    lg_fit_wanted wanted;
    lg_pairs pairs;                       /* the pairs that are added now */
    const struct lg_fit_batches_row *row; /* the method of this step */
    double clip, rate;
    /* number of blocks of LG_FIT_BLOCK parameters, by which gradients are summed and steps are taken */
    size_t blocks;
    /* (blocks): squared norm of the block's part of the gradient; NaN if the step made a parameter of the
     * block infinite or NaN */
    double *partial;
    double largest;  /* norm of all parameters at the start of the epoch; no parameter is larger */
    bool careful;    /* this step might overflow: keep a backup and check the result */
    char *backup;    /* theta, m and v before a careful step */
    double *scratch; /* (epochs): to compute the median of the seconds */
    double *revived; /* (parameters): for problem.revive; NULL without restarts */
};

#define LG_FIT_BLOCK  4096
#define LG_FIT_PIECES 4 /* most shards of a batch that is cut by its work (lg_fit_options.shards = 0) */
/* How many shards a batch of `samples` has if it is cut by its work. A tape takes at most `chunk` samples. */
size_t lg_fit_pieces(size_t samples, size_t parameters, size_t chunk);

lg_status lg_fit_state_create(const lg_fit *fit, lg_fit_state *out);
void lg_fit_state_destroy(const lg_fit *fit, lg_fit_state *state);

/* Computes the loss of a batch at fit->point. Each shard gets a contiguous piece of the batch; their losses
 * are added in order. The shards then also have the gradients or matrices that `wanted` names. Error messages
 * begin with `what`. */
lg_status lg_fit_batch_loss(lg_fit *fit, const uint32_t *samples, size_t count, lg_fit_wanted wanted,
                            const char *what, double *loss, lg_error *error);
/* Finds out whether a plan can compute the loss of the first chunk. If not, the tape computes all losses. */
lg_status lg_fit_try_recording(lg_fit *fit);
/* ---- losses as plans (fit_recording.c) ---- */

/* Plans that a shard keeps: for full chunks, for the last chunks of shards and batches, and for recordings
 * that differ. */
#define LG_FIT_RECORDINGS 16
/* Records the problem's loss of the samples at the parameters `point`, which are of the tape's type, or with
 * `residuals` these. */
lg_status lg_fit_record(const lg_fit_problem *problem, lg_tape *tape, const void *point, bool residuals,
                        const uint32_t *samples, size_t count, size_t batch, lg_var *theta, lg_var *out);
/* Adds loss and gradient of the samples to the shard's, by a plan (lg_fit_problem.repeats). *done = false: a
 * plan is not possible for these samples, and nothing has been added. */
lg_status lg_fit_run_recording(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count,
                               bool *done);
void lg_fit_recordings_destroy(const lg_fit *fit, lg_shard *shard);
size_t lg_fit_recordings_size(const lg_shard *shard, size_t *plans); /* bytes; number of plans */

/* ---- sums of squares (fit_squares.c) ---- */

/* Loss, gradient and Gauss-Newton matrix of all training samples, from the residuals. Gradient and matrix are
 * in the first shard. */
lg_status lg_fit_squares(lg_fit *fit, const char *what, double *value, lg_error *error);
/* Adds |r|^2, J^T r and J^T J of `count` samples to the shard's loss, gradient and matrix. The first chunk
 * of a shard overwrites them. */
lg_status lg_fit_add_squares(const lg_fit *fit, lg_shard *shard, const uint32_t *samples, size_t count);
/* Adds `decay` and problem.decay to the matrix's diagonal, and `prior` to its first `weights` elements. */
void lg_fit_add_diagonal(lg_fit *fit, size_t weights, double prior, double decay);
/* Adds the gradients of the shards, and their matrices if they are wanted, pair by pair; after LG_PAIRS_REST
 * the first shard has the sums. Returns the norm of its gradient. */
double lg_fit_reduce(lg_fit *fit, lg_pairs pairs);
/* Calls add(fit, user, to, from) for all pairs of the tree (0 + 1) + (2 + 3) ..., in order: it adds shard
 * `from` into shard `to`, so that shard 0 gets the sum of all. */
typedef void (*lg_fit_add)(const lg_fit *fit, void *user, size_t to, size_t from);
void lg_fit_for_pairs(const lg_fit *fit, lg_pairs pairs, lg_fit_add add, void *user);
/* The factor min(1, limit/norm), which shortens a gradient to at most `limit`; 1 for limit 0. */
double lg_clip_factor(double norm, double limit);
/* Fails with a sentence that names the element of the gradient that is not finite. */
lg_status lg_fit_gradient_failure(const lg_fit *fit, const char *what, lg_error *error);

/* The parts of the first shard's Gauss-Newton matrix that belong to one sample: its rows C and its block B.
 * The part P of the shared parameters, with lg_fit_squares_length numbers, is summed over the shards
 * instead. */
typedef struct lg_fit_own {
    double *rows, *block;
    size_t rows_length, block_length;
} lg_fit_own;
size_t lg_fit_squares_length(const lg_fit *fit);
lg_fit_own lg_fit_own_of(const lg_fit *fit, uint32_t sample);

/* ---- parameters of a program as one vector (fit_program.c) ---- */

/* Copies them to theta, unless it is NULL; returns their number. lg_fit_give copies them back. */
size_t lg_fit_take(const lg_program *program, double *theta);
lg_status lg_fit_give(lg_program *program, const double *theta);
/* Records each parameter, in its shape, as a part of theta. */
void lg_fit_slice(lg_tape *tape, const lg_program *program, lg_var theta, lg_var *parameters);

/* ---- ranks (fit_ranks.c) ---- */

static inline bool lg_fit_alone(const lg_fit *fit) {
    return fit->options.ranks == NULL;
}
/* Divides the shards over the ranks, and wraps options.ranks to count exchanges. */
lg_status lg_fit_ranks_create(lg_fit *fit);
void lg_fit_ranks_destroy(lg_fit *fit);
/* Whether the rank needs gradient and matrix of the shard: it computes the shard, or receives its sum. */
bool lg_fit_holds(const lg_fit *fit, size_t shard);
/* Runs task(user, i) in threads for this rank's shards among the first `active`. With ranks an exchange
 * follows: then every rank has the losses and statuses of all shards and, if wanted, the sums that
 * LG_PAIRS_REST adds up. Returns LG_CANCELLED if any rank was asked to stop. */
lg_status lg_fit_run_shards(lg_fit *fit, void (*task)(void *user, size_t shard), lg_error *error);
/* If one rank failed, all ranks return its failure. */
lg_status lg_fit_agree(const lg_fit *fit, lg_status status, lg_error *error);
/* *seconds becomes rank 0's value on all ranks. */
lg_status lg_fit_share_seconds(const lg_fit *fit, double *seconds);
lg_status lg_fit_cancelled(const lg_fit *fit, lg_error *error);

/* ---- methods (fit_methods.c) ---- */

/* A method that takes batches. It keeps two numbers per parameter, m and v >= 0, which start from zero, are
 * saved, and stay through all phases. */
typedef struct lg_fit_batches_row {
    const char *name;
    /* Takes step number `step` = 1, 2, ... on n parameters of the type options->dtype. The gradient is
     * multiplied by `clip`, and the learning rate is options->adam.lr times `rate`. */
    void (*step)(const lg_fit_options *options, uint64_t step, double rate, double clip, const void *gradient,
                 size_t n, void *m, void *v, void *theta);
    /* Whether a step with a gradient of moderate size changes no parameter by more than 1e10. Then the result
     * is not checked for overflow. NULL: it is always checked. */
    bool (*bounded)(const lg_fit_options *options, double rate);
} lg_fit_batches_row;

/* The row of a method that takes batches; NULL for any other method. */
const lg_fit_batches_row *lg_fit_batches_of(lg_fit_method method);
/* The method of a phase of the plan. */
lg_fit_method lg_fit_method_of(const lg_fit *fit, uint64_t phase);
/* Makes the minimiser of the state's phase, which starts from its theta. */
lg_status lg_fit_create_minimiser(const lg_fit *fit, lg_fit_state *s, lg_error *error);
/* Options of this minimiser, for a phase without batches. */
lg_minimise_options lg_fit_minimise_options(const lg_fit *fit, uint64_t phase);
/* Evaluates the loss of all training samples and tells the minimiser. *moved: whether theta has changed. */
lg_status lg_fit_evaluate(lg_fit *fit, bool *moved, lg_error *error);
/* Called after an epoch: begins the next phase if the current one is over. */
void lg_fit_next_phase(lg_fit *fit);
lg_status lg_fit_check_plan(const lg_fit_problem *problem, const lg_fit_options *options, lg_error *error);

/* Takes one step on a batch. On failure theta, m and v are as before. */
lg_status lg_fit_step(lg_fit *fit, const uint32_t *samples, size_t count, double rate, double *loss,
                      lg_error *error);

/* Number of batches in the first `samples` samples of an epoch. */
static inline uint64_t lg_fit_batches(const lg_fit *fit, uint64_t samples) {
    return (samples + fit->batch - 1) / fit->batch;
}

/* The loss that decides which epoch is best: the validation loss if there is one. `epoch` counts from 1. */
static inline double lg_fit_criterion(const lg_fit *fit, uint64_t epoch) {
    const lg_fit_series series = fit->training < fit->problem.samples ? LG_FIT_VALIDATION : LG_FIT_LOSS;
    return fit->state.history[series][epoch - 1];
}

/* The current parameters (`parameters` numbers), even if an earlier epoch was better. */
void lg_fit_current_parameters(const lg_fit *fit, double *theta);

#endif

/* Training: Adam, learning rate schedules, the training loop lg_fit with its methods, and training of programs.
 */
#ifndef LIEGRAD_FIT_H
#define LIEGRAD_FIT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "liegrad/core.h"
#include "liegrad/tape.h"

LG_BEGIN_DECLS

typedef struct lg_program lg_program;

/* ---- Adam (Kingma & Ba 2015; decoupled decay: Loshchilov & Hutter 2019) ---- */

typedef struct lg_adam_options {
    double lr;           /* 1e-3, > 0 */
    double beta1, beta2; /* 0.9, 0.999, in [0, 1) */
    double eps;          /* 1e-8, > 0 */
    double weight_decay; /* 0, >= 0 */
    bool
        decoupled; /* false: gradient + decay theta (L2); true: theta - lr decay theta, apart from the step */
} lg_adam_options;
LG_API void lg_adam_options_init(lg_adam_options *options);

/* Step number `step` = 1, 2, ... on n elements of `dtype`, elementwise:
 *   g = clip gradient [+ decay theta], m = beta1 m + (1 - beta1) g, v = beta2 v + (1 - beta2) g^2,
 *   theta = theta [- lr decay theta] - lr (m/(1 - beta1^step)) / (sqrt(v/(1 - beta2^step)) + eps).
 * lr is the options' lr times `rate`. m and v start from zero. */
LG_API void lg_adam_step(const lg_adam_options *options, lg_dtype dtype, uint64_t step, double rate,
                         double clip, const void *gradient, size_t n, void *m, void *v, void *theta);

/* ---- schedules ---- */

typedef enum lg_schedule_kind { LG_SCHEDULE_CONSTANT, LG_SCHEDULE_STEP, LG_SCHEDULE_COSINE } lg_schedule_kind;
#define LG_SCHEDULE_COUNT 3
LG_API const char *lg_schedule_name(lg_schedule_kind kind); /* "constant", "step", "cosine" */

typedef struct lg_schedule {
    lg_schedule_kind kind;
    uint64_t every; /* step: epochs between two reductions, >= 1 */
    double gamma;   /* step: factor of a reduction, > 0 */
    double floor;   /* cosine: last factor, in [0, 1] */
} lg_schedule;

/* The factor on Adam's lr in epoch 0, 1, ..., epochs - 1:
 *   constant  1
 *   step      gamma^floor(epoch/every), floor() rounding down
 *   cosine    floor + (1 - floor) (1 + cos(pi epoch/epochs))/2, and floor from `epochs` on, where floor is
 *             the schedule's */
LG_API double lg_schedule_rate(const lg_schedule *schedule, uint64_t epoch, uint64_t epochs);

/* ---- training ---- */

/* Most samples of a shard on its tape at once; larger shards are cut into pieces of this size. */
#define LG_FIT_CHUNK 128

/* The learning problem. The fit borrows it and everything that it points to. */
typedef struct lg_fit_problem {
    size_t parameters; /* length of theta */
    size_t samples;    /* < 2^32 */
    /* Builds on the tape the part of the batch loss that belongs to `count` >= 1 samples, as a variable with
     * one element: the parts of a batch add up to the loss of the batch, which has `batch` samples (a mean is
     * thus a sum divided by `batch`). theta: flat vector (parameters) of the tape's type. Called by several
     * threads at once, each with its own tape; must be a pure function of its arguments. A status other than
     * LG_OK, or the tape's, stops the fit. */
    lg_status (*loss)(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                      size_t batch, lg_var *loss);
    void *user;
    size_t validation; /* this many samples at the end are the validation part; 0: no such part. Otherwise
                        * lg_fit_options.validation, which draws one at random, must be 0 */
    /* NULL, or the loss as a sum of squares: records r of the samples, of any shape, so that the sum of r_i^2
     * is what `loss` gives. For LG_FIT_LM. */
    lg_status (*residuals)(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *r);
    /* So many numbers at the end of theta belong to sample 0, as many to sample 1, ...: the residuals of a
     * sample, a row of r (count, ...), depend on the numbers before these and on its own. LG_FIT_LM then
     * takes one forward sweep for number k of all samples together. */
    size_t own;
    /* NULL, or what LG_FIT_LM takes in place of forward sweeps over `residuals`: r (count rows) and its
     * Jacobian J (count rows, columns), columns for the parameters that all samples share, then for the
     * sample's own ones, at `theta`. *loss, J^T r and J^T J are those of `residuals`; what is normal to all
     * columns may be left out of r. The tape is for work. */
    lg_status (*linearise)(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                           size_t count, size_t batch, double *loss, double *r, double *jacobian);
    size_t rows;         /* of linearise, for each sample */
    size_t observations; /* numbers of the training part that the loss is the mean square error of, for the
                          * prior; 0: unknown, and there is no prior */
    size_t weights;      /* so many numbers at the start of theta have the prior; 0: all */
    /* (parameters) or NULL: decay_i/2 theta_i^2 is added to the loss of the methods other than Adam, beside
     * the options' weight decay. Losses are reported without it. */
    const double *decay;
    size_t chunk; /* samples on a tape at once, so that their values stay in the cache; 0: LG_FIT_CHUNK */
    /* May be NULL. *dead: a model with these parameters can learn no more. Then theta gets others to start
     * from, those of restart `number` >= 1; a pure function of its arguments. May allocate memory. A status
     * other than LG_OK stops the fit. */
    lg_status (*revive)(void *user, uint64_t number, double *theta, bool *dead);
} lg_fit_problem;

/* What a sample is for. */
typedef enum lg_part { LG_PART_NONE, LG_PART_TRAIN, LG_PART_TEST, LG_PART_VALIDATION } lg_part;
#define LG_PART_COUNT 4

typedef struct lg_fit lg_fit;

/* How steps are taken. Methods that no caller names may follow; they are found by name. */
typedef enum lg_fit_method {
    LG_FIT_ADAM,      /* batches in a new order in each epoch */
    LG_FIT_SSBROYDEN, /* liegrad/minimise.h on the loss of all training samples: an epoch is one evaluation */
    LG_FIT_LBFGS,
    LG_FIT_LM /* of the problem's residuals; a parameter takes a forward sweep, or all `linearise` */
} lg_fit_method;
LG_API const char *
lg_fit_method_name(lg_fit_method method); /* "adam", "ssbroyden", "lbfgs", "lm"; else NULL */
/* It takes sums of squares alone. */
LG_API bool lg_fit_method_squares(lg_fit_method method);
/* It takes batches, as Adam does; the others take the loss of all training samples. */
LG_API bool lg_fit_method_batches(lg_fit_method method);

/* Methods one after the other. */
#define LG_FIT_MAX_PHASES 4
#define LG_FIT_PLAN_TEXT  128
typedef struct lg_fit_plan {
    uint32_t phases; /* 1..LG_FIT_MAX_PHASES; 0: Adam */
    struct {
        uint32_t method; /* lg_fit_method */
        uint32_t epochs; /* >= 1; of the last phase 0: the rest */
    } phase[LG_FIT_MAX_PHASES];
} lg_fit_plan;
/* "ssbroyden", "adam:100,ssbroyden". LG_INVALID_ARGUMENT with a sentence; *out untouched then. */
LG_API lg_status lg_fit_plan_parse(const char *text, lg_fit_plan *out, lg_error *error);
/* The same without methods for sums of squares alone, for a loss that is none. */
LG_API lg_status lg_fit_plan_parse_any_loss(const char *text, lg_fit_plan *out, lg_error *error);
/* Whether a phase takes batches; whether the last one does. */
LG_API bool lg_fit_plan_batches(const lg_fit_plan *plan);
LG_API bool lg_fit_plan_ends_in_batches(const lg_fit_plan *plan);
LG_API void lg_fit_plan_show(const lg_fit_plan *plan, char text[LG_FIT_PLAN_TEXT]);

/* Why training is finished. */
typedef enum lg_fit_end {
    LG_FIT_RUNNING,
    LG_FIT_END_EPOCHS,   /* the planned epochs are done */
    LG_FIT_END_SECONDS,  /* lg_fit_options.seconds are used up */
    LG_FIT_END_PATIENCE, /* no lower criterion for `patience` epochs, or steps of a minimiser */
    LG_FIT_END_MINIMISER /* the last phase's minimiser came to an end of its own */
} lg_fit_end;

/* The hyperparameters of lg_fit_options as command lines and files name them. */
typedef struct lg_training {
    lg_fit_plan plan;
    lg_dtype dtype;
    uint64_t epochs; /* planned total */
    uint64_t batch;
    double lr;
    lg_schedule_kind schedule;
    uint64_t lr_step; /* step: epochs between two reductions */
    double lr_gamma;  /* step: factor of a reduction; cosine: last factor, in [0, 1] */
    double weight_decay;
    double prior; /* standard deviation of the weights before any data, 0: not stated */
    double adam_eps;
    double clip;       /* bound on the gradient's norm, 0 none */
    double validation; /* fraction; above 0 the parameters of the best epoch are the result */
    /* Epochs (of methods other than Adam: accepted steps) without a lower loss, of the validation part if
     * there is one; 0: no limit. */
    uint64_t patience;
    uint32_t shards;
    uint64_t seed;
} lg_training;

/* After an epoch. */
typedef struct lg_fit_epoch {
    uint64_t epoch, epochs; /* finished, counted from 1; planned */
    double loss; /* Adam: mean over the batches, weighted by samples, each at the parameters before its step.
                  * Other methods: that of all training samples at the lowest point so far, without decay
                  * and prior */
    double validation; /* loss of the validation part after the epoch; NaN without one */
    double seconds;    /* wall time of the epoch */
    double rate;       /* learning rate used: lr times the schedule's factor; 0 without Adam */
    bool best;         /* the lowest criterion so far */
} lg_fit_epoch;

typedef struct lg_fit_options {
    size_t size; /* sizeof(lg_fit_options) */
    /* Hyperparameters: saved, and must be equal on load. */
    lg_fit_plan plan; /* Adam; the other methods need LG_F64 */
    lg_dtype dtype;   /* LG_F64; of tapes, theta and moments */
    uint64_t epochs;  /* 100: planned total, >= 1 */
    size_t batch;     /* 0: all samples; the last batch of an epoch may be smaller */
    uint32_t shards;  /* 0..1024, default 0: contiguous pieces of a batch, min(shards, batch) of them. Each
                      * has its own gradient, so take 1 for a model that is large compared with the batch;
                      * threads beyond the shards split the large products instead. 0: by the work, the
                      * largest of 1, 2 and 4 whose pieces have 6e4 samples x parameters and 24 samples; more,
                      * up to 4, where a piece would exceed LG_FIT_CHUNK samples (or the problem's chunk) */
    lg_adam_options adam; /* those of lg_adam_options_init */
    lg_schedule schedule; /* constant */
    /* 0: off. s > 0: noise in the data is not learned by the methods other than Adam. Where 50 iterations
     * lower the loss L by less than a tenth, L is taken as the variance of the noise, and the most probable
     * weights are sought: with normal noise and weights w from N(0, s^2), L + W/2 |w|^2 is minimised,
     * W = 2 L/(n s^2), n and w the problem's observations and weights. Where L falls to half of that, W is 0
     * again. */
    double prior;
    double clip_norm;  /* 0: off; else the bound on the gradient's Euclidean norm */
    uint64_t seed;     /* 1 */
    double validation; /* 0, in [0, 1): part of the samples kept for validation, drawn by the seed */
    bool shuffle;      /* true: a new order of the training samples in each epoch */
    bool keep_best; /* false; true: lg_fit_parameters gives those after the epoch with the lowest criterion */
    /* 0: off; else stop after so many epochs, or accepted steps of the other methods than Adam, without a new
     * lowest criterion. */
    uint64_t patience;
    /* The criterion is the validation loss, or without a validation part the epoch's loss. */
    /* 0: off; else lg_fit_problem.revive is asked after each epoch. A dead model starts from its other
     * parameters, at epoch 0 with an empty history, at most so many times; not when the seconds are used up,
     * nor with keep_best when the best epoch's criterion is below 0.9 times that of the dead model. */
    uint32_t restarts;

    /* Free to differ between runs. */
    int threads;         /* 1, 1..1024; the result does not depend on it */
    uint64_t stop_after; /* 0: off; else epochs in one call of lg_fit_run */
    double
        seconds; /* 0: off; else finished when the epochs have taken so long, those before a load included */
    size_t max_tape_size;      /* 0: no limit; else for each shard's tape */
    uint64_t checkpoint_every; /* 0: off; else calls `checkpoint` after each so many epochs */
    /* Called on the thread of lg_fit_run with a state that can be saved: as said above, and whenever
     * lg_fit_run returns before the plan is finished because of stop_after, the cancel flag or on_epoch. May
     * be NULL. A status other than LG_OK stops. Of ranks it is called on rank 0. */
    lg_status (*checkpoint)(void *user, const lg_fit *fit);
    /* May be NULL. A return other than 0 stops: lg_fit_run returns LG_CANCELLED. */
    int (*on_epoch)(void *user, const lg_fit_epoch *report);
    void *user; /* of checkpoint and on_epoch */
    /* NULL: alone; else processes that train together (liegrad/ranks.h; must outlive the fit). Each computes
     * its part of the shards, so at most `shards` ranks have work; the result does not depend on their
     * number. Seconds are those of rank 0, and the cancel flag of any rank stops all. */
    const lg_ranks *ranks;
} lg_fit_options;

/* The defaults named above. */
LG_API void lg_fit_options_init(lg_fit_options *options);
/* Sets the hyperparameters of *options, and leaves the rest. */
LG_API void lg_training_apply(const lg_training *training, lg_fit_options *options);

/* theta: `parameters` doubles, copied. Training starts from them; any vector makes a warm start. The context
 * must outlive the fit. `options` NULL: defaults. Errors: LG_INVALID_ARGUMENT (the sentence names the
 * option), LG_NOT_FINITE for theta, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_fit_create(const lg_context *context, const lg_fit_problem *problem,
                               const lg_fit_options *options, const double *theta, lg_fit **out,
                               lg_error *error);
LG_API void lg_fit_destroy(lg_fit *fit); /* NULL is fine */

/* Trains until the plan is finished (LG_OK; at once when it already is), stop_after epochs are done (LG_OK),
 * or an error stops it. In every case the state is that of a batch boundary: it can be saved, and lg_fit_run
 * continues from it with the same bits as a run that never stopped. Each shard has its own tape and gradient.
 * Gradients and losses are added in a fixed tree, so the bits depend on `shards` and not on `threads`. After
 * the first batches no memory is allocated. Errors:
 * - LG_CANCELLED: the context's cancel flag, read between batches, or on_epoch
 * - LG_NOT_FINITE: a loss, gradient, parameter or moment is NaN or infinite. The state is the one before that
 *   step. The sentence names the epoch, the batch and the value.
 * - LG_OUT_OF_MEMORY, and those of the loss callback, the tape and the checkpoint callback */
LG_API lg_status lg_fit_run(lg_fit *fit, lg_error *error);

/* Whether and why training is finished; a fit may be finished in one run and go on in another one that has
 * more seconds. The sentence has no full stop, "" while running. */
LG_API bool lg_fit_finished(const lg_fit *fit);
LG_API lg_fit_end lg_fit_why_finished(const lg_fit *fit);
LG_API const char *lg_fit_end_sentence(const lg_fit *fit);
/* The method of the next epoch, or of the last one when finished. */
LG_API lg_fit_method lg_fit_method_now(const lg_fit *fit);

/* Saves the whole state under these names:
 *   optimizer/{parameters,best}, optimizer/adam/{m,v,step}, rng, minimise/... (liegrad/minimise.h)
 *   train/{permutation,epoch,...}, train/history/{loss,validation,seconds,rate}, train/options/...
 *   with options.restarts: train/restarts, train/restart_seconds
 * Of ranks, rank 0 alone can save, in the checkpoint callback and after lg_fit_run; any number of them may
 * load. Errors: the writer's, LG_UNSUPPORTED on other ranks. */
LG_API lg_status lg_fit_save(const lg_fit *fit, const lg_archive_writer *writer, lg_error *error);
/* Replaces the state; on failure it is as before. Errors: LG_INVALID_ARGUMENT when a hyperparameter, the
 * number of parameters or samples differs (the sentence names it and both values), LG_FORMAT for an
 * impossible state (an order that is not a permutation, a position off a batch boundary, values not finite),
 * the reader's, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_fit_load(lg_fit *fit, const lg_archive_reader *reader, lg_error *error);

/* The result as `parameters` doubles: with keep_best those of the best epoch (when one is finished), else the
 * current ones. */
LG_API void lg_fit_parameters(const lg_fit *fit, double *theta);
LG_API uint64_t lg_fit_epochs_done(const lg_fit *fit);
LG_API uint64_t lg_fit_steps_done(const lg_fit *fit); /* Adam's steps and evaluations of other methods */
LG_API uint64_t lg_fit_best_epoch(const lg_fit *fit); /* counted from 1; 0: none finished */
LG_API uint64_t lg_fit_restarts(const lg_fit *fit);   /* done so far */
/* Loss of the last finished epoch; NaN before. */
LG_API double lg_fit_loss(const lg_fit *fit);

/* One number an epoch, lg_fit_epochs_done of them. Borrowed, until the next run or load. */
typedef enum lg_fit_series { LG_FIT_LOSS, LG_FIT_VALIDATION, LG_FIT_SECONDS, LG_FIT_RATE } lg_fit_series;
#define LG_FIT_SERIES_COUNT 4
LG_API const double *lg_fit_history(const lg_fit *fit, lg_fit_series series);
/* Median over the epochs after the first (of the first when it is the only one); NaN before. */
LG_API double lg_fit_seconds_per_epoch(const lg_fit *fit);
/* Where the time of this process's lg_fit_run went, and what it exchanged with other ranks (their messages
 * included): the model of docs/reports/scale.md in numbers. */
typedef struct lg_fit_cost {
    double seconds;          /* of all epochs of this process */
    double shard_seconds;    /* for its shards */
    double exchange_seconds; /* in exchanges, with the wait for slower ranks */
    uint64_t exchanges, bytes;
} lg_fit_cost;
LG_API lg_fit_cost lg_fit_cost_of(const lg_fit *fit);
/* Bytes held by the tapes of all shards: the memory of a step. */
LG_API size_t lg_fit_tape_size(const lg_fit *fit);

/* ---- Newton, for models with few parameters ---- */

#define LG_NEWTON_MAX_PARAMETERS 512

typedef struct lg_newton_result {
    uint64_t iterations;
    double loss, gradient_norm; /* at the last point where derivatives were taken */
} lg_newton_result;

/* Minimises the full-batch loss from theta (`parameters` doubles, in/out) by Newton's method with Levenberg's
 * damping: (H + mu I) s = -g. A step is taken when it lowers the loss; H is exact, by forward over reverse
 * differentiation. Returns LG_OK when max |gradient| <= 1e-15 max |Hessian entry|, when no step lowers the
 * loss any more because of rounding, and after 200 iterations. The whole batch lies on one f64 tape.
 * `result` may be NULL. Errors, theta untouched: LG_INVALID_ARGUMENT (a NULL, no
 * samples, parameters outside 1..LG_NEWTON_MAX_PARAMETERS), LG_OUT_OF_MEMORY, LG_NOT_FINITE, LG_CANCELLED,
 * the loss callback's. */
LG_API lg_status lg_newton_fit(const lg_context *context, const lg_fit_problem *problem, double *theta,
                               lg_newton_result *result);

/* ---- training of programs ----
 *
 * Training of a program: the parameters that minimise what one of its functions computes from rows of data.
 *
 *   lg_program_build(NULL, &spec, &program, &error);            `value` and `error` = value - wanted
 *   const double *const data[] = {x, wanted};
 *   lg_program_train(NULL, program, "error", data, rows, NULL, NULL, &error);
 *   lg_program_save(NULL, "model.h5", program, NULL, &error);   (liegrad/io.h)
 *
 * A program that was loaded is trained on in the same way. */

#define LG_TRAIN_MOST 64 /* parameters (tensors), inputs, outputs */

typedef struct lg_program_training {
    double before, after; /* the loss of all training rows */
    double seconds;
    uint64_t epochs; /* of methods other than Adam: evaluations */
    const char *end; /* why training is finished, a sentence of static storage without a full stop */
} lg_program_training;

/* The first output of `function` says what is minimised:
 *   one value for each row (B, ...)   the mean of its squares over rows and numbers
 *   one number that all rows share    itself; it must be a mean over the rows, as lg_mean makes it
 * Both are tried before and after training: the loss of 8 rows, from all over the data, must be the mean
 * of the losses of each row alone. A sum is refused, and so are rows that depend on each other: rows are
 * trained on in chunks, and the result would follow the chunks.
 * data[i]: input i of the function, (rows, numbers of one row); a shared input is there once.
 *
 * options NULL: in double precision, by Levenberg-Marquardt where there are squares and at most 64
 * parameters, else SSBroyden with at most 2000, else L-BFGS; 1000 evaluations, fewer where the loss no longer
 * falls. All of lg_fit_options is honoured: threads, validation part with keep_best, seconds, methods.
 *
 * Success replaces the program's parameters (lg_program_set_parameter). `result` may be NULL. Errors, the
 * program as before: LG_NOT_FOUND (function), LG_INVALID_ARGUMENT (no rows, NULL, an output that depends on
 * no parameter, that has several numbers which rows share, or that is no mean over rows), LG_UNSUPPORTED
 * (LG_TRAIN_MOST), LG_NOT_FINITE (data, and as lg_fit_run), those of lg_fit_create, lg_fit_run and of
 * operations. */
LG_API lg_status lg_program_train(const lg_context *context, lg_program *program, const char *function,
                                  const double *const *data, size_t rows, const lg_fit_options *options,
                                  lg_program_training *result, lg_error *error);

LG_END_DECLS

#endif

/* Training: Adam, learning rate schedules, the training loop lg_fit with its methods, Newton's method for
 * small models, and training of programs. Library liegrad. docs/reports/training.md has measured results.
 *
 * lg_fit minimises a loss over a data set of `samples` samples, by choice of the parameters theta, a flat
 * vector:
 *
 *   lg_fit_problem problem = {.parameters = n, .samples = count, .loss = loss, .user = &data};
 *   lg_fit_options options;
 *   lg_fit_options_init(&options);
 *   options.epochs = 500, options.batch = 64;
 *   lg_fit *fit;
 *   lg_status status = lg_fit_create(NULL, &problem, &options, theta, &fit, &error);
 *   if (status == LG_OK) status = lg_fit_run(fit, &error);
 *   if (status == LG_OK) lg_fit_parameters(fit, theta);
 *   lg_fit_destroy(fit);                                      (only if lg_fit_create succeeded)
 *
 * Words. A method is Adam or a minimiser (SSBroyden, L-BFGS, Levenberg-Marquardt; liegrad/minimise.h). Adam
 * takes a step per batch; its epoch is one pass over all training samples. An epoch of a minimiser is one
 * evaluation of the loss of all training samples and its derivatives. A plan is a sequence of methods, called
 * phases. The criterion of an epoch is its validation loss, or its training loss without validation part. A
 * shard is a contiguous piece of a batch with its own tape and gradient; threads work on different shards.
 *
 * Only one thread at a time may call the functions of an lg_fit.
 */
#ifndef LIEGRAD_FIT_H
#define LIEGRAD_FIT_H

#include "liegrad/networks.h"
#include "liegrad/program.h"

LG_BEGIN_DECLS

/* ---- Adam (Kingma & Ba 2015; decoupled decay: Loshchilov & Hutter 2019) ---- */

typedef struct lg_adam_options {
    double lr;           /* learning rate, > 0; default 1e-3 */
    double beta1, beta2; /* in [0, 1); default 0.9 and 0.999 */
    double eps;          /* > 0; default 1e-8 */
    double weight_decay; /* >= 0; default 0 */
    /* false (default): decay * theta is added to the gradient (L2 penalty). true: lr * decay * theta is
     * subtracted from theta, apart from Adam's step. */
    bool decoupled;
} lg_adam_options;
LG_API void lg_adam_options_init(lg_adam_options *options);

/* Takes step number `step` = 1, 2, ... on n elements; gradient, m, v and theta are arrays of the type
 * `dtype`, and all but the gradient are updated. For each element, with lr = options->lr * rate and decay =
 * options->weight_decay:
 *   g = clip * gradient [+ decay theta],  m = beta1 m + (1 - beta1) g,  v = beta2 v + (1 - beta2) g^2,
 *   theta = theta [- lr decay theta] - lr (m/(1 - beta1^step)) / (sqrt(v/(1 - beta2^step)) + eps).
 * The first bracket applies if options->decoupled is false, the second one if it is true. Before the first
 * step m and v must be zero. */
LG_API void lg_adam_step(const lg_adam_options *options, lg_dtype dtype, uint64_t step, double rate,
                         double clip, const void *gradient, size_t n, void *m, void *v, void *theta);

/* ---- schedules ---- */

typedef enum lg_schedule_kind { LG_SCHEDULE_CONSTANT, LG_SCHEDULE_STEP, LG_SCHEDULE_COSINE } lg_schedule_kind;
#define LG_SCHEDULE_COUNT 3
LG_API const char *lg_schedule_name(lg_schedule_kind kind); /* "constant", "step", "cosine" */

typedef struct lg_schedule {
    lg_schedule_kind kind;
    uint64_t every; /* LG_SCHEDULE_STEP: number of epochs after which the rate is multiplied by gamma, >= 1 */
    double gamma;   /* LG_SCHEDULE_STEP: > 0 */
    double floor;   /* LG_SCHEDULE_COSINE: the factor at the end, in [0, 1] */
} lg_schedule;

/* Returns the factor on Adam's learning rate in epoch number `epoch` = 0, 1, ..., epochs - 1:
 *   LG_SCHEDULE_CONSTANT  1
 *   LG_SCHEDULE_STEP      gamma^k, where k is epoch/every, rounded down
 *   LG_SCHEDULE_COSINE    floor + (1 - floor) (1 + cos(pi epoch/epochs))/2; floor for epoch >= epochs
 * gamma, every and floor are members of the schedule. */
LG_API double lg_schedule_rate(const lg_schedule *schedule, uint64_t epoch, uint64_t epochs);

/* ---- training: the problem ---- */

/* Default of lg_fit_problem.chunk. */
#define LG_FIT_CHUNK 128

/* The learning problem. lg_fit copies this struct, and borrows what it points to. Set members that are not
 * needed to 0 or NULL. All callbacks must be pure functions of their arguments; several threads call `loss`,
 * `gradient`, `residuals` and `linearise` at once, each with its own tape. The status of a callback or tape
 * that fails ends lg_fit_run. `samples` lists indices from 0: `count` >= 1 samples of a batch of `batch`. */
typedef struct lg_fit_problem {
    size_t parameters; /* length of theta, 1 to 2^32 - 1 */
    size_t samples;    /* size of the data set, validation part included, 1 to 2^32 - 1 */
    /* Records the contribution of these samples to the loss of the batch: the contributions of all parts of a
     * batch add up to its loss. So if the loss is a mean, it records the sum over the `count` samples,
     * divided by `batch`. theta is a flat variable (rank 1) of the tape's type; *loss is a variable with one
     * element. NULL: the sum of the squares of `residuals`, which then serve all methods, or `gradient`. */
    lg_status (*loss)(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                      size_t batch, lg_var *loss);
    void *user; /* passed to all callbacks */
    /* May be NULL. Computes in numbers what methods other than LG_FIT_LM otherwise get from a recording of
     * `loss`: adds the samples' part of the loss to *loss and, unless `gradient` is NULL, its derivatives to
     * gradient (parameters). theta and gradient have the type of the fit. */
    lg_status (*gradient)(void *user, const void *theta, const uint32_t *samples, size_t count, size_t batch,
                          double *loss, void *gradient);
    /* If > 0, the last `validation` samples are the validation part, and lg_fit_options.validation must be 0.
     * If 0, lg_fit_options.validation decides. */
    size_t validation;
    /* For LG_FIT_LM, and for all methods without `loss`; NULL if the loss is no sum of squares. Records
     * residuals r of the samples, of any shape, such that the sum of all r_i^2 is the loss. With `own` or
     * `rows`, r has one row per sample: (count, ...). */
    lg_status (*residuals)(void *user, lg_tape *tape, lg_var theta, const uint32_t *samples, size_t count,
                           size_t batch, lg_var *r);
    /* For LG_FIT_LM. If > 0, the last own * samples elements of theta belong to single samples: the first
     * `own` of them to sample 0, and so on. The residuals of a sample may depend only on these and on the
     * elements before all of them. LG_FIT_LM differentiates by the own parameters of all samples at the same
     * time, and eliminates them. */
    size_t own;
    /* For LG_FIT_LM, may be NULL; LG_FIT_LM alone needs neither `loss` nor `residuals` then. Computes what it
     * otherwise gets by forward sweeps over `residuals`, at the values `theta`: *loss, r (count * rows) and
     * its Jacobian (count * rows, columns), by the shared parameters, then by the `own` ones of the row's
     * sample. *loss, J^T r and J^T J must be those of `residuals`; components of r that are orthogonal
     * to all columns of J may be left out. `tape` may be used for work. */
    lg_status (*linearise)(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                           size_t count, size_t batch, double *loss, double *r, double *jacobian);
    size_t rows; /* rows of `linearise` per sample */
    /* For lg_fit_options.prior: how many measured numbers of the training part the loss is the mean square
     * error of. 0: unknown, and there is no prior. */
    size_t observations;
    size_t weights; /* the prior is on the first `weights` elements of theta; 0: on all */
    /* (parameters) or NULL. Minimisers add the sum of decay[i]/2 theta_i^2 to the loss, in addition to the
     * weight decay of the options. Reported losses do not contain it. */
    const double *decay;
    /* Largest number of samples that are on a tape at once; a larger shard is processed in pieces. Small
     * pieces keep the values in the processor's cache. 0: LG_FIT_CHUNK. */
    size_t chunk;
    /* True: `loss` usually records the same operations for the same number of samples, and only the values
     * of leaves (lg_input, lg_parameter) differ. lg_fit_create records it once and makes a plan
     * (liegrad/program.h) of the loss and its gradient, unless `loss` reads values from the tape. Results
     * differ from the tape's by rounding. A plan is faster in fits of machines, for layers of every width,
     * but slower for convolutions and Lie group maps (docs/reports/speed.md). */
    bool repeats;
    /* May be NULL. If the model with the parameters `theta` is dead, that is, cannot learn any more
     * (lg_fit_options.restarts), it sets *dead to true and replaces `theta` by parameters for restart number
     * `number` = 1, 2, ... It is called on the thread of lg_fit_run, and may allocate memory. */
    lg_status (*revive)(void *user, uint64_t number, double *theta, bool *dead);
} lg_fit_problem;

/* What a sample or a row of data is used for. */
typedef enum lg_part { LG_PART_NONE, LG_PART_TRAIN, LG_PART_TEST, LG_PART_VALIDATION } lg_part;
#define LG_PART_COUNT 4

typedef struct lg_fit lg_fit;

/* ---- training: methods and plans ---- */

/* Methods of training. lg_fit_plan_parse finds more by name: "sgd" is a step per batch, theta <- theta - lr
 * rate m with m <- beta1 m + g for the gradient g; it takes the options of Adam except beta2 and eps. */
typedef enum lg_fit_method {
    LG_FIT_ADAM,      /* a step per batch; the samples have a new order in each epoch */
    LG_FIT_SSBROYDEN, /* LG_MINIMISE_SSBROYDEN; at most 10000 parameters */
    LG_FIT_LBFGS,     /* LG_MINIMISE_LBFGS */
    /* LG_MINIMISE_LM, for a problem with `residuals`. An evaluation takes one forward sweep per column of the
     * Jacobian, or one call of `linearise`. At most 10000 shared parameters. */
    LG_FIT_LM
} lg_fit_method;
LG_API const char *
lg_fit_method_name(lg_fit_method method); /* "adam", "ssbroyden", "lbfgs", "lm", "sgd"; NULL if unknown */
/* Returns whether the method needs a loss that is a sum of squares. */
LG_API bool lg_fit_method_squares(lg_fit_method method);
/* Returns whether the method takes a step per batch, like Adam. The other methods are minimisers. */
LG_API bool lg_fit_method_batches(lg_fit_method method);

/* A plan: methods that train one after the other. A phase ends after its epochs, or when its minimiser
 * ends. */
#define LG_FIT_MAX_PHASES 4
#define LG_FIT_PLAN_TEXT  128
typedef struct lg_fit_plan {
    uint32_t phases; /* 1..LG_FIT_MAX_PHASES; 0: Adam alone */
    struct {
        uint32_t method; /* lg_fit_method */
        uint32_t epochs; /* >= 1; in the last phase also 0: all epochs that are left */
    } phase[LG_FIT_MAX_PHASES];
} lg_fit_plan;
/* Reads a plan from a text: "ssbroyden", or "adam:100,ssbroyden" (100 epochs of Adam, then SSBroyden).
 * Without `squares`, methods that need a sum of squares are unknown. Errors: LG_INVALID_ARGUMENT. */
LG_API lg_status lg_fit_plan_parse(const char *text, bool squares, lg_fit_plan *out, lg_error *error);
/* Return whether any phase of the plan takes batches, and whether the last one does. */
LG_API bool lg_fit_plan_batches(const lg_fit_plan *plan);
LG_API bool lg_fit_plan_ends_in_batches(const lg_fit_plan *plan);
/* Writes the plan as a text that lg_fit_plan_parse reads. */
LG_API void lg_fit_plan_show(const lg_fit_plan *plan, char text[LG_FIT_PLAN_TEXT]);

/* Why training is finished. */
typedef enum lg_fit_end {
    LG_FIT_RUNNING,      /* it is not finished */
    LG_FIT_END_EPOCHS,   /* the planned epochs are done */
    LG_FIT_END_SECONDS,  /* lg_fit_options.seconds are used up */
    LG_FIT_END_PATIENCE, /* the criterion did not fall for lg_fit_options.patience epochs or steps */
    LG_FIT_END_MINIMISER /* the minimiser of the last phase has ended, for example at a minimum */
} lg_fit_end;

/* ---- training: options ---- */

/* The hyperparameters of lg_fit_options in the form of command lines and settings files (liegrad/settings.h).
 * Members without a comment have the meaning of those of lg_fit_options. */
typedef struct lg_fit_settings {
    lg_fit_plan plan;
    lg_dtype dtype;
    uint64_t epochs;
    uint64_t batch;
    double lr; /* learning rate of Adam */
    lg_schedule_kind schedule;
    uint64_t lr_step;    /* lg_schedule.every */
    double lr_gamma;     /* LG_SCHEDULE_STEP: lg_schedule.gamma; LG_SCHEDULE_COSINE: lg_schedule.floor */
    double weight_decay; /* of Adam's options */
    double prior;        /* standard deviation of the weights before any data; 0: no prior */
    double adam_eps;
    double clip;       /* lg_fit_options.clip_norm: bound on the gradient's norm; 0: no bound */
    double validation; /* fraction; if > 0, the parameters of the best epoch are the result (keep_best) */
    uint64_t patience; /* 0: no limit */
    uint32_t shards;
    uint64_t seed;
} lg_fit_settings;

/* The report about a finished epoch. */
typedef struct lg_fit_epoch {
    uint64_t epoch, epochs; /* number of this epoch, counted from 1; planned number of epochs */
    /* Adam: the mean of the batch losses before their steps, weighted by the number of samples. Minimisers:
     * the loss of all training samples at the best point so far, without weight decay and prior. */
    double loss;
    double validation; /* loss of the validation part after the epoch; NaN if there is no such part */
    double seconds;    /* wall time of the epoch */
    double rate;       /* learning rate of Adam in this epoch, schedule included; 0 for other methods */
    bool best;         /* the epoch has the lowest criterion so far */
} lg_fit_epoch;

typedef struct lg_fit_options {
    size_t size; /* sizeof(lg_fit_options) */
    /* Hyperparameters. They are saved with the state, and must be equal when it is loaded. */
    lg_fit_plan plan; /* default: Adam; the other methods need LG_F64 */
    lg_dtype dtype;   /* type of tapes, parameters and Adam's moments; default LG_F64 */
    uint64_t epochs;  /* planned number of epochs, >= 1; default 100 */
    size_t batch;     /* samples per batch; the last batch of an epoch may be smaller; default 0: all */
    /* Number of shards of a batch, 0 to 1024, at most its samples. Each shard has its own gradient, so take 1
     * for a model that is large compared with the batch; threads without a shard then help with large matrix
     * products. 0 (default): the largest of 1, 2 and 4 such that each shard has at least 24 samples and 6e4
     * samples * parameters; more, up to 4, if a shard would otherwise have more than lg_fit_problem.chunk
     * samples. */
    uint32_t shards;
    lg_adam_options adam; /* default: as set by lg_adam_options_init */
    lg_schedule schedule; /* default: constant */
    /* 0 (default): off. Otherwise the standard deviation s of the prior distribution N(0, s^2) of the
     * weights w (lg_fit_problem.weights). It keeps SSBroyden and L-BFGS from learning the noise in the data;
     * the other methods do not use it. When 50 iterations have lowered the loss L by less than a tenth, L is
     * taken for the variance v of the noise. From then on L + W/2 |w|^2 with W = 2 v/(n s^2) and n =
     * lg_fit_problem.observations is minimised: the most probable weights for normal noise. If L falls below
     * v/2 later, v was too large and becomes 0 again. With keep_best the best epoch may be an earlier one. */
    double prior;
    double clip_norm;  /* bound on the Euclidean norm of Adam's gradient; default 0: no bound */
    uint64_t seed;     /* of the random numbers; default 1 */
    double validation; /* fraction of the samples, drawn at random, for validation; in [0, 1), default 0 */
    bool shuffle;      /* true (default): Adam takes the training samples in a new order in each epoch */
    /* true: the result (lg_fit_parameters) are the parameters after the epoch with the lowest criterion.
     * false (default): the last parameters. */
    bool keep_best;
    /* Training ends after this many epochs, or accepted steps of a minimiser, without a new lowest
     * criterion. Default 0: no limit. */
    uint64_t patience;
    /* Largest number of restarts of a dead model; default 0: none. If > 0, lg_fit_problem.revive is asked
     * after each epoch. A restart begins at epoch 0 with an empty history. There is none when the seconds are
     * used up, or with keep_best if the best epoch's criterion is below 0.9 times the dead model's. */
    uint32_t restarts;

    /* The following options do not change what the epochs compute; they may differ between a save and a
     * load. */
    int threads;         /* 1 to 1024; default 1 */
    uint64_t stop_after; /* a call of lg_fit_run ends after this many epochs; default 0: no limit */
    /* Training is finished when all epochs together, those before a load included, have taken this long.
     * Default 0: no limit. */
    double seconds;
    /* true: where `seconds` end the epochs early, the cosine of the schedule ends with them. Its place is the
     * larger one of the share of the epochs and the share of the seconds. The rates then depend on time, and
     * so do the parameters. Default false. */
    bool hurry;
    size_t max_tape_size;      /* limit in bytes on the tape of each shard; default 0: no limit */
    uint64_t checkpoint_every; /* `checkpoint` is called each time after this many epochs; default 0: never */
    /* May be NULL. It is called on the thread of lg_fit_run, with ranks on rank 0 only, to save the state: as
     * `checkpoint_every` says, and when stop_after, the cancel flag or on_epoch end lg_fit_run before the
     * plan is finished. A status other than LG_OK ends lg_fit_run. */
    lg_status (*checkpoint)(void *user, const lg_fit *fit);
    /* May be NULL. It is called after each epoch. If it returns a number other than 0, lg_fit_run returns
     * LG_CANCELLED. With ranks it is called on every rank, and must return the same number on all. */
    int (*on_epoch)(void *user, const lg_fit_epoch *report);
    void *user; /* passed to `checkpoint` and `on_epoch` */
    /* NULL (default): one process. Otherwise ranks that train together (liegrad/core.h), which must outlive
     * the fit. Each computes its part of the shards; ranks beyond the number of shards are idle. The result
     * is the same for any number. Rank 0 measures wall times. The cancel flag of any rank stops all ranks. */
    const lg_ranks *ranks;
} lg_fit_options;

/* Sets the defaults that lg_fit_options names. */
LG_API void lg_fit_options_init(lg_fit_options *options);
/* Copies the hyperparameters to *options, and sets keep_best if training->validation > 0. */
LG_API void lg_fit_settings_apply(const lg_fit_settings *training, lg_fit_options *options);

/* ---- training: running ---- */

/* Makes a fit that starts from `theta` (problem->parameters doubles, copied). `options` is copied, NULL means
 * the defaults. The context must outlive the fit. With ranks it is collective. Errors: LG_INVALID_ARGUMENT
 * (the message names the option), LG_NOT_FINITE (theta). */
LG_API lg_status lg_fit_create(const lg_context *context, const lg_fit_problem *problem,
                               const lg_fit_options *options, const double *theta, lg_fit **out,
                               lg_error *error);
LG_API void lg_fit_destroy(lg_fit *fit);

/* Trains, and returns LG_OK when training is finished (at once if it was before), or when options.stop_after
 * epochs are done. In every case, also after an error, the state is between two batches: it can be saved, and
 * a further lg_fit_run continues with the same bits as a run that was never interrupted. Results depend on
 * options.shards, to the last bit, but not on options.threads. After the first batches no memory is
 * allocated. With ranks it is collective. Errors:
 * - LG_CANCELLED: the context's cancel flag, which is read between batches, or on_epoch
 * - LG_NOT_FINITE: a loss, gradient, parameter or moment of Adam is NaN or infinite. The state is the one
 *   before this step. The message names the epoch, the batch and the value. A minimiser only fails if this
 *   happens at its first evaluation; later its line search shortens the step.
 * - LG_OUT_OF_MEMORY, the status of a callback of the problem, of the tape, of `checkpoint` or of an exchange
 *   between ranks */
LG_API lg_status lg_fit_run(lg_fit *fit, lg_error *error);

/* Return whether and why training is finished. A fit whose seconds are used up can be continued: save it, and
 * load the state into a fit with more seconds. The sentence has static storage and is "" before the end. */
LG_API bool lg_fit_finished(const lg_fit *fit);
LG_API lg_fit_end lg_fit_why_finished(const lg_fit *fit);
LG_API const char *lg_fit_end_sentence(const lg_fit *fit);
/* Returns the method of the next epoch; if training is finished, the method of the last epoch. */
LG_API lg_fit_method lg_fit_method_now(const lg_fit *fit);

/* Saves the whole state, as optimizer/..., rng, minimise/... (lg_minimiser_save) and train/... With ranks,
 * only rank 0 can save, in `checkpoint` and after lg_fit_run; any number of ranks can load the state. Errors:
 * the status of the writer, LG_UNSUPPORTED (this rank does not have the whole state). */
LG_API lg_status lg_fit_save(const lg_fit *fit, const lg_archive_writer *writer, lg_error *error);
/* Replaces the state by a saved one. On failure the state is unchanged. With ranks it is collective. Errors:
 * LG_INVALID_ARGUMENT (a hyperparameter, the number of parameters or the number of samples differs: the
 * message names it and both values), LG_FORMAT (an impossible state: an order of samples that is no
 * permutation, a position that is no batch boundary, numbers that are not finite), the status of the
 * reader. */
LG_API lg_status lg_fit_load(lg_fit *fit, const lg_archive_reader *reader, lg_error *error);

/* Copies the parameters (problem->parameters doubles): the current ones, or with options.keep_best those of
 * the best epoch, if an epoch is finished. */
LG_API void lg_fit_parameters(const lg_fit *fit, double *theta);
LG_API uint64_t lg_fit_epochs_done(const lg_fit *fit); /* number of finished epochs */
LG_API uint64_t lg_fit_steps_done(const lg_fit *fit);  /* steps of Adam plus evaluations of minimisers */
/* Returns the epoch with the lowest criterion, counted from 1; 0 if no epoch is finished. */
LG_API uint64_t lg_fit_best_epoch(const lg_fit *fit);
LG_API uint64_t lg_fit_restarts(const lg_fit *fit); /* number of restarts of dead models so far */
/* Returns the loss of the last finished epoch (lg_fit_epoch.loss); NaN if no epoch is finished. */
LG_API double lg_fit_loss(const lg_fit *fit);

/* The members of lg_fit_epoch that are stored for every epoch. */
typedef enum lg_fit_series { LG_FIT_LOSS, LG_FIT_VALIDATION, LG_FIT_SECONDS, LG_FIT_RATE } lg_fit_series;
#define LG_FIT_SERIES_COUNT 4
/* Returns one number per finished epoch. Borrowed until the next lg_fit_run or lg_fit_load. */
LG_API const double *lg_fit_history(const lg_fit *fit, lg_fit_series series);
/* Returns the median wall time of the epochs after the first, or of the only one; NaN without epochs. */
LG_API double lg_fit_seconds_per_epoch(const lg_fit *fit);
/* How this process has spent its time in lg_fit_run, and what it has exchanged with other ranks. */
typedef struct lg_fit_cost {
    double seconds;            /* wall time of all epochs */
    double shard_seconds;      /* of that, for its shards */
    double exchange_seconds;   /* of that, in exchanges, waiting for slower ranks included */
    uint64_t exchanges, bytes; /* number of exchanges, and bytes of the messages of all ranks in them */
} lg_fit_cost;
LG_API lg_fit_cost lg_fit_cost_of(const lg_fit *fit);
/* Whether losses and gradients are computed by plans where they can be (lg_fit_problem.repeats). A resumed
 * run goes on as it began: one that was saved without plans stays on the tape. */
LG_API bool lg_fit_by_plans(const lg_fit *fit);
/* Returns the bytes that the tapes and plans of all shards of this process hold. */
LG_API size_t lg_fit_tape_size(const lg_fit *fit);

/* The loss of all samples but the validation part, as one batch, in double precision,
 * recorded for problem->chunk samples at a time. Of the problem only parameters, samples, validation, chunk,
 * loss, user and, without a loss, residuals are read. Errors: LG_INVALID_ARGUMENT (neither loss nor
 * residuals), the status of the callback or of the tape, with its sentence. */
LG_API lg_status lg_fit_problem_loss(const lg_context *context, const lg_fit_problem *problem,
                                     const double *theta, double *loss, lg_error *error);

/* ---- to rounding, for models with few parameters ---- */

#define LG_NEWTON_MAX_PARAMETERS 512

typedef struct lg_fit_newton_result {
    uint64_t iterations;
    double loss, gradient_norm; /* the loss and max |g_i| at the result */
} lg_fit_newton_result;

/* Minimises the loss of all samples to rounding by lg_minimise (liegrad/minimise.h), which ends with Newton
 * steps for at most 200 parameters. theta (problem->parameters doubles) is the start on entry and the
 * result on return. Reads of the problem what lg_fit_problem_loss reads, except validation and chunk: all
 * samples are on one tape of doubles. `result` may be NULL. Returns LG_OK also where lg_minimise returns
 * LG_NO_CONVERGENCE. On failure theta is unchanged. Errors: LG_INVALID_ARGUMENT (no samples, or the number of
 * parameters is not in 1..LG_NEWTON_MAX_PARAMETERS), LG_NOT_FINITE, LG_CANCELLED, those of `loss`. */
LG_API lg_status lg_fit_newton(const lg_context *context, const lg_fit_problem *problem, double *theta,
                               lg_fit_newton_result *result);

/* ---- training of programs ----
 *
 * lg_program_fit finds the parameters of a program (liegrad/program.h), which may come from a file, for which
 * one of its functions, the loss or the residuals, becomes as small as possible over rows of data. Here the
 * program has the functions `value` and `error` = value - wanted:
 *
 *   lg_program_build(NULL, &spec, &program, &error);
 *   const double *const data[] = {x, wanted};
 *   lg_program_fit(NULL, program, "error", data, rows, NULL, NULL, NULL, &error);
 *   lg_program_save(NULL, "model.h5", program, NULL, &error);
 */

#define LG_PROGRAM_FIT_MOST 64 /* largest number of parameters (tensors), of inputs, and of outputs */

typedef struct lg_program_fit_result {
    double before, after; /* the loss of all rows, before and after training */
    double seconds;       /* wall time */
    uint64_t epochs;      /* finished epochs; for a minimiser, evaluations */
    /* Why training is finished: a sentence without a full stop, static storage. "the planned epochs are
     * done": with a higher limit of epochs or evaluations the loss may fall further. */
    const char *end;
    uint32_t start; /* number of the best start, from 0; 0 without lg_fit_starts */
} lg_program_fit_result;

/* Random starts of a training, because the training of a network can end in a poor minimum. draw may replace
 * the `count` values of each parameter of the program. Each start has its own random numbers. For an lg_mlp,
 * `draw` is lg_mlp_draw and `user` its address; a parameter that is no network keeps its value then. */
typedef struct lg_fit_starts {
    uint32_t count; /* number of starts, >= 1 */
    void (*draw)(void *user, size_t parameter, size_t count, lg_rng *rng, double *values);
    void *user;    /* passed to `draw` */
    uint64_t seed; /* of the random numbers */
} lg_fit_starts;

/* Trains all parameters of the program. The first output of `function` decides what is minimised:
 *   batched (B, ...)          the mean of the squares of all its numbers, over all rows
 *   shared, with one number   this number itself, which must be a mean over the rows (as lg_mean computes it)
 * Rows are trained on in pieces, so they must not depend on each other, and a sum over them would be wrong.
 * Both are tested before and after training: the loss of up to 8 rows must be the mean of their losses.
 *
 * data[i] are the values of input i: `rows` rows, one after the other; for a shared input its single value.
 *
 * `options` NULL: trains in double precision with at most 1000 evaluations. The method is L-BFGS for more
 * than 2000 numbers in the parameters, else Levenberg-Marquardt for a sum of squares and at most 64 numbers,
 * else SSBroyden. To change one of these options, begin with lg_program_fit_options_init, not with
 * lg_fit_options_init, whose method is Adam. If the data have noise and the parameters are weights of a
 * network, set `prior`, such as 0.1. It acts with SSBroyden and L-BFGS on an output with a value per row.
 *
 * `starts` NULL: training begins with the parameters of the program. Otherwise the best of all starts is
 * kept; one that fails with LG_NOT_FINITE is skipped. The result describes it, with the seconds of all.
 *
 * On success the parameters of the program are replaced. On failure the program is unchanged. `result` may be
 * NULL. Errors: LG_NOT_FOUND (no such function), LG_INVALID_ARGUMENT (no rows, no starts; the output depends
 * on no parameter, is shared and has several numbers, or fails the test above), LG_UNSUPPORTED (more than
 * LG_PROGRAM_FIT_MOST parameters), LG_NOT_FINITE (data; as in lg_fit_run, in all starts), the errors of
 * lg_fit_create, lg_fit_run and of operations. */
LG_API lg_status lg_program_fit(const lg_context *context, lg_program *program, const char *function,
                                const double *const *data, size_t rows, const lg_fit_options *options,
                                const lg_fit_starts *starts, lg_program_fit_result *result, lg_error *error);

/* Sets the options that lg_program_fit takes if its `options` are NULL. Errors: those of lg_program_fit. */
LG_API lg_status lg_program_fit_options_init(const lg_program *program, const char *function,
                                             lg_fit_options *options, lg_error *error);
/* Computes what lg_program_fit minimises, for other data. Errors: those of lg_program_fit. */
LG_API lg_status lg_program_loss(const lg_context *context, const lg_program *program, const char *function,
                                 const double *const *data, size_t rows, double *loss, lg_error *error);

/* ---- a step function, from a log ----
 *
 * lg_program_fit_log finds the parameters, and their errors, with which the function `step` of a program
 * (x (n), u (m), h (1) -> the state x (n) after the time h; u may be missing) follows a log.
 * lg_program_add_step makes such a function. `seen` (x -> y (k)) is what is measured; NULL: x itself.
 *
 *   double error[6];
 *   lg_program_log_result found = {.error = error};
 *   const lg_program_log log = {.rows = rows, .t = t, .u = u, .y = y};
 *   lg_program_fit_log(NULL, program, "step", "seen", &log, NULL, &found, &message);
 *
 * The log is cut into windows, which share no row and whose first states are estimated, too. Short windows
 * forgive a poor guess of the parameters and disturbances; whole runs give the smallest errors. */
typedef struct lg_program_log {
    size_t rows;
    const double *t, *u; /* (rows) times, rising in a run; (rows, m) inputs, each held until the next row */
    const double *y;     /* (rows, k) measured values; NaN: not measured */
    const size_t *first; /* (runs) first rows of the runs, rising from 0; NULL: one run */
    size_t runs, window; /* window: rows of a window, >= 2; a run is cut into equal ones; 0: whole runs */
    const double
        *scale; /* (k) deviations of the noise in y; NULL: found by repeated fits (maximum likelihood) */
    const double *guess; /* (rows, n) states; NULL: measured values that depend on one state, otherwise 0 */
} lg_program_log;

typedef struct lg_program_log_result {
    double *error; /* (P) standard errors of the P numbers in the parameters; infinite: not determined */
    double
        *covariance; /* (P, P); an infinite variance has zeros in its row. All three may be NULL on entry. */
    double *noise;   /* (k) standard deviations of the residuals; NaN without a measured value */
    size_t open;     /* numbers that the log does not determine */
    double loss;     /* mean square of the residuals, each y in units of its standard deviation */
    double block;    /* 0: white residuals. Otherwise errors come from sums over blocks of so many seconds */
    uint64_t epochs; /* evaluations */
    const char *end; /* as in lg_program_fit_result */
} lg_program_log_result;

/* `options` NULL: at most 200 evaluations. The method is Levenberg-Marquardt. Results do not depend on units.
 * On failure program and *result are unchanged. Errors: LG_NOT_FOUND, LG_SHAPE (functions), LG_UNSUPPORTED
 * (no or too many parameters), LG_INVALID_ARGUMENT (the log, a window longer than all runs, too few measured
 * values), LG_NOT_FINITE (u, y; the loss at the start), those of lg_fit_run. */
LG_API lg_status lg_program_fit_log(const lg_context *context, lg_program *program, const char *step,
                                    const char *seen, const lg_program_log *log,
                                    const lg_fit_options *options, lg_program_log_result *result,
                                    lg_error *error);

LG_END_DECLS

#endif

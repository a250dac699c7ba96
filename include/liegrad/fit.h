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
 * takes a step per batch, and an epoch is one pass over all training samples. A minimiser works with the loss
 * of all training samples, and an epoch is one evaluation of loss and derivatives. A plan is a sequence of
 * methods, called phases. The criterion of an epoch is its validation loss, or its training loss if there is
 * no validation part. A shard is a contiguous piece of a batch that has its own tape and gradient; threads
 * work on different shards at once.
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

/* The learning problem. lg_fit copies this struct, and borrows everything that it points to. Set members that
 * are not needed to 0 or NULL. The callbacks `loss`, `gradient`, `residuals` and `linearise` are called by
 * several threads at once, each with its own tape. All callbacks must be pure functions of their arguments. A
 * callback that fails returns a status other than LG_OK, which ends lg_fit_run; so does a tape that fails.
 * Their argument `samples` lists indices of samples, from 0. A batch has `batch` samples, and a callback
 * gets a part of it, `count` >= 1 samples. */
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
     * `own` of them to sample 0, the next `own` to sample 1, and so on. The residuals of a sample may depend
     * only on the elements before all these, which all samples share, and on its own ones. LG_FIT_LM then
     * computes derivatives by the own parameters of all samples at the same time, and eliminates these
     * parameters. */
    size_t own;
    /* For LG_FIT_LM, may be NULL. Computes numerically what LG_FIT_LM otherwise gets by forward sweeps over
     * `residuals`, at the values `theta`: *loss, r (count * rows) and the Jacobian of r (count * rows,
     * columns). The columns belong to the shared parameters, followed by the `own` parameters of the row's
     * sample. *loss, J^T r and J^T J must be those of `residuals`; components of r that are orthogonal to all
     * columns of J may be left out. `tape` may be used for work. */
    lg_status (*linearise)(void *user, lg_tape *tape, const double *theta, const uint32_t *samples,
                           size_t count, size_t batch, double *loss, double *r, double *jacobian);
    size_t rows; /* rows of `linearise` per sample */
    /* For lg_fit_options.prior: how many measured numbers of the training part the loss is the mean square
     * error of. 0: unknown, and there is no prior. */
    size_t observations;
    size_t weights; /* the prior is on the first `weights` elements of theta; 0: on all */
    /* (parameters) or NULL. Methods other than Adam add the sum of decay[i]/2 theta_i^2 to the loss, in
     * addition to the weight decay of the options. Reported losses do not contain it. */
    const double *decay;
    /* Largest number of samples that are on a tape at once; a larger shard is processed in pieces. Small
     * pieces keep the values in the processor's cache. 0: LG_FIT_CHUNK. */
    size_t chunk;
    /* True: `loss` usually records the same operations for the same number of samples, and only the values
     * of leaves (lg_input, lg_parameter) differ. lg_fit then makes a plan (liegrad/program.h) of the
     * loss and its gradient. In fits of machines a plan is faster than the tape for every width of the
     * layers. A plan of convolutions or of Lie group maps is slower than the tape (docs/reports/speed.md).
     * Results of a plan differ from results of the tape by rounding. lg_fit_create records the loss once. If
     * `loss` reads values from the tape, lg_fit uses the tape. */
    bool repeats;
    /* May be NULL. It tells whether a model is dead, that is, whether it cannot learn any more
     * (lg_fit_options.restarts). `theta` holds the current parameters. If the model is dead, it sets *dead to
     * true and replaces `theta` by parameters to start again from, for restart number `number` = 1, 2, ... It
     * is called on the thread of lg_fit_run, and may allocate memory. */
    lg_status (*revive)(void *user, uint64_t number, double *theta, bool *dead);
} lg_fit_problem;

/* What a sample or a row of data is used for. */
typedef enum lg_part { LG_PART_NONE, LG_PART_TRAIN, LG_PART_TEST, LG_PART_VALIDATION } lg_part;
#define LG_PART_COUNT 4

typedef struct lg_fit lg_fit;

/* ---- training: methods and plans ---- */

/* Methods of training. There are more methods than this enum has names; lg_fit_plan_parse finds them by
 * name. "sgd": a step per batch, theta <- theta - lr rate m with m <- beta1 m + g, where g is the gradient;
 * it takes the options of Adam except beta2 and eps. */
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
/* Reads a plan from a text: "ssbroyden", or "adam:100,ssbroyden" (100 epochs of Adam, then SSBroyden). With
 * `squares` false, for losses that are no sum of squares, methods that need such a sum are unknown. Errors:
 * LG_INVALID_ARGUMENT (an unknown method, or bad numbers). */
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
 * Unless a comment says otherwise, a member has the meaning of the member of lg_fit_options with the same
 * name. */
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
    /* Adam: the mean of the batch losses, weighted by the number of samples; each batch loss is taken before
     * the step on this batch. Other methods: the loss of all training samples at the best point so far,
     * without weight decay and prior. */
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
    /* Number of shards of a batch, 0 to 1024; a batch has at most as many shards as samples. Each shard has
     * its own gradient, so take 1 for a model that is large compared with the batch; threads that have no
     * shard then help with large matrix products. 0 (default): chosen by the amount of work, as the largest
     * of 1, 2 and 4 such that each shard has at least 24 samples and 6e4 samples * parameters. It is more, up
     * to 4, if a shard would otherwise have more than lg_fit_problem.chunk samples. */
    uint32_t shards;
    lg_adam_options adam; /* default: as set by lg_adam_options_init */
    lg_schedule schedule; /* default: constant */
    /* 0 (default): off. Otherwise the standard deviation s of the prior distribution N(0, s^2) of the
     * weights. It keeps SSBroyden and L-BFGS from learning the noise in the data; the other methods do not
     * use it. The variance v of the noise is estimated: it is 0 until 50 iterations have lowered the loss
     * L by less than a tenth; then v is L. From then on L + W/2 |w|^2 is minimised with W = 2 v/(n s^2),
     * which gives the most probable weights for normal noise. n is lg_fit_problem.observations, and w are the
     * elements of theta selected by lg_fit_problem.weights. If L falls below v/2 later, v was too large and
     * becomes 0 again. With keep_best the best epoch may be one before the prior acts. */
    double prior;
    double clip_norm;  /* bound on the Euclidean norm of Adam's gradient; default 0: no bound */
    uint64_t seed;     /* of the random numbers; default 1 */
    double validation; /* fraction of the samples, drawn at random, for validation; in [0, 1), default 0 */
    bool shuffle;      /* true (default): Adam takes the training samples in a new order in each epoch */
    /* true: the result (lg_fit_parameters) are the parameters after the epoch with the lowest criterion.
     * false (default): the last parameters. */
    bool keep_best;
    /* Training ends after this many epochs without a new lowest criterion. For a minimiser, accepted steps
     * are counted instead of epochs. Default 0: no limit. */
    uint64_t patience;
    /* Largest number of restarts of a dead model; default 0: none. If > 0, lg_fit_problem.revive is asked
     * after each epoch. If the model is dead, training starts again with other parameters, at epoch 0 and
     * with an empty history. There is no restart when the seconds are used up. With keep_best there is none
     * either, if the best epoch's criterion is below 0.9 times the dead model's criterion. */
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
    /* May be NULL. It is called on the thread of lg_fit_run when the state should be saved: as
     * `checkpoint_every` says, and when lg_fit_run returns before the plan is finished, because of
     * stop_after, the cancel flag or on_epoch. A status other than LG_OK ends lg_fit_run. With ranks it is
     * called on rank 0 only. */
    lg_status (*checkpoint)(void *user, const lg_fit *fit);
    /* May be NULL. It is called after each epoch. If it returns a number other than 0, lg_fit_run returns
     * LG_CANCELLED. With ranks it is called on every rank, and must return the same number on all. */
    int (*on_epoch)(void *user, const lg_fit_epoch *report);
    void *user; /* passed to `checkpoint` and `on_epoch` */
    /* NULL (default): one process. Otherwise ranks that train together (liegrad/core.h), which must outlive
     * the fit. Each rank computes its part of the shards, so ranks beyond the number of shards have nothing
     * to do. The result does not depend on the number of ranks. Wall times are measured on rank 0, and the
     * cancel flag of any rank stops all ranks. */
    const lg_ranks *ranks;
} lg_fit_options;

/* Sets the defaults that lg_fit_options names. */
LG_API void lg_fit_options_init(lg_fit_options *options);
/* Copies the hyperparameters to *options, and leaves its other members. keep_best becomes true if
 * training->validation > 0. */
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
 * epochs are done. Otherwise it returns an error. In every case the state is between two batches: it can be
 * saved, and a further lg_fit_run continues from it with the same bits as a run that was never interrupted.
 * The gradients and losses of the shards are added in a fixed order, so the result depends on options.shards,
 * to the last bit, but not on options.threads. After the first batches no memory is allocated. With ranks it
 * is collective. Errors:
 * - LG_CANCELLED: the context's cancel flag, which is read between batches, or on_epoch
 * - LG_NOT_FINITE: a loss, gradient, parameter or moment of Adam is NaN or infinite. The state is the one
 *   before this step. The message names the epoch, the batch and the value. A minimiser only fails if this
 *   happens at its first evaluation; later its line search shortens the step.
 * - LG_OUT_OF_MEMORY, the status of a callback of the problem, of the tape, of `checkpoint` or of an exchange
 *   between ranks */
LG_API lg_status lg_fit_run(lg_fit *fit, lg_error *error);

/* Return whether and why training is finished. A fit that is finished because its seconds are used up can be
 * continued: save it, and load the state into a fit that has more seconds. The sentence has no full stop and
 * static storage; it is "" while training is not finished. */
LG_API bool lg_fit_finished(const lg_fit *fit);
LG_API lg_fit_end lg_fit_why_finished(const lg_fit *fit);
LG_API const char *lg_fit_end_sentence(const lg_fit *fit);
/* Returns the method of the next epoch; if training is finished, the method of the last epoch. */
LG_API lg_fit_method lg_fit_method_now(const lg_fit *fit);

/* Saves the whole state, as optimizer/..., rng, minimise/... (lg_minimiser_save) and train/... With ranks,
 * only rank 0 can save, in `checkpoint` and after lg_fit_run; the state can be loaded by any number of ranks.
 * Errors: the status of the writer, LG_UNSUPPORTED (this rank does not have the whole state). */
LG_API lg_status lg_fit_save(const lg_fit *fit, const lg_archive_writer *writer, lg_error *error);
/* Replaces the state by a saved one. On failure the state is unchanged. With ranks it is collective. Errors:
 * LG_INVALID_ARGUMENT (a hyperparameter, the number of parameters or the number of samples differs: the
 * message names it and both values), LG_FORMAT (an impossible state: an order of samples that is no
 * permutation, a position that is no batch boundary, numbers that are not finite), the status of the
 * reader. */
LG_API lg_status lg_fit_load(lg_fit *fit, const lg_archive_reader *reader, lg_error *error);

/* Copies the result to theta (problem->parameters doubles): with options.keep_best the parameters of the best
 * epoch, if an epoch is finished; otherwise the current parameters. */
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
/* Returns the median wall time of an epoch. The first epoch is left out, unless it is the only one; NaN if no
 * epoch is finished. */
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

/* Minimises the loss of all samples to rounding by lg_minimise (liegrad/minimise.h), whose last steps are
 * Newton's, with a Hessian from differences of gradients, where there are at most 200 parameters. theta
 * (problem->parameters doubles) is the start on entry and the result on return. Of the problem only
 * parameters, samples, loss, user and, without a loss, residuals are read. All samples are on one tape of
 * doubles. `result` may be NULL. Returns LG_OK also where lg_minimise returns LG_NO_CONVERGENCE. On failure
 * theta is unchanged. Errors: LG_INVALID_ARGUMENT (no samples, or the number of parameters is not in
 * 1..LG_NEWTON_MAX_PARAMETERS), LG_NOT_FINITE, LG_CANCELLED, the status of the callback or of the tape. */
LG_API lg_status lg_fit_newton(const lg_context *context, const lg_fit_problem *problem, double *theta,
                               lg_fit_newton_result *result);

/* ---- training of programs ----
 *
 * lg_program_fit finds the parameters of a program (liegrad/program.h) for which one of its functions, the
 * loss or the residuals, becomes as small as possible over rows of data. A program that was loaded from a
 * file can be trained in the same way.
 *
 * In this example the program has the functions `value` and `error` = value - wanted:
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
     * done": the limit of epochs or evaluations was reached, and the loss may fall further with a higher
     * limit. */
    const char *end;
    uint32_t start; /* number of the best start, from 0; 0 without lg_fit_starts */
} lg_program_fit_result;

/* Random starts of a training, because the training of a network can end in a poor minimum. draw is called
 * for each parameter of the program; `values` are its `count` numbers as the program has them, and draw may
 * replace them. Each start has its own random numbers. For an lg_mlp, `draw` is lg_mlp_draw and `user` is the
 * address of the lg_mlp. A parameter that is no network, such as a mass, keeps its value then. */
typedef struct lg_fit_starts {
    uint32_t count; /* number of starts, >= 1 */
    void (*draw)(void *user, size_t parameter, size_t count, lg_rng *rng, double *values);
    void *user;    /* passed to `draw` */
    uint64_t seed; /* of the random numbers */
} lg_fit_starts;

/* Trains all parameters of the program. The first output of `function` decides what is minimised:
 *   batched (B, ...)          the mean of the squares of all its numbers, over all rows
 *   shared, with one number   this number itself, which must be a mean over the rows (as lg_mean computes it)
 * Rows are trained on in pieces, so rows must not depend on each other, and a sum over rows would give wrong
 * results. Both are tested before and after training, on up to 8 rows from all over the data: their loss
 * together must be the mean of their single losses.
 *
 * data[i] are the values of input i: `rows` rows, one after the other; for a shared input its single value.
 *
 * `options` NULL: trains in double precision with at most 1000 evaluations, fewer if the loss does not fall
 * any more. The method is L-BFGS for more than 2000 numbers in the parameters, otherwise Levenberg-Marquardt
 * if a sum of squares is minimised and there are at most 64 numbers, otherwise SSBroyden. To change one of
 * these options, begin with lg_program_fit_options_init, not with lg_fit_options_init, whose method is Adam.
 * If the data have noise and the parameters are weights of a network, set `prior`, such as 0.1. It acts
 * with SSBroyden and L-BFGS on an output with a value per row.
 *
 * `starts` NULL: training begins with the parameters of the program. Otherwise it is repeated from each
 * start, and the parameters with the lowest loss are kept. A start whose training fails with LG_NOT_FINITE
 * is skipped. The result describes the best start, but its seconds are the time of all starts.
 *
 * On success the parameters of the program are replaced. On failure the program is unchanged. `result` may be
 * NULL. Errors: LG_NOT_FOUND (no such function), LG_INVALID_ARGUMENT (no rows, no starts; the output depends
 * on no parameter, is shared and has several numbers, or fails the test above), LG_UNSUPPORTED (more than
 * LG_PROGRAM_FIT_MOST parameters), LG_NOT_FINITE (data; as in lg_fit_run, in all starts), the errors of
 * lg_fit_create, lg_fit_run and of operations. */
LG_API lg_status lg_program_fit(const lg_context *context, lg_program *program, const char *function,
                                const double *const *data, size_t rows, const lg_fit_options *options,
                                const lg_fit_starts *starts, lg_program_fit_result *result, lg_error *error);

/* Sets the options that lg_program_fit takes if its `options` are NULL. Errors: LG_INVALID_ARGUMENT,
 * LG_NOT_FOUND, LG_UNSUPPORTED, as for lg_program_fit. */
LG_API lg_status lg_program_fit_options_init(const lg_program *program, const char *function,
                                             lg_fit_options *options, lg_error *error);
/* Computes what lg_program_fit minimises, with the parameters of the program and for other data, such as rows
 * that were not learned. Errors: those of lg_program_fit. */
LG_API lg_status lg_program_loss(const lg_context *context, const lg_program *program, const char *function,
                                 const double *const *data, size_t rows, double *loss, lg_error *error);

LG_END_DECLS

#endif

/* The training loop: options, epochs, validation, checkpoints, accessors. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/clean.h"
#include "core/median.h"
#include "core/portions.h"
#include "nn/fit_internal.h"

#define RNG_STREAM 0x66697400u /* gives other random numbers than an initialisation with the same seed */

/* ---- options ---- */

void lg_fit_options_init(lg_fit_options *options) {
    *options = (lg_fit_options){
        .size = sizeof *options,
        .dtype = LG_F64,
        .epochs = 100,
        .schedule = {.kind = LG_SCHEDULE_CONSTANT, .every = 1, .gamma = 1.0, .floor = 0.0},
        .seed = 1,
        .shuffle = true,
        .threads = 1,
    };
    lg_adam_options_init(&options->adam);
}

void lg_fit_settings_apply(const lg_fit_settings *training, lg_fit_options *options) {
    options->plan = training->plan;
    options->dtype = training->dtype;
    options->epochs = training->epochs;
    options->batch = (size_t)training->batch;
    options->shards = training->shards;
    options->adam.lr = training->lr;
    options->adam.weight_decay = training->weight_decay;
    options->adam.eps = training->adam_eps;
    options->prior = training->prior;
    options->clip_norm = training->clip;
    options->schedule.kind = training->schedule;
    options->schedule.every = training->lr_step;
    options->schedule.gamma = training->lr_gamma;
    options->schedule.floor = training->schedule == LG_SCHEDULE_COSINE ? training->lr_gamma : 0.0;
    options->seed = training->seed;
    options->validation = training->validation;
    options->keep_best = training->validation > 0;
    options->patience = training->patience;
}

static bool positive(double x) {
    return x > 0.0 && isfinite(x);
}

static bool not_negative(double x) {
    return x >= 0.0 && isfinite(x);
}

/* Whether x is in [0, 1). */
static bool fraction(double x) {
    return x >= 0.0 && x < 1.0;
}

static lg_status check_problem(const lg_fit_problem *problem, lg_error *error) {
    if (problem == NULL || (problem->loss == NULL && problem->residuals == NULL &&
                            problem->linearise == NULL && problem->gradient == NULL))
        return lg_fail(error, LG_INVALID_ARGUMENT, "the problem has neither a loss function nor residuals");
    if (problem->parameters == 0 || problem->parameters > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the problem has %zu parameters; 1 to 2^32 - 1 are possible", problem->parameters);
    if (problem->samples == 0 || problem->samples > UINT32_MAX)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the problem has %zu samples; 1 to 2^32 - 1 are possible",
                       problem->samples);
    if (problem->validation >= problem->samples)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%zu of %zu samples are the validation part: none is left to train on",
                       problem->validation, problem->samples);
    return LG_OK;
}

static lg_status check_options(const lg_fit_problem *problem, const lg_fit_options *o, lg_error *error) {
    const lg_schedule *s = &o->schedule;
    const lg_rule rules[] = {
        {o->dtype == LG_F64 || o->dtype == LG_F32, "dtype must be LG_F64 or LG_F32"},
        {o->epochs >= 1 && o->epochs <= UINT32_MAX, "epochs must be 1 to 2^32 - 1"},
        {o->shards <= 1024, "shards must be 0 to 1024"},
        {o->threads >= 1 && o->threads <= 1024, "threads must be 1 to 1024"},
        {positive(o->adam.lr), "lr must be positive and finite"},
        {fraction(o->adam.beta1) && fraction(o->adam.beta2), "beta1 and beta2 must be in [0, 1)"},
        {positive(o->adam.eps), "eps must be positive and finite"},
        {not_negative(o->adam.weight_decay), "weight_decay must be finite and not negative"},
        {(int)s->kind >= 0 && (int)s->kind < LG_SCHEDULE_COUNT, "the schedule is unknown"},
        {s->kind != LG_SCHEDULE_STEP || s->every >= 1, "the schedule's epochs per step must be at least 1"},
        {s->kind != LG_SCHEDULE_STEP || positive(s->gamma),
         "the schedule's gamma must be positive and finite"},
        {s->kind != LG_SCHEDULE_COSINE || (s->floor >= 0.0 && s->floor <= 1.0),
         "the schedule's floor must be in [0, 1]"},
        {not_negative(o->prior), "prior must be finite and not negative"},
        {not_negative(o->clip_norm), "clip_norm must be finite and not negative"},
        {not_negative(o->seconds), "seconds must be finite and not negative"},
        {fraction(o->validation), "validation must be in [0, 1)"},
        {!(o->validation > 0.0) || problem->samples >= 2, "a validation part needs at least 2 samples"},
        {!(o->validation > 0.0) || problem->validation == 0,
         "validation must be 0 because the problem already has a validation part"},
    };
    for (size_t i = 0; i < LG_COUNT(rules); i++)
        if (!rules[i].good)
            return lg_fail(error, LG_INVALID_ARGUMENT, "training options: %s", rules[i].sentence);
    return lg_fit_check_plan(problem, o, error);
}

/* Number of validation samples: the problem's own ones, or else `part` of all samples, rounded such that both
 * parts have at least one sample. */
static size_t validation_samples(const lg_fit_problem *problem, double part) {
    if (!(part > 0.0)) return problem->validation;
    const size_t count = (size_t)floor(part * (double)problem->samples + 0.5);
    if (count == 0) return 1;
    return count < problem->samples ? count : problem->samples - 1;
}

/* ---- memory ---- */

/* Places the arrays of a state in `memory`, or counts their bytes if it is NULL. */
static size_t place(const lg_fit *fit, void *memory, lg_fit_state *s) {
    void **const vectors[] = {&s->theta, &s->m, &s->v, &s->best};
    lg_portions from = {memory, 0};
    for (size_t i = 0; i < LG_COUNT(vectors); i++)
        *vectors[i] = lg_portion(&from, fit->problem.parameters, fit->k->size);
    s->order = lg_portion(&from, fit->problem.samples, sizeof *s->order);
    for (size_t i = 0; i < LG_FIT_SERIES_COUNT; i++)
        s->history[i] = lg_portion(&from, (size_t)fit->options.epochs, sizeof(double));
    return from.used;
}

lg_status lg_fit_state_create(const lg_fit *fit, lg_fit_state *out) {
    lg_fit_state made = {0};
    made.memory = lg_alloc(fit->context, place(fit, NULL, &made), 1);
    if (made.memory == NULL) return LG_OUT_OF_MEMORY;
    (void)place(fit, made.memory, &made);
    *out = made;
    return LG_OK;
}

void lg_fit_state_destroy(const lg_fit *fit, lg_fit_state *state) {
    lg_free(fit->context, state->memory);
    lg_minimiser_destroy(state->minimiser);
    *state = (lg_fit_state){0};
}

static lg_status create_shards(lg_fit *fit) {
    lg_tape_options tape;
    lg_tape_options_init(&tape);
    tape.dtype = fit->options.dtype;
    tape.max_size = fit->options.max_tape_size;
    tape.threads = fit->options.threads / (int)fit->options.shards;
    if (tape.threads < 1) tape.threads = 1;
    fit->shards = lg_alloc(fit->context, fit->options.shards, sizeof *fit->shards);
    if (fit->shards == NULL) return LG_OUT_OF_MEMORY;
    fit->used = fit->training < fit->options.shards ? fit->training : fit->options.shards;
    LG_TRY(lg_fit_ranks_create(fit));
    for (size_t i = fit->first; i < fit->end; i++)
        LG_TRY(lg_tape_create(fit->context, &tape, &fit->shards[i].tape));
    for (size_t i = 0; i < fit->used; i++) {
        if (!lg_fit_holds(fit, i)) continue;
        fit->shards[i].gradient = lg_alloc(fit->context, fit->problem.parameters, fit->k->size);
        if (fit->shards[i].gradient == NULL) return LG_OUT_OF_MEMORY;
    }
    return LG_OK;
}

static lg_status create_machinery(lg_fit *fit) {
    const size_t n = fit->problem.parameters;
    LG_TRY(lg_fit_state_create(fit, &fit->state));
    LG_TRY(create_shards(fit));
    fit->blocks = (n + LG_FIT_BLOCK - 1) / LG_FIT_BLOCK;
    LG_TRY(LG_ALLOC_ALL(fit->context, LG_ARRAY(fit->partial, fit->blocks),
                        {&fit->backup, 3 * n, fit->k->size}, LG_ARRAY(fit->scratch, fit->options.epochs)));
    if (fit->options.restarts > 0 && fit->problem.revive != NULL)
        LG_TRY(LG_ALLOC_ALL(fit->context, LG_ARRAY(fit->revived, n)));
    return lg_thread_pool_create(fit->context, fit->options.threads, &fit->pool);
}

static void start(lg_fit *fit, const double *theta) {
    lg_fit_state *s = &fit->state;
    fit->k->convert_in(fit->problem.parameters, theta, s->theta);
    for (size_t i = 0; i < fit->problem.samples; i++) s->order[i] = (uint32_t)i;
    lg_rng_seed(&s->rng, fit->options.seed, RNG_STREAM);
    if (fit->options.validation > 0.0) lg_rng_shuffle(&s->rng, s->order, fit->problem.samples);
}

lg_status lg_fit_create(const lg_context *context, const lg_fit_problem *problem,
                        const lg_fit_options *options, const double *theta, lg_fit **out, lg_error *error) {
    lg_fit_options chosen;
    lg_fit_options_init(&chosen);
    if (options != NULL && options->size != sizeof *options)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the size of the training options is %zu, expected %zu",
                       options->size, sizeof *options);
    if (options != NULL) chosen = *options;
    if (theta == NULL || out == NULL) return lg_fail(error, LG_INVALID_ARGUMENT, "theta or `out` is NULL");
    LG_TRY(check_problem(problem, error));
    LG_TRY(check_options(problem, &chosen, error));

    LG_CLEAN(lg_fit_destroy_at) lg_fit *fit = lg_alloc(context, 1, sizeof *fit);
    if (fit == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the training state");
    fit->context = context;
    fit->problem = *problem;
    fit->options = chosen;
    fit->plans = problem->repeats && problem->gradient == NULL;
    fit->by_work = chosen.shards == 0;
    if (fit->by_work) fit->options.shards = LG_FIT_PIECES;
    fit->k = lg_kernels_for(chosen.dtype);
    fit->training = problem->samples - validation_samples(problem, chosen.validation);
    fit->batch = chosen.batch == 0 || chosen.batch > fit->training ? fit->training : chosen.batch;
    lg_status status = create_machinery(fit);
    if (status != LG_OK)
        (void)lg_fail(error, status, "no memory for the training state of %zu parameters",
                      problem->parameters);
    LG_TRY(lg_fit_agree(fit, status, error));
    LG_TRY(lg_fit_share_seconds(fit, &fit->options.seconds));
    start(fit, theta);
    if (!fit->k->all_finite(problem->parameters, fit->state.theta))
        return lg_fail(error, LG_NOT_FINITE,
                       "the initial parameters are not finite in the type (dtype) of the training");
    status = lg_fit_agree(fit, lg_fit_try_recording(fit), error);
    if (status != LG_OK) return lg_fail(error, status, "no memory for a plan of the loss");
    return LG_MOVE(out, fit);
}

void lg_fit_destroy(lg_fit *fit) {
    if (fit == NULL) return;
    lg_thread_pool_destroy(fit->pool);
    for (size_t i = 0; fit->shards != NULL && i < fit->options.shards; i++) {
        lg_tape_destroy(fit->shards[i].tape);
        lg_fit_recordings_destroy(fit, &fit->shards[i]);
        LG_FREE_ALL(fit->context, fit->shards[i].gradient, fit->shards[i].matrix, fit->shards[i].jacobian);
    }
    lg_free(fit->context, fit->shards);
    lg_fit_ranks_destroy(fit);
    LG_FREE_ALL(fit->context, fit->partial, fit->backup, fit->scratch, fit->revived);
    lg_fit_state_destroy(fit, &fit->state);
    lg_free(fit->context, fit);
}

/* ---- epochs ---- */

/* Called at the start of an epoch, or when an interrupted epoch continues. Within one epoch the parameters
 * cannot grow so much that a step of moderate size might overflow. */
static void measure_parameters(lg_fit *fit) {
    fit->largest = sqrt(fit->k->dot(fit->problem.parameters, fit->state.theta, fit->state.theta));
}

/* Draws the order of the samples for a new epoch. */
static void open_epoch(lg_fit *fit) {
    lg_fit_state *s = &fit->state;
    if (s->open) return;
    if (fit->options.shuffle) lg_rng_shuffle(&s->rng, s->order, fit->training);
    s->running_loss = 0.0;
    s->open = true;
}

/* Ranks do not read the flag here: they stop together, after the exchange of a batch. */
static bool to_stop(const lg_fit *fit) {
    return lg_fit_alone(fit) && lg_cancelled(fit->context);
}

/* Takes steps on the batches that are left of this epoch. */
static lg_status train_batches(lg_fit *fit, double rate, lg_error *error) {
    lg_fit_state *s = &fit->state;
    measure_parameters(fit);
    while (s->position < fit->training) {
        if (to_stop(fit)) return lg_fit_cancelled(fit, error);
        open_epoch(fit);
        const size_t rest = fit->training - (size_t)s->position;
        const size_t count = rest < fit->batch ? rest : fit->batch;
        double loss = 0.0;
        LG_TRY(lg_fit_step(fit, s->order + s->position, count, rate, &loss, error));
        s->running_loss += loss * (double)count;
        s->position += count;
        s->step++;
    }
    return LG_OK;
}

/* Mean loss of the validation part, in batches of the training size; NaN if there is no such part. */
static lg_status validate(lg_fit *fit, double *loss, lg_error *error) {
    const size_t total = fit->problem.samples - fit->training;
    const uint32_t *samples = fit->state.order + fit->training;
    char what[64];
    (void)snprintf(what, sizeof what, "epoch %" PRIu64 ", validation", fit->state.epoch + 1);
    double sum = 0.0;
    fit->point = fit->state.theta;
    for (size_t done = 0; done < total;) {
        const size_t count = total - done < fit->batch ? total - done : fit->batch;
        double part = 0.0;
        LG_TRY(lg_fit_batch_loss(fit, samples + done, count, LG_FIT_VALUE, what, &part, error));
        sum += part * (double)count;
        done += count;
    }
    *loss = total > 0 ? sum / (double)total : NAN;
    return LG_OK;
}

/* Writes a finished epoch into the history and makes the state ready for the next one. */
static void close_epoch(lg_fit *fit, lg_fit_epoch *report) {
    lg_fit_state *s = &fit->state;
    report->loss = s->running_loss / (double)fit->training;
    report->seconds = s->running_seconds;
    report->epoch = s->epoch + 1;
    report->epochs = fit->options.epochs;
    s->history[LG_FIT_LOSS][s->epoch] = report->loss;
    s->history[LG_FIT_VALIDATION][s->epoch] = report->validation;
    s->history[LG_FIT_SECONDS][s->epoch] = report->seconds;
    s->history[LG_FIT_RATE][s->epoch] = report->rate;
    s->adam_epochs += lg_fit_method_batches(lg_fit_method_now(fit));
    s->epoch++;
    s->position = 0;
    s->open = false;
    s->running_loss = s->running_seconds = 0.0;
    fit->spent += report->seconds;
    report->best =
        s->best_epoch == 0 || lg_fit_criterion(fit, s->epoch) < lg_fit_criterion(fit, s->best_epoch);
    if (!report->best) return;
    s->best_epoch = s->epoch;
    memcpy(s->best, s->theta, fit->problem.parameters * fit->k->size);
}

/* An epoch of a minimiser: one evaluation. The validation loss is computed only if theta has changed. */
static lg_status evaluate_epoch(lg_fit *fit, lg_fit_epoch *report, lg_error *error) {
    const lg_fit_state *s = &fit->state;
    bool moved = false;
    if (to_stop(fit)) return lg_fit_cancelled(fit, error);
    LG_TRY(lg_fit_evaluate(fit, &moved, error));
    if (moved || s->epoch == 0) return validate(fit, &report->validation, error);
    report->validation = s->history[LG_FIT_VALIDATION][s->epoch - 1];
    return LG_OK;
}

static lg_status batch_epoch(lg_fit *fit, lg_fit_epoch *report, lg_error *error) {
    const lg_fit_options *o = &fit->options;
    const double late = o->hurry && o->seconds > 0.0 ? fmin(fit->spent / o->seconds, 1.0) : 0.0;
    const uint64_t by_time = (uint64_t)(late * (double)o->epochs), epoch = fit->state.epoch;
    const double factor = lg_schedule_rate(&o->schedule, by_time > epoch ? by_time : epoch, o->epochs);
    report->rate = fit->options.adam.lr * factor;
    LG_TRY(train_batches(fit, factor, error));
    return validate(fit, &report->validation, error);
}

static lg_status run_epoch(lg_fit *fit, lg_fit_epoch *report, lg_error *error) {
    const double begin = lg_seconds();
    report->validation = NAN;
    const bool batches = lg_fit_method_batches(lg_fit_method_now(fit));
    lg_status status = batches ? batch_epoch(fit, report, error) : evaluate_epoch(fit, report, error);
    fit->state.running_seconds += lg_seconds() - begin;
    if (status == LG_OK) status = lg_fit_share_seconds(fit, &fit->state.running_seconds);
    fit->cost.seconds += lg_seconds() - begin;
    LG_TRY(status);
    close_epoch(fit, report);
    lg_fit_next_phase(fit);
    return LG_OK;
}

/* ---- dead models ---- */

/* Resets the state to that before the first epoch, with other parameters. */
static void begin_again(lg_fit *fit, const double *theta) {
    lg_fit_state *s = &fit->state, fresh = {.restarts = s->restarts + 1, .lost_seconds = fit->spent};
    fresh.memory = s->memory;
    s->memory = NULL;
    lg_fit_state_destroy(fit, s);
    memset(fresh.memory, 0, place(fit, fresh.memory, &fresh));
    *s = fresh;
    start(fit, theta);
}

/* Whether the best epoch is clearly better than the current one, whose model may be dead. */
static bool has_learned(const lg_fit *fit) {
    static const double BETTER = 0.9;
    const lg_fit_state *s = &fit->state;
    return fit->options.keep_best &&
           lg_fit_criterion(fit, s->best_epoch) < BETTER * lg_fit_criterion(fit, s->epoch);
}

static lg_status revive(lg_fit *fit, lg_error *error) {
    bool dead = false;
    if (fit->revived == NULL || fit->state.restarts >= fit->options.restarts || has_learned(fit) ||
        lg_fit_why_finished(fit) == LG_FIT_END_SECONDS)
        return LG_OK;
    lg_fit_current_parameters(fit, fit->revived);
    const lg_status status =
        fit->problem.revive(fit->problem.user, fit->state.restarts + 1, fit->revived, &dead);
    if (status != LG_OK)
        (void)lg_fail(error, status,
                      "epoch %" PRIu64 ": the check for a model that no longer learns failed: %s",
                      fit->state.epoch, lg_status_sentence(status));
    LG_TRY(lg_fit_agree(fit, status, error));
    if (dead) begin_again(fit, fit->revived);
    return LG_OK;
}

/* ---- running ---- */

/* Rank 0 gets what it needs to save the minimiser. */
static lg_status collect(lg_fit *fit, lg_error *error) {
    return fit->state.minimiser == NULL ? LG_OK : lg_minimiser_collect(fit->state.minimiser, error);
}

static lg_status checkpoint(lg_fit *fit, lg_error *error) {
    if (fit->options.checkpoint == NULL) return LG_OK;
    LG_TRY(collect(fit, error));
    const bool saves = lg_fit_alone(fit) || fit->options.ranks->rank == 0;
    const lg_status status = saves ? fit->options.checkpoint(fit->options.user, fit) : LG_OK;
    if (fit->state.minimiser != NULL) lg_minimiser_scatter(fit->state.minimiser);
    if (status != LG_OK)
        (void)lg_fail(error, status, "the checkpoint after %" PRIu64 " epochs failed: %s", fit->state.epoch,
                      lg_status_sentence(status));
    return lg_fit_agree(fit, status, error);
}

/* Ends a run before the plan is finished: makes a checkpoint, unless the state is saved already, and returns
 * `status`. saved: the state at the end of the last epoch is saved. */
static lg_status leave(lg_fit *fit, lg_status status, bool saved, lg_error *error) {
    if (!saved || fit->state.position > 0) LG_TRY(checkpoint(fit, error));
    return status;
}

static lg_status run(lg_fit *fit, lg_error *error) {
    const lg_fit_options *o = &fit->options;
    bool saved = false;
    for (uint64_t done = 0; !lg_fit_finished(fit); done++) {
        if (o->stop_after > 0 && done == o->stop_after) return leave(fit, LG_OK, saved, error);
        lg_fit_epoch report = {0};
        const lg_status status = run_epoch(fit, &report, error);
        if (status == LG_CANCELLED) return leave(fit, status, saved, error);
        if (status != LG_OK) return status;
        const bool stop = o->on_epoch != NULL && o->on_epoch(o->user, &report) != 0;
        LG_TRY(revive(fit, error));
        saved = o->checkpoint_every > 0 && fit->state.epoch % o->checkpoint_every == 0;
        if (saved) LG_TRY(checkpoint(fit, error));
        if (!stop || lg_fit_finished(fit)) continue;
        (void)lg_fail(error, LG_CANCELLED, "stopped after epoch %" PRIu64, fit->state.epoch);
        return leave(fit, LG_CANCELLED, saved, error);
    }
    return LG_OK;
}

lg_status lg_fit_run(lg_fit *fit, lg_error *error) {
    LG_NEEDS(error, fit);
    if (fit->state.minimiser != NULL) lg_minimiser_scatter(fit->state.minimiser);
    const lg_status status = run(fit, error);
    if (lg_fit_alone(fit)) return status;
    const lg_status collected = collect(fit, status == LG_OK ? error : NULL);
    const lg_status end = status == LG_OK ? collected : status;
    const lg_ranks *ranks = fit->options.ranks;
    /* LG_CANCELLED would say that the state is saved */
    return ranks->reason(ranks->user) != NULL ? lg_ranks_lost(ranks, LG_FILE, error) : end;
}

/* ---- accessors ---- */

void lg_fit_current_parameters(const lg_fit *fit, double *theta) {
    fit->k->convert_out(fit->problem.parameters, fit->state.theta, theta);
}

void lg_fit_parameters(const lg_fit *fit, double *theta) {
    const bool best = fit->options.keep_best && fit->state.best_epoch > 0;
    fit->k->convert_out(fit->problem.parameters, best ? fit->state.best : fit->state.theta, theta);
}

uint64_t lg_fit_epochs_done(const lg_fit *fit) {
    return fit->state.epoch;
}

uint64_t lg_fit_steps_done(const lg_fit *fit) {
    return fit->state.step + fit->state.epoch - fit->state.adam_epochs;
}

uint64_t lg_fit_best_epoch(const lg_fit *fit) {
    return fit->state.best_epoch;
}

uint64_t lg_fit_restarts(const lg_fit *fit) {
    return fit->state.restarts;
}

double lg_fit_loss(const lg_fit *fit) {
    return fit->state.epoch > 0 ? fit->state.history[LG_FIT_LOSS][fit->state.epoch - 1] : NAN;
}

const double *lg_fit_history(const lg_fit *fit, lg_fit_series series) {
    return fit->state.history[series];
}

double lg_fit_seconds_per_epoch(const lg_fit *fit) {
    const size_t epochs = (size_t)fit->state.epoch;
    if (epochs == 0) return NAN;
    const size_t skip = epochs > 1 ? 1 : 0, n = epochs - skip;
    memcpy(fit->scratch, fit->state.history[LG_FIT_SECONDS] + skip, n * sizeof *fit->scratch);
    return lg_median(fit->scratch, n);
}

lg_fit_cost lg_fit_cost_of(const lg_fit *fit) {
    return fit->cost;
}

bool lg_fit_by_plans(const lg_fit *fit) {
    return fit->plans;
}

size_t lg_fit_tape_size(const lg_fit *fit) {
    size_t bytes = 0, plans;
    for (size_t i = 0; i < fit->options.shards; i++)
        if (fit->shards[i].tape != NULL)
            bytes += lg_tape_size(fit->shards[i].tape) + lg_fit_recordings_size(&fit->shards[i], &plans);
    return bytes;
}

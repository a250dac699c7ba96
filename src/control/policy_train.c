/* Policies: training. A race of seeds by Adam, then more Adam for the winner, then L-BFGS. Every step draws
 * its starts from a separate generator, so that a resumed run continues with the same bits. */
#include <math.h>
#include <string.h>

#include "control/policy_gradient.h"
#include "core/stored.h"
#include "kernels/kernels.h"
#include "liegrad/fit.h"
#include "liegrad/minimise.h"

enum { VALIDATION = 512, FIXED = 512, LOOKS = 10, MOST_ROUNDS = 4 };
enum { RACE, FINISH, POLISH, DONE };

/* Streams of random numbers of a seed. */
enum { STREAM_VALIDATION = 2, STREAM_FIXED = 3, STREAM_STEPS = 16 };

typedef struct judged {
    double success, cost;
} judged;

struct lg_policy_trainer {
    lg_policy *policy;
    lg_policy_train_options options;
    size_t n;               /* parameters */
    uint32_t seeds, racers; /* racers: seeds that are left; they lie in the first slots of the arrays */
    uint64_t *number;       /* (seeds): of the seed in a slot */
    double *theta, *m, *v, *gradient; /* (seeds, parameters) */
    double *best;                     /* (parameters) */
    judged of_best;
    uint32_t phase, leader;
    uint64_t step;  /* of the phase */
    uint32_t round; /* of the phase FINISH: it is repeated while many runs fail */
    lg_policy_batch batch;
    double *x;          /* starts of a step (seeds, starts, state) or (FIXED, state) */
    double *validation; /* starts (VALIDATION, state) */
    double *cost, **gradients;
    lg_minimiser *minimiser; /* in the phase POLISH */
    double begun, phase_begun;
    lg_error *error;
};
typedef struct lg_policy_trainer training;
LG_AT(lg_policy_trainer_destroy, training)

void lg_policy_train_options_init(lg_policy_train_options *options) {
    *options = (lg_policy_train_options){.size = sizeof *options,
                                         .seeds = 8,
                                         .starts = 64,
                                         .race = 450,
                                         .finish = 1000,
                                         .polish = 100,
                                         .lr = 2e-2,
                                         .seed = 1,
                                         .threads = 1};
}

static lg_status check_options(const lg_policy_train_options *o, lg_error *error) {
    if (o->size != sizeof *o || o->seeds == 0 || o->seeds > 1000 || o->starts == 0 ||
        o->starts % LG_POLICY_ROWS != 0 || !(o->lr > 0.0) || !(o->seconds >= 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "training needs 1 to 1000 seeds, a multiple of %d starts, and a learning rate above 0",
                       LG_POLICY_ROWS);
    return LG_OK;
}

/* ---- starts and judgements ---- */

static lg_status draw_starts(const training *t, uint64_t stream, size_t count, double *x) {
    lg_rng rng;
    lg_rng_seed(&rng, t->options.seed, stream);
    return lg_policy_starts(t->policy, &rng, count, x, NULL, t->error);
}

static lg_status judge(const training *t, const double *theta, judged *out) {
    const lg_policy *p = t->policy;
    const lg_policy_trial trial = {.theta = theta,
                                   .disturbed = lg_policy_is_disturbed(&p->task),
                                   .seed = t->options.seed,
                                   .threads = t->options.threads};
    lg_policy_outcome found;
    LG_TRY(lg_policy_try(p, &trial, t->validation, VALIDATION, &found, NULL, t->error));
    *out = (judged){(double)found.succeeded / VALIDATION, found.cost_mean};
    return LG_OK;
}

static bool better(judged a, judged b) {
    if (!isfinite(a.cost)) return false;
    return a.success > b.success || (a.success == b.success && a.cost < b.cost) || !isfinite(b.cost);
}

/* If this share of the validation starts succeeds, racers are compared by cost, and no further round
 * follows. */
static const double enough = 0.995;

/* Whether racer a is before racer b. Above `enough`, success counts as equal. */
static bool leads(judged a, judged b) {
    a.success = fmin(a.success, enough), b.success = fmin(b.success, enough);
    return better(a, b);
}

/* Judges the parameters and keeps them if they are the best. */
static lg_status look(training *t, const double *theta, judged *found) {
    LG_TRY(judge(t, theta, found));
    if (!better(*found, t->of_best)) return LG_OK;
    t->of_best = *found;
    memcpy(t->best, theta, t->n * sizeof *theta);
    return LG_OK;
}

/* ---- time ---- */

/* How much of the phase is done, by steps, or by time if there is a bound on it: the phases get these
 * shares. */
static double done_of(const training *t, uint64_t steps) {
    static const double share[] = {0.5, 0.25, 0.25};
    const double by_steps = steps > 0 ? (double)t->step / (double)steps - t->round : 1.0;
    if (t->options.seconds == 0.0) return by_steps;
    double end = 0.0;
    for (uint32_t i = 0; i <= t->phase; i++) end += share[i];
    const double left = end * t->options.seconds - (t->phase_begun - t->begun);
    return fmax(by_steps, left > 0.0 ? (lg_seconds() - t->phase_begun) / left : 1.0);
}

/* How much of the phase is done, the same on all ranks. Errors: LG_CANCELLED (a rank is asked to stop before
 * the end of the phase), those of an exchange between ranks. */
static lg_status go_on(const training *t, uint64_t steps, double *done) {
    const lg_ranks *ranks = t->options.ranks;
    *done = done_of(t, steps);
    lg_status status = LG_OK;
    if (ranks != NULL && t->options.seconds > 0.0) status = lg_ranks_share(ranks, 0, done, sizeof *done);
    if (status != LG_OK) return lg_ranks_lost(ranks, status, t->error);
    if (*done >= 1.0) return LG_OK;
    status = lg_cancelled(t->policy->context) ? LG_CANCELLED : LG_OK;
    return ranks != NULL ? lg_ranks_agree(ranks, status, t->error) : status;
}

static void report(const training *t, double done) {
    if (t->options.progress == NULL) return;
    const uint64_t finish = (t->round + 1) * t->options.finish,
                   steps = t->options.race + finish + t->options.polish;
    const uint64_t before[] = {0, t->options.race + t->round * t->options.finish, t->options.race + finish};
    const uint64_t of[] = {t->options.race, t->options.finish, t->options.polish};
    const lg_policy_progress now = {.step = before[t->phase] + (uint64_t)(done * (double)of[t->phase]),
                                    .steps = steps,
                                    .seed = t->leader,
                                    .cost = t->of_best.cost,
                                    .success = t->of_best.success,
                                    .seconds = lg_seconds() - t->begun};
    t->options.progress(t->options.user, &now);
}

/* ---- Adam ---- */

/* The bound on the gradient's norm is in units of the cost: a thirteenth of the cost of the unforced
 * machine. */
static double clip_of(const training *t, const double *gradient) {
    const double bound = t->policy->terminal / 8.0;
    double sum = 0.0;
    for (size_t i = 0; i < t->n; i++) sum += gradient[i] * gradient[i];
    return sum > bound * bound ? bound / sqrt(sum) : 1.0;
}

static lg_status run_batch(training *t) {
    t->batch.ranks = t->options.ranks;
    const lg_status status = lg_policy_batch_run(&t->batch, t->cost, t->gradients);
    return status == LG_OK ? status : lg_ranks_lost(t->options.ranks, status, t->error);
}

/* Periods of the runs of a step. A few chaotic runs spoil the gradient of long runs. Short runs with the
 * terminal cost learn more and take less time. The best length depends on the machine, so racers have
 * different lengths. The winner keeps its length in the first round. Each further round makes it longer by
 * half. */
static size_t steps_of(const training *t, uint64_t seed) {
    static const double share[] = {0.3, 0.5, 0.4};
    const double part = fmin(1.0, share[seed % LG_COUNT(share)] * pow(1.5, t->round));
    return (size_t)ceil(part * (double)t->batch.most);
}

/* One step of all points. A point whose gradient is not finite stays where it is in this step. */
static lg_status adam_step(training *t, double done) {
    lg_policy_batch *b = &t->batch;
    lg_adam_options adam;
    lg_adam_options_init(&adam);
    adam.lr = t->options.lr;
    const double rate = 0.5 * (1.0 + cos(3.14159265358979323846 * fmin(done, 1.0)));
    for (size_t k = 0; k < b->points; k++) {
        const uint64_t seed = t->phase == RACE ? t->number[k] : t->seeds;
        double *x = t->x + k * b->count * t->policy->state;
        LG_TRY(draw_starts(t, STREAM_STEPS + t->step * (t->seeds + 1) + seed, b->count, x));
        b->starts[k] = x;
        b->steps[k] = steps_of(t, t->phase == RACE ? t->number[k] : t->leader);
        b->theta[k] = t->theta + k * t->n;
    }
    b->seed = t->options.seed, b->draw = t->step;
    LG_TRY(run_batch(t));
    for (size_t k = 0; k < b->points; k++)
        if (lg_kernels_for(LG_F64)->all_finite(t->n, t->gradients[k]))
            lg_adam_step(&adam, LG_F64, t->step + 1, rate, clip_of(t, t->gradients[k]), t->gradients[k], t->n,
                         t->m + k * t->n, t->v + k * t->n, t->theta + k * t->n);
    return LG_OK;
}

/* Orders the racers by their judgements, the best first, by exchanging slots. */
static void order_racers(training *t, judged *found) {
    for (uint32_t i = 0; i < t->racers; i++) {
        uint32_t best = i;
        for (uint32_t k = i + 1; k < t->racers; k++)
            if (leads(found[k], found[best])) best = k;
        if (best == i) continue;
        double *const arrays[] = {t->theta, t->m, t->v};
        for (size_t a = 0; a < LG_COUNT(arrays); a++) {
            double *x = arrays[a] + i * t->n, *y = arrays[a] + best * t->n;
            for (size_t j = 0; j < t->n; j++) t->gradient[j] = x[j], x[j] = y[j], y[j] = t->gradient[j];
        }
        const judged kept = found[i];
        const uint64_t number = t->number[i];
        found[i] = found[best], found[best] = kept;
        t->number[i] = t->number[best], t->number[best] = number;
    }
}

static lg_status judge_racers(training *t) {
    LG_TRY_SCRATCH(judged, found, t->policy->context, t->racers, lg_no_memory(t->error));
    for (uint32_t k = 0; k < t->racers; k++) LG_TRY(look(t, t->theta + k * t->n, &found[k]));
    order_racers(t, found);
    t->leader = (uint32_t)t->number[0];
    return LG_OK;
}

/* After a third and after two thirds of the race the worse half leaves it. */
static lg_status drop_racers(training *t, double done) {
    const uint32_t stay = done < 1.0 / 3.0 ? t->seeds : (t->seeds + 1) / (done < 2.0 / 3.0 ? 2 : 4);
    if (t->racers <= stay || t->racers <= 2) return LG_OK;
    LG_TRY(judge_racers(t));
    t->racers = stay > 2 ? stay : 2;
    t->batch.points = t->racers;
    return LG_OK;
}

static lg_status adam_phase(training *t, size_t points, uint64_t steps) {
    /* The winner gets twice as many starts as a racer: they are two pieces of work. */
    const uint64_t every = steps / LOOKS + 1, starts = (t->phase == RACE ? 1 : 2) * t->options.starts;
    judged found;
    if (t->batch.policy == NULL)
        LG_TRY(
            lg_policy_batch_create(t->phase == RACE && t->policy->warm != NULL ? t->policy->warm : t->policy,
                                   LG_F32, points, starts, t->options.threads, &t->batch, t->error));
    double done;
    t->batch.bound = 5.0 * t->policy->terminal;
    t->batch.points = t->phase == RACE ? t->racers : 1;
    for (;;) {
        LG_TRY(go_on(t, steps, &done));
        if (done >= 1.0) return LG_OK;
        if (t->phase == RACE) LG_TRY(drop_racers(t, done));
        LG_TRY(adam_step(t, done));
        t->step++;
        if (t->phase == FINISH && t->step % every == 0) LG_TRY(look(t, t->theta, &found));
        report(t, done);
    }
}

/* ---- phases ---- */

static void end_phase(training *t) {
    lg_policy_batch_destroy(&t->batch);
    lg_minimiser_destroy(t->minimiser);
    t->minimiser = NULL;
}

static void next_phase(training *t) {
    end_phase(t);
    t->phase++;
    t->step = 0, t->round = 0;
    t->phase_begun = lg_seconds();
}

/* The regulator without compensation, k = e^-100, is kept if training finds nothing better. */
static lg_status try_plain(training *t) {
    const lg_policy *p = t->policy;
    judged found;
    if (!p->task.compensate || p->task.kind != LG_POLICY_LQR || t->step > 0) return LG_OK;
    memcpy(t->gradient, t->theta, t->n * sizeof *t->theta);
    for (uint32_t l = 0; l < p->inputs; l++) t->gradient[l] = -100.0;
    return look(t, t->gradient, &found);
}

static lg_status race(training *t) {
    LG_TRY(try_plain(t));
    LG_TRY(adam_phase(t, t->seeds, t->options.race));
    LG_TRY(judge_racers(t));
    if (!isfinite(t->of_best.cost))
        return lg_fail(t->error, LG_NOT_FINITE, "the cost of all %u seeds is not finite", t->seeds);
    memset(t->m, 0, t->n * sizeof *t->m);
    memset(t->v, 0, t->n * sizeof *t->v);
    next_phase(t);
    return LG_OK;
}

/* Rounds of Adam, each with a decay of its rate, until nearly all validation starts succeed. */
static lg_status finish(training *t) {
    judged found;
    const uint32_t rounds = t->options.seconds > 0.0 || t->options.finish == 0 ? 1 : MOST_ROUNDS;
    for (;; t->round++) {
        LG_TRY(adam_phase(t, 1, t->options.finish));
        LG_TRY(look(t, t->theta, &found));
        if (t->of_best.success >= enough || t->round + 1 == rounds) break;
    }
    memcpy(t->theta, t->best, t->n * sizeof *t->theta);
    next_phase(t);
    return LG_OK;
}

static lg_status begin_polish(training *t) {
    lg_minimise_options options;
    end_phase(t); /* a failed call of this function may have left its batch */
    LG_TRY(lg_policy_batch_create(t->policy, LG_F64, 1, FIXED, t->options.threads, &t->batch, t->error));
    LG_TRY(draw_starts(t, STREAM_FIXED, FIXED, t->x));
    t->batch.starts[0] = t->x;
    t->batch.seed = t->options.seed;
    t->batch.cut = 20.0 * t->policy->terminal;
    lg_minimise_options_init(&options);
    options.method = LG_MINIMISE_LBFGS;
    options.check = false;
    return lg_minimiser_create(t->policy->context, t->n, &options, t->theta, &t->minimiser, t->error);
}

static lg_status polish(training *t) {
    const uint64_t every = t->options.polish / LOOKS + 1;
    judged found;
    double done;
    if (t->minimiser == NULL) LG_TRY(begin_polish(t));
    while (lg_minimiser_result(t->minimiser).end == LG_MINIMISE_RUNNING) {
        LG_TRY(go_on(t, t->options.polish, &done));
        if (done >= 1.0) break;
        t->batch.theta[0] = lg_minimiser_point(t->minimiser);
        LG_TRY(run_batch(t));
        (void)lg_minimiser_tell(t->minimiser, t->cost[0], t->gradients[0]);
        t->step++;
        if (t->step % every == 0) LG_TRY(look(t, lg_minimiser_best(t->minimiser), &found));
        report(t, done);
    }
    LG_TRY(look(t, lg_minimiser_best(t->minimiser), &found));
    next_phase(t);
    return LG_OK;
}

/* ---- the object ---- */

static lg_status begin(training *t) {
    const lg_policy *p = t->policy;
    const size_t n = t->n, seeds = t->seeds;
    const size_t most = (seeds > 2 ? seeds : 2) * t->options.starts, starts = most > FIXED ? most : FIXED;
    t->theta = lg_alloc(p->context, (4 * seeds + 1) * n + (starts + VALIDATION) * p->state + seeds,
                        sizeof *t->theta);
    t->gradients = lg_alloc(p->context, seeds, sizeof *t->gradients);
    t->number = lg_alloc(p->context, seeds, sizeof *t->number);
    if (t->theta == NULL || t->gradients == NULL || t->number == NULL) return lg_no_memory(t->error);
    t->m = t->theta + seeds * n, t->v = t->m + seeds * n, t->gradient = t->v + seeds * n;
    t->best = t->gradient + seeds * n;
    t->x = t->best + n;
    t->validation = t->x + starts * p->state;
    t->cost = t->validation + VALIDATION * p->state;
    for (size_t k = 0; k < seeds; k++) {
        lg_policy_initialise(p, t->options.seed * 1000 + k, t->theta + k * n);
        t->gradients[k] = t->gradient + k * n;
        t->number[k] = k;
    }
    t->racers = t->seeds;
    t->of_best = (judged){0.0, INFINITY};
    return draw_starts(t, STREAM_VALIDATION, VALIDATION, t->validation);
}

lg_status lg_policy_trainer_create(lg_policy *policy, const lg_policy_train_options *options,
                                   lg_policy_trainer **out, lg_error *error) {
    LG_NEEDS(error, policy, out);
    LG_CLEAN(lg_policy_trainer_destroy_at) training *t = lg_alloc(policy->context, 1, sizeof *t);
    if (t == NULL) return lg_no_memory(error);
    t->policy = policy, t->error = error;
    lg_policy_train_options_init(&t->options);
    if (options != NULL) t->options = *options;
    t->n = policy->parameters;
    t->seeds = policy->task.kind == LG_POLICY_NETWORK ? t->options.seeds : 1;
    LG_TRY(check_options(&t->options, error));
    LG_TRY(begin(t));
    if (t->n == 0) t->phase = DONE;
    return LG_MOVE(out, t);
}

void lg_policy_trainer_destroy(lg_policy_trainer *t) {
    if (t == NULL) return;
    const lg_context *context = t->policy->context;
    end_phase(t);
    LG_FREE_ALL(context, t->theta, t->gradients, t->number, t);
}

lg_status lg_policy_trainer_run(lg_policy_trainer *t, lg_policy_train_result *result, lg_error *error) {
    LG_NEEDS(error, t);
    static lg_status (*const phases[])(training *) = {race, finish, polish};
    lg_status status = LG_OK;
    t->error = error;
    t->begun = t->phase_begun = lg_seconds();
    while (t->phase < DONE && status == LG_OK) status = phases[t->phase](t);
    if (status == LG_CANCELLED)
        (void)lg_fail(error, status, "training was stopped; the best policy so far is kept");
    if ((status == LG_OK || status == LG_CANCELLED) && t->n > 0 && isfinite(t->of_best.cost))
        (void)lg_policy_take(t->policy, t->best);
    if (status == LG_OK && t->n == 0) status = judge(t, t->policy->theta, &t->of_best);
    if (result != NULL)
        *result =
            (lg_policy_train_result){t->of_best.cost, t->of_best.success, t->leader, lg_seconds() - t->begun};
    return status;
}

/* ---- states of training ---- */

/* Numbers that a resumed run must have in common with the saved one, then the place in the run. */
enum { FACTS = 14, COMMON = 8, METHOD = 2 }; /* METHOD 1: Adam took whole runs; 2: short runs */

static uint64_t mixed(uint64_t hash, const void *data, size_t bytes) {
    const unsigned char *at = data;
    for (size_t i = 0; i < bytes; i++) hash = (hash ^ at[i]) * UINT64_C(0x100000001b3);
    return hash;
}

/* A hash of METHOD, the rate of Adam, the validation starts (states of the plant), the bounds of success, the
 * disturbances, the regulator and the terminal cost. It changes with the task, the plant and the version. */
static uint64_t fingerprint(const training *t) {
    const lg_policy *p = t->policy;
    const lg_policy_regulator *r = &p->regulator;
    const size_t n = r->errors, m = r->inputs;
    const double numbers[] = {METHOD, t->options.lr, p->task.gate,  p->task.hold,          p->task.within,
                              r->c,   p->terminal,   p->task.delay, (double)p->task.draws, p->task.spread};
    uint64_t hash =
        mixed(UINT64_C(0xcbf29ce484222325), t->validation, VALIDATION * p->state * sizeof(double));
    hash = mixed(hash, numbers, sizeof numbers);
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        hash = mixed(hash, (const double[]){c->success, c->success_velocity, c->noise, c->noise_velocity},
                     4 * sizeof(double));
    }
    hash = mixed(hash, r->K, m * n * sizeof *r->K);
    hash = mixed(hash, r->near, m * n * sizeof *r->near);
    hash = mixed(hash, r->P, n * n * sizeof *r->P);
    return mixed(hash, r->u0, m * sizeof *r->u0);
}

static void list_facts(const training *t, uint64_t out[FACTS]) {
    const lg_policy_train_options *o = &t->options;
    const uint64_t all[FACTS] = {t->n,      t->seeds,  o->starts, o->race,
                                 o->finish, o->polish, o->seed,   fingerprint(t),
                                 t->phase,  t->step,   t->leader, isfinite(t->of_best.cost),
                                 t->racers, t->round};
    memcpy(out, all, sizeof all);
}

/* The arrays of a saved state. `facts` come first. */
enum { SAVED = 4 };
static void list_saved(const training *t, uint64_t facts[FACTS], double best[2], lg_stored out[SAVED]) {
    const lg_stored all[SAVED] = {
        {"facts", LG_ELEMENT_U64, 1, {FACTS}, .data = facts},
        {"best", LG_ELEMENT_F64, 1, {2}, .data = best},
        {"number", LG_ELEMENT_U64, 1, {t->seeds}, .data = t->number},
        {"theta", LG_ELEMENT_F64, 1, {(4 * (uint64_t)t->seeds + 1) * t->n}, .data = t->theta}};
    memcpy(out, all, sizeof all);
}

lg_status lg_policy_trainer_save(const lg_policy_trainer *t, const lg_archive_writer *to, lg_error *error) {
    LG_NEEDS(error, t, to);
    uint64_t facts[FACTS];
    double best[2] = {t->of_best.success, isfinite(t->of_best.cost) ? t->of_best.cost : 0.0};
    lg_stored arrays[SAVED];
    list_facts(t, facts);
    list_saved(t, facts, best, arrays);
    LG_TRY(lg_stored_save(to, arrays, SAVED, error));
    return t->minimiser != NULL ? lg_minimiser_save(t->minimiser, to, error) : LG_OK;
}

/* Refuses a saved run with another number of parameters, other options, another task or another plant. */
static lg_status check_facts(const training *t, const uint64_t facts[FACTS], lg_error *error) {
    static const char *const names[COMMON] = {"number of parameters",
                                              "--seeds",
                                              "--batch",
                                              "--race",
                                              "--finish",
                                              "--polish",
                                              "--seed",
                                              "task, plant or version of training"};
    uint64_t own[FACTS];
    list_facts(t, own);
    for (size_t i = 0; i < COMMON; i++)
        if (facts[i] != own[i])
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           i + 1 == COMMON ? "the saved run has another %s"
                                           : "the saved run has another %s: %llu, not %llu",
                           names[i], (unsigned long long)facts[i], (unsigned long long)own[i]);
    return LG_OK;
}

lg_status lg_policy_trainer_load(lg_policy_trainer *t, const lg_archive_reader *from, lg_error *error) {
    LG_NEEDS(error, t, from);
    uint64_t facts[FACTS];
    double best[2];
    lg_stored arrays[SAVED];
    list_saved(t, facts, best, arrays);
    if (lg_stored_load(from, arrays, 1, error) != LG_OK)
        return lg_fail(error, LG_FORMAT, "the file has no state of training of a policy");
    LG_TRY(check_facts(t, facts, error));
    LG_TRY(lg_as_format(lg_stored_load(from, arrays + 1, SAVED - 1, error), error));
    if (facts[8] > DONE || facts[10] >= t->seeds || facts[12] == 0 || facts[12] > t->seeds ||
        facts[13] >= MOST_ROUNDS)
        return lg_fail(error, LG_FORMAT, "the state of training is damaged");
    end_phase(t);
    t->error = error;
    t->phase = (uint32_t)facts[8], t->step = facts[9], t->leader = (uint32_t)facts[10];
    t->racers = (uint32_t)facts[12], t->round = (uint32_t)facts[13];
    t->of_best = (judged){best[0], facts[11] ? best[1] : INFINITY};
    if (t->phase != POLISH || t->step == 0) return LG_OK;
    LG_TRY(begin_polish(t));
    return lg_minimiser_load(t->minimiser, from, error);
}

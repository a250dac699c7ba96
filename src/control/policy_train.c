/* Policies: training by lg_fit. A race of seeds by Adam, then more Adam for the winner, then L-BFGS. A sample
 * of the fit is a piece of runs. Every piece of every step draws its starts from a separate generator, so
 * that a resumed run continues with the same bits. */
#include <math.h>
#include <string.h>

#include "control/policy_rollout.h"
#include "core/stored.h"
#include "liegrad/fit.h"

enum { ROWS = LG_POLICY_ROWS, VALIDATION = 512, FIXED = 512, LOOKS = 10, MOST_ROUNDS = 4, MOST_SHARDS = 16 };
enum { RACE, FINISH, POLISH, DONE };
enum { COMMON = 8 }; /* number of values in which a resumed run must agree with the saved one */

/* Streams of random numbers of a seed. */
enum { STREAM_VALIDATION = 2, STREAM_FIXED = 3, STREAM_STEPS = 16 };

typedef struct judged {
    double success, cost;
} judged;

struct lg_policy_trainer {
    lg_policy *policy;
    lg_policy_train_options options;
    size_t n; /* parameters */
    uint64_t seeds, common[COMMON];
    uint64_t phase, round, step; /* round: FINISH is repeated while many runs fail; step: of all rounds */
    uint64_t leader, racers;     /* the best seed; number of seeds that are still in the race */
    uint64_t *racing;            /* (seeds): 1 for a racer */
    double *theta, *best;        /* (seeds, parameters); (parameters) */
    double *validation;          /* starts (VALIDATION, state) */
    judged of_best;
    lg_fit *fit; /* of the present phase and round; NULL: it has not begun */
    lg_policy_rollout rollout;
    size_t pieces;              /* number of pieces of runs for each point */
    double begun, spent, limit; /* spent, limit: seconds of the phase; limit 0: none */
    lg_status status;           /* of the evaluation after a step */
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
    if (o->size != sizeof *o || o->seeds == 0 || o->seeds > 1000 || o->starts == 0 || o->starts % ROWS != 0 ||
        !(o->lr > 0.0) || !(o->seconds >= 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "training needs 1 to 1000 seeds, a multiple of %d starts, and a learning rate above 0",
                       ROWS);
    return LG_OK;
}

/* ---- evaluation of parameters ---- */

static lg_status draw_starts(const training *t, uint64_t stream, size_t count, double *x, lg_error *error) {
    lg_rng rng;
    lg_rng_seed(&rng, t->options.seed, stream);
    return lg_policy_starts(t->policy, &rng, count, x, NULL, error);
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

/* Evaluates the racers. The worst ones leave the race until `stay` of them remain. */
static lg_status judge_racers(training *t, uint64_t stay) {
    LG_TRY_SCRATCH(judged, found, t->policy->context, t->seeds, lg_no_memory(t->error));
    for (uint64_t k = 0; k < t->seeds; k++)
        if (t->racing[k]) LG_TRY(look(t, t->theta + k * t->n, &found[k]));
    for (;; t->racers--) {
        uint64_t best = t->seeds, worst = t->seeds;
        for (uint64_t k = 0; k < t->seeds; k++) {
            if (!t->racing[k]) continue;
            if (best == t->seeds || leads(found[k], found[best])) best = k;
            if (worst == t->seeds || !leads(found[k], found[worst])) worst = k;
        }
        t->leader = best;
        if (t->racers <= stay) return LG_OK;
        t->racing[worst] = 0;
    }
}

/* ---- the cost of a piece of runs ---- */

/* Periods of the runs of a step. A few chaotic runs spoil the gradient of long runs. Short runs with the
 * terminal cost learn more and take less time. The best length depends on the machine, so racers have
 * different lengths. The winner keeps its length in the first round. Each further round makes it longer by
 * half. */
static size_t periods_of(const training *t, uint64_t seed) {
    static const double share[] = {0.3, 0.5, 0.4};
    if (t->phase == POLISH) return t->rollout.most;
    const double part = fmin(1.0, share[seed % LG_COUNT(share)] * pow(1.5, (double)t->round));
    return (size_t)ceil(part * (double)t->rollout.most);
}

/* The bound on the norm of a gradient is in units of the cost: a thirteenth of the cost of the unforced
 * machine. */
static double clip_of(const training *t) {
    return t->policy->terminal / 8.0;
}

/* Adds the part of piece `index` to the mean cost of a point and to its gradient (parameters). All steps of
 * L-BFGS have the same starts, and their costs are cut. In the race the norm of each point's gradient is
 * bounded. For Adam a piece whose gradient is not finite adds nothing. */
static lg_status add_piece(const training *t, uint64_t point, uint64_t index, const double *theta,
                           double *loss, double *gradient) {
    const lg_policy_rollout *r = &t->rollout;
    const bool fixed = t->phase == POLISH, race = t->phase == RACE;
    const uint64_t step = fixed ? 0 : t->step, number = step * t->pieces + index,
                   stream = fixed ? STREAM_FIXED
                                  : STREAM_STEPS + step * (t->seeds + 1) + (race ? point : t->seeds);
    const double unit = t->policy->terminal;
    double length = 0.0;
    lg_policy_piece w = {0};
    LG_TRY_SCRATCH(double, sum, t->policy->context, t->n + ROWS * r->policy->state, LG_OUT_OF_MEMORY);
    LG_TRY_SCRATCH(char, memory, t->policy->context, r->bytes, LG_OUT_OF_MEMORY);
    lg_policy_piece_at(r, memory, number, &w);
    w.steps = periods_of(t, race ? point : t->leader);
    LG_TRY(draw_starts(t, stream * t->pieces + index, ROWS, sum + t->n, NULL));
    lg_policy_begin_runs(r, sum + t->n, ROWS, t->options.seed, number, &w);
    lg_put_numbers(r->dtype, w.given[0], 0, theta, t->n);
    const double cost =
        lg_policy_gradient(r, &w, fixed ? 20.0 * unit : INFINITY, fixed ? INFINITY : 5.0 * unit, sum);
    for (size_t i = 0; i < t->n; i++) length += sum[i] * sum[i];
    if (!fixed && !isfinite(cost + length)) return LG_OK;
    const double by = (race ? fmin(1.0, clip_of(t) / sqrt(length)) : 1.0) / (double)t->pieces;
    for (size_t i = 0; i < t->n; i++) gradient[i] += by * sum[i];
    *loss += cost / (double)t->pieces;
    return LG_OK;
}

static lg_status add_pieces(void *user, const void *theta, const uint32_t *samples, size_t count,
                            size_t batch, double *loss, void *gradient) {
    const training *t = user;
    for (size_t i = 0; i < count; i++) {
        const uint64_t point = samples[i] / t->pieces;
        if (t->phase == RACE && !t->racing[point]) continue;
        LG_TRY(add_piece(t, point, samples[i] % t->pieces, (const double *)theta + point * t->n, loss,
                         (double *)gradient + point * t->n));
    }
    return LG_OK;
}

/* ---- phases ---- */

static uint64_t steps_of(const training *t, uint64_t phase) {
    const lg_policy_train_options *o = &t->options;
    return (uint64_t[]){o->race, o->finish, o->polish}[phase];
}

/* After a third and after two thirds of the race the worse half leaves it. In the other phases the policy is
 * evaluated LOOKS times. */
static lg_status judge_step(training *t, uint64_t epoch, double done) {
    const uint64_t stay = done < 1.0 / 3.0 ? t->seeds : (t->seeds + 1) / (done < 2.0 / 3.0 ? 2 : 4),
                   every = steps_of(t, t->phase) / LOOKS + 1;
    judged found;
    if (t->phase == RACE ? t->racers <= stay || t->racers <= 2 : epoch % every != 0) return LG_OK;
    lg_fit_parameters(t->fit, t->theta);
    return t->phase == RACE ? judge_racers(t, stay > 2 ? stay : 2) : look(t, t->theta, &found);
}

/* Evaluates and reports after a step. */
static int end_step(void *user, const lg_fit_epoch *epoch) {
    training *t = user;
    const lg_policy_train_options *o = &t->options;
    uint64_t before = t->round * o->finish;
    for (uint64_t k = 0; k < t->phase; k++) before += steps_of(t, k);
    t->spent += epoch->seconds;
    const double by_time = t->limit > 0.0 ? fmin(t->spent / t->limit, 1.0) : 0.0,
                 done = fmax((double)epoch->epoch / (double)epoch->epochs, by_time);
    t->step = t->round * o->finish + epoch->epoch;
    t->status = judge_step(t, epoch->epoch, done);
    const lg_policy_progress now = {.step = before + (uint64_t)(done * (double)epoch->epochs),
                                    .steps = o->race + (t->round + 1) * o->finish + o->polish,
                                    .seed = (uint32_t)t->leader,
                                    .cost = t->of_best.cost,
                                    .success = t->of_best.success,
                                    .seconds = lg_seconds() - t->begun};
    if (o->progress != NULL) o->progress(o->user, &now);
    return t->status != LG_OK;
}

static void end_fit(training *t) {
    lg_fit_destroy(t->fit);
    lg_policy_plans_destroy(&t->rollout.plans);
    t->fit = NULL;
    t->rollout.plans = (lg_policy_plans){0};
}

/* Creates the fit of all points of the phase, whose parameters lie one after the other. The winner of the
 * race gets twice as many starts as a racer. With o->seconds, each phase ends after its share of them. */
static lg_status begin_fit(training *t) {
    static const char *const names[2][LG_POLICY_PLANS] = {
        {"closed", "terminal", "adj1_closed", "adj1_terminal"},
        {"disturbed", "disturbed_end", "adj1_disturbed", "adj1_disturbed_end"}};
    static const double share[] = {0.5, 0.75, 1.0};
    const lg_policy_train_options *o = &t->options;
    const bool race = t->phase == RACE, fixed = t->phase == POLISH,
               disturbed = lg_policy_is_disturbed(&t->policy->task);
    const lg_policy *p = race && t->policy->warm != NULL ? t->policy->warm : t->policy;
    const size_t points = race ? t->seeds : 1;
    lg_fit_options options;
    end_fit(t); /* a failed call may have left its plans */
    t->pieces = fixed ? FIXED / ROWS : (race ? 1 : 2) * o->starts / ROWS;
    t->rollout = (lg_policy_rollout){.policy = p, .dtype = fixed ? LG_F64 : LG_F32, .rows = ROWS};
    t->rollout.most = lg_policy_periods(p, p->task.horizon);
    LG_TRY(lg_policy_rollout_create(&t->rollout, names[disturbed], LG_POLICY_PLANS, t->error));
    const lg_fit_problem problem = {.parameters = points * t->n,
                                    .samples = points * t->pieces,
                                    .gradient = add_pieces,
                                    .user = t,
                                    .chunk = 1};
    lg_fit_options_init(&options);
    options.plan.phases = 1;
    options.plan.phase[0].method = fixed ? LG_FIT_LBFGS : LG_FIT_ADAM;
    options.epochs = steps_of(t, t->phase);
    options.adam.lr = o->lr;
    options.schedule.kind = LG_SCHEDULE_COSINE;
    options.clip_norm = race ? 0.0 : clip_of(t); /* of Adam alone */
    options.shuffle = false, options.hurry = true;
    options.shards = problem.samples < MOST_SHARDS ? (uint32_t)problem.samples : MOST_SHARDS;
    options.seed = o->seed, options.threads = o->threads, options.ranks = o->ranks;
    options.on_epoch = end_step, options.user = t;
    t->spent = t->limit = 0.0;
    if (o->seconds > 0.0) t->limit = fmax(share[t->phase] * o->seconds - (lg_seconds() - t->begun), 1e-9);
    const lg_status shared =
        o->ranks != NULL ? lg_ranks_share(o->ranks, 0, &t->limit, sizeof t->limit) : LG_OK;
    if (shared != LG_OK) return lg_ranks_lost(o->ranks, shared, t->error);
    options.seconds = t->limit;
    return lg_fit_create(p->context, &problem, &options, t->theta, &t->fit, t->error);
}

/* The regulator without compensation, k = e^-100, is kept if training finds nothing better. */
static lg_status try_plain(training *t) {
    const lg_policy *p = t->policy;
    judged found;
    if (!p->task.compensate || p->task.kind != LG_POLICY_LQR || t->phase != RACE) return LG_OK;
    LG_TRY_SCRATCH(double, plain, p->context, t->n, lg_no_memory(t->error));
    memcpy(plain, t->theta, t->n * sizeof *plain);
    for (uint32_t l = 0; l < p->inputs; l++) plain[l] = -100.0;
    return look(t, plain, &found);
}

/* Rounds of FINISH follow until nearly all validation starts succeed. */
static lg_status end_phase(training *t) {
    const uint64_t rounds = t->options.seconds > 0.0 || t->options.finish == 0 ? 1 : MOST_ROUNDS;
    judged found;
    LG_TRY(t->phase == RACE ? judge_racers(t, 1) : look(t, t->theta, &found));
    if (!isfinite(t->of_best.cost))
        return lg_fail(t->error, LG_NOT_FINITE, "the cost of all %u seeds is not finite", (uint32_t)t->seeds);
    end_fit(t);
    t->step = 0;
    if (t->phase == FINISH && t->of_best.success < enough && t->round + 1 < rounds) {
        t->step = ++t->round * t->options.finish;
        return LG_OK;
    }
    const double *from = t->phase == RACE ? t->theta + t->leader * t->n : t->best;
    memmove(t->theta, from, t->n * sizeof *t->theta);
    t->phase++, t->round = 0;
    return LG_OK;
}

static lg_status run_phase(training *t) {
    lg_error error = {LG_OK, ""};
    if (t->fit == NULL) LG_TRY(try_plain(t));
    if (steps_of(t, t->phase) == 0) return end_phase(t);
    if (t->fit == NULL) LG_TRY(begin_fit(t));
    t->status = LG_OK;
    const lg_status status = lg_fit_run(t->fit, &error);
    LG_TRY(t->status); /* t->error says why */
    if (status != LG_OK && !(t->phase == POLISH && status == LG_NOT_FINITE))
        return lg_fail(t->error, status, "%s", error.message);
    lg_fit_parameters(t->fit, t->theta);
    return end_phase(t);
}

/* ---- the object ---- */

/* A hash of METHOD, the rate of Adam, the validation starts (states of the plant), the bounds of success, the
 * disturbances, the regulator and the terminal cost. It changes with the task, the plant and the version. */
static uint64_t find_fingerprint(const training *t) {
    /* Version of training. 1: Adam on whole runs. 2: Adam on short runs. 3: lg_fit. */
    enum { METHOD = 3, EACH = 4 };
    const lg_policy *p = t->policy;
    const lg_policy_regulator *r = &p->regulator;
    const size_t n = r->errors, m = r->inputs, coordinates = p->task.coordinate_count;
    double bounds[EACH * LG_POLICY_COORDINATES];
    for (size_t i = 0; i < coordinates; i++) {
        const lg_policy_coordinate *c = &p->task.coordinate[i];
        const double own[EACH] = {c->success, c->success_velocity, c->noise, c->noise_velocity};
        memcpy(bounds + EACH * i, own, sizeof own);
    }
    const double numbers[] = {METHOD, t->options.lr, p->task.gate,  p->task.hold,          p->task.within,
                              r->c,   p->terminal,   p->task.delay, (double)p->task.draws, p->task.spread};
    const struct {
        const void *at;
        size_t count;
    } parts[] = {{t->validation, VALIDATION * p->state},
                 {numbers, LG_COUNT(numbers)},
                 {bounds, EACH * coordinates},
                 {r->K, m * n},
                 {r->near, m * n},
                 {r->P, n * n},
                 {r->u0, m}};
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    for (size_t i = 0; i < LG_COUNT(parts); i++)
        for (size_t k = 0; k < parts[i].count * sizeof(double); k++)
            hash = (hash ^ ((const unsigned char *)parts[i].at)[k]) * UINT64_C(0x100000001b3);
    return hash;
}

static lg_status begin(training *t) {
    const lg_policy *p = t->policy;
    if (LG_ALLOC_ALL(p->context, LG_ARRAY(t->theta, (t->seeds + 1) * t->n + VALIDATION * p->state),
                     LG_ARRAY(t->racing, t->seeds)) != LG_OK)
        return lg_no_memory(t->error);
    t->best = t->theta + t->seeds * t->n;
    t->validation = t->best + t->n;
    for (uint64_t k = 0; k < t->seeds; k++) {
        lg_policy_initialise(p, t->options.seed * 1000 + k, t->theta + k * t->n);
        t->racing[k] = 1;
    }
    t->racers = t->seeds;
    t->of_best = (judged){0.0, INFINITY};
    LG_TRY(draw_starts(t, STREAM_VALIDATION, VALIDATION, t->validation, t->error));
    const lg_policy_train_options *o = &t->options;
    const uint64_t common[] = {t->n,      t->seeds,  o->starts, o->race,
                               o->finish, o->polish, o->seed,   find_fingerprint(t)};
    memcpy(t->common, common, sizeof common);
    return LG_OK;
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
    end_fit(t);
    LG_FREE_ALL(t->policy->context, t->theta, t->racing, t);
}

lg_status lg_policy_trainer_run(lg_policy_trainer *t, lg_policy_train_result *result, lg_error *error) {
    LG_NEEDS(error, t);
    lg_status status = LG_OK;
    t->error = error;
    t->begun = lg_seconds();
    while (t->phase < DONE && status == LG_OK) status = run_phase(t);
    if (status == LG_CANCELLED)
        (void)lg_fail(error, status, "training was stopped; the best policy so far is kept");
    if ((status == LG_OK || status == LG_CANCELLED) && t->n > 0 && isfinite(t->of_best.cost))
        (void)lg_policy_take(t->policy, t->best);
    if (status == LG_OK && t->n == 0) status = judge(t, t->policy->theta, &t->of_best);
    if (result != NULL)
        *result = (lg_policy_train_result){t->of_best.cost, t->of_best.success, (uint32_t)t->leader,
                                           lg_seconds() - t->begun};
    return status;
}

/* ---- states of training ---- */

/* What a resumed run must have in common with the saved one, then the state. begun: whether the phase's fit
 * has begun; then its state follows. */
enum { SAVED = COMMON + 8 };
static void list_saved(training *t, uint64_t *begun, lg_stored out[SAVED]) {
    static const char *const names[COMMON] = {"parameters", "seeds",  "batch", "race",
                                              "finish",     "polish", "seed",  "task"};
    const lg_stored state[] = {{"phase", LG_ELEMENT_U64, .data = &t->phase},
                               {"round", LG_ELEMENT_U64, .data = &t->round},
                               {"leader", LG_ELEMENT_U64, .data = &t->leader},
                               {"racers", LG_ELEMENT_U64, .data = &t->racers},
                               {"begun", LG_ELEMENT_U64, .data = begun},
                               {"best", LG_ELEMENT_F64, 1, {2}, .data = &t->of_best},
                               {"racing", LG_ELEMENT_U64, 1, {t->seeds}, .data = t->racing},
                               {"theta", LG_ELEMENT_F64, 1, {(t->seeds + 1) * t->n}, .data = t->theta}};
    for (size_t i = 0; i < COMMON; i++) out[i] = (lg_stored){names[i], LG_ELEMENT_U64, .data = &t->common[i]};
    memcpy(out + COMMON, state, sizeof state);
}

lg_status lg_policy_trainer_save(const lg_policy_trainer *t, const lg_archive_writer *to, lg_error *error) {
    LG_NEEDS(error, t, to);
    training same = *t; /* shares the arrays, which are only read */
    uint64_t begun = t->fit != NULL;
    lg_stored rows[SAVED];
    list_saved(&same, &begun, rows);
    LG_TRY(lg_stored_save(to, rows, SAVED, error));
    return begun ? lg_fit_save(t->fit, to, error) : LG_OK;
}

lg_status lg_policy_trainer_load(lg_policy_trainer *t, const lg_archive_reader *from, lg_error *error) {
    LG_NEEDS(error, t, from);
    uint64_t begun = 0, racers = 0, task;
    lg_stored rows[SAVED];
    list_saved(t, &begun, rows);
    t->error = error;
    if (lg_stored_load(from, &(lg_stored){"task", LG_ELEMENT_U64, .data = &task}, 1, error) != LG_OK)
        return lg_fail(error, LG_FORMAT, "the file has no state of training of a policy");
    LG_TRY(lg_stored_compare(from, rows, COMMON - 1, error));
    if (task != t->common[COMMON - 1])
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the saved run has another task, plant or version of training");
    LG_TRY(lg_as_format(lg_stored_load(from, rows + COMMON, SAVED - COMMON, error), error));
    for (uint64_t k = 0; k < t->seeds; k++) racers += t->racing[k] == 1;
    if (t->phase > DONE || t->round >= MOST_ROUNDS || t->leader >= t->seeds || racers == 0 ||
        racers != t->racers || (begun && (t->phase == DONE || steps_of(t, t->phase) == 0)))
        return lg_fail(error, LG_FORMAT, "the state of training is damaged");
    end_fit(t);
    t->step = t->round * t->options.finish;
    if (!begun) return LG_OK;
    t->begun = lg_seconds();
    LG_TRY(begin_fit(t));
    LG_TRY(lg_as_format(lg_fit_load(t->fit, from, error), error));
    for (uint64_t i = 0; i < lg_fit_epochs_done(t->fit); i++, t->step++)
        t->spent += lg_fit_history(t->fit, LG_FIT_SECONDS)[i];
    return LG_OK;
}

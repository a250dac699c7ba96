/* Methods of training, plans of phases, and why training ends. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/text.h"
#include "nn/fit_internal.h"
#include "nn/minimise_internal.h"

/* X(name) for each row lg_fit_<name>. lg_fit_method numbers the methods: first the first row, then the
 * minimisers, then the other rows. */
#define BATCHES(X)    X(adam) X(sgd)
#define DECLARE(name) extern const lg_fit_batches_row lg_fit_##name;
#define LIST(name)    &lg_fit_##name,
BATCHES(DECLARE)
static const lg_fit_batches_row *const batches[] = {BATCHES(LIST)};

static size_t minimisers(void) {
    size_t count = 0;
    while (lg_minimise_row_at(count) != NULL) count++;
    return count;
}

const lg_fit_batches_row *lg_fit_batches_of(lg_fit_method method) {
    const size_t number = (size_t)method, others = minimisers();
    if (number == 0) return batches[0];
    return number > others && number - others < LG_COUNT(batches) ? batches[number - others] : NULL;
}

/* NULL if the method takes batches. */
static const lg_minimise_row *minimiser_of(lg_fit_method method) {
    return (size_t)method > 0 ? lg_minimise_row_at((size_t)method - 1) : NULL;
}

const char *lg_fit_method_name(lg_fit_method method) {
    const lg_fit_batches_row *row = lg_fit_batches_of(method);
    const lg_minimise_row *minimiser = minimiser_of(method);
    return row != NULL ? row->name : minimiser != NULL ? minimiser->name : NULL;
}

bool lg_fit_method_squares(lg_fit_method method) {
    return minimiser_of(method) != NULL && minimiser_of(method)->squares;
}

bool lg_fit_method_batches(lg_fit_method method) {
    return lg_fit_batches_of(method) != NULL;
}

/* ---- plans ---- */

static lg_status no_method(const char *text, size_t length, bool squares, lg_error *error) {
    lg_name_list names = {.used = 0};
    const char *name;
    for (int i = 0; (name = lg_fit_method_name((lg_fit_method)i)) != NULL; i++)
        if (squares || !lg_fit_method_squares((lg_fit_method)i)) lg_name_list_add(&names, name);
    return lg_fail(error, LG_INVALID_ARGUMENT, "'%.*s' is not a method of training; the methods are %s",
                   (int)(length < 40 ? length : 40), text, names.text);
}

/* Parses one phase, such as "adam:100", from the first `length` characters. *epochs is 0 if there is no
 * number. Methods for sums of squares are refused unless `squares`. */
static lg_status parse_phase(const char *text, size_t length, bool squares, uint32_t *method,
                             uint32_t *epochs, lg_error *error) {
    const char *colon = memchr(text, ':', length);
    const size_t size = colon != NULL ? (size_t)(colon - text) : length;
    const char *name;
    *epochs = 0;
    for (*method = 0; (name = lg_fit_method_name((lg_fit_method)*method)) != NULL; (*method)++)
        if (strlen(name) == size && memcmp(name, text, size) == 0) break;
    if (name == NULL || (lg_fit_method_squares((lg_fit_method)*method) && !squares))
        return no_method(text, size, squares, error);
    bool good = true;
    for (const char *c = colon; good && c != NULL && ++c < text + length;) {
        good = *c >= '0' && *c <= '9' && *epochs <= 100000000;
        *epochs = 10 * *epochs + (uint32_t)(*c - '0');
    }
    if (good && (colon == NULL || *epochs > 0)) return LG_OK;
    return lg_fail(error, LG_INVALID_ARGUMENT,
                   "the epochs of a method must be a whole number from 1 to 10^9, as in adam:100");
}

lg_status lg_fit_plan_parse(const char *text, bool squares, lg_fit_plan *out, lg_error *error) {
    LG_NEEDS(error, text, out);
    lg_fit_plan plan = {0};
    for (const char *at = text;;) {
        const size_t length = strcspn(at, ",");
        if (plan.phases == LG_FIT_MAX_PHASES)
            return lg_fail(error, LG_INVALID_ARGUMENT, "at most %d methods can follow each other",
                           LG_FIT_MAX_PHASES);
        LG_TRY(parse_phase(at, length, squares, &plan.phase[plan.phases].method,
                           &plan.phase[plan.phases].epochs, error));
        plan.phases++;
        if (at[length] == '\0') break;
        if (plan.phase[plan.phases - 1].epochs == 0)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "each method except the last needs a number of epochs, as in adam:100,ssbroyden");
        at += length + 1;
    }
    if (plan.phases == 1 && plan.phase[0].method == LG_FIT_ADAM && plan.phase[0].epochs == 0) plan.phases = 0;
    *out = plan;
    return LG_OK;
}

void lg_fit_plan_show(const lg_fit_plan *plan, char text[LG_FIT_PLAN_TEXT]) {
    (void)snprintf(text, LG_FIT_PLAN_TEXT, "%s", plan->phases == 0 ? batches[0]->name : "");
    for (uint32_t i = 0; i < plan->phases; i++) {
        const uint32_t epochs = plan->phase[i].epochs;
        lg_append(text, LG_FIT_PLAN_TEXT, "%s%s", i > 0 ? "," : "",
                  lg_fit_method_name((lg_fit_method)plan->phase[i].method));
        if (epochs > 0) lg_append(text, LG_FIT_PLAN_TEXT, ":%" PRIu32, epochs);
    }
}

bool lg_fit_plan_batches(const lg_fit_plan *plan) {
    bool takes = plan->phases == 0;
    for (uint32_t i = 0; i < plan->phases; i++)
        takes = takes || lg_fit_method_batches((lg_fit_method)plan->phase[i].method);
    return takes;
}

bool lg_fit_plan_ends_in_batches(const lg_fit_plan *plan) {
    return plan->phases == 0 || lg_fit_method_batches((lg_fit_method)plan->phase[plan->phases - 1].method);
}

lg_fit_method lg_fit_method_of(const lg_fit *fit, uint64_t phase) {
    const lg_fit_plan *plan = &fit->options.plan;
    return plan->phases == 0 ? LG_FIT_ADAM : (lg_fit_method)plan->phase[phase].method;
}

lg_fit_method lg_fit_method_now(const lg_fit *fit) {
    return lg_fit_method_of(fit, fit->state.phase);
}

static bool is_last(const lg_fit *fit) {
    return fit->state.phase + 1 >= fit->options.plan.phases;
}

lg_status lg_fit_check_plan(const lg_fit_problem *problem, const lg_fit_options *o, lg_error *error) {
    /* A matrix of n^2 doubles: for 10000 parameters 0.8 GB. */
    enum { MOST_DENSE = 10000 };
    bool squares = o->plan.phases > 0 && problem->validation == 0 && o->validation == 0.0;
    if (o->plan.phases > LG_FIT_MAX_PHASES)
        return lg_fail(error, LG_INVALID_ARGUMENT, "training options: the plan has too many phases");
    for (uint32_t i = 0; i < o->plan.phases; i++) {
        const lg_fit_method method = (lg_fit_method)o->plan.phase[i].method;
        const lg_minimise_row *row = minimiser_of(method);
        if (lg_fit_method_name(method) == NULL || (o->plan.phase[i].epochs == 0 && i + 1 < o->plan.phases))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "training options: the plan has an unknown method or a phase without epochs");
        squares = squares && row != NULL && row->squares;
        if (row == NULL) continue;
        if (o->dtype != LG_F64)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "training options: %s needs double precision (f64); only methods that take "
                           "batches, such as adam, take f32",
                           row->name);
        if (row->squares && problem->residuals == NULL && problem->linearise == NULL)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "training options: %s needs a loss that is a sum of squares; this one is not",
                           row->name);
        const size_t own = row->squares ? problem->own * problem->samples : 0;
        if (row->dense && problem->parameters - own > MOST_DENSE)
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "training options: %s needs a matrix with a row and a column per parameter, and "
                           "%zu parameters are too many (at most %d): use lbfgs, or a smaller network",
                           row->name, problem->parameters - own, MOST_DENSE);
    }
    if (problem->loss == NULL && problem->residuals == NULL && problem->gradient == NULL && !squares)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the problem has neither a loss function nor residuals");
    return LG_OK;
}

/* ---- evaluations ---- */

lg_minimise_options lg_fit_minimise_options(const lg_fit *fit, uint64_t phase) {
    lg_minimise_options options;
    lg_minimise_options_init(&options);
    options.method = (lg_minimise_method)((int)lg_fit_method_of(fit, phase) - 1);
    options.check = false; /* gradients come from the tape and need no check here */
    options.slow = true;
    options.ranks = fit->options.ranks;
    options.block = fit->problem.own;
    options.blocks = fit->problem.own > 0 ? fit->problem.samples : 0;
    return options;
}

lg_status lg_fit_create_minimiser(const lg_fit *fit, lg_fit_state *s, lg_error *error) {
    const lg_minimise_options options = lg_fit_minimise_options(fit, s->phase);
    return lg_minimiser_create(fit->context, fit->problem.parameters, &options, s->theta, &s->minimiser,
                               error);
}

/* How many numbers of theta the prior applies to; they come first. */
static size_t weights_of(const lg_fit *fit) {
    return fit->problem.weights > 0 ? fit->problem.weights : fit->problem.parameters;
}

/* The factor W of the prior's term W/2 |w|^2, where w are the weights. */
static double prior_of(const lg_fit *fit) {
    const double spread = fit->options.prior * fit->options.prior * (double)fit->problem.observations;
    return spread > 0.0 ? 2.0 * fit->state.noise / spread : 0.0;
}

/* What weight decay and prior add to the loss at x. */
static double penalty_at(const lg_fit *fit, const double *x) {
    const double *each = fit->problem.decay;
    double sum = 0.0;
    for (size_t i = 0; each != NULL && i < fit->problem.parameters; i++) sum += each[i] * x[i] * x[i];
    return 0.5 * sum + 0.5 * fit->options.adam.weight_decay * fit->k->dot(fit->problem.parameters, x, x) +
           0.5 * prior_of(fit) * fit->k->dot(weights_of(fit), x, x);
}

static bool takes_squares(const lg_fit *fit) {
    return lg_fit_method_squares(lg_fit_method_now(fit));
}

/* Loss and gradient of all training samples, and for sums of squares the Gauss-Newton matrix, with weight
 * decay and prior. Only at the first evaluation is a loss that is not finite a failure; later *value is NaN,
 * and the search shortens its step. */
static lg_status full_loss(lg_fit *fit, const char *what, double *value, lg_error *error) {
    const double *theta = fit->point;
    const size_t n = fit->problem.parameters;
    const double decay = fit->options.adam.weight_decay, prior = prior_of(fit);
    const bool first = lg_minimiser_result(fit->state.minimiser).evaluations == 0;
    lg_status status = takes_squares(fit) ? lg_fit_squares(fit, what, value, error)
                                          : lg_fit_batch_loss(fit, fit->state.order, fit->training,
                                                              LG_FIT_GRADIENT, what, value, error);
    if (status == LG_OK && !takes_squares(fit) && !isfinite(lg_fit_reduce(fit, LG_PAIRS_REST)))
        status = lg_fit_gradient_failure(fit, what, error);
    if (status == LG_NOT_FINITE && !first) {
        (void)lg_fail(error, LG_OK, "%s", "");
        *value = NAN;
        return LG_OK;
    }
    LG_TRY(status);
    const double *each = fit->problem.decay;
    if (!(decay > 0.0 || prior > 0.0 || each != NULL)) return LG_OK;
    *value += penalty_at(fit, theta);
    fit->k->axpy(n, decay, theta, fit->shards[0].gradient);
    fit->k->axpy(weights_of(fit), prior, theta, fit->shards[0].gradient);
    double *gradient = (double *)(void *)fit->shards[0].gradient;
    for (size_t i = 0; each != NULL && i < n; i++) gradient[i] += each[i] * theta[i];
    if (takes_squares(fit)) lg_fit_add_diagonal(fit, weights_of(fit), prior, decay);
    return LG_OK;
}

/* The loss at the lowest point, without weight decay and prior. */
static double plain_loss(const lg_fit *fit) {
    const double value = lg_minimiser_result(fit->state.minimiser).value;
    return value - penalty_at(fit, lg_minimiser_best(fit->state.minimiser));
}

/* Sets the variance of the noise; tells the minimiser the new value and gradient at the lowest point. */
static void set_noise(lg_fit *fit, double noise) {
    lg_fit_state *s = &fit->state;
    const size_t n = fit->problem.parameters, weights = weights_of(fit);
    const double *x = lg_minimiser_best(s->minimiser), before = prior_of(fit);
    double *gradient = (double *)(void *)fit->shards[0].gradient;
    const double value = lg_minimiser_result(s->minimiser).value;
    s->noise = noise;
    const double change = prior_of(fit) - before;
    memcpy(gradient, lg_minimiser_gradient(s->minimiser), n * sizeof *gradient);
    fit->k->axpy(weights, change, x, gradient);
    lg_minimiser_change(s->minimiser, value + 0.5 * change * fit->k->dot(weights, x, x), gradient);
}

/* Called after an accepted step. If WINDOW iterations lowered the loss by less than a tenth, the loss becomes
 * the variance of the noise. If the loss later falls below half the noise, the noise becomes 0 again. */
static void watch_noise(lg_fit *fit, double loss) {
    enum { WINDOW = 50 };
    static const double FALL = 0.9, ANEW = 0.5;
    lg_fit_state *s = &fit->state;
    const uint64_t iterations = lg_minimiser_result(s->minimiser).iterations;
    if (s->noise > 0.0 && loss < ANEW * s->noise) set_noise(fit, 0.0);
    if (iterations > 1 && iterations - s->plateau_start < WINDOW) return;
    if (iterations > 1 && s->noise == 0.0 && loss > FALL * s->plateau) set_noise(fit, loss);
    s->plateau = loss;
    s->plateau_start = iterations;
}

static void drop_minimiser(lg_fit_state *s) {
    lg_minimiser_destroy(s->minimiser);
    s->minimiser = NULL;
}

lg_status lg_fit_evaluate(lg_fit *fit, bool *moved, lg_error *error) {
    lg_fit_state *s = &fit->state;
    const size_t n = fit->problem.parameters;
    if (s->minimiser == NULL) {
        const lg_status agreed = lg_fit_agree(fit, lg_fit_create_minimiser(fit, s, error), error);
        if (agreed != LG_OK) { /* all ranks have a minimiser, or none has one */
            drop_minimiser(s);
            return agreed;
        }
    }
    char what[64];
    double value = 0.0;
    (void)snprintf(what, sizeof what, "epoch %" PRIu64, s->epoch + 1);
    fit->point = lg_minimiser_point(s->minimiser);
    LG_TRY(full_loss(fit, what, &value, error));
    const double *gradient = (const double *)(const void *)fit->shards[0].gradient;
    *moved = takes_squares(fit)
                 ? lg_minimiser_tell_squares(s->minimiser, value, gradient, fit->shards[0].matrix)
                 : lg_minimiser_tell(s->minimiser, value, gradient);
    LG_TRY(lg_minimiser_status(s->minimiser));
    if (lg_minimiser_result(s->minimiser).end == LG_MINIMISE_NOT_FINITE) {
        drop_minimiser(s); /* a further run begins again at the same point */
        return lg_fit_gradient_failure(fit, what, error);
    }
    memcpy(s->theta, lg_minimiser_best(s->minimiser), n * sizeof(double));
    const double loss = plain_loss(fit);
    if (*moved && !takes_squares(fit) && fit->options.prior > 0.0 && fit->problem.observations > 0)
        watch_noise(fit, loss);
    s->running_loss = loss * (double)fit->training;
    return LG_OK;
}

static bool minimiser_ended(const lg_fit *fit) {
    const lg_minimiser *minimiser = fit->state.minimiser;
    return minimiser != NULL && lg_minimiser_result(minimiser).end != LG_MINIMISE_RUNNING;
}

static bool phase_done(const lg_fit *fit) {
    const lg_fit_plan *plan = &fit->options.plan;
    const uint32_t planned = plan->phases == 0 ? 0 : plan->phase[fit->state.phase].epochs;
    return planned > 0 && fit->state.epoch - fit->state.phase_start >= planned;
}

void lg_fit_next_phase(lg_fit *fit) {
    lg_fit_state *s = &fit->state;
    if (is_last(fit) || !(minimiser_ended(fit) || phase_done(fit))) return;
    drop_minimiser(s);
    s->noise = 0.0;
    s->plateau_start = 0;
    s->phase++;
    s->phase_start = s->epoch;
}

/* ---- ends ---- */

/* Epochs since the best one. For a minimiser only epochs whose step was accepted count, which are those where
 * the loss changed: other evaluations of a line search had no chance to become the best. */
static uint64_t fruitless(const lg_fit *fit) {
    const lg_fit_state *s = &fit->state;
    const double *loss = s->history[LG_FIT_LOSS];
    if (lg_fit_method_batches(lg_fit_method_now(fit))) return s->epoch - s->best_epoch;
    uint64_t count = 0;
    for (uint64_t i = s->best_epoch; i < s->epoch; i++) count += i > 0 && loss[i] != loss[i - 1];
    return count;
}

lg_fit_end lg_fit_why_finished(const lg_fit *fit) {
    const lg_fit_state *s = &fit->state;
    const lg_fit_options *o = &fit->options;
    if (s->position > 0) return LG_FIT_RUNNING;
    if (is_last(fit) && minimiser_ended(fit)) return LG_FIT_END_MINIMISER;
    if (s->epoch >= o->epochs || (is_last(fit) && phase_done(fit))) return LG_FIT_END_EPOCHS;
    if (o->patience > 0 && fruitless(fit) >= o->patience) return LG_FIT_END_PATIENCE;
    return o->seconds > 0.0 && fit->spent >= o->seconds ? LG_FIT_END_SECONDS : LG_FIT_RUNNING;
}

bool lg_fit_finished(const lg_fit *fit) {
    return lg_fit_why_finished(fit) != LG_FIT_RUNNING;
}

const char *lg_fit_end_sentence(const lg_fit *fit) {
    static const char *const sentences[] = {
        [LG_FIT_RUNNING] = "",
        [LG_FIT_END_EPOCHS] = "the planned epochs are done",
        [LG_FIT_END_SECONDS] = "the time is used up",
        [LG_FIT_END_PATIENCE] = "the loss has not fallen for --patience epochs or steps",
    };
    const lg_fit_end end = lg_fit_why_finished(fit);
    if (end == LG_FIT_END_MINIMISER)
        return lg_minimise_end_sentence(lg_minimiser_result(fit->state.minimiser).end);
    return sentences[end];
}

/* Policies: compares the cost of a run with the cost of the best inputs that a search finds. The inputs are
 * planned by corrections y of a feedback (function `planned`). Open-loop inputs of an unstable machine would
 * amplify rounding, but corrections do not, and every sequence of inputs has its corrections. */
#include <math.h>
#include <string.h>

#include "control/policy_rollout.h"
#include "liegrad/minimise.h"

/* For each start the search has GUESSES initial guesses (each is a row of the plans) and ROUNDS rounds of
 * EVALUATIONS evaluations. */
enum { GUESSES = 8, ROUNDS = 9, EVALUATIONS = 20, HOW = LG_POLICY_PLANNED };

typedef struct search {
    const lg_policy *policy;
    size_t starts, rows, steps, n; /* n: numbers in y, (steps, inputs) */
    lg_policy_rollout rollout;     /* of `planned`, given y and how */
    lg_policy_piece runs;
    char *memory;
    lg_minimiser **minimiser;                              /* (rows) */
    double *z, *x, *policy_cost, *unit, *best, *by, *kept; /* (starts); by, kept: how and y of the best */
    double *guess, *how;                                   /* (rows): y and how of a run */
    double *y, *slope;                                     /* (steps, rows, inputs): y of all runs, dJ/dy */
    double *total, *own;                                   /* (rows); own: y or slope of one row */
    double end;                                            /* wall-clock time at which the search stops */
} search;

/* Copies the y of a row into the arrays of periods, or out of them. */
static void deal(const search *s, size_t r, double *own, double *all, bool into) {
    const size_t m = s->policy->inputs;
    for (size_t k = 0; k < s->steps; k++) {
        double *here = own + k * m, *there = all + (k * s->rows + r) * m;
        memcpy(into ? there : here, into ? here : there, m * sizeof *own);
    }
}

/* Runs the guesses with inputs in their limits, and keeps the best ones. */
static void take_best(search *s) {
    for (size_t r = 0; r < s->rows; r++) {
        s->how[r * HOW + LG_POLICY_BEYOND] = s->how[r * HOW + LG_POLICY_PENALTY] = 0.0;
        deal(s, r, s->guess + r * s->n, s->y, true);
    }
    lg_policy_cost(&s->rollout, &s->runs);
    for (size_t r = 0; r < s->rows; r++) {
        const size_t i = r / GUESSES;
        if (!(s->total[r] < s->best[i])) continue;
        s->best[i] = s->total[r];
        memcpy(s->kept + i * s->n, s->guess + r * s->n, s->n * sizeof *s->kept);
        memcpy(s->by + i * HOW, s->how + r * HOW, HOW * sizeof *s->by);
    }
}

/* The policy's run, the regulator's, that of no input, and random corrections of these in the first half. */
static void guess(search *s, uint64_t seed) {
    const lg_policy *p = s->policy;
    const size_t part = s->steps / 16 + 1;
    const uint32_t m = p->inputs;
    lg_rng rng;
    lg_rng_seed(&rng, seed, 1);
    for (size_t r = 0; r < s->rows; r++) {
        double *y = s->guess + r * s->n, drawn[LG_POLICY_INPUTS] = {0};
        const size_t kind = r % GUESSES % 3;
        if (kind < 2) s->how[r * HOW + kind] = 1.0;
        for (size_t i = 0; i < s->n; i++) {
            if (r % GUESSES >= 3 && i / m % part == 0)
                drawn[i % m] = i / m < 8 * part ? lg_rng_uniform_in(&rng, -1.0, 1.0) : 0.0;
            y[i] = drawn[i % m] + (kind < 2 ? 0.0 : p->regulator.u0[i % m] / lg_policy_half_range(p, i % m));
        }
    }
}

/* Minimises from the guesses. Inputs may pass their limits at a price, in units of the mean cost of a period.
 * Then takes as guesses the best y of the start and of the starts after it. */
static lg_status search_round(search *s, double price, lg_error *error) {
    lg_minimise_options options;
    lg_minimise_options_init(&options);
    options.method = LG_MINIMISE_LBFGS, options.memory = EVALUATIONS, options.check = false;
    for (size_t r = 0; r < s->rows; r++) {
        s->how[r * HOW + LG_POLICY_BEYOND] = 1.0;
        s->how[r * HOW + LG_POLICY_PENALTY] = price * s->unit[r / GUESSES] / (double)s->steps;
        lg_minimiser_destroy(s->minimiser[r]);
        s->minimiser[r] = NULL;
        LG_TRY(lg_minimiser_create(s->policy->context, s->n, &options, s->guess + r * s->n, &s->minimiser[r],
                                   error));
    }
    for (int i = 0; i < EVALUATIONS && lg_seconds() < s->end && !lg_cancelled(s->policy->context); i++) {
        for (size_t r = 0; r < s->rows; r++)
            deal(s, r, memcpy(s->own, lg_minimiser_point(s->minimiser[r]), s->n * sizeof *s->own), s->y,
                 true);
        lg_policy_cost(&s->rollout, &s->runs);
        lg_policy_backward(&s->rollout, &s->runs, INFINITY, NULL);
        for (size_t r = 0; r < s->rows; r++) {
            deal(s, r, s->own, s->slope, false);
            for (size_t k = 0; k < s->n; k++) s->own[k] /= s->unit[r / GUESSES];
            (void)lg_minimiser_tell(s->minimiser[r], s->total[r] / s->unit[r / GUESSES], s->own);
        }
    }
    for (size_t r = 0; r < s->rows; r++)
        memcpy(s->guess + r * s->n, lg_minimiser_best(s->minimiser[r]), s->n * sizeof *s->guess);
    take_best(s);
    for (size_t r = 0; r < s->rows; r++) {
        const size_t from = (r / GUESSES + r % GUESSES) % s->starts;
        memcpy(s->guess + r * s->n, s->kept + from * s->n, s->n * sizeof *s->guess);
        memcpy(s->how + r * HOW, s->by + from * HOW, HOW * sizeof *s->how);
    }
    return LG_OK;
}

static lg_status search_all(search *s, uint64_t seed, lg_error *error) {
    const lg_policy *p = s->policy;
    lg_rng rng;
    lg_rng_seed(&rng, seed, 0);
    LG_TRY(lg_policy_starts(p, &rng, s->starts, s->x, NULL, error));
    LG_TRY(lg_program_eval(p->context, p->program, "errors", s->starts, (const double *const[]){s->x},
                           (double *const[]){s->z}, error));
    for (size_t i = 0; i < s->starts; i++) s->best[i] = INFINITY;
    for (size_t r = 0; r < s->rows; r++) {
        lg_put_numbers(LG_F64, s->runs.path, r * p->state, s->x + r / GUESSES * p->state, p->state);
        lg_put_numbers(LG_F64, s->runs.weight, r, &(double){1.0}, 1);
    }
    guess(s, seed);
    take_best(s);
    for (size_t i = 0; i < s->starts; i++) {
        const double J = s->policy_cost[i] = s->total[i * GUESSES];
        s->unit[i] = isfinite(J) && J > 0.0 ? J : fmax(p->terminal, 1.0);
    }
    for (int k = 0; k < ROUNDS && lg_seconds() < s->end; k++)
        LG_TRY(search_round(s, pow(10.0, 1.0 + k / (ROUNDS - 1.0)), error));
    return lg_cancelled(p->context) ? lg_fail(error, LG_CANCELLED, "the search of inputs was stopped")
                                    : LG_OK;
}

static lg_status allocate(search *s, lg_error *error) {
    static const char *const names[] = {"planned", "terminal", "adj1_planned", "adj1_terminal"};
    const lg_policy *p = s->policy;
    const size_t x = p->state, errors = p->layout.errors, starts = s->starts, rows = s->rows, n = s->n;
    s->rollout = (lg_policy_rollout){.policy = p, .dtype = LG_F64, .rows = rows, .most = s->steps};
    LG_TRY(lg_policy_rollout_create(&s->rollout, names, LG_POLICY_PLANS, error));
    const size_t numbers = starts * (errors + x + 3 + HOW + n) + rows * n + n;
    if (LG_ALLOC_ALL(p->context, {&s->memory, s->rollout.bytes, 1}, LG_ARRAY(s->minimiser, rows),
                     LG_ARRAY(s->z, numbers)) != LG_OK)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a search of inputs from %zu starts", starts);
    lg_policy_piece_at(&s->rollout, s->memory, 0, &s->runs);
    s->y = (double *)(void *)s->runs.given[0], s->how = (double *)(void *)s->runs.given[1];
    s->slope = (double *)(void *)s->runs.slope;
    s->x = s->z + starts * errors, s->policy_cost = s->x + starts * x;
    s->unit = s->policy_cost + starts, s->best = s->unit + starts;
    s->by = s->best + starts, s->kept = s->by + starts * HOW, s->guess = s->kept + starts * n;
    s->own = s->guess + rows * n, s->total = s->runs.total;
    return LG_OK;
}

static void end(search *s) {
    lg_policy_plans_destroy(&s->rollout.plans);
    for (size_t r = 0; s->minimiser != NULL && r < s->rows; r++) lg_minimiser_destroy(s->minimiser[r]);
    LG_FREE_ALL(s->policy->context, s->minimiser, s->memory, s->z);
}

static void fill(const search *s, lg_policy_gap *out, bool *complete) {
    const size_t n = s->policy->layout.errors;
    for (size_t i = 0; i < s->starts; i++) {
        const double best = s->best[i], cost = isfinite(s->policy_cost[i]) ? s->policy_cost[i] : INFINITY;
        out[i] = (lg_policy_gap){cost, best, best < cost ? cost / best : 1.0, {0}};
        memcpy(out[i].errors, s->z + i * n, n * sizeof *s->z);
    }
    if (complete != NULL) *complete = lg_seconds() < s->end;
}

lg_status lg_policy_find_gaps(lg_policy *p, size_t starts, uint64_t seed, double seconds, lg_policy_gap *out,
                              bool *complete, lg_error *error) {
    LG_NEEDS(error, p, out);
    if (starts == 0 || starts > 1000 || !(seconds >= 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a search of inputs needs 1 to 1000 starts and a time >= 0");
    LG_CLEAN(end) search s = {.policy = p, .starts = starts, .rows = starts * GUESSES};
    s.steps = lg_policy_periods(p, p->task.horizon), s.n = s.steps * p->inputs;
    s.end = seconds > 0.0 ? lg_seconds() + seconds : INFINITY;
    if (!lg_policy_has(p, "planned")) LG_TRY(lg_policy_add(p, "planned", error));
    if (!lg_policy_has(p, "adj1_planned")) LG_TRY(lg_policy_add(p, "adj1_planned", error));
    LG_TRY(allocate(&s, error));
    LG_TRY(search_all(&s, seed, error));
    fill(&s, out, complete);
    return LG_OK;
}

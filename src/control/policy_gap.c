/* Policies: how much cheaper the best inputs are that a search finds for a start. The inputs of a run are
 * planned by corrections y of a feedback (function `planned`). Open-loop inputs of an unstable machine would
 * amplify rounding, but corrections do not, and every sequence of inputs has its corrections. */
#include <math.h>
#include <string.h>

#include "control/policy.h"
#include "liegrad/minimise.h"

enum { GUESSES = 8, ROUNDS = 9, EVALUATIONS = 20 }; /* of a start: guesses, rounds, evaluations of each */
enum { PLANNED, TERMINAL, ADJOINT_PLANNED, ADJOINT_TERMINAL, PLANS };

/* First guesses: the corrected feedback, and whether the corrections are random or those of no input. */
static const struct {
    double policy, regulator;
    bool random;
} guesses[GUESSES] = {{1, 0, false}, {0, 1, false}, {0, 0, false}, {1, 0, true},
                      {0, 1, true},  {0, 0, true},  {1, 0, true},  {0, 1, true}};

typedef struct search {
    const lg_policy *policy;
    size_t starts, steps, n; /* n: numbers in y, (steps, inputs) */
    lg_plan *plan[PLANS];
    double *x, *cost;           /* (starts, state); (starts) */
    double *best, *by, *best_y; /* (starts), (starts, LG_POLICY_PLANNED), (starts, n) */
    double *y, *how;            /* (starts, GUESSES, n or LG_POLICY_PLANNED) */
    double *z;                  /* (starts, errors) */
    lg_minimiser **minimiser;   /* (starts, GUESSES) */
    char *memory;
    size_t bytes;
    bool *late; /* (starts): time ran out */
    uint32_t round;
    double begun, seconds; /* by the clock; seconds 0: no bound */
} search;

/* The memory for the runs of a start; the arrays of a period have GUESSES rows. */
typedef struct runs {
    double *path, *y, *slope; /* (steps + 1, state), (steps, inputs) twice */
    double *cost, *total, *one, *lambda, *before, *gradient, *value;
    const double *how;
    void *work;
} runs;

static size_t lay_out(const search *s, char *memory, runs *out) {
    const size_t x = s->policy->state, each[] = {(s->steps + 1) * x, s->n, s->n, 1, 1, 1, x, x, s->n, 1};
    double **const arrays[] = {&out->path, &out->y,      &out->slope,  &out->cost,     &out->total,
                               &out->one,  &out->lambda, &out->before, &out->gradient, &out->value};
    size_t used = 0, work = 0;
    for (size_t i = 0; i < LG_COUNT(arrays); i++) {
        if (memory != NULL) *arrays[i] = (double *)(void *)(memory + used);
        used += (GUESSES * each[i] * sizeof(double) + 63) / 64 * 64;
    }
    if (memory != NULL) out->work = memory + used;
    for (size_t i = 0; i < PLANS; i++)
        work = lg_plan_work_size(s->plan[i]) > work ? lg_plan_work_size(s->plan[i]) : work;
    return used + (work + 63) / 64 * 64;
}

/* Moves row r of (GUESSES, n) into the rows of periods, or out of them. */
static void deal(const search *s, size_t r, const double *from, double *to, bool into) {
    const size_t m = s->policy->inputs;
    for (size_t k = 0; k < s->steps; k++) {
        const size_t here = k * m, there = (k * GUESSES + r) * m;
        memcpy(to + (into ? there : here), from + (into ? here : there), m * sizeof *to);
    }
}

/* The costs of the runs of a start, w->total. */
static void forward(const search *s, size_t start, runs *w) {
    const size_t x = s->policy->state, u = GUESSES * s->policy->inputs;
    memset(w->total, 0, GUESSES * sizeof *w->total);
    for (size_t r = 0; r < GUESSES; r++) memcpy(w->path + r * x, s->x + start * x, x * sizeof *w->path);
    for (size_t k = 0; k <= s->steps; k++) {
        double *at = w->path + k * GUESSES * x;
        if (k < s->steps)
            lg_plan_eval(s->plan[PLANNED], (const void *[]){at, w->y + k * u, w->how},
                         (void *[]){at + GUESSES * x, w->cost, NULL}, w->work);
        else
            lg_plan_eval(s->plan[TERMINAL], (const void *[]){at}, (void *[]){w->cost}, w->work);
        for (size_t r = 0; r < GUESSES; r++) w->total[r] += w->cost[r];
    }
}

/* w->slope: the gradient of each run's cost by its y. */
static void backward(const search *s, runs *w) {
    const size_t x = GUESSES * s->policy->state, u = GUESSES * s->policy->inputs;
    double *lambda = w->lambda, *next = w->before;
    for (size_t r = 0; r < GUESSES; r++) w->one[r] = 1.0;
    lg_plan_eval(s->plan[ADJOINT_TERMINAL], (const void *[]){w->path + s->steps * x, w->one},
                 (void *[]){lambda}, w->work);
    for (size_t k = s->steps; k-- > 0;) {
        lg_plan_eval(s->plan[ADJOINT_PLANNED],
                     (const void *[]){w->path + k * x, w->y + k * u, w->how, lambda, w->one},
                     (void *[]){next, w->slope + k * u}, w->work);
        double *const swap = lambda;
        lambda = next, next = swap;
    }
}

/* The runs of s->y with inputs in their limits; keeps the cheapest. */
static void take_best(const search *s, size_t start, runs *w) {
    double how[GUESSES * LG_POLICY_PLANNED];
    const double *own = s->how + start * GUESSES * LG_POLICY_PLANNED;
    for (size_t i = 0; i < GUESSES * LG_POLICY_PLANNED; i++)
        how[i] = i % LG_POLICY_PLANNED < LG_POLICY_BEYOND ? own[i] : 0.0;
    for (size_t r = 0; r < GUESSES; r++) deal(s, r, s->y + (start * GUESSES + r) * s->n, w->y, true);
    w->how = how;
    forward(s, start, w);
    w->how = own;
    for (size_t r = 0; r < GUESSES; r++) {
        if (!(w->total[r] < s->best[start])) continue;
        s->best[start] = w->total[r];
        memcpy(s->best_y + start * s->n, s->y + (start * GUESSES + r) * s->n, s->n * sizeof *s->y);
        memcpy(s->by + start * LG_POLICY_PLANNED, how + r * LG_POLICY_PLANNED,
               LG_POLICY_PLANNED * sizeof *how);
    }
}

static double unit_of(const search *s, size_t start) {
    return s->cost[start] > 0.0 && isfinite(s->cost[start]) ? s->cost[start] : fmax(s->policy->terminal, 1.0);
}

/* In the first round each start has a part of the time. */
static bool stopped(const search *s, size_t start) {
    const double part = s->round > 0 ? 1.0 : (double)(start + 1) / (double)s->starts;
    const bool late = s->seconds > 0.0 && lg_seconds() - s->begun > part * s->seconds;
    s->late[start] = s->late[start] || late;
    return late || lg_cancelled(s->policy->context);
}

/* Evaluates the points of the minimisers that run. false: all have ended. */
static bool advance(const search *s, size_t start, runs *w) {
    const double unit = unit_of(s, start);
    bool running[GUESSES], any = false;
    for (size_t r = 0; r < GUESSES; r++) {
        const lg_minimiser *own = s->minimiser[start * GUESSES + r];
        running[r] = lg_minimiser_result(own).end == LG_MINIMISE_RUNNING;
        any = any || running[r];
        deal(s, r, lg_minimiser_point(own), w->y, true);
    }
    if (!any) return false;
    forward(s, start, w);
    backward(s, w);
    for (size_t r = 0; r < GUESSES; r++) {
        if (!running[r]) continue;
        deal(s, r, w->slope, w->gradient, false);
        for (size_t i = 0; i < s->n; i++) w->gradient[i] /= unit;
        (void)lg_minimiser_tell(s->minimiser[start * GUESSES + r], w->total[r] / unit, w->gradient);
    }
    return true;
}

static void search_start(void *user, size_t start) {
    const search *s = user;
    runs w = {0};
    (void)lay_out(s, s->memory + start * s->bytes, &w);
    w.how = s->how + start * GUESSES * LG_POLICY_PLANNED;
    for (int i = 0; i < EVALUATIONS && !stopped(s, start) && advance(s, start, &w); i++) continue;
    for (size_t r = 0; r < GUESSES; r++)
        memcpy(s->y + (start * GUESSES + r) * s->n, lg_minimiser_best(s->minimiser[start * GUESSES + r]),
               s->n * sizeof *s->y);
    take_best(s, start, &w);
}

/* The costs of the guesses; the first one is the policy's run. */
static void try_guesses(void *user, size_t start) {
    const search *s = user;
    runs w = {0};
    (void)lay_out(s, s->memory + start * s->bytes, &w);
    s->best[start] = INFINITY;
    take_best(s, start, &w);
    s->cost[start] = w.total[0];
}

/* ---- guesses ---- */

/* Corrections that a first guess begins with: 0, or of each eighth of the first half of the run a random one. */
static void guess(const search *s, size_t row, lg_rng *rng, double *y) {
    const lg_policy *p = s->policy;
    const size_t m = p->inputs, part = s->steps / 16 + 1;
    const bool alone = guesses[row].policy + guesses[row].regulator == 0.0;
    for (size_t i = 0; i < s->n; i++) {
        const lg_policy_input *in = &p->task.input[i % m];
        const double half = 0.5 * (in->high - in->low), to = alone ? p->regulator.u0[i % m] / half : 0.0;
        y[i] = to;
        if (!guesses[row].random || i / m >= 8 * part) continue;
        const double drawn =
            lg_rng_uniform_in(rng, -1.0, 1.0) + (alone ? 0.5 * (in->high + in->low) / half : 0);
        y[i] = i / m % part == 0 ? drawn : y[i - m];
    }
}

/* Later rounds begin at the best inputs so far, of this start and of those after it. */
static void set_guesses(search *s, uint64_t seed) {
    for (size_t i = 0; i < s->starts; i++) {
        lg_rng rng;
        lg_rng_seed(&rng, seed, 1 + i);
        for (size_t r = 0; r < GUESSES; r++) {
            double *y = s->y + (i * GUESSES + r) * s->n,
                   *how = s->how + (i * GUESSES + r) * LG_POLICY_PLANNED;
            const size_t of = (i + r) % s->starts;
            if (s->round == 0)
                how[0] = guesses[r].policy, how[1] = guesses[r].regulator, guess(s, r, &rng, y);
            else
                memcpy(y, s->best_y + of * s->n, s->n * sizeof *y),
                    memcpy(how, s->by + of * LG_POLICY_PLANNED, LG_POLICY_PLANNED * sizeof *how);
        }
    }
}

/* Inputs may pass their limits, at a price that grows tenfold, in units of the mean cost of a period. */
static lg_status begin_round(search *s, lg_error *error) {
    lg_minimise_options options;
    lg_minimise_options_init(&options);
    options.method = LG_MINIMISE_LBFGS;
    options.memory = 20;
    options.check = false;
    for (size_t k = 0; k < s->starts * GUESSES; k++) {
        double *how = s->how + k * LG_POLICY_PLANNED;
        how[LG_POLICY_BEYOND] = 1.0;
        how[LG_POLICY_PENALTY] =
            pow(10.0, 1.0 + s->round / (ROUNDS - 1.0)) * unit_of(s, k / GUESSES) / (double)s->steps;
        lg_minimiser_destroy(s->minimiser[k]);
        s->minimiser[k] = NULL;
        LG_TRY(lg_minimiser_create(s->policy->context, s->n, &options, s->y + k * s->n, &s->minimiser[k],
                                   error));
    }
    return LG_OK;
}

static lg_status run_rounds(search *s, uint64_t seed, int threads, lg_error *error) {
    lg_thread_pool *pool = NULL;
    LG_TRY(lg_thread_pool_create(s->policy->context, threads, &pool));
    lg_status status = LG_OK;
    for (s->round = 0; s->round < ROUNDS && status == LG_OK; s->round++) {
        set_guesses(s, seed);
        if (s->round == 0) lg_thread_pool_run(pool, s->starts, try_guesses, s);
        status = begin_round(s, error);
        if (status == LG_OK) lg_thread_pool_run(pool, s->starts, search_start, s);
    }
    lg_thread_pool_destroy(pool);
    if (status == LG_OK && lg_cancelled(s->policy->context))
        status = lg_fail(error, LG_CANCELLED, "the search for better inputs was stopped");
    return status;
}

static lg_status allocate(search *s, double **memory, lg_error *error) {
    static const char *const names[PLANS] = {"planned", "terminal", "adj1_planned", "adj1_terminal"};
    const lg_policy *p = s->policy;
    const size_t rows = s->starts * GUESSES, how = LG_POLICY_PLANNED;
    for (size_t i = 0; i < PLANS; i++)
        LG_TRY(lg_policy_plan(p, names[i], LG_F64, GUESSES, &s->plan[i], error));
    s->bytes = lay_out(s, NULL, &(runs){0});
    s->memory = lg_alloc(p->context, s->starts, s->bytes);
    s->minimiser = lg_alloc(p->context, rows, sizeof(lg_minimiser *));
    *memory =
        lg_alloc(p->context,
                 s->starts * (p->state + 2 + how + s->n) + rows * (s->n + how) + s->starts * p->layout.errors,
                 sizeof **memory);
    s->late = lg_alloc(p->context, s->starts, sizeof *s->late);
    if (s->late == NULL || s->memory == NULL || s->minimiser == NULL || *memory == NULL)
        return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a search of inputs from %zu starts",
                       s->starts);
    s->x = *memory, s->cost = s->x + s->starts * p->state, s->best = s->cost + s->starts;
    s->by = s->best + s->starts, s->best_y = s->by + s->starts * how;
    s->y = s->best_y + s->starts * s->n, s->how = s->y + rows * s->n;
    s->z = s->how + rows * how;
    return LG_OK;
}

static void fill(const search *s, lg_policy_gap *out) {
    const size_t n = s->policy->layout.errors;
    for (size_t i = 0; i < s->starts; i++) {
        const double cost = isfinite(s->cost[i]) ? s->cost[i] : INFINITY, best = s->best[i];
        out[i] = (lg_policy_gap){cost, best, cost == best ? 1.0 : cost / best, {0}};
        memcpy(out[i].errors, s->z + i * n, n * sizeof *s->z);
    }
}

/* The starts that lg_policy_evaluate takes. */
static lg_status draw_starts(const search *s, uint64_t seed, lg_error *error) {
    const lg_policy *p = s->policy;
    lg_rng rng;
    lg_rng_seed(&rng, seed, 0);
    for (size_t i = 0; i < s->starts; i++)
        lg_policy_draw(&p->task, &p->layout, &rng, s->z + i * p->layout.errors);
    return lg_policy_states(p, s->z, s->starts, s->x, error);
}

lg_status lg_policy_find_gaps(lg_policy *p, size_t starts, uint64_t seed, int threads, double seconds,
                              lg_policy_gap *out, bool *complete, lg_error *error) {
    LG_NEEDS(error, p, out);
    if (starts == 0 || starts > 1000 || !(seconds >= 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "a search of inputs needs 1 to 1000 starts and a time >= 0");
    search s = {.policy = p, .starts = starts, .steps = lg_policy_periods(p, p->task.horizon)};
    s.n = s.steps * p->inputs;
    s.begun = lg_seconds(), s.seconds = seconds;
    double *memory = NULL;
    size_t at;
    lg_status status =
        lg_program_find(p->program, "planned", &at, NULL) == LG_OK ? LG_OK : lg_policy_add_planned(p, error);
    if (status == LG_OK) status = allocate(&s, &memory, error);
    if (status == LG_OK) status = draw_starts(&s, seed, error);
    if (status == LG_OK) status = run_rounds(&s, seed, threads, error);
    if (status == LG_OK) fill(&s, out);
    bool all = true;
    for (size_t i = 0; i < starts && status == LG_OK; i++) all = all && !s.late[i];
    if (status == LG_OK && complete != NULL) *complete = all;
    for (size_t i = 0; i < PLANS; i++) lg_plan_destroy(s.plan[i]);
    for (size_t i = 0; s.minimiser != NULL && i < starts * GUESSES; i++) lg_minimiser_destroy(s.minimiser[i]);
    lg_free(p->context, s.late), lg_free(p->context, s.minimiser), lg_free(p->context, s.memory),
        lg_free(p->context, memory);
    return status;
}

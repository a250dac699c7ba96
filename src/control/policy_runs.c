/* Policies: runs of the closed loop, in pieces of LG_POLICY_ROWS starts. */
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "control/policy.h"
#include "core/portions.h"

enum { ROWS = LG_POLICY_ROWS };

size_t lg_policy_periods(const lg_policy *policy, double seconds) {
    const double n = floor(seconds / policy->task.period + 0.5);
    return n > 1.0 ? (size_t)n : 1;
}

lg_status lg_policy_states_at(const lg_policy *p, const double *q, const double *v, size_t count, double *x,
                              lg_error *error) {
    if (p->layout.velocities > 0)
        return lg_program_eval(p->context, p->program, "momenta", count, (const double *const[]){q, v},
                               (double *const[]){x}, error);
    memcpy(x, q, count * p->layout.positions * sizeof *x);
    return LG_OK;
}

lg_status lg_policy_see(const lg_policy *p, const double *x, size_t count, double *q, double *v,
                        lg_error *error) {
    const double *const in[] = {x};
    if (p->layout.velocities == 0) {
        memcpy(q, x, count * p->state * sizeof *x);
        return LG_OK;
    }
    LG_TRY(lg_program_eval(p->context, p->program, "positions", count, in, (double *const[]){q}, error));
    return lg_program_eval(p->context, p->program, "velocities", count, in, (double *const[]){v}, error);
}

lg_status lg_policy_states(const lg_policy *p, const double *z, size_t count, double *x, lg_error *error) {
    return lg_program_eval(p->context, p->program, "retract", count, (const double *const[]){z},
                           (double *const[]){x}, error);
}

lg_status lg_policy_starts(const lg_policy *p, lg_rng *rng, size_t count, double *x, double *u,
                           lg_error *error) {
    LG_TRY_SCRATCH(double, z, p->context, count * p->layout.errors, lg_no_memory(error));
    for (size_t i = 0; i < count; i++) {
        lg_policy_draw(p, rng, z + i * p->layout.errors);
        for (uint32_t l = 0; u != NULL && l < p->inputs; l++)
            *u++ = lg_rng_uniform_in(rng, p->task.input[l].low, p->task.input[l].high);
    }
    return lg_policy_states(p, z, count, x, error);
}

lg_status lg_policy_plans_create(const lg_policy *p, bool drawn, const char *const *functions, size_t count,
                                 lg_dtype dtype, size_t rows, lg_policy_plans *out, lg_error *error) {
    const size_t machines = drawn && p->draw_count > 0 ? p->draw_count : 1, all = machines * count;
    *out = (lg_policy_plans){.context = p->context, .machines = machines, .count = count};
    out->plan = lg_alloc(p->context, all, sizeof(lg_plan *));
    if (out->plan == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for plans of a policy");
    for (size_t i = 0; i < all; i++) {
        const lg_policy *of = drawn && p->draw_count > 0 ? p->draws[i / count % p->draw_count] : p;
        LG_TRY(lg_program_plan(of->program, functions[i % count], dtype, rows, &out->plan[i], error));
        const size_t own = lg_plan_work_size(out->plan[i]);
        out->work = own > out->work ? own : out->work;
    }
    return LG_OK;
}

void lg_policy_plans_destroy(lg_policy_plans *plans) {
    for (size_t i = 0; plans->plan != NULL && i < plans->machines * plans->count; i++)
        lg_plan_destroy(plans->plan[i]);
    lg_free(plans->context, plans->plan);
}

void lg_policy_draw_noise(const lg_policy *p, uint64_t seed, uint64_t piece, size_t periods, double *noise,
                          double *late) {
    double sizes[LG_POLICY_NOISE];
    const size_t n = p->layout.noise;
    lg_rng rng;
    lg_policy_noise_sizes(&p->task, sizes);
    lg_rng_seed(&rng, seed ^ UINT64_C(0xd1b54a32d192ed03), piece);
    for (size_t i = 0; i < ROWS; i++) late[i] = lg_rng_uniform(&rng) < p->task.delay ? 1.0 : 0.0;
    for (size_t i = 0; i < periods * ROWS * n; i++)
        noise[i] = sizes[i % n] > 0.0 ? sizes[i % n] * lg_rng_normal(&rng) : 0.0;
}

enum { STEP, ERRORS, POSITIONS, PLANS }; /* POSITIONS: of a plant with velocities */

typedef struct running {
    const lg_policy *policy;
    const lg_policy_trial *trial;
    lg_policy_plans plans;
    lg_policy_runs *runs;
    size_t pieces, hold; /* periods at the end that must be inside */
    size_t width, noise; /* numbers in the state of a run, and in its noise in a period */
    char *memory;
    size_t piece_bytes;
} running;

/* The work memory of a piece: states x, the input before, what a step takes and gives (width), errors and
 * behind them positions, costs, inputs, disturbances, and the plans' memory. */
typedef struct piece {
    double *x, *before, *state, *next, *z, *cost, *u, *noise, *late;
    void *work;
} piece;

static size_t lay_out(const running *r, char *memory, piece *out) {
    const lg_policy *p = r->policy;
    double **const arrays[] = {&out->x,    &out->before, &out->state, &out->next, &out->z,
                               &out->cost, &out->u,      &out->noise, &out->late};
    const size_t noise = r->runs->steps * r->noise, z = p->layout.errors + p->layout.positions,
                 counts[] = {p->state, p->inputs, r->width, r->width, z, 1, p->inputs, noise, 1};
    lg_portions from = {memory, 0};
    for (size_t i = 0; i < LG_COUNT(arrays); i++)
        *arrays[i] = lg_portion(&from, ROWS * counts[i], sizeof(double));
    out->work = lg_portion(&from, r->plans.work, 1);
    return from.used;
}

bool lg_policy_at_limit(const lg_policy *p, const double *u) {
    for (uint32_t l = 0; l < p->inputs; l++) {
        const lg_policy_input *in = &p->task.input[l];
        const double near = 1e-3 * (in->high - in->low);
        if (u[l] <= in->low + near || u[l] >= in->high - near) return true;
    }
    return false;
}

static void note(const running *r, const piece *w, size_t first, size_t count, size_t k) {
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    const size_t n = p->layout.errors, positions = p->layout.positions;
    const double *q = r->plans.count > POSITIONS ? w->z + ROWS * n : w->x;
    for (size_t i = 0; i < count; i++) {
        if (runs->path != NULL)
            memcpy(runs->path + (k * runs->count + first + i) * n, w->z + i * n, n * sizeof *w->z);
        if (k + r->hold > runs->steps && !lg_policy_inside(p, q + i * positions, w->z + i * n))
            runs->succeeded[first + i] = false;
    }
}

static void tell(const running *r, const piece *w, size_t first, size_t count, size_t k) {
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    for (size_t i = 0; i < count; i++) {
        const double *u = w->u + i * p->inputs;
        if (runs->cost != NULL) runs->cost[first + i] += w->cost[i];
        if (runs->costs != NULL) runs->costs[k * runs->count + first + i] = w->cost[i];
        if (runs->saturated != NULL && lg_policy_at_limit(p, u))
            runs->saturated[first + i] += 1.0 / (double)runs->steps;
        if (runs->input != NULL)
            memcpy(runs->input + (k * runs->count + first + i) * p->inputs, u, p->inputs * sizeof *u);
    }
}

/* The states of a piece; a last piece repeats its first start. */
static void begin(const running *r, size_t index, size_t count, piece *w) {
    const lg_policy *p = r->policy;
    for (size_t i = 0; i < ROWS; i++) {
        memcpy(w->x + i * p->state, r->runs->x + (index * ROWS + (i < count ? i : 0)) * p->state,
               p->state * sizeof *w->x);
        memcpy(w->before + i * p->inputs, p->regulator.u0, p->inputs * sizeof *w->before);
    }
    if (r->trial->disturbed)
        lg_policy_draw_noise(p, r->trial->seed, index, r->runs->steps, w->noise, w->late);
}

/* Moves the states by period k. */
static void step(const running *r, const lg_plan *plan, size_t k, piece *w) {
    const lg_policy *p = r->policy;
    const size_t x = p->state, n = r->width;
    for (size_t i = 0; i < ROWS; i++) {
        memcpy(w->state + i * n, w->x + i * x, x * sizeof *w->x);
        if (n > x) memcpy(w->state + i * n + x, w->before + i * p->inputs, p->inputs * sizeof *w->x);
    }
    const void *in[4] = {w->state};
    size_t count = 1;
    if (r->trial->gain != NULL)
        in[count++] = r->trial->gain;
    else if (p->parameters > 0)
        in[count++] = r->trial->theta;
    in[count] = w->noise + k * ROWS * r->noise, in[count + 1] = w->late;
    lg_plan_eval(plan, in, (void *[]){w->next, w->cost, w->u}, w->work);
    for (size_t i = 0; i < ROWS; i++) {
        memcpy(w->x + i * x, w->next + i * n, x * sizeof *w->x);
        if (n > x) memcpy(w->before + i * p->inputs, w->next + i * n + x, p->inputs * sizeof *w->x);
    }
}

static void run_piece(void *user, size_t index) {
    const running *r = user;
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    const size_t first = index * ROWS, left = runs->count - first, count = left < ROWS ? left : ROWS;
    lg_plan *const *plan = r->plans.plan + index % r->plans.machines * r->plans.count;
    piece w = {0};
    (void)lay_out(r, r->memory + index * r->piece_bytes, &w);
    begin(r, index, count, &w);
    for (size_t k = 0; k <= runs->steps; k++) {
        if (runs->motion != NULL)
            memcpy(runs->motion + (k * runs->count + first) * p->state, w.x, count * p->state * sizeof *w.x);
        if (runs->path != NULL || k + r->hold > runs->steps) {
            lg_plan_eval(plan[ERRORS], (const void *[]){w.x}, (void *[]){w.z}, w.work);
            if (r->plans.count > POSITIONS)
                lg_plan_eval(plan[POSITIONS], (const void *[]){w.x},
                             (void *[]){w.z + ROWS * p->layout.errors}, w.work);
            note(r, &w, first, count, k);
        }
        if (k == runs->steps) break;
        step(r, plan[STEP], k, &w);
        tell(r, &w, first, count, k);
    }
    memcpy(runs->x + first * p->state, w.x, count * p->state * sizeof *w.x);
}

static void run_all(running *r, lg_thread_pool *pool) {
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    for (size_t i = 0; i < runs->count; i++) {
        runs->succeeded[i] = true;
        if (runs->cost != NULL) runs->cost[i] = 0.0;
        if (runs->saturated != NULL) runs->saturated[i] = 0.0;
    }
    lg_thread_pool_run(pool, r->pieces, run_piece, r);
    for (size_t i = 0; i < runs->count; i++)
        for (uint32_t k = 0; k < p->state; k++)
            if (!isfinite(runs->x[i * p->state + k])) runs->succeeded[i] = false;
}

lg_status lg_policy_run(const lg_policy *p, const lg_policy_trial *trial, lg_policy_runs *runs,
                        lg_error *error) {
    static const char *const steps[2][2] = {{"closed", "regulated"}, {"disturbed", "disturbed_regulator"}};
    const char *const names[PLANS] = {steps[trial->disturbed][trial->gain != NULL], "errors", "positions"};
    const size_t functions = p->layout.velocities > 0 ? PLANS : POSITIONS;
    running r = {.policy = p, .trial = trial, .runs = runs, .width = p->state};
    LG_CLEAN(lg_policy_plans_destroy) lg_policy_plans plans;
    LG_CLEAN(lg_thread_pool_destroy_at) lg_thread_pool *pool = NULL;
    if (trial->disturbed) r.width += p->inputs, r.noise = p->layout.noise;
    LG_TRY(lg_policy_plans_create(p, trial->disturbed, names, functions, LG_F64, ROWS, &plans, error));
    LG_TRY(lg_thread_pool_create(p->context, trial->threads, &pool));
    r.plans = plans;
    r.pieces = (runs->count + ROWS - 1) / ROWS;
    r.hold = lg_policy_periods(p, p->task.hold);
    r.piece_bytes = lay_out(&r, NULL, &(piece){0});
    LG_TRY_SCRATCH(char, memory, p->context, (uint64_t)r.pieces *r.piece_bytes, lg_no_memory(error));
    r.memory = memory;
    run_all(&r, pool);
    return LG_OK;
}

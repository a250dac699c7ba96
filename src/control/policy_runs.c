/* Policies: runs of the closed loop, in pieces of LG_POLICY_ROWS starts. */
#include <math.h>
#include <string.h>

#include "autodiff/program/program.h"
#include "control/policy_rollout.h"

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

enum { ERRORS = 1, POSITIONS, PLANS }; /* POSITIONS: of a plant with velocities */

typedef struct running {
    const lg_policy *policy;
    const lg_policy_trial *trial;
    lg_policy_runs *runs;
    lg_policy_rollout rollout;
    size_t hold; /* number of last periods in which a run must stay within the bounds of success */
} running;

bool lg_policy_at_limit(const lg_policy *p, const double *u) {
    for (uint32_t l = 0; l < p->inputs; l++) {
        const lg_policy_input *in = &p->task.input[l];
        const double near = 1e-3 * (in->high - in->low);
        if (u[l] <= in->low + near || u[l] >= in->high - near) return true;
    }
    return false;
}

/* The states x of a piece after k periods. */
static void note(const running *r, const lg_policy_piece *w, double *x, size_t first, size_t count,
                 size_t k) {
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    const size_t n = p->layout.errors, positions = p->layout.positions, state = r->rollout.state;
    const double *path = (const double *)(const void *)w->path + k * ROWS * state, *q = x;
    double *z = x + ROWS * p->state, *found = z + ROWS * n;
    for (size_t i = 0; i < ROWS; i++) memcpy(x + i * p->state, path + i * state, p->state * sizeof *x);
    if (runs->motion != NULL)
        memcpy(runs->motion + (k * runs->count + first) * p->state, x, count * p->state * sizeof *x);
    if (runs->path == NULL && k + r->hold <= runs->steps) return;
    lg_plan_eval(w->plan[ERRORS], (const void *[]){x}, (void *[]){z}, w->work);
    if (r->rollout.plans.count > POSITIONS)
        lg_plan_eval(w->plan[POSITIONS], (const void *[]){x}, (void *[]){found}, w->work), q = found;
    if (runs->path != NULL) memcpy(runs->path + (k * runs->count + first) * n, z, count * n * sizeof *z);
    for (size_t i = 0; i < count && k + r->hold > runs->steps; i++)
        if (!lg_policy_inside(p, q + i * positions, z + i * n)) runs->succeeded[first + i] = false;
}

static void tell(const running *r, const lg_policy_piece *w, size_t first, size_t count, size_t k) {
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    const double *cost = (const double *)(const void *)w->cost + k * ROWS,
                 *u = (const double *)(const void *)w->u + k * ROWS * p->inputs;
    for (size_t i = 0; i < count; i++, u += p->inputs) {
        if (runs->cost != NULL) runs->cost[first + i] += cost[i];
        if (runs->costs != NULL) runs->costs[k * runs->count + first + i] = cost[i];
        if (runs->saturated != NULL && lg_policy_at_limit(p, u))
            runs->saturated[first + i] += 1.0 / (double)runs->steps;
        if (runs->input != NULL)
            memcpy(runs->input + (k * runs->count + first + i) * p->inputs, u, p->inputs * sizeof *u);
    }
}

static lg_status run_piece(void *user, size_t index, lg_error *error) {
    const running *r = user;
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    const size_t first = index * ROWS, left = runs->count - first, count = left < ROWS ? left : ROWS,
                 numbers = ROWS * (p->state + p->layout.errors + p->layout.positions);
    lg_policy_piece w = {0};
    LG_TRY_SCRATCH(char, memory, p->context, r->rollout.bytes, lg_no_memory(error));
    LG_TRY_SCRATCH(double, x, p->context, numbers, lg_no_memory(error));
    lg_policy_piece_at(&r->rollout, memory, index, &w);
    lg_policy_begin_runs(&r->rollout, runs->x + first * p->state, count, r->trial->seed, index, &w);
    if (!r->rollout.varies[0])
        memcpy(w.given[0], r->trial->gain != NULL ? r->trial->gain : r->trial->theta,
               r->rollout.given[0] * sizeof(double));
    lg_policy_forward(&r->rollout, &w);
    for (size_t i = 0; i < count; i++) {
        runs->succeeded[first + i] = true;
        if (runs->cost != NULL) runs->cost[first + i] = 0.0;
        if (runs->saturated != NULL) runs->saturated[first + i] = 0.0;
    }
    for (size_t k = 0; k <= runs->steps; k++) {
        note(r, &w, x, first, count, k);
        if (k < runs->steps) tell(r, &w, first, count, k);
    }
    memcpy(runs->x + first * p->state, x, count * p->state * sizeof *x);
    for (size_t i = 0; i < count * p->state; i++)
        if (!isfinite(x[i])) runs->succeeded[first + i / p->state] = false;
    return LG_OK;
}

static void end(running *r) {
    lg_policy_plans_destroy(&r->rollout.plans);
}

lg_status lg_policy_run(const lg_policy *p, const lg_policy_trial *trial, lg_policy_runs *runs,
                        lg_error *error) {
    static const char *const steps[2][2] = {{"closed", "regulated"}, {"disturbed", "disturbed_regulator"}};
    const char *const names[PLANS] = {steps[trial->disturbed][trial->gain != NULL], "errors", "positions"};
    const size_t functions = p->layout.velocities > 0 ? PLANS : POSITIONS;
    LG_CLEAN(end) running r = {.policy = p, .trial = trial, .runs = runs};
    r.hold = lg_policy_periods(p, p->task.hold);
    r.rollout = (lg_policy_rollout){.policy = p, .dtype = LG_F64, .rows = ROWS, .most = runs->steps};
    LG_TRY(lg_policy_rollout_create(&r.rollout, names, functions, error));
    return lg_jobs_run(p->context, (uint64_t)trial->threads, (runs->count + ROWS - 1) / ROWS, run_piece, &r,
                       error);
}

/* Policies: runs of the closed loop, in pieces of LG_POLICY_ROWS starts. */
#include <math.h>
#include <string.h>

#include "control/policy.h"

enum { ROWS = LG_POLICY_ROWS };

size_t lg_policy_periods(const lg_policy *policy, double seconds) {
    const double n = floor(seconds / policy->task.period + 0.5);
    return n > 1.0 ? (size_t)n : 1;
}

lg_status lg_policy_states(const lg_policy *p, const double *z, size_t count, double *x, lg_error *error) {
    const size_t nq = p->layout.positions, nv = p->layout.velocities;
    double *q = lg_alloc(p->context, count * (nq + nv), sizeof *q);
    if (q == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for starts");
    double *v = q + count * nq;
    for (size_t i = 0; i < count; i++)
        lg_policy_retract(&p->task, &p->layout, z + i * p->layout.errors, q + i * nq, v + i * nv);
    lg_status status = LG_OK;
    if (nv == 0)
        memcpy(x, q, count * nq * sizeof *x);
    else
        status = lg_program_eval(p->context, p->program, "momenta", count, (const double *const[]){q, v},
                                 (double *const[]){x}, error);
    lg_free(p->context, q);
    return status;
}

typedef struct running {
    const lg_policy *policy;
    const lg_plan *step, *errors;
    const double *shared;
    lg_policy_runs *runs;
    size_t pieces, hold; /* periods at the end that must be inside */
    char *memory;
    size_t piece_bytes;
} running;

/* The work memory of a piece: states before and after, errors, costs, inputs, and the plans' memory. */
typedef struct piece {
    double *x, *next, *z, *cost, *u;
    void *work;
} piece;

static size_t aligned(size_t bytes) {
    return (bytes + 63) / 64 * 64;
}

static size_t lay_out(const running *r, char *memory, piece *out) {
    const lg_policy *p = r->policy;
    const size_t work = lg_plan_work_size(r->step), other = lg_plan_work_size(r->errors);
    double **const arrays[] = {&out->x, &out->next, &out->z, &out->cost, &out->u};
    const size_t counts[] = {p->state, p->state, p->layout.errors, 1, p->inputs};
    size_t used = 0;
    for (size_t i = 0; i < LG_COUNT(arrays); i++) {
        if (memory != NULL) *arrays[i] = (double *)(void *)(memory + used);
        used += aligned(ROWS * counts[i] * sizeof(double));
    }
    if (memory != NULL) out->work = memory + used;
    return used + aligned(work > other ? work : other);
}

static bool at_limit(const lg_policy *p, const double *u) {
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
    const size_t n = p->layout.errors;
    for (size_t i = 0; i < count; i++) {
        if (runs->path != NULL)
            memcpy(runs->path + (k * runs->count + first + i) * n, w->z + i * n, n * sizeof *w->z);
        if (k + r->hold > runs->steps && !lg_policy_inside(&p->task, &p->layout, w->z + i * n))
            runs->succeeded[first + i] = false;
    }
}

static void tell(const running *r, const piece *w, size_t first, size_t count, size_t k) {
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    for (size_t i = 0; i < count; i++) {
        const double *u = w->u + i * p->inputs;
        if (runs->cost != NULL) runs->cost[first + i] += w->cost[i];
        if (runs->saturated != NULL && at_limit(p, u))
            runs->saturated[first + i] += 1.0 / (double)runs->steps;
        if (runs->input != NULL)
            memcpy(runs->input + (k * runs->count + first + i) * p->inputs, u, p->inputs * sizeof *u);
    }
}

static void run_piece(void *user, size_t index) {
    const running *r = user;
    const lg_policy *p = r->policy;
    lg_policy_runs *runs = r->runs;
    const size_t first = index * ROWS, left = runs->count - first, count = left < ROWS ? left : ROWS;
    piece w = {0};
    (void)lay_out(r, r->memory + index * r->piece_bytes, &w);
    for (size_t i = 0; i < ROWS; i++) /* a last piece repeats its first start */
        memcpy(w.x + i * p->state, runs->x + (first + (i < count ? i : 0)) * p->state,
               p->state * sizeof *w.x);
    for (size_t k = 0; k <= runs->steps; k++) {
        if (runs->path != NULL || k + r->hold > runs->steps) {
            lg_plan_eval(r->errors, (const void *[]){w.x}, (void *[]){w.z}, w.work);
            note(r, &w, first, count, k);
        }
        if (k == runs->steps) break;
        lg_plan_eval(r->step, (const void *[]){w.x, r->shared}, (void *[]){w.next, w.cost, w.u}, w.work);
        tell(r, &w, first, count, k);
        memcpy(w.x, w.next, ROWS * p->state * sizeof *w.x);
    }
    memcpy(runs->x + first * p->state, w.x, count * p->state * sizeof *w.x);
}

lg_status lg_policy_run(const lg_policy *p, const double *gain, const double *theta, int threads,
                        lg_policy_runs *runs, lg_error *error) {
    running r = {.policy = p, .shared = gain != NULL ? gain : theta, .runs = runs};
    lg_plan *step = NULL, *errors = NULL;
    lg_thread_pool *pool = NULL;
    lg_status status = lg_policy_plan(p, gain != NULL ? "regulated" : "closed", LG_F64, ROWS, &step, error);
    if (status == LG_OK) status = lg_policy_plan(p, "errors", LG_F64, ROWS, &errors, error);
    if (status == LG_OK) status = lg_thread_pool_create(p->context, threads, &pool);
    if (status == LG_OK) {
        r.step = step, r.errors = errors;
        r.pieces = (runs->count + ROWS - 1) / ROWS;
        r.hold = lg_policy_periods(p, p->task.hold);
        r.piece_bytes = lay_out(&r, NULL, &(piece){0});
        r.memory = lg_alloc(p->context, r.pieces, r.piece_bytes);
        if (r.memory == NULL) status = lg_fail(error, LG_OUT_OF_MEMORY, "no memory for runs");
    }
    if (status == LG_OK) {
        for (size_t i = 0; i < runs->count; i++) {
            runs->succeeded[i] = true;
            if (runs->cost != NULL) runs->cost[i] = 0.0;
            if (runs->saturated != NULL) runs->saturated[i] = 0.0;
        }
        lg_thread_pool_run(pool, r.pieces, run_piece, &r);
        for (size_t i = 0; i < runs->count; i++)
            for (uint32_t k = 0; k < p->state; k++)
                if (!isfinite(runs->x[i * p->state + k])) runs->succeeded[i] = false;
    }
    lg_free(p->context, r.memory);
    lg_thread_pool_destroy(pool);
    lg_plan_destroy(step);
    lg_plan_destroy(errors);
    return status;
}

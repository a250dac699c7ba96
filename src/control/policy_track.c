/* Policies that follow set points, or to which a position does not matter: the machine must move in the same
 * way wherever the coordinate is. Then a set point is a shift of the coordinate, and a free position needs no
 * error. */
#include <math.h>
#include <string.h>

#include "control/policy.h"

enum { TRIALS = 32 };

/* Positions and velocities, (TRIALS, ...), and the inputs of a period. */
typedef struct trial {
    double *q, *v, *u;
} trial;

/* The motion over a period from `from`, whose position `at` is larger by `shift`; x (2, TRIALS, state) is
 * scratch. */
static lg_status move(const lg_policy *p, const trial *from, uint32_t at, double shift, double *x,
                      trial *before, trial *after, lg_error *error) {
    const size_t nq = p->layout.positions;
    double *next = x + TRIALS * p->state;
    memcpy(before->q, from->q, TRIALS * nq * sizeof *from->q);
    for (size_t i = 0; i < TRIALS; i++) before->q[i * nq + at] += shift;
    LG_TRY(lg_policy_states_at(p, before->q, from->v, TRIALS, x, error));
    LG_TRY(lg_policy_see(p, x, TRIALS, before->q, before->v, error));
    LG_TRY(lg_program_eval(p->context, p->program, "period", TRIALS, (const double *const[]){x, from->u},
                           (double *const[]){next}, error));
    return lg_policy_see(p, next, TRIALS, after->q, after->v, error);
}

/* Whether numbers (TRIALS, n) change alike from a to b and from c to d; the number `at` has been shifted. */
static bool alike(uint32_t n, const double *a, const double *b, const double *c, const double *d, uint32_t at,
                  double shift) {
    for (uint32_t j = 0; j < n; j++) {
        double off = 0.0, change = 0.0;
        for (size_t i = j; i < (size_t)TRIALS * n; i += n) {
            const double moved = b[i] - a[i], differs = d[i] - c[i] - moved;
            off += differs * differs, change += moved * moved;
        }
        const double rounding = j == at ? 1e-9 * fabs(shift) * sqrt((double)TRIALS) : 0.0;
        if (!(sqrt(off) <= 1e-4 * sqrt(change) + rounding)) return false;
    }
    return true;
}

/* How far a coordinate is shifted: beyond its starts, or as far as it goes in a run. */
static double shift_of(const lg_policy_task *task, const lg_policy_coordinate *c) {
    const double far = lg_policy_reach(c->start), fast = lg_policy_reach(c->start_velocity);
    if (c->motion == LG_POLICY_ANGLE) return 1.0;
    if (far > 0.0) return 4.0 * far;
    if (isfinite(c->success)) return 10.0 * c->success;
    if (fast > 0.0) return fast * task->horizon;
    return isfinite(c->success_velocity) ? c->success_velocity * task->horizon : 1.0;
}

/* `own` are random states; `other` has room for four motions. */
static lg_status compare(const lg_policy *p, uint32_t k, const trial *own, double *x, trial *other,
                         lg_error *error) {
    const lg_policy_coordinate *c = &p->task.coordinate[k];
    const uint32_t at = p->layout.at[k].position;
    const double shift = shift_of(&p->task, c);
    LG_TRY(move(p, own, at, 0.0, x, &other[0], &other[1], error));
    LG_TRY(move(p, own, at, shift, x, &other[2], &other[3], error));
    if (alike(p->layout.positions, other[0].q, other[1].q, other[2].q, other[3].q, at, shift) &&
        alike(p->layout.velocities, other[0].v, other[1].v, other[2].v, other[3].v, UINT32_MAX, shift))
        return LG_OK;
    return lg_fail(
        error, LG_CHECK_FAILED,
        c->free ? "free: the machine moves otherwise where %s is %.3g larger, so the position of %s "
                  "matters and cannot be left out"
                : "track: the machine moves otherwise where %s is %.3g larger, so no set point of %s can be "
                  "followed by a shift",
        c->name, shift, c->name);
}

static bool shifted(const lg_policy_coordinate *c, bool tracked) {
    return (tracked && c->track) || c->free;
}

lg_status lg_policy_check_shifts(const lg_policy *p, bool tracked, uint64_t seed, lg_error *error) {
    enum { KEPT = 5 };
    const lg_policy_task *task = &p->task;
    const size_t nq = p->layout.positions, nv = p->layout.velocities;
    trial all[KEPT];
    bool any = false;
    lg_rng rng;
    for (uint32_t k = 0; k < task->coordinate_count; k++) any = any || shifted(&task->coordinate[k], tracked);
    if (!any) return LG_OK;
    LG_TRY_SCRATCH(double, x, p->context, TRIALS *(2 * p->state + KEPT * (nq + nv) + p->inputs),
                   lg_no_memory(error));
    double *at = x + (size_t)2 * TRIALS * p->state;
    for (int i = 0; i < KEPT; i++, at += TRIALS * (nq + nv)) all[i] = (trial){.q = at, .v = at + TRIALS * nq};
    all[0].u = at;
    lg_rng_seed(&rng, seed, 9);
    LG_TRY(lg_policy_starts(p, &rng, TRIALS, x, all[0].u, error));
    LG_TRY(lg_policy_see(p, x, TRIALS, all[0].q, all[0].v, error));
    for (uint32_t k = 0; k < task->coordinate_count; k++) /* free positions from their range */
        for (size_t i = p->layout.at[k].position; task->coordinate[k].free && i < TRIALS * nq; i += nq)
            all[0].q[i] +=
                lg_rng_uniform_in(&rng, task->coordinate[k].start[0], task->coordinate[k].start[1]);
    for (uint32_t k = 0; k < task->coordinate_count; k++)
        if (shifted(&task->coordinate[k], tracked)) LG_TRY(compare(p, k, &all[0], x, all + 1, error));
    return LG_OK;
}

/* Policies that follow set points, or to which a position does not matter: the machine must move in the same
 * way wherever the coordinate is. Then a set point is a shift of the coordinate, and a free position needs no
 * error. */
#include <math.h>
#include <string.h>

#include "control/policy.h"

enum { TRIALS = 32 };

/* What a trial keeps of its states: (TRIALS, positions + velocities), before and after a period. */
typedef struct motion {
    double *before, *after;
} motion;

static uint32_t numbers_of(const lg_policy *p) {
    return p->layout.positions + p->layout.velocities;
}

/* Positions and velocities of states. */
static lg_status see(const lg_policy *p, const double *x, double *q, double *v, double *out,
                     lg_error *error) {
    const size_t nq = p->layout.positions, nv = p->layout.velocities;
    const double *const in[] = {x};
    if (nv == 0)
        memcpy(q, x, TRIALS * nq * sizeof *q);
    else
        LG_TRY(lg_program_eval(p->context, p->program, "positions", TRIALS, in, (double *const[]){q}, error));
    if (nv > 0)
        LG_TRY(
            lg_program_eval(p->context, p->program, "velocities", TRIALS, in, (double *const[]){v}, error));
    for (size_t i = 0; i < TRIALS; i++) {
        memcpy(out + i * (nq + nv), q + i * nq, nq * sizeof *q);
        memcpy(out + i * (nq + nv) + nq, v + i * nv, nv * sizeof *v);
    }
    return LG_OK;
}

/* The motion over a period from the positions and velocities `seen`, whose position `at` is larger by
 * `shift`. */
static lg_status move(const lg_policy *p, const double *seen, const double *u, uint32_t at, double shift,
                      motion *out, lg_error *error) {
    const size_t nq = p->layout.positions, nv = p->layout.velocities;
    double *q = lg_alloc(p->context, TRIALS * (nq + nv + 2 * p->state), sizeof *q);
    if (q == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a comparison of motions");
    double *v = q + TRIALS * nq, *x = v + TRIALS * nv, *next = x + TRIALS * p->state;
    for (size_t i = 0; i < TRIALS; i++) {
        memcpy(q + i * nq, seen + i * (nq + nv), nq * sizeof *q);
        memcpy(v + i * nv, seen + i * (nq + nv) + nq, nv * sizeof *v);
        q[i * nq + at] += shift;
    }
    lg_status status = lg_policy_states_at(p, q, v, TRIALS, x, error);
    if (status == LG_OK) status = see(p, x, q, v, out->before, error);
    if (status == LG_OK)
        status = lg_program_eval(p->context, p->program, "period", TRIALS, (const double *const[]){x, u},
                                 (double *const[]){next}, error);
    if (status == LG_OK) status = see(p, next, q, v, out->after, error);
    lg_free(p->context, q);
    return status;
}

/* Whether the shift of number `at` has changed nothing else. */
static bool same(const lg_policy *p, const motion *a, const motion *b, uint32_t at, double shift) {
    const uint32_t n = numbers_of(p);
    for (uint32_t j = 0; j < n; j++) {
        double off = 0.0, change = 0.0;
        for (size_t i = j; i < (size_t)TRIALS * n; i += n) {
            const double moved = a->after[i] - a->before[i], differs = b->after[i] - b->before[i] - moved;
            off += differs * differs, change += moved * moved;
        }
        const double rounding = j == at ? 1e-9 * fabs(shift) * sqrt((double)TRIALS) : 0.0;
        if (!(sqrt(off) <= 1e-4 * sqrt(change) + rounding)) return false;
    }
    return true;
}

/* How far a coordinate is shifted: beyond its starts, or as far as it goes in a run. */
static double shift_of(const lg_policy_task *task, const lg_policy_coordinate *c) {
    const double far = fmax(fabs(c->start[0]), fabs(c->start[1])),
                 fast = fmax(fabs(c->start_velocity[0]), fabs(c->start_velocity[1]));
    if (c->motion == LG_POLICY_ANGLE) return 1.0;
    if (far > 0.0) return 4.0 * far;
    if (isfinite(c->success)) return 10.0 * c->success;
    if (fast > 0.0) return fast * task->horizon;
    return isfinite(c->success_velocity) ? c->success_velocity * task->horizon : 1.0;
}

static lg_status compare(const lg_policy *p, uint32_t k, const double *seen, const double *u, motion *a,
                         motion *b, lg_error *error) {
    const lg_policy_coordinate *c = &p->task.coordinate[k];
    const uint32_t at = p->layout.at[k].position;
    const double shift = shift_of(&p->task, c);
    LG_TRY(move(p, seen, u, at, 0.0, a, error));
    LG_TRY(move(p, seen, u, at, shift, b, error));
    if (same(p, a, b, at, shift)) return LG_OK;
    if (c->free)
        return lg_fail(error, LG_CHECK_FAILED,
                       "free: the machine moves otherwise where %s is %.3g larger, so the position of %s "
                       "matters and cannot be left out",
                       c->name, shift, c->name);
    return lg_fail(error, LG_CHECK_FAILED,
                   "track: the machine moves otherwise where %s is %.3g larger, so no set point of %s can be "
                   "followed by a shift",
                   c->name, shift, c->name);
}

/* Random states: starts, with free positions from their range. */
static lg_status draw(const lg_policy *p, uint64_t seed, double *seen, double *u, lg_error *error) {
    const uint32_t nq = p->layout.positions, nv = p->layout.velocities;
    double *x = lg_alloc(p->context, TRIALS * (p->state + nq + nv), sizeof *x);
    if (x == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a comparison of motions");
    double *q = x + TRIALS * p->state, *v = q + TRIALS * nq;
    lg_rng rng;
    lg_rng_seed(&rng, seed, 9);
    lg_status status = lg_policy_starts(p, &rng, TRIALS, x, u, error);
    if (status == LG_OK) status = see(p, x, q, v, seen, error);
    for (uint32_t k = 0; k < p->task.coordinate_count && status == LG_OK; k++) {
        const lg_policy_coordinate *c = &p->task.coordinate[k];
        for (size_t i = 0; c->free && i < TRIALS; i++)
            seen[i * (nq + nv) + p->layout.at[k].position] +=
                lg_rng_uniform_in(&rng, c->start[0], c->start[1]);
    }
    lg_free(p->context, x);
    return status;
}

static bool shifted(const lg_policy_coordinate *c, bool tracked) {
    return (tracked && c->track) || c->free;
}

lg_status lg_policy_check_shifts(const lg_policy *p, bool tracked, uint64_t seed, lg_error *error) {
    const lg_policy_task *task = &p->task;
    const size_t numbers = (size_t)TRIALS * numbers_of(p);
    uint32_t first = 0;
    while (first < task->coordinate_count && !shifted(&task->coordinate[first], tracked)) first++;
    if (first == task->coordinate_count) return LG_OK;
    double *seen = lg_alloc(p->context, 5 * numbers + (size_t)TRIALS * p->inputs, sizeof *seen);
    if (seen == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a comparison of motions");
    motion a = {seen + numbers, seen + 2 * numbers}, b = {seen + 3 * numbers, seen + 4 * numbers};
    double *u = seen + 5 * numbers;
    lg_status status = draw(p, seed, seen, u, error);
    for (uint32_t k = first; k < task->coordinate_count && status == LG_OK; k++)
        if (shifted(&task->coordinate[k], tracked)) status = compare(p, k, seen, u, &a, &b, error);
    lg_free(p->context, seen);
    return status;
}

/* Policies that follow set points: the machine must move in the same way wherever the tracked coordinate is,
 * so that a set point is a shift of the coordinate. */
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

/* The motion over a period from the errors z, whose error `at` is larger by `shift`. */
static lg_status move(const lg_policy *p, const double *z, const double *u, uint32_t at, double shift,
                      motion *out, lg_error *error) {
    const size_t n = p->layout.errors, nq = p->layout.positions, nv = p->layout.velocities;
    double *from = lg_alloc(p->context, TRIALS * (n + 2 * p->state + nq + nv), sizeof *from);
    if (from == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a comparison of motions");
    double *x = from + TRIALS * n, *next = x + TRIALS * p->state, *q = next + TRIALS * p->state,
           *v = q + TRIALS * nq;
    memcpy(from, z, TRIALS * n * sizeof *z);
    for (size_t i = 0; i < TRIALS; i++) from[i * n + at] += shift;
    lg_status status = lg_policy_states(p, from, TRIALS, x, error);
    if (status == LG_OK) status = see(p, x, q, v, out->before, error);
    if (status == LG_OK)
        status = lg_program_eval(p->context, p->program, "period", TRIALS, (const double *const[]){x, u},
                                 (double *const[]){next}, error);
    if (status == LG_OK) status = see(p, next, q, v, out->after, error);
    lg_free(p->context, from);
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

static lg_status compare(const lg_policy *p, uint32_t k, const double *z, const double *u, motion *a,
                         motion *b, lg_error *error) {
    const lg_policy_coordinate *c = &p->task.coordinate[k];
    const double far = fmax(fabs(c->start[0]), fabs(c->start[1])), shift = c->motion == LG_POLICY_ANGLE ? 1.0
                                                                           : far > 0.0 ? 4.0 * far
                                                                           : isfinite(c->success)
                                                                               ? 10.0 * c->success
                                                                               : 1.0;
    LG_TRY(move(p, z, u, p->layout.at[k].error, 0.0, a, error));
    LG_TRY(move(p, z, u, p->layout.at[k].error, shift, b, error));
    if (same(p, a, b, p->layout.at[k].position, shift)) return LG_OK;
    return lg_fail(error, LG_CHECK_FAILED,
                   "track: the machine moves otherwise where %s is %.3g larger, so no set point of %s can be "
                   "followed by a shift",
                   c->name, shift, c->name);
}

lg_status lg_policy_check_track(const lg_policy *p, uint64_t seed, lg_error *error) {
    const uint32_t n = p->layout.errors, seen = numbers_of(p);
    double *z = lg_alloc(p->context, TRIALS * (n + p->inputs + 4 * seen), sizeof *z);
    if (z == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a comparison of motions");
    double *u = z + TRIALS * n, *rest = u + TRIALS * p->inputs;
    motion a = {rest, rest + TRIALS * seen}, b = {a.after + TRIALS * seen, a.after + 2 * TRIALS * seen};
    lg_rng rng;
    lg_rng_seed(&rng, seed, 9);
    for (size_t i = 0; i < TRIALS; i++) {
        lg_policy_draw(&p->task, &p->layout, &rng, z + i * n);
        for (uint32_t l = 0; l < p->inputs; l++)
            u[i * p->inputs + l] = lg_rng_uniform_in(&rng, p->task.input[l].low, p->task.input[l].high);
    }
    lg_status status = LG_OK;
    for (uint32_t k = 0; k < p->task.coordinate_count && status == LG_OK; k++)
        if (p->task.coordinate[k].track) status = compare(p, k, z, u, &a, &b, error);
    lg_free(p->context, z);
    return status;
}

/* Policies: the numbers of a machine of one coordinate, for certificates of the energy. */
#include <math.h>
#include <string.h>

#include "control/policy.h"
#include "liegrad/geometry.h"

enum { ROTATION = 9, TURN = 3, ROWS = 1 + TURN + LG_POLICY_INPUTS };

/* The machine's numbers at the position q: at rest, at `speed` along each axis, and at rest under each
 * input, `part` of its range. */
static lg_status look(const lg_policy *p, const double *q, double speed, double part, lg_policy_body *out,
                      lg_error *error) {
    const uint32_t n = p->layout.velocities, m = p->inputs, nq = p->layout.positions, rows = 1 + n + m;
    double at[ROWS * ROTATION], v[ROWS * TURN] = {0}, u[ROWS * LG_POLICY_INPUTS] = {0},
                                         x[ROWS * (ROTATION + TURN)], rate[ROWS * 2 * TURN];
    for (uint32_t r = 0; r < rows; r++) memcpy(at + r * nq, q, nq * sizeof *q);
    for (uint32_t k = 0; k < n; k++) v[(1 + k) * n + k] = speed;
    for (uint32_t l = 0; l < m; l++)
        u[(1 + n + l) * m + l] = part * (p->task.input[l].high - p->task.input[l].low);
    LG_TRY(lg_policy_states_at(p, at, v, rows, x, error));
    LG_TRY(lg_program_eval(p->context, p->program, "field", rows, (const double *const[]){x, u},
                           (double *const[]){rate}, error));
    for (uint32_t i = 0; i < n; i++) {
        out->rest[i] = rate[n + i];
        for (uint32_t k = 0; k < n; k++) {
            const double *w = v + (1 + k) * n, *own = x + (1 + k) * p->state + nq;
            const double turned =
                n < TURN ? 0 : own[(i + 1) % 3] * w[(i + 2) % 3] - own[(i + 2) % 3] * w[(i + 1) % 3];
            out->mass[i * n + k] = own[i] / speed;
            out->damping[i * n + k] = (out->rest[i] + turned - rate[(1 + k) * 2 * n + n + i]) / speed;
        }
        for (uint32_t l = 0; l < m; l++)
            out->map[i * m + l] = (rate[(1 + n + l) * 2 * n + n + i] - out->rest[i]) / u[(1 + n + l) * m + l];
    }
    return LG_OK;
}

/* Whether numbers are equal to 1e-6 of the largest one, or of `size`. */
static bool same(size_t count, const double *a, const double *b, double size) {
    for (size_t i = 0; i < count; i++) size = fmax(size, fabs(b[i]));
    for (size_t i = 0; i < count; i++)
        if (!(fabs(a[i] - b[i]) <= 1e-6 * size)) return false;
    return true;
}

/* Place k: rotations all around; angles over a turn; lines around the starts. */
static void place(const lg_policy_coordinate *c, int k, lg_rng *rng, double *q) {
    const double far = c->motion == LG_POLICY_ANGLE ? 3.0 : fmax(lg_policy_reach(c->start), 0.1);
    double turn[TURN];
    q[0] = c->goal[0] + 0.25 * (k - 4) * far;
    if (c->motion != LG_POLICY_ROTATION) return;
    for (int i = 0; i < TURN; i++) turn[i] = lg_rng_uniform_in(rng, -3, 3);
    lg_so3_exp_multiply(turn, c->goal, q);
}

lg_status lg_policy_needs_energy(const lg_policy *p, lg_error *error) {
    LG_TRY(lg_policy_check_memory(p, true, error));
    if (p->task.kind == LG_POLICY_ENERGY) return LG_OK;
    return lg_fail(error, LG_UNSUPPORTED, "the controller is of kind %s; the energy needs kind energy",
                   lg_policy_kind_name(p->task.kind));
}

lg_status lg_policy_probe(const lg_policy *p, lg_policy_body *first, lg_error *error) {
    static const double speeds[] = {1, -1, 0.1, -3, 10, -10}, inputs[] = {1, -1, 0.3, 0.1, -0.3, 0.5};
    const lg_policy_coordinate *c = &p->task.coordinate[0];
    const double fast = fmax(lg_policy_reach(c->start_velocity), 0.1),
                 range = p->task.input[0].high - p->task.input[0].low;
    const size_t n = p->layout.velocities, m = p->inputs;
    double q[ROTATION];
    lg_policy_body other;
    lg_rng rng;
    if (!lg_policy_has(p, "field"))
        return lg_fail(error, LG_NOT_FOUND, "the plant has no function field (x, u)");
    LG_TRY(look(p, c->goal, fast, 1, first, error));
    lg_rng_seed(&rng, 1, 14);
    for (int k = 0; k < 54; k++) {
        place(c, k / 6, &rng, q);
        LG_TRY(look(p, q, speeds[k % 6] * fast, inputs[k % 6], &other, error));
        for (size_t i = 0; n == TURN && i < TURN; i++)
            if (fabs(other.rest[i]) > 1e-9 * range)
                return lg_fail(
                    error, LG_UNSUPPORTED,
                    "at rest and without inputs a torque acts on %s: the energy is certified for a body "
                    "that nothing but inputs and damping turns",
                    c->name);
        if (!same(n * n, other.mass, first->mass, 0))
            return lg_fail(error, LG_UNSUPPORTED, "the %s of %s is not constant", n == 1 ? "mass" : "inertia",
                           c->name);
        if (!same(n * m, other.map, first->map, 0))
            return lg_fail(error, LG_UNSUPPORTED,
                           n == 1 ? "the force of %s is not a constant times the input"
                                  : "the torque of %s and the other inputs is not a constant map of them",
                           p->task.input[0].name);
        if (!same(n * n, other.damping, first->damping, 1e-3 * fabs(first->mass[0]) / p->task.horizon))
            return lg_fail(error, LG_CHECK_FAILED,
                           "the damping of %s is not linear: %.6g at the speed %.4g, %.6g at %.4g", c->name,
                           first->damping[0], fast, other.damping[0], speeds[k % 6] * fast);
    }
    return LG_OK;
}

static lg_status check(const lg_policy *p, lg_error *error) {
    LG_TRY(lg_policy_needs_energy(p, error));
    if (p->task.coordinate_count != 1 || p->task.coordinate[0].motion != LG_POLICY_ROTATION ||
        p->state != ROTATION + TURN)
        return lg_fail(error, LG_UNSUPPORTED,
                       "the energy of rotations is certified for one rotation and no other state");
    for (uint32_t l = 0; l < p->inputs; l++) {
        const double half = lg_policy_half_range(p, l);
        if (fabs(p->regulator.u0[l]) > 1e-9 * half)
            return lg_fail(error, LG_UNSUPPORTED,
                           "the goal needs the input %s to be %.4g; the energy needs 0",
                           p->task.input[l].name, p->regulator.u0[l]);
    }
    return LG_OK;
}

/* A lower bound of the least eigenvalue of the symmetric part of D (3, 3): the diagonal less the row sums. */
static double least_damping(const double *D) {
    double least = INFINITY;
    for (int i = 0; i < TURN; i++) {
        double row = D[i * (TURN + 1)];
        for (int j = 0; j < TURN; j++)
            if (j != i) row -= 0.5 * fabs(D[i * TURN + j] + D[j * TURN + i]);
        least = fmin(least, row);
    }
    return least;
}

lg_status lg_policy_find_turn(const lg_policy *p, lg_policy_turn *out, lg_error *error) {
    lg_policy_body b;
    double gains[2][LG_POLICY_INPUTS], stiff[TURN * TURN] = {0}, even[TURN * TURN] = {0};
    LG_NEEDS(error, p, out);
    LG_TRY(check(p, error));
    LG_TRY(lg_policy_probe(p, &b, error));
    const uint32_t m = p->inputs, n = p->layout.errors;
    *out = (lg_policy_turn){.inputs = m};
    memcpy(out->J, b.mass, sizeof b.mass);
    for (uint32_t l = 0; l < m; l++) {
        for (int i = 0; i < 2; i++)
            gains[i][l] = p->parameters > 0 ? exp(p->theta[i * (int)m + (int)l]) : p->task.gains[i];
        out->limit[l] = fmin(p->task.input[l].high, -p->task.input[l].low);
        if (!(out->limit[l] > 0))
            return lg_fail(error, LG_UNSUPPORTED, "the limits of input %s do not hold 0",
                           p->task.input[l].name);
        /* Gains of this input are part of its row of the map. */
        for (int i = 0; i < TURN; i++) out->map[l * TURN + (uint32_t)i] = p->G[l * n + (uint32_t)i];
        out->gains[0] = fmax(out->gains[0], gains[0][l]);
        out->gains[1] = fmax(out->gains[1], gains[1][l]);
        for (uint32_t i = 0; i < TURN * TURN; i++) {
            stiff[i] += gains[0][l] * b.map[i / TURN * m + l] * p->G[l * n + i % TURN];
            b.damping[i] += gains[1][l] * b.map[i / TURN * m + l] * p->G[l * n + TURN + i % TURN];
        }
    }
    out->stiffness = (stiff[0] + stiff[4] + stiff[8]) / TURN;
    for (int i = 0; i < TURN; i++) even[i * (TURN + 1)] = out->stiffness;
    if (!same(9, stiff, even, 0))
        return lg_fail(
            error, LG_UNSUPPORTED,
            "the stiffness depends on the axis of the rotation (%.6g, %.6g, %.6g along the axes), so it is "
            "no slope of a potential: give the same gain to all inputs",
            stiff[0], stiff[4], stiff[8]);
    out->damping = least_damping(b.damping) * (1 - 1e-6);
    return LG_OK;
}

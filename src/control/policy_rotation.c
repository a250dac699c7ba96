/* Policies: the numbers of a body that turns, for lg_policy_find_turn. */
#include <math.h>
#include <string.h>

#include "control/policy.h"
#include "liegrad/geometry.h"

enum { ROTATION = 9, TURN = 3, STATE = ROTATION + TURN };

/* The momentum p at the angular velocity w, and the torque at (R, w, u), which is p' - p x w in the body's
 * axes. */
static lg_status torque_at(const lg_policy *p, const double *R, const double *w, const double *u,
                           double *momentum, double *torque, lg_error *error) {
    double x[STATE], rate[STATE], turned[TURN];
    LG_TRY(lg_program_eval(p->context, p->program, "momenta", 1, (const double *const[]){R, w},
                           (double *const[]){x}, error));
    LG_TRY(lg_program_eval(p->context, p->program, "velocity", 1, (const double *const[]){x, u},
                           (double *const[]){rate}, error));
    const double *m = x + ROTATION;
    turned[0] = m[1] * w[2] - m[2] * w[1];
    turned[1] = m[2] * w[0] - m[0] * w[2];
    turned[2] = m[0] * w[1] - m[1] * w[0];
    for (int i = 0; i < TURN; i++) {
        momentum[i] = m[i];
        torque[i] = rate[ROTATION + i] - turned[i];
    }
    return LG_OK;
}

typedef struct body {
    double J[TURN * TURN], D[TURN * TURN], B[TURN * LG_POLICY_INPUTS]; /* torque = -D w + B u */
} body;

/* The columns of J, D and B at the rotation R. */
static lg_status look(const lg_policy *p, const double *R, double speed, body *out, lg_error *error) {
    const double zero[LG_POLICY_INPUTS] = {0};
    double momentum[TURN], torque[TURN], still[TURN];
    LG_TRY(torque_at(p, R, zero, zero, momentum, still, error));
    for (int i = 0; i < TURN; i++)
        if (fabs(still[i]) > 1e-9 * fabs(p->task.input[0].high - p->task.input[0].low))
            return lg_fail(
                error, LG_UNSUPPORTED,
                "at rest and without inputs a torque acts on %s: the energy is certified for a body that "
                "nothing but inputs and damping turns",
                p->task.coordinate[0].name);
    for (int k = 0; k < TURN; k++) {
        double w[TURN] = {0};
        w[k] = speed;
        LG_TRY(torque_at(p, R, w, zero, momentum, torque, error));
        for (int i = 0; i < TURN; i++) {
            out->J[i * TURN + k] = momentum[i] / speed;
            out->D[i * TURN + k] = -torque[i] / speed;
        }
    }
    for (uint32_t l = 0; l < p->inputs; l++) {
        double u[LG_POLICY_INPUTS] = {0};
        u[l] = 0.5 * (p->task.input[l].high - p->task.input[l].low);
        LG_TRY(torque_at(p, R, zero, u, momentum, torque, error));
        for (int i = 0; i < TURN; i++) out->B[i * p->inputs + l] = torque[i] / u[l];
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

static double largest_speed(const lg_policy *p) {
    const lg_policy_coordinate *c = &p->task.coordinate[0];
    return fmax(fmax(fabs(c->start_velocity[0]), fabs(c->start_velocity[1])), 0.1);
}

/* J, D and B are compared at rotations all around and at rates up to ten times the largest of the starts. */
static lg_status probe_body(const lg_policy *p, body *first, lg_error *error) {
    static const double speeds[] = {1, -0.1, 3, -10};
    const lg_policy_coordinate *c = &p->task.coordinate[0];
    const double fast = largest_speed(p);
    lg_rng rng;
    LG_TRY(look(p, c->goal, fast, first, error));
    lg_rng_seed(&rng, 1, 14);
    for (size_t k = 0; k < 24; k++) {
        double turn[TURN], by[ROTATION], R[ROTATION] = {0};
        body other;
        for (int i = 0; i < TURN; i++) turn[i] = lg_rng_uniform_in(&rng, -3, 3);
        lg_so3_exp(turn, by);
        for (int i = 0; i < ROTATION; i++)
            for (int j = 0; j < TURN; j++) R[i] += c->goal[i / 3 * 3 + j] * by[3 * j + i % 3];
        LG_TRY(look(p, R, speeds[k % LG_COUNT(speeds)] * fast, &other, error));
        if (!same(9, other.J, first->J, 0))
            return lg_fail(error, LG_UNSUPPORTED, "the inertia of %s is not constant", c->name);
        if (!same((size_t)TURN * p->inputs, other.B, first->B, 0))
            return lg_fail(error, LG_UNSUPPORTED, "the torque of the inputs is not a constant map of them");
        if (!same(9, other.D, first->D, first->J[0] / p->task.horizon))
            return lg_fail(error, LG_CHECK_FAILED, "the damping of %s is not linear", c->name);
    }
    return LG_OK;
}

static lg_status check(const lg_policy *p, lg_error *error) {
    size_t velocity;
    if (p->task.kind != LG_POLICY_ENERGY)
        return lg_fail(error, LG_UNSUPPORTED, "the controller is of kind %s; the energy needs kind energy",
                       lg_policy_kind_name(p->task.kind));
    LG_TRY(lg_policy_check_memory(p, true, error));
    if (p->task.coordinate_count != 1 || p->task.coordinate[0].motion != LG_POLICY_ROTATION ||
        p->state != STATE)
        return lg_fail(error, LG_UNSUPPORTED,
                       "the energy of rotations is certified for one rotation and no other state");
    if (lg_program_find(p->program, "velocity", &velocity, NULL) != LG_OK)
        return lg_fail(error, LG_NOT_FOUND, "the plant has no function velocity (x, u)");
    for (uint32_t l = 0; l < p->inputs; l++) {
        const double half = 0.5 * (p->task.input[l].high - p->task.input[l].low);
        if (fabs(p->regulator.u0[l]) > 1e-9 * half)
            return lg_fail(error, LG_UNSUPPORTED,
                           "the goal needs the input %s to be %.4g; the energy needs 0",
                           p->task.input[l].name, p->regulator.u0[l]);
    }
    return LG_OK;
}

/* A lower bound of the least eigenvalue of the symmetric part of D (3, 3): the diagonal less the row sums. */
static double least_damping(const double *D) {
    double least = (double)INFINITY;
    for (int i = 0; i < TURN; i++) {
        double row = D[i * (TURN + 1)];
        for (int j = 0; j < TURN; j++)
            if (j != i) row -= 0.5 * fabs(D[i * TURN + j] + D[j * TURN + i]);
        least = fmin(least, row);
    }
    return least;
}

lg_status lg_policy_find_turn(const lg_policy *p, lg_policy_turn *out, lg_error *error) {
    body b;
    double gains[2][LG_POLICY_INPUTS], stiff[TURN * TURN] = {0}, even[TURN * TURN] = {0};
    LG_NEEDS(error, p, out);
    LG_TRY(check(p, error));
    LG_TRY(probe_body(p, &b, error));
    const uint32_t m = p->inputs, n = p->layout.errors;
    *out = (lg_policy_turn){.inputs = m};
    memcpy(out->J, b.J, sizeof b.J);
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
            stiff[i] += gains[0][l] * b.B[i / TURN * m + l] * p->G[l * n + i % TURN];
            b.D[i] += gains[1][l] * b.B[i / TURN * m + l] * p->G[l * n + TURN + i % TURN];
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
    out->damping = least_damping(b.D) * (1 - 1e-6);
    return LG_OK;
}

/* Attitude with feedback of the half angle: the level at which inputs stay in their limits. */
#include <math.h>
#include <stdio.h>

#include "certify/certify.h"
#include "kernels/matrix.h"

enum { INPUTS = 16 };

/* r(x) = sqrt(x^2 + 1e-6) keeps the feedback smooth at the angle pi: r(0) and r(1). */
static const double bottom = 1e-3, top = 1.000000499999875;

void lg_certify_rotation_spec_init(lg_certify_rotation_spec *spec) {
    if (spec != NULL) *spec = (lg_certify_rotation_spec){.size = sizeof *spec};
}

/* What an input can be at most, over the square roots of V's parts: |u_l| <= stiff |z| + fast sqrt(2 (c -
 * Phi)) */
typedef struct bound {
    double stiff, fast, limit;
} bound;

static lg_status take(const lg_certify_rotation_spec *spec, bound *bounds, lg_error *error) {
    double L[9], size = 0;
    if (spec->size != sizeof *spec || spec->inputs < 1 || spec->inputs > INPUTS)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "size is not the size of the struct, or inputs are not 1 to %d", INPUTS);
    for (int i = 0; i < 9; i++) {
        if (!isfinite(spec->J[i])) return lg_fail(error, LG_NOT_FINITE, "J is not finite");
        size = fmax(size, fabs(spec->J[i]));
    }
    for (int i = 0; i < 9; i++)
        if (fabs(spec->J[i] - spec->J[i % 3 * 3 + i / 3]) > 1e-9 * size)
            return lg_fail(error, LG_INVALID_ARGUMENT, "J is not symmetric");
    if (!lg_matrix_cholesky(3, spec->J, L))
        return lg_fail(error, LG_INVALID_ARGUMENT, "J is not positive definite");
    if (!(spec->gains[0] >= 0 && spec->gains[1] >= 0 && isfinite(spec->stiffness)))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "gains must not be negative, and the stiffness must be finite");
    for (size_t l = 0; l < spec->inputs; l++) {
        const double *g = spec->map + 3 * l, a = g[0] / L[0], b = (g[1] - L[3] * a) / L[4],
                     c = (g[2] - L[6] * a - L[7] * b) / L[8];
        bounds[l] = (bound){spec->gains[0] * sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]),
                            spec->gains[1] * sqrt(a * a + b * b + c * c), spec->limit[l]};
        if (!(spec->limit[l] > 0) || !isfinite(bounds[l].stiff + bounds[l].fast))
            return lg_fail(error, LG_INVALID_ARGUMENT, "input %zu: the limit must be above 0, the map finite",
                           l);
    }
    return LG_OK;
}

/* sin(a/2) where Phi = 4 k p: r(cos(a/2)) = top - p */
static double half_sine(double p) {
    return sqrt(p * (2 * top - p));
}

/* An upper bound of the input in {V <= c}: of 2 stiff sin(a/2) + fast sqrt(2 (c - 4 k p)) over 0 <= p <=
 * c/(4 k), as |z| <= 2 sin(a/2). The function is concave, so the tangent at a point near its maximum bounds
 * it; a part in 1e6 is more than that and rounding need. */
static double largest(const bound *b, double k, double c) {
    double low = 0, high = c / (4 * k), most = 0;
    for (int i = 0; i < 200; i++) {
        double value[2];
        for (int side = 0; side < 2; side++) {
            const double p = low + (high - low) * (side == 0 ? 0.382 : 0.618);
            value[side] = 2 * b->stiff * half_sine(p) + b->fast * sqrt(2 * fmax(c - 4 * k * p, 0));
            most = fmax(most, value[side]);
        }
        if (value[0] < value[1])
            low += 0.382 * (high - low);
        else
            high -= 0.382 * (high - low);
    }
    return most * (1 + 1e-6);
}

static double find_level(const bound *bounds, size_t inputs, double k, double critical) {
    double level = critical * (1 - 1e-9);
    for (size_t l = 0; l < inputs; l++) {
        if (largest(&bounds[l], k, level) <= bounds[l].limit) continue;
        double good = 0, bad = level;
        for (int i = 0; i < 60; i++) {
            const double c = 0.5 * (good + bad);
            *(largest(&bounds[l], k, c) <= bounds[l].limit ? &good : &bad) = c;
        }
        level = good;
    }
    return level;
}

lg_status lg_certify_rotation(const lg_certify_rotation_spec *spec, lg_certify_rotation_result *result,
                              lg_error *error) {
    bound bounds[INPUTS];
    LG_NEEDS(error, spec, result);
    LG_TRY(take(spec, bounds, error));
    const double k = spec->stiffness;
    lg_certify_rotation_result r = {.verified = k > 0 && spec->damping > 0,
                                    .critical = 4 * fmax(k, 0) * (top - bottom)};
    if (r.verified) {
        r.level = find_level(bounds, spec->inputs, k, r.critical);
        r.angle = 2 * asin(half_sine(r.level / (4 * k))) * (1 - 1e-9);
    } else
        (void)snprintf(r.reason, sizeof r.reason, "the %s is not positive", k > 0 ? "damping" : "stiffness");
    (void)lg_format(
        r.claim, sizeof r.claim,
        "%s: motions from {w.J w/2 + 4 k (r(1) - r(cos(a/2))) < c = %s} converge to the goal, with k = %.6g, "
        "r(x) = sqrt(x^2 + 1e-6) and the angle a of the rotation from the goal; these are all rotations at "
        "rest up to %s radians; inputs stay inside of their limits, so the torque is -k z - D w there, with "
        "z = 2 sin(a/2) cos(a/2)/r(cos(a/2)) along the axis (continuous inputs, no model error).",
        r.verified ? "Proved" : "Not proved", LG_DIGITS(r.level, -1), k, LG_DIGITS(r.angle, -1));
    *result = r;
    return LG_OK;
}

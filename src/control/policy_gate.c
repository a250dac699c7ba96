/* Policies: how far a quadratic set reaches into the gate of a network. */
#include <math.h>

#include "control/policy.h"
#include "kernels/matrix.h"

enum { MOST = LG_POLICY_ERRORS, ANGLES = 8 };

/* Whether the error of the position is that of an angle. */
static bool turns(const lg_policy_coordinate *c) {
    return c->motion == LG_POLICY_ANGLE && !c->free;
}

static lg_status check(const lg_policy *p, uint32_t *angles, lg_error *error) {
    *angles = 0;
    if (p->task.kind != LG_POLICY_NETWORK || !p->task.gate)
        return lg_fail(error, LG_UNSUPPORTED, "the controller has no gate");
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        const lg_policy_motion motion = p->task.coordinate[i].motion;
        if (turns(&p->task.coordinate[i])) angles[0]++;
        if ((motion != LG_POLICY_LINE && motion != LG_POLICY_ANGLE) || *angles > ANGLES)
            return lg_fail(error, LG_UNSUPPORTED, "the gate is bounded for lines and up to %d angles",
                           ANGLES);
    }
    return LG_OK;
}

/* The largest eigenvalue of T^T D G D T with the diagonal D, rounded up; T = L^-T with P = L L^T. */
static bool largest(size_t n, const double *G, const double *D, const double *T, double *out) {
    double GT[MOST * MOST], M[MOST * MOST], DT[MOST * MOST], w[MOST];
    for (size_t i = 0; i < n * n; i++) DT[i] = D[i / n] * T[i];
    lg_matrix_multiply(n, n, n, G, DT, GT);
    lg_matrix_multiply_tn(n, n, n, DT, GT, M);
    const bool found = lg_matrix_eigen(n, false, M, w);
    *out = w[n - 1] * (1 + 1e-9);
    return found && isfinite(*out);
}

/* The error of an angle a is d a with d between 2 sin(a/2)/a at the largest |a| of the set and 1. (D z)^T G
 * (D z) is convex in D, so the largest value is at one of the corners of D. The lost part of the error is 0
 * up to pi. */
lg_status lg_policy_bound_gate(const lg_policy *p, const double *P, double level, double *ratio,
                               lg_error *error) {
    uint32_t angles, at[ANGLES];
    LG_NEEDS(error, p, P, ratio);
    LG_TRY(check(p, &angles, error));
    const size_t n = p->layout.errors;
    double L[MOST * MOST], T[MOST * MOST], D[MOST], least[ANGLES], most = 0;
    if (!lg_matrix_cholesky(n, P, L) || !(level > 0))
        return lg_fail(error, LG_INVALID_ARGUMENT, "P is not positive definite, or the level is not above 0");
    lg_matrix_invert_transposed(n, L, T);
    angles = 0;
    for (uint32_t i = 0; i < p->task.coordinate_count; i++) {
        if (!turns(&p->task.coordinate[i])) continue;
        double row = 0;
        const size_t error_at = p->layout.at[i].error;
        for (size_t k = 0; k < n; k++) row += T[error_at * n + k] * T[error_at * n + k];
        const double far = fmin(sqrt(level * row), 3.141592653589793);
        least[angles] = 2 * sin(far / 2) / far;
        at[angles++] = (uint32_t)error_at;
    }
    for (uint32_t corner = 0; corner < 1u << angles; corner++) {
        double value;
        for (size_t i = 0; i < n; i++) D[i] = 1;
        for (uint32_t k = 0; k < angles; k++)
            if (corner >> k & 1) D[at[k]] = least[k];
        if (!largest(n, p->regulator.P, D, T, &value))
            return lg_fail(error, LG_INVALID_ARGUMENT, "P is too ill-conditioned");
        most = fmax(most, value);
    }
    *ratio = most * level / p->regulator.c;
    return LG_OK;
}

/* Attitude: the critical values of an energy on SO(3) (Koditschek 1989; Bullo & Murray 1999). */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "certify/certify.h"
#include "kernels/matrix.h"

lg_status lg_certify_attitude(const double *A, double damping, lg_certify_attitude_result *result,
                              lg_error *error) {
    lg_certify_attitude_result r = {.verified = false};
    double a[3], copy[9], size = 0;
    LG_NEEDS(error, A, result);
    for (int i = 0; i < 9; i++) {
        if (!isfinite(A[i])) return lg_fail(error, LG_NOT_FINITE, "A is not finite");
        size = fmax(size, fabs(A[i]));
    }
    for (int i = 0; i < 9; i++)
        if (fabs(A[i] - A[i % 3 * 3 + i / 3]) > 1e-12 * size)
            return lg_fail(error, LG_INVALID_ARGUMENT, "A is not symmetric");
    memcpy(copy, A, sizeof copy); /* errors of eigenvalues are below 1e-13 of the largest number (Weyl) */
    if (!lg_matrix_eigen(3, false, copy, a))
        return lg_fail(error, LG_NO_CONVERGENCE, "the eigenvalues of A were not found");
    const double pairs[3] = {a[0] + a[1], a[0] + a[2], a[1] + a[2]};
    for (int i = 0; i < 3; i++) r.critical[i] = 2 * pairs[i] - 1e-11 * size;
    r.verified = r.critical[0] > 0 && damping > 0;
    r.level = r.verified ? r.critical[0] : 0;
    if (!r.verified)
        (void)snprintf(
            r.reason, sizeof r.reason, "%s",
            damping > 0 ? "a rotation by pi is no higher than the goal: two eigenvalues of A have a sum of "
                          "at most 0"
                        : "the damping is not positive");
    (void)lg_format(
        r.claim, sizeof r.claim,
        "%s: motions from {w.J w/2 + tr(A (1 - Q)) < c = %s} converge to the goal (continuous inputs, no "
        "limit of torque, no model error); further critical rotations, by pi, have values of at least %s, "
        "%s, %s, so this is almost global, not global.",
        r.verified ? "Proved" : "Not proved", LG_DIGITS(r.level, -1), LG_DIGITS(r.critical[0], -1),
        LG_DIGITS(r.critical[1], -1), LG_DIGITS(r.critical[2], -1));
    *result = r;
    return LG_OK;
}

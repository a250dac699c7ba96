/* The argument near the goal, with interval matrices in the form middle +- radius. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "certify/certify.h"
#include "kernels/matrix.h"

enum { MOST = LG_CERTIFY_STATES };

/* An interval matrix (n, n). Radii are rounded generously: every sum of this file has at most 64 terms, so
 * its relative error is below SLACK. */
#define SLACK 1e-13
typedef struct banded {
    double middle[MOST * MOST], radius[MOST * MOST];
} banded;

/* out = A^T B */
static void product(size_t n, const banded *a, const banded *b, banded *out) {
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) {
            double sum = 0, size = 0, radius = 0;
            for (size_t k = 0; k < n; k++) {
                const double p = a->middle[k * n + i], q = b->middle[k * n + j];
                const double rp = a->radius[k * n + i], rq = b->radius[k * n + j];
                sum += p * q;
                size += fabs(p * q);
                radius += fabs(p) * rq + rp * (fabs(q) + rq);
            }
            out->middle[i * n + j] = sum;
            out->radius[i * n + j] = radius * (1 + SLACK) + size * SLACK + DBL_MIN;
        }
}

static void from_bounds(size_t n, const double *low, const double *high, banded *out) {
    for (size_t i = 0; i < n * n; i++) {
        const double middle = 0.5 * low[i] + 0.5 * high[i];
        out->middle[i] = middle;
        out->radius[i] = fmax(high[i] - middle, middle - low[i]) * (1 + SLACK) + fabs(middle) * SLACK;
    }
}

static void exactly(size_t n, const double *values, banded *out) {
    memset(out, 0, sizeof *out);
    memcpy(out->middle, values, n * n * sizeof *values);
}

/* Whether S = sign (A + A^T)/2 is positive definite for every A. S is scaled to a diagonal of 1. Its middle,
 * less the largest sum of radii, must have a Cholesky factor in rounded arithmetic, with room for the
 * rounding (Rump 2006). NaN and inf fail. */
static bool is_definite(size_t n, const banded *a, double sign) {
    double m[MOST * MOST], L[MOST * MOST], scale[MOST], most = 0;
    for (size_t i = 0; i < n; i++) {
        scale[i] = 1 / sqrt(sign * a->middle[i * n + i]);
        if (!isfinite(scale[i])) return false;
    }
    for (size_t i = 0; i < n; i++) {
        double radius = 0;
        for (size_t j = 0; j < n; j++) {
            const double by = 0.5 * scale[i] * scale[j], p = a->middle[i * n + j], q = a->middle[j * n + i];
            m[i * n + j] = by * sign * (p + q);
            radius += by * (a->radius[i * n + j] + a->radius[j * n + i] + SLACK * (fabs(p) + fabs(q)));
        }
        if (!isfinite(radius)) return false;
        most = fmax(most, radius);
    }
    for (size_t i = 0; i < n; i++) m[i * n + i] -= most * (1 + SLACK) + 1e3 * SLACK;
    return lg_matrix_cholesky(n, m, L);
}

/* ---- coordinates of a quadratic V: T = L^-T with P = L L^T ---- */

/* The sums of |T^T P T - 1| along rows must be below 1e-7. */
lg_status lg_certify_check_coordinates(const lg_certify *c, lg_error *error) {
    const size_t n = c->n;
    banded P, T, PT, M;
    exactly(n, c->P, &P);
    exactly(n, c->T, &T);
    product(n, &P, &T, &PT);
    product(n, &T, &PT, &M);
    for (size_t i = 0; i < n; i++) {
        double off = 0;
        for (size_t j = 0; j < n; j++) off += fabs(M.middle[i * n + j] - (i == j)) + M.radius[i * n + j];
        if (!(off <= 1e-7))
            return lg_fail(error, LG_INVALID_ARGUMENT,
                           "P is so ill-conditioned that its coordinates have an error of %.2g", off);
    }
    return LG_OK;
}

lg_status lg_certify_whiten(lg_certify *c, lg_error *error) {
    const size_t n = c->n;
    double L[MOST * MOST];
    banded P;
    exactly(n, c->P, &P);
    if (!is_definite(n, &P, 1) || !lg_matrix_cholesky(n, c->P, L))
        return lg_fail(error, LG_INVALID_ARGUMENT, "P is not positive definite");
    lg_matrix_invert_transposed(n, L, c->T);
    c->determinant = 1;
    for (size_t i = 0; i < n; i++) c->determinant /= L[i * n + i];
    return lg_certify_check_coordinates(c, error);
}

/* |x_i - goal_i| <= |row i of T| |y|, and |y|^2 <= V/(1 - 1e-7). */
double lg_certify_width(const lg_certify *c, size_t i) {
    double row = 0;
    for (size_t j = 0; j < c->n; j++) row += c->T[i * c->n + j] * c->T[i * c->n + j];
    return sqrt(row);
}

double lg_certify_reach(const lg_certify *c) {
    double level = (double)INFINITY;
    for (size_t i = 0; i < c->n; i++) {
        const double room = fmin(c->high[i] - c->goal[i], c->goal[i] - c->low[i]) / lg_certify_width(c, i);
        level = fmin(level, room * room * (1 - 1e-6));
    }
    return level;
}

/* ---- the neighbourhood N ---- */

/* Bounds of `local` over |y_i| <= size_i: the gradient, the rate and their Jacobians by y. slopes: whether
 * the Jacobians contain all slopes there */
static lg_status bound(lg_certify *c, const double *size, double *low, double *high, bool *slopes) {
    double from[MOST], to[MOST];
    uint8_t flags[2 * MOST + 2 * MOST * MOST];
    for (size_t i = 0; i < c->n; i++) {
        to[i] = size == NULL ? 0 : size[i];
        from[i] = -to[i];
    }
    if (c->flow != NULL) return lg_certify_held_local(c, from, to, low, high, slopes);
    LG_TRY_SCRATCH(char, work, c->context, lg_interval_work_size(c->local), LG_OUT_OF_MEMORY);
    LG_TRY(lg_interval_eval(c->local, 1, from, to, low, high, flags, work, NULL));
    *slopes = true;
    for (size_t j = 0; j < lg_interval_outputs(c->local); j++)
        *slopes = *slopes && flags[j] >= (j < 2 * c->n ? LG_INTERVAL_LIPSCHITZ : LG_INTERVAL_DEFINED);
    return LG_OK;
}

/* M with V' = y^T M y (steps, with a quadratic V: V(F(x)) - V(x) = y^T M y), from the bounds of `local`
 * about the goal. */
static void rate_matrix(const lg_certify *c, const double *low, const double *high, banded *M) {
    const size_t n = c->n;
    banded G, F = {{0}, {0}}, P, T, W;
    from_bounds(n, low + 2 * n, high + 2 * n, &G);
    from_bounds(n, low + 2 * n + n * n, high + 2 * n + n * n, &F);
    if (!c->step) {
        product(n, &G, &F, M);
        return;
    }
    exactly(n, c->P, &P);
    exactly(n, c->T, &T);
    product(n, &P, &F, &W);
    product(n, &F, &W, M);
    product(n, &P, &T, &W);
    product(n, &T, &W, &F);
    for (size_t i = 0; i < n * n; i++) {
        M->radius[i] += F.radius[i] + (fabs(F.middle[i]) + fabs(M->middle[i])) * SLACK;
        M->middle[i] -= F.middle[i];
    }
}

/* Whether V > 0 and V' < 0 on N except at the goal. */
static bool argument_holds(const lg_certify *c, const double *low, const double *high) {
    banded G, M;
    from_bounds(c->n, low + 2 * c->n, high + 2 * c->n, &G);
    rate_matrix(c, low, high, &M);
    return (c->quadratic || is_definite(c->n, &G, 1)) && is_definite(c->n, &M, -1);
}

/* Held loops on N with an error d of the input: a period takes the length |y| to |y| sqrt(1 - mu) + r at
 * most, where M + mu is negative definite and r bounds the state after a period from the goal. So |y| falls
 * to 2 r/mu, and stays below it. Sets eps_rounded to a bound of V there. Whether it is far below eps. */
static bool rounding_is_small(lg_certify *c, const double *low, const double *high) {
    static const double part = 1e-4; /* a level is at least 1e-3 eps */
    const size_t n = c->n;
    banded M, P, r = {{0}, {0}}, W;
    double mu = 1;
    bool definite = false;
    rate_matrix(c, low, high, &M);
    for (; mu > 1e-12 && !definite; mu *= 0.7) {
        banded shifted = M;
        for (size_t i = 0; i < n; i++) {
            shifted.middle[i * (n + 1)] += mu;
            shifted.radius[i * (n + 1)] += (fabs(M.middle[i * (n + 1)]) + mu) * SLACK;
        }
        definite = is_definite(n, &shifted, -1);
    }
    for (size_t i = 0; i < n; i++) r.radius[i * n] = fmax(-low[n + i], high[n + i]);
    exactly(n, c->P, &P);
    product(n, &P, &r, &W);
    product(n, &r, &W, &M); /* r^T P r */
    const double size = fabs(M.middle[0]) + M.radius[0];
    c->eps_rounded = 4 * size / (mu * mu) * (1 + 1e-5);
    return definite && c->eps_rounded <= part * c->eps;
}

/* U -= D/tr D for the sum D of E^T E over points of the set. E is the change of the Jacobian of a
 * period from the goal, whose bounds there are low and high: if D v = 0, along v a period is linear. */
static lg_status add_changes(const lg_certify *c, const double *low, const double *high, double *U) {
    enum { POINTS = 64 };
    const size_t n = c->n, of = 2 * n + n * n;
    const double size = sqrt(fmin(c->level, lg_certify_reach(c)));
    double l[2 * MOST + 2 * MOST * MOST], h[2 * MOST + 2 * MOST * MOST], D[MOST * MOST] = {0}, E[MOST * MOST],
                                                                                  trace = 0;
    lg_rng rng;
    lg_rng_seed(&rng, 1, 1);
    for (int p = 0; p < POINTS && size < 1e150; p++) {
        double y[MOST], length = 0;
        bool slopes;
        for (size_t i = 0; i < n; i++) length = hypot(length, y[i] = lg_rng_normal(&rng));
        for (size_t i = 0; i < n; i++) y[i] *= size * sqrt((p + 0.5) / POINTS) / length;
        LG_TRY(lg_certify_held_local(c, y, y, l, h, &slopes));
        for (size_t i = 0; i < n * n && slopes; i++)
            E[i] = 0.5 * (l[of + i] + h[of + i]) - 0.5 * (low[of + i] + high[of + i]);
        for (size_t i = 0; i < n * n && slopes; i++)
            for (size_t k = 0; k < n; k++) D[i] += E[k * n + i / n] * E[k * n + i % n];
    }
    for (size_t i = 0; i < n; i++) trace += D[i * (n + 1)];
    for (size_t i = 0; i < n * n && trace > 0 && trace < DBL_MAX; i++) U[i] -= D[i] / trace;
    return LG_OK;
}

/* Turns the coordinates of a quadratic V such that sides of boxes lie along directions in which V falls
 * fast and slowly at the goal: M is diagonal there. For held loops they lie along directions in which a
 * period is linear, and far from linear: sides along the former need not be halved. */
lg_status lg_certify_turn(lg_certify *c, lg_error *error) {
    static const double share = 1e-4;
    double low[2 * MOST + 2 * MOST * MOST], high[2 * MOST + 2 * MOST * MOST], U[MOST * MOST], w[MOST],
        T[MOST * MOST], size = 0;
    bool slopes;
    banded M;
    LG_TRY(bound(c, NULL, low, high, &slopes));
    rate_matrix(c, low, high, &M);
    for (size_t i = 0; i < c->n * c->n; i++) {
        U[i] = 0.5 * M.middle[i] + 0.5 * M.middle[i % c->n * c->n + i / c->n];
        if (!isfinite(U[i])) return LG_OK;
        if (i % (c->n + 1) == 0) size += fabs(U[i]);
    }
    if (c->flow != NULL && size > 0) {
        for (size_t i = 0; i < c->n * c->n; i++) U[i] *= share / size;
        LG_TRY(add_changes(c, low, high, U));
    }
    if (!lg_matrix_eigen(c->n, true, U, w)) return LG_OK;
    memcpy(T, c->T, sizeof T);
    for (size_t i = 0; i < c->n; i++)
        for (size_t j = 0; j < c->n; j++) {
            c->T[i * c->n + j] = 0;
            for (size_t k = 0; k < c->n; k++) c->T[i * c->n + j] += T[i * c->n + k] * U[j * c->n + k];
        }
    return lg_certify_check_coordinates(c, error);
}

static bool is_equilibrium(const lg_certify *c, const double *low, const double *high) {
    for (size_t i = 0; i < 2 * c->n; i++)
        if (low[i] != 0.0 || high[i] != 0.0) return false;
    return true;
}

/* N for this eps: where V, by its second derivative `hessian` at the goal, is somewhat above eps. */
static bool size_of_near(lg_certify *c, double eps, const double *hessian) {
    const size_t n = c->n;
    double L[MOST * MOST], column[MOST];
    for (size_t i = 0; i < n && c->quadratic; i++)
        c->near[i] = c->file != NULL && c->made == NULL ? c->file->near[i] : 1.05 * sqrt(eps);
    if (c->quadratic) return true;
    if (!lg_matrix_cholesky(n, hessian, L)) return false;
    for (size_t i = 0; i < n; i++) { /* |L^-1 e_i|^2 = (H^-1)_ii */
        double sum = 0;
        for (size_t k = 0; k < n; k++) {
            column[k] = k == i;
            for (size_t j = 0; j < k; j++) column[k] -= L[k * n + j] * column[j];
            column[k] /= L[k * n + k];
            sum += column[k] * column[k];
        }
        c->near[i] = 1.2 * sqrt(2 * eps * sum);
        if (!(c->near[i] < fmin(c->to[i], -c->from[i]))) return false;
    }
    return true;
}

lg_status lg_certify_near(lg_certify *c) {
    double low[2 * MOST + 2 * MOST * MOST], high[2 * MOST + 2 * MOST * MOST], hessian[MOST * MOST];
    bool slopes;
    c->converges = false;
    if (c->flow != NULL) lg_flow_set_error(c->flow, NULL);
    LG_TRY(bound(c, NULL, low, high, &slopes));
    for (size_t i = 0; i < c->n * c->n; i++) hessian[i] = 0.5 * low[2 * c->n + i] + 0.5 * high[2 * c->n + i];
    const bool exact = !c->errors && is_equilibrium(c, low, high);
    double eps = c->asked_eps > 0 ? c->asked_eps : 0.5 * c->level;
    for (int k = 0; exact && k < (c->asked_eps > 0 ? 1 : 60) && !c->converges; k++, eps *= 0.7) {
        if (!size_of_near(c, eps, hessian)) continue;
        LG_TRY(bound(c, c->near, low, high, &slopes));
        c->eps = eps;
        c->converges = slopes && argument_holds(c, low, high);
        if (!c->converges || !c->rounds) continue;
        lg_flow_set_error(c->flow, c->rounding);
        LG_TRY(bound(c, c->near, low, high, &slopes));
        c->converges = slopes && rounding_is_small(c, low, high);
        lg_flow_set_error(c->flow, NULL);
    }
    if (c->rounds) lg_flow_set_error(c->flow, c->rounding);
    if (c->converges) return LG_OK;
    c->eps = c->asked_eps > 0 ? c->asked_eps : 1e-3 * c->level;
    if (!size_of_near(c, c->eps, hessian))
        for (size_t i = 0; i < c->n; i++) c->near[i] = 0;
    return LG_OK;
}

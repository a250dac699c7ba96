/* The periods of the riser, its energy, and its free motion, which only tests need. */
#ifndef TESTS_RISER_MOTION_H
#define TESTS_RISER_MOTION_H

#include <float.h>
#include <math.h>
#include <string.h>

#include "anomaly/riser.h"

/* ---- periods ---- */

/* Cholesky factor, in place in the lower triangle. Returns false if the matrix is not positive definite. */
static bool factor(double *a) {
    enum { N = LG_RISER_DOF };
    for (size_t j = 0; j < N; j++) {
        for (size_t i = j; i < N; i++) {
            double sum = a[i * N + j];
            for (size_t k = 0; k < j; k++) sum -= a[i * N + k] * a[j * N + k];
            if (i == j && !(sum > 0.0 && isfinite(sum))) return false;
            a[i * N + j] = i == j ? sqrt(sum) : sum / a[j * N + j];
        }
    }
    return true;
}

/* a := L^-1 a L^-T. a is symmetric before and after. */
static void reduce(const double *l, double *a) {
    enum { N = LG_RISER_DOF };
    for (int pass = 0; pass < 2; pass++) {
        for (size_t c = 0; c < N; c++)
            for (size_t i = 0; i < N; i++) {
                for (size_t k = 0; k < i; k++) a[i * N + c] -= l[i * N + k] * a[k * N + c];
                a[i * N + c] /= l[i * N + i];
            }
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j < i; j++) {
                const double kept = a[i * N + j];
                a[i * N + j] = a[j * N + i];
                a[j * N + i] = kept;
            }
    }
}

/* One Jacobi rotation, which makes a[p, q] zero (Golub & Van Loan, Matrix Computations, 8.5). */
static void rotate(double *a, size_t p, size_t q) {
    enum { N = LG_RISER_DOF };
    const double apq = a[p * N + q];
    if (apq == 0.0) return;
    const double tau = (a[q * N + q] - a[p * N + p]) / (2.0 * apq);
    const double t = (tau >= 0.0 ? 1.0 : -1.0) / (fabs(tau) + sqrt(1.0 + tau * tau));
    const double c = 1.0 / sqrt(1.0 + t * t), s = t * c;
    for (size_t i = 0; i < N; i++) {
        const double x = a[i * N + p], y = a[i * N + q];
        a[i * N + p] = c * x - s * y;
        a[i * N + q] = s * x + c * y;
    }
    for (size_t i = 0; i < N; i++) {
        const double x = a[p * N + i], y = a[q * N + i];
        a[p * N + i] = c * x - s * y;
        a[q * N + i] = s * x + c * y;
    }
    a[p * N + q] = a[q * N + p] = 0.0;
}

/* Jacobi's method: the diagonal of a becomes the eigenvalues. Returns false if 50 sweeps do not suffice. */
static bool diagonalise(double *a) {
    enum { N = LG_RISER_DOF, SWEEPS = 50 };
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        double off = 0.0, on = 0.0;
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j < N; j++) *(i == j ? &on : &off) += a[i * N + j] * a[i * N + j];
        if (off <= on * DBL_EPSILON * DBL_EPSILON) return true;
        for (size_t p = 0; p < N; p++)
            for (size_t q = p + 1; q < N; q++) rotate(a, p, q);
    }
    return false;
}

/* Computes the periods of the undamped linear system in seconds, longest first. If `locked`, the stiffness of
 * the housing is the one beyond its gap (or of a tight housing), otherwise the one within the gap. Errors:
 * LG_NO_CONVERGENCE; LG_INVALID_ARGUMENT (also for a structure that cannot stand with that stiffness). */
static lg_status riser_periods(const lg_riser_parameters *p, bool locked, double periods[LG_RISER_DOF]) {
    enum { N = LG_RISER_DOF };
    lg_riser_matrices m;
    lg_wellhead w;
    if (!periods) return LG_INVALID_ARGUMENT;
    LG_TRY(lg_riser_parameters_check(p, NULL));
    lg_riser_matrices_make(p, &m);
    lg_wellhead_make(p, &w);
    m.stiffness[0] += p->soil_stiffness;
    m.stiffness[N + 1] += locked ? w.outer : w.inner;
    if (!factor(m.mass)) return LG_INVALID_ARGUMENT;
    reduce(m.mass, m.stiffness);
    if (!diagonalise(m.stiffness)) return LG_NO_CONVERGENCE;
    double sorted[N];
    for (size_t i = 0; i < N; i++) {
        const double value = m.stiffness[i * N + i];
        if (!(value > 0.0)) return LG_INVALID_ARGUMENT;
        size_t at = i;
        for (; at > 0 && sorted[at - 1] > value; at--) sorted[at] = sorted[at - 1];
        sorted[at] = value;
    }
    for (size_t i = 0; i < N; i++) periods[i] = 2.0 * 3.14159265358979323846 / sqrt(sorted[i]);
    return LG_OK;
}

/* ---- energy and free motion ---- */

static double radius(const double *q, size_t dof) {
    const double x = q[dof], y = q[LG_RISER_ROW + dof];
    return sqrt(x * x + y * y);
}

/* x - log(1 + x), x >= 0 */
static double minus_log(double x) {
    if (x > 0.1) return x - log1p(x);
    double sum = 0.0, power = x;
    for (int n = 2; n <= 18; n++) {
        power *= -x;
        sum -= power / n;
    }
    return sum;
}

static double wellhead_energy(const lg_wellhead *w, double r) {
    if (w->tight) return 0.5 * w->outer * r * r;
    const double s = w->softening, knee = r < w->gap ? r : w->gap;
    const double below = w->inner * s * s * minus_log(knee / s);
    if (r <= w->gap) return below;
    const double ratio = log1p((r - w->gap) / (s + w->gap));
    return below + (w->gap_moment - w->outer * w->gap) * s * ratio +
           w->outer * s * ((r - w->gap) - s * ratio);
}

static double soil_energy(double stiffness, double strength, double r) {
    const double x = stiffness * r / strength, s = sinh(0.5 * x);
    if (x < 1e-8) return 0.5 * stiffness * r * r;
    const double log_cosh = x > 20.0 ? x - log(2.0) : log1p(2.0 * s * s);
    return strength * (strength / stiffness) * log_cosh;
}

static double riser_motion_energy(const lg_riser_motion *m) {
    enum { N = LG_RISER_DOF };
    double sum = wellhead_energy(&m->wellhead, radius(m->q, 1)) +
                 soil_energy(m->soil_stiffness, m->soil_strength, radius(m->q, 0));
    for (size_t d = 0; d < 2; d++) {
        const double *q = m->q + d * LG_RISER_ROW, *v = m->v + d * LG_RISER_ROW;
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j < N; j++)
                sum += 0.5 * (v[i] * m->matrices.mass[i * N + j] * v[j] +
                              q[i] * m->matrices.stiffness[i * N + j] * q[j]);
    }
    return sum;
}

static bool finite_state(const lg_riser_motion *m) {
    double sum = 0.0;
    for (size_t i = 0; i < LG_RISER_STATE; i++) sum += fabs(m->q[i]) + fabs(m->v[i]) + fabs(m->a[i]);
    return isfinite(sum);
}

static void copy_state(const double *from, size_t from_row, double *to, size_t to_row) {
    for (size_t d = 0; d < 2; d++) memcpy(to + d * to_row, from + d * from_row, LG_RISER_DOF * sizeof *to);
}

static lg_status run_freely(const lg_context *context, lg_riser_motion *m, size_t steps, double *energy,
                            lg_error *error) {
    enum { CHECK_EVERY = 1024 };
    const double still[2 * LG_RISER_STATE] = {0.0};
    lg_riser_motion_start(m, still);
    for (size_t i = 0;; i++) {
        if (energy) energy[i] = riser_motion_energy(m);
        if ((i % CHECK_EVERY == 0 || i == steps) && !finite_state(m))
            return lg_fail(error, LG_NOT_FINITE, "the motion grew without bound");
        if (i == steps) return LG_OK;
        if (i % CHECK_EVERY == 0 && lg_cancelled(context)) return lg_fail(error, LG_CANCELLED, "cancelled");
        lg_riser_motion_step(m, still);
    }
}

/* Integrates the free motion without waves, current and noise. q and v (2,
 * LG_RISER_DOF), x before y, are advanced in place over `steps` steps of dt. energy (steps + 1) may be NULL;
 * it becomes the kinetic plus potential energy of the conservative part, J. Damping and drag have the values
 * of the parameters; damped = false leaves both out. */
static lg_status riser_free_motion(const lg_context *context, const lg_riser_parameters *p, double dt,
                                   size_t steps, bool damped, double *q, double *v, double *energy,
                                   lg_error *error) {
    if (!q || !v) return lg_fail(error, LG_INVALID_ARGUMENT, "an argument is NULL");
    if (!(dt > 0.0) || !isfinite(dt)) return lg_fail(error, LG_INVALID_ARGUMENT, "dt must be positive");
    LG_TRY(lg_riser_parameters_check(p, error));
    if (energy && steps == SIZE_MAX) return lg_fail(error, LG_OUT_OF_MEMORY, "too many steps");
    lg_riser_motion *m = lg_alloc(context, 1, sizeof *m);
    double *kept = energy ? lg_alloc(context, steps + 1, sizeof *kept) : NULL;
    lg_status status = LG_OK;
    if (!m || (energy && !kept)) {
        status = lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %zu steps", steps);
    } else if (lg_riser_motion_init(p, dt, damped, 1.0, m) != LG_OK) {
        status = lg_fail(error, LG_INVALID_ARGUMENT, "the structure does not stand");
    } else {
        copy_state(q, LG_RISER_DOF, m->q, LG_RISER_ROW);
        copy_state(v, LG_RISER_DOF, m->v, LG_RISER_ROW);
        status = run_freely(context, m, steps, kept, error);
    }
    if (status == LG_OK) {
        copy_state(m->q, LG_RISER_ROW, q, LG_RISER_DOF);
        copy_state(m->v, LG_RISER_ROW, v, LG_RISER_DOF);
        if (energy) memcpy(energy, kept, (steps + 1) * sizeof *energy);
    }
    lg_free(context, kept);
    lg_free(context, m);
    return status;
}

#endif

/* Newton's method for one implicit stage, and the implicit schemes on R^n.
 *
 * The unknown z solves z = h f(t + theta h, stage(z)). The Jacobian of the residual is computed by
 * differences. It is used again as long as each correction is at most a tenth of the one before. Corrections
 * are damped by the natural monotonicity test (Deuflhard, Newton methods for nonlinear problems, 3.3). If
 * this does not converge, the equation is solved for increasing step sizes up to h, each started from the
 * solution for the step size before. Nothing is kept from one time step to the next, so a step depends on its
 * arguments only.
 */
#include <float.h>
#include <math.h>
#include <string.h>

#include "integrators/stepper.h"
#include "kernels/matrix.h"

#define ITERATIONS 40
#define HALVINGS   8
#define PARTS_MAX  64

/* ---- Newton's method ---- */

/* The equation z - h f(t, stage(y, z)) = 0, where t is the time of the stage. */
typedef struct lg_equation {
    lg_stepper *s;
    double t, h;
    const double *y, *input;
    lg_stage_map stage;
} lg_equation;

static lg_status residual(const lg_equation *e, const double *z, double *out) {
    lg_stepper *s = e->s;
    const size_t m = s->ode.space.algebra_dim;
    e->stage(s, e->y, z, s->point);
    LG_TRY(lg_stepper_evaluate(s, e->t, s->point, e->input, s->sigma));
    for (size_t i = 0; i < m; i++) out[i] = z[i] - e->h * s->sigma[i];
    return lg_all_finite(m, out) ? LG_OK : LG_NOT_FINITE;
}

/* max_i |x_i| / scale_i, or NaN when an x_i is NaN. */
static double size_of(const lg_stepper *s, const double *x) {
    double size = 0.0;
    for (size_t i = 0; i < s->ode.space.algebra_dim; i++) {
        const double relative = fabs(x[i]) / s->newton.scale[i];
        if (relative > size || isnan(relative)) size = relative;
    }
    return size;
}

/* Computes the Jacobian at newton.z and its factors. newton.residual must hold the residual at newton.z.
 * Overwrites newton.trial and newton.next. */
static lg_status linearise(const lg_equation *e) {
    lg_newton *w = &e->s->newton;
    const size_t m = e->s->ode.space.algebra_dim;
    memcpy(w->trial, w->z, m * sizeof(*w->z));
    for (size_t j = 0; j < m; j++) {
        w->trial[j] = w->z[j] + 1e-8 * w->scale[j];
        const double delta = w->trial[j] - w->z[j];
        LG_TRY(residual(e, w->trial, w->next));
        for (size_t i = 0; i < m; i++) w->jacobian[i * m + j] = (w->next[i] - w->residual[i]) / delta;
        w->trial[j] = w->z[j];
    }
    return lg_matrix_factor(m, m, w->jacobian, w->pivot) ? LG_OK : LG_NO_CONVERGENCE;
}

/* Tries z - lambda step for lambda = 1, 1/2, ... until the correction shrinks. On LG_OK the accepted point is
 * in newton.trial, its residual in newton.residual and its Newton correction in newton.next.
 * LG_NO_CONVERGENCE: the correction shrank for no lambda. */
static lg_status damped(const lg_equation *e, double size, double *next_size, double *lambda) {
    lg_newton *w = &e->s->newton;
    const size_t m = e->s->ode.space.algebra_dim;
    *lambda = 1.0;
    for (int i = 0; i < HALVINGS; i++, *lambda *= 0.5) {
        for (size_t j = 0; j < m; j++) w->trial[j] = w->z[j] - *lambda * w->step[j];
        const lg_status status = residual(e, w->trial, w->residual);
        if (status == LG_NOT_FINITE) continue;
        LG_TRY(status);
        memcpy(w->next, w->residual, m * sizeof(*w->next));
        lg_matrix_solve(m, m, w->jacobian, w->pivot, 1, w->next);
        *next_size = size_of(e->s, w->next);
        if (*next_size <= (1.0 - 0.25 * *lambda) * size) return LG_OK;
        if (size < 1e-8) break; /* the cause is rounding or an old Jacobian; a smaller lambda will not help */
    }
    return LG_NO_CONVERGENCE;
}

#define ROUNDING (0.05 * DBL_EPSILON)

/* Repeats corrections with the same Jacobian, the first of them newton.step, as long as each is at most a
 * tenth of the one before. *done true: newton.z is the solution. *done false with LG_OK: a new Jacobian is
 * needed; newton.residual holds the residual at newton.z. */
static lg_status chords(const lg_equation *e, bool *done) {
    lg_newton *w = &e->s->newton;
    const size_t m = e->s->ode.space.algebra_dim;
    double size = size_of(e->s, w->step), lambda = 1.0, rate = 0.0;
    for (bool fresh = true;; fresh = false) {
        double next_size;
        *done = size <= ROUNDING || (!fresh && size * rate <= ROUNDING);
        for (size_t i = 0; *done && i < m; i++) w->z[i] -= w->step[i];
        if (*done) return LG_OK;
        const lg_status status = damped(e, size, &next_size, &lambda);
        if (status == LG_NO_CONVERGENCE) {
            *done = size < (fresh ? 1e-8 : 1e-12); /* converged as far as rounding allows */
            if (*done) return LG_OK;
            return fresh ? status : residual(e, w->z, w->residual);
        }
        LG_TRY(status);
        memcpy(w->z, w->trial, m * sizeof(*w->z));
        memcpy(w->step, w->next, m * sizeof(*w->step));
        rate = next_size / size;
        size = next_size;
        if (lambda < 1.0 || rate > 0.1) return LG_OK;
    }
}

/* Newton's method with newton.z as the first guess; on LG_OK the solution is in newton.z. */
static lg_status iterate(const lg_equation *e) {
    lg_newton *w = &e->s->newton;
    const size_t m = e->s->ode.space.algebra_dim;
    bool done = false;
    LG_TRY(residual(e, w->z, w->residual));
    for (int i = 0; i < ITERATIONS && !done; i++) {
        LG_TRY(linearise(e));
        memcpy(w->step, w->residual, m * sizeof(*w->step));
        lg_matrix_solve(m, m, w->jacobian, w->pivot, 1, w->step);
        LG_TRY(chords(e, &done));
    }
    return done ? LG_OK : LG_NO_CONVERGENCE;
}

/* Solves the equation for the step sizes h/parts, 2 h/parts, ..., h. The first guess is h/parts f(t, y); each
 * further guess is the solution before, scaled by the ratio of the step sizes, as z is nearly proportional to
 * the step size. */
static lg_status in_parts(lg_equation e, double t, double theta, double h, int parts) {
    lg_newton *w = &e.s->newton;
    const size_t m = e.s->ode.space.algebra_dim;
    LG_TRY(lg_stepper_evaluate(e.s, t, e.y, e.input, e.s->sigma));
    if (!lg_all_finite(m, e.s->sigma)) return LG_NOT_FINITE;
    for (size_t i = 0; i < m; i++) w->z[i] = h / parts * e.s->sigma[i];
    for (int part = 1; part <= parts; part++) {
        const double grown = part > 1 ? (double)part / (part - 1) : 1.0;
        for (size_t i = 0; i < m; i++) w->z[i] *= grown;
        e.h = part == parts ? h : h * part / parts;
        e.t = t + theta * e.h;
        LG_TRY(iterate(&e));
    }
    return LG_OK;
}

lg_status lg_newton_solve(lg_stepper *s, double t, double h, const double *y, const double *input,
                          lg_stage_map stage) {
    const lg_equation equation = {.s = s, .y = y, .input = input, .stage = stage};
    lg_status status = LG_NO_CONVERGENCE;
    for (int parts = 1; parts <= PARTS_MAX; parts *= 4) {
        status = in_parts(equation, t, s->scheme->theta, h, parts);
        if (status != LG_NO_CONVERGENCE && status != LG_NOT_FINITE) break;
    }
    return status;
}

/* ---- implicit schemes on R^n: stage(z) = y + theta z, y1 = y + z ---- */

static void rn_stage(const lg_stepper *s, const double *y, const double *z, double *point) {
    for (size_t i = 0; i < s->ode.space.dim; i++) point[i] = y[i] + s->scheme->theta * z[i];
}

lg_status lg_step_implicit(lg_stepper *s, double t, double h, const double *y, const double *input) {
    const size_t n = s->ode.space.dim;
    double largest = 0.0;
    for (size_t i = 0; i < n; i++) largest = fmax(largest, fabs(y[i]));
    for (size_t i = 0; i < n; i++)
        s->newton.scale[i] = largest > 0.0 ? fmax(fabs(y[i]), 1e-3 * largest) : 1.0;
    LG_TRY(lg_newton_solve(s, t, h, y, input, rn_stage));
    for (size_t i = 0; i < n; i++) s->y_next[i] = y[i] + s->newton.z[i];
    return LG_OK;
}

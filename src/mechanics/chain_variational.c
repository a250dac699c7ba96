/* The variational integrator of the chain: the trapezoidal discrete Lagrangian in ambient coordinates with
 * the constraints |q_i| = 1, in its one-step form (SHAKE, RATTLE).
 *
 *   v_half = v + h/2 a - 1/h W o (mu_j q_j),   q1 = q + h v_half,        |q1_i| = 1
 *   v1     = v_half + h/2 a - W o (nu_j q1_j),                           q1_i.v1_i = 0
 *
 * with a = -m^-1 grad V = (-g/L_1 e3, 0, ..., 0) and (W o x)_i = sum_j W_ij x_j. The multipliers mu (SHAKE)
 * and nu (RATTLE) come from tridiagonal systems. See Hairer, Lubich, Wanner, Geometric Numerical Integration,
 * VII.1.4.
 */
#include <math.h>
#include <string.h>

#include "liegrad/geometry.h"
#include "mechanics/chain.h"
#include "mechanics/fields/scalars.h"

#include "mechanics/fields/chain.inc"

#define NEWTON_MAX     50
#define ROUNDING       1e-15 /* a residual (|q|^2 - 1)/2 up to this ends the iteration */
#define NEARLY         1e-13 /* so does a residual up to this that no longer falls */
#define STEP_TOO_LARGE 1e6

typedef struct step_work {
    double *q, *v;                        /* (k, 3) */
    double *lower, *diagonal, *upper, *r; /* k each */
    double *scratch;                      /* k */
} step_work;

static step_work split_work(size_t k, double *work) {
    return (step_work){.q = work,
                       .v = work + 3 * k,
                       .lower = work + 6 * k,
                       .diagonal = work + 7 * k,
                       .upper = work + 8 * k,
                       .r = work + 9 * k,
                       .scratch = work + 10 * k};
}

/* x = J^-1 x for the tridiagonal J, by elimination without pivoting: for small h, J is close to the positive
 * definite matrix (W_ij q_i.q_j). */
static void solve_general(size_t k, const double *lower, const double *diagonal, const double *upper,
                          double *x, double *scratch) {
    double pivot = diagonal[0];
    x[0] /= pivot;
    for (size_t i = 1; i < k; i++) {
        scratch[i] = upper[i - 1] / pivot;
        pivot = diagonal[i] - lower[i] * scratch[i];
        x[i] = (x[i] - lower[i] * x[i - 1]) / pivot;
    }
    for (size_t i = k - 1; i-- > 0;) x[i] -= scratch[i + 1] * x[i + 1];
}

/* out_i -= scale sum_j W_ij x_j q_j, where q_j is the 3-vector at q + stride j. */
static void subtract_forces(const lg_chain *chain, double scale, const double *x, const double *q,
                            size_t stride, double *out) {
    const size_t k = chain->links;
    for (size_t i = 0; i < k; i++)
        for (size_t c = 0; c < 3; c++) {
            double sum = chain->w[i] * x[i] * q[stride * i + c];
            if (i > 0) sum += chain->w_next[i - 1] * x[i - 1] * q[stride * (i - 1) + c];
            if (i + 1 < k) sum += chain->w_next[i] * x[i + 1] * q[stride * (i + 1) + c];
            out[3 * i + c] -= scale * sum;
        }
}

/* r_i = (|q1_i|^2 - 1)/2. Returns the largest |r_i|, or NaN if an r_i is NaN. */
static double residual(size_t k, const double *q, double *r) {
    double worst = 0.0;
    for (size_t i = 0; i < k; i++) {
        r[i] = 0.5 * (lg_dot3(q + 3 * i, q + 3 * i) - 1.0);
        if (!(fabs(r[i]) <= worst)) worst = fabs(r[i]);
        if (isnan(worst)) break;
    }
    return worst;
}

/* Newton's method for the positions. On entry w->v is v_half without constraint forces and w->q = q + h w->v;
 * on return both include the constraint forces. y holds q. */
static lg_status shake(const lg_chain *chain, double h, const double *y, step_work *w) {
    const size_t k = chain->links;
    double last = INFINITY;
    for (int n = 0; n < NEWTON_MAX; n++) {
        const double worst = residual(k, w->q, w->r);
        if (!(worst <= STEP_TOO_LARGE)) return isnan(worst) ? LG_NOT_FINITE : LG_NO_CONVERGENCE;
        if (worst <= ROUNDING || (worst <= NEARLY && !(worst < last))) return LG_OK;
        last = worst;
        for (size_t i = 0; i < k; i++) {
            const double *q1 = w->q + 3 * i, *q0 = y + 6 * i;
            w->diagonal[i] = chain->w[i] * lg_dot3(q1, q0);
            w->lower[i] = i > 0 ? chain->w_next[i - 1] * lg_dot3(q1, q0 - 6) : 0.0;
            w->upper[i] = i + 1 < k ? chain->w_next[i] * lg_dot3(q1, q0 + 6) : 0.0;
        }
        solve_general(k, w->lower, w->diagonal, w->upper, w->r, w->scratch);
        subtract_forces(chain, 1.0, w->r, y, 6, w->q);
        subtract_forces(chain, 1.0 / h, w->r, y, 6, w->v);
    }
    return LG_NO_CONVERGENCE;
}

/* Removes from w->v the part that violates q1_i.v1_i = 0 at q1 = w->q. */
static lg_status rattle(const lg_chain *chain, step_work *w) {
    const size_t k = chain->links;
    for (size_t i = 0; i < k; i++) {
        const double *q = w->q + 3 * i;
        w->diagonal[i] = chain->w[i] * lg_dot3(q, q);
        w->upper[i] = i + 1 < k ? chain->w_next[i] * lg_dot3(q, q + 3) : 0.0;
        w->r[i] = lg_dot3(q, w->v + 3 * i);
    }
    tridiagonal_factor_of(k, true, w->diagonal, w->upper);
    if (isnan(w->diagonal[k - 1])) return LG_NOT_FINITE;
    tridiagonal_solve_of(k, w->diagonal, w->upper, w->r, w->r);
    subtract_forces(chain, 1.0, w->r, w->q, 3, w->v);
    return LG_OK;
}

lg_status lg_chain_rattle(const lg_chain *chain, double h, double *y, double *v, double *work) {
    const size_t k = chain->links;
    const double kick = -0.5 * h * chain->gravity * chain->curvature[0];
    step_work w = split_work(k, work);
    if (h == 0.0) return LG_OK;
    memcpy(w.v, v, 3 * k * sizeof(*v));
    w.v[2] += kick;
    for (size_t i = 0; i < k; i++)
        for (size_t c = 0; c < 3; c++) w.q[3 * i + c] = y[6 * i + c] + h * w.v[3 * i + c];
    LG_TRY(shake(chain, h, y, &w));
    w.v[2] += kick;
    LG_TRY(rattle(chain, &w));
    for (size_t i = 0; i < k; i++) memcpy(y + 6 * i, w.q + 3 * i, 3 * sizeof(*y));
    memcpy(v, w.v, 3 * k * sizeof(*v));
    return LG_OK;
}

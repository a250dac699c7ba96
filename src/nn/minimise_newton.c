/* When searches fail: the Hessian A, from differences of gradients, tells whether the point is a minimum. If
 * it is not, or if rounding has spoiled H, the search goes on along a Newton step with A.
 *
 * A is symmetric (n, n). Its upper triangle stays; the lower triangle and the diagonal are overwritten by a
 * Cholesky factor, so m->s keeps the diagonal of A. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "nn/minimise_internal.h"

enum { MOST_VARIABLES = 200, ITERATIONS = 20 };
static const double DIFFERENCE = 1e-5; /* step relative to |x_i| */
static const double FLAT = 1e-12;      /* relative to |f|: curvature that changes f by less counts as zero */
static const double LEAST_SHIFT = 1e-12, MOST_SHIFT = 1e12; /* relative to the diagonal D */
/* if no larger shift is needed, A counts as positive semidefinite */
static const double CONVEX_SHIFT = 1e-9;
/* relative to D: one-sided differences show the sign of larger eigenvalues */
static const double CLEAR = 1e-4;
static const double PROFIT = 0.1, LEFT = 1e-8, STILL = 1e-12, STRIDE = 0.1, LEAST_SLOPE = 1e-300;

static size_t before_hessian(const lg_minimiser *m) {
    return m->row->before_hessian != NULL ? m->row->before_hessian(m) : 0;
}

static double *hessian_of(const lg_minimiser *m) {
    return m->curvature + before_hessian(m);
}

bool lg_minimise_newton_fits(const lg_minimiser *m) {
    return m->options.check && m->options.ranks == NULL && m->n <= MOST_VARIABLES &&
           before_hessian(m) + m->n * m->n <= m->length;
}

static double step_of(const lg_minimiser *m, size_t i) {
    return DIFFERENCE * fmax(fabs(m->x[i]), DIFFERENCE);
}

/* The next point of the differences. Trials 0 to n - 1: x plus a step along one variable. Trial n: x minus
 * the steps along all variables. Trials n + 1 to 2 n: x minus a step along one variable. */
static void next_point(lg_minimiser *m) {
    const size_t n = m->n, trial = (size_t)m->counts.trials;
    memcpy(m->point, m->x, n * sizeof *m->x);
    for (size_t i = 0; i < n; i++) {
        if (trial == i) m->point[i] += step_of(m, i);
        if (trial == n || trial == n + 1 + i) m->point[i] -= step_of(m, i);
    }
}

static void begin(lg_minimiser *m) {
    m->counts.stage = LG_STAGE_HESSIAN;
    m->counts.trials = m->counts.pairs = 0;
    m->newton = true;
    next_point(m);
}

lg_minimise_end lg_minimise_verify(lg_minimiser *m, lg_minimise_end end) {
    const bool newton = lg_minimise_newton_fits(m);
    if (m->counts.stage == LG_STAGE_DONE) return (lg_minimise_end)m->counts.end;
    if (!newton && !lg_minimise_curvature_fits(m)) {
        lg_minimise_finish(m, end);
        return end;
    }
    m->counts.failures = 2;
    if (newton)
        begin(m);
    else
        lg_minimise_curvature_begin(m);
    return LG_MINIMISE_RUNNING;
}

/* D_i, the scale of the curvature of variable i, chosen such that A_ij^2 <= D_i D_j. It is A_ii if A is
 * positive semidefinite. For f = x y, where the diagonal of A is zero, it is |A_ij| if both variables have
 * the same size. Needs both triangles of A. */
static double curvature_of(const lg_minimiser *m, size_t i) {
    const double *row = hessian_of(m) + i * m->n, size = 1.0 + fabs(m->x[i]);
    double most = fmax(FLAT * fabs(m->numbers.value) / (size * size), 1e-300);
    for (size_t j = 0; j < m->n; j++) {
        const double ratio = (1.0 + fabs(m->x[j])) / size;
        most = fmax(most, fmin(fabs(row[j]) * ratio, row[j] * row[j] / fabs(m->s[j])));
    }
    return most;
}

/* Makes A symmetric. m->s becomes the diagonal of A, and m->y becomes 1/sqrt(D), where D_i is curvature_of
 * variable i. */
static void measure(lg_minimiser *m) {
    const size_t n = m->n;
    double *A = hessian_of(m);
    for (size_t i = 0; i < n; i++) {
        m->s[i] = A[i * n + i];
        for (size_t j = 0; j < i; j++) A[j * n + i] = A[i * n + j] = 0.5 * (A[j * n + i] + A[i * n + j]);
    }
    for (size_t i = 0; i < n; i++) m->y[i] = 1.0 / sqrt(curvature_of(m, i));
}

/* Factors S (A + shift D) S with S = diag(m->y), which makes D the unit matrix. The factor goes to the lower
 * triangle; the diagonal of A is read from m->s. Returns false if the matrix is not positive definite. */
static bool factor(lg_minimiser *m, double shift) {
    const size_t n = m->n;
    const int order = (int)n;
    double *A = hessian_of(m);
    int info = 0;
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < i; j++) A[i * n + j] = A[j * n + i] * m->y[i] * m->y[j];
        A[i * n + i] = m->s[i] * m->y[i] * m->y[i] + shift;
    }
    /* LAPACK's upper triangle (by columns) is our lower triangle (by rows) */
    dpotrf_("U", &order, A, &order, &info);
    return info == 0;
}

/* x <- (S (A + shift D) S)^-1 x, with the factor of factor(). */
static void solve(const lg_minimiser *m, double *x) {
    const int order = (int)m->n, one = 1;
    int info;
    dpotrs_("U", &order, &one, hessian_of(m), &order, x, &order, &info);
}

/* Adds to d a step along which f curves downwards: the eigenvector of the lowest eigenvalue, by inverse
 * iteration. The variable with the largest change relative to 1 + |x_i| changes by STRIDE (1 + |x_i|). The
 * shift is first halved as often as the matrix stays positive definite. Then the eigenvector grows at least
 * twice as fast per iteration as eigenvectors of positive eigenvalues. */
static void add_downwards(lg_minimiser *m, double shift) {
    const size_t n = m->n;
    double *v = m->s, most = 0.0;
    while (factor(m, 0.5 * shift)) shift *= 0.5;
    (void)factor(m, shift);
    lg_minimise_check_direction(m);
    for (int i = 0; i < ITERATIONS; i++) {
        solve(m, v);
        const double length = sqrt(m->k->dot(n, v, v));
        for (size_t j = 0; j < n; j++) v[j] /= length;
    }
    for (size_t j = 0; j < n; j++) {
        v[j] *= m->y[j];
        most = fmax(most, fabs(v[j]) / (1.0 + fabs(m->x[j])));
    }
    m->k->axpy(n, copysign(STRIDE / most, -m->k->dot(n, m->g, v)), v, m->d);
}

bool lg_minimise_newton_shows(const lg_minimiser *m) {
    const double fall = -0.5 * m->k->dot(m->n, m->g, m->d);
    bool still = true;
    for (size_t i = 0; i < m->n; i++) still = still && fabs(m->d[i]) <= LEFT * fabs(m->x[i]) + STILL;
    return m->numbers.damping <= CONVEX_SHIFT && (still || fall <= LEFT * fabs(m->numbers.value));
}

bool lg_minimise_newton_pays(const lg_minimiser *m, double fall) {
    return lg_minimise_newton_fits(m) && m->numbers.damping <= CONVEX_SHIFT &&
           fall > PROFIT * fabs(m->numbers.value + fall);
}

void lg_minimise_leave(lg_minimiser *m) {
    if (m->k->dot(m->n, m->g, m->d) < 0.0) {
        lg_minimise_search(m, 1.0);
        return;
    }
    m->numbers.slope = -LEAST_SLOPE;
    lg_minimise_search_begin(m, 1.0);
    lg_minimise_set_point(m, 1.0, m->d);
}

/* Whether the Newton step lowers f by at most (sum sqrt(D_i) eps |x_i|)^2/2, the change of f that rounding of
 * x can cause. This also finds a minimum where f is 0, where no fall is small relative to f. */
static bool is_rounding(const lg_minimiser *m) {
    double sum = 0.0;
    for (size_t i = 0; i < m->n; i++) sum += fabs(m->x[i]) / m->y[i];
    return -m->k->dot(m->n, m->g, m->d) <= DBL_EPSILON * sum * DBL_EPSILON * sum || lg_minimise_tiny(m);
}

/* Searches along the Newton step d = -(A + shift D)^-1 g. The shift is 0 or the lowest power of 10 that makes
 * the matrix positive definite. */
static void decide(lg_minimiser *m) {
    const size_t n = m->n;
    double shift = 0.0;
    measure(m);
    while (!factor(m, shift) && shift <= MOST_SHIFT) shift = fmax(10.0 * shift, LEAST_SHIFT);
    m->numbers.damping = shift;
    for (size_t i = 0; i < n; i++) m->d[i] = -m->g[i] * m->y[i];
    if (shift <= MOST_SHIFT) solve(m, m->d);
    for (size_t i = 0; i < n; i++) m->d[i] *= m->y[i];
    if (shift > CONVEX_SHIFT && shift <= MOST_SHIFT) add_downwards(m, shift);
    if (m->row->invert != NULL && shift <= CONVEX_SHIFT) m->row->invert(m, m->y);
    if (lg_minimise_flat(m) && shift <= CONVEX_SHIFT) {
        lg_minimise_finish(m, LG_MINIMISE_GRADIENT);
    } else if (shift <= CONVEX_SHIFT && is_rounding(m)) {
        lg_minimise_finish(m, LG_MINIMISE_ROUNDING);
    } else {
        lg_minimise_leave(m);
    }
}

/* Whether one-sided differences suffice: A predicts `gradient`, the gradient at x minus all steps, and A
 * shows a minimum (all eigenvalues above CLEAR) or a saddle (one below -CLEAR), relative to D. A is symmetric
 * and whole on return. */
static bool is_clear(lg_minimiser *m, const double *gradient) {
    const size_t n = m->n;
    double *A = hessian_of(m), *off = m->d;
    for (size_t j = 0; j < n; j++) off[j] = gradient[j] - m->g[j];
    for (size_t i = 0; i < n; i++) m->k->axpy(n, step_of(m, i), A + i * n, off);
    measure(m);
    bool clear = true;
    for (size_t j = 0; j < n; j++) clear &= fabs(off[j]) * m->y[j] * m->y[j] <= CLEAR * step_of(m, j);
    clear = clear && (factor(m, -CLEAR) || !factor(m, CLEAR));
    for (size_t i = 0; i < n; i++) {
        A[i * n + i] = m->s[i];
        for (size_t j = 0; j < i; j++) A[i * n + j] = A[j * n + i];
    }
    return clear;
}

/* Takes one gradient of the differences, which go to both sides of x. Trial n, at x minus all steps, is
 * evaluated only where g is zero; if is_clear then holds, the differences to one side suffice. */
void lg_minimise_newton_tell(lg_minimiser *m, const double *gradient) {
    const size_t n = m->n, trial = (size_t)m->counts.trials;
    const bool back = trial > n;
    const size_t i = back ? trial - n - 1 : trial;
    if (!m->k->all_finite(n, gradient)) {
        lg_minimise_finish(m, lg_minimise_flat(m) ? LG_MINIMISE_GRADIENT : LG_MINIMISE_STUCK);
        return;
    }
    const bool last = trial == n ? is_clear(m, gradient) : trial == 2 * n;
    if (trial != n) {
        double *row = hessian_of(m) + i * n;
        const double step = back ? -step_of(m, i) : step_of(m, i);
        for (size_t j = 0; j < n; j++) {
            const double slope = (gradient[j] - m->g[j]) / step;
            row[j] = back ? 0.5 * (row[j] + slope) : slope;
        }
    }
    m->counts.trials++;
    if (last)
        decide(m);
    else
        next_point(m);
}

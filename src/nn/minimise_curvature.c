/* When searches fail and the Hessian is too large to compute: Lanczos' method on products with the Hessian A,
 * which are differences of gradients (Golub & Van Loan, Matrix Computations, 10.1).
 *
 * Let S = diag(1 + |x_i|). The products S A S q_k = S (g(x + h S q_k) - g(x))/h of orthonormal vectors q_k
 * give a tridiagonal matrix T, whose eigenvalues lie between the extreme eigenvalues of S A S. If T has a
 * negative eigenvalue, its eigenvector gives a direction in which f falls. */
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "nn/minimise_internal.h"

static const double DIFFERENCE = 1e-6; /* h: length of the step along q_k, which has length 1 */
/* Relative to the largest eigenvalue: smaller negative curvature is taken for an error of the differences. */
static const double NEGATIVE = 1e-4;
/* relative to |f|: smaller negative curvature counts as zero, as in minimise_newton.c */
static const double FLAT = 1e-12;
/* Relative to the largest eigenvalue: a smaller remainder of a product is rounding, and T cannot grow. */
static const double CLOSED = 1e-8;
static const double STRIDE = 0.1;

static double *vector(const lg_minimiser *m, size_t k) {
    return m->curvature + k * lg_minimise_stride(m->n);
}

/* T: LG_LANCZOS_STEPS diagonal elements, then as many off-diagonal elements. */
static double *coefficients(const lg_minimiser *m) {
    return vector(m, LG_LANCZOS_STEPS);
}

bool lg_minimise_curvature_fits(const lg_minimiser *m) {
    const size_t length = lg_minimise_curvature_length(m->n, &m->options);
    return m->row->update != NULL && length > 0 && length <= m->length;
}

static double size_of(const lg_minimiser *m, size_t i) {
    return 1.0 + fabs(m->x[i]);
}

static void normalise(const lg_minimiser *m, double *q) {
    const double length = sqrt(m->k->dot(m->n, q, q));
    for (size_t i = 0; i < m->n; i++) q[i] /= length;
}

static void next_point(lg_minimiser *m) {
    const double *q = vector(m, (size_t)m->counts.trials);
    for (size_t i = 0; i < m->n; i++) m->point[i] = m->x[i] + DIFFERENCE * size_of(m, i) * q[i];
}

void lg_minimise_curvature_begin(lg_minimiser *m) {
    m->counts.stage = LG_STAGE_CURVATURE;
    m->counts.trials = m->counts.pairs = 0;
    lg_minimise_check_direction(m);
    memcpy(vector(m, 0), m->s, m->n * sizeof *m->s);
    normalise(m, vector(m, 0));
    next_point(m);
}

/* Returns the lowest eigenvalue of T (count, count), or 0 if LAPACK fails. v: its eigenvector (count);
 * *largest: the largest absolute eigenvalue. */
static double least_of(const lg_minimiser *m, size_t count, double *v, double *largest) {
    enum { MOST = LG_LANCZOS_STEPS, WORK = 1 + 6 * MOST + 2 * MOST * MOST, INTEGERS = 3 + 5 * MOST };
    const double *diagonal = coefficients(m), *beside = diagonal + MOST;
    double A[MOST * MOST] = {0.0}, values[MOST], work[WORK];
    const int n = (int)count, room = WORK, integers = INTEGERS;
    int whole[INTEGERS], info;
    for (size_t i = 0; i < count; i++) {
        A[i * count + i] = diagonal[i];
        if (i > 0) A[i * count + i - 1] = A[(i - 1) * count + i] = beside[i - 1];
    }
    dsyevd_("V", "U", &n, A, &n, values, work, &room, whole, &integers, &info);
    memcpy(v, A, count * sizeof *v);
    *largest = fmax(fabs(values[0]), fabs(values[count - 1]));
    return info == 0 ? values[0] : 0.0;
}

/* Searches along d = S sum_k v[k] q_k, downhill. The length of d is such that the variable with the largest
 * change relative to 1 + |x_i| changes by STRIDE (1 + |x_i|). */
static void leave(lg_minimiser *m, size_t count, const double *v) {
    double most = 0.0;
    for (size_t i = 0; i < m->n; i++) m->d[i] = 0.0;
    for (size_t k = 0; k < count; k++) m->k->axpy(m->n, v[k], vector(m, k), m->d);
    for (size_t i = 0; i < m->n; i++) most = fmax(most, fabs(m->d[i]));
    const double way = copysign(STRIDE / most, -m->k->dot(m->n, m->g, m->d));
    for (size_t i = 0; i < m->n; i++) m->d[i] *= way * size_of(m, i);
    m->numbers.damping = 1.0; /* d is no Newton step */
    lg_minimise_leave(m);
}

/* Computes w = S A S q_k and the diagonal element q_k.w of T; then subtracts from w its components along q_0,
 * ..., q_k. Returns |w|, which is the next off-diagonal element of T. */
static double multiply(lg_minimiser *m, const double *gradient, double *w, double *diagonal) {
    const size_t k = (size_t)m->counts.trials, n = m->n;
    for (size_t i = 0; i < n; i++) w[i] = size_of(m, i) * (gradient[i] - m->g[i]) / DIFFERENCE;
    *diagonal = m->k->dot(n, vector(m, k), w);
    for (size_t j = 0; j < 2 * (k + 1); j++) { /* all components twice, because of rounding */
        const double *q = vector(m, j % (k + 1));
        m->k->axpy(n, -m->k->dot(n, q, w), q, w);
    }
    return sqrt(m->k->dot(n, w, w));
}

void lg_minimise_curvature_tell(lg_minimiser *m, const double *gradient) {
    const size_t k = (size_t)m->counts.trials, count = k + 1;
    const size_t most = m->n < LG_LANCZOS_STEPS ? m->n : LG_LANCZOS_STEPS;
    const lg_minimise_end end = lg_minimise_flat(m) ? LG_MINIMISE_GRADIENT : lg_minimise_no_step(m);
    double v[LG_LANCZOS_STEPS], largest, *w = m->y, *T = coefficients(m);
    if (!m->k->all_finite(m->n, gradient)) {
        lg_minimise_finish(m, end);
        return;
    }
    const double left = multiply(m, gradient, w, &T[k]), least = least_of(m, count, v, &largest);
    if (least < -NEGATIVE * largest - FLAT * fabs(m->numbers.value)) {
        leave(m, count, v);
    } else if (count == most || !(left > CLOSED * largest)) {
        lg_minimise_finish(m, end);
    } else {
        T[LG_LANCZOS_STEPS + k] = left;
        memcpy(vector(m, count), w, m->n * sizeof *w);
        normalise(m, vector(m, count));
        m->counts.trials++;
        next_point(m);
    }
}

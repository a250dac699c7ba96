/* Levenberg-Marquardt: damped Gauss-Newton steps, with the damping of Nielsen (1999), in lg_least_squares
 * that of a trust region (More 1978). Blocks of variables of which no two meet in a residual are eliminated.
 * With A = (P C^T; C B), where B is block diagonal, B = L L^T and Y = L^-1 C:
 *   (P - Y^T Y) d_p = -g_p + Y^T L^-1 g_b,  d_b = -L^-T (L^-1 g_b + Y d_p).  */
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "nn/minimise_internal.h"

enum { MOST_REFUSALS = 40 };
static const double FIRST_DAMPING = 1e-3, LEAST_GAIN = 1e-4, FASTEST_FALL = 0.1, ROUNDING = 1e-16,
                    LEAST_DAMPING = 1e-20, LEFT = 1e-8, LEAST_INFLUENCE = 1e-3, FORGET = 0.5,
                    LAST_RISE = 1e-14, NEGLIGIBLE = 1e-14, NEAR = 0.1, BAD_GAIN = 0.25, GOOD_GAIN = 0.9,
                    GROWTH = 1.5;

/* ---- memory: rows of p numbers, padded to the stride ---- */

typedef struct arrow {
    size_t p, stride, blocks, block, rest; /* rest = blocks block: number of eliminated variables */
    double *P, *schur;                     /* (p, stride): P of A; damped P minus Y^T Y */
    double *D;                             /* (n): largest diagonal of A so far */
    double *C, *Y;                         /* (rest, stride) each */
    /* (blocks, block, block) each: B of A; Cholesky factors of the damped blocks */
    double *B, *L;
} arrow;

static arrow sizes_of(size_t n, const lg_minimise_options *o) {
    const size_t rest = o->blocks * o->block, p = n - rest;
    return (arrow){
        .p = p, .stride = lg_minimise_stride(p), .blocks = o->blocks, .block = o->block, .rest = rest};
}

static size_t length(size_t n, const lg_minimise_options *options) {
    const arrow a = sizes_of(n, options);
    return 2 * (a.p + a.rest) * a.stride + lg_minimise_stride(n) + 2 * a.rest * a.block;
}

size_t lg_minimise_matrix_length(size_t n, const lg_minimise_options *options) {
    const arrow a = sizes_of(n, options);
    return a.p * a.p + a.rest * (a.p + a.block);
}

static arrow arrow_of(const lg_minimiser *m) {
    arrow a = sizes_of(m->n, &m->options);
    a.P = m->curvature;
    a.schur = a.P + a.p * a.stride;
    a.D = a.schur + a.p * a.stride;
    a.C = a.D + lg_minimise_stride(m->n);
    a.Y = a.C + a.rest * a.stride;
    a.B = a.Y + a.rest * a.stride;
    a.L = a.B + a.rest * a.block;
    return a;
}

/* ---- the step ---- */

/* D_i. For lg_least_squares it is at least LEAST_INFLUENCE f/x_i^2, which limits the step of a variable with
 * little influence relative to |x_i|. */
static double scale_of(const lg_minimiser *m, const arrow *a, size_t i) {
    const double least = LEAST_INFLUENCE * m->numbers.value / m->x[i] / m->x[i];
    return m->squares != NULL && fabs(m->x[i]) > NEGLIGIBLE ? fmax(a->D[i], least) : a->D[i];
}

/* The number mu D_i that is added to element i of the diagonal. It is 1 if D_i is 0, so that a variable
 * without influence does not move. */
static double damping_of(const lg_minimiser *m, const arrow *a, size_t i) {
    const double d = scale_of(m, a, i);
    return d > 0.0 ? d * m->numbers.damping : 1.0;
}

/* Eliminates block b: computes its L and its rows of Y, and replaces its part of d, which holds -g_b, by
 * -L^-1 g_b. Returns false if the damped block is not positive definite. */
static bool eliminate(const lg_minimiser *m, const arrow *a, size_t b) {
    const size_t n = a->block, first = b * n;
    double *L = a->L + first * n, *d = m->d + a->p + first;
    memcpy(L, a->B + first * n, n * n * sizeof *L);
    for (size_t i = 0; i < n; i++) {
        double *y = a->Y + (first + i) * a->stride;
        memcpy(y, a->C + (first + i) * a->stride, a->p * sizeof *y);
        L[i * n + i] += damping_of(m, a, a->p + first + i);
        for (size_t j = 0; j <= i; j++) {
            for (size_t k = 0; k < j; k++) L[i * n + j] -= L[i * n + k] * L[j * n + k];
            if (j < i) {
                L[i * n + j] /= L[j * n + j];
                d[i] -= L[i * n + j] * d[j];
                m->k->axpy(a->p, -L[i * n + j], a->Y + (first + j) * a->stride, y);
            }
        }
        if (!(L[i * n + i] > 0.0)) return false;
        L[i * n + i] = sqrt(L[i * n + i]);
        d[i] /= L[i * n + i];
        m->k->unary[LG_K_SCALE](a->p, 1.0 / L[i * n + i], y, y);
    }
    return true;
}

static void put_back(const lg_minimiser *m, const arrow *a, size_t b) {
    const size_t n = a->block, first = b * n;
    const double *L = a->L + first * n;
    double *d = m->d + a->p + first;
    for (size_t i = n; i-- > 0;) {
        d[i] -= m->k->dot(a->p, a->Y + (first + i) * a->stride, m->d);
        for (size_t j = i + 1; j < n; j++) d[i] -= L[j * n + i] * d[j];
        d[i] /= L[i * n + i];
    }
}

/* This number replaces mu D_i in a step without damping. It is tiny, and only makes a singular J
 * factorable. */
static double ridge_of(const arrow *a, size_t i) {
    const double square = a->P[i * a->stride + i];
    return square > 0.0 ? LEAST_DAMPING * square : 1.0;
}

/* Computes the d of solve() from J: it minimises |(J; sqrt(mu D/2)) d + (r; 0)|, by Householder reflections.
 * The error grows with the condition of J, not with its square. If `damped` is false, ridge_of replaces mu
 * D. */
static bool solve_residuals(lg_minimiser *m, bool damped) {
    const lg_minimise_squares *q = m->squares;
    const arrow a = arrow_of(m);
    const size_t n = m->n, rows = q->rows + n;
    const int tall = (int)rows, order = (int)n, one = 1, room = LG_SQUARES_ROOM * (int)n;
    double *R = q->stack, *right = R + n * rows, *tau = right + rows, *work = tau + n;
    int info;
    for (size_t j = 0; j < n; j++) {
        double *column = R + j * rows;
        memcpy(column, q->columns + j * q->rows, q->rows * sizeof *R);
        memset(column + q->rows, 0, n * sizeof *R);
        column[q->rows + j] = sqrt(0.5 * (damped ? damping_of(m, &a, j) : ridge_of(&a, j)));
    }
    for (size_t i = 0; i < rows; i++) right[i] = i < q->rows ? -q->r[i] : 0.0;
    dgeqrf_(&tall, &order, R, &tall, tau, work, &room, &info);
    dormqr_("L", "T", &tall, &one, &order, R, &tall, tau, right, &tall, work, &room, &info);
    for (size_t i = n; i-- > 0;) {
        double sum = right[i];
        for (size_t j = i + 1; j < n; j++) sum -= R[j * rows + i] * m->d[j];
        m->d[i] = sum / R[i * rows + i];
    }
    return m->k->all_finite(n, m->d);
}

/* Solves (A + mu D) d = -g. Returns false if the matrix is not positive definite. */
static bool solve(lg_minimiser *m) {
    const arrow a = arrow_of(m);
    const int order = (int)a.p, leading = (int)a.stride, one = 1, rest = (int)a.rest;
    static const double minus = -1.0, plus = 1.0;
    int info = 0;
    m->k->unary[LG_K_SCALE](m->n, -1.0, m->g, m->d);
    memcpy(a.schur, a.P, a.p * a.stride * sizeof *a.schur);
    for (size_t i = 0; i < a.p; i++) a.schur[i * a.stride + i] += damping_of(m, &a, i);
    for (size_t b = 0; b < a.blocks; b++)
        if (!eliminate(m, &a, b)) return false;
    if (a.p > 0) {
        if (rest > 0) dsyrk_("L", "N", &order, &rest, &minus, a.Y, &leading, &plus, a.schur, &leading);
        for (size_t i = 0; i < a.rest; i++) m->k->axpy(a.p, -m->d[a.p + i], a.Y + i * a.stride, m->d);
        dposv_("L", &order, &one, a.schur, &leading, m->d, &order, &info);
    }
    for (size_t b = 0; b < a.blocks && info == 0; b++) put_back(m, &a, b);
    return info == 0 && m->k->all_finite(m->n, m->d);
}

/* The fall f - f(x + d) that the model f + g.d + d.A d/2 predicts. */
static double foretold(lg_minimiser *m) {
    const arrow a = arrow_of(m);
    double twice = 0.0;
    if (a.p > 0) {
        m->k->matvec(a.p, a.stride, a.P, m->d, m->y, false);
        twice = m->k->dot(a.p, m->d, m->y);
    }
    for (size_t i = 0; i < a.rest; i++) {
        const double *block = m->d + a.p + i / a.block * a.block;
        twice += m->d[a.p + i] * (2.0 * m->k->dot(a.p, a.C + i * a.stride, m->d) +
                                  m->k->dot(a.block, a.B + i * a.block, block));
    }
    return -m->numbers.slope - 0.5 * twice;
}

/* Whether the step without damping moves each x_i by at most LEFT |x_i|, or lowers f by at most LEFT f. */
static bool at_minimum(lg_minimiser *m) {
    bool still = true;
    if (!solve_residuals(m, false)) return false;
    for (size_t i = 0; i < m->n; i++) still = still && fabs(m->d[i]) <= LEFT * fabs(m->x[i]);
    /* The part of -r in the column space of J: the first n numbers of the right side, behind the factor. */
    const double *in = m->squares->stack + m->n * (m->squares->rows + m->n);
    return still || m->k->dot(m->n, in, in) <= LEFT * m->numbers.value;
}

/* The length of d in the norm of D, in which the radius of lg_least_squares is measured. */
static double length_of(const lg_minimiser *m, const double *d) {
    const arrow a = arrow_of(m);
    double sum = 0.0;
    for (size_t i = 0; i < m->n; i++) sum += scale_of(m, &a, i) * d[i] * d[i];
    return sqrt(sum);
}

/* The step without damping if it is within the radius; otherwise that with the damping for which its length
 * is the radius, to a tenth (More 1978). */
static bool solve_within(lg_minimiser *m) {
    enum { MOST = 60 };
    double low = 0.0, high = INFINITY, *mu = &m->numbers.damping;
    bool good = solve_residuals(m, false),
         near = good && !(length_of(m, m->d) > (1.0 + NEAR) * m->numbers.radius);
    for (int i = 0; i < MOST && !near; i++) {
        good = solve_residuals(m, true);
        const double length = length_of(m, m->d) / m->numbers.radius;
        near = good && fabs(length - 1.0) <= NEAR;
        *(length < 1.0 ? &high : &low) = *mu;
        if (!near) *mu = high == INFINITY ? 4.0 * low : low == 0.0 ? 0.25 * high : sqrt(low * high);
    }
    return good;
}

/* After a trial with the value f: a radius that is shorter if the model predicted the fall badly. */
static void set_radius(lg_minimiser *m, double value, double gain) {
    const double length = length_of(m, m->d), rise = value - m->numbers.value - m->numbers.slope;
    if (!(gain > BAD_GAIN))
        m->numbers.radius = fmin(0.5, fmax(0.1, -0.5 * m->numbers.slope / rise)) * length;
    else if (gain > GOOD_GAIN)
        m->numbers.radius = fmax(m->numbers.radius, GROWTH * length);
}

static void refuse(lg_minimiser *m) {
    m->counts.failures++;
    m->numbers.damping *= m->numbers.growth;
    m->numbers.growth *= 2.0;
}

/* x is a minimum to the rounding of f. One more step, without damping, gives more correct digits of x. */
static void begin_last(lg_minimiser *m) {
    lg_minimise_set_point(m, 1.0, m->d);
    m->counts.stage = LG_STAGE_SEARCH;
    m->last = true;
}

/* Proposes the next trial; raises the damping while the damped matrix is not positive definite. If the step
 * does not change x, or is predicted to lower f by less than the rounding of f, the run verifies the minimum,
 * takes a last step or ends. */
static void propose(lg_minimiser *m) {
    for (; m->counts.failures < MOST_REFUSALS; refuse(m)) {
        if (!(m->squares != NULL ? solve_within(m) : solve(m))) continue;
        lg_minimise_set_point(m, 1.0, m->d);
        m->counts.stage = LG_STAGE_SEARCH;
        m->numbers.slope = m->k->dot(m->n, m->g, m->d);
        const bool moves = memcmp(m->point, m->x, m->n * sizeof *m->x) != 0;
        if (moves && foretold(m) > ROUNDING * m->numbers.value) return;
        break;
    }
    const bool minimum = m->squares == NULL || at_minimum(m);
    if (!minimum)
        (void)lg_minimise_verify(m, LG_MINIMISE_STUCK);
    else if (m->squares == NULL || !isfinite(m->numbers.high_value))
        lg_minimise_finish(m, lg_minimise_no_step(m));
    else
        begin_last(m);
}

static void take(lg_minimiser *m, double value, const double *gradient, const double *matrix) {
    const arrow a = arrow_of(m);
    const double *C = matrix + a.p * a.p, *B = C + a.rest * a.p;
    const double keep = m->squares != NULL ? FORGET : 1.0;
    memcpy(m->x, m->point, m->n * sizeof *m->x);
    memcpy(m->g, gradient, m->n * sizeof *m->g);
    for (size_t i = 0; i < a.p; i++) {
        memcpy(a.P + i * a.stride, matrix + i * a.p, a.p * sizeof *matrix);
        a.D[i] = fmax(keep * a.D[i], matrix[i * a.p + i]);
    }
    for (size_t i = 0; i < a.rest; i++) {
        memcpy(a.C + i * a.stride, C + i * a.p, a.p * sizeof *C);
        a.D[a.p + i] = fmax(keep * a.D[a.p + i], B[i * a.block + i % a.block]);
    }
    if (a.rest > 0) memcpy(a.B, B, a.rest * a.block * sizeof *B);
    if (m->squares != NULL) {
        memcpy(m->squares->r, m->squares->trial_r, m->squares->rows * sizeof(double));
        memcpy(m->squares->columns, m->squares->trial_columns, m->n * m->squares->rows * sizeof(double));
    }
    m->numbers.value = value;
}

static void begin_damped(lg_minimiser *m) {
    m->newton = false;
    m->counts.failures = 0;
    m->numbers.damping = FIRST_DAMPING;
    m->numbers.growth = 2.0;
    m->numbers.high_value = 0.0;
    m->numbers.radius = length_of(m, m->x);
    if (!(m->numbers.radius > NEGLIGIBLE * sqrt(m->numbers.value))) m->numbers.radius = INFINITY;
    propose(m);
}

/* Whether the trial becomes the new point. If not, the next trial is chosen, or the run ends. newton_shows:
 * lg_minimise_newton_shows, along a Newton step. */
static bool accepts(lg_minimiser *m, double value, const double *gradient, bool finite, bool newton_shows) {
    if (m->last) {
        const bool good = finite && value <= m->numbers.value * (1.0 + LAST_RISE);
        if (!good) lg_minimise_finish(m, LG_MINIMISE_ROUNDING);
        return good;
    }
    if (m->newton) {
        const lg_search_verdict verdict = lg_minimise_search_tell(m, value, gradient, finite);
        if (verdict == LG_SEARCH_FAIL)
            lg_minimise_finish(m, newton_shows ? LG_MINIMISE_ROUNDING : LG_MINIMISE_STUCK);
        return verdict == LG_SEARCH_ACCEPT;
    }
    const double gain = finite ? (m->numbers.value - value) / foretold(m) : NAN;
    if (m->squares != NULL) set_radius(m, value, gain);
    if (!(gain > LEAST_GAIN)) {
        m->numbers.high_value = finite ? value : INFINITY;
        refuse(m);
        propose(m);
        return false;
    }
    m->counts.failures = 0;
    m->numbers.damping *= fmax(FASTEST_FALL, 1.0 - pow(2.0 * gain - 1.0, 3.0));
    m->numbers.growth = 2.0;
    m->numbers.high_value = 0.0;
    return true;
}

bool lg_minimiser_tell_squares(lg_minimiser *m, double value, const double *gradient, const double *matrix) {
    if (m->counts.stage == LG_STAGE_DONE || !m->row->squares) return false;
    const bool finite = isfinite(value) && m->k->all_finite(m->n, gradient) &&
                        m->k->all_finite(lg_minimise_matrix_length(m->n, &m->options), matrix);
    const bool start = m->counts.stage == LG_STAGE_START, shown = m->newton && lg_minimise_newton_shows(m);
    const double before = m->numbers.value;
    m->counts.evaluations++;
    if (m->counts.stage == LG_STAGE_HESSIAN) {
        lg_minimise_newton_tell(m, gradient);
        return false;
    }
    if (!start && !accepts(m, value, gradient, finite, shown)) return false;
    take(m, value, gradient, matrix);
    m->counts.iterations += !start;
    if (start) m->numbers.reference_value = m->numbers.start_value = value;
    if (start && !finite)
        lg_minimise_finish(m, LG_MINIMISE_NOT_FINITE);
    else if (!m->last && lg_minimise_flat(m))
        lg_minimise_finish(m, LG_MINIMISE_GRADIENT);
    else if (m->last || shown)
        lg_minimise_finish(m, LG_MINIMISE_ROUNDING);
    else if (m->newton && lg_minimise_newton_pays(m, before - value))
        (void)lg_minimise_verify(m, LG_MINIMISE_STUCK);
    else if (start || m->newton)
        begin_damped(m);
    else if (lg_minimise_tiny(m))
        lg_minimise_finish(m, LG_MINIMISE_ROUNDING);
    else if (lg_minimise_slow(m))
        lg_minimise_finish(m, LG_MINIMISE_SLOW);
    else if (m->squares != NULL && lg_minimise_creeps(m))
        (void)lg_minimise_verify(m, LG_MINIMISE_STUCK);
    else
        propose(m);
    return !start;
}

/* The Hessian of f overwrites the damped matrix (`schur`), which follows P; P is kept. */
static size_t before_hessian(const lg_minimiser *m) {
    const arrow a = sizes_of(m->n, &m->options);
    return a.p * a.stride;
}

const lg_minimise_row lg_minimise_lm = {.name = "lm",
                                        .dense = true,
                                        .squares = true,
                                        .slow = 20,
                                        .creep = 20,
                                        .before_hessian = before_hessian,
                                        .length = length};

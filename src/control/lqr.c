/* Linear quadratic regulators of models, and the zero-order hold. */
#include <math.h>
#include <string.h>

#include "liegrad/control.h"

#include "kernels/lapack.h"
#include "core/portions.h"
#include "kernels/matrix.h"
#include "model/internal.h"

/* ---- zero-order hold ---- */

enum { BLOCKS = 8 };

typedef struct hold {
    size_t rows; /* n + m */
    /* (rows, rows) each: M, M^2, M^4, M^6; numerator and denominator of the approximation; next and sum are
     * scratch. unit (rows): the scales of `balance`. */
    double *M, *M2, *M4, *M6, *over, *under, *next, *sum, *unit;
    int *pivots;
} hold;

static size_t plan_hold(hold *s, void *memory) {
    lg_portions from = {memory, 0};
    double **const square[BLOCKS] = {&s->M, &s->M2, &s->M4, &s->M6, &s->over, &s->under, &s->next, &s->sum};
    for (size_t i = 0; i < BLOCKS; i++) *square[i] = lg_portion(&from, s->rows * s->rows, sizeof(double));
    s->unit = lg_portion(&from, s->rows, sizeof(double));
    s->pivots = lg_portion(&from, s->rows, sizeof(int));
    return from.used;
}

static bool hold_fits(size_t n, size_t m) {
    return lg_riccati_work_size(n, m) > 0;
}

size_t lg_zero_order_hold_work_size(size_t n, size_t m) {
    hold s = {.rows = n + m};
    return hold_fits(n, m) ? plan_hold(&s, NULL) : 0;
}

static double largest_row(size_t n, const double *x) {
    double most = 0.0;
    for (size_t i = 0; i < n && !isnan(most); i++) {
        double sum = 0.0;
        for (size_t j = 0; j < n; j++) sum += fabs(x[i * n + j]);
        if (!(sum <= most)) most = sum;
    }
    return most;
}

/* The largest row sum of the power of (|M_ij|), computed by repeated products with a vector of ones. */
static double largest_row_of_power(const hold *s, int power) {
    const size_t n = s->rows;
    double *x = s->next, *y = x + n, most = 0.0;
    for (size_t i = 0; i < n; i++) x[i] = 1.0;
    for (int k = 0; k < power; k++) {
        most = 0.0;
        for (size_t i = 0; i < n; i++) {
            y[i] = 0.0;
            for (size_t j = 0; j < n; j++) y[i] += fabs(s->M[i * n + j]) * x[j];
            most = fmax(most, y[i]);
        }
        memcpy(x, y, n * sizeof *x);
    }
    return most;
}

/* The number k for which M / 2^k is small enough for Pade's approximation [13/13] (Al-Mohy & Higham, SIAM J.
 * Matrix Anal. Appl. 31 (2009), algorithm 5.1). It follows from norms of powers of M, which may be far
 * smaller than the powers of the norm of M. */
static int squarings_of(const hold *s) {
    static const double theta = 4.25, first_error = 8.8299e-36; /* 1/(C(26, 13) 27!) */
    const size_t n = s->rows;
    const double norm = largest_row(n, s->M);
    const double d6 = pow(largest_row(n, s->M6), 1.0 / 6.0);
    lg_matrix_multiply(n, n, n, s->M4, s->M4, s->next);
    const double d8 = pow(largest_row(n, s->next), 1.0 / 8.0);
    lg_matrix_multiply(n, n, n, s->M4, s->M6, s->next);
    const double d10 = pow(largest_row(n, s->next), 1.0 / 10.0);
    const double size = fmin(fmax(d6, d8), fmax(d8, d10));
    if (!(norm > 0.0) || !isfinite(norm) || !isfinite(size)) return 0;
    int squarings = size > theta ? (int)ceil(log2(size / theta)) : 0;
    /* Bound of the approximation's relative error, from the 27th power of the matrix of all |M_ij| / 2^k. */
    const double left = first_error * largest_row_of_power(s, 27) / norm;
    const double excess = isfinite(left) && left > 0.0 ? log2(left) - 26.0 * squarings + 53.0 : 0.0;
    if (excess > 0.0) squarings += (int)ceil(excess / 26.0);
    return squarings;
}

/* y = c2 M2 + c4 M4 + c6 M6 */
static void combine(const hold *s, double c2, double c4, double c6, double *y) {
    const size_t count = s->rows * s->rows;
    for (size_t i = 0; i < count; i++) y[i] = c2 * s->M2[i] + c4 * s->M4[i] + c6 * s->M6[i];
}

static void set_powers(hold *s, int halvings) {
    const size_t n = s->rows;
    for (size_t i = 0; i < n * n; i++) s->M[i] = ldexp(s->M[i], -halvings);
    lg_matrix_multiply(n, n, n, s->M, s->M, s->M2);
    lg_matrix_multiply(n, n, n, s->M2, s->M2, s->M4);
    lg_matrix_multiply(n, n, n, s->M2, s->M4, s->M6);
}

/* M <- exp(M): Pade's approximation of exp(M / 2^k), squared k times. LAPACK sees row-major matrices as their
 * transposes; that is no problem here, because numerator and denominator commute. */
static void exponential(hold *s) {
    double b[14] = {1.0}; /* (26 - k)! 13!/(26! k! (13 - k)!) */
    for (int k = 1; k < 14; k++) b[k] = b[k - 1] * (14 - k) / (k * (27 - k));
    const size_t n = s->rows;
    const int size = (int)n;
    const double norm = largest_row(n, s->M);
    /* Powers of a huge M would overflow, so M is made smaller before their norms are computed. */
    const int before = isfinite(norm) && norm > 0x1p80 ? (int)ceil(log2(norm)) - 80 : 0;
    int info;
    set_powers(s, before);
    const int rest = squarings_of(s), squarings = before + rest;
    if (rest > 0) set_powers(s, rest);
    combine(s, b[9], b[11], b[13], s->over); /* sum = the terms with odd powers of M */
    lg_matrix_multiply(n, n, n, s->M6, s->over, s->next);
    combine(s, b[3], b[5], b[7], s->over);
    for (size_t i = 0; i < n * n; i++) s->next[i] += s->over[i] + (i % (n + 1) == 0 ? b[1] : 0.0);
    lg_matrix_multiply(n, n, n, s->M, s->next, s->sum);
    combine(s, b[8], b[10], b[12], s->over); /* next + over = the terms with even powers */
    lg_matrix_multiply(n, n, n, s->M6, s->over, s->next);
    combine(s, b[2], b[4], b[6], s->over);
    for (size_t i = 0; i < n * n; i++) {
        const double even = s->next[i] + s->over[i] + (i % (n + 1) == 0 ? b[0] : 0.0);
        s->over[i] = even + s->sum[i];
        s->under[i] = even - s->sum[i];
    }
    dgetrf_(&size, &size, s->under, &size, s->pivots, &info);
    dgetrs_("N", &size, &size, s->under, &size, s->pivots, s->over, &size, &info);
    for (int k = 0; k < squarings; k++) {
        lg_matrix_multiply(n, n, n, s->over, s->over, s->next);
        memcpy(s->over, s->next, n * n * sizeof *s->next);
    }
    memcpy(s->M, s->over, n * n * sizeof *s->M);
}

/* M <- D^-1 M D, where the diagonal matrix D (s->unit) has powers of 2. Rows and columns of A become about
 * equally large. The largest number in each column of B becomes about as large as the norm of A, because the
 * column of the exponential grows with it. */
static void balance(hold *s, size_t n) {
    const size_t N = s->rows;
    const int size = (int)n;
    int low, high, info;
    double *A = s->next;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++) A[j * n + i] = fabs(s->M[i * N + j]);
    dgebal_("S", &size, A, &size, &low, &high, s->unit, &info);
    for (size_t i = 0; i < n && info != 0; i++) s->unit[i] = 1.0;
    const double a = largest_row(n, A); /* A is column-major: its largest column sum after balancing */
    for (size_t j = n; j < N; j++) {
        double b = 0.0;
        for (size_t i = 0; i < n; i++) b = fmax(b, fabs(s->M[i * N + j]) / s->unit[i]);
        s->unit[j] = a > 0.0 && b > 0.0 ? exp2(nearbyint(log2(a) - log2(b))) : 1.0;
    }
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < N; j++) s->M[i * N + j] *= s->unit[j] / s->unit[i];
}

lg_status lg_zero_order_hold(size_t n, size_t m, const double *A, const double *B, double h, double *Ad,
                             double *Bd, void *work, size_t bytes, lg_error *error) {
    hold s = {.rows = n + m};
    if (!hold_fits(n, m) || A == NULL || B == NULL || Ad == NULL || Bd == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "%zu states or %zu inputs are too few or too many, or a matrix is NULL", n, m);
    LG_TRY(lg_portions_check(work, bytes, lg_zero_order_hold_work_size(n, m), error));
    (void)plan_hold(&s, work);
    const size_t N = s.rows;
    const lg_kernels *k = lg_kernels_for(LG_F64);
    if (!isfinite(h) || !k->all_finite(n * n, A) || !k->all_finite(n * m, B))
        return lg_fail(error, LG_NOT_FINITE, "A, B or the time has a number that is not finite");
    memset(s.M, 0, N * N * sizeof *s.M);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) s.M[i * N + j] = h * A[i * n + j];
        for (size_t j = 0; j < m; j++) s.M[i * N + n + j] = h * B[i * m + j];
    }
    balance(&s, n);
    exponential(&s);
    if (!k->all_finite(N * N, s.M))
        return lg_fail(error, LG_NOT_FINITE, "the exponential over %g s is not finite", h);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) Ad[i * n + j] = s.M[i * N + j] * (s.unit[i] / s.unit[j]);
        for (size_t j = 0; j < m; j++) Bd[i * m + j] = s.M[i * N + n + j] * (s.unit[i] / s.unit[n + j]);
    }
    return LG_OK;
}

/* ---- regulators ---- */

void lg_lqr_options_init(lg_lqr_options *options) {
    *options = (lg_lqr_options){.size = sizeof *options, .most_drift = 1e-6};
}

typedef struct parts {
    double *state, *input, *A, *B, *P, *K, *eigenvalues, *c;
    void *work;  /* workspace of the model */
    void *solve; /* workspace of the Riccati solver and of the zero-order hold */
    size_t solve_bytes;
} parts;

static size_t plan_parts(const lg_model *model, parts *p, void *memory) {
    lg_portions from = {memory, 0};
    const size_t d = lg_model_inputs(model), m = lg_model_input_dim(model), r = lg_model_tangent_dim(model);
    const size_t riccati = lg_riccati_work_size(r, m), hold_bytes = lg_zero_order_hold_work_size(r, m);
    double **const at[] = {&p->state, &p->input, &p->A, &p->B, &p->P, &p->K, &p->eigenvalues, &p->c};
    const size_t counts[] = {d, m, r * r, r * m, r * r, m * r, 2 * r, r};
    for (size_t i = 0; i < LG_COUNT(at); i++) *at[i] = lg_portion(&from, counts[i], sizeof(double));
    p->solve_bytes = riccati > hold_bytes ? riccati : hold_bytes;
    p->work = lg_portion(&from, lg_model_work_size(model), 1);
    p->solve = lg_portion(&from, p->solve_bytes, 1);
    return riccati > 0 ? from.used : 0;
}

size_t lg_lqr_size(const lg_model *model) {
    parts p;
    return lg_model_moves(model) ? plan_parts(model, &p, NULL) : 0;
}

static lg_status linearise(const lg_model *model, const lg_lqr_options *options, const parts *p,
                           double *drift, lg_error *error) {
    const size_t r = lg_model_tangent_dim(model), m = lg_model_input_dim(model);
    memcpy(p->state, options->state, lg_model_inputs(model) * sizeof *p->state);
    memset(p->input, 0, m * sizeof *p->input);
    if (options->input != NULL) memcpy(p->input, options->input, m * sizeof *p->input);
    *drift = 0.0;
    lg_model_drift(model, p->state, p->input, p->c, p->work);
    for (size_t i = 0; i < r && !isnan(*drift); i++)
        if (!(fabs(p->c[i]) <= *drift)) *drift = fabs(p->c[i]);
    if (isnan(*drift)) return lg_fail(error, LG_NOT_FINITE, "the field at the state is not finite");
    if (*drift > options->most_drift)
        return lg_fail(error, LG_CHECK_FAILED,
                       "the state is not an equilibrium: a coordinate changes by %.3g per second, more than "
                       "most_drift; lg_model_equilibrium finds an equilibrium",
                       *drift);
    LG_TRY(lg_model_linearise(model, p->state, p->input, p->A, p->B, NULL, p->work));
    if (options->period == 0.0) return LG_OK;
    return lg_zero_order_hold(r, m, p->A, p->B, options->period, p->A, p->B, p->solve, p->solve_bytes, error);
}

lg_status lg_lqr_init(const lg_model *model, const lg_lqr_options *options, lg_lqr *out, void *memory,
                      size_t bytes, lg_error *error) {
    LG_NEEDS(error, model, options, out, memory);
    parts p;
    lg_riccati_result result;
    double drift;
    const size_t needed = lg_lqr_size(model), r = lg_model_tangent_dim(model), m = lg_model_input_dim(model);
    if (needed == 0) return lg_fail(error, LG_UNSUPPORTED, "the model has no inputs or no field");
    if (options->size != sizeof *options || options->state == NULL || !(options->period >= 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "the options' size is wrong, their state is NULL, or their period is negative");
    LG_TRY(lg_portions_check(memory, bytes, needed, error));
    (void)plan_parts(model, &p, memory);
    LG_TRY(linearise(model, options, &p, &drift, error));
    const lg_riccati equation = {sizeof equation, r, m, p.A, p.B, options->Q, options->R, options->S};
    LG_TRY((options->period > 0.0 ? lg_dare : lg_care)(&equation, p.P, p.K, p.eigenvalues, &result, p.solve,
                                                       p.solve_bytes, error));
    *out = (lg_lqr){model, r,   m,   options->period, drift,  p.state, p.input, p.A,
                    p.B,   p.P, p.K, p.eigenvalues,   result, p.c,     p.work};
    return LG_OK;
}

lg_status lg_lqr_control(const lg_lqr *lqr, const double *state, double *u) {
    LG_NEEDS(NULL, lqr, state, u);
    LG_TRY(lg_model_deviation(lqr->model, lqr->state, state, lqr->c, lqr->work));
    for (int writing = 0; writing < 2; writing++)
        for (size_t i = 0; i < lqr->m; i++) {
            double sum = lqr->input[i];
            for (size_t j = 0; j < lqr->r; j++) sum -= lqr->K[i * lqr->r + j] * lqr->c[j];
            if (!isfinite(sum)) return LG_NOT_FINITE;
            if (writing) u[i] = sum;
        }
    return LG_OK;
}

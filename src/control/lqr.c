/* Linear quadratic regulators of models, and the zero-order hold. */
#include <math.h>
#include <string.h>

#include "liegrad/control.h"

#include "kernels/lapack.h"
#include "core/portions.h"
#include "kernels/matrix.h"
#include "model/internal.h"

/* ---- zero-order hold ---- */

typedef struct hold {
    size_t rows;          /* n + m */
    double *M, *X, *next; /* (rows, rows) each; next is scratch */
    double *unit;         /* (rows): the scales of `balance` */
} hold;

static size_t plan_hold(hold *s, void *memory) {
    lg_portions from = {memory, 0};
    double **const square[] = {&s->M, &s->X, &s->next};
    for (size_t i = 0; i < LG_COUNT(square); i++)
        *square[i] = lg_portion(&from, s->rows * s->rows, sizeof(double));
    s->unit = lg_portion(&from, s->rows, sizeof(double));
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

static void add_to_diagonal(size_t n, double *x) {
    for (size_t i = 0; i < n; i++) x[i * (n + 1)] += 1.0;
}

/* X <- exp(M): Taylor's polynomial of exp(M/2^k) - 1, then k times X <- X X + 2 X, where small parts of M
 * keep their digits although a large part makes k large. Where all n states have decayed to less than a half,
 * 1 + X itself is squared. */
static void exponential(const hold *s, size_t n) {
    enum { TERMS = 13 };
    const size_t N = s->rows;
    const double norm = largest_row(N, s->M);
    const int squarings = isfinite(norm) && norm > 0.25 ? (int)ceil(log2(norm)) + 2 : 0;
    bool decayed = false;
    for (size_t i = 0; i < N * N; i++) s->M[i] = ldexp(s->M[i], -squarings), s->X[i] = 0.0;
    for (int k = TERMS; k > 0; k--) {
        lg_matrix_multiply(N, N, N, s->M, s->X, s->next);
        for (size_t i = 0; i < N * N; i++) s->X[i] = (s->M[i] + s->next[i]) / k;
    }
    for (int k = 0; k < squarings; k++) {
        double most = 0.0;
        for (size_t i = 0; i < n && !decayed; i++) most = fmax(most, fabs(1.0 + s->X[i * (N + 1)]));
        if (!decayed && most < 0.5) add_to_diagonal(N, s->X), decayed = true;
        lg_matrix_multiply(N, N, N, s->X, s->X, s->next);
        for (size_t i = 0; i < N * N; i++) s->X[i] = s->next[i] + (decayed ? 0.0 : 2.0 * s->X[i]);
    }
    if (!decayed) add_to_diagonal(N, s->X);
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
    exponential(&s, n);
    if (!k->all_finite(N * N, s.X))
        return lg_fail(error, LG_NOT_FINITE, "the exponential over %g s is not finite", h);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) Ad[i * n + j] = s.X[i * N + j] * (s.unit[i] / s.unit[j]);
        for (size_t j = 0; j < m; j++) Bd[i * m + j] = s.X[i * N + n + j] * (s.unit[i] / s.unit[n + j]);
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

/* Linear quadratic regulators of models, and the zero-order hold. */
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"
#include "models/control_internal.h"
#include "models/model_internal.h"

/* ---- zero-order hold ---- */

enum { PADE = 8, MOST_SQUARINGS = 1000 };

typedef struct hold {
    size_t rows; /* n + m */
    double *M, *power, *over, *under, *next;
    int *pivots;
} hold;

static size_t plan_hold(hold *s, void *memory) {
    lg_portions from = {memory, 0};
    double **const square[] = {&s->M, &s->power, &s->over, &s->under, &s->next};
    for (size_t i = 0; i < LG_COUNT(square); i++)
        *square[i] = lg_portion(&from, s->rows * s->rows, sizeof(double));
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
    for (size_t i = 0; i < n; i++) {
        double sum = 0.0;
        for (size_t j = 0; j < n; j++) sum += fabs(x[i * n + j]);
        if (!(sum <= most)) most = sum;
    }
    return most;
}

/* M <- exp(M): N(M / 2^k) / N(-M / 2^k), squared k times. The transposes that LAPACK sees commute alike. */
static void exponential(hold *s) {
    const size_t n = s->rows;
    const int size = (int)n;
    const double norm = largest_row(n, s->M);
    int squarings = 0, info;
    while (squarings < MOST_SQUARINGS && norm > exp2(squarings - 1)) squarings++;
    for (size_t i = 0; i < n * n; i++) {
        s->M[i] *= exp2(-squarings);
        s->over[i] = s->under[i] = s->power[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
    }
    double c = 1.0;
    for (int k = 1; k <= PADE; k++) {
        c *= (double)(PADE - k + 1) / (double)(k * (2 * PADE - k + 1));
        lg_matrix_multiply(n, n, n, s->M, s->power, s->next);
        memcpy(s->power, s->next, n * n * sizeof *s->next);
        lg_matrix_add(n * n, c, s->power, s->over);
        lg_matrix_add(n * n, k % 2 == 0 ? c : -c, s->power, s->under);
    }
    dgetrf_(&size, &size, s->under, &size, s->pivots, &info);
    dgetrs_("N", &size, &size, s->under, &size, s->pivots, s->over, &size, &info);
    for (int k = 0; k < squarings; k++) {
        lg_matrix_multiply(n, n, n, s->over, s->over, s->next);
        memcpy(s->over, s->next, n * n * sizeof *s->next);
    }
    memcpy(s->M, s->over, n * n * sizeof *s->M);
}

/* A power of 2 that makes B at most as large as A: B grows with it, and exp's columns of u likewise. */
static double input_unit(size_t n, size_t m, const double *A, const double *B) {
    const double a = lg_matrix_norm(n * n, A), b = lg_matrix_norm(n * m, B);
    return a > 0.0 && b > 0.0 ? exp2(nearbyint(log2(a / b))) : 1.0;
}

lg_status lg_zero_order_hold(size_t n, size_t m, const double *A, const double *B, double h, double *Ad,
                             double *Bd, void *work, size_t bytes, lg_error *error) {
    hold s = {.rows = n + m};
    if (!hold_fits(n, m) || A == NULL || B == NULL || Ad == NULL || Bd == NULL)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu states, %zu inputs, or a matrix is missing", n, m);
    LG_TRY(lg_portions_check(work, bytes, lg_zero_order_hold_work_size(n, m), error));
    (void)plan_hold(&s, work);
    const size_t N = s.rows;
    const double unit = input_unit(n, m, A, B);
    const lg_kernels *k = lg_kernels_for(LG_F64);
    if (!isfinite(h) || !k->all_finite(n * n, A) || !k->all_finite(n * m, B))
        return lg_fail(error, LG_NOT_FINITE, "a number of A, B or the time is not finite");
    memset(s.M, 0, N * N * sizeof *s.M);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) s.M[i * N + j] = h * A[i * n + j];
        for (size_t j = 0; j < m; j++) s.M[i * N + n + j] = h * unit * B[i * m + j];
    }
    exponential(&s);
    if (!k->all_finite(N * N, s.M))
        return lg_fail(error, LG_NOT_FINITE, "the exponential over %g s is not finite", h);
    for (size_t i = 0; i < n; i++) {
        memcpy(Ad + i * n, s.M + i * N, n * sizeof *Ad);
        for (size_t j = 0; j < m; j++) Bd[i * m + j] = s.M[i * N + n + j] / unit;
    }
    return LG_OK;
}

/* ---- regulators ---- */

void lg_lqr_options_init(lg_lqr_options *options) {
    *options = (lg_lqr_options){.size = sizeof *options, .most_drift = 1e-6};
}

typedef struct parts {
    double *state, *input, *A, *B, *P, *K, *eigenvalues, *c;
    void *work;  /* of the model */
    void *solve; /* of the Riccati solver and the hold */
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
    for (size_t i = 0; i < r; i++)
        if (!(fabs(p->c[i]) <= *drift)) *drift = fabs(p->c[i]);
    if (isnan(*drift)) return lg_fail(error, LG_NOT_FINITE, "the field at the state is not finite");
    if (*drift > options->most_drift)
        return lg_fail(error, LG_CHECK_FAILED,
                       "the state is no equilibrium: a coordinate changes by %.3g a second (most_drift; "
                       "lg_model_equilibrium finds one)",
                       *drift);
    LG_TRY(lg_model_linearise(model, p->state, p->input, p->A, p->B, NULL, p->work));
    if (options->period == 0.0) return LG_OK;
    return lg_zero_order_hold(r, m, p->A, p->B, options->period, p->A, p->B, p->solve, p->solve_bytes, error);
}

lg_status lg_lqr_init(const lg_model *model, const lg_lqr_options *options, lg_lqr *out, void *memory,
                      size_t bytes, lg_error *error) {
    parts p;
    lg_riccati_result result;
    double drift;
    const size_t needed = lg_lqr_size(model), r = lg_model_tangent_dim(model), m = lg_model_input_dim(model);
    if (needed == 0) return lg_fail(error, LG_UNSUPPORTED, "the model has no inputs or does not move");
    if (options == NULL || options->size != sizeof *options || out == NULL || options->state == NULL ||
        !(options->period >= 0.0))
        return lg_fail(error, LG_INVALID_ARGUMENT, "options, state or result are missing, or period < 0");
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

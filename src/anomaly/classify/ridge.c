/* Ridge regression on classes, with the penalty chosen by leave-one-out.
 *
 * With X (n, d) and the targets Y (n, t) of mean 0 in each column, the weights are W = X^T (X X^T + a)^-1 Y =
 * (X^T X + a)^-1 X^T Y. The smaller of the two matrices is factored, A = L L^T. The residual of a row that is
 * left out, with the intercept fitted again, is its residual divided by 1 - 1/n - h, where h is the diagonal
 * of X (X^T X + a)^-1 X^T. With C = (X X^T + a)^-1 Y and g = diag (X X^T + a)^-1, residual and divisor are
 * a C and a g - 1/n. g is the sum of squares of the columns of L^-1. */
#include "anomaly/classify/classify_internal.h"

#include <cblas.h>
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"

enum { PENALTIES = 10, FIRST_STRIDE = 3 };

typedef struct ridge {
    const lg_context *context;
    size_t n, d, targets, order; /* order: of the matrix that is factored, the smaller of n and d */
    double *x;                   /* (n, d), centred in place */
    double *x_mean, *y_mean;     /* (d), (targets) */
    double *y;                   /* (targets, n) centred */
    double *gram, *factor;       /* (order, order): X X^T or X^T X; only the upper triangles, row-major */
    double *c;                   /* (targets, order) */
    double *rest;                /* (targets, n) residuals */
    double *h;                   /* (n): divisors of the residuals */
    double *rows;                /* (n, d) for n > d: rows of X L^-T */
} ridge;

/* ---- centring ---- */

static void centre_columns(double *x, size_t n, size_t d, double *mean) {
    memset(mean, 0, d * sizeof *mean);
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < d; j++) mean[j] += x[i * d + j] / (double)n;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < d; j++) x[i * d + j] -= mean[j];
}

/* Targets: 1 for the class, else -1. Two classes have one target, of class 1. */
static void set_targets(ridge *r, const uint32_t *label) {
    for (size_t t = 0; t < r->targets; t++) {
        const uint32_t class = r->targets == 1 ? 1 : (uint32_t)t;
        double *y = r->y + t * r->n, sum = 0;
        for (size_t i = 0; i < r->n; i++) sum += y[i] = label[i] == class ? 1 : -1;
        r->y_mean[t] = sum / (double)r->n;
        for (size_t i = 0; i < r->n; i++) y[i] -= r->y_mean[t];
    }
}

static void set_gram(const ridge *r) {
    const int n = (int)r->n, d = (int)r->d, order = (int)r->order;
    cblas_dsyrk(CblasRowMajor, CblasUpper, r->n <= r->d ? CblasNoTrans : CblasTrans, order,
                r->n <= r->d ? d : n, 1, r->x, d, 0, r->gram, order);
}

/* ---- one penalty ---- */

/* A row-major upper triangle is a column-major lower one. */
static bool factor(const ridge *r, double penalty) {
    const int order = (int)r->order;
    int info = 0;
    memcpy(r->factor, r->gram, r->order * r->order * sizeof *r->gram);
    for (size_t i = 0; i < r->order; i++) r->factor[i * (r->order + 1)] += penalty;
    dpotrf_("L", &order, r->factor, &order, &info);
    return info == 0;
}

/* Sets c = A^-1 Y, or A^-1 X^T Y, by target. */
static void solve(const ridge *r) {
    const int order = (int)r->order, targets = (int)r->targets, d = (int)r->d;
    int info = 0;
    if (r->n <= r->d)
        memcpy(r->c, r->y, r->targets * r->n * sizeof *r->c);
    else
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, targets, d, (int)r->n, 1, r->y, (int)r->n,
                    r->x, d, 0, r->c, d);
    dpotrs_("L", &order, &targets, r->factor, &order, r->c, &order, &info);
}

/* For n <= d: residuals a C, divisors a g - 1/n. The inverse of the factor overwrites it. */
static void leave_out_rows(const ridge *r, double penalty) {
    const int order = (int)r->order;
    int info = 0;
    for (size_t i = 0; i < r->targets * r->n; i++) r->rest[i] = penalty * r->c[i];
    dtrtri_("L", "N", &order, r->factor, &order, &info);
    for (size_t i = 0; i < r->n; i++) {
        const double *column = r->factor + i * r->n;
        r->h[i] = penalty * lg_dot(column + i, column + i, r->n - i) - 1 / (double)r->n;
    }
}

/* For n > d: residuals Y - X W, divisors 1 - 1/n - h. */
static void leave_out_features(const ridge *r) {
    const int n = (int)r->n, d = (int)r->d, targets = (int)r->targets;
    memcpy(r->rest, r->y, r->targets * r->n * sizeof *r->rest);
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, targets, n, d, -1, r->c, d, r->x, d, 1, r->rest, n);
    memcpy(r->rows, r->x, r->n * r->d * sizeof *r->rows);
    cblas_dtrsm(CblasRowMajor, CblasRight, CblasUpper, CblasNoTrans, CblasNonUnit, n, d, 1, r->factor, d,
                r->rows, d);
    for (size_t i = 0; i < r->n; i++)
        r->h[i] = 1 - 1 / (double)r->n - lg_dot(r->rows + i * r->d, r->rows + i * r->d, r->d);
}

/* Mean square of the residuals of rows that are left out; infinite if the matrix cannot be factored. */
static double error_of(const ridge *r, double penalty) {
    double sum = 0;
    if (!factor(r, penalty)) return INFINITY;
    solve(r);
    if (r->n <= r->d)
        leave_out_rows(r, penalty);
    else
        leave_out_features(r);
    for (size_t t = 0; t < r->targets; t++)
        for (size_t i = 0; i < r->n; i++) {
            const double e = r->rest[t * r->n + i] / r->h[i];
            sum += e * e;
        }
    sum /= (double)(r->n * r->targets);
    return isfinite(sum) ? sum : INFINITY;
}

/* ---- choice of the penalty ---- */

static double penalty_at(const ridge *r, int i) {
    return (double)r->n * pow(10, -3 + 6.0 * i / (PENALTIES - 1));
}

/* The error is smooth in the logarithm of the penalty: every third penalty is tried, then the neighbours of
 * the best one. */
static double choose(const ridge *r, double *best_error) {
    double error[PENALTIES];
    int best = 0;
    for (int i = 0; i < PENALTIES; i++) error[i] = NAN;
    for (int i = 0; i < PENALTIES; i += FIRST_STRIDE)
        if ((error[i] = error_of(r, penalty_at(r, i))) < error[best]) best = i;
    for (int centre = best, i = centre - FIRST_STRIDE + 1; i < centre + FIRST_STRIDE; i++)
        if (i >= 0 && i < PENALTIES && isnan(error[i]) &&
            (error[i] = error_of(r, penalty_at(r, i))) < error[best])
            best = i;
    *best_error = error[best];
    return penalty_at(r, best);
}

/* ---- the fit ---- */

static void set_weights(const ridge *r, lg_logistic *out) {
    const int n = (int)r->n, d = (int)r->d, targets = (int)r->targets;
    if (r->n <= r->d)
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, targets, d, n, 1, r->c, n, r->x, d, 0,
                    out->weight, d);
    else
        memcpy(out->weight, r->c, r->targets * r->d * sizeof *out->weight);
    for (size_t t = 0; t < r->targets; t++)
        out->intercept[t] = r->y_mean[t] - lg_dot(out->weight + t * r->d, r->x_mean, r->d);
}

static lg_status fit(ridge *r, const uint32_t *label, lg_logistic *out, lg_error *error) {
    double least;
    centre_columns(r->x, r->n, r->d, r->x_mean);
    set_targets(r, label);
    set_gram(r);
    out->penalty = choose(r, &least);
    if (!isfinite(least) || !factor(r, out->penalty))
        return lg_fail(error, LG_NO_CONVERGENCE, "no penalty gives weights that predict a row left out");
    solve(r);
    set_weights(r, out);
    return LG_OK;
}

static lg_status take_memory(ridge *r, lg_logistic *out, lg_error *error) {
    const size_t n = r->n, d = r->d, t = r->targets, square = r->order * r->order;
    const struct {
        double **to;
        size_t count;
    } rows[] = {{&r->x_mean, d},       {&r->y_mean, t},      {&r->y, t * n},
                {&r->gram, square},    {&r->factor, square}, {&r->c, t * r->order},
                {&r->rest, t * n},     {&r->h, n},           {&r->rows, n > d ? n * d : 1},
                {&out->weight, t * d}, {&out->intercept, t}};
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        if ((*rows[i].to = lg_alloc(r->context, rows[i].count, sizeof(double))) == NULL)
            return lg_fail(error, LG_OUT_OF_MEMORY,
                           "no memory for a ridge regression of %zu rows with %zu features", n, d);
    return LG_OK;
}

lg_status lg_ridge_fit(const lg_context *context, double *x, const uint32_t *label, size_t n, uint32_t d,
                       uint32_t classes, lg_logistic *out, lg_error *error) {
    LG_NEEDS(error, x, label, out);
    LG_TRY(lg_check_table(x, n, d, error));
    size_t *counts = lg_alloc(context, classes, sizeof *counts);
    if (counts == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %u classes", classes);
    lg_status status = lg_check_labels(label, n, classes, counts, error);
    lg_free(context, counts);
    LG_TRY(status);
    lg_logistic made = {.inputs = d, .classes = classes, .context = context};
    ridge r = {.context = context, .n = n, .d = d, .targets = classes == 2 ? 1 : classes, .x = x};
    r.order = n < d ? n : d;
    status = take_memory(&r, &made, error);
    if (status == LG_OK) status = fit(&r, label, &made, error);
    double *const own[] = {r.x_mean, r.y_mean, r.y, r.gram, r.factor, r.c, r.rest, r.h, r.rows};
    for (size_t i = 0; i < LG_COUNT(own); i++) lg_free(context, own[i]);
    if (status == LG_OK)
        *out = made;
    else
        lg_logistic_destroy(&made);
    return status;
}

void lg_ridge_predict(const lg_logistic *model, const double *x, size_t n, double *score) {
    for (size_t i = 0; i < n; i++) {
        double *row = score + i * model->classes;
        lg_logistic_scores(model, x + i * model->inputs, row);
        if (model->classes > 2) continue;
        row[1] = row[0];
        row[0] = -row[1];
    }
}

/* Logistic regression by Newton's method (Nelder and Wedderburn 1972; Boyd and Vandenberghe, "Convex
 * Optimization", 9.5: damped steps, Newton decrement).
 *
 * The rows of the table are centred and get a last column of ones, so they have q = d + 1 numbers. This does
 * not change the problem, because the intercept is not penalised. theta is (rows, q); its last column holds
 * the intercepts. If d >= n, the centred table is factored, x^T = Q R, and the columns of R take the place of
 * the rows (q = n + 1). This is possible because the minimiser has the form w = Q v, with |w| = |v|. */
#include "anomaly/classify/classify_internal.h"

#include <cblas.h>
#include <limits.h>
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"

#define MAX_ITERATIONS 200
#define MAX_HALVINGS   60
/* Newton's method stops when the squared Newton decrement is at most this fraction of the objective. It still
 * takes the step for which the decrement was computed, which squares the error once more. */
#define TOLERANCE 1e-13
/* Largest number of conjugate gradient iterations per Newton step. */
#define MAX_CG 2000
/* A factorisation takes about as long as FACTOR_COST q (1 + q/(3 n))/rows products with the Hessian. It is
 * made after that many products. The count begins at START instead of 0, so that short tables are factored at
 * once. */
#define FACTOR_COST (1.0 / 16.0)
#define START       8.0
/* Tolerance of conjugate gradients in the last Newton steps, as a fraction of the decrease of the quadratic
 * model. */
#define EXACT 1e-9
/* A product with the Hessian passes twice over the table. It does so in blocks of about this many doubles, so
 * that the second pass finds the block in the cache. */
#define BLOCK_DOUBLES 32768
/* Intercept of a class that does not occur in training. The other intercepts and weights add up to 0, so the
 * probability of this class is 0. */
#define UNSEEN (-1e4)

typedef struct problem {
    const lg_context *context;
    size_t n, q, unknowns;
    uint32_t rows, classes;
    double c;
    double *x;       /* (n, q): table, centred, with a last column of ones */
    uint32_t *label; /* (n): label, counted among the classes that occur */
    double *theta, *trial, *step, *gradient;
    double *score;    /* (n, rows) */
    double *residual; /* (n, rows): p - y, probability minus target */
    double *weight;   /* (n, rows): p (1 - p) if rows == 1, otherwise p */
    double *scaled;   /* (n, q): rows times the root of their curvature; allocated with `factor` */
    /* (q, q): Cholesky factor of the preconditioner of conjugate gradients. NULL until factoring pays off. */
    double *factor;
    double *diagonal; /* (q): diagonal preconditioner, used until there is a factor */
    double *vectors;  /* (4, unknowns): vectors of conjugate gradients */
    double objective, forcing;
    double worth; /* number of Hessian products that take as long as a factorisation */
    double spent; /* number of Hessian products since the last factorisation */
    bool solved;  /* whether the last step meets the tolerance `forcing` */
} problem;

/* ---- the objective ---- */

/* Loss of two classes with one logit. Small probabilities are computed without cancellation. */
static double binary_loss(problem *p) {
    double loss = 0.0;
    for (size_t i = 0; i < p->n; i++) {
        const double s = p->score[i], e = exp(-fabs(s)), small = e / (1.0 + e), large = 1.0 / (1.0 + e);
        /* Whether the more probable class is the true one. */
        const bool right = (s >= 0.0) == (p->label[i] == 1);
        const double miss = right ? small : large; /* probability of the wrong class */
        p->residual[i] = p->label[i] == 1 ? -miss : miss;
        p->weight[i] = small * large;
        loss += log1p(e) + (right ? 0.0 : fabs(s));
    }
    return loss;
}

static double softmax_loss(problem *p) {
    double loss = 0.0;
    const size_t k = p->rows;
    for (size_t i = 0; i < p->n; i++) {
        const double *s = p->score + i * k;
        double *w = p->weight + i * k, *r = p->residual + i * k, largest = s[0], sum = 0.0, others = 0.0;
        const uint32_t truth = p->label[i];
        for (size_t a = 1; a < k; a++) largest = fmax(largest, s[a]);
        for (size_t a = 0; a < k; a++) {
            w[a] = exp(s[a] - largest);
            sum += w[a];
            if (a != truth) others += w[a];
        }
        loss += others < 0.5 * w[truth] ? log1p(others / w[truth]) : largest - s[truth] + log(sum);
        for (size_t a = 0; a < k; a++) r[a] = w[a] /= sum;
        r[truth] = -others / sum;
    }
    return loss;
}

/* score = x theta^T for the rows first .. last - 1 of the table. */
static void scores(const problem *p, size_t first, size_t last, const double *theta) {
    const int n = (int)(last - first), q = (int)p->q, rows = (int)p->rows;
    const double *x = p->x + first * p->q;
    double *out = p->score + first * p->rows;
    if (rows == 1)
        cblas_dgemv(CblasRowMajor, CblasNoTrans, n, q, 1.0, x, q, theta, 1, 0.0, out, 1);
    else
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, rows, q, 1.0, x, q, theta, q, 0.0, out, rows);
}

/* Returns the objective at `theta`, and sets p->residual and p->weight for this theta. */
static double evaluate(problem *p, const double *theta) {
    scores(p, 0, p->n, theta);
    double square = 0.0;
    for (size_t a = 0; a < p->rows; a++) square += lg_dot(theta + a * p->q, theta + a * p->q, p->q - 1);
    return p->c * (p->rows == 1 ? binary_loss(p) : softmax_loss(p)) + 0.5 * square;
}

/* out (rows, q) += factor r^T x, summed over the rows first .. last - 1 of the table. */
static void add_transposed(const problem *p, size_t first, size_t last, double factor, const double *r,
                           double *out) {
    const int n = (int)(last - first), q = (int)p->q, rows = (int)p->rows;
    const double *x = p->x + first * p->q;
    r += first * p->rows;
    if (rows == 1)
        cblas_dgemv(CblasRowMajor, CblasTrans, n, q, factor, x, q, r, 1, 1.0, out, 1);
    else
        cblas_dgemm(CblasRowMajor, CblasTrans, CblasNoTrans, rows, q, n, factor, r, rows, x, q, 1.0, out, q);
}

static void add_penalty(const problem *p, const double *v, double *out) {
    for (size_t a = 0; a < p->rows; a++)
        for (size_t j = 0; j + 1 < p->q; j++) out[a * p->q + j] += v[a * p->q + j];
}

/* ---- the Newton step by conjugate gradients ---- */

/* The Hessian is sum_i C (diag(p_i) - p_i p_i^T) (x) x_i x_i^T plus the penalty, where (x) is the Kronecker
 * product. The preconditioner replaces the factor diag(p_i) - p_i p_i^T by one number for all classes, sum_c
 * p_c (1 - p_c)/(K - 1). Steps add up to 0 over the classes, and on such vectors the factor is exactly this
 * number (1/K) when all K probabilities are equal. With one row of theta the preconditioner is the Hessian
 * itself. This function returns C times the number for row i. */
static double curvature(const problem *p, size_t i) {
    const size_t k = p->rows;
    const double *w = p->weight + i * k;
    if (k == 1) return p->c * w[0];
    double sum = 0.0;
    for (size_t a = 0; a < k; a++) sum += w[a] * (1.0 - w[a]);
    return p->c * sum / (double)(k - 1);
}

/* Forms the preconditioner in p->factor, as a row-major upper triangle. `ridge` times the largest diagonal
 * entry is added to the diagonal. */
static void form(const problem *p, double ridge) {
    const size_t q = p->q;
    double largest = 0.0;
    for (size_t i = 0; i < p->n; i++) {
        const double factor = sqrt(curvature(p, i));
        for (size_t j = 0; j < q; j++) p->scaled[i * q + j] = factor * p->x[i * q + j];
    }
    cblas_dsyrk(CblasRowMajor, CblasUpper, CblasTrans, (int)q, (int)p->n, 1.0, p->scaled, (int)q, 0.0,
                p->factor, (int)q);
    for (size_t j = 0; j < q; j++) {
        p->factor[j * q + j] += j + 1 < q ? 1.0 : 0x1p-1000;
        largest = fmax(largest, p->factor[j * q + j]);
    }
    for (size_t j = 0; j < q; j++) p->factor[j * q + j] += ridge * largest;
}

static lg_status make_factor(problem *p) {
    if (p->factor == NULL) {
        LG_TRY(LG_ALLOC_ALL(p->context, LG_ARRAY(p->factor, p->q * p->q), LG_ARRAY(p->scaled, p->n * p->q)));
    }
    const int q = (int)p->q;
    double ridge = 0.0;
    p->spent = 0.0;
    for (int attempt = 0; attempt < 8; attempt++) {
        int info = 0;
        form(p, ridge);
        dpotrf_("L", &q, p->factor, &q, &info); /* LAPACK's lower triangle is the row-major upper triangle */
        if (info == 0) return LG_OK;
        ridge = ridge == 0.0 ? 1e-14 : 100.0 * ridge;
    }
    return LG_NO_CONVERGENCE;
}

static void make_diagonal(problem *p) {
    const size_t q = p->q;
    memset(p->diagonal, 0, q * sizeof *p->diagonal);
    for (size_t i = 0; i < p->n; i++) {
        const double *x = p->x + i * q, factor = curvature(p, i);
        for (size_t j = 0; j < q; j++) p->diagonal[j] += factor * x[j] * x[j];
    }
    for (size_t j = 0; j < q; j++) p->diagonal[j] += j + 1 < q ? 1.0 : 0x1p-1000;
}

/* out = P^-1 r, where P is the preconditioner. */
static void precondition(const problem *p, const double *r, double *out) {
    const int q = (int)p->q, rows = (int)p->rows;
    int info = 0;
    for (size_t i = 0; i < p->unknowns; i++) out[i] = p->factor != NULL ? r[i] : r[i] / p->diagonal[i % p->q];
    if (p->factor != NULL) dpotrs_("L", &q, &rows, p->factor, &q, out, &q, &info);
}

/* Replaces each row s of p->score by (diag(w) - w w^T) s; for two classes by w s. */
static void curve(const problem *p, size_t first, size_t last) {
    const size_t k = p->rows;
    for (size_t i = first; i < last; i++) {
        const double *w = p->weight + i * k;
        double *s = p->score + i * k;
        if (k == 1) {
            s[0] *= w[0];
            continue;
        }
        const double mean = lg_dot(w, s, k);
        for (size_t a = 0; a < k; a++) s[a] = w[a] * (s[a] - mean);
    }
}

/* out = H v, where H is the Hessian at the current theta. */
static void hessian_product(problem *p, const double *v, double *out) {
    const size_t q = p->q, block = BLOCK_DOUBLES / q + 1;
    memset(out, 0, p->unknowns * sizeof *out);
    for (size_t first = 0; first < p->n; first += block) {
        const size_t last = p->n - first < block ? p->n : first + block;
        scores(p, first, last, v);
        curve(p, first, last);
        add_transposed(p, first, last, p->c, p->score, out);
    }
    add_penalty(p, v, out);
    p->spent += 1.0;
}

/* Minimiser, gradients and steps add up to 0 over the classes. This function subtracts the part of v that
 * rounding has added to the sum. Without it, errors would grow in that direction: the Hessian is 0 there for
 * the intercepts, so the preconditioner is far from it. */
static void balance(const problem *p, double *v) {
    for (size_t j = 0; j < p->q && p->rows > 1; j++) {
        double sum = 0.0;
        for (size_t a = 0; a < p->rows; a++) sum += v[a * p->q + j];
        for (size_t a = 0; a < p->rows; a++) v[a * p->q + j] -= sum / (double)p->rows;
    }
}

/* Solves for the Newton step. The tolerance `forcing` follows from the decrement of the previous step (Dembo,
 * Eisenstat, Steihaug 1982). Without a factor the iteration stops after as many products as a factorisation
 * would cost. */
static lg_status conjugate_gradients(problem *p) {
    const size_t n = p->unknowns;
    const double limit = p->factor == NULL ? p->worth + 1.0 : MAX_CG;
    double *r = p->vectors, *z = r + n, *direction = z + n, *image = direction + n;
    memset(p->step, 0, n * sizeof *p->step);
    for (size_t i = 0; i < n; i++) r[i] = -p->gradient[i];
    balance(p, r);
    precondition(p, r, direction);
    double rho = lg_dot(r, direction, n);
    /* Decrease of the quadratic model: in total, and by the last direction. */
    double fallen = 0.0, last = 1.0;
    size_t iteration = 0;
    for (; rho > 0.0 && (double)(iteration + 1) * last > p->forcing * fallen; iteration++) {
        p->solved = p->factor != NULL;
        if ((double)iteration >= limit) return LG_OK;
        if (lg_cancelled(p->context)) return LG_CANCELLED;
        hessian_product(p, direction, image);
        const double alpha = rho / lg_dot(direction, image, n);
        if (!isfinite(alpha)) break;
        last = alpha * rho;
        fallen += last;
        cblas_daxpy((int)n, alpha, direction, 1, p->step, 1);
        cblas_daxpy((int)n, -alpha, image, 1, r, 1);
        const double before = rho;
        balance(p, r);
        precondition(p, r, z);
        rho = lg_dot(r, z, n);
        for (size_t i = 0; i < n; i++) direction[i] = z[i] + rho / before * direction[i];
    }
    p->solved = true;
    return LG_OK;
}

/* Computes the Newton step. When the products since the last factorisation have taken as long as a
 * factorisation, a new factor is made. With one row of theta the new factor solves the equations directly;
 * otherwise it serves as preconditioner. */
static lg_status find_step(problem *p) {
    if (p->spent < p->worth) {
        if (p->factor == NULL) make_diagonal(p);
        return conjugate_gradients(p);
    }
    LG_TRY(make_factor(p));
    if (p->rows > 1) return conjugate_gradients(p);
    for (size_t i = 0; i < p->unknowns; i++) p->vectors[i] = -p->gradient[i];
    precondition(p, p->vectors, p->step);
    p->spent = 1.0;
    p->solved = true;
    p->forcing = EXACT;
    return LG_OK;
}

/* ---- Newton's method ---- */

/* Halves the step until the objective decreases enough. A decrease too small to be seen in spite of rounding
 * is accepted. */
static lg_status backtrack(problem *p, double decrement) {
    const double slack = 0x1p-48 * p->objective;
    double length = 1.0;
    for (int i = 0; i < MAX_HALVINGS; i++, length *= 0.5) {
        for (size_t j = 0; j < p->unknowns; j++) p->trial[j] = p->theta[j] + length * p->step[j];
        const double value = evaluate(p, p->trial);
        if (!(value <= p->objective - 1e-4 * length * decrement + slack)) continue;
        double *swap = p->theta;
        p->theta = p->trial;
        p->trial = swap;
        p->objective = value;
        return LG_OK;
    }
    return LG_NO_CONVERGENCE;
}

static lg_status newton(problem *p, uint32_t *iterations) {
    p->objective = evaluate(p, p->theta);
    if (!isfinite(p->objective)) return LG_NOT_FINITE;
    for (uint32_t i = 1; i <= MAX_ITERATIONS; i++) {
        if (lg_cancelled(p->context)) return LG_CANCELLED;
        *iterations = i;
        memset(p->gradient, 0, p->unknowns * sizeof *p->gradient);
        add_transposed(p, 0, p->n, p->c, p->residual, p->gradient);
        add_penalty(p, p->theta, p->gradient);
        LG_TRY(find_step(p));
        const double decrement = -lg_dot(p->gradient, p->step, p->unknowns);
        if (!isfinite(decrement)) return LG_NOT_FINITE;
        if (decrement <= 0.0) return LG_OK; /* theta is at the minimum up to rounding */
        const bool exact = p->solved && p->forcing <= EXACT;
        p->forcing = fmin(1e-2, fmax(EXACT, decrement / p->objective));
        const lg_status moved = backtrack(p, decrement);
        if (exact && decrement <= TOLERANCE * p->objective) return LG_OK;
        if (moved != LG_OK) return decrement <= 1e-10 * p->objective ? LG_OK : moved;
    }
    return LG_NO_CONVERGENCE;
}

/* ---- fitting ---- */

/* Householder form of x^T = Q R by LAPACK. The row-major table (n, d) is a column-major matrix (d, n). */
typedef struct span {
    double *qr, *tau, *work;
    int lwork;
} span;

static void span_free(const lg_context *context, span *s) {
    LG_FREE_ALL(context, s->qr, s->tau, s->work);
}

static lg_status take_span(const lg_context *context, const double *x, const double *mean, size_t n, size_t d,
                           span *s, double *out) {
    s->lwork = 64 * (int)n;
    LG_TRY(LG_ALLOC_ALL(context, LG_ARRAY(s->qr, n * d), LG_ARRAY(s->tau, n),
                        LG_ARRAY(s->work, (size_t)s->lwork)));
    const int rows = (int)d, columns = (int)n;
    int info = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < d; j++) s->qr[i * d + j] = x[i * d + j] - mean[j];
    dgeqrf_(&rows, &columns, s->qr, &rows, s->tau, s->work, &s->lwork, &info);
    for (size_t i = 0; i < n; i++) {
        memset(out + i * (n + 1), 0, n * sizeof *out);
        memcpy(out + i * (n + 1), s->qr + i * d, (i + 1) * sizeof *out);
        out[i * (n + 1) + n] = 1.0;
    }
    return info == 0 ? LG_OK : LG_NO_CONVERGENCE;
}

/* Computes w = Q v in place. On entry w (d) holds v (n) followed by zeros. */
static void leave_span(const span *s, size_t n, size_t d, double *w) {
    const int rows = (int)d, one = 1, reflections = (int)n;
    int info = 0;
    dormqr_("L", "N", &rows, &one, &reflections, s->qr, &rows, s->tau, w, &rows, s->work, &s->lwork, &info);
}

static void centre_rows(const double *x, const double *mean, size_t n, size_t d, double *out) {
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < d; j++) out[i * (d + 1) + j] = x[i * d + j] - mean[j];
        out[i * (d + 1) + d] = 1.0;
    }
}

static lg_status problem_allocate(problem *p) {
    const size_t scores = p->n * p->rows;
    return LG_ALLOC_ALL(
        p->context, LG_ARRAY(p->x, p->n * p->q), LG_ARRAY(p->label, p->n), LG_ARRAY(p->theta, p->unknowns),
        LG_ARRAY(p->trial, p->unknowns), LG_ARRAY(p->step, p->unknowns), LG_ARRAY(p->gradient, p->unknowns),
        LG_ARRAY(p->score, scores), LG_ARRAY(p->residual, scores), LG_ARRAY(p->weight, scores),
        LG_ARRAY(p->diagonal, p->q), LG_ARRAY(p->vectors, 4 * p->unknowns));
}

static void problem_free(problem *p) {
    LG_FREE_ALL(p->context, p->x, p->label, p->theta, p->trial, p->step, p->gradient, p->score, p->residual,
                p->weight, p->scaled, p->factor, p->diagonal, p->vectors);
}

/* Writes weights and intercepts of the model from theta. theta has rows only for the classes that occur, and
 * refers to the centred table (and to v instead of w if the table was factored); the model refers to the
 * original features. */
static void write_model(const problem *p, const size_t *counts, const double *mean, const span *s,
                        lg_logistic *model) {
    const size_t d = model->inputs, rows = p->classes == 2 ? 1 : p->classes;
    size_t from = 0;
    for (size_t a = 0; a < rows; a++) {
        double *w = model->weight + a * d;
        if (rows > 1 && counts[a] == 0) {
            model->intercept[a] = UNSEEN;
            continue;
        }
        const double *theta = p->theta + from++ * p->q;
        memcpy(w, theta, (p->q - 1) * sizeof *w);
        if (s->qr != NULL) leave_span(s, p->n, d, w);
        model->intercept[a] = theta[p->q - 1] - lg_dot(w, mean, d);
    }
}

static lg_status solve(problem *p, const double *x, const uint32_t *label, const size_t *counts, double *mean,
                       span *s, lg_logistic *model) {
    const size_t d = model->inputs;
    LG_TRY(problem_allocate(p));
    lg_column_means(x, p->n, d, mean);
    if (d >= p->n)
        LG_TRY(take_span(p->context, x, mean, p->n, d, s, p->x));
    else
        centre_rows(x, mean, p->n, d, p->x);
    for (size_t i = 0; i < p->n; i++) {
        for (uint32_t c = 0; c < label[i]; c++) p->label[i] += counts[c] > 0;
    }
    LG_TRY(newton(p, &model->iterations));
    balance(p, p->theta);
    write_model(p, counts, mean, s, model);
    const size_t rows = model->classes == 2 ? 1 : model->classes;
    for (size_t i = 0; i < rows * d; i++)
        if (!isfinite(model->weight[i])) return LG_NOT_FINITE;
    return LG_OK;
}

static lg_status fit_model(const lg_context *context, const double *x, const uint32_t *label, size_t n,
                           double c, size_t *counts, lg_logistic *model, lg_error *error) {
    const uint32_t d = model->inputs, classes = model->classes, rows = classes == 2 ? 1 : classes;
    LG_TRY(lg_check_labels(label, n, classes, 2, counts, error));
    problem p = {
        .context = context, .n = n, .q = (d >= n ? n : d) + 1, .classes = classes, .c = c, .forcing = 1e-2};
    for (uint32_t a = 0; a < classes; a++) p.rows += counts[a] > 0;
    if (classes == 2) p.rows = 1;
    p.unknowns = p.rows * p.q;
    p.worth = FACTOR_COST * (double)p.q * (1.0 + (double)p.q / (3.0 * (double)n)) / (double)p.rows;
    p.spent = START;
    if (p.unknowns > INT_MAX / 2)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%u classes with %u features are too many", classes, d);
    span s = {0};
    LG_SCRATCH(double, mean, context, d);
    lg_status status = mean == NULL ? LG_OUT_OF_MEMORY
                                    : LG_ALLOC_ALL(context, LG_ARRAY(model->weight, (size_t)rows * d),
                                                   LG_ARRAY(model->intercept, rows));
    if (status == LG_OK) status = solve(&p, x, label, counts, mean, &s, model);
    problem_free(&p);
    span_free(context, &s);
    if (status == LG_OK) return LG_OK;
    return lg_fail(error, status, "logistic regression of %zu rows and %u features, C = %g: %s", n, d, c,
                   lg_status_sentence(status));
}

lg_status lg_logistic_fit(const lg_context *context, const double *x, const uint32_t *label, size_t n,
                          uint32_t d, uint32_t classes, double c, lg_logistic *out, lg_error *error) {
    LG_NEEDS(error, label, out);
    LG_TRY(lg_check_c(c, classes, error));
    LG_TRY(lg_check_table(x, n, d, error));
    LG_TRY_SCRATCH(size_t, counts, context, classes,
                   lg_fail(error, LG_OUT_OF_MEMORY, "no memory for %u classes", classes));
    LG_CLEAN(lg_logistic_destroy)
    lg_logistic model = {.inputs = d, .classes = classes, .context = context};
    LG_TRY(fit_model(context, x, label, n, c, counts, &model, error));
    return LG_GIVE(out, model);
}

void lg_logistic_destroy(lg_logistic *model) {
    if (model == NULL) return;
    LG_FREE_ALL(model->context, model->weight, model->intercept);
    *model = (lg_logistic){0};
}

/* Ridge regression on classes, with the penalty chosen by leave-one-out.
 *
 * With X (n, d) and the targets Y (n, t) of mean 0 in each column, the weights are W = X^T (X X^T + a)^-1 Y =
 * (X^T X + a)^-1 X^T Y. One of the two matrices is factored, A = U^T U. The residual of a row that is
 * left out, with the intercept fitted again, is its residual divided by 1 - 1/n - h, where h is the diagonal
 * of X (X^T X + a)^-1 X^T. With C = (X X^T + a)^-1 Y and g = diag (X X^T + a)^-1, residual and divisor are
 * a C and a g - 1/n. g is the sum of squares of the rows of U^-1.
 *
 * Threads share tiles or blocks of a fixed size, so that the result has the same bits for any number of
 * threads. */
#include "anomaly/classify/classify_internal.h"

#include <cblas.h>
#include <math.h>
#include <string.h>

#include "kernels/lapack.h"

enum {
    PENALTIES = 10,
    FIRST_STRIDE = 3,
    TILE = 256, /* rows and columns of a tile of a matrix */
    WIDTH = 64, /* rows of U^-1, or of X U^-1, that are computed at a time */
    MANY = 256, /* rows from which the choice of the penalty begins with a part of the rows */
    PART = 5    /* that part: every fifth row */
};

typedef struct ridge {
    const lg_context *context;
    lg_thread_pool *pool;
    size_t n, d, targets, order; /* order: of the matrix that is factored, n or d */
    size_t parts;                /* tasks that have scratch memory */
    double *x;                   /* (n, d), centred in place */
    double *x_mean, *y_mean;     /* (d), (targets) */
    double *y;                   /* (targets, n) centred */
    double *gram, *factor;       /* (order, order): X X^T or X^T X; only the upper triangles, row-major */
    double *c, *best;            /* (targets, order), and for the best penalty until now */
    double *rest;                /* (targets, n) residuals */
    double *h;                   /* (n): divisors of the residuals */
    double *scratch;             /* (parts, WIDTH, order) */
} ridge;

static size_t smaller(size_t a, size_t b) {
    return a < b ? a : b;
}

/* Whether X X^T is factored. For a penalty this takes 2/3 n^3 operations, X^T X takes n d^2 + d^3/3. */
static bool by_rows(const ridge *r) {
    return 10 * r->n <= 14 * r->d;
}

/* Number of rows from which the choice of the penalty begins; 0: it begins with all rows. */
static size_t few_rows(const ridge *r) {
    const size_t few = (r->n + PART - 1) / PART;
    return r->n >= MANY && few <= r->d ? few : 0;
}

/* ---- centring ---- */

static void centre_columns(double *x, size_t n, size_t d, double *mean) {
    lg_column_means(x, n, d, mean);
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

/* ---- tiles of the upper triangle ---- */

typedef struct tiling {
    const ridge *r;
    size_t first, count; /* tiles first..count-1 in each direction */
} tiling;

static size_t tiles_of(size_t order) {
    return (order + TILE - 1) / TILE;
}

static int edge(const ridge *r, size_t tile) {
    return (int)smaller(TILE, r->order - tile * TILE);
}

static size_t triangle(const tiling *t) {
    const size_t side = t->count - t->first;
    return side * (side + 1) / 2;
}

/* Row i and column j of a tile, which are numbered row by row. */
static void place(const tiling *t, size_t number, size_t *i, size_t *j) {
    size_t row = t->first, in_row = t->count - t->first;
    while (number >= in_row) number -= in_row--, row++;
    *i = row;
    *j = row + number;
}

static void gram_tile(void *user, size_t number) {
    const tiling *t = user;
    const ridge *r = t->r;
    const int d = (int)r->d;
    size_t i, j;
    place(t, number, &i, &j);
    const bool rows = by_rows(r);
    const double *a = r->x + i * TILE * (rows ? r->d : 1), *b = r->x + j * TILE * (rows ? r->d : 1);
    cblas_dgemm(CblasRowMajor, rows ? CblasNoTrans : CblasTrans, rows ? CblasTrans : CblasNoTrans, edge(r, i),
                edge(r, j), rows ? d : (int)r->n, 1, a, d, b, d, 0, r->gram + i * TILE * r->order + j * TILE,
                (int)r->order);
}

static void set_gram(const ridge *r) {
    tiling t = {r, 0, tiles_of(r->order)};
    lg_thread_pool_run(r->pool, triangle(&t), gram_tile, &t);
}

/* ---- Cholesky factor ---- */

/* Row `first` - 1 of tiles: U_kj = U_kk^-T A_kj. */
static void solve_tile(void *user, size_t number) {
    const tiling *t = user;
    const ridge *r = t->r;
    const size_t k = t->first - 1, j = t->first + number;
    double *row = r->factor + k * TILE * r->order;
    cblas_dtrsm(CblasRowMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, TILE, edge(r, j), 1,
                row + k * TILE, (int)r->order, row + j * TILE, (int)r->order);
}

/* A_ij -= U_ki^T U_kj, for the row k of tiles above `first`. */
static void update_tile(void *user, size_t number) {
    const tiling *t = user;
    const ridge *r = t->r;
    const int order = (int)r->order;
    const double *row = r->factor + (t->first - 1) * TILE * r->order;
    size_t i, j;
    place(t, number, &i, &j);
    cblas_dgemm(CblasRowMajor, CblasTrans, CblasNoTrans, edge(r, i), edge(r, j), TILE, -1, row + i * TILE,
                order, row + j * TILE, order, 1, r->factor + i * TILE * r->order + j * TILE, order);
}

/* A row-major upper triangle is a column-major lower one. Returns whether the matrix is positive definite. */
static bool factor(const ridge *r, double penalty) {
    const int order = (int)r->order;
    memcpy(r->factor, r->gram, r->order * r->order * sizeof *r->gram);
    for (size_t i = 0; i < r->order; i++) r->factor[i * (r->order + 1)] += penalty;
    for (size_t k = 0; k < tiles_of(r->order); k++) {
        const int size = edge(r, k);
        int info = 0;
        dpotrf_("L", &size, r->factor + k * TILE * (r->order + 1), &order, &info);
        if (info != 0) return false;
        tiling t = {r, k + 1, tiles_of(r->order)};
        lg_thread_pool_run(r->pool, t.count - t.first, solve_tile, &t);
        lg_thread_pool_run(r->pool, triangle(&t), update_tile, &t);
    }
    return true;
}

/* Sets c = A^-1 Y, or A^-1 X^T Y, by target. */
static void solve(const ridge *r) {
    const int order = (int)r->order, targets = (int)r->targets, d = (int)r->d;
    int info = 0;
    if (by_rows(r))
        memcpy(r->c, r->y, r->targets * r->n * sizeof *r->c);
    else
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, targets, d, (int)r->n, 1, r->y, (int)r->n,
                    r->x, d, 0, r->c, d);
    dpotrs_("L", &order, &targets, r->factor, &order, r->c, &order, &info);
}

/* ---- residuals of rows that are left out ---- */

typedef struct leaving {
    const ridge *r;
    double penalty;
} leaving;

/* By rows: divisors a g - 1/n. Rows `begin` and later of U^-1 are 0 before their column. */
static void divide_rows(const leaving *l, size_t begin, size_t count, double *row) {
    const ridge *r = l->r;
    const size_t left = r->order - begin;
    memset(row, 0, count * left * sizeof *row);
    for (size_t i = 0; i < count; i++) row[i * left + i] = 1;
    cblas_dtrsm(CblasRowMajor, CblasRight, CblasUpper, CblasNoTrans, CblasNonUnit, (int)count, (int)left, 1,
                r->factor + begin * (r->order + 1), (int)r->order, row, (int)left);
    for (size_t i = 0; i < count; i++, row += left)
        r->h[begin + i] = l->penalty * lg_dot(row, row, left) - 1 / (double)r->n;
}

/* By features: divisors 1 - 1/n - h, from the rows of X U^-1. */
static void divide_features(const leaving *l, size_t begin, size_t count, double *row) {
    const ridge *r = l->r;
    const size_t d = r->d;
    memcpy(row, r->x + begin * d, count * d * sizeof *row);
    cblas_dtrsm(CblasRowMajor, CblasRight, CblasUpper, CblasNoTrans, CblasNonUnit, (int)count, (int)d, 1,
                r->factor, (int)d, row, (int)d);
    for (size_t i = 0; i < count; i++, row += d) r->h[begin + i] = 1 - 1 / (double)r->n - lg_dot(row, row, d);
}

static void divide_part(void *user, size_t part) {
    const leaving *l = user;
    const ridge *r = l->r;
    double *row = r->scratch + part * WIDTH * r->order;
    for (size_t begin = part * WIDTH; begin < r->n; begin += r->parts * WIDTH)
        (by_rows(r) ? divide_rows : divide_features)(l, begin, smaller(WIDTH, r->n - begin), row);
}

/* Residuals: a C, or Y - X W. */
static void set_residuals(const ridge *r, double penalty) {
    const int n = (int)r->n, d = (int)r->d, targets = (int)r->targets;
    if (by_rows(r)) {
        for (size_t i = 0; i < r->targets * r->n; i++) r->rest[i] = penalty * r->c[i];
        return;
    }
    memcpy(r->rest, r->y, r->targets * r->n * sizeof *r->rest);
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, targets, n, d, -1, r->c, d, r->x, d, 1, r->rest, n);
}

/* Mean square of the residuals of rows that are left out; infinite if the matrix cannot be factored. */
static double error_of(const ridge *r, double penalty) {
    double sum = 0;
    leaving l = {r, penalty};
    if (!factor(r, penalty)) return INFINITY;
    solve(r);
    set_residuals(r, penalty);
    lg_thread_pool_run(r->pool, r->parts, divide_part, &l);
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

typedef struct search {
    double error[PENALTIES]; /* NAN: not tried */
    int best;                /* -1: none tried */
} search;

/* Tries penalty number i, if there is such a penalty and it was not tried. */
static void try_penalty(const ridge *r, int i, search *s) {
    if (i < 0 || i >= PENALTIES || !isnan(s->error[i])) return;
    s->error[i] = error_of(r, penalty_at(r, i));
    if (s->best >= 0 && !(s->error[i] < s->error[s->best])) return;
    s->best = i;
    memcpy(r->best, r->c, r->targets * r->order * sizeof *r->c);
}

static search begin_search(void) {
    search s = {.best = -1};
    for (int i = 0; i < PENALTIES; i++) s.error[i] = NAN;
    return s;
}

/* The error is smooth in the logarithm of the penalty: every third penalty is tried, then the neighbours of
 * the best one. */
static search try_strides(const ridge *r) {
    search s = begin_search();
    for (int i = 0; i < PENALTIES; i += FIRST_STRIDE) try_penalty(r, i, &s);
    for (int centre = s.best, i = centre - FIRST_STRIDE + 1; i < centre + FIRST_STRIDE; i++)
        try_penalty(r, i, &s);
    return s;
}

/* Takes the means of rows and columns off a symmetric matrix (n, n), of which the upper triangle is stored.
 * means (n) is written. */
static void centre_gram(size_t n, double *gram, double *means) {
    double mean = 0;
    memset(means, 0, n * sizeof *means);
    for (size_t i = 0; i < n; i++)
        for (size_t j = i; j < n; j++) {
            means[i] += gram[i * n + j] / (double)n;
            if (j > i) means[j] += gram[i * n + j] / (double)n;
        }
    for (size_t i = 0; i < n; i++) mean += means[i] / (double)n;
    for (size_t i = 0; i < n; i++)
        for (size_t j = i; j < n; j++) gram[i * n + j] -= means[i] + means[j] - mean;
}

/* The penalty that suits every fifth row. */
static int guess(const ridge *r) {
    ridge few = *r;
    few.n = few.order = few_rows(r);
    few.gram = r->best + r->targets * r->order;
    few.factor = few.gram + few.order * few.order;
    few.y = few.factor + few.order * few.order;
    cblas_dsyrk(CblasRowMajor, CblasUpper, CblasNoTrans, (int)few.n, (int)r->d, 1, r->x, PART * (int)r->d, 0,
                few.gram, (int)few.n);
    centre_gram(few.n, few.gram, few.h);
    for (size_t t = 0; t < r->targets; t++) {
        double *y = few.y + t * few.n, mean = 0;
        for (size_t i = 0; i < few.n; i++) mean += (y[i] = r->y[t * r->n + PART * i]) / (double)few.n;
        for (size_t i = 0; i < few.n; i++) y[i] -= mean;
    }
    return try_strides(&few).best;
}

/* From the guess on, the error is followed downhill. */
static search descend(const ridge *r, int from) {
    search s = begin_search();
    for (int before = -1; before != from; from = s.best) {
        before = from;
        for (int i = from - 1; i <= from + 1; i++) try_penalty(r, i, &s);
    }
    return s;
}

/* Sets r->best and returns the penalty. */
static double choose(const ridge *r, double *error) {
    const search s = few_rows(r) > 0 ? descend(r, guess(r)) : try_strides(r);
    *error = s.error[s.best];
    return penalty_at(r, s.best);
}

/* ---- the fit ---- */

static void set_weights(const ridge *r, lg_logistic *out) {
    const int n = (int)r->n, d = (int)r->d, targets = (int)r->targets;
    if (by_rows(r))
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, targets, d, n, 1, r->best, n, r->x, d, 0,
                    out->weight, d);
    else
        memcpy(out->weight, r->best, r->targets * r->d * sizeof *out->weight);
    for (size_t t = 0; t < r->targets; t++)
        out->intercept[t] = r->y_mean[t] - lg_dot(out->weight + t * r->d, r->x_mean, r->d);
}

static lg_status fit(ridge *r, const uint32_t *label, lg_logistic *out, lg_error *error) {
    double least;
    centre_columns(r->x, r->n, r->d, r->x_mean);
    set_targets(r, label);
    set_gram(r);
    out->penalty = choose(r, &least);
    if (!isfinite(least))
        return lg_fail(error, LG_NO_CONVERGENCE, "no penalty gives weights that predict a row left out");
    set_weights(r, out);
    return LG_OK;
}

/* Behind `best` lie gram, factor and targets of the part of the rows. */
static size_t best_doubles(const ridge *r) {
    const size_t few = few_rows(r);
    return r->targets * r->order + 2 * few * few + r->targets * few;
}

static lg_status take_memory(ridge *r, lg_logistic *out, lg_error *error) {
    const size_t n = r->n, d = r->d, t = r->targets, square = r->order * r->order;
    if (LG_ALLOC_ALL(r->context, LG_ARRAY(r->x_mean, d), LG_ARRAY(r->y_mean, t), LG_ARRAY(r->y, t * n),
                     LG_ARRAY(r->gram, square), LG_ARRAY(r->factor, square), LG_ARRAY(r->c, t * r->order),
                     LG_ARRAY(r->best, best_doubles(r)), LG_ARRAY(r->rest, t * n), LG_ARRAY(r->h, n),
                     LG_ARRAY(r->scratch, r->parts * WIDTH * r->order), LG_ARRAY(out->weight, t * d),
                     LG_ARRAY(out->intercept, t)) == LG_OK)
        return LG_OK;
    return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for a ridge regression of %zu rows with %zu features",
                   n, d);
}

lg_status lg_ridge_fit(const lg_context *context, double *x, const uint32_t *label, size_t n, uint32_t d,
                       uint32_t classes, int threads, lg_logistic *out, lg_error *error) {
    LG_NEEDS(error, x, label, out);
    if (threads < 1)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%d threads: at least one is needed", threads);
    LG_TRY(lg_check_table(x, n, d, error));
    LG_TRY(lg_check_labels(label, n, classes, 2, NULL, error));
    LG_CLEAN(lg_logistic_destroy)
    lg_logistic made = {.inputs = d, .classes = classes, .context = context};
    ridge r = {.context = context, .n = n, .d = d, .targets = classes == 2 ? 1 : classes, .x = x};
    r.order = by_rows(&r) ? n : d;
    r.parts = smaller((size_t)threads, (n + WIDTH - 1) / WIDTH);
    lg_status status = lg_thread_pool_create(context, (int)r.parts, &r.pool);
    if (status != LG_OK) return lg_fail(error, status, "no memory for a pool of %zu threads", r.parts);
    status = take_memory(&r, &made, error);
    if (status == LG_OK) status = fit(&r, label, &made, error);
    LG_FREE_ALL(context, r.x_mean, r.y_mean, r.y, r.gram, r.factor, r.c, r.best, r.rest, r.h, r.scratch);
    lg_thread_pool_destroy(r.pool);
    LG_TRY(status);
    return LG_GIVE(out, made);
}

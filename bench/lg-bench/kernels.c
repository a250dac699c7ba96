/* The building blocks of all other cases: gemm, act, node. */
#include <cblas.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "kernels/kernels.h"
#include "lg-bench/bench.h"
#include "liegrad/ops.h"

/* ---- gemm ---- */

typedef enum layout { NN, NT, TN } layout;
static const char *const layout_names[] = {"nn", "nt", "tn"};

/* C (m, n) = op(A) op(B), summed over k. */
typedef struct shape {
    layout layout;
    size_t m, n, k;
} shape;

static const shape shapes[] = {
    {NN, 3, 3, 3},      {NN, 50, 100, 100},   {NN, 500, 100, 100}, {NN, 1500, 100, 100}, {NN, 80, 100, 3},
    {NN, 32, 879, 879}, {NN, 4096, 190, 190}, {NT, 50, 100, 100},  {NT, 500, 100, 100},  {NT, 32, 879, 879},
    {TN, 100, 100, 50}, {TN, 100, 100, 500},  {TN, 879, 879, 32},  {NN, 1, 100, 100},    {NT, 1, 100, 100},
    {NN, 128, 20, 20},  {NT, 128, 20, 20},    {TN, 20, 20, 128},   {NN, 128, 20, 3},     {NT, 128, 3, 20},
};

typedef struct gemm {
    shape s;
    lg_dtype dtype;
    const lg_kernels *k;
    void *a, *b, *c, *scratch;
    lg_tape *tape;
    lg_mark mark;
    lg_var va, vb;
} gemm;

/* For nt, B^T is made in every call, as for a single product. */
static void own_call(void *user) {
    const gemm *g = user;
    const void *b = g->b;
    if (g->s.layout == NT) {
        g->k->transpose(g->s.n, g->s.k, g->b, g->scratch);
        b = g->scratch;
    }
    g->k->gemm(g->s.m, g->s.n, g->s.k, g->a, g->s.layout == TN ? 1 : g->s.k, g->s.layout == TN ? g->s.m : 1,
               b, g->s.n, g->c, g->s.n, false);
}

static void blas_call(void *user) {
    const gemm *g = user;
    const CBLAS_TRANSPOSE ta = g->s.layout == TN ? CblasTrans : CblasNoTrans;
    const CBLAS_TRANSPOSE tb = g->s.layout == NT ? CblasTrans : CblasNoTrans;
    const int m = (int)g->s.m, n = (int)g->s.n, k = (int)g->s.k;
    const int lda = g->s.layout == TN ? m : k, ldb = g->s.layout == NT ? k : n;
    if (g->dtype == LG_F64)
        cblas_dgemm(CblasRowMajor, ta, tb, m, n, k, 1, g->a, lda, g->b, ldb, 0, g->c, n);
    else
        cblas_sgemm(CblasRowMajor, ta, tb, m, n, k, 1, g->a, lda, g->b, ldb, 0, g->c, n);
}

static void tape_call(void *user) {
    static lg_var (*const operations[])(lg_tape *, lg_var, lg_var) = {lg_matmul, lg_matmul_nt, lg_matmul_tn};
    gemm *g = user;
    (void)lg_tape_rewind(g->tape, g->mark);
    const lg_var c = operations[g->s.layout](g->tape, g->va, g->vb);
    g->c = (void *)(uintptr_t)lg_value(g->tape, c);
}

/* Returns max |c - r| / sum |a| |b|. In this measure a sum of n products is wrong by at most n ULP. Only the
 * first 50 rows are checked. */
static double gemm_error(const gemm *g) {
    const shape s = g->s;
    double *a = bench_doubles(g->dtype, g->a, s.m * s.k), *b = bench_doubles(g->dtype, g->b, s.k * s.n);
    double *c = bench_doubles(g->dtype, g->c, s.m * s.n), error = 0;
    const size_t rows = s.m < 50 ? s.m : 50;
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < s.n; j++) {
            long double sum = 0, size = 0;
            for (size_t l = 0; l < s.k; l++) {
                const long double x = s.layout == TN ? a[l * s.m + i] : a[i * s.k + l];
                const long double y = s.layout == NT ? b[j * s.k + l] : b[l * s.n + j];
                sum += x * y;
                size += fabsl(x * y);
            }
            const double e = (double)(fabsl((long double)c[i * s.n + j] - sum) / size);
            if (!(e <= error)) error = e;
        }
    free(a);
    free(b);
    free(c);
    return error;
}

static void gemm_row(bench *b, gemm *g, const char *how, void (*call)(void *user)) {
    char name[64];
    void *const own = g->c;
    (void)snprintf(name, sizeof name, "%zux%zux%zu %s %s", g->s.m, g->s.n, g->s.k, layout_names[g->s.layout],
                   how);
    bench_row *row = bench_measure(b, name, call, g);
    if (row != NULL) {
        call(g);
        row->rate = 2e-3 * (double)(g->s.m * g->s.n * g->s.k) / row->median_us;
        row->unit = "GF/s";
        row->error = gemm_error(g);
        row->error_is = "max |c - r| / sum |a| |b|, r in long double";
    }
    g->c = own;
}

void bench_gemm(bench *b) {
    for (size_t i = 0; i < LG_COUNT(shapes); i++) {
        const shape s = shapes[i];
        gemm g = {.s = s, .dtype = b->dtype, .k = lg_kernels_for(b->dtype)};
        double *x = bench_uniform(s.m * s.k, 1), *y = bench_uniform(s.k * s.n, 2);
        g.a = bench_typed(b->dtype, x, s.m * s.k);
        g.b = bench_typed(b->dtype, y, s.k * s.n);
        g.c = app_alloc(s.m * s.n, bench_size(b->dtype));
        g.scratch = app_alloc(s.k * s.n, bench_size(b->dtype));
        g.tape = bench_tape(b, b->dtype, b->threads);
        g.va = lg_parameter(g.tape,
                            s.layout == TN ? lg_shape2((uint32_t)s.k, (uint32_t)s.m)
                                           : lg_shape2((uint32_t)s.m, (uint32_t)s.k),
                            g.a);
        g.vb = lg_parameter(g.tape,
                            s.layout == NT ? lg_shape2((uint32_t)s.n, (uint32_t)s.k)
                                           : lg_shape2((uint32_t)s.k, (uint32_t)s.n),
                            g.b);
        g.mark = lg_tape_mark(g.tape);
        gemm_row(b, &g, "own", own_call);
        gemm_row(b, &g, "blas", blas_call);
        gemm_row(b, &g, "tape", tape_call);
        bench_check_tape(b, g.tape);
        lg_tape_destroy(g.tape);
        void *const arrays[] = {x, y, g.a, g.b, g.c, g.scratch};
        for (size_t k = 0; k < LG_COUNT(arrays); k++) free(arrays[k]);
    }
}

/* ---- act ---- */

static long double sigmoidl(long double x) {
    return 1 / (1 + expl(-x));
}
static long double tanh1l(long double x) {
    const long double t = coshl(x);
    return 1 / (t * t);
}
static long double swishl(long double x) {
    return x * sigmoidl(x);
}
static long double relul(long double x) {
    return x > 0 ? x : 0;
}

typedef struct elementwise {
    const char *name;
    /* Exactly one of `act` (an lg_k_act) and `unary` (an lg_k_unary) is set, the other is -1. order: order of
     * the derivative of `act`. */
    int act, unary, order;
    double low, high;
    long double (*reference)(long double x);
} elementwise;

static const elementwise functions[] = {
    {"tanh", LG_K_TANH, -1, 0, -4, 4, tanhl},          {"tanh'", LG_K_TANH, -1, 1, -4, 4, tanh1l},
    {"sigmoid", LG_K_SIGMOID, -1, 0, -8, 8, sigmoidl}, {"swish", LG_K_SWISH, -1, 0, -8, 8, swishl},
    {"relu", LG_K_RELU, -1, 0, -4, 4, relul},          {"exp", -1, LG_K_EXP, 0, -10, 10, expl},
    {"log", -1, LG_K_LOG, 0, 0.01, 10, logl},          {"sin", -1, LG_K_SIN, 0, -10, 10, sinl},
    {"cos", -1, LG_K_COS, 0, -10, 10, cosl},           {"sqrt", -1, LG_K_SQRT, 0, 0, 10, sqrtl},
};

typedef struct act {
    const elementwise *f;
    const lg_kernels *k;
    size_t n;
    void *x, *h, *y; /* h: stored tanh of x, from which its derivatives are computed. */
} act;

static void act_call(void *user) {
    const act *a = user;
    if (a->f->act >= 0)
        a->k->act((lg_k_act)a->f->act, a->f->order, a->n, a->x, a->f->order > 0 ? a->h : NULL, NULL, a->y);
    else
        a->k->unary[a->f->unary](a->n, 0, a->x, a->y);
}

/* Returns the largest |y - r| in ULP of r. For derivatives in ULP of 1, because their tails are differences
 * of numbers close to 1. */
static double ulp_error(const bench *b, const act *a) {
    double *x = bench_doubles(b->dtype, a->x, a->n), *y = bench_doubles(b->dtype, a->y, a->n), error = 0;
    const int digits = b->dtype == LG_F64 ? DBL_MANT_DIG : FLT_MANT_DIG;
    for (size_t i = 0; i < a->n; i++) {
        const long double r = a->f->reference(x[i]);
        int exponent;
        (void)frexpl(r, &exponent);
        if (r == 0 || a->f->order > 0) exponent = 1;
        const double e = (double)ldexpl(fabsl(y[i] - r), digits - exponent);
        if (!(e <= error)) error = e;
    }
    free(x);
    free(y);
    return error;
}

void bench_act(bench *b) {
    const size_t n = (size_t)b->given->width;
    for (size_t i = 0; i < LG_COUNT(functions); i++) {
        const elementwise *f = &functions[i];
        act a = {.f = f, .k = lg_kernels_for(b->dtype), .n = n};
        double *x = bench_uniform(n, 1);
        for (size_t j = 0; j < n; j++) x[j] = f->low + (x[j] + 1) / 2 * (f->high - f->low);
        a.x = bench_typed(b->dtype, x, n);
        a.h = app_alloc(n, bench_size(b->dtype));
        a.y = app_alloc(n, bench_size(b->dtype));
        a.k->act(LG_K_TANH, 0, n, a.x, NULL, NULL, a.h);
        bench_row *row = bench_measure(b, f->name, act_call, &a);
        if (row != NULL) {
            act_call(&a);
            row->width = n;
            row->rate = 1e3 * row->median_us / (double)n;
            row->unit = "ns an element";
            row->error = ulp_error(b, &a);
            row->error_is = f->order > 0 ? "ULP of 1" : "ULP";
        }
        free(x);
        free(a.x);
        free(a.h);
        free(a.y);
    }
}

/* ---- node ---- */

typedef struct node {
    lg_tape *tape;
    size_t n;
    double one, gradient;
    float one32, gradient32;
} node;

static lg_var chain(node *c, lg_var *x) {
    const bool doubles = lg_tape_dtype(c->tape) == LG_F64;
    lg_tape_reset(c->tape);
    *x = lg_input(c->tape, lg_shape0(), doubles ? (const void *)&c->one : &c->one32);
    lg_var y = *x;
    for (size_t i = 0; i < c->n; i++) y = lg_add(c->tape, y, *x);
    return y;
}

static void record_call(void *user) {
    lg_var x;
    (void)chain(user, &x);
}

static void both_call(void *user) {
    node *c = user;
    lg_var x;
    const lg_var y = chain(c, &x);
    void *gradient = lg_tape_dtype(c->tape) == LG_F64 ? (void *)&c->gradient : &c->gradient32;
    (void)lg_backward_set(c->tape, y, &x, 1, &gradient);
}

void bench_node(bench *b) {
    static const struct {
        const char *name;
        void (*call)(void *user);
    } table[] = {{"record", record_call}, {"record and backward", both_call}};
    node c = {.tape = bench_tape(b, b->dtype, 1), .n = (size_t)b->given->width, .one = 1, .one32 = 1};
    for (size_t i = 0; i < LG_COUNT(table); i++) {
        bench_row *row = bench_measure(b, table[i].name, table[i].call, &c);
        if (row == NULL) continue;
        bench_check_tape(b, c.tape);
        row->width = c.n;
        row->rate = 1e3 * row->median_us / (double)c.n;
        row->unit = "ns a node";
        if (i == 0) continue;
        const double found = b->dtype == LG_F64 ? c.gradient : (double)c.gradient32;
        row->error = fabs(found - (double)(c.n + 1)) / (double)(c.n + 1);
        row->error_is = "relative, against the number of additions";
    }
    lg_tape_destroy(c.tape);
}

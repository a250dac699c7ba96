/* Deviations from means and covariances, which are derivatives of each other; the symmetric root S of a
 * covariance C, and the equation S X + X S = W that its derivatives solve: with the cotangent W of S, X is
 * the cotangent of C, and dS is the X of W = dC. The C of all computes the library's values, too, in double
 * precision. attr.i[0] = number of parts. */
#include "autodiff/ops/covariance.h"

#include <float.h>
#include <math.h>

#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/tape/tape_internal.h"

#define real         double
#define REAL(number) number
#define REAL_EPSILON DBL_EPSILON
#define SQRT         sqrt
#define FABS         fabs
#define RESTRICT     restrict
#define NOINLINE
#include "autodiff/program/code/dot.c"

#include "autodiff/ops/code/factor_rows.c"
#include "autodiff/ops/code/mean_of.c"
#include "autodiff/ops/code/rotate_rows.c"

#include "autodiff/ops/code/centre.c"
#include "autodiff/ops/code/covariance.c"
#include "autodiff/ops/code/covariance_root.c"
#include "autodiff/ops/code/lyapunov.c"

/* ---- a batch of matrices ---- */

/* Whether x is a batch of matrices that the C can compute with. */
static bool has_rows(const lg_shape *x) {
    return x->rank == 3 && x->dims[2] > 0 && (uint64_t)x->dims[1] * x->dims[2] <= INT32_MAX / 2;
}

/* Whether batches of a and b rows meet, and the rows of the result. */
static bool meet(uint32_t a, uint32_t b, uint32_t *rows) {
    *rows = a == 1 ? b : a;
    return a == b || a == 1 || b == 1;
}

static lg_row_use broadcast(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape,
                            uint32_t copies, lg_attr *attr) {
    return LG_ROWS_BROADCAST;
}

static size_t terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return in[0]->dims[2];
}

static size_t scratch(const lg_evaluation *e) {
    return (3 * (size_t)BLOCK + lg_batch_doubles(e)) * sizeof(double);
}

/* a (B, m, k) with row i times s[i] (m) */
static lg_var times_rows(lg_tape *tape, lg_var a, lg_var s) {
    return lg_mul(tape, a, lg_reshape(tape, s, lg_shape2(lg_var_shape(tape, s).dims[0], 1)));
}

/* ---- deviations from means; the projection is its own adjoint ---- */

static lg_status centre_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    const lg_shape *x = in[0], *s = in[1];
    if (!has_rows(x) || s->rank != 3 || s->dims[1] != x->dims[1] || s->dims[2] == 0 ||
        s->dims[2] > x->dims[2])
        return LG_SHAPE;
    *out = *x;
    return meet(x->dims[0], s->dims[0], out->dims) ? LG_OK : LG_SHAPE;
}

static void centre_row(const lg_evaluation *e, const double *const *x, double *y, double *work) {
    const uint32_t *d = e->shape->dims;
    centre((int)d[1], (int)d[2], (int)e->in[1]->dims[2], x[0], x[1], y, work);
}

LG_BATCH_FORWARD(centre)

static void centre_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *d = e->shape->dims;
    lg_batch_c(c, e, BLOCK, "centre(%u, %u, %u", d[1], d[2], e->in[1]->dims[2]);
}

static void centre_vjp(lg_reverse *r) {
    const lg_shape x = lg_var_shape(r->tape, r->in[0]), s = lg_var_shape(r->tape, r->in[1]);
    if (r->need[0]) r->out[0] = lg_sum_to(r->tape, lg_centre(r->tape, r->g, r->in[1]), x);
    if (!r->need[1]) return;
    const lg_var all = lg_full(r->tape, lg_shape1(x.dims[1]), 1);
    r->out[1] = lg_sum_to(r->tape, lg_covariance(r->tape, r->in[0], all, r->g, s.dims[2]), s);
}

const lg_op lg_op_centre = {
    LG_OP("centre", 0, 2, 2, centre_shape, centre_forward, centre_vjp, lg_multilinear_jvp),
    .scratch = scratch, .write_c = centre_c, .rows = broadcast, .terms = terms};

lg_var lg_centre(lg_tape *tape, lg_var x, lg_var s) {
    return lg_record(tape, &lg_op_centre, (lg_var[]){x, s}, 2, NULL);
}

/* ---- covariances of x, s, z ---- */

static lg_status covariance_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                  lg_shape *out) {
    const lg_shape *x = in[0], *s = in[1], *z = in[2];
    uint32_t rows;
    if (!has_rows(x) || s->rank != 1 || s->dims[0] != x->dims[1] || z->rank != 3 ||
        z->dims[1] != x->dims[1] || z->dims[2] != x->dims[2] || !meet(x->dims[0], z->dims[0], &rows))
        return LG_SHAPE;
    *out = lg_shape3(rows, x->dims[1], attr->i[0]);
    return attr->i[0] == 0 || attr->i[0] > x->dims[2] ? LG_INVALID_ARGUMENT : LG_OK;
}

static void covariance_row(const lg_evaluation *e, const double *const *x, double *y, double *work) {
    const uint32_t *d = e->in[0]->dims;
    covariance((int)d[1], (int)d[2], (int)e->attr->i[0], x[0], x[1], x[2], y, work);
}

LG_BATCH_FORWARD(covariance)

static void covariance_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *d = e->in[0]->dims;
    lg_batch_c(c, e, 3 * (size_t)BLOCK, "covariance(%u, %u, %u", d[1], d[2], e->attr->i[0]);
}

static void covariance_vjp(lg_reverse *r) {
    const bool same = r->in[0].index == r->in[2].index;
    lg_var g = times_rows(r->tape, times_rows(r->tape, r->g, r->in[1]), r->in[1]);
    if (same) g = lg_scale(r->tape, g, 2);
    for (uint32_t k = 0; k < (same ? 1 : 3); k += 2)
        if (r->need[k])
            r->out[k] =
                lg_sum_to(r->tape, lg_centre(r->tape, r->in[2 - k], g), lg_var_shape(r->tape, r->in[k]));
    if (same && r->need[2]) r->out[2] = LG_NONE;
}

const lg_op lg_op_covariance = {
    LG_OP("covariance", 2, 3, 3, covariance_shape, covariance_forward, covariance_vjp, lg_multilinear_jvp),
    .scratch = scratch, .write_c = covariance_c, .rows = broadcast, .terms = terms};

lg_var lg_covariance(lg_tape *tape, lg_var x, lg_var s, lg_var z, uint32_t parts) {
    return lg_record(tape, &lg_op_covariance, (lg_var[]){x, s, z}, 3, &(lg_attr){.i = {parts}});
}

/* ---- the root of a covariance ---- */

static lg_status root_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    const uint32_t m = in[0]->rank == 3 ? in[0]->dims[1] : 0;
    if (!has_rows(in[0]) || in[1]->rank != 1 || in[1]->dims[0] != m || m > 8192) return LG_SHAPE;
    *out = lg_shape3(in[0]->dims[0], m, m);
    return LG_OK;
}

/* Samples that the triangle grows by at a time: as long as it is itself small beside them. */
static size_t chunk_of(const lg_evaluation *e) {
    const size_t m = e->in[0]->dims[1], n = e->in[0]->dims[2], most = 64 + 16 * m;
    const size_t chunks = (n + most - 1) / most;
    return (n + chunks - 1) / chunks;
}

static size_t root_work(const lg_evaluation *e) {
    const size_t m = e->in[0]->dims[1], chunk = chunk_of(e);
    return BLOCK + m * ((chunk < e->in[0]->dims[2] ? 2 : 1) * m + chunk + 2);
}

static size_t root_scratch(const lg_evaluation *e) {
    return (root_work(e) + lg_batch_doubles(e)) * sizeof(double);
}

static void root_row(const lg_evaluation *e, const double *const *x, double *y, double *work) {
    const uint32_t *d = e->in[0]->dims;
    covariance_root((int)d[1], (int)d[2], (int)chunk_of(e), x[0], x[1], y, work);
}

LG_BATCH_FORWARD(root)

static void root_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *d = e->in[0]->dims;
    lg_batch_c(c, e, root_work(e), "covariance_root(%u, %u, %zu", d[1], d[2], chunk_of(e));
}

static lg_var solve(lg_tape *tape, lg_var s, lg_var w) {
    return lg_record(tape, &lg_op_lyapunov, (lg_var[]){s, w}, 2, NULL);
}

/* 2 F a F with F = diag(factor) */
static lg_var scaled(lg_tape *tape, lg_var a, lg_var factor) {
    return lg_scale(tape, times_rows(tape, lg_mul(tape, a, factor), factor), 2);
}

/* Deviations of x (B, m, n) over n. */
static lg_var deviations(lg_tape *tape, lg_var x) {
    return lg_centre(tape, x, lg_full(tape, lg_shape3(1, lg_var_shape(tape, x).dims[1], 1), 1));
}

static void root_vjp(lg_reverse *r) {
    const lg_var by = scaled(r->tape, solve(r->tape, r->y, r->g), r->in[1]);
    if (r->need[0]) r->out[0] = lg_matmul(r->tape, by, deviations(r->tape, r->in[0]));
}

static lg_var root_jvp(const lg_forward *f) {
    const lg_var products = lg_matmul_nt(f->tape, f->tangents[0], deviations(f->tape, f->in[0]));
    return solve(f->tape, f->y, scaled(f->tape, products, f->in[1]));
}

const lg_op lg_op_covariance_root = {
    LG_OP("covariance_root", 2, 2, 2, root_shape, root_forward, root_vjp, root_jvp), .scratch = root_scratch,
    .write_c = root_c, .rows = broadcast, .terms = terms};

lg_var lg_covariance_root(lg_tape *tape, lg_var x, lg_var factor) {
    return lg_record(tape, &lg_op_covariance_root, (lg_var[]){x, factor}, 2, NULL);
}

/* ---- S X + X S = W ---- */

static lg_status lyapunov_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                lg_shape *out) {
    const lg_shape *s = in[0];
    if (s->rank != 3 || s->dims[1] != s->dims[2] || s->dims[1] > 8192 || !lg_same_shape(s, in[1]))
        return LG_SHAPE;
    *out = *s;
    return LG_OK;
}

static size_t lyapunov_work(const lg_evaluation *e) {
    return (size_t)e->shape->dims[1] * (e->shape->dims[1] + 2);
}

static size_t lyapunov_scratch(const lg_evaluation *e) {
    return (lyapunov_work(e) + lg_batch_doubles(e)) * sizeof(double);
}

static void lyapunov_row(const lg_evaluation *e, const double *const *x, double *y, double *work) {
    lyapunov((int)e->shape->dims[1], x[0], x[1], y, work);
}

LG_BATCH_FORWARD(lyapunov)

static void lyapunov_c(lg_c *c, const lg_evaluation *e) {
    lg_batch_c(c, e, lyapunov_work(e), "lyapunov(%u", e->shape->dims[1]);
}

/* a x + x a */
static lg_var both_sides(lg_tape *tape, lg_var a, lg_var x) {
    return lg_add(tape, lg_matmul(tape, a, x), lg_matmul(tape, x, a));
}

static void lyapunov_vjp(lg_reverse *r) {
    const lg_var by_w = solve(r->tape, r->in[0], r->g);
    if (r->need[0]) r->out[0] = lg_neg(r->tape, both_sides(r->tape, by_w, r->y));
    if (r->need[1]) r->out[1] = by_w;
}

static lg_var lyapunov_jvp(const lg_forward *f) {
    lg_var right = f->tangents[1];
    if (!lg_is_none(f->tangents[0]))
        right = lg_add_or(f->tape, right, lg_neg(f->tape, both_sides(f->tape, f->tangents[0], f->y)));
    return solve(f->tape, f->in[0], right);
}

const lg_op lg_op_lyapunov = {
    LG_OP("lyapunov", 0, 2, 2, lyapunov_shape, lyapunov_forward, lyapunov_vjp, lyapunov_jvp),
    .scratch = lyapunov_scratch, .write_c = lyapunov_c, .rows = lg_rows_each, .terms = terms};

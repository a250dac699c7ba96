/* Row-wise vector products, small symmetric positive definite systems, and the analytic functions of w =
 * |u|^2 that exp, dexp and dexpinv are made of. */
#include <float.h>

#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/program/scalars.h"
#include "autodiff/tape/tape_internal.h"

extern const lg_op lg_op_rowdot;

/* ---- row-wise dot product: (..., d) (..., d) -> (..., 1) ---- */

static lg_status rowdot_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    if (in[0]->rank == 0 || !lg_same_shape(in[0], in[1])) return LG_SHAPE;
    *out = *in[0];
    out->dims[out->rank - 1] = 1;
    return LG_OK;
}

static lg_status rowdot_forward(lg_evaluation *e) {
    size_t d = e->in[0]->dims[e->in[0]->rank - 1];
    e->k->rowdot(e->count, d, e->x[0], e->x[1], e->y);
    return LG_OK;
}

static void rowdot_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    const size_t d = e->in[0]->dims[e->in[0]->rank - 1];
    for (size_t i = 0; i < e->count; i++) y[i] = lg_s_dot(s, x[0] + i * d, 1, x[1] + i * d, 1, d);
}

static void rowdot_c(lg_c *c, const lg_evaluation *e) {
    lg_c_call(c, "rowdot(%zu, %u, $0, $1, $y)", e->count, e->in[0]->dims[e->in[0]->rank - 1]);
}

static void rowdot_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = lg_mul(r->tape, r->g, r->in[1]);
    if (r->need[1]) r->out[1] = lg_mul(r->tape, r->g, r->in[0]);
}

static size_t rowdot_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return in[0]->dims[in[0]->rank - 1];
}

const lg_op lg_op_rowdot = {
    LG_OP("rowdot", 0, 2, 2, rowdot_shape, rowdot_forward, rowdot_vjp, lg_multilinear_jvp),
    .expand = rowdot_expand, .write_c = rowdot_c, .rows = lg_rows_each, .terms = rowdot_terms};

lg_var lg_rowdot(lg_tape *tape, lg_var a, lg_var b) {
    lg_var in[2] = {a, b};
    return lg_record(tape, &lg_op_rowdot, in, 2, NULL);
}

lg_var lg_rownorm2(lg_tape *tape, lg_var a) {
    return lg_rowdot(tape, a, a);
}

/* ---- row-wise cross product of vectors of length 3 ---- */

static lg_status cross_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    const lg_shape *a = in[0];
    if (a->rank == 0 || a->dims[a->rank - 1] != 3 || !lg_same_shape(a, in[1])) return LG_SHAPE;
    *out = *a;
    return LG_OK;
}

static lg_status cross_forward(lg_evaluation *e) {
    e->k->cross(e->count / 3, e->x[0], e->x[1], e->y);
    return LG_OK;
}

/* For cross_vjp: g.(da x b) = da.(b x g), g.(a x db) = db.(g x a). */
static void cross_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    for (size_t i = 0; i < e->count; i += 3)
        for (size_t c = 0; c < 3; c++) {
            const size_t p = i + (c + 1) % 3, q = i + (c + 2) % 3;
            y[i + c] = lg_s_sub(s, lg_s_mul(s, x[0][p], x[1][q]), lg_s_mul(s, x[0][q], x[1][p]));
        }
}

static void cross_c(lg_c *c, const lg_evaluation *e) {
    lg_c_call(c, "cross(%zu, $0, $1, $y)", e->count / 3);
}

static void cross_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = lg_cross(r->tape, r->in[1], r->g);
    if (r->need[1]) r->out[1] = lg_cross(r->tape, r->g, r->in[0]);
}

const lg_op lg_op_cross = {LG_OP("cross", 0, 2, 2, cross_shape, cross_forward, cross_vjp, lg_multilinear_jvp),
                           .expand = cross_expand, .write_c = cross_c, .rows = lg_rows_each};

lg_var lg_cross(lg_tape *tape, lg_var a, lg_var b) {
    lg_var in[2] = {a, b};
    return lg_record(tape, &lg_op_cross, in, 2, NULL);
}

/* ---- batched symmetric positive definite solve; the Cholesky factor is a separate node, which
 * differentiation treats as a constant ---- */

static lg_status factor_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    const lg_shape *a = in[0];
    if (a->rank != 3 || a->dims[1] != a->dims[2]) return LG_SHAPE;
    *out = *a;
    return LG_OK;
}

static lg_status factor_forward(lg_evaluation *e) {
    (void)e->k->spd_factor(e->shape->dims[0], e->shape->dims[1], e->x[0], e->y);
    return LG_OK;
}

/* If the matrix is not positive definite (`good` is 0), sets the diagonal of its factor to NaN. The solve
 * divides every number by a diagonal element, so all of the solution becomes NaN. NaN in other elements would
 * not suffice: where the scalar code knows a zero in advance it drops the product. */
static void mark_diagonal(lg_scalars *s, size_t k, lg_scalar good, lg_scalar *l) {
    const lg_scalar minus = lg_s_constant(s, -1.0), nan = lg_s(s, LG_S_SQRT, minus, minus);
    for (size_t j = 0; j < k; j++) l[j * k + j] = lg_s_select(s, good, l[j * k + j], nan);
}

/* l (k, k), lower triangular */
static void factor_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    const size_t k = e->shape->dims[1];
    for (size_t b = 0; b < e->shape->dims[0]; b++) {
        const lg_scalar *a = x[0] + b * k * k;
        lg_scalar *l = y + b * k * k, good = lg_s_constant(s, 1.0);
        for (size_t j = 0; j < k; j++)
            for (size_t i = 0; i < k; i++) {
                if (i < j) {
                    l[i * k + j] = lg_s_constant(s, 0.0);
                    continue;
                }
                lg_scalar sum =
                    i == j ? a[i * k + j] : lg_s_scale(s, 0.5, lg_s_add(s, a[i * k + j], a[j * k + i]));
                for (size_t m = 0; m < j; m++)
                    sum = lg_s_sub(s, sum, lg_s_mul(s, l[i * k + m], l[j * k + m]));
                if (i == j) /* whether the pivot is positive and normal in both types */
                    good = lg_s_mul(s, good, lg_s(s, LG_S_GE, sum, lg_s_constant(s, FLT_MIN)));
                l[i * k + j] = i == j ? lg_s(s, LG_S_SQRT, sum, sum) : lg_s_div(s, sum, l[j * k + j]);
            }
        mark_diagonal(s, k, good, l);
    }
}

static void factor_c(lg_c *c, const lg_evaluation *e) {
    lg_c_call(c, "spd_factor(%u, %u, $0, $y)", e->shape->dims[0], e->shape->dims[1]);
}

/* Number of terms (lg_op.terms) of a factorisation and of a solve. */
static size_t order_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return (size_t)shape->dims[1] * shape->dims[1];
}

const lg_op lg_op_spd_factor = {
    LG_OP("spd_factor", 1u, 1, 1, factor_shape, factor_forward, lg_no_vjp, lg_zero_jvp),
    .expand = factor_expand, .write_c = factor_c, .rows = lg_rows_each, .terms = order_terms};

static lg_status solve_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    const lg_shape *a = in[0], *b = in[1];
    if (a->rank != 3 || b->rank != 3 || a->dims[0] != b->dims[0] || a->dims[2] != b->dims[1] ||
        !lg_same_shape(a, in[2]) || a->dims[1] != a->dims[2])
        return LG_SHAPE;
    *out = *b;
    return LG_OK;
}

static lg_status solve_forward(lg_evaluation *e) {
    const uint32_t *d = e->shape->dims;
    e->k->spd_solve(d[0], d[1], d[2], e->x[2], e->x[1], e->y);
    return LG_OK;
}

/* Forward uses only the factor; the matrix itself is read only by derivatives. */
static uint32_t solve_unread(const lg_attr *attr, uint32_t inputs) {
    return 1u;
}

/* Solves l l^T y = b, one column after the other. */
static void solve_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    const size_t k = e->shape->dims[1], m = e->shape->dims[2];
    for (size_t b = 0; b < e->shape->dims[0]; b++) {
        const lg_scalar *l = x[2] + b * k * k, *from = x[1] + b * k * m;
        lg_scalar *to = y + b * k * m;
        for (size_t c = 0; c < m; c++) {
            for (size_t i = 0; i < k; i++) {
                lg_scalar sum = from[i * m + c];
                for (size_t j = 0; j < i; j++)
                    sum = lg_s_sub(s, sum, lg_s_mul(s, l[i * k + j], to[j * m + c]));
                to[i * m + c] = lg_s_div(s, sum, l[i * k + i]);
            }
            for (size_t i = k; i-- > 0;) {
                lg_scalar sum = to[i * m + c];
                for (size_t j = i + 1; j < k; j++)
                    sum = lg_s_sub(s, sum, lg_s_mul(s, l[j * k + i], to[j * m + c]));
                to[i * m + c] = lg_s_div(s, sum, l[i * k + i]);
            }
        }
    }
}

static void solve_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t *d = e->shape->dims;
    lg_c_call(c, "spd_solve(%u, %u, %u, $2, $1, $y)", d[0], d[1], d[2]);
}

static lg_var solve_with(lg_tape *tape, lg_var a, lg_var b, lg_var factor) {
    lg_var in[3] = {a, b, factor};
    return lg_record(tape, &lg_op_spd_solve, in, 3, NULL);
}

static lg_var symmetric_part(lg_tape *tape, lg_var a) {
    return lg_scale(tape, lg_add(tape, a, lg_transpose(tape, a)), 0.5);
}

/* X = S^-1 B with S = sym(A), and G the cotangent of X: dB = S^-1 G, dA = -sym(dB X^T). */
static void solve_vjp(lg_reverse *r) {
    lg_var db = solve_with(r->tape, r->in[0], r->g, r->in[2]);
    if (r->need[0]) r->out[0] = lg_neg(r->tape, symmetric_part(r->tape, lg_matmul_nt(r->tape, db, r->y)));
    if (r->need[1]) r->out[1] = db;
}

/* dX = S^-1 (dB - sym(dA) X). */
static lg_var solve_jvp(const lg_forward *f) {
    lg_var right = f->tangents[1];
    if (!lg_is_none(f->tangents[0])) {
        lg_var moved = lg_neg(f->tape, lg_matmul(f->tape, symmetric_part(f->tape, f->tangents[0]), f->y));
        right = lg_add_or(f->tape, right, moved);
    }
    return solve_with(f->tape, f->in[0], right, f->in[2]);
}

const lg_op lg_op_spd_solve = {LG_OP("spd_solve", 4u, 3, 3, solve_shape, solve_forward, solve_vjp, solve_jvp),
                               .unread = solve_unread,
                               .expand = solve_expand,
                               .write_c = solve_c,
                               .rows = lg_rows_each,
                               .terms = order_terms};

lg_var lg_spd_solve(lg_tape *tape, lg_var a, lg_var b) {
    lg_var factor = lg_record(tape, &lg_op_spd_factor, &a, 1, NULL);
    return solve_with(tape, a, b, factor);
}

/* ---- Stumpff functions c_0..c_K; attr.i = {K, order of the derivative} ---- */

static bool is_column(const lg_shape *shape) {
    return shape->rank > 0 && shape->dims[shape->rank - 1] == 1;
}

#define HIGHEST_ORDER 8u

static lg_status stumpff_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                               lg_shape *out) {
    if (!is_column(in[0])) return LG_SHAPE;
    if (attr->i[0] > 8) return LG_INVALID_ARGUMENT;
    if (attr->i[1] > HIGHEST_ORDER) return LG_NOT_DIFFERENTIABLE;
    *out = *in[0];
    out->dims[out->rank - 1] = attr->i[0] + 1;
    return LG_OK;
}

static lg_status stumpff_forward(lg_evaluation *e) {
    e->k->stumpff(lg_shape_count(*e->in[0]), (int)e->attr->i[0], (int)e->attr->i[1], e->x[0], e->y);
    return LG_OK;
}

static void stumpff_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    const uint32_t each = e->attr->i[0] + 1;
    for (size_t i = 0; i < e->count; i++)
        y[i] = lg_s_numbered(s, LG_S_STUMPFF, x[0][i / each], 16 * e->attr->i[1] + (uint32_t)(i % each));
}

static void stumpff_c(lg_c *c, const lg_evaluation *e) {
    lg_c_call(c, "stumpff_rows(%zu, %u, %u, $0, $y)", e->count / (e->attr->i[0] + 1), e->attr->i[0],
              e->attr->i[1]);
}

/* Records the same functions with the next higher order of derivative. */
static lg_var next_order(lg_tape *tape, const lg_op *op, lg_var w, const lg_attr *attr) {
    lg_attr next = *attr;
    next.i[1]++;
    return lg_record(tape, op, &w, 1, &next);
}

static void stumpff_vjp(lg_reverse *r) {
    if (r->need[0])
        r->out[0] = lg_rowdot(r->tape, r->g, next_order(r->tape, &lg_op_stumpff, r->in[0], r->attr));
}

static lg_var stumpff_jvp(const lg_forward *f) {
    return lg_mul(f->tape, next_order(f->tape, &lg_op_stumpff, f->in[0], f->attr), f->tangents[0]);
}

const lg_op lg_op_stumpff = {
    LG_OP("stumpff", 0, 1, 1, stumpff_shape, stumpff_forward, stumpff_vjp, stumpff_jvp),
    .expand = stumpff_expand, .write_c = stumpff_c, .rows = lg_rows_each};

lg_var lg_stumpff_functions(lg_tape *tape, lg_var w, int K) {
    if (K < 0)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "stumpff", "K is negative, but it must be 0 or more");
    lg_attr attr = {.i = {(uint32_t)K, 0, 0, 0}};
    return lg_record(tape, &lg_op_stumpff, &w, 1, &attr);
}

/* ---- the coefficient g2 of dexpinv; attr.i = {0, order of the derivative} ---- */

static lg_status dexpinv_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                               lg_shape *out) {
    if (!is_column(in[0])) return LG_SHAPE;
    if (attr->i[1] > HIGHEST_ORDER) return LG_NOT_DIFFERENTIABLE;
    *out = *in[0];
    return LG_OK;
}

static lg_status dexpinv_forward(lg_evaluation *e) {
    e->k->dexpinv_coef(lg_shape_count(*e->in[0]), (int)e->attr->i[1], e->x[0], e->y);
    return LG_OK;
}

static void dexpinv_vjp(lg_reverse *r) {
    if (r->need[0])
        r->out[0] = lg_mul(r->tape, r->g, next_order(r->tape, &lg_op_dexpinv_coef, r->in[0], r->attr));
}

static lg_var dexpinv_jvp(const lg_forward *f) {
    return lg_mul(f->tape, next_order(f->tape, &lg_op_dexpinv_coef, f->in[0], f->attr), f->tangents[0]);
}

static lg_scalar dexpinv_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s_numbered(s, LG_S_DEXPINV, x[0], attr->i[1]);
}

const lg_op lg_op_dexpinv_coef = {
    LG_OP("dexpinv_coef", 0, 1, 1, dexpinv_shape, dexpinv_forward, dexpinv_vjp, dexpinv_jvp),
    .element = dexpinv_element};

lg_var lg_dexpinv_coefficient(lg_tape *tape, lg_var w, int order) {
    if (order < 0) return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "dexpinv_coef", "the order is negative");
    lg_attr attr = {.i = {0, (uint32_t)order, 0, 0}};
    return lg_record(tape, &lg_op_dexpinv_coef, &w, 1, &attr);
}

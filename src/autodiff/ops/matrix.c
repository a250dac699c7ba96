/* Matrix products a b (nn), a b^T (nt) and a^T b (tn), a family that is closed under differentiation. The
 * operands have rank 2, or rank 3 for a batch of matrices. An optional third input is added: a full matrix, a
 * bias row or a scalar. */
#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/program/scalars.h"
#include "autodiff/tape/tape_internal.h"
#include "kernels/product.h"

#include <string.h>

enum { NN = LG_NN, NT = LG_NT, TN = LG_TN };

/* Sizes of one product: m rows, n columns, inner length k; and the numbers of matrices in a, b and the
 * result. */
typedef struct extent {
    size_t m, n, k, batch_a, batch_b, batch;
} extent;

static bool extent_of(const lg_shape *a, const lg_shape *b, uint32_t variant, extent *e) {
    if (a->rank < 2 || a->rank > 3 || b->rank < 2 || b->rank > 3) return false;
    const uint32_t *da = a->dims + (a->rank - 2), *db = b->dims + (b->rank - 2);
    e->m = da[variant == TN ? 1 : 0];
    e->k = da[variant == TN ? 0 : 1];
    e->n = db[variant == NT ? 0 : 1];
    e->batch_a = a->rank == 3 ? a->dims[0] : 1;
    e->batch_b = b->rank == 3 ? b->dims[0] : 1;
    e->batch = e->batch_a > e->batch_b ? e->batch_a : e->batch_b;
    if (e->batch_a != e->batch_b) {
        if (e->batch_a != 1 && e->batch_b != 1) return false;
        e->batch = e->batch_a == 1 ? e->batch_b : e->batch_a;
    }
    return db[variant == NT ? 1 : 0] == e->k;
}

static lg_status matmul_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                              lg_shape *out) {
    extent e = {0};
    if (attr->i[0] > TN) return LG_INVALID_ARGUMENT;
    if (!extent_of(in[0], in[1], attr->i[0], &e)) return LG_SHAPE;
    bool batched = in[0]->rank == 3 || in[1]->rank == 3;
    *out = batched ? lg_shape3((uint32_t)e.batch, (uint32_t)e.m, (uint32_t)e.n)
                   : lg_shape2((uint32_t)e.m, (uint32_t)e.n);
    if (inputs < 3) return LG_OK;
    const lg_shape *c = in[2];
    if (batched || c->rank > 2) return LG_SHAPE;
    if (c->rank == 0) return LG_OK;
    if (c->dims[c->rank - 1] != e.n) return LG_SHAPE;
    return c->rank == 1 || c->dims[0] == 1 || c->dims[0] == e.m ? LG_OK : LG_SHAPE;
}

static extent extent_at(const lg_evaluation *e) {
    extent of = {0};
    (void)extent_of(e->in[0], e->in[1], e->attr->i[0], &of);
    return of;
}

static lg_product_size one_product(const lg_evaluation *e, const extent *of) {
    return (lg_product_size){e->attr->i[0], of->m, of->n, of->k};
}

static size_t matmul_scratch(const lg_evaluation *e) {
    const extent of = extent_at(e);
    const lg_product_size size = one_product(e, &of);
    return e->transposed != NULL ? 0 : lg_product_scratch(e->k, &size, e->crew);
}

static lg_transpose_use matmul_transpose(const lg_evaluation *e) {
    const extent of = extent_at(e);
    const lg_product_size size = one_product(e, &of);
    return e->in[1]->rank == 2 ? lg_product_transpose(&size, e->crew) : LG_TRANSPOSE_NONE;
}

/* Up to this side, many products are computed by the kernel for small matrices. Products of a row with a
 * transposed matrix are left out: a single one is a product with a vector, which may have partial sums. */
enum { SMALL_SIDE = 4 };

static bool is_small(uint32_t variant, const extent *of) {
    return of->batch > 1 && of->m <= SMALL_SIDE && of->n <= SMALL_SIDE && of->k <= SMALL_SIDE &&
           !(variant == NT && of->m == 1);
}

static lg_small_products small_products(uint32_t variant, const extent *of, bool accumulate) {
    return (lg_small_products){.count = of->batch,
                               .m = of->m,
                               .n = of->n,
                               .k = of->k,
                               .step_a = of->batch_a == 1 ? 0 : of->m * of->k,
                               .ra = variant == TN ? 1 : of->k,
                               .ca = variant == TN ? of->m : 1,
                               .step_b = of->batch_b == 1 ? 0 : of->k * of->n,
                               .rb = variant == NT ? 1 : of->n,
                               .cb = variant == NT ? of->k : 1,
                               .accumulate = accumulate};
}

static lg_status matmul_forward(lg_evaluation *e) {
    const lg_kernels *k = e->k;
    const extent of = extent_at(e);
    const lg_product_size size = one_product(e, &of);
    const size_t c_count = e->inputs == 3 ? lg_shape_count(*e->in[2]) : 0;
    const bool full = e->inputs == 3 && c_count == e->count;
    if (full && e->x[2] != e->y) memcpy(e->y, e->x[2], e->count * k->size);
    const unsigned char *a = e->x[0], *b = e->x[1];
    unsigned char *c = e->y;
    const size_t step_a = of.batch_a == 1 ? 0 : of.m * of.k * k->size;
    const size_t step_b = of.batch_b == 1 ? 0 : of.k * of.n * k->size, step_c = of.m * of.n * k->size;
    if (is_small(size.variant, &of)) {
        const lg_small_products small = small_products(size.variant, &of, full);
        k->small_products(&small, a, b, c);
    } else {
        for (size_t i = 0; i < of.batch; i++)
            lg_product(k, e->crew, &size, a + i * step_a, b + i * step_b, e->transposed, c + i * step_c, full,
                       e->scratch);
    }
    if (e->inputs < 3 || full) return LG_OK;
    if (c_count == of.n) {
        k->bias_act(LG_K_IDENTITY, of.m, of.n, e->x[2], e->y);
    } else {
        double value;
        k->convert_out(1, e->x[2], &value);
        k->unary[LG_K_SHIFT](e->count, value, e->y, e->y);
    }
    return LG_OK;
}

static void matmul_expand(lg_scalars *s, const lg_evaluation *e, const lg_scalar *const *x, lg_scalar *y) {
    const extent of = extent_at(e);
    const bool turned_a = e->attr->i[0] == TN, turned_b = e->attr->i[0] == NT;
    for (size_t b = 0; b < of.batch; b++) {
        const lg_scalar *left = x[0] + (of.batch_a == 1 ? 0 : b * of.m * of.k);
        const lg_scalar *right = x[1] + (of.batch_b == 1 ? 0 : b * of.k * of.n);
        for (size_t i = 0; i < of.m; i++)
            for (size_t j = 0; j < of.n; j++) {
                lg_scalar sum = lg_s_dot(s, left + (turned_a ? i : i * of.k), turned_a ? of.m : 1,
                                         right + (turned_b ? j * of.k : j), turned_b ? 1 : of.n, of.k);
                if (e->inputs > 2) {
                    const size_t count = lg_shape_count(*e->in[2]);
                    sum = lg_s_add(s, sum, x[2][count == e->count ? i * of.n + j : count == of.n ? j : 0]);
                }
                y[(b * of.m + i) * of.n + j] = sum;
            }
    }
}

/* ---- generated C ---- */

static void matmul_c(lg_c *c, const lg_evaluation *e) {
    static const char *const names[] = {[NN] = "nn", [NT] = "nt", [TN] = "tn"};
    const extent of = extent_at(e);
    const uint32_t variant = e->attr->i[0];
    const size_t rows = of.batch * of.m, added = e->inputs == 3 ? lg_shape_count(*e->in[2]) : 0;
    const size_t step_a = of.batch_a == 1 ? 0 : of.m * of.k, step_b = of.batch_b == 1 ? 0 : of.k * of.n;
    if (!lg_c_lies_over(c, 2))
        lg_c_call(c, "start(%zu, %zu, %s, %zu, %d, $y)", rows, of.n, added > 0 ? "$2" : "NULL",
                  added == e->count ? of.n : 0, added == e->count || added == of.n);
    if (of.batch == 1)
        lg_c_call(c, "matmul_%s(%zu, %zu, %zu, $0, $1, $y)", names[variant], of.m, of.n, of.k);
    else
        lg_c_call(c,
                  "for (int i = 0; i < %zu; i++) matmul_%s(%zu, %zu, %zu, $0 + i * %zu, $1 + i * %zu, $y + i "
                  "* %zu)",
                  of.batch, names[variant], of.m, of.n, of.k, step_a, step_b, of.m * of.n);
}

static lg_var product(lg_tape *tape, uint32_t variant, lg_var a, lg_var b) {
    lg_attr attr = {.i = {variant, 0, 0, 0}};
    lg_var in[2] = {a, b};
    return lg_record(tape, &lg_op_matmul, in, 2, &attr);
}

/* The cotangents of both factors are products, too: for each, the variant, and which of A, B and G (the
 * cotangent of the product) is the left and the right factor. */
enum { A, B, G };
static const struct {
    uint8_t variant, left, right;
} adjoint[3][2] = {
    [NN] = {{NT, G, B}, {TN, A, G}}, /* dA = G B^T, dB = A^T G */
    [NT] = {{NN, G, B}, {TN, G, A}}, /* dA = G B,   dB = G^T A */
    [TN] = {{NT, B, G}, {NN, A, G}}, /* dA = B G^T, dB = A G   */
};

static void matmul_vjp(lg_reverse *r) {
    uint32_t variant = r->attr->i[0];
    lg_var who[3] = {r->in[0], r->in[1], r->g};
    bool batched = lg_node_at(r->tape, r->y)->shape.rank == 3;
    for (uint32_t k = 0; k < 2; k++) {
        if (!r->need[k]) continue;
        lg_var left = who[adjoint[variant][k].left], right = who[adjoint[variant][k].right];
        if (batched) {
            lg_var full = product(r->tape, adjoint[variant][k].variant, left, right);
            r->out[k] = lg_sum_to(r->tape, full, lg_node_at(r->tape, r->in[k])->shape);
        } else {
            lg_reverse_matmul(r, k, adjoint[variant][k].variant, left, right);
        }
    }
    if (r->inputs == 3 && r->need[2])
        r->out[2] = lg_sum_to(r->tape, r->g, lg_node_at(r->tape, r->in[2])->shape);
}

static lg_var matmul_jvp(const lg_forward *f) {
    lg_var a = LG_NONE, b = LG_NONE, c = LG_NONE;
    if (!lg_is_none(f->tangents[0])) a = product(f->tape, f->attr->i[0], f->tangents[0], f->in[1]);
    if (!lg_is_none(f->tangents[1])) b = product(f->tape, f->attr->i[0], f->in[0], f->tangents[1]);
    if (f->inputs == 3 && !lg_is_none(f->tangents[2]))
        c = lg_broadcast_to(f->tape, f->tangents[2], lg_node_at(f->tape, f->y)->shape);
    return lg_add_or(f->tape, lg_add_or(f->tape, a, b), c);
}

static lg_row_use matmul_rows(const lg_shape *const *in, uint32_t inputs, const lg_shape *shape,
                              uint32_t copies, lg_attr *attr) {
    if (shape->rank == 3) return LG_ROWS_BROADCAST;
    /* Whether the third input has its own row for each row of the result. */
    const bool added = inputs > 2 && lg_shape_count(*in[2]) == lg_shape_count(*shape);
    return attr->i[0] != TN && !added ? LG_ROWS_FIRST : LG_ROWS_MEET;
}

static lg_instead matmul_instead(const lg_known *k) {
    const bool zero = k->filled(k->user, 0, 0.0) || k->filled(k->user, 1, 0.0);
    return k->inputs == 2 && zero ? lg_instead_zeros() : lg_instead_nothing();
}

static size_t matmul_terms(const lg_shape *const *in, const lg_attr *attr, const lg_shape *shape) {
    return in[0]->dims[in[0]->rank - (attr->i[0] == TN ? 2 : 1)];
}

static bool matmul_begins_layer(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr) {
    return attr->i[0] == NN && in[0]->rank == 2 && in[1]->rank == 2 &&
           (inputs == 2 || lg_shape_count(*in[2]) == in[1]->dims[1]);
}

const lg_op lg_op_matmul = {.name = "matmul",
                            .least = 2,
                            .most = 3,
                            .shape = matmul_shape,
                            .forward = matmul_forward,
                            .vjp = matmul_vjp,
                            .jvp = matmul_jvp,
                            .expand = matmul_expand,
                            .scratch = matmul_scratch,
                            .transpose = matmul_transpose,
                            .write_c = matmul_c,
                            .rows = matmul_rows,
                            .instead = matmul_instead,
                            .terms = matmul_terms,
                            .most_code = 64,
                            .begins_layer = matmul_begins_layer};

lg_var lg_matmul(lg_tape *tape, lg_var a, lg_var b) {
    return product(tape, NN, a, b);
}
lg_var lg_matmul_nt(lg_tape *tape, lg_var a, lg_var b) {
    return product(tape, NT, a, b);
}
lg_var lg_matmul_tn(lg_tape *tape, lg_var a, lg_var b) {
    return product(tape, TN, a, b);
}
lg_var lg_matmul_add(lg_tape *tape, lg_var a, lg_var b, lg_var c) {
    lg_attr attr = {.i = {NN, 0, 0, 0}};
    lg_var in[3] = {a, b, c};
    return lg_record(tape, &lg_op_matmul, in, 3, &attr);
}

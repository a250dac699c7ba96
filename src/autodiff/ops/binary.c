/* Binary operations with broadcasting. */
#include "autodiff/ops/op_rows.h"
#include "autodiff/program/scalars.h"
#include "autodiff/tape/tape_internal.h"

/* ---- broadcasting ---- */

/* The dimension of `shape` at axis i of a result of rank `rank`, with last axes aligned; 1 where `shape` has
 * no such axis. */
static uint32_t dim_at(const lg_shape *shape, uint32_t rank, uint32_t i) {
    uint32_t missing = rank - shape->rank;
    return i < missing ? 1 : shape->dims[i - missing];
}

static lg_status broadcast_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                 lg_shape *out) {
    const lg_shape *a = in[0], *b = in[1];
    out->rank = a->rank > b->rank ? a->rank : b->rank;
    for (uint32_t i = 0; i < out->rank; i++) {
        uint32_t da = dim_at(a, out->rank, i), db = dim_at(b, out->rank, i);
        if (da != db && da != 1 && db != 1) return LG_SHAPE;
        out->dims[i] = da == 1 ? db : da;
    }
    return LG_OK;
}

/* A nest of LG_MAX_RANK loops over two strided operands, the innermost loop last; strides are in elements. */
typedef struct nest {
    size_t dims[LG_MAX_RANK], a[LG_MAX_RANK], b[LG_MAX_RANK];
} nest;

/* Drops axes of length 1 and merges adjacent axes that form one run in both operands. */
static nest nest_of(const lg_shape *out, const lg_shape *a, const lg_shape *b) {
    nest n;
    size_t stride_a = 1, stride_b = 1;
    size_t dims[LG_MAX_RANK], sa[LG_MAX_RANK], sb[LG_MAX_RANK];
    uint32_t levels = 0; /* filled with the innermost axis first */
    for (uint32_t i = out->rank; i-- > 0;) {
        size_t da = dim_at(a, out->rank, i), db = dim_at(b, out->rank, i), d = out->dims[i];
        size_t ra = da == 1 ? 0 : stride_a, rb = db == 1 ? 0 : stride_b;
        stride_a *= da;
        stride_b *= db;
        if (d == 1) continue;
        if (levels > 0 && ra == sa[levels - 1] * dims[levels - 1] &&
            rb == sb[levels - 1] * dims[levels - 1]) {
            dims[levels - 1] *= d;
            continue;
        }
        dims[levels] = d;
        sa[levels] = ra;
        sb[levels] = rb;
        levels++;
    }
    for (uint32_t i = 0; i < LG_MAX_RANK; i++) {
        bool used = i < levels;
        n.dims[LG_MAX_RANK - 1 - i] = used ? dims[i] : 1;
        n.a[LG_MAX_RANK - 1 - i] = used ? sa[i] : 0;
        n.b[LG_MAX_RANK - 1 - i] = used ? sb[i] : 0;
    }
    return n;
}

static lg_status binary_forward(lg_evaluation *e, lg_k_binary op) {
    const lg_kernels *k = e->k;
    if (lg_same_shape(e->in[0], e->in[1])) {
        k->binary[op](e->count, e->x[0], e->x[1], e->y);
        return LG_OK;
    }
    nest n = nest_of(e->shape, e->in[0], e->in[1]);
    const unsigned char *a = e->x[0], *b = e->x[1];
    unsigned char *y = e->y;
    size_t block = n.dims[2] * n.dims[3];
    for (size_t i = 0; i < n.dims[0]; i++)
        for (size_t j = 0; j < n.dims[1]; j++) {
            k->binary_strided[op](n.dims[2], n.dims[3], a + (i * n.a[0] + j * n.a[1]) * k->size, n.a[2],
                                  n.a[3], b + (i * n.b[0] + j * n.b[1]) * k->size, n.b[2], n.b[3], y);
            y += block * k->size;
        }
    return LG_OK;
}

/* Sums the cotangent g of the output to the shape of input k, which may have been broadcast. */
static lg_var fold(const lg_reverse *r, uint32_t k, lg_var g) {
    return lg_sum_to(r->tape, g, lg_node_at(r->tape, r->in[k])->shape);
}

/* The same as fold(a * b) for input k; computed as a row-wise dot product when only the last axis was
 * broadcast. */
static lg_var fold_product(const lg_reverse *r, uint32_t k, lg_var a, lg_var b) {
    const lg_shape *target = &lg_node_at(r->tape, r->in[k])->shape;
    const lg_shape *sa = &lg_node_at(r->tape, a)->shape, *sb = &lg_node_at(r->tape, b)->shape;
    bool rows =
        target->rank == sa->rank && sa->rank > 0 && lg_same_shape(sa, sb) && sa->dims[sa->rank - 1] > 1;
    for (uint32_t i = 0; rows && i < sa->rank; i++)
        rows = target->dims[i] == (i + 1 == sa->rank ? 1 : sa->dims[i]);
    if (rows) return lg_rowdot(r->tape, a, b);
    return fold(r, k, lg_mul(r->tape, a, b));
}

/* Broadcasts a tangent of an input to the output's shape. */
static lg_var spread(const lg_forward *f, lg_var t) {
    return lg_is_none(t) ? t : lg_broadcast_to(f->tape, t, lg_node_at(f->tape, f->y)->shape);
}

/* ---- operations ---- */

#define FORWARD(op, kernel)                                                                                  \
    static lg_status op##_forward(lg_evaluation *e) {                                                        \
        return binary_forward(e, kernel);                                                                    \
    }

/* Whether input `input` has the output's shape and all elements of the other input equal `with`. */
static bool other_is(const lg_known *k, uint32_t input, double with) {
    return lg_same_shape(k->in[input], k->shape) && k->filled(k->user, 1 - input, with);
}

FORWARD(add, LG_K_ADD)
static void add_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = fold(r, 0, r->g);
    if (r->need[1]) r->out[1] = fold(r, 1, r->g);
}
static lg_var add_jvp(const lg_forward *f) {
    return lg_add_or(f->tape, spread(f, f->tangents[0]), spread(f, f->tangents[1]));
}
static lg_scalar add_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s_add(s, x[0], x[1]);
}
static lg_instead add_instead(const lg_known *k) {
    if (other_is(k, 0, 0.0)) return lg_instead_input(0);
    if (other_is(k, 1, 0.0)) return lg_instead_input(1);
    return lg_instead_nothing();
}
const lg_op lg_op_add = {LG_OP("add", 0, 2, 2, broadcast_shape, add_forward, add_vjp, add_jvp),
                         .element = add_element, .instead = add_instead};

FORWARD(sub, LG_K_SUB)
static void sub_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = fold(r, 0, r->g);
    if (r->need[1]) r->out[1] = lg_neg(r->tape, fold(r, 1, r->g));
}
static lg_var sub_jvp(const lg_forward *f) {
    lg_var a = spread(f, f->tangents[0]), b = spread(f, f->tangents[1]);
    if (lg_is_none(b)) return a;
    return lg_is_none(a) ? lg_neg(f->tape, b) : lg_sub(f->tape, a, b);
}
static lg_scalar sub_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s_sub(s, x[0], x[1]);
}
static lg_instead sub_instead(const lg_known *k) {
    if (other_is(k, 0, 0.0)) return lg_instead_input(0);
    return lg_instead_nothing();
}
const lg_op lg_op_sub = {LG_OP("sub", 0, 2, 2, broadcast_shape, sub_forward, sub_vjp, sub_jvp),
                         .element = sub_element, .instead = sub_instead};

lg_var lg_multilinear_jvp(const lg_forward *f) {
    lg_var sum = LG_NONE;
    for (uint32_t k = 0; k < f->inputs; k++)
        if (!lg_is_none(f->tangents[k])) sum = lg_add_or(f->tape, sum, lg_with_tangent(f, k));
    return sum;
}

FORWARD(mul, LG_K_MUL)
static void mul_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = fold_product(r, 0, r->g, r->in[1]);
    if (r->need[1]) r->out[1] = fold_product(r, 1, r->g, r->in[0]);
}
static lg_scalar mul_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s_mul(s, x[0], x[1]);
}
static lg_instead mul_instead(const lg_known *k) {
    if (other_is(k, 0, 1.0)) return lg_instead_input(0);
    if (other_is(k, 1, 1.0)) return lg_instead_input(1);
    if (k->filled(k->user, 0, 0.0) || k->filled(k->user, 1, 0.0)) return lg_instead_zeros();
    return lg_instead_nothing();
}
const lg_op lg_op_mul = {LG_OP("mul", 0, 2, 2, broadcast_shape, mul_forward, mul_vjp, lg_multilinear_jvp),
                         .element = mul_element, .instead = mul_instead};

FORWARD(div, LG_K_DIV)
/* y = a/b: da = g/b, db = -g y/b */
static void div_vjp(lg_reverse *r) {
    lg_var over = lg_div(r->tape, r->g, r->in[1]);
    if (r->need[0]) r->out[0] = fold(r, 0, over);
    if (r->need[1]) r->out[1] = lg_neg(r->tape, fold_product(r, 1, over, r->y));
}
static lg_var div_jvp(const lg_forward *f) {
    lg_var a = f->tangents[0], b = LG_NONE;
    if (!lg_is_none(f->tangents[1])) b = lg_neg(f->tape, lg_mul(f->tape, f->y, f->tangents[1]));
    return lg_div(f->tape, lg_add_or(f->tape, a, b), f->in[1]);
}
static lg_scalar div_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s_div(s, x[0], x[1]);
}
static lg_instead div_instead(const lg_known *k) {
    if (other_is(k, 0, 1.0)) return lg_instead_input(0);
    if (k->filled(k->user, 0, 0.0)) return lg_instead_zeros();
    return lg_instead_nothing();
}
const lg_op lg_op_div = {LG_OP("div", 0, 2, 2, broadcast_shape, div_forward, div_vjp, div_jvp),
                         .element = div_element, .instead = div_instead};

/* The mask a >= b. Differentiation treats it as a constant. */
FORWARD(ge, LG_K_GE)
static lg_scalar ge_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s(s, LG_S_GE, x[0], x[1]);
}
const lg_op lg_op_ge = {LG_OP("ge", ~0u, 2, 2, broadcast_shape, ge_forward, lg_no_vjp, lg_zero_jvp),
                        .element = ge_element};

FORWARD(max, LG_K_MAX)
static lg_var mask_of(lg_tape *tape, const lg_var *in) {
    return lg_record(tape, &lg_op_ge, in, 2, NULL);
}
static void max_vjp(lg_reverse *r) {
    lg_var to_a = lg_mul(r->tape, r->g, mask_of(r->tape, r->in));
    if (r->need[0]) r->out[0] = fold(r, 0, to_a);
    if (r->need[1]) r->out[1] = fold(r, 1, lg_sub(r->tape, r->g, to_a));
}
static lg_var max_jvp(const lg_forward *f) {
    lg_var mask = mask_of(f->tape, f->in), a = LG_NONE, b = LG_NONE;
    if (!lg_is_none(f->tangents[0])) a = lg_mul(f->tape, mask, f->tangents[0]);
    if (!lg_is_none(f->tangents[1])) {
        lg_var other = lg_add_scalar(f->tape, lg_neg(f->tape, mask), 1.0);
        b = lg_mul(f->tape, other, f->tangents[1]);
    }
    return lg_add_or(f->tape, a, b);
}
static lg_scalar max_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s(s, LG_S_MAX, x[0], x[1]);
}
const lg_op lg_op_max = {LG_OP("max", 0, 2, 2, broadcast_shape, max_forward, max_vjp, max_jvp),
                         .element = max_element};

#define BINARY(op)                                                                                           \
    lg_var lg_##op(lg_tape *tape, lg_var a, lg_var b) {                                                      \
        return lg_record(tape, &lg_op_##op, (const lg_var[]){a, b}, 2, NULL);                                \
    }
BINARY(add)
BINARY(sub)
BINARY(mul)
BINARY(div)
BINARY(max)

FORWARD(atan2, LG_K_ATAN2)
/* d atan2(a, b) = (B da - A db)/(m (A^2 + B^2)) with A = a/m, B = b/m, for any m. Here m = max(|a|, |b|), as
 * a constant for differentiation, so that no square overflows or underflows. Sets unit to {A, B} and returns
 * g/(m (A^2 + B^2)). */
static lg_var over_square(lg_tape *t, lg_var g, const lg_var *in, lg_var *unit) {
    const lg_var m = lg_stop_gradient(t, lg_max(t, lg_abs(t, in[0]), lg_abs(t, in[1])));
    for (int i = 0; i < 2; i++) unit[i] = lg_div(t, in[i], m);
    const lg_var square = lg_add(t, lg_square(t, unit[0]), lg_square(t, unit[1]));
    return lg_div(t, lg_div(t, g, square), m);
}
static void atan2_vjp(lg_reverse *r) {
    lg_var unit[2];
    const lg_var over = over_square(r->tape, r->g, r->in, unit);
    if (r->need[0]) r->out[0] = fold_product(r, 0, over, unit[1]);
    if (r->need[1]) r->out[1] = lg_neg(r->tape, fold_product(r, 1, over, unit[0]));
}
static lg_var atan2_jvp(const lg_forward *f) {
    lg_var a = LG_NONE, b = LG_NONE, unit[2];
    const lg_var one = lg_full(f->tape, lg_shape0(), 1), over = over_square(f->tape, one, f->in, unit);
    if (!lg_is_none(f->tangents[0])) a = lg_mul(f->tape, f->tangents[0], unit[1]);
    if (!lg_is_none(f->tangents[1])) b = lg_neg(f->tape, lg_mul(f->tape, unit[0], f->tangents[1]));
    return lg_mul(f->tape, over, spread(f, lg_add_or(f->tape, a, b)));
}
static lg_scalar atan2_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s(s, LG_S_ATAN2, x[0], x[1]);
}
const lg_op lg_op_atan2 = {LG_OP("atan2", 0, 2, 2, broadcast_shape, atan2_forward, atan2_vjp, atan2_jvp),
                           .element = atan2_element};

BINARY(atan2)
BINARY(ge)

/* Elementwise operations: binary with broadcasting, unary. */
#include <math.h>

#include "autodiff/op_rows.h"
#include "autodiff/scalars.h"
#include "autodiff/tape_internal.h"

extern const lg_op lg_op_mix, lg_op_pow;

/* ---- broadcasting ---- */

/* Dimension of `shape` at axis i of a rank-`rank` result, aligned at the last axis. */
static uint32_t dim_at(const lg_shape *shape, uint32_t rank, uint32_t i) {
    uint32_t missing = rank - shape->rank;
    return i < missing ? 1 : shape->dims[i - missing];
}

static lg_status broadcast_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                 lg_shape *out) {
    (void)inputs, (void)attr;
    const lg_shape *a = in[0], *b = in[1];
    out->rank = a->rank > b->rank ? a->rank : b->rank;
    for (uint32_t i = 0; i < out->rank; i++) {
        uint32_t da = dim_at(a, out->rank, i), db = dim_at(b, out->rank, i);
        if (da != db && da != 1 && db != 1) return LG_SHAPE;
        out->dims[i] = da == 1 ? db : da;
    }
    return LG_OK;
}

/* A strided loop nest of at most four levels, innermost last; strides in elements. */
typedef struct nest {
    uint32_t levels;
    size_t dims[LG_MAX_RANK], a[LG_MAX_RANK], b[LG_MAX_RANK];
} nest;

/* Levels of length 1 vanish and neighbours that are one run for both operands merge. */
static nest nest_of(const lg_shape *out, const lg_shape *a, const lg_shape *b) {
    nest n = {0};
    size_t stride_a = 1, stride_b = 1;
    size_t dims[LG_MAX_RANK], sa[LG_MAX_RANK], sb[LG_MAX_RANK];
    uint32_t levels = 0; /* innermost first here */
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
    n.levels = LG_MAX_RANK;
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

/* The cotangent or tangent of an input that was broadcast, brought back to its shape. */
static lg_var fold(const lg_reverse *r, uint32_t k, lg_var g) {
    return lg_sum_to(r->tape, g, lg_node_at(r->tape, r->in[k])->shape);
}

/* fold(a * b) for input k: a row-wise dot product when only the last axis was broadcast. */
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

/* Brings a tangent of an input to the output's shape. */
static lg_var spread(const lg_forward *f, lg_var t) {
    return lg_is_none(t) ? t : lg_broadcast_to(f->tape, t, lg_node_at(f->tape, f->y)->shape);
}

/* ---- binary ---- */

/* Whether input k has the output's shape and the other one is filled with a number. */
static bool other_is(const lg_known *k, uint32_t input, double with) {
    return lg_same_shape(k->in[input], k->shape) && k->filled(k->user, 1 - input, with);
}

static lg_status add_forward(lg_evaluation *e) {
    return binary_forward(e, LG_K_ADD);
}
static void add_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = fold(r, 0, r->g);
    if (r->need[1]) r->out[1] = fold(r, 1, r->g);
}
static lg_var add_jvp(const lg_forward *f) {
    return lg_add_or(f->tape, spread(f, f->tangents[0]), spread(f, f->tangents[1]));
}
static lg_scalar add_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    (void)attr, (void)inputs;
    return lg_s_add(s, x[0], x[1]);
}
static lg_instead add_instead(const lg_known *k) {
    if (other_is(k, 0, 0.0)) return lg_instead_input(0);
    if (other_is(k, 1, 0.0)) return lg_instead_input(1);
    return lg_instead_nothing();
}
const lg_op lg_op_add = {LG_OP("add", 0, 2, 2, broadcast_shape, add_forward, add_vjp, add_jvp),
                         .element = add_element, .instead = add_instead};

static lg_status sub_forward(lg_evaluation *e) {
    return binary_forward(e, LG_K_SUB);
}
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
    (void)attr, (void)inputs;
    return lg_s_sub(s, x[0], x[1]);
}
static lg_instead sub_instead(const lg_known *k) {
    if (other_is(k, 0, 0.0)) return lg_instead_input(0);
    return lg_instead_nothing();
}
const lg_op lg_op_sub = {LG_OP("sub", 0, 2, 2, broadcast_shape, sub_forward, sub_vjp, sub_jvp),
                         .element = sub_element, .instead = sub_instead};

static lg_status mul_forward(lg_evaluation *e) {
    return binary_forward(e, LG_K_MUL);
}
static void mul_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = fold_product(r, 0, r->g, r->in[1]);
    if (r->need[1]) r->out[1] = fold_product(r, 1, r->g, r->in[0]);
}
static lg_var mul_jvp(const lg_forward *f) {
    lg_var a = LG_NONE, b = LG_NONE;
    if (!lg_is_none(f->tangents[0])) a = lg_mul(f->tape, f->tangents[0], f->in[1]);
    if (!lg_is_none(f->tangents[1])) b = lg_mul(f->tape, f->in[0], f->tangents[1]);
    return lg_add_or(f->tape, a, b);
}
static lg_scalar mul_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    (void)attr, (void)inputs;
    return lg_s_mul(s, x[0], x[1]);
}
static lg_instead mul_instead(const lg_known *k) {
    if (other_is(k, 0, 1.0)) return lg_instead_input(0);
    if (other_is(k, 1, 1.0)) return lg_instead_input(1);
    if (k->filled(k->user, 0, 0.0) || k->filled(k->user, 1, 0.0)) return lg_instead_zeros();
    return lg_instead_nothing();
}
const lg_op lg_op_mul = {LG_OP("mul", 0, 2, 2, broadcast_shape, mul_forward, mul_vjp, mul_jvp),
                         .element = mul_element, .instead = mul_instead};

static lg_status div_forward(lg_evaluation *e) {
    return binary_forward(e, LG_K_DIV);
}
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
    (void)attr, (void)inputs;
    return lg_s_div(s, x[0], x[1]);
}
static lg_instead div_instead(const lg_known *k) {
    if (other_is(k, 0, 1.0)) return lg_instead_input(0);
    if (k->filled(k->user, 0, 0.0)) return lg_instead_zeros();
    return lg_instead_nothing();
}
const lg_op lg_op_div = {LG_OP("div", 0, 2, 2, broadcast_shape, div_forward, div_vjp, div_jvp),
                         .element = div_element, .instead = div_instead};

/* The mask a >= b, a frozen constant. */
static lg_status ge_forward(lg_evaluation *e) {
    return binary_forward(e, LG_K_GE);
}
static lg_scalar ge_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    (void)attr, (void)inputs;
    return lg_s(s, LG_S_GE, x[0], x[1]);
}
const lg_op lg_op_ge = {LG_OP("ge", ~0u, 2, 2, broadcast_shape, ge_forward, lg_no_vjp, lg_zero_jvp),
                        .element = ge_element};

static lg_status max_forward(lg_evaluation *e) {
    return binary_forward(e, LG_K_MAX);
}
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
    (void)attr, (void)inputs;
    return lg_s(s, LG_S_MAX, x[0], x[1]);
}
const lg_op lg_op_max = {LG_OP("max", 0, 2, 2, broadcast_shape, max_forward, max_vjp, max_jvp),
                         .element = max_element};

static lg_var binary(lg_tape *tape, const lg_op *op, lg_var a, lg_var b) {
    lg_var in[2] = {a, b};
    return lg_record(tape, op, in, 2, NULL);
}
lg_var lg_add(lg_tape *tape, lg_var a, lg_var b) {
    return binary(tape, &lg_op_add, a, b);
}
lg_var lg_sub(lg_tape *tape, lg_var a, lg_var b) {
    return binary(tape, &lg_op_sub, a, b);
}
lg_var lg_mul(lg_tape *tape, lg_var a, lg_var b) {
    return binary(tape, &lg_op_mul, a, b);
}
lg_var lg_div(lg_tape *tape, lg_var a, lg_var b) {
    return binary(tape, &lg_op_div, a, b);
}
lg_var lg_max(lg_tape *tape, lg_var a, lg_var b) {
    return binary(tape, &lg_op_max, a, b);
}

static lg_status atan2_forward(lg_evaluation *e) {
    return binary_forward(e, LG_K_ATAN2);
}
/* d atan2(a, b) = (b da - a db)/(a^2 + b^2) */
static lg_var over_square(lg_tape *t, lg_var g, const lg_var *in) {
    return lg_div(t, g, lg_add(t, lg_square(t, in[0]), lg_square(t, in[1])));
}
static void atan2_vjp(lg_reverse *r) {
    const lg_var over = over_square(r->tape, r->g, r->in);
    if (r->need[0]) r->out[0] = fold_product(r, 0, over, r->in[1]);
    if (r->need[1]) r->out[1] = lg_neg(r->tape, fold_product(r, 1, over, r->in[0]));
}
static lg_var atan2_jvp(const lg_forward *f) {
    lg_var a = LG_NONE, b = LG_NONE;
    if (!lg_is_none(f->tangents[0])) a = lg_mul(f->tape, f->tangents[0], f->in[1]);
    if (!lg_is_none(f->tangents[1])) b = lg_neg(f->tape, lg_mul(f->tape, f->in[0], f->tangents[1]));
    return over_square(f->tape, spread(f, lg_add_or(f->tape, a, b)), f->in);
}
static lg_scalar atan2_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    (void)attr, (void)inputs;
    return lg_s(s, LG_S_ATAN2, x[0], x[1]);
}
const lg_op lg_op_atan2 = {LG_OP("atan2", 0, 2, 2, broadcast_shape, atan2_forward, atan2_vjp, atan2_jvp),
                           .element = atan2_element};

lg_var lg_atan2(lg_tape *tape, lg_var a, lg_var b) {
    return binary(tape, &lg_op_atan2, a, b);
}
lg_var lg_ge(lg_tape *tape, lg_var a, lg_var b) {
    return binary(tape, &lg_op_ge, a, b);
}

/* ---- y = c != 0 ? a : b, equal shapes ---- */

static lg_status three_alike(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    (void)inputs, (void)attr;
    if (!lg_same_shape(in[0], in[1]) || !lg_same_shape(in[0], in[2])) return LG_SHAPE;
    *out = *in[0];
    return LG_OK;
}
static lg_status select_forward(lg_evaluation *e) {
    e->k->select(e->count, e->x[0], e->x[1], e->x[2], e->y);
    return LG_OK;
}
/* What is not chosen gets 0, whatever its derivative is. */
static void select_vjp(lg_reverse *r) {
    const lg_var zero = lg_zeros_like(r->tape, r->g);
    if (r->need[1]) r->out[1] = lg_select(r->tape, r->in[0], r->g, zero);
    if (r->need[2]) r->out[2] = lg_select(r->tape, r->in[0], zero, r->g);
}
static lg_var select_jvp(const lg_forward *f) {
    const lg_var zero = lg_zeros_like(f->tape, f->y);
    return lg_select(f->tape, f->in[0], lg_is_none(f->tangents[1]) ? zero : f->tangents[1],
                     lg_is_none(f->tangents[2]) ? zero : f->tangents[2]);
}
static lg_scalar select_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    (void)attr, (void)inputs;
    return lg_s_select(s, x[0], x[1], x[2]);
}
const lg_op lg_op_select = {LG_OP("select", 1u, 3, 3, three_alike, select_forward, select_vjp, select_jvp),
                            .element = select_element};

lg_var lg_select(lg_tape *tape, lg_var condition, lg_var yes, lg_var no) {
    const lg_var in[3] = {condition, yes, no};
    return lg_record(tape, &lg_op_select, in, 3, NULL);
}

/* ---- y = (1 - z) u + z v ---- */

static lg_status mix_forward(lg_evaluation *e) {
    e->k->mix(e->count, e->x[0], e->x[1], e->x[2], e->y);
    return LG_OK;
}

/* dz = g (v - u), du = g (1 - z) = g - dv, dv = g z */
static void mix_vjp(lg_reverse *r) {
    lg_tape *t = r->tape;
    if (lg_reverse_in_place(r)) {
        lg_reverse_three(r, t->k->mix_reverse, lg_node_at(t, r->y)->count);
        return;
    }
    if (r->need[0]) r->out[0] = lg_mul(t, r->g, lg_sub(t, r->in[2], r->in[1]));
    if (!r->need[1] && !r->need[2]) return;
    const lg_var to_v = lg_mul(t, r->g, r->in[0]);
    if (r->need[1]) r->out[1] = lg_sub(t, r->g, to_v);
    if (r->need[2]) r->out[2] = to_v;
}

static lg_var mix_jvp(const lg_forward *f) {
    lg_tape *t = f->tape;
    lg_var from_z = LG_NONE, from_u = LG_NONE, from_v = LG_NONE;
    if (!lg_is_none(f->tangents[0])) from_z = lg_mul(t, f->tangents[0], lg_sub(t, f->in[2], f->in[1]));
    if (!lg_is_none(f->tangents[1]))
        from_u = lg_mul(t, f->tangents[1], lg_add_scalar(t, lg_neg(t, f->in[0]), 1.0));
    if (!lg_is_none(f->tangents[2])) from_v = lg_mul(t, f->tangents[2], f->in[0]);
    return lg_add_or(t, from_z, lg_add_or(t, from_u, from_v));
}

static lg_scalar mix_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    (void)attr, (void)inputs;
    return lg_s_add(s, lg_s_mul(s, lg_s_sub(s, lg_s_constant(s, 1.0), x[0]), x[1]), lg_s_mul(s, x[0], x[2]));
}
const lg_op lg_op_mix = {LG_OP("mix", 0, 3, 3, three_alike, mix_forward, mix_vjp, mix_jvp),
                         .element = mix_element};

lg_var lg_lerp(lg_tape *tape, lg_var z, lg_var u, lg_var v) {
    const lg_var in[3] = {z, u, v};
    return lg_record(tape, &lg_op_mix, in, 3, NULL);
}

/* ---- linear combination; attr.pointer = coefficients (payload) ---- */

static lg_status combine_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                               lg_shape *out) {
    (void)attr;
    if (inputs == 0) return LG_INVALID_ARGUMENT;
    for (uint32_t i = 1; i < inputs; i++)
        if (!lg_same_shape(in[0], in[i])) return LG_SHAPE;
    *out = *in[0];
    return LG_OK;
}

static lg_status combine_forward(lg_evaluation *e) {
    const double *c = e->attr->pointer;
    e->k->unary[LG_K_SCALE](e->count, c[0], e->x[0], e->y);
    for (uint32_t i = 1; i < e->inputs; i++) e->k->axpy(e->count, c[i], e->x[i], e->y);
    return LG_OK;
}

static void combine_vjp(lg_reverse *r) {
    const double *c = r->attr->pointer;
    for (uint32_t k = 0; k < r->inputs; k++)
        if (r->need[k]) r->out[k] = lg_scale(r->tape, r->g, c[k]);
}

static lg_var combine_jvp(const lg_forward *f) {
    const double *c = f->attr->pointer;
    lg_var total = LG_NONE;
    for (uint32_t k = 0; k < f->inputs; k++)
        if (!lg_is_none(f->tangents[k]))
            total = lg_add_or(f->tape, total, lg_scale(f->tape, f->tangents[k], c[k]));
    return total;
}

static lg_scalar combine_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    const double *c = attr->pointer;
    lg_scalar total = lg_s_scale(s, c[0], x[0]);
    for (uint32_t k = 1; k < inputs; k++) total = lg_s_add(s, total, lg_s_scale(s, c[k], x[k]));
    return total;
}
const lg_op lg_op_combine = {
    LG_OP("combine", 0, 1, LG_MAX_INPUTS, combine_shape, combine_forward, combine_vjp, combine_jvp),
    .payload = LG_PAYLOAD_REALS, .element = combine_element, .over_first = true};

lg_var lg_linear_combination(lg_tape *tape, const lg_var *x, const double *c, size_t n) {
    if (tape->status != LG_OK) return LG_NONE;
    if (n == 0 || n > LG_MAX_INPUTS)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "combine", "the number of terms is not in 1..64");
    double *kept = lg_payload_allocate(tape, n * sizeof *kept);
    if (kept == NULL) return LG_NONE;
    for (size_t i = 0; i < n; i++) kept[i] = c[i];
    lg_attr attr = {.pointer = kept};
    return lg_record(tape, &lg_op_combine, x, (uint32_t)n, &attr);
}

/* ---- unary: f'(x) is named by each row through its vjp ---- */

static lg_status same_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    (void)inputs, (void)attr;
    *out = *in[0];
    return LG_OK;
}

static lg_var unary(lg_tape *tape, const lg_op *op, lg_var x, double c) {
    lg_attr attr = {.c = c};
    return lg_record(tape, op, &x, 1, &attr);
}

/* X(name, kernel, the c with which it does nothing, scalar code, derivative times g): the derivative is an
 * expression in t (tape), x (input), y (output), c and g; it serves the vjp and the jvp, for an elementwise
 * Jacobian is its own transpose. */
#define UNARY_LIST(X)                                                                                        \
    X(scale, LG_K_SCALE, 1.0, lg_s_scale(s, c, x), lg_scale(t, g, c))                                        \
    X(shift, LG_K_SHIFT, 0.0, lg_s_add(s, x, lg_s_constant(s, c)), g)                                        \
    X(sqrt, LG_K_SQRT, NAN, lg_s(s, LG_S_SQRT, x, x), lg_scale(t, lg_div(t, g, y), 0.5))                     \
    X(exp, LG_K_EXP, NAN, lg_s(s, LG_S_EXP, x, x), lg_mul(t, g, y))                                          \
    X(log, LG_K_LOG, NAN, lg_s(s, LG_S_LOG, x, x), lg_div(t, g, x))                                          \
    X(sin, LG_K_SIN, NAN, lg_s(s, LG_S_SIN, x, x), lg_mul(t, g, lg_cos(t, x)))                               \
    X(cos, LG_K_COS, NAN, lg_s(s, LG_S_COS, x, x), lg_neg(t, lg_mul(t, g, lg_sin(t, x))))                    \
    X(abs, LG_K_ABS, NAN, lg_s(s, LG_S_ABS, x, x), lg_mul(t, g, lg_sign(t, x)))

#define DEFINE_UNARY(name, kernel, idle, scalar, derivative)                                                 \
    static lg_status name##_forward(lg_evaluation *e) {                                                      \
        e->k->unary[kernel](e->count, e->attr->c, e->x[0], e->y);                                            \
        return LG_OK;                                                                                        \
    }                                                                                                        \
    static lg_var name##_times(lg_tape *t, lg_var x, lg_var y, double c, lg_var g) {                         \
        (void)t, (void)x, (void)y, (void)c;                                                                  \
        return derivative;                                                                                   \
    }                                                                                                        \
    static lg_scalar name##_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *in,                 \
                                    uint32_t inputs) {                                                       \
        const lg_scalar x = in[0];                                                                           \
        const double c = attr->c;                                                                            \
        (void)c, (void)inputs;                                                                               \
        return scalar;                                                                                       \
    }                                                                                                        \
    static lg_instead name##_instead(const lg_known *known) {                                                \
        return known->attr->c == idle ? lg_instead_input(0) : lg_instead_nothing();                          \
    }                                                                                                        \
    static void name##_vjp(lg_reverse *r) {                                                                  \
        if (r->need[0]) r->out[0] = name##_times(r->tape, r->in[0], r->y, r->attr->c, r->g);                 \
    }                                                                                                        \
    static lg_var name##_jvp(const lg_forward *f) {                                                          \
        return name##_times(f->tape, f->in[0], f->y, f->attr->c, f->tangents[0]);                            \
    }                                                                                                        \
    const lg_op lg_op_##name = {LG_OP(#name, 0, 1, 1, same_shape, name##_forward, name##_vjp, name##_jvp),   \
                                .element = name##_element, .instead = name##_instead};
UNARY_LIST(DEFINE_UNARY)

static lg_status pow_forward(lg_evaluation *e) {
    if (e->attr->c == 2.0)
        e->k->binary[LG_K_MUL](e->count, e->x[0], e->x[0], e->y);
    else
        e->k->unary[LG_K_POW](e->count, e->attr->c, e->x[0], e->y);
    return LG_OK;
}
/* c x^(c-1) g, exact zeros for c = 0, no powers for c = 1 and 2 */
static lg_var pow_times(lg_tape *t, lg_var x, double c, lg_var g) {
    if (c == 0.0) return lg_scale(t, g, 0.0);
    if (c == 1.0) return g;
    return lg_scale(t, lg_mul(t, g, c == 2.0 ? x : lg_pow(t, x, c - 1.0)), c);
}
static void pow_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = pow_times(r->tape, r->in[0], r->attr->c, r->g);
}
static lg_var pow_jvp(const lg_forward *f) {
    return pow_times(f->tape, f->in[0], f->attr->c, f->tangents[0]);
}
static lg_scalar pow_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    (void)inputs;
    return lg_s_pow(s, x[0], attr->c);
}
const lg_op lg_op_pow = {LG_OP("pow", 0, 1, 1, same_shape, pow_forward, pow_vjp, pow_jvp),
                         .element = pow_element};

static lg_status sign_forward(lg_evaluation *e) {
    e->k->unary[LG_K_SIGN](e->count, 0.0, e->x[0], e->y);
    return LG_OK;
}
static lg_scalar sign_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    (void)attr, (void)inputs;
    return lg_s(s, LG_S_SIGN, x[0], x[0]);
}
const lg_op lg_op_sign = {LG_OP("sign", ~0u, 1, 1, same_shape, sign_forward, lg_no_vjp, lg_zero_jvp),
                          .element = sign_element};

static lg_status copy_forward(lg_evaluation *e) {
    e->k->unary[LG_K_SCALE](e->count, 1.0, e->x[0], e->y);
    return LG_OK;
}
static lg_scalar stop_gradient_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x,
                                       uint32_t inputs) {
    (void)s, (void)attr, (void)inputs;
    return x[0];
}
static lg_instead stop_gradient_instead(const lg_known *k) {
    (void)k;
    return lg_instead_input(0);
}
const lg_op lg_op_stop_gradient = {
    LG_OP("stop_gradient", ~0u, 1, 1, same_shape, copy_forward, lg_no_vjp, lg_zero_jvp),
    .element = stop_gradient_element, .instead = stop_gradient_instead};

lg_var lg_neg(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_scale, x, -1.0);
}
lg_var lg_scale(lg_tape *tape, lg_var x, double c) {
    return unary(tape, &lg_op_scale, x, c);
}
lg_var lg_add_scalar(lg_tape *tape, lg_var x, double c) {
    return unary(tape, &lg_op_shift, x, c);
}
lg_var lg_pow(lg_tape *tape, lg_var x, double exponent) {
    return unary(tape, &lg_op_pow, x, exponent);
}
lg_var lg_square(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_pow, x, 2.0);
}
lg_var lg_sqrt(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_sqrt, x, 0.0);
}
lg_var lg_exp(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_exp, x, 0.0);
}
lg_var lg_log(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_log, x, 0.0);
}
lg_var lg_sin(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_sin, x, 0.0);
}
lg_var lg_cos(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_cos, x, 0.0);
}
lg_var lg_abs(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_abs, x, 0.0);
}
lg_var lg_sign(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_sign, x, 0.0);
}
lg_var lg_stop_gradient(lg_tape *tape, lg_var x) {
    return unary(tape, &lg_op_stop_gradient, x, 0.0);
}

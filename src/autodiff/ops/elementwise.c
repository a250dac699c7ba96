/* Elementwise operations of inputs with equal shapes. */
#include <math.h>

#include "autodiff/ops/op_rows.h"
#include "autodiff/program/scalars.h"
#include "autodiff/tape/tape_internal.h"

extern const lg_op lg_op_mix, lg_op_pow;

/* ---- select: y = c != 0 ? a : b ---- */

static lg_status three_alike(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    if (!lg_same_shape(in[0], in[1]) || !lg_same_shape(in[0], in[2])) return LG_SHAPE;
    *out = *in[0];
    return LG_OK;
}
static lg_status select_forward(lg_evaluation *e) {
    e->k->select(e->count, e->x[0], e->x[1], e->x[2], e->y);
    return LG_OK;
}
/* The branch that is not chosen gets exactly 0, even if its derivative is infinite or NaN. */
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
    return lg_s_select(s, x[0], x[1], x[2]);
}
const lg_op lg_op_select = {LG_OP("select", 1u, 3, 3, three_alike, select_forward, select_vjp, select_jvp),
                            .element = select_element};

lg_var lg_select(lg_tape *tape, lg_var condition, lg_var yes, lg_var no) {
    const lg_var in[3] = {condition, yes, no};
    return lg_record(tape, &lg_op_select, in, 3, NULL);
}

/* ---- mix: y = (1 - z) u + z v ---- */

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
    const lg_var *d = f->tangents;
    lg_var from_z = LG_NONE, rest = LG_NONE;
    if (!lg_is_none(d[0])) from_z = lg_mul(t, d[0], lg_sub(t, f->in[2], f->in[1]));
    if (!lg_is_none(d[1]) && !lg_is_none(d[2]))
        rest = lg_lerp(t, f->in[0], d[1], d[2]);
    else if (!lg_is_none(d[2]))
        rest = lg_mul(t, d[2], f->in[0]);
    else if (!lg_is_none(d[1]))
        rest = lg_mul(t, d[1], lg_add_scalar(t, lg_neg(t, f->in[0]), 1.0));
    return lg_add_or(t, from_z, rest);
}

static lg_scalar mix_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
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

/* ---- unary operations; attr.c is a number that scale, shift and pow use ---- */

static lg_status same_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    *out = *in[0];
    return LG_OK;
}

static lg_var unary(lg_tape *tape, const lg_op *op, lg_var x, double c) {
    lg_attr attr = {.c = c};
    return lg_record(tape, op, &x, 1, &attr);
}

/* X(name, kernel, the value of c for which the operation is the identity (NAN: none), scalar code, derivative
 * times g). The derivative is an expression in t (tape), x (input), y (output), c and g. It serves both vjp
 * and jvp, because the Jacobian of an elementwise operation is symmetric. */
#define UNARY_LIST(X)                                                                                        \
    X(scale, LG_K_SCALE, 1.0, lg_s_scale(s, c, x), lg_scale(t, g, c))                                        \
    X(shift, LG_K_SHIFT, 0.0, lg_s_add(s, x, lg_s_constant(s, c)), g)                                        \
    X(sqrt, LG_K_SQRT, NAN, lg_s(s, LG_S_SQRT, x, x), lg_scale(t, lg_div(t, g, y), 0.5))                     \
    X(exp, LG_K_EXP, NAN, lg_s(s, LG_S_EXP, x, x), lg_mul(t, g, y))                                          \
    X(log, LG_K_LOG, NAN, lg_s(s, LG_S_LOG, x, x), lg_div(t, g, x))                                          \
    X(sin, LG_K_SIN, NAN, lg_s(s, LG_S_SIN, x, x), lg_mul(t, g, lg_cos(t, x)))                               \
    X(cos, LG_K_COS, NAN, lg_s(s, LG_S_COS, x, x), lg_neg(t, lg_mul(t, g, lg_sin(t, x))))                    \
    X(abs, LG_K_ABS, NAN, lg_s(s, LG_S_ABS, x, x), lg_mul(t, g, lg_sign(t, x)))

/* The input itself, if the number of the operation is `idle`. */
static lg_instead instead_where(const lg_known *known, double idle) {
    return known->attr->c == idle ? lg_instead_input(0) : lg_instead_nothing();
}

#define DEFINE_UNARY(name, kernel, idle, scalar, derivative)                                                 \
    static lg_status name##_forward(lg_evaluation *e) {                                                      \
        e->k->unary[kernel](e->count, e->attr->c, e->x[0], e->y);                                            \
        return LG_OK;                                                                                        \
    }                                                                                                        \
    static lg_var name##_times(lg_tape *t, lg_var x, lg_var y, double c, lg_var g) {                         \
        return derivative;                                                                                   \
    }                                                                                                        \
    static lg_scalar name##_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *in,                 \
                                    uint32_t inputs) {                                                       \
        const lg_scalar x = in[0];                                                                           \
        const double c = attr->c;                                                                            \
        (void)c;                                                                                             \
        return scalar;                                                                                       \
    }                                                                                                        \
    static lg_instead name##_instead(const lg_known *known) {                                                \
        return instead_where(known, idle);                                                                   \
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
/* c x^(c-1) g: exact zeros for c = 0, and no call of pow for c = 1 and c = 2. For c < 1/2 the difference
 * c - 1 is rounded to a: x^(c-1) = x^a x^rest, and rest < 0 gives the right limits at 0 and infinity. */
static lg_var pow_times(lg_tape *t, lg_var x, double c, lg_var g) {
    double a = c - 1.0, one = c - a, rest = (c - (a + one)) - (1.0 - one);
    if (c == 0.0) return lg_scale(t, g, 0.0);
    if (c == 1.0) return g;
    if (rest > 0.0) rest -= nextafter(a, 0.0) - a, a = nextafter(a, 0.0);
    if (rest != 0.0) g = lg_mul(t, g, lg_pow(t, x, rest));
    return lg_scale(t, lg_mul(t, g, c == 2.0 ? x : lg_pow(t, x, a)), c);
}
static void pow_vjp(lg_reverse *r) {
    if (r->need[0]) r->out[0] = pow_times(r->tape, r->in[0], r->attr->c, r->g);
}
static lg_var pow_jvp(const lg_forward *f) {
    return pow_times(f->tape, f->in[0], f->attr->c, f->tangents[0]);
}
static lg_scalar pow_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    return lg_s_pow(s, x[0], attr->c);
}
const lg_op lg_op_pow = {LG_OP("pow", 0, 1, 1, same_shape, pow_forward, pow_vjp, pow_jvp),
                         .element = pow_element};

static lg_status sign_forward(lg_evaluation *e) {
    e->k->unary[LG_K_SIGN](e->count, 0.0, e->x[0], e->y);
    return LG_OK;
}
static lg_scalar sign_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
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
    return lg_s_stopped(s, x[0]);
}
static lg_instead stop_gradient_instead(const lg_known *k) {
    return lg_instead_input(0);
}
const lg_op lg_op_stop_gradient = {
    LG_OP("stop_gradient", ~0u, 1, 1, same_shape, copy_forward, lg_no_vjp, lg_zero_jvp),
    .element = stop_gradient_element, .instead = stop_gradient_instead};

/* The functions of liegrad/ops.h that record one of these operations: of x and a number, and of x alone. */
#define WITH_NUMBER(name, op)                                                                                \
    lg_var name(lg_tape *tape, lg_var x, double c) {                                                         \
        return unary(tape, &lg_op_##op, x, c);                                                               \
    }
#define ALONE(name, op, c)                                                                                   \
    lg_var name(lg_tape *tape, lg_var x) {                                                                   \
        return unary(tape, &lg_op_##op, x, c);                                                               \
    }
WITH_NUMBER(lg_scale, scale)
WITH_NUMBER(lg_add_scalar, shift)
WITH_NUMBER(lg_pow, pow)
ALONE(lg_neg, scale, -1.0)
ALONE(lg_square, pow, 2.0)
ALONE(lg_sqrt, sqrt, 0.0)
ALONE(lg_exp, exp, 0.0)
ALONE(lg_log, log, 0.0)
ALONE(lg_sin, sin, 0.0)
ALONE(lg_cos, cos, 0.0)
ALONE(lg_abs, abs, 0.0)
ALONE(lg_sign, sign, 0.0)
ALONE(lg_stop_gradient, stop_gradient, 0.0)

/* Activations, a family of operations that is closed under differentiation.
 *
 * ACT(x; kind) is the activation. ACT_DERIVATIVE(x, h[, g]; kind, n) is its n-th derivative at x, times g if
 * given. It is computed from the stored helper h: the activation's value for tanh, sigmoid and the ReLUs, the
 * sigmoid of x for swish. Differentiation treats h as a constant. The derivative of ACT_DERIVATIVE with
 * respect to x is ACT_DERIVATIVE with n + 1. */
#include "autodiff/ops/op_rows.h"
#include "autodiff/program/scalars.h"
#include "autodiff/tape/tape_internal.h"
#include "kernels/act_zeros.h"

static const char *const names[LG_ACTIVATION_COUNT] = {"identity", "tanh",       "sigmoid", "swish",
                                                       "relu",     "leaky-relu", "sine"};

const char *lg_activation_name(lg_activation kind) {
    return (unsigned)kind < LG_ACTIVATION_COUNT ? names[kind] : "unknown";
}

_Static_assert((int)LG_K_IDENTITY == (int)LG_IDENTITY && (int)LG_K_TANH == (int)LG_TANH &&
                   (int)LG_K_SIGMOID == (int)LG_SIGMOID && (int)LG_K_SWISH == (int)LG_SWISH &&
                   (int)LG_K_RELU == (int)LG_RELU && (int)LG_K_LEAKY_RELU == (int)LG_LEAKY_RELU &&
                   (int)LG_K_SINE == (int)LG_SINE && (int)LG_K_ACTS == LG_ACTIVATION_COUNT,
               "kinds are handed to the kernels as they are");

/* The value from which derivatives are computed. */
typedef enum helper { HELPER_NONE, HELPER_VALUE, HELPER_SIGMOID } helper;
static const helper helpers[LG_ACTIVATION_COUNT] = {HELPER_NONE,  HELPER_VALUE, HELPER_VALUE, HELPER_SIGMOID,
                                                    HELPER_VALUE, HELPER_VALUE, HELPER_NONE};

static lg_status act_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr, lg_shape *out) {
    if (attr->i[0] >= LG_ACTIVATION_COUNT) return LG_INVALID_ARGUMENT;
    if (attr->i[1] > LG_K_ACT_ORDERS) return LG_NOT_DIFFERENTIABLE;
    *out = *in[0];
    return LG_OK;
}

/* ---- scalar code ---- */

/* y prod_k (h^2 - z_k), where z_k are the zeros and to = 1 - h^2; the same factorisation as in act.inc. */
static lg_scalar times_zeros(lg_scalars *s, uint32_t order, lg_scalar h, lg_scalar to, lg_scalar y) {
    for (uint32_t k = 0; k < (order - 1) / 2; k++) {
        const double zero = lg_act_zeros[order][k];
        const lg_scalar from = zero > 0 ? lg_s_mul(s, h, h) : lg_s_neg(s, to);
        y = lg_s_mul(s, y, lg_s_sub(s, from, lg_s_constant(s, zero)));
    }
    return y;
}

/* x > 0 ? yes : no; `yes` if x is NaN. */
static lg_scalar where_positive(lg_scalars *s, lg_scalar x, lg_scalar yes, lg_scalar no) {
    return lg_s_select(s, lg_s(s, LG_S_GE, lg_s_constant(s, 0.0), x), no, yes);
}

static lg_scalar tanh_code(lg_scalars *s, lg_scalar h, uint32_t order) {
    const lg_scalar one = lg_s_constant(s, 1.0), factor = lg_s_constant(s, lg_act_factorial[order]);
    const lg_scalar first = lg_s_mul(s, lg_s_sub(s, one, h), lg_s_add(s, one, h));
    const lg_scalar odd = order % 2 == 0 ? lg_s_mul(s, lg_s_neg(s, h), factor) : factor;
    return lg_s_mul(s, first, times_zeros(s, order, h, first, odd));
}

static lg_scalar sigmoid_code(lg_scalars *s, lg_scalar v, uint32_t order) {
    if (order == 0) return v;
    const lg_scalar one = lg_s_constant(s, 1.0), first = lg_s_mul(s, v, lg_s_sub(s, one, v));
    const lg_scalar h = lg_s_sub(s, one, lg_s_scale(s, 2.0, v));
    const lg_scalar factor = lg_s_constant(s, lg_act_factorial[order] / (double)(1u << (order - 1)));
    const lg_scalar odd = order % 2 == 0 ? lg_s_mul(s, h, factor) : factor;
    return lg_s_mul(s, first, times_zeros(s, order, h, lg_s_scale(s, 4.0, first), odd));
}

static lg_scalar kink_code(lg_scalars *s, lg_scalar x, double slope, uint32_t order) {
    const lg_scalar one = lg_s_constant(s, 1.0), lower = lg_s_constant(s, slope);
    /* For intervals, as a maximum: a choice would count as a jump. */
    if (order == 0 && s->level_of != NULL) return lg_s(s, LG_S_MAX, x, lg_s_mul(s, lower, x));
    if (order == 0) return where_positive(s, x, x, lg_s_mul(s, lower, x));
    return order == 1 ? where_positive(s, x, one, lower) : lg_s_constant(s, 0.0);
}

static lg_scalar sine_code(lg_scalars *s, lg_scalar x, uint32_t order) {
    const lg_scalar y = lg_s(s, order % 2 == 0 ? LG_S_SIN : LG_S_COS, x, x);
    return order % 4 < 2 ? y : lg_s_neg(s, y);
}

/* sigma^(order)(x). h is the helper for kinds that have one; the ReLUs also work without it (has_h). */
static lg_scalar derivative_code(lg_scalars *s, uint32_t kind, uint32_t order, lg_scalar x, lg_scalar h,
                                 bool has_h) {
    switch ((lg_activation)kind) {
    case LG_TANH:
        return order == 0 ? h : tanh_code(s, h, order);
    case LG_SIGMOID:
        return sigmoid_code(s, h, order);
    case LG_SWISH:
        if (order == 0) return lg_s_mul(s, x, h);
        return lg_s_add(s, lg_s_mul(s, x, sigmoid_code(s, h, order)),
                        lg_s_scale(s, order, sigmoid_code(s, h, order - 1)));
    case LG_RELU:
        return order == 0 && has_h ? h : kink_code(s, has_h ? h : x, 0.0, order);
    case LG_LEAKY_RELU:
        return order == 0 && has_h ? h : kink_code(s, has_h ? h : x, LG_LEAKY_SLOPE, order);
    case LG_SINE:
        return sine_code(s, x, order);
    case LG_IDENTITY:
        break;
    }
    return order == 0 ? x : lg_s_constant(s, order == 1 ? 1.0 : 0.0);
}

static lg_scalar derivative_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    const lg_scalar y = derivative_code(s, attr->i[0], attr->i[1], x[0], x[1], attr->i[2] != 0);
    return inputs > 2 ? lg_s_mul(s, y, x[2]) : y;
}

static lg_scalar act_element(lg_scalars *s, const lg_attr *attr, const lg_scalar *x, uint32_t inputs) {
    lg_scalar h = x[0];
    if (attr->i[0] == LG_TANH) h = lg_s(s, LG_S_TANH, x[0], x[0]);
    if (attr->i[0] == LG_SIGMOID || attr->i[0] == LG_SWISH) h = lg_s(s, LG_S_SIGMOID, x[0], x[0]);
    return derivative_code(s, attr->i[0], 0, x[0], h, false);
}

/* ---- derivatives ---- */

/* g * sigma^(order)(x) with the helper h of this kind. g and h may be LG_NONE. */
static lg_var derivative(lg_tape *tape, lg_var x, lg_var h, lg_var g, uint32_t kind, uint32_t order) {
    lg_attr attr = {.i = {kind, order, !lg_is_none(h), !lg_is_none(g)}};
    lg_var in[3] = {x};
    uint32_t n = 1;
    /* Without a helper, x fills its place, so that the bit of input 1 in `frozen` always means the helper. */
    in[n++] = lg_is_none(h) ? x : h;
    if (!lg_is_none(g)) in[n++] = g;
    return lg_record(tape, &lg_op_act_derivative, in, n, &attr);
}

static lg_status derivative_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                  lg_shape *out) {
    const lg_status status = act_shape(in, inputs, attr, out);
    if (status != LG_OK) return status;
    const helper from = helpers[attr->i[0]];
    const bool kink = attr->i[0] == LG_RELU || attr->i[0] == LG_LEAKY_RELU;
    if (inputs != (attr->i[3] != 0 ? 3u : 2u) || (attr->i[2] == 0 && from != HELPER_NONE && !kink))
        return LG_INVALID_ARGUMENT;
    for (uint32_t i = 1; i < inputs; i++)
        if (!lg_same_shape(in[0], in[i])) return LG_SHAPE;
    return LG_OK;
}

/* Input x is not read when the helper is the activation's value; without a helper, input 1 is not read. */
static uint32_t derivative_unread(const lg_attr *attr, uint32_t inputs) {
    if (attr->i[2] == 0) return 2u;
    return helpers[attr->i[0]] == HELPER_VALUE ? 1u : 0u;
}

static lg_status derivative_forward(lg_evaluation *e) {
    const void *x =
        /* A tape passes x even when it must not be read. */
        derivative_unread(e->attr, e->inputs) & 1u ? NULL : e->x[0];
    e->k->act((lg_k_act)e->attr->i[0], (int)e->attr->i[1], e->count, x, e->attr->i[2] ? e->x[1] : NULL,
              e->attr->i[3] ? e->x[2] : NULL, e->y);
    return LG_OK;
}

static bool derivative_factor(const lg_attr *attr, uint32_t inputs, lg_attr *rest) {
    *rest = *attr;
    rest->i[3] = 0;
    return attr->i[3] != 0;
}

static lg_var helper_of(const lg_attr *attr, const lg_var *in) {
    return attr->i[2] ? in[1] : LG_NONE;
}

/* For y = q sigma^(order)(x): adds the cotangents of q and x directly to their adjoints, in one pass. False:
 * this is not possible, and nothing was done. */
static bool reversed_in_place(lg_reverse *r, uint32_t order, lg_var h, bool has_q) {
    if (!lg_reverse_in_place(r)) return false;
    lg_tape *tape = r->tape;
    if (order + 1 > LG_K_ACT_ORDERS) return false;
    bool add_q = false, add_x = false;
    void *dq = has_q && r->need[2] ? lg_reverse_into(r, 2, &add_q) : NULL;
    void *dx = r->need[0] && tape->status == LG_OK ? lg_reverse_into(r, 0, &add_x) : NULL;
    if (tape->status != LG_OK) return true;
    const lg_node *x = lg_node_at(tape, r->in[0]);
    tape->k->act_reverse((lg_k_act)r->attr->i[0], (int)order, x->count,
                         x->flags & LG_NODE_NO_VALUE ? NULL : x->value,
                         lg_is_none(h) ? NULL : lg_node_at(tape, h)->value, lg_node_at(tape, r->g)->value,
                         has_q ? lg_node_at(tape, r->in[2])->value : NULL, dq, add_q, dx, add_x);
    return true;
}

/* y = g s_n(x), with s_n the n-th derivative of sigma and c the cotangent of y: dg = s_n(x) c, dx = (g c)
 * s_{n+1}(x). */
static void derivative_vjp(lg_reverse *r) {
    uint32_t kind = r->attr->i[0], order = r->attr->i[1];
    lg_var h = helper_of(r->attr, r->in);
    bool has_g = r->attr->i[3] != 0;
    if (reversed_in_place(r, order, h, has_g)) return;
    if (has_g && r->need[2]) r->out[2] = derivative(r->tape, r->in[0], h, r->g, kind, order);
    if (r->need[0]) {
        lg_var both = has_g ? lg_mul(r->tape, r->g, r->in[2]) : r->g;
        r->out[0] = derivative(r->tape, r->in[0], h, both, kind, order + 1);
    }
}

static lg_var derivative_jvp(const lg_forward *f) {
    uint32_t kind = f->attr->i[0], order = f->attr->i[1];
    lg_var h = helper_of(f->attr, f->in), from_g = LG_NONE, from_x = LG_NONE;
    bool has_g = f->attr->i[3] != 0;
    if (has_g && !lg_is_none(f->tangents[2]))
        from_g = derivative(f->tape, f->in[0], h, f->tangents[2], kind, order);
    if (!lg_is_none(f->tangents[0])) {
        lg_var both = has_g ? lg_mul(f->tape, f->tangents[0], f->in[2]) : f->tangents[0];
        from_x = derivative(f->tape, f->in[0], h, both, kind, order + 1);
    }
    return lg_add_or(f->tape, from_g, from_x);
}

const lg_op lg_op_act_derivative = {
    LG_OP("act_derivative", 2u, 2, 3, derivative_shape, derivative_forward, derivative_vjp, derivative_jvp),
    .unread = derivative_unread, .element = derivative_element, .factor = derivative_factor};

static lg_status act_forward(lg_evaluation *e) {
    e->k->act((lg_k_act)e->attr->i[0], 0, e->count, e->x[0], NULL, NULL, e->y);
    return LG_OK;
}

/* The helper available at an ACT node: its value y for kinds whose helper is the value, otherwise LG_NONE.
 * For swish, whose helper is the sigmoid, this node has none. */
static lg_var own_helper(uint32_t kind, lg_var y) {
    return helpers[kind] == HELPER_VALUE ? y : LG_NONE;
}

static void act_vjp(lg_reverse *r) {
    const lg_var h = own_helper(r->attr->i[0], r->y);
    if (reversed_in_place(r, 0, h, false)) return;
    if (r->need[0]) r->out[0] = derivative(r->tape, r->in[0], h, r->g, r->attr->i[0], 1);
}

static lg_var act_jvp(const lg_forward *f) {
    const uint32_t kind = f->attr->i[0];
    return derivative(f->tape, f->in[0], own_helper(kind, f->y), f->tangents[0], kind, 1);
}

static lg_instead act_instead(const lg_known *k) {
    return k->attr->i[0] == LG_IDENTITY ? lg_instead_input(0) : lg_instead_nothing();
}
const lg_op lg_op_act = {LG_OP("act", 0, 1, 1, act_shape, act_forward, act_vjp, act_jvp),
                         .element = act_element, .instead = act_instead, .ends_layer = true,
                         .saturates = true};

static lg_var act_node(lg_tape *tape, lg_var x, lg_activation kind) {
    lg_attr attr = {.i = {(uint32_t)kind, 0, 0, 0}};
    return lg_record(tape, &lg_op_act, &x, 1, &attr);
}

lg_var lg_act(lg_tape *tape, lg_var x, lg_activation kind) {
    return lg_act_derivative(tape, x, kind, 0);
}

lg_var lg_act_derivative(lg_tape *tape, lg_var x, lg_activation kind, int order) {
    if ((unsigned)kind >= LG_ACTIVATION_COUNT || order < 0)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "act",
                            "the activation is unknown, or the order is negative");
    if (order == 0 && helpers[kind] != HELPER_SIGMOID) return act_node(tape, x, kind);
    lg_var h = LG_NONE;
    if (helpers[kind] == HELPER_VALUE) h = act_node(tape, x, kind);
    if (helpers[kind] == HELPER_SIGMOID) h = act_node(tape, x, LG_SIGMOID);
    if (tape->status != LG_OK) return LG_NONE;
    return derivative(tape, x, h, LG_NONE, (uint32_t)kind, (uint32_t)order);
}

/* ---- fused dense layer ---- */

/* Records z = x W + b and y = sigma(z) as two nodes with one buffer. y may overwrite z, because the
 * derivatives of these kinds never read z. Kinds whose derivatives need z are not fused. */
lg_var lg_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, lg_activation kind) {
    if ((unsigned)kind >= LG_ACTIVATION_COUNT)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "dense", "unknown activation");
    bool has_bias = !lg_is_none(b);
    if (kind == LG_IDENTITY || helpers[kind] != HELPER_VALUE || tape->unrecorded) {
        lg_var z = has_bias ? lg_matmul_add(tape, x, w, b) : lg_matmul(tape, x, w);
        return kind == LG_IDENTITY ? z : lg_act(tape, z, kind);
    }
    const lg_node *nx = lg_node_of(tape, x, "dense"), *nw = lg_node_of(tape, w, "dense");
    const lg_node *nb = has_bias ? lg_node_of(tape, b, "dense") : NULL;
    if (tape->status != LG_OK) return LG_NONE;
    const lg_node *in[3] = {nx, nw, nb};
    bool fits = nx->shape.rank == 2 && nw->shape.rank == 2 && nx->shape.dims[1] == nw->shape.dims[0];
    if (!fits || (has_bias && (nb->shape.rank != 1 || nb->shape.dims[0] != nw->shape.dims[1])))
        return lg_fail_shapes(tape, "dense", in, has_bias ? 3 : 2);
    size_t m = nx->shape.dims[0], k = nx->shape.dims[1], n = nw->shape.dims[1];
    void *value = tape->dry ? tape : lg_value_allocate(tape, m * n);
    if (value == NULL) return LG_NONE;
    if (!tape->dry) {
        lg_gemm(tape, 0, m, n, k, nx->value, w.index, value, false);
        tape->k->bias_act((lg_k_act)kind, m, n, has_bias ? nb->value : NULL, value);
    }
    lg_shape shape = lg_shape2((uint32_t)m, (uint32_t)n);
    lg_var inputs[3] = {x, w, b};
    lg_attr product = {.i = {0, 0, 0, 0}}, activation = {.i = {(uint32_t)kind, 0, 0, 0}};
    lg_var z = lg_record_value(tape, &lg_op_matmul, inputs, has_bias ? 3 : 2, &product, shape, value,
                               LG_NODE_NO_VALUE);
    return lg_record_value(tape, &lg_op_act, &z, 1, &activation, shape, value, 0);
}

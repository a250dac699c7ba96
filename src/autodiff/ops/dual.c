/* Operations on pairs (dual.h). Recorded derivatives are composed of operations on the halves; the unrecorded
 * sweep uses kernels. */
#include "autodiff/ops/dual.h"
#include "autodiff/ops/op_c.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/tape/tape_internal.h"

extern const lg_op lg_op_dual_act, lg_op_dual_mix;

/* ---- halves ---- */

lg_var lg_dual_half(lg_tape *tape, lg_var pairs, int half) {
    const uint32_t rows = lg_var_shape(tape, pairs).dims[0] / 2;
    return lg_slice(tape, pairs, 0, half == 0 ? 0 : rows, rows);
}

/* Joins two halves to pairs. LG_NONE stands for zeros; at most one half may be LG_NONE. */
static lg_var join(lg_tape *tape, lg_var values, lg_var derivatives) {
    lg_var both[2] = {values, derivatives};
    if (lg_is_none(values)) both[0] = lg_zeros_like(tape, derivatives);
    if (lg_is_none(derivatives)) both[1] = lg_zeros_like(tape, values);
    return lg_concat(tape, both, 2, 0);
}

lg_var lg_dual_pair(lg_tape *tape, lg_var x, lg_var dx) {
    const lg_var both[2] = {x, lg_broadcast_to(tape, dx, lg_var_shape(tape, x))};
    return lg_concat(tape, both, 2, 0);
}

static bool is_pairs(const lg_shape *shape) {
    return shape->rank == 2 && shape->dims[0] % 2 == 0;
}

/* ---- activation; attr.i = {kind}; for the sine, the cosines of the arguments are kept for the vjp ---- */

/* Whether slope = sigma'(x) and bend = sigma''(x)/sigma'(x) can be computed from y = sigma(x). The argument
 * of these kinds may be overwritten, and their node also adds the bias. */
static bool fused(uint32_t kind) {
    return kind != LG_SWISH && kind != LG_SINE;
}

/* slope * v */
static lg_var times_slope(lg_tape *t, uint32_t kind, lg_var y, lg_var v) {
    if (kind == LG_IDENTITY) return v;
    if (kind == LG_TANH)
        return lg_mul(t, v, lg_mul(t, lg_add_scalar(t, y, 1.0), lg_add_scalar(t, lg_neg(t, y), 1.0)));
    if (kind == LG_SIGMOID) return lg_mul(t, v, lg_mul(t, y, lg_add_scalar(t, lg_neg(t, y), 1.0)));
    return lg_mul(t, v, lg_act_derivative(t, y, (lg_activation)kind, 1)); /* y has the same sign as x */
}

/* bend * v, or LG_NONE if that is zero */
static lg_var times_bend(lg_tape *t, uint32_t kind, lg_var y, lg_var v) {
    if (kind == LG_TANH) return lg_scale(t, lg_mul(t, v, y), -2.0);
    if (kind == LG_SIGMOID) return lg_mul(t, v, lg_add_scalar(t, lg_scale(t, y, -2.0), 1.0));
    return LG_NONE;
}

static lg_status dual_act_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                lg_shape *out) {
    if (!is_pairs(in[0])) return LG_SHAPE;
    if (inputs > 1 && (in[1]->rank != 1 || in[1]->dims[0] != in[0]->dims[1])) return LG_SHAPE;
    if (attr->i[0] >= LG_ACTIVATION_COUNT || (inputs > 1 && !fused(attr->i[0]))) return LG_INVALID_ARGUMENT;
    *out = *in[0];
    return LG_OK;
}

/* Bytes for the cosines of the sine's arguments. */
static size_t dual_act_kept(const lg_evaluation *e) {
    return e->attr->i[0] == LG_SINE ? e->count / 2 * e->k->size : 0;
}

static lg_status dual_act_forward(lg_evaluation *e) {
    const size_t rows = e->shape->dims[0] / 2, cols = e->shape->dims[1];
    if (e->y != e->x[0]) /* otherwise y takes over the memory of the product (lg_record_over) */
        e->k->unary[LG_K_SCALE](e->count, 1.0, e->x[0], e->y);
    e->k->dual_act((lg_k_act)e->attr->i[0], rows, cols, e->inputs > 1 ? e->x[1] : NULL, e->kept, e->y);
    return LG_OK;
}

static const lg_c_fragment c_dual_start = {
    .comment = "y = x, and the bias b (n; or NULL) is added to the values, the first half of the rows.",
    .text = LG_C(static NOINLINE void dual_start(int rows, int n, const real *x, const real *b, real *y) {
        for (int i = 0; i < 2 * rows; i++)
            for (int j = 0; j < n; j++)
                y[i * n + j] = x[i * n + j] + (b != NULL && i < rows ? b[j] : REAL(0.0));
    })};

/* y' = slope x' and y = sigma(x), with the C functions of act and act_derivative. Fused kinds compute the
 * slope from y, the sine from x, and swish from x and sigmoid(x), which the first half of y holds until y
 * itself is computed. */
static void dual_act_c(lg_c *c, const lg_evaluation *e) {
    const uint32_t kind = e->attr->i[0];
    const lg_attr value = {.i = {kind}}, slope = {.i = {kind, 1, kind != LG_SINE, 1}};
    const lg_attr sigmoid = {.i = {LG_SIGMOID}}, swish = {.i = {kind, 0, 1, 0}};
    const size_t half = e->count / 2;
    lg_c_call(c, &c_dual_start, "dual_start(%u, %u, $0, %s, $y)", e->shape->dims[0] / 2, e->shape->dims[1],
              e->inputs > 1 ? "$1" : "NULL");
    if (fused(kind) && kind != LG_IDENTITY) {
        lg_c_call(c, NULL, "%s(%zu, $y)", lg_c_map(c, &lg_op_act, &value, 1, 1), half);
        lg_c_call(c, NULL, "%s(%zu, $y, $y + %zu)", lg_c_map(c, &lg_op_act_derivative, &slope, 3, 4), half,
                  half);
    } else if (kind == LG_SWISH) {
        lg_c_call(c, NULL, "%s(%zu, $0, $y)", lg_c_map(c, &lg_op_act, &sigmoid, 1, 0), half);
        lg_c_call(c, NULL, "%s(%zu, $0, $y, $y + %zu)", lg_c_map(c, &lg_op_act_derivative, &slope, 3, 4),
                  half, half);
        lg_c_call(c, NULL, "%s(%zu, $0, $y)", lg_c_map(c, &lg_op_act_derivative, &swish, 2, 2), half);
    } else if (kind == LG_SINE) {
        lg_c_call(c, NULL, "%s(%zu, $0, $y + %zu)", lg_c_map(c, &lg_op_act_derivative, &slope, 3, 4), half,
                  half);
        lg_c_call(c, NULL, "%s(%zu, $0, $y)", lg_c_map(c, &lg_op_act, &value, 1, 0), half);
    }
}

/* Adds the argument's cotangent directly to its adjoint, then sums it over the rows to get the bias's
 * cotangent, while it is in the cache. Returns false where that is not possible; for example, if the
 * argument's adjoint already holds other contributions, the sum would include them. */
static bool dual_act_in_place(lg_reverse *r) {
    lg_tape *tape = r->tape;
    const bool has_bias = r->inputs > 1;
    if (!lg_reverse_in_place(r) || (has_bias && r->need[1] && !r->need[0])) return false;
    if (!r->need[0]) return true;
    if (has_bias && r->need[1] && lg_reverse_started(r, 0)) return false;
    bool add = false, add_bias = false;
    void *d = lg_reverse_into(r, 0, &add);
    void *db = d != NULL && has_bias && r->need[1] ? lg_reverse_into(r, 1, &add_bias) : NULL;
    if (tape->status != LG_OK) return true;
    const lg_node *x = lg_node_at(tape, r->in[0]);
    tape->k->dual_act_reverse((lg_k_act)r->attr->i[0], x->count / 2, x->value, r->attr->pointer,
                              lg_node_at(tape, r->y)->value, lg_node_at(tape, r->g)->value, d, add);
    if (db != NULL) tape->k->sum_rows(x->shape.dims[0] / 2, x->shape.dims[1], d, db, add_bias);
    return true;
}

/* The argument is (z, z'), the output (y, y'), its cotangent (g, g'): dz = slope g + bend y' g', dz' = slope
 * g'. */
static void dual_act_vjp(lg_reverse *r) {
    if (dual_act_in_place(r)) return;
    lg_tape *t = r->tape;
    const uint32_t kind = r->attr->i[0];
    const lg_var g = lg_dual_half(t, r->g, 0), gd = lg_dual_half(t, r->g, 1);
    lg_var dz, dzd;
    if (fused(kind)) {
        const lg_var y = lg_dual_half(t, r->y, 0), yd = lg_dual_half(t, r->y, 1);
        dz = lg_add_or(t, times_slope(t, kind, y, g), times_bend(t, kind, y, lg_mul(t, yd, gd)));
        dzd = times_slope(t, kind, y, gd);
    } else {
        const lg_var z = lg_dual_half(t, r->in[0], 0), zd = lg_dual_half(t, r->in[0], 1);
        const lg_var slope = lg_act_derivative(t, z, (lg_activation)kind, 1);
        const lg_var bend = lg_act_derivative(t, z, (lg_activation)kind, 2);
        dz = lg_add(t, lg_mul(t, slope, g), lg_mul(t, bend, lg_mul(t, zd, gd)));
        dzd = lg_mul(t, slope, gd);
    }
    if (r->need[0]) r->out[0] = join(t, dz, dzd);
    if (r->inputs > 1 && r->need[1]) r->out[1] = lg_sum_to(t, dz, lg_node_at(t, r->in[1])->shape);
}

/* With tangents s, s' of z, z', the tangent of the output is (slope s, bend y' s + slope s'). */
static lg_var dual_act_jvp(const lg_forward *f) {
    lg_tape *t = f->tape;
    const uint32_t kind = f->attr->i[0];
    const lg_var y = lg_dual_half(t, f->y, 0), yd = lg_dual_half(t, f->y, 1);
    lg_var s = LG_NONE, sd = LG_NONE, moved;
    if (!lg_is_none(f->tangents[0])) {
        s = lg_dual_half(t, f->tangents[0], 0);
        sd = lg_dual_half(t, f->tangents[0], 1);
    }
    if (f->inputs > 1 && !lg_is_none(f->tangents[1]))
        s = lg_add_or(t, s, lg_broadcast_to(t, f->tangents[1], lg_var_shape(t, y)));
    if (fused(kind)) {
        moved = times_bend(t, kind, y, lg_mul(t, yd, s));
        if (!lg_is_none(sd)) moved = lg_add_or(t, moved, times_slope(t, kind, y, sd));
        return join(t, times_slope(t, kind, y, s), moved);
    }
    const lg_var z = lg_dual_half(t, f->in[0], 0), zd = lg_dual_half(t, f->in[0], 1);
    const lg_var slope = lg_act_derivative(t, z, (lg_activation)kind, 1);
    const lg_var bend = lg_act_derivative(t, z, (lg_activation)kind, 2);
    moved = lg_add(t, lg_mul(t, bend, lg_mul(t, zd, s)), lg_mul(t, slope, sd));
    return join(t, lg_mul(t, slope, s), moved);
}

const lg_op lg_op_dual_act = {
    LG_OP("dual_act", 0, 1, 2, dual_act_shape, dual_act_forward, dual_act_vjp, dual_act_jvp),
    .payload = LG_PAYLOAD_KEPT, .kept = dual_act_kept, .write_c = dual_act_c};

lg_var lg_dual_act(lg_tape *tape, lg_var x, lg_activation kind) {
    const lg_attr attr = {.i = {(uint32_t)kind, 0, 0, 0}};
    return lg_record(tape, &lg_op_dual_act, &x, 1, &attr);
}

/* The product x W, z = x W + b and, for fused kinds, sigma(z) share one buffer. Derivatives never read what
 * was overwritten. */
lg_var lg_dual_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, lg_activation kind) {
    const lg_attr none = {.i = {0, 0, 0, 0}};
    if ((unsigned)kind >= LG_ACTIVATION_COUNT)
        return lg_tape_fail(tape, LG_INVALID_ARGUMENT, "dual_dense", "unknown activation");
    if (!fused((uint32_t)kind)) return lg_dual_act(tape, lg_dual_dense(tape, x, w, b, LG_IDENTITY), kind);
    const lg_var in[2] = {x, w};
    const lg_var product = lg_record(tape, &lg_op_matmul, in, 2, &none);
    if (lg_is_none(product) || (lg_is_none(b) && kind == LG_IDENTITY)) return product;
    const lg_attr attr = {.i = {(uint32_t)kind, 0, 0, 0}};
    const lg_var parts[2] = {product, b};
    const uint32_t inputs = lg_is_none(b) ? 1 : 2;
    if (tape->unrecorded) return lg_record(tape, &lg_op_dual_act, parts, inputs, &attr);
    return lg_record_over(tape, &lg_op_dual_act, parts, inputs, &attr);
}

/* ---- mix ---- */

static lg_status dual_mix_shape(const lg_shape *const *in, uint32_t inputs, const lg_attr *attr,
                                lg_shape *out) {
    if (!is_pairs(in[0]) || !lg_same_shape(in[0], in[1]) || !lg_same_shape(in[0], in[2])) return LG_SHAPE;
    *out = *in[0];
    return LG_OK;
}

static lg_status dual_mix_forward(lg_evaluation *e) {
    e->k->dual_mix(e->count / 2, e->x[0], e->x[1], e->x[2], e->y);
    return LG_OK;
}

static const lg_c_fragment c_dual_mix = {
    .comment = "(1 - z) u + z v of n pairs of a value and its derivative.",
    .text = LG_C(static NOINLINE void dual_mix(int n, const real *RESTRICT z, const real *RESTRICT u,
                                               const real *RESTRICT v, real *RESTRICT y) {
        for (int i = 0; i < n; i++) {
            const real rest = REAL(1.0) - z[i];
            y[i] = rest * u[i] + z[i] * v[i];
            y[n + i] = z[n + i] * (v[i] - u[i]) + (rest * u[n + i] + z[i] * v[n + i]);
        }
    })};

static void dual_mix_c(lg_c *c, const lg_evaluation *e) {
    lg_c_call(c, &c_dual_mix, "dual_mix(%zu, $0, $1, $2, $y)", e->count / 2);
}

typedef struct halves {
    lg_var z, zd, u, ud, v, vd;
} halves;

static halves halves_of(lg_tape *t, const lg_var *in) {
    return (halves){lg_dual_half(t, in[0], 0), lg_dual_half(t, in[0], 1), lg_dual_half(t, in[1], 0),
                    lg_dual_half(t, in[1], 1), lg_dual_half(t, in[2], 0), lg_dual_half(t, in[2], 1)};
}

/* y = (1 - z) u + z v, y' = z' (v - u) + (1 - z) u' + z v':
 * dz = g (v - u) + g' (v' - u'), dz' = g' (v - u);
 * dv = g z + g' z', dv' = g' z; du = g - dv, du' = g' - dv'. */
static void dual_mix_vjp(lg_reverse *r) {
    lg_tape *t = r->tape;
    if (lg_reverse_in_place(r)) {
        lg_reverse_three(r, t->k->dual_mix_reverse, lg_node_at(t, r->y)->count / 2);
        return;
    }
    const halves h = halves_of(t, r->in);
    const lg_var g = lg_dual_half(t, r->g, 0), gd = lg_dual_half(t, r->g, 1);
    if (r->need[0]) {
        const lg_var gap = lg_sub(t, h.v, h.u);
        const lg_var dz = lg_add(t, lg_mul(t, g, gap), lg_mul(t, gd, lg_sub(t, h.vd, h.ud)));
        r->out[0] = join(t, dz, lg_mul(t, gd, gap));
    }
    if (!r->need[1] && !r->need[2]) return;
    const lg_var to_v = join(t, lg_add(t, lg_mul(t, g, h.z), lg_mul(t, gd, h.zd)), lg_mul(t, gd, h.z));
    if (r->need[1]) r->out[1] = lg_sub(t, r->g, to_v);
    if (r->need[2]) r->out[2] = to_v;
}

/* The product of a factor (f, f') and pairs (p, p'): (f p, f' p + f p'). */
static lg_var times(lg_tape *t, lg_var f, lg_var fd, lg_var pairs) {
    const lg_var p = lg_dual_half(t, pairs, 0), pd = lg_dual_half(t, pairs, 1);
    return join(t, lg_mul(t, f, p), lg_add(t, lg_mul(t, fd, p), lg_mul(t, f, pd)));
}

static lg_var dual_mix_jvp(const lg_forward *f) {
    lg_tape *t = f->tape;
    const halves h = halves_of(t, f->in);
    lg_var moved = LG_NONE;
    if (!lg_is_none(f->tangents[0]))
        moved = times(t, lg_sub(t, h.v, h.u), lg_sub(t, h.vd, h.ud), f->tangents[0]);
    if (!lg_is_none(f->tangents[1]))
        moved = lg_add_or(t, moved,
                          times(t, lg_add_scalar(t, lg_neg(t, h.z), 1.0), lg_neg(t, h.zd), f->tangents[1]));
    if (!lg_is_none(f->tangents[2])) moved = lg_add_or(t, moved, times(t, h.z, h.zd, f->tangents[2]));
    return moved;
}

const lg_op lg_op_dual_mix = {
    LG_OP("dual_mix", 0, 3, 3, dual_mix_shape, dual_mix_forward, dual_mix_vjp, dual_mix_jvp),
    .write_c = dual_mix_c};

lg_var lg_dual_mix(lg_tape *tape, lg_var z, lg_var u, lg_var v) {
    const lg_var in[3] = {z, u, v};
    return lg_record(tape, &lg_op_dual_mix, in, 3, NULL);
}

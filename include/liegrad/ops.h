/* Operations of the tape. Each evaluates at once, records one or more nodes, and returns the result, or
 * LG_NONE with the tape's sticky error set: LG_STALE_HANDLE for a stale or foreign handle, LG_SHAPE for
 * shapes that do not fit, LG_INVALID_ARGUMENT for an axis, index or order out of range, LG_OUT_OF_MEMORY.
 *
 * Broadcasting: shapes are aligned at the last axis, a missing axis counts as 1, an axis of 1 repeats.
 * All derivatives exist to any order unless an operation says otherwise. Kinks: the mask is a constant, so
 * the second derivative is 0; each operation says what it does at ties.
 */
#ifndef LIEGRAD_OPS_H
#define LIEGRAD_OPS_H

#include "liegrad/tape.h"

LG_BEGIN_DECLS

/* ---- elementwise, broadcasting ---- */
LG_API lg_var lg_add(lg_tape *tape, lg_var a, lg_var b);
LG_API lg_var lg_sub(lg_tape *tape, lg_var a, lg_var b);
LG_API lg_var lg_mul(lg_tape *tape, lg_var a, lg_var b);
LG_API lg_var lg_div(lg_tape *tape, lg_var a, lg_var b);
LG_API lg_var lg_max(lg_tape *tape, lg_var a, lg_var b); /* larger of two; ties: derivative to a */

LG_API lg_var lg_atan2(lg_tape *tape, lg_var a, lg_var b); /* angle of (b, a) in (-pi, pi], C's atan2; both 0:
                                                            * the derivative is NaN */
LG_API lg_var lg_ge(lg_tape *tape, lg_var a, lg_var b);    /* a >= b ? 1 : 0, a condition; derivative 0 */
/* condition != 0 ? yes : no, elementwise, equal shapes. The value that is not selected may be infinite or
 * NaN. It gets a cotangent of 0, and 0 times an infinite derivative is NaN: guard the argument too, as in
 * select(c, sqrt(select(c, x, 1)), 0). A function that becomes a program must branch with select, not with
 * C's `if`. */
LG_API lg_var lg_select(lg_tape *tape, lg_var condition, lg_var yes, lg_var no);

/* (1 - z) u + z v elementwise, equal shapes: the gate of multiplicative networks in one node. */
LG_API lg_var lg_lerp(lg_tape *tape, lg_var z, lg_var u, lg_var v);

/* sum_i c[i] x[i], equal shapes, 1 <= n <= 64: the linear combinations of Runge-Kutta stages in one node. */
LG_API lg_var lg_linear_combination(lg_tape *tape, const lg_var *x, const double *c, size_t n);

/* ---- elementwise ---- */
LG_API lg_var lg_neg(lg_tape *tape, lg_var x);
LG_API lg_var lg_scale(lg_tape *tape, lg_var x, double c);      /* c x */
LG_API lg_var lg_add_scalar(lg_tape *tape, lg_var x, double c); /* x + c */
LG_API lg_var lg_pow(lg_tape *tape, lg_var x,
                     double exponent); /* x^c; C's pow: NaN for x < 0 and c not whole */
LG_API lg_var lg_square(lg_tape *tape, lg_var x);
LG_API lg_var lg_sqrt(lg_tape *tape, lg_var x);
LG_API lg_var lg_exp(lg_tape *tape, lg_var x);
LG_API lg_var lg_log(lg_tape *tape, lg_var x);
LG_API lg_var lg_sin(lg_tape *tape, lg_var x);
LG_API lg_var lg_cos(lg_tape *tape, lg_var x);
LG_API lg_var lg_abs(lg_tape *tape, lg_var x);  /* derivative sign(x), +1 at 0 */
LG_API lg_var lg_sign(lg_tape *tape, lg_var x); /* +1 for x >= 0, else -1; derivative 0 */

/* Activations (activation.h) as families closed under differentiation: the n-th derivative is computed from
 * stored values, to order 8; beyond that LG_NOT_DIFFERENTIABLE. Where an activation is flat, its derivatives
 * are right to rounding of 1, not of their own size. */
LG_API lg_var lg_act(lg_tape *tape, lg_var x, lg_activation kind);
/* Derivative number `order` of the activation at x, elementwise. */
LG_API lg_var lg_act_derivative(lg_tape *tape, lg_var x, lg_activation kind, int order);

/* ---- matrix products; A and B of rank 2, or of rank 3 as batches (equal, or one of them 1) ---- */
LG_API lg_var lg_matmul(lg_tape *tape, lg_var a, lg_var b);    /* nn: (m, k) (k, n) -> (m, n) */
LG_API lg_var lg_matmul_nt(lg_tape *tape, lg_var a, lg_var b); /* A B^T: (m, k) (n, k) -> (m, n) */
LG_API lg_var lg_matmul_tn(lg_tape *tape, lg_var a, lg_var b); /* A^T B: (k, m) (k, n) -> (m, n) */
/* c + A B with c of shape (m, n), (1, n) or (n), or a scalar: accumulation and bias. Rank 2 only. */
LG_API lg_var lg_matmul_add(lg_tape *tape, lg_var a, lg_var b, lg_var c);
/* Fused dense layer sigma(x W + b): x (m, k), W (k, n), b (n) or LG_NONE -> (m, n). */
LG_API lg_var lg_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, lg_activation kind);

/* ---- reductions and broadcasts; axis -1 is the last ---- */
LG_API lg_var lg_sum(lg_tape *tape, lg_var x);  /* over all: rank 0 */
LG_API lg_var lg_mean(lg_tape *tape, lg_var x); /* over all: rank 0 */
LG_API lg_var lg_sum_axis(lg_tape *tape, lg_var x, int axis,
                          bool keep); /* keep: the axis stays with length 1 */
LG_API lg_var lg_mean_axis(lg_tape *tape, lg_var x, int axis, bool keep);
LG_API lg_var lg_max_axis(lg_tape *tape, lg_var x, int axis, bool keep); /* ties: to the first index */
LG_API lg_var lg_sum_to(lg_tape *tape, lg_var x, lg_shape shape);        /* the adjoint of a broadcast */
LG_API lg_var lg_broadcast_to(lg_tape *tape, lg_var x, lg_shape shape);

/* ---- shapes ---- */
LG_API lg_var lg_reshape(lg_tape *tape, lg_var x, lg_shape shape); /* same count; a view */
LG_API lg_var lg_slice(lg_tape *tape, lg_var x, int axis, uint32_t start, uint32_t length); /* axis stays */
LG_API lg_var lg_pad(lg_tape *tape, lg_var x, int axis, uint32_t before, uint32_t after);   /* with zeros */
LG_API lg_var lg_concat(lg_tape *tape, const lg_var *parts, size_t n, int axis);
LG_API lg_var lg_transpose(lg_tape *tape, lg_var x); /* the last two axes exchanged; rank >= 2 */
LG_API lg_var lg_permute(lg_tape *tape, lg_var x, const int *axes); /* out axis i is x's axis axes[i] */
/* Rows (axis 0) by index; out (n, ...). Indices are payload, not variables; repeated ones add in order of
 * position. */
LG_API lg_var lg_gather(lg_tape *tape, lg_var x, const uint32_t *indices, uint32_t n);
/* out (rows, ...) with out[indices[i]] += x[i]: the adjoint of a gather. */
LG_API lg_var lg_scatter(lg_tape *tape, lg_var x, const uint32_t *indices, uint32_t n, uint32_t rows);
LG_API lg_var lg_stop_gradient(lg_tape *tape, lg_var x); /* same value, derivative 0 */

/* ---- convolution and pooling along time: x (B, L, C), time before channels ---- */
/* y[b, t, o] = sum_{j,c} x[b, s t + j - p, c] w[j, c, o], w (k, C, O) -> y (B, L', O), L' = floor((L + 2p -
 * k)/s) + 1, zeros outside; stride s >= 1, padding p < k. LG_SHAPE when nothing is left. Its derivatives are
 * convolutions again, to any order. */
LG_API lg_var lg_conv1d(lg_tape *tape, lg_var x, lg_var w, uint32_t stride, uint32_t padding);
/* sigma(conv + b) in one: b (O) or LG_NONE. */
LG_API lg_var lg_conv1d_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, uint32_t stride, uint32_t padding,
                              lg_activation kind);
/* Mean of `size` samples every `stride`: (B, L, C) -> (B, floor((L - size)/stride) + 1, C). */
LG_API lg_var lg_avg_pool1d(lg_tape *tape, lg_var x, uint32_t size, uint32_t stride);
/* lg_avg_pool1d(lg_conv1d_dense(...), size, step) in one node, which keeps only sigma' of the convolution. */
LG_API lg_var lg_conv1d_pooled(lg_tape *tape, lg_var x, lg_var w, lg_var b, uint32_t stride, uint32_t padding,
                               lg_activation kind, uint32_t size, uint32_t step);
/* Maximum of `size` samples every `stride`; ties: to the first. A kink: second derivative 0. */
LG_API lg_var lg_max_pool1d(lg_tape *tape, lg_var x, uint32_t size, uint32_t stride);

/* ---- rows of vectors: the last axis is the vector, all others are batch; equal shapes ---- */
LG_API lg_var lg_rowdot(lg_tape *tape, lg_var a, lg_var b); /* (..., d) (..., d) -> (..., 1) */
LG_API lg_var lg_rownorm2(lg_tape *tape, lg_var a);         /* squared norm, (..., 1) */
LG_API lg_var lg_cross(lg_tape *tape, lg_var a, lg_var b);  /* (..., 3) */

/* Solves sym(A) X = B for a batch: A (n, k, k) with symmetric part positive definite, B (n, k, m) -> (n, k,
 * m). The derivative with respect to A is symmetric. A row whose factorisation fails becomes NaN. */
LG_API lg_var lg_spd_solve(lg_tape *tape, lg_var a, lg_var b);

/* ---- functions of the rotation angle, w = |u|^2 of any shape (..., 1) ---- */
/* Stumpff functions c_0..c_K, (..., 1) -> (..., K + 1): c_k(w) = sum_j (-w)^j / (k + 2j)!, 0 <= K <= 8;
 * derivatives d c_k/dw = (k c_{k+2} - c_{k+1})/2, to order 8. */
LG_API lg_var lg_stumpff_functions(lg_tape *tape, lg_var w, int K);
/* (..., 1) -> (..., 1): d^order/dw^order of g2(w) = (1 - (x/2) cot(x/2))/x^2 with w = x^2, |x| < 2 pi; orders
 * to 8. */
LG_API lg_var lg_dexpinv_coefficient(lg_tape *tape, lg_var w, int order);

/* ---- losses: scalars; `weights` of shape (n) gives each sample (axis 0) a weight, LG_NONE means 1 ---- */
typedef enum lg_loss {
    LG_LOSS_MSE,          /* mean over all elements of w (y - t)^2 */
    LG_LOSS_MAE,          /* mean of w |y - t| */
    LG_LOSS_HUBER,        /* mean of w h(y - t), h(r) = r^2/2 for |r| <= 1, |r| - 1/2 beyond */
    LG_LOSS_BCE_LOGITS,   /* mean of w (max(y, 0) - y t + log(1 + exp(-|y|))), t in [0, 1] */
    LG_LOSS_CROSS_ENTROPY /* y (n, classes) logits, t (n, classes) probabilities: mean over n of -w sum_c t
                             log softmax(y) */
} lg_loss;
#define LG_LOSS_COUNT 5
LG_API lg_var lg_loss_record(lg_tape *tape, lg_loss kind, lg_var prediction, lg_var target, lg_var weights);
/* Mean of squares of prediction - target, which broadcast as in lg_sub; lg_loss_record wants equal shapes. */
LG_API lg_var lg_mse(lg_tape *tape, lg_var prediction, lg_var target);
LG_API lg_var lg_log_softmax(lg_tape *tape, lg_var x); /* over the last axis */

/* ---- your own operation ---- */

/* Records the vjp with operations, so that derivatives of any order exist. `inputs` are the operation's
 * inputs, `y` its output, g its cotangent. Where need[i] is true, write LG_NONE or a variable of inputs[i]'s
 * shape to out[i]. */
typedef lg_status (*lg_custom_vjp_fn)(void *user, lg_tape *tape, const lg_var *inputs, size_t n, lg_var y,
                                      lg_var g, const bool *need, lg_var *out);
/* Records the jvp: writes the output's tangent. tangents[i] is LG_NONE where inputs[i] does not vary. */
typedef lg_status (*lg_custom_jvp_fn)(void *user, lg_tape *tape, const lg_var *inputs, size_t n, lg_var y,
                                      const lg_var *tangents, lg_var *out);
/* Numeric: values only, elements of the tape's type. `y` has the declared shape. */
typedef lg_status (*lg_custom_forward_fn)(void *user, lg_dtype dtype, const void *const *inputs, void *y);
/* Writes (does not add) the cotangents of all inputs for which out[i] != NULL. First order only. */
typedef lg_status (*lg_custom_numeric_vjp_fn)(void *user, lg_dtype dtype, const void *const *inputs,
                                              const void *y, const void *g, void *const *out);
typedef lg_status (*lg_custom_numeric_jvp_fn)(void *user, lg_dtype dtype, const void *const *inputs,
                                              const void *y, const void *const *tangents, void *out);

#define LG_CUSTOM_MAX_INPUTS 8
typedef struct lg_custom_op {
    const char *name; /* for messages; must outlive the tape */
    lg_custom_forward_fn forward;
    /* Give one of each pair, or none: then this derivative is LG_NOT_DIFFERENTIABLE. A numeric derivative
     * gives first order only; a higher order is LG_NOT_DIFFERENTIABLE with the operation's name. If both
     * kinds of vjp are given, lg_backward and lg_backward_set, which record nothing, use the numeric one,
     * lg_grad and lg_vjp the other: any order, and a fast last pass. */
    lg_custom_vjp_fn vjp;
    lg_custom_numeric_vjp_fn numeric_vjp;
    lg_custom_jvp_fn jvp;
    lg_custom_numeric_jvp_fn numeric_jvp;
    void *user;
} lg_custom_op;
/* `op` is kept by pointer until rewound. The output has the shape given. n <= LG_CUSTOM_MAX_INPUTS. A failing
 * callback's status becomes the tape's. */
LG_API lg_var lg_custom(lg_tape *tape, const lg_custom_op *op, const lg_var *inputs, size_t n,
                        lg_shape shape);

LG_END_DECLS

#endif

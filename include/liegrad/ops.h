/* Operations of the tape. Library liegrad.
 *
 * Each function computes its result at once, records one or more nodes, and returns the result. When it
 * fails, it returns LG_NONE and the tape keeps the error (liegrad/tape.h): LG_STALE_HANDLE (a handle is
 * LG_NONE, was rewound or belongs to another tape), LG_SHAPE (shapes do not fit), LG_INVALID_ARGUMENT (an
 * axis, an index, an order or another number is out of range).
 *
 * Broadcasting: the shapes of two operands are aligned at their last axes. A missing axis counts as an axis
 * of length 1, and an axis of length 1 is repeated as often as the other operand needs.
 *
 * An axis is a number from 0; negative numbers count from the end, so -1 is the last axis.
 *
 * Every operation has derivatives of any order, unless its comment says otherwise. An operation with a kink
 * (max, abs, ReLU) chooses a branch per element, and derivatives treat this choice as constant; so its second
 * derivative is 0. Its comment says which branch is chosen at the kink itself.
 *
 * Comments give shapes as "(m, k) (k, n) -> (m, n)": the shapes of the arguments, then the shape of the
 * result. "..." stands for any axes. sigma is the activation function `kind`.
 */
#ifndef LIEGRAD_OPS_H
#define LIEGRAD_OPS_H

#include "liegrad/tape.h"

LG_BEGIN_DECLS

/* ---- elementwise operations of two variables, with broadcasting ---- */

LG_API lg_var lg_add(lg_tape *tape, lg_var a, lg_var b); /* a + b */
LG_API lg_var lg_sub(lg_tape *tape, lg_var a, lg_var b); /* a - b */
LG_API lg_var lg_mul(lg_tape *tape, lg_var a, lg_var b); /* a b */
LG_API lg_var lg_div(lg_tape *tape, lg_var a, lg_var b); /* a / b */
/* The larger of a and b. Where they are equal, the derivative goes to a. */
LG_API lg_var lg_max(lg_tape *tape, lg_var a, lg_var b);

/* The angle of the point (b, a), as C's atan2(a, b), in (-pi, pi]. Where a = b = 0 the derivative is NaN. */
LG_API lg_var lg_atan2(lg_tape *tape, lg_var a, lg_var b);
/* 1 where a >= b, else 0: a condition for lg_select. The derivative is 0. */
LG_API lg_var lg_ge(lg_tape *tape, lg_var a, lg_var b);

/* ---- elementwise operations of several variables of equal shape ---- */

/* yes where condition != 0, else no. An element that is not selected may be infinite or NaN: it has no
 * influence on the value, and its cotangent is 0. But the operations before it then multiply this 0 with
 * their own derivative, and 0 times an infinite derivative is NaN. So keep their argument away from singular
 * points too, as in select(c, sqrt(select(c, x, 1)), 0). A function that becomes a program
 * (liegrad/program.h) must branch by lg_select, because a C `if` on a value is not recorded. */
LG_API lg_var lg_select(lg_tape *tape, lg_var condition, lg_var yes, lg_var no);

/* (1 - z) u + z v, as one node: the gate of multiplicative networks (liegrad/networks.h). */
LG_API lg_var lg_lerp(lg_tape *tape, lg_var z, lg_var u, lg_var v);

/* c[0] x[0] + ... + c[n-1] x[n-1], as one node, 1 <= n <= 64: the linear combinations of Runge-Kutta stages.
 * `c` is copied. */
LG_API lg_var lg_linear_combination(lg_tape *tape, const lg_var *x, const double *c, size_t n);

/* ---- elementwise operations of one variable ---- */

LG_API lg_var lg_neg(lg_tape *tape, lg_var x);                  /* -x */
LG_API lg_var lg_scale(lg_tape *tape, lg_var x, double c);      /* c x */
LG_API lg_var lg_add_scalar(lg_tape *tape, lg_var x, double c); /* x + c */
/* x^exponent, as C's pow: NaN where x < 0 and the exponent is not a whole number. */
LG_API lg_var lg_pow(lg_tape *tape, lg_var x, double exponent);
LG_API lg_var lg_square(lg_tape *tape, lg_var x); /* x^2 */
LG_API lg_var lg_sqrt(lg_tape *tape, lg_var x);   /* square root */
LG_API lg_var lg_exp(lg_tape *tape, lg_var x);    /* e^x */
LG_API lg_var lg_log(lg_tape *tape, lg_var x);    /* natural logarithm */
LG_API lg_var lg_sin(lg_tape *tape, lg_var x);    /* x in radians */
LG_API lg_var lg_cos(lg_tape *tape, lg_var x);    /* x in radians */
LG_API lg_var lg_abs(lg_tape *tape, lg_var x);    /* |x|; the derivative is +1 at x = 0 */
LG_API lg_var lg_sign(lg_tape *tape, lg_var x);   /* +1 for x >= 0, else -1; the derivative is 0 */

/* The activation function `kind` (liegrad/tape.h), elementwise. Derivatives exist up to order 8; beyond, the
 * tape fails with LG_NOT_DIFFERENTIABLE. Where the activation is flat (far from 0), a derivative has an error
 * of the size of rounding errors of 1, not of rounding errors of the derivative itself. */
LG_API lg_var lg_act(lg_tape *tape, lg_var x, lg_activation kind);
/* Derivative number `order` (0 to 8) of the activation function at x, elementwise. */
LG_API lg_var lg_act_derivative(lg_tape *tape, lg_var x, lg_activation kind, int order);

/* ---- matrix products ----
 *
 * A and B have rank 2, or rank 3: then they are batches of matrices, the first axis is the batch, and every
 * matrix of one batch is multiplied with the matrix at the same place in the other one. A batch of one matrix
 * (or a matrix of rank 2) is multiplied with every matrix of the other batch. */

LG_API lg_var lg_matmul(lg_tape *tape, lg_var a, lg_var b);    /* A B: (m, k) (k, n) -> (m, n) */
LG_API lg_var lg_matmul_nt(lg_tape *tape, lg_var a, lg_var b); /* A B^T: (m, k) (n, k) -> (m, n) */
LG_API lg_var lg_matmul_tn(lg_tape *tape, lg_var a, lg_var b); /* A^T B: (k, m) (k, n) -> (m, n) */
/* c + A B, as one node. c has shape (m, n), or is a bias row of shape (n) or (1, n), or a scalar. A and B
 * must have rank 2. */
LG_API lg_var lg_matmul_add(lg_tape *tape, lg_var a, lg_var b, lg_var c);
/* A dense layer sigma(x W + b): x (m, k), W (k, n), b (n) -> (m, n). b may be LG_NONE: no bias. */
LG_API lg_var lg_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, lg_activation kind);

/* ---- sums and broadcasts ----
 *
 * With `keep` the axis stays in the shape, with length 1; otherwise it is removed. */

LG_API lg_var lg_sum(lg_tape *tape, lg_var x);                            /* sum of all elements; rank 0 */
LG_API lg_var lg_mean(lg_tape *tape, lg_var x);                           /* mean of all elements; rank 0 */
LG_API lg_var lg_sum_axis(lg_tape *tape, lg_var x, int axis, bool keep);  /* sum along an axis */
LG_API lg_var lg_mean_axis(lg_tape *tape, lg_var x, int axis, bool keep); /* mean along an axis */
/* Maximum along an axis. The derivative goes to the first of equal largest elements. */
LG_API lg_var lg_max_axis(lg_tape *tape, lg_var x, int axis, bool keep);
/* Sums x over those axes along which a tensor of the given shape would be repeated to get the shape of x.
 * This is the vjp of lg_broadcast_to. */
LG_API lg_var lg_sum_to(lg_tape *tape, lg_var x, lg_shape shape);
/* Repeats x to the given shape, by the rules of broadcasting. */
LG_API lg_var lg_broadcast_to(lg_tape *tape, lg_var x, lg_shape shape);

/* ---- shapes ---- */

/* The same numbers with another shape of the same number of elements. Nothing is copied. */
LG_API lg_var lg_reshape(lg_tape *tape, lg_var x, lg_shape shape);
/* The elements start..start + length - 1 along an axis. The axis stays, with this length. */
LG_API lg_var lg_slice(lg_tape *tape, lg_var x, int axis, uint32_t start, uint32_t length);
/* Adds `before` zeros before and `after` zeros behind the elements of an axis. */
LG_API lg_var lg_pad(lg_tape *tape, lg_var x, int axis, uint32_t before, uint32_t after);
/* Joins n >= 1 tensors along an axis; the other axes must be equal. */
LG_API lg_var lg_concat(lg_tape *tape, const lg_var *parts, size_t n, int axis);
LG_API lg_var lg_transpose(lg_tape *tape, lg_var x); /* swaps the last two axes; rank >= 2 */
/* Reorders the axes: axis i of the result is axis axes[i] of x. `axes` has as many entries as x has axes. */
LG_API lg_var lg_permute(lg_tape *tape, lg_var x, const int *axes);
/* Rows of x by number: row i of the result is row indices[i] of x, i = 0..n-1. A row is an element along axis
 * 0: x (rows, ...) -> (n, ...). A row may be taken several times; its cotangents are then added in the order
 * of i. The indices are copied; they are numbers, not variables. */
LG_API lg_var lg_gather(lg_tape *tape, lg_var x, const uint32_t *indices, uint32_t n);
/* The vjp of a gather: starts from zeros of shape (rows, ...) and adds row i of x (n, ...) to row indices[i],
 * i = 0..n-1. The indices are copied. */
LG_API lg_var lg_scatter(lg_tape *tape, lg_var x, const uint32_t *indices, uint32_t n, uint32_t rows);
LG_API lg_var lg_stop_gradient(lg_tape *tape, lg_var x); /* the value of x, with derivative 0 */

/* ---- convolution and pooling along time ----
 *
 * x has shape (B, L, C): B series of L samples with C channels. */

/* Convolution with kernels w (k, C, O) of k samples; the result has shape (B, L', O). (Strictly it is a
 * correlation, as usual in networks.)
 *   y[b, t, o] = sum_{j,c} x[b, s t + j - p, c] w[j, c, o],   L' = floor((L + 2p - k)/s) + 1.
 * s >= 1 is the stride and p < k the padding; samples before and behind the series count as zero. Further
 * error: LG_SHAPE (nothing is left, L' would be below 1). */
LG_API lg_var lg_conv1d(lg_tape *tape, lg_var x, lg_var w, uint32_t stride, uint32_t padding);
/* sigma(lg_conv1d(x, w) + b), as one node. b (O), or LG_NONE for no bias. */
LG_API lg_var lg_conv1d_dense(lg_tape *tape, lg_var x, lg_var w, lg_var b, uint32_t stride, uint32_t padding,
                              lg_activation kind);
/* Means over windows of `size` samples that begin every `stride` samples. The result has shape (B, L', C),
 * where L' = floor((L - size)/stride) + 1. */
LG_API lg_var lg_avg_pool1d(lg_tape *tape, lg_var x, uint32_t size, uint32_t stride);
/* lg_avg_pool1d(lg_conv1d_dense(...), size, step), as one node. It needs less memory: of the convolution only
 * the derivative sigma' is kept. */
LG_API lg_var lg_conv1d_pooled(lg_tape *tape, lg_var x, lg_var w, lg_var b, uint32_t stride, uint32_t padding,
                               lg_activation kind, uint32_t size, uint32_t step);
/* Maxima over windows of `size` samples that begin every `stride` samples. The derivative goes to the first
 * of equal largest samples; the second derivative is 0. */
LG_API lg_var lg_max_pool1d(lg_tape *tape, lg_var x, uint32_t size, uint32_t stride);

/* ---- vectors along the last axis; operands have equal shapes ---- */

LG_API lg_var lg_rowdot(lg_tape *tape, lg_var a, lg_var b); /* a . b: (..., d) (..., d) -> (..., 1) */
LG_API lg_var lg_rownorm2(lg_tape *tape, lg_var a);         /* |a|^2: (..., d) -> (..., 1) */
LG_API lg_var lg_cross(lg_tape *tape, lg_var a, lg_var b);  /* a x b: (..., 3) (..., 3) -> (..., 3) */

/* Solves n systems sym(A) X = B, where sym(A) = (A + A^T)/2 must be positive definite: A (n, k, k), B (n, k,
 * m) -> X (n, k, m). The cotangent of A is symmetric. If sym(A) of a system is not positive definite, its X
 * is NaN. */
LG_API lg_var lg_spd_solve(lg_tape *tape, lg_var a, lg_var b);

/* ---- functions of the squared rotation angle, w = |u|^2 of shape (..., 1) ---- */

/* Stumpff functions c_0, ..., c_K: (..., 1) -> (..., K + 1), 0 <= K <= 8,
 *   c_k(w) = sum_j (-w)^j / (k + 2j)!,   d c_k/dw = (k c_{k+2} - c_{k+1})/2.
 * Derivatives exist up to order 8; beyond, LG_NOT_DIFFERENTIABLE. */
LG_API lg_var lg_stumpff_functions(lg_tape *tape, lg_var w, int K);
/* Derivative number `order` (0 to 8) by w of g_2(w) = (1 - (x/2) cot(x/2))/x^2, where w = x^2 and |x| < 2 pi:
 * (..., 1) -> (..., 1). This is a coefficient of dexp^-1 (liegrad/geometry.h). Beyond order 8, also by
 * further differentiation: LG_NOT_DIFFERENTIABLE. */
LG_API lg_var lg_dexpinv_coefficient(lg_tape *tape, lg_var w, int order);

/* ---- losses ---- */

/* y is the prediction, t the target and w the weight of a sample. Means are over all elements. A term whose
 * factor (w, t_c) is 0 counts as 0, even if the loss of the sample or log softmax(y)_c is infinite. */
typedef enum lg_loss {
    LG_LOSS_MSE,   /* mean of w (y - t)^2 */
    LG_LOSS_MAE,   /* mean of w |y - t|; the derivative is w at y = t, and the second derivative 0 */
    LG_LOSS_HUBER, /* mean of w h(y - t); h(r) = r^2/2 and h'' = 1 for |r| <= 1, else |r| - 1/2 and 0 */
    /* mean of w (log(1 + exp(y)) - y t), t in [0, 1]. The derivative is w (sigmoid(y) - t). If y is infinite,
     * the loss is 0 or infinite, and the derivative -t or 1 - t. */
    LG_LOSS_BCE_LOGITS,
    /* y (n, classes) are logits and t (n, classes) probabilities. The loss is -w sum_c t_c log softmax(y)_c,
     * averaged over the n samples. A class with y_c = -inf has the probability 0. If it is the target, the
     * loss is infinite; the derivative stays softmax(y) - t. */
    LG_LOSS_CROSS_ENTROPY
} lg_loss;
#define LG_LOSS_COUNT 5
/* Records a loss; the result has rank 0. Prediction and target have equal shapes (n, ...) of rank >= 1.
 * `weights` has shape (n), one weight per sample (along axis 0); LG_NONE: all weights are 1. The mean is not
 * divided by the sum of the weights. */
LG_API lg_var lg_loss_record(lg_tape *tape, lg_loss kind, lg_var prediction, lg_var target, lg_var weights);
/* Mean of the squares of prediction - target, which have equal shapes of any rank. The result has rank 0. */
LG_API lg_var lg_mse(lg_tape *tape, lg_var prediction, lg_var target);
/* Logarithm of the softmax along the last axis; the shape stays. -inf where x is -inf. All of a row is NaN if
 * all its x are -inf, or one is +inf or NaN. */
LG_API lg_var lg_log_softmax(lg_tape *tape, lg_var x);

/* ---- operations of the caller ----
 *
 * A caller defines an operation y = f(inputs) by callbacks for the value and for derivatives. `user` is
 * passed to all of them. A callback that fails returns a status other than LG_OK, which becomes the status of
 * the tape. */

/* A vjp that is recorded: it uses operations on the tape, so derivatives of any order exist. y is the
 * operation's output and g its cotangent, of the same shape. For each i < n with need[i], the callback writes
 * to out[i] the cotangent of inputs[i], of the shape of inputs[i], or LG_NONE for zero. */
typedef lg_status (*lg_custom_vjp_fn)(void *user, lg_tape *tape, const lg_var *inputs, size_t n, lg_var y,
                                      lg_var g, const bool *need, lg_var *out);
/* A jvp that is recorded: it writes to *out the tangent of y, of the shape of y, or LG_NONE for zero.
 * tangents[i] is the tangent of inputs[i], or LG_NONE for zero. */
typedef lg_status (*lg_custom_jvp_fn)(void *user, lg_tape *tape, const lg_var *inputs, size_t n, lg_var y,
                                      const lg_var *tangents, lg_var *out);
/* The value: computes the numbers of `y` from the numbers of the inputs. All arrays have the type `dtype`;
 * `y` has the shape that lg_custom got. */
typedef lg_status (*lg_custom_forward_fn)(void *user, lg_dtype dtype, const void *const *inputs, void *y);
/* A numeric vjp: overwrites out[i] with the cotangent of input i, for each i with out[i] != NULL. `g` is the
 * cotangent of `y`. It cannot be differentiated again. */
typedef lg_status (*lg_custom_numeric_vjp_fn)(void *user, lg_dtype dtype, const void *const *inputs,
                                              const void *y, const void *g, void *const *out);
/* A numeric jvp: overwrites `out` with the tangent of `y`. tangents[i] is NULL if input i has no tangent. It
 * cannot be differentiated again. */
typedef lg_status (*lg_custom_numeric_jvp_fn)(void *user, lg_dtype dtype, const void *const *inputs,
                                              const void *y, const void *const *tangents, void *out);

#define LG_CUSTOM_MAX_INPUTS 8
typedef struct lg_custom_op {
    const char *name; /* for messages; must live as long as the tape */
    lg_custom_forward_fn forward;
    /* The derivatives; each may be NULL. Without any vjp, reverse mode fails with LG_NOT_DIFFERENTIABLE, and
     * without any jvp forward mode does. A numeric derivative is of first order only: differentiating it
     * again fails with LG_NOT_DIFFERENTIABLE and the name of the operation. Both kinds of vjp may be given:
     * then lg_backward and lg_backward_set use the numeric one, which is faster, and lg_grad and lg_vjp use
     * the other one, which has any order. Only one kind of jvp may be given. */
    lg_custom_vjp_fn vjp;
    lg_custom_numeric_vjp_fn numeric_vjp;
    lg_custom_jvp_fn jvp;
    lg_custom_numeric_jvp_fn numeric_jvp;
    void *user;
} lg_custom_op;
/* Records the operation on n <= LG_CUSTOM_MAX_INPUTS inputs; the result has this shape. The tape keeps the
 * pointer `op`, so the struct must live until the result is rewound. Further errors: LG_INVALID_ARGUMENT (no
 * name, no `forward`, both kinds of jvp, too many inputs), the status of a callback. */
LG_API lg_var lg_custom(lg_tape *tape, const lg_custom_op *op, const lg_var *inputs, size_t n,
                        lg_shape shape);

LG_END_DECLS

#endif

/* The kernels: everything that loops over numbers. One source per family, compiled for both types and for
 * each instruction set; a tape holds a pointer to one table and never branches on type.
 *
 * Conventions. Arrays are contiguous unless strides are given; `size_t n` counts elements; pointers are to
 * the table's own type (double or float), 64-byte alignment is usual but not required. Outputs do not overlap
 * inputs except where "in place" is said or y == x / y == a is allowed for elementwise kernels (it is, for
 * all that take n). No kernel allocates, locks or fails. Elementwise results do not depend on an element's
 * position. Reductions (sum, dot) accumulate in double on both types, in a fixed order.
 */
#ifndef LG_KERNELS_H
#define LG_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "core/core.h"
#include "liegrad/context.h"

typedef enum lg_k_binary {
    LG_K_ADD,
    LG_K_SUB,
    LG_K_MUL,
    LG_K_DIV,
    LG_K_MAX,
    LG_K_GE /* a >= b ? 1 : 0 */,
    LG_K_ATAN2,
    LG_K_BINARIES
} lg_k_binary;

typedef enum lg_k_unary {
    LG_K_SCALE, /* c x */
    LG_K_SHIFT, /* x + c */
    LG_K_POW,   /* x^c, C's pow */
    LG_K_SQRT,
    LG_K_EXP,
    LG_K_LOG,
    LG_K_SIN,
    LG_K_COS,
    LG_K_ABS,
    LG_K_SIGN, /* 1 for x >= 0, else -1 (ties to +1); NaN stays NaN */
    LG_K_RECIPROCAL,
    LG_K_UNARIES
} lg_k_unary;

/* Same order as lg_activation in liegrad/ops.h. */
typedef enum lg_k_act {
    LG_K_IDENTITY,
    LG_K_TANH,
    LG_K_SIGMOID,
    LG_K_SWISH,
    LG_K_RELU,
    LG_K_LEAKY_RELU,
    LG_K_SINE,
    LG_K_ACTS
} lg_k_act;

/* Maps of so(3) and se(3) on rows of three numbers, by their inputs; y and cotangents are as long as the last
 * input. liegrad/geometry.h has the formulas. */
typedef enum lg_k_lie {
    LG_K_SO3_EXP,     /* u, x: exp(u) x; or x row-major matrices, 9 numbers a row */
    LG_K_SO3_DEXP,    /* u, v: dexp_u(v) */
    LG_K_SE3_ACT,     /* u, v, q, p: the second half of exp(u, v) . (q, p) */
    LG_K_SO3_DEXPINV, /* A, B: dexp_A^-1(B) */
    LG_K_SE3_DEXPINV, /* A, a, B, b: the second half of dexp_(A, a)^-1(B, b) */
    LG_K_LIE_MAPS
} lg_k_lie;
#define LG_K_LIE_INPUTS 4

#define LG_K_ACT_ORDERS 8 /* highest derivative of an activation */
#define LG_LEAKY_SLOPE  0.01

/* A point this close to its manifold is taken as off by rounding alone. The limit is many times the error of
 * a step. */
#define LG_LIE_ROUNDING 1e-13

/* A stage of Runge-Kutta-Munthe-Kaas on copies of T*S^2. First, unless f is NULL, k_new = dexp_sigma^-1(f),
 * where f is the field's value at the stage before and sigma its exponent. Then sigma = sum_j c_j k_j +
 * c_new k_new and out = exp(sigma) . y. f and out are plain. The others are packed: blocks in a layout that
 * only the functions of this table read. All arrays are aligned to whole blocks of LG_SE3_BLOCK copies and
 * have room for them. */
typedef struct lg_se3_stage {
    size_t count;
    const double *c, *const *k, *y, *f;
    double c_new, *k_new;
    double *f_packed; /* not NULL: f, for later */
    double *sigma, *out;
    double *end;  /* not NULL: the step's end, taken back to the manifold as by se3_act, goes here too */
    double *most; /* LG_SE3_BLOCK numbers, 0 at first: the largest |u|^2 so far, or NaN, is among them */
} lg_se3_stage;
#define LG_SE3_BLOCK 8

/* `count` windows of `size` rows of a series, one every `stride` rows, the first begins `padding` rows before
 * the series; a row has `channels` numbers. Window t has rows stride t - padding .. + size - 1; those outside
 * of the series are zero. count = (length + 2 padding - size)/stride + 1 or less. */
typedef struct lg_k_windows {
    size_t length, channels, size, stride, padding, count;
} lg_k_windows;

/* Scalar code: X(enumerator, operands that are results of instructions, all operands). Where there is one
 * more, it is a whole number n (STUMPFF, DEXPINV) or the register of a constant (POW). */
#define LG_SCALAR_LIST(X)                                                                                    \
    X(INPUT, 0, 0)                                                                                           \
    X(CONSTANT, 0, 0)                                                                                        \
    X(ADD, 2, 2)                                                                                             \
    X(SUB, 2, 2)                                                                                             \
    X(MUL, 2, 2)                                                                                             \
    X(DIV, 2, 2)                                                                                             \
    X(NEG, 1, 1)                                                                                             \
    X(MAX, 2, 2)    /* a NaN wins */                                                                         \
    X(GE, 2, 2)     /* a >= b ? 1 : 0 */                                                                     \
    X(SELECT, 3, 3) /* a != 0 ? b : c */                                                                     \
    X(SQRT, 1, 1)                                                                                            \
    X(ABS, 1, 1)                                                                                             \
    X(SIGN, 1, 1) /* a >= 0 ? 1 : -1, NaN stays */                                                           \
    X(POW, 1, 2)                                                                                             \
    X(EXP, 1, 1)                                                                                             \
    X(LOG, 1, 1)                                                                                             \
    X(SIN, 1, 1)                                                                                             \
    X(COS, 1, 1)                                                                                             \
    X(TANH, 1, 1)                                                                                            \
    X(SIGMOID, 1, 1)                                                                                         \
    X(ATAN2, 2, 2)                                                                                           \
    X(STUMPFF, 1, 2) /* derivative number n / 16 of c_(n % 16) at a */                                       \
    X(DEXPINV, 1, 2) /* derivative number n of g2 at a */

typedef enum lg_scalar_op {
#define X(name, instructions, all) LG_S_##name,
    LG_SCALAR_LIST(X)
#undef X
        LG_SCALAR_OPS
} lg_scalar_op;

/* `count` instructions of one sort, none of which needs another one: results in registers result, result + 1,
 * ...; the operands of each, one instruction after the other, from `operands` on. */
typedef struct lg_scalar_group {
    uint32_t op, count, result, operands;
} lg_scalar_group;

#define LG_K_STAGES      16
#define LG_K_STAGE_BLOCK ((size_t)8)

typedef struct lg_kernels {
    lg_dtype dtype;
    lg_isa isa;
    size_t size; /* sizeof(double) or sizeof(float) */

    void (*fill)(size_t n, double value, void *y);
    void (*axpy)(size_t n, double c, const void *x, void *y);                 /* y += c x */
    void (*outer)(size_t m, size_t n, const void *u, const void *v, void *y); /* y (m, n) += u v^T */
    /* y = a u + b v + c y */
    void (*combine)(size_t n, double a, const void *u, double b, const void *v, double c, void *y);
    void (*convert_in)(size_t n, const double *x, void *y);  /* from double */
    void (*convert_out)(size_t n, const void *x, double *y); /* to double */
    bool (*all_finite)(size_t n, const void *x);

    /* y[i] = op(a[i], b[i]) */
    void (*binary[LG_K_BINARIES])(size_t n, const void *a, const void *b, void *y);
    /* y[i, j] = op(a[i*ra + j*ca], b[i*rb + j*cb]), y contiguous (rows, cols); ca, cb in {0, 1} */
    void (*binary_strided[LG_K_BINARIES])(size_t rows, size_t cols, const void *a, size_t ra, size_t ca,
                                          const void *b, size_t rb, size_t cb, void *y);
    void (*unary[LG_K_UNARIES])(size_t n, double c, const void *x, void *y);

    /* Derivative number `order` (0..8) of an activation, times g when g is not NULL.
     * h is the stored helper: tanh: tanh(x); sigmoid and swish: sigmoid(x); others: unused, may be NULL.
     * x may be NULL for tanh and sigmoid when order >= 1 or h is given, and for ReLU and leaky ReLU when h is
     * given (then h is the activation's value, whose sign is that of x). order 0 with h == NULL computes from
     * x. tanh^(n), sigmoid^(n): products over their zeros (act_zeros.h). swish^(n) = x s^(n) + n s^(n-1).
     * ReLU: 1 for x > 0 else 0 (0 at the kink: ties to the zero branch), leaky: LG_LEAKY_SLOPE for x <= 0;
     * orders >= 2 are 0. sine^(n) = sin(x + n pi/2), exactly +-sin or +-cos. identity: x, 1, 0. */
    void (*act)(lg_k_act kind, int order, size_t n, const void *x, const void *h, const void *g, void *y);
    /* One reverse step of y = q sigma^(order)(x) (q NULL: ones) with cotangent c: dq [+]= c sigma^(order),
     * dx [+]= c q sigma^(order + 1); either may be NULL. Whether something is added is said for each.
     * dq and dx do not overlap. */
    void (*act_reverse)(lg_k_act kind, int order, size_t n, const void *x, const void *h, const void *c,
                        const void *q, void *dq, bool add_q, void *dx, bool add_x);
    /* In place: y[i, j] = sigma(y[i, j] + bias[j]); bias may be NULL. Order 0 only. */
    void (*bias_act)(lg_k_act kind, size_t rows, size_t cols, const void *bias, void *y);
    /* y[i, j] = sigma(x), d[i, j] = sigma'(x) at x = d[i, j] + bias[j]; y does not overlap d. */
    void (*act_slope)(lg_k_act kind, size_t rows, size_t cols, const void *bias, void *d, void *y);

    /* y[i] = c[i] != 0 ? a[i] : b[i] */
    void (*select)(size_t n, const void *c, const void *a, const void *b, void *y);
    /* y = (1 - z) u + z v. reverse: cotangents of in = (z, u, v) from g, y's one, into out[k], NULL where it
     * is not asked for; added where add[k]. No two of them overlap. */
    void (*mix)(size_t n, const void *z, const void *u, const void *v, void *y);
    void (*mix_reverse)(size_t n, const void *const *in, const void *g, void *const *out, const bool *add);
    /* Pairs of a value and its derivative in a direction: arrays of 2 n numbers, n = rows cols of values and
     * n of derivatives. dual_mix: mix of pairs. dual_act, in place: (x, x') -> (sigma(x + bias), sigma'(x +
     * bias) x'), bias may be NULL; `cosines` (n), of the sine, or NULL. dual_act_reverse: d [+]= the
     * cotangent of (x + bias, x') from g, that of y; x, the argument with its bias, is read for swish and
     * sine alone and may be NULL for the others; `cosines` NULL: computed again. */
    void (*dual_mix)(size_t n, const void *z, const void *u, const void *v, void *y);
    void (*dual_mix_reverse)(size_t n, const void *const *in, const void *g, void *const *out,
                             const bool *add);
    void (*dual_act)(lg_k_act kind, size_t rows, size_t cols, const void *bias, void *cosines, void *y);
    void (*dual_act_reverse)(lg_k_act kind, size_t n, const void *x, const void *cosines, const void *y,
                             const void *g, void *d, bool add);

    /* C(m, n) = [C +] A(m, k) B(k, n): element (i, l) of A at a[i*ra + l*ca] (one of ra, ca is usually 1), B
     * row-major with leading dimension ldb, C with ldc. Each element of C is one chain of fma over l = 0..k-1
     * starting from 0 and, with `accumulate`, added to C at the end: the result does not depend on m, n,
     * blocking or the position in C. k == 0 gives zero. */
    void (*gemm)(size_t m, size_t n, size_t k, const void *a, size_t ra, size_t ca, const void *b, size_t ldb,
                 void *c, size_t ldc, bool accumulate);
    /* y(m) = [y +] A(m, k) x(k), all contiguous: several partial sums a row, in an order that depends on k
     * alone where m and k are at least 8. */
    void (*matvec)(size_t m, size_t k, const void *a, const void *x, void *y, bool accumulate);
    /* y(cols, rows) = transpose of x(rows, cols), both contiguous */
    void (*transpose)(size_t rows, size_t cols, const void *x, void *y);

    /* Of series x (batch, length, channels) and their windows, y and g (batch, count, channels).
     * mean: of each window; pick: of h in the row of the window in which x is largest (ties: the first; a NaN
     * is larger than all); no padding. place: g into that row of `to`, [added to] zeros. fold: x[u] = [x[u]
     * +] factor times the sum over windows t that have row u, as their row j, of the channels at from[t pitch
     * + j inner], t ascending; a sample's windows follow the windows of the one before. `times`, as long as
     * x: each sum is multiplied by its number, and nothing is added to; or NULL. */
    void (*window_mean)(const lg_k_windows *w, size_t batch, const void *x, void *y);
    void (*window_pick)(const lg_k_windows *w, size_t batch, const void *h, const void *x, void *y);
    void (*window_place)(const lg_k_windows *w, size_t batch, const void *g, const void *x, void *to,
                         bool add);
    void (*window_fold)(const lg_k_windows *w, size_t batch, double factor, const void *from, size_t pitch,
                        size_t inner, const void *times, void *x, bool add);

    double (*sum)(size_t n, const void *x);
    double (*dot)(size_t n, const void *a, const void *b);
    /* y[j] = [y[j] +] sum_i x[i, j], accumulated in the type over rows in order */
    void (*sum_rows)(size_t rows, size_t cols, const void *x, void *y, bool accumulate);
    void (*sum_cols)(size_t rows, size_t cols, const void *x, void *y); /* y[i] = sum_j x[i, j], in order */

    void (*cross)(size_t rows, const void *a, const void *b, void *y); /* rows of 3 */
    void (*rowdot)(size_t rows, size_t cols, const void *a, const void *b,
                   void *y); /* y[i] = sum_j a[i,j] b[i,j] */

    /* y[i, k] = d^order/dw^order c_k(w[i]), k = 0..K, y is (n, K + 1). Computed in double for both types.
     * c_k(w) = sum_j (-w)^j/(k + 2j)!; dc_k/dw = (k c_{k+2} - c_{k+1})/2. Any finite w (negative too);
     * 0 <= order <= 8, 0 <= K <= 8. */
    void (*stumpff)(size_t n, int K, int order, const void *w, void *y);
    /* y[i] = d^order/dw^order g2(w[i]), g2 = (1 - (x/2) cot(x/2))/x^2, w = x^2, pole form; in double. */
    void (*dexpinv_coef)(size_t n, int order, const void *w, void *y);

    /* Lie group actions on many copies, in double in both tables; results do not depend on a copy's position;
     * out may be an input. liegrad/geometry.h has the formulas, a = (u, v) six numbers a copy.
     * se3_act: on T*S^2, y = (q, p) six numbers, exp(a) . y; where |q|^2 is then within LG_LIE_ROUNDING of 1,
     * it is returned to 1 to first order, and q.p to 0 where it is within LG_LIE_ROUNDING of 0 relative to
     * (1, r, p).
     * se3_dexpinv: out = dexp_a^-1(b). se3_angle: the largest |u|, NaN when there is one. */
    void (*se3_act)(size_t count, const double *a, const double *y, double *out);
    void (*se3_dexpinv)(size_t count, const double *a, const double *b, double *out);
    double (*se3_angle)(size_t count, const double *a);
    /* se3_pack: plain to packed. se3_stage: the sum of n terms k_j, 0 <= n. se3_estimate: the same k_new and
     * sum, out = (the sum) . y, an ambient vector; sigma, end and most stay. */
    void (*se3_pack)(size_t count, const double *x, double *packed);
    void (*se3_stage)(int n, const lg_se3_stage *stage);
    void (*se3_estimate)(int n, const lg_se3_stage *stage);

    /* Scalar code on registers of the table's type. */
    void (*scalars)(size_t groups, const lg_scalar_group *group, const uint32_t *operands, void *registers);

    /* Of integrators, in double in both tables, the same bits on every set.
     * stage_sum: out = sum_{j < n} c_j k_j, 1 <= n <= LG_K_STAGES, rows aligned to LG_ALIGNMENT, m a
     * multiple of LG_K_STAGE_BLOCK.
     * error_norm: root mean square of error_i / (atol_i + rtol max(|y_i|, |y_next_i|)), 0/0 counts as 0. */
    void (*stage_sum)(size_t m, int n, const double *c, const double *const *k, double *out);
    double (*error_norm)(size_t dim, double rtol, const double *atol, const double *error, const double *y,
                         const double *y_next);

    /* One map on n rows, in double in both tables; `columns`: of the matrices x, 1 for vectors. reverse: the
     * inputs' cotangents from g, y's one, into out[k], NULL where it is not asked for; added where add[k].
     * Those that are only written overlap no other. */
    void (*lie[LG_K_LIE_MAPS])(size_t n, size_t columns, const void *const *in, void *y);
    void (*lie_reverse[LG_K_LIE_MAPS])(size_t n, size_t columns, const void *const *in, const void *g,
                                       void *const *out, const bool *add);

    /* Batches of n symmetric positive definite k x k systems. factor: L = Cholesky factor (lower; upper part
     * zero) of (A + A^T)/2; a row whose pivot is not positive becomes all NaN and is counted in the returned
     * number. solve: x(n, k, m) = A^-1 b(n, k, m) from L; x == b allowed. */
    size_t (*spd_factor)(size_t n, size_t k, const void *a, void *l);
    void (*spd_solve)(size_t n, size_t k, size_t m, const void *l, const void *b, void *x);

    /* One fused pass: g' = clip g; m = b1 m + (1-b1) g'; v = b2 v + (1-b2) g'^2;
     * theta = theta - lr decay theta - lr (m/(1-b1^t)) / (sqrt(v/(1-b2^t)) + eps). Decoupled weight decay
     * when `decoupled`, else g' = clip g + decay theta (the L2 form). correction1 = 1-b1^t, correction2 =
     * 1-b2^t. */
    void (*adam)(size_t n, double lr, double beta1, double beta2, double eps, double correction1,
                 double correction2, double decay, bool decoupled, double clip, const void *g, void *m,
                 void *v, void *theta);
} lg_kernels;

/* The table for the instruction set in use. Never NULL; constant. */
const lg_kernels *lg_kernels_for(lg_dtype dtype);
/* A given set's table, or NULL when this build or machine does not have it. For tests. */
const lg_kernels *lg_kernels_of(lg_dtype dtype, lg_isa isa);

#endif

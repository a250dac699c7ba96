/* The kernels: all inner loops over numbers. Each family of kernels has one source file, which is compiled
 * for both types and for each instruction set. A tape holds a pointer to one table of kernels and never
 * branches on type.
 *
 * Conventions. Arrays are contiguous unless strides are given. `size_t n` is the number of elements. Pointers
 * are to the table's type (double or float) unless declared otherwise; 64-byte alignment is usual but not
 * required. Outputs must not overlap inputs, except where a comment says "in place"; in kernels that take n,
 * y may also be the same array as an input. No kernel allocates, locks or fails. Elementwise results do not
 * depend on an element's position. Reductions (sum, dot, sum_rows, sum_cols, rowdot) have a fixed order; in
 * f32 they accumulate in double if they have more than 32 terms. "[+]=" means: set, or added to if the flag
 * `add` or `accumulate` says so; [y +] likewise.
 */
#ifndef LG_KERNELS_H
#define LG_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "core/core.h"
#include "liegrad/core.h"

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
    LG_K_SIGN, /* 1 for x >= 0 (also for zeros), else -1; NaN stays NaN */
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

/* Maps of so(3) and se(3) on rows of three numbers. The comments name the inputs, then the map. The result y
 * and the cotangents of y have the shape of the last input. liegrad/geometry.h has the formulas. */
typedef enum lg_k_lie {
    LG_K_SO3_EXP,     /* u, x: exp(u) x; x is a vector or a row-major matrix, 9 numbers per row */
    LG_K_SO3_DEXP,    /* u, v: dexp_u(v) */
    LG_K_SE3_ACT,     /* u, v, q, p: the second half (three numbers) of exp(u, v) . (q, p) */
    LG_K_SO3_DEXPINV, /* A, B: dexp_A^-1(B) */
    LG_K_SE3_DEXPINV, /* A, a, B, b: the second half (three numbers) of dexp_(A, a)^-1(B, b) */
    LG_K_LIE_MAPS
} lg_k_lie;
#define LG_K_LIE_INPUTS 4

#define LG_K_ACT_ORDERS 8 /* highest order of derivative of an activation */
#define LG_LEAKY_SLOPE  0.01

/* A point whose distance from its manifold is at most this is assumed to be off by rounding alone, and is put
 * back. The limit is many times the rounding error of a step. */
#define LG_LIE_ROUNDING 1e-13

/* One stage of a Runge-Kutta-Munthe-Kaas step on many copies of T*S^2. First, unless f is NULL, k_new =
 * dexp_sigma^-1(f), where f is the vector field's value at the previous stage and sigma that stage's
 * exponent. Then sigma = sum_j c_j k_j + c_new k_new and out = exp(sigma) . y. f and out are plain arrays,
 * six numbers per copy. All others are packed: blocks in a layout that only the functions of this table know.
 * All arrays are aligned to whole blocks of LG_SE3_BLOCK copies and have room for whole blocks. */
typedef struct lg_se3_stage {
    size_t count;
    const double *c, *const *k, *y, *f;
    double c_new, *k_new;
    double *f_packed; /* if not NULL, f is also stored here, packed */
    double *sigma, *out;
    /* If not NULL, the end of the step is also stored here, put back on the manifold as in se3_act. */
    double *end;
    /* LG_SE3_BLOCK numbers, initially 0. The largest of them is the largest |u|^2 so far, or NaN if there was
     * one. */
    double *most;
} lg_se3_stage;
#define LG_SE3_BLOCK 8

/* `count` windows of `size` rows of a series, one every `stride` rows. A row has `channels` numbers. Window t
 * begins at row stride t - padding of the series; rows outside of the series are zero. count is at most
 * (length + 2 padding - size)/stride + 1. */
typedef struct lg_k_windows {
    size_t length, channels, size, stride, padding, count;
} lg_k_windows;

/* Scalar code: X(name, number of operands that are results of other instructions, number of all operands).
 * The additional operand of STUMPFF and DEXPINV is an integer n, the one of POW is the register of a
 * constant. */
#define LG_SCALAR_LIST(X)                                                                                    \
    X(INPUT, 0, 0)                                                                                           \
    X(CONSTANT, 0, 0)                                                                                        \
    X(ADD, 2, 2)                                                                                             \
    X(SUB, 2, 2)                                                                                             \
    X(MUL, 2, 2)                                                                                             \
    X(DIV, 2, 2)                                                                                             \
    X(NEG, 1, 1)                                                                                             \
    X(MAX, 2, 2)    /* if a or b is NaN, the result is NaN */                                                \
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
    X(STUMPFF, 1, 2) /* derivative of order n / 16 of c_(n % 16), at a */                                    \
    X(DEXPINV, 1, 2) /* derivative of order n of g2, at a */

typedef enum lg_scalar_op {
#define X(name, instructions, all) LG_S_##name,
    LG_SCALAR_LIST(X)
#undef X
        LG_SCALAR_OPS
} lg_scalar_op;

/* `count` instructions of the same operation that do not depend on each other. Their results go to the
 * registers result, result + 1, ... Their operands begin at index `operands`, one instruction after the
 * other. */
typedef struct lg_scalar_group {
    uint32_t op, count, result, operands;
} lg_scalar_group;

#define LG_K_ROWS        ((size_t)32)
#define LG_K_STAGES      16
#define LG_K_STAGE_BLOCK ((size_t)8)

/* Sizes of `small_products`. Element (i, l) of A_s is at a[s step_a + i ra + l ca], element (l, j) of B_s at
 * b[s step_b + l rb + j cb]. The C_s are row-major, one behind the other. */
typedef struct lg_small_products {
    size_t count, m, n, k, step_a, ra, ca, step_b, rb, cb;
    bool accumulate;
} lg_small_products;

typedef struct lg_kernels {
    lg_dtype dtype;
    lg_isa isa;
    size_t size; /* sizeof(double) or sizeof(float) */

    void (*fill)(size_t n, double value, void *y);
    void (*axpy)(size_t n, double c, const void *x, void *y);                 /* y += c x */
    void (*outer)(size_t m, size_t n, const void *u, const void *v, void *y); /* y (m, n) += u v^T */
    /* y = a u + b v + c y */
    void (*combine)(size_t n, double a, const void *u, double b, const void *v, double c, void *y);
    void (*convert_in)(size_t n, const double *x, void *y);  /* y = x, converted from double */
    void (*convert_out)(size_t n, const void *x, double *y); /* y = x, converted to double */
    bool (*all_finite)(size_t n, const void *x);

    /* y[i] = op(a[i], b[i]) */
    void (*binary[LG_K_BINARIES])(size_t n, const void *a, const void *b, void *y);
    /* y[i, j] = op(a[i*ra + j*ca], b[i*rb + j*cb]), y contiguous (rows, cols); ca, cb in {0, 1} */
    void (*binary_strided[LG_K_BINARIES])(size_t rows, size_t cols, const void *a, size_t ra, size_t ca,
                                          const void *b, size_t rb, size_t cb, void *y);
    void (*unary[LG_K_UNARIES])(size_t n, double c, const void *x, void *y);

    /* The derivative of order `order` (0..8) of an activation sigma, multiplied by g unless g is NULL. h is a
     * helper that the caller may have stored: tanh(x) for tanh; sigmoid(x) for sigmoid and swish; sigma(x)
     * for ReLU and leaky ReLU, where it replaces x because it has the same sign; unused for the others. x may
     * be NULL if h is given for tanh, sigmoid, ReLU and leaky ReLU. If h is NULL, it is computed from x.
     * - tanh^(n) and sigmoid^(n) are products over their zeros (act_zeros.h). swish^(n) = x s^(n) + n s^(n-1)
     *   with s = sigmoid(x). sine^(n) = sin(x + n pi/2), computed as +-sin or +-cos. ReLU': 1 for x > 0, else
     *   0 (also at x = 0). Leaky ReLU': 1 for x > 0, else LG_LEAKY_SLOPE. Orders >= 2 of these two and of the
     *   identity are 0. */
    void (*act)(lg_k_act kind, int order, size_t n, const void *x, const void *h, const void *g, void *y);
    /* One reverse step of y = q sigma^(order)(x) with the cotangent c of y: dq [+]= c sigma^(order)(x) and dx
     * [+]= c q sigma^(order + 1)(x). q == NULL stands for ones. dq and dx may be NULL and must not overlap.
     * add_q and add_x say whether the result is added. */
    void (*act_reverse)(lg_k_act kind, int order, size_t n, const void *x, const void *h, const void *c,
                        const void *q, void *dq, bool add_q, void *dx, bool add_x);
    /* In place: y[i, j] = sigma(y[i, j] + bias[j]). bias may be NULL. */
    void (*bias_act)(lg_k_act kind, size_t rows, size_t cols, const void *bias, void *y);
    /* At x = d[i, j] + bias[j]: y[i, j] = sigma(x), and d[i, j] becomes sigma'(x). y must not overlap d. */
    void (*act_slope)(lg_k_act kind, size_t rows, size_t cols, const void *bias, void *d, void *y);

    /* y[i] = c[i] != 0 ? a[i] : b[i] */
    void (*select)(size_t n, const void *c, const void *a, const void *b, void *y);
    /* mix: y = (1 - z) u + z v. mix_reverse: in = (z, u, v), g is the cotangent of y. The cotangent of in[k]
     * is written to out[k], or added to it if add[k]; out[k] == NULL means that it is not wanted. No two of
     * these arrays overlap. */
    void (*mix)(size_t n, const void *z, const void *u, const void *v, void *y);
    void (*mix_reverse)(size_t n, const void *const *in, const void *g, void *const *out, const bool *add);

    /* C(m, n) = [C +] A(m, k) B(k, n). Element (i, l) of A is at a[i*ra + l*ca]; one of ra, ca is usually 1.
     * B is row-major with leading dimension ldb, C with ldc. Each element of C is one chain of fma over l =
     * 0..k-1 that starts from 0 and, with `accumulate`, is added to C at the end. So the result does not
     * depend on m, n, blocking or the position in C. k == 0 gives a zero sum. */
    void (*gemm)(size_t m, size_t n, size_t k, const void *a, size_t ra, size_t ca, const void *b, size_t ldb,
                 void *c, size_t ldc, bool accumulate);
    /* C_s (m, n) = [C_s +] A_s (m, k) B_s (k, n) for s = 0..count-1, with the same bits as gemm; for matrices
     * of a few elements. */
    void (*small_products)(const lg_small_products *p, const void *a, const void *b, void *c);
    /* y(m) = [y +] A(m, k) x(k), all contiguous. If m and k are at least 2, 4 or 8 (by the set), each row may
     * have several partial sums, in an order that depends on k alone. */
    void (*matvec)(size_t m, size_t k, const void *a, const void *x, void *y, bool accumulate);
    /* y(cols, rows) = transpose of x(rows, cols), both contiguous */
    void (*transpose)(size_t rows, size_t cols, const void *x, void *y);

    /* Kernels on series x (batch, length, channels) and their windows; y and g are (batch, count, channels).
     * - window_mean: the mean of each window, without padding. window_pick: in each window and channel, the
     *   element of h in the row where x is largest. Of equal rows the first one counts, and a NaN counts as
     *   the largest. Without padding. window_place: writes g to these rows of `to` and zeros to all others,
     *   or adds it if `add`.
     * - window_fold: x[u] = [x[u] +] factor times a sum over all windows t that contain row u. If u is row j
     *   of window t, the term is the row of `channels` numbers at from[t pitch + j inner]. The sum runs in
     *   ascending t. The windows of a sample follow the windows of the previous sample. If `times` (same size
     *   as x) is not NULL, each sum is multiplied by its element of `times`, and nothing may be added to. */
    void (*window_mean)(const lg_k_windows *w, size_t batch, const void *x, void *y);
    void (*window_pick)(const lg_k_windows *w, size_t batch, const void *h, const void *x, void *y);
    void (*window_place)(const lg_k_windows *w, size_t batch, const void *g, const void *x, void *to,
                         bool add);
    void (*window_fold)(const lg_k_windows *w, size_t batch, double factor, const void *from, size_t pitch,
                        size_t inner, const void *times, void *x, bool add);

    /* Convolutions with nine taps, `step` samples apart. taps_sum: y[t] = sum_{j < 9} x[t + j step].
     * taps_apply: y[t] = [y[t] +] sign (3 (x[0][t] + x[1][t] + x[2][t]) - sum[t]), that is, weight 2 for the
     * three taps at x[0], x[1], x[2] and weight -1 for the six others; sign is 1 or -1. count_above:
     * count[j] = how many of the n numbers of x are above level[j]. All three have the same bits for all
     * instruction sets. */
    void (*taps_sum)(size_t n, const void *x, size_t step, void *y);
    void (*taps_apply)(size_t n, const void *const *x, const void *sum, double sign, void *y, bool add);
    void (*count_above)(size_t n, const void *x, size_t levels, const void *level, uint32_t *count);

    double (*sum)(size_t n, const void *x);
    double (*dot)(size_t n, const void *a, const void *b);
    /* y[j] = [y[j] +] sum_i x[i, j], in the order of the rows */
    void (*sum_rows)(size_t rows, size_t cols, const void *x, void *y, bool accumulate);
    /* y[i] = sum_j x[i, j] */
    void (*sum_cols)(size_t rows, size_t cols, const void *x, void *y);

    void (*cross)(size_t rows, const void *a, const void *b, void *y); /* rows of 3 numbers */
    void (*rowdot)(size_t rows, size_t cols, const void *a, const void *b,
                   void *y); /* y[i] = sum_j a[i,j] b[i,j] */

    /* y[i, k] = d^order/dw^order c_k(w[i]) for k = 0..K; y is (n, K + 1). Computed in double for both types.
     * c_k(w) = sum_j (-w)^j/(k + 2j)!, and dc_k/dw = (k c_{k+2} - c_{k+1})/2. w may be any finite number,
     * also negative. 0 <= order <= 8, 0 <= K <= 8. */
    void (*stumpff)(size_t n, int K, int order, const void *w, void *y);
    /* y[i] = d^order/dw^order g2(w[i]), where g2 = (1 - (x/2) cot(x/2))/x^2 and w = x^2. Computed in double
     * for both types. */
    void (*dexpinv_coef)(size_t n, int order, const void *w, void *y);

    /* Lie group actions on many copies, in double in both tables. Results do not depend on a copy's position.
     * `out` may be the same array as an input. liegrad/geometry.h has the formulas; a = (u, v) has six
     * numbers per copy.
     * - se3_act: out = exp(a) . y on T*S^2, y = (q, p) with six numbers per copy. If |q|^2 of the result is
     *   within LG_LIE_ROUNDING of 1, it is corrected to 1 to first order. If then also |q.p| <=
     *   LG_LIE_ROUNDING |(1, r, p)|, where r is the translation of exp(a), q.p is corrected to 0.
     * - se3_dexpinv: out = dexp_a^-1(b). se3_angle: returns the largest |u|, or NaN if any is NaN. */
    void (*se3_act)(size_t count, const double *a, const double *y, double *out);
    void (*se3_dexpinv)(size_t count, const double *a, const double *b, double *out);
    double (*se3_angle)(size_t count, const double *a);
    /* se3_pack converts plain copies to packed ones. se3_stage computes a stage whose sum has n >= 0 terms
     * c_j k_j. se3_estimate computes k_new and the sum of the exponents in the same way, but out = (the sum)
     * . y, the algebra's action, which is a vector of the ambient space. It leaves sigma, end and most as
     * they are. */
    void (*se3_pack)(size_t count, const double *x, double *packed);
    void (*se3_stage)(int n, const lg_se3_stage *stage);
    void (*se3_estimate)(int n, const lg_se3_stage *stage);

    /* Runs scalar code on an array of registers of the table's type. */
    void (*scalars)(size_t groups, const lg_scalar_group *group, const uint32_t *operands, void *registers);
    /* Runs scalar code for n <= LG_K_ROWS rows of a batch. Register i of row b is element i LG_K_ROWS + b of
     * the array `registers`. */
    void (*row_scalars)(size_t n, size_t groups, const lg_scalar_group *group, const uint32_t *operands,
                        void *registers);
    /* load_rows copies x[b apart + i] to register i of row b. store_rows copies register from[i] of row b to
     * y[b apart + i]. b = 0..n-1, i = 0..count-1. With apart = 0 load_rows copies the same elements to all
     * rows. */
    void (*load_rows)(size_t n, size_t count, size_t apart, const void *x, void *registers);
    void (*store_rows)(size_t n, size_t count, const uint32_t *from, size_t apart, const void *registers,
                       void *y);

    /* Kernels for integrators, in double in both tables. All instruction sets give the same bits.
     * - stage_sum: out = sum_{j < n} c_j k_j, 1 <= n <= LG_K_STAGES. The arrays are aligned to LG_ALIGNMENT
     *   and m is a multiple of LG_K_STAGE_BLOCK.
     * - error_norm: the root mean square of error_i / (atol_i + rtol max(|y_i|, |y_next_i|)), where 0/0
     *   counts as 0. */
    void (*stage_sum)(size_t m, int n, const double *c, const double *const *k, double *out);
    double (*error_norm)(size_t dim, double rtol, const double *atol, const double *error, const double *y,
                         const double *y_next);

    /* A map of lg_k_lie on n rows, computed in double in both tables. `columns` is the number of columns of
     * the matrices x, or 1 for vectors. lie_reverse computes the cotangents of the inputs from g, the
     * cotangent of y. The cotangent of in[k] is written to out[k], or added to it if add[k]; out[k] == NULL
     * means that it is not wanted. Arrays that are only written overlap no other array. */
    void (*lie[LG_K_LIE_MAPS])(size_t n, size_t columns, const void *const *in, void *y);
    void (*lie_reverse[LG_K_LIE_MAPS])(size_t n, size_t columns, const void *const *in, const void *g,
                                       void *const *out, const bool *add);

    /* Batches of n symmetric positive definite k x k systems. spd_factor: l is the Cholesky factor of (A +
     * A^T)/2, lower triangular with a zero upper part. If a pivot of a system is not positive, all elements
     * of its factor become NaN; the number of these systems is returned. spd_solve: x(n, k, m) = A^-1 b(n, k,
     * m) from the factors l. x may be the same array as b. */
    size_t (*spd_factor)(size_t n, size_t k, const void *a, void *l);
    void (*spd_solve)(size_t n, size_t k, size_t m, const void *l, const void *b, void *x);

    /* A step of Adam in one pass: g' = clip g; m = b1 m + (1-b1) g'; v = b2 v + (1-b2) g'^2; theta = theta -
     * lr decay theta - lr (m/(1-b1^t)) / (sqrt(v/(1-b2^t)) + eps). This is decoupled weight decay
     * (`decoupled`). Otherwise decay enters through g' = clip g + decay theta (the L2 form) and the term lr
     * decay theta is absent. correction1 = 1-b1^t, correction2 = 1-b2^t. */
    void (*adam)(size_t n, double lr, double beta1, double beta2, double eps, double correction1,
                 double correction2, double decay, bool decoupled, double clip, const void *g, void *m,
                 void *v, void *theta);
} lg_kernels;

/* The table for the instruction set in use. Never NULL; always the same. Exported because liegrad_classify
 * uses it. */
LG_API const lg_kernels *lg_kernels_for(lg_dtype dtype);
/* The table of a given instruction set, or NULL if this build or machine does not have the set. For tests. */
const lg_kernels *lg_kernels_of(lg_dtype dtype, lg_isa isa);

#endif

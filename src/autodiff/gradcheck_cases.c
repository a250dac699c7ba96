/* The registry: rows for every operation of LG_OP_LIST in the variants of shapes and attributes that matter.
 */
#include "autodiff/dual.h"
#include "autodiff/gradcheck_internal.h"
#include "autodiff/lie.h"

#include <math.h>

/* ---- how rows are written ---- */

#define S0                                                                                                   \
    {                                                                                                        \
        0, {                                                                                                 \
            0, 0, 0, 0                                                                                       \
        }                                                                                                    \
    }
#define S1(a)                                                                                                \
    {                                                                                                        \
        1, {                                                                                                 \
            a, 0, 0, 0                                                                                       \
        }                                                                                                    \
    }
#define S2(a, b)                                                                                             \
    {                                                                                                        \
        2, {                                                                                                 \
            a, b, 0, 0                                                                                       \
        }                                                                                                    \
    }
#define S3(a, b, c)                                                                                          \
    {                                                                                                        \
        3, {                                                                                                 \
            a, b, c, 0                                                                                       \
        }                                                                                                    \
    }
#define S4(a, b, c, d)                                                                                       \
    {                                                                                                        \
        4, {                                                                                                 \
            a, b, c, d                                                                                       \
        }                                                                                                    \
    }

#define IN(...)                                                                                              \
    { .shape = __VA_ARGS__ }
#define IN_RANGE(a, b, ...)                                                                                  \
    { .shape = __VA_ARGS__, .low = a, .high = b }
#define IN_VALUES(v, ...)                                                                                    \
    { .shape = __VA_ARGS__, .values = v }
#define INPUTS(...)                                                                                          \
    .inputs = (uint32_t)(sizeof((lg_gradcheck_argument[]){__VA_ARGS__}) / sizeof(lg_gradcheck_argument)),    \
    .arguments = (const lg_gradcheck_argument[]) {                                                           \
        __VA_ARGS__                                                                                          \
    }

/* What a build function is told besides its inputs. */
typedef struct settings {
    int i[5];
    double c;
    lg_shape shape;
} settings;
#define WITH(...)                                                                                            \
    .user = &(const settings) {                                                                              \
        __VA_ARGS__                                                                                          \
    }

#define ROW(name_, op, build_, ...)                                                                          \
    {                                                                                                        \
        .function = {.name = name_, .build = build_, __VA_ARGS__}, .operations = { op }                      \
    }
#define ROW_ZERO(name_, op, build_, ...)                                                                     \
    { .function = {.name = name_, .build = build_, __VA_ARGS__}, .operations = {op}, .zero = true }
#define ROW_STOPS(name_, op, build_, ...)                                                                    \
    {                                                                                                        \
        .function = {.name = name_, .build = build_, .stops = true, __VA_ARGS__}, .operations = {op},        \
        .zero = true                                                                                         \
    }
#define ROW_TWO(name_, op, op2, build_, ...)                                                                 \
    {                                                                                                        \
        .function = {.name = name_, .build = build_, __VA_ARGS__}, .operations = { op, op2 }                 \
    }
#define ROW_COMPOSED(name_, build_, ...)                                                                     \
    {                                                                                                        \
        .function = {.name = name_, .build = build_, __VA_ARGS__ }                                           \
    }

/* Numbers at least 1/4 away from zero, from each other by 1/2 within a table, by 1/4 between the tables. */
static const double apart[24] = {0.5,  -1.5, 3.0,  -2.5, 1.0,  5.5, -0.5, 2.0, -3.0, 4.5, -4.0, 1.5,
                                 -1.0, 6.0,  -5.5, 3.5,  -2.0, 2.5, -6.0, 4.0, -3.5, 5.0, -4.5, -5.0};
static const double between[24] = {-0.75, 2.25, -1.25, 0.75,  1.75, -5.25, 0.25,  4.25,
                                   -0.25, 3.25, 5.25,  -1.75, 2.75, -2.25, 6.25,  -3.25,
                                   1.25,  4.75, -2.75, -4.25, 3.75, -5.75, -3.75, 5.75};

#define BUILD(name) static lg_var name(const void *user, lg_tape *t, const lg_var *x)
#define SETTINGS    const settings *s = user

/* ---- elementwise ---- */

#define BUILD_BINARY(op)                                                                                     \
    BUILD(build_##op) {                                                                                      \
        (void)user;                                                                                          \
        return lg_##op(t, x[0], x[1]);                                                                       \
    }
BUILD_BINARY(add)
BUILD_BINARY(sub)
BUILD_BINARY(mul)
BUILD_BINARY(div)
BUILD_BINARY(max)
BUILD_BINARY(rowdot)
BUILD_BINARY(cross)
BUILD_BINARY(mse)

#define BUILD_UNARY(op)                                                                                      \
    BUILD(build_##op) {                                                                                      \
        (void)user;                                                                                          \
        return lg_##op(t, x[0]);                                                                             \
    }
BUILD_UNARY(neg)
BUILD_UNARY(square)
BUILD_UNARY(sqrt)
BUILD_UNARY(exp)
BUILD_UNARY(log)
BUILD_UNARY(sin)
BUILD_UNARY(cos)
BUILD_UNARY(abs)
BUILD_UNARY(sign)
BUILD_UNARY(stop_gradient)
BUILD_UNARY(sum)
BUILD_UNARY(mean)
BUILD_UNARY(transpose)
BUILD_UNARY(rownorm2)
BUILD_UNARY(log_softmax)

BUILD(build_leaf) {
    (void)user, (void)t;
    return x[0];
}
BUILD(build_ge) {
    (void)user;
    return lg_record(t, LG_OP_GE, x, 2, NULL);
}
BUILD(build_scale) {
    SETTINGS;
    return lg_scale(t, x[0], s->c);
}
BUILD(build_shift) {
    SETTINGS;
    return lg_shift(t, x[0], s->c);
}
BUILD(build_pow) {
    SETTINGS;
    return lg_pow(t, x[0], s->c);
}
BUILD(build_mul_self) {
    (void)user;
    return lg_mul(t, x[0], x[0]);
}

static const double coefficients[5] = {0.5, -1.25, 2.0, -0.75, 1.5};
BUILD(build_combine) {
    (void)user;
    return lg_combine(t, x, coefficients, 3);
}
/* A term more than once, each time with its own coefficient. */
BUILD(build_combine_repeated) {
    (void)user;
    lg_var terms[5] = {x[0], x[1], x[0], lg_mul(t, x[0], x[1]), x[1]};
    return lg_combine(t, terms, coefficients, 5);
}

BUILD(build_mix) {
    (void)user;
    return lg_mix(t, x[0], x[1], x[2]);
}
/* One variable in two places. */
BUILD(build_mix_itself) {
    (void)user;
    return lg_mix(t, x[0], x[1], x[0]);
}

/* Both orders of each pattern of broadcasting; `a` and `b` make an argument of a shape. */
#define BINARY_ROWS(op, a, b)                                                                                \
    ROW(#op " (4, 3) (4, 3)", #op, build_##op, INPUTS(a(S2(4, 3)), b(S2(4, 3)))),                            \
        ROW(#op " (4, 1) (4, 3)", #op, build_##op, INPUTS(a(S2(4, 1)), b(S2(4, 3)))),                        \
        ROW(#op " (4, 3) (4, 1)", #op, build_##op, INPUTS(a(S2(4, 3)), b(S2(4, 1)))),                        \
        ROW(#op " (3) (4, 3)", #op, build_##op, INPUTS(a(S1(3)), b(S2(4, 3)))),                              \
        ROW(#op " (4, 3) (1, 3)", #op, build_##op, INPUTS(a(S2(4, 3)), b(S2(1, 3)))),                        \
        ROW(#op " () (4, 3)", #op, build_##op, INPUTS(a(S0), b(S2(4, 3)))),                                  \
        ROW(#op " (4, 3) ()", #op, build_##op, INPUTS(a(S2(4, 3)), b(S0))),                                  \
        ROW(#op " (4, 1) (1, 3)", #op, build_##op, INPUTS(a(S2(4, 1)), b(S2(1, 3)))),                        \
        ROW(#op " (2, 1, 3) (4, 1)", #op, build_##op, INPUTS(a(S3(2, 1, 3)), b(S2(4, 1)))),                  \
        ROW(#op " (2, 1, 2, 3) (2, 2, 1, 3)", #op, build_##op, INPUTS(a(S4(2, 1, 2, 3)), b(S4(2, 2, 1, 3))))
#define ANY(...)      IN(__VA_ARGS__)
#define POSITIVE(...) IN_RANGE(0.5, 2.0, __VA_ARGS__)
#define APART(...)    IN_VALUES(apart, __VA_ARGS__)
#define BETWEEN(...)  IN_VALUES(between, __VA_ARGS__)

/* ---- activations ---- */

BUILD(build_act) {
    SETTINGS;
    return lg_act(t, x[0], (lg_activation)s->i[0]);
}
BUILD(build_act_derivative) {
    SETTINGS;
    return lg_act_derivative(t, x[0], (lg_activation)s->i[0], s->i[1]);
}
/* The family's member with a factor: x[1] sigma'(x[0]), as a vjp records it. */
BUILD(build_act_times) {
    SETTINGS;
    lg_var y = lg_act(t, x[0], (lg_activation)s->i[0]), out = LG_NONE;
    (void)lg_vjp(t, &y, &x[1], 1, x, 1, &out);
    return out;
}
#define ACT_ROW(label, kind) ROW("act " label, "act", build_act, WITH(.i = {kind}), INPUTS(APART(S2(4, 3))))
#define ACT_ORDER(label, kind, order)                                                                        \
    ROW("act_derivative " label " " #order, "act_derivative", build_act_derivative,                          \
        WITH(.i = {kind, order}), INPUTS(ANY(S2(4, 3))))
#define ACT_ORDERS(label, kind)                                                                              \
    ACT_ORDER(label, kind, 1), ACT_ORDER(label, kind, 2), ACT_ORDER(label, kind, 3)
#define ACT_FLAT(label, kind, order)                                                                         \
    ROW_ZERO("act_derivative " label " " #order, "act_derivative", build_act_derivative,                     \
             WITH(.i = {kind, order}), INPUTS(APART(S2(4, 3))))
#define ACT_FLATS(label, kind) ACT_FLAT(label, kind, 1), ACT_FLAT(label, kind, 2), ACT_FLAT(label, kind, 3)
#define ACT_TIMES(label, kind)                                                                               \
    ROW("act_derivative " label " with a factor", "act_derivative", build_act_times, WITH(.i = {kind}),      \
        INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3))))

/* ---- products ---- */

BUILD(build_matmul) {
    SETTINGS;
    lg_var (*const variants[3])(lg_tape *, lg_var, lg_var) = {lg_matmul, lg_matmul_nt, lg_matmul_tn};
    return variants[s->i[0]](t, x[0], x[s->i[1] ? 0 : 1]);
}
BUILD(build_matmul_add) {
    (void)user;
    return lg_matmul_add(t, x[0], x[1], x[2]);
}
BUILD(build_dense) {
    SETTINGS;
    return lg_dense(t, x[0], x[1], s->i[1] ? x[2] : LG_NONE, (lg_activation)s->i[0]);
}
/* The operands as slices and reshapes of one flat vector, used twice: y = tanh(x W + b) W2 with W2 = W^T. */
BUILD(build_flat_parameters) {
    (void)user;
    lg_var w = lg_reshape(t, lg_slice(t, x[1], 0, 0, 12), lg_shape2(3, 4)), b = lg_slice(t, x[1], 0, 12, 4);
    return lg_matmul_nt(t, lg_dense(t, x[0], w, b, LG_TANH), w);
}
#define VARIANT_ROWS(label, v, a, b)                                                                         \
    ROW("matmul " label, "matmul", build_matmul, WITH(.i = {v}), INPUTS(ANY(S2 a), ANY(S2 b)))
#define BATCH_ROW(label, v, ...)                                                                             \
    ROW("matmul " label, "matmul", build_matmul, WITH(.i = {v}), INPUTS(__VA_ARGS__))
#define DENSE_ROW(label, kind, op)                                                                           \
    ROW_TWO("dense " label, "matmul", op, build_dense, WITH(.i = {kind, 1}),                                 \
            INPUTS(APART(S2(4, 3)), ANY(S2(3, 5)), ANY(S1(5))))
/* ReLU and LeakyReLU: every pre-activation is +-1/4 or more, x W + b with whole numbers for W. */
static const double whole[15] = {1, 0, -1, 2, 0, 0, 1, 1, -1, 2, -1, 1, 0, 0, 1};
static const double quarters[5] = {0.25, 0.25, -0.25, 0.25, -0.25};
#define DENSE_KINKED(label, kind)                                                                            \
    ROW_TWO("dense " label, "matmul", "act", build_dense, WITH(.i = {kind, 1}),                              \
            INPUTS({.shape = S2(4, 3), .values = apart, .scale = 0.25},                                      \
                   {.shape = S2(3, 5), .values = whole, .scale = 0.125},                                     \
                   {.shape = S1(5), .values = quarters, .scale = 0.25}))

/* ---- convolution and pooling; s->i = {stride or size, padding or stride, extent}, or {stride, padding,
 * activation, size and stride of pooling} ---- */

BUILD(build_conv1d) {
    SETTINGS;
    return lg_conv1d(t, x[0], x[1], (uint32_t)s->i[0], (uint32_t)s->i[1]);
}
static lg_var conv_pooled(lg_tape *t, const lg_var *x, lg_var bias, const settings *s) {
    return lg_conv1d_pooled(t, x[0], x[1], bias, (uint32_t)s->i[0], (uint32_t)s->i[1], (lg_activation)s->i[2],
                            (uint32_t)s->i[3], (uint32_t)s->i[4]);
}
BUILD(build_conv1d_pooled) {
    SETTINGS;
    return conv_pooled(t, x, x[2], s);
}
BUILD(build_conv1d_pooled_alone) {
    SETTINGS;
    return conv_pooled(t, x, LG_NONE, s);
}
BUILD(build_conv1d_itself) {
    SETTINGS;
    return lg_conv1d(t, x[0], x[0], (uint32_t)s->i[0], (uint32_t)s->i[1]);
}
static lg_var record_windows(lg_tape *t, lg_op_code op, const lg_var *x, uint32_t inputs, const settings *s) {
    const lg_attr attr = {.i = {(uint32_t)s->i[0], (uint32_t)s->i[1], (uint32_t)s->i[2], 0}};
    return lg_record(t, op, x, inputs, &attr);
}
BUILD(build_conv1d_input) {
    SETTINGS;
    return record_windows(t, LG_OP_CONV1D_INPUT, x, 2, s);
}
BUILD(build_conv1d_weight) {
    SETTINGS;
    return record_windows(t, LG_OP_CONV1D_WEIGHT, x, 2, s);
}
BUILD(build_avg_pool1d) {
    SETTINGS;
    return lg_avg_pool1d(t, x[0], (uint32_t)s->i[0], (uint32_t)s->i[1]);
}
BUILD(build_avg_pool1d_adjoint) {
    SETTINGS;
    return record_windows(t, LG_OP_AVG_POOL1D_ADJOINT, x, 1, s);
}
BUILD(build_max_pool1d) {
    SETTINGS;
    return lg_max_pool1d(t, x[0], (uint32_t)s->i[0], (uint32_t)s->i[1]);
}
/* Where x[1], constant, is largest. */
BUILD(build_pool_place) {
    SETTINGS;
    const lg_var in[2] = {x[0], lg_stop_gradient(t, lg_input_f64(t, s->shape, apart))};
    return record_windows(t, LG_OP_POOL_PLACE, in, 2, s);
}
/* A block of a network: fused activation, poolings that share their input. */
BUILD(build_conv_block) {
    (void)user;
    const lg_var y = lg_conv1d_dense(t, x[0], x[1], x[2], 1, 1, LG_TANH);
    return lg_add(t, lg_avg_pool1d(t, y, 2, 2), lg_avg_pool1d(t, lg_square(t, y), 3, 2));
}
/* Batch, length and channels of x; kernel, outputs; stride, padding; count of windows. */
#define CONV_ROWS(label, B, L, C, K, O, S, P, N)                                                             \
    ROW("conv1d " label, "conv1d", build_conv1d, WITH(.i = {S, P}),                                          \
        INPUTS(ANY(S3(B, L, C)), ANY(S3(K, C, O)))),                                                         \
        ROW("conv1d_input " label, "conv1d_input", build_conv1d_input, WITH(.i = {S, P, L}),                 \
            INPUTS(ANY(S3(B, N, O)), ANY(S3(K, C, O)))),                                                     \
        ROW("conv1d_weight " label, "conv1d_weight", build_conv1d_weight, WITH(.i = {S, P, K}),              \
            INPUTS(ANY(S3(B, L, C)), ANY(S3(B, N, O))))
#define CONV_POOLED_ROW(label, op, S, P, kind, SIZE, STEP)                                                   \
    ROW("conv1d_pooled " label, op, build_conv1d_pooled, WITH(.i = {S, P, kind, SIZE, STEP}),                \
        INPUTS(ANY(S3(2, 6, 2)), ANY(S3(3, 2, 3)), ANY(S1(3))))
/* Arguments as in DENSE_KINKED. */
#define CONV_KINKED(label, kind)                                                                             \
    ROW("conv1d_pooled " label, "conv1d_block", build_conv1d_pooled, WITH(.i = {1, 0, kind, 2, 2}),          \
        INPUTS({.shape = S3(1, 4, 3), .values = apart, .scale = 0.25},                                       \
               {.shape = S3(1, 3, 5), .values = whole, .scale = 0.125},                                      \
               {.shape = S1(5), .values = quarters, .scale = 0.25}))
/* Two samples with two channels, 24 numbers; N windows. */
#define POOL_ROWS(label, SIZE, STRIDE, N)                                                                    \
    ROW("avg_pool1d " label, "avg_pool1d", build_avg_pool1d, WITH(.i = {SIZE, STRIDE}),                      \
        INPUTS(ANY(S3(2, 6, 2)))),                                                                           \
        ROW("avg_pool1d_adjoint " label, "avg_pool1d_adjoint", build_avg_pool1d_adjoint,                     \
            WITH(.i = {SIZE, STRIDE, 6}), INPUTS(ANY(S3(2, N, 2)))),                                         \
        ROW("max_pool1d " label, "pool_pick", build_max_pool1d, WITH(.i = {SIZE, STRIDE}),                   \
            INPUTS(APART(S3(2, 6, 2)))),                                                                     \
        ROW("pool_place " label, "pool_place", build_pool_place,                                             \
            WITH(.i = {SIZE, STRIDE}, .shape = S3(2, 6, 2)), INPUTS(ANY(S3(2, N, 2))))

/* ---- pairs of values and derivatives ---- */

BUILD(build_dual_act) {
    SETTINGS;
    return lg_dual_act(t, x[0], (lg_activation)s->i[0]);
}
BUILD(build_dual_dense) {
    SETTINGS;
    return lg_dual_dense(t, x[0], x[1], s->i[1] ? x[2] : LG_NONE, (lg_activation)s->i[0]);
}
BUILD(build_dual_mix) {
    SETTINGS;
    return lg_dual_mix(t, x[0], x[1], x[s->i[0]]);
}
#define DUAL_ACT_ROW(label, kind, ...)                                                                       \
    ROW("dual_act " label, "dual_act", build_dual_act, WITH(.i = {kind}), INPUTS(__VA_ARGS__))
#define DUAL_DENSE_ROW(label, kind)                                                                          \
    ROW_TWO("dual_dense " label, "matmul", "dual_act", build_dual_dense, WITH(.i = {kind, 1}),               \
            INPUTS(APART(S2(4, 3)), ANY(S2(3, 5)), ANY(S1(5))))

/* ---- reductions ---- */

BUILD(build_sum_axis) {
    SETTINGS;
    return lg_sum_axis(t, x[0], s->i[0], s->i[1] != 0);
}
BUILD(build_mean_axis) {
    SETTINGS;
    return lg_mean_axis(t, x[0], s->i[0], s->i[1] != 0);
}
BUILD(build_max_axis) {
    SETTINGS;
    return lg_max_axis(t, x[0], s->i[0], s->i[1] != 0);
}
/* The gradient of the maxima, which is the mask. */
BUILD(build_argmax_mask) {
    (void)user;
    lg_var out = LG_NONE;
    (void)lg_grad(t, lg_max_axis(t, x[0], 1, false), x, 1, &out);
    return out;
}
BUILD(build_sum_to) {
    SETTINGS;
    return lg_sum_to(t, x[0], s->shape);
}
BUILD(build_broadcast_to) {
    SETTINGS;
    return lg_broadcast_to(t, x[0], s->shape);
}
#define AXIS_ROWS(fn, op, axis)                                                                              \
    ROW(#fn " " #axis " of (2, 3, 4)", op, build_##fn, WITH(.i = {axis, 0}), INPUTS(APART(S3(2, 3, 4)))),    \
        ROW(#fn " " #axis " of (2, 3, 4), kept", op, build_##fn, WITH(.i = {axis, 1}),                       \
            INPUTS(APART(S3(2, 3, 4))))
#define ALL_AXES(fn, op)                                                                                     \
    AXIS_ROWS(fn, op, 0), AXIS_ROWS(fn, op, 1), AXIS_ROWS(fn, op, 2), AXIS_ROWS(fn, op, -1),                 \
        ROW(#fn " 0 of (5)", op, build_##fn, WITH(.i = {0, 0}), INPUTS(APART(S1(5))))

/* ---- shapes ---- */

BUILD(build_reshape) {
    SETTINGS;
    return lg_reshape(t, x[0], s->shape);
}
BUILD(build_slice) {
    SETTINGS;
    return lg_slice(t, x[0], s->i[0], (uint32_t)s->i[1], (uint32_t)s->i[2]);
}
BUILD(build_pad) {
    SETTINGS;
    return lg_pad(t, x[0], s->i[0], (uint32_t)s->i[1], (uint32_t)s->i[2]);
}
BUILD(build_concat) {
    SETTINGS;
    return lg_concat(t, x, 3, s->i[0]);
}
/* 100 parts, rows of x in reverse order and doubled in turn: more than one node takes. */
BUILD(build_concat_many) {
    (void)user;
    lg_var parts[100];
    for (uint32_t i = 0; i < 100; i++)
        parts[i] = lg_scale(t, lg_slice(t, x[0], 0, 99 - i, 1), i % 2 == 0 ? 1.0 : 2.0);
    return lg_concat(t, parts, 100, 0);
}
BUILD(build_permute) {
    SETTINGS;
    return lg_permute(t, x[0], s->i);
}
static const uint32_t repeated[6] = {3, 0, 3, 1, 3, 0};
BUILD(build_gather) {
    (void)user;
    return lg_gather(t, x[0], repeated, 6);
}
BUILD(build_scatter) {
    (void)user;
    return lg_scatter(t, x[0], repeated, 6, 5);
}

/* ---- rows of vectors, solves, functions of the angle ---- */

BUILD(build_cross_self) {
    (void)user;
    return lg_cross(t, x[0], lg_mul(t, x[0], x[0]));
}
/* A = x0 + 3 I: the symmetric part of x0 has a norm below 3. */
static lg_var definite(lg_tape *t, lg_var x, uint32_t k) {
    double eye[6 * 6] = {0};
    for (uint32_t i = 0; i < k; i++) eye[i * k + i] = 3.0;
    return lg_add(t, x, lg_input_f64(t, lg_shape2(k, k), eye));
}
BUILD(build_spd_solve) {
    SETTINGS;
    return lg_spd_solve(t, definite(t, x[0], (uint32_t)s->i[0]), x[1]);
}
BUILD(build_spd_factor) {
    lg_var a = definite(t, x[0], 2);
    (void)user;
    return lg_record(t, LG_OP_SPD_FACTOR, &a, 1, NULL);
}
#define SPD_ROW(label, k, m)                                                                                 \
    ROW("spd_solve k = " label, "spd_solve", build_spd_solve, WITH(.i = {k}),                                \
        INPUTS(IN_RANGE(-0.5, 0.5, S3(3, k, k)), ANY(S3(3, k, m))))

BUILD(build_stumpff) {
    SETTINGS;
    return lg_stumpff_functions(t, x[0], s->i[0]);
}
BUILD(build_dexpinv) {
    SETTINGS;
    return lg_dexpinv_coefficient(t, x[0], s->i[0]);
}
BUILD(build_lie) {
    SETTINGS;
    switch (s->i[0]) {
    case LG_K_SO3_EXP:
        return lg_so3_exp_rows(t, x[0], x[s->i[1]]);
    case LG_K_SO3_DEXP:
        return lg_so3_dexp_rows(t, x[0], x[1]);
    case LG_K_SE3_ACT:
        return lg_se3_act_rows(t, x[0], x[1], x[2], x[3]);
    case LG_K_SO3_DEXPINV:
        return lg_so3_dexpinv_rows(t, x[0], x[1]);
    default:
        return lg_se3_dexpinv_rows(t, x[0], x[1], x[2], x[3]);
    }
}
/* Rows of u: none, a tiny one, angles on both sides of where the series end, beyond pi. */
static const double rotations[15] = {0.0, 0.0,  0.0, 1e-9, -2e-9, 2e-9, 1.1, -0.3,
                                     0.4, -1.2, 1.6, 1.1,  3.0,   1.0,  -1.5};
#define ROTATIONS                                                                                            \
    { .shape = S3(5, 1, 3), .values = rotations, .scale = 0.25 }
#define LIE(label, ...)         ROW("lie " label, "lie", build_lie, __VA_ARGS__)
#define LIE_PAIR(label, map, u) LIE(label, WITH(.i = {map, 1}), INPUTS(u, ANY(S3(5, 1, 3))))
#define LIE_FOUR(label, map, u)                                                                              \
    LIE(label, WITH(.i = {map}), INPUTS(u, ANY(S3(5, 1, 3)), ANY(S3(5, 1, 3)), ANY(S3(5, 1, 3))))

/* A row for each angle, for numbers of very different size would hide each other. */
#define ANGLE_ROWS(w)                                                                                        \
    ROW("stumpff w = " #w, "stumpff", build_stumpff, WITH(.i = {3}),                                         \
        INPUTS(IN_VALUES((const double[]){w}, S2(1, 1)))),                                                   \
        ROW("dexpinv_coef w = " #w, "dexpinv_coef", build_dexpinv, WITH(.i = {0}),                           \
            INPUTS({.shape = S2(1, 1), .values = (const double[]){w}, .scale = 0.25}))
static const double angles[8] = {0.0, 1e-18, 1e-8, 0.1, 1.0, 9.0, 9.869604401089358, 4.0};

/* ---- losses ---- */

BUILD(build_loss) {
    SETTINGS;
    return lg_loss_apply(t, (lg_loss)s->i[0], x[0], x[1], s->i[1] ? x[2] : LG_NONE);
}
#define LOSS_ROWS(label, kind, a, b)                                                                         \
    ROW_COMPOSED("loss " label, build_loss, WITH(.i = {kind, 0}), INPUTS(a(S2(4, 3)), b(S2(4, 3)))),         \
        ROW_COMPOSED("loss " label " weighted", build_loss, WITH(.i = {kind, 1}),                            \
                     INPUTS(a(S2(4, 3)), b(S2(4, 3)), POSITIVE(S1(4))))
#define PROBABILITY(...) IN_RANGE(0.1, 0.9, __VA_ARGS__)

/* ---- custom operations: y = a sin b, elementwise of three numbers ---- */

static double number(lg_dtype dtype, const void *a, size_t i) {
    return dtype == LG_F64 ? ((const double *)a)[i] : (double)((const float *)a)[i];
}
static void put_number(lg_dtype dtype, void *a, size_t i, double value) {
    if (dtype == LG_F64)
        ((double *)a)[i] = value;
    else
        ((float *)a)[i] = (float)value;
}
static lg_status a_sin_b(void *user, lg_dtype dtype, const void *const *in, void *y) {
    (void)user;
    for (size_t i = 0; i < 3; i++)
        put_number(dtype, y, i, number(dtype, in[0], i) * sin(number(dtype, in[1], i)));
    return LG_OK;
}
static lg_status built_vjp(void *user, lg_tape *t, const lg_var *in, size_t n, lg_var y, lg_var g,
                           const bool *need, lg_var *out) {
    (void)user, (void)n, (void)y;
    if (need[0]) out[0] = lg_mul(t, g, lg_sin(t, in[1]));
    if (need[1]) out[1] = lg_mul(t, g, lg_mul(t, in[0], lg_cos(t, in[1])));
    return LG_OK;
}
static lg_status built_jvp(void *user, lg_tape *t, const lg_var *in, size_t n, lg_var y,
                           const lg_var *tangents, lg_var *out) {
    (void)user, (void)n, (void)y;
    lg_var a = lg_is_none(tangents[0]) ? LG_NONE : lg_mul(t, tangents[0], lg_sin(t, in[1]));
    lg_var b = lg_is_none(tangents[1]) ? LG_NONE : lg_mul(t, tangents[1], lg_mul(t, in[0], lg_cos(t, in[1])));
    *out = lg_add_or(t, a, b);
    return LG_OK;
}
static lg_status numeric_vjp(void *user, lg_dtype dtype, const void *const *in, const void *y, const void *g,
                             void *const *out) {
    (void)user, (void)y;
    for (size_t i = 0; i < 3; i++) {
        double a = number(dtype, in[0], i), b = number(dtype, in[1], i), c = number(dtype, g, i);
        if (out[0] != NULL) put_number(dtype, out[0], i, c * sin(b));
        if (out[1] != NULL) put_number(dtype, out[1], i, c * a * cos(b));
    }
    return LG_OK;
}
static lg_status numeric_jvp(void *user, lg_dtype dtype, const void *const *in, const void *y,
                             const void *const *tangents, void *out) {
    (void)user, (void)y;
    for (size_t i = 0; i < 3; i++) {
        double a = number(dtype, in[0], i), b = number(dtype, in[1], i);
        double da = tangents[0] != NULL ? number(dtype, tangents[0], i) : 0.0;
        double db = tangents[1] != NULL ? number(dtype, tangents[1], i) : 0.0;
        put_number(dtype, out, i, da * sin(b) + a * cos(b) * db);
    }
    return LG_OK;
}
static const lg_custom_op custom_ops[2] = {
    {.name = "a sin b, built", .forward = a_sin_b, .vjp = built_vjp, .jvp = built_jvp},
    {.name = "a sin b, numeric", .forward = a_sin_b, .numeric_vjp = numeric_vjp, .numeric_jvp = numeric_jvp}};
BUILD(build_custom) {
    SETTINGS;
    return lg_custom(t, &custom_ops[s->i[0]], x, 2, lg_shape1(3));
}

/* ---- an argument on a manifold: q on the sphere, q <- exp(h d) q ---- */

static const double on_sphere[3] = {2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0};
static lg_status turn(const void *user, uint32_t argument, const double *q, const double *d, double h,
                      double *moved) {
    (void)user, (void)argument;
    double angle = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), c = cos(h * angle),
           s = sin(h * angle) / angle;
    double along = (d[0] * q[0] + d[1] * q[1] + d[2] * q[2]) * (1.0 - c) / (angle * angle);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        moved[i] = c * q[i] + s * (d[j] * q[k] - d[k] * q[j]) + along * d[i];
    }
    return LG_OK;
}
static lg_status turn_tangent(const void *user, uint32_t argument, const double *q, const double *d,
                              double *dq) {
    (void)user, (void)argument;
    for (int i = 0; i < 3; i++) dq[i] = d[(i + 1) % 3] * q[(i + 2) % 3] - d[(i + 2) % 3] * q[(i + 1) % 3];
    return LG_OK;
}
/* (p.q) q + tanh(p x q) */
BUILD(build_sphere) {
    (void)user;
    lg_var along = lg_mul(t, lg_rowdot(t, x[1], x[0]), x[0]);
    return lg_add(t, along, lg_act(t, lg_cross(t, x[1], x[0]), LG_TANH));
}

/* ---- the table ---- */

static const lg_gradcheck_case rows[] = {
    ROW("leaf", "leaf", build_leaf, INPUTS(ANY(S2(4, 3)))),
    BINARY_ROWS(add, ANY, ANY),
    BINARY_ROWS(sub, ANY, ANY),
    BINARY_ROWS(mul, ANY, ANY),
    BINARY_ROWS(div, ANY, POSITIVE),
    BINARY_ROWS(max, APART, BETWEEN),
    ROW("add () ()", "add", build_add, INPUTS(ANY(S0), ANY(S0))),
    ROW("sub () ()", "sub", build_sub, INPUTS(ANY(S0), ANY(S0))),
    ROW("mul () ()", "mul", build_mul, INPUTS(ANY(S0), ANY(S0))),
    ROW("div () ()", "div", build_div, INPUTS(ANY(S0), POSITIVE(S0))),
    /* only one of two numbers wins */
    ROW_COMPOSED("max () (), the first", build_max, INPUTS(APART(S0), BETWEEN(S0))),
    ROW_COMPOSED("max () (), the second", build_max, INPUTS(BETWEEN(S0), APART(S0))),
    ROW("mix", "mix", build_mix, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("mix of () () ()", "mix", build_mix, INPUTS(ANY(S0), ANY(S0), ANY(S0))),
    ROW("mix with its gate", "mix", build_mix_itself, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("combine", "combine", build_combine, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("combine of repeated terms", "combine", build_combine_repeated, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("mul of itself", "mul", build_mul_self, INPUTS(ANY(S2(4, 3)))),
    ROW_ZERO("ge", "ge", build_ge, INPUTS(APART(S2(4, 3)), BETWEEN(S2(4, 3)))),
    ROW("scale", "scale", build_scale, WITH(.c = -1.75), INPUTS(ANY(S2(4, 3)))),
    ROW("neg", "scale", build_neg, INPUTS(ANY(S2(4, 3)))),
    ROW("shift", "shift", build_shift, WITH(.c = 0.75), INPUTS(ANY(S2(4, 3)))),
    ROW("pow 1", "pow", build_pow, WITH(.c = 1.0), INPUTS(ANY(S2(4, 3)))),
    ROW("pow 2", "pow", build_square, INPUTS(ANY(S2(4, 3)))),
    ROW("pow 3", "pow", build_pow, WITH(.c = 3.0), INPUTS(APART(S2(4, 3)))),
    ROW("pow 5", "pow", build_pow, WITH(.c = 5.0), INPUTS(ANY(S2(4, 3)))),
    ROW("pow -1", "pow", build_pow, WITH(.c = -1.0), INPUTS(APART(S2(4, 3)))),
    ROW("pow 0.5", "pow", build_pow, WITH(.c = 0.5), INPUTS(POSITIVE(S2(4, 3)))),
    ROW("pow -2.5", "pow", build_pow, WITH(.c = -2.5), INPUTS(POSITIVE(S2(4, 3)))),
    ROW_ZERO("pow 0", "pow", build_pow, WITH(.c = 0.0), INPUTS(ANY(S2(4, 3)))),
    ROW("sqrt", "sqrt", build_sqrt, INPUTS(POSITIVE(S2(4, 3)))),
    ROW("exp", "exp", build_exp, INPUTS(ANY(S2(4, 3)))),
    ROW("log", "log", build_log, INPUTS(POSITIVE(S2(4, 3)))),
    ROW("sin", "sin", build_sin, INPUTS(APART(S2(4, 3)))),
    ROW("cos", "cos", build_cos, INPUTS(APART(S2(4, 3)))),
    ROW("abs", "abs", build_abs, INPUTS(APART(S2(4, 3)))),
    ROW_ZERO("sign", "sign", build_sign, INPUTS(APART(S2(4, 3)))),
    ROW_STOPS("stop_gradient", "stop_gradient", build_stop_gradient, INPUTS(ANY(S2(4, 3)))),

    ACT_ROW("identity", LG_IDENTITY),
    ACT_ROW("tanh", LG_TANH),
    ACT_ROW("sigmoid", LG_SIGMOID),
    /* swish itself is the family's member of order 0, computed from the sigmoid */
    ROW("act swish", "act_derivative", build_act, WITH(.i = {LG_SWISH}), INPUTS(APART(S2(4, 3)))),
    ACT_ROW("relu", LG_RELU),
    ACT_ROW("leaky-relu", LG_LEAKY_RELU),
    ACT_ROW("sine", LG_SINE),
    ACT_ORDERS("tanh", LG_TANH),
    ACT_ORDERS("sigmoid", LG_SIGMOID),
    ACT_ORDERS("swish", LG_SWISH),
    ACT_ORDERS("sine", LG_SINE),
    ACT_FLATS("identity", LG_IDENTITY),
    ACT_FLATS("relu", LG_RELU),
    ACT_FLATS("leaky-relu", LG_LEAKY_RELU),
    ACT_TIMES("tanh", LG_TANH),
    ACT_TIMES("sigmoid", LG_SIGMOID),
    ACT_TIMES("swish", LG_SWISH),
    ACT_TIMES("sine", LG_SINE),

    VARIANT_ROWS("nn (3, 4) (4, 5)", 0, (3, 4), (4, 5)),
    VARIANT_ROWS("nt (3, 4) (5, 4)", 1, (3, 4), (5, 4)),
    VARIANT_ROWS("tn (4, 3) (4, 5)", 2, (4, 3), (4, 5)),
    BATCH_ROW("nn (2, 3, 4) (2, 4, 5)", 0, ANY(S3(2, 3, 4)), ANY(S3(2, 4, 5))),
    BATCH_ROW("nt (2, 3, 4) (2, 5, 4)", 1, ANY(S3(2, 3, 4)), ANY(S3(2, 5, 4))),
    BATCH_ROW("tn (2, 4, 3) (2, 4, 5)", 2, ANY(S3(2, 4, 3)), ANY(S3(2, 4, 5))),
    BATCH_ROW("nn (1, 3, 4) (2, 4, 5)", 0, ANY(S3(1, 3, 4)), ANY(S3(2, 4, 5))),
    BATCH_ROW("nt (2, 3, 4) (1, 5, 4)", 1, ANY(S3(2, 3, 4)), ANY(S3(1, 5, 4))),
    BATCH_ROW("tn (1, 4, 3) (2, 4, 5)", 2, ANY(S3(1, 4, 3)), ANY(S3(2, 4, 5))),
    BATCH_ROW("nn (2, 3, 4) (4, 5)", 0, ANY(S3(2, 3, 4)), ANY(S2(4, 5))),
    BATCH_ROW("tn (4, 3) (2, 4, 5)", 2, ANY(S2(4, 3)), ANY(S3(2, 4, 5))),
    ROW("matmul tn of itself", "matmul", build_matmul, WITH(.i = {2, 1}), INPUTS(ANY(S2(4, 3)))),
    ROW("matmul nn of itself", "matmul", build_matmul, WITH(.i = {0, 1}), INPUTS(ANY(S2(3, 3)))),
    ROW("matmul + (3, 5)", "matmul", build_matmul_add, INPUTS(ANY(S2(3, 4)), ANY(S2(4, 5)), ANY(S2(3, 5)))),
    ROW("matmul + (1, 5)", "matmul", build_matmul_add, INPUTS(ANY(S2(3, 4)), ANY(S2(4, 5)), ANY(S2(1, 5)))),
    ROW("matmul + (5)", "matmul", build_matmul_add, INPUTS(ANY(S2(3, 4)), ANY(S2(4, 5)), ANY(S1(5)))),
    ROW("matmul + ()", "matmul", build_matmul_add, INPUTS(ANY(S2(3, 4)), ANY(S2(4, 5)), ANY(S0))),
    ROW("matmul (1, 4) (4, 5) + (5)", "matmul", build_matmul_add,
        INPUTS(ANY(S2(1, 4)), ANY(S2(4, 5)), ANY(S1(5)))),
    DUAL_ACT_ROW("tanh", LG_TANH, ANY(S2(4, 3))),
    DUAL_ACT_ROW("sigmoid", LG_SIGMOID, ANY(S2(4, 3))),
    DUAL_ACT_ROW("swish", LG_SWISH, ANY(S2(4, 3))),
    DUAL_ACT_ROW("sine", LG_SINE, ANY(S2(4, 3))),
    DUAL_ACT_ROW("identity", LG_IDENTITY, ANY(S2(4, 3))),
    DUAL_ACT_ROW("relu", LG_RELU, APART(S2(4, 3))),
    DUAL_ACT_ROW("leaky-relu", LG_LEAKY_RELU, APART(S2(4, 3))),
    DUAL_DENSE_ROW("tanh", LG_TANH),
    DUAL_DENSE_ROW("sigmoid", LG_SIGMOID),
    DUAL_DENSE_ROW("identity", LG_IDENTITY),
    DUAL_DENSE_ROW("swish", LG_SWISH),
    DUAL_DENSE_ROW("sine", LG_SINE),
    ROW("dual_dense tanh without bias", "dual_act", build_dual_dense, WITH(.i = {LG_TANH, 0}),
        INPUTS(ANY(S2(4, 3)), ANY(S2(3, 5)))),
    ROW("dual_mix", "dual_mix", build_dual_mix, WITH(.i = {2}),
        INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("dual_mix with its gate", "dual_mix", build_dual_mix, WITH(.i = {0}),
        INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    DENSE_ROW("identity", LG_IDENTITY, NULL),
    DENSE_ROW("tanh", LG_TANH, "act"),
    DENSE_ROW("sigmoid", LG_SIGMOID, "act"),
    DENSE_ROW("swish", LG_SWISH, "act_derivative"),
    DENSE_ROW("sine", LG_SINE, "act"),
    DENSE_KINKED("relu", LG_RELU),
    DENSE_KINKED("leaky-relu", LG_LEAKY_RELU),
    ROW_TWO("dense tanh without bias", "matmul", "act", build_dense, WITH(.i = {LG_TANH, 0}),
            INPUTS(ANY(S2(4, 3)), ANY(S2(3, 5)))),
    ROW_TWO("dense over slices of one vector", "slice", "reshape", build_flat_parameters,
            INPUTS(ANY(S2(4, 3)), ANY(S1(16)))),

    CONV_ROWS("(2, 6, 3) (3, 3, 2)", 2, 6, 3, 3, 2, 1, 0, 4),
    CONV_ROWS("stride 2", 2, 7, 2, 2, 3, 2, 0, 3),
    CONV_ROWS("stride 3 beyond the kernel", 2, 7, 2, 2, 3, 3, 0, 2),
    CONV_ROWS("padding 2", 2, 4, 2, 3, 3, 1, 2, 6),
    CONV_ROWS("stride 2, padding 1", 2, 6, 2, 4, 3, 2, 1, 3),
    CONV_ROWS("kernel 1", 2, 4, 3, 1, 2, 1, 0, 4),
    CONV_ROWS("one sample", 1, 6, 2, 3, 4, 1, 0, 4),
    CONV_ROWS("as long as the series", 3, 4, 2, 4, 3, 1, 0, 1),
    ROW("conv1d of itself", "conv1d", build_conv1d_itself, WITH(.i = {1, 1}), INPUTS(ANY(S3(3, 3, 3)))),
    CONV_POOLED_ROW("identity, no pooling", "conv1d", 2, 1, LG_IDENTITY, 1, 1),
    CONV_POOLED_ROW("identity, 2 every 3", "conv1d_block", 1, 1, LG_IDENTITY, 2, 3),
    CONV_POOLED_ROW("tanh, no pooling", "conv1d_block", 2, 1, LG_TANH, 1, 1),
    CONV_POOLED_ROW("tanh, 3 every 2", "conv1d_block", 1, 1, LG_TANH, 3, 2),
    CONV_POOLED_ROW("sigmoid, 1 every 2", "conv1d_block", 1, 0, LG_SIGMOID, 1, 2),
    CONV_POOLED_ROW("swish, no pooling", "conv1d_block", 2, 1, LG_SWISH, 1, 1),
    CONV_POOLED_ROW("swish, 2 every 2", "conv1d_block", 1, 1, LG_SWISH, 2, 2),
    CONV_POOLED_ROW("sine, 2 every 1", "conv1d_block", 1, 2, LG_SINE, 2, 1),
    CONV_KINKED("relu", LG_RELU),
    CONV_KINKED("leaky-relu", LG_LEAKY_RELU),
    ROW("conv1d_pooled without bias", "conv1d_block", build_conv1d_pooled_alone,
        WITH(.i = {1, 1, LG_SWISH, 2, 2}), INPUTS(ANY(S3(2, 6, 2)), ANY(S3(3, 2, 3)))),
    POOL_ROWS("2 every 2", 2, 2, 3),
    POOL_ROWS("3 every 1", 3, 1, 4),
    POOL_ROWS("2 every 3", 2, 3, 2),
    POOL_ROWS("all 6", 6, 1, 1),
    ROW_TWO("block of convolution and pooling", "conv1d_block", "avg_pool1d", build_conv_block,
            INPUTS(ANY(S3(2, 7, 2)), ANY(S3(3, 2, 3)), ANY(S1(3)))),

    ROW("sum of (2, 3, 4)", "sum", build_sum, INPUTS(ANY(S3(2, 3, 4)))),
    ROW("mean of (2, 3, 4)", "sum", build_mean, INPUTS(ANY(S3(2, 3, 4)))),
    ROW("sum of ()", "sum", build_sum, INPUTS(ANY(S0))),
    ALL_AXES(sum_axis, "sum"),
    ALL_AXES(mean_axis, "sum"),
    ALL_AXES(max_axis, "max_axis"),
    ROW_ZERO("argmax_mask", "argmax_mask", build_argmax_mask, INPUTS(APART(S2(4, 3)))),
    ROW("sum_to () of (4, 3)", "sum", build_sum_to, WITH(.shape = S0), INPUTS(ANY(S2(4, 3)))),
    ROW("sum_to (4, 1) of (4, 3)", "sum", build_sum_to, WITH(.shape = S2(4, 1)), INPUTS(ANY(S2(4, 3)))),
    ROW("sum_to (3) of (4, 3)", "sum", build_sum_to, WITH(.shape = S1(3)), INPUTS(ANY(S2(4, 3)))),
    /* chains of two: a sign planted in both would cancel */
    ROW_COMPOSED("sum_to (1, 3, 1) of (2, 2, 3, 4)", build_sum_to, WITH(.shape = S3(1, 3, 1)),
                 INPUTS(ANY(S4(2, 2, 3, 4)))),
    ROW("broadcast_to (4, 3) of ()", "broadcast", build_broadcast_to, WITH(.shape = S2(4, 3)),
        INPUTS(ANY(S0))),
    ROW("broadcast_to (4, 3) of (4, 1)", "broadcast", build_broadcast_to, WITH(.shape = S2(4, 3)),
        INPUTS(ANY(S2(4, 1)))),
    ROW("broadcast_to (2, 3, 4) of (3, 4)", "broadcast", build_broadcast_to, WITH(.shape = S3(2, 3, 4)),
        INPUTS(ANY(S2(3, 4)))),
    ROW("broadcast_to (4, 3) of (3)", "broadcast", build_broadcast_to, WITH(.shape = S2(4, 3)),
        INPUTS(ANY(S1(3)))),
    ROW_COMPOSED("broadcast_to (2, 2, 3, 4) of (1, 3, 1)", build_broadcast_to, WITH(.shape = S4(2, 2, 3, 4)),
                 INPUTS(ANY(S3(1, 3, 1)))),

    ROW("reshape (2, 6) of (4, 3)", "reshape", build_reshape, WITH(.shape = S2(2, 6)), INPUTS(ANY(S2(4, 3)))),
    ROW("reshape (12) of (2, 2, 3)", "reshape", build_reshape, WITH(.shape = S1(12)),
        INPUTS(ANY(S3(2, 2, 3)))),
    ROW("reshape (1) of ()", "reshape", build_reshape, WITH(.shape = S1(1)), INPUTS(ANY(S0))),
    ROW("slice of (5, 3), contiguous", "slice", build_slice, WITH(.i = {0, 1, 3}), INPUTS(ANY(S2(5, 3)))),
    ROW("slice of (3, 5), strided", "slice", build_slice, WITH(.i = {1, 1, 3}), INPUTS(ANY(S2(3, 5)))),
    ROW("slice of (2, 4, 3), strided", "slice", build_slice, WITH(.i = {-2, 2, 2}), INPUTS(ANY(S3(2, 4, 3)))),
    ROW("slice of (7)", "slice", build_slice, WITH(.i = {0, 2, 4}), INPUTS(ANY(S1(7)))),
    ROW("pad 0 of (3, 4)", "pad", build_pad, WITH(.i = {0, 1, 2}), INPUTS(ANY(S2(3, 4)))),
    ROW("pad 1 of (3, 4)", "pad", build_pad, WITH(.i = {1, 2, 0}), INPUTS(ANY(S2(3, 4)))),
    ROW("concat 0", "concat", build_concat, WITH(.i = {0}),
        INPUTS(ANY(S2(2, 3)), ANY(S2(1, 3)), ANY(S2(3, 3)))),
    ROW("concat 1", "concat", build_concat, WITH(.i = {1}),
        INPUTS(ANY(S2(3, 2)), ANY(S2(3, 1)), ANY(S2(3, 3)))),
    ROW("concat -1 of (2, 2, n)", "concat", build_concat, WITH(.i = {-1}),
        INPUTS(ANY(S3(2, 2, 2)), ANY(S3(2, 2, 1)), ANY(S3(2, 2, 3)))),
    ROW_COMPOSED("concat of 100 parts", build_concat_many, INPUTS(ANY(S2(100, 2)))),
    ROW("transpose of (3, 4)", "permute", build_transpose, INPUTS(ANY(S2(3, 4)))),
    ROW("transpose of (2, 3, 4)", "permute", build_transpose, INPUTS(ANY(S3(2, 3, 4)))),
    ROW("permute 2 0 1 of (2, 3, 4)", "permute", build_permute, WITH(.i = {2, 0, 1}),
        INPUTS(ANY(S3(2, 3, 4)))),
    ROW("permute 1 3 0 2 of (2, 3, 2, 4)", "permute", build_permute, WITH(.i = {1, 3, 0, 2}),
        INPUTS(ANY(S4(2, 3, 2, 4)))),
    ROW("gather of (5, 2), repeated", "gather", build_gather, INPUTS(ANY(S2(5, 2)))),
    ROW("gather of (5), repeated", "gather", build_gather, INPUTS(ANY(S1(5)))),
    ROW("scatter of (6, 2), repeated", "scatter", build_scatter, INPUTS(ANY(S2(6, 2)))),

    ROW("rowdot (4, 3)", "rowdot", build_rowdot, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("rowdot (2, 3, 5)", "rowdot", build_rowdot, INPUTS(ANY(S3(2, 3, 5)), ANY(S3(2, 3, 5)))),
    ROW("rownorm2 (4, 3)", "rowdot", build_rownorm2, INPUTS(ANY(S2(4, 3)))),
    ROW("cross (4, 3)", "cross", build_cross, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("cross (2, 2, 3)", "cross", build_cross, INPUTS(ANY(S3(2, 2, 3)), ANY(S3(2, 2, 3)))),
    ROW("cross (3)", "cross", build_cross, INPUTS(ANY(S1(3)), ANY(S1(3)))),
    ROW("cross of x and x^2", "cross", build_cross_self, INPUTS(ANY(S2(4, 3)))),
    ROW_STOPS("spd_factor", "spd_factor", build_spd_factor, INPUTS(IN_RANGE(-0.5, 0.5, S3(3, 2, 2)))),
    SPD_ROW("1", 1, 2),
    SPD_ROW("2", 2, 2),
    SPD_ROW("3", 3, 1),
    SPD_ROW("3, m = 2", 3, 2),
    SPD_ROW("4", 4, 2),
    SPD_ROW("6", 6, 1),
    ANGLE_ROWS(0.0),
    ANGLE_ROWS(1e-18),
    ANGLE_ROWS(1e-8),
    ANGLE_ROWS(1e-4),
    ANGLE_ROWS(0.1),
    ANGLE_ROWS(1.0),
    ANGLE_ROWS(4.0),
    ANGLE_ROWS(9.0),
    ANGLE_ROWS(9.869604401089358),
    ANGLE_ROWS(15.9),
    ANGLE_ROWS(16.1),
    ANGLE_ROWS(39.0),
    ROW("stumpff c_0..c_8 of (4, 2, 1)", "stumpff", build_stumpff, WITH(.i = {8}),
        INPUTS(IN_VALUES(angles, S3(4, 2, 1)))),
    ROW("stumpff c_0 of (8, 1)", "stumpff", build_stumpff, WITH(.i = {0}),
        INPUTS(IN_VALUES(angles, S2(8, 1)))),
    ROW("dexpinv_coef of (8, 1), order 2", "dexpinv_coef", build_dexpinv, WITH(.i = {2}),
        INPUTS(IN_VALUES(angles, S2(8, 1)))),
    LIE_PAIR("exp(u) x", LG_K_SO3_EXP, ROTATIONS),
    LIE_PAIR("dexp", LG_K_SO3_DEXP, ROTATIONS),
    LIE_PAIR("dexpinv", LG_K_SO3_DEXPINV, ROTATIONS),
    LIE_FOUR("action of SE(3), second half", LG_K_SE3_ACT, ROTATIONS),
    LIE_FOUR("dexpinv of se(3), second half", LG_K_SE3_DEXPINV, ROTATIONS),
    LIE("exp(u) x of (19, 3)", WITH(.i = {LG_K_SO3_EXP, 1}), INPUTS(ANY(S2(19, 3)), ANY(S2(19, 3)))),
    LIE("exp(u) X of (9, 9)", WITH(.i = {LG_K_SO3_EXP, 1}), INPUTS(ANY(S2(9, 3)), ANY(S2(9, 9)))),
    LIE("exp(u) u", WITH(.i = {LG_K_SO3_EXP, 0}), INPUTS(ANY(S1(3)))),

    LOSS_ROWS("mse", LG_LOSS_MSE, ANY, ANY),
    LOSS_ROWS("mae", LG_LOSS_MAE, APART, BETWEEN),
    LOSS_ROWS("huber", LG_LOSS_HUBER, APART, BETWEEN),
    LOSS_ROWS("bce", LG_LOSS_BCE_LOGITS, APART, PROBABILITY),
    LOSS_ROWS("cross-entropy", LG_LOSS_CROSS_ENTROPY, APART, PROBABILITY),
    ROW_COMPOSED("mse", build_mse, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW_COMPOSED("log_softmax (4, 3)", build_log_softmax, INPUTS(APART(S2(4, 3)))),

    ROW("custom, built", "custom", build_custom, WITH(.i = {0}), INPUTS(ANY(S1(3)), ANY(S1(3)))),
    {.function = {.name = "custom, numeric",
                  .build = build_custom,
                  .first_order_only = true,
                  WITH(.i = {1}),
                  INPUTS(ANY(S1(3)), ANY(S1(3)))},
     .operations = {"custom", "custom_derivative"}},
    {.function = {.name = "on the sphere",
                  .build = build_sphere,
                  .perturb = turn,
                  .tangent = turn_tangent,
                  INPUTS({.shape = S2(1, 3), .values = on_sphere, .algebra = 3}, ANY(S2(1, 3)))}},
};

const lg_gradcheck_case *lg_gradcheck_operations(size_t *count) {
    *count = LG_COUNT(rows);
    return rows;
}

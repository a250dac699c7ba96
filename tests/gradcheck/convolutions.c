/* Cases of the gradient check: convolution and pooling. */
#include "gradcheck/rows.h"
#include "autodiff/ops/op_rows.h"

/* ---- convolution and pooling; s->i = {stride or size, padding or stride, extent}, or for conv1d_pooled
 * {stride, padding, activation, size and stride of the pooling} ---- */

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
static lg_var record_windows(lg_tape *t, const lg_op *op, const lg_var *x, uint32_t inputs,
                             const settings *s) {
    const lg_attr attr = {.i = {(uint32_t)s->i[0], (uint32_t)s->i[1], (uint32_t)s->i[2], 0}};
    return lg_record(t, op, x, inputs, &attr);
}
BUILD(build_conv1d_input) {
    SETTINGS;
    return record_windows(t, &lg_op_conv1d_input, x, 2, s);
}
BUILD(build_conv1d_weight) {
    SETTINGS;
    return record_windows(t, &lg_op_conv1d_weight, x, 2, s);
}
BUILD(build_avg_pool1d) {
    SETTINGS;
    return lg_avg_pool1d(t, x[0], (uint32_t)s->i[0], (uint32_t)s->i[1]);
}
BUILD(build_avg_pool1d_adjoint) {
    SETTINGS;
    return record_windows(t, &lg_op_avg_pool1d_adjoint, x, 1, s);
}
BUILD(build_max_pool1d) {
    SETTINGS;
    return lg_max_pool1d(t, x[0], (uint32_t)s->i[0], (uint32_t)s->i[1]);
}
/* The places are given by the largest elements of a constant, the numbers of `apart`. */
BUILD(build_pool_place) {
    SETTINGS;
    const lg_var in[2] = {x[0], lg_stop_gradient(t, lg_input_f64(t, s->shape, apart))};
    return record_windows(t, &lg_op_pool_place, in, 2, s);
}
/* A block of a network: a fused activation, then two poolings, one of y and one of y^2. */
BUILD(build_conv_block) {
    (void)user;
    const lg_var y = lg_conv1d_dense(t, x[0], x[1], x[2], 1, 1, LG_TANH);
    return lg_add(t, lg_avg_pool1d(t, y, 2, 2), lg_avg_pool1d(t, lg_square(t, y), 3, 2));
}
/* Rows for a convolution and its two adjoints: B, L, C are batch, length and channels of x; K kernel length,
 * O outputs; S stride, P padding; N number of windows. */
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
/* The arguments keep every pre-activation away from the kink, as in DENSE_KINKED. */
#define CONV_KINKED(label, kind)                                                                             \
    ROW("conv1d_pooled " label, "conv1d_block", build_conv1d_pooled, WITH(.i = {1, 0, kind, 2, 2}),          \
        INPUTS({.shape = S3(1, 4, 3), .values = apart, .scale = 0.25},                                       \
               {.shape = S3(1, 3, 5), .values = whole, .scale = 0.125},                                      \
               {.shape = S1(5), .values = quarters, .scale = 0.25}))
/* Rows for poolings of x (2, 6, 2), two samples with 24 numbers in all; N is the number of windows. */
#define POOL_ROWS(label, SIZE, STRIDE, N)                                                                    \
    ROW("avg_pool1d " label, "avg_pool1d", build_avg_pool1d, WITH(.i = {SIZE, STRIDE}),                      \
        INPUTS(ANY(S3(2, 6, 2)))),                                                                           \
        ROW("avg_pool1d_adjoint " label, "avg_pool1d_adjoint", build_avg_pool1d_adjoint,                     \
            WITH(.i = {SIZE, STRIDE, 6}), INPUTS(ANY(S3(2, N, 2)))),                                         \
        ROW("max_pool1d " label, "pool_pick", build_max_pool1d, WITH(.i = {SIZE, STRIDE}),                   \
            INPUTS(APART(S3(2, 6, 2)))),                                                                     \
        ROW("pool_place " label, "pool_place", build_pool_place,                                             \
            WITH(.i = {SIZE, STRIDE}, .shape = S3(2, 6, 2)), INPUTS(ANY(S3(2, N, 2))))

/* ---- the table ---- */

static const lg_gradcheck_case rows[] = {
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
};
FAMILY(convolutions)

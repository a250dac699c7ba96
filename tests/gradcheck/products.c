/* Cases of the gradient check: products, dense layers, pairs of values and derivatives. */
#include "gradcheck/rows.h"

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
/* W and b are a slice and a reshape of one flat vector, and W is used twice: y = tanh(x W + b) W^T. */
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
#define DENSE_KINKED(label, kind)                                                                            \
    ROW_TWO("dense " label, "matmul", "act", build_dense, WITH(.i = {kind, 1}),                              \
            INPUTS({.shape = S2(4, 3), .values = apart, .scale = 0.25},                                      \
                   {.shape = S2(3, 5), .values = whole, .scale = 0.125},                                     \
                   {.shape = S1(5), .values = quarters, .scale = 0.25}))

/* ---- the table ---- */

static const lg_gradcheck_case rows[] = {
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
};
FAMILY(products)

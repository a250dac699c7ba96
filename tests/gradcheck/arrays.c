/* Cases of the gradient check: reductions and operations that change shapes. */
#include "gradcheck/rows.h"

/* ---- reductions ---- */

BUILD_UNARY(sum)
BUILD_UNARY(mean)
BUILD_UNARY(transpose)

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
/* The gradient of the maxima is the mask. */
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
/* Concatenates 100 parts, more than one node can have as inputs: the rows of x in reverse order, every second
 * one doubled. */
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
/* A scatter small enough for scalar code. */
BUILD(build_small_scatter) {
    static const uint32_t rows[3] = {3, 0, 3};
    (void)user;
    return lg_scatter(t, x[0], rows, 3, 4);
}

/* ---- the table ---- */

static const lg_gradcheck_case rows[] = {
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
    /* Chains of two equal operations. No errors are planted (ROW_COMPOSED): a wrong sign in both would
     * cancel. */
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
    ROW("pad 1 of (2, 2)", "pad", build_pad, WITH(.i = {1, 2, 0}), INPUTS(ANY(S2(2, 2)))),
    ROW("concat 1 of (2, n)", "concat", build_concat, WITH(.i = {1}),
        INPUTS(ANY(S2(2, 2)), ANY(S2(2, 1)), ANY(S2(2, 3)))),
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
    ROW("scatter of (3, 2), repeated", "scatter", build_small_scatter, INPUTS(ANY(S2(3, 2)))),
};
FAMILY(arrays)

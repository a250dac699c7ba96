/* Cases of the gradient check: elementwise operations and activations. */
#include "gradcheck/rows.h"
#include "autodiff/ops/op_rows.h"

/* ---- elementwise ---- */

BUILD_BINARY(add)
BUILD_BINARY(sub)
BUILD_BINARY(mul)
BUILD_BINARY(div)
BUILD_BINARY(max)
BUILD_BINARY(atan2)

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

BUILD(build_leaf) {
    (void)user, (void)t;
    return x[0];
}
/* a where a >= b, otherwise b^2. */
BUILD(build_select) {
    (void)user;
    return lg_select(t, lg_ge(t, x[0], x[1]), x[0], lg_mul(t, x[1], x[1]));
}
BUILD(build_ge) {
    (void)user;
    return lg_record(t, &lg_op_ge, x, 2, NULL);
}
BUILD(build_scale) {
    SETTINGS;
    return lg_scale(t, x[0], s->c);
}
BUILD(build_shift) {
    SETTINGS;
    return lg_add_scalar(t, x[0], s->c);
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
    return lg_linear_combination(t, x, coefficients, 3);
}
/* A sum in which variables occur more than once, each time with another coefficient. */
BUILD(build_combine_repeated) {
    (void)user;
    lg_var terms[5] = {x[0], x[1], x[0], lg_mul(t, x[0], x[1]), x[1]};
    return lg_linear_combination(t, terms, coefficients, 5);
}

BUILD(build_mix) {
    (void)user;
    return lg_lerp(t, x[0], x[1], x[2]);
}
/* One of the ends is a constant. */
BUILD(build_mix_end) {
    SETTINGS;
    const lg_var fixed = lg_full(t, lg_var_shape(t, x[1]), 0.7);
    return lg_lerp(t, x[0], s->i[0] == 1 ? x[1] : fixed, s->i[0] == 2 ? x[1] : fixed);
}
/* The same variable is both z and v. */
BUILD(build_mix_itself) {
    (void)user;
    return lg_lerp(t, x[0], x[1], x[0]);
}

/* Rows of a binary operation for each pattern of broadcasting, mostly in both orders. `a` and `b` are macros
 * that make an argument from a shape. */
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

/* ---- activations ---- */

BUILD(build_act) {
    SETTINGS;
    return lg_act(t, x[0], (lg_activation)s->i[0]);
}
BUILD(build_act_derivative) {
    SETTINGS;
    return lg_act_derivative(t, x[0], (lg_activation)s->i[0], s->i[1]);
}
/* The activation's derivative with a factor, x[1] sigma'(x[0]), as a vjp records it. */
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

/* ---- the table ---- */

static const lg_gradcheck_case rows[] = {
    ROW("leaf", "leaf", build_leaf, INPUTS(ANY(S2(4, 3)))),
    BINARY_ROWS(add, ANY, ANY),
    BINARY_ROWS(sub, ANY, ANY),
    BINARY_ROWS(mul, ANY, ANY),
    BINARY_ROWS(div, ANY, POSITIVE),
    BINARY_ROWS(max, APART, BETWEEN),
    BINARY_ROWS(atan2, APART, BETWEEN),
    ROW("select (4, 3)", "select", build_select, INPUTS(APART(S2(4, 3)), BETWEEN(S2(4, 3)))),
    ROW_COMPOSED("select ()", build_select, INPUTS(APART(S0), BETWEEN(S0))),
    ROW_COMPOSED("select (), the other", build_select, INPUTS(BETWEEN(S0), APART(S0))),
    ROW("add () ()", "add", build_add, INPUTS(ANY(S0), ANY(S0))),
    ROW("sub () ()", "sub", build_sub, INPUTS(ANY(S0), ANY(S0))),
    ROW("mul () ()", "mul", build_mul, INPUTS(ANY(S0), ANY(S0))),
    ROW("div () ()", "div", build_div, INPUTS(ANY(S0), POSITIVE(S0))),
    /* No errors are planted in these (ROW_COMPOSED): only one of the two numbers is the maximum, so the other
     * has no gradient. */
    ROW_COMPOSED("max () (), the first", build_max, INPUTS(APART(S0), BETWEEN(S0))),
    ROW_COMPOSED("max () (), the second", build_max, INPUTS(BETWEEN(S0), APART(S0))),
    ROW("mix", "mix", build_mix, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("mix of () () ()", "mix", build_mix, INPUTS(ANY(S0), ANY(S0), ANY(S0))),
    /* No errors are planted in these: a wrong derivative with respect to the constant changes nothing. */
    ROW_COMPOSED("mix with a constant end", build_mix_end, WITH(.i = {1}),
                 INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW_COMPOSED("mix with a constant start", build_mix_end, WITH(.i = {2}),
                 INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
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
    /* swish is recorded as its derivative of order 0, computed from the sigmoid */
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
};
FAMILY(elementwise)

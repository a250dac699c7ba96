/* Cases of elementwise functions, products and sums, maps of Lie groups, and derivatives. */
#include <math.h>
#include <string.h>

#include "hard.h"
#include "liegrad/geometry.h"
#include "liegrad/ops.h"

/* ---- recorded functions of x (1, n) ---- */

static lg_var at(lg_tape *tape, lg_var x, uint32_t index) {
    return lg_slice(tape, x, 1, index, 1);
}

static lg_var tanh_of(lg_tape *tape, lg_var x) {
    return lg_act(tape, x, LG_TANH);
}

static lg_var tanh_8(lg_tape *tape, lg_var x) {
    return lg_act_derivative(tape, x, LG_TANH, 8);
}

static lg_var sigmoid_of(lg_tape *tape, lg_var x) {
    return lg_act(tape, x, LG_SIGMOID);
}

static lg_var swish_of(lg_tape *tape, lg_var x) {
    return lg_act(tape, x, LG_SWISH);
}

static lg_var atan2_of(lg_tape *tape, lg_var x) {
    return lg_atan2(tape, at(tape, x, 0), at(tape, x, 1));
}

static lg_var norm_of(lg_tape *tape, lg_var x) {
    return lg_sqrt(tape, lg_rownorm2(tape, x));
}

static lg_var stumpff_of(lg_tape *tape, lg_var x) {
    return lg_stumpff_functions(tape, x, 4);
}

static lg_var dexpinv_of(lg_tape *tape, lg_var x) {
    return lg_dexpinv_coefficient(tape, x, 0);
}

static lg_var cross_entropy_of(lg_tape *tape, lg_var x) {
    const lg_shape shape = lg_var_shape(tape, x);
    const lg_var other = lg_full(tape, lg_shape2(1, shape.dims[1] - 1), 0),
                 one = lg_full(tape, lg_shape2(1, 1), 1);
    return lg_loss_record(tape, LG_LOSS_CROSS_ENTROPY, x, lg_concat(tape, (const lg_var[]){one, other}, 2, 1),
                          LG_NONE);
}

static lg_var bce_of(lg_tape *tape, lg_var x) {
    return lg_loss_record(tape, LG_LOSS_BCE_LOGITS, x, lg_full(tape, lg_shape2(1, 1), 1), LG_NONE);
}

/* The dot product of the first half of x and the second half. */
static lg_var dot_of(lg_tape *tape, lg_var x) {
    const uint32_t half = lg_var_shape(tape, x).dims[1] / 2;
    return lg_rowdot(tape, lg_slice(tape, x, 1, 0, half), lg_slice(tape, x, 1, half, half));
}

/* x holds A (k, k), then b (k). The result is the solution of A y = b. */
static lg_var solve_of(lg_tape *tape, lg_var x) {
    const uint32_t n = lg_var_shape(tape, x).dims[1];
    uint32_t k = 1;
    while (k * k + k < n) k++;
    const lg_var a = lg_reshape(tape, lg_slice(tape, x, 1, 0, k * k), lg_shape3(1, k, k));
    return lg_spd_solve(tape, a, lg_reshape(tape, lg_slice(tape, x, 1, k * k, k), lg_shape3(1, k, 1)));
}

/* cos(a/4 + 2 b), where a and b are equal expressions. */
static lg_var twice_of(lg_tape *tape, lg_var x) {
    const lg_var terms[] = {lg_sin(tape, x), lg_sin(tape, x)};
    return lg_cos(tape, lg_linear_combination(tape, terms, (const double[]){.25, 2}, 2));
}

/* sqrt(x) where x > 0, else 0. The inner select keeps the gradient of sqrt finite in the branch that is not
 * taken. */
static lg_var select_of(lg_tape *tape, lg_var x) {
    const lg_var zero = lg_full(tape, lg_var_shape(tape, x), 0),
                 one = lg_full(tape, lg_var_shape(tape, x), 1);
    const lg_var positive = lg_sub(tape, one, lg_ge(tape, zero, x));
    return lg_select(tape, positive, lg_sqrt(tape, lg_select(tape, positive, x, one)), zero);
}

/* ---- maps of Lie groups ---- */

static lg_status so3_exp(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_so3_exp(in, out);
    return LG_OK;
}

/* The largest magnitude of the entries of R^T R - I. */
static lg_status so3_defect(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    double R[9];
    lg_so3_exp(in, R);
    out[0] = 0;
    for (int i = 0; i < 9; i++) {
        const int a = i / 3, b = i % 3;
        const double product = R[a] * R[b] + R[a + 3] * R[b + 3] + R[a + 6] * R[b + 6] - (a == b);
        out[0] = fmax(out[0], fabs(product));
    }
    return LG_OK;
}

static lg_status so3_exp_act(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_so3_exp_act(in, in + 3, out);
    return LG_OK;
}

static lg_status so3_log(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_so3_log(in, out);
    return LG_OK;
}

static lg_status so3_dexp(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_so3_dexp(in, in + 3, out);
    return LG_OK;
}

static lg_status so3_dexpinv(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_so3_dexpinv(in, in + 3, out);
    return LG_OK;
}

static lg_status so3_project(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    memcpy(out, in, 9 * sizeof(*out));
    lg_so3_project(out);
    return LG_OK;
}

static lg_status se3_exp(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_se3_exp(in, out, out + 9);
    return LG_OK;
}

static lg_status se3_log(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_se3_log(in, in + 9, out);
    return LG_OK;
}

static lg_status se3_dexp(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_se3_dexp(in, in + 6, out);
    return LG_OK;
}

static lg_status se3_dexpinv(const double *in, size_t n, double *out, size_t m) {
    (void)n, (void)m;
    lg_se3_dexpinv(in, in + 6, out);
    return LG_OK;
}

const hard_function hard_maths[] = {
    {"sin", .record = lg_sin},
    {"sin, f32", .record = lg_sin, .dtype = LG_F32},
    {"sin, plan", .record = lg_sin, .way = HARD_PLAN},
    {"cos", .record = lg_cos},
    {"exp", .record = lg_exp},
    {"exp, f32", .record = lg_exp, .dtype = LG_F32},
    {"exp, plan", .record = lg_exp, .way = HARD_PLAN},
    {"log", .record = lg_log},
    {"log, plan", .record = lg_log, .way = HARD_PLAN},
    {"sqrt", .record = lg_sqrt},
    {"tanh", .record = tanh_of},
    {"tanh, f32", .record = tanh_of, .dtype = LG_F32},
    {"tanh, plan", .record = tanh_of, .way = HARD_PLAN},
    {"tanh^(8)", .record = tanh_8},
    {"sigmoid", .record = sigmoid_of},
    {"sigmoid, plan", .record = sigmoid_of, .way = HARD_PLAN},
    {"swish", .record = swish_of},
    {"atan2", .record = atan2_of},
    {"log softmax", .record = lg_log_softmax},
    {"cross entropy", .record = cross_entropy_of},
    {"cross entropy, gradient", .record = cross_entropy_of, .way = HARD_GRADIENT},
    {"binary cross entropy", .record = bce_of},
    {"binary cross entropy, gradient", .record = bce_of, .way = HARD_GRADIENT},
    {"Stumpff c_0..c_4", .record = stumpff_of},
    {"Stumpff c_0..c_4, plan", .record = stumpff_of, .way = HARD_PLAN},
    {"Stumpff, gradient", .record = stumpff_of, .way = HARD_GRADIENT},
    {"dexpinv g_2", .record = dexpinv_of},
    {"dexpinv g_2, gradient", .record = dexpinv_of, .way = HARD_GRADIENT},
    {"sum", .record = lg_sum},
    {"mean", .record = lg_mean},
    {"sum, f32", .record = lg_sum, .dtype = LG_F32},
    {"dot product", .record = dot_of},
    {"spd solve", .record = solve_of},
    {"spd solve, f32", .record = solve_of, .dtype = LG_F32},
    {"norm", .record = norm_of},
    {"norm, gradient", .record = norm_of, .way = HARD_GRADIENT},
    {"atan2, gradient", .record = atan2_of, .way = HARD_GRADIENT},
    {"sqrt behind select, gradient", .record = select_of, .way = HARD_GRADIENT},
    {"cos(a/4 + 2 b), a = b = sin x", .record = twice_of, .way = HARD_ROWS},
    {"exp of so(3)", .measure = so3_exp},
    {"exp of so(3), R^T R - I", .measure = so3_defect},
    {"exp of so(3) on a vector", .measure = so3_exp_act},
    {"log of SO(3)", .measure = so3_log},
    {"dexp of so(3)", .measure = so3_dexp},
    {"dexpinv of so(3)", .measure = so3_dexpinv},
    {"projection to SO(3)", .measure = so3_project},
    {"exp of se(3)", .measure = se3_exp},
    {"log of SE(3)", .measure = se3_log},
    {"dexp of se(3)", .measure = se3_dexp},
    {"dexpinv of se(3)", .measure = se3_dexpinv},
    {.name = NULL},
};

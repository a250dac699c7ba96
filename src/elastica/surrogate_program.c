/* Surrogates as programs, with their Jacobians.
 *
 * R is the sign of the mirror: 1, or -1, which changes the sign of y-components. f is the network, evaluated
 * on its side of the mirror.
 *   discrete    q_i = q0 + R f_i, v_i = R f_i', where f_i and f_i' depend on (v0, qN - q0, vN)
 *   continuous  q = q0 + R f(s/L, v0, qN - q0, vN); with held ends q = H + w R f
 *   angle       theta = R (pi f(s) + m_0 w_0(s) + m_N w_N(s)), f(s) = f(theta_0/pi, theta_N/pi, s),
 *               m_0 = theta_0 - pi f(0), m_N = theta_N - pi f(L)
 * w_0 and w_N are the weights of the ends; they are 0 without `boundary`. A tangent of length 0 has no angle:
 * derivatives with respect to it are NaN.
 *
 * x are boundary conditions (B, 8). For the continuous and the angle network the functions' input begins with
 * s. */
#include <math.h>

#include "core/core.h"
#include "liegrad/ops.h"
#include "liegrad/program.h"
#include "model/record.h"
#include "elastica/surrogate_internal.h"

enum { BOUNDARY = 8 };
enum { THETA, MEAN, MODES, PARAMETERS };

/* The recording of a model on a tape. */
typedef struct drawing {
    lg_tape *tape;
    const lg_surrogate *model;
    const lg_var *theta; /* the program's parameters: theta, then mean and modes if there are any */
} drawing;

static uint32_t rows_of(const drawing *d, lg_var x) {
    return lg_var_shape(d->tape, x).dims[0];
}

static lg_var beside(const drawing *d, lg_var a, lg_var b) {
    const lg_var both[2] = {a, b};
    return lg_concat(d->tape, both, 2, 1);
}

/* Returns a row (1, count), to be used with all rows of a batch. */
static lg_var row(const drawing *d, const double *values, uint32_t count) {
    return lg_input_f64(d->tape, lg_shape2(1, count), values);
}

static lg_var net(const drawing *d, lg_var input) {
    if (d->model->options.modes == 0) return lg_surrogate_net(d->tape, d->model, d->theta[THETA], input);
    const lg_var c = lg_net_record(d->tape, &d->model->net, d->theta[THETA], 0, input);
    const lg_shape shape = lg_shape2(d->model->options.modes, lg_surrogate_outputs(d->model));
    const lg_var modes = lg_reshape(d->tape, d->theta[MODES], shape);
    return lg_dense(d->tape, c, modes, d->theta[MEAN], LG_IDENTITY);
}

/* Number of inputs before the boundary conditions: 1 (s), or 0 for the discrete network. */
static uint32_t places(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_DISCRETE ? 0 : 1;
}

/* ---- the mirror ---- */

/* R (B, 1): the sign of the first of these numbers that is not zero: v0y - vNy, v0y, qNy - q0y. 1 without
 * `mirror`. */
static lg_var sign_of(const drawing *d, lg_var x) {
    lg_tape *t = d->tape;
    if (!d->model->options.mirror) return lg_full(t, lg_shape2(rows_of(d, x), 1), 1.0);
    const lg_var v0 = lg_columns(d->tape, x, LG_AT_V0 + 1, 1), vn = lg_columns(d->tape, x, LG_AT_VN + 1, 1);
    const lg_var q0 = lg_columns(d->tape, x, LG_AT_Q0 + 1, 1), qn = lg_columns(d->tape, x, LG_AT_QN + 1, 1);
    const lg_var turn = lg_sub(t, v0, vn), rise = lg_sub(t, qn, q0);
    return lg_select(t, turn, lg_sign(t, turn), lg_select(t, v0, lg_sign(t, v0), lg_sign(t, rise)));
}

/* Multiplies the y-components of y (B, n) by R; y consists of pairs (x, y). */
static lg_var reflected(const drawing *d, lg_var y, lg_var sign) {
    const lg_shape shape = lg_var_shape(d->tape, y);
    if (!d->model->options.mirror) return y;
    const lg_var one = lg_full(d->tape, lg_var_shape(d->tape, sign), 1.0);
    const lg_var factors = lg_reshape(d->tape, beside(d, one, sign), lg_shape3(shape.dims[0], 1, 2));
    const lg_var pairs = lg_reshape(d->tape, y, lg_shape3(shape.dims[0], shape.dims[1] / 2, 2));
    return lg_reshape(d->tape, lg_mul(d->tape, pairs, factors), shape);
}

/* ---- discrete and continuous networks ---- */

/* x (B, 8) relative to q0. */
static lg_var relative(const drawing *d, lg_var x) {
    static const double counted[BOUNDARY] = {1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0};
    const lg_var q0 = lg_columns(d->tape, x, LG_AT_Q0, 2), twice = beside(d, q0, q0);
    return lg_sub(d->tape, x, lg_mul(d->tape, beside(d, twice, twice), row(d, counted, BOUNDARY)));
}

/* Evaluates the network at s (B, 1), if it has s, and at the relative conditions z (B, 8), on its side of the
 * mirror: (B, outputs). With `normalise` the x-coordinates of the ends enter as (input - centre)/centre. */
static lg_var net_at(const drawing *d, lg_var s, lg_var z, lg_var sign) {
    lg_tape *t = d->tape;
    double centre[BOUNDARY], scale[BOUNDARY];
    lg_var seen = reflected(d, z, sign);
    for (size_t c = 0; c < BOUNDARY; c++) {
        const bool point = c == LG_AT_Q0 || c == LG_AT_QN;
        centre[c] = point ? d->model->centre : 0.0;
        scale[c] = point ? d->model->centre : 1.0;
    }
    if (d->model->options.normalise)
        seen = lg_div(t, lg_sub(t, seen, row(d, centre, BOUNDARY)), row(d, scale, BOUNDARY));
    if (places(d->model) > 0) seen = beside(d, lg_scale(t, s, 1.0 / d->model->length), seen);
    return net(d, seen);
}

/* Number of outputs that are positions relative to q0. They come before the tangents. */
static uint32_t points_in(const lg_surrogate *model) {
    const uint32_t outputs = lg_surrogate_outputs(model);
    return model->options.kind == LG_SURROGATE_DISCRETE ? outputs / 2 : outputs;
}

static bool is_held(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_CONTINUOUS && model->options.boundary;
}

/* Column j of `numbers` holds the coefficients of number j of (q0, L v0, qN, L vN, w) in the basis (u^3,
 * t u^2, t^2 u, t^3, t^2 u^2), where t = s/L and u = 1 - t. */
enum { HELD = 5 };
lg_var lg_surrogate_hold_ends(lg_tape *tape, const lg_surrogate *model, lg_var s, lg_var x, lg_var f) {
    const double L = model->length;
    const double numbers[HELD][HELD] = {
        {1, 0, 0, 0, 0}, {3, L, 0, 0, 0}, {0, 0, 3, -L, 0}, {0, 0, 1, 0, 0}, {0, 0, 0, 0, 16}};
    const lg_var t = lg_scale(tape, s, 1.0 / L), u = lg_add_scalar(tape, lg_scale(tape, t, -1.0), 1.0);
    const lg_var tt = lg_mul(tape, t, t), tu = lg_mul(tape, t, u), uu = lg_mul(tape, u, u);
    const lg_var basis[HELD] = {lg_mul(tape, uu, u), lg_mul(tape, tu, u), lg_mul(tape, tu, t),
                                lg_mul(tape, tt, t), lg_mul(tape, tu, tu)};
    const lg_var shares = lg_matmul(tape, lg_concat(tape, basis, HELD, 1),
                                    lg_input_f64(tape, lg_shape2(HELD, HELD), numbers[0]));
    lg_var sum = lg_mul(tape, lg_columns(tape, shares, HELD - 1, 1), f);
    for (uint32_t j = 0; j + 1 < HELD; j++)
        sum = lg_add(tape, sum, lg_mul(tape, lg_columns(tape, shares, j, 1), lg_columns(tape, x, 2 * j, 2)));
    return sum;
}

/* Computes the outputs of the program (B, outputs) from those of the network, y: adds q0 or, with held ends,
 * combines with H. */
static lg_var hand_over(const drawing *d, lg_var y, lg_var s, lg_var x) {
    lg_tape *t = d->tape;
    const uint32_t n = points_in(d->model), outputs = lg_surrogate_outputs(d->model), rows = rows_of(d, y);
    if (is_held(d->model)) return lg_surrogate_hold_ends(t, d->model, s, x, y);
    const lg_var pairs = lg_reshape(t, lg_columns(d->tape, y, 0, n), lg_shape3(rows, n / 2, 2));
    const lg_var q0 = lg_reshape(t, lg_columns(d->tape, x, LG_AT_Q0, 2), lg_shape3(rows_of(d, x), 1, 2));
    const lg_var q = lg_reshape(t, lg_add(t, pairs, q0), lg_shape2(rows, n));
    return n == outputs ? q : beside(d, q, lg_columns(d->tape, y, n, outputs - n));
}

static lg_var value_at(const drawing *d, lg_var s, lg_var x) {
    const lg_var sign = sign_of(d, x);
    return hand_over(d, reflected(d, net_at(d, s, relative(d, x), sign), sign), s, x);
}

static lg_status curve_value(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    const drawing d = {t, user, theta};
    y[0] = value_at(&d, lg_columns(t, in[0], 0, 1), lg_columns(t, in[0], places(d.model), BOUNDARY));
    return lg_tape_status(t);
}

/* ---- angle network ---- */

/* Angle of a tangent v (B, 2); of its mirror image for R = -1. */
static lg_var angle_of(const drawing *d, lg_var v, lg_var sign) {
    const lg_var y = lg_mul(d->tape, sign, lg_columns(d->tape, v, 1, 1));
    return lg_surrogate_angle(d->tape, beside(d, lg_columns(d->tape, v, 0, 1), y));
}

/* pi f at s (B, 1) for the end angles `angles` (B or 1, 2). */
static lg_var net_angle(const drawing *d, lg_var s, lg_var angles) {
    const lg_var ends = lg_scale(d->tape, angles, 1.0 / LG_SURROGATE_PI);
    const lg_var all = lg_broadcast_to(d->tape, ends, lg_shape2(rows_of(d, s), 2));
    return lg_scale(d->tape, net(d, beside(d, all, s)), LG_SURROGATE_PI);
}

/* w_0 and w_N at s (B, 1): (B, 2). They are (1, 0) at s = 0 and (0, 1) at s = L. */
static lg_var end_weights(const drawing *d, lg_var s) {
    lg_tape *t = d->tape;
    const double length = d->model->length, c = exp(-100.0 * length * length);
    const double mixed = 1.0 / ((1.0 - c) * (1.0 + c));
    const double high = (double)(float)length; /* so that s - L is exact near L, also in single precision */
    const lg_var rest = lg_add_scalar(t, lg_add_scalar(t, s, -high), high - length);
    const lg_var a = lg_exp(t, lg_scale(t, lg_square(t, s), -100.0));
    const lg_var b = lg_exp(t, lg_scale(t, lg_square(t, rest), -100.0));
    const double own[2] = {mixed, -c * mixed}, other[2] = {-c * mixed, mixed};
    const lg_var both[2] = {a, b};
    return beside(d, lg_linear_combination(t, both, own, 2), lg_linear_combination(t, both, other, 2));
}

/* Columns of the quantities that are computed once per curve: R, theta_0, theta_N, m_0, m_N (B, 5). */
enum { CURVE_SIGN, CURVE_ANGLES, CURVE_MISSING = 3, CURVE_NUMBERS = LG_SURROGATE_ENDS };

/* Computes R, theta_0, theta_N: (B, 3). */
static lg_var side_and_angles(const drawing *d, lg_var x) {
    const lg_var sign = sign_of(d, x);
    const lg_var first = angle_of(d, lg_columns(d->tape, x, LG_AT_V0, 2), sign);
    const lg_var last = angle_of(d, lg_columns(d->tape, x, LG_AT_VN, 2), sign);
    return beside(d, beside(d, sign, first), last);
}

/* pi f (B, n) at the points s (B, n) of the curves `curve` (B, 3 or more). */
static lg_var net_angles(const drawing *d, lg_var s, lg_var curve) {
    const lg_shape shape = lg_var_shape(d->tape, s);
    const uint32_t n = shape.dims[1];
    const lg_var angles = lg_record_copies(d->tape, lg_columns(d->tape, curve, CURVE_ANGLES, 2), n);
    return lg_reshape(d->tape, net_angle(d, lg_reshape(d->tape, s, lg_shape2(shape.dims[0] * n, 1)), angles),
                      shape);
}

static lg_var both_ends(const drawing *d, uint32_t rows) {
    const double at[2] = {0.0, d->model->length};
    return lg_broadcast_to(d->tape, row(d, at, 2), lg_shape2(rows, 2));
}

/* Computes theta at s (B, 1) from `angle`, the value of pi f there: adds the corrections of the end angles
 * and undoes the mirror. curve (B or 1, 3 or more), missing (B or 1, 2). */
static lg_var hold_ends(const drawing *d, lg_var angle, lg_var s, lg_var curve, lg_var missing) {
    lg_tape *t = d->tape;
    if (d->model->options.boundary) {
        const lg_var held = lg_mul(t, end_weights(d, s), missing);
        angle = lg_add(t, angle, lg_add(t, lg_columns(d->tape, held, 0, 1), lg_columns(d->tape, held, 1, 1)));
    }
    return d->model->options.mirror ? lg_mul(t, angle, lg_columns(d->tape, curve, CURVE_SIGN, 1)) : angle;
}

/* Program function `value` of the angle network. The network is evaluated at s and at both ends in one
 * batch. */
static lg_status angle_value(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    const drawing d = {t, user, theta};
    const lg_var s = lg_columns(d.tape, in[0], 0, 1),
                 curve = side_and_angles(&d, lg_columns(d.tape, in[0], 1, BOUNDARY));
    lg_var angle, missing = LG_NONE;
    if (d.model->options.boundary) {
        const lg_var all = net_angles(&d, beside(&d, s, both_ends(&d, rows_of(&d, s))), curve);
        angle = lg_columns(d.tape, all, 0, 1);
        missing = lg_sub(t, lg_columns(d.tape, curve, CURVE_ANGLES, 2), lg_columns(d.tape, all, 1, 2));
    } else {
        angle = net_angles(&d, s, curve);
    }
    y[0] = hold_ends(&d, angle, s, curve, missing);
    return lg_tape_status(t);
}

/* ---- Jacobians ---- */

/* dq/dq0 while the network's input stays the same: (1, outputs, 2). */
static lg_var identity(const drawing *d) {
    static const double pair[4] = {1.0, 0.0, 0.0, 1.0};
    const uint32_t n = points_in(d->model), outputs = lg_surrogate_outputs(d->model);
    const lg_var one = lg_input_f64(d->tape, lg_shape3(1, 2, 2), pair);
    const lg_var all = lg_broadcast_to(d->tape, one, lg_shape3(n / 2, 2, 2));
    return lg_pad(d->tape, lg_reshape(d->tape, all, lg_shape3(1, n, 2)), 1, 0, outputs - n);
}

/* Program function `grad` of networks whose positions are relative to q0: y and its Jacobian g (B, outputs,
 * inputs). One batch evaluates the network. The batch has a row for each output or, as the discrete network
 * has many outputs, for each of the inputs v0, qN - q0 and vN. */
static lg_status free_gradient(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    enum { DIRECTIONS = BOUNDARY - LG_AT_V0 };
    const drawing d = {t, user, theta};
    const uint32_t rows = rows_of(&d, in[0]), outputs = lg_surrogate_outputs(d.model),
                   first = places(d.model), count = first == 0 ? DIRECTIONS : outputs;
    const lg_var x = lg_columns(t, in[0], first, BOUNDARY), s = lg_columns(t, in[0], 0, 1);
    const lg_var z = relative(&d, x), sign = sign_of(&d, x);
    const lg_var of[2] = {lg_record_copies(t, z, count), lg_record_copies(t, s, count)};
    const lg_var units = first == 0 ? lg_record_units(t, rows, count, LG_AT_V0, BOUNDARY)
                                    : lg_record_units(t, rows, count, 0, outputs);
    const lg_var signs = lg_record_copies(t, sign, count), f = net_at(&d, of[1], of[0], signs);
    lg_var by[2] = {LG_NONE, LG_NONE};
    y[0] = hand_over(&d, reflected(&d, net_at(&d, s, z, sign), sign), s, x);
    if (first == 0) {
        LG_TRY(lg_jvp(t, &f, 1, of, &units, 1, by));
        by[0] = reflected(&d, by[0], signs);
        by[0] = lg_transpose(t, lg_reshape(t, by[0], lg_shape3(rows, count, outputs)));
    } else {
        LG_TRY(lg_vjp(t, &f, &units, 1, of, 2, by));
        const lg_var one = lg_full(t, lg_var_shape(t, sign), 1.0);
        const lg_var side = lg_reshape(t, beside(&d, one, sign), lg_shape3(rows, count, 1));
        by[0] = lg_slice(t, lg_reshape(t, by[0], lg_shape3(rows, count, BOUNDARY)), 2, LG_AT_V0, DIRECTIONS);
        by[0] = lg_mul(t, by[0], side);
        by[1] = lg_mul(t, lg_reshape(t, by[1], lg_shape3(rows, count, 1)), side);
    }
    const lg_var chord = lg_slice(t, by[0], 2, LG_AT_QN - LG_AT_V0, 2);
    const lg_var parts[3] = {by[1], lg_sub(t, identity(&d), chord), by[0]};
    y[1] = lg_concat(t, parts + 1 - first, 2 + first, 2);
    return lg_tape_status(t);
}

/* The same for all other networks, from the function `value`. */
static lg_status gradient(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    const lg_surrogate *model = user;
    const bool angle = model->options.kind == LG_SURROGATE_ANGLE;
    if (!angle && !is_held(model)) return free_gradient(user, t, theta, in, y);
    return lg_record_gradient(angle ? angle_value : curve_value, user, t, theta, in, false, y);
}

/* ---- functions for many points of one curve ---- */

/* Repeats `numbers` (count), which belong to the curve, for every row of s. */
static lg_var for_all(const drawing *d, lg_var numbers, uint32_t count, lg_var s) {
    const lg_var row = lg_reshape(d->tape, numbers, lg_shape2(1, count));
    return lg_broadcast_to(d->tape, row, lg_shape2(rows_of(d, s), count));
}

/* Program function `point` of the continuous network: s, and x of the curve -> q, v. */
static lg_status curve_point(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    const drawing d = {t, user, theta};
    const lg_var forward = lg_full(t, lg_var_shape(t, in[0]), 1.0);
    y[0] = value_at(&d, in[0], for_all(&d, in[1], BOUNDARY, in[0]));
    return lg_jvp(t, y, 1, in, &forward, 1, y + 1);
}

/* Program function `place`: s, and x of the curve -> q. */
static lg_status curve_place(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    const drawing d = {t, user, theta};
    const lg_var both = beside(&d, in[0], for_all(&d, in[1], BOUNDARY, in[0]));
    y[0] = lg_program_call(t, "value", 0, &both);
    return lg_tape_status(t);
}

/* Program function `ends`: x -> R, theta_0, theta_N, m_0, m_N. */
static lg_status angle_ends(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    const drawing d = {t, user, theta};
    const uint32_t rows = rows_of(&d, in[0]);
    const lg_var curve = side_and_angles(&d, in[0]);
    lg_var missing = lg_full(t, lg_shape2(rows, 2), 0.0);
    if (d.model->options.boundary)
        missing =
            lg_sub(t, lg_columns(d.tape, curve, CURVE_ANGLES, 2), net_angles(&d, both_ends(&d, rows), curve));
    y[0] = beside(&d, curve, missing);
    return lg_tape_status(t);
}

/* Program function `point` of the angle network: s, and the outputs of `ends` -> theta. */
static lg_status angle_point(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    const drawing d = {t, user, theta};
    const lg_var curve = lg_reshape(t, in[1], lg_shape2(1, CURVE_NUMBERS));
    const lg_var angle = net_angle(&d, in[0], lg_columns(d.tape, curve, CURVE_ANGLES, 2));
    y[0] = hold_ends(&d, angle, in[0], curve, lg_columns(d.tape, curve, CURVE_MISSING, 2));
    return lg_tape_status(t);
}

/* Program function `span` of the angle network: s, the outputs of `ends`, a length -> the integral of
 * (cos theta, sin theta) from s over this length, by Gauss's rule. */
static lg_status angle_span(void *user, lg_tape *t, const lg_var *theta, const lg_var *in, lg_var *y) {
    const uint32_t rows = lg_var_shape(t, in[0]).dims[0];
    const lg_shape points = lg_shape2(rows, LG_GAUSS_POINTS);
    const lg_var share = lg_input_f64(t, lg_shape2(1, LG_GAUSS_POINTS), lg_gauss_at);
    const lg_var weight = lg_input_f64(t, lg_shape2(LG_GAUSS_POINTS, 1), lg_gauss_weight);
    const lg_var at = lg_add(t, in[0], lg_mul(t, in[2], share));
    const lg_var of[2] = {lg_reshape(t, at, lg_shape2(rows * LG_GAUSS_POINTS, 1)), in[1]};
    lg_var angle = LG_NONE;
    LG_TRY(angle_point(user, t, theta, of, &angle));
    angle = lg_reshape(t, angle, points);
    const lg_var sums[2] = {lg_matmul(t, lg_cos(t, angle), weight), lg_matmul(t, lg_sin(t, angle), weight)};
    y[0] = lg_mul(t, lg_concat(t, sums, 2, 1), in[2]);
    return lg_tape_status(t);
}

/* ---- functions of each kind of network ---- */

/* Inputs and outputs of the functions. */
static const lg_port x8 = {.name = "x", .shape = {1, {BOUNDARY}}},
                     x9 = {.name = "x", .shape = {1, {1 + BOUNDARY}}};
static const lg_port point_in[2] = {{.name = "s", .shape = {1, {1}}},
                                    {.name = "x", .shape = {1, {BOUNDARY}}, .shared = true}};
static const lg_port angle_in[3] = {{.name = "s", .shape = {1, {1}}},
                                    {.name = "ends", .shape = {1, {CURVE_NUMBERS}}, .shared = true},
                                    {.name = "length", .shape = {1, {1}}}};
static const lg_port value_out[2] = {{.name = "y"}, {.name = "g"}};
static const lg_port point_out[2] = {{.name = "q"}, {.name = "v"}};
static const lg_port ends_out = {.name = "ends"}, theta_out = {.name = "theta"},
                     span_out = {.name = "integral"};

enum { MOST_FUNCTIONS = 5 };
static const struct bundle {
    const char *description;
    lg_function_spec function[MOST_FUNCTIONS];
} bundles[LG_SURROGATE_KIND_COUNT] = {
    [LG_SURROGATE_DISCRETE] = {"discrete surrogate of a beam",
                               {{"value", &x8, 1, value_out, 1, curve_value, NULL},
                                {"grad", &x8, 1, value_out, 2, gradient, NULL}}},
    [LG_SURROGATE_CONTINUOUS] = {"continuous surrogate of a beam",
                                 {{"value", &x9, 1, value_out, 1, curve_value, NULL},
                                  {"grad", &x9, 1, value_out, 2, gradient, NULL},
                                  {"point", point_in, 2, point_out, 2, curve_point, NULL},
                                  {"place", point_in, 2, point_out, 1, curve_place, NULL}}},
    [LG_SURROGATE_ANGLE] = {"angle surrogate of a beam",
                            {{"value", &x9, 1, value_out, 1, angle_value, NULL},
                             {"grad", &x9, 1, value_out, 2, gradient, NULL},
                             {"ends", &x8, 1, &ends_out, 1, angle_ends, NULL},
                             {"point", angle_in, 2, &theta_out, 1, angle_point, NULL},
                             {"span", angle_in, 3, &span_out, 1, angle_span, NULL}}},
};

lg_status lg_surrogate_program(const lg_context *context, const lg_surrogate *model, const double *theta,
                               lg_program **out, lg_error *error) {
    LG_NEEDS(error, model, theta, out);
    LG_TRY(lg_surrogate_check_modes(model, error));
    const struct bundle *bundle = &bundles[model->options.kind];
    lg_function_spec functions[MOST_FUNCTIONS];
    const uint32_t modes = model->options.modes, outputs = lg_surrogate_outputs(model);
    const lg_parameter_spec parameters[PARAMETERS] = {
        [THETA] = {"theta", lg_shape1((uint32_t)lg_surrogate_parameters(model)), theta},
        [MEAN] = {"mean", lg_shape1(outputs), model->modes},
        [MODES] = {"modes", lg_shape1(modes * outputs), modes > 0 ? model->modes + outputs : NULL}};
    lg_program_spec spec;
    lg_program_spec_init(&spec);
    for (; spec.function_count < MOST_FUNCTIONS && bundle->function[spec.function_count].name != NULL;
         spec.function_count++) {
        functions[spec.function_count] = bundle->function[spec.function_count];
        functions[spec.function_count].user = (void *)(uintptr_t)model; /* never written */
    }
    spec.parameters = parameters;
    spec.parameter_count = modes > 0 ? PARAMETERS : MEAN;
    spec.functions = functions;
    spec.description = bundle->description;
    return lg_program_build(context, &spec, out, error);
}

/* Surrogates as maps of numbers, with their Jacobians.
 *
 * With R the sign of the mirror (1, or -1 on y-components) and f the network on its own side of it:
 *   discrete    q_i = q0 + R f_i, v_i = R f_i', both functions of (v0, qN - q0, vN): columns of q0 are those
 *               of -qN, and the identity for q
 *   continuous  q = q0 + R f(s/L, v0, qN - q0, vN), likewise
 *   angle       theta = R (pi f(s) + m_0 w_0(s) + m_N w_N(s)), m_0 = theta_0 - pi f(0), m_N = theta_N - pi
 *               f(L), f(s) = f(theta_0/pi, theta_N/pi, s); w are the weights at the ends, 0 without
 * `boundary` A tangent of length 0 has no angle: the derivatives by it are NaN.
 */
#include "core/core.h"
#include "models/model_internal.h"
#include "models/surrogate_internal.h"
#include "nn/eval.h"

/* Where the columns of the boundary conditions begin, in the input and the Jacobian. */
static size_t first_boundary(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_DISCRETE ? 0 : 1;
}

/* Directions in which the network of a discrete or continuous model is differentiated: s where there is one,
 * then v0, qN and vN. */
enum { BOUNDARY_DIRECTIONS = 6, PLACES = 3 };

/* Rows of the network's input: directions, or the places of an angle network. */
static size_t rows_of(const lg_surrogate *model) {
    if (model->options.kind == LG_SURROGATE_ANGLE) return PLACES;
    return first_boundary(model) + BOUNDARY_DIRECTIONS;
}

typedef struct pieces {
    double *x, *dx; /* (rows, in of the network); angle: dx is the gradient */
    double *y, *dy; /* (rows, out) */
    char *net;
} pieces;

static double *take(char **rest, size_t *bytes, size_t numbers) {
    return (double *)(void *)eval_take(rest, bytes, numbers * sizeof(double));
}

/* With `work` NULL only *bytes is of use. */
static pieces cut(const lg_surrogate *model, void *work, size_t *bytes) {
    const size_t rows = rows_of(model);
    char *rest = work;
    pieces p;
    *bytes = 0;
    p.x = take(&rest, bytes, rows * model->net.inputs);
    p.dx = take(&rest, bytes, rows * model->net.inputs);
    p.y = take(&rest, bytes, rows * model->net.outputs);
    p.dy = take(&rest, bytes, rows * model->net.outputs);
    p.net = eval_take(&rest, bytes, 0);
    *bytes += lg_net_work_size(&model->net, rows, LG_F64);
    return p;
}

size_t lg_model_surrogate_inputs(const lg_surrogate *model) {
    return first_boundary(model) + 8;
}

size_t lg_model_surrogate_outputs(const lg_surrogate *model) {
    return model->net.outputs;
}

size_t lg_model_surrogate_work_size(const lg_surrogate *model) {
    size_t bytes;
    (void)cut(model, NULL, &bytes);
    return bytes;
}

/* ---- discrete and continuous ---- */

/* Sign of output o under reflection: y-components, which are the odd ones. */
static double sign_of(double sign, size_t o) {
    return o % 2 == 1 ? sign : 1.0;
}

/* Outputs that count from q0: the points, which stand before the tangents of the discrete network. */
static size_t points_in(const lg_surrogate *model) {
    return model->options.kind == LG_SURROGATE_DISCRETE ? model->net.outputs / 2 : model->net.outputs;
}

static void hand_over(const lg_surrogate *model, const double *boundary, double sign, const double *f,
                      double *y) {
    const size_t points = points_in(model);
    for (size_t o = 0; o < model->net.outputs; o++)
        y[o] = (o < points ? boundary[LG_AT_Q0 + o % 2] : 0.0) + sign_of(sign, o) * f[o];
}

static void eval_curve(const lg_surrogate *model, const double *theta, const double *x, double *y,
                       const pieces *p) {
    const double *boundary = x + first_boundary(model);
    const double sign = lg_surrogate_sign(model, boundary);
    lg_surrogate_row(model, boundary, sign, x[0], p->x);
    lg_net_eval(&model->net, LG_F64, theta, p->x, 1, p->y, p->net);
    hand_over(model, boundary, sign, p->y, y);
}

/* Row by row: the same input, each with its direction. */
static void lay_directions(const lg_surrogate *model, const double *x, double sign, const pieces *p) {
    const size_t first = first_boundary(model), in = model->net.inputs, rows = rows_of(model);
    const double none[8] = {0.0};
    for (size_t r = 0; r < rows; r++) {
        double dx[8] = {0.0};
        lg_surrogate_row(model, x + first, sign, x[0], p->x + r * in);
        if (r >= first) dx[LG_AT_V0 + r - first] = 1.0;
        lg_surrogate_row_tangent(model, r < first ? none : dx, sign, r < first ? 1.0 : 0.0, p->dx + r * in);
    }
}

static void curve_jacobian(const lg_surrogate *model, const double *theta, const double *x, double *y,
                           double *jacobian, const pieces *p) {
    const size_t first = first_boundary(model), outputs = model->net.outputs, rows = rows_of(model);
    const size_t columns = first + 8, points = points_in(model);
    const double sign = lg_surrogate_sign(model, x + first);
    lay_directions(model, x, sign, p);
    lg_net_jvp(&model->net, LG_F64, theta, p->x, p->dx, rows, p->y, p->dy, p->net);
    for (size_t o = 0; o < outputs; o++) {
        double *row = jacobian + o * columns, *by = row + first;
        for (size_t r = 0; r < rows; r++)
            row[r < first ? r : r + LG_AT_V0] = sign_of(sign, o) * p->dy[r * outputs + o];
        for (size_t c = 0; c < 2; c++)
            by[LG_AT_Q0 + c] = (o < points && o % 2 == c ? 1.0 : 0.0) - by[LG_AT_QN + c];
    }
    if (y != NULL) hand_over(model, x + first, sign, p->y, y);
}

/* ---- angle ---- */

/* The places at which the network is asked: s, and for `boundary` both ends. Returns how many. */
static size_t lay_places(const lg_surrogate *model, const double *x, double sign, const pieces *p) {
    const double at[PLACES] = {x[0], 0.0, model->length};
    const size_t count = model->options.boundary ? PLACES : 1;
    for (size_t i = 0; i < count; i++) lg_surrogate_row(model, x + 1, sign, at[i], p->x + 3 * i);
    return count;
}

/* What the network lacks at both ends, from its values at the places. */
static void find_missing(const lg_surrogate *model, const double *x, double sign, const pieces *p,
                         double *missing) {
    missing[0] = missing[1] = 0.0;
    if (!model->options.boundary) return;
    lg_surrogate_angles(x + 1, sign, missing);
    for (size_t i = 0; i < 2; i++) missing[i] -= LG_SURROGATE_PI * p->y[1 + i];
}

static double angle_of(const lg_surrogate *model, const double *x, double sign, const pieces *p) {
    double weights[2], missing[2];
    const double angle = LG_SURROGATE_PI * p->y[0];
    if (!model->options.boundary) return sign * angle;
    find_missing(model, x, sign, p, missing);
    lg_surrogate_end_weights(model, x[0], weights);
    return sign * (angle + (missing[0] * weights[0] + missing[1] * weights[1]));
}

static void eval_angle(const lg_surrogate *model, const double *theta, const double *x, double *y,
                       const pieces *p) {
    const double sign = lg_surrogate_sign(model, x + 1);
    const size_t places = lay_places(model, x, sign, p);
    lg_net_eval(&model->net, LG_F64, theta, p->x, places, p->y, p->net);
    y[0] = angle_of(model, x, sign, p);
}

/* by[i]: derivative of (R theta) by theta_0 and theta_N; g (places, 3): that of f by its input, whose angles
 * are divided by pi. */
static void by_angles(const lg_surrogate *model, double s, const double *g, double *by) {
    double weights[2];
    by[0] = g[0];
    by[1] = g[1];
    if (!model->options.boundary) return;
    lg_surrogate_end_weights(model, s, weights);
    for (size_t i = 0; i < 2; i++)
        for (size_t end = 0; end < 2; end++)
            by[i] += ((i == end ? 1.0 : 0.0) - g[3 * (1 + end) + i]) * weights[end];
}

/* d atan2(R v_y, v_x) = R (v_x dv_y - v_y dv_x)/|v|^2, and R R = 1. */
static void angle_jacobian(const lg_surrogate *model, const double *theta, const double *x, double *y,
                           double *jacobian, const pieces *p) {
    const double sign = lg_surrogate_sign(model, x + 1);
    const size_t places = lay_places(model, x, sign, p);
    const size_t at[2] = {1 + LG_AT_V0, 1 + LG_AT_VN};
    double missing[2], slopes[2] = {0.0, 0.0}, by[2];
    lg_net_input_gradient(&model->net, LG_F64, theta, p->x, places, NULL, p->y, p->dx, p->net);
    find_missing(model, x, sign, p, missing);
    by_angles(model, x[0], p->dx, by);
    if (model->options.boundary) lg_surrogate_end_slopes(model, x[0], slopes);
    for (size_t c = 0; c < 9; c++) jacobian[c] = 0.0;
    jacobian[0] = sign * (LG_SURROGATE_PI * p->dx[2] + (missing[0] * slopes[0] + missing[1] * slopes[1]));
    for (size_t i = 0; i < 2; i++) {
        const double *v = x + at[i], square = v[0] * v[0] + v[1] * v[1];
        jacobian[at[i]] = -by[i] * v[1] / square;
        jacobian[at[i] + 1] = by[i] * v[0] / square;
    }
    if (y != NULL) y[0] = angle_of(model, x, sign, p);
}

/* ---- all ---- */

void lg_model_surrogate_eval(const lg_surrogate *model, const double *theta, const double *x, double *y,
                             void *work) {
    size_t bytes;
    const pieces p = cut(model, work, &bytes);
    (model->options.kind == LG_SURROGATE_ANGLE ? eval_angle : eval_curve)(model, theta, x, y, &p);
}

void lg_model_surrogate_jacobian(const lg_surrogate *model, const double *theta, const double *x, double *y,
                                 double *jacobian, void *work) {
    size_t bytes;
    const pieces p = cut(model, work, &bytes);
    (model->options.kind == LG_SURROGATE_ANGLE ? angle_jacobian : curve_jacobian)(model, theta, x, y,
                                                                                  jacobian, &p);
}

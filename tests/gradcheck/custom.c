/* Cases of the gradient check: custom operations, and an argument on a manifold. */
#include "gradcheck/rows.h"

#include <math.h>

/* ---- custom operations: y = a sin b for each of three numbers ---- */

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

/* ---- an argument on a manifold: q on the sphere, moved to exp(h d) q ---- */

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
    {.function =
         {.name = "custom, built", .build = build_custom, WITH(.i = {0}), INPUTS(ANY(S1(3)), ANY(S1(3)))},
     .operations = {"custom"},
     .no_program = "operation custom"},
    {.function = {.name = "custom, numeric",
                  .build = build_custom,
                  .first_order_only = true,
                  WITH(.i = {1}),
                  INPUTS(ANY(S1(3)), ANY(S1(3)))},
     .operations = {"custom", "custom_derivative"},
     .no_program = "operation custom"},
    {.function = {.name = "on the sphere",
                  .build = build_sphere,
                  .perturb = turn,
                  .tangent = turn_tangent,
                  INPUTS({.shape = S2(1, 3), .values = on_sphere, .algebra = 3}, ANY(S2(1, 3)))}},
};
FAMILY(custom)

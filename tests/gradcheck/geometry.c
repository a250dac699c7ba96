/* Cases of the gradient check: row-wise vector products, solves, functions of the rotation angle, Lie
 * groups. */
#include "gradcheck/rows.h"
#include "autodiff/ops/covariance.h"
#include "autodiff/ops/lie.h"
#include "autodiff/ops/op_rows.h"
#include "autodiff/ops/rocket.h"

#include <math.h>

/* ---- row-wise products, solves, functions of the rotation angle ---- */

BUILD_BINARY(rowdot)
BUILD_BINARY(cross)
BUILD_UNARY(rownorm2)

BUILD(build_cross_self) {
    (void)user;
    return lg_cross(t, x[0], lg_mul(t, x[0], x[0]));
}
/* A = x + 3 I, which is positive definite because the symmetric part of x has a norm below 3. */
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
    return lg_record(t, &lg_op_spd_factor, &a, 1, NULL);
}
/* The adjoint of the root has a solution of S X + X S = W. */
BUILD_BINARY(centre)
BUILD(build_covariance) {
    SETTINGS;
    const lg_var factor = lg_input_f64(t, lg_shape1(3), (const double[]){1.5, -0.5, 0.25});
    return lg_covariance(t, x[0], factor, x[s->i[1]], (uint32_t)s->i[0]);
}
BUILD(build_covariance_root) {
    (void)user;
    const double factor[] = {1.5, 0.5, 2};
    return lg_covariance_root(t, x[0], lg_input_f64(t, lg_shape1(lg_var_shape(t, x[0]).dims[1]), factor));
}
BUILD(build_lyapunov) {
    lg_var in[2] = {definite(t, x[0], 3), x[1]};
    (void)user;
    return lg_record(t, &lg_op_lyapunov, in, 2, NULL);
}
/* Two convolutions of two channels of nine samples. */
BUILD(build_rocket) {
    static const lg_rocket_row rows[] = {{3, 1, 1, 2, 2}, {90, 1, 0, 1, 1}};
    static const uint32_t channels[] = {0, 3, 2};
    const lg_rocket_table table = {rows, channels, 2, 3};
    const lg_var mean = lg_input_f64(t, lg_shape1(2), (const double[]){0.125, -0.25}),
                 inverse = lg_input_f64(t, lg_shape1(2), (const double[]){1.5, 0.75}),
                 bias = lg_input_f64(t, lg_shape1(3), (const double[]){0.25, -0.5, 1});
    (void)user;
    return lg_rocket_record(t, x[0], mean, inverse, bias, &table);
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
/* Five rows u: zero, a tiny rotation, one angle on each side of the limit of the series, and one beyond
 * pi. */
static const double rotations[15] = {0.0, 0.0,  0.0, 1e-9, -2e-9, 2e-9, 1.1, -0.3,
                                     0.4, -1.2, 1.6, 1.1,  3.0,   1.0,  -1.5};
#define ROTATIONS                                                                                            \
    { .shape = S3(5, 1, 3), .values = rotations, .scale = 0.25 }
#define LIE(label, ...)         ROW("lie " label, "lie", build_lie, __VA_ARGS__)
#define LIE_PAIR(label, map, u) LIE(label, WITH(.i = {map, 1}), INPUTS(u, ANY(S3(5, 1, 3))))
#define LIE_FOUR(label, map, u)                                                                              \
    LIE(label, WITH(.i = {map}), INPUTS(u, ANY(S3(5, 1, 3)), ANY(S3(5, 1, 3)), ANY(S3(5, 1, 3))))

/* Each w has its own row of the table, because in one tensor, results of very different size would hide
 * errors of each other. */
#define ANGLE_ROWS(w)                                                                                        \
    ROW("stumpff w = " #w, "stumpff", build_stumpff, WITH(.i = {3}),                                         \
        INPUTS(IN_VALUES((const double[]){w}, S2(1, 1)))),                                                   \
        ROW("dexpinv_coef w = " #w, "dexpinv_coef", build_dexpinv, WITH(.i = {0}),                           \
            INPUTS({.shape = S2(1, 1), .values = (const double[]){w}, .scale = 0.25}))
static const double angles[8] = {0.0, 1e-18, 1e-8, 0.1, 1.0, 9.0, 9.869604401089358, 4.0};

/* ---- the table ---- */

static const lg_gradcheck_case rows[] = {
    ROW("rowdot (4, 3)", "rowdot", build_rowdot, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("rowdot (2, 3, 5)", "rowdot", build_rowdot, INPUTS(ANY(S3(2, 3, 5)), ANY(S3(2, 3, 5)))),
    ROW("rownorm2 (4, 3)", "rowdot", build_rownorm2, INPUTS(ANY(S2(4, 3)))),
    ROW("cross (4, 3)", "cross", build_cross, INPUTS(ANY(S2(4, 3)), ANY(S2(4, 3)))),
    ROW("cross (2, 2, 3)", "cross", build_cross, INPUTS(ANY(S3(2, 2, 3)), ANY(S3(2, 2, 3)))),
    ROW("cross (3)", "cross", build_cross, INPUTS(ANY(S1(3)), ANY(S1(3)))),
    ROW("cross of x and x^2", "cross", build_cross_self, INPUTS(ANY(S2(4, 3)))),
    ROW_STOPS("spd_factor", "spd_factor", build_spd_factor, INPUTS(IN_RANGE(-0.5, 0.5, S3(3, 2, 2)))),
    ROW("centre (2, 3, 11), 2 parts", "centre", build_centre, INPUTS(ANY(S3(2, 3, 11)), ANY(S3(2, 3, 2)))),
    ROW("centre, a batch of 1", "centre", build_centre, INPUTS(ANY(S3(1, 3, 9)), ANY(S3(2, 3, 1)))),
    ROW("centre, factors of 1", "centre", build_centre, INPUTS(ANY(S3(2, 1, 5)), ANY(S3(1, 1, 2)))),
    ROW("covariance (2, 3, 11), 3 parts", "covariance", build_covariance, WITH(.i = {3}),
        INPUTS(ANY(S3(2, 3, 11)))),
    ROW("covariance of two", "covariance", build_covariance, WITH(.i = {2, 1}),
        INPUTS(ANY(S3(2, 3, 9)), ANY(S3(2, 3, 9)))),
    ROW("covariance of two, a batch of 1", "covariance", build_covariance, WITH(.i = {1, 1}),
        INPUTS(ANY(S3(1, 3, 9)), ANY(S3(2, 3, 9)))),
    ROW("covariance_root (2, 3, 5)", "covariance_root", build_covariance_root, INPUTS(ANY(S3(2, 3, 5)))),
    ROW("covariance_root (1, 2, 200)", "covariance_root", build_covariance_root, INPUTS(ANY(S3(1, 2, 200)))),
    ROW("covariance_root (1, 1, 3)", "covariance_root", build_covariance_root, INPUTS(ANY(S3(1, 1, 3)))),
    ROW("lyapunov (2, 3, 3)", "lyapunov", build_lyapunov,
        INPUTS(IN_RANGE(-0.5, 0.5, S3(2, 3, 3)), ANY(S3(2, 3, 3)))),
    ROW_STOPS("rocket (2, 2, 9)", "rocket", build_rocket, INPUTS(ANY(S3(2, 2, 9)))),
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
};
FAMILY(geometry)

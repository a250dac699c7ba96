/* SO(3) and SE(3): group axioms, generators, logarithms, duals; dexp and dexpinv against series, matrix
 * functions and each other. */
#include "test_support.h"

#include "integrators/matrix_function.h"

#include "liegrad/core.h"
#include "liegrad/geometry.h"
#include "liegrad/integrators.h"

#define PI 3.14159265358979323846

static void random_vector(lg_rng *rng, int n, double *x) {
    for (int i = 0; i < n; i++) x[i] = lg_rng_uniform_in(rng, -1.0, 1.0);
}

/* A random element a = (u, v) with |u| = angle and, in general, rho = u.v != 0. */
static void random_algebra(lg_rng *rng, double angle, double *a) {
    random_vector(rng, 6, a);
    const double norm = sqrt(lg_dot3(a, a));
    for (int i = 0; i < 3; i++) a[i] *= angle / norm;
}

static void assert_same(const double *x, const double *e, int n, double tolerance) {
    assert_all_close(x, e, (size_t)n, 0.0, tolerance);
}

/* ---- comparison with matrix functions for both groups ---- */

static void so3_bracket(const double *a, const double *b, double *out) {
    lg_cross3(a, b, out);
}

static void se3_bracket(const double *a, const double *b, double *out) {
    lg_se3_bracket(a, b, out);
}

static void so3_adjoint_of_exp(const double *a, const double *b, double *out) {
    double R[9];
    lg_so3_exp(a, R);
    lg_so3_adjoint(R, b, out);
}

static void so3_coadjoint_of_exp(const double *a, const double *mu, double *out) {
    double R[9];
    lg_so3_exp(a, R);
    lg_so3_coadjoint(R, mu, out);
}

typedef void (*map)(const double *, const double *, double *);

/* One row per group. Every function takes an algebra element and a vector. */
static const struct group {
    const char *name;
    int n;
    map bracket, dexp, dexpinv, adjoint, coadjoint; /* the last two may be NULL: the library has none */
} groups[] = {
    {"SO(3)", 3, so3_bracket, lg_so3_dexp, lg_so3_dexpinv, so3_adjoint_of_exp, so3_coadjoint_of_exp},
    {"SE(3)", 6, se3_bracket, lg_se3_dexp, lg_se3_dexpinv, NULL, NULL},
};
#define GROUPS (sizeof(groups) / sizeof(groups[0]))

static const double wide_angles[] = {0.0, 1e-9, 1e-4, 1.0, 2.9, 3.0, PI - 1e-9, PI, 4.5, 2.0 * PI - 1e-3};
#define WIDE_ANGLES (sizeof(wide_angles) / sizeof(wide_angles[0]))

/* dexp must be phi(ad), dexpinv its inverse from both sides, Ad of exp(a) must be exp(ad), and its dual the
 * transpose. The condition of dexpinv grows near its pole like 1/(2 pi - |u|), and like the square for the
 * translation. */
static void check_group(const struct group *g, const double *a, double condition) {
    const matrix ad = matrix_of_bracket(g->n, g->bracket, a);
    matrix exponential, phi;
    matrix_functions(&ad, &exponential, &phi);
    for (int j = 0; j < g->n; j++) {
        double unit[6] = {0}, e[6], x[6];
        unit[j] = 1.0;
        matrix_apply(&phi, 0, unit, e);
        g->dexp(a, unit, x);
        assert_same(x, e, g->n, 2e-14);
        g->dexpinv(a, e, x);
        assert_same(x, unit, g->n, 2e-14 * condition);
        g->dexpinv(a, e, e); /* out may be the input */
        assert_same(e, x, g->n, 0.0);
        g->dexpinv(a, unit, e);
        matrix_apply(&phi, 0, e, x);
        assert_same(x, unit, g->n, 2e-14 * condition);
        if (g->adjoint == NULL) continue;
        matrix_apply(&exponential, 0, unit, e);
        g->adjoint(a, unit, x);
        assert_same(x, e, g->n, 2e-14);
        matrix_apply(&exponential, 1, unit, e);
        g->coadjoint(a, unit, x);
        assert_same(x, e, g->n, 2e-14);
    }
}

TEST("dexp, dexpinv and Ad are matrix functions of ad") {
    lg_rng rng = test_rng(9, 0);
    for (size_t k = 0; k < GROUPS; k++)
        for (size_t n = 0; n < WIDE_ANGLES; n++)
            for (int repeat = 0; repeat < 5; repeat++) {
                const double distance = 2.0 * PI - wide_angles[n];
                double a[6];
                random_algebra(&rng, wide_angles[n], a);
                check_group(&groups[k], a, distance < 1.0 ? 1.0 / (distance * distance) : 1.0);
            }
}

TEST("exp and its action agree with the matrix exponential") {
    lg_rng rng = test_rng(11, 0);
    for (size_t n = 0; n < WIDE_ANGLES; n++) {
        double a[6], b[6], x[6], R[9], r[3], S[9], T[9];
        random_algebra(&rng, wide_angles[n], a);
        random_algebra(&rng, 2.0, b);
        random_vector(&rng, 6, x);
        const matrix m = matrix_of_motion(a);
        matrix e, unused;
        matrix_functions(&m, &e, &unused);
        lg_se3_exp(a, R, r);
        for (int i = 0; i < 3; i++) {
            assert_close(r[i], (double)e.at[i][3], 0.0, 5e-15);
            for (int j = 0; j < 3; j++) assert_close(R[3 * i + j], (double)e.at[i][j], 0.0, 5e-15);
        }
        double turned[3], acted[6], plain[3]; /* the action of (R, r) on (q, p), also in place */
        for (int i = 0; i < 3; i++) turned[i] = lg_dot3(R + 3 * i, x);
        lg_cross3(r, turned, plain);
        memcpy(acted, x, sizeof(acted));
        lg_se3_exp_act(a, acted, acted);
        assert_same(acted, turned, 3, 8e-15);
        for (int i = 0; i < 3; i++)
            assert_close(acted[3 + i], lg_dot3(R + 3 * i, x + 3) + plain[i], 0.0, 8e-15);
        lg_so3_exp_act(a, x, plain);
        assert_same(plain, turned, 3, 8e-15);
        memcpy(T, R, sizeof T);
        lg_so3_exp_multiply(a, R, S);
        lg_so3_exp_multiply(a, T, T); /* out may be the input */
        assert_same(T, S, 9, 0.0);
        for (int i = 0; i < 9; i++) {
            const double column[3] = {R[i % 3], R[3 + i % 3], R[6 + i % 3]};
            assert_close(S[i], lg_dot3(R + 3 * (i / 3), column), 0.0, 5e-15);
        }
    }
}

/* ---- logarithms ---- */

TEST("log is the inverse of exp, also near 0 and near pi") {
    const double some[] = {0.0, 1e-300, 1e-160, 1e-12, 1e-9, 1e-4, 0.1, 1.0, 2.0, 3.0, PI - 1e-4, PI - 1e-9};
    lg_rng rng = test_rng(12, 0);
    for (size_t n = 0; n < sizeof(some) / sizeof(some[0]); n++)
        for (int repeat = 0; repeat < 20; repeat++) {
            double a[6], x[6], R[9], r[3];
            random_algebra(&rng, some[n], a);
            lg_se3_exp(a, R, r);
            lg_so3_log(R, x);
            assert_same(x, a, 3, 3e-15);
            if (some[n] < 1e-8) assert_all_close(x, a, 3, 1e-15, 0.0); /* no digits are lost near 0 */
            lg_se3_log(R, r, x);
            assert_same(x, a, 6, 2e-14);
        }
}

TEST("beyond pi the logarithm differs from the argument, but its exponential is the same") {
    lg_rng rng = test_rng(13, 0);
    for (size_t n = 0; n < WIDE_ANGLES; n++)
        for (int repeat = 0; repeat < 20; repeat++) {
            double a[6], x[6], R[9], r[3], S[9], s[3];
            random_algebra(&rng, wide_angles[n], a);
            lg_se3_exp(a, R, r);
            lg_se3_log(R, r, x);
            assert_true(sqrt(lg_dot3(x, x)) <= PI * (1.0 + 1e-15));
            lg_se3_exp(x, S, s);
            assert_same(S, R, 9, 1e-14);
            assert_same(s, r, 3, 1e-14);
        }
}

TEST("log at angle pi has a positive largest entry") {
    static const struct {
        double axis[3], expected[3];
    } turns[] = {
        {{0.6, 0.0, -0.8}, {-0.6, 0.0, 0.8}},
        {{-0.6, 0.0, 0.8}, {-0.6, 0.0, 0.8}},
        {{0.0, -1.0, 0.0}, {0.0, 1.0, 0.0}},
        {{-0.5, 0.5, -0.70710678118654752}, {0.5, -0.5, 0.70710678118654752}},
        {{-0.70710678118654752, 0.70710678118654752, 0.0}, {0.70710678118654752, -0.70710678118654752, 0.0}},
    };
    for (size_t n = 0; n < sizeof(turns) / sizeof(turns[0]); n++) {
        const double *axis = turns[n].axis;
        double R[9], u[3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) R[3 * i + j] = 2.0 * axis[i] * axis[j] - (i == j ? 1.0 : 0.0);
        lg_so3_log(R, u);
        for (int i = 0; i < 3; i++) assert_close(u[i], PI * turns[n].expected[i], 0.0, 2e-15);
    }
}

TEST("log of an approximate rotation has an error of the size of the approximation error") {
    lg_rng rng = test_rng(14, 0);
    for (size_t n = 0; n < WIDE_ANGLES; n++)
        for (int repeat = 0; repeat < 50; repeat++) {
            const double size = repeat % 2 == 0 ? 4e-16 : 1e-9;
            double a[6], R[9], S[9], u[3];
            random_algebra(&rng, wide_angles[n], a);
            lg_so3_exp(a, R);
            for (int i = 0; i < 9; i++) R[i] += lg_rng_uniform_in(&rng, -size, size);
            lg_so3_log(R, u);
            lg_so3_exp(u, S);
            assert_same(S, R, 9, 8.0 * size + 2e-14);
        }
    for (int i = 0; i < 9; i++) {
        double R[9], u[3];
        lg_so3_exp((double[3]){0.1, 2.0, 0.3}, R);
        R[i] = NAN;
        lg_so3_log(R, u);
        for (int j = 0; j < 3; j++) assert_true(isnan(u[j]));
    }
}

TEST("an exponential is a rotation at every angle, even if the angle is too large to have digits modulo "
     "2 pi") {
    static const double angles[] = {1e-310, 1e-9, 1.0, 3.7, 1e3, 1e8, 1e13, 1e14, 1e15, 1e16, 1e30, 1e100};
    for (size_t k = 0; k < LG_COUNT(angles); k++) {
        const double u[3] = {0.48 * angles[k], -0.64 * angles[k], 0.6 * angles[k]};
        double R[9];
        lg_so3_exp(u, R);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                assert_close(lg_dot3(R + 3 * i, R + 3 * j), i == j ? 1.0 : 0.0, 0.0, 4e-15);
    }
}

TEST("the projection of a matrix is its polar factor") {
    lg_rng rng = test_rng(15, 0);
    for (int repeat = 0; repeat < 50; repeat++) {
        /* The polar factor of R S, with S symmetric and positive definite, is R. */
        double a[6], R[9], S[9], X[9], s[6];
        random_algebra(&rng, 3.0, a);
        lg_so3_exp(a, R);
        random_vector(&rng, 6, s);
        for (int i = 0; i < 6; i++) s[i] *= repeat % 2 == 0 ? 1e-13 : 0.3;
        const double symmetric[9] = {1.0 + s[0], s[3], s[4], s[3], 1.0 + s[1], s[5], s[4], s[5], 1.0 + s[2]};
        memcpy(S, symmetric, sizeof(S));
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) X[3 * i + j] = lg_dot3(R + 3 * i, S + 3 * j);
        static const double scales[] = {1.0, 1e100, 1e-100, 1e-290, 1e290};
        for (int k = 0; k < 5; k++) {
            double scaled[9];
            for (int i = 0; i < 9; i++) scaled[i] = X[i] * scales[k];
            lg_so3_project(scaled);
            assert_same(scaled, R, 9, 2e-15);
        }
    }
    double reflection[9] = {1, 0, 0, 0, 1, 0, 0, 0, -1}, zero[9] = {0};
    lg_so3_project(reflection);
    lg_so3_project(zero);
    for (int i = 0; i < 9; i++) assert_true(isnan(reflection[i]) && isnan(zero[i]));
}

/* A = U diag(values) V^T with random rotations U and V, or the diagonal matrix; `polar` gets its polar factor
 * U V^T. */
static void draw_matrix(lg_rng *rng, bool turned, const double values[3], double A[9], double polar[9]) {
    static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    double a[6], U[9], V[9], weighted[9];
    memcpy(U, identity, sizeof U);
    memcpy(V, identity, sizeof V);
    if (turned) {
        random_algebra(rng, 3.0, a);
        lg_so3_exp(a, U);
        lg_so3_exp(a + 3, V);
    }
    for (int i = 0; i < 9; i++) weighted[i] = U[i] * values[i % 3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            A[3 * i + j] = lg_dot3(weighted + 3 * i, V + 3 * j);
            polar[3 * i + j] = lg_dot3(U + 3 * i, V + 3 * j);
        }
}

/* Rounding of the matrix turns the nearest rotation by eps/(sum of the two smallest singular values). If the
 * determinant is very small, rounding may change its sign. */
TEST("the projection of any matrix is the nearest rotation, or NaN") {
    static const double others[][2] = {{1, 1}, {1, 0.3}, {1, 0.01}, {1, 1e-5}, {1, 1e-10}, {1, 1e-17}};
    static const double least[] = {1,      0.1,    1e-3,   1e-7,   1e-10,  1e-13,  1e-15,
                                   1e-16,  1e-17,  1e-20,  1e-25,  1e-30,  1e-40,  1e-80,
                                   1e-120, 1e-160, 1e-200, 1e-280, 1e-300, 1e-310, 1e-320};
    static const double scales[] = {1, 1e100, 1e-100};
    lg_rng rng = test_rng(16, 0);
    for (size_t n = 0; n < LG_COUNT(others) * LG_COUNT(least) * LG_COUNT(scales) * 2 * 5; n++) {
        const double *other = others[n % LG_COUNT(others)], s = least[n / LG_COUNT(others) % LG_COUNT(least)];
        const size_t rest = n / LG_COUNT(others) / LG_COUNT(least);
        const double scale = scales[rest % 3], sign = rest / 3 % 2 == 0 ? 1.0 : -1.0;
        const bool turned = rest / 6 % 5 > 0;
        const double values[3] = {other[0], other[1], sign * s};
        if (s > other[1] || (scale < 1.0 && s * scale < 1e-300)) continue;
        double A[9], R[9], polar[9], lost = 0.0;
        draw_matrix(&rng, turned, values, A, polar);
        for (int i = 0; i < 9; i++) R[i] = A[i] * scale;
        lg_so3_project(R);
        for (int i = 0; i < 9; i++) lost += isnan(R[i]);
        /* rounding may change the sign of smaller determinants */
        const double known = turned ? 1e-14 : 1e-300;
        const double gap = other[1] + s, error = 2e-15 / fmin(1.0, turned ? gap : 1.0);
        if (sign < 0 && s * other[1] > known) assert_true(lost == 9);
        if (sign > 0 && s * other[1] > known && gap > 1e-12) assert_true(lost == 0);
        if (gap < 1e-14) assert_true(lost == 9);
        if (lost > 0) {
            assert_true(lost == 9);
            continue;
        }
        if (sign * s > -known) assert_same(R, polar, 9, error);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                assert_close(lg_dot3(R + 3 * i, R + 3 * j), i == j ? 1.0 : 0.0, 0.0, 1e-15);
    }
}

TEST("invalid spaces are refused") {
    lg_space space = {.dim = 77};
    const lg_space_factor zero = {LG_SPACE_TS2, 0}, unknown = {LG_SPACE_KINDS, 1},
                          huge = {LG_SPACE_RN, SIZE_MAX}, large = {LG_SPACE_SE3, SIZE_MAX / 2};
    const lg_space_factor many[LG_SPACE_MAX_FACTORS + 1] = {{LG_SPACE_RN, 1}};
    assert_status(lg_space_init(&space, &zero, 1), LG_INVALID_ARGUMENT);
    assert_status(lg_space_init(&space, &unknown, 1), LG_INVALID_ARGUMENT);
    assert_status(lg_space_init(&space, &huge, 1), LG_INVALID_ARGUMENT);
    assert_status(lg_space_init(&space, &large, 1), LG_INVALID_ARGUMENT);
    assert_status(lg_space_init(&space, many, LG_SPACE_MAX_FACTORS + 1), LG_INVALID_ARGUMENT);
    assert_status(lg_space_init(&space, &zero, 0), LG_INVALID_ARGUMENT);
    assert_status(lg_space_init_rn(&space, 0), LG_INVALID_ARGUMENT);
    assert_true(space.dim == 77);
    assert_null(lg_space_kind_entry(LG_SPACE_KINDS));
}

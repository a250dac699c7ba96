/* The kernels of both types, for every instruction set of this machine. */
#include "kernels/kernel_tables.h"

#include <float.h>

#include "kernels/kernels.h"
#include "kernels/stumpff.h"
#include "golden/stumpff_table.h"
#include "liegrad/core.h"
#include "liegrad/geometry.h"

enum { MAX_N = 4096 };

static const char *const type_names[2] = {"f64", "f32"};

static double get(const lg_kernels *k, const void *x, size_t i) {
    return k->dtype == LG_F64 ? ((const double *)x)[i] : (double)((const float *)x)[i];
}

static void set(const lg_kernels *k, void *x, size_t i, double value) {
    if (k->dtype == LG_F64)
        ((double *)x)[i] = value;
    else
        ((float *)x)[i] = (float)value;
}

static const void *at(const lg_kernels *k, const void *x, size_t i) {
    return (const char *)x + i * k->size;
}

static void *at_mutable(const lg_kernels *k, void *x, size_t i) {
    return (char *)x + i * k->size;
}

static double epsilon(const lg_kernels *k) {
    return k->dtype == LG_F64 ? DBL_EPSILON : (double)FLT_EPSILON;
}

/* Memory for exactly n elements, so that a sanitizer sees accesses beyond the end. */
static void *numbers(const lg_kernels *k, size_t n) {
    return lg_test_memory(n * k->size);
}

static void *random_numbers(const lg_kernels *k, lg_rng *rng, size_t n, double low, double high) {
    void *x = numbers(k, n);
    for (size_t i = 0; i < n; i++) set(k, x, i, lg_rng_uniform_in(rng, low, high));
    return x;
}

TEST("every table states its type and instruction set, and the one in use exists") {
    for (int dtype = 0; dtype < 2; dtype++) {
        const lg_kernels *k = lg_kernels_for((lg_dtype)dtype);
        assert_non_null(k);
        assert_int_equal(k->isa, lg_isa_in_use());
        assert_ptr_equal(k, lg_kernels_of((lg_dtype)dtype, lg_isa_in_use()));
        assert_non_null(lg_kernels_of((lg_dtype)dtype, LG_ISA_BASELINE));
        for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
            k = lg_kernels_of((lg_dtype)dtype, (lg_isa)isa);
            if (k == NULL) continue;
            assert_int_equal(k->dtype, dtype);
            assert_int_equal(k->isa, isa);
            assert_int_equal(k->size, dtype == 0 ? sizeof(double) : sizeof(float));
        }
    }
}

/* ---- accuracy of elementary functions ---- */

/* Distance in units in the last place of the type, or in units of `least` if that is larger; 0 for equal
 * infinities and for two NaN. */
static double ulp_error(const lg_kernels *k, double got, long double exact, double least) {
    if (isnan(exact) || isnan(got)) return isnan(exact) && isnan(got) ? 0 : 1e30;
    const double e = k->dtype == LG_F64 ? (double)exact : (double)(float)exact;
    if (isinf(e) || isinf(got)) return got == e ? 0 : 1e30;
    if (exact == 0) return got == 0 && !signbit(got) == !signbit(e) ? 0 : 1e30;
    const double unit = k->dtype == LG_F64 ? nextafter(fabs(e), INFINITY) - fabs(e)
                                           : (double)(nextafterf((float)fabs(e), INFINITY) - (float)fabs(e));
    return (double)(fabsl((long double)got - exact) / (long double)fmax(unit, least));
}

static long double sigmoid_exact(long double x) {
    return x >= 0 ? 1 / (1 + expl(-x)) : expl(x) / (1 + expl(x));
}

static long double swish_exact(long double x) {
    return isinf(x) && x < 0 ? -0.0L : x * sigmoid_exact(x);
}

enum { CALL_UNARY, CALL_ACT };

static const struct {
    const char *name;
    int call, number;
    long double (*exact)(long double);
    double low, high; /* range for dense points */
    double bound;     /* units in the last place */
} functions[] = {
    {"exp", CALL_UNARY, LG_K_EXP, expl, -110, 100, 3},
    {"exp wide", CALL_UNARY, LG_K_EXP, expl, -750, 715, 3},
    {"log", CALL_UNARY, LG_K_LOG, logl, 0, 3, 3},
    {"log near 1", CALL_UNARY, LG_K_LOG, logl, 0.99, 1.01, 3},
    {"sin", CALL_UNARY, LG_K_SIN, sinl, -20, 20, 3},
    {"sin far", CALL_UNARY, LG_K_SIN, sinl, -1.1e6, 1.1e6, 3},
    {"cos", CALL_UNARY, LG_K_COS, cosl, -20, 20, 3},
    {"cos far", CALL_UNARY, LG_K_COS, cosl, -1.1e6, 1.1e6, 3},
    {"sqrt", CALL_UNARY, LG_K_SQRT, sqrtl, 0, 10, 0.5},
    {"tanh", CALL_ACT, LG_K_TANH, tanhl, -20, 20, 3},
    {"tanh near 0", CALL_ACT, LG_K_TANH, tanhl, -1, 1, 3},
    {"sigmoid", CALL_ACT, LG_K_SIGMOID, sigmoid_exact, -40, 40, 3},
    {"sigmoid wide", CALL_ACT, LG_K_SIGMOID, sigmoid_exact, -750, 100, 3},
    {"swish", CALL_ACT, LG_K_SWISH, swish_exact, -40, 40, 3},
    {"sine", CALL_ACT, LG_K_SINE, sinl, -20, 20, 3},
};

static void call_function(const lg_kernels *k, size_t f, size_t n, const void *x, void *y) {
    if (functions[f].call == CALL_UNARY)
        k->unary[functions[f].number](n, 0, x, y);
    else
        k->act((lg_k_act)functions[f].number, 0, n, x, NULL, NULL, y);
}

/* Zeros, denormals, ends of ranges, infinities, NaN, multiples of pi/2 and their neighbours. */
static size_t special_values(const lg_kernels *k, void *x) {
    static const double values[] = {
        0.0,   1.0,     0.5,     2.0,     1e-300,  4.9e-324, 1e-40,    1e-45,     1e-5,
        1e-10, 20.0,    50.0,    88.7,    88.8,    103.9,    104.1,    709.7,     709.8,
        745.1, 745.2,   746.0,   1e3,     1e5,     1e6,      1e10,     1e22,      1e38,
        1e300, DBL_MAX, FLT_MAX, FLT_MIN, DBL_MIN, INFINITY, 999999.9, 1000001.0, 1.1754942e-38};
    static const double roots[] = {0.34657359027997264, 0.70710678118654746, 0.70710678118654757,
                                   1.4142135623730951};
    size_t n = 0;
    for (size_t i = 0; i < LG_COUNT(values); i++)
        for (int sign = -1; sign <= 1; sign += 2) set(k, x, n++, sign * values[i]);
    for (size_t i = 0; i < LG_COUNT(roots); i++)
        for (int sign = -1; sign <= 1; sign += 2) set(k, x, n++, sign * roots[i]);
    for (int i = 1; i < 400; i += i < 20 ? 1 : 37) set(k, x, n++, i * 1.5707963267948966);
    set(k, x, n++, NAN);
    return n;
}

TEST_EVERY_TABLE("functions are accurate to a few units in the last place", k) {
    lg_rng rng = test_rng(1, 0);
    void *x = numbers(k, MAX_N), *y = numbers(k, MAX_N);
    for (size_t f = 0; f < LG_COUNT(functions); f++) {
        double worst = 0;
        for (int round = 0; round < 60; round++) {
            size_t n = MAX_N;
            if (round == 0)
                n = special_values(k, x);
            else
                for (size_t i = 0; i < n; i++)
                    set(k, x, i,
                        round % 6 == 1 ? ldexp(lg_rng_uniform_in(&rng, -1, 1), -(int)lg_rng_below(&rng, 60))
                                       : lg_rng_uniform_in(&rng, functions[f].low, functions[f].high));
            call_function(k, f, n, x, y);
            for (size_t i = 0; i < n; i++) {
                const double v = get(k, x, i);
                /* In x sigmoid(x) with a denormal sigmoid(x) the product amplifies the error of its last
                 * place. */
                const double least = functions[f].exact == swish_exact && !isinf(v)
                                         ? fabs(v) * (k->dtype == LG_F64 ? 0x1p-1074 : 0x1p-149)
                                         : 0;
                const double error = ulp_error(k, get(k, y, i), functions[f].exact((long double)v), least);
                if (!(error <= functions[f].bound))
                    fail_msg("%s %s %s(%.17g) = %.17g: %.3g units from %.21Lg", type_names[k->dtype],
                             lg_isa_name(k->isa), functions[f].name, v, get(k, y, i), error,
                             functions[f].exact((long double)v));
                if (error > worst) worst = error;
            }
        }
        print_message("%s %-8s %-12s %.2f ulp\n", type_names[k->dtype], lg_isa_name(k->isa),
                      functions[f].name, worst);
    }
}

/* ---- results do not depend on position ---- */

enum { POSITION_N = 37 };

/* Fails unless the bits are equal; sign and payload of a NaN are not compared. */
static void assert_same(const lg_kernels *k, const char *name, const void *whole, size_t i, const void *alone,
                        size_t width) {
    bool same = true;
    for (size_t j = 0; j < width; j++)
        same &= memcmp(at(k, whole, i * width + j), at(k, alone, j), k->size) == 0 ||
                (isnan(get(k, whole, i * width + j)) && isnan(get(k, alone, j)));
    if (!same)
        fail_msg("%s %s %s: element %zu is %.17g in an array, %.17g alone", type_names[k->dtype],
                 lg_isa_name(k->isa), name, i, get(k, whole, i * width), get(k, alone, 0));
}

/* Evaluates the last argument for each i; it computes element i alone, which must have the same bits as in
 * y. */
#define ALONE(name, width, ...)                                                                              \
    for (size_t i = 0; i < N; i++) {                                                                         \
        __VA_ARGS__;                                                                                         \
        assert_same(k, name, y, i, one, width);                                                              \
    }

TEST_EVERY_TABLE("the bits of an element do not depend on its position in an array", k) {
    enum { N = POSITION_N };
    lg_rng rng = test_rng(2, 0);
    void *special = numbers(k, 256), *x = numbers(k, N), *g = random_numbers(k, &rng, N, -2, 2),
         *h = numbers(k, N), *y = numbers(k, 9 * N), *one = numbers(k, 9);
    const size_t specials = special_values(k, special);
    for (int round = 0; round < 20; round++) {
        const double c = round % 2 == 0 ? 1.37 : 3;
        for (size_t i = 0; i < N; i++)
            set(k, x, i,
                lg_rng_below(&rng, 4) == 0 ? get(k, special, lg_rng_below(&rng, specials))
                                           : lg_rng_normal(&rng) * (round + 1));
        for (int f = 0; f < LG_K_UNARIES; f++) {
            k->unary[f](N, c, x, y);
            ALONE("unary", 1, k->unary[f](1, c, at(k, x, i), one))
            memcpy(y, x, N * k->size);
            k->unary[f](N, c, y, y);
            ALONE("unary in place", 1, k->unary[f](1, c, at(k, x, i), one))
        }
        for (int f = 0; f < LG_K_BINARIES; f++) {
            k->binary[f](N, x, g, y);
            ALONE("binary", 1, k->binary[f](1, at(k, x, i), at(k, g, i), one))
        }
        for (int kind = 0; kind < LG_K_ACTS; kind++) {
            const bool helped = kind == LG_K_TANH || kind == LG_K_SIGMOID || kind == LG_K_SWISH;
            k->act(kind == LG_K_TANH ? LG_K_TANH : LG_K_SIGMOID, 0, N, x, NULL, NULL, h);
            for (int order = 0; order <= LG_K_ACT_ORDERS; order++)
                for (int variant = 0; variant < 4; variant++) {
                    const bool with_h = variant & 1, with_g = variant & 2;
                    if (with_h && !helped) continue;
                    k->act((lg_k_act)kind, order, N, x, with_h ? h : NULL, with_g ? g : NULL, y);
                    ALONE("act", 1,
                          k->act((lg_k_act)kind, order, 1, at(k, x, i), with_h ? at(k, h, i) : NULL,
                                 with_g ? at(k, g, i) : NULL, one))
                }
            memcpy(y, x, N * k->size);
            k->bias_act((lg_k_act)kind, 1, N, g, y);
            ALONE("bias_act", 1, memcpy(one, at(k, x, i), k->size);
                  k->bias_act((lg_k_act)kind, 1, 1, at(k, g, i), one))
        }
        for (int order = 0; order < 4; order++) {
            k->stumpff(N, 3, order, x, y);
            ALONE("stumpff", 4, k->stumpff(1, 3, order, at(k, x, i), one))
            k->dexpinv_coef(N, order, x, y);
            ALONE("dexpinv_coef", 1, k->dexpinv_coef(1, order, at(k, x, i), one))
        }
    }
}

/* ---- elementwise ---- */

TEST_EVERY_TABLE("elementwise functions have the right values, also at kinks and for NaN", k) {
    const double a[] = {1, -2, 3, NAN, 0.5, 5}, b[] = {2, -2, 1, 1, NAN, 5};
    static const double max[] = {2, -2, 3, NAN, NAN, 5}, ge[] = {0, 1, 1, 0, 0, 1},
                        sub[] = {-1, 0, 2, NAN, NAN, 0};
    void *x = numbers(k, 6), *y = numbers(k, 6), *z = numbers(k, 6);
    k->convert_in(6, a, x);
    k->convert_in(6, b, y);
    const double *const expected[] = {[LG_K_MAX] = max, [LG_K_GE] = ge, [LG_K_SUB] = sub};
    for (size_t op = 0; op < LG_COUNT(expected); op++) {
        if (expected[op] == NULL) continue;
        k->binary[op](6, x, y, z);
        for (size_t i = 0; i < 6; i++)
            assert_true(get(k, z, i) == expected[op][i] || (isnan(expected[op][i]) && isnan(get(k, z, i))));
    }
    static const struct {
        lg_k_unary op;
        double c, x, y;
    } unary[] = {{LG_K_SCALE, 3, 2, 6},     {LG_K_SHIFT, 3, 2, 5},   {LG_K_POW, 2, -3, 9},
                 {LG_K_POW, 3, -2, -8},     {LG_K_POW, -1, 4, 0.25}, {LG_K_POW, 4, -2, 16},
                 {LG_K_POW, 0.5, 9, 3},     {LG_K_POW, 0, 7, 1},     {LG_K_POW, 1, 7, 7},
                 {LG_K_POW, -2, 4, 0.0625}, {LG_K_ABS, 0, -3, 3},    {LG_K_SIGN, 0, -3, -1},
                 {LG_K_SIGN, 0, 0, 1},      {LG_K_SIGN, 0, 3, 1},    {LG_K_RECIPROCAL, 0, 8, 0.125},
                 {LG_K_SQRT, 0, 16, 4}};
    for (size_t c = 0; c < LG_COUNT(unary); c++) {
        set(k, x, 0, unary[c].x);
        k->unary[unary[c].op](1, unary[c].c, x, y);
        assert_close(get(k, y, 0), unary[c].y, 0, 0);
    }
    set(k, x, 0, NAN);
    k->unary[LG_K_SIGN](1, 0, x, y);
    assert_true(isnan(get(k, y, 0)));
    set(k, x, 0, 4);
    set(k, y, 0, 1);
    k->axpy(1, 0.5, x, y);
    assert_close(get(k, y, 0), 3, 0, 0);
    k->combine(1, 0.5, x, -2, x, 3, y);
    assert_close(get(k, y, 0), 3, 0, 0);
    k->fill(6, -1.5, z);
    for (size_t i = 0; i < 6; i++) assert_close(get(k, z, i), -1.5, 0, 0);
    for (size_t n = 0; n < 70; n++) {
        void *v = numbers(k, n);
        assert_true(k->all_finite(n, v));
        for (size_t i = 0; i < n; i++) {
            static const double bad[] = {NAN, INFINITY, -INFINITY};
            set(k, v, i, bad[(n + i) % 3]);
            assert_false(k->all_finite(n, v));
            set(k, v, i, k->dtype == LG_F64 ? -DBL_MAX : (double)FLT_MAX);
        }
        assert_true(k->all_finite(n, v));
    }
}

TEST_EVERY_TABLE("strided operations agree with contiguous ones", k) {
    lg_rng rng = test_rng(3, 0);
    for (size_t rows = 1; rows < 20; rows += 3)
        for (size_t cols = 1; cols < 24; cols += cols < 4 ? 1 : 5)
            for (unsigned pattern = 0; pattern < 16; pattern++) {
                const size_t ra = pattern & 1 ? cols : 0, ca = pattern >> 1 & 1,
                             rb = pattern >> 2 & 1 ? cols + 1 : 0, cb = pattern >> 3;
                void *a = random_numbers(k, &rng, rows * (cols + 1), 1, 2),
                     *b = random_numbers(k, &rng, rows * (cols + 1), 1, 2);
                void *y = numbers(k, rows * cols), *one = numbers(k, 1);
                for (int op = 0; op < LG_K_BINARIES; op++) {
                    k->binary_strided[op](rows, cols, a, ra, ca, b, rb, cb, y);
                    for (size_t i = 0; i < rows; i++)
                        for (size_t j = 0; j < cols; j++) {
                            k->binary[op](1, at(k, a, i * ra + j * ca), at(k, b, i * rb + j * cb), one);
                            assert_close(get(k, y, i * cols + j), get(k, one, 0), 0, 0);
                        }
                }
            }
}

/* ---- activations ---- */

/* Derivatives 0..8, by Taylor series of the differential equations h' = 1 - h^2 and s' = s - s^2. */
static void exact_derivatives(lg_k_act kind, long double x, long double d[LG_K_ACT_ORDERS + 1]) {
    long double c[LG_K_ACT_ORDERS + 2], factorial = 1;
    c[0] = kind == LG_K_TANH ? tanhl(x) : sigmoid_exact(x);
    for (int n = 0; n <= LG_K_ACT_ORDERS; n++) {
        long double square = 0;
        for (int i = 0; i <= n; i++) square += c[i] * c[n - i];
        c[n + 1] = ((kind == LG_K_TANH ? (n == 0 ? 1 : 0) : c[n]) - square) / (n + 1);
    }
    for (int n = 0; n <= LG_K_ACT_ORDERS; n++) {
        factorial *= n > 1 ? n : 1;
        d[n] = factorial * (kind == LG_K_SWISH ? x * c[n] + (n > 0 ? c[n - 1] : 0) : c[n]);
    }
}

TEST_EVERY_TABLE("derivatives of activations up to order 8 are accurate", k) {
    static const double points[] = {-3.1, -1.0, -0.3, 0, 0.2, 0.9, 2.5, 6.0};
    static const lg_k_act smooth[] = {LG_K_TANH, LG_K_SIGMOID, LG_K_SWISH};
    enum { N = LG_COUNT(points) };
    void *x = numbers(k, N), *y = numbers(k, N), *h = numbers(k, N), *g = numbers(k, N);
    k->convert_in(N, points, x);
    for (size_t i = 0; i < N; i++) set(k, g, i, 2.0);
    for (size_t s = 0; s < LG_COUNT(smooth); s++) {
        k->act(smooth[s] == LG_K_SWISH ? LG_K_SIGMOID : smooth[s], 0, N, x, NULL, NULL, h);
        for (int order = 0; order <= LG_K_ACT_ORDERS; order++) {
            const double scale[] = {1, 1, 1, 2, 5, 20, 70, 300, 1500}; /* sizes of the derivatives near 0 */
            for (int variant = 0; variant < 4; variant++) {
                k->act(smooth[s], order, N, smooth[s] != LG_K_SWISH && variant & 1 ? NULL : x,
                       variant & 1 ? h : NULL, variant & 2 ? g : NULL, y);
                for (size_t i = 0; i < N; i++) {
                    long double d[LG_K_ACT_ORDERS + 1];
                    exact_derivatives(smooth[s], (long double)get(k, x, i), d);
                    assert_close(get(k, y, i), (double)d[order] * (variant & 2 ? 2 : 1), 8 * epsilon(k),
                                 8 * epsilon(k) * scale[order]);
                }
            }
        }
    }
    static const double derivative_of_sine[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}}; /* of sin and of cos */
    for (int order = 0; order <= LG_K_ACT_ORDERS; order++) {
        k->act(LG_K_SINE, order, N, x, NULL, NULL, y);
        for (size_t i = 0; i < N; i++) {
            const double v = get(k, x, i), *w = derivative_of_sine[order % 4];
            assert_close(get(k, y, i), w[0] * sin(v) + w[1] * cos(v), 4 * epsilon(k), 0);
        }
    }
    for (int order = 0; order <= 2; order++)
        for (size_t i = 0; i < N; i++) {
            const double v = get(k, x, i), relu[] = {v > 0 ? v : 0, v > 0, 0},
                         leaky[] = {v > 0 ? v : LG_LEAKY_SLOPE * v, v > 0 ? 1 : LG_LEAKY_SLOPE, 0},
                         identity[] = {v, 1, 0};
            static const lg_k_act kinds[] = {LG_K_RELU, LG_K_LEAKY_RELU, LG_K_IDENTITY};
            const double *expected[] = {relu, leaky, identity};
            for (size_t s = 0; s < 3; s++) {
                k->act(kinds[s], order, N, x, NULL, NULL, y);
                assert_close(get(k, y, i), expected[s][order], 2 * epsilon(k), 0);
                k->act(kinds[s], order, N, x, NULL, g, y);
                assert_close(get(k, y, i), 2 * expected[s][order], 2 * epsilon(k), 0);
                if (kinds[s] == LG_K_IDENTITY) continue;
                k->act(kinds[s], 0, N, x, NULL, NULL, h);
                k->act(kinds[s], order, N, NULL, h, g, y);
                assert_close(get(k, y, i), 2 * expected[s][order], 2 * epsilon(k), 0);
            }
        }
}

/* tanh^(n) = (1 - h^2) Q_n(h), with Q_1 = 1 and Q_(n+1) = -2 h Q_n + (1 - h^2) Q_n', whose coefficients are
 * integers. Hence d tanh^(n)/dh = Q_(n+1). */
static long double tanh_polynomial(int n, long double h) {
    long double q[LG_K_ACT_ORDERS + 3] = {1}, y = 0;
    for (int m = 1; m < n; m++) {
        long double next[LG_K_ACT_ORDERS + 3] = {0};
        for (int i = 0; i < m; i++) {
            next[i + 1] -= (i + 2) * q[i];
            if (i > 0) next[i - 1] += i * q[i];
        }
        memcpy(q, next, sizeof q);
    }
    for (int i = n; i-- > 0;) y = y * h + q[i];
    return y;
}

/* A derivative y computed from the stored value h, and its size |y| + |h dy/dh|. */
typedef struct conditioned {
    long double y, size;
} conditioned;

static conditioned of_tanh(int n, long double h) {
    if (n == 0) return (conditioned){h, fabsl(h)};
    const long double y = (1 - h) * (1 + h) * tanh_polynomial(n, h);
    return (conditioned){y, fabsl(y) + fabsl(h * tanh_polynomial(n + 1, h))};
}

/* sigmoid(x) = (1 + tanh(x/2))/2. */
static conditioned of_sigmoid(int n, long double s) {
    if (n == 0) return (conditioned){s, fabsl(s)};
    const long double y = s * (1 - s) * ldexpl(tanh_polynomial(n, 2 * s - 1), 1 - n);
    return (conditioned){y, fabsl(y) + fabsl(s * ldexpl(tanh_polynomial(n + 1, 2 * s - 1), -n))};
}

static conditioned of_activation(lg_k_act kind, int n, long double x, long double h) {
    if (kind == LG_K_TANH) return of_tanh(n, h);
    const conditioned a = of_sigmoid(n, h);
    if (kind == LG_K_SIGMOID) return a;
    const conditioned b = n > 0 ? of_sigmoid(n - 1, h) : (conditioned){0, 0};
    return (conditioned){x * a.y + n * b.y, fabsl(x) * a.size + n * b.size};
}

TEST_EVERY_TABLE("derivatives from a stored value are as accurate as the stored value allows", k) {
    enum { N = 1000 };
    static const lg_k_act smooth[] = {LG_K_TANH, LG_K_SIGMOID, LG_K_SWISH};
    void *x = numbers(k, N), *y = numbers(k, N), *h = numbers(k, N);
    lg_rng rng = test_rng(11, 1);
    for (size_t kind = 0; kind < LG_COUNT(smooth); kind++)
        for (int order = 0; order <= LG_K_ACT_ORDERS; order++) {
            for (size_t i = 0; i < N; i++) {
                const double near = pow(10.0, lg_rng_uniform_in(&rng, -10.0, 0.0));
                const double s = i % 4 == 0 ? near : i % 4 == 1 ? 1 - near : lg_rng_uniform(&rng);
                set(k, h, i, smooth[kind] == LG_K_TANH ? 2 * s - 1 : s);
                set(k, x, i, lg_rng_uniform_in(&rng, -4.0, 4.0));
            }
            k->act(smooth[kind], order, N, x, h, NULL, y);
            for (size_t i = 0; i < N; i++) {
                const conditioned want =
                    of_activation(smooth[kind], order, (long double)get(k, x, i), (long double)get(k, h, i));
                const long double off = fabsl((long double)get(k, y, i) - want.y);
                if (!(off <= 4 * (long double)epsilon(k) * want.size))
                    fail_msg("kind %d, order %d at %.17g: off by %.3Lg units", (int)smooth[kind], order,
                             get(k, h, i), off / ((long double)epsilon(k) * want.size));
            }
        }
}

TEST_EVERY_TABLE(
    "act_reverse has the bits of its passes one by one: dq [+]= c s^(order), dx [+]= (c q) s^(order + 1)",
    k) {
    lg_rng rng = test_rng(14, 0);
    static const size_t sizes[] = {1, 7, 256, 300, 1000};
    static const lg_k_act kinds[] = {LG_K_TANH, LG_K_SIGMOID, LG_K_SWISH, LG_K_LEAKY_RELU, LG_K_SINE};
    for (size_t i = 0; i < LG_COUNT(sizes) * LG_COUNT(kinds) * 64; i++) {
        const size_t n = sizes[i / 64 % LG_COUNT(sizes)];
        const lg_k_act kind = kinds[i / 64 / LG_COUNT(sizes)];
        const int order = (int)(i & 1);
        const bool add_q = i >> 1 & 1, add_x = i >> 2 & 1, has_q = i >> 3 & 1, to_q = i >> 4 & 1;
        const bool to_x = !to_q || (i >> 5 & 1);
        void *x = random_numbers(k, &rng, n, -3, 3), *c = random_numbers(k, &rng, n, -1, 1);
        void *q = random_numbers(k, &rng, n, -1, 1), *h = numbers(k, n), *both = numbers(k, n);
        void *dq = random_numbers(k, &rng, n, -1, 1), *dx = random_numbers(k, &rng, n, -1, 1);
        void *found_q = numbers(k, n), *found_x = numbers(k, n), *y = numbers(k, n);
        memcpy(found_q, dq, n * k->size);
        memcpy(found_x, dx, n * k->size);
        const bool helped = kind == LG_K_TANH || kind == LG_K_SIGMOID || kind == LG_K_SWISH;
        k->act(kind == LG_K_SWISH ? LG_K_SIGMOID : kind, 0, n, x, NULL, NULL, h);
        k->act_reverse(kind, order, n, x, helped ? h : NULL, c, has_q ? q : NULL, to_q ? found_q : NULL,
                       add_q, to_x ? found_x : NULL, add_x);
        k->binary[LG_K_MUL](n, c, q, both);
        k->act(kind, order, n, x, helped ? h : NULL, c, y);
        if (to_q && add_q) k->axpy(n, 1.0, y, dq);
        if (to_q && !add_q) memcpy(dq, y, n * k->size);
        k->act(kind, order + 1, n, x, helped ? h : NULL, has_q ? both : c, y);
        if (to_x && add_x) k->axpy(n, 1.0, y, dx);
        if (to_x && !add_x) memcpy(dx, y, n * k->size);
        assert_memory_equal(found_q, dq, n * k->size);
        assert_memory_equal(found_x, dx, n * k->size);
    }
}

TEST_EVERY_TABLE("bias_act has the bits of the addition followed by the activation", k) {
    lg_rng rng = test_rng(4, 0);
    static const size_t shapes[][2] = {{1, 1}, {5, 1}, {3, 37}, {20, 100}, {7, 8}};
    for (size_t s = 0; s < LG_COUNT(shapes); s++)
        for (int kind = 0; kind < LG_K_ACTS; kind++)
            for (int with_bias = 0; with_bias < 2; with_bias++) {
                const size_t rows = shapes[s][0], cols = shapes[s][1], n = rows * cols;
                void *x = random_numbers(k, &rng, n, -9, 9), *bias = random_numbers(k, &rng, cols, -3, 3),
                     *y = numbers(k, n), *z = numbers(k, n);
                memcpy(y, x, n * k->size);
                k->bias_act((lg_k_act)kind, rows, cols, with_bias ? bias : NULL, y);
                if (with_bias) {
                    k->binary_strided[LG_K_ADD](rows, cols, x, cols, 1, bias, 0, 1, z);
                    memcpy(x, z, n * k->size);
                }
                k->act((lg_k_act)kind, 0, n, x, NULL, NULL, z);
                assert_memory_equal(y, z, n * k->size);
            }
}

/* ---- products ---- */

/* The definition: one sum over l in order, with fused multiply-adds except on the baseline. */
static double chain(const lg_kernels *t, size_t k, const void *a, size_t ca, const void *b, size_t ldb) {
    if (t->dtype == LG_F64) {
        double s = 0;
        for (size_t l = 0; l < k; l++) {
            const double x = ((const double *)a)[l * ca], y = ((const double *)b)[l * ldb];
            s = t->isa == LG_ISA_BASELINE ? x * y + s : fma(x, y, s);
        }
        return s;
    }
    float s = 0;
    for (size_t l = 0; l < k; l++) {
        const float x = ((const float *)a)[l * ca], y = ((const float *)b)[l * ldb];
        s = t->isa == LG_ISA_BASELINE ? x * y + s : fmaf(x, y, s);
    }
    return (double)s;
}

static void check_gemm(const lg_kernels *t, lg_rng *rng, size_t m, size_t n, size_t k, bool transposed,
                       bool accumulate, size_t pad) {
    const size_t ra = transposed ? 1 : k, ca = transposed ? m : 1, ldb = n + pad, ldc = n + pad;
    const size_t mark = lg_test_owned();
    void *a = random_numbers(t, rng, m * k, -1, 1),
         *b = random_numbers(t, rng, k > 0 ? k * ldb - pad : 0, -1, 1);
    void *c = random_numbers(t, rng, m * ldc - pad, -1, 1), *before = numbers(t, m * ldc - pad);
    memcpy(before, c, (m * ldc - pad) * t->size);
    t->gemm(m, n, k, a, ra, ca, b, ldb, c, ldc, accumulate);
    for (size_t i = 0; i < m; i++)
        for (size_t j = 0; j < ldc && i * ldc + j < m * ldc - pad; j++) {
            const double old = get(t, before, i * ldc + j), got = get(t, c, i * ldc + j);
            double expected = old;
            if (j < n) {
                expected = chain(t, k, at(t, a, i * ra), ca, at(t, b, j), ldb);
                if (accumulate)
                    expected = t->dtype == LG_F64 ? old + expected : (double)((float)old + (float)expected);
            }
            if (!(got == expected))
                fail_msg("%s %s gemm %zux%zux%zu%s%s: (%zu, %zu) = %.17g, expected %.17g",
                         type_names[t->dtype], lg_isa_name(t->isa), m, n, k, transposed ? " transposed" : "",
                         accumulate ? " accumulate" : "", i, j, got, expected);
        }
    lg_test_give_back(mark);
}

TEST_EVERY_TABLE("products have the bits of sums of multiply-adds in order", t) {
    lg_rng rng = test_rng(5, 0);
    for (size_t m = 1; m <= 19; m++)
        for (size_t n = 1; n <= 35; n++)
            for (unsigned v = 0; v < 4; v++)
                check_gemm(t, &rng, m, n, (m * 7 + n * 3 + v) % 12, v & 1, v >> 1, (m + n) % 3);
    static const size_t shapes[][3] = {{50, 100, 100}, {1, 879, 61}, {67, 129, 33},  {1, 1, 500},
                                       {500, 1, 20},   {33, 257, 3}, {3, 3, 3},      {100, 1, 130},
                                       {2, 211, 17},   {3, 230, 17}, {600, 20, 200}, {23, 52, 9},
                                       {40, 84, 5},    {14, 68, 11}};
    for (size_t s = 0; s < LG_COUNT(shapes); s++)
        for (unsigned v = 0; v < 8; v++)
            check_gemm(t, &rng, shapes[s][0], shapes[s][1], shapes[s][2], v & 1, v >> 1 & 1, v >> 2);
}

TEST_EVERY_TABLE("many small products have the same bits, with each operand transposed or shared", t) {
    lg_rng rng = test_rng(6, 0);
    for (unsigned v = 0; v < 32 * 125; v++) {
        const size_t m = v / 32 % 5 + 1, n = v / 160 % 5 + 1, k = v / 800 % 5, count = 3;
        const lg_small_products p = {.count = count,
                                     .m = m,
                                     .n = n,
                                     .k = k,
                                     .step_a = v & 1 ? 0 : m * k,
                                     .ra = v & 2 ? 1 : k,
                                     .ca = v & 2 ? m : 1,
                                     .step_b = v & 4 ? 0 : k * n,
                                     .rb = v & 8 ? 1 : n,
                                     .cb = v & 8 ? k : 1,
                                     .accumulate = (v & 16) != 0};
        const size_t mark = lg_test_owned();
        void *a = random_numbers(t, &rng, count * m * k, -1, 1),
             *b = random_numbers(t, &rng, count * k * n, -1, 1),
             *c = random_numbers(t, &rng, count * m * n, -1, 1), *before = numbers(t, count * m * n);
        memcpy(before, c, count * m * n * t->size);
        t->small_products(&p, a, b, c);
        for (size_t i = 0; i < count * m * n; i++) {
            const size_t s = i / (m * n), row = i / n % m, column = i % n;
            double expected = chain(t, k, at(t, a, s * p.step_a + row * p.ra), p.ca,
                                    at(t, b, s * p.step_b + column * p.cb), p.rb);
            if (p.accumulate) {
                const double old = get(t, before, i);
                expected = t->dtype == LG_F64 ? old + expected : (double)((float)old + (float)expected);
            }
            assert_true(get(t, c, i) == expected);
        }
        lg_test_give_back(mark);
    }
}

TEST_EVERY_TABLE("matvec is right to rounding, and does not depend on the row or on the number of rows", k) {
    lg_rng rng = test_rng(15, 0);
    for (size_t i = 0; i < 40 * 40; i++) {
        const size_t m = i % 40 + 1, n = i < 1600 - 40 ? i / 40 : 700;
        void *a = random_numbers(k, &rng, m * n, -1, 1), *x = random_numbers(k, &rng, n, -1, 1);
        void *y = random_numbers(k, &rng, m + 1, -1, 1), *z = numbers(k, m + 1);
        memcpy(z, y, (m + 1) * k->size);
        k->matvec(m, n, a, x, y, i & 1);
        for (size_t r = 0; r < m; r++) {
            double sum = i & 1 ? get(k, z, r) : 0, size = fabs(sum);
            for (size_t l = 0; l < n; l++) {
                sum += get(k, a, r * n + l) * get(k, x, l);
                size += fabs(get(k, a, r * n + l) * get(k, x, l));
            }
            assert_close(get(k, y, r), sum, 0, 4 * epsilon(k) * (1 + 0.3 * sqrt((double)n)) * size);
        }
        assert_close(get(k, y, m), get(k, z, m), 0, 0);
        /* an infinite element makes the result infinite at any place */
        for (size_t l = 0; l < n && n < 20; l++) {
            const double kept = get(k, a, l);
            set(k, a, l, INFINITY);
            k->matvec(m, n, a, x, y, false);
            assert_true(isinf(get(k, y, 0)));
            set(k, a, l, kept);
        }
        if (m >= 16) {
            k->matvec(m, n, a, x, y, false);
            k->matvec(8, n, at(k, a, 5 * n), x, z, false);
            assert_memory_equal(at(k, y, 5), z, 8 * k->size);
        }
    }
}

TEST_EVERY_TABLE("transposed matrices are right", k) {
    lg_rng rng = test_rng(6, 0);
    for (size_t rows = 1; rows < 23; rows++)
        for (size_t cols = 1; cols < 23; cols++) {
            void *x = random_numbers(k, &rng, rows * cols, -1, 1), *y = numbers(k, rows * cols);
            k->transpose(rows, cols, x, y);
            for (size_t i = 0; i < rows; i++)
                for (size_t j = 0; j < cols; j++)
                    assert_close(get(k, y, j * rows + i), get(k, x, i * cols + j), 0, 0);
        }
}

/* ---- reductions ---- */

/* Compares y with the sum of n numbers of x that are `step` apart, plus `start`: with the sum in the order of
 * the numbers, or with the exact sum if this sum in f32 is so long that it is accumulated in double. */
static void check_sum(const lg_kernels *k, double y, size_t n, const void *x, size_t step, double start,
                      bool in_order) {
    void *one = numbers(k, 1);
    double exact = start, size = fabs(start);
    set(k, one, 0, 0);
    for (size_t i = 0; i < n; i++) {
        k->binary[LG_K_ADD](1, one, (const char *)x + i * step * k->size, one);
        exact += get(k, x, i * step);
        size += fabs(get(k, x, i * step));
    }
    if (start != 0) k->unary[LG_K_SHIFT](1, start, one, one);
    if (in_order || k->dtype == LG_F64)
        assert_close(y, get(k, one, 0), 0, 0);
    else
        assert_close(y, exact, 0, 0.5 * epsilon(k) * size);
}

TEST_EVERY_TABLE("sums and dot products have the same bits on every instruction set", k) {
    lg_rng rng = test_rng(7, 0);
    for (size_t n = 0; n < 300; n += n < 70 ? 1 : 41) {
        void *x = random_numbers(k, &rng, n, -1, 1), *y = random_numbers(k, &rng, n, -1, 1);
        long double s = 0, d = 0;
        for (size_t i = 0; i < n; i++) {
            s += (long double)get(k, x, i);
            d += (long double)get(k, x, i) * (long double)get(k, y, i);
        }
        assert_close(k->sum(n, x), (double)s, 0, 1e-15 * (double)(n + 1));
        assert_close(k->dot(n, x, y), (double)d, 0, 1e-15 * (double)(n + 1));
        /* The same bits on every instruction set. */
        const lg_kernels *base = lg_kernels_of(k->dtype, LG_ISA_BASELINE);
        assert_true(k->sum(n, x) == base->sum(n, x));
        assert_true(k->dot(n, x, y) == base->dot(n, x, y));
    }
    static const size_t shapes[][2] = {{1, 1},   {5, 3},   {8, 100}, {13, 300}, {50, 1},
                                       {3, 700}, {300, 3}, {65, 40}, {7, 32},   {9, 33}};
    for (size_t s = 0; s < LG_COUNT(shapes); s++) {
        const size_t rows = shapes[s][0], cols = shapes[s][1], most = rows > cols ? rows : cols;
        const lg_kernels *base = lg_kernels_of(k->dtype, LG_ISA_BASELINE);
        void *x = random_numbers(k, &rng, rows * cols, -1, 1), *y = numbers(k, most), *z = numbers(k, most);
        for (int accumulate = 0; accumulate < 2; accumulate++) {
            for (size_t j = 0; j < cols; j++) {
                set(k, y, j, 2.0);
                set(k, z, j, 2.0);
            }
            k->sum_rows(rows, cols, x, y, accumulate);
            base->sum_rows(rows, cols, x, z, accumulate);
            assert_memory_equal(y, z, cols * k->size);
            for (size_t j = 0; j < cols; j++)
                check_sum(k, get(k, y, j), rows, at(k, x, j), cols, 2.0 * accumulate, rows <= 64);
        }
        k->sum_cols(rows, cols, x, y);
        base->sum_cols(rows, cols, x, z);
        assert_memory_equal(y, z, rows * k->size);
        for (size_t i = 0; i < rows; i++)
            check_sum(k, get(k, y, i), cols, at(k, x, i * cols), 1, 0, cols <= 32);
    }
}

/* ---- geometry ---- */

TEST_EVERY_TABLE("cross products and dot products of rows are right", k) {
    lg_rng rng = test_rng(8, 0);
    for (size_t rows = 1; rows < 40; rows += 3) {
        void *a = random_numbers(k, &rng, rows * 5, -1, 1), *b = random_numbers(k, &rng, rows * 5, -1, 1),
             *y = numbers(k, rows * 3);
        k->cross(rows, a, b, y);
        for (size_t i = 0; i < rows; i++)
            for (size_t j = 0; j < 3; j++) {
                const size_t p = 3 * i + (j + 1) % 3, q = 3 * i + (j + 2) % 3;
                assert_close(get(k, y, 3 * i + j), get(k, a, p) * get(k, b, q) - get(k, a, q) * get(k, b, p),
                             0, 2 * epsilon(k));
            }
        for (size_t cols = 1; cols <= 5; cols++) {
            k->rowdot(rows, cols, a, b, y);
            for (size_t i = 0; i < rows; i++) {
                double s = 0;
                for (size_t j = 0; j < cols; j++) s += get(k, a, i * cols + j) * get(k, b, i * cols + j);
                assert_close(get(k, y, i), s, 0, 4 * epsilon(k));
            }
        }
    }
}

/* Relative accuracy is also required next to the zeros, since the table's arguments are exact doubles. In
 * single precision only arguments that rounding does not change are compared. */
TEST_EVERY_TABLE("Stumpff functions have full relative accuracy, also next to their zeros", t) {
    const double tolerance = t->dtype == LG_F64 ? 1e-13 : 0.51 * (double)FLT_EPSILON;
    void *x = numbers(t, 1), *y = numbers(t, 9);
    double c[9], part[9];
    for (size_t i = 0; i < LG_COUNT(stumpff_table); i++) {
        const double w = stumpff_table[i].w, *e = stumpff_table[i].c;
        const int order = stumpff_table[i].order;
        lg_stumpff(w, 8, order, c);
        assert_all_close(c, e, 9, order == 0 ? 2e-15 : 1e-13, 0);
        for (int K = 0; K < 8; K++) { /* the result must not depend on the number of requested functions */
            lg_stumpff(w, K, order, part);
            assert_all_close(part, c, (size_t)K + 1, 1e-15, 0);
        }
        if (t->dtype == LG_F32 && (double)(float)w != w) continue;
        t->convert_in(1, &w, x);
        t->stumpff(1, 8, order, x, y);
        t->convert_out(9, y, part);
        assert_all_close(part, e, 9, tolerance, 0);
    }
    lg_stumpff(NAN, 3, 1, c);
    for (int k = 0; k < 4; k++) assert_true(isnan(c[k]));
}

/* ---- Lie group actions ---- */

/* Angles on both sides of the limits of the series, 1/4 and 2, in every vector lane; arrays of exact size; in
 * place; the same bits at every position. */
TEST_EVERY_TABLE("the action of SE(3) agrees with the plain functions, with the same bits at every "
                 "position",
                 t) {
    const double angles[] = {0.0, 1e-9, 0.1, 0.2499, 0.2501, 0.3, 1.0, 1.999, 2.001, 3.0, 5.0};
    lg_rng rng = test_rng(71, 0);
    for (size_t n = 0; n <= 19; n++) {
        double *a = TEST_ARRAY(double, 6 * n), *y = TEST_ARRAY(double, 6 * n),
               *out = TEST_ARRAY(double, 6 * n);
        double *inverse = TEST_ARRAY(double, 6 * n), largest = 0.0;
        for (size_t i = 0; i < 6 * n; i++) {
            a[i] = lg_rng_uniform_in(&rng, -1, 1);
            y[i] = lg_rng_uniform_in(&rng, -1, 1);
        }
        for (size_t i = 0; i < n; i++) {
            const double angle = angles[lg_rng_below(&rng, LG_COUNT(angles))],
                         norm = sqrt(lg_dot3(a + 6 * i, a + 6 * i));
            for (size_t j = 0; j < 3; j++) a[6 * i + j] *= angle / norm;
            largest = fmax(largest, angle);
        }
        t->se3_act(n, a, y, out);
        t->se3_dexpinv(n, a, y, inverse);
        for (size_t i = 0; i < n; i++) {
            double e[6], one[6];
            lg_se3_exp_act(a + 6 * i, y + 6 * i, e);
            assert_all_close(out + 6 * i, e, 6, 0, 1e-14);
            t->se3_act(1, a + 6 * i, y + 6 * i, one);
            assert_memory_equal(one, out + 6 * i, sizeof one);
            lg_se3_dexpinv(a + 6 * i, y + 6 * i, e);
            assert_all_close(inverse + 6 * i, e, 6, 2e-14, 2e-14);
            t->se3_dexpinv(1, a + 6 * i, y + 6 * i, one);
            assert_memory_equal(one, inverse + 6 * i, sizeof one);
        }
        assert_close(t->se3_angle(n, a), largest, 1e-15, 0);
        memcpy(inverse, y, 6 * n * sizeof *y);
        t->se3_act(n, a, y, y);
        assert_memory_equal(y, out, 6 * n * sizeof *y);
        for (size_t i = 0; i < n; i++) {
            const double kept = a[6 * i + 1];
            a[6 * i + 1] = NAN;
            assert_true(isnan(t->se3_angle(n, a)));
            t->se3_act(n, a, inverse, out);
            assert_true(isnan(out[6 * i]) && (n < 2 || isfinite(out[6 * ((i + 1) % n)])));
            a[6 * i + 1] = kept;
        }
    }
}

TEST_EVERY_TABLE("a point off its manifold by rounding is returned to it, a point farther away is not", t) {
    const double a[6] = {0.1, 0.2, -0.3, 0.4, 0.0, 0.2};
    double y[6] = {0.6, 0.0, 0.8, 1.6 + 1e-14, 2.0, -1.2}, out[6];
    y[0] += 2e-14;
    t->se3_act(1, a, y, out);
    assert_close(lg_dot3(out, out), 1.0, 0, 5e-16);
    assert_close(lg_dot3(out, out + 3), 0.0, 0, 2e-15);
    y[0] += 1e-12;
    t->se3_act(1, a, y, out);
    assert_close(lg_dot3(out, out) - lg_dot3(y, y), 0.0, 0, 2e-15);
    assert_close(lg_dot3(out, out + 3) - lg_dot3(y, y + 3), 0.0, 0, 5e-15);
}

TEST("lg_dexpinv_coef has full relative accuracy up to order 5") {
    for (size_t i = 0; i < LG_COUNT(dexpinv_table); i++)
        for (int order = 0; order < 6; order++) {
            const double e = dexpinv_table[i].g[order];
            assert_close(lg_dexpinv_coef(dexpinv_table[i].w, order), e, 1e-13, 0);
            double y;
            lg_kernels_for(LG_F64)->dexpinv_coef(1, order, &dexpinv_table[i].w, &y);
            assert_close(y, e, 1e-13, 0);
        }
    assert_true(isnan(lg_dexpinv_coef(NAN, 1)));
}

/* ---- small systems ---- */

TEST_EVERY_TABLE("small positive definite systems are solved; others give NaN and are counted", t) {
    lg_rng rng = test_rng(9, 0);
    enum { N = 21, M = 3, MAX_K = 9 }; /* two blocks of eight side by side, and five one by one */
    for (size_t k = 1; k <= MAX_K; k++) {
        const size_t kk = k * k;
        void *a = numbers(t, N * kk), *l = numbers(t, N * kk), *b = random_numbers(t, &rng, N * k * M, -1, 1),
             *x = numbers(t, N * k * M);
        for (size_t s = 0; s < N; s++) { /* G G^T + I, plus a skew part that symmetrisation removes */
            double g[MAX_K * MAX_K];
            for (size_t i = 0; i < kk; i++) g[i] = lg_rng_uniform_in(&rng, -1, 1);
            for (size_t i = 0; i < k; i++)
                for (size_t j = 0; j < k; j++) {
                    double v = i == j ? 1 : (i < j ? 0.25 : -0.25);
                    for (size_t p = 0; p < k; p++) v += g[i * k + p] * g[j * k + p];
                    set(t, a, s * kk + i * k + j, v);
                }
        }
        assert_int_equal(t->spd_factor(N, k, a, l), 0);
        t->spd_solve(N, k, M, l, b, x);
        for (size_t s = 0; s < N; s++)
            for (size_t i = 0; i < k; i++) {
                for (size_t j = i + 1; j < k; j++) assert_true(get(t, l, s * kk + i * k + j) == 0);
                for (size_t c = 0; c < M; c++) {
                    double v = 0;
                    for (size_t j = 0; j < k; j++)
                        v += 0.5 * (get(t, a, s * kk + i * k + j) + get(t, a, s * kk + j * k + i)) *
                             get(t, x, s * k * M + j * M + c);
                    assert_close(v, get(t, b, s * k * M + i * M + c), 0, 100 * epsilon(t));
                }
            }
        for (size_t s = 0; s < N; s++) { /* each alone must have the same bits */
            double alone[MAX_K * MAX_K], solution[MAX_K * M];
            const size_t at = s * kk * t->size, right = s * k * M * t->size;
            assert_int_equal(t->spd_factor(1, k, (char *)a + at, alone), 0);
            assert_memory_equal(alone, (char *)l + at, kk * t->size);
            t->spd_solve(1, k, M, alone, (char *)b + right, solution);
            assert_memory_equal(solution, (char *)x + right, k * M * t->size);
        }
        void *in_place = numbers(t, N * k * M);
        memcpy(in_place, b, N * k * M * t->size);
        t->spd_solve(N, k, M, l, in_place, in_place);
        assert_memory_equal(in_place, x, N * k * M * t->size);
        set(t, a, 1 * kk, -1.0);
        set(t, a, 3 * kk + kk - 1, NAN);
        set(t, a, (N - 1) * kk, -1.0);
        assert_int_equal(t->spd_factor(N, k, a, l), 3);
        for (size_t s = 0; s < N; s++)
            for (size_t i = 0; i < kk; i++)
                assert_true(isnan(get(t, l, s * kk + i)) == (s == 1 || s == 3 || s == N - 1));
    }
}

/* ---- Adam ---- */

TEST_EVERY_TABLE("the bits of an Adam update do not depend on the position", k) {
    lg_rng rng = test_rng(11, 0);
    enum { N = POSITION_N };
    void *g = random_numbers(k, &rng, N, -1, 1), *m = random_numbers(k, &rng, N, -1, 1),
         *v = random_numbers(k, &rng, N, 0, 1), *theta = random_numbers(k, &rng, N, -1, 1),
         *all[3] = {m, v, theta};
    void *copy[3];
    for (int a = 0; a < 3; a++) {
        copy[a] = numbers(k, N);
        memcpy(copy[a], all[a], N * k->size);
    }
    k->adam(N, 1e-3, 0.9, 0.999, 1e-8, 0.1, 0.001, 0.01, true, 1, g, m, v, theta);
    for (size_t i = 0; i < N; i++)
        k->adam(1, 1e-3, 0.9, 0.999, 1e-8, 0.1, 0.001, 0.01, true, 1, at(k, g, i), at_mutable(k, copy[0], i),
                at_mutable(k, copy[1], i), at_mutable(k, copy[2], i));
    for (int a = 0; a < 3; a++) assert_memory_equal(copy[a], all[a], N * k->size);
}

/* ---- convolutions with nine taps ---- */

TEST_EVERY_TABLE("sums of nine taps, and counts above levels, follow their definition", k) {
    enum { MOST = 70, STEP = 3 };
    lg_rng rng = test_rng(12, 0);
    for (size_t n = 0; n <= MOST; n += n < 20 ? 1 : 7) {
        void *x = numbers(k, MOST + 8 * STEP), *sum = numbers(k, MOST), *y = numbers(k, MOST);
        for (size_t i = 0; i < MOST + 8 * STEP; i++) set(k, x, i, (double)lg_rng_below(&rng, 64) / 8);
        const void *taps[3] = {at(k, x, 0), at(k, x, 4 * STEP), at(k, x, 8 * STEP)};
        k->taps_sum(n, x, STEP, sum);
        for (int sign = 1; sign >= -1; sign -= 2)
            for (int add = 0; add < 2; add++) {
                k->fill(MOST, 0.5, y);
                k->taps_apply(n, taps, sum, sign, y, add);
                for (size_t i = 0; i < MOST; i++) {
                    double all = 0, three = 0;
                    for (size_t j = 0; j < 9; j++) all += get(k, x, i + j * STEP);
                    for (size_t j = 0; j < 9; j += 4) three += get(k, x, i + j * STEP);
                    if (i < n) assert_close(get(k, sum, i), all, 0, 0);
                    assert_close(get(k, y, i), i < n ? (add ? 0.5 : 0) + sign * (3 * three - all) : 0.5, 0,
                                 0);
                }
            }
        uint32_t count[6] = {0};
        void *level = numbers(k, 5);
        for (size_t j = 0; j < 5; j++) set(k, level, j, 2.0 * (double)j - 0.25);
        for (size_t levels = 0; levels <= 5; levels++) {
            count[levels] = 77;
            k->count_above(n, x, levels, level, count);
            assert_int_equal(count[levels], 77);
            for (size_t j = 0; j < levels; j++) {
                uint32_t above = 0;
                for (size_t i = 0; i < n; i++) above += get(k, x, i) > get(k, level, j);
                assert_int_equal(count[j], above);
            }
        }
    }
}

TEST("a window of floats may be so long that floats do not count its rows") {
    enum { ROWS = (1 << 24) + 3 };
    const lg_kernels *k = lg_kernels_for(LG_F32);
    const lg_k_windows w = {.length = ROWS, .channels = 1, .size = ROWS, .stride = ROWS, .count = 1};
    float *x = TEST_ARRAY(float, ROWS), *to = TEST_ARRAY(float, ROWS), g = 3, sum = 0;
    x[ROWS - 2] = 1; /* row 2^24 + 1 */
    k->window_place(&w, 1, &g, x, to, false);
    for (int i = 0; i < ROWS; i++) sum += to[i];
    assert_true(to[ROWS - 2] == g && sum == g);
}

/* Activations as lg-export writes them, against the mathematics library in extended precision: errors in
 * units in the last place over the whole range, in double and float; limits, zeros, NaN, kinks; the same
 * numbers wherever an element stands in its array. */
#include "test_support.h"

#include <float.h>

#define EXPORT_REAL    double
#define EXPORT_NAME(x) f64_##x
#define EXPORT_SINGLE  0
#include "export_activations.h"

#define EXPORT_REAL    float
#define EXPORT_NAME(x) f32_##x
#define EXPORT_SINGLE  1
#include "export_activations.h"

#include "liegrad/ops.h"
#include "liegrad/random.h"

enum { BLOCK = 1024, BLOCKS = 256 };

/* ---- one interface for both types ---- */

typedef struct function {
    const char *name;
    void (*f64)(int, double *), (*f64_slope)(int, double *, double *);
    void (*f32)(int, float *), (*f32_slope)(int, float *, float *);
    long double (*exact)(long double), (*exact_slope)(long double);
    double ulps;  /* of the value; where sigmoid is denormal, swish has its spacing times x */
    double slope; /* of the slope, in epsilons, absolute */
} function;

static long double sigmoidl(long double x) {
    return x >= 0 ? 1 / (1 + expl(-x)) : expl(x) / (1 + expl(x));
}
static long double swishl(long double x) {
    return x * sigmoidl(x);
}
static long double tanh_slope(long double x) {
    const long double e = expl(-2 * fabsl(x));
    return 4 * e / ((1 + e) * (1 + e));
}
static long double sigmoid_slope(long double x) {
    return sigmoidl(x) * sigmoidl(-x);
}
static long double swish_slope(long double x) {
    return sigmoidl(x) * (1 + x * sigmoidl(-x));
}
static long double relul(long double x) {
    return x > 0 ? x : 0;
}
static long double relu_slope(long double x) {
    return x > 0 ? 1 : 0;
}
static long double leaky_relul(long double x) {
    return x > 0 ? x : 0.01L * x;
}
static long double leaky_relu_slope(long double x) {
    return x > 0 ? 1 : 0.01L;
}

#define ROW(name, exact, exact_slope, ulps, slope)                                                           \
    {                                                                                                        \
#name, f64_activate_##name, f64_slope_##name, f32_activate_##name, f32_slope_##name, exact,          \
            exact_slope, ulps, slope                                                                         \
    }
static const function functions[] = {
    ROW(tanh, tanhl, tanh_slope, 4, 4),     ROW(sigmoid, sigmoidl, sigmoid_slope, 4, 2),
    ROW(swish, swishl, swish_slope, 5, 20), /* x (1 - s): half an epsilon of s times x */
    ROW(relu, relul, relu_slope, 0, 0),     ROW(leaky_relu, leaky_relul, leaky_relu_slope, 1.5, 0.01),
};
enum { FUNCTIONS = LG_COUNT(functions) };

static void values_of(const function *f, bool single, int n, double *z, double *slope) {
    float narrow[BLOCK], narrow_slope[BLOCK];
    if (!single && slope == NULL) f->f64(n, z);
    if (!single && slope != NULL) f->f64_slope(n, z, slope);
    for (int i = 0; i < n; i++) narrow[i] = (float)z[i];
    if (single && slope == NULL) f->f32(n, narrow);
    if (single && slope != NULL) f->f32_slope(n, narrow, narrow_slope);
    for (int i = 0; i < n && single; i++) {
        z[i] = (double)narrow[i];
        if (slope != NULL) slope[i] = (double)narrow_slope[i];
    }
}

/* Distance of numbers of the type around x. */
static long double spacing(long double x, bool single) {
    int e;
    (void)frexpl(x, &e);
    const int digits = single ? FLT_MANT_DIG : DBL_MANT_DIG, least = single ? FLT_MIN_EXP : DBL_MIN_EXP;
    return ldexpl(1, (e < least ? least : e) - digits);
}

/* ---- points ---- */

/* Every size from the least denormal to the largest number, and densely where functions bend. */
static void draw(lg_rng *rng, bool single, int block, double *x) {
    for (int i = 0; i < BLOCK; i++) {
        const double sign = lg_rng_uniform(rng) < 0.5 ? -1 : 1, top = single ? 127.9 : 1023.9;
        const double least = single ? -149 : -1074, wide = single ? 120 : 800;
        if (block % 4 == 0)
            x[i] = exp2(lg_rng_uniform_in(rng, least, top));
        else
            x[i] = lg_rng_uniform(rng) * (block % 4 == 1 ? 1 : block % 4 == 2 ? 30 : wide);
        x[i] *= sign;
        if (single) x[i] = (double)(float)x[i];
    }
}

static void errors_over_the_range(const function *f, bool single) {
    static double x[BLOCK], y[BLOCK], z[BLOCK], slope[BLOCK];
    const double eps = single ? (double)FLT_EPSILON : DBL_EPSILON;
    long double worst = 0, worst_slope = 0;
    lg_rng rng;
    lg_rng_seed(&rng, 11, 0);
    for (int b = 0; b < BLOCKS; b++) {
        draw(&rng, single, b, x);
        memcpy(y, x, sizeof y);
        memcpy(z, x, sizeof z);
        values_of(f, single, BLOCK, y, NULL);
        values_of(f, single, BLOCK, z, slope);
        for (int i = 0; i < BLOCK; i++) {
            const long double exact = f->exact((long double)x[i]);
            const long double place = spacing(exact, single),
                              coarse = fabsl((long double)x[i]) * spacing(0, single);
            const long double unit = f->exact == swishl && place < coarse ? coarse : place;
            const long double ulps = fabsl((long double)y[i] - exact) / unit;
            const long double off = fabsl((long double)slope[i] - f->exact_slope((long double)x[i])) / eps;
            if (y[i] != z[i]) fail_msg("%s(%.17g): value beside slope is another", f->name, x[i]);
            if (!(ulps <= f->ulps)) fail_msg("%s(%.17g) = %.17g, %.2Lf ulp", f->name, x[i], y[i], ulps);
            if (!(off <= f->slope)) fail_msg("%s'(%.17g) = %.17g, %.2Lf eps", f->name, x[i], slope[i], off);
            worst = ulps > worst ? ulps : worst;
            worst_slope = off > worst_slope ? off : worst_slope;
        }
    }
    print_message("%-10s %s  value %.2Lf ulp, slope %.2Lf eps\n", f->name, single ? "f32" : "f64", worst,
                  worst_slope);
}

static void test_errors(void **state) {
    (void)state;
    for (int i = 0; i < FUNCTIONS; i++) {
        errors_over_the_range(&functions[i], false);
        errors_over_the_range(&functions[i], true);
    }
}

/* ---- limits and kinks ---- */

static void test_limits(void **state) {
    (void)state;
    static const struct {
        int function;
        double x, value;
    } rows[] = {
        {0, INFINITY, 1},
        {0, -INFINITY, -1},
        {0, 1e30, 1},
        {0, -30, -1},
        {0, 0, 0},
        {0, -0.0, 0},
        {1, INFINITY, 1},
        {1, -1e9, 0},
        {1, 0, 0.5},
        {1, -INFINITY, 0},
        {2, -1e9, 0},
        {2, -INFINITY, 0},
        {2, 0, 0},
        {2, 100, 100},
        {2, INFINITY, INFINITY},
        {3, 0, 0},
        {3, -INFINITY, 0},
        {3, -1, 0},
        {3, 2, 2},
        {3, INFINITY, INFINITY},
        {4, 0, 0},
        {4, 2, 2},
        {4, -0.0, 0},
        {4, INFINITY, INFINITY},
        {4, -INFINITY, -INFINITY},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        for (int single = 0; single < 2; single++) {
            double y = rows[i].x;
            values_of(&functions[rows[i].function], single, 1, &y, NULL);
            if (!(y == rows[i].value))
                fail_msg("%s(%g) = %g", functions[rows[i].function].name, rows[i].x, y);
        }
}

static void test_nan_passes(void **state) {
    (void)state;
    for (int i = 0; i < FUNCTIONS; i++)
        for (int single = 0; single < 2; single++) {
            double y[2] = {NAN, NAN}, slope[2];
            values_of(&functions[i], single, 1, y, NULL);
            values_of(&functions[i], single, 1, y + 1, slope);
            assert_true(isnan(y[0]) && isnan(y[1]));
        }
}

/* Kinks belong to the branch of x < 0, as in the library. */
static void test_kinks(void **state) {
    (void)state;
    const lg_activation kinds[] = {LG_RELU, LG_LEAKY_RELU};
    const double wanted[] = {0, 0.01};
    for (int i = 0; i < 2; i++)
        for (int single = 0; single < 2; single++) {
            double y[3] = {0, -0.0, 5e-324}, slope[3];
            if (single) y[2] = 1e-45;
            values_of(&functions[3 + i], single, 3, y, slope);
            assert_string_equal(lg_activation_name(kinds[i]), i == 0 ? "relu" : "leaky-relu");
            assert_close(slope[0], wanted[i], 1e-7, 0);
            assert_close(slope[1], wanted[i], 1e-7, 0);
            assert_close(slope[2], 1, 0, 0);
        }
}

/* sin and cos are the mathematics library's, arguments of any size included. */
static void test_sine(void **state) {
    (void)state;
    const double x[] = {0, 0.5, -3, 1e5, 123456789.125, 1e22};
    for (size_t i = 0; i < LG_COUNT(x); i++) {
        double y = x[i], slope;
        float narrow = (float)x[i], narrow_slope;
        f64_slope_sine(1, &y, &slope);
        f32_slope_sine(1, &narrow, &narrow_slope);
        assert_close(y, (double)sinl((long double)x[i]), 2e-16, 0);
        assert_close(slope, (double)cosl((long double)x[i]), 2e-16, 0);
        assert_close((double)narrow, (double)sinl((long double)(float)x[i]), 1.2e-7, 0);
        assert_close((double)narrow_slope, (double)cosl((long double)(float)x[i]), 1.2e-7, 0);
        f64_activate_sine(1, &y);
        f32_activate_sine(1, &narrow);
    }
}

/* ---- position ---- */

static void test_any_place_gives_the_same(void **state) {
    (void)state;
    enum { N = 61 };
    for (int i = 0; i < FUNCTIONS; i++)
        for (int single = 0; single < 2; single++) {
            double x[BLOCK], y[N];
            lg_rng rng;
            lg_rng_seed(&rng, 5, 0);
            draw(&rng, single, 2, x);
            memcpy(y, x, sizeof y);
            values_of(&functions[i], single, N, y, NULL);
            for (int k = 0; k < N; k++) {
                double one = x[k];
                values_of(&functions[i], single, 1, &one, NULL);
                assert_close(y[k], one, 0, 0);
            }
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_errors),     cmocka_unit_test(test_limits),
        cmocka_unit_test(test_nan_passes), cmocka_unit_test(test_kinks),
        cmocka_unit_test(test_sine),       cmocka_unit_test(test_any_place_gives_the_same),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

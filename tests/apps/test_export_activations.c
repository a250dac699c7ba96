/* Compares tanh and sigmoid of the exported code, in double and float, with the C library's in extended
 * precision. */
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

#include "liegrad/core.h"

enum { BLOCK = 1024, BLOCKS = 256 };

typedef struct function {
    const char *name;
    void (*f64)(int, double *);
    void (*f32)(int, float *);
    long double (*exact)(long double);
} function;

static long double sigmoidl(long double x) {
    return x >= 0 ? 1 / (1 + expl(-x)) : expl(x) / (1 + expl(x));
}

static const function functions[] = {{"tanh", f64_tanh, f32_tanh, tanhl},
                                     {"sigmoid", f64_sigmoid, f32_sigmoid, sigmoidl}};

static void values_of(const function *f, bool single, int n, double *z) {
    float narrow[BLOCK];
    if (!single) {
        f->f64(n, z);
        return;
    }
    for (int i = 0; i < n; i++) narrow[i] = (float)z[i];
    f->f32(n, narrow);
    for (int i = 0; i < n; i++) z[i] = (double)narrow[i];
}

/* Distance between neighbouring numbers of the type near x. */
static long double spacing(long double x, bool single) {
    int e;
    (void)frexpl(x, &e);
    const int digits = single ? FLT_MANT_DIG : DBL_MANT_DIG, least = single ? FLT_MIN_EXP : DBL_MIN_EXP;
    return ldexpl(1, (e < least ? least : e) - digits);
}

/* Draws numbers of every size from the least denormal to the largest number, many of them where the functions
 * bend. */
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

static void check_range(const function *f, bool single) {
    static double x[BLOCK], y[BLOCK];
    long double worst = 0;
    lg_rng rng = test_rng(11, 0);
    for (int b = 0; b < BLOCKS; b++) {
        draw(&rng, single, b, x);
        memcpy(y, x, sizeof y);
        values_of(f, single, BLOCK, y);
        for (int i = 0; i < BLOCK; i++) {
            const long double exact = f->exact((long double)x[i]);
            const long double ulps = fabsl((long double)y[i] - exact) / spacing(exact, single);
            if (!(ulps <= 4)) fail_msg("%s(%.17g) = %.17g, %.2Lf ulp", f->name, x[i], y[i], ulps);
            worst = ulps > worst ? ulps : worst;
        }
    }
    print_message("%-8s %s  %.2Lf ulp\n", f->name, single ? "f32" : "f64", worst);
}

TEST("errors are at most four units in the last place over the whole range") {
    for (size_t i = 0; i < LG_COUNT(functions); i++) {
        check_range(&functions[i], false);
        check_range(&functions[i], true);
    }
}

TEST("limits, zeros and NaN are exact") {
    static const struct {
        int function;
        double x, value;
    } rows[] = {
        {0, INFINITY, 1}, {0, -INFINITY, -1}, {0, 1e30, 1}, {0, -30, -1}, {0, 0, 0},
        {0, -0.0, 0},     {1, INFINITY, 1},   {1, -1e9, 0}, {1, 0, 0.5},  {1, -INFINITY, 0},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        for (int single = 0; single < 2; single++) {
            double y = rows[i].x, unfit = NAN;
            values_of(&functions[rows[i].function], single, 1, &y);
            values_of(&functions[rows[i].function], single, 1, &unfit);
            assert_close(y, rows[i].value, 0, 0);
            assert_true(isnan(unfit));
        }
}

TEST("the result for an element does not depend on its position in the array") {
    enum { N = 61 };
    for (size_t i = 0; i < LG_COUNT(functions); i++)
        for (int single = 0; single < 2; single++) {
            double x[BLOCK], y[BLOCK];
            lg_rng rng = test_rng(5, 0);
            draw(&rng, single, 2, x);
            memcpy(y, x, sizeof y);
            values_of(&functions[i], single, N, y);
            for (int k = 0; k < N; k++) {
                values_of(&functions[i], single, 1, x + k);
                assert_close(y[k], x[k], 0, 0);
            }
        }
}

/* Minimisation: known minima, the ways in which a run ends, states saved between any two evaluations.
 * ctest-labels: src/nn */
#include "nn_support.h"

#include "nn/minimise_internal.h"

/* ---- objectives ---- */

typedef struct function {
    lg_status (*value)(const double *x, size_t n, double *value, double *gradient);
    size_t n;
    double factor;   /* multiplies gradient component `wrong` */
    size_t wrong;    /* n: no component is wrong */
    uint64_t poison; /* number of the evaluation that gives NaN, from 1 */
    uint64_t calls;
    volatile int *cancel; /* set in the fifth call */
} function;

/* sum 100 (x_{i+1} - x_i^2)^2 + (1 - x_i)^2, minimum 0 at ones. */
static lg_status rosenbrock(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) gradient[i] = 0;
    for (size_t i = 0; i + 1 < n; i++) {
        const double u = x[i + 1] - x[i] * x[i], v = 1 - x[i];
        *value += 100 * u * u + v * v;
        gradient[i] += -400 * u * x[i] - 2 * v;
        gradient[i + 1] += 200 * u;
    }
    return LG_OK;
}

/* sum 10^(4 i/(n - 1)) (x_i - 1)^2/2. */
static lg_status stiff(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) {
        const double c = pow(10, n > 1 ? 4.0 * (double)i / (double)(n - 1) : 0), d = x[i] - 1;
        *value += 0.5 * c * d * d;
        gradient[i] = c * d;
    }
    return LG_OK;
}

static lg_status bowl(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) {
        const double c = 1 + (double)(i % 3);
        *value += 0.5 * c * x[i] * x[i] + 0.25 * x[i] * x[i] * x[i] * x[i];
        gradient[i] = c * x[i] + x[i] * x[i] * x[i];
    }
    return LG_OK;
}

static lg_status constant(const double *x, size_t n, double *value, double *gradient) {
    (void)x;
    *value = 7;
    for (size_t i = 0; i < n; i++) gradient[i] = 0;
    return LG_OK;
}

static lg_status slope(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) *value -= x[i], gradient[i] = -1;
    return LG_OK;
}

static lg_status saddle(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) {
        const double c = i % 2 == 0 ? 1 : -1;
        *value += c * x[i] * x[i];
        gradient[i] = 2 * c * x[i];
    }
    return LG_OK;
}

/* 1/x^2 - 1/x: undefined at 0, where the first step may land. */
static lg_status well(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) {
        const double r = 1 / x[i];
        *value += x[i] > 0 ? r * r - r : NAN;
        gradient[i] = -2 * r * r * r + r * r;
    }
    return LG_OK;
}

static lg_status evaluate(void *user, const double *x, double *value, double *gradient) {
    function *f = user;
    const lg_status status = f->value(x, f->n, value, gradient);
    if (f->wrong < f->n) gradient[f->wrong] *= f->factor;
    if (++f->calls == f->poison) *value = NAN;
    if (f->cancel != NULL && f->calls == 5) *f->cancel = 1;
    return status;
}

#define FUNCTION(name, size)                                                                                 \
    { .value = name, .n = size, .wrong = size }

static double *start_of(size_t n) {
    double *x = TEST_ARRAY(double, n);
    for (size_t i = 0; i < n; i++) x[i] = i % 2 == 0 ? -1.2 : 1.0;
    return x;
}

static lg_minimise_result minimise(function *f, lg_minimise_method method, double *x, lg_status expected) {
    lg_minimise_options options;
    lg_minimise_result result;
    lg_error error;
    lg_minimise_options_init(&options);
    options.method = method;
    assert_int_equal(lg_minimise(NULL, f->n, evaluate, f, &options, x, &result, &error), expected);
    assert_string_equal(error.message, lg_minimise_end_sentence(result.end));
    assert_int_equal(result.evaluations, f->calls);
    return result;
}

/* ---- known minima ---- */

TEST("both methods find known minima to rounding within a given number of evaluations") {
    static const struct {
        lg_status (*value)(const double *x, size_t n, double *value, double *gradient);
        size_t n;
        uint64_t most[LG_MINIMISE_LM]; /* largest number of evaluations */
    } cases[] = {{rosenbrock, 2, {90, 90}},
                 {rosenbrock, 10, {300, 200}},
                 {stiff, 1, {20, 20}},
                 {stiff, 7, {100, 120}},
                 {stiff, 100, {400, 1200}}};
    for (int method = 0; method < LG_MINIMISE_LM; method++)
        for (size_t c = 0; c < LG_COUNT(cases); c++) {
            function f = FUNCTION(cases[c].value, cases[c].n);
            double *x = start_of(f.n);
            const lg_minimise_result r = minimise(&f, (lg_minimise_method)method, x, LG_OK);
            print_message("%s, n = %zu: %s after %llu evaluations, f = %.1e\n",
                          lg_minimise_row_at((size_t)method)->name, f.n, lg_minimise_end_sentence(r.end),
                          (unsigned long long)r.evaluations, r.value);
            assert_true(r.end == LG_MINIMISE_GRADIENT || r.end == LG_MINIMISE_ROUNDING);
            assert_true(r.evaluations <= cases[c].most[method]);
            assert_true(r.value <= 1e-20);
            for (size_t i = 0; i < f.n; i++) assert_close(x[i], 1, 1e-8, 0);
        }
}

/* sum (1 + i) x_i^2: f and x tend to 0. */
static lg_status parabola(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) {
        *value += (1 + (double)i) * x[i] * x[i];
        gradient[i] = 2 * (1 + (double)i) * x[i];
    }
    return LG_OK;
}

TEST("a run ends when steps no longer change the value") {
    for (int method = 0; method < LG_MINIMISE_LM; method++)
        for (size_t n = 2; n <= 50; n *= 5) {
            function f = FUNCTION(parabola, n);
            const lg_minimise_result r = minimise(&f, (lg_minimise_method)method, start_of(n), LG_OK);
            print_message("%s, n = %zu: %llu evaluations, |g| = %.1e\n",
                          lg_minimise_row_at((size_t)method)->name, n, (unsigned long long)r.evaluations,
                          r.gradient);
            assert_true(r.evaluations < 200 && r.gradient < 1e-20);
        }
}

TEST("the dense method takes fewer than three evaluations per iteration") {
    function f = FUNCTION(rosenbrock, 10);
    const lg_minimise_result r = minimise(&f, LG_MINIMISE_SSBROYDEN, start_of(f.n), LG_OK);
    assert_true(r.evaluations < 3 * r.iterations);
}

/* ---- scales of variables and of f ---- */

/* (x/500 - 2)^2 + cosh(1e4 y - 2). */
static lg_status uneven(const double *x, size_t n, double *value, double *gradient) {
    const double u = x[0] / 500 - 2, v = 1e4 * x[1] - 2;
    *value = u * u + cosh(v);
    gradient[0] = u / 250;
    gradient[1] = 1e4 * sinh(v);
    return LG_OK;
}

/* sum (x_i/1e-12 - 3)^2, times 1e-30. */
static lg_status tiny(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) {
        const double u = x[i] / 1e-12 - 3;
        *value += 1e-30 * u * u;
        gradient[i] = 1e-30 * 2 * u / 1e-12;
    }
    return LG_OK;
}

/* sum 2 - cos(x_i - 1e8). The period is 2 pi, about 1e-8 of x. */
static lg_status turns(const double *x, size_t n, double *value, double *gradient) {
    *value = 0;
    for (size_t i = 0; i < n; i++) {
        *value += 2 - cos(x[i] - 1e8);
        gradient[i] = sin(x[i] - 1e8);
    }
    return LG_OK;
}

TEST("steps and checks adapt to the sizes of the variables and of the function") {
    static const struct {
        lg_status (*value)(const double *x, size_t n, double *value, double *gradient);
        double start[2], minimum[2], off; /* off 0: one of many minima */
    } cases[] = {{uneven, {500, 1e-4}, {1000, 2e-4}, 1e-7},
                 {tiny, {1e-12, 1e-12}, {3e-12, 3e-12}, 1e-9},
                 {tiny, {0, 0}, {3e-12, 3e-12}, 1e-9},
                 {turns, {1e8 + 1, 1e8 - 1}, {0, 0}, 0}};
    for (int method = 0; method < LG_MINIMISE_LM; method++)
        for (size_t c = 0; c < LG_COUNT(cases); c++) {
            function f = FUNCTION(cases[c].value, 2);
            double x[2] = {cases[c].start[0], cases[c].start[1]};
            const lg_minimise_result r = minimise(&f, (lg_minimise_method)method, x, LG_OK);
            for (int i = 0; i < 2; i++)
                if (cases[c].off > 0) assert_close(x[i], cases[c].minimum[i], cases[c].off, 0);
            if (!(cases[c].off > 0)) assert_close(r.value, 2, 1e-15, 0);
        }
}

TEST("a start very close to 0 leads to the same minimum as 0") {
    static const double close[] = {1e-16, 1e-19, 1e-23, 1e-30, 1e-100, 1e-300, 0};
    for (size_t c = 0; c < 4 * LG_COUNT(close); c++) {
        const size_t n = 1 + c % 2;
        function f = FUNCTION(stiff, n);
        double x[2] = {close[c / 4], 0.5};
        (void)minimise(&f, c % 4 < 2 ? LG_MINIMISE_SSBROYDEN : LG_MINIMISE_LBFGS, x, LG_OK);
        for (size_t i = 0; i < n; i++) assert_close(x[i], 1, 1e-9, 0);
    }
}

/* Two squares whose variables have the units `first` and `second`, and a third variable, along which f does
 * not fall at 0. */
static lg_status mixed(const double *x, double first, double second, double *value, double *gradient) {
    const double u = x[0] / first - 3, v = x[1] / second - 3, w = x[2] / 1e3, z = w * w - 1;
    *value = u * u + v * v + z * z;
    gradient[0] = 2 * u / first;
    gradient[1] = 2 * v / second;
    gradient[2] = 4 * z * w / 1e3;
    return LG_OK;
}
static lg_status rising(const double *x, size_t n, double *value, double *gradient) {
    (void)n;
    return mixed(x, 1e-3, 1e3, value, gradient);
}
static lg_status falling(const double *x, size_t n, double *value, double *gradient) {
    (void)n;
    return mixed(x, 1e3, 1e-3, value, gradient);
}

TEST("the order of the variables changes nothing when all of them start at 0") {
    for (int method = 0; method < LG_MINIMISE_LM; method++) {
        function f = FUNCTION(rising, 3), g = FUNCTION(falling, 3);
        double x[3] = {0}, y[3] = {0};
        const lg_minimise_result a = minimise(&f, (lg_minimise_method)method, x, LG_OK),
                                 b = minimise(&g, (lg_minimise_method)method, y, LG_OK);
        assert_close(x[0], 3e-3, 1e-6, 0);
        assert_int_equal(a.evaluations, b.evaluations);
        assert_true(x[0] == y[1] && x[1] == y[0] && x[2] == y[2]);
    }
}

/* x^2 + x^4 + (y^2 - 1)^2: y = 0 is a saddle, and all gradients from (1, 0) on lead into it. */
static lg_status two_wells(const double *x, size_t n, double *value, double *gradient) {
    const double w = x[1] * x[1] - 1;
    *value = x[0] * x[0] + x[0] * x[0] * x[0] * x[0] + w * w;
    gradient[0] = 2 * x[0] + 4 * x[0] * x[0] * x[0];
    gradient[1] = 4 * x[1] * w;
    return LG_OK;
}

TEST("a saddle is left") {
    for (int method = 0; method < LG_MINIMISE_LM; method++) {
        function f = FUNCTION(two_wells, 2);
        double x[2] = {1, 0};
        const lg_minimise_result r = minimise(&f, (lg_minimise_method)method, x, LG_OK);
        print_message("%s: f = %g\n", lg_minimise_row_at((size_t)method)->name, r.value);
        assert_true(r.value < 1e-12);
    }
}

/* f = sum of z_i^4/4 + s_i z_i^2/2, where s_i = -1 for the first `down` variables and 1 for the others. z = Q
 * x, where Q is a product of reflections. The minimum is -down/4. */
enum { REFLECTIONS = 2 };
typedef struct wells {
    size_t n, down;
    bool rotated;
    uint64_t calls;
    double *z, *mirror[REFLECTIONS]; /* (n) */
} wells;

static void reflect(const wells *f, int which, double *x) {
    const double *v = f->mirror[which];
    double sum = 0;
    for (size_t i = 0; i < f->n; i++) sum += 2 * v[i] * x[i];
    for (size_t i = 0; i < f->n && f->rotated; i++) x[i] -= sum * v[i];
}

static lg_status wells_value(void *user, const double *x, double *value, double *gradient) {
    wells *f = user;
    f->calls++;
    memcpy(f->z, x, f->n * sizeof *x);
    for (int k = 0; k < REFLECTIONS; k++) reflect(f, k, f->z);
    *value = 0;
    for (size_t i = 0; i < f->n; i++) {
        const double z = f->z[i], s = i < f->down ? -1 : 1;
        *value += z * z * z * z / 4 + s * z * z / 2;
        gradient[i] = z * z * z + s * z;
    }
    for (int k = REFLECTIONS; k-- > 0;) reflect(f, k, gradient);
    return LG_OK;
}

/* Variables along which f has negative curvature start at 0. The others start at 1, or at 0 too if
 * at_rest. */
static wells make_wells(size_t n, size_t down, bool rotated, bool at_rest, double *x) {
    wells f = {.n = n, .down = down, .rotated = rotated, .z = TEST_ARRAY(double, n)};
    lg_rng rng = test_rng(n, 0);
    for (int k = 0; k < REFLECTIONS; k++) {
        double sum = 0;
        f.mirror[k] = TEST_ARRAY(double, n);
        for (size_t i = 0; i < n; i++) {
            f.mirror[k][i] = lg_rng_normal(&rng);
            sum += f.mirror[k][i] * f.mirror[k][i];
        }
        for (size_t i = 0; i < n; i++) f.mirror[k][i] /= sqrt(sum);
    }
    for (size_t i = 0; i < n; i++) x[i] = i < down || at_rest ? 0 : 1;
    for (int k = REFLECTIONS; k-- > 0;) reflect(&f, k, x);
    return f;
}

TEST("saddles and maxima of any number of variables are left, minima are not") {
    static const size_t sizes[] = {1, 2, 10, 100, 101, 199, 200, 201, 500};
    for (size_t row = 0; row < LG_COUNT(sizes) * 32; row++) {
        const size_t n = sizes[row / 32], downs[] = {0, 1, n / 2, n}, down = downs[row / 8 % 4];
        const bool rotated = row / 4 % 2 != 0, at_rest = row / 2 % 2 != 0;
        lg_minimise_options options;
        lg_minimise_result r;
        double *x = TEST_ARRAY(double, n);
        wells f = make_wells(n, down, rotated, at_rest, x);
        lg_minimise_options_init(&options);
        options.method = row % 2 == 0 ? LG_MINIMISE_SSBROYDEN : LG_MINIMISE_LBFGS;
        options.memory = rotated ? 50 : 1;
        options.evaluations = 2000;
        const lg_status status = lg_minimise(NULL, n, wells_value, &f, &options, x, &r, NULL);
        const bool there = fabs(r.value + 0.25 * (double)down) <= 1e-9 * (double)n;
        /* From some starts both methods take thousands of steps, because the rotated function has hundreds of
         * wells. */
        const bool slow = r.end == LG_MINIMISE_EVALUATIONS && rotated && n >= 100 && down > 1;
        if (slow ? r.value > -0.24 * (double)down : status != LG_OK || !there)
            fail_msg("%s, n %zu, %zu down%s%s: f %g after %llu evaluations: %s",
                     lg_minimise_row_at(options.method)->name, n, down, rotated ? ", rotated" : "",
                     at_rest ? ", at rest" : "", r.value, (unsigned long long)r.evaluations,
                     lg_minimise_end_sentence(r.end));
    }
}

/* 1 + sum (x_i - i % 7)^4: at the minimum the Hessian is zero to rounding. */
static lg_status quartic(const double *x, size_t n, double *value, double *gradient) {
    *value = 1;
    for (size_t i = 0; i < n; i++) {
        const double d = x[i] - (double)(i % 7);
        *value += d * d * d * d;
        gradient[i] = 4 * d * d * d;
    }
    return LG_OK;
}

TEST("a minimum without curvature counts as a minimum, for any number of variables") {
    static const size_t sizes[] = {1, 10, 100, 150, 201, 1000};
    for (size_t row = 0; row < LG_COUNT(sizes) * LG_MINIMISE_LM; row++) {
        function f = FUNCTION(quartic, sizes[row / LG_MINIMISE_LM]);
        const lg_minimise_result r =
            minimise(&f, (lg_minimise_method)(row % LG_MINIMISE_LM), start_of(f.n), LG_OK);
        assert_close(r.value, 1, 1e-12, 0);
        assert_true(r.evaluations < 2000);
    }
}

TEST("the search for a direction of descent costs at most 30 evaluations, and none without the check") {
    static const uint64_t most[] = {0, 30};
    for (int method = 0; method < LG_MINIMISE_LM; method++) {
        uint64_t evaluations[2];
        for (int check = 0; check < 2; check++) {
            lg_minimise_options options;
            lg_minimise_result r;
            double *x = TEST_ARRAY(double, 500);
            wells f = make_wells(500, 0, true, false, x);
            lg_minimise_options_init(&options);
            options.method = (lg_minimise_method)method;
            options.check = check != 0;
            options.gradient_tolerance = 1e-6;
            assert_ok(lg_minimise(NULL, 500, wells_value, &f, &options, x, &r, NULL));
            evaluations[check] = r.evaluations;
        }
        const uint64_t start = 16; /* evaluations of the gradient check */
        assert_true(evaluations[1] <= evaluations[0] + start + most[1]);
        assert_true(evaluations[1] > evaluations[0]);
    }
}

/* A function of n variables with a parameter a. */
typedef struct landscape {
    double (*value)(const double *x, size_t n, double a, double *gradient);
    size_t n;
    double a;
} landscape;

static lg_status landscape_value(void *user, const double *x, double *value, double *gradient) {
    const landscape *f = user;
    memset(gradient, 0, f->n * sizeof *gradient);
    *value = f->value(x, f->n, f->a, gradient);
    return LG_OK;
}

static lg_minimise_result minimise_landscape(landscape f, int method, double *x) {
    lg_minimise_options options;
    lg_minimise_result r;
    lg_minimise_options_init(&options);
    options.method = (lg_minimise_method)method;
    const lg_status status = lg_minimise(NULL, f.n, landscape_value, &f, &options, x, &r, NULL);
    if (status != LG_OK)
        fail_msg("%s, n %zu, a %g: f %g after %llu evaluations: %s", lg_minimise_row_at(options.method)->name,
                 f.n, f.a, r.value, (unsigned long long)r.evaluations, lg_minimise_end_sentence(r.end));
    return r;
}

/* a + a bowl + two shallow wells in the last variable. The minimum is a - 0.025. */
static double raised(const double *x, size_t n, double a, double *gradient) {
    const double y = x[n - 1], y2 = y * y;
    double value;
    (void)bowl(x, n - 1, &value, gradient);
    gradient[n - 1] = 0.1 * (y2 * y - y);
    return a + value + 0.1 * (y2 * y2 / 4 - y2 / 2);
}

TEST("a large constant in f does not hide a direction of descent that exceeds the rounding of f") {
    static const size_t sizes[] = {201, 400};
    for (size_t row = 0; row < 2 * LG_COUNT(sizes) * LG_MINIMISE_LM; row++)
        for (double height = 1; height < 3e9; height *= 1e3) {
            const landscape f = {raised, sizes[row / 2 % LG_COUNT(sizes)], height};
            double *x = TEST_ARRAY(double, f.n);
            for (size_t i = 0; i + 1 < f.n; i++) x[i] = row % 2 != 0 && i % 2 != 0 ? 0.5 : 1;
            const lg_minimise_result r = minimise_landscape(f, (int)(row / (2 * LG_COUNT(sizes))), x);
            assert_true(r.value - height + 0.025 <= 1e-14 * height);
            assert_true(r.gradient <= 3e-8 * sqrt(height));
        }
}

/* Functions with a saddle at 0 where the diagonal of the Hessian is zero. a is the unit of x[0]. */

/* (x y - 1)^2, or (u.v - 1)^2 of vectors u, v with n/2 elements. */
static double hyperbola(const double *x, size_t n, double a, double *gradient) {
    double w = -1;
    for (size_t i = 0; i < n; i += 2) w += a * x[i] * x[i + 1];
    for (size_t i = 0; i < n; i++) gradient[i] = 2 * w * a * x[i ^ 1];
    return w * w;
}

/* x y + x^4 + y^4, minimum -1/8. */
static double saddle_of_product(const double *x, size_t n, double a, double *gradient) {
    const double u = a * x[0], v = x[n - 1];
    gradient[0] = a * (v + 4 * u * u * u);
    gradient[n - 1] = u + 4 * v * v * v;
    return u * v + u * u * u * u + v * v * v * v;
}

/* sin x sin y, minimum -1. */
static double egg_box(const double *x, size_t n, double a, double *gradient) {
    gradient[0] = a * cos(a * x[0]) * sin(x[n - 1]);
    gradient[n - 1] = sin(a * x[0]) * cos(x[n - 1]);
    return sin(a * x[0]) * sin(x[n - 1]);
}

TEST("a saddle is left where the diagonal of the Hessian is zero") {
    static const struct {
        landscape of;
        double start, least;
    } cases[] = {{{hyperbola, 2, 1}, 0, 0},   {{hyperbola, 10, 1}, 0, 0},
                 {{hyperbola, 50, 1}, 0, 0},  {{hyperbola, 140, 1}, 0, 0},
                 {{hyperbola, 200, 1}, 0, 0}, {{saddle_of_product, 2, 1}, 0, -0.125},
                 {{egg_box, 2, 1}, 0, -1},    {{egg_box, 2, 1}, 1, -1}};
    for (size_t row = 0; row < LG_COUNT(cases) * LG_MINIMISE_LM; row++)
        for (double unit = 1e-3; unit < 2e3; unit *= 1e3) {
            landscape f = cases[row / LG_MINIMISE_LM].of;
            double *x = TEST_ARRAY(double, f.n);
            for (size_t i = 0; i < f.n; i++) x[i] = cases[row / LG_MINIMISE_LM].start;
            f.a = unit;
            const lg_minimise_result r = minimise_landscape(f, (int)(row % LG_MINIMISE_LM), x);
            assert_close(r.value, cases[row / LG_MINIMISE_LM].least, 1e-12, 1e-20);
        }
}

/* sum a cos x_i + (x_{i+1} - x_i)^2/2 on a ring. At 0 the Hessian has the eigenvalue -a and the diagonal 2 -
 * a. The minimum is -a n. */
static double ring(const double *x, size_t n, double a, double *gradient) {
    double value = 0;
    for (size_t i = 0; i < n; i++) {
        const size_t j = (i + 1) % n;
        const double d = x[j] - x[i];
        value += a * cos(x[i]) + d * d / 2;
        gradient[i] -= a * sin(x[i]) + d;
        gradient[j] += d;
    }
    return value;
}

TEST("a saddle is left even if the negative curvature is only 1e-9 of the Hessian's diagonal") {
    static const size_t sizes[] = {2, 3, 4, 10, 50, 150, 200};
    for (int method = 0; method < LG_MINIMISE_LM; method++)
        for (size_t k = 0; k < LG_COUNT(sizes); k++)
            for (double a = 1e-2; a > 5e-9; a /= 10) {
                const landscape f = {ring, sizes[k], a};
                if (method == LG_MINIMISE_LBFGS && f.n > 100) continue; /* uses Lanczos' method there */
                double *x = TEST_ARRAY(double, f.n);
                const lg_minimise_result r = minimise_landscape(f, method, x);
                assert_close(r.value, -a * (double)f.n, 1e-12, 0);
            }
}

TEST("a run that starts near a saddle neither ends there nor reports an unbounded function") {
    static const size_t sizes[] = {2, 3, 4, 10, 50};
    for (size_t row = 0; row < LG_COUNT(sizes) * LG_MINIMISE_LM; row++)
        for (double start = 1e-1; start > 5e-13; start /= 10)
            for (double a = 1e-3; a < 0.2; a *= 10) {
                /* f may be constant to rounding there. From 1e-12, SSBroyden ends there for n = 50. */
                if (start < 5e-9 && (start > 2e-12 || a > 2e-3)) continue;
                if (start < 5e-9 && row == 4 * LG_MINIMISE_LM + LG_MINIMISE_SSBROYDEN) continue;
                const landscape f = {ring, sizes[row / LG_MINIMISE_LM], a};
                double *x = TEST_ARRAY(double, f.n);
                for (size_t i = 0; i < f.n; i++) x[i] = start * (1 + 0.1 * (double)i);
                const lg_minimise_result r = minimise_landscape(f, (int)(row % LG_MINIMISE_LM), x);
                assert_close(r.value, -a * (double)f.n, 1e-12, 0);
            }
}

/* sum u^4 + u^3 - a u^2/2, u = x - 1. One-sided differences do not show the saddle at u = 0. The higher
 * minimum is at u = a/3, with the value -n a^3/54 to first order. */
static double skew(const double *x, size_t n, double a, double *gradient) {
    double value = 0;
    for (size_t i = 0; i < n; i++) {
        const double u = x[i] - 1;
        value += u * u * (u * u + u - a / 2);
        gradient[i] += 4 * u * u * u + 3 * u * u - a * u;
    }
    return value;
}

/* As skew, with springs between neighbours. */
static double skew_ring(const double *x, size_t n, double a, double *gradient) {
    return ring(x, n, 0, gradient) + skew(x, n, a, gradient);
}

TEST("a saddle is left where one-sided differences do not show it") {
    static const landscape cases[] = {{skew, 1, 0},      {skew, 7, 0},       {skew, 50, 0},
                                      {skew_ring, 2, 0}, {skew_ring, 10, 0}, {skew_ring, 50, 0}};
    for (size_t row = 0; row < LG_COUNT(cases) * LG_MINIMISE_LM; row++)
        for (double a = 1e-3; a > 5e-8; a /= 10) {
            landscape f = cases[row / LG_MINIMISE_LM];
            double *x = TEST_ARRAY(double, f.n);
            for (size_t i = 0; i < f.n; i++) x[i] = 1;
            f.a = a;
            const lg_minimise_result r = minimise_landscape(f, (int)(row % LG_MINIMISE_LM), x);
            assert_true(r.value <= -0.999 * (double)f.n * a * a * a / 54);
        }
}

/* ---- ways in which a run ends ---- */

static void assert_end(function f, lg_status status, lg_minimise_end end) {
    for (int method = 0; method < LG_MINIMISE_LM; method++) {
        f.calls = 0;
        double *x = start_of(f.n);
        const lg_minimise_result r = minimise(&f, (lg_minimise_method)method, x, status);
        assert_string_equal(lg_minimise_end_sentence(r.end), lg_minimise_end_sentence(end));
        for (size_t i = 0; i < f.n; i++) assert_true(isfinite(x[i]));
    }
}

TEST("flat, unbounded and undefined functions end with their reason") {
    assert_end((function)FUNCTION(constant, 3), LG_OK, LG_MINIMISE_GRADIENT);
    assert_end((function)FUNCTION(slope, 3), LG_NO_CONVERGENCE, LG_MINIMISE_UNBOUNDED);
    assert_end((function)FUNCTION(saddle, 3), LG_NO_CONVERGENCE, LG_MINIMISE_UNBOUNDED);
    function f = FUNCTION(rosenbrock, 4);
    f.poison = 1;
    assert_end(f, LG_NOT_FINITE, LG_MINIMISE_NOT_FINITE);
}

TEST("the check finds a wrong component of the gradient") {
    static const double factors[] = {-1, 0, 2, 0.9};
    for (size_t wrong = 0; wrong < 10; wrong++)
        for (size_t i = 0; i < LG_COUNT(factors); i++) {
            function f = FUNCTION(rosenbrock, 10);
            f.wrong = wrong;
            f.factor = factors[i];
            assert_end(f, LG_CHECK_FAILED, LG_MINIMISE_WRONG_GRADIENT);
        }
}

TEST("a wrong gradient is found where f varies on a scale far below the size of x") {
    function f = FUNCTION(turns, 2);
    f.wrong = 1;
    f.factor = -1;
    double x[2] = {1e8 + 1, 1e8 - 1};
    const lg_minimise_result r = minimise(&f, LG_MINIMISE_SSBROYDEN, x, LG_CHECK_FAILED);
    assert_int_equal(r.end, LG_MINIMISE_WRONG_GRADIENT);
}

TEST("a value that is not finite shortens the step, in any evaluation") {
    function f = FUNCTION(well, 3);
    double x[3] = {0.3, 0.5, 4};
    (void)minimise(&f, LG_MINIMISE_SSBROYDEN, x, LG_OK);
    for (int i = 0; i < 3; i++) assert_close(x[i], 2, 1e-6, 0);
    for (uint64_t poison = 2; poison < 40; poison++) {
        function g = FUNCTION(rosenbrock, 2);
        g.poison = poison;
        double *y = start_of(2);
        (void)minimise(&g, LG_MINIMISE_SSBROYDEN, y, LG_OK);
        assert_close(y[0], 1, 1e-8, 0);
    }
}

TEST("limits on evaluations and seconds and the cancel flag end a run") {
    volatile int cancel = 0;
    lg_minimise_options options;
    lg_minimise_result r;
    lg_error error;
    lg_minimise_options_init(&options);
    options.evaluations = 17;
    function f = FUNCTION(rosenbrock, 10);
    assert_ok(lg_minimise(NULL, f.n, evaluate, &f, &options, start_of(f.n), &r, &error));
    assert_int_equal(r.end, LG_MINIMISE_EVALUATIONS);
    assert_int_equal(f.calls, 17);
    options.evaluations = 10000;
    options.seconds = 1e-9;
    assert_ok(lg_minimise(NULL, f.n, evaluate, &f, &options, start_of(f.n), &r, &error));
    assert_int_equal(r.end, LG_MINIMISE_SECONDS);
    options.seconds = 0;
    f = (function)FUNCTION(rosenbrock, 10);
    f.cancel = &cancel;
    assert_int_equal(
        lg_minimise(cancelled_by(&cancel), f.n, evaluate, &f, &options, start_of(f.n), &r, &error),
        LG_CANCELLED);
    assert_int_equal(f.calls, 5);
}

/* rosenbrock(2), or its residuals; evaluation `at` returns a status. */
typedef struct failing {
    uint64_t calls, at;
    lg_status status;
} failing;

static lg_status failing_objective(void *user, const double *x, double *value, double *gradient) {
    failing *f = user;
    (void)rosenbrock(x, 2, value, gradient);
    if (++f->calls != f->at) return LG_OK;
    if (f->status == LG_OK) gradient[1] = NAN;
    return f->status;
}

static lg_status failing_residuals(void *user, const double *x, double *r, double *jacobian) {
    failing *f = user;
    const double all[4] = {-20 * x[0], 10, -1, 0};
    r[0] = 10 * (x[1] - x[0] * x[0]);
    r[1] = 1 - x[0];
    memcpy(jacobian, all, sizeof all);
    if (++f->calls != f->at) return LG_OK;
    if (f->status == LG_OK) *(f->at % 2 == 0 ? &r[1] : &jacobian[2]) = NAN;
    return f->status;
}

TEST("an evaluation that fails ends the run with its status; where it is undefined, the step is shorter") {
    /* LG_OK: a derivative or a residual is NaN */
    static const lg_status statuses[] = {LG_FILE, LG_CANCELLED, LG_NOT_FINITE, LG_OK};
    for (size_t s = 0; s < LG_COUNT(statuses); s++)
        for (uint64_t at = 1; at < 60; at++)
            for (int squares = 0; squares < 2; squares++) {
                failing f = {0, at, statuses[s]};
                double x[2] = {-1.2, 1};
                lg_minimise_result result = {.evaluations = 0};
                lg_error error;
                const lg_status status =
                    squares
                        ? lg_least_squares(NULL, 2, 2, failing_residuals, &f, NULL, x, NULL, &result, &error)
                        : lg_minimise(NULL, 2, failing_objective, &f, NULL, x, &result, &error);
                const bool undefined = statuses[s] == LG_NOT_FINITE || statuses[s] == LG_OK;
                assert_int_equal(status, f.calls < at || (undefined && at > 1) ? LG_OK
                                         : undefined                           ? LG_NOT_FINITE
                                                                               : statuses[s]);
                if (status == LG_FILE) assert_says(error.message, "the objective: ");
                if (status == LG_OK) assert_close(x[0], 1, 1e-6, 0);
                assert_true(status == LG_OK || f.calls == at);
                if (statuses[s] == LG_FILE && at == 1) assert_true(x[0] == -1.2 && x[1] == 1);
            }
}

TEST("invalid arguments are refused before the first evaluation") {
    lg_minimise_options options;
    lg_minimise_options_init(&options);
    function f = FUNCTION(rosenbrock, 2);
    double x[2] = {NAN, 0};
    lg_error error;
    assert_int_equal(lg_minimise(NULL, 2, evaluate, &f, NULL, x, NULL, &error), LG_NOT_FINITE);
    x[0] = 0;
    for (int row = 0; row < 11; row++) {
        static const char *const words[] = {"0 variables",
                                            "4294967296 variables",
                                            "1 to 1000 pairs",
                                            "1 to 1000 pairs",
                                            "the size of the options",
                                            "the method of minimisation is unknown",
                                            "2 blocks of 2 are more than 2 variables",
                                            "must not be negative",
                                            "must not be negative",
                                            "must not be negative",
                                            "must not be negative"};
        if (SIZE_MAX == UINT32_MAX && row == 1) continue;
        lg_minimise_options wrong = options;
        const size_t n = row == 0 ? 0 : row == 1 ? (size_t)UINT32_MAX + 1 : 2;
        if (row == 2) wrong.memory = 0;
        if (row == 3) wrong.memory = 1001;
        if (row == 4) wrong.size--;
        if (row == 5) wrong.method = LG_MINIMISE_METHOD_COUNT;
        if (row == 6) wrong.block = 2, wrong.blocks = 2;
        if (row == 7) wrong.gradient_tolerance = -1;
        if (row == 8) wrong.gradient_tolerance = NAN;
        if (row == 9) wrong.seconds = -1;
        if (row == 10) wrong.seconds = NAN;
        assert_status(lg_minimise(NULL, n, evaluate, &f, &wrong, x, NULL, &error), LG_INVALID_ARGUMENT);
        assert_says(error.message, words[row]);
    }
    assert_int_equal(f.calls, 0);
    for (int end = -1; end <= LG_MINIMISE_END_COUNT; end += LG_MINIMISE_END_COUNT + 1) {
        assert_string_equal(lg_minimise_end_sentence((lg_minimise_end)end), "");
        assert_int_equal(lg_minimise_end_status((lg_minimise_end)end), LG_INVALID_ARGUMENT);
    }
}

/* -sum x_i, undefined if an x_i is 3 or more. */
static lg_status cliff(const double *x, size_t n, double *value, double *gradient) {
    (void)slope(x, n, value, gradient);
    for (size_t i = 0; i < n; i++)
        if (x[i] >= 3) *value = NAN;
    return LG_OK;
}

TEST("a search that ends at values that are not finite reports this, and not rounding") {
    assert_end((function)FUNCTION(cliff, 2), LG_OK, LG_MINIMISE_BARRIER);
    assert_end((function)FUNCTION(slope, 2), LG_NO_CONVERGENCE, LG_MINIMISE_UNBOUNDED);
}

/* ---- saved states ---- */

RELEASES(release_minimiser, lg_minimiser_destroy)

static lg_minimiser *test_minimiser(const function *f, lg_minimise_method method) {
    lg_minimise_options options;
    lg_minimiser *m = NULL;
    lg_minimise_options_init(&options);
    options.method = method;
    options.memory = 5;
    if (f->value == bowl) options.gradient_tolerance = 1e-9;
    assert_ok(lg_minimiser_create(NULL, f->n, &options, start_of(f->n), &m, NULL));
    lg_test_owns(m, release_minimiser);
    return m;
}

static void advance(lg_minimiser *m, function *f) {
    double value, *gradient = TEST_ARRAY(double, f->n);
    assert_ok(evaluate(f, lg_minimiser_point(m), &value, gradient));
    (void)lg_minimiser_tell(m, value, gradient);
}

TEST("a run that is saved and loaded after every evaluation has the bits of one that was not") {
    const function functions[] = {FUNCTION(rosenbrock, 3), FUNCTION(bowl, 201), FUNCTION(stiff, 1)};
    for (int row = 0; row < 3 * LG_MINIMISE_LM; row++) {
        const lg_minimise_method method = (lg_minimise_method)(row / 3);
        function f = functions[row % 3];
        lg_minimiser *whole = test_minimiser(&f, method), *parts = whole;
        whole = test_minimiser(&f, method);
        for (int i = 0; i < 100; i++) { /* includes the check of the Hessian at the end */
            memory_archive archive = {.count = 0};
            const lg_archive_writer writer = memory_writer(&archive);
            assert_ok(lg_minimiser_save(parts, &writer, NULL));
            const lg_archive_reader reader = memory_reader(&archive);
            parts = test_minimiser(&f, method);
            assert_ok(lg_minimiser_load(parts, &reader, NULL));
            advance(parts, &f);
            advance(whole, &f);
            assert_memory_equal(lg_minimiser_point(parts), lg_minimiser_point(whole), f.n * sizeof(double));
        }
        const lg_minimise_result a = lg_minimiser_result(parts), b = lg_minimiser_result(whole);
        assert_int_equal(a.iterations, b.iterations);
        assert_true(a.iterations > 10 || row % 3 == 2); /* fewer than the first pairs of ssbroyden */
        if (row % 3 == 1) assert_int_equal(a.end, LG_MINIMISE_GRADIENT);
    }
}

TEST("invalid states are refused and leave the minimiser unchanged") {
    function f = FUNCTION(rosenbrock, 3);
    lg_minimiser *m = test_minimiser(&f, LG_MINIMISE_SSBROYDEN);
    for (int i = 0; i < 12; i++) advance(m, &f);
    memory_archive archive = {.count = 0};
    const lg_archive_writer writer = memory_writer(&archive);
    assert_ok(lg_minimiser_save(m, &writer, NULL));
    for (size_t i = 0; i < archive.count; i++) {
        memory_item *item = &archive.items[i];
        void *good = item->data;
        uint64_t *bad = lg_test_memory(item->bytes);
        memcpy(bad, good, item->bytes);
        bad[0] = UINT64_MAX; /* NaN in arrays of doubles */
        item->data = bad;
        const lg_archive_reader reader = memory_reader(&archive);
        const double before = lg_minimiser_point(m)[0];
        lg_error error;
        if (strcmp(item->path, "minimise/numbers") != 0)
            assert_int_equal(lg_minimiser_load(m, &reader, &error), LG_FORMAT);
        assert_close(lg_minimiser_point(m)[0], before, 0, 0);
        item->data = good;
    }
    lg_minimiser *other = test_minimiser(&f, LG_MINIMISE_LBFGS);
    const lg_archive_reader reader = memory_reader(&archive);
    assert_int_equal(lg_minimiser_load(other, &reader, NULL), LG_SHAPE);
}

#define COUNT(member)  (offsetof(lg_minimise_counts, member) / sizeof(uint64_t))
#define NUMBER(member) (offsetof(lg_minimise_numbers, member) / sizeof(double))

TEST("a state whose counts or numbers do not fit together is refused with the rule") {
    static const struct {
        size_t n; /* variables: above 200 there is no room for a Hessian */
        lg_minimise_method method;
        struct {
            size_t at;
            double value;
        } counts[2], numbers;
        const char *words; /* NULL: the state is sound */
    } rows[] = {
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(stage), LG_STAGE_SEARCH}}, {0, 1}, NULL},
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(end), LG_MINIMISE_END_COUNT}}, {0, 1}, "unknown stage or end"},
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(stage), LG_STAGE_DONE}}, {0, 1}, "unknown stage or end"},
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(trials), 1000}}, {0, 1}, "does not fit together"},
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(iterations), 1e6}}, {0, 1}, "does not fit together"},
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(reference), 1e6}}, {0, 1}, "does not fit together"},
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(pairs), 1e6}}, {0, 1}, "does not fit together"},
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(stage), LG_STAGE_HESSIAN}, {COUNT(trials), 7}}, {0, 1}, "Hessian"},
        {3, LG_MINIMISE_SSBROYDEN, {{COUNT(stage), LG_STAGE_HESSIAN}, {COUNT(trials), 6}}, {0, 1}, NULL},
        {300, LG_MINIMISE_LBFGS, {{COUNT(stage), LG_STAGE_HESSIAN}}, {0, 1}, "Hessian"},
        {3,
         LG_MINIMISE_SSBROYDEN,
         {{COUNT(stage), LG_STAGE_CURVATURE}, {COUNT(trials), 900}},
         {0, 1},
         "Lanczos"},
        {300,
         LG_MINIMISE_LBFGS,
         {{COUNT(stage), LG_STAGE_CURVATURE}, {COUNT(trials), 900}},
         {0, 1},
         "Lanczos"},
        {3, LG_MINIMISE_SSBROYDEN, {{0, LG_STAGE_SEARCH}}, {NUMBER(slope), 0}, "not a valid state"},
        {3, LG_MINIMISE_SSBROYDEN, {{0, LG_STAGE_SEARCH}}, {NUMBER(alpha), NAN}, "not a valid state"},
        {3, LG_MINIMISE_SSBROYDEN, {{0, LG_STAGE_SEARCH}}, {NUMBER(value), INFINITY}, "not a valid state"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        function f = {.value = rosenbrock, .n = rows[i].n, .wrong = rows[i].n};
        lg_minimiser *m = test_minimiser(&f, rows[i].method);
        for (int k = 0; k < 12; k++) advance(m, &f);
        memory_archive archive = {.count = 0};
        const lg_archive_writer writer = memory_writer(&archive);
        assert_ok(lg_minimiser_save(m, &writer, NULL));
        uint64_t *counts = memory_find(&archive, "minimise/counts")->data;
        double *numbers = memory_find(&archive, "minimise/numbers")->data;
        for (int k = 0; k < 2 && (k == 0 || rows[i].counts[k].at > 0); k++)
            counts[rows[i].counts[k].at] = (uint64_t)rows[i].counts[k].value;
        if (rows[i].numbers.value != 1) numbers[rows[i].numbers.at] = rows[i].numbers.value;
        const lg_archive_reader reader = memory_reader(&archive);
        lg_error error = {.message = ""};
        assert_status(lg_minimiser_load(m, &reader, &error), rows[i].words == NULL ? LG_OK : LG_FORMAT);
        if (rows[i].words != NULL) assert_says(error.message, rows[i].words);
    }
}

/* What the state machine does not expect changes nothing. */
TEST("a minimiser ignores what does not belong to its method or its stage, and finds -infinity") {
    function f = FUNCTION(rosenbrock, 3);
    const double gradient[3] = {1, 2, 3}, matrix[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    lg_minimiser *lm = test_minimiser(&f, LG_MINIMISE_LM), *m = test_minimiser(&f, LG_MINIMISE_LBFGS);
    lg_minimise_options options;
    assert_false(lg_minimiser_tell(lm, 1, gradient));
    assert_false(lg_minimiser_tell_squares(m, 1, gradient, matrix));
    assert_int_equal(lg_minimiser_result(lm).evaluations + lg_minimiser_result(m).evaluations, 0);
    lg_minimiser_change(m, 1, gradient); /* before the first evaluation */
    while (lg_minimiser_result(m).iterations == 0) {
        lg_minimiser_change(m, 1, gradient);
        advance(m, &f);
    }
    assert_false(lg_minimiser_tell(m, -INFINITY, gradient));
    assert_int_equal(lg_minimiser_result(m).end, LG_MINIMISE_UNBOUNDED);
    assert_false(lg_minimiser_tell(m, 1, gradient));
    (void)lg_minimiser_tell_squares(lm, 1, (const double[3]){INFINITY, 0, 0}, matrix);
    assert_int_equal(lg_minimiser_result(lm).end, LG_MINIMISE_NOT_FINITE);
    assert_false(lg_minimiser_tell_squares(lm, 1, gradient, matrix));
    lm = test_minimiser(&f, LG_MINIMISE_LM);
    (void)lg_minimiser_tell_squares(lm, 1, gradient, (const double[9]){NAN});
    assert_int_equal(lg_minimiser_result(lm).end, LG_MINIMISE_NOT_FINITE);
    assert_true(lg_minimiser_result(lm).value == 1 && lg_minimiser_result(lm).gradient == 3);
    lm = test_minimiser(&f, LG_MINIMISE_LM);
    assert_false(lg_minimiser_tell_squares(lm, 1, gradient, matrix));
    assert_int_equal(lg_minimiser_result(lm).iterations, 0); /* the start is no step */
    lg_minimiser_change(lm, 1, gradient);
    assert_int_equal(lg_minimiser_result(lm).end, LG_MINIMISE_RUNNING);
    lg_minimise_options_init(&options);
    options.check = false;
    assert_ok(lg_minimiser_create(NULL, 3, &options, gradient, &m, NULL));
    lg_test_owns(m, release_minimiser);
    (void)lg_minimiser_tell(m, 1, (const double[3]){0, 0, 0});
    assert_int_equal(lg_minimiser_result(m).end, LG_MINIMISE_GRADIENT);
    assert_ok(lg_minimiser_create(NULL, 3, &options, gradient, &m, NULL));
    lg_test_owns(m, release_minimiser);
    (void)lg_minimiser_tell(m, 1, (const double[3]){0, NAN, 0});
    assert_int_equal(lg_minimiser_result(m).end, LG_MINIMISE_NOT_FINITE);
}

/* ---- nonlinear least squares ---- */

enum { POINTS = 40 };

/* r_i = a exp(-b t_i) + c - y_i. With `twice` there is a fourth unknown d, which is added to c. */
typedef struct decay {
    double t[POINTS], y[POINTS];
    size_t n;
    uint64_t calls, poison;
} decay;

static decay make_decay(double deviation, uint64_t seed) {
    decay f = {.n = 3};
    lg_rng rng = test_rng(seed, 0);
    for (int i = 0; i < POINTS; i++) {
        f.t[i] = 0.1 * i;
        f.y[i] = 2 * exp(-1.5 * f.t[i]) + 0.5 + deviation * lg_rng_normal(&rng);
    }
    return f;
}

static lg_status decay_residuals(void *user, const double *x, double *r, double *jacobian) {
    decay *f = user;
    for (size_t i = 0; i < POINTS; i++) {
        const double e = exp(-x[1] * f->t[i]), row[4] = {e, -x[0] * f->t[i] * e, 1, 1};
        r[i] = x[0] * e + x[2] + (f->n == 4 ? x[3] : 0) - f->y[i];
        for (size_t j = 0; j < f->n; j++) jacobian[i * f->n + j] = row[j];
    }
    return ++f->calls == f->poison ? LG_NOT_FINITE : LG_OK;
}

TEST("least squares find exact parameters with few Jacobians") {
    decay f = make_decay(0, 1);
    double x[3] = {1, 0.2, 0};
    lg_minimise_result result;
    assert_ok(lg_least_squares(NULL, 3, POINTS, decay_residuals, &f, NULL, x, NULL, &result, NULL));
    assert_close(x[0], 2, 1e-12, 0);
    assert_close(x[1], 1.5, 1e-12, 0);
    assert_close(x[2], 0.5, 1e-12, 0);
    assert_true(result.evaluations < 20 && result.value < 1e-26);
}

/* Over many draws of the noise the estimates must scatter as the covariance predicts. */
TEST("the covariance agrees with the scatter of estimates from repeated data") {
    enum { DRAWS = 400 };
    double mean[3] = {0}, scatter[9] = {0}, expected[9] = {0};
    static double all[DRAWS][3];
    for (int draw = 0; draw < DRAWS; draw++) {
        decay f = make_decay(0.02, (uint64_t)draw + 1);
        double covariance[9], *x = all[draw];
        x[0] = 1, x[1] = 1, x[2] = 0;
        assert_ok(lg_least_squares(NULL, 3, POINTS, decay_residuals, &f, NULL, x, covariance, NULL, NULL));
        for (int i = 0; i < 3; i++) mean[i] += x[i] / DRAWS;
        for (int i = 0; i < 9; i++) expected[i] += covariance[i] / DRAWS;
    }
    for (int draw = 0; draw < DRAWS; draw++)
        for (int i = 0; i < 9; i++)
            scatter[i] += (all[draw][i / 3] - mean[i / 3]) * (all[draw][i % 3] - mean[i % 3]) / (DRAWS - 1);
    for (int i = 0; i < 9; i++)
        assert_close(scatter[i], expected[i], 0, 0.2 * sqrt(expected[i / 3 * 4] * expected[i % 3 * 4]));
}

TEST("least squares report which parameters cannot be identified, and refuse too few residuals") {
    decay f = make_decay(0.01, 1);
    double x[4] = {1, 1, 0, 0}, covariance[16];
    lg_error error;
    f.n = 4;
    assert_ok(lg_least_squares(NULL, 4, POINTS, decay_residuals, &f, NULL, x, covariance, NULL, NULL));
    assert_close(x[2] + x[3], 0.5, 0.05, 0);
    for (int i = 0; i < 16; i++) assert_true(isnan(covariance[i]));
    assert_status(lg_least_squares(NULL, 4, 3, decay_residuals, &f, NULL, x, NULL, NULL, &error),
                  LG_INVALID_ARGUMENT);
    lg_minimise_options options;
    lg_minimise_options_init(&options);
    options.method = LG_MINIMISE_LM;
    function g = FUNCTION(rosenbrock, 2);
    assert_status(lg_minimise(NULL, 2, evaluate, &g, &options, x, NULL, &error), LG_INVALID_ARGUMENT);
}

/* A decay through three points; the unknowns are in other units. */
typedef struct three {
    double unit[3], factor[3]; /* units of the unknowns; factors of the columns of the Jacobian */
    bool transposed;
    uint64_t calls;
} three;

static lg_status three_residuals(void *user, const double *x, double *r, double *jacobian) {
    static const double t[3] = {0, 0.5, 2};
    three *f = user;
    const double a = x[0] * f->unit[0], b = x[1] * f->unit[1], c = x[2] * f->unit[2];
    for (int i = 0; i < 3; i++) {
        const double e = exp(-b * t[i]), row[3] = {e, -a * t[i] * e, 1};
        r[i] = a * e + c - (2 * exp(-1.5 * t[i]) + 0.5);
        for (int j = 0; j < 3; j++)
            jacobian[f->transposed ? j * 3 + i : i * 3 + j] = row[j] * f->unit[j] * f->factor[j];
    }
    f->calls++;
    return LG_OK;
}

static lg_minimise_end end_of_three(three f, bool check) {
    double x[3] = {1 / f.unit[0], 0.2 / f.unit[1], 0};
    lg_minimise_options options;
    lg_minimise_result result;
    lg_error error;
    lg_minimise_options_init(&options);
    options.check = check;
    const lg_status status =
        lg_least_squares(NULL, 3, 3, three_residuals, &f, &options, x, NULL, &result, &error);
    assert_status(status, lg_minimise_end_status(result.end));
    assert_string_equal(error.message, lg_minimise_end_sentence(result.end));
    assert_int_equal(result.evaluations, f.calls);
    if (status == LG_OK && check) assert_close(x[1] * f.unit[1], 1.5, 1e-9, 0);
    return result.end;
}

TEST("the check finds a wrong Jacobian, and accepts a badly scaled one") {
    static const double factors[] = {-1, 0, 2, 0.8};
    static const double units[][3] = {{1, 1, 1}, {1e8, 1e-7, 1e3}, {1e-9, 1e6, 1}};
    for (size_t u = 0; u < LG_COUNT(units); u++) {
        three good = {.factor = {1, 1, 1}};
        memcpy(good.unit, units[u], sizeof good.unit);
        (void)end_of_three(good, true);
        three bad = good;
        for (int j = 0; j < 3; j++) bad.factor[j] = -1;
        assert_int_equal(end_of_three(bad, true), LG_MINIMISE_WRONG_JACOBIAN);
        assert_int_not_equal(end_of_three(bad, false), LG_MINIMISE_WRONG_JACOBIAN);
        for (size_t i = 0; i < 3 * LG_COUNT(factors); i++) {
            bad = good;
            bad.factor[i % 3] = factors[i / 3];
            assert_int_equal(end_of_three(bad, true), LG_MINIMISE_WRONG_JACOBIAN);
        }
        good.transposed = true;
        assert_int_equal(end_of_three(good, true), LG_MINIMISE_WRONG_JACOBIAN);
    }
}

TEST("residuals that are not finite shorten the step of least squares, but are an error at the start") {
    for (uint64_t poison = 1; poison < 8; poison++) {
        decay f = make_decay(0, 1);
        double x[3] = {1, 0.2, 0};
        lg_minimise_result result;
        f.poison = poison;
        const lg_status status =
            lg_least_squares(NULL, 3, POINTS, decay_residuals, &f, NULL, x, NULL, &result, NULL);
        assert_status(status, poison == 1 ? LG_NOT_FINITE : LG_OK);
        if (poison > 1) assert_close(x[1], 1.5, 1e-12, 0);
    }
}

/* x_i - 1, and 0.1 (x_0 + ... - 1 - n) */
static lg_status line_residuals(void *user, const double *x, double *r, double *jacobian) {
    const size_t n = *(const size_t *)user;
    r[n] = -0.1 * (double)(n + 1);
    for (size_t i = 0; i < n; i++) {
        r[i] = x[i] - 1;
        r[n] += 0.1 * x[i];
        for (size_t j = 0; j < n; j++) jacobian[i * n + j] = i == j;
        jacobian[n * n + i] = 0.1;
    }
    return LG_OK;
}

TEST("least squares find the minimum from a start very close to 0") {
    static const double close[] = {1e-16, 1e-17, 1e-20, 1e-24, 1e-100, 1e-300, 0};
    for (size_t c = 0; c < 4 * LG_COUNT(close); c++) {
        size_t n = 1 + c % 2;
        double x[2] = {close[c / 4], c % 4 < 2 ? 0.5 : close[c / 4]};
        assert_ok(lg_least_squares(NULL, n, n + 1, line_residuals, &n, NULL, x, NULL, NULL, NULL));
        for (size_t i = 0; i < n; i++) assert_close(x[i], 1 + 0.01 / (1 + 0.01 * (double)n), 1e-12, 0);
    }
}

TEST("normal equations find exact numbers, divide equally between equal columns, and refuse indefinite "
     "matrices") {
    enum { N = 4, ROWS = 30 };
    const double truth[2][3] = {{1.5, -2.0, 0.25}, {0.0, 1e6, 3.0}};
    double matrix[N * N] = {0}, right[2 * N] = {0};
    for (int row = 0; row < ROWS; row++) {
        const double t = 0.1 * row, x[N] = {1.0, 1e-3 * t, t * t, 0.0};
        for (int i = 0; i < N; i++) {
            for (int j = 0; j <= i; j++) matrix[i * N + j] += x[i] * x[j];
            for (int k = 0; k < 2; k++)
                right[k * N + i] += x[i] * (truth[k][0] * x[0] + truth[k][1] * x[1] + truth[k][2] * x[2]);
        }
    }
    assert_ok(lg_normal_equations(N, 2, 1e-14, matrix, right));
    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < 3; i++) assert_close(right[k * N + i], truth[k][i], 1e-9, 1e-7);
        assert_true(right[k * N + 3] == 0.0);
    }
    double equal[4] = {2.0, 0.0, 2.0, 2.0}, shared[2] = {6.0, 6.0};
    assert_ok(lg_normal_equations(2, 1, 1e-12, equal, shared));
    for (int i = 0; i < 2; i++) assert_close(shared[i], 1.5, 1e-3, 0.0);
    double none[4] = {1.0, 0.0, 2.0, 1.0}, unknown[1] = {(double)NAN}, x[2] = {1.0, 1.0};
    assert_status(lg_normal_equations(2, 1, 1e-12, none, x), LG_CHECK_FAILED);
    assert_status(lg_normal_equations(1, 1, 1e-12, unknown, x), LG_CHECK_FAILED);
}

/* H <- (I - s y^T/ys) H (I - y s^T/ys) + s s^T/ys for a full matrix H (n, n). */
static void update_whole(size_t n, const double *s, const double *y, double *H) {
    double ys = 0, yhy = 0, hy[8] = {0};
    for (size_t i = 0; i < n; i++) {
        ys += s[i] * y[i];
        for (size_t j = 0; j < n; j++) hy[i] += H[i * n + j] * y[j], yhy += y[i] * H[i * n + j] * y[j];
    }
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < n; j++)
            H[i * n + j] += (1 + yhy / ys) * s[i] * s[j] / ys - (hy[i] * s[j] + s[i] * hy[j]) / ys;
}

TEST("directions of L-BFGS are those of full BFGS matrices, from the pairs that memory holds") {
    enum { PAIRS = 7 };
    static const uint32_t memories[] = {2, 3, 5, 9};
    for (size_t n = 1; n <= 8; n++) {
        for (size_t c = 0; c < LG_COUNT(memories); c++) {
            double *s[PAIRS], y[PAIRS][8], H[64], zeros[8] = {0}, *g = test_numbers(17 * n + c, n, -1, 1);
            const size_t most = memories[c];
            lg_minimise_options options;
            lg_minimiser *m;
            lg_minimise_options_init(&options);
            options.method = LG_MINIMISE_LBFGS;
            options.memory = memories[c];
            assert_ok(lg_minimiser_create(NULL, n, &options, zeros, &m, NULL));
            for (size_t k = 0; k < PAIRS; k++) {
                s[k] = test_numbers(100 * n + 10 * c + k, n, -1, 1);
                for (size_t i = 0; i < n; i++) y[k][i] = (1.0 + (double)((3 * i + k) % 5)) * s[k][i];
                memcpy(m->g, g, n * sizeof *g);
                lg_minimise_pairs_add(m, m->curvature, most, s[k], y[k]);
                m->counts.pairs++;
                for (size_t i = 0; i < n * n; i++)
                    H[i] = i % (n + 1) == 0 ? lg_minimise_pairs_diagonal(m, m->curvature, most)[i / n] : 0;
                for (size_t j = k + 1 > most ? k + 1 - most : 0; j <= k; j++) update_whole(n, s[j], y[j], H);
                for (size_t i = 0; i < n; i++) {
                    double wanted = 0;
                    for (size_t j = 0; j < n; j++) wanted -= H[i * n + j] * g[j];
                    assert_close(m->d[i], wanted, 1e-9, 1e-9);
                }
                /* H y = s, whatever H was before */
                memcpy(m->g, y[k], n * sizeof *g);
                lg_minimise_pairs_direction(m, m->curvature, most, k + 1);
                for (size_t i = 0; i < n; i++) assert_close(m->d[i], -s[k][i], 1e-11, 1e-11);
            }
            lg_minimiser_destroy(m);
        }
    }
}

/* Microseconds instead of seconds and kilometres instead of metres give the same steps. */
TEST("least squares do not depend on units") {
    decay f = make_decay(0.01, 1), g = f;
    double x[3] = {1, 0.2, 0}, y[3] = {1e-3, 0.2e-6, 0};
    lg_minimise_result a, b;
    for (int i = 0; i < POINTS; i++) g.t[i] *= 1e6, g.y[i] *= 1e-3;
    assert_ok(lg_least_squares(NULL, 3, POINTS, decay_residuals, &f, NULL, x, NULL, &a, NULL));
    assert_ok(lg_least_squares(NULL, 3, POINTS, decay_residuals, &g, NULL, y, NULL, &b, NULL));
    assert_close(y[0] * 1e3, x[0], 1e-9, 0);
    assert_close(y[1] * 1e6, x[1], 1e-9, 0);
    assert_close(b.value * 1e6, a.value, 1e-9, 0);
    assert_true(a.evaluations < 80 && b.evaluations < 80);
}

/* Bounds of rounding: scalar code computed with rounding differs from exact values by less.
 * ctest-labels: src/certify */
#include "interval_support.h"

#include "liegrad/ops.h"

enum { STATES = 4, POINTS = 10000 };

static lg_expansion code;

static void release_code(void *object) {
    lg_expansion_destroy(object);
}

static lg_scalars *begin(lg_scalar *in) {
    lg_expansion_destroy(&code); /* of the last call */
    code = (lg_expansion){.inputs = STATES, .results = 1};
    lg_test_owns(&code, release_code);
    lg_scalars_init(&code.s, NULL);
    code.s.level_of = lg_interval_level;
    code.result = lg_heap_take(&code.heap, 1, sizeof(lg_scalar));
    for (uint32_t i = 0; i < STATES; i++) in[i] = lg_s_input(&code.s, i);
    return &code.s;
}

static long double nearest(long double x, double unit) {
    return unit > 0x1p-40 ? (long double)(float)x : (long double)(double)x;
}

/* With constants and inputs rounded; functions err by up to 6 units more. */
static long double computed(lg_rng *rng, const double *at, double unit, long double *r) {
    for (uint32_t i = 0; i < code.s.count; i++) {
        const lg_scalar_code *c = &code.s.code[i];
        const long double x[3] = {r[c->in[0]], r[c->in[1]], r[c->in[2]]};
        const bool function = c->op >= LG_S_POW;
        r[i] = c->op == LG_S_INPUT ? at[c->n] : c->op == LG_S_CONSTANT ? c->p : exact_value(c, x);
        if (function) r[i] *= 1 + (long double)(unit * lg_rng_uniform_in(rng, -6, 6));
        r[i] = nearest(r[i], unit);
    }
    return r[code.result[0]];
}

/* The largest error in bounds of it, at points of the box */
static double largest(lg_rng *rng, const double *low, const double *high, double unit, double bound,
                      size_t points) {
    long double *r = TEST_ARRAY(long double, code.s.count + 1);
    double most = 0, at[STATES];
    for (size_t k = 0; k < points; k++) {
        for (size_t i = 0; i < STATES; i++) at[i] = draw_in(rng, low[i], high[i]);
        exact_walk(&code.s, at, r);
        const long double exact = r[code.result[0]], found = computed(rng, at, unit, r);
        if (isnan(exact)) continue; /* not known */
        const long double error = fabsl(found - exact);
        if (!(error <= bound))
            fail_msg("the error %Lg of %Lg, unit %g, is above %g", error, exact, unit, bound);
        most = fmax(most, (double)error / bound);
    }
    return most;
}

static const double UNITS[] = {0x1p-53, 0x1p-24};

TEST("every operation of sums: errors are below their bounds") {
    static const double powers[] = {2, 3, 0.5, 1.5, -1, -0.5};
    size_t finite = 0;
    for (int op = LG_S_ADD; op < LG_SCALAR_OPS; op++)
        for (size_t p = 0; p < LG_COUNT(powers); p++)
            for (size_t k = 0; k < 40 * LG_COUNT(UNITS); k++) {
                lg_rng rng = test_rng(64, k + 100 * p);
                const double unit = UNITS[k % 2], size = pow(10, lg_rng_uniform_in(&rng, -3, 1));
                lg_scalar in[STATES], a[3];
                double low[STATES], high[STATES], bound;
                if (op == LG_S_INPUT || op == LG_S_CONSTANT) continue;
                lg_scalars *s = begin(in);
                a[0] = lg_s_add(s, in[0], lg_s_scale(s, 0.3, in[1]));
                a[1] = lg_s_add(s, in[1], lg_s_sub(s, in[2], lg_s_scale(s, 0.1, in[3])));
                a[2] = lg_s_mul(s, in[2], in[0]);
                code.result[0] = op == LG_S_SELECT ? lg_s_select(s, lg_s(s, LG_S_GE, a[0], a[1]), a[1], a[2])
                                 : op == LG_S_POW  ? lg_s_pow(s, a[0], powers[p])
                                 : op == LG_S_STUMPFF || op == LG_S_DEXPINV
                                     ? lg_s_numbered(s, (lg_scalar_op)op, a[0], (uint32_t)p)
                                     : lg_s(s, (lg_scalar_op)op, a[0], a[1]);
                for (size_t i = 0; i < STATES; i++) {
                    const double about = size * lg_rng_uniform_in(&rng, k % 3 == 0 ? -1 : 0.2, 1.5);
                    draw_box(&rng, about, &low[i], &high[i]);
                }
                assert_ok(lg_expansion_rounding(&code, low, high, unit, &bound));
                if (!isfinite(bound)) continue;
                finite++;
                (void)largest(&rng, low, high, unit, bound, 50);
            }
    print_message("%zu finite bounds\n", finite);
    assert_true(finite > 5000);
}

/* -K x and a network of tanh, saturated, as policies are */
static void controller(lg_rng *rng, double scale) {
    enum { WIDTH = 5 };
    lg_scalar in[STATES], now[WIDTH], next[WIDTH], terms[STATES], sum;
    lg_scalars *s = begin(in);
    for (size_t i = 0; i < STATES; i++) {
        now[i] = lg_s_scale(s, lg_rng_uniform_in(rng, 0.1, 2) / scale, in[i]);
        terms[i] = lg_s_scale(s, lg_rng_uniform_in(rng, -30, 30) / scale, in[i]);
    }
    sum = lg_s_sum(s, terms, STATES, 1);
    for (int layer = 0; layer < 3; layer++) {
        const size_t from = layer == 0 ? STATES : WIDTH, to = layer == 2 ? 1 : WIDTH;
        for (size_t j = 0; j < to; j++) {
            lg_scalar weight[WIDTH];
            for (size_t i = 0; i < from; i++) weight[i] = lg_s_constant(s, lg_rng_uniform_in(rng, -1, 1));
            const lg_scalar dot = lg_s_dot(s, weight, 1, now, 1, from);
            next[j] = layer == 2 ? dot : lg_s(s, LG_S_TANH, dot, dot);
        }
        memcpy(now, next, sizeof now);
    }
    const lg_scalar limit = lg_s_constant(s, 300.1), y = lg_s_add(s, sum, now[0]),
                    below = lg_s_neg(s, lg_s(s, LG_S_MAX, lg_s_neg(s, y), lg_s_neg(s, limit)));
    code.result[0] = lg_s(s, LG_S_MAX, below, lg_s_neg(s, limit));
}

TEST("random controllers in f64 and f32, whatever the unit of the states: errors are below the bounds") {
    static const double scales[] = {1, 1e9, 1e-9};
    double most = 0;
    for (size_t k = 0; k < 24; k++) {
        lg_rng rng = test_rng(65, k);
        const double unit = UNITS[k % 2], scale = scales[k % LG_COUNT(scales)];
        double low[STATES], high[STATES], bound;
        controller(&rng, scale);
        for (size_t i = 0; i < STATES; i++) low[i] = -(high[i] = scale * lg_rng_uniform_in(&rng, 0.01, 2));
        assert_ok(lg_expansion_rounding(&code, low, high, unit, &bound));
        assert_true(bound > 0 && bound < 1e5 * unit);
        most = fmax(most, largest(&rng, low, high, unit, bound, POINTS));
    }
    print_message("the largest error is %.3g of its bound\n", most);
    assert_true(most > 0.003); /* so bounds that are 1000 times too small fail */
}

enum { TERMS = 40 };

static float in_order(const double *weight, const double *at, size_t from, size_t step) {
    float found = 0;
    for (size_t i = 0; i < TERMS; i++) {
        const size_t j = (from + i * step) % TERMS;
        found += (float)weight[j] * (float)at[j % STATES];
    }
    return found;
}

TEST("a sum of 40 terms in any order has errors below the bound, as where 1 swallows all the others") {
    for (int swallows = 0; swallows < 2; swallows++) {
        lg_scalar in[STATES], terms[TERMS];
        double low[STATES], high[STATES], weight[TERMS], bound;
        lg_rng rng = test_rng(66, 0);
        lg_scalars *s = begin(in);
        for (size_t i = 0; i < TERMS; i++) {
            weight[i] = !swallows ? lg_rng_uniform(&rng) : i == 0 ? 1 : 0.95 * 0x1p-24;
            terms[i] = lg_s_scale(s, weight[i], in[i % STATES]);
        }
        code.result[0] = lg_s_sum(s, terms, TERMS, 1);
        for (size_t i = 0; i < STATES; i++) low[i] = swallows, high[i] = 1;
        assert_ok(lg_expansion_rounding(&code, low, high, 0x1p-24, &bound));
        for (size_t k = 0; k < (swallows ? 1 : POINTS); k++) {
            const size_t from = swallows ? 0 : lg_rng_below(&rng, TERMS),
                         step = 1 + 2 * lg_rng_below(&rng, 2);
            long double exact = 0;
            double at[STATES];
            for (size_t i = 0; i < STATES; i++) at[i] = lg_rng_uniform_in(&rng, low[i], high[i]);
            for (size_t i = 0; i < TERMS; i++) exact += (long double)weight[i] * at[i % STATES];
            assert_true(fabsl(in_order(weight, at, from, step) - exact) <= bound);
        }
    }
}

TEST("there is no bound where rounding may decide a jump, leave a domain or overflow") {
    static const struct {
        lg_scalar_op op;
        double low, high;
        bool finite;
    } rows[] = {{LG_S_GE, 1, 2, false},        {LG_S_GE, 1.1, 2, true},  {LG_S_SIGN, 0, 1, false},
                {LG_S_SIGN, 1, 2, true},       {LG_S_SQRT, 0, 1, false}, {LG_S_SQRT, 1, 2, true},
                {LG_S_LOG, 0, 1, false},       {LG_S_LOG, 1, 2, true},   {LG_S_EXP, 0, 100, false},
                {LG_S_EXP, 0, 50, true},       {LG_S_DIV, -1, 1, false}, {LG_S_DIV, 1, 2, true},
                {LG_S_ATAN2, -2, -1, false},   {LG_S_ATAN2, 1, 2, true}, {LG_S_DEXPINV, 0, 1, false},
                {LG_S_MUL, 1e38, 3e38, false}, {LG_S_MUL, 1, 1e30, true}};
    for (size_t k = 0; k < LG_COUNT(rows); k++) {
        lg_scalar in[STATES];
        double low[STATES], high[STATES], bound;
        lg_scalars *s = begin(in);
        const lg_scalar one = lg_s_constant(s, 1), x = in[0], two = lg_s_constant(s, 2);
        code.result[0] = rows[k].op == LG_S_GE        ? lg_s(s, LG_S_GE, x, one)
                         : rows[k].op == LG_S_DIV     ? lg_s(s, LG_S_DIV, one, x)
                         : rows[k].op == LG_S_MUL     ? lg_s(s, LG_S_MUL, x, two)
                         : rows[k].op == LG_S_ATAN2   ? lg_s(s, LG_S_ATAN2, one, x)
                         : rows[k].op == LG_S_DEXPINV ? lg_s_numbered(s, LG_S_DEXPINV, x, 0)
                                                      : lg_s(s, rows[k].op, x, x);
        for (size_t i = 0; i < STATES; i++) low[i] = rows[k].low, high[i] = rows[k].high;
        assert_ok(lg_expansion_rounding(&code, low, high, 0x1p-24, &bound));
        if (isfinite(bound) != rows[k].finite) fail_msg("row %zu: the bound %g", k, bound);
    }
}

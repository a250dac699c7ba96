/* Taylor coefficients in time and their Jacobians, for every operation of scalar code.
 * ctest-labels: src/certify src/autodiff */
#include "interval_support.h"
#include "autodiff/program_support.h"

#include "liegrad/ops.h"

/* x' = (op(a, b, c), x_0/2 - x_1 + u, x_0 - .3 x_2 x_1), where a, b, c are sums of states and the input. */
enum { N = 3, COLUMNS = 4, ORDERS = 5 };
enum { COEFFICIENTS, SLOPES, CHORDS };

typedef struct motion {
    lg_expansion x;
    lg_interval *f;
    lg_scalar_code exact;
} motion;

static void release_motion(void *object) {
    motion *m = object;
    lg_expansion_destroy(&m->x);
    lg_interval_destroy(m->f);
}

static lg_scalar scaled(lg_scalars *s, double c, lg_scalar a) {
    return lg_s_scale(s, c, a);
}

static motion *motion_of(lg_scalar_op op, uint32_t n, double p, uint32_t first, uint32_t last, int kind) {
    motion *m = TEST_ARRAY(motion, 1);
    lg_scalar in[COLUMNS], a[3];
    lg_scalars *s = &m->x.s;
    lg_test_owns(m, release_motion);
    lg_scalars_init(s, NULL);
    s->level_of = lg_interval_level;
    m->x.inputs = COLUMNS;
    for (uint32_t i = 0; i < COLUMNS; i++) in[i] = lg_s_input(s, i);
    a[0] = lg_s_add(s, in[0], scaled(s, 0.5, in[1]));
    a[1] = lg_s_add(s, in[1], lg_s_sub(s, in[2], scaled(s, 0.25, in[3])));
    a[2] = lg_s_mul(s, in[2], in[0]);
    lg_scalar y = op == LG_S_SELECT ? lg_s_select(s, lg_s(s, LG_S_GE, a[0], a[1]), a[1], a[2])
                  : op == LG_S_POW  ? lg_s_pow(s, a[0], p)
                  : op == LG_S_STUMPFF || op == LG_S_DEXPINV ? lg_s_numbered(s, op, a[0], n)
                                                             : lg_s(s, op, a[0], a[1]);
    m->x.result = lg_heap_take(&m->x.heap, N, sizeof(lg_scalar));
    m->x.result[0] = y;
    m->x.result[1] = lg_s_add(s, lg_s_sub(s, scaled(s, 0.5, in[0]), in[1]), in[3]);
    m->x.result[2] = lg_s_sub(s, in[0], scaled(s, 0.3, lg_s_mul(s, in[2], in[1])));
    m->x.results = N;
    lg_interval_taylor_spec spec;
    lg_interval_taylor_spec_init(&spec);
    spec.first = first;
    spec.last = last;
    spec.slopes = kind != COEFFICIENTS;
    spec.chords = kind == CHORDS;
    lg_error error = {LG_OK, ""};
    const lg_status status = lg_expansion_taylor(&m->x, N, &spec, &error);
    if (status != LG_OK) fail_msg("instruction %d: %s", (int)op, error.message);
    m->f = lg_alloc(NULL, 1, sizeof *m->f);
    *m->f = (lg_interval){.run = lg_interval_kernel(lg_isa_in_use()),
                          .inputs = m->x.inputs,
                          .outputs = m->x.results,
                          .functions = 1};
    assert_ok(lg_interval_choose(&m->x, false, m->f));
    return m;
}

/* The results at a point, in long double */
static void walk(const motion *m, const double *at, long double *out) {
    long double *r = TEST_ARRAY(long double, m->x.s.count + 1);
    exact_walk(&m->x.s, at, r);
    for (size_t j = 0; j < m->x.results; j++) out[j] = r[m->x.result[j]];
}

static void draw_point(lg_rng *rng, double *at) {
    do {
        for (int i = 0; i < COLUMNS; i++) at[i] = lg_rng_uniform_in(rng, 0.4, 1.6);
        /* away from kinks and from poles */
    } while (fabs(at[0] + 0.5 * at[1] - (at[1] + at[2] - 0.25 * at[3])) < 0.05 ||
             at[1] + at[2] - 0.25 * at[3] < 0.2);
}

static void assert_near(lg_scalar_op op, const char *what, size_t j, long double found, long double wanted) {
    if (!(fabsl(found - wanted) <= 2e-7L * (1 + fabsl(wanted))))
        fail_msg("instruction %d: %s %zu is %.15Lg, not %.15Lg", (int)op, what, j, found, wanted);
}

/* x_1 = f; (k + 1) x_{k+1} = D_x x_k f, and the Jacobians, by differences of x_k. */
static size_t check_row(lg_scalar_op op, uint32_t n, double p, lg_rng *rng) {
    const motion *value = motion_of(op, n, p, 1, ORDERS, false),
                 *slope = motion_of(op, n, p, 1, ORDERS, true);
    long double x[ORDERS * N], low[ORDERS * N], high[ORDERS * N], J[ORDERS * N * COLUMNS],
        D[ORDERS * N * COLUMNS];
    for (int round = 0; round < 20; round++) {
        double at[COLUMNS];
        draw_point(rng, at);
        walk(value, at, x);
        walk(slope, at, J);
        for (size_t c = 0; c < COLUMNS; c++) {
            const double h = 0x1p-18, was = at[c];
            at[c] = was - h;
            walk(value, at, low);
            at[c] = was + h;
            walk(value, at, high);
            at[c] = was;
            for (size_t j = 0; j < ORDERS * N; j++) D[j * COLUMNS + c] = (high[j] - low[j]) / (2 * h);
        }
        for (size_t j = 0; j < ORDERS * N * COLUMNS; j++) assert_near(op, "slope", j, J[j], D[j]);
        for (size_t j = 0; j + N < ORDERS * N; j++) {
            long double rate = 0;
            for (size_t c = 0; c < N; c++) rate += D[j * COLUMNS + c] * x[c];
            assert_near(op, "coefficient", j + N, x[j + N], rate / (long double)(j / N + 2));
        }
    }
    return 20;
}

/* Bounds over boxes contain the values at points. */
static void check_boxes(lg_scalar_op op, uint32_t n, double p, bool slopes, lg_rng *rng) {
    enum { BOX = 40 };
    const motion *m = motion_of(op, n, p, 1, 4, slopes);
    double low[BOX * COLUMNS], high[BOX * COLUMNS], at[COLUMNS];
    double *l = TEST_ARRAY(double, BOX * m->x.results), *h = TEST_ARRAY(double, BOX * m->x.results);
    long double *r = TEST_ARRAY(long double, m->x.results);
    for (size_t i = 0; i < BOX; i++) {
        draw_point(rng, at);
        for (size_t c = 0; c < COLUMNS; c++)
            draw_box(rng, at[c], &low[i * COLUMNS + c], &high[i * COLUMNS + c]);
    }
    assert_ok(lg_interval_eval(m->f, BOX, low, high, l, h, NULL, lg_test_memory(lg_interval_work_size(m->f)),
                               NULL));
    for (size_t i = 0; i < BOX; i++) {
        for (size_t c = 0; c < COLUMNS; c++)
            at[c] = draw_in(rng, low[i * COLUMNS + c], high[i * COLUMNS + c]);
        walk(m, at, r);
        for (size_t j = 0; j < m->x.results; j++)
            if (!is_within(l[i * m->x.results + j], h[i * m->x.results + j], r[j]))
                fail_msg("instruction %d, result %zu: %.20Lg is outside of [%.17g, %.17g]", (int)op, j, r[j],
                         l[i * m->x.results + j], h[i * m->x.results + j]);
    }
}

/* The coefficients at a point, and x_k(x) - x_k(x_0) in S (x - x_0) for points x of a box. */
static size_t check_chords(lg_scalar_op op, uint32_t n, double p, lg_rng *rng) {
    enum { BOX = 40, RESULTS = 4 * N, ALL = RESULTS * (1 + COLUMNS) };
    const motion *m = motion_of(op, n, p, 1, 4, CHORDS), *value = motion_of(op, n, p, 1, 4, COEFFICIENTS);
    double low[2 * COLUMNS], high[2 * COLUMNS], at[COLUMNS], l[ALL], h[ALL];
    long double first[RESULTS], other[RESULTS];
    size_t bounded = 0;
    assert_int_equal(m->x.results, ALL);
    for (size_t i = 0; i < BOX; i++) {
        draw_point(rng, at);
        for (size_t c = 0; c < COLUMNS; c++) {
            draw_box(rng, at[c], &low[c], &high[c]);
            at[c] = draw_in(rng, low[c], high[c]);
            low[COLUMNS + c] = high[COLUMNS + c] = at[c];
        }
        assert_ok(lg_interval_eval(m->f, 1, low, high, l, h, NULL,
                                   lg_test_memory(lg_interval_work_size(m->f)), NULL));
        walk(value, at, first);
        for (size_t c = 0; c < COLUMNS; c++) at[c] = draw_in(rng, low[c], high[c]);
        walk(value, at, other);
        for (size_t j = 0; j < RESULTS; j++) {
            long double least = other[j] - first[j], most = least, size = fabsl(first[j]) + fabsl(other[j]);
            for (size_t c = 0; c < COLUMNS; c++) {
                const long double by = (long double)at[c] - low[COLUMNS + c];
                const size_t k = RESULTS + j * COLUMNS + c;
                if (by == 0) continue;
                least -= by * (by > 0 ? h[k] : l[k]);
                most -= by * (by > 0 ? l[k] : h[k]);
                size += fabsl(by) * fmaxl(fabsl((long double)l[k]), fabsl((long double)h[k]));
            }
            bounded += isfinite((double)size);
            if (!is_within(l[j], h[j], first[j]) || least > 1e-17L * size || most < -1e-17L * size)
                fail_msg("instruction %d, result %zu: a chord is outside of its bounds", (int)op, j);
        }
    }
    return bounded;
}

static const double powers[] = {-2, -1, 0.5, 1.5, 3, 4, -0.5, 0.1, 2.7};
static const uint32_t numbers[] = {0, 1, 2, 3, 17, 34};

TEST("every operation's coefficients are those of its motion, and their Jacobians are slopes, also of "
     "chords") {
    lg_rng rng = test_rng(64, 1);
    size_t points = 0, bounded = 0;
    for (int op = LG_S_ADD; op < LG_SCALAR_OPS; op++)
        for (size_t k = 0; k < LG_COUNT(powers); k++) {
            const uint32_t n = op == LG_S_DEXPINV ? numbers[k % 4] : numbers[k % LG_COUNT(numbers)];
            const size_t mark = lg_test_owned();
            points += check_row((lg_scalar_op)op, n, powers[k], &rng);
            check_boxes((lg_scalar_op)op, n, powers[k], false, &rng);
            check_boxes((lg_scalar_op)op, n, powers[k], true, &rng);
            bounded += check_chords((lg_scalar_op)op, n, powers[k], &rng);
            lg_test_give_back(mark);
        }
    assert_true(points > 3000 && bounded > 40000);
}

TEST("over a kink, x_1, x_2 and the Jacobian of x_1 have bounds; what would be a jump has none") {
    static const lg_scalar_op kinks[] = {LG_S_MAX, LG_S_ABS};
    for (size_t k = 0; k < LG_COUNT(kinks); k++)
        for (int slopes = 0; slopes < 2; slopes++) {
            const motion *m = motion_of(kinks[k], 0, 0, 1, 3, slopes);
            const size_t each = m->x.results / 3;
            double l[3 * N * COLUMNS], h[3 * N * COLUMNS];
            const double low[COLUMNS] = {-1, -1, -1, 0.5}, high[COLUMNS] = {1, 1, 1, 0.5};
            assert_ok(lg_interval_eval(m->f, 1, low, high, l, h, NULL,
                                       lg_test_memory(lg_interval_work_size(m->f)), NULL));
            const size_t end = slopes ? 1 : 2;
            for (size_t j = 0; j < end * each; j++) assert_true(isfinite(l[j]) && isfinite(h[j]));
            assert_true(h[end * each] == INFINITY);
        }
}

/* ---- programs ---- */

RECORDING(spring) {
    y[0] = lg_add(tape, lg_neg(tape, x[0]), x[1]);
}
RECORDING(stopped) {
    y[0] = lg_add(tape, lg_stop_gradient(tape, x[0]), x[1]);
}
RECORDING(weighed) {
    y[0] = lg_select(tape, lg_sub(tape, x[0], x[1]), x[0], x[1]);
}

RELEASES(release_interval, lg_interval_destroy)

TEST("of a program: x' = u - x has x_k = -x_{k-1}/k; orders, ports and operations that have no series fail") {
    static const lg_port in[3] = {{.name = "x", .shape = {1, {1}}},
                                  {.name = "u", .shape = {1, {1}}},
                                  {.name = "v", .shape = {1, {1}}}},
                         out = {.name = "y"};
    const lg_function_spec functions[] = {{"spring", in, 2, &out, 1, spring, NULL},
                                          {"stopped", in, 2, &out, 1, stopped, NULL},
                                          {"weighed", in, 2, &out, 1, weighed, NULL},
                                          {"three", in, 3, &out, 1, spring, NULL}};
    const lg_program_spec spec = spec_of(NULL, 0, functions, 4);
    const lg_program *program = test_program(&spec);
    lg_interval_taylor_spec what;
    lg_interval *f = NULL;
    lg_error error;
    lg_interval_taylor_spec_init(NULL);
    lg_interval_taylor_spec_init(&what);
    what.last = 4;
    assert_told(lg_interval_taylor(program, &what, NULL, &f, &told));
    lg_test_owns(f, release_interval);
    const double at[2] = {0.5, 2};
    double l[4], h[4], wanted = 1;
    assert_ok(lg_interval_eval(f, 1, at, at, l, h, NULL, lg_test_memory(lg_interval_work_size(f)), NULL));
    for (int k = 0; k < 4; k++) {
        wanted = k == 0 ? 1.5 : -wanted / (k + 1);
        assert_close(l[k], wanted, 1e-14, 0);
        assert_true(l[k] <= h[k] && h[k] - l[k] < 1e-14);
    }
    const struct {
        size_t size, function;
        uint32_t first, last;
        lg_status status;
        const char *words;
    } bad[] = {{1, 0, 1, 1, LG_INVALID_ARGUMENT, "size"},
               {sizeof what, 0, 0, 1, LG_INVALID_ARGUMENT, "orders"},
               {sizeof what, 0, 3, 2, LG_INVALID_ARGUMENT, "orders"},
               {sizeof what, 0, 1, 13, LG_INVALID_ARGUMENT, "orders"},
               {sizeof what, 9, 1, 1, LG_NOT_FOUND, "number 9"},
               {sizeof what, 1, 1, 2, LG_UNSUPPORTED, "lg_stop_gradient"},
               {sizeof what, 2, 1, 2, LG_UNSUPPORTED, "no comparison"},
               {sizeof what, 3, 1, 2, LG_INVALID_ARGUMENT, "inputs"}};
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        what =
            (lg_interval_taylor_spec){bad[i].size, bad[i].function, bad[i].first, bad[i].last, false, false};
        assert_status(lg_interval_taylor(program, &what, NULL, &f, &error), bad[i].status);
        assert_says(error.message, bad[i].words);
    }
}

/* Convolution and pooling along time. The kernels of every type and instruction set, then the operations of
 * the tape with their derivatives, are compared with plain loops in double. */
#include "kernels/kernel_tables.h"
#include "support/fixtures.h"

#include <float.h>

#include "kernels/conv.h"
#include "liegrad/ops.h"

/* ---- sizes ---- */

typedef struct sizes {
    uint32_t batch, length, channels, kernel, outputs, stride, padding;
} sizes;

/* A size of 1 for everything, kernels as long as the series, strides longer than the kernel, long inner sums,
 * and the sizes of a network for 300 samples of 6 channels. Random sizes follow. */
static const sizes extreme[] = {
    {1, 1, 1, 1, 1, 1, 0},    {3, 1, 2, 1, 4, 1, 0},     {1, 7, 3, 7, 2, 1, 0},    {4, 7, 3, 7, 2, 1, 0},
    {2, 9, 2, 3, 5, 4, 0},    {2, 9, 2, 3, 5, 3, 0},     {3, 5, 1, 4, 1, 9, 3},    {1, 3, 1, 5, 2, 1, 4},
    {2, 1, 2, 2, 3, 1, 1},    {1, 500, 1, 3, 1, 1, 1},   {1, 7, 180, 5, 3, 1, 2},  {1, 900, 3, 2, 20, 1, 0},
    {2, 300, 6, 5, 12, 1, 0}, {2, 148, 12, 5, 24, 1, 0}, {2, 72, 24, 5, 48, 1, 0}, {0, 5, 2, 3, 4, 1, 0},
    {2, 40, 17, 3, 16, 1, 0}, {2, 40, 16, 3, 33, 2, 1},  {1, 12, 4, 1, 450, 1, 0}, {5, 8, 2, 2, 3, 2, 0},
    {2, 97, 12, 2, 3, 2, 0},  {3, 61, 5, 3, 2, 3, 0},    {2, 70, 1, 2, 3, 2, 0},
};
enum { EXTREME = sizeof extreme / sizeof *extreme, SHAPES = EXTREME + 40 };

static uint32_t between(lg_rng *rng, uint32_t low, uint32_t high) {
    return low + (uint32_t)lg_rng_below(rng, high - low + 1);
}

static sizes sizes_of(size_t i) {
    if (i < EXTREME) return extreme[i];
    lg_rng rng = test_rng(11, i);
    sizes s = {.batch = between(&rng, 1, 4), .channels = between(&rng, 1, 35), .kernel = between(&rng, 1, 8)};
    s.outputs = between(&rng, 1, 35);
    s.stride = between(&rng, 1, 4);
    s.padding = between(&rng, 0, s.kernel - 1);
    s.length = s.kernel + between(&rng, 0, 30);
    return s;
}

static lg_conv conv_for(sizes s) {
    lg_conv c = {.windows = {.length = s.length,
                             .channels = s.channels,
                             .size = s.kernel,
                             .stride = s.stride,
                             .padding = s.padding},
                 .batch = s.batch,
                 .outputs = s.outputs};
    assert_true(lg_windows_count(&c.windows));
    assert_int_equal(c.windows.count, (s.length + 2 * s.padding - s.kernel) / s.stride + 1);
    return c;
}

/* ---- plain loops in double, with the sums of magnitudes for the error bounds ---- */

typedef struct reference {
    size_t nx, nw, ny;
    double *x, *w, *b, *g; /* inputs and cotangent of y */
    double *y, *dx, *dw, *db;
    double *ay, *adx, *adw, *adb; /* sums of |terms| */
} reference;

/* Numbers that a float represents exactly, so that both types compute with the same ones. */
static double *random_values(size_t n, uint64_t seed) {
    double *x = test_numbers(seed, n, -1.0, 1.0);
    for (size_t i = 0; i < n; i++) x[i] = (double)(float)x[i];
    return x;
}

static reference reference_of(sizes s) {
    const size_t count = conv_for(s).windows.count;
    reference r = {.nx = (size_t)s.batch * s.length * s.channels,
                   .nw = (size_t)s.kernel * s.channels * s.outputs,
                   .ny = s.batch * count * s.outputs};
    r.x = random_values(r.nx, 1), r.w = random_values(r.nw, 2);
    r.b = random_values(s.outputs, 3), r.g = random_values(r.ny, 4);
    r.y = TEST_ARRAY(double, r.ny), r.ay = TEST_ARRAY(double, r.ny), r.dx = TEST_ARRAY(double, r.nx),
    r.adx = TEST_ARRAY(double, r.nx);
    r.dw = TEST_ARRAY(double, r.nw), r.adw = TEST_ARRAY(double, r.nw), r.db = TEST_ARRAY(double, s.outputs),
    r.adb = TEST_ARRAY(double, s.outputs);
    for (size_t i = 0; i < r.ny; i++) {
        const size_t o = i % s.outputs, t = i / s.outputs % count, n = i / s.outputs / count;
        r.y[i] = r.b[o], r.ay[i] = fabs(r.b[o]);
        r.db[o] += r.g[i], r.adb[o] += fabs(r.g[i]);
        for (size_t j = 0; j < s.kernel; j++) {
            const size_t at = t * s.stride + j;
            if (at < s.padding || at - s.padding >= s.length) continue;
            for (size_t c = 0; c < s.channels; c++) {
                const size_t ix = (n * s.length + at - s.padding) * s.channels + c;
                const size_t iw = (j * s.channels + c) * s.outputs + o;
                r.y[i] += r.x[ix] * r.w[iw], r.ay[i] += fabs(r.x[ix] * r.w[iw]);
                r.dx[ix] += r.g[i] * r.w[iw], r.adx[ix] += fabs(r.g[i] * r.w[iw]);
                r.dw[iw] += r.g[i] * r.x[ix], r.adw[iw] += fabs(r.g[i] * r.x[ix]);
            }
        }
    }
    return r;
}

/* ---- memory of exactly the needed size, so that a sanitizer sees accesses beyond it ---- */

static void *typed(const lg_kernels *k, const double *x, size_t n) {
    void *y = lg_test_memory(n * k->size);
    if (x != NULL) k->convert_in(n, x, y);
    return y;
}

/* `y` must be `expected` plus `shift`, up to the rounding of a sum of n terms. */
static void assert_numbers(const lg_kernels *k, const char *what, size_t i, size_t n, const void *y,
                           const double *expected, const double *sum, double shift) {
    const double epsilon = k->dtype == LG_F64 ? DBL_EPSILON : (double)FLT_EPSILON;
    double *got = TEST_ARRAY(double, n);
    k->convert_out(n, y, got);
    for (size_t j = 0; j < n; j++)
        if (!lg_is_close(got[j], expected[j] + shift, 0.0, 12 * epsilon * (sum[j] + fabs(shift))))
            fail_msg("%s of shape %zu, element %zu: %.9g, expected %.9g (%s, set %d)", what, i, j, got[j],
                     expected[j] + shift, k->dtype == LG_F64 ? "f64" : "f32", (int)k->isa);
}

/* ---- convolution kernels ---- */

/* Kernels first overwrite memory that holds other numbers, then add to it. */
static void check_convolution(const lg_kernels *k, size_t i) {
    const sizes s = sizes_of(i);
    const lg_conv c = conv_for(s);
    reference r = reference_of(s);
    void *x = typed(k, r.x, r.nx), *w = typed(k, r.w, r.nw), *b = typed(k, r.b, s.outputs);
    void *g = typed(k, r.g, r.ny), *y = typed(k, NULL, r.ny), *wt = typed(k, NULL, r.nw);
    void *dx = typed(k, NULL, r.nx), *dw = typed(k, NULL, r.nw), *db = typed(k, NULL, s.outputs);
    void *s0 = typed(k, NULL, lg_conv_scratch(&c)), *s1 = typed(k, NULL, lg_conv_input_scratch(&c));
    void *s2 = typed(k, NULL, lg_conv_weight_scratch(&c)),
         *s3 = typed(k, NULL, LG_CONV_BIAS_SCRATCH * c.outputs);
    k->transpose((size_t)s.kernel * s.channels, s.outputs, w, wt);
    k->fill(r.ny, NAN, y), k->fill(lg_conv_scratch(&c), NAN, s0);
    lg_conv_apply(k, &c, x, w, b, LG_K_IDENTITY, NULL, y, s0);
    assert_numbers(k, "convolution", i, r.ny, y, r.y, r.ay, 0.0);
    for (int add = 0; add < 2; add++) {
        const double start = add ? 2.5 : NAN, shift = add ? 2.5 : 0.0;
        k->fill(r.nx, start, dx), k->fill(r.nw, start, dw), k->fill(s.outputs, start, db);
        lg_conv_input(k, &c, g, wt, dx, add, s1);
        lg_conv_weight(k, &c, x, g, dw, add, s2);
        lg_conv_bias(k, &c, g, db, add, s3);
        assert_numbers(k, "cotangent of x", i, r.nx, dx, r.dx, r.adx, shift);
        assert_numbers(k, "cotangent of w", i, r.nw, dw, r.dw, r.adw, shift);
        assert_numbers(k, "cotangent of the bias", i, s.outputs, db, r.db, r.adb, shift);
    }
}

TEST_EVERY_TABLE("convolution agrees with plain loops", k) {
    for (size_t i = 0; i < SHAPES; i++) check_convolution(k, i);
}

/* ---- pooling kernels ---- */

/* The row of the window's maximum. Of equal numbers the first counts; NaN counts as larger than all
 * numbers. */
static size_t argmax(const double *x, size_t size, size_t step) {
    size_t best = 0;
    for (size_t j = 1; j < size; j++) {
        const double now = x[best * step], next = x[j * step];
        if (!isnan(now) && (isnan(next) || next > now)) best = j;
    }
    return best;
}

static void check_pooling(const lg_kernels *k, size_t i) {
    const sizes s = sizes_of(i);
    lg_k_windows w = {.length = s.length, .channels = s.channels, .size = s.kernel, .stride = s.stride};
    if (!lg_windows_count(&w)) return;
    const size_t n = s.channels, nx = s.batch * s.length * n, ny = s.batch * w.count * n;
    double *x = random_values(nx, 1), *h = random_values(nx, 2), *g = random_values(ny, 3);
    for (size_t j = 0; j < nx; j++) x[j] = floor(3.0 * x[j]); /* many numbers are equal */
    if (nx > 3) x[nx / 2] = NAN, x[nx / 3] = INFINITY, x[nx - 1] = NAN;
    double *mean = TEST_ARRAY(double, ny), *amean = TEST_ARRAY(double, ny), *spread = TEST_ARRAY(double, nx),
           *aspread = TEST_ARRAY(double, nx);
    double *pick = TEST_ARRAY(double, ny), *place = TEST_ARRAY(double, nx);
    for (size_t j = 0; j < ny; j++) {
        const size_t c = j % n, t = j / n % w.count, b = j / n / w.count,
                     at = (b * s.length + t * s.stride) * n + c;
        for (size_t q = 0; q < s.kernel; q++) {
            mean[j] += h[at + q * n] / s.kernel, amean[j] += fabs(h[at + q * n]) / s.kernel;
            spread[at + q * n] += g[j] / s.kernel, aspread[at + q * n] += fabs(g[j]) / s.kernel;
        }
        const size_t found = at + argmax(x + at, s.kernel, n) * n;
        pick[j] = h[found];
        place[found] += g[j];
    }
    void *tx = typed(k, x, nx), *th = typed(k, h, nx), *tg = typed(k, g, ny);
    void *y = typed(k, NULL, ny), *to = typed(k, NULL, nx);
    k->fill(ny, NAN, y);
    k->window_mean(&w, s.batch, th, y);
    assert_numbers(k, "mean", i, ny, y, mean, amean, 0.0);
    k->window_pick(&w, s.batch, th, tx, y);
    assert_numbers(k, "pick", i, ny, y, pick, amean, 0.0);
    for (int add = 0; add < 2; add++) {
        const double start = add ? 2.5 : NAN, shift = add ? 2.5 : 0.0;
        k->fill(nx, start, to);
        k->window_fold(&w, s.batch, 1.0 / s.kernel, tg, n, 0, NULL, to, add);
        assert_numbers(k, "spread", i, nx, to, spread, aspread, shift);
        if (!add) {
            k->fill(nx, start, to);
            k->window_fold(&w, s.batch, 1.0 / s.kernel, tg, n, 0, th, to, false);
            for (size_t j = 0; j < nx; j++) spread[j] *= h[j];
            assert_numbers(k, "spread times h", i, nx, to, spread, aspread, 0.0);
            for (size_t j = 0; j < nx; j++) spread[j] /= h[j];
        }
        k->fill(nx, start, to);
        k->window_place(&w, s.batch, tg, tx, to, add);
        for (size_t j = 0; j < nx; j++) aspread[j] += fabs(place[j]);
        assert_numbers(k, "place", i, nx, to, place, aspread, shift);
    }
}

TEST_EVERY_TABLE("pooling agrees with plain loops", k) {
    for (size_t i = 0; i < SHAPES; i++) check_pooling(k, i);
}

/* ---- operations of the tape ---- */

static void check_on_tape(lg_dtype dtype, size_t i) {
    const lg_kernels *k = lg_kernels_for(dtype);
    const sizes s = sizes_of(i);
    const uint32_t count = (uint32_t)conv_for(s).windows.count;
    reference r = reference_of(s);
    lg_tape *tape = test_tape(dtype);
    lg_var wrt[3] = {lg_input_f64(tape, lg_shape3(s.batch, s.length, s.channels), r.x),
                     lg_input_f64(tape, lg_shape3(s.kernel, s.channels, s.outputs), r.w),
                     lg_input_f64(tape, lg_shape1(s.outputs), r.b)};
    const lg_var g = lg_input_f64(tape, lg_shape3(s.batch, count, s.outputs), r.g);
    const lg_var y = lg_conv1d_dense(tape, wrt[0], wrt[1], wrt[2], s.stride, s.padding, LG_IDENTITY);
    assert_ok(lg_tape_status(tape));
    assert_numbers(k, "lg_conv1d_dense", i, r.ny, lg_value(tape, y), r.y, r.ay, 0.0);
    void *const grad[3] = {typed(k, NULL, r.nx), typed(k, NULL, r.nw), typed(k, NULL, s.outputs)};
    assert_ok(lg_backward_set(tape, lg_sum(tape, lg_mul(tape, y, g)), wrt, 3, grad));
    assert_numbers(k, "dx", i, r.nx, grad[0], r.dx, r.adx, 0.0);
    assert_numbers(k, "dw", i, r.nw, grad[1], r.dw, r.adw, 0.0);
    assert_numbers(k, "db", i, s.outputs, grad[2], r.db, r.adb, 0.0);
}

TEST("operations and their cotangents agree with plain loops") {
    for (size_t i = 0; i < SHAPES; i++) {
        check_on_tape(LG_F64, i);
        check_on_tape(LG_F32, i);
    }
}

/* x (2, 20, 3), w (4, 3, 5), stride 2, padding 1: the convolution is (2, 10, 5). */
static lg_var composed(lg_tape *tape, const lg_var *in, lg_activation kind, uint32_t size, uint32_t step) {
    const lg_var z = lg_add(tape, lg_conv1d(tape, in[0], in[1], 2, 1), in[2]);
    return lg_avg_pool1d(tape, lg_act(tape, z, kind), size, step);
}

static void check_block(const reference *r, lg_activation kind, uint32_t size, uint32_t step) {
    const uint32_t count = (10 - size) / step + 1, ny = 2 * count * 5;
    const size_t n[3] = {r->nx, r->nw, 5};
    double y[2][100], grad[2][3][120];
    for (int way = 0; way < 2; way++) {
        lg_tape *tape = test_tape(LG_F64);
        const lg_var in[3] = {lg_input_f64(tape, lg_shape3(2, 20, 3), r->x),
                              lg_input_f64(tape, lg_shape3(4, 3, 5), r->w),
                              lg_input_f64(tape, lg_shape1(5), r->b)};
        const lg_var g = lg_input_f64(tape, lg_shape3(2, count, 5), r->g);
        const lg_var z = way == 0 ? lg_conv1d_pooled(tape, in[0], in[1], in[2], 2, 1, kind, size, step)
                                  : composed(tape, in, kind, size, step);
        void *const to[3] = {grad[way][0], grad[way][1], grad[way][2]};
        assert_ok(lg_read(tape, z, ny, y[way]));
        assert_ok(lg_backward_set(tape, lg_sum(tape, lg_mul(tape, z, g)), in, 3, to));
    }
    assert_all_close(y[0], y[1], ny, 1e-13, 1e-14);
    for (int k = 0; k < 3; k++) assert_all_close(grad[0][k], grad[1][k], n[k], 1e-12, 1e-13);
}

TEST("the fused node computes the same as convolution, bias, activation and pooling as separate "
     "operations") {
    static const uint32_t pools[][2] = {{1, 1}, {2, 2}, {3, 2}, {3, 1}, {2, 3}, {1, 2}, {10, 1}};
    reference r = reference_of((sizes){2, 20, 3, 4, 5, 2, 1});
    for (int kind = 0; kind < LG_ACTIVATION_COUNT; kind++)
        for (size_t i = 0; i < sizeof pools / sizeof *pools; i++)
            check_block(&r, (lg_activation)kind, pools[i][0], pools[i][1]);
}

TEST_EVERY_TABLE("fused values and slopes equal bias_act and act on every instruction set, also for rows "
                 "that do not fill vectors",
                 k) {
    enum { ROWS = 3, COLS = 37, N = ROWS * COLS };
    double *x = random_values(N, 41), *b = random_values(COLS, 42), *z = TEST_ARRAY(double, N);
    for (size_t j = 0; j < N; j++) z[j] = 6.0 * x[j];
    void *bias = typed(k, b, COLS), *added = typed(k, z, N), *value = typed(k, NULL, N);
    void *d = typed(k, NULL, N), *y = typed(k, NULL, N), *slope = typed(k, NULL, N);
    double *expected = TEST_ARRAY(double, N), *got = TEST_ARRAY(double, N);
    k->bias_act(LG_K_IDENTITY, ROWS, COLS, bias, added);
    for (int kind = 0; kind < LG_K_ACTS; kind++) {
        k->convert_in(N, z, d);
        k->act_slope((lg_k_act)kind, ROWS, COLS, bias, d, y);
        k->act((lg_k_act)kind, 0, N, added, NULL, NULL, value);
        k->act((lg_k_act)kind, 1, N, added, NULL, NULL, slope);
        const void *both[2][2] = {{value, y}, {slope, d}};
        for (int what = 0; what < 2; what++) {
            k->convert_out(N, both[what][0], expected);
            k->convert_out(N, both[what][1], got);
            assert_all_close(got, expected, N, 1e-6 * (k->size == 4), 1e-15);
        }
    }
}

TEST("the bits of a sample's value and cotangent do not depend on the rest of the batch") {
    for (size_t i = 0; i < SHAPES; i++) {
        const sizes s = sizes_of(i);
        const lg_kernels *k = lg_kernels_for(LG_F32);
        reference r = reference_of(s);
        sizes one = s;
        one.batch = 1;
        const lg_conv all = conv_for(s), alone = conv_for(one);
        const size_t nx = (size_t)s.length * s.channels, ny = all.windows.count * s.outputs;
        float *x = typed(k, r.x, r.nx), *w = typed(k, r.w, r.nw), *g = typed(k, r.g, r.ny);
        float *wt = typed(k, NULL, r.nw), *y = typed(k, NULL, r.ny), *y1 = typed(k, NULL, ny);
        float *dx = typed(k, NULL, r.nx), *dx1 = typed(k, NULL, nx);
        void *s0 = typed(k, NULL, lg_conv_scratch(&all)), *s1 = typed(k, NULL, lg_conv_input_scratch(&all));
        k->transpose((size_t)s.kernel * s.channels, s.outputs, w, wt);
        lg_conv_apply(k, &all, x, w, NULL, LG_K_TANH, NULL, y, s0);
        lg_conv_input(k, &all, g, wt, dx, false, s1);
        for (size_t b = 0; b < s.batch; b++) {
            lg_conv_apply(k, &alone, x + b * nx, w, NULL, LG_K_TANH, NULL, y1, s0);
            lg_conv_input(k, &alone, g + b * ny, wt, dx1, false, s1);
            assert_memory_equal(y1, y + b * ny, ny * sizeof *y);
            assert_memory_equal(dx1, dx + b * nx, nx * sizeof *dx);
        }
    }
}

/* NaN and infinities reach only the windows that contain them; a maximum returns NaN and infinities. */
TEST("numbers that are not finite affect only the windows that contain them") {
    double x[2 * 9] = {0};
    for (int i = 0; i < 18; i++) x[i] = i % 5;
    x[2 * 4] = NAN;          /* time 4, channel 0 */
    x[2 * 6 + 1] = INFINITY; /* time 6, channel 1 */
    const double w[3 * 2] = {1, 1, 1, 1, 1, 1};
    lg_tape *tape = test_tape(LG_F64);
    const lg_var in = lg_input_f64(tape, lg_shape3(1, 9, 2), x);
    const double *y = lg_value(tape, lg_conv1d(tape, in, lg_input_f64(tape, lg_shape3(3, 2, 1), w), 1, 0));
    const double *mean = lg_value(tape, lg_avg_pool1d(tape, in, 3, 1));
    const double *max = lg_value(tape, lg_max_pool1d(tape, in, 3, 1));
    assert_true(y != NULL && mean != NULL && max != NULL);
    for (int t = 0; t < 7; t++) {
        const bool nan = t >= 2 && t <= 4, infinite = t >= 4;
        assert_true(isnan(y[t]) == nan);
        if (infinite && !nan) assert_true(isinf(y[t]));
        if (!infinite && !nan) assert_true(isfinite(y[t]));
        assert_true(isnan(mean[2 * t]) == nan && isnan(max[2 * t]) == nan);
        assert_true(isinf(mean[2 * t + 1]) == infinite && isinf(max[2 * t + 1]) == infinite);
    }
}

/* ---- refused shapes and options ---- */

static const struct {
    lg_shape x, w;
    uint32_t bias, stride, padding; /* bias 0: without bias */
    lg_status status;
} refused[] = {
    {{3, {1, 4, 2, 0}}, {3, {5, 2, 3, 0}}, 0, 1, 0, LG_SHAPE},            /* the kernel is too long */
    {{3, {1, 2, 2, 0}}, {3, {5, 2, 3, 0}}, 0, 1, 1, LG_SHAPE},            /* also with padding */
    {{3, {1, 4, 2, 0}}, {3, {3, 1, 3, 0}}, 0, 1, 0, LG_SHAPE},            /* numbers of channels differ */
    {{2, {4, 2, 0, 0}}, {3, {3, 2, 3, 0}}, 0, 1, 0, LG_SHAPE},            /* rank of x */
    {{3, {1, 4, 2, 0}}, {2, {3, 2, 0, 0}}, 0, 1, 0, LG_SHAPE},            /* rank of w */
    {{3, {1, 4, 2, 0}}, {3, {0, 2, 3, 0}}, 0, 1, 0, LG_SHAPE},            /* an empty kernel */
    {{3, {1, 4, 2, 0}}, {3, {3, 2, 3, 0}}, 2, 1, 0, LG_SHAPE},            /* size of the bias */
    {{3, {1, 4, 2, 0}}, {3, {3, 2, 3, 0}}, 0, 0, 0, LG_INVALID_ARGUMENT}, /* stride */
    {{3, {1, 4, 2, 0}}, {3, {3, 2, 3, 0}}, 0, 1, 3, LG_INVALID_ARGUMENT}, /* padding */
    {{3, {1, 4, 2, 0}}, {3, {3, 2, 3, 0}}, 0, 1, UINT32_MAX, LG_INVALID_ARGUMENT},
};

TEST("shapes, strides and paddings that do not fit are refused") {
    lg_tape *tape = test_tape(LG_F64);
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        for (int kind = LG_IDENTITY; kind <= LG_TANH; kind++) {
            lg_tape_reset(tape);
            const lg_var x = lg_full(tape, refused[i].x, 1.0), w = lg_full(tape, refused[i].w, 1.0);
            const lg_var b = refused[i].bias > 0 ? lg_full(tape, lg_shape1(refused[i].bias), 1.0) : LG_NONE;
            const lg_var y =
                lg_conv1d_dense(tape, x, w, b, refused[i].stride, refused[i].padding, (lg_activation)kind);
            assert_true(lg_is_none(y));
            assert_status(lg_tape_status(tape), refused[i].status);
            assert_says(lg_tape_message(tape), "conv1d");
        }
    lg_var (*const pools[2])(lg_tape *, lg_var, uint32_t, uint32_t) = {lg_avg_pool1d, lg_max_pool1d};
    static const struct {
        uint32_t rank, size, stride;
        lg_status status;
    } bad[] = {{3, 5, 1, LG_SHAPE},
               {2, 2, 2, LG_SHAPE},
               {3, 0, 1, LG_INVALID_ARGUMENT},
               {3, 2, 0, LG_INVALID_ARGUMENT},
               {3, UINT32_MAX, UINT32_MAX, LG_SHAPE}};
    for (int p = 0; p < 2; p++)
        for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
            lg_tape_reset(tape);
            lg_shape shape = {bad[i].rank, {2, 4, bad[i].rank == 3 ? 3 : 0, 0}};
            assert_true(lg_is_none(pools[p](tape, lg_full(tape, shape, 1.0), bad[i].size, bad[i].stride)));
            assert_status(lg_tape_status(tape), bad[i].status);
        }
    for (int p = 0; p < 3; p++) { /* pooling windows: too long, of size 0, stride 0 */
        lg_tape_reset(tape);
        const lg_var in = lg_full(tape, lg_shape3(1, 4, 2), 1.0), w = lg_full(tape, lg_shape3(2, 2, 3), 1.0);
        assert_true(lg_is_none(lg_conv1d_pooled(tape, in, w, LG_NONE, 1, 0, LG_TANH,
                                                p == 0   ? 4
                                                : p == 1 ? 0
                                                         : 2,
                                                p == 2 ? 0 : 1)));
        assert_status(lg_tape_status(tape), p == 0 ? LG_SHAPE : LG_INVALID_ARGUMENT);
    }
    lg_tape_reset(tape);
    const lg_var x = lg_full(tape, lg_shape3(1, 4, 2), 1.0);
    assert_true(lg_is_none(lg_conv1d(tape, x, LG_NONE, 1, 0)));
    assert_status(lg_tape_status(tape), LG_STALE_HANDLE);
    lg_tape_reset(tape);
    assert_true(lg_is_none(lg_conv1d_dense(tape, x, x, LG_NONE, 1, 0, (lg_activation)LG_ACTIVATION_COUNT)));
    assert_status(lg_tape_status(tape), LG_INVALID_ARGUMENT);
}

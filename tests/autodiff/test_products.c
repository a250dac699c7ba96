/* ctest-labels: isa threads */
/* Dense products on the tape. Each way to compute them (own kernel, stored transpose, transposed product,
 * BLAS) is compared with a plain loop, and must give the same bits for any number of threads. */
#include "support/fixtures.h"

#include "liegrad/core.h"
#include "liegrad/ops.h"

typedef struct shape {
    uint32_t m, n, k;
} shape;

/* Sizes around the limits between the ways: not split, split by columns and by rows, B small and large for
 * nt, few and many rows; the last one is too large for the own kernel. */
static const shape shapes[] = {{1, 1, 1},       {3, 5, 7},      {20, 100, 100},
                               {33, 101, 97},   {32, 300, 301}, {500, 100, 60},
                               {130, 300, 300}, {7, 700, 129},  {1009, 997, 1013}};

/* op(A) op(B), and both gradients of its weighted sum: (m n + m k + k n) numbers. */
static double *evaluate(shape s, int variant, const double *a, const double *b, lg_dtype dtype, int threads) {
    static lg_var (*const functions[3])(lg_tape *, lg_var, lg_var) = {lg_matmul, lg_matmul_nt, lg_matmul_tn};
    const size_t mn = (size_t)s.m * s.n, mk = (size_t)s.m * s.k, kn = (size_t)s.k * s.n;
    const size_t bytes = dtype == LG_F64 ? sizeof(double) : sizeof(float);
    double *out = TEST_ARRAY(double, mn + mk + kn);
    lg_tape_options options;
    lg_tape *tape;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    options.threads = threads;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    const lg_var wrt[2] = {lg_input_f64(tape, variant == 2 ? lg_shape2(s.k, s.m) : lg_shape2(s.m, s.k), a),
                           lg_input_f64(tape, variant == 1 ? lg_shape2(s.n, s.k) : lg_shape2(s.k, s.n), b)};
    lg_var c = functions[variant](tape, wrt[0], wrt[1]), gradient[2];
    lg_var weighted = lg_mul(tape, c, lg_input_f64(tape, lg_shape2(s.m, s.n), test_numbers(3, mn, -1, 1)));
    assert_ok(lg_grad(tape, weighted, wrt, 2, gradient));
    assert_ok(lg_read(tape, c, mn, out));
    assert_ok(lg_read(tape, gradient[0], mk, out + mn));
    assert_ok(lg_read(tape, gradient[1], kn, out + mn + mk));
    /* Gradients that are not recorded but accumulated in place must be the same numbers. */
    void *const grad[2] = {lg_test_memory(mk * bytes), lg_test_memory(kn * bytes)};
    assert_ok(lg_backward(tape, weighted, wrt, 2, grad));
    assert_memory_equal(grad[0], lg_value(tape, gradient[0]), mk * bytes);
    assert_memory_equal(grad[1], lg_value(tape, gradient[1]), kn * bytes);
    lg_tape_destroy(tape);
    return out;
}

TEST("products agree with plain loops, and have the same bits for any number of threads") {
    /* BLAS runs one thread, as in the executables; the thread sanitizer does not see the threads of BLAS. */
    lg_runtime_setup();
    for (size_t i = 0; i < LG_COUNT(shapes) * 6; i++) {
        const shape s = shapes[i / 6];
        const int variant = (int)(i % 3);
        const lg_dtype dtype = i % 6 < 3 ? LG_F64 : LG_F32;
        const size_t mn = (size_t)s.m * s.n, mk = (size_t)s.m * s.k, kn = (size_t)s.k * s.n;
        const double *a = test_numbers(1, mk, -1, 1), *b = test_numbers(2, kn, -1, 1);
        const double *got = evaluate(s, variant, a, b, dtype, 1);
        for (uint32_t r = 0; r < s.m; r += 1 + s.m / 9)
            for (uint32_t c = 0; c < s.n; c += 1 + s.n / 9) {
                double sum = 0.0, size = 0.0;
                for (uint32_t l = 0; l < s.k; l++) {
                    const double x = a[variant == 2 ? l * s.m + r : r * s.k + l];
                    const double y = b[variant == 1 ? c * s.k + l : l * s.n + c];
                    sum += x * y;
                    size += fabs(x * y);
                }
                assert_close(got[r * s.n + c], sum, 0.0, (dtype == LG_F64 ? 1e-15 : 5e-7) * size * 4.0);
            }
        for (int threads = 2; threads <= 3 && mn < 1000000; threads++) {
            const double *more = evaluate(s, variant, a, b, dtype, threads);
            assert_memory_equal(got, more, (mn + mk + kn) * sizeof *got);
        }
    }
}

TEST("a product has the same bits alone and in a batch") {
    static lg_var (*const functions[3])(lg_tape *, lg_var, lg_var) = {lg_matmul, lg_matmul_nt, lg_matmul_tn};
    enum { BATCH = 9 };
    for (uint32_t i = 0; i < 5 * 5 * 5 * 6; i++) {
        const uint32_t m = i / 6 % 5 + 1, n = i / 30 % 5 + 1, k = i / 150 + 1, variant = i % 3;
        const uint32_t ar = variant == 2 ? k : m, ac = variant == 2 ? m : k, br = variant == 1 ? n : k,
                       bc = variant == 1 ? k : n;
        const double *a = test_numbers(4 + i, BATCH * m * k, -1, 1),
                     *b = test_numbers(5 + i, BATCH * k * n, -1, 1);
        double all[BATCH * 25], one[25];
        lg_tape_options options;
        lg_tape *tape;
        lg_tape_options_init(&options);
        options.dtype = i % 6 < 3 ? LG_F64 : LG_F32;
        assert_ok(lg_tape_create(NULL, &options, &tape));
        const lg_var batch = functions[variant](tape, lg_input_f64(tape, lg_shape3(BATCH, ar, ac), a),
                                                lg_input_f64(tape, lg_shape3(BATCH, br, bc), b));
        assert_ok(lg_read(tape, batch, BATCH * m * n, all));
        for (uint32_t s = 0; s < BATCH; s++) {
            const lg_var alone =
                functions[variant](tape, lg_input_f64(tape, lg_shape3(1, ar, ac), a + s * m * k),
                                   lg_input_f64(tape, lg_shape3(1, br, bc), b + s * k * n));
            assert_ok(lg_read(tape, alone, m * n, one));
            assert_memory_equal(one, all + s * m * n, m * n * sizeof *one);
        }
        lg_tape_destroy(tape);
    }
}

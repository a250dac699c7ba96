/* ctest-labels: threads */
/* Dense products on the tape: every form (own kernel, kept transpose, transposed product, BLAS) against a
 * naive loop, and the same bits whatever the number of threads. */
#include "test_support.h"

#include "liegrad/ops.h"
#include "liegrad/random.h"

typedef lg_var (*product_fn)(lg_tape *, lg_var, lg_var);

static double *random_values(size_t n, uint64_t stream) {
    double *x = malloc(n * sizeof *x);
    lg_rng rng;
    lg_rng_seed(&rng, 8, stream);
    for (size_t i = 0; i < n; i++) x[i] = lg_rng_normal(&rng);
    return x;
}

typedef struct shape {
    uint32_t m, n, k;
} shape;

/* Result of op(A) op(B) and both gradients of its weighted sum, (m n + m k + k n) values. */
static double *evaluate(shape s, int variant, lg_dtype dtype, int threads) {
    static const product_fn functions[3] = {lg_matmul, lg_matmul_nt, lg_matmul_tn};
    const size_t mn = (size_t)s.m * s.n, mk = (size_t)s.m * s.k, kn = (size_t)s.k * s.n;
    double *a = random_values(mk, 1), *b = random_values(kn, 2), *w = random_values(mn, 3);
    double *out = malloc((mn + mk + kn) * sizeof *out);
    lg_tape_options options;
    lg_tape *tape;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    options.threads = threads;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    lg_var va = lg_input_f64(tape, variant == 2 ? lg_shape2(s.k, s.m) : lg_shape2(s.m, s.k), a);
    lg_var vb = lg_input_f64(tape, variant == 1 ? lg_shape2(s.n, s.k) : lg_shape2(s.k, s.n), b);
    lg_var c = functions[variant](tape, va, vb);
    lg_var weighted = lg_mul(tape, c, lg_input_f64(tape, lg_shape2(s.m, s.n), w));
    lg_var wrt[2] = {va, vb}, gradient[2];
    assert_ok(lg_grad(tape, weighted, wrt, 2, gradient));
    assert_ok(lg_read(tape, c, out, mn));
    assert_ok(lg_read(tape, gradient[0], out + mn, mk));
    assert_ok(lg_read(tape, gradient[1], out + mn + mk, kn));
    /* Unrecorded, accumulated in place: the same numbers. */
    float *f[2] = {calloc(mk, sizeof(double)), calloc(kn, sizeof(double))};
    void *const grad[2] = {f[0], f[1]};
    assert_ok(lg_backward(tape, weighted, wrt, 2, grad));
    const size_t bytes = dtype == LG_F64 ? sizeof(double) : sizeof(float);
    assert_memory_equal(f[0], lg_value(tape, gradient[0]), mk * bytes);
    assert_memory_equal(f[1], lg_value(tape, gradient[1]), kn * bytes);
    lg_tape_destroy(tape);
    free(f[0]), free(f[1]), free(a), free(b), free(w);
    return out;
}

/* Around the limits: below the split, split by columns and by rows, B small and large for nt, few and many
 * rows. */
static const shape shapes[] = {{1, 1, 1},      {3, 5, 7},      {20, 100, 100},  {33, 101, 97},
                               {32, 300, 301}, {500, 100, 60}, {130, 300, 300}, {7, 700, 129}};

TEST("products and their gradients are naive loops") {
    for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++)
        for (int variant = 0; variant < 3; variant++)
            for (int d = 0; d < 2; d++) {
                const shape s = shapes[i];
                const size_t mk = (size_t)s.m * s.k, kn = (size_t)s.k * s.n;
                double *a = random_values(mk, 1), *b = random_values(kn, 2);
                double *got = evaluate(s, variant, d == 0 ? LG_F64 : LG_F32, 1);
                for (uint32_t r = 0; r < s.m; r += 1 + s.m / 9)
                    for (uint32_t c = 0; c < s.n; c += 1 + s.n / 9) {
                        double sum = 0.0, size = 0.0;
                        for (uint32_t l = 0; l < s.k; l++) {
                            const double x = a[variant == 2 ? l * s.m + r : r * s.k + l];
                            const double y = b[variant == 1 ? c * s.k + l : l * s.n + c];
                            sum += x * y;
                            size += fabs(x * y);
                        }
                        assert_close(got[r * s.n + c], sum, 0.0, (d == 0 ? 1e-15 : 5e-7) * size * 4.0);
                    }
                free(got), free(a), free(b);
            }
}

TEST("same bits for any number of threads") {
    for (size_t i = 0; i < LG_COUNT(shapes); i++)
        for (int variant = 0; variant < 3; variant++)
            for (int d = 0; d < 2; d++) {
                const shape s = shapes[i];
                const size_t values = (size_t)s.m * s.n + (size_t)s.m * s.k + (size_t)s.k * s.n;
                double *one = evaluate(s, variant, d == 0 ? LG_F64 : LG_F32, 1);
                for (int threads = 2; threads <= 3; threads++) {
                    double *more = evaluate(s, variant, d == 0 ? LG_F64 : LG_F32, threads);
                    assert_memory_equal(one, more, values * sizeof *one);
                    free(more);
                }
                free(one);
            }
}

TEST("numbers of threads that cannot be are refused") {
    lg_tape_options options;
    lg_tape *tape;
    lg_tape_options_init(&options);
    options.threads = 0;
    assert_status(lg_tape_create(NULL, &options, &tape), LG_INVALID_ARGUMENT);
    options.threads = 1025;
    assert_status(lg_tape_create(NULL, &options, &tape), LG_INVALID_ARGUMENT);
}

/* Objects that the running test owns and releases when it ends. */
#ifndef LG_FIXTURES_H
#define LG_FIXTURES_H

#include "test_support.h"

#include "liegrad/core.h"
#include "liegrad/integrators.h"
#include "liegrad/taped.h"
#include "support/fail_alloc.h"

/* FIELD(name, y) { ... } defines a field, or one part of a split field, that computes `out` from t and y and
 * cannot fail. */
#define FIELD(name, y)                                                                                       \
    static void name##_at(void *, double, const double *, const double *, double *);                         \
    static lg_status name(void *user, double t, const double *y, const double *input, double *out) {         \
        name##_at(user, t, y, input, out);                                                                   \
        return LG_OK;                                                                                        \
    }                                                                                                        \
    static void name##_at(void *user, double t, const double *y, const double *input, double *out)

/* A step of size h from t, for lg_taped_step. */
#define OVER(t_, h_) (&(lg_taped_interval){.t = {.value = (t_)}, .h = (h_)})

/* As FIELD, on a tape, from the parts of y. */
#define TAPED_FIELD(name)                                                                                    \
    static void name##_on_tape(void *, lg_tape *, lg_taped_time, const lg_var *, lg_var, lg_var *);          \
    static lg_status name(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,         \
                          lg_var *out) {                                                                     \
        name##_on_tape(user, tape, t, y, input, out);                                                        \
        return lg_tape_status(tape);                                                                         \
    }                                                                                                        \
    static void name##_on_tape(void *user, lg_tape *tape, lg_taped_time t, const lg_var *y, lg_var input,    \
                               lg_var *out)

/* All names must differ, and the name of any number beyond the enumeration must be "unknown". */
#define ASSERT_NAMES(type, prefix, count)                                                                    \
    do {                                                                                                     \
        for (int i_ = 0; i_ <= (int)(count); i_++)                                                           \
            for (int j_ = 0; j_ < i_; j_++)                                                                  \
                assert_string_not_equal(prefix##_name((type)i_), prefix##_name((type)j_));                   \
        assert_string_equal(prefix##_name((type)(count)), "unknown");                                        \
    } while (0)

/* Defines own_TYPE(value): copies the value; when the running test ends, destroy(copy) frees what the copy
 * holds. */
#define OWNED(type, destroy)                                                                                 \
    static inline void release_##type(void *value) {                                                         \
        destroy(value);                                                                                      \
    }                                                                                                        \
    static inline type *own_##type(type value) {                                                             \
        type *copy = TEST_ARRAY(type, 1);                                                                    \
        *copy = value;                                                                                       \
        lg_test_owns(copy, release_##type);                                                                  \
        return copy;                                                                                         \
    }

/* The same of a file structure of a kind of model. */
#define OWNED_FILE(kind)                                                                                     \
    static inline void destroy_##kind##_file(void *file) {                                                   \
        lg_recipe_release(&lg_recipe_##kind, file);                                                          \
    }                                                                                                        \
    OWNED(lg_##kind##_file, destroy_##kind##_file)

RELEASES(release_context, lg_context_destroy)
RELEASES(release_tape, lg_tape_destroy)

static inline lg_tape *test_tape(lg_dtype dtype) {
    lg_tape_options options;
    lg_tape *tape = NULL;
    lg_tape_options_init(&options);
    options.dtype = dtype;
    assert_ok(lg_tape_create(NULL, &options, &tape));
    lg_test_owns(tape, release_tape);
    return tape;
}

/* Fails unless the variable has these `n` numbers. */
#define assert_reads(tape, v, n, expected, rtol, atol)                                                       \
    do {                                                                                                     \
        double *const lg_read_ = TEST_ARRAY(double, n);                                                      \
        assert_ok(lg_read(tape, v, n, lg_read_));                                                            \
        lg_all_close(#v, lg_read_, (expected), (n), (rtol), (atol), __FILE__, __LINE__);                     \
    } while (0)

/* `n` random numbers from [low, high]. */
static inline double *test_numbers(uint64_t seed, size_t n, double low, double high) {
    double *x = TEST_ARRAY(double, n);
    lg_rng rng = test_rng(seed, 0);
    for (size_t i = 0; i < n; i++) x[i] = lg_rng_uniform_in(&rng, low, high);
    return x;
}

/* The derivatives of the `count` numbers that f(user, x, y) computes from x, with respect to x[i]. Central
 * differences with steps h, h/2, ..., extrapolated `levels` - 1 times; use one level for functions with
 * kinks. x is restored. */
static inline void test_slope(void (*f)(const void *user, const double *x, double *y), const void *user,
                              double *x, size_t i, double h, int levels, size_t count, double *out) {
    const size_t mark = lg_test_owned();
    const double kept = x[i];
    double *table = TEST_ARRAY(double, (size_t)levels *count), *down = TEST_ARRAY(double, count);
    for (int level = 0; level < levels; level++) {
        double *row = table + (size_t)level * count;
        const double step = ldexp(h, -level);
        x[i] = kept + step;
        f(user, x, row);
        x[i] = kept - step;
        f(user, x, down);
        for (size_t o = 0; o < count; o++) row[o] = (row[o] - down[o]) / (2.0 * step);
    }
    x[i] = kept;
    for (int order = 1; order < levels; order++)
        for (size_t at = (size_t)levels * count; at-- > (size_t)order * count;)
            table[at] += (table[at] - table[at - count]) / (ldexp(1.0, 2 * order) - 1.0);
    memcpy(out, table + (size_t)(levels - 1) * count, count * sizeof *out);
    lg_test_give_back(mark);
}

RELEASES(release_stepper, lg_stepper_destroy)

static inline lg_stepper *test_stepper(const lg_scheme *scheme, const lg_ode *ode) {
    lg_stepper *stepper = NULL;
    assert_ok(lg_stepper_create(NULL, scheme, ode, &stepper));
    lg_test_owns(stepper, release_stepper);
    return stepper;
}

/* Work memory of the running test, full of NaN, at an address divisible by 64. When the test ends, the 64
 * bytes after it must be unchanged. */
static inline void release_work(void *block) {
    size_t bytes;
    memcpy(&bytes, block, sizeof bytes);
    const unsigned char *behind = (const unsigned char *)block + 64 + bytes;
    bool kept = true;
    for (size_t i = 0; i < 64; i++) kept = kept && behind[i] == 0xff;
    free(block);
    if (!kept) fail_msg("something wrote behind %zu bytes of work memory", bytes);
}

static inline void *test_work(size_t bytes) {
    void *block = NULL;
    assert_int_equal(posix_memalign(&block, 64, bytes + 128), 0);
    memset(block, 0xff, bytes + 128);
    memcpy(block, &bytes, sizeof bytes);
    lg_test_owns(block, release_work);
    return (unsigned char *)block + 64;
}

/* Runs a block, which sets `status`, with every allocation of `context` failing in turn. `status` must be
 * LG_OUT_OF_MEMORY each time until all allocations, at least `least`, have failed once; then LG_OK. The block
 * must free all memory that it allocates, so nothing may leak. */
#define EVERY_ALLOCATION_FAILS(context, least, ...)                                                          \
    do {                                                                                                     \
        lg_fail_alloc memory_;                                                                               \
        if (lg_test_faulty()) skip();                                                                        \
        lg_context *context = lg_fail_alloc_context(&memory_);                                               \
        bool hit_ = true;                                                                                    \
        assert_non_null(context);                                                                            \
        for (long n_ = 1; hit_; n_++) {                                                                      \
            lg_status status = LG_CHECK_FAILED;                                                              \
            lg_fail_alloc_arm(&memory_, n_);                                                                 \
            __VA_ARGS__                                                                                      \
            hit_ = lg_fail_alloc_hit(&memory_);                                                              \
            assert_int_equal(lg_fail_alloc_live(&memory_), 0);                                               \
            assert_status(status, hit_ ? LG_OUT_OF_MEMORY : LG_OK);                                          \
            assert_true(hit_ || n_ > (least));                                                               \
        }                                                                                                    \
        lg_fail_alloc_arm(&memory_, 0);                                                                      \
        lg_context_destroy(context);                                                                         \
    } while (0)

#endif

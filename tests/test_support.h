/* Included by every test: cmocka, the TEST macro, and comparisons of doubles that fail for NaN. cmocka's own
 * assert_float_equal is not used, because it compares floats and lets NaN pass. */
#ifndef LG_TEST_SUPPORT_H
#define LG_TEST_SUPPORT_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "core/count.h"
#include "liegrad/core.h"

/* TEST("claim") { ... } defines and registers a test; the claim says what must hold. A file of tests is a
 * suite. support/run_tests.c runs the tests of the suite that the first argument names, in the order of the
 * file. */
typedef void (*lg_test_body)(void);
enum { LG_MOST_TESTS = 128 };

typedef struct lg_suite {
    const char *file;
    CMFixtureFunction begin, end;
    size_t count;
    lg_test_body bodies[LG_MOST_TESTS];
    struct CMUnitTest tests[LG_MOST_TESTS];
    struct lg_suite *next;
} lg_suite;
static lg_suite lg_suite_here __attribute__((unused)) = {.file = __BASE_FILE__};
void lg_test_enter(lg_suite *suite, const char *claim, lg_test_body body);

/* Gives `object` to the running test: release(object) is called when the test ends or fails. The object that
 * was given last is released first. */
void lg_test_owns(void *object, void (*release)(void *));

/* Defines the function name(object), which calls destroy(object). For lg_test_owns. */
#define RELEASES(name, destroy)                                                                              \
    static inline void name(void *object) {                                                                  \
        destroy(object);                                                                                     \
    }

/* Releases the objects that the test was given since lg_test_owned() returned `mark`. For loops whose rounds
 * each take much memory. */
size_t lg_test_owned(void);
void lg_test_give_back(size_t mark);

/* Zeroed memory, owned by the running test and aligned to 64 bytes. */
void *lg_test_memory(size_t bytes);
#define TEST_ARRAY(type, count) ((type *)lg_test_memory((count) * sizeof(type)))

/* Zeroed memory that a function of the library will release with lg_free. This allocation never fails
 * (faults.h). */
void *lg_test_gives(size_t count, size_t size);

/* A formatted text, owned by the running test. */
char *test_text(const char *format, ...) __attribute__((format(printf, 1, 2)));

static inline lg_rng test_rng(uint64_t seed, uint64_t stream) {
    lg_rng rng;
    lg_rng_seed(&rng, seed, stream);
    return rng;
}

#define TEST(claim)             LG_TEST_AT(claim, __LINE__)
#define LG_TEST_AT(claim, line) LG_TEST_NAMED(claim, line)
#define LG_TEST_NAMED(claim, line)                                                                           \
    static void lg_test_##line(void);                                                                        \
    __attribute__((constructor)) static void lg_enter_##line(void) {                                         \
        lg_test_enter(&lg_suite_here, claim, lg_test_##line);                                                \
    }                                                                                                        \
    static void lg_test_##line(void)

/* begin() runs before the tests of a file and end() after them; either may be NULL. */
#define TEST_GROUP(first, last)                                                                              \
    __attribute__((constructor)) static void lg_enter_group(void) {                                          \
        lg_suite_here.begin = first;                                                                         \
        lg_suite_here.end = last;                                                                            \
    }

/* |a - e| <= atol + rtol |e|. False when either is NaN. Infinities are close only when they are equal. */
static inline bool lg_is_close(double a, double e, double rtol, double atol) {
    if (a == e) return true;
    return isfinite(e) && fabs(a - e) <= atol + rtol * fabs(e);
}

#define assert_close(a, e, rtol, atol)                                                                       \
    do {                                                                                                     \
        const double lg_a_ = (a), lg_e_ = (e);                                                               \
        if (!lg_is_close(lg_a_, lg_e_, (rtol), (atol)))                                                      \
            fail_msg("%s = %.17g, expected %s = %.17g (difference %.3g)", #a, lg_a_, #e, lg_e_,              \
                     lg_a_ - lg_e_);                                                                         \
    } while (0)

/* Compares `n` numbers; a failure says which one is wrong. */
#define assert_all_close(a, e, n, rtol, atol)                                                                \
    lg_all_close(#a, (a), (e), (n), (rtol), (atol), __FILE__, __LINE__)

static inline void lg_all_close(const char *name, const double *a, const double *e, size_t n, double rtol,
                                double atol, const char *file, int line) {
    for (size_t i = 0; i < n; i++) {
        if (lg_is_close(a[i], e[i], rtol, atol)) continue;
        print_error("ERROR: %s: number %zu is %.17g, expected %.17g (difference %.3g)\n", name, i, a[i], e[i],
                    a[i] - e[i]);
        _fail(file, line);
    }
}

/* Fails unless `text` contains `part`. */
#define assert_says(text, part)                                                                              \
    do {                                                                                                     \
        const char *const lg_text_ = (text), *const lg_part_ = (part);                                       \
        if (strstr(lg_text_, lg_part_) == NULL) fail_msg("'%s' is not in: %s", lg_part_, lg_text_);          \
    } while (0)

/* Whether to make a call again: it returned LG_OUT_OF_MEMORY because run_faults.h made an allocation fail.
 * The second call has enough memory and must succeed as the test says. True once per run; always false
 * without run_faults.h. */
bool lg_test_again(lg_status status);
/* Whether the tests run with failing calls (run_faults.h). */
bool lg_test_faulty(void);

#define LG_STATUS_OF(call, s)                                                                                \
    lg_status s;                                                                                             \
    do s = (call);                                                                                           \
    while (lg_test_again(s))

#define assert_ok(call)                                                                                      \
    do {                                                                                                     \
        LG_STATUS_OF(call, lg_s_);                                                                           \
        if (lg_s_ != LG_OK) fail_msg("%s: %s", #call, lg_status_name(lg_s_));                                \
    } while (0)

/* Fails unless the call, which may use &told as its lg_error, returns LG_OK; then prints told's message. */
#define assert_told(call)                                                                                    \
    do {                                                                                                     \
        lg_error told = {LG_OK, ""};                                                                         \
        LG_STATUS_OF(call, lg_s_);                                                                           \
        if (lg_s_ != LG_OK) fail_msg("%s", told.message);                                                    \
    } while (0)

#define assert_status(call, expected)                                                                        \
    do {                                                                                                     \
        LG_STATUS_OF(call, lg_s_);                                                                           \
        if (lg_s_ != (expected))                                                                             \
            fail_msg("%s: %s, expected %s", #call, lg_status_name(lg_s_), lg_status_name(expected));         \
    } while (0)

/* Slope of the least-squares line through points. */
typedef struct fit_line {
    double n, sx, sy, sxx, sxy;
} fit_line;

static inline void fit_add(fit_line *f, double x, double y) {
    f->n++, f->sx += x, f->sy += y, f->sxx += x * x, f->sxy += x * y;
}

static inline double fit_slope(const fit_line *f) {
    return (f->n * f->sxy - f->sx * f->sy) / (f->n * f->sxx - f->sx * f->sx);
}

#endif

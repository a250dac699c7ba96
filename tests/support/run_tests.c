/* The main function of a room's executable. The arguments are [--faults ...] SUITE [CLAIM]: it runs the tests
 * of one file, or only the tests whose claims match CLAIM (* and ? are wildcards). --faults: run_faults.h.
 * LG_TEST_LOCALE names the locale of the process. */
#include <locale.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "core/core.h"
#include "support/faults.h"
#include "support/run_faults.h"
#include "test_support.h"

enum { MOST_OWNED = 1 << 16 };

static lg_suite *suites, *running;

static struct {
    void *object;
    void (*release)(void *);
} owned[MOST_OWNED];
static size_t owned_count;

size_t lg_test_owned(void) {
    return owned_count;
}

void lg_test_give_back(size_t mark) {
    while (owned_count > mark) {
        owned_count--;
        owned[owned_count].release(owned[owned_count].object);
    }
}

static bool passed; /* the test that ran last has run to its end */

static void run_body(void **state) {
    passed = false;
    run_faults_begin();
    (*(lg_test_body *)*state)();
    passed = true;
}

/* Runs after every test, also after a failed one. If LG_FIRST_FAILURE is set, a failed test ends the program
 * (used by scripts/mutants). */
static int release_owned(void **state) {
    (void)state;
    lg_test_give_back(0);
    run_faults_end(passed);
    if (passed || getenv("LG_FIRST_FAILURE") == NULL) return 0;
    if (running->end != NULL) (void)running->end(NULL);
    exit(1);
}

void lg_test_enter(lg_suite *suite, const char *claim, lg_test_body body) {
    const size_t i = suite->count++;
    if (i == LG_MOST_TESTS) abort();
    suite->bodies[i] = body;
    suite->tests[i] = (struct CMUnitTest){claim, run_body, NULL, release_owned, &suite->bodies[i]};
    if (i > 0) return;
    suite->next = suites;
    suites = suite;
}

void lg_test_owns(void *object, void (*release)(void *)) {
    assert_non_null(object);
    assert_true(owned_count < MOST_OWNED);
    owned[owned_count].object = object;
    owned[owned_count].release = release;
    owned_count++;
}

void *lg_test_memory(size_t bytes) {
    void *memory = NULL;
    assert_int_equal(posix_memalign(&memory, 64, bytes > 0 ? bytes : 1), 0);
    lg_test_owns(memory, free);
    return memset(memory, 0, bytes);
}

void *lg_test_gives(size_t count, size_t size) {
    faults_spare(true);
    void *memory = lg_alloc(NULL, count, size);
    faults_spare(false);
    assert_non_null(memory);
    return memory;
}

char *test_text(const char *format, ...) {
    va_list first, second;
    va_start(first, format);
    va_copy(second, first);
    const int length = lg_format_list(NULL, 0, format, first);
    char *text = lg_test_memory((size_t)length + 1);
    (void)lg_format_list(text, (size_t)length + 1, format, second);
    va_end(second);
    va_end(first);
    return text;
}

/* HDF5 1.10 leaks a block of its internal free list when a damaged header makes H5Fopen fail. Objects that we
 * forget to close are found by scratch_end (support/io_test.h) instead. */
__attribute__((visibility("default"))) const char *__lsan_default_suppressions(void);
const char *__lsan_default_suppressions(void) {
    return "leak:libhdf5";
}

/* Whether the suite's file is folder/NAME.c, where `name` is NAME. */
static bool is_named(const lg_suite *suite, const char *name) {
    const char *slash = strrchr(suite->file, '/'), *file = slash != NULL ? slash + 1 : suite->file;
    const size_t length = strlen(name);
    return strncmp(file, name, length) == 0 && strcmp(file + length, ".c") == 0;
}

int main(int argc, char **argv) {
#ifdef __GLIBC__ /* memory that is given back is kept: fetching its pages again took longer than some tests */
    (void)(mallopt(M_TRIM_THRESHOLD, 1 << 28) && mallopt(M_MMAP_THRESHOLD, 1 << 25));
#endif
    argv += run_faults_options(&argc, argv);
    lg_suite *suite = argc > 1 ? suites : NULL;
    while (suite != NULL && !is_named(suite, argv[1])) suite = suite->next;
    if (suite == NULL) {
        print_error("usage: %s SUITE [CLAIM]; suites are\n", argv[0]);
        for (suite = suites; suite != NULL; suite = suite->next) print_error("%s\n", suite->file);
        return 2;
    }
    running = suite;
    const char *locale = getenv("LG_TEST_LOCALE");
    if (locale != NULL && setlocale(LC_ALL, locale) == NULL) {
        print_error("there is no locale %s\n", locale);
        return 2;
    }
    const char *claim = argc > 2 ? argv[2] : NULL;
    if (run_faults_wanted()) return run_faults(suite, claim);
    if (claim != NULL) cmocka_set_test_filter(claim);
    const int failed = _cmocka_run_group_tests(argv[1], suite->tests, suite->count, suite->begin, NULL);
    return failed != 0 || (suite->end != NULL && suite->end(NULL) != 0);
}

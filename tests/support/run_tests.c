#include "test_support.h"

enum { MOST_TESTS = 128, MOST_OWNED = 1 << 16 };

static lg_test_body bodies[MOST_TESTS];
static struct CMUnitTest tests[MOST_TESTS];
static size_t test_count;
static CMFixtureFunction group_begin, group_end;

static struct {
    void *object;
    void (*release)(void *);
} owned[MOST_OWNED];
static size_t owned_count;

static void run_body(void **state) {
    (*(lg_test_body *)*state)();
}

size_t lg_test_owned(void) {
    return owned_count;
}

void lg_test_give_back(size_t mark) {
    while (owned_count > mark) {
        owned_count--;
        owned[owned_count].release(owned[owned_count].object);
    }
}

/* Runs after a failed test too. */
static int release_owned(void **state) {
    (void)state;
    lg_test_give_back(0);
    return 0;
}

void lg_test_enter(const char *claim, lg_test_body body) {
    if (test_count == MOST_TESTS) abort();
    bodies[test_count] = body;
    tests[test_count] = (struct CMUnitTest){claim, run_body, NULL, release_owned, &bodies[test_count]};
    test_count++;
}

void lg_test_group(CMFixtureFunction begin, CMFixtureFunction end) {
    group_begin = begin;
    group_end = end;
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

int main(int argc, char **argv) {
    if (argc > 1) cmocka_set_test_filter(argv[1]);
    const int failed = _cmocka_run_group_tests("tests", tests, test_count, group_begin, NULL);
    return failed != 0 || (group_end != NULL && group_end(NULL) != 0);
}

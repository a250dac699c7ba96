/* Core: statuses, context and allocator, random numbers, worker threads, instruction sets.
 * ctest-labels: threads isa */
#include "support/fixtures.h"

#include <pthread.h>
#include <stdatomic.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cblas.h>

#include "core/core.h"
#include "core/portions.h"
#include "core/text.h"
#include "support/malloc_count.h"

/* ---- status ---- */

/* The values are part of the interface. They are repeated here so that a test fails if the list is
 * renumbered. */
static const struct {
    lg_status status;
    int value;
    const char *name;
} statuses[] = {
    {LG_OK, 0, "OK"},
    {LG_INVALID_ARGUMENT, 1, "INVALID_ARGUMENT"},
    {LG_SHAPE, 2, "SHAPE"},
    {LG_STALE_HANDLE, 3, "STALE_HANDLE"},
    {LG_OUT_OF_MEMORY, 4, "OUT_OF_MEMORY"},
    {LG_NOT_FINITE, 5, "NOT_FINITE"},
    {LG_NO_CONVERGENCE, 6, "NO_CONVERGENCE"},
    {LG_STEP_TOO_SMALL, 7, "STEP_TOO_SMALL"},
    {LG_TOO_MANY_STEPS, 8, "TOO_MANY_STEPS"},
    {LG_NOT_DIFFERENTIABLE, 9, "NOT_DIFFERENTIABLE"},
    {LG_NOT_FOUND, 10, "NOT_FOUND"},
    {LG_FILE, 11, "FILE"},
    {LG_FORMAT, 12, "FORMAT"},
    {LG_VERSION, 13, "VERSION"},
    {LG_UNSUPPORTED, 14, "UNSUPPORTED"},
    {LG_CANCELLED, 15, "CANCELLED"},
    {LG_CHECK_FAILED, 16, "CHECK_FAILED"},
};

TEST("every status has the value, name and message of the interface, and any other value is UNKNOWN") {
    assert_string_equal(lg_status_name((lg_status)1000), "UNKNOWN");
    assert_non_null(lg_status_sentence((lg_status)1000));
#define COUNT_ONE(code, value, sentence) +1
    assert_int_equal(LG_COUNT(statuses), 0 LG_STATUS_LIST(COUNT_ONE));
#undef COUNT_ONE
    for (size_t i = 0; i < LG_COUNT(statuses); i++) {
        assert_int_equal(statuses[i].status, statuses[i].value);
        assert_string_equal(lg_status_name(statuses[i].status), statuses[i].name);
        const char *sentence = lg_status_sentence(statuses[i].status);
        assert_true(strlen(sentence) > 4);
        assert_string_not_equal(sentence, lg_status_sentence((lg_status)1000));
        for (size_t j = 0; j < i; j++)
            assert_string_not_equal(sentence, lg_status_sentence(statuses[j].status));
    }
}

TEST("lg_fail fills the message") {
    lg_error error;
    memset(&error, 'x', sizeof error);
    assert_int_equal(lg_fail(&error, LG_SHAPE, "line %d", 7), LG_SHAPE);
    assert_int_equal(error.status, LG_SHAPE);
    assert_string_equal(error.message, "line 7");
    assert_int_equal(lg_fail(NULL, LG_FILE, "nobody listens"), LG_FILE);

    char longer[2 * sizeof error.message];
    memset(longer, 'y', sizeof longer);
    longer[sizeof longer - 1] = '\0';
    (void)lg_fail(&error, LG_FILE, "%s", longer);
    assert_int_equal(strlen(error.message), sizeof error.message - 1);
}

/* ---- context ---- */

static void *refuse(void *user, size_t bytes) {
    return NULL;
}

static void release_nothing(void *user, void *memory) {
}

TEST("context options are checked") {
    lg_context_options good, options;
    lg_context_options_init(&good);
    assert_int_equal(good.size, sizeof good);
    lg_context *const untouched = (lg_context *)(void *)&good;
    lg_context *context = untouched;

    static const struct {
        bool short_size, allocate, release;
        lg_status status;
    } bad[] = {{true, false, false, LG_INVALID_ARGUMENT},
               {false, true, false, LG_INVALID_ARGUMENT},
               {false, false, true, LG_INVALID_ARGUMENT},
               {false, true, true, LG_OUT_OF_MEMORY}};
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        options = good;
        if (bad[i].short_size) options.size--;
        if (bad[i].allocate) options.allocate = refuse;
        if (bad[i].release) options.release = release_nothing;
        assert_status(lg_context_create(&options, &context), bad[i].status);
    }
    assert_ptr_equal(context, untouched);

    assert_ok(lg_context_create(&good, &context));
    lg_context_destroy(context);
    assert_ok(lg_context_create(NULL, &context));
    lg_context_destroy(context);
    lg_context_destroy(NULL);
}

static void check_memory(const lg_context *context) {
    static const size_t counts[] = {0, 1, 3, 64, 1000, 100000};
    for (size_t i = 0; i < LG_COUNT(counts); i++) {
        unsigned char *memory = lg_alloc(context, counts[i], 3);
        assert_non_null(memory);
        assert_int_equal((uintptr_t)memory % LG_ALIGNMENT, 0);
        for (size_t j = 0; j < 3 * counts[i]; j++) assert_int_equal(memory[j], 0);
        if (counts[i] != 0) memset(memory, 0xff, 3 * counts[i]);
        lg_free(context, memory);
    }
    /* count * size overflows, or is so large that an allocator's own additions would overflow. */
    assert_null(lg_alloc(context, SIZE_MAX, 2));
    assert_null(lg_alloc(context, 2, SIZE_MAX));
    assert_null(lg_alloc(context, SIZE_MAX / 2 + 2, 2));
    assert_null(lg_alloc(context, SIZE_MAX, 1));
    assert_null(
        lg_alloc(context, UINT64_MAX / 2 + 2, 1)); /* on machines with 32 bits: 2 bytes, if it were cut */
    lg_free(context, NULL);

    char *copy = lg_strdup(context, "qp");
    assert_non_null(copy);
    assert_string_equal(copy, "qp");
    lg_free(context, copy);
    copy = lg_strdup(context, "");
    assert_non_null(copy);
    assert_string_equal(copy, "");
    lg_free(context, copy);
}

TEST("memory is zeroed, aligned and allocated from the context; sizes that overflow are refused") {
    lg_fail_alloc memory;
    lg_context *counted = lg_fail_alloc_context(&memory), *plain = NULL;
    assert_ok(lg_context_create(NULL, &plain));
    check_memory(NULL);
    check_memory(plain);
    assert_int_equal(lg_fail_alloc_live(&memory), 1);
    check_memory(counted);
    assert_int_equal(lg_fail_alloc_live(&memory), 1);
    lg_fail_alloc_arm(&memory, 1);
    assert_null(lg_alloc(counted, 1, 1));
    lg_fail_alloc_arm(&memory, 1);
    assert_null(lg_strdup(counted, "text"));
    lg_fail_alloc_arm(&memory, 0);
    lg_context_destroy(counted);
    assert_int_equal(lg_fail_alloc_live(&memory), -1);
    lg_context_destroy(plain);
}

TEST("portions that no size_t counts together are SIZE_MAX bytes, which no allocation gives") {
    static const size_t counts[][2] = {
        {SIZE_MAX, 1}, {1, SIZE_MAX}, {SIZE_MAX / 2, 1}, {SIZE_MAX / 8 + 2, 8}};
    for (size_t i = 0; i < LG_COUNT(counts); i++) {
        lg_portions from = {NULL, 0};
        (void)lg_portion(&from, 3, 8);
        assert_int_equal(from.used, LG_ALIGNMENT);
        for (size_t k = 0; k < 3; k++) (void)lg_portion(&from, counts[i][0], counts[i][1]);
        assert_true(from.used == SIZE_MAX);
        (void)lg_portion(&from, 0, 8);
        assert_true(from.used == SIZE_MAX);
        assert_null(lg_alloc(NULL, from.used, 1));
    }
}

TEST("indices are spread evenly over more samples than the square root of size_t") {
    assert_int_equal(lg_spread(0, 100000, 80000), 0);
    assert_int_equal(lg_spread(70000, 100000, 80000), 87500);
    assert_int_equal(lg_spread(79999, 100000, 80000), 99998);
}

TEST("a pool whose allocations fail leaks nothing") {
    EVERY_ALLOCATION_FAILS(context, 1, {
        lg_thread_pool *const untouched = (lg_thread_pool *)(void *)&memory_;
        lg_thread_pool *pool = untouched;
        status = lg_thread_pool_create(context, 3, &pool);
        assert_true(status == LG_OK || pool == untouched);
        if (status == LG_OK) lg_thread_pool_destroy(pool);
    });
}

typedef struct heard {
    int calls;
    lg_log_level level;
    char message[1024];
} heard;

static void hear(void *user, lg_log_level level, const char *message) {
    heard *all = user;
    all->calls++;
    all->level = level;
    (void)snprintf(all->message, sizeof all->message, "%s", message);
}

TEST("log messages and the cancel flag are passed through the context") {
    heard all = {0, LG_LOG_DEBUG, ""};
    volatile int cancel = 0;
    lg_context_options options;
    lg_context_options_init(&options);
    options.log = hear;
    options.log_user = &all;
    options.cancel = &cancel;
    lg_context *context = NULL;
    assert_ok(lg_context_create(&options, &context));

    lg_log_message(context, LG_LOG_WARNING, "epoch %d", 12);
    assert_int_equal(all.calls, 1);
    assert_int_equal(all.level, LG_LOG_WARNING);
    assert_string_equal(all.message, "epoch 12");
    assert_false(lg_cancelled(context));
    cancel = 1;
    assert_true(lg_cancelled(context));
    lg_context_destroy(context);

    assert_ok(lg_context_create(NULL, &context));
    lg_log_message(context, LG_LOG_ERROR, "nobody listens");
    lg_log_message(NULL, LG_LOG_ERROR, "nobody listens");
    assert_false(lg_cancelled(context));
    assert_false(lg_cancelled(NULL));
    assert_int_equal(all.calls, 1);
    lg_context_destroy(context);
}

/* ---- random numbers ---- */

TEST("the first outputs from the state 1, 2, 3, 4 agree with the reference implementation (Blackman & "
     "Vigna 2018)") {
    static const uint64_t expected[] = {
        11520u,
        0u,
        1509978240u,
        1215971899390074240u,
        1216172134540287360u,
        607988272756665600u,
        16172922978634559625u,
        8476171486693032832u,
        10595114339597558777u,
        2904607092377533576u,
    };
    lg_rng rng = {{1, 2, 3, 4}};
    for (size_t i = 0; i < LG_COUNT(expected); i++) assert_true(lg_rng_next(&rng) == expected[i]);
}

TEST("seeded sequences never change, as files and reports rely on them") {
    static const struct {
        uint64_t seed, stream, next[3];
    } rows[] = {
        {1, 0, {0xee127fe613436e33u, 0xd6dad8d34a1874eau, 0x2a52c16cec1116a9u}},
        {1, 1, {0x550e4e55a37114ccu, 0xa645791d18940fddu, 0xebededf9628ebf4cu}},
        {42, 7, {0x62737c38a122f17bu, 0xea6ebb82a9ba9dafu, 0xd441ca1af7a73d34u}},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        lg_rng rng = test_rng(rows[i].seed, rows[i].stream);
        for (int j = 0; j < 3; j++) assert_true(lg_rng_next(&rng) == rows[i].next[j]);
    }
}

TEST("a copy of a generator's state continues its sequence") {
    lg_rng rng = test_rng(3, 0);
    (void)lg_rng_normal(&rng);
    lg_rng copy = rng;
    for (int i = 0; i < 100; i++) {
        assert_true(lg_rng_normal(&rng) == lg_rng_normal(&copy));
        assert_true(lg_rng_below(&rng, 77) == lg_rng_below(&copy, 77));
    }
}

TEST("outputs of all ones and all zeros give the ends of [0, 1); s[1] is computed from the output word") {
    uint64_t inverse5 = 1, inverse9 = 1;
    for (int i = 0; i < 6; i++) { /* Newton's iteration modulo 2^64 */
        inverse5 *= 2 - 5 * inverse5;
        inverse9 *= 2 - 9 * inverse9;
    }
    const uint64_t rotated = UINT64_MAX * inverse9;
    lg_rng rng = {{1, ((rotated >> 7) | (rotated << 57)) * inverse5, 2, 3}};
    lg_rng copy = rng;
    assert_true(lg_rng_next(&copy) == UINT64_MAX);
    const double highest = lg_rng_uniform(&rng);
    assert_true(highest < 1.0);
    assert_close(highest, 1.0, 1e-15, 0.0);
    rng = (lg_rng){{1, 0, 2, 3}};
    assert_close(lg_rng_uniform(&rng), 0.0, 0.0, 0.0);
}

/* Moments of n samples: mean, variance, skewness, kurtosis, correlation of neighbours. */
static void moments(const double *x, size_t n, double out[5]) {
    double mean = 0, m2 = 0, m3 = 0, m4 = 0, lag = 0;
    for (size_t i = 0; i < n; i++) mean += x[i] / (double)n;
    for (size_t i = 0; i < n; i++) {
        const double d = x[i] - mean;
        m2 += d * d / (double)n;
        m3 += d * d * d / (double)n;
        m4 += d * d * d * d / (double)n;
        if (i > 0) lag += d * (x[i - 1] - mean) / (double)n;
    }
    out[0] = mean;
    out[1] = m2;
    out[2] = m3 / (m2 * sqrt(m2));
    out[3] = m4 / (m2 * m2);
    out[4] = lag / m2;
}

enum { SAMPLES = 200000 };

TEST("uniform and normal numbers have the right moments") {
    const double root = 5.0 / sqrt((double)SAMPLES);
    double *x = TEST_ARRAY(double, SAMPLES), m[5];
    for (uint64_t seed = 1; seed <= 3; seed++) {
        lg_rng rng = test_rng(seed, 0);
        for (int i = 0; i < SAMPLES; i++) {
            x[i] = lg_rng_uniform_in(&rng, -2.0, 4.0);
            assert_true(x[i] >= -2.0 && x[i] <= 4.0);
        }
        moments(x, SAMPLES, m);
        const double flat[5] = {1.0, 3.0, 0.0, 1.8, 0.0},
                     flat_off[5] = {sqrt(3.0), 3.0 * sqrt(0.8), 2.0, 2.0, 1.0};
        for (int i = 0; i < 5; i++) assert_close(m[i], flat[i], 0.0, root * flat_off[i]);

        double inside = 0;
        for (int i = 0; i < SAMPLES; i++) {
            x[i] = lg_rng_normal(&rng);
            inside += fabs(x[i]) < 1.0 ? 1.0 / SAMPLES : 0.0;
        }
        moments(x, SAMPLES, m);
        const double bell[5] = {0.0, 1.0, 0.0, 3.0, 0.0},
                     bell_off[5] = {1.0, sqrt(2.0), sqrt(6.0), sqrt(24.0), 1.0};
        for (int i = 0; i < 5; i++) assert_close(m[i], bell[i], 0.0, root * bell_off[i]);
        assert_close(inside, 0.68268949213708590, 0.0, root * 0.5);
    }
}

TEST("streams and seeds are independent") {
    lg_rng a, b, c;
    lg_rng_seed(&a, 5, 0);
    lg_rng_seed(&b, 5, 1);
    lg_rng_seed(&c, 6, 0);
    double ab = 0, ac = 0;
    for (int i = 0; i < SAMPLES; i++) {
        const double x = lg_rng_normal(&a);
        ab += x * lg_rng_normal(&b) / SAMPLES;
        ac += x * lg_rng_normal(&c) / SAMPLES;
    }
    assert_close(ab, 0.0, 0.0, 5.0 / sqrt((double)SAMPLES));
    assert_close(ac, 0.0, 0.0, 5.0 / sqrt((double)SAMPLES));
}

TEST("bounded draws are uniform") {
    lg_rng rng = test_rng(8, 0);
    assert_true(lg_rng_below(&rng, 0) == 0);
    for (int i = 0; i < 100; i++) assert_true(lg_rng_below(&rng, 1) == 0);

    double seen[6] = {0}, chi2 = 0;
    for (int i = 0; i < SAMPLES; i++) {
        const uint64_t k = lg_rng_below(&rng, 6);
        assert_true(k < 6);
        seen[k] += 1;
    }
    for (int k = 0; k < 6; k++) chi2 += pow(seen[k] - SAMPLES / 6.0, 2) / (SAMPLES / 6.0);
    assert_true(chi2 < 35.0); /* 5 degrees of freedom: probability 1.5e-6 */

    /* A remainder without rejection would give the lowest third of 3 * 2^62 half of the draws. */
    const uint64_t third = (uint64_t)1 << 62;
    double low = 0;
    for (int i = 0; i < SAMPLES; i++) low += lg_rng_below(&rng, 3 * third) < third ? 1.0 / SAMPLES : 0.0;
    assert_close(low, 1.0 / 3.0, 0.0, 5.0 * sqrt(2.0 / 9.0 / SAMPLES));
}

TEST("shuffles are permutations, all equally likely") {
    lg_rng rng = test_rng(9, 0);
    lg_rng_shuffle(&rng, NULL, 0);
    uint32_t one = 7;
    lg_rng_shuffle(&rng, &one, 1);
    assert_int_equal(one, 7);

    uint32_t items[1000];
    bool there[1000] = {false};
    for (uint32_t i = 0; i < 1000; i++) items[i] = i;
    lg_rng_shuffle(&rng, items, 1000);
    int fixed = 0;
    for (uint32_t i = 0; i < 1000; i++) {
        assert_true(items[i] < 1000 && !there[items[i]]);
        there[items[i]] = true;
        fixed += items[i] == i;
    }
    assert_true(fixed < 12); /* Poisson with mean 1 */

    /* All six orders of three are equally likely. */
    double seen[27] = {0}, chi2 = 0;
    int orders = 0;
    for (int i = 0; i < SAMPLES; i++) {
        uint32_t p[3] = {0, 1, 2};
        lg_rng_shuffle(&rng, p, 3);
        seen[9 * p[0] + 3 * p[1] + p[2]] += 1;
    }
    for (int k = 0; k < 27; k++)
        if (seen[k] > 0) {
            orders++;
            chi2 += pow(seen[k] - SAMPLES / 6.0, 2) / (SAMPLES / 6.0);
        }
    assert_int_equal(orders, 6);
    assert_true(chi2 < 35.0);
}

/* ---- worker threads ---- */

typedef struct job {
    atomic_int *runs; /* one per task */
    double *results;
    atomic_int inside;
} job;

static void square(void *user, size_t index) {
    job *all = user;
    atomic_fetch_add(&all->inside, 1);
    atomic_fetch_add(&all->runs[index], 1);
    all->results[index] = (double)index * (double)index;
    atomic_fetch_sub(&all->inside, 1);
}

static void check_pool(int threads, size_t count, int rounds) {
    lg_thread_pool *pool = NULL;
    assert_ok(lg_thread_pool_create(NULL, threads, &pool));
    job all = {TEST_ARRAY(atomic_int, count + 1), TEST_ARRAY(double, count + 1), 0};
    for (int round = 1; round <= rounds; round++) {
        lg_thread_pool_run(pool, count, square, &all);
        assert_int_equal(atomic_load(&all.inside), 0);
        for (size_t i = 0; i < count; i++) {
            assert_int_equal(atomic_load(&all.runs[i]), round);
            assert_close(all.results[i], (double)i * (double)i, 0.0, 0.0);
            all.results[i] = -1.0;
        }
        assert_int_equal(atomic_load(&all.runs[count]), 0);
    }
    lg_thread_pool_destroy(pool);
}

TEST("a pool of threads runs every task once") {
    for (int threads = 1; threads <= 8; threads++) {
        check_pool(threads, 0, 3);
        check_pool(threads, 1, 3);
        check_pool(threads, 2, 100);
        check_pool(threads, 1000, 3);
    }
    check_pool(2, 4, 5000);
    check_pool(3, 2, 5000);
}

static void wait_for_all(void *user, size_t index) {
    atomic_int *arrived = user;
    atomic_fetch_add(arrived, 1);
    const struct timespec pause = {0, 500000};
    for (int i = 0; i < 20000 && atomic_load(arrived) < 3; i++) nanosleep(&pause, NULL);
}

TEST("three tasks that wait for each other end only if three threads run them at the same time") {
    lg_thread_pool *pool = NULL;
    assert_ok(lg_thread_pool_create(NULL, 3, &pool));
    atomic_int arrived = 0;
    lg_thread_pool_run(pool, 3, wait_for_all, &arrived);
    assert_int_equal(atomic_load(&arrived), 3);
    lg_thread_pool_destroy(pool);
}

typedef struct late {
    pthread_t caller;
    atomic_int arrived, finished;
} late;

/* Each of the two threads takes one task; the worker's task takes longer. A pool without a worker, because
 * the system has no thread for it, runs both tasks on the caller's thread, which waits a second. */
static void finish_late(void *user, size_t index) {
    late *self = user;
    const struct timespec moment = {0, 100000}, pause = {0, 20000000};
    atomic_fetch_add(&self->arrived, 1);
    for (int i = 0; i < 10000 && atomic_load(&self->arrived) < 2; i++) (void)nanosleep(&moment, NULL);
    if (!pthread_equal(pthread_self(), self->caller)) (void)nanosleep(&pause, NULL);
    atomic_fetch_add(&self->finished, 1);
}

TEST("a run on threads returns when the last task has ended, even long after the caller's own task") {
    lg_thread_pool *pool = NULL;
    assert_ok(lg_thread_pool_create(NULL, 2, &pool));
    for (int i = 0; i < 3; i++) {
        late all = {.caller = pthread_self()};
        lg_thread_pool_run(pool, 2, finish_late, &all);
        assert_int_equal(atomic_load(&all.finished), 2);
    }
    lg_thread_pool_destroy(pool);
}

TEST("invalid numbers of threads are refused") {
    lg_thread_pool *pool = NULL;
    static const int bad[] = {0, -1, -2147483647, 1025};
    for (size_t i = 0; i < LG_COUNT(bad); i++) {
        assert_status(lg_thread_pool_create(NULL, bad[i], &pool), LG_INVALID_ARGUMENT);
        assert_null(pool);
    }
    lg_thread_pool_destroy(NULL);
}

/* A list of jobs, of which those from `first` to `last` fail. */
typedef struct failing {
    size_t first, last;
    atomic_int runs[100];
} failing;

static lg_status fail_some(void *user, size_t index, lg_error *error) {
    failing *all = user;
    const struct timespec pause = {0, 20000};
    atomic_fetch_add(&all->runs[index], 1);
    if (index < all->first || index > all->last) return LG_OK;
    if (index == all->first) (void)nanosleep(&pause, NULL); /* so that others fail before it */
    return lg_fail(error, index % 2 == 0 ? LG_FORMAT : LG_NOT_FOUND, "job %zu", index);
}

TEST("jobs on threads return the status and sentence of the first one that fails, and run all before it") {
    for (uint64_t threads = 1; threads <= 8; threads++)
        for (size_t first = 0; first <= 100; first += 10) {
            failing all = {.first = first, .last = 98};
            lg_error error = {LG_OK, ""};
            char expected[32] = "";
            const bool fails = first < 100;
            if (fails) (void)snprintf(expected, sizeof expected, "job %zu", first);
            assert_status(lg_jobs_run(NULL, threads, 100, fail_some, &all, &error),
                          fails ? LG_FORMAT : LG_OK);
            assert_status(error.status, fails ? LG_FORMAT : LG_OK);
            assert_string_equal(error.message, expected);
            for (size_t i = 0; i < 100; i++) {
                const int runs = atomic_load(&all.runs[i]);
                assert_true(runs == 1 || (runs == 0 && i > first));
            }
            if (threads == 1 && fails) assert_int_equal(atomic_load(&all.runs[99]), first == 99);
        }
    assert_ok(lg_jobs_run(NULL, 0, 0, fail_some, NULL, NULL));
    assert_status(lg_jobs_run(NULL, 0, 1, fail_some, &(failing){.first = 1}, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_jobs_run(NULL, 2, 3, fail_some, &(failing){.first = 1, .last = 2}, NULL), LG_NOT_FOUND);
}

/* ---- texts ---- */

static void assert_text(void (*add)(lg_text *to, const char *value), const char *value,
                        const char *expected) {
    lg_text text = {.context = NULL};
    add(&text, value);
    if (text.failed) fail_msg("out of memory");
    assert_string_equal(text.data, expected);
    lg_text_destroy(&text);
}

static void add_x(lg_text *to, const char *code) {
    lg_text_add_named(to, "x", code);
}

TEST("words of a shell, literals and comments of C, and names in code") {
    static const char *const words[][2] = {
        {"a-b", "a-b"}, {"", "''"}, {"a b", "'a b'"}, {"it's", "'it'\\''s'"}};
    static const char *const literals[][2] = {{"a\"b\\c?", "\"a\\\"b\\\\c\\?\""},
                                              {"\x7f\n\xc3", "\"\\177\\012\\303\""}};
    static const char *const comments[][2] = {
        {"a*/b /* c", "a* /b / * c"},
        {"a?"
         "?/",
         "a? ?/"},
        {"end\\", "end\\."},
        {"end\\\nnext", "end\\.\nnext"},
        {"a\tb\x7f", "a b "},
        {"\xc3\xa9 \xe2\x82\xac \xf0\x9f\x98\x80", "<U+00E9> <U+20AC> <U+1F600>"},
        {"\x80 \xc1\xa9 \xf5 \xc3x \xe2\x82", "<80> <C1><A9> <F5> <C3>x <E2><82>"},
    };
    static const char *const named[][2] = {{"NAME_f(MY_NAME_g, NAME_h)", "x_f(MY_NAME_g, x_h)"},
                                           {"NAME", "NAME"}};
    for (size_t i = 0; i < LG_COUNT(words); i++) assert_text(lg_text_add_word, words[i][0], words[i][1]);
    for (size_t i = 0; i < LG_COUNT(literals); i++)
        assert_text(lg_text_add_literal, literals[i][0], literals[i][1]);
    for (size_t i = 0; i < LG_COUNT(comments); i++)
        assert_text(lg_text_add_comment, comments[i][0], comments[i][1]);
    for (size_t i = 0; i < LG_COUNT(named); i++) assert_text(add_x, named[i][0], named[i][1]);
    lg_text unfit = {.unfit = true}, all = {.lost = 1};
    lg_text_join(&all, &unfit);
    assert_true(all.unfit && !all.failed && all.lost == 1);
}

TEST("control characters and bytes that are not UTF-8 become question marks") {
    static const struct row {
        const char *from, *to;
        bool changed;
    } rows[] = {
        {"", "", false},
        {"a ~\xc2\xa0\xc3\xa9\xe2\x82\xac\xf0\x9f\x98\x80", "a ~\xc2\xa0\xc3\xa9\xe2\x82\xac\xf0\x9f\x98\x80",
         false},
        {"\x1b[2J\t\n\x7f", "?[2J???", true},
        {"\xc2\x80x\xc2\x85y\xc2\x9f", "??x??y??", true},
        {"\x80 \xc1\xa9 \xed\xa0\x80 \xf4\x90\x80\x80 \xe2\x82", "? ?? ??? ???? ??", true},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char text[32];
        (void)snprintf(text, sizeof text, "%s", rows[i].from);
        assert_true(lg_tame(text) == rows[i].changed);
        assert_string_equal(text, rows[i].to);
    }
}

/* ---- ranks ---- */

enum { RANKS = 5000, ME = 4321 }; /* more than an exchange has room for without the heap */

/* Rank 7 has failed if `user` points to true; all others contribute zeros. */
static lg_status gather_alone(void *user, void *all, const size_t *bytes) {
    const bool *failed = user;
    const lg_status status = LG_FORMAT;
    if (bytes[7] == sizeof(uint32_t) && *failed) ((uint32_t *)all)[7] = (uint32_t)status;
    if (bytes[7] > sizeof(uint32_t)) memcpy(all, "why", 4);
    return LG_OK;
}

static lg_status gather_fails(void *user, void *all, const size_t *bytes) {
    return LG_FILE;
}

static const char *say(void *user) {
    return "rank 3 was killed";
}

TEST("thousands of ranks agree on the failure of the lowest one") {
    bool failed = false;
    lg_ranks ranks = {
        .size = sizeof ranks, .rank = ME, .count = RANKS, .user = &failed, .gather = gather_alone};
    lg_error error = {LG_OK, ""};
    assert_ok(lg_ranks_agree(&ranks, LG_OK, &error));
    assert_status(lg_ranks_agree(&ranks, LG_NOT_FINITE, NULL), LG_NOT_FINITE);
    failed = true;
    assert_status(lg_ranks_agree(&ranks, LG_OK, &error), LG_FORMAT);
    assert_string_equal(error.message, "why (rank 7)");
    ranks.gather = gather_fails;
    assert_status(lg_ranks_agree(&ranks, LG_OK, &error), LG_FILE);
    assert_string_equal(error.message, "the ranks lost their connection");
    ranks.reason = say;
    assert_status(lg_ranks_agree(&ranks, LG_OK, &error), LG_FILE);
    assert_string_equal(error.message, "rank 3 was killed");
}

/* ---- instruction sets ---- */

/* The instruction set is chosen once per process, so each value of the variable is tried in a child. */
static int isa_with(const char *asked) {
    const pid_t child = fork();
    if (child == 0) {
        if (asked == NULL)
            unsetenv("LIEGRAD_ISA");
        else
            setenv("LIEGRAD_ISA", asked, 1);
        _exit((int)lg_isa_in_use());
    }
    int status = 0;
    assert_true(child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status));
    return WEXITSTATUS(status);
}

TEST("LIEGRAD_ISA chooses an instruction set that the machine has") {
    static const char *const names[LG_ISA_COUNT] = {"baseline", "avx2", "avx512", "neon"};
    const int best = isa_with(NULL);
    assert_in_range(best, 0, LG_ISA_COUNT - 1);
    for (int isa = 0; isa < LG_ISA_COUNT; isa++) {
        assert_string_equal(lg_isa_name((lg_isa)isa), names[isa]);
        assert_int_equal(isa_with(names[isa]), lg_isa_is_here((lg_isa)isa) ? isa : best);
    }
    assert_int_equal(isa_with("sse9"), best);
    assert_int_equal(isa_with(""), best);
}

TEST("the instruction set in use is the requested one") {
    const char *asked = getenv("LIEGRAD_ISA");
    if (asked != NULL && isa_with(asked) == isa_with(NULL)) asked = NULL;
    if (asked != NULL) assert_string_equal(lg_isa_name(lg_isa_in_use()), asked);
    assert_int_equal(lg_isa_in_use(), lg_isa_in_use());
}

TEST("the description of the machine fits into its buffer") {
    char text[256], part[8];
    memset(text, 'x', sizeof text);
    const int length = lg_cpu_describe(text, sizeof text);
    assert_in_range(length, 10, sizeof text - 1);
    assert_int_equal(strlen(text), length);
    assert_non_null(strstr(text, lg_isa_name(lg_isa_in_use())));
    assert_null(strchr(text, '\n'));
    assert_int_equal(lg_cpu_describe(part, sizeof part), length);
    assert_memory_equal(part, text, sizeof part - 1);
    assert_int_equal(part[sizeof part - 1], '\0');
    assert_int_equal(lg_cpu_describe(NULL, 0), length);
}

TEST("the version equals the header's") {
    assert_string_equal(lg_version(), LG_VERSION_STRING);
}

/* ---- the tests' own tools ---- */

static void take_and_give_back(void) {
    void *volatile memory = malloc(100);
    memory = realloc(memory, 200);
    free(memory);
    memory = calloc(3, 7);
    free(memory);
    void *aligned = NULL;
    assert_int_equal(posix_memalign(&aligned, 64, 100), 0);
    assert_int_equal((uintptr_t)aligned % 64, 0);
    free(aligned);
    memory = aligned_alloc(64, 128);
    free(memory);
}

TEST("counters see allocations, releases and locks") {
    if (!lg_count_available()) skip();
    lg_count_begin();
    take_and_give_back();
    lg_counts used = lg_count_end();
    assert_int_equal(used.allocations, 5);
    assert_int_equal(used.releases, 4);

    lg_rng rng = test_rng(1, 0);
    assert_no_malloc_no_lock((void)lg_rng_normal(&rng));
    take_and_give_back(); /* outside of a region, so not counted */
    used = lg_count_end();
    assert_int_equal(used.allocations, 0);

    lg_thread_pool *pool = NULL;
    lg_count_begin();
    assert_ok(lg_thread_pool_create(NULL, 2, &pool));
    used = lg_count_end();
    assert_true(used.allocations >= 2);
    atomic_int runs[4] = {0};
    double results[4];
    job all = {runs, results, 0};
    lg_count_begin();
    lg_thread_pool_run(pool, 4, square, &all);
    used = lg_count_end();
    assert_int_equal(used.allocations, 0);
    assert_true(used.locks >= 1);
    lg_thread_pool_destroy(pool);
}

TEST("in the comparison that all tests use, NaN is never close, not even to NaN") {
    assert_true(lg_is_close(1.0, 1.0 + 1e-12, 1e-11, 0.0));
    assert_false(lg_is_close(1.0, 1.0 + 1e-10, 1e-11, 0.0));
    assert_false(lg_is_close(NAN, 1.0, 1.0, 1.0));
    assert_false(lg_is_close(1.0, NAN, 1.0, 1.0));
    assert_false(lg_is_close(NAN, NAN, 1.0, 1.0));
    assert_true(lg_is_close(INFINITY, INFINITY, 0.0, 0.0));
    assert_false(lg_is_close(1.0, INFINITY, 1.0, 1.0));
    assert_false(lg_is_close(-INFINITY, INFINITY, 1.0, 1.0));
}

#define WEAK __attribute__((weak))
extern WEAK char *openblas_get_corename(void);
extern WEAK void gotoblas_dynamic_quit(void);
extern WEAK void gotoblas_dynamic_init(void);

/* Makes OpenBLAS use the kernels that it used if the variable had this value at its start. */
static void start_blas_as(const char *core) {
    assert_int_equal(setenv("OPENBLAS_CORETYPE", core, 1), 0);
    gotoblas_dynamic_quit();
    gotoblas_dynamic_init();
}

/* Must run last, because it changes the process. OpenBLAS must compute the same, in one thread, and the
 * environment must be unchanged. With AVX-512, kernels of AVX2 are replaced, unless the user wants them. */
TEST("lg_runtime_setup limits OpenBLAS to one thread, with the kernels of the processor") {
    enum { N = 96 };
    static double a[N * N], c[N * N];
    const char *asked = getenv("OPENBLAS_CORETYPE");
    char text[256];
    openblas_set_num_threads(2);
    (void)lg_cpu_describe(text, sizeof text);
    assert_true(openblas_get_num_threads() < 2 || strstr(text, ", 2 BLAS threads") != NULL);
    if (lg_isa_in_use() == LG_ISA_AVX512 && asked == NULL) {
        start_blas_as("Haswell");
        lg_runtime_setup();
        assert_string_equal(openblas_get_corename(), "Haswell");
        assert_int_equal(unsetenv("OPENBLAS_CORETYPE"), 0);
        lg_runtime_setup();
        assert_string_equal(openblas_get_corename(), "SkylakeX");
    }
    lg_runtime_setup();
    lg_runtime_setup();
    assert_true(getenv("OPENBLAS_CORETYPE") == asked);
    (void)lg_cpu_describe(text, sizeof text);
    assert_int_equal(openblas_get_num_threads(), 1);
    assert_says(text, "OpenBLAS 0.");
    assert_says(text, ", 1 BLAS thread");
    for (int i = 0; i < N * N; i++) a[i] = i % 7;
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, N, N, N, 1.0, a, N, a, N, 0.0, c, N);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            double sum = 0;
            for (int k = 0; k < N; k++) sum += a[i * N + k] * a[j * N + k];
            assert_close(c[i * N + j], sum, 0.0, 0.0); /* small integers: exact in any order */
        }
}

/* ---- the process, texts ---- */

TEST("memory for OpenBLAS is reserved for any number of threads, or refused under a limit of addresses") {
    assert_true(lg_runtime_reserve(0) && lg_runtime_reserve(1000));
    const pid_t child = fork();
    if (child == 0) {
        const struct rlimit little = {1 << 20, RLIM_INFINITY};
        const bool limited = setrlimit(RLIMIT_AS, &little) == 0;
        if (malloc(16 << 20) != NULL) _exit(0); /* qemu has no such limit */
        _exit(limited && !lg_runtime_reserve(1) ? 0 : 1);
    }
    int status = -1;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

TEST("a text takes over what another text has lost, and a quiet context needs no other one") {
    lg_text all = {.length = 0}, part = {.length = 0};
    lg_context *quiet;
    lg_text_add(&all, "%s", "");
    assert_int_equal(all.length, 0);
    lg_text_add_real(&part, LG_F64, INFINITY);
    lg_text_join(&all, &part);
    assert_true(part.unfit && all.unfit);
    lg_text_join(&all, &(lg_text){.length = 0});
    assert_true(all.unfit);
    lg_text_destroy(&all);
    lg_text_destroy(&part);
    assert_ok(lg_context_quiet(NULL, &quiet));
    lg_log_message(quiet, LG_LOG_WARNING, "nobody hears this");
    lg_context_destroy(quiet);
}

/* A steady training step of a surrogate calls no malloc; its curves take no memory and no lock. */
#include "models/surrogate_support.h"

#include "support/malloc_count.h"

typedef struct counting {
    lg_counts used;
    bool done;
} counting;

/* Epochs 1 and 2 warm up; 3 to 5 are counted. */
static int count_epochs(void *user, const lg_fit_epoch *report) {
    counting *self = user;
    if (report->epoch == 2) lg_count_begin();
    if (report->epoch == 5) {
        self->used = lg_count_end();
        self->done = true;
    }
    return 0;
}

static void training(void **state) {
    (void)state;
    static const uint32_t all[6] = {0, 1, 2, 3, 4, 5};
    lg_elastica_curves set;
    if (!lg_count_available()) skip();
    make_curves(&set, 6, 20);
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        lg_fit_problem fit_problem;
        lg_fit_options options;
        lg_fit *fit;
        counting counted = {.done = false};
        make_small(&s, which, 20, TEST_LENGTH, 41);
        const lg_surrogate_problem problem = {&s.model, &set, all, 6};
        lg_surrogate_fit_problem(&problem, &fit_problem);
        lg_fit_options_init(&options);
        options.dtype = LG_F32;
        options.epochs = 5;
        options.shards = 2;
        options.on_epoch = count_epochs;
        options.user = &counted;
        assert_ok(lg_fit_create(NULL, &fit_problem, &options, s.theta, &fit, NULL));
        assert_ok(lg_fit_run(fit, NULL));
        assert_true(counted.done);
        assert_int_equal(counted.used.allocations, 0);
        assert_int_equal(counted.used.releases, 0);
        lg_fit_destroy(fit);
        free_small(&s);
    }
    free_curves(&set);
}

static void curves(void **state) {
    (void)state;
    enum { POINTS = 30 };
    static const double x[8] = {0.0, 0.0, 0.8, 0.6, 3.0, 0.0, 0.8, -0.6};
    if (!lg_count_available()) skip();
    for (size_t which = 0; which < TEST_OPTIONS; which++) {
        small s;
        double at[POINTS], q[2 * POINTS], v[2 * POINTS];
        make_small(&s, which, 20, TEST_LENGTH, 42);
        for (size_t k = 0; k < POINTS; k++) at[k] = TEST_LENGTH * (double)k / POINTS;
        plan_small(&s, POINTS);
        assert_no_malloc_no_lock(lg_surrogate_curve(s.curves, x, at, POINTS, q, v, s.work));
        assert_no_malloc_no_lock(lg_surrogate_curve(s.curves32, x, at, POINTS, q, v, s.work));
        free_small(&s);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(training), cmocka_unit_test(curves)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

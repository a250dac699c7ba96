/* Counters beyond 2^32. */
#include "anomaly/classify/monitor.c" /* its counters */

#include "nn/fit_internal.h"
#include "nn/nn_support.h"

static const uint64_t top = (uint64_t)1 << 32;

static lg_status judge_nothing(void *user, const float *x, uint32_t missing, lg_answer *answer,
                               double *score) {
    (void)user;
    (void)x;
    (void)missing;
    *answer = LG_ANSWER_NEGATIVE;
    *score = 0;
    return LG_OK;
}

TEST("a monitor counts samples, windows and a gap beyond 2^32") {
    enum { WINDOW = 4 };
    _Alignas(64) static char memory[1024];
    lg_monitor_options options;
    lg_monitor *monitor = NULL;
    lg_verdict v = {.window = 0};
    bool ready = false;
    lg_monitor_options_init(&options);
    options.channels = 1;
    options.window = WINDOW;
    options.bridge = 0;
    assert_ok(lg_monitor_init(&options, judge_nothing, NULL, &monitor, memory, sizeof memory, NULL));
    monitor->samples = top - 2 * WINDOW;
    monitor->windows = top - 1;
    monitor->gap = top - 1;
    monitor->received = true;
    for (uint64_t k = 0; k < 4; k++) {
        for (int i = 0; i < WINDOW; i++) assert_ok(lg_monitor_push(monitor, NULL, &ready, &v));
        assert_true(ready);
        assert_true(v.window == top - 1 + k);
        assert_true(v.first_sample == top - 2 * WINDOW + k * WINDOW);
    }
    assert_true(monitor->gap == top - 1 + 4 * WINDOW);
}

/* Runs the fit, sets its counter of steps to `step`, and runs the rest. */
static void run_from(lg_fit *fit, uint64_t step) {
    run_fit(fit);
    fit->state.step = step;
    fit->options.stop_after = 0;
    run_fit(fit);
}

/* After about 40000 steps both bias corrections of Adam are 1 in double precision. Then the parameters do not
 * depend on the counter, unless it wraps to 0. */
TEST("Adam's steps are counted beyond 2^32") {
    regression r = make_regression();
    lg_fit_options options = options_of(6, 0);
    const lg_fit_problem problem = regression_problem(&r);
    double *theta = TEST_ARRAY(double, problem.parameters);
    options.stop_after = 2;
    for (size_t i = 0; i < problem.parameters; i++) theta[i] = 0.1 * sin((double)i);
    lg_fit *below = test_fit(NULL, &problem, &options, theta),
           *across = test_fit(NULL, &problem, &options, theta);
    run_from(below, 1000000);
    run_from(across, top - 2);
    assert_memory_equal(below->state.theta, across->state.theta, problem.parameters * sizeof(double));
    assert_true(lg_fit_steps_done(across) == top + 2);
}

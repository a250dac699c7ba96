/* Searches: random draws, early stopping, and interruptions. */
#include "test_support.h"
#include "liegrad/core.h"
#include "nn/search.h"
#include "support/searches.h"
static lg_range bounds(const char *name, lg_range_kind kind, double low, double high) {
    lg_range range = {.kind = kind, .low = low, .high = high};
    (void)snprintf(range.name, sizeof range.name, "%s", name);
    return range;
}
static lg_range choices(const char *name, uint32_t count, const char *const *texts) {
    lg_range range = {.kind = LG_RANGE_CHOICE, .choices = count};
    (void)snprintf(range.name, sizeof range.name, "%s", name);
    for (uint32_t i = 0; i < count; i++)
        (void)snprintf(range.choice[i], sizeof range.choice[i], "%s", texts[i]);
    return range;
}
static const char *const three[] = {"a", "b", "c"};
/* u in [0, 1), lr in [1e-4, 1e-1], layers in 0..4, kind one of three. */
static lg_search_space example(void) {
    lg_search_space space = {.count = 4};
    space.ranges[0] = bounds("u", LG_RANGE_UNIFORM, 0, 1);
    space.ranges[1] = bounds("lr", LG_RANGE_LOG_UNIFORM, 1e-4, 1e-1);
    space.ranges[2] = bounds("layers", LG_RANGE_INTEGER, 0, 4);
    space.ranges[3] = choices("kind", 3, three);
    return space;
}
/* ---- ranges ---- */
static void refused(const lg_search_space *space, const char *word) {
    lg_error error = {LG_OK, ""};
    assert_status(lg_search_space_check(space, &error), LG_INVALID_ARGUMENT);
    if (strstr(error.message, word) == NULL) fail_msg("no '%s' in: %s", word, error.message);
    assert_status(lg_search_space_check(space, NULL), LG_INVALID_ARGUMENT);
}
TEST("a space with an invalid range is refused with the range's name") {
    lg_search_space good = example(), s = good;
    assert_ok(lg_search_space_check(&good, NULL));
    refused(NULL, "ranges");
    s.count = 0;
    refused(&s, "ranges");
    s.count = LG_RANGE_MAX + 1;
    refused(&s, "ranges");
    static const struct {
        lg_range_kind kind;
        double low, high;
        const char *word;
    } wrong[] = {
        {LG_RANGE_UNIFORM, 1, 0, "above"},
        {LG_RANGE_UNIFORM, NAN, 1, "finite"},
        {LG_RANGE_UNIFORM, 0, INFINITY, "finite"},
        {LG_RANGE_LOG_UNIFORM, 0, 1, "log-uniform"},
        {LG_RANGE_LOG_UNIFORM, -1, 1, "log-uniform"},
        {LG_RANGE_INTEGER, 0, 1.5, "whole"},
        {LG_RANGE_INTEGER, -0.5, 2, "whole"},
        {LG_RANGE_INTEGER, 0, 0x1p54, "whole"},
        {(lg_range_kind)9, 0, 1, "kind"},
    };
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        s = good;
        s.ranges[1] = bounds("x", wrong[i].kind, wrong[i].low, wrong[i].high);
        refused(&s, wrong[i].word);
    }
    static const char *const twice[] = {"a", "b", "a"}, *const quote[] = {"a", "b\"c"}, *const none[] = {""};
    s = good;
    s.ranges[3] = choices("kind", 3, twice);
    refused(&s, "twice");
    s.ranges[3] = choices("kind", 2, quote);
    refused(&s, "choice 2");
    s.ranges[3] = choices("kind", 1, none);
    refused(&s, "choice 1");
    s.ranges[3].choices = 0;
    refused(&s, "0 choices");
    s.ranges[3].choices = LG_RANGE_MAX_CHOICES + 1;
    refused(&s, "choices");
    static const char *const names[] = {"", "a\"b", "a\nb"};
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        s = good;
        (void)snprintf(s.ranges[2].name, sizeof s.ranges[2].name, "%s", names[i]);
        refused(&s, "range 3");
    }
    s = good;
    memset(s.ranges[2].name, 'x', sizeof s.ranges[2].name); /* not terminated by a zero */
    refused(&s, "range 3");
    s = good;
    (void)snprintf(s.ranges[2].name, sizeof s.ranges[2].name, "lr");
    refused(&s, "'lr' stands twice");
}
TEST("draws have the mean and variance of their range; integers reach both ends, choices all values") {
    enum { N = 20000 };
    const lg_search_space space = example();
    double sum[2] = {0}, squares[2] = {0};
    int layers[5] = {0}, kinds[3] = {0};
    for (uint64_t t = 0; t < N; t++) {
        double v[4];
        lg_search_draw(&space, 1, t, v);
        assert_true(v[0] >= 0 && v[0] < 1 && v[1] >= 1e-4 && v[1] <= 1e-1);
        const double x[2] = {v[0], log10(v[1])};
        for (int k = 0; k < 2; k++) sum[k] += x[k] / N, squares[k] += x[k] * x[k] / N;
        assert_true(v[2] == (int)v[2] && v[2] >= 0 && v[2] <= 4 && v[3] == (int)v[3] && v[3] >= 0 &&
                    v[3] < 3);
        layers[(int)v[2]]++;
        kinds[(int)v[3]]++;
    }
    /* Five standard deviations. */
    assert_close(sum[0], 0.5, 0, 5 * sqrt(1.0 / 12 / N));
    assert_close(sum[1], -2.5, 0, 5 * sqrt(9.0 / 12 / N));
    assert_close(squares[0] - sum[0] * sum[0], 1.0 / 12, 0.03, 0);
    assert_close(squares[1] - sum[1] * sum[1], 9.0 / 12, 0.03, 0);
    for (int i = 0; i < 5; i++) assert_close(layers[i], N / 5.0, 0, 5 * sqrt(N * 0.2 * 0.8));
    for (int i = 0; i < 3; i++) assert_close(kinds[i], N / 3.0, 0, 5 * sqrt(N * 2.0 / 9));
}
TEST("draws depend on seed, trial number and range, and not on later ranges") {
    lg_search_space space = example();
    double v[3][8], w[8];
    lg_search_draw(&space, 7, 41, v[0]);
    lg_search_draw(&space, 7, 42, v[1]);
    lg_search_draw(&space, 8, 41, v[2]);
    lg_search_draw(&space, 7, 41, w);
    assert_memory_equal(v[0], w, 4 * sizeof *w);
    assert_true(v[0][0] != v[1][0] && v[0][0] != v[2][0] && v[1][0] != v[2][0]);
    assert_true(v[0][1] != v[1][1] && v[0][1] != v[2][1]);
    /* Another range at the end does not change the earlier ones, and has its own draws. */
    space.ranges[4] = bounds("w", LG_RANGE_UNIFORM, 0, 1);
    space.count = 5;
    lg_search_draw(&space, 7, 41, w);
    assert_memory_equal(v[0], w, 4 * sizeof *w);
    assert_true(w[4] != w[0]);
}
TEST("the narrowest and the widest ranges can be drawn from") {
    lg_search_space space = {.count = 6};
    space.ranges[0] = bounds("one", LG_RANGE_UNIFORM, 2.5, 2.5);
    space.ranges[1] = bounds("wide", LG_RANGE_UNIFORM, -1.7e308, 1.7e308);
    space.ranges[2] = bounds("thin", LG_RANGE_UNIFORM, 1, nextafter(1, 2));
    space.ranges[3] = bounds("log", LG_RANGE_LOG_UNIFORM, 0.1, 0.1);
    space.ranges[4] = bounds("whole", LG_RANGE_INTEGER, -0x1p53, 0x1p53);
    space.ranges[5] = bounds("two", LG_RANGE_INTEGER, -1, 0);
    assert_ok(lg_search_space_check(&space, NULL));
    bool low = false, high = false;
    for (uint64_t t = 0; t < 200; t++) {
        double v[6];
        lg_search_draw(&space, 1, t, v);
        assert_true(v[0] == 2.5 && isfinite(v[1]) && v[2] == 1 && v[3] == 0.1);
        assert_true(fabs(v[4]) <= 0x1p53 && floor(v[4]) == v[4]);
        low = low || v[5] == -1;
        high = high || v[5] == 0;
        assert_true(v[5] == -1 || v[5] == 0);
    }
    assert_true(low && high);
}
/* ---- early stopping ---- */
static lg_trial with_report(uint64_t number, uint32_t reports, double value) {
    lg_trial trial = {.number = number, .reports = reports};
    for (uint32_t i = 0; i < reports; i++) trial.report[i] = value;
    return trial;
}
TEST("a trial that is worse than the quantile of the others is stopped") {
    lg_search_options o;
    lg_search_options_init(&o);
    assert_true(o.size == sizeof o && o.seed == 1 && o.rungs == 5 && o.warm_up == 5);
    assert_close(o.quantile, 0.5, 0, 0);
    o.warm_up = 4;
    lg_trial t[6];
    for (uint64_t i = 0; i < 6; i++) t[i] = with_report(i, 1, 1.0 + (double)i); /* 1 2 3 4 5 6 */
    /* Half of four is two: 2.5 is worse than 1 and 2. */
    assert_true(lg_search_prune(&o, t, 4, 4, 0, 2.5));
    assert_false(lg_search_prune(&o, t, 4, 4, 0, 1.5));
    /* An equal objective is not worse. */
    assert_false(lg_search_prune(&o, t, 4, 4, 0, 2));
    assert_true(lg_search_prune(&o, t, 4, 4, 0, 3));
    /* Half of five, rounded up, is three. */
    assert_false(lg_search_prune(&o, t, 5, 5, 0, 2.5));
    assert_true(lg_search_prune(&o, t, 5, 5, 0, 3.5));
    /* Fewer trials than the warm-up, or no trial that reached this rung. */
    assert_false(lg_search_prune(&o, t, 3, 3, 0, 100));
    assert_false(lg_search_prune(&o, t, 6, 6, 1, 100));
    o.warm_up = 0;
    assert_false(lg_search_prune(&o, t, 0, 0, 0, 100));
    assert_false(lg_search_prune(&o, t, 6, 6, 1, 100));
    assert_true(lg_search_prune(&o, t, 1, 1, 0, 100));
    /* An objective that is not finite is always stopped, and counts as worse than all others. */
    assert_true(lg_search_prune(&o, t, 0, 0, 0, NAN));
    assert_true(lg_search_prune(&o, t, 0, 0, 0, INFINITY));
    assert_true(lg_search_prune(&o, t, 0, 0, 0, -INFINITY));
    t[0].report[0] = NAN;
    t[1].report[0] = -INFINITY; /* 3, 4 and two that diverged: two of four are better than 4.5 */
    o.warm_up = 4;
    assert_true(lg_search_prune(&o, t, 4, 4, 0, 4.5));
    assert_false(lg_search_prune(&o, t, 4, 4, 0, 3.5));
    for (uint64_t i = 0; i < 6; i++) t[i].report[0] = NAN;
    assert_false(lg_search_prune(&o, t, 6, 6, 0, 1e300));
    /* Trials with higher numbers do not count, wherever they are in the table. */
    for (uint64_t i = 0; i < 6; i++) t[i] = with_report(5 - i, 1, 1);
    assert_true(lg_search_prune(&o, t, 6, 4, 0, 2));
    assert_false(lg_search_prune(&o, t, 6, 3, 0, 2));
}
TEST("the quantile determines how many better trials stop a trial") {
    lg_search_options o;
    lg_search_options_init(&o);
    o.warm_up = 1;
    lg_trial t[30];
    for (uint64_t i = 0; i < 30; i++) t[i] = with_report(i, 1, (double)i);
    static const struct {
        double quantile;
        int better; /* the smallest number of better trials that stops a trial */
    } rows[] = {{0.1, 3}, {0.5, 15}, {0.25, 8}, {1, 30}, {1e-6, 1}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        o.quantile = rows[i].quantile;
        for (int b = 0; b <= 30; b++)
            assert_int_equal(lg_search_prune(&o, t, 30, 30, 0, b - 0.5), b >= rows[i].better);
    }
}
/* ---- running trials ---- */
#define TRIALS 24
#define EPOCHS 12
/* Trials whose objective falls towards a value that depends on the drawn numbers; some diverge, some fail.
 * `stop_at`: the cancel flag is raised when all trials together have run this many epochs. */
typedef struct training {
    volatile int cancel;
    long stop_at, epochs;
    size_t finished;
    bool by_status; /* returns LG_CANCELLED when a report says stop, as a fit does */
    uint32_t rungs_seen;
    size_t failures;
} training;
static double curve(const lg_trial *trial, uint64_t done) {
    const double end = trial->value[0] + 0.1 * trial->value[3];
    if (trial->value[2] == 3 && done >= 5) return NAN;
    return end + exp(-100 * trial->value[1] * (double)done);
}
static lg_status run(void *user, lg_search *search, lg_trial *trial, lg_error *error) {
    training *t = user;
    trial->parameters = 10 + trial->number;
    if (trial->value[2] == 4 && trial->value[3] == 0) {
        (void)snprintf(error->message, sizeof error->message, "cannot be trained");
        return LG_SHAPE;
    }
    for (uint64_t done = 1; done <= EPOCHS; done++) {
        if (++t->epochs == t->stop_at) t->cancel = 1;
        if (t->cancel) return LG_CANCELLED;
        trial->epochs = done;
        trial->objective = curve(trial, done);
        const bool stop = lg_search_report(search, done, EPOCHS, trial->objective);
        if (trial->reports > t->rungs_seen) t->rungs_seen = trial->reports;
        if (stop) return t->by_status ? LG_CANCELLED : LG_OK;
    }
    return LG_OK;
}
static lg_status finished(void *user, const lg_trial *trials, size_t count, const lg_error *error) {
    training *t = user;
    t->finished++;
    const bool failed = trials[count - 1].state == LG_TRIAL_FAILED;
    assert_int_equal(failed, error->status != LG_OK);
    assert_int_equal(failed, error->message[0] != '\0');
    if (failed) assert_status(error->status, LG_SHAPE);
    t->failures += failed;
    return LG_OK;
}
static lg_search_options few(void) {
    lg_search_options options;
    lg_search_options_init(&options);
    options.seed = 3;
    return options;
}
/* Trials must be equal except for their seconds. */
static void assert_same_trials(const lg_trial *a, const lg_trial *b, size_t count) {
    for (size_t i = 0; i < count; i++) {
        lg_trial x = a[i], y = b[i];
        x.seconds = y.seconds = 0;
        /* Normalises NaN, so that all have one bit pattern. */
        if (isnan(x.objective) && isnan(y.objective)) x.objective = y.objective = 0;
        for (uint32_t k = 0; k < LG_TRIAL_REPORTS; k++)
            if (isnan(x.report[k]) && isnan(y.report[k])) x.report[k] = y.report[k] = 0;
        assert_int_equal(x.number, y.number);
        assert_int_equal(x.state, y.state);
        assert_int_equal(x.parameters, y.parameters);
        assert_int_equal(x.epochs, y.epochs);
        assert_int_equal(x.reports, y.reports);
        assert_close(x.objective, y.objective, 0, 0);
        assert_memory_equal(x.value, y.value, sizeof x.value);
        assert_memory_equal(x.report, y.report, sizeof x.report);
    }
}
static void search_whole(training *t, lg_trial *trials) {
    const lg_search_space space = example();
    const lg_search_options options = few();
    const lg_search_problem problem = {run, t};
    size_t count = 0;
    assert_ok(serial_search(NULL, &space, &options, TRIALS, &problem, finished, trials, &count));
    assert_int_equal(count, TRIALS);
    assert_int_equal(t->finished, TRIALS);
}
TEST("a search runs, stops and fails its trials, and finds the best") {
    lg_trial trials[TRIALS], again[TRIALS];
    training t = {.stop_at = 0}, u = {.by_status = true};
    search_whole(&t, trials);
    size_t states[LG_TRIAL_STATE_COUNT] = {0};
    const lg_search_space space = example();
    for (size_t i = 0; i < TRIALS; i++) {
        double v[4];
        lg_search_draw(&space, 3, i, v);
        assert_int_equal(trials[i].number, i);
        assert_memory_equal(trials[i].value, v, sizeof v);
        assert_true(trials[i].seconds >= 0 && trials[i].seconds < 10);
        states[trials[i].state]++;
        const bool whole = trials[i].state == LG_TRIAL_DONE;
        assert_int_equal(whole, trials[i].state != LG_TRIAL_FAILED && trials[i].epochs == EPOCHS);
        if (whole) assert_int_equal(trials[i].reports, 5);
        if (trials[i].state == LG_TRIAL_FAILED) assert_true(isnan(trials[i].objective));
        /* Twelve epochs and five rungs: a report after every second epoch. */
        if (trials[i].state == LG_TRIAL_PRUNED && !isnan(trials[i].objective)) {
            assert_int_equal(trials[i].epochs, 2 * trials[i].reports);
            assert_close(trials[i].objective, trials[i].report[trials[i].reports - 1], 0, 0);
        }
        for (uint32_t r = 0; r < trials[i].reports; r++)
            assert_close(trials[i].report[r], curve(&trials[i], 2 * r + 2), 0, 0);
    }
    print_message("done %zu, pruned %zu, failed %zu\n", states[0], states[1], states[2]);
    assert_true(states[LG_TRIAL_DONE] >= 5 && states[LG_TRIAL_PRUNED] >= 5 && states[LG_TRIAL_FAILED] >= 1);
    assert_int_equal(t.failures, states[LG_TRIAL_FAILED]);
    /* The status of a fit that a report stopped does not count as an interruption. */
    search_whole(&u, again);
    assert_same_trials(trials, again, TRIALS);
    const size_t best = lg_search_best(trials, TRIALS);
    assert_true(best < TRIALS && trials[best].state == LG_TRIAL_DONE);
    for (size_t i = 0; i < TRIALS; i++)
        if (trials[i].state == LG_TRIAL_DONE) assert_true(trials[i].objective >= trials[best].objective);
}
TEST("a search that is cancelled at any epoch and continued gives the same table") {
    lg_trial whole[TRIALS], parts[TRIALS];
    training t = {.stop_at = 0};
    search_whole(&t, whole);
    const lg_search_space space = example();
    const lg_search_options options = few();
    for (long stop = 1; stop <= t.epochs; stop++) {
        training u = {.stop_at = stop};
        const lg_search_problem problem = {run, &u};
        size_t count = 0;
        assert_status(serial_search(&u.cancel, &space, &options, TRIALS, &problem, finished, parts, &count),
                      LG_CANCELLED);
        assert_true(count < TRIALS && count == u.finished);
        /* While it is still cancelled nothing runs. */
        const long epochs = u.epochs;
        assert_status(serial_search(&u.cancel, &space, &options, TRIALS, &problem, finished, parts, &count),
                      LG_CANCELLED);
        assert_int_equal(u.epochs, epochs);
        u.cancel = 0;
        assert_ok(serial_search(&u.cancel, &space, &options, TRIALS, &problem, finished, parts, &count));
        assert_int_equal(count, TRIALS);
        assert_int_equal(u.finished, TRIALS);
        assert_same_trials(whole, parts, TRIALS);
    }
}
TEST("any trial that is missing in the table is run again with the same result") {
    lg_trial whole[TRIALS], parts[TRIALS];
    training t = {.stop_at = 0};
    search_whole(&t, whole);
    const lg_search_space space = example();
    const lg_search_options options = few();
    for (size_t hole = 0; hole < TRIALS; hole++) {
        training u = {.stop_at = 0};
        const lg_search_problem problem = {run, &u};
        size_t count = 0;
        for (size_t i = TRIALS; i-- > 0;)
            if (i != hole) parts[count++] = whole[i];
        assert_ok(serial_search(NULL, &space, &options, TRIALS, &problem, finished, parts, &count));
        assert_int_equal(count, TRIALS);
        assert_int_equal(u.finished, 1);
        assert_same_trials(&whole[hole], &parts[TRIALS - 1], 1);
    }
    /* Nothing is left to do. */
    training u = {.stop_at = 0};
    const lg_search_problem problem = {run, &u};
    size_t count = TRIALS;
    assert_ok(serial_search(NULL, &space, &options, TRIALS, &problem, finished, whole, &count));
    assert_int_equal(u.finished, 0);
}
TEST("invalid arguments and options are refused") {
    lg_trial trial;
    training t = {.stop_at = 0};
    const lg_search_space space = example(), empty = {.count = 0};
    const lg_search_problem problem = {run, &t}, nothing = {NULL, &t};
    lg_search_options o = few();
    assert_status(lg_search_run_trial(&empty, &o, &problem, NULL, 0, &trial, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_search_run_trial(&space, &o, &nothing, NULL, 0, &trial, NULL), LG_INVALID_ARGUMENT);
    lg_search_space odd = example();
    memcpy(odd.ranges[0].name, "\x7f", 2);
    assert_status(lg_search_space_check(&odd, NULL), LG_INVALID_ARGUMENT);
    const struct {
        double quantile;
        uint32_t rungs;
        size_t size;
    } wrong[] = {{0, 5, sizeof o}, {1.1, 5, sizeof o}, {NAN, 5, sizeof o}, {0.5, 17, sizeof o}, {0.5, 5, 0}};
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        o = few();
        o.quantile = wrong[i].quantile;
        o.rungs = wrong[i].rungs;
        o.size = wrong[i].size;
        assert_status(lg_search_run_trial(&space, &o, &problem, NULL, 0, &trial, NULL), LG_INVALID_ARGUMENT);
    }
    assert_int_equal(t.epochs, 0);
}
TEST("there may be no rungs, and more rungs than epochs") {
    lg_trial trials[TRIALS];
    const lg_search_space space = example();
    training t = {.stop_at = 0};
    const lg_search_problem problem = {run, &t};
    lg_search_options o = few();
    size_t count = 0;
    o.rungs = 0;
    assert_ok(serial_search(NULL, &space, &o, TRIALS, &problem, NULL, trials, &count));
    assert_int_equal(t.rungs_seen, 0);
    for (size_t i = 0; i < TRIALS; i++) /* only trials that diverged were stopped */
        if (trials[i].state == LG_TRIAL_PRUNED) assert_true(isnan(trials[i].objective));
    count = 0;
    o.rungs = LG_TRIAL_REPORTS; /* after 12/17, 24/17, ... epochs */
    assert_ok(serial_search(NULL, &space, &o, TRIALS, &problem, NULL, trials, &count));
    assert_int_equal(t.rungs_seen, LG_TRIAL_REPORTS);
    for (size_t i = 0; i < TRIALS; i++)
        for (uint32_t r = 0; r < trials[i].reports; r++) {
            const uint64_t epoch = ((r + 1) * EPOCHS + 16) / 17;
            const double expected = curve(&trials[i], epoch);
            if (isnan(expected))
                assert_true(isnan(trials[i].report[r]));
            else
                assert_close(trials[i].report[r], expected, 0, 0);
        }
    assert_false(lg_search_report(NULL, 1, 2, 3.0));
}
static lg_status run_once(void *user, lg_search *search, lg_trial *trial, lg_error *error) {
    (void)user;
    (void)error;
    trial->epochs = 1;
    assert_false(lg_search_report(search, 1, 1, (double)trial->number));
    trial->objective = (double)trial->number;
    return LG_OK;
}
TEST("a trial is not stopped after its last epoch") {
    lg_trial trials[TRIALS];
    const lg_search_space space = example();
    const lg_search_problem problem = {run_once, NULL};
    const lg_search_options o = few();
    size_t count = 0;
    assert_ok(serial_search(NULL, &space, &o, TRIALS, &problem, NULL, trials, &count));
    lg_trial alone[TRIALS];
    lg_error why;
    for (size_t i = 0; i < TRIALS; i++)
        assert_ok(lg_search_run_trial(&space, &o, &problem, NULL, i, &alone[i], &why));
    lg_search_settle(&o, alone, TRIALS);
    for (size_t i = 0; i < TRIALS; i++) {
        assert_int_equal(trials[i].state, LG_TRIAL_DONE);
        assert_int_equal(trials[i].reports, 5);
        assert_int_equal(alone[i].state, LG_TRIAL_DONE);
        assert_int_equal(alone[i].reports, 5);
    }
}
TEST("the best trial is the first done one with the lowest objective") {
    lg_trial t[5];
    static const struct {
        uint64_t number;
        lg_trial_state state;
        double objective;
    } rows[5] = {{4, LG_TRIAL_DONE, 2},
                 {1, LG_TRIAL_PRUNED, 0.1},
                 {3, LG_TRIAL_DONE, 2},
                 {0, LG_TRIAL_FAILED, NAN},
                 {2, LG_TRIAL_DONE, NAN}};
    for (int i = 0; i < 5; i++)
        t[i] = (lg_trial){.number = rows[i].number, .state = rows[i].state, .objective = rows[i].objective};
    assert_int_equal(lg_search_best(t, 5), 2);
    assert_int_equal(lg_search_best(t, 1), 0);
    assert_int_equal(lg_search_best(t + 3, 2), 2);
    assert_int_equal(lg_search_best(NULL, 0), 0);
    assert_string_equal(lg_trial_state_name(LG_TRIAL_PRUNED), "pruned");
    assert_string_equal(lg_trial_state_name((lg_trial_state)LG_TRIAL_STATE_COUNT), "unknown");
    assert_string_equal(lg_trial_state_name((lg_trial_state)-1), "unknown");
}
/* ---- trials that run at the same time ---- */

/* Trials that run in any order. A trial sees the trials before it once all of them have run. */
typedef struct beside {
    training training;
    lg_search_options options;
    lg_trial all[TRIALS]; /* indexed by trial number */
    bool ran[TRIALS];
    bool tells; /* whether trials may ask if they should stop */
    size_t asked, stopped;
} beside;

static lg_status run_beside(void *user, lg_search *search, lg_trial *trial, lg_error *error) {
    beside *b = user;
    return run(&b->training, search, trial, error);
}

static bool known(void *user, const lg_trial *trial, uint32_t rung, const lg_trial **trials, size_t *count) {
    static lg_trial settled[TRIALS];
    beside *b = user;
    b->asked++;
    assert_true(trial->reports > rung);
    for (size_t i = 0; i < trial->number; i++)
        if (!b->ran[i]) return false;
    memcpy(settled, b->all, sizeof settled);
    lg_search_settle(&b->options, settled, trial->number);
    *trials = settled;
    *count = trial->number;
    return b->tells;
}

static void run_in_order(beside *b, const size_t *order) {
    const lg_search_space space = example();
    const lg_search_problem problem = {run_beside, b};
    for (size_t i = 0; i < TRIALS; i++) {
        lg_error why = {LG_OK, ""};
        lg_trial *trial = &b->all[order[i]];
        assert_ok(lg_search_run_trial(&space, &b->options, &problem, known, order[i], trial, &why));
        assert_int_equal(trial->state == LG_TRIAL_FAILED, why.message[0] != '\0');
        b->ran[order[i]] = true;
        b->stopped += trial->state == LG_TRIAL_PRUNED;
    }
}

TEST("trials run in any order, seeing others or not, settle to the table of a sequential search") {
    lg_trial whole[TRIALS], mixed[TRIALS];
    training t = {.stop_at = 0};
    search_whole(&t, whole);
    for (uint64_t round = 0; round < 40; round++) {
        beside *b = lg_test_memory(sizeof *b);
        size_t order[TRIALS];
        b->options = few();
        b->tells = round % 2 == 0;
        b->training.by_status = round % 3 == 0;
        lg_rng rng = test_rng(round, 0);
        for (size_t i = 0; i < TRIALS; i++) order[i] = round == 0 ? i : TRIALS - 1 - i;
        for (size_t i = TRIALS - 1; round > 1 && i > 0; i--) {
            const size_t k = (size_t)lg_rng_below(&rng, i + 1), kept = order[i];
            order[i] = order[k];
            order[k] = kept;
        }
        run_in_order(b, order);
        assert_true(b->asked > 0);
        for (size_t i = 0; i < TRIALS; i++) mixed[i] = b->all[order[i]];
        lg_search_settle(&b->options, mixed, TRIALS);
        assert_same_trials(whole, mixed, TRIALS);
        /* If they ran in order, nothing is left to settle. */
        if (round == 0) assert_same_trials(whole, b->all, TRIALS);
        lg_search_settle(&b->options, mixed, TRIALS);
        assert_same_trials(whole, mixed, TRIALS);
    }
}

TEST("rungs that one report passes are decided together, and a cancelled trial is not kept") {
    const lg_search_space space = example();
    lg_trial whole[TRIALS], alone[TRIALS];
    training t = {.stop_at = 0}, u = {.stop_at = 1};
    lg_search_options o = few();
    const lg_search_problem problem = {run, &t}, broken = {run, &u};
    size_t count = 0;
    lg_error why;
    o.rungs = LG_TRIAL_REPORTS;
    assert_ok(serial_search(NULL, &space, &o, TRIALS, &problem, NULL, whole, &count));
    for (size_t i = 0; i < TRIALS; i++)
        assert_ok(lg_search_run_trial(&space, &o, &problem, NULL, i, &alone[i], &why));
    lg_search_settle(&o, alone, TRIALS);
    assert_same_trials(whole, alone, TRIALS);
    assert_status(lg_search_run_trial(&space, &o, &broken, NULL, 1, &alone[1], &why), LG_CANCELLED);
}

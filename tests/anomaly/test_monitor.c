/* Watching a feed: windows, gaps, votes, memory. */
#include "test_support.h"

#include "liegrad/anomaly.h"
#include "support/malloc_count.h"

enum { CHANNELS = 2, WINDOW = 10, ROOM = 1 << 16 };

/* A judge that records the window it is given and answers as its script says. */
typedef struct witness {
    uint32_t channels, window, seen, missing;
    float x[CHANNELS * 512];
    const char *script; /* one letter per window: p positive, n novel, f failure, others negative */
} witness;

static lg_status look(void *user, const float *x, uint32_t missing, lg_answer *given, double *score) {
    witness *w = user;
    const char answer = w->script != NULL && w->seen < strlen(w->script) ? w->script[w->seen] : '-';
    memcpy(w->x, x, (size_t)w->channels * w->window * sizeof *x);
    w->seen++;
    w->missing = missing;
    *given = answer == 'p' ? LG_ANSWER_POSITIVE : answer == 'n' ? LG_ANSWER_NOVEL : LG_ANSWER_NEGATIVE;
    *score = answer == 'p' ? 0.75 : 0.25;
    return answer == 'f' ? LG_NO_CONVERGENCE : LG_OK;
}

static _Alignas(64) unsigned char memory[ROOM];

static lg_monitor_options options_of(uint32_t channels, uint32_t window, uint32_t hop) {
    lg_monitor_options options;
    lg_monitor_options_init(&options);
    options.channels = channels;
    options.window = window;
    options.hop = hop;
    return options;
}

static lg_monitor *start(const lg_monitor_options *options, witness *w) {
    lg_monitor *watch = NULL;
    w->channels = options->channels;
    w->window = options->window;
    assert_in_range(lg_monitor_size(options), 1, ROOM);
    memset(memory, 0xa5, sizeof memory);
    assert_ok(lg_monitor_init(options, look, w, &watch, memory, lg_monitor_size(options), NULL));
    return watch;
}

static float value_at(uint64_t i, uint32_t c) {
    return (float)((double)i * (c == 0 ? 1.0 : -3.0) + 0.5);
}

/* Pushes sample i of a feed whose channels rise by 1 and fall by 3 per sample; `lost`: the sample is
 * missing. */
static bool push(lg_monitor *watch, uint64_t i, bool lost, lg_verdict *verdict) {
    const float sample[CHANNELS] = {value_at(i, 0), value_at(i, 1)};
    bool ready = false;
    assert_ok(lg_monitor_push(watch, lost ? NULL : sample, &ready, verdict));
    return ready;
}

TEST("a window is judged after every hop") {
    const uint32_t hops[] = {0, 1, 3, 7, WINDOW};
    for (size_t h = 0; h < LG_COUNT(hops); h++) {
        const uint32_t hop = hops[h] == 0 ? WINDOW : hops[h];
        const lg_monitor_options options = options_of(CHANNELS, WINDOW, hops[h]);
        witness w = {.seen = 0};
        lg_monitor *watch = start(&options, &w);
        uint64_t windows = 0;
        for (uint64_t i = 0; i < 100; i++) {
            lg_verdict v;
            const bool due = i + 1 >= WINDOW && (i + 1 - WINDOW) % hop == 0;
            assert_int_equal(push(watch, i, false, &v), due);
            if (!due) continue;
            assert_int_equal(v.window, windows++);
            assert_int_equal(v.first_sample, i + 1 - WINDOW);
            assert_true(v.scored && v.answer == LG_ANSWER_NEGATIVE && v.missing == 0 && !v.alarm);
            assert_close(v.score, 0.25, 0, 0);
            for (uint32_t c = 0; c < CHANNELS; c++)
                for (uint32_t k = 0; k < WINDOW; k++)
                    assert_close(w.x[c * WINDOW + k], value_at(v.first_sample + k, c), 0, 0);
        }
        assert_int_equal(w.seen, windows);
    }
}

/* Runs a feed in which samples from..to-1 are lost. Returns the verdict on the last window that was
 * judged. */
static lg_verdict run_gap(const lg_monitor_options *options, witness *w, uint64_t from, uint64_t to,
                          uint64_t end) {
    lg_monitor *watch = start(options, w);
    lg_verdict v = {.window = 99}, last = {.window = 99};
    for (uint64_t i = 0; i < end; i++)
        if (push(watch, i, i >= from && i < to, &v)) last = v;
    return last;
}

TEST("short gaps are bridged by a line") {
    lg_monitor_options options = options_of(CHANNELS, WINDOW, 0);
    options.missing = 0.5;
    for (uint64_t gap = 1; gap <= 5; gap++) {
        witness w = {.seen = 0};
        const lg_verdict v = run_gap(&options, &w, 3, 3 + gap, WINDOW);
        assert_true(v.scored);
        assert_int_equal(v.missing, gap);
        assert_int_equal(w.missing, gap);
        for (uint32_t k = 0; k < WINDOW; k++) {
            assert_close(w.x[k], value_at(k, 0), 1e-6, 0);
            assert_close(w.x[WINDOW + k], value_at(k, 1), 1e-6, 0);
        }
    }
}

TEST("a gap across the end of a window is held there, and bridged once it is closed") {
    lg_monitor_options options = options_of(CHANNELS, WINDOW, 0);
    options.missing = 0.5;
    witness w = {.seen = 0};
    lg_monitor *watch = start(&options, &w);
    lg_verdict v;
    /* still open: the last value is held */
    for (uint64_t i = 0; i < WINDOW; i++) (void)push(watch, i, i >= 8, &v);
    for (uint32_t k = 0; k < WINDOW; k++) assert_close(w.x[k], value_at(k < 8 ? k : 7, 0), 1e-6, 0);
    assert_int_equal(v.missing, 2);
    for (uint64_t i = WINDOW; i < 2 * WINDOW; i++) (void)push(watch, i, i < 12, &v); /* closed: a line */
    for (uint32_t k = 0; k < WINDOW; k++) assert_close(w.x[k], value_at(WINDOW + k, 0), 1e-6, 0);
    assert_int_equal(v.missing, 2);
}

TEST("in long gaps the last value is held") {
    lg_monitor_options options = options_of(CHANNELS, WINDOW, 0);
    options.missing = 0.6;
    witness w = {.seen = 0};
    const lg_verdict v = run_gap(&options, &w, 2, 8, WINDOW);
    assert_true(v.scored);
    for (uint32_t k = 0; k < WINDOW; k++) assert_close(w.x[k], value_at(k >= 2 && k < 8 ? 1 : k, 0), 1e-6, 0);
    options.bridge = 6;
    (void)run_gap(&options, &w, 2, 8, WINDOW);
    for (uint32_t k = 0; k < WINDOW; k++) assert_close(w.x[k], value_at(k, 0), 1e-6, 0);
    options.bridge = 0;
    (void)run_gap(&options, &w, 2, 3, WINDOW);
    assert_close(w.x[2], value_at(1, 0), 0, 0);
}

TEST("of a bridged gap longer than the window, the window has only the end") {
    lg_monitor_options options = options_of(CHANNELS, WINDOW, 0);
    options.missing = 1.0;
    options.bridge = 100;
    witness w = {.seen = 0};
    const lg_verdict v = run_gap(&options, &w, 5, 29, 30);
    assert_int_equal(v.missing, 9);
    for (uint32_t k = 0; k < WINDOW; k++) assert_close(w.x[k], value_at(20 + k, 0), 1e-6, 0);
}

TEST("lost samples at the start of a feed take the first value, and at its end the last one") {
    lg_monitor_options options = options_of(CHANNELS, WINDOW, 0);
    options.missing = 1.0;
    witness w = {.seen = 0};
    lg_monitor *watch = start(&options, &w);
    lg_verdict v;
    for (uint64_t i = 0; i < 10; i++) (void)push(watch, i, true, &v);
    assert_false(v.scored); /* nothing was received */
    assert_int_equal(w.seen, 0);
    assert_int_equal(v.missing, 10);
    for (uint64_t i = 10; i < 20; i++) (void)push(watch, i, i < 17, &v);
    assert_true(v.scored);
    for (uint32_t k = 0; k < WINDOW; k++) assert_close(w.x[k], value_at(k < 7 ? 17 : 10 + k, 0), 0, 0);
    /* now a window that ends with lost samples */
    for (uint64_t i = 20; i < 30; i++) (void)push(watch, i, i >= 22, &v);
    for (uint32_t k = 0; k < WINDOW; k++) assert_close(w.x[k], value_at(k < 2 ? 20 + k : 21, 0), 0, 0);
}

TEST("a window with too many missing samples is not judged") {
    const lg_monitor_options options = options_of(CHANNELS, 300, 0); /* allowed: a tenth, 30 samples */
    witness w = {.seen = 0, .script = "ppppp"};
    assert_true(run_gap(&options, &w, 100, 130, 300).scored);
    w.seen = 0;
    const lg_verdict v = run_gap(&options, &w, 100, 131, 300);
    assert_false(v.scored);
    assert_int_equal(v.missing, 31);
    assert_int_equal(w.seen, 0);
}

TEST("windows that are not judged do not change the alarm") {
    lg_monitor_options options = options_of(CHANNELS, WINDOW, 0);
    options.votes = 2;
    options.votes_of = 3;
    witness w = {.seen = 0, .script = "pp---"};
    lg_monitor *watch = start(&options, &w);
    lg_verdict v;
    for (uint64_t i = 0; i < 20; i++) (void)push(watch, i, false, &v);
    assert_true(v.alarm && v.scored && v.window == 1);
    for (uint64_t i = 20; i < 60; i++) {
        if (!push(watch, i, true, &v)) continue;
        assert_true(!v.scored && v.alarm);
        assert_int_equal(v.missing, WINDOW);
        assert_int_equal(v.votes, 2);
    }
    for (uint64_t i = 60; i < 70; i++) (void)push(watch, i, false, &v);
    assert_true(v.scored && v.alarm && v.votes == 3);
    for (uint64_t i = 70; i < 80; i++) (void)push(watch, i, false, &v);
    assert_false(v.alarm);
    assert_int_equal(v.window, 7);
}

TEST("the alarm needs k votes of the last n windows") {
    static const struct {
        uint32_t k, n;
        const char *script, *alarm;
    } rows[] = {
        {3, 5, "p-p-p-----ppp---", "----*-------***-"},
        {1, 1, "-p-pp-", "-*-**-"},
        {2, 2, "pp-pp", "-*--*"},
        {3, 5, "pp------", "--------"},
    };
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        lg_monitor_options options = options_of(CHANNELS, 1, 0);
        options.votes = rows[r].k;
        options.votes_of = rows[r].n;
        witness w = {.seen = 0, .script = rows[r].script};
        lg_monitor *watch = start(&options, &w);
        for (uint32_t i = 0; rows[r].script[i] != '\0'; i++) {
            lg_verdict v;
            uint32_t positive = 0, votes = i + 1 < rows[r].n ? i + 1 : rows[r].n;
            for (uint32_t j = 0; j < votes; j++) positive += rows[r].script[i - j] == 'p';
            assert_true(push(watch, i, false, &v));
            assert_int_equal(v.positive_votes, positive);
            assert_int_equal(v.votes, votes);
            assert_int_equal(v.alarm, positive >= rows[r].k);
            assert_int_equal(v.alarm, rows[r].alarm[i] == '*');
        }
    }
}

TEST("sixty-four votes are kept") {
    lg_monitor_options options = options_of(CHANNELS, 1, 0);
    options.votes = options.votes_of = 64;
    char script[71];
    memset(script, 'p', 70);
    script[70] = '\0';
    witness w = {.seen = 0, .script = script};
    lg_monitor *watch = start(&options, &w);
    for (uint64_t i = 0; i < 70; i++) {
        lg_verdict v;
        (void)push(watch, i, false, &v);
        assert_int_equal(v.alarm, i >= 63);
    }
}

TEST("if the judge fails there is a verdict without a vote") {
    const lg_monitor_options options = options_of(CHANNELS, 2, 0);
    witness w = {.seen = 0, .script = "pf-"};
    lg_monitor *watch = start(&options, &w);
    const float sample[CHANNELS] = {1, 2};
    lg_verdict v = {.window = 99};
    bool ready = false;
    for (int i = 0; i < 3; i++) assert_ok(lg_monitor_push(watch, sample, &ready, &v));
    v.window = 99;
    ready = true;
    assert_status(lg_monitor_push(watch, sample, &ready, &v), LG_NO_CONVERGENCE);
    assert_true(ready && v.window == 99);
    for (int i = 0; i < 2; i++) assert_ok(lg_monitor_push(watch, sample, &ready, &v));
    assert_true(ready);
    assert_int_equal(v.window, 2);
    assert_int_equal(v.votes, 2);
    assert_int_equal(v.positive_votes, 1);
}

TEST("values that are not finite count as lost samples") {
    const lg_monitor_options options = options_of(CHANNELS, WINDOW, 0);
    witness w = {.seen = 0};
    lg_monitor *watch = start(&options, &w);
    lg_verdict v;
    bool ready;
    for (uint64_t i = 0; i < WINDOW; i++) {
        float sample[CHANNELS] = {value_at(i, 0), value_at(i, 1)};
        if (i == 4) sample[1] = NAN;
        if (i == 6) sample[0] = -INFINITY;
        assert_ok(lg_monitor_push(watch, sample, &ready, &v));
    }
    assert_true(ready && !v.scored);
    assert_int_equal(v.missing, 2);
    lg_monitor_options lenient = options;
    lenient.missing = 0.2;
    watch = start(&lenient, &w);
    for (uint64_t i = 0; i < WINDOW; i++) {
        float sample[CHANNELS] = {value_at(i, 0), value_at(i, 1)};
        if (i == 4) sample[1] = NAN;
        if (i == 6) sample[0] = -INFINITY;
        assert_ok(lg_monitor_push(watch, sample, &ready, &v));
    }
    assert_true(v.scored);
    for (uint32_t k = 0; k < WINDOW; k++) assert_close(w.x[k], value_at(k, 0), 1e-6, 0);
}

TEST("push allocates no memory") {
    if (!lg_count_available()) skip();
    const lg_monitor_options options = options_of(CHANNELS, WINDOW, 3);
    witness w = {.seen = 0};
    lg_monitor *watch = start(&options, &w);
    const float sample[CHANNELS] = {1, 2};
    lg_verdict v;
    bool ready;
    lg_status worst = LG_OK;
    assert_no_malloc_no_lock({
        for (int i = 0; i < 1000; i++) {
            const lg_status status = lg_monitor_push(watch, i % 17 == 0 ? NULL : sample, &ready, &v);
            if (status != LG_OK) worst = status;
        }
    });
    assert_ok(worst);
    assert_true(w.seen > 100);
}

TEST("invalid options are refused") {
    const lg_monitor_options good = options_of(CHANNELS, WINDOW, 0);
    witness w = {.channels = CHANNELS, .window = WINDOW};
    lg_monitor *watch = (lg_monitor *)(void *)memory;
    lg_error error;
    enum { BAD = 13 };
    lg_monitor_options bad[BAD];
    for (int i = 0; i < BAD; i++) bad[i] = good;
    bad[0].channels = 0;
    bad[1].window = 0;
    bad[2].hop = WINDOW + 1;
    bad[3].missing = NAN;
    bad[4].missing = 1.5;
    bad[5].votes = 0;
    bad[6].votes = 6;
    bad[7].votes_of = 65;
    bad[8].size = 3;
    bad[9].channels = UINT32_MAX;
    bad[10].window = UINT32_MAX;
    bad[11].channels = bad[11].window = 1u << 17;
    bad[12].votes_of = 0;
    for (int i = 0; i < BAD; i++) {
        assert_int_equal(lg_monitor_size(&bad[i]), 0);
        assert_status(lg_monitor_init(&bad[i], look, &w, &watch, memory, ROOM, &error), LG_INVALID_ARGUMENT);
        assert_true(error.message[0] != '\0');
    }
    assert_status(lg_monitor_init(&good, NULL, &w, &watch, memory, ROOM, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_monitor_init(&good, look, &w, &watch, memory + 8, ROOM - 8, &error),
                  LG_INVALID_ARGUMENT);
    const size_t short_by_one = lg_monitor_size(&good) - 1;
    assert_status(lg_monitor_init(&good, look, &w, &watch, memory, short_by_one, &error),
                  LG_INVALID_ARGUMENT);
    assert_ptr_equal(watch, memory);
    assert_int_equal(lg_monitor_size(NULL), 0);
}

TEST("nothing is written beyond the stated size") {
    const uint32_t sizes[][2] = {{1, 1}, {2, 7}, {2, 64}, {2, 65}};
    for (size_t s = 0; s < 4; s++) {
        const lg_monitor_options options = options_of(sizes[s][0], sizes[s][1], 1);
        witness w = {.seen = 0};
        lg_monitor *watch = start(&options, &w);
        for (uint64_t i = 0; i < 300; i++) {
            lg_verdict v;
            (void)push(watch, i, i % 11 == 3 || i < 2, &v);
        }
        for (size_t i = lg_monitor_size(&options); i < ROOM; i++) assert_int_equal(memory[i], 0xa5);
    }
}

TEST("novel windows have separate votes and do not change the alarm") {
    lg_monitor_options options = options_of(CHANNELS, WINDOW, 0);
    options.votes = 2;
    options.votes_of = 3;
    witness w = {.seen = 0, .script = "ppnnn----"};
    static const bool alarm[] = {false, true, true, true, true, true, false, false, false};
    static const bool novel[] = {false, false, false, true, true, true, false, false, false};
    static const uint32_t votes[] = {1, 2, 2, 2, 2, 2, 1, 0, 0}, novels[] = {0, 0, 1, 2, 3, 2, 1, 0, 0};
    lg_monitor *watch = start(&options, &w);
    for (uint64_t i = 0; i < 9 * WINDOW; i++) {
        lg_verdict v;
        if (!push(watch, i, false, &v)) continue;
        assert_true(v.scored);
        assert_int_equal(v.alarm, alarm[v.window]);
        assert_int_equal(v.novel, novel[v.window]);
        assert_int_equal(v.positive_votes, votes[v.window]);
        assert_int_equal(v.novel_votes, novels[v.window]);
        assert_int_equal(v.answer == LG_ANSWER_NOVEL, v.window >= 2 && v.window < 5);
    }
    assert_int_equal(w.seen, 9);
}

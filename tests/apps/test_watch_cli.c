/* lg-anomaly watch: feeds in every layout, gaps, pipes, Ctrl-C, memory.
 * ctest-labels: apps/lg-anomaly src/anomaly */
#include "apps/cli_support.h"

#include "liegrad/core.h"
#include "liegrad/series.h"

/* Two channels at 5 Hz, windows of 8 s. Intact values are about 0.1, broken ones about 10. */
enum { CHANNELS = 2, WINDOW = 40, SETS = 200, RATE = 5, NEVER = 1 << 20 };

static char text[1 << 20], *end = text; /* text of the feed */
static char other[CLI_TEXT];

static float value_at(uint64_t i, uint32_t channel, bool broken) {
    const double wave = sin(0.9 * (double)i + channel) + 0.3 * cos(2.1 * (double)i);
    lg_rng rng = test_rng(i, channel);
    return (float)((wave + 0.5 * lg_rng_normal(&rng)) * (broken ? 10.0 : 0.1));
}

/* `swapped`: class 0 is broken, and class 1 intact. `named`: the channels are a and b. */
static void write_series(const char *name, bool swapped, bool named) {
    lg_series_data data = {.noise = NAN, .severity = NAN};
    data.series =
        (lg_series){.count = SETS, .channels = CHANNELS, .length = WINDOW, .classes = 2, .rate = RATE};
    assert_ok(lg_series_allocate(NULL, &data.series, false, false));
    for (uint32_t n = 0; n < SETS; n++) {
        data.series.label[n] = swapped ? 1 - n % 2 : n % 2;
        for (uint32_t c = 0; c < CHANNELS; c++)
            for (uint32_t k = 0; k < WINDOW; k++)
                data.series.x[(n * CHANNELS + c) * WINDOW + k] = value_at(7 * n + k, c, n % 2 == 1);
    }
    (void)snprintf(data.series.class_name[swapped], LG_SERIES_NAME, "intact");
    (void)snprintf(data.series.class_name[!swapped], LG_SERIES_NAME, "broken");
    if (named) {
        data.series.channel_name = calloc(CHANNELS, LG_SERIES_NAME);
        assert_non_null(data.series.channel_name);
        for (uint32_t c = 0; c < CHANNELS; c++) data.series.channel_name[c][0] = (char)('a' + c);
    }
    assert_ok(lg_series_write(NULL, cli_at(name), &data, NULL));
    lg_series_data_destroy(&data);
}

/* Writes windows of one sample. */
static void write_points(void) {
    lg_series_data data = {.noise = NAN, .severity = NAN};
    data.series = (lg_series){.count = SETS, .channels = CHANNELS, .length = 1, .classes = 2, .rate = RATE};
    assert_ok(lg_series_allocate(NULL, &data.series, false, false));
    for (uint32_t n = 0; n < SETS; n++) {
        data.series.label[n] = n % 2;
        for (uint32_t c = 0; c < CHANNELS; c++) data.series.x[n * CHANNELS + c] = value_at(n, c, n % 2 == 1);
    }
    assert_ok(lg_series_write(NULL, cli_at("point.h5"), &data, NULL));
    lg_series_data_destroy(&data);
}

static int make_models(void **state) {
    if (cli_begin() != 0) return -1;
    write_series("data.h5", false, false);
    write_series("swapped.h5", true, false);
    write_series("ab.h5", false, true);
    write_points();
    cli_expect("lg-anomaly", "train data.h5 --method tree --features std --out m.h5", 0, "");
    cli_expect("lg-anomaly", "train ab.h5 --method tree --features std --out letters.h5", 0, "");
    cli_expect("lg-anomaly", "train data.h5 --method cnn --filters 4 --epochs 2 --out n.h5", 0, "");
    return 0;
}

/* ---- feeds: write, extend, watch ---- */

static void add(const char *format, ...) __attribute__((format(printf, 1, 2)));
static void add(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    end += vsnprintf(end, sizeof text - (size_t)(end - text), format, arguments);
    va_end(arguments);
}

static void begin(void) {
    end = text;
    *end = '\0';
}

/* Adds samples first..last-1, broken from `crack` on. `form` is a format with two values, or with the time
 * and two values if `timed`. */
static void add_in(const char *form, bool timed, uint64_t first, uint64_t last, uint64_t crack) {
    for (uint64_t i = first; i < last; i++) {
        const double a = value_at(i, 0, i >= crack), b = value_at(i, 1, i >= crack);
        end += timed ? sprintf(end, form, (double)i / RATE, a, b) : sprintf(end, form, a, b);
    }
}

static void add_samples(bool timed, uint64_t first, uint64_t last, uint64_t crack) {
    add_in(timed ? "%.1f,%.9g,%.9g\n" : "%.9g,%.9g\n", timed, first, last, crack);
}

static void add_timed(uint64_t first, uint64_t last) {
    add_samples(true, first, last, NEVER);
}

static void add_plain(uint64_t first, uint64_t last) {
    add_samples(false, first, last, NEVER);
}

/* Line `index` (from 0) of the output. The next call overwrites the result. */
static const char *line_of(int index) {
    static char line[4096];
    const char *from = result.out;
    for (; index > 0; index--) {
        from = strchr(from, '\n');
        assert_non_null(from);
        from++;
    }
    const size_t length = strcspn(from, "\n");
    assert_true(length > 0 && length < sizeof line);
    memcpy(line, from, length);
    line[length] = '\0';
    return line;
}

static int count_lines(const char *from) {
    int count = 0;
    for (; *from != '\0'; from++) count += *from == '\n';
    return count;
}

/* Runs watch on the feed without --json; the output must contain `words`. */
static void watch_words(const char *options, int code, const char *words) {
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", test_text("watch m.h5 %s --input feed.csv", options), code, words);
}

/* Rows of the summary for people: "windows 4, judged 4". */
static void expect_rows(const char *rows) {
    char name[32], value[32];
    int n;
    for (; sscanf(rows, " %31s %31[^,]%n", name, value, &n) == 2; rows += n + (rows[n] == ','))
        assert_says(result.out, test_text("# %-20s  %14s", name, value));
}

static void watch_rows(const char *options, const char *rows) {
    watch_words(options, 0, "# windows");
    expect_rows(rows);
}

static void expect_summary(const char *members) {
    const char *line = line_of(count_lines(result.out) - 1);
    if (!json_is_object(line)) fail_msg("no summary: %s", line);
    json_expect(line, members);
}

static void watch(const char *options, const char *members) {
    watch_words(test_text("--json %s", options), 0, "\"summary\"");
    expect_summary(members);
}

static double summary(const char *key) {
    return json_number(line_of(count_lines(result.out) - 1), key);
}

/* ---- tests ---- */

TEST("every window gets a verdict, a number and a time") {
    begin();
    add_samples(false, 0, 20 * WINDOW + 7, 10 * WINDOW);
    watch("--crack-at 80",
          "samples 807, received 807, judged 20, positive 10, alarms 1, time_to_detection 24, "
          "false_alarms 0, false_alarms_per_day 0, interrupted false");
    assert_int_equal(count_lines(result.out), 21);
    for (int w = 0; w < 20; w++) {
        char members[256];
        (void)snprintf(members, sizeof members,
                       "window %d, first_sample %d, time %.1f, class \"%s\", judged true, alarm %s, "
                       "positive_votes %d, votes %d",
                       w, w * WINDOW, (w * WINDOW + WINDOW - 1) / (double)RATE, w < 10 ? "intact" : "broken",
                       w < 12 ? "false" : "true",
                       w < 10   ? 0
                       : w < 15 ? w - 9
                                : 5,
                       w < 5 ? w + 1 : 5);
        json_expect(line_of(w), members);
    }
    /* A later --crack-at: the system was intact for longer, so alarms before it count as false. */
    watch("--quiet --crack-at 130", "false_alarms 1, false_alarms_per_day 675, "
                                    "false_positive_windows_per_day 4050, time_to_detection 6");
    assert_int_equal(count_lines(result.out), 2);
    watch("", "time_to_detection null, false_alarms null");
}

TEST("a network can watch too") {
    begin();
    add_timed(0, 5 * WINDOW);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch n.h5 --json --input feed.csv", 0, "\"summary\"");
    assert_int_equal(count_lines(result.out), 6);
    const double score = json_number(line_of(2), "score");
    assert_true(score >= 0 && score <= 1);
}

TEST("the same samples in every layout give the same verdicts") {
    static const struct {
        const char *before, *form;
        bool timed;
    } rows[] = {
        {"", "%.9g,%.9g\n", false},
        {"", "%.9g;%.9g\n", false},
        {"", "%.9g %.9g\n", false},
        {"", "  %.9g \t %.9g\t\n", false},
        {"", "%.9g , %.9g\r\n", false},
        {"", "%.9g,%.9g,\n", false},
        {"", "%+.17e,%.17g\n", false},
        {"", "%.30f;%.40e\n", false},
        {"acc,moment\n", "%.9g,%.9g\n", false},
        {"acc;moment\nm/s2;Nm\n\n# a comment\n", "%.9g;%.9g # well\n", false},
        {"\xef\xbb\xbf", "%.9g,%.9g\n", false},
        {"", "%.1f,%.9g,%.9g\n", true},
        {"time acc moment\n", "%.17g %.9g %.9g\n", true},
        {"", "%.3e; %.12g; %.12g;\r\n", true},
    };
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        begin();
        add("%s", rows[r].before);
        add_in(rows[r].form, rows[r].timed, 0, 4 * WINDOW, 2 * WINDOW);
        watch_rows("", "windows 4, judged 4, positive 2");
        const size_t verdicts = (size_t)(strstr(result.out, "# samples") - result.out);
        if (r == 0) memcpy(other, result.out, verdicts + 1);
        if (strncmp(result.out, other, verdicts) != 0)
            fail_msg("row %zu:\n%s\nnot\n%s", r, result.out, other);
        assert_string_equal(result.err, "");
    }
    /* A last line without a newline is a sample. */
    text[strlen(text) - 2] = '\0';
    watch_rows("", "windows 4, judged 4");
}

TEST("gaps in the times count as missing samples") {
    begin();
    add_timed(0, 50);
    add_timed(53, 90);   /* 3 samples of window 1 are missing */
    add_timed(200, 240); /* 30 samples of window 2, and windows 3 and 4, are missing */
    add_timed(239, 280); /* one sample is repeated */
    watch("", "absent 113, repeated 1, samples 280");
    static const int missing[] = {0, 3, 30, 40, 40, 0, 0};
    assert_int_equal(count_lines(result.out), 8);
    for (int w = 0; w < 7; w++) {
        json_expect(line_of(w),
                    test_text("missing %d, time %.1f, judged %s, class %s", missing[w], w * 8 + 7.8,
                              missing[w] <= 4 ? "true" : "false", missing[w] <= 4 ? "\"intact\"" : "null"));
    }
}

TEST("times that jitter or drift lose no sample, and a clock that is set back does not stop the watch") {
    begin();
    for (int i = 0; i < 5000; i++) add("%.4f,0.1,-0.1\n", 1.7e9 + i * 0.2003 + 0.05 * sin(1.3 * i));
    watch("--quiet", "received >4989, received <5011, samples >4998, samples <5016");
    begin();
    add_samples(true, 10000, 10080, 0);
    add_samples(true, 0, 80, 0);
    add("1e300,1,1\n-1e300,1,1\n"); /* no later time follows from 1e300 */
    watch("", "judged 4, windows 5, malformed 2");
    assert_says(result.err, "restarts");
}

TEST("missing values are lost samples, and other lines are malformed") {
    static const char *const lost[] = {"nan,1",   "1,",     ",",         "-inf,NaN", "NA;null",
                                       "1e999,1", "1e39,1", "\"nan\",1", "1,\"\""};
    static const char *const malformed[] = {
        "1",          "1,2,3,4",          "foo,bar", "1,abc",    "9,81;3,2", "34 032.6,", "1,2;",
        "1.2.3,4",    "0x1p3,1",          "--1,1",   "1,,2,,,,", "1e,1",     "1,2e+",     "nano,1",
        "1,\x01\xff", "\"5\"\" pipe\",1", "\"5\"6",  "\"nan\"2"};
    for (size_t r = 0; r < LG_COUNT(lost) + LG_COUNT(malformed); r++) {
        const bool is_lost = r < LG_COUNT(lost);
        const char *line = is_lost ? lost[r] : malformed[r - LG_COUNT(lost)];
        begin();
        add_plain(0, 20);
        add("%s\n", line);
        add_plain(21, 40);
        watch_rows("", is_lost ? "not_finite 1, malformed 0" : "not_finite 0, malformed 1");
        assert_says(result.out, "intact\t");
        assert_says(result.out, "\t0/1\t1\t-");
        if (is_lost != (strstr(result.err, "line 21: ") == NULL)) fail_msg("'%s': %s", line, result.err);
    }
    begin();
    add("\"5\"\" pipe\",1\n"); /* a first line that is damaged holds no names */
    add_plain(0, 40);
    watch_rows("", "received 40, absent 0, not_finite 0, malformed 1");
    begin();
    add("1,2,3,4\n"); /* no sample is lost before the first one */
    add_plain(0, 40);
    watch_rows("", "received 40, absent 0, not_finite 0, malformed 1");
    assert_says(result.err, "line 1: ");
    assert_says(result.err, "left out");
    begin();
    add_plain(0, 20);
    for (int i = 0; i < 30; i++) add("what %d\n", i);
    watch_rows("", "malformed 30");
    assert_int_equal(count_lines(result.err), 7);
    assert_says(result.err, "after line 20 no line could be read: 30 lines are malformed; the last: 'what'");
    assert_says(result.err, "line 40: 20 lines in a row could not be read; expected are 2 numbers");
    assert_says(result.err, "line 25: 'what' is not a number");
    assert_says(result.err, "only counted");
}

TEST("a very long line does not affect other lines") {
    begin();
    add_plain(0, 20);
    add("%0700000d\n", 7);
    add_plain(21, 60);
    add("%100000s0.%0500d1,%0400d\n", "", 0, 1); /* blanks and numbers with very many digits are accepted */
    add_plain(61, 80);
    watch("", "malformed 1, received 79, judged 2");
    assert_says(result.err, "line 21: longer than");
    begin();
    add("%0700000d", 7); /* a feed that is a single line without end */
    watch_words("", 3, "no line holds 2 numbers");
}

TEST("the layout is taken from lines that agree, even if the first lines are incomplete") {
    static const struct {
        const char *before;
        uint64_t first;
        const char *members;
    } rows[] = {
        {"1,2\n", 1, "malformed 1, received 199"},         /* an incomplete line */
        {"time,acc,moment\n1,2\n1,2\n", 2, "malformed 2"}, /* the line of names counts as malformed too */
        {"Well seven\n", 0, "malformed 0, received 200"},  /* a title with as many words as channels */
    };
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        begin();
        add("%s", rows[r].before);
        add_timed(rows[r].first, 200);
        watch("", rows[r].members);
    }
}

TEST("a column that is missing, for some time or for good, means lost samples; a time is never taken for "
     "a value") {
    for (int timed = 0; timed < 2; timed++) {
        begin();
        add_samples(timed, 0, 100, NEVER);
        for (int i = 100; i < 104; i++) add(timed ? "%.1f,0.1\n" : "%.1f,0.1,0.1\n", i / 5.0);
        add_samples(timed, 104, 400, NEVER);
        watch("--votes 1,5", timed ? "malformed 4, received 396, samples 400, absent 4, judged 10, alarms 0"
                                   : "malformed 4, received 396, samples 400, absent 0, judged 10, alarms 0");
    }
    begin();
    add_timed(0, 100);
    for (int i = 100; i < 400; i++) add("%d,0.1\n", i);
    watch("--votes 1,5", "malformed 300, alarms 0");
    assert_says(result.err, "line 101: 2 numbers, not 3 with the time");
    assert_says(result.err, "20 lines in a row could not be read; expected are a time and 2 numbers");
}

TEST("lines without a sample do not change the clock: every true sample is received") {
    static const struct {
        const char *line;
        int malformed;
    } rows[] = {{"", 0},
                {" \t\r", 0},
                {"# comment", 0},
                {"time,acc,moment", 0},
                {"what is this", 3},
                {"time;acc;moment", 3}};
    for (size_t r = 0; r < LG_COUNT(rows); r++)
        for (int timed = 0; timed < 2; timed++) {
            begin();
            add("time,acc,moment\n");
            for (uint64_t i = 0; i < 120; i += 40) {
                add_samples(timed, i, i + 30, NEVER);
                add("%s\n", rows[r].line);
                add_samples(timed, i + 30, i + 40, NEVER);
            }
            watch("", test_text("received 120, repeated 0, malformed %d, samples %d", rows[r].malformed,
                                timed ? 120 : 120 + rows[r].malformed));
        }
}

static void feed_at(double rate, int samples, double jitter) {
    begin();
    for (int i = 0; i < samples; i++)
        add("%.4f,%.5g,0.1\n", i / rate + jitter * sin(0.7 * i), 0.1 * sin(0.9 * i));
}

TEST("a feed of another rate is refused before any window is judged; --rate puts it on the grid of that "
     "rate") {
    static const struct {
        double rate, jitter;
        const char *refused;
    } rows[] = {{50, 0, "give 50 samples per second"},
                {2.5, 0, "give 2.5 samples per second"},
                {5.1, 0, "give 5.1 samples per second"},
                {4.9, 0, "give 4.9 samples per second"},
                {5.04, 0, NULL},
                {4.96, 0, NULL},
                {5, 0, NULL},
                {5, 0.1, NULL},
                {4.5, 0.05, "trained at 5:"},
                {10, 0.02, "trained at 5:"}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        feed_at(rows[r].rate, 400, rows[r].jitter);
        if (rows[r].refused == NULL) {
            watch("", "");
            continue;
        }
        watch_words("--json", 3, rows[r].refused);
        assert_string_equal(result.out, "");
        assert_says(result.err, "trained at 5:");
        assert_says(result.err, "--rate");
    }
    feed_at(50, 10000, 0);
    watch("--rate 5", "received >998, received <1002, absent 0");
    assert_close(json_number(line_of(20), "time"), 20 * 8 + 7.8, 0, 0.11);
    assert_says(result.err, "give 50 samples per second; the grid of --rate 5");
    watch("--rate 50", "received 10000");
    feed_at(2.5, 400, 0);
    watch("--rate 5", "received 400, absent 399");
}

TEST("times may be dates or times of day; a first line that begins within a date costs the next one, too") {
    static const char *const forms[][2] = {
        {"23:%02d:%02d.%d,", "0:%02d:%02d.%d,"},
        {"2024-02-29T23:%02d:%02d.%d,", "2024-03-01T00:%02d:%02d.%d,"},
        {"2024-03-31 01:%02d:%02d.%d+01:00,", "2024-03-31 03:%02d:%02d.%d+02,"},
    };
    for (size_t k = 0; k <= LG_COUNT(forms); k++) {
        const bool within = k == LG_COUNT(forms);
        begin();
        for (int i = 0; i < 320; i++) {
            const int minutes = 59 + i / 300;
            add(forms[within ? 1 : k][minutes / 60], minutes % 60, i / 5 % 60, i % 5 * 2);
            if (within && i == 0) memmove(text, text + 11, strlen(text + 10)), end -= 11;
            add_plain(1000 + (uint64_t)i, 1001 + (uint64_t)i);
        }
        watch("", within ? "malformed 1, received 318" : "malformed 0, received 320, absent 0, repeated 0");
        assert_close(json_number(line_of(0), "time"), 7.8, 1e-9, 0);
        if (within) assert_says(result.err, "line 2: the time is not a number");
    }
    begin();
    for (int i = 0; i < 40; i++) add("202403011200%02d,1,2\n", i);
    watch_words("", 3, "no line holds 2 numbers, or 3 with a time");
}

TEST("a single wrong time costs only its own line; repeated ones are a jump of the clock") {
    static const char *const wrong[] = {"5%.1f", "59%.1f", "-%.1f", "1e%.0f", "%.0fe200", "%.1f"};
    static const int places[] = {0, 1, 2, 57, 300, 318, 319};
    for (size_t k = 0; k < LG_COUNT(wrong); k++)
        for (size_t p = 0; p < LG_COUNT(places); p++) {
            const int where = places[p];
            const bool inside = where > 0 && where < 319, late = k == 5; /* late: 59 s too late */
            if (k > 0 && k < 5 && where != 57) continue;
            begin();
            add_timed(1000, 1000 + (uint64_t)where);
            add(wrong[k], (late ? 259 : 200) + where / 5.0);
            add(",0.1,0.1\n");
            add_timed(1001 + (uint64_t)where, 1320);
            watch("", inside ? "malformed 1, received 319, absent 1, repeated 0"
                             : "malformed 1, received 319, absent 0, repeated 0");
            assert_says(result.err, "does not fit the lines around it");
        }
    /* Two wrong times in a row, and one among the samples that confirm a gap. */
    begin();
    add_timed(0, 100);
    add("520.0,0.1,0.1\n3.2,0.1,0.1\n");
    add_timed(102, 200);
    add_timed(230, 232);
    add("546.4,0.1,0.1\n");
    add_timed(233, 300);
    add_timed(320, 322); /* gaps that follow each other closely */
    add_timed(350, 400);
    watch("", "malformed 3, received 319, samples 400");
}

TEST("a long gap is counted, not printed window by window") {
    begin();
    add_timed(0, 80);
    add_timed(40080, 40160);
    watch("", "absent 40000, windows 1004, judged 4");
    assert_int_equal(count_lines(result.out), 2 + 3 + 1 + 2 + 1);
    json_expect(line_of(5), "not_judged 997");
    json_expect(line_of(7), "window 1003");
    watch_words("", 0, "# not judged: 997 windows more");
}

TEST("a last line without a newline may hold half a number") {
    static const char *const rows[][2] = {{"15.8,0.1,0.1", "malformed 1, judged 2"},
                                          {"15.8,0.1,0.1 ", "malformed 0, judged 2"},
                                          {"15.8,0.1,0.1,", "malformed 0, judged 2"},
                                          {"15.8,0.1,0.1\r", "malformed 0, judged 2"},
                                          {"15.8,0.1,0.1#", "malformed 0, judged 2"},
                                          {"15.8,0.1", "malformed 1, judged 1"},
                                          {"15", "malformed 1, judged 1"},
                                          {"15.8,0.1,-", "malformed 1, judged 1"}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        begin();
        add_timed(0, 79);
        add("%s", rows[r][0]);
        watch("", rows[r][1]);
        if (r == 0) json_expect(line_of(1), "missing 1");
    }
    begin();
    add("0.1 0.2"); /* the whole feed */
    watch("", "received 1");
}

TEST("a --crack-at after the last sample or before the first window causes a warning") {
    begin();
    add_samples(true, 0, 200, 100);
    watch("--crack-at 20", "");
    assert_string_equal(result.err, "");
    watch("--crack-at 2520000", "");
    assert_says(result.err, "--crack-at 2520000 s is after the last sample, at 39.8 s");
    watch("--crack-at 0.02", "false_alarms_per_day null");
    assert_says(result.err, "--crack-at 0.02 s is before the end of the first scored window");
    cli_expect("lg-anomaly", "watch --help", 0, "takes hours");
    cli_expect("lg-anomaly", "feed --help", 0, "takes seconds");
}

TEST("the order of the classes changes neither alarms nor scores") {
    static const char *const methods[] = {"tree --features std", "svm-linear --features std --c 1",
                                          "novelty"};
    static cli straight;
    begin();
    add_samples(true, 0, 24 * WINDOW, 12 * WINDOW);
    cli_write("feed.csv", text);
    for (size_t i = 0; i < LG_COUNT(methods); i++) {
        for (int swapped = 0; swapped < 2; swapped++) {
            cli_run("lg-anomaly", "train %s.h5 --method %s --test-fraction 0 --out order.h5",
                    swapped ? "swapped" : "data", methods[i]);
            cli_expect("lg-anomaly", "watch order.h5 --crack-at 96 --unlike 0 --input feed.csv", 0, "ALARM");
            if (swapped == 0) straight = result;
        }
        assert_says(straight.out, "# time_to_detection");
        assert_null(strstr(straight.out, "unknown")); /* it was detected */
        for (int line = 0; line < 24; line++) {
            static cli now;
            double score[2];
            char name[2][64];
            now = result, result = straight;
            assert_int_equal(sscanf(line_of(line + 1), "%*f %63s %lf", name[0], &score[0]), 2);
            result = now;
            assert_int_equal(sscanf(line_of(line + 1), "%*f %63s %lf", name[1], &score[1]), 2);
            assert_string_equal(name[0], name[1]);
            assert_close(score[0], score[1], 0.02, 0.02); /* the svm stops at a tolerance */
        }
        const char *tail = strstr(straight.out, "# windows"), *other_tail = strstr(result.out, "# windows");
        assert_int_equal(strncmp(tail, other_tail, (size_t)(strstr(tail, "# seconds") - tail)), 0);
    }
}

TEST("overlapping windows vote as --votes says") {
    begin();
    add_samples(true, 0, 4 * WINDOW, 2 * WINDOW);
    watch_rows("--hop 1.6 --votes 1,1", "windows 16");
    watch_rows("--hop 0.2 --quiet --votes 40,64", "windows 121");
    int line = 0;
    while (strncmp(line_of(line), "# ", 2) != 0) line++;
    assert_int_equal(line, 1); /* one change before the summary */
    watch_rows("--rate 10 --hop 4", "windows 7, judged 0");
    assert_says(result.err, "trained at 5 Hz, not 10 Hz");
}

/* Writes feed.csv, changed by an awk program, to the file `to`. */
static void change(const char *program, const char *to) {
    assert_int_equal(
        system(test_text("cd '%s' && awk -F, -v OFS=, '%.300s' feed.csv > %s", cli_folder, program, to)), 0);
}

/* Writes the feed with its columns in another order, or without one of them. */
static void reorder(const char *columns, const char *to) {
    change(test_text("{ print %s }", columns), to);
}

TEST("channels are found by their names; a feed without one of them is refused") {
    static cli straight;
    cli_expect("lg-anomaly", "generate --noise 10 --runs 6 --hours 0.1 --out well.h5", 0, "");
    cli_expect("lg-anomaly", "train well.h5 --method logistic --out named.h5", 0, "");
    cli_expect("lg-anomaly", "feed --noise 10 --hours 0.2 --seed 5", 0, "");
    cli_write("feed.csv", result.out);
    cli_expect("lg-anomaly", "watch named.h5 --input feed.csv", 0, "# windows");
    straight = result;
    reorder("$1, $7, $6, $5, $4, $3, $2", "swapped.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input swapped.csv", 0, "# windows");
    const size_t verdicts = (size_t)(strstr(straight.out, "# samples") - straight.out);
    assert_true(verdicts > 100 && strncmp(straight.out, result.out, verdicts) == 0);
    reorder("(NR == 1 ? \"# \" : \"\") $1, $7, $6, $5, $4, $3, $2",
            "comment.csv"); /* as numpy.savetxt writes */
    cli_expect("lg-anomaly", "watch named.h5 --input comment.csv", 0, "# windows");
    assert_true(strncmp(straight.out, result.out, verdicts) == 0);
    reorder("$1, $2, $3, $4, $5, $6", "cut.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input cut.csv", 3, "there is no column");
    reorder("$1, $2, $3, $4, $5, $6, $2", "twice.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input twice.csv", 3, "there are two columns");
    reorder("$2, $3, $1, $4, $5, $6, $7", "late.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input late.csv", 3, "after a column of times");
    reorder("$1, NR == 1 ? \"a,b,c,d,e,f\" : $2 \",\" $3 \",\" $4 \",\" $5 \",\" $6 \",\" $7", "others.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input others.csv", 3,
               "no column of the feed has the name of a channel");
}

/* Watches with the model whose channels are a and b. */
static void watch_named(int code, const char *words) {
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch letters.h5 --json --input feed.csv", code, words);
}

TEST("a first column is the time if it increases or its name says so; otherwise it is left out") {
    static const struct {
        const char *before;     /* lines of names */
        double at, each, noise; /* cell i is at + each i + noise sin(5 i) */
        int code;
        const char *words;
    } rows[] = {
        {"label,a,b\n", 0, 0, 0, 0, "column label is left out"},
        {"label,a,b\n", 1, 0.025, 0, 0, "column label is left out"}, /* 1, 1, ..., 2, 2, ... */
        {"temp,a,b\n", 20, 0, 1, 0, "column temp is left out"},
        {"zeit,a,b\n", 0, 0.2, 0, 0, ""},
        {"zeit,a,b\n", 0, 0.1, 0, 3, "column zeit comes first and increases, so it is taken as the time"},
        {"seconds,other,a,b\n", 0, 0.2, 0, 0, "left out: other"},
        {"t,a,b\n", 20, 0, 1, 3, "column t should be the time, but it does not increase"},
        {"", 20, 0, 1, 3, "column 1 should be the time, but it does not increase"},
        {"t,a,b\n", 7, 0, 0, 3, "column t should be the time, but it does not increase"},
        {"", 7, 0, 0, 3, "column 1 should be the time, but it does not increase"},
    };
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        begin();
        add("%s", rows[r].before);
        for (int i = 0; i < 4 * WINDOW; i++) {
            const double cell = rows[r].at + rows[r].each * i + rows[r].noise * sin(5.0 * i);
            add(r == 1 ? "%.0f," : "%.3f,", cell);
            if (strstr(rows[r].before, "other") != NULL) add("word,");
            add_samples(false, (uint64_t)i, (uint64_t)i + 1, 2 * WINDOW);
        }
        watch_named(rows[r].code, rows[r].words);
        if (rows[r].code == 0) expect_summary("received 160, repeated 0, judged 4, positive 2");
    }
    begin(); /* the clock stops */
    add_timed(0, 100);
    for (int i = 0; i < 120; i++) add("19.8,0.1,0.1\n");
    watch_named(3, "120 of 220 lines are left out, because their times do not go beyond earlier ones");
}

TEST("a later line of names replaces the columns, and the window begins anew") {
    static const struct {
        const char *before, *form; /* form: of a sample, with time, a and b or b and a */
        bool turned;
    } rows[] = {{"t,b,a", "%.1f,%.9g,%.9g\n", true},
                {"# t,b,a", "%.1f,%.9g,%.9g\n", true},
                {"t,a,b,label", "%.1f,%.9g,%.9g,x\n", false},
                {"label;t;a;b", "x;%.1f;%.9g;%.9g\n", false}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        begin();
        add("t,a,b\n");
        add_timed(0, 60);
        add("%s\n", rows[r].before);
        for (int i = 60; i < 160; i++) {
            const double x[] = {5, 0.01 * (i % 2)}; /* a stands still */
            add(rows[r].form, i / 5.0, x[rows[r].turned], x[!rows[r].turned]);
        }
        add("t,a,b\n"); /* the columns of the beginning */
        for (int i = 160; i < 200; i++) add("%.1f,5,%d.1\n", i / 5.0, i % 2);
        watch_named(0, "\"summary\"");
        expect_summary(r < 2 ? "malformed 0, received 200, absent 80"
                             : "malformed 0, received 200, absent 80");
        assert_says(result.err, "line 62: a line of names replaces the columns from here on");
        assert_says(result.err, "line 163: a line of names");
        assert_int_equal(count_lines(result.out), 8);
        json_expect(line_of(1), "judged false"); /* samples from before the line of names */
        json_expect(line_of(3), "judged true, class \"unlike\"");
        assert_says(line_of(3), "a: stands still for 40 of 40 samples");
    }
    begin(); /* a clock that begins again at 0, and a first column of words */
    add("t,a,b\n");
    add_timed(0, 25);
    add("t,b,a\n");
    add_timed(0, 80);
    add("note,a,b\n");
    add_in("at_%.1f,%.9g,%.9g\n", true, 0, 80, 0);
    watch_named(0, "\"summary\"");
    expect_summary("malformed 0, repeated 0, received 185, absent 80");
    begin();
    add("t,a,b\n");
    add_timed(0, 60);
    add("t,a,label\n"); /* its third number would be read as b */
    watch_named(3, "line 62: there is no column b");
    begin();
    add("t,a,b\n");
    add_timed(0, 60);
    add("t,a\n"); /* cut off */
    add_timed(60, 80);
    watch_named(0, "line 62: 't' is not a number");
}

TEST("columns with other names are left out, whatever they hold, with one warning that names them") {
    static const struct {
        const char *columns,
            *left_out; /* `columns` of an awk program; c1: name or cell of the first of them */
        bool timed;
    } rows[] = {
        {"$1, $2, $3, $4, $5, $6, $7, NR == 1 ? \"label\" : \"0\"", "label", true},
        {"NR == 1 ? \"timestamp\" : sprintf(\"2026-01-01T00:%02d:%04.1f\", $1 / 60, $1 % 60), $2, $3, $4, "
         "$5, "
         "$6, $7, NR == 1 ? \"label\" : \"0\"",
         "label", true},
        {"NR == 1 ? \"\\\"run, site\\\"\" : \"x7\", $2, $3, NR == 1 ? \"note\" : \"#so\", $4, "
         "$5, "
         "$6, $7",
         "run, site", false},
        {"$1, NR == 1 ? \"a\" : \"\", $2, $3, $4, $5, $6, $7, NR == 1 ? \"b\" : \"#9 ok\", NR == 1 ? \"c\" : "
         "\"\"",
         "a, b, c", true},
        {"$2, $3, $4, $5, $6, $7, NR == 1 ? \"uptime\" : NR", "uptime", false},
        {"NR == 1 ? \"index\" : NR, $1, $2, $3, $4, $5, $6, $7", "index", true},
        {"NR == 1 ? \"note\" : \"ok \" NR, $1, $2, $3, $4, $5, $6, $7, NR == 1 ? \"datetime\" : "
         "\"2026-01-01\"",
         "note, datetime", true},
        {"NR == 1 ? \"note\" : \"so\", $2, $3, $4, $5, $6, $7", "note", false},
        {"(NR == 1 ? \"% \" : \"\") $2, $3, $4, $5, $6, $7, NR == 1 ? \"uptime\" : NR", "uptime", false},
        {"(NR == 1 ? \"// \" : \"\") $1, $2, $3, $4, $5, $6, $7, NR == 1 ? \"a\" : \"-\"", "a", true},
        {"NR == 1 ? $1 : \"\\\"\" $1 \"\\\"\", $2, $3, $4, NR == 1 ? $5 : \"\\\"\" $5 \"\\\"\", $6, $7, NR "
         "== 1 ? \"a\" : \"\"",
         "a", true},
    };
    static cli straight[2];
    cli_expect("lg-anomaly", "generate --noise 10 --runs 6 --hours 0.1 --out well.h5", 0, "");
    cli_expect("lg-anomaly", "train well.h5 --method logistic --out named.h5", 0, "");
    cli_expect("lg-anomaly", "feed --noise 10 --hours 0.2 --seed 5", 0, "");
    cli_write("feed.csv", result.out);
    reorder("$2, $3, $4, $5, $6, $7", "plain.csv");
    for (int timed = 0; timed < 2; timed++) {
        cli_expect("lg-anomaly", test_text("watch named.h5 --input %s.csv", timed ? "feed" : "plain"), 0, "");
        straight[timed] = result;
    }
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        reorder(rows[i].columns, "more.csv");
        cli_expect("lg-anomaly", "watch named.h5 --input more.csv", 0, "# windows");
        assert_says(result.err, "not channels of the model are left out: ");
        assert_says(result.err, rows[i].left_out);
        assert_int_equal(count_lines(result.err), 1);
        const char *expected = straight[rows[i].timed].out;
        const size_t verdicts = (size_t)(strstr(expected, "# windows") - expected);
        assert_true(verdicts > 100);
        if (strncmp(expected, result.out, verdicts) != 0) fail_msg("%s:\n%s", rows[i].columns, result.out);
    }
    change("{ gsub(\",\", \"\\t\"); print $0 (NR == 1 ? \"\\tvalve\\tstate\" : NR % 2 ? \"\\t\\ttwo words\" "
           ": \"\\t7\\t\") }",
           "tabs.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input tabs.csv", 0, "# windows");
    assert_says(result.err, "left out: valve, state");
    assert_memory_equal(straight[1].out, result.out, strstr(straight[1].out, "# windows") - straight[1].out);
    change("{ print (NR == 1 ? $0 \",uptime\" : NR % 9 == 0 ? $0 : $0 \",7\") }", "lost.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input lost.csv", 0, "# windows");
    expect_rows("malformed 400, received 3200");
    change("{ print (NR == 9 ? \"#N/A\" : NR == 1 ? \"tag\" : 7) \",\" $0 }", "sign.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input sign.csv", 0, "# windows");
    assert_says(result.err, "line 9: begins as a comment, but has as many cells as a row");
    change("{ gsub(\",\", \";\"); print (NR == 1 ? \"pressure\" : \"1,5\") \";\" $0 }", "comma.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input comma.csv", 0, "# windows");
    reorder("$1, $2, $3, $4, $5, $6, NR == 1 ? \"x\" : 1, NR == 1 ? \"y\" : 2", "cut.csv");
    cli_expect("lg-anomaly", "watch named.h5 --input cut.csv", 3, "there is no column moment_y");
}

/* Writes spoilt.csv: the feed with an awk expression in one field of every sample. */
static void spoil(const char *field, const char *expression) {
    change(test_text("NR > 1 { $%s = %s } { print }", field, expression), "spoilt.csv");
}

TEST("windows unlike all training windows get a third verdict, with the reason") {
    static const struct {
        const char *field, *expression, *reason;
    } faults[] = {{"2", "0", "acc_lower_x: stands still for 300 of 300 samples"},
                  {"6", "1234.5", "moment_x: stands still"},
                  {"2", "0.01 * $2", "acc_lower_x: standard deviation 0.0"},
                  {"7", "100 * $7", "moment_y: standard deviation "},
                  {"4", "$4 + 0.3 * sin(12 * $1)", "acc_upper_x: standard deviation "}};
    cli_expect("lg-anomaly", "generate --noise 10 --runs 24 --hours 0.5 --out wells.h5", 0, "");
    cli_expect("lg-anomaly", "train wells.h5 --method logistic --out known.h5", 0, "");
    cli_expect("lg-anomaly", "feed --noise 10 --hours 0.4 --seed 5 --out feed.csv", 0, "");
    cli_expect("lg-anomaly", "watch known.h5 --input feed.csv", 0, "# windows");
    expect_rows("unlike 0");
    assert_string_equal(result.err, "");
    for (size_t i = 0; i < LG_COUNT(faults); i++) {
        spoil(faults[i].field, faults[i].expression);
        cli_expect("lg-anomaly", "watch known.h5 --input spoilt.csv", 0, "# windows");
        expect_rows("windows 24, judged 24, positive 0, unlike 24, unlike_alarms 1");
        assert_says(result.out, "1  standing");
        assert_says(result.out, "\tunlike\t");
        assert_says(result.out, "\tUNLIKE\t");
        assert_says(result.out, faults[i].reason);
        cli_expect("lg-anomaly", "watch known.h5 --unlike 0 --input spoilt.csv", 0, "# windows");
        expect_rows("windows 24");
        assert_null(strstr(result.out, "unlike"));
        cli_expect("lg-anomaly", "watch known.h5 --json --quiet --input spoilt.csv", 0, "\"unlike\": 24");
        json_expect(line_of(0),
                    "class \"unlike\", unlike true, unlike_votes 3, unlike_alarm true, alarm false");
        assert_says(line_of(0), faults[i].reason);
    }
}

/* Reverses the order of the channels, with their names. */
static void turn_channels(lg_series *s) {
    const size_t n = s->length, last = s->channels - 1;
    for (size_t i = 0; i < s->count * s->channels; i++) {
        const size_t c = i % s->channels;
        for (size_t t = 0; t < n && c < last - c; t++) {
            float *a = s->x + i * n + t, *b = a + (last - 2 * c) * n, kept = *a;
            *a = *b;
            *b = kept;
        }
    }
    for (size_t c = 0; c < last - c; c++) {
        char kept[LG_SERIES_NAME];
        memcpy(kept, s->channel_name[c], sizeof kept);
        memcpy(s->channel_name[c], s->channel_name[last - c], sizeof kept);
        memcpy(s->channel_name[last - c], kept, sizeof kept);
    }
}

TEST("data whose channels are in another order are judged by their names") {
    lg_series_data data;
    cli_expect("lg-anomaly", "generate --noise 10 --runs 6 --hours 0.5 --seed 3 --out straight.h5", 0, "");
    assert_ok(lg_series_read(NULL, cli_at("straight.h5"), NULL, NULL, &data, NULL));
    turn_channels(&data.series);
    assert_ok(lg_series_write(NULL, cli_at("turned.h5"), &data, NULL));
    lg_series_data_destroy(&data);
    static const char *const files[] = {"straight.h5", "turned.h5"};
    double mse[2];
    for (size_t i = 0; i < 2; i++) {
        cli_expect("lg-anomaly", test_text("evaluate known.h5 %s --json", files[i]), 0, "\"unlike\": 0,");
        assert_string_equal(result.err, "");
        mse[i] = json_number(result.out, "mse");
    }
    assert_true(mse[0] > 0);
    assert_close(mse[0], mse[1], 0, 0);
}

TEST("a channel without numbers makes a window unlike the training windows; a gap does not") {
    for (int word = 0; word < 3; word++) {
        static const char *const words[] = {"\"nan\"", "\"\"", "\"inf\""};
        spoil("4", words[word]);
        cli_expect("lg-anomaly", "watch known.h5 --input spoilt.csv", 0, "# windows");
        expect_rows("windows 24, judged 0, positive 0, unlike 24, unlike_alarms 1");
        assert_says(result.out, "1  standing");
        assert_says(result.out,
                    "\tunlike\t-\t0/0\t300\tUNLIKE\tacc_upper_x: no number in 300 of 300 samples");
        cli_expect("lg-anomaly", "watch known.h5 --json --quiet --input spoilt.csv", 0, "\"unlike\": 24");
        json_expect(line_of(0),
                    "judged false, class \"unlike\", unlike true, unlike_votes 3, unlike_alarm true");
        cli_expect("lg-anomaly", "watch known.h5 --unlike 0 --input spoilt.csv", 0, "# windows");
        expect_rows("judged 0");
    }
    change("NR < 3000 || NR > 5000", "spoilt.csv");
    cli_expect("lg-anomaly", "watch known.h5 --input spoilt.csv", 0, "# windows");
    expect_rows("unlike 0");
}

TEST("a feed with other noise causes a warning, and so does a model that does not know its training "
     "windows") {
    cli_expect("lg-anomaly", "feed --noise 1 --hours 0.4 --seed 5 --out clean.csv", 0, "");
    cli_expect("lg-anomaly", "watch known.h5 --quiet --input clean.csv", 0, "# windows");
    expect_rows("unlike 24");
    assert_says(result.err, "6 of 6 channels have less amplitude above 2.2");
    cli_expect("lg-anomaly", "feed --noise 50 --hours 0.4 --seed 5 --out loud.csv", 0, "");
    cli_expect("lg-anomaly", "watch known.h5 --quiet --input loud.csv", 0, "# windows");
    expect_rows("unlike 24");
    assert_says(result.err, "6 of 6 channels have more amplitude above 2.2");
    cli_expect("lg-anomaly", "evaluate known.h5 wells.h5 --json", 0, "\"unlike\": 0,");
    assert_string_equal(result.err, "");
    cli_expect("lg-anomaly", "generate --noise 1 --runs 6 --hours 0.5 --out clean.h5", 0, "");
    cli_expect("lg-anomaly", "evaluate known.h5 clean.h5 --json", 0, "\"unlike\": 180,");
    assert_says(result.err, "180 of 180 windows are unlike those of training, the farthest by ");
    cli_expect("lg-anomaly", "train point.h5 --method tree --features std --out old.h5", 0, "");
    assert_says(
        result.err,
        "has no record of what its training windows look like (the windows have fewer than two samples)");
    cli_expect("lg-anomaly", "watch old.h5 --input /dev/null", 0, "");
    assert_says(result.err, "has no record of what its training windows look like");
}

static void keep_class_0(lg_series *s) {
    const size_t each = (size_t)s->channels * s->length;
    size_t kept = 0;
    for (size_t i = 0; i < s->count; i++) {
        if (s->label[i] != 0) continue;
        memmove(s->x + kept * each, s->x + i * each, each * sizeof *s->x);
        s->label[kept] = 0;
        s->group[kept] = s->group[i];
        s->run[kept++] = s->run[i];
    }
    s->count = kept;
}

TEST("a detector trained on intact data alone raises the alarm, and recognises dead sensors") {
    cli_expect("lg-anomaly", "generate --noise 1 --runs 24 --hours 0.5 --out wells.h5", 0, "");
    cli_expect("lg-anomaly", "train wells.h5 --method novelty --json --out alone.h5", 0, "\"unlike\"");
    cli_expect("lg-anomaly", "feed --noise 1 --hours 1 --crack-at 0.5 --seed 5 --out feed.csv", 0, "");
    cli_expect("lg-anomaly", "watch alone.h5 --crack-at 1800 --json --quiet --input feed.csv", 0, "");
    expect_summary("alarm true, alarms 1, unlike 0, false_alarms 0, time_to_detection <400");
    json_expect(line_of(0), "class \"unlike\", unlike false, alarm true");
    assert_says(line_of(0), "standard deviation");
    spoil("3", "0");
    cli_expect("lg-anomaly", "watch alone.h5 --json --quiet --input spoilt.csv", 0, "");
    expect_summary("alarm false, positive 0, unlike 60");
    cli_expect("lg-anomaly", "evaluate alone.h5 wells.h5 --json", 0, "\"part\": \"test\"");
    assert_true(json_number(result.out, "recall") > 0.9 &&
                json_number(result.out, "false_positive_rate") < 0.1);
    char path[1024]; /* windows of class 0 only, though the file names a second class */
    lg_series_data data;
    cli_path("wells.h5", path, sizeof path);
    assert_ok(lg_series_read(NULL, path, NULL, NULL, &data, NULL));
    keep_class_0(&data.series);
    cli_path("intact.h5", path, sizeof path);
    assert_ok(lg_series_write(NULL, path, &data, NULL));
    lg_series_data_destroy(&data);
    cli_expect("lg-anomaly",
               "train intact.h5 --method novelty --split group --test wells.h5 --json --out i.h5", 0,
               "\"unlike\"");
    assert_true(json_number(result.out, "recall") > 0.9);
    cli_expect("lg-export", "alone.h5 --out alone", 3, "is not exported");
}

TEST("an empty feed is reported") {
    begin();
    watch("", "samples 0, days 0");
    watch("--crack-at 5", "samples 0, false_alarms_per_day null");
    cli_expect("lg-anomaly", "watch m.h5 --json --input /dev/null", 0, "\"samples\": 0");
    cli_expect("lg-anomaly", "watch m.h5 --json --input /dev/null", 0,
               "[\"/dev/null is empty: there was nothing to watch\"]");
}

/* Reads a child's output until `words` appear. Returns false after ten seconds. */
static bool wait_for(cli_child child, const char *words, size_t *used) {
    for (int i = 0; i < 100 && strstr(result.out, words) == NULL; i++) {
        struct pollfd ready = {child.out, POLLIN, 0};
        if (poll(&ready, 1, 100) > 0 && !cli_drain(child.out, result.out, used)) return false;
    }
    return strstr(result.out, words) != NULL;
}

TEST("a pipe is watched until Ctrl-C") {
    int feed[2];
    size_t used = 0;
    const int saved = dup(STDIN_FILENO);
    assert_int_equal(pipe(feed), 0);
    assert_int_equal(fcntl(feed[1], F_SETFD, FD_CLOEXEC), 0);
    assert_true(dup2(feed[0], STDIN_FILENO) >= 0);
    const cli_child child = cli_start("lg-anomaly", "watch m.h5 --json", 0);
    if (saved >= 0) (void)dup2(saved, STDIN_FILENO);
    (void)close(saved);
    (void)close(feed[0]);
    result.out[0] = '\0';
    begin();
    add_samples(true, 0, WINDOW, 0);
    const size_t bytes = strlen(text);
    /* the window is complete, so its verdict must come */
    assert_int_equal(write(feed[1], text, bytes), bytes);
    assert_true(wait_for(child, "\"window\": 0", &used));
    const char part[] = "8.0,1."; /* half a line */
    assert_int_equal(write(feed[1], part, sizeof part - 1), sizeof part - 1);
    cli_interrupt(child);
    (void)close(feed[1]);
    expect_summary("interrupted true, received 40");
}

/* Sanitizers keep freed memory, and memory of their own for each address that is used first. */
#ifdef LG_SANITIZED
enum { MORE_KB = 4096 };
#else
enum { MORE_KB = 1024 };
#endif

TEST("memory does not grow with the length of the feed") {
    FILE *file = fopen(cli_at("feed.csv"), "w");
    assert_non_null(file);
    for (int i = 0; i < 600000; i++)
        if (i % 1000 < 990)
            (void)fprintf(file, "%d.%d,%s,0.%d\n", i / 5, i % 5 * 2, i % 777 == 0 ? "nan" : "-0.1", i % 7);
    assert_int_equal(fclose(file), 0);
    cli_expect("lg-anomaly", "watch m.h5 --json --quiet --input feed.csv", 0, "\"summary\"");
    expect_summary("samples 599990, absent 5990, windows 14999, start_rss_kb >0");
    printf("%.3g samples/s, %g KiB at the start, %g KiB at most\n", summary("samples_per_second"),
           summary("start_rss_kb"), summary("max_rss_kb"));
    assert_true(summary("max_rss_kb") - summary("start_rss_kb") < MORE_KB);
}

TEST_GROUP(make_models, cli_end)

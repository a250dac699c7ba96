/* lg-anomaly watch: feeds of every shape, gaps, pipes, Ctrl-C, memory. */
#include "apps/cli_support.h"

#include "liegrad/io.h"
#include "liegrad/random.h"
#include "liegrad/series.h"

/* Two channels at 5 Hz, windows of 8 s; intact: values about 0.1, broken: about 10. */
enum { CHANNELS = 2, WINDOW = 40, SETS = 60, RATE = 5 };

static cli result;
static char text[1 << 20], other[CLI_TEXT];

static float value_at(uint64_t i, uint32_t channel, bool broken) {
    const double wave = sin(0.9 * (double)i + channel) + 0.3 * cos(2.1 * (double)i);
    return (float)(wave * (broken ? 10.0 : 0.1));
}

static void write_series(void) {
    char path[1024];
    lg_series_data data = {.noise = NAN, .severity = NAN};
    data.series =
        (lg_series){.count = SETS, .channels = CHANNELS, .length = WINDOW, .classes = 2, .rate = RATE};
    assert_ok(lg_series_allocate(NULL, &data.series, false, false));
    for (uint32_t n = 0; n < SETS; n++) {
        data.series.label[n] = n % 2;
        for (uint32_t c = 0; c < CHANNELS; c++)
            for (uint32_t k = 0; k < WINDOW; k++)
                data.series.x[(n * CHANNELS + c) * WINDOW + k] = value_at(7 * n + k, c, n % 2 == 1);
    }
    (void)snprintf(data.series.class_name[0], LG_SERIES_NAME, "intact");
    (void)snprintf(data.series.class_name[1], LG_SERIES_NAME, "broken");
    cli_path("data.h5", path, sizeof path);
    assert_ok(lg_series_write(NULL, path, &data, NULL));
    lg_series_data_destroy(&data);
}

static int make_models(void **state) {
    (void)state;
    cli_make_folder();
    write_series();
    cli_expect("lg-anomaly", "train data.h5 --method tree --features std --out m.h5", 0, "", &result);
    cli_expect("lg-anomaly", "train data.h5 --method cnn --filters 4 --epochs 2 --out n.h5", 0, "", &result);
    return 0;
}

static int remove_models(void **state) {
    (void)state;
    cli_remove_folder();
    return 0;
}

/* ---- feeds ---- */

/* Samples first..last-1 in `form` (time, two values), or without the time; broken from `crack` on. */
static char *add_samples(char *at, const char *form, bool timed, uint64_t first, uint64_t last,
                         uint64_t crack) {
    for (uint64_t i = first; i < last; i++) {
        const double a = value_at(i, 0, i >= crack), b = value_at(i, 1, i >= crack);
        at += timed ? sprintf(at, form, (double)i / RATE, a, b) : sprintf(at, form, a, b);
    }
    return at;
}

static const char timed_form[] = "%.1f,%.9g,%.9g\n", plain_form[] = "%.9g,%.9g\n";

static void write_feed(const char *name, bool timed, uint64_t samples, uint64_t crack) {
    (void)add_samples(text, timed ? timed_form : plain_form, timed, 0, samples, crack);
    cli_write(name, text);
}

/* Line `index` (from 0) of the text; the next call overwrites it. */
static const char *line_of(const char *from, int index) {
    static char line[4096];
    for (; index > 0 && from != NULL; index--) {
        from = strchr(from, '\n');
        if (from != NULL) from++;
    }
    if (from == NULL || *from == '\0') return NULL;
    const size_t length = strcspn(from, "\n");
    assert_true(length < sizeof line);
    memcpy(line, from, length);
    line[length] = '\0';
    return line;
}

static int count_lines(const char *from) {
    int count = 0;
    for (; *from != '\0'; from++) count += *from == '\n';
    return count;
}

static const char *summary(void) {
    const char *line = line_of(result.out, count_lines(result.out) - 1);
    assert_non_null(line);
    if (!json_is_object(line) || json_find(line, "summary") == NULL) fail_msg("no summary: %s", line);
    return line;
}

static bool json_is(const char *object, const char *key, const char *value) {
    const char *s = json_find(object, key);
    return s != NULL && strncmp(s, value, strlen(value)) == 0;
}

/* ---- tests ---- */

TEST("every window has its verdict, place and time") {
    write_feed("feed.csv", false, 20 * WINDOW + 7, 10 * WINDOW);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv --crack-at 80", 0, "summary", &result);
    assert_int_equal(count_lines(result.out), 21);
    for (int w = 0; w < 20; w++) {
        const char *line = line_of(result.out, w);
        assert_true(json_is_object(line));
        assert_close(json_number(line, "window"), w, 0, 0);
        assert_close(json_number(line, "first_sample"), w * WINDOW, 0, 0);
        assert_close(json_number(line, "time"), (w * WINDOW + WINDOW - 1) / (double)RATE, 1e-12, 0);
        assert_true(json_is(line, "class", w < 10 ? "\"intact\"" : "\"broken\""));
        assert_true(json_is(line, "judged", "true"));
        assert_true(json_is(line, "alarm", w < 12 ? "false" : "true"));
        assert_close(json_number(line, "positive_votes"), w < 10 ? 0 : w < 15 ? w - 9 : 5, 0, 0);
        assert_close(json_number(line, "votes"), w < 5 ? w + 1 : 5, 0, 0);
    }
    const char *s = summary();
    assert_close(json_number(s, "samples"), 20 * WINDOW + 7, 0, 0);
    assert_close(json_number(s, "received"), 20 * WINDOW + 7, 0, 0);
    assert_close(json_number(s, "judged"), 20, 0, 0);
    assert_close(json_number(s, "positive"), 10, 0, 0);
    assert_close(json_number(s, "alarms"), 1, 0, 0);
    assert_close(json_number(s, "time_to_detection"), 13 * 8 - 80, 1e-9, 0);
    assert_close(json_number(s, "false_alarms"), 0, 0, 0);
    assert_close(json_number(s, "false_alarms_per_day"), 0, 0, 0);
    assert_true(json_is(s, "interrupted", "false"));
    /* Known to be intact longer: what is found before counts as false. */
    cli_expect("lg-anomaly", "watch m.h5 --json --quiet --input feed.csv --crack-at 130", 0, "summary",
               &result);
    assert_int_equal(count_lines(result.out), 2);
    s = summary();
    assert_close(json_number(s, "false_alarms"), 1, 0, 0);
    assert_close(json_number(s, "false_alarms_per_day"), 86400.0 / (16 * 8), 1e-12, 0);
    assert_close(json_number(s, "false_positive_windows_per_day"), 6 * 86400.0 / (16 * 8), 1e-12, 0);
    assert_close(json_number(s, "time_to_detection"), 136 - 130, 1e-9, 0);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    assert_true(json_is(summary(), "time_to_detection", "null"));
    assert_true(json_is(summary(), "false_alarms", "null"));
}

TEST("a network watches too") {
    write_feed("feed.csv", true, 5 * WINDOW, 0);
    cli_expect("lg-anomaly", "watch n.h5 --json --input feed.csv", 0, "summary", &result);
    assert_int_equal(count_lines(result.out), 6);
    const double score = json_number(line_of(result.out, 2), "score");
    assert_true(score >= 0 && score <= 1);
}

TEST("the same samples in every form give the same verdicts") {
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
        char *at = text + sprintf(text, "%s", rows[r].before);
        (void)add_samples(at, rows[r].form, rows[r].timed, 0, 4 * WINDOW, 2 * WINDOW);
        cli_write("feed.csv", text);
        cli_expect("lg-anomaly", "watch m.h5 --input feed.csv", 0, "# windows 4: judged 4, positive 2",
                   &result);
        const size_t verdicts = (size_t)(strstr(result.out, "# samples") - result.out);
        if (r == 0) memcpy(other, result.out, verdicts + 1);
        if (strncmp(result.out, other, verdicts) != 0)
            fail_msg("row %zu:\n%s\nnot\n%s", r, result.out, other);
        assert_string_equal(result.err, "");
    }
    /* A last line without an end is a sample. */
    text[strlen(text) - 2] = '\0';
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --input feed.csv", 0, "# windows 4: judged 4", &result);
}

TEST("times tell what is missing") {
    char *at = add_samples(text, timed_form, true, 0, 50, 999);
    at = add_samples(at, timed_form, true, 53, 90, 999);    /* 3 in window 1 */
    at = add_samples(at, timed_form, true, 200, 240, 999);  /* 30 of window 2, windows 3 and 4 */
    (void)add_samples(at, timed_form, true, 239, 280, 999); /* one twice */
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    static const int missing[] = {0, 3, 30, 40, 40, 0, 0};
    assert_int_equal(count_lines(result.out), 8);
    for (int w = 0; w < 7; w++) {
        const char *line = line_of(result.out, w);
        assert_close(json_number(line, "missing"), missing[w], 0, 0);
        assert_true(json_is(line, "judged", missing[w] <= 4 ? "true" : "false"));
        assert_true(json_is(line, "class", missing[w] <= 4 ? "\"intact\"" : "null"));
        assert_close(json_number(line, "time"), w * 8 + 7.8, 1e-12, 0);
    }
    assert_close(json_number(summary(), "absent"), 113, 0, 0);
    assert_close(json_number(summary(), "repeated"), 1, 0, 0);
    assert_close(json_number(summary(), "samples"), 280, 0, 0);
}

TEST("times that jitter and drift lose no sample, and a clock that is set does not stop the watch") {
    char *at = text;
    for (int i = 0; i < 5000; i++)
        at += sprintf(at, "%.4f,0.1,-0.1\n", 1.7e9 + i * 0.2003 + 0.05 * sin(1.3 * i));
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --quiet --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "received"), 5000, 0, 10);
    assert_close(json_number(summary(), "samples"), 5007, 0, 8);
    at = add_samples(text, timed_form, true, 10000, 10080, 0);
    at = add_samples(at, timed_form, true, 0, 80, 0);
    at += sprintf(at, "1e300,1,1\n");
    (void)sprintf(at, "-1e300,1,1\n");
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "judged"), 4, 0, 0);
    assert_close(json_number(summary(), "windows"), 5, 0, 0);
    assert_close(json_number(summary(), "malformed"), 2, 0, 0); /* nothing goes on from 1e300 */
    assert_non_null(strstr(result.err, "begins anew"));
}

TEST("values that are missing are lost samples, and other lines are malformed") {
    static const struct {
        const char *line;
        bool malformed;
    } rows[] = {{"nan,1", false},    {"1,", false},      {",", false},      {"-inf,NaN", false},
                {"NA;null", false},  {"1e999,1", false}, {"1e39,1", false}, {"1", true},
                {"1,2,3,4", true},   {"foo,bar", true},  {"1,abc", true},   {"9,81;3,2", true},
                {"1,2;", true},      {"1.2.3,4", true},  {"0x1p3,1", true}, {"1,,2,,,,", true},
                {"--1,1", true},     {"1e,1", true},     {"1,2e+", true},   {"nano,1", true},
                {"1,\x01\xff", true}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        char *at = add_samples(text, plain_form, false, 0, 20, 999), words[64];
        at += sprintf(at, "%s\n", rows[r].line);
        (void)add_samples(at, plain_form, false, 21, 40, 999);
        cli_write("feed.csv", text);
        (void)snprintf(words, sizeof words, "not finite %d, malformed %d", !rows[r].malformed,
                       rows[r].malformed);
        cli_expect("lg-anomaly", "watch m.h5 --input feed.csv", 0, words, &result);
        assert_non_null(strstr(result.out, "intact\t"));
        assert_non_null(strstr(result.out, "\t0/1\t1\t-"));
        if (rows[r].malformed != (strstr(result.err, "line 21: ") != NULL))
            fail_msg("'%s': %s", rows[r].line, result.err);
    }
    char *at = add_samples(text, plain_form, false, 0, 20, 999);
    for (int i = 0; i < 30; i++) at += sprintf(at, "what %d\n", i);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --input feed.csv", 0, "malformed 30", &result);
    assert_int_equal(count_lines(result.err), 6);
    assert_non_null(
        strstr(result.err, "line 40: 20 lines in a row could not be read; expected are 2 numbers"));
    assert_non_null(strstr(result.err, "line 25: 'what' is not a number"));
    assert_non_null(strstr(result.err, "only counted"));
}

TEST("a very long line costs no other line") {
    char *at = add_samples(text, plain_form, false, 0, 20, 999);
    memset(at, '7', 700000);
    at += 700000;
    at += sprintf(at, "\n");
    at = add_samples(at, plain_form, false, 21, 60, 999);
    memset(at, ' ', 100000); /* blanks, and numbers of very many digits, are fine */
    at += 100000;
    at += sprintf(at, "0.%0500d1,%0400d\n", 0, 1);
    (void)add_samples(at, plain_form, false, 61, 80, 999);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "malformed"), 1, 0, 0);
    assert_close(json_number(summary(), "received"), 79, 0, 0);
    assert_close(json_number(summary(), "judged"), 2, 0, 0);
    assert_non_null(strstr(result.err, "line 21: longer than"));
    memset(text, '7', 700000); /* a feed that is one line without an end */
    text[700000] = '\0';
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --input feed.csv", 3, "no line holds 2 numbers", &result);
}

TEST("the layout is that of lines that agree, though the first ones are cut off") {
    char *at = text + sprintf(text, "1,2\n"); /* cut off */
    (void)add_samples(at, timed_form, true, 1, 200, 999);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "malformed"), 1, 0, 0);
    assert_close(json_number(summary(), "received"), 199, 0, 0);
    /* Names count as a line: two that are cut off do not decide against them. */
    at = text + sprintf(text, "time,acc,moment\n1,2\n1,2\n");
    (void)add_samples(at, timed_form, true, 2, 200, 999);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "malformed"), 2, 0, 0);
    /* A title of as many words as channels does not decide either. */
    at = text + sprintf(text, "Well seven\n");
    (void)add_samples(at, timed_form, true, 0, 200, 999);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "received"), 200, 0, 0);
    assert_close(json_number(summary(), "malformed"), 0, 0, 0);
}

TEST("one column less, for a while or for good, is lost samples, never a time taken for a value") {
    for (int timed = 0; timed < 2; timed++) {
        char *at = add_samples(text, timed ? timed_form : plain_form, timed, 0, 100, 999);
        for (int i = 100; i < 104; i++) at += sprintf(at, timed ? "%.1f,0.1\n" : "%.1f,0.1,0.1\n", i / 5.0);
        (void)add_samples(at, timed ? timed_form : plain_form, timed, 104, 400, 999);
        cli_write("feed.csv", text);
        cli_expect("lg-anomaly", "watch m.h5 --json --votes 1 --input feed.csv", 0, "summary", &result);
        assert_close(json_number(summary(), "malformed"), 4, 0, 0);
        assert_close(json_number(summary(), "received"), 396, 0, 0);
        assert_close(json_number(summary(), "samples"), 400, 0, 0);
        assert_close(json_number(summary(), "absent"), timed ? 4 : 0, 0, 0);
        assert_close(json_number(summary(), "judged"), 10, 0, 0);
        assert_close(json_number(summary(), "alarms"), 0, 0, 0);
    }
    char *at = add_samples(text, timed_form, true, 0, 100, 999);
    for (int i = 100; i < 400; i++) at += sprintf(at, "%d,0.1\n", i);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --votes 1 --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "malformed"), 300, 0, 0);
    assert_close(json_number(summary(), "alarms"), 0, 0, 0);
    assert_non_null(strstr(result.err, "line 101: 2 numbers, not 3 with the time"));
    assert_non_null(
        strstr(result.err, "20 lines in a row could not be read; expected are a time and 2 numbers"));
}

TEST("lines that hold no sample move no clock: every true sample is received") {
    static const struct {
        const char *line;
        int malformed[2]; /* without times, with times */
    } rows[] = {{"", {0, 0}},
                {" \t\r", {0, 0}},
                {"# comment", {0, 0}},
                {"time,acc,moment", {0, 0}},
                {"what is this", {3, 3}},
                {"time;acc;moment", {3, 3}}};
    for (size_t r = 0; r < LG_COUNT(rows); r++)
        for (int timed = 0; timed < 2; timed++) {
            char *at = text + sprintf(text, "time,acc,moment\n");
            for (int i = 0; i < 3; i++) {
                at = add_samples(at, timed ? timed_form : plain_form, timed, 40 * i, 40 * i + 30, 999);
                at += sprintf(at, "%s\n", rows[r].line);
                at = add_samples(at, timed ? timed_form : plain_form, timed, 40 * i + 30, 40 * i + 40, 999);
            }
            cli_write("feed.csv", text);
            cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
            const int malformed = rows[r].malformed[timed];
            assert_close(json_number(summary(), "received"), 120, 0, 0);
            assert_close(json_number(summary(), "repeated"), 0, 0, 0);
            assert_close(json_number(summary(), "malformed"), malformed, 0, 0);
            assert_close(json_number(summary(), "samples"), timed ? 120 : 120 + malformed, 0, 0);
        }
}

static void write_rate(double rate, int samples, double jitter) {
    char *at = text;
    for (int i = 0; i < samples; i++)
        at += sprintf(at, "%.4f,%.5g,0.1\n", i / rate + jitter * sin(0.7 * i), 0.1 * sin(0.9 * i));
    cli_write("feed.csv", text);
}

TEST("a feed of another rate is refused before anything is judged, or forced onto its grid") {
    static const struct {
        double rate, jitter;
        bool refused;
    } rows[] = {{50, 0, true},    {2.5, 0, true}, {5.1, 0, true},  {4.9, 0, true},    {5.04, 0, false},
                {4.96, 0, false}, {5, 0, false},  {5, 0.1, false}, {4.5, 0.05, true}, {10, 0.02, true}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        char words[64] = "summary";
        write_rate(rows[r].rate, 400, rows[r].jitter);
        if (rows[r].refused && rows[r].jitter == 0)
            (void)snprintf(words, sizeof words, "say %.6g samples a second", rows[r].rate);
        else if (rows[r].refused)
            (void)snprintf(words, sizeof words, "trained at 5:");
        cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", rows[r].refused ? 3 : 0, words,
                   &result);
        if (!rows[r].refused) continue;
        assert_string_equal(result.out, "");
        assert_non_null(strstr(result.err, "trained at 5:"));
        assert_non_null(strstr(result.err, "--rate"));
    }
    write_rate(50, 10000, 0);
    cli_expect("lg-anomaly", "watch m.h5 --json --rate 5 --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "received"), 1000, 0, 1);
    assert_close(json_number(summary(), "absent"), 0, 0, 0);
    assert_close(json_number(line_of(result.out, 20), "time"), 20 * 8 + 7.8, 0, 0.11);
    assert_non_null(strstr(result.err, "say 50 samples a second, --rate 5"));
    cli_expect("lg-anomaly", "watch m.h5 --json --rate 50 --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "received"), 10000, 0, 0);
    write_rate(2.5, 400, 0);
    cli_expect("lg-anomaly", "watch m.h5 --json --rate 5 --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "received"), 400, 0, 0);
    assert_close(json_number(summary(), "absent"), 399, 0, 0);
}

TEST("one wrong time costs its own line; what comes again and again is a jump") {
    static const char *const wrong[] = {"5%.1f", "59%.1f", "-%.1f", "1e%.0f", "%.0fe200", "0%.3g"};
    static const int places[] = {0, 1, 2, 57, 300, 318, 319};
    for (size_t k = 0; k < LG_COUNT(wrong); k++)
        for (size_t p = 0; p < LG_COUNT(places); p++) {
            const int where = places[p];
            if (k > 0 && k < 5 && where != 57) continue;
            char *at = add_samples(text, timed_form, true, 1000, 1000 + (uint64_t)where, 9999);
            char time[128];
            (void)snprintf(time, sizeof time, wrong[k], 200 + where / 5.0);
            if (k == 5) (void)snprintf(time, sizeof time, "%.1f", 259 + where / 5.0); /* 59 s too late */
            at += sprintf(at, "%s,0.1,0.1\n", time);
            (void)add_samples(at, timed_form, true, 1001 + (uint64_t)where, 1320, 9999);
            cli_write("feed.csv", text);
            cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
            const bool inside = where > 0 && where < 319;
            if (json_number(summary(), "malformed") != 1 || json_number(summary(), "received") != 319 ||
                json_number(summary(), "absent") != inside || json_number(summary(), "repeated") != 0)
                fail_msg("%s at %d: %s%s", time, where, result.err, summary());
            assert_non_null(strstr(result.err, "does not fit the lines around it"));
        }
    /* Two in a row, and one within the samples that confirm a gap. */
    char *at = add_samples(text, timed_form, true, 0, 100, 999);
    at += sprintf(at, "520.0,0.1,0.1\n3.2,0.1,0.1\n");
    at = add_samples(at, timed_form, true, 102, 200, 999);
    at = add_samples(at, timed_form, true, 230, 232, 999);
    at += sprintf(at, "546.4,0.1,0.1\n");
    at = add_samples(at, timed_form, true, 233, 300, 999);
    at = add_samples(at, timed_form, true, 320, 322, 999); /* gaps that follow each other closely */
    (void)add_samples(at, timed_form, true, 350, 400, 999);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    assert_close(json_number(summary(), "malformed"), 3, 0, 0);
    assert_close(json_number(summary(), "received"), 100 + 98 + 2 + 67 + 2 + 50, 0, 0);
    assert_close(json_number(summary(), "samples"), 400, 0, 0);
}

TEST("a long gap is counted, not printed window by window") {
    char *at = add_samples(text, timed_form, true, 0, 80, 999);
    (void)add_samples(at, timed_form, true, 40080, 40160, 999);
    cli_write("feed.csv", text);
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
    assert_int_equal(count_lines(result.out), 2 + 3 + 1 + 2 + 1);
    assert_close(json_number(line_of(result.out, 5), "not_judged"), 997, 0, 0);
    assert_close(json_number(line_of(result.out, 7), "window"), 1003, 0, 0);
    assert_close(json_number(summary(), "absent"), 40000, 0, 0);
    assert_close(json_number(summary(), "windows"), 1004, 0, 0);
    assert_close(json_number(summary(), "judged"), 4, 0, 0);
    cli_expect("lg-anomaly", "watch m.h5 --input feed.csv", 0, "# not judged: 997 windows more", &result);
}

TEST("a last line without an end may hold half a number") {
    static const struct {
        const char *line;
        int malformed;
    } rows[] = {{"15.8,0.1,0.1", 1},
                {"15.8,0.1,0.1 ", 0},
                {"15.8,0.1,0.1,", 0},
                {"15.8,0.1,0.1\r", 0},
                {"15.8,0.1,0.1#", 0},
                {"15.8,0.1", 1},
                {"15", 1},
                {"15.8,0.1,-", 1}};
    for (size_t r = 0; r < LG_COUNT(rows); r++) {
        char *at = add_samples(text, timed_form, true, 0, 79, 999);
        (void)sprintf(at, "%s", rows[r].line);
        cli_write("feed.csv", text);
        cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "summary", &result);
        assert_close(json_number(summary(), "malformed"), rows[r].malformed, 0, 0);
        assert_close(json_number(summary(), "judged"), r < 5 ? 2 : 1, 0, 0);
        if (r == 0) assert_close(json_number(line_of(result.out, 1), "missing"), 1, 0, 0);
    }
    cli_write("feed.csv", "0.1 0.2"); /* all there is */
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "\"received\": 1", &result);
}

TEST("--crack-at beyond the last sample is told") {
    write_feed("feed.csv", true, 200, 100);
    cli_expect("lg-anomaly", "watch m.h5 --json --crack-at 20 --input feed.csv", 0, "summary", &result);
    assert_string_equal(result.err, "");
    cli_expect("lg-anomaly", "watch m.h5 --json --crack-at 2520000 --input feed.csv", 0, "summary", &result);
    assert_non_null(strstr(result.err, "--crack-at 2520000 s is after the last sample, at 39.8 s"));
    cli_expect("lg-anomaly", "watch --help", 0, "takes hours", &result);
    cli_expect("lg-anomaly", "feed --help", 0, "takes seconds", &result);
}

TEST("windows that overlap vote as they are asked to") {
    write_feed("feed.csv", true, 4 * WINDOW, 2 * WINDOW);
    cli_expect("lg-anomaly", "watch m.h5 --hop 1.6 --votes 1 --votes-of 1 --input feed.csv", 0,
               "# windows 16:", &result);
    cli_expect("lg-anomaly", "watch m.h5 --hop 0.2 --quiet --votes 40 --votes-of 64 --input feed.csv", 0,
               "# windows 121:", &result);
    assert_int_equal(count_lines(result.out), 4); /* one change, three lines of summary */
    cli_expect("lg-anomaly", "watch m.h5 --rate 10 --hop 4 --input feed.csv", 0, "# windows 7: judged 0",
               &result);
    assert_non_null(strstr(result.err, "trained at 5 Hz, not 10 Hz"));
}

TEST("an empty feed is told") {
    cli_write("feed.csv", "");
    cli_expect("lg-anomaly", "watch m.h5 --json --input feed.csv", 0, "\"samples\": 0", &result);
    assert_true(json_is(summary(), "days", "0"));
    cli_expect("lg-anomaly", "watch m.h5 --json --crack-at 5 --input /dev/null", 0, "\"samples\": 0",
               &result);
    assert_true(json_is(summary(), "false_alarms_per_day", "null"));
}

TEST("a refused command line tells its exit code and word") {
    write_feed("feed.csv", true, 50, 999);
    cli_write("words.csv", "acc,moment\nfoo,bar\n");
    cli_write("three.csv", "1,2,3,4\n1,2,3,4\n");
    const cli_bad rows[] = {
        {"watch", 2, "MODEL.h5"},
        {"watch none.h5 --input feed.csv", 3, "none.h5"},
        {"watch feed.csv --input feed.csv", 3, "feed.csv"},
        {"watch data.h5 --input feed.csv", 3, "data.h5"},
        {"watch m.h5 --input none.csv", 3, "none.csv"},
        {"watch m.h5 --input .", 3, "directory"},
        {"watch m.h5 --votes 6 --input feed.csv", 2, "--votes 6"},
        {"watch m.h5 --votes 0 --input feed.csv", 2, "votes"},
        {"watch m.h5 --votes-of 65 --input feed.csv", 2, "votes-of"},
        {"watch m.h5 --hop 8.2 --input feed.csv", 2, "--hop"},
        {"watch m.h5 --hop 0.01 --input feed.csv", 2, "--hop"},
        {"watch m.h5 --hop nan --input feed.csv", 2, "hop"},
        {"watch m.h5 --bridge -1 --input feed.csv", 2, "bridge"},
        {"watch m.h5 --missing 1.5 --input feed.csv", 2, "missing"},
        {"watch m.h5 --crack-at soon --input feed.csv", 2, "crack-at"},
    };
    cli_expect_refused("lg-anomaly", rows, LG_COUNT(rows), &result);
    cli_expect("lg-anomaly", "watch m.h5 --quiet --input words.csv", 3, "no line holds 2 numbers", &result);
    cli_expect("lg-anomaly", "watch m.h5 --quiet --input three.csv", 3, "line 1: more than 3 numbers",
               &result);
}

/* Reads from a child's output until `words` appear; false after ten seconds. */
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
    (void)add_samples(text, timed_form, true, 0, WINDOW, 0);
    const size_t bytes = strlen(text);
    assert_int_equal(write(feed[1], text, bytes), bytes); /* the window is complete: its verdict must come */
    assert_true(wait_for(child, "\"window\": 0", &used));
    const char part[] = "8.0,1."; /* half a line */
    assert_int_equal(write(feed[1], part, sizeof part - 1), sizeof part - 1);
    assert_int_equal(kill(child.pid, SIGINT), 0);
    memcpy(other, result.out, used + 1);
    cli_finish(child, &result);
    (void)close(feed[1]);
    assert_int_equal(result.code, 130);
    assert_true(json_is(summary(), "interrupted", "true"));
    assert_close(json_number(summary(), "received"), WINDOW, 0, 0);
}

TEST("memory does not grow with the feed") {
    char path[1024];
    cli_path("feed.csv", path, sizeof path);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    for (int i = 0; i < 600000; i++)
        if (i % 1000 < 990)
            (void)fprintf(file, "%d.%d,%s,0.%d\n", i / 5, i % 5 * 2, i % 777 == 0 ? "nan" : "-0.1", i % 7);
    assert_int_equal(fclose(file), 0);
    cli_expect("lg-anomaly", "watch m.h5 --json --quiet --input feed.csv", 0, "summary", &result);
    const char *s = summary();
    assert_close(json_number(s, "samples"), 599990, 0, 0);
    assert_close(json_number(s, "absent"), 5990, 0, 0);
    assert_close(json_number(s, "windows"), 14999, 0, 0);
    const double start = json_number(s, "start_rss_kb"), most = json_number(s, "max_rss_kb");
    printf("%.3g samples/s, %g KiB at the start, %g KiB at most\n", json_number(s, "samples_per_second"),
           start, most);
    assert_true(start > 0 && most - start < 1024);
}

TEST_GROUP(make_models, remove_models)

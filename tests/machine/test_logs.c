/* Logs of machines in CSV and HDF5. */
#include "support/io_test.h"
#include "liegrad/geometry.h"
#include "liegrad/machine.h"

/* ---- machines and logs of a test ---- */

RELEASES(release_file, lg_machine_file_destroy)
RELEASES(release_logs, lg_logs_destroy)

static const lg_machine_file *machine(const char *text) {
    lg_machine_file *file = TEST_ARRAY(lg_machine_file, 1);
    assert_told(lg_machine_file_parse(NULL, "machine.yaml", text, strlen(text), file, &told));
    lg_test_owns(file, release_file);
    return file;
}

static const lg_logs *read_all(const lg_machine_file *file, const char *const *paths, size_t count,
                               const lg_log_options *options) {
    lg_logs *logs = TEST_ARRAY(lg_logs, 1);
    assert_told(lg_logs_read(NULL, file, paths, count, options, logs, &told));
    lg_test_owns(logs, release_logs);
    return logs;
}

static const lg_logs *read_text(const lg_machine_file *file, const char *text) {
    const char *path = scratch_path("log.csv");
    write_text_to(path, text);
    return read_all(file, &path, 1, NULL);
}

static void refuse_paths(const lg_machine_file *file, const char *const *paths, size_t count,
                         lg_status status, const char *word1, const char *word2) {
    lg_error error = {LG_OK, ""};
    lg_logs *logs = TEST_ARRAY(lg_logs, 1), before;
    memset(logs, 0x5a, sizeof *logs);
    before = *logs;
    const lg_status got = lg_logs_read(NULL, file, paths, count, NULL, logs, &error);
    if (got != status) fail_msg("%s (%s), expected: %s %s", lg_status_name(got), error.message, word1, word2);
    assert_memory_equal(logs, &before, sizeof before);
    assert_says(error.message, word1);
    assert_says(error.message, word2);
}

static void refuse_text(const lg_machine_file *file, const char *text, const char *word1, const char *word2) {
    const char *path = scratch_path("log.csv");
    write_text_to(path, text);
    refuse_paths(file, &path, 1, LG_FORMAT, word1, word2);
    refuse_paths(file, &path, 1, LG_FORMAT, "log.csv: ", "");
}

static bool warns(const lg_logs *logs, const char *part) {
    for (uint32_t i = 0; i < logs->warning_count; i++)
        if (strstr(logs->warnings[i], part) != NULL) return true;
    return false;
}

static void assert_warns(const lg_logs *logs, const char *part) {
    if (!warns(logs, part))
        fail_msg("no '%s' in %u warnings: %s", part, logs->warning_count,
                 logs->warning_count > 0 ? logs->warnings[0] : "");
}

static void assert_silent(const lg_logs *logs) {
    if (logs->warning_count > 0) fail_msg("warning: %s", logs->warnings[0]);
}

static void assert_parts(const lg_logs *logs, size_t parts, const size_t *first) {
    assert_int_equal(logs->log.parts, parts);
    for (size_t i = 0; i <= parts; i++) assert_int_equal(logs->log.first[i], first[i]);
    assert_int_equal(logs->log.rows, first[parts]);
}

/* A text that grows. */
typedef struct text {
    char *at;
    size_t used, room;
} text;

static text new_text(const char *header) {
    text t = {TEST_ARRAY(char, 4u << 20), 0, 4u << 20};
    t.used = (size_t)sprintf(t.at, "%s\n", header);
    return t;
}

static void say_row(text *t, const double *numbers, int count) {
    for (int i = 0; i < count; i++)
        t->used += (size_t)sprintf(t->at + t->used, "%s%.17g", i > 0 ? "," : "", numbers[i]);
    t->used += (size_t)sprintf(t->at + t->used, "\n");
    assert_true(t->used + 1000 < t->room);
}

#define LINE  "coordinates: [{name: q, kind: line, velocity: v}]\n"
#define TURNS "coordinates: [{name: q, kind: angle, velocity: v}]\n"
#define SEEN  "coordinates: [{name: q, kind: line}]\nmeasured: positions\n"

/* ---- CSV ---- */

TEST("rows are read in any dialect of CSV") {
    static const char *const dialects[] = {
        "t,q,v,u\n0,1,10,5\n1,11,10,6\n2,,10,7\n3,31,nan,8\n",
        "v;u;q;t\n10;5;1;0\n10;6;11;1\n10;7;NA;2\nNaN;8;31;3\n",
        "t\tq\tv\tu\n0\t1\t10\t5\n1\t11\t10\t6\n2\t\t10\t7\n3\t31\t\t8",
        "\xef\xbb\xbf# made by hand\r\n\"t\", q ,\"v\",\"u\", \"a \"\"note\"\", all\"\r\n0, 1 ,\"10\",5,\"x, "
        "y\"\r\n1,1.1e1,10,6,\r\n"
        "\r\n2,,10,7,\r\n3,31,,8,",
    };
    static const double q[] = {1, 11, NAN, 31}, v[] = {10, 10, 10, NAN}, u[] = {5, 6, 7, 8};
    const lg_machine_file *f = machine(LINE "inputs: {columns: [u]}\n");
    for (size_t d = 0; d < LG_COUNT(dialects); d++) {
        const lg_logs *logs = read_text(f, dialects[d]);
        const size_t first[] = {0, 4};
        assert_parts(logs, 1, first);
        for (int i = 0; i < 4; i++) {
            assert_true(logs->t[i] == i && logs->u[4 * i] == u[i] && logs->u[4 * i + 1] == 0);
            assert_true(isnan(q[i]) ? isnan(logs->q[i]) : logs->q[i] == q[i]);
            assert_true(isnan(v[i]) ? isnan(logs->v[i]) : logs->v[i] == v[i]);
        }
        assert_true(logs->columns[1].missing == 1 && logs->columns[1].low == 1 &&
                    logs->columns[1].high == 31);
        assert_true(logs->rows_read == 4 && logs->runs == 1 && logs->files == 1 && logs->dt_median == 1);
        assert_silent(logs);
    }
}

TEST("a file that is not a log is refused with file, line and column") {
    static const struct {
        const char *text, *word1, *word2;
    } wrong[] = {
        {"", "line 1", "is empty"},
        {"# only this\n", "line 2", "is empty"},
        {"t,q\n0,1\n", "line 1: there is no column 'v'", "the columns are: t, q"},
        {"# a\n\ntime;q;v\n", "line 3: there is no column 't'", "time, q, v"},
        {"t,q,v,q\n0,1,1,1\n", "line 1", "there are two columns 'q'"},
        {"t,q,v\n0,1,1\n1,one,1\n", "line 3", "column q: 'one' is not a number"},
        {"t;q;v\n0;1,5;1\n", "line 2: column q: '1,5'", "write decimals with a point"},
        {"t,q,v\n0,1e999,1\n", "line 2: column q", "not a finite number"},
        {"t,q,v\n0,inf,1\n", "line 2: column q", "'inf'"},
        {"t,q,v\n0,1\n1,2,1\n", "line 2", "has 2 cells, the header has 3"},
        {"t,q,v\n0,1,1,1\n", "line 2", "has 4 cells"},
        {"t,q,v\n0,\"1,1\n", "line 2", "quote is not closed"},
        {"t,q,v\n0,\"1\"2,1\n", "line 2", "follows a closing quote"},
        {"t,q,v\n", "has no row with a time", "column t"},
        {"t,q,v\n,1,1\n", "has no row with a time", "column t"},
        {"t,q,v\n0,1,1\n", "no run has two rows", ""},
        {"t,q,v\n0,,1\n1,,1\n", "column q: has no value", ""},
        {"t,q,v\n0,1,\n1,,1\n", "no row is complete", ""},
        {"t,q,v\n0,1,1\n1,1,1\n1,1,1\n", "line 4: column t: time does not increase", "1 after 1"},
        {"t,q,v\n0,1,1\n1,1,1\n0.5,1,1\n", "line 4", "columns: {run: ...}"},
        {"t,q,v,a\"b,c\"d\n0,1,1,1\n", "line 1", "a cell has a quote inside: put the cell in quotes"},
    };
    const lg_machine_file *f = machine(LINE);
    for (size_t i = 0; i < LG_COUNT(wrong); i++)
        refuse_text(f, wrong[i].text, wrong[i].word1, wrong[i].word2);
    const char *path = scratch_path("log.csv"), *none = scratch_path("nothing-here");
    write_bytes_to(path, "t,q,v\n0,\0,1\n", 12);
    refuse_paths(f, &path, 1, LG_FORMAT, "line 2", "is not text");
    refuse_paths(f, &none, 1, LG_NOT_FOUND, "nothing-here", "");
    path = scratch;
    refuse_paths(f, &path, 1, LG_FILE, "regular", "");
    refuse_paths(f, &path, 0, LG_INVALID_ARGUMENT, "at least one log", "");
    path = "";
    refuse_paths(f, &path, 1, LG_INVALID_ARGUMENT, "needs a name", "");
}

TEST("an incomplete line and rows without a time are left out with a warning") {
    const lg_machine_file *f = machine(LINE);
    const lg_logs *logs = read_text(f, "t,q,v\n0,1,1\n,1,1\n1,2,1\n2,3");
    assert_int_equal(logs->log.rows, 2);
    assert_int_equal(logs->rows_read, 3);
    assert_warns(logs, "the last line was cut off");
    assert_warns(logs, "1 rows without a time");
}

TEST("numbers are scaled, times too") {
    const lg_machine_file *f = machine(LINE "scale: {t: 0.001, q: 2}\n");
    const lg_logs *logs = read_text(f, "t,q,v\n0,1,5\n10,2,6\n20,4,7\n");
    assert_close(logs->t[2], 0.02, 1e-15, 0);
    assert_true(logs->q[2] == 8 && logs->v[2] == 7);
    assert_close(logs->dt_median, 0.01, 1e-15, 0);
}

TEST("times of a log may be dates or times of day, which have no scale") {
    static const char dates[] = "t,q,v\n2024-02-29T23:59:59.75Z,1,5\n2024-03-01T00:00:00.25Z,2,6\n";
    const lg_logs *logs = read_text(machine(LINE), dates);
    assert_true(logs->t[0] == 0 && logs->t[1] == 0.5 && logs->dt_median == 0.5);
    refuse_text(machine(LINE "scale: {t: 0.001}\n"), dates,
                "line 2: column t: '2024-02-29T23:59:59.75Z' is a date with an offset",
                "remove the column's scale, 0.001");
    static const char packed[] = "t,q,v\n20240229235959,1,5\n20240301000000.5,2,6\n";
    refuse_text(machine(LINE), packed, "line 2: column t: 20240229235959 is a date without separators",
                "write dates as 2024-03-01T12:00:00");
    assert_int_equal(read_text(machine(LINE "scale: {t: 1e-9}\n"), packed)->rows_read, 2);
    static const char *const also[] = {"20240229235959123", "202402292359", "240229235959", "240229235959.5"};
    for (size_t i = 0; i < LG_COUNT(also); i++)
        refuse_text(machine(LINE), test_text("t,q,v\n%s,1,5\n", also[i]),
                    "line 2: column t: ", "is a date without separators");
    refuse_text(machine(LINE "scale: {t: 0.001}\n"), "t,q,v\n20240229235959123,1,5\n",
                "line 2: column t: ", "is a date without separators");
    assert_int_equal(read_text(machine(LINE), "t,q,v\n20240001123456,1,5\n20240001123457,2,6\n")->rows_read,
                     2);
}

/* ---- runs and parts ---- */

TEST("a file is a run, or a column names the runs") {
    const char *paths[] = {scratch_path("a.csv"), scratch_path("b.csv")};
    write_text_to(paths[0], "t,q,v,r\n0,1,0,one\n1,2,0,one\n0,3,0,two\n1,4,0,two\n");
    write_text_to(paths[1], "t,q,v,r\n0,5,0,two\n1,6,0,two\n2,7,0,two\n");
    const lg_logs *logs = read_all(machine("columns: {run: r}\n" LINE), paths, 2, NULL);
    static const size_t first[] = {0, 2, 4, 7};
    static const uint32_t file[] = {0, 0, 1}, run[] = {0, 1, 2};
    assert_parts(logs, 3, first);
    assert_memory_equal(logs->part_file, file, sizeof file);
    assert_memory_equal(logs->part_run, run, sizeof run);
    assert_true(logs->runs == 3 && logs->files == 2 && logs->gaps == 0);
    for (int i = 0; i < 7; i++) assert_true(logs->q[i] == i + 1);
    refuse_paths(machine(LINE), paths, 2, LG_FORMAT, "a.csv: line 4", "does not increase");
    write_text_to(paths[0], "t,q,v,r\n0,1,0,\n");
    refuse_paths(machine("columns: {run: r}\n" LINE), paths, 1, LG_FORMAT, "line 2: column r",
                 "the row names no run");
    write_text_to(paths[0], test_text("t,q,v,r\n0,1,0,%064d\n", 0));
    refuse_paths(machine("columns: {run: r}\n" LINE), paths, 1, LG_FORMAT,
                 "column r: the text has more than 63 bytes: shorten it", "");
}

TEST("time steps longer than 1.4 medians, or longer than max_step, are gaps") {
    static const char log[] = "t,q,v\n0,0,1\n1,1,1\n2,2,1\n3.3,3.3,1\n4.3,4.3,1\n6,6,1\n7,7,1\n";
    static const size_t two[] = {0, 5, 7}, one[] = {0, 7}, three[] = {0, 3, 5, 7};
    const lg_logs *logs = read_text(machine(LINE), log);
    assert_parts(logs, 2, two);
    assert_int_equal(logs->gaps, 1);
    assert_close(logs->dt_max, 1.7, 1e-12, 0);
    assert_close(logs->max_step, 1.4, 1e-12, 0);
    assert_parts(read_text(machine("columns: {max_step: 1.7}\n" LINE), log), 1, one);
    assert_parts(read_text(machine("columns: {max_step: 1.2}\n" LINE), log), 3, three);
    refuse_text(machine("columns: {max_step: 0.5}\n" LINE), log, "every step is longer than max_step",
                "scale: {t: 0.001}");
}

TEST("files with different rates cause a warning") {
    const char *paths[] = {scratch_path("a.csv"), scratch_path("b.csv")};
    write_text_to(paths[0], "t,q,v\n0,1,0\n1,2,0\n2,3,0\n3,4,0\n");
    write_text_to(paths[1], "t,q,v\n0,1,0\n0.3,2,0\n0.6,3,0\n");
    assert_warns(read_all(machine(LINE), paths, 2, NULL), "different rates: the median step is 1 s in");
    write_text_to(paths[1], "t,q,v\n0,1,0\n0.4,2,0\n0.8,3,0\n");
    assert_silent(read_all(machine(LINE), paths, 2, NULL));
}

/* ---- inputs ---- */

static const char lossy[] =
    "t,q,v,u\n0,0,1,\n1,1,1,1\n2,2,1,2\n3,3,1,\n4,4,1,4\n5,5,1,5\n6,6,1,\n7,7,1,\n8,8,1,8\n";

TEST("a missing input ends its part") {
    const lg_logs *logs = read_text(machine(LINE "inputs: {columns: [u]}\n"), lossy);
    static const size_t held[] = {0, 3, 6}, linear[] = {0, 2, 4};
    static const double t[] = {1, 2, 3, 4, 5, 6}, u[] = {1, 2, 2, 4, 5, 5};
    assert_parts(logs, 2, held);
    assert_memory_equal(logs->t, t, sizeof t);
    for (int i = 0; i < 6; i++) assert_true(logs->u[4 * i] == u[i]);
    logs = read_text(machine(LINE "inputs: {columns: [u], hold: linear}\n"), lossy);
    assert_parts(logs, 2, linear);
    assert_true(logs->t[0] == 1 && logs->t[2] == 4);
    refuse_text(machine(LINE "inputs: {columns: [u]}\n"), "t,q,v,u\n0,1,1,\n1,1,1,\n2,1,1,4\n",
                "no two rows with inputs follow each other", "");
}

TEST("a delay moves inputs within parts") {
    static const char log[] =
        "t,q,v,u\n0,0,1,0\n1,1,1,1\n2,2,1,4\n3,3,1,9\n9,9,1,16\n10,10,1,25\n11,11,1,36\n"
        "12,12,1,49\n";
    const lg_machine_file *f = machine(LINE "inputs: {columns: [u], delay: 2}\n");
    static const size_t two[] = {0, 2, 4}, none[] = {0, 4, 8}, one[] = {0, 3, 6};
    static const double t[] = {2, 3, 11, 12}, u[] = {0, 1, 16, 25};
    const lg_logs *logs = read_text(f, log);
    assert_parts(logs, 2, two);
    assert_int_equal(logs->delay[0], 2);
    assert_memory_equal(logs->t, t, sizeof t);
    for (int i = 0; i < 4; i++) assert_true(logs->u[4 * i] == u[i]);
    const char *path = scratch_path("log.csv");
    lg_log_options options;
    lg_log_options_init(&options);
    write_text_to(path, log);
    options.delay = 1;
    assert_parts(read_all(f, &path, 1, &options), 2, two);
    f = machine(LINE "inputs: {columns: [u], delay: estimate}\n");
    logs = read_all(f, &path, 1, &options);
    assert_parts(logs, 2, one);
    assert_int_equal(logs->delay[0], 1);
    assert_parts(read_all(f, &path, 1, NULL), 2, none);
    assert_true(logs->u[0] == 0 && logs->u[4] == 1);
    options.size = 1;
    assert_status(lg_logs_read(NULL, f, &path, 1, &options, (lg_logs *)logs, NULL), LG_INVALID_ARGUMENT);
    refuse_text(machine(LINE "inputs: {columns: [u], delay: 4}\n"), log, "is the delay longer than the runs?",
                "");
}

TEST("each input has its hold and its delay") {
    static const char log[] =
        "t,q,v,u,w\n0,0,1,0,10\n1,1,1,1,20\n2,2,1,4,40\n3,3,1,9,80\n4,4,1,,90\n5,5,1,3,95\n"
        "6,6,1,2,\n7,7,1,1,96\n8,8,1,0,97\n";
    const char *inputs = "inputs: {columns: [u, w], hold: [zero, linear], delay: [%d, %d]}\n";
    /* A row without u, which is held, ends its part; a row without w is dropped. */
    static const size_t at_once[] = {0, 5, 7}, late[] = {0, 4, 6};
    const lg_logs *logs = read_text(machine(test_text(LINE "%s", test_text(inputs, 0, 0))), log);
    assert_parts(logs, 2, at_once);
    assert_true(logs->t[4] == 4 && logs->u[8 * 4] == 9 && logs->t[5] == 7);
    for (size_t row = 0; row < 4; row++) {
        const double *u = logs->u + 8 * row;
        assert_true(u[2] == 0 && u[3] == u[9] - u[1] && u[3] > 0);
    }
    logs = read_text(machine(test_text(LINE "%s", test_text(inputs, 0, 1))), log);
    assert_parts(logs, 2, late);
    assert_true(logs->delay[0] == 0 && logs->delay[1] == 1);
    assert_true(logs->t[0] == 1 && logs->u[0] == 1 && logs->u[1] == 10 && logs->u[3] == 10);
}

TEST("inputs between rows are linear, or cubic where possible") {
    static const double t[] = {0, 1, 1.5, 2.7, 3.5, 4.4, 5};
    enum { N = LG_COUNT(t) };
    text log = new_text("t,q,v,u,w");
    for (int i = 0; i < N; i++) {
        const double x = t[i], row[] = {x, x, 1, x, 2 - 3 * x + x * x - 0.5 * x * x * x};
        say_row(&log, row, 5);
    }
    const char *yaml = "columns: {max_step: 9}\n" LINE "inputs: {columns: [u, w], hold: %s}\n";
    char linear[200], cubic[200];
    (void)sprintf(linear, yaml, "linear");
    (void)sprintf(cubic, yaml, "cubic");
    const lg_logs *logs = read_text(machine(linear), log.at);
    for (int i = 0; i + 1 < N; i++) {
        const double *u = logs->u + 8 * i, *next = u + 8;
        assert_true(u[1] == 2 - 3 * t[i] + t[i] * t[i] - 0.5 * t[i] * t[i] * t[i] || u[1] != 0);
        assert_close(u[2], t[i + 1] - t[i], 1e-12, 0);
        assert_close(u[1] + u[3], next[1], 1e-12, 1e-12);
        assert_true(u[4] == 0 && u[5] == 0 && u[6] == 0 && u[7] == 0);
    }
    /* Not-a-knot splines reproduce cubic polynomials exactly, for any steps. */
    logs = read_text(machine(cubic), log.at);
    for (int i = 0; i + 1 < N; i++) {
        for (double s = 0; s <= 1; s += 0.25) {
            const double *u = logs->u + 8 * i, x = t[i] + s * (t[i + 1] - t[i]);
            assert_close(u[0] + s * (u[2] + s * (u[4] + s * u[6])), x, 1e-12, 1e-12);
            assert_close(u[1] + s * (u[3] + s * (u[5] + s * u[7])), 2 - 3 * x + x * x - 0.5 * x * x * x,
                         1e-11, 1e-11);
        }
    }
    assert_true(logs->u[8 * (N - 1)] == 5 &&
                logs->u[8 * (N - 1) + 2] == 0); /* there is no interval after the last row */
    logs = read_text(machine(cubic), "t,q,v,u,w\n0,0,1,0,1\n1,1,1,1,2\n2,2,1,4,1\n"); /* three rows */
    assert_true(logs->u[2] == 1 && logs->u[4] == 0 && logs->u[8 + 2] == 3 && logs->u[8 + 3] == -1);
}

TEST("cubic inputs have two continuous derivatives and do not cross gaps") {
    text log = new_text("t,q,v,u");
    for (int i = 0; i < 20; i++) {
        const double t = i + 0.2 * sin(i) + (i >= 12 ? 100 : 0), row[] = {t, t, 1, cos(i * i)};
        say_row(&log, row, 4);
    }
    const lg_logs *logs =
        read_text(machine("columns: {max_step: 2}\n" LINE "inputs: {columns: u, hold: cubic}\n"), log.at);
    static const size_t first[] = {0, 12, 20};
    assert_parts(logs, 2, first);
    for (int i = 0; i < 19; i++) {
        const double *u = logs->u + 4 * i, *n = u + 4;
        if (i == 11) {
            assert_true(u[0] == cos(121) && u[1] == 0 && u[2] == 0 && u[3] == 0);
            continue;
        }
        assert_close(u[0] + u[1] + u[2] + u[3], n[0], 0, 1e-12);
        if (i == 10 || i == 18) continue;
        const double h = logs->t[i + 1] - logs->t[i], g = logs->t[i + 2] - logs->t[i + 1];
        assert_close((u[1] + 2 * u[2] + 3 * u[3]) / h, n[1] / g, 0, 1e-11);
        assert_close((2 * u[2] + 6 * u[3]) / (h * h), 2 * n[2] / (g * g), 0, 1e-11);
    }
    /* The not-a-knot condition: the third derivatives of the first two intervals are equal. */
    const double h = logs->t[1] - logs->t[0], g = logs->t[2] - logs->t[1];
    assert_close(logs->u[3] / (h * h * h), logs->u[7] / (g * g * g), 1e-10, 0);
}

TEST("inputs that never change and coordinates that never move cause warnings") {
    const lg_logs *logs =
        read_text(machine(LINE "inputs: {columns: [u]}\n"), "t,q,v,u\n0,1,0,5\n1,1,0,5\n2,1,0,5\n");
    assert_warns(logs, "column u: the input is always 5");
    assert_warns(logs, "coordinate q never moves");
    text log = new_text("t,q,v,u");
    for (int i = 0; i < 100; i++) {
        const double row[] = {0.1 * i, 0.3, 0, sin(i)};
        say_row(&log, row, 4);
    }
    logs = read_text(machine(LINE "inputs: {columns: [u]}\n"), log.at);
    assert_true(logs->columns[1].noise == 0 && logs->warning_count == 1);
}

/* ---- attitudes ---- */

#define BODY "coordinates: [{name: b, kind: rotation, columns: [w, x, y, z]}]\nmeasured: positions\n"
#define MATRIX                                                                                               \
    "coordinates: [{name: b, kind: rotation, columns: [a, b, c, d, e, f, g, h, i]}]\nmeasured: positions\n"

TEST("quaternions are normalised, made continuous and converted to rotations") {
    const lg_logs *logs = read_text(machine(BODY), "t,w,x,y,z\n0,1,0,0,0\n1,-0.6,0,0,-0.8\n2,,0,0,1\n"
                                                   "3,0.8016,0,0,0.6012\n4,-0.6,0,-0.8,0\n");
    static const double turned[] = {0.36 - 0.64, -0.96, 0, 0.96, 0.36 - 0.64, 0, 0, 0, 1};
    static const double identity[] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const double third[] = {0.64 - 0.36, -0.96, 0, 0.96, 0.64 - 0.36, 0, 0, 0, 1};
    assert_all_close(logs->q, identity, 9, 0, 1e-15);
    assert_all_close(logs->q + 9, turned, 9, 0, 1e-15);
    for (int i = 0; i < 9; i++) assert_true(isnan(logs->q[18 + i]));
    assert_all_close(logs->q + 27, third, 9, 0, 1e-12);
    assert_warns(logs, "columns w, x, y, z: 2 changes of sign were undone");
    assert_warns(logs, "1 rows were off by more than 0.001, at most by 0.002");
    assert_int_equal(logs->warning_count, 2);
    refuse_text(machine(BODY), "t,w,x,y,z\n0,1,0,0,0\n1,0.98,0,0,0\n",
                "line 3: columns w, x, y, z: not a quaternion", "length 0.98");
    refuse_text(machine(BODY), "t,w,x,y,z\n0,1,0,0,0\n1,0,0,0,0\n", "line 3", "length 0 ");
}

TEST("matrices are projected to the nearest rotation, those with determinant -1 are refused") {
    const lg_logs *logs = read_text(
        machine(MATRIX), "t,a,b,c,d,e,f,g,h,i\n0,1,0,0,0,1,0,0,0,1\n1,0,-1.002,0,1.002,0,0,0,0,1\n");
    static const double quarter[] = {0, -1, 0, 1, 0, 0, 0, 0, 1};
    assert_all_close(logs->q + 9, quarter, 9, 0, 1e-12);
    assert_warns(logs, "1 rows were off by more than 0.001");
    const lg_logs *part =
        read_text(machine(MATRIX),
                  "t,a,b,c,d,e,f,g,h,i\n0,1,0,0,0,1,0,0,0,1\n1,1,0,0,0,1,,0,0,1\n2,1,0,0,0,1,0,0,0,1\n");
    for (int i = 0; i < 9; i++) assert_true(isnan(part->q[9 + i]) && !isnan(part->q[18 + i]));
    refuse_text(machine(MATRIX), "t,a,b,c,d,e,f,g,h,i\n0,1,0,0,0,1,0,0,0,1\n1,1.02,0,0,0,1,0,0,0,1\n",
                "line 3: columns a, b, c, d, e, f, g, h, i: not a rotation matrix",
                "differs from the nearest one by 0.02");
    refuse_text(machine(MATRIX), "t,a,b,c,d,e,f,g,h,i\n0,1,0,0,0,1,0,0,0,-1\n1,1,0,0,0,1,0,0,0,1\n", "line 2",
                "determinant -1, so it is a reflection");
}

TEST("directions are normalised and have no angular velocity along themselves") {
    const char *yaml = "coordinates: [{name: d, kind: direction, columns: [x, y, z], velocity: [a, b, c]}]\n";
    const lg_logs *logs = read_text(machine(yaml), "t,x,y,z,a,b,c\n0,0,0,1.005,1,2,3\n1,0,0,1,1,2,0\n");
    static const double q[] = {0, 0, 1, 0, 0, 1}, v[] = {1, 2, 0, 1, 2, 0};
    assert_all_close(logs->q, q, 6, 0, 1e-15);
    assert_all_close(logs->v, v, 6, 0, 1e-15);
    assert_warns(logs, "columns a, b, c: a part of 0.688 of the angular velocity is about the direction");
    assert_warns(logs, "columns x, y, z: 1 rows were off");
    refuse_text(machine(yaml), "t,x,y,z,a,b,c\n0,0,0,1,0,0,0\n1,0,0,2,0,0,0\n",
                "line 3: columns x, y, z: not a direction", "length 2");
}

TEST("a pose's velocities in space are converted to the axes of the body") {
    const char *yaml =
        "coordinates: [{name: h, kind: pose, position: [x, y, z], columns: [qw, qx, qy, qz], velocity: "
        "[a, b, c], rates: [d, e, f], frame: %s}]\n";
    static const char log[] =
        "t,x,y,z,qw,qx,qy,qz,a,b,c,d,e,f\n0,1,2,3,0.6,0,0,0.8,1,0,2,4,5,6\n1,1,2,3,0.6,0,0,0.8,1,0,2,4,5,6\n";
    static const double space[] = {-0.28, -0.96, 2, 4, 5, 6}, body[] = {1, 0, 2, 4, 5, 6};
    static const double q[] = {1, 2, 3, -0.28, -0.96, 0, 0.96, -0.28, 0, 0, 0, 1};
    char yaml_text[300];
    (void)sprintf(yaml_text, yaml, "space");
    const lg_logs *logs = read_text(machine(yaml_text), log);
    assert_all_close(logs->v, space, 6, 0, 1e-15);
    assert_all_close(logs->q, q, 12, 0, 1e-15);
    (void)sprintf(yaml_text, yaml, "body");
    assert_all_close(read_text(machine(yaml_text), log)->v, body, 6, 0, 0);
}

/* ---- angles ---- */

#define ANGLE "coordinates: [{name: a, kind: angle}]\nmeasured: positions\n"

/* a = amplitude sin(t) + rate t at 100 rows, times `unit`; wrapped by `turn` if that is above 0. */
static const char *angle_log(double amplitude, double rate, double unit, double turn) {
    text log = new_text("t,a");
    for (int i = 0; i < 100; i++) {
        const double t = 0.1 * i, a = unit * (amplitude * sin(t) + rate * t);
        const double row[] = {t, turn > 0 ? a - turn * round(a / turn) : a};
        say_row(&log, row, 2);
    }
    return log.at;
}

TEST("positions are integrals of velocities if the log has no positions; a missing velocity equals the "
     "velocity before it, or 0") {
    const lg_machine_file *file =
        machine("coordinates: [{name: q, kind: line, velocity: v}, {name: p, kind: line, velocity: w}]\n"
                "measured: velocities-only\n");
    static const double q[] = {0, 1, 2, 4}, p[] = {0, 1, 3, 5};
    const lg_logs *logs = read_text(file, "t,v,w\n0,1,\n1,1,2\n2,,2\n3,3,2\n");
    for (size_t row = 0; row < 4; row++) {
        assert_close(logs->log.q[2 * row], q[row], 1e-14, 0);
        assert_close(logs->log.q[2 * row + 1], p[row], 1e-14, 0);
    }
}

TEST("integrals of accelerations have no drift: a bias of the sensor leaves nothing, vibrations stay") {
    const lg_machine_file *file =
        machine("coordinates: [{name: q, kind: line, acceleration: a}]\nmeasured: accelerations\n");
    static const int lengths[] = {50, 390, 610, 2000};
    for (size_t i = 0; i < LG_COUNT(lengths); i++)
        for (int shaken = 0; shaken < 2; shaken++) {
            const double w = 40, bias = 0.7, size = 3;
            text t = new_text("t,a");
            for (int row = 0; row < lengths[i]; row++)
                say_row(&t,
                        (double[]){0.01 * row, bias + shaken * size * cos(w * 0.01 * row) + 1e-9 * (row % 2)},
                        2);
            const lg_logs *logs = read_text(file, t.at);
            assert_int_equal(logs->log.rows, lengths[i]);
            for (int row = 0; row < lengths[i]; row++) {
                const double v = logs->log.v[row], expected = shaken * size / w * sin(w * 0.01 * row);
                assert_true(fabs(v - expected) < (shaken == 1 ? 0.6 * size / w : 1e-8));
                assert_true(fabs(logs->log.a[row] - bias) <= shaken * size + 1e-6);
            }
        }
}

TEST("angles are unwrapped") {
    const double turn = 2 * acos(-1);
    const lg_logs *logs = read_text(machine(ANGLE), angle_log(2, 4, 1, turn));
    for (int i = 0; i < 100; i++) assert_close(logs->q[i], 2 * sin(0.1 * i) + 0.4 * i, 1e-12, 1e-12);
    assert_warns(logs, "column a: 6 jumps of 2 pi were undone");
    logs = read_text(machine(ANGLE "unwrap: false\n"), angle_log(2, 4, 1, turn));
    assert_true(fabs(logs->q[99]) < 3.2);
    assert_silent(read_text(machine(ANGLE), angle_log(2, 1, 1, 0)));
    /* 2.5 radians per row: the jumps are far from 2 pi. */
    logs = read_text(machine(ANGLE), angle_log(0, 25, 1, turn));
    for (int i = 0; i < 100; i++) assert_close(logs->q[i], 2.5 * i, 1e-12, 1e-12);
}

TEST("across missing values an angle turns as its velocity says, wrapped or not; without one a warning says "
     "that this is a guess") {
    enum { ROWS = 100, FIRST = 12, END = 57, SIZE = 1 << 14 };
    const double turn = 2 * acos(-1);
    for (int i = 0; i < 4; i++) {
        const bool wrapped = i % 2 == 1, alone = i >= 2;
        char all[SIZE] = "t,w,a\n";
        for (int row = 0; row < ROWS; row++) {
            const double a = 9 * sin(0.06 * row);
            lg_append(all, SIZE, "%.2f,%.9f,", 0.01 * row, 54 * cos(0.06 * row));
            if (row < FIRST || row >= END)
                lg_append(all, SIZE, "%.9f", wrapped ? a - turn * round(a / turn) : a);
            lg_append(all, SIZE, "\n");
        }
        const lg_logs *logs =
            read_text(machine(alone ? ANGLE : "coordinates: [{name: a, kind: angle, velocity: w}]\n"), all);
        for (int row = 0; row < ROWS && !alone; row++)
            if (!isnan(logs->q[row])) assert_close(logs->q[row], 9 * sin(0.06 * row), 0, 1e-6);
        assert_true(warns(logs, "across missing values, where no velocity counts turns") ==
                    (alone && !wrapped));
    }
}

TEST("angles in degrees are recognised") {
    refuse_text(machine(ANGLE), angle_log(2, 4, 180 / acos(-1), 360), "column a: goes from",
                "scale: {a: 0.0174533}");
    refuse_text(machine(ANGLE), angle_log(2, 0, 180 / acos(-1), 0), "column a: changes by",
                "scale: {a: 0.0174533}");
    refuse_text(machine(ANGLE), angle_log(2, 40, 180 / acos(-1), 720), "column a: changes by",
                "scale: {a: 0.0174533}");
    assert_warns(read_text(machine(ANGLE "unwrap: false\n"), angle_log(2, 0, 180 / acos(-1), 0)),
                 "if they are degrees, set scale: {a: 0.0174533}");
    const lg_logs *logs =
        read_text(machine(ANGLE "scale: {a: 0.017453292519943295}\n"), angle_log(2, 4, 180 / acos(-1), 360));
    assert_close(logs->q[99], 2 * sin(9.9) + 39.6, 1e-12, 0);
}

/* ---- positions and velocities ---- */

#define TWO "coordinates: [{name: x, kind: line, velocity: vx}, {name: a, kind: angle, velocity: va}]\n"

/* Two sines and their rates; the rates are multiplied by `factor`, and positions and rates have noise. */
static const char *two_sines(double factor, double noise) {
    text log = new_text("t,x,vx,a,va");
    const double *n = test_numbers(7, 4 * 400, -1.7320508, 1.7320508);
    for (int i = 0; i < 400; i++) {
        const double t = 0.02 * i;
        const double row[] = {t, sin(3 * t) + noise * n[4 * i],
                              factor * (3 * cos(3 * t) + 5 * noise * n[4 * i + 1]),
                              cos(2 * t) + noise * n[4 * i + 2], -2 * sin(2 * t) + 5 * noise * n[4 * i + 3]};
        say_row(&log, row, 5);
    }
    return log.at;
}

#define SPIN "coordinates: [{name: b, kind: rotation, columns: [qw, qx, qy, qz], velocity: [w1, w2, w3]}]\n"

TEST("velocities of a wrong unit or sign are refused") {
    const lg_machine_file *f = machine(TWO);
    assert_silent(read_text(f, two_sines(1, 0)));
    assert_silent(read_text(f, two_sines(1, 5e-3)));
    assert_silent(read_text(f, two_sines(1, 5e-2)));
    assert_silent(read_text(f, two_sines(1.15, 0)));
    refuse_text(f, two_sines(1000, 0), "column vx: the rate of x is 0.001",
                "if the unit is wrong, set scale: {vx: 0.001");
    refuse_text(f, two_sines(1000, 5e-3), "column vx: the rate of x is",
                "if the unit is wrong, set scale: {vx: 0.00");
    /* found by using many rows */
    refuse_text(f, two_sines(1000, 5e-2), "column vx: the rate of x is", "the unit is wrong");
    refuse_text(f, two_sines(-1, 5e-3), "column vx: the rate of x is -1",
                "if the sign is wrong, set scale: {vx: -1");
    refuse_text(f, two_sines(0.7, 0), "column vx", "the unit is wrong");
    refuse_text(machine(TWO "scale: {vx: 0.1}\n"), two_sines(1000, 0), "column vx: the rate of x is 0.01",
                "if the unit is wrong, set scale: {vx: 0.001");
    const char *path = scratch_path("log.csv");
    lg_log_options options;
    lg_log_options_init(&options);
    options.consistency = false;
    assert_true(read_all(f, &path, 1, &options)->log.rows == 400);
    assert_true(read_text(machine("measured: momenta\n" TWO), two_sines(1000, 0))->log.rows == 400);
}

/* A correct log with noise, rounded to the given steps and clipped at the ends of the sensors' ranges; 0
 * means not rounded, or not clipped. */
static const char *rounded(double noise, double step_x, double step_v, double end_x, double end_v) {
    text log = new_text("t,q,v");
    const double *n = test_numbers(7, 2 * 400, -1.7320508, 1.7320508);
    for (int i = 0; i < 400; i++) {
        const double t = 0.02 * i;
        double row[] = {t, sin(t) + 0.3 * cos(2.9 * t), cos(t) - 0.87 * sin(2.9 * t)};
        const double step[] = {0, step_x, step_v}, end[] = {0, end_x, end_v};
        for (int k = 1; k < 3; k++) {
            row[k] += noise * n[2 * i + k - 1];
            if (end[k] > 0) row[k] = fmax(-end[k], fmin(end[k], row[k]));
            if (step[k] > 0) row[k] = step[k] * round(row[k] / step[k]);
        }
        say_row(&log, row, 3);
    }
    return log.at;
}

TEST("rounded numbers of a correct log are not taken for a saturated sensor, which is found in rounded "
     "logs too") {
    static const double steps[] = {0, 1e-3, 0.01, 0.02, 0.05, 0.1, 0.2};
    for (size_t i = 0; i < LG_COUNT(steps); i++)
        for (size_t j = 0; j < LG_COUNT(steps); j++)
            assert_silent(read_text(machine(LINE), rounded(0, steps[i], steps[j], 0, 0)));
    assert_silent(read_text(machine(LINE), rounded(0, 0.5, 0, 0, 0))); /* only five different numbers */
    for (size_t i = 0; i < LG_COUNT(steps); i++) /* a rounded position that stands still is not stuck */
        assert_int_equal(read_text(machine(LINE), rounded(0, steps[i], 0, 0, 0))->stuck[0].rows, 0);
    refuse_text(machine(LINE), rounded(0.01, 0, 0, 0.2, 0), "column q: is at its", "end of its range");
    refuse_text(machine(LINE), rounded(0.01, 0, 0, 0, 0.2), "column v: is at its", "end of its range");
    for (size_t i = 0; i < LG_COUNT(steps) && steps[i] < 0.1; i++) {
        refuse_text(machine(LINE), rounded(0, steps[i], 0, 0.6, 0), "column q: is at its",
                    "end of its range");
        refuse_text(machine(LINE), rounded(0, 0, steps[i], 0, 0.6), "column v: is at its",
                    "end of its range");
    }
}

TEST("a rounded angle is not taken for a saturated sensor where turns were undone") {
    /* The value at 150 is a turn and a little away: then the values are multiples of no step. */
    for (int step = 2; step <= 10; step++) {
        text log = new_text("t,q,v");
        for (int i = 0; i < 400; i++) {
            const double a = 0.01 * step * round(70.0 / step * cos(0.02 * i));
            const double row[] = {0.02 * i, a + (i == 150 ? 6.33 : 0), -0.7 * sin(0.02 * i)};
            say_row(&log, row, 3);
        }
        (void)read_text(machine(TURNS), log.at);
    }
}

TEST("velocities that are constant to rounding are right, at any place and in any unit") {
    static const double speeds[] = {0, -3e-18, -3e-9, 1e-3, 1, 1e9}, places[] = {0, 1, -1e3, 1e6},
                        errors[] = {0, 1e-16, 1e-12, 1e-8};
    const double *n = test_numbers(7, 400, -1.7320508, 1.7320508);
    for (size_t k = 0; k < LG_COUNT(speeds) * LG_COUNT(places) * LG_COUNT(errors); k++) {
        const double v = speeds[k % LG_COUNT(speeds)],
                     place = places[k / LG_COUNT(speeds) % LG_COUNT(places)],
                     error = errors[k / LG_COUNT(speeds) / LG_COUNT(places)];
        text log = new_text("t,q,v");
        for (int i = 0; i < 400; i++) {
            const double row[] = {0.02 * i, place + v * 0.02 * i, v * (1 + error * n[i])};
            say_row(&log, row, 3);
        }
        assert_false(warns(read_text(machine(LINE), log.at), "fit badly"));
    }
}

TEST("a proposed scale is a power of ten where the rate is nearly one") {
    text log = new_text("t,q,v");
    for (int i = 0; i < 400;
         i++) /* times in nanoseconds, which a double rounds, and a rate that is .4 % off */
        say_row(&log, (double[]){1.7e18 + 2e7 * i, sin(0.02 * i), 1.004 * cos(0.02 * i)}, 3);
    refuse_text(machine(LINE), log.at, "if all coordinates show this: {t: 1e-09}", "{v: 1e-09}");
    log = new_text("t,q,v");
    for (int i = 0; i < 400; i++) say_row(&log, (double[]){0.02 * i, sin(0.02 * i), 1.3 * cos(0.02 * i)}, 3);
    refuse_text(machine(LINE), log.at, "{t: 0.76", "");
}

TEST("a single outlier of a velocity or position is named with its line") {
    static const double sizes[] = {1e2, -1e3, 1e6, 1e12};
    for (size_t k = 0; k < LG_COUNT(sizes) * 2; k++) {
        const bool velocity = k % 2 == 1;
        text log = new_text("t,q,v");
        for (int i = 0; i < 400; i++) {
            double row[] = {0.02 * i, sin(0.02 * i), cos(0.02 * i)};
            if (i == 200) row[1 + velocity] = sizes[k / 2];
            say_row(&log, row, 3);
        }
        const lg_logs *logs = read_text(machine(LINE), log.at);
        assert_warns(logs, velocity ? "line 202: column v: " : "line 202: column q: ");
        assert_int_equal(logs->columns[1].outliers, !velocity);
        assert_int_equal(logs->columns[2].outliers, velocity);
        assert_true(isnan((velocity ? logs->log.v : logs->log.q)[200]));
        assert_true(logs->columns[1 + velocity].high <= 1);
    }
}

TEST("positions with several rows far off, which the velocity does not show, are refused with the line") {
    static const int lengths[] = {5, 30, 30};
    for (size_t k = 0; k < LG_COUNT(lengths); k++) {
        text log = new_text("t,q,v");
        for (int i = 0; i < 400; i++) {
            double row[] = {0.02 * i, sin(0.02 * i), (k == 2 ? 10 : 1) * cos(0.02 * i)};
            if (i >= 200 && i < 200 + lengths[k]) row[1] += 50;
            say_row(&log, row, 3);
        }
        if (k == 2) { /* a wrong unit, too */
            refuse_text(machine(LINE), log.at, "columns q and v do not belong together", "");
            continue;
        }
        refuse_text(machine(LINE), log.at, "line 202: column q: jumps to",
                    "2 steps are more than 20 times the usual step");
    }
}

TEST("a log keeps as many warnings as it has columns") {
    enum { LINES = 12, INPUTS = 16, COLUMNS = 1 + LINES + INPUTS };
    char text_of[2048] = "measured: positions\ncoordinates:\n", header[512] = "t";
    for (int i = 0; i < LINES; i++) {
        (void)sprintf(text_of + strlen(text_of), "  - {name: q%d, kind: line}\n", i);
        (void)sprintf(header + strlen(header), ",q%d", i);
    }
    (void)strcat(text_of, "inputs: {columns: [");
    for (int i = 0; i < INPUTS; i++) {
        (void)sprintf(text_of + strlen(text_of), "%su%d", i > 0 ? ", " : "", i);
        (void)sprintf(header + strlen(header), ",u%d", i);
    }
    (void)strcat(text_of, "]}\n");
    text log = new_text(header);
    for (int row = 0; row < 20; row++) {
        double numbers[COLUMNS] = {0.1 * row};
        for (int i = 1; i < COLUMNS; i++) numbers[i] = i;
        say_row(&log, numbers, COLUMNS);
    }
    const lg_logs *logs = read_text(machine(text_of), log.at);
    assert_true(logs->warning_count >= LINES + INPUTS);
    assert_warns(logs, "u0");
    assert_warns(logs, "u15");
    assert_warns(logs, "q11");
}

/* Position and velocity at row i. */
typedef void motion_of(int i, double *x);
static void swinging(int i, double *x) {
    x[0] = sin(0.02 * i), x[1] = cos(0.02 * i);
}
static void with_outliers(int i, double *x) {
    swinging(i, x);
    if (i == 50 || i == 120 || i == 121) x[0] += 0.1;
    if (i == 121) x[0] -= 0.3;
    /* The smaller value is near the polynomial through the larger one: only the larger one shows the pair. */
    if (i == 300 || i == 401) x[0] += 0.3;
    if (i == 301 || i == 400) x[0] += 0.2;
    for (int apart = 2; apart < 6; apart++) /* one outlier near another one */
        if (i == 20 * apart || i == 21 * apart) x[1] += i == 20 * apart ? 0.2 : -0.3;
    if (i == 200 || i == 598) x[1] -= 0.1;
    if (i == 1) x[0] += 0.1;
}
static void bouncing(int i, double *x) {
    swinging(i, x);
    x[1] *= x[0] < 0 ? -1 : 1, x[0] = fabs(x[0]);
}
static void in_counts(int i, double *x) {
    swinging(i, x);
    x[0] = 0.01 * round(100 * x[0]), x[1] = 0.02 * round(50 * x[1]);
}
static void at_rest(int i, double *x) { /* one count of an encoder comes and goes */
    x[0] = i % 37 == 0 ? 0.01 : i > 300 ? 0.0 : 0.01 * (i / 30 % 2), x[1] = 0.02 * (i % 41 == 0);
}
static void often(int i, double *x) { /* too many for outliers */
    swinging(i, x);
    x[0] += i % 12 == 5 ? 0.1 : 0.0;
}
static void pushed(int i, double *x) { /* three rows are no outlier */
    swinging(i, x);
    x[0] += i >= 150 && i < 153 ? 0.1 : 0.0;
}

TEST("outliers of one or two rows are left out; kinks, steps, counts and pulses are kept, in any unit") {
    static const struct {
        motion_of *motion;
        double noise;
        size_t position, velocity;
    } cases[] = {{with_outliers, 0, 8, 10}, {with_outliers, 1e-3, 8, 10}, {swinging, 0, 0, 0},
                 {swinging, 1e-3, 0, 0},    {bouncing, 0, 0, 0},          {bouncing, 1e-3, 0, 0},
                 {in_counts, 0, 0, 0},      {at_rest, 0, 0, 0},           {often, 0, 0, 0},
                 {pushed, 0, 0, 0},         {pushed, 1e-3, 0, 0}};
    static const double units[] = {1, 1e-9, 1e9};
    lg_log_options options;
    lg_log_options_init(&options);
    options.consistency = false;
    for (size_t k = 0; k < LG_COUNT(cases) * LG_COUNT(units); k++) {
        const double unit = units[k % LG_COUNT(units)];
        const size_t at = k / LG_COUNT(units);
        lg_rng rng;
        lg_rng_seed(&rng, 1, at);
        text log = new_text("t,q,v");
        for (int i = 0; i < 600; i++) {
            double row[3] = {0.02 * i};
            cases[at].motion(i, row + 1);
            for (int c = 1; c < 3; c++) row[c] = unit * (row[c] + cases[at].noise * lg_rng_normal(&rng));
            say_row(&log, row, 3);
        }
        const char *path = scratch_path("log.csv");
        write_text_to(path, log.at);
        const lg_logs *logs = read_all(machine(LINE), &path, 1, &options);
        assert_true(warns(logs, "so they are kept") == (cases[at].motion == often));
        if (logs->columns[1].outliers != cases[at].position ||
            logs->columns[2].outliers != cases[at].velocity)
            fail_msg("case %zu, unit %g: %zu and %zu outliers", at, unit, logs->columns[1].outliers,
                     logs->columns[2].outliers);
    }
}

TEST("a mark of missing inputs is named, also where it stands in many rows") {
    for (int apart = 7; apart <= 60; apart += 53) {
        text log = new_text("t,q,v,u");
        for (int i = 0; i < 151; i++) {
            const double row[] = {i, i % 7, 0, i % apart == 3 ? -9999 : (i * 37 % 20) / 10.0};
            say_row(&log, row, 4);
        }
        const char *path = scratch_path("log.csv");
        lg_log_options options;
        lg_log_options_init(&options);
        options.consistency = false;
        write_text_to(path, log.at);
        const lg_logs *logs = read_all(machine(LINE "inputs: {columns: [u]}\n"), &path, 1, &options);
        assert_warns(logs, test_text("line 5: column u: jumps to -9999 and back, but most rows are between "
                                     "0 and 1.9; this is the first of %d such jumps",
                                     147 / apart + 1));
    }
}

TEST("a value at an end of a run is an outlier only if it is far beyond the size of all others, too") {
    text log = new_text("t,r,q,v,u,w");
    for (int i = 0; i < 80; i++) {
        const bool end = i == 39 || i == 40; /* of the first run, of the second run */
        const double row[] = {i, i / 40, i % 7, 0, end ? 1e4 : i % 5, end ? 1e3 : 5};
        say_row(&log, row, 6);
    }
    const char *path = scratch_path("log.csv");
    lg_log_options options;
    lg_log_options_init(&options);
    options.consistency = false;
    write_text_to(path, log.at);
    const lg_logs *logs =
        read_all(machine("columns: {run: r}\n" LINE "inputs: {columns: [u, w]}\n"), &path, 1, &options);
    assert_warns(logs,
                 "line 41: column u: jumps to 10000 and back, but most rows are between 0 and 4; this is "
                 "the first of 2 such jumps");
    assert_false(warns(logs, "column w: jumps"));
}

TEST("the range of an angle is the same with and without an outlier, though angles are unwrapped") {
    double high[2];
    for (int spike = 0; spike < 2; spike++) {
        text log = new_text("t,q,v");
        for (int i = 0; i < 400; i++) {
            const double row[] = {0.02 * i,
                                  remainder(0.06 * i + 0.5 * (spike && i == 200), 6.283185307179586), 3};
            say_row(&log, row, 3);
        }
        const lg_logs *logs =
            read_text(machine("coordinates: [{name: q, kind: angle, velocity: v}]\n"), log.at);
        assert_int_equal(logs->columns[1].outliers, spike);
        high[spike] = logs->columns[1].high;
    }
    assert_true(high[0] > 3 && high[1] == high[0]);
}

TEST("a jump of an acceleration is no outlier: bodies may touch") {
    text log = new_text("t,a");
    for (int i = 0; i < 400; i++) {
        const double row[] = {0.02 * i, sin(0.3 * i) + (i == 200 ? 50 : 0)};
        say_row(&log, row, 2);
    }
    const lg_logs *logs = read_text(
        machine("coordinates: [{name: q, kind: line, acceleration: a}]\nmeasured: accelerations\n"), log.at);
    assert_true(logs->columns[1].outliers == 0 && logs->log.a[200] > 45);
}

TEST("five rows per period are enough to find a wrong unit") {
    for (int wrong = 0; wrong < 2; wrong++) {
        text log = new_text("t,q,v");
        for (int i = 0; i < 200; i++) {
            const double row[] = {i, sin(1.4 * i), (wrong ? 1000 : 1) * 1.4 * cos(1.4 * i)};
            say_row(&log, row, 3);
        }
        if (!wrong) assert_silent(read_text(machine(LINE), log.at));
        if (wrong)
            refuse_text(machine(LINE), log.at, "column v: the rate of q is 0.0012", "the unit is wrong");
    }
}

TEST("late rates do not cause a wrong accusation") {
    text log = new_text("t,qw,qx,qy,qz,w1,w2,w3");
    for (int i = 0; i < 400; i++) { /* about one axis, so rates in space and in the body are the same */
        const double t = 0.02 * i, half = 0.5 * sin(t);
        const double row[] = {t, cos(half), 0, 0, sin(half), 0, 0, cos(t - 0.3)};
        say_row(&log, row, 8);
    }
    assert_silent(read_text(machine(SPIN), log.at));
}

/* A swing of a period of 630 rows with noise (or, if `shaken`, a vibration) that hides it over few rows, in
 * any unit of time and position; the rates are multiplied by `factor`. */
static const char *hidden(double factor, bool shaken, double time, double size) {
    text log = new_text("t,q,v");
    const double *n = test_numbers(7, 1200, -1.7320508, 1.7320508);
    for (int i = 0; i < 1200; i++) {
        const double t = 0.002 * i, off = shaken ? 0.1 * sin(15 * t) : 0.05 * n[i];
        const double row[] = {time * t, size * (0.35 * sin(5 * t) + off),
                              factor * 1.75 * cos(5 * t) * size / time};
        say_row(&log, row, 3);
    }
    return log.at;
}

TEST("a wrong sign, degrees and wrong units are found over many rows where noise or vibration hides the "
     "motion") {
    static const double times[] = {1, 1e9}, sizes[] = {1, 1e-9}, turn = 180 / 3.14159265358979;
    for (int k = 0; k < 4; k++) {
        const double time = times[k % 2], size = sizes[k / 2];
        assert_silent(read_text(machine(LINE), hidden(1, false, time, size)));
        assert_warns(read_text(machine(LINE), hidden(1, true, time, size)), "columns q and v agree over");
        for (int shaken = 0; shaken < 2; shaken++) {
            refuse_text(machine(LINE), hidden(-1, shaken, time, size), "the rate of q is -1",
                        "if the sign is wrong, set scale: {v: -1} or {q: -1}");
            assert_warns(read_text(machine(LINE), hidden(0.01, shaken, time, size)),
                         "if the unit is wrong, set scale: {v: 100} or {q: 0.01}");
            if (size == 1)
                refuse_text(machine(TURNS), hidden(turn, shaken, time, 1), "the rate of q is 0.0",
                            "if the velocity is in degrees, set scale: {v: 0.0174533}");
        }
    }
}

TEST("steady velocities of a wrong unit are refused") {
    for (int wrong = 0; wrong < 2; wrong++) {
        text log = new_text("t,q,v");
        const double *n = test_numbers(7, 2 * 400, -1e-3, 1e-3);
        for (int i = 0; i < 400; i++) {
            const double row[] = {0.02 * i, 0.02 * i + n[2 * i], (wrong ? 1000 : 1) * (1 + n[2 * i + 1])};
            say_row(&log, row, 3);
        }
        if (!wrong) assert_silent(read_text(machine(LINE), log.at));
        if (wrong)
            refuse_text(machine(LINE), log.at, "column v: the rate of q is 0.001", "the unit is wrong");
    }
}

/* A log of two coordinates with random defects: factors, noise, jumps, ends of a sensor's range, a velocity
 * that is 0, swapped velocities. */
static const char *defective(lg_rng *rng) {
    static const double factors[] = {1, 1, -1, 1000, 1e-3, 57.2957795, -57.2957795, 0.3};
    text log = new_text("t,q,v,r,w");
    const double fq = factors[lg_rng_below(rng, LG_COUNT(factors))],
                 fv = factors[lg_rng_below(rng, LG_COUNT(factors))], noise = lg_rng_below(rng, 2) * 0.02,
                 still = lg_rng_below(rng, 6) == 0, steady = lg_rng_below(rng, 4) == 0;
    const uint64_t every = 40 + lg_rng_below(rng, 400), swaps = lg_rng_below(rng, 6);
    const double end = lg_rng_below(rng, 3) == 0 ? lg_rng_uniform_in(rng, 0.5, 1) : 1e300;
    for (uint64_t i = 0; i < 400; i++) {
        const double t = 0.02 * (double)i, jump = i % every == every - 1 ? 40 : 0;
        double row[] = {t, fq * (steady ? 2 * t : 1.5 * sin(t)),
                        still > 0 ? 0 : fv * (steady ? 2 : 1.5 * cos(t)), cos(2 * t), -2 * sin(2 * t)};
        for (int k = 1; k < 3; k++) row[k] += noise * lg_rng_uniform_in(rng, -1, 1);
        row[1 + i % 2] += jump;
        row[2] = fmax(-end, fmin(end, row[2]));
        if (swaps == 0) { /* v and w */
            const double v = row[2];
            row[2] = row[4] * (steady ? 10 : 1), row[4] = v;
        }
        say_row(&log, row, 5);
    }
    return log.at;
}

TEST("with the scales that refusals propose, units and signs of the log are right") {
    lg_rng rng = test_rng(8, 0);
    int proposed = 0;
    for (int round = 0; round < 300; round++) {
        const size_t mark = lg_test_owned();
        const char *path = scratch_path("log.csv"), *kind = round % 2 == 0 ? "line" : "angle";
        char scales[512] = "t: 1";
        write_text_to(path, defective(&rng));
        for (int again = 0;; again++) {
            const char *text_of = test_text("coordinates: [{name: q, kind: %s, velocity: v}, {name: r, kind: "
                                            "line, velocity: w}]\nscale: {%s}\n",
                                            kind, scales);
            lg_error error = {LG_OK, ""};
            lg_logs logs;
            LG_STATUS_OF(lg_logs_read(NULL, machine(text_of), &path, 1, NULL, &logs, &error), status);
            if (status == LG_OK) lg_logs_destroy(&logs);
            const char *scale = status == LG_OK ? NULL : strstr(error.message, "set scale: {");
            if (scale == NULL) break;
            if (again == 2) fail_msg("round %d: again with %s%s", round, text_of, error.message);
            scale = strchr(scale, '{') + 1;
            (void)sprintf(scales + strlen(scales), ", %.*s", (int)strcspn(scale, "}"), scale);
            proposed++;
        }
        lg_test_give_back(mark);
    }
    assert_true(proposed > 50);
}

TEST("swapped columns are refused, and the column that fits is named") {
    refuse_text(
        machine("coordinates: [{name: x, kind: line, velocity: va}, {name: a, kind: angle, velocity: vx}]\n"),
        two_sines(1, 5e-3), "columns x and va do not belong together", "Column vx fits");
    refuse_text(machine("coordinates: [{name: x, kind: line, velocity: va}]\n"), two_sines(1, 0),
                "columns x and va do not belong together", "swapped?");
    /* A velocity that is related, and stands at its largest value in few rows. */
    text log = new_text("t,x,vx,a,va");
    for (int i = 0; i < 2000; i++) {
        const double t = 0.02 * i, v = 3 * cos(3 * t);
        const double row[] = {t, sin(3 * t), i < 14 ? 10 : v + 3 * cos(7.3 * t), cos(2 * t), v};
        say_row(&log, row, 5);
    }
    refuse_text(machine(TWO), log.at, "columns x and vx do not belong together", "Column va fits");
}

/* A body that turns about all axes, and possible errors of its log. */
typedef struct spin {
    bool rates_in_space, scalar_last, conjugate, transpose;
    double factor, noise;
} spin;

static void multiply(const double *a, const double *b, double *out) {
    for (int i = 0; i < 9; i++) {
        const double *row = a + i / 3 * 3, *column = b + i % 3;
        out[i] = row[0] * column[0] + row[1] * column[3] + row[2] * column[6];
    }
}

/* The unit quaternion of a rotation by less than pi. */
static void quaternion_of(const double *R, double *q) {
    double u[3];
    lg_so3_log(R, u);
    const double angle = sqrt(lg_dot3(u, u)), s = angle > 0 ? sin(angle / 2) / angle : 0.5;
    q[0] = cos(angle / 2);
    for (int i = 0; i < 3; i++) q[i + 1] = s * u[i];
}

/* A log of R(t), body rates w(t), and the place p(t) with velocity in the body. */
static const char *spin_log(const spin *s, bool matrix) {
    text log = new_text(matrix ? "t,a,b,c,d,e,f,g,h,i,w1,w2,w3,x,y,z,v1,v2,v3"
                               : "t,qw,qx,qy,qz,w1,w2,w3,x,y,z,v1,v2,v3");
    const double *noise = test_numbers(3, 2000 * 3, -1.7320508, 1.7320508);
    double R[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    for (int i = 0; i < 600; i++) {
        const double t = 0.02 * i, w[] = {2 * sin(1.1 * t), 1.5 * cos(0.7 * t), 1 + sin(0.9 * t)};
        const double place[] = {sin(t), cos(2 * t), 0.3 * t}, rate[] = {cos(t), -2 * sin(2 * t), 0.3};
        double row[32] = {t}, q[4], T[9], turned[3];
        int used = 1;
        for (int k = 0; k < 9; k++) T[k] = s->transpose ? R[k % 3 * 3 + k / 3] : R[k];
        quaternion_of(R, q);
        for (int k = 1; k < 4 && s->conjugate; k++) q[k] = -q[k];
        if (matrix)
            for (int k = 0; k < 9; k++) row[used++] = T[k];
        for (int k = 0; k < 4 && !matrix; k++) row[used++] = q[s->scalar_last ? (k + 1) % 4 : k];
        lg_so3_adjoint(R, w, turned);
        for (int k = 0; k < 3; k++)
            row[used++] = s->factor * (s->rates_in_space ? turned : w)[k] + s->noise * noise[3 * i + k];
        for (int k = 0; k < 3; k++) row[used++] = place[k];
        lg_so3_coadjoint(R, rate, turned);
        for (int k = 0; k < 3; k++) row[used++] = turned[k];
        say_row(&log, row, used);
        for (int k = 0; k < 20; k++) { /* R' = R hat(w) */
            const double m = t + (k + 0.5) * 1e-3;
            const double step[] = {2e-3 * sin(1.1 * m), 1.5e-3 * cos(0.7 * m), 1e-3 * (1 + sin(0.9 * m))};
            double E[9], next[9];
            lg_so3_exp(step, E);
            multiply(R, E, next);
            memcpy(R, next, sizeof R);
        }
    }
    return log.at;
}

#define SPIN9                                                                                                \
    "coordinates: [{name: b, kind: rotation, columns: [a, b, c, d, e, f, g, h, i], velocity: [w1, w2, "      \
    "w3]}]\n"

TEST("rates in space and other orders of quaternions are named") {
    static const struct {
        spin spin;
        const char *words;
    } rows[] = {
        {{.factor = 1, .rates_in_space = true},
         "qw, qx, qy, qz and w1, w2, w3: the rates are in the space frame: give body rates"},
        {{.factor = 1, .rates_in_space = true, .noise = 0.1}, "the rates are in the space frame"},
        {{.factor = 1, .scalar_last = true}, "the quaternion is x, y, z, w: name"},
        {{.factor = 1, .conjugate = true}, "the rotation maps space to body"},
        {{.factor = 1, .scalar_last = true, .rates_in_space = true},
         "x, y, z, w and the rates are in the space frame"},
        {{.factor = 57.3}, "the rate of qw, qx, qy, qz is 0.0174"},
        {{.factor = -1}, "the sign is wrong"},
        {{.factor = 57.3, .rates_in_space = true}, "do not belong together"},
    };
    const lg_machine_file *f = machine(SPIN), *g = machine(SPIN9);
    const spin right = {.factor = 1}, noisy = {.factor = 1, .noise = 0.1}, wild = {.factor = 1, .noise = 2};
    assert_true(read_text(f, spin_log(&right, false))->log.rows == 600);
    assert_true(read_text(f, spin_log(&noisy, false))->log.rows == 600);
    assert_true(read_text(f, spin_log(&wild, false))->log.rows == 600); /* nothing can be compared */
    assert_silent(read_text(g, spin_log(&right, true)));
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        refuse_text(f, spin_log(&rows[i].spin, false), rows[i].words, "");
    const spin transposed = {.factor = 1, .transpose = true}, space = {.factor = 1, .rates_in_space = true};
    refuse_text(g, spin_log(&transposed, true), "the rotation maps space to body", "its inverse");
    refuse_text(g, spin_log(&space, true),
                "a, b, c, d, e, f, g, h, i and w1, w2, w3: the rates are in the space frame", "");
}

TEST("a wrong frame of a pose is named") {
    const char *yaml =
        "coordinates: [{name: h, kind: pose, position: [x, y, z], columns: [qw, qx, qy, qz], velocity: "
        "[v1, v2, v3], rates: [w1, w2, w3], frame: %s}]\n";
    const spin right = {.factor = 1};
    char yaml_text[300];
    (void)sprintf(yaml_text, yaml, "body");
    const lg_logs *logs = read_text(machine(yaml_text), spin_log(&right, false));
    assert_true(logs->log.rows == 600);
    (void)sprintf(yaml_text, yaml, "space");
    refuse_text(machine(yaml_text), spin_log(&right, false), "columns x, y, z and v1, v2, v3",
                "the velocities are in the body frame: set frame: body");
    /* Here v1, v2, v3 are x', y', z', the velocity in space. */
    text log = new_text("t,x,y,z,qw,qx,qy,qz,v1,v2,v3,w1,w2,w3");
    for (int i = 0; i < 200; i++) {
        const double t = 0.02 * i;
        const double row[] = {t,      sin(t), cos(2 * t),      t, cos(t), 0, 0,
                              sin(t), cos(t), -2 * sin(2 * t), 1, 0,      0, 2};
        say_row(&log, row, 14);
    }
    assert_silent(read_text(machine(yaml_text), log.at));
    (void)sprintf(yaml_text, yaml, "body");
    refuse_text(machine(yaml_text), log.at, "the velocities are in the space frame: set frame: space", "");
}

TEST("directions are compared with their angular velocity") {
    const char *yaml = "coordinates: [{name: d, kind: direction, columns: [x, y, z], velocity: [a, b, c]}]\n";
    for (int wrong = 0; wrong < 3; wrong++) {
        text log = new_text("t,x,y,z,a,b,c");
        for (int i = 0; i < 300; i++) {
            const double t = 0.02 * i, p = sin(t), rate = cos(t) * (wrong == 1 ? 100 : 1);
            /* Turns about y; the wrong log claims about z. */
            const double row[] = {t, sin(p), 0, cos(p), 0, wrong == 2 ? 0 : rate, wrong == 2 ? rate : 0};
            say_row(&log, row, 7);
        }
        if (wrong == 0) assert_silent(read_text(machine(yaml), log.at));
        if (wrong == 1)
            refuse_text(machine(yaml), log.at, "the rate of x, y, z is 0.01 times a, b, c",
                        "the unit is wrong");
        if (wrong == 2)
            refuse_text(machine(yaml), log.at, "columns x, y, z and a, b, c do not belong together", "");
    }
}

/* ---- noise ---- */

/* sin t with white noise at steps of 0.01 to 0.03. */
static const lg_logs *noisy_log(double noise, bool irregular) {
    text log = new_text("t,q");
    double t = 0;
    lg_rng rng = test_rng(5, 0);
    for (int i = 0; i < 4000; i++) {
        const double row[] = {t, sin(t) + noise * lg_rng_normal(&rng)};
        say_row(&log, row, 2);
        t += irregular ? lg_rng_uniform_in(&rng, 0.01, 0.03) : 0.02;
    }
    return read_text(machine("columns: {max_step: 0.1}\n" SEEN), log.at);
}

TEST("the noise of a column is estimated") {
    for (int irregular = 0; irregular < 2; irregular++) {
        for (double noise = 1e-4; noise < 1; noise *= 10) {
            const lg_logs *logs = noisy_log(noise, irregular == 1);
            assert_close(logs->columns[1].noise, noise, 0.05, 0);
            assert_true(!logs->columns[1].noise_at_most);
        }
        const lg_logs *smooth = noisy_log(0, irregular == 1);
        assert_true(smooth->columns[1].noise < 1e-6);
    }
    /* A very smooth column with few rows gives only an upper bound. */
    text log = new_text("t,q");
    for (int i = 0; i < 100; i++) {
        const double row[] = {i, sin(0.3 * i)};
        say_row(&log, row, 2);
    }
    const lg_logs *logs = read_text(machine(SEEN), log.at);
    assert_true(logs->columns[1].noise_at_most && logs->columns[1].noise < 1e-3);
    assert_true(isnan(read_text(machine(SEEN), "t,q\n0,1\n1,2\n2,4\n3,1\n4,3\n5,3\n6,1\n")
                          ->columns[1]
                          .noise)); /* only 4 windows */
}

/* ---- HDF5 ---- */

#define ROWS 50

static void write_h5(const char *path, const char *skip, bool wrong_length) {
    static const char *const names[] = {"t", "q", "v", "u", "group of runs"};
    hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    double data[ROWS];
    assert_true(file >= 0);
    for (int c = 0; c < 5; c++) {
        const hsize_t rows = wrong_length && c == 2 ? ROWS - 1 : ROWS;
        for (int i = 0; i < ROWS; i++) {
            const double t = 0.1 * (i % 25), all[] = {t, sin(t), cos(t), i, i / 25};
            data[i] = all[c];
        }
        if (c == 1) data[3] = NAN;
        if (strcmp(skip, names[c]) == 0) continue;
        put_dataset(file, names[c], c == 4 ? H5T_STD_I32LE : H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &rows,
                    c == 1, data);
    }
    assert_true(H5Fclose(file) >= 0);
}

static const char h5_yaml[] = "columns: {run: group of runs}\n" LINE "inputs: {columns: [u]}\n";

TEST("HDF5 with one data set per column is read") {
    const char *path = scratch_path("log.h5");
    static const size_t first[] = {0, 25, 50};
    write_h5(path, "", false);
    const lg_logs *logs = read_all(machine(h5_yaml), &path, 1, NULL);
    assert_parts(logs, 2, first);
    assert_true(isnan(logs->q[3]) && logs->q[30] == sin(0.1 * 5) && logs->u[4 * 30] == 30 &&
                logs->v[26] == cos(0.1));
    assert_true(logs->runs == 2 && logs->columns[2].missing == 1);
    assert_silent(logs);
}

static lg_status read_h5(const lg_context *context, const char *path, const lg_read_options *options,
                         lg_error *error) {
    lg_logs *logs = TEST_ARRAY(lg_logs, 1);
    lg_log_options chosen;
    lg_log_options_init(&chosen);
    if (options != NULL) chosen.read = *options;
    const lg_status status = lg_logs_read(context, machine(h5_yaml), &path, 1, &chosen, logs, error);
    if (status == LG_OK) lg_logs_destroy(logs);
    return status;
}

TEST("columns of a log in HDF5 may be (rows), (rows, 1) or (1, rows), but no matrix and no single number") {
    const char *path = scratch_path("log.h5");
    double data[ROWS];
    for (int i = 0; i < ROWS; i++) data[i] = 3 + i;
    for (hsize_t k = 0; k < 2; k++) {
        write_h5(path, "", false);
        replace_dataset(path, "u", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2,
                        (hsize_t[]){k == 0 ? 1 : ROWS, k == 0 ? ROWS : 1}, data);
        const lg_logs *logs = read_all(machine(h5_yaml), &path, 1, NULL);
        assert_true(logs->rows_read == ROWS && logs->u[4 * 30] == 33 && logs->u[4 * 24] == 27);
    }
    replace_dataset(path, "u", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, (hsize_t[]){ROWS / 2, 2}, data);
    assert_refused(read_h5, path, LG_FORMAT, "there is no column 'u'; the columns are: ", "u0, u1");
    replace_dataset(path, "u", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, (hsize_t[]){1, 1}, data);
    assert_refused(read_h5, path, LG_FORMAT, "/u: has 1 rows, but /", "");
}

TEST("columns of a log in HDF5 may be in groups, and runs may be texts") {
    static const char yaml[] = "columns: {run: group/run}\n"
                               "coordinates:\n  - {name: q, kind: line, velocity: motor/v}\n"
                               "inputs: {columns: [u]}\n";
    const char *path = scratch_path("log.h5");
    char words[ROWS][4];
    double data[ROWS];
    for (int i = 0; i < ROWS; i++) {
        data[i] = cos(0.1 * (i % 25));
        (void)snprintf(words[i], sizeof words[i], "r%d", i / 25);
    }
    write_h5(path, "v", false);
    hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT), word = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(word, sizeof *words) >= 0);
    assert_true(H5Gclose(H5Gcreate2(file, "group", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)) >= 0 &&
                H5Gclose(H5Gcreate2(file, "motor", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)) >= 0);
    put_dataset(file, "motor/v", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, (hsize_t[]){ROWS}, false, data);
    put_dataset(file, "group/run", word, word, 2, (hsize_t[]){1, ROWS}, false, words);
    assert_true(H5Tclose(word) >= 0 && H5Fclose(file) >= 0);
    static const size_t first[] = {0, 25, 50};
    const lg_logs *logs = read_all(machine(yaml), &path, 1, NULL);
    assert_parts(logs, 2, first);
    assert_true(logs->runs == 2 && logs->v[30] == cos(0.1 * 5));
}

TEST("HDF5 that is not a log is refused") {
    const char *path = scratch_path("log.h5");
    const hsize_t rows = ROWS, table[] = {ROWS, 2};
    double data[2 * ROWS] = {0};
    write_h5(path, "v", false);
    assert_refused(read_h5, path, LG_FORMAT, "there is no column 'v'", "group of runs, q, t, u");
    write_h5(path, "", true);
    assert_refused(read_h5, path, LG_FORMAT, "/v: has 49 rows, but /u has 50", "");
    write_h5(path, "v", false);
    replace_dataset(path, "v", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 2, table, data);
    assert_refused(read_h5, path, LG_FORMAT, "there is no column 'v'; the columns are: ", "t, u, v0, v1");
    write_h5(path, "v", false);
    data[7] = INFINITY;
    replace_dataset(path, "v", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &rows, data);
    assert_refused(read_h5, path, LG_FORMAT, "row 8: column v: the value is infinite", "");
    write_h5(path, "v", false);
    replace_dataset(path, "v", H5T_C_S1, H5T_C_S1, 1, &rows, data);
    assert_refused(read_h5, path, LG_FORMAT, "/v: does not hold numbers", "");
    replace_dataset(path, "v", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 0, NULL, data);
    assert_refused(read_h5, path, LG_FORMAT, "there is no column 'v'", "t, u");
    write_h5(path, "group of runs", false);
    data[7] = NAN;
    replace_dataset(path, "group of runs", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &rows, data);
    assert_refused(read_h5, path, LG_FORMAT, "row 8: column group of runs: the row names no run", "");
    refuse_paths(machine(LINE), &path, 1, LG_FORMAT, "row 26: column t: time does not increase", "");
    write_h5(path, "t", false);
    data[7] = 0;
    replace_dataset(path, "t", H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, 1, &rows, data);
    assert_refused(read_h5, path, LG_FORMAT, "row 2: column t: time does not increase", "");
    write_h5(path, "", false);
    survive_changed_bytes(read_h5, path, 60);
}

/* ---- memory ---- */

TEST("every allocation may fail") {
    const char *path = scratch_path("log.csv");
    write_text_to(path, two_sines(1, 5e-3));
    const lg_machine_file *f = machine(TWO "inputs: {columns: [u], hold: cubic}\n");
    text log = new_text("t,x,vx,a,va,u");
    for (int i = 0; i < 40; i++) {
        const double row[] = {0.1 * i, 1, 0, (i % 7), 0, 5};
        say_row(&log, row, 6);
    }
    write_text_to(path, log.at);
    lg_log_options options;
    lg_log_options_init(&options);
    options.consistency = false;
    EVERY_ALLOCATION_FAILS(context, 15, {
        lg_logs *logs = TEST_ARRAY(lg_logs, 1);
        status = lg_logs_read(context, f, &path, 1, &options, logs, NULL);
        if (status == LG_OK) {
            assert_true(logs->warning_count >= 2);
            lg_logs_destroy(logs);
        }
    });
    const char *h5 = scratch_path("log.h5");
    write_h5(h5, "", false);
    assert_true(fail_every_reading(read_h5, h5) > 15);
}

TEST("calls without a machine, paths or a place for the logs are refused") {
    const char *const paths[] = {"log.csv", NULL};
    const lg_machine_file *f = machine(LINE);
    lg_logs logs;
    const struct {
        const lg_machine_file *file;
        const char *const *paths;
        size_t count;
        lg_logs *out;
    } calls[] = {{NULL, paths, 1, &logs}, {f, NULL, 1, &logs},  {f, paths, 1, NULL},
                 {f, paths, 2, &logs},    {f, paths, 0, &logs}, {f, paths, (size_t)1 << 33, &logs}};
    for (size_t i = 0; i < LG_COUNT(calls); i++)
        assert_status(
            lg_logs_read(NULL, calls[i].file, calls[i].paths, calls[i].count, NULL, calls[i].out, NULL),
            LG_INVALID_ARGUMENT);
    lg_logs_destroy(NULL);
    lg_recipe_release(&lg_recipe_machine_model, NULL);
    lg_machine none = {.coordinate_count = 0};
    const double value = 1;
    assert_status(lg_machine_set_parameter(&none, "mass", 1, &value, NULL, NULL), LG_INVALID_ARGUMENT);
    assert_status(lg_machine_bound_parameter(&none, "mass", 0, 0, 1, 1, NULL), LG_INVALID_ARGUMENT);
}

TEST("CSV with changed bytes is read or refused") {
    const char *path = scratch_path("log.csv");
    write_text_to(path, lossy);
    const lg_machine_file *f = machine(LINE "inputs: {columns: [u]}\n");
    size_t size;
    unsigned char *data = read_bytes_of(path, &size);
    for (size_t i = 0; i < size; i++) {
        const unsigned char before = data[i];
        for (int k = 0; k < 3; k++) {
            lg_logs *logs = TEST_ARRAY(lg_logs, 1);
            data[i] = (unsigned char)(before ^ (k == 0 ? 0xff : k == 1 ? 1 : 0x80));
            write_bytes_to(path, data, size);
            if (lg_logs_read(NULL, f, &path, 1, NULL, logs, NULL) == LG_OK) lg_logs_destroy(logs);
        }
        data[i] = before;
    }
}

/* lg-identify check: what it reports of logs, what it refuses, and what causes a warning. Wrong command lines
 * are in test_refused.
 * ctest-labels: slow apps/lg-identify src/machine */
#include "files/h5.h"
#include "identify_support.h"

/* ---- a log: x = sin t, y = .5 cos 3t, theta = .8 sin 2t, an attitude turning about e3 by t ---- */

enum { ROWS = 200, COLUMNS = 14 };
#define DT 0.02
static const char *const names[COLUMNS] = {"t",  "x",  "vx", "y",  "vy", "theta", "w",
                                           "qw", "qx", "qy", "qz", "wx", "wy",    "wz"};
enum { T, X, VX, Y, VY, THETA, W, QW, QX, QY, QZ, WX, WY, WZ };

typedef struct sheet {
    double cells[ROWS][COLUMNS], u[ROWS];
} sheet;

static double noise(size_t i) { /* pseudo-random numbers from -1 to 1 */
    const double x = sin(12.9898 * (double)i) * 43758.5453;
    return sqrt(12) * (x - floor(x) - 0.5);
}

static sheet *good_sheet(void) {
    sheet *s = TEST_ARRAY(sheet, 1);
    for (size_t i = 0; i < ROWS; i++) {
        const double t = DT * (double)i;
        double *c = s->cells[i];
        c[T] = t, c[X] = sin(t), c[VX] = cos(t), c[Y] = 0.5 * cos(3 * t), c[VY] = -1.5 * sin(3 * t);
        c[THETA] = 0.8 * sin(2 * t), c[W] = 1.6 * cos(2 * t);
        c[QW] = cos(t / 2), c[QZ] = sin(t / 2), c[WZ] = 1;
        s->u[i] = sin(7 * t) + 0.3 * sin(11 * t * t);
    }
    return s;
}

static void write_sheet(const char *name, const sheet *s) {
    enum { SIZE = 1 << 18 };
    char *text = lg_test_memory(SIZE);
    size_t used = 0;
    for (int k = 0; k < COLUMNS; k++) used += (size_t)snprintf(text + used, SIZE - used, "%s,", names[k]);
    used += (size_t)snprintf(text + used, SIZE - used, "u\n");
    for (size_t i = 0; i < ROWS; i++) {
        for (int k = 0; k < COLUMNS; k++)
            used += (size_t)snprintf(text + used, SIZE - used, isnan(s->cells[i][k]) ? "," : "%.12g,",
                                     s->cells[i][k]);
        used += (size_t)snprintf(text + used, SIZE - used, "%.12g\n", s->u[i]);
    }
    cli_write(name, text);
}

static const char machine[] =
    "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
    "  - {name: y, kind: line, velocity: vy}\n  - {name: theta, kind: angle, velocity: w}\n"
    "  - {name: body, kind: rotation, columns: [qw, qx, qy, qz], velocity: [wx, wy, wz]}\n"
    "inputs: {columns: [u]}\nmass: diagonal\ninput_map: {kind: known, values: [[1],[0],[0],[0],[0],[0]]}\n";

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("machine.yaml", machine);
    cli_write("swapped.yaml", "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: vy}\n"
                              "  - {name: y, kind: line, velocity: vx}\ninputs: {columns: [u]}\n");
    return 0;
}

/* ---- reports ---- */

TEST("check reports files, rows, steps, gaps and the range of each column") {
    sheet *s = good_sheet();
    s->cells[50][X] = (double)NAN;
    /* a gap; the motion continues as if there were none */
    for (size_t i = 100; i < ROWS; i++) s->cells[i][T] += 5 * DT;
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv", "files 1, runs 1, rows 200, parts 2, gaps 1, delay 0");
    assert_close(json_number(result.out, "dt_median"), DT, 1e-9, 0);
    assert_close(json_number(result.out, "dt_max"), 6 * DT, 1e-9, 0);
    const char *columns = json_find(result.out, "columns");
    json_expect(json_find(columns, "x"), "missing 1, noise <1e-6, noise_at_most true");
    assert_close(json_number(json_find(columns, "theta"), "max"), 0.8, 1e-3, 0);
    assert_close(json_number(json_find(columns, "theta"), "min"), -0.8, 1e-3, 0);
    json_expect(json_find(columns, "u"), "min <-1, max >1");
    assert_null(json_find(columns, "t"));
    json_expect(result.out, "parts 2");
    cli_expect(identify, "check machine.yaml log.csv", 0, " 2  without a gap");
    assert_says(result.out, "column ");
}

TEST("check estimates the noise of a column, and the residual of positions against velocities") {
    sheet *s = good_sheet();
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv", "warnings []");
    const char *motion = json_find(result.out, "kinematics");
    json_expect(motion, "x <1e-3, y <1e-2, theta <1e-2, body <1e-3");
    for (size_t i = 0; i < ROWS; i++) s->cells[i][X] += 0.01 * noise(i);
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv", "files 1");
    assert_close(json_number(json_find(json_find(result.out, "columns"), "x"), "noise"), 0.01, 0.2, 0);
    /* a step is .02 long; the difference of two numbers with errors of .01 */
    assert_close(json_number(json_find(result.out, "kinematics"), "x"), sqrt(2) * 0.01 / (0.02 * 0.71), 0.5,
                 0);
}

TEST("a log may have many short runs, also more rows than are sampled") {
    enum { RUNS = 26000, EACH = 6, SIZE = 1 << 23 };
    char *text = lg_test_memory(SIZE);
    size_t used = (size_t)snprintf(text, SIZE, "t,run,x,vx\n");
    for (size_t i = 0; i < (size_t)RUNS * EACH; i++) {
        const double t = 0.01 * (double)(i % EACH), phase = (double)(i / EACH);
        used += (size_t)snprintf(text + used, SIZE - used, "%g,%zu,%.9g,%.9g\n", t, i / EACH, sin(t + phase),
                                 cos(t + phase));
    }
    cli_write("runs.csv", text);
    cli_write("runs.yaml",
              "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
              "mass: diagonal\n");
    cli_expect(identify, "check runs.yaml runs.csv --json", 0, "156000");
}

TEST("check draws every column of the first run") {
    write_sheet("log.csv", good_sheet());
    cli_json(identify, "check machine.yaml log.csv --plot log.svg", "rows 200");
    char text[16384];
    (void)cli_read("log.dat", text, sizeof text);
    for (int k = 1; k < COLUMNS; k++) assert_says(text, test_text("\n=%s\n", names[k]));
    assert_true(cli_exists("log.svg") && cli_exists("log.gp"));
}

/* ---- logs that are refused: exit code 3; the message has file, column and remedy; fit refuses them too
 * ---- */

static void expect_hopeless(const char *yaml, const sheet *s, const char *const *words) {
    static const char *const commands[] = {"check %s bad.csv", "fit %s bad.csv --out never.h5"};
    write_sheet("bad.csv", s);
    for (size_t i = 0; i < LG_COUNT(commands); i++) {
        cli_expect(identify, test_text(commands[i], yaml), 3, "bad.csv: ");
        for (const char *const *word = words; *word != NULL; word++) assert_says(result.err, *word);
        assert_string_equal(result.out, "");
        assert_false(cli_exists("never.h5"));
    }
}
#define WORDS(...)                                                                                           \
    (const char *const[]) {                                                                                  \
        __VA_ARGS__, NULL                                                                                    \
    }

TEST("swapped columns are refused, and the message names the column that fits") {
    expect_hopeless("swapped.yaml", good_sheet(), WORDS("columns x and vy", "Column vx fits"));
}

TEST("degrees and other wrong units are refused, and the message gives a scale") {
    sheet *s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->cells[i][THETA] *= 57.295779513;
    expect_hopeless("machine.yaml", s, WORDS("theta", "in degrees, set scale: {theta: 0.0174"));
    s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->cells[i][X] *= 1000;
    expect_hopeless("machine.yaml", s, WORDS("the rate of x", "scale: {vx: 1000", "or {x: 0.00"));
    s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->cells[i][T] *= 1000;
    expect_hopeless("machine.yaml", s, WORDS("scale: ", "if all coordinates show this: {t: 0.001"));
}

TEST("outliers are left out, and saturated sensors are reported as such, and not as a wrong unit") {
    sheet *s = good_sheet();
    s->cells[77][X] += 50, s->cells[120][X] += 50;
    write_sheet("bad.csv", s);
    cli_json(identify, "check machine.yaml bad.csv", "files 1");
    json_expect(json_find(json_find(result.out, "columns"), "x"), "missing 0, outliers 2, max <3");
    assert_says(result.err, "line 79: column x: 5");
    assert_says(result.err, "is an outlier");
    s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->cells[i][W] = fmax(-0.5, fmin(0.5, s->cells[i][W]));
    expect_hopeless("machine.yaml", s, WORDS("column w: is at its smallest or largest value, -0.5 and 0.5"));
}

TEST("a time that jumps back is refused, with the line") {
    sheet *s = good_sheet();
    for (size_t i = 120; i < ROWS; i++) s->cells[i][T] -= 1.5;
    expect_hopeless("machine.yaml", s, WORDS("line 122", "column t", "time does not increase", "run"));
}

TEST("a column without a value is refused") {
    sheet *s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->cells[i][VY] = (double)NAN;
    expect_hopeless("machine.yaml", s, WORDS("column vy", "no value"));
}

TEST("quaternions that are not of length 1 are refused with their line") {
    sheet *s = good_sheet();
    for (int k = QW; k <= QZ; k++) s->cells[77][k] *= 1.3;
    expect_hopeless("machine.yaml", s, WORDS("line 79", "qw, qx, qy, qz", "length 1.3"));
}

/* One fault: changes a good sheet; the message must contain `word`. */
typedef struct fault {
    void (*make)(sheet *s);
    const char *word;
} fault;

static void other_sign(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->cells[i][VX] *= -1;
}
static void unrelated(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->cells[i][VX] = 2 * sin(9 * s->cells[i][T]);
}
static void clipped(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->cells[i][W] = fmax(-0.5, fmin(0.5, s->cells[i][W]));
}
static void degrees(sheet *s) {
    for (size_t i = 0; i < ROWS; i++)
        s->cells[i][THETA] = remainder(57.295779513 * 2 * (double)i, 360), s->cells[i][W] = 2 / DT;
}
static void backwards(sheet *s) {
    s->cells[120][T] = -1;
}
static void no_velocity(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->cells[i][VY] = (double)NAN;
}
static void no_input(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = (double)NAN;
}
static void never_complete(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->cells[i][i % 2 == 0 ? X : Y] = (double)NAN;
}
static void too_long(sheet *s) {
    for (int k = QW; k <= QZ; k++) s->cells[77][k] *= 1.3;
}
static void late_rates(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->cells[i][WX] = 1, s->cells[i][WZ] = 0;
}

static size_t times(const char *text, const char *word) {
    size_t count = 0;
    for (const char *at = strstr(text, word); at != NULL; at = strstr(at + 1, word)) count++;
    return count;
}

TEST("with several files the message names only the file with the fault, once") {
    static const fault faults[] = {
        {other_sign, "the sign is wrong"},    {unrelated, "do not belong together"},
        {clipped, "is at its smallest"},      {degrees, "scale: {theta: 0.0174"},
        {backwards, "line 122: column t"},    {no_velocity, "column vy: has no value"},
        {no_input, "column u: has no value"}, {never_complete, "no row is complete"},
        {too_long, "line 79: columns qw"},    {late_rates, "columns qw, qx, qy, qz"}};
    static const char *const files[] = {"first.csv", "second.csv", "third.csv"};
    static const char *const lines[] = {
        "check machine.yaml first.csv second.csv third.csv",
        "fit machine.yaml first.csv second.csv --validation third.csv --out never.h5"};
    for (size_t i = 0; i < LG_COUNT(faults); i++) {
        const size_t bad = i % LG_COUNT(files);
        for (size_t f = 0; f < LG_COUNT(files); f++) {
            sheet *s = good_sheet();
            if (f == bad) faults[i].make(s);
            write_sheet(files[f], s);
        }
        for (size_t k = 0; k < LG_COUNT(lines); k++) {
            cli_expect(identify, lines[k], 3, files[bad]);
            assert_says(result.err, faults[i].word);
            for (size_t f = 0; f < LG_COUNT(files); f++)
                assert_int_equal(times(result.err, files[f]), f == bad);
        }
    }
    write_sheet("first.csv", good_sheet());
    cli_write("second.csv", "t,x\n1,2\n");
    cli_expect(identify, "check machine.yaml first.csv second.csv", 3, "second.csv: line 1");
    assert_null(strstr(result.err, "first.csv"));
    cli_expect(identify, "check machine.yaml first.csv none.csv", 3, "none.csv");
    assert_null(strstr(result.err, "first.csv"));
}

TEST("a whole number that no double equals is refused; a time in nanoseconds may be rounded") {
    static const char *const columns[] = {"t", "x", "vx", "u"};
    char text[4096] = "t,x,vx,u\n";
    cli_write("line.yaml", "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
                           "inputs: {columns: [u]}\nscale: {t: 1e-9}\n");
    hid_t file = H5Fcreate(cli_at("line.h5"), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    int64_t values[4][40];
    for (int i = 0; i < 40; i++) {
        const int64_t row[4] = {1700000000123456789 + 20000000 * (int64_t)i, i * i, 100 * i, i % 3};
        (void)snprintf(text + strlen(text), sizeof text - strlen(text), "%lld,%lld,%lld,%lld\n",
                       (long long)row[0], (long long)row[1], (long long)row[2], (long long)row[3]);
        for (int c = 0; c < 4; c++) values[c][i] = row[c];
    }
    cli_write("line.csv", text);
    for (int c = 0; c < 4; c++) {
        const hsize_t rows[1] = {40};
        hid_t space = H5Screate_simple(1, rows, NULL);
        hid_t set = H5Dcreate2(file, columns[c], H5T_STD_I64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
        assert_true(H5Dwrite(set, H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, values[c]) >= 0);
        assert_true(H5Dclose(set) >= 0 && H5Sclose(space) >= 0);
    }
    assert_true(H5Fclose(file) >= 0);
    for (int k = 0; k < 2; k++) {
        cli_json(identify, test_text("check line.yaml line.%s", k == 0 ? "csv" : "h5"), "rows 40, gaps 0");
        assert_close(json_number(result.out, "dt_median"), DT, 1e-4, 0);
    }
    *strstr(text, "400,2000,") = '\0';
    cli_write("large.csv", test_text("%s9007199254740993,2000,2\n", text));
    cli_expect(identify, "check line.yaml large.csv", 3,
               "large.csv: line 22: column x: 9007199254740993 is beyond 2^53");
}

TEST("a file with no usable rows is reported, and the others are read") {
    sheet *s = good_sheet();
    write_sheet("first.csv", s);
    for (size_t i = 0; i < ROWS; i++) s->cells[i][T] *= 10;
    write_sheet("second.csv", s);
    cli_write("short.yaml", "columns: {time: t, max_step: 0.1}\ncoordinates:\n  - {name: x, kind: line}\n"
                            "measured: positions\nmass: {kind: known, values: [1]}\n");
    cli_json(identify, "check short.yaml first.csv second.csv", "rows_kept 200");
    assert_says(result.err, "second.csv: no row of this file is used");
    assert_null(strstr(result.err, "first.csv: no row"));
}

TEST("the same warning appears only once, on standard error and in JSON") {
    sheet *s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->u[i] = 2;
    s->cells[50][T] = (double)NAN;
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv log.csv log.csv", "files 3");
    static const char *const sentences[] = {"log.csv: 1 rows without a time were left out",
                                            "column u: the input is always 2"};
    for (size_t i = 0; i < LG_COUNT(sentences); i++) {
        assert_int_equal(times(result.err, sentences[i]), 1);
        assert_int_equal(times(result.out, sentences[i]), 1);
    }
}

/* Two angles a and b, of which each moves slowly and vibrates fast; the rates show the slow motion alone. */
static void write_vibrating(const char *name, size_t rows, double step, double size, double sd) {
    const size_t room = 120 * (rows + 1);
    char *text = TEST_ARRAY(char, room);
    size_t used = (size_t)snprintf(text, room, "t,a,wa,b,wb\n");
    lg_rng rng = test_rng(rows, 1);
    for (size_t i = 0; i < rows; i++) {
        const double t = step * (double)i;
        used +=
            (size_t)snprintf(text + used, room - used, "%.12g,%.12g,%.12g,%.12g,%.12g\n", t,
                             sin(t) + 0.3 * sin(0.31 * t) + size * sin(141 * t) + sd * lg_rng_normal(&rng),
                             cos(t) + 0.093 * cos(0.31 * t) + sd * lg_rng_normal(&rng),
                             0.7 * cos(0.83 * t) + size * sin(157 * t + 1) + sd * lg_rng_normal(&rng),
                             -0.581 * sin(0.83 * t) + sd * lg_rng_normal(&rng));
    }
    cli_write(name, text);
}

/* A machine of the angles a and b, whose rates are in columns wa and wb. */
static void write_angles(const char *name, const char *wa, const char *wb, const char *scale) {
    cli_write(name, test_text("columns: {time: t}\n%scoordinates:\n"
                              "  - {name: a, kind: angle, velocity: %s}\n"
                              "  - {name: b, kind: angle, velocity: %s}\nmass: diagonal\n",
                              scale, wa, wb));
}

TEST("an angle that vibrates fits its rate over many rows; swapped rates and wrong units are still found") {
    static const char *const machines[] = {"right.yaml", "crossed.yaml", "negative.yaml", "doubled.yaml"};
    static const char *const rates[][2] = {{"wa", "wb"}, {"wb", "wa"}, {"wa", "wb"}, {"wa", "wb"}};
    static const char *const scales[] = {"", "", "scale: {wb: -1}\n", "scale: {wb: 2}\n"};
    static const struct {
        size_t rows;
        double step, size, sd;
    } logs[] = {{10000, 0.002, 0.03, 0},
                {20000, 0.001, 0.1, 0.01},
                {2000, 0.013, 0.05, 0.001},
                {4000, 0.005, 0.03, 0.02},
                {4000, 0.001, 0.2, 0.01}};
    for (size_t k = 0; k < LG_COUNT(machines); k++)
        write_angles(machines[k], rates[k][0], rates[k][1], scales[k]);
    for (size_t i = 0; i < LG_COUNT(logs); i++) {
        write_vibrating("shaken.csv", logs[i].rows, logs[i].step, logs[i].size, logs[i].sd);
        cli_json(identify, "check right.yaml shaken.csv", "files 1");
        if (i == 0) assert_says(result.err, "one of them vibrates or is noisy");
        for (size_t k = 1; k < LG_COUNT(machines); k++) {
            if (i > 0 && k != 1 + i % 3) continue; /* every wrong machine with the first log */
            cli_run_limited(identify, test_text("check %s shaken.csv", machines[k]), 0);
            if (result.code != 3) fail_msg("log %zu: %s is accepted", i, machines[k]);
        }
    }
}

/* Angles a and b with a slow motion `common` times the same, a motion of each, and fast vibrations; the rates
 * show the slow motions alone, with noise sd. */
static void write_common(const char *name, double common, double period, double sd, uint64_t seed) {
    enum { COUNT = 4000, ROOM = 120 * (COUNT + 1) };
    char *text = TEST_ARRAY(char, ROOM);
    size_t used = (size_t)snprintf(text, ROOM, "t,a,wa,b,wb\n");
    lg_rng rng = test_rng(seed, 2);
    for (size_t i = 0; i < COUNT; i++) {
        const double t = 1e-3 * (double)i, trend = common * sin(1.1 * t), rate = common * 1.1 * cos(1.1 * t),
                     f = 6.2832 / period;
        used += (size_t)snprintf(text + used, ROOM - used, "%.12g,%.12g,%.12g,%.12g,%.12g\n", t,
                                 trend + 0.1 * sin(f * t) + 0.03 * sin(565 * t),
                                 rate + 0.1 * f * cos(f * t) + sd * lg_rng_normal(&rng),
                                 trend + 0.1 * sin(1.4 * f * t + 1) + 0.03 * sin(480 * t),
                                 rate + 0.14 * f * cos(1.4 * f * t + 1) + sd * lg_rng_normal(&rng));
    }
    cli_write(name, text);
}

TEST(
    "columns that agree over long spans only are accepted, and a slow motion that two coordinates share does "
    "not hide that their rates are swapped") {
    static const double commons[] = {0, 0.5, 2}, periods[] = {0.7, 2.1}, noises[] = {0.01, 0.3};
    write_angles("right.yaml", "wa", "wb", "");
    write_angles("crossed.yaml", "wb", "wa", "");
    for (size_t i = 0; i < 6; i++) { /* all pairs of the three values */
        write_common("shared.csv", commons[i % 3], periods[i % 2], noises[i / 3], i);
        cli_run_limited(identify, "check right.yaml shared.csv", 0);
        if (result.code != 0) fail_msg("log %zu: right columns: %s", i, result.err);
        cli_run_limited(identify, "check crossed.yaml shared.csv", 0);
        if (result.code != 3) fail_msg("log %zu: crossed columns are accepted: %s", i, result.err);
        if (i % 3 > 0) assert_says(result.err, "Column w");
    }
}

/* ---- logs that leave something undetermined: a warning ---- */

TEST("constant inputs, feedback, coordinates that never move and a free scale cause warnings") {
    sheet *s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->u[i] = 2;
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv", "files 1");
    assert_says(result.err, "column u: the input is always 2");
    for (size_t i = 0; i < ROWS; i++) s->u[i] = 3 * s->cells[i][Y] - 0.5 * s->cells[i][VX] + 1;
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv", "files 1");
    assert_says(result.err, "column u: the input is a linear function of the state");
    s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->cells[i][Y] = 4, s->cells[i][VY] = 0;
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv", "files 1");
    assert_says(result.err, "coordinate y never moves");
    cli_write("free.yaml", "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
                           "inputs: {columns: [u]}\n");
    cli_json(identify, "check free.yaml log.csv", "files 1");
    assert_says(result.err, "scale of the forces");
}

/* Changes the input of a log without changing its motion. */
typedef struct input_case {
    void (*make)(sheet *s);
    const char *told; /* what the warning says; NULL: no warning */
} input_case;

static void one_jump(sheet *s) {
    s->u[70] = 10966;
}
static void two_rows(sheet *s) {
    s->u[70] = 10966, s->u[71] = 9000;
}
static void several(sheet *s) {
    s->u[20] = -400, s->u[70] = 500, s->u[150] = 10966;
}
static void first_row(sheet *s) {
    s->u[0] = 10966;
}
static void last_row(sheet *s) {
    s->u[ROWS - 1] = -10966;
}
static void beside_offset(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = 0.26 + 0.01 * s->u[i];
    s->u[70] = 0.9;
}
static void of_constant(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = 6;
    s->u[70] = 10966;
}
static void of_steps(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = i / 20 % 2 == 0 ? 0 : 10;
    s->u[70] = 10966;
}
static void nothing(sheet *s) {
    (void)s;
}
static void steps(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = i / 20 % 2 == 0 ? 0 : 10;
}
static void one_step(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = i < 40 ? 0 : 10;
}
static void noisy_step(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = (i < 1 ? 0 : 10) + 1e-3 * noise(i);
}
static void late_step(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = i + 4 < ROWS ? 0 : 10;
}
static void short_step(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = (i >= 50 && i < 53 ? 10 : 0) + 1e-3 * noise(i);
}
static void pulses(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = i % 17 == 0 ? 10 : 0;
}
static void hammer(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = i == 30 ? 50 : 0;
}
static void every_row(sheet *s) {
    for (size_t i = 0; i < ROWS; i++) s->u[i] = noise(i) > 0 ? 3 : -3;
}

TEST("an input that jumps and returns is reported with file, line and column; steps, pulses and noise "
     "are not") {
    static const input_case cases[] = {{one_jump, "line 72: column u: jumps to 10966"},
                                       {two_rows, "line 72: column u: jumps to 10966"},
                                       {several, "the first of 3 such"},
                                       {first_row, "line 2: column u: jumps to 10966"},
                                       {last_row, "line 201: column u: jumps to -10966"},
                                       {beside_offset, "line 72: column u: jumps to 0.9"},
                                       {of_constant, "line 72: column u: jumps to 10966"},
                                       {of_steps, "line 72: column u: jumps to 10966"},
                                       {nothing, NULL},
                                       {steps, NULL},
                                       {one_step, NULL},
                                       {noisy_step, NULL},
                                       {late_step, NULL},
                                       {short_step, NULL},
                                       {pulses, NULL},
                                       {hammer, NULL},
                                       {every_row, NULL}};
    static const double units[] = {1e-9, 1e9};
    cli_write("input.yaml", "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
                            "inputs: {columns: [u]}\npotential: {kind: quadratic, of: x}\n");
    write_sheet("first.csv", good_sheet());
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        for (size_t k = 0; k < 2; k++) {
            sheet *s = good_sheet();
            cases[i].make(s);
            for (size_t row = 0; row < ROWS && k > 0; row++) s->u[row] *= units[i % 2];
            write_sheet("second.csv", s);
            cli_json(identify, "check input.yaml first.csv second.csv", "files 2");
            assert_int_equal(strstr(result.err, "such jumps") != NULL, cases[i].told != NULL);
            if (cases[i].told != NULL && k == 0) assert_says(result.err, cases[i].told);
            if (cases[i].told != NULL) assert_says(result.err, "second.csv: line ");
        }
    sheet *s = good_sheet();
    one_jump(s);
    write_sheet("second.csv", s);
    cli_json(identify, "fit input.yaml first.csv second.csv --out m.h5 --epochs 2", "loss >0");
    assert_int_equal(times(result.err, "second.csv: line 72: column u: jumps to 10966"), 1);
    cli_write("place.yaml",
              "columns: {time: t}\nmeasured: positions\ncoordinates:\n  - {name: x, kind: line}\n"
              "mass: {kind: known, values: [1]}\n");
    s = good_sheet();
    s->cells[70][X] = 40;
    write_sheet("second.csv", s);
    cli_json(identify, "check place.yaml first.csv second.csv", "files 2");
    assert_says(result.err, "second.csv: line 72: column x: 40 is an outlier");
}

/* Copies a log of a cart with a pole, and adds `off` to vx in row `at`. */
static void copy_with_spike(const char *from, const char *to, size_t at, double off) {
    enum { SIZE = 1 << 20 };
    char *text = lg_test_memory(SIZE), *copy = lg_test_memory(SIZE), *save = NULL;
    size_t used = 0, row = 0;
    (void)cli_read(from, text, SIZE);
    for (char *line = strtok_r(text, "\n", &save); line != NULL; line = strtok_r(NULL, "\n", &save), row++) {
        char *cell = line;
        for (int k = 0; k < 3; k++) cell = strchr(cell, ',') + 1; /* t, run, x, vx, ... */
        char *rest = strchr(cell, ',');
        if (row == at + 1)
            used += (size_t)snprintf(copy + used, SIZE - used, "%.*s%.17g%s\n", (int)(cell - line), line,
                                     strtod(cell, NULL) + off, rest);
        else
            used += (size_t)snprintf(copy + used, SIZE - used, "%s\n", line);
    }
    cli_write(to, copy);
}

TEST("steps of an input in logs without noise are no outliers; a spike next to such a step is one") {
    enum { SEEDS = 3, ROOM = 4096 };
    static double u[ROOM];
    cli_write("cart.yaml",
              "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
              "  - {name: theta, kind: angle, velocity: vtheta}\ninputs: {columns: [u]}\n"
              "system: cart-pole\nparameters: {cart: 1, pole: 0.3, length: 0.5, gravity: 9.81}\n"
              "damping: {kind: known, values: [0.1, 0.02]}\n"
              "input_map: {kind: known, values: [[1], [0]]}\n");
    for (int seed = 1; seed <= SEEDS; seed++) {
        cli_forget("cart.csv");
        cli_run(identify,
                "generate cart.yaml --inputs steps --amplitude 5 --t-end 5 --runs 4 --seed %d --out cart.csv",
                seed);
        cli_json(identify, "check cart.yaml cart.csv", "runs 4");
        assert_null(strstr(result.err, "outlier"));
        const size_t rows = csv_column("cart.csv", "u", u, ROOM);
        size_t step = 20;
        while (step + 20 < rows && u[step] == u[step - 1]) step++;
        for (size_t at = step - 2; at <= step + 2; at++) {
            copy_with_spike("cart.csv", "spiked.csv", at, at % 2 == 0 ? 1.5 : -1.2);
            cli_json(identify, "check cart.yaml spiked.csv", "runs 4");
            assert_says(result.err, test_text("line %zu: column vx", at + 2));
            assert_says(result.err, "the first of 1 outliers");
        }
    }
}

TEST("every command refuses a cell so large that the others vanish in its rounding, with file, line and "
     "column") {
    static const char *const commands[] = {"check input.yaml first.csv second.csv",
                                           "fit input.yaml first.csv second.csv --out m.h5",
                                           "fit input.yaml first.csv --validation second.csv --out m.h5"};
    static const double values[] = {1e308, -1e308, 1e155, 1e20, -1e20};
    static const char *const spoiled[] = {"u", "x", "vx", "u"};
    for (size_t i = 0; i < LG_COUNT(values) * LG_COUNT(spoiled); i++) {
        const size_t k = i / LG_COUNT(spoiled), column = i % LG_COUNT(spoiled);
        /* the input is 0 elsewhere: 1e20 may then be its true value, so only larger values are refused */
        const bool idle = column == 3;
        sheet *s = good_sheet();
        if (idle && fabs(values[k]) < 1e154) continue;
        for (size_t row = 0; row < ROWS && idle; row++) s->u[row] = 0;
        if (spoiled[column][0] == 'u')
            s->u[70] = values[k];
        else
            s->cells[70][column == 1 ? X : VX] = values[k];
        write_sheet("second.csv", s);
        cli_expect(identify, commands[i % LG_COUNT(commands)], 3,
                   test_text("second.csv: line 72: column %s: %g is so large", spoiled[column], values[k]));
    }
    sheet *s = good_sheet();
    s->cells[70][X] = 1e308;
    write_sheet("second.csv", s);
    cli_expect(identify, "check place.yaml second.csv", 3, "line 72: column x: 1e+308 is so large");
}

TEST("late positions are reported with their lag, noisy or not, and a sensor that is stuck with its rows") {
    static const double sizes[] = {0.0, 1e-3};
    for (size_t k = 0; k < LG_COUNT(sizes); k++) {
        sheet *s = good_sheet();
        for (size_t i = 0; i < ROWS; i++)
            s->cells[i][Y] = 0.5 * cos(3 * DT * ((double)i - 4)) + sizes[k] * noise(i);
        write_sheet("log.csv", s);
        cli_json(identify, "check machine.yaml log.csv", "files 1");
        assert_says(result.err, "y: its positions are 4 rows (0.08 s) later than its velocities");
        assert_null(strstr(result.err, "x: its positions"));
    }
    sheet *s = good_sheet();
    for (size_t i = 75; i < 84; i++) s->cells[i][THETA] = s->cells[75][THETA];
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv", "files 1");
    assert_says(result.err, "column theta: stands at ");
    assert_says(result.err, "for 9 rows from 1.5 s on while w moves");
}

TEST("irregular time steps are not reported as gaps, but in a warning that names max_step") {
    sheet *s = good_sheet();
    for (size_t i = 0; i < ROWS; i++) s->cells[i][T] += 0.35 * DT * sin((double)(i * i));
    write_sheet("log.csv", s);
    cli_write("line.yaml",
              "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line}\nmeasured: positions\n"
              "mass: {kind: known, values: [1]}\n");
    cli_json(identify, "check line.yaml log.csv", "gaps >4");
    assert_says(result.err, "columns: {max_step: ...}");
    cli_write("line.yaml", "columns: {time: t, max_step: 0.04}\ncoordinates:\n  - {name: x, kind: line}\n"
                           "measured: positions\nmass: {kind: known, values: [1]}\n");
    cli_json(identify, "check line.yaml log.csv", "gaps 0, parts 1, warnings []");
}

TEST("momenta are refused where velocities are needed, and are not mistaken for them") {
    write_sheet("log.csv", good_sheet());
    cli_write(
        "momenta.yaml",
        "columns: {time: t}\nmeasured: momenta\ncoordinates:\n"
        "  - {name: x, kind: line, velocity: vx}\nmass: {kind: known, values: [3]}\ndamping: diagonal\n");
    cli_json(identify, "check momenta.yaml log.csv", "rows 200");
    cli_expect(identify, "fit momenta.yaml log.csv --out never.h5", 2, "measured: momenta");
}

TEST("both signs of a quaternion are the same rotation, which is reported") {
    sheet *s = good_sheet();
    for (size_t i = 40; i < 90; i++)
        for (int k = QW; k <= QZ; k++) s->cells[i][k] *= -1;
    write_sheet("log.csv", s);
    cli_json(identify, "check machine.yaml log.csv", "files 1");
    assert_says(result.err, "q and -q are the same rotation");
    json_expect(json_find(result.out, "kinematics"), "body <1e-3");
}

/* ---- delays of inputs ---- */

/* Writes a log of x'' = u - .4 x' - 4 x, where u is constant between rows and is logged `late` rows before it
 * acts. It is integrated with a thousand steps per row. */
static void write_driven(const char *name, size_t late) {
    enum { SIZE = 1 << 16, FINE = 1000 };
    char *text = lg_test_memory(SIZE);
    double x = 0.3, v = 0.0;
    size_t used = (size_t)snprintf(text, SIZE, "t,x,vx,u,k\n");
    for (size_t i = 0; i < ROWS; i++) {
        const double h = 5 * DT / FINE, u = 3 * noise(i);
        used += (size_t)snprintf(text + used, SIZE - used, "%.12g,%.12g,%.12g,%.12g,1\n", 5 * DT * (double)i,
                                 x, v, 3 * noise(i + late));
        for (int k = 0; k < FINE; k++) {
            v += h * (u - 0.4 * v - 4 * x);
            x += h * v;
        }
    }
    cli_write(name, text);
}

TEST("the delay of the inputs is estimated, and each fault of the log is reported once") {
    static const char *const expected[] = {"delay 0", "delay 1", "delay 4", "delay 8"};
    static const size_t late[] = {0, 1, 4, 8};
    cli_write("driven.yaml", "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}]\n"
                             "inputs: {columns: [u, k], delay: estimate}\n");
    for (size_t i = 0; i < LG_COUNT(late); i++) {
        write_driven("driven.csv", late[i]);
        cli_json(identify, "check driven.yaml driven.csv", expected[i]);
        const char *told = strstr(result.err, "the input is always");
        assert_non_null(told);
        assert_null(strstr(told + 1, "the input is always"));
        assert_int_equal(times(result.err, "more are not tried: if they act later, set a number"),
                         late[i] == 8);
    }
}

/* ---- noise ---- */

TEST(
    "the noise of attitudes, and of omega across a direction, is found whatever the attitude and the speed") {
    enum { SEEDS = 20 };
    /* Student's t with 19 degrees of freedom exceeds this in one of 1000 cases. */
    static const double student = 3.883, within = 0.05;
    /* Without damping the chain whips so fast that the estimate is only an upper bound. */
    static const char links[] =
        "system: pendulum-chain\nparameters: {gravity: 9.81, masses: [1, 0.7, 0.5], lengths: [0.5, 0.4, "
        "0.3]}\n"
        "damping: {kind: known, values: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1]}\n";
    static const char body[] = "system: rigid-body-attitude\nparameters: {inertia: [0.3, 0.4, 0.2]}\n";
    static const struct {
        const char *coordinates, *terms;
        double position, velocity; /* noise */
        const char *attitude, *rate;
        double part; /* of the noise of angles in a column of an attitude */
    } rows[] = {
        {"{name: b, kind: rotation, columns: [p, q, r, s], velocity: [wx, wy, wz]}", body, 0.002, 0.01, "p",
         NULL, 0.5},
        {"{name: b, kind: rotation, columns: [p, q, r, s, t1, t2, t3, t4, t5], velocity: [wx, wy, wz]}", body,
         0.002, 0.01, "p", NULL, 1},
        {"{name: b, kind: direction, columns: [x, y, z], velocity: [wx, wy, wz]}",
         "mass: {kind: known, values: [1, 1, 1]}\n", 0.002, 0.01, "x", "wx", 1},
        {"{name: b, kind: direction, columns: [x, y, z], velocity: [wx, wy, wz]}",
         "mass: {kind: known, values: [1, 1, 1]}\n", 0.01, 0.005, "y", "wz", 1},
        {"{name: a, kind: direction, columns: [x1, y1, z1], velocity: [a1, b1, c1]}, {name: b, kind: "
         "direction, "
         "columns: [x2, y2, z2], velocity: [a2, b2, c2]}, {name: c, kind: direction, columns: [x3, y3, z3], "
         "velocity: [a3, b3, c3]}",
         links, 0.002, 0.01, "x2", "a2", 1}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        double sum[2] = {0}, squares[2] = {0};
        cli_write("noise.yaml", test_text("columns: {run: run}\ncoordinates: [%s]\n%s", rows[i].coordinates,
                                          rows[i].terms));
        for (int seed = 1; seed <= SEEDS; seed++) {
            cli_run(
                identify,
                "generate noise.yaml --noise %g,%g --runs 4 --t-end 3 --dt 0.01 --start-spread 1,2 --seed %d "
                "--out noise-%zu.csv",
                rows[i].position, rows[i].velocity, seed, i);
            cli_json(identify, test_text("check noise.yaml noise-%zu.csv", i), "runs 4");
            const char *columns = json_find(result.out, "columns");
            for (int k = 0; k < 2 && (k == 0 || rows[i].rate != NULL); k++) {
                const double truth = k == 0 ? rows[i].part * rows[i].position : rows[i].velocity,
                             found = json_number(json_find(columns, k == 0 ? rows[i].attitude : rows[i].rate),
                                                 "noise"),
                             ratio = pow(truth / found, 2); /* of a loss to the expected one */
                sum[k] += ratio, squares[k] += ratio * ratio;
            }
        }
        for (int k = 0; k < 2 && (k == 0 || rows[i].rate != NULL); k++) {
            const double mean = sum[k] / SEEDS,
                         error = sqrt((squares[k] / SEEDS - mean * mean) / (SEEDS - 1));
            (void)printf("row %zu, %s: %.3f +- %.3f\n", i, k == 0 ? "attitude" : "rate", mean, error);
            if (!(fabs(mean - 1) < fmax(student * error, within)))
                fail_msg("row %zu, %s: %.3f +- %.3f", i, k == 0 ? "attitude" : "rate", mean, error);
        }
    }
}

TEST_GROUP(setup, cli_end)

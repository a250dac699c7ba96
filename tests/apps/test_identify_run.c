/* lg-identify generate, predict and evaluate, compared with motions that are known in closed form.
 * ctest-labels: apps/lg-identify src/machine */
#include "core/core.h"
#include "identify_support.h"

enum { ROOM = 4096 };

/* x'' = -x; the input has no effect */
static const char unit_machine[] =
    "columns: {time: t, run: run}\ncoordinates:\n"
    "  - {name: x, kind: line, velocity: vx}\nmass: {kind: known, values: [1]}\n"
    "potential: {kind: quadratic, of: x}\n";

/* The scene's machine with a network of 321 weights as potential. */
static const char wide_machine[] =
    "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
    "inputs: {columns: [u]}\nmass: diagonal\npotential: {kind: network, of: x}\n"
    "input_map: {kind: known, values: [[1]]}\n";

static const char body_scene[] =
    "columns: {time: t, run: run}\ncoordinates:\n"
    "  - {name: body, kind: rotation, columns: [qw, qx, qy, qz], velocity: [wx, wy, wz]}\n"
    "inputs: {columns: [a, b, c]}\nmass: {kind: known, values: [0.5, 0.6, 0.3]}\n"
    "potential: {kind: known, form: linear, of: body.up, values: [0.1, -0.2, 1]}\n"
    "damping: {kind: known, values: [0.1, 0.12, 0.08]}\n"
    "input_map: {kind: known, values: [[1,0,0],[0,1,0],[0,0,1]]}\n";
static const char body_machine[] =
    "columns: {time: t, run: run}\ncoordinates:\n"
    "  - {name: body, kind: rotation, columns: [qw, qx, qy, qz], velocity: [wx, wy, wz]}\n"
    "inputs: {columns: [a, b, c], hold: zero}\nmass: diagonal\npotential: {kind: linear, of: body.up}\n"
    "damping: diagonal\ninput_map: {kind: known, values: [[1,0,0],[0,1,0],[0,0,1]]}\n";

/* A crane with degrees, milliseconds, and inputs that act two rows after they are logged. */
#define CRANE                                                                                                \
    "columns: {time: ms, run: run}\ncoordinates:\n"                                                          \
    "  - {name: s, kind: angle, columns: deg, velocity: rate}\n"                                             \
    "inputs: {columns: [u], delay: 2}\nscale: {ms: 0.001, deg: 0.017453292519943295, u: 10}\n"               \
    "input_map: {kind: known, values: [[1]]}\n"
static const char crane_scene[] =
    CRANE "mass: {kind: known, values: [3]}\ndamping: {kind: known, values: [1]}\n"
          "potential: {kind: known, form: gravity, of: s, values: [0, -20]}\n";
static const char crane_machine[] = CRANE "mass: diagonal\ndamping: diagonal\n"
                                          "potential: {kind: gravity, of: s}\n";

static const double *column(const char *name, const char *of, size_t *rows) {
    double *out = TEST_ARRAY(double, ROOM);
    *rows = csv_column(name, of, out, ROOM);
    return out;
}

/* Numbers in the first row of a plot's data. */
static int drawn_columns(const char *name) {
    char *text = lg_test_memory(1 << 20), *save = NULL;
    int count = 0;
    (void)cli_read(name, text, 1 << 20);
    char *row = strstr(text, "\n\n\n");
    assert_non_null(row);
    for (char *word = strtok_r(strtok_r(row, "\n", &save), " ", &row); word != NULL; count++)
        word = strtok_r(NULL, " ", &row);
    return count;
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("unit.yaml", unit_machine);
    cli_write("scene.yaml", oscillator_scene);
    cli_write("machine.yaml", oscillator_machine);
    cli_write("wide.yaml", wide_machine);
    cli_write("body-scene.yaml", body_scene);
    cli_write("body.yaml", body_machine);
    cli_write("crane-scene.yaml", crane_scene);
    cli_write("crane.yaml", crane_machine);
    return 0;
}

/* ---- generate ---- */

TEST("generated motions solve the equations of motion") {
    cli_forget("train.csv test.csv p.csv log.csv");
    size_t rows;
    cli_run(identify, "generate scene.yaml --inputs none --runs 2 --t-end 5 --dt 0.05 --out free.csv");
    const double *t = column("free.csv", "t", &rows), *x = column("free.csv", "x", &rows),
                 *v = column("free.csv", "vx", &rows), *u = column("free.csv", "u", &rows);
    assert_int_equal(rows, 202);
    /* The solution of x'' + 2 d x' + w^2 x = 0 with d = .075, w^2 = 2.5 is known. */
    const double d = 0.075, w = sqrt(2.5 - d * d);
    for (size_t i = 0; i < rows; i++) {
        const size_t start = i / 101 * 101;
        const double a = x[start], b = (v[start] + d * a) / w, e = exp(-d * t[i]), c = cos(w * t[i]),
                     s = sin(w * t[i]);
        assert_close(x[i], e * (a * c + b * s), 0, 1e-9);
        assert_close(v[i], e * (w * (b * c - a * s) - d * (a * c + b * s)), 0, 1e-9);
        assert_close(u[i], 0, 0, 0);
    }
    assert_true(fabs(x[0] - x[101]) > 1e-3);
}

TEST("an input acts exactly as long as it is held") {
    cli_forget("train.csv test.csv p.csv log.csv");
    size_t rows;
    cli_write("pulse.csv", "t,run,u\n0,0,0\n1,0,3\n2,0,0\n3,0,0\n4,0,0\n");
    cli_write("mass.yaml", OSCILLATOR_COLUMNS "mass: {kind: known, values: [2]}\n"
                                              "input_map: {kind: known, values: [[1]]}\n");
    cli_run(identify,
            "generate mass.yaml --inputs pulse.csv --runs 1 --dt 0.125 --start-spread 0 --out pushed.csv");
    const double *t = column("pushed.csv", "t", &rows), *v = column("pushed.csv", "vx", &rows),
                 *u = column("pushed.csv", "u", &rows);
    assert_int_equal(rows, 33);
    for (size_t i = 0; i < rows; i++) {
        assert_close(v[i], t[i] < 1 ? 0 : 1.5 * fmin(1, t[i] - 1), 0, 1e-12);
        assert_close(u[i], t[i] >= 1 && t[i] < 2 ? 3 : 0, 0, 0);
    }
    cli_write("scaled.yaml", OSCILLATOR_COLUMNS "scale: {t: 0.001, u: 2}\nmass: {kind: known, values: [2]}\n"
                                                "input_map: {kind: known, values: [[1]]}\n");
    cli_write("scaled.csv", "t,run,u\n0,0,0\n1000,0,1.5\n2000,0,0\n3000,0,0\n4000,0,0\n");
    cli_run(identify, "generate scaled.yaml --inputs scaled.csv --runs 1 --dt 0.125 --start-spread 0 "
                      "--out milliseconds.csv");
    const double *milliseconds = column("milliseconds.csv", "t", &rows),
                 *same = column("milliseconds.csv", "vx", &rows),
                 *half = column("milliseconds.csv", "u", &rows);
    assert_int_equal(rows, 33);
    for (size_t i = 0; i < rows; i++) {
        assert_close(milliseconds[i], 1000 * t[i], 0, 1e-9);
        assert_true(same[i] == v[i] && 2 * half[i] == u[i]);
    }
    cli_write("dates.csv", "t,run,u\n20240301000000,0,0\n20240301000001,0,0\n20240301000002,0,0\n");
    cli_expect(identify, "generate mass.yaml --inputs dates.csv --runs 1 --out log.csv", 3,
               "dates.csv: line 2: column t: 20240301000000 is a date without separators");
    cli_write("twice.csv", "t,run,u\n0,0,0\n1,0,3\n1,0,0\n2,0,0\n");
    cli_run(identify, "generate mass.yaml --inputs twice.csv --runs 1 --out log.csv");
    assert_says(result.err,
                "twice.csv: line 4: the time does not increase: only the rows before it are used");
    char epoch[4096], *at = epoch + sprintf(epoch, "t,run,u\n");
    for (int i = 0; i <= 60; i++) at += sprintf(at, "%.2f,0,%d\n", 1700000000.03 + 0.05 * i, i);
    cli_write("epoch.csv", epoch);
    cli_run(identify, "generate mass.yaml --inputs epoch.csv --runs 1 --dt 0.05 --out late.csv");
    u = column("late.csv", "u", &rows);
    for (size_t i = 0; i < rows; i++) assert_close(u[i], (double)i, 0, 0);
    cli_write("hole.csv", "t,run,u\n0,0,0\n1,0,\n2,0,0\n");
    cli_expect(identify, "generate mass.yaml --inputs hole.csv --runs 1 --out log.csv", 3,
               "hole.csv: line 3: column u: the value is missing");
}

TEST("noise has the given size, and the same seed gives the same bytes") {
    cli_forget("train.csv test.csv p.csv log.csv");
    size_t rows;
    double off = 0, slow = 0;
    char a[65536 * 2], b[65536 * 2];
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 8 --out clean.csv");
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 8 --noise 0.01,0.05 --out noisy.csv");
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 8 --noise 0.01,0.05 --out again.csv --threads 1");
    assert_true(cli_read("noisy.csv", a, sizeof a) == cli_read("again.csv", b, sizeof b));
    assert_int_equal(strcmp(a, b), 0);
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 8 --noise 0.01,0.05 --out again.csv --seed 2");
    (void)cli_read("again.csv", b, sizeof b);
    assert_int_not_equal(strcmp(a, b), 0);
    const double *x = column("clean.csv", "x", &rows), *y = column("noisy.csv", "x", &rows);
    const double *v = column("clean.csv", "vx", &rows), *w = column("noisy.csv", "vx", &rows);
    for (size_t i = 0; i < rows; i++) off += pow(x[i] - y[i], 2), slow += pow(v[i] - w[i], 2);
    assert_close(sqrt(off / (double)rows), 0.01, 0.08, 0);
    assert_close(sqrt(slow / (double)rows), 0.05, 0.08, 0);
}

TEST("inputs of the kind `steps` are constant for the given time and within their amplitude") {
    cli_forget("train.csv test.csv p.csv log.csv");
    size_t rows, changes = 0;
    cli_run(identify, "generate scene.yaml --inputs steps:0.5 --amplitude 4 --runs 1 --out s.csv");
    const double *u = column("s.csv", "u", &rows);
    for (size_t i = 0; i < rows; i++) {
        assert_true(fabs(u[i]) <= 4);
        if (i > 0 && i % 25 != 0) assert_close(u[i], u[i - 1], 0, 0);
        changes += i > 0 && u[i] != u[i - 1];
    }
    assert_int_equal(changes, 20);
}

TEST("each column of a pose has its own noise, and the expected loss counts places, angles and rates as they "
     "are") {
    static const char pose[] =
        "columns: {time: t, run: run}\ncoordinates: [{name: b, kind: pose, position: [x, y, z], columns: "
        "[qw, qx, "
        "qy, qz], velocity: [vx, vy, vz], rates: [wx, wy, wz]}]\ninputs: {columns: [f, a, c, d], hold: "
        "zero}\n"
        "noise: {x: 0.05, y: 0.05, z: 0.05, qw: 0.001, qx: 0.001, qy: 0.001, qz: 0.001, vx: 0.02, vy: 0.02, "
        "vz: 0.02, wx: 0.002, wy: 0.002, wz: 0.002}\n"
        "input_map: {kind: known, values: [[0,0,0,0],[0,0,0,0],[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}\n"
        "mass: {kind: known, values: [1, 1, 1, 0.1, 0.2, 0.3]}\n";
    static const struct {
        const char *column;
        double size;
    } columns[] = {{"x", 0.05}, {"z", 0.05}, {"vx", 0.02}, {"wx", 0.002}, {"wz", 0.002}};
    size_t rows;
    cli_write("noise.yaml",
              test_text("%sdamping: {kind: known, values: [0.1, 0.1, 0.1, 0.02, 0.02, 0.02]}\n", pose));
    cli_write("pose.yaml", test_text("%sdamping: diagonal\n", pose));
    cli_run(identify, "generate noise.yaml --runs 2 --t-end 6 --inputs steps --seed 5 --out noise.csv");
    cli_run(identify,
            "generate noise.yaml --runs 2 --t-end 6 --inputs steps --seed 5 --noise 0 --out none.csv");
    for (size_t i = 0; i < LG_COUNT(columns); i++) {
        const double *with = column("noise.csv", columns[i].column, &rows),
                     *without = column("none.csv", columns[i].column, &rows);
        double sum = 0;
        for (size_t row = 0; row < rows; row++) sum += pow(with[row] - without[row], 2) / (double)rows;
        assert_close(sqrt(sum), columns[i].size, 0.1, 0);
    }
    cli_json(identify, "fit pose.yaml noise.csv --out pose.h5", "loss >0");
    assert_close(json_number(result.out, "expected_loss"), json_number(result.out, "loss"), 0.1, 0);
}

TEST("white noise of velocities alone, and of a direction, is told to be white") {
    static const char *const machines[][2] = {
        {"columns: {time: t, run: run}\ncoordinates: [{name: x, kind: line, velocity: vx}]\n"
         "inputs: {columns: [u], hold: zero}\nnoise: {vx: 0.02}\ninput_map: {kind: known, values: [1]}\n",
         "mass: {kind: known, values: [2]}\ndamping: {kind: known, values: [0.5]}\n"},
        {"columns: {time: t, run: run}\n"
         "coordinates: [{name: q, kind: direction, columns: [qx, qy, qz], velocity: [wx, wy, wz]}]\n"
         "inputs: {columns: [a, b, c], hold: zero}\n"
         "input_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n"
         "noise: {qx: 0.005, qy: 0.005, qz: 0.005, wx: 0.02, wy: 0.02, wz: 0.02}\n",
         "mass: {kind: known, values: [1, 1, 1]}\ndamping: {kind: known, values: [0.2, 0.2, 0.2]}\n"}};
    for (int i = 0; i < 2; i++) {
        cli_forget("white.csv");
        cli_write("truth.yaml", test_text("%s%s", machines[i][0], machines[i][1]));
        cli_write("white.yaml", test_text("%s%sdamping: diagonal\n", machines[i][0],
                                          i == 0 ? "measured: velocities-only\n" : ""));
        cli_run(identify, "generate truth.yaml --runs 2 --t-end 20 --dt 0.02 --seed 3 --out white.csv");
        cli_json(identify, "fit white.yaml white.csv --out m.h5", "identified {");
        assert_says(result.out, "\"errors\": \"white\"");
    }
}

/* ---- predict ---- */

/* The predicted file must be a log of the machine with the same times and inputs as the given log. Columns
 * `same` must be equal, columns `near` agree to `tolerance`. */
static void expect_log(const char *yaml, const char *log, const char *predicted, const char *const *same,
                       const char *const *near, double tolerance) {
    size_t rows, more;
    cli_json(identify, test_text("check %s %s", yaml, predicted), "gaps 0");
    for (; *same != NULL; same++) {
        const double *a = column(log, *same, &rows), *b = column(predicted, *same, &more);
        assert_int_equal(rows, more);
        assert_all_close(b, a, rows, 1e-14, 1e-12);
    }
    for (; *near != NULL; near++) {
        const double *a = column(log, *near, &rows), *b = column(predicted, *near, &more);
        assert_all_close(b, a, rows, 0, tolerance);
    }
}

TEST("the CSV that predict writes can be read as a log, with quaternions and the inputs of the given log") {
    cli_forget("train.csv test.csv p.csv log.csv");
    cli_run(identify, "generate body-scene.yaml --runs 2 --t-end 3 --inputs steps --out train.csv");
    cli_run(identify, "generate body-scene.yaml --runs 2 --t-end 3 --seed 4 --out test.csv");
    cli_run(identify, "fit body.yaml train.csv --out body.h5");
    cli_json(identify, "predict body.h5 test.csv --out p.csv --plot p.svg", "rows 302, runs 2");
    expect_log("body.yaml", "test.csv", "p.csv", (const char *const[]){"t", "run", "a", "b", "c", NULL},
               (const char *const[]){"qw", "qx", "qy", "qz", "wx", "wy", "wz", NULL}, 2e-4);
    json_expect(json_find(result.out, "kinematics"), "body <1e-2");
    assert_true(cli_exists("p.svg"));
}

TEST("predict writes columns in the log's units, and inputs at the rows where they were logged") {
    cli_forget("train.csv test.csv p.csv log.csv");
    size_t rows, more;
    cli_run(identify, "generate crane-scene.yaml --runs 2 --t-end 4 --amplitude 20 --out train.csv");
    cli_run(identify, "fit crane.yaml train.csv --out crane.h5");
    cli_json(identify, "check crane.yaml train.csv", "delay 2, dt_median 0.02");
    cli_run(identify, "predict crane.h5 train.csv --out p.csv");
    const double *a = column("train.csv", "deg", &rows), *b = column("p.csv", "deg", &more);
    const double *ta = column("train.csv", "ms", &rows), *tb = column("p.csv", "ms", &more);
    const double *ua = column("train.csv", "u", &rows), *ub = column("p.csv", "u", &more);
    assert_int_equal(rows, 402);
    assert_int_equal(more, 398); /* the first two rows of each run have no input yet */
    for (size_t i = 0; i < more; i++) {
        const size_t at = i + 2 + (i >= 199 ? 2 : 0);
        assert_close(tb[i], ta[at], 1e-12, 1e-9);
        assert_close(b[i], a[at], 0, 1e-3); /* degrees */
        const bool known = i % 199 < 197;   /* inputs that would act after the end are missing */
        assert_true(isnan(ub[i]) == !known);
        if (known) assert_close(ub[i], ua[at], 1e-12, 1e-12);
    }
}

TEST("a prediction has the names of the runs as in the log") {
    static const char *const names[] = {"7", "\"cold, dry\"", "7"};
    enum { ROWS = 20, SIZE = 1 << 14 };
    char log[SIZE] = "t,run,x,vx,u\n";
    cli_forget("train.csv p.csv log.csv");
    for (size_t run = 0; run < LG_COUNT(names); run++)
        for (int row = 0; row < ROWS; row++)
            lg_append(log, SIZE, "%.2f,%s,%.9f,%.9f,0\n", 0.05 * row, names[run], 0.1 * cos(0.08 * row),
                      -0.16 * sin(0.08 * row));
    cli_write("log.csv", log);
    cli_run(identify, "generate scene.yaml --runs 3 --t-end 5 --noise 0 --out train.csv");
    cli_run(identify, "fit machine.yaml train.csv --out m.h5");
    cli_json(identify, "predict m.h5 log.csv --out p.csv", "rows 60, runs 3");
    (void)cli_read("p.csv", log, SIZE);
    assert_says(log, "\n0,7,0.1");
    assert_says(log, "\n0,\"cold, dry\",0.1");
}

TEST("a prediction begins at the given row, and a gap ends it") {
    cli_forget("train.csv test.csv p.csv log.csv");
    size_t rows;
    cli_run(identify, "generate scene.yaml --runs 3 --t-end 5 --noise 0 --out train.csv");
    cli_run(identify, "fit machine.yaml train.csv --out m.h5");
    cli_run(identify, "generate scene.yaml --runs 1 --t-end 4 --out one.csv --seed 3");
    cli_json(identify, "predict m.h5 one.csv --start 40 --out p.csv", "rows 161, runs 1");
    const double *t = column("p.csv", "t", &rows);
    assert_close(t[0], 0.8, 1e-12, 0);
    cli_expect(identify, "predict m.h5 one.csv --start 200 --out p.csv", 2, "row 200");
}

TEST("bands of a prediction are as wide as its errors; models without a covariance say that there are "
     "none") {
    cli_forget("train.csv test.csv p.csv log.csv");
    size_t rows, more;
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 8 --noise 0.02 --out train.csv");
    cli_run(identify, "fit machine.yaml train.csv --out m.h5");
    cli_run(identify, "generate scene.yaml --runs 1 --t-end 8 --noise 0 --out exact.csv --seed 7");
    cli_run(identify, "predict m.h5 exact.csv --bands --out p.csv --plot bands.svg");
    assert_int_equal(drawn_columns("bands.dat"), 1 + 3 * 5); /* t; log, prediction, deviations of 5 columns */
    const double *truth = column("exact.csv", "x", &rows), *x = column("p.csv", "x", &more),
                 *band = column("p.csv", "x.sd", &more);
    double error = 0.0, width = 0.0;
    assert_int_equal(rows, more);
    assert_true(band[0] == 0.0);
    for (size_t i = 0; i < rows; i++) {
        assert_true(fabs(x[i] - truth[i]) <= 5.0 * band[i] + 1e-9);
        error += (x[i] - truth[i]) * (x[i] - truth[i]);
        width += band[i] * band[i];
    }
    assert_true(error > 0.02 * width && width > 0.0);
    cli_run(identify, "generate scene.yaml --runs 1 --t-end 1 --out short.csv");
    cli_run(identify, "fit wide.yaml short.csv --out wide.h5 --epochs 2");
    cli_expect(identify, "predict wide.h5 exact.csv --bands --out p.csv", 2, "more than 256");
}

/* The machines of the file have the column `p`, the velocity `v` and the input `u` instead of x, vx and u. */
static void write_named(const char *file, const char *name, const char *rest) {
    cli_write(file, test_text("columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, columns: 'p%s', "
                              "velocity: 'v%s'}\ninputs: {columns: ['u%s']}\n%s",
                              name, name, name, rest));
}

TEST("plots show names of columns and inputs as they are, and run nothing") {
    /* as YAML writes them, as they are */
    static const char *const names[][2] = {{"`touch RAN`$(touch RAN)", "`touch RAN`$(touch RAN)"},
                                           {"''.system(''touch RAN'').''", "'.system('touch RAN').'"},
                                           {"\\101%s@t_{x}^y\\n", "\\101%s@t_{x}^y\\n"}};
    static const char *const lines[] = {
        "generate named.yaml --runs 1 --t-end 8 --out log.csv --plot generate.svg",
        "check model.yaml log.csv --plot check.svg", "fit model.yaml log.csv --out m.h5",
        "predict m.h5 log.csv --bands --out p.csv --plot predict.svg",
        "evaluate m.h5 log.csv --plot evaluate.svg"};
    static const char *const plots[] = {"generate", "check", "predict", "evaluate"};
    static char shown[1 << 20];
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        write_named("named.yaml", names[i][0], strstr(oscillator_scene, "mass"));
        write_named("model.yaml", names[i][0], strstr(oscillator_machine, "mass"));
        cli_forget("log.csv p.csv");
        for (size_t k = 0; k < LG_COUNT(lines); k++) {
            cli_run(identify, "%s", lines[k]);
            if (cli_exists("RAN")) fail_msg("%s: %s ran", lines[k], names[i][1]);
            assert_null(strstr(result.err, "gnuplot failed"));
        }
        for (size_t k = 0; k < LG_COUNT(plots); k++) {
            const char *path = test_text("%s.svg", plots[k]);
            if (!cli_exists(path)) continue; /* gnuplot is not installed */
            (void)cli_read(path, shown, sizeof shown);
            for (const char *c = "pvu"; *c != '\0'; c++)
                if (*c != 'u' || strcmp(plots[k], "evaluate") != 0)
                    assert_says(shown, test_text("<text>%c%s</text>", *c, names[i][1]));
        }
    }
}

TEST("predict and evaluate warn of columns that leave the range of the training data, and of no others") {
    cli_forget("train.csv test.csv p.csv log.csv");
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 8 --out train.csv --start-spread 0.5");
    cli_run(identify, "fit machine.yaml train.csv --out m.h5");
    identify_run_quietly("predict m.h5 train.csv --out p.csv");
    cli_run(identify,
            "generate scene.yaml --runs 1 --t-end 8 --out far.csv --amplitude 1 --start-spread 9 --seed 5");
    cli_run(identify, "predict m.h5 far.csv --out p.csv");
    assert_says(result.err, "column x goes to ");
    assert_says(result.err, "outside the training data");
    cli_run(identify, "evaluate m.h5 far.csv");
    assert_says(result.err, "column vx goes to ");
}

/* A log of an angle a = centre + size sin t. */
static void write_swing(const char *name, double centre, double size) {
    enum { SIZE = 1 << 14, ROWS = 100 };
    char *text = lg_test_memory(SIZE);
    size_t used = (size_t)snprintf(text, SIZE, "t,a,va\n");
    for (int i = 0; i < ROWS; i++)
        used += (size_t)snprintf(text + used, SIZE - used, "%.17g,%.17g,%.17g\n", 0.1 * i,
                                 centre + size * sin(0.1 * i), size * cos(0.1 * i));
    cli_write(name, text);
}

TEST("an angle is outside the training data if it is so after any number of full turns") {
    static const struct {
        double trained, size, centre;
        bool outside;
    } rows[] = {{3.1, 0.4, 3.1, false},  {3.1, 0.4, 3.1 - 6.283185307179586, false},
                {3.1, 0.4, 0.3, true},   {-3.1, 0.4, -0.3, true},
                {-3.1, 0.5, 3.1, false}, {0, 3.13, 3.1, false}};
    cli_write("swing.yaml", "columns: {time: t}\ncoordinates:\n  - {name: a, kind: angle, velocity: va}\n"
                            "mass: {kind: known, values: [1]}\npotential: {kind: network, of: [a]}\n");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        write_swing("swing.csv", rows[i].trained, rows[i].size);
        write_swing("other.csv", rows[i].centre, 0.4);
        cli_forget("swing.h5 p.csv");
        cli_run(identify, "fit swing.yaml swing.csv --out swing.h5 --epochs 2");
        cli_run(identify, "predict swing.h5 other.csv --out p.csv");
        if ((strstr(result.err, "column a goes to ") != NULL) != rows[i].outside)
            fail_msg("row %zu: %s", i, result.err);
    }
}

/* ---- evaluate, compared with errors that are computed here ---- */

enum { POINTS = 201 };
#define STEP 0.05
#define OFF  0.01

/* A log of x = cos t, v = -sin t in which every second row, but not the first, has OFF added to x. */
static void write_wrong(const char *name) {
    enum { SIZE = 1 << 15 };
    char *text = lg_test_memory(SIZE);
    size_t used = (size_t)snprintf(text, SIZE, "run,t,x,vx\n");
    for (int i = 0; i < POINTS; i++)
        used += (size_t)snprintf(text + used, SIZE - used, "0,%.17g,%.17g,%.17g\n", STEP * i,
                                 cos(STEP * i) + (i % 2 == 1 ? OFF : 0), -sin(STEP * i));
    cli_write(name, text);
}

static void learn_unit(void) {
    cli_write("unit-scene.yaml",
              "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"
              "mass: {kind: known, values: [1]}\n"
              "potential: {kind: known, form: quadratic, of: x, values: [0.5]}\n");
    cli_forget("train.csv");
    cli_run(identify, "generate unit-scene.yaml --runs 3 --t-end 8 --dt 0.05 --out train.csv");
    cli_run(identify, "fit unit.yaml train.csv --out unit.h5 --substeps 4");
}

TEST("errors of free runs and of the guess that nothing moves agree with errors computed here") {
    double still = 0, moving = 0;
    learn_unit();
    write_wrong("wrong.csv");
    cli_json(identify, "evaluate unit.h5 wrong.csv --horizons 10 --every 1000 --metric relative",
             "window_loss >0");
    const char *runs = json_find(result.out, "free_run");
    assert_close(json_number(runs, "x"), OFF * sqrt(100.0 / POINTS), 1e-5, 0);
    assert_true(json_number(runs, "vx") < 1e-6);
    const char *horizon = strchr(json_find(result.out, "horizons"), '{');
    json_expect(horizon, "seconds 10, starts 1, angle null, rotation null, velocity <1e-6");
    assert_close(json_number(horizon, "line"), OFF * sqrt(100.0 / 200), 1e-5, 0);
    for (int i = 1; i < POINTS; i++) {
        still += pow(cos(STEP * i) + (i % 2 == 1 ? OFF : 0) - 1, 2) / 200;
        moving += pow(sin(STEP * i), 2) / 200;
    }
    assert_close(json_number(json_find(horizon, "unchanged"), "line"), sqrt(still), 1e-9, 0);
    assert_close(json_number(json_find(horizon, "unchanged"), "velocity"), sqrt(moving), 1e-9, 0);
    /* The machine is linear, so the linear model that is fitted to these logs is nearly as good. */
    assert_true(json_number(json_find(horizon, "linear"), "line") < 0.02);
    double mean = 0;
    for (int i = 0; i < POINTS; i++) {
        const double off = i % 2 == 1 ? OFF : 0, x = cos(STEP * i), v = 2 * sin(STEP * i);
        mean += log(off / sqrt((2 * x + off) * (2 * x + off) + v * v) + 1e-8) / POINTS;
    }
    assert_close(json_number(result.out, "relative"), exp(mean), 0.5,
                 0); /* rows without an error have rounding errors */
    cli_expect(identify, "evaluate unit.h5 wrong.csv", 0, "free run");
}

TEST("relative errors are geometric means over time, then over parts") {
    learn_unit();
    write_wrong("wrong.csv");
    /* All rows are too high by a part that is far above rounding. */
    enum { SIZE = 1 << 15 };
    char *text = lg_test_memory(SIZE);
    size_t used = (size_t)snprintf(text, SIZE, "run,t,x,vx\n");
    double mean[2] = {0, 0};
    for (int part = 0; part < 2; part++)
        for (int i = 0; i < 41; i++) {
            const double off = i == 0 ? 0 : 0.002 * (part + 1) * (2 + sin(40.0 * i)), x = cos(STEP * i),
                         v = -sin(STEP * i);
            used += (size_t)snprintf(text + used, SIZE - used, "%d,%.17g,%.17g,%.17g\n", part, STEP * i,
                                     x + off, v);
            mean[part] += log(off / sqrt((2 * x + off) * (2 * x + off) + 4 * v * v) + 1e-8) / 41;
        }
    cli_write("two.csv", text);
    cli_json(identify, "evaluate unit.h5 two.csv --horizons 1 --metric relative", "relative >0");
    assert_close(json_number(result.out, "relative"), exp((mean[0] + mean[1]) / 2), 1e-3, 0);
    assert_close(json_number(result.out, "relative_worst"), exp(fmax(mean[0], mean[1])), 1e-3, 0);
    cli_json(identify, "evaluate unit.h5 two.csv --horizons 1", "window_loss >0");
    assert_null(json_find(result.out, "relative"));
}

TEST("the energy balance adds up, and has the true change, work and damping") {
    cli_forget("train.csv test.csv p.csv log.csv");
    size_t rows;
    cli_run(identify, "generate scene.yaml --runs 1 --t-end 10 --out log.csv");
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 10 --out train.csv --seed 2");
    cli_run(identify, "fit machine.yaml train.csv --out m.h5");
    cli_json(identify, "evaluate m.h5 log.csv --plot e.svg", "window_loss <1e-10");
    const char *energy = json_find(result.out, "energy");
    const double *x = column("log.csv", "x", &rows), *v = column("log.csv", "vx", &rows),
                 *u = column("log.csv", "u", &rows);
    double work = 0, lost = 0;
    for (size_t i = 0; i + 1 < rows; i++) work += u[i] * (x[i + 1] - x[i]);
    for (size_t i = 0; i + 1 < rows; i++)
        lost -= 0.3 * 0.02 * (v[i] * v[i] + v[i] * v[i + 1] + v[i + 1] * v[i + 1]) / 3;
    const double change = 2.5 * (pow(x[rows - 1], 2) - x[0] * x[0]) + pow(v[rows - 1], 2) - v[0] * v[0];
    assert_close(json_number(energy, "change"), change, 1e-4, 1e-6);
    assert_close(json_number(energy, "inputs"), work, 1e-3, 1e-5);
    assert_close(json_number(energy, "damping"), lost, 2e-3, 0);
    assert_close(json_number(energy, "residual"), 0, 0, 0);
    json_expect(energy, "left_size <1e-4, change_size >1");
    assert_close(json_number(energy, "change"),
                 json_number(energy, "inputs") + json_number(energy, "damping") + json_number(energy, "left"),
                 1e-9, 1e-9);
    assert_true(cli_exists("e.svg"));
}

TEST("noise makes neighbouring one-step residuals opposite, a wrong model makes them similar") {
    cli_forget("train.csv test.csv p.csv log.csv");
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 10 --out train.csv");
    cli_run(identify, "fit machine.yaml train.csv --out m.h5");
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 10 --noise 0.02 --out noisy.csv");
    cli_json(identify, "evaluate m.h5 noisy.csv --horizons 1", "window_loss >0");
    const char *white = json_find(json_find(result.out, "whiteness"), "x");
    json_expect(white, "lag1 <-0.4, lag1 >-0.6, probability <1e-6, rms >0.02, rms <0.04");
    /* A model with twice the damping. */
    cli_write(
        "wrong.yaml", OSCILLATOR_COLUMNS
        "mass: {kind: known, values: [2]}\npotential: {kind: known, form: quadratic, of: x, values: [2.5]}\n"
        "damping: {kind: known, values: [0.6]}\ninput_map: {kind: known, values: [[1]]}\n");
    cli_forget("wrong.csv");
    cli_run(identify, "generate wrong.yaml --runs 4 --t-end 10 --out wrong.csv");
    cli_json(identify, "evaluate m.h5 wrong.csv --horizons 1", "window_loss >0");
    json_expect(json_find(json_find(result.out, "whiteness"), "vx"), "lag1 >0.8, probability <1e-6");
}

TEST("the window loss is a mean over windows and points; for white noise it equals the mean square of "
     "one-step residuals") {
    cli_forget("train.csv test.csv p.csv log.csv");
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 10 --noise 0.01 --seed 7 --out noisy.csv");
    cli_json(identify, "evaluate m.h5 noisy.csv --horizons 1 --window 2", "window_loss >0");
    const double loss = json_number(result.out, "window_loss");
    const char *whiteness = json_find(result.out, "whiteness");
    const double x = json_number(json_find(whiteness, "x"), "rms"),
                 vx = json_number(json_find(whiteness, "vx"), "rms");
    assert_close(loss, x * x + vx * vx, 1e-6, 0);
    cli_json(identify, "evaluate m.h5 noisy.csv --horizons 1 --window 11", "window_loss >0");
    assert_close(json_number(result.out, "window_loss"), loss, 0.2, 0);
}

TEST("with positions alone the starts are estimated from 50 rows, which are not scored") {
    cli_forget("train.csv test.csv p.csv log.csv");
    cli_write("positions-scene.yaml",
              "columns: {time: t, run: run}\nmeasured: positions\ncoordinates:\n  - {name: x, kind: line}\n"
              "inputs: {columns: [u], hold: zero}\nmass: {kind: known, values: [2]}\n"
              "potential: {kind: known, form: quadratic, of: x, values: [2.5]}\n"
              "damping: {kind: known, values: [0.3]}\ninput_map: {kind: known, values: [[1]]}\n");
    cli_write("positions.yaml",
              "columns: {time: t, run: run}\nmeasured: positions\ncoordinates:\n  - {name: x, kind: line}\n"
              "inputs: {columns: [u], hold: zero}\nmass: {kind: known, values: [2]}\npotential: {kind: "
              "quadratic, of: x}\n"
              "damping: diagonal\ninput_map: {kind: known, values: [[1]]}\n");
    cli_run(identify, "generate positions-scene.yaml --runs 2 --t-end 5 --out train.csv");
    cli_run(identify, "fit positions.yaml train.csv --out m.h5");
    cli_run(identify,
            "generate positions-scene.yaml --runs 2 --t-end 10 --out test.csv --seed 3 --noise 0.001");
    cli_json(identify, "evaluate m.h5 test.csv --horizons 2", "energy {");
    const double rms = json_number(json_find(result.out, "free_run"), "x");
    assert_true(rms > 0.0008 && rms < 0.0013);
    const char *horizon = strchr(json_find(result.out, "horizons"), '{');
    json_expect(horizon, "starts >10, line <0.0015, line >0.0008, velocity null");
    json_expect(json_find(json_find(result.out, "whiteness"), "x"), "lag1 <0.5, rms <0.0013");
    cli_json(identify, "predict m.h5 test.csv --out p.csv", "rows 1002, runs 2");
    cli_run(identify, "check positions.yaml p.csv");
}

/* y'' = u - .3 y' + d, all lengths in `unit`. The disturbance d changes slowly at random: its standard
 * deviation is `push`. Positions have the noise `noise`. */
static void write_pushed(const char *name, int rows, double h, double unit, double push, double noise,
                         uint64_t seed) {
    enum { FINE = 20 };
    static const double memory = 1;
    const size_t size = 80 * ((size_t)rows + 1);
    char *text = lg_test_memory(size);
    size_t used = (size_t)snprintf(text, size, "t,y,u\n");
    double y = 0, v = 0, d = 0, u = 0;
    lg_rng rng = test_rng(seed, 0);
    for (int i = 0; i < rows; i++) {
        if (i % (rows / 20) == 0) u = lg_rng_normal(&rng);
        used += (size_t)snprintf(text + used, size - used, "%.17g,%.17g,%.17g\n", h * i,
                                 unit * (y + noise * lg_rng_normal(&rng)), unit * u);
        for (int k = 0; k < FINE; k++) {
            d += -d * h / FINE / memory + push * sqrt(2 * h / FINE / memory) * lg_rng_normal(&rng);
            v += h / FINE * (u - 0.3 * v + d);
            y += h / FINE * v;
        }
    }
    cli_write(name, text);
}

TEST("the rows that estimate a start follow disturbance and noise, and all machines start from them") {
    static const struct {
        int rows;
        double h, unit, push, noise, least, most;
    } cases[] = {{8000, 1e-3, 1, 0, 2e-4, 100, 200},
                 {600, 0.05, 1, 0.5, 1e-4, 4, 10},
                 {600, 0.05, 1e9, 0.5, 1e-4, 4, 10},
                 {600, 0.05, 1, 0, 0.02, 25, 50}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        cli_write("pushed.yaml",
                  test_text("columns: {time: t}\nmeasured: positions\ncoordinates:\n"
                            "  - {name: y, kind: line}\ninputs: {columns: [u], hold: zero}\n%s",
                            cases[i].least > 50 ? "mass: diagonal\ninput_map: {kind: known, values: [[1]]}\n"
                                                  "damping: {kind: known, values: [0.3]}\n"
                                                : "mass: {kind: known, values: [1]}\ndamping: diagonal\n"));
        const double unit = cases[i].unit, h = cases[i].h;
        write_pushed("train.csv", cases[i].rows, h, unit, cases[i].push, cases[i].noise, 2);
        write_pushed("test.csv", cases[i].rows, h, unit, cases[i].push, cases[i].noise, 3);
        cli_json(identify, "fit pushed.yaml train.csv --out m.h5", "start_rows >0");
        const double rows = json_number(result.out, "start_rows");
        if (rows < cases[i].least || rows > cases[i].most) fail_msg("case %zu: %g rows", i, rows);
        expect_known_range("m.h5");
        cli_json(identify, "evaluate m.h5 test.csv --horizons .3", "start_rows >0");
        assert_true(json_number(result.out, "start_rows") == rows);
        const char *horizon = strchr(json_find(result.out, "horizons"), '{');
        const double line = json_number(horizon, "line"),
                     linear = json_number(json_find(horizon, "linear"), "line"),
                     unchanged = json_number(json_find(horizon, "unchanged"), "line");
        cli_json(identify, "evaluate m.h5 test.csv --horizons .3 --start-rows 50", "start_rows 50");
        horizon = strchr(json_find(result.out, "horizons"), '{');
        const double usual = json_number(horizon, "line");
        if (cases[i].push > 0) {
            assert_true(line < 0.4 * usual && line < unchanged);
            /* the linear model begins in the same states */
            assert_true(linear < 0.6 * json_number(json_find(horizon, "linear"), "line"));
        }
        if (cases[i].least > 50) assert_true(line < 0.85 * usual);
    }
    cli_json(identify, "predict m.h5 test.csv --out pushed-run.csv --start-rows 7", "start_rows 7");
    const double scored = json_number(json_find(result.out, "free_run"), "y");
    cli_json(identify, "evaluate m.h5 test.csv --start-rows 7", "free_run {");
    assert_close(scored, json_number(json_find(result.out, "free_run"), "y"), 1e-12, 0);
    cli_json(identify, "adapt m.h5 test.csv --seconds 10 --numbers friction --start-rows 9", "start_rows 9");
    cli_run(identify, "evaluate m.h5 test.csv --horizons .3");
    assert_says(result.out, "unchanged");
    assert_says(result.out, "linear");
    assert_null(strstr(result.out, "\\x09"));
    learn_unit();
    cli_json(identify, "evaluate unit.h5 train.csv", "start_rows null");
    cli_expect(identify, "evaluate unit.h5 train.csv --start-rows 9", 2, "no start is estimated");
}

TEST("numbers have errors only if the fit has converged, whatever ended it") {
    static const struct {
        const char *machine, *options;
        bool converged;
    } fits[] = {{"machine.yaml", "", true},
                {"machine.yaml", "--epochs 1", false},
                {"machine.yaml", "--seconds 1e-6", false},
                {"machine.yaml", "--method lbfgs --epochs 3", false},
                {"place.yaml", "", true},
                {"place.yaml", "--epochs 1", false},
                {"place.yaml", "--method ssbroyden --epochs 2", false},
                {"spring.yaml", "--epochs 1", false},
                {"spring.yaml", "--method adam --epochs 3", false}};
    cli_forget("train.csv");
    cli_write("place.yaml", "columns: {time: t, run: run}\nmeasured: positions\ncoordinates:\n"
                            "  - {name: x, kind: line}\ninputs: {columns: [u], hold: zero}\nmass: diagonal\n"
                            "potential: {kind: quadratic, of: x}\ndamping: diagonal\n"
                            "input_map: {kind: known, values: [[1]]}\n");
    cli_write("spring.yaml", oscillator_network);
    cli_run(identify, "generate scene.yaml --runs 3 --t-end 4 --noise 0.01,0.01 --seed 5 --out train.csv");
    for (size_t i = 0; i < LG_COUNT(fits); i++) {
        cli_json(identify, test_text("fit %s train.csv --out m.h5 %s", fits[i].machine, fits[i].options),
                 "errors *");
        const char *mass = json_find(json_find(result.out, "identified"), "mass.1.1");
        json_expect(mass, fits[i].converged ? "error >0" : "error null");
        assert_int_equal(strstr(result.err, "the fit has not converged") != NULL, !fits[i].converged);
        assert_int_equal(strstr(json_find(result.out, "errors"), "has not converged") != NULL,
                         !fits[i].converged);
        assert_int_equal(cli_machine_model("m.h5")->spread != NULL, fits[i].converged);
    }
    cli_expect(identify, "fit spring.yaml train.csv --out m.h5 --epochs 1", 0, "  -\n");
    cli_expect(identify, "predict m.h5 train.csv --out bands.csv --bands", 2, "has no covariance");
}

TEST("a model that is no better than a simple guess causes a warning") {
    cli_forget("train.csv test.csv p.csv log.csv");
    cli_write(
        "stiff.yaml", OSCILLATOR_COLUMNS
        "mass: {kind: known, values: [2]}\npotential: {kind: known, form: quadratic, of: x, values: [90]}\n"
        "damping: {kind: known, values: [0.3]}\ninput_map: {kind: known, values: [[1]]}\n");
    cli_run(identify, "generate scene.yaml --runs 4 --t-end 6 --out train.csv");
    cli_run(identify, "fit machine.yaml train.csv --out m.h5");
    identify_run_quietly("evaluate m.h5 train.csv");
    cli_run(identify, "generate stiff.yaml --runs 4 --t-end 6 --out stiff.csv --start-spread 0.1,0.1");
    cli_json(identify, "evaluate m.h5 stiff.csv --horizons 1,2", "window_loss >0");
    assert_says(result.err, "at 1 s the model's error of line");
    assert_says(result.err, "of a linear model");
    assert_null(strstr(result.err, "at 2 s"));
}

TEST("the sentence on a horizon names a machine that stands still where this one has the smallest error") {
    cli_write("sticks.yaml",
              OSCILLATOR_COLUMNS "mass: {kind: known, values: [2]}\ndamping: {kind: coulomb, values: [1.3]}\n"
                                 "input_map: {kind: known, values: [[1]]}\n");
    cli_run(identify,
            "generate sticks.yaml --runs 8 --t-end 6 --inputs steps --amplitude 1.5 --start-spread 0.3,0 "
            "--seed 3 --out sticks.csv");
    cli_expect(identify, "evaluate m.h5 sticks.csv --horizons 1", 0,
               "Runs of 1 s, error of line: a machine that stands still is better, ");
    cli_expect(identify, "evaluate m.h5 train.csv --horizons 1", 0,
               "Runs of 1 s, error of line: the model is better");
}

TEST("a free run that is not finite is reported, and none of its columns counts as white noise") {
    enum { SIZE = 1 << 15 };
    char *text = lg_test_memory(SIZE);
    /* x'' = 4 x^3: from x = 3 the solution is infinite after .2 s */
    static const double starts[] = {0.02, 3};
    static const char *const files[] = {"near.csv", "far.csv"};
    cli_write("quartic.yaml", "coordinates:\n  - {name: x, kind: line, velocity: vx}\n"
                              "mass: {kind: known, values: [1]}\ndamping: diagonal\npotential: {kind: known, "
                              "form: polynomial, degree: 4, of: x, values: [0, 0, 0, -1]}\n");
    lg_rng rng = test_rng(1, 0);
    for (size_t k = 0; k < LG_COUNT(files); k++) {
        size_t used = (size_t)snprintf(text, SIZE, "t,x,vx\n");
        for (int i = 0; i < 300; i++)
            used += (size_t)snprintf(text + used, SIZE - used, "%.17g,%.17g,%.17g\n", STEP * i,
                                     starts[k] + 1e-3 * lg_rng_normal(&rng), 1e-3 * lg_rng_normal(&rng));
        cli_write(files[k], text);
    }
    cli_json(identify, "fit quartic.yaml near.csv --out m.h5 --starts measured --window 2", "loss >0");
    cli_json(identify, "evaluate m.h5 near.csv", "window_loss >0");
    assert_null(strstr(result.err, "is not finite"));
    cli_json(identify, "evaluate m.h5 far.csv", "window_loss >0");
    assert_says(result.err, "the free run is not finite");
    static const char *const columns[] = {"x", "vx"};
    for (size_t c = 0; c < LG_COUNT(columns); c++) {
        json_expect(json_find(json_find(result.out, "whiteness"), columns[c]), "probability 0");
    }
    cli_expect(identify, "evaluate m.h5 far.csv", 0, "probability");
}

TEST("rows that were used to estimate a start are not scored") {
    enum { SIZE = 1 << 16 };
    char *text = lg_test_memory(SIZE);
    size_t used = (size_t)snprintf(text, SIZE, "run,t,x\n");
    cli_write("still.yaml", "columns: {time: t, run: run}\nmeasured: positions\ncoordinates:\n"
                            "  - {name: x, kind: line}\nmass: {kind: known, values: [1]}\n"
                            "potential: {kind: quadratic, of: x}\n");
    for (int bad = 0; bad < 2; bad++) {
        used = (size_t)snprintf(text, SIZE, "run,t,x\n");
        for (int i = 0; i < 500; i++)
            used += (size_t)snprintf(text + used, SIZE - used, "0,%.17g,%.17g\n", STEP * i,
                                     cos(STEP * i) + (bad && i < 50 ? (i % 2 == 0 ? 0.2 : -0.2) : 0));
        cli_write(bad ? "bad.csv" : "good.csv", text);
    }
    cli_run(identify, "fit still.yaml good.csv --out m.h5");
    cli_json(identify, "evaluate m.h5 bad.csv --horizons 1", "window_loss *");
    const double rms = json_number(json_find(result.out, "free_run"), "x");
    assert_true(rms > 1e-4 && rms < 0.02); /* if all rows were scored: .063 */
}

TEST("angles are compared modulo full turns") {
    enum { SIZE = 1 << 16 };
    char *text = lg_test_memory(SIZE);
    size_t used = (size_t)snprintf(text, SIZE, "t,a\n");
    /* a'' = -.1 a' from a' = 1.5 turns two times; the log has a in one turn */
    for (int i = 0; i < 400; i++) {
        const double a = 15 * (1 - exp(-0.1 * STEP * i)), turn = 6.283185307179586;
        used +=
            (size_t)snprintf(text + used, SIZE - used, "%.17g,%.17g\n", STEP * i, a - turn * floor(a / turn));
        if (i == 99) cli_write("lap.csv", text);
    }
    cli_write("wrapped.csv", text);
    cli_write("spin.yaml", "unwrap: false\nmeasured: positions\ncoordinates:\n  - {name: a, kind: angle}\n"
                           "mass: {kind: known, values: [1]}\ndamping: diagonal\n");
    cli_run(identify, "fit spin.yaml lap.csv --window 50 --out lap.h5");
    cli_json(identify, "evaluate lap.h5 wrapped.csv --horizons 2", "window_loss *");
    json_expect(json_find(result.out, "free_run"), "a <1e-2");
}

/* A pose whose velocity is logged in the inertial frame, and a direction; smooth inputs. */
#define FERRY                                                                                                \
    "columns: {time: t, run: run}\ncoordinates:\n"                                                           \
    "  - {name: hull, kind: pose, position: [x, y, z], columns: [qw, qx, qy, qz], velocity: [vx, vy, vz],\n" \
    "     rates: [wx, wy, wz], frame: space}\n"                                                              \
    "  - {name: rod, kind: direction, columns: [dx, dy, dz], velocity: [ax, ay, az]}\n"                      \
    "inputs: {columns: [f, s], hold: cubic}\n"                                                               \
    "input_map: {kind: known, values: [[1,0],[0,0],[0,1],[0,0],[0,1],[0.2,0],[1,0],[0,1],[0,0]]}\n"

TEST("poses with velocities in the inertial frame, directions and smooth inputs work with all commands") {
    cli_forget("train.csv test.csv p.csv log.csv");
    cli_write("ferry-scene.yaml",
              FERRY "mass: {kind: known, values: [2, 2, 2, 0.5, 0.6, 0.3, 1, 1, 1]}\n"
                    "potential: {kind: known, form: linear, of: rod, values: [0, 0, 3]}\n");
    cli_write("ferry.yaml", FERRY "mass: diagonal\npotential: {kind: linear, of: rod}\n");
    cli_run(identify, "generate ferry-scene.yaml --runs 2 --t-end 2 --out ferry.csv");
    cli_json(identify, "check ferry.yaml ferry.csv", "warnings []");
    json_expect(json_find(result.out, "kinematics"), "hull <1e-2, rod <1e-2");
    cli_json(identify, "fit ferry.yaml ferry.csv --out ferry.h5", "loss <1e-10");
    assert_close(json_number(json_find(json_find(result.out, "identified"), "mass.4.4"), "value"), 0.5, 1e-4,
                 0);
    cli_json(identify, "evaluate ferry.h5 ferry.csv --horizons 1 --plot ferry.svg", "window_loss <1e-10");
    const char *errors = json_find(result.out, "free_run");
    json_expect(errors, "x <1e-4, qw <1e-4, vx <1e-4, wy <1e-4, dz <1e-4, ax <1e-4");
    json_expect(json_find(result.out, "energy"), "left_size <1e-3, change_size >0.1");
    cli_run(identify, "predict ferry.h5 ferry.csv --out run.csv");
    expect_log("ferry.yaml", "ferry.csv", "run.csv", (const char *const[]){"t", "run", "f", "s", NULL},
               (const char *const[]){"x", "y", "z", "vx", "vy", "vz", "wx", "dx", "ay", NULL}, 1e-3);
}

/* Removes the direction from one row of a file with the columns t, run, x, y, z, .... */
static void leave_out_direction(const char *name, size_t row) {
    enum { SIZE = 1 << 17 };
    char *text = lg_test_memory(SIZE), *cell = text;
    (void)cli_read(name, text, SIZE);
    while (row-- > 0) cell = strchr(cell, '\n') + 1;
    for (int k = 0; k < 2; k++) cell = strchr(cell, ',') + 1;
    char *rest = cell;
    for (int k = 0; k < 3; k++) rest = strchr(rest, ',') + 1;
    memset(cell, ',', 3);
    memmove(cell + 3, rest, strlen(rest) + 1);
    cli_write(name, text);
}

TEST("a row without its direction is not counted in the errors of runs") {
    cli_forget("train.csv test.csv p.csv log.csv");
    static const char scene[] =
        "columns: {time: t, run: run}\n"
        "coordinates: [{name: d, kind: direction, columns: [x, y, z], velocity: [a, b, c]}]\n"
        "mass: {kind: known, values: [1, 1, 1]}\n"
        "potential: {kind: known, form: linear, of: d, values: [0, 0, 2]}\n%s";
    cli_write("rod-scene.yaml", test_text(scene, "damping: {kind: known, values: [0.1, 0.1, 0.1]}\n"));
    cli_write("rod.yaml", test_text(scene, "damping: diagonal\n"));
    cli_run(identify, "generate rod-scene.yaml --runs 2 --t-end 3 --out rod.csv");
    cli_run(identify, "fit rod.yaml rod.csv --out rod.h5");
    leave_out_direction("rod.csv", 40);
    cli_json(identify, "evaluate rod.h5 rod.csv --horizons 1", "horizons *");
    json_expect(strchr(json_find(result.out, "horizons"), '{'), "direction <1e-6, velocity <1e-6");
}

TEST_GROUP(setup, cli_end)

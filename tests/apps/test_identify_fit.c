/* ctest-labels: slow apps/lg-identify src/machine src/nn
 * Runs lg-identify fit: estimated numbers and their errors, equal bits, resumption, Ctrl-C, parameters that
 * the logs do not determine, the demo. Of large grids each commit has a part, other commits the others. */
#include "identify_support.h"
#include "liegrad/geometry.h"
#include "support/seed.h"

OWNED(lg_machine_file, lg_machine_file_destroy)

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("scene.yaml", oscillator_scene);
    cli_write("machine.yaml", oscillator_machine);
    cli_write("network.yaml", oscillator_network);
    cli_run(identify, "generate scene.yaml --runs 6 --t-end 6 --out train.csv");
    cli_run(identify, "generate scene.yaml --runs 10 --t-end 10 --noise 0.01 --out noisy.csv");
    return 0;
}

/* ---- estimated numbers ---- */

static const struct {
    const char *name;
    double truth;
} truths[] = {{"mass.1.1", 2}, {"potential.x^2", 2.5}, {"damping.x", 0.3}};

/* Each number must be within `errors` standard errors (or `floor`) of its true value, and each standard error
 * below `part` of the number. */
static void expect_numbers(double errors, double part, double floor) {
    const char *numbers = json_find(result.out, "identified");
    for (size_t i = 0; i < LG_COUNT(truths); i++) {
        const char *number = json_find(numbers, truths[i].name);
        if (number == NULL) fail_msg("%s is not identified: %s", truths[i].name, result.out);
        const double error = json_number(number, "error");
        assert_true(error >= 0 && error < part * truths[i].truth);
        assert_close(json_number(number, "value"), truths[i].truth, 0, errors * error + floor);
    }
}

TEST("fit finds the numbers of a linear oscillator from generated logs, within the stated errors") {
    cli_json(identify, "fit machine.yaml train.csv --out m.h5", "windows >100, parameters 3");
    expect_numbers(0, 1e-4, 1e-5);
    cli_json(identify, "fit machine.yaml noisy.csv --out m.h5", "windows >100, parameters 3");
    expect_numbers(4, 0.02, 0);
    /* The standard errors are not too large: at least one number is off by a quarter of its standard
     * error. */
    const char *numbers = json_find(result.out, "identified");
    double most = 0;
    for (size_t i = 0; i < LG_COUNT(truths); i++) {
        const char *number = json_find(numbers, truths[i].name);
        most =
            fmax(most, fabs(json_number(number, "value") - truths[i].truth) / json_number(number, "error"));
    }
    assert_true(most > 0.25);
}

TEST("a residual, also a polynomial, explains only what the other terms leave over, and does not change "
     "them") {
    cli_write("residual.yaml",
              test_text("%sresidual: {kind: polynomial, degree: 3, of: [x, vx, u]}\n", oscillator_machine));
    cli_json(identify, "fit residual.yaml train.csv --out m.h5 --epochs 20", "parameters 22");
    for (size_t i = 0; i < LG_COUNT(truths); i++) {
        const char *number = json_find(json_find(result.out, "identified"), truths[i].name);
        assert_close(json_number(number, "value"), truths[i].truth, 1e-3, 0);
    }
}

TEST("logs for validation are not used for training, and their loss is reported") {
    cli_run(identify, "generate scene.yaml --runs 2 --t-end 6 --seed 8 --out other.csv");
    cli_json(identify,
             "fit network.yaml train.csv --validation other.csv --out m.h5 --epochs 60 --history losses.csv",
             "validation >0");
    const double windows = json_number(result.out, "windows"), told = json_number(result.out, "validation");
    double losses[60], least = INFINITY; /* of the epoch that is the model */
    const size_t epochs = csv_column("losses.csv", "validation", losses, LG_COUNT(losses));
    for (size_t i = 0; i < epochs; i++) least = fmin(least, losses[i]);
    assert_true(losses[epochs - 1] != least);
    assert_close(told, least, 1e-12, 0);
    assert_close(json_number(result.out, "validation_loss"), least, 1e-12, 0);
    cli_json(identify, "fit network.yaml train.csv --out m.h5 --epochs 5", "validation null");
    assert_close(json_number(result.out, "windows"), windows, 0, 0);
}

TEST("variational steps fit long windows, are stored in the model's file, and are refused if the mass "
     "depends on the state") {
    cli_json(identify,
             "fit machine.yaml train.csv --integrator variational --window 40 --substeps 2 --out v.h5",
             "parameters 3");
    expect_numbers(0, 0.01, 0.02);
    assert_string_equal(cli_machine_model("v.h5")->run.scheme->name, "variational");
    cli_run(identify, "evaluate v.h5 train.csv --horizons 1");
    cli_run(identify, "predict v.h5 train.csv --out run.csv");
    cli_write("moving.yaml",
              OSCILLATOR_COLUMNS "mass: {kind: network, of: x}\ninput_map: {kind: known, values: [[1]]}\n");
    cli_expect(identify, "fit moving.yaml train.csv --integrator variational --out w.h5", 2,
               "masses that do not depend on the state");
    assert_false(cli_exists("w.h5"));
}

/* ---- equal bits ---- */

static void expect_theta(const char *a, const char *b, bool same) {
    const lg_machine_model_file *x = cli_machine_model(a), *y = cli_machine_model(b);
    assert_int_equal(x->parameters, y->parameters);
    const bool equal = memcmp(x->theta, y->theta, x->parameters * sizeof *x->theta) == 0;
    if (equal != same) fail_msg("%s and %s %s", a, b, equal ? "are the same" : "differ");
}

TEST("the same seed gives the same bits with any number of threads, in one run or resumed; another seed "
     "gives other bits") {
    static const char *const options[] = {"--method ssbroyden", "--method lbfgs --starts estimated",
                                          "--method adam:20"};
    for (size_t i = 0; i < LG_COUNT(options); i++) {
        char line[256];
        cli_run(identify, "fit network.yaml train.csv --epochs 20 --threads 1 --seed 4 --out one.h5 %s",
                options[i]);
        cli_run(identify, "fit network.yaml train.csv --epochs 20 --threads 2 --seed 4 --out two.h5 %s",
                options[i]);
        cli_run(identify, "fit network.yaml train.csv --epochs 20 --threads 2 --seed 5 --out other.h5 %s",
                options[i]);
        (void)snprintf(
            line, sizeof line,
            "fit network.yaml train.csv --epochs 20 --seed 4 --stop-after 7 --checkpoint c.h5 --out "
            "half.h5 %s",
            options[i]);
        cli_json(identify, line, "epochs 7");
        cli_json(identify, "fit network.yaml train.csv --resume c.h5 --out resumed.h5", "epochs 20");
        expect_theta("one.h5", "two.h5", true);
        expect_theta("one.h5", "resumed.h5", true);
        expect_theta("one.h5", "other.h5", false);
        expect_theta("one.h5", "half.h5", false);
    }
    cli_expect(identify, "fit network.yaml noisy.csv --resume c.h5 --out r.h5", 2, "from other data");
    cli_expect(identify, "fit network.yaml train.csv --resume c.h5 --window 9 --out r.h5", 2, "window");
    assert_false(cli_exists("r.h5"));
}

TEST("Ctrl-C saves the state of a fit and leaves no model") {
    const cli_child child = cli_start(
        identify,
        "fit network.yaml train.csv --method adam --epochs 1000000 --checkpoint-every 1 --out never.h5", 0);
    cli_wait_for("never.h5.checkpoint");
    cli_interrupt(child);
    assert_says(result.err, "--resume never.h5.checkpoint");
    assert_false(cli_exists("never.h5"));
    cli_json(identify, "fit network.yaml train.csv --resume never.h5.checkpoint --stop-after 1 --out now.h5",
             "epochs >0");
}

TEST("a full disk is reported, and no part of a model is left") {
    cli_expect_limited(identify, "fit machine.yaml train.csv --out big.h5", 4096, 3, "big.h5");
    assert_false(cli_exists("big.h5"));
    cli_expect_limited(identify, "generate scene.yaml --out big.csv", 4096, 3, "big.csv");
    assert_false(cli_exists("big.csv"));
    assert_int_equal(cli_count_files("tmp"), 0);
}

/* ---- parameters that the logs do not determine: a warning, exit code 0 ---- */

TEST("constant inputs do not determine the input map, which is reported") {
    cli_write("map.yaml", OSCILLATOR_COLUMNS "mass: {kind: known, values: [2]}\n"
                                             "potential: {kind: quadratic, of: x}\ndamping: diagonal\n");
    cli_run(identify, "generate scene.yaml --inputs none --runs 3 --t-end 6 --out still.csv");
    cli_json(identify, "fit map.yaml still.csv --out m.h5", "loss <1e-8");
    assert_says(result.err, "column u: the input is always 0");
    assert_says(result.err, "input_map.1.1");
}

TEST("a free common factor is reported, also if networks have it; a known map of an input that is always "
     "0 does not fix it") {
    cli_write("factor.yaml",
              OSCILLATOR_COLUMNS "mass: {kind: network, of: x}\npotential: {kind: network, of: x}\n"
                                 "damping: diagonal\ninput_map: {kind: known, values: [[1]]}\n");
    cli_run(identify, "generate scene.yaml --inputs none --runs 3 --t-end 6 --out still.csv");
    cli_json(identify, "fit factor.yaml still.csv --epochs 40 --out m.h5", "gauge \"nothing: learning left");
    assert_says(result.err, "mass.1.1 and damping.x appear only as a ratio");
    json_expect(json_find(json_find(result.out, "identified"), "mass.1.1"), "error null");
    cli_json(identify, "fit factor.yaml train.csv --epochs 40 --out m.h5", "gauge \"the values");
    json_expect(json_find(json_find(result.out, "identified"), "mass.1.1"), "error <1");
}

/* Writes the log with 30 added to x. */
static void shift_log(const char *from, const char *to) {
    enum { ROWS = 4000, SIZE = 1 << 19 };
    static const char *const columns[] = {"t", "run", "x", "vx", "u"};
    double *cells = lg_test_memory(sizeof *cells * LG_COUNT(columns) * ROWS);
    char *text = lg_test_memory(SIZE);
    size_t rows = 0, used = (size_t)snprintf(text, SIZE, "t,run,x,vx,u\n");
    for (size_t c = 0; c < LG_COUNT(columns); c++)
        rows = csv_column(from, columns[c], cells + c * ROWS, ROWS);
    for (size_t i = 0; i < rows; i++)
        used += (size_t)snprintf(text + used, SIZE - used, "%.17g,%g,%.17g,%.17g,%.17g\n", cells[i],
                                 cells[ROWS + i], cells[2 * ROWS + i] + 30, cells[3 * ROWS + i],
                                 cells[4 * ROWS + i]);
    cli_write(to, text);
}

TEST("the mass of a network is reported at the logged states, with these states") {
    cli_write("push.yaml", OSCILLATOR_COLUMNS "mass: {kind: known, values: [2]}\n"
                                              "input_map: {kind: known, values: [[1]]}\n");
    cli_write("moving.yaml",
              OSCILLATOR_COLUMNS "mass: {kind: network, of: x}\ninput_map: {kind: known, values: [[1]]}\n");
    cli_run(identify,
            "generate push.yaml --runs 8 --t-end 4 --amplitude 4 --noise 0.002,0.01 --out near.csv");
    shift_log("near.csv", "away.csv");
    cli_json(identify, "fit moving.yaml near.csv --out m.h5 --epochs 400", "loss <4, expected_loss <4");
    json_expect(json_find(result.out, "mass_at"), "x [0]");
    cli_json(identify, "fit moving.yaml away.csv --out m.h5 --epochs 400 --seed 2",
             "loss <4, expected_loss <4");
    const double at = strtod(strchr(json_find(json_find(result.out, "mass_at"), "x"), '[') + 1, NULL);
    assert_close(at, 30, 0, 3);
    const char *number = json_find(json_find(result.out, "identified"), "mass.1.1");
    assert_close(json_number(number, "value"), 2, 0.05, 0);
    assert_true(json_number(number, "error") < 0.2);
    assert_null(strstr(result.err, "do not determine"));
    cli_run(identify, "fit moving.yaml away.csv --out m.h5 --epochs 20");
    assert_says(result.out, "mass: of a network, at x ");
    assert_says(result.out, "value  error\n");
    assert_says(result.out, "\nmass.1.1  ");
    assert_says(result.out, "expected_loss                    1.9  of a model that explains the logs");
    cli_run(identify,
            "generate push.yaml --inputs none --runs 8 --t-end 4 --start-spread 1,0 --noise 0.002,0.01 --out "
            "rest.csv");
    shift_log("rest.csv", "away.csv");
    cli_json(identify, "fit moving.yaml away.csv --out m.h5 --epochs 20", "loss <4");
    assert_says(result.err, "the logs do not determine mass.1.1 at x ");
    /* nothing pulls a mass that the logs do not determine away from its start, 1 */
    assert_close(json_number(json_find(json_find(result.out, "identified"), "mass.1.1"), "value"), 1, 0.3, 0);
}

TEST("rows in parts shorter than a window are reported; the end of a longer part is used for training") {
    cli_run(identify, "generate scene.yaml --runs 1 --t-end 24.84 --out long.csv"); /* 1243 rows */
    cli_run(identify, "generate scene.yaml --runs 3 --t-end 0.8 --out short.csv");
    static const struct {
        const char *line, *told;
    } rows[] = {{"fit machine.yaml long.csv --window 500 --stride 499 --epochs 2 --out m.h5", NULL},
                {"fit machine.yaml long.csv short.csv --window 41 --epochs 2 --out m.h5", NULL},
                {"fit machine.yaml long.csv short.csv --window 42 --epochs 2 --out m.h5",
                 "123 of 1366 rows are in no window of 42 rows"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_json(identify, rows[i].line, i == 0 ? "windows 3" : "windows >3");
        assert_int_equal(strstr(result.err, "in no window") != NULL, rows[i].told != NULL);
        if (rows[i].told != NULL) assert_says(result.err, rows[i].told);
    }
}

/* A log of 2 x'' = -5 x - .3 x' + u as another program would write it: integrated by RK4 or by symplectic
 * Euler, with `digits` decimals. */
static void write_foreign(const char *name, bool euler, int digits) {
    enum { ROWS = 900, SIZE = 1 << 18 };
    char *text = lg_test_memory(SIZE);
    const double h = 0.02;
    double x = 1, v = 0, u = 0;
    size_t used = (size_t)snprintf(text, SIZE, "t,run,x,vx,u\n");
    for (int i = 0; i < ROWS; i++) {
        if (i % 25 == 0) u = 4 * sin(i);
        used += (size_t)snprintf(text + used, SIZE - used, "%.6f,0,%.*f,%.*f,%.6f\n", h * i, digits, x,
                                 digits, v, u);
        if (euler) {
            v += h * (u - 0.3 * v - 5 * x) / 2;
            x += h * v;
            continue;
        }
        double dx[4], dv[4];
        for (int k = 0; k < 4; k++) {
            const double at = k == 0   ? 0
                              : k == 3 ? h
                                       : h / 2,
                         y = k > 0 ? x + at * dx[k - 1] : x, w = k > 0 ? v + at * dv[k - 1] : v;
            dx[k] = w, dv[k] = (u - 0.3 * w - 5 * y) / 2;
        }
        x += h / 6 * (dx[0] + 2 * dx[1] + 2 * dx[2] + dx[3]);
        v += h / 6 * (dv[0] + 2 * dv[1] + 2 * dv[2] + dv[3]);
    }
    cli_write(name, text);
}

TEST("a log that contradicts the machine is reported; smooth, rounded, noisy and position logs that "
     "agree are not") {
#define POSITIONS                                                                                            \
    "columns: {time: t, run: run}\nmeasured: positions\ncoordinates:\n  - {name: x, kind: line}\n"           \
    "inputs: {columns: [u], hold: zero}\n"
#define MAP "input_map: {kind: known, values: [[1]]}\n"
    static const struct {
        const char *terms;
        bool told;
    } machines[] = {
        {"mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n" MAP, false},
        {"mass: diagonal\npotential: {kind: quadratic, of: x}\n" MAP, true}, /* no friction */
        /* the wrong friction */
        {"mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: quadratic\n" MAP, true},
        {"mass: diagonal\ndamping: diagonal\n" MAP, true}, /* no spring */
        {"mass: {kind: known, values: [4]}\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n" MAP,
         true},
        {"mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n" MAP "scale: {u: -1}\n",
         true},
        {"mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\ninput_map: {kind: known, "
         "values: [[0]]}\n",
         true}};
    static const char *const heads[] = {OSCILLATOR_COLUMNS, POSITIONS};
    static const char *const logs[] = {"train.csv",   "noisy.csv",   "rk4.csv",    "euler.csv",
                                       "digits6.csv", "digits4.csv", "digits3.csv"};
    const uint64_t part = commit_seed();
    write_foreign("rk4.csv", false, 15);
    write_foreign("euler.csv", true, 15);
    write_foreign("digits6.csv", false, 6);
    write_foreign("digits4.csv", false, 4);
    write_foreign("digits3.csv", false, 3);
    for (size_t h = 0; h < LG_COUNT(heads); h++)
        for (size_t m = 0; m < LG_COUNT(machines); m++)
            for (size_t l = 0; l < LG_COUNT(logs); l++) {
                if ((2 * h + m + l + part) % 4 > 0) continue;
                const char *text = test_text("%s%s", heads[h], machines[m].terms);
                cli_write("tried.yaml", text);
                cli_json(identify, test_text("fit tried.yaml %s --out m.h5", logs[l]),
                         "loss >0, expected_loss >0");
                const bool told = strstr(result.err, "does not explain the logs") != NULL;
                if (told != machines[m].told)
                    fail_msg("%s %s: %s: loss %g of %g", told ? "told" : "not told", logs[l], text,
                             json_number(result.out, "loss"), json_number(result.out, "expected_loss"));
            }
}

/* ---- positions alone ---- */

#define ARM                                                                                                  \
    "columns: {time: t}\n%scoordinates:\n  - {name: q1, kind: angle%s}\n  - {name: q2, kind: angle%s}\n"     \
    "inputs: {columns: [u1, u2]}\nsystem: two-link-arm\n"                                                    \
    "input_map: {kind: known, values: [[1, 0], [0, 1]]}\n"

TEST("positions alone at 400 Hz give the numbers of an arm from starts that are wrong by a factor of 10") {
    static const struct {
        const char *name;
        double truth;
    } numbers[] = {{"c1", 0.2}, {"c2", 0.15}, {"I1", 0.02}, {"I2", 0.01}, {"L", 0.4}};
    /* Plain fits of windows of 15 to 60 rows ended at I1 = 1e4 and c1 = 1e16. */
    cli_write("arm_scene.yaml",
              test_text(ARM "parameters: {masses: [1.2, 0.8], centres: [0.2, 0.15], inertia: [0.02, 0.01], "
                            "length: 0.4, gravity: 9.81}\ndamping: {kind: known, values: [0.05, 0.03]}\n",
                        "", ", velocity: v1", ", velocity: v2"));
    cli_write("arm.yaml",
              test_text(ARM "parameters: {masses: [1.2, 0.8], gravity: 9.81, length: {start: 4, unknown: "
                            "true}, centres: {start: [0.02, 0.015], unknown: true}, inertia: {start: [0.2, "
                            "0.001], unknown: true}}\ndamping: diagonal\n",
                        "measured: positions\n", "", ""));
    cli_run(identify, "generate arm_scene.yaml --inputs multisine --amplitude 2 --runs 1 --t-end 5 "
                      "--dt 0.0025 --seed 1 --noise 0.0002,0 --out arm.csv");
    cli_json(identify, "fit arm.yaml arm.csv --out m.h5", "parameters 7");
    for (size_t i = 0; i < LG_COUNT(numbers); i++) {
        const char *number = json_find(json_find(result.out, "identified"), numbers[i].name);
        assert_close(json_number(number, "value"), numbers[i].truth, 0.02, 0);
    }
}

TEST("a tumbling double pendulum is learned from positions alone: windows grow step by step into chaos") {
    /* When the windows of candidates grew at once, the loss stayed at 55 times what the noise explains. */
#define TUMBLING                                                                                             \
    "columns: {time: t, run: run}\n%scoordinates: [{name: th, kind: angle%s}, {name: a, kind: angle%s}]\n"   \
    "system: two-link-arm\n"
    cli_write("tumbling_scene.yaml",
              test_text(TUMBLING
                        "parameters: {masses: [1, 0.8], centres: [0.1, 0.09], inertia: [0.004, 0.003], "
                        "length: 0.17, gravity: 9.81}\ndamping: {kind: known, values: [0.0005, 0.0002]}\n",
                        "", ", velocity: w", ", velocity: v"));
    cli_write("tumbling.yaml",
              test_text(TUMBLING "parameters: {masses: [1, unknown], centres: unknown, inertia: unknown, "
                                 "length: unknown}\ndamping: diagonal\n",
                        "measured: positions\n", "", ""));
    cli_run(identify, "generate tumbling_scene.yaml --inputs none --runs 2 --t-end 3.5 --dt 0.015 "
                      "--noise 0.002,0 --start-spread 3,10 --seed 8 --out tumbling.csv");
    cli_json(identify, "fit tumbling.yaml tumbling.csv --out m.h5", "parameters 8");
    assert_true(json_number(result.out, "loss") < json_number(result.out, "expected_loss"));
    const char *length = json_find(json_find(result.out, "identified"), "L");
    assert_close(json_number(length, "value"), 0.17, 0.01, 0);
}

/* Copies the runs of a log of the oscillator: positions rounded to steps, or with noise `sd`, a twentieth of
 * them and some gaps left out. One in `spike` rows is an outlier (0: none). */
static void write_positions(const char *name, double step, double sd, size_t spike) {
    enum { ROOM = 4096 };
    static double t[ROOM], run[ROOM], x[ROOM], u[ROOM];
    const size_t rows = csv_column("fine.csv", "t", t, ROOM);
    assert_int_equal(csv_column("fine.csv", "run", run, ROOM), rows);
    assert_int_equal(csv_column("fine.csv", "x", x, ROOM), rows);
    assert_int_equal(csv_column("fine.csv", "u", u, ROOM), rows);
    char *text = TEST_ARRAY(char, 100 * (rows + 1));
    size_t used = (size_t)sprintf(text, "t,run,x,u\n");
    lg_rng rng;
    lg_rng_seed(&rng, 5, 0);
    for (size_t i = 0; i < rows; i++) {
        double y = step > 0 ? step * round(x[i] / step) : x[i] + sd * lg_rng_normal(&rng);
        if (spike > 0 && i % spike == spike / 2) y += (i % 2 ? 1 : -1) * lg_rng_uniform_in(&rng, 0.1, 2);
        const bool lost = sd > 0 && (lg_rng_uniform(&rng) < 0.05 || i % 700 < 15);
        used += (size_t)sprintf(text + used, "%.17g,%g,", t[i], run[i]);
        if (!lost) used += (size_t)sprintf(text + used, "%.17g", y);
        used += (size_t)sprintf(text + used, ",%.17g\n", u[i]);
    }
    cli_write(name, text);
}

TEST("coarse encoders, motion capture with dropouts, and outliers give the numbers within their errors") {
    static const char *const logs[] = {"steps.csv", "coarse.csv", "dropouts.csv", "outliers.csv"};
    cli_run(identify, "generate scene.yaml --inputs multisine --runs 4 --t-end 10 --dt 0.01 --out fine.csv");
    write_positions(logs[0], 0.01, 0, 0);
    write_positions(logs[1], 0.05, 0, 0);
    write_positions(logs[2], 0, 0.001, 0);
    write_positions(logs[3], 0, 0.001, 97);
    cli_write("alone.yaml", POSITIONS "mass: diagonal\npotential: {kind: quadratic, of: x}\n"
                                      "damping: diagonal\n" MAP);
    for (size_t i = 0; i < LG_COUNT(logs); i++) {
        cli_json(identify, test_text("fit alone.yaml %s --out m.h5", logs[i]), "parameters 3");
        expect_numbers(4, 0.1, 0);
        if (strstr(result.err, "does not explain") != NULL) fail_msg("%s: %s", logs[i], result.err);
    }
    cli_json(identify, "check alone.yaml coarse.csv", "rows >1000");
    assert_close(json_number(json_find(json_find(result.out, "columns"), "x"), "noise"), 0.05 / sqrt(12),
                 1e-9, 0);
}

/* ---- velocities alone ---- */

TEST("a drive is learned from its speed alone; what depends on a position is refused") {
#define DRIVE                                                                                                \
    "columns: {time: t, run: run}\n%scoordinates:\n  - {name: x, kind: line, velocity: vx}\n"                \
    "inputs: {columns: [u]}\ninput_map: {kind: known, values: [[1]]}\n"
    cli_write("drive_scene.yaml", test_text(DRIVE "mass: {kind: known, values: [2]}\ndamping: {kind: known, "
                                                  "values: [0.3]}\n",
                                            ""));
    cli_run(identify, "generate drive_scene.yaml --runs 3 --t-end 6 --noise 0,0.01 --out drive.csv");
    cli_write("drive.yaml",
              test_text(DRIVE "mass: diagonal\ndamping: diagonal\n", "measured: velocities-only\n"));
    cli_json(identify, "fit drive.yaml drive.csv --out m.h5", "parameters 2");
    expect_known_range("m.h5");
    const char *numbers = json_find(result.out, "identified");
    const char *mass = json_find(numbers, "mass.1.1"), *damping = json_find(numbers, "damping.x");
    assert_close(json_number(mass, "value"), 2, 0, 4 * json_number(mass, "error"));
    assert_close(json_number(damping, "value"), 0.3, 0, 4 * json_number(damping, "error"));
    assert_true(json_number(mass, "error") < 0.1 && json_number(damping, "error") < 0.05);
    cli_write("spring.yaml", test_text(DRIVE "mass: diagonal\npotential: {kind: quadratic, of: x}\n",
                                       "measured: velocities-only\n"));
    cli_expect(identify, "fit spring.yaml drive.csv --out m.h5", 3,
               "potential: depends on the position of x");
}

/* ---- forces that the model lacks ---- */

/* The equations of motion for the coordinates x and y (or x alone) with unit masses. y[4] = x, y, x', y'; out
 * = x'', y''. */
typedef void field(const double *y, double *out);
static void cubic(const double *y, double c, double *out) {
    out[0] = -4 * y[0] - c * y[0] * y[0] * y[0] - 0.3 * y[2];
}
static void weak_cubic(const double *y, double *out) {
    cubic(y, 0.03, out);
}
static void some_cubic(const double *y, double *out) {
    cubic(y, 0.3, out);
}
static void strong_cubic(const double *y, double *out) {
    cubic(y, 3, out);
}
static void damped(const double *y, double *out) {
    out[0] = -4 * y[0] - 0.03 * y[2];
}
static void rubbed(const double *y, double *out) {
    out[0] = -4 * y[0] - 0.3 * y[2] - 0.1 * tanh(y[2] / 0.02);
}
static void swung(const double *y, double *out) {
    out[0] = -9 * sin(0.2 * y[0]) / 0.2 - 0.1 * y[2];
}
static void pushed(const double *y, double *out) {
    out[0] = 0.02 - 4 * y[0] - 0.3 * y[2];
}
static void coupled(const double *y, double *out) {
    out[0] = -4 * y[0] - 0.1 * (y[0] - y[1]) - 0.2 * y[2];
    out[1] = -6 * y[1] - 0.1 * (y[1] - y[0]) - 0.1 * y[3];
}

static void run_on(field *f, double h, double *y) {
    static const double share[] = {0, 0.5, 0.5, 1};
    double at[4], slope[4] = {0}, sum[4] = {0}, acceleration[2] = {0};
    for (int k = 0; k < 4; k++) {
        for (int i = 0; i < 4; i++) at[i] = y[i] + share[k] * h * slope[i];
        f(at, acceleration);
        for (int i = 0; i < 2; i++) slope[i] = at[2 + i], slope[2 + i] = acceleration[i];
        for (int i = 0; i < 4; i++) sum[i] += (k == 0 || k == 3 ? 1 : 2) * slope[i];
    }
    for (int i = 0; i < 4; i++) y[i] += h / 6 * sum[i];
}

/* Writes a log of three runs of 10 s. Every column has noise of this size and is rounded to `digits`
 * decimals. */
static void write_motion(const char *name, field *f, bool velocities, int columns, double noise, int digits,
                         uint64_t seed) {
    enum { RUNS = 3, ROWS = 501, FINE = 8, SIZE = 1 << 19 };
    char *text = lg_test_memory(SIZE);
    lg_rng starts, rng;
    lg_rng_seed(&starts, seed, 0);
    lg_rng_seed(&rng, seed, 1);
    size_t used = (size_t)snprintf(text, SIZE, "t,run,x%s%s%s\n", columns > 1 ? ",y" : "",
                                   velocities ? ",vx" : "", velocities && columns > 1 ? ",vy" : "");
    for (int run = 0; run < RUNS; run++) {
        double y[4];
        for (int i = 0; i < 4; i++) y[i] = lg_rng_normal(&starts);
        for (int row = 0; row < ROWS; row++) {
            used += (size_t)snprintf(text + used, SIZE - used, "%.2f,%d", 0.02 * row, run);
            for (int i = 0; i < (velocities ? 4 : 2); i++)
                if (i % 2 < columns)
                    used += (size_t)snprintf(text + used, SIZE - used, ",%.*f", digits,
                                             y[i] + noise * lg_rng_normal(&rng));
            used += (size_t)snprintf(text + used, SIZE - used, "\n");
            for (int k = 0; k < FINE; k++) run_on(f, 0.02 / FINE, y);
        }
    }
    cli_write(name, text);
}

#define LINES(MORE_X, MORE_Y) "  - {name: x, kind: line" MORE_X "}\n", "  - {name: y, kind: line" MORE_Y "}\n"
#define OWN                   "mass: {kind: known, values: [1]}\n"
#define SPRING                OWN "potential: {kind: quadratic, of: x}\n"
#define FOURTH                OWN "potential: {kind: polynomial, of: x, degree: 4}\n"
#define SPRINGS(OF)           "mass: {kind: known, values: [1, 1]}\npotential: " OF "\n"
static const struct {
    field *of;
    int columns;
    /* descriptions of a model with the force and of one without it; NULL: there is none */
    const char *right, *wrong;
} lacking[] = {{weak_cubic, 1, FOURTH "damping: diagonal\n", SPRING "damping: diagonal\n"},
               {some_cubic, 1, FOURTH "damping: diagonal\n", SPRING "damping: diagonal\n"},
               {strong_cubic, 1, FOURTH "damping: diagonal\n", SPRING "damping: diagonal\n"},
               {damped, 1, SPRING "damping: diagonal\n", SPRING},
               {rubbed, 1, SPRING "damping: {kind: diagonal, coulomb: true, coulomb_width: 0.02}\n",
                SPRING "damping: diagonal\n"},
               {pushed, 1,
                OWN "potential: [{kind: linear, of: x}, {kind: quadratic, of: x}]\ndamping: diagonal\n",
                SPRING "damping: diagonal\n"},
               {swung, 1, NULL, SPRING "damping: diagonal\n"},
               {coupled, 2, SPRINGS("{kind: quadratic, of: [x, y]}") "damping: diagonal\n",
                SPRINGS("[{kind: quadratic, of: x}, {kind: quadratic, of: y}]") "damping: diagonal\n"}};

static void expect_lacking(size_t row, bool velocities, double noise, int digits, bool wrong) {
    static const char *const lines[][2] = {{LINES("", "")}, {LINES(", velocity: vx", ", velocity: vy")}};
    const char *terms = wrong ? lacking[row].wrong : lacking[row].right;
    if (terms == NULL) return;
    cli_write("tried.yaml", test_text("columns: {time: t, run: run}\n%scoordinates:\n%s%s%s",
                                      velocities ? "" : "measured: positions\n", lines[velocities][0],
                                      lacking[row].columns > 1 ? lines[velocities][1] : "", terms));
    cli_json(identify, "fit tried.yaml motion.csv --out m.h5", "loss >0");
    const bool told = strstr(result.err, "does not explain the logs") != NULL;
    if (told != wrong)
        fail_msg("%s of row %zu, %s, noise %g, %d decimals, was %stold: loss %g of %g: %s",
                 wrong ? "the wrong model" : "the right model", row, velocities ? "velocities" : "positions",
                 noise, digits, told ? "" : "not ", json_number(result.out, "loss"),
                 json_number(result.out, "expected_loss"), result.err);
}

TEST("forces that the model lacks are reported unless noise hides them; a right model is never reported") {
    static const struct {
        double noise;
        int digits;
        bool seen; /* every missing force must be reported */
    } kinds[] = {{0, 15, true}, {1e-6, 15, true},  {1e-4, 15, true},  {0, 6, true},      {0, 4, true},
                 {0, 3, false}, {1e-3, 15, false}, {1e-2, 15, false}, {0.05, 15, false}, {0, 2, false}};
    const uint64_t part = commit_seed();
    for (size_t row = 0; row < LG_COUNT(lacking); row++)
        for (size_t k = 0; k < LG_COUNT(kinds); k++)
            for (int velocities = 0; velocities < 2; velocities++) {
                const double noise = kinds[k].noise;
                /* from positions alone with so much noise, some fits end in another minimum with 30 times the
                 * loss */
                if ((noise > 0.02 && velocities == 0) ||
                    (3 * row + 2 * k + (size_t)velocities + part) % 5 > 0)
                    continue;
                write_motion("motion.csv", lacking[row].of, velocities != 0, lacking[row].columns, noise,
                             kinds[k].digits, 1 + k);
                expect_lacking(row, velocities != 0, noise, kinds[k].digits, false);
                if (kinds[k].seen) expect_lacking(row, velocities != 0, noise, kinds[k].digits, true);
            }
}

TEST("the warning says how large the missing forces are, and the errors are corrected for what they make") {
    double part[2];
    for (size_t row = 0; row < 2; row++) { /* the second cubic spring is ten times as strong as the first */
        write_motion("motion.csv", lacking[row].of, false, 1, 0, 15, 1);
        expect_lacking(row, false, 0, 15, true);
        const char *number = json_find(json_find(result.out, "identified"), "potential.x^2");
        assert_true(fabs(json_number(number, "value") - 2) < 10 * json_number(number, "error"));
        assert_says(result.out, "corrected for correlation");
        const char *about = strstr(result.err, "about ");
        assert_non_null(about);
        part[row] = strtod(about + strlen("about "), NULL);
    }
    /* percent: .03 x^3 relative to 4 x, minus the part that a linear spring fits */
    assert_close(part[0], 0.4, 0.5, 0);
    assert_close(part[1] / part[0], 10, 0.3, 0); /* the fitted linear spring differs too */
}

TEST("a loss near the error of the steps is told where this error matters") {
    static const struct {
        const char *stiffness;
        bool told;
    } rows[] = {{"200", true}, {"1", false}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_write("exact.yaml", test_text(OSCILLATOR_COLUMNS
                                          "mass: {kind: known, values: [1]}\npotential: {kind: known, form: "
                                          "quadratic, of: x, values: [%s]}\n" MAP,
                                          rows[i].stiffness));
        cli_run(identify, "generate exact.yaml --runs 4 --t-end 4 --start-spread 0.1,0.1 --out exact.csv");
        cli_json(identify, "fit machine.yaml exact.csv --out m.h5 --substeps 1", "loss >0");
        assert_int_equal(strstr(result.err, "give --substeps 2 for a better model") != NULL, rows[i].told);
    }
}

TEST("steps that are too long for a stiff machine are reported once, and do not excuse its large loss") {
    cli_write("stiff-scene.yaml", OSCILLATOR_COLUMNS
              "mass: {kind: known, values: [1]}\npotential: {kind: known, form: quadratic, of: "
              "x, values: [1000]}\ndamping: {kind: known, values: [300]}\n" MAP);
    cli_run(identify,
            "generate stiff-scene.yaml --runs 4 --t-end 4 --amplitude 500 --start-spread 0.1,0.1 --out "
            "stiff.csv");
    static const struct {
        const char *line;
        bool told;
    } rows[] = {{"fit machine.yaml stiff.csv --out m.h5", true},
                {"fit machine.yaml stiff.csv --out m.h5 --substeps 1", true},
                {"fit machine.yaml stiff.csv --out m.h5 --substeps 20", false}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_json(identify, rows[i].line, "loss >0");
        assert_int_equal(strstr(result.err, "the integrator's steps are too long") != NULL, rows[i].told);
        assert_null(strstr(result.err, "does not explain the logs"));
        assert_int_equal(json_number(result.out, "loss") > 1.5 * json_number(result.out, "expected_loss"),
                         rows[i].told);
        const double off =
            json_number(json_find(json_find(result.out, "identified"), "mass.1.1"), "value") - 1;
        assert_int_equal(fabs(off) > 0.01, rows[i].told);
    }
}

#define PENDULUM                                                                                             \
    "columns: {time: t, run: run}\n"                                                                         \
    "coordinates: [{name: d, kind: direction, columns: [x, y, z], velocity: [a, b, c]}]\n"                   \
    "mass: {kind: known, values: [1, 1, 1]}\n"

TEST("the loss of a direction is what its noise explains: for any attitude, speed, starts and windows") {
    static const struct {
        double position, velocity; /* noise */
        const char *spread, *options;
    } rows[] = {{0.01, 0.02, "0.3,1", ""},
                {0.01, 0.02, "2,3", ""},
                {0.01, 0.001, "0.3,3", ""}, /* omega dq is 30 times the noise of omega */
                {0.001, 0.05, "2,1", ""},
                {0.01, 0.02, "2,3", "--window 3 --starts estimated"},
                {0.01, 0.02, "2,3", "--window 4 --starts measured"},
                {0.01, 0.02, "0.3,1", "--window 4 --starts measured"},
                {0.01, 0.02, "2,6", "--window 40 --starts estimated"}};
    cli_write("bob-scene.yaml", PENDULUM "potential: [{kind: known, form: gravity, of: d, values: [9.81]}]\n"
                                         "damping: {kind: known, values: [0.2, 0.2, 0.2]}\n");
    const uint64_t part = commit_seed();
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const int seed = 2 + (int)((i + part) % 2);
        char yaml[1024];
        (void)snprintf(yaml, sizeof yaml,
                       PENDULUM "potential: {kind: gravity, of: d}\ndamping: diagonal\n"
                                "noise: {x: %g, y: %g, z: %g, a: %g, b: %g, c: %g}\n",
                       rows[i].position, rows[i].position, rows[i].position, rows[i].velocity,
                       rows[i].velocity, rows[i].velocity);
        cli_write("bob.yaml", yaml);
        cli_run(identify,
                "generate bob-scene.yaml --noise %g,%g --runs 8 --t-end 6 --start-spread %s --seed %d --out "
                "bob.csv",
                rows[i].position, rows[i].velocity, rows[i].spread, seed);
        cli_run(identify, "fit bob.yaml bob.csv --out m.h5 --json %s", rows[i].options);
        const double ratio = json_number(result.out, "loss") / json_number(result.out, "expected_loss");
        if (!(fabs(ratio - 1) < 0.04)) fail_msg("row %zu, seed %d: %.3f of what is expected", i, seed, ratio);
        assert_null(strstr(result.err, "does not explain"));
    }
}

TEST("noise of positions is taken into account however far the machine travels") {
    cli_write("sledge.yaml", OSCILLATOR_COLUMNS "mass: {kind: known, values: [2]}\n"
                                                "damping: {kind: known, values: [0.1]}\n"
                                                "input_map: {kind: known, values: [[1]]}\n");
    cli_write("slide.yaml", OSCILLATOR_COLUMNS "mass: diagonal\ndamping: diagonal\n"
                                               "input_map: {kind: known, values: [[1]]}\n");
    cli_run(
        identify,
        "generate sledge.yaml --runs 4 --t-end 8 --amplitude 2 --start-spread 1,20 --noise 0.002,0.002 --out "
        "far.csv");
    cli_json(identify, "fit slide.yaml far.csv --out m.h5", "loss >0.5, loss <4, starts \"estimated\"");
    cli_run(identify,
            "generate sledge.yaml --runs 4 --t-end 8 --amplitude 2 --start-spread 1,20 --out far.csv");
    cli_json(identify, "fit slide.yaml far.csv --out m.h5", "loss <1e-8, starts \"measured\"");
}

TEST("a coordinate that never moves is named") {
    enum { SIZE = 1 << 15 };
    char *text = lg_test_memory(SIZE);
    size_t used = (size_t)snprintf(text, SIZE, "t,x,vx,y,vy\n");
    for (int i = 0; i < 300; i++)
        used += (size_t)snprintf(text + used, SIZE - used, "%.6g,%.12g,%.12g,1,0\n", 0.02 * i, sin(0.02 * i),
                                 cos(0.02 * i));
    cli_write("y.csv", text);
    cli_write("y.yaml", "coordinates:\n  - {name: x, kind: line, velocity: vx}\n"
                        "  - {name: y, kind: line, velocity: vy}\nmass: diagonal\n"
                        "potential: {kind: quadratic, of: x}\n");
    cli_json(identify, "fit y.yaml y.csv --out m.h5", "loss <1e-6");
    assert_says(result.err, "coordinate y never moves");
}

TEST("logs without accelerations are refused: at rest, and with constant velocities") {
    static const double speeds[] = {0.0, 0.5, -256.0};
    enum { SIZE = 1 << 15 };
    char *text = lg_test_memory(SIZE);
    cli_write("x.yaml", "coordinates: [{name: x, kind: line, velocity: vx}]\nmass: diagonal\n"
                        "potential: {kind: quadratic, of: x}\n");
    for (size_t k = 0; k < LG_COUNT(speeds); k++) {
        size_t used = (size_t)snprintf(text, SIZE, "t,x,vx\n");
        for (int i = 0; i < 300; i++)
            used += (size_t)snprintf(text + used, SIZE - used, "%.6g,%.17g,%.17g\n", i / 64.0,
                                     1 + speeds[k] * i / 64.0, speeds[k]);
        cli_write("x.csv", text);
        cli_expect(identify, "fit x.yaml x.csv --out m.h5", 3,
                   k == 0 ? "nothing moves in the logs" : "all velocities are constant in the logs");
    }
}

TEST("if mass and input map are both free, one factor is fixed by a convention (gauge) that is reported") {
    cli_write("free.yaml", OSCILLATOR_COLUMNS "mass: diagonal\npotential: {kind: quadratic, of: x}\n"
                                              "damping: diagonal\ninput_map: constant\n");
    cli_json(identify, "fit free.yaml train.csv --out m.h5", "loss <1e-8, gauge \"");
    assert_says(result.err, "factor");
    const char *numbers = json_find(result.out, "identified");
    assert_close(json_number(json_find(numbers, "mass.1.1"), "value"), 1, 1e-12, 0);
    assert_close(json_number(json_find(numbers, "input_map.1.1"), "value"), 0.5, 1e-4, 0);
    assert_close(json_number(json_find(numbers, "potential.x^2"), "value"), 1.25, 1e-4, 0);
    assert_close(json_number(json_find(numbers, "damping.x"), "value"), 0.15, 1e-4, 0);
}

/* ---- machines given as named systems ---- */

#define TOP_COLUMNS                                                                                          \
    "columns: {run: run}\ncoordinates:\n  - {name: top, kind: rotation, columns: [a, b, c, d], "             \
    "velocity: [wx, wy, wz]}\nsystem: heavy-top\n"

TEST("generate and fit a heavy top by name: numbers with errors, undetermined parameters, predictions of "
     "the model") {
    static const struct {
        const char *name;
        double truth;
    } expected[] = {{"L", 0.25},           {"I2", 0.4},   {"I3", 0.2},
                    {"chi2", 0.6},         {"chi3", 0.8}, {"damping.top.1", 0.1},
                    {"damping.top.3", 0.2}};
    cli_write("top.yaml",
              TOP_COLUMNS "parameters: {mass: 0.8, length: 0.25, inertia: [0.3, 0.4, 0.2], chi: [0, 0.6, "
                          "0.8]}\ndamping: {kind: known, values: [0.1, 0.1, 0.2]}\n");
    cli_write("learn.yaml",
              TOP_COLUMNS "parameters: {mass: 0.8, length: {start: 0.5}, inertia: [0.3, unknown, unknown],\n"
                          "  chi: {start: [0, 1, 0], unknown: true}}\ndamping: diagonal\n");
    cli_write("open.yaml", TOP_COLUMNS "parameters: {mass: {start: 1}, length: {start: 0.5}, inertia: [0.3, "
                                       "0.4, 0.2], chi: [0, 0.6, 0.8]}\ndamping: diagonal\n");
    cli_run(identify, "generate top.yaml --runs 6 --t-end 3 --out top.csv");
    cli_run(identify, "generate top.yaml --runs 6 --t-end 3 --noise 0.002,0.02 --out shaken.csv");
    cli_json(identify, "fit learn.yaml top.csv --out top.h5", "loss <1e-8, parameters 8, gauge \"the values");
    const char *numbers = json_find(result.out, "identified");
    for (size_t i = 0; i < LG_COUNT(expected); i++)
        assert_close(json_number(json_find(numbers, expected[i].name), "value"), expected[i].truth, 1e-6, 0);
    cli_json(identify, "fit learn.yaml shaken.csv --out top.h5", "loss <10");
    numbers = json_find(result.out, "identified");
    for (size_t i = 0; i < LG_COUNT(expected); i++) {
        const double error = json_number(json_find(numbers, expected[i].name), "error");
        assert_true(error > 0 && error < 0.1 * expected[i].truth);
        assert_close(json_number(json_find(numbers, expected[i].name), "value"), expected[i].truth, 0,
                     4 * error);
    }
    const char *correlations = json_find(result.out, "correlations");
    assert_close(json_number(correlations, "chi2,chi3"), -1, 1e-3, 0); /* because chi has length 1 */
    cli_json(identify, "evaluate top.h5 shaken.csv --horizons 1", "");
    cli_run(identify, "predict top.h5 top.csv --out again.csv");
    cli_json(identify, "fit open.yaml shaken.csv --out open.h5", "loss <10, gauge \"nothing: learning left");
    assert_says(result.err, "m and L appear only as a product: give one of them as known");
    assert_null(strstr(result.err, "do not determine m"));
    cli_write("far.yaml", TOP_COLUMNS "parameters: {length: unknown, inertia: [0.3, unknown, unknown], chi: "
                                      /* the mass is not given, so it has its default, 15 kg */
                                      "unknown}\ndamping: diagonal\n");
    cli_json(identify, "fit far.yaml top.csv --out far.h5", "loss <1e-8");
    numbers = json_find(result.out, "identified");
    assert_close(json_number(json_find(numbers, "L"), "value"), 0.25 * 0.8 / 15, 1e-6, 0);
    assert_close(json_number(json_find(numbers, "I2"), "value"), 0.4, 1e-6, 0);
    cli_write("known.yaml", TOP_COLUMNS);
    cli_expect(identify, "fit known.yaml top.csv --out k.h5", 2, "everything is known");
}

/* A pendulum without friction, whose torque is switched with the sign of its velocity: 15 s in rows of
 * 5 ms. */
static void write_switched(uint64_t seed) {
    enum { ROWS = 3000, STEPS = 10 };
    const double interval = 5e-3, h = interval / STEPS, inertia = 0.3, weight = 6, torque = 0.9;
    double q = 0, v = 0.01, u = torque, way = 1;
    lg_rng rng = test_rng(63, seed);
    FILE *file = fopen(cli_at("switched.csv"), "w");
    assert_non_null(file);
    (void)fprintf(file, "t,q,v,u\n");
    for (int k = 0; k < ROWS; k++) {
        const double energy = 0.5 * inertia * v * v - weight * cos(q);
        if (energy > 5.5) way = -1;
        if (energy < -4) way = 1;
        if (fabs(v) > 0.3) u = copysign(torque, v) * way;
        (void)fprintf(file, "%.9g,%.9g,%.9g,%.9g\n", k * interval, q + 8e-4 * lg_rng_normal(&rng),
                      v + 0.1 * lg_rng_normal(&rng), u);
        for (int i = 0; i < STEPS; i++) {
            const double middle = v + 0.5 * h * (u - weight * sin(q)) / inertia;
            v += h * (u - weight * sin(q + 0.5 * h * v)) / inertia;
            q += h * middle;
        }
    }
    assert_int_equal(fclose(file), 0);
}

TEST("friction that short windows take for 0 does not stop the fit, whatever the noise") {
    cli_write("switched.yaml", "coordinates:\n  - {name: q, kind: angle, velocity: v}\n"
                               "inputs: {columns: [u], hold: zero}\nmass: diagonal\n"
                               "potential: {kind: gravity, of: q}\ndamping: [diagonal, coulomb]\n"
                               "input_map: {kind: known, values: [[1]]}\n");
    for (uint64_t seed = commit_seed() % 4; seed < 8; seed += 4) {
        write_switched(seed);
        cli_json(identify, "fit switched.yaml switched.csv --out m.h5", "parameters 5");
        const double loss = json_number(result.out, "loss"),
                     expected = json_number(result.out, "expected_loss");
        if (!(loss < 1.5 * expected)) fail_msg("seed %d: loss %g, of noise %g", (int)seed, loss, expected);
        assert_close(json_number(json_find(json_find(result.out, "identified"), "mass.1.1"), "value"), 0.3,
                     0.1, 0);
    }
}

TEST("an oscillator of 5 mg is learned from starting values of 1 for masses and springs") {
    cli_write("tiny.yaml", OSCILLATOR_COLUMNS
              "system: oscillator\nparameters: {mass: 5.0e-6, stiffness: 2.0e-3}\n"
              "damping: {kind: known, values: [1.0e-5]}\ninput_map: {kind: known, values: [[1]]}\n");
    cli_write("far.yaml",
              OSCILLATOR_COLUMNS "system: oscillator\nparameters: {mass: unknown, stiffness: unknown}\n"
                                 "damping: diagonal\ninput_map: {kind: known, values: [[1]]}\n");
    cli_run(
        identify,
        "generate tiny.yaml --runs 4 --t-end 2 --dt 0.005 --amplitude 1e-6 --start-spread 1e-3,1e-2 --out "
        "tiny.csv");
    cli_json(identify, "fit far.yaml tiny.csv --out tiny.h5 --substeps 4", "parameters 3");
    const char *numbers = json_find(result.out, "identified");
    assert_close(json_number(json_find(numbers, "m"), "value"), 5e-6, 1e-6, 0);
    assert_close(json_number(json_find(numbers, "k"), "value"), 2e-3, 1e-6, 0);
    assert_close(json_number(json_find(numbers, "damping.x"), "value"), 1e-5, 1e-6, 0);
}

/* ---- the demo ---- */

static void record_energies(const lg_machine *machine, const double *theta, const double *q, uint32_t count,
                            double *out) {
    lg_tape *tape = test_tape(LG_F64);
    lg_machine_vars vars;
    lg_var parts[LG_TAPED_MAX_PARTS];
    const double *still = TEST_ARRAY(double, 3 * count);
    const uint32_t n = (uint32_t)machine->parameters;
    assert_ok(
        lg_machine_bind(tape, machine, n > 0 ? lg_parameter(tape, lg_shape1(n), theta) : LG_NONE, &vars));
    assert_ok(lg_machine_record_state(tape, &vars, lg_input_f64(tape, lg_shape2(count, 9), q),
                                      lg_input_f64(tape, lg_shape2(count, 3), still), parts));
    assert_ok(lg_read(tape, lg_machine_record_energy(tape, &vars, parts), count, out));
    for (uint32_t i = 0; i < count; i++) out[i] *= machine->scales.energy;
}

static double spread(const double *x, size_t count) {
    double mean = 0, sum = 0;
    for (size_t i = 0; i < count; i++) mean += x[i] / (double)count;
    for (size_t i = 0; i < count; i++) sum += (x[i] - mean) * (x[i] - mean);
    return sqrt(sum / (double)count);
}

/* Standard deviation of the potentials' difference over random attitudes, relative to the true
 * potential's. */
static double potential_error(const lg_machine *learned, const double *theta, const lg_machine *truth) {
    enum { ATTITUDES = 400 };
    double q[9 * ATTITUDES], a[ATTITUDES], b[ATTITUDES];
    lg_rng rng;
    lg_rng_seed(&rng, 1, 7);
    for (size_t i = 0; i < ATTITUDES; i++) {
        double turn[3];
        for (int k = 0; k < 3; k++) turn[k] = 2 * lg_rng_normal(&rng);
        lg_so3_exp(turn, q + 9 * i);
    }
    record_energies(learned, theta, q, ATTITUDES, a);
    record_energies(truth, NULL, q, ATTITUDES, b);
    for (size_t i = 0; i < ATTITUDES; i++) a[i] -= b[i];
    return spread(a, ATTITUDES) / spread(b, ATTITUDES);
}

TEST("the demo learns a body from a log and controls the true body with the model") {
    static const struct {
        const char *name;
        lg_machine_part part;
        size_t at;
    } numbers[] = {{"mass.1.1", LG_MACHINE_MASS, 0},
                   {"mass.2.2", LG_MACHINE_MASS, 1},
                   {"mass.3.3", LG_MACHINE_MASS, 2},
                   {"damping.body.1", LG_MACHINE_DAMPING, 0}};
    cli_needs_programs();
    cli_json(identify, "demo --out shown --seconds 600 --epochs 40", "starts 500, succeeded 500");
    const lg_machine_model_file *model = cli_machine_model("shown/model.h5");
    lg_machine_file file;
    assert_ok(lg_machine_file_read(NULL, cli_at("shown/truth.yaml"), &file, NULL));
    const lg_machine_file *truth = own_lg_machine_file(file);
    lg_identified found[16];
    const size_t count = lg_machine_numbers(&model->run.machine, model->theta, LG_COUNT(found), found);
    for (size_t i = 0; i < LG_COUNT(numbers); i++) {
        const lg_machine_term *term = truth->machine.terms;
        size_t k = 0;
        while (term->part != numbers[i].part) term++;
        while (k < count && strcmp(found[k].name, numbers[i].name) != 0) k++;
        if (k == count) fail_msg("%s is not identified", numbers[i].name);
        assert_close(found[k].value, term->values[numbers[i].at], 0.05, 0);
    }
    assert_true(potential_error(&model->run.machine, model->theta, &truth->machine) < 0.1);
    static const char *const files[] = {"machine.yaml", "train.csv",     "model.h5",
                                        "learned.svg",  "predicted.csv", "policy.h5"};
    for (size_t i = 0; i < LG_COUNT(files); i++) {
        const char *path = test_text("shown/%s", files[i]);
        if (!cli_exists(path)) fail_msg("%s is not there", path);
    }
    cli_run(identify, "demo --help");
}

static int finish(void **state) {
    static const char *const names[] = {"truth.yaml", "machine.yaml",  "train.csv", "test.csv",
                                        "model.h5",   "predicted.csv", "task.yaml", "policy.h5"};
    static const char *const plots[] = {"log", "fit", "learned", "predicted"};
    static const char *const endings[] = {"svg", "dat", "gp"};
    char path[1024], name[64];
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        (void)snprintf(name, sizeof name, "shown/%s", names[i]);
        cli_path(name, path, sizeof path);
        (void)unlink(path);
    }
    for (size_t i = 0; i < LG_COUNT(plots) * LG_COUNT(endings); i++) {
        (void)snprintf(name, sizeof name, "shown/%s.%s", plots[i / 3], endings[i % 3]);
        cli_path(name, path, sizeof path);
        (void)unlink(path);
    }
    return cli_end(state);
}

TEST_GROUP(setup, finish)

/* Runs lg-simulate (in LG_BIN_DIR): known solutions, schemes from files, trajectories, plots, gradients.
 * What it refuses is in test_refused.
 * ctest-labels: apps/lg-simulate src/mechanics */
#include "cli_support.h"

#include <glob.h>

#include "liegrad/files.h"
#include "liegrad/integrators.h"

static const char lg[] = "lg-simulate";

static const char oscillator[] = "system: oscillator\ninitial: {q: 0.6, p: -0.8}\nt_end: 3\n";
static const char no_end[] = "system: oscillator\ninitial: {q: 0.6, p: -0.8}\n";
static const char rigid[] =
    "system: rigid-body\ninertia: [1, 2, 3]\ninitial: {mu: [1, 0.5, -0.3]}\nt_end: 4\n";
static const char top_format[] =
    "system: heavy-top\nform: %s\ninertia: [0.5, 0.6, 0.3]\nmass: 1\nlength: 0.5\nchi: [0, 0, 1]\n"
    "gamma0: [0, 0, -9.81]\ninitial: {Q: [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]], pi: [0.2, -1, "
    "2]}\nt_end: 0.5\n";
/* g, m_2 and the second angular velocity (a, 0.3, b) can be chosen. The angular velocity is orthogonal to q_2
 * = (0, 0.6, 0.8) if 0.3 * 0.6 + b * 0.8 = 0. */
static const char chain_format[] =
    "system: pendulum-chain\nform: lagrangian\ngravity: %.17g\nmasses: [1, %.17g]\nlengths: [1, 0.8]\n"
    "initial: {q: [[0.8, 0, -0.6], [0, 0.6, 0.8]], omega: [[0.3, 0.5, 0.4], [%.17g, 0.3, -0.225]]}\nt_end: "
    "1\n";

static void write_chain(const char *name, double gravity, double mass, double rate) {
    cli_write(name, test_text(chain_format, gravity, mass, rate));
}

static void write_top(const char *name, const char *form) {
    cli_write(name, test_text(top_format, form));
}

static double component(size_t i) {
    double y[64];
    assert_true(i < json_array(result.out, "y", y, 64));
    return y[i];
}

static void json(const char *arguments, const char *members) {
    cli_json(lg, arguments, members);
}

static double component_of(const char *arguments, size_t i) {
    json(arguments, "");
    return component(i);
}

/* The state at the end of the run. */
static const double *state_of(const char *arguments, size_t count) {
    double *y = TEST_ARRAY(double, count);
    json(arguments, "");
    assert_int_equal(json_array(result.out, "y", y, count), count);
    return y;
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("oscillator.yaml", oscillator);
    cli_write("no-end.yaml", no_end);
    cli_write("rigid.yaml", rigid);
    write_top("cotangent.yaml", "cotangent");
    write_top("quadratic.yaml", "quadratic");
    write_chain("chain.yaml", 9.81, 1.3, 0.2);
    return 0;
}

/* ---- runs with known solutions ---- */

TEST("JSON has the shortest text of a number that reads back the same") {
    /* The last three: a subnormal number, the smallest one, and a power of two whose nearest decimal with 16
     * digits is another number. */
    static const char *const texts[] = {"0.1",
                                        "2.5",
                                        "100000",
                                        "1e-05",
                                        "0.30000000000000004",
                                        "1.2e-309",
                                        "5e-324",
                                        "7.174648137343064e-43"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        const char *line = test_text("oscillator.yaml --steps 1 --t-end %s --json", texts[i]);
        cli_expect(lg, line, 0, test_text("\"t\": %s,", texts[i]));
    }
}

TEST("the help names every method") {
    cli_run(lg, "--help");
    for (size_t i = 0; i < lg_scheme_count(); i++) assert_says(result.out, lg_scheme_at(i)->name);
}

TEST("an oscillator follows a cosine") {
    const double end[] = {0.6 * cos(3) - 0.8 * sin(3), -0.8 * cos(3) - 0.6 * sin(3)};
    assert_all_close(state_of("oscillator.yaml --tol 1e-12", 2), end, 2, 0, 1e-10);
    json_expect(result.out, "t 3, manifold_error 0, method \"dp54\"");
    assert_all_close(state_of("oscillator.yaml --method rk4 --steps 1000", 2), end, 2, 0, 1e-10);
    json_expect(result.out, "steps 1000, rejected 0, evaluations 4000");
    assert_close(component_of("oscillator.yaml --t-end 1", 0), 0.6 * cos(1) - 0.8 * sin(1), 0, 1e-7);
}

/* Euler's method multiplies the energy by (1 + h^2)^n. theta = 1/2 is the midpoint rule. */
TEST("the energy is printed for start and end, and its largest drift; --theta is passed to the method") {
    const double growth = pow(1 + 0.03 * 0.03, 100);
    json("oscillator.yaml --method euler --steps 100", "invariants {");
    const char *energy = json_find(json_find(result.out, "invariants"), "energy");
    json_expect(energy, "start 0.5");
    assert_close(json_number(energy, "end"), 0.5 * growth, 1e-12, 0);
    assert_close(json_number(energy, "max_drift"), 0.5 * (growth - 1), 1e-11, 0);
    assert_close(component_of("oscillator.yaml --method implicit-euler --theta 0.5 --steps 100", 0),
                 component_of("oscillator.yaml --method midpoint --steps 100", 0), 0, 1e-14);
}

/* A double pendulum in other units of mass and length; the unit of time is unchanged. */
static const char *swing(double mass, double length, const char *rates, double t_end) {
    static char text[512];
    (void)snprintf(text, sizeof text,
                   "system: pendulum-chain\nform: lagrangian\ngravity: %.17g\nmasses: [%.17g, %.17g]\n"
                   "lengths: [%.17g, %.17g]\ninitial: {q: [[0.8, 0, 0.6], [0.6, 0, 0.8]], omega: %s}\n"
                   "t_end: %.17g\n",
                   9.81 * length, mass, mass, length, length, rates, t_end);
    return text;
}

TEST("a state beyond the horizon of prediction is reported with the time of the horizon, in any units") {
    static const double units[][2] = {{1, 1}, {1e9, 1}, {1e-9, 1}, {1, 1e9}, {1, 1e-9}};
    static const char *const methods[] = {"rkmk54", "dp54", "dp85"};
    for (size_t i = 0; i < LG_COUNT(units); i++)
        for (size_t m = 0; m < LG_COUNT(methods); m++) {
            double from = 0;
            cli_write("chaos.yaml", swing(units[i][0], units[i][1], "[[0, 1, 0], [0, 1, 0]]", 60));
            json(test_text("chaos.yaml --method %s", methods[m]), "warnings [");
            const char *told = strstr(json_find(result.out, "warnings"), "from t = ");
            assert_non_null(told);
            assert_says(result.err, "the result is not reliable");
            assert_int_equal(sscanf(told, "from t = %lf", &from), 1);
            assert_true(from > 15 && from < 35);
            cli_run(lg, "chaos.yaml --method %s --t-end %g", methods[m], 0.5 * from);
            assert_string_equal(result.err, "");
        }
}

TEST("predictable motions cause no warning: all scenes, rest, small swings over a long time") {
    static const char *const rows[] = {"heavy.yaml",
                                       "still.yaml",
                                       "small.yaml",
                                       "rigid.yaml --t-end 1000",
                                       "oscillator.yaml --t-end 3000",
                                       "cotangent.yaml --t-end 5",
                                       "oscillator.yaml --tol 1e-3 --t-end 20"};
    glob_t scenes;
    cli_write("still.yaml", "system: pendulum-chain\ngravity: 9.7\nmasses: [1.3, 0.7]\nlengths: [0.9, 1.1]\n"
                            "initial: {q: [[0, 0, -1], [0, 0, -1]], omega: [[0, 0, 0], [0, 0, 0]]}\n"
                            "t_end: 10\n");
    cli_write("heavy.yaml", "system: rigid-body\ninertia: [1e9, 2e9, 3e9]\n"
                            "initial: {mu: [1e9, 5e8, -3e8]}\nt_end: 100\n");
    cli_write("small.yaml",
              "system: pendulum-chain\ngravity: 9.7\nmasses: [1.3, 0.7]\nlengths: [0.9, 1.1]\n"
              "initial: {q: [[0.28, 0, -0.96], [0, 0.28, -0.96]], omega: [[0, 0, 0], [0, 0, 0]]}\n"
              "t_end: 100\n");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_run(lg, "%s", rows[i]);
        if (strstr(result.err, "not reliable") != NULL) fail_msg("%s: %s", rows[i], result.err);
    }
    assert_int_equal(glob(LG_TEST_DIR "/../scenes/*.yaml", 0, NULL, &scenes), 0);
    assert_true(scenes.gl_pathc >= 15);
    for (size_t i = 0; i < scenes.gl_pathc; i++) {
        if (strstr(scenes.gl_pathv[i], "/study-") != NULL || strstr(scenes.gl_pathv[i], "-ensemble.") != NULL)
            continue;
        cli_run(lg, "%s", scenes.gl_pathv[i]);
        if (strstr(result.err, "not reliable") != NULL) fail_msg("%s: %s", scenes.gl_pathv[i], result.err);
    }
    globfree(&scenes);
}

/* The second text of a row is a part of the warning, or NULL if there must be no warning. */
TEST("steps that are far too long cause a warning; good steps, short steps of Euler, and rest do not") {
    static const struct {
        const char *arguments, *words;
    } rows[] = {
        {"chain.yaml --method rkmk4 --steps 20 --t-end 3", "the energy, which is constant, changes by"},
        {"chain.yaml --method rkmk4 --steps 400", NULL},
        {"cotangent.yaml --method lie-euler --steps 2 --t-end 20", "rad, which is more than pi"},
        {"cotangent.yaml --method slgi --steps 400", NULL},
        {"cotangent.yaml --method rk4 --steps 3",
         "the state leaves the manifold: a constraint is violated by"},
        {"chain.yaml --method euler --steps 8 --t-end 2", "the energy, which is constant, changes by"},
        {"oscillator.yaml --method rk4 --steps 2", "far from the solution; give more --steps"},
        {"oscillator.yaml --method euler --steps 1000", NULL},
        {"oscillator.yaml --method euler --steps 5", "far from the solution"},
        {"rigid.yaml", NULL},
        {"rest.yaml --method rkmk4 --steps 300", NULL},
        {"nanometres.yaml", NULL},
        {"nanometres.yaml --method rk4 --steps 20", "the state leaves the manifold"},
    };
    cli_write(
        "nanometres.yaml",
        "system: pendulum-chain\nform: hamiltonian\ngravity: 9.81e9\nmasses: [1, 1.3]\n"
        "lengths: [1e9, 0.8e9]\ninitial: {q: [[1, 0, 0], [0, 1, 0]], p: [[0, 1e18, 2e18], [3e18, 0, 1e18]]}\n"
        "t_end: 3\n");
    cli_write("rest.yaml", "system: pendulum-chain\ngravity: 9.7\nmasses: [1.3, 0.7]\nlengths: [0.9, 1.1]\n"
                           "initial: {q: [[3e-8, 1e-8, -1], [2e-8, 0, -1]], omega: [[0, 0, 0], [0, 0, 0]]}\n"
                           "t_end: 10\n");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        json(rows[i].arguments, "warnings [");
        const char *warnings = json_find(result.out, "warnings");
        if (rows[i].words == NULL && warnings[1 + strspn(warnings + 1, " \n")] != ']')
            fail_msg("%s: %s", rows[i].arguments, result.err);
        if (rows[i].words == NULL) continue;
        if (strstr(warnings, rows[i].words) == NULL || strstr(result.err, rows[i].words) == NULL)
            fail_msg("%s: '%s' is not in %s", rows[i].arguments, rows[i].words, result.err);
    }
}

TEST("a chain stays on the manifold with group methods; with others the distance from it is printed") {
    const double *y = state_of("chain.yaml --tol 1e-11", 12);
    json_expect(result.out,
                "method *, steps *, rejected *, evaluations *, seconds *, t *, manifold_error <1e-13");
    json_expect(json_find(json_find(result.out, "invariants"), "energy"), "max_drift <1e-8, max_drift >0");
    assert_all_close(state_of("chain.yaml --method cf4 --steps 4000", 12), y, 12, 0, 1e-9);
    json("chain.yaml --method rk4 --steps 40", "manifold_error >1e-9");
    json("chain.yaml --method rk4-projected --steps 40", "manifold_error <1e-14");
    cli_run(lg, "chain.yaml");
    assert_says(result.out, "manifold_error");
    assert_says(result.out, "max_drift");
}

TEST("rkmk4 has order 4 with dexpinv truncated after ad^2, but not after ad^1; the exact form is the "
     "default") {
    const double exact = component_of("chain.yaml --method rkmk4 --steps 200 --dexpinv exact", 0);
    assert_close(component_of("chain.yaml --method rkmk4 --steps 200", 0), exact, 0, 0);
    assert_close(component_of("chain.yaml --method rkmk4 --steps 200 --dexpinv 10", 0), exact, 0, 1e-13);
    const double second = component_of("chain.yaml --method rkmk4 --steps 200 --dexpinv 2", 0);
    assert_close(second, exact, 0, 1e-7);
    assert_true(fabs(component_of("chain.yaml --method rkmk4 --steps 200 --dexpinv 0", 0) - exact) >
                10 * fabs(second - exact));
}

TEST("all forms of the heavy top give the same motion, and theta changes it") {
    const double *y = state_of("cotangent.yaml --tol 1e-11", 12);
    assert_all_close(state_of("quadratic.yaml --method slgi --steps 4000", 12), y, 12, 0, 1e-5);
    json_expect(result.out, "theta 0.5");
    const double middle = component(0);
    assert_true(fabs(component_of("cotangent.yaml --method slgi --steps 4000 --theta 0", 0) - middle) > 1e-8);
}

/* ---- tableaus of the user ---- */

static void expect_same(const char *scheme, const char *method) {
    const double *y = state_of(test_text("chain.yaml --method %s --steps 50", method), 12);
    assert_all_close(state_of(test_text("chain.yaml --scheme %s --steps 50", scheme), 12), y, 12, 0, 1e-14);
}

TEST("schemes are read from files") {
    cli_write("kutta3.yaml",
              "name: kutta3\nkind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3, 1/6]\n");
    expect_same("kutta3.yaml", "rkmk3");
    json_expect(result.out, "method \"kutta3\"");
    cli_write("classic.json",
              "{\"kind\": \"runge-kutta\", \"order\": 4, \"c\": [0, 0.5, 0.5, 1], \"a\": [[], [0.5], "
              "[0, 0.5], [0, 0, 1]], \"b\": [\"1/6\", \"1/3\", \"1/3\", \"1/6\"]}");
    expect_same("classic.json", "rk4");
    cli_write("cf.yaml", "kind: commutator-free\norder: 4\nrows:\n- []\n- [1/2]\n- [0, 1/2]\n"
                         "- {base: 2, exponentials: [[-1/2, 0, 1]]}\n"
                         "- [[1/4, 1/6, 1/6, -1/12], [-1/12, 1/6, 1/6, 1/4]]\n");
    expect_same("cf.yaml", "cf4");
    cli_write("heun.yaml",
              "kind: rkmk\norder: 2\nembedded_order: 1\na: [[], [1]]\nb: [0.5, 0.5]\nembedded: [1, 0]\n"
              "dexpinv: 0\n");
    json("chain.yaml --scheme heun.yaml --tol 1e-5", "steps >10");
    cli_write("verlet.yaml", "kind: splitting\norder: 2\nkick: [0.5, 0.5]\ndrift: [1, 0]\n");
    const double q = component_of("oscillator.yaml --method stormer-verlet --steps 50", 0);
    assert_close(component_of("oscillator.yaml --scheme verlet.yaml --steps 50", 0), q, 0, 0);
    cli_run(lg, "chain.yaml --work-precision --scheme kutta3.yaml --methods rk4 --levels 3 --json");
    assert_says(result.out, "kutta3");
}

/* ---- trajectories and plots ---- */

static void open_trajectory(const char *name, lg_file_reader **reader, lg_archive_reader *archive) {
    assert_ok(lg_file_reader_create(NULL, cli_at(name), "trajectory", NULL, reader, NULL));
    assert_ok(lg_file_reader_archive(*reader, "", archive));
}

static void read_array(const char *name, const char *key, uint32_t rank, const uint64_t *dims, double *out) {
    lg_file_reader *reader = NULL;
    lg_archive_reader archive;
    open_trajectory(name, &reader, &archive);
    assert_ok(archive.array(archive.user, key, LG_ELEMENT_F64, rank, dims, out));
    lg_file_reader_destroy(reader);
}

static void expect_text(const char *name, const char *key, const char *value) {
    char text[64];
    lg_file_reader *reader = NULL;
    lg_archive_reader archive;
    open_trajectory(name, &reader, &archive);
    assert_ok(archive.text(archive.user, key, text, sizeof text));
    lg_file_reader_destroy(reader);
    assert_string_equal(text, value);
}

TEST("a trajectory is written as it was computed") {
    const uint64_t dims[] = {11, 12}, three[] = {3, 2};
    double t[11], y[11 * 12], s[11 * 12];
    const double *last = state_of("chain.yaml --out t.h5 --points 11", 12);
    json_expect(result.out, "points 11");
    read_array("t.h5", "t", 1, dims, t);
    read_array("t.h5", "trajectory", 2, dims, y);
    for (size_t i = 0; i < 11; i++) assert_close(t[i], 0.1 * (double)i, 0, 1e-15);
    assert_close(y[0], 0.8, 0, 0);
    assert_all_close(y + 120, last, 12, 0, 0);
    expect_text("t.h5", "system", "pendulum-chain");
    expect_text("t.h5", "form", "lagrangian");
    expect_text("t.h5", "layout", "q1 omega1 q2 omega2");
    expect_text("t.h5", "method", "rkmk54");
    read_array("t.h5", "invariants/energy", 1, dims, t);
    assert_close(t[10], t[0], 1e-7, 0);
    /* Dense output of the adaptive run must agree with the steps of the other run. */
    cli_run(lg, "chain.yaml --method rkmk4 --steps 1000 --out s.h5 --points 11");
    read_array("s.h5", "trajectory", 2, dims, s);
    assert_all_close(s, y, 132, 0, 1e-6);
    cli_run(lg, "oscillator.yaml --method dp54 --steps 300 --times 0.5,1.234,2 --out o.h5");
    read_array("o.h5", "trajectory", 2, three, y);
    assert_close(y[2], 0.6 * cos(1.234) - 0.8 * sin(1.234), 0, 1e-9);
    cli_run(lg, "oscillator.yaml --times 0,1.5,3 --out o.h5");
    read_array("o.h5", "trajectory", 2, three, y);
    assert_close(y[0], 0.6, 0, 0);
    assert_close(y[4], 0.6 * cos(3) - 0.8 * sin(3), 0, 1e-7);
    json("no-end.yaml --times 1,2 --out o.h5", "t 2");
}

TEST("plots are drawn") {
    static const char *const arguments[] = {
        "chain.yaml", "oscillator.yaml", "chain.yaml --plot-kind components",
        "chain.yaml --plot-kind invariants", "chain.yaml --plot-kind manifold",
        "chain.yaml --plot-kind steps", "chain.yaml --plot-kind 3d", "cotangent.yaml --plot-kind 3d",
        "rigid.yaml --plot-kind 3d", "chain.yaml --method rk4 --steps 20",
        /* zero at all times, and no invariants */
        "rigid.yaml --plot-kind manifold", "quadrotors.yaml --plot-kind invariants",
        "quadrotors.yaml --plot-kind 3d", "bodies.yaml --plot-kind 3d", "satellite.yaml --plot-kind 3d",
        "chain.yaml --tol 1e-13"};
    cli_write("quadrotors.yaml",
              "system: quadrotors\ninitial: {q: [[0.6, 0, 0.8], [-0.6, 0, 0.8]]}\nt_end: 0.1\n");
    cli_write("bodies.yaml", "system: quadrotors\nform: attitudes\n"
                             "initial: {q: [[0.6, 0, 0.8], [-0.6, 0, 0.8]]}\nt_end: 0.1\n");
    cli_write("satellite.yaml",
              "system: satellite\ninitial: {pi: [0.3, 0, 1], q: [0, 0.6, 0.8], p: [0.2, 0, 0]}\nt_end: 1\n");
    for (size_t i = 0; i < LG_COUNT(arguments); i++) {
        cli_run(lg, "%s --plot p%zu.svg", arguments[i], i);
        assert_true(cli_exists(test_text("p%zu.gp", i)));
        if (!cli_exists(test_text("p%zu.svg", i)) && strstr(result.err, "gnuplot is not installed") == NULL)
            fail_msg("%s: no plot: %s", arguments[i], result.err);
    }
}

TEST("gnuplot draws a plot whatever the names of its file and folder are") {
    static const char *const paths[] = {"it's/p.svg",     "'/''.svg",
                                        "share/-y.svg",   "$(touch\tRAN)/`touch\tRAN`.svg",
                                        "\\/\"a\"&*.svg", "./<p;.svg"};
    assert_int_equal(setenv("CDPATH", "/usr", 1), 0);
    static const char *const folders[] = {"it's", "'", "share", "$(touch\tRAN)", "\\"};
    for (size_t i = 0; i < LG_COUNT(folders); i++) assert_int_equal(mkdir(cli_at(folders[i]), 0700), 0);
    for (size_t i = 0; i < LG_COUNT(paths); i++) {
        cli_run(lg, "oscillator.yaml --plot %s", paths[i]);
        if (strstr(result.err, "gnuplot is not installed") == NULL) assert_true(cli_exists(paths[i]));
    }
    cli_run(lg, "oscillator.yaml --plot %s", cli_at("it's/absolute.svg"));
    if (strstr(result.err, "gnuplot is not installed") == NULL) assert_true(cli_exists("it's/absolute.svg"));
    assert_false(cli_exists("RAN") || cli_exists("it's/RAN"));
    assert_int_equal(unsetenv("CDPATH"), 0);
}

/* ---- --work-precision ---- */

TEST("--work-precision takes theta: midpoint has order 2 at 1/2, else 1") {
    static const char *const lines[] = {
        "oscillator.yaml --work-precision --methods midpoint --theta 0.5 --steps 4096 --levels 2",
        "oscillator.yaml --work-precision --methods midpoint --theta 1 --steps 4096 --levels 2"};
    for (int i = 0; i < 2; i++) {
        json(lines[i], "work_precision [");
        const char *s = strchr(json_find(result.out, "work_precision"), '{');
        const double coarse = json_number(s, "error"), fine = json_number(strchr(s + 1, '{'), "error");
        assert_close(log2(coarse / fine), 2 - i, 0.05, 0);
    }
}

TEST("--work-precision compares the error and the work of schemes") {
    double error[4];
    json("rigid.yaml --work-precision --methods rkmk4,rkmk54 --levels 5 --plot w.svg", "work_precision [");
    json_expect(json_find(result.out, "reference"), "error <1e-9");
    const char *s = strchr(json_find(result.out, "work_precision"), '{');
    for (int i = 0; i < 4; i++, s = strchr(s + 1, '{')) {
        json_expect(s, "method \"rkmk4\", error >0, error <1, seconds >0, evaluations >0");
        error[i] = json_number(s, "error");
    }
    /* of the two finest levels, whose step lengths differ by a factor of two */
    assert_close(log2(error[2] / error[3]), 4, 0.05, 0);
    for (; s != NULL && strncmp(json_find(s, "method"), "\"rkmk54\"", 8) != 0; s = strchr(s + 1, '{'))
        continue;
    json_expect(s, "tol *, error >0, error <1");
    cli_run(lg, "oscillator.yaml --work-precision --levels 4");
    assert_says(result.out, "stormer-verlet");
    assert_says(result.out, "the reference is dp54");
    assert_null(strstr(result.out, "rkmk4"));
    assert_true(cli_exists("w.gp"));
}

TEST("the plot shows the name of a scheme's file as it is, and its script does not have the name") {
    static char script[65536], first[65536];
    for (size_t i = 0; i < CLI_NAMES; i++) {
        char name[128];
        size_t used = 0;
        for (const char *c = cli_strange_name(i); *c != '\0'; c++)
            used += (size_t)snprintf(name + used, sizeof name - used, "%s%c", *c == '\'' ? "'" : "", *c);
        cli_write("named.yaml", test_text("name: '%s'\nkind: rkmk\norder: 1\na: [[]]\nb: [1]\n", name));
        cli_run(lg, "rigid.yaml --work-precision --scheme named.yaml --methods rk4 --levels 2 --plot n.svg");
        cli_shows_names("n.svg", "<text>", i, i + 1);
        (void)cli_read("n.gp", script, sizeof script);
        if (i == 0) memcpy(first, script, sizeof first);
        assert_string_equal(script, first);
    }
}

/* ---- gradients ---- */

#define WEIGHTS "0.3,-0.2,0.5,0.1,0.7,-0.4,0.25,-0.6,0.15,0.35,-0.45,0.55"

static double functional(const char *options) {
    char arguments[256], *word = (char[]){WEIGHTS};
    double sum = 0;
    (void)snprintf(arguments, sizeof arguments, "varied.yaml %s", options);
    const double *y = state_of(arguments, 12);
    for (size_t i = 0; i < 12; i++, word++) sum += strtod(word, &word) * y[i];
    return sum;
}

/* The derivative of J by central differences of runs of the executable. */
static double difference(const char *options, const double direction[3]) {
    const double d = 1e-4;
    double j[4];
    for (int i = 0; i < 4; i++) {
        const double s = d * (i < 2 ? 1 : 2) * (i % 2 == 0 ? 1 : -1);
        write_chain("varied.yaml", 9.81 + s * direction[0], 1.3 + s * direction[1], 0.2 + s * direction[2]);
        j[i] = functional(options);
    }
    return (8 * (j[0] - j[1]) - (j[2] - j[3])) / (12 * d);
}

/* The gradient with respect to the start is tangent: orthogonal to (q, 0) and (omega, q), the normals of |q|
 * = 1, q.omega = 0. */
TEST("the gradient agrees with differences in the parameters and in tangent directions of the start") {
    static const char *const methods[] = {"--method rkmk4 --steps 60", "--method rk4-projected --steps 20",
                                          "--tol 1e-11"};
    for (size_t i = 0; i < LG_COUNT(methods); i++) {
        double dy0[12];
        json(test_text("chain.yaml --gradient " WEIGHTS " %s", methods[i]), "dJ_dparameters {");
        assert_int_equal(json_array(result.out, "dJ_dy0", dy0, 12), 12);
        const double j = json_number(result.out, "J"),
                     in[] = {json_number(json_find(result.out, "dJ_dparameters"), "g"),
                             json_number(json_find(result.out, "dJ_dparameters"), "m2"), dy0[9]};
        write_chain("varied.yaml", 9.81, 1.3, 0.2);
        assert_close(j, functional(methods[i]), 1e-12, 1e-13);
        for (int k = 0; k < 3; k++)
            assert_close(in[k], difference(methods[i], (const double[]){k == 0, k == 1, k == 2}), 1e-6, 1e-6);
        assert_close(0.6 * dy0[7] + 0.8 * dy0[8], 0, 0, 1e-12);
        assert_close(0.2 * dy0[6] + 0.3 * dy0[7] - 0.225 * dy0[8] + 0.6 * dy0[10] + 0.8 * dy0[11], 0, 0,
                     1e-12);
    }
}

TEST("weights can be read from a file, and the number of checkpoints changes no result") {
    double dy0[2];
    cli_write("weights.txt", "0.3 -0.2\n0.5,0.1,\t0.7 -0.4 0.25 -0.6 0.15 0.35 -0.45 0.55\n");
    json("chain.yaml --method rkmk4 --steps 60 --gradient @weights.txt", "");
    const double j = json_number(result.out, "J");
    json("chain.yaml --method rkmk4 --steps 60 --checkpoints 5 --gradient " WEIGHTS,
         "checkpoints 5, tape_bytes >0");
    assert_close(json_number(result.out, "J"), j, 0, 0);
    json("oscillator.yaml --tol 1e-12 --gradient 1,0", "");
    assert_int_equal(json_array(result.out, "dJ_dy0", dy0, 2), 2);
    assert_all_close(dy0, ((const double[]){cos(3), sin(3)}), 2, 0, 1e-9);
    cli_run(lg, "chain.yaml --gradient " WEIGHTS);
    assert_says(result.out, "and in the parameters:");
}

/* ---- Ctrl-C ---- */

TEST("Ctrl-C ends a run") {
    static const char *const lines[] = {
        "chain.yaml --method rkmk4 --steps 1000000000 --json",
        "chain.yaml --tol 1e-13 --t-end 1e6 --max-steps 1000000000 --json",
        "chain.yaml --work-precision --t-end 300 --tol 1e-9 --json",
        "rigid.yaml --method rkmk4 --steps 1000000000 --t-end 1000000 --points 1000001 --out part.h5 --json"};
    for (size_t i = 0; i < LG_COUNT(lines); i++) {
        const cli_child child = cli_start(lg, lines[i], 0);
        (void)nanosleep(&(struct timespec){0, 150000000}, NULL);
        cli_interrupt(child);
        assert_string_equal(result.out, "");
        assert_says(result.err, "stopped by Ctrl-C");
    }
    assert_true(cli_exists("part.h5"));
    assert_says(result.err, "points reached");
}

TEST_GROUP(setup, cli_end)

/* lg-simulate (in LG_BIN_DIR) from outside: every option, every refusal, numbers with known answers. */
#include "cli_support.h"

#include "liegrad/integrators.h"
#include "liegrad/io.h"

static const char lg[] = "lg-simulate";
static cli result;

static const char oscillator[] = "system: oscillator\ninitial: {q: 0.6, p: -0.8}\nt_end: 3\n";
static const char no_end[] = "system: oscillator\ninitial: {q: 0.6, p: -0.8}\n";
static const char no_start[] = "system: rigid-body\ninertia: [1, 2, 3]\nt_end: 3\n";
static const char rigid[] =
    "system: rigid-body\ninertia: [1, 2, 3]\ninitial: {mu: [1, 0.5, -0.3]}\nt_end: 4\n";
static const char top_format[] =
    "system: heavy-top\nform: %s\ninertia: [0.5, 0.6, 0.3]\nmass: 1\nlength: 0.5\nchi: [0, 0, 1]\n"
    "gamma0: [0, 0, -9.81]\ninitial: {Q: [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]], pi: [0.2, -1, "
    "2]}\nt_end: 0.5\n";
/* g, m_2 and the second angular velocity (a, 0.3, b) may be varied: it stays orthogonal to q_2 = (0, 0.6,
 * 0.8) where 0.3 * 0.6 + b * 0.8 = 0. */
static const char chain_format[] =
    "system: pendulum-chain\nform: lagrangian\ngravity: %.17g\nmasses: [1, %.17g]\nlengths: [1, 0.8]\n"
    "initial: {q: [[0.8, 0, -0.6], [0, 0.6, 0.8]], omega: [[0.3, 0.5, 0.4], [%.17g, 0.3, -0.225]]}\nt_end: "
    "1\n";

static void write_chain(const char *name, double gravity, double mass, double rate) {
    char text[1024];
    (void)snprintf(text, sizeof text, chain_format, gravity, mass, rate);
    cli_write(name, text);
}

static void write_top(const char *name, const char *form) {
    char text[1024];
    (void)snprintf(text, sizeof text, top_format, form);
    cli_write(name, text);
}

/* The numbers of an array of the outermost object. */
static size_t json_array(const char *text, const char *key, double *out, size_t room) {
    const char *s = json_find(text, key);
    size_t n = 0;
    if (s == NULL || *s != '[') fail_msg("no array '%s' in %s", key, text);
    for (s = json_space(s + 1); *s != ']' && n < room; s = json_space(s + (*s == ','))) {
        char *end = NULL;
        out[n++] = strtod(s, &end);
        if (end == s) fail_msg("no number in '%s' of %s", key, text);
        s = json_space(end);
    }
    return n;
}

static double component(size_t i) {
    double y[64];
    assert_true(i < json_array(result.out, "y", y, 64));
    return y[i];
}

static void run(const char *arguments) {
    cli_expect(lg, arguments, 0, "", &result);
    if (strstr(arguments, "--json") != NULL && !json_is_object(result.out))
        fail_msg("no JSON: %s", result.out);
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("oscillator.yaml", oscillator);
    cli_write("no-end.yaml", no_end);
    cli_write("no-start.yaml", no_start);
    cli_write("rigid.yaml", rigid);
    write_top("cotangent.yaml", "cotangent");
    write_top("quadratic.yaml", "quadratic");
    write_top("direct.yaml", "direct");
    write_chain("chain.yaml", 9.81, 1.3, 0.2);
    return 0;
}

/* ---- bad input: exit code and words of the sentence ---- */

static const cli_bad bad_input[] = {
    {"", 2, "missing argument; expected: SCENE.yaml"},
    {"missing.yaml", 3, "missing.yaml"},
    {".", 3, "."},
    {"no-start.yaml", 3, "`initial` is missing"},
    {"no-end.yaml", 2, "no final time: give --t-end T"},
    {"chain.yaml oscillator.yaml", 2, "one argument too many"},
    {"chain.yaml --bogus", 2, "--bogus"},
    {"chain.yaml --method leapfrog", 2, "'leapfrog' is not one of euler, implicit-euler, midpoint"},
    {"chain.yaml --method symplectic-euler --steps 10", 2, "not separable; those that do: euler,"},
    {"chain.yaml --method slgi --steps 10", 2, "heavy-top, form cotangent or quadratic"},
    {"direct.yaml --method slgi --steps 10", 2, "does not apply to heavy-top, direct"},
    {"cotangent.yaml --method variational --steps 10", 2, "no discrete Lagrangian"},
    {"chain.yaml --method rkmk4", 2, "'rkmk4' needs --steps N, as it does not estimate its error; adaptive"},
    {"chain.yaml --method rkmk4 --tol 1e-6", 2, "--tol: 'rkmk4' does not estimate its error"},
    {"chain.yaml --steps 10 --tol 1e-6", 2, "either --steps (equal steps) or --tol"},
    {"chain.yaml --steps 0", 2, "--steps: '0'"},
    {"chain.yaml --steps -3", 2, "--steps: '-3'"},
    {"chain.yaml --steps 1e3", 2, "--steps: '1e3'"},
    {"chain.yaml --tol 0", 2, "--tol: '0'"},
    {"chain.yaml --tol nan", 2, "--tol: 'nan'"},
    {"chain.yaml --tol -1e-3", 2, "--tol: '-1e-3'"},
    {"chain.yaml --atol -1", 2, "--atol: '-1'"},
    {"chain.yaml --t-end 0", 2, "--t-end: '0'"},
    {"chain.yaml --t-end -1", 2, "--t-end: '-1'"},
    {"chain.yaml --t-end inf", 2, "--t-end: 'inf'"},
    {"cotangent.yaml --method slgi --steps 10 --theta 1.5", 2, "--theta: '1.5'"},
    {"cotangent.yaml --method slgi --steps 10 --theta -0.1", 2, "--theta: '-0.1'"},
    {"chain.yaml --method rkmk4 --steps 10 --theta 0.5", 2, "--theta: 'rkmk4' has no such parameter"},
    {"chain.yaml --dexpinv 11", 2, "--dexpinv: '11' is neither"},
    {"chain.yaml --dexpinv most", 2, "--dexpinv: 'most' is neither"},
    {"chain.yaml --method cf4 --steps 10 --dexpinv 2", 2, "--dexpinv: 'cf4' does not use it"},
    {"chain.yaml --scheme missing.yaml", 3, "missing.yaml"},
    {"chain.yaml --scheme chain.yaml --steps 10", 3, "chain.yaml: line"},
    {"chain.yaml --scheme chain.yaml --method rk4", 2, "either --method or --scheme"},
    {"chain.yaml --out nowhere/t.h5", 3, "nowhere/t.h5"},
    {"chain.yaml --out .", 3, "folder"},
    {"chain.yaml --out chain.yaml", 2, "--out: chain.yaml is an input and would be replaced"},
    {"chain.yaml --scheme oscillator.yaml --out oscillator.yaml", 2, "is an input of --scheme"},
    {"chain.yaml --gradient @oscillator.yaml --out oscillator.yaml", 2, "is an input of --gradient"},
    {"chain.yaml --out t.dat --plot t.svg", 2, "--plot: t.dat is what --out writes too"},
    {"chain.yaml --plot t.pdf", 2, "t.pdf"},
    {"chain.yaml --plot nowhere/t.svg", 3, "nowhere/t.svg"},
    {"chain.yaml --plot-kind 3d", 2, "--plot-kind: works together with --plot only"},
    {"chain.yaml --plot t.svg --plot-kind pie", 2, "--plot-kind: 'pie'"},
    {"oscillator.yaml --plot t.svg --plot-kind 3d", 2, "no picture in space of oscillator"},
    {"chain.yaml --points 1", 2, "--points: '1'"},
    {"chain.yaml --points 5 --times 0,1", 2, "either --points or --times"},
    {"chain.yaml --times 0.5,0.2 --out t.h5", 2, "--times: 0.2"},
    {"chain.yaml --times 0.5,2 --out t.h5", 2, "--times: 2"},
    {"chain.yaml --method rk4 --steps 10 --points 4 --out t.h5", 2,
     "3 intervals, which do not divide 10 steps"},
    {"chain.yaml --method rk4 --steps 10 --times 0.25 --out t.h5", 2,
     "--times: 0.25 is no multiple of the step"},
    {"chain.yaml --gradient 1,2", 2, "2 weights, but the state has 12 numbers: q1 omega1 q2 omega2"},
    {"chain.yaml --gradient 1,x", 2, "'x' is not a number"},
    {"chain.yaml --gradient @missing.txt", 3, "missing.txt"},
    {"chain.yaml --method variational --steps 400 --gradient 1,1,1,1,1,1,1,1,1,1,1,1", 2,
     "'variational' has no differentiable form on pendulum-chain, lagrangian"},
    {"chain.yaml --checkpoints 4", 2, "--checkpoints: works together with --gradient only"},
    {"chain.yaml --work-precision --gradient 1,2", 2, "either --work-precision or --gradient"},
    {"chain.yaml --work-precision --methods rk4,leapfrog", 2, "--methods: 'leapfrog' is not one of"},
    {"chain.yaml --work-precision --methods stormer-verlet", 2, "not separable"},
    {"chain.yaml --methods rk4", 2, "--methods: works together with --work-precision only"},
    {"oscillator.yaml --t-end 1e18", 4, "the step size fell below the resolution of time at t = 0"},
    {"chain.yaml --max-steps 5", 4, "is all that 5 steps reached"},
    {"chain.yaml --method euler --steps 40 --t-end 1e6", 4, "not finite"},
};

TEST("a refused command line tells its exit code and word") {
    cli_expect_refused(lg, bad_input, LG_COUNT(bad_input), &result);
    assert_false(cli_exists("t.h5") || cli_exists("t.svg"));
}

TEST("the executable has help and a version") {
    cli_expect(lg, "--version", 0, "lg-simulate (liegrad) ", &result);
    cli_expect(lg, "--help", 0, "--work-precision", &result);
    /* Every method is named. */
    for (size_t i = 0; i < lg_scheme_count(); i++)
        if (strstr(result.out, lg_scheme_at(i)->name) == NULL)
            fail_msg("--help: no %s", lg_scheme_at(i)->name);
}

/* ---- runs with known answers ---- */

TEST("an oscillator turns as the cosine does") {
    const double q = 0.6 * cos(3) - 0.8 * sin(3), p = -0.8 * cos(3) - 0.6 * sin(3);
    run("oscillator.yaml --tol 1e-12 --json");
    assert_close(component(0), q, 0, 1e-10);
    assert_close(component(1), p, 0, 1e-10);
    assert_close(json_number(result.out, "t"), 3, 0, 0);
    assert_close(json_number(result.out, "manifold_error"), 0, 0, 0);
    assert_non_null(strstr(result.out, "\"method\": \"dp54\""));
    run("oscillator.yaml --method rk4 --steps 1000 --json");
    assert_close(component(0), q, 0, 1e-10);
    assert_close(json_number(result.out, "steps"), 1000, 0, 0);
    assert_close(json_number(result.out, "rejected"), 0, 0, 0);
    assert_close(json_number(result.out, "evaluations"), 4000, 0, 0);
    run("oscillator.yaml --t-end 1 --json");
    assert_close(component(0), 0.6 * cos(1) - 0.8 * sin(1), 0, 1e-7);
}

/* (1 + h^2)^(+-n)/2 and, symplectic Euler, p first: q^2 + p^2 - h q p. */
TEST("the energies of both Euler methods are those of the formulas") {
    const double h = 0.03, growth = pow(1 + h * h, 100);
    run("oscillator.yaml --method euler --steps 100 --json");
    const char *energy = json_find(json_find(result.out, "invariants"), "energy");
    assert_non_null(energy);
    assert_close(json_number(energy, "start"), 0.5, 1e-15, 0);
    assert_close(json_number(energy, "end"), 0.5 * growth, 1e-12, 0);
    assert_close(json_number(energy, "max_drift"), 0.5 * (growth - 1), 1e-11, 0);
    run("oscillator.yaml --method implicit-euler --steps 100 --json");
    energy = json_find(json_find(result.out, "invariants"), "energy");
    assert_close(json_number(energy, "end"), 0.5 / growth, 1e-12, 0);
    run("oscillator.yaml --method symplectic-euler --steps 100 --json");
    const double q = component(0), p = component(1);
    assert_close(q * q + p * p - h * q * p, 1 + h * 0.48, 1e-13, 0);
    /* theta = 1/2 is the midpoint rule, as is the variational integrator here. */
    run("oscillator.yaml --method implicit-euler --theta 0.5 --steps 100 --json");
    const double theta_q = component(0);
    run("oscillator.yaml --method midpoint --steps 100 --json");
    assert_close(component(0), theta_q, 0, 1e-14);
    run("oscillator.yaml --method variational --steps 100 --json");
    assert_close(component(0), theta_q, 0, 1e-13);
}

TEST("a chain keeps its energy") {
    double y[12];
    run("chain.yaml --tol 1e-11 --json");
    static const char *const keys[] = {"method",  "steps", "rejected",   "evaluations",
                                       "seconds", "t",     "invariants", "manifold_error"};
    for (size_t i = 0; i < LG_COUNT(keys); i++) assert_non_null(json_find(result.out, keys[i]));
    const char *energy = json_find(json_find(result.out, "invariants"), "energy");
    assert_true(json_number(energy, "max_drift") < 1e-8 && json_number(energy, "max_drift") > 0);
    assert_true(json_number(result.out, "manifold_error") < 1e-13);
    assert_int_equal(json_array(result.out, "y", y, 12), 12);
    run("chain.yaml --method cf4 --steps 4000 --json");
    for (size_t i = 0; i < 12; i++) assert_close(component(i), y[i], 0, 1e-9);
    /* Off the sphere, and said so. */
    run("chain.yaml --method rk4 --steps 40 --json");
    assert_true(json_number(result.out, "manifold_error") > 1e-9);
    run("chain.yaml --method rk4-projected --steps 40 --json");
    assert_true(json_number(result.out, "manifold_error") < 1e-14);
    run("chain.yaml");
    assert_non_null(strstr(result.out, "manifold error"));
    assert_non_null(strstr(result.out, "largest drift"));
}

TEST("dexpinv truncated at ad^2 has order 4 still, at ad^1 not; the exact form is the default") {
    static const char *const arguments[] = {"exact", "10", "2", "0"};
    double y[4];
    char line[128];
    for (size_t i = 0; i < 4; i++) {
        (void)snprintf(line, sizeof line, "chain.yaml --method rkmk4 --steps 200 --json --dexpinv %s",
                       arguments[i]);
        run(line);
        y[i] = component(0);
    }
    run("chain.yaml --method rkmk4 --steps 200 --json");
    assert_close(component(0), y[0], 0, 0);
    assert_close(y[1], y[0], 0, 1e-13);
    assert_close(y[2], y[0], 0, 1e-7);
    assert_true(fabs(y[3] - y[0]) > 10 * fabs(y[2] - y[0]));
}

TEST("the forms of the heavy top give the same motion, and theta changes it") {
    double y[12];
    run("cotangent.yaml --tol 1e-11 --json");
    assert_int_equal(json_array(result.out, "y", y, 13), 12);
    run("quadratic.yaml --method slgi --steps 4000 --json");
    assert_close(json_number(result.out, "theta"), 0.5, 0, 0);
    for (size_t i = 0; i < 12; i++) assert_close(component(i), y[i], 0, 1e-5);
    const double middle = component(0);
    run("cotangent.yaml --method slgi --steps 4000 --theta 0 --json");
    assert_true(fabs(component(0) - middle) > 1e-8);
}

/* ---- one's own tableau ---- */

static void expect_same(const char *scheme, const char *method) {
    char arguments[256];
    double y[12];
    (void)snprintf(arguments, sizeof arguments, "chain.yaml --method %s --steps 50 --json", method);
    run(arguments);
    assert_int_equal(json_array(result.out, "y", y, 12), 12);
    (void)snprintf(arguments, sizeof arguments, "chain.yaml --scheme %s --steps 50 --json", scheme);
    run(arguments);
    for (size_t i = 0; i < 12; i++) assert_close(component(i), y[i], 0, 1e-14);
}

TEST("schemes are read from files") {
    cli_write("kutta3.yaml",
              "name: kutta3\nkind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3, 1/6]\n");
    expect_same("kutta3.yaml", "rkmk3");
    assert_non_null(strstr(result.out, "\"method\": \"kutta3\""));
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
    run("chain.yaml --scheme heun.yaml --tol 1e-5 --json");
    assert_true(json_number(result.out, "steps") > 10);
    cli_write("verlet.yaml", "kind: splitting\norder: 2\nkick: [0.5, 0.5]\ndrift: [1, 0]\n");
    run("oscillator.yaml --method stormer-verlet --steps 50 --json");
    const double q = component(0);
    run("oscillator.yaml --scheme verlet.yaml --steps 50 --json");
    assert_close(component(0), q, 0, 0);
    cli_expect(lg, "chain.yaml --scheme verlet.yaml --steps 50", 2, "not separable", &result);
    cli_expect(lg, "chain.yaml --scheme kutta3.yaml", 2, "'kutta3' needs --steps", &result);
    run("chain.yaml --work-precision --scheme kutta3.yaml --methods rk4 --levels 3 --json");
    assert_non_null(strstr(result.out, "kutta3"));
}

static const char *const bad_schemes[][2] = {
    {"order: 3\n", "kind"},
    {"kind: magic\norder: 3\n", "'magic' is none of rkmk, runge-kutta, commutator-free, splitting"},
    {"kind: rkmk\n", "order"},
    {"kind: rkmk\norder: 3\nb: [1]\n", "needs the key 'a'"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [1]\nkick: [1]\n",
     "line 5: kick: a scheme of kind rkmk has no such key"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [1]\nb: [1]\n", "line 5"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [1]\ncolour: red\n", "colour"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [0.9]\n", "weights do not sum to 1"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [one]\n", "line 4: b: 'one' is neither a number nor a quotient"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [1/0]\n", "'1/0'"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: 1\n", "0 stages"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.2]\n", "9 stages, 1 to 8"},
    {"kind: rkmk\norder: 2\na: [[]]\nb: [0.5, 0.5]\n", "line 3: a: a list for each stage"},
    {"kind: rkmk\norder: 2\na: [[1], [1]]\nb: [0.5, 0.5]\n", "not explicit"},
    {"kind: rkmk\norder: 2\na: [[], [1]]\nb: [0.5, 0.5]\nc: [0, 0.5]\n", "c_i is not the sum"},
    {"kind: rkmk\norder: 2\na: [[], [1]]\nb: [0.5, 0.5]\ndexpinv: 12\n", "dexpinv: '12'"},
    {"kind: rkmk\norder: 2\nembedded_order: 1\na: [[], [1]]\nb: [0.5, 0.5]\nembedded: [0.5, 0.5]\n",
     "no error could be"},
    {"kind: rkmk\norder: 2\na: [[], [1]]\nb: [0.5, 0.5]\nembedded: [1, 0]\n", "belong together"},
    {"kind: rkmk\norder: 2\na: [[], [1]]\nb: [0.5, 0.5]\ncommutators: [[1, 1, 9, 0.5]]\n", "commutators"},
    {"kind: commutator-free\norder: 1\nrows: [[]]\n", "0 stages"},
    {"kind: commutator-free\norder: 1\nrows: [[], [0.5]]\n", "do not sum"},
    {"kind: commutator-free\norder: 1\nrows: [[], {base: 2, exponentials: []}]\n", "base"},
    {"kind: commutator-free\norder: 1\nrows: [[], {bass: 1}]\n", "`base` and `exponentials`"},
    {"kind: splitting\norder: 1\nkick: [1]\ndrift: [1, 0]\n", "2 numbers, at most 1"},
    {"[", "bad.yaml"},
};

TEST("a bad scheme is refused with its word") {
    for (size_t i = 0; i < LG_COUNT(bad_schemes); i++) {
        cli_write("bad.yaml", bad_schemes[i][0]);
        cli_expect(lg, "chain.yaml --scheme bad.yaml --steps 10", 3, bad_schemes[i][1], &result);
        if (strstr(result.err, "bad.yaml: line") == NULL) fail_msg("no line in: %s", result.err);
    }
}

/* ---- trajectories and pictures ---- */

static void read_array(const char *name, const char *key, uint32_t rank, const uint64_t *dims, double *out) {
    char path[1024];
    lg_file_reader *reader = NULL;
    lg_archive_reader archive;
    cli_path(name, path, sizeof path);
    assert_ok(lg_file_reader_create(NULL, path, "trajectory", NULL, &reader, NULL));
    assert_ok(lg_file_reader_archive(reader, "", &archive));
    if (dims != NULL)
        assert_ok(archive.array(archive.user, key, LG_ELEMENT_F64, rank, dims, out));
    else
        assert_ok(archive.text(archive.user, key, (char *)out, rank));
    lg_file_reader_destroy(reader);
}

static void expect_text(const char *name, const char *key, const char *value) {
    double text[16];
    read_array(name, key, sizeof text, NULL, text);
    assert_string_equal((const char *)text, value);
}

TEST("a trajectory is written as it was computed") {
    const uint64_t dims[] = {11, 12}, three[] = {3, 2};
    double t[11], y[11 * 12];
    run("chain.yaml --out t.h5 --points 11 --json");
    assert_close(json_number(result.out, "points"), 11, 0, 0);
    read_array("t.h5", "t", 1, dims, t);
    read_array("t.h5", "trajectory", 2, dims, y);
    for (size_t i = 0; i < 11; i++) assert_close(t[i], 0.1 * (double)i, 0, 1e-15);
    assert_close(y[0], 0.8, 0, 0);
    for (size_t i = 0; i < 12; i++) assert_close(y[120 + i], component(i), 0, 0);
    expect_text("t.h5", "system", "pendulum-chain");
    expect_text("t.h5", "form", "lagrangian");
    expect_text("t.h5", "layout", "q1 omega1 q2 omega2");
    expect_text("t.h5", "method", "rkmk54");
    read_array("t.h5", "invariants/energy", 1, dims, t);
    assert_close(t[10], t[0], 1e-7, 0);
    /* Dense output of the adaptive run, the steps of the other one: the same states. */
    run("chain.yaml --method rkmk4 --steps 1000 --out s.h5 --points 11 --json");
    double s[11 * 12];
    read_array("s.h5", "trajectory", 2, dims, s);
    for (size_t i = 0; i < 132; i++) assert_close(s[i], y[i], 0, 1e-6);
    run("oscillator.yaml --method dp54 --steps 300 --times 0.5,1.234,2 --out o.h5 --json");
    read_array("o.h5", "trajectory", 2, three, y);
    assert_close(y[2], 0.6 * cos(1.234) - 0.8 * sin(1.234), 0, 1e-9);
    run("oscillator.yaml --times 0,1.5,3 --out o.h5 --json");
    read_array("o.h5", "trajectory", 2, three, y);
    assert_close(y[0], 0.6, 0, 0);
    assert_close(y[4], 0.6 * cos(3) - 0.8 * sin(3), 0, 1e-7);
    run("no-end.yaml --times 1,2 --out o.h5 --json");
    assert_close(json_number(result.out, "t"), 2, 0, 0);
}

TEST("a full disk is told, and leaves no file") {
    cli_expect_limited(lg, "chain.yaml --out full.h5", 4096, 3, "full.h5", &result);
    cli_expect_limited(lg, "chain.yaml --plot full.svg", 4096, 3, "full", &result);
    assert_false(cli_exists("full.h5") || cli_exists("full.svg") || cli_exists("full.dat"));
    assert_int_equal(cli_count_files("tmp"), 0);
}

TEST("pictures are drawn") {
    static const char *const arguments[] = {
        "chain.yaml", "oscillator.yaml", "chain.yaml --plot-kind components",
        "chain.yaml --plot-kind invariants", "chain.yaml --plot-kind manifold",
        "chain.yaml --plot-kind steps", "chain.yaml --plot-kind 3d", "cotangent.yaml --plot-kind 3d",
        "rigid.yaml --plot-kind 3d", "chain.yaml --method rk4 --steps 20",
        /* zero all along */
        "rigid.yaml --plot-kind manifold"};
    char line[256];
    for (size_t i = 0; i < LG_COUNT(arguments); i++) {
        (void)snprintf(line, sizeof line, "%s --plot p%zu.svg", arguments[i], i);
        run(line);
        (void)snprintf(line, sizeof line, "p%zu.gp", i);
        assert_true(cli_exists(line));
        (void)snprintf(line, sizeof line, "p%zu.svg", i);
        if (!cli_exists(line) && strstr(result.err, "gnuplot is not installed") == NULL)
            fail_msg("%s: no picture: %s", arguments[i], result.err);
    }
}

/* ---- work and precision ---- */

TEST("work and precision of schemes are compared") {
    run("rigid.yaml --work-precision --methods rkmk4,rkmk54 --levels 5 --plot w.svg --json");
    const char *reference = json_find(result.out, "reference");
    assert_non_null(reference);
    assert_true(json_number(reference, "error") < 1e-9);
    const char *s = json_find(result.out, "work_precision");
    assert_non_null(s);
    size_t count = 0;
    double before = 0, steps = 0, slope = 0;
    for (s = strchr(s, '{'); s != NULL; s = strchr(s + 1, '{'), count++) {
        const double error = json_number(s, "error");
        assert_true(error > 0 && error < 1 && json_number(s, "seconds") > 0 &&
                    json_number(s, "evaluations") > 0);
        const bool fixed = strncmp(json_find(s, "method"), "\"rkmk4\"", 7) == 0;
        if (fixed && json_number(s, "steps") == 2 * steps) slope = log2(before / error);
        if (!fixed && json_find(s, "tol") == NULL) fail_msg("no tol in %s", s);
        before = error;
        steps = json_number(s, "steps");
        if (count < 4) slope = 0; /* the finest pair alone */
        if (count == 4) break;
    }
    assert_int_equal(count, 4);
    assert_close(slope, 4, 0.05, 0);
    run("oscillator.yaml --work-precision --levels 4");
    assert_non_null(strstr(result.out, "stormer-verlet"));
    assert_non_null(strstr(result.out, "the reference is dp54"));
    assert_null(strstr(result.out, "rkmk4"));
    assert_true(cli_exists("w.gp"));
}

/* ---- gradients ---- */

#define WEIGHTS "0.3,-0.2,0.5,0.1,0.7,-0.4,0.25,-0.6,0.15,0.35,-0.45,0.55"

static double functional(const char *options) {
    char arguments[256], *word = (char[]){WEIGHTS};
    double y[12], sum = 0;
    (void)snprintf(arguments, sizeof arguments, "varied.yaml --json %s", options);
    run(arguments);
    assert_int_equal(json_array(result.out, "y", y, 12), 12);
    for (size_t i = 0; i < 12; i++, word++) sum += strtod(word, &word) * y[i];
    return sum;
}

/* dJ by a symmetric difference of the executable's own runs. */
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

/* `more` goes with --gradient only. */
static void check_gradient(const char *options, const char *more, double tolerance) {
    static const double directions[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const char *const labels[] = {"g", "m2"};
    char arguments[512];
    double dy0[12], expected;
    (void)snprintf(arguments, sizeof arguments, "chain.yaml --json --gradient " WEIGHTS " %s %s", options,
                   more);
    run(arguments);
    char *text = strdup(result.out);
    write_chain("varied.yaml", 9.81, 1.3, 0.2);
    assert_close(json_number(text, "J"), functional(options), 1e-12, 1e-13);
    for (int i = 0; i < 2; i++) {
        expected = difference(options, directions[i]);
        assert_close(json_number(json_find(text, "dJ_dparameters"), labels[i]), expected, tolerance,
                     tolerance);
    }
    assert_int_equal(json_array(text, "dJ_dy0", dy0, 12), 12);
    expected = difference(options, directions[2]);
    assert_close(dy0[9], expected, tolerance, tolerance);
    /* Tangent to |q| = 1, q.omega = 0: no part along the normals (q, 0) and (omega, q). */
    const double normal_a = 0.6 * dy0[7] + 0.8 * dy0[8];
    const double normal_b = 0.2 * dy0[6] + 0.3 * dy0[7] - 0.225 * dy0[8] + 0.6 * dy0[10] + 0.8 * dy0[11];
    assert_close(normal_a, 0, 0, 1e-12);
    assert_close(normal_b, 0, 0, 1e-12);
    free(text);
}

TEST("the gradient of an end is that of differences") {
    check_gradient("--method rkmk4 --steps 60", "", 1e-6);
    check_gradient("--method cf4 --steps 60", "--checkpoints 7", 1e-6);
    check_gradient("--method rk4 --steps 60", "", 1e-6);
    check_gradient("--method rk4-projected --steps 20", "", 1e-6);
    check_gradient("--tol 1e-11", "", 1e-6);
    cli_write("weights.txt", "0.3 -0.2\n0.5,0.1,\t0.7 -0.4 0.25 -0.6 0.15 0.35 -0.45 0.55\n");
    run("chain.yaml --method rkmk4 --steps 60 --json --gradient @weights.txt");
    const double j = json_number(result.out, "J");
    run("chain.yaml --method rkmk4 --steps 60 --json --checkpoints 5 --gradient " WEIGHTS);
    assert_close(json_number(result.out, "J"), j, 0, 0);
    assert_close(json_number(result.out, "checkpoints"), 5, 0, 0);
    assert_true(json_number(result.out, "tape_bytes") > 0);
    run("oscillator.yaml --tol 1e-12 --json --gradient 1,0");
    double dy0[2];
    assert_int_equal(json_array(result.out, "dJ_dy0", dy0, 2), 2);
    assert_close(dy0[0], cos(3), 0, 1e-9);
    assert_close(dy0[1], sin(3), 0, 1e-9);
    run("oscillator.yaml --method stormer-verlet --steps 3000 --json --gradient 0,1");
    assert_int_equal(json_array(result.out, "dJ_dy0", dy0, 2), 2);
    assert_close(dy0[0], -sin(3), 0, 1e-6);
    run("chain.yaml --gradient " WEIGHTS);
    assert_non_null(strstr(result.out, "and in the parameters:"));
}

/* ---- Ctrl-C ---- */

static void interrupt(const char *arguments) {
    const struct timespec pause = {0, 150000000};
    const cli_child child = cli_start(lg, arguments, 0);
    (void)nanosleep(&pause, NULL);
    assert_int_equal(kill(child.pid, SIGINT), 0);
    cli_finish(child, &result);
    if (result.code != 130) fail_msg("%s: exit code %d: %s", arguments, result.code, result.err);
    assert_string_equal(result.out, "");
    assert_non_null(strstr(result.err, "stopped by Ctrl-C"));
}

TEST("Ctrl-C ends a run") {
    interrupt("chain.yaml --method rkmk4 --steps 1000000000 --json");
    interrupt("chain.yaml --tol 1e-13 --t-end 1e6 --max-steps 1000000000 --json");
    interrupt("chain.yaml --work-precision --t-end 300 --tol 1e-9 --json");
    interrupt(
        "rigid.yaml --method rkmk4 --steps 1000000000 --t-end 1000000 --points 1000001 --out part.h5 --json");
    assert_true(cli_exists("part.h5"));
    assert_non_null(strstr(result.err, "points reached"));
}

TEST_GROUP(setup, cli_end)

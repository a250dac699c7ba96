/* lg-elastica (in LG_BIN_DIR) from outside: equilibria with known energies, hard cases, bad input, training
 * that is interrupted and resumed, searches likewise. */
#include "cli_support.h"

#include <hdf5.h>

#include "liegrad/io.h"

static const char lg[] = "lg-elastica";
static cli result;

static const char ranges[] = "fixed: {network: discrete, batch: 16, epochs: 6, mirror: true}\n"
                             "ranges:\n"
                             "  architecture: {choice: [mlp, resnet]}\n"
                             "  layers: {integer: [0, 2]}\n"
                             "  hidden: {integer: [4, 12]}\n"
                             "  gamma: {uniform: [0, 1e-2]}\n"
                             "  lr: {log-uniform: [1e-4, 1e-1]}\n";

#define TRAIN  "train data.h5 --hidden 12 --layers 1 --batch 8 "
#define SEARCH "search ranges.yaml data.h5 --trials 6 --warm-up 2 "
#define PI     3.14159265358979323846

static void run(const char *arguments) {
    cli_expect(lg, arguments, 0, "", &result);
}

/* Numbers of an array of numbers, or of an array of such arrays, one after the other. */
static size_t json_array(const char *text, const char *key, double *out, size_t room) {
    const char *s = json_find(text, key);
    if (s == NULL || *s != '[') fail_msg("no array '%s' in %.200s", key, text);
    size_t n = 0;
    for (int depth = 0; s != NULL; s++) {
        if (*s == '[') depth++;
        if (*s == ']' && --depth == 0) break;
        if (strchr("[], ", *s) != NULL) continue;
        const char *end = json_number_end(s);
        if (end == NULL) fail_msg("'%s' holds no numbers", key);
        if (n < room) out[n] = strtod(s, NULL);
        n++;
        s = end - 1;
    }
    return n;
}

/* Copies a data file with one number of a data set changed. */
static void write_spoilt(const char *name, const char *set_name, size_t index, double value) {
    static double data[16384];
    char path[1024];
    (void)snprintf(path, sizeof path, "generate --count 6 --intervals 8 --out %s", name);
    run(path);
    cli_path(name, path, sizeof path);
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t set = H5Dopen2(file, set_name, H5P_DEFAULT);
    assert_true(H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    data[index] = value;
    assert_true(H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Fclose(file) >= 0);
}

static int setup(void **state) {
    (void)state;
    if (cli_begin() != 0) return -1;
    cli_write("ranges.yaml", ranges);
    run("generate --case both-ends --count 40 --intervals 10 --out data.h5");
    run("generate --case right-end --count 40 --intervals 10 --out right.h5");
    run("generate --case both --count 10 --intervals 10 --out both.h5");
    run("generate --case both-ends --count 8 --intervals 6 --out coarse.h5");
    run("generate --case both-ends --count 8 --intervals 10 --length 4 --out long.h5");
    write_spoilt("nan.h5", "q", 31, NAN);
    write_spoilt("torn.h5", "boundary", 8, 0.25);
    cli_link("data.h5", "link.h5");
    cli_link("data.h5", "link.dat");
    run(TRAIN "--epochs 3 --out model.h5");
    run("train data.h5 --network angle --embedding 4 --hidden 4 --layers 1 --epochs 1 --out angle.h5");
    return 0;
}

/* ---- bad input: exit code and words of the sentence ---- */

static const cli_bad bad_input[] = {
    {"", 2, "which command"},
    {"bend", 2, "'bend' is no command"},
    {"--bogus", 2, "--bogus"},
    {"solve", 2, "no boundary conditions: give --case and --x, or --theta0 and --thetaN"},
    {"solve extra --x 1", 2, "'extra' is one argument too many"},
    {"solve --case both-ends", 2, "--x X is missing"},
    {"solve --case left-end --x 1", 2, "--case: 'left-end' is not one of both-ends, right-end"},
    {"solve --x nan", 2, "--x: 'nan'"},
    {"solve --x inf", 2, "--x: 'inf'"},
    {"solve --x 1,2", 2, "--x: '1,2'"},
    {"solve --x 1 --theta0 1", 2, "either --case and --x or --theta0 and --thetaN"},
    {"solve --theta0 nan --thetaN 1", 2, "--theta0: 'nan'"},
    {"solve --theta0 1", 2, "--thetaN B is missing"},
    {"solve --thetaN 1", 2, "--theta0 A is missing"},
    {"solve --theta0 1 --thetaN -1 --rotation 1", 2, "the nearest that do are -2 and 4.28318530718"},
    {"solve --theta0 1 --thetaN -1 --rotation -2.000001", 2, "the nearest that do are -2 and"},
    {"solve --x 1 --intervals 1", 2, "--intervals: '1'"},
    {"solve --x 1 --intervals 50.5", 2, "--intervals: '50.5'"},
    {"solve --x 1 --length 0", 2, "--length: '0'"},
    {"solve --x 1 --length 2.9", 2, "the ends are 3 apart"},
    {"solve --x 1 --length 3", 2, "the ends are 3 apart"},
    {"solve --x 1 --stiffness -1", 2, "--stiffness: '-1'"},
    {"solve --x 1 --q0 1", 2, "--q0: two numbers, x,y; not 1"},
    {"solve --x 1 --qN 1,2,3", 2, "--qN: two numbers, x,y; not 3"},
    {"solve --x 1 --qN 1,nan", 2, "--qN: '1,nan'"},
    {"solve --x 1 --qN 5,0", 2, "the ends are 5 apart"},
    {"solve --x 1 --gradient-tol 0", 2, "--gradient-tol: '0'"},
    {"solve --x 1 --branches --continuous", 2, "--continuous: --branches is of the discrete problem"},
    {"solve --x 1 --saddles", 2, "--saddles: works together with"},
    {"solve --x 1 --sweep 5", 2, "--x: --sweep goes over the x of a case"},
    {"solve --sweep 1", 2, "--sweep: '1'"},
    {"solve --sweep 5 --branches", 2, "either --branches or --sweep"},
    {"solve --sweep 3 --length 2", 2, "the ends are 3 apart"},
    {"solve --x 1 --plot c.pdf", 2, "c.pdf"},
    {"solve --x 1 --plot nowhere/c.svg", 3, "nowhere/c.svg"},
    {"solve --x 1 --out nowhere/c.csv", 3, "nowhere/c.csv"},
    {"solve --x 1 --out .", 3, "folder"},
    {"generate", 2, "--out FILE is missing"},
    {"generate --out d.h5 --case neither", 2, "--case: 'neither' is not one of both-ends, right-end, both"},
    {"generate --out d.h5 --count 0", 2, "--count: '0'"},
    {"generate --out d.h5 --intervals 1", 2, "--intervals: '1'"},
    {"generate --out d.h5 --gap 0.5", 2, "--gap: '0.5'"},
    {"generate --out d.h5 --gap -0.1", 2, "--gap: '-0.1'"},
    {"generate --out d.h5 --gap nan", 2, "--gap: 'nan'"},
    {"generate --out d.h5 --length 2.5 --count 4", 2, "the ends are 3 apart"},
    {"generate --out nowhere/d.h5", 3, "nowhere/d.h5"},
    {"generate --out d.h5 --plot d.jpg", 2, "d.jpg"},
    {"solve --x 1 --qN 1,nan", 2, "'1,nan' is not a list, separated by commas, of: a number\n"},
    {"solve --x 1 --intervals 99999999", 2, "of at least 2 and at most"},
    {"solve --x 1 --stiffness 1e301", 2, "'1e301' is not a number above 0 and at most 1e+300\n"},
    {"solve --x 1 --stiffness 0", 2, "'0' is not a number above 0\n"},
    {"solve --x 1 --seed 18446744073709551616", 2, "a whole number of at least 0 and below 2^64\n"},
    {"solve --x 1 --out c.dat --plot c.svg", 2, "--plot: c.dat is what --out writes too"},
    {"solve --sweep 3 --out c.gp --plot c.svg", 2, "--plot: c.gp is what --out writes too"},
    {"generate --out d.gp --plot d.svg", 2, "--plot: d.gp is what --out writes too"},
    {"generate --out d.svg --plot nowhere/../d.svg", 3, "nowhere"},
    {"generate --out d.svg --plot ./d.svg", 2, "--plot: ./d.svg is what --out writes too"},
    {"train data.h5 --out data.h5", 2, "--out: data.h5 is an input and would be replaced"},
    {"train data.h5 --out ./data.h5", 2, "--out: ./data.h5 is an input"},
    {"train data.h5 --out link.h5", 2, "--out: link.h5 is an input"},
    {"train link.dat --out link.h5", 2, "--out: link.h5 is an input"},
    {"train data.h5 --out m.h5 --history link.h5", 2, "--history: link.h5 is an input"},
    {"train data.h5 --out m.h5 --history ./m.h5", 2, "--history: ./m.h5 is what --out writes too"},
    {"train data.h5 --out m.h5 --history m.h5.checkpoint", 2, "is what --checkpoint writes too"},
    {"train data.h5 --out m.dat --plot m.svg", 2, "--plot: m.dat is what --out writes too"},
    {"train data.h5 --out model.h5 --resume model.h5", 2, "--out: model.h5 is an input of --resume"},
    {"train data.h5 --out m.h5 --resume data.h5", 3, "data.h5"},
    {"train data.h5 --out m.h5 --resume data.h5 --checkpoint data.h5", 2,
     "--checkpoint: data.h5 is an input"},
    {"train data.h5 --out m.h5 --network angle --gamma 1", 2, "--gamma: --network angle has no such option"},
    {"evaluate model.h5 link.dat --plot link.svg", 2, "--plot: link.dat is an input"},
    {"predict model.h5 --x 1 --out model.h5", 2, "--out: model.h5 is an input"},
    {"predict model.h5 --x 1 --out p.gp --plot p.png", 2, "--plot: p.gp is what --out writes too"},
    {"search ranges.yaml data.h5 --out data.h5", 2, "--out: data.h5 is an input"},
    {"search ranges.yaml data.h5 --out ranges.yaml", 2, "--out: ranges.yaml is an input"},
    {"search ranges.yaml data.h5 --out s.dat --plot s.svg", 2, "--plot: s.dat is what --out writes too"},
    {"train", 2, "missing argument"},
    {"train data.h5", 2, "--out FILE is missing"},
    {"train data.h5 --out m.h5 --network deep", 2, "--network: 'deep' is not one of discrete, continuous"},
    {"train data.h5 --out m.h5 --normalise yes", 2, "--normalise: 'yes' is not one of false, true"},
    {"train data.h5 --out m.h5 --boundary true", 2, "--boundary: --network discrete has no"},
    {"train both.h5 --out m.h5 --network angle --preset thesis", 2, "--preset: thesis has no settings"},
    {"train data.h5 --out m.h5 --train-fraction 0.95 --test-fraction 0.1", 2, "more than 1 together"},
    {"train data.h5 --out m.h5 --train-fraction 0.001", 2, "no curve of 40 to train on"},
    {"train data.h5 --out m.h5 --plot l.pdf", 2, "l.pdf"},
    {"train data.h5 --out nowhere/m.h5", 3, "nowhere/m.h5"},
    {"train data.h5 --out m.h5 --history nowhere/h.csv", 3, "nowhere/h.csv"},
    {"train missing.h5 --out m.h5", 3, "missing.h5"},
    {"train empty.h5 --out m.h5", 3, "empty.h5"},
    {"train foreign.h5 --out m.h5", 3, "foreign.h5"},
    {"train model.h5 --out m.h5", 3, "model.h5"},
    {"train nan.h5 --out m.h5", 3, "nan.h5: /q: NaN at index (1, 6, 1)"},
    {"train torn.h5 --out m.h5", 3, "torn.h5"},
    {"train data.h5 --out m.h5 --resume missing.h5", 3, "missing.h5"},
    {"train data.h5 --out m.h5 --resume model.h5", 3, "model.h5"},
    {"train data.h5 --out m.h5 --resume model.h5 --preset best", 2, "--preset: a resumed run"},
    {"train data.h5 --hidden 12 --layers 14 --batch 8 --out m.h5 --lr 1e3 --schedule constant --activation "
     "identity --epochs 9",
     4, "epoch"},
    {"evaluate model.h5", 2, "missing argument"},
    {"evaluate missing.h5 data.h5", 3, "missing.h5"},
    {"evaluate model.h5 missing.h5", 3, "missing.h5"},
    {"evaluate data.h5 model.h5", 3, "data.h5"},
    {"evaluate model.h5 nan.h5", 3, "NaN"},
    {"evaluate model.h5 coarse.h5", 3, "coarse.h5"},
    {"evaluate model.h5 long.h5", 3, "long.h5"},
    {"evaluate angle.h5 long.h5", 3, "long.h5"},
    {"evaluate model.h5 data.h5 --part half", 2, "--part: 'half'"},
    {"evaluate model.h5 right.h5 --part test", 2, "was not trained on right.h5"},
    {"evaluate model.h5 data.h5 --plot e.gif", 2, "e.gif"},
    {"predict model.h5", 2, "no boundary conditions"},
    {"predict model.h5 --x nan", 2, "--x: 'nan'"},
    {"predict model.h5 --x 1 --s 0,4", 2, "--s: 4 is outside [0, 3.3], the beam"},
    {"predict model.h5 --x 1 --s -1,1", 2, "--s: -1 is outside"},
    {"predict model.h5 --x 1 --s 1,0.5", 2, "--s: 0.5 stands after 1; they must rise"},
    {"predict model.h5 --x 1 --s 1 --points 5", 2, "either --s or --points"},
    {"predict model.h5 --x 1 --points 1", 2, "--points: '1'"},
    {"predict model.h5 --x 1 --qN 9,0", 2, "the ends are 9 apart"},
    {"predict missing.h5 --x 1", 3, "missing.h5"},
    {"predict data.h5 --x 1", 3, "data.h5"},
    {"predict model.h5 --x 1 --out nowhere/p.csv", 3, "nowhere/p.csv"},
    {"search ranges.yaml data.h5", 2, "--out FILE.csv is missing"},
    {"search ranges.yaml --out s.csv", 2, "missing argument"},
    {"search missing.yaml data.h5 --out s.csv", 3, "missing.yaml"},
    {"search ranges.yaml missing.h5 --out s.csv", 3, "missing.h5"},
    {"search data.h5 data.h5 --out s.csv", 3, "data.h5"},
    {"search ranges.yaml data.h5 --out nowhere/s.csv", 3, "nowhere/s.csv"},
    {"search ranges.yaml data.h5 --out s.csv --trials 0", 2, "--trials: '0'"},
    {"search ranges.yaml data.h5 --out s.csv --rungs 17", 2, "--rungs: '17'"},
    {"search ranges.yaml data.h5 --out s.csv --quantile 0", 2, "--quantile: '0'"},
    {"search ranges.yaml data.h5 --out s.csv --validation 1", 2, "--validation: '1'"},
    {"search ranges.yaml data.h5 --out ranges.yaml --resume", 2, "--out: ranges.yaml is an input"},
};

TEST("a refused command line tells its exit code and word, and writes nothing") {
    cli_expect_refused(lg, bad_input, sizeof bad_input / sizeof bad_input[0], &result);
    static const char *const outputs[] = {"m.h5", "d.h5", "s.csv", "c.svg", "d.svg", "link.svg"};
    for (size_t i = 0; i < sizeof outputs / sizeof outputs[0]; i++) assert_false(cli_exists(outputs[i]));
}

TEST("a list that is too long is refused with its length") {
    char line[2048] = "predict model.h5 --x 1 --s 0";
    for (int i = 1; i < 256; i++) (void)strcat(line, ",1");
    run(line);
    (void)strcat(line, ",1");
    cli_expect(lg, line, 2, "--s: a list of 257 numbers is too long: at most 256; use --points\n", &result);
    (void)strcat(line, ",x");
    cli_expect(lg, line, 2, "a list of 258 numbers", &result);
    line[sizeof "predict model.h5 --x 1 --s 0" + 300] = 'x';
    line[sizeof "predict model.h5 --x 1 --s 0" + 301] = '\0';
    cli_expect(lg, line, 2, ",1,1,...' is not a list", &result);
}

/* Ranges of a search that train would not take: each with the line that is wrong. */
static const char *const bad_ranges[][2] = {
    {"fixed: {bogus: 1}\nranges:\n  layers: {integer: [0, 4]}\n", "line 1: 'bogus' is no option of train"},
    {"fixed:\n  out: m.h5\nranges:\n  layers: {integer: [0, 4]}\n", "line 2: 'out' is no option of train"},
    {"ranges:\n  resume: {choice: [a, b]}\n", "line 2: 'resume' is no option of train"},
    {"ranges:\n  layers: {integer: [0, 4]}\n  width: {integer: [1, 4]}\n", "line 3: 'width' is no option"},
    {"ranges:\n  layers: {integer: [0, 15]}\n", "line 2: layers: '15'"},
    {"ranges:\n  layers: {uniform: [0, 4]}\n", "line 2: layers: '1.5"},
    {"ranges:\n  lr: {uniform: [0, 1]}\n", "line 2: lr: '0'"},
    {"ranges:\n  activation: {choice: [tanh, tan]}\n", "line 2: activation: 'tan' is not one of"},
    {"fixed: {epochs: 0}\nranges:\n  layers: {integer: [0, 4]}\n", "line 1: epochs: '0'"},
    {"ranges:\n  lr: {log-uniform: [0, 1]}\n", "line 2"},
    {"ranges:\n  lr: {gaussian: [0, 1]}\n", "line 2"},
    {"fixed: {lr: 1}\n", "ranges"},
    {"ranges: [1, 2\n", "bad.yaml"},
    {"ranges:\n  lr: {log-uniform: [1, 1e4]}\n",
     "line 2: lr: '10000' is not a number above 0 and at most 1000"},
    {"fixed: {network: angle}\nranges:\n  gamma: {uniform: [0, 1]}\n",
     "line 3: 'gamma' is no option of --network angle"},
};

TEST("bad ranges of a search are refused with their line") {
    cli_expect_bad_ranges(lg, bad_ranges, sizeof bad_ranges / sizeof bad_ranges[0], &result);
}

TEST("every command has help") {
    static const char *const commands[] = {"solve", "generate", "train", "evaluate", "predict", "search"};
    cli_expect_help(lg, commands, sizeof commands / sizeof commands[0], &result);
}

/* ---- solve ---- */

/* Energies at N = 1000 found by another program. */
TEST("energies are those that another program found at N = 1000") {
    run("solve --case both-ends --x 1.0471975511965976 --intervals 1000 --json");
    assert_close(json_number(result.out, "energy"), 9.695403610363, 1e-10, 0);
    run("solve --case both-ends --x 1.5707963267948966 --intervals 1000 --json");
    assert_close(json_number(result.out, "energy"), 45.752542288901, 1e-10, 0);
    run("solve --theta0 1.5707963267948966 --thetaN -1.5707963267948966 --intervals 1000 --json");
    assert_close(json_number(result.out, "energy"), 45.752542288901, 1e-10, 0);
}

TEST("a solution meets its boundary conditions, and is written as it was found") {
    static const char *const keys[] = {
        "energy", "residual", "gradient",   "multiplier", "lambda",
        "v",      "seconds",  "iterations", "theta",      "negative_eigenvalues"};
    double q[22], v[22], numbers[11];
    run("solve --case right-end --x 2 --intervals 10 --json");
    assert_true(json_is_object(result.out));
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        if (json_find(result.out, keys[i]) == NULL) fail_msg("no key '%s'", keys[i]);
    assert_int_equal(json_array(result.out, "q", q, 22), 22);
    assert_int_equal(json_array(result.out, "v", v, 22), 22);
    assert_int_equal(json_array(result.out, "multiplier", numbers, 11), 2);
    assert_int_equal(json_array(result.out, "lambda", numbers, 11), 9);
    assert_int_equal(json_array(result.out, "theta", numbers, 11), 11);
    assert_close(json_number(result.out, "rotation"), -2, 1e-15, 0);
    assert_close(json_number(result.out, "negative_eigenvalues"), 0, 0, 0);
    assert_true(json_number(result.out, "gradient") < 1e-10 && json_number(result.out, "residual") < 1e-8);
    assert_close(q[0], 0, 0, 0);
    assert_close(q[20], 3, 1e-13, 0);
    assert_close(q[21], 0, 0, 1e-13);
    assert_close(v[20], cos(2), 1e-13, 0);
    assert_close(v[21], -sin(2), 1e-13, 0);
    /* The force is what the energy gains with the distance of the ends. */
    double force[2];
    (void)json_array(result.out, "multiplier", force, 2);
    run("solve --case right-end --x 2 --intervals 10 --qN 3.00001,0 --json");
    const double more = json_number(result.out, "energy");
    run("solve --case right-end --x 2 --intervals 10 --qN 2.99999,0 --json");
    assert_close(force[0], (more - json_number(result.out, "energy")) / 2e-5, 1e-5, 0);
    run("solve --x 2 --intervals 2");
    run("solve --x 2 --intervals 2 --json");
    assert_int_equal(json_array(result.out, "lambda", numbers, 11), 1);
}

/* Another place, direction, size and stiffness: E scales with EI/L. */
TEST("the energy scales with EI/L, at any place, direction and size") {
    run("solve --theta0 0.7 --thetaN -0.4 --json");
    const double energy = json_number(result.out, "energy");
    run("solve --theta0 2.270796326794897 --thetaN 1.1707963267948966 --q0 1,-2 --qN 1,4 --length 6.6 "
        "--stiffness 30 --json");
    assert_close(json_number(result.out, "energy"), 1.5 * energy, 1e-10, 0);
}

TEST("the rotation that is asked for is found or refused") {
    double rotation;
    run("solve --theta0 1 --thetaN -1 --json");
    const double best = json_number(result.out, "energy");
    assert_close(json_number(result.out, "rotation"), -2, 1e-12, 0);
    /* The other loop is a minimum for large angles only; otherwise there is nothing to accept. */
    cli_expect(lg, "solve --theta0 1 --thetaN -1 --rotation 4.283185307179586 --json", 4, "no minimum",
               &result);
    assert_string_equal(result.out, "");
    run("solve --theta0 3.1 --thetaN -3.1 --rotation 6.366370614359172 --json");
    rotation = json_number(result.out, "rotation");
    assert_close(rotation, 4 * PI - 6.2, 1e-12, 0);
    const double opposite = json_number(result.out, "energy");
    run("solve --theta0 3.1 --thetaN -3.1 --json");
    assert_true(json_number(result.out, "energy") < opposite);
    /* Without --thetaN the rotation gives it. */
    run("solve --theta0 1 --rotation -2 --json");
    assert_close(json_number(result.out, "energy"), best, 1e-12, 0);
    /* A whole turn is less work here than the smaller angle. */
    run("solve --theta0 2.9 --thetaN -2.9 --json");
    assert_close(json_number(result.out, "rotation"), -5.8, 1e-12, 0);
    run("solve --case both-ends --x 2.9 --json");
    assert_close(json_number(result.out, "rotation"), -5.8, 1e-12, 0);
}

/* Energies of the branches, by their documented values; NAN: any. */
static size_t branch_energies(const char *arguments, double *energies, size_t room) {
    run(arguments);
    assert_true(json_is_object(result.out));
    const char *s = json_find(result.out, "branches");
    assert_non_null(s);
    size_t n = 0;
    for (s = json_space(s + 1); *s == '{' && n < room; s = json_space(s + (*s == ','))) {
        energies[n++] = json_number(s, "energy");
        if (strstr(arguments, "--saddles") == NULL)
            assert_close(json_number(s, "negative_eigenvalues"), 0, 0, 0);
        s = json_space(json_value(s));
    }
    return n;
}

TEST("hard cases have their known minima") {
    double energies[64];
    size_t n =
        branch_energies("solve --case both-ends --x 3.141592653589793 --branches --json", energies, 64);
    assert_int_equal(n, 4);
    for (size_t i = 0; i < 4; i++) assert_close(energies[i], i < 2 ? 420.415 : 439.367, 2e-6, 0);
    run("solve --case both-ends --x 3.141592653589793 --json");
    assert_close(json_number(result.out, "energy"), 420.415, 2e-6, 0);
    /* A second minimum up to |w| = 0.1925 pi. */
    n = branch_energies("solve --case both-ends --x 0.59 --branches --json", energies, 64);
    assert_int_equal(n, 2);
    n = branch_energies("solve --case both-ends --x 0.62 --branches --json", energies, 64);
    assert_int_equal(n, 1);
    /* The wrong-way buckle up to 0.171 pi. */
    n = branch_energies("solve --case right-end --x 0.53 --branches --json", energies, 64);
    assert_int_equal(n, 2);
    n = branch_energies("solve --case right-end --x 0.55 --branches --json", energies, 64);
    assert_int_equal(n, 1);
    /* At the bifurcations themselves there is an answer, and it is a minimum. */
    static const char *const angles[] = {"0", "3.141592653589793", "6.283185307179586", "-3.141592653589793"};
    for (size_t i = 0; i < 8; i++) {
        char line[128];
        (void)snprintf(line, sizeof line, "solve --case %s --x %s --json", i < 4 ? "both-ends" : "right-end",
                       angles[i % 4]);
        run(line);
        assert_close(json_number(result.out, "negative_eigenvalues"), 0, 0, 0);
    }
}

TEST("there are more branches with saddles than without") {
    double minima[64], all[64];
    const size_t few = branch_energies("solve --x 0.3 --intervals 20 --branches --json", minima, 64);
    const size_t many = branch_energies("solve --x 0.3 --intervals 20 --branches --saddles --json", all, 64);
    assert_true(many > few);
    run("solve --x 0.3 --intervals 20 --branches --saddles");
    assert_non_null(strstr(result.out, "saddle"));
    assert_non_null(strstr(result.out, "minimum"));
    run("solve --x 0.3 --intervals 20 --branches --rotation -0.6 --plot all.svg --out all.csv --json");
    assert_true(cli_exists("all.gp") && cli_exists("all.csv"));
    if (!cli_exists("all.svg")) assert_non_null(strstr(result.err, "gnuplot"));
}

TEST("the continuous problem is what the discrete one converges to") {
    run("solve --x 1 --continuous --json");
    const double limit = json_number(result.out, "energy");
    assert_null(json_find(result.out, "lambda"));
    run("solve --x 1 --intervals 100 --json");
    const double coarse = json_number(result.out, "energy") - limit;
    run("solve --x 1 --intervals 200 --json");
    const double fine = json_number(result.out, "energy") - limit;
    assert_close(coarse / fine, 4, 0.02, 0);
}

TEST("a sweep follows the branches") {
    char text[8192];
    run("solve --case right-end --sweep 9 --intervals 12 --plot sweep.svg --out sweep.csv --json");
    assert_true(json_is_object(result.out));
    double x[9];
    assert_int_equal(json_array(result.out, "x", x, 9), 9);
    assert_close(x[8], 2 * PI, 1e-15, 0);
    assert_true(json_number(result.out, "branches") >= 2);
    assert_true(cli_exists("sweep.gp"));
    cli_read("sweep.csv", text, sizeof text);
    assert_int_equal(strncmp(text, "branch,x,energy,negative_eigenvalues,rotation\n1,", 48), 0);
    run("solve --case right-end --sweep 9 --intervals 12 --threads 1");
    assert_non_null(strstr(result.out, "energy from"));
}

/* ---- generate ---- */

TEST("generated curves are those that are asked for, and the same for the same seed") {
    run("generate --case both --count 5 --intervals 7 --gap 0.02 --out g.h5 --plot g.svg --json");
    assert_true(json_is_object(result.out));
    assert_close(json_number(result.out, "curves"), 10, 0, 0);
    assert_close(json_number(result.out, "intervals"), 7, 0, 0);
    char path[1024];
    lg_elastica_data data;
    cli_path("g.h5", path, sizeof path);
    assert_ok(lg_elastica_data_read(NULL, path, NULL, &data, NULL));
    const lg_elastica_curves *c = &data.curves;
    assert_int_equal(c->count, 10);
    /* Three values in the first half, two in the second, for each case; the energies are those of solve. */
    assert_close(c->x[0], 0.02 * PI, 1e-14, 0);
    assert_close(c->x[1], 0.5 * PI, 1e-14, 0);
    assert_close(c->x[2], 0.98 * PI, 1e-14, 0);
    assert_int_equal(c->kind[0], LG_ELASTICA_BOTH_ENDS);
    assert_int_equal(c->kind[9], LG_ELASTICA_RIGHT_END);
    run("solve --case both-ends --x 1.5707963267948966 --intervals 7 --json");
    assert_close(json_number(result.out, "energy"), c->energy[1], 1e-12, 0);
    double q[16];
    assert_int_equal(json_array(result.out, "q", q, 16), 16);
    for (size_t i = 0; i < 16; i++) assert_close(c->q[16 + i], q[i], 0, 1e-10);
    lg_elastica_data_destroy(&data);
    /* The same bits whatever the threads. */
    run("generate --case both --count 5 --intervals 7 --gap 0.02 --out g1.h5 --threads 1 --json");
    const char *hash = json_find(result.out, "sha256");
    char first[80];
    (void)snprintf(first, sizeof first, "%.66s", hash);
    run("generate --case both --count 5 --intervals 7 --gap 0.02 --out g1.h5 --threads 2 --json");
    assert_int_equal(strncmp(json_find(result.out, "sha256"), first, 66), 0);
    run("generate --count 3 --intervals 2 --out tiny.h5");
    run("generate --count 1 --intervals 6 --out one.h5");
    run("generate --count 2 --intervals 6 --continuous --out c.h5 --json");
    assert_non_null(strstr(result.out, "\"values\": \"continuous\""));
    /* N = 2 can be learned too. */
    run("train tiny.h5 --hidden 4 --layers 0 --epochs 1 --train-fraction 1 --test-fraction 0 --out t2.h5 "
        "--json");
    assert_int_equal(strncmp(json_find(result.out, "test_mse"), "null", 4), 0);
}

/* Processor time of the children that have ended: a busy machine does not change it. */
static double children_seconds(void) {
    struct rusage use;
    assert_int_equal(getrusage(RUSAGE_CHILDREN, &use), 0);
    return (double)(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
           1e-6 * (double)(use.ru_utime.tv_usec + use.ru_stime.tv_usec);
}

TEST("interrupted generation ends at once") {
    const struct timespec pause = {0, 400000000};
    const double begin = children_seconds();
    const cli_child child =
        cli_start(lg, "generate --count 100000 --intervals 100 --out many.h5 --threads 1", 0);
    (void)nanosleep(&pause, NULL);
    assert_int_equal(kill(child.pid, SIGINT), 0);
    cli_finish(child, &result);
    assert_int_equal(result.code, 130);
    assert_non_null(strstr(result.err, "stopped by Ctrl-C"));
    assert_true(children_seconds() - begin <= 2);
    assert_false(cli_exists("many.h5"));
}

/* ---- train, evaluate, predict ---- */

TEST("a network is trained and judged") {
    static const char *const keys[] = {"train_mse", "test_mse", "seconds_per_epoch", "parameters",
                                       "loss",      "epochs",   "threads",           "dtype",
                                       "seed",      "source"};
    run(TRAIN "--epochs 4 --out t.h5 --history t.csv --plot t.svg --json");
    assert_true(json_is_object(result.out));
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        if (json_find(result.out, keys[i]) == NULL) fail_msg("no key '%s'", keys[i]);
    assert_close(json_number(result.out, "epochs"), 4, 0, 0);
    /* 8 x 12 + 12, 12 x 12 + 12, 12 x 36 + 36 */
    assert_close(json_number(result.out, "parameters"), 732, 0, 0);
    assert_close(json_number(result.out, "train_curves"), 36, 0, 0);
    assert_close(json_number(result.out, "test_curves"), 4, 0, 0);
    const double train_mse = json_number(result.out, "train_mse"),
                 test_mse = json_number(result.out, "test_mse");
    /* What evaluate says of the parts is what train said. */
    run("evaluate t.h5 data.h5 --part train --json");
    assert_close(json_number(result.out, "mse"), train_mse, 1e-12, 0);
    assert_close(json_number(result.out, "curves"), 36, 0, 0);
    run("evaluate t.h5 data.h5 --part test --json");
    assert_close(json_number(result.out, "mse"), test_mse, 1e-12, 0);
    run("evaluate t.h5 data.h5 --json --plot e.svg");
    assert_close(json_number(result.out, "mse"), 0.9 * train_mse + 0.1 * test_mse, 1e-12, 0);
    assert_close(json_number(result.out, "curves"), 40, 0, 0);
    assert_true(cli_exists("e.gp") && cli_exists("t.gp") && cli_exists("t.csv"));
}

TEST("without a preset's, published settings are taken where they are asked for") {
    run("train data.h5 --preset thesis --epochs 1 --out p.h5 --json");
    assert_close(json_number(result.out, "hidden"), 879, 0, 0);
    assert_close(json_number(result.out, "layers"), 4, 0, 0);
    assert_non_null(strstr(result.out, "\"source\": \"table 5.3\""));
    assert_non_null(strstr(result.out, "\"preset\": \"thesis\""));
    run("train data.h5 --preset thesis --epochs 1 --out p.h5 --json --hidden 5 --layers 2 --activation "
        "swish");
    assert_close(json_number(result.out, "hidden"), 5, 0, 0);
    assert_non_null(strstr(result.out, "\"activation\": \"swish\""));
    run("train both.h5 --preset thesis --epochs 1 --hidden 4 --out p.h5 --json");
    assert_non_null(strstr(result.out, "table 5.5"));
    assert_non_null(strstr(result.out, "leaky"));
    run("train both.h5 --epochs 1 --hidden 4 --out p.h5 --json");
    assert_non_null(strstr(result.out, "\"preset\": \"best\""));
}

static const char *const kinds[] = {"--network discrete --architecture resnet",
                                    "--network continuous --embedding 5 --architecture mult",
                                    "--network continuous --architecture mult-affine --mirror false",
                                    "--network angle --embedding 5 --architecture mult",
                                    "--network angle --boundary true --architecture mlp"};

TEST("every kind of network is trained, judged and asked") {
    char line[256];
    double q[22], v[22];
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        (void)snprintf(line, sizeof line,
                       "train data.h5 %s --hidden 5 --layers 1 --epochs 2 --out k.h5 --json", kinds[i]);
        run(line);
        const double mse = json_number(result.out, "test_mse");
        assert_true(mse > 0 && mse < 100);
        run("evaluate k.h5 data.h5 --part test --json");
        assert_close(json_number(result.out, "mse"), mse, 1e-12, 0);
        if (i >= 3) assert_true(json_number(result.out, "unit_tangent_error") < 1e-15);
        if (i == 0) assert_close(json_number(result.out, "boundary_error"), 0, 0, 1e-15);
        if (i == 4) assert_true(json_number(result.out, "boundary_error") < 1e-12);
        run("predict k.h5 --case both-ends --x 1 --json");
        assert_int_equal(json_array(result.out, "q", q, 22), 22);
        assert_int_equal(json_array(result.out, "v", v, 22), 22);
        /* The mirror image of x is 2 pi - x. */
        run("predict k.h5 --case both-ends --x 5.283185307179586 --json");
        double mirrored[22];
        (void)json_array(result.out, "q", mirrored, 22);
        bool same = true;
        for (size_t k = 0; k < 11; k++)
            same = same && lg_is_close(mirrored[2 * k], q[2 * k], 0, 1e-12) &&
                   lg_is_close(mirrored[2 * k + 1], -q[2 * k + 1], 0, 1e-12);
        assert_int_equal(same, i != 2);
    }
}

TEST("a prediction is told with its place, its reach and its error") {
    static const char *const keys[] = {"s",     "q",      "v",      "theta",   "distance",
                                       "reach", "inside", "energy", "seconds", "max_error"};
    char text[4096];
    double s[5];
    run("predict model.h5 --x 1 --points 5 --solve --out p.csv --plot p.svg --json");
    assert_true(json_is_object(result.out));
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        if (json_find(result.out, keys[i]) == NULL) fail_msg("no key '%s'", keys[i]);
    assert_int_equal(json_array(result.out, "s", s, 5), 5);
    assert_close(s[1], 3.3 / 4, 1e-15, 0);
    assert_int_equal(strncmp(json_find(result.out, "inside"), "true", 4), 0);
    assert_string_equal(result.err, "");
    cli_read("p.csv", text, sizeof text);
    assert_int_equal(strncmp(text, "s,x,y,vx,vy,theta\n0,0,0,0.54030230586813", 40), 0);
    run("predict model.h5 --x 1 --s 0,0.5,3.3 --json");
    assert_int_equal(json_array(result.out, "theta", s, 5), 3);
    assert_close(s[0], 1, 1e-14, 0);
    /* Angles instead of a case. */
    run("predict model.h5 --theta0 1 --thetaN -1 --json");
    assert_int_equal(strncmp(json_find(result.out, "inside"), "true", 4), 0);
    run("predict model.h5 --x 1 --solve");
    assert_non_null(strstr(result.out, "largest difference"));
}

TEST("a query that the network was not trained for is answered with a warning") {
    run("predict model.h5 --case right-end --x 2 --json");
    assert_non_null(strstr(result.err, "warning: outside the trained range"));
    assert_int_equal(strncmp(json_find(result.out, "inside"), "false", 5), 0);
    assert_true(json_number(result.out, "distance") > 2 * json_number(result.out, "reach"));
    run("predict model.h5 --x 1 --qN 1,0 --json");
    assert_non_null(strstr(result.err, "outside"));
    run("evaluate model.h5 right.h5 --json");
    assert_non_null(strstr(result.err, "of 40 curves lie outside the range"));
    assert_true(json_number(result.out, "outside") > 20);
    assert_true(json_number(result.out, "largest_distance") > 0.5);
    run("evaluate model.h5 data.h5 --json");
    assert_close(json_number(result.out, "outside"), 0, 0, 0);
    assert_string_equal(result.err, "");
    run("generate --count 8 --intervals 10 --continuous --out smooth.h5");
    run("evaluate model.h5 smooth.h5");
    assert_non_null(strstr(result.err, "trained on discrete values"));
}

/* ---- the same bits ---- */

static void load(const char *name, lg_surrogate_file *file) {
    char path[1024];
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_load_surrogate(NULL, path, NULL, file, NULL));
}

static void assert_same_parameters(const char *a, const char *b, bool same) {
    lg_surrogate_file first, second;
    load(a, &first);
    load(b, &second);
    assert_int_equal(first.parameters, second.parameters);
    const int difference = memcmp(first.theta, second.theta, first.parameters * sizeof(double));
    if ((difference == 0) != same)
        fail_msg("%s and %s: parameters are %s", a, b, same ? "different" : "the same");
    lg_surrogate_file_destroy(&first);
    lg_surrogate_file_destroy(&second);
}

TEST("the same seed gives the same bits, in one run or resumed") {
    run(TRAIN "--epochs 6 --threads 1 --seed 4 --shards 4 --out one.h5");
    run(TRAIN "--epochs 6 --threads 2 --seed 4 --shards 4 --out two.h5");
    run(TRAIN "--epochs 6 --threads 2 --seed 5 --shards 4 --out other.h5");
    cli_expect(lg,
               TRAIN "--epochs 6 --seed 4 --shards 4 --stop-after 2 --checkpoint c.h5 --out half.h5 --json",
               0, "\"epochs\": 2", &result);
    cli_expect(lg, "train data.h5 --resume c.h5 --out resumed.h5 --json", 0, "\"epochs\": 6", &result);
    assert_non_null(strstr(result.out, "\"preset\": null"));
    assert_same_parameters("one.h5", "two.h5", true);
    assert_same_parameters("one.h5", "resumed.h5", true);
    assert_same_parameters("one.h5", "other.h5", false);
    assert_same_parameters("one.h5", "half.h5", false);
    cli_expect(lg, "train data.h5 --resume c.h5 --out r.h5 --batch 10", 2, "batch", &result);
    cli_expect(lg, "train data.h5 --resume c.h5 --out r.h5 --hidden 13", 2, "hidden", &result);
    cli_expect(lg, "train data.h5 --resume c.h5 --out r.h5 --gamma 1", 2, "gamma", &result);
    cli_expect(lg, "train data.h5 --resume c.h5 --out r.h5 --train-fraction 0.5", 2, "fraction", &result);
    cli_expect(lg, "train right.h5 --resume c.h5 --out r.h5", 2, "c.h5", &result);
    assert_false(cli_exists("r.h5"));
}

TEST("Ctrl-C saves the state of a training") {
    cli_interrupt_training(lg, TRAIN "--history never.csv", &result);
    assert_true(cli_exists("never.csv"));
    cli_expect(lg, "train data.h5 --resume never.h5.checkpoint --stop-after 1 --out now.h5 --json", 0,
               "\"epochs\"", &result);
}

/* ---- search ---- */

TEST("a search runs, and goes on where it was stopped") {
    run(SEARCH "--out once.csv --plot s.svg --json");
    assert_true(json_is_object(result.out));
    assert_close(json_number(result.out, "trials"), 6, 0, 0);
    assert_close(json_number(result.out, "new"), 6, 0, 0);
    const char *best = json_find(result.out, "best");
    assert_non_null(best);
    const double objective = json_number(best, "objective");
    assert_true(objective > 0 && objective < 10);
    assert_non_null(json_find(json_find(best, "values"), "architecture"));
    assert_true(cli_exists("s.gp"));
    if (!cli_exists("s.svg")) assert_non_null(strstr(result.err, "gnuplot"));
    cli_expect_same_table(lg, &result);
    run(SEARCH "--out again.csv --resume --json");
    assert_close(json_number(result.out, "new"), 0, 0, 0);
    cli_expect(lg, SEARCH "--out again.csv --resume --seed 2", 2, "seed", &result);
    cli_expect(lg, SEARCH "--out again.csv --resume --quantile 0.3", 2, "settings", &result);
    cli_expect(lg, "search ranges.yaml right.h5 --trials 6 --warm-up 2 --out again.csv --resume", 2, "data",
               &result);
    cli_expect(lg, "search ranges.yaml one.h5 --trials 2 --out few.csv", 3, "one.h5", &result);
    run("search ranges.yaml data.h5 --trials 2 --out new.csv --resume --json");
    assert_close(json_number(result.out, "new"), 2, 0, 0);
}

TEST("a trial that fails is a row of the table, and the search goes on") {
    cli_write("wild.yaml", "fixed: {epochs: 9, batch: 8, hidden: 4, layers: 14, activation: identity, "
                           "schedule: constant}\nranges:\n  lr: {log-uniform: [5e2, 1e3]}\n");
    cli_expect(lg, "search wild.yaml data.h5 --trials 2 --out wild.csv --plot wild.svg --json", 4,
               "none of 2 trials was done; trial 0 failed first: ", &result);
    assert_true(cli_exists("wild.csv"));
    assert_close(json_number(result.out, "done"), 0, 0, 0);
    assert_close(json_number(result.out, "trials"), 2, 0, 0);
    assert_null(json_find(result.out, "best"));
    cli_expect(lg, "search wild.yaml data.h5 --trials 2 --out wild.csv --resume", 4,
               "none of the 2 trials in wild.csv was done", &result);
    /* No room for a network of 10^13 parameters. */
    cli_write("roomy.yaml", "fixed: {epochs: 1, batch: 8, layers: 14}\n"
                            "ranges:\n  hidden: {choice: [4, 1048576]}\n");
    run("search roomy.yaml data.h5 --trials 6 --out roomy.csv --json");
    assert_true(json_number(result.out, "done") > 0 && json_number(result.out, "failed") > 0);
    assert_non_null(strstr(result.err, "out of memory"));
    cli_expect(lg, "train data.h5 --out m.h5 --layers 14 --hidden 1048576", 5,
               "lg-elastica train: out of memory: the network has 1", &result);
}

TEST("the published searches run") {
    static const char *const names[] = {"elastica-discrete", "elastica-continuous", "elastica-angle"};
    cli_expect_published(lg, names, sizeof names / sizeof names[0], &result);
}

TEST("Ctrl-C keeps the table of a search") {
    static char once[16384], again[16384];
    const cli_child child =
        cli_start(lg, "search ranges.yaml data.h5 --trials 100000 --warm-up 2 --out long.csv", 0);
    cli_wait_for("long.csv");
    cli_interrupt(child, &result);
    assert_non_null(strstr(result.err, "continue with --resume"));
    cli_read_trials("long.csv", once, sizeof once);
    /* What was finished is kept, as a search of so many trials would have it. */
    int trials = -2;
    for (const char *s = once; *s != '\0'; s++) trials += *s == '\n';
    char line[128];
    (void)snprintf(line, sizeof line, "search ranges.yaml data.h5 --trials %d --warm-up 2 --out short.csv",
                   trials);
    run(line);
    cli_read_trials("short.csv", again, sizeof again);
    if (strlen(once) < sizeof once - 1) assert_string_equal(once, again);
}

/* ---- full disks ---- */

TEST("a full disk is told, and leaves no file") {
    cli_expect_limited(lg, "generate --count 100 --out full.h5", 4096, 3, "full.h5", &result);
    cli_expect_limited(lg, TRAIN "--epochs 1 --out full.h5", 2048, 3, "full.h5", &result);
    cli_expect_limited(lg, TRAIN "--epochs 9 --out full.h5 --stop-after 1", 2048, 3, "full.h5.checkpoint",
                       &result);
    cli_expect_limited(lg, "predict model.h5 --x 1 --points 500 --out full.csv", 2048, 3, "full.csv",
                       &result);
    cli_expect_limited(lg, "solve --x 1 --intervals 500 --out full.csv", 2048, 3, "full.csv", &result);
    cli_expect_limited(lg, SEARCH "--out full.csv", 200, 3, "full.csv", &result);
    /* First the data are too long, then the script, then the picture. */
    static const struct {
        const char *line, *words;
        rlim_t limit;
    } plots[] = {{"solve --x 1 --intervals 500 --plot full.svg", "full.dat", 2048},
                 {"solve --sweep 3 --intervals 4 --plot full.svg", "full.gp", 300},
                 {"solve --x 1 --intervals 20 --plot full.svg", "full.svg", 16384}};
    for (size_t i = 0; i < sizeof plots / sizeof plots[0]; i++) {
        cli_run_limited(lg, plots[i].line, plots[i].limit, &result);
        if (i < 2 || result.code != 0)
            cli_expect_limited(lg, plots[i].line, plots[i].limit, 3, plots[i].words, &result);
        else /* no gnuplot: nothing failed to be written */
            assert_non_null(strstr(result.err, "gnuplot"));
        if (result.code == 3)
            assert_false(cli_exists("full.dat") || cli_exists("full.gp") || cli_exists("full.svg"));
    }
    assert_false(cli_exists("full.h5"));
    assert_false(cli_exists("full.csv"));
    assert_int_equal(cli_count_files("tmp"), 0);
}

TEST_GROUP(setup, cli_end)

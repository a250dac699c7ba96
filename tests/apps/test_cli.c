/* lg-hamiltonian (in LG_BIN_DIR) from outside: bad input, files, resumption, Ctrl-C. */
#include "cli_support.h"

#include <hdf5.h>

#include "liegrad/io.h"

static const char lg[] = "lg-hamiltonian";
static cli result;

static const char scene[] = "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\n";
static const char start_scene[] =
    "system: pendulum-chain\nform: hamiltonian\ngravity: 1\nmasses: [1]\nlengths: [1]\n"
    "initial: { q: [[0.6, 0, 0.8]], p: [[0, 0.5, 0]] }\nt_end: 2\n";
static const char quartic[] = "system: quartic\n";
static const char grid[] =
    "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\nintegrators: [cf4, euler]\n"
    "N: [12]\nM: [3]\neps: [0]\nrepeats: 2\nt_end: 0.1\nepochs: 2\nbatch: 8\nhidden: [6]\n"
    "test: { trajectories: 4, points: 5 }\nseed: 3\n";

#define TRAIN "train train.h5 --hidden 12,12 --batch 16 "

/* Training data, one of its numbers NaN. */
static void write_nan_file(void) {
    double data[3 * 4 * 6];
    char path[1024];
    cli_expect(lg, "generate scene.yaml --trajectories 3 --points 4 --t-end 0.1 --out nan.h5", 0, "nan.h5",
               &result);
    cli_path("nan.h5", path, sizeof path);
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t set = H5Dopen2(file, "trajectories", H5P_DEFAULT);
    assert_true(H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    data[31] = NAN; /* trajectory 1, point 1, component 1 */
    assert_true(H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Fclose(file) >= 0);
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("scene.yaml", scene);
    cli_write("start.yaml", start_scene);
    cli_write("quartic.yaml", quartic);
    cli_write("grid.yaml", grid);
    cli_expect(lg,
               "generate scene.yaml --trajectories 40 --points 4 --t-end 0.1 --out train.h5 --seed 5 --json",
               0, "\"trajectories\": 40", &result);
    assert_true(json_is_object(result.out));
    cli_expect(lg, "generate scene.yaml --trajectories 6 --points 8 --t-end 1 --out test.h5 --seed 6", 0,
               "test.h5", &result);
    cli_expect(lg, TRAIN "--epochs 3 --out model.h5 --json", 0, "\"epochs\": 3", &result);
    write_nan_file();
    cli_link("test.h5", "link.dat");
    cli_link("model.h5", "twin.h5");
    return 0;
}

/* ---- bad input: exit code and words of the sentence ---- */

static const cli_bad bad_input[] = {
    {"", 2, "which command"},
    {"--json", 2, "which command"},
    {"learn", 2, "'learn' is no command"},
    {"train", 2, "missing argument"},
    {"train train.h5", 2, "--out FILE is missing"},
    {"train train.h5 test.h5 --out m.h5", 2, "'test.h5' is one argument too many"},
    {"train train.h5 --out m.h5 --bogus", 2, "--bogus"},
    {"train train.h5 --out m.h5 --epochs", 2, "--epochs"},
    {"train train.h5 --out m.h5 --epochs 0", 2, "--epochs: '0'"},
    {"train train.h5 --out m.h5 --lr 0", 2, "--lr: '0'"},
    {"train train.h5 --out m.h5 --hidden 10,,3", 2, "--hidden: '10,,3'"},
    {"train train.h5 --out m.h5 --hidden 1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1", 2,
     "--hidden: a list of 20 numbers is too long: at most 15"},
    {"train train.h5 --out m.h5 --integrator leapfrog", 2, "--integrator: 'leapfrog' is not one of euler"},
    {"train train.h5 --out m.h5 --integrator stormer-verlet", 2, "stormer-verlet needs a separable"},
    {"train train.h5 --out m.h5 --integrator variational", 2, "variational cannot be differentiated"},
    {"train train.h5 --out m.h5 --integrator slgi", 2, "slgi is for SE(3)"},
    {"train train.h5 --out m.h5 --integrator rk4-projected", 2, "rk4-projected: training does not project"},
    {"train train.h5 --out m.h5 --threads 0", 2, "--threads: '0'"},
    {"--threads -2 train train.h5 --out m.h5", 2, "--threads: '-2'"},
    {"train train.h5 --out m.h5 --seed -1", 2, "--seed: '-1'"},
    {"train train.h5 --out m.h5 --plot loss.pdf", 2, "loss.pdf"},
    {"train train.h5 --out m.h5 --penalty 1e-3", 2, "penalty"},
    {"train train.h5 --out m.h5 --newton", 2, "--newton"},
    {"train missing.h5 --out m.h5", 3, "missing.h5"},
    {"train empty.h5 --out m.h5", 3, "empty.h5"},
    {"train foreign.h5 --out m.h5", 3, "foreign.h5"},
    {"train nan.h5 --out m.h5", 3, "nan.h5: /trajectories: NaN at index (1, 1, 1)"},
    {"evaluate model.h5 nan.h5", 3, "NaN"},
    {"train model.h5 --out m.h5", 3, "model.h5"},
    {"train . --out m.h5", 3, "."},
    {"train train.h5 --out nowhere/m.h5", 3, "nowhere/m.h5"},
    {"train train.h5 --out .", 3, "folder"},
    {"train train.h5 --out m.h5 --history nowhere/h.csv", 3, "nowhere/h.csv"},
    {"train train.h5 --out m.h5 --checkpoint nowhere/c.h5", 3, "nowhere/c.h5"},
    {"train train.h5 --out m.h5 --resume missing.h5", 3, "missing.h5"},
    {"train train.h5 --out m.h5 --resume foreign.h5", 3, "foreign.h5"},
    {"train train.h5 --out m.h5 --resume model.h5", 3, "model.h5"},
    {"train train.h5 --out m.h5 --hidden 30,30,30,30,30,30,30,30 --activation identity --dtype f32 --lr 1e3",
     4, "epoch 2, batch 1: the loss"},
    {"train train.h5 --out train.h5", 2, "--out: train.h5 is an input and would be replaced"},
    {"train train.h5 --out m.h5 --history ./train.h5", 2, "--history: ./train.h5 is an input"},
    {"train train.h5 --out m.h5 --history m.h5", 2, "--history: m.h5 is what --out writes too"},
    {"train train.h5 --out m.h5 --checkpoint m.h5", 2, "--checkpoint: m.h5 is what --out writes too"},
    {"train train.h5 --out model.h5 --resume model.h5", 2, "--out: model.h5 is an input of --resume"},
    {"generate scene.yaml --out scene.yaml", 2, "--out: scene.yaml is an input"},
    {"predict model.h5 start.yaml --out model.h5", 2, "--out: model.h5 is an input"},
    {"predict model.h5 start.yaml --out m.gp --plot m.svg", 2, "--plot: m.gp is what --out writes too"},
    {"evaluate model.h5 link.dat --plot link.svg", 2, "--plot: link.dat is an input"},
    {"study grid.yaml --out grid.yaml", 2, "--out: grid.yaml is an input"},
    {"study grid.yaml --out s.csv --plot s.svg --plot-noise s.png", 2, "--plot-noise: s.dat is what --plot"},
    {"generate", 2, "missing argument"},
    {"generate scene.yaml", 2, "--out FILE is missing"},
    {"generate scene.yaml --out d.h5 --trajectories -5", 2, "--trajectories: '-5'"},
    {"generate scene.yaml --out d.h5 --points 1", 2, "--points: '1'"},
    {"generate scene.yaml --out d.h5 --t-end -1", 2, "--t-end: '-1'"},
    {"generate scene.yaml --out d.h5 --noise -0.1", 2, "--noise: '-0.1'"},
    {"generate scene.yaml --out d.h5 --noise-kind pink", 2, "--noise-kind: 'pink'"},
    {"generate missing.yaml --out d.h5", 3, "missing.yaml"},
    {"generate train.h5 --out d.h5", 3, "train.h5"},
    {"generate scene.yaml --out nowhere/d.h5", 3, "nowhere/d.h5"},
    {"evaluate model.h5", 2, "missing argument"},
    {"evaluate missing.h5 test.h5", 3, "missing.h5"},
    {"evaluate model.h5 missing.h5", 3, "missing.h5"},
    {"evaluate test.h5 model.h5", 3, "test.h5"},
    {"evaluate model.h5 test.h5 --tolerance 0", 2, "--tolerance: '0'"},
    {"evaluate model.h5 ./model.h5 --record", 2, "--record: model.h5 is the model and the test data too"},
    {"evaluate model.h5 twin.h5 --record", 2, "--record: model.h5 is the model and the test data too"},
    {"evaluate nowhere/model.h5 test.h5 --record", 3, "nowhere/model.h5: cannot be written"},
    {"evaluate missing.h5 test.h5 --record", 3, "missing.h5"},
    {"evaluate train.h5 test.h5 --record", 3, "train.h5"},
    {"predict model.h5", 2, "--initial"},
    {"predict model.h5 start.yaml --initial 1,2", 2, "not both"},
    {"predict model.h5 --initial 1,2,3", 2, "3 numbers"},
    {"predict model.h5 --initial 1,0,0,0,nan,0", 2, "--initial: '1,0,0,0,nan,0'"},
    {"predict model.h5 --initial 1,0,0,1,0,0", 2, "manifold"},
    {"predict model.h5 quartic.yaml", 3, "quartic.yaml"},
    {"predict model.h5 start.yaml --out nowhere/p.h5", 3, "nowhere/p.h5"},
    {"study grid.yaml", 2, "--out FILE.csv is missing"},
    {"study missing.yaml --out s.csv", 3, "missing.yaml"},
    {"study scene.yaml --out s.csv", 3, "scene.yaml"},
    {"study grid.yaml --out nowhere/s.csv", 3, "nowhere/s.csv"},
    {"study grid.yaml --out scene.yaml", 3, "not the table of a study"},
    {"study grid.yaml --out s.csv --plot s.jpg", 2, "s.jpg"},
    {"study grid.yaml --out s.csv --plot-noise nowhere/s.svg", 3, "nowhere/s.svg"},
    {"study grid.yaml --out s.csv --jobs 0", 2, "--jobs: '0'"},
    {"demo --out scene.yaml", 3, "scene.yaml"},
};

TEST("a refused command line tells its exit code and word, and writes nothing") {
    cli_expect_refused(lg, bad_input, sizeof bad_input / sizeof bad_input[0], &result);
    assert_false(cli_exists("m.h5"));
    assert_false(cli_exists("d.h5"));
}

static const char *const bad_scenes[][2] = {
    {"system: pendulum\n", "pendulum"},
    {"gravity: 1\n", "system"},
    {"system: pendulum-chain\nmasses: [1]\nlengths: [1]\nmasses: [2]\ngravity: 1\n", "line 4"},
    {"system: pendulum-chain\ngravity: 1\nmasses: [1, 2]\nlengths: [1]\n", "lengths"},
    {"system: pendulum-chain\nmasses: [1]\nlengths: [1]\ngravity: 9.81m\n", "line 4"},
    {"system: pendulum-chain\nmasses: [1]\nlengths: [1]\ngravity: .nan\n", "line 4"},
    {"system: pendulum-chain\nmasses: [-1]\nlengths: [1]\ngravity: 1\n", "line 2"},
    {"system: pendulum-chain\nmasses: [1]\nlengths: [1]\ngravity: 1\ncolour: red\n", "colour"},
    {"system: [pendulum-chain\n", "bad.yaml"},
};

TEST("a bad scene is refused with its name") {
    for (size_t i = 0; i < sizeof bad_scenes / sizeof bad_scenes[0]; i++) {
        cli_write("bad.yaml", bad_scenes[i][0]);
        cli_expect(lg, "generate bad.yaml --out d.h5", 3, bad_scenes[i][1], &result);
        if (strstr(result.err, "bad.yaml") == NULL) fail_msg("no file in: %s", result.err);
    }
}

/* ---- help, versions, JSON ---- */

TEST("every command has help and a version") {
    static const char *const commands[] = {"generate", "train", "evaluate", "predict", "study", "demo"};
    char arguments[64];
    cli_expect(lg, "--version", 0, "lg-hamiltonian (liegrad) ", &result);
    cli_expect(lg, "--help", 0, "Commands:", &result);
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        (void)snprintf(arguments, sizeof arguments, "%s --help", commands[i]);
        cli_expect(lg, arguments, 0, "Usage: lg-hamiltonian", &result);
        assert_non_null(strstr(result.out, "--threads"));
        (void)snprintf(arguments, sizeof arguments, "%s --version", commands[i]);
        cli_expect(lg, arguments, 0, "(liegrad)", &result);
    }
}

TEST("the checker of JSON refuses what is no JSON") {
    assert_true(json_is_object("{\"a\": [1, -2.5e-3, null, true], \"b\": {\"c\": \"x\\u00e9\\n\"}}\n"));
    assert_false(json_is_object("{\"a\": nan}"));
    assert_false(json_is_object("{\"a\": 01}"));
    assert_false(json_is_object("{\"a\": 1,}"));
    assert_false(json_is_object("{\"a\": 1} {}"));
    assert_close(json_number("{\"ab\": {\"b\": 1}, \"b\": 2}", "b"), 2, 0, 0);
}

TEST("a model is evaluated, and predicts") {
    cli_expect(lg, "evaluate model.h5 test.h5 --json", 0, "\"E1\"", &result);
    assert_true(json_is_object(result.out));
    const double e1 = json_number(result.out, "E1"), e2 = json_number(result.out, "E2");
    assert_true(e1 > 0 && e1 < 1 && e2 > 0 && e2 < 10);
    assert_close(json_number(result.out, "trajectories"), 6, 0, 0);
    assert_close(json_number(result.out, "points"), 8, 0, 0);
    cli_expect(lg, "--json --threads 1 evaluate model.h5 test.h5", 0, "\"E1\"", &result);
    assert_close(json_number(result.out, "E1"), e1, 0, 0);
    cli_expect(lg, "evaluate model.h5 test.h5 --tolerance 1e-12 --json", 0, "\"E1\"", &result);
    assert_close(json_number(result.out, "E1"), e1, 1e-6, 1e-18);
    cli_expect(lg, "predict model.h5 start.yaml --points 21 --out path.h5 --json", 0, "\"y\"", &result);
    assert_true(json_is_object(result.out));
    assert_close(json_number(result.out, "t"), 2, 0, 0);
    assert_true(json_number(result.out, "max_error") > 0);
    assert_true(json_number(result.out, "energy_drift") < 1e-7);
    cli_expect(lg, "evaluate model.h5 path.h5 --json", 0, "\"E1\"", &result);
    assert_true(json_number(result.out, "E1") < 1e-16);
    assert_true(json_number(result.out, "E2") < 1e-12);
    cli_expect(lg, "predict model.h5 --initial 1,0,0,0,0.5,0 --t-end 0.5", 0, "y = ", &result);
}

TEST("all commands take scenes with and without a start, and say what they make of them") {
    cli_expect(lg, "predict model.h5 scene.yaml --seed 4 --t-end 0.1", 0, "y = ", &result);
    assert_non_null(strstr(result.err, "scene.yaml: there is no `initial`: the start is drawn with seed 4"));
    cli_expect("lg-simulate", "scene.yaml --seed 4 --t-end 0.1", 0, "", &result);
    assert_non_null(strstr(result.err, "the start is drawn with seed 4"));
    cli_expect(lg, "generate start.yaml --trajectories 4 --points 2 --out drawn.h5", 0, "drawn.h5", &result);
    assert_non_null(strstr(result.err, "`initial` is one start and was not used"));
}

TEST("pictures and histories are drawn") {
    static char script[65536];
    cli_expect(lg, "evaluate model.h5 test.h5 --plot ./sphere.svg", 0, "E1", &result);
    assert_true(cli_exists("sphere.dat") && cli_exists("sphere.gp"));
    cli_read("sphere.gp", script, sizeof script);
    assert_non_null(strstr(script, "datafile = 'sphere.dat'\n")); /* no folder */
    assert_non_null(strstr(script, "gravity"));
    if (!cli_exists("sphere.svg")) assert_non_null(strstr(result.err, "gnuplot"));
    cli_expect(lg, TRAIN "--epochs 2 --out plotted.h5 --plot loss.svg --history loss.csv", 0, "plotted.h5",
               &result);
    char text[4096];
    cli_read("loss.csv", text, sizeof text);
    assert_int_equal(strncmp(text, "epoch,loss,validation,rate,seconds\n1,", 37), 0);
}

/* Linear potential: Newton reaches the floor of the loss, below what Adam alone leaves. */
TEST("Newton reaches the floor of a linear potential's loss, below what Adam alone leaves") {
    cli_expect(lg, "train train.h5 --potential linear --epochs 3 --out l.h5 --json", 0, "\"loss\"", &result);
    const double adam = json_number(result.out, "loss");
    cli_expect(lg, "train train.h5 --potential linear --epochs 3 --newton --out l.h5 --json", 0,
               "newton_iterations", &result);
    const double newton = json_number(result.out, "loss");
    if (!(newton < 1e-14 && newton < 1e-6 * adam)) fail_msg("loss %g by Adam, %g by Newton", adam, newton);
}

TEST("separable systems are trained and judged") {
    cli_expect(lg, "generate quartic.yaml --trajectories 20 --points 4 --t-end 0.3 --out q.h5", 0, "quartic",
               &result);
    cli_expect(lg, "train q.h5 --hidden 8 --epochs 2 --batch 10 --out qm.h5 --json", 0, "\"stormer-verlet\"",
               &result);
    cli_expect(lg, "evaluate qm.h5 q.h5 --json", 0, "\"E1\"", &result);
    assert_true(json_number(result.out, "E1") > 0);
    cli_expect(lg, "evaluate model.h5 q.h5", 3, "q.h5", &result);
}

/* ---- the same bits ---- */

static void load(const char *name, lg_hamiltonian_file *file) {
    char path[1024];
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_load_hamiltonian(NULL, path, NULL, file, NULL));
}

static void assert_same_parameters(const char *a, const char *b, bool same) {
    lg_hamiltonian_file first, second;
    load(a, &first);
    load(b, &second);
    assert_int_equal(first.parameters, second.parameters);
    const int difference = memcmp(first.theta, second.theta, first.parameters * sizeof(double));
    if ((difference == 0) != same)
        fail_msg("%s and %s: parameters are %s", a, b, same ? "different" : "the same");
    lg_hamiltonian_file_destroy(&first);
    lg_hamiltonian_file_destroy(&second);
}

TEST("the same seed gives the same bits, in one run or resumed") {
    cli_expect(lg, TRAIN "--epochs 6 --threads 1 --seed 4 --out one.h5", 0, "one.h5", &result);
    cli_expect(lg, TRAIN "--epochs 6 --threads 2 --seed 4 --out two.h5", 0, "two.h5", &result);
    cli_expect(lg, TRAIN "--epochs 6 --threads 2 --seed 5 --out other.h5", 0, "other.h5", &result);
    cli_expect(lg, TRAIN "--epochs 6 --seed 4 --stop-after 2 --checkpoint c.h5 --out half.h5 --json", 0,
               "\"epochs\": 2", &result);
    cli_expect(lg, "train train.h5 --resume c.h5 --out resumed.h5 --json", 0, "\"epochs\": 6", &result);
    assert_same_parameters("one.h5", "two.h5", true);
    assert_same_parameters("one.h5", "resumed.h5", true);
    assert_same_parameters("one.h5", "other.h5", false);
    assert_same_parameters("one.h5", "half.h5", false);
    cli_expect(lg, "train train.h5 --resume c.h5 --out r.h5 --batch 10", 2, "batch", &result);
    cli_expect(lg, "train test.h5 --resume c.h5 --out r.h5", 2, "c.h5", &result);
}

/* ---- errors on record ---- */

static void assert_same_file(const char *a, const char *b) {
    static char one[262144], two[262144];
    const size_t n = cli_read(a, one, sizeof one);
    assert_true(n < sizeof one - 1);
    assert_int_equal(cli_read(b, two, sizeof two), n);
    assert_memory_equal(one, two, n);
}

static void copy(const char *from, const char *to) {
    char source[1024], target[1024];
    lg_error error = {LG_OK, ""};
    static char data[262144];
    cli_path(from, source, sizeof source);
    cli_path(to, target, sizeof target);
    const size_t n = cli_read(from, data, sizeof data);
    if (lg_file_write(NULL, target, data, n, &error) != LG_OK) fail_msg("%s", error.message);
}

/* Everything in the file but errors and test set. */
static void assert_same_training(const lg_hamiltonian_file *a, const lg_hamiltonian_file *b) {
    const size_t bytes = a->parameters * sizeof(double);
    assert_ok(lg_run_compare(&lg_run_hamiltonian, &a->run, &b->run, "model", NULL));
    assert_memory_equal(a->theta, b->theta, bytes);
    assert_memory_equal(a->adam_m, b->adam_m, bytes);
    assert_memory_equal(a->adam_v, b->adam_v, bytes);
    assert_true(a->adam_step == b->adam_step && a->has_rng && b->has_rng);
    assert_memory_equal(&a->rng, &b->rng, sizeof a->rng);
    assert_true(a->epochs_done == 2 && b->epochs_done == 2);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++)
        assert_memory_equal(a->history[i], b->history[i], 2 * sizeof(double));
    assert_string_equal(a->provenance.command, b->provenance.command);
    assert_string_equal(a->provenance.cpu, b->provenance.cpu);
    assert_string_equal(a->provenance.liegrad_version, b->provenance.liegrad_version);
    assert_true(a->provenance.has_seed && a->provenance.seed == b->provenance.seed);
}

static void assert_recorded(const lg_hamiltonian_file *file, double e1, double e2) {
    lg_trajectories test;
    char path[1024];
    cli_path("test.h5", path, sizeof path);
    assert_ok(lg_trajectories_read(NULL, path, NULL, &test, NULL));
    assert_true(file->has_e1 && file->has_e2);
    assert_close(file->e1, e1, 0, 0);
    assert_close(file->e2, e2, 0, 0);
    assert_true(file->test.trajectories == 6 && file->test.points == 8);
    assert_close(file->test.t_end, 1, 1e-15, 0);
    assert_string_equal(file->test.sha256, test.sha256);
    lg_trajectories_destroy(&test);
}

TEST("errors are recorded in the model's file") {
    lg_hamiltonian_file before, after;
    cli_expect(lg, TRAIN "--epochs 6 --seed 4 --stop-after 2 --checkpoint rc.h5 --out rec.h5", 0, "rec.h5",
               &result);
    load("rec.h5", &before);
    assert_false(before.has_e1 || before.has_e2 || before.test.trajectories > 0);
    copy("rec.h5", "rec.before");
    cli_expect(lg, "evaluate rec.h5 test.h5 --json", 0, "\"recorded\": false", &result);
    assert_same_file("rec.h5", "rec.before");
    cli_expect_limited(lg, "evaluate rec.h5 test.h5 --record", 2048, 3, "rec.h5", &result);
    assert_non_null(strstr(result.out, "E1 = "));
    assert_null(strstr(result.out, "Recorded"));
    assert_same_file("rec.h5", "rec.before");
    cli_expect(lg, "evaluate rec.h5 test.h5 --record --json", 0, "\"recorded\": true", &result);
    const double e1 = json_number(result.out, "E1"), e2 = json_number(result.out, "E2");
    load("rec.h5", &after);
    assert_recorded(&after, e1, e2);
    assert_same_training(&before, &after);
    lg_hamiltonian_file_destroy(&before);
    lg_hamiltonian_file_destroy(&after);
    /* A checkpoint is no model; the one beside the model goes on to the same bits. */
    copy("rc.h5", "rc.before");
    cli_expect(lg, "evaluate rc.h5 test.h5 --record", 3, "rc.h5", &result);
    assert_same_file("rc.h5", "rc.before");
    cli_expect(lg, "train train.h5 --resume rc.h5 --out rec.h5 --json", 0, "\"epochs\": 6", &result);
    cli_expect(lg, TRAIN "--epochs 6 --seed 4 --out whole.h5", 0, "whole.h5", &result);
    assert_same_parameters("rec.h5", "whole.h5", true);
    load("rec.h5", &after);
    assert_false(after.has_e1 || after.has_e2 || after.test.sha256[0] != '\0');
    lg_hamiltonian_file_destroy(&after);
}

/* Test data without energies take the E2 of others away; the training data are no test set, which is said. A
 * link to the model stays a link. */
TEST("recorded errors replace the first ones, and a link to the model stays a link") {
    char path[1024];
    lg_hamiltonian_file file;
    cli_expect(lg, "evaluate twin.h5 train.h5 --record", 0, "Recorded in twin.h5", &result);
    assert_non_null(strstr(result.err, "train.h5 holds the data that twin.h5 was trained on"));
    load("model.h5", &file);
    assert_true(file.has_e2 && file.test.trajectories == 40);
    assert_string_equal(file.test.sha256, file.run.data_sha256);
    lg_hamiltonian_file_destroy(&file);
    copy("test.h5", "plain.h5");
    cli_path("plain.h5", path, sizeof path);
    const hid_t plain = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(H5Ldelete(plain, "hamiltonian", H5P_DEFAULT) >= 0 && H5Fclose(plain) >= 0);
    cli_expect(lg, "evaluate model.h5 plain.h5 --record", 0, "E2 unknown", &result);
    assert_int_equal(result.err[0], '\0');
    load("model.h5", &file);
    assert_true(file.has_e1 && !file.has_e2 && file.test.trajectories == 6);
    lg_hamiltonian_file_destroy(&file);
}

TEST("a folder that cannot be written is told before the evaluation; root may write everywhere") {
    char folder[1024], path[1024];
    cli_path("shut", folder, sizeof folder);
    assert_int_equal(mkdir(folder, 0777), 0);
    copy("model.h5", "shut/model.h5");
    cli_link("shut/model.h5", "shut.h5");
    assert_int_equal(chmod(folder, 0555), 0);
    if (access(folder, W_OK) != 0) {
        cli_expect(lg, "evaluate shut.h5 test.h5 --record", 3, "cannot be written", &result);
        assert_int_equal(result.out[0], '\0');
    }
    assert_int_equal(chmod(folder, 0777), 0);
    cli_path("shut/model.h5", path, sizeof path);
    assert_int_equal(unlink(path), 0);
}

/* What demo judges, it records. */
TEST("what the demonstration judges, it records") {
    lg_hamiltonian_file file;
    lg_trajectories test;
    char path[1024];
    cli_expect(lg, "demo --epochs 1 --t-end 1 --out demo --json", 0, "\"E1\"", &result);
    load("demo/model.h5", &file);
    assert_true(file.has_e1 && file.has_e2 && file.test.trajectories == 100 && file.test.points == 15);
    assert_close(file.e1, json_number(result.out, "E1"), 0, 0);
    assert_close(file.e2, json_number(result.out, "E2"), 0, 0);
    cli_path("demo/test.h5", path, sizeof path);
    assert_ok(lg_trajectories_read(NULL, path, NULL, &test, NULL));
    assert_string_equal(file.test.sha256, test.sha256);
    lg_trajectories_destroy(&test);
    lg_hamiltonian_file_destroy(&file);
    cli_path("demo", path, sizeof path);
    DIR *folder = opendir(path);
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;)
        if (entry->d_name[0] != '.') assert_int_equal(unlinkat(dirfd(folder), entry->d_name, 0), 0);
    assert_int_equal(closedir(folder), 0);
}

TEST("Ctrl-C saves the state") {
    cli_interrupt_training(lg, TRAIN "--history never.csv", &result);
    assert_true(cli_exists("never.csv"));
    cli_expect(lg, "train train.h5 --resume never.h5.checkpoint --stop-after 1 --out now.h5 --json", 0,
               "\"epochs\"", &result);
    assert_true(json_number(result.out, "epochs") >= 1);
}

/* ---- full disks ---- */

TEST("a full disk is told, and leaves no file") {
    cli_expect_limited(lg, "generate scene.yaml --out full.h5 --trajectories 300", 4096, 3, "full.h5",
                       &result);
    cli_expect_limited(lg, TRAIN "--epochs 1 --out full.h5", 2048, 3, "full.h5", &result);
    cli_expect_limited(lg, TRAIN "--epochs 9 --out full.h5 --stop-after 1", 2048, 3, "full.h5.checkpoint",
                       &result);
    cli_expect_limited(lg, "predict model.h5 start.yaml --points 500 --out full.h5", 2048, 3, "full.h5",
                       &result);
    cli_expect_limited(lg, TRAIN "--epochs 60 --out model-full.h5 --history full.csv", 512, 3, "full.csv",
                       &result);
    /* The data of the picture fit, the picture does not. */
    cli_expect_limited(lg, "evaluate model.h5 test.h5 --plot full.svg", 8192, 3, "full.svg", &result);
    assert_false(cli_exists("full.dat") || cli_exists("full.gp") || cli_exists("full.svg"));
    assert_false(cli_exists("full.h5"));
    assert_false(cli_exists("full.csv"));
    assert_int_equal(cli_count_files("tmp"), 0);
}

/* ---- study ---- */

static int lines(const char *text) {
    int n = 0;
    for (; *text != '\0'; text++) n += *text == '\n';
    return n;
}

TEST("a study runs, and goes on where it was stopped") {
    char once[8192], again[8192], path[1024];
    cli_expect(lg,
               "study grid.yaml --out once.csv --jobs 2 --threads 2 --plot w.svg --plot-noise n.svg "
               "--plot-parallel p.png",
               0, "Geometric means", &result);
    assert_true(cli_exists("w.gp") && cli_exists("n.gp") && cli_exists("p.gp"));
    if (!cli_exists("p.png")) assert_non_null(strstr(result.err, "gnuplot"));
    cli_expect(lg, "study grid.yaml --out again.csv --stop-after 1 --json", 0, "\"done\": 1", &result);
    assert_true(json_is_object(result.out));
    cli_path("again.csv", path, sizeof path);
    FILE *file = fopen(path, "a");
    assert_non_null(file);
    (void)fputs("cf4,1,12,3,0,0,1,12", file);
    assert_int_equal(fclose(file), 0);
    cli_expect(lg, "study grid.yaml --out again.csv --jobs 1 --json", 0, "\"done\": 4", &result);
    assert_close(json_number(result.out, "new"), 3, 0, 0);
    cli_expect(lg, "study grid.yaml --out again.csv --json", 0, "\"new\": 0", &result);
    cli_read("once.csv", once, sizeof once);
    cli_read("again.csv", again, sizeof again);
    assert_int_equal(lines(once), 5);
    assert_int_equal(lines(again), 5);
    cli_expect(lg, "study grid.yaml --out again.csv --seed 8", 3, "other settings", &result);
    cli_expect_limited(lg, "study grid.yaml --out limited.csv --jobs 1", 200, 3, "limited.csv", &result);
    cli_read("limited.csv", once, sizeof once);
    assert_int_equal(once[strlen(once) - 1], '\n');
    cli_expect(lg, "study grid.yaml --out limited.csv --json", 0, "\"done\": 4", &result);
}

TEST_GROUP(setup, cli_end)

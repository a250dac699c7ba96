/* Runs lg-hamiltonian (in LG_BIN_DIR): judging and recording, plots, studies. Elsewhere: what it shares
 * with other executables is in test_runs, what it refuses in test_refused.
 * ctest-labels: apps/lg-hamiltonian src/hamiltonian */
#include "cli_files.h"

#include <hdf5.h>

static const char lg[] = "lg-hamiltonian";

static const char scene[] = "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\n";
static const char start_scene[] =
    "system: pendulum-chain\nform: hamiltonian\ngravity: 1\nmasses: [1]\nlengths: [1]\n"
    "initial: { q: [[0.6, 0, 0.8]], p: [[0, 0.5, 0]] }\nt_end: 2\n";
static const char quartic[] = "system: quartic\n";
static const char grid[] =
    "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\nintegrators: [cf4, euler]\n"
    "N: [6, 12]\nM: [3]\neps: [0]\nrepeats: 2\nt_end: 0.1\nepochs: 2\nbatch: 8\nhidden: [6]\n"
    "test: { trajectories: 4, points: 5 }\nseed: 3\n";

#define TRAIN "train train.h5 --hidden 12,12 --batch 16 "

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("scene.yaml", scene);
    cli_write("start.yaml", start_scene);
    cli_write("quartic.yaml", quartic);
    cli_write("grid.yaml", grid);
    cli_json(lg, "generate scene.yaml --trajectories 40 --points 4 --t-end 0.1 --out train.h5 --seed 5",
             "trajectories 40");
    cli_expect(lg, "generate scene.yaml --trajectories 6 --points 8 --t-end 1 --out test.h5 --seed 6", 0,
               "test.h5");
    cli_json(lg, TRAIN "--epochs 3 --out model.h5", "epochs 3, floor >0, warnings []");
    cli_link("model.h5", "twin.h5");
    return 0;
}

TEST("the tests' JSON checker refuses text that is not JSON") {
    assert_true(json_is_object("{\"a\": [1, -2.5e-3, null, true], \"b\": {\"c\": \"x\\u00e9\\n\"}}\n"));
    assert_false(json_is_object("{\"a\": nan}"));
    assert_false(json_is_object("{\"a\": 01}"));
    assert_false(json_is_object("{\"a\": 1,}"));
    assert_false(json_is_object("{\"a\": 1} {}"));
    assert_close(json_number("{\"ab\": {\"b\": 1}, \"b\": 2}", "b"), 2, 0, 0);
}

TEST("a model is evaluated and predicts") {
    cli_json(lg, "evaluate model.h5 test.h5", "E1 >0, E1 <1, E2 >0, E2 <10, trajectories 6, points 8");
    const double e1 = json_number(result.out, "E1");
    cli_json(lg, "--threads 1 evaluate model.h5 test.h5", "");
    assert_close(json_number(result.out, "E1"), e1, 0, 0);
    cli_json(lg, "evaluate model.h5 test.h5 --tolerance 1e-12", "");
    assert_close(json_number(result.out, "E1"), e1, 1e-6, 1e-18);
    cli_json(lg, "predict model.h5 start.yaml --points 21 --out path.h5",
             "t 2, max_error >0, energy_drift <1e-7, y *");
    cli_json(lg, "evaluate model.h5 path.h5", "E1 <1e-16, E2 <1e-12");
    cli_expect(lg, "predict model.h5 --initial 1,0,0,0,0.5,0 --t-end 0.5", 0, "\ny  ");
}

TEST("all commands take scenes with and without `initial`, and say which start they use") {
    cli_expect(lg, "predict model.h5 scene.yaml --seed 4 --t-end 0.1", 0, "\ny  ");
    assert_non_null(
        strstr(result.err, "scene.yaml: the key `initial` is missing: the start is drawn with seed 4"));
    cli_expect("lg-simulate", "scene.yaml --seed 4 --t-end 0.1", 0, "");
    assert_non_null(strstr(result.err, "the start is drawn with seed 4"));
    cli_expect(lg, "generate start.yaml --trajectories 4 --points 2 --out drawn.h5", 0, "drawn.h5");
    assert_non_null(strstr(result.err, "`initial` is a single start and was not used"));
}

static void expect_drawn(const char *arguments, const char *path) {
    cli_expect(lg, test_text("%s --plot %s", arguments, path), 0, "");
    if (!cli_exists(path) && strstr(result.err, "gnuplot is not installed") == NULL)
        fail_msg("%s: no plot: %s", arguments, result.err);
}

/* `curves`: in all panels, without the spheres. */
static void expect_curves(const char *arguments, size_t curves) {
    static char path[1 << 20];
    size_t found = 0;
    expect_drawn(arguments, "flow.svg");
    if (!cli_exists("flow.svg")) return;
    (void)cli_read("flow.svg", path, sizeof path);
    for (const char *at = path; (at = strstr(at, "id=\"gnuplot_plot_")) != NULL; at++) found++;
    if (strstr(path, "gravity") != NULL) found--;
    if (found != curves) fail_msg("%s: %zu curves, expected %zu", arguments, found, curves);
    assert_int_equal(unlink(cli_at("flow.svg")), 0);
}

TEST("plots of trajectories show all curves: spheres, phase portraits, planes, with and without the "
     "truth") {
    expect_curves("predict model.h5 start.yaml", 2);
    expect_curves("predict model.h5 --initial 1,0,0,0,0.5,0 --t-end 0.5", 1);
    expect_curves("evaluate model.h5 test.h5", 2 * 6);
    static const struct {
        const char *scene, *initial;
        size_t panels;
    } rows[] = {{"system: oscillator\n", "0.5,0.5", 3}, {"system: quartic\n", "0.5,0.5,0.2,0.1", 1}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_write("flat.yaml", rows[i].scene);
        cli_expect(lg, "generate flat.yaml --trajectories 9 --points 4 --t-end 0.1 --out flat.h5", 0, "");
        cli_expect(lg, "train flat.h5 --hidden 4 --epochs 1 --out flat-model.h5", 0, "");
        expect_curves("evaluate flat-model.h5 flat.h5", rows[i].panels * 2 * 9);
        expect_curves(test_text("predict flat-model.h5 --initial %s --t-end 0.5", rows[i].initial),
                      rows[i].panels);
    }
}

TEST("plots and histories are drawn") {
    static char script[65536];
    expect_drawn("evaluate model.h5 test.h5", "./sphere.svg");
    assert_true(cli_exists("sphere.dat") && cli_exists("sphere.gp"));
    cli_read("sphere.gp", script, sizeof script);
    assert_null(strstr(script, "sphere.dat")); /* it reads the file beside it */
    assert_non_null(strstr(script, "gravity"));
    cli_read("sphere.dat", script, sizeof script);
    assert_non_null(strstr(script, "=Trajectories of the test set, true and predicted\n"));
    cli_expect(lg, TRAIN "--epochs 2 --out plotted.h5 --plot loss.svg --history loss.csv", 0, "plotted.h5");
    char text[4096];
    cli_read("loss.csv", text, sizeof text);
    assert_int_equal(strncmp(text, "epoch,loss,validation,rate,seconds\n1,", 37), 0);
}

TEST("with --newton a linear potential's loss is lower than with Adam alone, and cannot be lowered "
     "further") {
    cli_json(lg, "train train.h5 --potential linear --epochs 3 --out l.h5", "loss *");
    const double adam = json_number(result.out, "loss");
    cli_json(lg, "train train.h5 --potential linear --epochs 3 --newton --out l.h5",
             "newton_iterations *, loss <1e-14, floor >1e-20, floor <1e-14, warnings [\"the loss");
    assert_true(json_number(result.out, "loss") < 1e-6 * adam);
    assert_true(json_number(result.out, "loss") < 3 * json_number(result.out, "floor"));
    assert_non_null(strstr(result.err, "warning: the loss "));
    assert_non_null(strstr(result.err, "use --substeps 2 (floor about "));
    assert_non_null(strstr(result.err, "higher order, --scheme rkmk5"));
    cli_json(lg, "train train.h5 --potential linear --epochs 3 --newton --substeps 2 --out l.h5",
             "floor >1e-22");
    assert_non_null(strstr(result.err, "use --substeps 4"));
    cli_expect(lg, "train train.h5 --potential linear --epochs 3 --newton --integrator lie-euler --out l.h5",
               0, "l.h5");
    assert_non_null(strstr(result.err, "--scheme rkmk5"));
    cli_json(lg, "train train.h5 --potential linear --epochs 3 --stop-after 1 --newton --out l.h5",
             "newton_iterations 0"); /* only after the last epoch */
}

TEST("the default is the preset best; an option of Adam selects the published settings") {
    cli_json(lg, "train train.h5 --epochs 150 --out b.h5",
             "method \"ssbroyden\", hidden [20, evaluations 150, epochs 150, activation \"swish\", prior "
             "0.2, loss <1e-8");
    cli_json(lg, "train train.h5 --epochs 1 --batch 20 --out b.h5", "method \"adam\", hidden [100");
    cli_json(lg, "train train.h5 --method adam:2,ssbroyden --epochs 4 --out b.h5", "hidden [20");
    cli_json(lg, "train train.h5 --preset thesis --epochs 1 --out b.h5", "method \"adam\", prior 0");
    cli_expect(lg, "train train.h5 --method adam:5,lbfgs --lr 1e-2 --epochs 9 --out b.h5", 0,
               "epochs                             9\n");
}

TEST("training that ends early says why, and training for some seconds records its number of evaluations") {
    cli_json(lg, "train train.h5 --seconds 0.05 --out b.h5", "stopped \"the time is used up\"");
    assert_true(json_number(result.out, "evaluations") < 1000000);
    assert_non_null(strstr(result.err, "the time is used up"));
    cli_json(lg, "train train.h5 --method lbfgs --hidden 4 --epochs 10 --validation 0.2 --out b.h5",
             "stopped \"the planned epochs are done\"");
}

TEST("--size auto compares widths and takes the smallest good one") {
    cli_json(lg, "train train.h5 --size auto --epochs 60 --out b.h5", "hidden *, sizes *");
    assert_non_null(strstr(result.out, "\"size\": \"8,8\""));
    assert_says(result.out, "\"forecast\": ");
    assert_says(result.err, "--size auto: ");
    assert_says(result.err, " widths");
    cli_json(lg, "train train.h5 --size 7,5 --epochs 3 --out b.h5", "hidden [7");
}

TEST("--size auto shares the time of --seconds with the training, and says if there are no sizes to "
     "compare") {
    cli_json(lg, "train train.h5 --size auto --seconds 0.9 --out b.h5", "sizes *, stopped *");
    assert_true(json_number(result.out, "seconds_per_epoch") * json_number(result.out, "epochs") < 0.9);
    assert_true(json_number(result.out, "seconds") < 0.9);
    cli_expect(lg, "train train.h5 --potential linear --size auto --epochs 2 --out b.h5", 0, "b.h5");
    assert_says(result.err, "this model has no network, so there is no width to choose");
}

/* E1 of a model of noisy data, trained with measured or with estimated starts. */
static double error_with(const char *starts) {
    cli_json(lg, test_text("train n.h5 --starts %s --epochs 300 --out b.h5", starts),
             strcmp(starts, "measured") == 0 ? "method \"ssbroyden\"" : "method \"lbfgs\"");
    cli_json(lg, "evaluate b.h5 test.h5", "E1 *");
    return json_number(result.out, "E1");
}

TEST("with noise on all points, estimated starts are better than measured ones in the mean of five data "
     "sets") {
    enum { SETS = 5 };
    double gain = 0;
    for (int seed = 1; seed <= SETS; seed++) {
        char line[128];
        (void)snprintf(
            line, sizeof line,
            "generate scene.yaml --trajectories 60 --noise 1e-2 --noise-on all --out n.h5 --seed %d",
            10 + seed);
        cli_expect(lg, line, 0, "n.h5");
        const double measured = error_with("measured");
        gain += log(measured / error_with("estimated"));
    }
    assert_true(gain > 0);
}

TEST("training that learned nothing ends with exit code 4 and says why") {
    cli_expect(lg, TRAIN "--method adam --lr 1000 --epochs 10 --out wild.h5 --json", 4,
               "a state that does not change reaches");
    assert_true(json_is_object(result.out));
    json_expect(result.out, "epochs 10, warnings [\"the model has learned nothing");
}

TEST("separable systems are trained and judged") {
    cli_expect(lg, "generate quartic.yaml --trajectories 20 --points 4 --t-end 0.3 --out q.h5", 0, "quartic");
    cli_json(lg, "train q.h5 --hidden 8 --epochs 2 --batch 10 --out qm.h5", "integrator \"stormer-verlet\"");
    cli_json(lg, "evaluate qm.h5 q.h5", "E1 >0");
    cli_json(lg, "train q.h5 --hidden 8 --epochs 2 --batch 10 --integrator blanes-moan --out bm.h5",
             "integrator \"blanes-moan\"");
    cli_json(lg, "evaluate bm.h5 q.h5", "E1 >0");
    cli_expect(lg, "evaluate model.h5 q.h5", 3, "q.h5");
}

/* Writes the trajectories again, with two inputs for each step and a first point off the sphere. */
static void write_odd(const char *from, const char *to) {
    lg_trajectories *data = cli_trajectories(from);
    data->input_dim = 2;
    data->inputs = calloc(data->count * (data->points - 1) * 2, sizeof *data->inputs);
    assert_non_null(data->inputs);
    data->data[0] += 1e-3;
    assert_ok(lg_trajectories_write(NULL, cli_at(to), data, NULL));
}

TEST("data with inputs, noisy starts or no names are learned, which is told") {
    write_odd("train.h5", "odd.h5");
    cli_expect(lg, "train odd.h5 --starts estimated --method adam --hidden 4 --epochs 2 --out o.h5", 0, "");
    assert_says(result.err, "/inputs (2 numbers per step) is not used");
    assert_null(strstr(result.err, "are projected"));
    cli_expect(lg, "train odd.h5 --starts measured --hidden 4 --epochs 2 --out o.h5", 0, "");
    assert_says(result.err, "are projected onto it");
    assert_ok(lg_trajectories_write(NULL, cli_at("bare.h5"), cli_trajectories("train.h5"), NULL));
    const hid_t bare = H5Fopen(cli_at("bare.h5"), H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(H5Adelete(bare, "system") >= 0 && H5Adelete(bare, "layout") >= 0 && H5Fclose(bare) >= 0);
    cli_expect(lg, "train bare.h5 --hidden 4 --epochs 2 --out o.h5", 0, "");
    assert_says(result.err, "are taken as a state of family chain");
}

static const char make_quartic[] =
    "generate quartic.yaml --trajectories 20 --points 4 --t-end 0.3 --out q.h5";

TEST("a model is not evaluated on states of another size, and a symmetry has to fit") {
    cli_expect(lg, make_quartic, 0, "quartic");
    cli_write("two.yaml", "system: pendulum-chain\ngravity: 1\nmasses: [1, 1]\nlengths: [1, 1]\n");
    cli_expect(lg, "generate two.yaml --trajectories 3 --t-end 0.3 --out two.h5", 0, "");
    cli_expect("lg-learn", "evaluate model.h5 two.h5", 3,
               "a state has 12 numbers, but a state of the model has 6");
    cli_expect("lg-learn", "evaluate model.h5 q.h5", 3,
               "a state has 4 numbers, but a state of the model has 6");
    cli_expect(lg, "train q.h5 --symmetry axial --out none.h5", 2,
               "--symmetry axial: is not for family separable");
}

TEST("numbers too large for a loss are refused in the units of the data") {
    cli_expect(lg, make_quartic, 0, "quartic");
    lg_trajectories *data = cli_trajectories("q.h5");
    for (size_t i = 0; i < data->count * data->points * data->state_dim; i++) data->data[i] *= 1e200;
    lg_system_destroy(data->truth);
    data->truth = NULL;
    assert_ok(lg_trajectories_write(NULL, cli_at("huge.h5"), data, NULL));
    cli_expect(lg, "train huge.h5 --units given --scaled yes --hidden 4 --epochs 2 --out none.h5", 4,
               "epoch 1: the loss is inf");
}

TEST("a message reports variational steps that are too long for the data, and the remedy") {
    static const char train[] = "train attitude.h5 --scheme variational --epochs 2 --out attitude-model.h5";
    cli_write("attitude.yaml", "system: rigid-body-attitude\ninertia: [1, 2, 3]\nt_end: 10\n");
    cli_expect(lg, "generate attitude.yaml --trajectories 20 --points 5 --out attitude.h5", 0, "");
    cli_expect(lg, train, 4, "is finite with --substeps 1 and --scheme variational: give more --substeps");
    cli_expect(lg, test_text("%s --substeps 8", train), 0, "mean squared error");
}

/* ---- recorded errors ---- */

static void shell(const char *format, ...) __attribute__((format(printf, 1, 2)));
static void shell(const char *format, ...) {
    char command[1024];
    const int n = snprintf(command, sizeof command, "cd '%s' && ", cli_folder);
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(command + n, sizeof command - (size_t)n, format, arguments);
    va_end(arguments);
    if (system(command) != 0) fail_msg("%s", command);
}

/* The state of Adam and of the generator in a model file with n parameters. */
static void read_optimizer(const char *name, uint64_t n, double *m, double *v, uint64_t more[5]) {
    lg_file_reader *reader;
    lg_archive_reader from;
    assert_ok(lg_file_reader_create(NULL, cli_at(name), NULL, NULL, &reader, NULL));
    assert_ok(lg_file_reader_archive(reader, "", &from));
    assert_ok(from.array(from.user, "optimizer/adam/m", LG_ELEMENT_F64, 1, &n, m));
    assert_ok(from.array(from.user, "optimizer/adam/v", LG_ELEMENT_F64, 1, &n, v));
    assert_ok(from.array(from.user, "rng", LG_ELEMENT_U64, 1, &(uint64_t){4}, more));
    assert_ok(from.array(from.user, "optimizer/adam/step", LG_ELEMENT_U64, 0, NULL, more + 4));
    lg_file_reader_destroy(reader);
}

static void assert_same_optimizer(const char *a, const char *b, size_t n) {
    double *x = lg_test_memory(4 * n * sizeof *x);
    uint64_t more[2][5] = {{0}};
    read_optimizer(a, n, x, x + n, more[0]);
    read_optimizer(b, n, x + 2 * n, x + 3 * n, more[1]);
    assert_memory_equal(x, x + 2 * n, 2 * n * sizeof *x);
    assert_memory_equal(more[0], more[1], sizeof more[0]);
    assert_true(more[0][4] > 0);
}

/* Fails unless the two files agree in everything except errors and test set. */
static void assert_same_training(const lg_hamiltonian_file *a, const lg_hamiltonian_file *b) {
    const size_t bytes = a->parameters * sizeof(double);
    assert_ok(lg_recipe_compare_runs(&lg_recipe_hamiltonian, &a->run, &b->run, "model", NULL));
    assert_memory_equal(a->theta, b->theta, bytes);
    assert_true(a->epochs_done == 2 && b->epochs_done == 2);
    for (int i = 0; i < LG_FIT_SERIES_COUNT; i++)
        assert_memory_equal(a->history[i], b->history[i], 2 * sizeof(double));
    assert_string_equal(a->provenance.command, b->provenance.command);
    assert_string_equal(a->provenance.cpu, b->provenance.cpu);
    assert_string_equal(a->provenance.liegrad_version, b->provenance.liegrad_version);
    assert_true(a->provenance.has_seed && a->provenance.seed == b->provenance.seed);
}

TEST("evaluate --record writes the errors into the model's file and changes nothing else") {
    cli_expect(lg, TRAIN "--epochs 6 --seed 4 --stop-after 2 --checkpoint rc.h5 --out rec.h5", 0, "rec.h5");
    const lg_hamiltonian_file *before = cli_hamiltonian("rec.h5");
    assert_false(before->has_e1 || before->has_e2 || before->test.trajectories > 0);
    shell("cp rec.h5 rec.before");
    cli_json(lg, "evaluate rec.h5 test.h5", "recorded false");
    shell("cmp rec.h5 rec.before");
    cli_expect_limited(lg, "evaluate rec.h5 test.h5 --record", 2048, 3, "rec.h5");
    assert_says(result.out, "E1  ");
    assert_null(strstr(result.out, "Recorded"));
    shell("cmp rec.h5 rec.before");
    cli_json(lg, "evaluate rec.h5 test.h5 --record", "recorded true");
    const lg_hamiltonian_file *after = cli_hamiltonian("rec.h5");
    assert_true(after->has_e1 && after->has_e2);
    assert_close(after->e1, json_number(result.out, "E1"), 0, 0);
    assert_close(after->e2, json_number(result.out, "E2"), 0, 0);
    assert_true(after->test.trajectories == 6 && after->test.points == 8);
    assert_close(after->test.t_end, 1, 1e-15, 0);
    assert_string_equal(after->test.sha256, cli_trajectories("test.h5")->sha256);
    assert_same_training(before, after);
    assert_same_optimizer("rec.before", "rec.h5", after->parameters);
    /* A checkpoint is not a model, so it is refused. A model that is trained further from its checkpoint has
     * no errors yet. */
    shell("cp rc.h5 rc.before");
    cli_expect(lg, "evaluate rc.h5 test.h5 --record", 3, "rc.h5");
    shell("cmp rc.h5 rc.before");
    cli_json(lg, "train train.h5 --resume rc.h5 --out rec.h5", "epochs 6");
    after = cli_hamiltonian("rec.h5");
    assert_false(after->has_e1 || after->has_e2 || after->test.sha256[0] != '\0');
}

/* Test data without energies remove an E2 that was recorded with other data. Training data as test set cause
 * a warning. A link to the model stays a link. */
TEST("recorded errors replace older ones, and a link to the model stays a link") {
    cli_expect(lg, "evaluate twin.h5 train.h5 --record", 0, "Recorded in twin.h5");
    assert_says(result.err, "train.h5 holds the data that twin.h5 was trained on");
    const lg_hamiltonian_file *file = cli_hamiltonian("model.h5");
    assert_true(file->has_e2 && file->test.trajectories == 40);
    assert_string_equal(file->test.sha256, file->run.data_sha256);
    shell("cp test.h5 plain.h5 && test -L twin.h5");
    const hid_t plain = H5Fopen(cli_at("plain.h5"), H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(H5Ldelete(plain, "hamiltonian", H5P_DEFAULT) >= 0 && H5Fclose(plain) >= 0);
    cli_expect(lg, "evaluate model.h5 plain.h5 --record", 0, "unknown  the file of the test");
    assert_string_equal(result.err, "");
    file = cli_hamiltonian("model.h5");
    assert_true(file->has_e1 && !file->has_e2 && file->test.trajectories == 6);
}

TEST("a folder that cannot be written is reported before the evaluation; root can write everywhere") {
    shell("mkdir shut && cp model.h5 shut && ln -s shut/model.h5 shut.h5 && chmod 555 shut");
    if (geteuid() != 0) {
        cli_expect(lg, "evaluate shut.h5 test.h5 --record", 3, "cannot be written");
        assert_string_equal(result.out, "");
    }
    shell("chmod 777 shut && rm -r shut");
}

TEST("the demonstration records the errors that it prints") {
    cli_needs_programs();
    cli_json(lg, "demo --epochs 1 --t-end 1 --out demo", "E1 *, E2 *, trajectories 100, recorded true");
    const lg_hamiltonian_file *file = cli_hamiltonian("demo/model.h5");
    assert_true(file->has_e1 && file->has_e2 && file->test.trajectories == 100 && file->test.points == 15);
    assert_close(file->e1, json_number(result.out, "E1"), 0, 0);
    assert_close(file->e2, json_number(result.out, "E2"), 0, 0);
    assert_string_equal(file->test.sha256, cli_trajectories("demo/test.h5")->sha256);
    shell("rm -r demo");
}

/* The first weights of seed 31 have a nearly singular mass: a velocity overflows within one step. */
TEST("initial weights whose predictions are not finite are drawn again") {
    cli_write("planar.yaml", "system: pendulum-chain\nform: hamiltonian\ngravity: 9.81\nt_end: 0.12\n"
                             "masses: [0.93892384, 1.03590655, 1.0822107, 1.17215149, 1.0390508]\n"
                             "lengths: [0.90675322, 1.37093021, 1.3134184, 0.95006977, 1.11671529]\n"
                             "starts: { kind: plane, ahead: 2.85 }\n");
    cli_expect(lg, "generate planar.yaml --trajectories 200 --seed 4 --out planar.h5", 0, "");
    cli_json(lg, "train planar.h5 --seed 31 --integrator cf4 --hidden 8 --epochs 1 --out p.h5", "loss >0");
}

TEST("by default the penalty uses the first integral that fits the system") {
    cli_json(lg, "train train.h5 --penalty 1e-3 --epochs 2 --out p.h5",
             "penalty_integral \"vertical-angular-momentum\"");
    cli_json(lg, "train train.h5 --epochs 2 --out p.h5", "penalty_integral \"oscillator\"");
}

TEST("a penalty on a quantity that the data do not conserve causes a warning; noise alone does not") {
    cli_write("coupled.yaml", "system: coupled-oscillators\n");
    static const char *const noise[] = {"0", "0.05"};
    for (size_t i = 0; i < LG_COUNT(noise); i++) {
        char generate[160];
        (void)snprintf(
            generate, sizeof generate,
            "generate coupled.yaml --trajectories 400 --points 6 --t-end 1 --noise %s --out coupled.h5",
            noise[i]);
        cli_expect(lg, generate, 0, "");
        cli_expect(lg, "train coupled.h5 --penalty 1 --penalty-integral anharmonic --epochs 2 --out p.h5", 0,
                   "");
        assert_says(result.err, "do not conserve anharmonic");
        cli_expect(lg, "train coupled.h5 --penalty 1 --epochs 2 --out p.h5", 0, "");
        assert_null(strstr(result.err, "conserve"));
    }
}

/* ---- studies ---- */

TEST("a study runs, and continues where it was stopped") {
    expect_drawn("study grid.yaml --out once.csv --jobs 2 --threads 2", "w.png");
    assert_says(result.out, "Geometric means");
    static char text[65536];
    (void)cli_read("w.dat", text, sizeof text);
    assert_says(text, "=0\n=2\n=1\n=cf4\n=euler\n=M = 3\n");
    cli_json(lg, "study grid.yaml --out again.csv --stop-after 1", "done 1");
    shell("printf 'cf4,1,12,3,0,0,1,12' >> again.csv"); /* an incomplete row */
    cli_json(lg, "study grid.yaml --out again.csv --jobs 1", "done 8, new 7");
    cli_json(lg, "study grid.yaml --out again.csv", "new 0");
    shell("test $(wc -l < once.csv) = 9 && test $(wc -l < again.csv) = 9");
    cli_expect(lg, "study grid.yaml --out again.csv --seed 8", 3, "other settings");
    cli_expect_limited(lg, "study grid.yaml --out limited.csv --jobs 1", 200, 3, "limited.csv");
    shell("test -z \"$(tail -c 1 limited.csv)\"");
    cli_json(lg, "study grid.yaml --out limited.csv", "done 8");
}

TEST("damaged rows of a study are found, whether this grid has their run or not; numbers may be written in "
     "other ways") {
    cli_json(lg, "study grid.yaml --out whole.csv --jobs 1", "done 8");
    static const struct {
        const char *change, *said;
    } damages[] = {{"2s/^\\([^,]*,[^,]*,[^,]*\\)/\\1x/", "line 2: column N: '6x' is not a number"},
                   {"2s/^[^,]*,/,/", "line 2: column integrator: is empty"},
                   {"2s/^\\([^,]*,[^,]*\\),[^,]*/\\1,77x/", "line 2: column N: '77x' is not a number"},
                   {"2s/^\\([^,]*,[^,]*\\),[^,]*/\\1,/", "line 2: column N: is empty"},
                   {"2s/^\\(.*,.*,.*,.*\\),[^,]*,[^,]*,[^,]*$/\\1,zz,ok,p/", "line 2: column epochs: 'zz'"},
                   {"2s/,[^,]*$//", "line 2: has 14 cells, the header has 15; leave cells without"},
                   {"2s/^/\\n/", "line 2: is blank or a comment"},
                   {"1s/^/# mine\\n/", "line 2: comes after other lines"}};
    for (size_t i = 0; i < LG_COUNT(damages); i++) {
        shell("sed '%s' whole.csv > damaged.csv && ! cmp -s whole.csv damaged.csv", damages[i].change);
        cli_expect(lg, "study grid.yaml --out damaged.csv", 3, damages[i].said);
    }
    shell("sed '1s/$/,more/' whole.csv > damaged.csv");
    cli_expect(lg, "study grid.yaml --out damaged.csv", 3, "this is not the table of a study");
    shell("sed 's/^\\(cf4,1\\),6,/\\1,6.0,/' whole.csv > other.csv && ! cmp -s whole.csv other.csv");
    cli_json(lg, "study grid.yaml --out other.csv", "new 0");
}

/* Command lines that change grid.yaml. */
#define OTHER_GRID(change) "sed '" change "' grid.yaml > other.yaml && ! cmp -s grid.yaml other.yaml"

TEST("a study and a search reject the table of the other, which stays as it is") {
    cli_json(lg, "study grid.yaml --out study.csv --jobs 1", "done 8");
    cli_write("ranges.yaml", "fixed: {epochs: 2, hidden: 4}\nranges:\n  batch: {choice: [8, 16]}\n");
    cli_expect(lg, "search ranges.yaml train.h5 --trials 2 --out search.csv", 0, "best: trial");
    shell("cp study.csv study-kept.csv && cp search.csv search-kept.csv");
    cli_expect(lg, "search ranges.yaml train.h5 --trials 2 --out study.csv", 3,
               "study.csv: exists and is not an earlier result of this kind");
    /* the table is looked at before the data */
    cli_expect(lg, "search ranges.yaml nowhere.h5 --trials 2 --out study.csv", 3, "is not an earlier result");
    cli_expect(lg, "search ranges.yaml train.h5 --trials 2 --out study.csv --continue", 3,
               "study.csv: line 1: '# seed S space HASH setting HASH' is expected");
    cli_expect(lg, "search ranges.yaml train.h5 --trials 2 --out study.csv --task 0/2", 3, "line 1");
    cli_expect(lg, "study grid.yaml --out search.csv", 3,
               "this is not the table of a study: column 1 is 'trial', expected: integrator");
    cli_expect(lg, "study grid.yaml --out search.csv --task 0/2", 3, "this is not the table of a study");
    shell("cmp study.csv study-kept.csv && cmp search.csv search-kept.csv && ! ls *.part-* 2>/dev/null");
}

TEST("a run of a study whose row lacks a result counts as not done") {
    static const char *const changes[] = {"2s/^\\(\\([^,]*,\\)\\{8\\}\\)[^,]*,[^,]*,[^,]*/\\1,,/",
                                          "2s/^\\(\\([^,]*,\\)\\{8\\}\\)[^,]*/\\1/",
                                          "2s/^\\(\\([^,]*,\\)\\{10\\}\\)[^,]*/\\1/"};
    cli_json(lg, "study grid.yaml --out whole.csv --jobs 1", "done 8");
    for (size_t i = 0; i < LG_COUNT(changes); i++) {
        shell("sed '%s' whole.csv > empty.csv && grep -q ',,.*,ok' empty.csv", changes[i]);
        cli_json(lg, "study grid.yaml --out empty.csv --jobs 1", "done 8, new 1");
        shell("cut -d, -f1-11 empty.csv > a && cut -d, -f1-11 whole.csv > b && cmp a b");
    }
}

TEST("runs of a study are known by their settings and seed, wherever their rows come from") {
    cli_json(lg, "study grid.yaml --out whole.csv --jobs 1", "done 8");
    for (int task = 0; task < 2; task++) {
        cli_expect(lg, test_text("study grid.yaml --out half.csv --task %d/2", task), 0, "");
        cli_expect(lg, "study grid.yaml --out half.csv --merge", 3, "4 of 8 pieces are not done yet");
        shell("mv half.csv half-%d.csv && rm half.csv.part-%d-of-2", task, task);
    }
    shell("(cat half-1.csv; sed 1d half-0.csv) > joined.csv");
    cli_json(lg, "study grid.yaml --out joined.csv --plot joined.svg", "done 8, new 0");
    shell("cut -d, -f1-11 whole.csv | sort > a && cut -d, -f1-11 joined.csv | sort > b && cmp a b");
    /* rows of the first half again: the table keeps them, and the first ones count */
    shell("sed '1d; s/^\\(\\([^,]*,\\)\\{9\\}\\)[^,]*/\\10.5/' half-0.csv >> joined.csv");
    cli_json(lg, "study grid.yaml --out joined.csv", "done 12, new 0");
    assert_null(strstr(result.out, "\"E1\": 0.5"));
    shell(OTHER_GRID("s/^seed.*/seed: 4/"));
    cli_json(lg, "study other.yaml --out seed-4.csv --jobs 1", "done 8");
    shell("(cat half-0.csv; sed 1d seed-4.csv) > joined.csv");
    cli_expect(lg, "study grid.yaml --out joined.csv", 3, "joined.csv: line 6: column seed: the row belongs");
    /* a spreadsheet rounds seeds */
    shell("awk -F, -v OFS=, 'NR > 1 {$8 = sprintf(\"%%.14E\", $8)} 1' whole.csv > joined.csv");
    cli_json(lg, "study grid.yaml --out joined.csv", "done 8, new 0");
    shell(
        "sed '2s/,1,\\([0-9]\\{12,\\}\\),/,2,\\1,/' whole.csv > joined.csv && ! cmp -s whole.csv joined.csv");
    cli_expect(lg, "study grid.yaml --out joined.csv", 3, "joined.csv: line 2: column seed: the row belongs");
}

TEST("a study continues the table of a grid with more values, fewer values and other ones, and keeps all "
     "rows") {
    cli_json(lg, "study grid.yaml --out rows.csv --jobs 1", "planned 8, done 8, new 8");
    shell("sort rows.csv > rows");
    shell(OTHER_GRID("s/^N:.*/N: [12]/; s/^integrators:.*/integrators: [euler]/"));
    cli_json(lg, "study other.yaml --out rows.csv --jobs 1", "planned 2, done 8, new 0");
    shell("sort rows.csv | cmp rows -");
    shell(OTHER_GRID("s/^eps:.*/eps: [0.25]/; s/^repeats:.*/repeats: 3/"));
    cli_json(lg, "study other.yaml --out rows.csv --jobs 1", "planned 12, done 20, new 12");
    cli_json(lg, "study grid.yaml --out rows.csv", "planned 8, done 20, new 0");
    shell(OTHER_GRID("s/^eps:.*/eps: [0, 0.25]/; s/^repeats:.*/repeats: 3/"));
    cli_json(lg, "study other.yaml --out rows.csv --jobs 1", "planned 24, done 24, new 4");
    shell("sort rows.csv | comm -13 - rows | cmp - /dev/null");
}

TEST("a value that is given twice in a grid counts once") {
    shell(OTHER_GRID("s/^eps:.*/eps: [0, 0.0, -0]/; s/^integrators:.*/integrators: [cf4, euler, cf4]/"));
    cli_json(lg, "study other.yaml --out twice.csv --jobs 1", "planned 8, done 8, new 8");
    assert_says(result.err, "eps: 0 is given twice and counts once");
    assert_says(result.err, "integrator: cf4 is given twice and counts once");
    cli_json(lg, "study grid.yaml --out twice.csv", "planned 8, done 8, new 0");
}

TEST("the table of a study or search that has no row yet is continued") {
    cli_write("head.csv", "integrator,substeps,N,M,eps,penalty,repeat,seed,loss,E1,E2,seconds,epochs,status,"
                          "protocol\n");
    cli_json(lg, "study grid.yaml --out head.csv --jobs 1", "done 8, new 8");
    cli_write("head.csv", "");
    cli_json(lg, "study grid.yaml --out head.csv --jobs 1", "done 8, new 8");
    cli_write("ranges.yaml", "fixed: {epochs: 2, hidden: 4}\nranges:\n  batch: {choice: [8, 16]}\n");
    for (int lines = 1; lines < 3; lines++) {
        cli_forget("trials.csv");
        cli_expect(lg, "search ranges.yaml train.h5 --trials 2 --out trials.csv", 0, "");
        shell("sed -i '%d,$d' trials.csv", lines + 1);
        cli_json(lg, "search ranges.yaml train.h5 --trials 2 --out trials.csv --continue", "new 2");
    }
}

TEST("the plot of a study has a block for each integrator, also when runs failed") {
    static char text[65536];
    cli_expect(lg, "study grid.yaml --out lost.csv --jobs 1", 0, "");
    shell("sed 's/^\\(cf4,1,6,.*\\),[^,]*,[^,]*,[^,]*,\\([^,]*,[^,]*\\),ok,/\\1,,,,\\2,failed,/' lost.csv > "
          "half.csv");
    cli_json(lg, "study grid.yaml --out half.csv --plot half.svg", "new 0");
    assert_says(result.out, "\"runs\": 2, \"failed\": 2}");
    (void)cli_read("half.dat", text, sizeof text);
    size_t ends = 0;
    for (const char *at = text; (at = strstr(at, "\n\n\n")) != NULL; at++) ends++;
    assert_int_equal(ends, 1 + 2); /* of the texts and of two integrators with one M */
}

TEST("a study continues only with the same method, prior and scale") {
    shell("{ cat grid.yaml; echo 'method: lbfgs'; echo 'prior: 0.5'; } > later.yaml");
    cli_json(lg, "study later.yaml --out later.csv --jobs 1", "done 8");
    static const char *const changes[] = {"s/lbfgs/ssbroyden/", "s/^prior.*//", "$ a scaled: yes"};
    for (size_t i = 0; i < LG_COUNT(changes); i++) {
        shell("sed '%s' later.yaml > other.yaml", changes[i]);
        cli_expect(lg, "study other.yaml --out later.csv", 3, "other settings");
    }
}

TEST_GROUP(setup, cli_end)

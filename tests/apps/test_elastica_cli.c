/* Runs lg-elastica (in LG_BIN_DIR): equilibria, curves, networks, searches whose trials fail. Elsewhere: what
 * it shares with other executables is in test_runs, what it refuses in test_refused.
 * ctest-labels: apps/lg-elastica src/elastica */
#include "cli_support.h"

#include <hdf5.h>

#include "liegrad/elastica.h"

static const char lg[] = "lg-elastica";

#define PI 3.14159265358979323846

static void json(const char *arguments, const char *members) {
    cli_json(lg, arguments, members);
}

static double number(const char *arguments, const char *key) {
    json(arguments, "");
    return json_number(result.out, key);
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_run(lg, "generate --case both-ends --count 40 --intervals 10 --out data.h5");
    cli_run(lg, "generate --case right-end --count 40 --intervals 10 --out right.h5");
    cli_run(lg, "generate --case both --count 20 --intervals 10 --out both.h5");
    cli_run(
        lg,
        "train data.h5 --method adam --modes 0 --hidden 12 --layers 1 --batch 8 --epochs 3 --out model.h5");
    return 0;
}

/* ---- solve ---- */

TEST("solve prints energy, force, nodes and angles") {
    double q[22], v[22], numbers[11], force[2];
    json("solve --case right-end --x 2 --intervals 10",
         "energy *, v *, seconds *, iterations *, rotation -2, negative_eigenvalues 0, gradient <1e-10, "
         "residual <1e-8");
    assert_int_equal(json_array(result.out, "q", q, 22), 22);
    assert_int_equal(json_array(result.out, "v", v, 22), 22);
    assert_int_equal(json_array(result.out, "multiplier", force, 2), 2);
    assert_int_equal(json_array(result.out, "lambda", numbers, 11), 9);
    assert_int_equal(json_array(result.out, "theta", numbers, 11), 11);
    assert_all_close(q, ((const double[]){0, 0}), 2, 0, 0);
    assert_all_close(q + 20, ((const double[]){3, 0}), 2, 1e-13, 1e-13);
    assert_all_close(v + 20, ((const double[]){cos(2), -sin(2)}), 2, 1e-13, 0);
    /* The force is the derivative of the energy with respect to the distance of the ends. */
    const double more = number("solve --case right-end --x 2 --intervals 10 --qN 3.00001,0", "energy");
    const double less = number("solve --case right-end --x 2 --intervals 10 --qN 2.99999,0", "energy");
    assert_close(force[0], (more - less) / 2e-5, 1e-5, 0);
    cli_run(lg, "solve --x 2 --intervals 2");
    json("solve --x 2 --intervals 2", "");
    assert_int_equal(json_array(result.out, "lambda", numbers, 11), 1);
    json("solve --x 1 --continuous", "energy >0");
    assert_null(json_find(result.out, "lambda"));
}

/* The energies for N = 1000 were computed by another program. */
TEST("a case, and the same problem given by angles, have the energy that another program found") {
    static const char *const ways[] = {
        "solve --case both-ends --x 1.5707963267948966 --intervals 1000",
        "solve --theta0 1.5707963267948966 --thetaN -1.5707963267948966 --intervals 1000",
        "solve --theta0 3.1415926535897931 --thetaN 0 --q0 1,-2 --qN 1,1 --length 3.3 --intervals 1000"};
    for (size_t i = 0; i < LG_COUNT(ways); i++)
        assert_close(number(ways[i], "energy"), 45.752542288901, 1e-10, 0);
}

TEST("the requested rotation is found, or refused if there is no such minimum") {
    json("solve --theta0 1 --thetaN -1", "rotation -2");
    const double best = json_number(result.out, "energy");
    /* A loop in the other direction is a minimum for large angles only; here there is no minimum to
     * accept. */
    cli_expect(lg, "solve --theta0 1 --thetaN -1 --rotation 4.283185307179586 --json", 4, "no minimum");
    assert_string_equal(result.out, "");
    json("solve --theta0 3.1 --thetaN -3.1 --rotation 6.366370614359172", "rotation 6.366370614359172");
    const double opposite = json_number(result.out, "energy");
    assert_true(number("solve --theta0 3.1 --thetaN -3.1", "energy") < opposite);
    /* Without --thetaN the rotation determines it. */
    assert_close(number("solve --theta0 1 --rotation -2", "energy"), best, 1e-12, 0);
    /* Here a turn by the larger angle needs less energy. */
    json("solve --theta0 2.9 --thetaN -2.9", "rotation -5.8");
    json("solve --case both-ends --x 2.9", "rotation -5.8");
}

/* Reads the energies of the branches. Without --saddles all of them are minima. */
static size_t branch_energies(const char *arguments, double *energies, size_t room) {
    json(arguments, "branches [");
    size_t n = 0;
    for (const char *s = json_space(json_find(result.out, "branches") + 1); *s == '{' && n < room; n++) {
        energies[n] = json_number(s, "energy");
        if (strstr(arguments, "--saddles") == NULL) json_expect(s, "negative_eigenvalues 0");
        s = json_space(json_value(s));
        s = json_space(s + (*s == ','));
    }
    return n;
}

TEST("hard cases have their known minima") {
    static const struct {
        const char *arguments;
        size_t minima;
    } rows[] = {/* there is a second minimum for |w| up to 0.1925 pi */
                {"solve --case both-ends --x 0.59 --branches", 2},
                {"solve --case both-ends --x 0.62 --branches", 1},
                /* the beam that buckles to the other side is stable up to 0.171 pi */
                {"solve --case right-end --x 0.53 --branches", 2},
                {"solve --case right-end --x 0.55 --branches", 1}};
    double energies[64];
    assert_int_equal(branch_energies("solve --case both-ends --x 3.141592653589793 --branches", energies, 64),
                     4);
    assert_all_close(energies, ((const double[]){420.415, 420.415, 439.367, 439.367}), 4, 2e-6, 0);
    assert_close(number("solve --case both-ends --x 3.141592653589793", "energy"), 420.415, 2e-6, 0);
    for (size_t i = 0; i < LG_COUNT(rows); i++)
        assert_int_equal(branch_energies(rows[i].arguments, energies, 64), rows[i].minima);
    /* Exactly at the bifurcations solve must still find a minimum. */
    static const char *const angles[] = {"0", "3.141592653589793", "6.283185307179586", "-3.141592653589793"};
    for (size_t i = 0; i < 8; i++) {
        json(test_text("solve --case %s --x %s", i < 4 ? "both-ends" : "right-end", angles[i % 4]),
             "negative_eigenvalues 0");
    }
}

TEST("--saddles adds branches") {
    double energies[64];
    const size_t few = branch_energies("solve --x 0.3 --intervals 20 --branches", energies, 64);
    assert_true(branch_energies("solve --x 0.3 --intervals 20 --branches --saddles", energies, 64) > few);
    cli_run(lg, "solve --x 0.3 --intervals 20 --branches --saddles");
    assert_says(result.out, "saddle");
    assert_says(result.out, "minimum");
    cli_run(lg, "solve --x 0.3 --intervals 20 --branches --rotation -0.6 --plot all.svg --out all.csv");
    assert_true(cli_exists("all.gp") && cli_exists("all.csv"));
    if (!cli_exists("all.svg")) assert_says(result.err, "gnuplot");
}

TEST("a sweep follows the branches") {
    char text[8192];
    double x[9];
    json("solve --case right-end --sweep 9 --intervals 12 --plot sweep.svg --out sweep.csv", "branches >1");
    assert_int_equal(json_array(result.out, "x", x, 9), 9);
    assert_close(x[8], 2 * PI, 1e-15, 0);
    assert_true(cli_exists("sweep.gp"));
    cli_read("sweep.csv", text, sizeof text);
    assert_int_equal(strncmp(text, "branch,x,energy,negative_eigenvalues,rotation\n1,", 48), 0);
    cli_run(lg, "solve --case right-end --sweep 9 --intervals 12 --threads 1");
    assert_says(result.out, "energy from");
}

/* ---- generate ---- */

TEST("generated curves are those that are asked for, and agree with solve") {
    double q[16];
    lg_elastica_data data;
    json("generate --case both --count 5 --intervals 7 --gap 0.02 --out g.h5 --plot g.svg",
         "curves 10, intervals 7");
    assert_ok(lg_elastica_data_read(NULL, cli_at("g.h5"), NULL, &data, NULL));
    const lg_elastica_curves *c = &data.curves;
    assert_int_equal(c->count, 10);
    /* For each case: three values in the first half, two in the second. */
    assert_all_close(c->x, ((const double[]){0.02 * PI, 0.5 * PI, 0.98 * PI}), 3, 1e-14, 0);
    assert_int_equal(c->kind[0], LG_ELASTICA_BOTH_ENDS);
    assert_int_equal(c->kind[9], LG_ELASTICA_RIGHT_END);
    json("solve --case both-ends --x 1.5707963267948966 --intervals 7", "");
    assert_close(json_number(result.out, "energy"), c->energy[1], 1e-12, 0);
    assert_int_equal(json_array(result.out, "q", q, 16), 16);
    assert_all_close(c->q + 16, q, 16, 0, 1e-10);
    lg_elastica_data_destroy(&data);
    cli_run(lg, "generate --count 1 --intervals 6 --out one.h5");
    json("generate --count 2 --intervals 6 --continuous --out c.h5", "values \"continuous\"");
    cli_run(lg, "generate --count 3 --intervals 2 --out tiny.h5"); /* N = 2 can be learned too */
    json("train tiny.h5 --modes 0 --hidden 4 --layers 0 --epochs 1 --train-fraction 1 --test-fraction 0 "
         "--out t2.h5",
         "test_mse null, floor null, warnings [\"the model has learned nothing");
}

TEST("curves with nodes that no beam can have are refused where they are read") {
    static const double sizes[] = {3.0, -1e4, 1e200, 1e307};
    static const char *const lines[] = {"evaluate model.h5 odd.h5",
                                        "train odd.h5 --hidden 4 --layers 0 --epochs 1 --out odd-model.h5"};
    char path[1024];
    lg_elastica_data data;
    cli_path("data.h5", path, sizeof path);
    assert_ok(lg_elastica_data_read(NULL, path, NULL, &data, NULL));
    cli_path("odd.h5", path, sizeof path);
    for (size_t i = 0; i < 2 * LG_COUNT(sizes); i++) {
        double *number = (i % 2 == 0 ? data.curves.q : data.curves.v) + 2 * (11 * 3 + 5);
        const double kept = *number;
        *number = sizes[i / 2] * data.curves.length;
        assert_ok(lg_elastica_data_write(NULL, path, &data, NULL));
        *number = kept;
        for (size_t k = 0; k < LG_COUNT(lines); k++) {
            cli_run_limited(lg, lines[k], 0);
            if (strstr(result.err,
                       "odd.h5: 1 nodes cannot be points of a beam; the first is node 5 of curve 3") == NULL)
                fail_msg("%s: %s", lines[k], result.err);
            if (fabs(sizes[i / 2]) > 1e100) assert_int_equal(result.code, 4);
        }
    }
    lg_elastica_data_destroy(&data);
    cli_json(lg, "evaluate model.h5 both.h5", "");
    if (strstr(result.out, "cannot be points") != NULL) fail_msg("%s", result.out);
}

/* Processor time of the children that have ended. Unlike elapsed time it is the same on a busy machine. */
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
    cli_interrupt(child);
    assert_says(result.err, "stopped by Ctrl-C");
    assert_true(children_seconds() - begin <= 2);
    assert_false(cli_exists("many.h5"));
}

/* ---- train, evaluate, predict ---- */

/* The network has 8 x 12 + 12, 12 x 12 + 12 and 12 x 36 + 36 parameters. */
TEST("a network is trained, and evaluate prints the same errors of the parts as train") {
    json("train data.h5 --method adam --modes 0 --hidden 12 --layers 1 --batch 8 --epochs 4 --out t.h5 "
         "--history t.csv --plot t.svg",
         "seconds_per_epoch *, parameters 732, training_loss *, epochs 4, threads *, dtype *, seed *, source "
         "*, "
         "train_curves 36, test_curves 4");
    const double train = json_number(result.out, "train_mse"), test = json_number(result.out, "test_mse");
    json("evaluate t.h5 data.h5 --part train", "curves 36");
    assert_close(json_number(result.out, "mse"), train, 1e-12, 0);
    json("evaluate t.h5 data.h5 --part test", "curves 4");
    assert_close(json_number(result.out, "mse"), test, 1e-12, 0);
    json("evaluate t.h5 data.h5 --plot e.svg", "curves 40");
    assert_close(json_number(result.out, "mse"), 0.9 * train + 0.1 * test, 1e-12, 0);
    assert_true(cli_exists("e.gp") && cli_exists("t.gp") && cli_exists("t.csv"));
}

TEST("--preset takes the published settings for the data and the network, except for options that are "
     "given") {
    static const char *const rows[][2] = {
        {"train data.h5 --preset thesis",
         "hidden 879, layers 4, source \"table 5.3; penalty of the published program\", preset \"thesis\""},
        {"train data.h5 --preset thesis --hidden 5 --layers 2 --activation swish",
         "hidden 5, activation \"swish\""},
        {"train both.h5 --preset thesis --hidden 4",
         "source \"table 5.5; penalty of the published program\", activation \"leaky-relu\""},
        {"train both.h5 --hidden 4", "preset \"best\""},
        {"train right.h5 --hidden 4", "preset \"best\""},
        {"train data.h5 --most-curves 1 --modes 0 --hidden 4", "learned_curves 1"},
    };
    static const char *const none[][2] = {
        {"data.h5 --loss energy", "thesis has no settings for the discrete network with --loss energy"},
        {"data.h5 --network continuous --boundary true", "continuous network with --boundary true"},
        {"both.h5 --network angle", "angle network on data of both families"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        json(test_text("%s --epochs 1 --out p.h5", rows[i][0]), rows[i][1]);
    }
    for (size_t i = 0; i < LG_COUNT(none); i++)
        cli_expect(lg, test_text("train %s --preset thesis --out p.h5", none[i][0]), 2, none[i][1]);
}

/* The mirror image of x is 2 pi - x. */
TEST("every kind of network is trained, judged and predicts, and only --mirror makes it symmetric") {
    static const struct {
        const char *options, *evaluated;
        bool mirrored;
    } kinds[] = {
        {"--network discrete --architecture resnet", "boundary_error <1e-15", true},
        {"--network discrete --modes 0", "boundary_error <1e-15", true},
        {"--network discrete --modes 0 --angles true", "unit_tangent_error <1e-15, boundary_error <1e-15",
         true},
        {"--network discrete --loss energy", "unit_tangent_error <1e-15, boundary_error <1e-15", true},
        {"--network continuous --embedding 5 --architecture mult", "mse *", true},
        {"--network continuous --architecture mult-affine --mirror false", "mse *", false},
        {"--network continuous --boundary true", "boundary_error <1e-13", true},
        {"--network discrete --modes 0 --gamma 0.1 --penalty-form text --mirror false", "mse *", false},
        {"--network angle --embedding 5 --architecture mult", "unit_tangent_error <1e-15", true},
        {"--network angle --boundary true --symmetric true",
         "unit_tangent_error <1e-15, boundary_error <1e-12", true},
        {"--network angle --boundary true --architecture mlp",
         "unit_tangent_error <1e-15, boundary_error <1e-12", true},
    };
    for (size_t i = 0; i < LG_COUNT(kinds); i++) {
        double q[22], mirrored[22];
        json(test_text("train data.h5 %s --hidden 5 --layers 1 --epochs 60 --out k.h5", kinds[i].options),
             "test_mse >0, test_mse <100");
        const double mse = json_number(result.out, "test_mse");
        json("evaluate k.h5 data.h5 --part test", kinds[i].evaluated);
        assert_close(json_number(result.out, "mse"), mse, 1e-12, 0);
        json("predict k.h5 --case both-ends --x 1", "v *");
        assert_int_equal(json_array(result.out, "q", q, 22), 22);
        json("predict k.h5 --case both-ends --x 5.283185307179586", "");
        assert_int_equal(json_array(result.out, "q", mirrored, 22), 22);
        bool same = true;
        for (size_t k = 0; k < 22; k++)
            same = same && lg_is_close(mirrored[k], k % 2 == 0 ? q[k] : -q[k], 0, 1e-12);
        assert_int_equal(same, kinds[i].mirrored);
    }
}

TEST("a prediction is printed with its distance to the training range, the reach, and its error") {
    char text[4096];
    double s[5];
    json("predict model.h5 --x 1 --points 5 --solve --out p.csv --plot p.svg",
         "q *, v *, theta *, distance *, reach *, inside true, energy *, seconds *, max_error *");
    assert_int_equal(json_array(result.out, "s", s, 5), 5);
    assert_close(s[1], 3.3 / 4, 1e-15, 0);
    assert_string_equal(result.err, "");
    cli_read("p.csv", text, sizeof text);
    assert_int_equal(strncmp(text, "s,x,y,vx,vy,theta\n0,0,0,0.54030230586813", 40), 0);
    json("predict model.h5 --x 1 --s 0,0.5,3.3", "");
    assert_int_equal(json_array(result.out, "theta", s, 5), 3);
    assert_close(s[0], 1, 1e-14, 0);
    json("predict model.h5 --theta0 1 --thetaN -1", "inside true"); /* angles instead of a case */
    cli_run(lg, "predict model.h5 --x 1 --solve");
    assert_says(result.out, "largest difference");
}

TEST("the beam that a model was trained on is solved with its own length and stiffness") {
    static const struct {
        const char *beam;
        double scale;
    } rows[] = {{"--length 0.42 --stiffness 0.04375 --qN 0.36,0", 1},
                {"--length 420e6 --stiffness 0.04375e27 --qN 360e6,0", 1e18}}; /* EI/L has the factor 1e18 */
    double energy[2], first = 0;
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_run(lg, "generate %s --count 40 --intervals 10 --out beam.h5", rows[i].beam);
        cli_run(lg, "train beam.h5 --epochs 20 --out beam-model.h5");
        energy[0] = number("predict beam-model.h5 --x 0.7 --solve", "energy");
        energy[1] = number(test_text("solve %s --x 0.7 --intervals 10", rows[i].beam), "energy");
        assert_close(energy[0], energy[1], 1e-12, 0);
        if (i == 0) first = energy[0];
        assert_close(energy[0], first * rows[i].scale, 1e-9, 0);
    }
    cli_run(lg, "predict beam-model.h5 --theta0 .6 --thetaN -.2");
    assert_says(result.err, "off their family");
    hid_t file = H5Fopen(cli_at("beam-model.h5"), H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(H5Adelete_by_name(file, "run", "stiffness", H5P_DEFAULT) >= 0 && H5Fclose(file) >= 0);
    json("predict beam-model.h5 --x 0.7 --solve", "energy null, max_error *");
    assert_says(result.err, "does not say the stiffness");
}

TEST("the error of a network of modes is its loss plus its truncation; the curves determine the number "
     "of modes") {
    json("train data.h5 --modes 3 --epochs 40 --seed 2 --out m3.h5",
         "modes 3, angles false, learned_curves 36");
    const double truncation = json_number(result.out, "truncation");
    assert_close(json_number(result.out, "train_mse"), json_number(result.out, "training_loss") + truncation,
                 1e-9, 0);
    assert_true(truncation > 1e-12);
    json("train data.h5 --epochs 1 --out once.h5", "truncation <1e-13");
    const double one = json_number(result.out, "modes");
    json("train both.h5 --epochs 1 --train-fraction 1 --test-fraction 0 --out two.h5", "truncation <1e-13");
    assert_true(one > 7 && json_number(result.out, "modes") > one);
    json("train data.h5 --epochs 1 --train-fraction 0.1 --out m3.h5", "modes 3, train_curves 4");
    json("train data.h5 --most-curves 9 --epochs 1 --out m9.h5", "learned_curves 9, train_curves 36");
}

TEST("--size auto does not drop networks whose loss still falls") {
    cli_expect(lg, "generate --count 100 --intervals 10 --out race.h5", 0, "");
    cli_json(lg, "train race.h5 --size auto --out raced.h5", "hidden >8, train_mse <1e-12");
}

TEST("the energy loss trains a network from boundary conditions alone") {
    json("train data.h5 --loss energy --epochs 300 --out e.h5",
         "training_loss <1e-3, angles true, modes 0, truncation null");
    assert_true(json_number(result.out, "test_mse") < 1e-3);
    cli_run(lg, "generate --count 12 --intervals 40 --continuous --out smooth.h5");
    json("train smooth.h5 --loss energy --epochs 300 --out e.h5",
         "warnings [\"--loss energy learns solutions of the discrete problem with 40 intervals");
    assert_says(result.err,
                "but the data are continuous solutions: the errors include the difference between the two");
}

TEST("a prediction outside the training range is printed with a warning") {
    json("predict model.h5 --case right-end --x 2", "inside false");
    assert_says(result.err, "warning: outside the training range");
    assert_true(json_number(result.out, "distance") > 2 * json_number(result.out, "reach"));
    json("predict model.h5 --x 1 --qN 1,0", "");
    assert_says(result.err, "outside");
    json("evaluate model.h5 right.h5", "outside >20, largest_distance >0.5");
    assert_says(result.err, "of 40 curves lie outside the training range");
    json("evaluate model.h5 data.h5", "outside 0");
    assert_string_equal(result.err, "");
    cli_run(lg, "generate --count 8 --intervals 10 --continuous --out smooth.h5");
    cli_run(lg, "evaluate model.h5 smooth.h5");
    assert_says(result.err, "trained on discrete values");
}

TEST("a failed trial becomes a row of the table, and the search goes on") {
    cli_write("wild.yaml", "fixed: {method: adam, dtype: f32, modes: 0, epochs: 9, batch: 8, hidden: 4, "
                           "layers: 14, activation: identity, "
                           "schedule: constant}\nranges:\n  lr: {log-uniform: [5e2, 1e3]}\n");
    cli_expect(lg, "search wild.yaml data.h5 --trials 2 --out wild.csv --plot wild.svg --json", 4,
               "none of 2 trials was finished; trial 0 failed first: ");
    assert_true(cli_exists("wild.csv"));
    json_expect(result.out, "done 0, trials 2");
    assert_null(json_find(result.out, "best"));
    cli_expect(lg, "search wild.yaml data.h5 --trials 2 --out wild.csv --resume", 4,
               "none of the 2 trials in wild.csv was finished");
    cli_expect(lg, "search wild.yaml data.h5 --trials 2 --validation 0.001 --out w.csv", 4,
               "the validation part has none of the 36 curves");
    /* There is no memory for a network of 10^13 parameters. */
    cli_write("roomy.yaml", "fixed: {epochs: 1, batch: 8, layers: 14}\n"
                            "ranges:\n  hidden: {choice: [4, 1048576]}\n");
    json("search roomy.yaml data.h5 --trials 6 --out roomy.csv", "done >0, failed >0");
    assert_says(result.err, "out of memory");
    cli_expect(lg,
               "train data.h5 --out m.h5 --method adam --modes 0 --layers 4 --hidden 12 --lr 1000 --epochs "
               "12 --json",
               4, "the mean curve");
    cli_expect(lg, "train data.h5 --out m.h5 --layers 14 --hidden 1048576", 5,
               "lg-elastica train: out of memory: the network has 1");
}

TEST("too few intervals for a nearly straight beam cause a warning; enough intervals do not") {
    static const struct {
        double chord;
        const char *more;
        bool told;
    } rows[] = {{0.9999, "", true},
                {0.999, "", true},
                {0.99, "", false},
                {0.5, "", false},
                {0.999, "--intervals 300", false},
                {0.9999, "--continuous", false}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char line[160];
        (void)snprintf(line, sizeof line,
                       "solve --length 1 --stiffness 1 --q0 0,0 --qN %g,0 --theta0 0 --thetaN 0 %s",
                       rows[i].chord, rows[i].more);
        cli_expect("lg-elastica", line, 0, "minimum");
        assert_int_equal(strstr(result.err, "too few for this shape") != NULL, rows[i].told);
    }
}

TEST_GROUP(setup, cli_end)

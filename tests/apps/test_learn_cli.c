/* lg-learn must do the same with a recipe as the recipe's own program.
 * ctest-labels: apps/lg-learn apps/common src/model src/table */
#include "cli_files.h"
#include "identify_support.h"
#include "liegrad/model.h"

OWNED(lg_model_file, lg_model_file_destroy)

static const char learn[] = "lg-learn";

/* Four seconds of the six sensors of a well. */
#define SENSOR "1,2,1,0,-1,-2,-1,0,1,2,3,2,1,0,-1,-2,-3,-2,-1,0"
#define WINDOW SENSOR "," SENSOR "," SENSOR "," SENSOR "," SENSOR "," SENSOR

/* Recipes with learned models: `generate` makes the data with the program (NULL: the data are a table),
 * `train` are options of a short training, `range` is a range of a search. */
static const struct learned {
    const char *recipe, *program, *generate, *train, *range;
    const char *initial;  /* --initial of a prediction */
    const char *command;  /* the program's command that trains */
    const char *training; /* files of training data */
} rows[] = {
    {"hamiltonian", "lg-hamiltonian", "generate " LG_TEST_DIR "/../scenes/pendulum.yaml --trajectories 20",
     "--method adam --hidden 6 --epochs 20", "hidden: {integer: [4, 8]}", "1,0,0,0,0.5,0", "train",
     "data.h5"},
    {"surrogate", "lg-elastica", "generate --case both-ends --count 30 --intervals 10",
     "--method lbfgs --hidden 6 --epochs 60", "hidden: {integer: [4, 8]}", "0,0,1,0,3,0,1,0", "train",
     "data.h5"},
    {"machine_model", "lg-identify", "generate scene.yaml --runs 2 --t-end 4",
     "--method ssbroyden --epochs 12", "window: {integer: [3, 9]}", "0.3,0", "fit", "machine.yaml data.h5"},
    {"table", "lg-fit", NULL, "--method ssbroyden --hidden 6 --epochs 60", "hidden: {integer: [4, 8]}",
     "1,0.5", "train", "data.h5"},
    {"detector", "lg-anomaly", "generate --runs 8 --hours 0.05 --noise 1 --window 4",
     "--optimizer adam --filters 4 --lr 0.01 --epochs 40", "kernel: {integer: [2, 5]}", WINDOW, "train",
     "data.h5"},
};

static const struct learned *row_of(const char *recipe) {
    size_t i = 0;
    while (strcmp(rows[i].recipe, recipe) != 0) i++;
    return &rows[i];
}

static lg_model_file *load(const char *name) {
    lg_model_file file;
    assert_ok(lg_model_load(NULL, cli_at(name), NULL, &file, NULL));
    return own_lg_model_file(file);
}

/* y = sin a + b^2 + error */
static void make_table(void) {
    const char *text = "a,b,y\n";
    for (int i = 0; i < 60; i++) {
        const double a = sin(3.0 * i), b = cos(5.0 * i);
        text = test_text("%s%.17g,%.17g,%.17g\n", text, a, b, sin(a) + b * b + 0.05 * sin(70.0 * i));
    }
    cli_write("data.h5", text);
}

static void make_data(const struct learned *row) {
    static const char *const made[] = {"data.h5", "theirs.h5",          "ours.h5", "whole.h5",
                                       "part.h5", "part.h5.checkpoint", "m.h5"};
    for (size_t i = 0; i < LG_COUNT(made); i++) cli_forget(made[i]); /* of another kind */
    if (row->generate == NULL)
        make_table();
    else
        cli_expect(row->program, test_text("%s --out data.h5", row->generate), 0, "");
}

TEST("lg-learn lists all recipes that also have their own program") {
    cli_expect(learn, "list --json", 0, "\"recipes\"");
    size_t found = 0;
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *words = test_text("{\"name\": \"%s\"", rows[i].recipe);
        assert_non_null(strstr(result.out, words));
    }
    for (const char *at = result.out; (at = strstr(at, "{\"name\": ")) != NULL; at++) found++;
    assert_true(found >= LG_COUNT(rows));
}

TEST("the last --recipe counts, and may be abbreviated") {
    make_data(row_of("table"));
    cli_json(learn, "train data.h5 --recipe hamiltonian --rec table --linear no --epochs 2 --out m.h5",
             "rmse *");
    cli_json(learn, "evaluate m.h5 data.h5", "recipe \"table\"");
    cli_expect(learn, "train data.h5 --recipe=table --recip=hamiltonian --linear no --epochs 2 --out m.h5", 2,
               "unrecognized option '--linear'");
}

TEST("train finds the same bits as the recipe's own program") {
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const struct learned *row = &rows[i];
        make_data(row);
        cli_expect(row->program,
                   test_text("%s %s %s --out theirs.h5", row->command, row->training, row->train), 0, "");
        cli_expect(learn,
                   test_text("train %s --recipe %s %s --out ours.h5", row->training, row->recipe, row->train),
                   0, "");
        lg_model_file *theirs = load("theirs.h5"), *ours = load("ours.h5");
        lg_slice_info slice;
        const double *a, *b;
        uint32_t slices = 0;
        for (; lg_model_file_slice(ours, slices, &slice, &b); slices++) {
            assert_true(lg_model_file_slice(theirs, slices, &slice, &a));
            assert_memory_equal(a, b, slice.count * sizeof *a);
        }
        assert_true(slices > 0);
    }
}

TEST("training that is stopped and resumed reaches the same loss") {
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const struct learned *row = &rows[i];
        make_data(row);
        const char *train = test_text("train %s --recipe %s", row->training, row->recipe);
        cli_expect(learn, test_text("%s %s --out whole.h5 --json", train, row->train), 0, "");
        const double loss = json_number(result.out, "running_loss");
        cli_expect(learn, test_text("%s %s --out part.h5 --stop-after 7", train, row->train), 0, "");
        cli_expect(learn, test_text("%s --resume part.h5.checkpoint --out part.h5 --json", train), 0, "");
        assert_true(json_number(result.out, "running_loss") == loss);
    }
}

TEST("evaluate, search and predict work from the file and the recipe alone") {
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const struct learned *row = &rows[i];
        make_data(row);
        cli_expect(learn,
                   test_text("train %s --recipe %s %s --out m.h5", row->training, row->recipe, row->train), 0,
                   "");
        cli_json(learn, "evaluate m.h5 data.h5", "recipe *, seconds *, warnings *");
        cli_json(learn, test_text("predict m.h5 --initial %s", row->initial), "value *");
        cli_write("ranges.yaml", test_text("fixed: {epochs: 4}\nranges:\n  %s\n", row->range));
        cli_json(
            learn,
            test_text("search ranges.yaml %s --recipe %s --trials 2 --out t.csv", row->training, row->recipe),
            "trials 2, done >0, best *");
        assert_int_equal(remove(cli_at("t.csv")), 0);
    }
}

TEST("a detector is judged on the same windows as by its program") {
    const struct learned *row = row_of("detector");
    make_data(row);
    cli_expect(learn, test_text("train data.h5 --recipe detector %s --out m.h5", row->train), 0, "");
    cli_json("lg-anomaly", "evaluate m.h5 data.h5", "part \"test\"");
    const double windows = json_number(result.out, "windows"), auc = json_number(result.out, "auc");
    cli_json(learn, "evaluate m.h5 data.h5", "recipe \"detector\"");
    assert_close(json_number(result.out, "windows"), windows, 0, 0);
    assert_close(json_number(result.out, "auc"), auc, 0, 0);
}

TEST("a machine is judged as by lg-identify: windows of its length, and runs of a second") {
    static const char *const errors[] = {"window_loss", "line", "velocity"};
    double theirs[LG_COUNT(errors)];
    make_data(row_of("machine_model"));
    cli_expect(learn, "train machine.yaml data.h5 --recipe machine_model --epochs 12 --window 7 --out m.h5",
               0, "");
    cli_expect("lg-identify", "evaluate m.h5 data.h5 --horizons 1 --json", 0, "");
    for (size_t i = 0; i < LG_COUNT(errors); i++)
        theirs[i] =
            json_number(i == 0 ? result.out : strchr(json_find(result.out, "horizons"), '{'), errors[i]);
    cli_expect(learn, "evaluate m.h5 data.h5 --json", 0, "");
    for (size_t i = 0; i < LG_COUNT(errors); i++)
        assert_close(json_number(result.out, errors[i]), theirs[i], 0, 0);
}

TEST("a prediction is the motion that the recipe's program finds, and its table has every point") {
    static const char start[] = "predict m.h5 --initial 1,0,0,0,0.5,0 --t-end 2 --points 11";
    double ours[6], theirs[6];
    const struct learned *row = row_of("hamiltonian");
    make_data(row);
    cli_expect(learn, test_text("train data.h5 --recipe hamiltonian %s --out m.h5", row->train), 0, "");
    cli_expect(learn, "evaluate m.h5 data.h5", 0, "without measured starts");
    cli_expect("lg-hamiltonian", "evaluate m.h5 data.h5", 0, "starts included");
    cli_expect("lg-hamiltonian", test_text("%s --json", start), 0, "");
    assert_int_equal(json_array(result.out, "y", theirs, 6), 6);
    cli_expect(learn, test_text("%s --out p.csv --json", start), 0, "");
    assert_int_equal(json_array(result.out, "y", ours, 6), 6);
    assert_memory_equal(ours, theirs, sizeof ours);
    double first = 0, last = 1;
    assert_int_equal(json_array(result.out, "value", &first, 1), 1);
    cli_json(learn,
             test_text("predict m.h5 --initial %.17g,%.17g,%.17g,%.17g,%.17g,%.17g", ours[0], ours[1],
                       ours[2], ours[3], ours[4], ours[5]),
             "value *");
    assert_int_equal(json_array(result.out, "value", &last, 1), 1);
    assert_close(first, last, 1e-8, 0);
    char table[4096];
    size_t lines = 0;
    (void)cli_read("p.csv", table, sizeof table);
    for (const char *at = table; (at = strchr(at, '\n')) != NULL; at++) lines++;
    assert_int_equal(lines, 12);
}

TEST("predict checks its inputs as the recipe's program does, and says what its numbers are") {
    make_data(row_of("table"));
    cli_expect("lg-fit", "train data.h5 --hidden 4 --epochs 9 --out m.h5", 0, "");
    cli_expect(learn, "predict m.h5 --initial 9,0.5", 0, "");
    assert_says(result.err, "outside of the training range");
    cli_json(learn, "predict m.h5 --initial 0.9,0.5", "value *, warnings []");
    cli_write("classes.csv", "a,k\n1,u\n2,u\n3,u\n4,v\n5,v\n6,v\n1.5,u\n2.5,u\n4.5,v\n5.5,v\n");
    cli_expect("lg-fit", "train classes.csv --class k --test classes.csv --out m.h5 --epochs 9", 0, "");
    cli_expect("lg-fit", "predict m.h5 classes.csv --out classes-p.csv", 0, "");
    double row[3], ours[2];
    char table[1024];
    (void)cli_read("classes-p.csv", table, sizeof table);
    assert_int_equal(sscanf(table, "%*[^\n] u,%lf,%lf", &row[0], &row[1]), 2);
    cli_expect(learn, "predict m.h5 --initial 1", 0, "logits");
    cli_json(learn, "predict m.h5 --initial 1", "value *");
    assert_int_equal(json_array(result.out, "probability", ours, 2), 2);
    for (int i = 0; i < 2; i++) assert_close(ours[i], row[i], 1e-12, 1e-12);
    make_data(row_of("surrogate"));
    cli_expect("lg-elastica", "train data.h5 --network angle --hidden 4 --epochs 9 --out m.h5", 0, "");
    cli_expect(learn, "predict m.h5 --initial 1,0,0,1,0,9,0,1,0", 2, "the ends are 9 apart");
    cli_expect(learn, "predict m.h5 --initial 4,0,0,1,0,3,0,1,0", 2, "s = 4 is outside the beam [0, 3.3]");
    cli_expect(learn, "predict m.h5 --initial 1,0,0,0,1,1,0,0,1", 0, "");
    assert_says(result.err, "outside the training range");
    make_data(row_of("machine_model"));
    cli_expect("lg-identify", "fit machine.yaml data.h5 --epochs 9 --out m.h5", 0, "");
    cli_json(learn, "predict m.h5 --initial 0.3,2", "value *, velocities [");
    cli_expect(learn, "predict m.h5 --initial 0.3,2", 0, "of the start, which has momenta; no input acts");
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("scene.yaml", oscillator_scene);
    cli_write("machine.yaml", oscillator_network);
    return 0;
}

TEST_GROUP(setup, cli_end)

/* lg-hamiltonian train and study with a first integral in a program file.
 * ctest-labels: apps/lg-hamiltonian src/hamiltonian */
#include "cli_files.h"
#include "support/fixtures.h"

#include "liegrad/ops.h"
#include "liegrad/program.h"

static const char lg[] = "lg-hamiltonian";

static const char scene[] = "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\n";
static const char grid[] =
    "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\nintegrators: [cf4]\nN: [12]\nM: [4]\n"
    "eps: [0]\nrepeats: 1\nt_end: 0.5\nepochs: 3\nbatch: 8\nhidden: [6]\npenalty: [0, 1]\n"
    "penalty_integral: G.h5\ntest: { trajectories: 4, points: 5 }\nseed: 3\n";

/* ---- programs ---- */

static lg_var vertical(lg_tape *t, lg_var x) {
    return lg_slice(t, lg_cross(t, lg_slice(t, x, 1, 0, 3), lg_slice(t, x, 1, 3, 3)), 1, 2, 1);
}

static lg_var thousandfold(lg_tape *t, lg_var x) {
    return lg_scale(t, vertical(t, x), 1000.0);
}

/* One number per row, without an axis of its own. */
static lg_var rank_0(lg_tape *t, lg_var x) {
    return lg_reshape(t, vertical(t, x), lg_shape1(lg_var_shape(t, x).dims[0]));
}

static lg_var height(lg_tape *t, lg_var x) {
    return lg_slice(t, x, 1, 2, 1);
}

static lg_var constant(lg_tape *t, lg_var x) {
    return lg_scale(t, height(t, x), 0.0);
}

static lg_var infinite(lg_tape *t, lg_var x) {
    return lg_log(t, height(t, x));
}

static lg_var two_numbers(lg_tape *t, lg_var x) {
    return lg_slice(t, x, 1, 0, 2);
}

static lg_var for_all_rows(lg_tape *t, lg_var x) {
    return lg_mean(t, x);
}

typedef enum port_kind { VECTOR, MATRIX, SHARED } port_kind;
typedef struct program_row {
    lg_var (*record)(lg_tape *t, lg_var x);
    const char *name; /* of the function */
    uint32_t d;
    size_t inputs, outputs;
    port_kind kind;
    double factor; /* a parameter of the program; 0: it has none */
} program_row;

static const program_row good = {vertical, "integral", 6, 1, 1, VECTOR, 0.0};

static lg_status record(void *user, lg_tape *t, const lg_var *theta, const lg_var *x, lg_var *y) {
    const program_row *row = user;
    const lg_var sum = row->inputs > 1 ? lg_add(t, x[0], x[1]) : x[0];
    const lg_var rows = lg_reshape(t, sum, lg_shape2(lg_var_shape(t, sum).dims[0], row->d));
    y[0] = row->record(t, rows);
    if (row->factor != 0.0) y[0] = lg_mul(t, y[0], theta[0]);
    if (row->outputs > 1) y[1] = lg_neg(t, y[0]);
    return lg_tape_status(t);
}

RELEASES(release_program, lg_program_destroy)

static lg_program *build(const program_row *row) {
    program_row copy = *row;
    const lg_shape shapes[] = {
        [VECTOR] = lg_shape1(row->d), [MATRIX] = lg_shape2(row->d / 2, 2), [SHARED] = lg_shape2(1, row->d)};
    const lg_port in[2] = {{.name = "x", .shape = shapes[row->kind], .shared = row->kind == SHARED},
                           {.name = "u", .shape = lg_shape1(row->d)}},
                  out[2] = {{.name = "G"}, {.name = "minus"}};
    const lg_function_spec function = {row->name, in, row->inputs, out, row->outputs, record, &copy};
    const lg_parameter_spec factor = {"factor", lg_shape1(1), &row->factor};
    lg_program_spec spec;
    lg_program *program;
    lg_program_spec_init(&spec);
    spec.functions = &function;
    spec.function_count = 1;
    spec.parameters = &factor;
    spec.parameter_count = row->factor != 0.0;
    assert_told(lg_program_build(NULL, &spec, &program, &told));
    lg_test_owns(program, release_program);
    return program;
}

static void save(const program_row *row, const char *name) {
    assert_told(lg_program_save(NULL, cli_at(name), build(row), NULL, &told));
}

static void save_of(lg_var (*of)(lg_tape *t, lg_var x), const char *name) {
    program_row row = good;
    row.record = of;
    save(&row, name);
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("scene.yaml", scene);
    cli_write("grid.yaml", grid);
    cli_json(lg, "generate scene.yaml --trajectories 30 --points 5 --t-end 1 --out train.h5",
             "trajectories 30");
    save(&good, "G.h5");
    return 0;
}

/* Runs a command of the shell in the test's folder. */
static void shell(const char *command) {
    if (system(test_text("cd %s && %s", cli_folder, command)) != 0) fail_msg("%s", command);
}

/* ---- the library ---- */

/* dG/dq = (p_2, -p_1, 0) and dG/dp = (-q_2, q_1, 0) */
TEST("the unit of a measured first integral is the root mean square of its slope in scaled numbers") {
    const lg_trajectories *data = cli_trajectories("train.h5");
    lg_hamiltonian model;
    lg_first_integral integral;
    assert_ok(lg_hamiltonian_init(&model, data->family, data->n, LG_POTENTIAL_LINEAR, NULL, 0, LG_TANH));
    lg_hamiltonian_problem problem = {.model = &model,
                                      .scheme = lg_scheme_find("cf4"),
                                      .substeps = 1,
                                      .penalty = 1,
                                      .penalty_integral = &integral,
                                      .trajectories = data->count,
                                      .points = data->points,
                                      .dt = data->dt,
                                      .data = data->data};
    const double s = 3.0, factor[2] = {1.0, 1000.0};
    model.scales.part[1] = s;
    double sum = 0;
    for (size_t i = 0; i < data->count * data->points; i++) {
        const double *q = data->data + 6 * i, *p = q + 3;
        sum += p[0] * p[0] + p[1] * p[1] + s * s * (q[0] * q[0] + q[1] * q[1]);
    }
    for (int k = 0; k < 2; k++) {
        program_row row = good;
        row.record = k == 0 ? vertical : thousandfold;
        double unit = 0;
        assert_ok(lg_first_integral_from(build(&row), &model, "G", &integral, NULL));
        assert_ok(lg_hamiltonian_integral_unit(NULL, &problem, &unit, NULL));
        assert_close(unit, factor[k] * sqrt(sum / (double)(data->count * data->points)), 1e-13, 0);
    }
    problem.penalty_integral = lg_first_integral_find("vertical-angular-momentum");
    double unit = 0;
    assert_ok(lg_hamiltonian_integral_unit(NULL, &problem, &unit, NULL));
    assert_close(unit, s, 0, 0);
}

/* ---- training ---- */

#define TRAIN "train train.h5 --hidden 6 --epochs 20 --out m.h5 --penalty 1 "

TEST("a first integral in a file trains as the row of the table with the same formula") {
    cli_json(lg, TRAIN "--units given --penalty-integral vertical-angular-momentum", "");
    const double named = json_number(result.out, "loss");
    cli_json(lg, TRAIN "--units given --penalty-integral G.h5",
             "penalty_integral \"G.h5\", method \"ssbroyden\"");
    assert_close(json_number(result.out, "loss"), named, 1e-9, 0);
    cli_json(lg, TRAIN "--units given --penalty 0", "");
    assert_true(fabs(json_number(result.out, "loss") / named - 1) > 1e-3);
    save_of(rank_0, "rank.h5");
    cli_json(lg, TRAIN "--units given --penalty-integral ./rank.h5", "");
    assert_close(json_number(result.out, "loss"), named, 1e-9, 0);
    cli_expect(lg, TRAIN "--penalty-integral rank.h5 --checkpoint ./rank.h5", 3, "rank.h5: exists");
    cli_expect(lg, TRAIN "--penalty-integral rank.h5 --stop-after 1", 0, "");
    cli_expect(lg, "train train.h5 --resume m.h5.checkpoint --out rank.h5", 3, "rank.h5: exists");
    cli_json(lg, TRAIN "--units given --penalty-integral G.h5 --dtype f32", "loss >0");
}

TEST("a parameter of the program is part of the first integral, and of what a run is resumed with") {
    char hash[LG_SHA256_TEXT] = "";
    double loss = 0;
    for (int k = 0; k < 2; k++) {
        program_row row = good;
        row.factor = k == 0 ? 1.0 : -1.0;
        save(&row, "factor.h5");
        cli_json(lg, TRAIN "--units data --penalty-form published --penalty-integral factor.h5", "");
        if (k == 1) assert_close(json_number(result.out, "loss"), loss, 1e-6, 0);
        loss = json_number(result.out, "loss");
        const char *found = cli_hamiltonian("m.h5")->run.penalty_sha256;
        assert_string_not_equal(found, hash);
        memcpy(hash, found, sizeof hash);
    }
}

TEST("with scales of the data the result does not depend on the unit of the first integral") {
    save_of(thousandfold, "large.h5");
    cli_json(lg, TRAIN "--units data --penalty-integral G.h5", "");
    const double loss = json_number(result.out, "loss");
    cli_json(lg, TRAIN "--units data --penalty-integral large.h5", "");
    assert_close(json_number(result.out, "loss"), loss, 1e-6, 0);
    cli_json(lg, TRAIN "--units data --penalty 0", "");
    assert_true(fabs(json_number(result.out, "loss") / loss - 1) > 1e-3);
}

TEST("a file with a function that the data do not conserve causes a warning") {
    save_of(height, "height.h5");
    cli_expect(lg, TRAIN "--penalty-integral height.h5", 0, "");
    assert_says(result.err, "do not conserve height.h5");
    cli_expect(lg, TRAIN "--penalty-integral G.h5", 0, "");
    assert_null(strstr(result.err, "conserve"));
}

TEST("the model is evaluated without the file") {
    save(&good, "away.h5");
    cli_expect(lg, TRAIN "--penalty-integral away.h5", 0, "");
    cli_unlink("away.h5");
    cli_json(lg, "evaluate m.h5 train.h5", "E1 >0");
    cli_json(lg, "predict m.h5 --initial 1,0,0,0,0.5,0 --t-end 0.5", "");
}

TEST("a file without a fitting function is refused by a sentence") {
    static const struct {
        program_row row;
        const char *says;
    } wrong[] = {
        {{vertical, "value", 6, 1, 1, VECTOR, 0},
         "bad.h5: the program has no function 'integral'; it has value"},
        {{vertical, "integral", 12, 1, 1, VECTOR, 0},
         "takes 12 numbers, but a state of the data has 6 numbers"},
        {{vertical, "integral", 6, 1, 1, MATRIX, 0},
         "takes 6 numbers, but a state of the data has 6 numbers, as"},
        {{vertical, "integral", 6, 1, 1, SHARED, 0}, "takes 6 numbers that all rows share"},
        {{vertical, "integral", 6, 2, 1, VECTOR, 0}, "function integral has 2 inputs and 1 outputs"},
        {{vertical, "integral", 6, 1, 2, VECTOR, 0}, "function integral has 1 inputs and 2 outputs"},
        {{two_numbers, "integral", 6, 1, 1, VECTOR, 0}, "gives 2 numbers; it must give one for each state"},
        {{for_all_rows, "integral", 6, 1, 1, VECTOR, 0}, "gives 1 numbers for all states together"},
        {{constant, "integral", 6, 1, 1, VECTOR, 0},
         "bad.h5: the function integral has the slope 0 at all points"},
        {{infinite, "integral", 6, 1, 1, VECTOR, 0},
         "bad.h5: the function integral or its derivative is not finite at some points"}};
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        save(&wrong[i].row, "bad.h5");
        cli_expect(lg, TRAIN "--penalty-integral bad.h5", 3, "");
        assert_says(result.err, wrong[i].says);
    }
    cli_expect(lg, TRAIN "--penalty-integral none.h5", 3, "");
    assert_says(result.err, "none.h5: No such file");
    cli_expect(lg, TRAIN "--penalty-integral train.h5", 3, "");
    assert_says(result.err, "expected 'program'");
    cli_expect(lg, TRAIN "--penalty-integral momentum", 2, "");
    assert_says(result.err, "'momentum' is not a first integral; take oscillator, ");
    cli_expect(lg, "train train.h5 --out m.h5 --penalty-integral G.h5", 2, "");
    assert_says(result.err, "--penalty-integral: needs --penalty MU");
    char path[400] = "./";
    while (strlen(path) < 256) (void)strcat(path, "x");
    cli_expect(lg, test_text(TRAIN "--penalty-integral %s", path), 2, "");
    assert_says(result.err, "a path of 256 bytes is too long");
}

TEST("a run is resumed with the same function only, wherever the file is") {
    cli_expect(lg, TRAIN "--penalty-integral G.h5", 0, "");
    cli_link("m.h5", "whole.h5");
    const lg_hamiltonian_file *whole = cli_hamiltonian("m.h5");
    assert_int_equal(strlen(whole->run.penalty_sha256), 64);
    save(&good, "first.h5");
    cli_json(lg,
             "train train.h5 --hidden 6 --epochs 20 --out r.h5 --penalty 1 --penalty-integral first.h5 "
             "--stop-after 5 --checkpoint c.h5",
             "");
    shell("mv first.h5 moved.h5");
    cli_expect(lg, "train train.h5 --resume c.h5 --out r.h5", 3, "");
    assert_says(result.err, "first.h5: No such file");
    cli_expect(lg, "train train.h5 --resume c.h5 --out r.h5 --penalty-integral moved.h5", 0, "");
    const lg_hamiltonian_file *resumed = cli_hamiltonian("r.h5");
    assert_memory_equal(resumed->theta, whole->theta, whole->parameters * sizeof(double));
    assert_string_equal(resumed->run.penalty_integral, "first.h5");
    save_of(height, "first.h5");
    cli_expect(lg, "train train.h5 --resume c.h5 --out r.h5", 2, "");
    assert_says(result.err, "was written with penalty_sha256");
}

TEST("a study finds the file from the grid's folder, and continues only with the same function") {
    shell("mkdir -p folder && mv grid.yaml folder && cp G.h5 folder/G.h5 && rm G.h5");
    cli_json(lg, "study folder/grid.yaml --out s.csv --jobs 1 --stop-after 1", "done 1");
    shell("mv folder other");
    cli_json(lg, "study other/grid.yaml --out s.csv --jobs 1", "done 2, new 1");
    shell("cut -d, -f10 s.csv | sort -u | wc -l | grep -q '^ *3$'"); /* the loss of both rows, and the head */
    save_of(height, "other/G.h5");
    cli_expect(lg, "study other/grid.yaml --out s.csv", 3, "other settings");
    shell("rm -r other");
    save(&good, "G.h5");
}

TEST_GROUP(setup, cli_end)

/* lg-hamiltonian with constraints of a user: a program file becomes data, data a model, and each file carries
 * the constraint. What is no constraint, or data that are not on it, are refused.
 * ctest-labels: apps/lg-hamiltonian src/hamiltonian */
#include "support/constraints.h"
#include "support/models.h"
#include "cli_files.h"

#include "hamiltonian/internal.h"

static const char lg[] = "lg-hamiltonian";

/* |q|^2 - 4, which the knot's points do not satisfy. */
static lg_status far_ball(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_add_scalar(tape, lg_rownorm2(tape, q[0]), -4.0);
    return lg_tape_status(tape);
}

/* The first row of the knot twice. */
static lg_status doubled(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const lg_status status = knot(user, tape, theta, q, g);
    const lg_var first = lg_slice(tape, *g, 1, 0, 1);
    *g = lg_concat(tape, (lg_var[]){first, lg_scale(tape, first, 3.0)}, 2, 1);
    return status == LG_OK ? lg_tape_status(tape) : status;
}

/* The knot with other units of g. */
static lg_status tripled(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    const lg_status status = knot(user, tape, theta, q, g);
    *g = lg_scale(tape, *g, 3.0);
    return status == LG_OK ? lg_tape_status(tape) : status;
}

/* log(2.6 - x^2) */
static lg_status no_number(void *user, lg_tape *tape, const lg_var *theta, const lg_var *q, lg_var *g) {
    (void)user, (void)theta;
    *g = lg_log(tape, lg_add_scalar(tape, lg_neg(tape, lg_square(tape, lg_slice(tape, q[0], 1, 0, 1))), 2.6));
    return lg_tape_status(tape);
}

static void save(const char *name, const constraint_case *of) {
    lg_program *program;
    assert_told(constraint_program_of(of, &plain_units, &program, &told));
    assert_ok(lg_program_save(NULL, cli_at(name), program, NULL, NULL));
    lg_program_destroy(program);
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    save("knot.h5", &constraint_cases[1]);
    save("bars.h5", &constraint_cases[2]);
    save("still.h5", &(constraint_case){"still", knot, NULL, NULL, 3, 2});
    save("far.h5", &(constraint_case){"far", far_ball, hill, NULL, 3, 1});
    save("tripled.h5", &(constraint_case){"tripled", tripled, hill, NULL, 3, 2});
    save("double.h5", &(constraint_case){"double", doubled, hill, NULL, 3, 2});
    save("log.h5", &(constraint_case){"log", no_number, hill, NULL, 3, 1});
    cli_run(lg, "generate knot.h5 --trajectories 40 --seed 3 --out data.h5");
    cli_run(lg, "generate knot.h5 --trajectories 5 --points 4 --t-end 0.5 --seed 4 --out test.h5");
    return 0;
}

/* Writes data.h5 again without its functions. */
static void write_plain(const char *name, double shift) {
    lg_trajectories *data = cli_trajectories("data.h5");
    lg_constraint_destroy(data->constraint);
    data->constraint = NULL;
    for (size_t i = 0; i < data->count * data->points * data->state_dim; i += data->state_dim)
        data->data[i] += shift;
    assert_ok(lg_trajectories_write(NULL, cli_at(name), data, NULL));
}

TEST("generated data lie on T*Q and carry the constraint") {
    const lg_trajectories *data = cli_trajectories("data.h5");
    assert_ptr_equal(data->family, &lg_hamiltonian_constrained);
    assert_true(data->n == 3 && data->count == 40 && data->points == 5 && data->state_dim == 6);
    assert_int_equal(lg_constraint_equations(data->constraint), 2);
    assert_true(data->starts_off < 1e-13);
    for (size_t i = 0; i < data->count; i++) {
        double H;
        assert_ok(lg_constraint_energy(data->constraint, data->data + i * 30 + 24, &H, NULL));
        assert_close(H, data->hamiltonian[i], 1e-11, 1e-11);
    }
}

TEST("data without functions need --constraint, and then give the same model") {
    write_plain("plain.h5", 0.0);
    assert_ptr_equal(cli_trajectories("plain.h5")->family, &lg_hamiltonian_separable);
    cli_run(lg, "train data.h5 --epochs 20 --hidden 5 --out one.h5");
    cli_run(lg, "train plain.h5 --constraint knot.h5 --epochs 20 --hidden 5 --out two.h5");
    const lg_hamiltonian_file *one = cli_hamiltonian("one.h5"), *two = cli_hamiltonian("two.h5");
    assert_string_equal(one->run.data_sha256, two->run.data_sha256);
    assert_memory_equal(one->theta, two->theta, one->parameters * sizeof *one->theta);
    assert_ptr_equal(one->run.model.constraint, one->constraint);
    assert_int_equal(lg_constraint_equations(one->constraint), 2);
}

TEST("a model is evaluated and predicts on the constraint, without a further file") {
    cli_run(lg, "train data.h5 --epochs 60 --hidden 6 --out model.h5");
    cli_run(lg, "evaluate model.h5 test.h5 --record --json");
    const double e1 = json_number(result.out, "E1"), e2 = json_number(result.out, "E2");
    assert_true(e1 < 1e-2 && e1 > 1e-16 && e2 < 1.0);
    write_plain("bare.h5", 0.0);
    cli_run(lg, "evaluate model.h5 bare.h5 --json");
    cli_run("lg-learn", "evaluate model.h5 test.h5 --json");
    const double loss = json_number(result.out, "loss");
    assert_true(loss < json_number(result.out, "unchanged"));
    cli_run(lg, "predict model.h5 --initial 1,0,0.4,0,0,0 --t-end 2 --points 9 --out motion.h5");
    const lg_trajectories *motion = cli_trajectories("motion.h5");
    for (size_t j = 0; j < 9; j++) {
        lg_constraint_view view;
        assert_ok(lg_constraint_look(motion->constraint, 0, motion->data + 6 * j, &view, NULL));
        assert_true(view.residual < 2e-15 && view.across < 1e-12);
    }
    lg_program *program;
    lg_constraint *learned;
    double *out = TEST_ARRAY(double, 1001 * 6);
    assert_ok(lg_program_load(NULL, cli_at("model.h5"), NULL, &program, NULL));
    assert_told(lg_constraint_create(NULL, program, &learned, &told));
    lg_program_destroy(program);
    own_constraint(learned);
    assert_told(lg_constraint_rattle(learned, 4, 0.002, 1000, 1000, motion->data, out, &told));
    for (size_t j = 0; j < 6; j++) assert_close(out[6 + j], motion->data[48 + j], 1e-6, 1e-6);
}

TEST("a training with a constraint is resumed to the same bits, and not with another constraint") {
    cli_run(lg, "train data.h5 --epochs 30 --hidden 5 --out whole.h5");
    cli_run(lg,
            "train data.h5 --epochs 30 --hidden 5 --out part.h5 --checkpoint part.cp --checkpoint-every 20");
    write_plain("again.h5", 0.0);
    cli_expect(lg, "train again.h5 --constraint bars.h5 --resume part.cp --out part.h5", 3, "4 numbers");
    cli_expect(lg, "train again.h5 --constraint tripled.h5 --resume part.cp --out part.h5", 2, "other data");
    cli_run(lg, "train again.h5 --constraint knot.h5 --resume part.cp --out part.h5");
    const lg_hamiltonian_file *a = cli_hamiltonian("whole.h5"), *b = cli_hamiltonian("part.h5");
    assert_memory_equal(a->theta, b->theta, a->parameters * sizeof *a->theta);
}

TEST("constraints that do not fit the data are refused with the point and the number") {
    write_plain("moved.h5", 1e-3);
    write_plain("exact.h5", 0.0);
    cli_expect(lg, "train moved.h5 --constraint knot.h5 --out none.h5", 3,
               "the first point of trajectory 0 is off the constraint");
    cli_expect(lg, "train exact.h5 --constraint far.h5 --out none.h5", 3, "largest |g_i| = ");
    cli_expect(lg, "train exact.h5 --constraint double.h5 --out none.h5", 3, "loses rank at q = (");
    write_plain("away.h5", 5.0);
    cli_expect(lg, "train away.h5 --constraint log.h5 --out none.h5", 3, "not finite at q = (");
    cli_expect(lg, "train exact.h5 --constraint bars.h5 --out none.h5", 3, "takes q of 4 numbers");
    cli_expect(lg, "train exact.h5 --constraint one.h5.none --out none.h5", 3, "one.h5.none");
    cli_expect(lg, "train data.h5 --starts estimated --epochs 5 --out none.h5", 2, "leave the constraint");
    cli_expect(lg, "train data.h5 --penalty 1 --epochs 5 --out none.h5", 2,
               "does not fit family constrained");
    cli_run(lg, "train moved.h5 --constraint knot.h5 --starts measured --epochs 5 --hidden 5 --out near.h5");
    cli_expect(lg, "generate still.h5 --out none.h5", 3, "no function potential");
    cli_expect(lg, "generate data.h5 --segments 3 --out none.h5", 2, "--segments");
    cli_expect(lg, "generate double.h5 --out none.h5", 3, "no start with g(q) = 0");
    assert_says(result.err, "loses rank at q = (");
    cli_expect(lg, "predict near.h5 --initial 1,0,0.5,0,0,0", 2, "off the constraint");
    lg_trajectories *hit = cli_trajectories("data.h5"); /* a later point on the axis, where G is not finite */
    memset(hit->data + (2 * hit->points + 3) * hit->state_dim, 0, 3 * sizeof *hit->data);
    assert_ok(lg_trajectories_write(NULL, cli_at("axis.h5"), hit, NULL));
    cli_expect(lg, "train axis.h5 --out none.h5", 3,
               "point 4 of trajectory 2: the constraint or its Jacobian");
    assert_false(cli_exists("none.h5"));
}

TEST_GROUP(setup, cli_end)

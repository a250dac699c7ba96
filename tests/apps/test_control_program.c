/* lg-control certify of a plant that is a program: polynomials and other V, and refusals.
 * ctest-labels: apps/lg-control src/control */
#include "autodiff/program_support.h"
#include "cli_support.h"

#include "liegrad/ops.h"
#include "liegrad/policy.h"

static const char control[] = "lg-control";

static lg_var column(lg_tape *tape, lg_var x, uint32_t i) {
    return lg_slice(tape, x, 1, i, 1);
}

/* Van der Pol: x1' = x2, x2' = -x1 + (1 - x1^2) x2 + u */
RECORDING(field) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var damped = lg_sub(tape, b, lg_mul(tape, lg_square(tape, a), b));
    const lg_var parts[2] = {b, lg_add(tape, lg_sub(tape, damped, a), x[1])};
    y[0] = lg_concat(tape, parts, 2, 1);
}

/* Lienard's coordinates: x1, x2 - x1 + x1^3/3 */
RECORDING(coordinates) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var cube = lg_scale(tape, lg_mul(tape, a, lg_square(tape, a)), 1.0 / 3.0);
    const lg_var parts[2] = {a, lg_add(tape, lg_sub(tape, b, a), cube)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

/* The same plant in Lienard's coordinates: x1' = x2 + x1 - x1^3/3, x2' = u - x1 */
RECORDING(turned) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var cube = lg_scale(tape, lg_mul(tape, a, lg_square(tape, a)), 1.0 / 3.0);
    const lg_var parts[2] = {lg_sub(tape, lg_add(tape, b, a), cube), lg_sub(tape, x[1], a)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

/* x1' = x2, x2' = -x1 - x2 + u */
RECORDING(damped) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var parts[2] = {b, lg_sub(tape, lg_sub(tape, x[1], a), b)};
    y[0] = lg_concat(tape, parts, 2, 1);
}

/* V = (1.5 x1^2 + x1 x2 + x2^2)(1 - .999 exp(-40 |x - (.4, .4)|^2)) */
RECORDING(with_a_hole) {
    const lg_var a = column(tape, x[0], 0), b = column(tape, x[0], 1);
    const lg_var form = lg_add(
        tape, lg_add(tape, lg_scale(tape, lg_square(tape, a), 1.5), lg_square(tape, b)), lg_mul(tape, a, b));
    const lg_var d = lg_add_scalar(tape, x[0], -0.4);
    const lg_var dip = lg_exp(tape, lg_scale(tape, lg_rownorm2(tape, d), -40));
    y[0] = lg_mul(tape, form, lg_add_scalar(tape, lg_scale(tape, dip, -0.999), 1));
}

/* x' = -grad V + 1e-9 u: this V falls everywhere, even into the hole. */
RECORDING(down_hill) {
    lg_var v, slope;
    (void)with_a_hole(NULL, tape, theta, x, &v);
    (void)lg_grad(tape, lg_sum(tape, v), x, 1, &slope);
    y[0] = lg_sub(tape, lg_scale(tape, x[1], 1e-9), slope);
}

static void write_plant(const char *name, lg_record_function rate, const char *second,
                        lg_record_function more) {
    const lg_port in[2] = {{.name = "x", .shape = lg_shape1(2)}, {.name = "u", .shape = lg_shape1(1)}},
                  out = {.name = "y"};
    const lg_function_spec functions[2] = {{"field", in, 2, &out, 1, rate, NULL},
                                           {second, in, 1, &out, 1, more, NULL}};
    const lg_program_spec spec = spec_of(NULL, 0, functions, more != NULL ? 2 : 1);
    assert_ok(lg_program_save(NULL, cli_at(test_text("%s.h5", name)), test_program(&spec), NULL, NULL));
}

static const char *task_of(const char *plant, const char *gains) {
    return test_text(
        "plant: %s.h5\nperiod: 0.01\nhorizon: 5\nstarts: {x1: [-1, 1], x2: [-1, 1]}\nlimits: {u: "
        "1}\ncost: {x1: 1, x2: 1, u: 1}\nsuccess: {x1: 0.05, hold: 1, within: 10}\ncontroller: "
        "{kind: lqr, gains: [%s]}\n",
        plant, gains);
}

static void write_task(const char *name, const char *plant, const char *gains) {
    cli_write(test_text("%s.yaml", name), task_of(plant, gains));
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    write_plant("pol", field, "coordinates", coordinates);
    write_plant("plain", field, "", NULL);
    write_plant("lienard", turned, "", NULL);
    write_plant("hole", damped, "lyapunov", with_a_hole);
    write_plant("hill", down_hill, "lyapunov", with_a_hole);
    write_task("pol3", "pol", "0, 3");
    write_task("lienard3", "lienard", "3, 3");
    write_task("plain3", "plain", "0, 3");
    write_task("wrong", "plain", "0, -3");
    write_task("weak", "plain", "0, 0.6");
    write_task("holed", "hole", "0, 0");
    cli_write("away.yaml", test_text("%sgoal: {x1: 0.5}\n", task_of("hole", "1, 1")));
    write_task("rolling", "hill", "0, 0");
    return 0;
}

TEST("a policy of a plant that is a program is judged on another program, by the names of its task") {
    cli_write(
        "named.yaml",
        "plant: plain.h5\nstates: [p, {name: a, kind: angle}]\nperiod: 0.01\nhorizon: 5\nstarts: {p: [-1, "
        "1], a: [-1, 1]}\nlimits: {u: 1}\ncost: {p: 1, a: 1, u: 1}\nsuccess: {p: 0.05, hold: 1, within: "
        "10}\ncontroller: {kind: lqr, gains: [0, 3]}\n");
    cli_expect(control, "train named.yaml --out named.h5", 0, "");
    cli_expect(control, "evaluate named.h5 --starts 64 --json", 0, "");
    const double cost = json_number(result.out, "cost_mean");
    cli_expect(control, "evaluate named.h5 --plant plain.h5 --starts 64 --json", 0, "");
    assert_close(json_number(result.out, "cost_mean"), cost, 1e-3, 0);
    cli_expect(control, "evaluate named.h5 --plant lienard.h5 --starts 64 --json", 0, "");
    assert_true(fabs(json_number(result.out, "cost_mean") - cost) > 1e-2 * cost);
    cli_expect("lg-export", "named.h5 --out exported", 0, "");
}

static double volume_of(const char *line) {
    cli_expect(control, line, 0, "");
    assert_says(result.out, "\"verified\": true");
    print_message("%s: %g in %g s\n", line, json_number(result.out, "volume"),
                  json_number(result.out, "seconds"));
    return json_number(result.out, "volume");
}

TEST("Van der Pol: polynomials of Lienard's coordinates prove at least 50 within 4.8, 10.8") {
    assert_true(
        volume_of("certify pol3.yaml --continuous --lyapunov polynomial --box x1=4.8,x2=10.8 --json") >= 50);
    assert_says(result.out, "in the box [-3.888, 3.888]"); /* none falls in all of the box: .81 of it */
}

TEST("Van der Pol in Lienard's coordinates: a polynomial proves at least 150 within 8, 20") {
    assert_true(
        volume_of("certify lienard3.yaml --continuous --lyapunov polynomial --box x1=8,x2=20 --json") >= 150);
}

/* The box that failed, and what was said. */
static void expect_refused(const char *line, const char *reason, double side[2][2]) {
    cli_expect(control, line, 1, "not proved");
    assert_says(result.out, "\"verified\": false");
    assert_says(result.out, reason);
    const char *failed = json_find(result.out, "failed");
    assert_non_null(failed);
    assert_int_equal(json_array(failed, "x1", side[0], 2), 2);
    assert_int_equal(json_array(failed, "x2", side[1], 2), 2);
    for (int i = 0; i < 2; i++) assert_true(side[i][0] <= side[i][1]);
}

/* V' = 2 x2 (1 - x1^2 + k) x2 and more with u = -k x2: it rises along x1 = 0 if k < 1. */
TEST("a wrong sign and a gain that is a fifth are refused with states where V rises") {
    double side[2][2];
    expect_refused("certify wrong.yaml --box x1=1,x2=1 --json", "V rises in a step", side);
    assert_true(fabs(side[0][0]) <= 1 && fabs(side[1][0]) <= 1);
    assert_says(result.err, "no quadratic V falls near the goal");
    expect_refused("certify weak.yaml --box x1=1,x2=1 --json", "V rises in a step", side);
    assert_true(fabs(side[0][0]) <= 1 && fabs(side[1][0]) <= 1);
}

TEST("a quadratic V is searched for given gains, and a level above the proposal's is refused") {
    assert_true(volume_of("certify plain3.yaml --box x1=4.8,x2=10.8 --json") > 1.5);
    assert_true(json_find(result.out, "gains") == NULL);
    double side[2][2];
    expect_refused("certify plain3.yaml --box x1=4.8,x2=10.8 --level 2 --json", "V rises in a step", side);
}

TEST("a goal away from 0, which a constant input holds, is certified with continuous and held inputs") {
    assert_true(volume_of("certify away.yaml --box x1=1,x2=1 --continuous --json") > 1);
    assert_true(volume_of("certify away.yaml --box x1=1,x2=1 --json") > 1);
    cli_expect(control, "certify away.yaml --continuous --lyapunov function --box x1=1,x2=1", 2,
               "its goal must be 0");
}

TEST("the plant's own V: a hole in it, and a part of {V < eps} elsewhere, are refused where they are") {
    double side[2][2];
    expect_refused("certify holed.yaml --continuous --lyapunov function --box x1=1,x2=1 --level 0.7 --json",
                   "V ", side);
    assert_true(fabs(side[0][0] - 0.4) < 0.4 && fabs(side[1][0] - 0.4) < 0.4);
    expect_refused(
        "certify rolling.yaml --continuous --lyapunov function --box x1=1,x2=1 --level 0.05 --json",
        "V is below eps away from the goal", side);
    assert_true(fabs(side[0][0] - 0.4) < 0.2 && fabs(side[1][0] - 0.4) < 0.2);
    cli_expect(control, "certify plain3.yaml --continuous --lyapunov function --box x1=1,x2=1", 2,
               "no program with a function lyapunov");
}

TEST_GROUP(setup, cli_end)

/* lg-control with a coordinate whose position does not matter: tables, plots, proofs and what is refused.
 * ctest-labels: apps/lg-control src/control */
#include "cli_support.h"

static const char control[] = "lg-control";
#define TASK                                                                                                 \
    "plant: wheel.yaml\nperiod: 0.04\nhorizon: 5\nstarts: {th: [-0.3, 0.3], vph: [-9, 9]}\nlimits: {u: "     \
    "0.12}\ncost: {th: "                                                                                     \
    "1, vth: 0.05, vph: 0.0001}\nsuccess: {th: 0.05, vth: 0.3, vph: 3, hold: 1, within: 6}\ncontroller: "    \
    "{kind: lqr}\n"

/* A pendulum with a reaction wheel, whose angle comes first. */
static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write(
        "wheel.yaml",
        "columns: {time: t}\ncoordinates: [{name: ph, kind: angle, velocity: vph}, {name: th, kind: angle, "
        "velocity: vth}]\ninputs: {columns: [u]}\nmass: {kind: known, values: [[0.0015, 0.0015], [0.0015, "
        "0.0135]]}\npotential: {kind: known, form: linear, of: th, values: [0, 0.35]}\ndamping: {kind: "
        "known, values: [0.0002, 0.0005]}\ninput_map: {kind: known, values: [[1], [0]]}\n");
    cli_write("task.yaml", TASK "free: [ph]\n");
    return 0;
}

TEST("tables have the free position, plots have what is not free") {
    static char text[1 << 20];
    cli_expect(control, "train task.yaml --out p.h5 --json", 0, "");
    cli_expect(control, "evaluate p.h5 --starts 20 --runs r.csv --plot p.svg --json", 0, "");
    assert_true(json_number(result.out, "success") > 0.5);
    double errors[4];
    assert_int_equal(json_array(json_find(result.out, "worst"), "errors", errors, 4), 3);
    if (!cli_exists("p.svg")) assert_says(result.err, "gnuplot");
    (void)cli_read("r.csv", text, sizeof text);
    assert_true(strncmp(text, "start,t,ph,th,vph,vth,u,cost\n", 29) == 0);
    (void)cli_read("p.dat", text, sizeof text);
    assert_says(text, "=Motion of the first 20 runs\n=th\n=vth\n");
    assert_says(text, "=Starts of 20 runs\n=th\n=vph\n");
}

TEST("a free position is no state of a proof") {
    double width[4];
    cli_expect(control, "certify task.yaml --box th=0.5,vth=2,vph=50 --json", 0, "");
    assert_says(result.out, "The box is of th, vph, vth, counted from the goal");
    assert_int_equal(json_array(result.out, "width", width, 4), 3);
    assert_int_equal(json_array(result.out, "gains", width, 4), 3);
    assert_true(json_number(result.out, "fraction") > 0.1);
    /* One number is for the two accelerations. */
    cli_expect(control, "certify task.yaml --box th=0.5,vth=2,vph=50 --continuous --model-error 1e-3 --json",
               0, "");
    assert_says(result.out, "may err by up to (0, 0.001, 0.001)");
    cli_expect(control, "certify task.yaml --box th=0.5,vth=2,vph=50 --continuous --json", 0, "");
    cli_expect(control, "certify task.yaml --box ph=1", 2, "no state 'ph'; the states are th, vph, vth");
    cli_expect(control, "certify task.yaml --box th=1 --continuous --model-error th=1", 2,
               "th is a position");
}

TEST("there is no proof where the position acts, however little") {
    static char text[1 << 14];
    (void)cli_read("wheel.yaml", text, sizeof text);
    const char *at = strstr(text, "potential: "), *end = strchr(at, '\n');
    cli_write("bent.yaml",
              test_text("%.*spotential: [%.*s, {kind: known, form: linear, of: ph, values: [0, 3e-6]}]%s",
                        (int)(at - text), text, (int)(end - at - 11), at + 11, end));
    cli_write("bent_task.yaml", test_text("plant: bent.yaml%sfree: [ph]\n", strchr(TASK, '\n')));
    cli_expect(control, "certify bent_task.yaml --box th=0.5,vth=2,vph=50", 2,
               "depends on the position ph: it is free");
}

TEST("the name of a free position is refused where it would be an error") {
    static const struct {
        const char *more, *says;
    } faults[] = {
        {"goal: {ph: 0}\n",
         "goal: ph: expected a position that is not free: this one has no error (key free)"},
        {"track: [ph]\n", "track: ph: expected a position that is not free"},
        {"robust: {noise: {ph: 0.1}}\n", "robust.noise: ph: expected a position that is not free"},
    };
    for (size_t i = 0; i < LG_COUNT(faults); i++) {
        cli_write("bad.yaml", test_text("%sfree: [ph]\n%s", TASK, faults[i].more));
        cli_expect(control, "train bad.yaml --out x.h5", 3, faults[i].says);
    }
    static const char *const keys[] = {"cost", "success"};
    for (size_t i = 0; i < LG_COUNT(keys); i++) {
        const char *at = strstr(TASK, test_text("%s: {", keys[i])) + strlen(keys[i]) + 3;
        cli_write("bad.yaml", test_text("%.*sph: 1, %sfree: [ph]\n", (int)(at - TASK), TASK, at));
        cli_expect(control, "train bad.yaml --out x.h5", 3,
                   test_text("%s: ph: expected a position that is not free", keys[i]));
    }
    cli_write("bad.yaml", TASK "free: [vph]\n");
    cli_expect(control, "train bad.yaml --out x.h5", 3, "free: expected a position, not 'vph'");
    cli_write("bad.yaml", TASK "free: ph\n");
    cli_expect(control, "train bad.yaml --out x.h5", 3, "free: expected a list of positions");
    cli_write("bad.yaml", TASK "free: [ph, ph]\n");
    cli_expect(control, "train bad.yaml --out x.h5", 3, "free: ph: expected a position that is not free");
    cli_write("bad.yaml",
              "plant: wheel.yaml\nperiod: 0.04\nhorizon: 5\nstarts: {vth: 1}\nlimits: {u: 0.12}\ncost: {vth: "
              "1}\nsuccess: {vth: 1}\nfree: [ph, th]\n");
    cli_expect(control, "train bad.yaml --out x.h5", 1,
               "free: the machine moves otherwise where th is 1 larger");
}

TEST_GROUP(setup, cli_end)

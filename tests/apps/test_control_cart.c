/* lg-control certify of a cart-pole, |u| <= 30: known and learned, continuous and held.
 * ctest-labels: slow apps/lg-control src/control */
#include "cli_support.h"

static const char control[] = "lg-control", box[] = "--box x=3.6,theta=1.5,vx=12,vtheta=12";

static void write_machine(const char *name, const char *parameters, const char *damping) {
    cli_write(name,
              test_text("columns: {time: t, run: run}\ncoordinates: [{name: x, kind: line, velocity: vx}, "
                        "{name: theta, kind: angle, velocity: vtheta}]\ninputs: {columns: [u], hold: "
                        "zero}\nsystem: cart-pole\nparameters: %s\n%sinput_map: {kind: known, values: [[1], "
                        "[0]]}\n",
                        parameters, damping));
}

static void write_task(const char *name, const char *plant, const char *controller) {
    cli_write(
        name,
        test_text("plant: %s\nperiod: 0.01\nhorizon: 5\nstarts: {x: [-1, 1], theta: [-1, 1], vx: [-2, 2], "
                  "vtheta: [-3, 3]}\nlimits: {u: 30}\ncost: {x: 0.1, theta: 1, vx: 0.01, vtheta: 0.02, u: "
                  "0.002}\nsuccess: {theta: 0.05, hold: 0.5, within: 4}\ncontroller: %s\n",
                  plant, controller));
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    write_machine("cart.yaml", "{cart: 1, pole: 0.1, length: 1, gravity: 9.81}", "");
    write_machine("truth.yaml", "{cart: 1, pole: 0.1, length: 1, gravity: 9.81}",
                  "damping: {kind: known, values: [0.1, 0.005]}\n");
    write_machine("learn.yaml", "{cart: unknown, pole: unknown, length: unknown, gravity: 9.81}",
                  "damping: diagonal\n");
    write_task("lqr.yaml", "cart.yaml", "{kind: lqr}");
    write_task("learned.yaml", "learned.h5", "{kind: lqr}");
    return 0;
}

static double prove(const char *line) {
    cli_expect(control, line, 0, "");
    assert_says(result.out, "\"verified\": true");
    print_message("volume %g, level %g, %g boxes, %g s\n", json_number(result.out, "volume"),
                  json_number(result.out, "level"), json_number(result.out, "boxes"),
                  json_number(result.out, "seconds"));
    return json_number(result.out, "volume");
}

TEST("V and gains are found: a volume of at least 300, also for the policy with these gains") {
    double K[4];
    const double volume = prove(test_text("certify lqr.yaml %s --continuous --seconds 600 --json", box));
    assert_true(volume >= 300);
    assert_says(result.out, "\"converges\": true");
    assert_int_equal(json_array(result.out, "gains", K, 4), 4);
    write_task("given.yaml", "cart.yaml",
               test_text("{kind: lqr, gains: [%.6g, %.6g, %.6g, %.6g]}", K[0], K[1], K[2], K[3]));
    cli_expect(control, "train given.yaml --out given.h5", 0, "");
    assert_true(prove(test_text("certify given.h5 %s --continuous --seconds 600 --json", box)) >= 300);
}

TEST("inputs that are held for .01 s") {
    assert_true(prove(test_text("certify lqr.yaml %s --seconds 600 --threads 2 --json", box)) >= 300);
}

TEST("a cart that was learned from a log, with the error of its fit") {
    cli_expect(
        "lg-identify",
        "generate truth.yaml --inputs steps:0.4 --amplitude 8 --runs 4 --t-end 10 --dt 0.02 --start-spread "
        "1 --noise 1e-3,1e-2 --out log.csv",
        0, "");
    cli_expect("lg-identify", "fit learn.yaml log.csv --out learned.h5", 0, "");
    assert_true(
        prove(test_text("certify learned.yaml %s --continuous --model-error auto --seconds 600 --json",
                        box)) >= 300);
    assert_says(result.out, "the rate may err by up to");
    assert_says(result.out, "\"converges\": false");
}

TEST_GROUP(setup, cli_end)

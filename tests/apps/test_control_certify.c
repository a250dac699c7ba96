/* lg-control certify: proofs, refusals and exit codes.
 * ctest-labels: apps/lg-control src/control */
#include "cli_support.h"

static const char control[] = "lg-control";

/* A pendulum of the page: m .15, l .5, b .1; `more` times the mass. */
static void write_pendulum(const char *name, double more) {
    cli_write(
        name,
        test_text("columns: {time: t}\ncoordinates: [{name: th, kind: angle, velocity: w}]\ninputs: "
                  "{columns: [u]}\nmass: {kind: known, values: [%.17g]}\npotential: {kind: known, form: "
                  "polynomial, of: th, degree: 1, values: [0, %.17g]}\ndamping: {kind: known, values: "
                  "[0.1]}\ninput_map: {kind: known, values: [[1]]}\n",
                  0.15 * 0.25 * more, 0.15 * 9.81 * 0.5 * more));
}

static void write_task(const char *name, const char *plant, double limit, const char *controller) {
    cli_write(
        name,
        test_text("plant: %s\nperiod: 0.01\nhorizon: 5\nstarts: {th: [-3.14, 3.14], w: [-1, 1]}\nlimits: "
                  "{u: %g}\ncost: {th: 1, w: 0.02, u: 0.02}\nsuccess: {th: 0.05, hold: 1, within: "
                  "8}\ncontroller: %s\n",
                  plant, limit, controller));
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    write_pendulum("light.yaml", 1.0);
    write_pendulum("heavy.yaml", 1.02);
    write_task("strong.yaml", "light.yaml", 6, "{kind: energy, gains: [3, 0.3]}");
    write_task("weak.yaml", "light.yaml", 0.75, "{kind: energy, gains: [1.6, 0.06]}");
    write_task("loaded.yaml", "heavy.yaml", 0.75, "{kind: energy, gains: [1.6, 0.06]}");
    cli_write("cart.yaml",
              "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: "
              "angle, velocity: w}]\ninputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: 1, "
              "pole: 0.1, length: 1, gravity: 9.81}\ninput_map: {kind: known, values: [[1], [0]]}\n");
    cli_write("lqr.yaml",
              "plant: cart.yaml\nperiod: 0.01\nhorizon: 5\nstarts: {x: [-1, 1], th: [-1, 1], vx: [-2, 2], "
              "w: [-3, 3]}\nlimits: {u: 30}\ncost: {x: 0.1, th: 1, vx: 0.01, w: 0.02, u: 0.002}\nsuccess: "
              "{th: 0.05, hold: 0.5, within: 4}\ncontroller: {kind: lqr}\n");
    cli_write("body.yaml",
              "columns: {time: t}\ncoordinates: [{name: R, kind: rotation, columns: [a, b, c, d], "
              "velocity: [wx, wy, wz]}]\ninputs: {columns: [p, q, r]}\nmass: {kind: known, values: [1, 2, "
              "3]}\ninput_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n");
    cli_write("turn.yaml",
              "plant: body.yaml\nperiod: 0.1\nhorizon: 5\nstarts: {R: [0, 1]}\nlimits: {p: 2, q: 2, r: "
              "2}\ncost: {R: 1}\nsuccess: {R: 0.05, hold: 1, within: 10}\ncontroller: {kind: lqr}\n");
    return 0;
}

/* Where the torque is at its limit the given gain shows: |q| >= limit/k_p. */
TEST("both pendulums are proved from every state, with their margins and with the gains as given") {
    cli_expect(control, "certify strong.yaml --lyapunov energy --json", 0, "");
    assert_says(result.out, "\"verified\": true, \"global\": true, \"converges\": true");
    assert_close(json_number(result.out, "margin"), 6 - 0.73575, 2e-3, 0.0);
    assert_says(result.out, "for |q| >= 2.");
    assert_says(result.out, "it was not proved");
    cli_expect(control, "certify weak.yaml --lyapunov energy --json", 0, "");
    assert_close(json_number(result.out, "margin"), 0.75 - 0.73575, 2e-3, 0.0);
    assert_says(result.out, "for |q| >= 0.4688."); /* .75/1.6 */
}

TEST("2 % more mass is refused with the angle, and the claim does not speak of a margin") {
    cli_expect(control, "certify loaded.yaml --lyapunov energy --json", 1, "not proved");
    assert_says(result.out, "\"verified\": false, \"global\": false, \"converges\": false");
    assert_true(strstr(result.out, "at least 0 ") == NULL);
    double side[2];
    assert_int_equal(json_array(json_find(result.out, "failed"), "th", side, 2), 2);
    assert_true(side[0] > 1.4 && side[1] < 1.72); /* sin th > .75/.750465 within .04 of pi/2; refined there */
}

TEST("a regulator of the cart-pole is proved in its box, continuous and held, and not with a large error") {
    cli_expect(control, "certify lqr.yaml --box x=3.6,th=1.5,vx=12,w=12 --seconds 60 --json", 0, "");
    assert_says(result.out, "\"verified\": true");
    const double volume = json_number(result.out, "volume"), level = json_number(result.out, "level");
    assert_true(volume > 5 && json_number(result.out, "fraction") < 1);
    cli_expect(control, "certify lqr.yaml --box x=3.6,th=1.5,vx=12,w=12 --held --seconds 60 --json", 0, "");
    assert_says(result.out, "held");
    char line[160];
    (void)snprintf(line, sizeof line,
                   "certify lqr.yaml --box x=3.6,th=1.5,vx=12,w=12 --seconds 60 --level %.6g --json",
                   20 * level);
    cli_expect(control, line, 1, "not proved");
    assert_non_null(json_find(result.out, "failed"));
    cli_expect(
        control,
        "certify lqr.yaml --box x=3.6,th=1.5,vx=12,w=12 --seconds 60 --model-error vx=100,w=100 --json", 1,
        "not proved");
}

TEST("names, kinds and options that do not fit are refused with a sentence") {
    cli_expect(control, "certify lqr.yaml --box y=1", 2,
               "there is no state 'y'; the states are x, th, vx, w");
    cli_expect(control, "certify lqr.yaml --box x=-1", 2, "not a number above 0");
    cli_expect(control, "certify lqr.yaml --box x=1,x=2", 2, "stands twice");
    cli_expect(control, "certify lqr.yaml --lyapunov polynomial --box x=1", 2,
               "needs a bound of every state");
    cli_expect(control, "certify lqr.yaml --lyapunov energy", 2, "the energy needs kind energy");
    cli_expect(control, "certify strong.yaml --lyapunov energy --level 2", 2,
               "the energy proves all states at once");
    cli_expect(control, "certify lqr.yaml --held --lyapunov polynomial --box x=1,th=1,vx=1,w=1", 2,
               "quadratic");
    cli_expect(control, "certify turn.yaml --box R=1", 2,
               "certificates are for machines of lines and angles");
}

TEST_GROUP(setup, cli_end)

/* lg-control: training, judging, stopping, and what is refused.
 * ctest-labels: apps/lg-control src/control */
#include "cli_support.h"

static const char control[] = "lg-control";
static const char machine[] =
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: angle, "
    "velocity: w}]\n"
    "inputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: 1, pole: %s, length: 1, gravity: 9.81}\n"
    "input_map: {kind: known, values: [[1], [0]]}\n";
#define TASK                                                                                                 \
    "plant: cart.yaml\nperiod: 0.05\nhorizon: 5\nstarts: {x: [-0.5, 0.5], th: [-3.14159, 3.14159], vx: "     \
    "[-0.5, 0.5], w: [-1, 1]}\nlimits: {u: "                                                                 \
    "10}\ncost: {x: 0.1, th: 1, vx: 0.01, w: 0.02, u: 0.002}\nsuccess: {th: 0.1, hold: 1, within: 10}\n"

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("cart.yaml", test_text(machine, "0.1"));
    cli_write("heavy.yaml", test_text(machine, "0.2"));
    cli_write("unknown.yaml", test_text(machine, "unknown"));
    cli_write("task.yaml", TASK "controller: {kind: network, hidden: [32, 32]}\n");
    cli_write("lqr.yaml", TASK "controller: {kind: lqr}\n");
    cli_write("tilted.yaml", TASK "goal: {th: 0.3}\n");
    cli_write("blind.yaml", "plant: unknown.yaml\n" TASK);
    return 0;
}

TEST("a short training swings up more starts than the regulator, and its file gives the same runs") {
    cli_expect(control, "train task.yaml --race 60 --finish 60 --polish 5 --threads 2 --out p.h5 --json", 0,
               "");
    const double success = json_number(result.out, "success"),
                 regulator = json_number(result.out, "regulator_success"),
                 cost = json_number(result.out, "cost");
    assert_true(regulator < 0.6 && success > regulator + 0.25);
    assert_true(isfinite(cost) &&
                json_number(result.out, "parameters") == 32 * 5 + 32 + 32 * 32 + 32 + 32 + 1);
    cli_expect(control, "evaluate p.h5 --starts 300 --json", 0, "");
    assert_close(json_number(result.out, "success"), success, 0.0, 0.1); /* other starts */
    assert_true(json_number(json_find(result.out, "lqr"), "success") < 0.6);
    cli_expect(control, "evaluate p.h5 --plant cart.yaml --starts 300 --json", 0, "");
    const double same = json_number(result.out, "cost_mean");
    cli_expect(control, "evaluate p.h5 --starts 300 --json", 0, "");
    assert_close(json_number(result.out, "cost_mean"), same, 1e-2, 0.0); /* with fewer steps in a period */
    cli_expect(control, "evaluate p.h5 --plant heavy.yaml --starts 300 --json", 0, "");
    assert_true(fabs(json_number(result.out, "cost_mean") - same) > 1e-3 * same);
}

TEST("the regulator alone needs no training") {
    cli_expect(control, "train lqr.yaml --out lqr.h5 --json", 0, "");
    assert_close(json_number(result.out, "success"), json_number(result.out, "regulator_success"), 0.0, 0.0);
    assert_true(json_number(result.out, "seconds") < 5.0);
}

TEST("goals, machines and options that do not fit are refused with a sentence") {
    cli_expect(control, "train tilted.yaml --out x.h5", 1, "not an equilibrium under any constant input");
    cli_expect(control, "train absent.yaml --out x.h5", 3, "absent.yaml");
    cli_expect(control, "train task.yaml --starts 100 --out x.h5", 2, "multiple of 64");
    cli_expect(control, "evaluate cart.yaml", 3, "cart.yaml");
    cli_write("blind.yaml",
              "plant: unknown.yaml\nperiod: 0.05\nhorizon: 3\nstarts: {x: 1}\nlimits: {u: 10}\ncost: {x: "
              "1}\nsuccess: {x: 1}\n");
    cli_expect(control, "train blind.yaml --out x.h5", 3, "or learn the machine with lg-identify");
    cli_write("other.yaml",
              "columns: {time: t}\ncoordinates: [{name: y, kind: line, velocity: vy}]\ninputs: {columns: "
              "[u]}\nmass: {kind: known, values: [1]}\ninput_map: {kind: known, values: [1]}\n");
    cli_expect(control, "train lqr.yaml --out lqr.h5", 0, "");
    cli_expect(control, "evaluate lqr.h5 --plant other.yaml", 3, "not those of the policy");
}

TEST("disturbances of another task judge a policy, and draws need the covariance of a fit") {
    cli_write("noisy.yaml", TASK "controller: {kind: lqr}\nrobust: {delay: 0.5, noise: {th: 0.3}}\n");
    cli_write("drawn.yaml", TASK "controller: {kind: lqr}\nrobust: {draws: 2}\n");
    cli_write("wrong.yaml", TASK "robust: {noise: {u: 0.3}}\n");
    cli_expect(control, "train lqr.yaml --out lqr.h5 --json", 0, "");
    assert_null(json_find(result.out, "disturbed"));
    cli_expect(control, "evaluate lqr.h5 --disturb noisy.yaml --json", 0, "");
    assert_true(json_number(json_find(result.out, "disturbed"), "succeeded") <
                0.8 * json_number(result.out, "succeeded"));
    cli_expect(control, "train noisy.yaml --out noisy.h5 --json", 0, "");
    assert_close(json_number(json_find(result.out, "disturbed"), "starts"), 512, 0.0, 0.0);
    cli_expect(control, "evaluate lqr.h5 --disturb lqr.yaml", 3, "the task has no disturbances (robust)");
    cli_expect(control, "train drawn.yaml --out x.h5", 3, "robust.draws needs a model of lg-identify");
    cli_expect(control, "train wrong.yaml --out x.h5", 3,
               "robust.noise: u: expected a coordinate, not an input");
}

TEST("a policy follows the set points of a file") {
    cli_write("track.yaml", TASK "controller: {kind: lqr}\ntrack: [x]\n");
    cli_write("steps.csv", "t,x\n0,0.2\n20,0.2\n");
    cli_write("moving.csv", "t,x,vx\n0,0,0.1\n20,2,0.1\n");
    cli_write("other.csv", "t,y\n0,0\n1,1\n");
    cli_write("back.csv", "t,x\n0,0\n0,1\n");
    cli_expect(control, "train track.yaml --out track.h5", 0, "");
    cli_expect(control, "evaluate track.h5 --starts 64 --reference steps.csv --json", 0, "");
    assert_close(json_number(json_find(result.out, "reference"), "x_largest"), 0.0, 0.0, 1e-9);
    cli_expect(control, "evaluate track.h5 --starts 64 --reference moving.csv --json", 0, "");
    assert_true(json_number(json_find(result.out, "reference"), "x_rms") < 0.2);
    cli_expect(control, "evaluate track.h5 --reference other.csv", 3, "x");
    cli_expect(control, "evaluate track.h5 --reference back.csv", 3, "line 3: the time t does not increase");
    cli_expect(control, "train lqr.yaml --out lqr.h5", 0, "");
    cli_expect(control, "evaluate lqr.h5 --reference steps.csv", 3, "tracks no coordinate");
    cli_write("track.yaml", TASK "track: [vx]\n");
    cli_expect(control, "train track.yaml --out x.h5", 3, "track: expected a position, not 'vx'");
}

TEST_GROUP(setup, cli_end)

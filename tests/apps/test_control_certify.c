/* lg-control certify: proofs, refusals and exit codes.
 * ctest-labels: slow apps/lg-control src/control */
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

static const char cart_task[] =
    "plant: cart.yaml\nperiod: 0.01\nhorizon: 5\nstarts: {x: [-1, 1], th: [-1, 1], vx: [-2, 2], w: [-3, "
    "3]}\nlimits: {u: 30}\ncost: {x: 0.1, th: 1, vx: 0.01, w: 0.02, u: 0.002}\nsuccess: {th: 0.05, hold: "
    "0.5, "
    "within: 4}\ncontroller: ";

static void write_turn(const char *name, double limit, const char *controller) {
    cli_write(name,
              test_text("plant: body.yaml\nperiod: 0.1\nhorizon: 5\nstarts: {R: [0, 1]}\nlimits: {p: %g, q: "
                        "%g, r: %g}\ncost: {R: 1}\nsuccess: {R: 0.05, hold: 1, within: 10}\ncontroller: %s\n",
                        limit, limit, limit, controller));
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
    write_task("chosen.yaml", "light.yaml", 0.75, "{kind: lqr}");
    write_task("regulator.yaml", "light.yaml", 0.75, "{kind: lqr, gains: [2.06009, 0.254665]}");
    cli_write("lqr.yaml", test_text("%s{kind: lqr}\n", cart_task));
    cli_write("body.yaml",
              "columns: {time: t}\ncoordinates: [{name: R, kind: rotation, columns: [a, b, c, d], "
              "velocity: [wx, wy, wz]}]\ninputs: {columns: [p, q, r]}\nmass: {kind: known, values: [1, 2, "
              "3]}\ninput_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n");
    write_turn("turn.yaml", 2, "{kind: lqr}");
    write_turn("spin.yaml", 20, "{kind: energy, gains: [1, 2]}");
    write_turn("spin2.yaml", 2, "{kind: energy, gains: [1, 2]}");
    return 0;
}

/* Where the torque is at its limit the given gain shows: |q| >= limit/k_p. */
TEST("both pendulums are proved from every state, with their margins and with the gains as given") {
    cli_expect(control, "certify strong.yaml --continuous --lyapunov energy --json", 0, "");
    assert_says(result.out, "\"verified\": true, \"global\": true, \"converges\": true");
    assert_close(json_number(result.out, "margin"), 6 - 0.73575, 2e-3, 0.0);
    assert_says(result.out, "for |q| >= 2.");
    assert_says(result.out, "it was not proved");
    cli_expect(control, "certify weak.yaml --continuous --lyapunov energy --json", 0, "");
    assert_close(json_number(result.out, "margin"), 0.75 - 0.73575, 2e-3, 0.0);
    assert_says(result.out, "for |q| >= 0.46875"); /* .75/1.6 */
}

TEST("2 % more mass is refused with the angle, and the claim does not speak of a margin") {
    cli_expect(control, "certify loaded.yaml --continuous --lyapunov energy --json", 1, "not proved");
    assert_says(result.out, "\"verified\": false, \"global\": false, \"converges\": false");
    assert_true(strstr(result.out, "at least 0 ") == NULL);
    double side[2];
    assert_int_equal(json_array(json_find(result.out, "failed"), "th", side, 2), 2);
    assert_true(side[0] > 1.4 && side[1] < 1.72); /* sin th > .75/.750465 within .04 of pi/2; refined there */
}

/* The pendulum with the torque .75 as a regulator. regulator.yaml has the gains that certify chooses for
 * chosen.yaml. */
TEST("gains that are found can be given: the same set is proved for the task and for its policy") {
    cli_expect(control, "certify chosen.yaml --box th=1.5,w=12 --json", 0, "");
    assert_says(result.out, "\"verified\": true");
    const double volume = json_number(result.out, "volume");
    double K[2], P[4];
    assert_int_equal(json_array(result.out, "gains", K, 2), 2);
    assert_int_equal(json_array(result.out, "P", P, 4), 4);
    assert_true(volume > 10 && K[0] > 0 && P[0] * P[3] > P[1] * P[2]);
    write_task("given.yaml", "light.yaml", 0.75, test_text("{kind: lqr, gains: [%.6g, %.6g]}", K[0], K[1]));
    cli_expect(control, "certify given.yaml --box th=1.5,w=12 --json", 0, "");
    assert_close(json_number(result.out, "volume"), volume, 0.03, 0);
    assert_true(strstr(result.out, "\"gains\"") == NULL);
    cli_expect(control, "train given.yaml --out given.h5 --robustness 0 --optimality-gap 0", 0, "");
    cli_expect(control, "certify given.h5 --box th=1.5,w=12 --json", 0, "");
    assert_close(json_number(result.out, "volume"), volume, 0.03, 0);
    cli_expect("lg-export", "given.h5 --out exported", 0, "");
}

/* The torque of a controller with a period of .4 s comes too late: the linear closed loop is not stable. */
TEST("the loop that runs is proved, with inputs that are held; --continuous is another claim, and says so") {
    static const char box[] = "--box th=1.5,w=12 --json";
    cli_expect(control, test_text("certify chosen.yaml %s", box), 0, "");
    assert_says(result.out, "\"claim\": \"Proved, for the plant light.yaml (SHA-256 ");
    assert_says(result.out, ") and the controller of kind lqr of chosen.yaml (SHA-256 ");
    assert_says(result.out, ") with gains that were chosen: in the box ");
    assert_says(result.out, "inputs are held");
    assert_says(result.out, "between the samples");
    assert_says(result.out,
                "Inputs stay in their limits. The box is of th, w, counted from the goal. Not covered: ");
    cli_expect(control, test_text("certify regulator.yaml --held %s", box), 0, "");
    assert_says(result.out, "inputs are held");
    cli_expect(control, test_text("certify chosen.yaml --continuous %s", box), 0, "");
    assert_says(result.out, "at all times; the controller holds them for 0.01. The box");
    write_task("slow.yaml", "light.yaml", 0.75, "{kind: lqr, gains: [2.5, 0.3]}");
    char text[2048];
    (void)cli_read("slow.yaml", text, sizeof text);
    char *period = strstr(text, "period: 0.01");
    memcpy(period, "period: 0.40", 12);
    cli_write("slow.yaml", text);
    cli_expect(control, test_text("certify slow.yaml --continuous %s", box), 0, "");
    cli_expect(control, test_text("certify slow.yaml %s", box), 1,
               "not proved: V rises in a step, at th from ");
    assert_says(result.out, "\"claim\": \"Not proved, for the plant light.yaml (");
    assert_says(result.out, "\"reason\": \"V rises in a step, at th from ");
    static const char *const kinds[] = {"polynomial", "function", "energy"};
    for (size_t i = 0; i < LG_COUNT(kinds); i++)
        cli_expect(
            control, test_text("certify weak.yaml --box th=1,w=1 --lyapunov %s", kinds[i]), 2,
            test_text("--lyapunov %s: this proof is about inputs that follow the state at all times, but "
                      "the controller holds them for a period: give --loop continuous",
                      kinds[i]));
}

/* The pendulum below a stiff regulator, with a motor behind a lag, inputs that act late, and an integral. */
TEST("lags, inputs that act late and integrals are states of the proof; friction that sticks is no loop of "
     "it") {
    static const struct {
        const char *inputs, *more, *damping;
        int code;
        const char *says;
    } rows[] = {{"", "", "[0.1]", 0, "The box is of th, w, counted"},
                {", lag: 0.03", "", "[0.1]", 0, "The box is of th, lagged.u, w, counted"},
                {", delay: 1", "", "[0.1]", 0,
                 "The input u acts 1 period late; the set also holds past inputs beyond the limits. The box "
                 "is of th, past.u.1, w, counted"},
                {", delay: 13", "", "[0.1]", 1, "not proved"}, /* .13 s: the linear loop is not stable */
                {"", "integral: [th]\n", "[0.1]", 0, "The box is of th, integral.th, w, counted"},
                {"", "", "[0.1]}, {kind: coulomb, values: [0.01]", 2, "as where dry friction sticks"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_write(
            "driven.yaml",
            test_text("columns: {time: t}\ncoordinates: [{name: th, kind: angle, velocity: w}]\ninputs: "
                      "{columns: [u]%s}\nmass: {kind: known, values: [0.0375]}\ndamping: [{kind: known, "
                      "values: %s}]\ninput_map: {kind: known, values: [[1]]}\n",
                      rows[i].inputs, rows[i].damping));
        write_task("driven_task.yaml", "driven.yaml", 3,
                   i == 4 ? "{kind: lqr}" : "{kind: lqr, gains: [2, 0.3]}");
        char text[2048];
        (void)cli_read("driven_task.yaml", text, sizeof text);
        if (i == 1) (void)strcpy(strstr(text, "0.3]"), "0.3, 0]}\n");
        (void)strcat(text, rows[i].more);
        cli_write("driven_task.yaml", text);
        cli_expect(
            control,
            test_text("certify driven_task.yaml --box th=1.5,w=12%s --json", i == 4 ? ",integral.th=1" : ""),
            rows[i].code, rows[i].code == 0 ? "" : rows[i].says);
        if (rows[i].code == 0) assert_says(result.out, rows[i].says);
    }
}

TEST("the rounding of the controller is in the claim, unless it is exact or inputs are continuous") {
    static const struct {
        const char *options, *says, *more;
    } rows[] = {
        {"", "with the controller's rounding, errors of inputs of up to", "\"eps_rounded\": "},
        {" --precision f64", "in exact arithmetic and V <= ", "and the rounding of their numbers."},
        {" --precision f32", "the controller's rounding, errors of inputs of up to", "\"input_error\": "},
        {" --precision exact", "converge to the goal and V <= ", "and the rounding of the controller ("},
        {" --continuous", "converge to the goal; ", "and the rounding of the controller ("}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_expect(control, test_text("certify regulator.yaml --box th=1.5,w=12%s --json", rows[i].options),
                   0, rows[i].says);
        assert_says(result.out, rows[i].more);
    }
    cli_expect(control, "certify regulator.yaml --box th=1.5,w=12 --continuous --precision f32", 2,
               "--dtype");
}

TEST("levels and errors of the model") {
    cli_expect(control, "certify regulator.yaml --box th=1.5,w=12 --level 3 --json", 1, "not proved");
    double side[2];
    assert_int_equal(json_array(json_find(result.out, "failed"), "th", side, 2), 2);
    cli_expect(control, "certify chosen.yaml --box th=1.5,w=12 --model-error w=0.002 --json", 0, "");
    assert_says(result.out, "\"converges\": false");
    assert_says(result.out, "between the samples (of the model); the next state may err by up to (0, 0.002)");
    cli_expect(control, "certify regulator.yaml --box th=1.5,w=12 --continuous --model-error 0.2 --json", 0,
               "");
    assert_says(result.out, "\"converges\": false");
    assert_says(result.out, "the rate may err by up to (0, 0.2)");
    cli_expect(control, "certify regulator.yaml --box th=1.5,w=12 --model-error w=0.0019956 --json", 0, "");
    assert_says(result.out, "may err by up to (0, 0.0019956)");
    cli_expect(control, "certify regulator.yaml --box th=1.5,w=12 --model-error w=100 --json", 1,
               "no quadratic V falls at all points");
    cli_expect(control, "certify regulator.yaml --box th=1.5,w=12 --eps 0.5 --json", 0, "");
    assert_says(result.out, "eps = 0.5 <=");
}

TEST("the cart-pole with gains of a wrong sign, or a fifth of them, is refused with states where V rises") {
    static const char *const gains[] = {"2.7, 51.5, 6.04, 15.2", "-0.54, -10.3, -1.21, -3.04"};
    for (size_t i = 0; i < LG_COUNT(gains); i++) {
        cli_write("bad.yaml", test_text("%s{kind: lqr, gains: [%s]}\n", cart_task, gains[i]));
        cli_expect(control, "certify bad.yaml --box x=3.6,th=1.5,vx=12,w=12 --json", 1, "not proved");
        assert_says(result.out, "V rises in a step");
        const char *failed = json_find(result.out, "failed");
        double x[2], th[2];
        assert_int_equal(json_array(failed, "x", x, 2), 2);
        assert_int_equal(json_array(failed, "th", th, 2), 2);
        assert_true(x[0] <= x[1] && fabs(x[0]) <= 3.6 && th[0] <= th[1] && fabs(th[0]) <= 1.5);
    }
}

/* z = 2 sin(a/2) cos(a/2)/r(cos(a/2)) n, r(x) = sqrt(x^2 + 1e-6): 4 k (r(1) - r(cos(a/2))) is the work of k z
 * up to the angle a. The inertia and limits decide the level: |u_l| <= k_p |z| + k_d |w_l|. */
TEST("a body that turns: the energy up to half a turn, or as far as torques stay in their limits") {
    cli_expect(control, "certify spin.yaml --continuous --lyapunov energy --json", 0, "");
    assert_says(result.out, "\"verified\": true");
    assert_close(json_number(result.out, "level"), 4 * (sqrt(1 + 1e-6) - 1e-3), 1e-6, 0);
    assert_true(strstr(result.out, "jumps") == NULL);
    cli_expect(control, "certify spin2.yaml --continuous --lyapunov energy --json", 0, "");
    const double level = json_number(result.out, "level"), angle = json_number(result.out, "angle");
    assert_close(angle, 2 * acos(sqrt(pow(sqrt(1 + 1e-6) - level / 4, 2) - 1e-6)), 2e-6, 0);
    /* at the level the first axis (inertia 1) reaches 2 = |z| + 2 |w| for the worst share of the energy */
    double most = 0;
    for (int i = 0; i <= 100000; i++) {
        const double phi = level * i / 100000, c = 1 - phi / 4;
        most = fmax(most, 2 * sqrt(1 - c * c) + 2 * sqrt(2 * (level - phi)));
    }
    assert_close(most, 2, 1e-4, 0);
    cli_expect(control, "certify turn.yaml --continuous --lyapunov energy", 2,
               "the energy needs kind energy");
    cli_expect(control, "certify spin.yaml --continuous --lyapunov energy --box R=1", 2, "its own set");
}

TEST("a trained network is proved to reach a small set, and the claim says what its gate does") {
    write_task("net.yaml", "light.yaml", 0.75, "{kind: network, hidden: [8, 8]}");
    cli_expect(control,
               "train net.yaml --out net.h5 --race 40 --finish 40 --polish 2 --seeds 2 --robustness 0 "
               "--optimality-gap 0",
               0, "");
    cli_expect(control, "certify net.h5 --box th=1,w=8 --json", 0, "");
    assert_says(result.out, "\"verified\": true");
    assert_says(result.out, "of the input to the regulator");
    assert_true(json_number(result.out, "volume") > 1);
    cli_expect(control, "certify net.h5 --box th=1,w=8 --continuous --json", 0, "");
}

TEST("names, kinds and options that do not fit are refused with a sentence") {
    cli_expect(control, "certify lqr.yaml --box y=1", 2,
               "there is no state 'y'; the states are x, th, vx, w");
    cli_expect(control, "certify lqr.yaml --box x=-1", 2, "not a number above 0");
    cli_expect(control, "certify lqr.yaml --box x=1,x=2", 2, "stands twice");
    cli_expect(control, "certify lqr.yaml --continuous --lyapunov polynomial --box x=1", 2,
               "needs a bound of every state");
    cli_expect(control, "certify lqr.yaml --continuous --lyapunov energy", 2, "the energy needs kind energy");
    cli_expect(control, "certify strong.yaml --continuous --lyapunov energy --level 2", 2,
               "the energy proves all states at once");
    cli_expect(control, "certify lqr.yaml --held --continuous --box x=1,th=1,vx=1,w=1", 2, "one of the two");
    write_task("few.yaml", "light.yaml", 0.75, "{kind: lqr, gains: [1]}");
    cli_expect(control, "certify few.yaml --box th=1,w=1", 2, "K of kind lqr: 2 numbers");
    write_task("both.yaml", "light.yaml", 0.75, "{kind: network, gains: [1, 1]}");
    cli_expect(control, "certify both.yaml --box th=1,w=1", 2, "gains are two positive numbers");
    write_task("unstable.yaml", "light.yaml", 0.75, "{kind: lqr, gains: [0, 0]}");
    cli_expect(
        control, "train unstable.yaml --out x.h5", 1,
        "the given gains do not hold the goal: with them the loop is unstable, its spectral radius is 1.");
    assert_null(strstr(result.err, "stabilisable"));
    cli_expect(control, "certify chosen.yaml --box th=1,w=1 --model-error auto", 3,
               "needs a model of lg-identify");
    cli_expect(control, "certify turn.yaml --box R=1", 2,
               "certificates are for machines of lines and angles");
}

TEST_GROUP(setup, cli_end)

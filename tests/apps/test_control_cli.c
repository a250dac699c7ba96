/* lg-control: training, judging, stopping, and what is refused.
 * ctest-labels: apps/lg-control src/control */
#include "cli_support.h"

static const char control[] = "lg-control";
static const char machine[] =
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: angle, "
    "velocity: w}]\n"
    "inputs: {columns: [u], hold: zero}\nsystem: cart-pole\nparameters: {cart: 1, pole: %s, length: 1, "
    "gravity: 9.81}\n"
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

/* Trains without what train computes of the result. */
#define BRIEFLY " --robustness 0 --optimality-gap 0"

static void need_regulator(void) {
    if (!cli_exists("lqr.h5")) cli_run(control, "train lqr.yaml --out lqr.h5" BRIEFLY);
}

TEST("a short training swings up more starts than the regulator, and its file gives the same runs") {
    cli_expect(control,
               "train task.yaml --race 60 --finish 60 --polish 5 --threads 2 --out p.h5 --json" BRIEFLY, 0,
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
    assert_null(json_find(result.out, "disturbed"));
}

TEST("a policy does not replace the plant that its task names") {
    cli_run("lg-identify", "generate cart.yaml --inputs multisine --amplitude 2 --runs 1 --t-end 4 --dt 0.02 "
                           "--seed 1 --out log.csv");
    cli_run("lg-identify", "fit unknown.yaml log.csv --out plant.h5");
    cli_write("fitted.yaml", test_text("plant: plant.h5%s", strchr(TASK "controller: {kind: lqr}\n", '\n')));
    cli_expect(control, "train fitted.yaml --out plant.h5", 3,
               "plant.h5: exists and is not an earlier result of this kind");
    cli_run(control, "train fitted.yaml --out policy.h5" BRIEFLY); /* the plant is as it was */
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
    need_regulator();
    cli_expect(control, "evaluate lqr.h5 --plant other.yaml", 3, "not those of the policy");
}

TEST("runs have a column for a lagged input; a goal of a lagged input and a certificate are refused") {
    cli_write(
        "slow.yaml",
        "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: angle, "
        "velocity: w}]\ninputs: {columns: [u], lag: 0.3}\nsystem: cart-pole\nparameters: {cart: 1, "
        "pole: 0.1, length: 1, gravity: 9.81}\ninput_map: {kind: known, values: [[1], [0]]}\n");
    cli_write("slow_task.yaml",
              "plant: slow.yaml\nperiod: 0.05\nhorizon: 5\nstarts: {th: [-0.2, "
              "0.2]}\nlimits: {u: 10}\ncost: {x: 0.1, th: 1, lagged.u: 0.001, u: "
              "0.002}\nsuccess: {th: 0.05, hold: 1, within: 10}\ncontroller: {kind: lqr}\n");
    cli_expect(control, "train slow_task.yaml --out slow.h5 --json" BRIEFLY, 0, "");
    assert_true(json_number(result.out, "success") == 1);
    cli_expect(control, "evaluate slow.h5 --starts 2 --runs slow.csv", 0, "");
    char text[256];
    FILE *csv = fopen(cli_at("slow.csv"), "r");
    assert_non_null(csv);
    assert_non_null(fgets(text, sizeof text, csv));
    (void)fclose(csv);
    assert_string_equal(text, "start,t,x,th,lagged.u,vx,w,u,cost\n");
    cli_expect(control, "evaluate slow.h5 --plant slow.yaml --json", 0, "");
    assert_null(strstr(result.out, "another lag"));
    cli_write("slower.yaml",
              "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: "
              "angle, velocity: w}]\ninputs: {columns: [u], lag: 0.4}\nsystem: cart-pole\nparameters: "
              "{cart: 1, pole: 0.1, length: 1, gravity: 9.81}\ninput_map: {kind: known, values: [[1], "
              "[0]]}\n");
    cli_expect(control, "evaluate slow.h5 --plant slower.yaml --json", 0, "");
    assert_non_null(strstr(result.out, "has another lag"));
    cli_expect(control, "evaluate slow.h5 --plant cart.yaml", 3,
               "the plant has 0 lagged inputs, but the policy knows 1");
    need_regulator();
    cli_expect(control, "evaluate lqr.h5 --plant slow.yaml --json", 0,
               ""); /* the controller does not know the lag */
    assert_true(json_number(result.out, "succeeded") < 50);
    cli_write("aimed.yaml", "plant: slow.yaml\nperiod: 0.05\nhorizon: 5\ngoal: {lagged.u: 1}\nstarts: {th: "
                            "1}\nlimits: {u: 10}\ncost: {th: 1}\nsuccess: {th: 0.05}\n");
    cli_expect(control, "train aimed.yaml --out x.h5", 3, "a lagged input has no goal to choose");
}

TEST("inputs whose names have blanks or are long keep their names in the policy's file") {
    cli_write(
        "blank.yaml",
        "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: the speed}]\ninputs: {columns: "
        "[motor current], lag: 0.1}\nmass: {kind: known, values: [1]}\ninput_map: {kind: known, values: "
        "[1]}\n");
    cli_write("blank_task.yaml",
              "plant: blank.yaml\nperiod: 0.05\nhorizon: 3\nstarts: {x: 1}\nlimits: {motor current: "
              "5}\ncost: {x: 1, the speed: 0.1}\nsuccess: {x: 0.05}\ncontroller: {kind: lqr}\n");
    cli_expect(control, "train blank_task.yaml --out blank.h5" BRIEFLY, 0, "");
    cli_expect(control, "evaluate blank.h5 --starts 10", 0, "");
    cli_write("long.yaml",
              "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: {columns: "
              "[motor_of_the_left_arm_1, motor_of_the_left_arm_2], lag: 0.1}\nmass: {kind: known, values: "
              "[1]}\ninput_map: {kind: known, values: [[1, 1]]}\n");
    cli_write("long_task.yaml",
              "plant: long.yaml\nperiod: 0.05\nhorizon: 3\nstarts: {x: 1}\nlimits: "
              "{motor_of_the_left_arm_1: 5, motor_of_the_left_arm_2: 5}\ncost: {x: 1}\nsuccess: {x: "
              "0.05}\n");
    cli_expect(control, "train long_task.yaml --out x.h5", 2, "give the inputs shorter names");
}

TEST("a weight behind a dead zone has its equilibrium outside of the dead zone") {
    cli_write("zone.yaml",
              "columns: {time: t}\ncoordinates: [{name: h, kind: line, velocity: v}]\ninputs: {columns: [u], "
              "curve: "
              "{dead_zone: 0.5}}\nmass: {kind: known, values: [1]}\noffset: {kind: known, values: "
              "[-9.81]}\ninput_map: {kind: known, values: [1]}\n");
    cli_write("zone_task.yaml", "plant: zone.yaml\nperiod: 0.05\nhorizon: 3\nstarts: {h: 0.2}\nlimits: {u: "
                                "20}\ncost: {h: 1, v: 0.1}\nsuccess: {h: 0.05}\ncontroller: {kind: lqr}\n");
    cli_expect(control, "train zone_task.yaml --out zone.h5 --json" BRIEFLY, 0, "");
    assert_true(json_number(result.out, "success") == 1);
}

TEST("disturbances of another task judge a policy, and draws need the covariance of a fit") {
    cli_write("noisy.yaml", TASK "controller: {kind: lqr}\nrobust: {delay: 0.5, noise: {th: 0.3}}\n");
    cli_write("drawn.yaml", TASK "controller: {kind: lqr}\nrobust: {draws: 2}\n");
    cli_write("wrong.yaml", TASK "robust: {noise: {u: 0.3}}\n");
    need_regulator();
    cli_expect(control, "evaluate lqr.h5 --disturb noisy.yaml --json", 0, "");
    assert_true(json_number(json_find(result.out, "disturbed"), "succeeded") <
                0.8 * json_number(result.out, "succeeded"));
    cli_expect(control, "train noisy.yaml --out noisy.h5 --json" BRIEFLY, 0, "");
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
    cli_expect(control, "train track.yaml --out track.h5" BRIEFLY, 0, "");
    cli_expect(control, "evaluate track.h5 --starts 64 --reference steps.csv --json", 0, "");
    assert_close(json_number(json_find(result.out, "reference"), "x_largest"), 0.0, 0.0, 1e-9);
    cli_expect(control, "evaluate track.h5 --starts 64 --reference moving.csv --json", 0, "");
    assert_true(json_number(json_find(result.out, "reference"), "x_rms") < 0.2);
    const double rms = json_number(json_find(result.out, "reference"), "x_rms");
    cli_write("dates.csv", "t,x,vx\n2024-02-28T23:59:59.5,0,0.1\n2024-02-29T00:00:19.5,2,0.1\n");
    cli_expect(control, "evaluate track.h5 --starts 64 --reference dates.csv --json", 0, "");
    assert_close(json_number(json_find(result.out, "reference"), "x_rms"), rms, 0.0, 0.0);
    cli_expect(control, "evaluate track.h5 --reference other.csv", 3, "no column 'x'");
    cli_write("other.csv", "t,x\n0,0\n1,\n2,1\n");
    cli_expect(control, "evaluate track.h5 --reference other.csv", 3,
               "line 3: column x: the value is missing");
    cli_expect(control, "evaluate track.h5 --reference back.csv", 3,
               "line 3: column t: the time does not increase");
    need_regulator();
    cli_write("long.csv", "t,x\n0,0\n1e300,1\n");
    cli_expect(control, "evaluate track.h5 --starts 64 --reference long.csv", 3, "expected at most 1e+09");
    cli_expect(control, "evaluate lqr.h5 --reference steps.csv", 3, "tracks no coordinate");
    cli_write("track.yaml", TASK "track: [vx]\n");
    cli_expect(control, "train track.yaml --out x.h5", 3, "track: expected a position, not 'vx'");
}

/* ---- what evaluate shows of its runs ---- */

enum { RUNS = 70 /* more than a piece of 64 */, PERIODS = 200, COLUMNS = 8 };
static double table[RUNS * (PERIODS + 1)][COLUMNS]; /* start, t, x, th, vx, w, u, cost; NAN: an empty cell */
static char shown[3000000];

static void read_runs(const char *name, const char *head) {
    assert_true(cli_read(name, shown, sizeof shown) + 1 < sizeof shown);
    char *at = strchr(shown, '\n');
    assert_non_null(at);
    *at++ = '\0';
    assert_string_equal(shown, head);
    for (size_t row = 0; row < LG_COUNT(table); row++)
        for (size_t c = 0; c < COLUMNS; c++, at++) {
            const bool empty = *at == ',' || *at == '\n';
            table[row][c] = empty ? (double)NAN : strtod(at, &at);
            assert_int_equal(*at, c + 1 < COLUMNS ? ',' : '\n');
        }
    assert_int_equal(*at, '\0');
}

/* Follows one run: rows of periods in order, positions that velocities move, a cost that is the task's. */
static double follow_run(size_t run) {
    double cost = 0;
    for (size_t k = 0; k <= PERIODS; k++) {
        const double *row = table[run * (PERIODS + 1) + k];
        assert_true(row[0] == (double)run && fabs(row[1] - 0.05 * (double)k) < 1e-12);
        assert_true((k < PERIODS) == isfinite(row[6]) && (k < PERIODS) == isfinite(row[7]));
        if (k == PERIODS) break;
        for (int c = 2; c < 4; c++)
            assert_close(row[COLUMNS + c] - row[c], 0.025 * (row[2 + c] + row[COLUMNS + 2 + c]), 0.0, 0.05);
        assert_true(fabs(row[6]) <= 10);
        const double stage = 0.1 * row[2] * row[2] + 2 * (1 - cos(row[3])) + 0.01 * row[4] * row[4] +
                             0.02 * row[5] * row[5] + 0.002 * row[6] * row[6];
        assert_close(row[7], 0.05 * stage, 1e-9, 1e-12);
        cost += row[7];
    }
    return cost;
}

static bool stands(size_t run) {
    for (size_t k = PERIODS - 19; k <= PERIODS; k++)
        if (fabs(remainder(table[run * (PERIODS + 1) + k][3], 6.283185307179586)) > 0.1) return false;
    return true;
}

TEST("--runs writes the states, inputs and costs of the runs that are told") {
    need_regulator();
    cli_expect(control, "evaluate lqr.h5 --starts 70 --runs runs.csv --json", 0, "");
    double cost = 0, stood = 0;
    read_runs("runs.csv", "start,t,x,th,vx,w,u,cost");
    for (size_t i = 0; i < RUNS; i++) cost += follow_run(i) / RUNS, stood += stands(i);
    assert_close(json_number(result.out, "cost_mean"), cost, 1e-9, 0.0);
    assert_true(json_number(result.out, "succeeded") == stood && stood > 0 && stood < RUNS);
    cli_expect(control, "evaluate lqr.h5 --starts 70 --runs no/runs.csv", 3, "no/runs.csv");
}

/* Where block `index` of gnuplot's data begins. */
static char *block(char *data, int index) {
    for (; index > 0; index--) {
        data = strstr(data, "\n\n\n");
        assert_non_null(data);
        data += strspn(data, "\n");
    }
    return data;
}

/* Reads the points of a block up to its end; returns how many there are. */
static size_t points(char *at, double (*out)[2], size_t most) {
    size_t n = 0;
    for (; n < most && *at != '\n' && *at != 'n'; n++) {
        out[n][0] = strtod(at, &at), out[n][1] = strtod(at, &at);
        assert_int_equal(*at++, '\n');
    }
    return n;
}

/* Motion ends with an empty line a run, so a block has one more. */
static void stay_around_goal(const char *at, const char *end) {
    for (; at < end; at = strchr(at, '\n') + 1)
        if (*at != '\n') assert_true(fabs(strtod(at, NULL)) <= 3.14160);
}

TEST("--plot shows starts by their end, motion around the goal and the limits of each input") {
    static double failed[RUNS][2], stood[RUNS][2];
    need_regulator();
    cli_expect(control, "evaluate lqr.h5 --starts 70 --runs runs.csv --plot p.svg --json", 0, "");
    if (!cli_exists("p.svg")) assert_says(result.err, "gnuplot");
    const size_t count = (size_t)json_number(result.out, "succeeded");
    read_runs("runs.csv", "start,t,x,th,vx,w,u,cost");
    assert_true(cli_read("p.dat", shown, sizeof shown) + 1 < sizeof shown);
    assert_says(shown, test_text("runs\n=th\n=w\n=%zu failed\n=%zu succeeded\n", RUNS - count, count));
    assert_says(shown, "succeeded\n=-10\n=10\n");
    stay_around_goal(block(shown, 1), block(shown, 3)); /* failed runs tumble */
    const size_t lost = points(block(shown, 3), failed, RUNS), won = points(block(shown, 4), stood, RUNS);
    assert_true(lost == RUNS - count && won == count);
    for (size_t i = 0, a = 0, b = 0; i < RUNS; i++) { /* in the order of the starts */
        const double *row = table[i * (PERIODS + 1)], *drawn = stands(i) ? stood[b++] : failed[a++];
        assert_true(fabs(drawn[0] - remainder(row[3], 6.283185307179586)) < 1e-5 &&
                    fabs(drawn[1] - row[5]) < 1e-5);
    }
    cli_expect(control, "evaluate lqr.h5 --starts 70 --plot p.pdf", 2, ".svg or .png");
}

TEST("the axes of the map of starts do not depend on the unit of length") {
    cli_write(
        "mm.yaml",
        "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: vx}, {name: th, kind: angle, "
        "velocity: w}]\ninputs: {columns: [u]}\nsystem: cart-pole\nparameters: {cart: 1, pole: 0.1, "
        "length: 1000, gravity: 9810}\ninput_map: {kind: known, values: [[1], [0]]}\n");
    cli_write(
        "far.yaml",
        "plant: mm.yaml\nperiod: 0.05\nhorizon: 5\nstarts: {x: [-500, 500], th: [-3.14159, 3.14159], vx: "
        "[-500, 500], w: [-1, 1]}\nlimits: {u: 10000}\ncost: {x: 1e-7, th: 1, vx: 1e-8, w: 0.02, u: "
        "2e-9}\nsuccess: {th: 0.1, hold: 1, within: 10}\ncontroller: {kind: lqr}\n");
    cli_expect(control, "train far.yaml --out far.h5" BRIEFLY, 0, "");
    cli_expect(control, "evaluate far.h5 --starts 10 --plot far.svg", 0, "");
    (void)cli_read("far.dat", shown, sizeof shown);
    assert_says(shown, "=Starts of 10 runs\n=th\n=w\n");
}

TEST("of a rotation the plot shows the angle and the speed, the table its nine numbers") {
    static double far[PERIODS][2];
    cli_write("body.yaml",
              "columns: {time: t}\ncoordinates: [{name: R, kind: rotation, columns: [a, b, c, d], velocity: "
              "[wx, wy, wz]}]\ninputs: {columns: [p, q, r]}\nmass: {kind: known, values: [1, 2, 3]}\n"
              "input_map: {kind: known, values: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}\n");
    cli_write("turn.yaml",
              "plant: body.yaml\nperiod: 0.1\nhorizon: 5\nstarts: {R: [3, 3]}\nlimits: {p: 2, q: "
              "2, r: 2}\ncost: {R: 1, vR: 0.1, p: 0.01, q: 0.01, r: 0.01}\nsuccess: {R: 0.05, "
              "hold: 1, within: 12}\ncontroller: {kind: lqr}\n");
    cli_expect(control, "train turn.yaml --out turn.h5" BRIEFLY, 0, "");
    cli_expect(control, "evaluate turn.h5 --starts 1 --runs turn.csv --plot turn.svg", 0, "");
    (void)cli_read("turn.csv", shown, sizeof shown);
    assert_true(strncmp(shown, "start,t,R.1,R.2,", 16) == 0 &&
                strstr(shown, ",R.9,vR.1,vR.2,vR.3,p,q,r,cost\n"));
    char *at = strchr(shown, '\n') + 1;
    for (int k = 0; k < 120; k++) {
        double row[18];
        for (int c = 0; c < 18; c++, at++) row[c] = strtod(at, &at);
        double stage = 3 - row[2] - row[6] - row[10];
        for (int c = 0; c < 3; c++)
            stage += 0.1 * row[11 + c] * row[11 + c] + 0.01 * row[14 + c] * row[14 + c];
        assert_close(row[17], 0.1 * stage, 1e-9, 1e-9);
    }
    (void)cli_read("turn.dat", shown, sizeof shown);
    assert_int_equal(points(block(shown, 2), far, PERIODS), 121);
    assert_true(fabs(far[0][0] - 3) < 1e-4 && far[0][1] < 1e-6 && far[20][1] > 0.1 && far[120][0] < 0.05);
}

TEST("a plot shows names of velocities and inputs as they are, and runs nothing") {
    /* as YAML writes them, as they are */
    static const char *const names[][2] = {{"''.system(\"touch RAN\").''", "'.system(\"touch RAN\").'"},
                                           {"\"; system \"touch RAN\"; \"7", "\"; system \"touch RAN\"; \"7"},
                                           {"`touch RAN`%s@t_{x}^y\\n", "`touch RAN`%s@t_{x}^y\\n"}};
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        const char *yaml = names[i][0], *name = names[i][1];
        cli_write("named.yaml", test_text("columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: "
                                          "'v%s'}]\ninputs: {columns: ['u%s']}\nmass: {kind: known, values: "
                                          "[1]}\ninput_map: {kind: known, values: [[1]]}\n",
                                          yaml, yaml));
        cli_write("names.yaml",
                  test_text("plant: named.yaml\nperiod: 0.1\nhorizon: 5\nstarts: {x: [-1, 1]}\nlimits: "
                            "{'u%s': 9}\ncost: {x: 1, 'v%s': 1, 'u%s': 1}\nsuccess: {x: 0.5, hold: 1, "
                            "within: 5}\ncontroller: {kind: lqr}\n",
                            yaml, yaml, yaml));
        cli_expect(control, "train names.yaml --out names.h5" BRIEFLY, 0, "");
        cli_expect(control, "evaluate names.h5 --starts 5 --plot names.svg", 0, "");
        if (cli_exists("RAN")) fail_msg("%s ran", name);
        assert_null(strstr(result.err, "gnuplot failed"));
        if (!cli_exists("names.svg")) continue; /* gnuplot is not installed */
        (void)cli_read("names.svg", shown, sizeof shown);
        assert_says(shown, test_text(">v%s</text>", name));
        assert_says(shown, test_text(">u%s</text>", name));
        assert_says(shown, test_text(">Inputs of the first 5 runs: u%s</text>", name));
    }
}

/* make would prefer GNUmakefile and makefile, and a self-test that is newer than its source. */
TEST("the demo runs nothing that was in its folder before") {
    static const char *const files[] = {"GNUmakefile", "makefile", "swingup_test", "swingup.o"};
    cli_needs_programs();
    assert_true(mkdir(cli_at("demo"), 0777) == 0 && mkdir(cli_at("demo/swingup"), 0777) == 0);
    for (size_t i = 0; i < LG_COUNT(files); i++) {
        const char *name = test_text("demo/swingup/%s", files[i]);
        cli_write(name, i < 2 ? "test:\n\ttouch ../../RAN\n" : "#!/bin/sh\ntouch ../../RAN\n");
        assert_int_equal(chmod(cli_at(name), 0777), 0);
        const struct timespec late[2] = {{.tv_sec = 4102444800}, {.tv_sec = 4102444800}};
        assert_int_equal(utimensat(AT_FDCWD, cli_at(name), late, 0), 0);
        if (i == 0) continue; /* the demo finds both makefiles */
        cli_expect(control, "demo --out demo --seconds 0.2", i < 2 ? 0 : 3, i < 2 ? "" : files[i]);
        if (cli_exists("RAN")) fail_msg("%s ran", files[i]);
        cli_unlink(name);
    }
    assert_int_equal(system(test_text("rm -r '%s/demo'", cli_folder)), 0);
}

TEST_GROUP(setup, cli_end)

/* A cart with a motor of 6 N per volt behind a lag of .06 s, friction of 4 N, and inputs that act late. */
static void write_truck(const char *name, double mass, double lag, unsigned delay, const char *width) {
    cli_write(name,
              test_text("columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: "
                        "{columns: [u], lag: %.17g, delay: %u}\nmass: {kind: known, values: [%.17g]}\n"
                        "damping: [{kind: known, values: [2]}, {kind: coulomb, values: [4]%s}]\n"
                        "input_map: {kind: known, values: [6]}\n",
                        lag, delay, mass, width));
}

static void write_truck_task(const char *name, const char *plant, int within, const char *more) {
    cli_write(name,
              test_text("plant: %s\nperiod: 0.05\nhorizon: 5\nstarts: {x: [-1, 1], v: [-0.5, 0.5]}\nlimits: "
                        "{u: 5}\ncost: {x: 1, v: 0.1}\nsuccess: {x: 0.01, hold: 1, within: %d}\n"
                        "controller: {kind: lqr}\n%s",
                        plant, within, more));
}

/* The success of a row of `robustness`; -1: there is no such row. */
static double robustness_of(const char *json, const char *name, const char *factor) {
    const char *at = strstr(json, test_text("\"name\": \"%s\", \"factor\": %s", name, factor));
    if (at == NULL) at = strstr(json, test_text("\"name\":\"%s\",\"factor\":%s", name, factor));
    return at == NULL ? -1 : atof(strstr(at, "success") + 9);
}

TEST("train tells what a change of each number does, as evaluate finds it on the changed machine") {
    write_truck("truck.yaml", 10, 0.06, 2, "");
    write_truck("heavy.yaml", 12, 0.06, 2, "");
    write_truck("lazy.yaml", 10, 0.1, 2, "");
    write_truck_task("truck_task.yaml", "truck.yaml", 8, "integral: [x]\n");
    cli_expect(control, "train truck_task.yaml --out truck.h5 --json --robustness 30 --optimality-gap 0", 0,
               "");
    const double heavy = robustness_of(result.out, "mass", "1.2"),
                 lazy = robustness_of(result.out, "lag", "1.6666666666666667");
    static const char *const names[] = {"mass", "lag", "damping", "coulomb", "input_map"},
                             *const factors[] = {"0.8", "0.9", "1.1", "1.2"};
    for (size_t i = 0; i < LG_COUNT(names); i++)
        for (size_t k = 0; k < LG_COUNT(factors); k++) {
            const double success = robustness_of(result.out, names[i], factors[k]);
            assert_true(success >= 0 && success <= 1);
        }
    assert_true(robustness_of(result.out, "mass", "1.6666666666666667") == -1);
    cli_expect(control, "evaluate truck.h5 --plant heavy.yaml --starts 30 --json", 0, "");
    assert_close(json_number(result.out, "success"), heavy, 0, 1e-9);
    cli_expect(control, "evaluate truck.h5 --plant lazy.yaml --starts 30 --json", 0, "has another lag");
    assert_close(json_number(result.out, "success"), lazy, 0, 1e-9);
}

TEST("friction sticks whatever its width in the file, and inputs act late in all commands") {
    double success[2];
    static const char *const widths[] = {"", ", width: 0.3"};
    for (int i = 0; i < 2; i++) {
        write_truck("wide.yaml", 10, 0.06, 0, widths[i]);
        write_truck_task("wide_task.yaml", "wide.yaml", 3, "");
        cli_expect(control, "train wide_task.yaml --out wide.h5 --json" BRIEFLY, 0, "");
        success[i] = json_number(result.out, "success");
        assert_true(robustness_of(result.out, "mass", "1.2") == -1);
    }
    assert_close(success[1], success[0], 0, 1e-9);
    print_message("success %g\n", success[0]);
    assert_true(success[0] < 0.9); /* the regulator alone stops before the goal, and train says so */
    assert_non_null(strstr(result.out, "of the starts succeed"));
    write_truck("late.yaml", 10, 0.06, 12, "");
    cli_expect(control, "evaluate truck.h5 --plant late.yaml --starts 30 --json", 0, "");
    assert_true(json_number(result.out, "success") < 0.5);
    cli_expect(control, "certify truck.h5 --box x=1,v=1", 2, "as where dry friction sticks");
    cli_expect(control, "certify truck.h5 --box x=1,v=1 --continuous", 2,
               "--loop continuous: the input u acts late");
    write_truck("open.yaml", 10, 0.06, 0, "");
    cli_write("auto.yaml", "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: "
                           "{columns: [u], delay: auto}\nmass: {kind: known, values: [1]}\ninput_map: {kind: "
                           "known, values: [1]}\n");
    write_truck_task("auto_task.yaml", "auto.yaml", 8, "");
    cli_expect(control, "train auto_task.yaml --out x.h5", 3, "the delay of the input u is unknown");
    write_truck_task("bad_task.yaml", "truck.yaml", 8, "compensate: true\nintegral: [v]\n");
    cli_expect(control, "train bad_task.yaml --out x.h5", 3, "integral: expected a position, not 'v'");
}

/* Two links with a motor at the shoulder, like a pendubot, after a training that is far too short. */
TEST("train warns where a controller costs much more than the best inputs that a search finds") {
    static const char rows[] = "\"optimality_gap\"";
    cli_write("arm.yaml",
              "columns: {time: t}\ncoordinates: [{name: a, kind: angle, velocity: va}, {name: b, kind: "
              "angle, velocity: vb}]\ninputs: {columns: [u]}\nsystem: two-link-arm\ninput_map: {kind: "
              "known, values: [[1], [0]]}\n");
    cli_write("arm_task.yaml",
              "plant: arm.yaml\ngoal: {a: 3.14159265358979}\nperiod: 0.05\nhorizon: 4\nlimits: {u: 20}\n"
              "starts: {a: [-3.14159, 3.14159], b: [-0.5, 0.5], va: [-0.5, 0.5], vb: [-0.5, 0.5]}\n"
              "cost: {a: 1, b: 1, va: 0.02, vb: 0.02, u: 0.0005}\n"
              "success: {a: 0.1, b: 0.1, hold: 1, within: 10}\n");
    for (int gap = 8; gap >= 0; gap -= 8) {
        cli_expect(
            control,
            test_text("train arm_task.yaml --out arm.h5 --json --robustness 0 --seeds 2 --race %d --finish 0 "
                      "--polish 0 --optimality-gap %d",
                      gap > 0 ? 60 : 2, gap),
            0, "");
        const char *warning = strstr(result.out, "times as much as the best inputs found"),
                   *at = strstr(result.out, rows);
        assert_true((warning != NULL) == (gap > 0));
        assert_non_null(at);
        double largest = 0;
        for (int i = 0; i < gap; i++) {
            at = strstr(at, test_text("{\"start\": %d,", i));
            assert_non_null(at);
            const double cost = json_number(at, "cost"), best = json_number(at, "best"),
                         ratio = json_number(at, "ratio");
            assert_true(best > 0 && best <= cost);
            assert_close(ratio, cost / best, 1e-12, 0);
            largest = fmax(largest, ratio);
        }
        if (gap == 0) break;
        assert_true(largest > 1.5);
        assert_says(result.out, test_text("%.3g times as much", largest));
    }
    cli_expect(control, "train lqr.yaml --out lqr.h5 --robustness 0 --optimality-gap 3", 0, "");
    assert_says(result.out, "cost from 3 starts over the cost of the best inputs found: median ");
    cli_expect(control, "train lqr.yaml --out lqr.h5 --optimality-gap 101", 2, "--optimality-gap");
}

/* lg-identify fit with short logs and few epochs. Each row of the table has a machine and options for which
 * the fit runs other code. ctest-labels: apps/lg-identify src/machine */
#include "cli_support.h"

#define LINE  "coordinates: [{name: x, kind: line, velocity: v}]\ncolumns: {run: run}\n"
#define INPUT "inputs: {columns: [u, w], hold: zero}\n"
#define LAW   "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n"
#define MAP   "input_map: {kind: known, values: [[1, -0.5]]}\n"
#define ROD                                                                                                  \
    "coordinates: [{name: d, kind: direction, columns: [a, b, c], velocity: [e, f, g]},\n"                   \
    "  {name: x, kind: line, velocity: v}, {name: y, kind: line, velocity: w}]\ncolumns: {run: run}\n"

/* Two machines: an oscillator with two inputs; a rod and two coordinates along lines. */
static const char oscillator[] = LINE INPUT
    "mass: {kind: known, values: [2]}\npotential: {kind: known, form: quadratic, of: x, values: 4}\n"
    "damping: {kind: known, values: [0.3]}\n" MAP;
static const char rod[] = ROD "mass: {kind: known, values: [2, 2, 2, 1, 3]}\n"
                              "potential: [{kind: known, form: gravity, of: d, values: 9},\n"
                              "  {kind: known, form: quadratic, of: [x, y], values: [1, 0.5, 2]}]\n";

static const struct {
    const char *machine, *log, *options;
    int code;
    const char *words; /* in the output or the messages */
} rows[] = {
    {LINE INPUT LAW MAP, "all.csv", "", 0, "potential.x^2"},
    {LINE INPUT LAW MAP, "all.csv", "--window 5 --stride 30", 0, "potential.x^2"},
    {LINE INPUT LAW MAP, "all.csv", "--validation-part 0.3 --select free-run --json", 0,
     "\"select\": {\"windows\": "},
    {LINE INPUT LAW MAP, "all.csv", "--size 4", 2, "--size: this machine has no network"},
    {LINE INPUT LAW MAP, "few.csv", "--select free-run", 3,
     "few.csv: the log is too short to hold out windows for --select"},
    {LINE INPUT LAW MAP, "few.csv", "--suggest -", 3,
     "few.csv: the log is too short to hold out windows for --suggest"},
    {LINE INPUT "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: [diagonal, coulomb]\n" MAP,
     "all.csv", "--integrator variational", 0, "coulomb.x"},
    {LINE INPUT LAW "input_map: {kind: network, of: x, hidden: [2]}\n", "few.csv", "--size auto --json", 0,
     "\"size\": \"4\""},
    {LINE INPUT
     "mass: {kind: network, of: x, hidden: [2]}\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n"
     "input_map: {kind: network, of: x, hidden: [2]}\n",
     "all.csv", "", 0, "nothing fixes the common factor"},
    {LINE "inputs: {columns: [u, w], hold: zero, lag: [unknown, 0.04]}\n" LAW MAP, "all.csv", "--json", 0,
     "0.04]"},
    {LINE "inputs: {columns: [u, w], hold: auto, delay: [auto, 0]}\n" LAW MAP, "all.csv", "", 0,
     "the log is too short to choose how the inputs act: hold zero and no delay are taken"},
    {LINE "inputs: {columns: [u, w], hold: zero, delay: [estimate, 0]}\n" LAW MAP, "all.csv", "", 0,
     "potential.x^2"},
    {"measured: positions\ncoordinates: [{name: x, kind: line}]\ncolumns: {run: run}\n"
     "inputs: {columns: [u, w], delay: estimate}\n" LAW MAP,
     "all.csv", "", 3, "`delay: estimate` needs velocities: log them, or give `delay: auto` or a number"},
    {"measured: velocities-only\n" LINE INPUT "mass: diagonal\ndamping: diagonal\n" MAP, "all.csv", "", 0,
     "damping.x"},
    {"noise: {x: 0.01, v: 0.02}\n" LINE INPUT LAW MAP, "all.csv", "", 0, "potential.x^2"},
    {LINE INPUT "mass: diagonal\npotential: {kind: quadratic, of: x}\n"
                "damping: [diagonal, {kind: network, of: x, hidden: [2]}]\n" MAP,
     "all.csv", "--validation-part 0.3", 0, "potential.x^2"},
    {"measured: positions\ncoordinates: [{name: d, kind: direction, columns: [a, b, c]}, {name: x, kind: "
     "line},\n"
     "  {name: y, kind: line}]\ncolumns: {run: run}\nmass: {kind: known, values: [2, 2, 2, 1, 3]}\n"
     "potential: [gravity, {kind: quadratic, of: [x, y]}]\n",
     "rod.csv", "", 0, "potential.d.height"},
    {LINE INPUT "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: lugre\n" MAP, "few.csv", "", 0,
     "bristle_stiffness.x"},
    {ROD "mass: [{kind: network, of: [d, x], hidden: [2]}, {kind: known, values: [2, 2, 2, 0.1, 0.1]}]\n"
         "potential: [gravity, {kind: quadratic, of: [x, y]}]\n",
     "rod.csv", "", 0, "mass: of a network, at d "},
};

static void generate(const char *machine, const char *log, const char *options) {
    cli_write("scene.yaml", machine);
    cli_expect("lg-identify", test_text("generate scene.yaml --out %s --dt 0.05 %s", log, options), 0, "");
}

TEST("fit learns from short logs, or refuses them and says why, for every row of the table") {
    cli_test_folder();
    generate(oscillator, "all.csv", "--runs 3 --t-end 3 --inputs steps:0.3");
    generate(oscillator, "few.csv", "--runs 1 --t-end 1.4 --inputs steps:0.3");
    generate(rod, "rod.csv", "--runs 3 --t-end 3");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_write("m.yaml", rows[i].machine);
        cli_run_limited(
            "lg-identify",
            test_text("fit m.yaml %s --out m.h5 --epochs 2 --threads 1 %s", rows[i].log, rows[i].options), 0);
        if (result.code != rows[i].code ||
            (strstr(result.out, rows[i].words) == NULL && strstr(result.err, rows[i].words) == NULL))
            fail_msg("row %zu: exit code %d\n%s%s", i, result.code, result.out, result.err);
        assert_true(cli_exists("m.h5") == (result.code == 0));
        if (cli_exists("m.h5")) cli_unlink("m.h5");
    }
}

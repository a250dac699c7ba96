/* ctest-labels: slow apps/lg-identify src/machine src/nn
 * Runs lg-identify fit on logs of every kind of friction. LG_FRICTION_SEEDS=30 fits 30 logs of each kind. */
#include <stdlib.h>

#include "identify_support.h"

#define HEAD                                                                                                 \
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: {columns: [u]}\n"        \
    "input_map: {kind: known, values: [1]}\n"
#define TRUTH HEAD "mass: {kind: known, values: [2]}\n"
#define MODEL HEAD "mass: diagonal\n"

/* A machine of mass 2, the model that is fitted (with the width of the truth, then with one from the log),
 * and the numbers that must be found within `part` of their size and three standard errors. */
static const struct {
    const char *kind, *truth, *model;
    double part;
    struct {
        const char *name;
        double value;
    } numbers[5];
} rows[] = {
    {"asymmetric",
     TRUTH "damping: [{kind: coulomb, values: [0.5], width: 0.01}, {kind: asymmetric, values: "
           "[[0.8], [-0.2]], width: 0.01}]\noffset: {kind: known, values: [0.3]}\n",
     MODEL "damping: [diagonal, {kind: coulomb%1$s}, {kind: asymmetric%1$s}]\noffset: unknown\n",
     0.05,
     {{"mass.1.1", 2}, {"damping.x", 0.8}, {"asymmetric.x", -0.2}, {"coulomb.x", 0.5}, {"offset.x", 0.3}}},
    {"stribeck",
     TRUTH "damping: [{kind: known, values: [0.3]}, {kind: stribeck, values: [[0.8], [1.4], [0.2]], "
           "width: 0.01}]\n",
     MODEL "damping: [diagonal, {kind: coulomb%1$s}, {kind: stribeck%1$s}]\n",
     0.05,
     {{"mass.1.1", 2}, {"coulomb.x", 0.8}, {"breakaway.x", 1.4}, {"stribeck_speed.x", 0.2}}},
    {"cubic",
     TRUTH "damping: [{kind: known, values: [0.5]}, {kind: cubic, values: [0.05]}]\n",
     MODEL "damping: [diagonal, cubic] #%1$s\n",
     0.05,
     {{"mass.1.1", 2}, {"damping.x", 0.5}, {"cubic.x", 0.05}}},
    {"load",
     TRUTH "damping: [{kind: known, values: [0.5]}, {kind: load, of: u, values: [[0.5], [0.2]], width: "
           "0.01}]\n",
     MODEL "damping: [diagonal, {kind: coulomb%1$s}, {kind: load, of: u%1$s}]\n",
     0.05,
     {{"mass.1.1", 2}, {"coulomb.x", 0.5}, {"load.x", 0.2}}},
    {"position",
     TRUTH "damping: [{kind: known, values: [0.5]}, {kind: position, of: x, values: [[0.8], [0.1]], width: "
           "0.01}]\npotential: {kind: known, form: quadratic, of: x, values: [0.5]}\n",
     MODEL "damping: [diagonal, {kind: coulomb%1$s}, {kind: position, of: x%1$s}]\n"
           "potential: {kind: known, form: quadratic, of: x, values: [0.5]}\n",
     0.05,
     {{"mass.1.1", 2}, {"coulomb.x", 0.8}, {"position.x", 0.1}}},
};

static int seeds(void) {
    const char *text = getenv("LG_FRICTION_SEEDS");
    return text != NULL ? atoi(text) : 3;
}

/* Whether the numbers that were found are near the true ones. */
static bool found(size_t row) {
    bool near = true;
    const char *numbers = json_find(result.out, "identified");
    for (size_t i = 0; i < LG_COUNT(rows[row].numbers) && rows[row].numbers[i].name != NULL; i++) {
        const char *number = json_find(numbers, rows[row].numbers[i].name);
        if (number == NULL) fail_msg("%s is not identified: %s", rows[row].numbers[i].name, result.out);
        const double value = json_number(number, "value"), truth = rows[row].numbers[i].value;
        if (!isfinite(value)) fail_msg("%s is not finite", rows[row].numbers[i].name);
        near = near && fabs(value - truth) <= rows[row].part * fabs(truth) + 3 * json_number(number, "error");
    }
    return near;
}

TEST("fits from default starts stay finite with every kind of friction, and find its numbers") {
    const int all = seeds();
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        int right = 0;
        cli_write("truth.yaml", rows[i].truth);
        cli_write("model.yaml", test_text(rows[i].model, ", width: 0.01"));
        cli_write("narrow.yaml", test_text(rows[i].model, ""));
        for (int seed = 1; seed <= all; seed++) {
            cli_run(identify,
                    "generate truth.yaml --inputs multisine --amplitude 8 --noise 0.0005,0.002 "
                    "--runs 1 --t-end 12 --dt 0.01 --seed %d --out log.csv",
                    seed);
            cli_json(identify, "fit model.yaml log.csv --out m.h5", "loss >0");
            right += found(i);
            if (seed > 1) continue;
            cli_json(identify, "fit narrow.yaml log.csv --out m.h5", "loss >0");
            (void)found(i);
        }
        printf("%s: %d of %d\n", rows[i].kind, right, all);
        assert_true(3 * right >= 2 * all);
    }
}

TEST("names of coordinates and velocities make an offset; what is neither is refused") {
    cli_write("truth.yaml", rows[0].truth);
    cli_run(identify, "generate truth.yaml --runs 1 --t-end 2 --out log.csv");
    static const char *const ways[] = {"[x]", "v", "{kind: unknown, of: x}", "unknown"};
    for (size_t i = 0; i < LG_COUNT(ways); i++) {
        cli_write("model.yaml", test_text(MODEL "damping: diagonal\noffset: %s\n", ways[i]));
        cli_json(identify, "fit model.yaml log.csv --out m.h5 --epochs 1", "parameters 3");
        assert_non_null(json_find(json_find(result.out, "identified"), "offset.x"));
    }
    cli_write("model.yaml", MODEL "offset: [y]\n");
    cli_expect(identify, "check model.yaml log.csv", 3, "'y' is neither a kind");
}

TEST("substeps are doubled until steps come to rest; a width from the log is a thousandth of the largest "
     "speed") {
    cli_write("truth.yaml", TRUTH "damping: {kind: coulomb, values: [2], width: 0.01}\n");
    cli_write("model.yaml", MODEL "damping: {kind: coulomb, width: 0.01}\n");
    cli_run(identify,
            "generate truth.yaml --runs 1 --inputs multisine --amplitude 8 --noise 0.0005,0.002 --t-end 20 "
            "--dt 0.05 --out log.csv");
    cli_json(identify, "fit model.yaml log.csv --out m.h5", "loss >0");
    /* 0.05 s c/(M w) = 5 */
    const uint32_t substeps = cli_machine_model("m.h5")->run.substeps;
    assert_true(substeps >= 5 && substeps <= 10);
    cli_write("model.yaml", MODEL "damping: coulomb\n");
    cli_json(identify, "fit model.yaml log.csv --out m.h5 --epochs 1", "loss >0");
    const lg_machine *machine = &cli_machine_model("m.h5")->run.machine;
    assert_close(lg_machine_width(machine, &machine->terms[1], 0), 1e-3 * machine->scales.fastest[0], 1e-15,
                 0);
    assert_true(machine->scales.fastest[0] < 15.0 && machine->scales.fastest[0] > 1.0);
}

TEST("a prior decides what the log leaves open, and its sigma becomes the error") {
    cli_write("truth.yaml", TRUTH "damping: {kind: known, values: [0.5]}\n");
    cli_run(identify,
            "generate truth.yaml --runs 1 --inputs multisine --amplitude 8 --noise 0.0005,0.002 --t-end 20 "
            "--dt 0.02 --out log.csv");
    cli_write("model.yaml",
              "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\n"
              "inputs: {columns: [u]}\ninput_map: {kind: known, values: [{within: [0.1, 40]}]}\n"
              "mass: {kind: diagonal, values: [{start: 3, sigma: 0.3}]}\n"
              "damping: {kind: diagonal, values: [unknown]}\n");
    cli_json(identify, "fit model.yaml log.csv --out m.h5", "loss >0, parameters 3");
    const char *mass = json_find(json_find(result.out, "identified"), "mass.1.1"),
               *map = json_find(json_find(result.out, "identified"), "input_map.1.1");
    assert_close(json_number(mass, "value"), 3, 1e-3, 0);
    assert_close(json_number(mass, "error"), 0.3, 0.05, 0);
    assert_close(json_number(map, "value"), 1.5, 0.01, 0);
    cli_write("model.yaml", MODEL "damping: {kind: diagonal, values: [{start: 0.1, within: [0.05, 0.2]}]}\n");
    cli_json(identify, "fit model.yaml log.csv --out m.h5", "loss >0, parameters 2");
    assert_close(json_number(json_find(json_find(result.out, "identified"), "damping.x"), "value"), 0.2, 0.01,
                 0);
}

static int setup(void **state) {
    (void)state;
    return cli_begin();
}

TEST_GROUP(setup, cli_end)

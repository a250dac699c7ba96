/* ctest-labels: slow apps/lg-identify src/machine
 * Runs lg-identify on logs that measure accelerations alone: numbers and their errors, free runs over logs
 * that the fit did not see, what cannot be known, and what is refused. */
#include "identify_support.h"

#define COLUMNS "columns: {time: t, run: run}\nmeasured: accelerations\n"
#define LINE                                                                                                 \
    COLUMNS "coordinates:\n  - {name: x, kind: line, acceleration: ax}\ninputs: {columns: [u], hold: "       \
            "zero}\n"
#define ANGLE COLUMNS "coordinates:\n  - {name: th, kind: angle, acceleration: ath}\n"
#define TWO                                                                                                  \
    COLUMNS "coordinates:\n  - {name: q1, kind: angle, acceleration: a1}\n  - {name: q2, kind: angle, "      \
            "acceleration: a2}\ninputs: {columns: [u, w], hold: zero}\nsystem: two-link-arm\n"
#define PUSHED "input_map: {kind: known, values: [[1]]}\n"
#define BOTH   "input_map: {kind: known, values: [[1, 0], [0, 1]]}\n"

/* A number of the machine, and its true value. */
typedef struct truth {
    const char *name;
    double value;
} truth;

/* A machine whose numbers are learned from a log of noisy accelerations, and judged on another one. */
typedef struct example {
    const char *name, *scene, *machine, *how;
    double noise;
    truth numbers[5];
} example;

static const example examples[] = {
    {"a mass, a spring and a damper, and a sensor with a bias",
     LINE "mass: {kind: known, values: [2]}\npotential: {kind: known, form: quadratic, of: x, values: [25]}\n"
          "damping: {kind: known, values: [1.2]}\n" PUSHED,
     LINE "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n"
          "bias: {kind: constant, of: ax}\n" PUSHED,
     "--amplitude 6 --dt 0.01",
     0.08,
     {{"mass.1.1", 2}, {"potential.x^2", 25}, {"damping.x", 1.2}, {"bias.x.acceleration", 0}}},
    {"a pendulum that swings far",
     ANGLE
     "mass: {kind: known, values: [1]}\npotential: {kind: known, form: gravity, of: th, values: [0, -9]}\n"
     "damping: {kind: known, values: [0.15]}\n",
     ANGLE "mass: {kind: known, values: [1]}\npotential: {kind: gravity, of: th, values: [0, unknown]}\n"
           "damping: diagonal\n",
     "--start-spread 1.6,2 --dt 0.01",
     0.1,
     {{"potential.cos(th)", -9}, {"damping.th", 0.15}}},
    {"an arm of two links",
     TWO "parameters: {masses: [1, 0.7], centres: [0.25, 0.2], inertia: [0.02, 0.01], length: 0.5}\n"
         "damping: {kind: known, values: [0.08, 0.05]}\n" BOTH,
     TWO "parameters: {masses: [1, 0.7], centres: unknown, inertia: [0.02, 0.01], length: unknown}\n"
         "damping: diagonal\n" BOTH,
     "--amplitude 0.5,0.1 --start-spread 0.6,1 --dt 0.01",
     0.3,
     {{"c1", 0.25}, {"c2", 0.2}, {"L", 0.5}, {"damping.q1", 0.08}, {"damping.q2", 0.05}}}};

static int setup(void **state) {
    return cli_begin();
}

/* Writes the two logs of an example. */
static void generate(const example *e) {
    cli_forget("log1.csv log2.csv p.csv");
    cli_write("scene.yaml", e->scene);
    cli_write("machine.yaml", e->machine);
    for (int seed = 1; seed <= 2; seed++)
        cli_run(identify, "generate scene.yaml --runs 2 --t-end 10 %s --noise 0,%g --seed %d --out log%d.csv",
                e->how, e->noise, seed, seed);
}

TEST("numbers are learned from accelerations alone, within the stated errors, and predict another log") {
    for (size_t i = 0; i < LG_COUNT(examples); i++) {
        const example *e = &examples[i];
        generate(e);
        cli_json(identify, "fit machine.yaml log1.csv --out m.h5", "windows >5");
        expect_known_range("m.h5");
        if (strstr(result.err, "does not explain") != NULL) fail_msg("%s: %s", e->name, result.err);
        if (strstr(result.err, "cannot be known") != NULL) fail_msg("%s: %s", e->name, result.err);
        const char *numbers = json_find(result.out, "identified");
        for (const truth *t = e->numbers; t < e->numbers + LG_COUNT(e->numbers) && t->name != NULL; t++) {
            const char *number = json_find(numbers, t->name);
            if (number == NULL) fail_msg("%s: %s is not identified: %s", e->name, t->name, result.out);
            const double value = json_number(number, "value"), error = json_number(number, "error");
            if (!(fabs(value - t->value) <= 3.5 * error && error < 0.05 * fmax(1, fabs(t->value))))
                fail_msg("%s: %s is %g +- %g", e->name, t->name, value, error);
        }
        cli_json(identify, "evaluate m.h5 log2.csv --horizons 1 --every 100", "");
        double found[1] = {NAN};
        const char *horizon = strchr(json_find(result.out, "horizons"), '{');
        found[0] = json_number(horizon, "acceleration");
        if (!(found[0] > 0.8 * e->noise && found[0] < 1.3 * e->noise))
            fail_msg("%s: an error of %g over 1 s, the noise is %g", e->name, found[0], e->noise);
        assert_true(isnan(json_number(horizon, "line")) && isnan(json_number(horizon, "velocity")));
    }
}

TEST("the bias of a sensor is learned together with a spring, and predictions have the columns of the log") {
    double logged[1200], predicted[1200];
    generate(&examples[0]);
    cli_write("biased.yaml", test_text("%s", examples[0].machine));
    /* The log of another sensor: the accelerations are 0.5 larger. */
    const size_t rows = csv_column("log1.csv", "ax", logged, LG_COUNT(logged));
    cli_json(identify, "fit biased.yaml log1.csv --out m.h5", "");
    cli_json(identify, "predict m.h5 log1.csv --out p.csv", "");
    assert_int_equal(csv_column("p.csv", "ax", predicted, LG_COUNT(predicted)), rows);
    double sum = 0, size = 0;
    for (size_t i = 300; i < 1000; i++)
        sum += (logged[i] - predicted[i]) * (logged[i] - predicted[i]), size += logged[i] * logged[i];
    assert_close(sqrt(sum / 700), 0.08, 0.1, 0);
    assert_true(size > 100 * sum);
}

TEST("accelerations of a prediction, and guessed states, are not compared with the range of states") {
    generate(&examples[0]);
    cli_run(identify, "fit machine.yaml log1.csv --out m.h5");
    cli_run(identify, "predict m.h5 log1.csv --out p.csv");
    if (strstr(result.err, "outside the training data") != NULL) fail_msg("%s", result.err);
    cli_run(identify, "evaluate m.h5 log1.csv --horizons 1");
    if (strstr(result.err, "outside the training data") != NULL) fail_msg("%s", result.err);
}

TEST("what accelerations do not show is said: the zero of a position, and where a free mass is") {
    generate(&examples[0]);
    cli_write("open.yaml", LINE "mass: diagonal\npotential: {kind: polynomial, of: x, degree: 2}\n"
                                "damping: diagonal\n" PUSHED);
    cli_run(identify, "fit open.yaml log1.csv --out m.h5");
    assert_says(result.err, "do not determine potential.x: ");
    assert_says(result.err, "do not show which position is 0");
    cli_write("scene.yaml",
              LINE "mass: {kind: known, values: [3]}\ndamping: {kind: known, values: [0.6]}\n" PUSHED);
    cli_run(identify, "generate scene.yaml --runs 2 --t-end 10 --dt 0.02 --noise 0,0.02 --out free.csv");
    cli_write("free.yaml", LINE "mass: diagonal\ndamping: diagonal\n" PUSHED);
    cli_run(identify, "fit free.yaml free.csv --out m.h5");
    assert_says(result.err, "where x is cannot be known");
}

TEST("machines and commands that accelerations alone do not suffice for are refused") {
    static const struct {
        const char *text, *words;
    } wrong[] = {
        {"measured: accelerations\ncoordinates: [{name: x, kind: line, columns: x, acceleration: ax}]\n"
         "mass: diagonal\n",
         "columns of positions are not allowed with `measured: accelerations`"},
        {"measured: accelerations\ncoordinates: [{name: x, kind: line, velocity: ax}]\nmass: diagonal\n",
         "velocity: this key is not allowed with `measured: accelerations`"},
        {"coordinates: [{name: x, kind: line, velocity: vx, acceleration: ax}]\nmass: diagonal\n",
         "acceleration: this key is not allowed with `measured: velocities`"},
        {"measured: accelerations\ncoordinates: [{name: x, kind: line}]\nmass: diagonal\n",
         "key 'acceleration' is missing"},
        {"measured: accelerations\ncoordinates: [{name: r, kind: rotation, acceleration: [a, b, c]}]\n"
         "mass: diagonal\n",
         "does not take this key"},
        {LINE "mass: diagonal\nbias: {kind: constant, of: x.velocity}\n" PUSHED,
         "name the column of an acceleration"},
        {LINE "mass: diagonal\nresidual: {kind: polynomial, degree: 2, of: ax}\n" PUSHED, "'ax' is unknown"}};
    generate(&examples[0]);
    for (size_t i = 0; i < LG_COUNT(wrong); i++) {
        cli_write("wrong.yaml", wrong[i].text);
        cli_expect(identify, "fit wrong.yaml log1.csv --out m.h5", 3, wrong[i].words);
    }
    cli_expect(identify, "fit machine.yaml log1.csv --starts measured --out m.h5", 2,
               "do not have the states");
    cli_json(identify, "fit machine.yaml log1.csv --out m.h5", "");
    cli_expect(identify, "adapt m.h5 log2.csv --seconds 3 --out n.h5", 2, "accelerations alone");
}

TEST_GROUP(setup, cli_end)

/* ctest-labels: slow apps/lg-identify src/machine
 * Fits of simulated actuators: lags, dead zones and curves; models with a lag in all commands. */
#include "identify_support.h"

#define MOTOR(actuator)                                                                                      \
    "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"                  \
    "inputs: {columns: [u], " actuator "}\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n"         \
    "mass: diagonal\ninput_map: {kind: known, values: [[1]]}\n"
#define TRUE_MOTOR(actuator)                                                                                 \
    "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"                  \
    "inputs: {columns: [u], " actuator "}\nmass: {kind: known, values: [2]}\n"                               \
    "potential: {kind: known, form: quadratic, of: x, values: [3]}\n"                                        \
    "damping: {kind: known, values: [0.8]}\ninput_map: {kind: known, values: [[1]]}\n"

static const struct {
    const char *truth, *machine;
    struct {
        const char *name;
        double value;
    } numbers[3];
} cases[] = {
    {TRUE_MOTOR("lag: 0.02"), MOTOR("hold: zero, lag: unknown"), {{"lag.u", 0.02}}},
    {TRUE_MOTOR("lag: 0.3"), MOTOR("lag: unknown"), {{"lag.u", 0.3}}},
    {TRUE_MOTOR("hold: linear, lag: 0.1"), MOTOR("hold: linear, lag: unknown"), {{"lag.u", 0.1}}},
    {TRUE_MOTOR("lag: {order: 2, value: 0.05}"), MOTOR("lag: {order: 2}"), {{"lag.u", 0.05}}},
    {TRUE_MOTOR("curve: {dead_zone: 1}"), MOTOR("curve: {dead_zone: unknown}"), {{"dead_zone.u", 1}}},
    {TRUE_MOTOR("lag: 0.1, curve: {degree: 3, values: [0.05, -0.01]}"),
     MOTOR("lag: unknown, curve: {degree: 3}"),
     {{"lag.u", 0.1}, {"curve.u.2", 0.05}, {"curve.u.3", -0.01}}},
};

static void generate(const char *truth, const char *log, int seed) {
    cli_write("truth.yaml", truth);
    cli_run(identify,
            "generate truth.yaml --inputs steps:0.3 --amplitude 4 --t-end 20 --dt 0.01 --noise 0.002,0.01 "
            "--runs 1 --seed %d --out %s",
            seed, log);
}

TEST("lags of two to thirty rows, dead zones and curves are found within three stated errors") {
    cli_test_folder();
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        generate(cases[i].truth, "log.csv", 3);
        cli_write("machine.yaml", cases[i].machine);
        cli_json(identify, "fit machine.yaml log.csv --out m.h5", "parameters >3");
        const char *numbers = json_find(result.out, "identified");
        for (size_t k = 0; k < 3 && cases[i].numbers[k].name != NULL; k++) {
            const char *number = json_find(numbers, cases[i].numbers[k].name);
            if (number == NULL) fail_msg("%s is not identified: %s", cases[i].numbers[k].name, result.out);
            const double error = json_number(number, "error"), truth = cases[i].numbers[k].value;
            assert_true(error > 0 && error < 0.2 * fabs(truth));
            assert_close(json_number(number, "value"), truth, 0, 3 * error);
        }
    }
}

TEST("a log without a lag says so") {
    cli_test_folder();
    generate(TRUE_MOTOR("lag: none"), "log.csv", 4);
    cli_write("machine.yaml", MOTOR("lag: unknown"));
    cli_json(identify, "fit machine.yaml log.csv --out m.h5", "loss *");
    assert_says(result.err, "no lag that the log shows");
    const char *lag = json_find(result.out, "lag");
    assert_true(json_number(lag, "chosen") < 0.01);
    assert_says(json_find(lag, "warning"), "\"no lag that the log shows\"");
}

TEST("a lag below the step is not called shown by the log, however small its error is") {
    cli_test_folder();
    cli_write("truth.yaml", TRUE_MOTOR("lag: 0.006"));
    cli_run(identify,
            "generate truth.yaml --inputs steps:0.3 --amplitude 4 --t-end 20 --dt 0.01 --noise 0.0002,0.001 "
            "--runs 1 --seed 4 --out log.csv");
    cli_write("machine.yaml", MOTOR("lag: unknown"));
    cli_json(identify, "fit machine.yaml log.csv --out m.h5", "loss *");
    assert_says(result.err, "no lag that the log shows");
    const char *lag = json_find(json_find(result.out, "identified"), "lag.u");
    assert_true(json_number(lag, "value") < 0.01);
    assert_true(2 * json_number(lag, "error") < json_number(lag, "value"));
    assert_says(json_find(json_find(result.out, "lag"), "warning"), "\"no lag that the log shows\"");
}

TEST("the lag that was chosen is told with the losses of all starts") {
    static const char *const starts[] = {"0.02", "0.05", "0.1", "0.3"};
    cli_test_folder();
    generate(TRUE_MOTOR("lag: 0.1"), "log.csv", 3);
    cli_write("machine.yaml", MOTOR("lag: unknown"));
    cli_json(identify, "fit machine.yaml log.csv --out m.h5", "loss *");
    const char *lag = json_find(result.out, "lag"), *ratios = json_find(lag, "ratios");
    double least = INFINITY;
    assert_close(json_number(lag, "chosen"), 0.1, 0.05, 0);
    for (size_t i = 0; i < LG_COUNT(starts); i++) least = fmin(least, json_number(ratios, starts[i]));
    assert_true(least == 1);
    assert_null(strstr(lag, "no lag that"));
    /* A start that is given is taken. */
    cli_write("machine.yaml", MOTOR("lag: {start: 0.05, within: [0.02, 0.5], sigma: 1}"));
    cli_json(identify, "fit machine.yaml log.csv --out m.h5", "loss *");
    lag = json_find(result.out, "lag");
    assert_close(json_number(lag, "chosen"), 0.1, 0.05, 0);
    assert_says(lag, "\"ratios\": {}");
}

static void check_model(const char *truth, const char *machine, uint32_t order) {
    generate(truth, "log.csv", 5);
    generate(truth, "other.csv", 6);
    cli_write("machine.yaml", machine);
    cli_run(identify, "fit machine.yaml log.csv --out m.h5");
    const lg_machine_model_file *file = cli_machine_model("m.h5");
    assert_int_equal(file->run.machine.lags, order);
    assert_close(file->run.scales.lag[0], 0.002, 1e-6, 0);
    assert_close(file->run.scales.lag[1], 4, 1e-6, 0);
    cli_run(identify, "predict m.h5 other.csv --out run.csv");
    static double logged[2500], predicted[2500];
    const size_t rows = csv_column("other.csv", "x", logged, 2500);
    assert_int_equal(csv_column("run.csv", "x", predicted, 2500), rows);
    for (size_t i = 0; i < rows; i++) assert_close(predicted[i], logged[i], 0, 0.03);
    cli_json(identify, "evaluate m.h5 other.csv --horizons 1", "");
    const char *energy = json_find(result.out, "energy");
    assert_non_null(energy);
    assert_close(json_number(energy, "left"), 0, 0, 0.03 * json_number(energy, "change_size"));
}

TEST("a model with a lag predicts as it was simulated, keeps its energy balance, and reloads") {
    cli_test_folder();
    check_model(TRUE_MOTOR("lag: 0.1"), MOTOR("lag: unknown"), 1);
    check_model(TRUE_MOTOR("lag: {order: 2, value: 0.1}"), MOTOR("lag: {order: 2}"), 2);
}

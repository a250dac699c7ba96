/* ctest-labels: slow apps/lg-identify src/machine What lg-identify fit chooses by free runs over windows
 * that are held out: hold and delay of the inputs, terms. */
#include "identify_support.h"

/* ---- simulated logs ---- */

/* 2 x'' = -5 x - .3 x' - f(x') + u: its friction f, how u acts between rows, and its delay in rows. */
typedef struct plant {
    double (*friction)(double v);
    bool held;
    int delay, rows;
    double unit; /* of time: the log's clock counts seconds times `unit` */
    double slow; /* size of a slow force that no candidate has */
    double fast; /* size of a part of the input that changes faster than the rows */
} plant;

static double none(double v) {
    (void)v;
    return 0;
}

static double coulomb(double v) {
    return 0.4 * tanh(v / 1e-3);
}

static double cubic(double v) {
    return 0.6 * v * v * v;
}

static double asymmetric(double v) {
    return 0.2 * fabs(v) - 0.1;
}

static const double interval = 0.05;

static double input_at(const plant *p, double t) {
    return p->fast * sin(97 * t) + 1.5 * sin(1.1 * t) + 1.2 * sin(2.9 * t + 1) + 0.8 * sin(6.3 * t + 2) +
           0.5 * sin(17 * t);
}

static double acceleration(const plant *p, const double *x, double u) {
    return (-5 * x[0] - 0.3 * x[1] - p->friction(x[1]) + u) / 2;
}

/* Moves x from row k to the next one. */
static void move(const plant *p, int k, double *x) {
    enum { STEPS = 200 };
    const double h = interval / STEPS;
    for (int i = 0; i < STEPS; i++) {
        const double t = k * interval + (i + 0.5) * h;
        const double u = input_at(p, p->held ? (k - p->delay) * interval : t - p->delay * interval);
        const double slow = p->slow * sin(0.21 * t);
        const double middle[2] = {x[0] + h / 2 * x[1], x[1] + h / 2 * acceleration(p, x, u + slow)};
        x[0] += h * middle[1];
        x[1] += h * acceleration(p, middle, u + slow);
    }
}

static void write_log(const char *name, const plant *p) {
    double x[2] = {0.3, 0};
    FILE *file = fopen(cli_at(name), "w");
    assert_non_null(file);
    (void)fprintf(file, "t,x,vx,u\n");
    for (int k = 0; k < p->rows; k++) {
        (void)fprintf(file, "%.17g,%.17g,%.17g,%.17g\n", k * interval * p->unit, x[0], x[1] / p->unit,
                      input_at(p, k * interval));
        move(p, k, x);
    }
    assert_int_equal(fclose(file), 0);
}

#define INPUT(inputs)                                                                                        \
    "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\ninputs: {columns: "          \
    "[u]" inputs "}\ninput_map: {kind: known, values: [[1]]}\n"
#define MACHINE(inputs, damping)                                                                             \
    INPUT(inputs) "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: " damping "\n"

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("open.yaml", MACHINE("", "diagonal"));
    cli_write("auto.yaml", MACHINE(", hold: auto, delay: auto", "diagonal"));
    cli_write("held.yaml", MACHINE(", hold: zero", "diagonal"));
    cli_write("network.yaml", MACHINE(", hold: zero", "{kind: network, of: x.velocity}"));
    return 0;
}

/* ---- hold and delay ---- */

/* Fits, and checks what was chosen. */
static void choose(const char *machine, const char *hold, int delay) {
    cli_json(identify, test_text("fit %s log.csv --out m.h5", machine), "loss *");
    const char *found = json_find(json_find(result.out, "hold"), "chosen");
    assert_non_null(found);
    if (strncmp(found, hold, strlen(hold)) != 0) fail_msg("hold: %.40s instead of %s", found, hold);
    assert_int_equal((int)json_number(json_find(result.out, "delay"), "chosen"), delay);
}

static double ratio_of(const char *what, const char *other) {
    return json_number(json_find(json_find(result.out, what), "ratios"), other);
}

TEST("a sampled analogue input is recognised although the file has no hold, in any unit of time") {
    static const double units[] = {1, 1e-9, 1e9};
    for (size_t i = 0; i < LG_COUNT(units); i++) {
        write_log("log.csv", &(plant){none, false, 0, 1500, units[i], 0, 0});
        choose("open.yaml", "\"cubic\"", 0);
        assert_true(ratio_of("hold", "zero") > 10 && ratio_of("hold", "linear") > 1.5);
        assert_says(result.out, "the input is a sampled analogue signal: hold: cubic leaves 1/");
    }
    /* The model knows its choice. */
    cli_json(identify, "evaluate m.h5 log.csv", "window_loss <1e-6");
}

TEST("an input that is held stays held, without a word") {
    write_log("log.csv", &(plant){none, true, 0, 1500, 1, 0, 0});
    choose("open.yaml", "\"zero\"", 0);
    assert_null(strstr(result.out, "analogue"));
    assert_true(ratio_of("hold", "cubic") > 2);
}

TEST("a sampled analogue input is recognised where a slow force hides it in long runs") {
    write_log("log.csv", &(plant){none, false, 0, 1500, 1, 0.2, 0});
    choose("open.yaml", "\"linear\"", 0);
    assert_true(ratio_of("hold", "zero") > 1.05);
}

/* The ratios of the holds after a fit with these options, as they are printed. */
static const char *ratios_with(const char *options) {
    cli_json(identify, test_text("fit open.yaml log.csv --out m.h5 %s", options), "loss *");
    const char *ratios = json_find(json_find(result.out, "hold"), "ratios");
    assert_non_null(ratios);
    return test_text("%.*s", (int)strcspn(ratios, "}"), ratios);
}

TEST("candidates are fitted with the options that say how windows are predicted, in either spelling") {
    static const char *const pairs[][2] = {{"--hop 7", "--stride 7"},
                                           {"--initial-states estimated", "--starts estimated"},
                                           {"--initial-states measured", "--starts measured"},
                                           {"--scheme lie-euler", "--integrator lie-euler"},
                                           {"--substeps 3", "--substeps 3"},
                                           {"--window 9", "--window 9"}};
    const char *ratios[LG_COUNT(pairs)];
    write_log("log.csv", &(plant){none, false, 0, 400, 1, 0.2, 0});
    const char *usual = ratios_with("");
    for (size_t i = 0; i < LG_COUNT(pairs); i++) {
        ratios[i] = ratios_with(pairs[i][0]);
        print_message("%s: %s\n", pairs[i][0], ratios[i]);
        assert_string_equal(ratios[i], ratios_with(pairs[i][1]));
        if (strstr(pairs[i][0], "initial") == NULL) assert_string_not_equal(ratios[i], usual);
    }
    assert_string_not_equal(ratios[1], ratios[2]);
}

/* Standard deviation of number i of a model with the model's covariance, by difference quotients. */
static double error_of_model(const char *path, size_t i) {
    enum { MOST = 32 };
    static const double step = 1e-6;
    const lg_machine_model_file *file = cli_machine_model(path);
    const size_t n = file->parameters;
    lg_identified numbers[2][MOST];
    double theta[MOST], sum = 0;
    assert_true(n <= MOST && file->spread != NULL);
    for (size_t k = 0; k < n; k++) { /* along each column of W */
        for (int side = 0; side < 2; side++) {
            for (size_t j = 0; j < n; j++)
                theta[j] = file->theta[j] + (side == 0 ? step : -step) * file->spread[j * n + k];
            assert_true(lg_machine_numbers(&file->run.machine, theta, MOST, numbers[side]) <= MOST);
        }
        sum += pow((numbers[0][i].value - numbers[1][i].value) / (2 * step), 2);
    }
    return sqrt(sum);
}

TEST("what another hold would change is a part of the errors, if the log does not tell the holds apart") {
    write_log("log.csv", &(plant){none, false, 0, 1500, 1, 0.5, 4});
    cli_json(identify, "fit open.yaml log.csv --out m.h5", "loss *");
    const char *told = strstr(result.err, "another hold changes mass.1.1 by ");
    assert_non_null(told);
    const char *mass = json_find(json_find(result.out, "identified"), "mass.1.1");
    assert_true(json_number(mass, "error") >
                0.99 * strtod(told + strlen("another hold changes mass.1.1 by "), NULL));
    assert_close(error_of_model("m.h5", 0), json_number(mass, "error"), 1e-3, 0);
}

TEST("hold and delay are found together") {
    write_log("log.csv", &(plant){none, true, 2, 1500, 1, 0, 0});
    choose("auto.yaml", "\"zero\"", 2);
    assert_true(ratio_of("delay", "0") > 5 && ratio_of("delay", "1") > 2 && ratio_of("delay", "3") > 2);
    assert_says(result.out, "the inputs act 2 rows after they are logged");
    assert_null(strstr(result.out, "more are not tried"));
    write_log("log.csv", &(plant){none, false, 1, 1500, 1, 0, 0});
    choose("auto.yaml", "\"cubic\"", 1);
}

TEST("where the greatest delay that is tried is the best one, this is said with what to do") {
    cli_write("late.yaml", MACHINE(", hold: zero, delay: auto", "diagonal"));
    write_log("log.csv", &(plant){none, true, 7, 1500, 1, 0, 0});
    choose("late.yaml", "\"zero\"", 5);
    assert_says(result.out, "more are not tried: for a greater delay set `delay: estimate` (up to 8 rows)");
}

/* Two inputs: u is held, w is smooth and acts 2 rows late. */
#define TWO(inputs, rest)                                                                                    \
    "columns: {time: t}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\ninputs: {columns: [u, w], "  \
    "hold: " inputs "}\ninput_map: {kind: known, values: [[1, 1]]}\n" rest

TEST("hold and delay of each input are found one after the other, and the model keeps them") {
    cli_write("truth.yaml", TWO("[zero, cubic], delay: [0, 2]",
                                "mass: {kind: known, values: [2]}\ndamping: {kind: known, values: [0.3]}\n"
                                "potential: {kind: known, form: quadratic, of: x, values: [5]}\n"));
    cli_write("both.yaml", TWO("auto, delay: [0, auto]",
                               "mass: diagonal\ndamping: diagonal\npotential: {kind: quadratic, of: x}\n"));
    cli_run(identify, "generate truth.yaml --inputs multisine:4 --amplitude 3 --t-end 60 --dt 0.05 --runs 1 "
                      "--out two.csv");
    cli_json(identify, "check truth.yaml two.csv", "rows *");
    assert_says(result.out, "\"delay\": [0, 2]");
    cli_json(identify, "fit both.yaml two.csv --out m.h5", "loss <1e-8");
    const char *hold = json_find(result.out, "hold"), *delay = json_find(result.out, "delay");
    assert_says(hold, "\"chosen\": [\"zero\", \"cubic\"]");
    assert_says(delay, "\"chosen\": [0, 2]");
    assert_says(result.out, "the input w is a sampled analogue signal: hold: cubic leaves ");
    assert_says(result.out, "the input w acts 2 rows after it is logged");
    cli_json(identify, "evaluate m.h5 two.csv", "window_loss <1e-6");
}

TEST("a log that is too short to choose from says so") {
    write_log("log.csv", &(plant){none, true, 0, 20, 1, 0, 0});
    choose("auto.yaml", "\"zero\"", 0);
    assert_says(result.out, "the log is too short to choose how the inputs act");
}

/* ---- terms ---- */

static void suggests(double (*friction)(double), const char *name, const char *asks) {
    write_log("log.csv", &(plant){friction, true, 0, 1500, 1, 0, 0});
    cli_json(identify, "fit held.yaml log.csv --out m.h5 --suggest new.yaml", "loss *");
    const char *list = json_find(result.out, "suggested");
    assert_non_null(list);
    if (strncmp(list, test_text("[\"%s\"", name), strlen(name) + 3) != 0) fail_msg("%s: %.300s", name, list);
    assert_says(result.out, asks);
    lg_machine_file *file = TEST_ARRAY(lg_machine_file, 1);
    assert_told(lg_machine_file_read(NULL, cli_at("new.yaml"), file, &told));
    assert_string_equal(lg_term_kind_name(file->machine.terms[file->machine.term_count - 2].kind), name);
    lg_machine_file_destroy(file);
}

TEST("--suggest names the term that the log asks for, and writes the machine that has it") {
    suggests(coulomb, "coulomb", "the log asks for Coulomb friction: it leaves 0.");
    suggests(cubic, "cubic", "the log asks for friction that grows with the cube of the velocity");
}

TEST("--suggest adds an offset to friction that differs by direction") {
    char text[1000];
    write_log("log.csv", &(plant){asymmetric, true, 0, 1500, 1, 0, 0});
    cli_json(identify, "fit held.yaml log.csv --out m.h5 --suggest new.yaml", "suggested [\"asymmetric\"]");
    assert_says(result.err, "and for a constant force (an offset)");
    (void)cli_read("new.yaml", text, sizeof text);
    assert_says(text, "offset: unknown");
    assert_true(fabs(json_number(json_find(json_find(result.out, "identified"), "offset.x"), "value") - 0.1) <
                0.01);
}

TEST("--suggest takes nothing where nothing is missing") {
    write_log("log.csv", &(plant){none, true, 0, 1500, 1, 0, 0});
    cli_json(identify, "fit held.yaml log.csv --out m.h5 --suggest -", "suggested []");
    assert_says(result.out, "the log asks for no further term");
}

/* ---- the epoch, and widths of networks ---- */

TEST("with --select free-run the result is the epoch with the least error of free runs, held out of "
     "training") {
    write_log("log.csv", &(plant){cubic, true, 0, 1000, 1, 0, 0});
    cli_json(identify, "fit network.yaml log.csv --out m.h5 --epochs 40 --method adam:25,ssbroyden --lr .3",
             "windows *");
    const double all = json_number(result.out, "windows");
    cli_json(identify,
             "fit network.yaml log.csv --out m.h5 --epochs 60 --method adam --lr 2 --schedule constant "
             "--select free-run",
             "epochs 60");
    const char *found = json_find(result.out, "select");
    assert_non_null(found);
    const double windows = json_number(result.out, "windows"), loss = json_number(result.out, "loss");
    assert_true(windows < 0.9 * all && windows > 0.5 * all);
    const int epoch = (int)json_number(found, "epoch");
    assert_true(epoch > 0 && epoch < 60);
    cli_json(
        identify,
        test_text("fit network.yaml log.csv --out m.h5 --epochs %d --method adam --lr 2 --schedule constant "
                  "--select free-run",
                  epoch),
        "epochs *");
    assert_true(json_number(result.out, "loss") == loss);
}

TEST(
    "--select free-run keeps an epoch before free runs get worse, although the loss of windows still falls") {
    enum { EPOCHS = 300 };
    double error[2];
    cli_write(
        "known.yaml",
        INPUT(", hold: zero") "mass: {kind: known, values: [2]}\ndamping: {kind: known, values: [0.3]}\n"
                              "potential: {kind: known, form: quadratic, of: x, values: [5]}\n");
    cli_write("wide.yaml", MACHINE(", hold: zero", "{kind: network, of: x.velocity, hidden: [24, 24]}"));
    cli_run(identify,
            "generate known.yaml --inputs steps --amplitude 3 --t-end 30 --dt 0.05 --noise 0.05,0.1 "
            "--runs 1 --out noisy.csv");
    cli_run(identify,
            "generate known.yaml --inputs steps --amplitude 3 --t-end 30 --dt 0.05 --runs 1 --seed 5 "
            "--out clean.csv");
    for (int plain = 0; plain < 2; plain++) {
        cli_json(
            identify,
            test_text("fit wide.yaml noisy.csv --out m.h5 --window 5 --starts measured --prior 0 --method "
                      "ssbroyden --epochs %d%s",
                      EPOCHS, plain ? "" : " --select free-run"),
            "loss >0");
        if (!plain) {
            const int epoch = (int)json_number(json_find(result.out, "select"), "epoch");
            const double *loss = cli_machine_model("m.h5")->history[LG_FIT_LOSS];
            assert_true(epoch > 0 && epoch < EPOCHS && loss[EPOCHS - 1] < loss[epoch - 1]);
        }
        cli_json(identify, "evaluate m.h5 clean.csv", "window_loss >0");
        error[plain] = json_number(json_find(result.out, "free_run"), "x");
    }
    printf("free runs over another log: %.3g at the epoch that is kept, %.3g at the last\n", error[0],
           error[1]);
    assert_true(error[0] < 0.9 * error[1]);
}

TEST("--size sets the widths of networks, and auto takes the smallest that is good enough") {
    write_log("log.csv", &(plant){cubic, true, 0, 1000, 1, 0, 0});
    cli_json(identify, "fit network.yaml log.csv --out m.h5 --epochs 20 --size 5,3", "parameters 34");
    cli_json(identify, "fit network.yaml log.csv --out m.h5 --epochs 20 --size auto", "size *");
    assert_says(result.err, "are taken; errors of the others in free runs, as multiples: ");
    cli_expect(identify, "fit held.yaml log.csv --out m.h5 --size auto", 2,
               "--size: this machine has no network");
}

/* ---- memory ---- */

#ifndef LG_SANITIZED
enum { MIB = 1 << 20, LONG = 20000 };

/* What a fit says whose windows are too long for the memory. */
typedef struct room {
    double needed, left; /* MiB */
    unsigned window;     /* of how many rows they may be */
} room;

/* Fits windows of this length under a limit on addresses. Returns the exit code. */
static int fit_under(double mebibytes, unsigned window, room *out) {
    static const char sentence[] = "a fit of windows as long as this needs about ";
    struct rlimit before;
    assert_int_equal(getrlimit(RLIMIT_AS, &before), 0);
    const struct rlimit less = {(rlim_t)(mebibytes * MIB), before.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_AS, &less), 0); /* children have the limit of this process */
    cli_run_limited(identify,
                    test_text("fit held.yaml log.csv --out m.h5 --threads 1 --method adam --epochs 2 "
                              "--window %u",
                              window),
                    0);
    assert_int_equal(setrlimit(RLIMIT_AS, &before), 0);
    *out = (room){0, 0, 0};
    const char *told = strstr(result.err, sentence);
    if (told != NULL)
        (void)sscanf(told + strlen(sentence),
                     "%lf MiB of memory, and %lf MiB are left: windows of up to %u rows fit", &out->needed,
                     &out->left, &out->window);
    return result.code;
}

/* The least limit under which the program gets so far as to say what it needs depends on the machine. */
TEST("windows that are too long for the memory are refused with what they need and with the length that "
     "fits; both are enough") {
    room told = {0, 0, 0}, other;
    double limit = 64;
    write_log("log.csv", &(plant){none, true, 0, LONG, 1, 0, 0});
    for (int code = 5; code == 5 && told.window == 0; limit *= 1.25) code = fit_under(limit, LONG, &told);
    limit /= 1.25;
    print_message("limit %.0f MiB: %.0f needed, %.0f left, windows of up to %u rows fit\n", limit,
                  told.needed, told.left, told.window);
    assert_true(told.needed > told.left && told.left > 0 && told.left < limit);
    assert_true(told.window > 2 && told.window < LONG);
    const double enough = limit + told.needed - told.left;
    if (fit_under(limit, told.window, &other) != 0) fail_msg("--window %u: %s", told.window, result.err);
    if (fit_under(enough * 1.01, LONG, &other) != 0) fail_msg("%.0f MiB: %s", enough, result.err);
}
#endif

TEST_GROUP(setup, cli_end)

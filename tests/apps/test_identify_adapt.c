/* lg-identify adapt: a few numbers for a new log.
 * ctest-labels: apps/lg-identify src/machine */
#include "identify_support.h"

#define CART                                                                                                 \
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}]\ninputs: {columns: [u]}\n"        \
    "input_map: {kind: known, values: [1]}\n"
static const char first_day[] =
    CART "mass: {kind: known, values: [2]}\ndamping: {kind: known, values: [0.8]}\n";
static const char second_day[] = CART "mass: {kind: known, values: [2]}\ndamping: {kind: known, values: "
                                      "[0.84]}\noffset: {kind: known, values: [0.05]}\n";
static const char model[] = CART "mass: diagonal\ndamping: diagonal\n";
/* As first_day, in brackets. */
static const char brackets[] =
    "{columns: {time: t}, coordinates: [{name: x, kind: line, velocity: v}], inputs: {columns: [u]},\n"
    " input_map: {kind: known, values: [1]}, mass: diagonal, damping: diagonal}\n";

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("first.yaml", first_day);
    cli_write("second.yaml", second_day);
    cli_write("model.yaml", model);
    cli_write("brackets.yaml", brackets);
    cli_write("known.yaml", CART "mass: diagonal\ndamping: {kind: known, values: [0.8]}\n");
    cli_expect(identify,
               "generate first.yaml --runs 1 --inputs steps --amplitude 3 --t-end 10 --dt 0.02 --noise 0.002 "
               "--out first.csv",
               0, "");
    cli_expect(
        identify,
        "generate second.yaml --runs 1 --inputs steps --amplitude 3 --t-end 20 --dt 0.02 --noise 0.002 "
        "--seed 2 --out second.csv",
        0, "");
    cli_expect(identify,
               "generate first.yaml --runs 1 --inputs steps --amplitude 3 --t-end 20 --dt 0.02 --noise 0.002 "
               "--seed 3 --out same.csv",
               0, "");
    return 0;
}

static double of(const char *list, const char *name, const char *key) {
    return json_number(json_find(json_find(result.out, list), name), key);
}

TEST("friction and a constant force of the second day are found in ten seconds, and the rest is predicted to "
     "its noise") {
    static const char *const machines[] = {"model.yaml", "brackets.yaml"};
    char line[200];
    for (size_t i = 0; i < LG_COUNT(machines); i++) {
        (void)snprintf(line, sizeof line, "fit %s first.csv --out m.h5", machines[i]);
        cli_expect(identify, line, 0, "");
        cli_json(identify, "adapt m.h5 second.csv --seconds 10 --out n.h5", "adapted {");
        const double force = of("adapted", "offset.x", "value"), factor = of("adapted", "friction", "value");
        assert_true(fabs(force - 0.05) < 3 * of("adapted", "offset.x", "error") + 0.003);
        assert_true(fabs(factor - 1.05) < 3 * of("adapted", "friction", "error") + 0.01);
        assert_true(of("rest", "x", "after") < 0.1 * of("rest", "x", "before"));
        assert_true(of("rest", "x", "before") < of("rest", "x", "unchanged"));
        /* the written model runs as the adapted one */
        cli_json(identify, "evaluate n.h5 second.csv", "free_run {");
        assert_true(json_number(json_find(result.out, "free_run"), "x") < 0.05);
        cli_json(identify, "evaluate m.h5 second.csv", "free_run {");
        assert_true(json_number(json_find(result.out, "free_run"), "x") > 0.1);
    }
}

TEST("a log that shows no change keeps the model, and says so") {
    cli_expect(identify, "fit model.yaml first.csv --out m.h5", 0, "");
    cli_json(identify, "adapt m.h5 same.csv --seconds 10", "adapted {");
    assert_says(result.err, "do not show by more than chance that offset,friction changed");
    assert_says(result.out, "\"numbers\": \"kept\"");
    assert_true(of("rest", "x", "after") == of("rest", "x", "before"));
    assert_true(of("adapted", "friction", "value") == 1);
}

TEST("friction of half and twice its size, and a force of a third of the friction, are found and told, with "
     "their errors") {
    static const char *const damping[] = {"diagonal", "{kind: known, values: [unknown]}", "diagonal"};
    static const double factors[] = {0.5, 2, 1}, forces[] = {0, 0, 0.3};
    for (int day = 0; day < 3; day++) {
        cli_write("day.yaml",
                  test_text(CART "mass: {kind: known, values: [2]}\ndamping: {kind: known, values: [%g]}\n"
                                 "offset: {kind: known, values: [%g]}\n",
                            0.8 * factors[day], forces[day]));
        cli_run(identify,
                "generate day.yaml --runs 1 --inputs steps --amplitude 3 --t-end 20 --dt 0.02 --noise "
                "0.0001 --seed 2 --out day.csv");
        cli_write("kind.yaml", test_text(CART "mass: diagonal\ndamping: %s\n", damping[day]));
        cli_run(identify, "fit kind.yaml first.csv --out m.h5");
        cli_json(identify, "adapt m.h5 day.csv --beginning 10", "adapted {");
        assert_says(result.out, "\"numbers\": \"changed\"");
        assert_close(of("adapted", "friction", "value"), factors[day], 0.01, 0);
        assert_close(of("adapted", "offset.x", "value"), forces[day], 0, 0.005);
        assert_true(of("rest", "x", "after") < 0.02 * of("rest", "x", "before"));
    }
}

TEST("numbers that cannot be adapted are refused with a list of those that can, and too short a beginning is "
     "told") {
    cli_expect(identify, "fit model.yaml first.csv --out m.h5", 0, "");
    cli_expect(identify, "adapt m.h5 second.csv --seconds 10 --numbers offset,mass", 2, "");
    assert_says(result.err, "\"mass\" is no number that can be adapted; take of: offset, friction");
    cli_expect(identify, "adapt m.h5 second.csv --seconds 30", 2, "");
    assert_says(result.err, "leaves 1001 rows for the fit and 0 for the judgement");
    cli_expect(identify, "adapt m.h5 second.csv", 2, "--beginning S is missing");
    cli_json(identify, "adapt m.h5 second.csv --seconds 0.1", "adapted {");
    assert_says(result.err, "are too short to tell");
    cli_expect(identify, "fit known.yaml first.csv --out k.h5", 0, "");
    cli_expect(identify, "adapt k.h5 second.csv --seconds 10", 2, "");
    assert_says(result.err, "the machine has no learned friction");
}

TEST(
    "a free run that integrates a constant force is told, with the force; a run that a spring holds is not") {
    static const char spring[] = "potential: {kind: known, form: quadratic, of: x, values: [4]}\n";
    static const char *const springs[] = {"", spring};
    for (int held = 0; held < 2; held++) {
        cli_write("a.yaml", test_text("%s%s", first_day, springs[held]));
        cli_write("b.yaml", test_text("%s%s", second_day, springs[held]));
        cli_write("c.yaml", test_text("%s%s", model, springs[held]));
        cli_run(identify,
                "generate a.yaml --runs 1 --inputs steps --amplitude 3 --t-end 10 --dt 0.02 --noise 0.002 "
                "--out a.csv");
        cli_run(identify,
                "generate b.yaml --runs 1 --inputs steps --amplitude 3 --t-end 20 --dt 0.02 --noise 0.002 "
                "--seed 2 --out b.csv");
        cli_run(identify, "fit c.yaml a.csv --out c.h5");
        cli_json(identify, "evaluate c.h5 b.csv --horizons 1,5", "integrates {");
        const char *x = json_find(json_find(result.out, "integrates"), "x");
        if (held != 0) {
            assert_null(x);
            assert_null(strstr(result.err, "integrates an offset"));
            continue;
        }
        assert_says(result.err, "the free run integrates an offset");
        assert_non_null(x);
        assert_true(fabs(json_number(x, "force") - 0.05) < 0.03);
        assert_true(json_number(x, "with") < 0.7 * json_number(x, "without"));
    }
}

TEST("a linear model is compared in logs of positions alone, and the plot of friction has the logged "
     "forces") {
    cli_write("p.yaml",
              "columns: {time: t}\ncoordinates: [{name: x, kind: line}]\nmeasured: positions\n"
              "inputs: {columns: [u]}\ninput_map: {kind: known, values: [1]}\nmass: diagonal\ndamping: "
              "diagonal\n");
    cli_run(identify, "fit p.yaml first.csv --out p.h5");
    cli_expect(identify, "evaluate p.h5 first.csv --horizons 1 --plot p.svg", 0, "");
    assert_says(result.out, "Runs of 1 s, error of line: the ");
    enum { SIZE = 1 << 20 };
    char *text = lg_test_memory(SIZE);
    (void)cli_read("p.svg", text, SIZE);
    assert_says(text, "as logged");
}

#define TWO                                                                                                  \
    "columns: {time: t}\ncoordinates: [{name: x, kind: line, velocity: v}, {name: y, kind: line, velocity: " \
    "w}]\ninputs: {columns: [u]}\ninput_map: {kind: known, values: [[1], [0.5]]}\n"                          \
    "mass: {kind: known, values: [[2, 0], [0, 1]]}\ndamping: {kind: known, values: [0.8, 0.4]}\n"

TEST("each of several offsets is adapted, and pushes its own velocity, in any order") {
    static const char *const orders[] = {"[{kind: unknown, of: x}, {kind: unknown, of: y}]",
                                         "[{kind: unknown, of: y}, {kind: unknown, of: x}]",
                                         "[{kind: unknown, of: y}, unknown]"};
    cli_write("two.yaml", TWO);
    cli_write("pushed.yaml", TWO "offset: {kind: known, values: [0.05, -0.03]}\n");
    cli_write("x.yaml", TWO "offset: {kind: known, values: [0.05, 0]}\n");
    cli_run(identify, "generate two.yaml --runs 1 --inputs steps --t-end 10 --noise 0.002 --out two.csv");
    cli_run(
        identify,
        "generate pushed.yaml --runs 1 --inputs steps --t-end 20 --noise 0.002 --seed 2 --out pushed.csv");
    cli_run(identify,
            "generate x.yaml --runs 1 --inputs steps --t-end 20 --noise 0.002 --seed 2 --out x.csv");
    for (size_t i = 0; i < LG_COUNT(orders); i++) {
        cli_write("offsets.yaml", test_text("%soffset: %s\n", TWO, orders[i]));
        cli_expect(identify, "fit offsets.yaml two.csv --out two.h5", 0, "");
        cli_json(identify, "adapt two.h5 pushed.csv --seconds 10 --numbers offset", "adapted {");
        assert_true(fabs(of("adapted", "offset.x", "value") - 0.05) < 0.005);
        assert_true(fabs(of("adapted", "offset.y", "value") + 0.03) < 0.005);
        cli_json(identify, "evaluate two.h5 x.csv", "integrates {");
        const char *integrates = json_find(result.out, "integrates");
        assert_true(fabs(json_number(json_find(integrates, "x"), "force") - 0.05) < 0.005);
        assert_true(fabs(json_number(json_find(integrates, "y"), "force")) < 0.005);
    }
}

TEST_GROUP(setup, cli_end)

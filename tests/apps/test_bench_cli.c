/* Runs lg-bench: every case at its smallest size, options, JSON. The computed results are checked, the
 * measured times are not. */
#include "cli_support.h"

static int setup(void **state) {
    return cli_begin();
}

static void run_case(const char *arguments, double largest_error) {
    cli_json("lg-bench", arguments, "min_us >0");
    assert_true(json_number(result.out, "min_us") <= json_number(result.out, "median_us"));
    if (largest_error < 0) return;
    const double error = json_number(result.out, "error");
    if (!(error >= 0 && error <= largest_error)) fail_msg("lg-bench %s: error %g", arguments, error);
}

TEST("every case runs") {
    static const struct {
        const char *arguments;
        double error; /* largest accepted error; negative: the case reports no error */
    } cases[] = {
        {"mlp2 --batch 3 --width 8 --repeats 1", 1e-14},
        {"mlp2 --batch 3 --width 8 --repeats 1 --dtype f32", 1e-5},
        {"mlp2 --batch 5 --width 8 --repeats 1 --threads 2", 1e-14},
        {"mlp2-parts --batch 3 --width 8 --repeats 1", 1e-14},
        {"jvp --batch 3 --width 8 --repeats 1", 1e-14},
        {"dense --batch 4 --width 16 --repeats 1", 1e-5},
        {"dense --batch 4 --width 16 --repeats 1 --dtype f64", 1e-14},
        {"adam --width 1000 --repeats 1", 1e-6},
        {"adam --width 1000 --repeats 1 --dtype f64 --threads 2", 1e-14},
        {"scalar --repeats 1", 1e-13},
        {"scalar-ops --repeats 1", 1e-13},
        {"peak --repeats 1", 0},
        {"peak --repeats 1 --dtype f32", 0},
        {"gemm --repeats 1 --only 3x3x3", 1e-15},
        {"act --width 64 --repeats 1", 3},
        {"act --width 64 --repeats 1 --dtype f32", 3},
        {"node --width 100 --repeats 1", -1},
        {"batch1 --width 8 --repeats 100", 1e-14},
        {"ode --links 2 --repeats 1 --only N=2", 0.1},
        {"ode --links 3 --repeats 1 --only tol=1e-12", 1e-9},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) run_case(cases[i].arguments, cases[i].error);
}

/* The parameters are written, read again and judged, as it is done for another program. Two epochs must lower
 * the loss. */
TEST("a Hamiltonian is trained, its parameters are read again and judged") {
    run_case("hamiltonian-quartic --epochs 3 --out set --judge", 0.2);
    const double trained = json_number(result.out, "error");
    assert_true(isfinite(json_number(result.out, "E1")));
    assert_true(json_find(result.out, "losses") != NULL);
    assert_true(cli_exists("set.data") && cli_exists("set.weights"));
    run_case("hamiltonian-quartic --weights set.weights", 10);
    assert_true(trained < json_number(result.out, "error"));
    cli_expect("lg-bench", "hamiltonian --weights set.weights", 3, "set.weights");
}

TEST("the list names all cases") {
    static const char *const names[] = {"mlp2", "hamiltonian", "dense", "adam",   "scalar", "jvp",
                                        "gemm", "act",         "node",  "batch1", "ode",    "peak"};
    cli_expect("lg-bench", "list", 0, "mlp2");
    for (size_t i = 0; i < LG_COUNT(names); i++) assert_non_null(strstr(result.out, names[i]));
    cli_expect("lg-bench", "list --json", 0, "\"cases\"");
    assert_true(json_is_object(result.out));
}

/* A row of a chain reports the solver's work; the time of one step is in the row too. */
TEST("an integration reports its steps, rejected steps and evaluations") {
    static const char *const keys[] = {"steps", "rejected", "evaluations", "manifold_error",
                                       "reference_error"};
    run_case("ode --links 2 --repeats 1 --only tol=1e-06", 1e-4);
    for (size_t i = 0; i < LG_COUNT(keys); i++) assert_non_null(json_find(result.out, keys[i]));
    assert_true(json_number(result.out, "manifold_error") <= 1e-14);
    assert_true(json_number(result.out, "evaluations") >= 6 * json_number(result.out, "steps"));
    run_case("ode --links 1 --repeats 1 --only step", -1);
    assert_non_null(strstr(result.out, "ns a link"));
}

/* The report names the machine that it ran on. --only selects rows. */
TEST("the report says what machine it ran on") {
    static const char *const keys[] = {"cpu",      "kernels", "dtype",  "threads",
                                       "error_is", "p10_us",  "p90_us", "rows"};
    run_case("act --width 64 --repeats 1 --only exp", 3);
    for (size_t i = 0; i < LG_COUNT(keys); i++) assert_non_null(json_find(result.out, keys[i]));
    assert_null(strstr(result.out, "tanh"));
    cli_expect("lg-bench", "mlp2 --batch 2 --width 4 --repeats 1", 0, "B=2");
}

TEST_GROUP(setup, cli_end)

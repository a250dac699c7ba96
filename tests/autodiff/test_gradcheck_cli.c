/* Runs lg-gradcheck (in LG_BIN_DIR): exit codes, table, JSON. Its cases are the library's operations and
 * every layer, integrator, system, learned Hamiltonian and surrogate. For each it compares first and second
 * derivatives with differences, the backward sweep with the recorded gradient, and plans with the tape.
 * ctest-labels: slow apps/lg-gradcheck src/autodiff src/kernels src/integrators src/nn
 * ctest-labels: src/mechanics src/hamiltonian src/elastica src/machine */
#include "apps/cli_support.h"

static const char program[] = "lg-gradcheck";

static int begin(void **state) {
    return cli_begin();
}

TEST_GROUP(begin, cli_end)

static const struct {
    const char *arguments;
    int code;
    const char *says[4], *not [2];
} runs[] = {
    {"--seed 77", 0, {" 0 wrong."}, {" no\n"}},
    {"--only implicit-euler", 0, {" 6 refused as programs"}, {NULL}},
    {"--only custom --json", 0, {"\"refused\": true"}, {NULL}},
    {"--only cross --json",
     0,
     {"\"passed\": true", "\"name\": \"cross (4, 3)\"", "\"adjoint\": ", "\"refused_programs\": 0"},
     {"matmul"}},
    {"--only scale --json", 0, {"\"slope\": null"}, {NULL}}, /* linear: only rounding errors */
    {"--only sin", 0, {"2.0"}, {NULL}},
    {"--version", 0, {"lg-gradcheck"}, {NULL}},
    {"--help", 0, {"--plant"}, {NULL}},
    {"--plant --only matmul", 0, {" 0 missed."}, {"MISSED", "\n0 mutations caught"}},
    {"--plant --only cross", 0, {" 0 missed."}, {"MISSED", "\n0 mutations caught"}},
    {"--plant --only spd_solve",
     0,
     {" 0 missed.", "the transposed derivative has the same numbers"},
     {"MISSED"}},
    {"--plant", 0, {"caught"}, {NULL}}, /* the output is longer than the part that is kept */
    {"--plant --only shift --json",
     0,
     {"\"missed\": 0", "\"outcome\": \"caught\"", "\"mutation\": \"transpose\"",
      "\"direction\": \"scalars\""},
     {NULL}},
    {"--only nosuch", 2, {"nosuch"}, {NULL}},
    {"--only nosuch --plant --json", 2, {"nosuch"}, {NULL}},
    /* a network has no operation of its own to plant errors in */
    {"--plant --only net", 2, {"there is nothing to plant"}, {NULL}},
    {"--plant --only net --json", 2, {"'net'"}, {NULL}},
    {"--seed -1", 2, {"seed"}, {NULL}},
    {"--bogus", 2, {"bogus"}, {NULL}},
    {"surplus", 2, {"surplus"}, {NULL}},
};

TEST("every function passes, every planted error is caught, and wrong arguments are refused") {
    for (size_t i = 0; i < LG_COUNT(runs); i++) {
        const bool json = strstr(runs[i].arguments, "--json") != NULL;
        cli_expect(program, runs[i].arguments, runs[i].code, runs[i].says[0]);
        for (size_t j = 1; j < 4 && runs[i].says[j] != NULL; j++) assert_says(result.out, runs[i].says[j]);
        for (size_t j = 0; j < 2 && runs[i].not [j] != NULL; j++)
            assert_null(strstr(result.out, runs[i].not [j]));
        if (json && runs[i].code == 0) assert_true(json_is_object(result.out));
        if (json && runs[i].code != 0) assert_string_equal(result.out, "");
    }
}

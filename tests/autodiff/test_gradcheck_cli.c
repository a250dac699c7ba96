/* lg-gradcheck (in LG_BIN_DIR) from outside: exit codes, table, JSON. */
#include "apps/cli_support.h"

static const char program[] = "lg-gradcheck";
static cli result;

static int setup(void **state) {
    cli_make_folder();
    return cli_folder[0] == '\0' ? -1 : 0;
}

static int teardown(void **state) {
    cli_remove_folder();
    return 0;
}

static void test_everything_passes(void **state) {
    cli_expect(program, "", 0, " 0 wrong.", &result);
    assert_null(strstr(result.out, "WRONG"));
    cli_expect(program, "--seed 77", 0, " 0 wrong.", &result);
    cli_expect(program, "--only implicit-euler --order 1", 0, "refused", &result);
    cli_expect(program, "--only custom --json", 0, "\"refused\": true", &result);
    cli_expect(program, "--only cross --json", 0, "\"adjoint\": ", &result);
    assert_non_null(strstr(result.out, "\"refused_programs\": 0"));
}

static void test_every_plant_is_caught(void **state) {
    static const char *const some[] = {"matmul", "cross", "stumpff", "spd_solve", "max", "custom"};
    for (size_t i = 0; i < sizeof some / sizeof *some; i++) {
        char arguments[64];
        (void)snprintf(arguments, sizeof arguments, "--plant --only %s", some[i]);
        cli_expect(program, arguments, 0, " 0 missed.", &result);
        assert_null(strstr(result.out, "MISSED"));
        assert_null(strstr(result.out, "\n0 mutations caught"));
    }
    cli_expect(program, "--plant --only spd_solve", 0, "the transposition changes no number", &result);
    cli_expect(program, "--plant", 0, "caught", &result); /* longer than what is kept of it */
    cli_expect(program, "--plant --only shift --json", 0, "\"missed\": 0", &result);
    assert_true(json_is_object(result.out));
    assert_non_null(strstr(result.out, "\"outcome\": \"caught\""));
    assert_non_null(strstr(result.out, "\"mutation\": \"transpose\""));
    assert_non_null(strstr(result.out, "\"direction\": \"scalars\""));
    assert_non_null(strstr(result.out, "\"mutation\": \"missing\""));
}

static void test_one_operation(void **state) {
    cli_expect(program, "--only cross --json", 0, "\"passed\": true", &result);
    assert_true(json_is_object(result.out));
    assert_non_null(strstr(result.out, "\"name\": \"cross (4, 3)\""));
    assert_null(strstr(result.out, "matmul"));
    for (const char *key = "name\0order\0slope\0error\0passed\0"; *key != '\0'; key += strlen(key) + 1)
        assert_non_null(strstr(result.out, key));
    cli_expect(program, "--only scale --json", 0, "\"slope\": null", &result); /* linear: at rounding */
    cli_expect(program, "--only sin --order 1", 0, "2.0", &result);
    cli_expect(program, "--version", 0, "lg-gradcheck", &result);
    cli_expect(program, "--help", 0, "--plant", &result);
}

static void test_bad_usage(void **state) {
    cli_expect(program, "--only nosuch", 2, "nosuch", &result);
    cli_expect(program, "--only nosuch --plant --json", 2, "nosuch", &result);
    assert_string_equal(result.out, "");
    /* A network has no derivative of its own: nothing planted would be nothing missed. */
    cli_expect(program, "--plant --only net", 2, "there is nothing to plant", &result);
    cli_expect(program, "--plant --only net --json", 2, "'net'", &result);
    assert_string_equal(result.out, "");
    cli_expect(program, "--order 3", 2, "order", &result);
    cli_expect(program, "--order 0", 2, "order", &result);
    cli_expect(program, "--seed -1", 2, "seed", &result);
    cli_expect(program, "--bogus", 2, "bogus", &result);
    cli_expect(program, "surplus", 2, "surplus", &result);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_everything_passes),
        cmocka_unit_test(test_every_plant_is_caught),
        cmocka_unit_test(test_one_operation),
        cmocka_unit_test(test_bad_usage),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}

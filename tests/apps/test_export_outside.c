/* Models that the library does not know (examples/programs/), trained, differentiated and written as C: value,
 * field, step, loss and the derivatives equal the tape's at random inputs.
 * ctest-labels: slow */
#include "apps/outside_models.h"

enum { POINTS = 1000 };

static void compare(const model *m, lg_program *program, lg_dtype dtype) {
    model_compare(m, program, dtype == LG_F64 ? "gcc" : "clang", "-O2", dtype, POINTS);
}

static void written_functions_equal_the_tape(void **state) {
    (void)state;
    model_for_each(compare);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(written_functions_equal_the_tape)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

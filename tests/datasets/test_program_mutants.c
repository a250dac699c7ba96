/* 20000 mutants of programs: 14000 of decoded lists, 4500 of arrays in files, 1500 of files' bytes through
 * the probe, which forks for each. Each is refused with a sentence and a status of exit code 3, or is sound
 * and runs within its limits. ctest-labels: slow */
#include "program_mutants.h"

static void decoded_lists(void **state) {
    (void)state;
    mutate_images(14000, 101);
}

static void arrays_of_files(void **state) {
    (void)state;
    mutate_arrays(4500, 102);
}

static void bytes_of_files(void **state) {
    (void)state;
    mutate_bytes(1500, 103);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(decoded_lists),
        cmocka_unit_test(arrays_of_files),
        cmocka_unit_test(bytes_of_files),
    };
    return cmocka_run_group_tests(tests, scratch_begin, scratch_end);
}

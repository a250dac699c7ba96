/* Exported detectors with every compiler and optimisation; stack. ctest-labels: study */
#include "export_detector.h"

static void every_way(void **state) {
    (void)state;
    for (size_t s = 0; s < SAMPLES; s++) {
        char folder[64];
        detector_export(&samples[s], s % 2 == 0 ? "f64" : "f32", folder, sizeof folder);
        if (s < 2)
            export_check_all_ways(folder, "m");
        else
            export_check_ways(folder, "m");
        export_check_objects(folder, "m");
        export_check_stack(folder);
    }
}

/* Networks of default sizes: their loops are long enough for compilers to unroll and to spill. */
static void default_sizes(void **state) {
    (void)state;
    static const struct {
        uint32_t channels, length, classes;
        bool relu;
    } rows[] = {{1, 96, 2, false},  {2, 128, 2, false}, {2, 128, 3, true},  {4, 64, 3, false},
                {6, 100, 2, false}, {6, 100, 3, true},  {6, 300, 5, false}, {6, 300, 2, true}};
    static const char *const dtypes[] = {"f64", "f32"};
    for (size_t i = 0; i < 2 * LG_COUNT(rows); i++) {
        char name[32], folder[64], command[128];
        (void)snprintf(name, sizeof name, "default%zu", i);
        const sample of = detector_default(name, rows[i / 2].channels, rows[i / 2].length,
                                           rows[i / 2].classes, rows[i / 2].relu);
        detector_export(&of, dtypes[i % 2], folder, sizeof folder);
        export_check_stack(folder);
        (void)snprintf(command, sizeof command, "make -C %s test stack", folder);
        export_expect(command);
    }
}

static int setup(void **state) {
    (void)state;
    return export_begin();
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_way), cmocka_unit_test(default_sizes)};
    return cmocka_run_group_tests(tests, setup, export_end);
}

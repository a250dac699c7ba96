/* Exported classifiers with every compiler and optimisation; stack. ctest-labels: study */
#include "export_classifier.h"

static void every_way(void **state) {
    (void)state;
    for (size_t s = 0; s < SAMPLES; s++) {
        fitted of;
        char folder[64];
        classifier_make(&samples[s], &of);
        classifier_export(&of, samples[s].folder, s % 3 == 0 ? "f64" : "f32", folder, sizeof folder);
        classifier_free(&of);
        if (s < 2)
            export_check_all_ways(folder, "m");
        else
            export_check_ways(folder, "m");
        export_check_objects(folder, "m");
        export_check_stack(folder);
    }
}

static int setup(void **state) {
    (void)state;
    return export_begin();
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_way)};
    return cmocka_run_group_tests(tests, setup, export_end);
}

/* Exported Hamiltonians compiled in every way: no warning, self-test passed, sanitizers silent, objects that
 * need libm alone, the stated stack. ctest-labels: study */
#include "export_hamiltonian.h"

static void check(const sample *of, const char *dtype, void (*ways)(const char *folder, const char *name)) {
    char folder[64];
    learned made = learned_make(of);
    learned_export(of, dtype, folder, sizeof folder);
    ways(folder, "m");
    export_check_objects(folder, "m");
    export_check_stack(folder);
    learned_free(&made);
}

TEST("one model meets all compilers and levels") {
    check(&samples[1], "f64", export_check_all_ways);
    check(&samples[1], "f32", export_check_all_ways);
}

TEST("every model meets some") {
    for (size_t i = 0; i < SAMPLES; i++) check(&samples[i], i % 2 == 0 ? "f64" : "f32", export_check_ways);
}

TEST_GROUP(hamiltonians_begin, export_end)

/* Exported programs with all compilers at all optimisation levels, in both types, as straight code and as
 * loops.
 * ctest-labels: study */
#define EVERY_WAY
#include "export_program.h"

TEST("every program is built by all compilers") {
    static const char *const programs[] = {"links", "flat", "waves"};
    static const char *const options[] = {"", "--dtype f32", "--compact", "--compact --dtype f32"};
    save_hamiltonian("links", &lg_hamiltonian_chain);
    save_hamiltonian("flat", &lg_hamiltonian_separable);
    save_network("waves");
    for (size_t p = 0; p < LG_COUNT(programs); p++)
        for (size_t o = 0; o < LG_COUNT(options); o++) {
            const char *folder = test_text("%s%zu", programs[p], o);
            export_run(test_text("%s.h5 --out %s --name %s --golden 20 %s", programs[p], folder, programs[p],
                                 options[o]));
            export_check_all_ways(folder, programs[p]);
            export_check_objects(folder, programs[p]);
            export_check_stack(folder);
        }
}

TEST_GROUP(export_begin, export_end)

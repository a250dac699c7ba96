/* Bounds and flags of every operation on numbers, and of compositions, compared with values of MPFR.
 * ctest-labels: src/certify */
#include "exact_checks.h"

TEST("bounds contain the values of MPFR for every operation and kind of box, with every instruction set") {
    check_exact_bounds(5000, 64);
}

TEST("flags are not above the level that MPFR sees at ends, zeros, ties and between") {
    check_exact_flags(600, 65);
}

TEST("bounds and flags of random compositions hold at points of MPFR") {
    check_exact_trees(400, 66);
}

/* The claim of test_constraint about RATTLE, over 1e5 steps.
 * ctest-labels: study src/hamiltonian */
#include "support/constraints.h"

TEST("over 1e5 steps RATTLE stays on the manifold to rounding, and its energy in a band") {
    for (size_t i = 0; i < CONSTRAINTS; i++) constraint_long_run(i, 100000);
}

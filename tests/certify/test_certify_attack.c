/* Random loops that try to get a false proof; what is proved is attacked.
 * ctest-labels: src/certify src/autodiff */
#include "loop_tests.h"

TEST("what is proved of 54 random loops, each kind in each mode, withstands an attack") {
    attack_loops(54, 2000, 6);
}

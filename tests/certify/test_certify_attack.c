/* Random loops that try to get a false proof; what is proved is attacked.
 * ctest-labels: src/certify src/autodiff */
#include "loop_tests.h"

TEST("what is proved of 135 random loops, each kind in each mode, withstands an attack") {
    attack_loops(135, 4000, 12);
}

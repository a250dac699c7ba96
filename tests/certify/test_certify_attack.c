/* Random loops that try to get a false proof; what is proved is attacked.
 * ctest-labels: src/certify src/autodiff */
#include "loop_tests.h"

TEST("what is proved of 405 random loops withstands an attack") {
    attack_loops(405, 4000, 12);
}

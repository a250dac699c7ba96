/* Three thousand random loops. LG_LOOP=NUMBER: that one alone.
 * ctest-labels: slow src/certify src/autodiff */
#include "loop_tests.h"

TEST("what is proved of 3000 random loops withstands 20 000 states and 50 motions each") {
    attack_loops(3000, ATTACK_SAMPLES, ATTACK_STARTS);
}

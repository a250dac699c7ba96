/* Ten thousand random loops. LG_LOOP=NUMBER: that one alone.
 * ctest-labels: study src/certify src/autodiff */
#include "loop_tests.h"

TEST("what is proved of 10 000 random loops withstands 20 000 states and 50 motions each") {
    attack_loops(10000, ATTACK_SAMPLES, ATTACK_STARTS);
}

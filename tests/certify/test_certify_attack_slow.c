/* Random loops, others for each commit. LG_LOOP=NUMBER: that one alone.
 * ctest-labels: slow src/certify src/autodiff */
#include "loop_tests.h"
#include "support/seed.h"

TEST("what is proved of 500 random loops withstands 20 000 states and 50 motions each") {
    attack_loops_from(1000 + 500 * (commit_seed() % 1000000), 500, ATTACK_SAMPLES, ATTACK_STARTS);
}

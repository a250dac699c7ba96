/* ctest-labels: slow study
 * Results of commands in other units of mass, length and time: the whole table; each unit in turn is changed
 * by factors from 1e-9 to 1e9. */
#include "units_support.h"

static int setup(void **state) {
    return cli_begin();
}

TEST("trained, identified, solved and simulated results do not depend on any unit") {
    static const double by[] = {1e-9, 1e-6, 1e3, 1e9};
    units in[3 * LG_COUNT(by)];
    for (size_t i = 0; i < LG_COUNT(by); i++) {
        in[3 * i] = (units){by[i], 1, 1};
        in[3 * i + 1] = (units){1, by[i], 1};
        in[3 * i + 2] = (units){1, 1, by[i]};
    }
    compare_table(in, LG_COUNT(in), false);
}

TEST_GROUP(setup, cli_end)

/* Results of commands in other units of mass, length and time: the quick rows of the table, each in one of
 * two systems in which all three units differ. test_unit_changes_all has all rows in all systems.
 * ctest-labels: apps/common src/mechanics */
#include "units_support.h"

static int setup(void **state) {
    return cli_begin();
}

TEST("trained, identified, solved and simulated results do not depend on the units") {
    static const units in[] = {{1e9, 1e-3, 1e-9}, {1e-9, 1e3, 1e9}};
    compare_table(in, LG_COUNT(in), true);
}

TEST_GROUP(setup, cli_end)

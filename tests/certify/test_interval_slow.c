/* Ten million points.
 * ctest-labels: slow src/certify src/autodiff */
#include "interval_support.h"

TEST("bounds contain the exact values of every operation at ten million points") {
    assert_true(check_bounds(16, 38) >= 10000000);
}

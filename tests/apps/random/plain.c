/* Plain C: the self-test that lg-export writes compares it with plans (random_programs compares far more
 * C). */
#include "apps/random/exports.h"

static bool check(model *m, finding *f) {
    tallied.functions++;
    return make_file(m, "test", f);
}

const target target_c = {.name = "c", .check = check};

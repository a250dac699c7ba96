/* The table of lanes for the instruction set in use, and the check of what lanes support. */
#include "integrators/lanes.h"

#define DECLARE(NAME, name) extern const lg_lane_table lg_lanes_##name;
DECLARE(BASELINE, baseline)
LG_FASTER_SETS(DECLARE)

const lg_lane_table *lg_lanes(void) {
#define ROW(NAME, name) [LG_ISA_##NAME] = &lg_lanes_##name,
    static const lg_lane_table *const tables[LG_ISA_COUNT] = {ROW(BASELINE, baseline) LG_FASTER_SETS(ROW)};
    return tables[lg_isa_in_use()];
}

/* Whether lane_project covers all factors of the space: it projects T*S^2, but not SO(3) and SE(3). */
static bool projects(const lg_space *space) {
    for (size_t i = 0; i < space->factors; i++)
        if (space->factor[i].kind == LG_SPACE_SO3 || space->factor[i].kind == LG_SPACE_SE3) return false;
    return true;
}

bool lg_lanes_fit(const lg_lane_plan *plan) {
    const lg_scheme *scheme = plan->scheme;
    if (!lg_lanes()->knows(plan) || (scheme->project && !projects(&plan->space))) return false;
    if (scheme->kind == LG_SCHEME_COMMUTATOR_FREE) return true;
    return scheme->kind == LG_SCHEME_RKMK && scheme->commutator_count == 0;
}

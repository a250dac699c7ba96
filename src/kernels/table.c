#include "kernels/kernels.h"

#define DECLARE(NAME, name) extern const lg_kernels lg_kernels_f64_##name, lg_kernels_f32_##name;
DECLARE(BASELINE, baseline)
LG_FASTER_SETS(DECLARE)

#define ROW(NAME, name)                                                                                      \
    [LG_ISA_##NAME] = {[LG_F64] = &lg_kernels_f64_##name, [LG_F32] = &lg_kernels_f32_##name},
static const lg_kernels *const tables[LG_ISA_COUNT][2] = {ROW(BASELINE, baseline) LG_FASTER_SETS(ROW)};

const lg_kernels *lg_kernels_for(lg_dtype dtype) {
    return tables[lg_isa_in_use()][dtype];
}

const lg_kernels *lg_kernels_of(lg_dtype dtype, lg_isa isa) {
    return lg_isa_is_here(isa) ? tables[isa][dtype] : NULL;
}

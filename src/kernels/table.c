#include "kernels/kernels.h"

extern const lg_kernels lg_kernels_f64_baseline, lg_kernels_f32_baseline;
#if defined(__x86_64__)
extern const lg_kernels lg_kernels_f64_avx2, lg_kernels_f32_avx2, lg_kernels_f64_avx512,
    lg_kernels_f32_avx512;
#elif defined(__aarch64__)
extern const lg_kernels lg_kernels_f64_neon, lg_kernels_f32_neon;
#endif

static const lg_kernels *const tables[LG_ISA_COUNT][2] = {
    [LG_ISA_BASELINE] = {[LG_F64] = &lg_kernels_f64_baseline, [LG_F32] = &lg_kernels_f32_baseline},
#if defined(__x86_64__)
    [LG_ISA_AVX2] = {[LG_F64] = &lg_kernels_f64_avx2, [LG_F32] = &lg_kernels_f32_avx2},
    [LG_ISA_AVX512] = {[LG_F64] = &lg_kernels_f64_avx512, [LG_F32] = &lg_kernels_f32_avx512},
#elif defined(__aarch64__)
    [LG_ISA_NEON] = {[LG_F64] = &lg_kernels_f64_neon, [LG_F32] = &lg_kernels_f32_neon},
#endif
};

const lg_kernels *lg_kernels_for(lg_dtype dtype) {
    return tables[lg_isa_in_use()][dtype];
}

const lg_kernels *lg_kernels_of(lg_dtype dtype, lg_isa isa) {
    return lg_isa_is_here(isa) ? tables[isa][dtype] : NULL;
}

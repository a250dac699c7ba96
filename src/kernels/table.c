#include "kernels/kernels.h"

extern const lg_kernels lg_kernels_f64_baseline, lg_kernels_f32_baseline;
#if defined(__x86_64__)
extern const lg_kernels lg_kernels_f64_avx2, lg_kernels_f32_avx2, lg_kernels_f64_avx512,
    lg_kernels_f32_avx512;
#endif

static const lg_kernels *const tables[LG_ISA_COUNT][2] = {
    [LG_ISA_BASELINE] = {[LG_F64] = &lg_kernels_f64_baseline, [LG_F32] = &lg_kernels_f32_baseline},
#if defined(__x86_64__)
    [LG_ISA_AVX2] = {[LG_F64] = &lg_kernels_f64_avx2, [LG_F32] = &lg_kernels_f32_avx2},
    [LG_ISA_AVX512] = {[LG_F64] = &lg_kernels_f64_avx512, [LG_F32] = &lg_kernels_f32_avx512},
#endif
};

const lg_kernels *lg_kernels_for(lg_dtype dtype) {
    return tables[lg_isa_in_use()][dtype];
}

static bool machine_has(lg_isa isa) {
#if defined(__x86_64__)
    const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    if (isa == LG_ISA_AVX2) return avx2;
    if (isa == LG_ISA_AVX512)
        return avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
               __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") &&
               __builtin_cpu_supports("avx512cd");
#endif
    return isa == LG_ISA_BASELINE;
}

const lg_kernels *lg_kernels_of(lg_dtype dtype, lg_isa isa) {
    return machine_has(isa) ? tables[isa][dtype] : NULL;
}

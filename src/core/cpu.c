#include "core/core.h"

#include <stdlib.h>
#include <string.h>

static const char *const isa_names[LG_ISA_COUNT] = {"baseline", "avx2", "avx512", "neon"};

const char *lg_isa_name(lg_isa isa) {
    return isa_names[isa];
}

bool lg_isa_is_here(lg_isa isa) {
#if defined(__x86_64__)
    __builtin_cpu_init();
#endif
    switch (isa) {
    case LG_ISA_BASELINE:
        return true;
#if defined(__x86_64__)
    case LG_ISA_AVX2:
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    case LG_ISA_AVX512:
        return lg_isa_is_here(LG_ISA_AVX2) && __builtin_cpu_supports("avx512f") &&
               __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
               __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512cd");
#elif defined(__aarch64__)
    case LG_ISA_NEON:
        return true; /* every arm64 processor has it */
#endif
    default:
        return false;
    }
}

static lg_isa choose(void) {
    const char *asked = getenv("LIEGRAD_ISA");
    lg_isa best = LG_ISA_BASELINE;
    for (lg_isa isa = LG_ISA_BASELINE; isa < LG_ISA_COUNT; isa++) {
        if (!lg_isa_is_here(isa)) continue;
        if (asked != NULL && strcmp(asked, isa_names[isa]) == 0) return isa;
        best = isa;
    }
    return best;
}

/* Several threads may make the first call at once; all of them compute and store the same value. */
lg_isa lg_isa_in_use(void) {
    static _Atomic int chosen = -1;
    int isa = chosen;
    if (isa < 0) chosen = isa = (int)choose();
    return (lg_isa)isa;
}

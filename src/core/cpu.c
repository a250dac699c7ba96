#include "core/core.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const isa_names[LG_ISA_COUNT] = {"baseline", "avx2", "avx512"};

const char *lg_isa_name(lg_isa isa) {
    return isa_names[isa];
}

static lg_isa detect(void) {
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("fma"))
        return LG_ISA_AVX512;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return LG_ISA_AVX2;
#endif
    return LG_ISA_BASELINE;
}

static lg_isa choose(void) {
    const lg_isa best = detect();
    const char *asked = getenv("LIEGRAD_ISA");
    if (asked != NULL)
        for (int i = 0; i <= (int)best; i++)
            if (strcmp(asked, isa_names[i]) == 0) return (lg_isa)i;
    return best;
}

/* Threads may race to the first call: all of them compute and store the same value. */
lg_isa lg_isa_in_use(void) {
    static _Atomic int chosen = -1;
    int isa = chosen;
    if (isa < 0) chosen = isa = (int)choose();
    return (lg_isa)isa;
}

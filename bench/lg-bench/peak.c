/* The peak of a core: multiply-adds on registers alone, with the instruction set that the kernels use. */
#include <stdlib.h>
#include <string.h>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#include "core/core.h"
#include "lg-bench/bench.h"

/* CHAINS independent sums: enough to hide the latency of an addition (4 cycles, two units), and few enough to
 * fit into 16 registers together with both factors. */
enum { CHAINS = 12, STEPS = 4096, MOST_BYTES = 64 };
#define FACTOR   0.5
#define FACTOR_2 0.25

/* Writes one vector to `sums`: the sum over all chains. Chain c begins at c. All intermediate numbers are
 * exact. */
#define LOOP(name, target_, type, vec, all, fma)                                                             \
    target_ static void name(void *sums) {                                                                   \
        const vec x = all((type)FACTOR), y = all((type)FACTOR_2);                                            \
        vec sum[CHAINS];                                                                                     \
        _Pragma("GCC unroll 16") for (int c = 0; c < CHAINS; c++) sum[c] = all((type)c);                     \
        for (int l = 0; l < STEPS; l++) {                                                                    \
            _Pragma("GCC unroll 16") for (int c = 0; c < CHAINS; c++) sum[c] = fma(x, y, sum[c]);            \
        }                                                                                                    \
        _Pragma("GCC unroll 16") for (int c = 1; c < CHAINS; c++) sum[0] += sum[c];                          \
        memcpy(sums, &sum[0], sizeof(vec));                                                                  \
    }

typedef double pair __attribute__((vector_size(16)));
typedef float four __attribute__((vector_size(16)));
#define ALL_2(x)           ((pair){x, x})
#define ALL_4(x)           ((four){x, x, x, x})
#define TWO_OPS(x, y, sum) ((x) * (y) + (sum))
LOOP(baseline_f64, , double, pair, ALL_2, TWO_OPS)
LOOP(baseline_f32, , float, four, ALL_4, TWO_OPS)
#if defined(__x86_64__)
#define AVX2   __attribute__((target("avx2,fma")))
#define AVX512 __attribute__((target("avx512f")))
LOOP(avx2_f64, AVX2, double, __m256d, _mm256_set1_pd, _mm256_fmadd_pd)
LOOP(avx2_f32, AVX2, float, __m256, _mm256_set1_ps, _mm256_fmadd_ps)
LOOP(avx512_f64, AVX512, double, __m512d, _mm512_set1_pd, _mm512_fmadd_pd)
LOOP(avx512_f32, AVX512, float, __m512, _mm512_set1_ps, _mm512_fmadd_ps)
#elif defined(__aarch64__)
#define NEON_FMA_f64(x, y, sum) vfmaq_f64(sum, x, y)
#define NEON_FMA_f32(x, y, sum) vfmaq_f32(sum, x, y)
LOOP(neon_f64, , double, float64x2_t, vdupq_n_f64, NEON_FMA_f64)
LOOP(neon_f32, , float, float32x4_t, vdupq_n_f32, NEON_FMA_f32)
#endif

/* Index: lg_isa. bytes: size of a vector. */
static const struct {
    void (*loop[2])(void *sums); /* For f64 and f32. */
    size_t bytes;
} sets[LG_ISA_COUNT] = {
    [LG_ISA_BASELINE] = {{baseline_f64, baseline_f32}, 16},
#if defined(__x86_64__)
    [LG_ISA_AVX2] = {{avx2_f64, avx2_f32}, 32},
    [LG_ISA_AVX512] = {{avx512_f64, avx512_f32}, 64},
#elif defined(__aarch64__)
    [LG_ISA_NEON] = {{neon_f64, neon_f32}, 16},
#endif
};

void bench_peak(bench *b) {
    const lg_isa isa = lg_isa_in_use();
    const size_t lanes = sets[isa].bytes / bench_size(b->dtype);
    double sums[MOST_BYTES / sizeof(double)]; /* Room for one vector. */
    const double expected = CHAINS * (CHAINS - 1) / 2.0 + CHAINS * STEPS * FACTOR * FACTOR_2;
    bench_row *row = bench_measure(b, "multiply-adds", sets[isa].loop[b->dtype == LG_F32], sums);
    if (row == NULL) return;
    double *found = bench_doubles(b->dtype, sums, 1);
    row->rate = 2e-3 * (double)(lanes * CHAINS * STEPS) / row->median_us;
    row->unit = "GF/s";
    row->error = bench_difference(found, &expected, 1);
    row->error_is = "of a sum, which is exact";
    free(found);
}

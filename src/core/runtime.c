#define _DEFAULT_SOURCE /* for MAP_ANONYMOUS */
#include "core/core.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

/* Functions of OpenBLAS. They are weak symbols, so that linking works with other BLAS libraries too. The last
 * four are exported by OpenBLAS but not documented. */
#define LG_WEAK __attribute__((weak, visibility("default")))
extern LG_WEAK char *openblas_get_corename(void);
extern LG_WEAK char *openblas_get_config(void);
extern LG_WEAK void openblas_set_num_threads(int threads);
extern LG_WEAK int openblas_get_num_threads(void);
extern LG_WEAK void gotoblas_dynamic_quit(void);
extern LG_WEAK void gotoblas_dynamic_init(void);
extern LG_WEAK void *blas_memory_alloc(int procedure);
extern LG_WEAK void blas_memory_free(void *buffer);

int lg_cpu_describe(char *text, size_t size) {
    const char *isa = lg_isa_name(lg_isa_in_use());
    if (openblas_get_corename == NULL) return snprintf(text, size, "kernels %s, BLAS unknown", isa);
    const char *config = openblas_get_config != NULL ? openblas_get_config() : "OpenBLAS";
    int length = 0; /* of name and version in "OpenBLAS 0.3.21 options..." */
    (void)sscanf(config, "%*s%n %*s%n", &length, &length);
    const int threads = openblas_get_num_threads != NULL ? openblas_get_num_threads() : 0;
    return snprintf(text, size, "kernels %s, %.*s %s, %d BLAS thread%s", isa, length, config,
                    openblas_get_corename(), threads, threads == 1 ? "" : "s");
}

/* An OpenBLAS release older than the processor treats it as the newest processor that the release knows. On a
 * machine with AVX-512 it then runs AVX2 kernels, at half the speed. OpenBLAS reads OPENBLAS_CORETYPE when it
 * chooses its table of kernels, so this function sets the variable and makes OpenBLAS choose again. */
static void fit_core_type(void) {
#if defined(__x86_64__)
    static const char *const narrow[] = {"Haswell", "Zen", "Excavator", "Sandybridge", "Nehalem", "Prescott"};
    if (lg_isa_in_use() != LG_ISA_AVX512 || getenv("OPENBLAS_CORETYPE") != NULL) return;
    if (openblas_get_corename == NULL || gotoblas_dynamic_quit == NULL || gotoblas_dynamic_init == NULL)
        return;
    const char *core = openblas_get_corename();
    for (size_t i = 0; i < LG_COUNT(narrow); i++) {
        if (strcmp(core, narrow[i]) != 0) continue;
        if (setenv("OPENBLAS_CORETYPE", "SkylakeX", 1) != 0) return;
        gotoblas_dynamic_quit();
        gotoblas_dynamic_init();
        (void)unsetenv("OPENBLAS_CORETYPE");
        return;
    }
#endif
}

void lg_runtime_setup(void) {
    fit_core_type();
    if (openblas_set_num_threads != NULL) openblas_set_num_threads(1);
}

/* ---- limited memory ----
 *
 * OpenBLAS reserves up to 128 MiB of address space for each thread that multiplies. If there is no room, it
 * tries again forever. Under a limit (ulimit -v) the buffers are therefore reserved at the start, where a
 * failure can be reported.
 */

enum { BUFFERS = 32 };
#define BUFFER_SIZE ((size_t)1 << 27)

static bool has_room(size_t bytes) {
    void *room =
        mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (room == MAP_FAILED) return false;
    (void)munmap(room, bytes);
    return true;
}

bool lg_runtime_reserve(int threads) {
    void *buffer[BUFFERS];
    const int count = threads < 1 ? 1 : threads < BUFFERS ? threads : BUFFERS;
    if (blas_memory_alloc == NULL || blas_memory_free == NULL) return true;
    if (!has_room((size_t)count * BUFFER_SIZE)) return false;
    for (int i = 0; i < count; i++) buffer[i] = blas_memory_alloc(0);
    for (int i = 0; i < count; i++) blas_memory_free(buffer[i]);
    return true;
}

double lg_seconds(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The context: the allocator, the log callback and the cancel flag.
 *
 * A context is immutable after creation and may be shared by threads. Objects made with it must be destroyed
 * before it.
 */
#ifndef LIEGRAD_CONTEXT_H
#define LIEGRAD_CONTEXT_H

#include <stdbool.h>
#include <stddef.h>

#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

typedef struct lg_context lg_context;

/* Element type of a tape, a parameter vector, a model. */
typedef enum lg_dtype { LG_F64 = 0, LG_F32 = 1 } lg_dtype;

typedef enum lg_log_level { LG_LOG_DEBUG, LG_LOG_INFO, LG_LOG_WARNING, LG_LOG_ERROR } lg_log_level;

/* Called with a complete sentence without newline, only from the thread that calls the library. */
typedef void (*lg_log_fn)(void *user, lg_log_level level, const char *message);

/* Returns memory aligned to 64 bytes, or NULL. `bytes` > 0. Must be thread safe. */
typedef void *(*lg_allocate_fn)(void *user, size_t bytes);
typedef void (*lg_release_fn)(void *user, void *memory);

typedef struct lg_context_options {
    size_t size;             /* sizeof(lg_context_options) */
    lg_allocate_fn allocate; /* NULL: the C library's */
    lg_release_fn release;   /* NULL if and only if allocate is NULL */
    void *allocator_user;
    lg_log_fn log; /* NULL: silence */
    void *log_user;
    const volatile int *cancel; /* NULL, or a flag read at safe points: nonzero stops with LG_CANCELLED */
} lg_context_options;

/* Defaults: the C library's allocator, silence, no cancel flag. */
LG_API void lg_context_options_init(lg_context_options *options);

/* `options` may be NULL for the defaults. Errors: LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_context_create(const lg_context_options *options, lg_context **out);
LG_API void lg_context_destroy(lg_context *context); /* NULL is fine */

/* "2.0.0" */
LG_API const char *lg_version(void);

/* Writes one line that names the CPU, the chosen instruction set and the BLAS to `text` (at most `size` bytes
 * with the terminator). Returns the length without truncation, as snprintf does. The environment variable
 * LIEGRAD_ISA=baseline|avx2|avx512|neon forces an instruction set that the machine has. */
LG_API int lg_cpu_describe(char *text, size_t size);

/* For executables, before any thread: gives OpenBLAS one thread and, unless OPENBLAS_CORETYPE is set, the
 * core type that fits this CPU. The library never calls it by itself. */
LG_API void lg_runtime_setup(void);
/* For executables below a limit on their memory (RLIMIT_AS), after the set-up: takes the address space that
 * OpenBLAS needs for so many threads, 128 MiB each; without it OpenBLAS never returns. False: it is not
 * there. */
LG_API bool lg_runtime_reserve(int threads);

LG_END_DECLS

#endif

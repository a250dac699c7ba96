/* needed for RTLD_NEXT */
#define _GNU_SOURCE
#include "support/malloc_count.h"

#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "core/core.h"

#if defined(LG_SANITIZED) || !defined(__GLIBC__)

bool lg_count_available(void) {
    return false;
}
void lg_count_begin(void) {
}
void lg_count_begin_here(void) {
}
lg_counts lg_count_end(void) {
    return (lg_counts){0, 0, 0};
}

#else

static _Atomic int counting;
static _Thread_local int counting_here; /* set in the only thread whose calls are counted */
static _Atomic unsigned long allocations, releases, locks;

bool lg_count_available(void) {
    return true;
}

void lg_count_begin(void) {
    allocations = releases = locks = 0;
    counting = 1;
}

void lg_count_begin_here(void) {
    allocations = releases = locks = 0;
    counting_here = 1;
}

lg_counts lg_count_end(void) {
    counting = counting_here = 0;
    return (lg_counts){allocations, releases, locks};
}

/* Other libraries must find the definitions below, so they must not be hidden like the project's other
 * symbols. */
#pragma GCC visibility push(default)

/* The C library's functions under the names that glibc keeps for programs that replace malloc. */
void *__libc_malloc(size_t bytes);
void *__libc_calloc(size_t count, size_t bytes);
void *__libc_realloc(void *memory, size_t bytes);
void *__libc_memalign(size_t alignment, size_t bytes);
void __libc_free(void *memory);
void *memalign(size_t alignment, size_t bytes);

#define TAKES(counter)                                                                                       \
    do {                                                                                                     \
        if (counting || counting_here) counter++;                                                            \
    } while (0)

void *malloc(size_t bytes) {
    TAKES(allocations);
    return __libc_malloc(bytes);
}

void *calloc(size_t count, size_t bytes) {
    TAKES(allocations);
    return __libc_calloc(count, bytes);
}

void *realloc(void *memory, size_t bytes) {
    TAKES(allocations);
    return __libc_realloc(memory, bytes);
}

void *memalign(size_t alignment, size_t bytes) {
    TAKES(allocations);
    return __libc_memalign(alignment, bytes);
}

void *aligned_alloc(size_t alignment, size_t bytes) {
    TAKES(allocations);
    return __libc_memalign(alignment, bytes);
}

int posix_memalign(void **out, size_t alignment, size_t bytes) {
    TAKES(allocations);
    if (alignment < sizeof(void *) || (alignment & (alignment - 1)) != 0) return EINVAL;
    void *memory = __libc_memalign(alignment, bytes);
    if (memory == NULL) return ENOMEM;
    *out = memory;
    return 0;
}

void free(void *memory) {
    if (memory != NULL) TAKES(releases);
    __libc_free(memory);
}

/* Looks up the definition of a function that follows this executable's definition. */
#define NEXT(type, argument, function)                                                                       \
    static int next_##function(type *argument) {                                                             \
        static _Atomic(uintptr_t) found;                                                                     \
        if (found == 0) found = (uintptr_t)dlsym(RTLD_NEXT, #function);                                      \
        return ((int (*)(type *))(uintptr_t)found)(argument);                                                \
    }                                                                                                        \
    int function(type *argument) {                                                                           \
        TAKES(locks);                                                                                        \
        return next_##function(argument);                                                                    \
    }

NEXT(pthread_mutex_t, mutex, pthread_mutex_lock)
NEXT(pthread_mutex_t, mutex, pthread_mutex_trylock)
NEXT(pthread_rwlock_t, lock, pthread_rwlock_rdlock)
NEXT(pthread_rwlock_t, lock, pthread_rwlock_wrlock)

#pragma GCC visibility pop

#endif

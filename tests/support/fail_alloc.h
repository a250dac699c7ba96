/* An allocator that fails on request and counts the blocks that are still allocated. Thread safe.
 *
 *     lg_fail_alloc memory;
 *     lg_context *context = lg_fail_alloc_context(&memory);
 *     for (long n = 1;; n++) {                       // make the n-th allocation fail, for every n
 *         lg_fail_alloc_arm(&memory, n);
 *         lg_status status = what_is_tested(context, &out);
 *         if (!lg_fail_alloc_hit(&memory)) break;    // fewer than n allocations: all have been tried
 *         assert_int_equal(status, LG_OUT_OF_MEMORY);
 *         assert_int_equal(lg_fail_alloc_live(&memory), 0);
 *     }
 *
 * lg_fail_alloc_live is the number of blocks allocated since the last lg_fail_alloc_arm and not freed.
 * `bytes` is the sum of the sizes requested since then. */
#ifndef LG_FAIL_ALLOC_H
#define LG_FAIL_ALLOC_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>

#include "liegrad/core.h"

typedef struct lg_fail_alloc {
    atomic_long calls;   /* allocations requested since lg_fail_alloc_arm */
    atomic_long live;    /* blocks allocated minus blocks freed since lg_fail_alloc_arm */
    atomic_ullong bytes; /* bytes requested since lg_fail_alloc_arm */
    atomic_long fail_at; /* number of the call that fails, from 1; 0: no call fails */
    atomic_bool ended;   /* all calls after call `fail_at` fail too */
} lg_fail_alloc;

static inline void *lg_fail_alloc_take(void *user, size_t bytes) {
    lg_fail_alloc *memory = (lg_fail_alloc *)user;
    const long call = atomic_fetch_add(&memory->calls, 1) + 1;
    atomic_fetch_add(&memory->bytes, bytes);
    const long fail_at = atomic_load(&memory->fail_at);
    if (call == fail_at || (fail_at > 0 && call > fail_at && atomic_load(&memory->ended))) return NULL;
    void *block = NULL;
    if (posix_memalign(&block, 64, bytes) != 0) return NULL;
    atomic_fetch_add(&memory->live, 1);
    return block;
}

static inline void lg_fail_alloc_release(void *user, void *block) {
    lg_fail_alloc *memory = (lg_fail_alloc *)user;
    if (block != NULL) atomic_fetch_sub(&memory->live, 1);
    free(block);
}

static inline void lg_fail_alloc_arm(lg_fail_alloc *memory, long n) {
    atomic_store(&memory->calls, 0);
    atomic_store(&memory->live, 0);
    atomic_store(&memory->bytes, 0);
    atomic_store(&memory->fail_at, n);
    atomic_store(&memory->ended, false);
}

/* Makes the n-th allocation and all later ones fail. */
static inline void lg_fail_alloc_arm_end(lg_fail_alloc *memory, long n) {
    lg_fail_alloc_arm(memory, n);
    atomic_store(&memory->ended, true);
}

/* Whether the armed failure has happened. */
static inline bool lg_fail_alloc_hit(lg_fail_alloc *memory) {
    const long fail_at = atomic_load(&memory->fail_at);
    return fail_at > 0 && atomic_load(&memory->calls) >= fail_at;
}

static inline long lg_fail_alloc_live(lg_fail_alloc *memory) {
    return atomic_load(&memory->live);
}

/* A context that allocates from `memory`; NULL if it cannot be made. No allocation is set to fail. */
static inline lg_context *lg_fail_alloc_context(lg_fail_alloc *memory) {
    lg_fail_alloc_arm(memory, 0);
    lg_context_options options;
    lg_context_options_init(&options);
    options.allocate = lg_fail_alloc_take;
    options.release = lg_fail_alloc_release;
    options.allocator_user = memory;
    lg_context *context = NULL;
    return lg_context_create(&options, &context) == LG_OK ? context : NULL;
}

#endif

/* The memory of a tape: a bump arena holds recorded values, and a pool with size classes holds values that
 * are needed only during one pass. */
#include "autodiff/tape/tape_internal.h"

#include <string.h>

#define FIRST_CHUNK  ((size_t)1 << 16)
#define LARGEST_STEP ((size_t)1 << 24)

static size_t round_up(size_t bytes) {
    return (bytes + (LG_ALIGNMENT - 1)) & ~(size_t)(LG_ALIGNMENT - 1);
}

static void *counted_alloc(lg_tape *tape, size_t bytes) {
    if (tape->options.max_size != 0 && tape->bytes + bytes > tape->options.max_size) {
        lg_tape_fail(tape, LG_OUT_OF_MEMORY, "tape", "the limit max_size was reached");
        return NULL;
    }
    void *memory = lg_alloc(tape->context, bytes, 1);
    if (memory == NULL) {
        lg_tape_fail(tape, LG_OUT_OF_MEMORY, "tape", "an allocation failed");
        return NULL;
    }
    tape->bytes += bytes;
    return memory;
}

bool lg_grow(lg_tape *tape, void **array, uint32_t *capacity, uint32_t needed, size_t element) {
    if (needed <= *capacity) return true;
    uint32_t grown = *capacity < 64 ? 64 : *capacity;
    while (grown < needed) {
        if (grown > UINT32_MAX / 2) {
            lg_tape_fail(tape, LG_OUT_OF_MEMORY, "tape", "more than 2^31 nodes");
            return false;
        }
        grown *= 2;
    }
    void *memory = counted_alloc(tape, grown * element);
    if (memory == NULL) return false;
    if (*array != NULL) {
        memcpy(memory, *array, *capacity * element);
        lg_free(tape->context, *array);
        tape->bytes -= *capacity * element;
    }
    *array = memory;
    *capacity = grown;
    return true;
}

/* Moves to the next chunk that is large enough for `bytes`, or appends a new one when none is. Skipped chunks
 * stay empty until the next rewind, so a repeated step takes the same path and allocates nothing. */
static bool next_chunk(lg_tape *tape, lg_arena *arena, size_t bytes) {
    uint32_t next = arena->count == 0 ? 0 : arena->current + 1;
    while (next < arena->count && arena->chunks[next].size < bytes) next++;
    if (next == arena->count) {
        if (!lg_grow(tape, (void **)&arena->chunks, &arena->capacity, arena->count + 1,
                     sizeof *arena->chunks))
            return false;
        size_t size = arena->count == 0 ? FIRST_CHUNK : 2 * arena->chunks[arena->count - 1].size;
        if (size > LARGEST_STEP) size = LARGEST_STEP;
        if (size < bytes) size = bytes;
        unsigned char *base = counted_alloc(tape, size);
        if (base == NULL) return false;
        arena->chunks[arena->count++] = (lg_chunk){base, size};
    }
    arena->current = next;
    arena->used = 0;
    return true;
}

void *lg_arena_allocate(lg_tape *tape, lg_arena *arena, size_t bytes) {
    bytes = round_up(bytes == 0 ? 1 : bytes);
    if (arena->count == 0 || arena->chunks[arena->current].size - arena->used < bytes)
        if (!next_chunk(tape, arena, bytes)) return NULL;
    void *memory = arena->chunks[arena->current].base + arena->used;
    arena->used += bytes;
    return memory;
}

void lg_arena_destroy(lg_tape *tape, lg_arena *arena) {
    for (uint32_t i = 0; i < arena->count; i++) lg_free(tape->context, arena->chunks[i].base);
    lg_free(tape->context, arena->chunks);
    *arena = (lg_arena){0};
}

/* There are four size classes per octave, starting at 64 bytes. Returns the class of `bytes` and rounds
 * `bytes` up to the block size of this class. */
static uint32_t size_class(size_t *bytes) {
    size_t units = round_up(*bytes == 0 ? 1 : *bytes) / LG_ALIGNMENT;
    if (units <= 4) {
        *bytes = units * LG_ALIGNMENT;
        return (uint32_t)units - 1;
    }
    uint32_t octave = 63u - (uint32_t)__builtin_clzll(
                                (unsigned long long)(units - 1)); /* 2^octave < units <= 2^(octave+1) */
    size_t step = (size_t)1 << (octave - 2);
    uint32_t quarter = (uint32_t)((units - 1 - ((size_t)1 << octave)) >> (octave - 2)); /* 0..3 */
    *bytes = (((size_t)1 << octave) + (quarter + 1) * step) * LG_ALIGNMENT;
    return 4 + (octave - 2) * 4 + quarter;
}

void *lg_pool_take(lg_tape *tape, size_t bytes) {
    uint32_t class = size_class(&bytes);
    void *block = tape->pool.free[class];
    if (block == NULL) return lg_arena_allocate(tape, &tape->pool.arena, bytes);
    memcpy(&tape->pool.free[class], block, sizeof block);
    return block;
}

void lg_pool_give(lg_tape *tape, void *block, size_t bytes) {
    uint32_t class = size_class(&bytes);
    memcpy(block, &tape->pool.free[class], sizeof block);
    tape->pool.free[class] = block;
}

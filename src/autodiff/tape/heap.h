/* Memory that is freed all at once: pieces of blocks from the context. */
#ifndef LG_HEAP_H
#define LG_HEAP_H

#include "core/core.h"

typedef struct lg_heap {
    const lg_context *context;
    struct lg_heap_block *block;
    size_t used, size; /* of the newest block */
    size_t bytes;      /* taken in all */
    size_t most;       /* limit of `bytes`; 0: none */
} lg_heap;

/* Zeroed, 64-byte aligned; NULL: out of memory, or beyond the limit. */
void *lg_heap_take(lg_heap *heap, size_t count, size_t size);
void lg_heap_destroy(lg_heap *heap);

#endif

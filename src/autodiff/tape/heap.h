/* A heap whose pieces are freed all at once. They are cut from larger blocks of the context's allocator. */
#ifndef LG_HEAP_H
#define LG_HEAP_H

#include "core/core.h"

typedef struct lg_heap {
    const lg_context *context;
    struct lg_heap_block *block;
    size_t used, size; /* of the newest block: bytes taken, bytes in all */
    size_t bytes;      /* total handed out so far */
    size_t most;       /* limit on `bytes`; 0 means no limit */
} lg_heap;

/* Memory for `count` elements of `size` bytes, zeroed and 64-byte aligned. Returns NULL when out of memory or
 * beyond the limit. */
void *lg_heap_take(lg_heap *heap, size_t count, size_t size);
void lg_heap_destroy(lg_heap *heap);

#endif

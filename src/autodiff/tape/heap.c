#include "autodiff/tape/heap.h"

struct lg_heap_block {
    struct lg_heap_block *before;
};

enum { FIRST = 1 << 14, HEAD = LG_ALIGNMENT };

static bool new_block(lg_heap *heap, size_t bytes) {
    size_t size = heap->size == 0 ? FIRST : 2 * heap->size;
    if (size > (size_t)1 << 22) size = (size_t)1 << 22;
    if (size < bytes + HEAD) size = bytes + HEAD;
    struct lg_heap_block *block = lg_alloc(heap->context, size, 1);
    if (block == NULL) return false;
    block->before = heap->block;
    heap->block = block;
    heap->size = size;
    heap->used = HEAD;
    return true;
}

void *lg_heap_take(lg_heap *heap, size_t count, size_t size) {
    if (size != 0 && count > (SIZE_MAX / 4) / size) return NULL;
    const size_t bytes = (count * size + LG_ALIGNMENT) & ~(size_t)(LG_ALIGNMENT - 1);
    if (heap->most != 0 && (bytes > heap->most || heap->bytes > heap->most - bytes)) return NULL;
    if ((heap->block == NULL || heap->size - heap->used < bytes) && !new_block(heap, bytes)) return NULL;
    void *memory = (unsigned char *)heap->block + heap->used;
    heap->used += bytes;
    heap->bytes += bytes;
    return memory;
}

void lg_heap_destroy(lg_heap *heap) {
    while (heap->block != NULL) {
        struct lg_heap_block *before = heap->block->before;
        lg_free(heap->context, heap->block);
        heap->block = before;
    }
    *heap = (lg_heap){.context = heap->context, .most = heap->most};
}

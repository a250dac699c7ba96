/* Allocation in the caller's memory. */
#include "core/portions.h"

void *lg_portion(lg_portions *from, size_t count, size_t size) {
    void *at = from->base != NULL ? from->base + from->used : NULL;
    const size_t left = (SIZE_MAX - from->used) / LG_ALIGNMENT * LG_ALIGNMENT;
    const bool fits = size == 0 || count <= left / size;
    from->used +=
        fits ? (count * size + LG_ALIGNMENT - 1) / LG_ALIGNMENT * LG_ALIGNMENT : SIZE_MAX - from->used;
    return at;
}

lg_status lg_portions_check(const void *memory, size_t bytes, size_t needed, lg_error *error) {
    if (memory == NULL || (uintptr_t)memory % LG_ALIGNMENT != 0)
        return lg_fail(error, LG_INVALID_ARGUMENT, "the memory is NULL or not aligned to %d bytes",
                       LG_ALIGNMENT);
    if (bytes < needed)
        return lg_fail(error, LG_INVALID_ARGUMENT, "%zu bytes of memory are given, %zu are needed", bytes,
                       needed);
    return LG_OK;
}

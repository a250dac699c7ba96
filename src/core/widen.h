/* Arrays that grow. */
#ifndef LG_WIDEN_H
#define LG_WIDEN_H

#include <string.h>

#include "core/core.h"

/* Returns a copy of an array of `count` elements with room for `room`, and frees `old`. Returns NULL without
 * memory; then `old` stays. */
static inline void *lg_widen(const lg_context *context, void *old, size_t count, size_t room, size_t size) {
    void *wider = lg_alloc(context, room, size);
    if (wider == NULL) return NULL;
    if (count > 0) memcpy(wider, old, count * size);
    lg_free(context, old);
    return wider;
}

#endif
